"""A task: one scene to compute, known by the keys of its stages; and its computation, in this process or another.

Where results are kept in a folder, the worker writes them there, and sends back only how long it took and what failed.

Components and plugins that were registered by hand, not installed: how the workers of a sweep come to know them.
"""

from __future__ import annotations

import math
import pickle
import shutil
import sys
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Generic, NamedTuple, Self, TypeVar

from chemage.ageing.ageing import Ageing, elastic_limits
from chemage.contacts.solution import FLOW_MEASURES, MEASURES, ContactSolution
from chemage.foundation import threads as thread_budget
from chemage.foundation.codec import from_json, to_json
from chemage.foundation.errors import (
    ChemageError,
    ExecutorError,
    InputError,
    PluginError,
    StoreError,
)
from chemage.foundation.names import __version__
from chemage.foundation.ownership import Owned, in_words
from chemage.plugins import registry
from chemage.plugins.sources import changed, components_in, stage_hooks
from chemage.scene.files import load_scene
from chemage.scene.plan import Plan, cost
from chemage.scene.provenance import versions
from chemage.scene.run import Run, contact_of, run, run_keys, surface_of
from chemage.scene.scene import Scene
from chemage.studies.folder import CannotWrite, Folder, process_name, refuse_links


class PluginsInUse(NamedTuple):
    """What workers use beside chemage."""

    #: plugins
    installed: registry.InUse
    #: (name, "module:Class") of a component, (name, "module") of a plugin with hooks, which are registered by hand
    by_hand: tuple[tuple[str, str], ...]


def registered_classes(components: Iterable[Any]) -> set[type]:
    """The classes of ``components`` and of their parts that are registered by hand."""
    by_hand = {record.component for record in registry.current().records}
    return {type(part) for part in components_in(list(components))} & by_hand


def for_workers(
    executor: str | Executor, classes: Iterable[type]
) -> PluginsInUse | None:
    """What workers use of plugins and, registered by hand, of ``classes`` and plugins with hooks; None where they have
    the registry of this process.

    Raises
    ------
    InputError
        The executor uses other processes, and they cannot import one of them.
    """
    # forked workers are copies of this process
    context = getattr(executor, "_mp_context", None)
    forked = context is not None and context.get_start_method() == "fork"
    if executor == "serial" or isinstance(executor, ThreadPoolExecutor) or forked:
        return None
    plugins, known = registry.current(), []
    for cls in sorted(classes, key=lambda one: one.__qualname__):
        role, kind = getattr(cls, "role", ""), getattr(cls, "kind", "")
        name, module = cls.__qualname__, cls.__module__
        _check(f"the class {name} ({role} {kind!r})", module, name, cls)
        known.append((name, f"{module}:{name}"))
    answering = plugins.implementing(*stage_hooks())
    for record in plugins.records:
        name, module = record.name, record.module
        if name in answering and not record.distribution:
            _check(f"the plugin {name!r}", module, "", plugins.implementation(name))
            known.append((name, module))
    return PluginsInUse(plugins.installed(), tuple(known))


def _check(what: str, module: str, name: str, expected: Any) -> None:
    """Refuse what no other process can import from ``module``: the module itself, or ``name`` of it."""
    importable = False
    if module != "__main__" and module in sys.modules:
        with suppress(ImportError, ValueError):
            importable = find_spec(module) is not None
    loaded = sys.modules.get(module)
    found = getattr(loaded, name, None) if name else loaded
    if not importable or found is not expected:
        raise InputError(
            f"{what} was registered by hand from {module}, which worker processes cannot import; nothing was computed. "
            "Put it into a module, a .py file on the import path, and register it from there; or compute in this "
            'process (executor="serial")'
        )


