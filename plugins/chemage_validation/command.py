"""The command ``chemage validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chemage.plugin import options, output, progress


def validate(
    rows: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ROW]...",
            help="names of published numbers; default: all, which takes minutes",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="draw them: .png, .pdf or .svg"
        ),
    ] = None,
    as_json: options.JsonOpt = False,
    as_csv: options.CsvOpt = False,
    force: options.ForceOpt = False,
) -> None:
    """Predict published numbers with one set of parameters.

    Prints each number with its source, the prediction with its interval, from which numbers the set was made, how wrong
    a model must be to be refused, and a verdict by rule.
    """
    from chemage.plugin import preflight
    from chemage_validation.display import ValidationDisplay
    from chemage_validation.table import validate as predict

    if out is not None:
        options.check_ending(out, options.FIGURES, "a figure")
        preflight(out, force=force)
    with progress.progress_bars({"predicting": "rows"}) as report:
        found = predict(
            rows or (), lambda done, count: report("predicting", done, count)
        )
        report("predicting", len(found.rows), len(found.rows))
    result = ValidationDisplay(found)
    if out is not None:
        output.save_picture(result, out, force=force)
    if as_csv:
        output.say_csv(result)
        return
    output.answer(result, as_json, (), **({"figures": out} if out else {}))
