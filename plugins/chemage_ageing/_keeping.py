"""Tables in the cache folder of the user, one container each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from chemage import DamagedError, StoreError, container, content_hash
from chemage_ageing._table import Node, Setting, Took

_KINDS = {"table": container.Arrays}


def path_of(setting: Setting, folder: Path) -> Path:
    """The file of a table."""
    return folder / f"closure-{content_hash(setting.identity())}.npz"


def load(path: Path, setting: Setting, took: Took) -> tuple[dict[int, Node], str]:
    """The nodes that a file holds, and what is wrong with it in words; none where it does not exist."""
    if not path.exists():
        return {}, ""
    try:
        parts, about = container.read(path, _KINDS)
    except DamagedError:
        return {}, f"{path} is damaged"
    except StoreError as error:
        return {}, str(error)
    if about != _about(setting, took):
        return {}, f"{path} was made with other plugins"
    arrays = parts["table"].values
    rows = zip(*(arrays[name] for name in ("numbers", "change", "error", "replicas")), strict=True)
    return {int(number): Node(change, error, int(replicas)) for number, change, error, replicas in rows}, ""


def keep(path: Path, setting: Setting, took: Took, nodes: dict[int, Node]) -> str:
    """Write a table; what prevents it in words, else nothing."""
    numbers = sorted(nodes)
    arrays = {
        "numbers": np.array(numbers),
        **{name: np.stack([getattr(nodes[number], name) for number in numbers]) for name in ("change", "error")},
        "replicas": np.array([nodes[number].replicas for number in numbers]),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        table = container.Arrays(values=arrays)
        container.write(path, {"table": table}, _about(setting, took), compact=True, force=True)
    except OSError as error:  # a StoreError is one as well
        return f"the table could not be kept in {path.parent} ({error})"
    return ""


def _about(setting: Setting, took: Took) -> dict[str, Any]:
    about = {"identity": setting.identity(), "plugins": took.plugins, "approximate": took.approximate}
    return json.loads(json.dumps(about, default=str))
