"""Surfaces from files: a height map as it is (``from-file``), or an image with every step to a surface (``measured``).

The steps are plain functions of arrays: heights (nx, ny) in nm, nan where they are missing; lengths in nm.
"""

from __future__ import annotations

import math
import warnings
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
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
    stated,
)

#: more unknown heights than this are found by iteration instead of by elimination
MOST_ELIMINATED = 50_000


def cropped(
    heights: Floats, pixel_size: tuple[float, float], window: tuple[float, float, float, float]
) -> tuple[Floats, list[int]]:
    """The part (x, y, width, height) of an image, to whole pixels; and [first x, first y, pixels x, pixels y].

    Raises
    ------
    ValueError
        The window leaves the image.
    """
    taken = []
    for axis, name in enumerate("xy"):
        start, size, side = window[axis], window[axis + 2], pixel_size[axis]
        first, count = round(start / side), round(size / side)
        length = heights.shape[axis] * side
        if first + count > heights.shape[axis]:
            raise ValueError(
                f"{start:g} to {start + size:g} nm along {name}, but the image ends at {length:g} nm; "
                "give a part inside it"
            )
        if count < 1:
            raise ValueError(f"{size:g} nm along {name} is less than a pixel of {side:g} nm; give more")
        taken.append((first, count))
    (ix, nx), (iy, ny) = taken
    return np.ascontiguousarray(heights[ix : ix + nx, iy : iy + ny]), [ix, iy, nx, ny]


def find_spikes(heights: Floats, threshold: float, periodic: bool) -> NDArray[np.bool_]:
    """Pixels that differ from the median of the 5 x 5 pixels around them by more than ``threshold`` times the robust
    standard deviation (1.4826 times the median) of such differences, but at least 1 % of the standard deviation of the
    medians, and by more than twice the range of the medians around them.

    Features of up to 12 pixels are found; edges of steps and smooth peaks are no spikes.
    """
    from scipy import ndimage

    there = np.isfinite(heights)
    whole = heights
    if not there.all():
        nearest = ndimage.distance_transform_edt(~there, return_distances=False, return_indices=True)
        whole = heights[tuple(nearest)]  # pyright: ignore[reportArgumentType]
    # a slope goes on beyond the edges, where it would otherwise look like a feature
    padded = np.pad(whole, 2, mode="wrap") if periodic else np.pad(whole, 2, mode="reflect", reflect_type="odd")
    median = ndimage.median_filter(padded, size=5)
    local = (ndimage.maximum_filter(median, size=5) - ndimage.minimum_filter(median, size=5))[2:-2, 2:-2]
    smooth = median[2:-2, 2:-2]
    away = np.abs(whole - smooth)
    scale = max(1.4826 * float(np.median(away[there])), 0.01 * float(smooth.std()))
    # rounding of a flat image far from zero is no spike
    scale = max(scale, 1e-12 * float(np.abs(whole).max()))
    return there & (away > threshold * scale) & (away > 2 * local)


