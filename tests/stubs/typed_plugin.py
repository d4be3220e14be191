"""Components that type checkers must accept as they are, in their strictest mode; a test runs them."""

# pyright: strict

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from chemage import ContactSolution, ReactionLattice, Surface
from chemage.plugin import (
    Barriers,
    Bonded,
    BondHistory,
    Choice,
    ContactSolver,
    Energy,
    Engine,
    Observable,
    Output,
    Rupture,
    Seed,
)


class Ladder(Barriers):
    """Barriers evenly below a top."""

    kind = "typed-ladder"

    top: Energy = 1.2
    """the highest barrier, eV"""

    @property
    def exact(self) -> bool:
        return bool(self.top > 1)

    @property
    def declared_error(self) -> float | None:
        return None if self.exact else 0.1

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return self.top * uniform

    def density(self, energy: np.ndarray) -> np.ndarray:
        return np.where((energy >= 0) & (energy <= self.top), 1 / self.top, 0.0)


class Pausing(Engine):
    """Counts how often it was asked."""

    kind = "typed-pausing"
    inner: Choice[Engine]
    """the engine that is run"""
    outputs: ClassVar[Mapping[str, Output]] = {"asked": Output((), "", "calls of the engine")}

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        before = start.observables.get("asked", 0) if isinstance(start, BondHistory) else 0
        self.record(asked=before + 1)
        return self.inner.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)


class Fallback(ContactSolver):
    """Another solver, in an option of its own."""

    kind = "typed-fallback"
    other: Choice[ContactSolver]
    """the solver"""

    def _solve(self, surface: Surface, load: float, start: ContactSolution | None) -> ContactSolution:
        return self.other.solve(surface, load, start=start)


class Steady(Rupture):
    """One force for each bond."""

    kind = "typed-steady"
    states = True

    def force(self, bonded: Bonded) -> np.ndarray:
        return 2.0 * bonded.states.sum(axis=1)


class Share(Observable):
    """The share of the sites that are bonded."""

    kind = "typed-share"

    @property
    def outputs(self) -> Mapping[str, Output]:
        return {"share": Output((), "", "share of the sites that are bonded")}

    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, float | np.ndarray]:
        return {"share": float(history.state.mean()) if history.state.size else 0.0}


inner: Engine = Pausing(inner="rejection-free").inner
solver: ContactSolver = Fallback(other={"kind": "hertz", "modulus": "35.3 GPa"}).other
