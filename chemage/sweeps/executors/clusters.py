"""Tasks on a Dask cluster: one that runs, one to start here, or one that a file describes."""

from __future__ import annotations

import importlib
import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ChemageError, ExecutorError, InputError, StoreError, WorkerLost
from chemage.foundation.messages import nearest
from chemage.sweeps.executors.pool import Pool, shares
from chemage.sweeps.executors.processes import RETRIES

#: seconds a Dask cluster that we started on this machine may be without any worker; others may stand in a queue
PATIENCE = 120.0
#: seconds to wait for a Dask scheduler
ANSWER_TIME = 4.0


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
def open_cluster(detail: str, workers: int | None, threads: int | None) -> Iterator[Pool]:
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
        count, each = shares(where.workers, threads)
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
