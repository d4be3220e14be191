"""A step of a programme, what drives its slider, and the role that gives the steps and says what they measure."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from chemage.plugin import (
    BondHistory,
    Choice,
    Component,
    Drive,
    Length,
    Output,
    PlottedResult,
    PullHistory,
    Pulling,
    Temperature,
    Time,
    Unit,
    UnitError,
    convert,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Speed = Annotated[Any, Unit("nm/s", ge=0)]
Humidity = Annotated[Any, Unit("", ge=0, lt=1)]
Stiffness = Annotated[Any, Unit("nN/nm", ge=0, words=("rigid",))]


def _force(value: Any) -> Any:
    try:
        return convert(value, "nN") if isinstance(value, str) else value
    except UnitError:
        return value  # a pressure, which is multiplied by the area of the surface


Load = Annotated[float | str, AfterValidator(_force)]
#: times of a rest that are recorded, per decade
PER_DECADE = 5
#: the part of a step, at its end, over which the steady force is a mean
LAST = 0.5


class Slider(Drive):
    """``[drive]``: what pulls at the contact in the steps with a speed, and how its bonds yield."""

    speed: Annotated[Any, Unit("nm/s", ge=0, le=0)] = 0.0
    """0; the steps have their own, nm/s"""
    engine: Choice[Pulling] = Field(default="event-driven", validate_default=True)  # pyright: ignore[reportAssignmentType]
    """the engine that pulls; default: event-driven"""

    def at(self, conditions: Conditions) -> Drive:
        """What pulls under these."""
        own = {name: getattr(self, name) for name in Drive.model_fields}
        own["speed"] = conditions.speed
        if (spring := conditions.spring) is not None:
            own["spring"] = None if spring == "rigid" else spring
        return Drive(**own)


class Towards(Component):
    """``{to = ...}``: what is reached at the end of a step, linearly in time."""

    to: Any


class ToTemperature(Towards):
    """``{to = "400 K"}``, followed exactly."""

    to: Temperature
    """K"""


class ToSpeed(Towards):
    """``{to = "1 um/s"}``, followed exactly."""

    to: Speed
    """nm/s"""


class ToLoad(Towards):
    """``{to = "80 nN"}``, followed in contacts at equal distances of the load."""

    to: Load
    """a force (nN) or a nominal pressure"""
    contacts: int = Field(default=8, ge=1, le=1000)
    """contacts that are solved; the error falls as their number squared; default: 8"""


class HistoryStep(Component):
    """``[[step]]``: what changes in one step; what is not said stays as in the step before."""

    duration: Time | None = None
    """how long it takes, s; default: the way of ``distance``"""
    distance: Length | None = None
    """by which the drive moves, nm; instead of ``duration``"""
    speed: Speed | ToSpeed | None = None
    """of the drive, nm/s, or ``{to = ...}``, a ramp; 0: it rests, and the bonds keep their stretch; first: it rests"""
    spring: Stiffness | None = None
    """stiffness of the spring that pulls the slider, nN/nm, or "rigid": the slider has the speed; first: that of
    ``[drive]``"""
    load: Load | ToLoad | None = None
    """a force (nN) or a nominal pressure, or ``{to = ...}``, a ramp; first: that of the scene"""
    temperature: Temperature | ToTemperature | None = None
    """K, or ``{to = ...}``, a ramp; first: that of ``[hold]``"""
    humidity: Humidity | None = None
    """relative humidity; first: that of ``[chemistry]``"""
    hardness_ratio: float | None = Field(default=None, gt=0, le=1)
    """hardness over that in ``[contact]``: where it falls, the contact creeps; first: 1"""
    points: int | None = Field(default=None, ge=1, le=100_000)
    """times that are recorded besides its beginning: at rest 5 per decade, counted back from the end; else evenly;
    default: 20 at rest, else 100"""


@dataclass(frozen=True)
class Conditions:
    """Of a contact at one time."""

    #: nN, or a pressure; None: of the scene
    load: Any = None
    #: K; None: of the scene
    temperature: float | None = None
    #: None: of the chemistry
    humidity: float | None = None
    #: nm/s
    speed: float = 0.0
    #: nN/nm, or "rigid"; None: of the drive
    spring: float | str | None = None
    #: hardness over that of the scene
    hardness_ratio: float = 1.0


@dataclass(frozen=True)
class Segment:
    """A step with all its conditions."""

    #: (m,) s since the contact was made; the first is its beginning, just after what changes
    times: np.ndarray
    #: at its beginning
    first: Conditions
    #: at its end, to which temperature, speed and load go linearly in time
    last: Conditions
    #: by how many contacts the load changes; 0: it stays
    contacts: int = 0

    @property
    def driven(self) -> bool:
        """Whether the drive moves."""
        return self.first.speed + self.last.speed > 0

    def along(self, name: str, times: Any, otherwise: float = 0.0) -> np.ndarray:
        """A condition at ``times`` (s); ``otherwise`` where it has no value."""
        first, last = getattr(self.first, name), getattr(self.last, name)
        first = otherwise if first is None else first
        last = first if last is None else last
        begin, end = self.times[[0, -1]]
        return first + (last - first) * ((times - begin) / ((end - begin) or 1.0))

    def parts(self, kelvin: float) -> Iterator[Segment]:
        """Those with one contact each, the first and the last half as long; their last time is none of the whole. The
        step itself where its load stays. ``kelvin``: temperature where it has none."""
        if not self.contacts:
            yield self
            return
        begin, end = self.times[[0, -1]]
        edges = (np.arange(-1, self.contacts + 1) + 0.5) / self.contacts
        edges = begin + (end - begin) * edges.clip(0, 1)
        number = np.searchsorted(edges[1:], self.times)
        ends = [
            replace(
                self.last,
                temperature=float(self.along("temperature", time, kelvin)),
                speed=float(self.along("speed", time)),
            )
            for time in edges
        ]
        for part, until in enumerate(edges[1:]):
            times = np.append(self.times[number == part], until)
            yield Segment(times, ends[part], ends[part + 1])


def segments(steps: Sequence[HistoryStep]) -> Iterator[Segment]:
    """Every step with what it has from those before.

    Raises
    ------
    ValueError
        A step has no duration, or no speed for its distance.
    """
    begin, last = 0.0, Conditions()
    for number, step in enumerate(steps):
        said = {
            one.name: value
            for one in fields(Conditions)
            if (value := getattr(step, one.name)) is not None
        }
        ramps = {
            name: at.to for name, at in said.items() if isinstance(at, Towards)
        }
        first = replace(last, **{k: v for k, v in said.items() if k not in ramps})
        last = replace(first, **ramps)
        if (step.duration is None) == (step.distance is None):
            raise ValueError(f"step {number}: give either duration or distance")
        speed = (first.speed + last.speed) / 2
        if step.distance is not None and not speed:
            raise ValueError(f"step {number}: a distance needs a speed")
        span = step.distance / speed if step.distance else step.duration or 0.0
        points = step.points or (100 if speed else 20)
        if speed:
            passed = np.linspace(0.0, span, points + 1)
        else:
            back = np.arange(points, 0, -1) - 1
            passed = np.append(0.0, span * 10.0 ** (-back / PER_DECADE))
        contacts = getattr(step.load, "contacts", 0)
        yield Segment(begin + passed, first, last, contacts)
        begin += span
        if not math.isfinite(begin):
            raise ValueError(f"step {number}: ends beyond the range of numbers")


class Measure(NamedTuple):
    """A number that a protocol measures on one replica."""

    name: str
    value: float
    unit: str
    meaning: str
    #: the steady means on which it rests, see :class:`chemage.plugin.Output`
    rests: tuple[str, ...] = ()


@dataclass(frozen=True)
class StepOutcome:
    """What a replica did in one step."""

    segment: Segment
    #: (m,)
    bonds: np.ndarray
    #: (m,) nN, of the drive, and nm, of the slider since it was first pulled; 0 before
    force: np.ndarray
    slider: np.ndarray
    #: largest force of this step, nN, and way of the slider in it to there, nm
    peak: float
    peak_at: float
    #: smallest force of this step, nN
    least: float
    #: mean force over the last half of the step, nN; at rest that at its end
    steady: float
    #: that over the second half of this window less that over the first, nN; nan where fewer than 4 points are recorded
    change: float
    #: bonds formed in this window
    formed: float
    #: share of one bond in its mean force, nN, that is not exceeded
    per_bond: float
    #: of the drive in this step, nN nm
    work: float
    #: bonds of sites that left the contact as the load changed
    lost: int = 0
    #: bonds at its end on the sites of the first contact
    old: int = 0

    @classmethod
    def of(
        cls,
        segment: Segment,
        history: BondHistory | PullHistory | None = None,
        energy: float = 0.0,
        **counts: int,
    ) -> Self:
        """That of a ``history``; without one nothing happened, and at rest nothing was pulled. ``energy``: that no bond
        exceeds before it breaks, nN nm."""
        none = np.zeros(segment.times.size)
        names = "bonds", "force", "displacement", "work", "formed"
        bonds, force, slider, work, formed = (
            getattr(history, name, none) for name in names
        )
        last = -1 - max(1, round(LAST * (none.size - 1)))

        def way(first: int, end: int) -> float:
            since, until = segment.times[[first, end]]
            speed = segment.along("speed", (since + until) / 2)
            return float(speed * (until - since))

        def mean(first: int, end: int) -> float:
            passed = way(first, end)
            return float((work[end] - work[first]) / passed if passed else math.nan)

        middle = (last - 1) // 2
        return cls(
            segment,
            bonds,
            force,
            slider,
            getattr(history, "peak", 0.0),
            getattr(history, "peak_displacement", 0.0) - float(slider[0]),
            getattr(history, "least", 0.0),
            mean(last, -1) if way(last, -1) else float(force[-1]),
            mean(middle, -1) - mean(last, middle),
            float(formed[-1] - formed[last]),
            energy / (way(last, -1) or math.inf),
            float(work[-1] - work[0]),
            **counts,
        )


class Protocol(Component, ABC):
    """Role ``protocol``: the steps of an experiment, and what they measure."""

    role = "protocol"
    figures: ClassVar[Mapping[str, str]] = {
        "programme": "The programme above; below it force and bonds, means over replicas, on one time axis: logarithmic "
        "within holds.",
    }

    @model_validator(mode="after")
    def _complete(self) -> Self:
        tuple(segments(self.expand()))
        return self

    @abstractmethod
    def expand(self) -> Sequence[HistoryStep]:
        """The steps, one at least."""

    @property
    def outputs(self) -> Mapping[str, Output]:
        """What it measures: name -> unit and meaning."""
        still = [StepOutcome.of(one) for one in segments(self.expand())]
        return {
            one.name: Output((), one.unit, one.meaning, one.rests)
            for one in self.measure(still)
        }

    def measure(self, steps: Sequence[StepOutcome]) -> Iterable[Measure]:
        """What one replica measures, from what it did in each step; of every replica the same names."""
        return ()

    def draw(
        self, figure: str, axes: Axes, results: Sequence[PlottedResult]
    ) -> None:
        """Draw the programme and what came of it."""
        from chemage_history.drawing import draw_programme

        draw_programme(axes, results)
