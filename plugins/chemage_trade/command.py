"""The command ``chemage tradeoff``."""

from __future__ import annotations

import sys
from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from chemage.plugin import options, output, progress

_STAGE = "measuring"


def tradeoff(
    scene: options.SceneArg,
    changes: options.SetOpt = None,
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
    folder: options.FolderOpt = None,
    executor: options.ExecutorOpt = None,
    workers: options.WorkersOpt = None,
    patience: options.PatienceOpt = None,
    as_json: options.JsonOpt = False,
    force: options.ForceOpt = False,
) -> None:
    """Measure speed against accuracy on a scene.

    Settings, and combinations of those that pay, are computed on several surfaces and compared with a reference. The
    result is a table of CPU times and errors, and the cheapest settings within 10, 3, 1 and 0.3 % for each observable.
    """
    from chemage import load_scene
    from chemage.plugin import preflight
    from chemage_trade.display import TradeDisplay
    from chemage_trade.mapping import planned
    from chemage_trade.mapping import tradeoff as measure

    files = out or []
    for file in files:
        options.check_ending(
            file, (".json", *options.FIGURES), "a map or its figure"
        )
        preflight(file, force=force)
    if len(set(files)) < len(files):
        raise options.user_error("--out: one file is named twice")
    loaded = load_scene(scene, options.changed_fields(changes))
    if not output.quiet():
        print(f"{loaded.name}: {planned(loaded)}", file=sys.stderr)
    steps = count(1)
    with progress.progress_bars({_STAGE: "steps"}) as report:
        measured = measure(
            loaded,
            rounds=rounds,
            report=lambda what: report(_STAGE, next(steps), 0, what),
            folder=folder,
            executor=executor,
            workers=workers,
            patience=patience,
        )
        report(_STAGE, 1, 1)
    result = TradeDisplay(measured)
    for file in files:
        if file.suffix.lower() == ".json":
            measured.write(file, force=force)
            continue
        output.save_picture(result, file, force=force)
    if as_json:
        output.say_json(measured.summary())
        return
    output.show_result(result)
    for file in files:
        output.say(
            f"{'map' if file.suffix.lower() == '.json' else 'figure':8} {file}"
        )
