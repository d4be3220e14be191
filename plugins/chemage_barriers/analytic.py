"""Distributions of barriers in closed form: uniform, and normal with or without bounds."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from chemage.plugin import Barriers, Energy, Unit


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
            raise ValueError(f"upper = {high:g} eV: not above lower = {low:g} eV; swap or widen them")
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

        u = np.asarray(uniform, dtype=np.float64)
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
        below = np.logaddexp(left + special.log_ndtr(a), right + special.log_ndtr(b))
        above = np.logaddexp(left + special.log_ndtr(-a), right + special.log_ndtr(-b))
        lower_half = below < above
        x = special.ndtri_exp(np.where(lower_half, below, above))
        return np.clip(self.mean + self.std * np.where(lower_half, x, -x), low, high)

    def density(self, energy: np.ndarray) -> np.ndarray:
        e = np.asarray(energy, dtype=np.float64)
        point = self._point()
        if point is not None:
            return np.where(e == point, np.inf, 0.0)
        low, high = self._bounds()
        with np.errstate(over="ignore", under="ignore"):
            z = (e - self.mean) / self.std
            log_density = -0.5 * z * z - (math.log(self.std) + 0.5 * math.log(2 * math.pi) + self._log_share())
            return np.where((e >= low) & (e <= high), np.exp(log_density), 0.0)

    def _log_share(self) -> float:
        """Logarithm of the probability that the normal distribution assigns to the interval between the bounds."""
        from scipy import special

        a, b = self._cuts()
        if (b - a) * max(1.0, abs(a), abs(b)) < 1e-5:
            # so narrow that differences of the two tails cancel, and that the midpoint is exact to 1e-11
            return math.log(b - a) - 0.125 * (a + b) ** 2 - 0.5 * math.log(2 * math.pi)
        if a <= 0 <= b:
            return math.log(0.5 * (special.erf(b / math.sqrt(2)) - special.erf(a / math.sqrt(2))))
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
            raise ValueError(f"upper = {self.upper:g} eV: not above lower = {self.lower:g} eV; swap or widen them")
        return self

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        u = np.asarray(uniform, dtype=np.float64)
        return np.clip(self.lower * (1.0 - u) + self.upper * u, self.lower, self.upper)

    def density(self, energy: np.ndarray) -> np.ndarray:
        e = np.asarray(energy, dtype=np.float64)
        return np.where((e >= self.lower) & (e <= self.upper), 1.0 / (self.upper - self.lower), 0.0)
