"""Where a sweep computes: in this process, in processes, or on a Dask cluster, behind ``concurrent.futures.Executor``.

:func:`open_pool` makes any of them from a word such as ``"processes"`` or ``"dask:tcp://host:8786"``. What is computed,
and every bit of it, is the same on all of them.
"""

from __future__ import annotations

import importlib
import logging
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from chemage import threads as thread_budget
from chemage.errors import ChemageError, ExecutorError, InputError, StoreError, WorkerLost
from chemage.spec import nearest

#: how often a task is tried again after its worker died
RETRIES = 1
#: seconds a Dask cluster that we started on this machine may be without any worker; others may stand in a queue
PATIENCE = 120.0
#: seconds to wait for a Dask scheduler
ANSWER_TIME = 4.0
NAMES = ("serial", "processes", "dask")


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


@contextmanager
def open_pool(executor: str | Executor, workers: int | None = None, threads: int | None = None) -> Iterator[Pool]:
    """The pool that ``executor`` names, for the length of a block.

    Parameters
    ----------
    executor
        ``"serial"``; ``"processes"``; ``"dask"`` (a cluster on this machine), ``"dask:tcp://host:8786"`` (one that
        runs), ``"dask:package.module.Class"`` or ``"dask:cluster.toml"`` (one to start, see docs/sweeps.md); or any
        ``concurrent.futures.Executor`` whose workers can import chemage.
    workers
        How many tasks run side by side; default: as many as the processors allow.
    threads
        Threads for each task; default: all processors in ``serial``, one elsewhere.

    Raises
    ------
    InputError
        No such executor, or more threads asked for than there are processors.
    ExecutorError
        It cannot be started, or does not answer.
    """
    _check_count("workers", workers)
    _check_count("threads", threads)
    if isinstance(executor, Executor):
        width = workers or getattr(executor, "_max_workers", None) or thread_budget.processors()
        yield Pool(executor, type(executor).__name__, threads or 1, lambda: width)
        return
    name, _, detail = executor.partition(":")
    if name not in NAMES or (detail and name != "dask"):
        raise InputError.of(
            "executor",
            executor,
            f"no such executor{nearest(name, NAMES)}",
            "choose serial, processes, dask, dask:ADDRESS, dask:CLASS or dask:FILE.toml",
        )
    if name == "serial":
        if workers not in (None, 1):
            raise InputError.of(
                "workers", workers, "serial runs one task at a time", "choose processes or dask, or set threads"
            )
        yield Pool(Serial(), name, threads or thread_budget.available(), lambda: 1)
    elif name == "processes":
        workers, threads = _shares(workers, threads)
        with Processes(workers, threads) as processes:
            yield Pool(processes, name, threads, lambda: workers, processes.abort)
    else:
        with _dask(detail, workers, threads) as pool:
            yield pool


def _check_count(name: str, value: int | None) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
        raise InputError.of(name, value, "must be a whole number of at least 1")


def _shares(workers: int | None, threads: int | None) -> tuple[int, int]:
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


# -- processes --------------------------------------------------------------------------------------------------------

_BOOT = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); from chemage.executors import _serve; _serve()"
)


class Processes(Executor):
    """Processes of this machine, each a fresh interpreter that runs one task at a time.

    Unlike ``ProcessPoolExecutor``, a process that dies takes nothing with it but its own task, which is tried again in
    a new one; and processes end by themselves when this one is gone. A function must be importable by name, and a
    script needs no ``if __name__ == "__main__"``.

    Raises
    ------
    WorkerLost
        From a task's future: as many processes died with it as it was tried.
    ExecutorError
        From a task's future: no process could be started.
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
        """Kill the processes, whatever they are doing, and cancel what waits."""
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
                    task[0].set_running_or_notify_cancel()  # whoever waits for it must learn of it

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
    """Says how, as the rest of a sentence."""


class _Process:
    """One interpreter that answers calls; its standard input and output are the line, what it prints is our stderr."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        # a session of its own: Ctrl-C on the terminal reaches this process alone, which then decides
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
        """Returns when it has imported chemage."""
        try:
            pickle.dump([path or os.getcwd() for path in sys.path], self._to)
            self._to.flush()
        except OSError:
            raise self._death() from None
        self._receive()

    def call(self, message: bytes) -> tuple[str, Any]:
        """``("done", value)`` or ``("failed", exception)``."""
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
        why = " (the system does that to the largest process when memory runs out)" if status == -9 else ""
        return _ProcessDied(f"was ended by {name}{why}")

    def kill(self) -> None:
        """End it now; one that is dead already keeps its own exit status."""
        with suppress(OSError):
            self._popen.kill()

    def close(self) -> None:
        """End it; it ends by itself when its input does."""
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


