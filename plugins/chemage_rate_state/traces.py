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
        _rising(self.name, self.times)
        if not np.isfinite(self.friction).all():
            raise InputError(f"{self.name}: friction: not all are finite numbers")
        speeds = self.loading.speeds
        if speeds.size < 2 or speeds[0] <= 0:
            raise InputError(
                f"{self.name}: the speed of the load point must change, from one above 0: {speeds.tolist()} µm/s; where it "
                'does, say how: --speeds "1 um/s, 10 um/s"'
            )

    @property
    def way(self) -> np.ndarray:
        """(m,) µm of the load point."""
        return self.loading.displacement(self.times)


def _rising(name: str, times: np.ndarray) -> None:
    if times.size < 20:
        raise InputError(f"{name}: {times.size} points; 20 are needed")
    falls = ~(np.diff(times) > 0)
    if falls.any():
        at = int(np.argmax(falls))
        raise InputError(
            f"{name}: times: must rise; point {at + 2} is at {times[at + 1]:g} s after {times[at]:g} s"
        )


def loading_of(
    times: np.ndarray,
    displacement: np.ndarray,
    speeds: Sequence[float] | None = None,
    changes: Sequence[float] | None = None,
) -> Loading:
    """The constant speeds of a ``displacement`` (m,) of the load point, µm, at ``times`` (m,), s: straight lines that meet.

    ``speeds``, µm/s, and ``changes``, s, are given where they are known.

    Raises
    ------
    InputError
        The load point moves back, or speeds and changes do not fit.
    """
    passed, end = times - times[0], times[-1] - times[0]
    given = None if speeds is None else np.array(speeds, dtype=float)
    if changes is None:
        kept, ends = _segments(passed, displacement, given)
        # first through the points of which is known where they belong
        for points in (kept, slice(None), slice(None)):
            found, heights = _lines(
                passed[points], displacement[points], ends, given
            )
            largest = np.maximum(found[1:], found[:-1])
            differ = (np.abs(np.diff(found)) > CHANGED * largest) | (
                given is not None
            )
            with np.errstate(divide="ignore", invalid="ignore"):
                meet = -np.diff(heights) / np.diff(found)
            ends = np.concatenate([[0.0], meet[differ], [end]])
    else:
        ends = np.concatenate(
            [[0.0], np.array(changes, dtype=float) - times[0], [end]]
        )
    parts = ends.size - 1
    if not (np.diff(ends) > 0).all() or (given is not None and given.size != parts):
        raise InputError(
            f"changes: {(ends[1:-1] + times[0]).tolist()} s: they must rise from {times[0]:g} to {times[-1]:g} s, one less "
            'than the speeds; give both: --speeds "1 um/s, 10 um/s" --changes "50 s"'
        )
    found, _ = _lines(passed, displacement, ends, given)
    return Loading(times[0] + ends[:-1], found)


