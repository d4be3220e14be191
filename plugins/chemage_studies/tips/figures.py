"""The figures of the study of tips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import figures
from chemage_studies.tips.study import UNIFORM, Study, deviation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"tip": figures.BLUE, "rough": figures.ORANGE, "equal area": figures.GREEN}
_MARKS = {"tip": "o", "rough": "s", "equal area": "^"}
_LABELS = {"tip": "tips", "rough": "rough, equal nominal pressure", "equal area": "rough, at a tip's area"}


def _figure(columns: int) -> tuple[Figure, list[Axes]]:
    return figures.panels(4.8 * columns, 3.8, columns, dpi=90)


def _groups(study: Study) -> list[str]:
    return list(dict.fromkeys(one.group for one in study.contacts))


def collapse_figure(study: Study) -> Figure:
    """Draw ΔF of every contact against hold time, per contact area, and relative to the prediction."""
    figure, axes = _figure(3)
    for one in study.contacts:
        style: dict[str, Any] = {"color": _COLOURS[one.group], "lw": 0.9, "alpha": 0.8}
        axes[0].plot(study.times, one.aging.mean_friction_drop, **style)
        axes[1].plot(study.times, one.density, **style)
    for time in study.times:
        deviations, _ = deviation(study, float(time))
        for group in _groups(study):
            values = [1 + value for value, one in zip(deviations, study.contacts, strict=True) if one.group == group]
            axes[2].plot([time] * len(values), values, color=_COLOURS[group], marker=".", ms=3, ls="none")
    for group in _groups(study):
        axes[0].plot([], [], color=_COLOURS[group], label=_LABELS[group])
    for pressure in (UNIFORM[0], 2.0, 4.0):
        curve = study.uniform[UNIFORM.index(pressure)]
        label = "uniform, no pressure" if pressure < 0.1 else f"uniform, {pressure:g} GPa"
        dashes = {0: ":", 1: "--", 2: "-."}[(UNIFORM[0], 2.0, 4.0).index(pressure)]
        axes[1].plot(study.times, curve, color=figures.BLACK, lw=1.3, ls=dashes, label=label)
    axes[2].axhline(1, color=figures.GREY, lw=1)
    axes[0].set(xscale="log", yscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    axes[1].set(xscale="log", xlabel="hold time (s)", ylabel="bonds per contact area (1/nm²)", ylim=(0, None))
    axes[2].set(xscale="log", xlabel="hold time (s)", ylabel="bonds / prediction from area and pressures")
    axes[2].set_ylim(0.8, 1.2)
    for one in axes[:2]:
        one.legend(frameon=False, fontsize=8)
    return figure


def pressure_figure(study: Study) -> Figure:
    """Draw bonds per area and Δμ at 1000 s against the mean contact pressure."""
    figure, axes = _figure(2)
    at = study.contacts[0].at(1e3)
    axes[0].plot(UNIFORM, study.uniform[:, at], color=figures.GREY, ls="--", lw=1.2, label="uniform pressure, no rim")
    for group in _groups(study):
        members = study.group(group)
        pressure = [one.contact.mean_contact_pressure for one in members]
        style: dict[str, Any] = {"color": _COLOURS[group], "marker": _MARKS[group], "ls": "none", "ms": 4.5}
        axes[0].plot(pressure, [one.density[at] for one in members], label=_LABELS[group], **style)
        axes[1].plot(pressure, [one.aging.mean_friction_coefficient_drop[at] for one in members], **style)
    highest = max(one.contact.mean_contact_pressure for one in study.contacts)
    most = max(one.density[at] for one in study.contacts)
    axes[0].set(xlim=(0, 1.1 * highest), ylim=(0, 1.5 * most), xlabel="mean contact pressure (GPa)")
    axes[0].set_ylabel("bonds per contact area at 1000 s (1/nm²)")
    axes[1].set(xscale="log", yscale="log", xlabel="mean contact pressure (GPa)", ylabel="Δμ at 1000 s")
    for axis, values in ((axes[1].xaxis, (0.5, 1, 2, 4, 8)), (axes[1].yaxis, (1, 2, 3, 4, 5))):
        axis.set_ticks(values, [f"{value:g}" for value in values])
        axis.set_ticks([], minor=True)
    axes[0].legend(frameon=False, fontsize=8)
    return figure


def rim_figure(studies: Sequence[Study]) -> Figure:
    """Draw the deviation from the prediction of area and pressure against the length of the rim."""
    figure, axes = _figure(len(studies))
    for one, study in zip(axes, studies, strict=True):
        deviations, rim = deviation(study, 1e3)
        for group in _groups(study):
            chosen = np.array([member.group == group for member in study.contacts])
            style: dict[str, Any] = {"color": _COLOURS[group], "marker": _MARKS[group], "ls": "none", "ms": 4.5}
            one.plot(rim[chosen], 100 * deviations[chosen], label=_LABELS[group], **style)
        slope = study.rim_effect(1e3)
        line = np.array([0, 1.05 * rim.max()])
        label = f"{100 * slope:.1f} % per 1/nm"
        one.plot(line, 100 * slope * line, color=figures.GREY, lw=1, ls="--", label=label)
        one.set(xlabel="perimeter to area C/A (1/nm)", title=f"interaction {study.strength:g} eV", xlim=(0, None))
        one.set_ylabel("deviation of the bonds at 1000 s (%)")
        one.legend(frameon=False, fontsize=8)
    return figure
