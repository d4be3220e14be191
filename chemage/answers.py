"""chemage's own answers to the hooks of the pipeline, asked after every plugin's: the chosen class's one method."""

from __future__ import annotations

import numpy as np

from chemage.hookspecs import hookimpl
from chemage.objects import BondHistory, ContactSolution, ReactionLattice, Surface
from chemage.reactions import Chemistry
from chemage.spec import ContactSolver, Engine, Seed, SurfaceMaker


@hookimpl(trylast=True)
def chemage_make_surface(maker: SurfaceMaker, seed: Seed) -> Surface:
    return maker.make(seed)


@hookimpl(trylast=True)
def chemage_solve_contact(
    solver: ContactSolver, surface: Surface, load: float, start: ContactSolution | None
) -> ContactSolution:
    return solver.solve(surface, load, start=start)


@hookimpl(trylast=True)
def chemage_build_lattice(chemistry: Chemistry, contact: ContactSolution, seed: Seed) -> ReactionLattice:
    return chemistry.on(contact, seed)


@hookimpl(trylast=True)
def chemage_run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: np.ndarray,
    temperature: float,
    seed: Seed,
    start: BondHistory | None,
) -> BondHistory:
    return engine.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)
