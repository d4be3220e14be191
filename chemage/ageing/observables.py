"""The role of further measurements on each replica, and how their figures are drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from chemage.ageing.outputs import Output
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
    #: what is measured: name -> :class:`chemage.plugin.Output`; may be a property, where it depends on options.
    #: Observables without it still work: nothing is known then of dimensions and units.
    outputs: ClassVar[Mapping[str, Output]] = {}
    #: asks for the state of every site at every hold time, ``history.states``, (m, n) bool; the engine must be able to
    #: resume from a history (``restart``)
    states: ClassVar[bool] = False

    @abstractmethod
    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, float | np.ndarray]:
        """Named numbers or arrays, the same names and shapes for every replica: just those of :attr:`outputs`."""

    def draw(self, figure: str, axes: Axes, results: Sequence[Observed]) -> None:
        """As for every component.

        What was measured is in ``Aging.observables`` of each result, (replicas, ...) by name.
        """
        super().draw(figure, axes, results)


def observable(kind: str, **options: Any) -> Any:
    """A further measurement on each replica."""
    return registry.current().make("observable", kind, options)
