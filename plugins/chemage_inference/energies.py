"""The probability that a site of one barrier is bonded, and what a piecewise linear density makes of it.

Bonded neighbours in the forward model: a mean field over the real sites of a contact, with its derivative.

A site sees the bonds of its neighbours as a barrier that changes in time, E + h(t). Whether it has bonded by the hold
time t depends on τ(t) = ∫ exp(−h/k_BT) dt' alone, so that neighbours shift its barrier by k_BT ln(t/τ). Each neighbour
is bonded from the time T on at which the bonded share of the sites under this pressure reaches the neighbour's own
uniform number; the shares follow from the shifts, and the shifts from the shares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from chemage import Chemistry
from chemage.plugin import KB, TwoState, algebra

#: nodes of the density per k_BT of the lowest temperature, and energies of the quadrature per node
NODES_PER_KT, FINE = 1.5, 4
#: eV by which the energies reach beyond those that react between the first and the last hold time
BELOW, ABOVE = 0.2, 0.15
#: most nodes of a density
MOST_NODES = 160
#: ranks over which the breaking barriers are averaged
RANKS = 128


@dataclass(frozen=True, eq=False)
class EnergyGrid:
    """The nodes of a piecewise linear density, and the finer energies on which it is integrated."""

    #: eV, first node and distance of the nodes
    first: float
    step: float
    count: int

    @cached_property
    def nodes(self) -> np.ndarray:
        """(n,) eV."""
        return self.first + self.step * np.arange(self.count)

    @property
    def fine_step(self) -> float:
        """eV."""
        return self.step / FINE

    @cached_property
    def fine(self) -> np.ndarray:
        """(N,) eV, :data:`FINE` intervals per interval of the nodes."""
        return self.first + self.fine_step * np.arange((self.count - 1) * FINE + 1)

    @cached_property
    def hats(self) -> np.ndarray:
        """(N, n): share of each fine energy in the integral of each hat function, eV; columns add up to its area."""
        place = np.arange(self.fine.size) / FINE
        hats = (
            np.clip(1 - np.abs(place[:, None] - np.arange(self.count)), 0, None)
            * self.fine_step
        )
        hats[0] /= 2
        hats[-1] /= 2
        return hats

    @cached_property
    def areas(self) -> np.ndarray:
        """(n,) eV: the integral of a density is its values times these."""
        return self.hats.sum(axis=0)

    def wider(self, below: float, above: float) -> EnergyGrid:
        """The grid with further nodes, up to ``below`` and ``above`` eV beyond its ends."""
        more = int(below / self.step)
        return EnergyGrid(
            self.first - more * self.step,
            self.step,
            self.count + more + math.ceil(above / self.step),
        )

    def place(self, other: EnergyGrid) -> tuple[int, int]:
        """Nodes below the first and above the last of ``other``, whose nodes are among these."""
        below = round((other.first - self.first) / self.step)
        return below, self.count - below - other.count

    def quantile(
        self, density: np.ndarray, uniform: np.ndarray, beyond: float
    ) -> np.ndarray:
        """Barriers at ``uniform`` numbers; those above the integral of ``density`` get the barrier ``beyond``."""
        weights = np.maximum(algebra.product(self.hats, np.maximum(density, 0)), 0)
        total = np.cumsum(weights)
        # a little of everything, so that the sum ascends
        total = total + np.arange(total.size) * 1e-15
        share = max(1.0, float(total[-1]))
        inside = np.interp(uniform * share, total, self.fine + self.fine_step / 2)
        return np.where(uniform * share > total[-1], beyond, inside)


def energy_grid(
    chemistry: Chemistry,
    temperatures: np.ndarray,
    times: np.ndarray,
    lowering: float,
) -> EnergyGrid:
    """Nodes for hold times (s) at temperatures (K), where pressure lowers barriers by up to ``lowering`` eV."""
    kt = KB * temperatures
    reacting = kt * np.log(chemistry.attempt_frequency * times)
    low = max(float(reacting.min()) - BELOW, -0.5)
    high = float(reacting.max()) + lowering + ABOVE + 2 * float(kt.max())
    step = max(float(kt.min()) / NODES_PER_KT, (high - low) / MOST_NODES)
    return EnergyGrid(low, step, math.ceil((high - low) / step) + 1)


def averaging(nodes: np.ndarray, resolution: float) -> np.ndarray:
    """(n, n): means over the resolution (eV) about each node; the standard deviation of the weights is half of it."""
    weights = np.exp(-0.5 * ((nodes[:, None] - nodes) / (0.5 * resolution)) ** 2)
    return weights / weights.sum(axis=1, keepdims=True)


def bonded_probability(
    chemistry: Chemistry,
    temperature: float,
    times: np.ndarray,
    energies: np.ndarray,
    before: tuple[float, float] | None = None,
) -> np.ndarray:
    """Probability that a site over the forming barrier is bonded, (times, energies), averaged over breaking barriers.

    a/(a + b) (1 − exp(−(a + b) t)) with the rates a of forming and b of breaking; a barrier at or below zero has the
    rate ν. ``before``: temperature (K) and duration (s) of a rest, from the bonds of which it goes on.
    """
    barriers = np.array([np.inf])
    if chemistry.breaking is not None:
        barriers = chemistry.breaking.quantile((np.arange(RANKS) + 0.5) / RANKS)
    barriers = np.maximum(barriers, 0.0)
    different, counts = np.unique(barriers, return_counts=True)
    passed = np.asarray(times, dtype=np.float64)[:, None]
    forming = chemistry.rates(energies, temperature)
    bonded = np.zeros((passed.size, forming.size))
    shares = counts / barriers.size
    for barrier, share in zip(different[::-1], shares[::-1], strict=True):
        sites = TwoState(forming, chemistry.rates(barrier, temperature))
        relaxed = sites.relaxed(passed)
        bonded += share * sites.equilibrium * relaxed
        if before is not None:
            kelvin, span = before
            rates = (chemistry.rates(one, kelvin) for one in (energies, barrier))
            bonded += share * TwoState(*rates).bonded(span) * (1 - relaxed)
    return bonded


@dataclass(frozen=True, eq=False)
class Kernel:
    """:func:`bonded_probability` of one chemistry at one temperature, tabulated over energies and shifts of them."""

    grid: EnergyGrid
    #: (l,) s
    times: np.ndarray
    #: eV, lowest shift; the shifts are fine steps apart
    lowest: float
    #: (l, N + shifts − 1) probability at the fine energies plus the shifts
    table: np.ndarray

    @property
    def shifts(self) -> int:
        """How many shifts."""
        return self.table.shape[1] - self.grid.fine.size + 1

    @cached_property
    def windows(self) -> np.ndarray:
        """(l, shifts, N) view of the table: probabilities at the fine energies for each shift."""
        return np.lib.stride_tricks.sliding_window_view(
            self.table, self.grid.fine.size, axis=1
        )

    def places(self, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each shift (eV), the tabulated one below it and the part of the way to the next."""
        place = np.clip(
            (shift - self.lowest) / self.grid.fine_step, 0.0, self.shifts - 1.001
        )
        left = place.astype(np.int64)
        return left, place - left

    def spread(
        self, shift: np.ndarray, weight: float | np.ndarray = 1.0
    ) -> np.ndarray:
        """(r, shifts): the weights of the tabulated shifts, for rows of shifts (r, s) that weigh ``weight``."""
        left, part = self.places(shift)
        rows = self.shifts * np.arange(len(shift))[:, None]
        size = len(shift) * self.shifts
        below, above = weight * (1 - part), weight * part
        weights = np.bincount((rows + left).ravel(), below.ravel(), size)
        weights += np.bincount((rows + left + 1).ravel(), above.ravel(), size)
        return weights.reshape(len(shift), self.shifts)

    def matrix(self, weights: np.ndarray) -> np.ndarray:
        """(l, n): derivative of the bonded share by the density, where shift s at time l has the weight [l, s]."""
        mixed = np.einsum("ls,lsj->lj", weights, self.windows)
        return algebra.product(mixed, self.grid.hats)


