"""Several results beside each other and beside measurements: the same quantities, and what differs in their scenes.

Single asperities and rough contacts are compared alike: bonds per contact area and the fraction of bonded sites do not
depend on the size of a contact.
"""

from __future__ import annotations

import math
import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from chemage.ageing.ageing import Ageing
from chemage.ageing.fitting import Fit, Model, fit_ageing
from chemage.ageing.measurements import Measurements, read_table
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError, printable
from chemage.foundation.figures import plain
from chemage.foundation.quantities import (
    NONE,
    Curve,
    Quantity,
    Rank,
    by_name,
    headed,
)
from chemage.foundation.result import TIMES, Comparable, Result, Table, result_of
from chemage.foundation.text import csv_text, jsonable
from chemage.foundation.units import QuantityLike, convert
from chemage.lattices.chemistry import SITE_DENSITY, Chemistry
from chemage.results.first import beside, first_numbers
from chemage.results.kinds import components, is_point, load
from chemage.results.verdicts import COLUMNS, Verdict, between, verdict
from chemage.studies.folder import SweepWarning
from chemage.studies.sweeps.result import in_words, load_sweep

#: the values of a quantity by name
Form = Callable[[Quantity], Mapping[str, Any]]
#: largest number of results in a comparison
MOST = 32
_CHEMICAL = ("forming", "breaking", "interaction", "chemistry", "temperature")


@dataclass(frozen=True)
class Entry:
    """One result beside others: what is compared of it, without its maps."""

    name: str
    source: str
    title: str
    #: what it is of, in words
    facts: Mapping[str, str]
    #: the same for JSON
    plain: Mapping[str, Any]
    #: by name
    quantities: Mapping[str, Quantity]
    curves: Mapping[str, Curve]
    #: the numbers that are shown first, none where all are
    first: Sequence[Quantity]
    #: doubts and faults, in words
    notes: Sequence[str]
    comparable: Comparable
    errors: str
    approximation: str
    #: plugins that took part: name -> source
    plugins: Mapping[str, str]
    scene: Mapping[str, Any]
    components: Sequence[tuple[str, Component]]
    ageing: Ageing | None
    #: reads the result again, maps included
    whole: Callable[[], Result] = field(compare=False, repr=False)

    @classmethod
    def of(
        cls,
        thing: Any,
        name: str = "",
        source: str = "",
        whole: Callable[[], Result] | None = None,
    ) -> Entry:
        """Make an entry of a result of any kind."""
        result = result_of(thing)
        # a kind of result that lays out its own rows and numbers
        own = type(result).rows is not Result.rows
        plain = {
            name: value
            for name, value in result.numbers().items()
            if isinstance(value, int | float | str | None)
        }
        return cls(
            printable(name or result.name),
            printable(source),
            result.title,
            dict(result.rows() if own else result.facts()),
            plain if own else dict(result.facts()),
            by_name(result.quantities()),
            by_name(result.curves()),
            first_numbers(result),
            [f"approximate: {result.approximation}"] * bool(result.approximation)
            + result.notes(),
            result.comparable(),
            result.errors,
            result.approximation,
            dict(result.plugins),
            result.scene,
            components(result),
            result.made_by().get("ageing"),
            whole or (lambda: result),
        )

    @property
    def legend_name(self) -> str:
        """The name, marked where the result is approximate, as a matplotlib label."""
        return plain(
            f"{self.name} (approximate)" if self.approximation else self.name
        )

    @property
    def ages(self) -> bool:
        """Whether it has a chemistry, and with it curves against hold time."""
        return bool(self.comparable.chemistry)

    @property
    def last(self) -> float:
        """The last hold time, s; nan without any."""
        return next(
            (
                float(one.x[-1])
                for one in self.curves.values()
                if not one.is_distribution
            ),
            math.nan,
        )

    def at(self, name: str, time: float | None) -> Quantity | None:
        """A curve at ``time`` (s), or at its last hold time."""
        curve = self.curves.get(name)
        if curve is None:
            return None
        return curve.last() if time is None else curve.at(time)

    def numbers(self, each: Form) -> dict[str, Any]:
        """Facts and quantities by name."""
        numbers = {"name": self.name, "file": self.source, **self.plain}
        for one in self.quantities.values():
            numbers |= each(one)
            if one.reason and not one.known:
                numbers[f"{one.name}_reason"] = one.reason
        return numbers

    def chemistry(self) -> dict[str, Any]:
        """The fields that determine the kinetics of the sites: dotted path -> value."""
        if not self.ages:
            return {}
        parts = self.comparable.chemistry
        own = {
            name: value
            for name, value in parts.get("chemistry", {}).items()
            if name not in Chemistry.limits
        }
        # results from before there was a choice
        return dict(
            _flat({**parts, "chemistry": {"site_density": SITE_DENSITY, **own}})
        )

    def elsewhere(self) -> dict[str, Any]:
        """The other fields of the scene (surface, contact, engine, hold and fit): dotted path -> value."""
        left = {
            name: part
            for name, part in self.scene.items()
            if name not in (*_CHEMICAL, "name", "title", "observe")
        }
        limits = {
            name: self.scene.get("chemistry", {}).get(name)
            for name in Chemistry.limits
        }
        return {
            path: value
            for path, value in _flat({**left, "chemistry": limits})
            if path != "hold.temperature"
        }


