"""Shapes of the density of barriers, what the paper says of it with a model of the errors, and what this leaves open.

The published β are one realisation of each surface, printed with two digits, and fitted over hold times that the paper
does not state. With ``b`` the mean over surfaces of a density over one of :data:`WINDOWS`,
ln β(published) = ln b + surface + rounding + method:

- *surface*: how one surface differs from the mean, with the covariance between our surfaces. Slopes and volumes of one
  surface deviate together, so that this covers a common factor and leaves the ratios nearly exact;
- *rounding*: uniform, ±0.005 in β, through its variance;
- *method*: what else the paper does not state, such as the width of the breaking barriers and the noise of ten
  replicas; one of :data:`METHODS` for each rate.

Window and method are nuisance parameters with equal prior weights, as the families have. The parameters of a family are
uniform in their box.
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
from chemage_li2018.density_rates import TIMES
from chemage_li2018.published import BETA

#: eV
LOWER, UPPER = 0.8, 1.4
#: width of a step in a density, eV: nodes of a table must increase
STEP = 1e-3

Nodes = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class DensityFamily:
    """A family of densities that are piecewise linear (the beta distribution: on a fine grid)."""

    name: str
    #: parameters, in the order of the arguments of ``nodes``, with units
    parameters: tuple[str, ...]
    #: range of the parameters, one pair each
    bounds: tuple[tuple[float, float], ...]
    #: parameters -> energies (eV) and weights
    nodes: Callable[..., Nodes]

    def barriers(
        self, parameters: Sequence[float] | np.ndarray
    ) -> chemage.plugin.Barriers:
        """Make the barriers of the density with these parameters."""
        energies, weights = self.nodes(*(float(value) for value in parameters))
        return chemage.barriers(
            "tabulated", energies=list(energies), weights=list(weights)
        )

    def named(self, parameters: Sequence[float] | np.ndarray) -> str:
        """Parameters with their names, in words."""
        return ", ".join(
            f"{name} {value:.3g}"
            for name, value in zip(self.parameters, parameters, strict=True)
        )

    def design(self, count: int, seed: int = 5) -> np.ndarray:
        """Spread parameters evenly over the box (Sobol'), (count, k)."""
        low, high = np.array(self.bounds).T
        # scipy before 1.15 has no argument rng
        sequence = qmc.Sobol(len(low), seed=seed)  # pyright: ignore[reportCallIssue]
        return (
            low + sequence.random(1 << (count - 1).bit_length())[:count] * (high - low)
        ).round(4)


def _beta(a: float, b: float) -> Nodes:
    x = np.linspace(0, 1, 121)
    # in logarithms, with the ends left out, where it vanishes: both exponents are above 0
    inside = np.exp((a - 1) * np.log(x[1:-1]) + (b - 1) * np.log1p(-x[1:-1]))
    return (LOWER + (UPPER - LOWER) * x).tolist(), [0.0, *inside.tolist(), 0.0]


def _power(end: float, start: float, power: float) -> Nodes:
    x = np.linspace(0, 1, 61)
    energies, weights = LOWER + (end - LOWER) * x, start + (1 - start) * x**power
    return [*energies.tolist(), end + STEP, UPPER], [*weights.tolist(), 0, 0]


#: parameters with their ranges, and nodes
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
        {"peak (eV)": (0.9, 1.3), "floor/peak": (0.0, 0.6)},
        lambda peak, floor: ((LOWER, peak, UPPER), (floor, 1, floor)),
    ),
    "beta distribution": ({"a": (1.2, 4.0), "b": (1.2, 4.0)}, _beta),
    "four nodes (0.8, 1.0, 1.2, 1.4 eV)": (
        {"at 0.8 eV": (0.0, 0.6), "at 1.0 eV": (0.3, 1.3), "at 1.4 eV": (0.0, 0.4)},
        lambda first, second, last: ((0.8, 1.0, 1.2, 1.4), (first, second, 1, last)),
    ),
    "shoulder and peak": (
        {
            "shoulder (eV)": (0.82, 0.96),
            "peak (eV)": (1.0, 1.25),
            "shoulder/peak": (0.1, 0.8),
        },
        lambda left, peak, height: ((LOWER, left, peak, UPPER), (0, height, 1, 0)),
    ),
    "ramp": (
        {
            "peak (eV)": (1.0, 1.26),
            "fall/(1.4 eV − peak)": (0.01, 0.99),
            "at 0.8 eV/peak": (0.0, 0.45),
        },
        lambda peak, fall, start: (
            (LOWER, peak, peak + fall * (UPPER - peak), UPPER),
            (start, 1, 0, 0),
        ),
    ),
    "rise by a power, cut off": (
        {
            "end (eV)": (1.10, 1.39),
            "at 0.8 eV/at the end": (0.0, 0.45),
            "power": (0.4, 3.0),
        },
        _power,
    ),
    # the lower end below 0.8 eV, which tips in atomic force microscopy ask for
    "triangle with a free lower end": (
        {
            "lower end (eV)": (0.66, 0.8),
            "peak − lower end (eV)": (0.02, 0.5),
            "at the lower end/peak": (0.0, 0.5),
        },
        lambda lower, rise, start: ((lower, lower + rise, UPPER), (start, 1, 0)),
    ),
}
*FAMILIES, FREE_END = (
    DensityFamily(name, tuple(ranges), tuple(ranges.values()), nodes)
    for name, (ranges, nodes) in _SHAPES.items()
)