def _serve() -> None:
    """The life of a worker process."""
    import warnings

    from chemage.registry import PluginWarning

    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a plugin prints must not get into the answers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", PluginWarning)  # the parent has said it already
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def listen() -> None:
        try:
            while True:
                tasks.put(_receive(sys.stdin.buffer))
        except (EOFError, OSError):
            os._exit(0)  # the parent has closed the line or is gone: whatever is running is of no use to anyone

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
        with suppress(Exception):  # an exception that cannot travel goes as text
            whole = pickle.dumps(("failed", error))
            pickle.loads(whole)
            answer = whole
        return answer


# -- Dask -------------------------------------------------------------------------------------------------------------


class Dask(Executor):
    """Tasks on the workers of a ``distributed.Client``. Dask itself tries a task again when its worker dies."""

    def __init__(self, client: Any, wanted: int = 0) -> None:
        # ``wanted`` workers of a cluster of our own; 0: somebody else looks after them
        self._client, self._wanted = client, wanted
        self._inner = client.get_executor(pure=False)
        self._known = (0.0, 1)
        self._alive, self._revived = time.monotonic(), 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        from distributed.scheduler import KilledWorker

        outer: Future[Any] = Future()
        outer.set_running_or_notify_cancel()

        def finished(inner: Future[Any]) -> None:
            if inner.cancelled():
                outer.set_exception(ExecutorError("the Dask scheduler is gone, or has dropped the task"))
                return
            error = inner.exception()
            if isinstance(error, KilledWorker):
                outer.set_exception(
                    WorkerLost(f"{error.allowed_failures + 1} Dask workers died at this task; the last {_at(error)}")
                )
            elif error is not None:
                outer.set_exception(error)
            else:
                outer.set_result(inner.result())

        self._inner.submit(fn, *args, **kwargs).add_done_callback(finished)
        return outer

    def width(self) -> int:
        """Threads of the workers there are now, at least 1; asked anew every second.

        Raises
        ------
        ExecutorError
            A cluster of our own has had no worker for ``PATIENCE`` seconds; tasks would wait for ever.
        """
        when, width = self._known
        now = time.monotonic()
        if now > when + 1:
            found = None
            # no answer: the scheduler is busy, or gone, which its tasks will tell
            with suppress(OSError, RuntimeError):
                found = sum(self._client.nthreads().values())
                width = max(1, found)
            if found:
                self._alive, self._revived = now, 0
            elif found == 0 and self._wanted:
                self._revive(now - self._alive)
            self._known = (now, width)
        return width

    def _revive(self, seconds: float) -> None:
        """Dask gives a worker up that dies while it starts; a cluster of our own is told to start others."""
        if seconds > PATIENCE:
            raise ExecutorError(
                f"the Dask cluster has had no worker for {seconds:.0f} s; look at its logs. "
                "What is finished is kept, the same sweep goes on"
            )
        if seconds > 10 * (self._revived + 1):
            self._revived += 1
            cluster = self._client.cluster
            with suppress(Exception):
                cluster.scale(len(cluster.worker_spec) + self._wanted)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._inner.shutdown(wait=wait and not cancel_futures)


def _at(error: Any) -> str:
    worker = getattr(error, "last_worker", None)
    return f"was at {getattr(worker, 'address', worker)}"


