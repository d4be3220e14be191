"""What an ensemble will do and cost, estimated before anything is computed.

The rule that stops an ensemble says what it will do with samples that have exactly the expected mean and variance: the
optimal allocation of multilevel Monte Carlo (Giles, Acta Numer. 24, 259 (2015)) with Student's limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import special

from chemage.foundation.text import percent
from chemage.foundation.threads import available
from chemage.scene import plan as estimate
from chemage.scene.plan import Plan
from chemage.scene.scene import Scene
from chemage.studies.ensembles import stages
from chemage.studies.ensembles.computations import (
    DIFFERENCE,
    DIFFERENCE_REPLICAS,
    PROGRAM,
    REPLICA_SHARE,
    Computation,
    fitting,
)
from chemage.studies.ensembles.goals import (
    Request,
    Scatters,
    is_about_zero,
    time_text,
)
from chemage.studies.ensembles.quantities import (
    RECORDED,
    declared_outputs,
    limit,
    recorded_measures,
)
from chemage.studies.ensembles.running import Sampler

#: probabilities at the ends of the ranges
TAILS = (0.1, 0.9)
#: correlation of the area of a sketch with what β has in common on a surface (``tests/benchmarks/sketches.py``)
CORRELATION = 0.95


@dataclass
class _ExpectedLevel:
    """A level of which any four samples have the mean and the variance that are expected."""

    cost: float
    mean: float
    #: (quantities,)
    deviation: np.ndarray
    #: (quantities,) with what the levels of a surface have in common
    correlation: np.ndarray
    name: str = ""
    parts: tuple[Any, ...] = ()

    def sample(self, begin: int, end: int) -> np.ndarray:
        """See :class:`chemage.studies.ensembles.stages.Level`."""
        number = np.arange(begin, end)[:, None]
        common, own = 1 - 2 * (number % 2), 1 - 2 * (number // 2 % 2)
        return self.mean + self.deviation * (
            self.correlation * common + np.sqrt(1 - self.correlation**2) * own
        )


@dataclass(frozen=True)
class Expectation:
    """What the rule is expected to do."""

    #: samples of the first level, and of the corrections
    samples: tuple[int, ...]
    cpu_seconds: float
    wall_seconds: float
    #: of the samples of the first level, in 80 % of cases
    range: tuple[int, int]
    #: quantity -> half the width of its interval over its mean
    intervals: dict[str, float] = field(default_factory=dict)
    #: why the accuracy is not reached: ``time``, or that of :class:`chemage.studies.ensembles.stages.Unreachable`
    reason: str = ""
    #: samples of the control
    sketches: int = 0

    @classmethod
    def counted(
        cls, count: int, seconds: float, workers: int, **more: Any
    ) -> Expectation:
        """Of a number of samples that is known, each of which takes ``seconds``."""
        return cls(
            (count,),
            count * seconds,
            count * seconds / min(workers, count),
            (count, count),
            **more,
        )

    @property
    def cpu_range(self) -> tuple[float, float]:
        """CPU seconds of as few, and of as many samples as the range says."""
        each = self.cpu_seconds / self.samples[0]
        return each * self.range[0], each * self.range[1]


def _expected_of(
    request: Request,
    routes: Sequence[stages.Route],
    expected: Scatters,
    mean: np.ndarray,
    workers: int,
    budget: float,
) -> Expectation:
    """What the rule does with samples that scatter exactly as is expected; ``mean`` (quantities,) is what errors of
    coarse grids may depend on."""
    columns = sorted(request.asked)
    scatter = expected.sample(routes[0].levels[0].parts[0].computation.replicas)[
        columns
    ]
    none, one = np.zeros(len(columns)), np.ones(1)
    correlation = CORRELATION * expected.surfaces[columns] / scatter
    first = _ExpectedLevel(routes[0].levels[0].cost, 1.0, scatter, correlation)
    drawn = []
    for route in routes:
        levels = [first]
        for correction in route.levels[1:]:
            per_surface = (
                1 + REPLICA_SHARE / correction.parts[0].computation.replicas
            )
            change = DIFFERENCE * math.sqrt(
                per_surface / (1 + REPLICA_SHARE / DIFFERENCE_REPLICAS)
            )
            levels.append(
                _ExpectedLevel(
                    correction.cost, 0.0, np.full(len(columns), change), none
                )
            )
        known, control = route.known(mean)[columns], None
        if route.control is not None:
            control = _ExpectedLevel(route.control.cost, 1.0, one, one)
        drawn.append(
            stages.Route(
                route.name, tuple(levels), lambda _, known=known: known, control
            )
        )
    clock = stages.Clock(budget, now=lambda: 0.0)
    clock.now = lambda: clock.cost / workers
    accuracy, reason = request.accuracy()[columns], ""
    try:
        state = stages.run_stages(drawn, accuracy, most=request.most, clock=clock)
        reason = "" if state.reached(accuracy) else "time"
        counts = state.counts
    except stages.Unreachable as error:
        state, reason = error.state, error.reason
        counts = error.needed or state.counts
    # what was tried and left costs, too
    cpu = max(
        clock.cost,
        sum(count * cost for count, cost in zip(counts, state.costs, strict=True)),
    )
    freedom = state.sampled[0].freedom
    # the number of samples goes with the variance, as it is measured with these degrees of freedom
    shares = (
        2 * special.gammaincinv(freedom / 2, TAILS) / freedom
        if reason != "time"
        else np.ones(2)
    )
    needed = (
        counts[0]
        if reason
        else counts[0] * float(np.max(state.relative() / accuracy)) ** 2
    )
    low, high = (
        max(stages.FIRST, round(share * needed)) for share in shares.tolist()
    )
    half = dict(zip(columns, state.relative().tolist(), strict=True))
    return Expectation(
        samples=tuple(counts[: len(counts) - state.controlled]),
        cpu_seconds=cpu,
        wall_seconds=cpu / min(workers, counts[0]),
        range=(low, high),
        intervals={name: half[column] for column, name in request.asked.items()},
        reason=reason,
        sketches=counts[-1] if state.controlled else 0,
    )


@dataclass(frozen=True)
class EnsemblePlan:
    """What is asked, the computations that may be used, and what they cost."""

    #: of one surface, as the scene is written
    one: estimate.Plan
    request: Request
    #: the cheapest first
    computations: tuple[Computation, ...]
    #: what is computed for a sample of the first level, and for a correction to it where there may be one
    levels: tuple[tuple[Computation, ...], ...]
    #: the computation of the area of the contact of a sketch, where there may be one
    control: Computation | None
    #: scatter that is expected
    scatters: Scatters
    #: what the rule is expected to do; None: not known before the first samples are computed
    foreseen: Expectation | None
    #: how that is known, in words
    reason: str

    @property
    def seconds(self) -> list[float]:
        """CPU seconds of a sample of each level."""
        return [sum(part.seconds_here for part in parts) for parts in self.levels]

    @property
    def expected(self) -> int | None:
        """Surfaces (or replicas) that are expected; None: not known before the first are computed."""
        return None if self.foreseen is None else self.foreseen.samples[0]

    @property
    def cpu_seconds(self) -> float | None:
        """CPU seconds of all levels; None where the number of samples is not known."""
        return None if self.foreseen is None else self.foreseen.cpu_seconds

    @property
    def memory(self) -> float | None:
        """Bytes, with as many surfaces at the same time as there are processors; None where it is not known."""
        used = (
            self.computations
            if self.foreseen is None or len(self._levels()) > 1
            else self.computations[:1]
        )
        sizes = [
            math.nan if one.bytes is None else one.bytes * self._at_once(one)
            for one in (used[0], used[-1])
        ]
        return None if math.isnan(sum(sizes)) else PROGRAM + max(sizes)

    def _at_once(self, computation: Computation) -> int:
        """Surfaces that are computed at the same time."""
        return fitting(computation, min(available(), self.expected or available()))

    @property
    def notes(self) -> list[str]:
        """What to know before it runs, in words."""
        # how long one run of the scene would take is another question
        notes = [
            note
            for note in self.one.notes
            if not note.startswith("this will take ")
        ]
        asked, budget = self.request, self.request.budget
        first = stages.FIRST * self.seconds[0] / available()
        if budget is not None and first > budget:
            notes.append(
                f"the first {stages.FIRST} {asked.counted}, without which there is no interval, take about "
                f"{time_text(first)}, which is longer than the budget of {budget:g} s"
            )
        seen = self.foreseen
        if seen is not None and asked.goals and seen.reason:
            notes.append(self._unreached(seen))
        return notes

    def _unreached(self, seen: Expectation) -> str:
        names = self.request.wishes
        if seen.reason == "time":
            return f"{names}: the time will be over before; {_intervals(seen)} is expected then"
        if seen.reason == "zero":
            return (
                f"{names}: its mean is expected to be 0 within its interval, {self.reason}; ask at other hold times, "
                "or another temperature"
            )
        needed = max(seen.samples) if seen.reason == "most" else None
        return self.request.refusal(needed, seen.cpu_seconds)

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        seen = self.foreseen
        return {
            **self.one.todict(),
            "notes": self.notes,
            "ensemble": {
                "surfaces": self.request.surfaces,
                "accuracy": {
                    goal.name: goal.accuracy for goal in self.request.goals
                },
                "budget": self.request.budget,
                "most": self.request.most,
                "random": self.request.random,
                "computations": [
                    {
                        "words": computation.words,
                        "cpu_seconds": computation.seconds_here,
                        "factor": computation.factor,
                    }
                    for computation in self.computations
                ],
                "levels": self._levels(),
                "sketches": None if self.sketch is None else self.sketch[1],
                "expected_samples": self.expected,
                "expected_samples_range": None
                if seen is None
                else list(seen.range),
                "expected_samples_reason": self.reason,
                "expected_intervals": None if seen is None else seen.intervals,
                "cpu_seconds": self.cpu_seconds,
                "cpu_seconds_range": None if seen is None else list(seen.cpu_range),
                "wall_seconds": None if seen is None else seen.wall_seconds,
                "memory": self.memory,
                "not_computed": self.not_computed(),
            },
        }

    def _levels(self) -> list[dict[str, Any]]:
        """What is computed for each level that is expected, how many samples, and the CPU seconds of one."""
        counts = () if self.foreseen is None else self.foreseen.samples
        levels = []
        for parts, count, seconds in zip(
            self.levels, counts, self.seconds, strict=False
        ):
            if count:
                level = {
                    "words": " minus ".join(part.words for part in parts),
                    "samples": count,
                }
                levels.append(
                    level | {"replicas": parts[0].replicas, "cpu_seconds": seconds}
                )
        return levels

    @property
    def sketch(self) -> tuple[Computation, int] | None:
        """The control, and how many samples of it are expected; None where it is not expected to pay."""
        count = 0 if self.foreseen is None else self.foreseen.sketches
        return (self.control, count) if self.control is not None and count else None

    def not_computed(self) -> list[str]:
        """What an ensemble leaves out of a run of its scene, and why, in words."""
        asked, first, sentences = self.request, self.computations[0], []
        scene = asked.scene
        if first.factor > 1:
            share = 100 * first.seconds / self.computations[-1].seconds
            why = "within the error that is stated for it"
            if len(self._levels()) > 1:
                why = "corrected on some surfaces"
            sentences.append(
                f"the contact grid of the scene on every surface: a coarser one costs {share:.2g} %, {why}"
            )
        written = (
            scene.hold.replicas if scene.hold is not None and scene.ages else 1
        )
        if asked.random and first.replicas < written:
            sentences.append(
                f"{written} replicas on each surface: with the scatter between surfaces, one on each of more "
                "surfaces says more"
            )
        known = recorded_measures(scene)
        left = [
            name
            for name in declared_outputs(scene)
            if f"{RECORDED}{name}" not in known
        ]
        left += [
            observable.kind
            for observable in scene.observe
            if not observable.outputs
        ]
        if left:
            sentences.append(
                f"arrays that are recorded ({', '.join(left)}): an ensemble averages declared numbers"
            )
        sentences.append(
            "maps of heights and pressure are not kept: no mean over surfaces needs them"
        )
        return sentences

    def rows(self) -> list[tuple[str, str]]:
        """(name, text) lines for a table."""
        asked, seen, hold = self.request, self.foreseen, self.request.scene.hold
        # what one surface costs is in the rows of the computations
        left_out = ("expected cost", "result file", "expected memory")
        rows = [row for row in self.one.rows() if row[0] not in left_out]
        if asked.surfaces is None and hold is not None:  # replicas are chosen, too
            chosen = f", {hold.replicas} replicas"
            rows = [(name, text.replace(chosen, "")) for name, text in rows]
        over = "replicas on the one surface, which is the same at every seed"
        rows.append(("mean", f"over {'random surfaces' if asked.random else over}"))
        wanted = [
            f"{goal.name} ± {100 * goal.accuracy:.3g} %" for goal in asked.goals
        ]
        if asked.surfaces is not None:
            wanted = [f"{asked.surfaces} {asked.counted}"]
        if asked.budget is not None:
            first = ", whichever comes first" if wanted else ""
            wanted.append(f"{asked.budget:g} s of wall time{first}")
        rows.append(("asked for", ", ".join(wanted)))
        rows += self._computation_rows()
        number = f"number of {asked.counted}"
        if seen is None:
            rows.append(
                (number, f"decided after the first {stages.FIRST}: {self.reason}")
            )
        else:
            low, high = seen.range
            spread = f" ({low} to {high})" if low < high else ""
            rows.append((number, f"{seen.samples[0]}{spread}, {self.reason}"))
            if seen.intervals:
                rows.append(("expected interval", _intervals(seen)))
            low, high = seen.cpu_range
            spread = (
                f" ({time_text(low)} to {time_text(high)})"
                if high > 1.3 * low
                else ""
            )
            cpu, wall = time_text(seen.cpu_seconds), time_text(seen.wall_seconds)
            text = f"about {cpu} of CPU time{spread}, {wall} on this machine"
            rows.append(("expected cost", text))
        if self.memory is not None:
            at_once = self._at_once(self.computations[0])
            text = f"about {self.memory / 1e9:.2g} GB, {at_once} at the same time"
            rows.append(("expected memory", text))
        return rows + [("not computed", text) for text in self.not_computed()]

    def _computation_rows(self) -> list[tuple[str, str]]:
        first, *others = self.computations
        rows = [("cheapest computation" if others else "computation", first)]
        rows += [("computation that may correct it", one) for one in others[-1:]]
        texts = [
            (
                name,
                f"{one.words}, about {time_text(one.seconds_here)} of CPU time each",
            )
            for name, one in rows
        ]
        if self.sketch is not None:
            sketch, count = self.sketch
            grid, each = (
                sketch.words.partition(",")[0],
                time_text(sketch.seconds_here),
            )
            text = f"the area of the contact of {count} surfaces on {grid}, {each} of CPU time each"
            texts.append(("control", text))
        if len(self.seconds) == 1:
            return texts
        levels, count = self._levels(), stages.FIRST_DIFFERENCES
        if len(levels) > 1:
            spent = time_text(levels[1]["samples"] * levels[1]["cpu_seconds"])
            text = f"{levels[1]['samples']} of {levels[1]['words']}, {spent} CPU"
        elif self.foreseen is not None:
            text = (
                "none expected: the stated error of the coarse grid is small enough"
            )
        else:
            text = f"where they pay: {count} first, {time_text(count * self.seconds[1])} CPU"
        return [*texts, ("corrections", text)]


def _intervals(seen: Expectation) -> str:
    return ", ".join(
        f"{name} ± {percent(half)}" for name, half in seen.intervals.items()
    )


def plan(scene: Scene) -> EnsemblePlan:
    """Foresee the ensemble that ``scene`` asks for.

    Raises
    ------
    InputError
        The request contradicts itself or the scene, or one surface needs more memory than this machine has.
    """
    with scene.in_use():
        single = estimate.plan(scene)
        sampler = Sampler(scene, warn=False)  # the plan has the doubts as notes
        request = sampler.request
        first, *_ = stated = tuple(request.computations())
        routes = sampler.possible_routes()
        levels = tuple(
            tuple(part.computation for part in level.parts)
            for level in routes[-1].levels
        )
        control = routes[0].control
        sketch = None if control is None else control.parts[0].computation
        costs = estimate.cost(scene)
        expected = Scatters.of(request, costs, single.numbers)
        seen, reason = _expectation(request, routes, costs, expected, first)
        if seen is not None:
            cpu, wall = (
                seen.cpu_seconds * first.scale,
                seen.wall_seconds * first.scale,
            )
            seen = replace(seen, cpu_seconds=cpu, wall_seconds=wall)
    return EnsemblePlan(
        single, request, stated, levels, sketch, expected, seen, reason
    )


def _expectation(
    request: Request,
    routes: Sequence[stages.Route],
    costs: Plan,
    expected: Scatters,
    first: Computation,
) -> tuple[Expectation | None, str]:
    """What the rule is expected to do, and how that is known; ``first`` is the cheapest computation, in whose seconds
    all times are."""
    quantities, workers, budget = request.quantities, available(), math.inf
    scatter = expected.sample(first.replicas)[sorted(request.asked)]
    zero = is_about_zero(scatter)
    if (count := request.surfaces) is not None:
        half = limit(count - 1) * float(scatter[0]) / math.sqrt(count)
        known = math.isfinite(half) and not zero[0]
        intervals = {quantities.names[0]: half} if known else {}
        seen = Expectation.counted(
            count, first.seconds, workers, intervals=intervals
        )
        return seen, "as asked for"
    workers, timed = fitting(first, workers), stages.FIRST
    if request.budget is not None:
        budget = request.budget / first.scale
        timed = max(timed, int(workers * budget / first.seconds))
    why = _why(request, expected, first.replicas)
    if np.any(zero):
        return Expectation.counted(
            timed, first.seconds, workers, reason="zero"
        ), why
    if np.isfinite(scatter).all():
        # of all but the area only the relative scatter counts
        mean = np.ones(quantities.count)
        mean[quantities.curve.stop :] = np.nan
        if (
            costs.area_fraction is not None
            and "area_fraction" in quantities.measures
        ):
            mean[quantities.column("area_fraction")] = costs.area_fraction
        return _expected_of(request, routes, expected, mean, workers, budget), why
    if request.budget is not None and not request.goals:
        seen = Expectation.counted(timed, first.seconds, workers)
        return seen, "as many as the time allows"
    source = f": {expected.source}" if expected.source else ""
    return (
        None,
        f"the scatter between {request.counted} is not known before{source}",
    )


def _why(request: Request, expected: Scatters, replicas: int) -> str:
    """How the expected number is known, in words."""
    scatter = expected.sample(replicas)
    column, name = max(request.asked.items(), key=lambda item: scatter[item[0]])
    if not is_about_zero(scatter[column]):
        by = ", as of sites that react independently"
        if expected.source:
            by = f": {expected.source}"
        return f"from a scatter of {name} of {percent(float(scatter[column]))}{by}"
    quantities = request.quantities
    when = f"until {name.partition('@')[2] or f'{quantities.hold_times[-1]:g} s'}"
    if name == "beta":
        when = "between {:g} and {:g} s".format(*quantities.window)
    text = (
        f"since hardly a bond is expected to form {when}, so that {name} is about 0"
    )
    timed = request.budget is not None and not request.goals
    return f"as many as the time allows, {text}" if timed else text
