"""The rule by which an ensemble is sampled: in three stages, after which its interval is as narrow as asked.

A first stage of few samples says roughly how many are needed; a quarter of these says it better. The second stage takes
half of them and fixes the variance, the third the rest. The interval is Student's with the variance of the second
stage, or that of all samples where it is larger, and the degrees of freedom of the second stage less two. With the
variance of a stage that is fixed before, the coverage of normal samples is that stated, whatever the number of samples
that the variance leads to (Stein, Ann. Math. Stat. 16, 243 (1945); three stages: Hall, Ann. Stat. 9, 1229 (1981)). Here
the second stage is as large as the first one says, for which the two degrees of freedom are given up, and several
levels have approximate degrees of freedom, so that the coverage is measured: 93 to 97 % (``tests/studies/ensembles``).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from chemage.studies.ensembles.quantities import (
    Spread,
    allocated,
    half_width,
    optimal,
    regressed,
)

#: samples of the first stage: of a level that is sampled often, and of one that corrects it
FIRST, FIRST_DIFFERENCES = 6, 5
#: parts of the samples that seem to be needed: after the first, their number is looked at again; the second fixes the
#: variance
LOOK, SECOND = 0.25, 0.5
#: degrees of freedom that are given up because the variance was looked at before it was fixed: without them the
#: intervals hold the truth in 92.5 to 95 % of cases
LOOKS = 2
#: degrees of freedom of a variance that is taken as known
CERTAIN = 10**6
#: a control is tried where so many samples of the first level seem to be needed, on at most so many of them
CONTROLLED, PAIRS = 32, 16


class Level(Protocol):
    """What is sampled: one computation on a random surface, or the difference between two on the same surface."""

    #: of the stage that is reported
    name: str
    #: the computations of which it has samples
    parts: tuple[Any, ...]

    @property
    def cost(self) -> float:
        """CPU seconds of one sample, estimated before anything is computed, so that it is the same everywhere."""
        ...

    def sample(self, begin: int, end: int) -> np.ndarray:
        """(end − begin, quantities): the samples of these numbers, the same however they are divided into calls."""
        ...


@dataclass(frozen=True)
class Route:
    """One way to the answer: the levels whose means add up to it, and the errors that no sampling makes smaller."""

    name: str
    levels: tuple[Level, ...]
    #: (quantities,) of the mean of all quantities: relative standard errors from other causes; nan: not known, so that
    #: no accuracy can be promised
    known: Callable[[np.ndarray], np.ndarray]
    #: (samples, 1): a cheap number of the surface of each sample of the first level, and of more surfaces, which the
    #: first level is regressed on where that pays; its costs are those of the number alone
    control: Level | None = None


@dataclass
class Sampled:
    """The samples of one level so far."""

    level: Level
    #: (samples, quantities)
    values: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    #: samples in the variance, once it is fixed
    frozen: int = 0
    #: degrees of freedom that are given up
    looks: int = 0

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.values)

    @property
    def chosen(self) -> int:
        """Samples in the variance."""
        return self.frozen or self.count

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the variance."""
        return max(1, self.chosen - 1 - self.looks)


