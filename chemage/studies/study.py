"""A study: many runs that a design asks for, on an executor, and the folder in which their results are kept.

A design says what to compute next, and is told what came of it, until it asks for nothing more. A grid is a design, and
so are a mean over surfaces, which stops at an accuracy, and a map of speed against accuracy. Where their tasks are
computed changes no result.

What one of several processes computes: the third of sixteen shares, or points by their numbers.
"""

from __future__ import annotations

import os
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.ownership import Owned
from chemage.foundation.progress import Report, progress_bars
from chemage.foundation.threads import restored
from chemage.scene.scene import Scene
from chemage.studies.folder import RESUME, Folder
from chemage.studies.runner import Pool, Runner, Told, open_pool, seconds
from chemage.studies.tasks import (
    Outcome,
    Place,
    PluginsInUse,
    Task,
    for_workers,
    forget,
    registered_classes,
)

#: largest number of shares
MANY_SHARES = 1_000_000
_FORM = "write the third of 16 shares as 3/16, points by their numbers as 3,7,12-20, or in a job array auto or auto/16"
_SHARE = re.compile(r"(\d{1,9})/(\d{1,9})")
_AUTO = re.compile(r"auto(?:/(\d{1,9}))?")
_NUMBERS = re.compile(r"\d{1,12}(-\d{1,12})?(,\d{1,12}(-\d{1,12})?)*")
#: the number of a task in a job array; first, last and step where the scheduler gives them
_ARRAYS = (
    (
        "SLURM_ARRAY_TASK_ID",
        "SLURM_ARRAY_TASK_MIN",
        "SLURM_ARRAY_TASK_MAX",
        "SLURM_ARRAY_TASK_STEP",
    ),
    ("PBS_ARRAY_INDEX",),
    ("PBS_ARRAYID",),
    ("SGE_TASK_ID", "SGE_TASK_FIRST", "SGE_TASK_LAST", "SGE_TASK_STEPSIZE"),
    ("LSB_JOBINDEX",),
)


@dataclass(frozen=True)
class Selection:
    """The points that one process computes: one of several shares, or points by their numbers."""

    #: share and number of shares, the first is 1; None for numbers
    share: tuple[int, int] | None = None
    #: first and last number of each range, the first point is 0
    ranges: tuple[tuple[int, int], ...] = ()

    @classmethod
    def read(
        cls, text: str, environment: Mapping[str, str] | None = None
    ) -> Selection:
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
            variables = os.environ if environment is None else environment
            return cls(share=_share_of_array(text, auto[1], variables))
        if match := _SHARE.fullmatch(compact):
            number, count = int(match[1]), int(match[2])
            if not 1 <= number <= count <= MANY_SHARES:
                raise _wrong(
                    text,
                    f"there is no share {number} of {count}; shares count from 1",
                )
            return cls(share=(number, count))
        if not _NUMBERS.fullmatch(compact):
            raise _wrong(text, "not understood")
        ranges = []
        for part in compact.split(","):
            first, _, last = part.partition("-")
            ranges.append((int(first), int(last or first)))
            if ranges[-1][0] > ranges[-1][1]:
                raise _wrong(text, f"{part} ends before it begins")
        return cls(ranges=tuple(ranges))

    def __str__(self) -> str:
        if self.share is not None:
            return f"{self.share[0]}/{self.share[1]}"
        return ",".join(
            str(first) if first == last else f"{first}-{last}"
            for first, last in self.ranges
        )

    def describe(self) -> str:
        """What is computed, in words."""
        if self.share is not None:
            return f"share {self.share[0]} of {self.share[1]}"
        return f"points {self}"


def _wrong(text: str, problem: str, remedy: str = _FORM) -> InputError:
    return InputError.of("points", text, problem, remedy)


