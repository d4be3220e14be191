"""The map of speed against accuracy as users have it: its fronts, and the cheapest settings for an accuracy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from chemage.plugin import TradeMap, TradePoint, statistics, text
from chemage_trade.choices import pasted

#: the accuracies for which the cheapest settings are named
WITHIN = (0.1, 0.03, 0.01, 0.003)
#: observables of the ageing: β, and the friction drop at hold times
BETA, DROP = "beta", "friction_drop"
#: distance of the distribution of pressure from that of the reference over the mean pressure
DISTRIBUTION = "pressure_distribution"
#: measures of the contact that are shown
SHOWN_MEASURES = ("corrected_area", DISTRIBUTION, "patches", "perimeter_to_area")
#: observable -> what it is, in words
WORDS = {
    BETA: "β",
    "corrected_area": "corrected contact area",
    DISTRIBUTION: "distribution of pressure",
    "patches": "number of patches",
    "perimeter_to_area": "perimeter over area",
}
#: replicas that are thought of
MOST_REPLICAS = 100_000


def words(observable: str) -> str:
    """An observable in words."""
    name, _, time = observable.partition("@")
    if name == DROP:
        return f"ΔF at {text.power_text(float(time.removesuffix(' s')))} s"
    return WORDS.get(name, name.replace("_", " "))


@dataclass(frozen=True)
class Cheapest:
    """The cheapest settings within an accuracy."""

    observable: str
    within: float
    #: None: none was found
    point: TradePoint | None
    #: replicas that the accuracy needs; None where there are none, or their number does not matter
    replicas: int | None = None
    seconds: float = math.nan
    #: relative, 95 %: of all, of the settings, and of the replicas
    error: float = math.nan
    settings_error: float = math.nan
    replicas_error: float = 0.0
    #: the smallest error of the settings that was found
    best: float = math.nan

    @property
    def options(self) -> str:
        """The settings as options of the command line; "" where the scene has them."""
        if self.point is None:
            return ""
        more = {"hold.replicas": self.replicas} if self.replicas is not None else {}
        return pasted({**self.point.changes, **more})

    def text(self, wider: Sequence[float] = ()) -> str:
        """What was found, in words; ``wider`` are accuracies for which it is the cheapest as well."""
        within = " and ".join(
            filter(
                None,
                [
                    ", ".join(f"{100 * accuracy:.2g}" for accuracy in wider),
                    f"{100 * self.within:.2g}",
                ],
            )
        )
        if self.point is None:
            best = (
                f"; the best is known to {text.percent(self.best)}"
                if math.isfinite(self.best)
                else ""
            )
            if self.best < self.within:
                best = f" with at most {MOST_REPLICAS:,} replicas"
            return f"within {within} %: none found{best}"
        parts = f"settings {text.percent(self.settings_error)}, replicas {text.percent(self.replicas_error)}"
        error = f"error {text.percent(self.error)}" + (
            f" ({parts})" if self.replicas_error else ""
        )
        how = self.options or "as the scene is"
        return f"within {within} %: {self.seconds:.2g} CPU s, {error}: {how}"

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        return text.jsonable(
            {
                "observable": self.observable,
                "within": self.within,
                "found": self.point is not None,
                "options": self.options,
                "cpu_seconds": self.seconds,
                "error": self.error,
                "settings_error": self.settings_error,
                "replicas_error": self.replicas_error,
                "replicas": self.replicas,
                "best": self.best,
            }
        )


@dataclass
class Tradeoff(TradeMap):
    """What was measured of the settings of a scene and of their combinations, and which of them pay."""

    def of(self, observable: str) -> list[TradePoint]:
        """The points that can be compared at an observable: for one of the contact, those that differ there."""
        points = [
            point
            for point in self.points
            if not math.isnan(point.deviation(observable).bound)
        ]
        return (
            points
            if TradePoint.of_ageing(observable)
            else [point for point in points if point.contact_only]
        )

    def front(self, observable: str) -> list[TradePoint]:
        """The Pareto front, from fast to accurate: no other point is both faster and more accurate."""
        return pareto(
            self.of(observable),
            lambda point: (
                point.seconds(observable),
                point.deviation(observable).bound,
            ),
        )

    def marked(self) -> Tradeoff:
        """The same with the front of every observable marked in the points."""
        fronts = {name: list(map(id, self.front(name))) for name in self.observables}
        points = [
            replace(
                point,
                front=[name for name, front in fronts.items() if id(point) in front],
            )
            for point in self.points
        ]
        return replace(self, points=points)

    def cheapest(self, observable: str, within: float) -> Cheapest:
        """The settings that give an observable of one surface within an accuracy at the least cost, with as many
        replicas as that needs."""
        least: Cheapest | None = None
        best = math.inf
        for point in self.of(observable):
            bound = point.deviation(observable).bound
            best = min(best, bound)
            if bound >= within:
                continue
            candidate = self._with_replicas(point, observable, within, bound)
            if candidate is not None and (
                least is None or candidate.seconds < least.seconds
            ):
                least = candidate
        return least or Cheapest(observable, within, None, best=best)

    def _with_replicas(
        self, point: TradePoint, observable: str, within: float, bound: float
    ) -> Cheapest | None:
        contact, replica = self.seconds_of(point)
        if not TradePoint.of_ageing(observable):
            return Cheapest(observable, within, point, None, contact, bound, bound)
        if not point.replicates:
            return Cheapest(
                observable, within, point, None, contact + replica, bound, bound
            )
        scatter = point.scatter.get(observable, math.nan)
        if not math.isfinite(scatter):
            return None
        count = max(
            2,
            math.ceil(
                (statistics.NORMAL_LIMIT * scatter) ** 2 / (within**2 - bound**2)
            ),
        )
        if count > MOST_REPLICAS:
            return None
        noise = statistics.NORMAL_LIMIT * scatter / math.sqrt(count)
        seconds = contact + replica * count
        return Cheapest(
            observable,
            within,
            point,
            count,
            seconds,
            math.hypot(bound, noise),
            bound,
            noise,
        )

    def sentences(self) -> dict[str, list[str]]:
        """Observable -> the cheapest settings within each of the accuracies, in words."""
        texts: dict[str, list[str]] = {}
        for name in self.observables:
            found = [self.cheapest(name, within) for within in WITHIN]
            texts[name] = []
            for _, same in groupby(
                found, key=lambda one: (id(one.point), one.replicas)
            ):
                *wider, last = same
                texts[name].append(last.text([one.within for one in wider]))
        return texts

    def summary(self) -> dict[str, Any]:
        """One JSON-able object: the map, and the cheapest settings within each of the accuracies."""
        cheapest = [
            self.cheapest(name, within).todict()
            for name in self.observables
            for within in WITHIN
        ]
        return {
            "scene": self.name,
            "notes": self.notes,
            "map": self.todict(),
            "cheapest": cheapest,
            "sentences": self.sentences(),
        }


def pareto(points: Sequence[Any], of: Any) -> list[Any]:
    """The points on the front, from fast to accurate; ``of`` gives (cost, error)."""
    front, least = [], math.inf
    for point in sorted(points, key=of):
        error = of(point)[1]
        if error < least:
            front.append(point)
            least = error
    return front
