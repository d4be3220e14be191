"""The ways in which a scene can be computed on one surface, from coarse to as it is written: what each costs, as
estimated or as a map of speed against accuracy has measured it, and its errors.

Samples of a computation on many surfaces: the tasks that give them, and what is kept of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import islice
from typing import Any

import numpy as np

from chemage.ageing.ageing import BARRIERS
from chemage.foundation.memory import capacity
from chemage.foundation.statistics import NORMAL_LIMIT, student_limit
from chemage.scene import plan as estimate
from chemage.scene.files import load_scene
from chemage.scene.run import run
from chemage.scene.scene import Scene
from chemage.studies.ensembles.quantities import (
    AccuracyGoal,
    Quantities,
    SurfaceSample,
)
from chemage.studies.runner import PROGRAM
from chemage.studies.tasks import Outcome, Task
from chemage.studies.trade import TradeMap, TradePoint
from chemage.surfaces.role import CONTINUATIONS

#: factors by which the pixels of the contact are made larger, the largest first
COARSER = (4, 2)
#: a coarser grid is used where it costs at most this part of the scene's own
PAYS = 0.6
#: other settings are used where they are expected to cost at most this part of what those of the scene do
MAP_PAYS = 0.9
#: a budget is divided among so many processors at least, s of CPU time per s
_ONE = 1.0
#: a control is used where it costs at most this part of the cheapest computation
CONTROL_PAYS = 0.5
#: replicas of a sample whose contact takes all the time
MOST_REPLICAS = 16
#: the difference between two grids on one surface: its standard deviation over the mean with so many replicas, and the
#: variance of one replica over that of the surfaces; as measured on scenes 0 to 27 of ``tests/benchmarks/unseen_scenes.py``
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
        return self.contact_seconds + self.replica_seconds * (
            self.replicas if self.scene.ages else 0
        )

    @property
    def words(self) -> str:
        """What is computed on a surface, in words."""
        expected = self.scene.surface.expected()
        words = (
            f"{expected['nx']:.0f} x {expected['ny']:.0f} pixels"
            if {"nx", "ny"} <= expected.keys()
            else "the surface"
        )
        if self.scene.ages:
            words += f", {self.replicas} replica{'s' if self.replicas > 1 else ''}"
        return words if self.grid_only else f"{words} ({self.settings})"

    @property
    def scale(self) -> float:
        """CPU seconds on this machine over those that are stated."""
        return 1.0 if self.timed else estimate.slowness()

    @property
    def seconds_here(self) -> float:
        """CPU seconds on one surface, on this machine."""
        return self.seconds * self.scale

    def with_replicas(self, replicas: int) -> Computation:
        """The same with another number of replicas."""
        hold = self.scene.hold
        if hold is None or hold.replicas == replicas:
            return self
        return replace(self, scene=self.scene.with_hold(replicas=replicas))

    def seeded(self, surface_seed: int, hold_seed: int) -> Scene:
        """The scene on one surface with its own disorder."""
        return self.scene.with_hold(seed=hold_seed).model_copy(
            update={"surface_seed": surface_seed}
        )

    def compute(self, surface_seed: int, hold_seed: int) -> SurfaceSample:
        """Compute one sample in this thread."""
        scene = self.seeded(surface_seed, hold_seed)
        return SurfaceSample.of(
            Outcome(run(scene, threads=1, warn=False, members=False))
        )


def computations(scene: Scene) -> list[Computation]:
    """Computations of ``scene`` that pay, the cheapest first and that of its own grid last.

    On coarser pixels the sites stay where they are; that of pixels which are sites gets the density of the scene's own
    pixels. All of them have one replica, whose random numbers they have in common.
    """
    base = scene.bare()
    own = estimated(base, 1)
    ways = [own]
    for factor in reversed(COARSER):
        coarse = base.coarser(factor)
        if coarse is not None:
            way = estimated(coarse, factor)
            if way.seconds <= PAYS * ways[-1].seconds:
                ways.append(way)
    return ways[::-1]


def sketched(cheapest: Computation) -> Computation | None:
    """The contact of a sketch of the surface, whose area explains most of the scatter between surfaces; None where the
    surface has no sketch, or it would cost too much."""
    scene = cheapest.scene
    maker = scene.surface.sketch() if scene.contact.gives_map else None
    if maker is None:
        return None
    sketch = estimated(
        scene.model_copy(update={"surface": maker, "hold": None}), cheapest.factor
    )
    return sketch if sketch.seconds <= CONTROL_PAYS * cheapest.seconds else None


def miniature(cheapest: Computation) -> Computation | None:
    """The same on the pixels of a sketch; None where the surface has no sketch."""
    maker, scene = cheapest.scene.surface.sketch(), cheapest.scene
    small = None if maker is None else scene.on(maker)
    return None if small is None else estimated(small, cheapest.factor)


def estimated(scene: Scene, factor: int) -> Computation:
    """The computation of ``scene``, whose pixels are ``factor`` times larger, with estimated costs."""
    costs = estimate.cost(scene, here=False)
    contact, replica = costs.contact_cpu_seconds, costs.kinetics_cpu_seconds
    if costs.kinetics_range is not None:
        replica = math.sqrt(math.prod(costs.kinetics_range))
    # what no component says is taken as so much per pixel; only the allocation depends on it
    if contact is None:
        contact = 1e-6 * max(costs.pixels, 1.0)
    sizes = [costs.contact_bytes, costs.replica_bytes if scene.ages else 0.0]
    known = [size for size in sizes if size is not None]
    size = max(known) if len(known) == len(sizes) else None
    return Computation(scene, factor, contact, replica or 1e-3, size)


def fitting(computation: Computation, workers: int) -> int:
    """How many surfaces are computed at the same time: ``workers``, or as many as the memory of this machine holds."""
    if not computation.bytes:
        return workers
    return max(1, int(min(workers, (capacity() - PROGRAM) / computation.bytes)))


def replicas_of_difference(fine: Computation, coarse: Computation) -> int:
    """Replicas of a sample of the difference between two computations: so many that kinetics take about as long as it
    is worth."""
    ageing = fine.scene.ageing
    if not fine.scene.ages or (ageing is not None and not ageing.replicates):
        return 1
    contacts = fine.contact_seconds + coarse.contact_seconds
    kinetics = max(fine.replica_seconds + coarse.replica_seconds, 1e-9)
    worth = round(math.sqrt(REPLICA_SHARE * contacts / kinetics))
    return max(1, min(MOST_REPLICAS, worth))


# -- settings from a map of speed against accuracy ---------------------------------------------------------------------


def mapped_computations(
    map: TradeMap,
    scene: Scene,
    quantities: Quantities,
    goals: Sequence[AccuracyGoal],
    budget: float,
) -> list[Computation]:
    """The settings of the map with which ``scene`` is expected to reach its goals at the least cost, and those of the
    scene itself last; only these where no other pay.

    Parameters
    ----------
    goals
        With accuracy 0: as accurate as the time allows.
    budget
        CPU seconds; inf: as long as it takes.
    """
    base, own = scene.bare(), map.own
    if own is None:
        return []
    whole = _mapped(base, own, map)
    names = _names(quantities)

    def price(point: TradePoint) -> float:
        """CPU seconds until every goal is reached; with a budget alone, the relative half width that it allows."""
        return max(
            _price(point, own, map, names[goal.column], goal.accuracy, budget)
            for goal in goals
        )

    def weighed(point: TradePoint) -> float:
        return MAP_PAYS * price(point) if point.own else price(point)

    chosen = min((own, *map.points), key=weighed)
    if chosen.own:
        return [whole]
    changed = _mapped(load_scene(base, chosen.changes), chosen, map)
    return [replace(changed, errors=_errors(chosen, names)), whole]


def _mapped(scene: Scene, point: TradePoint, map: TradeMap) -> Computation:
    contact, replica = map.seconds_of(point)
    pixel = scene.surface.expected().get("pixel_size", 0.0)
    own = map.scene.get("surface", {}).get("pixel_size")
    known = isinstance(own, int | float) and own > 0 and pixel
    return replace(
        estimated(scene, round(pixel / own) if known else 1),
        contact_seconds=contact,
        replica_seconds=replica,
        settings="" if point.own else point.words,
        grid_only=point.grid_only,
        timed=True,
    )


def _names(quantities: Quantities) -> list[str]:
    """The name of every column in a map."""
    curve = [f"friction_drop@{time:g} s" for time in quantities.hold_times.tolist()]
    return [
        *(["beta"] if quantities.has_beta else []),
        *curve,
        *quantities.measures,
    ]


def _errors(point: TradePoint, names: Sequence[str]) -> np.ndarray:
    """(quantities,) relative standard errors of the settings; nan where they were not measured."""
    if point.exact:
        return np.zeros(len(names))
    return np.array([point.deviation(name).size for name in names])


def _price(
    point: TradePoint,
    own: TradePoint,
    map: TradeMap,
    name: str,
    accuracy: float,
    budget: float,
) -> float:
    """CPU seconds until an observable is known to an accuracy, with or without corrections; 0: the relative half width
    that a budget allows."""
    seconds, whole = sum(map.seconds_of(point)), sum(map.seconds_of(own))
    surfaces = map.surface_scatter.get(name, 0.0) if map.random else 0.0
    variance = surfaces**2 + point.scatter.get(name, 0.0) ** 2
    size = change = 0.0
    if not (point.own or point.exact):
        deviation = point.deviation(name)
        # on random surfaces of the mean over the replicas of a round, as a correction has several replicas
        count = map.rounds if map.random else deviation.freedom + 1
        size, change = deviation.size, deviation.stderr**2 * count
    if math.isnan(size) or math.isnan(variance):
        return math.inf
    corrected = (
        math.sqrt(variance * seconds) + math.sqrt(change * (seconds + whole))
    ) ** 2
    if accuracy == 0:
        time = budget if math.isfinite(budget) else _ONE
        alone = math.sqrt(variance * seconds / time + size**2)
        return NORMAL_LIMIT * min(alone, math.sqrt(corrected / time))
    left = (accuracy / NORMAL_LIMIT) ** 2 - size**2
    plain = seconds * variance / left if left > 0 else math.inf
    return min(plain, corrected * (NORMAL_LIMIT / accuracy) ** 2)


def own_error(map: TradeMap, quantities: Quantities) -> str:
    """How far the scene's own settings are from the reference of the map, in words; "" where it is not known."""
    names = _names(quantities)
    if map.own is None or not names:
        return ""
    deviation = map.own.deviation(names[0])
    value, half = 100 * deviation.value, 100 * deviation.half_width
    if math.isnan(half):
        return ""
    return (
        f"with the settings of the scene {names[0].replace('_', ' ')} differs from that of the most accurate ones by "
        f"{value:.2g} ± {half:.2g} %, as measured for the map"
    )


