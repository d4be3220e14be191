"""Groups of a few sites whose master equation is solved exactly, and the comparison of an engine with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from chemage.foundation.units import KB
from chemage.kinetics.role import Engine
from chemage.lattices.lattice import ReactionLattice
from chemage.testing.checks import CHANCE, binomial_chance, require

TEMPERATURE = 300.0
NU = 1e13
#: groups on one lattice: small, because the simplest engines need a time that grows as the square of the sites
COPIES = 12
LARGE = 150


def barrier(rate: float, temperature: float = TEMPERATURE, nu: float = NU) -> float:
    """The barrier (eV) over which a site reacts at ``rate`` (1/s)."""
    return KB * temperature * math.log(nu / rate)


def evolved(generator: np.ndarray, rates: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """The master equation solved for rates over any number of decades.

    Parameters
    ----------
    generator
        (n, n), 1/s: the rate from state j to state i; columns sum to 0.
    rates
        (n, k), 1/s: how often each of k kinds of events happens in each state.
    time
        s.

    Returns
    -------
    (n, n) probability of state i at the end from state j, and (n, k) mean number of events from each state.

    Scaling and squaring, in which nothing is ever subtracted: the series of uniformization for a time in which hardly
    anything happens (Jensen 1953), then squares of a matrix of probabilities whose columns are normalised each time. A
    diagonal near 1 follows from the small entries beside it, so each rate keeps its relative accuracy beside others 60
    decades faster (compare Xue and Ye, Math. Comp. 82, 1577 (2013)); the usual exponential loses it.
    """
    fastest = float(-generator.diagonal().min(initial=0.0))
    identity = np.eye(generator.shape[0])
    if fastest * time == 0.0:
        return identity, rates * time
    doublings = max(math.ceil(math.log2(fastest) + math.log2(time)), 0)
    span = math.ldexp(time, -doublings)
    steps = fastest * span
    jumps = np.where(identity == 1.0, np.maximum(1.0 + generator / fastest, 0.0), generator / fastest)
    power = chances = so_far = identity  # the k-th power of the jumps, and the sum of those before
    waits = np.zeros_like(identity)
    weight = 1.0
    for k in range(1, 22):
        weight *= steps / k
        waits = waits + weight * so_far
        power = jumps @ power
        chances = chances + weight * power
        so_far = so_far + power
    chances = chances / chances.sum(axis=0)
    events = span * ((waits / waits.sum(axis=0)).T @ rates)
    for _ in range(doublings):
        events = events + chances.T @ events
        chances = chances @ chances
        chances /= chances.sum(axis=0)
    return chances, events


@dataclass(frozen=True)
class Group:
    """A few sites, coupled with each other and with nothing else. Energies in eV."""

    forming: tuple[float, ...]
    breaking: tuple[float, ...] | None = None
    #: [i][j]: what a bond of j adds to the forming barrier of i
    pair: tuple[tuple[float, ...], ...] | None = None

    def generator(self, temperature: float = TEMPERATURE, nu: float = NU) -> np.ndarray:
        """Rates (1/s) from every state to every other, (2**m, 2**m), columns sum to 0; bit i of a state is set where
        site i is bonded."""
        m = len(self.forming)
        pair = None if self.pair is None else np.array(self.pair, np.float32).astype(float)
        generator = np.zeros((2**m, 2**m))
        for state in range(2**m):
            bonded = [j for j in range(m) if state >> j & 1]
            for i in range(m):
                if i in bonded:
                    energy = math.inf if self.breaking is None else self.breaking[i]
                else:
                    energy = self.forming[i] + (0.0 if pair is None else float(pair[i, bonded].sum()))
                rate = nu * math.exp(-max(energy, 0.0) / (KB * temperature))
                generator[state ^ 1 << i, state] += rate
                generator[state, state] -= rate
        return generator

    def solution(
        self, time: float, temperature: float = TEMPERATURE, nu: float = NU, start: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Probability of every state after ``time`` s, (2**m,), and the mean number of events of each site, (m,)."""
        generator = self.generator(temperature, nu)
        states, site = np.arange(generator.shape[0]), np.arange(len(self.forming))
        chances, events = evolved(generator, generator[states[:, None] ^ 1 << site, states[:, None]], time)
        return chances[:, start], events[start]

    def probabilities(
        self, time: float, temperature: float = TEMPERATURE, nu: float = NU, start: int = 0
    ) -> np.ndarray:
        """Probability of every state after ``time`` s, (2**m,)."""
        return self.solution(time, temperature, nu, start)[0]

    def lattice(self, copies: int = COPIES, *, nu: float = NU, slots: int = 0, seed: int = 1) -> ReactionLattice:
        """``copies`` of the group next to each other, none coupled to another.

        The sites are every third pixel, so that a site's position in the list is not its pixel. With ``slots`` more
        slots per site than it has neighbours, the empty ones are anywhere in its row.
        """
        return _lattice(self, copies, nu, slots, seed)


