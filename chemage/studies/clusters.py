"""Tasks on a Dask cluster: a running one, a new one on this machine, or one described by a file."""

from __future__ import annotations

import asyncio
import importlib
import logging
import os
import re
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from chemage.foundation import threads as thread_budget
from chemage.foundation.errors import ChemageError, ExecutorError, InputError, StoreError, WorkerLost, explain, nearest
from chemage.foundation.files import check_data, described
from chemage.foundation.units import convert
from chemage.studies.folder import RESUME, SweepWarning
from chemage.studies.tasks import RETRIES

#: longest time that a Dask cluster started on this machine may be without a worker, s; elsewhere workers may be queued
PATIENCE = 120.0
#: time without a worker after which a warning says so where there is no limit, s
SILENCE = 60.0
#: longest time that submitting the first jobs may take, s: sbatch does not return while its server does not answer
SUBMIT_TIME = 60.0
#: time to wait for a Dask scheduler, s
ANSWER_TIME = 4.0

#: the scheduler, its pages and its workers can be reached from this machine alone
LOCAL_ONLY = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
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
#: loggers that show a traceback when a worker or the scheduler is lost, or a job cannot be submitted
_LOGGERS = ("distributed.client", "distributed.utils", "tornado.application", "asyncio")


class Dask(Executor):
    """Tasks on the workers of a ``distributed.Client``. Dask tries a task again when its worker dies.

    Parameters
    ----------
    client
        The ``distributed.Client``.
    patience
        Longest time without a worker, s; None for no limit.
    """

    def __init__(self, client: Any, patience: float | None = None) -> None:
        self._client, self._patience, self._warned = client, patience, False
        self._inner = client.get_executor(pure=False)
        #: when the number of workers was asked for, the number, and when there was one
        self._asked, self._width, self._alive = 0.0, 1, time.monotonic()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a task; :class:`chemage.plugin.WorkerLost` is raised by its future if its workers died."""
        from distributed.scheduler import KilledWorker

        outer: Future[Any] = Future()
        outer.set_running_or_notify_cancel()

        def finished(inner: Future[Any]) -> None:
            error = None if inner.cancelled() else inner.exception()
            if inner.cancelled():
                error = ExecutorError("the Dask scheduler is gone, or has dropped the task")
            elif isinstance(error, KilledWorker):
                at = getattr(error.last_worker, "address", error.last_worker)
                count = error.allowed_failures + 1
                error = WorkerLost(f"{count} Dask workers died at this task; the last was at {at}")
            if error is not None:
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
            The cluster has had no worker for longer than the given time, so that tasks would wait for ever.
        """
        now = time.monotonic()
        if now > self._asked + 1:
            self._asked, count = now, None
            # no answer: the scheduler is busy, or gone (a client without one fails as it happens to), in which case its
            # tasks fail
            with suppress(OSError, RuntimeError, AttributeError):
                count = sum(self._client.nthreads().values())
                self._width = max(1, count)
            if count:
                self._alive = now
            elif count == 0:
                self._check_alive(now - self._alive)
        return self._width

    def _check_alive(self, seconds: float) -> None:
        if self._patience is not None and seconds > self._patience:
            raise ExecutorError(
                f"the Dask cluster has had no worker for {seconds:.0f} s: its jobs have not started, or have ended; "
                f"look at its queue and its logs, or wait longer with --patience; {RESUME}"
            )
        if self._patience is None and seconds > SILENCE and not self._warned:
            self._warned = True
            warnings.warn(
                f"the Dask cluster has had no worker for {seconds:.0f} s: its jobs may be queued; waiting for them, "
                "without limit (--patience sets one)",
                SweepWarning,
                stacklevel=2,
            )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut the executor down; the cluster stays."""
        self._inner.shutdown(wait=wait and not cancel_futures)


@contextmanager
def open_cluster(detail: str, workers: int | None, threads: int, patience: float | None = None) -> Iterator[Dask]:
    """Connect to the Dask cluster that ``detail`` names, or start it, for the duration of a block.

    ``detail`` is what follows ``dask:``; the arguments and errors are those of
    :func:`chemage.studies.runner.open_pool`.
    """
    try:
        import dask.config as dask_config
        import distributed
    except ImportError as error:
        raise ExecutorError(
            f"executor dask needs Dask, which is not installed ({error}): pip install 'chemage[dask]'"
        ) from None
    where = Cluster.read(detail, workers)
    # Dask sets "pre-spawn" variables, which libraries read at import, in this process as well; numba would then refuse
    # to compile here, so that its variables are set in the workers only
    early = thread_budget.environment(threads)
    late = {name: early.pop(name) for name in ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS")}
    settings: dict[str, Any] = {
        "distributed.scheduler.allowed-failures": RETRIES,
        **{
            name: {**dask_config.get(name, {}), **values}
            for name, values in (("distributed.nanny.pre-spawn-environ", early), ("distributed.nanny.environ", late))
        },
    }
    # for the lifetime of the cluster, which starts workers later when it grows or when a worker died
    with dask_config.set(settings), _quiet(), where.connected(distributed) as client:
        executor = Dask(client, where.patience if patience is None else patience)
        try:
            yield executor
        finally:
            with suppress(Exception):
                executor.shutdown(wait=False)


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


class Cluster(BaseModel):
    """The cluster that the text after ``dask:`` names; its fields are the entries of a cluster file."""

    model_config = ConfigDict(strict=True, extra="forbid")
    address: str = ""
    #: dotted path of a class
    cluster: str = ""
    workers: int | None = None
    adapt: dict[str, Any] | None = None
    #: longest time without a worker, s
    patience: float | None = None
    options: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def read(cls, detail: str, workers: int | None) -> Self:
        """That of an address, a class, a file, or "" for a new one on this machine.

        Raises
        ------
        InputError
            A file has an entry that is not valid, or names a class that is not known.
        """
        if not detail:
            options = {
                "n_workers": workers,
                "threads_per_worker": 1,
                "processes": True,
                "silence_logs": logging.CRITICAL,
                # Ctrl-C on the terminal is handled by this process; the workers end with the cluster
                "preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
            }
            # Dask itself does not replace a worker that dies while it starts
            adapt = {"minimum": workers, "maximum": workers}
            return cls(cluster="distributed.LocalCluster", options=options, adapt=adapt, patience=PATIENCE)
        if "://" in detail or detail.rpartition(":")[2].isdigit() or detail.endswith(".json"):
            return cls(address=detail)
        if not detail.endswith((".toml", ".yaml", ".yml")):
            return cls(cluster=detail, workers=workers)
        where = cls._from_file(Path(detail))
        return where.model_copy(update={"workers": workers or where.workers})

    @classmethod
    def _from_file(cls, path: Path) -> Self:
        data = _configuration(path)
        for name in data:
            if name not in cls.model_fields:
                entries = list(cls.model_fields)
                raise InputError(f"{path}: {name}: no such entry{nearest(name, entries)}; known: {', '.join(entries)}")
        if ("address" in data) == ("cluster" in data):
            raise InputError(f'{path}: give either address = "tcp://..." or cluster = "package.Class"')
        if "patience" in data:
            data["patience"] = seconds(data["patience"])
        try:
            where = cls.model_validate(data)
        except ValidationError as error:
            raise InputError(f"{path}: " + "; ".join(": ".join(problem) for problem in explain(error))) from None
        allowed = filter(None, (name.strip() for name in os.environ.get(ALLOWED_CLUSTERS, "").split(",")))
        if where.cluster and where.cluster not in KNOWN_CLUSTERS.union(allowed):
            raise InputError(
                f"{path}: cluster = {where.cluster!r}: not a known class of clusters"
                f"{nearest(where.cluster, sorted(KNOWN_CLUSTERS))}; if you trust it, allow it with "
                f"{ALLOWED_CLUSTERS}={where.cluster}, or name it on the command line (dask:{where.cluster})"
            )
        return where

    @contextmanager
    def connected(self, distributed: Any) -> Iterator[Any]:
        """A client of this cluster, which is started and ended with the block unless it has an address."""
        cluster = None if self.address else self._started()
        try:
            client = _connect(distributed, self.address or cluster)
            try:
                yield client
            finally:
                with suppress(Exception):
                    client.close(timeout=5)
        finally:
            if cluster is not None:
                with suppress(Exception):
                    cluster.close(timeout=10)

    def _started(self) -> Any:
        module, _, name = self.cluster.rpartition(".")
        try:
            make = getattr(importlib.import_module(module or "builtins"), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise ExecutorError(
                f"dask:{self.cluster} cannot be imported ({error}); give an address such as tcp://host:8786, a file "
                "such as cluster.toml, or the dotted path of a cluster class such as dask_jobqueue.SLURMCluster"
            ) from None
        cluster = None
        try:
            cluster = make(**{**(LOCAL_ONLY if self.cluster in _LOCAL else {}), **self.options})
            self._request(cluster)
            return cluster
        except BaseException as error:
            if cluster is not None:
                _abandon(cluster)
            if isinstance(error, ChemageError) or not isinstance(error, Exception):
                raise
            guard = "; in a script, start it below `if __name__ == '__main__':`"
            raise ExecutorError(
                f"the Dask cluster {self.cluster} did not start: {_reason(error)}"
                f"{guard if 'failed to start' in str(error) else ''}"
            ) from error

    def _request(self, cluster: Any) -> None:
        """Request workers, and wait until the first request has been accepted."""
        if self.adapt is not None:
            _scale(cluster, max(1, int(self.adapt.get("minimum", 0))))
            cluster.adapt(**self.adapt)
        elif self.workers is not None:
            _scale(cluster, self.workers)
        elif getattr(cluster, "worker_spec", None) == {}:
            raise InputError(
                f"the cluster {self.cluster} starts without workers; say how many: --workers, or workers or adapt in "
                "its file"
            )


def _scale(cluster: Any, count: int) -> None:
    """Request ``count`` workers. ``cluster.scale`` returns before jobs are submitted, and nobody receives the error if
    that fails; therefore the same is done in the cluster's own event loop, and waited for."""
    begun = getattr(cluster, "_correct_state", None)
    if begun is None:
        cluster.scale(count)
        return

    async def request() -> None:
        cluster.scale(count)
        await asyncio.wait_for(asyncio.shield(begun()), SUBMIT_TIME)

    try:
        cluster.sync(request)
    except TimeoutError:
        raise ExecutorError(
            f"submitting jobs has taken more than {SUBMIT_TIME:.0f} s; check that the scheduler of the cluster answers"
        ) from None
    except Exception as error:
        raise ExecutorError(f"jobs cannot be submitted: {_reason(error)}") from error


