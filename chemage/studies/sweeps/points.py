"""The points of a sweep as a design: one surface each, or each a mean over surfaces.

Means that differ in temperature or chemistry have their surfaces in common, and so their contacts. Their samples are
kept in the folder ``samples`` of the sweep; the file of a point has its mean.

Which completed contacts and points of a sweep other plugins made than those in use now.

Every point and every contact names the plugins that took part in it, and the folder those that were asked about all of
them. A plugin that took part and is no longer in use in that version makes the point out of date. A plugin with hooks
that the folder does not know yet is asked, stage by stage: one that answers nothing changes nothing.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from chemage.contacts.solution import ContactSolution
from chemage.foundation.codec import to_json
from chemage.foundation.text import jsonable
from chemage.plugins.context import Plugins
from chemage.plugins.sources import changed, implementing, providers, would_change
from chemage.scene.run import aging_of, surface_of
from chemage.scene.scene import Scene
from chemage.studies.ensembles.planning import plan
from chemage.studies.ensembles.running import Sampler
from chemage.studies.folder import Folder, SweepWarning
from chemage.studies.study import Design
from chemage.studies.sweeps.grid import Survey
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
            name for name, source in survey.hooks.items() if asked.get(name) != source
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
        return f"{what}, because plugins changed: {'; '.join(self._reasons.values())}"

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
            if key in touched or self._ageing_would_change(keys[key].scene, solution):
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
                "load": scene.load,
                "start": None,
            }
            if not took_part and would_change(
                new, "chemage_solve_contact", solution, **arguments
            ):
                took_part = new
        return self._joined(took_part)

    def _ageing_would_change(self, scene: Scene, solution: ContactSolution) -> bool:
        # one replica goes through all stages after the contact
        aging = aging_of(scene, solution, replicas=1) if self._new_in_ageing else None
        if aging is None:
            return False
        provide = providers(*scene.components())
        return self._joined(
            [
                name
                for name in self._new_in_ageing
                if name in aging.plugins and name not in provide
            ]
        )

    def _joined(self, names: list[str]) -> bool:
        for name in names:
            self._reasons.setdefault(
                name, f"{name} ({self._survey.hooks[name]}) answers or changes them now"
            )
        return bool(names)


#: the folder of samples within that of a sweep
SAMPLES = "samples"
#: means that are planned to foresee what all of them cost
PLANNED = 20


class Points(Design):
    """The points of a sweep that are left, as a design: all of them are asked for at once.

    Parameters
    ----------
    chosen
        Numbers of the points to compute.
    """

    def __init__(self, folder: Folder, survey: Survey, chosen: Sequence[int]) -> None:
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
                str(path.relative_to(self._folder.path)) for path in self._damaged[:5]
            ]
            more = ", ..." if len(self._damaged) > 5 else ""
            message = f"{len(self._damaged)} files are damaged and are computed again: {', '.join(names)}{more}"
            warnings.warn(f"{self._folder.path}: {message}", SweepWarning, stacklevel=3)


def expected_seconds(survey: Survey) -> float | None:
    """CPU time of all means, s, from the plans of some of them; None where one is not known before it begins."""
    means = list({task.key: task for task in survey.tasks}.values())
    some = means[:: math.ceil(len(means) / PLANNED)]
    seconds = [plan(task.scene).cpu_seconds for task in some]
    finite = [estimate for estimate in seconds if estimate is not None]
    return sum(finite) * len(means) / len(some) if len(finite) == len(some) else None


class Means(Points):
    """The means of points that are left."""

    def __init__(self, folder: Folder, survey: Survey, chosen: Sequence[int]) -> None:
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
            aging=None,
            ensemble=to_json(ensemble),
        )
        self._folder.write_point(key, content)
        self.done += len(points)
