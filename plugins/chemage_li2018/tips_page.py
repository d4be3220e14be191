"""What `chemage study tips` writes: the page, its figures and tables."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import figures, progress, text
from chemage_li2018.pages import filled, free_folder, table, write_pages
from chemage_li2018.tips import NOTHING, SITES, STAGES, STRENGTHS, UNIFORM, WINDOW, Aged, Study, compute, deviation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: hold times in tables, s
TIMES = (1.0, 1e3, 1e5)

# -- tables -----------------------------------------------------------------------------------------------------------


def contacts_csv(studies: Sequence[Study]) -> str:
    """Make a CSV table with one line per contact and strength of the interaction."""
    rows = []
    for study in studies:
        for aged in study.contacts:
            contact, fit = aged.contact, aged.fit()
            row: dict[str, Any] = {
                "interaction (eV)": study.strength,
                "contact": aged.name,
                "group": aged.group,
                "load (nN)": contact.load,
                "sites": contact.sites.size,
                "area (nm^2)": contact.area,
                "mean pressure (GPa)": contact.mean_contact_pressure,
                "perimeter to area (1/nm)": contact.perimeter_to_area,
                "patches": contact.patches,
                "replicas": aged.aging.replicas,
                "beta": fit.beta,
                "beta error": fit.beta_stderr,
                "cut-off time (s)": fit.cutoff_time,
                "cut-off time error (s)": fit.cutoff_time_stderr,
            }
            for time in TIMES:
                at = aged.at(time)
                row[f"friction drop at {time:g} s (nN)"] = aged.aging.mean_friction_drop[at]
                row[f"friction drop error at {time:g} s (nN)"] = aged.aging.friction_drop_stderr[at]
                row[f"bonds per area at {time:g} s (1/nm^2)"] = aged.density[at]
            rows.append(row)
    return _csv(rows)


def curves_csv(studies: Sequence[Study]) -> str:
    """Make a CSV table of the bonds per contact area of every contact at every hold time."""
    return _csv(
        [
            {
                "interaction (eV)": study.strength,
                "contact": aged.name,
                "hold time (s)": float(time),
                "bonds per area (1/nm^2)": float(value),
                "error (1/nm^2)": float(error),
            }
            for study in studies
            for aged in study.contacts
            for time, value, error in zip(study.times, aged.density, aged.density_error, strict=True)
        ]
    )


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
    return text.getvalue()


def _over_surfaces(values: Sequence[float]) -> str:
    """Mean over surfaces and half of its 95 % interval."""
    return text.mean_text(np.array(values))


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def _collapse_table(studies: Sequence[Study]) -> str:
    rows = []
    for number, stage in enumerate((NOTHING, *STAGES)):
        cells = []
        for study in studies:
            raw, collapse = study.collapses[0].rms, study.collapses[number]
            cells += [f"{collapse.rms:.3f}", f"{100 * (1 - (collapse.rms / raw) ** 2):.3f} %"]
        rows.append([stage, *cells])
    columns = [f"{study.strength:g} eV: {what}" for study in studies for what in ("rms", "explained")]
    return table(["predicted from", *columns], rows)


def _hold_times_table(study: Study) -> str:
    at = [study.contacts[0].at(time) for time in (1.0, 10.0, 1e2, 1e3, 1e4, 1e5)]
    rows = [[collapse.what, *(f"{collapse.at[i]:.3f}" for i in at)] for collapse in study.collapses[1:]]
    return table(["predicted from", *(f"{study.times[i]:g} s" for i in at)], rows)


def _nominal_table(study: Study) -> str:
    """The rough contacts and arrays of each tip at equal nominal pressure."""
    nominal = study.group("rough")[0].contact.nominal_pressure
    at = study.contacts[0].at(1e3)
    rows = []
    for slope in sorted({aged.shape for aged in study.group("rough")}):
        members = [aged for aged in study.group("rough") if aged.shape == slope]
        rows.append(
            [
                f"rough, rms slope {slope:g} ({len(members)} surface{'s' * (len(members) > 1)})",
                _over_surfaces([aged.contact.mean_contact_pressure for aged in members]),
                _over_surfaces([1e2 * aged.contact.area_fraction for aged in members]),
                _over_surfaces([aged.density[at] for aged in members]),
                _over_surfaces([aged.aging.mean_friction_coefficient_drop[at] for aged in members]),
                _over_surfaces([aged.fit().beta for aged in members]),
            ]
        )
    for aged in study.group("tip"):
        fit, aging = aged.fit(), aged.aging
        rows.append(
            [
                aged.name,
                f"{aged.contact.mean_contact_pressure:.3g}",
                f"{1e2 * nominal / aged.contact.mean_contact_pressure:.3g}",
                text.mean_text(aging.bonds[:, at] / aged.contact.area),
                text.mean_text(aging.friction_coefficient_drop[:, at]),
                text.plus_minus(fit.beta, fit.beta_half_width),
            ]
        )
    columns = ["contact", "mean pressure (GPa)", "A/A0 (%)", "bonds per area (1/nm²), 1000 s", "Δμ, 1000 s", "β"]
    return table(columns, rows)


def _pairs(study: Study) -> list[tuple[Aged, list[Aged]]]:
    tips = {aged.name: aged for aged in study.group("tip")}
    rough = study.group("equal area")
    return [
        (tips[name], [aged for aged in rough if aged.partner == name])
        for name in dict.fromkeys(r.partner for r in rough)
    ]


def _equal_table(study: Study) -> str:
    """Each tip and the rough contacts of equal area."""
    rows = []
    for tip, members in _pairs(study):
        bonds = tip.density * tip.contact.area
        ratios = np.stack([aged.density * aged.contact.area / bonds for aged in members])
        rows.append(
            [
                tip.name,
                f"{tip.contact.sites.size}",
                f"{tip.contact.mean_contact_pressure:.2f}",
                _range([aged.contact.mean_contact_pressure for aged in members]),
                f"{tip.contact.perimeter_to_area:.2f}",
                _range([aged.contact.perimeter_to_area for aged in members]),
                *(_over_surfaces(ratios[:, tip.at(time)].tolist()) for time in TIMES),
            ]
        )
    ratio = [f"ΔF rough/tip, {time:g} s" for time in TIMES]
    shape = ["mean pressure (GPa)", "same, rough", "C/A (1/nm)", "same, rough"]
    return table(["tip", "sites", *shape, *ratio], rows)


def _exponents(study: Study) -> str:
    """The exponents d log ΔF / d log F_N and d log A / d log F_N of the tips of each radius."""
    at, exponents = study.contacts[0].at(1e3), []
    for radius in sorted({aged.shape for aged in study.group("tip")}):
        members = [aged for aged in study.group("tip") if aged.shape == radius]
        if len(members) > 2:
            load = np.log([aged.contact.load for aged in members])
            drop, area = (
                np.polyfit(load, np.log(values), 1)[0]
                for values in (
                    [aged.aging.mean_friction_drop[at] for aged in members],
                    [aged.contact.area for aged in members],
                )
            )
            exponents.append(f"{drop:.2f} at {radius:g} nm (area: {area:.2f})")
    return ", ".join(exponents) or "(too few tips)"


# -- the page ---------------------------------------------------------------------------------------------------------


def write_study(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and tables into ``out``, and return their paths.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    texts = {"tips.md": lambda: page(studies, "figures"), "tips-contacts.csv": lambda: contacts_csv(studies)}
    texts["tips-curves.csv"] = lambda: curves_csv(studies)
    drawn = {
        "tips-collapse.png": lambda: collapse_figure(studies[0]),
        "tips-pressure.png": lambda: pressure_figure(studies[0]),
        "tips-rim.png": lambda: rim_figure(studies),
    }
    free_folder(out, [*texts, *(f"figures/{name}" for name in drawn)], force=force)
    with progress.progress_bars() as report:
        studies = [compute(strength, report, quick=quick) for strength in STRENGTHS]
    return write_pages(out, texts, drawn, force=force)


def page(studies: Sequence[Study], figures: str) -> str:
    """Write the study as Markdown; ``figures`` is the folder of its figures, relative to the page."""
    import jinja2

    main = studies[0]
    at = main.contacts[0].at(1e3)
    drops = [aged.aging.mean_friction_drop[at] for aged in main.contacts]
    densities = [aged.density[at] for aged in main.contacts]
    smallest = min(main.group("tip"), key=lambda aged: aged.contact.area)
    hertz = math.pi * (0.75 * smallest.contact.load * smallest.shape / smallest.contact.modulus) ** (2 / 3)
    text = resources.files("chemage_li2018").joinpath("tips.md.j2").read_text(encoding="utf-8")
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(text)
    return filled(
        template.render(
            main=main,
            figures=figures,
            tips=len(main.group("tip")),
            rough=main.group("rough")[0].contact,
            sites=f"{SITES:,}",
            window=f"{WINDOW[0]:g} to {WINDOW[1]:g} s",
            strengths=" and ".join(f"{study.strength:g} eV" for study in studies),
            drop_ratio=max(drops) / min(drops),
            density_ratio=max(densities) / min(densities),
            rms=[collapse.rms for collapse in main.collapses],
            noise=" and ".join(f"{study.noise:.3f} at {study.strength:g} eV" for study in studies),
            rims=" and ".join(f"{100 * study.rim_effect(1e3):+.1f} % at {study.strength:g} eV" for study in studies),
            cancelling=" and ".join(
                f"{study.strength:g} eV" for study in studies if study.collapses[2].rms <= study.collapses[3].rms
            ),
            collapse_table=_collapse_table(studies),
            hold_times_table=_hold_times_table(main),
            nominal_table=_nominal_table(main),
            exponents=_exponents(main),
            equal_tables=[(study.strength, _equal_table(study)) for study in studies],
            mismatch=max(
                abs(aged.contact.sites.size / tip.contact.sites.size - 1) for tip, some in _pairs(main) for aged in some
            ),
            smallest=smallest,
            hertz_ratio=smallest.contact.area / hertz,
            hardest=max(main.group("tip"), key=lambda aged: aged.contact.mean_contact_pressure),
        )
    )


_COLOURS = {"tip": figures.BLUE, "rough": figures.ORANGE, "equal area": figures.GREEN}
_MARKS = {"tip": "o", "rough": "s", "equal area": "^"}
_LABELS = {"tip": "tips", "rough": "rough, equal nominal pressure", "equal area": "rough, at a tip's area"}


def _figure(columns: int) -> tuple[Figure, list[Axes]]:
    return figures.panels(4.8 * columns, 3.8, columns, dpi=90)


def _groups(study: Study) -> list[str]:
    return list(dict.fromkeys(aged.group for aged in study.contacts))


def collapse_figure(study: Study) -> Figure:
    """Draw ΔF of every contact against hold time, per contact area, and relative to the prediction."""
    figure, axes = _figure(3)
    for aged in study.contacts:
        style: dict[str, Any] = {"color": _COLOURS[aged.group], "lw": 0.9, "alpha": 0.8}
        axes[0].plot(study.times, aged.aging.mean_friction_drop, **style)
        axes[1].plot(study.times, aged.density, **style)
    for time in study.times:
        deviations, _ = deviation(study, float(time))
        for group in _groups(study):
            values = [1 + value for value, aged in zip(deviations, study.contacts, strict=True) if aged.group == group]
            axes[2].plot([time] * len(values), values, color=_COLOURS[group], marker=".", ms=3, ls="none")
    for group in _groups(study):
        axes[0].plot([], [], color=_COLOURS[group], label=_LABELS[group])
    for pressure in (UNIFORM[0], 2.0, 4.0):
        curve = study.uniform[UNIFORM.index(pressure)]
        label = "uniform, no pressure" if pressure < 0.1 else f"uniform, {pressure:g} GPa"
        dashes = {0: ":", 1: "--", 2: "-."}[(UNIFORM[0], 2.0, 4.0).index(pressure)]
        axes[1].plot(study.times, curve, color=figures.BLACK, lw=1.3, ls=dashes, label=label)
    axes[2].axhline(1, color=figures.GREY, lw=1)
    axes[0].set(xscale="log", yscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    axes[1].set(xscale="log", xlabel="hold time (s)", ylabel="bonds per contact area (1/nm²)", ylim=(0, None))
    axes[2].set(xscale="log", xlabel="hold time (s)", ylabel="bonds / prediction from area and pressures")
    axes[2].set_ylim(0.8, 1.2)
    for axis in axes[:2]:
        axis.legend(frameon=False, fontsize=8)
    return figure


def pressure_figure(study: Study) -> Figure:
    """Draw bonds per area and Δμ at 1000 s against the mean contact pressure."""
    figure, axes = _figure(2)
    at = study.contacts[0].at(1e3)
    axes[0].plot(UNIFORM, study.uniform[:, at], color=figures.GREY, ls="--", lw=1.2, label="uniform pressure, no rim")
    for group in _groups(study):
        members = study.group(group)
        pressure = [aged.contact.mean_contact_pressure for aged in members]
        style: dict[str, Any] = {"color": _COLOURS[group], "marker": _MARKS[group], "ls": "none", "ms": 4.5}
        axes[0].plot(pressure, [aged.density[at] for aged in members], label=_LABELS[group], **style)
        axes[1].plot(pressure, [aged.aging.mean_friction_coefficient_drop[at] for aged in members], **style)
    highest = max(aged.contact.mean_contact_pressure for aged in study.contacts)
    most = max(aged.density[at] for aged in study.contacts)
    axes[0].set(xlim=(0, 1.1 * highest), ylim=(0, 1.5 * most), xlabel="mean contact pressure (GPa)")
    axes[0].set_ylabel("bonds per contact area at 1000 s (1/nm²)")
    axes[1].set(xscale="log", yscale="log", xlabel="mean contact pressure (GPa)", ylabel="Δμ at 1000 s")
    for axis, values in ((axes[1].xaxis, (0.5, 1, 2, 4, 8)), (axes[1].yaxis, (1, 2, 3, 4, 5))):
        axis.set_ticks(values, [f"{value:g}" for value in values])
        axis.set_ticks([], minor=True)
    axes[0].legend(frameon=False, fontsize=8)
    return figure


def rim_figure(studies: Sequence[Study]) -> Figure:
    """Draw the deviation from the prediction of area and pressure against the length of the rim."""
    figure, axes = _figure(len(studies))
    for axis, study in zip(axes, studies, strict=True):
        deviations, rim = deviation(study, 1e3)
        for group in _groups(study):
            chosen = np.array([member.group == group for member in study.contacts])
            style: dict[str, Any] = {"color": _COLOURS[group], "marker": _MARKS[group], "ls": "none", "ms": 4.5}
            axis.plot(rim[chosen], 100 * deviations[chosen], label=_LABELS[group], **style)
        slope = study.rim_effect(1e3)
        line = np.array([0, 1.05 * rim.max()])
        label = f"{100 * slope:.1f} % per 1/nm"
        axis.plot(line, 100 * slope * line, color=figures.GREY, lw=1, ls="--", label=label)
        axis.set(xlabel="perimeter to area C/A (1/nm)", title=f"interaction {study.strength:g} eV", xlim=(0, None))
        axis.set_ylabel("deviation of the bonds at 1000 s (%)")
        axis.legend(frameon=False, fontsize=8)
    return figure
