"""Scene files: TOML read from a file or from a plugin, with changes applied."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any, get_args

from chemage.foundation.errors import ChemageError, InputError, PluginError, SceneError, StoreError, nearest, shortened
from chemage.foundation.files import check_data, described
from chemage.foundation.units import is_file_path
from chemage.plugins import registry
from chemage.scene.files import parse_scene
from chemage.scene.scene import Scene

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

    A relative path (an option that is a :data:`chemage.plugin.FilePath`) in a file starts from the folder of that file.
    """
    data, source, folder = _parsed(where)
    return (data if folder is None else located(data, folder)), source


def _parsed(where: str | Path) -> tuple[dict[str, Any], str, Path | None]:
    """The data of a scene as they are written, a name for messages, and the folder of the file."""
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
    data.setdefault("name", path.stem)
    return data, source, folder


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


def located(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A copy of scene data in which every relative path, also one that is swept, starts from ``folder``.

    Paths are known by the type of their option, see :data:`chemage.plugin.FilePath`. An option that a kind
    does not have, as where the kind is swept or left to a material, counts as that of any installed kind.
    """
    copy = {name: _located(section, folder, name) for name, section in data.items()}
    plugins, axes = data.get("plugins"), data.get("sweep")
    if isinstance(plugins, Mapping):
        options = {name: _options_classes(name) for name in plugins}
        copy["plugins"] = {name: _in_options(table, folder, options[name]) for name, table in plugins.items()}
    if isinstance(axes, Mapping):
        copy["sweep"] = _located_axes(axes, folder, data, "")
    return copy


def _located_axes(axes: Mapping[str, Any], folder: Path, data: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Axes of a sweep, nested or dotted, of the scene ``data``."""
    copy: dict[str, Any] = {}
    for name, value in axes.items():
        path = f"{prefix}{name}"
        if path == "zip" and isinstance(value, list):
            groups = [group if isinstance(group, Mapping) else {} for group in value]
            copy[name] = [_located_axes(group, folder, data, "") for group in groups] if all(groups) else value
        elif isinstance(value, Mapping):
            copy[name] = _located_axes(value, folder, data, f"{path}.")
        elif isinstance(value, list):
            copy[name] = [_located_at(path, item, folder, data) for item in value]
        else:
            copy[name] = value
    return copy


def _located_at(path: str, value: Any, folder: Path, data: Mapping[str, Any]) -> Any:
    """One value of an axis, in the place that it has in its section."""
    section, *options = path.split(".")
    if not isinstance(value, str | Mapping | list):
        return value
    kind = {"kind": data[section]["kind"]} if options and "kind" in (data.get(section) or ()) else {}
    table = value
    for number, option in enumerate(reversed(options), 1):
        table = {**(kind if number == len(options) else {}), option: table}
    table = _located(table, folder, section)
    for option in options:
        table = table[option]
    return table


def _located(table: Any, folder: Path, section: str) -> Any:
    """The content of a section."""
    for stage in registry.current().stages():
        if role := stage.parts.get(section, "") or (stage.role if stage.section == section else ""):
            return _in_component(table, folder, role)
        if stage.section == section and (model := stage.model()) is not None:
            return _in_options(table, folder, [model])
    return table


def _in_component(table: Any, folder: Path, role: str) -> Any:
    if isinstance(table, list):
        return [_in_component(item, folder, role) for item in table]
    if not isinstance(table, Mapping):
        return table
    kind = table.get("kind")
    own = _kinds(role, kind) if isinstance(kind, str) else []
    complete = all(any(name in cls.model_fields for cls in own) for name in table if name != "kind")
    return _in_options(table, folder, own if complete else _kinds(role))


def _in_options(table: Any, folder: Path, classes: Sequence[Any]) -> Any:
    """The options of one of ``classes``, components among them at any depth."""
    if not isinstance(table, Mapping):
        return table
    copy = dict(table)
    for name, value in table.items():
        fields = [cls.model_fields[name] for cls in classes if name in cls.model_fields]
        if any(is_file_path(field) for field in fields):
            copy[name] = str(folder / value) if isinstance(value, str) else value
        elif isinstance(value, list | Mapping):
            for role in {role for field in fields for role in _roles(field.annotation)}:
                copy[name] = _in_component(copy[name], folder, role)
    return copy


def _kinds(role: str, *kinds: str) -> list[Any]:
    """The classes of these kinds, or of every installed one."""
    plugins = registry.current()
    classes = []
    for kind in kinds or plugins.kinds(role):
        with suppress(ChemageError):  # reported where the scene is read
            classes.append(plugins.component(role, kind))
    return classes


def _options_classes(plugin: str) -> list[Any]:
    with suppress(ChemageError):
        return [registry.current().options_class(plugin)]
    return []


def _roles(annotation: Any) -> Iterator[str]:
    """The roles of the components that a field may hold."""
    if isinstance(annotation, type) and (role := getattr(annotation, "role", "")):
        yield role
    for part in get_args(annotation):
        yield from _roles(part)


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
    top = next((at for at, written in enumerate(lines) if written.lstrip().startswith("[")), len(lines))
    lines[:top] = [written for written in lines[:top] if written.partition("=")[0].strip() != "title"]
    old = next((at for at, written in enumerate(lines[:top]) if written.partition("=")[0].strip() == "name"), None)
    if old is None:
        lines.insert(next((at for at, written in enumerate(lines) if not written.startswith("#")), 0), line)
    else:
        lines[old] = line
    return "\n".join(lines) + "\n"


def is_sweep(where: str | Path) -> bool:
    """Whether a scene file or an installed scene has ``[sweep]`` in it."""
    return "sweep" in _parsed(where)[0]


def load_scene(where: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """A validated scene from a TOML file or the name of an installed scene, with dotted-path ``changes`` applied."""
    data, source = scene_data(where)
    data = override(data, changes or {})
    if "sweep" in data:
        raise SceneError(source, [("sweep", "this scene is a sweep of many; use chemage.sweep, or `chemage run`")])
    return parse_scene(data, source)
