"""Protocols of experiments: lists of steps, and what these measure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from chemage.plugin import Length, Temperature, Time, Unit
from chemage_history.steps import HistoryStep, Measure, Protocol, StepOutcome

#: a speed at which something moves
Moving = Annotated[Any, Unit("nm/s", gt=0)]


class Steps(Protocol):
    """The steps that ``[[step]]`` lists: the bonds of each, and of each with slip peak, steady friction and work."""

    kind = "steps"

    step: tuple[HistoryStep, ...] = Field(min_length=1)
    """the steps in their order"""

    def expand(self) -> Sequence[HistoryStep]:
        """See :meth:`Protocol.expand`."""
        return self.step

    def measure(self, steps: Sequence[StepOutcome]) -> Iterator[Measure]:
        """See :meth:`Protocol.measure`."""
        for k, one in enumerate(steps):
            yield f"bonds_{k}", one.bonds[-1], "", f"bonds at the end of step {k}"
            if one.segment.driven:
                yield f"peak_{k}", one.peak, "nN", f"largest force in step {k}"
                yield (
                    f"steady_{k}",
                    one.steady,
                    "nN",
                    f"steady friction in step {k}",
                )
                yield f"work_{k}", one.work, "nN nm", f"work in step {k}"


class SlideHoldSlide(Protocol):
    """Sliding, and after every hold with the drive at rest sliding again: relaxation, peak, and healing, which is the
    peak over the steady friction before the hold."""

    kind = "slide-hold-slide"

    speed: Moving
    """of the drive, nm/s"""
    distance: Length
    """by which the drive moves each time, nm: so far that sliding becomes steady"""
    holds: tuple[Time, ...] = Field(min_length=1)
    """hold times, s"""

    def expand(self) -> Sequence[HistoryStep]:
        """See :meth:`Protocol.expand`."""
        slide = HistoryStep(speed=self.speed, distance=self.distance)
        steps = [slide]
        for hold in self.holds:
            steps += [HistoryStep(speed=0.0, duration=hold), slide]
        return steps

    def measure(self, steps: Sequence[StepOutcome]) -> Iterator[Measure]:
        """See :meth:`Protocol.measure`."""
        yield (
            "steady",
            steps[0].steady,
            "nN",
            "steady friction before the first hold",
        )
        healing = []
        for k, hold in enumerate(self.holds):
            before, rest, after = steps[2 * k : 2 * k + 3]
            healing.append(after.peak - before.steady)
            fall, of = rest.force[0] - rest.force[-1], f"hold of {hold:g} s"
            yield f"relaxation_{k}", fall, "nN", f"fall of the force in the {of}"
            yield f"static_{k}", after.peak, "nN", f"largest force after the {of}"
            yield f"healing_{k}", healing[-1], "nN", f"its rise by the {of}"
        held = np.array(self.holds)
        some = held > 0
        if np.unique(held[some]).size > 1:
            decades = np.log10(held[some])
            slope = np.polyfit(decades, np.array(healing)[some], 1)[0]
            yield "healing_rate", slope, "nN", "healing per decade of hold time"


class VelocitySteps(Protocol):
    """Sliding at one speed after the other: steady friction, and the transient above it where the speed rises, else
    below it."""

    kind = "velocity-steps"

    speeds: tuple[Moving, ...] = Field(min_length=1)
    """of the drive, nm/s"""
    distance: Length
    """by which the drive moves at each speed, nm: so far that sliding becomes steady"""

    def expand(self) -> Sequence[HistoryStep]:
        """See :meth:`Protocol.expand`."""
        return [HistoryStep(speed=v, distance=self.distance) for v in self.speeds]

    def measure(self, steps: Sequence[StepOutcome]) -> Iterator[Measure]:
        """See :meth:`Protocol.measure`."""
        for k, (one, v) in enumerate(zip(steps, self.speeds, strict=True)):
            yield f"steady_{k}", one.steady, "nN", f"steady friction at {v:g} nm/s"
        for k, (old, new) in enumerate(pairwise(steps), 1):
            up = self.speeds[k] >= self.speeds[k - 1]
            extreme = new.peak if up else new.least
            at = f"at change {k} of the speed"
            yield f"transient_{k}", extreme - new.steady, "nN", f"transient {at}"
            yield (
                f"change_{k}",
                new.steady - old.steady,
                "nN",
                f"steady change {at}",
            )


class LoadSteps(Protocol):
    """Rest under one load after the other, as in experiments on the memory of a contact: how many bonds are lost after
    each change before their number grows, and until when."""

    kind = "load-steps"

    loads: tuple[float | str, ...] = Field(min_length=1)
    """forces (nN) or nominal pressures"""
    durations: tuple[Time, ...] = Field(min_length=1)
    """time under each, s"""

    def expand(self) -> Sequence[HistoryStep]:
        """See :meth:`Protocol.expand`."""
        if len(self.durations) != len(self.loads):
            raise ValueError(
                f"{len(self.durations)} durations, {len(self.loads)} loads"
            )
        return [
            HistoryStep(load=load, duration=span)
            for load, span in zip(self.loads, self.durations, strict=True)
        ]

    def measure(self, steps: Sequence[StepOutcome]) -> Iterator[Measure]:
        """See :meth:`Protocol.measure`."""
        for k, one in enumerate(steps):
            least = int(np.argmin(one.bonds))
            passed = one.segment.times[least] - one.segment.times[0]
            dip = one.bonds[0] - one.bonds[least]
            yield f"bonds_{k}", one.bonds[-1], "", f"bonds at the end of load {k}"
            yield f"dip_{k}", dip, "", f"bonds lost first under load {k}"
            yield f"dip_time_{k}", passed, "s", f"when there are fewest, load {k}"


class Heating(Protocol):
    """Rest at one temperature after the other: how many bonds each adds, or takes."""

    kind = "heating"

    temperatures: tuple[Temperature, ...] = Field(min_length=1)
    """K"""
    duration: Time
    """time at each, s"""

    def expand(self) -> Sequence[HistoryStep]:
        """See :meth:`Protocol.expand`."""
        return [
            HistoryStep(temperature=kelvin, duration=self.duration)
            for kelvin in self.temperatures
        ]

    def measure(self, steps: Sequence[StepOutcome]) -> Iterator[Measure]:
        """See :meth:`Protocol.measure`."""
        for k, (one, at) in enumerate(zip(steps, self.temperatures, strict=True)):
            gained = one.bonds[-1] - one.bonds[0]
            yield f"gained_{k}", gained, "", f"bonds gained at {at:g} K"


class Creep(Protocol):
    """Rest while the contact grows because the material creeps: H(t) = H/(1 + m ln(1 + t/τ)), in contacts at equal
    distances in log t; the bonds at the end, on sites that were in contact from the beginning and on others (Dieterich
    and Kilgore, Pure Appl. Geophys. 143, 283 (1994))."""

    kind = "creep"

    duration: Time
    """s"""
    rate: float = Field(gt=0, le=1)
    """m, by which the area grows per e-fold of time, over that at the beginning"""
    onset: Time = Field(default=1.0, gt=0)
    """τ, s; default: 1 s"""
    contacts: int = Field(default=12, ge=2, le=1000)
    """contacts that are solved; default: 12"""

    def expand(self) -> Sequence[HistoryStep]:
        """See :meth:`Protocol.expand`."""
        grown = np.log1p(self.duration / self.onset)
        ends = np.linspace(0.0, grown, self.contacts + 1)
        # each contact is that of the middle of its step, but the first
        middles = (ends[:-1] + ends[1:]) / 2
        middles[0] = 0.0
        return [
            HistoryStep(duration=span, hardness_ratio=ratio, points=4)
            for span, ratio in zip(
                np.diff(self.onset * np.exp(ends)),
                1.0 / (1.0 + self.rate * middles),
                strict=True,
            )
        ]

    def measure(self, steps: Sequence[StepOutcome]) -> Iterator[Measure]:
        """See :meth:`Protocol.measure`."""
        old, all_of_them = steps[-1].old, steps[-1].bonds[-1]
        yield "bonds_old", old, "", "bonds at the end on the area of the beginning"
        yield (
            "bonds_new",
            all_of_them - old,
            "",
            "bonds at the end on area that grew",
        )
