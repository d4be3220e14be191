"""Measured ageing curves, and the one table in which they are read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.columns import (
    ERRORS,
    NAMES,
    VALUES,
    ColumnTable,
    is_missing,
    read_columns,
)
from chemage.ageing.fitting import UNIT, FitData, Friction
from chemage.foundation.checks import check_times, force, temperature_value
from chemage.foundation.errors import InputError, shortened, shown
from chemage.foundation.records import frozen
from chemage.foundation.tables import Cell, Cells
from chemage.foundation.units import (
    QuantityLike,
    array_in,
    convert,
    unit_written,
)

_EXAMPLE = (
    "hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K)"
)
_TEXTS = ("curve", "instrument")
_UNITS = {"hold_time": "s", "load": "nN", "temperature": "K"}
#: columns in which an empty cell means what stands above it, as in merged cells
_CONDITIONS = ("load", "temperature", *_TEXTS)
#: columns that give errors together, and what to do where one of them is alone
_KINDS = {
    ("error",): "",
    ("plus", "minus"): "give both sides",
    ("upper", "lower"): "give both limits",
    (
        "scatter",
        "count",
    ): "may be the scatter of single measurements or the error of their mean; add a column n, how "
    'many values each is a mean of, or name the error of the values "error", which is the scatter over the root of n',
}


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
    #: the unit written with the number of the temperature, so that a low one is meant; "" where there is none
    temperature_unit: str = ""

    def __post_init__(self) -> None:
        for name in ("hold_times", "values", "error"):
            if (array := getattr(self, name)) is not None:
                unit = (
                    "s"
                    if name == "hold_times"
                    else UNIT.get(str(self.quantity), "")
                )
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
                problem = f"there are {self.hold_times.size} hold times; give one for each"
                raise InputError.of(name, array.shape, problem)
            for at in np.flatnonzero(~np.isfinite(array)):
                problem = f"{name}[{at}] = {array[at]}: is not finite"
                raise InputError(f"{problem}; leave that row out")
        if self.error is not None:
            for at in np.flatnonzero(self.error <= 0):
                raise InputError(
                    f"error[{at}] = {self.error[at]:g}: a standard error must be above zero; give the scatter of "
                    "repeated measurements, or leave errors out"
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
        """The curve as it was measured, for :func:`chemage.fit_ageing`."""
        if quantity not in (None, self.quantity):
            raise InputError.of(
                "quantity", quantity, f"these are measurements of {self.quantity}"
            )
        return FitData(self.values[None, :], self.quantity, error=self.error)


def read_measurements(
    path: str | Path | Any,
    *,
    offset: QuantityLike | None = None,
    sheet: str | None = None,
) -> Measurements:
    """Read one curve of hold times and Δμ or ΔF; table and arguments are those of :func:`chemage.plugin.read_table`.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and column that is wrong; or the table holds several curves.
    """
    first, *others = read_table(path, offset=offset, sheet=sheet)
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
    offset: QuantityLike | None = None,
    sheet: str | None = None,
) -> tuple[Measurements, ...]:
    """Read measured curves of ageing from a text file, an Excel file (.xlsx) or a data frame, one row for each value.

    A line names the columns, with their units in brackets::

        hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K), curve
        0.01,          12.1,               0.4,        50,        300,             a
        0.1,           25.3,               0.8,        50,        300,             a

    ``hold_time``, or its logarithm ``log10(t/s)``; ``friction_drop`` or ``friction_coefficient_drop``, or ``value``
    beside a column ``quantity`` with one of these names; ``friction`` or ``friction_coefficient``, of which ``offset``,
    a column or an argument, is subtracted. Where they are known ``error``, the standard error in the unit of the value
    unless it names its own, or in % of the value, ``load``, ``temperature``, and ``curve`` and ``instrument`` (any
    text). Usual other names, English and German, are understood, further columns left out, with a note.

    Errors may stand with the values (``12.3 ± 0.4``), in two columns (``error +``, ``error -``: their mean is taken;
    ``95 % upper``, ``95 % lower``), as ``std`` beside ``n``, or follow from replicates in several columns: the value is
    their mean, the error their scatter over the root of their number. Rows without a value are left out; an empty cell
    of load, temperature, curve or instrument means what stands above it. Rows that agree in all but times and values
    are one curve. See :func:`chemage.ageing.columns.read_columns` for separators, decimal marks and units.

    Parameters
    ----------
    source
        The file, or the data frame (of pandas, or alike).
    load, temperature
        nN and K, or with units, where the table has no such column.
    offset
        Friction (nN, or a coefficient) without ageing, of a table of friction; or "first": each curve is the rise above
        its first hold time.
    sheet
        Of an Excel file; default: the only one with hold times.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and the column that is wrong, and the remedy.
    """
    table = read_columns(source, {*NAMES, *VALUES, *ERRORS}, _EXAMPLE, sheet)
    given: dict[str, Any] = {} if load is None else {"load": force(load)}
    if temperature is not None:
        given["temperature"] = temperature_value(temperature)
        given["temperature_unit"] = unit_written(temperature)
    reading = _Reading.of(table, given, offset)
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in reading.rows():
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
        reading.curve(key, rows, stem, len(groups)) for key, rows in groups.items()
    )


def _drop(unit: str | None) -> str:
    """The heading of a column of drops in this ``unit``, which its numbers keep."""
    if unit is None:
        return "friction_drop (with the unit of its numbers) or friction_coefficient_drop"
    of_force = unit not in ("", "%")
    return f"friction_{'' if of_force else 'coefficient_'}drop ({unit or 1})"


@dataclass(frozen=True)
class _Reading:
    """How the values of a table become curves."""

    table: ColumnTable
    #: load and temperature, where the table has no such column
    given: dict[str, Any]
    #: the column of the values
    value: str
    #: the columns of their errors
    errors: tuple[str, ...]
    offset: QuantityLike | None
    #: what was done to the values -> where
    done: dict[str, list[str]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        table: ColumnTable,
        given: dict[str, Any],
        offset: QuantityLike | None,
    ) -> _Reading:
        """Decide which columns are read, and refuse what may mean two things."""
        columns, where = table.columns, table.where
        left = "".join(f"; {note}" for note in table.notes if " left out: " in note)
        if "hold_time" not in columns:
            raise InputError(
                f"{where}: no column hold_time; write the header as {_EXAMPLE}{left}"
            )
        values = [name for name in VALUES if name in columns]
        if len(values) != 1:
            raise InputError(
                f"{where}: {' and '.join(values) if values else 'neither friction_coefficient_drop (Δμ) nor friction_drop'}"
                f"{' are both there' if values else ' (ΔF)'}; give one of friction_drop (unit), friction_coefficient_drop, "
                f"and value with a column quantity{left}"
            )
        (value,) = values
        if value == "value" and "quantity" not in columns:
            raise InputError(
                f"{where}: column value without a column quantity; name it "
                f"{_drop(columns[value][0].unit)} instead"
            )
        for name, there in (*given.items(), ("offset", offset)):
            if name in columns and there is not None:
                raise InputError(
                    f"{where}: has a column {name}, and {name} is given as well; leave one out"
                )
        text = columns[value][0].text
        whole = f"{value}_drop" in VALUES
        if whole and offset is None and "offset" not in columns:
            unit = columns[value][0].unit
            unit = UNIT[f"{value}_drop"] and "unit" if unit is None else unit
            raise InputError(
                f"{where}: column {columns[value][0].place + 1}, {shown(text)}, is the whole friction, of which ageing "
                f"is a part; give what there is without ageing, in a column offset ({unit or 1}) or as offset (--offset), "
                "take the rise above the first hold time (--offset first), or, where it is the rise already, name it "
                f"{value}_drop ({unit or 1})"
            )
        if not whole and offset is not None:
            raise InputError(
                f"{where}: {shown(text)} is a rise already; leave offset out"
            )
        kinds = [kind for kind in _KINDS if all(name in columns for name in kind)]
        for kind, remedy in _KINDS.items():
            for name in () if kinds else columns.keys() - {"count"} & {*kind}:
                raise InputError(
                    f"{where}: {shown(columns[name][0].text)}: {remedy}"
                )
        errors = kinds[0] if kinds else ()
        if "upper" in errors and not columns["upper"][0].sigmas:
            raise InputError(
                f"{where}: {shown(columns['upper'][0].text)} does not say of which interval; name it, such as "
                '"95 % upper"'
            )
        return cls(table, given, value, errors, offset)

    def rows(self) -> Iterator[dict[str, Any]]:
        """The rows that have a value, with their conditions."""
        columns = self.table.columns
        above: dict[int, Cell] = {}
        places = [columns[name][0].place for name in _CONDITIONS if name in columns]
        for number, where, cells in self.table.rows:
            for place in places:
                if cells[place] == "" and place in above:
                    cells = [*cells[:place], above[place], *cells[place + 1 :]]
                    self._note(
                        "an empty cell of conditions means what is above it", where
                    )
                above[place] = cells[place]
            row = self._row((number, where, cells))
            if row is None:
                self._note("rows without a value are left out", where)
            else:
                yield self.given | row

    def _note(self, text: str, where: str) -> None:
        self.done.setdefault(text, []).append(where.rpartition(", ")[2])

    def _row(self, cells: Cells) -> dict[str, Any] | None:
        table, where, columns = self.table, cells[1], self.table.columns

        def text(name: str) -> str:
            cell = cells[2][columns[name][0].place]
            return cell if isinstance(cell, str) else f"{cell:g}"

        quantity = text("quantity") if self.value == "value" else self.value
        quantity = quantity.removesuffix("_drop") + "_drop"
        if quantity not in UNIT:
            raise InputError(
                f"{where}, column quantity: {shown(text('quantity'))}; write {' or '.join(UNIT)}"
            )
        unit = UNIT[quantity]
        found = [
            table.measured(cells, self.value, one, unit)
            for one in columns[self.value]
            if not is_missing(cells[2][one.place])
        ]
        if not found:
            return None
        row: dict[str, Any] = {"quantity": quantity}
        row["value"], row["error"] = self._value(cells, found, unit)
        row |= {
            name: table.number(cells, name, _UNITS[name])
            for name in _UNITS
            if name in columns
        }
        row |= {name: text(name) for name in _TEXTS if name in columns}
        if "temperature" in columns:
            row["temperature_unit"] = unit_written(text("temperature"))
        if row["error"] is not None and row["error"] <= 0:
            name = self.errors[0] if self.errors else self.value
            raise InputError(
                f"{where}, column {name}: {text(name)[:80]}: a standard error must be above zero; give the scatter "
                "of repeated measurements over the root of their number, or leave the column out"
            )
        if row["hold_time"] < 0:
            raise InputError(
                f"{where}, column hold_time: {text('hold_time')[:80]} is negative; hold times count from first contact"
            )
        for name in ("load", "temperature"):
            if name in row and row[name] <= 0:
                raise InputError(
                    f"{where}, column {name}: {row[name]:g} is not above zero"
                )
        offset = (
            0.0 if self.offset in (None, "first") else convert(self.offset, unit)
        )
        if "offset" in columns:
            offset = table.number(cells, "offset", unit)
        row["value"] -= offset
        return row

    def _value(
        self, cells: Cells, found: list[tuple[float, float | None]], unit: str
    ) -> tuple[float, float | None]:
        """The value of a row and its standard error: of one cell, of replicates, or of columns of errors."""
        table, where = self.table, cells[1]
        of = table.columns[self.errors[0] if self.errors else self.value]
        sigmas = of[0].sigmas or 1.0
        several = len(table.columns[self.value]) > 1
        if (several or self.errors) and any(
            error is not None for _, error in found
        ):
            raise InputError(
                f"{where}: a value with its error, beside replicates or columns of errors; leave one out"
            )
        if several:
            values = np.array([value for value, _ in found])
            if values.size < 2:
                raise InputError(
                    f"{where}: has one replicate, whose scatter is not known; leave that row out, or give a column error"
                )
            self._note(
                f"values are means of {values.size} replicates, errors their scatter over the root of {values.size}, "
                f"uncertain by {100 / math.sqrt(2 * values.size - 2):.0f} %",
                where,
            )
            return float(values.mean()), float(
                values.std(ddof=1) / math.sqrt(values.size)
            )
        ((value, error),) = found
        if not self.errors:
            return value, None if error is None else error / sigmas
        share = None if table.columns[self.value][0].unit == "%" else value
        numbers = [
            table.number(cells, name, "" if name == "count" else unit, share)
            for name in self.errors
        ]
        if self.errors == ("scatter", "count"):
            if numbers[1] < 1:
                raise InputError(
                    f"{where}, column count: {numbers[1]:g} is no number of measurements"
                )
            return value, numbers[0] / sigmas / math.sqrt(numbers[1])
        if self.errors == ("upper", "lower"):
            return value, (numbers[0] - numbers[1]) / 2 / sigmas
        if self.errors == ("plus", "minus"):
            self._note("of errors up and down their mean is taken", where)
            numbers = [(numbers[0] + abs(numbers[1])) / 2]
        return value, numbers[0] / sigmas

    def curve(
        self,
        key: tuple[Any, ...],
        rows: list[dict[str, Any]],
        stem: str,
        count: int,
    ) -> Measurements:
        """The rows that agree in ``key``, one of ``count`` curves."""
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
        rows = sorted(rows, key=itemgetter("hold_time"))
        times, values = (
            np.array([row[column] for row in rows])
            for column in ("hold_time", "value")
        )
        errors = [row["error"] for row in rows if row["error"] is not None]
        if errors and len(errors) < len(rows):
            raise InputError(
                f"{self.table.where}: {len(rows) - len(errors)} values of {name} have no error; give one for each"
            )
        error = np.array(errors) if errors else None
        notes = [
            *self.table.notes,
            *(
                text
                if len(places) == len(self.table.rows)
                else f"{text}: {shortened(', '.join(places), 60)}"
                for text, places in self.done.items()
            ),
        ]
        repeated = len(rows) - len(
            {(row["hold_time"], row["value"], row["error"]) for row in rows}
        )
        if repeated:
            notes.append(f"{repeated} rows repeat another one and count twice")
        if self.offset == "first" and len(rows):
            first = times == times[0]
            start, count_ = float(values[first].mean()), int(first.sum())
            notes.append(
                f"values are rises above {start:.4g} at {times[0]:g} s: sites that bonded before are not counted"
            )
            if error is not None:
                shared = float(np.sqrt((error[first] ** 2).sum()) / count_)
                error = np.hypot(error[~first], shared)
            times, values = times[~first], values[~first] - start
        if times.size < 2:
            of = f" of the curve {name}" if count > 1 else ""
            raise InputError(
                f"{self.table.where}: {times.size} rows of numbers{of}; a course in time needs at least two"
            )
        return Measurements(
            name,
            times,
            values,
            quantity,
            error,
            load,
            temperature,
            instrument,
            tuple(notes),
            min(row.get("temperature_unit", "") for row in rows),
        )
