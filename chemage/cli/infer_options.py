"""The arguments and options of ``chemage infer``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chemage.cli import completion

MeasuredArg = Annotated[
    list[Path],
    typer.Argument(
        metavar="MEASURED.csv",
        help="measured curves of ageing: CSV files with the columns hold_time (s), friction_drop (nN) or "
        "friction_coefficient_drop, error, load (nN), temperature (K)",
    ),
]
SceneOpt = Annotated[
    str,
    typer.Option(
        metavar="SCENE",
        autocompletion=completion.scenes,
        help="what is known of the contact: a scene file (.toml), or the name of an installed scene; its "
        "[forming], load, temperature and hold times are not used",
    ),
]
LoadOpt = Annotated[
    str | None, typer.Option(metavar="FORCE", help='load of curves without a column load, such as "50 nN"')
]
TemperatureOpt = Annotated[
    str | None,
    typer.Option(metavar="TEMPERATURE", help='temperature of curves without a column temperature, such as "300 K"'),
]
RelativeErrorOpt = Annotated[
    str | None,
    typer.Option(metavar="SHARE", help='standard error over the value of curves without a column error, such as "3 %"'),
]
UnknownOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="infer this value too, within default bounds or given ones: bond_force, activation_volume, "
        'attempt_frequency, or "bond_force=1 nN to 10 nN"; may be repeated; default: none',
    ),
]
FamiliesOpt = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="parametric densities to compare, separated by commas, or none; default: all of them",
    ),
]
PredictOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CONDITIONS",
        help='forecast at other conditions, such as "load=500 nN, temperature=350 K, hold_time=1 s to 1e6 s" or '
        '"scene=rough.toml, load=20 uN"; what is not given is as in the scene; may be repeated',
    ),
]
NextOpt = Annotated[
    list[str] | None,
    typer.Option(
        "--next",
        metavar="FILE|CONDITIONS",
        help="planned measurements to rank by how much they narrow the result: a CSV file with the columns "
        'hold_time (s), load (nN), temperature (K), error (nN), or "hold_time=1 ms to 1e7 s, load=50 nN"; may be '
        "repeated",
    ),
]
TargetOpt = Annotated[
    str | None,
    typer.Option(
        metavar="CONDITIONS",
        help='what they are to narrow: "energy=1.0 eV", or a forecast, "load=500 nN, hold_time=1e5 s"; default: '
        "the density at all visible energies",
    ),
]
SamplesOpt = Annotated[int, typer.Option(min=50, metavar="N", help="samples of the posterior that are kept")]
SeedOpt = Annotated[int, typer.Option(min=0, metavar="N", help="seed of sampling and of the simulated kinetics")]
OutOpt = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="result file, ending in .h5 or .hdf5; default: NAME-inferred.h5, after the first CSV file",
    ),
]
