"""A distribution of barriers from the user's own data: a tabulated density, or samples."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, PrivateAttr, model_validator

from chemage.plugin import Barriers, StoreError, Unit, tables
from chemage_barriers.piecewise import EmpiricalQuantile, PiecewiseLinearDensity


def _listed(value: Any) -> Any:
    return np.asarray(value).ravel().tolist() if isinstance(value, np.ndarray) else value


def _named_unit(value: Any) -> Any:
    """A name alone is read as one of that unit: "meV" as "1 meV"."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_listed)]


def read_columns(path: str | Path) -> np.ndarray:
    """The numbers of a text file, (rows, columns); see :func:`parse_columns`.

    Raises
    ------
    StoreError
        The file is missing, cannot be read, or does not hold such a table.
    """
    return parse_columns(tables.read_text(path), str(path))


def parse_columns(text: str, source: str) -> np.ndarray:
    """The numbers of a text table, (rows, columns).

    Columns are separated by commas, semicolons, tabs or blanks; text after ``#`` is a comment; one line of column names
    before the numbers is skipped.

    Raises
    ------
    StoreError
        ``source`` holds no numbers, something that is not a number, or rows of different lengths; names the line.
    """
    lines = tables.data_lines(text)
    if lines and not _numbers_in(lines[0][1]):
        lines = lines[1:]
    if not lines:
        raise StoreError(f"{source} holds no numbers; give one column (samples) or two (energy, density)")
    rows = tables.numbers(lines, source, tables.separator_of(lines[0][1]))
    for (number, line), row in zip(lines, rows, strict=True):
        if not np.isfinite(row).all():
            raise StoreError(f"{source}, line {number}: {line[:60].strip()!r} holds a value that is not finite")
    return rows


def _numbers_in(line: str) -> bool:
    try:
        return bool([float(word) for word in line.replace(",", " ").replace(";", " ").split()])
    except ValueError:
        return False


class Tabulated(Barriers):
    """A tabulated density with linear interpolation, or the distribution of samples.

    Give ``energies`` with ``weights``, or ``samples``, or a ``path`` to a text file with two columns (energies and
    weights) or one (samples). The file is read at once and its numbers replace ``path``, so that a stored result
    contains the distribution itself. Samples are not smoothed: their ordered values are joined by straight lines at the
    probabilities i/(n − 1), so barriers lie between the smallest and the largest.
    """

    kind = "tabulated"

    energies: Numbers | None = None
    """energies of the table, strictly increasing, in ``energy_unit``"""
    weights: Numbers | None = None
    """probability density at ``energies``, ≥ 0, in any unit; it is normalised"""
    samples: Numbers | None = None
    """barriers in ``energy_unit``, in any order, for example from molecular dynamics"""
    path: str | None = None
    """text file with ``energies`` and ``weights``, or with ``samples``"""
    energy_unit: Annotated[float, Unit("eV", gt=0), BeforeValidator(_named_unit)] = 1.0
    """unit of the given energies: its name, such as "meV", or its value in eV; default: 1 eV"""

    _distribution: PiecewiseLinearDensity | EmpiricalQuantile = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _read(cls, options: Any) -> Any:
        if not isinstance(options, dict) or not isinstance(path := options.get("path"), str | Path):
            return options
        if any(options.get(name) is not None for name in ("energies", "weights", "samples")):
            return options  # refused below
        columns = read_columns(path).T
        if len(columns) > 2:
            raise ValueError(f"path: {path} has {len(columns)} columns; give one (samples) or two (energies, weights)")
        names = ("samples",) if len(columns) == 1 else ("energies", "weights")
        rest = {name: value for name, value in options.items() if name != "path"}
        return rest | dict(zip(names, columns, strict=True))

    @model_validator(mode="after")
    def _build(self) -> Self:
        if self.samples is not None and self.energies is self.weights is self.path is None:
            self._distribution = EmpiricalQuantile(np.array(self.samples) * self.energy_unit)
        elif self.energies is not None and self.weights is not None and self.samples is self.path is None:
            self._distribution = PiecewiseLinearDensity(np.array(self.energies) * self.energy_unit, self.weights)
        else:
            given = [name for name in ("energies", "weights", "samples", "path") if getattr(self, name) is not None]
            raise ValueError(f"{', '.join(given) or 'nothing'} given; give energies and weights, or samples, or a path")
        return self

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return self._distribution.quantile(uniform)

    def density(self, energy: np.ndarray) -> np.ndarray:
        return self._distribution.density(energy)
