"""The figure of an ensemble: its mean curve with the single surfaces, and the parts of the error."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from chemage.ageing.fitting import short_doubt, span_text
from chemage.foundation.text import percent, with_error
from chemage.results.ensemble_text import over
from chemage.results.figures import BLUE, GREY, ORANGE, legend, panels, plain, save_figures
from chemage.studies.ensembles.ensemble import SOURCES, Ensemble

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: more single surfaces are not drawn, of those there are the first
MOST_CURVES = 200


def ensemble_figure(made: Ensemble, *, dpi: float = 150) -> Figure:
    """Draw Δμ (ΔF without load) against hold time, with the 95 % interval of the mean and the single surfaces, and the
    parts of the error of β, or else of the first quantity there is. Without ageing the parts alone."""
    figure, axes = panels(10.5, 4.2, 2, dpi=dpi) if ages(made) else panels(5.6, 3.2, dpi=dpi)
    if ages(made):
        draw_curve(axes[0], made)
    draw_parts(axes[-1], made)
    figure.suptitle(made.title, fontsize=10, parse_math=False)
    return figure


def ages(made: Ensemble) -> bool:
    """Whether there is a curve to draw against hold time."""
    return bool((made.hold_times > 0).any())


def draw(
    axes: Axes, made: Ensemble, singles: bool = True, color: str | None = None, label: str = "", size: float = 7.5
) -> None:
    """Draw the curve, or without ageing the parts of the error."""
    if ages(made):
        draw_curve(axes, made, singles, color, label, size)
    else:
        draw_parts(axes, made, 7.0)


def draw_curve(
    axes: Axes, made: Ensemble, singles: bool = True, color: str | None = None, label: str = "", size: float = 7.5
) -> None:
    """Draw the mean curve with its 95 % interval as a band, the single surfaces, and the line of β."""
    shown = made.hold_times > 0
    times, scale = made.hold_times[shown], 1 / made.load if made.load > 0 else 1.0
    what = "surfaces" if made.random else "replicas"
    if singles:
        for number, curve in enumerate(scale * made.single_friction_drops[:MOST_CURVES, shown]):
            text = f"single {what}: {made.levels[0]['words']}"
            axes.plot(times, curve, color=GREY, lw=0.5, alpha=0.4, label=text if number == 0 else None)
    mean, half = scale * made.friction_drop[shown], scale * made.friction_drop_half_width[shown]
    own = color or BLUE
    of = label or f"mean of {over(made)}"
    axes.plot(times, mean, color=own, lw=1.6, marker="o", ms=3, label=plain(of))
    if np.isfinite(half).any():
        axes.fill_between(
            times, mean - half, mean + half, color=own, alpha=0.3, lw=0, label="95 % interval of the mean"
        )
    if made.quantities.has_beta:
        beta, fitted = made.estimate("beta"), made.quantities.fitted[shown]
        x = np.log10(times[fitted])
        line = mean[fitted].mean() + beta.value * (x - x.mean())
        text = f"β = {with_error(beta.value, beta.half_width)} per decade (line, {span_text(made.quantities.span)})"
        text += f"\n{short_doubt(made.quantities.doubt)}" * bool(made.quantities.doubt)
        axes.plot(times[fitted], line, color=ORANGE, lw=1.2, zorder=3, label=plain(text))
    axes.set(xscale="log", xlabel="hold time (s)")
    axes.set_ylabel("friction coefficient drop Δμ" if made.load > 0 else "friction drop ΔF (nN)")
    axes.set_ylim(bottom=0)
    legend(axes, fontsize=size)


def draw_parts(axes: Axes, made: Ensemble, size: float = 8.5) -> None:
    """Draw the standard errors as bars, in percent of the mean, with how each is known."""
    name = made.quantities.names[0]
    one = made.estimate(name)
    parts = [(SOURCES.get(part, part), error) for part, error in one.errors.items()]
    for number, (label, error) in enumerate(parts):
        share = 100 * error.size / abs(one.value) if one.value else math.nan
        known = math.isfinite(share)
        axes.barh(number, share if known else 0.0, color=BLUE, height=0.4)
        text = percent(share / 100) if known else "not known"
        axes.text(0.0, number - 0.28, f" {label}: {text}", fontsize=size, va="bottom", parse_math=False)
        axes.text(0.0, number + 0.24, f" {error.how}", fontsize=size - 1.5, va="top", color=GREY, parse_math=False)
    shown = {"beta": "β"}.get(name, name.replace("_", " "))
    axes.set_yticks([])
    axes.set_ylim(max(len(parts), 2) - 0.4, -0.6)  # bars of one height, also where there is only one
    axes.set_xlim(left=0)
    title = f"{shown}: 95 % interval ± {percent(one.relative)}" if math.isfinite(one.relative) else shown
    axes.set(xlabel=f"standard error of {shown} (%)", title=title)


def save(made: Ensemble, folder: Path, *, force: bool = False, suffix: str = "png") -> list[Path]:
    """Write the figure into ``folder``; see :func:`chemage.results.figures.save_figures`."""
    return save_figures({"ensemble": ensemble_figure(made)}, folder, force=force, suffix=suffix)
