"""What `chemage study density` writes: the page, its figures, and the table of `md-silica`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import StoreError, figures, preflight, progress, write_file
from chemage_li2018 import density_fit as fit
from chemage_li2018.density import QUICK, Density, DensityStudy, Size, compute
from chemage_li2018.density_fit import OURS, PUBLISHED, WINDOWS
from chemage_li2018.density_rates import FITTED, UNUSED, DensityCurves
from chemage_li2018.pages import render
from chemage_li2018.published import SLOPES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    import chemage

#: misfits of the times up to which the least misfit of the rates is listed
_LEVELS = (0.5, 1, 2, 4, 8, 16, 32)


_WINDOWS = [f"{first:g} to {last:g} s" for first, last in WINDOWS]


def _families(study: DensityStudy) -> list[list[str]]:
    """Rows of the table of families."""
    prior, of_draws = study.prior, study.weight.sum(axis=(1, 2))
    chi = prior.chi_squared(fit.PAPER, study.surface, fit.METHODS[0])
    times = prior.reported.misfit_of_times(fit.PAPER)
    rows = []
    for number, family in enumerate(prior.families):
        draws = np.flatnonzero(prior.family == number)
        at = int(draws[np.argmax(of_draws[draws])])
        window = int(np.argmax(study.weight[at].sum(axis=1)))
        rows.append(
            [
                family.name,
                family.named(prior.parameters[at]),
                f"{of_draws[draws].sum():.3f}",
                f"{100 * np.sqrt(np.diag(prior.errors[number])).max():.1f}",
                f"{chi[at, window]:.1f} ({_WINDOWS[window]})",
                f"{times[at, window]:.1f}",
                *prior.reported.times(at, window),
                " ".join(f"{value:.0f}" for value in chi[draws].min(axis=0)),
            ]
        )
    return rows


def frontier(study: DensityStudy) -> tuple[np.ndarray, np.ndarray]:
    """Misfit of the times, increasing, and the least χ² of the rates (error of the method 1 %) up to it."""
    chi = study.prior.chi_squared(fit.PAPER, study.surface, fit.METHODS[0]).ravel()
    times = study.prior.reported.misfit_of_times(fit.PAPER).ravel()
    order = np.argsort(times)
    return times[order], np.minimum.accumulate(chi[order])


def write_study(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and the table of densities into ``out``, and return their paths.

    Computed curves and contacts are kept in ``out/rates``; rerun the same command to resume.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    draw = {"density-densities": densities_figure, "density-trade": trade_figure}
    texts = ["barrier_density.md", "md_silica_barriers.csv"]
    try:
        (out / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {out}: {error.strerror}") from error
    for name in (*texts, *(f"figures/{name}.png" for name in draw)):
        preflight(out / name, force=force)
    size = QUICK if quick else Size()
    with progress.progress_bars() as report:
        study = compute(DensityCurves(out / "rates", report, size.pixels), size)
    write_file(out / texts[0], page(study), force=force)
    write_file(
        out / texts[1],
        densities_csv([density.barriers for density in study.members]),
        force=force,
    )
    drawn = {name: make(study) for name, make in draw.items()}
    return [
        *(out / name for name in texts),
        *figures.save_figures(drawn, out / "figures", force=force),
    ]


def page(study: DensityStudy) -> str:
    """Write the study as Markdown."""
    beta = np.array([density.beta for density in study.members])
    alone, of_draws = study.tips.misfit, study.weight.sum(axis=(1, 2))
    low, high = np.exp(fit.interval(study.prior.reported.beta[:, OURS, :6], of_draws))
    # ln of the likelihood: of the rates alone, and where 95 % of the weight ends
    likelihood = study.prior.log_likelihood(fit.PAPER, study.surface).max(axis=(1, 2))
    rates_alone = study.rates_alone.reported.log_likelihood(
        fit.PAPER, study.surface
    ).max()
    order = np.argsort(-likelihood)
    end = likelihood[order[np.searchsorted(np.cumsum(of_draws[order]), 0.95)]]
    times, chi = frontier(study)
    last = np.searchsorted(times, _LEVELS) - 1
    return render(
        "density",
        study=study,
        fit=fit,
        tuple=tuple,
        three=[study.members[0], study.rates_alone, study.triangle],
        free_end=fit.FREE_END,
        conditions=FITTED,
        unused=UNUSED,
        published=PUBLISHED,
        windows=_WINDOWS,
        methods=[f"{value:.0%}" for value in fit.METHODS],
        of_windows=study.weight.sum(axis=(0, 2)),
        of_methods=[f"{value:.2f}" for value in study.weight.sum(axis=(0, 1))],
        beta=beta,
        low=low,
        high=high,
        largest=float(np.abs(beta[0] / PUBLISHED - 1).max()),
        band=beta.max(axis=0) / beta.min(axis=0) - 1,
        admitted=[float(2 * (likelihood.max() - one)) for one in (rates_alone, end)],
        families=_families(study),
        frontier=[
            (level, chi[at]) for level, at in zip(_LEVELS, last, strict=True) if at >= 0
        ],
        surface=np.sqrt(np.diag(study.surface))[:3],
        interpolation=float(np.sqrt(np.mean((study.interpolated - np.log(beta)) ** 2))),
        conflict=float(alone[2].sum() - alone[0, 0] - alone[1, 1]),
    )


def _drawn(study: DensityStudy) -> list[tuple[Density, dict[str, Any]]]:
    grey = {"color": figures.GREY, "lw": 0.7, "alpha": 0.7}
    every: list[tuple[Density, dict[str, Any]]] = [
        (density, grey) for density in study.members[1:]
    ]
    every.append(
        (
            study.triangle,
            {
                "color": figures.BLUE,
                "lw": 1.3,
                "ls": "--",
                "label": "triangle, peak 1.1 eV",
            },
        )
    )
    every.append(
        (
            study.rates_alone,
            {"color": figures.BLACK, "lw": 1.3, "ls": ":", "label": "rates alone"},
        )
    )
    every.append(
        (
            study.members[0],
            {"color": figures.ORANGE, "lw": 2.0, "label": "least misfit (member 0)"},
        )
    )
    return every


def densities_figure(study: DensityStudy) -> Figure:
    """Draw the members, the density of least misfit, and earlier ones; and the share of barriers below an energy."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    energies = np.linspace(0.78, 1.42, 1281)
    for density, style in _drawn(study):
        values = density.barriers.density(energies)
        share = np.concatenate(
            [[0], np.cumsum(0.5 * np.diff(energies) * (values[1:] + values[:-1]))]
        )
        left.plot(energies, values, **style)
        right.plot(energies, share, **style)
    for axes in (left, right):
        axes.axvspan(0.83, 1.01, color=figures.GREY, alpha=0.12, lw=0)
        axes.set(xlabel="intrinsic barrier (eV)", xlim=(0.78, 1.42))
    left.set(ylabel="density (1/eV)", ylim=(0, 6))
    right.set(ylabel="share of barriers below", ylim=(0, 1.02))
    right.legend(frameon=False, fontsize=8, loc="lower right")
    return figure


def trade_figure(study: DensityStudy) -> Figure:
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
        xlabel="misfit of the times (χ²)",
        ylabel="χ² of the six rates",
        xscale="log",
        yscale="log",
        xlim=(0.3, 60),
    )
    left.legend(frameon=False, fontsize=7)
    right.errorbar(
        where,
        0 * where,
        yerr=100 * fit.ROUNDING / PUBLISHED,
        color=figures.BLACK,
        ls="none",
        capsize=4,
    )
    right.set_xticks(
        where,
        [
            f"h' = {slope:g}\n{volume}"
            for volume in ("6.4 Å³", "ΔV = 0")
            for slope in SLOPES
        ],
    )
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
        energies = np.array(given.energies, dtype=float)
        weights = np.array(given.weights, dtype=float)
        density = weights / (0.5 * np.diff(energies) @ (weights[1:] + weights[:-1]))
        lines += [
            f"{number},{energy:.6g},{value:.6g}"
            for energy, value in zip(energies, density, strict=True)
        ]
    return "\n".join(lines) + "\n"
