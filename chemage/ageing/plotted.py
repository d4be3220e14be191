"""What plugins draw their figures from: a result as a component, an observable or a hook sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from chemage.ageing.aging import Aging
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.lattices.chemistry import Chemistry
from chemage.surfaces.surface import Surface


class Maps(NamedTuple):
    """The large arrays of a result; None for what its file does not hold."""

    contact: ContactSolution | None = None
    surface: Surface | None = None


@dataclass(frozen=True)
class PlottedResult:
    """One result to draw: alone, or beside others with which it is compared."""

    #: for the legend
    label: str
    #: None without ageing
    aging: Aging | None
    #: None without ageing, and where the plugins that made this result are not installed
    chemistry: Chemistry | None
    #: a matplotlib colour
    color: str
    #: the component whose figure is drawn, with the options that it had in this result; None for figures of a hook
    component: Component | None = None
    #: plain data of the scene; empty where the file holds none
    scene: Mapping[str, Any] = field(default_factory=dict)
    #: gives contact and surface, which are read from the file when they are needed
    load_maps: Callable[[], Maps] = field(default=Maps, repr=False, compare=False)

    @property
    def contact(self) -> ContactSolution | None:
        """The contact; None where the file holds none."""
        return self.load_maps().contact

    @property
    def surface(self) -> Surface | None:
        """The surface; None where the file holds none."""
        return self.load_maps().surface


@dataclass(frozen=True)
class Observed(PlottedResult):
    """One result as an observable draws it: ``aging`` is always there."""

    aging: Aging
