"""What can be plugged into this stage: observables, methods of ageing, and the hook that measures on a replica."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import hookspec

if TYPE_CHECKING:
    from chemage.contacts.solution import ContactSolution
    from chemage.kinetics.history import BondHistory
    from chemage.lattices.lattice import ReactionLattice

ROLES = {
    "observable": "chemage.ageing.observables:Observable",
    "ageing": "chemage.ageing.methods:AgeingMethod",
}


@hookspec
def chemage_observe(contact: ContactSolution, lattice: ReactionLattice, history: BondHistory) -> Mapping[str, Any]:  # pyright: ignore[reportReturnType]
    """Measure named numbers or arrays on a finished replica; they are kept in ``Aging.observables``."""
