"""The commands about results of every kind: show, plot, compare, report, arrhenius, cite."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import output
from chemage.cli.options import (
    FIGURES,
    PAGES,
    AllOpt,
    CsvOpt,
    FontOpt,
    ForceOpt,
    FormatOpt,
    JsonOpt,
    MeasuredOpt,
    OffsetOpt,
    ResultArg,
    ResultsArg,
    SheetOpt,
    StyleOpt,
    WidthOpt,
    changed_fields,
    check_ending,
    named_value,
    user_error,
)
from chemage.foundation.progress import progress_bars, reported
from chemage.plugins import registry

if TYPE_CHECKING:
    from chemage.results.comparison import Comparison


def show(
    file: ResultArg,
    as_json: JsonOpt = False,
    as_csv: CsvOpt = False,
    every: AllOpt = False,
) -> None:
    """Print the main numbers of a result file, or of a sweep."""
    from chemage.results.kinds import load

    result = load(file)
    if as_json and as_csv:
        raise user_error("--json and --csv: choose one")
    if as_json:
        output.say_json(result.todict())
    elif as_csv:
        output.say_csv(result)
    else:
        output.show_all(every)
        output.show_result(result)


_XOpt = Annotated[
    str | None,
    typer.Option(
        metavar="AXIS",
        help="sweeps: axis to the right, by the name of its field, or hold_time; default: the numeric axis with most "
        "values",
    ),
]
_LinesOpt = Annotated[
    str | None,
    typer.Option(
        metavar="AXIS",
        help="sweeps: axis with a line for each value; default: the next numeric axis",
    ),
]
_YOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="RESULT",
        help="sweeps: what to draw, such as beta, friction_drop, area_fraction; repeatable, one panel each; default: "
        "beta and friction_drop",
    ),
]
_WhereOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="AXIS=VALUE",
        help="sweeps: value of a further axis; repeatable; default: the one in the middle; seeds are averaged",
    ),
]
_HeatOpt = Annotated[
    bool,
    typer.Option(
        "--heat",
        help="sweeps: a heat map; default: only in place of more than 8 lines",
    ),
]
_PanelOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="only this panel, in a figure of its own; repeatable; default: all figures",
    ),
]
_DataOpt = Annotated[
    bool,
    typer.Option(
        "--data",
        help="write what each figure shows beside it, as NAME.csv; maps of up to 50 000 cells",
    ),
]


def plot(
    file: ResultArg,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="folder of the figures; default: NAME-figures beside NAME.h5",
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar='"X0 X1 Y0 Y1"',
            help="draw only this part of the maps, with all its pixels; in nm, or with units",
        ),
    ] = None,
    x: _XOpt = None,
    lines: _LinesOpt = None,
    y: _YOpt = None,
    where: _WhereOpt = None,
    heat: _HeatOpt = False,
    panel: _PanelOpt = None,
    width: WidthOpt = None,
    font: FontOpt = None,
    style: StyleOpt = None,
    data: _DataOpt = False,
    fmt: FormatOpt = "png",
    force: ForceOpt = False,
) -> None:
    """Draw the figures of a result file or of a sweep.

    The figures of a sweep are results against one axis, with a line for each value of another and bands of the 95 %
    interval, or heat maps; seeds are averaged over.
    """
    from chemage.foundation.figures import save_figures
    from chemage.foundation.looks import Look, drawn_as
    from chemage.results import drawing
    from chemage.results.kinds import load

    fixed = dict(
        named_value("--where", text, "AXIS=VALUE, such as load=50")
        for text in where or []
    )
    choice: dict[str, Any] = {
        "x": x,
        "lines": lines,
        "y": y,
        "where": fixed,
        "heat": heat,
    }
    choice = {name: value for name, value in choice.items() if value}
    is_sweep = file.is_dir()
    if is_sweep and window is not None:
        raise user_error(
            f"--window: {file} is a sweep, which has no maps; plot a result file"
        )
    if choice and not is_sweep:
        raise user_error(
            f"--{next(iter(choice))} is for sweeps, and {file} is a file; give the folder of a sweep"
        )
    folder = out or file.with_name(f"{file.stem}-figures")
    if is_sweep and out is None:
        folder = file.resolve().with_name(f"{file.resolve().name}-figures")
        if folder.is_relative_to(Path.cwd()):
            folder = folder.relative_to(Path.cwd())
    if window is not None and panel:
        raise user_error("--window and --panel: choose one")
    look = Look.of(width, font, style)
    with progress_bars() as report, reported(report, "drawing"), drawn_as(look):
        if window is not None:
            drawn = {"window": drawing.window_figure(file, window)}
        else:
            drawn = drawing.figures(load(file), panel or (), **choice)
        if not drawn:
            raise user_error(
                f"{file} holds nothing that can be drawn; `chemage run` makes files to plot"
            )
        pictures = save_figures(drawn, folder, force=force, suffix=fmt, data=data)
    for picture in pictures:
        output.say(picture)


def compare(
    files: ResultsArg,
    as_json: JsonOpt = False,
    as_csv: CsvOpt = False,
    figures: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="draw figures into this folder; default: no figures",
        ),
    ] = None,
    fmt: FormatOpt = "png",
    width: WidthOpt = None,
    font: FontOpt = None,
    style: StyleOpt = None,
    measured: MeasuredOpt = None,
    offset: OffsetOpt = None,
    sheet: SheetOpt = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIME",
            help='hold time at which to compare, in s or with a unit; may be repeated; default: "1 s" and "1e3 s"',
        ),
    ] = None,
    every: AllOpt = False,
    force: ForceOpt = False,
) -> None:
    """Compare results with each other and with measurements.

    Results of single asperities and of rough contacts can be compared.
    """
    from chemage.foundation.figures import save_figures
    from chemage.foundation.looks import Look, drawn_as
    from chemage.results import comparison, drawing

    if as_json and as_csv:
        raise user_error("--json and --csv: choose one")
    look = Look.of(width, font, style)
    joined = comparison.compare_files(
        files,
        measured=measured or (),
        times=at or comparison.TIMES,
        offset=offset,
        sheet=sheet,
    )
    pictures: list[Path] = []
    if figures is not None:
        with progress_bars() as report, reported(report, "drawing"), drawn_as(look):
            pictures = save_figures(
                drawing.comparison_figures(joined), figures, force=force, suffix=fmt
            )
    if as_json:
        output.say_json({**joined.todict(), "figures": pictures})
    elif as_csv:
        output.say(joined.csv(), end="")
    else:
        output.show_all(every)
        _print_comparison(joined)
        for picture in pictures:
            output.say(f"figure   {picture}")


def report(
    files: ResultsArg,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="the page to write, ending in .html"
        ),
    ] = Path("report.html"),
    measured: MeasuredOpt = None,
    offset: OffsetOpt = None,
    sheet: SheetOpt = None,
    force: ForceOpt = False,
) -> None:
    """Write a report of results as an HTML page.

    One file with figures, tables, scenes, provenance and references, which needs no network. Several results are also
    compared.
    """
    from chemage.results.page import write_report

    if out not in files:  # which is refused for that reason
        check_ending(out, PAGES, "a report")
    with progress_bars() as bars, reported(bars, "report"):
        written = write_report(
            files,
            out,
            measured=measured or (),
            offset=offset,
            sheet=sheet,
            force=force,
        )
    output.say(written)


def _print_comparison(joined: Comparison) -> None:
    names = [entry.name for entry in joined.results]
    brief = joined.has_first and not output.every()
    rows = joined.first() if brief else joined.table()
    for first in range(0, len(names), 4):  # more columns do not fit a screen
        chosen = slice(first, first + 4)
        output.show_rows(
            "",
            ("more: --all" if brief else "", *names[chosen]),
            ((label, *texts[chosen]) for label, texts in rows),
            spaced=not brief,
        )
    for title, differences in (
        (joined.statement(), joined.chemistry_differences()),
        ("Other differences, in internal units:", joined.other_differences()),
    ):
        if differences or title == joined.statement():
            output.remark(title)
        for path, values in differences.items():
            texts = ("none" if value is None else f"{value}" for value in values)
            output.remark(f"  {path}: {' | '.join(texts)}")
    for entry in joined.results:
        for note in entry.notes:
            output.remark(f"note: {entry.name}: {note}")
    if joined.measured or not brief:
        output.show_tables(joined.tables())
    for name, model, reason in joined.not_fitted():
        output.say(f"{name}: {model} not fitted: {reason}")


def arrhenius(
    results: Annotated[
        list[Path],
        typer.Argument(
            help="the folder of a sweep over hold.temperature, or result files (.h5)"
        ),
    ],
    level: Annotated[
        list[str] | None,
        typer.Option(
            metavar="VALUE",
            help="level of the quantity at which times are compared; repeatable; default: five are chosen",
        ),
    ] = None,
    quantity: Annotated[
        str | None,
        typer.Option(
            help="friction_coefficient_drop, friction_drop (nN) or bonds_per_site; default: the first, or the second "
            "without load"
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar='"T0 T1"',
            help="hold times of the line of β, s or with units; default: that of the scene",
        ),
    ] = None,
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH=VALUE",
            help="sweeps with more axes: use the points at which a field has this value; repeatable",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="file of the figure (.png, .pdf or .svg); default: no figure",
        ),
    ] = None,
    width: WidthOpt = None,
    font: FontOpt = None,
    style: StyleOpt = None,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Find activation energies from several temperatures.

    Lists β and the cut-off time at each temperature, and for each level of the friction rise the apparent activation
    energy of the time at which it is reached, with 95 % intervals.
    """
    from chemage.cli.output import save_picture
    from chemage.foundation.errors import InputError
    from chemage.foundation.files import preflight
    from chemage.foundation.looks import Look, drawn_as
    from chemage.foundation.result import result_of
    from chemage.results.arrhenius import arrhenius as summarise

    limits = tuple(window.split()) if window is not None else None
    if limits is not None and len(limits) != 2:
        raise InputError.of(
            "window",
            window,
            "is not two hold times",
            'give "10 1e4", say, or with units "10s 1e4s"',
        )
    look = Look.of(width, font, style)
    if out is not None:
        check_ending(out, FIGURES, "a figure")
        preflight(out, force=force)
    energies = summarise(
        results[0] if len(results) == 1 else results,
        level,
        quantity=quantity,  # pyright: ignore[reportArgumentType]
        window=tuple(_time(text) for text in limits) if limits else None,  # pyright: ignore[reportArgumentType]
        where=changed_fields(where) if where else None,
    )
    result = result_of(energies)
    if out is not None:
        with drawn_as(look):
            save_picture(result, out, force=force)
    output.answer(result, as_json, figure=out)


