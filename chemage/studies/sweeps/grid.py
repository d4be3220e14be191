"""The points of a sweep: reads ``[sweep]`` and validates every point before the first is computed.

Every entry of ``[sweep]`` is one axis of a grid; the entries of a ``[[sweep.zip]]`` vary together and form one axis.
The last axis varies fastest. A value replaces the value of the scene at that path: a number, a string with its unit, a
whole section given as an inline table, or ``false`` for a section to be left out.

Shares of a sweep: which points one of several processes computes, such as the third of sixteen shares.
"""

from __future__ import annotations

import heapq
import itertools
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from chemage.contacts.options import nominal_pressure
from chemage.contacts.role import is_sought
from chemage.contacts.theory import no_map
from chemage.foundation.components import Component
from chemage.foundation.container import read_json, sealed_json
from chemage.foundation.errors import (
    ChemageError,
    DamagedError,
    InputError,
    PluginError,
    SceneError,
    nearest,
)
from chemage.foundation.records import content_hash, text_hash
from chemage.plugins import registry
from chemage.plugins.sources import implementing, stage_hooks
from chemage.scene.files import (
    override,
    parse_scene,
    required_sections,
    scene_data,
    section_names,
    value_at,
)
from chemage.scene.materials import filled_sections
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene
from chemage.studies.folder import FORMAT, Folder
from chemage.studies.study import Selection, in_ranges
from chemage.studies.tasks import (
    Task,
    ageing_seconds,
    by_contact,
    registered_classes,
)


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
            if changes.get(path) is False and path not in (
                *kept,
                *required_sections(),
            ):
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
                isinstance(value, dict | bool)
                for row in axis.values
                for value in row
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
    if not isinstance(zips, list) or not all(
        isinstance(one, Mapping) for one in zips
    ):
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
            each = ", ".join(
                f"{path} has {length}" for path, length in lengths.items()
            )
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
            elif problem := _wrong(path, value):
                problems.append((f"{where}.{path}", problem))
            else:
                lines.append((path, value))

    visit(table, ())
    return lines


def _wrong(path: str, values: Any) -> str:
    """What is wrong with a line of an axis; "" for nothing."""
    if not isinstance(values, list):
        return f"{values!r} is one value; give a list, such as [{values!r}]"
    if not values:
        return "is an empty list; an axis needs at least one value"
    root, _, rest = path.partition(".")
    names = [name for name in section_names() if name != "sweep"]
    if root not in names:
        return f"no such section{nearest(root, names)}; the sections are {', '.join(names)}"
    if rest and ("" in rest.split(".") or root in ("name", "title", "material")):
        return "no such field"
    if path == "contact.load" and len({_of_load(load) for load in values}) > 1:
        return "give all loads as forces, or all as nominal pressures, or all over contact"
    return ""


