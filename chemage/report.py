"""One self-contained HTML page of one or several results: tables, figures, scene, provenance, what to cite.

The page loads nothing: styles are inline, maps are data URIs, curves are inline SVG that takes its colours from the
page, and a content security policy forbids everything else. It has no script. The same files give the same bytes.
"""

from __future__ import annotations

import base64
import io
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chemage.errors import InputError
from chemage.text import plus_minus

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from chemage.compare import Comparison, Difference, Result

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"


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
        CSV files of measurements, see :func:`chemage.measured.read_measurements`.

    Raises
    ------
    InputError, StoreError
        A file cannot be read or compared, or ``out`` is there already; nothing is written.
    """
    from chemage.store import fresh_file, preflight

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
    from chemage import __version__
    from chemage.compare import compare_files

    made = compare_files(files, measured=measured)
    several = len(made.results) > 1
    sections: list[tuple[str, str, str]] = []
    if several or made.measured:
        name = "Comparison" if several else "Measurements"
        sections.append((name.lower(), name, _comparison(made)))
    cite: dict[str, None] = {}
    for number, one in enumerate(made.results, 1):
        # one file at a time: the maps of a large run are 100 MB
        text, to_cite = _result(one, f"r{number}")
        name = (f"{one.name}: {one.title}" if one.title else one.name) if several else "Result"
        sections.append((f"r{number}", name, text))
        cite |= dict.fromkeys(to_cite)
    if cite:
        items = "".join(f"<li>{escape(text)}</li>" for text in cite)
        sections.append(("cite", "What to cite", f"<p>These results rest on:</p><ul>{items}</ul>"))
    only = made.results[0]
    title = f"Comparison of {len(made.results)} results" if several else (only.title or only.name)
    links = "".join(f'<li><a href="#{key}">{escape(name)}</a></li>' for key, name, _ in sections)
    body = "".join(
        f'<section id="{key}" aria-labelledby="{key}-h"><h2 id="{key}-h">{escape(name)}</h2>{text}</section>\n'
        for key, name, text in sections
    )
    style = resources.files("chemage").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(title)} - chemage report</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f'<header><h1>{escape(title)}</h1><p class="lead">Chemical ageing of a frictional contact: '
        f"{escape(', '.join(one.source for one in made.results))}</p></header>\n"
        f'<nav aria-label="Contents"><ul>{links}</ul></nav>\n<main>\n{body}</main>\n'
        f"<footer>Made with chemage {escape(__version__)}. Errors are standard errors over replicas of one surface; "
        "intervals are 95 % bootstrap intervals. Neither contains the scatter between surfaces.</footer>\n"
        "</body>\n</html>\n"
    )


# -- sections ---------------------------------------------------------------------------------------------------------


def _comparison(made: Comparison) -> str:
    parts = [f"<p>{escape(made.statement())}</p>"] if len(made.results) > 1 else []
    names = [one.name for one in made.results]
    if len(made.results) > 1:
        parts.append(_table("The results side by side", ["", *names], [(k, *v) for k, v in made.table()], wide=True))
        for caption, differences in (
            ("How the chemistry differs", made.chemistry_differences()),
            ("What else differs between the scenes, in internal units", made.other_differences()),
        ):
            if differences:
                parts.append(
                    _table(caption, ["field", *names], [_difference_row(one) for one in differences], wide=True)
                )
    fits = made.fits()
    if fits:
        rows = [(name, fit.describe(), fit.beta_text(), fit.cutoff_text()) for name, fit in fits]
        columns = ["data", "model", "β per decade", "cut-off time t_c"]
        parts.append(_table("Measurements and results, fitted alike", columns, rows, wide=True))
    parts.append(_figures(made.figures(), {name: _curve_alt(made, name) for name in _CAPTIONS}, "c"))
    return "".join(parts)


def _difference_row(one: Difference) -> tuple[str, ...]:
    return one.path, *("none" if value is None else f"{value}" for value in one.values)


def _result(one: Result, key: str) -> tuple[str, list[str]]:
    """The section of one result, and what to cite."""
    from chemage import plots
    from chemage.compare import Comparison
    from chemage.objects import ContactSolution
    from chemage.runs import Run

    assert one.whole is not None
    thing = one.whole()
    run = thing if isinstance(thing, Run) else None
    contact = run.contact if run is not None else (thing if isinstance(thing, ContactSolution) else None)
    alone = Comparison([one])
    numbers = [(label, texts[0]) for label, texts in alone.table()]
    parts = ["<h3>Key numbers</h3>", _table("", ["quantity", "value"], numbers, wide=True)]
    notes = [*(contact.notes if contact is not None else ())]
    if contact is not None and not contact.converged:
        notes.insert(0, f"The contact did NOT converge: residual {contact.residual:.3g}.")
    parts += [f"<p><strong>Note:</strong> {escape(note)}</p>" for note in notes]
    figures: dict[str, Figure] = {}
    if contact is not None:
        figures |= plots.map_figures(contact, run.surface if run is not None else None)
    figures |= alone.figures()
    if run is not None and (spectrum := plots.barriers_figure(run)) is not None:
        figures["barriers"] = spectrum
    alts = {name: _curve_alt(alone, name) for name in _CAPTIONS} | _map_alts(one)
    parts.append("<h3>Figures</h3>" + _figures(figures, alts, key))
    if one.aging is not None:
        parts.append("<h3>Friction against hold time</h3>" + _course(one))
    if one.scene:
        parts.append(
            "<h3>Scene</h3><p>Every option spelled out, in internal units (nm, nN, GPa, eV, s, K). Saved as a file, "
            f"<code>chemage run</code> repeats this result.</p><pre>{escape(scene_toml(one.scene))}</pre>"
        )
    parts.append("<h3>Provenance</h3>" + _provenance(one, thing))
    return "".join(parts), list(run.cite) if run is not None else []


def _course(one: Result) -> str:
    aging = one.aging
    assert aging is not None
    rows = []
    for number, time in enumerate(aging.hold_times):
        cells = [f"{time:.6g}"]
        for curves, unit in (
            (aging.friction_drop, ""),
            (aging.friction_coefficient_drop, ""),
            (one.bonds_per_area, ""),
            (one.bonded_fraction, ""),
        ):
            values = curves[:, number] if curves.size else None
            if values is None or not all(map(math.isfinite, values.tolist())):
                cells.append("-")
                continue
            error = float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else math.nan
            cells.append(plus_minus(float(values.mean()), error, unit))
        rows.append(tuple(cells))
    columns = ["hold time (s)", "ΔF (nN)", "Δμ", "bonds per contact area (1/nm²)", "fraction of sites bonded"]
    return _table(f"Means over {aging.replicas} replicas, ± standard error", columns, rows, wide=True)


def _provenance(one: Result, thing: Any) -> str:
    from chemage.runs import Run

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
            *((f"key of stage {stage}", value) for stage, value in thing.keys.items()),
        ]
    rows += [(f"content hash of {name}", part.digest()) for name, part in parts.items()]
    return _table("", ["what", "value"], rows)


def _solver(run: Any) -> str:
    contact = run.contact
    state = "converged" if contact.converged else "NOT CONVERGED"
    return f"{run.scene['contact']['kind']}, {state}, residual {contact.residual:.3g}, {contact.iterations} iterations"


# -- the scene as TOML ------------------------------------------------------------------------------------------------


def scene_toml(scene: Mapping[str, Any]) -> str:
    """Plain scene data as TOML; reading it back gives the same data."""
    lines = [f"{_key(name)} = {_value(value)}" for name, value in scene.items() if not _is_section(value)]
    for name, value in scene.items():
        if isinstance(value, Mapping):
            lines += _section(f"[{_key(name)}]", value)
        elif _is_section(value):
            for item in value:
                lines += _section(f"[[{_key(name)}]]", item)
    return "\n".join(lines) + "\n"


def _is_section(value: Any) -> bool:
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(item, Mapping) for item in value)
    )


def _section(header: str, data: Mapping[str, Any]) -> list[str]:
    return ["", header, *(f"{_key(name)} = {_value(value)}" for name, value in data.items())]


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _string(name)


def _string(text: str) -> str:
    # a JSON string is a TOML string, but for DEL, which JSON leaves bare
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(name)} = {_value(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return repr(value)


# -- tables and figures -----------------------------------------------------------------------------------------------


def _table(caption: str, columns: Sequence[str], rows: Sequence[Sequence[str]], *, wide: bool = False) -> str:
    """A table whose first column heads the rows; a ``wide`` one scrolls in a box of its own where it must."""
    # an empty corner is no header
    head = "".join(f'<th scope="col">{escape(name)}</th>' if name else "<td></td>" for name in columns)
    body = "".join(
        f'<tr><th scope="row">{escape(row[0])}</th>' + "".join(f"<td>{escape(cell)}</td>" for cell in row[1:]) + "</tr>"
        for row in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    inner = f"{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    if not wide:
        return f"<table>{inner}\n"
    label = escape(caption or "table", quote=True)
    return f'<div class="scroll" role="region" aria-label="{label}" tabindex="0"><table class="wide">{inner}</div>\n'


_CAPTIONS = {
    "heights": "Heights of the surface, higher is nearer to the counter-body.",
    "pressure": "Contact pressure; what is not in contact stays blank.",
    "patch": "Pressure around the largest contact patch, its outline in green.",
    "friction-drop": "Friction drop ΔF against hold time, mean and standard error.",
    "friction-coefficient-drop": "Friction coefficient drop Δμ against hold time, mean and standard error.",
    "bonds-per-area": "Bonds per contact area against hold time.",
    "pressures": "Distribution of the pressure over the contact.",
    "barriers": "Barriers to forming a bond.",
}
_MAPS = ("heights", "pressure", "patch")


def _map_alts(one: Result) -> dict[str, str]:
    area, patches = one.contact.get("area_fraction", math.nan), one.contact.get("patches", math.nan)
    pressure = f"mean {one.contact.get('mean_contact_pressure', math.nan):.3g} GPa"
    return {
        "heights": f"Map of the heights of the surface of {one.name}.",
        "pressure": f"Map of the contact pressure: {patches:g} patches on {100 * area:.3g} % of the area, {pressure}.",
        "patch": f"Map of the contact pressure around the largest of {patches:g} patches.",
    }


def _curve_alt(made: Comparison, name: str) -> str:
    """What a figure shows, in words and numbers, for those who do not see it."""
    curves = {
        "friction-drop": ("Friction drop", lambda one: one.aging.friction_drop, ", in nN"),
        "friction-coefficient-drop": ("Friction coefficient drop", lambda one: one.aging.friction_coefficient_drop, ""),
        "bonds-per-area": ("Bonds per contact area", lambda one: one.bonds_per_area, ", per square nanometre"),
    }
    if name not in curves:
        return f"{_CAPTIONS[name]} Curves for {', '.join(one.name for one in made.results)}."
    what, of, unit = curves[name]
    told = []
    for one in made.results:
        if one.aging is None or not (values := of(one)).size:
            continue
        first, last = values.mean(axis=0)[[0, -1]]
        start, stop = one.aging.hold_times[[0, -1]]
        told.append(f"{one.name} goes from {first:.3g} at {start:g} s to {last:.3g} at {stop:g} s")
    return f"{what} against hold time{unit}: {'; '.join(told)}."


def _figures(figures: Mapping[str, Figure], alts: Mapping[str, str], key: str) -> str:
    shown = []
    for name, figure in figures.items():
        picture = _png(figure, alts[name]) if name in _MAPS else _svg(figure, alts[name], f"{key}-{name}")
        shown.append(f"<figure>{picture}<figcaption>{escape(_CAPTIONS[name])}</figcaption></figure>")
    return f'<div class="figures">{"".join(shown)}</div>\n'


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