def learn(known: PluginsInUse | None) -> None:
    """Use what :func:`for_workers` gave, and no other plugin.

    Raises
    ------
    ExecutorError
        It is not installed here, or cannot be imported.
    """
    if known is None:
        return
    try:
        registry.use_only(known.installed)
    except PluginError as error:
        raise ExecutorError(f"worker {process_name()}: {error}") from None
    plugins = registry.current()
    for name, target in known.by_hand:
        try:
            component: Any = resolve_name(target)
        except (ImportError, AttributeError) as error:
            raise ExecutorError(
                f"a worker cannot import {target} ({error}); the module must be on the import path of every worker"
            ) from None
        records = plugins.records
        if ":" not in target:
            if all(record.component or record.name != name for record in records):
                plugins.register(component, name)
        elif all(record.component is not component for record in records):
            plugins.register_class(component)


T = TypeVar("T")
#: measures of a contact that are the same on every surface and with all settings
GIVEN = {"load", "modulus", "nominal_area", "nominal_pressure"}
#: number of times that a task is tried again after its worker died
RETRIES = 1


@dataclass(frozen=True)
class Task(Owned):
    """One scene to compute."""

    #: content hashes: of everything on which the result depends, and of its stages
    key: str
    ageing: str
    contact: str
    surface: str
    #: the validated scene, or what makes it where there may be very many
    source: Scene | Callable[[], Scene]
    #: by which users know it
    number: int = 0
    #: dotted path -> value, by which it differs from others of the study
    changes: Mapping[str, Any] = field(default_factory=dict)
    #: estimated CPU time, s; nan where a component gives no estimate
    contact_seconds: float = 0.0
    ageing_seconds: float = 0.0
    #: memory that its computation needs, as far as it is known
    bytes: float = 0.0
    #: whether the members of a distribution of barriers are aged as well, see :func:`chemage.run`
    members: bool = True
    #: whether only the contact is solved, because that in the folder is damaged
    contact_only: bool = False

    @classmethod
    def of(
        cls,
        scene: Scene | str | Path | Mapping[str, Any],
        changes: Mapping[str, Any] | None = None,
        costs: Plan | None = None,
        **more: Any,
    ) -> Self:
        """The run of a scene (its object, file, name or data) with ``changes``: dotted path -> value. Its ``costs`` are
        estimated where they are not given.

        Raises
        ------
        InputError
            The scene is not valid, or needs more memory than there is.
        """
        scene = load_scene(scene, changes)
        keys = scene.task_keys()
        if "contact_seconds" not in more:
            costs = costs or cost(scene)
            costs.check()
            estimates = costs.contact_cpu_seconds, costs.kinetics_cpu_seconds
            contact, ageing = (
                math.nan if seconds is None else seconds for seconds in estimates
            )
            size = max(costs.contact_bytes or 0.0, costs.replica_bytes or 0.0)
            more |= {
                "contact_seconds": contact,
                "ageing_seconds": ageing,
                "bytes": size,
            }
        # shares are divided by the numbers of tasks
        more = {
            "number": int(keys["contact"][:8], 16),
            "changes": changes or {},
        } | more
        return cls(
            keys["result"],
            keys["ageing"],
            keys["contact"],
            keys["surface"],
            scene,
            **more,
        )

    @property
    def scene(self) -> Scene:
        """The validated scene."""
        return self.source if isinstance(self.source, Scene) else self.source()

    def loaded(self) -> Self:
        """This task with its scene, as a worker needs it."""
        return replace(self, source=self.scene)

    def outcome(self, worker: Worker) -> Outcome:
        """Compute this task: here a run of its scene. What another design computes has a run as well, and may add
        ``content`` of its own; it names its ``worker.stage``, and finds what is :meth:`Worker.kept`."""
        if self.contact_only:
            worker.contact(self)
            return Outcome()
        return Outcome(worker.run(self))


def by_contact(tasks: Iterable[Task]) -> list[list[list[Task]]]:
    """The tasks of each contact, those with the same ageing together; contacts of one surface follow each other."""
    surfaces: dict[str, dict[str, dict[str, list[Task]]]] = {}
    for task in tasks:
        ageings = surfaces.setdefault(task.surface, {}).setdefault(task.contact, {})
        ageings.setdefault(task.ageing, []).append(task)
    return [
        list(ageings.values())
        for contacts in surfaces.values()
        for ageings in contacts.values()
    ]


