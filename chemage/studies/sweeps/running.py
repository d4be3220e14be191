"""Computing a sweep: validates every point, then distributes contacts and points as independent tasks.

A point is submitted as soon as its contact is solved. Completed contacts and points are skipped.

Progress of a sweep, reported while it runs.

The points of a sweep as a design: one surface each, or each a mean over surfaces.

Means that differ in temperature or chemistry have their surfaces in common, and so their contacts. Their samples are
kept in the folder ``samples`` of the sweep; the file of a point has its mean.

Which completed contacts and points of a sweep other plugins made than those in use now.

Every point and every contact names the plugins that took part in it, and the folder those that were asked about all of
them. A plugin that took part and is no longer in use in that version makes the point out of date. A plugin with hooks
that the folder does not know yet is asked, stage by stage: one that answers nothing changes nothing.
"""

from __future__ import annotations

import json
import math
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from chemage.contacts.solution import ContactSolution
from chemage.foundation.codec import to_json
from chemage.foundation.errors import (
    DamagedError,
    InputError,
    PlanWarning,
    SceneError,
    StoreError,
)
from chemage.foundation.files import make_folder
from chemage.foundation.memory import readable
from chemage.foundation.names import __version__
from chemage.foundation.progress import progress_bars
from chemage.foundation.text import jsonable
from chemage.foundation.units import in_words
from chemage.plugins.context import Plugins
from chemage.plugins.options import completed
from chemage.plugins.sources import changed, implementing, providers, would_change
from chemage.scene.files import located, override, scene_data
from chemage.scene.provenance import versions
from chemage.scene.run import ageing_of, surface_of
from chemage.scene.scene import Scene
from chemage.studies.ensembles.planning import plan
from chemage.studies.ensembles.running import Sampler
from chemage.studies.folder import Folder, SweepWarning, refuse_links
from chemage.studies.runner import Runner
from chemage.studies.study import Design, Selection, Study
from chemage.studies.sweeps.grid import PLACE, Grid, Survey, agree, points_of
from chemage.studies.sweeps.result import SweepResult
from chemage.studies.tasks import (
    Outcome,
    Place,
    Task,
    by_contact,
    failure,
    point_file,
)
from chemage.surfaces.surface import Surface

_CONTACT_HOOKS = ("chemage_make_surface", "chemage_solve_contact")
_AGEING_HOOKS = (
    "chemage_build_lattice",
    "chemage_run_kinetics",
    "chemage_rupture_bonds",
    "chemage_pull_bonds",
    "chemage_observe",
)


