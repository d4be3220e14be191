"""The results of a sweep, read from its folder at any time; and those that several processes computed, collected."""

from __future__ import annotations

import json
import shutil
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from chemage.ageing.ageing import Ageing
from chemage.contacts.solution import ContactSolution
from chemage.foundation.codec import from_json
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.units import in_one_unit
from chemage.scene.run import Run
from chemage.scene.scene import Scene
from chemage.studies.ensembles.ensemble import Ensemble
from chemage.studies.folder import FORMAT, Folder, SweepWarning
from chemage.studies.sweeps.grid import PLACE, Axis, Grid, listed, remedies
from chemage.studies.sweeps.table import SweepTable, error_text

if TYPE_CHECKING:
    import pandas
    import xarray


T = TypeVar("T")


@dataclass(frozen=True)
class Point:
    """One point of a sweep, read from the folder when its results are used."""

    result: SweepResult
    index: int

    @property
    def changes(self) -> dict[str, Any]:
        """The changes of this point to the scene: dotted path -> value, as written in ``[sweep]``."""
        return self.result.grid.changes(self.index)

    @property
    def values(self) -> dict[str, Any]:
        """The validated changes of this point: dotted path -> value, numbers in internal units."""
        return {
            path: column[self.index] for path, column in self.result.swept.items()
        }

    @property
    def key(self) -> str:
        """Content hash of everything on which the result depends."""
        return self.result.keys[self.index]

    @cached_property
    def _content(self) -> dict[str, Any]:
        return self.result.store.read_point(self.key)

    @property
    def status(self) -> str:
        """``done``, ``failed``, ``missing`` or ``damaged``."""
        return self._content["status"]

    @property
    def error(self) -> str:
        """Stage, type and message of the error of a point that failed; empty otherwise."""
        return error_text(self._content.get("error"))

    @property
    def summary(self) -> dict[str, Any]:
        """The summary of the run, see :meth:`chemage.Run.summary`.

        Raises
        ------
        StoreError
            The point failed or is missing.
        """
        if self.status != "done":
            raise StoreError(
                f"point {self.index} of {self.result.folder} is {self.status}{self.error and ': '}{self.error}"
            )
        return self._content["summary"]

    def scene(self) -> Scene:
        """The validated scene of this point."""
        return self.result.grid.scene(self.index)

    def ensemble(self) -> Ensemble:
        """The mean over surfaces, where every point of the sweep is one.

        Raises
        ------
        StoreError
            The point failed or is missing, or it is one surface.
        """
        return from_json(Ensemble, self._of(means=True)["ensemble"])

    def ageing(self) -> Ageing:
        """The ageing curve, with the bonds of every replica.

        Raises
        ------
        StoreError
            The point failed or is missing, or its scene stops at the contact.
        """
        content = self._of(means=False)
        if not content["summary"]["hold_times"]:
            raise StoreError(
                f"point {self.index} of {self.result.folder} has no ageing: its scene stops at the contact"
            )
        return from_json(Ageing, content["ageing"])

    def contact(self) -> ContactSolution:
        """The contact of this point.

        Raises
        ------
        StoreError
            It is not in the folder, or it is damaged.
        """
        self._of(means=False)
        contact = self.result.store.read_contact(
            self.result.contact_key(self.index)
        )
        if contact is None:
            raise StoreError(
                f"the contact of point {self.index} is not in {self.result.folder}"
            )
        return contact

    def _of(self, *, means: bool) -> dict[str, Any]:
        """What the folder has of a point that is done, and is a mean or is not."""
        self.summary  # noqa: B018
        if self.result.means != means:
            is_other = (
                "is one surface, and no mean; use run()"
                if means
                else "is a mean over surfaces; use ensemble()"
            )
            raise StoreError(
                f"point {self.index} of {self.result.folder} {is_other}"
            )
        return self._content

    def run(self) -> Run:
        """This point as a run, without its surface.

        Raises
        ------
        StoreError
            The point failed or is missing, or its contact is not in the folder.
        """
        scene, summary = self.scene(), self.summary
        return Run(
            scene.todict(),
            self.contact(),
            ageing=self.ageing() if summary["hold_times"] else None,
            timings=summary["timings"],
            versions=summary["versions"],
            keys=summary["keys"],
            cite=tuple(summary["cite"]),
        )

    def __repr__(self) -> str:
        return f"<Point {self.index}: {listed(self.changes)}>"


#: the states of points that are not done
NOT_DONE = ("failed", "missing", "damaged")


def count(states: Sequence[str]) -> dict[str, int]:
    """How many points there are, and are in each state."""
    return {
        "points": len(states),
        **{state: states.count(state) for state in ("done", *NOT_DONE)},
    }


