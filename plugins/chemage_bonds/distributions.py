"""Distributions of barriers: uniform, normal with or without bounds, a tabulated density, or samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, PrivateAttr, model_validator

from chemage.plugin import (
    Barriers,
    Energy,
    FilePath,
    StoreError,
    Unit,
    array_in,
    tables,
)


def doubles(value: Any, unit: str = "") -> Doubles:
    """``value`` as an array of float64, in ``unit`` where it carries a unit; masked values are refused."""
    return np.asarray(array_in(value, unit), dtype=np.float64)


class Gaussian(Barriers):
    """Normal distribution with ``mean`` and ``std``, conditioned on lying between ``lower`` and ``upper``.

    Truncation is exact, neither by clipping nor by rejection, in the far tails too: quantiles are computed from the
    logarithms of both tail probabilities. With ``std`` 0 every barrier equals ``mean``.
    """

    kind = "gaussian"

    mean: Energy
    """mean of the normal distribution before truncation, eV"""
    std: Annotated[Energy, Unit("eV", ge=0, le=1e300)]
    """standard deviation of the normal distribution before truncation, eV; 0: all barriers are equal"""
    lower: Energy | None = None
    """lower bound of the barriers, eV; default: none"""
    upper: Energy | None = None
    """upper bound of the barriers, eV; default: none"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        low, high = self._bounds()
        if not low < high:
            raise ValueError(
                f"upper = {high:g} eV: not above lower = {low:g} eV; swap or widen them"
            )
        if self.std == 0 and not low <= self.mean <= high:
            raise ValueError(
                f"mean = {self.mean:g} eV: outside {low:g} to {high:g} eV, and with std = 0 no barrier is inside"
            )
        return self

    def _bounds(self) -> tuple[float, float]:
        low = -math.inf if self.lower is None else self.lower
        return low, math.inf if self.upper is None else self.upper

    def _cuts(self) -> tuple[float, float]:
        """The bounds in standard deviations from the mean; std > 0."""
        low, high = self._bounds()
        with np.errstate(over="ignore"):
            a, b = np.subtract([low, high], self.mean) / self.std
        return float(a), float(b)

    def _point(self) -> float | None:
        """The barrier if all are equal to double precision, or None.

        More than 1e8 standard deviations from the mean, the density beyond a bound decays within its rounding error.
        """
        if self.std == 0:
            return self.mean
        a, b = self._cuts()
        if a > 1e8:
            return self.lower
        return self.upper if b < -1e8 else None

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        from scipy import special

        u = doubles(uniform)
        point = self._point()
        if point is not None:
            return np.full(u.shape, point)
        low, high = self._bounds()
        if math.isinf(low) and math.isinf(high):
            return self.mean + self.std * special.ndtri(u)
        a, b = self._cuts()
        # Both tails are sums of positive terms, Φ(x) = (1 − u)Φ(a) + uΦ(b) and likewise 1 − Φ(x): no cancellation.
        with np.errstate(divide="ignore"):
            left, right = np.log1p(-u), np.log(u)
        below = np.logaddexp(
            left + special.log_ndtr(a), right + special.log_ndtr(b)
        )
        above = np.logaddexp(
            left + special.log_ndtr(-a), right + special.log_ndtr(-b)
        )
        lower_half = below < above
        x = special.ndtri_exp(np.where(lower_half, below, above))
        return np.clip(
            self.mean + self.std * np.where(lower_half, x, -x), low, high
        )

    def density(self, energy: np.ndarray) -> np.ndarray:
        e = doubles(energy, "eV")
        point = self._point()
        if point is not None:
            return np.where(e == point, np.inf, 0.0)
        low, high = self._bounds()
        with np.errstate(over="ignore", under="ignore"):
            z = (e - self.mean) / self.std
            log_density = -0.5 * z * z - (
                math.log(self.std) + 0.5 * math.log(2 * math.pi) + self._log_share()
            )
            return np.where((e >= low) & (e <= high), np.exp(log_density), 0.0)

    def _log_share(self) -> float:
        """Logarithm of the probability that the normal distribution assigns to the interval between the bounds."""
        from scipy import special

        a, b = self._cuts()
        if (b - a) * max(1.0, abs(a), abs(b)) < 1e-5:
            # so narrow that differences of the two tails cancel, and that the midpoint is exact to 1e-11
            return (
                math.log(b - a) - 0.125 * (a + b) ** 2 - 0.5 * math.log(2 * math.pi)
            )
        if a <= 0 <= b:
            return math.log(
                0.5
                * (special.erf(b / math.sqrt(2)) - special.erf(a / math.sqrt(2)))
            )
        if a > 0:
            a, b = -b, -a
        near, far = float(special.log_ndtr(b)), float(special.log_ndtr(a))
        return near + math.log(-math.expm1(far - near))