@dataclass(frozen=True)
class Comparison:
    """Several results, and measurements to compare with them."""

    results: list[Entry]
    measured: list[Measurements] = field(default_factory=list)
    #: hold times at which results are compared, s, besides the last of each
    times: tuple[float, ...] = TIMES

    @property
    def has_several_errors(self) -> bool:
        """Whether the errors of the results have different meanings, so that it must be said what each contains."""
        return len({result.errors for result in self.results}) > 1

    def errors_in_words(self) -> str:
        """What the errors of the results are."""
        names: dict[str, list[str]] = {}
        for entry in self.results:
            names.setdefault(entry.errors, []).append(entry.name)
        every = [
            (f" of {', '.join(of)}" if len(names) > 1 else "", text)
            for text, of in names.items()
            if text
        ]
        return " ".join(f"Errors{of} are {text}." for of, text in every)

    def chemistry_differences(self) -> dict[str, tuple[Any, ...]]:
        """The fields in which the chemistry of the aged results differs, each with its values in the order of the
        results, None where it is absent; empty if it is the same."""
        return _differences(
            [result.chemistry() for result in self.results if result.ages]
        )

    def other_differences(self) -> dict[str, tuple[Any, ...]]:
        """The other fields in which the scenes differ, without options that exist for one kind only.

        A section that only some of the scenes have appears with its kind.
        """
        fields = _differences(
            [result.elsewhere() for result in self.results if result.scene]
        )
        other_kinds = tuple(
            path.removesuffix("kind") for path in fields if path.endswith(".kind")
        )
        return {
            path: values
            for path, values in fields.items()
            if None not in values
            or path.endswith(".kind")
            or not path.startswith(other_kinds)
        }

    def statement(self) -> str:
        """State in one sentence whether the chemistry is the same."""
        reacting = [result.name for result in self.results if result.ages]
        if len(reacting) < 2:
            return "Chemistry: nothing to compare; fewer than two of the results were aged."
        different = self.chemistry_differences()
        if not different:
            return "Chemistry: the same in all results."
        return f"Chemistry: differs in {', '.join(different)}."

    @property
    def has_first(self) -> bool:
        """Whether there are numbers of every result that are shown first."""
        return all(each.first for each in self.results)

    def first(self) -> list[tuple[str, list[str]]]:
        """The rows that are shown first: (quantity, text of each result)."""
        several = beside([each.first for each in self.results])
        return [in_a_row(one) for one in several]

    def table(self) -> list[tuple[str, list[str]]]:
        """The rows of the whole table: (quantity, text of each result)."""
        labels = _joined(result.facts for result in self.results)
        rows = [
            (label, [result.facts.get(label, NONE) for result in self.results])
            for label in labels
        ]
        for moment, several in self._numbers():
            label, texts = in_a_row(several)
            if moment:
                label = moment
                texts = [NONE if one is None else one.text() for one in several]
            if any(
                one is not None
                and one.rank < Rank.REST
                and (one.known or one.reason)
                for one in several
            ):
                rows.append((label, texts))
            causes = _joined(one.errors for one in several if one is not None)
            for cause in causes:
                parts = [
                    {}
                    if one is None
                    else {name: size for name, size, _ in one.parts()}
                    for one in several
                ]
                rows.append(
                    (
                        f"error of {label}: {cause}",
                        [each.get(cause, NONE) for each in parts],
                    )
                )
        if any(result.errors for result in self.results):
            rows.append(
                ("every ± is", [result.errors or NONE for result in self.results])
            )
        if any(result.approximation for result in self.results):
            rows.append(
                (
                    "approximate",
                    [result.approximation or NONE for result in self.results],
                )
            )
        if any(result.plugins for result in self.results):
            texts = [
                ", ".join(result.plugins.values()) or NONE
                for result in self.results
            ]
            rows.append(("plugins that took part", texts))
        return rows

    def _numbers(self) -> Iterator[tuple[str, list[Quantity | None]]]:
        """The numbers of all results: of curves at every time, with what each is, then quantities with ""."""
        for name in self._curve_names():
            for time in (*self.times, None):
                several = [result.at(name, time) for result in self.results]
                (title, *_) = [
                    result.curves[name].title
                    for result in self.results
                    if name in result.curves
                ]
                yield (
                    f"{title} at {'the last hold time' if time is None else f'{time:g} s'}",
                    several,
                )
        for name in _joined(result.quantities for result in self.results):
            yield "", [result.quantities.get(name) for result in self.results]

    def _curve_names(self) -> list[str]:
        """The curves against hold time of any result."""
        return _joined(
            [
                name
                for name, curve in result.curves.items()
                if not curve.is_distribution
            ]
            for result in self.results
        )

    def numbers(self, each: Form = Quantity.numbers) -> list[dict[str, Any]]:
        """The results as plain JSON values, one object each, all with the same names; ``each`` gives those of a
        quantity."""
        found = [result.numbers(each) for result in self.results]
        every = dict.fromkeys(_joined(found))
        any_approximate = any(result.approximation for result in self.results)
        objects = []
        for result, numbers in zip(self.results, found, strict=True):
            one = every | numbers
            if any_approximate:
                one["approximate"] = result.approximation
            objects.append(jsonable(one | self._at(result, each)))
        return objects

    def _at(self, result: Entry, each: Form) -> dict[str, Any]:
        names, moments = self._curve_names(), []
        for time in (*self.times, None):
            at = result.last if time is None else time
            moment = dict(each(Quantity("time", "s", "hold time", value=at)))
            for name in names:
                one = result.at(name, time)
                (like, *_) = [
                    each.curves[name]
                    for each in self.results
                    if name in each.curves
                ]
                moment |= each(like.number() if one is None else one)
            moments.append(moment)
        return {"plugins": dict(result.plugins), "at": moments}

    def todict(self) -> dict[str, Any]:
        """The whole comparison as plain JSON values."""

        def listed(differences: dict[str, tuple[Any, ...]]) -> list[dict[str, Any]]:
            return [
                {"field": path, "values": jsonable(list(values))}
                for path, values in differences.items()
            ]

        different = self.chemistry_differences()
        return {
            "results": self.numbers(_in_full),
            "same_chemistry": not different
            if sum(result.ages for result in self.results) > 1
            else None,
            "chemistry_differences": listed(different),
            "other_differences": listed(self.other_differences()),
            "verdicts": [each.todict() for each in self.verdicts()],
            "fits": [{"data": name, **fit.todict()} for name, fit in self.fits()],
            "not_fitted": [
                {"data": name, "model": model, "reason": reason}
                for name, model, reason in self.not_fitted()
            ],
        }

    def csv(self) -> str:
        """The comparison as CSV with one line per result and units in the header."""
        declared = [
            one
            for result in self.results
            for one in (*result.quantities.values(), *result.curves.values())
        ]
        units = {name: unit for one in declared for name, unit, _ in one.columns()}
        whens = (
            [*(f"{time:g} s" for time in self.times), "last"]
            if self._curve_names()
            else []
        )
        lines = []
        for numbers in self.numbers():
            moments = numbers.pop("at")
            numbers["plugins"] = "; ".join(
                f"{name}: {source}" for name, source in numbers["plugins"].items()
            )
            line = {
                headed(name, units.get(name, "")): value
                for name, value in numbers.items()
            }
            for when, moment in zip(whens, moments, strict=bool(whens)):
                line[f"time, {when} (s)"] = moment.pop("time")
                line |= {
                    headed(f"{name} at {when}", units[name]): value
                    for name, value in moment.items()
                }
            lines.append(line)
        return csv_text(
            lines[0], [[line.get(name) for name in lines[0]] for line in lines]
        )

    def tables(self) -> list[Table]:
        """How measurements and results differ, and the same fits to both."""
        tables: list[Table] = []
        if verdicts := self.verdicts():
            notes = dict.fromkeys(
                f"note: {data.name}: {note}"
                for data in self.measured
                for note in data.notes
            )
            rows = [each.row() for each in verdicts]
            title = "Data = offset + slope × model"
            tables.append(
                Table(title, COLUMNS, rows, remarks=list(notes), in_detail=False)
            )
            tables += [each.table() for each in verdicts if each.values.size]
        if fits := self.fits():
            columns = (
                "data",
                "model",
                "β per decade",
                "b per e-fold",
                "cut-off time",
            )
            rows = [(name, fit.describe(), *fit.texts()) for name, fit in fits]
            tables.append(
                Table("Fits, 95 % intervals", columns, rows, in_detail=False)
            )
        if left_out := self.not_fitted():
            tables.append(
                Table(
                    "Fits that cannot be made",
                    ("data", "model", "reason"),
                    left_out,
                )
            )
        return tables

    def verdicts(self) -> list[Verdict]:
        """Each measured curve beside each result, and each other result beside the first: offset, slope, χ², residuals,
        and what they mean."""
        first, *others = self.results
        return [
            verdict(data, entry.name, entry.comparable, entry.curves)
            for data in self.measured
            for entry in self.results
        ] + [between(first, entry) for entry in others if entry.ages and first.ages]

    def fits(self) -> list[tuple[str, Fit]]:
        """Fit both models to each set of measurements, and to each result over the same hold times: (name, fit)."""
        return [
            (name, fit) for name, _, fit in self._fits() if isinstance(fit, Fit)
        ]

    def not_fitted(self) -> list[tuple[str, str, str]]:
        """The fits of :meth:`fits` that cannot be made: (name, model in words, reason)."""
        words = {"line": "β log10(t/t_c)", "curve": "β log10(1 + t/t_c)"}
        return [
            (name, words[model], reason)
            for name, model, reason in self._fits()
            if isinstance(reason, str)
        ]

    def _fits(self) -> Iterator[tuple[str, Model, Fit | str]]:
        """Each fit, or the reason why there is none: (name, model, fit or reason)."""
        models: tuple[Model, Model] = ("line", "curve")
        for data in self.measured:
            for model in models:
                fit = self.measured_fit(data, model)
                yield data.name, model, fit
                if isinstance(fit, str):
                    continue
                positive = data.hold_times[data.hold_times > 0]
                window = fit.window or (
                    float(positive.min()),
                    float(positive.max()),
                )
                for result in self.results:
                    if result.comparable.fit is not None:
                        yield (
                            result.name,
                            model,
                            result.comparable.fit(model, window, data.quantity),
                        )

    def measured_fit(self, data: Measurements, model: Model) -> Fit | str:
        """Fit a model to measurements, or say why it cannot be fitted."""
        # the line over the window of the results if it contains enough measurements, else over all of them
        reason = ""
        windows: list[tuple[float, float] | None] = [None]
        if model == "line":
            windows.insert(0, self.results[0].comparable.window)
        for window in windows:
            try:
                return fit_ageing(data, model=model, window=window)
            except InputError as error:
                reason = str(error)
        return reason


