"""Measured ageing curves, read from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from chemage.ageing.fitting import UNIT, FitData, Quantity
from chemage.foundation.checks import check_times
from chemage.foundation.errors import InputError
from chemage.foundation.records import frozen
from chemage.foundation.tables import ColumnTable, factor, number, read_columns
from chemage.foundation.units import array_in

_COLUMNS = ("hold_time", *UNIT, "error")
_EXAMPLE = "hold_time (s), friction_coefficient_drop, error"
_LISTED = "hold_time, friction_coefficient_drop or friction_drop, and error"


@dataclass(frozen=True)
class Measurements:
    """A measured curve of ageing: one value a row, rows in order of hold time."""

    name: str
    #: (m,) s, ≥ 0, non-decreasing; a time that occurs again is a repeated measurement
    hold_times: np.ndarray
    #: (m,) Δμ, or ΔF in nN
    values: np.ndarray
    #: what ``values`` are
    quantity: Quantity
    #: (m,) standard errors in the unit of ``values``, or None
    error: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("hold_times", "values", "error"):
            if (array := getattr(self, name)) is not None:
                unit = "s" if name == "hold_times" else UNIT.get(str(self.quantity), "")
                try:
                    object.__setattr__(self, name, frozen(array_in(array, unit), np.float64))
                except ValueError as error:
                    raise InputError(f"{name}: {error}") from None
        if str(self.quantity) not in UNIT:
            raise InputError.of("quantity", self.quantity, f"choose {' or '.join(UNIT)}")
        _check_data(self.hold_times, self.values, self.error)

    def as_quantity(self, quantity: Quantity, load: float | None) -> Measurements | None:
        """The same measurements as ΔF or Δμ under ``load`` nN; None where the load is not known."""
        if quantity == self.quantity:
            return self
        if not load:
            return None
        factor = load if quantity == "friction_drop" else 1 / load
        error = None if self.error is None else self.error * factor
        return Measurements(self.name, self.hold_times, self.values * factor, quantity, error)

    def fit_data(self, quantity: Quantity | None) -> FitData:
        """The curve as it was measured, for :func:`chemage.fit_aging`."""
        if quantity not in (None, self.quantity):
            raise InputError.of("quantity", quantity, f"these are measurements of {self.quantity}")
        return FitData(self.values[None, :], self.quantity, error=self.error)


def read_measurements(path: str | Path) -> Measurements:
    """Read a CSV file of hold times and Δμ or ΔF.

    The first line that is neither empty nor a comment (``#``) names the columns, with their units in brackets::

        # silica on silica, 50 % humidity
        hold_time (s), friction_coefficient_drop, error
        1,   0.12, 0.02
        10,  0.31, 0.02

    Columns may come in any order: ``hold_time`` with a unit of time; ``friction_coefficient_drop`` (no unit, or %) or
    ``friction_drop`` with a unit of force; and, if known, ``error``, the standard error of the value, in the value's
    unit unless it names its own. Commas, semicolons or tabs separate columns; numbers have a decimal point. Rows are in
    order of hold time.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and column that is wrong.
    """
    source = Path(path)
    table = read_columns(source, _COLUMNS, _EXAMPLE, _LISTED)
    columns, quantity = _columns(table)
    rows = [_row(cells, columns, where) for _, where, cells in table.rows]
    _check_order([line for line, _, _ in table.rows], [row["hold_time"] for row in rows], source)
    if len(rows) < 2:
        raise InputError(f"{source}: {len(rows)} rows of numbers; a course in time needs at least two")
    error = np.array([row["error"] for row in rows]) if "error" in columns else None
    return Measurements(
        source.stem,
        np.array([row["hold_time"] for row in rows]),
        np.array([row[quantity] for row in rows]),
        quantity,
        error,
    )


@dataclass(frozen=True)
class _Column:
    place: int
    unit: str
    factor: float


def _columns(table: ColumnTable) -> tuple[dict[str, _Column], Quantity]:
    places, where = table.columns, table.where
    if "hold_time" not in places:
        raise InputError(f"{where}: no column hold_time; write the header as {_EXAMPLE}")
    quantities = [name for name in get_args(Quantity) if name in places]
    if len(quantities) != 1:
        raise InputError(
            f"{where}: {'both' if quantities else 'neither'} friction_coefficient_drop (Δμ) "
            f"{'and' if quantities else 'nor'} friction_drop (ΔF); give one of them"
        )
    quantity: Quantity = quantities[0]
    units = {"hold_time": "s", quantity: UNIT[quantity], "error": UNIT[quantity]}
    columns = {}
    for name in (name for name in ("hold_time", quantity, "error") if name in places):
        place, unit = places[name]
        if unit is None and name == "error":
            unit = columns[quantity].unit
        columns[name] = _Column(place, unit or "", factor(name, unit, units[name], where))
    return columns, quantity


def _row(cells: list[str], columns: dict[str, _Column], where: str) -> dict[str, float]:
    row = {}
    for name, column in columns.items():
        cell = cells[column.place]
        value = number(cell, f"{where}, column {name}")
        if name == "hold_time" and value < 0:
            raise InputError(f"{where}, column hold_time: {cell[:80]} is negative; hold times count from first contact")
        if name == "error" and value <= 0:
            raise InputError(f"{where}, column error: {cell[:80]} is not above zero; leave the column out if unknown")
        row[name] = value * column.factor
    return row


def _check_order(lines: list[int], times: list[float], source: Path) -> None:
    for line, before, after in zip(lines[1:], times, times[1:], strict=False):
        if after < before:
            raise InputError(
                f"{source}, line {line}, column hold_time: {after:g} s comes after {before:g} s; "
                "sort the rows by hold time"
            )


def _check_data(times: np.ndarray, values: np.ndarray, error: np.ndarray | None) -> None:
    check_times(times)
    for name, array in (("values", values), ("error", error)):
        if array is None:
            continue
        if array.shape != times.shape:
            raise InputError.of(name, array.shape, f"there are {times.size} hold times; give one number for each")
        if not np.isfinite(array).all():
            raise InputError(f"{name}: holds numbers that are not finite; leave those out")
    if error is not None and (error <= 0).any():
        raise InputError("error: holds numbers that are not above zero; leave it out if errors are not known")
