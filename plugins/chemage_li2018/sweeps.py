"""The scenes of each figure and table; those of one base form one sweep, so that figures share contacts.

And the points of these sweeps, with their means over surface seeds.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

import chemage
from chemage import InputError
from chemage.plugin import FIT_WINDOW, nearest, open_file, override, scene_data, text, write_file
from chemage_li2018.published import SLOPES, TABLE_1
from chemage_silica import MDSilica

#: nN
LOADS = tuple(1000.0 * load for load in (5, 10, 20, 50, 100, 200, 500))
#: eV
STRENGTHS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
#: nm³: 6.4 Å³, and none
WITH_PRESSURE = 0.0064
VOLUMES = (WITH_PRESSURE, 0.0)
#: nm³: "0.04 Å³" of the paper's Fig. 6, read literally
LITERAL_VOLUME = 0.04e-3
#: silanol density of a partly hydroxylated surface over that of the model, 2.6 and 4.9 OH/nm²
PARTIAL = round(2.6 / 4.9, 4)
#: K
TEMPERATURES = (225.0, 250.0, 275.0, 300.0, 325.0, 350.0, 375.0, 400.0)
#: nN and nm: loads of AFM in the paper and some between; radii, which the paper does not give
TIP_LOADS = (23.0, 50.0, 100.0, 200.0, 393.0)
TIP_RADII = (30.0, 100.0)
#: seeds of the surfaces: none of them was used to fit the barrier density or to choose an option
SURFACE_SEEDS = tuple(range(101, 101 + 32))
FEWEST_PIXELS = 320

#: the reference of the rough surfaces: the scene silica-rough
_ROUGH: dict[str, Any] = {
    "surface.rms_slope": 0.1,
    "surface.hurst": 0.8,
    "surface.zeta": 150.0,
    "surface.eta": 3.0,
    "contact.load": 20000.0,
    "chemistry.activation_volume": WITH_PRESSURE,
    "chemistry.hydroxylation": 1.0,
    "chemistry.front_factor": 1.0,
    "interaction.strength": 0.5,
    "forming.member": 0,
    "hold.replicas": 10,
}
_TIP: dict[str, Any] = {
    "surface.radius": 30.0,
    "contact.load": 50.0,
    "hold.temperature": 300.0,
    "hold.stop": 1e5,
    "hold.replicas": 200,
}
_PATCH: dict[str, Any] = {"hold.temperature": 300.0, "forming.member": 0, "hold.replicas": 10}


@dataclass(frozen=True)
class Base:
    """A scene whose options the studies of one sweep vary."""

    scene: str
    #: dotted path -> value of the reference; every point has a value for each
    reference: dict[str, Any]
    #: whether each surface seed gives another surface
    rough: bool = True


BASES = {
    "rough": Base("silica-rough", _ROUGH),
    "patch": Base("silica-patch", _PATCH),
    "tip": Base("silica-tip", _TIP, rough=False),
}


@dataclass(frozen=True)
class Study:
    """The points that a panel needs, for one surface."""

    base: str
    points: Callable[[], Iterable[dict[str, Any]]]
    #: number of surface seeds at most; 0: all that are asked for
    surfaces: int = 0


def _loads() -> Iterable[dict[str, Any]]:
    # the contact at 100 µN has 300 000 sites, and needs few replicas
    return ({"contact.load": load, "hold.replicas": 10 if load < 100e3 else 2} for load in LOADS)


def _rows(slopes: Sequence[float], volumes: Sequence[float], replicas: int = 2) -> Iterable[dict[str, Any]]:
    return (
        {
            "surface.rms_slope": slope,
            "surface.hurst": row.hurst,
            "surface.zeta": row.zeta,
            "surface.eta": row.eta,
            "chemistry.activation_volume": volume,
            "hold.replicas": replicas,
        }
        for volume in volumes
        for slope in slopes
        for row in TABLE_1
    )


def _slopes() -> Iterable[dict[str, Any]]:
    return ({"surface.rms_slope": slope, "chemistry.activation_volume": v} for v in VOLUMES for slope in SLOPES)


def _front() -> Iterable[dict[str, Any]]:
    for hydroxylation, volume, front in (
        (0.5, WITH_PRESSURE, 0.15),
        (0.25, WITH_PRESSURE, 0.15),
        (0.5, LITERAL_VOLUME, 0.15),
        (PARTIAL, WITH_PRESSURE, 0.15),
        (1.0, WITH_PRESSURE, 1.0),
    ):
        yield {
            "surface.rms_slope": 0.4,
            "chemistry.hydroxylation": hydroxylation,
            "chemistry.activation_volume": volume,
            "chemistry.front_factor": front,
        }


def _temperatures(replicas: int) -> Iterable[dict[str, Any]]:
    # above 350 K most events break a bond that has just formed
    return ({"hold.temperature": t, "hold.replicas": replicas if t <= 350 else replicas // 10} for t in TEMPERATURES)


def _members() -> Iterable[dict[str, Any]]:
    front = {"chemistry.hydroxylation": 0.5, "chemistry.front_factor": 0.15, "hold.replicas": 10}
    for member in range(MDSilica.MEMBERS):
        for slope, replicas in zip(SLOPES, (2, 3, 5), strict=True):
            for volume in VOLUMES:
                yield {
                    "surface.rms_slope": slope,
                    "chemistry.activation_volume": volume,
                    "forming.member": member,
                    "hold.replicas": replicas,
                }
        yield {"surface.rms_slope": 0.4, "forming.member": member, **front}


STUDIES: dict[str, Study] = {
    "reference": Study("rough", lambda: [{"hold.replicas": 1}]),
    "loads": Study("rough", _loads),
    "rows": Study("rough", lambda: _rows(SLOPES, VOLUMES)),
    "members": Study("rough", _members, surfaces=1),
    "table": Study("rough", lambda: _rows(SLOPES[:1], VOLUMES[:1], replicas=1)),
    "slopes": Study("rough", _slopes),
    "front": Study("rough", _front),
    "interaction": Study(
        "rough", lambda: ({"interaction.strength": strength, "hold.replicas": 2} for strength in STRENGTHS)
    ),
    "warm rough": Study("patch", lambda: _temperatures(10)),
    "warm members": Study(
        "patch",
        lambda: (
            {**changes, "forming.member": member}
            for member in range(MDSilica.MEMBERS)
            for changes in _temperatures(10)
            if changes["hold.temperature"] <= 350
        ),
        surfaces=1,
    ),
    "warm tip": Study("tip", lambda: ({"hold.stop": 1e4, **changes} for changes in _temperatures(40))),
    "tips": Study(
        "tip", lambda: ({"surface.radius": r, "contact.load": load} for r in TIP_RADII for load in TIP_LOADS)
    ),
}

#: the studies of each figure or table
TARGETS: dict[str, tuple[str, ...]] = {
    "fig1": ("reference",),
    "fig2": ("loads",),
    "fig3": ("rows", "slopes"),
    "fig4": ("slopes",),
    "fig5": ("rows",),
    "fig6": ("front",),
    "table1": ("table",),
    "kappa": ("loads", "table", "front"),
    "maps": ("table",),
    "areas": ("loads",),
    "barriers": ("loads",),
    "interaction": ("interaction",),
    "temperature": ("warm rough", "warm members", "warm tip"),
    "tips": ("tips",),
    "estimates": ("slopes", "front"),
    "calibration": ("members", "slopes", "front"),
}


def chosen(names: Sequence[str]) -> list[str]:
    """Check the names of targets and sort them as on the page; none, or ``all``, means all targets.

    Raises
    ------
    InputError
        There is no such target.
    """
    for name in names:
        if name == "patches":
            raise InputError("patches: is computed on its own; give no other target beside it")
        if name not in (*TARGETS, "all"):
            targets = [*TARGETS, "all", "patches"]
            raise InputError(f"no target {name!r}{nearest(name, targets)}; the targets are {', '.join(targets)}")
    return list(TARGETS) if not names or "all" in names else [name for name in TARGETS if name in names]


def studies_for(targets: Iterable[str]) -> list[str]:
    """List the studies of ``targets``, each once."""
    return list(dict.fromkeys(study for target in targets for study in TARGETS[target]))


def members(study: str) -> list[dict[str, Any]]:
    """List the points of a study for one surface seed: dotted path -> value, with all varied paths in each."""
    panel = STUDIES[study]
    return [{**BASES[panel.base].reference, **changes} for changes in panel.points()]


def content(point: dict[str, Any]) -> str:
    """Identify a point apart from its surface seed and its number of replicas."""
    apart = ("surface.seed", "hold.replicas")
    return repr(sorted((path, float(value)) for path, value in point.items() if path not in apart))


def scenes(targets: Sequence[str], seeds: Sequence[int], pixels: int | None = None) -> dict[str, dict[str, Any]]:
    """Make scene data of the sweeps, by base, that together have every point of ``targets`` for every surface seed.

    ``pixels`` coarsens every rough surface at constant size, for tests.

    Raises
    ------
    InputError
        ``pixels`` cannot resolve the shortest wavelength.
    """
    if pixels is not None and pixels < FEWEST_PIXELS:
        raise InputError.of(
            "pixels", pixels, "cannot resolve the shortest wavelength (ζ = 150)", f"give {FEWEST_PIXELS} or more"
        )
    sweeps = {}
    for base in BASES:
        studies = [study for study in studies_for(targets) if STUDIES[study].base == base]
        if studies:
            points = _points(studies, seeds if BASES[base].rough else (0,), rough=BASES[base].rough)
            sweeps[base] = {**_data(base, pixels), "sweep": {"zip": [points]}}
    return sweeps


def _points(studies: Sequence[str], seeds: Sequence[int], *, rough: bool) -> dict[str, list[Any]]:
    """The points of ``studies`` as columns by path; of equal points that with the most replicas is computed."""
    points: dict[str, dict[str, Any]] = {}
    for study in studies:
        for seed in seeds[: STUDIES[study].surfaces or None]:
            for member in members(study):
                name = f"{seed} {content(member)}"
                if name not in points or points[name]["hold.replicas"] < member["hold.replicas"]:
                    points[name] = {**member, "surface.seed": seed} if rough else member
    return {path: [point[path] for point in points.values()] for path in next(iter(points.values()))}


def _data(base: str, pixels: int | None) -> dict[str, Any]:
    data, _ = scene_data(BASES[base].scene)
    data = override(data, {"name": f"reproduction-{base}"})
    if base == "rough":
        data["observe"] = [{"kind": "barrier-spectrum"}, {"kind": "pressure-spectrum"}]
        if pixels is not None:  # each pixel is a site, so that patches, areas and bonds have the same coarse pixels
            size = 2500 * 0.4518 / pixels
            coarse = {"surface.pixels": pixels, "surface.pixel_size": size, "chemistry.site_density": "pixel"}
            data = override(data, coarse)
        return data
    data["observe"] = []
    if base == "patch":  # the interaction of the paper's rough surfaces
        return override(data, {"interaction.strength": 0.5, "hold.start": 1e-3, "hold.stop": 1e4})
    return data


SLOPE, SEED, LOAD, VOLUME = "surface.rms_slope", "surface.seed", "contact.load", "chemistry.activation_volume"
MEMBER = "forming.member"
ROW = ("surface.hurst", "surface.zeta", "surface.eta")


@dataclass(frozen=True)
class Point:
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
    def of(cls, point: chemage.plugin.Point) -> Point:
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
    def coefficient(self) -> np.ndarray:
        """Δμ, (m,)."""
        return self.friction_drop / self.summary["load"]

    def at(self, time: float) -> float:
        """ΔF at the hold time nearest to ``time`` (s), nN."""
        return float(self.friction_drop[self.index(time)])

    def index(self, time: float) -> int:
        """Index of the hold time nearest to ``time`` (s)."""
        return int(np.argmin(np.abs(np.log(self.hold_times) - np.log(time))))

    def beta(self, window: tuple[float, float] = FIT_WINDOW) -> float:
        """Slope of Δμ against log10 t between two hold times (s), of the mean over replicas."""
        inside = (self.hold_times >= window[0] * 0.999) & (self.hold_times <= window[1] * 1.001)
        return float(np.polyfit(np.log10(self.hold_times[inside]), self.coefficient[inside], 1)[0])

    def contact(self) -> chemage.ContactSolution:
        """The contact of this point, from the folder of its sweep."""
        assert self.source is not None
        return self.source.contact()

    def surface(self) -> chemage.Surface:
        """The rough surface of this point, made again."""
        assert self.source is not None
        scene = self.source.scene()
        return chemage.make_surface(scene.surface, scene.surface_seed)


#: what the page needs of a point, beside its curves
_SUMMED = ("load", "area_fraction", "kappa", "patches", "perimeter_to_area", "mean_contact_pressure", "beta")
_OBSERVED = ("pressures", "barriers_start", "barrier_edges")


def save_points(path: Path, points: Sequence[Point], about: dict[str, Any]) -> None:
    """Store what the page needs of the points, and a dictionary ``about`` them; curves in single precision."""
    observed = {content(member) for study in ("loads", "slopes") for member in members(study)}
    none = np.zeros(0)
    columns: dict[str, list[np.ndarray]] = {name: [] for name in ("times", "drop", "error", *_OBSERVED)}
    for point in points:
        columns["times"].append(point.hold_times)
        columns["drop"].append(point.friction_drop)
        # errors of replicas are those of tips; rough contacts have the scatter between surfaces
        columns["error"].append(none if point.observables else point.friction_drop_half_width)
        values = point.observables if content(point.changes) in observed else {}
        for name in _OBSERVED:
            columns[name].append(values.get(name, none))
    arrays = {}
    for name, rows in columns.items():
        # rows of different lengths end with nan
        arrays[name] = np.full((len(rows), max(map(len, rows), default=0)), np.nan, "f8" if name == "times" else "f4")
        for row, values in zip(arrays[name], rows, strict=True):
            row[: len(values)] = values
    summaries = [{name: point.summary[name] for name in _SUMMED if name in point.summary} for point in points]
    text = json.dumps({**about, "changes": [point.changes for point in points], "summaries": summaries})
    image = io.BytesIO()
    np.savez_compressed(image, about=np.frombuffer(text.encode(), np.uint8), **arrays)
    write_file(path, image.getvalue(), force=True)


def read_points(path: Path) -> tuple[list[Point], dict[str, Any]]:
    """Read what :func:`save_points` stored."""
    with open_file(path) as stream, np.load(stream) as stored:
        about = json.loads(stored["about"].tobytes())
        columns = {name: stored[name] for name in stored.files if name != "about"}
    points = []
    for at, (changes, summary) in enumerate(zip(about.pop("changes"), about.pop("summaries"), strict=True)):
        rows = {name: values[at][~np.isnan(values[at])].astype("f8") for name, values in columns.items()}
        times, drop, error = (rows.pop(name) for name in ("times", "drop", "error"))
        points.append(
            Point(changes, summary, times, drop, error, {name: row for name, row in rows.items() if row.size})
        )
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
        value, scatter = (f"{round(number, digits):.{max(digits, 0)}f}" for number in (self.value, self.scatter))
        return f"{value} ± {scatter}"

    def times(self, factor: float) -> Mean:
        """This mean multiplied by a positive number."""
        return Mean(self.value * factor, self.scatter * factor, self.count)

    @property
    def one_more(self) -> float:
        """Half width of the interval that holds the value of one more surface with a probability of 95 %."""
        if self.count < 2:
            return math.nan
        return float(stats.t.ppf(0.975, self.count - 1)) * self.scatter * math.sqrt(1 + 1 / self.count)


def mean(values: Iterable[float]) -> Mean:
    """Compute mean and standard deviation over surface seeds."""
    array = np.array(list(values), dtype=np.float64)
    scatter = float(array.std(ddof=1)) if array.size > 1 else math.nan
    return Mean(float(array.mean()), scatter, array.size)


def grouped(points: Iterable[Point], *paths: str) -> dict[tuple[Any, ...], list[Point]]:
    """Group the points with equal values at ``paths``, which differ in the surface seed, in order of appearance."""
    groups: dict[tuple[Any, ...], list[Point]] = {}
    for point in points:
        groups.setdefault(tuple(point.changes[path] for path in paths), []).append(point)
    return groups


def by(points: Iterable[Point], path: str) -> dict[Any, list[Point]]:
    """Group the points by their value at one ``path``, as :func:`grouped` does by several."""
    return {value: group for (value,), group in grouped(points, path).items()}


def curve(points: list[Point], quantity: Callable[[Point], np.ndarray]) -> np.ndarray:
    """Average an array over points; same shape."""
    return np.mean([quantity(point) for point in points], axis=0)


def spread(points: list[Point], quantity: Callable[[Point], np.ndarray]) -> np.ndarray:
    """Compute the standard deviation of an array between points; same shape, 0 for a single point."""
    values = np.array([quantity(point) for point in points])
    return values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1:])


def studies_of(points: Iterable[Point], targets: Iterable[str]) -> dict[str, list[Point]]:
    """Sort the points into the studies of ``targets``, in the order of each study, with seeds of one scene together."""
    by_content: dict[str, list[Point]] = {}
    for point in points:
        by_content.setdefault(content(point.changes), []).append(point)
    return {
        study: [
            point
            for member in members(study)
            for point in by_content[content(member)][: STUDIES[study].surfaces or None]
        ]
        for study in studies_for(targets)
    }
