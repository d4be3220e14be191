"""The number of threads that one computation may use, from which everything that starts threads takes it; and tasks
that run several at a time."""

from __future__ import annotations

import contextvars
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

T = TypeVar("T")

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
    names = (
        "CHEMAGE_THREADS",
        "NUMBA_NUM_THREADS",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
    )
    return dict.fromkeys(names, str(threads))


def in_order(
    task: Callable[[int], T],
    count: int,
    threads: int,
    progress: Callable[[int, int], None] | None,
) -> list[T]:
    """Results of ``task(0 … count−1)`` in that order, ``threads`` at a time; the first failure stops the rest.

    ``progress`` is called with (tasks done, ``count``).
    """
    results: dict[int, T] = {}
    if threads == 1:
        for number in range(count):
            results[number] = task(number)
            if progress:
                progress(number + 1, count)
        return [*results.values()]
    pool = ThreadPoolExecutor(threads, thread_name_prefix="chemage-replica")
    try:
        running: dict[Future[T], int] = {}
        begun = 0
        while len(results) < count:
            # one more for each thread, so that none waits; not all, because there may be 10^9
            while begun < count and len(running) < 2 * threads:
                # options of plugins are context variables, which the threads would not see
                running[
                    pool.submit(contextvars.copy_context().run, task, begun)
                ] = begun
                begun += 1
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                results[running.pop(future)] = future.result()
            if progress:
                progress(len(results), count)
        return [results[number] for number in range(count)]
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


class OncePerObject(Generic[T]):
    """What is computed once for an object, shared by all who ask, and gone with it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._results: dict[int, dict[Any, T]] = {}

    def get(self, owner: Any, key: Any, make: Callable[[], T]) -> T:
        """The result of ``make`` for ``owner`` and ``key``, which is called once; other threads wait for it."""
        with self._lock:
            results = self._results.get(id(owner))
            if results is None:
                results = self._results[id(owner)] = {}
                weakref.finalize(owner, self._results.pop, id(owner), None)
            if key not in results:
                results[key] = make()
            return results[key]
