"""The settings that ``chemage tradeoff`` tries: each option in ``trade`` of each component of a scene, at any depth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError
from chemage.plugins import registry
from chemage.scene.plan import cost
from chemage.scene.provenance import nested
from chemage.scene.scene import Scene

#: at most so many values of one option are tried, the first, the last and the scene's own among them
MOST_VALUES = 8
#: numbers of replicas that are tried besides the scene's own
REPLICAS = (2, 5, 10, 20)
#: factors by which pixels are made larger
COARSER = (4, 2)


@dataclass(frozen=True)
class Setting:
    """An option of a component, and the values of it that are tried, from fast to accurate."""

    #: the section of the scene, such as ``contact``
    section: str
    #: names of the options that lead from the component of the section to the one that has the option
    below: tuple[str, ...]
    option: str
    values: tuple[Any, ...]
    #: how many values its class names
    named: int

    @property
    def name(self) -> str:
        """Section, path and option, such as ``contact.inner.tolerance``."""
        return ".".join((self.section, *self.below, self.option))

    def turned(self, component: Component, value: Any) -> Component:
        """The component of the section with this option at ``value``."""
        return replaced(component, self.below, lambda part: part.replace(**{self.option: value}))

    def of(self, component: Component) -> Any:
        """The value that this option has in the component of the section."""
        return getattr(at(component, self.below), self.option, None)


def settings(scene: Scene) -> list[Setting]:
    """What ``trade`` of the components of ``scene`` names, in the order of the sections."""
    found = []
    for section, component in scene.sections().items():
        for path, part in nested(component, section):
            below = tuple(path.removeprefix(section).split(".")[1:])
            for option, values in part.trade.items():
                tried = _some(tuple(values), getattr(part, option, None))
                found.append(Setting(section, below, option, tried, len(values)))
    return found


def _some(values: tuple[Any, ...], own: Any) -> tuple[Any, ...]:
    if len(values) <= MOST_VALUES:
        return values
    chosen = {round(k * (len(values) - 1) / (MOST_VALUES - 1)) for k in range(MOST_VALUES)}
    if own in values and values.index(own) not in chosen:
        nearest = min(chosen - {0, len(values) - 1}, key=lambda k: abs(k - values.index(own)))
        chosen = chosen - {nearest} | {values.index(own)}
    return tuple(values[k] for k in sorted(chosen))


def at(component: Any, below: Sequence[str]) -> Any:
    """The component that the names of options ``below`` lead to."""
    for name in below:
        if isinstance(component, Mapping):
            component = component[name]
        elif isinstance(component, list | tuple):
            component = component[int(name)]
        else:
            component = getattr(component, name)
    return component


def replaced(component: Any, below: Sequence[str], change: Callable[[Any], Any]) -> Any:
    """``component`` with ``change`` applied to the component that ``below`` leads to."""
    if not below:
        return change(component)
    name, rest = below[0], below[1:]
    if isinstance(component, Mapping):
        return {**component, name: replaced(component[name], rest, change)}
    if isinstance(component, list | tuple):
        items = [replaced(one, rest, change) if k == int(name) else one for k, one in enumerate(component)]
        return type(component)(items)
    return component.replace(**{name: replaced(getattr(component, name), rest, change)})


def reference(component: Component) -> Component:
    """The component, and those that are options of it, each as accurate as its class can make it."""
    found = component.reference()
    paths = [path for path, _ in nested(found, "")]
    for path in paths[1:]:
        found = replaced(found, path.split(".")[1:], lambda part: part.reference())
    return found


def with_section(scene: Scene, section: str, component: Component) -> Scene:
    """``scene`` with another component in a section."""
    name, _, number = section.partition(".")
    if name in type(scene).model_fields:
        value: Any = component
        if number:
            value = replaced(getattr(scene, name), [number], lambda _: component)
        return scene.model_copy(update={name: value})
    for field in type(scene).model_fields:
        value = getattr(scene, field)
        if isinstance(value, Component) and name in type(value).model_fields:
            return scene.model_copy(update={field: value.replace(**{name: component})})
    raise KeyError(section)


def planned(scene: Scene) -> str:
    """What a measurement of ``scene`` will compute and about what it will cost, in words."""
    contacts, ageings = 1 + len(COARSER), 0
    for setting in settings(scene):
        tries = len(setting.values) + 1  # and the reference
        contacts += tries if setting.section in ("surface", "contact") else 0
        ageings += tries if scene.ages and not setting.section.startswith("observe") else 0
    if scene.ages:
        ageings += len(registry.current().kinds("engine")) + len(REPLICAS) + 2
    text = f"{contacts} contacts and {ageings} ageing curves at most"
    try:
        known = cost(scene)
    except ChemageError:
        return text
    if known.contact_cpu_seconds is None or (ageings and known.kinetics_cpu_seconds is None):
        return text
    seconds = contacts * known.contact_cpu_seconds + ageings * (known.kinetics_cpu_seconds or 0.0)
    return f"{text}, about {seconds:.2g} CPU seconds if each costs what the scene itself does"
