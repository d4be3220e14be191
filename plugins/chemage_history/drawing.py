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


def time_axis(times: np.ndarray, speed: float) -> np.ndarray:
    """(m,) places from 0 to 1 of the times of a step; the axis is logarithmic at rest."""
    passed = times - times[0]
    if not speed and passed.size > 2 and passed[1] > 0:
        passed[1:] = 1 + np.log10(passed[1:] / passed[1])
    return passed / (passed[-1] or 1.0)


def draw_programme(axes: Axes, results: Sequence[PlottedResult]) -> None:
    """Draw each result in bands above each other, each from its least to its largest value."""
    bands: dict[str, list[tuple[PlottedResult, np.ndarray, np.ndarray]]] = {}
    for one in results:
        if (ageing := one.ageing) is None:
            continue
        times, seen = ageing.hold_times, ageing.observables
        points = seen.get("step_points", np.array([[times.size]]))[0]
        speeds = seen.get("step_speed", np.zeros((1, 1)))[0]
        steps = np.split(times, np.cumsum(points)[:-1])
        parts = enumerate(zip(steps, speeds, strict=True))
        places = np.concatenate([k + time_axis(*part) for k, part in parts])
        begins = [*(own[0] for own in steps), times[-1]]
        ticks = [text.power_text(float(time)) for time in begins]
        axes.set_xticks(range(len(ticks)), ticks)
        curves = {"bonds": ageing.bonds, "force (nN)": ageing.friction_drop}
        for name, label in CONDITIONS.items():
            if name in seen and np.ptp(values := seen[name]) > 0:
                of_steps = name.startswith("step_")
                curves[label] = np.repeat(values, points, 1) if of_steps else values
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
    figures.legend(axes)
