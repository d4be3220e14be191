"""The JSON Schema of scene files, with every installed plugin's options in it."""

from __future__ import annotations

import warnings
from typing import Any

from pydantic.json_schema import models_json_schema

from chemage.foundation.components import Component
from chemage.foundation.errors import PluginError
from chemage.lattices.chemistry import Chemistry
from chemage.plugins import registry
from chemage.scene.asked import EnsembleOptions
from chemage.scene.holding import FitWindow, Hold
from chemage.scene.materials import SECTIONS as FILLED
from chemage.scene.materials import material
from chemage.scene.scene import ROLE_OF


def scene_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a scene, for editors that complete and check TOML."""
    plugins = registry.current()
    components: dict[str, list[Any]] = {role: [] for role in plugins.roles}
    for role in plugins.roles:
        for kind in plugins.kinds(role):
            try:
                components[role].append(plugins.component(role, kind))
            except PluginError as error:
                warnings.warn(f"not in the schema: {error}", registry.PluginWarning, stacklevel=2)
    models: list[Any] = [cls for classes in components.values() for cls in classes]
    refs, top = models_json_schema([(model, "validation") for model in [*models, Hold, FitWindow, EnsembleOptions]])
    definitions = top.get("$defs", {})

    def target(model: Any) -> str:
        return refs[model, "validation"]["$ref"].removeprefix("#/$defs/")

    for model in models:
        part = definitions[target(model)]
        part["properties"] = {"kind": {"const": model.kind}, **part.get("properties", {})}
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
            definitions[cls.__name__] = {"anyOf": [by_role[role], {"type": "string"}]}
    given = _of_materials("contact")
    properties: dict[str, Any] = {"name": {"type": "string"}, "title": {"type": "string"}}
    installed = sorted(plugins.materials())
    properties["material"] = {"enum": installed, "description": "material that fills what the scene does not say"}
    for section, role in ROLE_OF.items():
        properties[section] = by_role.get(role, {"type": "object"})
        if installed and section in FILLED and section != "contact":
            properties[section] = {"anyOf": [properties[section], _OF_MATERIAL, {"const": False}]}
    for section, extra in (("surface", _SURFACE_EXTRA), ("contact", _CONTACT_EXTRA)):
        for cls in components[section]:
            definitions[target(cls)]["properties"].update(extra)
            if section == "contact":
                own = definitions[target(cls)]["required"]
                definitions[target(cls)]["required"] = [*(name for name in own if name not in given), "load"]
    properties["chemistry"] = _chemistry_section()
    properties["hold"] = refs[Hold, "validation"]
    properties["fit"] = refs[FitWindow, "validation"]
    properties["ensemble"] = refs[EnsembleOptions, "validation"]
    properties["accuracy"] = _ACCURACY
    properties["plugins"] = _plugins_section(plugins, definitions)
    properties["observe"] = {"type": "array", "items": by_role.get("observable", {"type": "object"})}
    definitions |= _SWEEP
    properties["sweep"] = {"$ref": "#/$defs/Sweep"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "chemage scene",
        "type": "object",
        "required": ["surface", "contact"],
        "additionalProperties": False,
        "properties": properties,
        "$defs": definitions,
    }


_SWEEP: dict[str, Any] = {
    "Sweep": {
        "type": "object",
        "minProperties": 1,
        "description": "fields to vary: each line, a dotted path and the list of its values, is one axis of a grid",
        "properties": {
            "zip": {
                "type": "array",
                "items": {"$ref": "#/$defs/SweepLines"},
                "description": "lines that move together, of equal length, make one axis",
            }
        },
        "additionalProperties": {"$ref": "#/$defs/SweepValues"},
    },
    "SweepLines": {
        "type": "object",
        "minProperties": 1,
        "additionalProperties": {"$ref": "#/$defs/SweepValues"},
    },
    "SweepValues": {"anyOf": [{"type": "array", "minItems": 1}, {"$ref": "#/$defs/SweepLines"}]},
}
_ACCURACY = {
    "type": "object",
    "description": "quantity (beta, friction_drop, friction_coefficient_drop, a measure of the contact; name@time at a "
    'hold time) -> half the width of its 95 % interval over the mean: 0.02, or "2 %"',
    "additionalProperties": {
        "anyOf": [{"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, {"type": "string"}]
    },
}
#: a section whose kind the material gives
_OF_MATERIAL = {"type": "object", "not": {"required": ["kind"]}}
_SURFACE_EXTRA = {"seed": {"type": "integer", "minimum": 0, "default": 0, "description": "of the surface"}}
_CONTACT_EXTRA = {
    "load": {
        "anyOf": [{"type": "number", "minimum": 0}, {"type": "string"}],
        "description": "normal force (nN), or a nominal pressure such as 10 MPa, on the nominal area of the surface",
        "unit": "nN",
    }
}


def _of_materials(section: str) -> set[str]:
    """The options in a section that some installed material gives, so that a scene need not."""
    found: set[str] = set()
    for name in registry.current().materials():
        try:
            found |= material(name).options(section).keys()
        except PluginError as error:
            warnings.warn(f"not in the schema: {error}", registry.PluginWarning, stacklevel=3)
    return found


def _plugins_section(plugins: registry.Registry, definitions: dict[str, Any]) -> dict[str, Any]:
    """What a scene sets for plugins; adds the definitions of their options."""
    installed = sorted(record.name for record in plugins.records if not record.error)
    prefer = {
        "type": "array",
        "items": {"enum": installed},
        "description": "plugins that come first where several answer a stage or read a file",
    }
    properties: dict[str, Any] = {"prefer": prefer}
    for name, cls in plugins_with_options(plugins).items():
        part = cls.model_json_schema(mode="validation", ref_template="#/$defs/{model}")
        definitions |= part.pop("$defs", {})
        properties[name] = {"description": f"options of the plugin {name}", **part}
    return {"type": "object", "additionalProperties": False, "properties": properties}


def plugins_with_options(plugins: registry.Registry) -> dict[str, Any]:
    """Name of each plugin with options -> the class of its options; one that cannot be imported is left out."""
    found: dict[str, Any] = {}
    for record in plugins.records:
        if record.options:
            try:
                found[record.name] = plugins.options_class(record.name)
            except PluginError as error:
                warnings.warn(f"not in the schema: {error}", registry.PluginWarning, stacklevel=2)
    return found


def _chemistry_section() -> dict[str, Any]:
    whole = Chemistry.model_json_schema()
    properties = {
        name: part for name, part in whole["properties"].items() if name not in ("forming", "breaking", "interaction")
    }
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": properties,
        "description": "what turns a contact into reactive sites",
    }


def options_of(cls: type[Component]) -> list[dict[str, str]]:
    """Name, unit, default and meaning of each option of a component, as text."""
    rows = []
    properties = cls.model_json_schema().get("properties", {})
    for name, info in cls.model_fields.items():
        part = properties.get(name, {})
        rows.append(
            {
                "name": name,
                "unit": _unit(part),
                "default": "required" if info.is_required() else str(info.get_default(call_default_factory=True)),
                "meaning": " ".join((info.description or "").split()),
            }
        )
    return rows


def _unit(part: dict[str, Any]) -> str:
    """The unit of a property, also where the quantity may be left out, or is one of a list."""
    inner = [*part.get("anyOf", []), *([part["items"]] if isinstance(part.get("items"), dict) else [])]
    return part.get("unit", "") or next((unit for one in inner if (unit := _unit(one))), "")
