"""A step of a programme, what drives its slider, and the role that gives the steps and says what they measure."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeAlias

import numpy as np
from pydantic import Field, field_validator

from chemage import InputError
from chemage.plugin import (
    BondHistory,
    Choice,
    Component,
    Drive,
    Length,
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
#: name, value, unit and meaning of a number
Measure: TypeAlias = tuple[str, float, str, str]
Stiffness = Annotated[Any, Unit("nN/nm", ge=0, words=("rigid",))]
#: times of a rest that are recorded, per decade
PER_DECADE = 5
#: the part of a step, at its end, over which the steady force is a mean
LAST = 0.25


class Slider(Drive):
    """``[drive]``: what pulls at the contact in the steps with a speed, and how its bonds yield."""

    speed: Speed = 0.0
    """speed of the steps that have a distance and say none, nm/s; default: they must say it"""
    engine: Choice[Pulling] = Field(default="event-driven", validate_default=True)  # pyright: ignore[reportAssignmentType]
    """the engine that pulls; default: event-driven"""

    def at(self, speed: float, spring: float | None) -> Drive:
        """What pulls in one step."""
        own = {name: getattr(self, name) for name in Drive.model_fields}
        return Drive(**{**own, "speed": speed, "spring": spring})


class HistoryStep(Component):
    """``[[step]]``: what changes in one step; what is not said stays as in the step before."""

    duration: Time | None = None
    """how long it takes, s; default: the way of ``distance``"""
    distance: Length | None = None
    """by which the drive moves, nm; instead of ``duration``"""
    speed: Speed | None = None
    """of the drive, nm/s; 0: it rests, and the bonds keep their stretch; first: it rests"""
    spring: Stiffness | None = None
    """stiffness of the spring that pulls the slider, nN/nm, or "rigid": the slider has the speed; first: that of
    ``[drive]``"""
    load: float | str | None = None
    """a force (nN) or a nominal pressure; first: that of the scene"""
    temperature: Temperature | None = None
    """K; first: that of ``[hold]``"""
    points: int = Field(default=20, ge=1, le=100_000)
    """times that are recorded besides its beginning: at rest 5 per decade, counted back from the end; else evenly;
    default: 20"""

    @field_validator("load")
    @classmethod
    def _force(cls, value: Any) -> Any:
        try:
            return convert(value, "nN") if isinstance(value, str) else value
        except UnitError:
            return (
                value  # a pressure, which is multiplied by the area of the surface
            )


@dataclass(frozen=True)
class Segment:
    """A step with all its conditions."""

    #: (m,) s since the contact was made; the first is its beginning, just after what changes
    times: np.ndarray
    #: nN, or a pressure; None: of the scene
    load: float | str | None
    #: K; None: of the scene
    temperature: float | None
    #: nm/s
    speed: float
    #: nN/nm; None: rigid
    spring: float | None


def segments(
    steps: Sequence[HistoryStep], drive: Slider | None
) -> Iterator[Segment]:
    """Every step with what it has from those before.

    Raises
    ------
    InputError
        A step has no duration, or no speed for its distance, or is driven without ``drive``.
    """
    begin, speed, load, temperature = 0.0, 0.0, None, None
    spring = None if drive is None else drive.spring
    for number, step in enumerate(steps):
        speed = speed if step.speed is None else step.speed
        if step.distance is not None and not speed and drive is not None:
            speed = drive.speed
        load = load if step.load is None else step.load
        temperature = step.temperature or temperature
        if step.spring is not None:
            spring = None if step.spring == "rigid" else step.spring
        if (step.duration is None) == (step.distance is None):
            raise InputError(f"step {number}: give either duration or distance")
        if step.distance is not None and not speed:
            raise InputError(f"step {number}: a distance needs a speed")
        if speed and drive is None:
            raise InputError(
                f"step {number}: a speed needs [drive], which says how bonds yield"
            )
        span = step.distance / speed if step.distance else step.duration or 0.0
        if speed:
            passed = np.linspace(0.0, span, step.points + 1)
        else:
            back = np.arange(step.points, 0, -1) - 1
            passed = np.append(0.0, span * 10.0 ** (-back / PER_DECADE))
        yield Segment(begin + passed, load, temperature, speed, spring)
        begin += span
        if not math.isfinite(begin):
            raise InputError(f"step {number}: ends beyond the range of numbers")


@dataclass(frozen=True)
class StepOutcome:
    """What a replica did in one step."""

    segment: Segment
    history: BondHistory | PullHistory
    #: bonds of sites that left the contact as the load changed
    lost: int

    @property
    def force(self) -> np.ndarray:
        """(m,) nN, of the drive; 0 before it first moves."""
        if isinstance(self.history, PullHistory):
            return self.history.force
        return np.zeros(self.history.bonds.size)

    @property
    def slider(self) -> np.ndarray:
        """(m,) nm, since it was first pulled."""
        if isinstance(self.history, PullHistory):
            return self.history.displacement
        return np.zeros(self.history.bonds.size)

    @property
    def bonds(self) -> np.ndarray:
        """(m,)"""
        return self.history.bonds

    @property
    def peak(self) -> float:
        """Largest force of this step, nN."""
        return getattr(self.history, "peak", 0.0)

    @property
    def peak_at(self) -> float:
        """Way of the slider from the beginning of the step to there, nm."""
        at = getattr(self.history, "peak_displacement", 0.0)
        return at - float(self.slider[0])

    @property
    def steady(self) -> float:
        """Mean force over the last quarter of the step, nN; at rest that at its end."""
        if not isinstance(self.history, PullHistory) or not self.segment.speed:
            return float(self.force[-1])
        work, times = self.history.work, self.segment.times
        first = -1 - max(1, round(LAST * (work.size - 1)))
        way = self.segment.speed * (times[-1] - times[first])
        return float((work[-1] - work[first]) / way)

    @property
    def work(self) -> float:
        """Of the drive in this step, nN nm."""
        if isinstance(self.history, PullHistory):
            return float(self.history.work[-1] - self.history.work[0])
        return 0.0


class Protocol(Component, ABC):
    """Role ``protocol``: the steps of an experiment, and what they measure."""

    role = "protocol"
    figures: ClassVar[Mapping[str, str]] = {
        "programme": "The programme above; below it force and bonds, means over replicas, on one time axis: logarithmic "
        "within holds.",
    }

    @abstractmethod
    def expand(self) -> Sequence[HistoryStep]:
        """The steps, one at least."""

    def measure(self, steps: Sequence[StepOutcome]) -> Iterable[Measure]:
        """What one replica measures, from what it did in each step; of every replica the same names."""
        return ()

    def draw(
        self, figure: str, axes: Axes, results: Sequence[PlottedResult]
    ) -> None:
        """Draw the programme and what came of it."""
        from chemage_history.drawing import draw_programme

        draw_programme(axes, results)
