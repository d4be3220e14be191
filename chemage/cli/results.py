"""The commands about results: show, plot, compare, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import terminal
from chemage.cli.options import FileArg, ForceOpt, FormatOpt, JsonOpt, MeasuredOpt, user_error
from chemage.foundation.progress import progress_bars, reported

if TYPE_CHECKING:
    from chemage.ageing.aging import Aging
    from chemage.experiments.run import Run
    from chemage.reports.comparison.comparison import Comparison


def show(file: FileArg, as_json: JsonOpt = False) -> None:
    """Print the content of a result file."""
    from chemage.ageing.aging import Aging
    from chemage.ageing.elasticity import elastic_measures
    from chemage.experiments.run import Run
    from chemage.foundation.approximations import in_words
    from chemage.foundation.text import jsonable
    from chemage.store.results import read

    thing = read(file)
    if isinstance(thing, Run):
        if as_json:
            print(json.dumps(thing.summary()))
        else:
            print_run(thing)
        return
    fields: dict[str, Any] = {
        name: f"array {value.shape} {value.dtype}" if hasattr(value, "shape") else value
        for name, value in thing.todict().items()
    }
    if isinstance(thing, Aging):
        del fields["observables"], fields["outputs"], fields["elasticity"]
        fields |= elastic_measures(thing)
        if as_json:
            fields["observables"] = {name: one.summary() for name, one in thing.measured.items()}
        else:
            fields |= {f"observables.{name}": text for name, text in measured_rows(thing)}
    if as_json:
        print(json.dumps({"object": type(thing).__name__, **jsonable(fields)}, default=str))
        return
    rows = [(name, str(value)) for name, value in fields.items()]
    if approximate := in_words(thing.approximate):
        rows.insert(0, ("approximate", approximate))
    terminal.show_pairs(f"{type(thing).__name__} in {file}", rows)


def plot(
    file: FileArg,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder of the figures; default: FILE-figures")
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(metavar='"X0 X1 Y0 Y1"', help="draw this part of the maps alone, every pixel of it; nm, or units"),
    ] = None,
    fmt: FormatOpt = "png",
    force: ForceOpt = False,
) -> None:
    """Draw the figures of a result file."""
    from chemage.experiments.run import Run
    from chemage.reports import run_figures
    from chemage.store.results import read

    if window is not None:
        _plot_window(file, window, out, fmt, force)
        return
    thing = read(file)
    if not isinstance(thing, Run):
        raise user_error(f"{file} holds one {type(thing).__name__}, not a run; `chemage run` makes files to plot")
    with progress_bars() as report, reported(report, "drawing"):
        pictures = run_figures.save(thing, out or file.with_name(f"{file.stem}-figures"), force=force, suffix=fmt)
    for picture in pictures:
        terminal.say(picture)


def _plot_window(file: Path, window: str, out: Path | None, fmt: str, force: bool) -> None:
    from chemage.reports.figures import save_figures
    from chemage.reports.window_figure import window_figure

    with progress_bars() as report, reported(report, "drawing"):
        made = {"window": window_figure(file, window)}
        pictures = save_figures(made, out or file.with_name(f"{file.stem}-figures"), force=force, suffix=fmt)
    for picture in pictures:
        terminal.say(picture)


def print_run(result: Run) -> None:
    """Print the main numbers of a run."""
    from chemage.ageing.elasticity import elastic_rows
    from chemage.foundation.text import mean_text

    contact, aging, fit = result.contact, result.aging, result.fit()
    (nx, ny), kind = contact.shape, result.scene["surface"]["kind"]
    rows: list[tuple[str, str]] = [
        (
            "surface",
            f"{kind}, {nx} x {ny} pixels of {contact.pixel_size:g} nm, rms slope {contact.rms_slope:.4g}",
        ),
        (
            "contact",
            f"{result.scene['contact']['kind']}, load {contact.load:g} nN, E* {contact.modulus:g} GPa"
            + ("" if contact.converged else "  NOT CONVERGED"),
        ),
        ("area fraction A/A0", f"{contact.area_fraction:.5f}"),
        ("kappa", f"{contact.kappa:.3f}"),
        ("patches", f"{contact.patches}"),
        ("perimeter to area C/A", f"{contact.perimeter_to_area:.4f} /nm"),
        ("mean contact pressure", f"{contact.mean_contact_pressure:.4g} GPa"),
    ]
    if aging is not None:
        last = f"at {aging.hold_times[-1]:g} s"
        rows += [
            ("sites", f"{aging.sites.mean():.0f}, {aging.site_grid}"),
            ("engine", f"{aging.engine}, {aging.replicas} replicas, {aging.events.sum()} events"),
            ("rupture law", aging.rupture or ("mean force per bond" if aging.rupture_force is None else "a plugin's")),
            ("random numbers", aging.random_numbers or "not recorded"),
            (f"friction drop {last}", mean_text(aging.friction_drop[:, -1], "nN")),
            (f"friction coefficient drop {last}", mean_text(aging.friction_coefficient_drop[:, -1])),
        ]
        rows += elastic_rows(aging)
        rows += measured_rows(aging)
    if fit is not None:
        rows.append(("beta", f"{fit.beta_text()} per decade, {fit.points} hold times"))
        rows.append(("cut-off time", fit.cutoff_text()))
        scatter = result.scatter
        alone = scatter is not None and scatter.relative == 0
        more = "" if alone else "; scatter between surfaces is not included"
        rows.append(("errors", f"95 %, {fit.intervals_text()}{more}"))
        if scatter is not None and not alone:
            rows.append(("surfaces", scatter.text(fit.relative_stderr)))
    if result.approximate:
        rows.append(("approximate", result.approximate))
    rows += [(f"plugin {name}", source) for name, source in result.plugins.items()]
    if result.timings:
        rows.append(("wall time", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in result.timings.items())))
    terminal.show_pairs(result.scene.get("title") or result.name, rows)
    for note in result.notes:
        terminal.say(f"note: {note}")


def measured_rows(aging: Aging) -> list[tuple[str, str]]:
    """What observables measured: (name, text)."""
    last = f" at {aging.hold_times[-1]:g} s"
    return [(f"{name}{last if one.is_curve else ''}", one.text()) for name, one in aging.measured.items()]


def compare(
    files: Annotated[list[Path], typer.Argument(help="result files (.h5)")],
    as_json: JsonOpt = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="print CSV, one line per result")] = False,
    figures: Annotated[Path | None, typer.Option(help="folder for figures; default: no figures")] = None,
    fmt: FormatOpt = "png",
    measured: MeasuredOpt = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIME",
            help='hold time at which to compare, s or with a unit; repeatable; default: "1 s" and "1e3 s"',
        ),
    ] = None,
    force: ForceOpt = False,
) -> None:
    """Compare results and measurements.

    Results of single asperities and of rough contacts can be compared.
    """
    from chemage.reports import comparison
    from chemage.reports.figures import save_figures

    if as_json and as_csv:
        raise user_error("--json and --csv: choose one")
    made = comparison.compare_files(files, measured=measured or (), times=at or comparison.TIMES)
    pictures: list[Path] = []
    if figures is not None:
        with progress_bars() as report, reported(report, "drawing"):
            pictures = save_figures(comparison.comparison_figures(made), figures, force=force, suffix=fmt)
    if as_json:
        print(json.dumps({**made.todict(), "figures": [str(path) for path in pictures]}))
    elif as_csv:
        terminal.say(made.csv(), end="")
    else:
        _print_comparison(made)
        for picture in pictures:
            terminal.say(f"figure   {picture}")


def report(
    files: Annotated[list[Path], typer.Argument(help="result files (.h5); several results are compared")],
    out: Annotated[Path, typer.Option("--out", "-o", help="the HTML file to write")] = Path("report.html"),
    measured: MeasuredOpt = None,
    force: ForceOpt = False,
) -> None:
    """Write a report of results as HTML.

    The page is self-contained, with tables, figures, scenes, provenance and references.
    """
    from chemage.reports.page import write_report

    with progress_bars() as bars, reported(bars, "report"):
        written = write_report(files, out, measured=measured or (), force=force)
    terminal.say(written)


def _print_comparison(made: Comparison) -> None:
    names, rows = [one.name for one in made.results], made.table()
    for first in range(0, len(names), 4):  # more columns do not fit a screen
        chosen = slice(first, first + 4)
        table = terminal.table("", ("", *names[chosen]))
        for label, texts in rows:
            table.add_row(label, *texts[chosen])
        terminal.show(table)
    terminal.say(made.statement())
    for different in made.chemistry_differences():
        values = ("none" if value is None else f"{value}" for value in different.values)
        terminal.say(f"  {different.path}: {' | '.join(values)}")
    fits = made.fits()
    if fits:
        table = terminal.table("Fits, 95 % intervals", ("data", "model", "β per decade", "cut-off time"))
        for name, fit in fits:
            table.add_row(name, fit.describe(), fit.beta_text(), fit.cutoff_text())
        terminal.show(table)
