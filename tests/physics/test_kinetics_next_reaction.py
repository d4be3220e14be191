"""The queue of `next-reaction` (buckets, chunks, lazy entries) against the simplest program with the same random
numbers: one that searches all pending times for the smallest before every event."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chemage
from chemage import ReactionLattice
from chemage.plugin import KB
from chemage.plugin import random as cr
from chemage_kinetics._common import STREAMS
from chemage_kinetics._driver import noise_key


def lattice_of(side: int, spread: float) -> ReactionLattice:
    """A periodic square in full contact, barriers uniform over ``spread`` eV, bonds that break."""
    pairs = chemage.interaction("elastic-pairs", strength=0.5, bias=0.1)
    sites = np.arange(side * side)
    neighbours = pairs.neighbours((side, side), True, sites)
    return ReactionLattice(
        pixels=(side, side),
        sites=sites,
        forming=0.75 + spread * cr.uniforms(3, 900, sites),
        breaking=0.95 + 0.2 * cr.uniforms(3, 901, sites),
        neighbours=neighbours,
        coupling=pairs.coupling(sites, neighbours, 3),
    )


def plainly(
    lattice: ReactionLattice, times: list[float], temperature: float, seed: int
) -> tuple[np.ndarray, list[int]]:
    """The state at the end, and the bonds formed up to each time."""
    n = lattice.sites.size
    neighbours, coupling, breaking = (np.asarray(a) for a in (lattice.neighbours, lattice.coupling, lattice.breaking))
    energy, state, draws = np.array(lattice.forming), np.zeros(n, bool), np.zeros(n, int)
    nu, kt = lattice.attempt_frequency, KB * temperature
    stream = STREAMS["next-reaction"]
    key = np.array(noise_key(seed, stream, lattice))

    def wait(i: int) -> float:
        u = cr.uniforms(key, stream, [lattice.sites[i]], int(draws[i]))[0]
        draws[i] += 1
        return -math.log(u) / nu * math.exp(max(breaking[i] if state[i] else energy[i], 0.0) / kt)

    pending = np.array([wait(i) for i in range(n)])
    formed, counts = 0, []
    for end in times:
        while True:
            i = int(pending.argmin())
            now = pending[i]
            if now > end:
                break
            state[i] = not state[i]
            formed += int(state[i])
            for j, change in zip(neighbours[i], coupling[i], strict=True):
                if j < 0:
                    continue
                before = max(energy[j], 0.0)
                energy[j] += change if state[i] else -change
                if not state[j]:
                    pending[j] = now + (pending[j] - now) * math.exp((max(energy[j], 0.0) - before) / kt)
            pending[i] = now + wait(i)
        counts.append(formed)
    return state, counts


@pytest.mark.parametrize(
    ("side", "spread", "temperature", "times"),
    [
        (10, 0.4, 300.0, [1.0, 1e3, 1e5]),  # one bucket
        (30, 0.4, 300.0, [1.0, 1e3, 1e5]),
        (30, 0.2, 400.0, [0.01, 0.1, 1.0]),  # many events a site
        (130, 0.05, 300.0, [1.0, 50.0, 300.0]),  # all in a few octaves: crowded buckets
    ],
)
def test_events_come_in_the_order_of_their_times(side, spread, temperature, times):
    lattice = lattice_of(side, spread)
    state, formed = plainly(lattice, times, temperature, seed=5)
    history = chemage.engine("next-reaction").run(lattice, times, temperature=temperature, seed=5)
    assert formed[-1] > 0.25 * side**2
    assert history.formed.tolist() == formed
    assert history.state.tolist() == state.tolist()
