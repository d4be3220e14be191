"""The number of threads that one computation may use; everything that starts threads takes it from here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

_limit: int | None = None


def available() -> int:
    """Threads that this process may use now: of :func:`limit` or ``CHEMAGE_THREADS``, else one per processor."""
    if _limit is not None:
        return _limit
    text = os.environ.get("CHEMAGE_THREADS", "")
    return int(text) if text.isdigit() and int(text) > 0 else processors()


def processors() -> int:
    """Processors this process may run on."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # no such call on this system
        return os.cpu_count() or 1


def limit(threads: int | None) -> None:
    """Let computations in this process use ``threads`` threads; None takes the limit away."""
    global _limit
    _limit = threads


@contextmanager
def restored() -> Iterator[None]:
    """Take back, after the block, the limits that were set within it."""
    before = _limit
    try:
        yield
    finally:
        limit(before)


def environment(threads: int) -> dict[str, str]:
    """Environment variables that hold a new process, and the libraries in it, to ``threads`` threads."""
    names = ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return dict.fromkeys(names, str(threads))
