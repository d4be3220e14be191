"""Barriers that the hold times do not reach: any number of them, in narrow and in broad peaks.

A smooth process continues the density of the visible energies there, and alone would be sure of what nobody measured.
Therefore most of the samples keep it only within the energies that hold times reach. Their sites above, and those
below, lie in up to :data:`MOST` peaks: shares uniform (Dirichlet), positions uniform, widths uniform in the logarithm.
Any share of them, from none to all, may then lie below an energy. Of all densities with the same value at a hold time,
one narrow peak of all sites bonds the most later and the fewest earlier (Jensen's inequality): so many samples are such
peaks that bands of 90 % do not end before it.

What the measurements still tell of the sites outside - the last hold times see the foot of the barriers above -
restricts the peaks, which are drawn by Metropolis moves, one chain for each sample. Most moves shift all peaks such
that the rate with which they react at first, the sum of share × exp(−E/k_BT), stays as it was; the shift that this
takes does not depend on a common translation, so that the volume is preserved. The number of peaks changes by switching
them on and off (product space method, Carlin & Chib, J. R. Stat. Soc. B 57, 473 (1995)).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from chemage.inference.energies import EnergyGrid

#: peaks at most, and the probability of each but the first to be there
MOST, THERE = 4, 0.125
#: eV, standard deviations of peaks
WIDTHS = np.geomspace(0.01, 0.08, 4)
#: share of the samples in which the smooth process goes on
SMOOTH = 0.25
#: eV below and above the energies of the smooth process to which peaks may lie
REACH = 0.2, 0.5
#: Metropolis moves of each chain
MOVES = 2000
#: standard errors by which peaks with all sites change a combination of the measurements at least, or it is left out
NEGLIGIBLE = 0.01


@dataclass(frozen=True, eq=False)
class Data:
    """What the measurements say of S densities: values, errors and model in standard errors."""

    #: (g, m, n) at every point of the grid of scalars
    matrices: np.ndarray
    #: (S,) points, and common factors
    points: np.ndarray
    factors: np.ndarray
    #: (m,) and (g, m)
    values: np.ndarray
    offsets: np.ndarray
    #: eV
    kt: float


@dataclass(frozen=True, eq=False)
class Peaks:
    """The state of S chains with :data:`MOST` peaks each."""

    #: (S, k) positions in the table, from 0
    place: np.ndarray
    #: (S, k) numbers of the widths
    width: np.ndarray
    #: (S, k) weights, standard exponential; shares are their parts of the sum over the peaks that are there
    weight: np.ndarray
    #: (S, k)
    there: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """(S, k), 0 where a peak is not there."""
        present = self.weight * self.there
        return present / present.sum(axis=1, keepdims=True)


class Hidden:
    """Densities on the nodes ``first`` to ``stop`` of ``grid``, without ``stop``."""

    def __init__(self, grid: EnergyGrid, first: int, stop: int) -> None:
        from scipy.special import ndtr

        self.here, self.step, self.areas = slice(first, stop), grid.step, grid.areas[first:stop]
        #: positions of the table are one step apart
        self.count = stop - first + 1
        edges = np.arange(self.count)
        share = np.diff(ndtr((edges - edges[:, None]) * grid.step / WIDTHS[:, None, None]), axis=-1)
        #: (widths, positions, stop - first) 1/eV, each of integral 1
        self.shapes = share / share.sum(axis=-1, keepdims=True) / self.areas

    def drawn(self, count: int, rng: np.random.Generator) -> Peaks:
        """Peaks of the prior, of ``count`` chains."""
        size = (count, MOST)
        there = rng.random(size) < THERE
        there[:, 0] = True
        place = (self.count - 1) * rng.random(size)
        return Peaks(place, rng.integers(WIDTHS.size, size=size), rng.standard_exponential(size), there)

    def _inside(self, place: np.ndarray) -> np.ndarray:
        return (place >= 0) & (place <= self.count - 1)

    def at(self, peaks: Peaks, table: np.ndarray) -> np.ndarray:
        """(S, ...) sums over the peaks of ``table`` (widths, positions, ...), interpolated between positions."""
        left = np.minimum(peaks.place.astype(np.int64), self.count - 2)
        part = peaks.place - left
        shares = peaks.shares
        lower = np.einsum("sk,sk...->s...", shares * (1 - part), table[peaks.width, left])
        return lower + np.einsum("sk,sk...->s...", shares * part, table[peaks.width, left + 1])

    def integral(self, densities: np.ndarray) -> np.ndarray:
        """(S,) shares of the sites that ``densities`` (S, n) have here."""
        return densities[:, self.here] @ self.areas

    def redrawn(
        self, densities: np.ndarray, shares: np.ndarray, rng: np.random.Generator, data: Data | None = None
    ) -> np.ndarray:
        """``densities`` (S, n) with ``shares`` (S,) of the sites here, drawn anew; without ``data`` from the prior."""
        redrawn = densities.copy()
        redrawn[:, self.here] = 0.0
        peaks = self.drawn(len(redrawn), rng)
        if data is not None:
            peaks = self._moved(peaks, redrawn, shares, data, rng)
        redrawn[:, self.here] = shares[:, None] * self.at(peaks, self.shapes)
        return redrawn

    def _moved(self, peaks: Peaks, rest: np.ndarray, shares: np.ndarray, data: Data, rng: np.random.Generator) -> Peaks:
        """``peaks`` after :data:`MOVES` moves in the posterior, with the densities ``rest`` (S, n) elsewhere."""
        tables = np.einsum("gmn,wjn->gwjm", data.matrices[:, :, self.here], self.shapes, optimize=True)
        factor = data.factors[:, None]
        seen = data.offsets[data.points] + np.einsum("smn,sn->sm", data.matrices[data.points], rest, optimize=True)
        base, scale = data.values - factor * seen, factor * shares[:, None]
        # only combinations of the measurements that the peaks change
        axes = np.linalg.svd(tables.reshape(-1, tables.shape[-1]), full_matrices=False)[2]
        axes = axes[np.abs(tables @ axes.T).max(axis=(0, 1, 2)) > NEGLIGIBLE].T
        tables, base = np.ascontiguousarray(tables @ axes), base @ axes

        def misfit(peaks: Peaks) -> np.ndarray:
            at = np.minimum(peaks.place.astype(np.int64), self.count - 2)
            part = (peaks.place - at)[..., None]
            point = data.points[:, None]
            each = (1 - part) * tables[point, peaks.width, at] + part * tables[point, peaks.width, at + 1]
            residual = base - scale * np.einsum("sk,skm->sm", peaks.shares, each)
            return 0.5 * (residual**2).sum(axis=1)

        here = misfit(peaks)
        for number in range(MOVES):
            other, gain = self._proposed(peaks, number % 7, data.kt / self.step, rng)
            inside = (self._inside(other.place) | ~other.there).all(axis=1)
            other = Peaks(np.clip(other.place, 0, self.count - 1), other.width, other.weight, other.there)
            there = misfit(other)
            taken = inside & (np.log(rng.random(shares.size)) < here - there + gain)
            row = taken[:, None]
            peaks = Peaks(
                np.where(row, other.place, peaks.place),
                np.where(row, other.width, peaks.width),
                np.where(row, other.weight, peaks.weight),
                np.where(row, other.there, peaks.there),
            )
            here = np.where(taken, there, here)
        return peaks

    def _proposed(self, peaks: Peaks, kind: int, kt: float, rng: np.random.Generator) -> tuple[Peaks, np.ndarray]:
        """Other peaks, and the logarithm of what their prior and the volume of the move gain; ``kt`` in steps."""
        count = len(peaks.place)
        rows = np.arange(count)
        chosen = rng.integers(1, MOST, count) if kind == 0 else (peaks.there * rng.random((count, MOST))).argmax(axis=1)
        peak = rows, chosen
        place, width, weight, there = (a.copy() for a in (peaks.place, peaks.width, peaks.weight, peaks.there))
        gain = np.zeros(count)
        fresh = self.drawn(count, rng)
        far = kt * 10 ** rng.uniform(-3, 1, count) * rng.standard_normal(count)
        if kind == 0:  # switch a peak on or off; one that is switched on is drawn from the prior
            there[peak] ^= True
            on = there[peak]
            for old, new in ((place, fresh.place), (width, fresh.width), (weight, fresh.weight)):
                old[rows[on], chosen[on]] = new[rows[on], chosen[on]]
            gain = np.where(on, 1, -1) * np.log(THERE / (1 - THERE))
        elif kind == 1:
            place += far[:, None]
        elif kind == 2:
            place[peak] += far
        elif kind in (3, 4):
            place[peak], width[peak] = fresh.place[peak], fresh.width[peak]
        elif kind == 5:
            more = 10 ** rng.uniform(-2, 0.5, count) * rng.standard_normal(count)
            weight[peak] *= np.exp(more)
            gain = more + peaks.weight[peak] - weight[peak]
        else:
            place, width, weight, there = fresh.place, fresh.width, fresh.weight, fresh.there
        other = Peaks(place, width, weight, there)
        if kind in (0, 3, 5, 6):
            away = (self._location(other, kt) - self._location(peaks, kt))[:, None]
            other = Peaks(place - away, width, weight, there)
            # the move back must be possible: it draws the peaks that this one replaces or switches off, shifted as well
            gone = peaks.there & (~there | (place != peaks.place))
            gain = np.where((self._inside(peaks.place - away) | ~gone).all(axis=1), gain, -np.inf)
        return other, gain

    def _location(self, peaks: Peaks, kt: float) -> np.ndarray:
        """(S,) -kt times the logarithm of the rate with which all peaks react at first, in steps."""
        log_rates = -peaks.place / kt + 0.5 * (WIDTHS[peaks.width] / (kt * self.step)) ** 2
        log_rates = np.where(peaks.there, log_rates, -np.inf)
        top = log_rates.max(axis=1)
        return -kt * (top + np.log((peaks.shares * np.exp(log_rates - top[:, None])).sum(axis=1)))


def redrawn_outside(
    grid: EnergyGrid, seen: np.ndarray, densities: np.ndarray, rng: np.random.Generator, data: Data | None = None
) -> np.ndarray:
    """``densities`` (S, n), most of which get the sites below and above all energies ``seen`` (n,) in peaks.

    Those below keep their share; all that are missing to 1 lie above. Without ``data``, peaks are those of the prior.
    """
    inside = np.flatnonzero(seen) if seen.any() else np.zeros(1, dtype=np.int64)
    chosen = np.flatnonzero(rng.random(len(densities)) >= SMOOTH)
    redrawn, some = densities.copy(), densities[chosen]
    if data is not None:
        data = replace(data, points=data.points[chosen], factors=data.factors[chosen])
    if inside[0]:
        below = Hidden(grid, 0, int(inside[0]))
        some = below.redrawn(some, below.integral(some), rng, data)
    above = Hidden(grid, int(inside[-1]) + 1, grid.count)
    left = np.maximum(1 - some @ grid.areas + above.integral(some), 0.0)
    redrawn[chosen] = above.redrawn(some, left, rng, data)
    return redrawn