@dataclass
class SamplingState:
    """What is known after the samples so far."""

    route: Route
    #: of each level of the route, and of its control where that is used
    sampled: list[Sampled]
    #: (quantities,) bool: what is to be accurate
    asked: np.ndarray

    @property
    def controlled(self) -> bool:
        """Whether the last of the samples are those of the control."""
        return len(self.sampled) > len(self.route.levels)

    @property
    def counts(self) -> list[int]:
        """Samples so far."""
        return [sampled.count for sampled in self.sampled]

    @property
    def costs(self) -> list[float]:
        """CPU seconds of a sample."""
        return [sampled.level.cost for sampled in self.sampled]

    @property
    def terms(self) -> list[np.ndarray]:
        """(samples, quantities) of each level: independent samples, whose means add up to the mean."""
        values = [sampled.values for sampled in self.sampled]
        return regressed(values) if self.controlled else values

    @property
    def spreads(self) -> list[Spread]:
        """Of each of the terms: the variance that the interval is made of."""
        return [
            Spread.of(
                term,
                sampled.chosen,
                sampled.freedom,
                self.controlled and not number,
            )
            for number, (term, sampled) in enumerate(
                zip(self.terms, self.sampled, strict=True)
            )
        ]

    @property
    def mean(self) -> np.ndarray:
        """(quantities,)"""
        return np.sum([term.mean(axis=0) for term in self.terms], axis=0)

    @property
    def known(self) -> np.ndarray:
        """(quantities,) standard errors that no sampling makes smaller."""
        mean = self.mean
        return self.route.known(mean) * np.abs(mean)

    def half_width(self) -> np.ndarray:
        """(quantities,) half the width of the interval."""
        return half_width(self.spreads, self.counts, self.known)

    def relative(self) -> np.ndarray:
        """(quantities,) the same over the magnitude of the mean."""
        return self.half_width() / np.maximum(np.abs(self.mean), 1e-300)

    def reached(self, accuracy: np.ndarray) -> bool:
        """Whether the interval of everything that is to be accurate is as narrow as that, (quantities,) relative."""
        wanted = accuracy[self.asked] * (1 + 1e-9)
        return bool(
            np.all(self.relative()[self.asked] <= wanted) and np.all(wanted > 0)
        )

    def cost(self, counts: Sequence[int], each: Sequence[float]) -> float:
        """Seconds of the samples that are missing to ``counts``, of which one takes ``each``."""
        return sum(
            max(0, count - done) * one
            for count, done, one in zip(counts, self.counts, each, strict=True)
        )

    def upto(self, counts: Sequence[int], clock: Clock) -> Steps:
        """Take samples until there are ``counts``; each of the first level has that of the control."""
        for sampled, count in zip(self.sampled, counts, strict=True):
            yield from clock.upto(sampled, count)
        if self.controlled:
            yield from clock.upto(self.sampled[-1], self.sampled[0].count)


class Unreachable(Exception):
    """No number of samples gives the accuracy that was asked for."""

    def __init__(
        self, state: SamplingState, needed: list[int] | None, reason: str
    ) -> None:
        super().__init__(reason)
        self.state, self.needed, self.reason = state, needed, reason


#: what has to be there before the next step: a level, and how many samples of it
Need = tuple[Level, int]
#: a part of the rule, which stops where samples have to be taken
Steps = Generator[Need, None, None]
#: called after each stage, with what is known and the counts that are aimed at
Watch = Callable[[SamplingState, list[int]], None]


@dataclass
class Clock:
    """The wall time that sampling may take; without a budget it is unlimited, and never measured."""

    seconds: float = math.inf
    now: Callable[[], float] = time.monotonic
    begin: float = field(init=False)
    #: CPU seconds of the samples so far, as estimated before
    cost: float = 0.0

    def __post_init__(self) -> None:
        self.begin = self.now()

    @property
    def left(self) -> float:
        """Seconds that are left."""
        return (
            self.seconds - (self.now() - self.begin)
            if math.isfinite(self.seconds)
            else math.inf
        )

    def upto(self, sampled: Sampled, count: int) -> Steps:
        """Take samples until there are ``count``."""
        if count > sampled.count:
            yield sampled.level, count
            self.cost += (count - sampled.count) * sampled.level.cost
            more = sampled.level.sample(sampled.count, count)
            sampled.values = (
                np.concatenate([sampled.values, more]) if sampled.count else more
            )

    def wall(self, level: Level) -> float:
        """Wall seconds of one more sample: in proportion to its cost, as measured of those so far."""
        return max(
            level.cost * (self.now() - self.begin) / max(self.cost, 1e-12), 1e-9
        )

    def affordable(self, state: SamplingState, counts: list[int]) -> list[int]:
        """``counts``, or as many samples as the time that is left allows, divided so that the interval is narrowest."""
        if not math.isfinite(self.seconds):
            return counts
        walls = [self.wall(sampled.level) for sampled in state.sampled]
        left = max(self.left, 0.0)
        if state.cost(counts, walls) <= left:
            return counts
        widest = np.argmax(
            np.where(
                state.asked & ~np.isnan(relative := state.relative()),
                relative,
                -np.inf,
            )
        )
        variances = [float(spread.variance[widest]) for spread in state.spreads]
        if not any(
            variances
        ):  # equal samples say nothing of what other samples would be
            variances[0] = 1.0
        best = optimal(variances, walls, state.counts, budget=left)
        return [
            min(int(count), most) for count, most in zip(best, counts, strict=True)
        ]


