"""Random self-affine roughness by Fourier filtering.

Each wave vector has a fixed position in the random stream, ordered in shells of increasing wavenumber, so that a seed
defines one *surface*: a finer pixel grid samples the same surface, and a larger ``zeta`` adds shorter waves to it.
Convergence in the pixel size can therefore be studied without averaging over realisations.

Source: Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018), Eq. 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from chemage import Surface
from chemage.plugin import (
    Length,
    Roughness,
    Scatter,
    Seed,
    SurfaceMaker,
    Unit,
    memory,
    roughness,
    threads,
)
from chemage_surfaces._maps import Floats, Pixels, provenance, stream

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
    cite = (
        "Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",
        "T. D. B. Jacobs, T. Junge, L. Pastewka, Surf. Topogr.: Metrol. Prop. 5, 013001 (2017)",
    )
    bibtex = ("", JACOBS)

    pixels: Pixels
    """grid: one number for a square, or [nx, ny]"""
    pixel_size: Length
    """edge of a pixel, nm"""
    hurst: Annotated[Any, Unit("", ge=0, le=1)]
    """Hurst exponent H"""
    zeta: Annotated[Any, Unit("", ge=1)]
    """short-wavelength cut-off q_s/q_L; at most half the pixels of the longer side (Nyquist)"""
    eta: Annotated[Any, Unit("", ge=1)] = 1.0
    """roll-off q_r/q_L, 1 ≤ eta ≤ zeta; 1: no plateau"""
    rms_slope: Annotated[Any, Unit("", ge=0, le=1e100)] | None = None
    """rms slope (spectral) of this realisation; give either this or rms_height"""
    rms_height: Annotated[Any, Unit("nm", ge=0)] | None = None
    """rms height of this realisation, nm; give either this or rms_slope"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.rms_slope is None) == (self.rms_height is None):
            which = "neither" if self.rms_slope is None else "both"
            raise ValueError(
                f"rms_slope, rms_height: {which} given; give exactly one of them"
            )
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
        slope = (
            self.roughness().rms_slope if self.rms_slope is None else self.rms_slope
        )
        expected["cpu_seconds"] = 2e-8 * nx * ny
        return (
            {**expected, "rms_slope": slope} if math.isfinite(slope) else expected
        )

    def roughness(self, seed: Seed = 0) -> Roughness:
        """The rms slope and height of the spectrum, without any heights, so that the surface may have any size.

        One of the two is an option, which every surface has exactly; the other is the mean over surfaces, in the limit
        of many waves.
        """
        nx, ny = self.pixels
        longest = max(nx, ny) * self.pixel_size
        ratio = 2 * np.pi / longest * np.sqrt(self._moment(3.0) / self._moment(1.0))
        slope = (
            self.rms_slope
            if self.rms_slope is not None
            else (self.rms_height or 0.0) * ratio
        )
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
        measured = (
            MEASURED_AREA[0] <= area <= MEASURED_AREA[1]
            and ratio >= LEAST_RATIO
            and self.hurst >= 0.25
        )
        relative = (
            0.144 / self.eta * area**-0.5 * ratio ** (0.40 * self.hurst - 0.91)
            if measured
            else math.nan
        )
        if (
            self.rms_slope is None
            or not MEASURED_SCATTER[0] <= relative <= MEASURED_SCATTER[1]
        ):
            return Scatter(
                None,
                "1 to 22 % were measured on other surfaces, the more the smaller the contact",
            )
        return Scatter(
            float(f"{relative:.2g}"),
            "estimated from spectrum and A/A0, within a factor of 1.5",
        )

    def coarser(self, factor: int) -> Self | None:
        """The same surface on pixels ``factor`` times larger; None if they cannot resolve it."""
        nx, ny = self.pixels
        # with fewer than four pixels per shortest wavelength the contact depends on the pixels
        if nx % factor or ny % factor or self.zeta > max(nx, ny) / factor / 4:
            return None
        return self.replace(
            pixels=(nx // factor, ny // factor), pixel_size=self.pixel_size * factor
        )

    def sketch(self) -> Self | None:
        """The same surface on about two pixels per shortest wavelength."""
        from scipy.fft import next_fast_len

        step = math.gcd(*self.pixels)
        sides = [side // step for side in self.pixels]
        parts = (
            next_fast_len(math.ceil(SKETCHED * self.zeta / max(sides)), real=True)
            or step
        )
        if parts >= step:
            return None
        return self.replace(
            pixels=(sides[0] * parts, sides[1] * parts),
            pixel_size=self.pixel_size * step / parts,
        )

    def coarser_errors(
        self, factor: int, contact: Mapping[str, float]
    ) -> dict[str, float]:
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
        curvature = (
            math.sqrt(self._moment(5.0) / self._moment(3.0))
            * 2
            * math.pi
            / (max(nx, ny) * self.pixel_size)
        )
        area = area if area > 0 else 0.01
        return (
            2.79
            * curvature
            * area**-0.083
            * (self.zeta / self.eta) ** -0.172
            * math.exp(-0.703 * self.hurst)
        )

    def _moment(self, power: float) -> float:
        """∫ q^power C(q) dq between the cut-offs, q in units of q_L and C = 1 on the plateau."""
        plateau = (self.eta ** (power + 1) - 1) / (power + 1)
        decay = power - 2 - 2 * self.hurst
        if abs(decay + 1) < 1e-9:
            tail = np.log(self.zeta / self.eta)
        else:
            tail = (self.zeta ** (decay + 1) - self.eta ** (decay + 1)) / (
                decay + 1
            )
        moment = plateau + self.eta ** (2 + 2 * self.hurst) * tail
        # a spectrum of one wavenumber
        return float(moment) if moment > 0 else 1.0

    def _density(self, qx: Floats, qy: Floats) -> Floats:
        """Eq. 1 of the paper, 1 on the plateau; q in units of q_L."""
        q = np.hypot(qx, qy)
        return (np.maximum(q, self.eta) / self.eta) ** (-2.0 - 2.0 * self.hurst)

    def make(self, seed: Seed = 0) -> Surface:
        """Make the surface of ``seed``: heights (nx, ny) float64 nm with zero mean, reproducible to the last bit.

        Raises
        ------
        InputError
            The seed is not a whole number ≥ 0 (or a ``numpy.random.SeedSequence``).
        """
        memory.require(
            3 * 8.0 * self.pixels[0] * self.pixels[1],
            f"pixels = {self.pixels}",
            "use fewer",
        )
        nx, ny = self.pixels
        longest = max(nx, ny)

        half = half_spectrum(
            self.pixels,
            seed,
            density=self._density,
            long=1.0,
            short=self.zeta,
        )
        power = half.real**2 + half.imag**2
        power *= roughness.multiplicity(ny)[: half.shape[1]]
        if self.rms_slope is not None:
            # wavenumbers in units of 2π/λ_L: the terms are of order one, so that extreme spectra neither overflow nor
            # vanish
            qx = np.rint(np.fft.fftfreq(nx) * nx) * (longest / nx)
            qy = np.arange(half.shape[1]) * (longest / ny)
            norm = math.sqrt(float(np.sum(power * (qx[:, None] ** 2 + qy**2)))) * (
                2.0 * math.pi / longest
            )
            target = self.rms_slope * self.pixel_size
        else:
            norm, target = math.sqrt(float(np.sum(power))), self.rms_height or 0.0
        half *= target / norm * nx * ny
        heights = heights_of(half, ny)
        heights.setflags(write=False)
        return Surface(
            heights=heights,
            pixel_size=self.pixel_size,
            periodic=True,
            provenance=provenance(self, seed),
        )


def heights_of(half: NDArray[np.complex128], ny: int) -> Floats:
    """Heights (nx, ny) from the columns of a half spectrum, which is destroyed; threads do not change a bit."""
    from scipy import fft as sfft

    columns = sfft.ifft(half, axis=0, overwrite_x=True, workers=threads.available())
    heights = sfft.irfft(
        columns, n=ny, axis=1, overwrite_x=True, workers=threads.available()
    )
    return np.ascontiguousarray(heights)


def heights_at(
    half: NDArray[np.complex128],
    ny: int,
    sides: tuple[float, float],
    x: Floats,
    y: Floats,
) -> Floats:
    """The Fourier series of a half spectrum of periods ``sides``, at ``x`` and ``y``: (len(x), len(y))."""
    nx, columns = half.shape
    across = np.outer(x, np.rint(np.fft.fftfreq(nx) * nx))
    along = np.outer(np.arange(columns), y)
    waves = np.exp(2j * math.pi / sides[1] * along)
    waves *= roughness.multiplicity(ny)[:columns, None] / (nx * ny)
    return (np.exp(2j * math.pi / sides[0] * across) @ half @ waves).real


def half_spectrum(
    shape: tuple[int, int],
    seed: Seed,
    *,
    density: Callable[[Any, Any], Floats],
    long: float,
    short: float,
    scale: float = 1.0,
) -> NDArray[np.complex128]:
    """Complex white noise of mean square 2 times ``scale`` and the root of a density, with Hermitian symmetry: rows in
    FFT order, columns 0 … top along y.

    ``density`` is a function of the wavenumbers along x (nx, 1) and y (ny,); it is taken as zero for |q| below ``long``
    and above ``short``, inclusive to within rounding (1e-9). All are in units of 2π over the longer side.
    """
    nx, ny = shape
    longest = max(nx, ny)
    top_x = min(math.floor(short * nx / longest * (1.0 + 1e-12)), nx // 2)
    top_y = min(math.floor(short * ny / longest * (1.0 + 1e-12)), ny // 2)
    rng = np.random.Generator(np.random.Philox(stream(seed)))
    # noise[i, j] has kx = i - top_x, ky = j
    noise = np.zeros((2 * top_x + 1, top_y + 1), dtype=np.complex128)
    for s in range(1, max(top_x, top_y) + 1):
        draw = rng.standard_normal(2 * (4 * s + 1)).view(np.complex128)
        if s <= top_x:
            ky = min(s, top_y) + 1
            noise[top_x + s, :ky] = draw[:ky]
            noise[top_x - s, :ky] = draw[s + 1 : s + 1 + ky]
        if s <= top_y:
            kx = min(s - 1, top_x)
            middle = 3 * s + 1  # of draw[2s+2 : 4s+1], where kx = 0
            noise[top_x - kx : top_x + kx + 1, s] = draw[
                middle - kx : middle + kx + 1
            ]
    kx_all = np.arange(-top_x, top_x + 1)
    qx, qy = kx_all[:, None] * (longest / nx), np.arange(top_y + 1) * (longest / ny)
    q, slack = np.hypot(qx, qy), 1e-9
    power = density(qx, qy)
    power[(q < long * (1.0 - slack)) | (q > short * (1.0 + slack))] = 0.0
    noise *= scale * np.sqrt(power)
    half = np.zeros((nx, top_y + 1), dtype=np.complex128)
    half[kx_all % nx] = (
        noise  # for even nx and top_x = nx/2 the first and the last share a row, which keeps the last
    )
    # columns that are their own conjugate mirror images, from their positive halves; real entries keep their variance
    for j in (0, ny // 2) if ny % 2 == 0 and top_y == ny // 2 and ny > 1 else (0,):
        column = half[:, j]
        positive = column[1 : (nx + 1) // 2]
        column[nx - positive.size :] = positive[::-1].conj()
        for i in (0, nx // 2) if nx % 2 == 0 else (0,):
            column[i] = math.sqrt(2.0) * column[i].real
    return half