def ageing_seconds(tasks: Iterable[Task]) -> float:
    """Estimated CPU time of the ageings of tasks, s; the same ageing counts once."""
    return sum({task.ageing: task.ageing_seconds for task in tasks}.values())


@dataclass(frozen=True)
class Place:
    """The folder in which results are kept, as a worker is told of it."""

    path: str
    #: of the study, which the worker must find there; "": the folder describes none
    digest: str = ""
    #: whether contacts and failures are kept as well, and every file survives a power failure; and the design knows
    #: what is there
    contacts: bool = True
    #: whether a result of another processor is computed again
    processor: bool = False

    @classmethod
    def at(
        cls, path: str | Path | None, *, processor: bool = False
    ) -> Place | None:
        """A folder for the results of single tasks, which are known by their keys; None where none are kept."""
        if path is None:
            return None
        refuse_links(Path(path), "")
        return cls(str(Path(path).absolute()), contacts=False, processor=processor)

    @property
    def folder(self) -> Folder:
        """The folder, after a check that this process sees the same one."""
        return _opened(self.path, self.digest, self.contacts)

    @property
    def whole(self) -> Folder | None:
        """The folder, if contacts and failures are kept there as well."""
        return self.folder if self.contacts else None

    def find(self, task: Task) -> Outcome | None:
        """What came of a task before; None if it is not there, damaged, or of other versions."""
        if self.contacts:
            return None
        content = self.folder.read_point(task.key)
        if content["status"] != "done" or changed(content["plugins"]):
            return None
        recorded = content["summary"]["versions"]
        for name, text in versions(task.scene).items():
            if recorded.get(name, text) != text and (
                name != "processor" or self.processor
            ):
                return None
        return Outcome(content=content, kept=True)

    def read(self, task: Task, outcome: Outcome) -> Outcome:
        """What came of a task, with what is in the folder alone; an error if another version of chemage computed it."""
        if (
            self.contacts
            or outcome.error is not None
            or outcome.content is not None
        ):
            return outcome
        content = self.folder.read_point(task.key)
        if (version := content["summary"]["versions"]["chemage"]) != __version__:
            text = f"a worker has chemage {version}, but the study is run by {__version__}"
            return Outcome(error=ExecutorError(text))
        return Outcome(content=content)

    def tidy(self) -> None:
        """Remove what is needed while results are written."""
        shutil.rmtree(Path(self.path) / ".parts", ignore_errors=True)


@dataclass
class Outcome:
    """How a task ended. What failed has an ``error``; what a folder has alone has neither ``run`` nor ``content``."""

    #: without the surface; None where another process computed it
    run: Run | None = None
    #: what a folder has of it, see :func:`content_of`; with a run, the plain values that the task adds to that
    content: dict[str, Any] | None = None
    error: BaseException | None = None
    #: the stage that failed
    stage: str = ""
    #: whether it was in the folder before
    kept: bool = False

    @property
    def summary(self) -> dict[str, Any]:
        """The numbers of the run, see :meth:`chemage.Run.summary`; raises the error of what failed."""
        return self._stored("summary") if self.run is None else self.run.summary()

    @property
    def measures(self) -> dict[str, Any]:
        """Those of the contact, but for :data:`GIVEN` ones; what is not known is None or nan."""
        numbers = self.summary if self.run is None else self.run.contact.summary()
        names = [name for name in (*MEASURES, *FLOW_MEASURES) if name not in GIVEN]
        return {name: numbers[name] for name in names if name in numbers}

    @property
    def ageing(self) -> Ageing | None:
        """The ageing; None where the scene ends at the contact."""
        if self.run is not None:
            return self.run.ageing
        stored = self._stored("ageing")
        return None if stored is None else from_json(Ageing, stored)

    def _stored(self, name: str) -> Any:
        if self.error is not None:
            raise self.error
        assert self.content is not None
        return self.content[name]


