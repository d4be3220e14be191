"""A measured surface carried on to smaller wavelengths than those measured."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator
from scipy import fft as sfft

from chemage import InputError, Surface
from chemage.plugin import (
    Choice,
    Length,
    Scatter,
    Seed,
    SurfaceMaker,
    Unit,
    figures,
    memory,
    roughness,
    threads,
)
from chemage_surfaces._maps import LARGEST_PART, Floats, Pair, Parts, provenance, stream
from chemage_surfaces.findings import examined
from chemage_surfaces.generated import JACOBS, half_spectrum, heights_at, heights_of
from chemage_surfaces.spectra import Binned, PowerLaw, wavenumbers
from chemage_surfaces.trusted import TO_PIXELS, trusted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: the fit starts at this many times ``resolution``, unless ``fit_from`` is given
FIT_RANGE = 4.0
#: of a pixel, over a whole side
FITS = 1e-3
#: distinguishes the random numbers of this class from those of another maker with the same seed
_STREAM = 0x726F7567
#: pixels up to which a grid is made whole where only a part is needed
MOST_WHOLE = 2**24
#: period of the longer random waves of a part, in lengths of the longest
PERIODS = 16.5
#: bins of the spectra that are recorded
_BINS = 60


class Roughened(SurfaceMaker):
    """A measured surface on finer pixels, with a self-affine continuation of its spectrum below what was measured.

    Waves of the image longer than ``resolution`` stay as they are. Shorter ones are replaced by random waves with
    C(q) = C0 q^(−2−2H) down to ``cutoff``; C0, and H unless it is given, are fitted to the measured spectrum between
    ``fit_from`` and ``resolution``. A periodic image is refined by its Fourier series; one that is not by the cosine
    series of the image (mirror images at its edges), and the random waves are periodic on the fine grid; waves that the
    alignment of scan lines took from it are random, with the density of the image in other directions.

    H and C0 with their errors, and the spectrum of the image, are in ``provenance["roughened"]``.
    """

    kind = "roughened"
    cite = (
        "T. D. B. Jacobs, T. Junge, L. Pastewka, Surf. Topogr.: Metrol. Prop. 5, 013001 (2017)",
    )
    bibtex = (JACOBS,)
    figures = {
        "roughened-spectrum": "Power spectral density of the measured image (points) and of the surface carried on to "
        "smaller wavelengths (line). Dashed: the power law that was fitted; the vertical line is the shortest "
        "wavelength taken from the image."
    }

    surface: Choice[SurfaceMaker]
    """the measured surface: a table with its ``kind`` and options"""
    pixel_size: Length
    """edge of the new pixels, such as the spacing of the sites, nm"""
    hurst: Annotated[Any, Unit("", ge=0, le=1)] | None = None
    """Hurst exponent H of the continuation; None: fitted"""
    cutoff: Length | None = None
    """shortest wavelength of the continuation, nm; None: two new pixels"""
    resolution: Length | None = None
    """shortest wavelength to take from the image, such as the resolution of the instrument, nm; None: as far as the
    image is trusted, that is to two pixels, or to where the tip, noise or the end of its spectrum decides"""
    tip_radius: Length | None = None
    """radius of the tip with which the image was taken, nm; None: as valleys that are sharper than peaks show it"""
    fit_from: Length | None = None
    """longest wavelength of the fit, nm; None: four times ``resolution``"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        shortest = 2 * self.pixel_size
        if self.cutoff is not None and self.cutoff < shortest * (1 - 1e-9):
            raise ValueError(
                f"cutoff = {self.cutoff:g} nm: shorter than two pixels of {self.pixel_size:g} nm, {shortest:g} nm; "
                "give smaller pixels or a longer cutoff"
            )
        if self.resolution is not None and self.resolution <= self.shortest * (
            1 + 1e-9
        ):
            raise ValueError(
                f"resolution = {self.resolution:g} nm: nothing is left to add above the cutoff of {self.shortest:g} "
                "nm; give a longer resolution or a shorter cutoff"
            )
        if (
            self.fit_from is not None
            and self.resolution is not None
            and self.fit_from <= self.resolution
        ):
            raise ValueError(
                f"fit_from = {self.fit_from:g} nm: must be longer than resolution = {self.resolution:g} nm"
            )
        return self

    @property
    def shortest(self) -> float:
        """The shortest wavelength of the surface, nm."""
        return 2 * self.pixel_size if self.cutoff is None else self.cutoff

    def expected(self) -> dict[str, float]:
        """Grid, shortest wavelength and rms slope, from the measured surface and the fit."""
        measured = self.surface.make()
        plan = self._plan(measured)
        nx, ny = plan.shape
        return {
            "nx": nx,
            "ny": ny,
            "pixel_size": self.pixel_size,
            "periodic": float(measured.periodic),
            "shortest_wavelength": self.shortest,
            "rms_slope": math.hypot(plan.kept_slope(), plan.added_slope(self.shortest)),
        }

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """Not known: the seed changes the waves that were not measured, and not the others."""
        return Scatter(None, "the seed changes only wavelengths that were not measured")

    def make(self, seed: Seed = 0) -> Surface:
        """The surface of ``seed``, which is also that of the surface inside.

        Raises
        ------
        InputError
            The new pixels are no finer than the image or do not fit into its period, or the spectrum of the image
            allows no fit.
        """
        return self._whole(self._examined(seed), seed)

    def whole_or_parts(self, seed: Seed = 0) -> Surface | Parts:
        """The surface, or its parts where it has more than 2²⁴ pixels and is not periodic."""
        plan = self._examined(seed)
        measured = plan.measured
        if math.prod(plan.shape) <= MOST_WHOLE or measured.periodic:
            return self._whole(plan, seed)
        return Parts(
            shape=plan.shape,
            pixel_size=self.pixel_size,
            provenance=self._record(plan, seed),
            heights=partial(self._part, plan, seed),
            coarse=plan.cosines(
                plan.completed(seed), *plan.places(measured.shape, measured.pixel_size)
            ),
            side=measured.pixel_size,
            unseen=plan.added_height(self.shortest),
        )

    def _examined(self, seed: Seed) -> _Plan:
        """What is added to the image, of which warnings say what makes the fit doubtful."""
        measured = self.surface.make(seed)
        for one in examined(measured):
            if one.consequence == "no fit":
                warnings.warn(f"surface: {one.text}", UserWarning, stacklevel=3)
        return self._plan(measured)

    def _whole(self, plan: _Plan, seed: Seed) -> Surface:
        memory.require(
            6 * 8.0 * plan.shape[0] * plan.shape[1],
            f"pixel_size = {self.pixel_size:g} nm",
            "give larger pixels",
        )
        waves = (plan.join, 2 * math.pi / self.shortest)
        half = plan.added(plan.shape, self.pixel_size, waves, stream(seed, _STREAM))
        heights = None
        if plan.measured.periodic:
            half = plan.with_image(half)
        else:
            heights = plan.cosines(
                plan.completed(seed), *plan.places(plan.shape, self.pixel_size)
            )
        added = heights_of(half, plan.shape[1])
        heights = added if heights is None else heights + added
        heights.setflags(write=False)
        return Surface(
            heights=heights,
            pixel_size=self.pixel_size,
            periodic=plan.measured.periodic,
            provenance=self._record(plan, seed),
        )

    def _part(
        self,
        plan: _Plan,
        seed: Seed,
        first: Pair,
        shape: Pair,
        middle: Pair,
    ) -> Floats:
        """See :attr:`Parts.heights`: each octave of long random waves has a period of its own, short ones share one."""
        size = self.pixel_size
        x, y = plan.places(shape, size, first)
        heights = plan.cosines(plan.completed(seed), x, y)
        x, y = x - middle[0] * size, y - middle[1] * size
        least = max(LARGEST_PART, *shape) * size
        low, highest, octave = plan.join, 2 * math.pi / self.shortest, 0
        while low < highest:
            period = max(least, 2 * math.pi * PERIODS / low)
            high = highest if period == least else min(2 * low, highest)
            side = 2 * math.ceil(period * high / (2 * math.pi)) + 2
            key = stream(seed, _STREAM, 1, *middle, octave)
            half = plan.added((side, side), period / side, (low, high), key)
            heights += heights_at(half, side, (period, period), x, y)
            low, octave = high, octave + 1
        return heights

    def _record(self, plan: _Plan, seed: Seed) -> dict[str, Any]:
        return {
            **provenance(self, seed),
            "measured": plan.measured.provenance,
            "roughened": plan.record(),
        }

    def _plan(self, measured: Surface) -> _Plan:
        return _planned(self, measured)  # pyright: ignore[reportArgumentType]: hashable they are

    def plan(self, measured: Surface) -> _Plan:
        """What is added to the measured surface, and what is taken from it; errors as of :meth:`make`."""
        side = measured.pixel_size
        if self.pixel_size >= side * (1 - 1e-9):
            raise InputError(
                f"pixel_size = {self.pixel_size:g} nm: the pixels of the measured surface are {side:g} nm; give "
                "smaller ones, or use the measured surface itself"
            )
        if self.resolution is not None and self.resolution < 2 * side * (1 - 1e-9):
            raise InputError(
                f"resolution = {self.resolution:g} nm: shorter than two pixels of the image, {2 * side:g} nm; "
                "give at least this"
            )
        spectrum = Binned.of(measured)
        part = trusted(measured, self.resolution, self.tip_radius)
        if not len(part.data.q):
            raise InputError(
                f"tip_radius: a tip of {part.radius:.4g} nm has changed all waves of the image; give a larger image, "
                "or resolution to use it as it is"
            )
        resolution = self.resolution or (
            2 * side
            if part.limit == TO_PIXELS
            else 2 * math.pi / float(part.data.q[-1])
        )
        if resolution <= self.shortest * (1 + 1e-9):
            raise InputError(
                f"cutoff = {self.shortest:g} nm: the image has waves down to {resolution:g} nm, so that nothing is "
                "left to add; give a shorter cutoff"
            )
        shape = self._fine_shape(measured)
        join = 2 * math.pi / resolution
        longest = FIT_RANGE * resolution if self.fit_from is None else self.fit_from
        data = part.data.part(2 * math.pi / longest, join * (1 + 1e-9))
        cut = spectrum.part(0, join).cut
        if cut is not None and self.resolution is not None:
            raise InputError(
                f"resolution = {resolution:g} nm: the spectrum of the image ends at a wavelength of "
                f"{2 * math.pi / cut:.4g} nm; give this resolution"
            )
        try:
            law = data.power_law(self.hurst)
        except ValueError as error:
            raise InputError(
                f"fit_from = {longest:g} nm, resolution = {resolution:g} nm: no power law can be fitted to the "
                f"spectrum between them ({error}); give a longer fit_from, at most the side of the image"
            ) from None
        if not 0 <= law.hurst <= 1:
            raise InputError(
                f"hurst: the spectrum between {longest:g} and {resolution:g} nm falls with H = {law.hurst:.2f} ± "
                f"{law.hurst_error:.2f}, which is not self-affine (0 to 1); give a resolution longer than what the "
                "instrument blurs, another fit_from, or hurst"
            )
        return _Plan(measured, shape, join, law, spectrum, part.data.part(0, join))

    def _fine_shape(self, measured: Surface) -> tuple[int, int]:
        """Pixels of the fine grid: all that fit into the image; into the period they must fit exactly."""
        counts = []
        for name, count in zip("xy", measured.shape, strict=True):
            length = count * measured.pixel_size
            exact = length / self.pixel_size
            near = round(exact)
            if abs(exact - near) > FITS and measured.periodic:
                raise InputError(
                    f"pixel_size = {self.pixel_size:g} nm: the period along {name}, {length:.8g} nm, is no whole "
                    f'number of pixels; give pixel_size = "{length / near:.8g} nm"'
                )
            counts.append(near if abs(exact - near) <= FITS else math.floor(exact))
        return counts[0], counts[1]

    def draw(self, figure: str, axes: Axes, results: Sequence[Any]) -> None:
        """The spectra before and after, of one result or of several."""
        for result in results:
            record = _recorded(result)
            # a tip that carries this surface is another one
            if result.surface is not None and (
                record is None or "roughened" in result.surface.provenance
            ):
                q, density = result.surface.psd(_BINS)
                filled = density > 1e-12 * density.max(initial=0.0)
                axes.loglog(
                    q[filled],
                    density[filled],
                    color=result.color,
                    label=f"{result.label}, carried on",
                )
            if record is None:
                continue
            before = record["spectrum"]
            axes.loglog(
                before["q"],
                before["density"],
                "o",
                ms=3,
                mfc="none",
                color=result.color,
                label="measured image",
            )
            law = np.array(
                [record["fit_from_q"], 2 * math.pi / result.component.shortest]
            )
            fitted = record["density"] * (law / record["join"]) ** (
                -2 - 2 * record["hurst"]
            )
            axes.loglog(
                law,
                fitted,
                "--",
                color="0.2",
                lw=1,
                zorder=3,
                label=f"H = {record['hurst']:.2f}",
            )
            axes.axvline(record["join"], color="0.6", lw=0.8)
        axes.set(xlabel="wavenumber q (1/nm)", ylabel="power spectral density C (nm⁴)")
        figures.legend(axes)


