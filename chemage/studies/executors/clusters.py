"""Tasks on a Dask cluster: a running one, a new one on this machine, or one described by a file."""

from __future__ import annotations

import asyncio
import importlib
import logging
import os
import re
import shlex
import shutil
import time
import warnings
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
from chemage.foundation.units import convert
from chemage.studies.executors.pool import RETRIES, Pool, shares
from chemage.studies.folder import RESUME, SweepWarning

#: longest time that a Dask cluster started on this machine may be without a worker, s; elsewhere workers may be queued
PATIENCE = 120.0
#: time without a worker after which a warning says so where there is no limit, s
SILENCE = 60.0
#: longest time that submitting the first jobs may take, s: sbatch does not return while its server does not answer
SUBMIT_TIME = 60.0
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
#: how dask-jobqueue reports a program that failed
_FAILED_COMMAND = re.compile(
    r"Exit code: *(?P<code>-?\d+)\s*Command:\s*(?P<command>.*?)\s*stdout:(?P<stdout>.*?)stderr:(?P<stderr>.*)",
    re.DOTALL,
)


class Dask(Executor):
    """Tasks on the workers of a ``distributed.Client``. Dask tries a task again when its worker dies.

    Parameters
    ----------
    client
        The ``distributed.Client``.
    wanted
        Number of workers to keep running on a cluster started on this machine; 0 for any other cluster.
    patience
        Longest time without a worker, s; None for no limit.
    log
        What libraries have reported since the cluster was opened.
    """

    def __init__(self, client: Any, wanted: int = 0, patience: float | None = None, log: _Log | None = None) -> None:
        self._client, self._wanted = client, wanted
        self._patience = PATIENCE if patience is None and wanted else patience
        self._log, self._warned = log, False
        self._inner = client.get_executor(pure=False)
        self._known = (0.0, 1)
        self._alive, self._revived = time.monotonic(), 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a task; :class:`chemage.plugin.WorkerLost` is raised by its future if its workers died."""
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
            The cluster has had no worker for longer than the given time, or its jobs cannot be submitted, so that tasks
            would wait for ever.
        """
        when, width = self._known
        now = time.monotonic()
        if now > when + 1:
            found = None
            # no answer: the scheduler is busy, or gone (a client without one fails as it happens to), in which case its
            # tasks fail
            with suppress(OSError, RuntimeError, AttributeError):
                found = sum(self._client.nthreads().values())
                width = max(1, found)
            if found:
                self._alive, self._revived = now, 0
            elif found == 0:
                self._without_workers(now - self._alive)
            self._known = (now, width)
        return width

    def _without_workers(self, seconds: float) -> None:
        if self._log is not None and self._log.error is not None:
            raise ExecutorError(f"the Dask cluster has no worker: {_reason(self._log.error)}; {RESUME}")
        if self._patience is not None and seconds > self._patience:
            raise ExecutorError(
                f"the Dask cluster has had no worker for {seconds:.0f} s: its jobs have not started, or have ended; "
                f"look at its queue and its logs, or wait longer with --patience; {RESUME}"
            )
        if self._wanted and seconds > 10 * (self._revived + 1):
            # Dask does not replace a worker that dies while it starts
            self._revived += 1
            cluster = self._client.cluster
            with suppress(Exception):
                cluster.scale(len(cluster.worker_spec) + self._wanted)
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


def _at(error: Any) -> str:
    worker = getattr(error, "last_worker", None)
    return f"was at {getattr(worker, 'address', worker)}"


@contextmanager
def open_cluster(
    detail: str, workers: int | None, threads: int | None, patience: float | None = None
) -> Iterator[Pool]:
    """Connect to the Dask cluster that ``detail`` names, or start it, for the duration of a block.

    ``detail`` is what follows ``dask:``; the arguments and errors are those of
    :func:`chemage.studies.executors.opening.open_pool`.
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
    with dask_config.set(settings), _quiet() as log, _connected(distributed, where) as client:
        limit = where.patience if patience is None else patience
        pool = Dask(client, where.workers or 1 if where.local else 0, limit, log)
        try:
            yield Pool(pool, "dask", each, pool.width, here=False)
        finally:
            with suppress(Exception):
                pool.shutdown(wait=False)


class _Log(logging.Filter):
    """Keeps the last error of a background task of Dask, in place of the traceback that would be shown."""

    def __init__(self) -> None:
        super().__init__()
        self.error: BaseException | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is shown."""
        error = record.exc_info[1] if record.exc_info else None
        if error is None or not _of_dask(error):
            return True
        if isinstance(error, OSError | RuntimeError | ValueError):
            self.error = error
        return False


def _of_dask(error: BaseException) -> bool:
    trace = error.__traceback__
    while trace is not None:
        if str(trace.tb_frame.f_globals.get("__name__", "")).startswith(("distributed.deploy.", "dask_jobqueue.")):
            return True
        trace = trace.tb_next
    return False


