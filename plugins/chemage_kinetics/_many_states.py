"""Kernel of the direct method for sites of any number of states.

Every transition of every site has a leaf in the tree of `_rejection_free`, with the rate 0 where the site is in another
state; the forming and the breaking of the bond are the first two. Bonded neighbours change the barriers of a site by
shares of the sum of their couplings, a whole number that does not depend on the past.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage.plugin import random
from chemage_kinetics._common import (
    DONE,
    EVENT,
    HOLD,
    STREAMS,
    Array,
    Float,
    Holds,
    Instant,
    Int,
    Key,
    KineticModel,
    RampBounds,
    borrowed,
    count_flip,
    crossing_over_bound,
    degree,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    neighbour,
    past,
)
from chemage_kinetics._rejection_free import (
    SiteRates,
    mark,
    refresh,
    select,
    sum_leaves,
    tree_total,
)

STREAM = STREAMS["many-states"]
FREE, BONDED = np.int64(0), np.int64(1)
#: Blocks of random numbers of an event, and the draw of a site that comes into contact.
FIRST, FURTHER, INITIAL = np.int64(0), np.int64(1), 4


class Transitions(NamedTuple):
    """Forming and breaking, then those of the lattice."""

    pairs: Array
    """(t, 2) int64: states before and after"""
    barriers: Array
    """(n, t) int64: fixed-point barriers without bonded neighbours"""
    terms: Array
    """(t, 2): the share of the couplings that the barrier feels, and Hz without a barrier"""


class ManyStatesRun(NamedTuple):
    """Everything a run consists of; its arrays carry the state from call to call."""

    key: Key
    holds: Holds
    model: KineticModel
    transitions: Transitions
    states: Array
    """(n,) int64"""
    fields: Array
    """(n,) int64: the couplings of the bonded neighbours, in fixed point"""
    rates: SiteRates
    changes: Array
    """(m, states) int64: how many sites more are in each state than at the hold time before"""
    clock: Array
    """(2,) float64: the present instant"""
    counters: Array
    """(5,) int64, as of `RejectionFreeRun`"""


@hot
def barrier_of(i: Int, t: Int, run: ManyStatesRun) -> Int:
    """The present fixed-point barrier of a transition of site i."""
    felt = np.rint(run.transitions.terms[t, 0] * run.fields[i])
    return run.transitions.barriers[i, t] + np.int64(felt)


@hot
def rate_of(i: Int, t: Int, run: ManyStatesRun) -> Float:
    """The rate of a transition of site i; 0 where the site is in another state."""
    if run.transitions.pairs[t, 0] != run.states[i]:
        return 0.0
    barrier = max(barrier_of(i, t, run), 0)
    return run.transitions.terms[t, 1] * math.exp(-(barrier * run.model.per_unit))


@hot
def renew(i: Int, count: Int, run: ManyStatesRun) -> Int:
    """Fill the leaves of site i; returns the number of marked blocks, see `mark`."""
    transitions = run.transitions.terms.shape[0]
    for t in range(transitions):
        leaf = i * transitions + t
        run.rates.tree[leaf] = rate_of(i, t, run)
        count = mark(run.rates, leaf >> 3, count)
    return count


@inner
def accepted(
    i: Int, t: Int, now: Instant, ramp: RampBounds, run: ManyStatesRun
) -> Float:
    """The probability that an event takes place in a ramp, see `over_bound`."""
    levels = ramp.breaking if t == 1 else ramp.forming
    if t > 1:  # a ramp changes no other barrier
        levels = levels[:, :0]
    barrier = barrier_of(i, t, run)
    return crossing_over_bound(i, barrier, levels, now, ramp, run.model)


@inner
def change(i: Int, t: Int, hold: Int, run: ManyStatesRun) -> Float:
    """Take site i through a transition; returns the total rate."""
    before, after = run.transitions.pairs[t, 0], run.transitions.pairs[t, 1]
    run.states[i] = after
    run.changes[hold, before] -= 1
    run.changes[hold, after] += 1
    count = renew(i, np.int64(0), run)
    if before == BONDED or after == BONDED:
        count_flip(run.holds.tally, hold, np.int64(after == BONDED))
        sign = 1 if after == BONDED else -1
        for s in range(degree(run.model)):
            j = neighbour(i, s, run.model)
            if j >= 0:
                run.fields[j] += sign * fixed_coupling(run.model.coupling[i, s])
                count = renew(j, count, run)
    return refresh(run.rates, count)


@jit
def fill(run: ManyStatesRun) -> None:
    """Fill the tree of rates."""
    run = borrowed(run)
    for i in range(run.states.size):
        renew(i, np.int64(0), run)
    sum_leaves(run.states.size * run.transitions.terms.shape[0], run.rates)


@jit
def advance(
    run: ManyStatesRun, superbasins: None, ramp: RampBounds | None, events: Int
) -> None:
    """Go on for at most ``events`` events, or to the last hold time (then ``counters[DONE]`` is 1)."""
    run = borrowed(run)
    k0, k1 = run.key.k0, run.key.k1
    times = run.holds.times
    now = run.clock[0], run.clock[1]
    event = run.counters[EVENT]
    hold = run.counters[HOLD]
    total = tree_total(run.rates)
    done = False
    while events > 0:
        if total <= 0.0:
            done = True
            break
        u, v = random.uniform_pair(k0, k1, STREAM, event, FIRST)
        then = later(now, -math.log(u) / total)
        if past(then, times[times.size - 1]):
            done = True
            break
        now = then
        while past(now, times[hold]):
            hold += 1
        u, w = random.uniform_pair(k0, k1, STREAM, event, FURTHER)
        leaf = select(run.rates, v * total, w)
        i, t = divmod(leaf, run.transitions.terms.shape[0])
        event += 1
        events -= 1
        if ramp is not None and u >= accepted(i, t, now, ramp, run):
            continue
        total = change(i, t, hold, run)
    run.clock[0], run.clock[1] = now
    run.counters[EVENT] = event
    run.counters[HOLD] = hold
    run.counters[DONE] = 1 if done else 0
