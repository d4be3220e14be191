"""Measured curves of ageing with the conditions under which they were measured."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from chemage.ageing.fitting import UNIT, Quantity
from chemage.ageing.measurements import Measurements
from chemage.foundation.checks import check_times, force, temperature_value
from chemage.foundation.errors import InputError, shown
from chemage.foundation.records import Doubles, Plain, PositiveNumber, Record
from chemage.foundation.tables import factor, number, read_columns
from chemage.foundation.units import QuantityLike, array_in

#: fewer decades of hold times than this say nothing of a distribution of barriers
DECADES = 1.0
#: a curve falls where it is lower than before by so many standard errors of the difference
FALL = 5.0
_UNITS = {"hold_time": "s", "friction_drop": "nN", "friction_coefficient_drop": "", "load": "nN", "temperature": "K"}
_COLUMNS = (*_UNITS, "value", "error", "curve", "quantity")
_EXAMPLE = "hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K)"


class MeasuredCurve(Record):
    """A measured curve of ageing under one load and at one temperature."""

    arrays = {
        "hold_times": (("hold_time",), "s", "hold time"),
        "values": (("hold_time",), "", "ΔF in nN, or Δμ"),
        "errors": (("hold_time",), "", "standard errors of the values"),
    }

    name: str = "curve"
    load: PositiveNumber
    """nN"""
    temperature: PositiveNumber
    """K"""
    quantity: Quantity = "friction_drop"
    """what ``values`` are: "friction_drop" (ΔF, nN) or "friction_coefficient_drop" (Δμ)"""
    hold_times: Doubles
    """(m,) s, > 0, non-decreasing; a time that occurs again is a repeated measurement"""
    values: Doubles
    """(m,) ΔF in nN, or Δμ"""
    errors: Doubles
    """(m,) standard errors, > 0, in the unit of ``values``"""
    chemistry: Plain = {}
    """options of the chemistry under which it was measured, where they are known; the scene must have the same"""

    def __init__(self, **fields: Any) -> None:
        unit = UNIT.get(str(fields.get("quantity", "friction_drop")), "")
        super().__init__(**{n: array_in(v, unit) if n in ("values", "errors") else v for n, v in fields.items()})

    @model_validator(mode="after")
    def _check(self) -> Self:
        if check_times(self.hold_times).ndim != self.hold_times.ndim:
            raise ValueError("hold_times: give a list")
        if self.hold_times.size and self.hold_times[0] <= 0:
            raise ValueError("hold_times[0] = 0 s: nothing has aged then; leave that row out")
        for name in ("values", "errors"):
            array = getattr(self, name)
            if array.shape != self.hold_times.shape:
                raise ValueError(
                    f"{name}: {array.shape} numbers, but there are {self.hold_times.size} hold times; give one for each"
                )
            bad = np.flatnonzero(~np.isfinite(array))
            if bad.size:
                raise ValueError(f"{name}[{bad[0]}] = {array[bad[0]]}: is not finite; leave that row out")
        wrong = np.flatnonzero(self.errors <= 0)
        if wrong.size:
            raise ValueError(
                f"errors[{wrong[0]}] = {self.errors[wrong[0]]:g}: a standard error must be above zero; give the "
                "scatter of repeated measurements, or an estimate of it"
            )
        return self

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF, nN, (m,)."""
        return self.values if self.quantity == "friction_drop" else self.values * self.load

    @property
    def friction_drop_errors(self) -> np.ndarray:
        """Standard errors of ΔF, nN, (m,)."""
        return self.errors if self.quantity == "friction_drop" else self.errors * self.load

    @classmethod
    def of(
        cls,
        measurements: Measurements,
        *,
        load: QuantityLike,
        temperature: QuantityLike,
        relative_error: float | None = None,
    ) -> MeasuredCurve:
        """A curve read by :func:`chemage.read_measurements`, with the load (nN) and the temperature (K) it lacks.

        ``relative_error`` (0.03: 3 %) stands for errors that the measurements do not state.

        Raises
        ------
        InputError
            There are neither errors nor a ``relative_error``.
        """
        if measurements.error is None and relative_error is None:
            raise InputError(
                f"{measurements.name}: no standard errors; add a column error, or give relative_error, such as 0.03"
            )
        errors = np.abs(measurements.values) * relative_error if measurements.error is None else measurements.error
        kept = measurements.hold_times > 0
        return cls(
            name=measurements.name,
            load=force(load),
            temperature=temperature_value(temperature),
            quantity=measurements.quantity,
            hold_times=measurements.hold_times[kept],
            values=measurements.values[kept],
            errors=errors[kept],
        )

    def __repr__(self) -> str:
        return (
            f"<MeasuredCurve {self.name}: {self.hold_times.size} hold times from {self.hold_times[0]:g} to "
            f"{self.hold_times[-1]:g} s, {self.load:g} nN, {self.temperature:g} K>"
        )

    __str__ = __repr__


