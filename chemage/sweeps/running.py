"""Computing a sweep: validates every point, then distributes contacts and points as independent tasks.

A point is submitted as soon as its contact is solved. Completed contacts and points are skipped.
"""

from __future__ import annotations

import math
import shutil
import time
import warnings
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from chemage.experiments.provenance import versions
from chemage.experiments.scene_files import located, override, scene_data
from chemage.foundation.errors import DamagedError, ExecutorError, InputError, SceneError, StoreError, WorkerLost
from chemage.foundation.memory import readable
from chemage.foundation.threads import restored as threads_restored
from chemage.plugins.settings import completed
from chemage.sweeps.by_hand import Known, for_workers
from chemage.sweeps.executors.opening import open_pool
from chemage.sweeps.executors.pool import Pool
from chemage.sweeps.folder import FORMAT, RESUME, Folder, SweepWarning
from chemage.sweeps.freshness import Outdated, outdated
from chemage.sweeps.grid import Grid, Survey, check_base, order_of, survey
from chemage.sweeps.manifest import refuse_links
from chemage.sweeps.progress import Report, SweepProgress, reporting
from chemage.sweeps.result import SweepResult
from chemage.sweeps.tasks import compute, failure, solve

#: sweeps of more points need confirmation before they are validated
MANY_POINTS = 100_000
#: fraction of the free disk space that results may fill without confirmation
DISK_SHARE = 0.9


#: receives a description of what needs confirmation, and returns whether the sweep may continue
Confirm = Callable[[str], bool]


# -- before the first task --------------------------------------------------------------------------------------------


def read_grid(scene: str | Path | Mapping[str, Any], changes: Mapping[str, Any] | None = None) -> Grid:
    """Read the grid of a scene file, an installed scene, or scene data, with dotted-path ``changes`` to the base.

    Raises
    ------
    SceneError
        ``[sweep]`` is missing or not valid.
    """
    data, source = (dict(scene), "the scene") if isinstance(scene, Mapping) else scene_data(scene)
    data = completed(override(data, changes or {}))
    if "sweep" not in data:
        raise SceneError(source, [("sweep", "is missing: this scene is one point; use chemage.run")])
    return Grid.read(check_base(located(data, Path.cwd()), source), source)


def survey_of(grid: Grid, *, progress: Report | None = None, confirm: Confirm | None = None) -> Survey:
    """Validate every point; more than ``MANY_POINTS`` points only if ``confirm`` returns True.

    Raises
    ------
    SceneError
        A point is not valid.
    InputError
        There are too many points, and ``confirm`` did not return True.
    """
    begin = time.perf_counter()
    if grid.size > MANY_POINTS:
        _require_confirmation(f"the sweep has {grid.size} points ({grid.product})", confirm)
    last = begin

    def report(validated: int, total: int) -> None:
        nonlocal last
        now = time.perf_counter()
        if progress is not None and (now > last + 0.2 or validated == total):
            last = now
            left = (now - begin) * (total - validated) / validated
            progress(SweepProgress("validating", total, validated, 0, 0, 0, 1, now - begin, left))

    return survey(grid, report)


def _require_confirmation(what: str, confirm: Confirm | None) -> None:
    if confirm is None or not confirm(what):
        raise InputError(f"{what}; nothing was computed. Reduce the sweep, or confirm it (--yes, or confirm=True)")


def room_for(path: Path) -> int:
    """Free disk space where ``path`` is or will be, bytes."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    return shutil.disk_usage(place).free


def _check_room(found: Survey, path: Path, confirm: Confirm | None) -> None:
    need, room = found.total_bytes, room_for(path)
    if need > DISK_SHARE * room:
        _require_confirmation(
            f"the {found.grid.size} points and {len(found.contacts)} contacts may need {readable(need)}, but "
            f"{path.absolute().parent} has {readable(room)} left",
            confirm,
        )


def _check_folder(folder: Folder, found: Survey, force: bool) -> None:
    """Refuse a folder that is not of a sweep, or of another sweep unless that is to be replaced."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise StoreError(f"{path} is a file; a sweep is computed into a folder")
    refuse_links(path)
    if not path.exists() or not any(name for name in path.iterdir() if name.name not in (".lock", ".parts")):
        return
    if not folder.manifest.exists():
        raise StoreError(f"{path} is not empty and holds no sweep; choose another folder")
    if force:
        return
    there = _manifest_of(folder, found)
    if there["digest"] != found.digest:
        raise StoreError(f"{path} holds another sweep ({_difference(there, found)}); choose another folder")
    now, then = versions(), there["versions"]
    changed = [f"{name} {then[name]} -> {now[name]}" for name in now if name in then and then[name] != now[name]]
    if changed:
        warnings.warn(
            f"{path} was begun with other versions ({', '.join(changed)}); it will hold points of both",
            SweepWarning,
            stacklevel=3,
        )


