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
from chemage.ageing.measurements import Measurements, read_measurements
from chemage.ageing.outputs import Measured
from chemage.contacts.options import force_text
from chemage.foundation.errors import InputError
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.text import jsonable, mean_text, percent
from chemage.foundation.units import QuantityLike, convert
from chemage.results.comparison.differences import Difference, differences
from chemage.results.comparison.entries import Entry, load_results
from chemage.results.ensemble_text import errors, interval_text
from chemage.studies.ensembles.ensemble import Estimate

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
        return differences([one.chemistry() for one in self.results if one.ages])

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
        reacting = [one.name for one in self.results if one.ages]
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
            ("load", lambda one: force_text(one.load) if math.isfinite(one.load) else "-"),
            ("contact area A", partial(_contact_text, name="area", unit="nm²")),
            ("area fraction A/A0", partial(_contact_text, name="area_fraction")),
            ("patches", partial(_contact_text, name="patches")),
            ("perimeter to area C/A", partial(_contact_text, name="perimeter_to_area", unit="1/nm")),
            ("mean contact pressure", partial(_contact_text, name="mean_contact_pressure", unit="GPa")),
            ("sites", lambda one: _text(one.sites)),
            ("grid of sites", lambda one: one.site_grid),
            ("replicas", lambda one: str(one.aging.replicas) if one.aging else "-"),
        ]
        if self.has_ensembles:
            rows += [("mean over", lambda one: one.over), ("every ± is", _meaning)]
        for name, (label, unit, curves) in zip(_CURVE_NAMES, _CURVES, strict=True):
            for time in self.times:
                rows.append((f"{label} at {time:g} s", _row_at(name, curves, unit, time)))
            rows.append((f"{label} at the last hold time", _row_at(name, curves, unit, None)))
        if any(map(_further_errors, self.results)):
            rows.append(("further errors of the mean", lambda one: _further_errors(one) or "-"))
        rows += [(_ELASTIC[name], partial(_elastic_text, name=name)) for name in self._limits()]
        rows += self._measured_rows()
        rows += [
            ("last hold time", lambda one: _text(one.last(), "s")),
            ("hold times of the fit", _fitted),
            ("β, 95 % interval", lambda one: _beta(f) if (f := one.fit) else _not_fitted(one)),
            ("cut-off time, 95 % interval", lambda one: f.cutoff_text() if (f := one.fit) else _no_cutoff(one)),
        ]
        if self.has_ensembles:
            rows.append(("standard errors of β", _parts_text))
        if any(one.scatter or one.of_surfaces for one in self.results):
            rows.append(("scatter of β between surfaces", _scatter_text))
        if any(one.approximate for one in self.results):
            rows.append(("approximate", lambda one: one.approximate or "-"))
        if any(one.plugins for one in self.results):
            rows.append(("plugins that took part", lambda one: ", ".join(one.plugins.values()) or "-"))
        return [(label, [text_of(one) for one in self.results]) for label, text_of in rows]

    @property
    def has_ensembles(self) -> bool:
        """Whether a result is an ensemble, so that it must be said what each error contains."""
        return any(one.ensemble is not None for one in self.results)

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
                estimated = one.estimate(name, time)
                entry |= _with_errors(name, one.at(curves(one), time)) if estimated is None else _of(name, estimated)
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
            **(_interval_is(one) if self.has_ensembles else {}),
            **({"further_errors": _further_errors(one)} if any(map(_further_errors, self.results)) else {}),
            "plugins": dict(one.plugins),
            **({"approximate": one.approximate} if any(each.approximate for each in self.results) else {}),
            "fit_window": list(one.window),
            "fit_range": list(one.fit_range) if one.fit_range else None,
            "beta": fit.beta if fit else None,
            "beta_reason": one.fit_reason or None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "beta_interval": [fit.beta_interval.low, fit.beta_interval.high] if fit else None,
            "b": fit.b if fit else None,
            "b_stderr": fit.b_stderr if fit else None,
            "b_interval": [fit.b_interval.low, fit.b_interval.high] if fit else None,
            **_beta_of(one),
            "beta_scatter_between_surfaces": one.scatter.relative if one.scatter else _measured_scatter(one),
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
            "same_chemistry": not different if sum(one.ages for one in self.results) > 1 else None,
            "chemistry_differences": listed(different),
            "other_differences": listed(self.other_differences()),
            "fits": [{"data": name, **fit.todict()} for name, fit in self.fits()],
            "not_fitted": [
                {"data": name, "model": model, "reason": reason} for name, model, reason in self.not_fitted()
            ],
        }

    def csv(self) -> str:
        """The comparison as CSV with one line per result and units in the header."""
        units = {"load": "nN", "area": "nm^2", "perimeter_to_area": "1/nm", "mean_contact_pressure": "GPa"}
        units |= {"cutoff_time": "s", "cutoff_time_stderr": "s", "cutoff_time_low": "s", "cutoff_time_high": "s"}
        units |= {name: unit for name, (unit, _) in MEASURES.items() if unit != "1"}
        units |= {f"observable.{name}": one.unit for name, one in self.outputs().items() if one.unit}
        units |= {"friction_drop": "nN", "bonds_per_area": "1/nm^2", "fit_start": "s", "fit_stop": "s"}
        units |= {"fit_first": "s", "fit_last": "s", "last": "s"}
        lines = []
        for numbers in self.numbers():
            line: dict[str, Any] = {}
            at, window = numbers.pop("at"), numbers.pop("fit_window")
            first, final = numbers.pop("fit_range") or (None, None)
            numbers["plugins"] = "; ".join(f"{name}: {source}" for name, source in numbers["plugins"].items())
            for name in ("beta", "b", "cutoff_time"):
                low, high = numbers.pop(f"{name}_interval") or (None, None)
                numbers |= {f"{name}_low": low, f"{name}_high": high}
            numbers |= {"fit_start": window[0], "fit_stop": window[1]}
            numbers |= {"fit_first": first, "fit_last": final, "last": at[-1]["time"]}
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
        return [(name, fit) for name, _, fit in self._fits() if isinstance(fit, Fit)]

    def not_fitted(self) -> list[tuple[str, str, str]]:
        """The fits of :meth:`fits` that cannot be made: (name, model in words, reason)."""
        words = {"line": "β log10(t/t_c)", "curve": "β log10(1 + t/t_c)"}
        return [(name, words[model], reason) for name, model, reason in self._fits() if isinstance(reason, str)]

    def _fits(self) -> list[tuple[str, Model, Fit | str]]:
        """Each fit, or the reason why there is none: (name, model, fit or reason)."""
        found: list[tuple[str, Model, Fit | str]] = []
        models: tuple[Model, Model] = ("line", "curve")
        for data in self.measured:
            for model in models:
                fit = self._measured_fit(data, model)
                found.append((data.name, model, fit))
                if isinstance(fit, str):
                    continue
                positive = data.hold_times[data.hold_times > 0]
                window = fit.window or (float(positive.min()), float(positive.max()))
                for one in self.results:
                    if (same := _simulated_fit(one, model, window, data.quantity)) is not None:
                        found.append((one.name, model, same))
        return found

    def measured_fit(self, data: Measurements, model: Model) -> Fit | None:
        """Fit a model to measurements; None if there are too few."""
        fit = self._measured_fit(data, model)
        return fit if isinstance(fit, Fit) else None

    def _measured_fit(self, data: Measurements, model: Model) -> Fit | str:
        # the line over the window of the results if it contains enough measurements, else over all of them
        reason = ""
        windows = [self.results[0].window, None] if model == "line" else [None]
        for window in windows:
            try:
                return fit_aging(data, model=model, window=window)
            except InputError as error:
                reason = str(error)
        return reason


