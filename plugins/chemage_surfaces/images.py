"""Surfaces from files: a height map as it is (``from-file``), or an image with every step to a surface
(``measured``)."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import model_validator

from chemage import InputError, Surface
from chemage.plugin import FileStamp, Length, Reader, Seed, Unit, file_hash, file_stamp, memory, reader_for
from chemage_surfaces._maps import (
    SQUARE,
    Floats,
    HeightUnit,
    ImageMaker,
    PixelSides,
    in_nm,
    provenance,
    same_pixels,
    stated,
    surface_of,
)
from chemage_surfaces.readers import Unitless
from chemage_surfaces.steps import (
    cropped,
    filled,
    find_scars,
    find_spikes,
    hann,
    line_offsets,
    mirrored,
    resampled,
    trend,
)


class FromFile(ImageMaker):
    """Heights from a file; higher points are nearer to the counter-body.

    The ending of the file selects one of the installed readers, unless ``reader`` is given. A map is not periodic
    unless the file or ``periodic`` states that it is.
    """

    kind = "from-file"

    pixel_size: Length | None = None
    """edge of a pixel, nm; required if the file states none, and refused if it states another"""
    height_unit: HeightUnit | None = None
    """unit of the heights in the file, such as "um", or a factor that converts them to nm; None: as the file states,
    else nm"""
    detrend: Literal["none", "mean", "plane"] = "none"
    """trend to subtract: none, the mean height, or the least-squares plane"""
    periodic: bool | None = None
    """whether the map is periodic; None: as the file states, else not"""

    def make(self, seed: Seed = 0) -> Surface:
        """The surface in the file, which is read once as long as it does not change. ``seed`` is ignored.

        Raises
        ------
        StoreError
            The file is missing, truncated or not in the format of the reader, or no reader accepts its ending.
        InputError
            Several readers accept the ending, the pixel size is unknown, or heights are not finite.
        """
        reader = self.reader or reader_for(self.path)
        return _read(self, reader, file_stamp(self.path))  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=1)
def _read(maker: FromFile, reader: Reader, stamp: FileStamp) -> Surface:
    """The surface that was read last is kept: for the estimate of a scene, and for every contact of a sweep."""
    content = file_hash(maker.path, stamp)
    image = reader.height_map(maker.path)
    sides = image.pixel_size
    if maker.pixel_size is not None:
        sides = (maker.pixel_size, maker.pixel_size)
        same_pixels(image, sides)
    unit = maker.height_unit or image.height_unit or (1.0 if isinstance(reader, Unitless) else None)
    surface = surface_of(replace(image, height_unit=unit, pixel_size=sides))
    heights = surface.heights
    if maker.detrend != "none":
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
            heights = _without_trend(heights, plane=maker.detrend == "plane")
    return Surface(
        heights=heights,
        pixel_size=surface.pixel_size,
        periodic=surface.periodic if maker.periodic is None else maker.periodic,
        provenance={**provenance(maker), "reader": reader.kind, "file_blake2b": content},
    )


def _without_trend(heights: np.ndarray, *, plane: bool) -> np.ndarray:
    """Subtract the mean of the heights, or their least-squares plane."""
    result = heights - heights.mean(dtype=np.float64)
    if plane:
        # on a full grid the two tilts and the mean are orthogonal, so that each is a separate projection
        for axis, count in enumerate(heights.shape):
            x = np.arange(count) - 0.5 * (count - 1)
            if count > 1:
                tilt = (x @ result.mean(axis=1 - axis)) / (x @ x)
                result -= (tilt * x)[:, None] if axis == 0 else (tilt * x)[None, :]
    return result.astype(heights.dtype, copy=False)


#: an image is a grid of at least this many pixels along each side
FEWEST = 4
#: of the heights
MOST_MISSING = 0.5
#: shares of the heights that are interpolated where nothing else is asked for
FEW_SPIKES, FEW_MISSING = 1e-3, 0.05
#: rms slopes outside are those of a wrong unit
SLOPES = (1e-8, 10.0)
_DEGREES = {"mean": 0, "plane": 1, "quadratic": 2}
_Coordinate = Annotated[float, Unit("nm", ge=0)]


class Measured(ImageMaker):
    """A measured image and the steps that make a surface of it, in the order of the options: units, crop, lines, scars,
    spikes, missing heights, trend, pixels, window.

    A few spikes (up to 0.1 % of the pixels) and missing heights (up to 5 %) are interpolated with a warning that counts
    them. No other step is taken that is not asked for: an image with more of them, with pixels that are not square, or
    with units that nobody states is refused with the option that helps. ``provenance["steps"]`` records what each step
    did. Scan lines run along x.
    """

    kind = "measured"

    height_unit: HeightUnit | None = None
    """unit of the heights in the file, such as "um", or a factor that converts them to nm; overrides the unit in the
    file, and is required if the file has none"""
    pixel_size: PixelSides | None = None
    """edge of a pixel, nm, or both edges [along x, along y]; required if the file states none, and refused if it states
    others"""
    crop: tuple[_Coordinate, _Coordinate, Length, Length] | None = None
    """part to use, [x, y, width, height] in nm from the first pixel, rounded to whole pixels; None: all"""
    lines: Literal["none", "differences", "constant", "linear", "quadratic"] = "none"
    """how to align scan lines: not, by the medians of the differences from line to line, or by subtracting a polynomial
    from each, without the points far from it"""
    scars: Literal["keep", "interpolate"] = "keep"
    """what to do with scars, that is stretches of up to three scan lines that lie off the lines on both sides"""
    spikes: Literal["few", "refuse", "keep", "interpolate"] = "few"
    """what to do with spikes, that is pixels far from the median around them: interpolate up to 0.1 % of the pixels and
    refuse more, refuse any, keep them, or interpolate all"""
    spike_threshold: Annotated[float, Unit("", ge=3, le=1e6)] = 15.0
    """distance of a spike from the median of the 5 x 5 pixels around it, in robust standard deviations of such
    distances"""
    missing: Literal["few", "refuse", "interpolate"] = "few"
    """what to do with missing heights: solve Laplace's equation in the gaps of up to 5 % of the heights and refuse
    more, refuse any, or solve it in all"""
    detrend: Literal["none", "mean", "plane", "quadratic"] = "none"
    """trend to subtract: none, the mean height, or the least-squares plane or paraboloid"""
    resample: Length | None = None
    """edge of square pixels to average over or to interpolate to, nm; None: as they are, and they must be square"""
    window: Literal["none", "hann", "mirror"] = "none"
    """how to make the image periodic: not, by a Hann window over the heights about their mean (same rms height, flat
    edges), or by mirror images beyond two edges (twice the pixels along each side)"""
    periodic: bool | None = None
    """whether the image is one period; None: as the file states, else not; a window makes it periodic"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.window != "none" and self.periodic is not None:
            raise ValueError(
                f"window = {self.window!r}, periodic = {self.periodic}: a window makes an image periodic that is not; "
                "leave out one of them"
            )
        return self

    def make(self, seed: Seed = 0) -> Surface:
        """The surface, made once as long as the file does not change. ``seed`` is ignored.

        Raises
        ------
        StoreError
            The file is missing, truncated or not in the format of the reader, or no reader accepts its ending.
        InputError
            The image needs a step that was not asked for, or units that are not stated; or an option does not fit it.
        """
        surface, fault = _made(self, *self._opened())  # pyright: ignore[reportArgumentType]
        if surface is None:
            raise InputError(fault)
        return surface

    def image(self) -> Image:
        """The image after all steps that it allows: also where heights are missing, spikes are left or pixels are not
        square, so that it makes no surface. Errors as of :meth:`make`, but for these."""
        return _prepared(self, *self._opened())

    def retrace(self) -> Surface | None:
        """The image of the other direction of the scan lines after the same steps; None where the file has none that
        makes a surface. Its difference is the noise."""
        find = getattr(self._opened()[0], "retrace", None)
        other = None if find is None else find(self.path)
        if other is None:
            return None
        image = self.replace(reader=other, spikes="interpolate").image()
        if image.faults:
            return None
        return Surface(
            heights=image.heights,
            pixel_size=image.sides[0],
            periodic=image.periodic,
            provenance={"channel": image.steps[0].get("channel", "")},
        )

    def _opened(self) -> tuple[Reader, FileStamp]:
        reader: Any = self.reader or reader_for(self.path)
        return reader, file_stamp(self.path)