# -- the error of the barriers -----------------------------------------------------------------------------------------


def barriers_error(
    samples: SampleSeries,
    quantities: Quantities,
    threads: int | None,
    progress: Callable[[int, int], None],
) -> tuple[np.ndarray, str]:
    """(quantities,) relative standard errors that the forming barriers make, and how they are known; zeros and "" where
    their distribution has no members.

    The error is relative and the same for all surfaces, so that that of the first sample is enough; more surfaces do
    not make it smaller.
    """
    errors = np.zeros(quantities.count)
    scene = samples.computation.seeded(*samples.seeds(0))
    chemistry = scene.chemistry
    if chemistry is None or not scene.ages or not chemistry.forming.members(1):
        return errors, ""

    def report(stage: str, done: int, total: int, note: str = "") -> None:
        if stage == BARRIERS and total:
            progress(done, total)

    ageing = run(scene, threads=threads, warn=False, progress=report).ageing
    assert ageing is not None
    assert ageing.member_ratios is not None
    drop, ratios = ageing.mean_friction_drop, ageing.member_ratios
    errors[quantities.curve] = ageing.errors[BARRIERS]
    if quantities.has_beta:
        own = float(quantities.slope(drop[None])[0])
        slopes = quantities.slope(ratios * drop)
        errors[0] = slopes.std(ddof=1) / abs(own) if own else np.nan
    return errors, f"measured here on one surface: {ageing.error_sources[BARRIERS]}"


