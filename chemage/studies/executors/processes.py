"""Worker processes on this machine, as `loky <https://loky.readthedocs.io>`_ makes them.

When a process dies, loky gives up all tasks that were running; this executor starts new processes for the next task,
and the runner of a study finds out which of the tasks it was. Scripts need no ``if __name__ == "__main__"``.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ExecutorError, WorkerLost

#: seconds between two looks whether the parent process is there
WATCH = 1.0


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
