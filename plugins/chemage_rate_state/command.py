"""The commands ``chemage rate-state`` and ``chemage slip-length``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from chemage.plugin import options, output, progress


def rate_state(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="a table of time, displacement of the load point and friction_coefficient with their units, or a result "
            "file (.h5) of a programme of slides and holds",
        ),
    ],
    law: Annotated[
        str,
        typer.Option(metavar="LAW", help="ageing, slip, or both"),
    ] = "both",
    stiffness: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE",
            help='stiffness of spring and machine over the normal force, such as "0.003 um**-1"; default: fitted; of a '
            "result that of its spring",
        ),
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(
            metavar="VALUES",
            help='speeds of the load point, such as "1 um/s, 10 um/s"; default: found in its displacement',
        ),
    ] = None,
    changes: Annotated[
        str | None,
        typer.Option(
            metavar="VALUES", help='when they change, such as "50 s, 90 s"'
        ),
    ] = None,
    out: options.FigureOpt = None,
    as_json: options.JsonOpt = False,
    as_csv: options.CsvOpt = False,
    force: options.ForceOpt = False,
) -> None:
    """Fit the laws of rate-and-state friction to a trace.

    Prints a, b, D_c and the stiffness with intervals, whether a law explains the trace, and which explains it better.
    """
    import chemage as ca
    from chemage.plugin import convert
    from chemage_rate_state.fit import LAWS, RateStateFits
    from chemage_rate_state.traces import read_trace, trace_of

    output.check_figure(out, force)
    given = None if stiffness is None else convert(stiffness, "1/um")
    known = [
        [convert(one, unit) for one in text.split(",")] if text else []
        for text, unit in ((speeds, "um/s"), (changes, "s"))
    ]
    if file.suffix.lower() not in options.RESULTS:
        trace = read_trace(file, given, *known)
    elif any(known):
        raise options.user_error(
            f"{file}: has its speeds; leave --speeds and --changes out"
        )
    else:
        trace = trace_of(ca.read(file), given)
    result = RateStateFits(trace, LAWS if law == "both" else (law,))
    output.deliver(result, out, as_json, as_csv, force)


def slip_length(
    scene: options.SceneArg,
    changes: options.SetOpt = None,
    surfaces: Annotated[
        int,
        typer.Option(
            min=2, metavar="N", help="pairs of surfaces, for the intervals"
        ),
    ] = 3,
    slip: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help='how far they slide, such as "20 nm"; default: six mean chords of a patch',
        ),
    ] = None,
    out: options.FigureOpt = None,
    as_json: options.JsonOpt = False,
    as_csv: options.CsvOpt = False,
    force: options.ForceOpt = False,
) -> None:
    """Find the slip that renews the contact of two surfaces.

    They slide over each other by pixels. D_c is the mean slip since the sites came into contact. A scene with [sweep]
    gives a line for each of its points, and the power of the mean chord of a patch.
    """
    from chemage.plugin import convert, scenes_of
    from chemage_rate_state.renewal import RenewalDisplay
    from chemage_rate_state.renewal import slip_length as measured

    output.check_figure(out, force)
    length = None if slip is None else convert(slip, "nm")
    found = []
    with progress.progress_bars({"sliding": "steps"}) as report:
        for varied, one in scenes_of(scene, options.changed_fields(changes)):
            point = ", ".join(f"{path} = {value}" for path, value in varied.items())
            part = measured(one, surfaces, length, partial(report, "sliding"))
            found.append(part._replace(of=point and f" at {point}"))
    output.deliver(RenewalDisplay(*found), out, as_json, as_csv, force)
