"""Randomly rough, self-affine surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import model_validator

from chemage import Length, Roughness, Scatter, Seed, Surface, SurfaceMaker, Unit, checked_seed
from chemage.foundation.memory import require
from chemage.foundation.threads import available
from chemage_surfaces._options import Pixels, provenance

#: contacts on which the scatter between surfaces was measured: patches, and A/A0
MEASURED_PATCHES, MEASURED_AREA = (5, 500), (0.0025, 0.2)


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
            given = "neither" if self.rms_slope is None else "both"
            raise ValueError(f"rms_slope, rms_height: {given} given; give exactly one of them")
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
        """Grid, shortest wavelength (nm) and, where it is an option, the rms slope."""
        nx, ny = self.pixels
        known = {
            "nx": nx,
            "ny": ny,
            "pixel_size": self.pixel_size,
            "periodic": 1.0,
            "shortest_wavelength": max(nx, ny) * self.pixel_size / self.zeta,
        }
        return known if self.rms_slope is None else {**known, "rms_slope": self.rms_slope}

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
        """Standard deviation of β over its mean between seeds, 0.16 N_p^(−1/2) (A/A0)^(−1/4), from the patches N_p and
        the area fraction of one of them.

        Fitted to 24 surfaces of each of 27 settings with a given rms slope (H 0.3 to 0.9, ζ 15 to 150, η 1 to 10). It
        meets them, and 9 other settings, within a factor of 1.4: ``python tests/benchmarks/surface_scatter.py``.
        Outside their range, and where the rms height is given, the scatter is not known.
        """
        if 0 in (self.rms_slope, self.rms_height):
            return Scatter(0.0)  # flat at every seed
        patches, area = contact.get("patches", 0), contact.get("area_fraction", 0)
        fitted = MEASURED_PATCHES[0] <= patches <= MEASURED_PATCHES[1] and MEASURED_AREA[0] <= area <= MEASURED_AREA[1]
        if not fitted or self.rms_slope is None or self.hurst < 0.25:
            return Scatter(None, "1 to 22 % were measured on other surfaces, the more the fewer patches")
        return Scatter(
            0.16 * patches**-0.5 * area**-0.25,
            f"estimated from {patches:.0f} patches at A/A0 = {area:.3g}, within a factor of 1.5; sweep surface.seed to "
            "measure it",
        )

    def coarser(self, factor: int) -> Self | None:
        """The same surface on pixels ``factor`` times larger; None if they cannot resolve it."""
        nx, ny = self.pixels
        # with fewer than four pixels per shortest wavelength the contact depends on the pixels
        if nx % factor or ny % factor or self.zeta > max(nx, ny) / factor / 4:
            return None
        return self.replace(pixels=(nx // factor, ny // factor), pixel_size=self.pixel_size * factor)

    def make(self, seed: Seed = 0) -> Surface:
        """Make the surface of ``seed``: heights (nx, ny) float64 nm with zero mean, reproducible to the last bit.

        Raises
        ------
        InputError
            The seed is not a whole number ≥ 0 (or a ``numpy.random.SeedSequence``).
        """
        from chemage_surfaces import _spectral

        require(3 * 8.0 * self.pixels[0] * self.pixels[1], f"pixels = {self.pixels}", "use fewer")
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
            workers=available(),
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
    found = plateau + maker.eta ** (2 + 2 * maker.hurst) * tail
    # a spectrum of one wavenumber
    return float(found) if found > 0 else 1.0