def _of_load(load: Any) -> tuple[bool, bool]:
    """Whether it is a nominal pressure, and one over the contact."""
    return nominal_pressure(load) is not None, is_sought(load)


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
        #: problem -> the first point that has it, and their number
        wrong: dict[tuple[str, str], tuple[int, int]] = {}
        for point in range(grid.size):
            try:
                scene = grid.scene(point)
            except PluginError:
                raise
            except ChemageError as error:
                for problem in getattr(error, "problems", None) or [
                    ("", str(error))
                ]:
                    first, count = wrong.get(problem, (point, 0))
                    wrong[problem] = first, count + 1
                continue
            finally:
                if progress is not None:
                    progress(point + 1, grid.size)
            if wrong:
                continue
            try:
                result.add(point, scene)
            except InputError as error:
                error.add_note(f"at point {point} of {grid.source}")
                raise
        if wrong:
            located = [
                _located(grid, problem, *where) for problem, where in wrong.items()
            ]
            raise SceneError(grid.source, located)
        result.resolve()
        paths = [axis.paths for axis in grid.axes]
        result.digest = text_hash("".join([json.dumps([paths, []]), *result.keys]))
        return result

    def resolve(self) -> None:
        """Record the validated value of every position of every axis: "20 uN" is 20000.0 nN."""
        for number, axis in enumerate(self.grid.axes):
            self.resolved.append([])
            for place in range(len(axis)):
                places = [0] * len(self.grid.axes)
                places[number] = place
                point = int(np.ravel_multi_index(places, self.grid.shape))
                scene = self.grid.scene(point)
                written = zip(axis.paths, axis.values[place], strict=True)
                values = [
                    self._resolved(path, value, scene) for path, value in written
                ]
                self.resolved[-1].append(values)

    def add(self, point: int, scene: Scene) -> None:
        """Add a point.

        Raises
        ------
        InputError
            It has no map, needs more memory than there is, or is a mean over surfaces where others are not.
        """
        if not scene.contact.gives_map:
            remedy = "a sweep has no contact to store; run each scene by itself"
            raise InputError(no_map(scene.contact, remedy))
        costs = cost(scene)
        if point and scene.is_ensemble != self.means:
            raise InputError(
                "accuracy, ensemble: some points are means over surfaces and others are not; make two sweeps"
            )
        self.means = scene.is_ensemble
        self.classes |= registered_classes(scene.components())
        costs.check()
        varied = {path for axis in self.grid.axes for path in axis.paths}
        doubts = [*costs.doubts()]
        for stage in registry.current().stages():
            doubts += stage.doubts_of_sweep(costs.parts, varied)
        for doubt in doubts:
            text, first, count = self.doubts.get(doubt.kind, (doubt.text, point, 0))
            self.doubts[doubt.kind] = text, first, count + 1
        task = Task.of(scene, costs=costs, number=point)
        # only what makes the scene is kept, since there may be very many
        task = replace(
            task,
            key=mean_key(scene) if self.means else task.key,
            source=partial(self.grid.scene, point),
            changes=self.grid.changes(point),
        )
        self.tasks.append(task)
        if task.contact not in self.contacts:
            self.contacts[task.contact] = task
            self.bytes += 3000 + costs.contact_file
        self.bytes += 5000
        needed = [self.memory, costs.contact_bytes]
        if scene.hold is not None:
            self.bytes += scene.hold.hold_times.size * (
                90 + 11 * scene.hold.replicas
            )
            needed.append(costs.replica_bytes)
        self.memory = float(
            np.max(np.array(needed, dtype=np.float64))
        )  # None is nan

    def _resolved(self, path: str, written: Any, scene: Scene) -> Any:
        if (
            path == "contact.load"
            and (pressure := nominal_pressure(written)) is not None
        ):
            # the force differs where the size of the surface is swept as well
            self.units[path] = "GPa"
            return pressure
        value = value_at(scene.todict(), path)
        if path not in self.units:
            self.units[path] = scene.unit(path)
        plain = not isinstance(written, Mapping) and not isinstance(
            value, Mapping | list
        )
        return value if plain and value is not None else written

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
    return content_hash(
        [scene.task_keys()["result"], options, dict(scene.accuracy)]
    )


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


def scenes_of(
    where: str | Path, changes: Mapping[str, Any] | None = None
) -> list[tuple[dict[str, Any], Scene]]:
    """The scenes of a scene file or an installed scene, each with what varies: of ``[sweep]`` its points, else itself."""
    data, source = scene_data(where)
    data = override(data, changes or {})
    if "sweep" not in data:
        return [({}, parse_scene(data, source))]
    grid = Grid.read(data, source)
    return [(grid.changes(point), grid.scene(point)) for point in range(grid.size)]


#: the folder of divisions within that of a sweep
PLACE = ".shares"
_FILE = re.compile(r"of-(\d{1,7})\.json")


def points_of(
    selection: Selection | None, folder: Folder, survey: Survey
) -> Sequence[int]:
    """The numbers of the points of a sweep that a process computes, ascending; of means all, of which each share
    computes a part of the samples.

    Raises
    ------
    InputError
        The sweep has no such point.
    """
    count = len(survey.tasks)
    share = None if selection is None else selection.share
    if selection is None or (survey.means and share is not None):
        return range(count)
    if (
        share is None
        or read_partition(folder, share[1], survey.digest, count) is not None
    ):
        return agreed_points(selection, folder, survey.digest, count)
    return [
        point
        for point, of in enumerate(partition(survey, share[1]))
        if of == share[0]
    ]


def agreed_points(
    selection: Selection, folder: Folder, digest: str, count: int
) -> list[int]:
    """The same of the sweep of ``count`` points that is in ``folder``.

    Raises
    ------
    InputError
        The sweep has no such point.
    """
    if selection.share is not None:
        of = read_partition(folder, selection.share[1], digest, count) or ()
        return [
            point for point, share in enumerate(of) if share == selection.share[0]
        ]
    last = max(last for _, last in selection.ranges)
    if last >= count:
        raise InputError(
            f"there is no point {last}: the sweep has points 0 to {count - 1}"
        )
    return sorted(
        {
            point
            for first, last in selection.ranges
            for point in range(first, last + 1)
        }
    )


# -- division of all points --------------------------------------------------------------------------------------------


