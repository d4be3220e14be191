"""A scene of which the CPU time is measured, as a task: in the process that computes it, on one thread.

The result is what a map of speed against accuracy compares: measures of the contact, the distance of its pressures from
those of a reference, and the friction drop of each replica.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self, TypeVar

import numpy as np

from chemage.ageing.aging import Aging
from chemage.contacts.role import solve_contact
from chemage.contacts.solution import ContactSolution
from chemage.foundation.records import content_hash
from chemage.foundation.text import jsonable
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.run import aged
from chemage.scene.scene import Scene
from chemage.scene.warm_up import form, warm_up
from chemage.studies.tasks import Outcome, Recent, Task, Worker
from chemage.surfaces.role import make_surface

T = TypeVar("T")

#: distance of the distribution of pressure from that of the reference over the mean pressure
DISTRIBUTION = "pressure_distribution"
#: measures of a contact that its settings do not change
_GIVEN = {"load", "modulus", "nominal_area", "nominal_pressure"}


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
    def of(cls, scene: Scene, **more: Any) -> Self:
        """The task of a scene."""
        reference, estimates = more.get("reference"), cost(scene)
        keys = scene.task_keys()
        against = None if reference is None else _contact_key(reference)
        return cls(
            # options that change the speed alone are in the data of the scene, and in no key of its stages
            key=content_hash([keys["result"], _data(scene), against]),
            ageing=content_hash([keys["aging"], _data(scene)]),
            contact=_contact_key(scene),
            surface=keys["surface"],
            source=scene,
            contact_seconds=estimates.contact_cpu_seconds or 0.0,
            ageing_seconds=estimates.kinetics_cpu_seconds or 0.0,
            bytes=max(estimates.contact_bytes or 0.0, estimates.replica_bytes or 0.0),
            **more,
        )

    def outcome(self, worker: Worker) -> Outcome:
        """Compute and time the scene; what it needs is compiled before."""
        scene = self.scene
        with scene.in_use():
            worker.stage = "contact"
            solved = _solution(worker.owner, scene)
            distance = 0.0
            if self.reference is not None:
                distance = _distance(solved.contact, _solution(worker.owner, self.reference).contact)
            worker.stage = "ageing"
            _compile(scene, solved.contact)
            aging, seconds = timed(lambda: aged(scene, solved.contact))
        measures = {name: float(value) for name, value in solved.contact.summary().items() if name not in _GIVEN}
        return Outcome(content=self._content(solved, seconds, {**measures, DISTRIBUTION: distance}, aging))

    def _content(
        self, solved: _Solved, seconds: float, measures: dict[str, float], aging: Aging | None
    ) -> dict[str, Any]:
        plugins = solved.contact.plugins if aging is None else {**solved.contact.plugins, **aging.plugins}
        return {
            "status": "done",
            "point": self.number,
            "changes": dict(self.changes),
            "plugins": plugins,
            "summary": {"versions": versions(self.scene, (solved.contact, aging))},
            "contact_seconds": solved.seconds,
            "ageing_seconds": seconds,
            "measures": jsonable(measures),
            "friction_drop": None if aging is None else np.asarray(aging.friction_drop, dtype=np.float64).tolist(),
        }


@dataclass(frozen=True)
class Timing:
    """What came of a timed scene."""

    contact_seconds: float
    #: of all replicas
    ageing_seconds: float
    #: of the contact; nan where a measure does not exist
    measures: dict[str, float]
    #: (replicas, m) nN; None without ageing
    friction_drop: np.ndarray | None

    @classmethod
    def read(cls, content: Mapping[str, Any]) -> Timing:
        """From what a worker sends, or a folder has."""
        drop = content["friction_drop"]
        return cls(
            content["contact_seconds"],
            content["ageing_seconds"],
            {name: math.nan if value is None else value for name, value in content["measures"].items()},
            None if drop is None else np.array(drop, dtype=np.float64),
        )

    @property
    def seconds(self) -> float:
        """CPU seconds of contact and ageing."""
        return self.contact_seconds + self.ageing_seconds


# -- in the worker ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Solved:
    """A contact, and the CPU seconds of making its surface and solving it."""

    contact: ContactSolution
    seconds: float


# that of the reference, which every task uses, and that of the task
_solutions: Recent[_Solved] = Recent(2)
#: forms of scenes that this process has compiled everything for, and whether it has solved a contact
_compiled: set[str] = set()


def _solution(owner: str, scene: Scene) -> _Solved:
    def solve() -> ContactSolution:
        return solve_contact(scene.solver, make_surface(scene.surface, scene.surface_seed), scene.load)

    def measured() -> _Solved:
        warm_up(scene, "contact")
        if not _compiled:  # the first contact of a process takes longer
            solve()
            _compiled.add("contact")
        return _Solved(*timed(solve))

    return _solutions.get(f"{owner} {_contact_key(scene)}", measured)


def _compile(scene: Scene, contact: ContactSolution) -> None:
    """Age one replica where no scene of this form was aged, so that compilation, or a table that a method of ageing
    makes once, is in no time."""
    if scene.ages and (name := f"{form(scene)} {scene.ageing!r}") not in _compiled:
        aged(scene, contact, replicas=1)
        _compiled.add(name)


def _data(scene: Scene) -> dict[str, Any]:
    return scene.todict() | {"name": "", "title": ""}


def _contact_key(scene: Scene) -> str:
    data = scene.todict()
    return content_hash([scene.task_keys()["contact"], data["surface"], data["contact"]])


def _distance(contact: ContactSolution, reference: ContactSolution) -> float:
    """Wasserstein distance of the distributions of pressure over the contact, over the mean pressure."""
    from scipy import stats

    pressure, other = (solution.pressure[solution.pressure > 0] for solution in (contact, reference))
    if not pressure.size or not other.size:
        return math.nan
    return float(stats.wasserstein_distance(pressure, other)) / float(other.mean(dtype=np.float64))
