"""Result files side by side: the same quantities of each, whether the chemistry is the same, and the figures.

A single asperity and a rough contact are compared as they are; bonds per contact area and the fraction of sites bonded
are what makes contacts of different size comparable.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.errors import InputError
from chemage.measured import SYMBOL, AgingFit, Measurements, Model, Quantity, fit_aging
from chemage.objects import Aging, ContactSolution, Fit
from chemage.text import plus_minus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: hold times (s) at which results are put side by side, besides the last
TIMES = (1.0, 1e3)
_CHEMICAL = ("forming", "breaking", "interaction", "chemistry", "temperature")


# -- one result -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """What a comparison keeps of one result file: the maps are let go."""

    name: str
    source: str
    title: str
    #: plain scene data; {} where the file holds ageing without its scene
    scene: Mapping[str, Any]
    #: the measures of the contact, see :meth:`chemage.ContactSolution.summary`
    contact: Mapping[str, float]
    aging: Aging | None = None
    #: distribution of the pressure over the contact: edges (GPa), density (1/GPa)
    pressure: tuple[np.ndarray, np.ndarray] | None = None
    #: first and last hold time of the fit, s
    window: tuple[float, float] = (10.0, 1e4)
    #: reads the whole again, maps included
    whole: Callable[[], Any] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, thing: Any, name: str = "", source: str = "") -> Result:
        """The result in a :class:`chemage.Run`, or in ageing or a contact alone."""
        from chemage.runs import Run

        if isinstance(thing, Run):
            window = thing.scene.get("fit", {})
            return cls(
                name or thing.name,
                source,
                str(thing.scene.get("title", "")),
                thing.scene,
                thing.contact.summary(),
                thing.aging,
                _pressures(thing.contact),
                (window.get("start", 10.0), window.get("stop", 1e4)),
            )
        if isinstance(thing, Aging):
            return cls(name, source, "", {}, thing.contact, thing)
        if isinstance(thing, ContactSolution):
            return cls(name, source, "", {}, thing.summary(), None, _pressures(thing))
        raise InputError(
            f"{source or name} holds a {type(thing).__name__}; a comparison takes runs, ageing or contacts, "
            "such as `chemage run` makes"
        )

    @property
    def load(self) -> float:
        """nN."""
        return self.aging.load if self.aging is not None else self.contact.get("load", math.nan)

    @property
    def area(self) -> float:
        """Contact area, nm²; nan where the file does not tell it."""
        return self.contact.get("area", math.nan)

    @property
    def sites(self) -> float:
        """Reactive sites, mean over replicas."""
        return float(self.aging.sites.mean()) if self.aging is not None else math.nan

    @property
    def bonds_per_area(self) -> np.ndarray:
        """Bonds per contact area, 1/nm², (replicas, m)."""
        if self.aging is None or not self.area > 0:
            return np.full((1, 0), np.nan)
        return self.aging.bonds / self.area

    @property
    def bonded_fraction(self) -> np.ndarray:
        """Fraction of the sites that are bonded, (replicas, m)."""
        if self.aging is None:
            return np.full((1, 0), np.nan)
        with np.errstate(invalid="ignore"):
            return self.aging.bonds / self.aging.sites[:, None]

    @cached_property
    def fit(self) -> Fit | None:
        """The line of Δμ against log t over the scene's window, with jackknife errors."""
        try:
            return self.aging.fit(*self.window) if self.aging is not None and self.load > 0 else None
        except InputError:
            return None

    @cached_property
    def interval_fit(self) -> AgingFit | None:
        """The same line with bootstrap intervals over replicas."""
        try:
            return fit_aging(self.aging, window=self.window) if self.aging is not None and self.load > 0 else None
        except InputError:
            return None

    def at(self, curves: np.ndarray, time: float) -> tuple[float, float]:
        """Mean over replicas and standard error of ``curves`` (replicas, m) at ``time`` s, evenly in log t between hold
        times; nan outside them."""
        if self.aging is None or not curves.size:
            return math.nan, math.nan
        t = self.aging.hold_times
        exact = np.flatnonzero(np.abs(t - time) <= 1e-6 * time)
        if exact.size:
            values = curves[:, exact[-1]]
        else:
            after = int(np.searchsorted(t, time))
            if not 0 < after < t.size or t[after - 1] <= 0:
                return math.nan, math.nan
            part = math.log(time / t[after - 1]) / math.log(t[after] / t[after - 1])
            values = curves[:, after - 1] * (1 - part) + curves[:, after] * part
        error = float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else math.nan
        return float(values.mean()), error

    def last(self) -> float:
        """The last hold time, s; nan without ageing."""
        return float(self.aging.hold_times[-1]) if self.aging is not None else math.nan

    def chemistry(self) -> dict[str, Any]:
        """Everything that decides how sites react, flat: dotted path -> value."""
        if self.aging is None:
            return {}
        if self.scene:
            parts = {name: self.scene[name] for name in _CHEMICAL if name in self.scene}
        else:
            whole = dict(self.aging.provenance.get("chemistry", {}))
            parts = {name: whole.pop(name, None) for name in ("forming", "breaking", "interaction")}
            parts["chemistry"] = whole
        return dict(_flat({**parts, "temperature": self.aging.temperature}))

    def elsewhere(self) -> dict[str, Any]:
        """The rest of the scene, flat: surface, contact, engine, hold and fit."""
        left = {name: part for name, part in self.scene.items() if name not in (*_CHEMICAL, "name", "title", "observe")}
        return {path: value for path, value in _flat(left) if path != "hold.temperature"}


