"""What `chemage study density` writes: the page, its figures, and the table of `md-silica`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import figures, progress
from chemage_li2018 import density_fit as fit
from chemage_li2018.density import QUICK, Density, Size, Study, compute
from chemage_li2018.density_fit import OURS, PUBLISHED, WINDOWS
from chemage_li2018.density_rates import FITTED, UNUSED, Condition, Rates
from chemage_li2018.pages import filled, free_folder, table, write_pages
from chemage_li2018.published import SLOPES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    import chemage

#: misfits of the times up to which the least misfit of the rates is listed
_LEVELS = (0.5, 1, 2, 4, 8, 16, 32)


def _window(window: tuple[float, float]) -> str:
    return " to ".join(f"{time:g}" for time in window) + " s"


def _condition(condition: Condition) -> str:
    changed = {"ΔV": f"{1000 * condition.volume:.2g} Å³", "T": f"{condition.temperature:g} K"}
    usual = {"ΔV": "6.4 Å³", "T": "300 K"}
    return ", ".join(
        [f"h' = {condition.slope:g}", *(f"{k} = {value}" for k, value in changed.items() if value != usual[k])]
    )


def _times(reported: fit.Reported, at: int, window: int = OURS) -> list[str]:
    seconds = [*np.exp(reported.onsets[at, window]), *np.exp(reported.crossing[at])]
    return [f"{value:.2g}" for value in seconds]


def _named(family: fit.Family, parameters: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in zip(family.parameters, parameters, strict=True))


def _rates_table(study: Study) -> str:
    best, members = study.members[0], np.array([density.beta for density in study.members])
    low, high = np.exp(fit.interval(study.prior.reported.beta[:, OURS, :6], study.weight.sum(axis=(1, 2))))
    rows = [
        [
            _condition(condition),
            f"{published:.2f}",
            *(f"{row[at]:.3f} ({row[at] / published - 1:+.1%})" for row in (best.beta, study.rates_alone.beta)),
            f"{study.triangle.beta[at]:.3f} ({study.triangle.beta[at] / published - 1:+.1%})",
            f"{low[at]:.3f} to {high[at]:.3f}",
            f"{members[:, at].min():.3f} to {members[:, at].max():.3f}",
        ]
        for at, (condition, published) in enumerate(zip(FITTED, PUBLISHED, strict=True))
    ]
    columns = ["condition", "published β", "least misfit", "rates alone", "triangle, peak 1.1 eV", "95 %", "members"]
    return table(columns, rows)


def _windows_table(study: Study) -> str:
    three = [study.members[0], study.rates_alone, study.triangle]
    rows = [
        [_window(window), f"{study.weight[:, at].sum():.3f}", *(f"{density.rates[at]:.1f}" for density in three)]
        for at, window in enumerate(WINDOWS)
    ]
    return table(["window", "posterior weight", "χ²: least misfit", "rates alone", "triangle, peak 1.1 eV"], rows)


def _families_table(study: Study) -> str:
    prior, of_draws = study.prior, study.weight.sum(axis=(1, 2))
    chi, times = (
        prior.chi_squared(fit.PAPER, study.surface, fit.METHODS[0]),
        fit.misfit_of_times(prior.reported, fit.PAPER),
    )
    rows = []
    for number, family in enumerate(prior.families):
        draws = np.flatnonzero(prior.family == number)
        at = int(draws[np.argmax(of_draws[draws])])
        window = int(np.argmax(study.weight[at].sum(axis=1)))
        least = [" ".join(f"{value:.0f}" for value in chi[draws].min(axis=0))]
        rows.append(
            [
                family.name,
                _named(family, prior.parameters[at]),
                f"{of_draws[draws].sum():.3f}",
                f"{100 * np.sqrt(np.diag(prior.errors[number])).max():.1f}",
                f"{chi[at, window]:.1f} ({_window(WINDOWS[window])})",
                f"{times[at, window]:.1f}",
                *_times(prior.reported, at, window),
                *least,
            ]
        )
    columns = ["family", "parameters of least misfit", "posterior weight", "error of interpolation (%)"]
    columns += ["χ² of the rates", "of the times"]
    return table(
        [*columns, "onset with ΔV (s)", "without (s)", "crossing (s)", "least χ² of the rates by window"], rows
    )


def frontier(study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Misfit of the times, increasing, and the least χ² of the rates (error of the method 1 %) up to it."""
    chi = study.prior.chi_squared(fit.PAPER, study.surface, fit.METHODS[0]).ravel()
    times = fit.misfit_of_times(study.prior.reported, fit.PAPER).ravel()
    order = np.argsort(times)
    return times[order], np.minimum.accumulate(chi[order])