# -- the error of a measured surface ----------------------------------------------------------------------------------

#: name of the error, and members of a surface that are computed
MEASUREMENT, SURFACES = "measurement", 8


def measurement_error(
    samples: SampleSeries,
    quantities: Quantities,
    threads: int | None,
    progress: Callable[[int, int], None],
) -> tuple[np.ndarray, str]:
    """(quantities,) relative standard errors that a measured surface makes by what its image does not show, and how
    they are known; zeros and "" where the surface has no members.

    They are the scatter between members, enlarged so that normal limits hold as Student's prediction interval of one
    more member does; more surfaces do not make them smaller. Members have the seeds of the first sample, unless seeds
    draw only what was not measured, which is not known either.
    """
    scene = samples.computation.scene
    members = list(scene.surface.members(SURFACES))
    if len(members) < 2:
        return np.zeros(quantities.count), ""
    scatter, rows = scene.surface.scatter({}), []
    others = scatter is not None and scatter.between == CONTINUATIONS
    for number, maker in enumerate(members):
        seeds = samples.seeds(number if others else 0)
        member = samples.computation.seeded(*seeds).model_copy(
            update={"surface": maker}
        )
        found = run(member, threads=threads, warn=False, members=False)
        rows.append(quantities.row(SurfaceSample.of(Outcome(found))))
        progress(number + 1, len(members))
    count, mean = len(rows), np.abs(np.mean(rows, axis=0))
    wider = student_limit(count - 1) / NORMAL_LIMIT * math.sqrt(1 + 1 / count)
    spread = np.std(rows, axis=0, ddof=1) * wider
    with np.errstate(divide="ignore", invalid="ignore"):
        # where a member has no such number, the error is not known
        errors = np.where(spread == 0, 0.0, spread / mean)
    return errors, f"measured here, {count} members: {scene.surface.unknown}"


