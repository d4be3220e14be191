"""The study of tips written down: figures, tables, and the page that is ``docs/tips.md``."""

from __future__ import annotations

import csv
import io
import math
import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.reports.figures import panels
from chemage_studies.tips.study import NOTHING, SITES, STAGES, UNIFORM, WINDOW, Aged, Study, left_over

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: s, hold times told in tables
TIMES = (1.0, 1e3, 1e5)

# -- tables -----------------------------------------------------------------------------------------------------------


def contacts_csv(studies: Sequence[Study]) -> str:
    """One line a contact and strength."""
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
    """Bonds per contact area of every contact at every hold time."""
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


def _pm(value: float, error: float) -> str:
    if not error > 0:
        return f"{value:.3g}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _over_surfaces(values: Sequence[float]) -> str:
    """Mean and its standard error."""
    array = np.array(values)
    return _pm(float(array.mean()), float(array.std(ddof=1) / math.sqrt(array.size)) if array.size > 1 else math.nan)


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _collapse_table(studies: Sequence[Study]) -> str:
    rows = []
    for number, stage in enumerate((NOTHING, *STAGES)):
        cells = []
        for study in studies:
            raw, one = study.collapses[0].rms, study.collapses[number]
            cells += [f"{one.rms:.3f}", f"{100 * (1 - (one.rms / raw) ** 2):.3f} %"]
        rows.append([stage, *cells])
    columns = [f"{study.strength:g} eV: {what}" for study in studies for what in ("rms", "explained")]
    return _table(["predicted from", *columns], rows)


def _course_table(study: Study) -> str:
    at = [study.contacts[0].at(time) for time in (1.0, 10.0, 1e2, 1e3, 1e4, 1e5)]
    rows = [[one.what, *(f"{one.at[i]:.3f}" for i in at)] for one in study.collapses[1:]]
    return _table(["predicted from", *(f"{study.times[i]:g} s" for i in at)], rows)


def _nominal_table(study: Study) -> str:
    """At equal nominal pressure: the rough contacts, and arrays of each tip."""
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
                _pm(one.density[at], one.density_error[at]),
                _pm(aging.mean_friction_coefficient_drop[at], aging.friction_coefficient_drop_stderr[at]),
                _pm(fit.beta, fit.beta_stderr),
            ]
        )
    columns = ["contact", "mean pressure (GPa)", "A/A0 (%)", "bonds per area (1/nm²), 1000 s", "Δμ, 1000 s", "β"]
    return _table(columns, rows)


def _pairs(study: Study) -> list[tuple[Aged, list[Aged]]]:
    tips = {one.name: one for one in study.group("tip")}
    rough = study.group("equal area")
    return [
        (tips[name], [one for one in rough if one.partner == name]) for name in dict.fromkeys(r.partner for r in rough)
    ]


def _equal_table(study: Study) -> str:
    """At equal area: each tip beside the rough contacts pressed to its area."""
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
    shape = ["mean pressure (GPa)", "of the rough", "C/A (1/nm)", "of the rough"]
    return _table(["tip", "sites", *shape, *ratio], rows)


def _exponents(study: Study) -> str:
    """d log ΔF / d log F over the tips of each radius."""
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
            found.append(f"{drop:.2f} at {radius:g} nm (its area: {area:.2f})")
    return ", ".join(found) or "(too few tips)"


# -- figures ----------------------------------------------------------------------------------------------------------

_COLOURS = {"tip": "#0072B2", "rough": "#D55E00", "equal area": "#009E73"}
_MARKS = {"tip": "o", "rough": "s", "equal area": "^"}
_LABELS = {"tip": "tips", "rough": "rough, equal nominal pressure", "equal area": "rough, at a tip's area"}


def _figure(columns: int) -> tuple[Figure, list[Axes]]:
    return panels(4.8 * columns, 3.8, columns, dpi=90)


def _groups(study: Study) -> list[str]:
    return list(dict.fromkeys(one.group for one in study.contacts))


