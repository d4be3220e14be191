"""The ways in which a scene can be computed on one surface, from coarse to as it is written, and what each costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.contacts.theories import ContactTheory
from chemage.experiments.estimate import cost
from chemage.experiments.run import run
from chemage.experiments.scene import Scene
from chemage.experiments.variants import coarser
from chemage.foundation.approximations import merged
from chemage.foundation.errors import InputError
from chemage.foundation.hashes import content_hash
from chemage.foundation.memory import capacity

#: factors by which the pixels of the contact are made larger, the largest first
COARSER = (4, 2)
#: a coarser grid is used where it costs at most this part of the scene's own
PAYS = 0.6
#: a control is used where it costs at most this part of the cheapest computation
CONTROL_PAYS = 0.5
#: memory of the program itself, bytes
PROGRAM = 2e8
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

    def with_replicas(self, replicas: int) -> Computation:
        """The same with another number of replicas."""
        hold = self.scene.hold
        if hold is None or hold.replicas == replicas:
            return self
        changed = self.scene.model_copy(update={"hold": hold.model_copy(update={"replicas": replicas})})
        return replace(self, scene=changed)

    def key(self) -> str:
        """Content hash of everything that decides the numbers, but the seeds."""
        scene = self.scene.model_copy(update={"surface_seed": 0})
        if scene.hold is not None:
            scene = scene.model_copy(update={"hold": scene.hold.model_copy(update={"seed": 0})})
        return content_hash([scene.keys()["result"], list(self.scene.cite())])


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
    known = cost(scene)
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
    #: sites in contact, mean over replicas
    sites: float
    #: plugins that answered or changed a stage: name -> source
    plugins: Mapping[str, str] = field(default_factory=dict)
    #: as in :mod:`chemage.foundation.approximations`
    approximate: Sequence[Mapping[str, Any]] = ()

    def todict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "friction_drop": self.friction_drop.tolist(),
            "measures": dict(self.measures),
            "sites": self.sites,
            "plugins": dict(self.plugins),
            "approximate": list(self.approximate),
        }

    @classmethod
    def fromdict(cls, data: Mapping[str, Any]) -> Sample:
        """The inverse of :meth:`todict`."""
        drop = np.array(data["friction_drop"], dtype=np.float64)
        sites = math.nan if data["sites"] is None else data["sites"]
        return cls(drop.reshape(len(drop), -1), data["measures"], sites, data["plugins"], data["approximate"])


def compute(
    computation: Computation,
    surface_seed: int,
    hold_seed: int,
    contact: ContactSolution | ContactStatistics | None = None,
) -> tuple[Sample, ContactSolution | ContactStatistics]:
    """One sample, and the contact that it is of; ``contact`` is given where the surface is the same for all samples."""
    scene = computation.scene.model_copy(update={"surface_seed": surface_seed})
    if scene.hold is not None:
        scene = scene.model_copy(update={"hold": scene.hold.model_copy(update={"seed": hold_seed})})
    found = run(scene, threads=1, contact=contact, warn=False, members=False)
    measures = {name: float(value) for name, value in found.contact.summary().items() if _is_number(value)}
    if found.aging is None:
        bare = Sample(np.zeros((1, 0)), measures, math.nan, found.contact.plugins, found.contact.approximate)
        return bare, found.contact
    drop = np.asarray(found.aging.friction_drop, dtype=np.float64)
    if not np.isfinite(drop).all():
        raise InputError("friction_drop: has numbers that are not finite; see `chemage run` of one surface")
    sites, aging = float(found.aging.sites.mean()), found.aging
    approximate = merged(found.contact.approximate, aging.approximate)
    return Sample(drop, measures, sites, found.plugins, approximate), found.contact


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
