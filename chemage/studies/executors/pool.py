"""The executor of a study with its properties, and those in this process."""

from __future__ import annotations

import contextvars
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import InputError

#: number of times that a task is tried again after its worker died
RETRIES = 1


@dataclass(frozen=True)
class Pool:
    """An executor that a study uses, and its properties."""

    executor: Executor
    name: str
    #: threads per task
    threads: int
    #: returns the present number of concurrent tasks
    width: Callable[[], int]
    #: stops the running tasks immediately
    abort: Callable[[], None] = field(default=lambda: None)
    #: whether tasks run in other processes
    remote: bool = True
    #: whether tasks run on this machine, and share its memory
    here: bool = True

    def submit(self, fn: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a task."""
        return self.executor.submit(fn, *args)


def shares(workers: int | None, threads: int | None) -> tuple[int, int]:
    """Choose the number of workers and of threads per worker, together no more than the number of processors.

    Raises
    ------
    InputError
        The given numbers exceed the number of processors.
    """
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
    """Runs each task in the calling thread when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run the task; the future has its result or its exception."""
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Threads(ThreadPoolExecutor):
    """Threads of this process, which see the options of plugins of the thread that submits a task."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue a task."""
        return super().submit(contextvars.copy_context().run, fn, *args, **kwargs)
