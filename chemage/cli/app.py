"""The command line. Commands import what they need when they run, so that ``chemage --help`` is fast.

Exit status: 0 success, 1 a check found problems or points of a sweep failed, 2 invalid input, 3 an error in the code,
130 interrupted, 143 terminated (SIGTERM).
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import time
from functools import lru_cache
from typing import Annotated, Any

import typer
import typer.core

from chemage.cli import experiments, output, plugins, reference, results
from chemage.foundation.errors import ChemageError, printable, shortened
from chemage.foundation.memory import require_address_space
from chemage.foundation.ownership import in_words, naming_owner, owner_of
from chemage.foundation.progress import LOGGER, loaded
from chemage.plugins import registry
from chemage.plugins.context import PREFER, preference

#: heading in the help -> its commands
COMMANDS = {
    "Experiments": (
        experiments.init,
        experiments.check,
        experiments.run,
        experiments.sweep,
        experiments.status,
    ),
    "Results": (
        results.show,
        results.plot,
        results.compare,
        results.report,
        results.arrhenius,
        results.cite,
    ),
    "Reference": (
        reference.materials,
        reference.schema,
        reference.warmup,
        reference.selftest,
    ),
}
_OF_PLUGINS = "Commands of plugins"
#: set by the script that the shell runs for completion
_COMPLETE = "_CHEMAGE_COMPLETE"


class _Commands(typer.core.TyperGroup):
    """The commands under the headings of ``COMMANDS``."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, Any]]] = {
            heading: [] for heading in COMMANDS
        }
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                heading = getattr(command, "rich_help_panel", None)
                sections.setdefault(
                    heading if isinstance(heading, str) else _OF_PLUGINS, []
                ).append((name, command))
        longest = max(
            len(name) for listed in sections.values() for name, _ in listed
        )
        for heading, listed in sections.items():
            if listed:
                with formatter.section(heading):
                    room = formatter.width - 6 - longest
                    lines = [
                        (f"{name:{longest}}", command.get_short_help_str(room))
                        for name, command in listed
                    ]
                    formatter.write_dl(lines)


app = typer.Typer(
    name="chemage",
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Chemical ageing of frictional contacts: from a rough surface or a tip to the rise of static friction.",
    epilog="`chemage COMMAND -h` explains a command. Begin with: chemage init NAME, or chemage run silica-tip.",
)


def _print_version(requested: bool) -> None:
    if requested:
        from chemage.foundation.names import __version__

        print(f"chemage {__version__}")
        raise typer.Exit


for _heading, _commands in COMMANDS.items():
    for _command in _commands:
        app.command(rich_help_panel=_heading)(_command)
app.add_typer(plugins.plugins_app, name="plugins", rich_help_panel="Reference")


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="print the version and exit",
        ),
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PLUGIN",
            help="leave out an installed plugin, see `chemage plugins list`; may be repeated; before the command",
        ),
    ] = None,
    prefer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PLUGIN",
            help="let this plugin come first where several implement a stage, read a file or have a kind; may be "
            "repeated, in order; before the command",
        ),
    ] = None,
) -> None:
    pass


def _choose_plugins(words: list[str]) -> None:
    """Apply ``--without`` and ``--prefer``, before plugins are found; processes that are started inherit them."""
    chosen: dict[str, list[str]] = {"--without": [], "--prefer": []}
    for at, word in enumerate(words):
        name, _, value = word.partition("=")
        if name in chosen:
            chosen[name].append(
                value or (words[at + 1] if at + 1 < len(words) else "")
            )
        elif not word.startswith("-") and (
            at == 0 or words[at - 1] not in (*chosen, "--log")
        ):
            break
    if chosen["--without"]:
        before = filter(None, [os.environ.get("CHEMAGE_PLUGINS", "")])
        os.environ["CHEMAGE_PLUGINS"] = ",".join(
            [*before, *(f"-{name}" for name in chosen["--without"])]
        )
    if chosen["--prefer"]:
        os.environ[PREFER] = ",".join(chosen["--prefer"])


def _add_plugin_commands() -> None:
    """Add the commands of plugins; a plugin whose commands cannot be added is reported and skipped."""
    import warnings

    registry.current().check_preference(preference(), PREFER)
    registered = [
        command
        for command in app.registered_commands
        if command.callback is not None
    ]
    taken = {
        command.name or getattr(command.callback, "__name__", "")
        for command in registered
    }
    taken |= {
        command.name
        for command in app.registered_groups
        if isinstance(command.name, str)
    }
    for hook in registry.current().manager.hook.chemage_cli.get_hookimpls():
        try:
            commands: Any = hook.function()
            for name, function in commands:
                if name in taken:
                    if any(
                        function is getattr(command.callback, "__wrapped__", None)
                        for command in app.registered_commands
                    ):
                        continue  # a second call in one process
                    raise ValueError(f"the command {name!r} exists already")
                taken.add(name)
                trial = typer.Typer()
                trial.command(name)(function)
                typer.main.get_command(
                    trial
                )  # raises if typer cannot read the signature
                owned = naming_owner(function, f"the command {name!r}".format)
                app.command(name, rich_help_panel=_OF_PLUGINS)(owned)
        except (Exception, SystemExit) as error:
            if registry.current().strict:
                raise
            warnings.warn(
                f"commands of plugin {hook.plugin_name} were skipped: {in_words(error)}",
                registry.PluginWarning,
                stacklevel=2,
            )


