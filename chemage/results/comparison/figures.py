"""Figures of a comparison: friction, bonds per area, pressures, and the figures of plugins, of several results."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.fitting import SYMBOL, Quantity
from chemage.ageing.observables import Maps, PlottedResult
from chemage.contacts.solution import ContactSolution
from chemage.foundation.statistics import NORMAL_LIMIT, half_width
from chemage.results.comparison.comparison import Comparison, Curves, coefficient, friction
from chemage.results.comparison.entries import Entry
from chemage.results.ensemble_text import over
from chemage.results.figures import BLACK, PALETTE, blank, draw_fit, legend, legend_entries, plain, replicas_text
from chemage.results.plugin_figures import Brought, Source, chemistry_of, plugin_figures
from chemage.results.published import draw_published
from chemage.scene.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = "osD^vP*X"
#: fits are drawn for up to this many results
_FITTED = 4
#: inches; small, so that the text is legible on a phone
_SIZE = (4.9, 3.6)


def _styles(count: int) -> list[dict[str, Any]]:
    """Colour and marker of each curve."""
    return [{"color": PALETTE[i % len(PALETTE)], "marker": _MARKERS[i % len(_MARKERS)]} for i in range(count)]


def _drawn(axes: Axes, results: Sequence[Entry], curves: Curves) -> list[float]:
    """Draw mean and 95 % interval of each result against hold time; return the last mean of each."""
    last: list[float] = []
    among = any(one.ensemble is not None for one in results)
    for one, style in zip(results, _styles(len(results)), strict=True):
        if one.ensemble is not None:
            last += _drawn_ensemble(axes, one, curves, style)
            continue
        values = curves(one)
        if one.aging is None or not values.size or not np.isfinite(values).any():
            continue
        t, mean = one.aging.hold_times, values.mean(axis=0)
        error = np.nan_to_num(half_width(values))
        shown = t > 0
        bars = error[shown] if error.any() else None
        single = " on one surface" if among and one.aging.replicas > 1 else ""
        label = f"{one.legend}, {replicas_text(one.aging).replace(' replicas', f' replicas{single}')}"
        axes.errorbar(t[shown], mean[shown], yerr=bars, ms=3.5, lw=1, capsize=2, label=label, **style)
        last.append(float(mean[-1]))
    return last


def _drawn_ensemble(axes: Axes, one: Entry, curves: Curves, style: dict[str, Any]) -> list[float]:
    """Draw the mean of an ensemble with its interval, and return its last value.

    A band contains the scatter between surfaces; bars are errors of replicas on one surface, as of a run.
    """
    made = one.ensemble
    if made is None or curves not in (friction, coefficient) or (curves is coefficient and not one.load > 0):
        return []
    scale = 1.0 if curves is friction else 1 / one.load
    shown = made.hold_times > 0
    if not shown.any():
        return []
    t, mean, half = (values[shown] for values in (made.hold_times, made.friction_drop, made.friction_drop_half_width))
    label = f"{one.legend}, mean of {over(made)}, 95 %"
    if not one.of_surfaces:
        axes.errorbar(t, scale * mean, yerr=scale * half, ms=3.5, lw=1, capsize=2, label=label, **style)
        return [scale * float(mean[-1])]
    axes.plot(t, scale * mean, ms=3.5, lw=1, label=f"{label} band", **style)
    if np.isfinite(half).any():
        low, high = scale * (mean - half), scale * (mean + half)
        axes.fill_between(t, low, high, color=style["color"], alpha=0.25, lw=0)
    return [scale * float(mean[-1])]


def _scaled(axes: Axes, last: Sequence[float]) -> None:
    """Use a logarithmic scale if the curves end more than a decade apart."""
    positive = [value for value in last if value > 0]
    if positive and max(positive) > 10 * min(positive):
        lowest = min(positive) / 300
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], lowest))
    else:
        axes.set_ylim(bottom=0)


def _against_time(results: Sequence[Entry], curves: Curves, label: str) -> tuple[Figure, Axes, list[float]]:
    figure, axes = blank(*_SIZE)
    last = _drawn(axes, results, curves)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel=label)
    return figure, axes, last


def _finish(figure: Figure, axes: Axes, last: Sequence[float]) -> Figure:
    """Scale the axis, and put the legend inside or, if it is long, below the plot."""
    _scaled(axes, last)
    handles, labels = legend_entries(axes)
    if len(labels) <= 4:
        legend(axes, fontsize=7)
    else:
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + 0.16 * len(labels))
        figure.legend(handles, labels, loc="outside lower left", frameon=False, fontsize=7)
    return figure


def _darker(color: str) -> str:
    """The colour of the line fitted to a curve of this colour."""
    return "#" + "".join(f"{round(0.6 * int(color[at : at + 2], 16)):02X}" for at in (1, 3, 5))


def _overlay(axes: Axes, comparison: Comparison, quantity: Quantity) -> None:
    loads = {one.load for one in comparison.results}
    load = loads.pop() if len(loads) == 1 else None
    for number, original in enumerate(comparison.measured):
        data = original.as_quantity(quantity, load)
        if data is None:
            continue
        shown = data.hold_times > 0
        axes.errorbar(
            data.hold_times[shown],
            data.values[shown],
            yerr=None if data.error is None else NORMAL_LIMIT * data.error[shown],
            fmt="sDo^v"[number % 5],
            mfc="none",
            color=BLACK,
            ms=5,
            lw=1,
            capsize=2,
            label=plain(f"{data.name} (measured)" if data.error is None else f"{data.name} (measured, 95 %)"),
        )
        fit = comparison.measured_fit(data, "curve")
        if fit is not None and fit.drawable:
            line = np.geomspace(*fit.span, 100)
            label = plain(f"{data.name}: {fit.short_text()}")
            axes.plot(line, fit(line), color=BLACK, lw=1, ls=("--", ":", "-.")[number % 3], label=label)


def comparison_figures(comparison: Comparison) -> dict[str, Figure]:
    """Draw every figure for which there are data, those of plugins last: name -> figure."""
    brought = comparison_brought(comparison.results)
    return {**core_figures(comparison), **{name: one.figure for name, one in brought.items()}}


def core_figures(comparison: Comparison) -> dict[str, Figure]:
    """Draw chemage's own figures for which there are data: name -> figure."""
    made = {
        "friction-drop": friction_drop_figure(comparison),
        "friction-coefficient-drop": friction_coefficient_figure(comparison),
        "bonds-per-area": bonds_figure(comparison.results),
        "pressures": pressures_figure(comparison.results),
    }
    return {name: figure for name, figure in made.items() if figure is not None}


