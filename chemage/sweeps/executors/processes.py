"""Worker processes on this machine; the death of a process affects only its own task.

``concurrent.futures.ProcessPoolExecutor`` fails all of its tasks when one process dies, requires scripts to guard their
main module, and its processes outlive the parent; this executor does not.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import Any, BinaryIO

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ExecutorError, WorkerLost

#: number of times that a task is tried again after its worker died
RETRIES = 1
_BOOT = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from chemage.sweeps.executors.processes import serve; serve()"
)


class Processes(Executor):
    """Processes on this machine, each a new interpreter that runs one task at a time.

    If a process dies, its task is tried again in a new process and other tasks are not affected. The processes end when
    this process does. Functions must be importable by name; scripts need no ``if __name__ == "__main__"``.

    Parameters
    ----------
    workers
        Number of processes; default: chosen automatically from the number of processors.
    threads
        Threads per process.
    retries
        Number of times that a task is tried again after its process died.

    Raises
    ------
    WorkerLost
        By the future of a task: its process died at every attempt.
    ExecutorError
        By the future of a task: no process could be started.
    """

    def __init__(self, workers: int | None = None, threads: int = 1, *, retries: int = RETRIES) -> None:
        self.workers = workers or max(1, thread_budget.processors() // threads)
        self._environment = {**os.environ, **thread_budget.environment(threads)}
        self._retries = retries
        self._tasks: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._slots: list[threading.Thread] = []
        self._running: set[_Process] = set()
        self._lock = threading.Lock()
        self._closed = self._aborted = False
        self._waiting = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue a task; starts another process if all are busy and there are fewer than ``workers``."""
        message = pickle.dumps((fn, args, kwargs))
        future: Future[Any] = Future()
        with self._lock:
            if self._closed:
                raise RuntimeError("cannot submit to processes that were shut down")
            self._waiting += 1
            if self._waiting > len(self._slots) and len(self._slots) < self.workers:
                slot = threading.Thread(target=self._slot, name=f"chemage-process-{len(self._slots)}", daemon=True)
                self._slots.append(slot)
                slot.start()
        self._tasks.put((future, message))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the tasks in the queue; with ``cancel_futures`` after those that run."""
        with self._lock:
            closed, self._closed = self._closed, True
        if cancel_futures:
            self._cancel_waiting()
        if not closed:
            for _ in self._slots:
                self._tasks.put(None)
        if wait:
            for slot in self._slots:
                slot.join()

    def abort(self) -> None:
        """Kill the processes and cancel the tasks in the queue."""
        with self._lock:
            self._aborted = True
            running = list(self._running)
        self._cancel_waiting()
        for process in running:
            process.kill()
        self.shutdown(wait=True)

    def _cancel_waiting(self) -> None:
        with suppress(queue.Empty):
            while True:
                task = self._tasks.get_nowait()
                if task is not None and task[0].cancel():
                    task[0].set_running_or_notify_cancel()  # notifies those who wait for it

    def _slot(self) -> None:
        process: _Process | None = None
        while (task := self._tasks.get()) is not None:
            future, message = task
            if future.set_running_or_notify_cancel():
                process = self._carry_out(future, message, process)
            with self._lock:
                self._waiting -= 1
        if process is not None:
            self._forget(process)
            process.close()

    def _carry_out(self, future: Future[Any], message: bytes, process: _Process | None) -> _Process | None:
        deaths = 0
        while True:
            try:
                process = process or self._start()
                kind, value = process.call(message)
            except _ProcessDied as died:
                if process is not None:
                    self._forget(process)
                    process = None
                deaths += 1
                if deaths <= self._retries and not self._aborted:
                    continue
                times = "" if deaths == 1 else f" {deaths} times"
                future.set_exception(WorkerLost(f"the worker process died{times} at this task; the last {died}"))
            except Exception as error:
                future.set_exception(error)
            else:
                if kind == "done":
                    future.set_result(value)
                else:
                    future.set_exception(value)
            return process

    def _start(self) -> _Process:
        process = _Process(self._environment)
        with self._lock:
            self._running.add(process)
            aborted = self._aborted
        if aborted:
            process.kill()
        try:
            process.wait_until_ready()
        except _ProcessDied as died:
            self._forget(process)
            if self._aborted:
                raise WorkerLost("the worker process was stopped") from None
            raise ExecutorError(f"a worker process could not start: it {died}; its own message is above") from None
        return process

    def _forget(self, process: _Process) -> None:
        with self._lock:
            self._running.discard(process)


class _ProcessDied(Exception):
    """How a process died, as the rest of a sentence that begins with it."""


class _Process:
    """One interpreter that runs tasks, received and answered through pipes; its own output goes to stderr."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        # a session of its own, so that Ctrl-C on the terminal reaches the parent process only
        self._popen = subprocess.Popen(
            [sys.executable, "-c", _BOOT],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=dict(environment),
            start_new_session=os.name == "posix",
        )
        assert self._popen.stdin is not None
        assert self._popen.stdout is not None
        self._to, self._from = self._popen.stdin, self._popen.stdout
        self.pid = self._popen.pid

    def wait_until_ready(self) -> None:
        """Wait until the interpreter has imported chemage."""
        try:
            pickle.dump([path or os.getcwd() for path in sys.path], self._to)
            self._to.flush()
        except OSError:
            raise self._death() from None
        self._receive()

    def call(self, message: bytes) -> tuple[str, Any]:
        """Run a task: ``("done", value)`` or ``("failed", exception)``."""
        try:
            _send(self._to, message)
        except OSError:
            raise self._death() from None
        return self._receive()

    def _receive(self) -> tuple[str, Any]:
        try:
            return pickle.loads(_receive(self._from))
        except (EOFError, OSError):
            raise self._death() from None

    def _death(self) -> _ProcessDied:
        self.kill()
        status = self._popen.wait()
        self.close()
        if status >= 0:
            return _ProcessDied(f"ended with exit status {status}")
        name = signal.Signals(-status).name if -status in list(signal.Signals) else f"signal {-status}"
        why = " (the system kills the largest process when memory runs out)" if status == -9 else ""
        return _ProcessDied(f"was ended by {name}{why}")

    def kill(self) -> None:
        """Kill the process; a process that has ended keeps its exit status."""
        with suppress(OSError):
            self._popen.kill()

    def close(self) -> None:
        """End the process by closing its pipes."""
        for stream in (self._to, self._from):
            with suppress(OSError):
                stream.close()
        self._popen.wait()


