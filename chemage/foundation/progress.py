"""Progress on stderr: a bar for each stage on a terminal, a line for each slow stage elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol


class Report(Protocol):
    """A function that receives how far a computation is."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Show that ``done`` of ``total`` steps of ``stage`` are complete; ``total`` is 0 where it is unknown."""


@contextmanager
def progress_bars() -> Iterator[Report]:
    """Show progress on stderr during a block, which receives the function to report with.

    On a terminal every stage has a bar, followed by the note. Elsewhere a stage that took more than 2 s prints one line
    when it ends.
    """
    if not sys.stderr.isatty():
        yield _lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def draw(stage: str, done: int, total: int, note: str = "") -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None, note=note)
            bars.update(tasks[stage], completed=done, total=total or None, note=note)

        yield draw


def _lines() -> Report:
    begun: dict[str, float] = {}

    def line(stage: str, done: int, total: int, note: str = "") -> None:
        elapsed = time.perf_counter() - begun.setdefault(stage, time.perf_counter())
        if total and done == total and elapsed > 2:
            print(f"{stage}: done in {elapsed:.1f} s", file=sys.stderr, flush=True)
            del begun[stage]

    return line


@contextmanager
def reported(report: Report, stage: str) -> Iterator[None]:
    """Report the begin of a block as that of ``stage``, and its end if it succeeds."""
    report(stage, 0, 0)
    yield
    report(stage, 1, 1)
