"""Components that type checkers must accept as they are, in their strictest mode; a test runs them."""

# pyright: strict

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import ClassVar

import numpy as np

from chemage import ContactSolution, ReactionLattice, Surface
from chemage.plugin import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    Barriers,
    Bonded,
    BondHistory,
    Choice,
    ContactSolver,
    Drive,
    Energy,
    Engine,
    Interaction,
    Length,
    Observable,
    Output,
    Partners,
    PullHistory,
    Pulling,
    Reader,
    Rupture,
    Seed,
    SurfaceMaker,
    hookimpl,
    record,
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


class Step(SurfaceMaker):
    """A step."""

    kind = "typed-step"
    outputs: ClassVar[Mapping[str, Output]] = {"highest": Output(unit="nm", description="the upper terrace")}

    height: Length = 1.0
    """of the step, nm"""

    def make(self, seed: Seed = 0) -> Surface:
        self.record(highest=self.height)
        return Surface(heights=np.repeat([[0.0], [self.height]], 2, axis=1), pixel_size=1.0)


class Flat(Reader):
    """Reads nothing."""

    kind = "typed-flat"
    suffixes = (".flat",)

    def read(self, path: str | PathLike[str]) -> Surface:
        return Surface(heights=np.zeros((2, 2)), pixel_size=1.0, provenance={"file": str(path)})


class Alone(Interaction):
    """No site has a neighbour."""

    kind = "typed-alone"

    def neighbours(self, pixels: tuple[int, int], periodic: bool, sites: np.ndarray) -> np.ndarray:
        return np.full((sites.size, 1), -1, dtype=np.int32)

    def coupling(self, sites: np.ndarray, neighbours: np.ndarray, seed: Seed) -> np.ndarray:
        return np.zeros(neighbours.shape)


class Recorded(Pulling):
    """Another engine, whose work it records."""

    kind = "typed-recorded"
    inner: Choice[Pulling]
    """the engine that pulls"""
    outputs: ClassVar[Mapping[str, Output]] = {"final_work": Output((), "nN nm", "work of the drive")}

    def _run(
        self,
        lattice: ReactionLattice,
        drive: Drive,
        times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: PullHistory | BondHistory | np.ndarray | None,
        partners: Partners | None,
    ) -> PullHistory:
        pulled = self.inner.run(
            lattice, drive, times, temperature=temperature, seed=seed, start=start, partners=partners
        )
        self.record(final_work=pulled.work[-1])
        return pulled


class Never(AgeingMethod):
    """No site bonds."""

    kind = "typed-none"
    replicates = False

    def age(self, request: AgeingRequest) -> AgedBonds:
        return AgedBonds(bonds=np.zeros((1, request.hold_times.size)), sites=np.array([1.0]))


@hookimpl
def chemage_run_kinetics(engine: Engine, lattice: ReactionLattice) -> BondHistory | None:
    record(sites_seen=Output((), "", "sites of the lattice").of(lattice.sites.size))
    return None


class Steady(Rupture):
    """One force for each bond."""

    kind = "typed-steady"
    states = True
    outputs: ClassVar[Mapping[str, Output]] = {"most": Output("hold_time", "nN", "the force once more")}

    def force(self, bonded: Bonded) -> np.ndarray:
        force = 2.0 * bonded.states.sum(axis=1)
        self.record(most=force)
        return force


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
step: Surface = Step(height="2 nm").make()
