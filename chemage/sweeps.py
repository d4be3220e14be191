"""Sweeps: one scene, many points. :func:`sweep` computes them into a folder, :func:`load_sweep` reads it.

Stages are shared by content hash: a contact is solved once for all points that rest on it, and a point whose file is in
the folder is never computed again. Contacts and points are independent tasks; a point is handed out as soon as its
contact is there. See docs/sweeps.md.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chemage.errors import ExecutorError, InputError, SceneError, StoreError, WorkerLost
from chemage.executors import Pool, open_pool
from chemage.objects import Aging, ContactSolution
from chemage.runs import versions
from chemage.scene import Scene, located, override, scene_data
from chemage.sweep_folder import FORMAT, Folder, compute, failure, solve, unpack_aging
from chemage.sweep_grid import Axis, Grid, Survey, check_base, order_of, shown, survey
from chemage.sweep_table import Table
from chemage.threads import restored as threads_restored

if TYPE_CHECKING:
    import pandas
    import xarray

#: more points than this are asked about before they are looked at
MANY_POINTS = 100_000
#: results may fill this part of the room that is left on the disk
DISK_SHARE = 0.9


_KEPT = "what is finished is kept, the same sweep goes on"


class SweepWarning(UserWarning):
    """Something about a sweep that its user should know."""


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is."""

    #: ``validating`` or ``computing``
    stage: str
    points: int
    #: points validated, or finished
    done: int
    failed: int
    contacts: int
    contacts_done: int
    #: tasks that run side by side
    workers: int
    #: wall seconds since this run of the sweep began
    elapsed: float
    #: wall seconds still to go, None while there is nothing to tell from
    remaining: float | None


Tell = Callable[[SweepProgress], None]
Confirm = Callable[[str], bool]


@dataclass(frozen=True)
class Point:
    """One point of a sweep, read from the folder when asked."""

    result: SweepResult
    index: int

    @property
    def changes(self) -> dict[str, Any]:
        """Dotted path -> value that makes this point what it is, as it was written."""
        return self.result.grid.changes(self.index)

    @property
    def values(self) -> dict[str, Any]:
        """Dotted path -> value as the scene understood it: numbers in internal units."""
        return {path: column[self.index] for path, column in self.result.swept.items()}

    @property
    def key(self) -> str:
        """Content hash of everything the result depends on."""
        return self.result.keys[self.index]

    @cached_property
    def _content(self) -> dict[str, Any]:
        return self.result.store.read_point(self.key) or {"status": "missing"}

    @property
    def status(self) -> str:
        """``done``, ``failed`` or ``missing``."""
        return self._content["status"]

    @property
    def error(self) -> str:
        """Why it failed; empty otherwise."""
        told = self._content.get("error")
        return f"{told['stage']}: {told['type']}: {told['message']}" if told else ""

    @property
    def summary(self) -> dict[str, Any]:
        """The numbers of :meth:`chemage.Run.summary`.

        Raises
        ------
        StoreError
            The point is not done.
        """
        if self.status != "done":
            raise StoreError(
                f"point {self.index} of {self.result.folder} is {self.status}{self.error and ': '}{self.error}"
            )
        return self._content["summary"]

    def scene(self) -> Scene:
        """The validated scene of this point."""
        return self.result.grid.scene(self.index)

    def aging(self) -> Aging:
        """Ageing, bonds of every replica included.

        Raises
        ------
        StoreError
            The point is not done, or its scene stops at the contact.
        """
        if not self.summary["hold_times"]:
            raise StoreError(
                f"point {self.index} of {self.result.folder} has no ageing: its scene stops at the contact"
            )
        return unpack_aging(self._content["aging"])

    def contact(self) -> ContactSolution:
        """The contact this point rests on.

        Raises
        ------
        StoreError
            It is not in the folder.
        """
        found = self.result.store.read_contact(self.result.contact_key(self.index))
        if found is None:
            raise StoreError(f"the contact of point {self.index} is not in {self.result.folder}")
        return found

    def __repr__(self) -> str:
        return f"<Point {self.index}: {', '.join(f'{path} = {shown(value)}' for path, value in self.changes.items())}>"


def _no_counts() -> dict[str, int]:
    return {"points": 0, "done": 0, "failed": 0, "missing": 0}


