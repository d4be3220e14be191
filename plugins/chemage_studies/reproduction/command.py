"""``chemage reproduce``: run the sweep that the targets need, draw, compare, write the page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from chemage import SweepResult
    from chemage_studies.reproduction import checks


def reproduce(
    targets: Annotated[
        list[str] | None, typer.Argument(help="fig1 … fig6, table1, kappa, or all (the default)", show_default=False)
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the sweep, the figures and the page")] = Path(
        "reproduction"
    ),
    seeds: Annotated[int, typer.Option(min=1, max=32, help="surfaces for every row; the paper has one")] = 1,
    executor: Annotated[str, typer.Option(help="serial, processes, or dask[:address]")] = "processes",
    workers: Annotated[int | None, typer.Option(min=1, help="default one a processor")] = None,
    pixels: Annotated[int | None, typer.Option(help="coarser surfaces for a quick look; the paper's are 2500")] = None,
) -> None:
    """Compute the paper's figures and tables anew and lay them beside the published numbers.

    Interrupted, the same command goes on where it stopped.
    """
    from chemage import sweep
    from chemage_studies.reproduction import checks, pages, studies

    names = studies.chosen(targets or [])
    surfaces = studies.SURFACE_SEEDS[:seeds]
    folder = out / f"{'-'.join(names) if len(names) < len(studies.TARGETS) else 'all'}-{seeds}-{pixels or 2500}"
    result = sweep(
        studies.scene(names, surfaces, pixels), folder / "sweep", executor=executor, workers=workers, progress=True
    )
    if failed := result.failed:
        for point in failed:
            typer.echo(f"failed: {point!r}: {point.error}", err=True)
        typer.echo(f"{len(failed)} of {len(result)} points failed; the same command tries them again", err=True)
        raise typer.Exit(1)
    lines, claims = write(result, names, folder, seeds=surfaces, pixels=pixels or 2500)
    width = max(len(line.quantity) for line in lines) if lines else 0
    for line in lines:
        typer.echo(
            f"{line.target:7} {line.quantity:{width}}  paper {line.paper:<8g} ours {pages.shown(line.ours):18} "
            f"{line.difference:+7.1%}  {checks.WORDS[line.within]}"
        )
    for claim in claims:
        typer.echo(
            f"{claim.target:7} {'holds' if claim.holds else 'DOES NOT HOLD'}: {claim.statement}\n{'':8}{claim.found}"
        )
    typer.echo(f"\n{folder / 'reproduction.md'}")


def write(
    result: SweepResult, names: list[str], folder: Path, *, seeds: tuple[int, ...], pixels: int
) -> tuple[list[checks.Line], list[checks.Claim]]:
    """Figures and page of a finished sweep into ``folder``; what an earlier call drew there is drawn anew."""
    from chemage import fresh_file, versions
    from chemage.reports.figures import save_figures
    from chemage_studies.reproduction import checks, figures, pages
    from chemage_studies.reproduction.points import Point, studies_of

    found = studies_of((Point.of(point) for point in result), names)
    lines, claims = checks.lines(found, names), checks.claims(found, names)
    save_figures({name: figures.DRAW[name](found) for name in names}, folder / "figures", force=True)
    text = pages.page(lines, claims, names, seeds=seeds, pixels=pixels, figures="figures", versions=versions())
    with fresh_file(folder / "reproduction.md", force=True) as part:
        part.write_text(text, encoding="utf-8")
    return lines, claims