class Outdated:
    """What must be computed again of the completed part of ``folder``, whose manifest is ``there``, because plugins
    changed."""

    def __init__(
        self, folder: Folder, survey: Survey, there: Mapping[str, Any]
    ) -> None:
        self._folder, self._survey = folder, survey
        #: keys
        self._points: set[str] = set()
        self._contacts: set[str] = set()
        #: plugin -> what changed, in words
        self._reasons: dict[str, str] = {}
        asked = there.get("asked", {})
        new = {
            name
            for name, source in survey.hooks.items()
            if asked.get(name) != source
        }
        self._new_in_contact = [
            name for name in implementing(*_CONTACT_HOOKS) if name in new
        ]
        self._new_in_ageing = [
            name for name in implementing(*_AGEING_HOOKS) if name in new
        ]
        self._surface: tuple[str, Surface] | None = None
        for ageings in by_contact(survey.tasks):
            self._compare([task for tasks in ageings for task in tasks])

    def __bool__(self) -> bool:
        return bool(self._points or self._contacts)

    def describe(self) -> str:
        """One sentence for users."""
        what = f"{len(self._points)} points and {len(self._contacts)} contacts are computed again"
        return (
            f"{what}, because plugins changed: {'; '.join(self._reasons.values())}"
        )

    def remove(self) -> None:
        """Remove the files."""
        for key in self._points:
            self._folder.point(key).unlink(missing_ok=True)
        for key in self._contacts:
            self._folder.contact(key).unlink(missing_ok=True)

    def _compare(self, tasks: list[Task]) -> None:
        """Compare what is done of the tasks of one contact with the plugins in use."""
        keys = {task.key: task for task in tasks}
        done = {
            key: content
            for key in keys
            if (content := self._folder.read_point(key))["status"] == "done"
        }
        touched = {
            key
            for key, content in done.items()
            if self._changed(content.get("plugins", {}))
        }
        if not (touched or self._new_in_contact or self._new_in_ageing or not done):
            return
        first = tasks[0]
        solution = self._folder.intact_contact(first.contact)
        if solution is None:
            self._points |= touched
            return
        if self._changed(solution.plugins) or self._contact_would_change(
            first.scene, first.surface, solution
        ):
            self._contacts.add(first.contact)
            self._points |= set(done)
            return
        for key in done:
            if key in touched or self._ageing_would_change(
                keys[key].scene, solution
            ):
                self._points.add(key)

    def _changed(self, recorded: Plugins) -> bool:
        # options of plugins are in the keys of the points
        changes = changed(recorded, options=False)
        for name, (then, now) in changes.items():
            self._reasons[name] = f"{name} was {then} and is {now}"
        return bool(changes)

    def _contact_would_change(
        self, scene: Scene, key: str, solution: ContactSolution
    ) -> bool:
        new = self._new_in_contact
        if not new:
            return False
        with scene.in_use():
            if self._surface is None or self._surface[0] != key:
                self._surface = key, surface_of(scene)
            surface = self._surface[1]
            took_part = [name for name in new if name in surface.plugins]
            arguments = {
                "solver": scene.solver,
                "surface": surface,
                "load": solution.load,
                "start": None,
            }
            if not took_part and would_change(
                new, "chemage_solve_contact", solution, **arguments
            ):
                took_part = new
        return self._joined(took_part)

    def _ageing_would_change(self, scene: Scene, solution: ContactSolution) -> bool:
        # one replica goes through all stages after the contact
        ageing = (
            ageing_of(scene, solution, replicas=1) if self._new_in_ageing else None
        )
        if ageing is None:
            return False
        provide = providers(*scene.components())
        return self._joined(
            [
                name
                for name in self._new_in_ageing
                if name in ageing.plugins and name not in provide
            ]
        )

    def _joined(self, names: list[str]) -> bool:
        for name in names:
            self._reasons.setdefault(
                name,
                f"{name} ({self._survey.hooks[name]}) answers or changes them now",
            )
        return bool(names)


#: the folder of samples within that of a sweep
SAMPLES = "samples"
#: means that are planned to foresee what all of them cost
PLANNED = 5


