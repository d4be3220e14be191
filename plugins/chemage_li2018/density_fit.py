"""Shapes of the density of barriers, what the paper says of it with a model of the errors, and what this leaves open.

The published β are one realisation of each surface, printed with two digits, and fitted over hold times that the paper
does not state. With ``b`` the mean over surfaces of a density under one of :data:`READINGS`,
ln β(published) = ln b + surface + rounding + method:

- *surface*: the covariance between our surfaces: a common factor is cheap, a ratio is not;
- *rounding*: uniform, ±0.005 in β, through its variance;
- *method*: what else the paper does not state, such as the noise of its replicas; one of :data:`METHODS` for each rate.

Reading and method are nuisance parameters. The parameters of a family are uniform in their box, and all families have
equal prior weights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import RBFInterpolator
from scipy.stats import qmc

import chemage
from chemage_li2018 import shapes
from chemage_li2018.density_rates import CONDITIONS, TIMES
from chemage_li2018.published import BETA, PREFERRED, Reading

#: range of the barriers, and width of a step in a density: nodes of a table must increase; eV
LOWER, UPPER, STEP = 0.8, 1.4, 1e-3

Nodes = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class DensityFamily:
    """A family of densities that are piecewise linear (the beta distribution: on a fine grid)."""

    name: str
    #: parameter, with its unit -> its range
    ranges: dict[str, tuple[float, float]]
    #: parameters -> energies (eV) and weights
    nodes: Callable[..., Nodes]

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper ends of the ranges, (2, k)."""
        return np.array(list(self.ranges.values())).T

    def barriers(
        self, parameters: Sequence[float] | np.ndarray
    ) -> chemage.plugin.Barriers:
        """Make the barriers of the density with these parameters."""
        nodes = self.nodes(*(float(value) for value in parameters))
        energies, weights = (list(values) for values in nodes)
        return chemage.barriers("tabulated", energies=energies, weights=weights)

    def design(self, count: int, seed: int = 5) -> np.ndarray:
        """Spread parameters evenly over the box (Sobol'), (count, k)."""
        low, high = self.bounds
        # scipy before 1.15 has no argument rng
        sequence = qmc.Sobol(len(low), seed=seed)  # pyright: ignore[reportCallIssue]
        unit = sequence.random(1 << (count - 1).bit_length())[:count]
        return (low + unit * (high - low)).round(4)


def _beta(a: float, b: float) -> Nodes:
    x = np.linspace(0, 1, 121)
    # in logarithms, with the ends left out, where it vanishes: both exponents are above 0
    inside = np.exp((a - 1) * np.log(x[1:-1]) + (b - 1) * np.log1p(-x[1:-1]))
    return (LOWER + (UPPER - LOWER) * x).tolist(), [0.0, *inside.tolist(), 0.0]


def _power(end: float, start: float, power: float) -> Nodes:
    x = np.linspace(0, 1, 61)
    energies, weights = LOWER + (end - LOWER) * x, start + (1 - start) * x**power
    return [*energies.tolist(), end + STEP, UPPER], [*weights.tolist(), 0, 0]


#: name -> ranges of the parameters, and nodes
_SHAPES: dict[str, tuple[dict[str, tuple[float, float]], Callable[..., Nodes]]] = {
    "triangle": (
        {"peak (eV)": (0.9, 1.3)},
        lambda peak: ((LOWER, peak, UPPER), (0, 1, 0)),
    ),
    "trapezoid": (
        {"start of the plateau (eV)": (0.82, 1.1), "width (eV)": (0.05, 0.28)},
        lambda left, width: ((LOWER, left, left + width, UPPER), (0, 1, 1, 0)),
    ),
    "uniform + triangle": (
        {"peak (eV)": (0.9, 1.3), "floor/peak": (0, 0.6)},
        lambda peak, floor: ((LOWER, peak, UPPER), (floor, 1, floor)),
    ),
    "beta distribution": ({"a": (1.2, 4), "b": (1.2, 4)}, _beta),
    "four nodes (0.8, 1.0, 1.2, 1.4 eV)": (
        {"at 0.8 eV": (0, 0.6), "at 1.0 eV": (0.3, 1.3), "at 1.4 eV": (0, 0.4)},
        lambda first, second, last: ((0.8, 1.0, 1.2, 1.4), (first, second, 1, last)),
    ),
    "shoulder and peak": (
        {
            "shoulder (eV)": (0.82, 0.96),
            "peak (eV)": (1, 1.25),
            "shoulder/peak": (0.1, 0.8),
        },
        lambda left, peak, height: ((LOWER, left, peak, UPPER), (0, height, 1, 0)),
    ),
    "ramp": (
        {
            "peak (eV)": (1, 1.26),
            "fall/(1.4 eV − peak)": (0.01, 0.99),
            "at 0.8 eV/peak": (0, 0.45),
        },
        lambda peak, fall, start: (
            (LOWER, peak, peak + fall * (UPPER - peak), UPPER),
            (start, 1, 0, 0),
        ),
    ),
    "rise by a power, cut off": (
        {"end (eV)": (1.1, 1.39), "at 0.8 eV/at the end": (0, 0.45), "power": (0.4, 3)},
        _power,
    ),
}
FAMILIES = {name: DensityFamily(name, *shape) for name, shape in _SHAPES.items()}

