"""The table of a sweep with one row per point: in memory, as CSV, as HDF5, for pandas and for xarray."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.aging import ELASTIC_MEASURES
from chemage.ageing.fitting import DROPS, FIT, LN10
from chemage.contacts.solution import FLOW_MEASURES, MEASURES
from chemage.foundation.container import seal
from chemage.foundation.errors import optional_module
from chemage.foundation.files import write_file
from chemage.foundation.quantities import HOLD_TIME, Declared, Quantity, headed
from chemage.studies.sweeps.grid import Axis, shown

if TYPE_CHECKING:
    import pandas
    import xarray

_COUNTS = (
    Quantity("sites", "1", "sites", "", "reactive sites, mean over replicas"),
    Quantity("replicas", "1", "replicas"),
    Quantity("events", "1", "events", "", "bonds formed and broken, all replicas"),
)
_EVERY = (*MEASURES.values(), *FLOW_MEASURES.values(), *_COUNTS, *FIT, *ELASTIC_MEASURES.values())
#: scalar results of a point: name in the summary -> (unit, meaning)
SCALARS = {name: (unit, meaning) for one in _EVERY for name, unit, meaning in one.columns()}
#: curves of a point: name in the summary -> (unit, meaning)
CURVES = {name: (unit, meaning) for one in DROPS.values() for name, unit, meaning in one.columns()}
#: what is written on axes and in headings: name -> quantity or curve
DECLARED: dict[str, Declared] = {one.name: one for one in (HOLD_TIME, *MEASURES.values(), *DROPS.values(), *_EVERY)}
#: those of SCALARS that only repeat a field of the scene; where that is swept, it has their place in the dataset
GIVEN = {"load", "nominal_pressure", "modulus", "replicas", "hardness", "shear_strength", "work_of_adhesion"}
#: dimensions, values, attributes
Variable = tuple[tuple[str, ...], np.ndarray, dict[str, str]]
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
    "approximate",
    "beta_reason",
    "plugins",
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
    paths: Sequence[str], taken: Container[str] = (), units: Mapping[str, str] | None = None
) -> dict[str, str]:
    """The name of each swept path: its last part (``contact.load`` is ``load``, ``engine.kind`` is ``engine``); loads
    that are given as pressures (``units`` are those of the paths) are ``nominal_pressure``.

    It is all of the path with underscores (``surface_seed``) where two would have one name, or a result has it already
    (``taken``).
    """
    last = {path: last_part(path) for path in paths}
    if units is not None and units.get("contact.load") == "GPa" and "contact.load" in last:
        last["contact.load"] = "nominal_pressure"
    names = {}
    for path, name in last.items():
        clear = list(last.values()).count(name) == 1 and name not in taken and name not in RESERVED
        names[path] = name if clear else path.replace(".", "_").replace("/", "_")
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
    taken: Container[str] = (),
    units: Mapping[str, str] | None = None,
) -> tuple[Dimension, ...]:
    """The dimensions of a sweep with ``axes``, whose paths have ``values`` at the points, in ``units``.

    A dimension has the name of its field; of several that vary together, that of the first whose values all differ and
    that is no seed, if there is one.
    """
    names = short_names([path for axis in axes for path in axis.paths], taken, units)
    dims = []
    for axis in axes:
        distinct = [path for path in axis.paths if len({str(value) for value in values[path]}) == len(axis)]
        fields = [path for path in distinct if not is_seed(path)]
        leading = [*fields, *distinct, *axis.paths][0]
        dims.append(Dimension(names[leading], {path: names[path] for path in axis.paths}, len(axis)))
    return tuple(dims)


@dataclass(frozen=True)
class SweepTable:
    """Columns of a sweep; missing values are nan, or -1 for bonds."""

    #: path -> one validated value per point: numbers in internal units, everything else as text
    swept: dict[str, np.ndarray]
    units: dict[str, str]
    #: ``done``, ``failed``, ``missing`` or ``damaged`` for each point
    status: list[str]
    error: list[str]
    #: (points,) each
    scalars: dict[str, np.ndarray]
    #: s, (times,) if equal for all points, else (points, times)
    hold_times: np.ndarray
    #: (points, times) each
    curves: dict[str, np.ndarray]
    #: (points, replicas, times), -1 where there is none
    bonds: np.ndarray
    #: on which the points were computed
    processors: tuple[str, ...] = ()
    #: numbers and curves of observables: column -> (unit, meaning, values), (points,) or (points, times)
    observed: dict[str, tuple[str, str, np.ndarray]] = field(default_factory=dict)
    #: what is approximate about each point, in words; empty if no point is approximate
    approximate: list[str] = field(default_factory=list)
    #: why beta of each point was not fitted, in words; empty if every one was
    beta_reason: list[str] = field(default_factory=list)
    #: the plugins that took part in each point, with their versions; empty if there are none
    plugins: list[str] = field(default_factory=list)
    #: of the grid, the last varying fastest; empty: the points are no grid
    dimensions: tuple[Dimension, ...] = ()
    #: whether every point is a mean over surfaces
    means: bool = False

    @classmethod
    def collect(
        cls,
        swept: Mapping[str, Sequence[Any]],
        units: Mapping[str, str],
        points: Iterable[Mapping[str, Any]],
        axes: Sequence[Axis] = (),
    ) -> SweepTable:
        """Make the table from the files of the points, read one after the other; missing ones have only a status.

        ``axes`` are those of the grid, of which ``swept`` has the values at every point.
        """
        count = len(next(iter(swept.values())))
        status, error, approximate = ["missing"] * count, [""] * count, [""] * count
        reasons, plugins = [""] * count, [""] * count
        scalars = {name: np.full(count, np.nan) for name in SCALARS}
        rows: dict[int, tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]] = {}
        processors: dict[str, None] = {}
        means = False
        observables: dict[int, Mapping[str, Any]] = {}
        for number, point in enumerate(points):
            status[number] = point["status"]
            if point["status"] != "done":
                error[number] = error_text(point.get("error"))
                continue
            summary, means = point["summary"], means or "ensemble" in point
            if processor := summary["versions"].get("processor"):
                processors[processor] = None
            observables[number] = summary.get("observables", {})
            approximate[number] = summary.get("approximate", "")
            reasons[number] = summary.get("beta_reason") or ""
            plugins[number] = "; ".join(f"{name}: {source}" for name, source in summary.get("plugins", {}).items())
            summary = _with_b(summary)
            for name, column in scalars.items():
                if (value := summary.get(name)) is not None:
                    column[number] = value
            # points written before there was such a number
            missing = np.full(len(summary["hold_times"]), np.nan)
            curves = {name: np.array(summary.get(name, missing), dtype=np.float64) for name in CURVES}
            bonds = _counts(point["aging"]["bonds"] if point["aging"] else [])
            rows[number] = (np.array(summary["hold_times"], dtype=np.float64), curves, bonds)
        return cls(
            swept={path: _column(values) for path, values in swept.items()},
            units=dict(units),
            status=status,
            error=error,
            scalars={name: column for name, column in scalars.items() if not _unknown(name, column, means)},
            means=means,
            processors=tuple(processors),
            **(padded := _padded(count, rows)),
            observed=_observed(count, padded["curves"], observables),
            approximate=approximate if any(approximate) else [],
            beta_reason=reasons if any(reasons) else [],
            plugins=plugins if any(plugins) else [],
            dimensions=dimensions(axes, swept, {*SCALARS, *CURVES} - GIVEN, units),
        )

    @property
    def points(self) -> int:
        """Number of rows."""
        return len(self.status)

    def write_csv(self, path: Path) -> None:
        """Write CSV with one line per point: swept fields, scalars, last values of the curves, with units."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        names = [
            f"{path} ({unit})" if unit else path for path, unit in ((p, self.units.get(p, "")) for p in self.swept)
        ]
        scalars = [headed(name, SCALARS[name][0]) for name in self.scalars]
        last = {"hold_time": _last(self.hold_times, self.hold_times)}
        last |= {name: _last(values, value_of(name, self.curves)) for name, values in self.curves.items()}
        lasts = ["last hold_time (s)"] + [headed(f"last {name}", unit) for name, (unit, _) in CURVES.items()]
        seen = {name: values for name, (_, _, values) in self.observed.items()}
        observed = {
            headed(f"{'last ' * (values.ndim == 2)}{name}", unit): _last(values, value_of(name, seen))
            if values.ndim == 2
            else values
            for name, (unit, _, values) in self.observed.items()
        }
        marked = [name for name in ("approximate", "beta_reason", "plugins") if getattr(self, name)]
        writer.writerow(["point", "status", *names, *scalars, *lasts, *observed, *marked, "error"])
        for row in range(self.points):
            done = self.status[row] == "done"
            times = last["hold_time"] if self.hold_times.ndim == 2 else np.broadcast_to(last["hold_time"], self.points)
            numbers = [values[row] for values in self.scalars.values()]
            numbers += [times[row] if done else math.nan, *(last[name][row] for name in CURVES)]
            numbers += [values[row] for values in observed.values()]
            writer.writerow(
                [
                    row,
                    self.status[row],
                    *(_cell(values[row]) for values in self.swept.values()),
                    *(_cell(number) for number in numbers),
                    *self.approximate[row : row + 1],
                    *self.beta_reason[row : row + 1],
                    *self.plugins[row : row + 1],
                    self.error[row].replace("\n", " "),
                ]
            )
        write_file(path, text.getvalue(), force=True)

    def write_hdf5(self, path: Path, attributes: Mapping[str, Any]) -> None:
        """Write NetCDF4 with the dimensions of :meth:`to_xarray`, readable with ``xarray.open_dataset``."""
        import h5netcdf
        import h5py

        text = h5py.string_dtype()
        # made in memory and written at once: HDF5 crashes the process when the disk fills up under it
        image = io.BytesIO()
        with h5netcdf.File(image, "w") as file:
            for name, value in attributes.items():
                file.attrs[name] = value
            file.dimensions = {
                **self._grid(),
                "hold_time": self.hold_times.shape[-1],
                "replica": self.bonds.shape[1],
            }
            for name, (dims, values, notes) in self.variables().items():
                kind = text if values.dtype == object else values.dtype
                empty = 0 in values.shape
                variable = file.create_variable(name, dims, kind, data=None if empty else values)
                for key, note in notes.items():
                    variable.attrs[key] = note
        write_file(path, seal(image), force=True)

    def _grid(self) -> dict[str, int]:
        """The dimensions of the grid and their lengths."""
        return {dimension.name: dimension.size for dimension in self.dimensions} or {"point": self.points}

    def variables(self) -> dict[str, Variable]:
        """The variables of the dataset by name."""
        grid = self._grid()
        dims, shape = tuple(grid), tuple(grid.values())

        def of_points(values: Any, *more: str, **notes: str) -> Variable:
            array = values if isinstance(values, np.ndarray) else np.array(values, dtype=object)
            return (*dims, *more), array.reshape(*shape, *array.shape[1:]), notes

        variables: dict[str, Variable] = {}
        for axis, dimension in enumerate(self.dimensions):
            first = tuple(slice(None) if place == axis else 0 for place in range(len(shape)))
            for path, name in dimension.coordinates.items():
                along = self.swept[path].reshape(shape)[first]
                notes = {"units": self.units.get(path) or "1", "long_name": "swept", "path": path}
                variables[name] = ((dimension.name,), along, notes)
        if not self.dimensions:
            for path, values in self.swept.items():
                variables[path] = of_points(values, units=self.units.get(path) or "1", long_name="swept")
        variables["point"] = of_points(np.arange(self.points), long_name="number of the point")
        variables["status"] = of_points(self.status, long_name="done, failed, missing or damaged")
        variables["error"] = of_points(self.error, long_name="why it failed")
        if self.beta_reason:
            variables["beta_reason"] = of_points(self.beta_reason, long_name="why beta was not fitted")
        if self.approximate:
            variables["approximate"] = of_points(self.approximate, long_name="what is approximate")
        if self.plugins:
            variables["plugins"] = of_points(self.plugins, long_name="plugins that took part")
        times = {"units": "s", "long_name": "time since the contact was made"}
        if self.hold_times.ndim == 1:
            variables["hold_time"] = (("hold_time",), self.hold_times, times)
        else:
            variables["hold_times"] = of_points(self.hold_times, "hold_time", **times)
        for name, values in self.scalars.items():
            if name in variables:  # swept, see GIVEN
                continue
            variables[name] = of_points(values, units=SCALARS[name][0], long_name=SCALARS[name][1])
        for name, values in self.curves.items():
            variables[name] = of_points(values, "hold_time", units=CURVES[name][0], long_name=CURVES[name][1])
        for name, (unit, meaning, values) in self.observed.items():
            variables[name] = of_points(values, *("hold_time",)[: values.ndim - 1], units=unit, long_name=meaning)
        variables["bonds"] = of_points(
            self.bonds, "replica", "hold_time", units="1", long_name="bonds; -1 where there are none"
        )
        return variables

    def to_pandas(self) -> pandas.DataFrame:
        """A data frame with one row per point, without the curves, which :meth:`to_xarray` includes.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        pandas = optional_module("pandas", "xarray")
        observed = {name: values for name, (_, _, values) in self.observed.items() if values.ndim == 1}
        marked = {name: getattr(self, name) for name in ("approximate", "plugins") if getattr(self, name)}
        columns: dict[str, Any] = {"status": self.status, **self.swept, **self.scalars, **observed, **marked}
        columns["error"] = self.error
        return pandas.DataFrame(columns, index=pandas.RangeIndex(self.points, name="point"))

    def to_xarray(self) -> xarray.Dataset:
        """A dataset with one dimension for each axis of the grid, hold_time and replica; swept fields are coordinates.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        xarray = optional_module("xarray", "xarray")
        variables = self.variables()
        swept = [name for dimension in self.dimensions for name in dimension.coordinates.values()] or list(self.swept)
        times = [name for name in ("hold_time", "hold_times") if name in variables]
        return xarray.Dataset(variables).set_coords([*swept, "point", *times])