def _abandon(cluster: Any) -> None:
    """Close a cluster of which jobs could not be submitted."""
    from distributed.core import Status

    for job in getattr(cluster, "_created", ()):
        if getattr(job, "status", None) == Status.created:
            job.status = Status.closed  # it never began; Dask would wait for its end
    try:
        cluster.close(timeout=5)
    except Exception:
        with suppress(AttributeError):
            cluster.shutdown_on_close = False  # else Dask tries again for ten seconds when this process ends


def _reason(error: Exception) -> str:
    """An error in one line."""
    if isinstance(error, FileNotFoundError):
        return (
            f"the program {error.filename} is not on the PATH: run this on a login node of the cluster, or load the "
            "module of its scheduler; without a scheduler use --executor processes"
        )
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _connect(distributed: Any, target: Any) -> Any:
    shown = target if isinstance(target, str) else "the cluster that was started"
    file = isinstance(target, str) and target.endswith(".json")
    if file and not Path(target).is_file():
        raise StoreError(f"the Dask scheduler file {target} does not exist")
    if "://" in shown and not re.search(r"[^/:]:\d+/?$", shown):
        raise InputError.of("executor", f"dask:{shown}", "has no host and port", "write it as dask:tcp://host:8786")
    options = {"scheduler_file" if file else "address": target}
    try:
        return distributed.Client(**options, timeout=ANSWER_TIME, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).split("\n")[0] or type(error).__name__
        raise ExecutorError(
            f"no Dask scheduler answers at {shown} within {ANSWER_TIME:g} s ({reason}); check the address, and that "
            "`dask scheduler` runs there"
        ) from None


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
