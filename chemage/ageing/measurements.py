"""Measured ageing curves, and the one table in which they are read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.fitting import UNIT, FitData, Friction
from chemage.foundation.checks import check_times, force, temperature_value
from chemage.foundation.errors import InputError, shown
from chemage.foundation.records import frozen
from chemage.foundation.tables import Cells, ColumnTable, read_columns
from chemage.foundation.units import QuantityLike, array_in

#: name of a column -> other spellings
MEASURED_COLUMNS = {
    "hold_time": "t|time|hold|holding time|contact time|waiting time|ageing time|aging time|t hold",
    "friction_drop": "F|ΔF|∆F|delta F|friction|friction force|friction rise",
    "friction_coefficient_drop": "mu|μ|µ|Δμ|∆μ|Δµ|∆µ|delta mu|friction coefficient|coefficient of friction|cof",
    "value": "",
    "quantity": "",
    "error": "err|errors|stderr|std err|standard error|se|sem|sigma|σ|uncertainty|±|+/-|friction drop error|"
    "friction error|F error|F err|mu error|mu err|error F|error mu",
    "load": "normal load|normal force|F N|FN|Fn",
    "temperature": "T|temp|temp.",
    "curve": "series|sample|label",
    "instrument": "lever|cantilever|tip|setup|rig",
}
_UNCLEAR = {
    'may be an error or a difference; name it "error", "friction_drop" or "friction_coefficient_drop"': "dF|dmu|d F|"
    "d mu",
    'may be the scatter of single measurements or the error of their mean; name the error of the values "error", '
    "which is the scatter over the root of the number that each is a mean of": "std|sd|stdev|std dev|"
    "standard deviation|F std|mu std|F sd|mu sd|s.d.|scatter",
}
_EXAMPLE = "hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K)"
_TEXTS = ("curve", "instrument")
_UNITS = {"hold_time": "s", "load": "nN", "temperature": "K"}


@dataclass(frozen=True)
class Measurements:
    """A measured curve of ageing: one value a row, rows in order of hold time."""

    name: str
    #: (m,) s, ≥ 0, non-decreasing; a time that occurs again is a repeated measurement
    hold_times: np.ndarray
    #: (m,) Δμ, or ΔF in nN
    values: np.ndarray
    #: what ``values`` are
    quantity: Friction
    #: (m,) standard errors in the unit of ``values``, or None
    error: np.ndarray | None = None
    #: nN and K, where they are known
    load: float | None = None
    temperature: float | None = None
    #: with which it was measured: curves of one instrument share its calibration
    instrument: str = ""
    #: what reading understood and left out, for users
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("hold_times", "values", "error"):
            if (array := getattr(self, name)) is not None:
                unit = "s" if name == "hold_times" else UNIT.get(str(self.quantity), "")
                try:
                    object.__setattr__(
                        self, name, frozen(array_in(array, unit), np.float64)
                    )
                except ValueError as error:
                    raise InputError(f"{name}: {error}") from None
        if str(self.quantity) not in UNIT:
            raise InputError.of(
                "quantity", self.quantity, f"choose {' or '.join(UNIT)}"
            )
        check_times(self.hold_times)
        for name in ("values", "error"):
            array = getattr(self, name)
            if array is None:
                continue
            if array.shape != self.hold_times.shape:
                problem = f"there are {self.hold_times.size} hold times; give one number for each"
                raise InputError.of(name, array.shape, problem)
            if not np.isfinite(array).all():
                raise InputError(
                    f"{name}: holds numbers that are not finite; leave those out"
                )
        if self.error is not None and (self.error <= 0).any():
            raise InputError(
                "error: holds numbers that are not above zero; leave it out if errors are not known"
            )

    def as_quantity(
        self, quantity: Friction, load: float | None
    ) -> Measurements | None:
        """The same measurements as ΔF or Δμ under their load, else ``load`` nN; None where neither is known."""
        load = self.load or load
        if quantity == self.quantity:
            return self
        if not load:
            return None
        factor = load if quantity == "friction_drop" else 1 / load
        error = None if self.error is None else self.error * factor
        return replace(
            self, values=self.values * factor, quantity=quantity, error=error
        )

    def fit_data(self, quantity: Friction | None) -> FitData:
        """The curve as it was measured, for :func:`chemage.fit_aging`."""
        if quantity not in (None, self.quantity):
            raise InputError.of(
                "quantity", quantity, f"these are measurements of {self.quantity}"
            )
        return FitData(self.values[None, :], self.quantity, error=self.error)


def read_measurements(path: str | Path | Any) -> Measurements:
    """Read one curve of hold times and Δμ or ΔF; the table is that of :func:`chemage.plugin.read_table`.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and column that is wrong; or the table holds several curves.
    """
    first, *others = read_table(path)
    if others:
        names = ", ".join(curve.name for curve in (first, *others))
        raise InputError(
            f"{path}: holds {1 + len(others)} curves, {names}; read them with chemage.read_curves"
        )
    return first


def read_table(
    source: str | Path | Any,
    *,
    load: QuantityLike | None = None,
    temperature: QuantityLike | None = None,
) -> tuple[Measurements, ...]:
    """Read measured curves of ageing from a text file, an Excel file (.xlsx) or a data frame, one row for each value.

    A line names the columns, with their units in brackets::

        hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K), curve
        0.01,          12.1,               0.4,        50,        300,             a
        0.1,           25.3,               0.8,        50,        300,             a

    ``hold_time``; ``friction_drop`` or ``friction_coefficient_drop``, or ``value`` beside a column ``quantity`` with
    one of these names; where they are known ``error``, the standard error in the unit of the value unless it names its
    own, or in % of the value, ``load``, ``temperature``, and ``curve`` and ``instrument`` (any text). Usual other names
    (``t``, ``F``, ``mu``, ``T``) are understood, further columns left out, with a note. Columns and rows come in any
    order; rows that agree in all but times and values are one curve. See :func:`chemage.foundation.tables.read_columns`
    for separators, decimal marks and units.

    Parameters
    ----------
    source
        The file, or the data frame (of pandas, or alike).
    load, temperature
        nN and K, or with units, where the table has no such column.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and the column that is wrong, and the remedy.
    """
    table = read_columns(source, MEASURED_COLUMNS, _EXAMPLE, _UNCLEAR)
    stated: dict[str, float] = {} if load is None else {"load": force(load)}
    if temperature is not None:
        stated["temperature"] = temperature_value(temperature)
    _check_columns(table, stated)
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for cells in table.rows:
        row = stated | _row(table, cells)
        key = (
            *(row.get(name, "") for name in _TEXTS),
            row.get("load"),
            row.get("temperature"),
            row["quantity"],
        )
        groups.setdefault(key, []).append(row)
    if not groups:
        raise InputError(
            f"{table.where}: has no rows of numbers below; add one for each hold time"
        )
    stem = Path(source).stem if isinstance(source, str | Path) else "data frame"
    return tuple(
        _curve(key, rows, stem, table, len(groups)) for key, rows in groups.items()
    )


def _curve(
    key: tuple[Any, ...],
    rows: list[dict[str, Any]],
    stem: str,
    table: ColumnTable,
    count: int,
) -> Measurements:
    label, instrument, load, temperature, quantity = key
    under = [
        f"{value:g} {unit}"
        for value, unit in ((load, "nN"), (temperature, "K"))
        if value is not None
    ]
    name = label or (
        stem
        if count == 1
        else ", ".join([stem, *([instrument] if instrument else []), *under])
    )
    rows = sorted(rows, key=lambda row: row["hold_time"])
    if len(rows) < 2:
        of = f" of the curve {name}" if count > 1 else ""
        raise InputError(
            f"{table.where}: {len(rows)} rows of numbers{of}; a course in time needs at least two"
        )
    times, values = (
        np.array([row[column] for row in rows]) for column in ("hold_time", "value")
    )
    error = (
        np.array([row["error"] for row in rows]) if "error" in table.columns else None
    )
    return Measurements(
        name, times, values, quantity, error, load, temperature, instrument, table.notes
    )


def _check_columns(table: ColumnTable, stated: dict[str, float]) -> None:
    columns, where = table.columns, table.where
    if "hold_time" not in columns:
        raise InputError(
            f"{where}: no column hold_time; write the header as {_EXAMPLE}"
        )
    values = [name for name in (*UNIT, "value") if name in columns]
    if len(values) != 1:
        raise InputError(
            f"{where}: {' and '.join(values) if values else 'neither friction_coefficient_drop (Δμ) nor friction_drop'}"
            f"{' are both there' if values else ' (ΔF)'}; give one of friction_drop (nN), friction_coefficient_drop, "
            "and value with a column quantity"
        )
    if "value" in columns and "quantity" not in columns:
        raise InputError(
            f"{where}: column value without a column quantity; name it friction_drop (nN) instead"
        )
    for name in ("load", "temperature"):
        if name in columns and name in stated:
            raise InputError(
                f"{where}: has a column {name}, and {name} is given as well; leave one out"
            )


def _row(table: ColumnTable, cells: Cells) -> dict[str, Any]:
    columns, where = table.columns, cells[1]

    def text(name: str) -> str:
        cell = cells[2][columns[name][0]]
        return cell if isinstance(cell, str) else f"{cell:g}"

    quantity = next((name for name in UNIT if name in columns), None) or text(
        "quantity"
    )
    if quantity not in UNIT:
        raise InputError(
            f"{where}, column quantity: {shown(quantity)}; write {' or '.join(UNIT)}"
        )
    unit, value_column = UNIT[quantity], quantity if quantity in columns else "value"
    row: dict[str, Any] = {
        "quantity": quantity,
        "value": table.number(cells, value_column, unit),
    }
    row |= {
        name: table.number(cells, name, _UNITS[name])
        for name in _UNITS
        if name in columns
    }
    row |= {name: text(name) for name in _TEXTS if name in columns}
    if "error" in columns:
        row["error"] = table.error(cells, value_column, row["value"], unit)
        if row["error"] <= 0:
            raise InputError(
                f"{where}, column error: {text('error')[:80]}: a standard error must be above zero; give the scatter "
                "of repeated measurements over the root of their number, or leave the column out"
            )
    if row["hold_time"] < 0:
        raise InputError(
            f"{where}, column hold_time: {text('hold_time')[:80]} is negative; hold times count from first contact"
        )
    for name in ("load", "temperature"):
        if name in row and row[name] <= 0:
            raise InputError(f"{where}, column {name}: {row[name]:g} is not above zero")
    return row
