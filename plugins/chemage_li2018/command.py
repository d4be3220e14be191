"""The commands ``chemage reproduce`` and ``chemage study``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.plugin import options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from chemage import SweepResult
    from chemage_li2018.reproduction_page import Reproduction
    from chemage_li2018.sweeps import StudyPoint


def reproduce(
    targets: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="TARGETS",
            help="what to compute: fig1 … fig6, table1, kappa; maps, areas, barriers (supplement); estimates (numbers "
            "in the text); calibration (of the barriers); interaction, temperature, tips; or all, the default. "
            "Since 0.2, fig1 is the surface, fig2 friction against time, fig4 pressures and barriers, and fig5 has "
            "ΔV = 0.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="folder of the sweeps, the figures and the page",
        ),
    ] = Path("reproduction"),
    seeds: Annotated[
        int,
        typer.Option(
            min=1,
            max=32,
            metavar="N",
            help="number of surfaces per row, 1 to 32; the paper has one, its page here 8",
        ),
    ] = 5,
    executor: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="where points are computed: serial, processes or dask[:ADDRESS]",
        ),
    ] = "processes",
    workers: options.WorkersOpt = None,
    pixels: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="pixels per side, for coarser surfaces; default: 2500"
        ),
    ] = None,
) -> None:
    """Compute the figures and tables of the paper.

    The results are compared with the published numbers. Completed points are skipped, so that the same command resumes
    an interrupted one.
    """
    from chemage_li2018 import sweeps

    names = sweeps.chosen(targets or [])
    surfaces, side = sweeps.SURFACE_SEEDS[:seeds], pixels or 2500
    words = "-".join(names) if len(names) < len(sweeps.TARGETS) else "all"
    folder = out / f"{words}-{seeds}-{side}"
    where = {"executor": executor, "workers": workers}
    results = _swept(sweeps.scenes(names, surfaces, pixels), folder, **where)
    points = [sweeps.StudyPoint.of(point) for result in results for point in result]
    compared = write(points, names, folder, seeds=list(surfaces), pixels=side)
    for line in compared.summary():
        typer.echo(line)
    typer.echo(f"\n{folder / 'reproduction.md'}")


def study(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            autocompletion=lambda: ["density"],
            help="name of the study: density",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="folder of the page, its figures and tables; default: study-NAME",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="compute only a few contacts, as a test")
    ] = False,
    force: options.ForceOpt = False,
) -> None:
    """Run an installed study.

    Writes a page with its figures, and tables as CSV.
    """
    from chemage import InputError
    from chemage.plugin import nearest
    from chemage_li2018 import density_page

    if name != "density":
        raise InputError(
            f"no study {name!r}{nearest(name, ['density'])}; there is: density"
        )
    target = out or Path(f"study-{name}")
    for path in density_page.write_study(target, quick=quick, force=force):
        typer.echo(path)


def _swept(scenes: Mapping[str, Any], folder: Path, **where: Any) -> list[SweepResult]:
    """Compute the sweeps, by base, each in a folder, and end the command if a point failed."""
    from chemage import sweep

    results = [
        sweep(data, folder / f"sweep-{base}", progress=True, **where)
        for base, data in scenes.items()
    ]
    failed = [point for result in results for point in result.failed]
    for point in failed:
        typer.echo(f"failed: {point!r}: {point.error}", err=True)
    if failed:
        again = "rerun the same command to try them again"
        typer.echo(f"{len(failed)} points failed; {again}", err=True)
        raise typer.Exit(1)
    return results


def write(
    points: Sequence[StudyPoint], names: list[str], folder: Path, **about: Any
) -> Reproduction:
    """Write figures and page of completed points into ``folder``, and return the comparisons.

    ``about`` are the seeds of the surfaces and the pixels.
    """
    from chemage.plugin import figures, versions, write_file
    from chemage_li2018 import reproduction_page
    from chemage_li2018.figures import NAMES, drawn
    from chemage_li2018.sweeps import save_points, studies_of

    stored = folder / "reproduction.npz"
    save_points(stored, points, {"targets": names, **about, "versions": versions()})
    compared, text = reproduction_page.of_points(stored)
    write_file(folder / "reproduction.md", text, force=True)
    computed = studies_of(points, names)
    made = {name: drawn(name, computed) for name in names if name in NAMES}
    figures.save_figures(made, folder / reproduction_page.FIGURES, force=True)
    return compared