def make_kernel(
    chemistry: Chemistry,
    temperature: float,
    times: np.ndarray,
    grid: EnergyGrid,
    lowest: float,
    highest: float,
    before: tuple[float, float] | None = None,
) -> Kernel:
    """A kernel for shifts of the barriers from ``lowest`` to ``highest``, eV."""
    step = grid.fine_step
    first = math.floor(lowest / step) - 1
    count = math.ceil(highest / step) - first + 3
    energies = grid.first + step * (first + np.arange(grid.fine.size + count - 1))
    return Kernel(
        grid,
        times,
        first * step,
        bonded_probability(chemistry, temperature, times, energies, before),
    )


#: groups of sites under similar pressures
GROUPS = 8
#: the share no longer changes by more than this
CONVERGED = 1e-5
MOST_SWEEPS = 60


@dataclass(frozen=True, eq=False)
class Environments:
    """Sites of a contact: how pressure and neighbours change their barriers."""

    #: (M,) eV by which pressure changes the barrier (negative)
    lowering: np.ndarray
    #: (M, k) eV that each bonded neighbour adds, 0 where there is none
    coupling: np.ndarray
    #: (M, k) uniform numbers of the neighbours; above 1 where there is none
    uniform: np.ndarray
    #: (M,) number of the group, 0 … groups − 1, ascending
    group: np.ndarray
    groups: int

    @cached_property
    def shares(self) -> np.ndarray:
        """(groups,) share of the sites."""
        return np.bincount(self.group, minlength=self.groups) / self.group.size


