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

from chemage.foundation.errors import ChemageError, InputError, PluginError, SceneError, StoreError, shortened
from chemage.foundation.inputs import check_data, described
from chemage.foundation.messages import nearest
from chemage.foundation.units import is_file_path
from chemage.plugins import registry
from chemage.scene.parsing import parse_scene
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

    A relative path (an option that is a :data:`chemage.FilePath`) in a file is taken from the folder of that file.
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

    Paths are known by the type of their option, see :data:`chemage.FilePath`. Where the kind of a component is swept,
    or not said, an option counts that is one of any installed kind.
    """
    copy = {name: _located(section, folder, *_classes(name, section)) for name, section in data.items()}
    plugins = data.get("plugins")
    if isinstance(plugins, Mapping):
        copy["plugins"] = {
            name: _located(options, folder, *_options_classes(name)) for name, options in plugins.items()
        }
    if isinstance(data.get("sweep"), Mapping):
        groups = [data["sweep"], *(data["sweep"].get("zip") or ())]
        copy["sweep"] = _located_axes(data["sweep"], folder, {**data, **{name: {} for name in _swept_kinds(groups)}})
    return copy


def _swept_kinds(groups: Sequence[Any]) -> Iterator[str]:
    """The sections whose kind is swept."""
    for group in groups:
        for name, lines in group.items() if isinstance(group, Mapping) else ():
            if name.endswith(".kind") or (isinstance(lines, Mapping) and "kind" in lines):
                yield name.removesuffix(".kind")


def _located_axes(axes: Any, folder: Path, data: Mapping[str, Any], parents: tuple[str, ...] = ()) -> Any:
    """Axes of a sweep, nested or dotted, of the scene ``data``."""
    if not isinstance(axes, Mapping):
        return axes
    copy: dict[str, Any] = {}
    for name, value in axes.items():
        if name == "zip" and not parents and isinstance(value, list):
            copy[name] = [_located_axes(group, folder, data) for group in value]
        elif isinstance(value, Mapping):
            copy[name] = _located_axes(value, folder, data, (*parents, name))
        else:
            section, *options = [word for parent in (*parents, name) for word in parent.split(".")]
            items = value if isinstance(value, list) else [value]
            for option in reversed(options):
                items = [{option: item} for item in items]
            tables = [data.get(section) if options else item for item in items]
            items = [
                _located(item, folder, *_classes(section, table)) for item, table in zip(items, tables, strict=True)
            ]
            for option in options:
                items = [item[option] for item in items]
            copy[name] = items if isinstance(value, list) else items[0]
    return copy


def _located(table: Any, folder: Path, *classes: Any) -> Any:
    """The options of a component of one of ``classes``, at any depth."""
    if isinstance(table, list):
        return [_located(item, folder, *classes) for item in table]
    if not isinstance(table, Mapping):
        return table
    copy = dict(table)
    for name, value in table.items():
        fields = [cls.model_fields[name] for cls in classes if name in cls.model_fields]
        if any(is_file_path(field) for field in fields):
            copy[name] = str(folder / value) if isinstance(value, str) else value
        elif isinstance(value, list | Mapping):
            roles = {role for field in fields for role in _roles(field.annotation)}
            copy[name] = _located(value, folder, *(cls for role in roles for cls in _kinds(role, value)))
    return copy


def _classes(section: str, table: Any) -> list[Any]:
    """The classes whose options may stand in a section."""
    for stage in registry.current().stages():
        role = stage.role if stage.section == section else stage.parts.get(section, "")
        if role:
            return _kinds(role, table)
        if stage.section == section:
            return [model] if (model := stage.model()) is not None else []
    return []


def _kinds(role: str, table: Any) -> list[Any]:
    """The class of a component, or every installed one of its role where its kind is not said."""
    plugins = registry.current()
    kind = table.get("kind") if isinstance(table, Mapping) else None
    classes = []
    for name in [kind] if isinstance(kind, str) else plugins.kinds(role):
        with suppress(ChemageError):  # reported where the scene is read
            classes.append(plugins.component(role, name))
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
    return "sweep" in _parsed(where)[0]


def load_scene(where: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """A validated scene from a TOML file or the name of an installed scene, with dotted-path ``changes`` applied."""
    data, source = scene_data(where)
    data = override(data, changes or {})
    if "sweep" in data:
        raise SceneError(source, [("sweep", "this scene is a sweep of many; use chemage.sweep, or `chemage run`")])
    return parse_scene(data, source)
