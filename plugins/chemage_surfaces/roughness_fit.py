"""Fits to the power spectral density of heights: a power law, and the parameters of `self-affine` surfaces like it.

An image is trusted down to the wavelength below which the tip, white noise or the end of the spectrum decides.

The density of each wave vector of a Gaussian surface is exponentially distributed. The mean over a bin of N independent
wave vectors is a Gamma variate, the logarithm of which has the mean ln C + ψ(N) − ln N and the variance ψ'(N). Bins
therefore enter with the weight 1/ψ'(N), about N, and those far from the fit with less (Huber), so that a line of
interference or a filter of the instrument does not decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import fft as sfft
from scipy.integrate import trapezoid
from scipy.optimize import least_squares
from scipy.special import digamma, polygamma

from chemage import InputError, Surface
from chemage.plugin import checked_count, convert, threads
from chemage_surfaces._maps import Floats
from chemage_surfaces.generated import SelfAffine
from chemage_surfaces.measures import measure
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
#: roll-offs that are tried where noise is fitted
ROLLS = 12
#: bins of the power law beyond the roll-off
FEWEST = 5
#: periods along an axis up to which waves of an image that does not repeat are left out: offsets between scan lines,
#: their drift and bow, and what a Hann window makes of them, are there
CROSS = 2
#: noise of this share of the density of the surface ends what is trusted; and its relative uncertainty, as noise is
#: not white, and waves shorter than two pixels look like it
NOISE_SHARE, NOISE_DOUBT = 0.25, 0.5
#: relative uncertainty of the correction for a tip of known and of estimated radius
KNOWN_TIP, ESTIMATED_TIP = 0.35, 0.6
#: share of the Nyquist wavenumber up to which an image is used: heights are samples, and waves shorter than two pixels
#: appear as longer ones
SAMPLED = 0.7
#: why a spectrum ends where nothing but its pixels ends it
TO_PIXELS = "two pixels"
#: χ² per degree of freedom from which a fit is doubtful, and from which it makes no surface
DOUBTFUL, FAILED = 3.0, 10.0


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

    def first(self, count: int) -> Binned:
        """The first ``count`` bins."""
        return Binned(self.q[:count], self.density[:count], self.modes[:count])

    @property
    def cut(self) -> float | None:
        """The highest q before a sudden end of the spectrum; None if there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            drops = np.nonzero(~(self.density[1:] > CUT * self.density[:-1]))[0]
        return float(self.q[drops[0]]) if drops.size else None


@dataclass(frozen=True)
class PowerLaw:
    """C(q) = density·(q/at)**(-2-2·hurst), fitted between two wavenumbers (1/nm); errors are standard errors."""

    hurst: float
    hurst_error: float
    density: float
    #: relative
    density_error: float
    at: float
    lowest: float
    highest: float
    #: χ² per degree of freedom
    misfit: float

    def __call__(self, q: Floats | float) -> Floats:
        return self.density * (np.asarray(q) / self.at) ** (-2.0 - 2.0 * self.hurst)


def binned(surface: Surface) -> Binned:
    """The density of ``surface`` in narrow bins, from the period to the Nyquist wavenumber.

    Of a surface that is not periodic the least-squares plane is subtracted, and it is tapered with a Hann window, which
    correlates neighbouring wave vectors; waves of up to two periods along an axis are left out.
    """
    heights = surface.heights.astype(np.float64)
    if not surface.periodic:
        heights = hann(heights - trend(heights, 1))
    nx, ny = heights.shape
    spectrum: Any = sfft.rfft2(heights, workers=threads.available())
    power = (spectrum.real**2 + spectrum.imag**2) * (surface.pixel_size**2 / heights.size)
    q = wavenumbers((nx, ny), surface.pixel_size)
    weight = np.full(power.shape, 1.0)
    weight[:, 0] = 0.5  # conjugate pairs are both in this column
    nyquist = math.pi / surface.pixel_size
    # a window spreads the mean and the trend over the first two waves
    lowest = (1.0 if surface.periodic else 2.5) * 2 * math.pi / (max(nx, ny) * surface.pixel_size)
    if ny % 2 == 0:
        weight[:, -1] = 0.5
    inside = (q >= lowest * (1 - 1e-9)) & (q < nyquist * (1 - 1e-9))
    if not surface.periodic:
        inside[np.abs(np.fft.fftfreq(nx, 1 / nx)) <= CROSS + 0.5] = False
        inside[:, : CROSS + 1] = False
    if not inside.any():
        raise InputError(f"{surface!r} has too few pixels for a power spectrum")
    q, power, weight = q[inside], power[inside], weight[inside]
    which = np.floor(BINS * np.log(q / lowest) + 1e-6).astype(np.int64)
    count = np.bincount(which, weight)
    filled = count > 0
    # the wavenumber at which a density of a typical slope has the mean of the bin
    slope = 3.5
    mean_q = (np.bincount(which, weight * q**-slope)[filled] / count[filled]) ** (-1 / slope)
    density = np.bincount(which, weight * power)[filled] / count[filled]
    return Binned(mean_q, density, np.maximum(count[filled] * (1.0 if surface.periodic else HANN_SHARE), 0.5))


