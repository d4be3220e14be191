"""From the image in a file to a surface, where no step is needed; and what names files and their units in options."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from chemage import InputError, Surface
from chemage.plugin import HeightMap, Length, StoreError, Unit, regular_file

#: sides of a pixel that differ by less than this are equal
SQUARE = 1e-6


def _named_unit(value: Any) -> Any:
    """Read the name of a unit, such as "um", as one of that unit."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


def _sides(value: Any) -> tuple[Any, Any]:
    sides = tuple(value) if isinstance(value, list | tuple | np.ndarray) else (value, value)
    if len(sides) != 2:
        raise ValueError(f"{len(sides)} lengths; give one, or two: [along x, along y]")
    return sides[0], sides[1]


#: a path as text
FilePath = Annotated[str, BeforeValidator(lambda value: str(value) if isinstance(value, Path) else value)]
#: nm per unit of heights, from a number or the name of a unit
HeightUnit = Annotated[float, Unit("nm", gt=0), BeforeValidator(_named_unit)]
#: edges of a pixel along x and y, nm, from one length (a square) or two
PixelSides = Annotated[
    tuple[Length, Length], BeforeValidator(_sides, json_schema_input_type=Length | tuple[Length, Length])
]

#: identifies the content of a file without reading it: size, modification time (ns), inode, device
Stamp = tuple[int, int, int, int]


def stamp(path: str) -> Stamp:
    """What changes when the file is written to."""
    found = regular_file(path)
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_dev


@lru_cache(maxsize=64)
def content_hash(path: str, stamp: Stamp) -> str:
    """The hash of the content of a file, which is read once as long as its stamp stays."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from None


def stated(
    found: HeightMap, height_unit: float | None, pixel_size: tuple[float, float] | None
) -> tuple[float, tuple[float, float]]:
    """The unit of heights and the sides of pixels, both nm; asks for them where neither file nor user states them."""
    if height_unit is not None and pixel_size is not None:
        return height_unit, pixel_size
    wanted = {}
    if height_unit is None:
        wanted["height_unit"] = '"um"'
    if pixel_size is None:
        wanted["pixel_size"] = '"4.5 nm"'
    one, it = ("one", "it") if len(wanted) == 1 else ("them", "them")
    give = " and ".join(f"{name} = {example}" for name, example in wanted.items())
    raise InputError(f"{', '.join(wanted)}: {found.source} does not state {one}; give {it}, such as {give}")


def surface_of(found: HeightMap) -> Surface:
    """The surface in an image that is one as it is: complete, with square pixels and known units.

    Raises
    ------
    InputError
        It is not, with the step that is needed.
    """
    bad = np.argwhere(~np.isfinite(found.heights))
    if bad.size:
        raise InputError(
            f"{found.source}: {len(bad)} of {found.heights.size} heights are missing or infinite, the first at pixel "
            f'({bad[0, 0]}, {bad[0, 1]}); fill them with the surface "measured" and missing = "interpolate", or crop'
        )
    unit, (dx, dy) = stated(found, found.height_unit, found.pixel_size)
    if abs(dx - dy) > SQUARE * dx:
        raise InputError(
            f"{found.source}: pixels of {dx:.6g} x {dy:.6g} nm are not square; make them so with the surface "
            f'"measured" and resample = "{min(dx, dy):.6g} nm"'
        )
    return Surface(heights=in_nm(found.heights, unit), pixel_size=dx, periodic=found.periodic)


def in_nm(heights: np.ndarray, unit: float) -> np.ndarray:
    """The heights times ``unit``, in their own precision."""
    if unit == 1:
        return heights
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused by the surface
        return heights * heights.dtype.type(unit)