@lru_cache(maxsize=256)
def _lattice(group: Group, copies: int, nu: float, slots: int, seed: int) -> ReactionLattice:
    m = len(group.forming)
    n = m * copies
    fields: dict[str, Any] = {}
    if group.breaking is not None:
        fields["breaking"] = np.tile(group.breaking, copies)
    if group.pair is not None:
        neighbours = np.full((n, m - 1 + slots), -1, dtype=np.int32)
        coupling = np.zeros(neighbours.shape, np.float32)  # as interactions give them
        rng = np.random.default_rng(seed)
        for site in range(n):
            first, i = site - site % m, site % m
            others = [j for j in range(m) if j != i and group.pair[i][j] != 0.0]
            places = np.arange(m - 1) if not slots else rng.permutation(neighbours.shape[1])
            for place, j in zip(places, others, strict=False):
                neighbours[site, place] = first + j
                coupling[site, place] = group.pair[i][j]
        fields |= {"neighbours": neighbours, "coupling": coupling}
    return ReactionLattice(
        pixels=(max(n, 1), 3),
        sites=3 * np.arange(n) + 1,
        forming=np.tile(group.forming, copies),
        attempt_frequency=nu,
        **fields,
    )


def single(forming: float, breaking: float | None = None) -> Group:
    """One site with these rates (1/s) at 300 K."""
    return Group((barrier(forming),), None if breaking is None else (barrier(breaking),))


def coupled(scale: float = 1.0) -> Group:
    """Four sites, each coupled to the other three, with rates of about one per second."""
    pair = np.zeros((4, 4))
    pair[np.triu_indices(4, 1)] = scale * np.array([0.05, -0.03, 0.02, 0.07, -0.02, 0.04])
    pair += pair.T
    return Group(
        tuple(barrier(k) for k in (3.0, 1.0, 0.6, 2.0)),
        tuple(barrier(k) for k in (0.5, 1.5, 0.2, 0.9)),
        tuple(map(tuple, pair.tolist())),
    )


@dataclass(frozen=True)
class Trials:
    """How many lattices of how many groups are run."""

    copies: int
    runs: int

    @classmethod
    def of(cls, component: Engine, runs: int = 200) -> Trials:
        """Many small lattices; for an approximate engine few larger ones, as it may round the number of bonds."""
        return cls(COPIES, runs) if component.exact else cls(LARGE, 8)


def states(history_state: np.ndarray, m: int) -> np.ndarray:
    """How many groups are in each state, (2**m,)."""
    return np.bincount(history_state.reshape(-1, m) @ (1 << np.arange(m)), minlength=2**m)


def sampled(
    component: Engine,
    group: Group,
    time: float,
    *,
    runs: int = 200,
    temperature: float = TEMPERATURE,
    nu: float = NU,
    slots: int = 0,
    start: bool = False,
) -> np.ndarray:
    """States of the groups after ``time`` s over many seeds, (2**m,); from all bonds where ``start`` is true."""
    sample = Trials.of(component, runs)
    m = len(group.forming)
    counts = np.zeros(2**m, dtype=np.int64)
    for seed in range(sample.runs):
        lattice = group.lattice(sample.copies, nu=nu, slots=slots, seed=seed % 5)
        begin = np.ones(lattice.sites.size, dtype=bool) if start else None
        history = component.run(lattice, [0.5 * time, time], temperature=temperature, seed=seed, start=begin)
        counts += states(history.state, m)
    return counts