def _admitted(study: Study) -> tuple[float, float]:
    """Twice ln of the likelihood below the largest: of the rates alone, and where 95 % of the weight ends."""
    likelihood = study.prior.log_likelihood(fit.PAPER, study.surface).max(axis=(1, 2))
    rates_alone = fit.log_likelihood(study.rates_alone.reported, fit.PAPER, study.surface).max()
    order = np.argsort(-likelihood)
    last = order[np.searchsorted(np.cumsum(study.weight.sum(axis=(1, 2))[order]), 0.95)]
    return float(2 * (likelihood.max() - rates_alone)), float(2 * (likelihood.max() - likelihood[last]))


def _frontier_table(study: Study) -> str:
    times, chi = frontier(study)
    rows = [
        [f"{level:g}", f"{chi[at]:.1f}"] for level in _LEVELS if (at := int(np.searchsorted(times, level)) - 1) >= 0
    ]
    return table(["misfit of the times, at most", "least χ² of the six rates"], rows)


def _members_table(study: Study) -> str:
    rows = [
        [
            str(number),
            density.name,
            f"{density.rates.min():.1f}",
            " ".join(f"{value:.3f}" for value in density.beta),
            *_times(density.reported, 0),
        ]
        for number, density in enumerate(study.members)
    ]
    columns = ["member", "family", "least χ² of the rates", "β: 6.4 Å³, then ΔV = 0", "onset with ΔV (s)"]
    return table([*columns, "without (s)", "crossing (s)"], rows)


def _held_table(study: Study) -> str:
    rows = [
        [_condition(condition), f"{study.held[:, at].sum()} of {len(study.held)}"]
        for at, condition in enumerate(UNUSED)
    ]
    return table(["condition", "cases in which the range of the members holds β"], rows)


def _tips_table(study: Study) -> str:
    tips, names = study.tips, ("the rough contacts", "the tip", "both")
    rows = [
        [name, _named(fit.FREE_END, values), *(f"{value:.1f}" for value in misfit), f"{start:.2g}", f"{power:.2f}"]
        for name, values, misfit, (start, power) in zip(names, tips.parameters, tips.misfit, tips.growth, strict=True)
    ]
    columns = ["fitted to", "density of least misfit", "misfit of the rough contacts", "of the tip"]
    return table([*columns, "start of the logarithmic regime of the tip (s)", "exponent from 5 to 90 ms"], rows)