def _with_b(summary: Mapping[str, Any]) -> Mapping[str, Any]:
    """The summary of a point with b, also of one that was written before there was b beside beta."""
    if "b" in summary:
        return summary
    parts = {name: summary.get(f"beta{name[1:]}") for name in ("b", "b_stderr", "b_half_width")}
    return {**summary, **{name: None if value is None else value / LN10 for name, value in parts.items()}}


def _counts(bonds: Sequence[Any]) -> np.ndarray:
    counts = np.array(bonds, ndmin=2)
    return counts if counts.size and counts.dtype.kind == "f" else counts.astype(np.int32)


def error_text(error: Mapping[str, Any] | None) -> str:
    """Format the error of a point as ``stage: type: message``; empty without one."""
    return f"{error['stage']}: {error['type']}: {error['message']}" if error else ""


def _unknown(name: str, column: np.ndarray, means: bool) -> bool:
    """Whether a column is left out: of a limit of the material with which no point was compared, of plastic flow where
    there is none, or of what means over surfaces do not have."""
    optional = name in ELASTIC_MEASURES or name in FLOW_MEASURES
    return (means or optional) and bool(np.isnan(column).all())


def _column(values: Sequence[Any]) -> np.ndarray:
    if all(isinstance(value, bool) for value in values):
        return np.array([int(value) for value in values])
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        limits = np.iinfo(np.int64)
        if all(limits.min <= value <= limits.max for value in values):
            return np.array(values, dtype=np.int64)
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=np.float64)
    return np.array([shown(value) for value in values], dtype=object)