def _pressures(contact: ContactSolution) -> tuple[np.ndarray, np.ndarray] | None:
    return contact.pressure_histogram(bins=min(50, max(5, contact.sites.size // 20))) if contact.sites.size else None


def _flat(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}.")
        elif value is not None:
            yield path, value


def load_results(files: Sequence[str | Path]) -> list[Result]:
    """Read result files; each is named by its file name, or by its path where two file names are equal.

    The folder of a sweep stands for its finished points, ``FOLDER/3`` for one of them.

    Raises
    ------
    InputError
        A file is given twice, holds nothing that can be compared, or there are more than ``MOST`` results.
    StoreError
        A file is missing or damaged.
    """
    found = [one for file in files for one in _sources(Path(file))]
    if len(found) > MOST:
        raise InputError(
            f"{len(found)} results are too many to lay side by side; give at most {MOST}, "
            "of a sweep single points such as FOLDER/0"
        )
    places = [place for _, place, _ in found]
    for _, place, _ in found:
        if sum(os.path.realpath(place) == os.path.realpath(other) for other in places) > 1:
            raise InputError(f"{place} is given twice; give each file once")
    names = Counter(name for name, _, _ in found)
    results = []
    for name, place, load in found:
        one = Result.of(load(False), name if names[name] == 1 else place, place)
        results.append(replace(one, whole=partial(load, True)))
    return results


#: results that a comparison takes
MOST = 32


def _sources(path: Path) -> list[tuple[str, str, Callable[[bool], Any]]]:
    """(name, place, reader) of a result file or a point of a sweep, or of every finished point of a sweep."""
    if (path / "sweep.json").is_file() or ((path.parent / "sweep.json").is_file() and path.name.isdecimal()):
        from chemage.sweeps import load_sweep

        if not path.name.isdecimal() or (path / "sweep.json").is_file():
            done = [index for index, state in enumerate(load_sweep(path).states()) if state == "done"]
            if not done:
                raise InputError(f"{path}: no point of this sweep is finished; `chemage status {path}` tells more")
            return [one for index in done for one in _sources(path / str(index))]
        name = f"{path.parent.resolve().name}/{path.name}"
        return [(name, str(path), partial(_point, path.parent, int(path.name)))]
    return [(path.stem, str(path), partial(_file, path))]


def _file(path: Path, whole: bool) -> Any:
    from chemage import store
    from chemage.runs import Run

    if not whole and path.is_file() and store.is_ours(path):
        parts, attributes = store.read_parts(path, only={"contact", "aging"})
        if "scene" in attributes and parts:
            return Run.from_parts(parts, attributes)
        if len(parts) == 1:
            return next(iter(parts.values()))
    return store.read(path)


def _point(folder: Path, index: int, whole: bool) -> Any:
    from chemage.runs import Run
    from chemage.sweeps import load_sweep

    sweep = load_sweep(folder)
    if index >= len(sweep):
        raise InputError(f"{folder} has {len(sweep)} points, from {folder}/0 on; there is no {folder}/{index}")
    point = sweep[index]
    scene, summary = point.scene(), point.summary
    return Run(
        scene.todict(),
        point.contact(),
        aging=point.aging() if summary["hold_times"] else None,
        timings=summary["timings"],
        versions=summary["versions"],
        keys=scene.keys(),
        cite=tuple(scene.cite()),
    )


# -- several ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """A field that is not the same everywhere; ``values`` in the order of the results, None where it is absent."""

    path: str
    values: tuple[Any, ...]


def _differences(flats: Sequence[Mapping[str, Any]]) -> list[Difference]:
    paths = dict.fromkeys(path for flat in flats for path in flat)
    found = [Difference(path, tuple(flat.get(path) for flat in flats)) for path in paths]
    return [one for one in found if not all(_same(one.values[0], value) for value in one.values[1:])]


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, float | int) and isinstance(b, float | int) and not isinstance(a, bool):
        return math.isclose(a, b, rel_tol=1e-9)
    return a == b


@dataclass(frozen=True)
class Comparison:
    """Several results side by side, and measurements to hold against them."""

    results: list[Result]
    measured: list[Measurements] = field(default_factory=list)
    #: hold times to compare at, s, besides the last of each
    times: tuple[float, ...] = TIMES

    def chemistry_differences(self) -> list[Difference]:
        """The fields by which the chemistry differs, among the results that react; none: it is the same."""
        return _differences([one.chemistry() for one in self.results if one.aging is not None])

    def other_differences(self) -> list[Difference]:
        """Everything else that differs between the scenes; of different kinds, not the options that only some have."""
        found = _differences([one.elsewhere() for one in self.results if one.scene])
        other_kinds = {one.path.removesuffix("kind") for one in found if one.path.endswith(".kind")}
        return [one for one in found if None not in one.values or not one.path.startswith(tuple(other_kinds))]

    def statement(self) -> str:
        """One sentence on whether the chemistry is the same."""
        reacting = [one.name for one in self.results if one.aging is not None]
        if len(reacting) < 2:
            return "Chemistry: nothing to compare, fewer than two of the results were aged."
        different = self.chemistry_differences()
        if not different:
            return "Chemistry: the same in all results."
        return f"Chemistry: differs in {', '.join(one.path for one in different)}."

    def table(self) -> list[tuple[str, list[str]]]:
        """(quantity, text of each result), for printing."""
        rows: list[tuple[str, Callable[[Result], str]]] = [
            ("scene", lambda one: str(one.scene.get("name", "")) or "-"),
            ("surface, solver", _made_of),
            ("load", lambda one: _text(one.load, "nN")),
            ("contact area A", lambda one: _text(one.area, "nm²")),
            ("area fraction A/A0", lambda one: _text(one.contact.get("area_fraction", math.nan))),
            ("patches", lambda one: _text(one.contact.get("patches", math.nan))),
            ("perimeter to area C/A", lambda one: _text(one.contact.get("perimeter_to_area", math.nan), "1/nm")),
            ("mean contact pressure", lambda one: _text(one.contact.get("mean_contact_pressure", math.nan), "GPa")),
            ("sites", lambda one: _text(one.sites)),
            ("replicas", lambda one: str(one.aging.replicas) if one.aging else "-"),
        ]
        for label, unit, curves in _CURVES:
            for time in self.times:
                rows.append((f"{label} at {time:g} s", _row_at(curves, unit, time)))
            rows.append((f"{label} at the last hold time", _row_at(curves, unit, None)))
        rows += [
            ("last hold time", lambda one: _text(one.last(), "s")),
            ("fit window", lambda one: f"{one.window[0]:g} to {one.window[1]:g} s" if one.aging else "-"),
            ("β, ± jackknife error", lambda one: plus_minus(f.beta, f.beta_stderr) if (f := one.fit) else "-"),
            ("β, 95 % bootstrap interval", lambda one: f.beta_text() if (f := one.interval_fit) else "-"),
            (
                "cut-off time, ± jackknife error",
                lambda one: plus_minus(f.cutoff_time, f.cutoff_time_stderr, "s") if (f := one.fit) else "-",
            ),
            ("cut-off time, 95 % interval", lambda one: f.cutoff_text() if (f := one.interval_fit) else "-"),
        ]
        return [(label, [tell(one) for one in self.results]) for label, tell in rows]

    def numbers(self) -> list[dict[str, Any]]:
        """One JSON-able object a result."""
        from chemage.runs import jsonable

        return [jsonable(self._numbers(one)) for one in self.results]

    def _numbers(self, one: Result) -> dict[str, Any]:
        fit, interval = one.fit, one.interval_fit
        at = []
        for time in (*self.times, one.last()):
            entry: dict[str, Any] = {"time": time}
            for name, (_, _, curves) in zip(_CURVE_NAMES, _CURVES, strict=True):
                entry[name], entry[f"{name}_stderr"] = one.at(curves(one), time)
            at.append(entry)
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
            "replicas": one.aging.replicas if one.aging else 0,
            "fit_window": list(one.window),
            "beta": fit.beta if fit else None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "beta_interval": [interval.beta_interval.low, interval.beta_interval.high] if interval else None,
            "cutoff_time": fit.cutoff_time if fit else None,
            "cutoff_time_stderr": fit.cutoff_time_stderr if fit else None,
            "cutoff_time_interval": [interval.cutoff_interval.low, interval.cutoff_interval.high] if interval else None,
            "at": at,
        }

    def todict(self) -> dict[str, Any]:
        """The whole comparison as one JSON-able object."""
        from chemage.runs import jsonable

        def told(differences: list[Difference]) -> list[dict[str, Any]]:
            return [{"field": one.path, "values": jsonable(list(one.values))} for one in differences]

        different = self.chemistry_differences()
        return {
            "results": self.numbers(),
            "same_chemistry": not different if sum(one.aging is not None for one in self.results) > 1 else None,
            "chemistry_differences": told(different),
            "other_differences": told(self.other_differences()),
            "fits": [{"data": name, **fit.todict()} for name, fit in self.fits()],
        }

    def csv(self) -> str:
        """The comparison as CSV, one line a result; units are in the header."""
        units = {"load": "nN", "area": "nm^2", "perimeter_to_area": "1/nm", "mean_contact_pressure": "GPa"}
        units |= {"cutoff_time": "s", "cutoff_time_stderr": "s", "cutoff_time_low": "s", "cutoff_time_high": "s"}
        units |= {"friction_drop": "nN", "bonds_per_area": "1/nm^2", "fit_start": "s", "fit_stop": "s", "last": "s"}
        lines = []
        for numbers in self.numbers():
            line: dict[str, Any] = {}
            at, window = numbers.pop("at"), numbers.pop("fit_window")
            for name in ("beta", "cutoff_time"):
                low, high = numbers.pop(f"{name}_interval") or (None, None)
                numbers |= {f"{name}_low": low, f"{name}_high": high}
            numbers |= {"fit_start": window[0], "fit_stop": window[1], "last": at[-1]["time"]}
            for name, value in numbers.items():
                line[f"{name} ({units[name]})" if name in units else name] = value
            for entry, label in zip(at, (*(f"{time:g} s" for time in self.times), "last"), strict=True):
                for name in (key for key in entry if key != "time"):
                    unit = units.get(name.removesuffix("_stderr"))
                    line[f"{name} at {label}" + (f" ({unit})" if unit else "")] = entry[name]
            lines.append(line)
        text = io.StringIO()
        writer = csv.DictWriter(text, list(lines[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
        return text.getvalue()

    def fits(self) -> list[tuple[str, AgingFit]]:
        """Both models fitted to each set of measurements, and to each result over the same hold times."""
        found = []
        for data in self.measured:
            for model in ("line", "curve"):
                fit = self._measured_fit(data, model)
                if fit is None:
                    continue
                found.append((data.name, fit))
                positive = data.hold_times[data.hold_times > 0]
                window = fit.window or (float(positive.min()), float(positive.max()))
                for one in self.results:
                    if (same := _simulated_fit(one, model, window, data.quantity)) is not None:
                        found.append((one.name, same))
        return found

    def _measured_fit(self, data: Measurements, model: Model) -> AgingFit | None:
        # the line over the results' own window where the measurements fill it, else over all of them
        windows = [self.results[0].window, None] if model == "line" else [None]
        for window in windows:
            try:
                return fit_aging(data, model=model, window=window)
            except InputError:
                continue
        return None

    def figures(self) -> dict[str, Figure]:
        """Every figure there is something to show for, by name."""
        made = {
            "friction-drop": friction_drop_figure(self),
            "friction-coefficient-drop": friction_coefficient_figure(self),
            "bonds-per-area": bonds_figure(self.results),
            "pressures": pressures_figure(self.results),
            "barriers": barriers_figure(self.results),
        }
        return {name: figure for name, figure in made.items() if figure is not None}

    def save(self, folder: Path, *, force: bool = False, suffix: str = "png") -> list[Path]:
        """Write the figures into ``folder``; existing files are kept unless ``force``."""
        from chemage import plots

        return plots.save_figures(self.figures(), folder, force=force, suffix=suffix)


def _simulated_fit(one: Result, model: Model, window: tuple[float, float], quantity: Quantity) -> AgingFit | None:
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
    """Put result files side by side, with CSV files of measurements to hold against them.

    Parameters
    ----------
    files
        Runs, or ageing or contacts alone, as :func:`chemage.write` and ``chemage run`` make them.
    measured
        See :func:`chemage.measured.read_measurements`.
    times
        Hold times to compare at (s, or strings with units), besides the last.
    """
    from chemage.measured import read_measurements
    from chemage.units import convert

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


def _made_of(one: Result) -> str:
    kinds = [one.scene.get(name, {}).get("kind", "") for name in ("surface", "contact")]
    return ", ".join(kind for kind in kinds if kind) or "-"


Curves = Callable[[Result], np.ndarray]


def _row_at(curves: Curves, unit: str, time: float | None) -> Callable[[Result], str]:
    def tell(one: Result) -> str:
        mean, error = one.at(curves(one), one.last() if time is None else time)
        return plus_minus(mean, error, unit) if math.isfinite(mean) else "-"

    return tell


def _friction(one: Result) -> np.ndarray:
    return one.aging.friction_drop if one.aging is not None else np.full((1, 0), np.nan)


def _coefficient(one: Result) -> np.ndarray:
    return one.aging.friction_coefficient_drop if one.aging is not None else np.full((1, 0), np.nan)


_CURVES: list[tuple[str, str, Curves]] = [
    ("friction drop ΔF", "nN", _friction),
    ("friction coefficient drop Δμ", "", _coefficient),
    ("bonds per contact area", "1/nm²", lambda one: one.bonds_per_area),
    ("fraction of sites bonded", "", lambda one: one.bonded_fraction),
]
_CURVE_NAMES = ("friction_drop", "friction_coefficient_drop", "bonds_per_area", "bonded_fraction")


# -- figures ----------------------------------------------------------------------------------------------------------

_SPECTRUM = {"barrier_edges", "barriers_start", "barriers_open"}
_MARKERS = "osD^vP*X"
#: inches; small, so that the letters can be read on a phone
_SIZE = (4.9, 3.6)


def _styles(count: int) -> list[dict[str, Any]]:
    """Colour and marker of each curve, so that neither alone tells them apart."""
    from itertools import islice

    from chemage.plots import colours

    found = list(islice(colours(), count))
    return [{"color": colour, "marker": _MARKERS[i % len(_MARKERS)]} for i, colour in enumerate(found)]


def _drawn(axes: Axes, results: Sequence[Result], curves: Curves) -> list[float]:
    """Mean and standard error of each result against hold time; the last value of each that was drawn."""
    from chemage.plots import plain

    last = []
    for one, style in zip(results, _styles(len(results)), strict=True):
        values = curves(one)
        if one.aging is None or not values.size or not np.isfinite(values).any():
            continue
        t, mean = one.aging.hold_times, values.mean(axis=0)
        error = values.std(axis=0, ddof=1) / math.sqrt(len(values)) if len(values) > 1 else np.zeros(t.size)
        shown = t > 0
        axes.errorbar(t[shown], mean[shown], yerr=error[shown], ms=3.5, lw=1, capsize=2, label=plain(one.name), **style)
        last.append(float(mean[-1]))
    return last


def _scaled(axes: Axes, last: Sequence[float]) -> None:
    """Logarithmic where the curves end more than a decade apart."""
    positive = [value for value in last if value > 0]
    if positive and max(positive) > 10 * min(positive):
        lowest = min(positive) / 300
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], lowest))
    else:
        axes.set_ylim(bottom=0)


def _against_time(results: Sequence[Result], curves: Curves, label: str) -> tuple[Figure, Axes, list[float]]:
    from chemage.plots import blank

    figure, axes = blank(*_SIZE)
    last = _drawn(axes, results, curves)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel=label)
    return figure, axes, last