def filled(heights: Floats, periodic: bool) -> Floats:
    """Missing heights by harmonic interpolation: each is the mean of its four neighbours, so that no new maximum or
    minimum arises (discrete Laplace equation with the known heights as boundary values)."""
    from scipy import sparse
    from scipy.sparse import linalg

    missing = ~np.isfinite(heights)
    count = int(missing.sum())
    if not count:
        return heights
    nx, ny = heights.shape
    number = np.full(heights.shape, -1)
    number[missing] = np.arange(count)
    x, y = np.nonzero(missing)
    here = number[x, y]
    degree, around = np.zeros(count), np.zeros(count)
    rows, columns = [], []
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        i, j = x + dx, y + dy
        inside = np.ones(count, bool) if periodic else (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        i, j = i % nx, j % ny
        degree += inside
        other = inside & missing[i, j]
        rows.append(here[other])
        columns.append(number[i[other], j[other]])
        boundary = inside & ~missing[i, j]
        around[boundary] += heights[i[boundary], j[boundary]]
    row, column = np.concatenate(rows), np.concatenate(columns)
    matrix: Any = sparse.csc_matrix((-np.ones(row.size), (row, column)), shape=(count, count))
    matrix = (matrix + sparse.diags(degree)).tocsc()
    if count <= MOST_ELIMINATED:
        solution: Any = linalg.spsolve(matrix, around)
    else:
        from scipy import ndimage

        nearest = ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
        start = heights[tuple(nearest)][missing]  # pyright: ignore[reportArgumentType]
        # heights about their mean, so that the tolerance is one of the roughness
        level = float(start.mean())
        solution, failed = linalg.cg(matrix, around - matrix @ np.full(count, level), x0=start - level, rtol=1e-8)
        if failed:
            raise ValueError(f"{count} missing heights cannot be interpolated; crop the image")
        solution = solution + level
    result = heights.copy()
    result[missing] = solution
    return result


def trend(heights: Floats, degree: int) -> Floats:
    """The least-squares polynomial in x and y of total degree ``degree`` (0 mean, 1 plane, 2 paraboloid)."""
    across, along = (_polynomials(count, degree) for count in heights.shape)
    # on a full grid products of discrete orthogonal polynomials are orthogonal: each is a separate projection
    part = across @ heights @ along.T
    i, j = np.indices(part.shape)
    part[i + j > degree] = 0.0
    return across.T @ part @ along


def _polynomials(count: int, degree: int) -> Floats:
    """Orthonormal polynomials on ``count`` points, (degree + 1, count)."""
    x = (np.arange(count) - 0.5 * (count - 1)) / count
    orthogonal, _ = np.linalg.qr(np.vander(x, degree + 1, increasing=True))
    return np.ascontiguousarray(orthogonal.T)


def resampled(heights: Floats, pixel_size: tuple[float, float], side: float, periodic: bool) -> Floats:
    """Means over square pixels of edge ``side``: the cubic spline through the integral of the heights along each axis,
    differenced at the new edges, so that volume is conserved and coarser pixels are averages.

    Raises
    ------
    ValueError
        The image repeats, and its period is no whole number of pixels; or fewer than four pixels would remain.
    """
    for axis, old in enumerate(pixel_size):
        count = heights.shape[axis]
        exact = count * old / side
        fits = abs(exact - round(exact)) < 1e-6 * max(exact, 1.0)
        if periodic and not fits:
            near = max(round(exact), 1)
            raise ValueError(
                f"the period along {'xy'[axis]}, {count * old:.9g} nm, is no whole number of pixels of {side:g} nm; "
                f"give {count * old / near:.9g} nm"
            )
        new = round(exact) if fits else math.floor(exact)
        if new < 4:
            raise ValueError(f"leaves {new} pixels of {side:g} nm along {'xy'[axis]}; give smaller pixels")
        if new == count and fits:
            continue
        heights = _averaged(np.moveaxis(heights, axis, 0), old, side, new, periodic)
        heights = np.moveaxis(heights, 0, axis)
    return np.ascontiguousarray(heights)


def _averaged(rows: Floats, old: float, side: float, count: int, periodic: bool) -> Floats:
    from scipy.interpolate import CubicSpline

    level = rows.mean(axis=0)
    integral = np.zeros((rows.shape[0] + 1, *rows.shape[1:]))
    np.cumsum((rows - level) * old, axis=0, out=integral[1:])
    if periodic:
        integral[-1] = 0.0  # to the last bit
    spline = CubicSpline(np.arange(rows.shape[0] + 1) * old, integral, bc_type="periodic" if periodic else "not-a-knot")
    edges = np.minimum(np.arange(count + 1) * side, rows.shape[0] * old)
    return np.diff(spline(edges), axis=0) / side + level


def hann(heights: Floats) -> Floats:
    """Heights about their mean times a Hann window of unit mean square, 0 at the edges."""
    result = heights - heights.mean()
    for axis, count in enumerate(heights.shape):
        window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
        window /= math.sqrt(float(np.mean(window**2)))
        result *= window[:, None] if axis == 0 else window[None, :]
    return result


def mirrored(heights: Floats) -> Floats:
    """The image and its mirror images beyond both edges, (2 nx, 2 ny): periodic without a step."""
    wide = np.concatenate([heights, heights[::-1]], axis=0)
    return np.concatenate([wide, wide[:, ::-1]], axis=1)


class FromFile(ImageMaker):
    """Heights from a file; higher points are nearer to the counter-body.

    The ending of the file selects one of the installed readers, unless ``reader`` is given. A map is not periodic
    unless the file or ``periodic`` states that it is.
    """

    kind = "from-file"

    pixel_size: Length | None = None
    """edge of a pixel, nm; overrides the value in the file, and is required if the file has none"""
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
        if self.pixel_size is not None and "pixel_size" in type(reader).model_fields:
            reader = reader.replace(pixel_size=self.pixel_size)
        return _read(self, reader, file_stamp(self.path))  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=1)
