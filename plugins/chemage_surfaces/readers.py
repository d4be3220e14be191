"""Readers of height maps: numpy files, text tables, HDF5, and NetCDF-3 files.

Heights are in nm where the file states no unit. The option ``pixel_size`` overrides the pixel size in a file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from os import SEEK_END, PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from chemage import InputError, Surface, errors
from chemage.plugin import (
    HeightMap,
    Length,
    Reader,
    StoreError,
    UnitError,
    container,
    convert,
    open_file,
)
from chemage_surfaces._maps import surface_of

if TYPE_CHECKING:
    import h5py

_BOOLEAN = TypeAdapter(bool)
#: groups of HDF5 in each other
DEEPEST = 32


def as_map(
    heights: Any,
    source: str,
    *,
    pixel_size: float | None = None,
    stated: object = None,
    periodic: bool = False,
    unit: str | None = None,
    notes: Mapping[str, Any] | None = None,
) -> HeightMap:
    """Make a HeightMap of the array ``heights`` (nx, ny) that was read from ``source``, where ``unit`` is that of the
    heights, if it is stated.

    ``pixel_size`` (nm) is that of the user and overrides ``stated``, the value in the file: a number in nm, or a string
    with its unit, or two such values, along x and y. ``notes`` are those of the map.

    Raises
    ------
    StoreError
        The array is not two-dimensional or does not consist of real numbers.
    """
    heights = np.asarray(heights)
    if heights.dtype.kind not in "fiub":
        raise StoreError(
            f"{source} holds {heights.dtype} values; heights are real numbers"
        )
    if heights.ndim != 2 or heights.size == 0:
        raise StoreError(
            f"{source} holds an array of shape {heights.shape}; a height map has two dimensions (nx, ny)"
        )
    if heights.dtype.kind != "f" or heights.dtype.itemsize not in (4, 8):
        heights = heights.astype(np.float64)
    sides = None if pixel_size is None else (pixel_size, pixel_size)
    if pixel_size is None and stated is not None:
        dx, dy = (
            stated_length(side, source)
            for side in (stated if isinstance(stated, tuple) else (stated, stated))
        )
        if not all(math.isfinite(side) and side > 0 for side in (dx, dy)):
            raise StoreError(
                f"{source} states a pixel size of {stated!r}; give pixel_size"
            )
        sides = (dx, dy)
    # a copy in the byte order of this machine
    heights = np.array(
        heights,
        dtype=np.float32 if heights.dtype.itemsize == 4 else np.float64,
        order="C",
    )
    heights.setflags(write=False)
    try:
        in_nm = None if unit is None else convert(f"1 {unit}", "nm")
    except UnitError as error:
        raise StoreError(
            f"{source} states the unit of its heights: {error}"
        ) from None
    return HeightMap(
        heights, in_nm, sides, periodic, source=source, notes=notes or {}
    )


def stated_length(value: Any, source: str) -> float:
    """A length that a file states, nm; the error names the file."""
    try:
        return convert(value, "nm")
    except UnitError as error:
        raise StoreError(
            f"{source} states the size of its pixels: {error}"
        ) from None


class Instrument(Reader):
    """A reader of images whose files state their units."""

    #: nm per unit of heights where the file states none; None: it must
    default_unit: ClassVar[float | None] = None
    #: option that names the channel; empty: a file has one
    channel_option: ClassVar[str] = ""

    def channels(self, path: str | PathLike[str]) -> list[str]:
        """Names of the channels of heights in a file, where it has several."""
        return []

    def read(self, path: str | PathLike[str]) -> Surface:
        """The surface, if the image is complete, its pixels are square and its units are known.

        Raises
        ------
        StoreError
            The file is missing, truncated or not in this format.
        InputError
            Heights are missing, units are not stated, pixels are not square, or it is unclear or wrong which heights of
            the file are meant.
        PluginError
            A library that the format needs is not installed.
        """
        image = self.height_map(path)
        return surface_of(
            replace(image, height_unit=image.height_unit or self.default_unit)
        )


class Unitless(Instrument):
    """A reader of arrays in a unit that the file need not state: else heights are in nm."""

    default_unit = 1.0

    pixel_size: Length | None = None
    """edge of a pixel, nm"""


class Npy(Unitless):
    """A two-dimensional array saved with ``numpy.save``, which has no pixel size."""

    kind = "npy"
    suffixes = (".npy",)
    marks = (b"\x93NUMPY",)

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The array as it is; its unit is not stated."""
        with open_file(path) as file:
            if file.read(6) not in self.marks:
                raise StoreError(f"{path} is not a numpy (.npy) file")
            length = file.seek(0, SEEK_END)
            file.seek(0)
            try:
                heights = container.read_array(file, length)
            except (
                Exception
            ) as error:  # what numpy raises depends on which byte is wrong
                reason = errors.shortened(" ".join(str(error).split()), 200)
                raise StoreError(
                    f"{path} is truncated or not a plain array of numbers ({reason})"
                ) from None
        return as_map(heights, str(path), pixel_size=self.pixel_size)


