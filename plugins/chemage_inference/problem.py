"""What is sampled: the density with its prior, the unknown scalars, and measured values as linear functions of them.

Barriers that the hold times do not reach: any number of them, in narrow and in broad peaks.

A smooth process continues the density of the visible energies there, and alone would be sure of what nobody measured.
Therefore most of the samples keep it only within the energies that hold times reach. Their sites above, and those
below, lie in up to :data:`MOST` peaks: shares uniform (Dirichlet), positions uniform, widths uniform in the logarithm.
Any share of them, from none to all, may then lie below an energy. Of all densities with the same value at a hold time,
one narrow peak of all sites bonds the most later and the fewest earlier (Jensen's inequality): so many samples are such
peaks that bands of 90 % do not end before it.

What the measurements still tell of the sites outside - the last hold times see the foot of the barriers above -
restricts the peaks, which are drawn by Metropolis moves, one chain for each sample. One peak or all of them are drawn
from the prior, there or not (product space method, Carlin & Chib, J. R. Stat. Soc. B 57, 473 (1995)), and all are then
shifted such that the rate with which they react at first, the sum of share × exp(−E/k_BT), stays as it was; the shift
that this takes does not depend on a common translation, so that the volume is preserved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from chemage import Chemistry, InputError
from chemage.plugin import algebra, convert, nearest, units
from chemage_inference import kernels
from chemage_inference.energies import EnergyGrid
from chemage_inference.noise import Noise, State, fixed

#: 1/eV: mean of the process, and standard deviation of its level
LEVEL, LEVEL_SPREAD = 0.5, 1.5
#: 1/eV: standard deviations of the process, uniform in the logarithm
STRENGTHS = np.geomspace(0.3, 12.0, 10)
#: eV: lengths, none shorter than what hold times can resolve
LENGTHS = (0.07, 0.125, 0.22, 0.4)
#: ν of the Matérn covariance
SMOOTHNESSES = (1.0, 1.5, 2.5)
#: unknown -> its unit, and whether its prior is uniform in the logarithm
UNITS: dict[str, tuple[str, bool]] = {
    "bond_force": ("nN", True),
    "activation_volume": ("nm**3", False),
    "attempt_frequency": ("Hz", True),
}
#: name of the true load over the stated one, where that has an error
LOAD = "load over stated"
#: values of one unknown, of each of two and of three on the grid, without and with an interaction; and of the load at
#: most, for each of which contacts are solved
POINTS, LOADS = ((31, 13, 9), (9, 5, 5)), 9
#: standard deviations by which the load is off at most
FARTHEST = 2.5


def matern(smoothness: float, distance: np.ndarray) -> np.ndarray:
    """Matérn covariance of variance 1 at distances in units of its length; Rasmussen & Williams 2006, eq. 4.14."""
    if smoothness == 1.0:
        from scipy.special import k1

        scaled = np.sqrt(2.0) * np.maximum(distance, 1e-9)
        return scaled * k1(scaled)
    if smoothness == 1.5:
        scaled = np.sqrt(3.0) * distance
        return (1 + scaled) * np.exp(-scaled)
    scaled = np.sqrt(5.0) * distance
    return (1 + scaled + scaled**2 / 3) * np.exp(-scaled)


@dataclass(frozen=True, eq=False)
class Prior:
    """A rectified Gaussian process on the nodes of a density, of unknown strength, smoothness and length.

    The density is max(x, 0), where x is the process, so that it can be exactly zero. Strength and covariance (Matérn 1,
    3/2 or 5/2, several lengths) are not set but sampled with it.
    """

    #: (n,) eV
    nodes: np.ndarray

    @cached_property
    def combinations(self) -> list[tuple[float, ...]]:
        """Smoothness, length (eV) and strength (1/eV) of every choice."""
        return list(product(SMOOTHNESSES, LENGTHS, STRENGTHS.tolist()))

    @cached_property
    def parts(self) -> np.ndarray:
        """(choices, 3) numbers of the smoothness, the length and the strength of every choice."""
        sizes = len(SMOOTHNESSES), len(LENGTHS), STRENGTHS.size
        return np.indices(sizes).reshape(3, -1).T

    def covariance(self, choice: int) -> np.ndarray:
        """(n, n) 1/eV²."""
        smoothness, length, strength = self.combinations[choice]
        distance = np.abs(self.nodes[:, None] - self.nodes) / length
        covariance = strength**2 * matern(smoothness, distance) + LEVEL_SPREAD**2
        rounding = 1e-6 * (strength**2 + LEVEL_SPREAD**2)
        return covariance + rounding * np.eye(self.nodes.size)

    @cached_property
    def factors(self) -> list[np.ndarray]:
        """Of each choice the (n, n) lower triangle whose square is the covariance."""
        choices = range(len(self.combinations))
        return [algebra.cholesky(self.covariance(choice)) for choice in choices]

    @cached_property
    def precisions(self) -> tuple[np.ndarray, np.ndarray]:
        """(choices, n, n) inverse covariances, and (choices,) minus half the logarithms of their determinants."""
        inverses, logs = [], []
        for lower in self.factors:
            root = algebra.forward(lower, np.eye(len(lower)))
            inverses.append(algebra.product(root.T, root))
            logs.append(-np.log(np.diag(lower)).sum())
        return np.stack(inverses), np.array(logs)

    def sample(
        self, count: int, areas: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """(count, n) densities of the prior whose integral is at most 1."""
        densities: list[np.ndarray] = []
        for _ in range(1000 * count):
            factor = self.factors[int(rng.integers(len(self.factors)))]
            normal = rng.standard_normal(self.nodes.size)
            density = np.maximum(LEVEL + algebra.product(factor, normal), 0.0)
            if algebra.product(density, areas) <= 1.0:
                densities.append(density)
                if len(densities) == count:
                    break
        # of a range of energies so wide that hardly any density has an integral below 1, the last one
        last = densities[-1:] or [np.zeros(self.nodes.size)]
        return np.stack(densities + last * (count - len(densities)))


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is inferred beside the density: scalars on a grid of values, each with its linear model, and ⟨f⟩."""

    #: name -> its values along its axis of the grid; bond_force is not on it, but scales everything
    axes: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: bounds of the logarithm of bond_force over that of the scene; None where it is known
    factor: tuple[float, float] | None = None
    #: name -> lower and upper bound, in its unit
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def nodes(self) -> np.ndarray:
        """(g, d) positions of the points of the grid, each from 0 to one less than the values of its axis."""
        shape = [axis.size for axis in self.axes.values()]
        return np.indices(shape).reshape(len(shape), self.points).T

    @property
    def points(self) -> int:
        """Points of the grid."""
        return math.prod(axis.size for axis in self.axes.values())

    def values(self, positions: np.ndarray) -> dict[str, np.ndarray]:
        """Name -> (S,) its value at each of the ``positions`` (S, d)."""
        return {
            name: np.exp(np.interp(at, np.arange(axis.size), np.log(axis)))
            if name == LOAD or UNITS.get(name, ("", False))[1]
            else np.interp(at, np.arange(axis.size), axis)
            for (name, axis), at in zip(self.axes.items(), positions.T, strict=True)
        }

    @cached_property
    def _cardinals(self) -> list[Any]:
        """Of each axis the splines that are 1 at one of its values and 0 at all others, or nearly so."""
        from scipy.interpolate import make_interp_spline, make_lsq_spline

        splines = []
        for name, axis in self.axes.items():
            at, each = np.arange(axis.size), np.eye(axis.size)
            spline = make_interp_spline(at, each)
            if name == LOAD:
                # as it rises, one pixel after the other comes into contact, as none does in truth
                knots = np.repeat([0.0, at[-1]], 3)
                spline = make_lsq_spline(at, each, knots, 2)
            splines.append(spline)
        return splines

    @cached_property
    def polynomials(self) -> tuple[np.ndarray, np.ndarray]:
        """Those of B-splines, with their sizes, as of :func:`chemage_inference.kernels.spline_weights`."""
        from scipy.interpolate import BSpline

        ends = [(spline.t[-1], len(spline.c)) for spline in self._cardinals]
        sizes = np.array(ends, dtype=np.int64).reshape(-1, 2)
        powers = np.zeros((len(sizes), 4, *sizes.max(axis=0, initial=1)))
        for each, spline, (pieces, count) in zip(
            powers, self._cardinals, sizes, strict=True
        ):
            basis = BSpline(spline.t, np.eye(count), spline.k)
            for k in range(4):
                derivative = basis(np.arange(pieces), k)
                each[k, :pieces, :count] = derivative / math.factorial(k)
        return powers, sizes

    def coefficients(self, array: np.ndarray) -> np.ndarray:
        """Of ``array`` (g, ...) at the points of the grid: those whose sums with :meth:`weights` interpolate it."""
        shape = [axis.size for axis in self.axes.values()]
        array = array.reshape(*shape, *array.shape[1:])
        for axis, spline in enumerate(self._cardinals):
            rows = np.moveaxis(array, axis, 0)
            array = np.moveaxis(algebra.product(spline.c, rows), 0, axis)
        return np.ascontiguousarray(array).reshape(-1, *array.shape[len(shape) :])

    def weights(self, positions: np.ndarray) -> np.ndarray:
        """(S, g) of the coefficients at ``positions`` (S, d); at most four along each axis are not 0."""
        each = [kernels.spline_weights(at, *self.polynomials) for at in positions]
        return np.stack(each)

    def chemistry(self, chemistry: Chemistry, point: int) -> Chemistry:
        """The chemistry at a point of the grid."""
        values = self.values(self.nodes[[point]])
        changed = {
            name: float(at[0]) for name, at in values.items() if name != LOAD
        }
        return chemistry.replace(**changed) if changed else chemistry

    def load(self, stated: float, point: int) -> float:
        """The load (nN) of a stated one at a point of the grid."""
        values = self.values(self.nodes[[point]])
        return stated * float(values[LOAD][0]) if LOAD in values else stated

    @cached_property
    def priors(self) -> np.ndarray:
        """(k, 4) of the position on the grid, and of the logarithm of the factor where it is unknown: lower and upper
        bound, mean, and standard deviation, infinite where the prior is uniform."""
        spans = [(0.0, axis.size - 1.0) for axis in self.axes.values()]
        spans += [self.factor] if self.factor else []
        priors = [(*span, sum(span) / 2, np.inf) for span in spans]
        if LOAD in self.axes:
            last = self.axes[LOAD].size - 1.0
            priors[len(self.axes) - 1] = 0.0, last, last / 2, last / 2 / FARTHEST
        return np.array(priors).reshape(-1, 4)