class Uniform(Barriers):
    """Constant density between ``lower`` and ``upper``."""

    kind = "uniform"

    lower: Energy
    """lowest barrier, eV"""
    upper: Energy
    """highest barrier, eV"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.upper > self.lower:
            raise ValueError(
                f"upper = {self.upper:g} eV: not above lower = {self.lower:g} eV; swap or widen them"
            )
        return self

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        u = doubles(uniform)
        return np.clip(
            self.lower * (1.0 - u) + self.upper * u, self.lower, self.upper
        )

    def density(self, energy: np.ndarray) -> np.ndarray:
        e = doubles(energy, "eV")
        return np.where(
            (e >= self.lower) & (e <= self.upper),
            1.0 / (self.upper - self.lower),
            0.0,
        )


Doubles = NDArray[np.float64]


def _listed(value: Any) -> Any:
    return (
        np.asarray(value).ravel().tolist()
        if isinstance(value, np.ndarray)
        else value
    )


def _named_unit(value: Any) -> Any:
    """A name alone is read as one of that unit: "meV" as "1 meV"."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_listed)]


def parse_columns(text: str, source: str) -> np.ndarray:
    """The numbers of a text table, (rows, columns).

    Columns are separated by commas, semicolons, tabs or blanks; text after ``#`` is a comment; one line of column names
    before the numbers is skipped.

    Raises
    ------
    StoreError
        ``source`` holds no numbers, something that is not a number, or rows of different lengths; names the line.
    """
    lines = tables.data_lines(text)
    first = lines[0][1].replace(",", " ").replace(";", " ").split() if lines else []
    try:
        found = [float(word) for word in first]
    except ValueError:
        found = []
    if not found:
        lines = lines[1:]
    if not lines:
        raise StoreError(
            f"{source} holds no numbers; give one column (samples) or two (energy, density)"
        )
    rows = tables.numbers(lines, source, tables.separator_of(lines[0][1]))
    for (number, line), row in zip(lines, rows, strict=True):
        if not np.isfinite(row).all():
            raise StoreError(
                f"{source}, line {number}: {line[:60].strip()!r} holds a value that is not finite"
            )
    return rows


def _finite(name: str, values: Doubles) -> None:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise ValueError(
            f"{name}[{bad[0]}] = {values[bad[0]]} is not finite; remove or replace it"
        )


