"""The roughness of images as the parameters of `self-affine` surfaces like them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import trapezoid

from chemage import InputError, Surface
from chemage.plugin import checked_count, convert
from chemage_surfaces.findings import Finding, examined
from chemage_surfaces.generated import SelfAffine
from chemage_surfaces.spectra import FEWEST, Binned
from chemage_surfaces.trusted import trusted

#: χ² per degree of freedom from which a fit is doubtful, and from which it makes no surface
DOUBTFUL, FAILED = 3.0, 10.0


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
    #: rms height of the noise in the image, nm: white, or of its retrace; 0: none is seen
    noise: float = 0.0
    #: radius of the tip, nm, given or estimated from valleys that are sharper than peaks; 0: none is seen
    tip_radius: float = 0.0
    #: artefacts and structures in the images
    findings: tuple[Finding, ...] = field(default=(), repr=False, compare=False)
    #: the bins of the fit
    data: Binned | None = field(default=None, repr=False, compare=False)

    @property
    def fault(self) -> str:
        """Why no surface is made of this fit; empty where one can be."""
        for one in self.findings:
            if one.consequence == "no fit":
                return one.text
        if not 0 <= self.hurst <= 1:
            return (
                f"the spectrum falls with H = {self.hurst:.2f} ± {self.hurst_error:.2f}, which is not self-affine "
                "(0 to 1)"
            )
        if not self.misfit <= FAILED:
            return (
                f"χ² per degree of freedom is {self.misfit:.2g}, so that the spectrum is not that of a self-affine "
                'surface; align lines that are offset (lines = "differences")'
            )
        return ""

    def slope(self, longest: float, shortest: float) -> float:
        """rms slope of all waves between two wavelengths (nm) of the fitted spectrum: h'² = ∫ C q³ dq/(2π)."""
        q = np.geomspace(2 * math.pi / longest, 2 * math.pi / shortest, 4001)
        roll = 0.0 if self.roll_off is None else 2 * math.pi / self.roll_off
        at = 2 * math.pi / self.resolution
        density = self.density * (np.maximum(q, roll) / at) ** (-2 - 2 * self.hurst)
        return math.sqrt(
            float(trapezoid(density * q**4, np.log(q))) / (2 * math.pi)
        )

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
            raise InputError.of(
                "pixel_size", pixel_size, "is no length", "give nm above 0"
            )
        count = (
            round(max(self.shape) * self.pixel_size / side)
            if pixels is None
            else checked_count("pixels", pixels)
        )
        longest = count * side
        if not 2 * side * (1 - 1e-9) <= shortest < longest:
            raise InputError(
                f"cutoff = {shortest:g} nm: a grid of {count} pixels of {side:g} nm holds wavelengths from "
                f"{2 * side:g} to {longest:g} nm; give a cutoff between them, or other pixels"
            )
        zeta = min(longest / shortest, count / 2)
        eta = (
            1.0
            if self.roll_off is None
            else min(max(longest / self.roll_off, 1.0), zeta)
        )
        return SelfAffine(
            pixels=(count, count),
            pixel_size=side,
            hurst=round(self.hurst, 4),
            zeta=float(f"{zeta:.6g}") if zeta < count / 2 else zeta,
            eta=float(f"{eta:.4g}"),
            rms_slope=float(f"{self.slope(longest, shortest):.4g}"),
        )

    def section(self, pixel_size: str | None, cutoff: str | None) -> str:
        """The section ``[surface]`` of a scene, TOML, of :meth:`maker`."""
        maker = self.maker(pixel_size=pixel_size, cutoff=cutoff)
        lines = [
            "[surface]",
            f'kind = "{maker.kind}"',
            f"pixels = {max(maker.pixels)}",
        ]
        lines.append(f'pixel_size = "{maker.pixel_size:.10g} nm"')
        lines += [
            f"{name} = {getattr(maker, name):.10g}"
            for name in ("rms_slope", "hurst", "zeta", "eta")
        ]
        return "\n".join([*lines, "seed = 1"])

    def text(self) -> str:
        """What was found, one line each."""
        roll = "none: the power law goes on to the longest wavelength"
        if self.roll_off is not None and self.roll_off_interval is not None:
            low, high = self.roll_off_interval
            roll = f"{self.roll_off:.4g} nm ({low:.4g} to {high:.4g})"
        rows = {
            "rms height": f"{self.rms_height:.4g} nm, of the image",
            "Hurst exponent": f"{self.hurst:.3f} ± {self.hurst_error:.3f}",
            "roll-off": roll,
            "shortest wavelength": f"{self.resolution:.4g} nm"
            + (f" ({self.limit})" if self.limit else ""),
        }
        if self.noise:
            rows["noise"] = f"{self.noise:.4g} nm rms, subtracted"
        rows["tip radius"] = "none is given or seen: no error has its effect"
        if self.tip_radius:
            rows["tip radius"] = (
                f"{self.tip_radius:.3g} nm, its effect is corrected"
            )
        rows["χ² per degree of freedom"] = f"{self.misfit:.2g}"
        if self.misfit > DOUBTFUL:
            rows["warning:"] = (
                f"this is no good fit (above {DOUBTFUL:g}); the errors are enlarged by it"
            )
        return "\n".join(f"{name:<19} {text}" for name, text in rows.items())


