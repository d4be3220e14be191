"""Comparison of the same quantities of several results, and of their chemistry.

Single asperities and rough contacts are compared alike: bonds per contact area and the fraction of bonded sites do not
depend on the size of a contact.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.elasticity import MEASURES, elastic_measures
from chemage.ageing.fitting import Fit, Model, Quantity, fit_aging
from chemage.ageing.measured import Measured
from chemage.ageing.measurements import Measurements, read_measurements
from chemage.foundation.errors import InputError
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.text import jsonable, mean_text
from chemage.foundation.units import convert
from chemage.reports.comparison.differences import Difference, differences
from chemage.reports.comparison.entries import Entry, load_results

#: rows about the limits of the elastic model: name of the measure -> label
_ELASTIC = {
    "hardness": "hardness",
    "area_above_hardness": "share of area above the hardness",
    "load_above_hardness": "share of load above the hardness",
    "mean_shear_stress": "mean shear stress at the last hold time",
    "shear_strength": "shear strength",
    "shear_stress_to_strength": "mean shear stress over shear strength",
}
#: hold times (s) at which results are compared, besides the last
TIMES = (1.0, 1e3)


@dataclass(frozen=True)
class Comparison:
    """Several results, and measurements to compare with them."""

    results: list[Entry]
    measured: list[Measurements] = field(default_factory=list)
    #: hold times at which results are compared, s, besides the last of each
    times: tuple[float, ...] = TIMES

    def chemistry_differences(self) -> list[Difference]:
        """Find the fields in which the chemistry of the aged results differs; empty if it is the same."""
        return differences([one.chemistry() for one in self.results if one.aging is not None])

    def other_differences(self) -> list[Difference]:
        """Find the other fields in which the scenes differ, without options that exist for one kind only.

        A section that only some of the scenes have appears with its kind.
        """
        found = differences([one.elsewhere() for one in self.results if one.scene])
        other_kinds = {one.path.removesuffix("kind") for one in found if one.path.endswith(".kind")}
        return [
            one
            for one in found
            if None not in one.values or one.path.endswith(".kind") or not one.path.startswith(tuple(other_kinds))
        ]

    def statement(self) -> str:
        """State in one sentence whether the chemistry is the same."""
        reacting = [one.name for one in self.results if one.aging is not None]
        if len(reacting) < 2:
            return "Chemistry: nothing to compare; fewer than two of the results were aged."
        different = self.chemistry_differences()
        if not different:
            return "Chemistry: the same in all results."
        return f"Chemistry: differs in {', '.join(one.path for one in different)}."

    def table(self) -> list[tuple[str, list[str]]]:
        """The rows of the printed table: (quantity, text of each result)."""
        rows: list[tuple[str, Callable[[Entry], str]]] = [
            ("scene", lambda one: str(one.scene.get("name", "")) or "-"),
            ("surface, solver", _made_of),
            ("load", lambda one: _text(one.load, "nN")),
            ("contact area A", lambda one: _text(one.area, "nm²")),
            ("area fraction A/A0", lambda one: _text(one.contact.get("area_fraction", math.nan))),
            ("patches", lambda one: _text(one.contact.get("patches", math.nan))),
            ("perimeter to area C/A", lambda one: _text(one.contact.get("perimeter_to_area", math.nan), "1/nm")),
            ("mean contact pressure", lambda one: _text(one.contact.get("mean_contact_pressure", math.nan), "GPa")),
            ("sites", lambda one: _text(one.sites)),
            ("grid of sites", lambda one: one.site_grid),
            ("replicas", lambda one: str(one.aging.replicas) if one.aging else "-"),
        ]
        for label, unit, curves in _CURVES:
            for time in self.times:
                rows.append((f"{label} at {time:g} s", _row_at(curves, unit, time)))
            rows.append((f"{label} at the last hold time", _row_at(curves, unit, None)))
        rows += [(_ELASTIC[name], partial(_elastic_text, name=name)) for name in self._limits()]
        rows += self._measured_rows()
        rows += [
            ("last hold time", lambda one: _text(one.last(), "s")),
            ("fit window", lambda one: f"{one.window[0]:g} to {one.window[1]:g} s" if one.aging else "-"),
            ("β, 95 % interval", lambda one: f.beta_text() if (f := one.fit) else "-"),
            ("cut-off time, 95 % interval", lambda one: f.cutoff_text() if (f := one.fit) else "-"),
        ]
        if any(one.scatter for one in self.results):
            rows.append(("scatter of β between surfaces", _scatter_text))
        if any(one.approximate for one in self.results):
            rows.append(("approximate", lambda one: one.approximate or "-"))
        if any(one.plugins for one in self.results):
            rows.append(("plugins that took part", lambda one: ", ".join(one.plugins.values()) or "-"))
        return [(label, [text_of(one) for one in self.results]) for label, text_of in rows]

    def _measured_rows(self) -> list[tuple[str, Callable[[Entry], str]]]:
        """Rows of the outputs of observables that are numbers, or curves against hold time."""
        rows: list[tuple[str, Callable[[Entry], str]]] = []
        for name, first in self.outputs().items():
            if first.is_number:
                rows.append((name, partial(_measured_text, name=name)))
                continue
            for time in self.times:
                rows.append((f"{name} at {time:g} s", partial(_measured_text, name=name, time=time)))
            rows.append((f"{name} at the last hold time", partial(_measured_text, name=name)))
        return rows

    def _limits(self) -> list[str]:
        """What is known of any result about the limits of the elastic model."""
        known = {name for one in self.results for name in elastic_measures(one.aging)}
        return [name for name in MEASURES if name in known]

    def outputs(self) -> dict[str, Measured]:
        """The outputs of observables that can be compared, by name: the first result that has each."""
        found: dict[str, Measured] = {}
        for one in self.results:
            for name, part in one.measured.items():
                if part.is_number or part.is_curve:
                    found.setdefault(name, part)
        return found

    def numbers(self) -> list[dict[str, Any]]:
        """The results as plain JSON values, one object each."""
        return [jsonable(self._numbers(one)) for one in self.results]

    def _numbers(self, one: Entry) -> dict[str, Any]:
        fit = one.fit
        at = []
        for time in (*self.times, one.last()):
            entry: dict[str, Any] = {"time": time}
            for name, (_, _, curves) in zip(_CURVE_NAMES, _CURVES, strict=True):
                entry |= _with_errors(name, one.at(curves(one), time))
            for name, first in self.outputs().items():
                if first.is_curve:
                    entry |= _with_errors(f"observable.{name}", _values_at(one, name, time))
            at.append(entry)
        numbers: dict[str, Any] = {}
        for name, first in self.outputs().items():
            if first.is_number:
                numbers |= _with_errors(f"observable.{name}", _values_at(one, name, None))
        return {
            "name": one.name,
            "file": one.source,
            "scene": one.scene.get("name"),
            "surface": one.scene.get("surface", {}).get("kind"),
            "solver": one.scene.get("contact", {}).get("kind"),
            "load": one.load,
            **{
                name: one.contact.get(name)
                for name in ("area", "area_fraction", "patches", "perimeter_to_area", "mean_contact_pressure")
            },
            "sites": one.sites,
            "site_grid": one.site_grid,
            "replicas": one.aging.replicas if one.aging else 0,
            "plugins": dict(one.plugins),
            **({"approximate": one.approximate} if any(each.approximate for each in self.results) else {}),
            "fit_window": list(one.window),
            "beta": fit.beta if fit else None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "beta_interval": [fit.beta_interval.low, fit.beta_interval.high] if fit else None,
            "beta_scatter_between_surfaces": one.scatter.relative if one.scatter else None,
            "cutoff_time": fit.cutoff_time if fit else None,
            "cutoff_time_stderr": fit.cutoff_time_stderr if fit else None,
            "cutoff_time_interval": [fit.cutoff_interval.low, fit.cutoff_interval.high] if fit else None,
            **{name: elastic_measures(one.aging).get(name) for name in self._limits()},
            **numbers,
            "at": at,
        }

    def todict(self) -> dict[str, Any]:
        """The whole comparison as plain JSON values."""

        def listed(differences: list[Difference]) -> list[dict[str, Any]]:
            return [{"field": one.path, "values": jsonable(list(one.values))} for one in differences]

        different = self.chemistry_differences()
        return {
            "results": self.numbers(),
            "same_chemistry": not different if sum(one.aging is not None for one in self.results) > 1 else None,
            "chemistry_differences": listed(different),
            "other_differences": listed(self.other_differences()),
            "fits": [{"data": name, **fit.todict()} for name, fit in self.fits()],
        }

    def csv(self) -> str:
        """The comparison as CSV with one line per result and units in the header."""
        units = {"load": "nN", "area": "nm^2", "perimeter_to_area": "1/nm", "mean_contact_pressure": "GPa"}
        units |= {"cutoff_time": "s", "cutoff_time_stderr": "s", "cutoff_time_low": "s", "cutoff_time_high": "s"}
        units |= {name: unit for name, (unit, _) in MEASURES.items() if unit != "1"}
        units |= {f"observable.{name}": one.unit for name, one in self.outputs().items() if one.unit}
        units |= {"friction_drop": "nN", "bonds_per_area": "1/nm^2", "fit_start": "s", "fit_stop": "s", "last": "s"}
        lines = []
        for numbers in self.numbers():
            line: dict[str, Any] = {}
            at, window = numbers.pop("at"), numbers.pop("fit_window")
            numbers["plugins"] = "; ".join(f"{name}: {source}" for name, source in numbers["plugins"].items())
            for name in ("beta", "cutoff_time"):
                low, high = numbers.pop(f"{name}_interval") or (None, None)
                numbers |= {f"{name}_low": low, f"{name}_high": high}
            numbers |= {"fit_start": window[0], "fit_stop": window[1], "last": at[-1]["time"]}
            for name, value in numbers.items():
                unit = units.get(_without_error(name))
                line[f"{name} ({unit})" if unit else name] = value
            for entry, label in zip(at, (*(f"{time:g} s" for time in self.times), "last"), strict=True):
                for name in (key for key in entry if key != "time"):
                    unit = units.get(_without_error(name))
                    line[f"{name} at {label}" + (f" ({unit})" if unit else "")] = entry[name]
            lines.append(line)
        text = io.StringIO()
        writer = csv.DictWriter(text, list(lines[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
        return text.getvalue()

    def fits(self) -> list[tuple[str, Fit]]:
        """Fit both models to each set of measurements, and to each result over the same hold times: (name, fit)."""
        found = []
        for data in self.measured:
            for model in ("line", "curve"):
                fit = self.measured_fit(data, model)
                if fit is None:
                    continue
                found.append((data.name, fit))
                positive = data.hold_times[data.hold_times > 0]
                window = fit.window or (float(positive.min()), float(positive.max()))
                for one in self.results:
                    if (same := _simulated_fit(one, model, window, data.quantity)) is not None:
                        found.append((one.name, same))
        return found

    def measured_fit(self, data: Measurements, model: Model) -> Fit | None:
        """Fit a model to measurements; None if there are too few."""
        # the line over the window of the results if it contains enough measurements, else over all of them
        windows = [self.results[0].window, None] if model == "line" else [None]
        for window in windows:
            try:
                return fit_aging(data, model=model, window=window)
            except InputError:
                continue
        return None


def _simulated_fit(one: Entry, model: Model, window: tuple[float, float], quantity: Quantity) -> Fit | None:
    if one.aging is None or (one.load == 0 and quantity == "friction_coefficient_drop"):
        return None
    try:
        return fit_aging(one.aging, model=model, window=window, quantity=quantity)
    except InputError:
        return None


def compare_files(
    files: Sequence[str | Path],
    *,
    measured: Sequence[str | Path] = (),
    times: Sequence[float | str] = TIMES,
) -> Comparison:
    """Compare result files with each other and with measurements.

    Parameters
    ----------
    files
        Files of runs, ageing curves or contacts, as written by :func:`chemage.write` and ``chemage run``, and folders
        of sweeps.
    measured
        CSV files of measurements, see :func:`chemage.read_measurements`.
    times
        Hold times at which to compare, s or strings with units, besides the last.

    Raises
    ------
    InputError
        There are no files or too many, a file is given twice or holds nothing to compare, or a time is not valid.
    StoreError
        A file is missing or damaged.
    """
    if not files:
        raise InputError("there is nothing to compare; give result files")
    seconds = tuple(convert(time, "s") for time in times)
    for given, value in zip(times, seconds, strict=True):
        if not (math.isfinite(value) and value > 0):
            raise InputError.of("times", given, "must be above zero and finite", 'give times such as "1e3 s"')
    data = [read_measurements(path) for path in measured]
    repeated = Counter(one.name for one in data)
    data = [
        one if repeated[one.name] == 1 else replace(one, name=str(path))
        for one, path in zip(data, measured, strict=True)
    ]
    return Comparison(load_results(files), data, seconds)


def _text(value: float | None, unit: str = "") -> str:
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.5g} {unit}".strip()


def _made_of(one: Entry) -> str:
    kinds = [one.scene.get(name, {}).get("kind", "") for name in ("surface", "contact")]
    return ", ".join(kind for kind in kinds if kind) or "-"


Curves = Callable[[Entry], np.ndarray]


def _row_at(curves: Curves, unit: str, time: float | None) -> Callable[[Entry], str]:
    def text_of(one: Entry) -> str:
        values = one.at(curves(one), one.last() if time is None else time)
        return mean_text(values, unit)

    return text_of


def _without_error(name: str) -> str:
    return name.removesuffix("_stderr").removesuffix("_half_width")


def _values_at(one: Entry, name: str, time: float | None) -> np.ndarray:
    """(replicas,) of an output of an observable, of a curve at ``time`` or the last hold time; nan without it."""
    part = one.measured.get(name)
    if part is None or part.numbers is None:
        return np.full(1, np.nan)
    return part.numbers if time is None or part.is_number else one.at(part.values, time)


def _measured_text(one: Entry, name: str, time: float | None = None) -> str:
    part = one.measured.get(name)
    return mean_text(_values_at(one, name, time), part.unit) if part is not None else "-"


def _scatter_text(one: Entry) -> str:
    if one.scatter is None or one.fit is None:
        return "-"
    return one.scatter.text(one.fit.relative_stderr) or "one surface"


def _elastic_text(one: Entry, name: str) -> str:
    unit = MEASURES[name][0]
    return _text(elastic_measures(one.aging).get(name), "" if unit == "1" else unit)


def _with_errors(name: str, values: np.ndarray) -> dict[str, float]:
    return {
        name: float(values.mean()),
        f"{name}_stderr": float(standard_error(values)),
        f"{name}_half_width": float(half_width(values)),
    }


def friction(one: Entry) -> np.ndarray:
    """ΔF, nN, (replicas, m)."""
    return one.aging.friction_drop if one.aging is not None else np.full((1, 0), np.nan)


def coefficient(one: Entry) -> np.ndarray:
    """Δμ, (replicas, m)."""
    return one.aging.friction_coefficient_drop if one.aging is not None else np.full((1, 0), np.nan)


_CURVES: list[tuple[str, str, Curves]] = [
    ("friction drop ΔF", "nN", friction),
    ("friction coefficient drop Δμ", "", coefficient),
    ("bonds per contact area", "1/nm²", lambda one: one.bonds_per_area),
    ("fraction of sites bonded", "", lambda one: one.bonded_fraction),
]
_CURVE_NAMES = ("friction_drop", "friction_coefficient_drop", "bonds_per_area", "bonded_fraction")