def _lines(
    times: np.ndarray, way: np.ndarray, ends: np.ndarray, given: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Speed, and height at time 0, of the line between each two ``ends``; slow ones rest."""
    lines = []
    for low, high in pairwise(ends):
        inside = (times >= low) & (times <= high)
        if np.count_nonzero(inside) < 2:
            raise InputError(
                f"displacement: fewer than 2 points between {low:g} and {high:g} s after the first; give --changes"
            )
        own, at = (
            way[inside] - way[inside].mean(),
            times[inside] - times[inside].mean(),
        )
        speed = at @ own / (at @ at)
        doubt = 3 * (own - speed * at).std() / np.sqrt(at @ at)
        lines.append((speed, doubt, times[inside].mean(), way[inside].mean()))
    found, doubts, at, own = np.transpose(lines)
    if given is not None:
        found = given
    elif (found < -CHANGED * found.max()).any():
        raise InputError(
            "displacement: the load point moves back; give its displacement in the direction of slip"
        )
    else:
        found[found < np.maximum(doubts, RESTS * found.max())] = 0.0
    return found, own - found * at


def _segments(
    times: np.ndarray, way: np.ndarray, given: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Some points, and ends of the straight parts that explain ``way`` best, by dynamic programming (Jackson
    et al., IEEE Signal Process. Lett. 12, 105 (2005)); their number has the least BIC, with a larger price, or is that of
    the given speeds."""
    span = np.ptp(way) or 1.0
    # as many points for each time as for each displacement
    even = times / times[-1] + np.maximum.accumulate(way - way[0]) / span
    sought = np.linspace(0, even[-1], SOUGHT)
    kept = np.unique(np.minimum(np.searchsorted(even, sought), times.size - 1))
    t, x = times[kept] / times[-1], (way[kept] - way[0]) / span
    size = t.size
    sums = np.zeros((6, size + 1))
    np.cumsum([np.ones(size), t, x, t * t, t * x, x * x], axis=1, out=sums[:, 1:])
    most = MOST if given is None else given.size
    best = np.full((most + 1, size + 1), np.inf)
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
    if given is None:
        most = 1 + int(np.argmin(squares + price * np.arange(most)))
    ends, j = [size], size
    for k in range(most, 0, -1):
        j = int(origin[k, j])
        ends.append(j)
    inner = np.array(ends[-2:0:-1], dtype=int)
    middle = (t[inner] + t[inner - 1]) / 2
    return kept, times[-1] * np.concatenate([[0.0], middle, [1.0]])


#: what a table must have, and a header for messages
COLUMNS = ("hold_time", "displacement", "friction", "friction_coefficient")
EXAMPLE = "time (s), displacement (um), friction_coefficient"
#: the part of the first slide of a simulation, at its end, with which the trace begins
STEADY = 0.25


def read_trace(
    source: Any,
    stiffness: float | None = None,
    speeds: Sequence[float] | None = None,
    changes: Sequence[float] | None = None,
) -> Trace:
    """The trace in a table with columns of time, displacement of the load point and friction coefficient, with units in
    their headings. ``stiffness``, 1/µm, ``speeds``, µm/s, and ``changes``, s, are given where they are known.

    Raises
    ------
    InputError
        A column is missing, a cell holds no number, or no speed changes.
    """
    table = read_columns(source, COLUMNS, EXAMPLE)
    units = {"hold_time": "s", "displacement": "um", COLUMNS[2]: ""}
    if COLUMNS[3] in table.columns:
        units[COLUMNS[3]] = units.pop(COLUMNS[2])
    for name in units:
        if name not in table.columns:
            raise InputError(
                f"{table.where}: no column {name}; a trace has columns such as {EXAMPLE}"
            )
    times, way, values = (
        np.array([table.number(row, name, unit) for row in table.rows])
        for name, unit in units.items()
    )
    name = source if isinstance(source, str) else getattr(source, "name", "trace")
    _rising(str(name), times)
    loading = loading_of(times, way, speeds, changes)
    return Trace(str(name), times, values, loading, stiffness)


def trace_of(run: Any, stiffness: float | None = None) -> Trace:
    """The trace of a simulated programme of slides and holds: mean friction of its replicas over the load.

    Raises
    ------
    InputError
        ``run`` has no slider, conditions change beside its speed, or in a ramp, its first slide does not become steady,
        or too few bonds form.
    """
    seen = getattr(run.ageing, "observables", {})
    if "step_speed" not in seen:
        raise InputError(
            f"{run.name}: no programme of slides; give [protocol] or [[step]] with speeds"
        )
    speeds, points, loads = (
        seen[name][0] for name in ("step_speed", "step_points", "step_load")
    )
    for name, values in (("load", loads), ("temperature", seen["temperature"][0])):
        if np.ptp(values) > 0:
            raise InputError(
                f"{run.name}: the {name} changes; friction laws have one {name}"
            )
    for number, step in enumerate(run.scene.get("step", ())):
        for name in ("speed", "load", "spring"):
            if isinstance(step.get(name), Mapping) or name == "spring" in step:
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
    if not speeds.any():
        raise InputError(f"{run.name}: no step has a speed")
    first, times = int(np.argmax(speeds > 0)), run.ageing.hold_times
    number = np.repeat(np.arange(points.size), points)
    starts = times[np.unique(number, return_index=True)[1]]
    end = times[number == first][-1]
    # the first point of a step is the last of the one before
    kept = (times >= end - STEADY * (end - starts[first])) & (number >= first)
    kept &= np.append(True, np.diff(times) > 0)
    begins = np.append(times[kept][0], starts[first + 1 :])
    loading = Loading(begins, 1e-3 * speeds[first:])
    spring = run.scene.get("drive", {}).get("spring")
    friction = run.ageing.friction_drop.mean(axis=0)[kept] / loads[0]
    if stiffness is None and isinstance(spring, int | float):
        stiffness = 1e3 * float(spring) / loads[0]
    return Trace(run.name, times[kept], friction, loading, stiffness)
