"""One function per arrow: surface → contact → lattice → kinetics. Each goes through its hook, so that a plugin can
replace or wrap the arrow; chemage's own answer, the chosen class's one method, comes last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from chemage import registry
from chemage.errors import InputError, PluginError
from chemage.objects import BondHistory, ContactSolution, ReactionLattice, Surface
from chemage.reactions import Chemistry
from chemage.spec import (
    ContactSolver,
    Engine,
    Seed,
    SurfaceMaker,
    check_times,
    force,
    temperature_value,
)


def _answer(name: str, expected: type, **arguments: Any) -> Any:
    result = getattr(registry.current().manager.hook, name)(**arguments)
    if not isinstance(result, expected):
        raise PluginError(
            f"a plugin answered {name} with {type(result).__name__}; expected {expected.__name__} or None"
        )
    return result


def expect(name: str, value: object, kind: type, remedy: str) -> None:
    if not isinstance(value, kind):
        raise InputError.of(name, value, f"is no {kind.__name__}", remedy)


# -- the arrows -------------------------------------------------------------------------------------------------------


def make_surface(maker: SurfaceMaker, seed: Seed = 0) -> Surface:
    """The surface of ``maker``, through the hook ``chemage_make_surface``."""
    expect("maker", maker, SurfaceMaker, 'make one with chemage.surface("sphere", ...)')
    return _answer("chemage_make_surface", Surface, maker=maker, seed=seed)


def solve_contact(
    solver: ContactSolver, surface: Surface, load: float | str, *, start: ContactSolution | None = None
) -> ContactSolution:
    """The contact of ``surface`` under ``load``, through the hook ``chemage_solve_contact``."""
    expect("solver", solver, ContactSolver, 'make one with chemage.contact("hertz", ...)')
    expect("surface", surface, Surface, "make one with chemage.surface(...).make()")
    return _answer(
        "chemage_solve_contact", ContactSolution, solver=solver, surface=surface, load=force(load), start=start
    )


def build_lattice(chemistry: Chemistry, contact: ContactSolution, seed: Seed = 0) -> ReactionLattice:
    """The reactive sites of ``contact``, through the hook ``chemage_build_lattice``."""
    expect("chemistry", chemistry, Chemistry, "make one with chemage.chemistry(forming=...)")
    expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
    return _answer("chemage_build_lattice", ReactionLattice, chemistry=chemistry, contact=contact, seed=seed)


def run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: Sequence[float] | np.ndarray,
    *,
    temperature: float | str,
    seed: Seed = 0,
    start: BondHistory | None = None,
) -> BondHistory:
    """One replica, through the hook ``chemage_run_kinetics``."""
    expect("engine", engine, Engine, 'make one with chemage.engine("bkl")')
    expect("lattice", lattice, ReactionLattice, "make one with chemistry.on(contact), or from arrays")
    return _answer(
        "chemage_run_kinetics",
        BondHistory,
        engine=engine,
        lattice=lattice,
        hold_times=check_times(hold_times),
        temperature=temperature_value(temperature),
        seed=seed,
        start=start,
    )
