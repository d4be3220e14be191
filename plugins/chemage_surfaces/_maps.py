"""What the makers of surfaces have in common: options that name grids, files and their units, the record of how a
surface was made, and the way from the image in a file to a surface, where no step is needed."""

from __future__ import annotations

import math
import operator
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

import chemage
from chemage import InputError, Surface
from chemage.plugin import (
    Choice,
    FilePath,
    FileStamp,
    HeightMap,
    Length,
    Reader,
    Scatter,
    Seed,
    SurfaceMaker,
    Unit,
    checked_seed,
    file_hash,
    file_stamp,
    memory,
    reader_for,
)

#: heights, or numbers of wave vectors
Floats = NDArray[np.float64]
#: along x and y
Pair: TypeAlias = tuple[int, int]
#: sides of a pixel that differ by less than this are equal
SQUARE = 1e-6
#: pixels that are given against a file may differ by this, as rounded lengths do
DIFFERENT = 1e-3
#: pixels along the sides of parts, beyond which their random waves repeat
LARGEST_PART = 2048
#: pixels of the largest grid: no machine holds its heights, but theories of contact need none
MOST_PIXELS = 2**43


def _sides(
    value: Any, *, give: str = "lengths; give one, or two: [along x, along y]"
) -> tuple[Any, Any]:
    """Along x and y, from one value or two."""
    sides = (
        tuple(value)
        if isinstance(value, list | tuple | np.ndarray)
        else (value, value)
    )
    if len(sides) != 2:
        raise ValueError(f"{len(sides)} {give}")
    return sides


def _grid(value: Any) -> tuple[int, int]:
    sides = _sides(
        value, give="numbers; give one whole number of pixels, or two: [nx, ny]"
    )
    # 2.5e3 is a whole number, too
    whole: Any = [
        int(side) if isinstance(side, float) and side.is_integer() else side
        for side in sides
    ]
    try:
        if bool in map(type, sides):
            raise TypeError
        nx, ny = map(operator.index, whole)
    except TypeError:
        raise ValueError(
            "give a whole number of pixels, or two: [nx, ny]"
        ) from None
    if min(nx, ny) < 1:
        raise ValueError(f"a grid of {nx} x {ny} pixels is empty; give at least 1")
    if nx * ny > MOST_PIXELS:
        there = min(memory.capacity(), 8 * MOST_PIXELS)
        side = math.isqrt(int(there / 8))
        raise ValueError(
            f"a grid of {nx} x {ny} pixels is too large; the {memory.readable(there)} of memory of this machine hold "
            f"the heights of at most {side} x {side}"
        )
    return nx, ny


#: (nx, ny), from one number (a square) or two
if TYPE_CHECKING:
    Pixels: TypeAlias = Any  # to a type checker, so that one number can be given
else:
    Pixels = Annotated[
        tuple[int, int],
        BeforeValidator(_grid, json_schema_input_type=int | tuple[int, int]),
    ]


def provenance(maker: SurfaceMaker, seed: Seed | None = None) -> dict[str, Any]:
    """Record how a surface was made, as plain JSON values; with ``seed`` if the maker draws random numbers."""
    options = maker.todict()
    record: dict[str, Any] = {
        "kind": options.pop("kind"),
        "options": options,
        "chemage": chemage.__version__,
    }
    if isinstance(seed, np.random.SeedSequence):
        entropy = seed.entropy
        record["seed"] = {
            "entropy": [int(word) for word in entropy]
            if isinstance(entropy, list | tuple | np.ndarray)
            else entropy,
            "spawn_key": [int(word) for word in seed.spawn_key],
        }
    elif seed is not None:
        record["seed"] = int(seed)
    return record


def stream(seed: Seed, *key: int) -> np.random.SeedSequence:
    """The random numbers of ``seed``, or those of it that ``key`` tells apart."""
    if not isinstance(seed, np.random.SeedSequence):
        seed = np.random.SeedSequence(checked_seed(seed))
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))


