"""The components of a scene by the path of their section, such as ``forming``, ``contact.inner`` or ``observe.0``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from chemage.ageing.aging import Aging
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError
from chemage.plugins import registry
from chemage.scene.scene import ROLE_OF, Scene
from chemage.surfaces.role import SurfaceMaker
from chemage.surfaces.scatter import Scatter

#: what a section holds besides the options of its component
_BESIDES = {"surface": "seed", "contact": "load"}


def sections(scene: Scene) -> dict[str, Component]:
    """Every section of ``scene`` that is a component: path -> component."""
    found: dict[str, Component] = {}
    for name in type(scene).model_fields:
        value = getattr(scene, name)
        if isinstance(value, Component) and value.role:
            found[name] = value
        elif isinstance(value, Component):  # the chemistry, whose components are sections of their own
            parts = {part: getattr(value, part) for part in type(value).model_fields}
            found |= {part: one for part, one in parts.items() if isinstance(one, Component)}
        elif isinstance(value, tuple):
            found |= {f"{name}.{number}": one for number, one in enumerate(value) if isinstance(one, Component)}
    return found


def nested(component: Component, path: str) -> Iterator[tuple[str, Component]]:
    """``component`` and the components that are options of it, at any depth: (path, component)."""
    yield path, component
    for name in type(component).model_fields:
        value = getattr(component, name)
        if isinstance(value, Component):
            yield from nested(value, f"{path}.{name}")
        elif isinstance(value, list | tuple):
            for number, one in enumerate(value):
                if isinstance(one, Component):
                    yield from nested(one, f"{path}.{name}.{number}")
        elif isinstance(value, Mapping):
            for key, one in value.items():
                if isinstance(one, Component):
                    yield from nested(one, f"{path}.{name}.{key}")


def scatter_of(
    scene: Mapping[str, Any],
    aging: Aging | None,
    contact: Mapping[str, float],
    recorded: Mapping[str, Any] | None = None,
) -> Scatter | None:
    """What the maker of a result's surface knows of the scatter between surfaces (:meth:`SurfaceMaker.scatter`).

    ``contact`` are the measures of the contact; the other arguments are those of :func:`components_of`.
    """
    for path, role, fields in _recorded(scene, aging, recorded):
        if path == "surface":  # the other components need not be imported
            maker = _installed(role, fields)
            return maker.scatter(contact) if isinstance(maker, SurfaceMaker) else None
    return None


def components_of(
    scene: Mapping[str, Any], aging: Aging | None = None, contact: Mapping[str, Any] | None = None
) -> list[tuple[str, Component]]:
    """The components that a result was made with, as far as their plugins are installed: (path, component).

    They are found in the plain data of its scene, or else in the provenance of the ageing curve or of the ``contact``.
    """
    found: list[tuple[str, Component]] = []
    for path, role, fields in _recorded(scene, aging, contact):
        if (component := _installed(role, fields)) is not None:
            found += nested(component, path)
    return found


def _installed(role: str, fields: Mapping[str, Any]) -> Component | None:
    try:
        return registry.current().fromdict(role, fields)
    except ChemageError:  # another version of the plugin, or none
        return None


def _recorded(
    scene: Mapping[str, Any], aging: Aging | None, contact: Mapping[str, Any] | None
) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """(path, role, plain options with kind) of each component."""
    provenance = aging.provenance if aging is not None else {}
    chemistry = provenance.get("chemistry", {})
    below = contact or provenance.get("contact") or {}
    made = {"contact": _options(below), "surface": _options(below.get("surface"))}
    for path, role in ROLE_OF.items():
        # the provenance of ageing has under "contact" that of the contact, which is no table of options
        recorded = made[path] if path in made else provenance.get(path) or chemistry.get(path)
        fields = scene.get(path) or recorded
        if isinstance(fields, Mapping) and "kind" in fields:
            besides = _BESIDES.get(path) if path in scene else None
            yield path, role, {name: value for name, value in fields.items() if name != besides}
    for number, fields in enumerate(provenance.get("observe") or scene.get("observe", ())):
        yield f"observe.{number}", "observable", fields


def _options(provenance: Any) -> dict[str, Any]:
    """The component that made a surface or a contact, where its provenance has ``kind`` and ``options``."""
    if not isinstance(provenance, Mapping) or not isinstance(provenance.get("options"), Mapping):
        return {}
    return {**provenance["options"], "kind": provenance.get("kind")}
