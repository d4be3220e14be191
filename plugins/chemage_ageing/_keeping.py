"""Tables on disk: one file each in the cache folder of the user, with a checksum, written whole or not at all."""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from chemage import ChemageError
from chemage.plugin import fresh_file
from chemage_ageing._table import Node, Setting, Took

_BEGIN = b"chemage closure table\n"
_ARRAYS = ("change", "error")


def cache_folder() -> Path:
    """The folder of the user for what can be computed again."""
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "chemage"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "chemage" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "chemage"
    return Path.home() / ".cache" / "chemage"


def path_of(setting: Setting, folder: Path) -> Path:
    """The file of a table."""
    text = json.dumps(setting.identity(), sort_keys=True, default=str)
    return folder / f"closure-{hashlib.blake2b(text.encode(), digest_size=16).hexdigest()}.table"


def load(path: Path, setting: Setting, took: Took) -> tuple[dict[int, Node], str]:
    """The nodes that a file holds, and what is wrong with it in words; none where it does not exist."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return {}, ""
    except OSError as error:
        return {}, f"{path} cannot be read ({error.strerror})"
    begin = len(_BEGIN)
    body = content[begin + 33 :]
    if content[:begin] != _BEGIN or content[begin : begin + 32].decode("ascii", "replace") != _checksum(body):
        return {}, f"{path} is damaged"
    with np.load(io.BytesIO(body), allow_pickle=False) as file:
        about = json.loads(bytes(file["about"]))
        if about != _about(setting, took):
            return {}, f"{path} was made with other plugins"
        numbers, replicas = file["numbers"].tolist(), file["replicas"].tolist()
        parts = [file[name] for name in _ARRAYS]
    nodes = {number: Node(*(part[k] for part in parts), replicas=replicas[k]) for k, number in enumerate(numbers)}
    return nodes, ""


def keep(path: Path, setting: Setting, took: Took, nodes: dict[int, Node]) -> str:
    """Write a table; what prevents it in words, else nothing."""
    numbers = sorted(nodes)
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: np.stack([getattr(nodes[number], name) for number in numbers]) for name in _ARRAYS}
    arrays["about"] = np.frombuffer(json.dumps(_about(setting, took)).encode(), dtype=np.uint8)
    arrays["numbers"] = np.array(numbers)
    arrays["replicas"] = np.array([nodes[number].replicas for number in numbers])
    np.savez(buffer, **arrays)
    body = buffer.getvalue()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with fresh_file(path, force=True, size=len(body)) as part:
            part.write_bytes(_BEGIN + _checksum(body).encode() + b"\n" + body)
    except (OSError, ChemageError) as error:
        return f"the table could not be kept in {path.parent} ({error})"
    return ""


def _about(setting: Setting, took: Took) -> dict[str, Any]:
    about = {"identity": setting.identity(), "plugins": took.plugins, "approximate": took.approximate}
    return json.loads(json.dumps(about, default=str))


def _checksum(body: bytes) -> str:
    return hashlib.blake2b(body, digest_size=16).hexdigest()
