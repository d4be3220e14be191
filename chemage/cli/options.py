"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

SceneArg = Annotated[str, typer.Argument(help="a scene file (.toml), or the name of an installed scene")]
FileArg = Annotated[Path, typer.Argument(help="a result file (.h5)")]
JsonOpt = Annotated[bool, typer.Option("--json", help="print one JSON object instead of a table")]
ForceOpt = Annotated[bool, typer.Option("--force", help="overwrite what is already there")]
YesOpt = Annotated[bool, typer.Option("--yes", "-y", help="of a sweep: agree to many points and little room on disk")]
SetOpt = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="change a field, e.g. --set surface.rms_slope=0.2; repeatable"),
]


def user_error(message: str) -> Exception:
    from chemage.foundation.errors import InputError

    return InputError(message)


def changed_fields(texts: list[str] | None, replicas: int | None = None, seed: int | None = None) -> dict[str, Any]:
    import tomllib

    changes: dict[str, Any] = {}
    for text in texts or []:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise user_error(f"--set {text}: write it as PATH=VALUE, such as surface.rms_slope=0.2")
        try:
            changes[path.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[path.strip()] = value.strip()
    if replicas is not None:
        changes["hold.replicas"] = replicas
    if seed is not None:
        changes["hold.seed"] = seed
    return changes
