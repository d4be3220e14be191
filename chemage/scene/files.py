"""Scenes as they are written: TOML read from a file or from a plugin, with changes applied, and made a scene."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any, get_args

from chemage.foundation.components import Component
from chemage.foundation.errors import (
    ChemageError,
    InputError,
    PluginError,
    SceneError,
    StoreError,
    UnknownKindError,
    nearest,
    shortened,
    shown,
)
from chemage.foundation.files import DEEPEST, MOST_NAMES, check_data, described
from chemage.foundation.units import in_words, is_file_path
from chemage.plugins import context, registry
from chemage.plugins.hooks import BOTTOM, TOP, Stage
from chemage.plugins.loading import OWN
from chemage.plugins.options import PluginOptions, options_for
from chemage.scene.materials import MaterialValue, filled
from chemage.scene.scene import Scene


def section_names() -> list[str]:
    """Every section and top-level entry that a scene may have."""
    sections = [
        name
        for stage in registry.current().stages()
        for name in (*stage.parts, stage.section)
    ]
    return [*TOP, *sections, *BOTTOM]


def required_sections() -> list[str]:
    """The sections that no scene can do without."""
    return [stage.section for stage in registry.current().stages() if stage.required]


def parse_scene(data: Mapping[str, Any], source: str = "the scene") -> Scene:
    """A validated scene from plain data (a parsed TOML file); ``[sweep]`` must have been taken out before.

    Raises
    ------
    SceneError
        Listing everything that is wrong, each with its path in the file.
    """
    return _Parser(data, source).scene()


class _Parser:
    """Reads one scene, and collects what is wrong."""

    def __init__(self, data: Mapping[str, Any], source: str) -> None:
        self.source = source
        self.problems: list[tuple[str, str]] = []
        #: what stages are given, see chemage.plugins.hooks
        self.parts: dict[str, Any] = {}
        if not isinstance(data, Mapping) or not all(
            isinstance(name, str) for name in data
        ):
            raise SceneError(
                source, [("", f"{shown(data)} is not a table of sections")]
            )
        try:
            check_data(dict(data), MOST_NAMES)
        except InputError as error:
            raise SceneError(source, error.problems) from None
        self.data = in_words(data)
        self.prefer, self.options = self._plugins(self.data.get("plugins", {}))

    def _fill(self) -> tuple[str, tuple[MaterialValue, ...]]:
        """Complete the data with the values of the material: its name, and the values."""
        try:
            self.data, material, values = filled(self.data)
        except UnknownKindError as error:
            self.problems.append(("material", str(error)))
            self.data.pop("material")
            return "", ()
        return material.name if material is not None else "", values

    def scene(self) -> Scene:
        # the kinds of this scene are those of the plugins that it prefers
        with context.applied(context.options(), self.prefer or None):
            return self._scene()

    def _scene(self) -> Scene:
        material, from_material = self._fill()
        stages, names = registry.current().stages(), section_names()
        for name in self.data:
            if name not in names:
                text = f"no such section{nearest(name, names)}; the sections are {', '.join(names)}"
                self.problems.append((name, text))
        for stage in stages:
            self._read(stage)
        if not self.problems:
            for stage in stages:
                self.problems += stage.problems(self.parts)
        if not self.problems:
            try:
                return Scene(
                    **{
                        name: self.data[name]
                        for name in ("name", "title")
                        if name in self.data
                    },
                    **Scene.fields_of(self.parts),
                    plugins=self.options,
                    prefer=self.prefer,
                    material=material,
                    from_material=from_material,
                )
            except InputError as error:
                paths = {
                    beside.field: f"{stage.section}.{name}"
                    for stage in stages
                    for name, beside in stage.beside.items()
                }
                self.problems += [
                    (paths.get(path, path), message) for path, message in error.problems
                ]
        raise SceneError(self.source, self.problems)

    def _take(self, path: str, error: ChemageError) -> None:
        inner = error.problems if isinstance(error, InputError) else []
        self.problems += [
            (f"{path}.{name}" if name else path, text) for name, text in inner
        ] or [(path, str(error))]

    # -- sections -----------------------------------------------------------------------------------------------------

    def _read(self, stage: Stage) -> None:
        """The parts of one stage."""
        tables = {
            name: self._table(name)
            for name in (*stage.parts, stage.section)
            if not stage.many
        }
        names = [name for name in (*stage.parts, stage.section) if name in self.data]
        if stage.needs and stage.needs not in self.data:
            missing = {
                name: text
                for each in registry.current().stages()
                for name, text in each.missing.items()
            }
            text = missing.get(
                stage.needs, f"needs [{stage.needs}]; add it, or leave this out"
            )
            self.problems += [(name, text) for name in names]
            return
        if stage.many:
            self._read_many(stage)
            return
        if stage.section not in self.data:
            if stage.required:
                self.problems.append(
                    (
                        stage.section,
                        "is required; every scene needs a surface and a contact",
                    )
                )
            elif stage.required_with and stage.required_with[0] in self.data:
                self.problems.append((stage.section, stage.required_with[1]))
        options = tables[stage.section]
        beside = (
            {name: options.pop(name, None) for name in stage.beside}
            if options is not None
            else {}
        )
        for name, role in stage.parts.items():
            if (table := tables[name]) is not None:
                self._set(name, self._component(role, name, table))
        if options is not None or (stage.parts and names):
            self._set(stage.section, self._value(stage, options or {}))
        for name, value in beside.items():
            try:
                self._set(
                    f"{stage.section}.{name}",
                    stage.read_beside(name, value, self.parts),
                )
            except ChemageError as error:
                text = str(error).removeprefix(f"{name} = ").removeprefix(f"{name}: ")
                self.problems.append((f"{stage.section}.{name}", text))

    def _set(self, path: str, value: Any) -> None:
        if value is not None:
            self.parts[path] = value

    def _table(self, name: str) -> dict[str, Any] | None:
        section = self.data.get(name)
        if section is None or isinstance(section, Mapping):
            return None if section is None else dict(section)
        self.problems.append(
            (
                name,
                f"{shown(section)} is not a section; write [{name}] with options below it",
            )
        )
        return None

    def _read_many(self, stage: Stage) -> None:
        items, name = self.data.get(stage.section, []), stage.section
        if not isinstance(items, list):
            self.problems.append(
                (name, f"write each {stage.role} as [[{name}]] with its kind")
            )
            return
        components = []
        for number, item in enumerate(items):
            path = f"{name}.{number}"
            if isinstance(item, Mapping):
                components.append(self._component(stage.role, path, dict(item)))
            else:
                self.problems.append(
                    (
                        path,
                        f"{shown(item)} is not a section; write [[{name}]] with its kind",
                    )
                )
        if components:
            self.parts[name] = tuple(components)

    def _value(self, stage: Stage, options: dict[str, Any]) -> Any:
        """The component of a section, or what else its options mean."""
        name, model = stage.section, stage.model()
        if stage.role:
            return self._component(stage.role, name, options)
        if model is None:
            return self._made(stage.make, stage, options)
        for part in [part for part in stage.parts if part in options]:
            self.problems.append(
                (f"{name}.{part}", f"is a section of its own; write [{part}]")
            )
            del options[part]
        parts = {part: self.parts[part] for part in stage.parts if part in self.parts}
        if any(
            part not in parts
            for part in stage.parts
            if model.model_fields[part].is_required()
        ):
            return None  # what is wrong with it is said
        return self._made(partial(model, **parts), stage, options)

    def _made(
        self, make: Callable[..., Any], stage: Stage, options: dict[str, Any]
    ) -> Any:
        """What ``make`` returns; None, and what is wrong is noted, where it refuses the options."""
        model, name = stage.model(), stage.section
        try:
            return make(options) if model is None else make(**options)
        except InputError as error:
            self._take(name, error)
        return None

    def _component(
        self, role: str, path: str, options: dict[str, Any]
    ) -> Component | None:
        plugins = registry.current()
        kind = options.pop("kind", None)
        if not isinstance(kind, str):
            installed = ", ".join(plugins.kinds(role)) or "none"
            self.problems.append(
                (f"{path}.kind", f"is required; installed: {installed}")
            )
            return None
        try:
            return plugins.make(role, kind, options)
        except PluginError:
            raise
        except ChemageError as error:
            self._take(
                path if getattr(error, "problems", None) else f"{path}.kind", error
            )
            return None

    # -- plugins ------------------------------------------------------------------------------------------------------

    def _plugins(
        self, section: Any
    ) -> tuple[tuple[str, ...], dict[str, PluginOptions]]:
        options: dict[str, PluginOptions] = {}
        if not isinstance(section, Mapping):
            text = f"{section!r} is not a section; write [plugins.NAME] with options below it"
            self.problems.append(("plugins", text))
            return (), options
        prefer = section.get("prefer", [])
        try:
            if not isinstance(prefer, list | tuple) or not all(
                isinstance(name, str) for name in prefer
            ):
                raise InputError(
                    f'{shown(prefer)}: give a list of names of plugins, such as ["my-plugin"]'
                )
            registry.current().check_preference(prefer, "it")
        except InputError as error:
            self.problems.append(("plugins.prefer", str(error)))
            prefer = ()
        for name, table in section.items():
            path = f"plugins.{name}"
            if name == "prefer":
                continue
            if not isinstance(table, Mapping):
                self.problems.append(
                    (
                        path,
                        f"{table!r} is not a section; write [{path}] with options below it",
                    )
                )
                continue
            try:
                options[name] = options_for(name, table)
            except InputError as error:
                self._take(path, error)
        return tuple(prefer), options


#: a key of TOML with too many parts
_DEEP_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{DEEPEST + 1}}}"""
)

