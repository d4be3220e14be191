"""What the commands print and write: lines, tables, results of every kind and the files beside them.

And the options of every command about what is printed: ``-q``, ``-v`` and ``--log FILE``, before or after its name.
What they show comes from the logger ``chemage``, to which the stages report; see :mod:`chemage.foundation.progress`.
"""

from __future__ import annotations

import json
import logging
import os
import platform
import shlex
import shutil
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli.options import FIGURES, check_ending, user_error
from chemage.foundation import progress
from chemage.foundation.errors import StoreError, printable
from chemage.foundation.progress import LOGGER
from chemage.plugins import registry

if TYPE_CHECKING:
    from chemage.foundation.result import Result, Table
    from chemage.scene.scene import Scene


class _State:
    """What the options of this call of the program ask for."""

    def __init__(self) -> None:
        self.quiet = self.verbose = self.all = False
        self.log: Path | None = None
        self.handlers: list[logging.Handler] = []
        #: whether SIGTERM has come, and what received it before
        self.terminated = False
        self.before: Any = None


_state = _State()


def quiet() -> bool:
    """Whether tables, notes and progress are left out."""
    return _state.quiet


def show_all(given: bool) -> None:
    """Print everything, and not only what is shown first."""
    _state.all = given


def every() -> bool:
    """Whether everything is printed."""
    return _state.all


def begin() -> None:
    """Forget what an earlier call in this process has set."""
    end()
    _state.quiet = _state.verbose = _state.all = False
    _state.log = None
    progress.silence(False)
    _state.terminated = False

    def terminate(number: int, frame: Any) -> None:
        """End as Ctrl-C does, for schedulers; a second signal ends the process at once."""
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        _state.terminated = True
        raise KeyboardInterrupt

    if (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    ):
        _state.before = signal.signal(signal.SIGTERM, terminate)


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


def _set_loudness(
    context: typer.Context, option: typer.CallbackParam, given: bool
) -> None:
    """``--quiet`` and ``--verbose``."""
    if not given or getattr(_state, str(option.name)) or context.resilient_parsing:
        return
    setattr(_state, str(option.name), True)
    if _state.quiet and _state.verbose:
        raise user_error("--quiet and --verbose: choose one")
    progress.silence(
        True
    )  # lines of --verbose say more, and bars between them would be torn
    if _state.verbose:
        handler = logging.StreamHandler(sys.stderr)
        handler.addFilter(
            lambda record: record.levelno < logging.WARNING
        )  # warnings are printed in any case
        _start_log(handler, "%(asctime)s %(message)s", "%H:%M:%S")


def _write_log(context: typer.Context, path: Path | None) -> None:
    if path is None or path == _state.log or context.resilient_parsing:
        return
    if _state.log is not None:
        raise user_error(
            f"--log {path}: the log is {_state.log} already; give --log once"
        )
    try:
        handler = _LogFile(path, mode="x", encoding="utf-8")
    except FileExistsError:
        raise user_error(
            f"--log {path}: this file is already there, and a log is a new file; choose another"
        ) from None
    except (OSError, ValueError) as error:
        raise user_error(
            f"--log {path}: {getattr(error, 'strerror', None) or error}; choose another file"
        ) from None
    _state.log = path
    _start_log(
        handler, "%(asctime)s %(levelname)-7s %(message)s", "%Y-%m-%d %H:%M:%S%z"
    )
    handler.begun = True


