"""What is checked of the folder of a sweep before anything is read or written by the names in its manifest.

A folder may come from a stranger: its manifest must not name files elsewhere, and links in it are not followed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from chemage.foundation.errors import InputError, StoreError, shown
from chemage.foundation.files import check_data

#: keys of points and contacts are hashes, and also names of files
_KEY = re.compile(r"[0-9a-f]{32}")


def checked_manifest(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The content of ``sweep.json``, if it has the form that this version writes.

    Raises
    ------
    StoreError
        It has not; names the entry.
    """
    try:
        check_data(data)
    except InputError as error:
        raise StoreError(f"{path} does not describe a sweep: {': '.join(error.problems[0])}") from None
    keys, contacts = _strings(data, "keys", path), _strings(data, "contacts", path)
    for name, values in (("keys", keys), ("contacts", contacts)):
        for value in values:
            if not _KEY.fullmatch(value):
                raise StoreError(f"{path}: {shown(value)} in {name} is no key of a point or a contact")
    numbers = data.get("contact_of")
    if not isinstance(numbers, list) or len(numbers) != len(keys):
        raise StoreError(f"{path}: contact_of does not name a contact for each point")
    if not all(type(number) is int and 0 <= number < len(contacts) for number in numbers):
        raise StoreError(f"{path}: contact_of names contacts that are not listed")
    versions = data.get("versions")
    if not isinstance(versions, dict) or not all(isinstance(text, str) for text in versions.values()):
        raise StoreError(f"{path}: versions is damaged")
    if "chemage" not in versions or not isinstance(data.get("digest"), str):
        raise StoreError(f"{path}: versions or digest is missing")
    _check_grid(data, len(keys), path)
    return dict(data)


def _strings(data: Mapping[str, Any], name: str, path: Path) -> list[str]:
    values = data.get(name)
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise StoreError(f"{path}: {name} is no list of names")
    return values


def _check_grid(data: Mapping[str, Any], points: int, path: Path) -> None:
    grid = data.get("grid")
    axes = grid.get("axes") if isinstance(grid, dict) else None
    if not isinstance(grid, dict) or not isinstance(axes, list) or not isinstance(grid.get("base"), dict):
        raise StoreError(f"{path}: grid is damaged")
    size = 1
    for axis in axes:
        paths, values = (axis.get("paths"), axis.get("values")) if isinstance(axis, dict) else (None, None)
        if not isinstance(paths, list) or not isinstance(values, list) or not values:
            raise StoreError(f"{path}: an axis of the grid is damaged")
        if not all(isinstance(name, str) for name in paths):
            raise StoreError(f"{path}: an axis of the grid is damaged")
        if not all(isinstance(one, list) and len(one) == len(paths) for one in values):
            raise StoreError(f"{path}: an axis of the grid has values for other fields than it names")
        size *= len(values)
    resolved = data.get("resolved")
    same = isinstance(resolved, list) and [len(one) for one in resolved if isinstance(one, list)] == [
        len(axis["values"]) for axis in axes
    ]
    if size != points or not same or not isinstance(grid.get("source"), str):
        raise StoreError(f"{path}: the grid has {size} points, but there are {points} keys")


def refuse_links(folder: Path) -> None:
    """Refuse a folder of a sweep in which a link would lead what is written elsewhere.

    Raises
    ------
    StoreError
        Naming the link.
    """
    for path in (folder / name for name in ("sweep.json", ".lock", ".parts", ".shares", "contacts", "points")):
        _refuse_link(path)
    try:
        with os.scandir(folder / "points") as entries:
            links = [Path(entry.path) for entry in entries if entry.is_symlink()]
    except OSError:
        return
    for path in links:
        _refuse_link(path)


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise StoreError(f"{path} is a link, which is not followed; remove it, or choose another folder")
