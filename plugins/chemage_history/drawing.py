"""The figure of a programme: what is done above, what comes of it below, on one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import PlottedResult, figures, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: rows from the top: what is drawn -> label; those that never change are left out
CONDITIONS = {
    "applied_load": "load (nN)",
    "held_at": "T (K)",
    "drive_speed": "speed (nm/s)",
}


def time_axis(
    times: np.ndarray, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(m,) places on an axis on which every step has the width 1, logarithmic at rest; and where steps begin, (k + 1,)
    times."""
    begins = np.flatnonzero(np.append(True, np.diff(times) == 0))
    places = np.empty(times.size)
    ends = [*begins[1:], times.size]
    for number, (first, last) in enumerate(zip(begins, ends, strict=True)):
        passed = times[first:last] - times[first]
        part = passed / (passed[-1] or 1.0)
        if not speed[first] and passed.size > 2 and passed[1] > 0:
            decades = np.log10(passed[1:] / passed[1])
            part = np.append(0.0, (1 + decades) / (1 + decades[-1]))
        places[first:last] = number + part
    return places, np.append(times[begins], times[-1])


def draw_programme(axes: Axes, results: Sequence[PlottedResult]) -> None:
    """Draw each result into rows within ``axes``."""
    there = [
        one
        for one in results
        if one.aging is not None and "drive_speed" in one.aging.observables
    ]
    if not there:
        return
    assert there[0].aging is not None
    first = there[0].aging.observables
    names = [name for name in CONDITIONS if np.ptp(first[name]) > 0]
    below = ["force (nN)"] if there[0].aging.rupture_force is not None else []
    rows = [*(CONDITIONS[name] for name in names), *below, "bonds", "area (nm²)"]
    heights = [1.0] * len(names) + [2.0] * (len(below) + 1) + [1.0]
    tops = 1 - np.cumsum(heights) / sum(heights)
    axes.axis("off")
    for row, label in enumerate(rows):
        height = 0.9 * heights[row] / sum(heights)
        plot = axes.inset_axes((0.0, float(tops[row]), 1.0, height))
        for one in there:
            assert one.aging is not None
            seen = one.aging.observables
            places, begins = time_axis(one.aging.hold_times, seen["drive_speed"][0])
            values = {
                "force (nN)": one.aging.rupture_force,
                "bonds": one.aging.bonds,
                "area (nm²)": seen["contact_area"],
            }.get(label)
            if values is None:
                values = seen[names[row]]
            plot.plot(
                places,
                values.mean(axis=0),
                color=one.color,
                lw=1.2,
                label=one.label,
            )
            ticks = [text.power_text(float(time)) for time in begins]
            last = row == len(rows) - 1
            plot.set_xticks(range(len(begins)), ticks if last else [])
        plot.set_ylabel(label)
        if row == 0 and len(there) > 1:
            figures.legend(plot)
        if row == len(rows) - 1:
            plot.set_xlabel("time (s); logarithmic within holds")
