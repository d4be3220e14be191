"""Tables in text files, with errors that name the line and the column: of numbers alone, or of columns with names."""

from __future__ import annotations

import csv
import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from os import SEEK_END, PathLike
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np

from chemage.foundation.errors import (
    InputError,
    StoreError,
    UnitError,
    nearest,
    optional_module,
    shortened,
    shown,
)
from chemage.foundation.files import open_file, read_bytes
from chemage.foundation.files import read_text as read_text
from chemage.foundation.units import convert

#: number of a line, from 1, and its text
Line = tuple[int, str]
#: a text, or a number of a spreadsheet or data frame
Cell = str | float
#: number of a line, where it is in words, and its cells
Cells = tuple[int, str, list[Cell]]
#: lines among which the header is looked for
_PREAMBLE = 40
#: rows and columns of a table with names, characters of a name, and ways to write the unit of a column
_ROWS, _COLUMNS, _LONGEST, _SPELLINGS = 100_000, 1000, 200, 100
#: of a workbook: its parts, their bytes, cells with their values, other elements, attributes
_PARTS = 1000
_BYTES = 1 << 25
_CELLS = 300_000
_ELEMENTS = 10_000
_ATTRIBUTES = 1_000_000
_OF_CELLS = re.compile(rb"<(?:\w{1,20}:)?(?:row|c|v|f|si|t)[\s/>]")
_ELEMENT = re.compile(rb"<[A-Za-z_]")
_NUMBER = re.compile(
    r"(?P<number>[-+]?(?:\d+(?:[.,]\d+)*[.,]?|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\W\d_].*|[°%].*)?"
)
_PLAIN_NUMBERS = "write decimals with a point and no marks of thousands"


def data_lines(text: str, comments: str = "#") -> list[Line]:
    """List the lines that hold data, without comments, which begin with one of the characters ``comments``."""
    lines = []
    for number, line in enumerate(text.splitlines(), 1):
        for mark in comments:
            line = line.partition(mark)[0]
        if line.strip():
            lines.append((number, line))
    return lines


def separator_of(line: str) -> str | None:
    """The separator of columns in ``line``: comma, semicolon or tab, the first that it contains; None for blanks."""
    return next((mark for mark in ",;\t" if mark in line), None)


def numbers(
    lines: Sequence[Line], source: str, separator: str | None = None
) -> np.ndarray:
    """Read lines of numbers: (rows, columns) float64. ``separator`` None means blanks.

    Raises
    ------
    StoreError
        A cell is not a number, or lines have different numbers of columns; names ``source``, line and column.
    """
    try:
        return np.loadtxt(
            [line for _, line in lines], delimiter=separator, comments=None, ndmin=2
        )
    except (
        ValueError
    ) as error:  # numpy counts rows without comments; find the line and the column
        cells = [line.split(separator) for _, line in lines]
        for (number, _), row in zip(lines, cells, strict=True):
            for column, cell in enumerate(row, 1):
                try:
                    float(cell)
                except ValueError:
                    where = f"{source}, line {number}, column {column}"
                    raise StoreError(
                        f"{where}: {shown(cell.strip())} is not a number"
                    ) from None
            if len(row) != len(cells[0]):
                raise StoreError(
                    f"{source}, line {number}: {len(row)} columns where line {lines[0][0]} has {len(cells[0])}"
                ) from None
        raise StoreError(
            f"{source} is not a table of numbers: {shortened(error, 200)}"
        ) from None


