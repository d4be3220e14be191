"""A measured or computed height map."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np

from chemage import InputError, Surface
from chemage.plugin import Length, Reader, Seed, reader_for
from chemage_surfaces._maps import HeightUnit, ImageMaker, Stamp, content_hash, provenance, stamp


class FromFile(ImageMaker):
    """Heights from a file; higher points are nearer to the counter-body.

    The ending of the file selects one of the installed readers, unless ``reader`` is given. A map is not periodic
    unless the file or ``periodic`` states that it is.
    """

    kind = "from-file"

    pixel_size: Length | None = None
    """edge of a pixel, nm; overrides the value in the file, and is required if the file has none"""
    height_unit: HeightUnit = 1.0
    """unit of the heights in the file, such as "um", or a factor that converts them to nm"""
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
        return _read(self, reader, stamp(self.path))  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=1)
def _read(maker: FromFile, reader: Reader, stamp: Stamp) -> Surface:
    """The surface that was read last is kept: for the estimate of a scene, and for every contact of a sweep."""
    content = content_hash(maker.path, stamp)
    surface = reader.read(maker.path)
    if not isinstance(surface, Surface):
        raise InputError(f"{maker.path}: reader {reader.kind!r} gives a {type(surface).__name__}, not a surface")
    heights = surface.heights
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        if maker.height_unit != 1:
            heights = heights * heights.dtype.type(maker.height_unit)
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
