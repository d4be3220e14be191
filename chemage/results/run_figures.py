"""Figures of a run: the surface, the pressure and its patches, those of plugins, friction against hold time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.fitting import SYMBOL, UNIT, Quantity
from chemage.ageing.observables import Maps, PlottedResult
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.statistics import half_width
from chemage.results.figures import (
    BLUE,
    GREEN,
    GREY,
    MAP_PIXELS,
    ORANGE,
    blank,
    decades_only,
    draw_fit,
    draw_map,
    legend,
    panels,
    plain,
    pooled,
    replicas_text,
    save_figures,
)
from chemage.results.plugin_figures import Brought, Source, chemistry_of, plugin_figures
from chemage.results.published import draw_published
from chemage.scene.provenance import components_of
from chemage.scene.run import Run
from chemage.scene.scene import heading
from chemage.surfaces.surface import Surface

#: least distance, in decades, of the hold times between which a local slope is taken
SLOPE_SPAN = 0.5

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def surface_figure(surface: Surface) -> Figure:
    """Draw the height map, and the power spectral density of a periodic surface or else a profile."""
    figure, axes = panels(10.5, 4.2, 2)
    nx, ny = surface.shape
    draw_heights(axes[0], surface)
    if surface.periodic and surface.rms_height > 0 and min(surface.shape) > 3:
        q, density = surface.psd()
        shown = density > density.max() * 1e-14
        axes[1].loglog(q[shown], density[shown], color=BLUE, marker=".", ms=3, lw=1)
        axes[1].set(xlabel="wavenumber q (1/nm)", ylabel="power spectral density C(q) (nm$^4$)")
        decades_only(axes[1].yaxis)
        axes[1].tick_params(axis="x", which="minor", labelsize=6)
    else:
        x = (np.arange(nx) + 0.5) * surface.pixel_size
        axes[1].plot(x, surface.heights[:, ny // 2], color=BLUE, marker="." if nx < 3 else None)
        axes[1].set(xlabel="x (nm)", ylabel="height (nm)", title="through the middle")
    return figure


def pressure_figure(contact: ContactSolution) -> Figure | None:
    """Draw the pressure over the whole contact, and around the largest patch with the outlines of patches.

    A contact of one patch is drawn once, where it is; None without contact.
    """
    if not contact.patches:
        return None
    if contact.patches == 1:
        figure, axes = blank(6.0, 4.6)
        _draw_only_patch(axes, contact)
        return figure
    figure, both = panels(10.5, 4.8, 2)
    draw_pressure(both[0], contact)
    _draw_largest_patch(both[1], contact)
    return figure


def map_figures(contact: ContactSolution | ContactStatistics, surface: Surface | None = None) -> dict[str, Figure]:
    """Draw each map as a figure for narrow pages: ``heights``, ``pressure``, ``patch``, the largest of several."""
    made = {}
    if surface is not None:
        made["heights"], axes = blank(4.9, 3.9)
        draw_heights(axes, surface)
    if isinstance(contact, ContactStatistics):
        return made
    if contact.patches:
        made["pressure"], axes = blank(4.9, 3.9)
        (_draw_only_patch if contact.patches == 1 else draw_pressure)(axes, contact)
    if contact.patches > 1:
        made["patch"], axes = blank(4.9, 3.9)
        _draw_largest_patch(axes, contact)
    return made


def draw_heights(axes: Axes, surface: Surface, most: int = MAP_PIXELS, title: bool = True) -> None:
    """Draw the heights as a map of at most ``most`` blocks of pixels a side."""
    nx, ny = surface.shape
    extent = (0.0, nx * surface.pixel_size, 0.0, ny * surface.pixel_size)
    draw_map(axes, pooled(surface.heights, np.mean, most), extent, "height (nm)", cmap="cividis")
    if title:
        axes.set_title(f"rms height {surface.rms_height:.3g} nm, rms slope {surface.rms_slope:.3g}")


def _pressure_style(contact: ContactSolution) -> dict[str, Any]:
    low, top = float(contact.pressure.min()), float(contact.pressure.max()) or 1.0
    return {"cmap": "inferno_r", "vmin": low if low < top else 0.0, "vmax": top}


def draw_pressure(axes: Axes, contact: ContactSolution, most: int = MAP_PIXELS) -> None:
    """Draw the pressure as a map of at most ``most`` blocks of pixels a side, each with its largest pressure."""
    nx, ny = contact.shape
    extent = (0.0, nx * contact.pixel_size, 0.0, ny * contact.pixel_size)
    shown = np.ma.masked_equal(pooled(contact.pressure, np.max, most), 0.0)
    draw_map(axes, shown, extent, "pressure (GPa)", **_pressure_style(contact))
    axes.set_title(f"{_count(contact.patches, 'patch', 'patches')}, A/A$_0$ = {contact.area_fraction:.3g}")


def _draw_only_patch(axes: Axes, contact: ContactSolution) -> None:
    _draw_largest_patch(axes, contact, least=8, margin=1.3)
    axes.set_title(f"1 patch, A/A$_0$ = {contact.area_fraction:.3g}")


def _draw_largest_patch(axes: Axes, contact: ContactSolution, least: int = 64, margin: float = 2.0) -> None:
    a = contact.pixel_size
    (x0, x1), (y0, y1) = _around_largest_patch(contact, least, margin)
    part = contact.pressure[x0:x1, y0:y1]
    extent = (x0 * a, x1 * a, y0 * a, y1 * a)
    draw_map(axes, np.ma.masked_equal(part, 0.0), extent, "pressure (GPa)", **_pressure_style(contact))
    # thinner where pixels are small, so that outlines leave the pressure to be seen
    width = min(0.8, 160 / max(part.shape))
    axes.add_collection(_outlines(part > 0, x0, y0, a, width))
    axes.set_title("around the largest patch")


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _outlines(contact: np.ndarray, x0: int, y0: int, pixel: float, width: float) -> Any:
    """The pixel edges between contact and gap in a (nx, ny) map whose corner is pixel (x0, y0)."""
    from matplotlib.collections import LineCollection

    i, j = np.nonzero(np.diff(contact, axis=0))
    upright = np.stack([np.stack([i + 1, j], -1), np.stack([i + 1, j + 1], -1)], 1)
    i, j = np.nonzero(np.diff(contact, axis=1))
    level = np.stack([np.stack([i, j + 1], -1), np.stack([i + 1, j + 1], -1)], 1)
    edges = (np.concatenate([upright, level]) + np.array([x0, y0])) * pixel
    return LineCollection(list(edges), colors=GREEN, linewidths=width, capstyle="round")


def _around_largest_patch(
    contact: ContactSolution, least: int, margin: float
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Pixels of a window ``margin`` times the size of the largest patch, and at least ``least``: (x0, x1), (y0, y1)."""
    from scipy import ndimage

    nx, ny = contact.shape
    labels, count = ndimage.label(contact.contact, structure=np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    largest = int(np.bincount(labels.ravel(), minlength=count + 1)[1:].argmax()) + 1
    box = ndimage.find_objects(labels, max_label=largest)[largest - 1]
    side = max(least, math.ceil(margin * max(part.stop - part.start for part in box)))
    window = []
    for part, n in zip(box, (nx, ny), strict=True):
        low = max(0, min((part.start + part.stop - side) // 2, n - side))
        window.append((low, min(n, low + side)))
    return window[0], window[1]


def friction_figure(run: Run) -> Figure | None:
    """Draw Δμ against hold time, with 95 % intervals over replicas, the fitted line and published values; beside it
    its slope from hold time to hold time, which β averages.

    ΔF in place of Δμ without load; None without ageing or without a hold time above 0.
    """
    if run.aging is None or not (run.aging.hold_times > 0).any():
        return None
    aging = run.aging
    quantity: Quantity = "friction_coefficient_drop" if aging.load > 0 else "friction_drop"
    fit = run.fit() if aging.load > 0 else None
    several = np.unique(aging.hold_times[aging.hold_times > 0]).size > 1
    figure, axes = panels(10.5, 4.2, 2) if several else panels(5.6, 4.2)
    draw_friction(axes[0], aging, quantity, label=plain(f"{run.name}, {replicas_text(aging)}"))
    axes[0].set_ylim(bottom=0)
    draw_fit(axes[0], fit)
    draw_published(axes[0], run.scene, fit)
    legend(axes[0], fontsize=8)
    if several:
        draw_local_slope(axes[1], aging, quantity, label=replicas_text(aging))
        if fit is not None:
            axes[1].plot(fit.span, [fit.beta] * 2, color=ORANGE, lw=1.6, zorder=3, label="β of the fitted line")
        legend(axes[1], fontsize=8)
        axes[1].set_xlim(axes[0].get_xlim())
    for one in axes:
        decades_only(one.xaxis)
    figure.suptitle(
        f"{heading(run.scene)}, {aging.temperature:g} K"
        + (f"\napproximate: {run.approximate}" if run.approximate else ""),
        fontsize=10,
        parse_math=False,  # a dollar sign in a title is not a formula
    )
    return figure


def draw_friction(axes: Axes, aging: Aging, quantity: Quantity, colour: str = BLUE, label: str = "") -> None:
    """Draw means of ``quantity`` against hold time, with 95 % intervals over replicas."""
    shown = aging.hold_times > 0
    coefficient = quantity == "friction_coefficient_drop"
    if coefficient and aging.load == 0:
        _write(axes, "undefined: no load")
    elif not shown.any():
        _write(axes, "no hold time above 0")
    else:
        mean = aging.mean_friction_coefficient_drop if coefficient else aging.mean_friction_drop
        half = aging.friction_coefficient_drop_half_width if coefficient else aging.friction_drop_half_width
        _with_errors(axes, aging.hold_times[shown], mean[shown], half[shown], colour, label)
    axes.set_ylabel("friction coefficient drop Δμ" if coefficient else "friction drop ΔF (nN)")
    axes.set(xscale="log", xlabel="hold time (s)")
    axes.set_ylim(bottom=0)


def draw_local_slope(axes: Axes, aging: Aging, quantity: Quantity, colour: str = BLUE, label: str = "") -> None:
    """Draw the mean slope per decade of ``quantity`` over half a decade or more about each time, with 95 % intervals
    over replicas."""
    shown = aging.hold_times > 0
    times, first = np.unique(np.log10(aging.hold_times[shown]), return_index=True)
    values = aging.friction_coefficient_drop if quantity == "friction_coefficient_drop" else aging.friction_drop
    values = values[:, shown][:, first]
    ends = [(at, int(np.searchsorted(times, start + SLOPE_SPAN - 1e-9))) for at, start in enumerate(times)]
    low, high = np.array([(at, end) for at, end in ends if end < times.size] or [(0, times.size - 1)]).T
    slopes = (values[:, high] - values[:, low]) / (times[high] - times[low])
    middle = 10 ** (0.5 * (times[low] + times[high]))
    _with_errors(axes, middle, slopes.mean(axis=0), half_width(slopes), colour, label)
    axes.set(xscale="log", xlabel="hold time (s)")
    symbol, unit = SYMBOL[quantity], f" ({UNIT[quantity]})" if UNIT[quantity] else ""
    axes.set_ylabel(f"slope d{symbol}/dlog$_{{10}}$t per decade{unit}")


def _write(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", color=GREY)


def _with_errors(axes: Axes, t: np.ndarray, mean: np.ndarray, error: np.ndarray, colour: str, label: str) -> None:
    bars = np.nan_to_num(error) if np.isfinite(error).any() else None
    axes.errorbar(t, mean, yerr=bars, color=colour, marker="o", ms=3.5, lw=1, capsize=2, label=label or None)


def brought_figures(run: Run) -> dict[str, Brought]:
    """Draw the figures that plugins bring to a run: name -> figure and caption."""
    aging = run.aging
    chemistry = chemistry_of(aging.provenance) if aging is not None else None
    maps = Maps(run.contact if isinstance(run.contact, ContactSolution) else None, run.surface)
    label = f"{run.name} (approximate)" if run.approximate else run.name
    result = PlottedResult(label, aging, chemistry, BLUE, scene=run.scene, load_maps=lambda: maps)
    return plugin_figures([Source(result, components_of(run.scene, aging), run.plugins)])


def figures(run: Run) -> dict[str, Figure]:
    """Draw every figure for which the run has data: name -> figure."""
    made = {
        "surface": surface_figure(run.surface) if run.surface is not None else None,
        "pressure": pressure_figure(run.contact) if isinstance(run.contact, ContactSolution) else None,
        **{name: brought.figure for name, brought in brought_figures(run).items()},
        "friction": friction_figure(run),
    }
    return {name: figure for name, figure in made.items() if figure is not None}


def save(run: Run, folder: Path, *, force: bool = False, suffix: str = "png") -> list[Path]:
    """Write the figures of ``run`` into ``folder``; see :func:`chemage.results.figures.save_figures`."""
    return save_figures(figures(run), folder, force=force, suffix=suffix)