class Solved(NamedTuple):
    """The mean field of one density."""

    #: (groups, l) bonded shares
    shares: np.ndarray
    #: (groups, l, n) their derivatives by the density, the neighbours' part included
    derivative: np.ndarray
    #: (groups, l, shifts) weights of the shifts
    weights: np.ndarray


class MeanField:
    """The bonded shares of environments at the times of a kernel."""

    def __init__(
        self, kernel: Kernel, environments: Environments, temperature: float
    ) -> None:
        self.kernel, self.environments = kernel, environments
        self.kt = KB * temperature
        self.times, self._rows = kernel.times, np.arange(kernel.times.size)[:, None]

    def solve(self, density: np.ndarray, start: np.ndarray | None = None) -> Solved:
        """The shares of ``density`` (n,), and their derivative; ``start`` (groups, l) are shares to begin from."""
        hats = algebra.product(self.kernel.grid.hats, density)
        # shares of the sites that are bonded if all barriers are shifted
        table = np.einsum("lsj,j->ls", self.kernel.windows, hats)
        shares = np.zeros((self.environments.groups, self.times.size))
        if start is not None:
            shares = start
        env = self.environments
        edges = np.searchsorted(env.group, np.arange(env.groups))
        sizes = env.shares * env.group.size
        for _ in range(MOST_SWEEPS):
            *_, shifts = self._shifted(shares)
            left, part = self.kernel.places(shifts)
            below, above = table[self._rows, left], table[self._rows, left + 1]
            values = below * (1 - part) + above * part
            sums = np.add.reduceat(values, edges, axis=1)
            before, shares = shares, (sums / sizes).T
            if float(np.abs(shares - before).max()) < CONVERGED:
                break
        return self._with_derivative(shares, table)

    def _events(self, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """When each neighbour bonds, in order, (M, k) s (inf: never), and exp(−h/k_BT) before and after, (M, k + 1)."""
        env = self.environments
        at = np.empty_like(env.uniform)
        for number in range(env.groups):
            here = env.group == number
            risen = np.maximum.accumulate(shares[number])
            uniform = env.uniform[here]
            times = np.exp(np.interp(uniform, risen, np.log(self.times)))
            early = uniform < risen[0]
            times[early] = self.times[0] * uniform[early] / max(risen[0], 1e-300)
            times[uniform >= risen[-1]] = np.inf
            at[here] = times
        order = np.argsort(at, axis=1, kind="stable")
        rows = np.arange(len(at))[:, None]
        height = np.cumsum(env.coupling[rows, order], axis=1)
        factors = np.exp(np.clip(-height / self.kt, -700.0, 700.0))
        return at[rows, order], np.concatenate(
            [np.ones((len(at), 1)), factors], axis=1
        )

    def _shifted(self, shares: np.ndarray) -> tuple[np.ndarray, ...]:
        """:meth:`_events`; τ, (l, M) s, the time during which a site without neighbours would have had the same chance
        to bond; and the shifts that follow from it, (l, M) eV."""
        at, factors = self._events(shares)
        steps = np.diff(factors, axis=1)
        tau = np.repeat(self.times[:, None], len(at), axis=1)
        for slot in range(at.shape[1]):
            tau += steps[:, slot] * np.maximum(
                self.times[:, None] - at[:, slot], 0.0
            )
        # what cancels is rounded to a part of the hold time
        tau = np.maximum(tau, 1e-15 * self.times[:, None])
        return (
            at,
            factors,
            tau,
            self.environments.lowering
            + self.kt * np.log(self.times[:, None] / tau),
        )

    def _with_derivative(self, shares: np.ndarray, table: np.ndarray) -> Solved:
        env, kernel = self.environments, self.kernel
        at, factors, tau, shifts = self._shifted(shares)
        left, _ = kernel.places(shifts)
        slope = (
            table[self._rows, left + 1] - table[self._rows, left]
        ) / kernel.grid.fine_step
        # change of the bonded probability of each site by a change of its τ
        by_tau = -slope * self.kt / tau
        derivative, weights = [], []
        for number in range(env.groups):
            here = np.flatnonzero(env.group == number)
            weight = kernel.spread(shifts[:, here]) / here.size
            direct = kernel.matrix(weight)
            back = self._back(
                shares[number], at[here], factors[here], by_tau[:, here]
            )
            derivative.append(algebra.solve(np.eye(self.times.size) - back, direct))
            weights.append(weight)
        return Solved(shares, np.stack(derivative), np.stack(weights))

    def _back(
        self,
        share: np.ndarray,
        at: np.ndarray,
        factors: np.ndarray,
        by_tau: np.ndarray,
    ) -> np.ndarray:
        """(l, l'): by how much the share at time l changes with the share at time l', through the neighbours.

        A share that rises by δ lets neighbours bond earlier, by δ over the rate at which it rises.
        """
        risen = np.maximum.accumulate(share)
        numbers, logs = np.arange(share.size), np.log(self.times)
        slopes = np.diff(risen) / np.diff(logs)
        back = np.zeros((share.size, share.size))
        for bonded, step in zip(at.T, np.diff(factors, axis=1).T, strict=True):
            inside = np.isfinite(bonded) & (bonded > self.times[0])
            if not inside.any():
                continue
            moment = bonded[inside]
            place = np.interp(np.log(moment), logs, numbers)
            rate = (
                slopes[np.minimum(place.astype(np.int64), share.size - 2)] / moment
            )
            # dτ/dT = −(factor after − factor before), dT/dshare = −1/rate
            gain = np.divide(
                step[inside], rate, out=np.zeros_like(rate), where=rate > 0
            )
            effect = by_tau[:, inside] * gain * (self.times[:, None] > moment)
            near = np.clip(1 - np.abs(place[:, None] - numbers), 0.0, 1.0)
            back += algebra.product(effect, near)
        return back / len(at)
