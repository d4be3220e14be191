"""The section of an ensemble in the page of a report."""

from __future__ import annotations

import math
from collections.abc import Sequence

from chemage.ageing.fitting import span_text
from chemage.foundation.text import plus_minus, power_text
from chemage.results.comparison import Entry
from chemage.results.ensemble_figure import ages, draw_curve, draw_parts
from chemage.results.ensemble_text import errors, interval_text, over, rows
from chemage.results.figures import blank
from chemage.results.page_parts import Part, Picture, Section, Table, markup, scene_part, svg
from chemage.studies.ensembles.ensemble import Ensemble

#: inches; small, so that the text is legible on a phone
_SIZE = (4.9, 3.6)
#: seeds of samples that are shown
_SEEDS = 10


def ensemble_section(one: Entry, key: str, name: str) -> tuple[Section, list[str]]:
    """Make the section of an ensemble, and list its references."""
    made = one.ensemble
    assert made is not None
    notes = [f"approximate: {one.approximate}"] if one.approximate else []
    curve, parts_of_error = _pictures(made, key)
    numbers = main_estimates(one, (1.0, 1e3))
    parts = [Part(numbers=numbers, figures=curve, notes=[*notes, *made.notes])]
    table = Table("", ["quantity", "value"], rows(made), wide=True)
    parts.append(Part("Parts of the error", tables=_error_tables(made), figures=parts_of_error))
    parts.append(Part("Key numbers", tables=[table]))
    if made.hold_times.size:
        parts.append(Part("Friction against hold time", tables=[_curves_table(made)]))
    if made.measures:
        parts.append(Part("Contact", tables=[_contact_table(made)]))
    if one.scene:
        parts.append(scene_part(one.scene, ", but for a budget of time, which ends where the time does"))
    parts.append(Part("Provenance", tables=[_provenance(one, made)]))
    return Section(key, name, parts=parts), list(made.provenance.get("cite", []))


def main_estimates(one: Entry, times: Sequence[float]) -> list[tuple[str, str]]:
    """The numbers that a reader looks for first: (value with its interval, what it is)."""
    made = one.ensemble
    assert made is not None
    sure, found = f"95 % interval, mean over {over(made)}", []
    names = made.quantities.names
    curve = next((name for name in ("friction_coefficient_drop", "friction_drop") if name in names), None)
    if curve is not None:
        known = [time for time in times if made.hold_times[0] <= time <= made.hold_times[-1]]
        time = known[-1] if known else one.last()
        if (drop := one.estimate(curve, time)) is not None:
            symbol, unit = ("Δμ", "") if curve == "friction_coefficient_drop" else ("ΔF", "nN")
            shown = plus_minus(drop.value, drop.half_width, unit)
            found.append((shown, f"{symbol} at {power_text(time)} s, {sure}"))
    if "beta" in names:
        beta = made.estimate("beta")
        shown = plus_minus(beta.value, beta.half_width)
        found.append((shown, f"β per decade, line fitted {span_text(made.quantities.span)}, {sure}"))
    area = one.estimate("area_fraction")
    if area is not None and math.isfinite(area.value):
        shown = plus_minus(area.value, area.half_width) if math.isfinite(area.half_width) else f"{area.value:.3g}"
        found.append((shown, "area fraction A/A₀"))
    if curve is None:
        for name in ("mean_contact_pressure", "patches"):
            if (measure := one.estimate(name)) is not None and math.isfinite(measure.value):
                unit = "GPa" if name == "mean_contact_pressure" else ""
                found.append((plus_minus(measure.value, measure.half_width, unit), name.replace("_", " ")))
    return found


def _pictures(made: Ensemble, key: str) -> tuple[list[Picture], list[Picture]]:
    """The curve, where there is one, and the parts of the error."""
    curves = []
    if ages(made):
        figure, axes = blank(*_SIZE)
        draw_curve(axes, made, size=7)
        alt = (
            f"Friction against hold time, mean of {over(made)}: from {made.friction_drop[0]:.3g} nN at "
            f"{made.hold_times[0]:g} s to {made.friction_drop[-1]:.3g} nN at {made.hold_times[-1]:g} s."
        )
        what = "surfaces" if made.random else "replicas on the one surface"
        caption = f"Mean over {what} with its 95 % interval (band), and single {what.split()[0]} (grey)."
        curves.append(Picture(markup(svg(figure, alt, f"{key}-ensemble")), caption))
    figure, axes = blank(_SIZE[0], 2.6)
    draw_parts(axes, made, 7.5)
    name = made.quantities.names[0]
    sizes = "; ".join(f"{part} {size}" for part, size, _ in errors(made.estimate(name)))
    caption = f"Standard errors that make up the interval of {'β' if name == 'beta' else name.replace('_', ' ')}."
    return curves, [Picture(markup(svg(figure, f"Parts of the error: {sizes}.", f"{key}-errors")), caption)]


def _error_tables(made: Ensemble) -> list[Table]:
    """The parts of the error of β, of the last friction, and of what was asked for."""
    names = made.quantities.names
    shown = [name for name in ("beta", "friction_coefficient_drop", "area_fraction") if name in names]
    asked = [name.partition("@")[0].strip() for name in made.goals]
    found = []
    for name in dict.fromkeys([*shown, *asked]):
        words = "β" if name == "beta" else name.replace("_", " ")
        for part, size, how in errors(made.estimate(name)):
            at = f" at {made.hold_times[-1]:g} s" if name.endswith("_drop") else ""
            found.append((words + at, size, part, how))
    return [Table("Standard errors by name", ["of", "size", "due to", "how it is known"], found, wide=True)]


def _curves_table(made: Ensemble) -> Table:
    names = [name for name in ("friction_drop", "friction_coefficient_drop") if name in made.quantities.names]
    heading = {"friction_drop": "ΔF (nN)", "friction_coefficient_drop": "Δμ"}
    found = []
    for time in made.hold_times.tolist():
        cells = [interval_text(made.estimate(name, time)) for name in names]
        found.append((f"{time:.6g}", *cells))
    columns = ["hold time (s)", *(heading[name] for name in names)]
    return Table(f"Means over {over(made)} with 95 % intervals (Student's t)", columns, found, wide=True)


def _contact_table(made: Ensemble) -> Table:
    found = [(name.replace("_", " "), interval_text(made.estimate(name))) for name in made.measures]
    title = "Means with 95 % intervals, in internal units (nm, nN, GPa)"
    return Table(title, ["measure", "mean"], [row for row in found if row[1] != "-"], wide=True)


def _provenance(one: Entry, made: Ensemble) -> Table:
    found: list[tuple[str, str]] = [("file", one.source)]
    for number, level in enumerate(made.levels):
        first = "samples" if number == 0 else "control" if level.get("control") else "corrections"
        found.append((first, f"{level['samples']} of {level['words']}"))
        pairs = level.get("seeds", [])[:_SEEDS]
        shown = ", ".join(f"{surface} {hold}" for surface, hold in pairs)
        more = ", …" if level["samples"] > len(pairs) else ""
        found.append((f"seeds of {first} (surface, disorder and kinetics)", shown + more))
    found += [(f"version of {name}", str(version)) for name, version in made.provenance.get("versions", {}).items()]
    found += [(f"plugin {name}", source) for name, source in made.plugins.items()]
    found.append(("content hash", made.digest()))
    return Table("", ["item", "value"], found)