def _time(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def cite(
    what: Annotated[
        str,
        typer.Argument(
            help="a result file (.h5), the folder of a sweep, or a scene"
        ),
    ],
    fmt: Annotated[
        str,
        typer.Option("--format", help="bibtex, or text: one line per publication"),
    ] = "bibtex",
) -> None:
    """Print what to cite, as BibTeX.

    These are chemage, the paper of its model, and the publications of the components that were used.
    """
    from chemage.results.kinds import components, load
    from chemage.scene.files import parse_scene, scene_data
    from chemage.scene.provenance import bibtex, references, text
    from chemage.studies.sweeps.grid import Grid

    if fmt not in ("bibtex", "text"):
        raise user_error(f"--format {fmt}: choose bibtex or text")
    path, texts, version = Path(what), [], ""
    if path.is_dir() or (
        path.is_file()
        and path.suffix != ".toml"
        and what not in registry.current().scenes()
    ):
        result = load(path, maps=False)
        parts = [component for _, component in components(result)]
        texts, version = result.cite()
    else:
        data, source = scene_data(what)
        grid = Grid.read(data, source) if "sweep" in data else None
        parts = (
            grid.components()
            if grid is not None
            else parse_scene(data, source).components()
        )
    texts = texts or [entry for component in parts for entry in component.cite]
    publications = references(
        texts, parts, **({"version": version} if version else {})
    )
    print(bibtex(publications) if fmt == "bibtex" else text(publications), end="")