@dataclass(frozen=True, eq=False)
class Image:
    """An image on its way to a surface."""

    #: (nx, ny) nm, nan where they are missing
    heights: Floats
    #: edges of a pixel along x and y, nm
    sides: tuple[float, float]
    periodic: bool
    #: what was done, as plain JSON values
    steps: list[dict[str, Any]]
    #: why it is no surface yet, each with the option that helps
    faults: list[str]


@lru_cache(maxsize=2)
def _made(maker: Measured, reader: Reader, stamp: FileStamp) -> tuple[Surface | None, str]:
    """The surface, or None and the reason. Those that were made last are kept: for the estimate of a scene, and for
    every contact of a sweep."""
    image = _prepared(maker, reader, stamp)
    if image.faults:
        return None, image.faults[0]
    image.heights.setflags(write=False)
    return Surface(
        heights=image.heights,
        pixel_size=image.sides[0],
        periodic=image.periodic,
        provenance={
            **provenance(maker),
            "reader": reader.kind,
            "file_blake2b": file_hash(maker.path, stamp),
            "steps": image.steps,
        },
    ), ""


def _prepared(maker: Measured, reader: Reader, stamp: FileStamp) -> Image:
    image = reader.height_map(maker.path)
    if maker.pixel_size is not None:
        same_pixels(image, maker.pixel_size)
    unit, sides = stated(image, maker.height_unit or image.height_unit, maker.pixel_size or image.pixel_size)
    memory.require(12 * 8.0 * image.heights.size, image.source, "crop the file in the program that wrote it")
    periodic = image.periodic if maker.periodic is None else maker.periodic
    steps: list[dict[str, Any]] = [
        {"step": "read", "reader": reader.kind, "height_unit_nm": unit, "pixel_size_nm": list(sides), **image.notes}
    ]
    heights = in_nm(image.heights.astype(np.float64), unit)
    heights[~np.isfinite(heights)] = np.nan
    what = image.source
    if maker.crop is not None:
        try:
            heights, taken = cropped(heights, sides, maker.crop)
        except ValueError as error:
            raise InputError(f"crop = {list(maker.crop)}: {error}") from None
        periodic = periodic and heights.shape == image.heights.shape
        what = f"crop = {list(maker.crop)}"
        steps.append({"step": "crop", "first_pixel": taken[:2], "pixels": taken[2:]})
    nx, ny = heights.shape
    if min(nx, ny) < FEWEST:
        faults = [f"{what}: {nx} x {ny} pixels are no image; give an image of at least {FEWEST} x {FEWEST} pixels"]
        return Image(heights, sides, periodic, steps, faults)
    faults: list[str] = []
    heights = _aligned(maker, heights, periodic, image.source, steps)
    heights = _complete(maker, heights, image.source, periodic, steps, faults)
    if maker.detrend != "none":
        if periodic and maker.detrend != "mean":
            raise InputError(
                f"detrend = {maker.detrend!r}: {image.source} is periodic, and without this trend its edges would not "
                'fit; give "mean" or "none", or periodic = false'
            )
        subtracted = trend(heights, _DEGREES[maker.detrend])
        heights = heights - subtracted
        steps.append({"step": "detrend", "trend": maker.detrend, "range_nm": float(np.ptp(subtracted))})
    heights, sides = _square(maker, heights, sides, image.source, periodic, steps, faults)
    if maker.window != "none" and periodic:
        raise InputError(f"window = {maker.window!r}: {image.source} is periodic already; leave it out")
    if maker.window != "none" and not faults:
        heights = hann(heights) if maker.window == "hann" else mirrored(heights)
        periodic = True
        steps.append({"step": "window", "window": maker.window})
    if not faults:
        surface = Surface(heights=heights, pixel_size=sides[0], periodic=periodic)
        slope = surface.rms_slope
        if slope and not SLOPES[0] <= slope <= SLOPES[1]:
            faults.append(
                f"{image.source}: an rms slope of {slope:.3g} (heights of {surface.rms_height:.3g} nm rms on pixels of "
                f"{sides[0]:.3g} nm) is not that of a surface; one of the units is wrong: give height_unit and "
                "pixel_size"
            )
    return Image(heights, sides, periodic, steps, faults)


