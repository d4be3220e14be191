"""The user's own distribution of barriers: a tabulated density, or samples."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, PrivateAttr, model_validator

from chemage.errors import StoreError
from chemage.spec import Barriers
from chemage.units import Unit
from chemage_barriers.piecewise import EmpiricalQuantile, PiecewiseLinearDensity


def _listed(value: Any) -> Any:
    return np.asarray(value).ravel().tolist() if isinstance(value, np.ndarray) else value


def _named_unit(value: Any) -> Any:
    """A unit by its name alone, "meV", is one of it."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_listed)]


def _path(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


FilePath = Annotated[str, BeforeValidator(_path)]


def read_columns(path: str | Path) -> tuple[bytes, np.ndarray]:
    """A text table: the bytes of the file, and its numbers (rows, columns); see :func:`parse_columns`.

    Raises
    ------
    StoreError
        The file is missing, cannot be read, or is not such a table.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from None
    try:
        return content, parse_columns(content.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError:
        raise StoreError(f"{path} is not a text file") from None


def parse_columns(text: str, source: str) -> np.ndarray:
    """The numbers of a text table, (rows, columns).

    Columns are separated by commas, semicolons, tabs or blanks; what follows ``#`` is a comment; a first line of names
    is skipped.

    Raises
    ------
    StoreError
        ``source`` holds no numbers, something that is not a number, or rows of different lengths; names the line.
    """
    rows: list[list[float]] = []
    named = False
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        words = [word for word in re.split(r"\s*[,;\t]\s*|\s+", line) if word]
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows and not named:
                named = True
                continue
            raise StoreError(f"{source}, line {number}: {line[:60]!r} is not a row of numbers") from None
        if rows and len(row) != len(rows[0]):
            raise StoreError(f"{source}, line {number}: {len(row)} columns where the rows before have {len(rows[0])}")
        if not all(math.isfinite(value) for value in row):
            raise StoreError(f"{source}, line {number}: {line[:60]!r} holds a value that is not finite")
        rows.append(row)
    if not rows:
        raise StoreError(f"{source} holds no numbers; give one column (samples) or two (energy, density)")
    return np.array(rows)


class Tabulated(Barriers):
    """A density given at points and joined by straight lines, or the distribution of samples.

    Give ``energies`` with ``weights``, or ``samples``, or a ``path`` to a text file: two columns are energies and
    weights, one column is samples. Samples are not smoothed: their ordered values are joined by straight lines at the
    probabilities i/(n − 1), so barriers lie between the smallest and the largest.
    """

    kind = "tabulated"

    energies: Numbers | None = None
    """strictly increasing, in ``energy_unit``"""
    weights: Numbers | None = None
    """probability density at ``energies``, ≥ 0, in any unit: it is normalised"""
    samples: Numbers | None = None
    """barriers in ``energy_unit``, in any order, for example from molecular dynamics"""
    path: FilePath | None = None
    """text file with two columns (energies, weights) or one (samples)"""
    energy_unit: Annotated[float, Unit("eV", gt=0), BeforeValidator(_named_unit)] = 1.0
    """unit of the energies given, eV: "meV", or a number"""

    _distribution: PiecewiseLinearDensity | EmpiricalQuantile = PrivateAttr()
    _content: str = PrivateAttr(default="")

    @model_validator(mode="after")
    def _load(self) -> Self:
        if (self.energies is None) != (self.weights is None):
            raise ValueError("energies, weights: give both, or neither")
        ways = [name for name in ("energies", "samples", "path") if getattr(self, name) is not None]
        if len(ways) != 1:
            raise ValueError(
                f"{' and '.join(ways) or 'nothing'} given; give exactly one of energies with weights, samples, or path"
            )
        columns: list[ArrayLike] = [
            column for column in (self.energies, self.weights, self.samples) if column is not None
        ]
        if self.path is None:
            self._distribution = self._of(columns)
            return self
        content, table = read_columns(self.path)
        # the digest follows the content, so that an edited file is another distribution
        self._content = hashlib.blake2b(content, digest_size=16).hexdigest()
        try:
            self._distribution = self._of(list(table.T))
        except ValueError as error:
            raise ValueError(f"path: {self.path}: {error}") from None
        return self

    def _of(self, columns: Sequence[ArrayLike]) -> PiecewiseLinearDensity | EmpiricalQuantile:
        first = np.array(columns[0], dtype=np.float64) * self.energy_unit
        if len(columns) == 1:
            return EmpiricalQuantile(first)
        if len(columns) == 2:
            return PiecewiseLinearDensity(first, columns[1])
        raise ValueError(f"{len(columns)} columns; give one (samples) or two (energies, weights)")

    def digest(self) -> str:
        if not self._content:
            return super().digest()
        return hashlib.blake2b((super().digest() + self._content).encode(), digest_size=16).hexdigest()

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return self._distribution.quantile(uniform)

    def density(self, energy: np.ndarray) -> np.ndarray:
        return self._distribution.density(energy)