def wavenumbers(shape: tuple[int, int], pixel_size: float) -> Floats:
    """|q| of the half spectrum, 1/nm, (nx, ny//2 + 1)."""
    qx = 2 * np.pi * np.fft.fftfreq(shape[0], pixel_size)
    qy = 2 * np.pi * np.fft.rfftfreq(shape[1], pixel_size)
    return np.hypot(qx[:, None], qy[None, :])


def _logs(data: Binned) -> tuple[Floats, Floats]:
    """Logarithms of the densities without their bias, and their variances."""
    variance: Any = polygamma(1, data.modes)
    bias: Any = digamma(data.modes)
    values: Any = np.log(data.density) - bias + np.log(data.modes)
    return values, variance


def _weighted(design: Floats, values: Floats, variance: Floats) -> tuple[Floats, Floats, float]:
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
        settled = np.allclose(new, fit, rtol=1e-12, atol=1e-12)
        fit = new
        if settled:
            break
    away = np.abs(values - design @ fit) / np.sqrt(variance)
    loss = np.where(away <= ROBUST, away**2, 2 * ROBUST * away - ROBUST**2).sum()
    misfit = float(loss / max(len(values) - design.shape[1], 1))
    covariance: Any = np.linalg.inv(normal) * max(misfit, 1.0)
    return fit, covariance, misfit


def fit_power_law(data: Binned, hurst: float | None = None, roll: float = 0.0) -> PowerLaw:
    """Fit Hurst exponent (unless given) and density to all bins of ``data``; below ``roll`` (1/nm) the density is that
    at ``roll``.

    Raises
    ------
    ValueError
        There are too few bins, or some are empty of power.
    """
    if len(data.q) < (FEWEST_BINS if hurst is None else 1):
        raise ValueError(f"only {len(data.q)} bins of wavenumbers; fit a wider range")
    if not (data.density > 0).all():
        raise ValueError("the spectrum is zero in this range")
    values, variance = _logs(data)
    at = math.exp(float(np.average(np.log(data.q), weights=1 / variance)))
    x = np.log(np.maximum(data.q, roll) / at)
    if hurst is None:
        design = np.stack([np.ones_like(x), -2 * x], axis=1)
        fit, covariance, misfit = _weighted(design, values + 2 * x, variance)
        exponent, error = float(fit[1]), math.sqrt(covariance[1, 1])
    else:
        fit, covariance, misfit = _weighted(np.ones((len(x), 1)), values + (2 + 2 * hurst) * x, variance)
        exponent, error = hurst, 0.0
    return PowerLaw(
        hurst=exponent,
        hurst_error=error,
        density=math.exp(float(fit[0])),
        density_error=math.sqrt(covariance[0, 0]),
        at=at,
        lowest=float(data.q[0]),
        highest=float(data.q[-1]),
        misfit=misfit,
    )