#: what a worker sends back: its wall time, s, and how each task ended, by its key
Answer = tuple[float, dict[str, Outcome]]

# -- what a process keeps in memory -----------------------------------------------------------------------------------


class Recent(Generic[T]):
    """A small cache of the objects used last, by key; threads that ask for one that is being made wait for it."""

    def __init__(self, size: int) -> None:
        self._size, self._lock = size, threading.Lock()
        self._making: dict[str, threading.Lock] = {}
        self._kept: OrderedDict[str, T] = OrderedDict()

    def get(self, key: str, make: Callable[[], T]) -> T:
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        with making:
            with self._lock:
                if key in self._kept:
                    self._kept.move_to_end(key)
                    return self._kept[key]
            value = make()
            with self._lock:
                self._kept[key] = value
                while len(self._kept) > self._size:
                    self._making.pop(self._kept.popitem(last=False)[0], None)
            return value

    def drop(self, start: str) -> None:
        """Forget the objects whose keys start so."""
        with self._lock:
            for key in [key for key in self._kept if key.startswith(start)]:
                del self._kept[key]
                self._making.pop(key, None)


#: what it is -> the last two: 50 MB each at 2500 x 2500 pixels; the order of tasks makes two enough
_kept: dict[str, Recent[Any]] = {}


def forget(path: str) -> None:
    """Free the surfaces and contacts of the study in the folder ``path`` that this process has in memory."""
    for cache in [*_kept.values()]:
        cache.drop(f"{path} ")


@lru_cache(maxsize=2)
def _opened(path: str, digest: str, durable: bool) -> Folder:
    folder = Folder(Path(path), durable)
    if not digest:
        return folder
    worker = f"worker {process_name()}"
    try:
        manifest = folder.read_manifest()
    except StoreError as error:
        raise ExecutorError(
            f"{worker} cannot read the sweep: {error}; every worker must see {path}; workers on other machines need a "
            "shared file system"
        ) from None
    if manifest["digest"] != digest:
        raise ExecutorError(
            f"{worker} finds another sweep in {path}; start the sweep again"
        )
    if (version := manifest["versions"]["chemage"]) != __version__:
        raise ExecutorError(
            f"{worker} has chemage {__version__}, but the sweep is run by {version}"
        )
    return folder


# -- computing --------------------------------------------------------------------------------------------------------


def compute(
    place: Place | None,
    tasks: Sequence[Task],
    threads: int,
    known: PluginsInUse | None,
    remote: bool,
) -> Answer:
    """Compute tasks that have one contact.

    Parameters
    ----------
    place
        The folder in which results are kept; None: they are sent back.
    known
        What workers of other processes use of plugins.
    remote
        Whether what is returned goes to another process.
    """
    begin = time.perf_counter()
    thread_budget.limit(threads)
    learn(known)
    worker = Worker(place, threads, remote)
    outcomes = {task.key: worker.outcome(task) for task in tasks}
    return time.perf_counter() - begin, outcomes


