"""The commands about results: show, plot, compare, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import completion, terminal
from chemage.cli.options import (
    PAGES,
    ForceOpt,
    FormatOpt,
    JsonOpt,
    MeasuredOpt,
    ResultArg,
    check_ending,
    user_error,
)
from chemage.foundation.progress import progress_bars, reported

if TYPE_CHECKING:
    from chemage.ageing.aging import Aging
    from chemage.contacts.solution import ContactSolution, ContactStatistics
    from chemage.results.comparison.comparison import Comparison
    from chemage.scene.run import Run


def show(file: ResultArg, as_json: JsonOpt = False) -> None:
    """Print the main numbers of a result file, or of a sweep."""
    if file.is_dir():
        from chemage.cli import sweeps  # imports numpy, which help and completion do without

        sweeps.show(file, as_json=as_json)
        return
    from chemage.ageing.aging import Aging
    from chemage.ageing.elasticity import elastic_measures
    from chemage.foundation.approximations import in_words
    from chemage.foundation.text import jsonable
    from chemage.inference.result import Inference
    from chemage.results.files import read
    from chemage.scene.run import Run, bond_errors
    from chemage.studies.ensembles.ensemble import Ensemble

    thing = read(file)
    if isinstance(thing, Inference):
        from chemage.cli import inference
        from chemage.results.files import read_inference

        if as_json:
            print(json.dumps(read_inference(file).summary()))
        else:
            inference.show(read_inference(file))
        return
    if isinstance(thing, Ensemble):
        from chemage.cli import ensembles

        if as_json:
            print(json.dumps(jsonable(thing.summary())))
        else:
            ensembles.show(thing)
        return
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
        for name in ("observables", "outputs", "elasticity", "errors", "error_sources"):
            del fields[name]
        fields |= bond_errors(thing)
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
    file: ResultArg,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="folder of the figures; default: NAME-figures beside NAME.h5"
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar='"X0 X1 Y0 Y1"', help="draw only this part of the maps, with all its pixels; in nm, or with units"
        ),
    ] = None,
    x: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS",
            help="sweeps: axis to the right, by the name of its field, or hold_time; default: the numeric axis with "
            "most values",
        ),
    ] = None,
    lines: Annotated[
        str | None,
        typer.Option(metavar="AXIS", help="sweeps: axis with a line for each value; default: the next numeric axis"),
    ] = None,
    y: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RESULT",
            help="sweeps: what to draw, such as beta, friction_drop, area_fraction; repeatable, one panel each; "
            "default: beta and friction_drop",
        ),
    ] = None,
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="AXIS=VALUE",
            help="sweeps: value of a further axis; repeatable; default: the one in the middle; seeds are averaged",
        ),
    ] = None,
    heat: Annotated[
        bool, typer.Option("--heat", help="sweeps: a heat map; default: only in place of more than 8 lines")
    ] = False,
    fmt: FormatOpt = "png",
    force: ForceOpt = False,
) -> None:
    """Draw the figures of a result file or of a sweep.

    The figures of a sweep are results against one axis, with a line for each value of another and bands of the 95 %
    interval, or heat maps; seeds are averaged over.
    """
    choice = {"--x": x, "--lines": lines, "--y": y, "--where": where, "--heat": heat}
    if file.is_dir():
        if window is not None:
            raise user_error(f"--window: {file} is a sweep, which has no maps; plot a result file")
        from chemage.cli import sweeps

        sweeps.plot(file, out, x=x, lines=lines, y=y or [], where=where or [], heat=heat, fmt=fmt, force=force)
        return
    if given := [name for name, value in choice.items() if value]:
        raise user_error(f"{given[0]} is for sweeps, and {file} is a file; give the folder of a sweep")
    if window is not None:
        _plot_window(file, window, out, fmt, force)
        return
    for picture in _plotted(file, out, fmt, force):
        terminal.say(picture)


def _plotted(file: Path, out: Path | None, fmt: str, force: bool) -> list[Path]:
    """Draw the figures of a result file."""
    from chemage.inference.result import Inference
    from chemage.results import ensemble_figure, inference_figures, run_figures
    from chemage.results.files import read, read_inference
    from chemage.scene.run import Run
    from chemage.studies.ensembles.ensemble import Ensemble

    thing, folder = read(file), out or file.with_name(f"{file.stem}-figures")
    if isinstance(thing, Inference):
        with progress_bars() as report, reported(report, "drawing"):
            return inference_figures.save(read_inference(file), folder, force=force, suffix=fmt)
    if not isinstance(thing, Run | Ensemble):
        raise user_error(f"{file} holds one {type(thing).__name__}, not a run; `chemage run` makes files to plot")
    with progress_bars() as report, reported(report, "drawing"):
        if isinstance(thing, Ensemble):
            return ensemble_figure.save(thing, folder, force=force, suffix=fmt)
        return run_figures.save(thing, folder, force=force, suffix=fmt)


def _plot_window(file: Path, window: str, out: Path | None, fmt: str, force: bool) -> None:
    from chemage.results.figures import save_figures
    from chemage.results.window_figure import window_figure

    with progress_bars() as report, reported(report, "drawing"):
        made = {"window": window_figure(file, window)}
        pictures = save_figures(made, out or file.with_name(f"{file.stem}-figures"), force=force, suffix=fmt)
    for picture in pictures:
        terminal.say(picture)


def print_run(result: Run) -> None:
    """Print the main numbers of a run."""
    from chemage.ageing.elasticity import elastic_rows
    from chemage.contacts.options import force_text
    from chemage.foundation.text import mean_text, percent
    from chemage.scene.scene import heading

    contact, aging, fit = result.contact, result.aging, result.fit()
    rows: list[tuple[str, str]] = [
        ("surface", _surface(result)),
        (
            "contact",
            f"{result.scene['contact']['kind']}, load {force_text(contact.load)}{_pressure(contact)}, "
            f"E* {contact.modulus:g} GPa" + ("" if contact.converged else "  NOT CONVERGED"),
        ),
        ("area fraction A/A0", f"{contact.area_fraction:.5f}"),
        ("kappa", f"{contact.kappa:.3f}"),
        *_of_map(contact),
        ("mean contact pressure", f"{contact.mean_contact_pressure:.4g} GPa"),
    ]
    if aging is not None:
        last = f"at {aging.hold_times[-1]:g} s"
        rows += [
            ("sites", f"{aging.sites.mean():.0f}, {aging.site_grid}"),
            ("engine", _kinetics(aging)),
            ("rupture law", aging.rupture or ("mean force per bond" if aging.rupture_force is None else "a plugin's")),
            ("random numbers", aging.random_numbers or ("none" if aging.method else "not recorded")),
            (f"friction drop {last}", mean_text(aging.friction_drop[:, -1], "nN")),
            (f"friction coefficient drop {last}", mean_text(aging.friction_coefficient_drop[:, -1])),
        ]
        if aging.errors:
            rows.append((f"errors of the mean {last}", aging.error_words))
        rows += elastic_rows(aging)
        rows += measured_rows(aging)
    if aging is not None and fit is None:
        rows += [("beta", f"not fitted: {result.fit_reason}"), ("cut-off time", "not fitted")]
    if fit is not None:
        rows.append(
            ("beta", f"{fit.beta_text()} per decade, {fit.points} hold times from {fit.span[0]:g} to {fit.span[1]:g} s")
        )
        rows.append(("b = beta/ln 10", f"{fit.b_text()} per e-fold"))
        rows.append(("cut-off time", fit.cutoff_text()))
        scatter = result.scatter
        alone = scatter is not None and scatter.relative == 0
        more = "" if alone else ": disorder and noise on this surface; scatter between surfaces is not included"
        rows.append(("errors", f"95 %, {fit.intervals_text()}{more}"))
        if scatter is not None and not alone:
            rows.append(("surfaces", scatter.text(fit.relative_stderr)))
        beside = "" if fit.replicas == 1 else ", beside the interval above"
        for name, error in result.beta_errors.items():
            rows.append((f"error of beta: {name}", f"{percent(error)} (standard error){beside}"))
    if result.approximate:
        rows.append(("approximate", result.approximate))
    rows += [(f"plugin {name}", source) for name, source in result.plugins.items()]
    if result.timings:
        rows.append(("wall time", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in result.timings.items())))
    terminal.show_pairs(heading(result.scene), rows)
    for note in result.notes:
        terminal.remark(f"note: {note}")


def _surface(result: Run) -> str:
    from chemage.contacts.solution import ContactStatistics

    contact, kind = result.contact, result.scene["surface"]["kind"]
    if isinstance(contact, ContactStatistics):
        return f"{kind}, {contact.nominal_area:.5g} nm² without a map, rms slope {contact.rms_slope:.4g}"
    nx, ny = contact.shape
    return f"{kind}, {nx} x {ny} pixels of {contact.pixel_size:g} nm, rms slope {contact.rms_slope:.4g}"


def _pressure(contact: ContactSolution | ContactStatistics) -> str:
    """The nominal pressure, where the contact has one."""
    from chemage.contacts.options import pressure_text

    return f" ({pressure_text(contact.nominal_pressure)} nominal)" if getattr(contact, "periodic", True) else ""


def _of_map(contact: ContactSolution | ContactStatistics) -> list[tuple[str, str]]:
    """The rows that need the map of the contact."""
    from chemage.contacts.solution import ContactStatistics

    if isinstance(contact, ContactStatistics):
        return [("patches, rim", "not known: the contact has no map")]
    return [
        ("patches", f"{contact.patches}"),
        ("perimeter to area C/A", f"{contact.perimeter_to_area:.4f} /nm"),
    ]


def _kinetics(aging: Aging) -> str:
    """Engine, method of ageing, replicas and events, in words."""
    by = f" by ageing {aging.method!r}" if aging.method else ""
    events = "" if aging.events is None else f", {aging.events.sum()} events"
    return f"{aging.engine}{by}, {aging.replicas} replica{'s' if aging.replicas > 1 else ''}{events}"


def measured_rows(aging: Aging) -> list[tuple[str, str]]:
    """What observables measured: (name, text)."""
    last = f" at {aging.hold_times[-1]:g} s"
    return [(f"{name}{last if one.is_curve else ''}", one.text()) for name, one in aging.measured.items()]


def compare(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES", autocompletion=completion.results, help="result files (.h5), folders of sweeps"
        ),
    ],
    as_json: JsonOpt = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="print CSV, one line per result, instead of tables")] = False,
    figures: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="draw figures into this folder; default: no figures")
    ] = None,
    fmt: FormatOpt = "png",
    measured: MeasuredOpt = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIME",
            help='hold time at which to compare, in s or with a unit; may be repeated; default: "1 s" and "1e3 s"',
        ),
    ] = None,
    force: ForceOpt = False,
) -> None:
    """Compare results with each other and with measurements.

    Results of single asperities and of rough contacts can be compared.
    """
    from chemage.results import comparison
    from chemage.results.figures import save_figures

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
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES",
            autocompletion=completion.results,
            help="result files (.h5), folders of sweeps; several results are also compared",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="the page to write, ending in .html")] = Path(
        "report.html"
    ),
    measured: MeasuredOpt = None,
    force: ForceOpt = False,
) -> None:
    """Write a report of results as an HTML page.

    One file with figures, tables, scenes, provenance and references, which needs no network.
    """
    from chemage.results.page import write_report

    if out not in files:  # which is refused for that reason
        check_ending(out, PAGES, "a report")
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
    terminal.remark(made.statement())
    for different in made.chemistry_differences():
        values = ("none" if value is None else f"{value}" for value in different.values)
        terminal.remark(f"  {different.path}: {' | '.join(values)}")
    fits = made.fits()
    if fits:
        table = terminal.table(
            "Fits, 95 % intervals", ("data", "model", "β per decade", "b per e-fold", "cut-off time")
        )
        for name, fit in fits:
            table.add_row(name, fit.describe(), fit.beta_text(), fit.b_text(), fit.cutoff_text())
        terminal.show(table)
    for name, model, reason in made.not_fitted():
        terminal.say(f"{name}: {model} not fitted: {reason}")
