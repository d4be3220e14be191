"""The tasks of a sweep that are left, and an estimate of the time that they take."""

from __future__ import annotations

import math
import time
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from chemage.foundation.errors import WorkerLost
from chemage.sweeps.claims import Claims
from chemage.sweeps.folder import Folder, SweepWarning
from chemage.sweeps.grid import Survey, order_of
from chemage.sweeps.tasks import failure

#: time between two looks for what other processes have completed, s
LOOK = 0.5


@dataclass
class Task:
    """A contact to solve, or points with the same ageing."""

    contact: int
    points: list[int]
    weight: float
    #: what processes that compute at the same time call it
    name: str
    #: whether no other task runs at the same time, so that a worker that dies must have died of this one
    alone: bool = False
    #: whether it is to solve the contact
    solves: bool = False


class Todo:
    """The tasks that are left, in an order in which successive contacts share a surface.

    Parameters
    ----------
    folder, found
        The folder of the sweep and its points.
    points
        Numbers of the points to compute; None for all of them.
    claims
        The claims of this process, where others compute points of the same sweep at the same time: a task that another
        process has claimed is left to it.
    """

    def __init__(
        self, folder: Folder, found: Survey, points: Sequence[int] | None = None, claims: Claims | None = None
    ) -> None:
        self.folder, self.found, self._claims = folder, found, claims
        self.points = range(len(found.keys)) if points is None else points
        states: dict[str, str] = {}
        for point in self.points:
            if (key := found.keys[point]) not in states:
                states[key] = folder.state(key)
        self.done = sum(states[found.keys[point]] == "done" for point in self.points)
        self.damaged = [folder.point(key) for key, state in states.items() if state == "damaged"]
        self.failed: dict[int, str] = {}
        groups: dict[str, list[int]] = {}
        claimed: set[str] = set()
        self._same: dict[str, list[int]] = {}
        for point in self.points:
            key = found.keys[point]
            self._same.setdefault(key, []).append(point)
            if states[key] != "done" and key not in claimed:
                claimed.add(key)
                groups.setdefault(found.agings[point], []).append(point)
        self._waiting: dict[int, list[Task]] = {}
        for members in groups.values():
            cost = found.cpu_seconds[members[0]]
            weight = math.nan if cost is None else cost + 1e-3
            task = Task(found.contact_of[members[0]], members, weight, f"ageing-{found.agings[members[0]]}")
            self._waiting.setdefault(task.contact, []).append(task)
        self._ready: deque[Task] = deque()
        self._contacts: deque[Task] = deque()
        self.contacts = len({found.contact_of[point] for point in self.points})
        self.contacts_done = self.contacts - len(self._waiting)
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
                weight = math.nan if cost is None else cost + 1e-3
                self._contacts.append(Task(number, [], weight, f"contact-{key}", solves=True))
        self._elsewhere: list[Task] = []
        self._looked = 0.0
        # what failed before is tried again; what fails from now on in another process is not
        self._failed_before = {key: _identity(folder, key) for key, state in states.items() if state == "failed"}
        self._unsolved_before = {
            task.contact: known[1]
            for task in self._contacts
            if claims is not None and (known := claims.failure(task.name)) is not None
        }

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

    @property
    def elsewhere(self) -> int:
        """Number of tasks that other processes compute."""
        return len(self._elsewhere)

    def take(self, solving: int, width: int) -> Task | None:
        """Take the next task while ``solving`` contacts are being solved on ``width`` workers.

        Points come first, while a worker still has their contact in memory; but half of the workers solve contacts, so
        that the last contact does not start after everything else has ended.

        Returns
        -------
        Task or None
            None if another process computes it, or has computed it.
        """
        if self._contacts and (not self._ready or solving < width // 2):
            task = self._contacts.popleft()
        else:
            task = self._ready.popleft()
        return task if self._claims is None or self._claimed(task, self._claims) else None

    def look_elsewhere(self) -> None:
        """Take back the tasks that other processes have completed or given up; looks once in ``LOOK`` seconds."""
        now = time.monotonic()
        if self._claims is None or now < self._looked + LOOK:
            return
        self._looked = now
        waiting, self._elsewhere = self._elsewhere, []
        for task in waiting:
            if not self._claims.free(task.name):
                self._elsewhere.append(task)
            elif task.solves:
                self._contacts.append(task)
            else:
                self._ready.append(task)

    def remaining(self) -> tuple[list[float], list[float]]:
        """The weights of the tasks that are not submitted: contacts, points."""
        points = [task.weight for task in self._ready]
        points += [task.weight for tasks in self._waiting.values() for task in tasks]
        points += [task.weight for task in self._elsewhere if not task.solves]
        contacts = [task.weight for task in (*self._contacts, *self._elsewhere) if task.solves]
        return contacts, points

    def finished(self, task: Task, answer: Mapping[str, Any]) -> None:
        """Record the end of a task that this process has computed."""
        if task.solves:
            self._solved(task, answer.get("error"))
            if self._claims is not None and "error" in answer:
                self._claims.failed(task.name, answer["error"])
        else:
            failed: Mapping[int, str] = answer.get("failed", {})
            for point in task.points:
                self._ended(point, failed.get(point))
        if self._claims is not None:
            self._claims.release(task.name)

    def lost(self, task: Task, error: WorkerLost) -> None:
        """Record a task whose workers died."""
        found = failure(0, {}, "contact" if task.solves else "ageing", error)["error"]
        if not task.solves:
            self._record(task.points, found)
        self.finished(task, {"error": found, "failed": dict.fromkeys(task.points, str(found["message"]))})

    def _solved(self, task: Task, error: Mapping[str, Any] | None) -> None:
        self.contacts_done += 1
        dependents = self._waiting.pop(task.contact)
        if error is None:
            self._ready.extend(dependents)
            return
        for group in dependents:
            self._record(group.points, error)
            for point in group.points:
                self._ended(point, str(error["message"]))

    def _ended(self, point: int, message: str | None) -> None:
        same = self._same[self.found.keys[point]]
        if message is None:
            self.done += len(same)
        else:
            self.failed.update(dict.fromkeys(same, message))

    def _record(self, points: list[int], error: Mapping[str, Any]) -> None:
        for point in points:
            content = {"status": "failed", "point": point, "changes": self.found.grid.changes(point), "error": error}
            self.folder.write_point(self.found.keys[point], content)

    # -- other processes --------------------------------------------------------------------------------------------

    def _claimed(self, task: Task, claims: Claims) -> bool:
        if self._completed(task, claims):
            return False
        if not claims.take(task.name):
            self._elsewhere.append(task)
            return False
        if self._completed(task, claims):  # immediately before
            claims.release(task.name)
            return False
        return True

    def _completed(self, task: Task, claims: Claims) -> bool:
        """Note what other processes have computed of a task; whether that is all of it."""
        if task.solves:
            if self.folder.has_contact(self.found.contacts[task.contact].key):
                self._solved(task, None)
                return True
            found = claims.failure(task.name)
            if found is None or found[1] == self._unsolved_before.get(task.contact):
                return False
            self._solved(task, found[0])
            return True
        missing = []
        for point in task.points:
            key = self.found.keys[point]
            state = self.folder.state(key)
            if state == "done":
                self._ended(point, None)
            elif state == "failed" and _identity(self.folder, key) != self._failed_before.get(key):
                self._ended(point, str(self.folder.read_point(key).get("error", {}).get("message", "")))
            else:
                missing.append(point)
        task.points[:] = missing
        return not missing


def _identity(folder: Folder, key: str) -> tuple[int, int]:
    """What differs between two versions of the file of a point."""
    try:
        state = folder.point(key).stat()
    except OSError:
        return 0, 0
    return state.st_ino, state.st_mtime_ns


@dataclass
class Clock:
    """Estimates the remaining time from the duration of completed tasks."""

    seconds: dict[bool, float] = field(default_factory=lambda: {True: 0.0, False: 0.0})
    weight: dict[bool, float] = field(default_factory=lambda: {True: 0.0, False: 0.0})
    count: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})

    def add(self, task: Task, seconds: float) -> None:
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
