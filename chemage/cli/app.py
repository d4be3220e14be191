"""The command line. Commands import what they need when they run, so that ``chemage --help`` is fast.

Exit status: 0 success, 1 a check found problems or points of a sweep failed, 2 invalid input, 130 interrupted.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from typing import Annotated, Any

import typer

from chemage.cli import experiments, plugins, results
from chemage.plugins.in_use import PREFER, preference

app = typer.Typer(
    name="chemage",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    help="Chemical ageing of frictional contacts: from a rough surface or a tip to the rise of static friction.",
)


def _print_version(requested: bool) -> None:
    if requested:
        from chemage.foundation.version import __version__

        print(f"chemage {__version__}")
        raise typer.Exit


for command in (
    experiments.run,
    experiments.check,
    experiments.status,
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
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and exit")
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="PLUGIN", help="leave out an installed plugin, see `chemage plugins list`; repeatable"),
    ] = None,
    prefer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PLUGIN",
            help="let this plugin come first where several answer a stage or read a file; repeatable, the first comes "
            "first",
        ),
    ] = None,
) -> None:
    pass


def _choose_plugins(words: list[str]) -> None:
    """Apply ``--without`` and ``--prefer``, before plugins are found; processes that are started inherit them."""
    given: dict[str, list[str]] = {"--without": [], "--prefer": []}
    for at, word in enumerate(words):
        name, _, value = word.partition("=")
        if name in given:
            given[name].append(value or (words[at + 1] if at + 1 < len(words) else ""))
        elif not word.startswith("-") and (at == 0 or words[at - 1] not in given):
            break
    if given["--without"]:
        before = filter(None, [os.environ.get("CHEMAGE_PLUGINS", "")])
        os.environ["CHEMAGE_PLUGINS"] = ",".join([*before, *(f"-{name}" for name in given["--without"])])
    if given["--prefer"]:
        os.environ[PREFER] = ",".join(given["--prefer"])


def _add_plugin_commands() -> None:
    """Add the commands of plugins; a plugin whose commands cannot be added is reported and skipped."""
    import warnings

    from chemage.plugins import registry

    registry.current().check_preference(preference(), PREFER)
    known = set(typer.main.get_group(app).commands)
    for hook in registry.current().manager.hook.chemage_cli.get_hookimpls():
        try:
            commands: Any = hook.function()
            for name, function in commands:
                if name in known:
                    if any(function is one.callback for one in app.registered_commands):
                        continue  # a second call in one process
                    raise ValueError(f"the command {name!r} exists already")
                known.add(name)
                trial = typer.Typer()
                trial.command(name)(function)
                typer.main.get_command(trial)  # raises if typer cannot read the signature
                app.command(name)(function)
        except (Exception, SystemExit) as error:
            if registry.current().strict:
                raise
            warnings.warn(
                f"commands of plugin {hook.plugin_name} were skipped: {type(error).__name__}: {error}",
                registry.PluginWarning,
                stacklevel=2,
            )


def main() -> None:
    """Run the command line; a :class:`chemage.ChemageError` is printed as one message on stderr."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # for terminals that cannot show µ or Δ
        _plain_warnings()
        _choose_plugins(sys.argv[1:])
        _add_plugin_commands()
        commands = typer.main.get_command(app)
        # typer's own main catches the KeyboardInterrupt
        with commands.make_context("chemage", sys.argv[1:]) as context:
            commands.invoke(context)
        if sys.stdout is not None:  # None where the caller has closed it
            sys.stdout.flush()
        sys.exit(0)
    except typer.Exit as end:
        sys.exit(end.exit_code)
    except (KeyboardInterrupt, typer.Abort) as stop:
        _complain(f"\ninterrupted; {str(stop) or 'nothing was written'}")
        os._exit(130)  # without waiting for threads that may still be in a compiled kernel
    except Exception as error:
        sys.exit(_explain(error))


def _complain(text: str) -> None:
    """Print on stderr, control characters as escapes; nothing where stderr is closed."""
    from chemage.foundation.printable import printable

    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            print(printable(text), file=sys.stderr, flush=True)


def _discard_output() -> None:
    """Send what stdout still holds nowhere, so that the interpreter does not fail on it at its end."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _plain_warnings() -> None:
    import warnings

    def plain(message: Warning | str, *_: Any, **__: Any) -> None:
        _complain(f"chemage: warning: {message}")

    warnings.showwarning = plain


def _explain(error: Exception) -> int:
    from chemage.foundation.errors import ChemageError

    if isinstance(error, ChemageError):
        _complain("\n".join([f"chemage: {error}", *getattr(error, "__notes__", ())]))
        return 2
    show_usage = getattr(error, "show", None)  # a usage error found by typer
    if show_usage is not None:
        show_usage()
        return int(getattr(error, "exit_code", 2))
    if isinstance(error, BrokenPipeError):  # the reader of the pipe has closed it
        _discard_output()
        return 0
    if isinstance(error, OSError):
        _discard_output()  # a full disk behind stdout would be reported again at the end
        _complain(f"chemage: {error}")
        return 2
    if isinstance(error, MemoryError):
        _complain(f"chemage: not enough memory: {error}; `chemage check` estimates what a scene needs")
        return 2
    raise error