class Worker:
    """Computes tasks one after the other, and keeps what the next may need."""

    def __init__(self, place: Place | None, threads: int, remote: bool) -> None:
        self._threads, self._remote = threads, remote
        self._folder = None if place is None else place.folder
        #: where contacts and failures are kept as well
        self._whole = None if place is None else place.whole
        #: in caches of this process: the study, and the plugins in use, which may change between two studies
        self._owner = f"{'' if place is None else f'{place.path} {place.digest}'} {registry.current().state()}"
        #: the ageing that was computed last, and what came of it
        self._ageing, self._run, self._error = "", None, None
        #: the stage that runs, which an error is of
        self.stage = "contact"

    def outcome(self, task: Task) -> Outcome:
        """Compute a task, and keep its result."""
        try:
            outcome = task.outcome(self)
        except CannotWrite:
            raise
        except (
            Exception,
            SystemExit,
        ) as error:  # a plugin that calls exit must not end the study
            return self._failed(task, error)
        if outcome.run is not None and (self._folder is not None or self._remote):
            content = content_of(outcome.run, task) | (outcome.content or {})
            outcome = Outcome(content=content)
        if self._folder is None or outcome.content is None:
            return outcome
        self._folder.write_point(task.key, outcome.content)
        return Outcome()

    def kept(self, what: str, key: str, make: Callable[[], T]) -> T:
        """What ``make`` gives for ``key``; of each ``what`` this process keeps the last two until the study ends."""
        return _kept.setdefault(what, Recent(2)).get(f"{self._owner} {key}", make)

    def run(self, task: Task) -> Run:
        """The run of a task's scene, which has its ageing in common with the task before if that was the same."""
        same = self._ageing == task.ageing
        if same and self._run is not None:
            return _fitted_again(self._run, task.scene)
        if same and self._error is not None:
            raise self._error
        self._ageing, self._run, self._error = task.ageing, None, None
        try:
            self.stage, contact = "contact", None
            if task.scene.contact.gives_map:
                contact = self.kept(
                    "contact", task.contact, lambda: self.contact(task)
                )
            self.stage = "ageing"
            self._run = run(
                task.scene,
                contact=contact,
                threads=self._threads,
                warn=False,
                members=task.members,
            )
        except (Exception, SystemExit) as error:
            self._error = error
            raise
        return self._run

    def contact(self, task: Task) -> ContactSolution:
        """The contact of a task: that in the folder, or a new one, which is then kept there."""
        folder = self._whole
        if folder is None:
            return self._solution(task)
        if (stored := folder.intact_contact(task.contact)) is not None:
            return stored
        # tasks always use the stored contact, so that an interruption or another process does not change them
        return folder.keep_contact(task.contact, self._solution(task))

    def _solution(self, task: Task) -> ContactSolution:
        scene = task.scene
        with scene.in_use():
            surface = self.kept("surface", task.surface, lambda: surface_of(scene))
            return contact_of(scene, surface)

    def _failed(self, task: Task, error: BaseException) -> Outcome:
        if self._whole is not None:
            self._whole.write_point(task.key, failure(task, self.stage, error))
        if self._remote:
            try:
                pickle.loads(pickle.dumps(error))
            except Exception:  # another process can receive its text alone
                error = ExecutorError(in_words(error))
        return Outcome(error=error, stage=self.stage)


def _fitted_again(before: Run, scene: Scene) -> Run:
    """The run of a scene that differs from that of ``made`` in its fit and in the limits of its material only."""
    before = replace(
        before,
        scene=scene.todict(),
        keys=run_keys(scene, before.contact, before.ageing),
    )
    if before.ageing is not None and scene.chemistry is not None:
        limits = {"elasticity": elastic_limits(before.contact, scene.chemistry)}
        before = replace(before, ageing=before.ageing.model_copy(update=limits))
    return before


# -- what a folder has of a task --------------------------------------------------------------------------------------


def point_file(task: Task, status: str, **content: Any) -> dict[str, Any]:
    """The content of the file of a task."""
    about = {"status": status, "point": task.number, "changes": dict(task.changes)}
    return about | content


def content_of(run: Run, task: Task) -> dict[str, Any]:
    """The content of the file of a task that is done."""
    ageing = None if run.ageing is None else to_json(run.ageing)
    more = {"plugins": run.plugins, "summary": run.summary(), "ageing": ageing}
    if ageing is None and run.contact.approximate:  # the ageing has it otherwise
        more["approximate"] = list(run.contact.approximate)
    return point_file(task, "done", **more)


def failure(task: Task, stage: str, error: BaseException) -> dict[str, Any]:
    """The content of the file of a task that failed."""
    report: dict[str, Any] = {
        "stage": stage,
        "type": type(error).__name__,
        "message": in_words(error).partition(": ")[2],
    }
    if not isinstance(error, ChemageError):
        report["traceback"] = "".join(traceback.format_exception(error)[-6:])
    return point_file(task, "failed", error=report)