def _named_unit(value: Any) -> Any:
    """Read the name of a unit, such as "um", as one of that unit."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


#: nm per unit of heights, from a number or the name of a unit
HeightUnit = Annotated[Any, Unit("nm", gt=0), BeforeValidator(_named_unit)]
#: edges of a pixel along x and y, nm, from one length (a square) or two
PixelSides = Annotated[
    tuple[Length, Length],
    BeforeValidator(_sides, json_schema_input_type=Length | tuple[Length, Length]),
]


@dataclass(frozen=True, eq=False)
class Parts:
    """A surface on a grid too large to be made, of which any part can be. It is not periodic."""

    periodic: ClassVar[bool] = False

    shape: Pair
    #: nm
    pixel_size: float
    provenance: Mapping[str, Any]
    #: of (first pixel, shape, middle, step): heights, nm, of every ``step``-th pixel, and of waves that are longer than
    #: four of these where there are others between; random waves are drawn for the pixel ``middle``, so that parts that
    #: name the same one are equal where they overlap
    heights: Callable[[Pair, Pair, Pair, int], Floats]
    #: its longer waves on the pixels of the image, and the edge of these, nm
    coarse: Floats
    side: float
    #: of a step: rms height of the waves that are not in such heights, nm; of 0 of those that are not in ``coarse``
    unseen: Callable[[int], float]


class ImageMaker(SurfaceMaker):
    """A surface in a file, which no seed changes."""

    path: FilePath
    """path of the file"""
    reader: Choice[Reader] | None = None
    """kind of the reader, or a table with its ``kind`` and options, such as the channel; None: selected by the ending
    of the file"""

    @abstractmethod
    def from_file(self, reader: Reader, stamp: FileStamp) -> Surface | str:
        """The surface in the file, or why it needs a step that was not asked for."""

    def make(self, seed: Seed = 0) -> Surface:
        """The surface, made once as long as the file does not change. ``seed`` is ignored.

        Raises
        ------
        StoreError
            The file is missing, truncated or not in the format of the reader, or no reader accepts its ending.
        InputError
            Several readers accept the ending, heights are not finite, units or the pixel size are not stated, a step is
            needed that was not asked for, or an option does not fit the image.
        """
        reader: Any = self.reader or reader_for(self.path)
        made = _made(self, reader, file_stamp(self.path))  # pyright: ignore[reportArgumentType]: hashable it is
        if isinstance(made, str):
            raise InputError(made)
        return made

    def content(self) -> dict[str, str]:
        """A hash of the content of the file, so that an edited file is another surface.

        The file is read once, and again after its size or modification time changed.

        Raises
        ------
        StoreError
            The file cannot be read.
        """
        return {"file_blake2b": file_hash(self.path, file_stamp(self.path))}

    def expected(self) -> dict[str, float]:
        """Grid and rms slope of the surface, which is made once as long as the file does not change."""
        surface = self.make()
        nx, ny = surface.shape
        numbers = {
            "nx": nx,
            "ny": ny,
            "pixel_size": surface.pixel_size,
            "rms_slope": surface.rms_slope,
        }
        return {**numbers, "periodic": float(surface.periodic)}

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """None: the seed is ignored."""
        return Scatter(0.0)


@lru_cache(maxsize=2)
def _made(maker: ImageMaker, reader: Reader, stamp: FileStamp) -> Surface | str:
    """Those that were made last are kept: for the estimate of a scene, and for every contact of a sweep."""
    return maker.from_file(reader, stamp)


def stated(
    image: HeightMap,
    height_unit: float | None,
    pixel_size: tuple[float, float] | None,
) -> tuple[float, tuple[float, float]]:
    """The unit of heights and the sides of pixels, both nm; asks for them where neither file nor user states them."""
    if height_unit is not None and pixel_size is not None:
        return height_unit, pixel_size
    wanted = {}
    if height_unit is None:
        wanted["height_unit"] = '"um"'
    if pixel_size is None:
        wanted["pixel_size"] = '"4.5 nm"'
    these, it = ("one", "it") if len(wanted) == 1 else ("them", "them")
    give = " and ".join(f"{name} = {example}" for name, example in wanted.items())
    raise InputError(
        f"{', '.join(wanted)}: {image.source} does not state {these}; give {it}, such as {give}"
    )


def same_pixels(image: HeightMap, given: tuple[float, float]) -> None:
    """Refuse pixels that are given against those in the file."""
    stated = image.pixel_size
    if stated is not None and any(
        abs(a - b) > DIFFERENT * b for a, b in zip(given, stated, strict=True)
    ):
        raise InputError(
            f"pixel_size = {given[0]:.9g} x {given[1]:.9g} nm: {image.source} states {stated[0]:.9g} x {stated[1]:.9g} "
            "nm; leave pixel_size out, or, if the file is wrong, give it to the reader: "
            f'reader = {{ kind = "...", pixel_size = "{given[0]:.9g} nm" }}'
        )


def surface_of(image: HeightMap) -> Surface:
    """The surface in an image that is one as it is: complete, with square pixels and known units.

    Raises
    ------
    InputError
        It is not, with the step that is needed.
    """
    bad = np.argwhere(~np.isfinite(image.heights))
    if bad.size:
        raise InputError(
            f"{image.source}: {len(bad)} of {image.heights.size} heights are missing or infinite, the first at pixel "
            f'({bad[0, 0]}, {bad[0, 1]}); fill them with the surface "measured" and missing = "interpolate", or crop'
        )
    unit, (dx, dy) = stated(image, image.height_unit, image.pixel_size)
    if abs(dx - dy) > SQUARE * dx:
        raise InputError(
            f"{image.source}: pixels of {dx:.6g} x {dy:.6g} nm are not square; make them so with the surface "
            f'"measured" and resample = "{min(dx, dy):.6g} nm"'
        )
    return Surface(
        heights=in_nm(image.heights, unit), pixel_size=dx, periodic=image.periodic
    )


def in_nm(heights: np.ndarray, unit: float) -> np.ndarray:
    """The heights times ``unit``, in their own precision."""
    if unit == 1:
        return heights
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # what is not finite is refused by the surface
        return heights * heights.dtype.type(unit)


#: words in the names of channels for the two directions of the scan lines
_WAYS = (("retrace", "trace"), ("backward", "forward"), ("bwd", "fwd"))


def opposite(one: str, other: str) -> bool:
    """Whether two names of channels differ in the direction of the scan lines, and in nothing else."""
    names = [
        " ".join(name.lower().replace("_", " ").split()) for name in (one, other)
    ]
    # JPK names the way back only
    bare = [
        name.replace(", retrace)", ")").replace(" (retrace)", "") for name in names
    ]
    if names[0] != names[1] and bare[0] == bare[1]:
        return True
    for back, there in _WAYS:
        marked = [name.replace(back, "<").replace(there, ">") for name in names]
        if (
            marked[0] != marked[1]
            and marked[0].translate({60: ">", 62: "<"}) == marked[1]
        ):
            return True
    return False
