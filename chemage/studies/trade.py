"""The map of speed against accuracy of a scene: what each setting and each combination of settings costs and how large
its errors are, and the file in which this is kept. Means over surfaces choose settings by it."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, TypeAdapter

from chemage.foundation.container import read_json, sealed_json
from chemage.foundation.errors import DamagedError, InputError, StoreError
from chemage.foundation.files import write_file
from chemage.foundation.machine import processor
from chemage.foundation.records import content_hash
from chemage.foundation.statistics import NORMAL_LIMIT, student_limit
from chemage.foundation.text import jsonable
from chemage.foundation.threads import processors
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene

FORMAT = 1
#: a number that is null in a file where it is not known
Known = Annotated[
    float, BeforeValidator(lambda value: math.nan if value is None else value)
]


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

    #: what is chosen by a coarser grid of the contact
    GRID: ClassVar[str] = "grid of the contact"
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

    @property
    def grid_only(self) -> bool:
        """Whether the grid is all that is not as in the scene."""
        return {*self.choices} <= {self.GRID}

    @staticmethod
    def of_ageing(observable: str) -> bool:
        """Whether an observable depends on the ageing; all others are of the contact alone."""
        return observable.partition("@")[0] in ("beta", "friction_drop")

    def deviation(self, observable: str) -> Deviation:
        """The error of an observable."""
        return Deviation(*self.differences.get(observable, (math.nan, math.nan, 0)))

    def seconds(self, observable: str = "beta") -> float:
        """Median CPU seconds of what an observable needs: of an observable of the contact, the contact alone."""
        contact = statistics.median(self.contact_seconds)
        return contact + (
            statistics.median(self.ageing_seconds)
            if self.of_ageing(observable)
            else 0.0
        )

    def spread(self, observable: str = "beta") -> float:
        """Half the range of the middle half of the repeated timings, CPU seconds."""
        seconds = np.array(self.contact_seconds)
        if self.of_ageing(observable):
            seconds = seconds + self.ageing_seconds
        low, high = np.percentile(seconds, [25, 75])
        return 0.5 * float(high - low)


@dataclass
class TradeMap:
    """What was measured of the settings of a scene and of their combinations."""

    #: the scene, see :meth:`Scene.todict`
    scene: dict[str, Any]
    #: content hash of what the scene asks but for seeds, replicas, goals and observables, which change neither costs
    #: per replica nor errors of its settings
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

    @classmethod
    def measured(cls, scene: Scene, **found: Any) -> Self:
        """What was ``found`` of a scene in this process."""
        return cls(
            scene=scene.todict(),
            question=_question(scene),
            versions=versions(scene),
            machine={"processor": processor(), "processors": processors()},
            replicas=scene.hold.replicas if scene.ages and scene.hold else 0,
            **found,
        )

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
            ageing / self.replicas
            if point.replicates and self.replicas
            else ageing,
        )

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        return jsonable(asdict(self))

    @classmethod
    def fromdict(cls, data: Mapping[str, Any]) -> Self:
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
    def read(cls, path: str | Path) -> Self:
        """Read what :meth:`write` wrote.

        Raises
        ------
        StoreError
            There is no such file, or it is no map.
        DamagedError
            It is not what was written.
        """
        remedy = f"`chemage tradeoff SCENE -o {path}` writes one"
        try:
            content = read_json(path)
        except DamagedError:
            raise
        except StoreError as error:
            raise StoreError(f"cannot read the map: {error}; {remedy}") from error
        if content.pop("trade_map", None) != FORMAT:
            raise StoreError(f"{path} is no map; {remedy}")
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
        if self.question != _question(scene):
            other = (
                f" ({self.name})"
                if self.name != scene.name
                else ", which has changed since"
            )
            raise InputError(
                f"{name}: was measured on another scene{other}; {again}"
            )
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


def _question(scene: Scene) -> str:
    return content_hash(
        scene.bare(seed=0).model_copy(update={"surface_seed": 0}).keys()["result"]
    )
