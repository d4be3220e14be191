"""What can be plugged into this stage: barriers, interactions, and the hook that builds a reaction lattice."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookimpl, hookspec

if TYPE_CHECKING:
    from chemage.contacts.solution import ContactSolution
    from chemage.foundation.checks import Seed
    from chemage.lattices.chemistry import Chemistry
    from chemage.lattices.lattice import ReactionLattice

ROLES = {"barriers": "chemage.lattices.role:Barriers", "interaction": "chemage.lattices.role:Interaction"}


@hookspec(firstresult=True)
def chemage_build_lattice(chemistry: Chemistry, contact: ContactSolution, seed: Seed) -> ReactionLattice | None:
    """Turn a contact into reactive sites. Return None to leave it to the next plugin; chemage itself answers last."""


class Default:
    """The chemistry's own method."""

    @hookimpl(trylast=True)
    def chemage_build_lattice(self, chemistry: Chemistry, contact: ContactSolution, seed: Seed) -> ReactionLattice:
        return chemistry.on(contact, seed)
