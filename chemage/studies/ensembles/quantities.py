"""A sample, and its quantities as one row of numbers, so that all of them are averaged and judged in the same way."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.fitting import few_hold_times, line_slopes
from chemage.foundation.checks import within
from chemage.foundation.codec import from_json
from chemage.foundation.errors import InputError, nearest
from chemage.foundation.records import merged_approximations
from chemage.scene.scene import Scene
from chemage.studies.tasks import Outcome

#: quantities that are a curve over hold times
CURVES = ("friction_drop", "friction_coefficient_drop")
#: measures of a contact that are the same on every surface, and so no quantities of an ensemble
_GIVEN = {"load", "modulus", "nominal_area", "nominal_pressure"}


@dataclass(frozen=True)
class Sample:
    """What one computation on one surface gives."""

    #: nN, (replicas, m); (0, 0) without ageing
    friction_drop: np.ndarray
    #: measures of the contact
    measures: Mapping[str, float]
    #: plugins that answered or changed a stage: name -> source
    plugins: Mapping[str, str] = field(default_factory=dict)
    #: as in :mod:`chemage.foundation.records`
    approximate: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def of(cls, outcome: Outcome) -> Sample:
        """The sample that a task gave.

        Raises
        ------
        InputError
            The friction is not finite.
        """
        if outcome.run is not None:
            contact, aging = outcome.run.contact, outcome.run.aging
            measures, plugins = contact.summary(), outcome.run.plugins
            approximate = merged_approximations(contact.approximate, aging.approximate if aging is not None else ())
        else:
            assert outcome.content is not None
            content = outcome.content
            aging = from_json(Aging, content["aging"]) if content["aging"] else None
            measures, plugins = content["summary"], content["plugins"]
            approximate = content.get("approximate", ()) if aging is None else aging.approximate
        numbers = {name: float(value) for name, value in measures.items() if _is_number(value)}
        if aging is None:
            return cls(np.zeros((1, 0)), numbers, plugins, approximate)
        drop = np.asarray(aging.friction_drop, dtype=np.float64)
        if not np.isfinite(drop).all():
            raise InputError("friction_drop: has numbers that are not finite; see `chemage run` of one surface")
        return cls(drop, numbers, plugins, approximate)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


@dataclass(frozen=True)
class Quantities:
    """The columns of a row: β where it can be fitted, ΔF at every hold time, the measures of the contact."""

    #: (m,) s
    hold_times: np.ndarray
    load: float
    window: tuple[float, float]
    measures: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, measures: Sequence[str]) -> Quantities:
        """Those of a scene, whose contacts have ``measures``."""
        times = scene.hold.hold_times if scene.ages and scene.hold is not None else np.zeros(0)
        names = tuple(name for name in measures if name not in _GIVEN)
        return cls(times, scene.load, (scene.fit.start, scene.fit.stop), names)

    @property
    def fitted(self) -> np.ndarray:
        """(m,) bool: hold times of the fit."""
        return within(self.hold_times, self.window) & (self.hold_times > 0)

    @property
    def span(self) -> tuple[float, float]:
        """First and last hold time of the fit, s."""
        return float(self.hold_times[self.fitted].min()), float(self.hold_times[self.fitted].max())

    @property
    def doubt(self) -> str:
        """That the fit has too few hold times; "" where it has not, and without one."""
        return few_hold_times(int(self.fitted.sum()), self.span) if self.has_beta else ""

    @property
    def has_beta(self) -> bool:
        """Whether β can be fitted: a line needs two points."""
        return self.load > 0 and np.unique(self.hold_times[self.fitted]).size >= 2

    @property
    def names(self) -> list[str]:
        """What can be asked for."""
        curves = list(CURVES if self.load > 0 else CURVES[:1]) if self.hold_times.size else []
        return [*(["beta"] if self.has_beta else []), *curves, *self.measures]

    @property
    def count(self) -> int:
        """Number of columns."""
        return int(self.has_beta) + self.hold_times.size + len(self.measures)

    def row(self, sample: Sample) -> np.ndarray:
        """(count,) of one sample, the mean over its replicas; nan where a measure does not exist."""
        return self._rows(sample.friction_drop.mean(axis=0)[None], sample.measures)[0]

    def replica_rows(self, sample: Sample) -> np.ndarray:
        """(replicas, count): of each replica."""
        return self._rows(sample.friction_drop, sample.measures)

    def _rows(self, drop: np.ndarray, measures: Mapping[str, float]) -> np.ndarray:
        parts = [drop, np.tile([measures.get(name, math.nan) for name in self.measures], (len(drop), 1))]
        if self.has_beta:
            parts.insert(0, (self.slope(drop) / self.load)[:, None])
        return np.concatenate(parts, axis=1)

    def slope(self, curves: np.ndarray) -> np.ndarray:
        """(n,) rise per decade of the least-squares line through each of ``curves`` (n, m) over the window: the fit of
        β, which is linear in the curve, so that its mean is that of the mean curve."""
        return line_slopes(self.hold_times, curves, self.window)

    def column(self, name: str, time: float | None = None) -> int:
        """The column of a quantity; of a curve at ``time`` (s), or at the last hold time.

        Raises
        ------
        InputError
            There is no such quantity, or ``time`` is not a hold time.
        """
        if name not in self.names:
            raise InputError(
                f"accuracy.{name}: no such quantity{nearest(name, self.names)}; this scene has {', '.join(self.names)}"
            )
        first = int(self.has_beta)
        if name in CURVES:
            return first + self._moment(name, time)
        if time is not None:
            raise InputError(f"accuracy.{name}: does not depend on the hold time; leave out the part after @")
        return 0 if name == "beta" else first + self.hold_times.size + self.measures.index(name)

    def _moment(self, name: str, time: float | None) -> int:
        if time is None:
            return self.hold_times.size - 1
        distance = np.abs(self.hold_times - time)
        number = int(distance.argmin())
        if distance[number] > 1e-6 * time:
            raise InputError(
                f"accuracy.{name}@{time:g} s: is not one of the hold times; the nearest is "
                f"{self.hold_times[number]:.6g} s; change [hold], or ask at that time"
            )
        return number