def write_study(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and the table of densities into ``out``, and return their paths.

    Computed curves and contacts are kept in ``out/rates``; rerun the same command to resume.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    draw = {"densities": densities_figure, "trade": trade_figure}
    names = ["barrier_density.md", "md_silica_barriers.csv", *(f"figures/density-{name}.png" for name in draw)]
    free_folder(out, names, force=force)
    size = QUICK if quick else Size()
    with progress.progress_bars() as report:
        study = compute(Rates(out / "rates", report, size.pixels), size)
    members = [density.barriers for density in study.members]
    texts = {names[0]: lambda: page(study, "figures"), names[1]: lambda: densities_csv(members)}
    return write_pages(
        out, texts, {f"density-{name}.png": partial(density, study) for name, density in draw.items()}, force=force
    )


def page(study: Study, figures: str) -> str:
    """Write the study as Markdown; ``figures`` is the folder of its figures, relative to the page."""
    import jinja2

    text = resources.files("chemage_li2018").joinpath("density.md.j2").read_text(encoding="utf-8")
    beta = np.array([density.beta for density in study.members])
    best, alone = study.members[0], study.tips.misfit
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(text)
    return filled(
        template.render(
            figures=figures,
            study=study,
            windows="; ".join(_window(window) for window in WINDOWS),
            methods=", ".join(f"{value:.0%}" for value in fit.METHODS),
            of_methods=", ".join(f"{value:.2f}" for value in study.weight.sum(axis=(0, 1))),
            about=fit.ABOUT,
            share=fit.SHARE,
            end=fit.END,
            largest=float(np.abs(best.beta / PUBLISHED - 1).max()),
            band=beta.max(axis=0) / beta.min(axis=0) - 1,
            times=[_times(density.reported, 0) for density in (best, study.rates_alone)],
            admitted=dict(zip(("rates_alone", "limit"), _admitted(study), strict=True)),
            best=best,
            surface=np.sqrt(np.diag(study.surface))[:3],
            interpolation=float(np.sqrt(np.mean((study.interpolated - np.log([d.beta for d in study.members])) ** 2))),
            held=float(study.held.mean()),
            conflict=float(alone[2].sum() - alone[0, 0] - alone[1, 1]),
            tables={name: make(study) for name, make in _TABLES.items()},
        )
    )


_TABLES = {
    "rates": _rates_table,
    "windows": _windows_table,
    "families": _families_table,
    "frontier": _frontier_table,
    "members": _members_table,
    "held": _held_table,
    "tips": _tips_table,
}


def _drawn(study: Study) -> list[tuple[Density, dict[str, Any]]]:
    grey = {"color": figures.GREY, "lw": 0.7, "alpha": 0.7}
    every: list[tuple[Density, dict[str, Any]]] = [(density, grey) for density in study.members[1:]]
    every.append((study.triangle, {"color": figures.BLUE, "lw": 1.3, "ls": "--", "label": "triangle, peak 1.1 eV"}))
    every.append((study.rates_alone, {"color": figures.BLACK, "lw": 1.3, "ls": ":", "label": "rates alone"}))
    every.append((study.members[0], {"color": figures.ORANGE, "lw": 2.0, "label": "least misfit (member 0)"}))
    return every


def densities_figure(study: Study) -> Figure:
    """Draw the members, the density of least misfit, and earlier ones; and the share of barriers below an energy."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    energies = np.linspace(0.78, 1.42, 1281)
    for density, style in _drawn(study):
        values = density.barriers.density(energies)
        share = np.concatenate([[0], np.cumsum(0.5 * np.diff(energies) * (values[1:] + values[:-1]))])
        left.plot(energies, values, **style)
        right.plot(energies, share, **style)
    for axes in (left, right):
        axes.axvspan(0.83, 1.01, color=figures.GREY, alpha=0.12, lw=0)
        axes.set(xlabel="intrinsic barrier (eV)", xlim=(0.78, 1.42))
    left.set(ylabel="density (1/eV)", ylim=(0, 6))
    right.set(ylabel="share of barriers below", ylim=(0, 1.02))
    right.legend(frameon=False, fontsize=8, loc="lower right")
    return figure


def trade_figure(study: Study) -> Figure:
    """Draw the least χ² of the rates against the misfit of the times; and the deviations of the six rates."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    times, chi = frontier(study)
    left.plot(times, chi, color=figures.GREY, label="least of all densities")
    where = np.arange(6)
    for density, style in _drawn(study):
        mark = {key: value for key, value in style.items() if key not in ("lw", "ls")}
        left.plot([density.times], [density.rates.min()], "o", ms=4, **mark)
        right.plot(where, 100 * (density.beta / PUBLISHED - 1), "o", ms=4, **mark)
    left.set(
        xlabel="misfit of the times (χ²)", ylabel="χ² of the six rates", xscale="log", yscale="log", xlim=(0.3, 60)
    )
    left.legend(frameon=False, fontsize=7)
    right.errorbar(where, 0 * where, yerr=100 * fit.ROUNDING / PUBLISHED, color=figures.BLACK, ls="none", capsize=4)
    right.set_xticks(where, [f"h' = {slope:g}\n{volume}" for volume in ("6.4 Å³", "ΔV = 0") for slope in SLOPES])
    right.tick_params(axis="x", labelsize=7)
    right.set(ylabel="β (10 to 10⁴ s) − published (%)")
    return figure


HEADER = """\
# Intrinsic energy barriers to forming a siloxane bridge between two hydroxylated silica surfaces.
#
# Columns: member (0: least misfit; 1 to {last}: densities that span what the published rates and times leave open);
# energy in eV; probability density in 1/eV, joined by lines, zero outside.
#
# Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), draw the barriers from a distribution found by molecular
# dynamics (Liu & Szlufarska, Phys. Rev. Lett. 109, 186102 (2012)) on 0.8 to 1.4 eV, which is not tabulated. These
# densities are NOT their data: they are a stand-in on the same span, calibrated to the six ageing rates that the paper
# reports for rms slopes 0.05, 0.1 and 0.2 at 20 uN and 300 K, with an activation volume of 6.4 cubic angstrom and
# without, to the start of the logarithmic regime and to the order of the slopes, over unknown windows.
# `chemage study density` writes this table; barrier_density.md has the residuals and the limits.
#
# To use barriers of your own, give the kind "tabulated" a table or samples.
"""


def densities_csv(members: Sequence[chemage.plugin.Barriers]) -> str:
    """Write the table of densities, by member."""
    lines = [HEADER.format(last=len(members) - 1) + "member,energy,density"]
    for number, barriers in enumerate(members):
        given: Any = barriers
        energies, weights = np.array(given.energies, dtype=float), np.array(given.weights, dtype=float)
        density = weights / (0.5 * np.diff(energies) @ (weights[1:] + weights[:-1]))
        lines += [f"{number},{energy:.6g},{value:.6g}" for energy, value in zip(energies, density, strict=True)]
    return "\n".join(lines) + "\n"
