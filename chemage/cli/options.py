"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def user_error(message: str) -> Exception:
    """Make an error that is printed as one message and ends the program with status 2."""
    from chemage.foundation.errors import InputError

    return InputError(message)


def _known_format(name: str) -> str:
    if name not in ("png", "pdf", "svg"):
        raise user_error(f"--format {name}: choose png, pdf or svg")
    return name


def known_figure(path: Path) -> None:
    """Refuse, before anything is computed, the file of a figure in a format that cannot be written."""
    if path.suffix.lower() not in ("", ".png", ".pdf", ".svg"):
        raise user_error(f"--out {path}: figures end in .png, .pdf or .svg")


SceneArg = Annotated[str, typer.Argument(help="a scene file (.toml), or the name of an installed scene")]
FileArg = Annotated[Path, typer.Argument(help="a result file (.h5)")]
JsonOpt = Annotated[bool, typer.Option("--json", help="print one JSON object instead of a table")]
ForceOpt = Annotated[bool, typer.Option("--force", help="overwrite existing files")]
YesOpt = Annotated[
    bool, typer.Option("--yes", "-y", help="sweeps: do not ask about a large number of points or a nearly full disk")
]
SetOpt = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="change a field, e.g. --set surface.rms_slope=0.2; repeatable"),
]
FormatOpt = Annotated[
    str, typer.Option("--format", callback=_known_format, help="format of the figures: png, pdf, svg")
]
MeasuredOpt = Annotated[
    list[Path] | None,
    typer.Option(help="CSV file of measured hold times and friction drops to compare with; repeatable"),
]
ExecutorOpt = Annotated[
    str | None,
    typer.Option(
        help="sweeps: serial, processes, dask, dask:ADDRESS, dask:CLASS or dask:FILE.toml; "
        "default: serial, or processes with two workers or more"
    ),
]
WorkersOpt = Annotated[
    int | None,
    typer.Option(min=1, help="sweeps: number of concurrent points; default: chosen automatically from the processors"),
]
ThreadsOpt = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="threads of a single run, i.e. concurrent replicas, or of each point of a sweep; default: one per "
        "processor; one thread per point with the executors processes and dask",
    ),
]


def changed_fields(texts: list[str] | None, replicas: int | None = None, seed: int | None = None) -> dict[str, Any]:
    """Read ``--set PATH=VALUE`` and its short forms: dotted path -> value, as TOML where it is TOML, else as text."""
    import tomllib

    changes: dict[str, Any] = {}
    for text in texts or []:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise user_error(f"--set {text}: write it as PATH=VALUE, such as surface.rms_slope=0.2")
        try:
            changes[path.strip()] = tomllib.loads(f"value = {value}")["value"]
        except (ValueError, RecursionError):
            changes[path.strip()] = value.strip()
    short = {"hold.replicas": replicas, "hold.seed": seed}
    return changes | {path: value for path, value in short.items() if value is not None}