@contextmanager
def _dask(detail: str, workers: int | None, threads: int | None) -> Iterator[Pool]:
    try:
        import dask.config as dask_config
        import distributed
    except ImportError as error:
        raise ExecutorError(
            f"executor dask needs Dask, which is not installed ({error}): pip install 'chemage[dask]'"
        ) from None
    where = _Where.read(detail, workers)
    each = threads or 1
    if where.local:
        count, each = _shares(where.workers, threads)
        where.options = {**_local_options(count), **where.options}
    # Dask sets what a library reads at import in its own process, too, while it starts a worker; numba would then
    # refuse to compile in this one, and needs it in the worker alone.
    early = thread_budget.environment(each)
    late = {name: early.pop(name) for name in ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS")}
    settings: dict[str, Any] = {
        "distributed.scheduler.allowed-failures": RETRIES,
        **{
            name: {**dask_config.get(name, {}), **values}
            for name, values in (("distributed.nanny.pre-spawn-environ", early), ("distributed.nanny.environ", late))
        },
    }
    # for as long as the cluster lives: workers are also started later, when it grows or one of them died
    with dask_config.set(settings), _quiet(), _connected(distributed, where) as client:
        pool = Dask(client, where.workers or 1 if where.local else 0)
        try:
            yield Pool(pool, "dask", each, pool.width, blames_one=False)
        finally:
            with suppress(Exception):
                pool.shutdown(wait=False)


@contextmanager
def _quiet() -> Iterator[None]:
    """What Dask logs as tracebacks while a worker or the scheduler goes away is told by our own errors."""
    logger = logging.getLogger("distributed.client")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


@contextmanager
def _connected(distributed: Any, where: _Where) -> Iterator[Any]:
    cluster = None if where.address else where.start()
    try:
        client = _connect(distributed, where.address or cluster)
        try:
            yield client
        finally:
            with suppress(Exception):
                client.close(timeout=5)
    finally:
        if cluster is not None:
            with suppress(Exception):
                cluster.close(timeout=10)


def _local_options(count: int) -> dict[str, Any]:
    return {
        "n_workers": count,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": ":0",
        "silence_logs": logging.CRITICAL,
        # Ctrl-C on the terminal is for this process to decide on; the workers end with the cluster
        "preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
    }


def _connect(distributed: Any, target: Any) -> Any:
    shown = target if isinstance(target, str) else "the cluster that was started"
    options = (
        {"scheduler_file": target} if isinstance(target, str) and target.endswith(".json") else {"address": target}
    )
    if "scheduler_file" in options and not Path(target).is_file():
        raise StoreError(f"the Dask scheduler file {target} does not exist")
    try:
        return distributed.Client(**options, timeout=ANSWER_TIME, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).split("\n")[0] or type(error).__name__
        raise ExecutorError(
            f"no Dask scheduler answers at {shown} within {ANSWER_TIME:g} s ({reason}); check the address, and that "
            "`dask scheduler` runs there"
        ) from None


@dataclass
class _Where:
    """What stands behind ``dask:``."""

    address: str = ""
    cluster: str = "distributed.LocalCluster"
    local: bool = True
    workers: int | None = None
    adapt: dict[str, Any] | None = None
    options: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, detail: str, workers: int | None) -> _Where:
        if not detail:
            return cls(workers=workers)
        if "://" in detail or detail.rpartition(":")[2].isdigit() or detail.endswith(".json"):
            return cls(address=detail, local=False)
        if detail.endswith((".toml", ".yaml", ".yml")):
            return cls._from_file(Path(detail), workers)
        return cls(cluster=detail, local=False, workers=workers)

    @classmethod
    def _from_file(cls, path: Path, workers: int | None) -> _Where:
        known = ("address", "cluster", "workers", "adapt", "options")
        data = _configuration(path)
        for name in data:
            if name not in known:
                raise InputError(f"{path}: {name}: no such entry{nearest(name, known)}; known: {', '.join(known)}")
        if ("address" in data) == ("cluster" in data):
            raise InputError(f'{path}: give either address = "tcp://..." or cluster = "package.Class"')
        for name, kind in (("address", str), ("cluster", str), ("workers", int), ("adapt", dict), ("options", dict)):
            if name in data and not isinstance(data[name], kind):
                raise InputError(f"{path}: {name} = {data[name]!r}: expected a {kind.__name__}")
        if "address" in data:
            return cls(address=data["address"], local=False)
        return cls(
            cluster=data["cluster"],
            local=False,
            workers=workers or data.get("workers"),
            adapt=data.get("adapt"),
            options=data.get("options", {}),
        )

    def start(self) -> Any:
        """The cluster, with its workers asked for."""
        module, _, name = self.cluster.rpartition(".")
        try:
            make = getattr(importlib.import_module(module or "builtins"), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise ExecutorError(
                f"dask:{self.cluster} cannot be imported ({error}); give an address such as tcp://host:8786, a file "
                "such as cluster.toml, or the dotted path of a cluster class such as dask_jobqueue.SLURMCluster"
            ) from None
        try:
            cluster = make(**self.options)
            if not self.local and self.adapt is not None:
                cluster.adapt(**self.adapt)
            elif not self.local and self.workers is not None:
                cluster.scale(self.workers)
        except ChemageError:
            raise
        except Exception as error:
            guard = "; a script must ask for it below `if __name__ == '__main__':`"
            hint = guard if "failed to start" in str(error) else ""
            raise ExecutorError(
                f"the Dask cluster {self.cluster} did not start: {type(error).__name__}: {error}{hint}"
            ) from error
        return cluster


def _configuration(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StoreError(f"the cluster file {path} cannot be read: {error}") from None
    try:
        if path.suffix == ".toml":
            import tomllib

            data: Any = tomllib.loads(text)
        else:
            import yaml  # comes with Dask

            data = yaml.safe_load(text)
    except Exception as error:
        raise InputError(f"the cluster file {path} cannot be read: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"the cluster file {path} holds {type(data).__name__}; expected names and values")
    return data