def run_stages(
    routes: Sequence[Route], accuracy: np.ndarray, *, most: int, **options: Any
) -> SamplingState:
    """Carry out :func:`steps` with levels whose samples are there when they are asked for; the arguments are the
    same."""
    rule = steps(routes, accuracy, most=most, **options)
    while True:
        try:
            next(rule)
        except StopIteration as end:
            return end.value


def steps(
    routes: Sequence[Route],
    accuracy: np.ndarray,
    *,
    most: int,
    clock: Clock | None = None,
    watch: Watch | None = None,
) -> Generator[Need, None, SamplingState]:
    """Sample until the half width of the interval is at most ``accuracy`` times the mean, in every quantity, or until
    the time of ``clock`` is over; stop wherever samples have to be taken, which are there when the rule goes on.

    Parameters
    ----------
    routes
        Ways to the answer whose first levels are the same.
    accuracy
        (quantities,) relative half widths asked for; inf where a quantity need not be accurate, 0 where it is to be as
        accurate as the time allows.
    most
        Samples of one level that are allowed.
    watch
        Called after each stage.

    Raises
    ------
    Unreachable
        More than ``most`` samples would be needed, or errors that are known already are too large or not known, or a
        mean is zero within its interval. With a clock only where an error is not known of what is to be accurate.
    """
    clock = clock or Clock()
    beginning = Sampled(routes[0].levels[0], looks=LOOKS)
    yield from clock.upto(beginning, FIRST)
    state = SamplingState(routes[0], [beginning], np.isfinite(accuracy))
    search = RouteSearch(routes, accuracy, most, clock)
    state, counts = yield from search.chosen(state)
    state, counts = yield from search.controlled(state, counts)
    for part in (LOOK, SECOND):
        aimed = clock.affordable(state, counts)
        if watch is not None:
            watch(state, aimed)
        done = [0] * len(aimed) if part == LOOK else state.counts
        yield from state.upto(
            [
                math.ceil(before + part * max(0, count - before))
                for before, count in zip(done, aimed, strict=True)
            ],
            clock,
        )
        counts = search.needed(state)
    for sampled in state.sampled:
        sampled.frozen = sampled.count
    while True:
        counts = search.needed(state)
        aimed = clock.affordable(state, counts)
        if watch is not None:
            watch(state, aimed)
        if all(
            count <= done for count, done in zip(aimed, state.counts, strict=True)
        ):
            return state
        # with a budget in parts, because times vary
        part = 0.7 if math.isfinite(clock.seconds) else 1.0
        steps = [
            math.ceil(part * max(0, count - done))
            for count, done in zip(aimed, state.counts, strict=True)
        ]
        yield from state.upto(
            [done + step for done, step in zip(state.counts, steps, strict=True)],
            clock,
        )


