"""Protocols of experiments: lists of steps, and what these measure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from chemage.plugin import Length, Temperature, Time, Unit, steadiness
from chemage_history.steps import HistoryStep, Measure, Protocol, StepOutcome

#: a speed at which something moves
Moving = Annotated[Any, Unit("nm/s", gt=0)]


def steady_of(k: int, one: StepOutcome, when: str) -> Iterator[Measure]:
    """The steady friction in step ``k`` with slip, and by what it is judged."""
    name, what = f"steady_{k}", f"steady friction {when}"
    yield Measure(name, one.steady, "nN", what, (name,))
    half = f"second half less first of the {what}"
    yield Measure(name + steadiness.CHANGE, one.change, "nN", half)
    yield Measure(
        name + steadiness.FORMED, one.formed, "", f"bonds formed in the {what}"
    )
    largest = f"largest share of one bond in the {what}"
    yield Measure(name + steadiness.SHARE, one.per_bond, "nN", largest)


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
            at = f"step {k}"
            yield Measure(
                f"bonds_{k}", one.bonds[-1], "", f"bonds at the end of {at}"
            )
            if one.segment.driven:
                yield Measure(f"peak_{k}", one.peak, "nN", f"largest force in {at}")
                yield from steady_of(k, one, f"in {at}")
                yield Measure(f"work_{k}", one.work, "nN nm", f"work in {at}")


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
        healing = []
        for k, hold in enumerate(self.holds):
            before, rest, after = steps[2 * k : 2 * k + 3]
            of = f"hold {k} of {hold:g} s"
            yield from steady_of(k, before, f"before {of}")
            healing.append(after.peak - before.steady)
            for name, value, meaning, *rests in (
                (
                    "relaxation",
                    rest.force[0] - rest.force[-1],
                    "fall of the force in",
                ),
                ("static", after.peak, "largest force after"),
                ("healing", healing[-1], "its rise by", f"steady_{k}"),
            ):
                words = f"{meaning} {of}"
                yield Measure(f"{name}_{k}", value, "nN", words, tuple(rests))
        held = np.array(self.holds)
        some = np.flatnonzero(held > 0)
        if np.unique(held[some]).size > 1:
            decades = np.log10(held[some])
            slope = np.polyfit(decades, np.array(healing)[some], 1)[0]
            rests = tuple(f"steady_{k}" for k in some)
            per = "healing per decade of hold time"
            yield Measure("healing_rate", slope, "nN", per, rests)


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
            yield from steady_of(k, one, f"at {v:g} nm/s")
        for k, (old, new) in enumerate(pairwise(steps), 1):
            up = self.speeds[k] >= self.speeds[k - 1]
            extreme = new.peak if up else new.least
            at = f"at change {k} of the speed"
            both = (f"steady_{k - 1}", f"steady_{k}")
            for name, value, on in (
                ("transient", extreme - new.steady, both[1:]),
                ("change", new.steady - old.steady, both),
            ):
                words = f"{'steady ' * (name == 'change')}{name} {at}"
                yield Measure(f"{name}_{k}", value, "nN", words, on)


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
            at = f"load {k}"
            for name, value, unit, words in (
                ("bonds", one.bonds[-1], "", "bonds at the end of"),
                ("dip", dip, "", "bonds lost first under"),
                ("dip_time", passed, "s", "when there are fewest,"),
            ):
                yield Measure(f"{name}_{k}", value, unit, f"{words} {at}")


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
            yield Measure(f"gained_{k}", gained, "", f"bonds gained at {at:g} K")


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
        for name, bonds, on in (
            ("old", old, "the area of the beginning"),
            ("new", all_of_them - old, "area that grew"),
        ):
            yield Measure(f"bonds_{name}", bonds, "", f"bonds at the end on {on}")
