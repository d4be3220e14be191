"""What `chemage study density` writes: the page, its figures, and the table of `md-silica`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from chemage.plugin import StoreError, figures, preflight, progress, write_file
from chemage_li2018 import density_fit as fit
from chemage_li2018.density import QUICK, REFERENCES, STAYS, DensityStudy, Size, compute
from chemage_li2018.density_fit import PAPER, PREFER, PUBLISHED
from chemage_li2018.density_rates import DensityCurves
from chemage_li2018.pages import render
from chemage_li2018.published import Reading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    import chemage

#: whose comments the table of a study repeats
SHIPPED = "md_silica_barriers.csv"
_COLOURS = (figures.ORANGE, figures.GREEN, figures.BLUE, figures.BLACK)


def _name(reading: Reading) -> str:
    first, second = (
        f"{start:g} s" if start else "half-slope time" for start in reading.starts
    )
    starts = first if first == second else f"{first} with ΔV and {second} without"
    return f"{starts} to {reading.end:g} s"


def write_study(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and the table of densities into ``out``, and return their paths.

    Computed curves and contacts are kept in ``out/rates``; rerun the same command to resume.
    """
    text, table = out / "barrier_density.md", out / "md_silica_barriers.csv"
    pictures, name = out / "figures", "density-densities"
    try:
        pictures.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {out}: {error.strerror}") from error
    for path in (text, table, pictures / f"{name}.png"):
        preflight(path, force=force)
    size = QUICK if quick else Size()
    with progress.progress_bars() as report:
        study = compute(DensityCurves(out / "rates", report, size.pixels), size)
    write_file(text, page(study), force=force)
    barriers = [one for _, one in study.members.densities]
    write_file(table, densities_csv(barriers), force=force)
    drawn = {name: densities_figure(study)}
    return [text, table, *figures.save_figures(drawn, pictures, force=force)]


def page(study: DensityStudy) -> str:
    """Write the study as Markdown."""
    prior, beta = study.prior, study.members.beta()
    errors = fit.covariance(prior.covariance, PUBLISHED, fit.METHODS[0])
    chi = prior.reported.chi_squared(PAPER, errors)[:, PREFER]
    times = prior.reported.misfit_of_times(PAPER)[:, PREFER]
    families = []
    weight = study.weight.sum(axis=(1, 2)).reshape(len(fit.FAMILIES), -1)
    for number, of in enumerate(weight):
        at = number * of.size + int(np.argmax(of))
        family, row = prior.draws[at]
        named = zip(family.ranges, row, strict=True)
        parameters = ", ".join(f"{name} {value:.3g}" for name, value in named)
        shown = [f"{of.sum():.3f}", f"{chi[at]:.1f}", f"{times[at]:.1f}"]
        families.append([family.name, parameters, *shown, *prior.reported.times(at)])
    rest = [*map(np.subtract, study.members.reported, study.interpolated)]
    return render(
        "density",
        study=study,
        fit=fit,
        references=[name for name, _ in REFERENCES],
        readings=[_name(reading) for reading in fit.READINGS],
        of_readings=study.weight.sum(axis=(0, 2)),
        of_methods=[f"{value:.2f}" for value in study.weight.sum(axis=(0, 1))],
        stays=STAYS,
        families=families,
        beta=beta,
        band=100 * (beta.max(axis=0) / beta.min(axis=0) - 1),
        scatter=100 * np.sqrt(np.diag(prior.surface))[:3],
        # in per cent, rms
        interpolation=[
            100 * np.sqrt(np.mean(one**2))
            for one in (rest[0], rest[1][:, PREFER], rest[2])
        ],
        shifts=100 * study.shifts.beta[:, PREFER].std(axis=0).max(),
    )


def densities_figure(study: DensityStudy) -> Figure:
    """Draw the members and the densities they are compared with; and the share of barriers below an energy."""
    figure, axes = figures.panels(9.6, 3.8, 2, dpi=110)
    left, right = axes
    energies = np.linspace(0.78, 1.42, 1281)

    def draw(barriers: chemage.plugin.Barriers, **style: Any) -> None:
        values = barriers.density(energies)
        left.plot(energies, values, **style)
        right.plot(energies, cumulative_trapezoid(values, energies, initial=0), **style)

    for _, barriers in study.members.densities[1:]:
        draw(barriers, color=figures.GREY, lw=0.7)
    for (name, barriers), colour in zip(REFERENCES, _COLOURS, strict=True):
        draw(barriers, color=colour, label=name)
    for panel in axes:
        panel.axvspan(0.83, 1.01, color=figures.GREY, alpha=0.12)
        panel.set(xlabel="intrinsic barrier (eV)", xlim=(0.78, 1.42))
    left.set(ylabel="density (1/eV)", ylim=(0, 6))
    right.set(ylabel="share of barriers below", ylim=(0, 1.02))
    figures.legend(right, fontsize=8, loc="lower right")
    return figure


def densities_csv(members: Sequence[chemage.plugin.Barriers]) -> str:
    """Write the table of densities, by member, below the comments of the shipped one."""
    text = resources.files("chemage_silica").joinpath(SHIPPED).read_text("utf-8")
    lines = [line for line in text.splitlines() if "#" in line]
    lines.append("member,energy,density")
    for number, barriers in enumerate(members):
        given: Any = barriers
        energies, weights = np.array([given.energies, given.weights], dtype=float)
        density = weights / (0.5 * np.diff(energies) @ (weights[1:] + weights[:-1]))
        rows = zip(energies, density, strict=True)
        lines += [f"{number},{energy:.6g},{value:.6g}" for energy, value in rows]
    return "\n".join(lines) + "\n"