#: hold times over which the paper may have fitted β, s
WINDOWS = ((1.0, 1e3), (1.0, 1e5), (10.0, 1e4), (10.0, 1e5), (1e2, 1e5))
#: that of our own scenes
OURS = WINDOWS.index((10.0, 1e4))
#: relative error of each rate from what else the paper does not state, one standard deviation
METHODS = (0.01, 0.02, 0.04, 0.08)
ROUNDING = 0.005
#: factor from "about" a time that is two standard deviations
ABOUT = 3.0
#: the published range ends at 0.8 and 1.4 eV: the share of barriers in its first and its last END (eV) is SHARE at
#: least, or less by a factor of 2, which is two standard deviations
END, SHARE = 0.1, 0.02
_X = np.log10(TIMES)


class Reported(NamedTuple):
    """What the paper reports, of the paper itself or of n densities; all are natural logarithms."""

    #: β, with ΔV first: (6,), of densities (n, windows, conditions)
    beta: np.ndarray
    #: hold time at which the slope first reaches half of β at h' = 0.1, with ΔV and without, s: (2,) or (n, windows, 2)
    onsets: np.ndarray
    #: hold time at which Δμ of h' = 0.05 passes that of h' = 0.2, with ΔV, s: (1,) or (n, 1)
    crossing: np.ndarray

    def predictions(self) -> np.ndarray:
        """What members are to span: ln β of :data:`FITTED` over all windows, and the times, (N, k)."""
        beta = self.beta[:, :, :6]
        return np.concatenate(
            [beta.reshape(len(beta), -1), self.onsets[:, OURS], self.crossing], axis=1
        )

    def misfit_of_times(self, paper: Reported) -> np.ndarray:
        """χ² of the two onsets and the order of the slopes, (n, windows)."""
        onsets = (((self.onsets - paper.onsets) / ONSET_ERROR) ** 2).sum(axis=-1)
        return onsets + ((self.crossing - paper.crossing) / CROSSING_ERROR) ** 2

    def chi_squared(self, paper: Reported, errors: np.ndarray) -> np.ndarray:
        """χ² of the six rates over each window, (n, windows); ``errors`` are one covariance, or n."""
        rest = paper.beta - self.beta[:, :, :6]
        return (rest @ np.linalg.inv(errors) * rest).sum(axis=-1)

    def log_likelihood(self, paper: Reported, surface: np.ndarray) -> np.ndarray:
        """ln of the likelihood by rates and times, but for a constant: (n, windows, methods).

        ``surface`` is (6, 6), or (n, 6, 6).
        """
        misfits = []
        for method in METHODS:
            errors = covariance(surface, np.exp(paper.beta), method)
            misfits.append(
                self.chi_squared(paper, errors)
                + np.linalg.slogdet(errors)[1][..., None]
            )
        return -0.5 * (
            np.stack(misfits, axis=-1) + self.misfit_of_times(paper)[..., None]
        )

    def times(self, at: int = 0, window: int = OURS) -> list[str]:
        """Onsets with ΔV and without, and the crossing, of one density, in s."""
        return [
            f"{value:.2g}"
            for value in np.exp([*self.onsets[at, window], *self.crossing[at]])
        ]

    @classmethod
    def of(cls, curves: np.ndarray) -> Reported:
        """Read curves Δμ (n, conditions, m), of which the first six are :data:`FITTED`."""
        beta = np.stack([slope(curves, window) for window in WINDOWS], axis=1)
        crossing = np.log(shapes.last_positive(TIMES, curves[:, 2] - curves[:, 0]))
        half = 0.5 * beta[:, :, [1, 4]]
        steep = np.gradient(curves[:, None, [1, 4]], _X, axis=-1)
        steep = np.broadcast_to(steep, (*half.shape, TIMES.size))
        onsets = np.log(shapes.first_reaching(TIMES, steep, half))
        return cls(np.log(np.maximum(beta, 1e-12)), onsets, crossing[:, None])


