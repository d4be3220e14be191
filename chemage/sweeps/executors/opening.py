"""The pools that a sweep can compute on, behind ``concurrent.futures.Executor``.

:func:`open_pool` makes any of them from a word such as ``"processes"`` or ``"dask:tcp://host:8786"``. What is computed,
and every bit of it, is the same on all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import InputError
from chemage.foundation.messages import nearest
from chemage.sweeps.executors.clusters import open_cluster
from chemage.sweeps.executors.pool import Pool, Serial, shares
from chemage.sweeps.executors.processes import Processes

NAMES = ("serial", "processes", "dask")


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
        workers, threads = shares(workers, threads)
        with Processes(workers, threads) as processes:
            yield Pool(processes, name, threads, lambda: workers, processes.abort)
    else:
        with open_cluster(detail, workers, threads) as cluster:
            yield cluster


def _check_count(name: str, value: int | None) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
        raise InputError.of(name, value, "must be a whole number of at least 1")
