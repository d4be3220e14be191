"""The command line. Commands import what they need when they run, so that ``chemage --help`` is instant.

Exit status: 0 done, 1 a check found problems, 2 the user's input is wrong, 130 interrupted.
"""

from __future__ import annotations

import io
import os
import sys
from typing import Annotated, Any

import typer

from chemage.cli import experiments, plugins, results

app = typer.Typer(
    name="chemage",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    help="Chemical ageing of frictional contacts: from a rough surface or a tip to the rise of static friction.",
)


def _version(wanted: bool) -> None:
    if wanted:
        from chemage.foundation.version import __version__

        print(f"chemage {__version__}")
        raise typer.Exit


for command in (
    experiments.run,
    experiments.check,
    results.status,
    results.show,
    results.plot,
    results.compare,
    results.report,
    experiments.tradeoff,
    experiments.schema,
    experiments.init,
):
    app.command()(command)
app.add_typer(plugins.plugins_app, name="plugins")


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version and exit")
    ] = False,
) -> None:
    pass


def _add_plugin_commands() -> None:
    """Add the commands of plugins; one that cannot be added is reported and skipped."""
    import warnings

    from chemage.plugins import registry

    known = _command_names()
    for hook in registry.current().manager.hook.chemage_cli.get_hookimpls():
        try:
            offered: Any = hook.function()
            for name, function in offered:
                if name in known:
                    if any(function is one.callback for one in app.registered_commands):
                        continue  # a second call in one process
                    raise ValueError(f"there is a command {name!r} already")
                known.add(name)
                trial = typer.Typer()
                trial.command(name)(function)
                typer.main.get_command(trial)  # a signature that typer cannot read shows here
                app.command(name)(function)
        except (Exception, SystemExit) as error:
            if registry.current().strict:
                raise
            warnings.warn(
                f"commands of plugin {hook.plugin_name} were skipped: {type(error).__name__}: {error}",
                registry.PluginWarning,
                stacklevel=2,
            )


def _command_names() -> set[str]:
    return set(typer.main.get_group(app).commands)


def main() -> None:
    """Run the command line; every error of ours is one message on stderr."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # a terminal without µ or Δ
        _plain_warnings()
        _add_plugin_commands()
        commands = typer.main.get_command(app)
        # typer's own main would swallow the KeyboardInterrupt
        with commands.make_context("chemage", sys.argv[1:]) as context:
            commands.invoke(context)
        sys.stdout.flush()
        sys.exit(0)
    except typer.Exit as end:
        sys.exit(end.exit_code)
    except (KeyboardInterrupt, typer.Abort) as stop:
        print(f"\ninterrupted; {str(stop) or 'nothing was written'}", file=sys.stderr, flush=True)
        # worker threads may still be inside a compiled kernel; waiting for them would not help anyone
        os._exit(130)
    except Exception as error:
        sys.exit(_explain(error))


def _plain_warnings() -> None:
    import warnings

    def plain(message: Warning | str, *_: Any, **__: Any) -> None:
        print(f"chemage: warning: {message}", file=sys.stderr)

    warnings.showwarning = plain


def _explain(error: Exception) -> int:
    from chemage.foundation.errors import ChemageError

    if isinstance(error, ChemageError):
        print("\n".join([f"chemage: {error}", *getattr(error, "__notes__", ())]), file=sys.stderr)
        return 2
    display = getattr(error, "show", None)  # a usage error of the command line itself
    if display is not None:
        display()
        return int(getattr(error, "exit_code", 2))
    if isinstance(error, BrokenPipeError):  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if isinstance(error, OSError):
        print(f"chemage: {error}", file=sys.stderr)
        return 2
    if isinstance(error, MemoryError):
        print(f"chemage: not enough memory: {error}; `chemage check` says what a scene needs", file=sys.stderr)
        return 2
    raise error
