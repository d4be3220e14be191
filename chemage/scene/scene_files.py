"""Scene files: TOML read from a file or from a plugin, with changes applied."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from chemage.foundation.errors import InputError, PluginError, SceneError, StoreError, shortened
from chemage.foundation.files import check_data, described
from chemage.foundation.messages import nearest
from chemage.plugins import registry
from chemage.scene.scene import Scene, parse_scene

#: fields and sections that no title is about
_UNTITLED = {"name", "title", "seed", "replicas", "ensemble", "accuracy"}


def installed_text(name: str) -> str:
    """The text of an installed scene."""
    target = registry.current().scene_target(name)
    try:
        return registry.scene_text(target)
    except Exception as error:  # whatever importing another's package raises
        raise PluginError(f"the installed scene {name!r} ({target}) cannot be read: {error}") from error


def scene_data(where: str | Path) -> tuple[dict[str, Any], str]:
    """The parsed TOML of a scene file, or of an installed scene by name, and a name for messages.

    A relative ``path`` in a section of a file is taken from the folder of that file.
    """
    path = Path(where)
    plugins = registry.current()
    if path.suffix != ".toml" and str(where) in plugins.scenes():
        text, source, folder = installed_text(str(where)), str(where), None
    else:
        if not _is_there(path):
            names = list(plugins.scenes())
            raise StoreError(
                f"{shortened(where, 200)} is neither a file nor an installed scene{nearest(str(where)[:200], names)}; "
                f"installed: {', '.join(sorted(names)) or 'none'}"
            )
        try:
            text, source, folder = described(path), str(path), path.parent
        except StoreError as error:
            raise StoreError(f"{error}: it cannot be read as a scene") from None
    data = parse_toml(text, source)
    if folder is not None:
        data = located(data, folder)
        wish = data.get("ensemble")
        if isinstance(wish, dict) and isinstance(wish.get("map"), str):
            wish["map"] = str(folder / wish["map"])
    data.setdefault("name", path.stem)
    return data, source


def _is_there(path: Path) -> bool:
    try:
        return os.path.lexists(path)
    except ValueError:  # a null byte in the name
        return False


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The data of a scene in TOML, of a size that can be handled.

    Raises
    ------
    SceneError
        It is not TOML, or nested too deeply, or holds numbers or texts that are too large.
    """
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also whole numbers of thousands of digits
        raise SceneError(source, [("", f"not valid TOML: {shortened(error, 300)}")]) from None
    try:
        check_data(data)
    except InputError as error:
        raise SceneError(source, error.problems) from None
    return data


def located(data: Any, folder: Path) -> Any:
    """A copy of scene data in which every relative ``path``, also one that is swept, starts from ``folder``."""
    if isinstance(data, list):
        return [located(item, folder) for item in data]
    if not isinstance(data, Mapping):
        return data
    made: dict[str, Any] = {}
    for name, value in data.items():
        if name.rpartition(".")[2] != "path":
            made[name] = located(value, folder)
        elif isinstance(value, list):
            made[name] = [str(folder / item) if isinstance(item, str) else item for item in value]
        else:
            made[name] = str(folder / value) if isinstance(value, str) else value
    return made


def override(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of scene data with dotted paths set: ``{"surface.rms_slope": 0.2}``; ``None`` removes what is there.

    The title goes with the values that it is about: it is left out where others than seeds, replicas and requests are
    changed, unless ``changes`` has another.
    """
    copy = deepcopy(dict(data))
    if any(path.partition(".")[0] not in _UNTITLED and path.rpartition(".")[2] not in _UNTITLED for path in changes):
        copy.pop("title", None)
    for path, value in changes.items():
        *parents, last = path.split(".")
        place: Any = copy
        if value is None and parents and parents[0] not in copy:
            continue
        for name in parents:
            place = place[_position(path, name, place)] if isinstance(place, list) else place.setdefault(name, {})
            if not isinstance(place, dict | list):
                raise InputError(f"{path}: {name!r} is a value, not a section", [(path, f"{name!r} is a value")])
        if isinstance(place, list):
            number = _position(path, last, place)
            place[number : number + 1] = [] if value is None else [deepcopy(value)]
        elif value is None:
            place.pop(last, None)
        else:
            place[last] = deepcopy(value)
    return copy


def _position(path: str, name: str, items: list[Any]) -> int:
    if name.isdigit() and int(name) < len(items):
        return int(name)
    problem = f"{name!r} is no position in a list of {len(items)}"
    raise InputError(f"{path}: {problem}", [(path, problem)])


def named(text: str, name: str) -> str:
    """The text of a scene with another name, and without its title; everything else, comments included, stays."""
    lines = text.splitlines()
    line = f"name = {json.dumps(name, ensure_ascii=False)}"
    top = next((at for at, one in enumerate(lines) if one.lstrip().startswith("[")), len(lines))
    lines[:top] = [one for one in lines[:top] if one.partition("=")[0].strip() != "title"]
    old = next((at for at, one in enumerate(lines[:top]) if one.partition("=")[0].strip() == "name"), None)
    if old is None:
        lines.insert(next((at for at, one in enumerate(lines) if not one.startswith("#")), 0), line)
    else:
        lines[old] = line
    return "\n".join(lines) + "\n"


def is_sweep(where: str | Path) -> bool:
    """Whether a scene file or an installed scene has ``[sweep]`` in it."""
    return "sweep" in scene_data(where)[0]


def load_scene(where: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """A validated scene from a TOML file or the name of an installed scene, with dotted-path ``changes`` applied."""
    data, source = scene_data(where)
    data = override(data, changes or {})
    if "sweep" in data:
        raise SceneError(source, [("sweep", "this scene is a sweep of many; use chemage.sweep, or `chemage run`")])
    return parse_scene(data, source)