@dataclass(frozen=True)
class ColumnTable:
    """The header and the rows of a table."""

    #: name -> place, and unit; None where it has none
    columns: dict[str, tuple[int, str | None]]
    #: where the header is, in words
    where: str
    #: number of the line, where it is in words, and its cells, one for each column
    rows: list[Cells]
    #: what was left out or understood, for users
    notes: tuple[str, ...] = ()
    #: mark of decimals
    decimal: str = "."

    def number(self, row: Cells, name: str, target: str) -> float:
        """The finite number of a column in a row, in the unit ``target``; "" for pure numbers.

        Raises
        ------
        InputError
            The cell holds none, or no unit says what it is.
        """
        value, own, where = self._value(row, name)
        return in_unit(
            value, unit_of(own, name) or self.columns[name][1], name, target, where
        )

    def error(self, row: Cells, of: str, value: float, target: str) -> float:
        """The standard error of ``value`` in a row: in its own unit, else that of the column ``of``, or in %."""
        error, own, where = self._value(row, "error")
        unit = unit_of(own, "error") or self.columns["error"][1]
        if unit == "%" and target:
            return error / 100 * abs(value)
        return in_unit(
            error, self.columns[of][1] if unit is None else unit, "error", target, where
        )

    def _value(self, row: Cells, name: str) -> tuple[float, str, str]:
        """A finite number as it is written, its unit where it has one, and where that, or the unit of all, stands."""
        cell, where = row[2][self.columns[name][0]], f"{row[1]}, column {name}"
        if not isinstance(cell, str):
            value, own = float(cell), ""
        elif (match := _NUMBER.fullmatch(cell)) is None:
            lost = cell.lower() in ("", "nan", "inf", "-inf", "n/a", "na", "-", "--")
            remedy = (
                "fill in the number, or leave that row out" if lost else _PLAIN_NUMBERS
            )
            raise InputError(
                f"{where}: {shown(cell)} is not a {'finite ' * lost}number; {remedy}"
            )
        else:
            value = float(match["number"].replace(self.decimal, "."))
            own = match["unit"] or ""
        if not math.isfinite(value):
            raise InputError(
                f"{where}: {shown(cell)} is not a finite number; leave that row out"
            )
        return value, own, where if own else self.where


def read_columns(
    source: Any,
    known: Mapping[str, str],
    example: str,
    unclear: Mapping[str, str] | None = None,
) -> ColumnTable:
    """Read a table with named columns: a text file, an Excel file (.xlsx) or a data frame.

    Of text, commas, semicolons, tabs or blanks separate the columns, and UTF-8, UTF-16 and Windows code pages are read.
    Decimals have a point or a comma, the same one everywhere; what could be a thousand or a decimal is refused. The
    first line that names columns is the header; units stand in brackets, after a comma or a slash, at the end of the
    name after ``_``, in the line below the header, or with the numbers. Columns with other names are left out.

    Parameters
    ----------
    known
        Names that columns may have -> other spellings, separated by ``|``; case matters in single letters.
    example
        A header for messages.
    unclear
        What to do instead -> names that may mean two things, separated by ``|``.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        It is empty, or a line does not have the columns; names line and column, and the remedy.
    """
    name, lines, notes = _lines(source, known)
    if not lines:
        raise InputError(
            f"{name}: there is nothing in it; the first line names the columns, such as {example}"
        )
    first = next(
        (
            at
            for at, (_, _, cells) in enumerate(lines[:_PREAMBLE])
            if _is_header(cells, known)
        ),
        0,
    )
    if first:
        notes.append(
            f"{first} line{'s' * (first > 1)} before the names of the columns left out"
        )
    (_, where, header), *rest = lines[first:]
    if len(rest) > _ROWS or len(header) > _COLUMNS:
        raise InputError(
            f"{where}: {len(rest)} rows below {len(header)} columns; a table has at most {_ROWS} rows and {_COLUMNS} "
            "columns: leave out what is not needed"
        )
    columns, more = _header(header, where, known, unclear or {}, example)
    if rest and (units := _units_below(rest[0][2], columns)) is not None:
        columns, rest = units, rest[1:]
    rows = [(number, at, _row(cells, len(header), at)) for number, at, cells in rest]
    decimal = _decimal(rows, [place for place, _ in columns.values()])
    return ColumnTable(columns, where, rows, (*notes, *more), decimal)


def unit_of(text: str | None, name: str) -> str | None:
    """The unit that is meant in a column of this name, as :mod:`chemage.foundation.units` has it."""
    if text is None:
        return None
    text = " ".join(text.replace("\u03bc", "u").replace("\u00b5", "u").split())
    if name == "temperature" and (
        match := re.fullmatch(
            r"(?:°|deg|º)?\s*(C|F|celsius|fahrenheit)|(℃)", text, re.I
        )
    ):
        return "degF" if (match[1] or "C")[0] in "fF" else "degC"
    return {"-": "", "–": "", "—": "", "1": "", "sec": "s", "percent": "%"}.get(
        text, text
    )


