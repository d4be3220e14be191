"""The plots of an inference: density, data, predictive bands, forecasts, unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from chemage.foundation.figures import BLACK, BLUE, GREEN, GREY, ORANGE, PALETTE, legend, plain
from chemage.foundation.result import Medium
from chemage.foundation.statistics import NORMAL_LIMIT
from chemage.inference.display import UNITS, density_text, unseen_text
from chemage.inference.forecast import Forecast, band
from chemage.inference.result import Inference
from chemage.inference.shape import peaks, unresolved

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: forecasts that are drawn, in one figure
MOST = 6
_LINES = ("-", "--", ":", "-.")


def draw_density(axes: Axes, medium: Medium, one: Inference) -> None:
    """Draw the density with its bands, the visible energies shaded, families as lines, and the band of the prior."""
    e = one.energies
    low, high = one.visible_range
    if np.isfinite(low):
        axes.axvspan(low, high, color=GREEN, alpha=0.10, lw=0, label="visible energies", zorder=0)
    for level, alpha in ((0.95, 0.22), (0.68, 0.38)):
        axes.fill_between(e, *one.band(level), color=BLUE, alpha=alpha, lw=0, label=f"{100 * level:.0f} % band")
    axes.plot(e, one.density, color=BLUE, lw=1.6, label="mean")
    for fill_style, what, places in (
        ("full", "peak", [peak.energy for peak in peaks(one)]),
        ("none", "maximum, not resolved", unresolved(one)),
    ):
        if places:
            heights = np.interp(places, e, one.density)
            axes.plot(places, heights, "v", color=BLUE, fillstyle=fill_style, ms=7, label=what)
    prior = one.prior_band(0.95)
    axes.plot(e, prior[1], color=GREY, lw=0.9, ls="--", label="prior, upper end of the 95 % band")
    for number, (name, fit) in enumerate(one.families.items()):
        if density := fit.get("density", ()):
            axes.plot(
                e[: len(density)], density, color=ORANGE, lw=1.0, ls=_LINES[number % len(_LINES)], label=plain(name)
            )
    seen = one.visible if one.visible.any() else np.ones(e.size, dtype=bool)
    top = 1.6 * float(max(one.band(0.95)[1][seen].max(), one.density.max()))
    beyond = 0.4 if np.isfinite(low) else np.inf
    axes.set_xlim(max(e[0], low - beyond), min(e[-1], high + beyond))
    axes.set_ylim(0, top or 1.0)
    axes.set(xlabel="forming barrier (eV)", ylabel="density (1/eV)")
    axes.set_title(fill(density_text(one), 76), fontsize=medium.font)
    legend(axes, fontsize=medium.font, ncols=2)


def draw_data(axes: Axes, medium: Medium, one: Inference) -> None:
    """Draw the measured friction drop and the bands of the fitted curves."""
    for number, about in enumerate(one.curves):
        colour, here = PALETTE[number % len(PALETTE)], one.curve == number
        order = np.argsort(one.hold_times[here], kind="stable")
        times, fitted = one.hold_times[here][order], one.fitted[:, here][:, order]
        for level, alpha in ((0.95, 0.2), (0.68, 0.35)):
            axes.fill_between(times, *band(fitted, level), color=colour, alpha=alpha, lw=0)
        axes.plot(times, np.median(fitted, axis=0), color=colour, lw=1.0)
        label = plain(f"{about['name']}: {about['load']:g} nN, {about['temperature']:g} K")
        bars = NORMAL_LIMIT * one.errors[here]
        axes.errorbar(one.hold_times[here], one.values[here], bars, fmt="o", ms=3.2, lw=0.9, color=colour, label=label)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    axes.set_ylim(bottom=min(0.0, float((one.values - NORMAL_LIMIT * one.errors).min())))
    legend(
        axes,
        fontsize=medium.font,
        title="points: measured, bars 95 %; bands: 68 and 95 %",
        title_fontsize=medium.font,
        alignment="left",
    )


def draw_residuals(axes: Axes, medium: Medium, one: Inference) -> None:
    """Draw measured minus fitted in standard errors."""
    residuals = one.residuals
    axes.axhspan(-2, 2, color=GREY, alpha=0.15, lw=0)
    axes.axhline(0, color=GREY, lw=0.8)
    for number in range(len(one.curves)):
        here = one.curve == number
        axes.plot(one.hold_times[here], residuals[here], "o", ms=3.2, color=PALETTE[number % len(PALETTE)])
    most = 1.15 * max(3.0, float(np.abs(residuals).max(initial=0)))
    axes.set_ylim(-most, most)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="residual (standard errors)")


def draw_predictive(axes: Axes, medium: Medium, one: Inference) -> None:
    """Draw what prior and posterior predict of the measurements, the scatter of a measurement included."""
    rng = np.random.default_rng(0)
    for number in range(len(one.curves)):
        here = np.flatnonzero(one.curve == number)
        here = here[np.argsort(one.hold_times[here], kind="stable")]
        times = one.hold_times[here]
        for samples, colour, alpha, what in (
            (one.prior_fitted, GREY, 0.25, "prior, 95 % band"),
            (one.fitted, BLUE, 0.35, "posterior with the errors of the data, 95 % band"),
        ):
            values = samples[:, here] + one.errors[here] * rng.standard_normal((len(samples), here.size))
            label = what if number == 0 else None
            axes.fill_between(times, *band(values, 0.95), color=colour, alpha=alpha, lw=0, label=label)
        axes.plot(times, one.values[here], "o", ms=3, color=BLACK, label="measured" if number == 0 else None)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    legend(axes, fontsize=medium.font)


def draw_forecasts(axes: Axes, medium: Medium, one: Inference, forecasts: Mapping[str, Forecast]) -> None:
    """Draw forecasts with their bands, and the measurements."""
    for number in range(len(one.curves)):
        here = one.curve == number
        label = "measured" if number == 0 else None
        axes.plot(one.hold_times[here], one.values[here], "o", ms=2.5, color=GREY, label=label)
    for number, (label, forecast) in enumerate(list(forecasts.items())[:MOST]):
        colour = PALETTE[number % len(PALETTE)]
        times, name = forecast.hold_times, plain(label + unseen_text(forecast))
        low, high = forecast.band()
        single = times.size == 1
        if forecast.bounds_only:
            style = {"marker": "_", "ms": 9, "lw": 0} if single else {"ls": "--", "lw": 1.0}
            axes.plot(times, low, color=colour, label=name, **style)
            axes.plot(times, high, color=colour, **style)
            continue
        for level, alpha in ((0.95, 0.2), (0.68, 0.35)):
            axes.fill_between(times, *forecast.band(level), color=colour, alpha=alpha, lw=0)
        axes.plot(
            times, forecast.median, color=colour, lw=1.3, label=name, **({"marker": "o", "ms": 4} if single else {})
        )
        if single:
            axes.vlines(times, low, high, color=colour, lw=1.2)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    axes.set_ylim(bottom=0)
    legend(axes, fontsize=medium.font, title="bands: 68 and 95 %", title_fontsize=medium.font, alignment="left")


def draw_scalar(axes: Axes, medium: Medium, one: Inference, name: str) -> None:
    """Draw the samples of an unknown, with the bounds of its prior."""
    values = one.scalars[name]
    low, high = one.scalar_bounds.get(name, (float(values.min()), float(values.max())))
    axes.hist(values, bins=list(np.linspace(low, high, 41)), color=BLUE, alpha=0.6, density=True)
    for end in (low, high):
        axes.axvline(end, color=GREY, lw=0.9, ls="--")
    for end in one.interval(name):
        axes.axvline(end, color=ORANGE, lw=1.0)
    unit = UNITS.get(name, "")
    axes.set(xlabel=f"{name.replace('_', ' ')}{f' ({unit})' if unit else ''}", ylabel="density of the samples")
    axes.set_title("orange: 95 %; grey: bounds of the prior", fontsize=8)
    axes.set_yticks([])