class _Printable(logging.Formatter):
    """Control characters, as in the name of a file, are written as escapes."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(
            printable(line) for line in super().format(record).splitlines()
        )


class _LogFile(logging.FileHandler):
    """A new file. On a full disk, one that cannot be begun ends the command, and one that cannot go on is left."""

    begun = False

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        text = f"--log {self.baseFilename}: {getattr(error, 'strerror', None) or error}"
        LOGGER.removeHandler(self)
        if not self.begun:
            raise user_error(f"{text}; choose another place") from None
        warnings.warn(f"{text}; the log ends here", stacklevel=2)

    def close(self) -> None:
        with suppress(OSError):  # what could not be written is tried again
            super().close()


def _start_log(handler: logging.Handler, form: str, dates: str) -> None:
    """Log to a handler, and to it alone the command, the versions, the plugins and where kernels are kept."""
    from importlib import metadata

    from chemage.foundation import machine
    from chemage.foundation.names import __version__

    handler.setFormatter(_Printable(form, dates))
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    _state.handlers.append(handler)
    libraries = {}
    for name in ("numpy", "scipy", "numba"):
        try:
            libraries[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            libraries[name] = "not installed"
    others = sorted(
        {
            one.source
            for one in registry.current().records
            if one.distribution != "chemage"
        }
    )
    for text in (
        f"command: {shlex.join(['chemage', *sys.argv[1:]])}",
        f"folder: {Path.cwd()}",
        f"versions: chemage {__version__}, Python {platform.python_version()}, "
        + ", ".join(f"{name} {version}" for name, version in libraries.items()),
        f"plugins of other packages: {', '.join(others) or 'none'}",
        f"compiled kernels are kept in {machine.kernel_folder()}",
    ):
        record = LOGGER.makeRecord(LOGGER.name, logging.INFO, "", 0, text, (), None)
        record.created = time.time()
        handler.handle(record)


QuietOpt = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=_set_loudness,
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
        callback=_set_loudness,
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


def _carrier(
    quiet: QuietOpt = False, verbose: VerboseOpt = False, log: LogOpt = None
) -> None:
    pass


def add_to(command: Any, options: Sequence[Any] = ()) -> None:
    """Add the options to a command, and to the commands of a group, where their names are free."""
    if not options:
        carrier = typer.Typer(add_completion=False)
        carrier.command()(_carrier)
        options = typer.main.get_command(carrier).params
    for one in getattr(command, "commands", {}).values():
        add_to(one, options)
    taken = {
        word
        for parameter in command.params
        for word in (*getattr(parameter, "opts", ()), parameter.name)
    }
    for option in options:
        if option.name in taken or option.opts[0] in taken:
            continue
        own = copy(option)
        own.opts = [word for word in option.opts if word not in taken]
        command.params.append(own)


#: characters of a line where stdout is not a terminal
WIDTH = 110


def say(text: object = "", end: str = "\n", file: Any = None) -> None:
    """Print a line, on stdout by default; control characters, as in the name of a file, are printed as escapes."""
    print(printable(str(text)), end=end, file=file)


def command_line(*words: object) -> str:
    """A ``chemage`` command as it can be pasted into a shell."""
    return shlex.join(["chemage", *map(str, words)])


def say_json(value: Any) -> None:
    """Print a value as JSON, in which what is not finite is null."""
    from chemage.foundation.text import jsonable

    print(json.dumps(jsonable(value), default=str))


def say_csv(result: Result) -> None:
    """Print the many values of a result, one column each, or its rows."""
    from chemage.foundation.text import csv_text

    columns = result.columns()
    names, texts = zip(*result.rows(), strict=True)
    text = (
        csv_text(columns, zip(*columns.values(), strict=True))
        if columns
        else csv_text(names, [texts])
    )
    say(text, end="")


def remark(text: object = "") -> None:
    """Print a line that is not the answer itself, such as a note; nothing with ``--quiet``."""
    if not quiet():
        say(text)


def show_rows(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    width: int = WIDTH,
    dense: bool = False,
    spaced: bool = True,
) -> None:
    """Print a table of text as wide as the terminal; ``width`` characters where stdout is not a terminal; ``spaced``
    by empty lines from what is around it. Nothing with ``--quiet``."""
    if quiet():
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table as Grid

    class Quiet(Console):
        def on_broken_pipe(self) -> None:  # rich's own exits with status 1
            raise

    heading = printable(title) or None
    grid = Grid(
        title=heading,
        title_justify="left",
        box=box.SIMPLE if spaced else None,
        show_header=bool(columns),
        pad_edge=not spaced,
    )
    for name in columns:
        grid.add_column(printable(name), overflow="fold")
    for row in rows:
        for _ in row[len(grid.columns) :]:  # without a heading
            grid.add_column(overflow="fold")
        grid.add_row(*map(printable, row))
    if dense:
        grid.padding = (0, 0)
        grid.columns[0].min_width = 22
    # a title or a file name is text, never markup
    Quiet(
        file=sys.stdout,
        highlight=False,
        markup=False,
        emoji=False,
        width=None if sys.stdout.isatty() else width,
    ).print(grid)


def show_result(result: Result) -> None:
    """Print what is shown first of a result, or everything; its tables and its notes."""
    from chemage.results.first import first_numbers

    first = [one.row() for one in first_numbers(result)]
    if first and not _state.all:
        errors = result.errors.partition(",")[0]
        remark(": ".join(filter(None, (result.title, errors))) + "; more: --all")
        show_rows("", (), first, result.width, spaced=False)
    else:
        rows = result.rows(every=True) if first else result.rows()
        rows += result.arrays() if _state.all else []
        show_rows(result.heading, (), rows, result.width)
    show_tables(result.tables(), result.width)
    approximate = result.approximation if first and not _state.all else ""
    for note in (
        [f"approximate: {approximate}"] if approximate else []
    ) + result.notes():
        remark(f"note: {note}")


def show_tables(tables: Iterable[Table], width: int = WIDTH) -> None:
    """Print tables that are not for pages alone, and what is below them."""
    for part in tables:
        if part.in_detail:
            continue
        show_rows(
            part.title, part.columns, part.rows[: part.most], width, part.dense
        )
        for text in part.remarks:
            remark(text)


def answer(
    result: Result, as_json: bool, remarks: Sequence[str] = (), **written: Any
) -> None:
    """Print a result that was computed, or one JSON object, with the files ``written``: what they are -> path."""
    if as_json:
        say_json({**result.todict(), **written})
        return
    show_result(result)
    for name, value in written.items():
        for path in dict.fromkeys(
            [one.parent for one in value]
            if isinstance(value, list)
            else [value]
            if isinstance(value, Path)
            else []
        ):
            say(f"{'result' if name == 'file' else name:8} {path}")
    for text in remarks:
        remark(text)


def check_figure(out: Path | None, force: bool) -> None:
    """Refuse, before anything is computed, a figure of :func:`deliver` that cannot be written."""
    from chemage.foundation.files import preflight

    if out is not None:
        check_ending(out, FIGURES, "a figure")
        preflight(out, force=force)


def deliver(
    result: Result, out: Path | None, as_json: bool, as_csv: bool, force: bool
) -> None:
    """Draw a result into ``out``, and print it."""
    if out is not None:
        save_picture(result, out, force=force)
    if as_csv:
        say_csv(result)
        return
    answer(result, as_json, (), **({"figures": out} if out else {}))


def figures_of(path: Path) -> Path:
    """The folder of the figures of a result file."""
    return path.with_name(f"{path.stem}-figures")


def drawn(result: Result, path: Path) -> list[Path]:
    """Draw the figures of a result beside its file; a new folder gets its name when all of them are in it."""
    from chemage.foundation.figures import save_figures
    from chemage.results.drawing import figures

    folder, named = figures_of(path), figures(result)
    if folder.exists():
        return save_figures(named, folder, force=True)
    part = _unfinished(folder)
    shutil.rmtree(part, ignore_errors=True)
    try:
        pictures = save_figures(named, part)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return [folder / picture.name for picture in pictures]


def _unfinished(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.part")


def save_picture(result: Result, file: Path, *, force: bool) -> None:
    """Draw the first picture of a result into a file, in the format of its ending."""
    from chemage.foundation.figures import save_figure
    from chemage.foundation.result import drawn_picture

    (picture, *_) = result.pictures().values()
    save_figure(
        drawn_picture(picture),
        file,
        file.suffix.removeprefix(".").lower() or "png",
        force=force,
    )


def protect_inputs(
    path: Path, source: str, one: Scene, *further: Path | str
) -> None:
    """Refuse to overwrite the scene file, a file that the scene reads, or ``further`` ones, even with ``--force``."""
    read = [
        part["path"]
        for part in one.todict().values()
        if isinstance(part, dict) and "path" in part
    ]
    for name in (source, *read, *further):
        if "\0" not in str(name) and os.path.realpath(name) == os.path.realpath(
            path
        ):
            raise user_error(
                f"{path} is an input of this command; choose another --out"
            )


def preflight_result(
    path: Path, *, force: bool, figures: bool, size: float = 0
) -> None:
    """Check that a result, and ``figures`` beside it, can be written; remove what a killed command left of figures."""
    from chemage.foundation.files import preflight

    if path.name:
        shutil.rmtree(_unfinished(figures_of(path)), ignore_errors=True)
    preflight(path, force=force, size=size)
    folder = figures_of(path)
    if figures and folder.is_symlink():
        raise user_error(
            f"{folder}, the folder for the figures, is a link; remove it, or choose another --out"
        )
    if not figures or not folder.exists():
        return
    if not folder.is_dir():
        raise user_error(
            f"{folder}, the folder for the figures, is a file; choose another --out, or --no-figures"
        )
    if not force and any(folder.iterdir()):
        raise user_error(
            f"{folder} is already there; choose another --out, or overwrite it with --force"
        )


@contextmanager
def result_written(path: Path) -> Iterator[None]:
    """Add to the errors of a block that the result itself has been written to ``path``."""
    try:
        yield
    except StoreError as error:
        raise StoreError(
            f"{error}\nthe result itself is in {path}; `{command_line('plot', path)}` draws its figures"
        ) from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"the result is in {path}, but its figures are incomplete"
        ) from None
