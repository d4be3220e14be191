"""The points of a sweep as a design: one surface each, or each a mean over surfaces.

Means that differ in temperature or chemistry have their surfaces in common, and so their contacts. Their samples are
kept in the folder ``samples`` of the sweep; the file of a point has its mean.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any

from chemage.foundation.codec import to_json
from chemage.foundation.errors import ChemageError
from chemage.foundation.text import jsonable
from chemage.studies.ensembles.ensemble import Ensemble
from chemage.studies.ensembles.planning import plan
from chemage.studies.ensembles.running import Sampler
from chemage.studies.folder import Folder, SweepWarning
from chemage.studies.sweeps.grid import Survey
from chemage.studies.tasks import Outcome, Place, Task, failure

#: the folder of samples within that of a sweep
SAMPLES = "samples"
#: means that are planned to foresee what all of them cost
PLANNED = 20


class Points:
    """The points of a sweep that are left, as a design: all of them are asked for at once.

    Parameters
    ----------
    chosen
        Numbers of the points to compute; None for all of them.
    """

    def __init__(self, folder: Folder, survey: Survey, chosen: Sequence[int] | None = None) -> None:
        self._folder, self._survey = folder, survey
        #: where the results of tasks are kept
        self.place = Place(str(folder.path), survey.digest)
        self.points = range(len(survey.keys)) if chosen is None else chosen
        self._same: dict[str, list[int]] = {}
        for point in self.points:
            self._same.setdefault(survey.keys[point], []).append(point)
        states = {key: folder.state(key) for key in self._same}
        self._left = [key for key, state in states.items() if state != "done"]
        self._damaged = [folder.point(key) for key, state in states.items() if state == "damaged"]
        self.contacts = len({survey.contact_of[point] for point in self.points})
        self.done = sum(len(self._same[key]) for key, state in states.items() if state == "done")
        self.failed: dict[int, str] = {}
        #: samples that were taken, where points are means
        self.samples: int | None = None

    @property
    def left(self) -> int:
        """Number of different points that are not computed yet."""
        return len(self._left)

    def ask(self) -> list[Task]:
        """See :class:`chemage.studies.study.Design`."""
        left, self._left = self._left, []
        return [self._survey.task(self._same[key][0]) for key in left]

    def tell(self, task: Task, outcome: Outcome) -> None:
        """See :class:`chemage.studies.study.Design`."""
        same = self._same[task.key]
        if outcome.error is None:
            self.done += len(same)
        else:
            self.failed.update(dict.fromkeys(same, str(outcome.error)))

    def warn_of_damage(self) -> None:
        """Name the damaged files, which are computed again."""
        contacts = {self._survey.contact_of[self._same[key][0]] for key in self._left}
        paths = [self._folder.contact(self._survey.contacts[number].key) for number in sorted(contacts)]
        damaged = self._damaged + [path for path in paths if path.exists() and not self._folder.has_contact(path.stem)]
        if damaged:
            names = [str(path.relative_to(self._folder.path)) for path in damaged[:5]]
            more = ", ..." if len(damaged) > 5 else ""
            message = f"{len(damaged)} files are damaged and are computed again: {', '.join(names)}{more}"
            warnings.warn(f"{self._folder.path}: {message}", SweepWarning, stacklevel=3)


def expected_seconds(survey: Survey) -> float | None:
    """CPU time of all means, s, from the plans of some of them; None where one is not known before it begins."""
    points = list(dict(zip(survey.keys, range(len(survey.keys)), strict=True)).values())
    some = points[:: math.ceil(len(points) / PLANNED)]
    seconds = [plan(survey.grid.scene(point)).cpu_seconds for point in some]
    finite = [estimate for estimate in seconds if estimate is not None]
    return sum(finite) * len(points) / len(some) if len(finite) == len(some) else None


class Means(Points):
    """The means of points that are left."""

    def __init__(self, folder: Folder, survey: Survey, chosen: Sequence[int] | None = None) -> None:
        super().__init__(folder, survey, chosen)
        self.place = Place(str(folder.path / SAMPLES), contacts=False)
        self.samples = 0
        #: key of a point -> its mean
        self._means: dict[str, Sampler] = {}
        #: key of a task -> keys of the points that asked for it
        self._asking: dict[str, list[str]] = {}

    def ask(self) -> list[Task]:
        """See :class:`chemage.studies.study.Design`."""
        for key in self._left:
            point = self._same[key][0]
            try:
                self._means[key] = Sampler(self._survey.grid.scene(point), samples=self.place.path, warn=False)
            except ChemageError as error:
                self._end(key, error)
        self._left = []
        tasks: dict[str, Task] = {}
        self._asking = {}
        for key, mean in tuple(self._means.items()):
            try:
                needed = mean.ask()
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
        self.samples = (self.samples or 0) + 1
        for key in self._asking[task.key]:
            if key not in self._means:
                continue
            try:
                self._means[key].tell(task, outcome)
            except Exception as error:
                self._end(key, error, outcome.stage or "ageing")

    def _end(self, key: str, error: BaseException | None = None, stage: str = "mean") -> None:
        """Write the file of a point."""
        points = self._same[key]
        changes = self._survey.grid.changes(points[0])
        mean = self._means.pop(key, None)
        if error is not None or mean is None:
            assert error is not None
            self._folder.write_point(key, failure(points[0], changes, stage, error))
            self.failed.update(dict.fromkeys(points, str(error)))
            return
        self._folder.write_point(key, _content(mean.ensemble(), points[0], changes))
        self.done += len(points)


def _content(mean: Ensemble, point: int, changes: dict[str, Any]) -> dict[str, Any]:
    return {
        "status": "done",
        "point": point,
        "changes": changes,
        "plugins": dict(mean.plugins),
        "summary": jsonable(mean.summary()),
        "aging": None,
        "ensemble": to_json(mean),
    }
