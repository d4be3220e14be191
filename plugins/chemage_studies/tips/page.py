"""The tables and the page of the study of tips, which is ``docs/tips.md``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from importlib import resources
from typing import Any

import numpy as np

from chemage.plugin import text
from chemage_studies.markdown import filled, table
from chemage_studies.tips.study import NOTHING, SITES, STAGES, WINDOW, Aged, Study

#: hold times in tables, s
TIMES = (1.0, 1e3, 1e5)

# -- tables -----------------------------------------------------------------------------------------------------------


def contacts_csv(studies: Sequence[Study]) -> str:
    """Make a CSV table with one line per contact and strength of the interaction."""
    rows = []
    for study in studies:
        for one in study.contacts:
            contact, fit = one.contact, one.fit()
            row: dict[str, Any] = {
                "interaction (eV)": study.strength,
                "contact": one.name,
                "group": one.group,
                "load (nN)": contact.load,
                "sites": contact.sites.size,
                "area (nm^2)": contact.area,
                "mean pressure (GPa)": contact.mean_contact_pressure,
                "perimeter to area (1/nm)": contact.perimeter_to_area,
                "patches": contact.patches,
                "replicas": one.aging.replicas,
                "beta": fit.beta,
                "beta error": fit.beta_stderr,
                "cut-off time (s)": fit.cutoff_time,
                "cut-off time error (s)": fit.cutoff_time_stderr,
            }
            for time in TIMES:
                at = one.at(time)
                row[f"friction drop at {time:g} s (nN)"] = one.aging.mean_friction_drop[at]
                row[f"friction drop error at {time:g} s (nN)"] = one.aging.friction_drop_stderr[at]
                row[f"bonds per area at {time:g} s (1/nm^2)"] = one.density[at]
            rows.append(row)
    return _csv(rows)


def curves_csv(studies: Sequence[Study]) -> str:
    """Make a CSV table of the bonds per contact area of every contact at every hold time."""
    return _csv(
        [
            {
                "interaction (eV)": study.strength,
                "contact": one.name,
                "hold time (s)": float(time),
                "bonds per area (1/nm^2)": float(value),
                "error (1/nm^2)": float(error),
            }
            for study in studies
            for one in study.contacts
            for time, value, error in zip(study.times, one.density, one.density_error, strict=True)
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
            raw, one = study.collapses[0].rms, study.collapses[number]
            cells += [f"{one.rms:.3f}", f"{100 * (1 - (one.rms / raw) ** 2):.3f} %"]
        rows.append([stage, *cells])
    columns = [f"{study.strength:g} eV: {what}" for study in studies for what in ("rms", "explained")]
    return table(["predicted from", *columns], rows)


def _hold_times_table(study: Study) -> str:
    at = [study.contacts[0].at(time) for time in (1.0, 10.0, 1e2, 1e3, 1e4, 1e5)]
    rows = [[one.what, *(f"{one.at[i]:.3f}" for i in at)] for one in study.collapses[1:]]
    return table(["predicted from", *(f"{study.times[i]:g} s" for i in at)], rows)


def _nominal_table(study: Study) -> str:
    """The rough contacts and arrays of each tip at equal nominal pressure."""
    nominal = study.group("rough")[0].contact.nominal_pressure
    at = study.contacts[0].at(1e3)
    rows = []
    for slope in sorted({one.shape for one in study.group("rough")}):
        members = [one for one in study.group("rough") if one.shape == slope]
        rows.append(
            [
                f"rough, rms slope {slope:g} ({len(members)} surface{'s' * (len(members) > 1)})",
                _over_surfaces([one.contact.mean_contact_pressure for one in members]),
                _over_surfaces([1e2 * one.contact.area_fraction for one in members]),
                _over_surfaces([one.density[at] for one in members]),
                _over_surfaces([one.aging.mean_friction_coefficient_drop[at] for one in members]),
                _over_surfaces([one.fit().beta for one in members]),
            ]
        )
    for one in study.group("tip"):
        fit, aging = one.fit(), one.aging
        rows.append(
            [
                one.name,
                f"{one.contact.mean_contact_pressure:.3g}",
                f"{1e2 * nominal / one.contact.mean_contact_pressure:.3g}",
                text.mean_text(aging.bonds[:, at] / one.contact.area),
                text.mean_text(aging.friction_coefficient_drop[:, at]),
                text.plus_minus(fit.beta, fit.beta_half_width),
            ]
        )
    columns = ["contact", "mean pressure (GPa)", "A/A0 (%)", "bonds per area (1/nm²), 1000 s", "Δμ, 1000 s", "β"]
    return table(columns, rows)


def _pairs(study: Study) -> list[tuple[Aged, list[Aged]]]:
    tips = {one.name: one for one in study.group("tip")}
    rough = study.group("equal area")
    return [
        (tips[name], [one for one in rough if one.partner == name]) for name in dict.fromkeys(r.partner for r in rough)
    ]


def _equal_table(study: Study) -> str:
    """Each tip and the rough contacts of equal area."""
    rows = []
    for tip, members in _pairs(study):
        bonds = tip.density * tip.contact.area
        ratios = np.stack([one.density * one.contact.area / bonds for one in members])
        rows.append(
            [
                tip.name,
                f"{tip.contact.sites.size}",
                f"{tip.contact.mean_contact_pressure:.2f}",
                _range([one.contact.mean_contact_pressure for one in members]),
                f"{tip.contact.perimeter_to_area:.2f}",
                _range([one.contact.perimeter_to_area for one in members]),
                *(_over_surfaces(ratios[:, tip.at(time)].tolist()) for time in TIMES),
            ]
        )
    ratio = [f"ΔF rough/tip, {time:g} s" for time in TIMES]
    shape = ["mean pressure (GPa)", "same, rough", "C/A (1/nm)", "same, rough"]
    return table(["tip", "sites", *shape, *ratio], rows)


def _exponents(study: Study) -> str:
    """The exponents d log ΔF / d log F_N and d log A / d log F_N of the tips of each radius."""
    at, found = study.contacts[0].at(1e3), []
    for radius in sorted({one.shape for one in study.group("tip")}):
        members = [one for one in study.group("tip") if one.shape == radius]
        if len(members) > 2:
            load = np.log([one.contact.load for one in members])
            drop, area = (
                np.polyfit(load, np.log(values), 1)[0]
                for values in (
                    [one.aging.mean_friction_drop[at] for one in members],
                    [one.contact.area for one in members],
                )
            )
            found.append(f"{drop:.2f} at {radius:g} nm (area: {area:.2f})")
    return ", ".join(found) or "(too few tips)"


# -- the page ---------------------------------------------------------------------------------------------------------


def page(studies: Sequence[Study], figures: str) -> str:
    """Write the study as Markdown; ``figures`` is the folder of its figures, relative to the page."""
    import jinja2

    main = studies[0]
    at = main.contacts[0].at(1e3)
    drops = [one.aging.mean_friction_drop[at] for one in main.contacts]
    densities = [one.density[at] for one in main.contacts]
    smallest = min(main.group("tip"), key=lambda one: one.contact.area)
    hertz = math.pi * (0.75 * smallest.contact.load * smallest.shape / smallest.contact.modulus) ** (2 / 3)
    text = resources.files("chemage_studies.tips").joinpath("tips.md.j2").read_text(encoding="utf-8")
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
            rms=[one.rms for one in main.collapses],
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
                abs(one.contact.sites.size / tip.contact.sites.size - 1) for tip, some in _pairs(main) for one in some
            ),
            smallest=smallest,
            hertz_ratio=smallest.contact.area / hertz,
            hardest=max(main.group("tip"), key=lambda one: one.contact.mean_contact_pressure),
        )
    )
