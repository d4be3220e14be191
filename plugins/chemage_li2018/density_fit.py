"""Shapes of the density of barriers, the published rates with a model of their errors, and the densities that fit.

Families have at most three parameters on 0.8 to 1.4 eV. The published β are one realisation of each surface, printed
with two digits. With ``b`` the mean over surfaces of a density, ln β(published) = ln b + surface + rounding + method:

- *surface*: how one surface differs from the mean, with the covariance between our surfaces. Slopes and volumes of one
  surface deviate together, so that this covers a common factor and leaves the ratios nearly exact;
- *rounding*: uniform, ±0.005 in β, through its variance;
- *method*: what the paper does not state, such as the width of the breaking barriers, hold times of the fit, and the
  noise of ten replicas, ±1 % for each rate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.stats import qmc

import chemage
from chemage_li2018.density_rates import SLOPES
from chemage_li2018.published import BETA

#: eV
LOWER, UPPER = 0.8, 1.4
#: width of a step in a density, eV: nodes of a table must increase
STEP = 1e-3

Nodes = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class Family:
    """A family of densities that are piecewise linear (the beta distribution: on a fine grid)."""

    name: str
    #: parameters, in the order of the arguments of ``nodes``, with units
    parameters: tuple[str, ...]
    #: range in which the parameters are searched, one pair each
    bounds: tuple[tuple[float, float], ...]
    #: parameters -> energies (eV) and weights
    nodes: Callable[..., Nodes]

    def barriers(self, parameters: Sequence[float] | np.ndarray) -> chemage.plugin.Barriers:
        """Make the barriers of the density with these parameters."""
        energies, weights = self.nodes(*(float(value) for value in parameters))
        return chemage.barriers("tabulated", energies=list(energies), weights=list(weights))


def _triangle(peak: float) -> Nodes:
    return (LOWER, peak, UPPER), (0, 1, 0)


def _trapezoid(left: float, width: float) -> Nodes:
    return (LOWER, left, left + width, UPPER), (0, 1, 1, 0)


def _mixture(peak: float, floor: float) -> Nodes:
    return (LOWER, peak, UPPER), (floor, 1, floor)


def _beta(a: float, b: float) -> Nodes:
    x = np.linspace(0, 1, 121)
    # in logarithms, with the ends left out: both exponents are at least 0
    inside = np.exp((a - 1) * np.log(x[1:-1]) + (b - 1) * np.log1p(-x[1:-1]))
    ends = (1.0 if a == 1 else 0.0), (1.0 if b == 1 else 0.0)
    return (LOWER + (UPPER - LOWER) * x).tolist(), [ends[0], *inside.tolist(), ends[1]]


def _four_nodes(first: float, second: float, last: float) -> Nodes:
    return (0.8, 1.0, 1.2, 1.4), (first, second, 1, last)


def _shoulder(left: float, peak: float, height: float) -> Nodes:
    return (LOWER, left, peak, UPPER), (0, height, 1, 0)


def _ramp(peak: float, fall: float, start: float) -> Nodes:
    return (LOWER, peak, peak + fall, UPPER), (start, 1, 0, 0)


def _power(end: float, start: float, power: float) -> Nodes:
    x = np.linspace(0, 1, 61)
    energies, weights = LOWER + (end - LOWER) * x, start + (1 - start) * x**power
    return [*energies.tolist(), end + STEP, UPPER], [*weights.tolist(), 0, 0]


FAMILIES = (
    Family("triangle", ("peak (eV)",), ((0.9, 1.3),), _triangle),
    Family("trapezoid", ("start of the plateau (eV)", "width (eV)"), ((0.82, 1.1), (0.05, 0.28)), _trapezoid),
    Family("uniform + triangle", ("peak (eV)", "floor/peak"), ((0.9, 1.3), (0.0, 0.6)), _mixture),
    Family("beta distribution", ("a", "b"), ((1.2, 4.0), (1.2, 4.0)), _beta),
    Family(
        "four nodes (0.8, 1.0, 1.2, 1.4 eV)",
        ("at 0.8 eV", "at 1.0 eV", "at 1.4 eV"),
        ((0.0, 0.6), (0.3, 1.3), (0.0, 0.4)),
        _four_nodes,
    ),
    Family(
        "shoulder and peak",
        ("shoulder (eV)", "peak (eV)", "shoulder/peak"),
        ((0.82, 0.96), (1.0, 1.25), (0.1, 0.8)),
        _shoulder,
    ),
    Family(
        "ramp",
        ("peak (eV)", "width of the fall (eV)", "at 0.8 eV/peak"),
        ((1.10, 1.26), (STEP, 0.12), (0.0, 0.45)),
        _ramp,
    ),
    Family(
        "rise by a power, cut off",
        ("end (eV)", "at 0.8 eV/at the end", "power"),
        ((1.10, 1.26), (0.0, 0.45), (0.4, 3.0)),
        _power,
    ),
)


#: published β, with ΔV first, (6,)
PUBLISHED = np.array([BETA[volume][slope] for volume in (6.4, 0.0) for slope in SLOPES])
ROUNDING = 0.005
#: relative error of each published rate from what the paper does not state, one standard deviation
METHOD = 0.01
#: the bounds asked for: each rate relative, each ratio absolute
WITHIN_BETA, WITHIN_RATIO = 0.06, 0.04
#: χ² above the least within which a density fits equally well: 68 % of three parameters
EQUAL = 3.53


def ratios(beta: np.ndarray) -> np.ndarray:
    """β(6.4 Å³)/β(0) of each slope: (..., 6) to (..., 3)."""
    return beta[..., :3] / beta[..., 3:]


#: the published ratios, with as many digits as the rates
PUBLISHED_RATIOS = ratios(PUBLISHED).round(2)


def rounded_ratios() -> np.ndarray:
    """The least and the largest ratio that round to the published rates, (2, 3)."""
    with_volume, without = PUBLISHED[:3], PUBLISHED[3:]
    return np.stack([(with_volume - ROUNDING) / (without + ROUNDING), (with_volume + ROUNDING) / (without - ROUNDING)])


@dataclass(frozen=True)
class Errors:
    """The error model: covariance of ln β(published) about the mean over surfaces, (6, 6)."""

    covariance: np.ndarray
    #: standard deviations between surfaces, of ln β (6,) and of the ratios, relative (3,)
    surface: np.ndarray
    surface_of_ratios: np.ndarray

    @classmethod
    def between(cls, logarithms: np.ndarray) -> Errors:
        """Make the error model from ln β of some densities on every surface, (densities, surfaces, 6)."""
        surfaces = logarithms.shape[1]
        scatter = np.mean([np.cov(values.T) for values in logarithms], axis=0)
        differences = logarithms[..., :3] - logarithms[..., 3:]
        return cls(
            # our own mean has the error of its surfaces as well
            scatter * (1 + 1 / surfaces) + np.diag(ROUNDING**2 / 3 / PUBLISHED**2 + METHOD**2),
            np.sqrt(np.diag(scatter)),
            differences.std(axis=1, ddof=1).mean(axis=0),
        )

    def chi_squared(self, logarithms: np.ndarray) -> np.ndarray:
        """χ² of ln β (..., 6), (...)."""
        rest = np.log(PUBLISHED) - logarithms
        return np.einsum("...i,ij,...j->...", rest, np.linalg.inv(self.covariance), rest)


def excess(beta: np.ndarray) -> np.ndarray:
    """The largest deviation over its bound, of the six rates and the three ratios: at most 1 where all are within."""
    rates = np.abs(beta / PUBLISHED - 1).max(axis=-1) / WITHIN_BETA
    of_ratios = np.abs(ratios(beta) - PUBLISHED_RATIOS).max(axis=-1) / WITHIN_RATIO
    return np.maximum(rates, of_ratios)


@dataclass(frozen=True)
class Fitted:
    """A family, the densities of it that were computed, and the best of all."""

    family: Family
    #: parameters (n, k) and ln β, mean over surfaces, (n, 6), of the computed densities
    parameters: np.ndarray
    logarithms: np.ndarray
    #: parameters of the best density (k,), by interpolation between the computed ones
    best: np.ndarray

    def interpolated(self, parameters: np.ndarray) -> np.ndarray:
        """ln β at ``parameters`` (m, k), (m, 6)."""
        low, high = np.array(self.family.bounds).T
        surface = RBFInterpolator(
            (self.parameters - low) / (high - low), self.logarithms, kernel="cubic", degree=2, smoothing=1e-4
        )
        return surface((np.atleast_2d(parameters) - low) / (high - low))


def design(
    family: Family, count: int, centre: np.ndarray | None = None, width: float = 0.25, *, share: bool = False
) -> np.ndarray:
    """Spread parameters evenly over the bounds of a family, or over this part of them about ``centre``; (count, k).

    With ``share`` they are given as shares of the range, from 0 to 1.
    """
    low, high = np.array(family.bounds).T
    if centre is not None:
        half = 0.5 * width * (high - low)
        low, high = np.maximum(low, centre - half), np.minimum(high, centre + half)
    # scipy before 1.15 has no argument rng
    sequence = qmc.Sobol(len(low), seed=5)  # pyright: ignore[reportCallIssue]
    points = sequence.random(1 << (count - 1).bit_length())[:count]
    return points if share else low + points * (high - low)


def fitted(family: Family, parameters: np.ndarray, logarithms: np.ndarray, errors: Errors) -> Fitted:
    """Find the density of least χ², by interpolation between the computed ones."""
    closest = Fitted(family, parameters, logarithms, parameters[int(np.argmin(errors.chi_squared(logarithms)))])
    best = closest.best
    for width in (None, 0.2, 0.05, 0.01):
        trial = design(family, 4096, None if width is None else best, width or 1.0)
        trial = np.vstack([best, trial])
        best = trial[int(np.argmin(errors.chi_squared(closest.interpolated(trial))))]
    return Fitted(family, parameters, logarithms, best)


def region(closest: Fitted, errors: Errors, margin: float = 0.15) -> tuple[tuple[float, float], ...]:
    """Find the box of parameters that holds the densities which fit equally well, a little wider; k pairs."""
    trial = np.vstack([closest.best, design(closest.family, 1 << 14)])
    chi = errors.chi_squared(closest.interpolated(trial))
    inside = trial[chi <= chi.min() + EQUAL]
    low, high = np.array(closest.family.bounds).T
    wider = np.maximum(margin * np.ptp(inside, axis=0), 0.05 * (high - low))
    least, most = np.maximum(low, inside.min(axis=0) - wider), np.minimum(high, inside.max(axis=0) + wider)
    return tuple((float(a), float(b)) for a, b in zip(least, most, strict=True))


def within_bounds(closest: Fitted, errors: Errors, count: int) -> np.ndarray:
    """Choose candidates for the best density: those that fit equally well with the least :func:`excess`; (count, k).

    They are chosen far from each other, because the interpolation has an error: the one with the least excess first.
    """
    trial = np.vstack([closest.best, design(closest.family, 1 << 15)])
    values = closest.interpolated(trial)
    chi = errors.chi_squared(values)
    inside = chi <= chi.min() + EQUAL
    trial, values = trial[inside], excess(np.exp(values[inside]))
    least = np.argsort(values)[: max(count, len(values) // 100)]
    return np.vstack([trial[least[0]], _apart(trial[least[1:]], trial[least[0]], count - 1)])


def _apart(points: np.ndarray, first: np.ndarray, count: int) -> np.ndarray:
    """Choose points, each the farthest from ``first`` and those chosen before, in units of their range; (count, k)."""
    span = np.maximum(np.ptp(points, axis=0), 1e-12)
    distance = np.linalg.norm((points - first) / span, axis=1)
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm((points - points[chosen[-1]]) / span, axis=1))
    return points[chosen]


def equally_good(closest: Fitted, errors: Errors, count: int, best: np.ndarray) -> np.ndarray:
    """Choose ``count`` members of a family that fit equally well, far from each other; parameters, (count, k).

    Of the densities whose χ² is at most :data:`EQUAL` above the least, each next member is the one farthest from those
    chosen before, beginning with ``best``; distances are those of the parameters, in units of their range in the
    region.
    """
    box = np.array(closest.family.bounds)
    while True:
        trial = box[:, 0] + design(closest.family, 1 << 15, share=True) * (box[:, 1] - box[:, 0])
        chi = errors.chi_squared(closest.interpolated(np.vstack([closest.best, trial])))
        inside = chi[1:] <= chi.min() + EQUAL
        if inside.sum() >= count or np.ptp(box, axis=1).max() < 1e-6:
            break
        # a region much smaller than the bounds: look closer about the best
        half = 0.25 * np.ptp(box, axis=1)
        box = np.stack([np.maximum(box[:, 0], closest.best - half), np.minimum(box[:, 1], closest.best + half)], axis=1)
    trial = trial[inside]
    return _apart(trial, best, count)