def read_curves(
    path: str | Path,
    *,
    load: QuantityLike | None = None,
    temperature: QuantityLike | None = None,
    relative_error: float | None = None,
) -> tuple[MeasuredCurve, ...]:
    """Read measured curves from a CSV file, one row for each hold time.

    The first line that is neither empty nor a comment (``#``) names the columns, with their units in brackets::

        hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K), curve
        0.01,          12.1,               0.4,        50,        300,             a
        0.1,           25.3,               0.8,        50,        300,             a

    ``hold_time``; ``friction_drop`` or ``friction_coefficient_drop``, or ``value`` beside a column ``quantity`` with
    one of these names; ``error``, the standard error in the unit of the value unless it names its own, or in % of the
    value. ``load``, ``temperature`` and ``curve`` (any text) may be left out; rows that agree in them are one curve.

    Parameters
    ----------
    path
        The file; commas, semicolons or tabs separate its columns.
    load, temperature
        nN and K, or with units, where the file has no such column.
    relative_error
        Standard error over the value (0.03: 3 %), where the file has no errors.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and the column that is wrong, and the remedy.
    """
    source = Path(path)
    table = read_columns(source, _COLUMNS, _EXAMPLE)
    stated: dict[str, float] = {} if load is None else {"load": force(load)}
    if temperature is not None:
        stated["temperature"] = temperature_value(temperature)
    _check_columns(table.columns, stated, relative_error, source)
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for _, where, cells in table.rows:
        row = stated | _row(cells, table.columns, where)
        if "error" not in row:
            row["error"] = abs(row["value"]) * float(relative_error or 0.0)
        key = row.get("curve", ""), row["load"], row["temperature"], row["quantity"]
        groups.setdefault(key, []).append(row)
    if not groups:
        raise InputError(f"{source}: it has no rows of numbers; add one for each hold time")
    return tuple(_curve(key, rows, source, len(groups)) for key, rows in groups.items())


def _curve(key: tuple[Any, ...], rows: list[dict[str, Any]], source: Path, count: int) -> MeasuredCurve:
    label, load, temperature, quantity = key
    name = label or (source.stem if count == 1 else f"{source.stem}, {load:g} nN, {temperature:g} K")
    for before, row in itertools.pairwise(rows):
        if row["hold_time"] < before["hold_time"]:
            raise InputError(
                f"{row['where']}, column hold_time: {row['hold_time']:g} s comes after {before['hold_time']:g} s in "
                f"the curve {name}; sort the rows of each curve by hold time"
            )
    kept = [row for row in rows if row["hold_time"] > 0]
    times, values, errors = (np.array([row[column] for row in kept]) for column in ("hold_time", "value", "error"))
    fields: dict[str, Any] = {"load": load, "temperature": temperature, "quantity": quantity}
    try:
        return MeasuredCurve(name=name, hold_times=times, values=values, errors=errors, **fields)
    except InputError as error:
        raise InputError(f"{source}, curve {name}: {error}") from None