def _all_commands() -> Any:
    """Every command, those of plugins included, with the options that all of them have."""
    _add_plugin_commands()
    return _built(tuple(app.registered_commands))


@lru_cache(maxsize=1)
def _built(registered: tuple[Any, ...]) -> Any:
    commands = typer.main.get_command(app)
    output.add_to(commands)
    return commands


def main() -> None:
    """Run the command line; a :class:`chemage.ChemageError` is printed as one message on stderr."""
    begin, status = time.perf_counter(), 0
    for name in ("stdout", "stderr"):
        if (
            getattr(sys, name) is None
        ):  # the caller has closed it; no file that is opened later takes its number
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    try:
        output.begin()
        require_address_space()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(
                    errors="backslashreplace"
                )  # for terminals that cannot show µ or Δ
        _plain_warnings()
        _print_version(
            sys.argv[1:2] == ["--version"]
        )  # before plugins are imported
        _choose_plugins(sys.argv[1:])
        commands = _all_commands()
        if _COMPLETE in os.environ:
            commands.main(prog_name="chemage", complete_var=_COMPLETE)
        # typer's own main catches the KeyboardInterrupt
        with commands.make_context("chemage", sys.argv[1:]) as context:
            commands.invoke(context)
        sys.stdout.flush()
    except typer.Exit as end:
        status = end.exit_code
    except (KeyboardInterrupt, typer.Abort) as stop:
        word, status = output.stopped()
        text = f"{word}; {str(stop) or 'nothing was written'}"
        _complain(f"\n{text}")
        LOGGER.error("%s", text)
        os._exit(
            status
        )  # without waiting for threads that may still be in a compiled kernel
    except Exception as error:
        status = _explain(error)
    LOGGER.info(
        "ended with status %d after %.2f s", status, time.perf_counter() - begin
    )
    output.end()
    sys.exit(status)


def _complain(text: str) -> None:
    """Print on stderr, control characters as escapes."""
    loaded()
    with contextlib.suppress(OSError, ValueError):
        print(printable(text), file=sys.stderr, flush=True)


def _plain_warnings() -> None:
    import warnings

    def plain(message: Warning | str, *_: Any, **__: Any) -> None:
        _complain(f"chemage: warning: {message}")
        LOGGER.warning("%s", message)

    warnings.showwarning = plain
    # of PYTHONWARNINGS=error, here and in workers: what a command warns of is a message, and no end
    sys.warnoptions[:] = [
        option for option in sys.warnoptions if not option.startswith("e")
    ]
    if "PYTHONWARNINGS" in os.environ:
        os.environ["PYTHONWARNINGS"] = ",".join(sys.warnoptions)
        warnings.filters[:] = [one for one in warnings.filters if one[0] != "error"]  # pyright: ignore[reportIndexIssue]


def _explain(error: Exception) -> int:
    show_usage = getattr(error, "show", None)  # a usage error found by typer
    text = "\n".join([f"{error}", *getattr(error, "__notes__", ())])
    owner, where = owner_of(error)
    known = (
        isinstance(error, ChemageError | OSError | MemoryError)
        or show_usage is not None
    )
    LOGGER.error("%s", text, exc_info=not known)
    if isinstance(error, ChemageError):
        _complain(f"chemage: {text}")
        return 2
    if show_usage is not None:
        show_usage()
        return int(getattr(error, "exit_code", 2))
    if isinstance(error, OSError):
        # what stdout still holds goes nowhere: the interpreter would report a closed pipe or a full disk again
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(
            error, BrokenPipeError
        ):  # the reader of the pipe has closed it
            return 0
        _complain(f"chemage: {text}")
        return 2
    if isinstance(error, MemoryError):
        _complain(
            f"chemage: not enough memory: {text}; `chemage check` estimates what a scene needs"
        )
        return 2
    where = "\n".join(
        filter(None, ["--log FILE writes where it arose to FILE", where])
    )
    _complain(
        f"chemage: this is a fault of {owner or 'chemage'}, please report it: {type(error).__name__}: "
        f"{shortened(error, 200)}; {where}"
    )
    return 3