def _send(stream: BinaryIO | Any, message: bytes) -> None:
    stream.write(struct.pack(">Q", len(message)))
    stream.write(message)
    stream.flush()


def _receive(stream: BinaryIO | Any) -> bytes:
    header = stream.read(8)
    if len(header) < 8:
        raise EOFError
    (size,) = struct.unpack(">Q", header)
    message = stream.read(size)
    if len(message) < size:
        raise EOFError
    return message


def serve() -> None:
    """Run tasks until the pipe is closed; the main function of a worker process."""
    import warnings

    from chemage.plugins.registry import PluginWarning

    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a plugin prints must not mix with the answers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", PluginWarning)  # the parent process has shown them
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def listen() -> None:
        try:
            while True:
                tasks.put(_receive(sys.stdin.buffer))
        except (EOFError, OSError):
            os._exit(0)  # the parent has closed the pipe or has ended

    threading.Thread(target=listen, daemon=True).start()
    _send(answers, pickle.dumps(("ready", os.getpid())))
    while True:
        _send(answers, _answer(tasks.get()))


def _answer(message: bytes) -> bytes:
    try:
        fn, args, kwargs = pickle.loads(message)
        return pickle.dumps(("done", fn(*args, **kwargs)))
    except Exception as error:
        answer = pickle.dumps(("failed", ExecutorError(f"{type(error).__name__}: {error}")))
        with suppress(Exception):  # an exception that cannot be pickled is sent as text
            whole = pickle.dumps(("failed", error))
            pickle.loads(whole)
            answer = whole
        return answer