def _manifest_of(folder: Folder, found: Survey) -> Mapping[str, Any]:
    """The manifest; one that is damaged is made anew, if the folder holds points of this sweep."""
    try:
        return folder.read_manifest()
    except DamagedError as error:
        if not any(folder.point(key).exists() for key in found.keys):
            raise
        warnings.warn(f"{error}; it is written again", SweepWarning, stacklevel=4)
        return _manifest(found)


def _difference(there: Mapping[str, Any], found: Survey) -> str:
    old = Grid.fromdict(there["grid"])
    if [axis.paths for axis in old.axes] != [axis.paths for axis in found.grid.axes]:
        return f"over {', '.join(axis.name for axis in old.axes)}"
    if old.shape != found.grid.shape:
        return f"{old.product} points instead of {found.grid.product}"
    different = sum(a != b for a, b in zip(there["keys"], found.keys, strict=True))
    return f"{different} of its {len(found.keys)} points differ"


def _outdated(folder: Folder, found: Survey) -> Outdated:
    if not folder.manifest.exists():
        return Outdated()
    try:
        there = folder.read_manifest()
    except DamagedError:
        there = {}
    stale = outdated(folder, found, there)
    if stale:
        warnings.warn(f"{folder.path}: {stale.describe()}", SweepWarning, stacklevel=3)
    return stale


def _describe(folder: Folder, found: Survey) -> None:
    """Write the manifest, or note in it which plugins were asked about all that is complete."""
    try:
        there = folder.read_manifest() if folder.manifest.exists() else None
    except DamagedError:
        there = None
    if there is None:
        folder.write_manifest(_manifest(found))
    elif there.get("asked", {}) != found.hooks:
        folder.write_manifest({**there, "asked": found.hooks})


def _clear(folder: Folder) -> None:
    """Remove the files of a sweep only; the manifest last, so that the folder stays recognisable as that of a sweep."""
    for name in ("points", "contacts", ".parts"):
        shutil.rmtree(folder.path / name, ignore_errors=True)
    for name in ("results.csv", "results.h5", "sweep.json"):
        (folder.path / name).unlink(missing_ok=True)


def _manifest(found: Survey) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "digest": found.digest,
        "versions": versions(found.grid.scene(0)),
        "asked": found.hooks,
        "grid": found.grid.todict(),
        "resolved": found.resolved,
        "units": found.units,
        "contacts": [contact.key for contact in found.contacts],
        "contact_of": found.contact_of,
        "keys": found.keys,
    }


# -- the sweep --------------------------------------------------------------------------------------------------------


def sweep(
    scene: str | Path | Mapping[str, Any],
    out: str | Path,
    *,
    executor: str | Executor = "serial",
    workers: int | None = None,
    threads: int | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: Report | bool | None = None,
    confirm: Confirm | bool = False,
    force: bool = False,
) -> SweepResult:
    """Compute every point of a scene with ``[sweep]`` into the folder ``out``; completed points are skipped.

    Parameters
    ----------
    scene
        A scene file, the name of an installed scene, or scene data (a mapping) that contain ``sweep``.
    out
        A new folder, or the folder of this sweep, which then resumes.
    executor, workers, threads
        Where to compute, the number of concurrent points, and the threads of each; see
        :func:`chemage.sweeps.executors.opening.open_pool`. Results do not depend on them.
    changes
        Dotted path -> value: changes to the scene before it is swept.
    progress
        Receives a :class:`~chemage.sweeps.progress.SweepProgress` several times a second; True shows it on stderr.
    confirm
        Receives a sentence if there are very many points or little free disk space, and returns whether to continue;
        True confirms always.
    force
        Replace the results in ``out`` and compute all points.

    Returns
    -------
    SweepResult
        All points; those that failed are in ``SweepResult.failed`` and are tried again by the next call.

    Raises
    ------
    SceneError
        A point is not valid; all points are validated before the first is computed.
    InputError
        The sweep needs confirmation; ``executor``, ``workers`` or ``threads`` is not valid; or a component was
        registered by hand in a place that worker processes cannot import.
    StoreError
        ``out`` holds something else, or cannot be written.
    ExecutorError
        The workers cannot be started, or have ended.
    """
    begin = time.perf_counter()
    confirmed = (lambda text: True) if confirm is True else (confirm or None)
    with ExitStack() as stack:
        report = stack.enter_context(reporting(progress))
        stack.enter_context(threads_restored())  # tasks that run in this process set their own
        found = survey_of(read_grid(scene, changes), progress=report, confirm=confirmed)
        known = for_workers(executor, found.classes)
        folder = Folder(Path(out).absolute())
        _check_folder(folder, found, force)
        _check_room(found, folder.path, confirmed)
        stale = Outdated() if force else _outdated(folder, found)
        pool = None
        # raises before anything is written if the workers cannot be started
        if force or stale or _Todo(folder, found).left:
            pool = stack.enter_context(open_pool(executor, workers, threads))
        _make(folder.path)
        stack.enter_context(folder.locked())
        if force:
            _clear(folder)
        folder.clear_parts()
        stale.remove(folder)
        _describe(folder, found)
        todo = _Todo(folder, found)
        todo.warn_of_damage()
        if todo.left and pool is not None:
            _run_tasks(todo, pool, report, begin, known)
        result = SweepResult(folder.path)
        result.write_tables()
        shutil.rmtree(folder.path / ".parts", ignore_errors=True)
    return result


