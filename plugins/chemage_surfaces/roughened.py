"""A measured surface carried on to smaller wavelengths than those measured."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy import fft as sfft

from chemage import InputError, Surface
from chemage.plugin import (
    CONTINUATIONS,
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
from chemage_surfaces._maps import (
    LARGEST_PART,
    Floats,
    Pair,
    Parts,
    provenance,
    stream,
)
from chemage_surfaces.continuation import HOLD, Continuation, Drawn
from chemage_surfaces.findings import PERIODIC, TERRACES, Finding, examined
from chemage_surfaces.generated import JACOBS, half_spectrum, heights_at, heights_of
from chemage_surfaces.spectra import DIRECTIONS, FEWEST, Binned, Modes, wavenumbers
from chemage_surfaces.trusted import TO_PIXELS, fitted_noise, trusted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: the fit starts at this many times the shortest wavelength of the image, or at the roll-off, unless ``fit_from`` is
#: given
FIT_RANGE = 16.0
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
    """A measured surface on finer pixels, with its spectrum carried on below what was measured.

    Waves of the image longer than ``resolution`` stay, with the density that tip and noise took or added corrected;
    periodic ones and terraces stay as they are. Shorter ones are replaced by random waves down to ``cutoff``. Their
    density goes on from the measured one between ``fit_from`` and ``resolution``, with the differences between
    directions that this has; how it may go on, if H is not given, is drawn (:meth:`members`): see
    :mod:`chemage_surfaces.continuation`. A periodic image is refined by its Fourier series; one that is not by the
    cosine series of the image (mirror images at its edges), and the random waves are periodic on the fine grid; waves
    that the alignment of scan lines took from it are random, with the density of the image in other directions.

    H, the density and the rms slope with their errors, and the spectrum of the image, are in
    ``provenance["roughened"]``.
    """

    kind = "roughened"
    cite = (
        "T. D. B. Jacobs, T. Junge, L. Pastewka, Surf. Topogr.: Metrol. Prop. 5, 013001 (2017)",
    )
    bibtex = (JACOBS,)
    figures = {
        "roughened-spectrum": "Power spectral density of the measured image (points) and of the surface carried on to "
        "smaller wavelengths (line). Dashed: the continuation, with the band that holds it with 90 %; the vertical line "
        "is the shortest wavelength taken from the image."
    }

    surface: Choice[SurfaceMaker]
    """the measured surface: a table with its ``kind`` and options"""
    pixel_size: Length
    """edge of the new pixels, such as the spacing of the sites, nm"""
    hurst: Annotated[Any, Unit("", ge=0, le=1)] | None = None
    """Hurst exponent H of the continuation, a power law; None: as the measured spectrum goes on"""
    cutoff: Length | None = None
    """shortest wavelength of the continuation, nm; None: two new pixels"""
    resolution: Length | None = None
    """shortest wavelength to take from the image, such as the resolution of the instrument, nm; None: as far as the
    image is trusted, that is to two pixels, or to where the tip, noise or the end of its spectrum decides"""
    tip_radius: Length | None = None
    """radius of the tip with which the image was taken, nm; None: as valleys that are sharper than peaks show it"""
    fit_from: Length | None = None
    """longest wavelength of the fit, nm; None: 16 times the shortest of the image, or the roll-off"""
    member: Annotated[int, Field(ge=0)] = 0
    """number of a continuation among those that the image allows; 0: the most probable one"""

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
            "rms_slope": plan.rms_slope(),
        }

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """Not known: the seed changes the waves that were not measured, and not the others."""
        source = "the seed changes only wavelengths that were not measured"
        return Scatter(None, source, CONTINUATIONS)

    def members(self, count: int) -> Sequence[Self]:
        """Other continuations that the image allows: quantiles of the rms slope, on which contacts depend most."""
        if self.member or not count:
            return []
        order = np.argsort(self._plan(self.surface.make()).slopes(), kind="stable")
        places = (np.arange(count) + 0.5) / count * len(order)
        numbers = order[places.astype(int)] + 1
        return [self.replace(member=number) for number in numbers.tolist()]

    @property
    def unknown(self) -> str:
        """That the tip is not among what is drawn where it is not known."""
        text = "the spectrum below what the image shows"
        if self.tip_radius is None and self.resolution is None:
            text += ", without what a tip took from it (tip_radius is not given)"
        return text

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
        series = plan.completed(seed)
        return Parts(
            shape=plan.shape,
            pixel_size=self.pixel_size,
            provenance=self._record(plan, seed),
            heights=partial(self._part, plan, series, seed),
            coarse=plan.image(
                series, *plan.places(measured.shape, measured.pixel_size)
            ),
            side=measured.pixel_size,
            unseen=partial(self._unseen, plan),
        )

    def _examined(self, seed: Seed) -> _Plan:
        """What is added to the image, of which warnings say what makes it doubtful."""
        plan = self._plan(self.surface.make(seed))
        for one in plan.findings:
            if one.consequence == "no fit" and one.kind not in (PERIODIC, TERRACES):
                warnings.warn(f"surface: {one.text}", UserWarning, stacklevel=3)
        return plan

    def _whole(self, plan: _Plan, seed: Seed) -> Surface:
        memory.require(
            6 * 8.0 * plan.shape[0] * plan.shape[1],
            f"pixel_size = {self.pixel_size:g} nm",
            "give larger pixels",
        )
        waves = (plan.join, 2 * math.pi / self.shortest)
        half = plan.added(plan.shape, self.pixel_size, waves, stream(seed, _STREAM))
        places = plan.places(plan.shape, self.pixel_size)
        if plan.measured.periodic:
            half = plan.with_image(half)
            heights = heights_of(half, plan.shape[1]) + plan.stairs_at(*places)
        else:
            image = plan.image(plan.completed(seed), *places)
            heights = image + heights_of(half, plan.shape[1])
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
        series: Floats,
        seed: Seed,
        first: Pair,
        shape: Pair,
        middle: Pair,
        step: int = 1,
    ) -> Floats:
        """See :attr:`Parts.heights`: each octave of long random waves has a period of its own, short ones share one."""
        size = self.pixel_size
        x, y = (
            (start + (np.arange(count) + 0.5) * step) * size
            for start, count in zip(first, shape, strict=True)
        )
        heights = plan.image(series, x, y)
        x, y = x - middle[0] * size, y - middle[1] * size
        least = max(LARGEST_PART, *shape) * size
        low, highest, octave = plan.join, 2 * math.pi / self.shortest, 0
        shown = min(self._shown(step), highest)
        while low < shown:
            period = max(least, 2 * math.pi * PERIODS / low)
            end = highest if period == least else min(2 * low, highest)
            high = min(end, shown)
            side = 2 * math.ceil(period * high / (2 * math.pi)) + 2
            key = stream(seed, _STREAM, 1, *middle, octave)
            half = plan.added((side, side), period / side, (low, high), key)
            heights += heights_at(half, side, (period, period), x, y)
            low, octave = end, octave + 1
        return heights

    def _shown(self, step: int) -> float:
        """The largest wavenumber that every ``step``-th pixel shows, 1/nm; infinite for all pixels."""
        return math.inf if step == 1 else math.pi / (2 * step * self.pixel_size)

    def _unseen(self, plan: _Plan, step: int) -> float:
        """See :attr:`Parts.unseen`."""
        low = self._shown(step) if step else plan.join
        return math.sqrt(plan.law.moment(1.0, plan.drawn, low))

    def _record(self, plan: _Plan, seed: Seed) -> dict[str, Any]:
        return {
            **provenance(self, seed),
            "measured": plan.measured.provenance,
            "roughened": {**plan.record(), "tip_radius": self.tip_radius},
        }

    def _plan(self, measured: Surface) -> _Plan:
        most_probable: Any = self.replace(member=0) if self.member else self
        plan = _planned(most_probable, measured)
        return plan._replace(drawn=plan.law.draw(self.member))

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
        findings = tuple(examined(measured))
        stairs, waves = None, None
        for one in findings:
            stairs = one.levels if one.kind == TERRACES else stairs
            waves = one.waves if one.kind == PERIODIC else waves
        whole = measured
        if stairs is not None:
            heights = measured.heights - stairs
            measured = Surface(
                heights=heights,
                pixel_size=side,
                periodic=measured.periodic,
                provenance=measured.provenance,
            )
        modes = Modes.of(measured, waves)
        spectrum = modes.binned()
        image = spectrum
        if stairs is not None or waves is not None:
            image = Binned.of(whole)
        part = trusted(
            measured,
            self.resolution,
            self.tip_radius,
            data=spectrum,
            with_noise=True,
        )
        data = part.data
        if not len(data.q):
            raise InputError(
                f"tip_radius: a tip of {part.radius:.4g} nm has changed all waves of the image; give a larger image, "
                "or resolution to use it as it is"
            )
        end = math.pi / side if part.limit == TO_PIXELS else float(data.q[-1])
        if self.resolution is not None:
            end = 2 * math.pi / self.resolution
        cut = spectrum.part(0, end).cut
        if cut is not None and self.resolution is not None:
            raise InputError(
                f"resolution = {self.resolution:g} nm: the spectrum of the image ends at a wavelength of "
                f"{2 * math.pi / cut:.4g} nm; give this resolution"
            )
        if end >= 2 * math.pi / self.shortest * (1 - 1e-9):
            raise InputError(
                f"cutoff = {self.shortest:g} nm: the image has waves down to {2 * math.pi / end:g} nm, so that nothing "
                "is left to add; give a shorter cutoff"
            )
        if self.fit_from is not None:
            lowest = 2 * math.pi / self.fit_from
        else:
            lowest = float(data.q[-1]) / FIT_RANGE
            if len(data.q) >= 3 * FEWEST and (data.density > 0).all():
                lowest = max(lowest, fitted_noise(data)[1])
        fitted = data.part(lowest, math.inf)
        if not len(fitted.q) or not (fitted.density > 0).all():
            raise InputError(
                f"fit_from = {2 * math.pi / lowest:g} nm, resolution = {2 * math.pi / end:g} nm: the image has no waves "
                "between them; give a longer fit_from, at most the side of the image"
            )
        floor = float(spectrum.density.min()) if self.resolution is None else 0.0
        shortest = 2 * math.pi / self.shortest
        law = Continuation.of(
            part, lowest, shortest, self.hurst, floor, end, measured.periodic
        )
        return _Plan(
            measured=measured,
            shape=self._fine_shape(measured),
            join=law.join,
            law=law,
            drawn=law.best,
            image_spectrum=image,
            spectrum=spectrum,
            directions=modes.directions(lowest, law.join),
            stairs=stairs,
            waves=waves,
            findings=findings,
        )

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
            added = record["continuation"]
            axes.loglog(
                added["q"],
                added["density"],
                "--",
                color="0.2",
                lw=1,
                zorder=3,
                label=f"H = {record['hurst']:.2f} ± {record['hurst_error']:.2f}",
            )
            band = (added["low"], added["high"])
            axes.fill_between(added["q"], *band, color="0.2", alpha=0.15, lw=0)
            axes.axvline(record["join"], color="0.6", lw=0.8)
        axes.set(
            xlabel="wavenumber q (1/nm)", ylabel="power spectral density C (nm⁴)"
        )
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

    #: without its terraces
    measured: Surface
    #: of the fine grid
    shape: Pair
    #: wavenumber from which on the image is not used, 1/nm
    join: float
    law: Continuation
    #: how the spectrum is taken to be
    drawn: Drawn
    #: of the image, and without its terraces and periodic parts
    image_spectrum: Binned
    spectrum: Binned
    #: the density by direction over its mean
    directions: Floats
    #: heights of its terraces, nm
    stairs: Floats | None
    #: wave vectors of periodic parts, 1/nm
    waves: Floats | None
    findings: tuple[Finding, ...]

    def added(
        self,
        shape: Pair,
        pixel_size: float,
        waves: tuple[float, float],
        seed: np.random.SeedSequence,
    ) -> NDArray[np.complex128]:
        """The half spectrum of the continuation between two wavenumbers (1/nm), on a grid."""
        nx, ny = shape
        unit = 2.0 * math.pi / (max(nx, ny) * pixel_size)

        def density(qx: Floats, qy: Floats) -> Floats:
            found = self.law.density(unit * np.hypot(qx, qy), self.drawn)
            return found * self.by_direction(qx, qy)

        # amplitudes are those of a Gaussian surface, not scaled to meet a roughness; noise has a mean square of 2
        return half_spectrum(
            shape,
            seed,
            density=density,
            long=waves[0] / unit,
            short=waves[1] / unit,
            scale=math.sqrt(0.5 * nx * ny) / pixel_size,
        )

    def by_direction(self, qx: Floats, qy: Floats) -> Floats | float:
        """The density over its mean over directions, at (nx, 1) and (ny,)."""
        if (self.directions == 1).all():
            return 1.0
        places = np.arange(DIRECTIONS) * (math.pi / DIRECTIONS)
        angle = np.arctan2(*np.broadcast_arrays(qy, qx))
        return np.interp(angle, places, self.directions, period=math.pi)

    def gain(self, q: Floats) -> Floats:
        """By what the waves of the image at ``q`` (1/nm) are multiplied, so that they have the corrected density; 0 from
        ``join`` on."""
        bins = np.log(self.law.part.data.q)
        added = self.law.correction(self.drawn)
        factor = np.exp(0.5 * np.interp(np.log(np.maximum(q, 1e-300)), bins, added))
        return np.where(q < self.join * (1 - 1e-9), factor, 0.0)

    def rms_slope(self) -> float:
        """rms slope of the surface."""
        return math.hypot(
            self.kept_slope(), math.sqrt(float(self.law.moment(3.0, self.drawn)))
        )

    def slopes(self) -> Floats:
        """Rms slopes of the draws."""
        law, kept = self.law, self.spectrum.part(0, self.join)
        added = law.moment(3.0, law.draws)
        if len(kept.q) < 2:
            return np.sqrt(self.kept_slope() ** 2 + added)
        share = kept.density * kept.q**3 * np.gradient(kept.q)
        own, drawn = (
            law.gain(kept.q, one) @ share for one in (self.drawn, law.draws)
        )
        return np.sqrt(self.kept_slope() ** 2 * drawn / own + added)

    def wave_spectrum(self) -> NDArray[np.complex128]:
        """The half spectrum of a periodic image, of the waves that stay."""
        half: Any = np.asarray(
            sfft.rfft2(
                self.measured.heights.astype(np.float64),
                workers=threads.available(),
            )
        )
        shape, side = self.measured.shape, self.measured.pixel_size
        factor = self.gain(wavenumbers(shape, side))
        self.keep(factor, 2 * math.pi / side / np.array(shape))
        return half * factor

    def keep(self, factor: Floats, steps: Floats) -> None:
        """Make the factors of periodic waves at least 1, in a grid of waves that are ``steps`` apart, 1/nm."""
        reach = 1 if self.measured.periodic else 3
        for wave in () if self.waves is None else np.rint(self.waves / steps):
            i, j = wave.astype(int).tolist()
            # cosines have no direction
            rows = np.arange(abs(i) - reach, abs(i) + reach + 1)
            columns = slice(max(abs(j) - reach, 0), abs(j) + reach + 1)
            for each in (rows, -rows) if self.measured.periodic else (rows,):
                place = each % len(factor), columns
                factor[place] = np.maximum(factor[place], 1.0)

    def with_image(self, half: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The half spectrum of the continuation and the waves of a periodic image that stay."""
        (nx, ny), (mx, my) = self.measured.shape, self.shape
        image = self.wave_spectrum()
        width = max(half.shape[1], image.shape[1])
        result = np.zeros((mx, width), dtype=np.complex128)
        result[:, : half.shape[1]] = half
        rows = np.rint(np.fft.fftfreq(nx) * nx).astype(np.int64) % mx
        x, y = np.nonzero(image)
        result[rows[x], y] = image[x, y] * (mx * my / (nx * ny))
        return result

    def series(self) -> Floats:
        """Amplitudes of the cosine series of an image, of the waves that stay."""
        heights = self.measured.heights.astype(np.float64)
        series = np.asarray(
            sfft.dctn(heights, type=2, norm="forward", workers=threads.available())
        )
        series[1:] *= 2
        series[:, 1:] *= 2
        factor = self.gain(self.cosine_waves())
        side = self.measured.pixel_size
        self.keep(factor, math.pi / side / np.array(self.measured.shape))
        return series * factor

    def cosine_waves(self) -> Floats:
        """Wavenumbers of the cosines, (nx, ny) 1/nm."""
        qx, qy = (
            np.arange(float(n)) * (math.pi / self.measured.pixel_size / n)
            for n in self.measured.shape
        )
        return np.hypot(qx[:, None], qy)

    def completed(self, seed: Seed) -> Floats:
        """The cosine series of the image, with random waves where the alignment of scan lines took them."""
        series, lost = self.series(), self.lost()
        random = np.random.Generator(np.random.Philox(stream(seed, _STREAM, 0)))
        series[: len(lost)] = np.where(
            lost > 0, lost * random.standard_normal(lost.shape), series[: len(lost)]
        )
        return series

    def image(self, series: Floats, x: Floats, y: Floats) -> Floats:
        """Heights of the image with this series at ``x`` and ``y`` (nm): (len(x), len(y))."""
        return self.cosines(series, x, y) + self.stairs_at(x, y)

    def stairs_at(self, x: Floats, y: Floats) -> Floats | float:
        """Heights of the terraces at ``x`` and ``y`` (nm), with edges as wide as a pixel of the image."""
        if self.stairs is None:
            return 0.0
        from scipy import ndimage

        places = np.meshgrid(
            *(at / self.measured.pixel_size - 0.5 for at in (x, y)), indexing="ij"
        )
        mode = "grid-wrap" if self.measured.periodic else "nearest"
        return ndimage.map_coordinates(self.stairs, places, order=1, mode=mode)

    def places(
        self, shape: Pair, pixel_size: float, first: Pair = (0, 0)
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
            np.cos(
                np.outer(at, np.pi * np.arange(n) / (n * self.measured.pixel_size))
            )
            for n, at in zip(series.shape, (x, y), strict=True)
        )
        return at_x @ series @ at_y.T

    def lost(self) -> Floats:
        """Standard deviations (nm) of the amplitudes that the alignment of scan lines took from the image, by its
        density at other directions: those that hardly change along a line, (waves along x, ny); 0 where the image has
        them."""
        steps = self.measured.provenance.get("steps", ())
        lines = next(
            (step["lines"] for step in steps if step["step"] == "lines"), None
        )
        rows = {None: 0, "linear": 2, "quadratic": 3}.get(lines, 1)
        q = self.cosine_waves()[:rows]
        data = self.law.part.data
        density = data.at(np.maximum(q, data.q[0]))
        area = self.measured.nominal_area
        # a cosine along both axes has four wave vectors, one along an axis two that others share
        variance = (
            density / area * np.where(np.arange(rows)[:, None] == 0, 1.0, 4.0)
        )
        variance[q >= self.join * (1 - 1e-9)] = 0.0
        variance[:, 0] = 0.0
        return np.sqrt(variance)

    def kept_slope(self) -> float:
        """rms slope of the waves of the image that stay, with what was lost between its lines."""
        side, periodic = self.measured.pixel_size, self.measured.periodic
        steps = 0.0
        if self.stairs is not None:
            squares = [np.mean(np.diff(self.stairs, axis=k) ** 2) for k in (0, 1)]
            steps = math.sqrt(float(sum(squares))) / side
        if periodic:
            low = np.asarray(
                sfft.irfft2(
                    self.wave_spectrum(),
                    s=self.measured.shape,
                    workers=threads.available(),
                )
            )
            return math.hypot(roughness.rms_slope(low, side, True), steps)
        series, lost = self.series(), self.lost()
        series[: len(lost)][lost > 0] = 0.0
        low = self.cosines(series, *self.places(self.measured.shape, side))
        q = self.cosine_waves()[: len(lost)]
        share = np.where(np.arange(len(lost))[:, None] == 0, 2.0, 4.0)
        return math.hypot(
            roughness.rms_slope(low, side, False),
            math.sqrt(float((lost**2 * q**2 / share).sum())),
            steps,
        )

    def record(self) -> dict[str, Any]:
        """Plain JSON values: what was fitted, and the spectrum of the image."""
        law, spectrum, q = self.law, self.image_spectrum, self.law.added
        positive = spectrum.density > 0
        logs = law.logs(q, law.draws)
        ends = (0.5 - HOLD / 2, 0.5 + HOLD / 2)
        low, high = np.exp(np.quantile(logs, ends, axis=0))
        hurst = law.hurst(law.draws)
        return {
            "hurst": float(law.hurst(law.best)),
            "hurst_error": float(hurst.std()),
            "density": float(law.density(q[:1], law.best)[0]),
            "density_relative_error": float(logs[:, 0].std()),
            "join": self.join,
            "fit_from_q": float(law.q[0]),
            "misfit": law.misfit,
            "noise": math.sqrt(float(law.best.noise)) / self.measured.pixel_size,
            "rms_slope": self.rms_slope(),
            "rms_slope_interval": np.quantile(self.slopes(), ends).tolist(),
            "measured_pixel_size": self.measured.pixel_size,
            "spectrum": {
                "q": spectrum.q[positive].tolist(),
                "density": spectrum.density[positive].tolist(),
            },
            "continuation": {
                "q": q.tolist(),
                "density": law.density(q, self.drawn).tolist(),
                "low": low.tolist(),
                "high": high.tolist(),
            },
        }