def _finish(figure: Figure, axes: Axes, last: Sequence[float]) -> Figure:
    _scaled(axes, last)
    axes.legend(frameon=False, fontsize=8)
    return figure


def _overlay(axes: Axes, comparison: Comparison, quantity: Quantity) -> None:
    from chemage.plots import BLACK, plain

    loads = {one.load for one in comparison.results}
    load = loads.pop() if len(loads) == 1 else None
    for number, original in enumerate(comparison.measured):
        data = original.as_quantity(quantity, load)
        if data is None:
            continue
        shown = data.hold_times > 0
        axes.errorbar(
            data.hold_times[shown],
            data.values[shown],
            yerr=None if data.error is None else data.error[shown],
            fmt="sDo^v"[number % 5],
            mfc="none",
            color=BLACK,
            ms=5,
            lw=1,
            capsize=2,
            label=plain(f"{data.name} (measured)"),
        )
        fit = comparison._measured_fit(data, "curve")
        if fit is not None and math.isfinite(fit.cutoff_time):
            line = np.geomspace(data.hold_times[shown].min(), data.hold_times[shown].max(), 100)
            label = plain(f"{data.name}: β = {fit.beta_text()}")
            axes.plot(line, fit(line), color=BLACK, lw=1, ls=("--", ":", "-.")[number % 3], label=label)


