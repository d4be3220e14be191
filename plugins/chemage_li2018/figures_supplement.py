"""The supplement, Table 1, κ, and figures of our own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import figures as plots
from chemage_li2018 import figures, published
from chemage_li2018.comparisons import Studies, front, rows
from chemage_li2018.figures import bars, density, figure, legend
from chemage_li2018.sweeps import LOAD, SEED, Point, by, mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TIMES = (1.0, 1e3, 1e5)


def maps(studies: Studies) -> Figure:
    """Draw the contact of each row of Table 1 on its first surface."""
    drawing, axes = figure(4, rows=2, width=3.0, height=3.2)
    for axis, (row, group) in zip(axes, rows(studies["table"]), strict=False):
        contact = group[0].contact()
        side = contact.shape[0] * contact.pixel_size
        shown = plots.pooled(contact.contact, np.max, 500)
        axis.imshow(shown.T, origin="lower", extent=(0, side, 0, side), cmap="binary", interpolation="nearest")
        axis.set_title(f"{row.name}: H {row.hurst:g}, ζ {row.zeta:g}, η {row.eta:g}", fontsize=8)
        axis.set(xticks=(0, 500, 1000), yticks=(0, 500, 1000))
    last = axes[-1]
    last.axis("off")
    last.text(
        0.0,
        0.9,
        f"x and y in nm\nh' = 0.05, 20 µN\nsurface seed {studies['table'][0].changes[SEED]}\nblack: contact "
        "(a block of pixels\nis black if any of them touches)",
        va="top",
        fontsize=8,
    )
    return drawing


def areas(studies: Studies) -> Figure:
    """Draw the contact area against load."""
    drawing, (axes,) = figure(1)
    groups = {load / 1000: group for load, group in by(studies["loads"], LOAD).items()}
    fractions = [mean(p.summary["area_fraction"] for p in group) for group in groups.values()]
    bars(axes, list(groups), fractions, fmt="o-", color=plots.PALETTE[0])
    for load, value in published.AREA_FRACTION.items():
        axes.plot(load, float(value), "s", ms=8, mfc="none", color=plots.PALETTE[1])
    axes.plot([], [], "s", ms=8, mfc="none", color=plots.PALETTE[1], label="paper")
    slope = fractions[2].value / 20.0
    axes.plot([0, 500], [0, 500 * slope], color=plots.GREY, lw=0.8, ls="--", label="proportional to load, from 20 µN")
    axes.set(xlabel="load (µN)", ylabel="A/A$_0$", xlim=(0, None), ylim=(0, None))
    legend(axes)
    return drawing


def barriers(studies: Studies) -> Figure:
    """Draw the distribution of E_form(t = 0) at every load, and its mean against load."""
    drawing, (left, right) = figure(2)
    groups = {load / 1000: group for load, group in by(studies["loads"], LOAD).items()}
    means = []
    for (load, group), colour in zip(groups.items(), plots.PALETTE, strict=False):
        density(left, group, "barriers_start", "barrier_edges", color=colour, label=f"{load:g} µN", lw=0.9)
        edges = group[0].observables["barrier_edges"]
        centre = 0.5 * (edges[1:] + edges[:-1])
        means.append(mean(float(np.average(centre, weights=p.observables["barriers_start"])) for p in group))
    left.set(xlabel="E$_{form}$(t = 0) (eV)", ylabel="density per site (1/eV)", xlim=(0.5, 1.45), ylim=(0, None))
    legend(left)
    bars(right, list(groups), means, fmt="o-", color=plots.PALETTE[0])
    right.set(xlabel="load (µN)", ylabel="mean E$_{form}$(t = 0) (eV)", xscale="log")
    return drawing


def interaction(studies: Studies) -> Figure:
    """Draw ΔF against the strength of the interaction."""
    drawing, (axes,) = figure(1)
    groups = by(studies["interaction"], "interaction.strength")
    for time, colour in zip(_TIMES, plots.PALETTE, strict=False):
        drop = [mean(p.at(time) / 1000 for p in g) for g in groups.values()]
        bars(axes, list(groups), drop, fmt="o-", color=colour, label=f"{time:g} s")
    axes.set(xlabel="I$_b$ (eV)", ylabel="ΔF (µN)", ylim=(0, None))
    legend(axes)
    return drawing


def table1(studies: Studies) -> Figure:
    """Draw our patches and contour lengths of the rows of Table 1 against those of the paper."""
    drawing, (left, right) = figure(2)
    for (row, group), colour in zip(rows(studies["table"]), plots.PALETTE, strict=False):
        style: dict[str, Any] = {"fmt": row.marker, "color": colour, "ms": 6, "mfc": "none"}
        bars(left, [float(row.patches)], [mean(p.summary["patches"] for p in group)], label=row.name, **style)
        bars(right, [float(row.perimeter_to_area)], [mean(p.summary["perimeter_to_area"] for p in group)], **style)
    for axes, label, scale, ends in ((left, "patches", "log", (8, 1500)), (right, "C/A (1/nm)", "linear", (0, 1.1))):
        axes.plot(ends, ends, color=plots.GREY, lw=0.8, zorder=0)
        axes.set(xlabel=f"{label}, paper", ylabel=f"{label}, ours", xscale=scale, yscale=scale, xlim=ends, ylim=ends)
    legend(left)
    return drawing


def kappa(studies: Studies) -> Figure:
    """Draw contact area and κ against load with two theories, and κ of the rows of Table 1 and of Fig. 6."""
    from chemage.plugin import theory

    drawing, (left, middle, right) = figure(3, width=4.3)
    groups = list(by(studies["loads"], LOAD).values())
    x = np.array([_reduced(group[0]) for group in groups])
    for name, label, style in (
        ("area", "pixels in contact", {"fmt": "o", "ms": 4}),
        ("corrected_area", "corrected for pixels", {"fmt": "s", "ms": 4, "mfc": "none"}),
    ):
        fraction = [mean(p.summary[name] / p.summary["nominal_area"] for p in group) for group in groups]
        bars(left, x, fraction, color=plots.PALETTE[0], label=label, **style)
        scaled = [value.times(1 / place) for value, place in zip(fraction, x, strict=True)]
        bars(middle, x, scaled, color=plots.PALETTE[0], **style)
    fine = np.linspace(0, x.max() * 1.05, 200)
    left.plot(fine, theory.persson_area_fraction(fine), color=plots.PALETTE[1], label="Persson")
    left.plot(fine, theory.bgt_area_fraction(fine), color=plots.PALETTE[2], label="Bush, Gibson & Thomas")
    left.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="A/A$_0$")
    legend(left)
    middle.axhline(np.sqrt(8 / np.pi), color=plots.PALETTE[1], lw=0.8)
    middle.axhline(np.sqrt(2 * np.pi), color=plots.PALETTE[2], lw=0.8)
    middle.plot(x[2], float(published.KAPPA), "D", color=plots.GREY, ms=5, label="paper, 20 µN")
    middle.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="κ", ylim=(1.4, 3.0))
    legend(middle)
    span = published.Published.of(published.KAPPA_ROWS)
    right.axhspan(span.low, span.high, color=plots.GREY, alpha=0.3, lw=0, label=f"paper, {span.text}")
    named = [(row.name, group) for row, group in rows(studies["table"])]
    half = front(studies, 0.5)
    named.append(("Fig. 6", half))
    for place, (_, group) in enumerate(named):
        bars(right, [place], [mean(p.summary["kappa"] for p in group)], fmt="o", ms=4, color=plots.PALETTE[0])
    right.set_xticks(range(len(named)), [name for name, _ in named], rotation=40, ha="right", fontsize=7)
    right.set(ylabel="κ at 20 µN", ylim=(1.4, 3.0))
    legend(right)
    return drawing


def _reduced(point: Point) -> float:
    summary = point.summary
    return summary["nominal_pressure"] / (summary["modulus"] * summary["rms_slope"])


def temperature(studies: Studies) -> Figure:
    """Draw β and ΔF against temperature, of a piece of the rough contact and of a tip."""
    drawing, axes = figure(2, width=4.4)
    names = (("warm rough", "rough"), ("warm tip", "tip"))
    for (study, name), colour in zip(names, plots.PALETTE, strict=False):
        groups = by(studies[study], "hold.temperature")
        kelvin = list(groups)
        bars(axes[0], kelvin, [mean(p.beta() for p in g) for g in groups.values()], fmt="o-", color=colour, label=name)
        for time, dashes in ((1e2, "--"), (1e4, "-")):
            largest = max(mean(p.at(time) for p in g).value for g in groups.values())
            drop = [mean(p.at(time) / largest for p in g) for g in groups.values()]
            bars(axes[1], kelvin, drop, fmt=f"o{dashes}", color=colour, label=f"{name}, {time:g} s")
    axes[0].set(xlabel="temperature (K)", ylabel="β over 10 to 1e4 s", ylim=(0, None))
    axes[1].set(xlabel="temperature (K)", ylabel="ΔF / its largest mean", ylim=(0, None))
    for axis in axes:
        axis.axvline(300, color=plots.GREY, lw=0.8, ls=":")
        legend(axis)
    return drawing


def tips(studies: Studies) -> Figure:
    """Draw ΔF and β of tips against load, with the published β of atomic force microscopy."""
    drawing, (left, right) = figure(2)
    groups = by(studies["tips"], "surface.radius")
    for (radius, group), colour in zip(groups.items(), plots.PALETTE, strict=False):
        load = [p.changes[LOAD] for p in group]
        error = [p.friction_drop_half_width[p.index(1e3)] for p in group]
        drop = [p.at(1e3) for p in group]
        left.errorbar(load, drop, yerr=error, fmt="o-", ms=3, lw=1, color=colour, capsize=2, label=f"R = {radius:g} nm")
        beta = [p.summary["beta"] for p in group]
        error = [p.summary["beta_half_width"] for p in group]
        right.errorbar(load, beta, yerr=error, fmt="o-", ms=3, lw=1, color=colour, capsize=2)
    paper = {load: float(text) for load, text in published.TIP_BETA.items()}
    right.plot(list(paper), list(paper.values()), "s", ms=7, mfc="none", color=plots.GREY, label="paper (AFM)")
    left.set(xlabel="load (nN)", ylabel="ΔF at 1e3 s (nN)", xlim=(0, None), ylim=(0, None))
    left.set_title("bars: 95 % intervals over replicas", fontsize=9)
    right.set(xlabel="load (nN)", ylabel="β", xscale="log", yscale="log", xlim=(15, 600))
    for axis, ticks in ((right.xaxis, (20, 50, 100, 200, 400)), (right.yaxis, (0.5, 1, 2, 5, 10, 20))):
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ticks([], minor=True)
    legend(left)
    legend(right)
    return drawing


DRAW: dict[str, Callable[[Studies], Any]] = {
    "fig1": figures.fig1,
    "fig2": figures.fig2,
    "fig3": figures.fig3,
    "fig4": figures.fig4,
    "fig5": figures.fig5,
    "fig6": figures.fig6,
    "table1": table1,
    "kappa": kappa,
    "maps": maps,
    "areas": areas,
    "barriers": barriers,
    "interaction": interaction,
    "temperature": temperature,
    "tips": tips,
}
