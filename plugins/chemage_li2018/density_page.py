"""What `chemage study density` writes: the page, its figures, and the table of `md-silica`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

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
    chi = prior.chi_squared(fit.METHODS[0])
    times = prior.reported.misfit_of_times(fit.PAPER)
    rows = []
    for number, family in enumerate(prior.families):
        draws = np.flatnonzero(prior.family == number)
        at = int(draws[np.argmax(of_draws[draws])])
        window = int(np.argmax(study.weight[at].sum(axis=1)))
        error = np.diag(prior.covariance[at] - prior.surface)
        rows.append(
            [
                family.name,
                family.named(prior.parameters[at]),
                f"{of_draws[draws].sum():.3f}",
                f"{100 * np.sqrt(error).max():.1f}",
                f"{chi[at, window]:.1f} ({_WINDOWS[window]})",
                f"{times[at, window]:.1f}",
                *prior.reported.times(at, window),
                " ".join(f"{value:.0f}" for value in chi[draws].min(axis=0)),
            ]
        )
    return rows


def frontier(study: DensityStudy) -> tuple[np.ndarray, np.ndarray]:
    """Misfit of the times, increasing, and the least χ² of the rates (error of the method 1 %) up to it."""
    chi = study.prior.chi_squared(fit.METHODS[0]).ravel()
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
    text, table = out / "barrier_density.md", out / "md_silica_barriers.csv"
    pictures = out / "figures"
    try:
        pictures.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {out}: {error.strerror}") from error
    for path in (text, table, *(pictures / f"{name}.png" for name in draw)):
        preflight(path, force=force)
    size = QUICK if quick else Size()
    with progress.progress_bars() as report:
        study = compute(DensityCurves(out / "rates", report, size.pixels), size)
    write_file(text, page(study), force=force)
    barriers = [density.barriers for density in study.members]
    write_file(table, densities_csv(barriers), force=force)
    drawn = {name: make(study) for name, make in draw.items()}
    return [text, table, *figures.save_figures(drawn, pictures, force=force)]


def page(study: DensityStudy) -> str:
    """Write the study as Markdown."""
    beta = np.array([density.beta for density in study.members])
    alone, of_draws = study.tips.misfit, study.weight.sum(axis=(1, 2))
    low, high = np.exp(fit.interval(study.prior.reported.beta[:, OURS, :6], of_draws))
    # ln of the likelihood: of the rates alone, and where 95 % of the weight ends
    likelihood = study.prior.log_likelihood(fit.PAPER).max(axis=(1, 2))
    surface = study.prior.surface
    rates_alone = study.rates_alone.reported.log_likelihood(fit.PAPER, surface).max()
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
        surface=np.sqrt(np.diag(surface))[:3],
        interpolation=float(np.sqrt(np.mean((study.interpolated - np.log(beta)) ** 2))),
        conflict=float(alone[2].sum() - alone[0, 0] - alone[1, 1]),
    )


def _drawn(study: DensityStudy) -> Iterator[tuple[Density, dict[str, Any]]]:
    """The densities that are drawn, with their looks: the members, two earlier ones, and that of least misfit."""
    for density in study.members[1:]:
        yield density, {"color": figures.GREY, "lw": 0.7}
    yield study.triangle, {"color": figures.BLUE, "label": "triangle, peak 1.1 eV"}
    yield study.rates_alone, {"color": figures.BLACK, "label": "rates alone"}
    best = {"color": figures.ORANGE, "label": "least misfit (member 0)"}
    yield study.members[0], best


def densities_figure(study: DensityStudy) -> Figure:
    """Draw the members, the density of least misfit, and earlier ones; and the share of barriers below an energy."""
    figure, axes = figures.panels(9.6, 3.8, 2, dpi=110)
    left, right = axes
    energies = np.linspace(0.78, 1.42, 1281)
    for density, style in _drawn(study):
        values = density.barriers.density(energies)
        left.plot(energies, values, **style)
        share = cumulative_trapezoid(values, energies, initial=0)
        right.plot(energies, share, **style)
    for panel in axes:
        panel.axvspan(0.83, 1.01, color=figures.GREY, alpha=0.12)
        panel.set(xlabel="intrinsic barrier (eV)", xlim=(0.78, 1.42))
    left.set(ylabel="density (1/eV)", ylim=(0, 6))
    right.set(ylabel="share of barriers below", ylim=(0, 1.02))
    figures.legend(right, fontsize=8, loc="lower right")
    return figure


def trade_figure(study: DensityStudy) -> Figure:
    """Draw the least χ² of the rates against the misfit of the times; and the deviations of the six rates."""
    figure, (left, right) = figures.panels(9.6, 3.8, 2, dpi=110)
    left.plot(*frontier(study), color=figures.GREY, label="least of all densities")
    where = np.arange(6)
    for density, style in _drawn(study):
        left.plot([density.times], [density.rates.min()], "o", **style)
        right.plot(where, 100 * (density.beta / PUBLISHED - 1), "o", **style)
    left.set(xlabel="misfit of the times (χ²)", ylabel="χ² of the six rates")
    left.set(xscale="log", yscale="log", xlim=(0.3, 60))
    figures.legend(left, fontsize=7)
    rounding = 100 * fit.ROUNDING / PUBLISHED
    right.errorbar(where, 0 * where, rounding, color=figures.BLACK, ls="none")
    names = [
        f"h' = {slope:g}\n{volume}"
        for volume, slope in product(("6.4 Å³", "ΔV = 0"), SLOPES)
    ]
    right.set_xticks(where, names, fontsize=7)
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
        energies, weights = np.array([given.energies, given.weights], dtype=float)
        density = weights / (0.5 * np.diff(energies) @ (weights[1:] + weights[:-1]))
        rows = zip(energies, density, strict=True)
        lines += [f"{number},{energy:.6g},{value:.6g}" for energy, value in rows]
    return "\n".join(lines) + "\n"