def _fitted_line(axes: Axes, one: Result) -> None:
    from chemage.plots import GREY

    fit = one.fit
    if fit is None or not (math.isfinite(fit.beta) and math.isfinite(fit.cutoff_time)):
        return
    line = np.geomspace(*one.window, 50)
    label = f"β = {plus_minus(fit.beta, fit.beta_stderr)} per decade"
    axes.plot(line, fit.beta * np.log10(line / fit.cutoff_time), color=GREY, lw=2.5, alpha=0.7, zorder=1, label=label)


def friction_drop_figure(comparison: Comparison) -> Figure | None:
    """ΔF against hold time; measurements of ΔF, or of Δμ where all results have one load, on top."""
    if not any(one.aging for one in comparison.results):
        return None
    figure, axes, last = _against_time(comparison.results, _friction, f"friction drop {SYMBOL['friction_drop']} (nN)")
    _overlay(axes, comparison, "friction_drop")
    return _finish(figure, axes, last)


def friction_coefficient_figure(comparison: Comparison) -> Figure | None:
    """Δμ against hold time, with measurements on top."""
    if not any(one.aging and one.load > 0 for one in comparison.results):
        return None
    label = f"friction coefficient drop {SYMBOL['friction_coefficient_drop']}"
    figure, axes, last = _against_time(comparison.results, _coefficient, label)
    if len(comparison.results) == 1:
        _fitted_line(axes, comparison.results[0])
    _overlay(axes, comparison, "friction_coefficient_drop")
    return _finish(figure, axes, last)


