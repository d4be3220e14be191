"""The bonds of one replica against hold time, with all on which the force to break them may depend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.errors import PluginError
from chemage.kinetics.history import BondHistory
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice


@dataclass(frozen=True)
class Bonded:
    """What a rupture law receives: the bonds of one replica at each hold time, and where they are."""

    contact: ContactSolution
    chemistry: Chemistry
    #: the n sites of this replica, with the barriers of each
    lattice: ReactionLattice
    #: bonds at each hold time; ``history.state`` are the bonded sites at the last one, (n,) bool
    history: BondHistory

    @property
    def temperature(self) -> float:
        """K."""
        return self.history.temperature

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s."""
        return self.history.hold_times

    @property
    def bonds(self) -> np.ndarray:
        """Number of bonds at each hold time, (m,)."""
        return self.history.bonds

    @property
    def states(self) -> np.ndarray:
        """Whether each site is bonded at each hold time, (m, n) bool.

        Raises
        ------
        PluginError
            Nothing asked for them: the class of the rupture law must set ``states = True``.
        """
        if self.history.states is None:
            raise PluginError("the states at every hold time were not asked for; set states = True in the class")
        return self.history.states
