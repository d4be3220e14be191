"""A self-contained HTML page of one or several results: tables, figures, scene, provenance, references.

The page loads no other file and has no script: styles are inline, maps are data URIs, curves are inline SVG in the
colours of the page, and a content security policy forbids everything else. Equal files give an equal page.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import tomli_w
from markupsafe import Markup

from chemage.foundation.errors import InputError
from chemage.foundation.figures import png
from chemage.foundation.files import preflight, write_file
from chemage.foundation.looks import drawn_as
from chemage.foundation.names import __version__
from chemage.foundation.result import Panel, Picture, Result, Table, drawn_picture
from chemage.foundation.units import QuantityLike
from chemage.results.comparison import Comparison, Entry, compare_files
from chemage.results.drawing import brought_figures, curve_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"


@dataclass
class PagePart:
    """The content below one heading of a section."""

    heading: str = ""
    #: the main numbers, in large type: (value, what it is)
    numbers: Sequence[tuple[str, str]] = ()
    paragraphs: Sequence[Any] = ()
    notes: Sequence[str] = ()
    tables: list[Table] = field(default_factory=list)
    #: (markup, caption)
    figures: list[tuple[Any, str]] = field(default_factory=list)
    code: str = ""
    items: Sequence[str] = ()


@dataclass
class PageSection:
    """A section of the page; ``key`` is its anchor."""

    key: str
    name: str
    parts: list[PagePart]
    paragraphs: Sequence[str] = ()


def write_report(
    files: Sequence[str | Path],
    out: str | Path = "report.html",
    *,
    measured: Sequence[str | Path] = (),
    offset: QuantityLike | None = None,
    sheet: str | None = None,
    force: bool = False,
) -> Path:
    """Write a report of result files to ``out``, with a comparison if there are several.

    Parameters
    ----------
    files
        Files of results of any kind, and folders of sweeps.
    out
        The HTML file to write.
    measured
        Files of measurements, see :func:`chemage.plugin.read_table`.
    offset, sheet
        Of the measurements, see there.
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
    for source in (*files, *measured):
        if os.path.realpath(source) == os.path.realpath(target):
            raise InputError(
                f"{target} is an input of this report; choose another --out"
            )
    preflight(target, force=force)
    comparison = compare_files(files, measured=measured, offset=offset, sheet=sheet)
    write_file(target, html(comparison), force=force)
    return target


def html(comparison: Comparison) -> str:
    """Make the page of several results as text."""
    several = len(comparison.results) > 1
    sections, cite, please = [], {}, ""
    if several or comparison.measured:
        heading = "Comparison" if several else "Measurements"
        sections.append(_comparison(comparison, heading))
    for number, entry in enumerate(comparison.results, 1):
        # one file at a time: the maps of a large run take 100 MB
        result, key, name = entry.whole(), f"r{number}", "Result"
        if several:
            name = entry.title or entry.name
            if not name.startswith(entry.name):
                name = f"{entry.name}: {name}"
        sections.append(PageSection(key, name, list(_parts(entry, result, key))))
        cite |= dict.fromkeys(result.cite()[0])
        please = please or result.please_cite
    if cite:
        parts = [PagePart(items=list(cite))]
        sections.append(PageSection("cite", "References", parts, [please]))
    only = comparison.results[0]
    title = only.title or only.name
    if several:
        title = f"Comparison of {len(comparison.results)} results"
    style, page = (
        resources.files("chemage.results")
        .joinpath(name)
        .read_text(encoding="utf-8")
        for name in ("report.css", "page.html.j2")
    )
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(page).render(
        title=title,
        policy=_POLICY,
        style=Markup(style),
        sources=[entry.source for entry in comparison.results],
        sections=sections,
        version=__version__,
        errors=comparison.errors_in_words(),
    )


# -- sections ---------------------------------------------------------------------------------------------------------


def _comparison(comparison: Comparison, name: str) -> PageSection:
    names = [entry.name for entry in comparison.results]
    several = len(comparison.results) > 1
    tables: list[Table] = []
    if several:
        rows = [(label, *values) for label, values in comparison.table()]
        tables.append(Table("Comparison of the results", ["", *names], rows))
        for caption, differences in (
            ("Differences in chemistry", comparison.chemistry_differences()),
            (
                "Other differences between the scenes, in internal units",
                comparison.other_differences(),
            ),
        ):
            rows = []
            for path, values in differences.items():
                rows.append(
                    (
                        path,
                        *(
                            "none" if value is None else f"{value}"
                            for value in values
                        ),
                    )
                )
            if rows:
                tables.append(Table(caption, ["field", *names], rows))
    tables += comparison.tables()
    drawn = [*_curves(comparison, "c"), *_brought(comparison, "c")]
    leading, others = PagePart(figures=drawn[:1]), drawn[1:]
    if several:
        rows = [(label, *texts) for label, texts in comparison.first()]
        leading.tables = [Table("Main numbers", ["", *names], rows)]
    parts = [
        leading,
        PagePart(tables=tables),
        *([PagePart("Figures", figures=others)] if others else []),
    ]
    return PageSection(
        name.lower(), name, parts, [comparison.statement()] if several else []
    )


