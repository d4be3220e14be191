"""Provenance: the versions of everything that took part in a result, and the components that it was made with."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib import metadata
from typing import Any

from chemage.ageing.aging import Aging
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError
from chemage.foundation.machine import processor
from chemage.foundation.names import __version__
from chemage.foundation.records import Record
from chemage.plugins import registry
from chemage.plugins.sources import providers
from chemage.scene.scene import Scene
from chemage.surfaces.role import Scatter, SurfaceMaker

#: libraries on whose versions the last bits of a result depend
LIBRARIES = ("numpy", "scipy", "numba", "h5py")


def versions(scene: Scene | None = None, results: tuple[Record | None, ...] = ()) -> dict[str, str]:
    """Versions of chemage, of the libraries below it, and of the plugins that took part; and the processor.

    Those are the plugins that provide the components of ``scene``, and those that took part in ``results``; and the
    libraries that they name as their basis.
    """
    numbers = {"chemage": __version__, "python": platform.python_version(), "processor": processor()}
    for name in LIBRARIES:
        numbers[name] = _version(name)
    taking_part = providers(*scene.components()) if scene is not None else {}
    for result in results:
        if result is not None:
            taking_part |= result.plugins
    records = {record.name: record for record in registry.current().records}
    for name, source in sorted(taking_part.items()):
        record = records.get(name)
        numbers.setdefault((record and record.distribution) or name, (record and record.version) or source)
        numbers |= (
            {library: numbers.get(library, version) for library, version in record.libraries.items()} if record else {}
        )
    return numbers


@lru_cache
def _version(distribution: str) -> str:
    # reading a distribution's metadata takes a millisecond, and a sweep needs it at every point
    return metadata.version(distribution)


def components_of(
    scene: Mapping[str, Any], aging: Aging | None = None, contact: Mapping[str, Any] | None = None
) -> list[tuple[str, Component]]:
    """The components that a result was made with, as far as their plugins are installed: (path, component).

    They are found in the plain data of its scene, or else in the provenance of the ageing curve or of the ``contact``.
    """
    return [
        part
        for path, role, options in _recorded(scene, aging, contact)
        if (component := _installed(role, options)) is not None
        for part in nested(component, path)
    ]


def scatter_of(
    scene: Mapping[str, Any],
    aging: Aging | None,
    contact: Mapping[str, float],
    recorded: Mapping[str, Any] | None = None,
) -> Scatter | None:
    """What the maker of a result's surface knows of the scatter between surfaces (:meth:`SurfaceMaker.scatter`).

    ``contact`` are the measures of the contact; the other arguments are those of :func:`components_of`.
    """
    for _, role, options in _recorded(scene, aging, recorded):
        if role == SurfaceMaker.role:  # the other components need not be imported
            maker = _installed(role, options)
            return maker.scatter(contact) if isinstance(maker, SurfaceMaker) else None
    return None


def _recorded(
    scene: Mapping[str, Any], aging: Aging | None, contact: Mapping[str, Any] | None
) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """(path, role, plain options with kind) of each component."""
    provenance = aging.provenance if aging is not None else {}
    below = contact or provenance.get("contact") or {}
    for stage in registry.current().stages():
        stored = stage.recorded(provenance, below)
        for section, role in {**stage.parts, **({stage.section: stage.role} if stage.role else {})}.items():
            options = scene.get(section) or stored.get(section)
            if stage.many:
                yield from ((f"{section}.{number}", role, table) for number, table in enumerate(options or ()))
            elif isinstance(options, Mapping) and "kind" in options:
                beside = stage.beside if scene.get(section) else ()
                yield section, role, {name: value for name, value in options.items() if name not in beside}


def _installed(role: str, options: Mapping[str, Any]) -> Component | None:
    try:
        return registry.current().fromdict(role, options)
    except ChemageError:  # another version of the plugin, or none
        return None


def nested(component: Component, path: str) -> Iterator[tuple[str, Component]]:
    """``component`` and the components that are options of it, at any depth: (path, component)."""
    yield path, component
    for name in type(component).model_fields:
        value = getattr(component, name)
        places: dict[str, Any] = {f"{path}.{name}": value}
        if isinstance(value, Mapping | list | tuple):
            items = value.items() if isinstance(value, Mapping) else enumerate(value)
            places = {f"{path}.{name}.{key}": part for key, part in items}
        for place, part in places.items():
            if isinstance(part, Component):
                yield from nested(part, place)