def partition(survey: Survey, count: int) -> list[int]:
    """Divide the points of a sweep into shares of about equal CPU time.

    Points with the same kinetics stay together, and points with one contact do unless shares become more equal if they
    are divided. The longest pieces are dealt first, each to the share that has least. Where a component gives no
    estimate, each contact and each point counts the same.

    Parameters
    ----------
    survey
        The points.
    count
        Number of shares. With more shares than groups of points some shares are empty.

    Returns
    -------
    list of int
        For each point the number of its share, 1 to ``count``.
    """
    best: tuple[float, list[int]] = (math.inf, [])
    for finer in (1, 2, 4):
        loads = [(0.0, share) for share in range(1, count + 1)]
        of = [0] * len(survey.tasks)
        pieces = _pieces(survey, count * finer)
        for seconds, points in sorted(pieces, key=lambda piece: -piece[0]):
            load, share = loads[0]
            for point in points:
                of[point] = share
            heapq.heapreplace(loads, (load + seconds, share))
        longest, _ = max(loads)
        if longest < 0.95 * best[0]:
            best = longest, of
    return best[1]


def _pieces(survey: Survey, count: int) -> list[tuple[float, list[int]]]:
    """The cost and the points of groups of points with one contact, none longer than a ``count``-th of all where it can
    be divided."""
    is_known = cpu_seconds(survey.tasks) is not None

    def seconds(estimate: float) -> float:
        return estimate + 1e-3 if is_known else 1.0

    groups = []
    for ageings in by_contact(survey.tasks):
        kinetics = [seconds(tasks[0].ageing_seconds) for tasks in ageings]
        groups.append((ageings, seconds(ageings[0][0].contact_seconds), kinetics))
    total = sum(contact + sum(kinetics) for _, contact, kinetics in groups)
    pieces = []
    for ageings, contact, kinetics in groups:
        whole = contact + sum(kinetics)
        parts = min(len(ageings), max(1, math.ceil(whole * count / total - 1e-9)))
        for part in range(parts):
            chosen = slice(
                part * len(ageings) // parts, (part + 1) * len(ageings) // parts
            )
            points = [task.number for tasks in ageings[chosen] for task in tasks]
            # each process solves the contact, rather than wait for another one
            pieces.append((contact + sum(kinetics[chosen]), points))
    return pieces


@dataclass(frozen=True)
class ShareCost:
    """The estimated cost of one share."""

    points: int
    #: contacts that the points need, which other shares may need as well
    contacts: int
    #: CPU time, s, if it solves all these contacts; None if a component gives no estimate
    cpu_seconds: float | None


def shares_cost(survey: Survey, count: int) -> list[ShareCost]:
    """The estimated cost of each of ``count`` shares."""
    shares: list[list[Task]] = [[] for _ in range(count)]
    for task, share in zip(survey.tasks, partition(survey, count), strict=True):
        shares[share - 1].append(task)
    return [
        ShareCost(
            len(tasks), len({task.contact for task in tasks}), cpu_seconds(tasks)
        )
        for tasks in shares
    ]


# -- the division that processes agreed on ----------------------------------------------------------------------------


def read_partition(
    folder: Folder, count: int, digest: str, points: int
) -> list[int] | None:
    """The division of the ``points`` points of a sweep into ``count`` shares, if it is in the folder."""
    try:
        content = read_json(folder.path / PLACE / f"of-{count}.json")
    except (OSError, DamagedError):
        return None
    of, shares = content.get("shares"), range(1, count + 1)
    if content.get("digest") != digest or not isinstance(of, list):
        return None
    right = all(type(share) is int and share in shares for share in of)
    return of if right and len(of) == points else None


def agree(folder: Folder, survey: Survey, count: int) -> None:
    """Write a division of the points into ``count`` shares, unless another process has.

    Estimates of cost may differ between machines; all processes use the division of the first one.
    """
    path = folder.path / PLACE / f"of-{count}.json"
    for over in (False, True):
        if (
            read_partition(folder, count, survey.digest, len(survey.tasks))
            is not None
        ):
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        content = {"digest": survey.digest, "shares": partition(survey, count)}
        # what is there the second time is damaged, or of a sweep that was replaced
        folder.place(path, sealed_json(content), over=over)


def remedies(
    folder: Folder, points: Sequence[int], digest: str, count: int
) -> list[str]:
    """Selections of which each computes a part of ``points``, and the last all of them.

    These are shares, if processes have divided this sweep of ``count`` points once; and numbers of points.
    """
    texts = [in_ranges(points)] if points else []
    files = (folder.path / PLACE).glob("of-*")
    names = [_FILE.fullmatch(path.name) for path in files]
    divisions = [int(match[1]) for match in names if match is not None]
    if len(divisions) != 1:
        return texts
    of = read_partition(folder, divisions[0], digest, count)
    shares = {of[point] for point in points} if of is not None else ()
    return [f"{share}/{divisions[0]}" for share in sorted(shares)] + texts
