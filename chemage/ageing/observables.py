"""The role of further measurements on each replica, and how their figures are drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.outputs import Output
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.kinetics.history import BondHistory
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Observed:
    """One result as an observable draws it."""

    #: for the legend
    label: str
    aging: Aging
    #: None where the plugins that made this result are not installed
    chemistry: Chemistry | None
    #: a matplotlib colour
    color: str


class Observable(Component, ABC):
    """Role ``observable``: further numbers to take from each replica."""

    role = "observable"
    #: what is measured: name -> :class:`chemage.Output`; may be a property, where it depends on options. Observables
    #: without it still work: nothing is known then of dimensions and units.
    outputs: ClassVar[Mapping[str, Output]] = {}
    #: asks for the state of every site at every hold time, ``history.states``, (m, n) bool; the engine must be able to
    #: resume from a history (``restart``)
    states: ClassVar[bool] = False
    #: figures that :meth:`draw` can draw: name -> caption
    figures: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, float | np.ndarray]:
        """Named numbers or arrays, the same names and shapes for every replica: just those of :attr:`outputs`."""

    def draw(self, figure: str, axes: Axes, results: Sequence[Observed]) -> None:
        """Draw one of :attr:`figures` into ``axes``: of one result, or of several that are compared.

        What was measured is in ``Aging.observables`` of each result, (replicas, ...) by name.
        """
        raise NotImplementedError(f"observable {self.kind!r} names the figure {figure!r} but does not draw it")


def observable(kind: str, **options: Any) -> Any:
    """A further measurement on each replica."""
    return registry.current().make("observable", kind, options)
