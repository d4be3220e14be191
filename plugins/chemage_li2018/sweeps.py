"""The scenes of each figure and table, one sweep for those of a base, so that they share contacts; and their points."""

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
#: silanol density of a partly hydroxylated surface over that of the model, 2.6 and 4.9 OH/nm²
PARTIAL = round(2.6 / 4.9, 4)
#: seeds of the surfaces: none of them was used to fit the barrier density or to choose an option
SURFACE_SEEDS = tuple(range(101, 101 + 32))
FEWEST_PIXELS = 320

#: scenes whose options the studies of one sweep vary, and studies: the points that a panel needs, for one surface; as
#: reproduction.toml describes them
BASES: dict[str, dict[str, Any]] = DATA["bases"]
STUDIES: dict[str, dict[str, Any]] = DATA["studies"]
#: the studies of each figure or table
TARGETS: dict[str, list[str]] = DATA["targets"]


def chosen(names: Sequence[str]) -> list[str]:
    """Check the names of targets and sort them as on the page; none, or ``all``, means all targets."""
    for name in names:
        if name not in (targets := (*TARGETS, "all")):
            raise InputError(
                f"no target {name!r}{nearest(name, targets)}; the targets are {', '.join(targets)}"
            )
    every = not names or "all" in names
    return [name for name in TARGETS if every or name in names]


def studies_for(targets: Iterable[str]) -> list[str]:
    """List the studies of ``targets``, each once."""
    return list(dict.fromkeys(study for target in targets for study in TARGETS[target]))


def members(study: str) -> list[dict[str, Any]]:
    """List the points of a study for one surface seed: dotted path -> value, with all varied paths in each."""
    panel = STUDIES[study]
    reference = BASES[panel["base"]]["reference"]
    paths = [path for axis in panel["axes"] for path in axis]
    axes = (zip(*axis.values(), strict=True) for axis in panel["axes"])
    return [
        reference | dict(zip(paths, chain(*parts), strict=True))
        for parts in product(*axes)
    ]


def content(point: dict[str, Any]) -> str:
    """Identify a point apart from its surface seed and its number of replicas."""
    return repr(
        sorted(
            (path, float(value))
            for path, value in point.items()
            if path not in ("surface.seed", "hold.replicas")
        )
    )


def scenes(
    targets: Sequence[str], seeds: Sequence[int], pixels: int | None = None
) -> dict[str, dict[str, Any]]:
    """Make scene data of the sweeps, by base, that together have every point of ``targets`` for every surface seed.

    ``pixels`` coarsens every rough surface at constant size, for tests.
    """
    if pixels is not None and pixels < FEWEST_PIXELS:
        remedy = f"give {FEWEST_PIXELS} or more"
        raise InputError.of("pixels", pixels, "cannot resolve ζ = 150", remedy)
    sweeps = {}
    for name, base in BASES.items():
        columns = _columns(targets, name, seeds if base.get("rough", True) else ())
        if columns:
            data, _ = scene_data(base["scene"])
            changes = {"name": f"reproduction-{name}", **base["changes"]}
            if name == "rough" and pixels is not None:
                changes |= coarse(pixels)
            sweeps[name] = {**override(data, changes), "sweep": {"zip": [columns]}}
    return sweeps


def _columns(
    targets: Sequence[str], base: str, seeds: Sequence[int]
) -> dict[str, list[Any]]:
    """The points of a base as columns by path; of equal points that with the most replicas is computed."""
    points: dict[str, dict[str, Any]] = {}
    replicas = "hold.replicas"
    for name in studies_for(targets):
        if STUDIES[name]["base"] != base:
            continue
        surfaces = seeds[: STUDIES[name].get("surfaces")] or (None,)
        for seed, member in product(surfaces, members(name)):
            key = f"{seed} {content(member)}"
            if key not in points or points[key][replicas] < member[replicas]:
                points[key] = member | ({} if seed is None else {"surface.seed": seed})
    rows = list(points.values())
    return {path: [row[path] for row in rows] for path in (rows[0] if rows else ())}


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
    #: summary of the run, see :meth:`chemage.Run.summary`, with the contact area of the grid, as the paper has it
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
        ageing = point.ageing()
        # the mean over replicas, of which a sweep has too many to keep
        means = {name: one.mean(axis=0) for name, one in ageing.observables.items()}
        errors = ageing.friction_drop_half_width
        curves = ageing.hold_times, ageing.mean_friction_drop, errors
        summary = dict(point.summary)
        excess = summary["grid_area"] / summary["area"]
        summary["mean_contact_pressure"] /= excess
        for name in ("area", "area_fraction", "kappa"):
            summary[name] *= excess
        return cls(point.values, summary, *curves, means, point)

    def varied(self, name: str) -> Any:
        """The value of a swept field by the last part of its path."""
        values = self.changes.items()
        return next(one for path, one in values if path.rpartition(".")[2] == name)

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

    def swept(self, name: str) -> np.ndarray:
        """The values of a swept field, (n,)."""
        return np.array([point.varied(name) for point in self])

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
        index = self.nearest_to(time)
        return np.array([point.friction_drop_half_width[index] for point in self])

    def beta(self, window: tuple[float, float] = FIT_WINDOW) -> np.ndarray:
        """Slope of Δμ against log10 t between two hold times (s), of the mean over replicas, (n,)."""
        inside = (self.times >= window[0] * 0.999) & (self.times <= window[1] * 1.001)
        curves = self.coefficient[:, inside].T
        return np.polyfit(np.log10(self.times[inside]), curves, 1)[0]

    def by(self, *names: str) -> Groups:
        """Group the points by swept fields, in order of appearance; the key of one field is its value."""
        groups = Groups()
        for point in self:
            key, *more = map(point.varied, names)
            key = (key, *more) if more else key
            groups.setdefault(key, PointSet()).append(point)
        return groups

    def at_options(self, options: dict[str, float]) -> PointSet:
        """The points with these options: dotted path -> value."""
        chosen = (one for one in self if options.items() <= one.changes.items())
        return PointSet(chosen)

    def by_load(self) -> Groups:
        """Group the points by the load in µN."""
        return Groups((load / 1000, group) for load, group in self.by("load").items())

    def by_volume(self) -> Groups:
        """Group the points by the activation volume in Å³."""
        groups = self.by("activation_volume")
        return Groups((6.4 if volume else 0.0, groups[volume]) for volume in groups)

    def by_row(self) -> Groups:
        """Group the points by the rows of Table 1."""
        groups = self.by("hurst", "zeta", "eta")
        return Groups((row, groups[tuple(row.options.values())]) for row in TABLE_1)


