"""What the commands print: tables on stdout, progress on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

    from chemage.experiments.run import Progress


def table(title: str, columns: tuple[str, ...] = ()) -> Table:
    """An empty table: two columns without heads, or ``columns`` with theirs."""
    from rich import box
    from rich.table import Table

    made = Table(title=title or None, title_justify="left", box=box.SIMPLE, show_header=bool(columns), pad_edge=False)
    for name in columns or ("", ""):
        made.add_column(name, overflow="fold")
    return made


def show(table: Table, width: int = 110) -> None:
    """Print a table: as wide as the terminal, or ``width`` where there is none."""
    from rich.console import Console

    class Quiet(Console):
        def on_broken_pipe(self) -> None:  # rich's own exits with status 1
            raise

    # a title or a file name is text, never markup
    Quiet(
        file=sys.stdout, highlight=False, markup=False, emoji=False, width=None if sys.stdout.isatty() else width
    ).print(table)


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """A bar for each stage on stderr; where that is no terminal, a line as each stage ends."""
    import time

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    begun: dict[str, float] = {}
    if not sys.stderr.isatty():

        def lines(stage: str, done: int, total: int) -> None:
            begun.setdefault(stage, time.perf_counter())
            elapsed = time.perf_counter() - begun[stage]
            if total and done == total and elapsed > 2:
                print(f"{stage}: done in {elapsed:.1f} s", file=sys.stderr, flush=True)
                del begun[stage]

        yield lines
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def draw(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None)
            bars.update(tasks[stage], completed=done, total=total or None)

        yield draw