def unknowns_of(
    names: Mapping[str, tuple[units.QuantityLike, units.QuantityLike]]
    | Sequence[str],
    chemistry: Chemistry,
    load_error: float = 0.0,
) -> Unknowns:
    """The unknowns of these ``names``, with bounds or with the default ones; and the load, where it has an error.

    Raises
    ------
    InputError
        A name that is no unknown, or bounds that are none.
    """
    names = (names,) if isinstance(names, str) else names
    bounds = {name: _bounds(name, names, chemistry) for name in names}
    on_grid = [name for name in bounds if name != "bond_force"]
    several = max(len(on_grid) + (load_error > 0), 1)
    count = POINTS[chemistry.interaction is not None][min(several, 3) - 1]
    axes = [
        (np.geomspace if UNITS[name][1] else np.linspace)(*bounds[name], count)
        for name in on_grid
    ]
    if load_error:
        on_grid = [*on_grid, LOAD]
        axes.append(
            np.exp(load_error * FARTHEST * np.linspace(-1, 1, min(count, LOADS)))
        )
    factor = None
    if "bond_force" in bounds:
        low, high = np.log(np.array(bounds["bond_force"]) / chemistry.bond_force)
        factor = float(low), float(high)
    return Unknowns(dict(zip(on_grid, axes, strict=True)), factor, bounds)