class Groups(dict[Any, PointSet]):
    """Points in groups, by what those of a group have in common."""

    def each(self, value: Callable[[PointSet], Value]) -> dict[Any, Value]:
        """The value of each group, by the same keys."""
        return {key: value(group) for key, group in self.items()}


Studies = dict[str, PointSet]


def front(
    studies: Studies, hydroxylation: float, volume: float = WITH_PRESSURE
) -> PointSet:
    """The points of Fig. 6 with a hydroxylation and an activation volume (nm³)."""
    return studies["front"].by("hydroxylation", "activation_volume")[
        hydroxylation, volume
    ]


#: what the page and most figures need of a point, beside its curves
_SUMMED = (
    *("load", "area", "area_fraction", "corrected_area", "nominal_area", "kappa"),
    *("patches", "perimeter_to_area", "mean_contact_pressure", "nominal_pressure"),
    *("modulus", "rms_slope", "beta", "beta_half_width"),
)
_OBSERVED = ("pressures", "pressure_edges", "barriers_start", "barrier_edges")


def save_points(
    path: Path, points: Sequence[StudyPoint], about: dict[str, Any]
) -> None:
    """Store what the page needs of the points, and a dictionary ``about`` them; curves in single precision."""
    observed = {
        content(member) for study in ("loads", "slopes") for member in members(study)
    }
    columns: dict[str, list[np.ndarray]] = {
        "times": [point.hold_times for point in points],
        "drop": [point.friction_drop for point in points],
        "error": [point.friction_drop_half_width for point in points],
    }
    kept = [p.observables if content(p.changes) in observed else {} for p in points]
    for name in _OBSERVED:
        columns[name] = [values.get(name, np.zeros(0)) for values in kept]
    arrays = {}
    for name, rows in columns.items():
        # rows of different lengths end with nan
        padded = list(zip_longest(*rows, fillvalue=np.nan))
        kind = "f8" if name == "times" else "f4"
        arrays[name] = np.array(padded, kind).reshape(-1, len(rows)).T
    summaries = [
        {name: point.summary[name] for name in _SUMMED if name in point.summary}
        for point in points
    ]
    changes = [point.changes for point in points]
    text = json.dumps({**about, "changes": changes, "summaries": summaries})
    image = io.BytesIO()
    np.savez_compressed(image, about=np.frombuffer(text.encode(), np.uint8), **arrays)
    write_file(path, image.getvalue(), force=True)


def read_points(path: Path) -> tuple[PointSet, dict[str, Any]]:
    """Read what :func:`save_points` stored."""
    with open_file(path) as stream, np.load(stream) as stored:
        about = json.loads(stored["about"].tobytes())
        columns = {name: stored[name] for name in stored.files if name != "about"}
    points = PointSet()
    known = zip(about.pop("changes"), about.pop("summaries"), strict=True)
    for index, (changes, summary) in enumerate(known):
        every = {name: rows[index].astype("f8") for name, rows in columns.items()}
        # the error of one replica is not known, and nan as well
        inside = ~np.isnan(every["times"])
        curves = [every.pop(name)[inside] for name in ("times", "drop", "error")]
        observed = {name: row[~np.isnan(row)] for name, row in every.items()}
        observed = {name: row for name, row in observed.items() if row.size}
        points.append(StudyPoint(changes, summary, *curves, observables=observed))
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
        numbers = (round(number, digits) for number in (self.value, self.scatter))
        return " ± ".join(f"{number:.{max(digits, 0)}f}" for number in numbers)

    @property
    def one_more(self) -> float:
        """Half width of the interval that holds the value of one more surface with a probability of 95 %."""
        limit = statistics.student_limit(self.count - 1)
        return limit * self.scatter * math.sqrt(1 + 1 / self.count)


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
