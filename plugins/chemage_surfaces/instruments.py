"""Readers of files of instruments and of their programs: X3P, Gwyddion's own files, NetCDF-3, lists of points."""

from __future__ import annotations

import io
import math
import struct
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from typing import Any
from xml.etree import ElementTree

import numpy as np

from chemage import InputError
from chemage.plugin import (
    HeightMap,
    Length,
    StoreError,
    UnitError,
    container,
    convert,
    open_file,
    tables,
)
from chemage_surfaces._maps import HeightUnit, opposite
from chemage_surfaces.readers import (
    Instrument,
    as_map,
    coordinate_side,
    plain,
    unpacked,
)

#: containers in containers of a file of Gwyddion, and parts in parts of XML
DEEPEST = 20
#: bytes of the XML of X3P, which may list points
LARGEST_XML = 1 << 23
#: places of a grid for each point
SPARSE = 4
#: spacings of a grid of points differ by less than this
EVEN = 1e-3


@contextmanager
def _content(path: str | PathLike[str]) -> Iterator[bytes]:
    """The bytes of a file; that they are damaged is said with its name."""
    with open_file(path) as file:
        data = file.read()
    with container.decoding(path):
        yield data


# -- X3P ---------------------------------------------------------------------------------------------------------------

_TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
_METRE = 1e9