def compare_files(
    files: Sequence[str | Path],
    *,
    measured: Sequence[str | Path] = (),
    times: Sequence[QuantityLike] = TIMES,
    offset: QuantityLike | None = None,
    sheet: str | None = None,
) -> Comparison:
    """Compare result files with each other and with measurements.

    Parameters
    ----------
    files
        Files of results of any kind, as written by :func:`chemage.write` and ``chemage run``, and folders of sweeps: of
        all completed points, or ``FOLDER/3`` of one of them.
    measured
        Files (or data frames) of measurements, see :func:`chemage.plugin.read_table`.
    times
        Hold times at which to compare, s or strings with units, besides the last.
    offset, sheet
        Of the measurements, as for :func:`chemage.plugin.read_table`.

    Raises
    ------
    InputError
        There are no files or too many, a file is given twice or holds no result, or a time is not valid.
    StoreError
        A file is missing or damaged.
    """
    if not files:
        raise InputError("there is nothing to compare; give result files")
    seconds = tuple(convert(time, "s") for time in times)
    for time, value in zip(times, seconds, strict=True):
        if not (math.isfinite(value) and value > 0):
            raise InputError.of(
                "times",
                time,
                "must be above zero and finite",
                'give times such as "1e3 s"',
            )
    every = [
        (path, curve)
        for path in measured
        for curve in read_table(path, offset=offset, sheet=sheet)
    ]
    repeated = Counter(curve.name for _, curve in every)
    data = [
        curve
        if repeated[curve.name] == 1
        else replace(curve, name=f"{path}, {curve.name}")
        for path, curve in every
    ]
    return Comparison(_entries(files), data, seconds)


