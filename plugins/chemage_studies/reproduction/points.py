"""The points of the studies, and their means over surface seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import stats

import chemage
from chemage.plugin import FIT_WINDOW, text
from chemage_studies.reproduction.studies import STUDIES, content, members, studies_for

SLOPE, SEED, LOAD, VOLUME = "surface.rms_slope", "surface.seed", "contact.load", "chemistry.activation_volume"
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


@dataclass(frozen=True)
class Mean:
    """Mean and scatter of a number over surface seeds."""

    value: float
    #: standard deviation between seeds; nan for a single seed
    scatter: float
    count: int

    def __str__(self) -> str:
        return text.plus_minus(self.value, self.scatter)

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
    found = np.array(list(values), dtype=np.float64)
    scatter = float(found.std(ddof=1)) if found.size > 1 else math.nan
    return Mean(float(found.mean()), scatter, found.size)


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