#: called when a sample is there, with the number of those so far
Taken = Callable[[int], None]


def seed_of(base: int, level: int, number: int, what: int) -> int:
    """The seed of sample ``number`` of a level, a function of the arguments alone: of its surface (``what`` 0), or of
    its disorder and noise (1).

    It is a whole number below 2^53, so that ``chemage run --set surface.seed=...`` makes the same surface.
    """
    words = np.random.SeedSequence(
        base, spawn_key=(level, number, what)
    ).generate_state(2, np.uint32)
    return (int(words[0]) << 21) | (int(words[1]) >> 11)


class SampleSeries:
    """The samples of one computation on the surfaces (or replicas) of one level."""

    def __init__(
        self,
        computation: Computation,
        *,
        level: int,
        varied: bool,
        taken: Taken | None = None,
    ) -> None:
        """``varied``: another surface for each sample; else the surface of the scene with other replicas."""
        self.computation, self.level, self.varied = computation, level, varied
        #: without gaps, in the order of their numbers
        self.samples: list[SurfaceSample] = []
        self._taken = taken
        self._later: dict[int, SurfaceSample] = {}

    def seeds(self, number: int) -> tuple[int, int]:
        """The seeds of surface and disorder of a sample."""
        scene = self.computation.scene
        base = scene.hold.seed if scene.hold is not None else 0
        surface = (
            seed_of(scene.surface_seed, self.level, number, 0)
            if self.varied
            else scene.surface_seed
        )
        return surface, seed_of(base, self.level, number, 1)

    def task(self, number: int) -> Task:
        """The task of a sample."""
        computation = self.computation
        replicas = computation.replicas if computation.scene.ages else 0
        return Task.of(
            computation.seeded(*self.seeds(number)),
            number=number,
            contact_seconds=computation.contact_seconds,
            ageing_seconds=computation.replica_seconds * replicas,
            bytes=computation.bytes or 0.0,
            members=False,
        )

    def missing(self, count: int) -> list[Task]:
        """The tasks of the samples that are missing to ``count``."""
        return [
            self.task(number)
            for number in range(len(self.samples), count)
            if number not in self._later
        ]

    def receive(self, number: int, sample: SurfaceSample) -> None:
        """Add a sample; those before it may come later."""
        self._later[number] = sample
        while len(self.samples) in self._later:
            self.samples.append(self._later.pop(len(self.samples)))
            if self._taken is not None:
                self._taken(len(self.samples))