def in_words(counts: Mapping[str, int]) -> str:
    """How many points are not done, by state, such as ``2 failed, 1 damaged``; empty where all are done."""
    return ", ".join(
        f"{counts[state]} {state}" for state in NOT_DONE if counts[state]
    )


class SweepResult:
    """The results of a sweep, complete or not: a sequence of :class:`Point`."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.store = Folder(self.folder)
        self._manifest = self.store.read_manifest()
        self.grid = Grid.fromdict(self._manifest["grid"])
        self.keys: list[str] = self._manifest["keys"]

    @property
    def name(self) -> str:
        """Name of the scene."""
        return str(self.grid.base.get("name", "scene"))

    @property
    def digest(self) -> str:
        """Content hash of the whole sweep."""
        return self._manifest["digest"]

    @property
    def versions(self) -> dict[str, str]:
        """The versions of chemage and its plugins that made the folder."""
        return self._manifest["versions"]

    @property
    def means(self) -> bool:
        """Whether every point is a mean over surfaces, see :meth:`Point.ensemble`."""
        return bool(self._manifest.get("means", False))

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of the grid; the last varies fastest."""
        return self.grid.axes

    @cached_property
    def swept(self) -> dict[str, list[Any]]:
        """The swept fields: dotted path -> validated value at every point, numbers in internal units."""
        columns = {}
        for number, (axis, resolved) in enumerate(
            zip(self.axes, self._manifest["resolved"], strict=True)
        ):
            for values, path in zip(
                zip(*resolved, strict=True), axis.paths, strict=True
            ):
                columns[path] = self._at_points(number, values)
        return columns

    def _at_points(self, axis: int, values: Sequence[T]) -> list[T]:
        """The values along an axis, at every point."""
        return [
            values[self.grid.positions(point)[axis]] for point in range(len(self))
        ]

    @property
    def units(self) -> dict[str, str]:
        """The units of :attr:`swept`: dotted path -> unit, empty for numbers without a unit."""
        return self._manifest["units"]

    @cached_property
    def written(self) -> dict[str, tuple[list[float], str]]:
        """Those of :attr:`swept` that were all written in one unit: dotted path -> numbers at the points, unit."""
        columns = {}
        for number, axis in enumerate(self.axes):
            for path, values in zip(
                axis.paths, zip(*axis.values, strict=True), strict=True
            ):
                if (
                    self.units.get(path)
                    and (common := in_one_unit(list(values))) is not None
                ):
                    columns[path] = self._at_points(number, common[0]), common[1]
        return columns

    def contact_key(self, point: int) -> str:
        """Content hash of the contact of ``point``."""
        return self._manifest["contacts"][self._manifest["contact_of"][point]]

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: int) -> Point:
        if not -len(self) <= index < len(self):
            raise IndexError(f"point {index} of a sweep of {len(self)}")
        return Point(self, index % len(self))

    def __iter__(self) -> Iterator[Point]:
        return (Point(self, index) for index in range(len(self)))

    def where(self, values: Mapping[str, Any]) -> list[Point]:
        """Find the points with the given values: dotted path -> value, as written in ``[sweep]`` or as validated.

        Raises
        ------
        InputError
            A path is not swept.
        """
        for path in values:
            if path not in self.swept:
                raise InputError.of(
                    path,
                    values[path],
                    f"is not swept; swept are {', '.join(self.swept)}",
                )
        return [
            point
            for point in self
            if all(
                value == point.values[path]
                or (path in point.changes and value == point.changes[path])
                for path, value in values.items()
            )
        ]

    def states(self) -> list[str]:
        """The present state of each point: ``done``, ``failed``, ``missing`` or ``damaged``."""
        states: dict[str, str] = {}
        for key in self.keys:
            if key not in states:
                states[key] = self.store.state(key)
        return [states[key] for key in self.keys]

    @property
    def failed(self) -> list[Point]:
        """The points that failed."""
        return [
            self[index]
            for index, state in enumerate(self.states())
            if state == "failed"
        ]

    def table(self) -> SweepTable:
        """The table of all points, as they are in the folder at present."""
        points = (self.store.read_point(key) for key in self.keys)
        return SweepTable.collect(self.swept, self.units, points, self.axes)

    def to_pandas(self) -> pandas.DataFrame:
        """A data frame with one row per point: status, swept fields, results.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        return self.table().to_pandas()

    def to_xarray(self) -> xarray.Dataset:
        """A dataset with one dimension for each axis, named after its field (``load``, ``surface_seed``).

        Lines that vary together share a dimension. Numbers of a point (``beta``, ``area_fraction``) have these
        dimensions; curves (``friction_drop``) have ``hold_time`` as well, and ``bonds`` also ``replica``. Every
        variable has ``units`` and ``long_name``. Of a point that is not done, ``status`` says why, numbers are nan and
        bonds -1.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        return self.table().to_xarray()

    def write_tables(self) -> tuple[Path, Path]:
        """Write ``results.csv`` and ``results.h5`` into the folder."""
        table = self.table()
        if len(table.processors) > 1:
            warnings.warn(
                f"{self.folder}: points were computed on unlike processors ({'; '.join(table.processors)}); "
                "equal contacts can differ in the last digits of their pressures",
                SweepWarning,
                stacklevel=2,
            )
        names = self.folder / "results.csv", self.folder / "results.h5"
        table.write_csv(names[0])
        versions = self._manifest["versions"]
        table.write_hdf5(
            names[1],
            {
                "chemage": versions["chemage"],
                "chemage_sweep": FORMAT,
                "Conventions": "CF-1.8",
                "sweep": json.dumps(self.grid.todict()),
                "digest": self.digest,
                "versions": json.dumps(versions),
            },
        )
        return names

    def status(self) -> dict[str, Any]:
        """Count the points by state, in total and for each value of each axis, and list failures."""
        states = self.states()
        on_grid = np.array(states).reshape(self.grid.shape)
        axes = []
        for number, axis in enumerate(self.axes):
            rows = []
            for place, values in enumerate(axis.values):
                there = on_grid.take(place, axis=number).ravel().tolist()
                rows.append(
                    {
                        "values": dict(zip(axis.paths, values, strict=True)),
                        **count(there),
                    }
                )
            axes.append({"axis": axis.name, "rows": rows})
        contacts: list[str] = [] if self.means else self._manifest["contacts"]
        of_contacts = Counter(self.store.contact_state(key) for key in contacts)
        return {
            "name": self.name,
            "folder": str(self.folder),
            **count(states),
            "contacts": len(contacts),
            "contacts_done": of_contacts["done"],
            "contacts_damaged": of_contacts["damaged"],
            "axes": axes,
            "failures": self.failures(
                point for point, state in enumerate(states) if state == "failed"
            ),
        }

    def failures(self, points: Iterable[int]) -> list[dict[str, Any]]:
        """Why points failed: one JSON-able object each."""
        return [
            {
                "point": point,
                "changes": self[point].changes,
                "error": self[point].error,
            }
            for point in points
        ]

    def __repr__(self) -> str:
        return (
            f"<SweepResult {self.folder}: {len(self)} points, {self.grid.product}>"
        )


