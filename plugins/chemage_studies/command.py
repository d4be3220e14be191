"""The command ``chemage study``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chemage.plugin import options

STUDIES = ("tips", "density")


def study(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            autocompletion=lambda incomplete: [one for one in STUDIES if one.startswith(incomplete)],
            help=f"name of the study: {' or '.join(STUDIES)}",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="folder of the page, its figures and tables; default: study-NAME"
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="compute only a few contacts, as a test")] = False,
    force: options.ForceOpt = False,
) -> None:
    """Run an installed study.

    Writes a page with its figures, and tables as CSV.
    """
    from chemage import InputError
    from chemage.plugin import nearest

    if name not in STUDIES:
        raise InputError(f"no study {name!r}{nearest(name, STUDIES)}; there are: {', '.join(STUDIES)}")
    if name == "tips":
        from chemage_studies.tips.command import write
    else:
        from chemage_studies.density.command import write
    for path in write(out or Path(f"study-{name}"), quick=quick, force=force):
        typer.echo(path)