#: fields and sections that no title is about
_UNTITLED = {"name", "title", "seed", "replicas", "ensemble", "accuracy"}


def installed_text(name: str) -> str:
    """The text of an installed scene."""
    target = registry.current().target("scenes", name)[1]
    try:
        return registry.scene_text(target)
    except Exception as error:  # whatever importing another's package raises
        raise PluginError(
            f"the installed scene {name!r} ({target}) cannot be read: {error}"
        ) from error


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
    if folder is None and (record := plugins.target("scenes", source)[0]).owner != OWN:
        _qualify(data, record)
    data.setdefault(
        "name", os.fsencode(path.stem).decode(errors="replace")
    )  # also where the locale is ASCII
    return data, source, folder


def _qualify(data: dict[str, Any], brought_by: registry.PluginRecord) -> None:
    """Let a kind that several plugins have be that of the plugin whose scene it is."""
    plugins = registry.current()
    for stage in plugins.stages():
        for name, role in {**stage.parts, stage.section: stage.role}.items():
            section = data.get(name)
            for table in section if isinstance(section, list) else [section]:
                if not isinstance(table, dict):
                    continue
                kind = table.get("kind")
                if (
                    isinstance(kind, str)
                    and brought_by.own_kind(role, kind) == kind
                    and len(plugins.offers(role, kind)) > 1
                ):
                    table["kind"] = f"{brought_by.owner}:{kind}"


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
    if _DEEP_KEY.search(
        text
    ):  # tomllib takes a time that grows with the square of the length of a key
        raise SceneError(
            source, [("", f"a key of more than {DEEPEST} parts; write it flatter")]
        )
    try:
        data = tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as error:  # also whole numbers of thousands of digits
        raise SceneError(
            source, [("", f"not valid TOML: {shortened(error, 300)}")]
        ) from None
    try:
        check_data(data, MOST_NAMES)
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
        copy["plugins"] = {
            name: _in_options(table, folder, options[name])
            for name, table in plugins.items()
        }
    if isinstance(axes, Mapping):
        copy["sweep"] = _located_axes(axes, folder, data, "")
    return copy


