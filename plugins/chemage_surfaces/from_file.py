"""A measured or computed height map."""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, SerializeAsAny, field_validator

from chemage import InputError, Length, Reader, Seed, StoreError, Surface, SurfaceMaker, Unit, reader_for, registry
from chemage_surfaces._options import provenance


def _named_unit(value: Any) -> Any:
    """A unit by its name alone, "um", is one of it."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


FilePath = Annotated[str, BeforeValidator(lambda value: str(value) if isinstance(value, Path) else value)]


class FromFile(SurfaceMaker):
    """Heights from a file, higher = nearer to the counter-body.

    The ending of the file selects one of the installed readers, unless ``reader`` names one. A measured map is taken as
    not periodic unless the file or ``periodic`` states otherwise.
    """

    kind = "from-file"

    path: FilePath
    """the file"""
    reader: SerializeAsAny[Reader] | None = None
    """kind of reader, or a table with its ``kind`` and options; None: by the file's ending"""
    pixel_size: Length | None = None
    """edge of a pixel, nm; required where the file does not state it, and used instead of what it states"""
    height_unit: Annotated[float, Unit("nm", gt=0), BeforeValidator(_named_unit)] = 1.0
    """unit of the heights in the file, nm: "um", or a number to multiply them by"""
    detrend: Literal["none", "mean", "plane"] = "none"
    """what to subtract: nothing, the mean height, or the plane of least squares"""
    periodic: bool | None = None
    """whether the map repeats; None: what the file says, else no"""

    @field_validator("reader", mode="before")
    @classmethod
    def _reader(cls, value: Any) -> Any:
        if isinstance(value, str):
            return registry.current().make("reader", value, {})
        if isinstance(value, dict):
            if "kind" not in value:
                raise ValueError('name the reader: kind = "..."')
            return registry.fromdict("reader", value)
        return value

    def identity(self) -> dict[str, Any]:
        """Kind, options, and a hash of the file's bytes: an edited file is another surface.

        The file is read once as long as its size and time of change stay what they are.

        Raises
        ------
        StoreError
            The file cannot be read.
        """
        return {**super().identity(), "file_blake2b": _hash(self.path, _stamp(self.path))}

    def expected(self) -> dict[str, float]:
        """Grid and rms slope of the surface in the file, which is read once as long as it does not change."""
        found = self.make()
        nx, ny = found.shape
        return {"nx": nx, "ny": ny, "pixel_size": found.pixel_size, "rms_slope": found.rms_slope}

    def make(self, seed: Seed = 0) -> Surface:
        """The surface in the file, which is read once as long as it does not change. ``seed`` is ignored.

        Raises
        ------
        StoreError
            The file is missing, truncated, not of the reader's format, or no reader accepts its ending.
        InputError
            Several readers accept the file's ending; the pixel size is unknown; heights are not finite.
        """
        reader = self.reader or reader_for(self.path)
        if self.pixel_size is not None and "pixel_size" in type(reader).model_fields:
            reader = reader.replace(pixel_size=self.pixel_size)
        return _read(self, reader, _stamp(self.path))  # pyright: ignore[reportArgumentType]


#: what tells one content of a file from another without reading it: size and time of change in ns, and which file it is
_Stamp = tuple[int, int, int, int]


def _stamp(path: str) -> _Stamp:
    try:
        found = os.stat(path)
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from None
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_dev


@lru_cache(maxsize=64)
def _hash(path: str, stamp: _Stamp) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from None


@lru_cache(maxsize=1)
def _read(maker: FromFile, reader: Reader, stamp: _Stamp) -> Surface:
    """The surface that was read last is kept: for the estimate of a scene, and for every contact of a sweep."""
    content = _hash(maker.path, stamp)
    found = reader.read(maker.path)
    if not isinstance(found, Surface):
        raise InputError(f"{maker.path}: reader {reader.kind!r} gives a {type(found).__name__}, not a surface")
    heights = found.heights
    if maker.height_unit != 1:
        heights = heights * heights.dtype.type(maker.height_unit)
    if maker.detrend != "none":
        heights = _without_trend(heights, plane=maker.detrend == "plane")
    return Surface(
        heights=heights,
        pixel_size=found.pixel_size if maker.pixel_size is None else maker.pixel_size,
        periodic=found.periodic if maker.periodic is None else maker.periodic,
        provenance={**provenance(maker), "reader": reader.kind, "file_blake2b": content},
    )


def _without_trend(heights: np.ndarray, *, plane: bool) -> np.ndarray:
    """Heights less their mean, or less their plane of least squares."""
    result = heights - heights.mean(dtype=np.float64)
    if plane:
        # on a full grid the two tilts and the mean are orthogonal, so each is a projection of its own
        for axis, count in enumerate(heights.shape):
            x = np.arange(count) - 0.5 * (count - 1)
            if count > 1:
                tilt = (x @ result.mean(axis=1 - axis)) / (x @ x)
                result -= (tilt * x)[:, None] if axis == 0 else (tilt * x)[None, :]
    return result.astype(heights.dtype, copy=False)