class Points(Design):
    """The points of a sweep that are left, as a design: all of them are asked for at once.

    Parameters
    ----------
    chosen
        Numbers of the points to compute.
    """

    def __init__(
        self, folder: Folder, survey: Survey, chosen: Sequence[int]
    ) -> None:
        self._folder, self._survey = folder, survey
        #: where the results of tasks are kept
        self.place = Place(str(folder.path), survey.digest)
        self.points = chosen
        self._same: dict[str, list[int]] = {}
        for point in self.points:
            self._same.setdefault(survey.tasks[point].key, []).append(point)
        states = {key: folder.state(key) for key in self._same}
        self._left = [key for key, state in states.items() if state != "done"]
        #: key of each contact -> the key of a point that has it, one that is left if there is any
        contacts = {
            survey.tasks[self._same[key][0]].contact: key
            for key in (*states, *self._left)
        }
        self.contacts = len(contacts)
        spoilt = (
            ()
            if survey.means
            else [key for key in contacts if folder.contact_state(key) == "damaged"]
        )
        self._damaged = [
            folder.point(key) for key, state in states.items() if state == "damaged"
        ]
        self._damaged += [folder.contact(key) for key in spoilt]
        #: points that are done, of which the contact is damaged
        self._mended = [
            contacts[key] for key in spoilt if states[contacts[key]] == "done"
        ]
        self.done = sum(
            len(self._same[key]) for key, state in states.items() if state == "done"
        )
        self.failed: dict[int, str] = {}
        #: samples that were taken, where points are means
        self.samples: int | None = None

    @property
    def left(self) -> int:
        """Number of different points that are not computed yet, and of contacts that are damaged."""
        return len(self._left) + len(self._mended)

    def ask(self) -> list[Task]:
        """See :class:`chemage.studies.study.Design`."""
        tasks = [self._survey.task(self._same[key][0]) for key in self._left]
        tasks += [
            self._survey.task(self._same[key][0], contact_only=True)
            for key in self._mended
        ]
        self._left, self._mended = [], []
        return tasks

    def tell(self, task: Task, outcome: Outcome) -> None:
        """See :class:`chemage.studies.study.Design`."""
        same = self._same[task.key]
        if task.contact_only:
            return
        if outcome.error is None:
            self.done += len(same)
        else:
            self.failed.update(dict.fromkeys(same, str(outcome.error)))

    def warn_of_damage(self) -> None:
        """Name the damaged files, which are computed again."""
        if self._damaged:
            names = [
                str(path.relative_to(self._folder.path))
                for path in self._damaged[:5]
            ]
            more = ", ..." if len(self._damaged) > 5 else ""
            message = f"{len(self._damaged)} files are damaged and are computed again: {', '.join(names)}{more}"
            warnings.warn(
                f"{self._folder.path}: {message}", SweepWarning, stacklevel=3
            )


def expected_seconds(survey: Survey) -> float | None:
    """CPU time of all means, s, from the plans of some of them; None where one is not known before it begins."""
    means = list({task.key: task for task in survey.tasks}.values())
    some = means[:: math.ceil(len(means) / PLANNED)]
    seconds = [plan(task.scene).cpu_seconds for task in some]
    finite = [estimate for estimate in seconds if estimate is not None]
    return (
        sum(finite) * len(means) / len(some) if len(finite) == len(some) else None
    )