class X3p(Instrument):
    """An image in X3P (ISO 25178-72): a ZIP archive with ``main.xml`` and binary heights, all lengths in metres."""

    kind = "x3p"
    suffixes = (".x3p",)

    @classmethod
    def claims(cls, head: bytes, path: str | PathLike[str]) -> bool:
        """A ZIP archive that begins with a part of X3P."""
        name = head[30 : 30 + int.from_bytes(head[26:28], "little")]
        return head.startswith(b"PK\x03\x04") and name in (
            b"main.xml",
            b"bindata/data.bin",
            b"md5checksum.hex",
            b"bindata/",
        )

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The image as it is; points marked invalid, or not finite, are missing."""
        source = str(path)
        with _content(path) as data, zipfile.ZipFile(io.BytesIO(data)) as archive:
            if archive.getinfo("main.xml").file_size > LARGEST_XML:
                raise ValueError(
                    "main.xml has more than a list of points needs; store them in bindata/data.bin"
                )
            record = archive.read("main.xml").replace(b"\0", b"")
            if b"<!DOCTYPE" in record or b"<!ENTITY" in record:
                raise ValueError("its XML defines entities")
            root = ElementTree.fromstring(record)
            fields = {
                "/".join(names): (node.text or "").strip()
                for names, node in _nodes(root)
            }
            if fields.get("Record1/FeatureType") not in ("SUR", None):
                raise InputError(
                    f"{source} holds no image, but {fields['Record1/FeatureType']!r} (SUR is an image)"
                )
            count = [
                int(fields[f"Record3/MatrixDimension/Size{axis}"]) for axis in "XYZ"
            ]
            nx, ny = count[:2]
            if min(count) < 1 or count[2] != 1:
                raise ValueError(f"{nx} x {ny} x {count[2]} points")
            if any(
                fields[f"Record1/Axes/C{axis}/AxisType"] != "I" for axis in "XY"
            ):
                raise InputError(
                    f"{source} holds points that are no grid; grid them in the program of the instrument"
                )
            dtype = _TYPES[fields["Record1/Axes/CZ/DataType"]]
            container.check_unpacked(8 * nx * ny, len(data), source)
            if (link := fields.get("Record3/DataLink/PointDataLink")) is not None:
                stored = _member(archive, link, nx * ny * np.dtype(dtype).itemsize)
                heights = np.frombuffer(stored, dtype).astype(np.float64)
                if (
                    valid := fields.get("Record3/DataLink/ValidPointsLink")
                ) is not None:
                    marks = np.frombuffer(
                        _member(archive, valid, -(-nx * ny // 8)), np.uint8
                    )
                    heights[
                        np.unpackbits(marks, bitorder="little")[: nx * ny] == 0
                    ] = np.nan
            else:
                points = [node.text or "" for node in root.iter("Datum")]
                if len(points) != nx * ny:
                    raise ValueError(f"{len(points)} points of {nx * ny}")
                heights = np.array(
                    [
                        float(point.split(";")[-1]) if point.strip() else math.nan
                        for point in points
                    ]
                )
            heights = heights * float(fields.get("Record1/Axes/CZ/Increment") or 1)
            heights = heights + float(fields.get("Record1/Axes/CZ/Offset") or 0)
            sides = tuple(
                f"{float(fields[f'Record1/Axes/C{axis}/Increment']) * _METRE!r} nm"
                for axis in "XY"
            )
            return as_map(
                heights.reshape(ny, nx).T,
                source,
                stated=sides,
                unit="m",
                notes={"format": "x3p"},
            )


def _nodes(
    node: ElementTree.Element, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], ElementTree.Element]]:
    for child in node:
        names = (*above, child.tag.rpartition("}")[2])
        if len(names) > DEEPEST:
            raise ValueError(f"its XML is nested more than {DEEPEST} deep")
        yield names, child
        yield from _nodes(child, names)


def _member(archive: zipfile.ZipFile, name: str, size: int) -> bytes:
    """The part of an archive, which is no larger than it should be."""
    name = name.lstrip("/")
    if archive.getinfo(name).file_size != size:
        raise ValueError(
            f"{name} has {archive.getinfo(name).file_size} bytes, and {size} are stated"
        )
    return archive.read(name)


# -- Gwyddion ----------------------------------------------------------------------------------------------------------


@dataclass
class _Stream:
    """A file of Gwyddion: little-endian components, each a name, a letter of its type and its value."""

    data: bytes
    at: int = 4

    def take(self, count: int) -> bytes:
        if count < 0 or self.at + count > len(self.data):
            raise ValueError("it ends too early")
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, code: str) -> Any:
        return struct.unpack("<" + code, self.take(struct.calcsize("<" + code)))[0]

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise ValueError("a text does not end")
        part, self.at = self.data[self.at : end], end + 1
        return part.decode("utf-8", "replace")

    def object(self, depth: int = 0) -> tuple[str, dict[str, Any]]:
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} containers in each other")
        name, size = self.text(), self.number("I")
        end, found = self.at + size, {}
        if end > len(self.data):
            raise ValueError("it ends too early")
        while self.at < end:
            key, code = self.text(), chr(self.number("B"))
            found[key] = self.value(code, depth)
        return name, found

    def value(self, code: str, depth: int) -> Any:
        if code in "bciqd":
            return self.number({"b": "?", "c": "c"}.get(code, code))
        if code == "s":
            return self.text()
        if code == "o":
            return self.object(depth + 1)[1]
        if code not in "CIQDSO":
            raise ValueError(f"unknown type {code!r}")
        count = self.number("I")
        if code in "SO":
            return [
                self.text() if code == "S" else self.object(depth + 1)[1]
                for _ in range(count)
            ]
        dtype = np.dtype({"C": "S1", "I": "<i4", "Q": "<i8", "D": "<f8"}[code])
        return np.frombuffer(self.take(count * dtype.itemsize), dtype)


class Gwy(Instrument):
    """An image in a file of Gwyddion (its user guide, section "Gwyddion Native Format"); masked points are missing."""

    kind = "gwy"
    suffixes = (".gwy",)
    marks = (b"GWYP",)
    channel_option = "channel"

    channel: str | None = None
    """title of the channel; None: the first with heights"""

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The image as it is, of the channel that is asked for, or the first one whose values are lengths."""
        with _content(path) as data:
            number, maps, content = self._maps(data, path)
            (title, field), mask = maps[number], content.get(f"{number}/mask")
            nx, ny = int(field["xres"]), int(field["yres"])
            if min(nx, ny) < 1 or field["data"].dtype != np.float64:
                raise ValueError(f"{nx} x {ny} points")
            heights = field["data"].reshape(ny, nx).T
            if isinstance(mask, dict):
                heights = np.where(
                    mask["data"].reshape(ny, nx).T > 0.5, np.nan, heights
                )
            lateral = _unit(field, "si_unit_xy")
            # Gwyddion takes sides without their sign, and 0 for 1
            sides = tuple(
                abs(float(field[name])) or 1.0 for name in ("xreal", "yreal")
            )
            stated = (
                None
                if lateral is None
                else tuple(
                    f"{side / n!r} {lateral}"
                    for side, n in zip(sides, (nx, ny), strict=True)
                )
            )
            notes = {"format": "gwy", "channel": title}
            return as_map(
                heights,
                str(path),
                stated=stated,
                unit=_unit(field, "si_unit_z"),
                notes=notes,
            )

    def channels(self, path: str | PathLike[str]) -> list[str]:
        """Titles of the channels whose values are lengths."""
        with _content(path) as data:
            return [title for title, _ in self._maps(data, path)[1].values()]

    def retrace(self, path: str | PathLike[str]) -> Gwy | None:
        """The reader of the same channel in the other direction of the scan lines; None where the file has none."""
        with _content(path) as data:
            number, maps, _ = self._maps(data, path)
            others = [
                title
                for title, _ in maps.values()
                if opposite(maps[number][0], title)
            ]
        return self.replace(channel=others[0]) if others else None

    def _maps(
        self, data: bytes, path: str | PathLike[str]
    ) -> tuple[str, dict[str, tuple[str, dict[str, Any]]], dict[str, Any]]:
        """The number of the channel to read, the titles and fields of heights, and the whole content."""
        if not data.startswith(self.marks):
            raise StoreError(f"{path} is no file of Gwyddion")
        _, content = _Stream(data).object()
        channels = {
            key[:-5]: (str(content.get(f"{key}/title", key)), field)
            for key, field in content.items()
            if key.startswith("/")
            and key.endswith("/data")
            and key[1:-5].isdigit()
            and isinstance(field, dict)
        }
        maps = {
            number: one
            for number, one in channels.items()
            if _unit(one[1], "si_unit_z") is not None
        }
        number = next(
            (
                number
                for number, (title, _) in maps.items()
                if self.channel in (None, title)
            ),
            None,
        )
        if number is None:
            titles = ", ".join(title for title, _ in maps.values()) or "none"
            raise InputError(
                f"channel = {self.channel!r}: {path} has no such channel of heights ({titles})"
            )
        return number, maps, content


