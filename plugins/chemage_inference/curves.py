"""Measured curves of ageing with the conditions under which they were measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import model_validator

from chemage import InputError, Measurements, read
from chemage.plugin import (
    Doubles,
    Plain,
    PositiveNumber,
    Record,
    array_in,
    check_times,
    container,
    correlated_errors,
    force,
    read_table,
    result_of,
    temperature_value,
    units,
)
from chemage_inference.noise import LARGEST

#: fewer decades of hold times than this say nothing of a distribution of barriers
DECADES = 1.0


class MeasuredCurve(Record):
    """A measured curve of ageing under one load and at one temperature."""

    arrays = {
        "hold_times": (("hold_time",), "s", "hold time"),
        "values": (("hold_time",), "", "ΔF in nN, or Δμ"),
        "errors": (("hold_time",), "", "standard errors of the values"),
        "correlation": (
            ("hold_time",),
            "",
            "correlation of each error with that of the hold time before",
        ),
    }
    added = ("correlation", "temperature_unit", "before")

    name: str = "curve"
    load: PositiveNumber
    """nN"""
    temperature: PositiveNumber
    """K"""
    quantity: Literal["friction_coefficient_drop", "friction_drop"] = (
        "friction_drop"
    )
    """what ``values`` are: "friction_drop" (ΔF, nN) or "friction_coefficient_drop" (Δμ)"""
    hold_times: Doubles
    """(m,) s, > 0, non-decreasing; a time that occurs again is a repeated measurement"""
    values: Doubles
    """(m,) ΔF in nN, or Δμ"""
    errors: Doubles
    """(m,) standard errors, > 0, in the unit of ``values``"""
    correlation: Doubles | None = None
    """(m,) correlation of each error with that of the hold time before, 0 at the first: the errors of simulated curves,
    whose hold times share their bonds, are a Markov chain. None: not known, and none unless it is inferred"""
    instrument: str = ""
    """with which it was measured: curves of one instrument share its calibration"""
    before: tuple[PositiveNumber, PositiveNumber] | None = None
    """temperature (K) and duration (s) of a rest under the same load before, with the bonds of which the hold times
    begin; sites must not interact"""
    notes: tuple[str, ...] = ()
    """what reading understood and left out"""
    temperature_unit: str = ""
    """the unit that was written with the number of the temperature: nobody asks whether "27 K" are 27 °C"""
    chemistry: Plain = {}
    """options of the chemistry under which it was measured, where they are known; the scene must have the same"""

    def __init__(self, **fields: Any) -> None:
        unit = (
            "nN"
            if fields.get("quantity", "friction_drop") == "friction_drop"
            else ""
        )
        temperature = fields.get("temperature")
        if isinstance(temperature, str):
            fields["temperature"] = temperature_value(temperature)
            fields["temperature_unit"] = units.unit_written(temperature)
        super().__init__(
            **{
                n: array_in(v, unit) if n in ("values", "errors") else v
                for n, v in fields.items()
            }
        )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if check_times(self.hold_times).ndim != self.hold_times.ndim:
            raise ValueError("hold_times: give a list")
        if self.hold_times.size and self.hold_times[0] <= 0:
            raise ValueError(
                "hold_times[0] = 0 s: nothing has aged then; leave that row out"
            )
        about = self.name, self.hold_times, self.values, self.quantity
        Measurements(*about, self.errors)
        if self.known_correlation.shape != self.hold_times.shape:
            raise ValueError("correlation: give one for each hold time")
        return self

    @property
    def known_correlation(self) -> np.ndarray:
        """(m,) correlation of each error with that of the hold time before; nan where it is not known."""
        if self.correlation is None:
            return np.full(self.hold_times.size, np.nan)
        return self.correlation

    @property
    def _force(self) -> float:
        """nN of one of ``values``."""
        return 1.0 if self.quantity == "friction_drop" else self.load

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF, nN, (m,)."""
        return self.values * self._force

    @property
    def friction_drop_errors(self) -> np.ndarray:
        """Standard errors of ΔF, nN, (m,)."""
        return self.errors * self._force

    @property
    def question(self) -> str:
        """Whether a low temperature is one in °C; "" of another, and of one whose unit was written with it."""
        asked = units.celsius_meant("temperature", self.temperature)
        if self.temperature_unit or not asked:
            return ""
        return f'{self.name}: {asked}, or "{self.temperature:g} K" if that is meant'

    @classmethod
    def of(
        cls,
        measurements: Measurements,
        *,
        load: units.QuantityLike | None = None,
        temperature: units.QuantityLike | None = None,
        relative_error: float | None = None,
    ) -> MeasuredCurve:
        """Measurements with what they lack: the load (nN), the temperature (K) and errors.

        ``relative_error`` (0.03: 3 %) stands for errors that the measurements do not state.

        Raises
        ------
        InputError
            Something is missing, or stated twice.
        """
        if relative_error is not None and not 0 < relative_error < 1:
            raise InputError.of(
                "relative_error",
                relative_error,
                "must be between 0 and 1",
                "3 % is 0.03",
            )
        name, there = measurements.name, measurements.error
        given = {
            "load": measurements.load if load is None else force(load),
            "temperature": measurements.temperature
            if temperature is None
            else temperature,
        }
        for what, value in given.items():
            if value is None:
                raise InputError(
                    f"{name}: no column {what}; add it, or give {what}"
                )
        if there is None and relative_error is None:
            raise InputError(
                f"{name}: no column error; the density cannot be inferred without standard errors, so add one, or give "
                "relative_error, such as 0.03"
            )
        if there is not None and relative_error is not None:
            raise InputError(
                f"{name}: has a column error, and relative_error is given as well; leave one out: a common scale of "
                "the stated errors is inferred anyway"
            )
        if there is None:
            there = np.abs(measurements.values) * relative_error
        kept = measurements.hold_times > 0
        return cls(
            name=name,
            **given,
            temperature_unit=measurements.temperature_unit,
            quantity=measurements.quantity,
            hold_times=measurements.hold_times[kept],
            values=measurements.values[kept],
            errors=there[kept],
            instrument=measurements.instrument,
            notes=measurements.notes,
        )

    @classmethod
    def of_result(cls, result: Any, name: str = "") -> MeasuredCurve:
        """The mean ΔF of a result of chemage, with the errors of its replicas or surfaces and their correlation.

        Raises
        ------
        InputError
            It is no result, has no ΔF against hold time, or no error, as that of a single replica.
        """
        try:
            shown = result_of(result)
        except InputError:
            problem = "is no MeasuredCurve, table or result"
            remedy = "give curves from chemage.read_curves, or a file"
            raise InputError.of("measured", result, problem, remedy) from None
        name, ageing = name or shown.name, shown.comparable()
        curves = [one for one in shown.curves() if one.name == "friction_drop"]
        chemistry = {**ageing.chemistry}
        kelvin = chemistry.pop("temperature", None)
        chemistry |= chemistry.pop("chemistry", {})
        if not curves or kelvin is None:
            raise InputError(f"{name}: has no friction drop against hold time")
        if reason := getattr(shown.made_by().get("ageing"), "unfitted", ""):
            raise InputError(f"{name}: is no single hold: {reason}")
        above = curves[0].x > 0
        errors, near = correlated_errors(curves[0])
        return cls(
            name=name,
            load=ageing.load,
            temperature=kelvin,
            hold_times=curves[0].x[above],
            values=curves[0].mean[above],
            errors=errors,
            correlation=near,
            chemistry=chemistry,
        )

    def __repr__(self) -> str:
        return (
            f"<MeasuredCurve {self.name}: {self.hold_times.size} hold times from {self.hold_times[0]:g} to "
            f"{self.hold_times[-1]:g} s, {self.load:g} nN, {self.temperature:g} K>"
        )

    __str__ = __repr__