def _read(maker: FromFile, reader: Reader, stamp: FileStamp) -> Surface:
    """The surface that was read last is kept: for the estimate of a scene, and for every contact of a sweep."""
    content = file_hash(maker.path, stamp)
    surface = reader.read(maker.path)
    factor = 1.0
    if maker.height_unit is not None:  # instead of the unit by which the reader has multiplied
        factor = maker.height_unit / (reader.height_map(maker.path).height_unit or 1.0)
    if not isinstance(surface, Surface):
        raise InputError(f"{maker.path}: reader {reader.kind!r} gives a {type(surface).__name__}, not a surface")
    heights = surface.heights
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        if factor != 1:
            heights = heights * heights.dtype.type(factor)
        if maker.detrend != "none":
            heights = _without_trend(heights, plane=maker.detrend == "plane")
    return Surface(
        heights=heights,
        pixel_size=surface.pixel_size if maker.pixel_size is None else maker.pixel_size,
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
    """A measured image and the steps that make a surface of it, in the order of the options: units, crop, spikes,
    missing heights, trend, pixels, window.

    A few spikes (up to 0.1 % of the pixels) and missing heights (up to 5 %) are interpolated with a warning that counts
    them. No other step is taken that is not asked for: an image with more of them, with pixels that are not square, or
    with units that nobody states is refused with the option that helps. ``provenance["steps"]`` records what each step
    did.
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
        reader = self.reader or reader_for(self.path)
        return _made(self, reader, file_stamp(self.path))  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=2)
def _made(maker: Measured, reader: Reader, stamp: FileStamp) -> Surface:
    """The surfaces that were made last are kept: for the estimate of a scene, and for every contact of a sweep."""
    content = file_hash(maker.path, stamp)
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
            heights, taken = cropped(heights, sides, maker.crop)
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
        subtracted = trend(heights, _DEGREES[maker.detrend])
        heights = heights - subtracted
        steps.append({"step": "detrend", "trend": maker.detrend, "range_nm": float(np.ptp(subtracted))})
    heights, side = _square(maker, heights, sides, image.source, periodic, steps)
    if maker.window != "none" and not periodic:
        heights = hann(heights) if maker.window == "hann" else mirrored(heights)
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
    if missing and _refused(maker.missing, missing, FEW_MISSING * heights.size):
        first = np.argwhere(gaps)[0]
        raise InputError(
            f"{source}: {missing} of {heights.size} heights are missing, the first at pixel ({first[0]}, {first[1]}); "
            'give missing = "interpolate", or crop the image'
        )
    if missing and maker.missing == "few":
        _say_repaired(source, missing, heights.size, "missing", "heights are missing")
    if maker.spikes != "keep":
        spikes = find_spikes(heights, maker.spike_threshold, periodic)
        count = int(spikes.sum())
        if _refused(maker.spikes, count, FEW_SPIKES * heights.size):
            first = np.argwhere(spikes)[0]
            raise InputError(
                f"{source}: {count} of {heights.size} pixels are spikes, the first at pixel ({first[0]}, {first[1]}), "
                f"more than {maker.spike_threshold:g} robust standard deviations from the median around it; give "
                'spikes = "interpolate" to replace them, or spikes = "keep" if they are part of the surface'
            )
        if count:
            if maker.spikes == "few":
                _say_repaired(source, count, heights.size, "spikes", "pixels are spikes")
            heights = np.where(spikes, np.nan, heights)
            steps.append({"step": "spikes", "replaced": count})
    if missing:
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
        new = resampled(heights, sides, maker.resample, periodic)
    except ValueError as error:
        raise InputError(f"resample = {maker.resample:g} nm: {error}") from None
    steps.append({"step": "resample", "pixel_size_nm": maker.resample, "pixels": list(new.shape)})
    return new, maker.resample