def _noise(data: Binned) -> float:
    """The density of white noise, nm⁴, fitted together with roll-off and power law; 0 where none is seen."""
    values, variance = _logs(data)
    at = math.exp(float(np.average(np.log(data.q), weights=1 / variance)))
    deviation = np.sqrt(variance)

    def fitted(roll: float) -> Any:
        x = np.log(np.maximum(data.q, roll) / at)

        def residuals(p: Floats) -> Floats:
            return (values - np.logaddexp(p[0] - (2 + 2 * p[1]) * x, p[2])) / deviation

        start = [float(np.interp(math.log(at), np.log(data.q), values)), 0.7, values[-1] - 1.5]
        bounds = ([-np.inf, -1.0, values[-1] - 12], [np.inf, 3.0, values[-1] + 1])
        return least_squares(residuals, start, loss="huber", f_scale=ROBUST, bounds=bounds)

    rolls = [0.0, *np.exp(np.linspace(math.log(data.q[0]), math.log(data.q[-FEWEST]), ROLLS))]
    best = min((fitted(roll) for roll in rolls), key=lambda one: one.cost)
    _, _, without = _rolled(data)
    degrees = max(len(data.q) - 3, 1)
    gain = without.misfit * max(len(data.q) - 2, 1) - 2 * best.cost
    return math.exp(best.x[2]) if gain > SIGNIFICANT * max(2 * best.cost / degrees, 1.0) else 0.0


@dataclass(frozen=True)
class Trusted:
    """The part of the spectrum of an image that the surface decides, with the effects of tip and noise corrected; and
    why it ends there."""

    data: Binned
    limit: str
    #: white noise, nm⁴, which was subtracted
    noise: float = 0.0
    #: radius of the tip, nm, given or estimated; 0: none
    radius: float = 0.0
    #: what was added to the logarithms of the densities, each with its relative uncertainty
    corrections: tuple[tuple[Floats, float], ...] = ()

    def without(self, which: int) -> Binned:
        """The data with a correction less by its uncertainty."""
        if which >= len(self.corrections):
            return self.data
        added, doubt = self.corrections[which]
        return replace(self.data, density=self.data.density * np.exp(-doubt * added))


def trusted(surface: Surface, resolution: float | None = None, tip_radius: float | None = None) -> Trusted:
    """What to trust of the spectrum of ``surface``: wavelengths above ``resolution`` (nm) if it is given; else above
    two pixels (three of an image that does not repeat), those that a tip has changed too much to correct, those at
    which white noise has 25 % of the density, and the end of the spectrum."""
    data, limit = binned(surface), TO_PIXELS
    if resolution is not None:
        return Trusted(data.part(0, 2 * math.pi / resolution), "as given")
    folded = np.zeros(len(data.q))
    if (cut := data.cut) is not None:
        # the last bin before the end is filled in part
        data, limit = data.part(0, cut * (1 - 1e-9)), "the spectrum ends"
    elif not surface.periodic:
        data, limit = data.part(0, SAMPLED * math.pi / surface.pixel_size), "waves shorter than two pixels"
        folded = _folded(data, math.pi / surface.pixel_size)
    measures = measure(surface.heights.astype(np.float64), (surface.pixel_size, surface.pixel_size))
    radius = measures.tip_radius() if tip_radius is None else tip_radius
    tip = measures.tip_share(radius, data.q) if radius else np.zeros(len(data.q))
    changed = np.nonzero(np.isinf(tip))[0]
    if changed.size:
        kept = int(changed[0])
        if kept < 2 * FEWEST and tip_radius is None:  # hardly a tip
            radius, tip = 0.0, np.zeros(len(data.q))
        else:
            data, tip, limit = data.first(kept), tip[:kept], "the tip"
    folded = folded[: len(data.q)]
    # folded waves are no noise
    plain = replace(data, density=data.density / (1 + folded))
    noise = _noise(plain) if len(data.q) >= 3 * FEWEST and (data.density > 0).all() else 0.0
    clean = data.density - noise
    noisy = np.nonzero(noise > NOISE_SHARE * clean)[0]
    kept = int(noisy[0]) if noisy.size else len(clean)
    share = clean[:kept] / data.density[:kept]
    if noise > 0 and kept >= 2 * FEWEST:
        data = Binned(data.q[:kept], clean[:kept], data.modes[:kept] * share**2)
        tip, limit = tip[:kept], "noise" if noisy.size else limit
    else:
        noise = 0.0
    folded = folded[: len(data.q)]
    corrections = [(tip, KNOWN_TIP if tip_radius else ESTIMATED_TIP), (-np.log1p(folded / 2), 1.0)]
    if noise:
        corrections.append((np.log(share), NOISE_DOUBT))
    data = replace(data, density=data.density * np.exp(tip) / (1 + folded / 2))
    return Trusted(data, limit, noise, radius, tuple(corrections))