@dataclass(frozen=True)
class RouteSearch:
    """How many samples are needed, and which route needs the least."""

    routes: Sequence[Route]
    accuracy: np.ndarray
    most: int
    clock: Clock

    def needed(self, state: SamplingState, expected: bool = False) -> list[int]:
        """The numbers of samples that the accuracy needs; with a budget no more than ``most``.

        Parameters
        ----------
        expected
            As if the variances were known: for a choice, since few samples of a correction would make it seem dear.

        Raises
        ------
        Unreachable
            See :func:`run_stages`.
        """
        mean, half = state.mean, state.half_width()
        asked = np.isfinite(self.accuracy)
        timed = math.isfinite(self.clock.seconds)
        if not timed and np.any(
            asked & ((mean == 0) | (np.abs(mean) <= 0.2 * half))
        ):
            raise Unreachable(state, None, "zero")
        if np.any(asked & (self.accuracy > 0) & np.isnan(state.known)):
            raise Unreachable(state, None, "unknown")
        if not np.any(
            asked & (self.accuracy > 0)
        ):  # as accurate as the time allows
            return [self.most] * len(state.sampled)
        counts = allocated(
            [Spread(spread.variance, CERTAIN) for spread in state.spreads]
            if expected
            else state.spreads,
            state.costs,
            state.counts,
            state.known,
            np.where(
                asked, np.where(asked, self.accuracy, 0.0) * np.abs(mean), np.inf
            ),
        )
        if counts is None and not timed:
            raise Unreachable(state, None, "known")
        if counts is None:
            return [self.most] * len(state.sampled)
        # the first samples say how many are needed within a factor of four
        certain = all(sampled.frozen for sampled in state.sampled)
        if not timed and max(counts) > (self.most if certain else 4 * self.most):
            raise Unreachable(state, counts, "most")
        if state.controlled:
            counts[-1] = max(counts[-1], counts[0])
        return [min(count, self.most) for count in counts]

    def controlled(
        self, state: SamplingState, counts: list[int]
    ) -> Generator[Need, None, tuple[SamplingState, list[int]]]:
        """The same with the control of the route, where that seems to be cheaper; and the counts."""
        control = state.route.control
        first = min(
            PAIRS, math.ceil(LOOK * self.clock.affordable(state, counts)[0])
        )
        if control is None or counts[0] < CONTROLLED or first < FIRST:
            return state, counts
        tried = SamplingState(
            state.route,
            [*state.sampled, Sampled(control, looks=LOOKS)],
            state.asked,
        )
        yield from tried.upto(
            [max(first, state.sampled[0].count), *state.counts[1:], first],
            self.clock,
        )
        try:
            plain = self.needed(state, expected=True)
            regressed = self.needed(tried, expected=True)
            pays = self.price(tried, regressed) < self.price(state, plain)
            return (
                (tried, self.needed(tried)) if pays else (state, self.needed(state))
            )
        except Unreachable:
            return state, counts

    def chosen(
        self, state: SamplingState
    ) -> Generator[Need, None, tuple[SamplingState, list[int]]]:
        """The route that seems best after the first stage, and its counts; routes with corrections take their first
        samples where they may be better than those without."""
        candidates: list[tuple[float, SamplingState, list[int]]] = []
        failed: Unreachable | None = None
        for route in sorted(self.routes, key=lambda route: len(route.levels)):
            if candidates and not self._may_pay(
                route, state, min(candidate[0] for candidate in candidates)
            ):
                continue
            tried = SamplingState(route, [state.sampled[0]], state.asked)
            for level in route.levels[1:]:
                more = Sampled(level, looks=LOOKS)
                yield from self.clock.upto(more, FIRST_DIFFERENCES)
                tried.sampled.append(more)
            try:
                counts = self.needed(tried)
                price = self.price(tried, self.needed(tried, expected=True))
            except Unreachable as error:
                failed = (
                    failed
                    if failed is not None and failed.needed is not None
                    else error
                )
                continue
            candidates.append((price, tried, counts))
        if not candidates:
            assert failed is not None
            raise failed
        _, chosen, counts = min(candidates, key=lambda candidate: candidate[0])
        return chosen, counts

    def price(self, state: SamplingState, counts: list[int]) -> float:
        """What a route costs, CPU seconds; where time is limited, the relative half width that it will reach."""
        if math.isfinite(self.clock.seconds):
            aimed = self.clock.affordable(state, counts)
            half = half_width(state.spreads, aimed, state.known)
            relative = half / np.maximum(np.abs(state.mean), 1e-300)
            return float(
                np.max(np.where(np.isnan(relative), np.inf, relative)[state.asked])
            )
        spent = sum(
            sampled.level.cost * sampled.count for sampled in state.sampled[1:]
        )
        return state.cost(counts, state.costs) + spent

    def _may_pay(self, route: Route, state: SamplingState, least: float) -> bool:
        """Whether the first samples of a route may be worth their cost."""
        if math.isfinite(self.clock.seconds):
            return (
                FIRST_DIFFERENCES * self.clock.wall(route.levels[-1])
                < 0.35 * self.clock.left
            )
        # what it costs at least: its first samples, and the first level without the errors that it corrects
        alone = SamplingState(
            Route("", route.levels[:1], route.known), state.sampled[:1], state.asked
        )
        try:
            first = alone.cost(self.needed(alone, expected=True), alone.costs)
        except Unreachable:
            return False
        return (
            FIRST_DIFFERENCES * sum(level.cost for level in route.levels[1:])
            + first
            < least
        )
