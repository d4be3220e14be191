"""What a sweep knows of the executor it computes on, and the simplest of them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import InputError


@dataclass(frozen=True)
class Pool:
    """An executor in use by a sweep."""

    executor: Executor
    name: str
    #: threads each task may use
    threads: int
    #: how many tasks can run at once, now
    width: Callable[[], int]
    #: stops at once, whatever is running
    abort: Callable[[], None] = field(default=lambda: None)
    #: whether a lost worker is blamed on the one task it worked on; Dask blames all that were waiting there as well
    blames_one: bool = True


def shares(workers: int | None, threads: int | None) -> tuple[int, int]:
    """Workers and threads of each, which together never ask for more than the processors there are."""
    processors = thread_budget.processors()
    threads = threads or 1
    if workers is None:
        workers = max(1, processors // threads)
    if threads > 1 and workers * threads > processors:
        raise InputError(
            f"workers = {workers} with threads = {threads} each: that is more than the {processors} processors there "
            f"are; give at most {max(1, processors // workers)} threads"
        )
    return workers, threads


class Serial(Executor):
    """Runs each task in this thread as it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future
