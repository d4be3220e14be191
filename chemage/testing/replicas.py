"""Finished replicas made by hand, for the checks of what is taken from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.kinetics.history import BondHistory
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Barriers


class Even(Barriers):
    """Barriers between 0.8 and 1.4 eV, for what needs some chemistry."""

    kind = "even"

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return 0.8 + 0.6 * uniform

    def density(self, energy: np.ndarray) -> np.ndarray:
        return np.where((energy >= 0.8) & (energy <= 1.4), 1 / 0.6, 0.0)


class Replica(NamedTuple):
    """What is there when the kinetics of a replica have been run."""

    contact: ContactSolution
    lattice: ReactionLattice
    history: BondHistory


def finished(
    n: int,
    bonded: int,
    *,
    grid: tuple[int, int] = (8, 8),
    times: Sequence[float] = (0.0, 10.0),
    breaking: bool = True,
    interacting: bool = True,
) -> Replica:
    """A finished replica: ``n`` sites scattered over the grid, ``bonded`` of them with a bond at the end."""
    rng = np.random.default_rng(n + 100 * grid[0])
    pixels = grid[0] * grid[1]
    touching = np.sort(rng.permutation(pixels)[: min(n + 3 * (n > 1), pixels)])
    if 1 < touching.size < pixels:
        touching[-1] = pixels - 1
    pressure = np.zeros(pixels)
    pressure[touching] = rng.uniform(0.3, 3.0, touching.size)
    contact = ContactSolution(
        pressure=pressure.reshape(grid), load=float(pressure.sum()) * 0.25, pixel_size=0.5, modulus=35.3, rms_slope=0.1
    )
    sites = touching[touching.size - n :]
    fields: dict[str, Any] = {"breaking": np.full(n, 1.1)} if breaking else {}
    if interacting:
        k = np.arange(n)
        near = np.stack([np.where(k + 1 < n, k + 1, -1), k - 1], axis=1) if n else np.empty((0, 2), int)
        fields |= {"neighbours": near.astype(np.int32), "coupling": np.where(near >= 0, 0.05, 0.0)}
    forming = np.sort(rng.uniform(0.8, 1.4, n))
    lattice = ReactionLattice(pixels=grid, sites=sites, forming=forming, pixel_size=0.5, **fields)
    counts = np.linspace(0 if len(times) > 1 else bonded, bonded, len(times)).astype(np.int64)
    history = BondHistory(
        hold_times=np.array(times),
        bonds=counts,
        formed=counts,
        broken=np.zeros(len(times), np.int64),
        state=np.arange(n) < bonded,
        time=times[-1],
        temperature=300.0,
        engine="by-hand",
        lattice_hash=lattice.digest(),
    )
    return Replica(contact, lattice, history)


def with_states(replica: Replica) -> Replica:
    """The replica with the state of every site at every hold time: a bond that has formed stays."""
    states = np.arange(replica.lattice.sites.size) < replica.history.bonds[:, None]
    return replica._replace(history=replica.history.model_copy(update={"states": states}))
