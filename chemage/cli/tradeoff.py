"""The command ``chemage tradeoff``: speed against accuracy, measured on a scene."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from chemage.cli import output, terminal
from chemage.cli.files import save_picture
from chemage.cli.options import FIGURES, ForceOpt, JsonOpt, SceneArg, SetOpt, changed_fields, check_ending, user_error
from chemage.foundation.progress import progress_bars

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
    from chemage.foundation.files import preflight
    from chemage.foundation.result import result_of
    from chemage.scene.files import load_scene
    from chemage.studies.trade.mapping import planned
    from chemage.studies.trade.mapping import tradeoff as measure

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
    with progress_bars({_STAGE: "steps"}) as report:

        def shown(what: str) -> None:
            nonlocal done
            done += 1
            report(_STAGE, done, 0, what)

        measured = measure(loaded, rounds=rounds, report=shown)
        report(_STAGE, 1, 1)
    result = result_of(measured)
    for file in files:
        if file.suffix.lower() == ".json":
            measured.write(file, force=force)
            continue
        save_picture(result, file, force=force)
    if as_json:
        print(json.dumps(measured.summary()))
        return
    terminal.show_result(result)
    for file in files:
        terminal.say(f"{'map' if file.suffix.lower() == '.json' else 'figure':8} {file}")