def compare(component: Engine, where: str, counts: np.ndarray, probabilities: np.ndarray) -> None:
    """Require that ``counts`` of groups in each state agree with the ``probabilities`` of the master equation.

    An exact engine: every site, every pair of sites and every state, each by its binomial distribution. An approximate
    one: the mean number of bonds, to within its declared error.
    """
    total, size = int(counts.sum()), counts.size
    m = size.bit_length() - 1
    every = np.arange(size)
    bonds = np.array([int(state).bit_count() for state in every])
    mean, expected = float(counts @ bonds) / total, float(probabilities @ bonds)
    if not component.exact:
        _within_declared(
            component, where, mean, expected, math.sqrt(float(probabilities @ (bonds - expected) ** 2 / total))
        )
        return
    questions = [(f"site {i} is bonded" if m > 1 else "the site is bonded", every >> i & 1 == 1) for i in range(m)]
    questions += [
        (f"sites {i} and {j} are both bonded", (every >> i & 1) + (every >> j & 1) == 2)
        for i in range(m)
        for j in range(i)
    ]
    if m > 2:
        questions += [
            (f"just the sites {[i for i in range(m) if state >> i & 1]} are bonded", every == state) for state in every
        ]
    for what, yes in questions:
        count, p = int(counts[yes].sum()), min(max(float(probabilities[yes].sum()), 0.0), 1.0)
        require(
            binomial_chance(count, total, p) > CHANCE,
            f"{where}, {what} in {count} of {total} cases; the master equation gives {total * p:.4g} "
            f"± {math.sqrt(total * p * (1 - p)):.2g}",
        )


def compare_mean(component: Engine, where: str, bonds: Sequence[int], of: int, probability: float) -> None:
    """Require that the numbers of ``bonds`` of runs with ``of`` independent sites each agree with ``probability``."""
    count, total = int(np.sum(bonds)), of * len(bonds)
    compare(component, where, np.array([total - count, count]), np.array([1 - probability, probability]))


def _within_declared(component: Engine, where: str, mean: float, expected: float, noise: float) -> None:
    error = component.declared_error or 0.0
    require(
        # and half a bond per lattice, for rounding
        abs(mean - expected) <= error * expected + 6.5 * noise + 0.5 / LARGE,
        f"{where}, {mean:.4g} bonds per group; the master equation gives {expected:.4g}, which is "
        f"{abs(mean / expected - 1) if expected else math.inf:.1%} away; declared_error = {error:g}",
    )


@dataclass(frozen=True)
class GroupHold:
    """A group, and a hold at whose end one of its sites is bonded in 5 to 95 % of all cases."""

    group: Group
    time: float
    """s"""
    temperature: float
    """K"""
    start: bool
    """whether all sites are bonded at the beginning"""
    probabilities: np.ndarray
    """(2**m,) of every state at the end"""
    events: np.ndarray
    """(m,) mean number of events of each site"""


