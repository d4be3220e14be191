"""A self-contained HTML page of one or several results: tables, figures, scene, provenance, references.

The page loads no other file and has no script: styles are inline, maps are data URIs, curves are inline SVG in the
colours of the page, and a content security policy forbids everything else. Equal files give an equal page.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chemage.ageing.aging import Aging
from chemage.ageing.elasticity import elastic_notes
from chemage.ageing.fitting import span_text
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.errors import InputError
from chemage.foundation.files import fresh_file, preflight
from chemage.foundation.text import mean_text, plus_minus, power_text
from chemage.foundation.version import __version__
from chemage.results.comparison import Comparison, Entry, compare_files
from chemage.results.comparison.differences import Difference
from chemage.results.comparison.figures import comparison_brought, core_figures
from chemage.results.ensemble_page import ensemble_section, main_estimates
from chemage.results.figures import png
from chemage.results.inference_page import ERRORS, holds_inference, inference_section
from chemage.results.page_parts import Part, Picture, Section, Table, markup, scene_part, svg
from chemage.results.plugin_figures import Brought
from chemage.results.run_figures import brought_figures, map_figures
from chemage.scene.run import Run

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
_CAPTIONS = {
    "heights": "Heights of the surface; higher points are nearer to the counter-body.",
    "pressure": "Contact pressure; pixels that are not in contact are blank.",
    "patch": "Pressure around the largest contact patch, outlined in green.",
    "friction-drop": "Friction drop ΔF against hold time, means and 95 % intervals.",
    "friction-coefficient-drop": "Friction coefficient drop Δμ against hold time, means and 95 % intervals.",
    "bonds-per-area": "Bonds per contact area against hold time.",
    "pressures": "Distribution of the pressure over the contact.",
}
#: of a figure with ensembles
_BARS = " Bands are intervals of means over surfaces, bars of means over replicas on one surface."
_MAPS = ("heights", "pressure", "patch")


def write_report(
    files: Sequence[str | Path],
    out: str | Path = "report.html",
    *,
    measured: Sequence[str | Path] = (),
    force: bool = False,
) -> Path:
    """Write a report of result files to ``out``, with a comparison if there are several.

    Parameters
    ----------
    files
        Files of runs, ageing curves or contacts, and folders of sweeps.
    out
        The HTML file to write.
    measured
        CSV files of measurements, see :func:`chemage.read_measurements`.
    force
        Overwrite ``out``, unless it is one of the files that are read.

    Returns
    -------
    pathlib.Path
        ``out``.

    Raises
    ------
    InputError
        A file cannot be compared, or ``out`` is one of the files that are read; nothing is written.
    StoreError
        A file cannot be read, or ``out`` exists or cannot be written.
    """
    target = Path(out)
    for given in (*files, *measured):
        if os.path.realpath(given) == os.path.realpath(target):
            raise InputError(f"{target} is an input of this report; choose another --out")
    preflight(target, force=force)
    page = html(files, measured=measured)
    with fresh_file(target, force=force, size=len(page)) as part:
        part.write_text(page, encoding="utf-8")
    return target


def html(files: Sequence[str | Path], *, measured: Sequence[str | Path] = ()) -> str:
    """Make the page as text; arguments and errors as for :func:`write_report`."""
    if inferences := [file for file in files if holds_inference(file)]:
        return _of_inferences(files, inferences, measured)
    made = compare_files(files, measured=measured)
    several = len(made.results) > 1
    sections = []
    if several or made.measured:
        sections.append(_comparison(made, "Comparison" if several else "Measurements"))
    cite: dict[str, None] = {}
    for number, one in enumerate(made.results, 1):
        # one file at a time: the maps of a large run take 100 MB
        title = one.title if not one.title or one.title.startswith(one.name) else f"{one.name}: {one.title}"
        name = (title or one.name) if several else "Result"
        section, to_cite = _result(one, f"r{number}", name)
        sections.append(section)
        cite |= dict.fromkeys(to_cite)
    if cite:
        sections.append(
            Section(
                "cite", "References", ["Please cite these works together with the results:"], [Part(items=list(cite))]
            )
        )
    only = made.results[0]
    return _template().render(
        title=f"Comparison of {len(made.results)} results" if several else (only.title or only.name),
        policy=_POLICY,
        style=markup(resources.files("chemage.results").joinpath("report.css").read_text(encoding="utf-8")),
        sources=[one.source for one in made.results],
        sections=sections,
        version=__version__,
        errors=_errors(made),
    )


def _of_inferences(files: Sequence[str | Path], inferences: list[Any], measured: Sequence[str | Path]) -> str:
    """Make the page of files of ``chemage infer``."""
    if others := [str(file) for file in (*files, *measured) if file not in inferences]:
        raise InputError(
            f"{inferences[0]} is an inference, which is not compared with {', '.join(others)}; write a report of each"
        )
    sections, cite, title = [], {}, ""
    for number, file in enumerate(inferences, 1):
        name = Path(file).stem if len(inferences) > 1 else "Result"
        section, to_cite, title = inference_section(file, f"r{number}", name)
        sections.append(section)
        cite |= dict.fromkeys(to_cite)
    if cite:
        sections.append(Section("cite", "References", ["Please cite these works:"], [Part(items=list(cite))]))
    return _template().render(
        title=title if len(inferences) == 1 else f"{len(inferences)} inferences",
        policy=_POLICY,
        style=markup(resources.files("chemage.results").joinpath("report.css").read_text(encoding="utf-8")),
        sources=[str(file) for file in inferences],
        sections=sections,
        version=__version__,
        errors=ERRORS,
    )


@lru_cache
def _template() -> Template:
    import jinja2

    text = resources.files("chemage.results").joinpath("page.html.j2").read_text(encoding="utf-8")
    return jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined).from_string(text)


# -- sections ---------------------------------------------------------------------------------------------------------


def _comparison(made: Comparison, name: str) -> Section:
    section = Section(name.lower(), name)
    names = [one.name for one in made.results]
    pictures = _pictures(_curve_first(core_figures(made)), comparison_brought(made.results), made, "c")
    part = Part()
    if len(made.results) > 1:
        section.paragraphs.append(made.statement())
        rows = [(label, *values) for label, values in made.table()]
        part.tables.append(Table("Comparison of the results", ["", *names], rows, wide=True))
        for caption, differences in (
            ("Differences in chemistry", made.chemistry_differences()),
            ("Other differences between the scenes, in internal units", made.other_differences()),
        ):
            if differences:
                rows = [_difference_row(one) for one in differences]
                part.tables.append(Table(caption, ["field", *names], rows, wide=True))
    if fits := made.fits():
        rows = [(name, fit.describe(), fit.beta_text(), fit.b_text(), fit.cutoff_text()) for name, fit in fits]
        columns = ["data", "model", "β per decade", "b per e-fold", "cut-off time t_c"]
        part.tables.append(Table("Equal fits to measurements and results", columns, rows, wide=True))
    if left_out := made.not_fitted():
        part.tables.append(Table("Fits that cannot be made", ["data", "model", "reason"], left_out, wide=True))
    leading = Part(figures=pictures[:1], tables=[_main_table(made)] if len(made.results) > 1 else [])
    section.parts += [leading, part]
    if pictures[1:]:
        section.parts.append(Part("Figures", figures=pictures[1:]))
    return section


def _difference_row(one: Difference) -> tuple[str, ...]:
    return one.path, *("none" if value is None else f"{value}" for value in one.values)


def _result(one: Entry, key: str, name: str) -> tuple[Section, list[str]]:
    """Make the section of one result, and list its references."""
    if one.ensemble is not None:
        return ensemble_section(one, key, name)
    assert one.whole is not None
    thing = one.whole()
    run = thing if isinstance(thing, Run) else None
    contact = (
        run.contact if run is not None else (thing if isinstance(thing, ContactSolution | ContactStatistics) else None)
    )
    alone = Comparison([one])
    rows = [(label, texts[0]) for label, texts in alone.table()]
    notes = [f"approximate: {one.approximate}"] if one.approximate else []
    if isinstance(thing, Aging):
        notes += [*elastic_notes(thing), *([one.fit.doubt] if one.fit is not None and one.fit.doubt else [])]
    else:
        notes += _notes(run, contact)
    figures = core_figures(alone)
    if contact is not None:
        figures |= map_figures(contact, run.surface if run is not None else None)
    brought = brought_figures(run) if run is not None else comparison_brought(alone.results)
    pictures = _pictures(_curve_first(figures), brought, alone, key)
    parts = [
        Part(numbers=main_numbers(one, alone.times), figures=pictures[:1], notes=notes),
        Part("Figures", figures=pictures[1:]),
        Part("Key numbers", tables=[Table("", ["quantity", "value"], rows, wide=True)]),
    ]
    parts = [part for part in parts if part.numbers or part.figures or part.tables or part.notes]
    if one.aging is not None:
        parts.append(Part("Friction against hold time", tables=[_curves_table(one)]))
    if one.scene:
        parts.append(scene_part(one.scene))
    parts.append(Part("Provenance", tables=[_provenance(one, thing)]))
    return Section(key, name, parts=parts), list(run.cite) if run is not None else []


def _curve_first(figures: Mapping[str, Figure]) -> dict[str, Figure]:
    """The same figures, the curve of friction against hold time first."""
    first = ("friction-coefficient-drop", "friction-drop", "pressure")
    leading = next((name for name in first if name in figures), None)
    return {**({leading: figures[leading]} if leading else {}), **figures}


def main_numbers(one: Entry, times: Sequence[float], among: bool = False) -> list[tuple[str, str]]:
    """The numbers that a reader looks for first: (value with its error, what it is); ``among`` ensembles, whose errors
    are others, it is said over what the interval is."""
    area = one.contact.get("area_fraction", math.nan)
    found = [(f"{area:.3g}", "area fraction A/A₀")] if math.isfinite(area) else []
    aging = one.aging
    if one.ensemble is not None:
        return main_estimates(one, times)
    if aging is None:
        pressure = one.contact.get("mean_contact_pressure", math.nan)
        patches = one.contact.get("patches", math.nan)
        found += [(f"{pressure:.3g} GPa", "mean contact pressure")] if math.isfinite(pressure) else []
        return found + ([(f"{patches:g}", "contact patches")] if math.isfinite(patches) else [])
    known = [time for time in times if aging.hold_times[0] <= time <= aging.hold_times[-1]]
    time = known[-1] if known else one.last()
    sure = "95 % interval" if aging.replicas > 1 else "one replica: no error"
    sure += ", replicas on one surface" if among and aging.replicas > 1 else ""
    if one.load > 0:
        drop = (mean_text(one.at(aging.friction_coefficient_drop, time)), f"Δμ at {power_text(time)} s, {sure}")
    else:
        drop = (mean_text(one.at(aging.friction_drop, time), "nN"), f"ΔF at {power_text(time)} s, {sure}")
    slope = []
    if (fit := one.fit) is not None and math.isfinite(fit.beta):
        half = fit.beta_half_width if math.isfinite(fit.beta_interval.low) else math.nan
        slope = [(plus_minus(fit.beta, half), f"β per decade, line fitted {span_text(fit.span)}, {sure}")]
    return [drop, *slope, *found]


def _main_table(made: Comparison) -> Table:
    """The main numbers of every result; what differs from the heading of its column is said with the number."""
    numbers = {one.name: main_numbers(one, made.times, made.has_ensembles) for one in made.results}
    columns = [what for _, what in max(numbers.values(), key=len)]
    rows = []
    for name, found in numbers.items():
        known = {what: value for value, what in found if what in columns}
        others = iter([f"{value} ({what})" for value, what in found if what not in columns])
        rows.append((name, *(known.get(what) or next(others, "-") for what in columns)))
    return Table("Main numbers", ["", *columns], rows, wide=True)


def _notes(run: Run | None, contact: ContactSolution | ContactStatistics | None) -> list[str]:
    notes = list(run.notes if run is not None else contact.notes if contact is not None else ())
    if isinstance(contact, ContactSolution) and not contact.converged:
        notes.insert(0, f"The contact did NOT converge: residual {contact.residual:.3g}.")
    return notes


def _curves_table(one: Entry) -> Table:
    aging = one.aging
    assert aging is not None
    rows = []
    for number, time in enumerate(aging.hold_times):
        cells = [f"{time:.6g}"]
        for curves in (aging.friction_drop, aging.friction_coefficient_drop, one.bonds_per_area, one.bonded_fraction):
            cells.append(mean_text(curves[:, number]) if curves.size else "-")
        rows.append(tuple(cells))
    columns = ["hold time (s)", "ΔF (nN)", "Δμ", "bonds per contact area (1/nm²)", "fraction of sites bonded"]
    title = f"Means over {aging.replicas} replicas with 95 % intervals (Student's t)"
    if aging.replicas == 1:
        title = "One replica: there is no error"
    if aging.errors:
        title += f". Errors of the mean at the last hold time: {aging.error_words}"
    return Table(title, columns, rows, wide=True)


def _provenance(one: Entry, thing: Any) -> Table:
    rows: list[tuple[str, str]] = [("file", one.source)]
    parts: Mapping[str, Any] = {type(thing).__name__: thing}
    if isinstance(thing, Run):
        parts = thing.parts()
        hold = thing.scene.get("hold", {})
        rows += [
            ("seed of the surface", str(thing.scene.get("surface", {}).get("seed", "-"))),
            ("seed of disorder and kinetics", str(hold.get("seed", "-"))),
            ("solver", _solver(thing)),
            ("wall time", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in thing.timings.items()) or "-"),
            *((f"version of {name}", version) for name, version in thing.versions.items()),
            *((f"plugin {name}", version) for name, version in thing.plugins.items()),
            *((f"key of stage {stage}", value) for stage, value in thing.keys.items()),
        ]
    rows += [(f"content hash of {name}", part.digest()) for name, part in parts.items()]
    return Table("", ["item", "value"], rows)


def _solver(run: Run) -> str:
    contact = run.contact
    if isinstance(contact, ContactStatistics):
        return f"{run.scene['contact']['kind']}, a theory: nothing is solved"
    state = "converged" if contact.converged else "NOT CONVERGED"
    return f"{run.scene['contact']['kind']}, {state}, residual {contact.residual:.3g}, {contact.iterations} iterations"


# -- figures ----------------------------------------------------------------------------------------------------------


def _pictures(
    figures: Mapping[str, Figure], brought: Mapping[str, Brought], made: Comparison, key: str
) -> list[Picture]:
    maps = _map_alts(made.results[0])
    approximate = "".join(
        f" {_of(one, made)}approximate: {one.approximate}." for one in made.results if one.approximate
    )
    found = []
    for name, figure in figures.items():
        alt = maps[name] if name in _MAPS else _curve_alt(made, name, _CAPTIONS[name])
        picture = png(figure, alt) if name in _MAPS else svg(figure, alt, f"{key}-{name}")
        mixed = _BARS if made.has_ensembles and name.startswith("friction") else ""
        found.append(Picture(markup(picture), _CAPTIONS[name] + mixed + approximate))
    for name, one in brought.items():
        anchor = re.sub(r"[^\w-]", "-", f"{key}-{name}")
        picture = svg(one.figure, _curve_alt(made, name, one.caption), anchor)
        found.append(Picture(markup(picture), one.caption + approximate))
    return found


def _of(one: Entry, made: Comparison) -> str:
    return f"{one.name} is " if len(made.results) > 1 else "The result is "


def _errors(made: Comparison) -> str:
    """What the errors of the page are, in words."""
    single = (
        "95 % intervals over replicas on one surface (Student's t); they do not include the scatter between surfaces"
    )
    means = "95 % intervals (Student's t) that include the scatter between surfaces"
    if not made.has_ensembles:
        return f"Errors are {single}."
    averages = [one.name for one in made.results if one.of_surfaces]
    others = [one.name for one in made.results if not one.of_surfaces]
    if not others:
        return f"Errors are {means}."
    if not averages:
        return f"Errors are {single}."
    return f"Errors of {', '.join(averages)} are {means}. Errors of {', '.join(others)} are {single}."


def _map_alts(one: Entry) -> dict[str, str]:
    area, patches = one.contact.get("area_fraction", math.nan), one.contact.get("patches", math.nan)
    pressure = f"mean {one.contact.get('mean_contact_pressure', math.nan):.3g} GPa"
    return {
        "heights": f"Map of the heights of the surface of {one.name}.",
        "pressure": f"Map of the contact pressure: {patches:g} patches on {100 * area:.3g} % of the area, {pressure}.",
        "patch": f"Map of the contact pressure around the largest of {patches:g} patches.",
    }


def _curve_alt(made: Comparison, name: str, caption: str) -> str:
    """Describe a figure in words and numbers, for readers who cannot see it."""
    curves = {
        "friction-drop": ("Friction drop", lambda one: one.aging.friction_drop, ", in nN"),
        "friction-coefficient-drop": ("Friction coefficient drop", lambda one: one.aging.friction_coefficient_drop, ""),
        "bonds-per-area": ("Bonds per contact area", lambda one: one.bonds_per_area, ", per square nanometre"),
    }
    if name not in curves:
        return f"{caption} Curves for {', '.join(one.name for one in made.results)}."
    what, of, unit = curves[name]
    found = []
    for one in made.results:
        if one.aging is None or not (values := of(one)).size:
            continue
        first, last = values.mean(axis=0)[[0, -1]]
        start, stop = one.aging.hold_times[[0, -1]]
        found.append(f"{one.name} goes from {first:.3g} at {start:g} s to {last:.3g} at {stop:g} s")
    return f"{what} against hold time{unit}: {'; '.join(found)}."