class SweepResult:
    """A sweep's folder, done or not: a sequence of :class:`Point`."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.store = Folder(self.folder)
        self._manifest = self.store.read_manifest()
        self.grid = Grid.fromdict(self._manifest["grid"])
        self.keys: list[str] = self._manifest["keys"]

    @property
    def name(self) -> str:
        """The scene's name."""
        return str(self.grid.base.get("name", "scene"))

    @property
    def digest(self) -> str:
        """Content hash of the whole sweep."""
        return self._manifest["digest"]

    @property
    def axes(self) -> tuple[Axis, ...]:
        """What varies; the last axis moves fastest."""
        return self.grid.axes

    @cached_property
    def swept(self) -> dict[str, list[Any]]:
        """Dotted path -> its value at every point, as the scene understood it: numbers in internal units."""
        resolved = self._manifest["resolved"]
        columns: dict[str, list[Any]] = {path: [] for axis in self.axes for path in axis.paths}
        for point in range(len(self)):
            for axis, place in enumerate(self.grid.positions(point)):
                for path, value in zip(self.axes[axis].paths, resolved[axis][place], strict=True):
                    columns[path].append(value)
        return columns

    @property
    def units(self) -> dict[str, str]:
        """Dotted path -> unit of :attr:`swept`, empty where it has none."""
        return self._manifest["units"]

    def contact_key(self, point: int) -> str:
        """Content hash of the contact that ``point`` rests on."""
        return self._manifest["contacts"][self._manifest["contact_of"][point]]

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: int) -> Point:
        if not -len(self) <= index < len(self):
            raise IndexError(f"point {index} of a sweep of {len(self)}")
        return Point(self, index % len(self))

    def __iter__(self) -> Iterator[Point]:
        return (Point(self, index) for index in range(len(self)))

    def where(self, values: Mapping[str, Any]) -> list[Point]:
        """The points at which every dotted path has the value given, as it was written or as it was understood.

        Raises
        ------
        InputError
            A path that is not swept.
        """
        for path in values:
            if path not in self.swept:
                raise InputError.of(path, values[path], f"is not swept; swept are {', '.join(self.swept)}")
        return [
            point
            for point in self
            if all(
                value == point.values[path] or (path in point.changes and value == point.changes[path])
                for path, value in values.items()
            )
        ]

    def states(self) -> list[str]:
        """``done``, ``failed`` or ``missing`` for each point, as the folder is now."""
        known: dict[str, str] = {}
        for key in self.keys:
            if key not in known:
                known[key] = self.store.state(key)
        return [known[key] for key in self.keys]

    @property
    def failed(self) -> list[Point]:
        """The points that failed."""
        return [self[index] for index, state in enumerate(self.states()) if state == "failed"]

    def table(self) -> Table:
        """The numbers of all points, read from the folder now."""
        points = (self.store.read_point(key) for key in self.keys)
        return Table.collect(self.swept, self.units, points)

    def to_pandas(self) -> pandas.DataFrame:
        """One row a point: status, what was swept, the numbers. Needs pandas."""
        return self.table().to_pandas()

    def to_xarray(self) -> xarray.Dataset:
        """Dimensions point, hold_time, replica: also friction and bonds at each hold time. Needs xarray."""
        return self.table().to_xarray()

    def write_tables(self) -> tuple[Path, Path]:
        """Write ``results.csv`` and ``results.h5`` into the folder."""
        table = self.table()
        names = self.folder / "results.csv", self.folder / "results.h5"
        table.write_csv(names[0])
        made = self._manifest["versions"]
        table.write_hdf5(
            names[1],
            {
                "chemage": made["chemage"],
                "chemage_sweep": FORMAT,
                "Conventions": "CF-1.8",
                "sweep": json.dumps(self.grid.todict()),
                "digest": self.digest,
                "versions": json.dumps(made),
            },
        )
        return names

    def status(self) -> dict[str, Any]:
        """Counts of points done, failed and missing, in all and for each value of each axis; and what failed."""
        states = self.states()
        counts = [[_no_counts() for _ in axis.values] for axis in self.axes]
        total = _no_counts()
        for point, state in enumerate(states):
            rows = [axis[place] for axis, place in zip(counts, self.grid.positions(point), strict=True)]
            for row in (total, *rows):
                row["points"] += 1
                row[state] += 1
        axes = [
            {
                "axis": axis.name,
                "rows": [
                    {"values": dict(zip(axis.paths, values, strict=True)), **row}
                    for values, row in zip(axis.values, found, strict=True)
                ],
            }
            for axis, found in zip(self.axes, counts, strict=True)
        ]
        contacts: list[str] = self._manifest["contacts"]
        return {
            "name": self.name,
            "folder": str(self.folder),
            **total,
            "contacts": len(contacts),
            "contacts_done": sum(self.store.has_contact(key) for key in contacts),
            "axes": axes,
            "failures": [
                {"point": index, "changes": self[index].changes, "error": self[index].error}
                for index, state in enumerate(states)
                if state == "failed"
            ],
        }

    def __repr__(self) -> str:
        return f"<SweepResult {self.folder}: {len(self)} points, {' x '.join(str(n) for n in self.grid.shape)}>"


