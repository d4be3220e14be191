"""Runs the tasks of a study on an executor: those of one contact together, so that it is solved once.

The executors of a study: this process, its threads, several processes, or a Dask cluster.

All have the interface of ``concurrent.futures.Executor``, and results are the same to the last bit. Worker processes on
this machine are those of `loky <https://loky.readthedocs.io>`_: when one dies, loky gives up all tasks that were
running; new processes are started for the next task, and the runner of a study finds out which of the tasks it was.
Scripts need no ``if __name__ == "__main__"``.

Connects to a Dask cluster: a running one, or a new one on this machine.

A Dask scheduler queues tasks and waits for the jobs of its workers. Clusters of many machines are started by
`dask-jobqueue <https://jobqueue.dask.org>`_ or by hand, see docs/clusters.md.
"""

from __future__ import annotations

import contextvars
import logging
import math
import os
import re
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.checks import checked_count
from chemage.foundation.errors import (
    ExecutorError,
    InputError,
    StoreError,
    WorkerLost,
    nearest,
)
from chemage.foundation.memory import capacity
from chemage.foundation.units import convert
from chemage.plugins import registry
from chemage.studies.folder import RESUME
from chemage.studies.tasks import (
    RETRIES,
    Answer,
    Outcome,
    Place,
    PluginsInUse,
    Task,
    ageing_seconds,
    by_contact,
    compute,
    failure,
)

#: time to wait for a Dask scheduler, s
ANSWER_TIME = 4.0
#: loggers that show a traceback when a worker or the scheduler is lost
_LOGGERS = (
    "distributed.client",
    "distributed.utils",
    "tornado.application",
    "asyncio",
)
#: of a new cluster on this machine
_LOCAL: dict[str, Any] = {
    "threads_per_worker": 1,
    "processes": True,
    # the scheduler, its pages and its workers can be reached from this machine alone
    "host": "127.0.0.1",
    "dashboard_address": "127.0.0.1:0",
    "silence_logs": logging.CRITICAL,
    # Ctrl-C on the terminal is handled by this process; the workers end with the cluster
    "preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
}