def _aligned(maker: Measured, heights: Floats, periodic: bool, source: str, steps: list[dict[str, Any]]) -> Floats:
    """With scan lines aligned and without scars, as far as they were asked for."""
    if maker.lines != "none":
        if periodic:
            raise InputError(
                f"lines = {maker.lines!r}: {source} is periodic, and aligned lines would not fit at its edges; leave "
                "it out, or give periodic = false"
            )
        offsets = line_offsets(heights, {"constant": 0, "linear": 1, "quadratic": 2}.get(maker.lines))
        heights = heights - offsets
        steps.append({"step": "lines", "lines": maker.lines, "rms_nm": float(offsets.std())})
    if maker.scars == "interpolate":
        scars = find_scars(heights)
        heights = np.where(scars, np.nan, heights)
        steps.append({"step": "scars", "pixels": int(scars.sum())})
    return heights


def _complete(
    maker: Measured, heights: Floats, source: str, periodic: bool, steps: list[dict[str, Any]], faults: list[str]
) -> Floats:
    """Without spikes and gaps; those that are to be refused stay, with a fault."""
    scars = sum(step["pixels"] for step in steps if step["step"] == "scars")
    gaps = ~np.isfinite(heights)
    # scars were asked for
    missing = int(gaps.sum()) - scars
    left = missing > 0 and _refused(maker.missing, missing, FEW_MISSING * heights.size)
    if missing + scars > MOST_MISSING * heights.size:
        left = True
        faults.append(
            f"{source}: {missing + scars} of {heights.size} heights are missing, which is too many to interpolate; "
            "crop the image to a part that was measured"
        )
    elif left:
        first = np.argwhere(gaps)[0]
        faults.append(
            f"{source}: {missing} of {heights.size} heights are missing, the first at pixel ({first[0]}, {first[1]}); "
            'give missing = "interpolate", or crop the image'
        )
    elif missing > 0 and maker.missing == "few":
        _say_repaired(source, missing, heights.size, "missing", "heights are missing")
    if maker.spikes != "keep" and not gaps.all():
        spikes = find_spikes(heights, maker.spike_threshold, periodic)
        count = int(spikes.sum())
        if _refused(maker.spikes, count, FEW_SPIKES * heights.size):
            first = np.argwhere(spikes)[0]
            faults.append(
                f"{source}: {count} of {heights.size} pixels are spikes, the first at pixel ({first[0]}, {first[1]}), "
                f"more than {maker.spike_threshold:g} robust standard deviations from the median around it; give "
                'spikes = "interpolate" to replace them, or spikes = "keep" if they are part of the surface'
            )
        elif count:
            if maker.spikes == "few":
                _say_repaired(source, count, heights.size, "spikes", "pixels are spikes")
            heights = np.where(spikes, np.nan, heights)
            steps.append({"step": "spikes", "replaced": count})
    if left:
        return heights
    if missing > 0:
        steps.append({"step": "missing", "interpolated": missing})
    try:
        return filled(heights, periodic)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None


