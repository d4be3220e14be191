"""The command ``chemage validate``."""

from __future__ import annotations

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
    out: options.FigureOpt = None,
    as_json: options.JsonOpt = False,
    as_csv: options.CsvOpt = False,
    force: options.ForceOpt = False,
) -> None:
    """Predict published numbers with one set of parameters.

    Prints each number with its source, the prediction with its interval, from which numbers the set was made, how wrong
    a model must be to be refused, and a verdict by rule.
    """
    from chemage_validation.display import ValidationDisplay
    from chemage_validation.table import validate as predict

    output.check_figure(out, force)
    with progress.progress_bars({"predicting": "rows"}) as report:
        found = predict(
            rows or (), lambda done, count: report("predicting", done, count)
        )
        report("predicting", len(found.rows), len(found.rows))
    output.deliver(ValidationDisplay(found), out, as_json, as_csv, force)
