"""A scene of which the CPU time is measured, as a task: in the process that computes it, on one thread.

The result is what a map of speed against accuracy compares: measures of the contact, the distance of its pressures from
those of a reference, and the friction drop of each replica.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from chemage import ContactSolution, Run, Scene
from chemage.plugin import (
    Outcome,
    Task,
    aging_of,
    contact_of,
    content_hash,
    text,
    versions,
)
from chemage_trade.result import DISTRIBUTION

T = TypeVar("T")
#: forms of scenes that this process has compiled everything for, and whether it has solved a contact
_compiled: set[str] = set()


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """What ``work`` returns, and its CPU seconds over all threads of this process."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


@dataclass(frozen=True)
class Timed(Task):
    """A scene of which the CPU time is measured."""

    #: with whose pressures those of the scene are compared; None: with none
    reference: Scene | None = None

    @classmethod
    def measuring(cls, scene: Scene, **more: Any) -> Timed:
        """The task that measures a scene.

        Raises
        ------
        InputError
            It needs more memory than there is.
        """
        task = cls.of(scene, **more)
        against = None if task.reference is None else _contact_key(task.reference)
        return replace(
            task,
            # options that change the speed alone are in the data of the scene, and in no key of its stages
            key=content_hash([task.key, _data(scene), against]),
            ageing=content_hash([task.ageing, _data(scene)]),
            contact=_contact_key(scene),
        )

    def outcome(self, worker: Any) -> Outcome:
        """Compute and time the scene; what it needs is compiled before."""
        scene, distance = self.scene, 0.0
        with scene.in_use():
            worker.stage = "contact"
            contact, contact_seconds = _solution(worker, scene)
            if self.reference is not None:
                distance = _distance(contact, _solution(worker, self.reference)[0])
            worker.stage = "ageing"
            _compile(scene, contact)
            aging, ageing_seconds = timed(lambda: aging_of(scene, contact))
        run = Run(
            scene.todict(),
            contact,
            aging=aging,
            timings={"contact": contact_seconds, "ageing": ageing_seconds},
            versions=versions(scene, (contact, aging)),
        )
        return Outcome(run, text.jsonable({DISTRIBUTION: distance}))


def _solution(worker: Any, scene: Scene) -> tuple[ContactSolution, float]:
    """The contact of a scene, and the CPU seconds of making its surface and solving it."""

    def solve() -> ContactSolution:
        return contact_of(scene)

    def measured() -> tuple[ContactSolution, float]:
        scene.warm_up("contact")
        if not _compiled:  # the first contact of a process takes longer
            solve()
            _compiled.add("contact")
        return timed(solve)

    # that of the reference, which every task uses, and that of the task
    return worker.kept("timed contact", _contact_key(scene), measured)


def _compile(scene: Scene, contact: ContactSolution) -> None:
    """Age one replica where no scene of this form was aged, which has other numbers at most, so that compilation, or a
    table that a method of ageing makes once, is in no time."""
    form = f"{scene.form()} {scene.ageing!r}"
    if scene.ages and form not in _compiled:
        aging_of(scene, contact, replicas=1)
        _compiled.add(form)


def _data(scene: Scene) -> dict[str, Any]:
    return scene.todict() | {"name": "", "title": ""}


def _contact_key(scene: Scene) -> str:
    data = scene.todict()
    return content_hash(
        [scene.task_keys()["contact"], data["surface"], data["contact"]]
    )


def _distance(contact: ContactSolution, reference: ContactSolution) -> float:
    """Wasserstein distance of the distributions of pressure over the contact, over the mean pressure."""
    from scipy import stats

    pressure, other = (
        solution.pressure[solution.contact] for solution in (contact, reference)
    )
    if not pressure.size or not other.size:
        return math.nan
    return float(stats.wasserstein_distance(pressure, other)) / float(
        np.abs(other).mean(dtype=np.float64)
    )
