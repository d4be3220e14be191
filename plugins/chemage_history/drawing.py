"""The figure of a programme: what is done above, what comes of it below, on one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import PlottedResult, figures, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what is drawn of the programme, above what comes of it, where it changes -> label
CONDITIONS = {
    "contact_area": "area (nm²)",
    "applied_load": "load (nN)",
    "held_at": "temperature (K)",
    "drive_speed": "speed (nm/s)",
}
#: part of a band that is filled
FILLED = 0.75


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
    """Draw each result in bands above each other, each from its least to its largest value."""
    bands: dict[str, list[tuple[PlottedResult, np.ndarray, np.ndarray]]] = {}
    ticks: dict[float, str] = {}
    for one in results:
        if (aging := one.aging) is None:
            continue
        still = np.zeros((1, aging.hold_times.size))
        speed = aging.observables.get("drive_speed", still)
        places, begins = time_axis(aging.hold_times, speed[0])
        ticks = {k: text.power_text(float(time)) for k, time in enumerate(begins)}
        curves = {"bonds": aging.bonds, "force (nN)": aging.friction_drop}
        curves |= {
            label: aging.observables[name]
            for name, label in CONDITIONS.items()
            if np.ptp(aging.observables.get(name, still)) > 0
        }
        for label, values in curves.items():
            bands.setdefault(label, []).append((one, places, values.mean(axis=0)))
    for bottom, (label, drawn) in enumerate(bands.items()):
        low = min(float(values.min()) for _, _, values in drawn)
        high = max(float(values.max()) for _, _, values in drawn)
        for one, places, values in drawn:
            height = FILLED * (values - low) / ((high - low) or 1.0)
            name = one.label if bottom == 0 and len(results) > 1 else None
            axes.plot(places, bottom + height, color=one.color, lw=1.2, label=name)
        words = f"{label}: {low:.3g} to {high:.3g}"
        axes.text(0.0, bottom + FILLED, words, va="bottom", fontsize="small")
    axes.set_yticks([])
    axes.set_xticks([*ticks], [*ticks.values()])
    axes.set(xlabel="time (s), logarithmic within holds", ylim=(-0.05, len(bands)))
    if len(results) > 1:
        figures.legend(axes)