class Means(Points):
    """The means of points that are left."""

    def __init__(
        self, folder: Folder, survey: Survey, chosen: Sequence[int]
    ) -> None:
        super().__init__(folder, survey, chosen)
        self.place = Place(str(folder.path / SAMPLES), contacts=False)
        self.samples = 0
        #: key of a point -> its mean
        self._means: dict[str, Sampler] = {}
        #: key of a task -> keys of the points that asked for it
        self._asking: dict[str, list[str]] = {}

    def ask(self) -> list[Task]:
        """See :class:`chemage.studies.study.Design`."""
        tasks: dict[str, Task] = {}
        self._asking = {}
        left, self._left = self._left, []
        for key in (*self._means, *left):
            try:
                if key not in self._means:
                    scene = self._survey.tasks[self._same[key][0]].scene
                    self._means[key] = Sampler(scene, warn=False)
                needed = self._means[key].ask()
            except (Exception, SystemExit) as error:
                self._end(key, error)
                continue
            if not needed:
                self._end(key)
            for task in needed:
                tasks[task.key] = task
                self._asking.setdefault(task.key, []).append(key)
        return list(tasks.values())

    def tell(self, task: Task, outcome: Outcome) -> None:
        """See :class:`chemage.studies.study.Design`."""
        self.samples = (self.samples or 0) + (not outcome.kept)
        for key in self._asking[task.key]:
            if key not in self._means:
                continue
            try:
                self._means[key].tell(task, outcome)
            except Exception as error:
                self._end(key, error, outcome.stage or "ageing")

    def _end(
        self, key: str, error: BaseException | None = None, stage: str = "mean"
    ) -> None:
        """Write the file of a point."""
        points, mean = self._same[key], self._means.pop(key, None)
        task = self._survey.tasks[points[0]]
        if error is not None:
            self._folder.write_point(key, failure(task, stage, error))
            self.failed.update(dict.fromkeys(points, str(error)))
            return
        assert mean is not None
        ensemble = mean.ensemble()
        content = point_file(
            task,
            "done",
            plugins=dict(ensemble.plugins),
            summary=jsonable(ensemble.summary()),
            ageing=None,
            ensemble=to_json(ensemble),
        )
        self._folder.write_point(key, content)
        self.done += len(points)


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a sweep at one moment."""

    #: ``validating`` or ``computing``
    stage: str
    points: int
    #: points validated, or completed
    done: int
    failed: int
    contacts: int
    contacts_done: int
    #: concurrent tasks
    workers: int
    #: wall time since this call began, s
    elapsed: float
    #: estimated remaining wall time, s; None before the first task has ended
    remaining: float | None
    #: samples that were taken, where the points are means over surfaces
    samples: int | None = None

    def __str__(self) -> str:
        if self.stage == "validating":
            return f"sweep: {self.done} of {self.points} points validated, {_left(self.remaining)}"
        failed = f", {self.failed} failed" if self.failed else ""
        if self.samples is not None:
            return f"sweep: {self.done} of {self.points} means{failed}, {self.samples} samples so far"
        return (
            f"sweep: {self.done} of {self.points} points{failed}, {self.contacts_done} of {self.contacts} contacts, "
            f"{_left(self.remaining)}"
        )


#: receives the progress of a sweep, several times a second
Report = Callable[[SweepProgress], None]


@contextmanager
def show_progress() -> Iterator[Report]:
    """Show the progress of a sweep on stderr, as :func:`chemage.foundation.progress.progress_bars` does."""
    units = dict.fromkeys(("validating", "points"), "points") | {
        "contacts": "contacts"
    }
    with progress_bars(units) as bar:

        def draw(state: SweepProgress) -> None:
            left = _left(state.remaining)
            if state.stage == "validating":
                bar("validating", state.done, state.points, left)
                return
            if state.samples is None:
                bar("contacts", state.contacts_done, state.contacts)
            else:
                left = f"{state.samples} samples so far"
            failed = f"{state.failed} failed, " if state.failed else ""
            bar("points", state.done + state.failed, state.points, failed + left)

        yield draw


def _left(seconds: float | None) -> str:
    if seconds is None:
        return "remaining time not known yet"
    whole = round(seconds)
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min left"
    return (
        f"{whole // 60} min {whole % 60:02d} s left"
        if whole >= 60
        else f"{whole} s left"
    )


#: sweeps of more points need confirmation before they are validated
MANY_POINTS = 100_000
#: fraction of the free disk space that results may fill without confirmation
DISK_SHARE = 0.9


#: receives a description of what needs confirmation, and returns whether the sweep may continue
Confirm = Callable[[str], bool]


# -- before the first task --------------------------------------------------------------------------------------------


def read_grid(
    scene: Scene | str | Path | Mapping[str, Any],
    changes: Mapping[str, Any] | None = None,
    axes: Mapping[str, Any] | None = None,
) -> Grid:
    """Read the grid of a scene, a scene file, an installed scene, or scene data, with dotted-path ``changes`` to the
    base; ``axes`` are in place of ``[sweep]``.

    Raises
    ------
    SceneError
        ``[sweep]`` is missing or not valid.
    """
    content = scene.completed().todict() if isinstance(scene, Scene) else scene
    data, source = (
        (dict(content), "the scene")
        if isinstance(content, Mapping)
        else scene_data(content)
    )
    data = completed(in_words(override(data, changes or {})))
    if axes is not None:
        data["sweep"] = in_words(axes)
    if "sweep" not in data:
        raise SceneError(
            source,
            [
                (
                    "sweep",
                    "is missing: this scene is one point; use chemage.run, or give axes",
                )
            ],
        )
    try:
        plain = json.loads(json.dumps(located(data, Path.cwd())))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{source}: a scene may hold numbers, strings, lists and tables only: {error}"
        ) from None
    return Grid.read(plain, source)


def survey_of(
    grid: Grid, *, progress: Report | None = None, confirm: Confirm | None = None
) -> Survey:
    """Validate every point; more than ``MANY_POINTS`` points only if ``confirm`` returns True.

    Raises
    ------
    SceneError
        A point is not valid.
    InputError
        There are too many points, and ``confirm`` did not return True.
    """
    begin = last = time.perf_counter()
    if grid.size > MANY_POINTS:
        _require_confirmation(
            f"the sweep has {grid.size} points ({grid.product})", confirm
        )

    def report(validated: int, total: int) -> None:
        nonlocal last
        now = time.perf_counter()
        if progress is not None and (now > last + 0.2 or validated == total):
            last = now
            left = (now - begin) * (total - validated) / validated
            progress(
                SweepProgress(
                    "validating", total, validated, 0, 0, 0, 1, now - begin, left
                )
            )

    return Survey.of(grid, report)


def _require_confirmation(what: str, confirm: Confirm | None) -> None:
    if confirm is None or not confirm(what):
        raise InputError(
            f"{what}; nothing was computed. Reduce the sweep, or confirm it (--yes, or confirm=True)"
        )


def room_for(path: Path) -> int:
    """Free disk space where ``path`` is or will be, bytes."""
    place = path.absolute()
    return shutil.disk_usage(
        next(one for one in (place, *place.parents) if one.exists())
    ).free


def _check_room(survey: Survey, path: Path, confirm: Confirm | None) -> None:
    """Ask for confirmation where the disk may be too small; warn of what is doubtful about the points."""
    need, room = survey.bytes, room_for(path)
    if need > DISK_SHARE * room:
        _require_confirmation(
            f"the {survey.grid.size} points and {len(survey.contacts)} contacts may need {readable(need)}, but "
            f"{path.absolute().parent} has {readable(room)} left",
            confirm,
        )
    for text in survey.warnings():
        warnings.warn(text, PlanWarning, stacklevel=4)


def _check_folder(folder: Folder, survey: Survey, force: bool) -> None:
    """Refuse a folder that is not of a sweep, or of another sweep unless that is to be replaced."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise StoreError(f"{path} is a file; a sweep is computed into a folder")
    refuse_links(path, SAMPLES)
    refuse_links(path / SAMPLES)
    # what another process makes before the manifest
    begun = {".lock", ".parts", PLACE}
    if not path.exists() or {entry.name for entry in path.iterdir()} <= begun:
        return
    if not folder.manifest.exists():
        raise StoreError(
            f"{path} is not empty and holds no sweep; choose another folder"
        )
    if force:
        return
    try:
        there = folder.read_manifest()
    except DamagedError as error:
        if not any(folder.point(task.key).exists() for task in survey.tasks):
            raise
        warnings.warn(f"{error}; it is written again", SweepWarning, stacklevel=4)
        return
    _check_same(folder, survey, there)
    now, then = versions(), there["versions"]
    changed = [
        f"{name} {then[name]} -> {now[name]}"
        for name in now
        if name in then and then[name] != now[name]
    ]
    if changed:
        warnings.warn(
            f"{path} was begun with other versions ({', '.join(changed)}); it will hold points of both",
            SweepWarning,
            stacklevel=4,
        )