class PiecewiseLinearDensity:
    """The distribution whose density joins the given points by straight lines and is zero outside them.

    Parameters
    ----------
    energies
        (m,) strictly increasing, m ≥ 2; any unit, which is then also the unit of :meth:`quantile`.
    weights
        density at each energy, (m,) ≥ 0, at least one positive; it is normalised.

    Raises
    ------
    ValueError
        An entry is wrong; the message names it.
    """

    def __init__(
        self,
        energies: ArrayLike | Sequence[float],
        weights: ArrayLike | Sequence[float],
    ) -> None:
        x = np.array(energies, dtype=np.float64)
        p = np.array(weights, dtype=np.float64)
        if x.ndim != 1 or p.shape != x.shape or x.size < 2:
            raise ValueError(
                f"energies {x.shape} and weights {p.shape}: give two lists of equal length, at least two points"
            )
        _finite("energies", x)
        _finite("weights", p)
        if (bad := np.flatnonzero(np.diff(x) <= 0)).size:
            at = int(bad[0]) + 1
            raise ValueError(
                f"energies[{at}] = {x[at]:g} does not exceed {x[at - 1]:g} before it; sort the table"
            )
        if np.any(p < 0):
            at = int(np.flatnonzero(p < 0)[0])
            raise ValueError(
                f"weights[{at}] = {p[at]:g} is negative; a probability density must be at least 0"
            )
        if not np.any(p > 0):
            raise ValueError(
                "weights: zero everywhere; at least one value must be positive"
            )
        # scaled before it is summed, so that the sum neither overflows nor underflows
        p /= p.max()
        span = x[-1] - x[0]
        if not np.isfinite(span):
            raise ValueError("energies: their span overflows; give energies in eV")
        widths = np.diff(x) / span
        areas = 0.5 * widths * (p[1:] + p[:-1])
        total = areas.sum()
        full = areas > 0
        self._left, self._right = x[:-1][full], x[1:][full]
        self._area = areas[full] / total
        self._rise = p[:-1][full] / (p[:-1][full] + p[1:][full])
        cumulative = np.concatenate([[0.0], np.cumsum(self._area)])
        self._cumulative = cumulative / cumulative[-1]
        self.energies: Doubles = x
        with np.errstate(
            over="ignore"
        ):  # over a span of nearly nothing the density is that of a point mass
            self.density_values: Doubles = p / total / span

    def quantile(self, uniform: np.ndarray) -> Doubles:
        """Energies at ``uniform`` in [0, 1], same shape, non-decreasing to within rounding.

        At a part t of an interval the share w of its area solves 2at + (b − a)t² = w, where a and b = 1 − a are the
        relative densities at its ends. It is solved from the end of lower density, in the form whose terms are all
        positive, so that there is no cancellation where the density goes to zero.
        """
        u = doubles(uniform)
        interval = np.clip(
            np.searchsorted(self._cumulative, u, side="right") - 1,
            0,
            self._area.size - 1,
        )
        a = self._rise[interval]
        below = np.clip(
            (u - self._cumulative[interval]) / self._area[interval], 0.0, 1.0
        )
        above = np.clip(
            (self._cumulative[interval + 1] - u) / self._area[interval], 0.0, 1.0
        )
        rising = a <= 0.5
        share = np.where(rising, below, above)
        low = np.where(rising, a, 1.0 - a)
        root = low + np.sqrt(low * low + (1.0 - 2.0 * low) * share)
        part = np.divide(share, root, out=np.zeros_like(share), where=root > 0)
        left, right = self._left[interval], self._right[interval]
        width = right - left
        return np.clip(
            np.where(rising, left + part * width, right - part * width), left, right
        )

    def density(self, energy: np.ndarray) -> Doubles:
        """Probability density at ``energy``, per unit of energy, same shape."""
        e = doubles(energy, "eV")
        return np.interp(e, self.energies, self.density_values, left=0.0, right=0.0)


