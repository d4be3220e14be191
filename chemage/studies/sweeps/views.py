"""Which axes of a sweep are drawn against each other, and the numbers of such a view: means over seeds, with errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage.ageing.fitting import FIT_WINDOW
from chemage.foundation.errors import InputError, UnitError, nearest
from chemage.foundation.quantities import NONE, Rank, headed
from chemage.foundation.statistics import crossed_half_width
from chemage.foundation.text import plus_minus
from chemage.foundation.units import convert
from chemage.studies.ensembles.quantities import Quantities
from chemage.studies.sweeps.grid import Axis, shown
from chemage.studies.sweeps.result import SweepResult
from chemage.studies.sweeps.table import (
    CURVES,
    DECLARED,
    Dimension,
    SweepTable,
    is_seed,
    last_part,
)

#: the axis along a curve
HOLD_TIME = "hold_time"
#: columns of the table of results
_FIRST = [name for name, one in DECLARED.items() if one.rank is Rank.FIRST]
#: what is drawn unless asked otherwise, as far as it is known
_USUAL = ("beta", "friction_drop")
_WITHOUT_AGEING = ("area_fraction",)


@dataclass(frozen=True)
class View:
    """A choice of axes: ``x`` to the right, a line for each value of ``lines``, seeds averaged, others at one value."""

    x: str
    #: None: one line
    lines: str | None
    #: axes that are averaged over
    averaged: tuple[str, ...]
    #: axis -> position of the value that is shown
    fixed: Mapping[str, int]


@dataclass(frozen=True)
class ViewedQuantity:
    """One quantity of a view."""

    name: str
    #: "" for a pure number
    unit: str
    meaning: str
    #: (lines, x), nan where no point is done
    mean: np.ndarray
    #: (lines, x) ends of the 95 % interval, nan where it is not known
    low: np.ndarray
    high: np.ndarray
    #: whether the numbers are those at the last hold time of a curve
    at_last: bool


class SweepData:
    """The table of a sweep as arrays with one dimension per axis."""

    def __init__(self, result: SweepResult) -> None:
        self.name = result.name
        self.table: SweepTable = result.table()
        self.dimensions: dict[str, Dimension] = {
            dimension.name: dimension for dimension in self.table.dimensions
        }
        self.variables = self.table.variables()
        #: coordinates that were written in one unit: name -> values along their dimension, unit
        self._written: dict[str, tuple[np.ndarray, str]] = {}
        for axis, dimension in enumerate(self.table.dimensions):
            for path in dimension.coordinates.keys() & result.written.keys():
                numbers, unit = result.written[path]
                along = self.table.along(axis, numbers)
                self._written[dimension.coordinates[path]] = along, unit
        #: that of the fit, s; None where it is swept
        self._window: tuple[float, float] | None = None
        if not any(path.startswith("fit") for path in self.table.swept):
            fit = dict(zip(("start", "stop"), FIT_WINDOW, strict=True))
            fit |= result.grid.base.get("fit", {})
            self._window = convert(fit["start"], "s"), convert(fit["stop"], "s")

    @property
    def doubt(self) -> str:
        """That β of the points rests on too few hold times; "" where it does not, or the points differ in it."""
        times, window = self.table.hold_times, self._window
        if times.ndim > 1 or window is None or not self._is_known("beta"):
            return ""
        return Quantities(times, 1.0, window, ()).doubt

    def _is_known(self, name: str) -> bool:
        return bool(np.isfinite(self.variables[name][1]).any())

    def axis(self, name: str, option: str) -> str:
        """The dimension called ``name``: its own name, that of a field along it, or the path of a field.

        Raises
        ------
        InputError
            There is none; the message lists the names.
        """
        if name == HOLD_TIME:
            return name
        short = []
        for dim, dimension in self.dimensions.items():
            paths = dimension.coordinates
            if name in (dim, *paths, *paths.values()):
                return dim
            if name in map(last_part, paths):
                short.append(dim)
        if len(short) == 1:
            return short[0]
        names = [*self.dimensions, HOLD_TIME]
        problem = f"is no axis of this sweep{nearest(name, names)}"
        raise InputError.of(
            option, name, problem, f"the axes are {', '.join(names)}"
        )

    def label(self, name: str, option: str) -> str:
        """The name of the coordinate that ``name`` stands for."""
        dim = self.axis(name, option)
        coordinates = {} if dim == HOLD_TIME else self.dimensions[dim].coordinates
        if name not in coordinates.values():
            for path, short in coordinates.items():
                if name in (path, last_part(path)):
                    return short
        return name

    def values(self, name: str) -> np.ndarray:
        """The values of a coordinate along its dimension, in :meth:`unit`; hold times in s."""
        return self._written.get(name, self.variables[name][1:])[0]

    def unit(self, name: str) -> str:
        """The unit of a variable, that in which its values were written if it is one; "" for a pure number."""
        if name in self._written:
            return self._written[name][1]
        unit = self.variables[name][2].get("units", "1")
        return "" if unit == "1" else unit

    def text(self, name: str, place: int) -> str:
        """``name = value unit`` of one position on an axis."""
        return f"{name} = {self.value_text(name, place)} {self.unit(name)}".rstrip()

    def value_text(self, name: str, place: int) -> str:
        """A value of a coordinate as text."""
        value = self.values(name)[place]
        return value if isinstance(value, str) else f"{value:.6g}"

    def is_number(self, name: str) -> bool:
        """Whether a coordinate has numbers."""
        return self.values(name).dtype.kind in "fiu"

    def is_seed(self, dim: str) -> bool:
        """Whether the points along a dimension differ in nothing but seeds."""
        return all(map(is_seed, self.dimensions[dim].coordinates))

    @property
    def names(self) -> list[str]:
        """The names of all results that can be drawn."""
        return [name for name in self.table.results if name != HOLD_TIME]

    def usual(self) -> list[str]:
        """What is drawn unless asked otherwise."""
        return [*filter(self._is_known, _USUAL)] or list(_WITHOUT_AGEING)

    def view(
        self,
        x: str | None,
        lines: str | None,
        where: Mapping[str, str] | None = None,
    ) -> View:
        """Choose the axes that were not given.

        x is the numeric axis with most values, or else hold time; lines the next one. Axes of seeds are averaged over,
        and of further axes the value in the middle is shown.

        Raises
        ------
        InputError
            An axis or a value does not exist.
        """
        fixed = {
            self.axis(name, "--where"): self._place(name, value)
            for name, value in (where or {}).items()
        }
        if lines == HOLD_TIME:
            raise InputError.of("--lines", lines, "can only be --x")
        axes = (x, "--x"), (lines, "--lines")
        asked = [self.axis(name, option) for name, option in axes if name]
        if len(set(asked)) < len(asked):
            raise InputError.of(
                "--lines", lines, "is the axis of --x", "choose another one"
            )
        sizes = {dim: dimension.size for dim, dimension in self.dimensions.items()}
        free = [
            dim
            for dim, size in sizes.items()
            if size > 1 and dim not in (*asked, *fixed)
        ]
        seeds = [dim for dim in free if self.is_seed(dim)]
        free = [dim for dim in free if dim not in seeds]
        free.sort(key=lambda dim: (not self.is_number(dim), -sizes[dim]))
        if x is None:
            x = free.pop(0) if free else HOLD_TIME
        if lines is None and free:
            lines = free.pop(0)
        used = {self.axis(name, "--x") for name in (x, lines) if name}
        middle = {dim: size // 2 for dim, size in sizes.items() if dim not in used}
        rest = {dim: place for dim, place in middle.items() if dim not in seeds}
        named = self.label(lines, "--lines") if lines else None
        return View(self.label(x, "--x"), named, tuple(seeds), rest | fixed)

    def _place(self, name: str, value: str) -> int:
        label = self.label(name, "--where")
        shown, inside = self.values(label), self.variables[label][1]
        unit = self.variables[label][2].get("units", "1")
        texts = [self.value_text(label, place) for place in range(len(shown))]
        if value in texts:
            return texts.index(value)
        # as it was written, in the unit inside, or with a unit
        number = _number(value)
        for values, wanted in (
            (shown, number),
            (inside, number),
            (inside, _number(value, unit)),
        ):
            for place, one in enumerate(values):
                if not isinstance(one, str) and math.isclose(
                    wanted, one, rel_tol=1e-6
                ):
                    return place
        problem = (
            f"is not swept; the values are {', '.join(texts)} {self.unit(label)}"
        )
        raise InputError.of(f"--where {name}", value, problem.rstrip())

    def quantity(self, name: str, view: View) -> ViewedQuantity:
        """The numbers of ``name`` in ``view``.

        Raises
        ------
        InputError
            There is no such result, or it has no hold times and x is the hold time.
        """
        if name not in self.names:
            problem = f"is no result of this sweep{nearest(name, self.names)}"
            raise InputError.of(
                "--y", name, problem, f"the results are {', '.join(self.names)}"
            )
        x = self.axis(view.x, "--x")
        result = self.table.results[name]
        is_curve = result.values.ndim > 1
        if x == HOLD_TIME and not is_curve:
            remedy = f"with --x {HOLD_TIME} choose {', '.join(CURVES)}"
            raise InputError.of("--y", name, "is one number per point", remedy)
        if x == HOLD_TIME and self.table.hold_times.ndim > 1:
            problem = "points have different hold times"
            raise InputError.of("--x", HOLD_TIME, problem, "choose another axis")
        order = [self.axis(view.lines, "--lines"), x] if view.lines else [x]
        numbers = self._estimates(name, view.averaged, order, view.fixed)
        mean, low, high = map(np.atleast_2d, numbers)
        at_last = is_curve and x != HOLD_TIME
        return ViewedQuantity(
            name, self.unit(name), result.meaning, mean, low, high, at_last
        )

    def _estimates(
        self,
        name: str,
        averaged: Sequence[str],
        order: Sequence[str],
        fixed: Mapping[str, int],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The means of a result over axes, or its numbers, and the ends of their 95 % intervals, nan where there are
        none; with the axes in ``order``. Curves are at the last hold time unless this is one of the axes."""
        results, along = self.table.results, HOLD_TIME in order
        axes = [*self.dimensions, *filter(HOLD_TIME.__eq__, order)]
        left = [axis for axis in axes if axis not in fixed]

        def arranged(variable: str) -> np.ndarray:
            values = (
                results[variable].values if along else self.table.at_last(variable)
            )
            values = values.reshape(*self.table.shape, *values.shape[1:])
            values = values[tuple(fixed.get(axis, slice(None)) for axis in axes)]
            return values.transpose(
                [left.index(axis) for axis in (*averaged, *order)]
            )

        mean = arranged(name)
        if averaged:
            # points that share the seed of a surface are not independent
            half = crossed_half_width(mean, len(averaged))
            over, finite = tuple(range(len(averaged))), np.isfinite(mean)
            count = finite.sum(axis=over)
            total = np.where(finite, mean, 0.0).sum(axis=over)
            mean = total / np.where(count > 0, count, np.nan)
        elif f"{name}_low" in results:
            return mean, arranged(f"{name}_low"), arranged(f"{name}_high")
        elif f"{name}_half_width" in results:
            half = arranged(f"{name}_half_width")
        else:
            half = np.full(mean.shape, np.nan)
        return mean, mean - half, mean + half

    def records(self) -> list[dict[str, Any]]:
        """One mapping per point: number, status, error, swept values by path, and the results."""
        table, records = self.table, []
        numbers = table.numbers("last_")
        for row, (status, error) in enumerate(
            zip(table.status, table.error, strict=True)
        ):
            swept = {path: values[row] for path, values in table.swept.items()}
            record = {
                "point": row,
                "status": status,
                "error": error,
                "swept": swept,
            }
            records.append(
                record | {name: values[row] for name, values in numbers.items()}
            )
        return records

    def objects(self) -> list[dict[str, Any]]:
        """:meth:`records` for JSON, each number with value, unit and the ends of its interval."""
        results, found = self.table.results, self.records()
        ends = ("stderr", "half_width", "low", "high")
        parts = {f"{name}_{end}" for name in results for end in ends}
        for record in found:
            for name, column in results.items():
                key = f"last_{name}" if column.values.ndim > 1 else name
                known = [record.get(f"{key}_{end}", math.nan) for end in ends]
                value = record[key]
                low, high = (
                    value + sign * known[1] if math.isnan(end) else end
                    for sign, end in zip((-1, 1), known[2:], strict=True)
                )
                if name not in parts:
                    record[key] = {
                        "value": value,
                        "unit": column.unit,
                        "low": low,
                        "high": high,
                    }
            for name, column in results.items():
                if name in parts:
                    del record[f"last_{name}" if column.values.ndim > 1 else name]
        return found

    def rows(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Headings and lines of a table with β, Δμ and the contact area; one line for the mean over seeds."""
        every = list(self.dimensions)
        dims = [dim for dim in every if not self.is_seed(dim)] or every
        seeds = [dim for dim in every if dim not in dims]
        along = {
            name: number
            for number, dim in enumerate(dims)
            for name in self.dimensions[dim].coordinates.values()
        }
        columns = [*filter(self._is_known, _FIRST)]
        results = [self._estimates(name, seeds, dims, {}) for name in columns]
        over = tuple(map(every.index, seeds))
        done = (self.variables["status"][1] == "done").sum(axis=over)
        uneven = bool(seeds) and np.unique(done[done > 0]).size > 1
        lines = []
        for place in zip(*np.nonzero(done), strict=True):
            texts = [
                self.value_text(name, place[number])
                for name, number in along.items()
            ]
            if uneven:
                texts.append(str(done[place]))
            for mean, low, high in results:
                value, half = (
                    float(mean[place]),
                    0.5 * float(high[place] - low[place]),
                )
                texts.append(
                    plus_minus(value, half) if math.isfinite(value) else NONE
                )
            lines.append(tuple(texts))
        headings = [headed(name, self.unit(name)) for name in along]
        headings += ["seeds"] * uneven
        headings += [
            DECLARED[name].symbol or DECLARED[name].label for name in columns
        ]
        return tuple(headings), lines

    def notes(self) -> list[str]:
        """What to know of :meth:`rows`, in words."""
        sentences, times = [], self.table.hold_times
        seeds = [
            dimension.size
            for dim, dimension in self.dimensions.items()
            if self.is_seed(dim)
        ]
        if seeds and len(seeds) < len(self.dimensions):
            sentences.append(
                f"means over {math.prod(seeds)} seeds with 95 % intervals (Student's t)"
            )
        elif self._is_known("beta"):
            over = "of means over surfaces" if self.table.means else "over replicas"
            sentences.append(f"95 % intervals {over}")
        if times.ndim == 1 and np.isfinite(times).any():
            sentences.append(
                f"Δμ at the last hold time, {np.nanmax(times):g} s; β per decade of hold time"
            )
        if self.doubt:
            sentences.append(self.doubt)
        if approximate := self.table.marks.get("approximate"):
            sentences.append(
                "approximate: "
                + "; ".join(dict.fromkeys(filter(None, approximate)))
            )
        return sentences


def _number(text: str, unit: str = "1") -> float:
    """The number that a text is, in ``unit``; nan for none."""
    try:
        return float(text) if unit == "1" else convert(text, unit)
    except (ValueError, UnitError):
        return math.nan


def swept_rows(axes: Sequence[Axis]) -> list[tuple[str, str]]:
    """What a sweep varies: the name of each axis, and its values."""
    rows = []
    for axis in axes:
        values = [
            "; ".join(shown(value) for value in values) for values in axis.values
        ]
        few = values if len(values) <= 8 else [*values[:6], "...", values[-1]]
        rows.append((axis.name, f"{len(axis)}: {', '.join(few)}"))
    return rows
