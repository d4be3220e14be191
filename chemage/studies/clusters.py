"""Connects to a Dask cluster: a running one, or a new one on this machine.

A Dask scheduler queues tasks and waits for the jobs of its workers. Clusters of many machines are started by
`dask-jobqueue <https://jobqueue.dask.org>`_ or by hand, see docs/clusters.md.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ExecutorError, InputError, StoreError
from chemage.foundation.units import convert

#: time to wait for a Dask scheduler, s
ANSWER_TIME = 4.0
#: loggers that show a traceback when a worker or the scheduler is lost
_LOGGERS = ("distributed.client", "distributed.utils", "tornado.application", "asyncio")
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
    late = {name: early.pop(name) for name in ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS")}
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