def _entries(files: Sequence[str | Path]) -> list[Entry]:
    """Read results; each has the name of its file, or its path if two names are equal."""
    places = [place for file in files for place in _places(Path(file))]
    if len(places) > MOST:
        raise InputError(
            f"{len(places)} results are too many to compare; give at most {MOST}, "
            "or single points of a sweep, such as FOLDER/0"
        )
    real = [os.path.realpath(place) for place in places]
    for place, path in zip(places, real, strict=True):
        if real.count(path) > 1:
            raise InputError(f"{place} is given twice; give each file once")
    names = [
        f"{path.parent.resolve().name}/{path.name}" if is_point(path) else path.stem
        for path in places
    ]
    entries = []
    for name, place in zip(names, places, strict=True):
        own = name if names.count(name) == 1 else str(place)
        # one file at a time: the maps of a large run take 100 MB
        result = load(place, maps=False)
        entries.append(Entry.of(result, own, str(place), partial(load, place)))
    return entries


def _places(path: Path) -> list[Path]:
    """The file, or the completed points of a sweep."""
    if not (path / "sweep.json").is_file():
        return [path]
    states = load_sweep(path).states()
    done = [index for index, state in enumerate(states) if state == "done"]
    left = in_words(Counter(states))
    if not done:
        raise InputError(
            f"{path}: no point of this sweep is complete ({left}); see `chemage status {path}`"
        )
    if left:
        text = f"{path}: {len(done)} of {len(states)} points are complete and compared ({left})"
        warnings.warn(text, SweepWarning, stacklevel=5)
    return [path / str(index) for index in done]


