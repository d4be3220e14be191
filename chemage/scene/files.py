"""Scenes as they are written: TOML read from a file or from a plugin, with changes applied, and made a scene."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from copy import deepcopy
from itertools import takewhile
from pathlib import Path
from typing import Any, get_args

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.checks import is_table
from chemage.foundation.components import Component
from chemage.foundation.errors import (
    NO_OPTION,
    ChemageError,
    InputError,
    PluginError,
    SceneError,
    StoreError,
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
from chemage.scene.materials import filled
from chemage.scene.scene import Scene


def section_names() -> list[str]:
    """Every section and top-level entry that a scene may have."""
    return [
        *TOP,
        *(name for stage in registry.stages() for name in stage.roles),
        *BOTTOM,
    ]


def required_sections() -> list[str]:
    """The sections that no scene can do without."""
    return [stage.section for stage in registry.stages() if stage.required]


def parse_scene(data: Fields, source: str = "the scene") -> Scene:
    """A validated scene from plain data (a parsed TOML file); ``[sweep]`` must have been taken out before.

    Raises
    ------
    SceneError
        Listing everything that is wrong, each with its path in the file.
    """
    parser = _Parser(data, source)
    # the kinds of this scene are those of the plugins that it prefers
    with context.applied(context.options(), parser.prefer or None):
        return parser.scene()


class _Parser:
    """Reads one scene, and collects what is wrong."""

    def __init__(self, data: Fields, source: str) -> None:
        self.source = source
        self.problems: list[tuple[str, str]] = []
        #: what stages are given, see chemage.plugins.hooks
        self.parts: Data = {}
        if not is_table(data):
            problem = f"{shown(data)} is not a table of sections"
            raise SceneError(source, [("", problem)])
        try:
            check_data(dict(data), MOST_NAMES)
        except InputError as error:
            raise SceneError(source, error.problems) from None
        self.data = in_words(data)
        self.prefer: tuple[str, ...] = ()
        self.options: dict[str, PluginOptions] = {}
        self._read_plugins(self.data.get("plugins", {}))

    @contextmanager
    def _noting(self, path: str, place: str = "") -> Iterator[None]:
        """Note what is wrong with what stands at ``path`` and go on: at its options, or else at its ``place``."""
        try:
            yield
        except PluginError:
            raise
        except ChemageError as error:
            problems = getattr(error, "problems", None) or [(place, str(error))]
            for name, text in problems:
                self.problems.append((f"{path}.{name}" if name else path, text))

    def scene(self) -> Scene:
        material, from_material = None, ()
        with self._noting("material"):
            self.data, material, from_material = filled(self.data)
        self.data.pop("material", None)
        stages, names = registry.stages(), section_names()
        self._fill(stages)
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
                        k: self.data[k] for k in ("name", "title") if k in self.data
                    },
                    **Scene.fields_of(self.parts),
                    plugins=self.options,
                    prefer=self.prefer,
                    material="" if material is None else material.name,
                    from_material=from_material,
                )
            except InputError as error:
                paths = {
                    beside.field: path
                    for stage in stages
                    for path, beside in stage.entries.items()
                }
                for name, text in error.problems:
                    self.problems.append((paths.get(name, name), text))
        raise SceneError(self.source, self.problems)

    # -- sections -----------------------------------------------------------------------------------------------------

    def _fill(self, stages: Sequence[Stage]) -> None:
        """Add what some sections decide of others."""
        for stage in stages:
            decided = stage.fills(self.data) if stage.section in self.data else {}
            for section, options in decided.items():
                given = self.data.setdefault(section, {})
                if isinstance(given, Mapping):
                    self.problems += [
                        (
                            f"{section}.{name}",
                            f"[{stage.section}] says it; leave this out",
                        )
                        for name in options.keys() & given.keys()
                    ]
                    self.data[section] = {**given, **options}

    def _read(self, stage: Stage) -> None:
        """The parts of one stage."""
        given = [name for name in stage.roles if name in self.data]
        tables = {} if stage.many else self._tables(given)
        if stage.needs and stage.needs not in self.data:
            missing = {
                name: text
                for each in registry.stages()
                for name, text in each.missing.items()
            }
            text = missing.get(
                stage.needs, f"needs [{stage.needs}]; add it, or leave this out"
            )
            self.problems += [(name, text) for name in given]
            return
        if stage.many:
            self._read_many(stage)
            return
        if stage.section not in self.data:
            if stage.required:
                text = "is required; every scene needs a surface and a contact"
                self.problems.append((stage.section, text))
            elif stage.required_with and stage.required_with[0] in self.data:
                self.problems.append((stage.section, stage.required_with[1]))
        options = tables.pop(stage.section, None)
        beside = (
            {}
            if options is None
            else {k: options.pop(k, None) for k in stage.beside}
        )
        for name, table in tables.items():
            with self._noting(name, "kind"):
                self.parts[name] = _component(stage.roles[name], table)
        if options is not None or (stage.parts and given):
            with self._noting(stage.section, "kind" if stage.role else ""):
                self._set(stage.section, self._value(stage, options or {}))
        for name, value in beside.items():
            path = f"{stage.section}.{name}"
            try:
                self._set(path, stage.read_beside(name, value, self.parts))
            except ChemageError as error:
                text = (
                    str(error).removeprefix(f"{name} = ").removeprefix(f"{name}: ")
                )
                self.problems.append((path, text))

    def _set(self, path: str, value: Any) -> None:
        if value is not None:
            self.parts[path] = value

    def _tables(self, names: Sequence[str]) -> dict[str, Data]:
        tables = {}
        for name in names:
            section = self.data[name]
            if isinstance(section, Mapping):
                tables[name] = dict(section)
            elif section is not None:
                text = f"{shown(section)} is not a section; write [{name}] with options below it"
                self.problems.append((name, text))
        return tables

    def _read_many(self, stage: Stage) -> None:
        items, name = self.data.get(stage.section, []), stage.section
        if not isinstance(items, list):
            self.problems.append((name, f"write each as [[{name}]]"))
            return
        components = []
        for number, item in enumerate(items):
            path = f"{name}.{number}"
            if isinstance(item, Mapping):
                with self._noting(path, "kind" if stage.role else ""):
                    components.append(self._value(stage, dict(item)))
            else:
                text = f"{shown(item)} is not a section; write [[{name}]] with options below it"
                self.problems.append((path, text))
        if components:
            self.parts[name] = tuple(components)

    def _value(self, stage: Stage, options: Data) -> Any:
        """The component of a section, or what else its options mean; None where a part is missing, which is noted."""
        if stage.role:
            return _component(stage.role, options, stage.beside)
        model = stage.model()
        if model is None:
            return stage.make(options)
        for part in [part for part in stage.parts if part in options]:
            text = f"is a section of its own; write [{part}]"
            self.problems.append((f"{stage.section}.{part}", text))
            del options[part]
        parts = {
            part: self.parts[part] for part in stage.parts if part in self.parts
        }
        for part in stage.parts:
            if part not in parts and model.model_fields[part].is_required():
                return None
        return model(**parts, **options)

    def _read_plugins(self, section: Any) -> None:
        if not isinstance(section, Mapping):
            text = f"{section!r} is not a section; write [plugins.NAME] with options below it"
            self.problems.append(("plugins", text))
            return
        tables = dict(section)
        prefer = tables.pop("prefer", [])
        with self._noting("plugins.prefer"):
            if not isinstance(prefer, list | tuple) or not all(
                isinstance(name, str) for name in prefer
            ):
                raise InputError(
                    f'{shown(prefer)}: give a list of names of plugins, such as ["my-plugin"]'
                )
            registry.current().check_preference(prefer, "it")
            self.prefer = tuple(prefer)
        for name, table in tables.items():
            path = f"plugins.{name}"
            with self._noting(path):
                if not isinstance(table, Mapping):
                    raise InputError(
                        f"{table!r} is not a section; write [{path}] with options below it"
                    )
                self.options[name] = options_for(name, table)


def _component(role: str, options: Data, beside: Iterable[str] = ()) -> Component:
    plugins = registry.current()
    kind = options.pop("kind", None)
    if not isinstance(kind, str):
        installed = ", ".join(plugins.kinds(role)) or "none"
        raise InputError("", [("kind", f"is required; installed: {installed}")])
    try:
        return plugins.make(role, kind, options)
    except InputError as error:
        for at, (name, text) in enumerate(error.problems):
            if text.startswith(NO_OPTION) and "." not in name:
                all_options = plugins.component(role, kind).no_option(name, beside)
                error.problems[at] = name, all_options
        raise


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


def scene_data(where: str | Path) -> tuple[Data, str]:
    """The parsed TOML of a scene file, or of an installed scene by name, and a name for messages.

    A relative path (an option that is a :data:`chemage.plugin.FilePath`) in a file starts from the folder of that file.
    """
    data, source, folder = _parsed(where)
    return (data if folder is None else located(data, folder)), source


def _parsed(where: str | Path) -> tuple[Data, str, Path | None]:
    """The data of a scene as they are written, a name for messages, and the folder of the file."""
    path = Path(where)
    plugins = registry.current()
    if path.suffix != ".toml" and str(where) in plugins.scenes():
        text, source, folder = installed_text(str(where)), str(where), None
    else:
        if not os.path.lexists(path):
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
    if (
        folder is None
        and (record := plugins.target("scenes", source)[0]).owner != OWN
    ):
        _qualify(data, record)
    data.setdefault(
        "name", os.fsencode(path.stem).decode(errors="replace")
    )  # also where the locale is ASCII
    return data, source, folder


def _qualify(data: Data, brought_by: registry.PluginRecord) -> None:
    """Let a kind that several plugins have be that of the plugin whose scene it is."""
    plugins = registry.current()
    for stage in plugins.stages():
        for name, role in stage.roles.items():
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


def parse_toml(text: str, source: str) -> Data:
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


def located(data: Fields, folder: Path) -> Data:
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


def _located_axes(axes: Fields, folder: Path, data: Fields, prefix: str) -> Data:
    """Axes of a sweep, nested or dotted, of the scene ``data``."""
    copy: Data = {}
    for name, value in axes.items():
        path = f"{prefix}{name}"
        if path == "zip" and isinstance(value, list):
            groups = [
                group if isinstance(group, Mapping) else {} for group in value
            ]
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


def _located_at(path: str, value: Any, folder: Path, data: Fields) -> Any:
    """One value of an axis, in the place that it has in its section."""
    section, *options = path.split(".")
    if not isinstance(value, str | Mapping | list):
        return value
    table: Any = {}
    if options and "kind" in (data.get(section) or ()):
        table = {section: {"kind": data[section]["kind"]}}
    table = _located(override(table, {path: value})[section], folder, section)
    for option in options:
        table = table[option]
    return table


def _located(table: Any, folder: Path, section: str) -> Any:
    """The content of a section."""
    for stage in registry.stages():
        if role := stage.roles.get(section):
            copy = _in_component(table, folder, role)
            if stage.section == section and isinstance(copy, dict):
                for name in copy.keys() & stage.beside.keys():
                    copy[name] = stage.locate_beside(name, copy[name], folder)
            return copy
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
    known = {"kind", *(name for cls in own for name in cls.model_fields)}
    return _in_options(
        table, folder, own if known >= table.keys() else _kinds(role)
    )


def _in_options(table: Any, folder: Path, classes: Sequence[Any]) -> Any:
    """The options of one of ``classes``, components among them at any depth."""
    if not isinstance(table, Mapping):
        return table
    copy = dict(table)
    for name, value in table.items():
        fields = [
            cls.model_fields[name] for cls in classes if name in cls.model_fields
        ]
        if any(is_file_path(field) for field in fields):
            copy[name] = str(folder / value) if isinstance(value, str) else value
        elif isinstance(value, list | Mapping):
            for role in {
                role for field in fields for role in _roles(field.annotation)
            }:
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


def value_at(data: Fields, path: str) -> Any:
    """The value at a dotted path of scene data; None where there is none."""
    place: Any = data
    for name in path.split("."):
        place = place.get(name) if isinstance(place, Mapping) else None
    return place


def override(data: Fields, changes: Fields) -> Data:
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
    line = f"name = {json.dumps(name, ensure_ascii=False)}"
    lines, top = [], True
    for written in text.splitlines():
        key = written.partition("=")[0].strip()
        top = top and not key.startswith("[")
        if top and key == "name":
            lines.append(line)
        elif not (top and key == "title"):
            lines.append(written)
    if line not in lines:
        comments = list(takewhile(lambda written: written.startswith("#"), lines))
        lines.insert(len(comments), line)
    return "\n".join(lines) + "\n"


def is_sweep(where: str | Path) -> bool:
    """Whether a scene file or an installed scene has ``[sweep]`` in it."""
    return "sweep" in _parsed(where)[0]


def load_scene(
    where: Scene | str | Path | Fields,
    changes: Fields | None = None,
) -> Scene:
    """A validated scene from a TOML file, the name of an installed scene, scene data or another scene, with dotted-path
    ``changes`` applied."""
    if isinstance(where, Scene):
        if not changes:
            return where
        scene = parse_scene(override(where.todict(), changes))
        # what the material gave is written out in the data
        return scene.model_copy(
            update={
                "material": where.material,
                "from_material": where.from_material,
            }
        )
    data, source = (
        (where, "the scene") if isinstance(where, Mapping) else scene_data(where)
    )
    data = override(data, changes or {})
    if "sweep" in data:
        problem = (
            "this scene is a sweep of many; use chemage.sweep, or `chemage run`"
        )
        raise SceneError(source, [("sweep", problem)])
    return parse_scene(data, source)
