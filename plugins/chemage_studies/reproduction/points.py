"""The points of the studies, and their means over surface seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import chemage
from chemage.foundation.text import plus_minus
from chemage_studies.reproduction.studies import TARGETS, members


@dataclass(frozen=True)
class Point:
    """A completed point of a study."""

    #: the swept fields: dotted path -> value
    changes: dict[str, Any]
    #: summary of the run, see :meth:`chemage.Run.summary`
    summary: dict[str, Any]
    #: s, (m,)
    hold_times: np.ndarray
    #: ΔF and its standard error over replicas, nN, (m,)
    friction_drop: np.ndarray
    friction_drop_stderr: np.ndarray
    observables: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, point: chemage.Point) -> Point:
        """Read a completed point of a sweep."""
        aging = point.aging()
        return cls(
            point.values,
            point.summary,
            aging.hold_times,
            aging.mean_friction_drop,
            aging.friction_drop_stderr,
            dict(aging.observables),
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


@dataclass(frozen=True)
class Mean:
    """Mean and scatter of a number over surface seeds."""

    value: float
    #: standard deviation between seeds; nan for a single seed
    scatter: float
    count: int

    def __str__(self) -> str:
        return plus_minus(self.value, self.scatter)


def mean(values: Iterable[float]) -> Mean:
    """Compute mean and standard deviation over surface seeds."""
    found = np.array(list(values), dtype=np.float64)
    scatter = float(found.std(ddof=1)) if found.size > 1 else float("nan")
    return Mean(float(found.mean()), scatter, found.size)


def grouped(points: Iterable[Point], *paths: str) -> dict[tuple[Any, ...], list[Point]]:
    """Group the points with equal values at ``paths``, which differ in the surface seed, in order of appearance."""
    groups: dict[tuple[Any, ...], list[Point]] = {}
    for point in points:
        groups.setdefault(tuple(point.changes[path] for path in paths), []).append(point)
    return groups


def curve(points: list[Point], quantity: Callable[[Point], np.ndarray]) -> np.ndarray:
    """Average an array over points; same shape."""
    return np.mean([quantity(point) for point in points], axis=0)


def studies_of(points: Iterable[Point], targets: Iterable[str]) -> dict[str, list[Point]]:
    """Sort the points into the studies of ``targets``, in the order of each study, with seeds of one scene together."""
    by_content: dict[str, list[Point]] = {}
    for point in points:
        by_content.setdefault(_content(point.changes), []).append(point)
    return {
        study: [point for member in members(study) for point in by_content[_content(member)]]
        for study in dict.fromkeys(study for target in targets for study in TARGETS[target])
    }


def _content(changes: dict[str, Any]) -> str:
    return repr(sorted((path, float(value)) for path, value in changes.items() if path != "surface.seed"))
