"""The points of the studies in a form that figures and checks read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import chemage
from chemage_studies.reproduction.studies import TARGETS, members


@dataclass(frozen=True)
class Point:
    """One finished scene of a study."""

    #: dotted path -> value, as swept
    changes: dict[str, Any]
    #: the scene's summary: contact measures, β …
    summary: dict[str, Any]
    #: (m,) s
    hold_times: np.ndarray
    #: (m,) nN and its standard error over replicas
    friction_drop: np.ndarray
    friction_drop_stderr: np.ndarray
    observables: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, point: chemage.Point) -> Point:
        """From a finished point of a sweep."""
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
        """ΔF at the hold time nearest to ``time``, nN."""
        return float(self.friction_drop[self.index(time)])

    def index(self, time: float) -> int:
        """Position of the hold time nearest to ``time``."""
        return int(np.argmin(np.abs(np.log(self.hold_times) - np.log(time))))


@dataclass(frozen=True)
class Mean:
    """A number over surface seeds."""

    value: float
    #: standard deviation between seeds; nan for one
    scatter: float
    count: int

    @property
    def stderr(self) -> float:
        """Standard error of the mean; nan for one seed."""
        return self.scatter / self.count**0.5


def mean(values: Iterable[float]) -> Mean:
    """Mean and standard deviation between seeds."""
    found = np.array(list(values), dtype=np.float64)
    scatter = float(found.std(ddof=1)) if found.size > 1 else float("nan")
    return Mean(float(found.mean()), scatter, found.size)


def grouped(points: Iterable[Point], *paths: str) -> dict[tuple[Any, ...], list[Point]]:
    """Points with equal values at ``paths`` together (they differ in the surface's seed), in order of appearance."""
    groups: dict[tuple[Any, ...], list[Point]] = {}
    for point in points:
        groups.setdefault(tuple(point.changes[path] for path in paths), []).append(point)
    return groups


def curve(points: list[Point], quantity: Callable[[Point], np.ndarray]) -> np.ndarray:
    """Mean over seeds of an array each point has, same shape."""
    return np.mean([quantity(point) for point in points], axis=0)


def studies_of(points: Iterable[Point], targets: Iterable[str]) -> dict[str, list[Point]]:
    """The points of each study that ``targets`` need, in the study's order, the seeds of one scene together."""
    by_content: dict[str, list[Point]] = {}
    for point in points:
        by_content.setdefault(_content(point.changes), []).append(point)
    return {
        study: [point for member in members(study) for point in by_content[_content(member)]]
        for study in dict.fromkeys(study for target in targets for study in TARGETS[target])
    }


def _content(changes: dict[str, Any]) -> str:
    return repr(sorted((path, float(value)) for path, value in changes.items() if path != "surface.seed"))
