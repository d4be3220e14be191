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

STUDIES = ("density",)
#: scenes in place of former studies
_SCENES = {"tips": "silica-tips and silica-patches", "challenge": "contact-challenge-loads, -pixels and -sizes"}


def reproduce(
    targets: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="TARGETS",
            help="what to compute: fig1 … fig6, table1, kappa; maps, areas, barriers (supplement); estimates (numbers "
            "in the text); calibration (of the barriers); interaction, temperature, tips; or all, the default. "
            "patches, what changes the number of patches, is not part of all. Since 0.2, fig1 is the surface, fig2 "
            "friction against time, fig4 pressures and barriers, and fig5 has ΔV = 0.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="folder of the sweeps, the figures and the page")
    ] = Path("reproduction"),
    seeds: Annotated[
        int, typer.Option(min=1, max=32, metavar="N", help="number of surfaces per row, 1 to 32; the paper has one")
    ] = 8,
    executor: Annotated[
        str, typer.Option(metavar="NAME", help="where points are computed: serial, processes or dask[:ADDRESS]")
    ] = "processes",
    workers: options.WorkersOpt = None,
    pixels: Annotated[
        int | None, typer.Option(metavar="N", help="pixels per side, for coarser surfaces; default: 2500")
    ] = None,
) -> None:
    """Compute the figures and tables of the paper.

    The results are compared with the published numbers. Completed points are skipped, so that the same command resumes
    an interrupted one.
    """
    from chemage_li2018 import sweeps

    if targets == ["patches"]:
        return _patches(out / f"patches-{max(2, seeds)}-{pixels or 2500}", seeds, pixels, executor, workers)
    names = sweeps.chosen(targets or [])
    surfaces = sweeps.SURFACE_SEEDS[:seeds]
    folder = out / f"{'-'.join(names) if len(names) < len(sweeps.TARGETS) else 'all'}-{seeds}-{pixels or 2500}"
    scenes = {f"sweep-{base}": data for base, data in sweeps.scenes(names, surfaces, pixels).items()}
    results = _swept(scenes, folder, executor, workers)
    _show(write(results, names, folder, seeds=surfaces, pixels=pixels or 2500))
    typer.echo(f"\n{folder / 'reproduction.md'}")


def study(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            autocompletion=lambda incomplete: [study for study in STUDIES if study.startswith(incomplete)],
            help="name of the study: density",
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
    from chemage_li2018 import density_page

    if name in _SCENES:
        raise InputError.of("study", name, "is computed by scenes", f"use `chemage run` with {_SCENES[name]}")
    if name not in STUDIES:
        raise InputError(f"no study {name!r}{nearest(name, STUDIES)}; there are: {', '.join(STUDIES)}")
    for path in density_page.write_study(out or Path(f"study-{name}"), quick=quick, force=force):
        typer.echo(path)


def _swept(
    scenes: Mapping[str, dict[str, Any]], folder: Path, executor: str, workers: int | None
) -> dict[str, SweepResult]:
    """Compute the sweeps, each in a folder of its name, and end the command if a point failed."""
    from chemage import sweep

    results = {
        name: sweep(data, folder / name, executor=executor, workers=workers, progress=True)
        for name, data in scenes.items()
    }
    failed = [point for result in results.values() for point in result.failed]
    if failed:
        for point in failed:
            typer.echo(f"failed: {point!r}: {point.error}", err=True)
        count = sum(len(result) for result in results.values())
        typer.echo(f"{len(failed)} of {count} points failed; rerun the same command to try them again", err=True)
        raise typer.Exit(1)
    return results


def _patches(folder: Path, count: int, pixels: int | None, executor: str, workers: int | None) -> None:
    from chemage.plugin import write_file
    from chemage_li2018 import patches

    seeds = patches.seeds_of(count)
    scenes = {
        name.replace(" ", "-").replace("%", "percent"): (name, data)
        for name, data in patches.scenes(seeds, pixels).items()
    }
    swept = _swept({folder_name: data for folder_name, (_, data) in scenes.items()}, folder, executor, workers)
    results = {scenes[folder_name][0]: result for folder_name, result in swept.items()}
    counted = patches.study(results, seeds, pixels, lambda text: typer.echo(text, err=True))
    write_file(folder / "patches.md", patches.page(counted, pixels or 2500), force=True)
    typer.echo(folder / "patches.md")


def _show(results: Reproduction) -> None:
    width = max((len(line.quantity) for line in results.lines), default=0)
    for line in results.lines:
        typer.echo(
            f"{line.target:7} {line.quantity:{width}}  paper {line.paper.text:<8} ours {line.ours!s:18} "
            f"{line.shown:>7}  {line.word}"
        )
    for claim in results.claims:
        typer.echo(f"{claim.target:7} {claim.word}: {claim.statement}\n{'':8}{claim.ours}")
    for estimate in results.estimates:
        typer.echo(f"text    {estimate.word}: {estimate.statement}\n{'':8}{estimate.ours}")


def write(
    results: Mapping[str, SweepResult], names: list[str], folder: Path, *, seeds: Sequence[int], pixels: int
) -> Reproduction:
    """Write figures and page of completed sweeps, by base, into ``folder``, and return the comparisons."""

    from chemage.plugin import figures, versions, write_file
    from chemage_li2018 import reproduction_page
    from chemage_li2018.figures import NAMES, drawn
    from chemage_li2018.sweeps import StudyPoint, save_points, studies_of

    points = [StudyPoint.of(point) for result in results.values() for point in result]
    about = {"targets": names, "seeds": list(seeds), "pixels": pixels, "versions": versions()}
    save_points(folder / "reproduction.npz", points, about)
    compared, text = reproduction_page.of_points(folder / "reproduction.npz")
    write_file(folder / "reproduction.md", text, force=True)
    computed = studies_of(points, names)
    made = {name: drawn(name, computed) for name in names if name in NAMES}
    figures.save_figures(made, folder / reproduction_page.FIGURES, force=True)
    return compared