#: hold times over which the paper may have fitted β, in three kinds: from the published starts of the logarithmic regime,
#: from the half-slope time of each curve, and one window for all
_WINDOWS = ((1, 1e3), (1, 1e5), (10, 1e4), (10, 1e5), (1e2, 1e5))
_KINDS = (
    [Reading(PREFERRED.starts, end) for end in (1e3, 1e4, 1e5)],
    [Reading((None, None), end) for end in (1e4, 1e5)],
    [Reading((start, start), end) for start, end in _WINDOWS],
)
READINGS = [reading for kind in _KINDS for reading in kind]
#: prior weights: equal for the kinds, and within each
READING_WEIGHTS = np.concatenate(
    [np.full(len(kind), 1 / len(kind) / len(_KINDS)) for kind in _KINDS]
)
#: the preferred reading, and the window of our own scenes
PREFER, OURS = (READINGS.index(one) for one in (PREFERRED, Reading((10.0, 10.0), 1e4)))
#: relative error of each rate from what else the paper does not state, one standard deviation
METHODS = (0.01, 0.02, 0.04, 0.08)
ROUNDING = 0.005
#: factor from "about" a time that is two standard deviations
ABOUT = 3.0
#: the published range ends at 0.8 and 1.4 eV: the share of barriers in its first and its last END (eV) is SHARE at
#: least, or less by a factor of 2, which is two standard deviations
END, SHARE = 0.1, 0.02
#: least distance of members in one of their predictions, relative to the 95 % interval
APART = 0.1
_X = np.log10(TIMES)
_WITHOUT = np.array([not condition.volume for condition in CONDITIONS])


class Reported(NamedTuple):
    """What the paper reports, of the paper itself or of n densities; all are natural logarithms."""

    #: β, with ΔV first: (6,), of densities (n, readings, conditions)
    beta: np.ndarray
    #: hold time at which the slope first reaches half of β at h' = 0.1, with ΔV and without, s: (2,) or
    #: (n, readings, 2)
    onsets: np.ndarray
    #: hold time at which Δμ of h' = 0.05 passes that of h' = 0.2, with ΔV, s: (1,) or (n, 1)
    crossing: np.ndarray

    @classmethod
    def of(cls, curves: np.ndarray) -> Reported:
        """Read curves Δμ (n, conditions, m), of which the first six are :data:`FITTED`."""
        beta = np.stack([fitted(curves, reading) for reading in READINGS], axis=1)
        onsets = _half_slope(curves[:, None, [1, 4]], beta[:, :, [1, 4]])
        crossing = np.log(shapes.last_positive(TIMES, curves[:, 2] - curves[:, 0]))
        return cls(np.log(np.maximum(beta, 1e-12)), np.log(onsets), crossing[:, None])

    def misfit_of_times(self, paper: Reported) -> np.ndarray:
        """χ² of the two onsets and the order of the slopes, (n, readings)."""
        onsets = (((self.onsets - paper.onsets) / ONSET_ERROR) ** 2).sum(axis=-1)
        return onsets + ((self.crossing - paper.crossing) / CROSSING_ERROR) ** 2

    def chi_squared(self, paper: Reported, errors: np.ndarray) -> np.ndarray:
        """χ² of the six rates under each reading, (n, readings); ``errors`` are one covariance, or n."""
        rest = paper.beta - self.beta[:, :, :6]
        return (rest @ np.linalg.inv(errors) * rest).sum(axis=-1)

    def log_likelihood(self, paper: Reported, surface: np.ndarray) -> np.ndarray:
        """ln of the likelihood by rates and times, but for a constant: (n, readings, methods).

        ``surface`` is (6, 6), or (n, 6, 6).
        """
        misfits = []
        for method in METHODS:
            errors = covariance(surface, np.exp(paper.beta), method)
            size = np.linalg.slogdet(errors)[1][..., None]
            misfits.append(self.chi_squared(paper, errors) + size)
        times = self.misfit_of_times(paper)[..., None]
        return -0.5 * (np.stack(misfits, axis=-1) + times)

    def times(self, at: int = 0, reading: int = PREFER) -> list[str]:
        """Onsets with ΔV and without, and the crossing, of one density, in s."""
        values = np.exp([*self.onsets[at, reading], *self.crossing[at]])
        return [f"{value:.2g}" for value in values]


