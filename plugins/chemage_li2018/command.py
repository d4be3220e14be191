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

STUDIES = ("density",)
#: scenes in place of former studies
_SCENES = {
    "tips": "silica-tips and silica-patches",
    "challenge": "contact-challenge-loads, -pixels and -sizes",
}


def reproduce(
    targets: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="TARGETS",
            help="what to compute: fig1 … fig6, table1, kappa; maps, areas, barriers (supplement); estimates (numbers "
            "in the text); calibration (of the barriers); interaction, temperature, tips; or all, the default. "
            "patches, ways to count them, is not part of all. Since 0.2, fig1 is the surface, fig2 "
            "friction against time, fig4 pressures and barriers, and fig5 has ΔV = 0.",
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
            help="number of surfaces per row, 1 to 32; the paper has one",
        ),
    ] = 8,
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
    from chemage.plugin import write_file
    from chemage_li2018 import patches, sweeps

    alone = targets == ["patches"]
    names = ["table1"] if alone else sweeps.chosen(targets or [])
    # the scatter of patches needs two surfaces
    surfaces = sweeps.SURFACE_SEEDS[: max(seeds, 2) if alone else seeds]
    words = "-".join(names) if len(names) < len(sweeps.TARGETS) else "all"
    folder = out / f"{'patches' if alone else words}-{len(surfaces)}-{pixels or 2500}"
    results = _swept(sweeps.scenes(names, surfaces, pixels), folder, executor, workers)
    points = [sweeps.StudyPoint.of(point) for result in results for point in result]
    if alone:
        counts = patches.counted(sweeps.studies_of(points, names)["table"])
        write_file(
            folder / "patches.md",
            patches.page(counts, surfaces, pixels or 2500),
            force=True,
        )
        typer.echo(folder / "patches.md")
    else:
        for line in write(
            points, names, folder, seeds=surfaces, pixels=pixels or 2500
        ).summary():
            typer.echo(line)
        typer.echo(f"\n{folder / 'reproduction.md'}")


def study(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            autocompletion=lambda incomplete: [
                study for study in STUDIES if study.startswith(incomplete)
            ],
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

    if name in _SCENES:
        raise InputError.of(
            "study",
            name,
            "is computed by scenes",
            f"use `chemage run` with {_SCENES[name]}",
        )
    if name not in STUDIES:
        raise InputError(
            f"no study {name!r}{nearest(name, STUDIES)}; there are: {', '.join(STUDIES)}"
        )
    for path in density_page.write_study(
        out or Path(f"study-{name}"), quick=quick, force=force
    ):
        typer.echo(path)


def _swept(
    scenes: Mapping[str, dict[str, Any]],
    folder: Path,
    executor: str,
    workers: int | None,
) -> list[SweepResult]:
    """Compute the sweeps, by base, each in a folder, and end the command if a point failed."""
    from chemage import sweep

    results = []
    for base, data in scenes.items():
        results.append(
            sweep(
                data,
                folder / f"sweep-{base}",
                executor=executor,
                workers=workers,
                progress=True,
            )
        )
    failed = [point for result in results for point in result.failed]
    for point in failed:
        typer.echo(f"failed: {point!r}: {point.error}", err=True)
    if failed:
        typer.echo(
            f"{len(failed)} points failed; rerun the same command to try them again",
            err=True,
        )
        raise typer.Exit(1)
    return results


def write(
    points: Sequence[StudyPoint],
    names: list[str],
    folder: Path,
    *,
    seeds: Sequence[int],
    pixels: int,
) -> Reproduction:
    """Write figures and page of completed points into ``folder``, and return the comparisons."""
    from chemage.plugin import figures, versions, write_file
    from chemage_li2018 import reproduction_page
    from chemage_li2018.figures import NAMES, drawn
    from chemage_li2018.sweeps import save_points, studies_of

    about = {
        "targets": names,
        "seeds": list(seeds),
        "pixels": pixels,
        "versions": versions(),
    }
    save_points(folder / "reproduction.npz", points, about)
    compared, text = reproduction_page.of_points(folder / "reproduction.npz")
    write_file(folder / "reproduction.md", text, force=True)
    computed = studies_of(points, names)
    made = {name: drawn(name, computed) for name in names if name in NAMES}
    figures.save_figures(made, folder / reproduction_page.FIGURES, force=True)
    return compared
