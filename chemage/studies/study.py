"""A study: many runs that a design asks for, on an executor, and the folder in which their results are kept.

A design says what to compute next, and is told what came of it, until it asks for nothing more. A grid is a design, and
so are a mean over surfaces, which stops at an accuracy, and a map of speed against accuracy. Where their tasks are
computed changes no result.

What one of several processes computes: the third of sixteen shares, or points by their numbers.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from chemage.foundation.errors import ExecutorError, InputError, StoreError
from chemage.foundation.threads import restored
from chemage.plugins.sources import changed
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene
from chemage.studies.clusters import seconds
from chemage.studies.folder import RESUME, Folder, refuse_links
from chemage.studies.runner import Pool, Runner, open_pool
from chemage.studies.tasks import Outcome, Place, Task, for_workers, forget

#: largest number of shares
MANY_SHARES = 1_000_000
_FORM = "write the third of 16 shares as 3/16, points by their numbers as 3,7,12-20, or in a job array auto or auto/16"
_SHARE = re.compile(r"(\d{1,9})/(\d{1,9})")
_AUTO = re.compile(r"auto(?:/(\d{1,9}))?")
_NUMBERS = re.compile(r"\d{1,12}(-\d{1,12})?(,\d{1,12}(-\d{1,12})?)*")
#: the number of a task in a job array, by scheduler; first, last and step where the scheduler gives them
_ARRAYS = {
    "SLURM": ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_MAX", "SLURM_ARRAY_TASK_STEP"),
    "PBS": ("PBS_ARRAY_INDEX",),
    "Torque": ("PBS_ARRAYID",),
    "Grid Engine": ("SGE_TASK_ID", "SGE_TASK_FIRST", "SGE_TASK_LAST", "SGE_TASK_STEPSIZE"),
    "LSF": ("LSB_JOBINDEX",),
}


@dataclass(frozen=True)
class Selection:
    """The points that one process computes: one of several shares, or points by their numbers."""

    #: share and number of shares, the first is 1; None for numbers
    share: tuple[int, int] | None = None
    #: first and last number of each range, the first point is 0
    ranges: tuple[tuple[int, int], ...] = ()

    @classmethod
    def read(cls, text: str, environment: Mapping[str, str] | None = None) -> Selection:
        """Read ``3/16``, ``3,7,12-20``, ``auto`` or ``auto/16``.

        ``auto`` is the share that belongs to this task of a job array, by the variables of
        ``environment`` (default: that of this process).

        Raises
        ------
        InputError
            It is none of these, or the environment does not say which share it is.
        """
        compact = text.replace(" ", "")
        if auto := _AUTO.fullmatch(compact):
            compact = _share_of_array(text, auto[1], os.environ if environment is None else environment)
        if match := _SHARE.fullmatch(compact):
            number, count = int(match[1]), int(match[2])
            if not 1 <= number <= count <= MANY_SHARES:
                raise InputError.of(
                    "points", text, f"there is no share {number} of {count}; shares count from 1", _FORM
                )
            return cls(share=(number, count))
        if not _NUMBERS.fullmatch(compact):
            raise InputError.of("points", text, "not understood", _FORM)
        ranges = []
        for part in compact.split(","):
            first, _, last = part.partition("-")
            ranges.append((int(first), int(last or first)))
            if ranges[-1][0] > ranges[-1][1]:
                raise InputError.of("points", text, f"{part} ends before it begins", _FORM)
        return cls(ranges=tuple(ranges))

    def __str__(self) -> str:
        if self.share is not None:
            return f"{self.share[0]}/{self.share[1]}"
        return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in self.ranges)

    def describe(self) -> str:
        """What is computed, in words."""
        if self.share is not None:
            return f"share {self.share[0]} of {self.share[1]}"
        return f"points {self}"


def _share_of_array(text: str, count: str | None, environment: Mapping[str, str]) -> str:
    numbers = {name: int(value) for name, value in environment.items() if re.fullmatch(r"\d{1,9}", value)}
    arrays = {scheduler: variables for scheduler, variables in _ARRAYS.items() if variables[0] in numbers}
    if not arrays:
        every = ", ".join(variables[0] for variables in _ARRAYS.values())
        raise InputError.of("points", text, f"this is no task of a job array: none of {every} is set", _FORM)
    if len(arrays) > 1:
        names = " and ".join(variables[0] for variables in arrays.values())
        raise InputError.of("points", text, f"{names} are both set; {_FORM}")
    ((scheduler, (name, *bounds)),) = arrays.items()
    at, option = numbers[name], f"--points ${name}/16"
    if count is not None:
        if not 1 <= at <= int(count):
            remedy = f"number the tasks from 1 to {count}"
            raise InputError.of("points", text, f"{name} is {at}, which is no share of {count}", remedy)
        return f"{at}/{count}"
    first, last, step = (numbers.get(bound) for bound in (*bounds, "", "", "")[:3])
    if first is None or last is None:
        problem = f"{scheduler} does not say how many tasks the array has"
        raise InputError.of("points", text, problem, f"give the number: auto/16, or {option}")
    step = step or 1
    tasks = (last - first) // step + 1
    if numbers.get("SLURM_ARRAY_TASK_COUNT", tasks) != tasks or (at - first) % step or not first <= at <= last:
        problem = "the numbers of the array's tasks are no range, so that shares are not clear"
        raise InputError.of("points", text, problem, f"give {option}")
    return f"{(at - first) // step + 1}/{tasks}"


def in_ranges(numbers: Iterable[int]) -> str:
    """Whole numbers as text, such as ``3,7,12-20``."""
    ranges: list[list[int]] = []
    for number in sorted(set(numbers)):
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)


#: seconds between two looks for what other processes have computed
LOOK = 0.5
#: seconds after which nothing more is expected of other processes that have computed nothing, unless more are given
PATIENCE = 3600.0


class Design(Protocol):
    """What a study computes."""

    def ask(self) -> Sequence[Task]:
        """The tasks to compute now; none when the design is content. All of them are told before it is asked again."""
        ...

    def tell(self, task: Task, outcome: Outcome) -> None:
        """Receive what came of a task that was asked for; in any order."""
        ...


@dataclass(frozen=True)
class Part:
    """What one of several processes computes of a design that asks again when all of them have answered."""

    #: the first is 1
    share: int
    count: int
    #: which all processes see
    folder: Folder
    #: s without anything new before this process gives up
    patience: float = PATIENCE

    @classmethod
    def of(cls, share: tuple[int, int], folder: Folder, patience: float | str | None) -> Part:
        """A share of several; ``patience`` as users give it."""
        return cls(*share, folder, PATIENCE if patience is None else seconds(patience))

    def is_mine(self, task: Task) -> bool:
        """Whether this process computes a task: of the same number all do the same, which have a contact in common."""
        return task.number % self.count == self.share - 1

    def wait(self, tasks: Sequence[Task], design: Design) -> None:
        """Wait until other processes have computed ``tasks``.

        Raises
        ------
        StoreError
            Nothing new has come for too long.
        """
        left, since = list(tasks), time.monotonic()
        while left:
            there = [task for task in left if self.folder.state(task.key) == "done"]
            for task in there:
                design.tell(task, Outcome())
            left = [task for task in left if task not in there]
            now = time.monotonic()
            since = now if there else since
            if left and now - since > self.patience:
                raise StoreError(
                    f"{self.folder.path}: {len(left)} samples of other shares are missing, and none has come for "
                    f"{self.patience:.0f} s; start the other shares, or wait longer with --patience; {RESUME}"
                )
            if left:
                time.sleep(LOOK)


class Study:
    """Carries designs out during a block, at whose end its executor is closed.

    Parameters
    ----------
    executor, workers, threads, patience
        Where to compute, see :func:`chemage.studies.runner.open_pool`.
    components
        What workers in other processes must be able to import, see :func:`chemage.studies.tasks.for_workers`.

    Raises
    ------
    InputError
        They cannot.
    """

    def __init__(
        self,
        executor: str | Executor,
        workers: int | None = None,
        threads: int | None = None,
        patience: float | str | None = None,
        classes: Iterable[type] = (),
    ) -> None:
        self._where = executor, workers, threads, patience
        self._known = for_workers(executor, classes)
        self._stack, self._pool = ExitStack(), None

    def __enter__(self) -> Self:
        self._stack.enter_context(restored())  # tasks that run in this process set their own number of threads
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def open(self) -> Pool:
        """The executor, which is opened when it is first needed.

        Raises
        ------
        ExecutorError
            It cannot be started, or does not respond.
        """
        if self._pool is None:
            self._pool = self._stack.enter_context(open_pool(*self._where))
        return self._pool

    def carry_out(
        self,
        design: Design,
        place: Place | None,
        part: Part | None = None,
        watch: Callable[[Runner], None] | None = None,
    ) -> None:
        """Compute what ``design`` asks for until it asks for nothing more.

        Parameters
        ----------
        place
            The folder in which workers keep results; None: they are handed to the design.
        part
            What this process computes beside others, which compute the rest; default: all.
        watch
            Called several times a second while tasks run.
        """
        self._stack.callback(forget, "" if place is None else place.path)
        runner = None
        while tasks := design.ask():
            runner = runner or Runner(self.open(), place, self._known, watch)
            runner.run([task for task in tasks if part is None or part.is_mine(task)], design.tell)
            if part is not None:
                part.wait([task for task in tasks if not part.is_mine(task)], design)


class Archive:
    """The results of single tasks of one scene, in a folder if there is one.

    Parameters
    ----------
    path
        None: nothing is kept.
    scene
        Results of other versions of what it needs are computed again.
    processor
        Whether those of another processor are, as well.
    """

    def __init__(self, path: str | Path | None, scene: Scene, *, processor: bool = False) -> None:
        self.path = None if path is None else Path(path)
        if self.path is not None:
            refuse_links(self.path, "")
        #: how many results were taken from the folder
        self.taken = 0
        self._versions = {name: text for name, text in versions(scene).items() if processor or name != "processor"}

    @property
    def place(self) -> Place | None:
        """The folder, for workers."""
        return None if self.path is None else Place(str(self.path.absolute()), contacts=False)

    def find(self, task: Task) -> Outcome | None:
        """What came of a task; None if it is not there, damaged, or of other versions."""
        if self.place is None:
            return None
        content = self.place.folder.read_point(task.key)
        if content["status"] != "done" or changed(content["plugins"]):
            return None
        recorded = content["summary"]["versions"]
        # a task that has another component in place of that of the scene names no provider of the latter
        if any(recorded.get(name, text) != text for name, text in self._versions.items()):
            return None
        self.taken += 1
        return Outcome(content=content)

    def received(self, task: Task, outcome: Outcome) -> Outcome:
        """What came of a task, which may be in the folder only; errors are raised.

        Raises
        ------
        ExecutorError
            Another version of chemage has computed it.
        """
        if outcome.error is not None:
            raise outcome.error
        if outcome.run is None and outcome.content is None:
            assert self.place is not None
            outcome = Outcome(content=self.place.folder.read_point(task.key))
        if outcome.content is not None:
            version = outcome.content["summary"]["versions"]["chemage"]
            if version != self._versions["chemage"]:
                raise ExecutorError(
                    f"a worker has chemage {version}, but the study is run by {self._versions['chemage']}"
                )
        return outcome

    def tidy(self) -> None:
        """Remove what is needed while results are written."""
        if self.place is not None:
            shutil.rmtree(self.place.folder.path / ".parts", ignore_errors=True)
