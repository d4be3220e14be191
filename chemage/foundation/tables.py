"""Tables in text files, with errors that name the line and the column: of numbers alone, or of columns with names."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from chemage.foundation.errors import InputError, StoreError, UnitError, nearest, shortened, shown
from chemage.foundation.files import read_text as read_text
from chemage.foundation.units import convert

#: number of a line, from 1, and its text
Line = tuple[int, str]


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


def numbers(lines: Sequence[Line], source: str, separator: str | None = None) -> np.ndarray:
    """Read lines of numbers: (rows, columns) float64. ``separator`` None means blanks.

    Raises
    ------
    StoreError
        A cell is not a number, or lines have different numbers of columns; names ``source``, line and column.
    """
    try:
        return np.loadtxt([line for _, line in lines], delimiter=separator, comments=None, ndmin=2)
    except ValueError as error:  # numpy counts rows without comments; find the line and the column
        cells = [line.split(separator) for _, line in lines]
        for (number, _), row in zip(lines, cells, strict=True):
            for column, cell in enumerate(row, 1):
                try:
                    float(cell)
                except ValueError:
                    where = f"{source}, line {number}, column {column}"
                    raise StoreError(f"{where}: {shown(cell.strip())} is not a number") from None
            if len(row) != len(cells[0]):
                raise StoreError(
                    f"{source}, line {number}: {len(row)} columns where line {lines[0][0]} has {len(cells[0])}"
                ) from None
        raise StoreError(f"{source} is not a table of numbers: {shortened(error, 200)}") from None


@dataclass(frozen=True)
class ColumnTable:
    """The header and the rows of a file, as text."""

    #: name -> place, and unit; None where it has none
    columns: dict[str, tuple[int, str | None]]
    #: where the header is, in words
    where: str
    #: number of the line, where it is in words, and its cells, one for each column
    rows: list[tuple[int, str, list[str]]]


def read_columns(source: Path, known: Sequence[str], example: str, listed: str = "") -> ColumnTable:
    """Read a file of columns separated by commas, semicolons or tabs.

    Parameters
    ----------
    known
        Names that columns may have.
    example
        A header for messages.
    listed
        The names in words for messages; default: ``known``.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        It is empty, or a line does not have the columns.
    """
    lines = [line for line in data_lines(read_text(source)) if line[1].strip(" \t,;")]
    if not lines:
        raise InputError(f"{source}: there is nothing in it; the first line names the columns, such as {example}")
    (first, header), *rest = lines
    separator = next((mark for mark in (";", "\t") if mark in header), ",")
    where = f"{source}, line {first}"
    columns = _header(_cells(header, separator), where, known, example, listed or ", ".join(known))
    rows = []
    for number, line in rest:
        at = f"{source}, line {number}"
        rows.append((number, at, _row(_cells(line, separator), len(columns), at)))
    return ColumnTable(columns, where, rows)


def number(cell: str, where: str) -> float:
    """The finite number in a cell; ``where`` names line and column.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        value = float(cell)
    except ValueError:
        point = "; write a decimal point" * ("," in cell)
        raise InputError(f"{where}: {shown(cell)} is not a number{point}") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {shown(cell)} is not a finite number; leave that row out")
    return value


def factor(name: str, unit: str | None, target: str, where: str) -> float:
    """What numbers of a column are multiplied with to be in the unit ``target``; "" for pure numbers.

    Raises
    ------
    UnitError
        The unit is missing, or another quantity's.
    """
    if unit in (None, "", "1"):
        if target:
            raise UnitError(f"{where}: the column {name} has no unit; write it as {name} ({target})")
        return 1.0
    try:
        return convert(f"1 {unit}", target)
    except UnitError as error:
        raise UnitError(f"{where}: the column {name} ({unit}): {error}") from None


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
    except csv.Error as error:  # a cell of more than 131072 characters
        raise InputError(f"{shown(line, 40)}: {error}") from None


def _header(
    cells: list[str], where: str, known: Sequence[str], example: str, listed: str
) -> dict[str, tuple[int, str | None]]:
    columns: dict[str, tuple[int, str | None]] = {}
    for place, cell in enumerate(cells):
        match = re.fullmatch(r"(?P<name>[^(\[]*?)\s*(?:[(\[]\s*(?P<unit>.*?)\s*[)\]])?", cell)
        name = match["name"].strip().lower().replace(" ", "_") if match else cell
        if match is None or name not in known:
            raise InputError(
                f"{where}: column {place + 1} is {shown(cell)}{nearest(name, known)}; the columns are {listed}, named "
                f"on the first line, such as {example}"
            )
        if name in columns:
            raise InputError(f"{where}: the column {name} is there twice; keep one")
        columns[name] = place, match["unit"]
    return columns


def _row(cells: list[str], columns: int, where: str) -> list[str]:
    while len(cells) > columns and not cells[-1]:
        cells = cells[:-1]
    if len(cells) != columns:
        more = "; write decimals with a point, and separate columns by semicolons or tabs" * (len(cells) > columns)
        raise InputError(f"{where}: {len(cells)} values under {columns} columns{more}")
    return cells
