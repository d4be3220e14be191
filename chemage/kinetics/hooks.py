"""What can be plugged into this stage: kinetic Monte Carlo engines, and the hook that runs one replica."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookimpl, hookspec

if TYPE_CHECKING:
    import numpy as np

    from chemage.contacts.solution import ContactSolution
    from chemage.foundation.checks import Seed
    from chemage.kinetics.history import BondHistory
    from chemage.kinetics.role import Engine
    from chemage.lattices.chemistry import Chemistry
    from chemage.lattices.lattice import ReactionLattice

ROLES = {"engine": "chemage.kinetics.role:Engine"}


@hookspec(firstresult=True)
def chemage_run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: np.ndarray,
    temperature: float,
    seed: Seed,
    start: BondHistory | None,
    contact: ContactSolution | None,
    chemistry: Chemistry | None,
) -> BondHistory | None:
    """Run one replica. Return None to leave it to the next plugin; chemage itself answers last.

    ``contact`` and ``chemistry`` are what the lattice was made from, None where an engine is run on a lattice by hand.
    Called once per replica (once per piece where checkpoints are kept; ``start`` is then the piece before), never per
    event.
    """


class Default:
    """The engine's own method."""

    @hookimpl(trylast=True)
    def chemage_run_kinetics(
        self,
        engine: Engine,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | None,
    ) -> BondHistory:
        return engine.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)