def _make(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {path}: {error.strerror}") from None


@dataclass
class _Task:
    """A contact to solve, or points with the same ageing."""

    contact: int
    points: list[int]
    weight: float
    #: whether no other task runs at the same time, so that a worker that dies must have died of this one
    alone: bool = False

    @property
    def solves(self) -> bool:
        return not self.points


class _Todo:
    """The tasks that are left, in an order in which successive contacts share a surface."""

    def __init__(self, folder: Folder, found: Survey) -> None:
        self.folder, self.found = folder, found
        states: dict[str, str] = {}
        for key in found.keys:
            if key not in states:
                states[key] = folder.state(key)
        self.done = sum(states[key] == "done" for key in found.keys)
        self.damaged = [folder.point(key) for key, state in states.items() if state == "damaged"]
        self.failed: dict[int, str] = {}
        groups: dict[str, list[int]] = {}
        claimed: set[str] = set()
        self._same: dict[str, list[int]] = {}
        for point, key in enumerate(found.keys):
            self._same.setdefault(key, []).append(point)
            if states[key] != "done" and key not in claimed:
                claimed.add(key)
                groups.setdefault(found.agings[point], []).append(point)
        self._waiting: dict[int, list[_Task]] = {}
        for points in groups.values():
            cost = found.cpu_seconds[points[0]]
            task = _Task(found.contact_of[points[0]], points, math.nan if cost is None else cost + 1e-3)
            self._waiting.setdefault(task.contact, []).append(task)
        self._ready: deque[_Task] = deque()
        self._contacts: deque[_Task] = deque()
        self.contacts_done = len(found.contacts) - len(self._waiting)
        for number in order_of(found.contacts):
            if number not in self._waiting:
                continue
            key = found.contacts[number].key
            if folder.has_contact(key):
                self.contacts_done += 1
                self._ready.extend(self._waiting.pop(number))
            else:
                if folder.contact(key).exists():
                    self.damaged.append(folder.contact(key))
                cost = found.contacts[number].cpu_seconds
                self._contacts.append(_Task(number, [], math.nan if cost is None else cost + 1e-3))

    def warn_of_damage(self) -> None:
        """Name the damaged files, which are computed again."""
        if self.damaged:
            names = [str(path.relative_to(self.folder.path)) for path in self.damaged[:5]]
            more = ", ..." if len(self.damaged) > 5 else ""
            message = f"{len(self.damaged)} files are damaged and are computed again: {', '.join(names)}{more}"
            warnings.warn(f"{self.folder.path}: {message}", SweepWarning, stacklevel=3)

    @property
    def left(self) -> int:
        """Number of tasks ready to be submitted."""
        return len(self._ready) + len(self._contacts)

    def take(self, solving: int, width: int) -> _Task:
        """Take the next task while ``solving`` contacts are being solved on ``width`` workers.

        Points come first, while a worker still has their contact in memory; but half of the workers solve contacts, so
        that the last contact does not start after everything else has ended.
        """
        if self._contacts and (not self._ready or solving < width // 2):
            return self._contacts.popleft()
        return self._ready.popleft()

    def remaining(self) -> tuple[list[float], list[float]]:
        """The weights of the tasks that are not submitted: contacts, points."""
        points = [task.weight for task in self._ready]
        points += [task.weight for tasks in self._waiting.values() for task in tasks]
        return [task.weight for task in self._contacts], points

    def finished(self, task: _Task, answer: Mapping[str, Any]) -> None:
        """Record the end of a task."""
        if task.solves:
            self.contacts_done += 1
            dependents = self._waiting.pop(task.contact)
            if (error := answer.get("error")) is None:
                self._ready.extend(dependents)
                return
            for group in dependents:
                self._record(group.points, error)
            return
        failed: Mapping[int, str] = answer.get("failed", {})
        for point in task.points:
            same = self._same[self.found.keys[point]]
            if point in failed:
                self.failed.update(dict.fromkeys(same, failed[point]))
            else:
                self.done += len(same)

    def lost(self, task: _Task, error: WorkerLost) -> None:
        """Record a task whose workers died."""
        found = failure(0, {}, "contact" if task.solves else "ageing", error)["error"]
        if task.solves:
            self.finished(task, {"error": found})
        else:
            self._record(task.points, found)

    def _record(self, points: list[int], error: Mapping[str, Any]) -> None:
        for point in points:
            content = {"status": "failed", "point": point, "changes": self.found.grid.changes(point), "error": error}
            self.folder.write_point(self.found.keys[point], content)
            self.failed.update(dict.fromkeys(self._same[self.found.keys[point]], str(error["message"])))


@dataclass
class _Clock:
    """Estimates the remaining time from the duration of completed tasks."""

    seconds: dict[bool, float] = field(default_factory=lambda: {True: 0.0, False: 0.0})
    weight: dict[bool, float] = field(default_factory=lambda: {True: 0.0, False: 0.0})
    count: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})

    def add(self, task: _Task, seconds: float) -> None:
        """Add the duration of a completed task."""
        self.seconds[task.solves] += seconds
        self.weight[task.solves] += task.weight
        self.count[task.solves] += 1

    def remaining(self, contacts: list[float], points: list[float], width: int) -> float | None:
        """Estimate the wall time of the remaining tasks, s; None before the first task has ended."""
        total = 0.0
        for solves, left in ((True, contacts), (False, points)):
            weights = sum(left)
            known = solves if self.count[solves] else not solves
            if not left:
                continue
            if math.isfinite(weights) and self.weight[known] > 0:
                total += self.seconds[known] / self.weight[known] * weights
            elif self.count[solves]:
                total += self.seconds[solves] / self.count[solves] * len(left)
            else:
                return None
        return total / max(1, width)