def in_unit(
    value: float, unit: str | None, name: str, target: str, where: str
) -> float:
    """A number of a column in the unit ``target``; "" for pure numbers.

    Raises
    ------
    UnitError
        The unit is missing, or another quantity's.
    """
    if unit in (None, ""):
        if target:
            raise UnitError(
                f"{where}: the column {name} has no unit; write it as {name} ({target})"
            )
        return value
    try:
        zero, one = _line(unit, target)
    except UnitError as error:
        raise UnitError(f"{where}: the column {name} ({unit}): {error}") from None
    return zero + value * (one - zero) if zero else value * one


@lru_cache(maxsize=256)
def _line(unit: str, target: str) -> tuple[float, float]:
    """What 0 and 1 of ``unit`` are in ``target``: zeros of temperatures differ."""
    one = convert(f"1 {unit}", target)
    return convert(f"0 {unit}", target), one


# -- lines of cells ---------------------------------------------------------------------------------------------------


def _lines(source: Any, known: Mapping[str, str]) -> tuple[str, list[Cells], list[str]]:
    """What is read, in words; the lines that hold anything; and notes."""
    if hasattr(source, "columns") and hasattr(source, "itertuples"):
        return "the data frame", _frame_lines(source), []
    if not isinstance(source, str | PathLike):
        raise InputError.of(
            "table", source, "is neither the path of a file nor a data frame"
        )
    path = Path(source)
    if path.suffix.lower() in (".xlsx", ".xlsm"):
        return str(path), *_excel_lines(path)
    if path.suffix.lower() in (".xls", ".ods"):
        raise InputError(
            f"{path}: files ending in {path.suffix} are not read; save it as .xlsx or as CSV"
        )
    return (
        str(path),
        _text_lines(text_of(read_bytes(path), str(path)), str(path), known),
        [],
    )


def text_of(data: bytes, source: str) -> str:
    """Decode a text: UTF-8, UTF-16 with or without its mark, or the Windows code page 1252.

    Raises
    ------
    StoreError
        It is none: it holds control characters.
    """
    code = "utf-8-sig"
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        code = "utf-16"
    for first, name in (
        (1, "utf-16-le"),
        (0, "utf-16-be"),
    ):  # every other byte of western text is zero
        if data[first:64:2].count(0) > 0.8 * len(data[first:64:2]):
            code = name
    for name in (code, "cp1252"):
        try:
            text = data.decode(name).removeprefix("\ufeff")
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1f]", text):
            return text
    raise StoreError(f"{source} is not a text file")


def _text_lines(text: str, source: str, known: Mapping[str, str]) -> list[Cells]:
    """The lines without comments, split by the separator that makes a header of one of them."""
    text = re.sub("[\u00a0\u202f\u2007]", " ", text.replace("\u2212", "-"))
    every = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip(' \t,;"')
    ]
    lines = [line for line in every if not line[1].lstrip().startswith("#")]
    marks: list[str | None] = [";", "\t", ",", None]
    if lines and (
        match := re.fullmatch(r'"?sep=(.)"?\s*', lines[0][1])
    ):  # as Excel writes and reads it
        marks, lines = [match[1]], lines[1:]
    begin = next(
        (at for at, (_, line) in enumerate(lines) if re.match(r'\s*"?[-+.]?\d', line)),
        len(lines),
    )
    # of comments the last one, as numpy.savetxt writes the names
    commented = [
        (n, line.lstrip("# \t")) for n, line in every if line.lstrip().startswith("#")
    ]
    for number, line in [
        *lines[: min(begin + 1, _PREAMBLE)],
        *reversed(commented[:_PREAMBLE]),
    ]:
        for mark in marks:
            if len(cells := _cells(line, mark)) > 1 and _is_header(cells, known):
                if (number, line) not in lines:
                    lines = [(number, line), *lines]
                return [
                    (n, f"{source}, line {n}", list(_cells(line, mark)))
                    for n, line in lines
                ]
    mark = next((mark for mark in marks if mark and lines and mark in lines[0][1]), ",")
    return [(n, f"{source}, line {n}", list(_cells(line, mark))) for n, line in lines]


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:  # blanks, of which a name with its unit may have some
        line = line.strip()
        if re.match(r"[-+.,]?\d", line):
            return line.split()
        parts = re.split(r"\t|\s{2,}", line)
        return (
            parts
            if len(parts) > 1
            else re.findall(r'"[^"]*"|[^\s(\[]+(?:\s*[(\[][^()\[\]]*[)\]])?', line)
        )
    try:
        return [
            cell.strip()
            for cell in next(
                csv.reader([line], delimiter=separator, skipinitialspace=True), []
            )
        ]
    except csv.Error as error:  # a cell of more than 131072 characters
        raise InputError(f"{shown(line, 40)}: {error}") from None


