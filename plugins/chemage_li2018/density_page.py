"""What `chemage study density` writes: the page, its figures, and the table of `md-silica`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import figures, progress
from chemage_li2018 import density_fit as fit
from chemage_li2018.density import QUICK, Density, Size, Study, compute
from chemage_li2018.density_fit import Family
from chemage_li2018.density_rates import SLOPES, TIMES, Rates
from chemage_li2018.pages import filled, free_folder, table, write_pages

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VOLUMES = ("6.4 Å³", "0")


def _word(within: bool) -> str:
    return "yes" if within else "**no**"


def _band(values: list[float], digits: int) -> str:
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def _rates_table(study: Study) -> str:
    rows = []
    for at, published in enumerate(fit.PUBLISHED):
        best, triangle = study.best.beta[at], study.triangle.beta[at]
        rows.append(
            [
                f"{SLOPES[at % 3]:g}",
                VOLUMES[at // 3],
                f"{published:.2f}",
                f"{best:.4f}",
                f"{100 * (best / published - 1):+.1f} %",
                _word(abs(best / published - 1) <= fit.WITHIN_BETA),
                _band([float(density.beta[at]) for density in study.members], 3),
                f"{triangle:.4f} ({100 * (triangle / published - 1):+.1f} %)",
            ]
        )
    columns = ["h'", "ΔV", "published β", "best", "difference", "within 6 %", "set", "triangle"]
    return table(columns, rows)


def _ratios_table(study: Study) -> str:
    published, (least, most) = fit.PUBLISHED_RATIOS, fit.rounded_ratios()
    best, triangle = fit.ratios(study.best.beta), fit.ratios(study.triangle.beta)
    rows = [
        [
            f"{slope:g}",
            f"{published[at]:.2f} ({least[at]:.3f} to {most[at]:.3f})",
            f"{best[at]:.3f}",
            f"{best[at] - published[at]:+.3f}",
            _word(abs(best[at] - published[at]) <= fit.WITHIN_RATIO),
            _band([float(fit.ratios(density.beta)[at]) for density in study.members], 3),
            f"{triangle[at]:.3f}",
            f"{100 * study.errors.surface_of_ratios[at]:.1f} %",
        ]
        for at, slope in enumerate(SLOPES)
    ]
    columns = ["h'", "published (rounding)", "best", "difference", "within 0.04", "set", "triangle", "between surfaces"]
    return table(columns, rows)


def _families_table(study: Study) -> str:
    rows = []
    for family, parameters, beta, chi, excess in study.families:
        named = ", ".join(f"{name} {value:.3g}" for name, value in zip(family.parameters, parameters, strict=True))
        rows.append(
            [
                family.name,
                named,
                f"{chi:.1f}",
                " ".join(f"{100 * value:+.0f}" for value in beta / fit.PUBLISHED - 1),
                " ".join(f"{value:.2f}" for value in fit.ratios(beta)),
                f"{excess:.2f}",
            ]
        )
    columns = ["family", "parameters of least χ²", "χ²", "differences of the six β (%)", "ratios", "largest/bound"]
    return table(columns, rows)


def _members_table(study: Study) -> str:
    rows = []
    for number, density in enumerate([study.best, *study.members]):
        rows.append(
            [
                str(number),
                *(f"{value:.4g}" for value in density.parameters),
                f"{density.chi_squared:.1f}",
                " ".join(f"{value:.3f}" for value in density.beta),
                " ".join(f"{value:.3f}" for value in fit.ratios(density.beta)),
                f"{density.crossing:.1f}",
                ", ".join(f"≤ {TIMES[0]:.1f}" if onset <= TIMES[0] else f"{onset:.1f}" for onset in density.onsets),
                "yes" if all(density.claims().values()) else "no",
            ]
        )
    columns = ["member", *study.family.parameters, "χ²", "β: 6.4 Å³, then ΔV = 0", "ratios"]
    return table([*columns, "crossing (s)", "start of the log regime (s): 6.4 Å³, 0", "all claims"], rows)


def _claims_table(study: Study) -> str:
    every: list[Density] = [study.best, *study.members]
    rows = [
        [
            claim,
            _word(study.triangle.claims()[claim]),
            _word(study.best.claims()[claim]),
            f"{sum(density.claims()[claim] for density in every)} of {len(every)}",
        ]
        for claim in study.best.claims()
    ]
    return table(["published claim", "triangle", "best", "members, the best included"], rows)


def write_study(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and the table of densities into ``out``, and return their paths.

    Computed densities and contacts are kept in ``out/rates``; rerun the same command to resume.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    draw = {"densities": densities_figure, "residuals": residuals_figure, "curves": claims_figure}
    names = ["barrier_density.md", "md_silica_barriers.csv", *(f"figures/density-{name}.png" for name in draw)]
    free_folder(out, names, force=force)
    (out / "rates").mkdir(exist_ok=True)
    size = QUICK if quick else Size()
    with progress.progress_bars() as report:
        study = compute(Rates(out / "rates", report, size.pixels), size)
    members = [density.parameters for density in (study.best, *study.members)]
    texts = {names[0]: lambda: page(study, "figures"), names[1]: lambda: densities_csv(study.family, members)}
    return write_pages(
        out, texts, {f"density-{name}.png": partial(density, study) for name, density in draw.items()}, force=force
    )


def page(study: Study, figures: str) -> str:
    """Write the study as Markdown; ``figures`` is the folder of its figures, relative to the page."""
    import jinja2

    text = resources.files("chemage_li2018").joinpath("density.md.j2").read_text(encoding="utf-8")
    best, published = study.best, fit.PUBLISHED
    inside = (np.abs(best.beta / published - 1) <= fit.WITHIN_BETA).sum()
    close = np.abs(fit.ratios(best.beta) - fit.PUBLISHED_RATIOS) <= fit.WITHIN_RATIO
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(text)
    return filled(
        template.render(
            figures=figures,
            study=study,
            inside=int(inside),
            close=int(close.sum()),
            largest=100 * float(np.abs(best.beta / published - 1).max()),
            farthest=float(np.abs(fit.ratios(best.beta) - fit.PUBLISHED_RATIOS).max()),
            rates=_rates_table(study),
            ratios=_ratios_table(study),
            families=_families_table(study),
            members=_members_table(study),
            claims=_claims_table(study),
            surface=[100 * value for value in study.errors.surface],
            band=[
                100
                * (
                    max(density.beta[at] for density in study.members)
                    / min(density.beta[at] for density in study.members)
                    - 1
                )
                for at in range(6)
            ],
            best=dict(zip(study.family.parameters, best.parameters, strict=True)),
            interpolation=100 * study.interpolation_error,
            equal=fit.EQUAL,
            method=100 * fit.METHOD,
            triangle=study.triangle,
            satisfied={
                "all": len(best.claims()),
                "best": sum(best.claims().values()),
                "triangle": sum(study.triangle.claims().values()),
            },
        )
    )


def densities_figure(study: Study) -> Figure:
    """Draw the best density, the set, and the triangle; and the share of barriers below an energy."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    energies = np.linspace(0.78, 1.42, 1281)
    every = [(density, figures.GREY, 0.7, 0.7, "set") for density in study.members]
    every += [
        (study.triangle, figures.BLUE, 1.3, 1.0, "triangle"),
        (study.best, figures.ORANGE, 2.0, 1.0, "best (member 0)"),
    ]
    for number, (density, colour, width, alpha, label) in enumerate(every):
        values = density.barriers.density(energies)
        share = np.concatenate([[0], np.cumsum(0.5 * np.diff(energies) * (values[1:] + values[:-1]))])
        style = {"color": colour, "lw": width, "alpha": alpha, "ls": "--" if label == "triangle" else "-"}
        left.plot(energies, values, label=label if number in (0, *range(len(every) - 2, len(every))) else None, **style)
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
    for density in study.members:
        left.plot(where, 100 * (density.beta / published - 1), color=figures.GREY, marker=".", ms=3, ls="none")
        right.plot(place + 0.12, fit.ratios(density.beta), color=figures.GREY, marker=".", ms=3, ls="none")
    left.plot([], [], color=figures.GREY, marker=".", ms=3, ls="none", label="set")
    for density, colour, mark, label in (
        (study.triangle, figures.BLUE, "s", "triangle"),
        (study.best, figures.ORANGE, "o", "best"),
    ):
        left.plot(where, 100 * (density.beta / published - 1), color=colour, marker=mark, ms=5, ls="none", label=label)
        right.plot(
            place + (0.12 if label == "best" else -0.12), fit.ratios(density.beta), color=colour, marker=mark, ls="none"
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
    for volume, (panel, title) in enumerate(zip(axes, ("6.4 Å³", "ΔV = 0"), strict=True)):
        for row, (slope, colour) in enumerate(zip(SLOPES, (figures.BLUE, figures.ORANGE, figures.BLACK), strict=True)):
            every = np.array([member.curves[volume, row] for member in study.members])
            panel.fill_between(TIMES, every.min(axis=0), every.max(axis=0), color=colour, alpha=0.2, lw=0)
            panel.plot(TIMES, study.best.curves[volume, row], color=colour, label=f"h' = {slope:g}")
        panel.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ", title=title, ylim=(0, None))
    axes[0].legend(frameon=False, fontsize=8)
    return figure


HEADER = """\
# Intrinsic energy barriers to forming a siloxane bridge between two hydroxylated silica surfaces.
#
# Columns: member (0: the best density; 1 to {count}: densities that fit equally well); energy in eV; probability
# density in 1/eV, joined by straight lines, zero outside.
#
# Provenance. Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), draw the barriers from a distribution found
# by molecular dynamics (Liu & Szlufarska, Phys. Rev. Lett. 109, 186102 (2012)) that spans 0.8 to 1.4 eV. The published
# distribution is not tabulated. These densities are NOT their data: they are a stand-in on the same span, calibrated
# to the six ageing rates beta that the paper reports for rms slopes 0.05, 0.1 and 0.2 at 20 uN and 300 K, with an
# activation volume of 6.4 cubic angstrom (0.89, 0.45, 0.20) and without (0.98, 0.49, 0.24). `chemage study
# density` calibrates the three parameters of their family and writes this table;
# barrier_density.md has the residuals and the limits. Versions before 0.2.0 had a symmetric triangle with its
# peak at 1.1 eV.
#
# To use barriers of your own, give the kind "tabulated" a table or samples.
"""


def densities_csv(family: Family, members: Sequence[np.ndarray]) -> str:
    """Write the table of densities with these parameters, the best one first."""
    lines = [HEADER.format(count=len(members) - 1) + "member,energy,density"]
    for number, parameters in enumerate(members):
        energies, weights = (np.array(column, dtype=float) for column in family.nodes(*parameters))
        density = weights / (0.5 * np.diff(energies) @ (weights[1:] + weights[:-1]))
        lines += [f"{number},{energy:.6g},{value:.6g}" for energy, value in zip(energies, density, strict=True)]
    return "\n".join(lines) + "\n"