def load_sweep(folder: str | Path) -> SweepResult:
    """The sweep in ``folder``, finished or not.

    Raises
    ------
    StoreError
        It is not the folder of a sweep, or a newer chemage made it.
    """
    return SweepResult(folder)


# -- before anything runs ---------------------------------------------------------------------------------------------


def read_grid(scene: str | Path | Mapping[str, Any], changes: Mapping[str, Any] | None = None) -> Grid:
    """The grid of a scene file, an installed scene, or scene data, with dotted-path ``changes`` to the base.

    Raises
    ------
    SceneError
        ``[sweep]`` is missing or wrong.
    """
    data, source = (dict(scene), "the scene") if isinstance(scene, Mapping) else scene_data(scene)
    data = override(data, changes or {})
    if "sweep" not in data:
        raise SceneError(source, [("sweep", "is missing: this scene is one point; use chemage.run")])
    return Grid.read(check_base(located(data, Path.cwd()), source), source)


def survey_of(grid: Grid, *, tell: Tell | None = None, confirm: Confirm | None = None) -> Survey:
    """Validate every point; more than ``MANY_POINTS`` of them only if ``confirm`` agrees."""
    begin = time.perf_counter()
    if grid.size > MANY_POINTS:
        _ask(f"the sweep has {grid.size} points ({_product(grid)})", confirm)
    last = begin

    def heard(seen: int, total: int) -> None:
        nonlocal last
        now = time.perf_counter()
        if tell is not None and (now > last + 0.2 or seen == total):
            last = now
            left = (now - begin) * (total - seen) / seen
            tell(SweepProgress("validating", total, seen, 0, 0, 0, 1, now - begin, left))

    return survey(grid, heard)


def _product(grid: Grid) -> str:
    return " x ".join(str(length) for length in grid.shape)


def _ask(what: str, confirm: Confirm | None) -> None:
    if confirm is None or not confirm(what):
        raise InputError(f"{what}; nothing was computed. Sweep over less, or agree to it (--yes, or confirm=)")


def room_for(path: Path) -> int:
    """Bytes left where ``path`` is or will be."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    return shutil.disk_usage(place).free


def _check_room(found: Survey, path: Path, confirm: Confirm | None) -> None:
    need, room = found.total_bytes, room_for(path)
    if need > DISK_SHARE * room:
        _ask(
            f"the {found.grid.size} points and {len(found.contacts)} contacts may need {_size(need)}, but "
            f"{path.absolute().parent} has {_size(room)} left",
            confirm,
        )


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def _check_folder(folder: Folder, found: Survey, force: bool) -> None:
    """Refuse what is not ours, or of another sweep unless that is to be replaced."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise StoreError(f"{path} is a file; a sweep is computed into a folder")
    if not path.exists() or not any(name for name in path.iterdir() if name.name not in (".lock", ".parts")):
        return
    if not folder.manifest.exists():
        raise StoreError(f"{path} is not empty and holds no sweep; choose another folder")
    if force:
        return
    there = folder.read_manifest()
    if there["digest"] != found.digest:
        raise StoreError(f"{path} holds another sweep ({_difference(there, found)}); choose another folder")
    now, then = versions(), there["versions"]
    changed = [f"{name} {then[name]} -> {now[name]}" for name in now if name in then and then[name] != now[name]]
    if changed:
        warnings.warn(
            f"{path} was begun with other versions ({', '.join(changed)}); points of both will stand side by side",
            SweepWarning,
            stacklevel=3,
        )


def _difference(there: Mapping[str, Any], found: Survey) -> str:
    old = Grid.fromdict(there["grid"])
    if [axis.paths for axis in old.axes] != [axis.paths for axis in found.grid.axes]:
        return f"over {', '.join(axis.name for axis in old.axes)}"
    if old.shape != found.grid.shape:
        return f"{_product(old)} points instead of {_product(found.grid)}"
    if there["hooks"] != found.hooks:
        before, now = (", ".join(names) or "none" for names in (there["hooks"], found.hooks))
        return f"plugins that answer or wrap its stages were {before} and are {now}"
    different = sum(a != b for a, b in zip(there["keys"], found.keys, strict=True))
    return f"{different} of its {len(found.keys)} points differ"


