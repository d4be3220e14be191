"""The table of a sweep with one row per point: in memory, as CSV, as HDF5, for pandas and for xarray."""

from __future__ import annotations

import io
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from chemage.ageing.ageing import ELASTIC_MEASURES
from chemage.ageing.fitting import DROPS, FIT
from chemage.contacts.solution import FLOW_MEASURES, MEASURES
from chemage.foundation.container import seal
from chemage.foundation.errors import optional_module
from chemage.foundation.files import write_file
from chemage.foundation.quantities import HOLD_TIME, Declared, Quantity, headed
from chemage.foundation.text import csv_text
from chemage.studies.sweeps.grid import Axis, shown

if TYPE_CHECKING:
    import pandas
    import xarray

_COUNTS = (
    Quantity("sites", "1", "sites", "", "reactive sites, mean over replicas"),
    Quantity("replicas", "1", "replicas"),
    Quantity("events", "1", "events", "", "bonds formed and broken, all replicas"),
)
_EVERY = (
    *MEASURES.values(),
    *FLOW_MEASURES.values(),
    *_COUNTS,
    *FIT,
    *ELASTIC_MEASURES.values(),
)
#: scalar results of a point: name in the summary -> (unit, meaning)
SCALARS = {
    name: (unit, meaning) for one in _EVERY for name, unit, meaning in one.columns()
}
#: curves of a point: name in the summary -> (unit, meaning)
CURVES = {
    name: (unit, meaning)
    for one in DROPS.values()
    for name, unit, meaning in one.columns()
}
#: what is written on axes and in headings: name -> quantity or curve
DECLARED: dict[str, Declared] = {
    one.name: one
    for one in (HOLD_TIME, *MEASURES.values(), *DROPS.values(), *_EVERY)
}
#: those of SCALARS that only repeat a field of the scene; where that is swept, it has their place in the dataset
GIVEN = {
    "load",
    "nominal_pressure",
    "modulus",
    "replicas",
    "hardness",
    "shear_strength",
    "work_of_adhesion",
}
#: dimensions, values, attributes
Variable = tuple[tuple[str, ...], np.ndarray, dict[str, str]]
#: texts of a point: name in the summary -> what they say
MARKS = {
    "beta_reason": "why beta was not fitted",
    "approximate": "what is approximate",
    "plugins": "plugins that took part",
}
#: what is listed of an output of an observable: suffix of the column -> (key in the summary, meaning)
PARTS = {
    "": ("mean", ""),
    "_stderr": ("stderr", "standard error"),
    "_half_width": ("half_width", "half the width of the 95 % interval"),
}


#: names that the dataset of a sweep has anyway, beside those of the results
RESERVED = (
    "point",
    "status",
    "error",
    *MARKS,
    "hold_time",
    "hold_times",
    "replica",
    "bonds",
)


@dataclass(frozen=True)
class Dimension:
    """The dimension of one axis; lines that vary together share one."""

    #: name of one of the fields, see :func:`dimensions`
    name: str
    #: swept path -> name of its coordinate
    coordinates: Mapping[str, str]
    size: int


