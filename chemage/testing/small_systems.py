"""Groups of a few sites whose master equation is solved exactly, and the comparison of an engine with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from chemage.foundation.units import KB
from chemage.lattices.lattice import ReactionLattice
from chemage.testing.checks import CHANCE, binomial_chance, require

TEMPERATURE = 300.0
NU = 1e13
#: groups on one lattice: small, because the simplest engines need a time that grows as the square of the sites
COPIES = 12
LARGE = 150


def barrier(rate: Any, temperature: float = TEMPERATURE, nu: float = NU) -> Any:
    """The barriers (eV) over which sites react at ``rate`` (1/s)."""
    return KB * temperature * np.log(nu / np.asarray(rate))


def evolved(
    generator: np.ndarray, time: float, events: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The master equation solved for rates over any number of decades: (n, n), the probability of state i after
    ``time`` (s) from state j, where ``generator`` is the rate (1/s) from j to i, whose columns sum to 0; and (n, k),
    the mean number of events of k kinds from each state, where ``events`` (n, k), 1/s, is their rate in each.

    Scaling and squaring, in which nothing is ever subtracted: the series of uniformization for a time in which hardly
    anything happens (Jensen 1953), then squares of a matrix of probabilities whose columns are normalised each time. A
    diagonal near 1 follows from the small entries beside it, so each rate keeps its relative accuracy beside others 60
    decades faster (compare Xue and Ye, Math. Comp. 82, 1577 (2013)); the usual exponential loses it.
    """
    fastest = float(-generator.diagonal().min(initial=0.0))
    identity = np.eye(generator.shape[0])
    rates = np.empty((len(identity), 0)) if events is None else events
    if fastest * time == 0.0:
        return identity, rates * time
    doublings = max(math.ceil(math.log2(fastest) + math.log2(time)), 0)
    span = math.ldexp(time, -doublings)
    steps = fastest * span
    jumps = np.where(
        identity == 1.0,
        np.maximum(1.0 + generator / fastest, 0.0),
        generator / fastest,
    )
    power = chances = so_far = (
        identity  # the k-th power of the jumps, and the sum of those before
    )
    waits, weight = np.zeros_like(identity), 1.0
    for k in range(1, 22):
        weight *= steps / k
        waits = waits + weight * so_far
        power = jumps @ power
        chances = chances + weight * power
        so_far = so_far + power
    chances = chances / chances.sum(axis=0)
    means = span * ((waits / waits.sum(axis=0)).T @ rates)
    for _ in range(doublings):
        means = means + chances.T @ means
        chances = chances @ chances
        chances /= chances.sum(axis=0)
    return chances, means


@dataclass(frozen=True)
class Group:
    """A few sites, coupled with each other and with nothing else. Energies in eV."""

    forming: tuple[float, ...]
    breaking: tuple[float, ...] | None = None
    #: [i][j]: what a bond of j adds to the forming barrier of i
    pair: tuple[tuple[float, ...], ...] | None = None

    def generator(
        self, temperature: float = TEMPERATURE, nu: float = NU
    ) -> np.ndarray:
        """Rates (1/s) from every state to every other, (2**m, 2**m), columns sum to 0; bit i of a state is set where
        site i is bonded."""
        m = len(self.forming)
        pair = (
            None
            if self.pair is None
            else np.array(self.pair, np.float32).astype(float)
        )
        generator = np.zeros((2**m, 2**m))
        for state in range(2**m):
            bonded = [j for j in range(m) if state >> j & 1]
            for i in range(m):
                if i in bonded:
                    energy = math.inf if self.breaking is None else self.breaking[i]
                else:
                    energy = self.forming[i] + (
                        0.0 if pair is None else float(pair[i, bonded].sum())
                    )
                rate = nu * math.exp(-max(energy, 0.0) / (KB * temperature))
                generator[state ^ 1 << i, state] += rate
                generator[state, state] -= rate
        return generator

    def at(self, temperature: float, nu: float) -> Group:
        """The group that has the same rates and couplings in k_B T there as this one at 300 K and 1e13 Hz."""
        warm = temperature / TEMPERATURE
        shift = KB * temperature * math.log(nu / NU)
        forming, breaking = (
            None
            if given is None
            else tuple(warm * energy + shift for energy in given)
            for given in (self.forming, self.breaking)
        )
        pair = self.pair and tuple(
            tuple(warm * energy for energy in row) for row in self.pair
        )
        return Group(forming or (), breaking, pair)

    def probabilities(
        self,
        time: float,
        temperature: float = TEMPERATURE,
        nu: float = NU,
        start: int = 0,
    ) -> np.ndarray:
        """Probability of every state after ``time`` s, (2**m,)."""
        return evolved(self.generator(temperature, nu), time)[0][:, start]

    @lru_cache(maxsize=256)  # noqa: B019
    def lattice(
        self, copies: int = COPIES, nu: float = NU, slots: int = 0, seed: int = 1
    ) -> ReactionLattice:
        """``copies`` of the group next to each other, none coupled to another.

        The sites are every third pixel, so that a site's position in the list is not its pixel. With ``slots`` more
        slots per site than it has neighbours, the empty ones are anywhere in its row.
        """
        m = len(self.forming)
        n = m * copies
        fields: dict[str, Any] = {}
        if self.breaking is not None:
            fields["breaking"] = np.tile(self.breaking, copies)
        if self.pair is not None:
            neighbours = np.full((n, m - 1 + slots), -1, dtype=np.int32)
            coupling = np.zeros(
                neighbours.shape, np.float32
            )  # as interactions give them
            rng = np.random.default_rng(seed)
            for site in range(n):
                first, i = site - site % m, site % m
                others = [j for j in range(m) if j != i and self.pair[i][j] != 0.0]
                places = (
                    np.arange(m - 1)
                    if not slots
                    else rng.permutation(neighbours.shape[1])
                )
                for place, j in zip(places, others, strict=False):
                    neighbours[site, place] = first + j
                    coupling[site, place] = self.pair[i][j]
            fields |= {"neighbours": neighbours, "coupling": coupling}
        return ReactionLattice(
            pixels=(max(n, 1), 3),
            sites=3 * np.arange(n) + 1,
            forming=np.tile(self.forming, copies),
            attempt_frequency=nu,
            **fields,
        )


