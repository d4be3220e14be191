"""Reader of height maps in text files: tables, and what instruments and Gwyddion export."""

from __future__ import annotations

import math
import re
from os import PathLike
from typing import Any

from pydantic import ValidationInfo, field_validator

from chemage import InputError
from chemage.plugin import HeightMap, StoreError, open_file, tables
from chemage_surfaces.readers import Unitless, as_map, stated_length

#: byte order marks of UTF-16
UTF16 = (b"\xff\xfe", b"\xfe\xff")


def _field(names: str, value: str = r"[^,;]") -> re.Pattern[str]:
    return re.compile(
        rf"^(?:{names})\s*[:=]\s*(?P<value>(?!\s){value}+)$", re.IGNORECASE
    )


#: what a header states, in English and in German; decimal commas in the sides
_FIELDS = {
    "pixel_size": _field(r"pixel[ _]size"),
    "unit": _field(r"(?:value|height|z)[ _]units?|werteeinheiten?|data unit"),
    "width": _field("width|breite", "."),
    "height": _field("height|höhe", "."),
    "channel": _field("channel|kanal", "."),
    "rows": re.compile(r"\bh=(?P<value>\d{1,9})\b"),
    "columns": re.compile(r"\bw=(?P<value>\d{1,9})\b"),
    "factor": re.compile(r"^height conversion factor \(-> \w+\)=(?P<value>\S+)$"),
    "factor_unit": re.compile(r"^height conversion factor \(-> (?P<value>\w+)\)="),
}
#: a line of the header of an interferometer, such as h=650 w=650
_HEADER = re.compile(r"\s*[a-z][\w ()>-]*=", re.IGNORECASE)
#: a row whose numbers have decimal commas and another separator
_DECIMAL_COMMA = re.compile(
    r"\s*[+-]?\d+,\d+(?:e[+-]?\d+)?\s*?(?P<separator>[;\t])", re.IGNORECASE
)


class Text(Unitless):
    """A table of heights with one scan line per line, as instruments write them: line j, column i is pixel (i, j).

    Columns are separated by commas, semicolons, tabs or blanks. Lines that begin with ``#`` or ``%`` are comments; the
    comment ``# pixel_size = 0.45 nm`` gives the pixel size, ``# value units: m`` the unit of the heights. A header may
    state the sides of the image (text export of Gwyddion, in English or German: ``# Width: 2 µm``), or the numbers of
    its pixels (``h=650 w=650``). A table with ``pixel_size`` and neither of these is one of arrays: there line i, column
    j is pixel (i, j).
    """

    kind = "text"
    suffixes = (".txt", ".dat", ".csv", ".tsv", ".asc")

    @classmethod
    def claims(cls, head: bytes, path: str | PathLike[str]) -> bool | None:
        """A binary file is no text; of a text, the ending tells."""
        return False if b"\0" in head and head[:2] not in UTF16 else None

    delimiter: str | None = None
    """separator of columns; None: comma, semicolon or tab, whichever the first row contains, else blanks"""
    comments: str = "#%"
    """characters that begin a comment"""
    transpose: bool = False
    """whether lines and columns of the table are exchanged before it is read"""

    @field_validator("delimiter", "comments")
    @classmethod
    def _no_part_of_a_number(
        cls, value: str | None, info: ValidationInfo
    ) -> str | None:
        if value is None:
            return value
        if info.field_name == "delimiter" and len(value) != 1:
            raise ValueError("give one character, or leave it out")
        if any(letter.isalnum() or letter in "+-._\n\r" for letter in value):
            raise ValueError(
                "letters, digits, signs, points and line ends are parts of numbers; give another character"
            )
        return value

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The array as it is, with its unit if the header states it."""
        with open_file(path) as file:
            data = file.read()
        try:
            text = (
                data.decode("utf-16")
                if data[:2] in UTF16
                else tables.read_text(path)
            )
        except UnicodeDecodeError:
            raise StoreError(f"{path} is not a text file") from None
        lines = tables.data_lines(text, self.comments)
        # the header of an instrument has no comment character
        first = next(
            (
                place
                for place, (_, line) in enumerate(lines)
                if not _HEADER.match(line)
            ),
            len(lines),
        )
        lines = lines[first:]
        if not lines:
            raise StoreError(f"{path} holds no numbers")
        header = text.splitlines()[: lines[0][0] - 1]
        bare = [line.strip().lstrip(self.comments).strip() for line in header]
        found = {
            name: match["value"]
            for name, pattern in _FIELDS.items()
            for line in bare
            if (match := pattern.search(line))
        }
        separator = self.delimiter
        if separator is None and (match := _DECIMAL_COMMA.match(lines[0][1])):
            separator = match["separator"]
            lines = [(number, line.replace(",", ".")) for number, line in lines]
        separator = separator or tables.separator_of(lines[0][1])
        heights = tables.numbers(lines, str(path), separator)
        return self._of_instrument(heights, found, str(path))

    def _of_instrument(
        self, heights: Any, found: dict[str, str], source: str
    ) -> HeightMap:
        """The map of the rows, by the fields of the header."""
        counts = (found.get("columns"), found.get("rows"))
        if (
            None not in counts
            and (int(counts[0] or 0), int(counts[1] or 0)) != heights.shape[::-1]
        ):
            raise StoreError(
                f"{source} states {counts[0]} x {counts[1]} pixels, but holds {heights.shape[1]} columns and "
                f"{heights.shape[0]} rows; it is damaged or no image"
            )
        stated, unit = found.get("pixel_size"), found.get("unit")
        if "factor" in found:
            factor = float(
                tables.numbers(
                    [(1, found["factor"])], f"{source}, conversion factor"
                ).flat[0]
            )
            if not 0 < factor < math.inf:
                raise StoreError(
                    f"{source} states a conversion factor of {factor:g} for its heights; it is above 0"
                )
            heights, unit = heights * factor, found["factor_unit"]
        sized = "width" in found or "height" in found or None not in counts
        if not found and heights.shape[1] == 3 < len(heights):
            raise InputError(
                f"{source} has three columns and no header, as a list of points x, y, height has; give reader = "
                '"xyz" if it is one, or transpose the table'
            )
        # in arrays lines are along y, and a header of arrays has only the size of a pixel
        if (sized or "pixel_size" not in found) != self.transpose:
            heights = heights.T
        if "width" in found and "height" in found and self.pixel_size is None:
            sides = (
                found["width"].replace(",", "."),
                found["height"].replace(",", "."),
            )
            stated = tuple(
                stated_length(side, source) / count
                for side, count in zip(sides, heights.shape, strict=True)
            )
        notes = {"channel": found["channel"]} if "channel" in found else {}
        if not found:
            notes["lines"] = "along y" if self.transpose else "along x"
        return as_map(
            heights,
            source,
            pixel_size=self.pixel_size,
            stated=stated,
            unit=unit,
            notes=notes,
        )
