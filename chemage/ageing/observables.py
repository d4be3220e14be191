"""The role of further measurements on each replica, and how their figures are drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from chemage.ageing.plotted import Observed as Observed
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.kinetics.history import BondHistory
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Observable(Component, ABC):
    """Role ``observable``: further numbers to take from each replica."""

    role = "observable"
    error_of: ClassVar[str] = "what it measures"

    @abstractmethod
    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, float | np.ndarray]:
        """Named numbers or arrays, the same names and shapes for every replica."""

    def draw(self, figure: str, axes: Axes, results: Sequence[Observed]) -> None:
        """As for every component.

        What was measured is in ``Aging.observables`` of each result, (replicas, ...) by name.
        """
        super().draw(figure, axes, results)


def observable(kind: str, **options: Any) -> Any:
    """A further measurement on each replica."""
    return registry.current().make("observable", kind, options)
