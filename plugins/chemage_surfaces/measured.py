"""A measured image, with every step from the file to the surface."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import model_validator

from chemage import InputError, Surface
from chemage.plugin import Length, Reader, Seed, Unit, memory, reader_for
from chemage_surfaces import _steps
from chemage_surfaces._maps import (
    SQUARE,
    HeightUnit,
    ImageMaker,
    PixelSides,
    Stamp,
    content_hash,
    in_nm,
    provenance,
    stamp,
    stated,
)

#: an image is a grid of at least this many pixels along each side
FEWEST = 4
#: of the heights
MOST_MISSING = 0.5
#: rms slopes outside are those of a wrong unit
SLOPES = (1e-8, 10.0)
_DEGREES = {"mean": 0, "plane": 1, "quadratic": 2}
_Coordinate = Annotated[float, Unit("nm", ge=0)]


class Measured(ImageMaker):
    """A measured image and the steps that make a surface of it, in the order of the options: units, crop, spikes,
    missing heights, trend, pixels, window.

    No step is taken that is not asked for: an image with missing heights, spikes, pixels that are not square, or units
    that nobody states is refused with the option that helps. ``provenance["steps"]`` records what each step did.
    """

    kind = "measured"

    height_unit: HeightUnit | None = None
    """unit of the heights in the file, such as "um", or a factor that converts them to nm; overrides the unit in the
    file, and is required if the file has none"""
    pixel_size: PixelSides | None = None
    """edge of a pixel, nm, or both edges [along x, along y]; overrides the size in the file, and is required if the
    file has none"""
    crop: tuple[_Coordinate, _Coordinate, Length, Length] | None = None
    """part to use, [x, y, width, height] in nm from the first pixel, rounded to whole pixels; None: all"""
    spikes: Literal["refuse", "keep", "interpolate"] = "refuse"
    """what to do with spikes, that is pixels far from the median around them: refuse the image, keep them, or treat
    them as missing and interpolate"""
    spike_threshold: Annotated[float, Unit("", ge=3, le=1e6)] = 15.0
    """distance of a spike from the median of the 5 x 5 pixels around it, in robust standard deviations of such
    distances"""
    missing: Literal["refuse", "interpolate"] = "refuse"
    """what to do with missing heights: refuse the image, or solve Laplace's equation in the gaps"""
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
        reader = self.reader or reader_for(self.path)
        return _made(self, reader, stamp(self.path))  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=2)
def _made(maker: Measured, reader: Reader, stamp: Stamp) -> Surface:
    """The surfaces that were made last are kept: for the estimate of a scene, and for every contact of a sweep."""
    content = content_hash(maker.path, stamp)
    image = reader.height_map(maker.path)
    unit, sides = stated(image, maker.height_unit or image.height_unit, maker.pixel_size or image.pixel_size)
    _check_shape(image.heights.shape, image.source)
    memory.require(12 * 8.0 * image.heights.size, image.source, "crop the file in the program that wrote it")
    periodic = image.periodic if maker.periodic is None else maker.periodic
    steps: list[dict[str, Any]] = [
        {"step": "read", "reader": reader.kind, "height_unit_nm": unit, "pixel_size_nm": list(sides), **image.notes}
    ]
    heights = in_nm(image.heights.astype(np.float64), unit)
    heights[~np.isfinite(heights)] = np.nan
    if maker.crop is not None:
        try:
            heights, taken = _steps.cropped(heights, sides, maker.crop)
        except ValueError as error:
            raise InputError(f"crop = {list(maker.crop)}: {error}") from None
        periodic = periodic and heights.shape == image.heights.shape
        _check_shape(heights.shape, f"crop = {list(maker.crop)}")
        steps.append({"step": "crop", "first_pixel": taken[:2], "pixels": taken[2:]})
    heights = _complete(maker, heights, image.source, periodic, steps)
    if maker.detrend != "none":
        if periodic and maker.detrend != "mean":
            raise InputError(
                f"detrend = {maker.detrend!r}: {image.source} is periodic, and without this trend its edges would not "
                'fit; give "mean" or "none", or periodic = false'
            )
        trend = _steps.trend(heights, _DEGREES[maker.detrend])
        heights = heights - trend
        steps.append({"step": "detrend", "trend": maker.detrend, "range_nm": float(np.ptp(trend))})
    heights, side = _square(maker, heights, sides, image.source, periodic, steps)
    if maker.window != "none" and not periodic:
        heights = _steps.hann(heights) if maker.window == "hann" else _steps.mirrored(heights)
        steps.append({"step": "window", "window": maker.window})
    elif maker.window != "none":
        raise InputError(f"window = {maker.window!r}: {image.source} is periodic already; leave it out")
    heights.setflags(write=False)
    surface = Surface(
        heights=heights,
        pixel_size=side,
        periodic=periodic or maker.window != "none",
        provenance={**provenance(maker), "reader": reader.kind, "file_blake2b": content, "steps": steps},
    )
    slope = surface.rms_slope
    if slope and not SLOPES[0] <= slope <= SLOPES[1]:
        raise InputError(
            f"{image.source}: an rms slope of {slope:.3g} (heights of {surface.rms_height:.3g} nm rms on pixels of "
            f"{side:.3g} nm) is not that of a surface; one of the units is wrong: give height_unit and pixel_size"
        )
    return surface