def _excel_lines(path: Path) -> tuple[list[Cells], list[str]]:
    """The lines of the first sheet that holds anything."""
    with open_file(path) as stream:
        openpyxl = optional_module("openpyxl", "excel")
        try:
            _check_book(stream)
            stream.seek(0)
            book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
            sheets = [(sheet.title, _rows_of(sheet)) for sheet in book.worksheets]
        except Exception as error:  # of whatever is in it
            raise StoreError(
                f"{path} is no Excel file that can be read: {shortened(error, 200)}"
            ) from None
    filled = [(title, rows) for title, rows in sheets if rows]
    if not filled:
        return [], []
    title, rows = filled[0]
    notes = (
        [f"sheet {title!r} is read; {len(filled) - 1} others are left out"]
        if len(filled) > 1
        else []
    )
    lines = []
    for number, row in rows:
        at = f"{path}, sheet {title}, row {number}"
        cells = [_cell(value, at) for value in row]
        if any(cell != "" for cell in cells) and not str(cells[0]).startswith("#"):
            lines.append((number, at, cells))
    width = max(
        (
            at + 1
            for _, _, cells in lines
            for at, cell in enumerate(cells)
            if cell != ""
        ),
        default=0,
    )
    if len(lines) * width > 10 * _CELLS:
        raise InputError(
            f"{path}, sheet {title}: {len(lines)} rows and {width} columns are no table; delete the cells far from it"
        )
    return [
        (number, at, [*cells[:width], *[""] * (width - len(cells))])
        for number, at, cells in lines
    ], notes


def _check_book(stream: IO[bytes]) -> None:
    """Refuse a workbook whose parts, when unpacked, take much longer to read than a table does."""
    size = stream.seek(0, SEEK_END)
    with ZipFile(stream) as archive:
        parts = archive.infolist()
        unpacked = sum(part.file_size for part in parts)
        if len(parts) > _PARTS or unpacked > _BYTES + size:
            raise ValueError(
                f"{len(parts)} parts of {unpacked} bytes in all; save the table alone, or as CSV"
            )
        cells = elements = attributes = 0
        for part in parts:
            data = archive.read(part).replace(b"\0", b"")  # in UTF-16 as in UTF-8
            if not data.lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n").startswith(b"<"):
                continue  # a picture
            if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
                raise ValueError("its XML defines entities")
            of_cells = len(_OF_CELLS.findall(data))
            cells += of_cells
            elements += len(_ELEMENT.findall(data)) - of_cells
            attributes += data.count(b"=")
    if cells > _CELLS or elements > _ELEMENTS or attributes > _ATTRIBUTES:
        raise ValueError(
            f"{cells + elements} elements are too many; save the table alone, or as CSV"
        )


def _rows_of(sheet: Any) -> list[tuple[int, list[Any]]]:
    """The rows of a sheet that hold anything, each with its number, up to its last cell."""
    sheet.reset_dimensions()  # which may be wrong
    rows, cells = [], 0
    for number, row in enumerate(sheet.iter_rows(values_only=True), 1):
        cells += len(row)
        if number > 1 << 20 or len(row) > 1 << 14 or cells > 10 * _CELLS:
            raise ValueError(
                f"it has cells at row {number}, column {len(row)}; delete what is far from the table"
            )
        last = next((at for at in range(len(row), 0, -1) if row[at - 1] is not None), 0)
        if last:
            rows.append((number, list(row[:last])))
    return rows


