"""How far a sweep is, told while it runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is."""

    #: ``validating`` or ``computing``
    stage: str
    points: int
    #: points validated, or finished
    done: int
    failed: int
    contacts: int
    contacts_done: int
    #: tasks that run side by side
    workers: int
    #: wall seconds since this run of the sweep began
    elapsed: float
    #: wall seconds still to go, None while there is nothing to tell from
    remaining: float | None


Tell = Callable[[SweepProgress], None]


@contextmanager
def display(progress: Tell | bool | None) -> Iterator[Tell | None]:
    if progress is True:
        with show_progress() as tell:
            yield tell
    else:
        yield progress or None


@contextmanager
def show_progress(seconds: float = 5.0) -> Iterator[Tell]:
    """Bars on stderr; where that is no terminal, a line every few ``seconds``."""
    if not sys.stderr.isatty():
        begin = time.perf_counter()
        last, printed = begin, ""

        def line(state: SweepProgress) -> None:
            nonlocal last, printed
            now = time.perf_counter()
            ended = state.stage == "computing" and state.done + state.failed == state.points
            if (now > last + seconds or (ended and last > begin)) and told(state) != printed:
                last, printed = now, told(state)
                print(printed, file=sys.stderr, flush=True)

        yield line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def bar(name: str, done: int, total: int, note: str) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=total, note=note)
            bars.update(tasks[name], completed=done, total=total, note=note)

        def draw(state: SweepProgress) -> None:
            if state.stage == "validating":
                bar("validating", state.done, state.points, _left(state.remaining))
                return
            bar("contacts", state.contacts_done, state.contacts, "")
            failed = f"{state.failed} failed, " if state.failed else ""
            bar("points", state.done + state.failed, state.points, f"{failed}{_left(state.remaining)}")

        yield draw


def told(state: SweepProgress) -> str:
    """How far a sweep is, in a line."""
    if state.stage == "validating":
        return f"sweep: {state.done} of {state.points} points validated, {_left(state.remaining)}"
    failed = f", {state.failed} failed" if state.failed else ""
    return (
        f"sweep: {state.done} of {state.points} points{failed}, {state.contacts_done} of {state.contacts} contacts, "
        f"{_left(state.remaining)}"
    )


def _left(seconds: float | None) -> str:
    if seconds is None:
        return "remaining time not known yet"
    whole = round(seconds)
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min left"
    return f"{whole // 60} min {whole % 60:02d} s left" if whole >= 60 else f"{whole} s left"
