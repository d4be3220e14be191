"""Measured and simulated traces of friction, and the loading that made them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from chemage import InputError
from chemage.plugin import read_columns
from chemage_rate_state.laws import Loading

#: change of the speed over the larger that counts, and by how much the misfit of lines must fall per ln(points) for one
CHANGED, BETTER = 0.01, 12.0
#: points of a part of constant speed at least, and part of the largest speed below which the load
#: point rests, as it does where its speed is within three standard errors
FEWEST, RESTS = 10, 1e-3


@dataclass(frozen=True, eq=False)
class Trace:
    """Friction while a load point moves."""

    name: str
    #: (m,) s, coefficient of friction
    times: np.ndarray
    friction: np.ndarray
    loading: Loading
    #: of spring and machine over the normal force, 1/µm, where it is known
    stiffness: float | None = None

    def __post_init__(self) -> None:
        if self.times.size < 2 * FEWEST:
            raise InputError(
                f"{self.name}: {self.times.size} points; {2 * FEWEST} are needed"
            )
        for name in ("times", "friction"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"{self.name}: {name}: not all are finite numbers")
        if (np.diff(self.times) <= 0).any():
            place = int(np.argmax(np.diff(self.times) <= 0)) + 1
            raise InputError(
                f"{self.name}: times: must rise; point {place + 1} is at {self.times[place]:g} s after "
                f"{self.times[place - 1]:g} s"
            )
        speeds = self.loading.speeds
        if speeds.size < 2 or speeds[0] <= 0:
            raise InputError(
                f"{self.name}: the speed of the load point must change, from one above 0: {speeds.tolist()} µm/s"
            )

    @property
    def way(self) -> np.ndarray:
        """(m,) µm of the load point."""
        return self.loading.displacement(self.times)

    def thinned(self, points: int) -> Trace:
        """About so many of its points."""
        kept = slice(None, None, max(1, round(self.times.size / points)))
        return replace(self, times=self.times[kept], friction=self.friction[kept])


def loading_of(times: np.ndarray, displacement: np.ndarray) -> Loading:
    """The constant speeds of a measured ``displacement`` (m,) of the load point, µm, at ``times`` (m,), s.

    A part is halved where two lines explain it much better than one (binary segmentation), and the speeds differ; then
    each change is sought once more between its neighbours.
    """
    found, pending = {0, times.size}, [(0, times.size)]
    while pending:
        low, high = pending.pop()
        split = _split(times[low:high], displacement[low:high])
        if split is not None:
            found.add(low + split)
            pending += [(low, low + split), (low + split, high)]
    # the first halves were not those of the truth
    ends, before = sorted(found), None
    while ends != before:
        before, kept = ends, [0]
        for high in ends[2:]:
            low = kept[-1]
            split = _split(times[low:high], displacement[low:high])
            if split is not None:
                kept.append(low + split)
        ends = [*kept, times.size]
    lines, doubts = [], []
    for low, high in pairwise(ends):
        passed, own = times[low:high] - times[0], displacement[low:high]
        line = np.polyfit(passed, own, 1)
        lines.append(line)
        rest = (own - np.polyval(line, passed)).std()
        doubts.append(3 * rest / (passed.std() * np.sqrt(passed.size)))
    speeds = np.array([line[0] for line in lines])
    speeds[np.abs(speeds) < np.maximum(doubts, RESTS * np.abs(speeds).max())] = 0.0
    if (speeds < 0).any():
        raise InputError(
            "displacement: the load point moves back; give its displacement in the direction of slip"
        )
    meet = [
        (after[1] - before[1]) / (before[0] - after[0])
        for before, after in pairwise(lines)
    ]
    return Loading(times[0] + np.append(0.0, meet), speeds)


def _split(times: np.ndarray, values: np.ndarray) -> int | None:
    """Where two lines explain ``values`` much better than one; None: nowhere."""
    size = times.size
    if size < 2 * FEWEST:
        return None
    centred = np.stack(
        [np.ones(size), times - times.mean(), values - values.mean()]
    )
    products = np.cumsum(centred[:, None] * centred[None], axis=2)
    whole = products[..., -1:]

    def misfit(sums: np.ndarray) -> np.ndarray:
        """Of the line through points whose sums of products these are (3, 3, n)."""
        count, squares = sums[0, 0], sums[1, 1] - sums[0, 1] ** 2 / sums[0, 0]
        both = sums[1, 2] - sums[0, 1] * sums[0, 2] / count
        spread = sums[2, 2] - sums[0, 2] ** 2 / count
        return np.maximum(spread - both**2 / np.maximum(squares, 1e-300), 0.0)

    inner = slice(FEWEST - 1, size - FEWEST)
    left, right = products[..., inner], (whole - products)[..., inner]
    sizes = misfit(left) + misfit(right)
    best = int(np.argmin(sizes))
    slopes = [
        (part[1, 2] - part[0, 1] * part[0, 2] / part[0, 0])
        / (part[1, 1] - part[0, 1] ** 2 / part[0, 0])
        for part in (left[..., best], right[..., best])
    ]
    floor = (1e-9 * np.ptp(values)) ** 2 * size
    gain = size * np.log((misfit(whole)[0] + floor) / (sizes[best] + floor))
    differ = abs(slopes[0] - slopes[1]) > CHANGED * max(map(abs, slopes))
    return best + FEWEST if gain > BETTER * np.log(size) and differ else None


#: what a table must have, and a header for messages
COLUMNS = ("hold_time", "displacement", "friction", "friction_coefficient")
EXAMPLE = "time (s), displacement (um), friction_coefficient"
#: the part of the first slide of a simulation, at its end, with which the trace begins
STEADY = 0.25


def read_trace(source: Any, stiffness: float | None = None) -> Trace:
    """The trace in a table with columns of time, displacement of the load point and friction coefficient, with units in
    their headings.

    Raises
    ------
    InputError
        A column is missing, a cell holds no number, or no speed changes.
    """
    table = read_columns(source, COLUMNS, EXAMPLE)
    friction = next(
        (one for one in COLUMNS[2:] if one in table.columns), "friction"
    )
    for name in (*COLUMNS[:2], friction):
        if name not in table.columns:
            raise InputError(
                f"{table.where}: no column {name}; a trace has columns such as {EXAMPLE}"
            )
    units = {"hold_time": "s", "displacement": "um", friction: ""}
    times, way, values = (
        np.array([table.number(row, name, unit) for row in table.rows])
        for name, unit in units.items()
    )
    name = source if isinstance(source, str) else getattr(source, "name", "trace")
    loading = loading_of(times, way) if times.size else Loading(times, way)
    return Trace(str(name), times, values, loading, stiffness)


def trace_of(run: Any, stiffness: float | None = None) -> Trace:
    """The trace of a simulated programme of slides and holds: mean friction of its replicas over the load.

    Raises
    ------
    InputError
        ``run`` has no slider, conditions change beside its speed, or in a ramp, its first slide does not become steady,
        or too few bonds form.
    """
    aging, seen = run.aging, {} if run.aging is None else run.aging.observables
    if aging is None or not {"step_speed", "step_points"} <= set(seen):
        raise InputError(
            f"{run.name}: no programme of slides; give [protocol] or [[step]] with speeds"
        )
    speeds, points = 1e-3 * seen["step_speed"][0], seen["step_points"][0]
    loads = seen["step_load"][0]
    for name, values in (("load", loads), ("temperature", seen["temperature"][0])):
        if np.ptp(values) > 0:
            raise InputError(
                f"{run.name}: the {name} changes; friction laws have one {name}"
            )
    for number, step in enumerate(run.scene.get("step", ())):
        for name in ("speed", "load", "spring"):
            ramp = isinstance(step.get(name), Mapping)
            if ramp or (name == "spring" and name in step):
                raise InputError(
                    f"{run.name}: step.{number}.{name}: a trace has constant speeds and one spring, that of [drive]; "
                    "write ramps as steps"
                )
    steady = [
        one.quantity()
        for name, one in run.measured.items()
        if one.output is not None and one.output.rests == (name,)
    ]
    for place, one in enumerate(steady):
        if one.reason and (place == 0 or not one.known):
            raise InputError(
                f"{run.name}: {one.label} {one.reason}: no a, b, D_c is taken from it; slide further, or give more "
                "replicas"
            )
    number = np.repeat(np.arange(points.size), points)
    slides = np.flatnonzero(speeds > 0)
    times = aging.hold_times
    starts = times[np.unique(number, return_index=True)[1]]
    if not slides.size:
        raise InputError(f"{run.name}: no step has a speed")
    first = int(slides[0])
    own = times[number == first]
    kept = (times >= own[-1] - STEADY * (own[-1] - own[0])) & (number >= first)
    # the first point of a step is the last of the one before
    kept &= np.append(True, np.diff(times) > 0)
    begin = times[kept][0]
    loading = Loading(np.append(begin, starts[first + 1 :]), speeds[first:])
    spring = run.scene.get("drive", {}).get("spring")
    friction = aging.friction_drop.mean(axis=0)[kept] / loads[0]
    if stiffness is None and isinstance(spring, int | float):
        stiffness = 1e3 * float(spring) / loads[0]
    return Trace(run.name, times[kept], friction, loading, stiffness)
