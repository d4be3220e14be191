"""Arguments and options that several commands share."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from chemage.cli import completion
from chemage.foundation.aliases import Data
from chemage.foundation.errors import InputError

#: endings of the files that chemage writes
RESULTS, FIGURES, PAGES = (
    (".h5", ".hdf5"),
    (".png", ".pdf", ".svg"),
    (".html", ".htm"),
)


#: an error that is printed as one message and ends the program with status 2
user_error = InputError


def _known_format(name: str) -> str:
    if name not in ("png", "pdf", "svg"):
        raise user_error(f"--format {name}: choose png, pdf or svg")
    return name


def check_ending(path: Path, endings: tuple[str, ...], what: str) -> None:
    """Refuse, before anything is computed, a file whose ending is not that of what is written into it.

    What is no file, such as a folder, is refused where it is opened, for that reason.
    """
    if path.suffix.lower() not in endings and (
        os.path.isfile(path) or not os.path.exists(path)
    ):
        *others, last = endings
        names = f"{', '.join(others)} or {last}" if others else last
        ending = f"ends in {path.suffix}" if path.suffix else "has no ending"
        raise user_error(
            f"--out {path}: the name {ending}; {what} must end in {names}"
        )


SceneArg = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        autocompletion=completion.scenes,
        help="a scene file (.toml), or the name of an installed scene such as silica-tip",
    ),
]
ResultArg = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        autocompletion=completion.results,
        help="result file (.h5), or the folder of a sweep",
    ),
]
ResultsArg = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILES",
        autocompletion=completion.results,
        help="result files (.h5), folders of sweeps",
    ),
]
CsvOpt = Annotated[bool, typer.Option("--csv", help="print CSV instead of tables")]
FiguresOpt = Annotated[
    bool,
    typer.Option(
        help="draw figures into the folder NAME-figures beside the result"
    ),
]
FigureOpt = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="draw it: .png, .pdf or .svg"),
]
ReplicasOpt = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="number of replicas; short for --set hold.replicas=N"
    ),
]
SeedOpt = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="seed of the disorder and the kinetics; short for --set hold.seed=N",
    ),
]
AllOpt = Annotated[
    bool,
    typer.Option(
        "--all",
        help="print everything: how it was computed, every number with the parts of its error, what is recorded as "
        "arrays",
    ),
]
JsonOpt = Annotated[
    bool, typer.Option("--json", help="print one JSON object instead of tables")
]
ForceOpt = Annotated[
    bool, typer.Option("--force", help="overwrite existing files; default: refuse")
]
YesOpt = Annotated[
    bool,
    typer.Option(
        "--yes",
        "-y",
        help="sweeps: do not ask whether to compute very many points or to fill the disk",
    ),
]
SetOpt = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        autocompletion=completion.fields,
        help='change a field of the scene, such as --set surface.rms_slope=0.2 or --set "contact.load=5 uN"; may be '
        "repeated",
    ),
]
AccuracyOpt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="average over random surfaces until the 95 % interval of this quantity is within ± VALUE of its mean, "
        'such as beta=2% or "friction_coefficient_drop@1e3 s=5%"; may be repeated; default: as the scene says',
    ),
]
BudgetOpt = Annotated[
    str | None,
    typer.Option(
        metavar="TIME",
        help='average over random surfaces for this wall time, such as "60 s", or until the accuracy is reached; '
        "default: as the scene says",
    ),
]
SurfacesOpt = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="average over this many random surfaces; 1: the one of the scene alone; default: as the scene says",
    ),
]
MapOpt = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        help="choose the settings of the mean over surfaces by the costs and errors in this file of `chemage tradeoff "
        "SCENE -o FILE`; default: as the scene says, or by estimates",
    ),
]
FormatOpt = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="FORMAT",
        callback=_known_format,
        autocompletion=completion.one_of("png", "pdf", "svg"),
        help="format of the figures: png, pdf or svg",
    ),
]
WidthOpt = Annotated[
    str | None,
    typer.Option(
        "--width",
        metavar="WIDTH",
        help="for print: 1 or 2 columns of a page (85 or 180 mm), or a length such as 120mm; default: for a screen",
    ),
]
FontOpt = Annotated[
    str | None,
    typer.Option(
        "--font",
        metavar="FONT",
        help='family of the text, its size in pt, or both, such as "Arial 9"; 7 pt at least',
    ),
]
StyleOpt = Annotated[
    Path | None,
    typer.Option(
        "--style",
        metavar="FILE",
        help="style sheet of matplotlib whose settings replace those of chemage",
    ),
]
MeasuredOpt = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="TABLE",
        help="measurements to draw, fit and judge beside the results: a text or Excel file of hold times and friction "
        "drops; may be repeated",
    ),
]
OffsetOpt = Annotated[
    str | None,
    typer.Option(
        metavar="FRICTION|first",
        help='friction without ageing, of tables of friction, such as "20 nN" or 0.3, or first: take the rise above the '
        "first hold time",
    ),
]
SheetOpt = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="sheet of an Excel file; default: the only one with hold times",
    ),
]
FolderOpt = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="keep what is computed in this folder, from which a later call goes on; default: none",
    ),
]
ExecutorOpt = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        autocompletion=completion.one_of("serial", "processes", "dask"),
        help="many runs: where they are computed: serial, processes, dask, dask:ADDRESS or dask:SCHEDULER.json; "
        "default: serial, or processes if --workers is above 1",
    ),
]
WorkersOpt = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="many runs: how many are computed at the same time; default: from the processors",
    ),
]
ThreadsOpt = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="threads, that is, replicas computed at the same time; of each point in a sweep; default: one per "
        "processor, or one per point with the executors processes and dask; results do not depend on it",
    ),
]

PointsOpt = Annotated[
    str | None,
    typer.Option(
        help="compute a part beside other processes: 3/16 (the third of 16 shares), auto (the share of this task of a "
        "job array; auto/16 where the scheduler does not say how many tasks there are), or of a sweep 3,7,12-20 "
        "(numbers of points, the first is 0); default: everything",
    ),
]
PatienceOpt = Annotated[
    str | None,
    typer.Option(
        metavar="TIME",
        help="longest time to wait for the first worker of Dask, e.g. '10 min', by default without limit, because jobs "
        "may be queued; and for samples of other shares, by default 1 h",
    ),
]


def chosen_executor(
    executor: str | None, workers: int | None, otherwise: str | None
) -> str | None:
    """What ``--executor`` says; without it processes for several workers, and ``otherwise`` for one."""
    return executor or ("processes" if (workers or 1) > 1 else otherwise)


def named_value(option: str, text: str, form: str) -> tuple[str, str]:
    """Read ``NAME=VALUE``."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise user_error(f"{option} {text}: write it as {form}")
    return name.strip(), value.strip()