def friction_drop_figure(comparison: Comparison) -> Figure | None:
    """Draw ΔF against hold time, and measurements of ΔF, or of Δμ if all results have the same load."""
    if not any(one.ages for one in comparison.results):
        return None
    figure, axes, last = _against_time(comparison.results, friction, f"friction drop {SYMBOL['friction_drop']} (nN)")
    _overlay(axes, comparison, "friction_drop")
    return _finish(figure, axes, last)


def friction_coefficient_figure(comparison: Comparison) -> Figure | None:
    """Draw Δμ against hold time, and measurements."""
    if not any(one.ages and one.load > 0 for one in comparison.results):
        return None
    label = f"friction coefficient drop {SYMBOL['friction_coefficient_drop']}"
    figure, axes, last = _against_time(comparison.results, coefficient, label)
    few = len(comparison.results) <= _FITTED
    for one, style in zip(comparison.results, _styles(len(comparison.results)), strict=True):
        if few:
            alone = len(comparison.results) == 1
            draw_fit(axes, one.fit, *(() if alone else (one.name, _darker(style["color"]))))
    if len(comparison.results) == 1:
        (one,) = comparison.results
        draw_published(axes, one.scene, one.fit)
    _overlay(axes, comparison, "friction_coefficient_drop")
    return _finish(figure, axes, last)


def bonds_figure(results: Sequence[Entry]) -> Figure | None:
    """Draw bonds per contact area against hold time."""
    if not any(np.isfinite(one.bonds_per_area).any() for one in results):
        return None
    figure, axes, last = _against_time(results, lambda one: one.bonds_per_area, "bonds per contact area (1/nm²)")
    return _finish(figure, axes, last)


def pressures_figure(results: Sequence[Entry]) -> Figure | None:
    """Draw the distribution of the pressure over each contact."""
    shown = [(one, style) for one, style in zip(results, _styles(len(results)), strict=True) if one.pressure]
    if not shown:
        return None
    figure, axes = blank(*_SIZE)
    for one, style in shown:
        assert one.pressure is not None
        edges, density = one.pressure
        axes.stairs(density, edges, color=style["color"], lw=1.4)
        middles, every = 0.5 * (edges[1:] + edges[:-1]), max(1, density.size // 8)
        axes.plot(middles, density, ls="none", markevery=every, ms=3.5, **style)
        axes.plot([], [], lw=1.4, ms=3.5, label=one.legend, **style)  # line and marker in one entry of the legend
    axes.set(xlabel="contact pressure (GPa)", ylabel="density over the contact (1/GPa)", xlim=(0, None), ylim=(0, None))
    axes.legend(frameon=False, fontsize=8)
    return figure


def comparison_brought(results: Sequence[Entry]) -> dict[str, Brought]:
    """Draw the figures that plugins bring to several results: name -> figure and caption."""

    @lru_cache(maxsize=1)  # the maps of a large contact take 100 MB
    def maps(number: int) -> Maps:
        whole = results[number].whole
        thing = whole() if whole is not None else None
        if isinstance(thing, Run):
            return Maps(thing.contact if isinstance(thing.contact, ContactSolution) else None, thing.surface)
        return Maps(thing) if isinstance(thing, ContactSolution) else Maps()

    sources = []
    for number, (one, style) in enumerate(zip(results, _styles(len(results)), strict=True)):
        chemistry = chemistry_of(one.aging.provenance) if one.aging is not None else None
        result = PlottedResult(
            one.legend, one.aging, chemistry, style["color"], scene=one.scene, load_maps=partial(maps, number)
        )
        sources.append(Source(result, one.components(), one.plugins))
    return plugin_figures(sources, size=_SIZE)
