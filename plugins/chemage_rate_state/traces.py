"""Measured and simulated traces of friction, and the loading that made them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from chemage import InputError
from chemage.plugin import read_columns
from chemage_rate_state.laws import Loading

#: change of the speed over the larger that counts, and part of the largest speed below which the load point rests, as it
#: does where its speed is within three standard errors
CHANGED, RESTS = 0.01, 1e-5
#: points in which changes of speed are sought, parts at most, and points of a part at least
SOUGHT, MOST, FEWEST = 1000, 40, 3
#: by how much the logarithm of the mean square must fall with a change of speed, over ln(points)/points, and the error of
#: a displacement over its range that is not told from none
BETTER, EXACT = 12.0, 1e-6


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
        _rising(self.times)
        begins, speeds = self.loading
        ends = [self.times[0], *begins[1:], self.times[-1]]
        fits = begins.size == speeds.size > 1 and (np.diff(ends) > 0).all()
        if not fits or speeds[0] <= 0:
            raise InputError(
                f"{self.name}: speeds {speeds.tolist()} µm/s, changed at {ends[1:-1]} s: the speed of the load point must "
                f"change, from one above 0, at times that rise from {ends[0]:g} to {ends[-1]:g} s; where it does, say how: "
                '--speeds "1 um/s, 10 um/s" --changes "50 s"'
            )

    @property
    def way(self) -> np.ndarray:
        """(m,) µm of the load point."""
        return self.loading.displacement(self.times)


def _rising(times: np.ndarray) -> None:
    falls = np.flatnonzero(np.diff(times) <= 0)
    if times.size < 20 or falls.size:
        raise InputError(
            f"times: give 20 or more that rise; of these {times.size} points {(falls[:3] + 2).tolist()} do not"
        )


def loading_of(times: np.ndarray, displacement: np.ndarray) -> Loading:
    """The constant speeds of a ``displacement`` (m,) of the load point, µm, at ``times`` (m,), s: straight lines that meet.

    Raises
    ------
    InputError
        The times do not rise, or the load point moves back.
    """
    _rising(times)
    passed = times - times[0]
    points, ends = _segments(passed, displacement)
    # first through the points of which is known where they belong
    for kept in (points, slice(None), slice(None)):
        speeds, heights = _lines(passed[kept], displacement[kept], ends)
        differ = np.abs(np.diff(speeds)) > CHANGED * np.maximum(
            speeds[1:], speeds[:-1]
        )
        meet = -np.diff(heights)[differ] / np.diff(speeds)[differ]
        ends = np.concatenate([[0.0], meet, passed[-1:]])
    speeds, _ = _lines(passed, displacement, ends)
    return Loading(times[0] + ends[:-1], speeds)


def _lines(
    times: np.ndarray, way: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Speed, and height at time 0, of the line between each two ``ends``; slow ones rest."""
    lines = []
    for low, high in pairwise(ends):
        inside = (times >= low) & (times <= high)
        if np.count_nonzero(inside) < 2:
            raise InputError(
                f"displacement: fewer than 2 points between {low:g} and {high:g} s after the first; give --speeds and "
                "--changes"
            )
        t, x = times[inside], way[inside]
        middle, height = t.mean(), x.mean()
        t, x = t - middle, x - height
        speed, width = t @ x / (t @ t), np.sqrt(t @ t)
        lines.append((speed, 3 * (x - speed * t).std() / width, middle, height))
    speeds, doubts, middles, heights = np.transpose(lines)
    if (speeds < -CHANGED * speeds.max()).any():
        raise InputError(
            "displacement: the load point moves back; give its displacement in the direction of slip"
        )
    speeds[speeds < np.maximum(doubts, RESTS * speeds.max())] = 0.0
    return speeds, heights - speeds * middles