def _check_shape(shape: tuple[int, ...], what: str) -> None:
    if min(shape) < FEWEST:
        raise InputError(
            f"{what}: {shape[0]} x {shape[1]} pixels are no image; give an image of at least {FEWEST} x {FEWEST} pixels"
        )


def _complete(
    maker: Measured, heights: np.ndarray, source: str, periodic: bool, steps: list[dict[str, Any]]
) -> np.ndarray:
    """Without spikes and gaps, or refused."""
    gaps = ~np.isfinite(heights)
    missing = int(gaps.sum())
    if missing > MOST_MISSING * heights.size:
        raise InputError(
            f"{source}: {missing} of {heights.size} heights are missing, which is too many to interpolate; crop the "
            "image to a part that was measured"
        )
    if missing and maker.missing == "refuse":
        first = np.argwhere(gaps)[0]
        raise InputError(
            f"{source}: {missing} of {heights.size} heights are missing, the first at pixel ({first[0]}, {first[1]}); "
            'give missing = "interpolate", or crop the image'
        )
    if maker.spikes != "keep":
        spikes = _steps.find_spikes(heights, maker.spike_threshold, periodic)
        count = int(spikes.sum())
        if count and maker.spikes == "refuse":
            first = np.argwhere(spikes)[0]
            raise InputError(
                f"{source}: {count} of {heights.size} pixels are spikes, the first at pixel ({first[0]}, {first[1]}), "
                f"more than {maker.spike_threshold:g} robust standard deviations from the median around it; give "
                'spikes = "interpolate" to replace them, or spikes = "keep" if they are part of the surface'
            )
        if count:
            heights = np.where(spikes, np.nan, heights)
            steps.append({"step": "spikes", "replaced": count})
    if missing:
        steps.append({"step": "missing", "interpolated": missing})
    try:
        return _steps.filled(heights, periodic)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None


def _square(
    maker: Measured,
    heights: np.ndarray,
    sides: tuple[float, float],
    source: str,
    periodic: bool,
    steps: list[dict[str, Any]],
) -> tuple[np.ndarray, float]:
    """On square pixels, or refused; and their edge."""
    dx, dy = sides
    if maker.resample is None:
        if abs(dx - dy) > SQUARE * dx:
            raise InputError(
                f"{source}: pixels of {dx:.6g} x {dy:.6g} nm are not square; give resample = "
                f'"{min(dx, dy):.6g} nm", or pixel_size if these lengths are wrong'
            )
        return heights, dx
    pixels = heights.shape[0] * dx * heights.shape[1] * dy / maker.resample**2
    memory.require(8 * 8.0 * pixels, f"resample = {maker.resample:g} nm", "give larger pixels")
    try:
        new = _steps.resampled(heights, sides, maker.resample, periodic)
    except ValueError as error:
        raise InputError(f"resample = {maker.resample:g} nm: {error}") from None
    steps.append({"step": "resample", "pixel_size_nm": maker.resample, "pixels": list(new.shape)})
    return new, maker.resample
