"""The figures of the paper, drawn from the points of the studies."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.reports.figures import GREY, PALETTE, panels
from chemage_studies.reproduction import published
from chemage_studies.reproduction.checks import LOAD, SLOPE, VOLUME, Studies
from chemage_studies.reproduction.points import Point, curve, grouped, mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _figure(columns: int, rows: int = 1, width: float = 4.6, height: float = 3.9) -> tuple[Figure, list[Axes]]:
    return panels(width * columns, height * rows, columns, rows, dpi=130)


def fig1(studies: Studies) -> Figure:
    """Draw ΔF and Δμ against hold time at several loads."""
    figure, (left, right) = _figure(2)
    for ((load,), group), colour in zip(grouped(studies["loads"], LOAD).items(), PALETTE, strict=True):
        times = group[0].hold_times
        left.plot(times, curve(group, lambda p: p.friction_drop) / 1000, color=colour, label=f"{load / 1000:g} µN")
        right.plot(times, curve(group, lambda p: p.coefficient), color=colour)
    left.set(xscale="log", yscale="log", xlabel="hold time (s)", ylabel="ΔF (µN)", ylim=(1e-2, None))
    right.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ")
    left.legend(frameon=False, fontsize=7)
    return figure


def fig2(studies: Studies) -> Figure:
    """Draw barriers and pressures at several loads, ΔF and Δμ against load, and ΔF against contact area."""
    figure, (barriers, pressures, empty, drop, coefficient, area) = _figure(3, rows=2, width=4.0, height=3.4)
    empty.axis("off")
    groups = {load / 1000: group for (load,), group in grouped(studies["loads"], LOAD).items()}
    for load, colour in zip((20.0, 100.0, 500.0), PALETTE, strict=False):
        group = groups[load]
        edges = group[0].observables["barrier_edges"][0]
        barriers.stairs(_density(group, "barriers_start"), edges, color=colour, label=f"{load:g} µN")
        barriers.stairs(_density(group, "barriers_open"), edges, color=colour, ls="--")
        pressures.stairs(_density(group, "pressures"), group[0].observables["pressure_edges"][0], color=colour)
    barriers.set(xlabel="barrier to forming (eV)", ylabel="density per site (1/eV)", xlim=(0.4, 2.2))
    barriers.legend(frameon=False, fontsize=7, title="— initial, -- unbonded at end", title_fontsize=7)
    pressures.set(xlabel="pressure (GPa)", ylabel="density per site (1/GPa)", xlim=(0, 8))
    loads = np.array(list(groups))
    for time, colour in zip((1.0, 1e3, 1e5), PALETTE, strict=False):
        values = np.array([mean(p.at(time) for p in group).value for group in groups.values()])
        drop.plot(loads, values / 1000, "o-", ms=3, color=colour, label=f"{time:g} s")
        coefficient.plot(loads, values / loads / 1000, "o-", ms=3, color=colour)
        fraction = np.array([mean(p.summary["area_fraction"] for p in group).value for group in groups.values()])
        area.plot(fraction, values / 1000, "o-", ms=3, color=colour)
    drop.set(xlabel="load (µN)", ylabel="ΔF (µN)")
    drop.legend(frameon=False, fontsize=7)
    coefficient.set(xlabel="load (µN)", ylabel="Δμ", ylim=(0, None))
    area.set(xlabel="A/A$_0$", ylabel="ΔF (µN)")
    return figure


def _density(points: list[Point], name: str) -> np.ndarray:
    return curve(points, lambda p: p.observables[name].mean(axis=0))


def fig3(studies: Studies) -> Figure:
    """Draw Δμ against hold time for each h'_rms, and against h'_rms at fixed times, with and without ΔV."""
    figure, axes = _figure(2, rows=2, height=3.5)
    for row, ((volume,), points) in enumerate(grouped(studies["slopes"], VOLUME).items()):
        over_time, over_slope = axes[2 * row], axes[2 * row + 1]
        by_slope = {key[0]: group for key, group in grouped(points, SLOPE).items()}
        title = "ΔV = 6.4 Å$^3$" if volume else "ΔV = 0"
        for (slope, group), colour in zip(by_slope.items(), PALETTE, strict=False):
            over_time.plot(group[0].hold_times, curve(group, lambda p: p.coefficient), color=colour, label=f"{slope:g}")
        over_time.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ", title=title)
        over_time.legend(frameon=False, fontsize=7, title="h'", title_fontsize=7)
        for time, colour in zip((0.1, 1.0, 10.0, 1e3), PALETTE, strict=False):
            values = [mean(p.at(time) / p.summary["load"] for p in group).value for group in by_slope.values()]
            over_slope.plot(list(by_slope), values, "o-", ms=3, color=colour, label=f"{time:g} s")
        over_slope.set(xlabel="h'$_{rms}$", ylabel="Δμ", title=title, yscale="log")
        if row == 0:  # the row below has the same times, and no room for a legend
            over_slope.legend(frameon=False, fontsize=7)
    return figure


def fig4(studies: Studies) -> Figure:
    """Draw ΔF against the strength of the interaction."""
    figure, (axes,) = _figure(1)
    groups = {key[0]: group for key, group in grouped(studies["interaction"], "interaction.strength").items()}
    for time, colour in zip((1.0, 1e3, 1e5), PALETTE, strict=False):
        axes.plot(
            list(groups),
            [mean(p.at(time) for p in g).value / 1000 for g in groups.values()],
            "o-",
            ms=3,
            color=colour,
            label=f"{time:g} s",
        )
    axes.set(xlabel="I$_b$ (eV)", ylabel="ΔF (µN)", ylim=(0, None))
    axes.legend(frameon=False, fontsize=7)
    return figure


def fig5(studies: Studies) -> Figure:
    """Draw Δμ·A0/A against C/A for the rows of Table 1."""
    figure, (axes,) = _figure(1, width=7.0)
    groups = grouped(studies["rows"], "surface.hurst", "surface.zeta", "surface.eta")
    for row, colour in zip(published.TABLE_1, PALETTE, strict=False):
        group = groups[row.hurst, row.zeta, row.eta]
        axes.plot(
            [p.summary["perimeter_to_area"] for p in group],
            [p.at(1e3) / p.summary["load"] / p.summary["area_fraction"] for p in group],
            "o",
            ms=4,
            color=colour,
            label=f"{row.name}: H {row.hurst:g}, ζ {row.zeta:g}, η {row.eta:g}",
        )
    axes.set(xlabel="C/A (1/nm)", ylabel="Δμ A$_0$/A at 1e3 s (axis does not start at 0)")
    axes.legend(frameon=False, fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def fig6(studies: Studies) -> Figure:
    """Draw Δμ against hold time at half hydroxylation, with the detachment-front factor."""
    figure, (axes,) = _figure(1)
    points = studies["front"]
    times = points[0].hold_times
    for point in points:
        axes.plot(times, point.coefficient, color=PALETTE[0], lw=0.8)
    beta = mean(p.summary["beta"] for p in points)
    axes.set(
        xscale="log", xlabel="hold time (s)", ylabel="Δμ", title=f"β = {beta.value:.4f} (paper: {published.FIG_6_BETA})"
    )
    return figure


def table1(studies: Studies) -> Figure:
    """Draw our patches and contour lengths of the rows of Table 1 against those of the paper."""
    figure, (left, right) = _figure(2)
    groups = grouped(studies["rows"], "surface.hurst", "surface.zeta", "surface.eta")
    for row, colour in zip(published.TABLE_1, PALETTE, strict=False):
        group = groups[row.hurst, row.zeta, row.eta]
        for axes, name, paper in ((left, "patches", row.patches), (right, "perimeter_to_area", row.perimeter_to_area)):
            ours = mean(p.summary[name] for p in group)
            axes.errorbar(
                paper,
                ours.value,
                yerr=None if np.isnan(ours.scatter) else ours.scatter,
                fmt="o",
                color=colour,
                capsize=2,
                label=row.name,
            )
    for axes, label, scale, ends in ((left, "patches", "log", (8, 1500)), (right, "C/A (1/nm)", "linear", (0, 1.1))):
        axes.plot(ends, ends, color=GREY, lw=0.8, zorder=0)
        axes.set(xlabel=f"{label}, paper", ylabel=f"{label}, ours", xscale=scale, yscale=scale, xlim=ends, ylim=ends)
    left.legend(frameon=False, fontsize=7)
    return figure


def kappa(studies: Studies) -> Figure:
    """Draw contact area against load, with the predictions of Persson and of Bush, Gibson and Thomas."""
    from chemage.contacts.theory import bgt_area_fraction, persson_area_fraction

    figure, (left, right) = _figure(2)
    groups = grouped(studies["loads"], LOAD)
    x = np.array([_reduced(group[0]) for group in groups.values()])
    ours = np.array([mean(p.summary["area_fraction"] for p in group).value for group in groups.values()])
    corrected = np.array(
        [
            mean(p.summary["corrected_area"] / p.summary["nominal_area"] for p in group).value
            for group in groups.values()
        ]
    )
    fine = np.linspace(0, x.max() * 1.05, 200)
    left.plot(x, ours, "o", ms=4, color=PALETTE[0], label="pixels in contact")
    left.plot(x, corrected, "s", ms=4, mfc="none", color=PALETTE[0], label="corrected for pixels")
    left.plot(fine, persson_area_fraction(fine), color=PALETTE[1], label="Persson")
    left.plot(fine, bgt_area_fraction(fine), color=PALETTE[2], label="Bush, Gibson & Thomas")
    left.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="A/A$_0$")
    left.legend(frameon=False, fontsize=7)
    right.plot(x, ours / x, "o", ms=4, color=PALETTE[0])
    right.plot(x, corrected / x, "s", ms=4, mfc="none", color=PALETTE[0])
    right.axhline(published.KAPPA, color=GREY, lw=0.8)
    right.axhline(np.sqrt(8 / np.pi), color=PALETTE[1], lw=0.8)
    right.axhline(np.sqrt(2 * np.pi), color=PALETTE[2], lw=0.8)
    right.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="κ", ylim=(1.4, 2.7))
    return figure


def _reduced(point: Point) -> float:
    summary = point.summary
    return summary["nominal_pressure"] / (summary["modulus"] * summary["rms_slope"])


DRAW: dict[str, Callable[[Studies], Any]] = {
    "fig1": fig1,
    "fig2": fig2,
    "fig3": fig3,
    "fig4": fig4,
    "fig5": fig5,
    "fig6": fig6,
    "table1": table1,
    "kappa": kappa,
}