def _simulated_fit(one: Entry, model: Model, window: tuple[float, float], quantity: Quantity) -> Fit | str | None:
    """The fit, or why it cannot be made; None of a result without ageing."""
    if one.ensemble is not None and one.ages:
        return "a mean over surfaces has the β of its own window, with its errors, in the table of the results"
    if one.aging is None:
        return None
    try:
        return fit_aging(one.aging, model=model, window=window, quantity=quantity)
    except InputError as error:
        return str(error)


def _fitted(one: Entry) -> str:
    """The first and the last hold time of the fit, and whether they are too few."""
    if one.fit_range is None:
        return "-"
    doubt = one.ensemble.quantities.doubt if one.ensemble is not None else one.fit.doubt if one.fit is not None else ""
    return "{:g} to {:g} s".format(*one.fit_range) + f"; {doubt}" * bool(doubt)


def _beta(fit: Fit) -> str:
    return f"{fit.beta_text()}; b = {fit.b_text()}"


def _not_fitted(one: Entry) -> str:
    """What stands in the row of a fit that is not there."""
    if one.ensemble is not None and one.ensemble.quantities.has_beta:
        beta, b = (
            interval_text(one.ensemble.estimate("beta"), "per decade"),
            interval_text(one.ensemble.b, "per e-fold"),
        )
        return f"{beta}; b = {b}"
    return "-" if one.aging is None else f"not fitted: {one.fit_reason}"


