"""The fourth stage: an engine follows the bonds of one replica."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, check_times, expect, temperature_value
from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.units import QuantityLike
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.context import Plugins
from chemage.plugins.sources import approximation_of, approximations, providers


def engine(kind: str, **options: Any) -> Any:
    """A kinetic Monte Carlo engine: ``chemage.engine("bkl").run(lattice, times, temperature=300, seed=3)``."""
    return registry.current().make("engine", kind, options)


def run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: Sequence[float] | np.ndarray,
    *,
    temperature: QuantityLike,
    seed: Seed = 0,
    start: BondHistory | None = None,
    states: bool = False,
    contact: ContactSolution | None = None,
    chemistry: Chemistry | None = None,
) -> BondHistory:
    """One replica, through the hook ``chemage_run_kinetics``.

    ``contact`` and ``chemistry``, from which the lattice was made, are for plugins; the engine does not see them. The
    plugins that took part are noted in the history's ``provenance``. With ``states``, the history has the state of
    every site at every hold time. The engine then runs from hold time to hold time, which gives the same bytes, because
    a run resumed from a history equals the uninterrupted one.

    Raises
    ------
    InputError
        ``states`` with an engine that cannot resume from a history.
    PluginError
        There are more bonds than sites.
    """
    expect("engine", engine, Engine, 'make one with chemage.engine("bkl")')
    expect("lattice", lattice, ReactionLattice, "make one with chemistry.on(contact), or from arrays")
    arguments: dict[str, Any] = {"lattice": lattice, "temperature": temperature_value(temperature), "seed": seed}
    arguments |= {"contact": contact, "chemistry": chemistry}
    times = check_times(hold_times)
    if not states:
        return _answered(engine, hold_times=times, start=start, **arguments)
    if not engine.restart:
        raise InputError(cannot_give_states(engine))
    counts: dict[str, list[np.ndarray]] = {name: [] for name in ("hold_times", "bonds", "formed", "broken")}
    seen: list[np.ndarray] = []
    notes: dict[str, None] = {}
    plugins: Plugins = {}
    approximate: list[dict[str, Any]] = []
    for number in range(times.size):
        # only the last piece is kept whole: what an engine needs to resume may be large
        start = _answered(engine, hold_times=times[number : number + 1], start=start, **arguments)
        for name, parts in counts.items():
            parts.append(getattr(start, name))
        seen.append(start.state)
        notes |= dict.fromkeys(start.notes)
        plugins |= start.plugins
        approximate += start.approximate
    assert start is not None
    joined: dict[str, Any] = {name: np.concatenate(parts) for name, parts in counts.items()}
    joined |= {"states": np.stack(seen), "notes": tuple(notes)}
    return start.model_copy(update=joined).noting(plugins, approximate)


def cannot_give_states(engine: Engine) -> str:
    """Why ``engine``, which cannot resume from a history, gives no states at every hold time, and what to do."""
    return (
        f"engine {engine.kind!r} cannot resume from a history (restart = False), so that the states at every hold time "
        "are not known; use another engine"
    )


def _answered(engine: Engine, **arguments: Any) -> BondHistory:
    history, plugins = registry.current().answer("chemage_run_kinetics", BondHistory, engine=engine, **arguments)
    sites, bonds = arguments["lattice"].sites.size, int(history.bonds.max())
    if bonds > sites:
        raise PluginError(
            f"engine {history.engine or engine.kind!r}: {bonds} bonds on {sites} sites; a site has one bond at most"
        )
    # an engine that selects another one, and a plugin that answers with one, record which
    used = approximation_of("engine", history.engine) if history.engine != engine.kind else []
    return history.noting(providers(engine) | plugins, [*approximations(engine), *used])