class Hdf5(Unitless):
    """A two-dimensional dataset of an HDF5 (or NetCDF-4) file.

    The attributes ``pixel_size`` (nm, or a string with its unit) and ``periodic`` are read from the dataset, else from
    its group, else from the file; ``units``, ``scale_factor``, ``add_offset`` and ``_FillValue`` from the dataset (CF
    conventions, sections 3.1, 2.5.1 and 8.1).
    """

    kind = "hdf5"
    suffixes = (".h5", ".hdf5", ".hdf", ".nc")
    channel_option = "dataset"

    @classmethod
    def claims(cls, head: bytes, path: str | PathLike[str]) -> bool | None:
        """It begins with the mark of HDF5, and its ending is not that of an instrument that writes HDF5."""
        marked = head.startswith(b"\x89HDF\r\n\x1a\n")
        return None if marked and Path(path).suffix.lower() == ".datx" else marked

    dataset: str | None = None
    """name of the dataset, such as "surface/heights"; None: the only two-dimensional dataset of numbers"""

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The array, with its unit if an attribute states it."""
        with container.hdf5(path) as file, container.decoding(path):
            node = self._find(file, path)
            container.check_dataset(node, path)
            attributes = {
                name: holder.attrs[name]
                for holder in (file, node.parent, node)
                for name in ("pixel_size", "periodic")
                if name in holder.attrs
            }
            name = f"{path}:{node.name}"
            own = {
                key: _single(node.attrs[key], key, name)
                for key in _PACKED
                if key in node.attrs
            }
            heights = unpacked(node[()], own, name)
            sides = []
            for scales in (
                node.dims if node.ndim == 2 else ()
            ):  # dimension scales (HDF5, NetCDF-4)
                if not len(scales):
                    continue
                place = str(node.name)
                container.check_dataset(scales[0], place)
                unit = _single(scales[0].attrs.get("units"), "units", place)
                sides.append(coordinate_side(scales[0][()], unit))
        stated = (
            None
            if self.pixel_size is not None
            else _single(attributes.get("pixel_size"), "pixel_size", name)
        )
        if (
            stated is None
            and self.pixel_size is None
            and len(sides) == 2
            and None not in sides
        ):
            stated = tuple(sides)
        flag = _single(attributes.get("periodic"), "periodic", name)
        try:
            periodic = flag is not None and _BOOLEAN.validate_python(
                flag.strip() if isinstance(flag, str) else flag
            )
        except ValidationError:
            raise StoreError(
                f"{name} has periodic = {errors.shown(flag)}; expected true or false"
            ) from None
        return as_map(
            heights,
            name,
            pixel_size=self.pixel_size,
            stated=stated,
            periodic=periodic,
            unit=own.get("units"),
        )

    def _find(self, file: h5py.File, path: str | PathLike[str]) -> h5py.Dataset:
        import h5py

        maps: list[str] = []

        def visit(name: str, node: Any) -> str | None:
            if (
                isinstance(node, h5py.Dataset)
                and node.ndim == 2
                and node.dtype.kind in "fiu"
            ):
                maps.append(name)
            return (
                name if name.count("/") > DEEPEST else None
            )  # which ends the visit

        if self.dataset is not None:
            _check_links(file, self.dataset, path)
            node = file.get(self.dataset)
            if isinstance(node, h5py.Dataset):
                return node
            problem = f"{path} has no dataset {self.dataset!r}"
        else:
            problem = f"{path}: which dataset holds the heights?"
        if (deep := file.visititems(visit)) is not None:
            raise StoreError(
                f"{path}: {errors.shortened(deep)} is nested more than {DEEPEST} deep; name a dataset above it"
            )
        if self.dataset is None and len(maps) == 1:
            return file[maps[0]]  # pyright: ignore[reportReturnType]
        listed = errors.shortened(", ".join(maps), 1000) or "none"
        error = InputError if self.dataset is None and maps else StoreError
        raise error(
            f"{problem}; two-dimensional datasets of numbers in it: {listed}"
        )


def _check_links(
    group: Any, name: str, path: str | PathLike[str], depth: int = 0
) -> None:
    """Refuse a name that leads into another file, at any group on the way."""
    import h5py

    place: Any = group.file if name.startswith("/") else group
    for part in filter(None, name.split("/")):
        if not isinstance(place, h5py.Group):
            return
        link = place.get(part, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise StoreError(
                f"{path}: {name!r} is a link into another file ({errors.shortened(link.filename)}), which is not "
                "followed; read that file, or copy the data"
            )
        if isinstance(link, h5py.SoftLink):
            if depth > 10:
                raise StoreError(f"{path}: {name!r} is a loop of links")
            _check_links(place, link.path, path, depth + 1)
        place = place.get(part)


#: attributes by which a NetCDF file packs its data
_PACKED = ("units", "scale_factor", "add_offset", "_FillValue", "missing_value")


def unpacked(heights: Any, packing: Mapping[str, Any], source: str) -> Any:
    """Heights as the attributes of their dataset say, nan where they are missing."""
    scale, offset = packing.get("scale_factor", 1.0), packing.get("add_offset", 0.0)
    missing = [
        packing[name] for name in ("_FillValue", "missing_value") if name in packing
    ]
    if any(isinstance(number, str) for number in (scale, offset, *missing)):
        raise StoreError(f"{source}: {', '.join(_PACKED[1:])} must be numbers")
    gaps = np.isin(heights, np.array(missing)) if missing else False
    if (scale, offset) != (1.0, 0.0):
        heights = heights * float(scale) + float(offset)
    return np.where(gaps, np.nan, heights) if np.any(gaps) else heights


def coordinate_side(places: np.ndarray, unit: Any) -> str | None:
    """The edge of a pixel with its unit, from the even places of the pixels; None where they or their unit are not
    there."""
    if (
        not unit
        or places.ndim != 1
        or len(places) < 2
        or places.dtype.kind not in "fiu"
    ):
        return None
    steps = np.diff(places.astype(np.float64))
    step = float(np.mean(steps))
    return (
        f"{abs(step)!r} {unit}"
        if step and np.all(np.abs(steps - step) < 1e-3 * abs(step))
        else None
    )


def plain(value: Any) -> Any:
    """An attribute as a number, a text or a list."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.item() if value.size == 1 else value.tolist()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _single(value: Any, attribute: str, source: str) -> Any:
    """An attribute that is one number or text; None if it is not there."""
    if isinstance(value, np.ndarray) and value.size != 1:
        raise StoreError(
            f"{source} has a {attribute} of {value.size} values; give one"
        )
    value = plain(value)
    if value is not None and not isinstance(value, bool | int | float | str):
        raise StoreError(
            f"{source} has a {attribute} of {type(value).__name__}; give a number or a text"
        )
    return value
