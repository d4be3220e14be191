"""The command about a temperature sweep."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chemage.cli import terminal
from chemage.cli.options import FIGURES, ForceOpt, JsonOpt, changed_fields, check_ending

if TYPE_CHECKING:
    from chemage.studies.arrhenius import Arrhenius


def arrhenius(
    results: Annotated[
        list[Path], typer.Argument(help="the folder of a sweep over hold.temperature, or result files (.h5)")
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
            metavar='"T0 T1"', help="hold times of the line of β, s or with units; default: that of the scene"
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
        Path | None, typer.Option("--out", "-o", help="file of the figure (.png, .pdf or .svg); default: no figure")
    ] = None,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Find activation energies from results at several temperatures.

    Lists β and the cut-off time at each temperature, and for each level of the friction rise the apparent activation
    energy of the time at which it is reached, with 95 % intervals.
    """
    from chemage.foundation.errors import InputError
    from chemage.foundation.files import fresh_file, preflight
    from chemage.results.arrhenius import arrhenius as summarise
    from chemage.results.arrhenius import figure

    limits = tuple(window.split()) if window is not None else None
    if limits is not None and len(limits) != 2:
        raise InputError.of("window", window, "is not two hold times", 'give "10 1e4", say, or with units "10s 1e4s"')
    if out is not None:
        check_ending(out, FIGURES, "a figure")
        preflight(out, force=force)
    found = summarise(
        results[0] if len(results) == 1 else results,
        level,
        quantity=quantity,  # pyright: ignore[reportArgumentType]
        window=tuple(_time(text) for text in limits) if limits else None,  # pyright: ignore[reportArgumentType]
        where=changed_fields(where) if where else None,
    )
    if out is not None:
        with fresh_file(out, force=force) as part:
            figure(found).savefig(part, format=out.suffix.removeprefix(".").lower() or "png")
    if as_json:
        print(json.dumps({**found.todict(), "figure": str(out) if out is not None else None}))
        return
    _print(found)
    if out is not None:
        terminal.say(f"figure   {out}")


def _print(found: Arrhenius) -> None:
    from chemage.results.arrhenius import rows

    by_temperature, by_level = rows(found)
    columns = ("T (K)", "β per decade", "b per e-fold", "β/T (1/K)", "cut-off time")
    table = terminal.table("Ageing at each temperature, 95 % intervals", columns)
    for row in by_temperature:
        table.add_row(*row)
    terminal.show(table)
    columns = ("time at which", "activation energy", "prefactor t0", "rms of ln t", "temperatures")
    table = terminal.table("t = t0 exp(E_a/k_B T), 95 % intervals", columns)
    for row in by_level:
        table.add_row(*row)
    terminal.show(table)
    for words in dict.fromkeys(one.intervals for one in found.energies):
        terminal.say(f"intervals: {words}; scatter between surfaces is not included")
    for note in found.notes:
        terminal.say(f"note: {note}")


def _time(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