def _check_same(folder: Folder, survey: Survey, there: Mapping[str, Any]) -> None:
    """Refuse a manifest of another sweep."""
    if there["digest"] == survey.digest:
        return
    old, new = Grid.fromdict(there["grid"]), survey.grid
    different = sum(
        a != b for a, b in zip(there["keys"], survey.keys, strict=False)
    )
    difference = f"{different} of its {new.size} points differ"
    if [axis.paths for axis in old.axes] != [axis.paths for axis in new.axes]:
        difference = f"over {', '.join(axis.name for axis in old.axes)}"
    elif old.shape != new.shape:
        difference = f"{old.product} points instead of {new.product}"
    raise StoreError(
        f"{folder.path} holds another sweep ({difference}); choose another folder"
    )


def _outdated(folder: Folder, survey: Survey, *, whole: bool) -> Outdated | None:
    if not folder.manifest.exists():
        return None
    stale = Outdated(folder, survey, folder.intact_manifest() or {})
    if not stale:
        return None
    if not whole:
        raise StoreError(
            f"{folder.path}: {stale.describe()}; one process must do so: rerun the command without --points, or choose "
            "another folder"
        )
    warnings.warn(f"{folder.path}: {stale.describe()}", SweepWarning, stacklevel=4)
    return stale


def _describe_first(folder: Folder, survey: Survey) -> None:
    """Write the manifest unless another process has, whose manifest must be of this sweep."""
    folder.write_manifest(survey.manifest(), first=True)
    there = folder.intact_manifest()
    if there is None:
        folder.write_manifest(survey.manifest())
        return
    _check_same(folder, survey, there)
    if (version := there["versions"]["chemage"]) != __version__:
        raise StoreError(
            f"{folder.path} was begun by chemage {version}, and this is {__version__}; compute all shares with one "
            "version, or finish it with one process (without --points)"
        )


