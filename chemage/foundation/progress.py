"""Progress on stderr: a bar for each stage on a terminal, lines for slow stages elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol

from chemage.foundation.logs import logged

#: silence after which a line says that a stage is at work, s; a tenth of the time it has taken so far where that is
#: longer, up to the largest
SILENCE, LONGEST_SILENCE = 2.5, 60.0
#: time between looks at what is silent, s
TICK = 0.25
#: time after which a command that still loads its libraries says so, s
LOADING = 0.5
#: and time after which it says so again
AGAIN = 1.5
#: seconds between two lines about a stage that came further, where there is no terminal
_SECONDS = 10.0
_silent = False


class Report(Protocol):
    """A function that receives how far a computation is."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Show that ``done`` of ``total`` steps of ``stage`` are complete; ``total`` is 0 where it is unknown."""


_watching: ContextVar[Report | None] = ContextVar("chemage_progress", default=None)


def silence(silent: bool) -> None:
    """Show no progress at all from now on, or show it again: the options ``-q`` and ``-v`` of the command line."""
    global _silent
    _silent = silent


def silenced() -> bool:
    """Whether no progress is to be shown."""
    return _silent


@contextmanager
def watching(report: Report) -> Iterator[None]:
    """Let components report their own steps to ``report`` during a block, in this thread."""
    token = _watching.set(report)
    try:
        yield
    finally:
        _watching.reset(token)


def watched() -> Report | None:
    """What a component may report its steps to, as ``("contact", 12, 0, "residual 3e-4")``; None if nobody looks."""
    return _watching.get()


@contextmanager
def progress_bars(units: Mapping[str, str] | None = None, *, alive: bool = False) -> Iterator[Report]:
    """Show progress on stderr during a block, which receives the function to report with.

    On a terminal every stage has a bar, followed by the note. Elsewhere a stage that takes more than 2 s prints one
    line when it ends, and one every 10 s in which it came further. With ``alive`` it also prints lines before it ends,
    more and more rarely; a stage that is not in ``units`` is printed at once where it begins with a note, and every few
    seconds as long as it has one. ``units`` says what is counted: stage -> plural.
    """
    loaded()
    named = units or {}
    if _silent:
        yield lambda stage, done, total, note="": None
        return
    if not sys.stderr.isatty():
        lines = _Lines(named)
        if not alive:
            yield lines
            return
        with lines.alive():
            yield lines
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<10}"),
        BarColumn(30),
        TextColumn("{task.fields[count]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}
        totals: dict[str, int] = {}

        def draw(stage: str, done: int, total: int, note: str = "") -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None, note=note, count="")
            if done == total == 1:  # the end of a stage, whatever was counted in it
                done = total = totals.get(stage, 1)
            totals[stage] = total
            bars.update(
                tasks[stage], completed=done, total=total or None, note=note, count=_count(named, stage, done, total)
            )

        yield draw


def _count(units: Mapping[str, str], stage: str, done: int, total: int) -> str:
    """``replicas 3/10``, or ``iterations 12`` where the total is unknown; nothing where there is nothing to count."""
    unit = units.get(stage, "")
    if total > 1:
        return f"{unit} {done}/{total}".strip()
    return f"{unit} {done}" if unit and done and not total else ""


class _Lines:
    """Progress where stderr is no terminal."""

    def __init__(self, units: Mapping[str, str]) -> None:
        self._units = units
        self._begun: dict[str, float] = {}
        self._now: dict[str, tuple[int, int, str]] = {}
        #: when a stage was printed last, and how far it was
        self._far: dict[str, tuple[float, int]] = {}
        self._lock = threading.Lock()
        self._printed = time.monotonic()
        self._ticking = False

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None:
        with self._lock:
            begins = stage not in self._begun
            elapsed = time.perf_counter() - self._begun.setdefault(stage, time.perf_counter())
            noted = self._has_note(stage)
            if total and done == total:
                self._now.pop(stage, None)
                del self._begun[stage]
                if elapsed > 2:
                    self._print(f"{stage}: done in {elapsed:.1f} s")
                return
            if noted and not note:
                del self._now[stage]
                return
            self._now[stage] = done, total, note
            if begins and self._ticking and self._has_note(stage):
                self._print(f"{stage} {note}")
            elif not self._ticking:
                self._further(stage, done, total, note)

    def _has_note(self, stage: str) -> bool:
        """Whether a note is what a stage has to say, and not how far it is."""
        return bool(self._now.get(stage, (0, 0, ""))[2]) and stage not in self._units

    def _further(self, stage: str, done: int, total: int, note: str) -> None:
        now = time.perf_counter()
        last, count = self._far.get(stage, (self._begun[stage], 0))
        how_far = ", ".join(filter(None, (_count(self._units, stage, done, total), note)))
        if how_far and done > count and now - last > _SECONDS:
            self._far[stage] = now, done
            self._print(f"{stage}: {how_far}")

    @contextmanager
    def alive(self) -> Iterator[None]:
        """Print, during a block, that the stages are at work."""
        self._ticking, ended = True, threading.Event()

        def tick() -> None:
            while not ended.wait(TICK):
                with self._lock:
                    self._tick()

        thread = threading.Thread(target=tick, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def _tick(self) -> None:
        if not self._now:
            return
        noted = [stage for stage in self._now if self._has_note(stage)]
        stage = noted[-1] if noted else list(self._now)[-1]
        elapsed = time.perf_counter() - self._begun[stage]
        wait = SILENCE if noted else min(max(SILENCE, elapsed / 10), LONGEST_SILENCE)
        if time.monotonic() - self._printed < wait:
            return
        done, total, note = self._now[stage]
        count = _count(self._units, stage, done, total) or (f"{done} done" if done else "")
        words = [count, note] if stage in self._units else [count]
        self._print(f"{stage}: {', '.join([*filter(None, words), f'{elapsed:.0f} s'])}")

    def _print(self, line: str) -> None:
        self._printed = time.monotonic()
        print(line, file=sys.stderr, flush=True)


_loading: threading.Timer | None = None


def loading(message: str) -> None:
    """Print a message on stderr if neither progress nor :func:`loaded` follows within a second, and again every few
    seconds; on a terminal it stands there once and is erased then."""
    begin = time.monotonic()

    def show(again: bool) -> None:
        if sys.stderr is not None and _loading is not None and not _silent:
            if not again or not sys.stderr.isatty():
                text = f"{message}: {time.monotonic() - begin:.0f} s" if again else message
                print(text, end="" if sys.stderr.isatty() else "\n", file=sys.stderr, flush=True)
            after(AGAIN, shown=True)

    def after(seconds: float, shown: bool) -> None:
        global _loading
        _loading = threading.Timer(seconds, show, (shown,))
        _loading.shown = shown  # pyright: ignore[reportAttributeAccessIssue]
        _loading.daemon = True
        _loading.start()

    after(LOADING, shown=False)


def loaded() -> None:
    """End what :func:`loading` began."""
    global _loading
    timer, _loading = _loading, None
    if timer is not None:
        timer.cancel()
        if getattr(timer, "shown", False) and sys.stderr is not None and sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@contextmanager
def reported(report: Report, stage: str) -> Iterator[None]:
    """Report the begin of a block as that of ``stage``, and its end if it succeeds."""
    report(stage, 0, 0)
    with logged(stage):
        yield
    report(stage, 1, 1)