@contextmanager
def open_client(
    detail: str, workers: int | None, threads: int, patience: float | None = None
) -> Iterator[Any]:
    """Connect a ``distributed.Client`` for the duration of a block.

    Parameters
    ----------
    detail
        The address of a scheduler, or its scheduler file; "" for a new cluster on this machine.
    workers, threads
        Of a new cluster: number of workers, and threads per worker.
    patience
        Longest time to wait for the first worker, s; None: tasks wait in the queue of the scheduler.

    Raises
    ------
    InputError
        ``detail`` is neither an address nor a scheduler file.
    ExecutorError
        Dask is not installed, the cluster does not start, or no scheduler or worker answers.
    """
    try:
        import dask.config as dask_config
        import distributed
    except ImportError as error:
        raise ExecutorError(
            f"executor dask needs Dask, which is not installed ({error}): pip install 'chemage[dask]'"
        ) from None
    options = _address(detail) if detail else {}
    # Dask sets "pre-spawn" variables, which libraries read at import, in this process as well; numba would then refuse
    # to compile here, so that its variables are set in the workers only
    early = thread_budget.environment(threads)
    late = {
        name: early.pop(name) for name in ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS")
    }
    settings = {
        # the runner of a study tries again what a worker died of, beside nothing else
        "distributed.scheduler.allowed-failures": 0,
        "distributed.nanny.pre-spawn-environ": early,
        "distributed.nanny.environ": late,
    }
    with dask_config.set(settings), _quiet(), ExitStack() as stack:
        try:
            if not detail:
                cluster = distributed.LocalCluster(n_workers=workers, **_LOCAL)
                options = {"address": stack.enter_context(cluster)}
            client = distributed.Client(
                **options, timeout=ANSWER_TIME, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            raise _unavailable(detail, error) from None
        try:
            if patience is not None:
                try:
                    client.wait_for_workers(1, timeout=patience)
                except TimeoutError:
                    raise ExecutorError(
                        f"the Dask cluster has had no worker for {patience:g} s: look at its queue and its logs, or "
                        "wait longer with --patience"
                    ) from None
            yield client
        finally:
            with suppress(Exception):
                client.close(timeout=5)


def _address(detail: str) -> dict[str, Any]:
    if detail.endswith(".json"):
        if not Path(detail).is_file():
            raise StoreError(f"the Dask scheduler file {detail} does not exist")
        return {"scheduler_file": detail}
    if not re.search(r"[^/:]:\d+/?$", detail):
        raise InputError.of(
            "executor",
            f"dask:{detail}",
            "is no address with host and port, and no scheduler file",
            "start the cluster, for example with dask-jobqueue, and write dask:tcp://host:8786 or dask:scheduler.json",
        )
    return {"address": detail}


def _unavailable(detail: str, error: Exception) -> ExecutorError:
    reason = str(error).partition("\n")[0] or type(error).__name__
    if detail:
        return ExecutorError(
            f"no Dask scheduler answers at {detail} within {ANSWER_TIME:g} s ({reason}); check the address, and that "
            "`dask scheduler` runs there"
        )
    return ExecutorError(
        f"the Dask cluster did not start: {reason}; in a script, start it below `if __name__ == '__main__':`"
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the tracebacks that Dask logs when a worker or the scheduler is lost; chemage raises its own errors."""
    levels = {logger: logger.level for logger in map(logging.getLogger, _LOGGERS)}
    for logger in levels:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


def seconds(value: object) -> float:
    """Read a time to wait: s, or text with its unit.

    Raises
    ------
    InputError
        It is no positive time.
    """
    with suppress(ValueError):
        value = float(value) if isinstance(value, str) else value
    time_limit = convert(value, "s")
    if not time_limit > 0:
        raise InputError.of("patience", value, "must be positive")
    return time_limit


NAMES = ("serial", "threads", "processes", "dask")
#: seconds between two looks whether the parent process is there
WATCH = 1.0


@dataclass(frozen=True)
class Pool:
    """An executor that a study uses, and its properties."""

    executor: Executor
    #: threads per task
    threads: int
    #: number of concurrent tasks, where it does not change
    workers: int
    #: whether tasks run in other processes
    remote: bool = True
    #: of Dask: its client
    client: Any = None

    @property
    def here(self) -> bool:
        """Whether tasks run on this machine, and share its memory."""
        return self.client is None

    @property
    def lost(self) -> bool:
        """Whether no task will end any more: what waits in a client that has given up its scheduler may not be told."""
        return self.client is not None and self.client.status in (
            "closing",
            "closed",
        )

    def width(self) -> int:
        """The present number of concurrent tasks."""
        if self.client is None:
            return self.workers
        # the scheduler is busy; or gone: its tasks fail
        with suppress(OSError, RuntimeError, AttributeError):
            return max(1, sum(self.client.nthreads().values()))
        return 1

    def abort(self) -> None:
        """Stop the running tasks immediately, where that is possible."""
        if isinstance(self.executor, Processes):
            self.executor.shutdown(cancel_futures=True)


class Serial(Executor):
    """Runs each task in the calling thread when it is submitted."""

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
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

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
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
    """

    def __init__(self, workers: int, threads: int = 1) -> None:
        self.workers, self._threads = workers, threads
        self._inner = self._started()

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        """Queue a task, in new processes if one has died."""
        try:
            return self._inner.submit(fn, *args, **kwargs)
        except BrokenProcessPool:
            self._inner = self._started()
            return self._inner.submit(fn, *args, **kwargs)

    def _started(self) -> Any:
        from loky import ProcessPoolExecutor

        return ProcessPoolExecutor(
            self.workers,
            initializer=_begin,
            initargs=(os.getpid(), sys.path, registry.current().installed()),
            env=thread_budget.environment(self._threads),
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the tasks in the queue; with ``cancel_futures`` at once."""
        self._inner.shutdown(wait=wait, kill_workers=cancel_futures)


def _begin(parent: int, path: Sequence[str], plugins: registry.InUse) -> None:
    """Prepare a worker process: it has the import path and the plugins of its parent, with which it ends; Ctrl-C is for
    the parent."""
    sys.path[:] = path
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    registry.use_only(plugins)

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
        ``"dask:tcp://host:8786"`` or ``"dask:scheduler.json"`` (a running cluster); or any
        ``concurrent.futures.Executor`` whose workers can import chemage, such as ``client.get_executor()`` of Dask.
    workers
        Number of concurrent tasks; default: chosen automatically from the number of processors.
    threads
        Threads per task; default: all processors with ``serial``, one with any other executor.
    patience
        Longest time to wait for the first worker of a Dask cluster: s, or text with a unit such as ``"10 min"``;
        default: no limit, because its jobs may be queued.

    Raises
    ------
    InputError
        There is no such executor, or ``workers`` and ``threads`` exceed the number of processors.
    ExecutorError
        The executor cannot be started, or does not respond.
    """
    for name, count in (("workers", workers), ("threads", threads)):
        if count is not None:
            checked_count(name, count)
    limit = None if patience is None else seconds(patience)
    if isinstance(executor, Executor):
        own = getattr(executor, "_max_workers", None)
        width = workers or own or thread_budget.processors()
        remote = not isinstance(executor, ThreadPoolExecutor)
        yield Pool(executor, threads or 1, width, remote)
        return
    name, _, detail = executor.partition(":")
    if name not in NAMES or (detail and name != "dask"):
        remedy = "choose serial, threads, processes, dask, dask:ADDRESS or dask:SCHEDULER.json"
        raise InputError.of(
            "executor", executor, f"no such executor{nearest(name, NAMES)}", remedy
        )
    if name == "serial":
        if workers not in (None, 1):
            remedy = "choose another executor, or set threads"
            raise InputError.of(
                "workers", workers, "serial runs one task at a time", remedy
            )
        yield Pool(Serial(), threads or thread_budget.available(), 1, remote=False)
        return
    if not detail:
        workers, threads = shares(workers, threads)
    width, threads = workers or 1, threads or 1
    if name == "threads":
        with Threads(width, thread_name_prefix="chemage-task") as pool:
            yield Pool(pool, threads, width, remote=False)
    elif name == "processes":
        with Processes(width, threads) as pool:
            yield Pool(pool, threads, width)
    else:
        with open_client(detail, workers, threads, limit) as client:
            yield Pool(
                client.get_executor(pure=False), threads, width, client=client
            )


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


#: called in this thread with each task as it ends
Told = Callable[[Task, Outcome], None]
#: seconds between two reports of the progress
PERIOD = 0.2
#: memory of the program itself, bytes
PROGRAM = 2e8
_GONE = f"the executor dropped its tasks: its scheduler is gone; {RESUME}"


@dataclass
class Piece:
    """Tasks that one worker computes in one call: all have one contact."""

    tasks: list[Task]
    #: whether the contact must be solved
    solves: bool
    #: estimated CPU time, s; nan where it is not known
    weight: float
    #: whether nothing else runs at the same time, so that a worker that dies must have died of this piece
    alone: bool = False
    #: how often a worker died of it while nothing else ran
    deaths: int = 0


class Runner:
    """Runs tasks on the workers of ``pool``.

    Parameters
    ----------
    pool
        The executor.
    place
        The folder in which results are kept; None: they are handed to the caller.
    known
        Components and plugins that are registered by hand, for workers in other processes.
    watch
        Called several times a second while tasks run, with this runner.
    """

    def __init__(
        self,
        pool: Pool,
        place: Place | None,
        known: PluginsInUse | None,
        watch: Callable[[Runner], None] | None,
    ) -> None:
        self._pool, self._place, self._known, self._watch = (
            pool,
            place,
            known,
            watch,
        )
        self._whole = None if place is None else place.whole
        self._ready: deque[Piece] = deque()
        #: contacts that must be solved: pieces that wait for them, the one that solves it first
        self._contacts: deque[list[Piece]] = deque()
        self._behind: dict[str, list[Piece]] = {}
        self._running: dict[Future[Answer], Piece] = {}
        self._suspects: deque[Piece] = deque()
        #: wall time, s, number and weights of the pieces that have ended
        self._seconds, self._ended, self._weight = 0.0, 0, 0.0
        self._memory = capacity() - PROGRAM if pool.here else math.inf

    @property
    def unsolved(self) -> int:
        """Contacts that are still to be solved."""
        return len(self._contacts) + len(self._behind)

    @property
    def width(self) -> int:
        """Present number of concurrent pieces."""
        return self._pool.width()

    def run(self, tasks: Iterable[Task], told: Told) -> None:
        """Compute ``tasks``, and call ``told`` with each as it ends, in any order.

        Raises
        ------
        ExecutorError
            The workers cannot be started, or have ended.
        """
        for ageings in by_contact(
            tasks
        ):  # in an order in which successive contacts share a surface
            self._divide(ageings)
        reported = 0.0
        try:
            while self._ready or self._contacts or self._running or self._suspects:
                self._submit()
                finished, _ = wait(
                    self._running, timeout=0.5, return_when=FIRST_COMPLETED
                )
                for future in finished:
                    self._settle(self._running.pop(future), future, told)
                if not finished and self._pool.lost:
                    raise ExecutorError(_GONE)
                now = time.perf_counter()
                if self._watch is not None and now > reported + PERIOD:
                    reported = now
                    self._watch(self)
            if self._watch is not None:
                self._watch(self)
        except BaseException:
            # first: a pool that ends gives its tasks an error, which one that was cancelled does not take
            self._pool.abort()
            for future in self._running:
                future.cancel()
            self._running.clear()
            raise

    def remaining(self) -> float | None:
        """Estimated wall time of what is left, s; None before the first piece has ended."""
        if not self._ended:
            return None
        waiting = chain(self._ready, *self._contacts, *self._behind.values())
        begun = chain(self._running.values(), self._suspects)
        weights = [piece.weight for piece in waiting]
        weights += [piece.weight / 2 for piece in begun]
        each = self._seconds / self._ended / max(1, self.width)
        total = sum(weights)
        if math.isfinite(self._weight + total) and self._weight > 0:
            return each * total * self._ended / self._weight
        return each * len(weights)

    # -- pieces -------------------------------------------------------------------------------------------------------

    def _divide(self, ageings: list[list[Task]]) -> None:
        """Divide the tasks of a contact into pieces."""
        first = ageings[0][0]
        if self._whole is None:
            ageings = self._joined(ageings)
        pieces = [
            Piece(tasks, False, ageing_seconds(tasks) + 1e-3) for tasks in ageings
        ]
        if self._is_there(first):
            self._ready.extend(pieces)
            return
        pieces[0].solves = True
        pieces[0].weight += first.contact_seconds
        self._contacts.append(pieces)

    def _is_there(self, task: Task) -> bool:
        """Whether the contact of a task is in the folder."""
        return (
            self._whole is not None
            and self._whole.contact_state(task.contact) == "done"
        )

    def _joined(self, ageings: list[list[Task]]) -> list[list[Task]]:
        """Ageings of a contact that is not kept, in so many pieces as it pays to solve the contact for."""
        contact = ageings[0][0].contact_seconds
        total = sum(ageing_seconds(tasks) + 1e-3 for tasks in ageings)
        count = len(ageings)
        if math.isfinite(contact + total):
            worth = math.ceil(total / max(contact, 1e-9))
            count = max(1, min(count, 4 * self.width, worth))
        edges = [k * len(ageings) // count for k in range(count + 1)]
        return [list(chain(*ageings[begin:end])) for begin, end in pairwise(edges)]

    def _submit(self) -> None:
        width, running = self.width, self._running.values()
        if self._suspects and not (running or self._ready or self._contacts):
            piece = self._suspects.popleft()
            piece.alone = True
            self._start(piece)
        while (
            len(running) < width
            and self._fits()
            and not any(piece.alone for piece in running)
        ):
            # pieces whose contact is there come first, while a worker still has it in memory; but half of the workers
            # solve contacts, so that the last contact does not begin after everything else has ended
            solving = sum(piece.solves for piece in running)
            if self._contacts and (not self._ready or solving < width // 2):
                piece, *behind = self._contacts.popleft()
                self._behind[piece.tasks[0].contact] = behind
            elif self._ready:
                piece = self._ready.popleft()
            else:
                break
            self._start(piece)

    def _fits(self) -> bool:
        """Whether the memory of this machine holds one more piece like those that run."""
        sizes = [
            max(task.bytes for task in piece.tasks)
            for piece in self._running.values()
        ]
        return not sizes or sum(sizes) + max(sizes) <= self._memory

    def _start(self, piece: Piece) -> None:
        remote = self._pool.remote
        tasks = [task.loaded() for task in piece.tasks] if remote else piece.tasks
        try:
            future = self._pool.executor.submit(
                compute, self._place, tasks, self._pool.threads, self._known, remote
            )
        except Exception as error:
            if self._pool.lost:
                raise ExecutorError(_GONE) from error
            raise
        self._running[future] = piece

    # -- what comes of them -------------------------------------------------------------------------------------------

    def _settle(self, piece: Piece, future: Future[Answer], told: Told) -> None:
        try:
            seconds, outcomes = future.result()
        except Exception as error:
            lost = self._death(error)
            piece.deaths += piece.alone
            if piece.deaths <= (RETRIES if piece.alone else 0):
                # perhaps it only ran beside the piece that killed the worker
                self._suspects.append(piece)
                return
            there = not piece.solves or self._is_there(piece.tasks[0])
            outcome = Outcome(error=lost, stage="ageing" if there else "contact")
            self._fail(piece.tasks, outcome, told)
        else:
            self._seconds += seconds
            self._weight += piece.weight
            self._ended += 1
            for task in piece.tasks:
                told(task, outcomes[task.key])
            outcome = outcomes[piece.tasks[0].key]
        if piece.solves:
            # let those begin that waited for the contact; if it cannot be solved, they fail as well
            behind = self._behind.pop(piece.tasks[0].contact)
            if outcome.error is None or outcome.stage != "contact":
                self._ready.extend(behind)
            for other in behind if outcome.stage == "contact" else ():
                self._fail(other.tasks, outcome, told)

    def _death(self, error: Exception) -> WorkerLost:
        """The death of a worker, as the executor reports it; any other error is raised."""
        if isinstance(error, WorkerLost):
            return error
        if type(error).__name__ == "KilledWorker":  # of Dask
            return WorkerLost(str(error))
        own = isinstance(self._pool.executor, Processes)
        if isinstance(error, BrokenProcessPool) and own:
            codes = re.findall(r"[A-Z]+\(-?[1-9]\d*\)", str(error))
            if codes or self._ended:
                status = ", ".join(codes) or "exit status 0"
                return WorkerLost(
                    f"the worker process died at this task: {status} (SIGKILL: most often, memory ran out)"
                )
            reason = "a worker process could not start; its own message is above"
        elif isinstance(error, CancelledError):
            reason = "the executor dropped a task: its scheduler is gone, or it was shut down"
        elif isinstance(error, BrokenExecutor):
            reason = f"the executor gave up ({type(error).__name__}: {error})"
        elif isinstance(error, ExecutorError):
            reason = str(error)
        else:
            raise error
        raise ExecutorError(f"{reason}; {RESUME}") from error

    def _fail(self, tasks: Sequence[Task], outcome: Outcome, told: Told) -> None:
        """Tell, and write, that tasks failed, which no worker could."""
        assert outcome.error is not None
        for task in tasks:
            if self._whole is not None:
                content = failure(task, outcome.stage, outcome.error)
                self._whole.write_point(task.key, content)
            told(task, outcome)