def fit_roughness(
    surface: Surface | Sequence[Surface],
    *,
    resolution: float | str | None = None,
    tip_radius: float | str | None = None,
    retraces: Sequence[Surface | None] = (),
) -> RoughnessFit:
    """Fit Hurst exponent, roll-off and amplitude to the power spectral density of ``surface``, or of several images of
    one surface, at any magnifications, together.

    ``resolution`` is the shortest wavelength (nm) to use, such as the resolution of the instrument; by default each
    image is used as far as it can be trusted (:func:`trusted`), for which the radius of the tip (nm) may be given, and
    for each image its retrace, from which the noise is known, or None. The fit is one of least squares to logarithmic
    bins, each weighted by its number of independent wave vectors, and less if it is far from the fit (Huber); its
    errors are enlarged by the misfit, and so by the scatter between images.

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
        raise InputError.of(
            "tip_radius", tip_radius, "is no radius", "give nm above 0"
        )
    if retraces and len(retraces) != len(surfaces):
        raise InputError(
            f"retraces: {len(retraces)} for {len(surfaces)} images; give one for each, or None"
        )
    parts, findings = [], []
    for one, retrace in zip(
        surfaces, retraces or [None] * len(surfaces), strict=True
    ):
        if shortest is not None and not shortest >= 2 * one.pixel_size * (1 - 1e-9):
            raise InputError(
                f"resolution = {shortest:g} nm: shorter than two pixels, {2 * one.pixel_size:g} nm; give at least this"
            )
        part = trusted(one, shortest, radius, retrace)
        if len(part.data.q) < 2 * FEWEST or not (part.data.density > 0).all():
            raise InputError(
                f"{one!r}: its power spectrum has too few wavelengths for a fit"
                + (
                    f" above those changed by the tip of {part.radius:.3g} nm"
                    if part.limit == "the tip"
                    else ""
                )
                + (
                    f" above noise of {part.noise:.3g} nm rms"
                    if part.limit == "noise"
                    else ""
                )
                + "; give a larger image"
            )
        parts.append(part)
        fine = part.fine_pixels(one.pixel_size)
        findings += [*examined(one), *filter(None, [fine])]
    data = Binned.together([part.data for part in parts])
    roll, interval, law = data.rolled()
    error = law.hurst_error
    for which in range(
        max(len(part.corrections) for part in parts)
    ):  # as much as each is uncertain
        others = [part.without(which) for part in parts]
        error = math.hypot(
            error,
            Binned.together(others).power_law(roll=roll or 0.0).hurst - law.hurst,
        )
    highest = float(data.q[-1])
    finest = max(parts, key=lambda part: part.data.q[-1])
    largest = max(surfaces, key=lambda one: max(one.shape) * one.pixel_size)
    sharpest = surfaces[parts.index(finest)]
    return RoughnessFit(
        hurst=law.hurst,
        hurst_error=error,
        roll_off=None if roll is None else 2 * math.pi / roll,
        roll_off_interval=None
        if interval is None
        else (2 * math.pi / interval[1], 2 * math.pi / interval[0]),
        resolution=2 * math.pi / highest,
        density=float(law(highest)),
        density_error=law.density_error,
        rms_height=largest.rms_height,
        rms_slope=sharpest.rms_slope,
        shape=largest.shape,
        pixel_size=largest.pixel_size,
        misfit=law.misfit,
        limit=finest.limit,
        noise=finest.noise,
        tip_radius=finest.radius,
        findings=tuple(findings),
        data=data,
    )