def _share_of_array(
    text: str, count: str | None, environment: Mapping[str, str]
) -> tuple[int, int]:
    """The share of this task of a job array, of ``count`` or of as many as the array has tasks."""
    numbers = {
        name: int(value)
        for name, value in environment.items()
        if re.fullmatch(r"\d{1,9}", value)
    }
    arrays = [variables for variables in _ARRAYS if variables[0] in numbers]
    if not arrays:
        every = ", ".join(variables[0] for variables in _ARRAYS)
        raise _wrong(
            text, f"this is no task of a job array: none of {every} is set"
        )
    if len(arrays) > 1:
        names = " and ".join(variables[0] for variables in arrays)
        raise _wrong(text, f"{names} are both set")
    name, *bounds = arrays[0]
    at, option = numbers[name], f"--points ${name}/16"
    if count is not None:
        share = at, int(count)
        if not 1 <= at <= share[1]:
            raise _wrong(
                text,
                f"{name} is {at}, which is no share of {count}",
                f"number the tasks from 1 to {count}",
            )
        return share
    if not numbers.keys() >= {*bounds[:2]} or not bounds:
        raise _wrong(
            text,
            f"{name} does not say how many tasks the array has",
            f"give the number: auto/16, or {option}",
        )
    first, last, step = (numbers.get(bound, 1) for bound in bounds)
    tasks = (last - first) // step + 1
    if (
        numbers.get("SLURM_ARRAY_TASK_COUNT", tasks) != tasks
        or (at - first) % step
        or not first <= at <= last
    ):
        raise _wrong(
            text,
            "the numbers of the array's tasks are no range, so that shares are not clear",
            f"give {option}",
        )
    return (at - first) // step + 1, tasks


def in_ranges(numbers: Iterable[int]) -> str:
    """Whole numbers as text, such as ``3,7,12-20``."""
    ranges: list[tuple[int, int]] = []
    for number in sorted(set(numbers)):
        first = number
        if ranges and ranges[-1][1] == number - 1:
            first, _ = ranges.pop()
        ranges.append((first, number))
    return str(Selection(ranges=tuple(ranges)))


#: the stage that is reported
RUNS = "runs"
#: seconds between two looks for what other processes have computed
LOOK = 0.5
#: seconds after which nothing more is expected of other processes that have computed nothing, unless more are given
PATIENCE = 3600.0


class Design(Owned, ABC):
    """What a study computes: it asks for runs, is told what came of them, and asks again, until it asks for none."""

    #: whether results depend on the processor, as times do; those of another one are computed again
    timed: ClassVar[bool] = False

    @abstractmethod
    def ask(self) -> Sequence[Task]:
        """The tasks to compute now; none when the design is content. All of them are told before it is asked again."""

    @abstractmethod
    def tell(self, task: Task, outcome: Outcome) -> None:
        """Receive what came of a task that was asked for; in any order."""


def share_of(points: str, place: Place | None) -> tuple[int, int]:
    """The share of a design that this process computes, as users write it: ``3/16``, or ``auto``.

    Raises
    ------
    InputError
        It is no share, or there is no folder in which shares meet.
    """
    share = Selection.read(points).share
    if share is None:
        remedy = "give a share, such as 3/16 or auto"
        raise _wrong(points, "only a sweep has points", remedy)
    if place is None:
        remedy = "name the one that all of them see"
        raise _wrong(points, "shares meet in a folder", remedy)
    return share


