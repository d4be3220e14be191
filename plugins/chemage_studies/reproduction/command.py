"""The command ``chemage reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chemage.cli.options import WorkersOpt

if TYPE_CHECKING:
    from chemage import SweepResult
    from chemage_studies.reproduction import checks


def reproduce(
    targets: Annotated[
        list[str] | None, typer.Argument(help="fig1 … fig6, table1, kappa, or all (the default)", show_default=False)
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder of the sweep, the figures and the page")] = Path(
        "reproduction"
    ),
    seeds: Annotated[int, typer.Option(min=1, max=32, help="number of surfaces; the paper has one")] = 1,
    executor: Annotated[str, typer.Option(help="serial, processes, or dask[:ADDRESS]")] = "processes",
    workers: WorkersOpt = None,
    pixels: Annotated[int | None, typer.Option(help="pixels per side of coarser surfaces; default: 2500")] = None,
) -> None:
    """Compute the figures and tables of the paper.

    The results are compared with the published numbers. Completed points are skipped; rerun the same command to resume.
    """
    from chemage import sweep
    from chemage_studies.reproduction import checks, studies

    names = studies.chosen(targets or [])
    surfaces = studies.SURFACE_SEEDS[:seeds]
    folder = out / f"{'-'.join(names) if len(names) < len(studies.TARGETS) else 'all'}-{seeds}-{pixels or 2500}"
    result = sweep(
        studies.scene(names, surfaces, pixels),
        folder / "sweep",
        executor=executor,
        workers=workers,
        progress=True,
    )
    if failed := result.failed:
        for point in failed:
            typer.echo(f"failed: {point!r}: {point.error}", err=True)
        typer.echo(f"{len(failed)} of {len(result)} points failed; rerun the same command to try them again", err=True)
        raise typer.Exit(1)
    lines, claims = write(result, names, folder, seeds=surfaces, pixels=pixels or 2500)
    width = max(len(line.quantity) for line in lines) if lines else 0
    for line in lines:
        typer.echo(
            f"{line.target:7} {line.quantity:{width}}  paper {line.paper:<8g} ours {line.ours!s:18} "
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
    """Write figures and page of a completed sweep into ``folder``, and return the comparison with the paper."""
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