def _unit(field: Mapping[str, Any], name: str) -> str | None:
    """The unit of a field, if it is one of length."""
    unit = field.get(name)
    text = unit.get("unitstr") if isinstance(unit, dict) else None
    return text if _is_length(text) else None


def _is_length(unit: Any) -> bool:
    try:
        convert(f"1 {unit}", "nm")
    except UnitError:
        return False
    return True


# -- NetCDF-3 ----------------------------------------------------------------------------------------------------------


class _Metered(io.BytesIO):
    """A file of which no part is read again and again: variables that overlap are none."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self._left = 2 * len(data)

    def read(self, size: int | None = -1, /) -> bytes:
        part = super().read(size)
        self._left -= len(part)
        if self._left < 0:
            raise ValueError("its variables overlap")
        return part


class NetCdf(Instrument):
    """A two-dimensional variable of a NetCDF file of the classic format (version 3), with its attributes ``units`` and
    others of the CF conventions, and pixels from its coordinates. NetCDF-4 is HDF5."""

    kind = "netcdf"
    suffixes = (".cdf",)
    marks = (b"CDF\x01", b"CDF\x02")
    channel_option = "variable"

    variable: str | None = None
    """name of the variable; None: the only one with two dimensions"""

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The variable as it is."""
        from scipy.io import netcdf_file

        source, variables = str(path), {}
        with (
            _content(path) as data,
            netcdf_file(_Metered(data), "r", mmap=False) as file,
        ):
            for name, one in file.variables.items():
                values = np.array(one[:] if one.dimensions else one[()])
                attributes = {
                    key: plain(value) for key, value in one._attributes.items()
                }
                attributes.setdefault("units", attributes.get("unit"))
                variables[name] = (one.dimensions, values, attributes)
        maps = [
            name
            for name, (dimensions, _, _) in variables.items()
            if len(dimensions) == 2
        ]
        heights_in = [
            name for name in maps if _is_length(variables[name][2]["units"])
        ]
        chosen = self.variable or next(
            (names[0] for names in (maps, heights_in) if len(names) == 1), None
        )
        if chosen not in maps:
            raise InputError(
                f"variable = {self.variable!r}: {source} has these of two dimensions: {', '.join(maps) or 'none'}; "
                "give one"
            )
        dimensions, values, attributes = variables[chosen]
        heights = unpacked(values, attributes, f"{source}:{chosen}")
        if (
            "mask" in maps
            and chosen != "mask"
            and variables["mask"][1].shape == heights.shape
        ):
            heights = np.where(variables["mask"][1] != 0, np.nan, heights)
        periodic, sides = True, []
        for dimension, count in zip(dimensions, heights.shape, strict=True):
            _, coordinate, about = variables.get(dimension, ((), np.empty(0), {}))
            unit = about.get("units")
            if "length" in about and unit:
                sides.append(f"{float(about['length']) / count!r} {unit}")
            elif (side := coordinate_side(coordinate, unit)) is not None:
                sides.append(side)
            periodic = periodic and bool(about.get("periodic"))
        stated = tuple(sides) if len(sides) == 2 else None
        notes = {"format": "netcdf", "channel": chosen}
        return as_map(
            heights,
            source,
            stated=stated,
            periodic=periodic,
            unit=attributes["units"],
            notes=notes,
        )


