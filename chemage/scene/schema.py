"""The JSON Schema of scene files, with every installed plugin's options in it."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pydantic.json_schema import models_json_schema

from chemage.foundation.aliases import Data
from chemage.foundation.checks import meanings
from chemage.foundation.components import Component
from chemage.foundation.errors import PluginError
from chemage.plugins import registry
from chemage.plugins.hooks import Stage
from chemage.scene.materials import material


def scene_schema() -> Data:
    """JSON Schema (2020-12) of a scene, for editors that complete and check TOML."""
    plugins = registry.current()
    stages, kinds = plugins.stages(), _kinds(plugins)
    components: dict[str, list[Any]] = {role: [] for role in plugins.roles}
    for cls in kinds:
        components[cls.role].append(cls)
    models = [*kinds, *filter(None, (stage.model() for stage in stages))]
    refs, top = models_json_schema([(model, "validation") for model in models])
    definitions = top.get("$defs", {})

    def target(model: Any) -> str:
        return refs[model, "validation"]["$ref"].removeprefix("#/$defs/")

    for model, names in kinds.items():
        part = definitions[target(model)]
        part["properties"] = {"kind": {"enum": names}, **part.get("properties", {})}
        part["required"] = ["kind", *part.get("required", [])]
    by_role = {
        role: {"oneOf": [{"$ref": f"#/$defs/{target(cls)}"} for cls in classes]}
        for role, classes in components.items()
        if classes
    }
    for role in plugins.roles:
        cls = plugins.role(role)
        # an option that is itself a component: a table with its kind, or the kind alone where the plugin takes that
        if cls.__name__ in definitions and role in by_role:
            definitions[cls.__name__] = {
                "anyOf": [by_role[role], {"type": "string"}]
            }
    installed = sorted(plugins.materials())
    properties: Data = {
        "name": {"type": "string"},
        "title": {"type": "string"},
    }
    properties["material"] = {
        "enum": installed,
        "description": "material that fills what the scene does not say",
    }
    for stage in stages:
        for section, role in stage.roles.items():
            part = by_role.get(role, {"type": "object"})
            if not role:
                part = (
                    stage.schema()
                    if stage.model() is None
                    else _of_model(stage, refs, definitions)
                )
            elif installed and stage.of_material and not stage.required:
                part = {"anyOf": [part, _OF_MATERIAL, {"const": False}]}
            properties[section] = (
                {"type": "array", "items": part} if stage.many else part
            )
        from_materials = (
            _of_materials(stage.section)
            if stage.of_material and stage.required
            else set()
        )
        extra = {name: {**entry.schema} for name, entry in stage.beside.items()}
        required = [name for name, entry in stage.beside.items() if entry.required]
        for cls in (
            components.get(stage.role, ()) if extra or from_materials else ()
        ):
            own = definitions[target(cls)]
            own["properties"].update(extra)
            own["required"] = [
                *(name for name in own["required"] if name not in from_materials),
                *required,
            ]
    properties["plugins"] = _plugins_section(plugins, definitions)
    definitions |= json.loads(
        registry.scene_text("chemage.scene:sweep.schema.json")
    )
    properties["sweep"] = {"$ref": "#/$defs/Sweep"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "chemage scene",
        "type": "object",
        "required": [stage.section for stage in stages if stage.required],
        "additionalProperties": False,
        "properties": properties,
        "$defs": definitions,
    }


def _kinds(plugins: registry.Registry) -> dict[Any, list[str]]:
    """The class of each installed component -> what selects it; one that cannot be imported is left out."""
    found: dict[Any, list[str]] = {}
    for role in plugins.roles:
        for kind in plugins.kinds(role):
            with _warning():
                cls = plugins.component(role, kind)
                qualified = f"{plugins.offer(role, kind).owner}:{cls.kind}"
                found[cls] = [*dict.fromkeys((kind, qualified))]
    return found


@contextmanager
def _warning() -> Iterator[None]:
    """Warn of what cannot be imported, and go on without it."""
    try:
        yield
    except PluginError as error:
        text = f"not in the schema: {error}"
        warnings.warn(text, registry.PluginWarning, stacklevel=5)


def _of_model(stage: Stage, refs: Any, definitions: Data) -> Data:
    """A section whose options are those of a class, but for the sections of their own among them."""
    ref = refs[stage.model(), "validation"]
    if not stage.parts:
        return ref
    whole = definitions[ref["$ref"].removeprefix("#/$defs/")]
    properties = {
        name: part
        for name, part in whole["properties"].items()
        if name not in stage.parts
    }
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": properties,
        "description": stage.about,
    }


#: a section whose kind the material gives
_OF_MATERIAL = {"type": "object", "not": {"required": ["kind"]}}


def _of_materials(section: str) -> set[str]:
    """The options in a section that some installed material gives, so that a scene need not."""
    options: set[str] = set()
    for name in registry.current().materials():
        with _warning():
            options |= material(name).options(section).keys()
    return options


def _plugins_section(plugins: registry.Registry, definitions: Data) -> Data:
    """What a scene sets for plugins; adds the definitions of their options."""
    installed = sorted(
        record.name for record in plugins.records if not record.error
    )
    prefer = {
        "type": "array",
        "items": {"enum": installed},
        "description": "plugins that come first where several answer a stage, read a file or have a kind",
    }
    properties: Data = {"prefer": prefer}
    for name in [record.name for record in plugins.records if record.options]:
        with _warning():
            part = plugins.options_class(name).model_json_schema(
                mode="validation", ref_template="#/$defs/{model}"
            )
            definitions |= part.pop("$defs", {})
            properties[name] = {
                "description": f"options of the plugin {name}",
                **part,
            }
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": properties,
    }


def options_of(cls: type[Component]) -> list[dict[str, str]]:
    """Name, unit, default and meaning of each option of a component, as text."""
    rows, texts = [], meanings(cls)
    properties = cls.model_json_schema().get("properties", {})
    for name, info in cls.model_fields.items():
        part = properties.get(name, {})
        rows.append(
            {
                "name": name,
                "unit": _unit(part),
                "default": "required"
                if info.is_required()
                else str(info.get_default(call_default_factory=True)),
                "meaning": " ".join(texts.get(name, "").split()),
            }
        )
    return rows


def _unit(part: Data) -> str:
    """The unit of a property, also where the quantity may be left out, or is one of a list."""
    inner = [*part.get("anyOf", ()), part.get("items")]
    units = [
        part.get("unit"),
        *(_unit(item) for item in inner if isinstance(item, dict)),
    ]
    return next(filter(None, units), "")
