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


@dataclass(frozen=True)
class Group:
    """A few sites, coupled with each other and with nothing else. Energies in eV."""

    forming: tuple[float, ...]
    breaking: tuple[float, ...] | None = None
    #: [i][j]: what a bond of j adds to the forming barrier of i
    pair: tuple[tuple[float, ...], ...] | None = None

    def probabilities(
        self, time: float, temperature: float = TEMPERATURE, nu: float = NU, start: int = 0
    ) -> np.ndarray:
        """Probability of every state after ``time`` s, (2**m,); bit i of a state is set where site i is bonded."""
        from scipy.linalg import expm

        m = len(self.forming)
        generator = np.zeros((2**m, 2**m))
        for state in range(2**m):
            bonded = [j for j in range(m) if state >> j & 1]
            for i in range(m):
                if i in bonded:
                    energy = math.inf if self.breaking is None else self.breaking[i]
                else:
                    energy = self.forming[i] + (sum(self.pair[i][j] for j in bonded) if self.pair else 0.0)
                rate = nu * math.exp(-max(energy, 0.0) / (KB * temperature))
                generator[state ^ 1 << i, state] += rate
                generator[state, state] -= rate
        return expm(generator * time)[:, start]

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
        coupling = np.zeros(neighbours.shape)
        rng = np.random.default_rng(seed)
        for site in range(n):
            first, i = site - site % m, site % m
            others = [j for j in range(m) if j != i]
            places = np.arange(m - 1) if not slots else rng.permutation(neighbours.shape[1])[: m - 1]
            for place, j in zip(places, others, strict=True):
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
class Sample:
    """How many lattices of how many groups are run."""

    copies: int
    runs: int

    @classmethod
    def of(cls, component: Engine, runs: int = 200) -> Sample:
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
    sample = Sample.of(component, runs)
    m = len(group.forming)
    found = np.zeros(2**m, dtype=np.int64)
    for seed in range(sample.runs):
        lattice = group.lattice(sample.copies, nu=nu, slots=slots, seed=seed % 5)
        begin = np.ones(lattice.sites.size, dtype=bool) if start else None
        history = component.run(lattice, [0.5 * time, time], temperature=temperature, seed=seed, start=begin)
        found += states(history.state, m)
    return found


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