def _refused(action: str, count: int, few: float) -> bool:
    return count > {"refuse": 0, "few": few}.get(action, math.inf)


def _say_repaired(source: str, count: int, of: int, option: str, what: str) -> None:
    warnings.warn(
        f'{source}: {count} of {of} {what}, and interpolated; {option} = "interpolate" says that this is meant',
        UserWarning,
        stacklevel=2,
    )


def _square(
    maker: Measured,
    heights: Floats,
    sides: tuple[float, float],
    source: str,
    periodic: bool,
    steps: list[dict[str, Any]],
    faults: list[str],
) -> tuple[Floats, tuple[float, float]]:
    """On square pixels, or as it is, with a fault; and the edges of a pixel."""
    dx, dy = sides
    if maker.resample is None:
        if abs(dx - dy) > SQUARE * dx:
            faults.append(
                f"{source}: pixels of {dx:.6g} x {dy:.6g} nm are not square; give resample = "
                f'"{min(dx, dy):.6g} nm", or pixel_size if these lengths are wrong'
            )
        return heights, sides
    if faults:
        return heights, sides
    pixels = heights.shape[0] * dx * heights.shape[1] * dy / maker.resample**2
    memory.require(8 * 8.0 * pixels, f"resample = {maker.resample:g} nm", "give larger pixels")
    try:
        new = resampled(heights, sides, maker.resample, periodic)
    except ValueError as error:
        raise InputError(f"resample = {maker.resample:g} nm: {error}") from None
    steps.append({"step": "resample", "pixel_size_nm": maker.resample, "pixels": list(new.shape)})
    return new, (maker.resample, maker.resample)