def _folded(data: Binned, nyquist: float) -> Floats:
    """The share of the density that is of waves shorter than two pixels, if the power law went on: Σ C(|q + G|)/C(q)
    over the eight nearest reciprocal vectors G of the pixels, averaged over directions. An instrument that averages
    over its pixels has less of it, so that half is corrected."""
    law = fit_power_law(data.part(0, 0.5 * nyquist)) if (data.q < 0.5 * nyquist).sum() >= FEWEST_BINS else None
    if law is None or not math.isfinite(law.hurst):
        return np.zeros(len(data.q))
    angle = (np.arange(16) + 0.5) * math.pi / 32
    qx, qy = data.q[:, None] * np.cos(angle), data.q[:, None] * np.sin(angle)
    share = np.zeros(qx.shape)
    for i, j in ((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)):
        away = np.hypot(qx + 2 * i * nyquist, qy + 2 * j * nyquist)
        share += (away / data.q[:, None]) ** (-2 - 2 * min(max(law.hurst, 0.0), 1.0))
    return share.mean(axis=1)


@dataclass(frozen=True)
class RoughnessFit:
    """The spectrum of a surface as that of `self-affine`: constant up to the roll-off, then C(q) ∝ q^(−2−2H).

    Errors are standard errors of the fit, from the number of independent wave vectors; they contain the scatter of a
    single surface and no error of the instrument. Lengths are in nm.
    """

    hurst: float
    hurst_error: float
    #: wavelength of the roll-off; None: the power law goes on to the longest wavelength
    roll_off: float | None
    #: lower and upper end of the interval of one standard error
    roll_off_interval: tuple[float, float] | None
    #: shortest wavelength of the fit
    resolution: float
    #: C at this wavelength, nm⁴, and its relative standard error
    density: float
    density_error: float
    #: rms height and slope of the surface itself, with all its waves
    rms_height: float
    rms_slope: float
    #: sides of the surface in pixels, and edge of a pixel
    shape: tuple[int, int]
    pixel_size: float
    #: χ² per degree of freedom; far above 1: the surface is not self-affine
    misfit: float
    #: why the fit ends at its shortest wavelength
    limit: str = ""
    #: rms height of the white noise in the image, nm; 0: none is seen
    noise: float = 0.0
    #: radius of the tip, nm, given or estimated from valleys that are sharper than peaks; 0: none is seen
    tip_radius: float = 0.0
    #: the bins of the fit
    data: Binned | None = field(default=None, repr=False, compare=False)

    @property
    def fault(self) -> str:
        """Why no surface is made of this fit; empty where one can be."""
        if not 0 <= self.hurst <= 1:
            return (
                f"the spectrum falls with H = {self.hurst:.2f} ± {self.hurst_error:.2f}, which is not self-affine "
                "(0 to 1); give a resolution longer than what the instrument blurs"
            )
        if not self.misfit <= FAILED:
            return (
                f"χ² per degree of freedom is {self.misfit:.2g}, so that the spectrum is not that of a self-affine "
                "surface; give a resolution longer than what tip and noise decide, or align lines that are offset "
                '(lines = "differences")'
            )
        return ""

    def slope(self, longest: float, shortest: float) -> float:
        """rms slope of all waves between two wavelengths (nm) of the fitted spectrum: h'² = ∫ C q³ dq/(2π)."""
        q = np.geomspace(2 * math.pi / longest, 2 * math.pi / shortest, 4001)
        roll = 0.0 if self.roll_off is None else 2 * math.pi / self.roll_off
        at = 2 * math.pi / self.resolution
        density = self.density * (np.maximum(q, roll) / at) ** (-2 - 2 * self.hurst)
        return math.sqrt(float(trapezoid(density * q**4, np.log(q))) / (2 * math.pi))

    def maker(
        self,
        *,
        pixel_size: float | str | None = None,
        pixels: int | None = None,
        cutoff: float | str | None = None,
    ) -> SelfAffine:
        """A maker of surfaces like this one: `self-affine` with the fitted parameters.

        Parameters
        ----------
        pixel_size
            Edge of a pixel, nm, such as the spacing of the sites; None: that of the measured surface.
        pixels
            Pixels along each side; None: as many as make the longer side of the measured surface.
        cutoff
            Shortest wavelength, nm; None: that of the fit. A shorter one continues the power law.

        Raises
        ------
        InputError
            The grid cannot hold the cut-off, or the fit is none of a self-affine surface (``fault``).
        """
        if self.fault:
            raise InputError(f"no surface like this one: {self.fault}")
        side = self.pixel_size if pixel_size is None else convert(pixel_size, "nm")
        shortest = self.resolution if cutoff is None else convert(cutoff, "nm")
        if not (side > 0 and math.isfinite(side)):
            raise InputError.of("pixel_size", pixel_size, "is no length", "give nm above 0")
        count = round(max(self.shape) * self.pixel_size / side) if pixels is None else checked_count("pixels", pixels)
        longest = count * side
        if not 2 * side * (1 - 1e-9) <= shortest < longest:
            raise InputError(
                f"cutoff = {shortest:g} nm: a grid of {count} pixels of {side:g} nm holds wavelengths from "
                f"{2 * side:g} to {longest:g} nm; give a cutoff between them, or other pixels"
            )
        zeta = min(longest / shortest, count / 2)
        eta = 1.0 if self.roll_off is None else min(max(longest / self.roll_off, 1.0), zeta)
        return SelfAffine(
            pixels=(count, count),
            pixel_size=side,
            hurst=round(self.hurst, 4),
            zeta=float(f"{zeta:.6g}") if zeta < count / 2 else zeta,
            eta=float(f"{eta:.4g}"),
            rms_slope=float(f"{self.slope(longest, shortest):.4g}"),
        )

    def text(self) -> str:
        """What was found, one line each."""
        roll = "none: the power law goes on to the longest wavelength"
        if self.roll_off is not None and self.roll_off_interval is not None:
            low, high = self.roll_off_interval
            roll = f"{self.roll_off:.4g} nm ({low:.4g} to {high:.4g})"
        return "\n".join(
            [
                f"rms height          {self.rms_height:.4g} nm, of the image",
                f"rms slope           {self.rms_slope:.4g}, of the image",
                f"Hurst exponent      {self.hurst:.3f} ± {self.hurst_error:.3f}",
                f"roll-off            {roll}",
                f"shortest wavelength {self.resolution:.4g} nm" + (f" ({self.limit})" if self.limit else ""),
                *([f"white noise         {self.noise:.4g} nm rms"] if self.noise else []),
                *(
                    [f"tip radius          {self.tip_radius:.3g} nm, its effect is corrected"]
                    if self.tip_radius
                    else []
                ),
                f"χ² per degree of freedom {self.misfit:.2g}",
            ]
            + [f"warning: this is no good fit (above {DOUBTFUL:g}); the errors are enlarged by it"]
            * (self.misfit > DOUBTFUL)
        )


