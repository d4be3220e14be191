"""The figures of the calibration of the density of barriers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import figures
from chemage_studies.density import fit
from chemage_studies.density.rates import SLOPES, TIMES
from chemage_studies.density.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def densities_figure(study: Study) -> Figure:
    """Draw the best density, the set, and the triangle; and the share of barriers below an energy."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    energies = np.linspace(0.78, 1.42, 1281)
    every = [(one, figures.GREY, 0.7, 0.7, "set") for one in study.members]
    every += [
        (study.triangle, figures.BLUE, 1.3, 1.0, "triangle"),
        (study.best, figures.ORANGE, 2.0, 1.0, "best (member 0)"),
    ]
    for number, (one, colour, width, alpha, label) in enumerate(every):
        density = one.barriers.density(energies)
        share = np.concatenate([[0], np.cumsum(0.5 * np.diff(energies) * (density[1:] + density[:-1]))])
        style = {"color": colour, "lw": width, "alpha": alpha, "ls": "--" if label == "triangle" else "-"}
        left.plot(
            energies, density, label=label if number in (0, *range(len(every) - 2, len(every))) else None, **style
        )
        right.plot(energies, share, **style)
    for axes in (left, right):
        axes.axvspan(0.83, 1.01, color=figures.GREY, alpha=0.12, lw=0)
        axes.set(xlabel="intrinsic barrier (eV)", xlim=(0.78, 1.42))
    left.set(ylabel="density (1/eV)", ylim=(0, None))
    right.set(ylabel="share of barriers below", ylim=(0, 1.02))
    left.legend(frameon=False, fontsize=8, loc="upper right")
    return figure


def residuals_figure(study: Study) -> Figure:
    """Draw the deviations of the six rates, and the three ratios, from the published ones."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    where = np.arange(6)
    published = fit.PUBLISHED
    rounding = fit.ROUNDING / published
    left.axhspan(-100 * fit.WITHIN_BETA, 100 * fit.WITHIN_BETA, color=figures.GREY, alpha=0.15, lw=0)
    left.errorbar(where, 0 * where, yerr=100 * rounding, color=figures.BLACK, ls="none", capsize=4, lw=1)
    place = np.arange(3)
    least, most = fit.rounded_ratios()
    middle = fit.PUBLISHED_RATIOS
    right.bar(place, 2 * fit.WITHIN_RATIO, 0.7, middle - fit.WITHIN_RATIO, color=figures.GREY, alpha=0.15)
    right.errorbar(place, middle, yerr=[middle - least, most - middle], color=figures.BLACK, fmt="_", capsize=4, lw=1)
    left.plot([], [], color=figures.BLACK, label="published, with rounding")
    for one in study.members:
        left.plot(where, 100 * (one.beta / published - 1), color=figures.GREY, marker=".", ms=3, ls="none")
        right.plot(place + 0.12, fit.ratios(one.beta), color=figures.GREY, marker=".", ms=3, ls="none")
    left.plot([], [], color=figures.GREY, marker=".", ms=3, ls="none", label="set")
    for one, colour, mark, label in (
        (study.triangle, figures.BLUE, "s", "triangle"),
        (study.best, figures.ORANGE, "o", "best"),
    ):
        left.plot(where, 100 * (one.beta / published - 1), color=colour, marker=mark, ms=5, ls="none", label=label)
        right.plot(
            place + (0.12 if label == "best" else -0.12), fit.ratios(one.beta), color=colour, marker=mark, ls="none"
        )
    left.set_xticks(where, [f"h' = {slope:g}\n{volume}" for volume in ("6.4 Å³", "ΔV = 0") for slope in SLOPES])
    left.tick_params(axis="x", labelsize=7)
    left.set(ylabel="β, calibrated − published (%)", ylim=(None, 19))
    right.set_xticks(place, [f"h' = {slope:g}" for slope in SLOPES])
    right.set(ylabel="β(6.4 Å³)/β(0)")
    left.legend(frameon=False, fontsize=8, ncols=2, loc="upper center")
    return figure


def claims_figure(study: Study) -> Figure:
    """Draw Δμ of the best density and the set against hold time, with the activation volume and without."""
    figure, axes = figures.panels(9.6, 3.8, 2, dpi=110)
    for volume, (one, title) in enumerate(zip(axes, ("6.4 Å³", "ΔV = 0"), strict=True)):
        for row, (slope, colour) in enumerate(zip(SLOPES, (figures.BLUE, figures.ORANGE, figures.BLACK), strict=True)):
            every = np.array([member.curves[volume, row] for member in study.members])
            one.fill_between(TIMES, every.min(axis=0), every.max(axis=0), color=colour, alpha=0.2, lw=0)
            one.plot(TIMES, study.best.curves[volume, row], color=colour, label=f"h' = {slope:g}")
        one.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ", title=title, ylim=(0, None))
    axes[0].legend(frameon=False, fontsize=8)
    return figure
