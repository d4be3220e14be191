"""What the rule that stops an ensemble will do, found by applying it to imagined samples of the expected scatter."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from chemage.lattices.independent import expected_kinetics, rough_pressures, smooth_pressures
from chemage.scene.plan import Plan
from chemage.scene.scene import Scene
from chemage.studies.ensembles import stages
from chemage.studies.ensembles.computations import DIFFERENCE, DIFFERENCE_REPLICAS, REPLICA_SHARE
from chemage.studies.ensembles.goals import Request

#: how often the rule is applied, for the median and the range
TRIALS = 31
#: part of the trials on each side of the range
TAIL = 0.1
#: correlation of the area of a sketch with what β has in common on a surface (``tests/benchmarks/sketches.py``)
CORRELATION = 0.95


@dataclass(frozen=True)
class Scatters:
    """Standard deviations over the mean that are expected, of each quantity; nan: not known."""

    #: (quantities,) between surfaces
    surfaces: np.ndarray
    #: (quantities,) between replicas on one surface
    replicas: np.ndarray
    #: how that between surfaces is known, in words
    source: str

    def sample(self, replicas: int) -> np.ndarray:
        """(quantities,) between samples of ``replicas`` on each surface."""
        return np.sqrt(self.surfaces**2 + self.replicas**2 / replicas)


def is_about_zero(scatter: np.ndarray | float) -> np.ndarray | bool:
    """Whether a mean of this relative scatter is that of too few bonds for one in each of the first samples."""
    return scatter**2 > stages.FIRST


def scatters(request: Request, costs: Plan, contact: Mapping[str, float]) -> Scatters:
    """The scatter of what ``request`` averages, of which ``known`` are the estimates and ``contact`` the expected
    measures of the contact."""
    quantities, scene = request.quantities, request.scene
    first, times = int(quantities.has_beta), quantities.hold_times.size
    surfaces, source = np.full(quantities.count, np.nan), ""
    if not request.random:
        surfaces[:] = 0.0
    elif (scatter := scene.surface.scatter(contact)) is not None:
        source = scatter.source
        if scatter.relative is not None:
            # the friction drop scatters as much as β does
            surfaces[: first + times] = scatter.relative
    replicas = np.zeros(quantities.count)
    replicas[: first + times] = _replicas(scene, costs, request)
    return Scatters(surfaces, replicas, source)


def _replicas(scene: Scene, costs: Plan, request: Request) -> np.ndarray:
    """(β and hold times,) standard deviation between replicas over the mean: that of sites which react independently.

    Of N sites that are bonded with the probability p(t), the bonds at t ≤ u have the covariance N p(t) (1 − p(u)).
    """
    quantities, chemistry, hold = request.quantities, scene.chemistry, scene.hold
    first, times = int(quantities.has_beta), quantities.hold_times.size
    scatter = np.full(first + times, np.nan)
    if chemistry is None or hold is None or costs.mean_pressure is None or not costs.sites:
        return scatter
    if scene.ageing is not None and not scene.ageing.replicates:
        return np.zeros(first + times)
    spread = smooth_pressures if "radius" in costs.surface else rough_pressures
    pressures = spread(costs.mean_pressure)
    needed = {goal.column - first for goal in request.goals} | set(np.flatnonzero(quantities.fitted) if first else ())
    bonded = np.full(times, np.nan)
    for number in needed:
        if 0 <= number < times:
            time = float(quantities.hold_times[number])
            bonded[number] = expected_kinetics(chemistry, pressures, time, hold.temperature).bonded
    with np.errstate(divide="ignore", invalid="ignore"):
        scatter[first:] = np.sqrt((1 - bonded) / (costs.sites * bonded))
    if first:
        share = bonded[quantities.fitted]
        x = np.log10(quantities.hold_times[quantities.fitted])
        x = x - x.mean()
        earlier, later = np.minimum.outer(share, share), np.maximum.outer(share, share)
        variance, slope = float(x @ (earlier * (1 - later)) @ x) / costs.sites, float(x @ share)
        # the quadrature of shares that are all 0 or all 1 rounds
        rises = slope > 1e-12 * float(np.abs(x).sum())
        scatter[0] = math.sqrt(max(variance, 0.0)) / slope if rises else math.inf if slope == slope else math.nan
    return scatter


@dataclass
class _Spent:
    """CPU and wall seconds of imagined samples."""

    cpu: float = 0.0
    wall: float = 0.0


@dataclass
class _Imagined:
    """A level of which the samples are normal numbers."""

    cost: float
    mean: np.ndarray
    deviation: np.ndarray
    rng: np.random.Generator
    workers: int
    spent: _Spent
    #: (quantities,) correlation with the number that each surface has
    correlation: np.ndarray
    #: of the numbers of the surfaces, the same for the levels that have them in common
    seed: int

    def sample(self, begin: int, end: int) -> np.ndarray:
        """See :class:`chemage.studies.ensembles.stages.Level`."""
        self.spent.cpu += self.cost * (end - begin)
        self.spent.wall += self.cost * (end - begin) / min(self.workers, max(1, end - begin))
        own = self.rng.normal(size=(end - begin, self.mean.size))
        common = np.random.default_rng(self.seed).normal(size=end)[begin:, None]
        return self.mean + self.deviation * (self.correlation * common + np.sqrt(1 - self.correlation**2) * own)


@dataclass(frozen=True)
class Expectation:
    """Medians over trials of what the rule does, and ranges of 80 % of the trials."""

    #: samples of the first level, and of the corrections
    samples: tuple[int, ...]
    #: of the first level
    range: tuple[int, int]
    cpu_seconds: float
    cpu_range: tuple[float, float]
    wall_seconds: float
    #: quantity -> half the width of its interval over its mean
    intervals: dict[str, float] = field(default_factory=dict)
    #: part of the trials in which the accuracy is reached
    reached: float = 1.0
    #: why it is not: the reasons of :class:`chemage.studies.ensembles.stages.Unreachable`
    reason: str = ""
    #: samples of the control
    sketches: int = 0

    def scaled(self, factor: float) -> Expectation:
        """The same where everything takes ``factor`` times as long."""
        low, high = self.cpu_range
        return replace(
            self,
            cpu_seconds=self.cpu_seconds * factor,
            cpu_range=(low * factor, high * factor),
            wall_seconds=self.wall_seconds * factor,
        )


def expected_of(
    request: Request, routes: list[stages.Route], expected: Scatters, means: Mapping[str, float], workers: int
) -> Expectation | None:
    """Apply the rule to imagined samples; None where the scatter of a quantity is not known.

    Parameters
    ----------
    routes
        Those of the ensemble; their levels state their costs and are not sampled.
    means
        Measures of the contact that are expected, of which errors of coarse grids may depend.
    workers
        Surfaces that are computed at the same time.
    """
    columns = sorted({goal.column for goal in request.goals}) or [0]
    replicas = [_replicas_of(level) for level in routes[0].levels]
    scatter = expected.sample(replicas[0])[columns]
    if np.any(is_about_zero(scatter)):
        cost, count = routes[0].levels[0].cost, stages.FIRST
        if request.budget is not None:
            count = max(count, int(workers * request.budget / cost))
        cpu = count * cost
        return Expectation((count,), (count, count), cpu, (cpu, cpu), cpu / workers, {}, 0.0, "zero")
    if not np.isfinite(scatter).all():
        return None
    full = _mean(request, means)
    trials = [_trial(request, routes, expected, full, columns, workers, seed) for seed in range(TRIALS)]
    firsts = sorted(trial.samples[0] for trial in trials)
    cpu = sorted(trial.cpu_seconds for trial in trials)
    levels = max(len(trial.samples) for trial in trials)
    counts = [[(*trial.samples, *[0] * levels)[k] for trial in trials] for k in range(levels)]
    low, high = int(TAIL * (TRIALS - 1)), int((1 - TAIL) * (TRIALS - 1))
    middle = {name: float(np.median([trial.intervals[name] for trial in trials])) for name in trials[0].intervals}
    reasons = [trial.reason for trial in trials if trial.reason]
    return Expectation(
        samples=tuple(round(float(np.median(one))) for one in counts),
        range=(firsts[low], firsts[high]),
        cpu_seconds=float(np.median(cpu)),
        cpu_range=(cpu[low], cpu[high]),
        wall_seconds=float(np.median([trial.wall_seconds for trial in trials])),
        intervals=middle,
        reached=1 - len(reasons) / TRIALS,
        reason=max(set(reasons), key=reasons.count) if reasons else "",
        sketches=round(float(np.median([trial.sketches for trial in trials]))),
    )


def _replicas_of(level: stages.Level) -> int:
    return level.parts[0].computation.replicas  # pyright: ignore[reportAttributeAccessIssue]


def _mean(request: Request, means: Mapping[str, float]) -> np.ndarray:
    """(quantities,): 1 where only the relative scatter counts, measures of the contact as far as they are known."""
    quantities = request.quantities
    measures = [means.get(name, math.nan) for name in quantities.measures]
    return np.concatenate([np.ones(quantities.count - len(measures)), measures])


def _trial(
    request: Request,
    routes: list[stages.Route],
    expected: Scatters,
    full: np.ndarray,
    columns: list[int],
    workers: int,
    seed: int,
) -> Expectation:
    """One application of the rule."""
    rng, spent = np.random.default_rng(seed), _Spent()
    levels: dict[int, _Imagined] = {}

    def imagined(level: stages.Level, number: int) -> _Imagined:
        if id(level) not in levels:
            replicas = _replicas_of(level)
            deviation = expected.sample(replicas)[columns]
            mean, correlation = np.ones(len(columns)), np.zeros(len(columns))
            if number:
                per_surface = (1 + REPLICA_SHARE / replicas) / (1 + REPLICA_SHARE / DIFFERENCE_REPLICAS)
                deviation, mean = np.full(len(columns), DIFFERENCE * math.sqrt(per_surface)), np.zeros(len(columns))
            else:
                correlation = CORRELATION * expected.surfaces[columns] / np.maximum(deviation, 1e-300)
            levels[id(level)] = _Imagined(level.cost, mean, deviation, rng, workers, spent, correlation, seed)
        return levels[id(level)]

    def sketched(level: stages.Level | None) -> _Imagined | None:
        one = np.ones(1)
        return None if level is None else _Imagined(level.cost, one, one, rng, workers, spent, one, seed)

    def errors(route: stages.Route) -> Callable[[np.ndarray], np.ndarray]:
        return lambda mean: route.known(full)[columns]

    drawn = [
        stages.Route(
            one.name,
            tuple(imagined(level, k) for k, level in enumerate(one.levels)),
            errors(one),
            sketched(one.control),
        )
        for one in routes
    ]
    clock = stages.Clock(math.inf if request.budget is None else request.budget, now=lambda: spent.wall)
    accuracy = request.accuracy()[columns]
    reason = ""
    try:
        state = stages.run_stages(drawn, accuracy, most=request.most, clock=clock)
        counts = state.counts
    except stages.Unreachable as error:
        state, reason = error.state, error.reason
        counts = error.needed or state.counts
    half = state.half_width() / np.abs(state.mean)
    names = [goal.name for goal in request.goals] or [request.quantities.names[0]]
    places = [columns.index(goal.column) for goal in request.goals] or [0]
    cpu, wall = spent.cpu, spent.wall
    if reason == "most":
        cpu = sum(count * one.level.cost for count, one in zip(counts, state.sampled, strict=True))
        wall = cpu / workers
    return Expectation(
        samples=tuple(counts[: len(counts) - state.controlled]),
        sketches=counts[-1] if state.controlled else 0,
        range=(counts[0], counts[0]),
        cpu_seconds=cpu,
        cpu_range=(cpu, cpu),
        wall_seconds=wall,
        intervals={name: float(half[place]) for name, place in zip(names, places, strict=True)},
        reason=reason or ("" if state.reached(accuracy) else "time"),
    )
