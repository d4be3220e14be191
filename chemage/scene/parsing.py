"""From plain data to a :class:`chemage.Scene`: every section is read as its stage declares it, and all that is wrong is
said at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from pydantic import ValidationError

from chemage.foundation.components import Component
from chemage.foundation.errors import (
    ChemageError,
    InputError,
    PluginError,
    SceneError,
    UnknownKindError,
    explain,
    nearest,
    shown,
)
from chemage.foundation.files import check_data
from chemage.foundation.units import in_words
from chemage.plugins import registry
from chemage.plugins.hooks import Stage
from chemage.plugins.options import PluginOptions, options_for
from chemage.scene.materials import MaterialValue, filled
from chemage.scene.scene import Scene

#: what a scene says beside the sections of its stages
_TOP, _BOTTOM = ("name", "title", "material"), ("plugins", "sweep")


def section_names() -> list[str]:
    """Every section and top-level entry that a scene may have."""
    sections = [name for stage in registry.current().stages() for name in (*stage.parts, stage.section)]
    return [*_TOP, *sections, *_BOTTOM]


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
        if not isinstance(data, Mapping) or not all(isinstance(name, str) for name in data):
            raise SceneError(source, [("", f"{shown(data)} is not a table of sections")])
        try:
            check_data(dict(data))
        except InputError as error:
            raise SceneError(source, error.problems) from None
        self.data, self.material, self.from_material = self._with_material(in_words(data))

    def _with_material(self, data: Mapping[str, Any]) -> tuple[dict[str, Any], str, tuple[MaterialValue, ...]]:
        try:
            data_filled, material, values = filled(data)
        except UnknownKindError as error:
            self.problems.append(("material", str(error)))
            return {name: part for name, part in data.items() if name != "material"}, "", ()
        return data_filled, material.name if material is not None else "", values

    def scene(self) -> Scene:
        stages, names = registry.current().stages(), section_names()
        for name in self.data:
            if name not in names:
                text = f"no such section{nearest(name, names)}; the sections are {', '.join(names)}"
                self.problems.append((name, text))
        for stage in stages:
            self._read(stage)
        prefer, options = self._plugins(self.data.get("plugins", {}))
        if not self.problems:
            for stage in stages:
                self.problems += stage.problems(self.parts)
        if not self.problems:
            try:
                return Scene(
                    **{name: self.data[name] for name in ("name", "title") if name in self.data},
                    **Scene.fields_of(self.parts),
                    plugins=options,
                    prefer=prefer,
                    material=self.material,
                    from_material=self.from_material,
                )
            except ValidationError as error:
                paths = {
                    beside.field: f"{stage.section}.{name}" for stage in stages for name, beside in stage.beside.items()
                }
                self.problems += [(paths.get(path, path), message) for path, message in explain(error)]
        raise SceneError(self.source, self.problems)

    def _take(self, path: str, error: ChemageError) -> None:
        inner = error.problems if isinstance(error, InputError) else []
        self.problems += [(f"{path}.{name}" if name else path, text) for name, text in inner] or [(path, str(error))]

    # -- sections -----------------------------------------------------------------------------------------------------

    def _read(self, stage: Stage) -> None:
        """The parts of one stage."""
        tables = {name: self._table(name) for name in (*stage.parts, stage.section) if not stage.many}
        names = [name for name in (*stage.parts, stage.section) if name in self.data]
        if stage.needs and stage.needs not in self.data:
            missing = {name: text for each in registry.current().stages() for name, text in each.missing.items()}
            text = missing.get(stage.needs, f"needs [{stage.needs}]; add it, or leave this out")
            self.problems += [(name, text) for name in names]
            return
        if stage.many:
            self._read_many(stage)
            return
        if stage.section not in self.data:
            if stage.required:
                self.problems.append((stage.section, "is required; every scene needs a surface and a contact"))
            elif stage.required_with and stage.required_with[0] in self.data:
                self.problems.append((stage.section, stage.required_with[1]))
        options = tables[stage.section]
        beside = {name: options.pop(name, None) for name in stage.beside} if options is not None else {}
        for name, role in stage.parts.items():
            if (table := tables[name]) is not None:
                self._set(name, self._component(role, name, table))
        if options is not None or (stage.parts and names):
            self._set(stage.section, self._value(stage, options or {}))
        for name, value in beside.items():
            try:
                self._set(f"{stage.section}.{name}", stage.read_beside(name, value, self.parts))
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
        self.problems.append((name, f"{shown(section)} is not a section; write [{name}] with options below it"))
        return None

    def _read_many(self, stage: Stage) -> None:
        items, name = self.data.get(stage.section, []), stage.section
        if not isinstance(items, list):
            self.problems.append((name, f"write each {stage.role} as [[{name}]] with its kind"))
            return
        components = []
        for number, item in enumerate(items):
            path = f"{name}.{number}"
            if isinstance(item, Mapping):
                components.append(self._component(stage.role, path, dict(item)))
            else:
                self.problems.append((path, f"{shown(item)} is not a section; write [[{name}]] with its kind"))
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
            self.problems.append((f"{name}.{part}", f"is a section of its own; write [{part}]"))
            del options[part]
        parts = {part: self.parts[part] for part in stage.parts if part in self.parts}
        if any(part not in parts for part in stage.parts if model.model_fields[part].is_required()):
            return None  # what is wrong with it is said
        return self._made(partial(model, **parts), stage, options)

    def _made(self, make: Callable[..., Any], stage: Stage, options: dict[str, Any]) -> Any:
        """What ``make`` returns; None, and what is wrong is noted, where it refuses the options."""
        model, name = stage.model(), stage.section
        try:
            return make(options) if model is None else make(**options)
        except ValidationError as error:
            options_known = list(model.model_fields) if model is not None else []
            self.problems += [
                (path, text + nearest(path.rpartition(".")[2], options_known) if text == "no such option" else text)
                for path, text in explain(error, name)
            ]
        except InputError as error:
            self._take(name, error)
        return None

    def _component(self, role: str, path: str, options: dict[str, Any]) -> Component | None:
        plugins = registry.current()
        kind = options.pop("kind", None)
        if not isinstance(kind, str):
            installed = ", ".join(plugins.kinds(role)) or "none"
            self.problems.append((f"{path}.kind", f"is required; installed: {installed}"))
            return None
        try:
            return plugins.make(role, kind, options)
        except PluginError:
            raise
        except ChemageError as error:
            self._take(path if getattr(error, "problems", None) else f"{path}.kind", error)
            return None

    # -- plugins ------------------------------------------------------------------------------------------------------

    def _plugins(self, section: Any) -> tuple[tuple[str, ...], dict[str, PluginOptions]]:
        options: dict[str, PluginOptions] = {}
        if not isinstance(section, Mapping):
            text = f"{section!r} is not a section; write [plugins.NAME] with options below it"
            self.problems.append(("plugins", text))
            return (), options
        prefer = section.get("prefer", [])
        try:
            if not isinstance(prefer, list | tuple) or not all(isinstance(name, str) for name in prefer):
                raise InputError(f'{prefer!r}: give a list of names of plugins, such as ["my-plugin"]')
            registry.current().check_preference(prefer, "it")
        except InputError as error:
            self.problems.append(("plugins.prefer", str(error)))
        for name, table in section.items():
            path = f"plugins.{name}"
            if name == "prefer":
                continue
            if not isinstance(table, Mapping):
                self.problems.append((path, f"{table!r} is not a section; write [{path}] with options below it"))
                continue
            try:
                options[name] = options_for(name, table)
            except InputError as error:
                self._take(path, error)
        return tuple(prefer), options