def changed_fields(
    texts: list[str] | None, replicas: int | None = None, seed: int | None = None
) -> Data:
    """Read ``--set PATH=VALUE`` and its short forms: dotted path -> value, as TOML where it is TOML, else as text."""
    import tomllib

    changes: Data = {}
    for text in texts or []:
        path, value = named_value(
            "--set", text, "PATH=VALUE, such as surface.rms_slope=0.2"
        )
        try:
            changes[path] = tomllib.loads(f"value = {value}")["value"]
        except (ValueError, RecursionError):
            changes[path] = value
    short = {"hold.replicas": replicas, "hold.seed": seed}
    return changes | {
        path: value for path, value in short.items() if value is not None
    }


def requested_fields(
    accuracy: list[str] | None,
    budget: str | None,
    surfaces: int | None,
    measured: Path | None = None,
) -> Data:
    """Read ``--accuracy``, ``--budget``, ``--surfaces`` and ``--map``: dotted path -> value. A number of surfaces takes
    the place of an accuracy, a budget and a map in the scene, and each of these that of a number of surfaces."""
    if surfaces is not None and (accuracy or budget is not None):
        raise user_error(
            "--surfaces: give the number of surfaces, or the accuracy (or budget) that decides it"
        )
    if surfaces is not None and measured is not None:
        raise user_error(
            "--map: a number of surfaces is computed as the scene is written; leave one of the two out"
        )
    if surfaces is not None:
        return {
            "ensemble.surfaces": surfaces,
            "ensemble.budget": None,
            "ensemble.map": None,
            "accuracy": None,
        }
    changes: Data = {}
    goals: dict[str, str] = {}
    for text in accuracy or []:
        name, value = named_value("--accuracy", text, "NAME=VALUE, such as beta=2%")
        if name in goals:
            raise user_error(f"--accuracy {text}: {name} is given twice")
        goals[name] = value
    if goals:
        changes |= {"accuracy": goals, "ensemble.surfaces": None}
    if budget is not None:
        changes |= {"ensemble.budget": budget, "ensemble.surfaces": None}
    if measured is not None:
        changes |= {"ensemble.map": str(measured)}
    return changes