class SurfaceLevel:
    """A level of one computation on random surfaces, or of the difference between two on the same surfaces.

    ``name`` is that of the stage that is reported; ``row`` gives the numbers of a sample.
    """

    def __init__(
        self,
        name: str,
        row: Callable[[SurfaceSample], np.ndarray],
        *parts: SampleSeries,
    ) -> None:
        self.name, self.parts, self._row = name, parts, row
        self._rows: list[np.ndarray] = []
        self._contact: Any = None

    @property
    def cost(self) -> float:
        """CPU seconds of a sample."""
        return sum(part.computation.seconds for part in self.parts)

    @property
    def cost_here(self) -> float:
        """The same on this machine."""
        return sum(part.computation.seconds_here for part in self.parts)

    @property
    def words(self) -> str:
        """What is computed, in words."""
        return " minus ".join(part.computation.words for part in self.parts)

    def on(self, computation: Computation) -> SurfaceLevel:
        """The same level of another computation."""
        series = SampleSeries(computation, level=self.parts[0].level, varied=True)
        return SurfaceLevel(self.name, self._row, series)

    def warm_up(self) -> None:
        """Compile what the samples need."""
        for part in self.parts:
            part.computation.scene.warm_up()

    def take(self, number: int) -> None:
        """Compute a sample in this thread; replicas on one surface share its contact."""
        for part in self.parts:
            scene = part.computation.seeded(*part.seeds(number))
            contact = None if part.varied else self._contact
            found = run(
                scene, threads=1, warn=False, members=False, contact=contact
            )
            self._contact = found.contact
            part.receive(number, SurfaceSample.of(Outcome(found)))

    def sample(self, begin: int, end: int) -> np.ndarray:
        """(end − begin, quantities): those of the samples that are there."""
        there = zip(*(part.samples for part in self.parts), strict=False)
        for samples in islice(there, len(self._rows), None):
            self._rows.append(reduce(np.subtract, map(self._row, samples)))
        return np.array(self._rows[begin:end]) if self._rows else np.zeros((0, 0))


def area(sample: SurfaceSample) -> np.ndarray:
    """(1,) what the first level is regressed on."""
    return np.array([sample.measures["area_fraction"]])


def within(
    parts: tuple[SampleSeries, ...], quantities: Quantities
) -> np.ndarray | None:
    """The variance between replicas on one surface, (quantities,); None without any."""
    total, freedom = np.zeros(quantities.count), 0
    for sample in parts[0].samples:
        rows = quantities.replica_rows(sample)
        if len(rows) > 1:
            total += rows.var(axis=0, ddof=1) * (len(rows) - 1)
            freedom += len(rows) - 1
    return total / freedom if freedom else None
