"""Tasks on a Dask cluster: a running one, a new one on this machine, or one described by a file."""

from __future__ import annotations

import importlib
import logging
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ChemageError, ExecutorError, InputError, StoreError, WorkerLost
from chemage.foundation.inputs import check_data, described
from chemage.foundation.messages import nearest
from chemage.sweeps.executors.pool import Pool, shares
from chemage.sweeps.executors.processes import RETRIES
from chemage.sweeps.folder import RESUME

#: longest time that a Dask cluster started on this machine may be without a worker, s; elsewhere workers may be queued
PATIENCE = 120.0
#: time to wait for a Dask scheduler, s
ANSWER_TIME = 4.0


#: the scheduler, its pages and its workers can be reached from this machine alone
_LOCAL_ONLY = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
#: classes of clusters on this machine, to which that applies unless their options say otherwise
_LOCAL = frozenset({"distributed.LocalCluster", "dask.distributed.LocalCluster", "dask_cuda.LocalCUDACluster"})
#: what cluster files may name; others only if the environment variable below lists them
KNOWN_CLUSTERS = _LOCAL | {
    "distributed.SSHCluster",
    "dask.distributed.SSHCluster",
    *(f"dask_jobqueue.{name}Cluster" for name in ("HTCondor", "LSF", "Moab", "OAR", "PBS", "SGE", "SLURM")),
    "dask_gateway.GatewayCluster",
    "dask_kubernetes.operator.KubeCluster",
    "dask_yarn.YarnCluster",
    *(f"dask_cloudprovider.{name}" for name in ("aws.EC2Cluster", "aws.FargateCluster", "azure.AzureVMCluster")),
    *(f"dask_cloudprovider.{name}" for name in ("gcp.GCPCluster", "openstack.OpenStackCluster")),
}
ALLOWED_CLUSTERS = "CHEMAGE_CLUSTERS"


class Dask(Executor):
    """Tasks on the workers of a ``distributed.Client``. Dask tries a task again when its worker dies.

    Parameters
    ----------
    client
        The ``distributed.Client``.
    wanted
        Number of workers to keep running on a cluster started here; 0 for any other cluster.
    """

    def __init__(self, client: Any, wanted: int = 0) -> None:
        self._client, self._wanted = client, wanted
        self._inner = client.get_executor(pure=False)
        self._known = (0.0, 1)
        self._alive, self._revived = time.monotonic(), 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a task; :class:`chemage.WorkerLost` is raised by its future if its workers died."""
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
        """Present number of threads of all workers, at least 1; updated every second.

        Raises
        ------
        ExecutorError
            A cluster started here has had no worker for ``PATIENCE`` seconds, so that tasks would wait for ever.
        """
        when, width = self._known
        now = time.monotonic()
        if now > when + 1:
            found = None
            # no answer: the scheduler is busy, or gone, in which case its tasks fail
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
        """Start other workers: Dask does not replace a worker that dies while it starts."""
        if seconds > PATIENCE:
            raise ExecutorError(f"the Dask cluster has had no worker for {seconds:.0f} s; look at its logs; {RESUME}")
        if seconds > 10 * (self._revived + 1):
            self._revived += 1
            cluster = self._client.cluster
            with suppress(Exception):
                cluster.scale(len(cluster.worker_spec) + self._wanted)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut the executor down; the cluster stays."""
        self._inner.shutdown(wait=wait and not cancel_futures)


def _at(error: Any) -> str:
    worker = getattr(error, "last_worker", None)
    return f"was at {getattr(worker, 'address', worker)}"


@contextmanager
def open_cluster(detail: str, workers: int | None, threads: int | None) -> Iterator[Pool]:
    """Connect to the Dask cluster that ``detail`` names, or start it, for the duration of a block.

    ``detail`` is what follows ``dask:``; the arguments and errors are those of
    :func:`chemage.sweeps.executors.opening.open_pool`.
    """
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
    # Dask sets "pre-spawn" variables, which libraries read at import, in this process as well; numba would then refuse
    # to compile here, so that its variables are set in the workers only
    early = thread_budget.environment(each)
    late = {name: early.pop(name) for name in ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS")}
    settings: dict[str, Any] = {
        "distributed.scheduler.allowed-failures": RETRIES,
        **{
            name: {**dask_config.get(name, {}), **values}
            for name, values in (("distributed.nanny.pre-spawn-environ", early), ("distributed.nanny.environ", late))
        },
    }
    # for the lifetime of the cluster, which starts workers later when it grows or when a worker died
    with dask_config.set(settings), _quiet(), _connected(distributed, where) as client:
        pool = Dask(client, where.workers or 1 if where.local else 0)
        try:
            yield Pool(pool, "dask", each, pool.width, blames_one=False)
        finally:
            with suppress(Exception):
                pool.shutdown(wait=False)


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the tracebacks that Dask logs when a worker or the scheduler is lost; chemage raises its own errors."""
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
        **_LOCAL_ONLY,
        "silence_logs": logging.CRITICAL,
        # Ctrl-C on the terminal is handled by this process; the workers end with the cluster
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
    """The cluster that the text after ``dask:`` names."""

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
        allowed = filter(None, (name.strip() for name in os.environ.get(ALLOWED_CLUSTERS, "").split(",")))
        if data["cluster"] not in KNOWN_CLUSTERS.union(allowed):
            raise InputError(
                f"{path}: cluster = {data['cluster']!r}: not a known class of clusters"
                f"{nearest(data['cluster'], sorted(KNOWN_CLUSTERS))}; if you trust it, allow it with "
                f"{ALLOWED_CLUSTERS}={data['cluster']}, or name it on the command line (dask:{data['cluster']})"
            )
        return cls(
            cluster=data["cluster"],
            local=False,
            workers=workers or data.get("workers"),
            adapt=data.get("adapt"),
            options=data.get("options", {}),
        )

    def start(self) -> Any:
        """Start the cluster and request its workers."""
        module, _, name = self.cluster.rpartition(".")
        try:
            make = getattr(importlib.import_module(module or "builtins"), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise ExecutorError(
                f"dask:{self.cluster} cannot be imported ({error}); give an address such as tcp://host:8786, a file "
                "such as cluster.toml, or the dotted path of a cluster class such as dask_jobqueue.SLURMCluster"
            ) from None
        options = {**_LOCAL_ONLY, **self.options} if self.cluster in _LOCAL else self.options
        try:
            cluster = make(**options)
            if not self.local and self.adapt is not None:
                cluster.adapt(**self.adapt)
            elif not self.local and self.workers is not None:
                cluster.scale(self.workers)
        except ChemageError:
            raise
        except Exception as error:
            guard = "; in a script, start it below `if __name__ == '__main__':`"
            hint = guard if "failed to start" in str(error) else ""
            raise ExecutorError(
                f"the Dask cluster {self.cluster} did not start: {type(error).__name__}: {error}{hint}"
            ) from error
        return cluster


def _configuration(path: Path) -> dict[str, Any]:
    try:
        text = described(path)
    except StoreError as error:
        raise StoreError(f"the cluster file cannot be read: {error}") from None
    try:
        if path.suffix == ".toml":
            import tomllib

            data: Any = tomllib.loads(text)
        else:
            import yaml  # comes with Dask

            data = yaml.safe_load(text)
    except Exception as error:
        raise InputError(f"the cluster file {path} cannot be read: {error}") from None
    check_data(data)
    if not isinstance(data, dict):
        raise InputError(f"the cluster file {path} holds a {type(data).__name__}; expected a table of names and values")
    return data
