"""The command ``chemage tradeoff``: speed against accuracy, measured on a scene."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chemage.cli import output, terminal
from chemage.cli.options import FIGURES, ForceOpt, JsonOpt, SceneArg, SetOpt, changed_fields, check_ending, user_error
from chemage.foundation.progress import progress_bars

if TYPE_CHECKING:
    from chemage.studies.trade.trade_map import Point, TradeMap

#: width of the tables, and of their first column at least
WIDTH, _FIRST = 80, 22
#: observable -> heading of its column
_SHORT = {
    "corrected_area": "area",
    "pressure_distribution": "p distr.",
    "patches": "patches",
    "perimeter_to_area": "C/A",
}
_STAGE = "measuring"


def tradeoff(
    scene: SceneArg,
    changes: SetOpt = None,
    out: Annotated[
        list[Path] | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="write the map into this file (.json), for `chemage run --map`, or draw it (.png, .pdf or .svg); may "
            "be repeated; default: neither",
        ),
    ] = None,
    rounds: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="how often everything is computed, each time on another surface where the surface is random; default: "
            "3 to 6, by the cost of the scene",
        ),
    ] = None,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Measure speed against accuracy on a scene.

    Settings, and combinations of those that pay, are computed on several surfaces and compared with a reference. The
    result is a table of CPU times and errors, and the cheapest settings within 10, 3, 1 and 0.3 % for each observable.
    """
    from chemage.foundation.files import fresh_file, preflight
    from chemage.results import tradeoff_figure
    from chemage.scene.files import load_scene
    from chemage.studies.trade.mapping import planned
    from chemage.studies.trade.mapping import tradeoff as measure

    files = out or []
    for file in files:
        check_ending(file, (".json", *FIGURES), "a map or its figure")
        preflight(file, force=force)
    if len(set(files)) < len(files):
        raise user_error("--out: one file is named twice")
    one = load_scene(scene, changed_fields(changes))
    if not output.quiet():
        print(f"{one.name}: {planned(one)}", file=sys.stderr)
    done = 0
    with progress_bars({_STAGE: "steps"}) as report:

        def shown(what: str) -> None:
            nonlocal done
            done += 1
            report(_STAGE, done, 0, what)

        found = measure(one, rounds=rounds, report=shown)
        report(_STAGE, 1, 1)
    for file in files:
        if file.suffix.lower() == ".json":
            found.write(file, force=force)
            continue
        with fresh_file(file, force=force) as part:
            tradeoff_figure.figure(found).savefig(part, format=file.suffix.removeprefix(".").lower())
    if as_json:
        print(json.dumps(found.summary()))
        return
    show(found)
    for file in files:
        terminal.say(f"{'map' if file.suffix.lower() == '.json' else 'figure':8} {file}")


def show(made: TradeMap) -> None:
    """Print the tables of a map, the cheapest settings and the notes."""
    from chemage.foundation.text import percent
    from chemage.studies.trade.trade_map import words

    where = f"{made.rounds} surfaces" if made.random else f"{made.rounds} repetitions on the one surface"
    terminal.remark(
        f"Speed against accuracy: {made.name}, {where}, CPU times on one thread.\n"
        "Errors: mean difference from the reference in %, ± half the width of its 95 %\n"
        "interval; (in brackets): not resolved, smaller than that; 0: below 0.005.\n"
        "* on the Pareto front: nothing else is both faster and more accurate."
    )
    for title, columns in _tables(made):
        _show_points(made, title, columns)
    for name, lines in made.sentences().items():
        terminal.remark(f"The cheapest settings for the {words(name)} of one surface:")
        for line in lines:
            terminal.remark(f"  {line}")
    if scatter := made.surface_scatter.get("beta"):
        terminal.remark(
            f"β scatters by about {percent(scatter)} between surfaces; `chemage run --accuracy` averages over them."
        )
    for note in made.notes:
        terminal.remark(f"note: {note}")


def _tables(made: TradeMap) -> list[tuple[str, list[str]]]:
    """Titles and columns: of the ageing four observables at most, and of the contact."""
    from chemage.studies.trade.trade_map import of_ageing

    ageing = [name for name in made.observables if of_ageing(name)]
    drops = [name for name in ageing if name != "beta"]
    shown = [name for name in ageing if name == "beta"] + drops[-1:]
    if len(drops) > 1:
        shown.insert(len(shown) - 1, drops[len(drops) // 2])
    contact = [name for name in made.observables if not of_ageing(name)]
    tables = [("Ageing", shown)] if shown else []
    return [*tables, ("Contact", contact)]


def _show_points(made: TradeMap, title: str, columns: list[str]) -> None:
    from chemage.studies.trade.trade_map import words

    names = [_SHORT.get(name, words(name)) for name in columns]
    table = terminal.table(title, ("settings", "CPU (s)", *names))
    table.padding = (0, 0)
    table.columns[0].min_width = _FIRST
    points = sorted(made.of(columns[0]), key=lambda one: one.seconds(columns[0]))
    short = _short_knobs(made)
    for one in points:
        if len(one.choices) > 1 and not set(columns) & set(one.front):
            continue  # a combination that is beaten by another
        settings = "\n".join(f"{short[knob]} {label}".strip() for knob, label in one.choices.items())
        seconds = _plus_minus(one.seconds(columns[0]), one.spread(columns[0]))
        table.add_row(settings or "as in the scene", seconds, *(_deviation(one, name) for name in columns))
    terminal.show(table, width=WIDTH)


def _short_knobs(made: TradeMap) -> dict[str, str]:
    """What is chosen -> the last part of its name where this is the only one with it, else the whole name."""
    from chemage.studies.trade.choices import AGEING, GRID

    knobs = {knob for one in made.points for knob in one.choices}
    last = [knob.rpartition(".")[2] for knob in knobs]
    short = {knob: part if last.count(part) == 1 else knob for knob, part in zip(knobs, last, strict=True)}
    return {**short, GRID: "grid", AGEING: ""}


def _plus_minus(value: float, error: float) -> str:
    from chemage.foundation.text import plus_minus

    text = plus_minus(value, error).replace(" ± ", "±")
    return text.removeprefix("-") if text.startswith("-0") and not text.partition("±")[0].strip("-0.") else text


def _deviation(one: Point, name: str) -> str:
    found = one.deviation(name)
    mark = "*" if name in one.front else ""
    value, half = 100 * found.value, 100 * found.half_width
    if math.isnan(value):
        return ""
    if math.isnan(half):
        return f"{value:.2g}±?{mark}"
    if half == 0 or abs(value) + half < 0.005:
        return f"{value:.2g}{mark}" if abs(value) + half > 0.005 else f"0{mark}"
    text = _plus_minus(value, half)
    return (text if found.resolved else f"({text})") + mark
