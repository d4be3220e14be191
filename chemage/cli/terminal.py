"""What the commands print on stdout: lines, tables, and results of every kind."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chemage.cli import output
from chemage.foundation.errors import printable

if TYPE_CHECKING:
    from rich.table import Table

    from chemage.foundation.result import Result

#: characters of a line where stdout is not a terminal
WIDTH = 110


def table(title: str, columns: Sequence[str] = ()) -> Table:
    """Make an empty table with the headings ``columns``, or with two columns that have none."""
    from rich import box
    from rich.table import Table

    class Harmless(Table):
        def add_row(self, *cells: Any, **options: Any) -> None:
            super().add_row(*(printable(cell) if isinstance(cell, str) else cell for cell in cells), **options)

    heading = printable(title) or None
    grid = Harmless(title=heading, title_justify="left", box=box.SIMPLE, show_header=bool(columns), pad_edge=False)
    for name in columns or ("", ""):
        grid.add_column(printable(name), overflow="fold")
    return grid


def say(text: object = "", end: str = "\n", file: Any = None) -> None:
    """Print a line, on stdout by default; control characters, as in the name of a file, are printed as escapes."""
    print(printable(str(text)), end=end, file=file)


def remark(text: object = "") -> None:
    """Print a line that is not the answer itself, such as a note; nothing with ``--quiet``."""
    if not output.quiet():
        say(text)


def show(table: Table, width: int = WIDTH) -> None:
    """Print a table as wide as the terminal; ``width`` characters where stdout is not a terminal.

    Nothing with ``--quiet``.
    """
    if output.quiet():
        return
    from rich.console import Console

    class Quiet(Console):
        def on_broken_pipe(self) -> None:  # rich's own exits with status 1
            raise

    # a title or a file name is text, never markup
    Quiet(
        file=sys.stdout, highlight=False, markup=False, emoji=False, width=None if sys.stdout.isatty() else width
    ).print(table)


def show_rows(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], width: int = WIDTH) -> None:
    """Print a table of text; without ``columns`` of names and values."""
    grid = table(title, columns)
    for row in rows:
        grid.add_row(*row)
    show(grid, width)


def show_result(result: Result) -> None:
    """Print the main numbers of a result, its tables and its notes."""
    show_rows(result.heading, (), result.rows(), result.width)
    for part in (part for part in result.tables() if not part.in_detail):
        grid = table(part.title, part.columns or ("",))
        grid.show_header = bool(part.columns)
        if part.dense:
            grid.padding = (0, 0)
            grid.columns[0].min_width = 22
        for row in part.rows[: part.most]:
            grid.add_row(*row)
        show(grid, result.width)
        for text in part.remarks:
            remark(text)
    for note in result.notes():
        remark(f"note: {note}")


def answer(result: Result, as_json: bool, remarks: Sequence[str] = (), **written: Any) -> None:
    """Print a result that was computed, or one JSON object, with the files ``written``: what they are -> path."""
    if as_json:
        paths = {name: value if isinstance(value, int | list | None) else str(value) for name, value in written.items()}
        print(json.dumps({**result.numbers(), **paths}, default=str))
        return
    show_result(result)
    remark()
    labels = {"file": "result", "figures": "figure"}
    for name, value in written.items():
        for path in value if isinstance(value, list) else [value] if isinstance(value, Path) else []:
            say(f"{labels.get(name, name):8} {path}")
    for text in remarks:
        remark(text)