def _run_tasks(todo: _Todo, pool: Pool, report: Report | None, begin: float, known: Known) -> None:
    running: dict[Future[dict[str, Any]], _Task] = {}
    suspects: deque[_Task] = deque()
    clock, last_report = _Clock(), 0.0
    path, digest = str(todo.folder.path), todo.found.digest

    def submit(task: _Task) -> Future[dict[str, Any]]:
        if task.solves:
            contact = todo.found.contacts[task.contact]
            return pool.executor.submit(solve, path, digest, contact.point, contact.key, pool.threads, known)
        return pool.executor.submit(compute, path, digest, task.points, pool.threads, known)

    def report_now(now: float) -> None:
        if report is None:
            return
        contacts, points = todo.remaining()
        for task in (*running.values(), *suspects):
            (contacts if task.solves else points).append(task.weight / 2)
        width = pool.width()
        report(
            SweepProgress(
                "computing",
                len(todo.found.keys),
                todo.done,
                len(todo.failed),
                len(todo.found.contacts),
                todo.contacts_done,
                width,
                now - begin,
                clock.remaining(contacts, points, width),
            )
        )

    try:
        while todo.left or running or suspects:
            width = pool.width()
            if suspects and not running and not todo.left:
                task = suspects.popleft()
                task.alone = True
                running[submit(task)] = task
            while todo.left and len(running) < width and not any(one.alone for one in running.values()):
                task = todo.take(sum(one.solves for one in running.values()), width)
                running[submit(task)] = task
            finished, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in finished:
                task = running.pop(future)
                if not pool.blames_one and not task.alone and isinstance(future.exception(), WorkerLost):
                    suspects.append(task)  # perhaps it only waited on the worker that another task killed
                else:
                    _settle(todo, task, future, clock)
            now = time.perf_counter()
            if now > last_report + 0.2:
                last_report = now
                report_now(now)
        report_now(time.perf_counter())
    except BaseException:
        for future in running:
            future.cancel()
        pool.abort()
        raise


def _settle(todo: _Todo, task: _Task, future: Future[dict[str, Any]], clock: _Clock) -> None:
    try:
        answer = future.result()
    except WorkerLost as error:
        todo.lost(task, error)
    except (BrokenExecutor, CancelledError) as error:
        raise ExecutorError(f"the executor gave up ({type(error).__name__}: {error}); {RESUME}") from error
    except ExecutorError as error:
        raise ExecutorError(f"{error}; {RESUME}") from error
    else:
        clock.add(task, answer["seconds"])
        todo.finished(task, answer)