class EmpiricalQuantile:
    """The distribution of a sample: its n ordered values, joined by straight lines at the probabilities i/(n − 1).

    Between two neighbouring values the density is constant; repeated values are point masses (density ``inf``). A
    single value is a point mass.

    Raises
    ------
    ValueError
        The sample is empty or holds a value that is not finite.
    """

    def __init__(self, samples: ArrayLike | Sequence[float]) -> None:
        values = np.sort(np.array(samples, dtype=np.float64), axis=None)
        if values.size == 0:
            raise ValueError("samples: none given; give at least one barrier")
        _finite("samples", values)
        self.values: Doubles = values

    def quantile(self, uniform: np.ndarray) -> Doubles:
        """Energies at ``uniform`` in [0, 1], same shape, non-decreasing to within rounding."""
        position = doubles(uniform) * (self.values.size - 1)
        lower = np.minimum(position.astype(np.int64), max(self.values.size - 2, 0))
        upper = np.minimum(lower + 1, self.values.size - 1)
        part = position - lower
        left, right = self.values[lower], self.values[upper]
        return np.clip(left * (1.0 - part) + right * part, left, right)

    def density(self, energy: np.ndarray) -> Doubles:
        """Probability density at ``energy``, per unit of energy, same shape."""
        e = doubles(energy, "eV")
        values = self.values
        n = values.size
        first = np.searchsorted(values, e, side="left")
        after = np.searchsorted(values, e, side="right")
        result = np.zeros(e.shape)
        if n > 1:
            upper = np.clip(after, 1, n - 1)
            gap = values[upper] - values[upper - 1]
            inside = (e >= values[0]) & (e <= values[-1])
            with np.errstate(over="ignore"):
                np.divide(1.0 / (n - 1), gap, out=result, where=inside & (gap > 0))
        result[after - first > 1 if n > 1 else after - first > 0] = np.inf
        return result


class Tabulated(Barriers):
    """A tabulated density with linear interpolation, or the distribution of samples.

    Give ``energies`` with ``weights``, or ``samples``, or a ``path`` to a text file with two columns (energies and
    weights) or one (samples). The file is read at once and its numbers replace ``path``, so that a stored result
    contains the distribution itself. Samples are not smoothed: their ordered values are joined by straight lines at the
    probabilities i/(n − 1), so barriers lie between the smallest and the largest.
    """

    kind = "tabulated"

    energies: Numbers | None = None
    """energies of the table, strictly increasing, in ``energy_unit``"""
    weights: Numbers | None = None
    """probability density at ``energies``, ≥ 0, in any unit; it is normalised"""
    samples: Numbers | None = None
    """barriers in ``energy_unit``, in any order, for example from molecular dynamics"""
    path: FilePath | None = None
    """text file with ``energies`` and ``weights``, or with ``samples``"""
    energy_unit: Annotated[Any, Unit("eV", gt=0), BeforeValidator(_named_unit)] = (
        1.0
    )
    """unit of the given energies: its name, such as "meV", or its value in eV; default: 1 eV"""

    _distribution: PiecewiseLinearDensity | EmpiricalQuantile = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _read(cls, options: Any) -> Any:
        if not isinstance(options, dict) or not isinstance(
            path := options.get("path"), str | Path
        ):
            return options
        if any(
            options.get(name) is not None
            for name in ("energies", "weights", "samples")
        ):
            return options  # refused below
        columns = parse_columns(tables.read_text(path), str(path)).T
        if len(columns) > 2:
            raise ValueError(
                f"path: {path} has {len(columns)} columns; give one (samples) or two (energies, weights)"
            )
        names = ("samples",) if len(columns) == 1 else ("energies", "weights")
        rest = {name: value for name, value in options.items() if name != "path"}
        return rest | dict(zip(names, columns, strict=True))

    @model_validator(mode="after")
    def _build(self) -> Self:
        if (
            self.samples is not None
            and self.energies is self.weights is self.path is None
        ):
            self._distribution = EmpiricalQuantile(
                np.array(self.samples) * self.energy_unit
            )
        elif (
            self.energies is not None
            and self.weights is not None
            and self.samples is self.path is None
        ):
            self._distribution = PiecewiseLinearDensity(
                np.array(self.energies) * self.energy_unit, self.weights
            )
        else:
            names = [
                name
                for name in ("energies", "weights", "samples", "path")
                if getattr(self, name) is not None
            ]
            raise ValueError(
                f"{', '.join(names) or 'nothing'} given; give energies and weights, or samples, or a path"
            )
        return self

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return self._distribution.quantile(uniform)

    def density(self, energy: np.ndarray) -> np.ndarray:
        return self._distribution.density(energy)