def _clear(folder: Folder) -> None:
    """Remove what a sweep left, and nothing else; the manifest last, so that the folder stays known as a sweep's."""
    for name in ("points", "contacts", ".parts"):
        shutil.rmtree(folder.path / name, ignore_errors=True)
    for name in ("results.csv", "results.h5", "sweep.json"):
        (folder.path / name).unlink(missing_ok=True)


def _manifest(found: Survey) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "digest": found.digest,
        "versions": versions(found.grid.scene(0)),
        "hooks": found.hooks,
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
    progress: Tell | bool | None = None,
    confirm: Confirm | bool = False,
    force: bool = False,
) -> SweepResult:
    """Compute every point of a scene's ``[sweep]`` into the folder ``out``; what is there is not computed again.

    Parameters
    ----------
    scene
        A scene file, the name of an installed scene, or scene data (a mapping), with ``sweep`` in it.
    out
        A new folder, or one in which this very sweep was begun.
    executor, workers, threads
        See :func:`chemage.executors.open_pool`. Results do not depend on them.
    changes
        Dotted path -> value: changes to the scene below the sweep.
    progress
        Called with a :class:`SweepProgress` several times a second; True prints to stderr.
    confirm
        Asked, with a sentence, when there are very many points or little room on the disk; True agrees to anything.
    force
        Compute everything anew.

    Returns
    -------
    SweepResult
        Points that failed are recorded in it, see ``SweepResult.failed``; a next call tries them again.

    Raises
    ------
    SceneError
        A point is not valid; all points are looked at before the first is computed.
    StoreError
        ``out`` holds something else, or cannot be written to.
    ExecutorError
        The workers cannot be started.
    """
    begin = time.perf_counter()
    agree = (lambda text: True) if confirm is True else (confirm or None)
    with ExitStack() as stack:
        tell = stack.enter_context(_display(progress))
        stack.enter_context(threads_restored())  # tasks that run in this process set their own
        found = survey_of(read_grid(scene, changes), tell=tell, confirm=agree)
        folder = Folder(Path(out).absolute())
        _check_folder(folder, found, force)
        _check_room(found, folder.path, agree)
        pool = None
        if force or _Todo(folder, found).left:  # workers that cannot be had are told before anything is written
            pool = stack.enter_context(open_pool(executor, workers, threads))
        _make(folder.path)
        stack.enter_context(folder.locked())
        if force:
            _clear(folder)
        folder.clear_parts()
        if not folder.manifest.exists():
            folder.write_manifest(_manifest(found))
        todo = _Todo(folder, found)
        if todo.left and pool is not None:
            _carry_out(todo, pool, tell, begin)
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
    """A contact, or points that share their ageing."""

    contact: int
    points: list[int]
    weight: float
    #: whether it runs with nothing beside it, so that a dead worker is certainly its doing
    alone: bool = False

    @property
    def solves(self) -> bool:
        return not self.points


class _Todo:
    """What is still to be computed, in the order in which neighbours share a surface."""

    def __init__(self, folder: Folder, found: Survey) -> None:
        self.folder, self.found = folder, found
        states: dict[str, str] = {}
        for key in found.keys:
            if key not in states:
                states[key] = folder.state(key)
        self.done = sum(states[key] == "done" for key in found.keys)
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
            if folder.has_contact(found.contacts[number].key):
                self.contacts_done += 1
                self._ready.extend(self._waiting.pop(number))
            else:
                cost = found.contacts[number].cpu_seconds
                self._contacts.append(_Task(number, [], math.nan if cost is None else cost + 1e-3))

    @property
    def left(self) -> int:
        """Tasks not handed out."""
        return len(self._ready) + len(self._contacts)

    def take(self, solving: int, width: int) -> _Task:
        """The next task when ``solving`` contacts are under way on ``width`` workers.

        Points first, while their contact is still in somebody's memory; but half the workers stay with contacts, so
        that the last of them is not started when everything else is done.
        """
        if self._contacts and (not self._ready or solving < width // 2):
            return self._contacts.popleft()
        return self._ready.popleft()

    def remaining(self) -> tuple[list[float], list[float]]:
        """Weights of what is not handed out: contacts, points."""
        points = [task.weight for task in self._ready]
        points += [task.weight for tasks in self._waiting.values() for task in tasks]
        return [task.weight for task in self._contacts], points

    def finished(self, task: _Task, answer: Mapping[str, Any]) -> None:
        """Note what came back."""
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
        """Note a task that killed its workers."""
        stage = "contact" if task.solves else "ageing"
        told = failure(0, {}, stage, error)["error"]
        if task.solves:
            self.finished(task, {"error": told})
        else:
            self._record(task.points, told)

    def _record(self, points: list[int], error: Mapping[str, Any]) -> None:
        for point in points:
            content = {"status": "failed", "point": point, "changes": self.found.grid.changes(point), "error": error}
            self.folder.write_point(self.found.keys[point], content)
            self.failed.update(dict.fromkeys(self._same[self.found.keys[point]], str(error["message"])))


@dataclass
class _Clock:
    """Tells the remaining time from what tasks cost so far."""

    begin: float
    seconds: dict[bool, float] = field(default_factory=lambda: {True: 0.0, False: 0.0})
    weight: dict[bool, float] = field(default_factory=lambda: {True: 0.0, False: 0.0})
    count: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})

    def add(self, task: _Task, seconds: float) -> None:
        """A task that took so long."""
        self.seconds[task.solves] += seconds
        self.weight[task.solves] += task.weight
        self.count[task.solves] += 1

    def remaining(self, contacts: list[float], points: list[float], width: int) -> float | None:
        """Wall seconds for what is left."""
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