# -- the sweep --------------------------------------------------------------------------------------------------------


def sweep(
    scene: Scene | str | Path | Mapping[str, Any],
    out: str | Path,
    *,
    axes: Mapping[str, Any] | None = None,
    accuracy: Mapping[str, Any] | None = None,
    executor: str | Executor | None = None,
    workers: int | None = None,
    threads: int | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: Report | bool | None = None,
    confirm: Confirm | bool = False,
    force: bool = False,
    points: str | None = None,
    patience: float | str | None = None,
) -> SweepResult:
    """Compute every point of a scene with ``[sweep]`` into the folder ``out``; completed points are skipped.

    Parameters
    ----------
    scene, axes
        A scene file, the name of an installed scene, scene data (a mapping), or a :class:`chemage.Scene`; dotted path
        -> values in place of its ``[sweep]``, such as ``{"contact.load": ["1 uN", "2 uN"]}``.
    out
        A new folder, or the folder of this sweep, which then resumes.
    accuracy
        Each point is a mean over random surfaces to this accuracy, such as ``{"beta": "2 %"}``, as for
        :func:`chemage.ensemble`; in place of ``[accuracy]`` of the scene.
    executor, workers, threads, patience
        Where to compute (default: ``serial``, means: ``threads``), concurrent points, threads of each, and how long to
        wait for workers of Dask or other shares, see :func:`chemage.studies.runner.open_pool`; results do not depend on
        them.
    changes
        Dotted path -> value: changes to the scene before it is swept.
    progress
        Receives a ``SweepProgress`` several times a second; True shows it on stderr.
    confirm
        Receives a question about very many points or little free disk space, and returns the answer; True: always.
    force
        Replace the results in ``out`` and compute all points.
    points
        Compute a part of the points only, while other processes may compute others into the same folder: ``"3/16"``,
        the third of sixteen shares; ``"3,7,12-20"``, numbers of points; ``"auto"``, the share of this task of a job
        array. No tables are written; see :func:`chemage.collect_sweep`.

    Returns
    -------
    SweepResult
        All points; those that failed are in ``SweepResult.failed`` and are tried again by the next call.

    Raises
    ------
    SceneError
        A point is not valid; all points are validated before the first is computed.
    InputError
        The sweep needs confirmation; an argument is not valid; or workers cannot import a component.
    StoreError
        ``out`` holds something else, or cannot be written.
    ExecutorError
        The workers cannot be started, or have ended.
    """
    begin = time.perf_counter()
    if accuracy is not None:
        changes = {
            **(changes or {}),
            "accuracy": dict(accuracy),
            "ensemble.surfaces": None,
        }
    if points is not None and force:
        raise InputError(
            "a part of the points cannot replace a sweep: give force (--force) without points (--points)"
        )
    selection = None if points is None else Selection.read(points)
    confirmed = (lambda text: True) if confirm is True else (confirm or None)
    with ExitStack() as stack:
        report = (
            stack.enter_context(show_progress())
            if progress is True
            else progress or None
        )
        survey = survey_of(
            read_grid(scene, changes, axes), progress=report, confirm=confirmed
        )
        executor = executor or ("threads" if survey.means else "serial")
        study = stack.enter_context(
            Study(executor, workers, threads, patience, classes=survey.classes)
        )
        folder = Folder(Path(out).absolute())
        _check_folder(folder, survey, force)
        _check_room(survey, folder.path, confirmed)
        design = _begin(stack, study, folder, survey, selection, force)
        # of means, shares compute the samples
        share = selection.share if survey.means and selection is not None else None
        study.carry_out(
            design, design.place, share, _watched(report, begin, design)
        )
        return _finished(folder, whole=selection is None)