def _check_columns(
    columns: dict[str, Any], stated: dict[str, float], relative_error: float | None, source: Path
) -> None:
    if "hold_time" not in columns:
        raise InputError(f"{source}: no column hold_time; write the header as {_EXAMPLE}")
    values = [name for name in ("friction_drop", "friction_coefficient_drop", "value") if name in columns]
    if len(values) != 1:
        raise InputError(
            f"{source}: {len(values)} columns of values; give one of friction_drop (nN), friction_coefficient_drop, "
            "and value with a column quantity"
        )
    if "value" in columns and "quantity" not in columns:
        raise InputError(f"{source}: column value without a column quantity; name it friction_drop (nN) instead")
    if "error" not in columns and relative_error is None:
        raise InputError(
            f"{source}: no column error; the density cannot be inferred without standard errors, so add them, or give "
            "relative_error, such as 0.03"
        )
    if relative_error is not None and not 0 < relative_error < 1:
        raise InputError.of("relative_error", relative_error, "must be between 0 and 1", "3 % is 0.03")
    for name in ("load", "temperature"):
        if name not in columns and name not in stated:
            raise InputError(f"{source}: no column {name}; add it, or give {name}")
        if name in columns and name in stated:
            raise InputError(f"{source}: has a column {name}, and {name} is given as well; leave one out")


def _row(cells: list[str], columns: dict[str, tuple[int, str | None]], where: str) -> dict[str, Any]:
    quantity = next((name for name in UNIT if name in columns), None)
    if quantity is None:
        quantity = cells[columns["quantity"][0]]
        if quantity not in UNIT:
            raise InputError(f"{where}, column quantity: {shown(quantity)}; write {' or '.join(UNIT)}")
    value_column = quantity if quantity in columns else "value"
    row: dict[str, Any] = {"where": where, "quantity": quantity}
    if "curve" in columns:
        row["curve"] = cells[columns["curve"][0]]
    for name in ("hold_time", value_column, "error", "load", "temperature"):
        if name not in columns:
            continue
        place, unit = columns[name]
        target = UNIT[quantity] if name in (value_column, "error") else _UNITS[name]
        if name == "error" and unit is None:
            unit = columns[value_column][1]
        value = number(cells[place], f"{where}, column {name}")
        if name == "error" and unit == "%" and target:
            row["error"] = value / 100 * abs(row["value"])
        elif name == value_column:
            row["value"] = value * factor(name, unit, target, where)
        else:
            row[name] = value * factor(name, unit, target, where)
    for name in ("load", "temperature"):
        if name in row and row[name] <= 0:
            raise InputError(f"{where}, column {name}: {row[name]:g} is not above zero")
    if row["hold_time"] > 0 and row.get("error", 1.0) <= 0:
        raise InputError(
            f"{where}, column error: {row['error']:g}: a standard error must be above zero; give the scatter of "
            "repeated measurements, or an estimate of it"
        )
    return row


def check_curves(curves: Sequence[MeasuredCurve]) -> None:
    """Refuse what no density can be inferred from: hold times of one decade, curves that fall.

    Raises
    ------
    InputError
        Naming the curve, what is wrong, and the remedy.
    """
    if not curves:
        raise InputError("curves: none given; read them with chemage.read_curves, or make a MeasuredCurve")
    for curve in curves:
        times, values, errors = curve.hold_times, curve.friction_drop, curve.friction_drop_errors
        if times.size < 2 or math.log10(times[-1] / times[0]) < DECADES:
            raise InputError(
                f"{curve.name}: hold_times from {times[0]:g} to {times[-1]:g} s are within one decade, which sees "
                "barriers within 2.3 k_BT of each other; give hold times over two decades or more"
            )
        (slope, _), covariance = np.polyfit(np.log10(times), values, 1, w=1 / errors, cov="unscaled")
        if slope < -3 * (error := math.sqrt(covariance[0, 0])):
            raise InputError(
                f"{curve.name}: values fall, by {-slope:.3g} ± {error:.2g} nN per decade of hold time, but bonds that "
                "form can only add; check the sign and the order of the values"
            )
        highest = np.maximum.accumulate(values)
        at = np.maximum.accumulate(np.where(values == highest, np.arange(values.size), 0))
        drop = (highest - values) / np.hypot(errors, errors[at])
        worst = int(np.argmax(drop))
        if drop[worst] > FALL:
            raise InputError(
                f"{curve.name}: values fall from {highest[worst]:.4g} nN at {times[at[worst]]:g} s to "
                f"{values[worst]:.4g} nN at {times[worst]:g} s, {drop[worst]:.1f} standard errors, but bonds that form "
                "can only add; leave out hold times at which something else happens, or correct the errors"
            )