@contextmanager
def _quiet() -> Iterator[_Log]:
    """Suppress the tracebacks that Dask logs when a worker or the scheduler is lost; chemage raises its own errors."""
    logger, log = logging.getLogger("distributed.client"), _Log()
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    others = [logging.getLogger(name) for name in ("asyncio", "tornado.application", "distributed.utils")]
    for other in others:
        other.addFilter(log)
    try:
        yield log
    finally:
        logger.setLevel(before)
        for other in others:
            other.removeFilter(log)


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
    if "://" in shown and not re.search(r"[^/:]:\d+/?$", shown):
        raise InputError.of("executor", f"dask:{shown}", "has no host and port", "write it as dask:tcp://host:8786")
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
    #: longest time without a worker, s
    patience: float | None = None
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
        known = ("address", "cluster", "workers", "adapt", "patience", "options")
        data = _configuration(path)
        for name in data:
            if name not in known:
                raise InputError(f"{path}: {name}: no such entry{nearest(name, known)}; known: {', '.join(known)}")
        if ("address" in data) == ("cluster" in data):
            raise InputError(f'{path}: give either address = "tcp://..." or cluster = "package.Class"')
        for name, kind in (("address", str), ("cluster", str), ("workers", int), ("adapt", dict), ("options", dict)):
            if name in data and not isinstance(data[name], kind):
                raise InputError(f"{path}: {name} = {data[name]!r}: expected a {kind.__name__}")
        patience = seconds(data["patience"]) if "patience" in data else None
        if "address" in data:
            return cls(address=data["address"], local=False, patience=patience)
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
            patience=patience,
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
        _check_command(make, self.cluster)
        options = {**_LOCAL_ONLY, **self.options} if self.cluster in _LOCAL else self.options
        try:
            cluster = make(**options)
        except ChemageError:
            raise
        except Exception as error:
            guard = "; in a script, start it below `if __name__ == '__main__':`"
            hint = guard if "failed to start" in str(error) else ""
            raise ExecutorError(
                f"the Dask cluster {self.cluster} did not start: {type(error).__name__}: {error}{hint}"
            ) from error
        try:
            if not self.local:
                self._request(cluster)
        except BaseException as error:
            _abandon(cluster)
            if isinstance(error, ChemageError) or not isinstance(error, Exception):
                raise
            raise ExecutorError(
                f"the Dask cluster {self.cluster} did not start: {type(error).__name__}: {_reason(error)}"
            ) from error
        return cluster

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


def _check_command(make: Any, name: str) -> None:
    """Raise if the program that submits jobs, such as sbatch, is not there."""
    command = getattr(getattr(make, "job_cls", None), "submit_command", None)
    program = shlex.split(command)[0] if isinstance(command, str) and command.strip() else ""
    if program and shutil.which(program) is None:
        raise ExecutorError(
            f"the program {program}, which {name.rpartition('.')[2]} needs to submit jobs, is not on the PATH: run "
            "this on a login node of the cluster, or load the module of its scheduler; without a scheduler use "
            "--executor processes"
        )


def _scale(cluster: Any, count: int) -> None:
    """Request ``count`` workers.

    ``cluster.scale`` returns before jobs are submitted, and nobody receives the error if that fails; therefore the same
    is done here in the cluster's own event loop, and waited for.
    """
    correct = getattr(cluster, "_correct_state", None)
    if correct is None or not hasattr(cluster, "sync"):
        cluster.scale(count)
        return

    async def request() -> None:
        cluster.scale(count)
        await asyncio.wait_for(asyncio.shield(correct()), SUBMIT_TIME)

    try:
        cluster.sync(request)
    except TimeoutError:
        raise ExecutorError(
            f"submitting jobs has taken more than {SUBMIT_TIME:.0f} s; check that the scheduler of the cluster answers"
        ) from None
    except Exception as error:
        raise ExecutorError(f"jobs cannot be submitted: {_reason(error)}") from error


def _reason(error: BaseException) -> str:
    """An error in one line; of a program that failed what it wrote to stderr."""
    if isinstance(error, FileNotFoundError):
        return f"{error.filename} is not on the PATH, or is not there"
    text = str(error) or type(error).__name__
    if (found := _FAILED_COMMAND.search(text)) is not None:
        program = (found["command"].split() or ["the command"])[0]
        said = " ".join((found["stderr"].strip() or found["stdout"].strip() or "no message").split())
        return f"{program} ended with exit status {found['code']}: {said}"
    return " ".join(text.split())


def seconds(value: object) -> float:
    """Read a time to wait: s, or text with its unit.

    Raises
    ------
    InputError
        It is no positive time.
    """
    text = value.strip() if isinstance(value, str) else value
    with suppress(ValueError):
        text = float(text) if isinstance(text, str) else text
    found = convert(text, "s")
    if not found > 0:
        raise InputError.of("patience", value, "must be positive")
    return found


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