def reacting(
    forming: Sequence[float],
    breaking: Sequence[float] | None = None,
    pair: Any = None,
) -> Group:
    """Sites with these rates (1/s) at 300 K."""
    over = None if breaking is None else tuple(barrier(breaking).tolist())
    return Group(tuple(barrier(forming).tolist()), over, pair)


def single(forming: float, breaking: float | None = None) -> Group:
    """One site with these rates (1/s) at 300 K."""
    return reacting([forming], None if breaking is None else [breaking])


def coupled() -> Group:
    """Four sites, each coupled to the other three, with rates of about one per second."""
    pair = (
        (0.0, 0.05, -0.03, 0.02),
        (0.05, 0.0, 0.07, -0.02),
        (-0.03, 0.07, 0.0, 0.04),
        (0.02, -0.02, 0.04, 0.0),
    )
    return reacting((3.0, 1.0, 0.6, 2.0), (0.5, 1.5, 0.2, 0.9), pair)


def agree(where: str, counts: np.ndarray, probabilities: np.ndarray) -> None:
    """Require that ``counts`` of groups in each state agree with the ``probabilities`` of the master equation: every
    site, every pair of sites and every state, each by its binomial distribution."""
    total, every = int(counts.sum()), np.arange(counts.size)
    m = counts.size.bit_length() - 1
    bonded = every[:, None] >> np.arange(m) & 1 == 1
    questions = {}
    for chosen in (*combinations(range(m), 1), *combinations(range(m), 2)):
        questions[f"each of the sites {chosen} is bonded"] = bonded[:, chosen].all(
            axis=1
        )
    for state in every if m > 2 else ():
        questions[f"just the sites {np.flatnonzero(bonded[state])} are bonded"] = (
            every == state
        )
    for what, yes in questions.items():
        count, p = int(counts[yes].sum()), min(float(probabilities[yes].sum()), 1.0)
        require(
            binomial_chance(count, total, p) > CHANCE,
            f"{where}, {what} in {count} of {total} cases; the master equation gives {total * p:.4g} "
            f"± {math.sqrt(total * p * (1 - p)):.2g}",
        )


def states(history_state: np.ndarray, m: int) -> np.ndarray:
    """How many groups are in each state, (2**m,)."""
    return np.bincount(
        history_state.reshape(-1, m) @ (1 << np.arange(m)), minlength=2**m
    )


#: grids of coupled sites with rates over 60 decades, one of which is bonded in 5 to 95 % of all cases at the end and
#: depends on another that flickers: (group, hold time in s, K)
FLICKERING: dict[str, tuple[Group, float, float]] = {
    "1 by 1 sites": (Group((3.5173,), (3.5173,)), 1.5157e6, 995.07),
    "1 by 2 sites": (
        Group(
            (0.470982, 0.035126),
            (1.122745, 0.750901),
            ((0.0, 0.310722), (0.310722, 0.0)),
        ),
        6.094e17,
        127.368,
    ),
    "1 by 2 hot sites": (
        Group(
            (2.61932, 1.84424), (9.74901, 4.39493), ((0.0, 1.94665), (1.94665, 0.0))
        ),
        2.69362e11,
        934.28,
    ),
    "1 by 2 weakly coupled sites": (
        Group(
            (1.094946, 1.15692),
            (1.094946, 2.700944),
            ((0.0, -0.012724), (-0.012724, 0.0)),
        ),
        5.6,
        416.637,
    ),
    "2 by 2 sites": (
        Group(
            (0.227071, 0.209807, 0.249215, 0.627239),
            (0.760801, 0.370714, 0.456586, 0.579448),
            (
                (0.0, 0.168768, 0.000848, -0.002678),
                (0.168768, 0.0, 0.00174, -0.006599),
                (0.000848, 0.00174, 0.0, -0.00372),
                (-0.002678, -0.006599, -0.00372, 0.0),
            ),
        ),
        3.902166e9,
        85.925,
    ),
}
