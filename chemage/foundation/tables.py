"""Tables in text files, with errors that name the line and the column: of numbers alone, or of columns with names."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from datetime import datetime, time, timedelta
from operator import itemgetter
from os import SEEK_END, PathLike
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np

from chemage.foundation.errors import (
    InputError,
    StoreError,
    nearest,
    optional_module,
    shortened,
    shown,
)
from chemage.foundation.files import open_file, read_bytes
from chemage.foundation.files import read_text as read_text

#: number of a line, from 1, and its text
Line = tuple[int, str]
#: a text, or a number of a spreadsheet or data frame
Cell = str | float
#: number of a line, where it is in words, and its cells
Cells = tuple[int, str, list[Cell]]
#: lines among which the header is looked for
_PREAMBLE = 40
#: of a workbook: its parts, their bytes, cells with their values, other elements, attributes
_PARTS = 1000
_BYTES = 1 << 25
_CELLS = 300_000
_ELEMENTS = 10_000
_ATTRIBUTES = 1_000_000
_OF_CELLS = re.compile(rb"<(?:\w{1,20}:)?(?:row|c|v|f|si|t)[\s/>]")
_ELEMENT = re.compile(rb"<[A-Za-z_]")


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


# -- lines of cells ---------------------------------------------------------------------------------------------------


def lines_of(
    source: Any, named: Callable[[Sequence[Cells]], int], sheet: str | None = None
) -> tuple[str, list[Cells], list[str]]:
    """Read a text file, an Excel file or a data frame: what is read, in words; the lines that hold anything; and notes.

    Parameters
    ----------
    named
        How many columns the header among some lines names: by that separators, and the sheet, are found.
    sheet
        Of an Excel file; default: the only one whose columns are named.

    Raises
    ------
    StoreError
        The file cannot be read.
    InputError
        It is none of these, or has several such sheets.
    """
    if hasattr(source, "columns") and hasattr(source, "itertuples"):
        return "the data frame", _frame_lines(source), []
    if not isinstance(source, str | PathLike):
        raise InputError.of(
            "table", source, "is neither the path of a file nor a data frame"
        )
    path = Path(source)
    if path.suffix.lower() in (".xlsx", ".xlsm"):
        return str(path), *_excel_lines(path, named, sheet)
    if path.suffix.lower() in (".xls", ".ods"):
        raise InputError(
            f"{path}: files ending in {path.suffix} are not read; save it as .xlsx or as CSV"
        )
    if sheet is not None:
        raise InputError(f"{path}: has no sheets; leave the sheet {sheet!r} out")
    text = text_of(read_bytes(path), str(path))
    return str(path), _text_lines(text, str(path), named), []


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


def _text_lines(
    text: str, source: str, named: Callable[[Sequence[Cells]], int]
) -> list[Cells]:
    """The lines without comments, split by the separator by which most columns have names."""
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

    def split(part: Sequence[Line], mark: str | None) -> list[Cells]:
        return [
            (n, f"{source}, line {n}", [*_cells(line, mark)]) for n, line in part
        ]

    # of comments the last one, as numpy.savetxt writes the names
    commented = [
        (n, line.lstrip("# \t"))
        for n, line in every
        if line.lstrip().startswith("#")
    ]
    for part in (
        lines[:_PREAMBLE],
        *([line] for line in reversed(commented[:_PREAMBLE])),
    ):
        count, mark = max(
            ((named(split(part, mark)), mark) for mark in marks if mark),
            key=itemgetter(0),
        )
        if not count and None in marks:
            count, mark = named(split(part, None)), None
        if count > 1:
            more = [] if lines and part[0] == lines[0] else part
            return split([*more, *lines], mark)
    mark = next(
        (mark for mark in marks if mark and lines and mark in lines[0][1]), ","
    )
    return split(lines, mark)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:  # blanks, of which a name with its unit may have some
        line = line.strip()
        if re.match(r"[-+.,]?\d", line):
            return re.sub(r"\s*(±|\+/-)\s*", r"\1", line).split()
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


def _excel_lines(
    path: Path, named: Callable[[Sequence[Cells]], int], sheet: str | None
) -> tuple[list[Cells], list[str]]:
    """The lines of a sheet: the one that is wanted, else the only one with names of columns, else the first."""
    with open_file(path) as stream:
        openpyxl = optional_module("openpyxl", "excel")
        try:
            _check_book(stream)
            stream.seek(0)
            book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
            sheets = {sheet.title: _rows_of(sheet) for sheet in book.worksheets}
        except Exception as error:  # of whatever is in it
            raise StoreError(
                f"{path} is no Excel file that can be read: {shortened(error, 200)}"
            ) from None
    filled = [title for title, rows in sheets.items() if rows]
    if sheet is not None and sheet not in sheets:
        raise InputError(
            f"{path}: has no sheet {sheet!r}{nearest(sheet, list(sheets))}; it has {', '.join(sheets)}"
        )
    if sheet is None and len(filled) > 1:
        found = [title for title in filled if named(_beginning(sheets[title]))]
        if len(found) > 1:
            raise InputError(
                f"{path}: the sheets {', '.join(found)} hold tables; choose one as the sheet (--sheet {found[0]!r})"
            )
        filled = [*found, *(title for title in filled if title not in found)]
    title = sheet or next(iter(filled), "")
    rows = sheets.get(title, [])
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


def _beginning(rows: Sequence[tuple[int, list[Any]]]) -> list[Cells]:
    """The first lines of a sheet as texts, in which its header is looked for."""
    return [
        (number, "", ["" if value is None else str(value) for value in row])
        for number, row in rows[:_PREAMBLE]
    ]


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
        last = next(
            (at for at in range(len(row), 0, -1) if row[at - 1] is not None), 0
        )
        if last:
            rows.append((number, list(row[:last])))
    return rows


def _frame_lines(frame: Any) -> list[Cells]:
    index = getattr(frame, "index", None)
    names = [name for name in getattr(index, "names", ()) if name is not None]
    if names:
        frame = frame.reset_index()
    heads = [name if isinstance(name, tuple) else (name,) for name in frame.columns]
    lines: list[Cells] = [
        (
            0,
            "the data frame",
            [str(one[level]) if level < len(one) else "" for one in heads],
        )
        for level in range(max(map(len, heads), default=0))
    ]
    for number, row in enumerate(frame.itertuples(index=False, name=None)):
        at = f"the data frame, row {number}"
        lines.append((number, at, [_cell(value, at) for value in row]))
    return lines


def _cell(value: Any, where: str) -> Cell:
    if value is None or isinstance(value, str):
        return " ".join((value or "").replace("\u2212", "-").split())
    if isinstance(value, timedelta | time):
        if isinstance(value, time):
            value = datetime.combine(datetime.min, value) - datetime.min
        hours, seconds = divmod(value.total_seconds(), 3600)
        return f"{hours:.0f}:{seconds // 60:02.0f}:{seconds % 60:09.6f}"
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        remedy = "; spreadsheets make dates of numbers such as 1.5: format the cells as numbers"
        raise InputError(
            f"{where}: {shown(value)} is not a number{remedy if hasattr(value, 'isoformat') else ''}"
        )
    return float(value)