def _bounds(
    name: str,
    names: Mapping[str, tuple[units.QuantityLike, units.QuantityLike]]
    | Sequence[str],
    chemistry: Chemistry,
) -> tuple[float, float]:
    if name not in UNITS:
        raise InputError.of(
            "unknown",
            name,
            f"cannot be inferred{nearest(name, list(UNITS))}",
            f"choose {', '.join(UNITS)}",
        )
    unit, logarithmic = UNITS[name]
    if not isinstance(names, Mapping):
        value = float(getattr(chemistry, name))
        if name == "activation_volume":
            return 0.0, max(2 * value, 0.012)
        return (
            (value / 3, value * 3)
            if name == "bond_force"
            else (value / 30, value * 30)
        )
    ends = names[name]
    if isinstance(ends, str) or not isinstance(ends, Sequence) or len(ends) != 2:
        raise InputError.of(
            f"unknown.{name}",
            ends,
            "must be a lower and an upper bound",
            f"in {unit}",
        )
    low, high = (convert(end, unit, f"unknown.{name}") for end in ends)
    if not (0 <= low < high < np.inf) or (logarithmic and low <= 0):
        raise InputError.of(
            f"unknown.{name}",
            ends,
            "must be a lower and a larger upper bound, finite and not negative",
        )
    return low, high


