"""The ways in which a scene can be computed on one surface, from coarse to as it is written, and what each costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.contacts.role import ContactTheory
from chemage.foundation.approximations import merged
from chemage.foundation.codec import from_json
from chemage.foundation.errors import InputError
from chemage.foundation.memory import capacity
from chemage.scene import plan as estimate
from chemage.scene.run import run
from chemage.scene.scene import Scene
from chemage.scene.variants import coarser
from chemage.studies.runner import PROGRAM
from chemage.studies.tasks import Outcome

#: factors by which the pixels of the contact are made larger, the largest first
COARSER = (4, 2)
#: a coarser grid is used where it costs at most this part of the scene's own
PAYS = 0.6
#: a control is used where it costs at most this part of the cheapest computation
CONTROL_PAYS = 0.5
#: replicas of a sample whose contact takes all the time
MOST_REPLICAS = 16
#: the difference between two grids on one surface: its standard deviation over the mean with so many replicas, and the
#: variance of one replica over that of the surfaces; as measured by ``tests/benchmarks/ensemble_estimates.py``
DIFFERENCE, DIFFERENCE_REPLICAS, REPLICA_SHARE = 0.008, 10, 3.0


@dataclass(frozen=True)
class Computation:
    """A scene as it is computed on each of several surfaces."""

    #: with the grid and the replicas of this computation
    scene: Scene
    #: pixels are so many times larger than the scene says
    factor: int
    #: CPU seconds of the contact, and of one replica, on one surface
    contact_seconds: float
    replica_seconds: float
    #: memory of one surface, as far as it is known
    bytes: float | None = None
    #: what was changed in the scene besides seeds and replicas, in words; "" for nothing but the grid
    settings: str = ""
    #: (quantities,) relative standard errors that the settings make, as a map has them; None: not measured
    errors: np.ndarray | None = field(default=None, compare=False)
    #: whether the grid is all that was changed
    grid_only: bool = True
    #: whether its seconds were measured; else they are those of the machine on which components were calibrated, since
    #: they decide what is computed, which must be the same on every machine
    timed: bool = False

    @property
    def replicas(self) -> int:
        """Replicas on each surface."""
        return self.scene.hold.replicas if self.scene.hold is not None else 1

    @property
    def seconds(self) -> float:
        """CPU seconds on one surface, as estimated before anything is computed."""
        return self.contact_seconds + self.replica_seconds * (self.replicas if self.scene.ages else 0)

    @property
    def words(self) -> str:
        """What is computed on a surface, in words."""
        known = self.scene.surface.expected()
        words = f"{known['nx']:.0f} x {known['ny']:.0f} pixels" if {"nx", "ny"} <= known.keys() else "the surface"
        if self.scene.ages:
            words += f", {self.replicas} replica{'s' if self.replicas > 1 else ''}"
        return words if self.grid_only else f"{words} ({self.settings})"

    @property
    def scale(self) -> float:
        """CPU seconds on this machine over those that are stated."""
        return 1.0 if self.timed else estimate.slowness()

    def here(self) -> Computation:
        """The same with the seconds of this machine."""
        contact, replica = self.contact_seconds * self.scale, self.replica_seconds * self.scale
        return replace(self, contact_seconds=contact, replica_seconds=replica, timed=True)

    def with_replicas(self, replicas: int) -> Computation:
        """The same with another number of replicas."""
        hold = self.scene.hold
        if hold is None or hold.replicas == replicas:
            return self
        changed = self.scene.model_copy(update={"hold": hold.model_copy(update={"replicas": replicas})})
        return replace(self, scene=changed)

    def seeded(self, surface_seed: int, hold_seed: int) -> Scene:
        """The scene on one surface with its own disorder."""
        update: dict[str, Any] = {"surface_seed": surface_seed}
        if self.scene.hold is not None:
            update["hold"] = self.scene.hold.model_copy(update={"seed": hold_seed})
        return self.scene.model_copy(update=update)

    def compute(self, surface_seed: int, hold_seed: int) -> Sample:
        """Compute one sample in this thread."""
        return Sample.of(Outcome(run(self.seeded(surface_seed, hold_seed), threads=1, warn=False, members=False)))


def computations(scene: Scene) -> list[Computation]:
    """Computations of ``scene`` that pay, the cheapest first and that of its own grid last.

    On coarser pixels the sites stay where they are; that of pixels which are sites gets the density of the scene's own
    pixels. All of them have one replica, whose random numbers they have in common.
    """
    base = bare(scene)
    own = estimated(base, 1)
    found = [own]
    for factor in reversed(COARSER):
        coarse = coarser(base, factor)
        if coarse is not None:
            one = estimated(coarse, factor)
            if one.seconds <= PAYS * found[-1].seconds:
                found.append(one)
    return found[::-1]


def bare(scene: Scene) -> Scene:
    """``scene`` with one replica, without what the numbers do not need."""
    update: dict[str, Any] = {"observe": (), "ensemble": None, "accuracy": {}}
    if scene.hold is not None:
        update["hold"] = scene.hold.model_copy(update={"replicas": 1, "common": "all"})
    return scene.model_copy(update=update)


def sketched(cheapest: Computation) -> Computation | None:
    """The contact of a sketch of the surface, whose area explains most of the scatter between surfaces; None where the
    surface has no sketch, or it would cost too much."""
    scene = cheapest.scene
    maker = None if isinstance(scene.contact, ContactTheory) else scene.surface.sketch()
    if maker is None:
        return None
    made = estimated(scene.model_copy(update={"surface": maker, "hold": None}), cheapest.factor)
    return made if made.seconds <= CONTROL_PAYS * cheapest.seconds else None


def estimated(scene: Scene, factor: int) -> Computation:
    """The computation of ``scene``, whose pixels are ``factor`` times larger, with estimated costs."""
    known = estimate.cost(scene, here=False)
    contact, replica = known.contact_cpu_seconds, known.kinetics_cpu_seconds
    if known.kinetics_range is not None:
        replica = math.sqrt(known.kinetics_range[0] * known.kinetics_range[1])
    pixels = max(known.pixels, 1.0)
    # what no component says is taken as so much per pixel; only the allocation depends on it
    parts = known.contact_bytes, known.replica_bytes if scene.ages else 0.0
    size = None if parts[0] is None or parts[1] is None else max(parts[0], parts[1])
    return Computation(scene, factor, 1e-6 * pixels if contact is None else contact, replica or 1e-3, size)


def fitting(computation: Computation, workers: int) -> int:
    """How many surfaces are computed at the same time: ``workers``, or as many as the memory of this machine holds."""
    there = capacity()
    if there is None or not computation.bytes:
        return workers
    return max(1, min(workers, int((there - PROGRAM) // computation.bytes)))


def replicas_of_difference(fine: Computation, coarse: Computation) -> int:
    """Replicas of a sample of the difference between two computations: so many that kinetics take about as long as it
    is worth."""
    if not fine.scene.ages or (fine.scene.ageing is not None and not fine.scene.ageing.replicates):
        return 1
    contacts = fine.contact_seconds + coarse.contact_seconds
    kinetics = fine.replica_seconds + coarse.replica_seconds
    return max(1, min(MOST_REPLICAS, round(math.sqrt(REPLICA_SHARE * contacts / max(kinetics, 1e-9)))))


@dataclass(frozen=True)
class Sample:
    """What one computation on one surface gives."""

    #: nN, (replicas, m); (0, 0) without ageing
    friction_drop: np.ndarray
    #: measures of the contact
    measures: Mapping[str, float]
    #: plugins that answered or changed a stage: name -> source
    plugins: Mapping[str, str] = field(default_factory=dict)
    #: as in :mod:`chemage.foundation.approximations`
    approximate: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def of(cls, outcome: Outcome) -> Sample:
        """The sample that a task gave.

        Raises
        ------
        InputError
            The friction is not finite.
        """
        if outcome.run is not None:
            contact, aging = outcome.run.contact, outcome.run.aging
            measures, plugins = contact.summary(), outcome.run.plugins
            approximate = merged(contact.approximate, aging.approximate if aging is not None else ())
        else:
            assert outcome.content is not None
            content = outcome.content
            aging = from_json(Aging, content["aging"]) if content["aging"] else None
            measures, plugins = content["summary"], content["plugins"]
            approximate = content.get("approximate", ()) if aging is None else aging.approximate
        numbers = {name: float(value) for name, value in measures.items() if _is_number(value)}
        if aging is None:
            return cls(np.zeros((1, 0)), numbers, plugins, approximate)
        drop = np.asarray(aging.friction_drop, dtype=np.float64)
        if not np.isfinite(drop).all():
            raise InputError("friction_drop: has numbers that are not finite; see `chemage run` of one surface")
        return cls(drop, numbers, plugins, approximate)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