def section(maker: SelfAffine) -> str:
    """The section ``[surface]`` of a scene, TOML."""
    lines = ["[surface]", f'kind = "{maker.kind}"', f"pixels = {max(maker.pixels)}"]
    lines.append(f'pixel_size = "{maker.pixel_size:.10g} nm"')
    lines += [f"{name} = {getattr(maker, name):.10g}" for name in ("rms_slope", "hurst", "zeta", "eta")]
    return "\n".join([*lines, "seed = 1"])


def fit_roughness(
    surface: Surface | Sequence[Surface],
    *,
    resolution: float | str | None = None,
    tip_radius: float | str | None = None,
) -> RoughnessFit:
    """Fit Hurst exponent, roll-off and amplitude to the power spectral density of ``surface``, or of several images of
    one surface, at any magnifications, together.

    ``resolution`` is the shortest wavelength (nm) to use, such as the resolution of the instrument; by default each
    image is used as far as it can be trusted (:func:`trusted`), for which the radius of the tip (nm) may be given. The
    fit is one of least squares to logarithmic bins, each weighted by its number of independent wave vectors, and less
    if it is far from the fit (Huber); its errors are enlarged by the misfit, and so by the scatter between images.

    Raises
    ------
    InputError
        The spectrum has too few bins.
    """
    surfaces = [surface] if isinstance(surface, Surface) else list(surface)
    if not surfaces:
        raise InputError("surface: an empty list; give at least one image")
    shortest = None if resolution is None else convert(resolution, "nm")
    radius = None if tip_radius is None else convert(tip_radius, "nm")
    if radius is not None and not (radius > 0 and math.isfinite(radius)):
        raise InputError.of("tip_radius", tip_radius, "is no radius", "give nm above 0")
    parts = []
    for one in surfaces:
        if shortest is not None and not shortest >= 2 * one.pixel_size * (1 - 1e-9):
            raise InputError(
                f"resolution = {shortest:g} nm: shorter than two pixels, {2 * one.pixel_size:g} nm; give at least this"
            )
        part = trusted(one, shortest, radius)
        if len(part.data.q) < 2 * FEWEST or not (part.data.density > 0).all():
            raise InputError(
                f"{one!r}: its power spectrum has too few wavelengths for a fit"
                + (f" above those changed by the tip of {part.radius:.3g} nm" if part.limit == "the tip" else "")
                + "; give a larger image"
            )
        parts.append(part)
    data = _together([part.data for part in parts])
    roll, interval, law = _rolled(data)
    error = law.hurst_error
    for which in range(max(len(part.corrections) for part in parts)):  # as much as each is uncertain
        others = [part.without(which) for part in parts]
        error = math.hypot(error, fit_power_law(_together(others), roll=roll or 0.0).hurst - law.hurst)
    highest = float(data.q[-1])
    finest = max(parts, key=lambda part: part.data.q[-1])
    largest = max(surfaces, key=lambda one: max(one.shape) * one.pixel_size)
    sharpest = surfaces[parts.index(finest)]
    return RoughnessFit(
        hurst=law.hurst,
        hurst_error=error,
        roll_off=None if roll is None else 2 * math.pi / roll,
        roll_off_interval=None if interval is None else (2 * math.pi / interval[1], 2 * math.pi / interval[0]),
        resolution=2 * math.pi / highest,
        density=float(law(highest)),
        density_error=law.density_error,
        rms_height=largest.rms_height,
        rms_slope=sharpest.rms_slope,
        shape=largest.shape,
        pixel_size=largest.pixel_size,
        misfit=law.misfit,
        limit=finest.limit,
        noise=math.sqrt(finest.noise) / sharpest.pixel_size,
        tip_radius=finest.radius,
        data=data,
    )


def _together(parts: Sequence[Binned]) -> Binned:
    columns = np.concatenate([np.stack([part.q, part.density, part.modes]) for part in parts], axis=1)
    return Binned(*columns[:, np.argsort(columns[0], kind="stable")])


def _rolled(data: Binned) -> tuple[float | None, tuple[float, float] | None, PowerLaw]:
    """The roll-off of the best fit (1/nm) with its interval, both None without one; and the power law beyond."""
    without = fit_power_law(data)
    candidates = np.exp(np.linspace(math.log(data.q[0]), math.log(data.q[-FEWEST]), 12 * len(data.q)))
    laws = [fit_power_law(data, roll=float(roll)) for roll in candidates]
    loss = np.array([law.misfit for law in laws]) * max(len(data.q) - 2, 1)
    best = int(np.argmin(loss))
    allowed = candidates[loss <= loss[best] + max(laws[best].misfit, 1.0)]
    if without.misfit * max(len(data.q) - 2, 1) - loss[best] < SIGNIFICANT * max(laws[best].misfit, 1.0):
        return None, None, without
    return float(candidates[best]), (float(allowed[0]), float(allowed[-1])), laws[best]
