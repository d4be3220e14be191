"""A design says what to compute next, and is told what came of it, until it asks for nothing more."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from chemage.foundation.errors import StoreError
from chemage.studies.folder import RESUME, Folder
from chemage.studies.runner import Runner
from chemage.studies.tasks import Outcome, Task

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


def carry_out(design: Design, runner: Runner, part: Part | None = None) -> None:
    """Compute what ``design`` asks for until it asks for nothing more; with ``part`` beside other processes, which
    compute the rest."""
    while tasks := design.ask():
        runner.run([task for task in tasks if part is None or part.is_mine(task)], design.tell)
        if part is not None:
            part.wait([task for task in tasks if not part.is_mine(task)], design)