def _no_cutoff(one: Entry) -> str:
    return "-" if one.aging is None else "not fitted"


def compare_files(
    files: Sequence[str | Path],
    *,
    measured: Sequence[str | Path] = (),
    times: Sequence[QuantityLike] = TIMES,
) -> Comparison:
    """Compare result files with each other and with measurements.

    Parameters
    ----------
    files
        Files of runs, ensembles, ageing curves or contacts, as written by :func:`chemage.write` and ``chemage run``,
        and folders of sweeps.
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


def _row_at(name: str, curves: Curves, unit: str, time: float | None) -> Callable[[Entry], str]:
    def text_of(one: Entry) -> str:
        if one.ensemble is not None and one.ages:
            estimated = one.estimate(name, one.last() if time is None else time)
            return "-" if estimated is None else interval_text(estimated, unit)
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


def _contact_text(one: Entry, name: str, unit: str = "") -> str:
    """A measure of the contact; of an ensemble with its interval."""
    estimated = one.estimate(name)
    if estimated is not None and math.isfinite(estimated.half_width):
        return interval_text(estimated, unit)
    return _text(one.contact.get(name, math.nan), unit)


def _meaning(one: Entry) -> str:
    """What the errors of a result contain, so that those of one surface are not taken for those of a mean."""
    if one.of_surfaces:
        return "95 % interval of the mean over surfaces: contains the scatter between surfaces"
    if one.ensemble is not None:
        return "95 % interval of the mean over replicas: disorder and noise on this surface alone"
    if one.aging is None or one.aging.replicas < 2:
        return "-"
    return "95 % interval over replicas: disorder and noise on this one surface, without the scatter between surfaces"


def _parts_text(one: Entry) -> str:
    """The standard errors of β by name."""
    if one.ensemble is not None:
        estimated = one.estimate("beta")
        return "-" if estimated is None else "; ".join(f"{part}: {size}" for part, size, _ in errors(estimated))
    if one.fit is None or not math.isfinite(one.fit.relative_stderr):
        return "-"
    return f"replicas on one surface: {percent(one.fit.relative_stderr)}"


def _interval_is(one: Entry) -> dict[str, Any]:
    """Over how many surfaces a result is a mean, and what its intervals are about."""
    surfaces = one.ensemble.surfaces if one.ensemble is not None and one.ensemble.random else 1
    return {"surfaces": surfaces, "interval_over": "surfaces" if one.of_surfaces else "replicas on one surface"}


def _beta_of(one: Entry) -> dict[str, Any]:
    """β and b of an ensemble; empty of other results."""
    if one.ensemble is None or not one.ensemble.quantities.has_beta:
        return {}
    found: dict[str, Any] = {"beta_reason": None}
    for name, estimated in (("beta", one.ensemble.estimate("beta")), ("b", one.ensemble.b)):
        low, high = estimated.value - estimated.half_width, estimated.value + estimated.half_width
        found |= {name: estimated.value, f"{name}_stderr": estimated.stderr, f"{name}_interval": [low, high]}
    return found


def _of(name: str, one: Estimate) -> dict[str, float]:
    """As :func:`_with_errors`, of an ensemble."""
    return {name: one.value, f"{name}_stderr": one.stderr, f"{name}_half_width": one.half_width}


def _measured_scatter(one: Entry) -> float | None:
    """The scatter of β between surfaces that an ensemble measured."""
    if one.ensemble is None or not one.of_surfaces or not math.isfinite(one.ensemble.scatter):
        return None
    return one.ensemble.scatter


def _scatter_text(one: Entry) -> str:
    if (measured := _measured_scatter(one)) is not None and one.ensemble is not None:
        return f"{percent(measured)} (standard deviation), measured here on {one.ensemble.surfaces} surfaces"
    if one.scatter is None or one.fit is None:
        return "-"
    return one.scatter.text(one.fit.relative_stderr) or "one surface"


def _further_errors(one: Entry) -> str:
    """The errors of the mean beside the scatter of the replicas, in words."""
    return one.aging.error_words if one.aging is not None else ""


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
