"""One self-contained HTML page of one or several results: tables, figures, scene, provenance, what to cite.

The page loads nothing: styles are inline, maps are data URIs, curves are inline SVG that takes its colours from the
page, and a content security policy forbids everything else. It has no script. The same files give the same bytes.
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

from chemage.contacts.solution import ContactSolution
from chemage.experiments.run import Run
from chemage.foundation.errors import InputError
from chemage.foundation.files import fresh_file, preflight
from chemage.foundation.text import plus_minus
from chemage.foundation.version import __version__
from chemage.reports.comparison import Comparison, Entry, compare_files, comparison_figures
from chemage.reports.comparison.differences import Difference
from chemage.reports.observables import captions, observables_of
from chemage.reports.run_figures import map_figures, observed_figures

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
_CAPTIONS = {
    "heights": "Heights of the surface, higher is nearer to the counter-body.",
    "pressure": "Contact pressure; what is not in contact stays blank.",
    "patch": "Pressure around the largest contact patch, its outline in green.",
    "friction-drop": "Friction drop ΔF against hold time, mean and standard error.",
    "friction-coefficient-drop": "Friction coefficient drop Δμ against hold time, mean and standard error.",
    "bonds-per-area": "Bonds per contact area against hold time.",
    "pressures": "Distribution of the pressure over the contact.",
}
_MAPS = ("heights", "pressure", "patch")


@dataclass(frozen=True)
class Table:
    """A table of text; a ``wide`` one scrolls in a box of its own where it must."""

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
    """What stands below one heading of a section."""

    heading: str = ""
    paragraphs: list[Any] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    figures: list[Picture] = field(default_factory=list)
    code: str = ""
    items: list[str] = field(default_factory=list)


@dataclass
class Section:
    """A section of the page; ``key`` is the name of its anchor."""

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
    """Write the report of result files to ``out``; several files are compared.

    Parameters
    ----------
    files
        Runs, or ageing or contacts alone.
    out
        The HTML file; an existing one is kept unless ``force``, and never is one of ``files`` overwritten.
    measured
        CSV files of measurements, see :func:`chemage.read_measurements`.

    Raises
    ------
    InputError, StoreError
        A file cannot be read or compared, or ``out`` is there already; nothing is written.
    """
    target = Path(out)
    for given in (*files, *measured):
        if os.path.realpath(given) == os.path.realpath(target):
            raise InputError(f"{target} is what this report is made from; choose another --out")
    preflight(target, force=force)
    page = html(files, measured=measured)
    with fresh_file(target, force=force, size=len(page)) as part:
        part.write_text(page, encoding="utf-8")
    return target


def html(files: Sequence[str | Path], *, measured: Sequence[str | Path] = ()) -> str:
    """The page as text."""
    made = compare_files(files, measured=measured)
    several = len(made.results) > 1
    sections = []
    if several or made.measured:
        sections.append(_comparison(made, "Comparison" if several else "Measurements"))
    cite: dict[str, None] = {}
    for number, one in enumerate(made.results, 1):
        # one file at a time: the maps of a large run are 100 MB
        name = (f"{one.name}: {one.title}" if one.title else one.name) if several else "Result"
        section, to_cite = _result(one, f"r{number}", name)
        sections.append(section)
        cite |= dict.fromkeys(to_cite)
    if cite:
        sections.append(Section("cite", "What to cite", ["These results rest on:"], [Part(items=list(cite))]))
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
        part.tables.append(Table("The results side by side", ["", *names], rows, wide=True))
        for caption, differences in (
            ("How the chemistry differs", made.chemistry_differences()),
            ("What else differs between the scenes, in internal units", made.other_differences()),
        ):
            if differences:
                rows = [_difference_row(one) for one in differences]
                part.tables.append(Table(caption, ["field", *names], rows, wide=True))
    if fits := made.fits():
        rows = [(name, fit.describe(), fit.beta_text(), fit.cutoff_text()) for name, fit in fits]
        columns = ["data", "model", "β per decade", "cut-off time t_c"]
        part.tables.append(Table("Measurements and results, fitted alike", columns, rows, wide=True))
    part.figures = _pictures(comparison_figures(made), made, "c")
    section.parts.append(part)
    return section


def _difference_row(one: Difference) -> tuple[str, ...]:
    return one.path, *("none" if value is None else f"{value}" for value in one.values)


def _result(one: Entry, key: str, name: str) -> tuple[Section, list[str]]:
    """The section of one result, and what to cite."""
    assert one.whole is not None
    thing = one.whole()
    run = thing if isinstance(thing, Run) else None
    contact = run.contact if run is not None else (thing if isinstance(thing, ContactSolution) else None)
    alone = Comparison([one])
    rows = [(label, texts[0]) for label, texts in alone.table()]
    parts = [
        Part("Key numbers", tables=[Table("", ["quantity", "value"], rows, wide=True)], notes=_notes(run, contact))
    ]
    figures: dict[str, Figure] = {}
    if contact is not None:
        figures |= map_figures(contact, run.surface if run is not None else None)
    figures |= comparison_figures(alone)
    if run is not None:
        figures |= observed_figures(run)
    parts.append(Part("Figures", figures=_pictures(figures, alone, key)))
    if one.aging is not None:
        parts.append(Part("Friction against hold time", tables=[_course(one)]))
    if one.scene:
        about = _markup(
            "Every option spelled out, in internal units (nm, nN, GPa, eV, s, K). Saved as a file, "
            "<code>chemage run</code> repeats this result."
        )
        parts.append(Part("Scene", paragraphs=[about], code=scene_toml(one.scene)))
    parts.append(Part("Provenance", tables=[_provenance(one, thing)]))
    return Section(key, name, parts=parts), list(run.cite) if run is not None else []


def _notes(run: Run | None, contact: ContactSolution | None) -> list[str]:
    notes = list(run.notes if run is not None else contact.notes if contact is not None else ())
    if contact is not None and not contact.converged:
        notes.insert(0, f"The contact did NOT converge: residual {contact.residual:.3g}.")
    return notes


def _course(one: Entry) -> Table:
    aging = one.aging
    assert aging is not None
    rows = []
    for number, time in enumerate(aging.hold_times):
        cells = [f"{time:.6g}"]
        for curves in (aging.friction_drop, aging.friction_coefficient_drop, one.bonds_per_area, one.bonded_fraction):
            values = curves[:, number] if curves.size else None
            if values is None or not all(map(math.isfinite, values.tolist())):
                cells.append("-")
                continue
            error = float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else math.nan
            cells.append(plus_minus(float(values.mean()), error))
        rows.append(tuple(cells))
    columns = ["hold time (s)", "ΔF (nN)", "Δμ", "bonds per contact area (1/nm²)", "fraction of sites bonded"]
    return Table(f"Means over {aging.replicas} replicas, ± standard error", columns, rows, wide=True)


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
            *((f"changed by plugin {name}", version) for name, version in thing.plugins.items()),
            *((f"key of stage {stage}", value) for stage, value in thing.keys.items()),
        ]
    rows += [(f"content hash of {name}", part.digest()) for name, part in parts.items()]
    return Table("", ["what", "value"], rows)


def _solver(run: Run) -> str:
    contact = run.contact
    state = "converged" if contact.converged else "NOT CONVERGED"
    return f"{run.scene['contact']['kind']}, {state}, residual {contact.residual:.3g}, {contact.iterations} iterations"


def scene_toml(scene: Mapping[str, Any]) -> str:
    """Plain scene data as TOML; reading it back gives the same data."""
    import tomli_w

    return tomli_w.dumps(scene)


# -- figures ----------------------------------------------------------------------------------------------------------


def _pictures(figures: Mapping[str, Figure], made: Comparison, key: str) -> list[Picture]:
    named = dict(_CAPTIONS)
    for one in made.results:
        if one.aging is not None:
            named |= captions(observables_of(one.aging, one.scene))
    maps = _map_alts(made.results[0])
    found = []
    for name, figure in figures.items():
        alt = maps[name] if name in _MAPS else _curve_alt(made, name, named[name])
        picture = _png(figure, alt) if name in _MAPS else _svg(figure, alt, f"{key}-{name}")
        found.append(Picture(_markup(picture), named[name]))
    return found


def _map_alts(one: Entry) -> dict[str, str]:
    area, patches = one.contact.get("area_fraction", math.nan), one.contact.get("patches", math.nan)
    pressure = f"mean {one.contact.get('mean_contact_pressure', math.nan):.3g} GPa"
    return {
        "heights": f"Map of the heights of the surface of {one.name}.",
        "pressure": f"Map of the contact pressure: {patches:g} patches on {100 * area:.3g} % of the area, {pressure}.",
        "patch": f"Map of the contact pressure around the largest of {patches:g} patches.",
    }


def _curve_alt(made: Comparison, name: str, caption: str) -> str:
    """What a figure shows, in words and numbers, for those who do not see it."""
    curves = {
        "friction-drop": ("Friction drop", lambda one: one.aging.friction_drop, ", in nN"),
        "friction-coefficient-drop": ("Friction coefficient drop", lambda one: one.aging.friction_coefficient_drop, ""),
        "bonds-per-area": ("Bonds per contact area", lambda one: one.bonds_per_area, ", per square nanometre"),
    }
    if name not in curves:
        return f"{caption} Curves for {', '.join(one.name for one in made.results)}."
    what, of, unit = curves[name]
    courses = []
    for one in made.results:
        if one.aging is None or not (values := of(one)).size:
            continue
        first, last = values.mean(axis=0)[[0, -1]]
        start, stop = one.aging.hold_times[[0, -1]]
        courses.append(f"{one.name} goes from {first:.3g} at {start:g} s to {last:.3g} at {stop:g} s")
    return f"{what} against hold time{unit}: {'; '.join(courses)}."


def _png(figure: Figure, alt: str) -> str:
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    width, height = (round(figure.dpi * inches) for inches in figure.get_size_inches())
    source = base64.b64encode(data.getvalue()).decode()
    return (
        f'<img alt="{escape(alt, quote=True)}" width="{width}" height="{height}" src="data:image/png;base64,{source}">'
    )


def _svg(figure: Figure, alt: str, key: str) -> str:
    """Inline SVG without addresses or metadata; black is the page's text colour, and ids are its own."""
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
