"""A design says what to compute next, and is told what came of it, until it asks for nothing more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from chemage.studies.runner import Runner
from chemage.studies.tasks import Outcome, Task


class Design(Protocol):
    """What a study computes."""

    def ask(self) -> Sequence[Task]:
        """The tasks to compute now; none when the design is content. All of them are told before it is asked again."""
        ...

    def tell(self, task: Task, outcome: Outcome) -> None:
        """Receive what came of a task that was asked for; in any order."""
        ...


def carry_out(design: Design, runner: Runner) -> None:
    """Compute what ``design`` asks for until it asks for nothing more."""
    while tasks := design.ask():
        runner.run(tasks, design.tell)
