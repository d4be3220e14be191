"""The probability that a site of one barrier is bonded, and what a piecewise linear density makes of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from chemage.foundation.units import KB
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.independent import TwoState

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
        hats = np.clip(1 - np.abs(place[:, None] - np.arange(self.count)), 0, None) * self.fine_step
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
        return EnergyGrid(self.first - more * self.step, self.step, self.count + more + math.ceil(above / self.step))

    def place(self, other: EnergyGrid) -> tuple[int, int]:
        """Nodes below the first and above the last of ``other``, whose nodes are among these."""
        below = round((other.first - self.first) / self.step)
        return below, self.count - below - other.count

    def quantile(self, density: np.ndarray, uniform: np.ndarray, beyond: float) -> np.ndarray:
        """Barriers at ``uniform`` numbers; those above the integral of ``density`` get the barrier ``beyond``."""
        weights = np.maximum(self.hats @ np.maximum(density, 0), 0)
        total = np.cumsum(weights)
        # a little of everything, so that the sum ascends
        total = total + np.arange(total.size) * 1e-15
        share = max(1.0, float(total[-1]))
        inside = np.interp(uniform * share, total, self.fine + self.fine_step / 2)
        return np.where(uniform * share > total[-1], beyond, inside)


def energy_grid(chemistry: Chemistry, temperatures: np.ndarray, times: np.ndarray, lowering: float) -> EnergyGrid:
    """Nodes for hold times (s) at temperatures (K), where pressure lowers barriers by up to ``lowering`` eV."""
    kt = KB * temperatures
    low = float(np.min(kt * np.log(chemistry.attempt_frequency * times)))
    high = float(np.max(kt * np.log(chemistry.attempt_frequency * times))) + lowering
    low, high = low - BELOW, high + ABOVE + 2 * float(kt.max())
    low = max(low, -0.5)
    step = max(float(kt.min()) / NODES_PER_KT, (high - low) / MOST_NODES)
    return EnergyGrid(low, step, math.ceil((high - low) / step) + 1)


def averaging(nodes: np.ndarray, resolution: float) -> np.ndarray:
    """(n, n): means over the resolution (eV) about each node; the standard deviation of the weights is half of it."""
    weights = np.exp(-0.5 * ((nodes[:, None] - nodes) / (0.5 * resolution)) ** 2)
    return weights / weights.sum(axis=1, keepdims=True)


def bonded_probability(chemistry: Chemistry, temperature: float, times: np.ndarray, energies: np.ndarray) -> np.ndarray:
    """Probability that a site over the forming barrier is bonded, (times, energies), averaged over breaking barriers.

    a/(a + b) (1 − exp(−(a + b) t)) with the rates a of forming and b of breaking; a barrier at or below zero has the
    rate ν.
    """
    times = np.asarray(times, dtype=np.float64)
    forming = chemistry.rates(energies, temperature)
    if chemistry.breaking is None:
        return TwoState(forming).relaxed(times[:, None])
    ranks = (np.arange(RANKS) + 0.5) / RANKS
    barriers = chemistry.breaking.quantile(ranks)
    breaking, counts = np.unique(chemistry.rates(barriers, temperature), return_counts=True)
    bonded = np.zeros((times.size, forming.size))
    for rate, count in zip(breaking, counts, strict=True):
        sites = TwoState(forming, rate)
        bonded += count / RANKS * sites.equilibrium * sites.relaxed(times[:, None])
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
        return np.lib.stride_tricks.sliding_window_view(self.table, self.grid.fine.size, axis=1)

    def places(self, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each shift (eV), the tabulated one below it and the part of the way to the next."""
        place = np.clip((shift - self.lowest) / self.grid.fine_step, 0.0, self.shifts - 1.001)
        left = place.astype(np.int64)
        return left, place - left

    def of_density(self, density: np.ndarray) -> np.ndarray:
        """(l, shifts): share of the sites of ``density`` (n,) that are bonded if all barriers are shifted."""
        return self.windows @ (self.grid.hats @ density)

    def matrix(self, weights: np.ndarray) -> np.ndarray:
        """(l, n): derivative of the bonded share by the density, where shift s at time l has the weight [l, s]."""
        mixed = np.einsum("ls,lsj->lj", weights, self.windows, optimize=True)
        return mixed @ self.grid.hats


def make_kernel(
    chemistry: Chemistry, temperature: float, times: np.ndarray, grid: EnergyGrid, lowest: float, highest: float
) -> Kernel:
    """A kernel for shifts of the barriers from ``lowest`` to ``highest``, eV."""
    step = grid.fine_step
    first = math.floor(lowest / step) - 1
    count = math.ceil(highest / step) - first + 3
    energies = grid.first + step * (first + np.arange(grid.fine.size + count - 1))
    return Kernel(grid, times, first * step, bonded_probability(chemistry, temperature, times, energies))