def slope(curves: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """β, the slope of the line through curves (..., m) of Δμ against log10 t over hold times (s), (...)."""
    inside = (window[0] * (1 - 1e-9) <= TIMES) & (window[1] * (1 + 1e-9) >= TIMES)
    x = _X[inside] - _X[inside].mean()
    return curves[..., inside] @ x / (x @ x)


def fitted(curves: np.ndarray, reading: Reading) -> np.ndarray:
    """β of curves (n, conditions, m) under a reading, (n, conditions)."""
    beta = np.empty(curves.shape[:2])
    without = _WITHOUT[: curves.shape[1]]
    for start, rows in zip(reading.starts, (~without, without), strict=True):
        of, end = curves[:, rows], reading.end
        beta[:, rows] = slope(of, (start, end)) if start else _from_half_slope(of, end)
    return beta


def _half_slope(curves: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Hold time (s) at which the local slope of curves (..., m) first reaches half of β (...)."""
    steep = np.broadcast_to(np.gradient(curves, _X, axis=-1), (*beta.shape, _X.size))
    return shapes.first_reaching(TIMES, steep, 0.5 * beta)


def _from_half_slope(curves: np.ndarray, end: float) -> np.ndarray:
    """β of the line from that hold time on at which the slope first reaches half of it."""
    starts = TIMES[0.1 * end * (1 + 1e-9) >= TIMES]
    betas = np.stack([slope(curves, (start, end)) for start in starts])
    # by how much the half-slope time is later than the start of the line: 0 between two starts
    late = np.log(_half_slope(curves[None], betas).T / starts).T
    after = np.maximum(np.argmax(late <= 0, axis=0), 1)[None]
    (first, one), (last, two) = (
        [np.take_along_axis(of, at, 0)[0] for of in (late, betas)]
        for at in (after - 1, after)
    )
    share = np.clip(first / np.where(first > last, first - last, 1), 0, 1)
    return one + share * (two - one)


PUBLISHED = np.array(BETA)
#: the order of the slopes reverses between 1 and 10 s; the regime starts at about 1 s with ΔV and 10 s without
PAPER = Reported(np.log(PUBLISHED), np.log([1.0, 10.0]), np.log([10**0.5]))
#: two standard deviations are 1 to 10 s
CROSSING_ERROR = 0.25 * np.log(10)
ONSET_ERROR = 0.5 * np.log(ABOUT)


def covariance(surface: np.ndarray, beta: np.ndarray, method: float) -> np.ndarray:
    """(6, 6) of ln β of one surface, printed with two digits, about the mean over surfaces with covariance (6, 6)."""
    return surface + np.diag(ROUNDING**2 / 3 / beta**2 + method**2)


@dataclass(frozen=True)
class Emulator:
    """Curves of a family between computed densities."""

    family: DensityFamily
    #: (n, k), and Δμ, mean over surfaces, (n, conditions, m)
    parameters: np.ndarray
    curves: np.ndarray

    def __call__(self, parameters: np.ndarray) -> np.ndarray:
        """Δμ at parameters (p, k), (p, conditions, m)."""
        low, high = self.family.bounds
        known, wanted = (
            (each - low) / (high - low) for each in (self.parameters, parameters)
        )
        values, degree = self.curves.reshape(len(known), -1), min(len(low), 2)
        made = RBFInterpolator(known, values, None, 1e-4, "cubic", degree=degree)
        return made(wanted).reshape(len(wanted), *self.curves.shape[1:])

    @property
    def error(self) -> np.ndarray:
        """Covariance (6, 6) of ln β of :data:`FITTED`, each computed density against those of all others."""
        others = []
        for at, row in enumerate(self.parameters):
            rest = np.arange(len(self.parameters)) != at
            without = Emulator(self.family, self.parameters[rest], self.curves[rest])
            others.append(without(row[None])[0])
        found, known = (Reported.of(of) for of in (np.array(others), self.curves))
        every = (found.beta - known.beta)[:, :, :6].reshape(-1, 6)
        return every.T @ every / len(every)


class DensityPrior(NamedTuple):
    """Draws of all families, equally many of each; N altogether."""

    #: families with the parameters (k,) of the draws, N, and what the paper would report of them
    draws: list[tuple[DensityFamily, np.ndarray]]
    reported: Reported
    #: ln of the prior weight by the published range, (N,)
    log_weight: np.ndarray
    #: covariance of ln β between surfaces, (6, 6), and with the error of the interpolation, (N, 6, 6)
    surface: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(
        cls,
        emulators: Sequence[Emulator],
        surface: np.ndarray,
        shift: Reported,
        count: int = 1 << 12,
    ) -> DensityPrior:
        """Draw from families.

        ``shift`` is what the mean over all surfaces has more than that over the surfaces of the emulators, of any
        density, and ``surface`` (6, 6) the covariance of ln β between surfaces.
        """
        draws, found = [], []
        for emulator in emulators:
            rows = emulator.family.design(count, seed=11)
            draws += [(emulator.family, row) for row in rows]
            found.append(Reported.of(emulator(rows)))
        reported = Reported(*map(np.concatenate, zip(*found, strict=True)))
        reported.beta[:, :, :6] += shift.beta
        reported.onsets[:] += shift.onsets
        reported.crossing[:] += shift.crossing
        ends = np.array([range_weight(family.nodes(*row)) for family, row in draws])
        errors = [surface + emulator.error for emulator in emulators]
        return cls(draws, reported, ends, surface, np.repeat(errors, count, axis=0))

    def barriers(self, at: int) -> chemage.plugin.Barriers:
        """Make the barriers of a draw."""
        family, parameters = self.draws[at]
        return family.barriers(parameters)

    def posterior(self, paper: Reported) -> np.ndarray:
        """Weights that sum to 1, (N, readings, methods)."""
        log = self.reported.log_likelihood(paper, self.covariance)
        log += self.log_weight[:, None, None] + np.log(READING_WEIGHTS)[:, None]
        weight = np.exp(log - log.max())
        return weight / weight.sum()


def range_weight(nodes: Nodes) -> float:
    """ln of the prior weight of a density: whether both ends of the published range have some barriers."""
    ends = [LOWER + END, UPPER - END]
    grid = np.unique([*nodes[0], *ends])
    below = cumulative_trapezoid(np.interp(grid, *nodes), grid, initial=0)
    low, high = np.interp(ends, grid, below) / below[-1]
    shares = np.maximum([low, 1 - high], 1e-6)
    return float(-0.5 * np.sum((2 * np.minimum(0.0, np.log2(shares / SHARE))) ** 2))


def interval(
    values: np.ndarray, weight: np.ndarray, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the central interval of ``values`` (N, k) with weights (N,); (k,) each."""
    found, at = [], [0.5 - level / 2, 0.5 + level / 2]
    for column, order in zip(values.T, np.argsort(values, axis=0).T, strict=True):
        found.append(np.interp(at, np.cumsum(weight[order]), column[order]))
    low, high = np.array(found).T
    return low, high


def spanning(
    reported: Reported, weight: np.ndarray, count: int, first: int | None = None
) -> np.ndarray:
    """Choose draws whose ranges of β under all readings and of the times are the central 95 % intervals, (count,).

    ``weight`` is that of each draw, (N,). After the draw ``first`` (default: that of largest weight), each next member
    brings the ends of all ranges closest to those of the intervals, in units of their widths.
    """
    beta = reported.beta[:, :, :6].reshape(len(weight), -1)
    times = reported.onsets[:, PREFER], reported.crossing
    values = np.concatenate([beta, *times], axis=1)
    low, high = interval(values, weight)
    # of a draw far outside of every interval no member is made
    candidates = np.flatnonzero(weight > 1e-3 * weight.max())
    first = int(np.argmax(weight)) if first is None else first
    candidates = np.union1d(candidates, [first])
    scaled = (values[candidates] - low) / np.maximum(high - low, 1e-9)
    chosen = [int(np.searchsorted(candidates, first))]
    while len(chosen) < count:
        of = scaled[chosen]
        least, most = (end[:, None] for end in (of.min(axis=0), of.max(axis=0)))
        miss = np.minimum(least, scaled.T) ** 2 + (np.maximum(most, scaled.T) - 1) ** 2
        # nearly the same draw twice says nothing more
        near = np.abs(scaled[:, None] - of).max(axis=2).min(axis=1) < APART
        chosen.append(int(np.argmin(miss.sum(axis=0) + 1e6 * near)))
    return candidates[chosen]
