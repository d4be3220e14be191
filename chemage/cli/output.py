"""The options of every command about what is printed: ``-q``, ``-v`` and ``--log FILE``, and help by ``-h``.

They stand before or after the name of a command. What they show comes from the logger ``chemage``, to which the stages
report; see :mod:`chemage.foundation.progress`.
"""

from __future__ import annotations

import logging
import os
import platform
import shlex
import signal
import sys
import threading
import time
from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import Annotated, Any

import typer

from chemage.foundation import progress
from chemage.foundation.progress import LOGGER


class _State:
    """What the options of this call of the program ask for."""

    def __init__(self) -> None:
        self.quiet = self.verbose = False
        self.log: Path | None = None
        self.handlers: list[logging.Handler] = []
        #: whether SIGTERM has come, and what received it before
        self.terminated = False
        self.before: Any = None


_state = _State()


def quiet() -> bool:
    """Whether tables, notes and progress are left out."""
    return _state.quiet


def begin() -> None:
    """Forget what an earlier call in this process has set."""
    end()
    _state.quiet = _state.verbose = False
    _state.log = None
    progress.silence(False)
    _state.terminated = False
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        _state.before = signal.signal(signal.SIGTERM, _terminate)


def _terminate(number: int, frame: Any) -> None:
    """End as Ctrl-C does, for schedulers; a second signal ends the process at once."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _state.terminated = True
    raise KeyboardInterrupt


def stopped() -> tuple[str, int]:
    """What stopped this call of the program, in a word, and its exit status."""
    return ("terminated", 143) if _state.terminated else ("interrupted", 130)


def end() -> None:
    """Close the log, and give the signals back."""
    if _state.before is not None:
        signal.signal(signal.SIGTERM, _state.before)
        _state.before = None
    for handler in _state.handlers:
        LOGGER.removeHandler(handler)
        handler.close()
    _state.handlers.clear()
    LOGGER.setLevel(logging.NOTSET)


def _be_quiet(context: typer.Context, given: bool) -> None:
    if given and not context.resilient_parsing:
        _state.quiet = True
        progress.silence(True)
        _check()


def _be_verbose(context: typer.Context, given: bool) -> None:
    if given and not _state.verbose and not context.resilient_parsing:
        _state.verbose = True
        progress.silence(True)  # the lines say more, and bars between them would be torn
        _check()
        handler = logging.StreamHandler(sys.stderr)
        handler.addFilter(lambda record: record.levelno < logging.WARNING)  # warnings are printed in any case
        handler.setFormatter(_Printable("%(asctime)s %(message)s", "%H:%M:%S"))
        _attach(handler)
        _describe(handler)


def _check() -> None:
    if _state.quiet and _state.verbose:
        from chemage.cli.options import user_error

        raise user_error("--quiet and --verbose: choose one")


def _write_log(context: typer.Context, path: Path | None) -> None:
    if path is None or path == _state.log or context.resilient_parsing:
        return
    from chemage.cli.options import user_error

    if _state.log is not None:
        raise user_error(f"--log {path}: the log is {_state.log} already; give --log once")
    try:
        handler = logging.FileHandler(path, mode="x", encoding="utf-8")
    except FileExistsError:
        raise user_error(f"--log {path}: this file is already there, and a log is a new file; choose another") from None
    except (OSError, ValueError) as error:
        raise user_error(f"--log {path}: {getattr(error, 'strerror', None) or error}; choose another file") from None
    _state.log = path
    handler.setFormatter(_Printable("%(asctime)s %(levelname)-7s %(message)s", "%Y-%m-%d %H:%M:%S%z"))
    _attach(handler)
    _describe(handler)


class _Printable(logging.Formatter):
    """Control characters, as in the name of a file, are written as escapes."""

    def format(self, record: logging.LogRecord) -> str:
        from chemage.foundation.errors import printable

        return "\n".join(printable(line) for line in super().format(record).splitlines())


def _attach(handler: logging.Handler) -> None:
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    _state.handlers.append(handler)


def _describe(handler: logging.Handler) -> None:
    """Log the command, the versions, the plugins and where kernels are kept, to one handler alone."""
    from importlib import metadata

    from chemage.foundation.names import __version__
    from chemage.plugins import registry

    libraries = {}
    for name in ("numpy", "scipy", "numba"):
        try:
            libraries[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            libraries[name] = "not installed"
    others = sorted({one.source for one in registry.current().records if one.distribution != "chemage"})
    kernels = os.environ.get("NUMBA_CACHE_DIR") or f"{Path(__file__).parents[1]}, in folders __pycache__"
    for text in (
        f"command: {shlex.join(['chemage', *sys.argv[1:]])}",
        f"folder: {Path.cwd()}",
        f"versions: chemage {__version__}, Python {platform.python_version()}, "
        + ", ".join(f"{name} {version}" for name, version in libraries.items()),
        f"plugins of other packages: {', '.join(others) or 'none'}",
        f"compiled kernels are kept in {kernels}",
    ):
        record = LOGGER.makeRecord(LOGGER.name, logging.INFO, "", 0, text, (), None)
        record.created = time.time()
        handler.handle(record)


QuietOpt = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=_be_quiet,
        expose_value=False,
        is_eager=True,
        help="print only errors, warnings and the names of written files",
    ),
]
VerboseOpt = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        callback=_be_verbose,
        expose_value=False,
        is_eager=True,
        help="print what each stage does, how long it takes, and which plugins take part",
    ),
]
LogOpt = Annotated[
    Path | None,
    typer.Option(
        "--log",
        metavar="FILE",
        callback=_write_log,
        expose_value=False,
        is_eager=True,
        help="write what -v prints, with all warnings and errors, to this new file",
    ),
]


def _carrier(quiet: QuietOpt = False, verbose: VerboseOpt = False, log: LogOpt = None) -> None:
    pass


def add_to(command: Any) -> None:
    """Add the options to a command, and to the commands of a group, where their names are free."""
    carrier = typer.Typer(add_completion=False)
    carrier.command()(_carrier)
    _add(command, typer.main.get_command(carrier).params)


def _add(command: Any, options: Sequence[Any]) -> None:
    for one in getattr(command, "commands", {}).values():
        _add(one, options)
    taken = {word for parameter in command.params for word in (*getattr(parameter, "opts", ()), parameter.name)}
    for option in options:
        if option.name in taken or option.opts[0] in taken:
            continue
        own = copy(option)
        own.opts = [word for word in option.opts if word not in taken]
        command.params.append(own)