def collapse_figure(study: Study) -> Figure:
    """ΔF of every contact against hold time; per contact area; and over what area and pressure predict."""
    figure, axes = _figure(3)
    for one in study.contacts:
        style: dict[str, Any] = {"color": _COLOURS[one.group], "lw": 0.9, "alpha": 0.8}
        axes[0].plot(study.times, one.aging.mean_friction_drop, **style)
        axes[1].plot(study.times, one.density, **style)
    for time in study.times:
        left, _ = left_over(study, float(time))
        for group in _groups(study):
            values = [1 + value for value, one in zip(left, study.contacts, strict=True) if one.group == group]
            axes[2].plot([time] * len(values), values, color=_COLOURS[group], marker=".", ms=3, ls="none")
    for group in _groups(study):
        axes[0].plot([], [], color=_COLOURS[group], label=_LABELS[group])
    for pressure in (UNIFORM[0], 2.0, 4.0):
        curve = study.uniform[UNIFORM.index(pressure)]
        label = "uniform, no pressure" if pressure < 0.1 else f"uniform, {pressure:g} GPa"
        dashes = {0: ":", 1: "--", 2: "-."}[(UNIFORM[0], 2.0, 4.0).index(pressure)]
        axes[1].plot(study.times, curve, color="#000000", lw=1.3, ls=dashes, label=label)
    axes[2].axhline(1, color="#777777", lw=1)
    axes[0].set(xscale="log", yscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    axes[1].set(xscale="log", xlabel="hold time (s)", ylabel="bonds per contact area (1/nm²)", ylim=(0, None))
    axes[2].set(xscale="log", xlabel="hold time (s)", ylabel="bonds / predicted from area and pressures")
    axes[2].set_ylim(0.8, 1.2)
    for one in axes[:2]:
        one.legend(frameon=False, fontsize=8)
    return figure


def pressure_figure(study: Study) -> Figure:
    """Bonds per area and Δμ at 1000 s against the mean contact pressure."""
    figure, axes = _figure(2)
    at = study.contacts[0].at(1e3)
    axes[0].plot(UNIFORM, study.uniform[:, at], color="#777777", ls="--", lw=1.2, label="uniform pressure, no rim")
    for group in _groups(study):
        members = study.group(group)
        pressure = [one.contact.mean_contact_pressure for one in members]
        style: dict[str, Any] = {"color": _COLOURS[group], "marker": _MARKS[group], "ls": "none", "ms": 4.5}
        axes[0].plot(pressure, [one.density[at] for one in members], label=_LABELS[group], **style)
        axes[1].plot(pressure, [one.aging.mean_friction_coefficient_drop[at] for one in members], **style)
    highest = max(one.contact.mean_contact_pressure for one in study.contacts)
    most = max(one.density[at] for one in study.contacts)
    axes[0].set(xlim=(0, 1.1 * highest), ylim=(0, 1.5 * most), xlabel="mean contact pressure (GPa)")
    axes[0].set_ylabel("bonds per contact area at 1000 s (1/nm²)")
    axes[1].set(xscale="log", yscale="log", xlabel="mean contact pressure (GPa)", ylabel="Δμ at 1000 s")
    for axis, values in ((axes[1].xaxis, (0.5, 1, 2, 4, 8)), (axes[1].yaxis, (1, 2, 3, 4, 5))):
        axis.set_ticks(values, [f"{value:g}" for value in values])
        axis.set_ticks([], minor=True)
    axes[0].legend(frameon=False, fontsize=8)
    return figure


def rim_figure(studies: Sequence[Study]) -> Figure:
    """What area and pressure leave unexplained, against the length of the rim."""
    figure, axes = _figure(len(studies))
    for one, study in zip(axes, studies, strict=True):
        left, rim = left_over(study, 1e3)
        for group in _groups(study):
            chosen = np.array([member.group == group for member in study.contacts])
            style: dict[str, Any] = {"color": _COLOURS[group], "marker": _MARKS[group], "ls": "none", "ms": 4.5}
            one.plot(rim[chosen], 100 * left[chosen], label=_LABELS[group], **style)
        slope = _rim_effect(study)
        line = np.array([0, 1.05 * rim.max()])
        label = f"{100 * slope:.1f} % for 1/nm"
        one.plot(line, 100 * slope * line, color="#777777", lw=1, ls="--", label=label)
        one.set(xlabel="perimeter to area C/A (1/nm)", title=f"interaction {study.strength:g} eV", xlim=(0, None))
        one.set_ylabel("bonds beyond area and pressure, 1000 s (%)")
        one.legend(frameon=False, fontsize=8)
    return figure


def _rim_effect(study: Study) -> float:
    assert study.rim is not None
    return float(study.rim[study.contacts[0].at(1e3)])


# -- the page ---------------------------------------------------------------------------------------------------------


def page(studies: Sequence[Study], figures: str) -> str:
    """The study as Markdown; ``figures`` is where its figures are, seen from the page."""
    main = studies[0]
    at = main.contacts[0].at(1e3)
    drops = [one.aging.mean_friction_drop[at] for one in main.contacts]
    densities = [one.density[at] for one in main.contacts]
    rough = main.group("rough")[0].contact
    number_of_tips = len(main.group("tip"))
    area, pressure, field, rim = (one.rms for one in main.collapses[1:])
    strengths = " and ".join(f"{study.strength:g} eV" for study in studies)
    noise = " and ".join(f"{study.noise:.3f} at {study.strength:g} eV" for study in studies)
    rims = " and ".join(f"{100 * _rim_effect(study):+.1f} % at {study.strength:g} eV" for study in studies)
    off = max(abs(one.contact.sites.size / tip.contact.sites.size - 1) for tip, some in _pairs(main) for one in some)
    equal = "\n\n".join(f"At {study.strength:g} eV:\n\n{_equal_table(study)}" for study in studies)
    smallest = min(main.group("tip"), key=lambda one: one.contact.area)
    hertz = math.pi * (0.75 * smallest.contact.load * smallest.shape / smallest.contact.modulus) ** (2 / 3)
    hardest = max(main.group("tip"), key=lambda one: one.contact.mean_contact_pressure)
    return _filled(f"""# Tips and rough contacts: what scaling by area explains

The command `chemage study tips` computed the results on this page and wrote it. It ages {number_of_tips} tips (the
radii and loads of the scene `silica-tips`) and {len(main.contacts) - number_of_tips} rough contacts (the scene
`silica-patch`, {rough.shape[0]} × {rough.shape[1]} pixels of {rough.pixel_size:g} nm) with the same chemistry, at two
strengths of the interaction between neighbours, {strengths}: Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018),
use the former for single asperities and the latter for rough contacts. Every mean is over some {SITES:,} aged sites.
The area of a contact is the area of its pixels, each of which carries one site.

## Summary

At {main.strength:g} eV, over hold times from {WINDOW[0]:g} to {WINDOW[1]:g} s:

- The friction drops ΔF of all contacts span a factor of {max(drops) / min(drops):.0f} at 1000 s. Per contact area, the
  bonds span a factor of {max(densities) / min(densities):.1f}.
- **Area alone** leaves an rms deviation of {100 * area:.0f} % between the contacts.
- **Area and mean pressure** leave {100 * pressure:.1f} %; **area and the distribution of the pressure** leave
  {100 * field:.1f} %. Neither prediction has a free parameter: the effect of pressure is taken from uniform contacts
  without a rim.
- Adding the **rim**, in proportion to C/A with one fitted number per hold time, leaves {100 * rim:.1f} %; the finite
  number of replicas accounts for {100 * main.noise:.1f} %.

Contact area is thus the most important quantity, and pressure the second. Whether the contact is a tip or a rough
surface matters only through these two and, by a few per cent, through the rim.

## Explained deviation

The table gives the rms of ln(bonds/prediction) over all contacts and hold times from {WINDOW[0]:g} to {WINDOW[1]:g} s,
and the share of the variance of ln ΔF that is explained. "Nothing" and "area" are deviations from the mean curve. The
finite number of replicas accounts for {noise}.

{_collapse_table(studies)}
{_cancelling(studies)}
The next table gives the same rms at single hold times, at {main.strength:g} eV. At short hold times, nearly all bonds
form at the few sites under the highest pressure, so that area alone predicts little; at long hold times, pressure
matters less and less:

{_course_table(main)}

A rim of C/A = 1/nm changes the bonds at 1000 s by {rims}: a site at the rim has fewer neighbours to raise its barrier.

![Friction drop of every contact, per area, and over the prediction]({figures}/tips-collapse.png)

![What area and pressure leave, against the length of the rim]({figures}/tips-rim.png)

## Equal nominal pressure

All contacts of this section have a nominal pressure of {1e3 * rough.nominal_pressure:.2f} MPa: rough surfaces, and
arrays of equal tips too far apart to interact elastically, at {main.strength:g} eV. Δμ is (bonds per area) × ⟨f⟩ /
(mean contact pressure). A contact of lower mean pressure has more area at the same load; this outweighs the smaller
number of bonds per area, so that it ages more. Errors describe the scatter between surfaces for rough contacts (of
{rough.shape[0] * rough.pixel_size:.0f} nm, which scatter more than the whole of `silica-rough`), and between replicas
for tips.

{_nominal_table(main)}

![Bonds per area and friction coefficient drop against mean pressure]({figures}/tips-pressure.png)

For tips of one radius, ΔF at 1000 s is proportional to the load to the power {_exponents(main)}. The excess over the
exponent of the area is due to pressure.

## Equal contact area

Rough contacts of rms slope 0.1 were pressed until they had as many sites as a tip (within {100 * off:.1f} %). Their
mean pressure scatters, which shows most at 1 s. Errors describe the scatter between surfaces.

{equal}

## Limitations

- Areas are counted in pixels: the {smallest.name} has {smallest.contact.area / hertz:.2f} times its area by Hertz.
  Scaling by the area of Hertz instead would change the comparison by as much.
- The contact is elastic. The {hardest.name} has a mean pressure of {hardest.contact.mean_contact_pressure:.1f} GPa,
  which is not far from the hardness of silica.
- Radii, loads and the interaction are assumptions of the scenes; no measurement was fitted.

## Reproduce

`chemage study tips --out FOLDER` writes this page, its figures, and the files `tips-contacts.csv` and `tips-curves.csv`
with all numbers on which they are based. `chemage run silica-tips` runs the tips as a sweep.
""")


def _cancelling(studies: Sequence[Study]) -> str:
    """What to say where the mean pressure does as well as its distribution."""
    which = [f"{study.strength:g} eV" for study in studies if study.collapses[2].rms <= study.collapses[3].rms]
    if not which:
        return ""
    return (
        f"\nAt {' and '.join(which)} the mean pressure predicts as well as the distribution of the pressure because "
        "two errors cancel: at long hold times bonds saturate with pressure, so that a spread of the pressure reduces "
        "their number, while the rim increases it.\n"
    )


def _filled(text: str) -> str:
    """Paragraphs and list items of Markdown broken at 120 characters; headings, tables and figures as they are."""
    blocks = []
    for block in text.strip().split("\n\n"):
        if block.startswith(("#", "|", "!")):
            blocks.append(block)
            continue
        items = re.split(r"\n(?=- )", block)
        indent = "  " if block.startswith("- ") else ""
        kept = [" ".join(item.split()) for item in items]
        blocks.append(
            "\n".join(
                textwrap.fill(item, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
                for item in kept
            )
        )
    return "\n\n".join(blocks) + "\n"