# -- points ------------------------------------------------------------------------------------------------------------


class Xyz(Instrument):
    """A list of points x, y, height on a grid, in any order, as text; where the grid has no point, it is missing.

    The text states no unit: give ``unit``, or the height unit and the pixel size of the surface.
    """

    kind = "xyz"
    suffixes = (".xyz",)

    unit: HeightUnit | None = None
    """unit of all three columns, such as "um", or a factor that converts them to nm"""
    pixel_size: Length | None = None
    """edge of a pixel, nm; needed only where the unit is not given"""

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The grid; the first index is that of x."""
        lines = tables.data_lines(tables.read_text(path), "#%")
        if not lines:
            raise StoreError(f"{path} holds no points")
        points = tables.numbers(lines, str(path), tables.separator_of(lines[0][1]))
        if points.shape[1] != 3:
            raise StoreError(
                f"{path} holds {points.shape[1]} columns; a list of points has three: x, y and height"
            )
        spacings, places = [], []
        for values, name in zip(points.T, "xy", strict=False):
            there = np.unique(values)
            # rounding in the file makes no new places
            steps = np.diff(there)
            step = (
                float(np.median(steps[steps > 1e-6 * np.ptp(there)]))
                if len(there) > 1
                else 0.0
            )
            if not (step > 0 and math.isfinite(step)):
                raise StoreError(
                    f"{path}: all points have one {name}; it is no image"
                )
            place = (values - there[0]) / step
            if np.abs(place - np.rint(place)).max() > EVEN * max(
                1.0, 0.1 * place.max()
            ):
                raise StoreError(
                    f"{path}: the points along {name} are not evenly spaced; grid them in another program"
                )
            places.append(np.rint(place).astype(np.int64))
            spacings.append(float(np.ptp(there)) / int(places[-1].max()))
        nx, ny = (int(place.max()) + 1 for place in places)
        if nx * ny > SPARSE * len(points):
            raise StoreError(
                f"{path}: {len(points)} points are no grid of {nx} x {ny}; grid them in another program"
            )
        heights = np.full((nx, ny), np.nan)
        heights[tuple(places)] = points[:, 2]
        sides = (
            None
            if self.unit is None
            else (spacings[0] * self.unit, spacings[1] * self.unit)
        )
        if self.pixel_size is not None:
            sides = (self.pixel_size, self.pixel_size)
        return HeightMap(
            heights, self.unit, sides, source=str(path), notes={"format": "xyz"}
        )
