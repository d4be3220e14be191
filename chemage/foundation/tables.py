"""Tables of numbers in text files, with errors that name the line and the column."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from chemage.foundation.errors import StoreError, shortened, shown
from chemage.foundation.inputs import regular_file

#: number of a line, from 1, and its text
Line = tuple[int, str]


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Raises
    ------
    StoreError
        The file is missing, cannot be read, or is not text.
    """
    regular_file(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise StoreError(f"{path} is not a text file") from None
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from None
    except ValueError:  # a null byte in the name
        raise StoreError(f"{os.fspath(path)!r} is no name of a file") from None


def data_lines(text: str, comments: str = "#") -> list[Line]:
    """List the lines that hold data, without comments, which begin with one of the characters ``comments``."""
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        for mark in comments:
            line = line.partition(mark)[0]
        if line.strip():
            found.append((number, line))
    return found


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