def bonds_figure(results: Sequence[Result]) -> Figure | None:
    """Bonds per contact area against hold time."""
    if not any(np.isfinite(one.bonds_per_area).any() for one in results):
        return None
    figure, axes, last = _against_time(results, lambda one: one.bonds_per_area, "bonds per contact area (1/nm²)")
    return _finish(figure, axes, last)


def pressures_figure(results: Sequence[Result]) -> Figure | None:
    """Distribution of the pressure over each contact."""
    from chemage.plots import blank, plain

    shown = [(one, style) for one, style in zip(results, _styles(len(results)), strict=True) if one.pressure]
    if not shown:
        return None
    figure, axes = blank(*_SIZE)
    for one, style in shown:
        assert one.pressure is not None
        edges, density = one.pressure
        axes.stairs(density, edges, color=style["color"], lw=1.4, label=plain(one.name))
        axes.plot(
            0.5 * (edges[1:] + edges[:-1]), density, ls="none", markevery=max(1, density.size // 8), ms=3.5, **style
        )
    axes.set(xlabel="contact pressure (GPa)", ylabel="density over the contact (1/GPa)", xlim=(0, None), ylim=(0, None))
    axes.legend(frameon=False, fontsize=8)
    return figure


def barriers_figure(results: Sequence[Result]) -> Figure | None:
    """Forming barriers before any bond formed and, dashed, those open at the end; of results that observed them."""
    from chemage.plots import blank, plain

    shown = [
        (one, one.aging.observables, style)
        for one, style in zip(results, _styles(len(results)), strict=True)
        if one.aging is not None
        and {"barrier_edges", "barriers_start", "barriers_open"} <= one.aging.observables.keys()
    ]
    if not shown:
        return None
    figure, axes = blank(*_SIZE)
    limits = []
    for one, seen, style in shown:
        edges = seen["barrier_edges"][0]
        for name, dashes, label in (
            ("barriers_start", "-", plain(one.name)),
            ("barriers_open", "--", plain(f"{one.name}, open after {one.last():g} s")),
        ):
            density = seen[name].mean(axis=0)
            axes.stairs(density, edges, color=style["color"], lw=1.3, ls=dashes, label=label)
            filled = np.flatnonzero(density > density.max() * 1e-3)
            if filled.size:
                limits += [edges[filled[0]], edges[filled[-1] + 1]]
    axes.set(xlabel="barrier to forming a bond (eV)", ylabel="density per site (1/eV)", ylim=(0, None))
    if limits:
        axes.set_xlim(min(limits) - 0.05, max(limits) + 0.05)
    axes.legend(frameon=False, fontsize=7)
    return figure