def summed(weights: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """(...,) sum of ``coefficients`` (g, ...) with ``weights`` (g,), most of which are 0."""
    used = np.flatnonzero(weights)
    if used.size == 1:
        return weights[used[0]] * coefficients[used[0]]
    return algebra.product(weights[used], coefficients[used])


def values_of(
    densities: np.ndarray,
    weights: np.ndarray,
    matrices: np.ndarray,
    offsets: np.ndarray,
) -> np.ndarray:
    """(S, m): offset + matrix @ density of each of ``densities`` (S, n), with ``weights`` (S, g) of the coefficients
    ``matrices`` (g, m, n) and ``offsets`` (g, m)."""
    values = np.zeros((len(densities), offsets.shape[1]))
    for weight, matrix, offset in zip(weights.T, matrices, offsets, strict=True):
        used = np.flatnonzero(weight)
        part = offset + algebra.product(densities[used], matrix.T)
        values[used] += weight[used, None] * part
    return values


@dataclass(frozen=True, eq=False)
class Linear:
    """Measured values as a linear function of the density: values = factor × (offset + matrix @ density)."""

    grid: EnergyGrid
    #: (m, n) and (m,)
    matrix: np.ndarray
    offset: np.ndarray
    #: (m,) measured, and their standard errors
    values: np.ndarray
    errors: np.ndarray
    #: bounds of the logarithm of an unknown common factor; None without one
    factor: tuple[float, float] | None = None
    #: (m, q): changes of the values by one standard deviation of each nuisance
    nuisances: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class Problem:
    """Measured values as a linear function of the density: values = offset + matrix @ density, for any scalars."""

    prior: Prior
    #: (n,) eV
    areas: np.ndarray
    #: (m,) measured
    values: np.ndarray
    #: the likelihood of residuals, and what is inferred of the errors
    noise: Noise
    #: (g, m, n) and (g, m): coefficients of splines over the grid of scalars, see :meth:`Unknowns.coefficients`
    matrices: np.ndarray
    offsets: np.ndarray
    unknowns: Unknowns = field(default_factory=Unknowns)
    #: point of the grid from which sampling begins
    start: int = 0
    #: where the errors of a chain begin; None: as they are stated
    state: State | None = None

    @cached_property
    def errors(self) -> np.ndarray:
        """(m,) standard errors where a chain begins."""
        return self.noise.errors(self.state or self.noise.start)

    def at(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m, n) and (m,): matrix and offset with these ``weights`` (g,) of the coefficients."""
        return summed(weights, self.matrices), summed(weights, self.offsets)

    def settled(self, state: State) -> Problem:
        """The problem with the errors and the nuisances of ``state``, and known: in combinations of the measurements
        whose errors are independent and 1."""
        noise = self.noise
        factor = noise.factor(state)

        def white(rows: np.ndarray) -> np.ndarray:
            return np.stack(
                [noise.white(state, (factor * one.T).T) for one in rows]
            )

        return replace(
            self,
            noise=fixed(np.ones(factor.size)),
            state=None,
            values=noise.white(state, self.values - noise.added(state)),
            matrices=white(self.matrices),
            offsets=white(self.offsets),
        )

    def without(self, left_out: np.ndarray) -> Problem:
        """The problem without the points that ``left_out`` (m,) marks."""
        kept = ~left_out
        return replace(
            self,
            values=self.values[kept],
            matrices=self.matrices[:, kept],
            offsets=self.offsets[:, kept],
            noise=self.noise.without(left_out),
        )


#: peaks at most, and the probability of each but the first to be there
MOST, THERE = 4, 0.125
#: eV, standard deviations of peaks
WIDTHS = np.geomspace(0.01, 0.08, 4)
#: share of the samples in which the smooth process goes on
SMOOTH = 0.25
#: eV below and above the energies of the smooth process to which peaks may lie
REACH = 0.2, 0.5
#: Metropolis moves of each chain
MOVES = 1000
#: standard errors by which peaks with all sites change a combination of the measurements at least, or it is left out
NEGLIGIBLE = 0.01


class Data(NamedTuple):
    """What the measurements say of S densities: values, errors and model in standard errors."""

    #: (g, m, n): coefficients over the grid of scalars
    matrices: np.ndarray
    #: (S, g) their weights, and (S,) common factors
    weights: np.ndarray
    factors: np.ndarray
    #: (m,) and (g, m)
    values: np.ndarray
    offsets: np.ndarray
    #: eV
    kt: float


class Hidden:
    """Densities on the nodes ``first`` to ``stop`` of ``grid``, without ``stop``."""

    def __init__(self, grid: EnergyGrid, first: int, stop: int) -> None:
        from scipy.special import ndtr

        self.here = slice(first, stop)
        self.step, self.areas = grid.step, grid.areas[first:stop]
        #: positions of the table are one step apart
        self.count = stop - first + 1
        edges = np.arange(self.count)
        places = (edges - edges[:, None]) * grid.step
        share = np.diff(ndtr(places / WIDTHS[:, None, None]), axis=-1)
        #: (widths, positions, stop - first) 1/eV, each of integral 1
        self.shapes = share / share.sum(axis=-1, keepdims=True) / self.areas

    def integral(self, densities: np.ndarray) -> np.ndarray:
        """(S,) shares of the sites that ``densities`` (S, n) have here."""
        return algebra.product(densities[:, self.here], self.areas)

    def redrawn(
        self,
        densities: np.ndarray,
        shares: np.ndarray,
        rng: np.random.Generator,
        data: Data | None = None,
    ) -> np.ndarray:
        """``densities`` (S, n) with ``shares`` (S,) of the sites here, drawn anew; without ``data`` from the prior."""
        redrawn, last = densities.copy(), self.count - 1.0
        redrawn[:, self.here] = 0.0
        uniforms = rng.random((len(redrawn), 4, MOST))
        peaks = kernels.peaks_drawn(uniforms, last, len(WIDTHS), THERE)
        if data is not None and len(redrawn):
            # the peaks in the posterior, with the densities elsewhere
            factor = data.factors[:, None]
            seen = values_of(redrawn, data.weights, data.matrices, data.offsets)
            base, scale = data.values - factor * seen, data.factors * shares
            # only combinations of the measurements that the peaks change
            here = np.moveaxis(data.matrices[:, :, self.here], 1, 2)
            rows = here.reshape(-1, here.shape[2])
            axes = algebra.row_axes(algebra.product(rows.T, rows), 0.0).T
            each = algebra.product(here, axes)
            tables = np.stack([algebra.product(self.shapes, one) for one in each])
            told = np.abs(tables).max(axis=(0, 1, 2)) > NEGLIGIBLE
            tables = np.ascontiguousarray(tables[..., told])
            base = algebra.product(base, axes[:, told])
            kt, widths = data.kt / self.step, WIDTHS / self.step
            samples = zip(peaks, data.weights, base, scale, strict=True)
            for some, row, *of in samples:
                table, uniforms = (
                    summed(row, tables),
                    rng.random((MOVES, 4 * MOST + 4)),
                )
                kernels.peaks_moved(some, *of, table, kt, widths, THERE, uniforms)
        for density, share, each in zip(redrawn, shares, peaks, strict=True):
            density[self.here] = share * kernels.of_peaks(each, self.shapes)
        return redrawn


def redrawn_outside(
    grid: EnergyGrid,
    seen: np.ndarray,
    densities: np.ndarray,
    rng: np.random.Generator,
    data: Data | None = None,
) -> np.ndarray:
    """``densities`` (S, n), most of which get the sites below and above all energies ``seen`` (n,) in peaks.

    Those below keep their share; all that are missing to 1 lie above. Without ``data``, peaks are those of the prior.
    """
    inside = np.flatnonzero(seen) if seen.any() else np.zeros(1, dtype=np.int64)
    chosen = np.flatnonzero(rng.random(len(densities)) >= SMOOTH)
    redrawn, some = densities.copy(), densities[chosen]
    if data is not None:
        weights, factors = data.weights[chosen], data.factors[chosen]
        data = data._replace(weights=weights, factors=factors)
    if inside[0]:
        below = Hidden(grid, 0, int(inside[0]))
        some = below.redrawn(some, below.integral(some), rng, data)
    above = Hidden(grid, int(inside[-1]) + 1, grid.count)
    left = np.maximum(
        1 - algebra.product(some, grid.areas) + above.integral(some), 0.0
    )
    redrawn[chosen] = above.redrawn(some, left, rng, data)
    return redrawn
