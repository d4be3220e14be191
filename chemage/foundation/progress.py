"""How far a computation is: on stderr, a bar for each stage on a terminal and lines for slow stages elsewhere; and in
the log, each stage with its time.

The logger is ``chemage`` of Python's ``logging``. It prints nothing unless the program that uses chemage asks for it,
as ``chemage -v`` and ``chemage --log FILE`` do: ``logging.basicConfig(level="INFO")`` is enough.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol

#: silence after which a line says that a stage is at work, s; a tenth of the time it has taken so far where that is
#: longer, up to the largest
SILENCE, LONGEST_SILENCE = 2.5, 60.0
#: time between looks at what is silent, s
TICK = 0.25
#: time after which a command that still loads its libraries says so, s
LOADING = 0.5
#: and time after which it says so again
AGAIN = 1.5
_silent = False

LOGGER = logging.getLogger("chemage")
LOGGER.addHandler(
    logging.NullHandler()
)  # Python itself prints errors of a logger without a handler


class Report(Protocol):
    """A function that receives how far a computation is."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Show that ``done`` of ``total`` steps of ``stage`` are complete; ``total`` is 0 where it is unknown."""


_watching: ContextVar[Report | None] = ContextVar("chemage_progress", default=None)


def silence(silent: bool) -> None:
    """Show no progress at all from now on, or show it again: the options ``-q`` and ``-v`` of the command line."""
    global _silent
    _silent = silent


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
def progress_bars(units: Mapping[str, str] | None = None) -> Iterator[Report]:
    """Show progress on stderr during a block, which receives the function to report with.

    On a terminal every stage has a bar, followed by the note. Elsewhere a stage that takes more than 2 s prints one
    line when it ends, and before, more and more rarely, how far it is; a stage that is not in ``units`` is printed at
    once where it begins with a note, and every few seconds as long as it has one. ``units`` says what is counted:
    stage -> plural.
    """
    loaded()
    named = units or {}
    if _silent:
        yield lambda stage, done, total, note="": None
        return
    if not sys.stderr.isatty():
        with _Lines(named).alive() as lines:
            yield lines
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )

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
                tasks[stage],
                completed=done,
                total=total or None,
                note=note,
                count=_count(named, stage, done, total),
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
        self._lock = threading.Lock()
        self._printed = time.monotonic()

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None:
        with self._lock:
            begins = stage not in self._begun
            elapsed = time.perf_counter() - self._begun.setdefault(
                stage, time.perf_counter()
            )
            if total and done == total:
                self._now.pop(stage, None)
                del self._begun[stage]
                if elapsed > 2:
                    self._print(f"{stage}: done in {elapsed:.1f} s")
            elif self._has_note(stage) and not note:
                del self._now[stage]
            else:
                self._now[stage] = done, total, note
                if begins and self._has_note(stage):
                    self._print(f"{stage} {note}")

    def _has_note(self, stage: str) -> bool:
        """Whether a note is what a stage has to say, and not how far it is."""
        return (
            bool(self._now.get(stage, (0, 0, ""))[2]) and stage not in self._units
        )

    @contextmanager
    def alive(self) -> Iterator[_Lines]:
        """Print, during a block, that the stages are at work."""
        ended = threading.Event()

        def tick() -> None:
            while not ended.wait(TICK):
                with self._lock:
                    self._tick()

        thread = threading.Thread(target=tick, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            ended.set()
            thread.join()

    def _tick(self) -> None:
        if not self._now:
            return
        noted = [stage for stage in self._now if self._has_note(stage)]
        stage = noted[-1] if noted else list(self._now)[-1]
        elapsed = time.perf_counter() - self._begun[stage]
        wait = (
            SILENCE if noted else min(max(SILENCE, elapsed / 10), LONGEST_SILENCE)
        )
        if time.monotonic() - self._printed < wait:
            return
        done, total, note = self._now[stage]
        count = _count(self._units, stage, done, total) or (
            f"{done} done" if done else ""
        )
        words = [count, note] if stage in self._units else [count]
        self._print(
            f"{stage}: {', '.join([*filter(None, words), f'{elapsed:.0f} s'])}"
        )

    def _print(self, line: str) -> None:
        self._printed = time.monotonic()
        print(line, file=sys.stderr, flush=True)


#: ends what :func:`loading` began
_loading: Callable[[], None] | None = None


def loading(message: str) -> None:
    """Print a message on stderr if neither progress nor :func:`loaded` follows within a second, and again every few
    seconds; on a terminal it stands there once and is erased then."""
    global _loading
    begin, ended = time.monotonic(), threading.Event()

    def show() -> None:
        if ended.wait(LOADING) or sys.stderr is None or _silent:
            return
        if sys.stderr.isatty():
            print(message, end="", file=sys.stderr, flush=True)
            ended.wait()
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
            return
        print(message, file=sys.stderr, flush=True)
        while not ended.wait(AGAIN):
            print(
                f"{message}: {time.monotonic() - begin:.0f} s",
                file=sys.stderr,
                flush=True,
            )

    thread = threading.Thread(target=show, daemon=True)
    thread.start()

    def end() -> None:
        ended.set()
        thread.join()

    _loading = end


def loaded() -> None:
    """End what :func:`loading` began."""
    global _loading
    end, _loading = _loading, None
    if end is not None:
        end()


@contextmanager
def reported(report: Report, stage: str) -> Iterator[None]:
    """Report the begin of a block as that of ``stage``, and its end if it succeeds."""
    report(stage, 0, 0)
    with logged(stage):
        yield
    report(stage, 1, 1)


# -- the log ----------------------------------------------------------------------------------------------------------


@contextmanager
def logged(stage: str, what: str = "begins") -> Iterator[Callable[[str], None]]:
    """Log the begin of a block as that of ``stage``, and its end with wall and CPU time.

    The block receives a function that adds words about its outcome to the last line.
    """
    LOGGER.info("%s: %s", stage, what)
    outcome: list[str] = []
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        yield outcome.append
    except BaseException as error:
        LOGGER.info(
            "%s: ended by %s after %.2f s",
            stage,
            type(error).__name__,
            time.perf_counter() - wall,
        )
        raise
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    LOGGER.info(
        "%s: done in %.2f s (%.2f s of CPU time)%s",
        stage,
        wall,
        cpu,
        "".join(f"; {words}" for words in outcome),
    )


def counted(
    stage: str, unit: str, progress: Callable[[int, int], None] | None
) -> Callable[[int, int], None] | None:
    """A function to report (done, total) with: it logs them, and passes them on to ``progress``; None where nobody
    reads either."""
    if progress is None and not LOGGER.isEnabledFor(logging.INFO):
        return None

    def report(done: int, total: int) -> None:
        LOGGER.info("%s: %s %d/%d", stage, unit, done, total)
        if progress is not None:
            progress(done, total)

    return report


def of_plugins(plugins: dict[str, str]) -> str:
    """Which plugins took part, in words."""
    return "plugins: " + (
        ", ".join(f"{name} ({source})" for name, source in plugins.items())
        or "none"
    )