def short_names(
    paths: Sequence[str],
    taken: Container[str] = (),
    units: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The name of each swept path: its last part (``contact.load`` is ``load``, ``engine.kind`` is ``engine``); loads
    that are given as pressures (``units`` are those of the paths) are ``nominal_pressure``.

    It is all of the path with underscores (``surface_seed``) where two would have one name, or a result has it already
    (``taken``).
    """
    last = {path: last_part(path) for path in paths}
    if "contact.load" in last and (units or {}).get("contact.load") == "GPa":
        last["contact.load"] = "nominal_pressure"
    short = list(last.values())
    names = {}
    for path, name in last.items():
        used = short.count(name) > 1 or name in taken or name in RESERVED
        names[path] = path.replace(".", "_").replace("/", "_") if used else name
    return names


def last_part(path: str) -> str:
    """The last part of a path, without ``kind``."""
    parts = path.split(".")
    return parts[-2] if parts[-1] == "kind" and len(parts) > 1 else parts[-1]


def is_seed(path: str) -> bool:
    """Whether a swept field only chooses random numbers."""
    return path.rpartition(".")[2] == "seed"


def dimensions(
    axes: Sequence[Axis],
    values: Mapping[str, Sequence[Any]],
    taken: Container[str],
    units: Mapping[str, str],
) -> tuple[Dimension, ...]:
    """The dimensions of a sweep with ``axes``, whose paths have ``values`` at the points, in ``units``.

    A dimension has the name of its field; of several that vary together, that of the first whose values all differ and
    that is no seed, if there is one.
    """
    names = short_names(
        [path for axis in axes for path in axis.paths], taken, units
    )
    dims = []
    for axis in axes:

        def repeats(path: str, size: int = len(axis)) -> tuple[bool, bool]:
            distinct = len({str(value) for value in values[path]}) == size
            return not distinct, is_seed(path)

        leading = names[min(axis.paths, key=repeats)]
        coordinates = {path: names[path] for path in axis.paths}
        dims.append(Dimension(leading, coordinates, len(axis)))
    return tuple(dims)


class Column(NamedTuple):
    """A result of every point; nan where there is none."""

    unit: str
    meaning: str
    #: (points,), or (points, times) of a curve
    values: np.ndarray


@dataclass(frozen=True)
class SweepTable:
    """Columns of a sweep; missing values are nan, or -1 for bonds."""

    #: path -> one validated value per point: numbers in internal units, everything else as text
    swept: dict[str, np.ndarray]
    units: dict[str, str]
    #: ``done``, ``failed``, ``missing`` or ``damaged`` for each point
    status: list[str]
    error: list[str]
    #: numbers of the points, the hold times, and curves along these; those of observables are the last
    results: dict[str, Column]
    #: (points, replicas, times), -1 where there is none
    bonds: np.ndarray
    #: on which the points were computed
    processors: tuple[str, ...]
    #: those of MARKS that at least one point has
    marks: dict[str, list[str]]
    #: of the grid, the last varying fastest
    dimensions: tuple[Dimension, ...]
    #: whether every point is a mean over surfaces
    means: bool = False

    @classmethod
    def collect(
        cls,
        swept: Mapping[str, Sequence[Any]],
        units: Mapping[str, str],
        points: Iterable[Mapping[str, Any]],
        axes: Sequence[Axis],
    ) -> SweepTable:
        """Make the table from the files of the points, read one after the other; missing ones have only a status.

        ``axes`` are those of the grid, of which ``swept`` has the values at every point.
        """
        count = len(next(iter(swept.values())))
        status, error, means = ["missing"] * count, [""] * count, False
        marks = {name: [""] * count for name in MARKS}
        results: dict[str, Column] = {}
        bonds = np.zeros((count, 0, 0), dtype=np.int32)
        processors: dict[str, None] = {}

        def add(row: int, summary: Mapping[str, Any]) -> None:
            for name, unit, meaning, value in _numbers(summary):
                numbers = np.array(value, dtype=np.float64)  # None where nan
                column = results.get(name) or Column(
                    unit, meaning, np.full((count, *(0,) * numbers.ndim), np.nan)
                )
                if column.values.ndim == 1 + numbers.ndim:
                    results[name] = column._replace(
                        values=_put(column.values, row, numbers, np.nan)
                    )

        add(0, {"hold_times": []})  # what there is, before any point is done
        for number, point in enumerate(points):
            status[number] = point["status"]
            if point["status"] != "done":
                error[number] = error_text(point.get("error"))
                continue
            summary, means = point["summary"], means or "ensemble" in point
            if processor := summary["versions"].get("processor"):
                processors[processor] = None
            plugins = "; ".join(
                f"{name}: {source}"
                for name, source in summary.get("plugins", {}).items()
            )
            for name, texts in marks.items():
                texts[number] = (
                    plugins if name == "plugins" else summary.get(name) or ""
                )
            add(number, summary)
            counts = np.array(
                point["ageing"]["bonds"] if point["ageing"] else (), ndmin=2
            )
            if counts.size:
                bonds = _put(
                    bonds,
                    number,
                    counts if counts.dtype.kind == "f" else counts.astype(np.int32),
                    -1,
                )
        # limits of the material with which no point was compared, plastic flow where there is none, and what means over
        # surfaces do not have
        optional = (
            SCALARS.keys()
            if means
            else {*ELASTIC_MEASURES, *FLOW_MEASURES} & SCALARS.keys()
        )
        for name in optional:
            if np.isnan(results[name].values).all():
                del results[name]
        longest = results[HOLD_TIME.name].values.shape[1:]
        for name, column in results.items():
            if column.values.ndim > 1:
                results[name] = column._replace(
                    values=_widened(column.values, longest, np.nan)
                )
        return cls(
            swept={path: _column(values) for path, values in swept.items()},
            units=dict(units),
            status=status,
            error=error,
            results=results,
            bonds=_widened(bonds, (0, *longest), -1),
            processors=tuple(processors),
            marks={name: texts for name, texts in marks.items() if any(texts)},
            dimensions=dimensions(axes, swept, {*SCALARS, *CURVES} - GIVEN, units),
            means=means,
        )

    @property
    def points(self) -> int:
        """Number of rows."""
        return len(self.status)

    @property
    def hold_times(self) -> np.ndarray:
        """s, (times,) if equal for all points, else (points, times)."""
        times = self.results[HOLD_TIME.name].values
        done = times[[status == "done" for status in self.status]]
        if not len(done):
            return times[0]
        return done[0] if (done == done[0]).all() else times

    def at_last(self, name: str) -> np.ndarray:
        """(points,) a result; of a curve, or its interval, at the last hold time at which the curve is known."""
        values = self.results[name].values
        if values.ndim == 1:
            return values
        if not values.size:
            return np.full(self.points, np.nan)
        curve = self.results.get(
            name.removesuffix("_half_width"), self.results[name]
        )
        known = np.isfinite(curve.values)
        last = values.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
        return np.where(
            known.any(axis=1), values[np.arange(self.points), last], np.nan
        )

    def numbers(self, last: str) -> dict[str, np.ndarray]:
        """(points,) every result; ``last`` stands before the name of one at the last hold time."""
        return {
            f"{last if column.values.ndim > 1 else ''}{name}": self.at_last(name)
            for name, column in self.results.items()
        }

    def write_csv(self, path: Path) -> None:
        """Write CSV with one line per point: swept fields, scalars, last values of the curves, with units."""
        columns: dict[str, Any] = {
            "point": range(self.points),
            "status": self.status,
        }
        for name, values in self.swept.items():
            unit = self.units.get(name)
            columns[f"{name} ({unit})" if unit else name] = values
        numbers = zip(
            self.numbers("last ").items(), self.results.values(), strict=True
        )
        for (name, values), column in numbers:
            columns[headed(name, column.unit)] = values
        columns |= {name: self.marks[name] for name in sorted(self.marks)}
        columns["error"] = [text.replace("\n", " ") for text in self.error]
        cells = [np.asarray(values).tolist() for values in columns.values()]
        rows = [
            ["" if cell != cell else cell for cell in row]  # nan
            for row in zip(*cells, strict=True)
        ]
        write_file(path, csv_text(columns, rows), force=True)

    def write_hdf5(self, path: Path, attributes: Mapping[str, Any]) -> None:
        """Write NetCDF4 with the dimensions of :meth:`to_xarray`, readable with ``xarray.open_dataset``."""
        import h5netcdf
        import h5py

        # made in memory and written at once: HDF5 crashes the process when the disk fills up under it
        image = io.BytesIO()
        with h5netcdf.File(image, "w") as file:
            file.attrs.update(attributes)
            grid = {dimension.name: dimension.size for dimension in self.dimensions}
            sizes = {
                "hold_time": self.hold_times.shape[-1],
                "replica": self.bonds.shape[1],
            }
            file.dimensions = grid | sizes
            for name, (dims, values, notes) in self.variables().items():
                kind = (
                    h5py.string_dtype() if values.dtype == object else values.dtype
                )
                data = values if values.size else None
                variable = file.create_variable(name, dims, kind, data=data)
                variable.attrs.update(notes)
        write_file(path, seal(image), force=True)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the grid."""
        return tuple(dimension.size for dimension in self.dimensions)

    def along(self, axis: int, values: Sequence[Any] | np.ndarray) -> np.ndarray:
        """Those of ``values`` (points,) along an axis of the grid."""
        return np.moveaxis(np.reshape(values, self.shape), axis, 0).reshape(
            self.shape[axis], -1
        )[:, 0]

    def variables(self) -> dict[str, Variable]:
        """The variables of the dataset by name."""
        dims = tuple(dimension.name for dimension in self.dimensions)
        variables: dict[str, Variable] = {}

        def add(name: str, values: Any, *more: str, **notes: str) -> None:
            array = (
                values
                if isinstance(values, np.ndarray)
                else np.array(values, dtype=object)
            )
            shape = *self.shape, *array.shape[1:]
            variables[name] = (*dims, *more), array.reshape(shape), notes

        for axis, dimension in enumerate(self.dimensions):
            for path, name in dimension.coordinates.items():
                units = self.units.get(path) or "1"
                notes = {"units": units, "long_name": "swept", "path": path}
                values = self.along(axis, self.swept[path])
                variables[name] = (dimension.name,), values, notes
        add("point", np.arange(self.points), long_name="number of the point")
        add("status", self.status, long_name="done, failed, missing or damaged")
        add("error", self.error, long_name="why it failed")
        for name, texts in self.marks.items():
            add(name, texts, long_name=MARKS[name])
        times = {"units": "s", "long_name": "time since the contact was made"}
        if self.hold_times.ndim == 1:
            variables["hold_time"] = ("hold_time",), self.hold_times, times
        else:
            add("hold_times", self.hold_times, "hold_time", **times)
        for name, (unit, meaning, values) in self.results.items():
            if name not in variables and name != HOLD_TIME.name:  # swept, see GIVEN
                along = ("hold_time",)[: values.ndim - 1]
                add(name, values, *along, units=unit, long_name=meaning)
        notes = {"units": "1", "long_name": "bonds; -1 where there are none"}
        add("bonds", self.bonds, "replica", "hold_time", **notes)
        return variables

    def to_pandas(self) -> pandas.DataFrame:
        """A data frame with one row per point, without the curves, which :meth:`to_xarray` includes.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        pandas = optional_module("pandas", "xarray")
        numbers = {
            name: column.values
            for name, column in self.results.items()
            if column.values.ndim == 1
        }
        columns = {"status": self.status, **self.swept, **numbers}
        index = pandas.RangeIndex(self.points, name="point")
        return pandas.DataFrame(
            columns | self.marks | {"error": self.error}, index=index
        )

    def to_xarray(self) -> xarray.Dataset:
        """A dataset with one dimension for each axis of the grid, hold_time and replica; swept fields are coordinates.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        xarray = optional_module("xarray", "xarray")
        variables = self.variables()
        swept = [
            name
            for dimension in self.dimensions
            for name in dimension.coordinates.values()
        ]
        times = [name for name in ("hold_time", "hold_times") if name in variables]
        return xarray.Dataset(variables).set_coords([*swept, "point", *times])


def _numbers(summary: Mapping[str, Any]) -> Iterator[tuple[str, str, str, Any]]:
    """Every number and curve in the summary of a point: name, unit, meaning, value."""
    for name, (unit, meaning) in SCALARS.items():
        yield name, unit, meaning, summary.get(name)
    yield HOLD_TIME.name, HOLD_TIME.unit, HOLD_TIME.label, summary["hold_times"]
    for name, (unit, meaning) in CURVES.items():
        yield name, unit, meaning, summary.get(name, ())
    for name, output in summary.get("observables", {}).items():
        about, unit = output["description"] or name, output["unit"] or "1"
        for suffix, (part, words) in PARTS.items() if "mean" in output else ():
            meaning = f"{about}: {words}" if words else about
            yield f"observable.{name}{suffix}", unit, meaning, output[part]


def _widened(values: np.ndarray, shape: Sequence[int], fill: float) -> np.ndarray:
    """``values`` (points, ...) with at least ``shape`` after the first axis."""
    more = [
        (0, max(0, wanted - there))
        for wanted, there in zip(shape, values.shape[1:], strict=True)
    ]
    if not np.any(more):
        return values
    return np.pad(values, [(0, 0), *more], constant_values=fill)


def _put(
    values: np.ndarray, row: int, numbers: np.ndarray, fill: float
) -> np.ndarray:
    """``values`` (points, ...), made larger as far as it is needed, with ``numbers`` in a row."""
    # methods of ageing may estimate the bonds, which are then no whole numbers
    values = _widened(values, numbers.shape, fill).astype(
        np.result_type(values, numbers), copy=False
    )
    values[(row, *map(slice, numbers.shape))] = numbers
    return values


def error_text(error: Mapping[str, Any] | None) -> str:
    """Format the error of a point as ``stage: type: message``; empty without one."""
    return f"{error['stage']}: {error['type']}: {error['message']}" if error else ""


def _column(values: Sequence[Any]) -> np.ndarray:
    kinds = {type(value) for value in values}
    if kinds == {bool} or kinds == {int}:
        with suppress(OverflowError):
            return np.array(values, dtype=np.int64)
    if kinds <= {int, float}:
        return np.array(values, dtype=np.float64)
    return np.array([shown(value) for value in values], dtype=object)