def _in_full(one: Quantity) -> dict[str, Any]:
    """A number for JSON."""
    return {one.name: one.todict()}


def _joined(lists: Iterable[Iterable[str]]) -> list[str]:
    """Every name once, in an order that keeps that of each list as far as possible."""
    order: list[str] = []
    for names in lists:
        place = 0
        for name in names:
            if name not in order:
                order.insert(place, name)
            place = order.index(name) + 1
    return order


def in_a_row(several: Sequence[Quantity | None]) -> tuple[str, list[str]]:
    """What one number of several results is, and its texts; each says at which hold time, where they differ."""
    known = [one for one in several if one is not None]
    labels = {one.row()[0] for one in known}
    texts = [NONE if one is None else one.text() for one in several]
    if len(labels) == 1:
        return labels.pop(), texts
    return known[0].title, [
        f"{text} {one.of}" if one is not None and one.of.startswith("at ") else text
        for text, one in zip(texts, several, strict=True)
    ]


def _differences(flats: Sequence[Mapping[str, Any]]) -> dict[str, tuple[Any, ...]]:
    """Find the fields that differ between flat mappings of dotted path -> value."""
    paths = dict.fromkeys(path for flat in flats for path in flat)
    different = {}
    for path in paths:
        first, *others = values = tuple(flat.get(path) for flat in flats)
        if not all(_same(first, other) for other in others):
            different[path] = values
    return different


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, float | int) and isinstance(b, float | int):
        return math.isclose(a, b, rel_tol=1e-9)
    return a == b


def _flat(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}.")
        elif value is not None:
            yield path, value