def read_curves(
    source: str | Path | Any,
    *,
    load: units.QuantityLike | None = None,
    temperature: units.QuantityLike | None = None,
    relative_error: float | None = None,
    offset: units.QuantityLike | None = None,
    sheet: str | None = None,
) -> tuple[MeasuredCurve, ...]:
    """Read measured curves with the conditions that an inference needs; the table is that of
    :func:`chemage.plugin.read_table`.

    Parameters
    ----------
    source
        The file, or a data frame; or a result of chemage or its file (``.h5``), see :meth:`MeasuredCurve.of_result`.
    load, temperature
        nN and K, or with units, where the table has no such column.
    relative_error
        Standard error over the value (0.03: 3 %), where the table has no errors.
    offset, sheet
        Friction without ageing, and the sheet of an Excel file, as for :func:`chemage.plugin.read_table`.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and the column that is wrong, or what is missing, and the remedy.
    """
    name = Path(source).stem if isinstance(source, str | Path) else ""
    if name and container.is_ours(Path(source)):
        source = read(source, maps=False)
    if not isinstance(source, str | Path) and not hasattr(source, "itertuples"):
        given = load, temperature, relative_error, offset, sheet
        if any(one is not None for one in given):
            raise InputError(
                f"{name or 'result'}: a result has load, temperature and errors; leave these options out"
            )
        return (MeasuredCurve.of_result(source, name),)
    tables = read_table(
        source, load=load, temperature=temperature, offset=offset, sheet=sheet
    )
    return tuple(
        MeasuredCurve.of(table, relative_error=relative_error) for table in tables
    )


def check_curves(curves: Sequence[MeasuredCurve], drift: float = 0.0) -> None:
    """Refuse what no density can be inferred from: hold times of one decade, curves that fall by more than a ``drift``.

    Raises
    ------
    InputError
        Naming the curve, what is wrong, and the remedy.
    """
    if not curves:
        raise InputError(
            "curves: none given; read them with chemage.read_curves, or make a MeasuredCurve"
        )
    for curve in curves:
        times = curve.hold_times
        values = curve.friction_drop
        errors = curve.friction_drop_errors
        if times.size < 2 or math.log10(times[-1] / times[0]) < DECADES:
            raise InputError(
                f"{curve.name}: hold_times from {times[0]:g} to {times[-1]:g} s are within one decade, which sees "
                "barriers within 2.3 k_BT of each other; give hold times over two decades or more"
            )
        (slope, _), covariance = np.polyfit(
            np.log10(times), values, 1, w=1 / errors, cov="unscaled"
        )
        # stated errors may be too small by a factor
        error = math.sqrt(covariance[0, 0])
        if slope < -3 * (LARGEST * error + drift * np.abs(values).max()):
            raise InputError(
                f"{curve.name}: values fall, by {-slope:.3g} ± {error:.2g} nN per decade of hold time, but bonds that "
                "form can only add; check the sign and the order of the values"
            )
