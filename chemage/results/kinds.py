"""Every kind of result that chemage has, and what is read from files and folders as one of them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

# what shows an ageing curve is in a room above it
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.result import Result, result_of
from chemage.plugins import registry
from chemage.results.files import read
from chemage.scene import display as _scene  # noqa: F401
from chemage.scene.provenance import components_of
from chemage.studies.sweeps.result import load_sweep


def load(path: str | os.PathLike[str], *, maps: bool = True) -> Result:
    """Read what users see of a result file, the folder of a sweep, a point of it (``FOLDER/3``), or a map of speed
    against accuracy (``.json``); without ``maps`` the surface is left out.

    Raises
    ------
    InputError
        The sweep has no such point, or the file holds no result.
    StoreError
        The file is missing or damaged.
    """
    source = Path(path)
    if is_point(source):
        sweep, index = load_sweep(source.parent), int(source.name)
        if index >= len(sweep):
            folder = source.parent
            raise InputError(
                f"{folder} has {len(sweep)} points, from {folder}/0 on; there is no {folder}/{index}"
            )
        return result_of(sweep[index])
    if source.is_dir():
        return result_of(load_sweep(source))
    if source.suffix.lower() == ".json" and source.is_file():
        # as the plugin shows it that measures such maps
        names = registry.current().offered("names")
        target = names.get("Tradeoff", "chemage.studies.trade:TradeMap")
        return result_of(resolve_name(target).read(source))
    return result_of(read(source, maps=maps)).completed(source)


def is_point(path: Path) -> bool:
    """Whether a path is a point of a sweep."""
    return (
        path.name.isdecimal()
        and (path.parent / "sweep.json").is_file()
        and not (path / "sweep.json").is_file()
    )


def components(result: Result) -> list[tuple[str, Component]]:
    """The components that made a result, as far as they are installed: (path of the section, component)."""
    made_by: Mapping[str, Any] = result.made_by()
    if "components" in made_by:
        return [("", component) for component in made_by["components"]]
    return components_of(**{"scene": {}, **made_by})