class Study:
    """Carries designs out during a block, at whose end its executor is closed.

    Parameters
    ----------
    executor, workers, threads, patience
        Where to compute, see :func:`chemage.studies.runner.open_pool`; default: ``processes`` for several workers, else
        ``serial``.
    classes
        Of components that workers in other processes must be able to import, beside those of the tasks that have a
        scene, see :func:`chemage.studies.tasks.for_workers`.

    Raises
    ------
    InputError
        They cannot.
    """

    def __init__(
        self,
        executor: str | Executor | None = None,
        workers: int | None = None,
        threads: int | None = None,
        patience: float | str | None = None,
        classes: Iterable[type] = (),
    ) -> None:
        self._executor = executor or (
            "processes" if (workers or 1) > 1 else "serial"
        )
        self._where = self._executor, workers, threads, patience
        #: s without anything new of other shares before this process gives up
        self._patience = PATIENCE if patience is None else seconds(patience)
        self._classes = {*classes}
        for_workers(self._executor, self._classes)
        self._stack, self._pool = ExitStack(), None
        #: tasks that designs were told of, and that they have asked for
        self.told = self.asked = 0

    def __enter__(self) -> Self:
        # tasks that run in this process set their own number of threads
        self._stack.enter_context(restored())
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
        share: tuple[int, int] | None = None,
        watch: Callable[[Runner], None] | None = None,
    ) -> None:
        """Compute what ``design`` asks for until it asks for nothing more; what is in the folder is not computed again.

        Parameters
        ----------
        place
            The folder in which workers keep results; None: they are handed to the design.
        share
            What this process computes beside others, which compute the rest into the same folder; default: all. Tasks of
            one number, which have a contact in common, belong to one share.
        watch
            Called several times a second while tasks run.
        """
        self._stack.callback(forget, "" if place is None else place.path)

        def told(task: Task, outcome: Outcome) -> None:
            self.told += 1
            design.tell(
                task, outcome if place is None else place.read(task, outcome)
            )

        number, count = share or (1, 1)
        while tasks := design.ask():
            self.asked += len(tasks)
            mine, others = [], []
            for task in tasks:
                found = None if place is None else place.find(task)
                if found is not None:
                    told(task, found)
                elif task.number % count == number - 1:
                    mine.append(task)
                else:
                    others.append(task)
            if mine:
                Runner(self.open(), place, self._known(mine), watch).run(mine, told)
            if place is not None:
                self._wait(others, place.folder, told)

    def _wait(self, tasks: Sequence[Task], folder: Folder, told: Told) -> None:
        """Wait until other processes have computed ``tasks``.

        Raises
        ------
        StoreError
            Nothing new has come for too long.
        """
        since = time.monotonic()
        while tasks:
            missing = []
            for task in tasks:
                if folder.state(task.key) == "done":
                    told(task, Outcome())
                    since = time.monotonic()
                else:
                    missing.append(task)
            tasks = missing
            if tasks and time.monotonic() - since > self._patience:
                raise StoreError(
                    f"{folder.path}: {len(tasks)} samples of other shares are missing, and none has come for "
                    f"{self._patience:.0f} s; start the other shares, or wait longer with --patience; {RESUME}"
                )
            if tasks:
                time.sleep(LOOK)

    def _known(self, tasks: Sequence[Task]) -> PluginsInUse | None:
        """What workers must know for ``tasks``."""
        for task in tasks:
            if isinstance(task.source, Scene):
                self._classes |= registered_classes(task.source.components())
        return for_workers(self._executor, self._classes)


def carry_out(
    design: Design,
    folder: str | Path | None = None,
    *,
    executor: str | Executor | None = None,
    workers: int | None = None,
    threads: int | None = None,
    patience: float | str | None = None,
    points: str | None = None,
    progress: Report | bool | None = None,
) -> None:
    """Compute the runs that ``design`` asks for, until it asks for none.

    Parameters
    ----------
    folder
        Where results are kept, and from which they are taken, if they are of these versions; default: none are kept.
    executor, workers, threads, patience
        Where to compute, as for :func:`chemage.sweep`; default: ``processes`` for several ``workers``, else ``serial``.
        Results do not depend on them.
    points
        Compute a share of the runs while other processes compute the others into the same folder: ``"3/16"``, or
        ``"auto"``, the share of this task of a job array. Each waits for the others, at most ``patience`` without a new
        run, and tells its design all of them.
    progress
        Called several times a second; True shows progress on stderr.

    Raises
    ------
    InputError
        An argument is not valid, or workers cannot import a component.
    ExecutorError
        The workers cannot be started, or have ended.
    """
    place = Place.at(folder, processor=design.timed)
    share = None if points is None else share_of(points, place)
    with ExitStack() as stack:
        report = (
            stack.enter_context(progress_bars({RUNS: RUNS}))
            if progress is True
            else progress or None
        )
        study = stack.enter_context(Study(executor, workers, threads, patience))

        def watch(_: Runner) -> None:
            if report is not None:
                report(RUNS, study.told, study.asked)

        try:
            study.carry_out(design, place, share, watch)
        except KeyboardInterrupt:
            if place is None:
                raise
            text = f"{study.told} runs are kept in {place.path}; rerun the same command to resume"
            raise KeyboardInterrupt(text) from None
        finally:
            if share is None and place is not None:
                place.tidy()