def _located_axes(
    axes: Mapping[str, Any], folder: Path, data: Mapping[str, Any], prefix: str
) -> dict[str, Any]:
    """Axes of a sweep, nested or dotted, of the scene ``data``."""
    copy: dict[str, Any] = {}
    for name, value in axes.items():
        path = f"{prefix}{name}"
        if path == "zip" and isinstance(value, list):
            groups = [group if isinstance(group, Mapping) else {} for group in value]
            copy[name] = (
                [_located_axes(group, folder, data, "") for group in groups]
                if all(groups)
                else value
            )
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
    kind = (
        {"kind": data[section]["kind"]}
        if options and "kind" in (data.get(section) or ())
        else {}
    )
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
        if role := stage.parts.get(section, "") or (
            stage.role if stage.section == section else ""
        ):
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
    complete = all(
        any(name in cls.model_fields for cls in own) for name in table if name != "kind"
    )
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
    if any(
        path.partition(".")[0] not in _UNTITLED
        and path.rpartition(".")[2] not in _UNTITLED
        for path in changes
    ):
        copy.pop("title", None)
    for path, value in changes.items():
        *parents, last = path.split(".")
        place: Any = copy
        if value is None and parents and parents[0] not in copy:
            continue
        for name in parents:
            place = (
                place[_position(path, name, place)]
                if isinstance(place, list)
                else place.setdefault(name, {})
            )
            if not isinstance(place, dict | list):
                raise InputError(
                    f"{path}: {name!r} is a value, not a section",
                    [(path, f"{name!r} is a value")],
                )
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
    top = next(
        (at for at, written in enumerate(lines) if written.lstrip().startswith("[")),
        len(lines),
    )
    lines[:top] = [
        written
        for written in lines[:top]
        if written.partition("=")[0].strip() != "title"
    ]
    old = next(
        (
            at
            for at, written in enumerate(lines[:top])
            if written.partition("=")[0].strip() == "name"
        ),
        None,
    )
    if old is None:
        lines.insert(
            next(
                (at for at, written in enumerate(lines) if not written.startswith("#")),
                0,
            ),
            line,
        )
    else:
        lines[old] = line
    return "\n".join(lines) + "\n"


def is_sweep(where: str | Path) -> bool:
    """Whether a scene file or an installed scene has ``[sweep]`` in it."""
    return "sweep" in _parsed(where)[0]


def load_scene(
    where: Scene | str | Path | Mapping[str, Any],
    changes: Mapping[str, Any] | None = None,
) -> Scene:
    """A validated scene from a TOML file, the name of an installed scene, scene data or another scene, with dotted-path
    ``changes`` applied."""
    if isinstance(where, Scene):
        if not changes:
            return where
        scene = parse_scene(override(where.todict(), changes))
        # what the material gave is written out in the data
        return scene.model_copy(
            update={"material": where.material, "from_material": where.from_material}
        )
    data, source = (
        (where, "the scene") if isinstance(where, Mapping) else scene_data(where)
    )
    data = override(data, changes or {})
    if "sweep" in data:
        raise SceneError(
            source,
            [
                (
                    "sweep",
                    "this scene is a sweep of many; use chemage.sweep, or `chemage run`",
                )
            ],
        )
    return parse_scene(data, source)