def _padded(count: int, rows: Mapping[int, tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]]) -> dict[str, Any]:
    longest = max((times.size for times, _, _ in rows.values()), default=0)
    replicas = max((bonds.shape[0] for _, _, bonds in rows.values() if bonds.size), default=0)
    curves = {name: np.full((count, longest), np.nan) for name in CURVES}
    # methods of ageing may estimate the bonds, which are then no whole numbers
    kind = np.result_type(np.int32, *(bonds.dtype for _, _, bonds in rows.values()))
    times, bonds = np.full((count, longest), np.nan), np.full((count, replicas, longest), -1, dtype=kind)
    for number, (own, values, counts) in rows.items():
        times[number, : own.size] = own
        for name, curve in values.items():
            curves[name][number, : curve.size] = curve
        if counts.size:
            bonds[number, : counts.shape[0], : counts.shape[1]] = counts
    numbers = list(rows)
    if numbers and all(np.array_equal(times[number], times[numbers[0]]) for number in numbers):
        times = times[numbers[0]]
    elif not numbers:
        times = times[0]
    return {"hold_times": times, "curves": curves, "bonds": bonds}


def _observed(
    count: int, curves: Mapping[str, np.ndarray], points: Mapping[int, Mapping[str, Any]]
) -> dict[str, tuple[str, str, np.ndarray]]:
    """The columns of the numbers and curves that observables measured; ``points`` are their summaries."""
    longest = next(iter(curves.values())).shape[1]
    columns: dict[str, tuple[str, str, np.ndarray]] = {}
    for number, outputs in points.items():
        for name, output in outputs.items():
            if "mean" not in output:
                continue
            shape = (count, longest) if output["shape"] else (count,)
            for suffix, (part, meaning) in PARTS.items():
                text = f"{output['description'] or name}{meaning and ': '}{meaning}"
                new = (output["unit"] or "1", text, np.full(shape, np.nan))
                values = columns.setdefault(f"observable.{name}{suffix}", new)[2]
                numbers = np.array(output[part], dtype=np.float64)  # None where nan
                if values.ndim == 1 + numbers.ndim:
                    values[(number, slice(numbers.size)) if numbers.ndim else number] = numbers
    return columns


def value_of(name: str, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """The curve that ``name`` is, or is the interval of."""
    return values.get(name.removesuffix("_half_width"), values[name])


def _last(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    """The number of each row at the last place where ``like`` is finite, nan where there is none."""
    if values.shape[-1] == 0:
        return np.full(values.shape[:-1], np.nan)
    rows, finite = np.atleast_2d(values), np.isfinite(np.atleast_2d(like))
    last = np.full(rows.shape[0], np.nan)
    for number, row in enumerate(rows):
        there = row[finite[number]]
        if there.size:
            last[number] = there[-1]
    return last if values.ndim == 2 else last[0]


def _cell(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return value if isinstance(value, str | int) else json.dumps(value)