def _frame_lines(frame: Any) -> list[Cells]:
    index = getattr(frame, "index", None)
    names = [name for name in getattr(index, "names", ()) if name is not None]
    if names:
        frame = frame.reset_index()
    heads = [
        f"{name[0]} ({name[1]})".removesuffix(" ()")
        if isinstance(name, tuple) and len(name) == 2
        else str(name)
        for name in frame.columns
    ]
    lines: list[Cells] = [(0, "the data frame", list(heads))]
    for number, row in enumerate(frame.itertuples(index=False, name=None)):
        at = f"the data frame, row {number}"
        lines.append((number, at, [_cell(value, at) for value in row]))
    return lines


def _cell(value: Any, where: str) -> Cell:
    if value is None or isinstance(value, str):
        return " ".join((value or "").replace("\u2212", "-").split())
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        remedy = "; spreadsheets make dates of numbers such as 1.5: format the cells as numbers"
        raise InputError(
            f"{where}: {shown(value)} is not a number{remedy if hasattr(value, 'isoformat') else ''}"
        )
    return float(value)


# -- header -----------------------------------------------------------------------------------------------------------

#: what follows a name: a unit in brackets, or after a comma or a slash
_IN_BRACKETS = re.compile(r"[(\[{]([^()\[\]{}]*)[)\]}]$")


def _named(cell: Cell, known: Mapping[str, str]) -> tuple[str, str | None] | None:
    """Name and unit of a column that is known."""
    text = str(cell).strip().strip('"').strip()
    if not text or len(text) > _LONGEST:
        return None
    text, unit = _parted(text)
    found = _known(text, known)
    if found is None and unit is None and "_" in text:  # hold_time_s
        stem, _, unit = text.rpartition("_")
        found = _known(stem, known)
    return None if found is None else (found, unit_of(unit, found))


def _parted(text: str) -> tuple[str, str | None]:
    """A heading as a name and its unit, in brackets, or after a comma or a slash."""
    brackets = _IN_BRACKETS.search(text)
    *_, last = text.rsplit(None, 1)
    begin = len(text) - len(last)
    head = text[:begin].rstrip()
    place = begin + min(
        (at for mark in ",/" if 0 <= (at := last.find(mark)) < len(last) - 1),
        default=len(last),
    )
    if head.endswith(",") or (
        head.endswith("/") and (begin - len(head) == 1 or head[-2:-1].isspace())
    ):
        place = len(head) - 1
    if place < (brackets.start() if brackets else len(text)):
        return text[:place].rstrip(), text[place + 1 :].strip()
    if brackets:
        return text[: brackets.start()].rstrip(), brackets[1].strip()
    return text, None


def _known(text: str, known: Mapping[str, str]) -> str | None:
    text = re.sub(r"[\s_\-]+", " ", text).strip()
    for name, others in known.items():
        for other in (name.replace("_", " "), *filter(None, others.split("|"))):
            if text == other or (len(other) > 2 and text.lower() == other.lower()):
                return name
    return None


def _is_header(cells: Sequence[Cell], known: Mapping[str, str]) -> bool:
    """Whether two cells name columns, or one of two that a mistake is in."""
    return sum(_named(cell, known) is not None for cell in cells[:_COLUMNS]) >= min(
        2, len(cells)
    )


