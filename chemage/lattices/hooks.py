"""What can be plugged into this stage: barriers, interactions, and the hook that builds a reaction lattice."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookimpl, hookspec

if TYPE_CHECKING:
    import numpy as np

    from chemage.contacts.solution import ContactSolution
    from chemage.foundation.checks import Seed
    from chemage.lattices.chemistry import Chemistry
    from chemage.lattices.lattice import ReactionLattice

ROLES = {"barriers": "chemage.lattices.role:Barriers", "interaction": "chemage.lattices.role:Interaction"}


@hookspec(firstresult=True)
def chemage_build_lattice(
    chemistry: Chemistry, contact: ContactSolution, seed: Seed, sites: np.ndarray | None
) -> ReactionLattice | None:
    """Turn a contact into reactive sites. Return None to leave it to the next plugin; chemage itself answers last.

    ``sites``, where it is not None, are ascending flat indices of sites in contact: a sample, and no other site is
    wanted.
    """


class Default:
    """The chemistry's own method."""

    @hookimpl(trylast=True)
    def chemage_build_lattice(
        self, chemistry: Chemistry, contact: ContactSolution, seed: Seed, sites: np.ndarray | None
    ) -> ReactionLattice:
        return chemistry.on(contact, seed, sites=sites)