def load_sweep(folder: str | Path) -> SweepResult:
    """Read the results of the sweep in ``folder``, complete or not.

    Raises
    ------
    StoreError
        It is not the folder of a sweep, or a newer version of chemage wrote it.
    """
    return SweepResult(folder)


@dataclass(frozen=True)
class Collected:
    """What is in the folder of a sweep, after :func:`collect_sweep`."""

    #: the results
    result: SweepResult
    #: the numbers of points that are missing
    missing: list[int]
    #: the numbers of points that failed
    failed: list[int]
    #: whether ``results.csv`` and ``results.h5`` were written: no point is missing or damaged
    written: bool
    #: values of ``points`` that compute what is missing or failed: shares of which each computes a part, if the points
    #: were divided into one number of shares; and, the last, the numbers of all these points
    points: list[str]
    #: whether other processes of this machine compute points at present
    computing: bool
    #: the numbers of points whose files are not as they were written
    damaged: list[int]

    @property
    def complete(self) -> bool:
        """Whether every point is done."""
        return self.written and not self.failed


def collect_sweep(folder: str | Path) -> Collected:
    """Verify every point in the folder of a sweep, and write the tables ``results.csv`` and ``results.h5``.

    The tables are written if every point is done or failed; they equal those of one process that computes all points.

    Raises
    ------
    StoreError
        It is not the folder of a sweep, or it cannot be written.
    """
    result = load_sweep(folder)
    states = result.states()
    failed, missing, damaged = (
        [point for point, state in enumerate(states) if state == wanted]
        for wanted in NOT_DONE
    )
    texts = remedies(
        result.store, sorted(missing + damaged + failed), result.digest, len(states)
    )
    computing = result.store.is_locked()
    written = not missing and not damaged
    if written:
        result.write_tables()
    if written and not failed and not computing:
        shutil.rmtree(result.store.path / PLACE, ignore_errors=True)
        shutil.rmtree(result.store.path / ".parts", ignore_errors=True)
    return Collected(result, missing, failed, written, texts, computing, damaged)
