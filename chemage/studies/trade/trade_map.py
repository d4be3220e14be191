"""The map of speed against accuracy of a scene: what each setting and each combination of settings costs and how large
its errors are, the cheapest ones, and the file in which this is kept."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, TypeAdapter

from chemage.foundation.container import read_json, sealed_json
from chemage.foundation.errors import DamagedError, InputError, StoreError
from chemage.foundation.files import write_file
from chemage.foundation.machine import processor
from chemage.foundation.statistics import NORMAL_LIMIT, student_limit
from chemage.foundation.text import jsonable, percent, power_text
from chemage.foundation.threads import processors
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene, question
from chemage.studies.trade.choices import DISTRIBUTION, pasted

#: the accuracies for which the cheapest settings are named
WITHIN = (0.1, 0.03, 0.01, 0.003)
#: observables of the ageing; all others are of the contact alone
BETA, DROP = "beta", "friction_drop"
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
FORMAT = 1
#: a number that is null in a file where it is not known
Known = Annotated[
    float, BeforeValidator(lambda value: math.nan if value is None else value)
]


def words(observable: str) -> str:
    """An observable in words."""
    name, _, time = observable.partition("@")
    if name == DROP:
        return f"ΔF at {power_text(float(time.removesuffix(' s')))} s"
    return WORDS.get(name, name.replace("_", " "))


def of_ageing(observable: str) -> bool:
    """Whether an observable depends on the ageing."""
    return observable.partition("@")[0] in (BETA, DROP)


@dataclass(frozen=True)
class Deviation:
    """A mean paired difference from the reference, relative to the value of the reference."""

    value: float
    #: standard error; 0 where all differences are equal, nan where there is only one
    stderr: float
    #: its degrees of freedom
    freedom: int

    @property
    def half_width(self) -> float:
        """Half the width of the 95 % interval of the difference."""
        if not self.stderr > 0:
            return self.stderr
        return self.stderr * student_limit(self.freedom)

    @property
    def bound(self) -> float:
        """The error is at most so large, with 95 % confidence; nan where that is not known."""
        return abs(self.value) + self.half_width

    @property
    def resolved(self) -> bool:
        """Whether the difference is larger than its own error."""
        return abs(self.value) > self.half_width

    @property
    def size(self) -> float:
        """The standard error that stands for this difference where it is not corrected."""
        return math.hypot(self.value, self.half_width / NORMAL_LIMIT)


@dataclass(frozen=True)
class TradePoint:
    """One setting, or a combination of them, as it was measured."""

    #: what is chosen -> value, without what is as in the scene
    choices: dict[str, str]
    #: the same as changes to the scene: dotted path -> value
    changes: dict[str, Any]
    #: CPU seconds of surface and contact, and of the ageing of all replicas, in each round
    contact_seconds: list[float]
    ageing_seconds: list[float]
    #: observable -> (difference, standard error, degrees of freedom), see :class:`Deviation`
    differences: dict[str, tuple[Known, Known, int]]
    #: observable -> mean value over the rounds
    values: dict[str, Known]
    #: observable of the ageing -> standard deviation between replicas over the mean
    scatter: dict[str, Known]
    #: whether only the contact differs from that of the scene
    contact_only: bool = True
    #: whether each replica has a scatter of its own, and takes its own time
    replicates: bool = True
    #: declared not to change what is computed but for noise
    exact: bool = False
    own: bool = False
    #: the observables on whose Pareto front this is
    front: list[str] = field(default_factory=list)
    remark: str = ""

    @property
    def words(self) -> str:
        """The settings in words."""
        return (
            ", ".join(f"{knob} {label}" for knob, label in self.choices.items())
            or "as in the scene"
        )

    def deviation(self, observable: str) -> Deviation:
        """The error of an observable."""
        return Deviation(*self.differences.get(observable, (math.nan, math.nan, 0)))

    def seconds(self, observable: str = BETA) -> float:
        """Median CPU seconds of what an observable needs: of an observable of the contact, the contact alone."""
        contact = statistics.median(self.contact_seconds)
        return contact + (
            statistics.median(self.ageing_seconds) if of_ageing(observable) else 0.0
        )

    def spread(self, observable: str = BETA) -> float:
        """Half the range of the middle half of the repeated timings, CPU seconds."""
        seconds = np.array(self.contact_seconds)
        if of_ageing(observable):
            seconds = seconds + self.ageing_seconds
        low, high = np.percentile(seconds, [25, 75])
        return 0.5 * float(high - low)


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
                f"; the best is known to {percent(self.best)}"
                if math.isfinite(self.best)
                else ""
            )
            if self.best < self.within:
                best = f" with at most {MOST_REPLICAS:,} replicas"
            return f"within {within} %: none found{best}"
        parts = f"settings {percent(self.settings_error)}, replicas {percent(self.replicas_error)}"
        error = f"error {percent(self.error)}" + (
            f" ({parts})" if self.replicas_error else ""
        )
        how = self.options or "as the scene is"
        return f"within {within} %: {self.seconds:.2g} CPU s, {error}: {how}"

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        return jsonable(
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
class TradeMap:
    """What was measured of the settings of a scene and of their combinations."""

    #: the scene, see :meth:`Scene.todict`
    scene: dict[str, Any]
    #: content hash of what the scene asks, see :func:`chemage.scene.scene.question`
    question: str
    versions: dict[str, str]
    machine: dict[str, Any]
    #: repetitions, each on another surface where the surface is random
    rounds: int
    random: bool
    replicas: int
    #: observables that are shown
    observables: list[str]
    #: observable -> standard deviation between surfaces over the mean, with the settings of the scene
    surface_scatter: dict[str, Known] = field(default_factory=dict)
    points: list[TradePoint] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The name of the scene."""
        return str(self.scene.get("name", "scene"))

    @property
    def own(self) -> TradePoint | None:
        """The settings of the scene."""
        return next((point for point in self.points if point.own), None)

    def seconds_of(self, point: TradePoint) -> tuple[float, float]:
        """Median CPU seconds of the contact, and of one replica; of all ageing where replicas are not computed."""
        contact = statistics.median(point.contact_seconds)
        ageing = statistics.median(point.ageing_seconds)
        return (
            contact,
            ageing / self.replicas if point.replicates and self.replicas else ageing,
        )

    def of(self, observable: str) -> list[TradePoint]:
        """The points that can be compared at an observable: for one of the contact, those that differ there."""
        points = [
            point
            for point in self.points
            if not math.isnan(point.deviation(observable).bound)
        ]
        return (
            points
            if of_ageing(observable)
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

    def marked(self) -> TradeMap:
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
        if not of_ageing(observable):
            return Cheapest(observable, within, point, None, contact, bound, bound)
        if not point.replicates:
            return Cheapest(
                observable, within, point, None, contact + replica, bound, bound
            )
        scatter = point.scatter.get(observable, math.nan)
        if not math.isfinite(scatter):
            return None
        count = max(
            2, math.ceil((NORMAL_LIMIT * scatter) ** 2 / (within**2 - bound**2))
        )
        if count > MOST_REPLICAS:
            return None
        noise = NORMAL_LIMIT * scatter / math.sqrt(count)
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

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        return jsonable(asdict(self))

    @classmethod
    def fromdict(cls, data: Mapping[str, Any]) -> TradeMap:
        """The inverse of :meth:`todict`."""
        return TypeAdapter(cls).validate_python(data)

    # -- the file -----------------------------------------------------------------------------------------------------

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write this into a JSON file with a checksum.

        Raises
        ------
        StoreError
            It cannot be written, or exists and ``force`` is false.
        """
        write_file(
            path,
            sealed_json({"trade_map": FORMAT, **self.todict()}, indent=1),
            force=force,
        )

    @classmethod
    def read(cls, path: str | Path) -> TradeMap:
        """Read what :meth:`write` wrote.

        Raises
        ------
        StoreError
            There is no such file, or it is no map.
        DamagedError
            It is not what was written.
        """
        try:
            content = read_json(path)
        except DamagedError:
            raise
        except StoreError as error:
            raise StoreError(
                f"cannot read the map: {error}; `chemage tradeoff SCENE -o {path}` writes one"
            ) from error
        if content.pop("trade_map", None) != FORMAT:
            raise StoreError(
                f"{path} is no map; `chemage tradeoff SCENE -o {path}` writes one"
            )
        try:
            return cls.fromdict(content)
        except (KeyError, TypeError, ValueError) as error:
            raise DamagedError(f"{path} is damaged: {error}") from error

    def check(self, scene: Scene, name: str = "map") -> None:
        """Refuse to serve another scene, or other versions.

        Raises
        ------
        InputError
            With what differs.
        """
        again = f"measure it again: chemage tradeoff {scene.name} -o {name} --force"
        if self.question != question(scene):
            other = (
                f" ({self.name})"
                if self.name != scene.name
                else ", which has changed since"
            )
            raise InputError(f"{name}: was measured on another scene{other}; {again}")
        now = versions(scene)
        changed = [
            f"{key} {self.versions.get(key, 'none')} instead of {now.get(key, 'none')}"
            for key in sorted({*now, *self.versions} - {"processor"})
            if now.get(key) != self.versions.get(key)
        ]
        if changed:
            raise InputError(
                f"{name}: was measured with other versions: {', '.join(changed)}; {again}"
            )


def pareto(points: Sequence[Any], of: Any) -> list[Any]:
    """The points on the front, from fast to accurate; ``of`` gives (cost, error)."""
    front, least = [], math.inf
    for point in sorted(points, key=of):
        error = of(point)[1]
        if error < least:
            front.append(point)
            least = error
    return front


def machine() -> dict[str, Any]:
    """The machine on which times are measured."""
    return {"processor": processor(), "processors": processors()}