def _parts(entry: Entry, result: Result, key: str) -> Iterator[PagePart]:
    """The parts of the section of a result: the main numbers, figures and tables below their headings, scene,
    provenance."""
    alone = Comparison([entry])
    headed = [("Figures", picture) for picture in _curves(alone, key)]
    for name, picture in result.pictures().items():
        for number, panel in enumerate(picture.panels):
            if panel.caption:
                anchor = re.sub(r"[^\w-]", "-", f"{key}-{name}-{number}")
                headed.append(
                    (panel.heading, _panel(panel, anchor, _approximate(alone)))
                )
    headed += [("Figures", picture) for picture in _brought(alone, key)]
    main = [one.row() for one in entry.first]
    yield PagePart(
        numbers=[] if main else result.summary(),
        figures=[picture for _, picture in headed[:1]],
        notes=entry.notes,
        tables=[Table("Main numbers", ["quantity", "value"], main)] if main else [],
    )
    below = {heading: PagePart(heading) for heading, _ in headed[1:]}
    for heading, picture in headed[1:]:
        below[heading].figures.append(picture)
    below["Key numbers"] = PagePart(
        "Key numbers", tables=[Table("", ["quantity", "value"], result.rows())]
    )
    for table in result.tables():
        part = below.setdefault(table.heading, PagePart(table.heading))
        part.tables.append(table)
        part.paragraphs = [*part.paragraphs, *table.remarks]
    yield from below.values()
    about, scene = result.stated()
    if scene:
        # what stands between backticks is code
        marked = Markup(
            re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(about, quote=False))
        )
        yield PagePart("Scene", paragraphs=[marked], code=tomli_w.dumps(scene))
    provenance = [("file", entry.source), *result.provenance()]
    yield PagePart("Provenance", tables=[Table("", ["item", "value"], provenance)])


# -- figures ----------------------------------------------------------------------------------------------------------


def _approximate(comparison: Comparison) -> str:
    """What is added to the caption of a figure of approximate results."""
    several = len(comparison.results) > 1
    return "".join(
        f" {entry.name + ' is' if several else 'The result is'} approximate: {entry.approximation}."
        for entry in comparison.results
        if entry.approximation
    )


def _curves(comparison: Comparison, key: str) -> list[tuple[Any, str]]:
    """The curves of all results, one figure each."""
    approximate = _approximate(comparison)
    return [
        _panel(panel, f"{key}-{name}", approximate)
        for name, picture in curve_pictures(comparison).items()
        for panel in picture.panels
    ]


def _brought(comparison: Comparison, key: str) -> list[tuple[Any, str]]:
    """The figures of plugins."""
    drawn = []
    for name, (figure, caption) in brought_figures(comparison.results).items():
        alt = f"{caption} Curves for {', '.join(entry.name for entry in comparison.results)}."
        anchor = re.sub(r"[^\w-]", "-", f"{key}-{name}")
        drawn.append(
            (Markup(svg(figure, alt, anchor)), caption + _approximate(comparison))
        )
    return drawn


def _panel(panel: Panel, anchor: str, approximate: str) -> tuple[Any, str]:
    figure = drawn_picture(Picture((panel,), panel.size))
    alt = panel.alt or panel.caption
    return Markup(
        png(figure, alt) if panel.is_map else svg(figure, alt, anchor)
    ), panel.caption + approximate


def svg(figure: Figure, alt: str, key: str) -> str:
    """Make inline SVG without addresses or metadata, with unique ids and the text colour of the page for black."""
    import matplotlib as mpl

    data = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with (
        drawn_as(),
        mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": "chemage"}),
    ):
        figure.savefig(data, format="svg", transparent=True, metadata=nothing)
    text = data.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text).replace(
        "xlink:href=", "href="
    )
    text = re.sub(r'\bid="', f'id="{key}-', text)
    text = text.replace('href="#', f'href="#{key}-').replace(
        "url(#", f"url(#{key}-"
    )
    text = text.replace("#000000", "currentColor")
    label = f'role="img" aria-label="{escape(alt, quote=True)}" fill="currentColor"'
    return f"<svg {label}" + text.removeprefix("<svg")
