"""The figures of the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import figures
from chemage_li2018 import published
from chemage_li2018.claims import morphology
from chemage_li2018.comparisons import Studies, by_volume, circle, front, rows
from chemage_li2018.estimates import variants
from chemage_li2018.sweeps import LOAD, SEED, SLOPE, Mean, Point, by, curve, mean, spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: size of the text of legends
SMALL = 7


def figure(columns: int, rows: int = 1, width: float = 4.6, height: float = 3.9) -> tuple[Figure, list[Axes]]:
    """Make a figure of panels of ``width`` by ``height`` inches, row by row."""
    return figures.panels(width * columns, height * rows, columns, rows, dpi=110)


def say_scatter(axes: Axes) -> None:
    """Say on the figure, once, what its bars and bands are."""
    axes.figure.supxlabel("bars and bands: standard deviation between surfaces", fontsize=SMALL)


def band(
    axes: Axes, points: list[Point], quantity: Callable[[Point], np.ndarray], label: str = "", **style: Any
) -> None:
    """Draw the mean of a curve against hold time, and the standard deviation between surfaces as a band."""
    times, middle, half = points[0].hold_times, curve(points, quantity), spread(points, quantity)
    axes.plot(times, middle, label=label or None, **style)
    if half.any():
        axes.fill_between(times, middle - half, middle + half, color=style.get("color"), alpha=0.2, lw=0)
        say_scatter(axes)


def bars(axes: Axes, x: Iterable[float], means: Iterable[Mean], **style: Any) -> None:
    """Draw means with the standard deviation between surfaces."""
    values = list(means)
    say_scatter(axes)
    axes.errorbar(
        list(x),
        [value.value for value in values],
        yerr=[0.0 if np.isnan(value.scatter) else value.scatter for value in values],
        capsize=2,
        elinewidth=0.8,
        **{"ms": 3, "lw": 1, **style},
    )


def density(axes: Axes, points: list[Point], name: str, edges: str, **style: Any) -> None:
    """Draw the mean of a measured density over surfaces, with its standard deviation as a band."""
    bounds = points[0].observables[edges]
    middle, half = (part(points, lambda p: p.observables[name]) for part in (curve, spread))
    axes.stairs(middle, bounds, **style)
    if half.any():
        centre = 0.5 * (bounds[1:] + bounds[:-1])
        low, high = np.maximum(middle - half, 0), middle + half
        axes.fill_between(centre, low, high, step="mid", color=style.get("color"), alpha=0.2, lw=0)
        say_scatter(axes)


def legend(axes: Axes, **style: Any) -> None:
    """Draw a legend without a frame."""
    axes.legend(**{"frameon": False, "fontsize": SMALL, "title_fontsize": SMALL, **style})


def letter(axes: Iterable[Axes], letters: str) -> None:
    """Write the letters of panels above their left upper corners."""
    for panel, name in zip(axes, letters, strict=True):
        panel.set_title(f"({name})", loc="left", fontsize=10)


_SLOPE_COLOURS = dict(zip(published.SLOPES, figures.PALETTE, strict=False))
_TIMES = (1.0, 1e3, 1e5)


def fig1(studies: Studies) -> Figure:
    """Draw the heights of the first surface, the contact on it, and a part of the contact."""
    point = studies["reference"][0]
    surface, contact = point.surface(), point.contact()
    side = contact.shape[0] * contact.pixel_size
    drawing, axes = figure(3, width=4.8)
    whole = (0.0, side, 0.0, side)
    figures.draw_map(axes[0], figures.pooled(surface.heights, np.mean, 600), whole, "height (nm)", cmap="cividis")
    shown = figures.pooled(contact.contact.astype(np.float64), np.max, 600)
    figures.draw_map(axes[1], np.ma.masked_equal(shown, 0.0), whole, "contact", cmap="binary", vmin=0, vmax=1)
    if (bar := axes[1].images[0].colorbar) is not None:
        bar.remove()
    start, size, pressure = _densest(contact.pressure)
    low = [place * contact.pixel_size for place in start]
    part = (low[0], low[0] + size * contact.pixel_size, low[1], low[1] + size * contact.pixel_size)
    figures.draw_map(axes[2], np.ma.masked_equal(pressure, 0.0), part, "pressure (GPa)", cmap="viridis")
    axes[1].plot(*_outline(part), color=figures.PALETTE[1], lw=1)
    axes[0].set_title(f"surface, seed {point.changes[SEED]}", fontsize=9)
    axes[1].set_title(f"contact at 20 µN, A/A$_0$ = {contact.area_fraction:.4f}", fontsize=9)
    axes[2].set_title("pressure in the square", fontsize=9)
    return drawing


def _densest(pressure: np.ndarray) -> tuple[tuple[int, int], int, np.ndarray]:
    """The square of an eighth of the width with the most contact: its corner, its size and its pressures."""
    from scipy import ndimage

    size = max(8, pressure.shape[0] // 8)
    share = ndimage.uniform_filter((pressure > 0).astype(np.float32), size, mode="constant")
    middle = np.unravel_index(int(np.argmax(share)), share.shape)
    i, j = (min(max(int(place) - size // 2, 0), pressure.shape[0] - size) for place in middle)
    return (i, j), size, pressure[i : i + size, j : j + size]


def _outline(part: tuple[float, float, float, float]) -> tuple[list[float], list[float]]:
    x0, x1, y0, y1 = part
    return [x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0]


def fig2(studies: Studies) -> Figure:
    """Draw barriers and pressures at three loads, and ΔF and Δμ against time, load and contact area."""
    drawing, axes = figure(4, rows=2, width=3.9, height=3.4)
    groups = {load / 1000: group for load, group in by(studies["loads"], LOAD).items()}
    chosen = {load: groups[load] for load in (20.0, 100.0, 500.0)}
    _intrinsic(axes[0], next(iter(chosen.values()))[0])
    for (load, group), colour in zip(chosen.items(), figures.PALETTE, strict=False):
        density(axes[0], group, "barriers_start", "barrier_edges", color=colour, label=f"E$_{{form}}$(0), {load:g} µN")
        density(axes[3], group, "pressures", "pressure_edges", color=colour, label=f"{load:g} µN")
    axes[0].set(xlabel="barrier (eV)", ylabel="density per site (1/eV)", xlim=(0.5, 1.45), ylim=(0, 6))
    axes[3].set(xlabel="pressure (GPa)", ylabel="density per site (1/GPa)", xlim=(0, 8), ylim=(0, None))
    for (load, group), colour in zip(groups.items(), figures.PALETTE, strict=False):
        band(axes[1], group, lambda p: np.maximum(p.friction_drop, 1e-9) / 1000, f"{load:g} µN", color=colour, lw=1)
        band(axes[2], group, lambda p: p.coefficient, color=colour, lw=1)
    axes[1].set(xscale="log", yscale="log", xlabel="hold time (s)", ylabel="ΔF (µN)", ylim=(1e-2, None))
    axes[2].set(xscale="log", xlabel="hold time (s)", ylabel="Δμ", ylim=(0, None))
    loads = list(groups)
    areas = [mean(p.summary["area_fraction"] for p in group).value for group in groups.values()]
    for time, colour in zip(_TIMES, figures.PALETTE, strict=False):
        drop = [mean(p.at(time) / 1000 for p in group) for group in groups.values()]
        coefficient = [mean(p.at(time) / p.changes[LOAD] for p in group) for group in groups.values()]
        for place, x, y in ((4, loads, drop), (5, loads, coefficient), (6, areas, drop), (7, areas, coefficient)):
            bars(axes[place], x, y, fmt="o-", color=colour, label=f"{time:g} s")
    for place, x, y in ((4, "load (µN)", "ΔF (µN)"), (5, "load (µN)", "Δμ"), (6, "A/A$_0$", "ΔF (µN)")):
        axes[place].set(xlabel=x, ylabel=y, ylim=(0, None))
    axes[7].set(xlabel="A/A$_0$", ylabel="Δμ", ylim=(0, None))
    for place in (0, 1, 3, 4):
        legend(axes[place], fontsize=6)
    for axis, name in zip(axes, ("a", "b", "b", "c", "d", "d", "d", "d"), strict=True):
        axis.set_title(f"({name})", loc="left", fontsize=10)
    return drawing


def _intrinsic(axes: Axes, point: Point) -> None:
    """Draw the densities of the intrinsic barriers to forming and to breaking."""
    assert point.source is not None
    chemistry = point.source.scene().chemistry
    assert chemistry is not None
    energy = np.linspace(0.5, 1.5, 1001)
    forming = chemistry.forming.density(energy)
    if forming is not None:
        axes.plot(energy, forming, color=figures.GREY, lw=1.2, ls="--", label="intrinsic, forming")
    breaking = chemistry.breaking.density(energy) if chemistry.breaking is not None else None
    if breaking is not None:
        axes.fill_between(
            energy, breaking / 5, color=figures.PALETTE[3], alpha=0.4, lw=0, label="breaking (density / 5)"
        )


def fig3(studies: Studies) -> Figure:
    """Draw Δμ against hold time and against A/A0 for the rows of Table 1 at three slopes, with and without ΔV."""
    from matplotlib.ticker import MultipleLocator

    drawing, axes = figure(3, rows=2, width=4.6, height=3.7)
    for line, (volume, points) in enumerate(by_volume(studies["rows"]).items()):
        over_time, *over_area = axes[3 * line : 3 * line + 3]
        title = "ΔV = 6.4 Å$^3$" if volume else "ΔV = 0"
        for row, of_row in rows(points):
            for slope, group in by(of_row, SLOPE).items():
                colour = _SLOPE_COLOURS[slope]
                band(over_time, group, lambda p: p.coefficient, color=colour, lw=0.7)
                over_time.plot(
                    group[0].hold_times[::4], _mean(group)[::4], row.marker, ms=3.5, mfc="none", mew=0.7, color=colour
                )
                for axis, time in zip(over_area, (1.0, 1e3), strict=True):
                    area = mean(p.summary["area_fraction"] for p in group)
                    drop = mean(p.at(time) / p.changes[LOAD] for p in group)
                    style = {"color": colour, "marker": row.marker, "ms": 5, "mfc": "none", "mew": 0.9, "lw": 0.7}
                    width = 0.0 if np.isnan(area.scatter) else area.scatter
                    height = 0.0 if np.isnan(drop.scatter) else drop.scatter
                    axis.errorbar(area.value, drop.value, xerr=width, yerr=height, ls="none", **style)
        over_time.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ", title=title, ylim=(0, None))
        for axis, time in zip(over_area, (1.0, 1e3), strict=True):
            axis.set(xlabel="A/A$_0$", ylabel="Δμ", title=f"{title}, {time:g} s", xlim=(0, None), ylim=(0, None))
            axis.xaxis.set_major_locator(MultipleLocator(0.005))
    _reversal(axes[0], circle(by_volume(studies["rows"])[6.4]))
    for slope, colour in _SLOPE_COLOURS.items():
        axes[0].plot([], [], color=colour, label=f"h' = {slope:g}")
    legend(axes[0])
    for row in published.TABLE_1:
        axes[2].plot([], [], row.marker, color=figures.GREY, ms=5, mfc="none", label=row.name)
    legend(axes[2], loc="lower right")
    return drawing


def _reversal(axes: Axes, points: list[Point]) -> None:
    """Draw the hold times at which the order of the slopes reverses, larger."""
    inset = axes.inset_axes((0.09, 0.36, 0.38, 0.34))
    for slope, group in by(points, SLOPE).items():
        band(inset, group, lambda p: p.coefficient, color=_SLOPE_COLOURS[slope], lw=1)
    inside = (points[0].hold_times >= 0.3) & (points[0].hold_times <= 30)
    top = max(float(p.coefficient[inside].max()) for p in points)
    inset.set(xscale="log", xlim=(0.3, 30), ylim=(0, top))
    inset.set_title("circle", fontsize=SMALL)
    inset.tick_params(labelsize=6)


def _mean(points: list[Point]) -> np.ndarray:
    return np.mean([p.coefficient for p in points], axis=0)


def fig4(studies: Studies) -> Figure:
    """Draw the distributions of local pressure and of E_form(t = 0) at three slopes."""
    drawing, (pressures, barriers) = figure(2)
    for slope, group in by(by_volume(studies["slopes"])[6.4], SLOPE).items():
        style = {"color": _SLOPE_COLOURS[slope], "label": f"h' = {slope:g}"}
        density(pressures, group, "pressures", "pressure_edges", **style)
        density(barriers, group, "barriers_start", "barrier_edges", **style)
    pressures.set(xlabel="pressure (GPa)", ylabel="density per site (1/GPa)", xlim=(0, 10), ylim=(0, None))
    barriers.set(xlabel="E$_{form}$(t = 0) (eV)", ylabel="density per site (1/eV)", xlim=(0.3, 1.5), ylim=(0, None))
    letter((pressures, barriers), "ab")
    legend(pressures)
    return drawing


def fig5(studies: Studies) -> Figure:
    """Draw Δμ·A0/A at 1e3 s against C/A for the rows of Table 1 at three slopes, without ΔV."""
    drawing, axes = figure(3, width=4.0, height=3.6)
    groups = by(by_volume(studies["rows"])[0.0], SLOPE)
    for axis, (slope, group) in zip(axes, groups.items(), strict=True):
        for (row, of_row), colour in zip(rows(group), figures.PALETTE, strict=False):
            x, y = morphology(of_row)
            axis.plot(x, y, row.marker, ms=4, mfc="none", mew=0.8, color=colour, label=row.name)
        x, y = morphology(group)
        line = np.polynomial.Polynomial.fit(x, y, 1)
        ends = np.array([x.min(), x.max()])
        axis.plot(ends, line(ends), color=figures.GREY, lw=0.8, zorder=0)
        axis.set_title(f"h' = {slope:g}, correlation {np.corrcoef(x, y)[0, 1]:.3f}", fontsize=9)
        axis.set(xlabel="C/A (1/nm)", ylabel="Δμ A$_0$/A at 1e3 s (axis not from 0)")
    legend(axes[0])
    return drawing


def fig6(studies: Studies) -> Figure:
    """Draw Δμ against hold time at half hydroxylation, and β by what it depends on, with κ of that contact."""
    drawing, (left, right) = figure(2, width=5.2, height=4.2)
    half = front(studies, 0.5)
    times = half[0].hold_times
    middle = _mean(half)
    scatter = (
        np.std([p.coefficient for p in half], axis=0, ddof=1) if len(half) > 1 else half[0].friction_drop_half_width
    )
    error = scatter if len(half) > 1 else scatter / half[0].summary["load"]
    left.errorbar(times, middle, yerr=error, fmt="o-", ms=3, lw=1, capsize=2, color=figures.PALETTE[0])
    left.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ")
    left.set_title(
        "bars: " + ("standard deviation between surfaces" if len(half) > 1 else "95 % over replicas"), fontsize=9
    )
    readings = variants(studies)
    for place, (reading, colour) in enumerate(zip(readings, figures.PALETTE, strict=False)):
        _level(right, -place, reading.beta, colour)
    right.axvline(float(published.FIG_6_BETA), color=figures.GREY, lw=1, ls="--")
    right.set_yticks(
        [-place for place in range(len(readings))], [_broken(reading.name) for reading in readings], fontsize=7
    )
    kappa = mean(p.summary["kappa"] for p in half)
    right.set(xlabel="β", xlim=(0, None))
    right.set_title(f"dashed: paper, {published.FIG_6_BETA}; κ = {kappa} at h' = 0.4", fontsize=9)
    return drawing


def _level(axes: Axes, place: float, value: Mean, colour: str) -> None:
    width = None if np.isnan(value.scatter) else value.scatter
    if width is not None:
        say_scatter(axes)
    axes.errorbar(value.value, place, xerr=width, fmt="o", color=colour, capsize=3)


def _broken(text: str) -> str:
    """A label on two lines, cut at the middle space."""
    words = text.split(" ")
    cut = min(range(1, len(words)), key=lambda i: abs(len(" ".join(words[:i])) - len(text) / 2))
    return " ".join(words[:cut]) + "\n" + " ".join(words[cut:])
