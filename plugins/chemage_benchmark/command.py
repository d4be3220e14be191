"""The command ``chemage benchmark``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chemage.plugin import nearest, options, output


def benchmark(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME|FILE]",
            help="a problem, or answers to score: a CSV of problem, answer, value and, as far as they are known, error (a "
            "standard error) and unit; default: list the problems",
        ),
    ] = None,
    as_json: options.JsonOpt = False,
    as_csv: options.CsvOpt = False,
) -> None:
    """State problems for any code, or score answers to them.

    With --csv problems are printed as rows to fill in.
    """
    from chemage_benchmark.display import ProblemsDisplay, ScoreDisplay
    from chemage_benchmark.problems import problems, scored

    known = problems()
    if what is None or what in known:
        chosen = [*known.values()] if what is None else [known[what]]
        result = ProblemsDisplay(chosen)
    elif Path(what).suffix or Path(what).exists():
        result = ScoreDisplay(Path(what).stem, scored(Path(what)))
    else:
        raise options.user_error(
            f"{what}: no problem{nearest(what, [*known])}, and no file; `chemage benchmark` lists the problems"
        )
    if as_csv:
        output.say_csv(result)
        return
    output.answer(result, as_json)
