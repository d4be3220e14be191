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
    "step_area": "area (nm²)",
    "step_load": "load (nN)",
    "temperature": "temperature (K)",
    "step_speed": "speed (nm/s)",
}
#: part of a band that is filled
FILLED = 0.75


def time_axis(
    times: np.ndarray, number: np.ndarray, speeds: np.ndarray
) -> np.ndarray:
    """(m,) places of times, of the steps with this ``number``, on an axis on which each step has the width 1; it is
    logarithmic at rest."""
    places = number.astype(float)
    for step, speed in enumerate(speeds):
        own = number == step
        passed = times[own] - times[own][0]
        part = passed / (passed[-1] or 1.0)
        if not speed and passed.size > 2 and passed[1] > 0:
            decades = np.log10(passed[1:] / passed[1])
            part = np.append(0.0, (1 + decades) / (1 + decades[-1]))
        places[own] += part
    return places


def draw_programme(axes: Axes, results: Sequence[PlottedResult]) -> None:
    """Draw each result in bands above each other, each from its least to its largest value."""
    bands: dict[str, list[tuple[PlottedResult, np.ndarray, np.ndarray]]] = {}
    for one in results:
        if (aging := one.aging) is None:
            continue
        times, seen = aging.hold_times, aging.observables
        points = seen.get("step_points", np.array([[times.size]]))[0]
        number = np.repeat(np.arange(points.size), points)
        speeds = seen.get("step_speed", np.zeros((1, 1)))[0]
        places = time_axis(times, number, speeds)
        begins = [*times[np.unique(number, return_index=True)[1]], times[-1]]
        ticks = [text.power_text(float(time)) for time in begins]
        axes.set_xticks(range(len(ticks)), ticks)
        curves = {"bonds": aging.bonds, "force (nN)": aging.friction_drop}
        for name, label in CONDITIONS.items():
            if name in seen and np.ptp(seen[name]) > 0:
                of_steps = seen[name].shape[1] == points.size
                curves[label] = seen[name][:, number] if of_steps else seen[name]
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
    axes.set(xlabel="time (s), logarithmic within holds", ylim=(-0.05, len(bands)))
    if len(results) > 1:
        figures.legend(axes)