def slope(curves: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """β, the slope of the line through curves (..., m) of Δμ against log10 t over hold times (s), (...)."""
    inside = (window[0] * (1 - 1e-9) <= TIMES) & (window[1] * (1 + 1e-9) >= TIMES)
    x = _X[inside] - _X[inside].mean()
    return curves[..., inside] @ x / (x @ x)


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
        low, high = np.array(self.family.bounds).T
        known, wanted = (
            (each - low) / (high - low) for each in (self.parameters, parameters)
        )
        values = self.curves.reshape(len(known), -1)
        degree = 2 if len(low) > 1 else 1
        surface = RBFInterpolator(
            known, values, kernel="cubic", degree=degree, smoothing=1e-4
        )
        return surface(wanted).reshape(len(wanted), *self.curves.shape[1:])

    @property
    def error(self) -> np.ndarray:
        """Covariance (6, 6) of ln β of :data:`FITTED`, each computed density against those of all others."""
        rest = []
        for at in range(len(self.parameters)):
            one = [at]
            parameters, curves = (
                np.delete(every, at, axis=0) for every in (self.parameters, self.curves)
            )
            others = Emulator(self.family, parameters, curves)
            both = np.concatenate([others(self.parameters[one]), self.curves[one]])
            beta = Reported.of(both).beta[:, :, :6]
            rest.append(beta[0] - beta[1])
        every = np.concatenate(rest)
        return every.T @ every / len(every)


@dataclass(frozen=True)
class DensityPrior:
    """Draws of all families, equally many of each; N altogether."""

    families: Sequence[DensityFamily]
    #: position of the family, (N,), its parameters, and what the paper would report of it
    family: np.ndarray
    parameters: list[np.ndarray]
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
        shift: np.ndarray,
        count: int = 1 << 12,
    ) -> DensityPrior:
        """Draw from families.

        ``shift`` (windows, 6) is what ln β lacks to the mean over all surfaces, and ``surface`` (6, 6) its covariance
        between these.
        """
        parameters, reported, weights, covariance = [], [], [], []
        for emulator in emulators:
            family = emulator.family
            rows = family.design(count, seed=11)
            parameters += list(rows)
            reported.append(Reported.of(emulator(rows)))
            weights += [range_weight(family.nodes(*row)) for row in rows]
            covariance.append(surface + emulator.error)
        together = Reported(*map(np.concatenate, zip(*reported, strict=True)))
        together.beta[:, :, :6] += shift
        return cls(
            [emulator.family for emulator in emulators],
            np.repeat(np.arange(len(emulators)), count),
            parameters,
            together,
            np.array(weights),
            surface,
            np.repeat(covariance, count, axis=0),
        )

    def barriers(self, at: int) -> chemage.plugin.Barriers:
        """Make the barriers of a draw."""
        return self.families[self.family[at]].barriers(self.parameters[at])

    def chi_squared(self, method: float) -> np.ndarray:
        """χ² of six rates of the paper over each window, (N, windows)."""
        errors = covariance(self.covariance, PUBLISHED, method)
        return self.reported.chi_squared(PAPER, errors)

    def log_likelihood(self, paper: Reported) -> np.ndarray:
        """ln of the likelihood of every draw, (N, windows, methods); see :meth:`Reported.log_likelihood`."""
        return self.reported.log_likelihood(paper, self.covariance)

    def posterior(self, paper: Reported) -> np.ndarray:
        """Weights that sum to 1, (N, windows, methods)."""
        log = self.log_likelihood(paper) + self.log_weight[:, None, None]
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
    ends = []
    for column in values.T:
        order = np.argsort(column)
        total = np.cumsum(weight[order])
        ends.append(np.interp([0.5 - level / 2, 0.5 + level / 2], total, column[order]))
    low, high = np.array(ends).T
    return low, high


#: least distance of members in one prediction, relative to the 95 % interval
_APART = 0.1


def spanning(
    values: np.ndarray, weight: np.ndarray, first: int, count: int
) -> np.ndarray:
    """Choose draws whose range over each of k predictions is its central 95 % interval as nearly as can be; (count,).

    ``values`` (N, k) are the predictions and ``weight`` (N,) their weights. After the draw
    ``first``, each next member is that which brings the ends of all ranges closest to those of the intervals, in units
    of their widths.
    """
    low, high = interval(values, weight)
    # of a draw far outside of every interval no member is made
    candidates = np.flatnonzero(weight > 1e-3 * weight.max())
    scaled = (values[candidates] - low) / np.maximum(high - low, 1e-9)
    least, most = np.full(scaled.shape[1], np.inf), np.full(scaled.shape[1], -np.inf)
    chosen = [int(np.searchsorted(candidates, first))]
    while len(chosen) < count:
        least = np.minimum(least, scaled[chosen[-1]])
        most = np.maximum(most, scaled[chosen[-1]])
        miss = (
            np.minimum(least, scaled) ** 2 + (np.maximum(most, scaled) - 1) ** 2
        ).sum(axis=1)
        # nearly the same draw twice says nothing more
        near = np.abs(scaled[:, None] - scaled[chosen]).max(axis=2).min(axis=1) < _APART
        chosen.append(int(np.argmin(miss + 1e6 * near)))
    return candidates[chosen]