def _finished(folder: Folder, *, whole: bool) -> SweepResult:
    """The results; of a whole sweep with its tables."""
    result = SweepResult(folder.path)
    if whole:
        result.write_tables()
        for name in (".parts", f"{SAMPLES}/.parts", PLACE):
            shutil.rmtree(folder.path / name, ignore_errors=True)
    return result


def _begin(
    stack: ExitStack,
    study: Study,
    folder: Folder,
    survey: Survey,
    selection: Selection | None,
    force: bool,
) -> Points:
    """Make the folder, lock it against other calls unless both compute parts of the points, and say what is left."""
    stale = None if force else _outdated(folder, survey, whole=selection is None)
    # raises before anything is written if the workers cannot be started
    if force or stale or _design(folder, survey, selection).left:
        study.open()
    make_folder(folder.path, links=True)
    stack.enter_context(folder.locked(shared=selection is not None))
    if selection is not None:
        folder.make_parts()
        _describe_first(folder, survey)
        if selection.share is not None and not survey.means:
            agree(folder, survey, selection.share[1])
    else:
        if force:  # only what is of a sweep; the manifest last, so that the folder stays recognisable as that of one
            for name in ("points", "contacts", SAMPLES, ".parts"):
                shutil.rmtree(folder.path / name, ignore_errors=True)
            for name in ("results.csv", "results.h5", "sweep.json"):
                (folder.path / name).unlink(missing_ok=True)
        folder.clear_parts()
        if stale is not None:
            stale.remove()
        there = folder.intact_manifest()
        if there is None or there.get("asked", {}) != survey.hooks:
            # which plugins were asked about all that is complete
            folder.write_manifest(
                survey.manifest()
                if there is None
                else {**there, "asked": survey.hooks}
            )
    design = _design(folder, survey, selection)
    design.warn_of_damage()
    return design


def _design(folder: Folder, survey: Survey, selection: Selection | None) -> Points:
    """What this process computes."""
    return (Means if survey.means else Points)(
        folder, survey, points_of(selection, folder, survey)
    )


def _watched(
    report: Report | None, begin: float, points: Points
) -> Callable[[Runner], None] | None:
    """What a runner calls while it computes ``points``, to ``report`` how far it is."""
    if report is None:
        return None

    def watch(runner: Runner) -> None:
        report(
            SweepProgress(
                "computing",
                len(points.points),
                points.done,
                len(points.failed),
                points.contacts,
                points.contacts - runner.unsolved,
                runner.width,
                time.perf_counter() - begin,
                runner.remaining(),
                points.samples,
            )
        )

    return watch