def _carry_out(todo: _Todo, pool: Pool, tell: Tell | None, begin: float) -> None:
    running: dict[Future[dict[str, Any]], _Task] = {}
    suspects: deque[_Task] = deque()
    clock, heard = _Clock(begin), 0.0
    path, digest = str(todo.folder.path), todo.found.digest

    def submit(task: _Task) -> Future[dict[str, Any]]:
        if task.solves:
            contact = todo.found.contacts[task.contact]
            return pool.executor.submit(solve, path, digest, contact.point, contact.key, pool.threads)
        return pool.executor.submit(compute, path, digest, task.points, pool.threads)

    def report(now: float) -> None:
        if tell is None:
            return
        contacts, points = todo.remaining()
        for task in (*running.values(), *suspects):
            (contacts if task.solves else points).append(task.weight / 2)
        width = pool.width()
        tell(
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
                    suspects.append(task)  # perhaps it only stood behind the one that killed the worker
                else:
                    _settle(todo, task, future, clock)
            now = time.perf_counter()
            if now > heard + 0.2:
                heard = now
                report(now)
        report(time.perf_counter())
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
        raise ExecutorError(f"the executor gave up ({type(error).__name__}: {error}); {_KEPT}") from error
    except ExecutorError as error:
        raise ExecutorError(f"{error}; {_KEPT}") from error
    else:
        clock.add(task, answer["seconds"])
        todo.finished(task, answer)


# -- telling ----------------------------------------------------------------------------------------------------------


@contextmanager
def _display(progress: Tell | bool | None) -> Iterator[Tell | None]:
    if progress is True:
        with show_progress() as tell:
            yield tell
    else:
        yield progress or None


@contextmanager
def show_progress(seconds: float = 5.0) -> Iterator[Tell]:
    """Bars on stderr; where that is no terminal, a line every few ``seconds``."""
    if not sys.stderr.isatty():
        begin = time.perf_counter()
        last, printed = begin, ""

        def line(state: SweepProgress) -> None:
            nonlocal last, printed
            now = time.perf_counter()
            ended = state.stage == "computing" and state.done + state.failed == state.points
            if (now > last + seconds or (ended and last > begin)) and told(state) != printed:
                last, printed = now, told(state)
                print(printed, file=sys.stderr, flush=True)

        yield line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def bar(name: str, done: int, total: int, note: str) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=total, note=note)
            bars.update(tasks[name], completed=done, total=total, note=note)

        def draw(state: SweepProgress) -> None:
            if state.stage == "validating":
                bar("validating", state.done, state.points, _left(state.remaining))
                return
            bar("contacts", state.contacts_done, state.contacts, "")
            failed = f"{state.failed} failed, " if state.failed else ""
            bar("points", state.done + state.failed, state.points, f"{failed}{_left(state.remaining)}")

        yield draw


def told(state: SweepProgress) -> str:
    """How far a sweep is, in a line."""
    if state.stage == "validating":
        return f"sweep: {state.done} of {state.points} points validated, {_left(state.remaining)}"
    failed = f", {state.failed} failed" if state.failed else ""
    return (
        f"sweep: {state.done} of {state.points} points{failed}, {state.contacts_done} of {state.contacts} contacts, "
        f"{_left(state.remaining)}"
    )


def _left(seconds: float | None) -> str:
    if seconds is None:
        return "remaining time not known yet"
    whole = round(seconds)
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min left"
    return f"{whole // 60} min {whole % 60:02d} s left" if whole >= 60 else f"{whole} s left"
