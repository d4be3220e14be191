"""Opens the executor of a study, named by a word such as ``"processes"`` or ``"dask:tcp://host:8786"``.

All executors have the interface of ``concurrent.futures.Executor``, and results are the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import InputError
from chemage.foundation.messages import nearest
from chemage.studies.executors.clusters import open_cluster, seconds
from chemage.studies.executors.pool import Pool, Serial, Threads, shares
from chemage.studies.executors.processes import Processes

NAMES = ("serial", "threads", "processes", "dask")


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
        with open_cluster(detail, workers, threads, limit) as cluster:
            yield cluster


def _check_count(name: str, value: int | None) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
        raise InputError.of(name, value, "must be a whole number of at least 1")
