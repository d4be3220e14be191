"""The executors of a study: this process, its threads, several processes, or a Dask cluster.

All have the interface of ``concurrent.futures.Executor``, and results are the same to the last bit. Worker processes on
this machine are those of `loky <https://loky.readthedocs.io>`_: when one dies, loky gives up all tasks that were
running; new processes are started for the next task, and the runner of a study finds out which of the tasks it was.
Scripts need no ``if __name__ == "__main__"``.
"""

from __future__ import annotations

import contextvars
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ExecutorError, InputError, WorkerLost, nearest
from chemage.studies.clusters import open_cluster, seconds

NAMES = ("serial", "threads", "processes", "dask")
#: seconds between two looks whether the parent process is there
WATCH = 1.0


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


class Processes(Executor):
    """Processes that outlive the death of one of them, and end when this process does.

    Parameters
    ----------
    workers
        Number of processes.
    threads
        Threads per process.

    Raises
    ------
    WorkerLost
        By the future of a task: a process died while the task was running.
    ExecutorError
        By the future of a task: no process could be started.
    """

    def __init__(self, workers: int, threads: int = 1) -> None:
        self.workers, self._threads = workers, threads
        self._lock = threading.Lock()
        self._inner: Any = None
        self._began = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue a task, in new processes if one has died."""
        outer: Future[Any] = Future()
        with self._lock:
            for _ in range(2):
                self._inner = self._inner or self._started()
                try:
                    inner = self._inner.submit(fn, *args, **kwargs)
                    break
                except BrokenProcessPool:
                    self._inner = None
            else:
                outer.set_exception(ExecutorError("worker processes cannot be started"))
                return outer
        pool = self._inner
        outer.set_running_or_notify_cancel()

        def ended(inner: Future[Any]) -> None:
            error = None if inner.cancelled() else inner.exception()
            if isinstance(error, BrokenProcessPool):
                with self._lock:
                    if self._inner is pool:
                        self._inner = None
                outer.set_exception(self._death(error))
            elif inner.cancelled() or type(error).__name__ == "ShutdownExecutorError":
                outer.set_exception(WorkerLost("the worker process was stopped"))
            elif error is not None:
                outer.set_exception(error)
            else:
                self._began = True
                outer.set_result(inner.result())

        inner.add_done_callback(ended)
        return outer

    def _started(self) -> Any:
        from loky import ProcessPoolExecutor

        return ProcessPoolExecutor(
            self.workers,
            initializer=_begin,
            initargs=(os.getpid(), [path or os.getcwd() for path in sys.path]),
            env=thread_budget.environment(self._threads),
        )

    def _death(self, error: BaseException) -> Exception:
        text = str(error)
        codes = re.findall(r"([A-Z]+)\((-?\d+)\)", text)
        how = next((_in_words(name, int(code)) for name, code in codes if int(code)), "")
        if not how and not self._began:
            return ExecutorError("a worker process could not start; its own message is above")
        return WorkerLost(f"the worker process died at this task: it {how or 'ended'}")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the tasks in the queue; with ``cancel_futures`` at once."""
        with self._lock:
            inner, self._inner = self._inner, None
        if inner is not None:
            inner.shutdown(wait=wait, kill_workers=cancel_futures)

    def abort(self) -> None:
        """Kill the processes and cancel the tasks in the queue."""
        self.shutdown(cancel_futures=True)


def _in_words(name: str, code: int) -> str:
    if name != "EXIT":
        why = " (the system kills the largest process when memory runs out)" if code == -signal.SIGKILL else ""
        return f"was ended by {name}{why}"
    return f"ended with exit status {code}"


def _begin(parent: int, path: Sequence[str]) -> None:
    """Prepare a worker process: the import path of its parent, with which it ends; Ctrl-C is for the parent."""
    import warnings

    from chemage.plugins.registry import PluginWarning

    sys.path[:] = path
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", PluginWarning)  # the parent process has shown them

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(0)

    if os.name == "posix":
        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def open_pool(
    executor: str | Executor,
    workers: int | None = None,
    threads: int | None = None,
    patience: float | str | None = None,
) -> Iterator[Pool]:
    """Open the executor that ``executor`` names, for the duration of a block.

    Parameters
    ----------
    executor
        ``"serial"``; ``"threads"`` (of this process); ``"processes"``; ``"dask"`` (a new cluster on this machine),
        ``"dask:tcp://host:8786"`` (a running cluster), ``"dask:package.module.Class"`` or ``"dask:cluster.toml"`` (a
        cluster to start, see docs/sweeps.md); or any ``concurrent.futures.Executor`` whose workers can import chemage.
    workers
        Number of concurrent tasks; default: chosen automatically from the number of processors.
    threads
        Threads per task; default: all processors with ``serial``, one with any other executor.
    patience
        Longest time to wait while a Dask cluster has no worker: s, or text with a unit such as ``"10 min"``; default:
        120 s for a cluster started on this machine, no limit for any other, whose jobs may be queued.

    Raises
    ------
    InputError
        There is no such executor, or ``workers`` and ``threads`` exceed the number of processors.
    ExecutorError
        The executor cannot be started, or does not respond.
    """
    _check_count("workers", workers)
    _check_count("threads", threads)
    limit = None if patience is None else seconds(patience)
    if isinstance(executor, Executor):
        width = workers or getattr(executor, "_max_workers", None) or thread_budget.processors()
        here = isinstance(executor, ThreadPoolExecutor)
        yield Pool(executor, type(executor).__name__, threads or 1, lambda: width, remote=not here)
        return
    name, _, detail = executor.partition(":")
    if name not in NAMES or (detail and name != "dask"):
        raise InputError.of(
            "executor",
            executor,
            f"no such executor{nearest(name, NAMES)}",
            "choose serial, threads, processes, dask, dask:ADDRESS, dask:CLASS or dask:FILE.toml",
        )
    if name == "serial":
        if workers not in (None, 1):
            raise InputError.of(
                "workers",
                workers,
                "serial runs one task at a time",
                "choose another executor, or set threads",
            )
        yield Pool(Serial(), name, threads or thread_budget.available(), lambda: 1, remote=False)
    elif name == "threads":
        workers, threads = shares(workers, threads)
        with Threads(workers, thread_name_prefix="chemage-task") as executor:
            yield Pool(executor, name, threads, lambda: workers, remote=False)
    elif name == "processes":
        workers, threads = shares(workers, threads)
        with Processes(workers, threads) as processes:
            yield Pool(processes, name, threads, lambda: workers, processes.abort)
    else:
        if not detail:
            workers, threads = shares(workers, threads)
        with open_cluster(detail, workers, threads or 1, limit) as cluster:
            yield Pool(cluster, name, threads or 1, cluster.width, here=False)


def _check_count(name: str, value: int | None) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
        raise InputError.of(name, value, "must be a whole number of at least 1")


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
