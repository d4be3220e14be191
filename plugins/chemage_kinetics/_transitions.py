"""The transitions of sites of any number of states, and the states with which a run begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import KB, random
from chemage_kinetics._common import LARGEST_BARRIER, UNITS_PER_EV, Array
from chemage_kinetics._driver import further
from chemage_kinetics._many_states import BONDED, FREE, INITIAL, STREAM, Transitions

if TYPE_CHECKING:
    from chemage import ReactionLattice
    from chemage_kinetics._driver import Job

#: stands for the rate out of states that nothing leaves, Hz
NEVER = 1e-200


def transitions_of(lattice: ReactionLattice) -> Transitions:
    """All transitions of a lattice; where bonds last, over an infinite barrier."""
    breaking = np.inf if lattice.breaking is None else lattice.breaking
    pairs, terms = [[FREE, BONDED], [BONDED, FREE]], [[1.0, 1.0], [0.0, 1.0]]
    barriers = [lattice.forming, breaking + np.zeros_like(lattice.forming)]
    if own := further(lattice):
        pairs, terms = [*pairs, *own[0]], [*terms, *own[2]]
        barriers += [*own[1].T]
    energies = np.clip(np.stack(barriers, 1), -LARGEST_BARRIER, LARGEST_BARRIER)
    return Transitions(
        np.array(pairs, np.int64),
        np.rint(energies * UNITS_PER_EV).astype(np.int64),
        np.array(terms) * [1.0, lattice.attempt_frequency],
    )


def in_equilibrium(
    transitions: Transitions, temperature: float, states: int
) -> Array:
    """Shares of ``states`` states to which free sites without bonds come in time: (states, n).

    By elimination without a subtraction (Grassmann, Taksar and Heyman, Oper. Res. 33, 1107 (1985)), so that rates keep
    their accuracy over any range.
    """
    energies = np.maximum(transitions.barriers.T / UNITS_PER_EV, 0.0)
    shares = np.ones((states, energies.shape[1]))
    rates = np.zeros((states, *shares.shape))
    with np.errstate(under="ignore"):
        crossed = np.exp(-energies / (KB * temperature))
        for number, (before, after) in enumerate(transitions.pairs):
            if BONDED not in (before, after):
                factor = transitions.terms[number, 1]
                rates[before, after] += factor * crossed[number]
        for last in range(states - 1, 0, -1):
            out = rates[last, :last]
            rates[:last, last] /= np.maximum(out.sum(axis=0), NEVER)
            rates[:last, :last] += rates[:last, last, None] * out
        for state in range(1, states):
            shares[state] = (shares[:state] * rates[:state, state]).sum(axis=0)
            shares[: state + 1] /= shares[: state + 1].sum(axis=0)
    return shares


def initial_states(
    job: Job, transitions: Transitions, temperature: float, count: int
) -> Array:
    """(n,) int64: of ``count`` states those with which a run begins at ``temperature`` K.

    They are those of its history, where -1 stands for a site that was not in contact; a bond that broke in a run of two
    states left its site free.
    """
    lattice = job.lattice
    states = np.full(job.state.size, -1)
    if job.pending is not None and "occupied" in job.pending:
        states = np.array(job.pending.occupied(count))
    new = states < 0
    states[states == BONDED] = FREE
    if lattice.states is not None and lattice.initial is None and new.any():
        shares = in_equilibrium(transitions, temperature, count)[:, new]
        ranks = random.uniforms(
            np.array(job.key), STREAM, lattice.random_index[new], INITIAL
        )
        below = np.cumsum(shares, axis=0)[:-1] <= ranks
        states[new] = below.sum(axis=0)
    else:
        states[new] = lattice.initial or FREE
    states[job.state] = BONDED
    return states