@lru_cache(maxsize=2)
def _planned(maker: Roughened, measured: Surface) -> _Plan:
    """The last ones are kept: for the estimate of a scene, and for every place of a tip."""
    return maker.plan(measured)


def _recorded(result: Any) -> dict[str, Any] | None:
    """What a plan noted with the surface of a result or its contact, or with a part of a tip; None where
    neither has it."""
    records = [result.surface.provenance] if result.surface is not None else []
    if result.contact is not None:
        records.append(result.contact.provenance.get("surface"))
    while records:
        part = records.pop(0)
        if not isinstance(part, Mapping):
            continue
        if "roughened" in part:
            return part["roughened"]
        records += part.values()
    return None


class _Plan(NamedTuple):
    """What a continuation adds to an image, and what it takes from it."""

    measured: Surface
    #: of the fine grid
    shape: tuple[int, int]
    #: wavenumber from which on the image is not used, 1/nm
    join: float
    law: PowerLaw
    #: of the image
    spectrum: Binned
    #: the part that is trusted, tip and noise corrected
    data: Binned

    def added(
        self,
        shape: tuple[int, int],
        pixel_size: float,
        waves: tuple[float, float],
        seed: np.random.SeedSequence,
    ) -> NDArray[np.complex128]:
        """The half spectrum of the continuation between two wavenumbers (1/nm), on a grid."""
        nx, ny = shape
        longest = 2.0 * math.pi / (max(nx, ny) * pixel_size)
        # amplitudes are those of a Gaussian surface, not scaled to meet a roughness; noise has a mean square of 2
        return half_spectrum(
            shape,
            seed,
            hurst=self.law.hurst,
            roll=self.join / longest,
            long=waves[0] / longest,
            short=waves[1] / longest,
            scale=math.sqrt(0.5 * float(self.law(self.join)) * nx * ny) / pixel_size,
        )

    def added_slope(self, shortest: float) -> float:
        """rms slope of the continuation: h'² = ∫ C q³ dq/(2π)."""
        power = 2 - 2 * self.law.hurst
        ratio = 2 * math.pi / shortest / self.join
        integral = math.log(ratio) if power < 1e-9 else (ratio**power - 1) / power
        return math.sqrt(
            float(self.law(self.join)) * self.join**4 * integral / (2 * math.pi)
        )

    def added_height(self, shortest: float) -> float:
        """rms height of the continuation, nm: h² = ∫ C q dq/(2π)."""
        power = -2 * self.law.hurst
        ratio = 2 * math.pi / shortest / self.join
        integral = math.log(ratio) if power > -1e-9 else (ratio**power - 1) / power
        return math.sqrt(
            float(self.law(self.join)) * self.join**2 * integral / (2 * math.pi)
        )

    def waves(self) -> tuple[NDArray[np.complex128], NDArray[np.bool_]]:
        """The half spectrum of a periodic image, and which of its waves stay."""
        half = np.asarray(
            sfft.rfft2(
                self.measured.heights.astype(np.float64), workers=threads.available()
            )
        )
        return half, wavenumbers(
            self.measured.shape, self.measured.pixel_size
        ) < self.join * (1 - 1e-9)

    def with_image(self, half: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The half spectrum of the continuation and the waves of a periodic image that stay."""
        (nx, ny), (mx, my) = self.measured.shape, self.shape
        image, kept = self.waves()
        width = max(half.shape[1], image.shape[1])
        result = np.zeros((mx, width), dtype=np.complex128)
        result[:, : half.shape[1]] = half
        rows = np.rint(np.fft.fftfreq(nx) * nx).astype(np.int64) % mx
        x, y = np.nonzero(kept)
        result[rows[x], y] = image[x, y] * (mx * my / (nx * ny))
        return result

    def series(self) -> Floats:
        """Amplitudes of the cosine series of an image, waves from ``join`` on left out."""
        heights = self.measured.heights.astype(np.float64)
        series = np.asarray(
            sfft.dctn(heights, type=2, norm="forward", workers=threads.available())
        )
        series[1:] *= 2
        series[:, 1:] *= 2
        series[self.cosine_waves() >= self.join * (1 - 1e-9)] = 0.0
        return series

    def cosine_waves(self) -> Floats:
        """Wavenumbers of the cosines, (nx, ny) 1/nm."""
        qx, qy = (
            np.arange(float(n)) * (math.pi / self.measured.pixel_size / n)
            for n in self.measured.shape
        )
        return np.hypot(qx[:, None], qy)

    def completed(self, seed: Seed) -> Floats:
        """These amplitudes, with random ones where the alignment of scan lines took them."""
        series, lost = self.series(), self.lost()
        random = np.random.Generator(np.random.Philox(stream(seed, _STREAM, 0)))
        series[: len(lost)] = np.where(
            lost > 0, lost * random.standard_normal(lost.shape), series[: len(lost)]
        )
        return series

    def places(
        self,
        shape: tuple[int, int],
        pixel_size: float,
        first: tuple[int, int] = (0, 0),
    ) -> tuple[Floats, Floats]:
        """x and y of the centres of the pixels from ``first`` on, nm."""
        (nx, ny), (x, y) = shape, first
        return (
            (np.arange(float(x), x + nx) + 0.5) * pixel_size,
            (np.arange(float(y), y + ny) + 0.5) * pixel_size,
        )

    def cosines(self, series: Floats, x: Floats, y: Floats) -> Floats:
        """The sum of cosines with these amplitudes at ``x`` and ``y``, nm: (len(x), len(y))."""
        at_x, at_y = (
            np.cos(np.outer(at, np.pi * np.arange(n) / (n * self.measured.pixel_size)))
            for n, at in zip(series.shape, (x, y), strict=True)
        )
        return at_x @ series @ at_y.T

    def lost(self) -> Floats:
        """Standard deviations (nm) of the amplitudes that the alignment of scan lines took from the image, by its
        density at other directions: those that hardly change along a line, (waves along x, ny); 0 where the image has
        them."""
        steps = self.measured.provenance.get("steps", ())
        lines = next((step["lines"] for step in steps if step["step"] == "lines"), None)
        rows = {None: 0, "linear": 2, "quadratic": 3}.get(lines, 1)
        q = self.cosine_waves()[:rows]
        density = np.exp(
            np.interp(
                np.log(np.maximum(q, 1e-300)),
                np.log(self.data.q),
                np.log(self.data.density),
            )
        )
        area = self.measured.nominal_area
        # a cosine along both axes has four wave vectors, one along an axis two that others share
        variance = density / area * np.where(np.arange(rows)[:, None] == 0, 1.0, 4.0)
        variance[q >= self.join * (1 - 1e-9)] = 0.0
        variance[:, 0] = 0.0
        return np.sqrt(variance)

    def kept_slope(self) -> float:
        """rms slope of the waves of the image that stay, with what was lost between its lines."""
        if self.measured.periodic:
            half, kept = self.waves()
            half[~kept] = 0.0
            low = np.asarray(
                sfft.irfft2(half, s=self.measured.shape, workers=threads.available())
            )
            return roughness.rms_slope(low, self.measured.pixel_size, True)
        series, lost = self.series(), self.lost()
        series[: len(lost)][lost > 0] = 0.0
        places = self.places(self.measured.shape, self.measured.pixel_size)
        low = self.cosines(series, *places)
        q = self.cosine_waves()[: len(lost)]
        share = np.where(np.arange(len(lost))[:, None] == 0, 2.0, 4.0)
        return math.hypot(
            roughness.rms_slope(low, self.measured.pixel_size, False),
            math.sqrt(float((lost**2 * q**2 / share).sum())),
        )

    def record(self) -> dict[str, Any]:
        """Plain JSON values: what was fitted, and the spectrum of the image."""
        law, spectrum = self.law, self.spectrum
        positive = spectrum.density > 0
        return {
            "hurst": law.hurst,
            "hurst_error": law.hurst_error,
            "density": float(law(self.join)),
            "density_relative_error": law.density_error,
            "join": self.join,
            "fit_from_q": law.lowest,
            "misfit": law.misfit,
            "measured_pixel_size": self.measured.pixel_size,
            "spectrum": {
                "q": spectrum.q[positive].tolist(),
                "density": spectrum.density[positive].tolist(),
            },
        }
