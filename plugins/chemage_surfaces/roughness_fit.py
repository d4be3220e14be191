"""Roughness parameters of a measured surface, from which `self-affine` surfaces like it are made."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid

from chemage import InputError, Surface
from chemage.plugin import checked_count, convert
from chemage_surfaces import _fitting
from chemage_surfaces.self_affine import SelfAffine

#: a roll-off must lower the loss of the fit by this, about two standard deviations, else there is none
SIGNIFICANT = 4.0
#: bins of the power law beyond the roll-off
FEWEST = 5


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
            The grid cannot hold the cut-off.
        """
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
                f"shortest wavelength {self.resolution:.4g} nm",
                f"χ² per degree of freedom {self.misfit:.2g}",
            ]
        )


def section(maker: SelfAffine) -> str:
    """The section ``[surface]`` of a scene, TOML."""
    lines = ["[surface]", f'kind = "{maker.kind}"', f"pixels = {max(maker.pixels)}"]
    lines.append(f'pixel_size = "{maker.pixel_size:.10g} nm"')
    lines += [f"{name} = {getattr(maker, name):.10g}" for name in ("rms_slope", "hurst", "zeta", "eta")]
    return "\n".join([*lines, "seed = 1"])


def fit_roughness(surface: Surface, *, resolution: float | str | None = None) -> RoughnessFit:
    """Fit Hurst exponent, roll-off and amplitude to the power spectral density of ``surface``.

    ``resolution`` is the shortest wavelength (nm) to use, such as the resolution of the instrument; by default two
    pixels, or the wavelength at which the spectrum ends. The fit is one of least squares to logarithmic bins, each
    weighted by its number of independent wave vectors, and less if it is far from the fit (Huber).

    Raises
    ------
    InputError
        The spectrum has too few bins, or does not fall like that of a self-affine surface.
    """
    data = _fitting.binned(surface)
    if resolution is not None:
        shortest = convert(resolution, "nm")
        if not shortest >= 2 * surface.pixel_size * (1 - 1e-9):
            raise InputError(
                f"resolution = {shortest:g} nm: shorter than two pixels, {2 * surface.pixel_size:g} nm; "
                "give at least this"
            )
        data = data.part(0, 2 * math.pi / shortest)
    elif (cut := data.cut) is not None:
        # the last bin before the end is filled in part
        data = data.part(0, cut * (1 - 1e-9))
    if len(data.q) < 2 * FEWEST or not (data.density > 0).all():
        raise InputError(f"{surface!r}: its power spectrum has too few wavelengths for a fit; give a larger image")
    roll, interval, law = _rolled(data)
    if not 0 <= law.hurst <= 1:
        raise InputError(
            f"{surface!r}: its spectrum falls with H = {law.hurst:.2f} ± {law.hurst_error:.2f}, which is not "
            "self-affine (0 to 1); give a resolution longer than what the instrument blurs"
        )
    highest = float(data.q[-1])
    return RoughnessFit(
        hurst=law.hurst,
        hurst_error=law.hurst_error,
        roll_off=None if roll is None else 2 * math.pi / roll,
        roll_off_interval=None if interval is None else (2 * math.pi / interval[1], 2 * math.pi / interval[0]),
        resolution=2 * math.pi / highest,
        density=float(law(highest)),
        density_error=law.density_error,
        rms_height=surface.rms_height,
        rms_slope=surface.rms_slope,
        shape=surface.shape,
        pixel_size=surface.pixel_size,
        misfit=law.misfit,
    )


def _rolled(
    data: _fitting.Binned,
) -> tuple[float | None, tuple[float, float] | None, _fitting.PowerLaw]:
    """The roll-off of the best fit (1/nm) with its interval, both None without one; and the power law beyond."""
    without = _fitting.fit_power_law(data)
    candidates = np.exp(np.linspace(math.log(data.q[0]), math.log(data.q[-FEWEST]), 12 * len(data.q)))
    laws = [_fitting.fit_power_law(data, roll=float(roll)) for roll in candidates]
    loss = np.array([law.misfit for law in laws]) * max(len(data.q) - 2, 1)
    best = int(np.argmin(loss))
    allowed = candidates[loss <= loss[best] + max(laws[best].misfit, 1.0)]
    if without.misfit * max(len(data.q) - 2, 1) - loss[best] < SIGNIFICANT * max(laws[best].misfit, 1.0):
        return None, None, without
    return float(candidates[best]), (float(allowed[0]), float(allowed[-1])), laws[best]
