"""Tables that the commands print on stdout."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from chemage.cli import output
from chemage.foundation.errors import printable

if TYPE_CHECKING:
    from rich.table import Table


def table(title: str, columns: tuple[str, ...] = ()) -> Table:
    """Make an empty table with the headings ``columns``, or with two columns that have none."""
    from rich import box
    from rich.table import Table

    class Harmless(Table):
        def add_row(self, *cells: Any, **options: Any) -> None:
            super().add_row(*(printable(cell) if isinstance(cell, str) else cell for cell in cells), **options)

    shown = printable(title) or None
    made = Harmless(title=shown, title_justify="left", box=box.SIMPLE, show_header=bool(columns), pad_edge=False)
    for name in columns or ("", ""):
        made.add_column(printable(name), overflow="fold")
    return made


def say(text: object = "", end: str = "\n", file: Any = None) -> None:
    """Print a line, on stdout by default; control characters, as in the name of a file, are printed as escapes."""
    print(printable(str(text)), end=end, file=file)


def remark(text: object = "") -> None:
    """Print a line that is not the answer itself, such as a note; nothing with ``--quiet``."""
    if not output.quiet():
        say(text)


def show(table: Table, width: int = 110) -> None:
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


def show_pairs(title: str, pairs: Iterable[tuple[str, str]], width: int = 110) -> None:
    """Print a table of names and values; ``width`` as in :func:`show`."""
    made = table(title)
    for name, text in pairs:
        made.add_row(name, text)
    show(made, width)
