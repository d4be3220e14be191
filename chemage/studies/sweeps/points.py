"""The points of a sweep as a design: what is left of them, and what came of it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from chemage.studies.folder import Folder, SweepWarning
from chemage.studies.sweeps.grid import Survey
from chemage.studies.tasks import Outcome, Place, Task


class Points:
    """The points of a sweep that are left, as a design: all of them are asked for at once.

    Parameters
    ----------
    chosen
        Numbers of the points to compute; None for all of them.
    """

    def __init__(self, folder: Folder, found: Survey, chosen: Sequence[int] | None = None) -> None:
        self._folder, self._found = folder, found
        #: where the results of tasks are kept
        self.place = Place(str(folder.path), found.digest)
        self.points = range(len(found.keys)) if chosen is None else chosen
        self._same: dict[str, list[int]] = {}
        for point in self.points:
            self._same.setdefault(found.keys[point], []).append(point)
        states = {key: folder.state(key) for key in self._same}
        self._left = [key for key, state in states.items() if state != "done"]
        self._damaged = [folder.point(key) for key, state in states.items() if state == "damaged"]
        self.contacts = len({found.contact_of[point] for point in self.points})
        self.done = sum(len(self._same[key]) for key, state in states.items() if state == "done")
        self.failed: dict[int, str] = {}
        #: samples that were taken, where points are means
        self.samples: int | None = None

    @property
    def left(self) -> int:
        """Number of different points that are not computed yet."""
        return len(self._left)

    def ask(self) -> list[Task]:
        """See :class:`chemage.studies.design.Design`."""
        left, self._left = self._left, []
        return [self._found.task(self._same[key][0]) for key in left]

    def tell(self, task: Task, outcome: Outcome) -> None:
        """See :class:`chemage.studies.design.Design`."""
        same = self._same[task.key]
        if outcome.error is None:
            self.done += len(same)
        else:
            self.failed.update(dict.fromkeys(same, str(outcome.error)))

    def warn_of_damage(self) -> None:
        """Name the damaged files, which are computed again."""
        contacts = {self._found.contact_of[self._same[key][0]] for key in self._left}
        paths = [self._folder.contact(self._found.contacts[number].key) for number in sorted(contacts)]
        damaged = self._damaged + [path for path in paths if path.exists() and not self._folder.has_contact(path.stem)]
        if damaged:
            names = [str(path.relative_to(self._folder.path)) for path in damaged[:5]]
            more = ", ..." if len(damaged) > 5 else ""
            message = f"{len(damaged)} files are damaged and are computed again: {', '.join(names)}{more}"
            warnings.warn(f"{self._folder.path}: {message}", SweepWarning, stacklevel=3)
