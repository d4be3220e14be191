"""Randomly rough, self-affine surfaces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import model_validator

from chemage import Surface
from chemage.plugin import Length, Roughness, Scatter, Seed, SurfaceMaker, Unit, checked_seed, memory, threads
from chemage_surfaces._maps import Pixels, provenance

#: what was measured of the scatter between surfaces: A/A0, ζ/η, and the scatter itself
MEASURED_AREA, LEAST_RATIO, MEASURED_SCATTER = (0.0025, 0.2), 2.0, (0.006, 0.25)

#: relative standard errors of a contact on coarser pixels are so many times (pixel size · perimeter / area)²
COARSER_ERRORS = {"beta": 0.016, "friction_drop": 0.016}

#: pixels per shortest wavelength of a sketch; two would be the least
SKETCHED = 2.1

JACOBS = """@article{jacobs2017,
  author = {Jacobs, T. D. B. and Junge, T. and Pastewka, L.},
  title = {Quantitative characterization of surface topography using spectral analysis},
  journal = {Surface Topography: Metrology and Properties},
  volume = {5},
  pages = {013001},
  year = {2017},
  doi = {10.1088/2051-672X/aa51f8},
}"""


class SelfAffine(SurfaceMaker):
    """Periodic, isotropic, Gaussian self-affine surface, by Fourier filtering of white noise.

    With q_L = 2π/λ_L, λ_L the longer side, the power spectral density is constant for q_L ≤ q < ``eta`` q_L, falls as
    q^(−2−2H) for ``eta`` q_L ≤ q ≤ ``zeta`` q_L, and is zero elsewhere. Li, Pastewka & Szlufarska, Phys. Rev. E 98,
    023001 (2018), eq. 1. A seed defines one surface: a finer grid of the same size samples the same heights, and a
    larger ``zeta`` adds shorter waves.
    """

    kind = "self-affine"
    cite: ClassVar[tuple[str, ...]] = (
        "Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",
        "T. D. B. Jacobs, T. Junge, L. Pastewka, Surf. Topogr.: Metrol. Prop. 5, 013001 (2017)",
    )
    bibtex: ClassVar[tuple[str, ...]] = ("", JACOBS)

    pixels: Pixels
    """grid: one number for a square, or [nx, ny]"""
    pixel_size: Length
    """edge of a pixel, nm"""
    hurst: Annotated[float, Unit("", ge=0, le=1)]
    """Hurst exponent H"""
    zeta: Annotated[float, Unit("", ge=1)]
    """short-wavelength cut-off q_s/q_L; at most half the pixels of the longer side (Nyquist)"""
    eta: Annotated[float, Unit("", ge=1)] = 1.0
    """roll-off q_r/q_L, 1 ≤ eta ≤ zeta; 1: no plateau"""
    rms_slope: Annotated[float, Unit("", ge=0, le=1e100)] | None = None
    """rms slope (spectral) of this realisation; give either this or rms_height"""
    rms_height: Annotated[float, Unit("nm", ge=0)] | None = None
    """rms height of this realisation, nm; give either this or rms_slope"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.rms_slope is None) == (self.rms_height is None):
            which = "neither" if self.rms_slope is None else "both"
            raise ValueError(f"rms_slope, rms_height: {which} given; give exactly one of them")
        if self.eta > self.zeta:
            raise ValueError(
                f"eta = {self.eta:g}: above zeta = {self.zeta:g}; the roll-off must come before the cut-off"
            )
        longest = max(self.pixels)
        if self.zeta > longest / 2:
            raise ValueError(
                f"zeta = {self.zeta:g}: above the Nyquist limit {longest / 2:g} of {longest} pixels; "
                "use more pixels or a smaller zeta"
            )
        return self

    def expected(self) -> dict[str, float]:
        """Grid, shortest wavelength (nm), rms slope, and the time to make it."""
        nx, ny = self.pixels
        expected = {
            "nx": nx,
            "ny": ny,
            "pixel_size": self.pixel_size,
            "periodic": 1.0,
            "shortest_wavelength": max(nx, ny) * self.pixel_size / self.zeta,
        }
        # that of an rms height is the mean over surfaces
        slope = self.roughness().rms_slope if self.rms_slope is None else self.rms_slope
        expected["cpu_seconds"] = 2e-8 * nx * ny
        return {**expected, "rms_slope": slope} if math.isfinite(slope) else expected

    def roughness(self, seed: Seed = 0) -> Roughness:
        """The rms slope and height of the spectrum, without any heights, so that the surface may have any size.

        One of the two is an option, which every surface has exactly; the other is the mean over surfaces, in the limit
        of many waves.
        """
        nx, ny = self.pixels
        longest = max(nx, ny) * self.pixel_size
        ratio = 2 * np.pi / longest * np.sqrt(_moment(self, 3.0) / _moment(self, 1.0))
        slope = self.rms_slope if self.rms_slope is not None else (self.rms_height or 0.0) * ratio
        height = self.rms_height if self.rms_height is not None else slope / ratio
        return Roughness(
            rms_slope=slope,
            rms_height=height,
            nominal_area=nx * ny * self.pixel_size**2,
            provenance=provenance(self, seed),
        )

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """Standard deviation of β over its mean between seeds, from the area fraction of a contact.

        With r = ζ/η it is 0.144 η^(−1) (A/A0)^(−1/2) r^(0.40 H − 0.91).
        It falls as the root of the nominal area, if the wavelengths stay. Fitted to 24 surfaces of each of 27 settings
        with a given rms slope and to 32 of each of 28 random scenes (H 0.3 to 0.9, ζ 15 to 210, η 1 to 10); it meets
        them, and 19 others, within a factor of 1.8, and most of them within 1.25: ``python
        tests/benchmarks/surface_scatter.py``. Outside their range, and where the rms height is given, the
        scatter is not known.
        """
        if 0 in (self.rms_slope, self.rms_height):
            return Scatter(0.0)  # flat at every seed
        area = contact.get("area_fraction", 0)
        ratio = self.zeta / self.eta
        measured = MEASURED_AREA[0] <= area <= MEASURED_AREA[1] and ratio >= LEAST_RATIO and self.hurst >= 0.25
        relative = 0.144 / self.eta * area**-0.5 * ratio ** (0.40 * self.hurst - 0.91) if measured else math.nan
        if self.rms_slope is None or not MEASURED_SCATTER[0] <= relative <= MEASURED_SCATTER[1]:
            return Scatter(None, "1 to 22 % were measured on other surfaces, the more the smaller the contact")
        return Scatter(relative, f"estimated from the spectrum and A/A0 = {area:.3g}, within a factor of 1.5")

    def coarser(self, factor: int) -> Self | None:
        """The same surface on pixels ``factor`` times larger; None if they cannot resolve it."""
        nx, ny = self.pixels
        # with fewer than four pixels per shortest wavelength the contact depends on the pixels
        if nx % factor or ny % factor or self.zeta > max(nx, ny) / factor / 4:
            return None
        return self.replace(pixels=(nx // factor, ny // factor), pixel_size=self.pixel_size * factor)

    def sketch(self) -> Self | None:
        """The same surface on about two pixels per shortest wavelength."""
        from scipy.fft import next_fast_len

        step = math.gcd(*self.pixels)
        sides = [side // step for side in self.pixels]
        parts = next_fast_len(math.ceil(SKETCHED * self.zeta / max(sides)), real=True) or step
        if parts >= step:
            return None
        return self.replace(pixels=(sides[0] * parts, sides[1] * parts), pixel_size=self.pixel_size * step / parts)

    def coarser_errors(self, factor: int, contact: Mapping[str, float]) -> dict[str, float]:
        """Pixels at the rim of patches are those that are wrong, so that errors grow with the part of the pixels which
        the rim has, of first order in the perimeter times the pixel size over the area; those that remain with sites in
        place are of second order.

        Measured on 28 scenes with 4 to 10 coarse pixels per shortest wavelength, loads of 2 to 200 µN and rms slopes of
        0.03 to 0.3 (``python tests/benchmarks/coarser_errors.py``), where that number is 0.3 to 0.8.
        """
        pixel = self.pixel_size * factor
        perimeter = contact.get("perimeter_to_area", math.nan)
        if not perimeter > 0:
            perimeter = self._perimeter(contact.get("area_fraction", math.nan))
        rim = (perimeter * pixel) ** 2
        return {name: error * rim for name, error in COARSER_ERRORS.items()}

    def _perimeter(self, area: float) -> float:
        """Perimeter over area of a contact of this area fraction, 1/nm; of a hundredth where it is not known.

        It is in proportion to the rms curvature over the rms slope, both spectral. Fitted to 29 contacts (3 %), it is
        5 to 20 % off on five others.
        """
        nx, ny = self.pixels
        curvature = math.sqrt(_moment(self, 5.0) / _moment(self, 3.0)) * 2 * math.pi / (max(nx, ny) * self.pixel_size)
        area = area if area > 0 else 0.01
        return 2.79 * curvature * area**-0.083 * (self.zeta / self.eta) ** -0.172 * math.exp(-0.703 * self.hurst)

    def make(self, seed: Seed = 0) -> Surface:
        """Make the surface of ``seed``: heights (nx, ny) float64 nm with zero mean, reproducible to the last bit.

        Raises
        ------
        InputError
            The seed is not a whole number ≥ 0 (or a ``numpy.random.SeedSequence``).
        """
        from chemage_surfaces import _spectral

        memory.require(3 * 8.0 * self.pixels[0] * self.pixels[1], f"pixels = {self.pixels}", "use fewer")
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        heights = _spectral.self_affine(
            self.pixels,
            self.pixel_size,
            hurst=self.hurst,
            zeta=self.zeta,
            eta=self.eta,
            rms_slope=self.rms_slope,
            rms_height=self.rms_height,
            seed=seed,
            workers=threads.available(),
        )
        heights.setflags(write=False)
        return Surface(heights=heights, pixel_size=self.pixel_size, periodic=True, provenance=provenance(self, seed))


def _moment(maker: SelfAffine, power: float) -> float:
    """∫ q^power C(q) dq between the cut-offs, q in units of q_L and C = 1 on the plateau."""
    plateau = (maker.eta ** (power + 1) - 1) / (power + 1)
    decay = power - 2 - 2 * maker.hurst
    if abs(decay + 1) < 1e-9:
        tail = np.log(maker.zeta / maker.eta)
    else:
        tail = (maker.zeta ** (decay + 1) - maker.eta ** (decay + 1)) / (decay + 1)
    moment = plateau + maker.eta ** (2 + 2 * maker.hurst) * tail
    # a spectrum of one wavenumber
    return float(moment) if moment > 0 else 1.0
