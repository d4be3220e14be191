"""Protocols of experiments: lists of steps, and what these measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from chemage.plugin import Length, Output, Temperature, Time, Unit
from chemage_history.steps import HistoryStep, Protocol, StepOutcome

#: a speed at which something moves
Moving = Annotated[Any, Unit("nm/s", gt=0)]


def numbered(
    outputs: Mapping[str, Output], numbers: Sequence[int]
) -> dict[str, Output]:
    """Outputs of several steps, by name and number of the step."""
    return {
        f"{name}_{number}": Output(
            (), output.unit, f"{output.description} {number}"
        )
        for number in numbers
        for name, output in outputs.items()
    }


class Steps(Protocol):
    """The steps that ``[[step]]`` lists; each measures its bonds, and its friction where it is driven."""

    kind = "steps"
    of_rest: ClassVar = {"bonds": Output((), "", "bonds at the end of step")}
    of_slip: ClassVar = {
        "peak": Output((), "nN", "largest force in step"),
        "steady": Output((), "nN", "mean force over the last quarter of step"),
        "work": Output((), "nN nm", "work of the drive in step"),
    }

    step: tuple[HistoryStep, ...] = Field(min_length=1)
    """the steps in their order"""

    def expand(self) -> Sequence[HistoryStep]:
        """Itself."""
        return self.step

    def _driven(self) -> list[int]:
        speed, driven = None, []
        for number, step in enumerate(self.step):
            speed = speed if step.speed is None else step.speed
            if speed or (step.distance is not None):
                driven.append(number)
        return driven

    @property
    def measures(self) -> Mapping[str, Output]:
        every = range(len(self.step))
        return numbered(self.of_rest, every) | numbered(
            self.of_slip, self._driven()
        )

    def measure(self, steps: Sequence[StepOutcome]) -> Mapping[str, float]:
        """Bonds, and of driven steps peak, steady friction and work."""
        found = {f"bonds_{k}": float(one.bonds[-1]) for k, one in enumerate(steps)}
        for number in self._driven():
            for name in self.of_slip:
                found[f"{name}_{number}"] = getattr(steps[number], name)
        return found


class SlideHoldSlide(Protocol):
    """Sliding, and after every hold with the drive at rest sliding again."""

    kind = "slide-hold-slide"
    of_hold: ClassVar = {
        "static": Output((), "nN", "largest force of sliding after hold"),
        "healing": Output((), "nN", "that over the steady friction, hold"),
        "relaxation": Output((), "nN", "fall of the force in hold"),
    }
    of_all: ClassVar = {
        "steady": Output((), "nN", "steady friction before the first hold"),
        "healing_rate": Output((), "nN", "healing per decade of hold time"),
    }

    speed: Moving
    """of the drive, nm/s"""
    distance: Length
    """by which the drive moves each time, nm: so far that sliding becomes steady"""
    holds: tuple[Time, ...] = Field(min_length=1)
    """hold times, s"""
    points: int = Field(default=100, ge=2, le=100_000)
    """times that are recorded of each slide; default: 100"""

    def expand(self) -> Sequence[HistoryStep]:
        """Slide, hold, slide, hold, slide …"""
        slide = HistoryStep(
            speed=self.speed, distance=self.distance, points=self.points
        )
        rests = (HistoryStep(speed=0.0, duration=hold) for hold in self.holds)
        return [slide, *(step for rest in rests for step in (rest, slide))]

    @property
    def measures(self) -> Mapping[str, Output]:
        outputs = numbered(self.of_hold, range(len(self.holds)))
        several = len({*self.holds} - {0.0}) > 1
        return {
            name: self.of_all[name] for name in [*self.of_all][: 1 + several]
        } | (outputs)

    def measure(self, steps: Sequence[StepOutcome]) -> Mapping[str, float]:
        """Steady friction; relaxation, peak and healing of every hold; and the slope of the healing against log10 of
        the hold time."""
        slides, rests = steps[::2], steps[1::2]
        healing = []
        found = {"steady": slides[0].steady}
        for number, (before, after) in enumerate(pairwise(slides)):
            rest = rests[number]
            healing.append(after.peak - before.steady)
            found |= {
                f"static_{number}": after.peak,
                f"healing_{number}": healing[-1],
                f"relaxation_{number}": float(rest.force[0] - rest.force[-1]),
            }
        if "healing_rate" in self.measures:
            held = np.array(self.holds)
            decades = np.log10(held[held > 0])
            decades -= decades.mean()
            rise = np.array(healing)[held > 0]
            found["healing_rate"] = float(decades @ rise / (decades @ decades))
        return found


class VelocitySteps(Protocol):
    """Sliding at one speed after the other."""

    kind = "velocity-steps"
    of_speed: ClassVar = {"steady": Output((), "nN", "steady friction, speed")}
    of_change: ClassVar = {
        "change": Output((), "nN", "change of the steady friction to speed"),
        "transient": Output(
            (), "nN", "extreme force less the steady friction, speed"
        ),
    }

    speeds: tuple[Moving, ...] = Field(min_length=1)
    """of the drive, nm/s"""
    distance: Length
    """by which the drive moves at each speed, nm: so far that sliding becomes steady"""
    points: int = Field(default=100, ge=2, le=100_000)
    """times that are recorded of each speed; default: 100"""

    def expand(self) -> Sequence[HistoryStep]:
        """One step for each speed."""
        return [
            HistoryStep(speed=speed, distance=self.distance, points=self.points)
            for speed in self.speeds
        ]

    @property
    def measures(self) -> Mapping[str, Output]:
        every = range(len(self.speeds))
        return numbered(self.of_speed, every) | numbered(self.of_change, every[1:])

    def measure(self, steps: Sequence[StepOutcome]) -> Mapping[str, float]:
        """Steady friction, its changes, and transients: above the new one where the speed rises, else below it."""
        found = {f"steady_{k}": one.steady for k, one in enumerate(steps)}
        for number, (before, after) in enumerate(pairwise(steps), 1):
            up = after.segment.speed >= before.segment.speed
            extreme = after.peak if up else float(after.force.min())
            found[f"change_{number}"] = after.steady - before.steady
            found[f"transient_{number}"] = extreme - after.steady
        return found


class LoadSteps(Protocol):
    """Rest under one load after the other, as in experiments on the memory of a contact."""

    kind = "load-steps"
    of_load: ClassVar = {
        "bonds": Output((), "", "bonds at the end of load"),
        "dip": Output((), "", "bonds that are lost again before they grow, load"),
        "dip_time": Output((), "s", "when there are the fewest, load"),
    }

    loads: tuple[float | str, ...] = Field(min_length=1)
    """forces (nN) or nominal pressures"""
    durations: tuple[Time, ...] = Field(min_length=1)
    """time under each, s; one: the same for all"""
    points: int = Field(default=20, ge=1, le=100_000)
    """times that are recorded of each, as in a step; default: 20"""

    def expand(self) -> Sequence[HistoryStep]:
        """One step for each load."""
        spans = self.durations * (
            len(self.loads) if len(self.durations) == 1 else 1
        )
        return [
            HistoryStep(load=load, duration=span, points=self.points)
            for load, span in zip(self.loads, spans, strict=True)
        ]

    @property
    def measures(self) -> Mapping[str, Output]:
        return numbered(self.of_load, range(len(self.loads)))

    def measure(self, steps: Sequence[StepOutcome]) -> Mapping[str, float]:
        """Bonds, and how far and until when they fall after the change of the load."""
        found: dict[str, float] = {}
        for number, one in enumerate(steps):
            least = int(np.argmin(one.bonds))
            passed = one.segment.times[least] - one.segment.times[0]
            found |= {
                f"bonds_{number}": float(one.bonds[-1]),
                f"dip_{number}": float(one.bonds[0] - one.bonds[least]),
                f"dip_time_{number}": float(passed),
            }
        return found


class Heating(Protocol):
    """Rest at one temperature after the other."""

    kind = "heating"
    of_each: ClassVar = {"bonds": Output((), "", "bonds at the end of temperature")}
    of_change: ClassVar = {
        "change": Output((), "", "bonds gained in all at temperature")
    }

    temperatures: tuple[Temperature, ...] = Field(min_length=1)
    """K"""
    duration: Time
    """time at each, s"""
    points: int = Field(default=20, ge=1, le=100_000)
    """times that are recorded of each, as in a step; default: 20"""

    def expand(self) -> Sequence[HistoryStep]:
        """One step for each temperature."""
        return [
            HistoryStep(
                temperature=kelvin, duration=self.duration, points=self.points
            )
            for kelvin in self.temperatures
        ]

    @property
    def measures(self) -> Mapping[str, Output]:
        every = range(len(self.temperatures))
        return numbered(self.of_each, every) | numbered(self.of_change, every)

    def measure(self, steps: Sequence[StepOutcome]) -> Mapping[str, float]:
        """Bonds at the end of each temperature, and how many more than at its beginning."""
        ends = {f"bonds_{k}": float(one.bonds[-1]) for k, one in enumerate(steps)}
        return ends | {
            f"change_{k}": float(one.bonds[-1] - one.bonds[0])
            for k, one in enumerate(steps)
        }
