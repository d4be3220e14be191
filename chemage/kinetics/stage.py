"""The fourth stage: an engine follows the bonds of one replica."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, check_times, expect, temperature_value
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.sources import approximation_of, approximations, providers


def engine(kind: str, **options: Any) -> Any:
    """A kinetic Monte Carlo engine: ``chemage.engine("bkl").run(lattice, times, temperature=300, seed=3)``."""
    return registry.current().make("engine", kind, options)


def run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: Sequence[float] | np.ndarray,
    *,
    temperature: float | str,
    seed: Seed = 0,
    start: BondHistory | None = None,
    contact: ContactSolution | None = None,
    chemistry: Chemistry | None = None,
) -> BondHistory:
    """One replica, through the hook ``chemage_run_kinetics``.

    ``contact`` and ``chemistry``, from which the lattice was made, are for plugins; the engine does not see them.
    The plugins that took part are noted in the history's ``provenance``.
    """
    expect("engine", engine, Engine, 'make one with chemage.engine("bkl")')
    expect("lattice", lattice, ReactionLattice, "make one with chemistry.on(contact), or from arrays")
    history, plugins = registry.current().answer(
        "chemage_run_kinetics",
        BondHistory,
        engine=engine,
        lattice=lattice,
        hold_times=check_times(hold_times),
        temperature=temperature_value(temperature),
        seed=seed,
        start=start,
        contact=contact,
        chemistry=chemistry,
    )
    # an engine that selects another one, and a plugin that answers with one, record which
    used = approximation_of("engine", history.engine) if history.engine != engine.kind else []
    return history.noting(providers(engine) | plugins, [*approximations(engine), *used])
