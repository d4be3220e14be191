"""Progress of a sweep, reported while it runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from chemage.foundation.progress import progress_bars, silenced


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a sweep at one moment."""

    #: ``validating`` or ``computing``
    stage: str
    points: int
    #: points validated, or completed
    done: int
    failed: int
    contacts: int
    contacts_done: int
    #: concurrent tasks
    workers: int
    #: wall time since this call began, s
    elapsed: float
    #: estimated remaining wall time, s; None before the first task has ended
    remaining: float | None
    #: samples that were taken, where the points are means over surfaces
    samples: int | None = None

    def __str__(self) -> str:
        if self.stage == "validating":
            return f"sweep: {self.done} of {self.points} points validated, {_left(self.remaining)}"
        failed = f", {self.failed} failed" if self.failed else ""
        if self.samples is not None:
            return f"sweep: {self.done} of {self.points} means{failed}, {self.samples} samples so far"
        return (
            f"sweep: {self.done} of {self.points} points{failed}, {self.contacts_done} of {self.contacts} contacts, "
            f"{_left(self.remaining)}"
        )


#: receives the progress of a sweep, several times a second
Report = Callable[[SweepProgress], None]


@contextmanager
def reporting(progress: Report | bool | None) -> Iterator[Report | None]:
    """The function to report progress with: that of the caller; for True one that shows progress on stderr."""
    if progress is True:
        with show_progress() as report:
            yield report
    else:
        yield progress or None


@contextmanager
def show_progress(seconds: float = 5.0) -> Iterator[Report]:
    """Show the progress of a sweep on stderr: bars on a terminal, elsewhere a line every few ``seconds``."""
    if silenced():
        yield lambda state: None
        return
    if not sys.stderr.isatty():
        yield _lines(seconds)
        return
    with progress_bars({"validating": "points", "contacts": "", "points": ""}) as bar:

        def draw(state: SweepProgress) -> None:
            if state.stage == "validating":
                bar("validating", state.done, state.points, _left(state.remaining))
                return
            failed = f"{state.failed} failed, " if state.failed else ""
            if state.samples is None:
                bar("contacts", state.contacts_done, state.contacts)
            left = _left(state.remaining) if state.samples is None else f"{state.samples} samples so far"
            bar("points", state.done + state.failed, state.points, f"{failed}{left}")

        yield draw


def _lines(seconds: float) -> Report:
    begin = last = time.perf_counter()
    printed = ""

    def line(state: SweepProgress) -> None:
        nonlocal last, printed
        now = time.perf_counter()
        ended = state.stage == "computing" and state.done + state.failed == state.points
        if (now > last + seconds or (ended and last > begin)) and str(state) != printed:
            last, printed = now, str(state)
            print(printed, file=sys.stderr, flush=True)

    return line


def _left(seconds: float | None) -> str:
    if seconds is None:
        return "remaining time not known yet"
    whole = round(seconds)
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min left"
    return f"{whole // 60} min {whole % 60:02d} s left" if whole >= 60 else f"{whole} s left"
