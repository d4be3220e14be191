"""Random groups of sites beside one that flickers, and how well an engine's states agree with their master equation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from chemage.plugin import KB
from chemage.testing.small_systems import Group, barrier, evolved, states


def solution(group: Group, time: float, temperature: float, start: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Probability of every state after ``time`` s, (2**m,), and the mean number of events of each site, (m,)."""
    generator = group.generator(temperature)
    states, site = np.arange(generator.shape[0]), np.arange(len(group.forming))
    chances, events = evolved(generator, time, generator[states[:, None] ^ 1 << site, states[:, None]])
    return chances[:, start], events[start]


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
        barriers = [[float(barrier(10.0**x / time, kelvin)) for x in row] for row in powers]
        interaction = tuple(map(tuple, (KB * kelvin * pair).tolist())) if m > 1 else None
        group = Group(tuple(barriers[0]), tuple(barriers[1]), interaction)
        start = bool(rng.integers(2))
        probabilities, means = solution(group, time, kelvin, start=2**m - 1 if start else 0)
        bonded = float(probabilities[np.arange(2**m) >> doubtful & 1 == 1].sum())
        most = float(means.max(initial=0.0))
        if 0.05 < bonded < 0.95 and most <= 2.0 * flips and means.sum() - most <= events:
            return GroupHold(group, time, kelvin, start, probabilities, means)


def held(
    component: Any, hold: GroupHold, copies: int, runs: int, *, through: Sequence[float] = (), restart: bool = False
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
