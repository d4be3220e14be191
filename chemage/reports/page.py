"""A self-contained HTML page of one or several results: tables, figures, scene, provenance, references.

The page loads no other file and has no script: styles are inline, maps are data URIs, curves are inline SVG in the
colours of the page, and a content security policy forbids everything else. Equal files give an equal page.
"""

from __future__ import annotations

import base64
import io
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chemage.ageing.aging import Aging
from chemage.ageing.elasticity import elastic_notes
from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.experiments.run import Run
from chemage.foundation.errors import InputError
from chemage.foundation.files import fresh_file, preflight
from chemage.foundation.text import mean_text
from chemage.foundation.version import __version__
from chemage.reports.comparison import Comparison, Entry, compare_files
from chemage.reports.comparison.differences import Difference
from chemage.reports.comparison.figures import comparison_brought, core_figures
from chemage.reports.plugin_figures import Brought
from chemage.reports.run_figures import brought_figures, map_figures

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
_MAPS = ("heights", "pressure", "patch")


@dataclass(frozen=True)
class Table:
    """A table of text; a ``wide`` one scrolls horizontally on narrow screens."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    wide: bool = False


@dataclass(frozen=True)
class Picture:
    """A figure as markup, with its caption."""

    picture: Any
    caption: str


@dataclass
class Part:
    """The content below one heading of a section."""

    heading: str = ""
    paragraphs: list[Any] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    figures: list[Picture] = field(default_factory=list)
    code: str = ""
    items: list[str] = field(default_factory=list)


@dataclass
class Section:
    """A section of the page; ``key`` is its anchor."""

    key: str
    name: str
    paragraphs: list[str] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)


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
    made = compare_files(files, measured=measured)
    several = len(made.results) > 1
    sections = []
    if several or made.measured:
        sections.append(_comparison(made, "Comparison" if several else "Measurements"))
    cite: dict[str, None] = {}
    for number, one in enumerate(made.results, 1):
        # one file at a time: the maps of a large run take 100 MB
        name = (f"{one.name}: {one.title}" if one.title else one.name) if several else "Result"
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
        style=_markup(resources.files("chemage.reports").joinpath("report.css").read_text(encoding="utf-8")),
        sources=[one.source for one in made.results],
        sections=sections,
        version=__version__,
    )


@lru_cache
def _template() -> Template:
    import jinja2

    text = resources.files("chemage.reports").joinpath("page.html.j2").read_text(encoding="utf-8")
    return jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined).from_string(text)


def _markup(text: str) -> Any:
    from markupsafe import Markup

    return Markup(text)


# -- sections ---------------------------------------------------------------------------------------------------------


def _comparison(made: Comparison, name: str) -> Section:
    section = Section(name.lower(), name)
    names = [one.name for one in made.results]
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
        rows = [(name, fit.describe(), fit.beta_text(), fit.cutoff_text()) for name, fit in fits]
        columns = ["data", "model", "β per decade", "cut-off time t_c"]
        part.tables.append(Table("Equal fits to measurements and results", columns, rows, wide=True))
    part.figures = _pictures(core_figures(made), comparison_brought(made.results), made, "c")
    section.parts.append(part)
    return section


def _difference_row(one: Difference) -> tuple[str, ...]:
    return one.path, *("none" if value is None else f"{value}" for value in one.values)


def _result(one: Entry, key: str, name: str) -> tuple[Section, list[str]]:
    """Make the section of one result, and list its references."""
    assert one.whole is not None
    thing = one.whole()
    run = thing if isinstance(thing, Run) else None
    contact = (
        run.contact if run is not None else (thing if isinstance(thing, ContactSolution | ContactStatistics) else None)
    )
    alone = Comparison([one])
    rows = [(label, texts[0]) for label, texts in alone.table()]
    notes = [f"approximate: {one.approximate}"] if one.approximate else []
    notes += _notes(run, contact) if not isinstance(thing, Aging) else elastic_notes(thing)
    parts = [Part("Key numbers", tables=[Table("", ["quantity", "value"], rows, wide=True)], notes=notes)]
    figures: dict[str, Figure] = {}
    if contact is not None:
        figures |= map_figures(contact, run.surface if run is not None else None)
    figures |= core_figures(alone)
    brought = brought_figures(run) if run is not None else comparison_brought(alone.results)
    parts.append(Part("Figures", figures=_pictures(figures, brought, alone, key)))
    if one.aging is not None:
        parts.append(Part("Friction against hold time", tables=[_curves_table(one)]))
    if one.scene:
        about = _markup(
            "All options, in internal units (nm, nN, GPa, eV, s, K). Saved as a file, this scene reproduces the result "
            "with <code>chemage run</code>."
        )
        parts.append(Part("Scene", paragraphs=[about], code=scene_toml(one.scene)))
    parts.append(Part("Provenance", tables=[_provenance(one, thing)]))
    return Section(key, name, parts=parts), list(run.cite) if run is not None else []


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


def scene_toml(scene: Mapping[str, Any]) -> str:
    """Format plain scene data as TOML, from which equal data can be read."""
    import tomli_w

    return tomli_w.dumps(scene)


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
        picture = _png(figure, alt) if name in _MAPS else _svg(figure, alt, f"{key}-{name}")
        found.append(Picture(_markup(picture), _CAPTIONS[name] + approximate))
    for name, one in brought.items():
        anchor = re.sub(r"[^\w-]", "-", f"{key}-{name}")
        picture = _svg(one.figure, _curve_alt(made, name, one.caption), anchor)
        found.append(Picture(_markup(picture), one.caption + approximate))
    return found


def _of(one: Entry, made: Comparison) -> str:
    return f"{one.name} is " if len(made.results) > 1 else "The result is "


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


def _png(figure: Figure, alt: str) -> str:
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    width, height = (round(figure.dpi * inches) for inches in figure.get_size_inches())
    source = base64.b64encode(data.getvalue()).decode()
    return (
        f'<img alt="{escape(alt, quote=True)}" width="{width}" height="{height}" src="data:image/png;base64,{source}">'
    )


def _svg(figure: Figure, alt: str, key: str) -> str:
    """Make inline SVG without addresses or metadata, with unique ids and the text colour of the page for black."""
    import matplotlib as mpl

    data = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": "chemage"}):
        figure.savefig(data, format="svg", transparent=True, metadata=nothing)
    text = data.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href=", "href=")
    text = re.sub(r'\bid="', f'id="{key}-', text)
    text = text.replace('href="#', f'href="#{key}-').replace("url(#", f"url(#{key}-")
    text = text.replace("#000000", "currentColor")
    label = f'role="img" aria-label="{escape(alt, quote=True)}" fill="currentColor"'
    return re.sub(r"<svg\b", f"<svg {label}", text, count=1)
