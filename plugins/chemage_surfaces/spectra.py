"""The power spectral density of a surface in logarithmic bins, and power laws fitted to it.

The density of each wave vector of a Gaussian surface is exponentially distributed. The mean over a bin of N independent
wave vectors is a Gamma variate, the logarithm of which has the mean ln C + ψ(N) − ln N and the variance ψ'(N). Bins
therefore enter with the weight 1/ψ'(N), about N, and those far from the fit with less (Huber), so that a line of
interference or a filter of the instrument does not decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import fft as sfft
from scipy.integrate import trapezoid
from scipy.special import digamma, polygamma

from chemage import InputError, Surface
from chemage.plugin import roughness, threads
from chemage_surfaces._maps import Floats
from chemage_surfaces.steps import hann, trend

#: bins of the density per factor of e in q
BINS = 8
#: standard deviations beyond which a bin counts less
ROBUST = 2.0
#: share of independent wave vectors under a Hann window along both axes: (3/8)⁴/(35/128)², the inverse of Σw⁴N/(Σw²)²
HANN_SHARE = (0.375**2 / (35 / 128)) ** 2
#: a density that falls by this factor from one bin to the next has been cut off
CUT = 1e-3
#: bins that a fit needs
FEWEST_BINS = 4
#: a roll-off must lower the loss of the fit by this, about two standard deviations, else there is none
SIGNIFICANT = 4.0
#: bins of the power law beyond the roll-off
FEWEST = 5
#: periods along an axis up to which waves of an image that does not repeat are left out: offsets between scan lines,
#: their drift and bow, and what a Hann window makes of them, are there
CROSS = 2
#: waves beside a periodic one that it fills under a Hann window
NEAR = 2
#: directions between 0 and π, and the χ² per direction from which the density differs between them
DIRECTIONS, DIFFERS = 24, 1.8


@dataclass(frozen=True)
class PowerLaw:
    """C(q) = density·(q/at)**(-2-2·hurst), q in 1/nm; errors are standard errors."""

    hurst: float
    hurst_error: float
    density: float
    #: relative
    density_error: float
    at: float
    #: χ² per degree of freedom
    misfit: float

    def __call__(self, q: Floats | float) -> Floats:
        return self.density * (np.asarray(q) / self.at) ** (-2.0 - 2.0 * self.hurst)


def _weighted(
    design: Floats, values: Floats, variance: Floats
) -> tuple[Floats, Floats, float]:
    """Robust weighted least squares: parameters, their covariance, and the mean of Huber's loss as χ² per degree of
    freedom."""
    weight = 1 / variance
    fit: Any = np.zeros(design.shape[1])
    normal = np.eye(design.shape[1])
    for _ in range(50):
        normal = (design * weight[:, None]).T @ design
        new: Any = np.linalg.solve(normal, design.T @ (weight * values))
        away = np.abs(values - design @ new) / np.sqrt(variance)
        weight = np.minimum(1.0, ROBUST / np.maximum(away, 1e-300)) / variance
        settled = (np.abs(new - fit) <= 1e-12 + 1e-12 * np.abs(fit)).all()
        fit = new
        if settled:
            break
    away = np.abs(values - design @ fit) / np.sqrt(variance)
    loss = np.where(away <= ROBUST, away**2, 2 * ROBUST * away - ROBUST**2).sum()
    misfit = float(loss / max(len(values) - design.shape[1], 1))
    covariance: Any = np.linalg.inv(normal) * max(misfit, 1.0)
    return fit, covariance, misfit


def wavenumbers(shape: tuple[int, int], pixel_size: float) -> Floats:
    """|q| of the half spectrum, 1/nm, (nx, ny//2 + 1)."""
    qx = 2 * np.pi * np.fft.fftfreq(shape[0], pixel_size)
    qy = 2 * np.pi * np.fft.rfftfreq(shape[1], pixel_size)
    return np.hypot(qx[:, None], qy[None, :])


@dataclass(frozen=True)
class Modes:
    """The density of each wave vector of a surface from the period to the Nyquist wavenumber."""

    #: wavenumber (1/nm) and direction (radians from x)
    q: Floats
    angle: Floats
    #: nm⁴
    density: Floats
    #: 1, or 1/2 where the conjugate is there as well
    weight: Floats
    #: independent wave vectors of each
    share: float
    #: where bins begin, 1/nm
    lowest: float

    @classmethod
    def of(cls, surface: Surface, waves: Floats | None = None) -> Modes:
        """Those of ``surface``, without wave vectors beside ``waves`` (n, 2), 1/nm.

        Of a surface that is not periodic the least-squares plane is subtracted, and it is tapered with a Hann window,
        which correlates neighbouring wave vectors; waves of up to two periods along an axis are left out.
        """
        heights = surface.heights.astype(np.float64)
        if not surface.periodic:
            heights = hann(heights - trend(heights, 1))
        nx, ny = heights.shape
        side = surface.pixel_size
        spectrum: Any = sfft.rfft2(heights, workers=threads.available())
        power = (spectrum.real**2 + spectrum.imag**2) * (side**2 / heights.size)
        q = wavenumbers((nx, ny), side)
        # conjugate pairs are both in the first column
        weight = np.broadcast_to(0.5 * roughness.multiplicity(ny), power.shape)
        nyquist = math.pi / side
        # a window spreads the mean and the trend over the first two waves
        lowest = (
            (1.0 if surface.periodic else 2.5) * 2 * math.pi / (max(nx, ny) * side)
        )
        inside = (q >= lowest * (1 - 1e-9)) & (q < nyquist * (1 - 1e-9))
        if not surface.periodic:
            inside[np.abs(np.fft.fftfreq(nx, 1 / nx)) <= CROSS + 0.5] = False
            inside[:, : CROSS + 1] = False
        for x, y in (
            ()
            if waves is None
            else np.rint(waves / (2 * math.pi) * side * (nx, ny))
            .astype(int)
            .tolist()
        ):
            for i, j in ((x, y), (-x, -y)):
                columns = slice(max(j - NEAR, 0), max(j + NEAR + 1, 0))
                inside[np.arange(i - NEAR, i + NEAR + 1) % nx, columns] = False
        if not inside.any():
            raise InputError(f"{surface!r} has too few pixels for a power spectrum")
        qx, qy = np.fft.fftfreq(nx)[:, None], np.fft.rfftfreq(ny)[None, :]
        return cls(
            q[inside],
            np.arctan2(*np.broadcast_arrays(qy, qx))[inside],
            power[inside],
            weight[inside],
            1.0 if surface.periodic else HANN_SHARE,
            lowest,
        )

    def binned(self) -> Binned:
        """The mean densities in bins of q."""
        which = np.floor(BINS * np.log(self.q / self.lowest) + 1e-6).astype(
            np.int64
        )
        count = np.bincount(which, self.weight)
        filled = count > 0
        # the wavenumber at which a density of a typical slope has the mean of the bin
        slope = 3.5
        mean_q = np.bincount(which, self.weight * self.q**-slope)[filled]
        mean_q = (mean_q / count[filled]) ** (-1 / slope)
        density = (
            np.bincount(which, self.weight * self.density)[filled] / count[filled]
        )
        return Binned(mean_q, density, np.maximum(count[filled] * self.share, 0.5))

    def directions(self, lowest: float, highest: float) -> Floats:
        """(DIRECTIONS,) the density by direction over its mean, from 0 on in steps of π/DIRECTIONS, between two
        wavenumbers (1/nm); ones where it does not differ by more than chance."""
        part = (self.q >= lowest) & (self.q <= highest)
        mean = self.binned().at(self.q[part])
        which = (
            np.rint(self.angle[part] / math.pi * DIRECTIONS).astype(int)
            % DIRECTIONS
        )
        weight = self.weight[part]
        count = np.maximum(np.bincount(which, weight, DIRECTIONS), 1e-300)
        ratio = (
            np.bincount(which, weight * self.density[part] / mean, DIRECTIONS)
            / count
        )
        error = polygamma(1, np.maximum(count * self.share, 0.5))
        logs = np.log(np.maximum(ratio, 1e-300))
        chance = float(np.average(logs**2 / error))
        if not chance > DIFFERS:
            return np.ones(DIRECTIONS)
        found = np.exp((1 - 1 / chance) * logs)
        return found / found.mean()


@dataclass(frozen=True)
class Binned:
    """The density of a surface in logarithmic bins: wavenumber (1/nm), density (nm⁴), independent wave vectors."""

    q: Floats
    density: Floats
    modes: Floats

    def part(self, lowest: float, highest: float) -> Binned:
        """The bins with lowest <= q <= highest."""
        inside = (self.q >= lowest) & (self.q <= highest)
        return Binned(self.q[inside], self.density[inside], self.modes[inside])

    def at(self, q: Floats) -> Floats:
        """The density between the bins, nm⁴."""
        logs = np.log(np.maximum(self.density, 1e-300))
        return np.exp(np.interp(np.log(q), np.log(self.q), logs))

    def first(self, count: int) -> Binned:
        """The first ``count`` bins."""
        return Binned(self.q[:count], self.density[:count], self.modes[:count])

    @classmethod
    def of(cls, surface: Surface) -> Binned:
        """The density of ``surface`` in narrow bins, from the period to the Nyquist wavenumber: see :class:`Modes`."""
        return Modes.of(surface).binned()

    @classmethod
    def together(cls, parts: Sequence[Binned]) -> Binned:
        """The bins of several surfaces, by their wavenumbers."""
        columns = np.concatenate(
            [np.stack([part.q, part.density, part.modes]) for part in parts], axis=1
        )
        return cls(*columns[:, np.argsort(columns[0], kind="stable")])

    def rolls(self, count: int) -> Floats:
        """Wavenumbers at which a roll-off is tried."""
        return np.exp(
            np.linspace(math.log(self.q[0]), math.log(self.q[-FEWEST]), count)
        )

    def logs(self) -> tuple[Floats, Floats, float]:
        """Logarithms of the densities without their bias, their variances, and the wavenumber in the middle of them."""
        variance: Any = polygamma(1, self.modes)
        bias: Any = digamma(self.modes)
        values: Any = np.log(self.density) - bias + np.log(self.modes)
        return (
            values,
            variance,
            math.exp(float(np.average(np.log(self.q), weights=1 / variance))),
        )

    @property
    def rms(self) -> float:
        """rms height of the waves in the bins, nm: h² = ∫ C q dq/(2π)."""
        return math.sqrt(
            float(trapezoid(self.density * self.q**2, np.log(self.q)))
            / (2 * math.pi)
        )

    @property
    def cut(self) -> float | None:
        """The highest q before a sudden end of the spectrum; None if there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            drops = np.nonzero(~(self.density[1:] > CUT * self.density[:-1]))[0]
        return float(self.q[drops[0]]) if drops.size else None

    def power_law(self, roll: float = 0.0) -> PowerLaw:
        """Fit Hurst exponent and density to all bins; below ``roll`` (1/nm) the density is that at ``roll``.

        Raises
        ------
        ValueError
            There are too few bins, or some are empty of power.
        """
        if len(self.q) < FEWEST_BINS:
            raise ValueError(
                f"only {len(self.q)} bins of wavenumbers; fit a wider range"
            )
        if not (self.density > 0).all():
            raise ValueError("the spectrum is zero in this range")
        values, variance, at = self.logs()
        x = np.log(np.maximum(self.q, roll) / at)
        design = np.stack([np.ones_like(x), -2 * x], axis=1)
        fit, covariance, misfit = _weighted(design, values + 2 * x, variance)
        return PowerLaw(
            hurst=float(fit[1]),
            hurst_error=math.sqrt(covariance[1, 1]),
            density=math.exp(float(fit[0])),
            density_error=math.sqrt(covariance[0, 0]),
            at=at,
            misfit=misfit,
        )

    def rolled(self) -> tuple[float | None, tuple[float, float] | None, PowerLaw]:
        """The roll-off of the best fit (1/nm) with its interval, both None without one; and the power law beyond."""
        without = self.power_law()
        candidates = self.rolls(12 * len(self.q))
        laws = [self.power_law(roll=float(roll)) for roll in candidates]
        loss = np.array([law.misfit for law in laws]) * max(len(self.q) - 2, 1)
        best = int(np.argmin(loss))
        allowed = candidates[loss <= loss[best] + max(laws[best].misfit, 1.0)]
        if without.misfit * max(len(self.q) - 2, 1) - loss[
            best
        ] < SIGNIFICANT * max(laws[best].misfit, 1.0):
            return None, None, without
        return (
            float(candidates[best]),
            (float(allowed[0]), float(allowed[-1])),
            laws[best],
        )
