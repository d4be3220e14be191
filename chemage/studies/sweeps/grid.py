"""The points of a sweep: reads ``[sweep]`` and validates every point before the first is computed.

Every entry of ``[sweep]`` is one axis of a grid; the entries of a ``[[sweep.zip]]`` vary together and form one axis.
The last axis varies fastest. A value replaces the value of the scene at that path: a number, a string with its unit, a
whole section given as an inline table, or ``false`` for a section to be left out.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from chemage.contacts.options import nominal_pressure
from chemage.contacts.theory import no_map
from chemage.foundation.components import Component
from chemage.foundation.errors import (
    ChemageError,
    InputError,
    PluginError,
    SceneError,
    nearest,
)
from chemage.foundation.records import content_hash, text_hash
from chemage.plugins import registry
from chemage.plugins.sources import implementing, stage_hooks
from chemage.scene.files import override, parse_scene, required_sections, section_names
from chemage.scene.materials import filled_sections
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene
from chemage.studies.folder import FORMAT
from chemage.studies.tasks import Task, ageing_seconds, registered_classes


@dataclass(frozen=True)
class Axis:
    """Fields that vary together, and their values."""

    #: dotted paths into the scene
    paths: tuple[str, ...]
    #: for each position on the axis one value per path
    values: tuple[tuple[Any, ...], ...]

    @property
    def name(self) -> str:
        """The paths, joined."""
        return " & ".join(self.paths)

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class Grid:
    """A scene and the axes along which it varies."""

    base: dict[str, Any]
    axes: tuple[Axis, ...]
    source: str = "the scene"

    @classmethod
    def read(cls, data: Mapping[str, Any], source: str = "the scene") -> Grid:
        """Read the grid from scene data with ``[sweep]``.

        Raises
        ------
        SceneError
            ``[sweep]`` is not valid; the message lists all its errors.
        """
        base = {name: section for name, section in data.items() if name != "sweep"}
        problems: list[tuple[str, str]] = []
        axes = _axes(data.get("sweep", {}), problems)
        seen: set[str] = set()
        for path in (path for axis in axes for path in axis.paths):
            if path in seen:
                problems.append(
                    (f"sweep.{path}", "is swept twice; keep one of the two")
                )
            seen.add(path)
        if not axes and not problems:
            problems.append(
                (
                    "sweep",
                    'names no field; give lists, such as "surface.rms_slope" = [0.05, 0.1]',
                )
            )
        if problems:
            raise SceneError(source, problems)
        return cls(base, tuple(axes), source)

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(len(axis) for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of positions on each axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def product(self) -> str:
        """The shape as text, such as ``2 x 3``."""
        return " x ".join(str(length) for length in self.shape)

    def positions(self, point: int) -> tuple[int, ...]:
        """The position of ``point`` on each axis."""
        return tuple(int(place) for place in np.unravel_index(point, self.shape))

    def changes(self, point: int) -> dict[str, Any]:
        """The changes of ``point`` to the base: dotted path -> value."""
        return {
            path: value
            for axis, place in zip(self.axes, self.positions(point), strict=True)
            for path, value in zip(axis.paths, axis.values[place], strict=True)
        }

    def data(self, point: int) -> dict[str, Any]:
        """Scene data of ``point``."""
        # a whole section is replaced before a field inside it is set
        changes = dict(
            sorted(self.changes(point).items(), key=lambda item: item[0].count("."))
        )
        # a material would fill what is removed here; there, a section that is false is left out
        kept = (
            filled_sections()
            if changes.get("material", self.base.get("material"))
            else ()
        )
        for path in section_names():
            if changes.get(path) is False and path not in (*kept, *required_sections()):
                changes[path] = None
        return override(self.base, changes)

    def scene(self, point: int) -> Scene:
        """The validated scene of ``point``."""
        return parse_scene(self.data(point), self.source)

    def components(self) -> list[Component]:
        """The components of all points; only an axis of kinds or of whole sections changes them."""
        varied = []
        for axis in self.axes:
            kinds = any(path.endswith("kind") for path in axis.paths)
            sections = any(
                isinstance(value, dict | bool) for row in axis.values for value in row
            )
            varied.append(range(len(axis)) if kinds or sections else (0,))
        points = [
            int(np.ravel_multi_index(places, self.shape))
            for places in itertools.product(*varied)
        ]
        return [
            component
            for point in points
            for component in self.scene(point).components()
        ]

    def todict(self) -> dict[str, Any]:
        """Plain JSON values, from which :meth:`fromdict` makes an equal grid."""
        return asdict(self)

    @classmethod
    def fromdict(cls, fields: Mapping[str, Any]) -> Grid:
        """The inverse of :meth:`todict`."""
        return TypeAdapter(cls).validate_python(fields)


def _axes(sweep: Any, problems: list[tuple[str, str]]) -> list[Axis]:
    if not isinstance(sweep, Mapping):
        problems.append(
            (
                "sweep",
                f"{sweep!r} is not a section; write [sweep] with one list per line",
            )
        )
        return []
    axes = [
        Axis((path,), tuple((value,) for value in values))
        for path, values in _lines(sweep, "sweep", problems)
    ]
    zips = sweep.get("zip", [])
    if not isinstance(zips, list) or not all(isinstance(one, Mapping) for one in zips):
        problems.append(
            (
                "sweep.zip",
                "write each group of lines that vary together as [[sweep.zip]], in two brackets",
            )
        )
        return axes
    for number, group in enumerate(zips):
        where = f"sweep.zip.{number}"
        lines = _lines(group, where, problems)
        lengths = {path: len(values) for path, values in lines}
        if len(set(lengths.values())) > 1:
            each = ", ".join(f"{path} has {length}" for path, length in lengths.items())
            problems.append(
                (where, f"lines that vary together must have equal length: {each}")
            )
        elif lines:
            axes.append(
                Axis(
                    tuple(lengths),
                    tuple(zip(*(values for _, values in lines), strict=True)),
                )
            )
        elif not group:
            problems.append((where, "names no field"))
    return axes


def _lines(
    table: Mapping[str, Any], where: str, problems: list[tuple[str, str]]
) -> list[tuple[str, list[Any]]]:
    """Find (path, values) of every list in ``table``, nested or dotted."""
    lines: list[tuple[str, list[Any]]] = []

    def visit(part: Mapping[str, Any], parents: tuple[str, ...]) -> None:
        for name, value in part.items():
            path = ".".join((*parents, name))
            if path == "zip" and where == "sweep":
                continue
            if isinstance(value, Mapping):
                visit(value, (*parents, name))
            elif not isinstance(value, list):
                problems.append(
                    (
                        f"{where}.{path}",
                        f"{value!r} is one value; give a list, such as [{value!r}]",
                    )
                )
            elif not value:
                problems.append(
                    (
                        f"{where}.{path}",
                        "is an empty list; an axis needs at least one value",
                    )
                )
            elif (wrong := _wrong_path(path)) is not None:
                problems.append((f"{where}.{path}", wrong))
            elif (
                path == "contact.load"
                and len({nominal_pressure(load) is None for load in value}) > 1
            ):
                problems.append(
                    (
                        f"{where}.{path}",
                        "give all loads as forces, or all as nominal pressures",
                    )
                )
            else:
                lines.append((path, value))

    visit(table, ())
    return lines


def _wrong_path(path: str) -> str | None:
    root, _, rest = path.partition(".")
    names = [name for name in section_names() if name != "sweep"]
    if root not in names:
        return f"no such section{nearest(root, names)}; the sections are {', '.join(names)}"
    if rest and ("" in rest.split(".") or root in ("name", "title", "material")):
        return "no such field"
    return None


# -- validation of all points -----------------------------------------------------------------------------------------


@dataclass
class Survey:
    """All points of a grid, validated: their tasks, and estimates of their cost."""

    grid: Grid
    tasks: list[Task] = field(default_factory=list)
    #: key of each contact -> the first task that has it
    contacts: dict[str, Task] = field(default_factory=dict)
    #: size of the folder
    bytes: float = 0.0
    #: largest memory of one task, bytes; nan if unknown
    memory: float = 0.0
    #: for each axis, position and path the validated value, in internal units
    resolved: list[list[list[Any]]] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    #: plugins that implement hooks of the stages: name -> source
    hooks: dict[str, str] = field(default_factory=dict)
    #: classes of components that are registered by hand
    classes: set[type] = field(default_factory=set)
    #: whether every point is a mean over surfaces
    means: bool = False
    digest: str = ""
    #: what to warn of: kind -> (text of the first point that it concerns, this point, number of points)
    doubts: dict[str, tuple[str, int, int]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, grid: Grid, progress: Callable[[int, int], None] | None = None
    ) -> Survey:
        """Validate every point of ``grid``; ``progress`` receives (points validated, number of points).

        Raises
        ------
        SceneError
            Points are not valid; for each error the message names the path, the first point, and the values of that
            point.
        """
        result = cls(grid, hooks=implementing(*stage_hooks()))
        result.resolved = [
            [[None] * len(axis.paths) for _ in axis.values] for axis in grid.axes
        ]
        wrong: dict[tuple[str, str], list[int]] = {}
        for point in range(grid.size):
            try:
                scene = grid.scene(point)
            except PluginError:
                raise
            except ChemageError as error:
                for problem in getattr(error, "problems", None) or [("", str(error))]:
                    first = wrong.setdefault(problem, [point, 0])
                    first[1] += 1
                continue
            finally:
                if progress is not None:
                    progress(point + 1, grid.size)
            if wrong:
                continue
            try:
                _add(result, point, scene)
            except InputError as error:
                error.add_note(f"at point {point} of {grid.source}")
                raise
            places = grid.positions(point)
            for axis, place in enumerate(places):
                if not any(
                    places[:axis] + places[axis + 1 :]
                ):  # the first point with this place
                    result.resolve(axis, place, scene)
        if wrong:
            raise SceneError(
                grid.source,
                [_located(grid, problem, *where) for problem, where in wrong.items()],
            )
        result.digest = text_hash(
            "".join(
                [json.dumps([[axis.paths for axis in grid.axes], []]), *result.keys]
            )
        )
        return result

    def resolve(self, axis: int, place: int, scene: Scene) -> None:
        """Record the validated values of one position: "20 uN" is 20000.0 nN."""
        data = scene.todict()
        for number, path in enumerate(self.grid.axes[axis].paths):
            written = self.grid.axes[axis].values[place][number]
            if (
                path == "contact.load"
                and (pressure := nominal_pressure(written)) is not None
            ):
                # the force differs where the size of the surface is swept as well
                self.resolved[axis][place][number], self.units[path] = pressure, "GPa"
                continue
            value: Any = data
            for name in path.split("."):
                value = value.get(name) if isinstance(value, Mapping) else None
            if (
                isinstance(written, Mapping)
                or value is None
                or isinstance(value, Mapping | list)
            ):
                value = written
            self.resolved[axis][place][number] = value
            if path not in self.units:
                self.units[path] = scene.unit(path)

    def manifest(self) -> dict[str, Any]:
        """What the file of a sweep in its folder says."""
        numbers = {key: number for number, key in enumerate(self.contacts)}
        return {
            "format": FORMAT,
            "digest": self.digest,
            "versions": versions(self.tasks[0].scene),
            "asked": self.hooks,
            "grid": self.grid.todict(),
            "resolved": self.resolved,
            "units": self.units,
            "contacts": list(numbers),
            "contact_of": [numbers[task.contact] for task in self.tasks],
            "keys": self.keys,
            **({"means": True} if self.means else {}),
        }

    def task(self, point: int, **changes: Any) -> Task:
        """The task of a point, with the memory that is enough for every one."""
        return replace(
            self.tasks[point],
            bytes=0.0 if math.isnan(self.memory) else self.memory,
            **changes,
        )

    @property
    def keys(self) -> list[str]:
        """Of all points."""
        return [task.key for task in self.tasks]

    def warnings(self) -> list[str]:
        """What to warn of, one sentence for each kind, with the points that it concerns."""
        sentences = []
        for text, first, count in self.doubts.values():
            others = (
                f" and similar at {count - 1} more of {self.grid.size}"
                if count > 1
                else f" of {self.grid.size}"
            )
            sentences.append(
                f"{text} [at point {first}{others}]" if self.grid.size > 1 else text
            )
        return sentences

    @property
    def surfaces(self) -> int:
        """Number of different surfaces."""
        return len({task.surface for task in self.tasks})


def cpu_seconds(tasks: Sequence[Task]) -> float | None:
    """CPU time of all contacts and kinetics of tasks, each once, s; None if a component gives no estimate."""
    seconds = ageing_seconds(tasks) + sum(
        {task.contact: task.contact_seconds for task in tasks}.values()
    )
    return None if math.isnan(seconds) else seconds


def mean_key(scene: Scene) -> str:
    """Content hash of everything on which the mean of a scene over surfaces depends.

    Raises
    ------
    InputError
        It asks for as much as a wall time allows.
    """
    wish = scene.ensemble
    if wish is not None and wish.budget is not None:
        raise InputError(
            "ensemble.budget: a wall time is for one mean, and the points of a sweep are computed together; ask each "
            "point for an accuracy, or for a number of surfaces"
        )
    options = None if wish is None else wish.model_dump(mode="json")
    return content_hash([scene.task_keys()["result"], options, dict(scene.accuracy)])


def _located(
    grid: Grid, problem: tuple[str, str], point: int, count: int
) -> tuple[str, str]:
    path, message = problem
    values = listed(grid.changes(point))
    others = f" and at {count - 1} more of {grid.size}" if count > 1 else ""
    return path, f"{message} [at point {point}: {values}{others}]"


def listed(values: Mapping[str, Any]) -> str:
    """Format dotted paths with their values as one line of text."""
    return ", ".join(f"{path} = {shown(value)}" for path, value in values.items())


def shown(value: Any) -> str:
    """Format a swept value as one line of text."""
    if isinstance(value, Mapping):
        rest = {name: item for name, item in value.items() if name != "kind"}
        return " ".join(
            [
                str(value.get("kind", "")),
                *(f"{name}={shown(item)}" for name, item in rest.items()),
            ]
        ).strip()
    return value if isinstance(value, str) else json.dumps(value)


def _add(result: Survey, point: int, scene: Scene) -> None:
    if not scene.contact.gives_map:
        raise InputError(
            no_map(
                scene.contact,
                "a sweep has no contact to store; run each scene by itself",
            )
        )
    costs = cost(scene)
    if point and scene.is_ensemble != result.means:
        raise InputError(
            "accuracy, ensemble: some points are means over surfaces and others are not; make two sweeps"
        )
    result.means = scene.is_ensemble
    result.classes |= registered_classes(scene.components())
    costs.check()
    varied = {path for axis in result.grid.axes for path in axis.paths}
    parts = costs.parts
    of_sweep = [
        doubt
        for stage in registry.current().stages()
        for doubt in stage.doubts_of_sweep(parts, varied)
    ]
    for doubt in [*costs.doubts(), *of_sweep]:
        text, first, count = result.doubts.get(doubt.kind, (doubt.text, point, 0))
        result.doubts[doubt.kind] = text, first, count + 1
    task = Task.of(scene, costs=costs, number=point)
    # only what makes the scene is kept, since there may be very many
    key = mean_key(scene) if result.means else task.key
    changes = result.grid.changes(point)
    task = replace(
        task, key=key, source=partial(result.grid.scene, point), changes=changes
    )
    result.tasks.append(task)
    needed = [costs.contact_bytes]
    if task.contact not in result.contacts:
        result.contacts[task.contact] = task
        result.bytes += 3000 + costs.contact_file
    result.bytes += 5000
    if scene.hold is not None:
        result.bytes += scene.hold.hold_times.size * (90 + 11 * scene.hold.replicas)
        needed.append(costs.replica_bytes)
    result.memory = float(np.max([result.memory, *map(_or_nan, needed)]))


def _or_nan(estimate: float | None) -> float:
    return math.nan if estimate is None else estimate