def _header(
    cells: Sequence[Cell],
    where: str,
    known: Mapping[str, str],
    unclear: Mapping[str, str],
    example: str,
) -> tuple[dict[str, tuple[int, str | None]], list[str]]:
    columns: dict[str, tuple[int, str | None]] = {}
    left, read = [], []
    for place, cell in enumerate(cells):
        found = _named(cell, known)
        text = " ".join(str(cell).split())
        if found is None:
            if not text:
                continue
            head = re.sub(r"[\s_]+", " ", re.sub(r"[(\[,/].*", "", text)).strip()
            if (question := _known(head, unclear)) is not None:
                raise InputError(
                    f"{where}: column {place + 1}, {shown(text)}, {question}"
                )
            head = head.lower().replace(" ", "_")
            number = _NUMBER.fullmatch(text) is not None
            if number or difflib.get_close_matches(head, known, n=1, cutoff=0.7):
                raise InputError(
                    f"{where}: column {place + 1} is {shown(text)}{'' if number else nearest(head, list(known))}; the "
                    f"columns are {', '.join(known)}, named on the first line, such as {example}"
                )
            left.append(text)
            continue
        name, unit = found
        if name in columns:
            raise InputError(f"{where}: the column {name} is there twice; keep one")
        columns[name] = place, unit
        if not re.sub(r"[\s_]+", "_", text.lower()).startswith(name):
            read.append(f"{text} as {name}")
    notes = [f"read {', '.join(read)}"] if read else []
    if left:
        notes.append(
            f"{len(left)} column{'s' * (len(left) > 1)} left out: {shortened(', '.join(left), 120)}"
        )
    return columns, notes


def _units_below(
    cells: Sequence[Cell], columns: dict[str, tuple[int, str | None]]
) -> dict[str, tuple[int, str | None]] | None:
    """The columns with the units of the line below their names; None where it is a line of numbers."""
    texts = {
        name: str(cells[place]).strip("()[] ")
        for name, (place, _) in columns.items()
        if place < len(cells)
    }
    if not any(texts.values()) or any(
        re.match(r"[-+.,]*\d", text) and text != "1" for text in texts.values()
    ):
        return None
    if any(
        text and unit is not None
        for text, (_, unit) in zip(texts.values(), columns.values(), strict=False)
    ):
        return None
    return {
        name: (place, unit_of(texts.get(name) or None, name) or unit)
        for name, (place, unit) in columns.items()
    }


# -- numbers ----------------------------------------------------------------------------------------------------------


def _row(cells: list[Cell], columns: int, where: str) -> list[Cell]:
    while len(cells) > columns and cells[-1] == "":
        cells = cells[:-1]
    if len(cells) != columns:
        more = ""
        if len(cells) > columns:
            more = "; separate columns by semicolons or tabs where decimals have a comma, and quote texts with blanks"
        raise InputError(f"{where}: {len(cells)} values under {columns} columns{more}")
    return cells


def _decimal(rows: Sequence[Cells], places: Sequence[int]) -> str:
    """The mark of decimals, a comma or a point; what could be thousands, or mixes both, is refused."""
    sure: dict[str, str] = {}
    unsure: dict[str, tuple[str, str]] = {}
    for place in places:
        texts = [(at, cells[place]) for _, at, cells in rows]
        matches = [
            (at, _NUMBER.fullmatch(cell)) for at, cell in texts if isinstance(cell, str)
        ]
        column = [(at, match["number"]) for at, match in matches if match]
        if len({match["unit"] for _, match in matches if match}) > _SPELLINGS:
            raise InputError(
                f"{texts[0][0]}: a column with more than {_SPELLINGS} units; write one above the column"
            )
        whole = any(text.lstrip("+-").isdigit() for _, text in column)
        for at, text in column:
            if sum(text.count(mark) for mark in ",.") > 1:
                raise InputError(
                    f"{at}: {text} has marks of thousands; {_PLAIN_NUMBERS}"
                )
            for mark in (mark for mark in ",." if mark in text):
                if re.fullmatch(rf"[+-]?[1-9]\d{{0,2}}[{mark}]\d{{3}}", text) and (
                    whole or mark == ","
                ):
                    unsure[mark] = at, text
                else:
                    sure[mark] = at
    for mark, (at, text) in unsure.items():
        if mark not in sure:
            other = f"{text.replace(mark, '')} or {text.replace(mark, '.')}"
            raise InputError(f"{at}: {text} may be {other}; {_PLAIN_NUMBERS}")
    if len(sure) > 1:
        raise InputError(
            f"{sure[',']}: it has a decimal comma, where others have a point; {_PLAIN_NUMBERS}"
        )
    return next(iter(sure), ".")