def _segments(times: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Some points, and ends of the straight parts that explain ``way`` best, by dynamic programming (Jackson
    et al., IEEE Signal Process. Lett. 12, 105 (2005)); their number has the least BIC, with a larger price."""
    span = np.ptp(way) or 1.0
    # as many points for each time as for each displacement
    even = times / times[-1] + np.maximum.accumulate(way - way[0]) / span
    sought = np.linspace(0, even[-1], SOUGHT)
    kept = np.unique(np.minimum(np.searchsorted(even, sought), times.size - 1))
    t, x = times[kept] / times[-1], (way[kept] - way[0]) / span
    size = t.size
    sums = np.array([np.ones(size), t, x, t * t, t * x, x * x]).cumsum(axis=1)
    sums = np.insert(sums, 0, 0.0, axis=1)
    best = np.full((MOST + 1, size + 1), np.inf)
    best[0, 0] = 0.0
    origin = np.zeros(best.shape, dtype=int)
    for j in range(FEWEST, size + 1):
        n, st, sx, stt, stx, sxx = sums[:, j, None] - sums[:, : j - FEWEST + 1]
        spread, both = sxx - sx * sx / n, stx - st * sx / n
        left = np.maximum(spread - both**2 / (stt - st * st / n), 0.0)
        total = best[:-1, : j - FEWEST + 1] + left
        origin[1:, j] = total.argmin(axis=1)
        best[1:, j] = total.min(axis=1)
    squares = np.log(best[1:, -1] / size + EXACT**2)
    price = BETTER * np.log(size) / size
    parts = 1 + int(np.argmin(squares + price * np.arange(MOST)))
    inner, j = [], size
    for k in range(parts, 1, -1):
        j = origin[k, j]
        inner.insert(0, j)
    first = np.array(inner, dtype=int)
    middle = (t[first] + t[first - 1]) / 2
    return kept, times[-1] * np.concatenate([[0.0], middle, [1.0]])


#: what a table must have, and a header for messages
COLUMNS = ("hold_time", "displacement", "friction", "friction_coefficient")
EXAMPLE = "time (s), displacement (um), friction_coefficient"
#: the part of the first slide of a simulation, at its end, with which the trace begins
STEADY = 0.25


def read_trace(
    source: Any,
    stiffness: float | None = None,
    speeds: Sequence[float] = (),
    changes: Sequence[float] = (),
) -> Trace:
    """The trace in a table with columns of time, displacement of the load point and friction coefficient, with units in
    their headings. ``stiffness``, 1/µm, ``speeds``, µm/s, and when they change, ``changes``, s, are given where they are
    known.

    Raises
    ------
    InputError
        A column is missing, a cell holds no number, or no speed changes.
    """
    table = read_columns(source, COLUMNS, EXAMPLE)
    friction = COLUMNS[3] if COLUMNS[3] in table.columns else COLUMNS[2]
    units = {"hold_time": "s", "displacement": "um", friction: ""}
    for name in units:
        if name not in table.columns:
            raise InputError(
                f"{table.where}: no column {name}; a trace has columns such as {EXAMPLE}"
            )
    times, way, values = (
        np.array([table.number(row, name, unit) for row in table.rows])
        for name, unit in units.items()
    )
    if len(speeds) or len(changes):
        begins = np.append(times[0], changes)
        loading = Loading(begins, np.array(speeds, dtype=float))
    else:
        loading = loading_of(times, way)
    name = str(getattr(source, "name", source))
    return Trace(name, times, values, loading, stiffness)


def trace_of(run: Any, stiffness: float | None = None) -> Trace:
    """The trace of a simulated programme of slides and holds: mean friction of its replicas over the load.

    Raises
    ------
    InputError
        ``run`` has no slider, conditions change beside its speed, or in a ramp, its first slide does not become steady,
        or too few bonds form.
    """
    seen = getattr(run.ageing, "observables", {})
    if "step_speed" not in seen or not seen["step_speed"].any():
        raise InputError(
            f"{run.name}: no programme of slides; give [protocol] or [[step]] with speeds"
        )
    names = "step_speed", "step_points", "step_load", "temperature"
    speeds, points, loads, kelvins = (seen[name][0] for name in names)
    changes = {"load": np.ptp(loads), "temperature": np.ptp(kelvins)}
    for number, step in enumerate(run.scene.get("step", ())):
        for name, value in step.items():
            changes[f"step.{number}.{name}"] = name == "spring" or isinstance(
                value, Mapping
            )
    if wrong := [name for name, change in changes.items() if change]:
        raise InputError(
            f"{run.name}: {', '.join(wrong)}: a trace has one load, one temperature, constant speeds, and the spring of "
            "[drive]; write ramps as steps"
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
    first, times = int(np.argmax(speeds > 0)), run.ageing.hold_times
    ends = points.cumsum()
    starts, end = times[ends - points], times[ends[first] - 1]
    # the first point of a step is the last of the one before
    kept = times >= end - STEADY * (end - starts[first])
    kept &= np.diff(times, prepend=-1.0) > 0
    begins = np.append(times[kept][0], starts[first + 1 :])
    spring = run.scene.get("drive", {}).get("spring")
    if stiffness is None and isinstance(spring, int | float):
        stiffness = 1e3 * float(spring) / loads[0]
    return Trace(
        run.name,
        times[kept],
        run.ageing.friction_drop.mean(axis=0)[kept] / loads[0],
        Loading(begins, 1e-3 * speeds[first:]),
        stiffness,
    )
