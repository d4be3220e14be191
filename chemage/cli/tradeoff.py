"""The command ``chemage tradeoff``: speed against accuracy, measured on a scene."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chemage.cli import output, terminal
from chemage.cli.files import save_picture
from chemage.cli.options import FIGURES, ForceOpt, JsonOpt, SceneArg, SetOpt, changed_fields, check_ending, user_error
from chemage.foundation.progress import progress_bars

if TYPE_CHECKING:
    from chemage.studies.trade.tradeoff import Tradeoff

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
    details: Annotated[
        bool,
        typer.Option(help="list what each single setting does to the contact and to β on the surface of the scene"),
    ] = False,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Measure speed against accuracy on a scene.

    Settings, and combinations of those that pay, are computed on several surfaces and compared with a reference. The
    result is a table of CPU times and errors, and the cheapest settings within 10, 3, 1 and 0.3 % for each observable.
    """
    from chemage.foundation.files import preflight
    from chemage.foundation.result import result_of
    from chemage.scene.scene_files import load_scene
    from chemage.studies.trade.settings import planned
    from chemage.studies.trade.tradeoff import tradeoff as measure

    files = out or []
    for file in files:
        check_ending(file, (".json", *FIGURES), "a map or its figure")
        preflight(file, force=force)
    if len(set(files)) < len(files):
        raise user_error("--out: one file is named twice")
    loaded = load_scene(scene, changed_fields(changes))
    if not output.quiet():
        print(f"{loaded.name}: {planned(loaded)}", file=sys.stderr)
    done = 0
    with progress_bars({_STAGE: "steps"}, alive=True) as report:

        def shown(what: str) -> None:
            nonlocal done
            done += 1
            report(_STAGE, done, 0, what)

        measured = measure(loaded, rounds=rounds, report=shown)
        report(_STAGE, 1, 1)
    assert measured.map is not None
    result = result_of(measured.map)
    for file in files:
        if file.suffix.lower() == ".json":
            measured.map.write(file, force=force)
            continue
        save_picture(result, file, force=force)
    if as_json:
        print(json.dumps(measured.todict()))
        return
    if details:
        _show_rows(measured)
    terminal.show_result(result)
    for note in measured.notes:
        terminal.remark(f"note: {note}")
    for file in files:
        terminal.say(f"{'map' if file.suffix.lower() == '.json' else 'figure':8} {file}")


def _show_rows(trade: Tradeoff) -> None:
    table = terminal.table(
        f"Single settings on the surface of {trade.scene} (* as in the scene; ± is half the width of a 95 % interval)",
        (
            *("option", "value", "CPU (s)", "wall (s)", "A/A0", "corrected", "area error"),
            *("p error", "estimate", "beta", "difference", ""),
        ),
    )
    for row in trade.rows:
        table.add_row(
            row.option,
            row.setting + (" *" if row.own else ""),
            _number(row.cpu_seconds),
            _number(row.wall_seconds),
            _number(row.area_fraction, 5),
            _number(row.corrected_fraction, 5),
            _with_error(row.area_error, row.area_error_half_width, 2),
            _number(row.pressure_error, 2),
            _number(row.pressure_estimate, 2),
            _with_error(row.beta, row.beta_half_width),
            _with_error(row.beta_difference, row.beta_difference_half_width),
            row.remark,
        )
    terminal.show(table, width=200)


def _number(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}g}" if value == value else ""


def _with_error(value: float, error: float, digits: int = 4) -> str:
    from chemage.foundation.text import plus_minus

    return plus_minus(value, error) if error > 0 else _number(value, digits)
