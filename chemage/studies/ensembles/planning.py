"""What an ensemble will do and cost, from a pilot: a few of its own samples, which are computed first.

The rule that stops an ensemble is carried out many times, with the samples of the pilot and more of them, whose mean and
covariance are drawn from what the pilot allows: Jeffreys' posterior of normal samples (Gelman et al., Bayesian Data
Analysis, 3rd ed. (2013), section 3.6), which is as wide as Student's t and χ² of so few samples are.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from chemage.foundation.statistics import half_width
from chemage.foundation.text import percent, plus_minus
from chemage.foundation.threads import available
from chemage.scene import plan as estimate
from chemage.scene.scene import Scene
from chemage.studies.ensembles import stages
from chemage.studies.ensembles.computations import (
    DIFFERENCE,
    DIFFERENCE_REPLICAS,
    PROGRAM,
    REPLICA_SHARE,
    Computation,
    SurfaceLevel,
    fitting,
    miniature,
)
from chemage.studies.ensembles.goals import Request, time_text
from chemage.studies.ensembles.quantities import (
    RECORDED,
    declared_outputs,
    recorded_measures,
)
from chemage.studies.ensembles.running import Sampler

#: probabilities at the ends of the ranges
TAILS = (0.1, 0.9)
#: samples of a pilot: at least, and at most, where they take less than PILOT seconds of CPU time together
LEAST, MOST, PILOT = 3, 16, 0.5
#: CPU seconds that the least samples of a level may take; above, a smaller grid takes their place, or nothing
LONGEST = 5.0
#: samples that members of barriers or of a surface are worth
MEMBERS = 10
#: times that the rule is carried out
DRAWS = 60
#: standard deviation of the logarithm of what is not measured: of a correction, and of a sample on another grid
DOUBT = 0.7
#: the same of the speed of a machine from one minute to the next
UNEVEN = 0.15


class _Measured(NamedTuple):
    """What a pilot gives of a level."""

    #: (n, quantities)
    rows: np.ndarray
    #: (n,) CPU seconds; () where they are estimated
    seconds: list[float]
    #: whether these are samples of the ensemble itself
    own: bool = True


@dataclass(frozen=True)
class Pilot:
    """Real samples of the levels of an ensemble."""

    #: by the name of the stage, as far as they are cheap
    levels: dict[str, _Measured]
    #: how the number of samples is known, in words
    source: str

    @classmethod
    def of(cls, levels: Sequence[Any], varied: bool, longest: float) -> Pilot:
        """Take samples of ``levels``, of which the first decides; ``longest`` (CPU s) is allowed for the least."""
        found, source = {}, ""
        for level in levels:
            seconds = _timed(level, longest)
            if seconds:
                rows = level.sample(0, len(seconds))
                found[level.name] = _Measured(rows, seconds)
            elif level is levels[0]:
                small = miniature(level.parts[0].computation) if varied else None
                on = None if small is None else level.on(small)
                seconds = [] if on is None else _timed(on, longest)
                if on is None or len(seconds) < LEAST:
                    need = time_text(LEAST * level.cost_here)
                    return cls(
                        {},
                        f"a pilot of {LEAST} would take about {need} of CPU time",
                    )
                rows, source = on.sample(0, len(seconds)), f", on {on.words}"
                found[level.name] = _Measured(rows, [], own=False)
        count = len(found[levels[0].name].rows)
        counted = "surfaces" if varied else "replicas"
        return cls(found, f"from a pilot of {count} {counted}{source}")


def _timed(level: SurfaceLevel, longest: float) -> list[float]:
    """Take samples of a level; CPU seconds of each, none where they are expected to take too long."""
    seconds: list[float] = []
    if LEAST * level.cost_here > longest:
        return seconds
    level.warm_up()
    while len(seconds) < MOST and (len(seconds) < LEAST or sum(seconds) < PILOT):
        begin = time.process_time()
        level.take(len(seconds))
        seconds.append(time.process_time() - begin)
        if max(seconds) > 2 * longest:  # the estimate was wrong
            break
    return seconds


class _Drawn:
    """Rows that a pilot allows: its own, and more with a mean and a covariance that are drawn."""

    def __init__(
        self, rows: np.ndarray, rng: np.random.Generator, *, own: bool
    ) -> None:
        """``rows`` (n, columns) of a pilot; ``own``: they are the first ones."""
        count, columns = rows.shape
        mean, away = rows.mean(axis=0), rows - rows.mean(axis=0)
        square = away.T @ away
        square[np.diag_indices(columns)] *= 1 + 1e-9
        square[np.diag_indices(columns)] += 1e-300
        # Bartlett's factor of a Wishart matrix
        freedoms = np.maximum(count - 1 - np.arange(columns), 1)
        bartlett = np.tril(rng.standard_normal((columns, columns)), -1)
        bartlett += np.diag(np.sqrt(rng.chisquare(freedoms)))
        self._factor = np.linalg.solve(bartlett, np.linalg.cholesky(square).T)
        self._mean = mean + rng.standard_normal(columns) @ self._factor / math.sqrt(
            count
        )
        self._rng = rng
        self.rows = rows if own else np.zeros((0, columns))

    def upto(self, count: int) -> np.ndarray:
        """(count, columns)"""
        more = max(0, count - len(self.rows))
        drawn = self._mean + self._rng.standard_normal((more, self._mean.size)) @ (
            self._factor
        )
        self.rows = np.concatenate([self.rows, drawn])
        return self.rows[:count]


@dataclass
class _DrawnLevel:
    """A level whose samples are drawn."""

    #: as estimated, by which the rule decides, and as measured
    cost: float
    seconds: float
    drawn: _Drawn
    columns: slice
    name: str = ""
    parts: tuple[Any, ...] = ()
    taken: int = 0

    def sample(self, begin: int, end: int) -> np.ndarray:
        """See :class:`chemage.studies.ensembles.stages.Level`."""
        self.taken = max(self.taken, end)
        return self.drawn.upto(end)[begin:, self.columns]


@dataclass(frozen=True)
class Expectation:
    """What the rule is expected to do."""

    #: samples of the first level, and of the corrections
    samples: tuple[int, ...]
    cpu_seconds: float
    wall_seconds: float
    #: of the samples of the first level, in 80 % of cases
    range: tuple[int, int]
    #: of the CPU seconds
    cpu_range: tuple[float, float]
    #: quantity -> half the width of its interval over its mean
    intervals: dict[str, float] = field(default_factory=dict)
    #: why the accuracy is not reached: ``time``, or that of :class:`chemage.studies.ensembles.stages.Unreachable`
    reason: str = ""
    #: samples of the control
    sketches: int = 0
    #: what is doubtful about it, in words
    doubts: tuple[str, ...] = ()

    @classmethod
    def counted(cls, count: int, seconds: float, workers: int) -> Expectation:
        """Of a number of samples that is known, each of which is estimated to take ``seconds``."""
        cpu, wall = count * seconds, count * seconds / min(workers, count)
        return cls((count,), cpu, wall, (count, count), (cpu, cpu))


class _Forecast:
    """Carries out the rule with samples that a pilot allows."""

    def __init__(
        self,
        request: Request,
        routes: Sequence[stages.Route],
        pilot: Pilot,
        workers: int,
        before: float,
    ) -> None:
        """``before``: CPU seconds of what is computed before the samples."""
        self.request, self.routes, self.pilot = request, routes, pilot
        times = pilot.levels[routes[0].levels[0].name].seconds
        if len(times) > 1 and not request.random:  # their one contact
            before += max(0.0, times[0] - float(np.mean(times[1:])))
        self.workers, self.before = workers, before
        self.columns = sorted(request.asked)
        self.rows = pilot.levels[routes[0].levels[0].name].rows
        self.mean = self.rows.mean(axis=0)

    @property
    def says_nothing(self) -> bool:
        """Whether nothing follows from the samples of the pilot."""
        rows = self.rows[:, self.columns]
        same = (rows == rows[0]).all(axis=0)
        return len(rows) < 2 or not np.isfinite(rows).all() or bool(same.any())

    def doubts(self) -> tuple[str, ...]:
        """What the pilot leaves open, in words."""
        count, doubts = len(self.rows), []
        of = f"the {count} samples of the pilot"
        for column, name in self.request.asked.items():
            values = self.rows[:, column]
            if count < 2:
                doubts.append("the pilot has a single sample, which took too long")
            elif not np.isfinite(values).all():
                doubts.append(f"{name}: not all of {of} have it")
            elif (values == values[0]).all():
                doubts.append(f"{name}: {of} are equal, {values[0]:.4g}")
            elif (half := float(half_width(values))) >= abs(values.mean()):
                text = plus_minus(float(values.mean()), half, "")
                doubts.append(
                    f"{name} cannot be told from zero: it is {text} in {of}"
                )
        return tuple(doubts)

    def drawn(self, rng: np.random.Generator) -> list[stages.Route]:
        """The routes with levels whose samples are drawn."""
        level, control = self.routes[0].levels[0], self.routes[0].control
        pairs = self.rows[:, self.columns]
        sketches = None
        if control is not None:
            sketches = self.pilot.levels.get(control.name)
        if sketches is not None:
            both = min(len(pairs), len(sketches.rows))
            pairs = np.hstack([pairs[:both], sketches.rows[:both]])
        own = self.pilot.levels[level.name].own
        values = _Drawn(pairs, rng, own=own)
        some = slice(0, len(self.columns))
        first = self._level(level, values, some, rng)
        drawn = []
        for route in self.routes:
            levels = [first]
            for more in route.levels[1:]:
                change = self.pilot.levels.get(more.name)
                differences = self._unmeasured(more, rng)
                if change is not None:
                    differences = change.rows[:, self.columns]
                others = _Drawn(differences, rng, own=change is not None)
                levels.append(self._level(more, others, some, rng))
            known = route.known(self.mean)[self.columns]
            beside = None
            if control is not None and sketches:
                last = slice(len(self.columns), None)
                beside = self._level(control, values, last, rng)
            drawn.append(
                stages.Route(
                    route.name, tuple(levels), lambda _, known=known: known, beside
                )
            )
        return drawn

    def _level(
        self,
        level: Any,
        drawn: _Drawn,
        columns: slice,
        rng: np.random.Generator,
    ) -> _DrawnLevel:
        measured = self.pilot.levels.get(level.name)
        times = measured.seconds if measured is not None else []
        seconds, error = level.cost_here, DOUBT
        if times:
            # the first sample prepares the others
            kept = np.array(times[1:] if len(times) > 2 else times)
            seconds = float(kept.mean())
            error = math.hypot(UNEVEN, kept.std() / seconds / math.sqrt(kept.size))
        seconds *= math.exp(error * rng.standard_normal())
        return _DrawnLevel(level.cost, seconds, drawn, columns, level.name)

    def _unmeasured(self, level: Any, rng: np.random.Generator) -> np.ndarray:
        """Differences between grids as they were measured on other surfaces."""
        replicas = level.parts[0].computation.replicas
        each, others = (
            1 + REPLICA_SHARE / count for count in (replicas, DIFFERENCE_REPLICAS)
        )
        change = DIFFERENCE * math.sqrt(each / others) * self.mean[self.columns]
        change = change * math.exp(DOUBT * rng.standard_normal())
        return change * rng.standard_normal((LEAST, change.size))

    def once(
        self, rng: np.random.Generator
    ) -> tuple[stages.SamplingState, str, list[int] | None, float]:
        """What one set of samples leads to: the last state, why it does not reach the accuracy, the samples that are
        needed, and CPU seconds."""
        request, routes = self.request, self.drawn(rng)
        levels: dict[str, Any] = {
            level.name: level
            for route in routes
            for level in (*route.levels, route.control)
            if level is not None
        }

        def spent() -> float:
            taken = sum(one.taken * one.seconds for one in levels.values())
            return self.before + taken

        clock = stages.Clock(
            math.inf if request.budget is None else request.budget,
            now=lambda: spent() / self.workers,
        )
        accuracy = request.accuracy()[self.columns]
        if request.surfaces is not None:
            first = routes[0].levels[0]
            values = first.sample(0, request.surfaces)
            one, asked = (
                stages.Sampled(first, values),
                np.zeros(accuracy.size, bool),
            )
            state = stages.SamplingState(routes[0], [one], asked)
            return state, "", state.counts, spent()
        try:
            state = stages.run_stages(
                routes, accuracy, most=request.most, clock=clock
            )
        except stages.Unreachable as error:
            needed, seconds = error.needed, spent()
            if needed:
                each = [
                    levels[one.level.name].seconds for one in error.state.sampled
                ]
                seconds = float(np.dot(needed[: len(each)], each[: len(needed)]))
            return error.state, error.reason, needed, seconds
        reason = "" if state.reached(accuracy) else "time"
        return state, reason, state.counts, spent()

    def expectation(self) -> Expectation:
        """Of many such sets."""
        found = [
            self.once(np.random.default_rng([20261127, number]))
            for number in range(DRAWS)
        ]
        reason, times = Counter(one[1] for one in found).most_common(1)[0]
        if times < DRAWS / 2:
            reason = ""
        # what no number of samples reaches takes all that are allowed
        counts = np.array(
            [self.request.most if one[2] is None else one[2][0] for one in found]
        )
        seconds = np.array([one[3] for one in found])
        middle = found[int(np.argsort(counts, kind="stable")[DRAWS // 2])]
        alike = [one for one in found if one[1] == reason] or found
        halves = np.median([one[0].relative() for one in alike], axis=0).tolist()
        half = dict(zip(self.columns, halves, strict=True))
        state, _, needed, _ = middle
        low, high = np.quantile(counts, TAILS).tolist()
        samples = needed or state.counts
        least, cpu, most = np.quantile(seconds, (TAILS[0], 0.5, TAILS[1])).tolist()
        return Expectation(
            samples=tuple(samples[: len(samples) - state.controlled]),
            cpu_seconds=cpu,
            wall_seconds=cpu / min(self.workers, samples[0]),
            range=(math.floor(low), math.ceil(high)),
            cpu_range=(least, most),
            intervals={
                name: half[column] for column, name in self.request.asked.items()
            },
            reason=reason,
            sketches=samples[-1] if state.controlled else 0,
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
        if seen is not None:
            notes += seen.doubts
            if asked.goals and seen.reason:
                notes.append(self._unreached(seen))
        return notes

    def _unreached(self, seen: Expectation) -> str:
        names = self.request.wishes
        if seen.reason == "time":
            return f"{names}: the time will be over before; {_intervals(seen)} is expected then"
        if seen.reason == "zero":
            return (
                f"{names}: its mean is expected to be 0 within its interval; ask at other hold times, or another "
                "temperature"
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
            more = " or more" if high >= asked.most else ""
            spread = f" ({low} to {high}{more})" if low < high else ""
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


def plan(scene: Scene, longest: float = LONGEST) -> EnsemblePlan:
    """Foresee the ensemble that ``scene`` asks for, from a pilot of it that takes ``longest`` (CPU s) or about so long.

    Raises
    ------
    InputError
        The request contradicts itself or the scene, or one surface needs more memory than this machine has.
    """
    with scene.in_use():
        single = estimate.plan(scene)
        sampler = Sampler(scene, warn=False)  # the plan has the doubts as notes
        request = sampler.request
        stated = tuple(request.computations())
        begin = time.process_time()
        if MEMBERS * stated[0].seconds_here < longest:
            sampler.measure_members()
        before = time.process_time() - begin
        routes = sampler.possible_routes()
        levels = tuple(
            tuple(part.computation for part in level.parts)
            for level in routes[-1].levels
        )
        control = routes[0].control
        sketch = None if control is None else control.parts[0].computation
        seen, reason = _foreseen(request, routes, stated[0], longest, before)
    return EnsemblePlan(single, request, stated, levels, sketch, seen, reason)


def _foreseen(
    request: Request,
    routes: Sequence[stages.Route],
    first: Computation,
    longest: float,
    before: float,
) -> tuple[Expectation | None, str]:
    """What the rule is expected to do, and how that is known."""
    workers, timed = fitting(first, available()), stages.FIRST
    sampled = [*routes[-1].levels]
    if routes[0].control is not None:
        sampled.append(routes[0].control)
    pilot = Pilot.of(sampled, request.random, longest)
    if request.budget is not None:
        timed = max(timed, int(workers * request.budget / first.seconds_here))
    asked_for = request.surfaces or (not request.goals and timed) or 0
    if not pilot.levels:
        if not asked_for:
            return None, pilot.source
        each = first.seconds_here
        seen = Expectation.counted(asked_for, each, workers)
        how = "as asked for" if request.surfaces else "as many as the time allows"
        return seen, f"{how}; {pilot.source}"
    forecast = _Forecast(request, routes, pilot, workers, before)
    doubts = forecast.doubts()
    source = "as asked for" if request.surfaces else pilot.source
    if not forecast.says_nothing:
        return replace(forecast.expectation(), doubts=doubts), source
    zero = "zero" if np.any(forecast.mean[forecast.columns] == 0) else ""
    if not (asked_for or zero):
        return None, doubts[0]
    each = first.seconds_here
    seen = Expectation.counted(asked_for or stages.FIRST, each, workers)
    return replace(seen, reason=zero, doubts=doubts), source