@lru_cache(maxsize=256)
def random_hold(
    seed: int, rows: int = 1, columns: int = 2, *, events: float = 60.0, flips: float = 60.0, decades: float = 60.0
) -> GroupHold:
    """A grid of sites, each coupled to the up to eight around it, with rates that differ by up to 10**``decades``.

    One site flickers, with up to ``flips`` events in the mean, in one of its states up to half the ``decades`` faster
    than in the other; all others together have at most ``events``. The site in doubt is next to it, and its rate
    depends on that state by about as much, so that it may react out of either. A single site is in doubt itself.
    """
    rng = np.random.default_rng((seed, rows, columns))
    m, half = rows * columns, 0.5 * decades
    at = np.stack(np.divmod(np.arange(m), columns), axis=1)
    near = np.abs(at[:, None] - at).max(axis=2) == 1
    while True:
        kelvin, time = 10.0 ** rng.uniform(1.7, 3.2), 10.0 ** rng.uniform(-10.0, 20.0)
        # powers of ten of rate times hold time, (2, m): forming, breaking
        powers = rng.uniform(-half, half, (2, m))
        slower = powers.argmin(axis=0)
        powers[slower, np.arange(m)] = np.minimum(powers.min(axis=0), rng.uniform(-half, 1.0, m))
        flickering = doubtful = int(rng.integers(m))
        slow = rng.uniform(0.3, math.log10(flips))
        powers[:, flickering] = rng.permutation([slow, slow + rng.uniform(0.0, half) * rng.integers(2)])
        pair = np.triu(rng.normal(0.0, 10.0 ** rng.uniform(-1.0, 0.7), (m, m)) * near)
        pair += pair.T
        if m > 1:
            doubtful = int(rng.choice(np.flatnonzero(near[flickering])))
            ratio = 10.0 ** (powers[0, flickering] - powers[1, flickering])
            contrast = math.log(ratio) * rng.uniform(0.3, 1.3) + rng.normal()
            pair[flickering, doubtful] = pair[doubtful, flickering] = contrast
            average = (ratio * math.exp(-contrast) + 1.0) / (ratio + 1.0)
            powers[:, doubtful] = rng.normal(0.0, 0.3) - math.log10(average), rng.uniform(-half, 0.5)
        barriers = [[barrier(10.0**x / time, kelvin) for x in row] for row in powers]
        interaction = tuple(map(tuple, (KB * kelvin * pair).tolist())) if m > 1 else None
        group = Group(tuple(barriers[0]), tuple(barriers[1]), interaction)
        start = bool(rng.integers(2))
        probabilities, means = group.solution(time, kelvin, start=2**m - 1 if start else 0)
        bonded = float(probabilities[np.arange(2**m) >> doubtful & 1 == 1].sum())
        most = float(means.max(initial=0.0))
        if 0.05 < bonded < 0.95 and most <= 2.0 * flips and means.sum() - most <= events:
            return GroupHold(group, time, kelvin, start, probabilities, means)


def held(
    component: Engine, hold: GroupHold, copies: int, runs: int, *, through: Sequence[float] = (), restart: bool = False
) -> np.ndarray:
    """States of ``copies`` groups at the end of the hold over ``runs`` seeds, (2**m,).

    ``through`` are fractions of the hold time at which the bonds are counted as well, or with ``restart`` at which the
    run ends and is resumed.
    """
    m = len(hold.group.forming)
    counts = np.zeros(2**m, dtype=np.int64)
    lattice = hold.group.lattice(copies)
    times = hold.time * np.array([*through, 1.0])
    for seed in range(runs):
        history: Any = np.ones(lattice.sites.size, dtype=bool) if hold.start else None
        for part in np.split(times, times.size) if restart else [times]:
            history = component.run(lattice, part, temperature=hold.temperature, seed=seed, start=history)
        counts += states(history.state, m)
    return counts


def chance_of(counts: np.ndarray, probabilities: np.ndarray, rng: np.random.Generator) -> float:
    """The p-value of ``counts`` of states with these ``probabilities``; uniform on (0, 1) if they are right.

    A multinomial distribution is a chain of binomial ones, each state among the states not counted yet. Their
    cumulative probabilities, evenly ``rng`` within that of the count itself, are independent and uniform to the last
    bit; their normal scores are summed as by χ². States expected fewer than five times are counted together.
    """
    from scipy.stats import binom, chi2, norm

    total = int(counts.sum())
    order = np.argsort(-probabilities)
    often = order[probabilities[order] * total >= 5.0]
    left, rest, scores = total, 1.0, []
    for state in often[:-1] if often.size == counts.size else often:
        count, p = int(counts[state]), min(float(probabilities[state]) / rest, 1.0)
        below, at = binom.cdf(count - 1, left, p), binom.pmf(count, left, p)
        if at == 0.0 and p in (0.0, 1.0):
            return 0.0
        if at < 1.0:
            scores.append(norm.isf(min(max(below + rng.uniform() * at, 1e-300), 1.0 - 1e-16)))
        left, rest = left - count, max(rest - float(probabilities[state]), 1e-300)
    return float(chi2.sf(np.square(scores).sum(), len(scores))) if scores else float(rng.uniform())
