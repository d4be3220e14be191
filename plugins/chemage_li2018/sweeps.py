"""The scenes of each figure and table; those of one base form one sweep, so that figures share contacts.

And the points of these sweeps, with their means over surface seeds.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain, product, zip_longest
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import chemage
from chemage import InputError
from chemage.plugin import (
    FIT_WINDOW,
    nearest,
    open_file,
    override,
    scene_data,
    statistics,
    text,
    write_file,
)
from chemage_li2018.published import DATA, TABLE_1

Value = TypeVar("Value")

#: nm³: 6.4 Å³, and none
WITH_PRESSURE = 0.0064
VOLUMES = (WITH_PRESSURE, 0.0)
#: nm³: "0.04 Å³" of the paper's Fig. 6, read literally
LITERAL_VOLUME = 0.04e-3
#: silanol density of a partly hydroxylated surface over that of the model, 2.6 and 4.9 OH/nm²
PARTIAL = round(2.6 / 4.9, 4)
#: seeds of the surfaces: none of them was used to fit the barrier density or to choose an option
SURFACE_SEEDS = tuple(range(101, 101 + 32))
FEWEST_PIXELS = 320

SLOPE = "surface.rms_slope"
SEED = "surface.seed"
LOAD = "contact.load"
VOLUME = "chemistry.activation_volume"
MEMBER = "forming.member"
REPLICAS = "hold.replicas"
KELVIN = "hold.temperature"
RADIUS = "surface.radius"
HYDROXYLATION = "chemistry.hydroxylation"
FRONT = "chemistry.front_factor"
STRENGTH = "interaction.strength"


#: scenes whose options the studies of one sweep vary, and studies: the points that a panel needs, for one surface; as
#: reproduction.toml describes them
BASES: dict[str, dict[str, Any]] = DATA["bases"]
STUDIES: dict[str, dict[str, Any]] = DATA["studies"]
#: the studies of each figure or table
TARGETS: dict[str, list[str]] = DATA["targets"]


def chosen(names: Sequence[str]) -> list[str]:
    """Check the names of targets and sort them as on the page; none, or ``all``, means all targets.

    Raises
    ------
    InputError
        There is no such target.
    """
    for name in names:
        if name == "patches":
            raise InputError(
                "patches: is computed on its own; give no other target beside it"
            )
        if name not in (*TARGETS, "all"):
            targets = [*TARGETS, "all", "patches"]
            raise InputError(
                f"no target {name!r}{nearest(name, targets)}; the targets are {', '.join(targets)}"
            )
    return (
        list(TARGETS)
        if not names or "all" in names
        else [name for name in TARGETS if name in names]
    )


def studies_for(targets: Iterable[str]) -> list[str]:
    """List the studies of ``targets``, each once."""
    return list(dict.fromkeys(study for target in targets for study in TARGETS[target]))


def members(study: str) -> list[dict[str, Any]]:
    """List the points of a study for one surface seed: dotted path -> value, with all varied paths in each."""
    panel, points = STUDIES[study], []
    paths = [path for axis in panel["axes"] for path in axis]
    for parts in product(*(zip(*axis.values(), strict=True) for axis in panel["axes"])):
        points.append(
            BASES[panel["base"]]["reference"]
            | dict(zip(paths, chain(*parts), strict=True))
        )
    return points


def content(point: dict[str, Any]) -> str:
    """Identify a point apart from its surface seed and its number of replicas."""
    return repr(
        sorted(
            (path, float(value))
            for path, value in point.items()
            if path not in (SEED, REPLICAS)
        )
    )


def scenes(
    targets: Sequence[str], seeds: Sequence[int], pixels: int | None = None
) -> dict[str, dict[str, Any]]:
    """Make scene data of the sweeps, by base, that together have every point of ``targets`` for every surface seed.

    ``pixels`` coarsens every rough surface at constant size, for tests.

    Raises
    ------
    InputError
        ``pixels`` cannot resolve the shortest wavelength.
    """
    if pixels is not None and pixels < FEWEST_PIXELS:
        raise InputError.of(
            "pixels",
            pixels,
            "cannot resolve the shortest wavelength (ζ = 150)",
            f"give {FEWEST_PIXELS} or more",
        )
    sweeps = {}
    for name, base in BASES.items():
        studies = [
            study for study in studies_for(targets) if STUDIES[study]["base"] == name
        ]
        if studies:
            columns = _columns(studies, seeds if base.get("rough", True) else ())
            data, _ = scene_data(base["scene"])
            coarser = coarse(pixels) if name == "rough" and pixels is not None else {}
            data = override(
                data, {"name": f"reproduction-{name}", **base["changes"], **coarser}
            )
            sweeps[name] = {**data, "sweep": {"zip": [columns]}}
    return sweeps


def _columns(studies: Sequence[str], seeds: Sequence[int]) -> dict[str, list[Any]]:
    """The points of ``studies`` as columns by path; of equal points that with the most replicas is computed."""
    points: dict[str, dict[str, Any]] = {}
    for study in studies:
        surfaces = [
            {SEED: seed} for seed in seeds[: STUDIES[study].get("surfaces")]
        ] or [{}]
        for surface, member in product(surfaces, members(study)):
            name = f"{surface} {content(member)}"
            if name not in points or points[name][REPLICAS] < member[REPLICAS]:
                points[name] = member | surface
    return {
        path: [point[path] for point in points.values()]
        for path in next(iter(points.values()))
    }


def coarse(pixels: int) -> dict[str, Any]:
    """Coarsen a rough surface at the paper's size; each pixel is a site, so that patches, areas and bonds have the same
    coarse pixels."""
    size = 2500 * 0.4518 / pixels
    return {
        "surface.pixels": pixels,
        "surface.pixel_size": size,
        "chemistry.site_density": "pixel",
    }


@dataclass(frozen=True)
class StudyPoint:
    """A completed point of a study."""

    #: the swept fields: dotted path -> value
    changes: dict[str, Any]
    #: summary of the run, see :meth:`chemage.Run.summary`
    summary: dict[str, Any]
    #: s, (m,)
    hold_times: np.ndarray
    #: ΔF and half the width of its 95 % interval over replicas, nN, (m,)
    friction_drop: np.ndarray
    friction_drop_half_width: np.ndarray
    observables: dict[str, np.ndarray] = field(default_factory=dict)
    #: the point in its sweep, which has the contact
    source: chemage.plugin.Point | None = None

    @classmethod
    def of(cls, point: chemage.plugin.Point) -> StudyPoint:
        """Read a completed point of a sweep."""
        aging = point.aging()
        return cls(
            point.values,
            point.summary,
            aging.hold_times,
            aging.mean_friction_drop,
            aging.friction_drop_half_width,
            # the mean over replicas, of which a sweep has too many to keep
            {name: values.mean(axis=0) for name, values in aging.observables.items()},
            point,
        )

    @property
    def computed(self) -> chemage.plugin.Point:
        """The point in its sweep."""
        assert self.source is not None
        return self.source


class PointSet(list[StudyPoint]):
    """n points with equal hold times, such as those of one scene on several surfaces, as arrays."""

    @property
    def times(self) -> np.ndarray:
        """s, (m,)."""
        return self[0].hold_times

    @property
    def drop(self) -> np.ndarray:
        """ΔF, nN, (n, m)."""
        return np.array([point.friction_drop for point in self])

    @property
    def coefficient(self) -> np.ndarray:
        """Δμ, (n, m)."""
        return self.drop / self.of("load")[:, None]

    def of(self, name: str) -> np.ndarray:
        """A number of the summary, (n,)."""
        return np.array([point.summary[name] for point in self])

    def swept(self, path: str) -> np.ndarray:
        """The values of a swept field, (n,)."""
        return np.array([point.changes[path] for point in self])

    def observed(self, name: str) -> np.ndarray:
        """An observable, (n, k)."""
        return np.array([point.observables[name] for point in self])

    def nearest_to(self, time: float) -> int:
        """Index of the hold time nearest to ``time`` (s)."""
        return int(np.argmin(np.abs(np.log(self.times) - np.log(time))))

    def at(self, time: float) -> np.ndarray:
        """ΔF at the hold time nearest to ``time`` (s), nN, (n,)."""
        return self.drop[:, self.nearest_to(time)]

    def coefficient_at(self, time: float) -> np.ndarray:
        """Δμ at the hold time nearest to ``time`` (s), (n,)."""
        return self.coefficient[:, self.nearest_to(time)]

    def half_width_at(self, time: float) -> np.ndarray:
        """Half the width of the 95 % interval of ΔF over replicas, nN, (n,)."""
        return np.array(
            [point.friction_drop_half_width[self.nearest_to(time)] for point in self]
        )

    def beta(self, window: tuple[float, float] = FIT_WINDOW) -> np.ndarray:
        """Slope of Δμ against log10 t between two hold times (s), of the mean over replicas, (n,)."""
        inside = (self.times >= window[0] * 0.999) & (self.times <= window[1] * 1.001)
        return np.polyfit(
            np.log10(self.times[inside]), self.coefficient[:, inside].T, 1
        )[0]

    def by(self, *paths: str) -> Groups:
        """Group the points by their values at ``paths``, in order of appearance; the key of one path is its value."""
        groups = Groups()
        for point in self:
            key = tuple(point.changes[path] for path in paths)
            key = key if len(paths) > 1 else key[0]
            groups.setdefault(key, PointSet()).append(point)
        return groups

    def at_options(self, options: dict[str, float]) -> PointSet:
        """The points with these options: dotted path -> value."""
        return PointSet(
            point for point in self if options.items() <= point.changes.items()
        )

    def by_load(self) -> Groups:
        """Group the points by the load in µN."""
        return Groups((load / 1000, group) for load, group in self.by(LOAD).items())

    def by_volume(self) -> Groups:
        """Group the points by the activation volume in Å³."""
        groups = self.by(VOLUME)
        return Groups((6.4 if volume else 0.0, groups[volume]) for volume in groups)

    def by_row(self) -> Groups:
        """Group the points by the rows of Table 1."""
        groups = self.by(*TABLE_1[0].options)
        return Groups((row, groups[tuple(row.options.values())]) for row in TABLE_1)

    def circle(self) -> PointSet:
        """The points with the roughness of the reference, the first row of Table 1."""
        return self.by_row()[TABLE_1[0]]


class Groups(dict[Any, PointSet]):
    """Points in groups, by what those of a group have in common."""

    def each(self, value: Callable[[PointSet], Value]) -> dict[Any, Value]:
        """The value of each group, by the same keys."""
        return {key: value(group) for key, group in self.items()}

    def means(self, value: Callable[[PointSet], np.ndarray]) -> dict[Any, Mean]:
        """The mean over the surfaces of each group, by the same keys."""
        return self.each(lambda group: mean(value(group)))


Studies = dict[str, PointSet]


def front(
    studies: Studies, hydroxylation: float, volume: float = WITH_PRESSURE
) -> PointSet:
    """The points of Fig. 6 with a hydroxylation and an activation volume (nm³)."""
    return studies["front"].by(HYDROXYLATION, VOLUME)[hydroxylation, volume]


#: what the page needs of a point, beside its curves
_SUMMED = (
    "load",
    "area_fraction",
    "kappa",
    "patches",
    "perimeter_to_area",
    "mean_contact_pressure",
    "beta",
)
_OBSERVED = ("pressures", "barriers_start", "barrier_edges")


def save_points(
    path: Path, points: Sequence[StudyPoint], about: dict[str, Any]
) -> None:
    """Store what the page needs of the points, and a dictionary ``about`` them; curves in single precision."""
    observed = {
        content(member) for study in ("loads", "slopes") for member in members(study)
    }
    none = np.zeros(0)
    columns: dict[str, list[np.ndarray]] = {
        name: [] for name in ("times", "drop", "error", *_OBSERVED)
    }
    for point in points:
        columns["times"].append(point.hold_times)
        columns["drop"].append(point.friction_drop)
        # errors of replicas are those of tips; rough contacts have the scatter between surfaces
        columns["error"].append(
            none if point.observables else point.friction_drop_half_width
        )
        values = point.observables if content(point.changes) in observed else {}
        for name in _OBSERVED:
            columns[name].append(values.get(name, none))
    arrays = {}
    for name, rows in columns.items():
        # rows of different lengths end with nan
        padded = np.array(
            list(zip_longest(*rows, fillvalue=np.nan)),
            "f8" if name == "times" else "f4",
        )
        arrays[name] = padded.reshape(-1, len(rows)).T
    summaries = [
        {name: point.summary[name] for name in _SUMMED if name in point.summary}
        for point in points
    ]
    text = json.dumps(
        {
            **about,
            "changes": [point.changes for point in points],
            "summaries": summaries,
        }
    )
    image = io.BytesIO()
    np.savez_compressed(image, about=np.frombuffer(text.encode(), np.uint8), **arrays)
    write_file(path, image.getvalue(), force=True)


def read_points(path: Path) -> tuple[PointSet, dict[str, Any]]:
    """Read what :func:`save_points` stored."""
    with open_file(path) as stream, np.load(stream) as stored:
        about = json.loads(stored["about"].tobytes())
        columns = {name: stored[name] for name in stored.files if name != "about"}
    points = PointSet()
    for at, (changes, summary) in enumerate(
        zip(about.pop("changes"), about.pop("summaries"), strict=True)
    ):
        rows = {
            name: values[at][~np.isnan(values[at])].astype("f8")
            for name, values in columns.items()
        }
        times, drop, error = (rows.pop(name) for name in ("times", "drop", "error"))
        if error.size:
            # before the first bonds there is none
            error = columns["error"][at][: times.size].astype("f8")
        observed = {name: row for name, row in rows.items() if row.size}
        points.append(StudyPoint(changes, summary, times, drop, error, observed))
    return points, about


@dataclass(frozen=True)
class Mean:
    """Mean and scatter of a number over surface seeds."""

    value: float
    #: standard deviation between seeds; nan for a single seed
    scatter: float
    count: int

    def __str__(self) -> str:
        if not self.scatter > text.ROUNDING * abs(self.value):
            return text.plus_minus(self.value, self.scatter)
        # the mean is better known than one surface
        digits = text.decimals(self.scatter / math.sqrt(self.count))
        value, scatter = (
            f"{round(number, digits):.{max(digits, 0)}f}"
            for number in (self.value, self.scatter)
        )
        return f"{value} ± {scatter}"

    @property
    def one_more(self) -> float:
        """Half width of the interval that holds the value of one more surface with a probability of 95 %."""
        return (
            statistics.student_limit(self.count - 1)
            * self.scatter
            * math.sqrt(1 + 1 / self.count)
        )


def mean(values: Iterable[float]) -> Mean:
    """Compute mean and standard deviation over surface seeds."""
    array = np.array(list(values), dtype=np.float64)
    scatter = float(array.std(ddof=1)) if array.size > 1 else math.nan
    return Mean(float(array.mean()), scatter, array.size)


def studies_of(points: Iterable[StudyPoint], targets: Iterable[str]) -> Studies:
    """Sort the points into the studies of ``targets``, in the order of each study, with seeds of one scene together."""
    by_content: dict[str, PointSet] = {}
    for point in points:
        by_content.setdefault(content(point.changes), PointSet()).append(point)
    studies = {}
    for study in studies_for(targets):
        found = studies[study] = PointSet()
        for member in members(study):
            found += by_content[content(member)][: STUDIES[study].get("surfaces")]
    return studies
