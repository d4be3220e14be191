"""Kernel of the direct method: an eight-way sum tree over the rates.

A node holds the sum of its eight children, which share one cache line (64 bytes). After an event the parents of every
changed leaf are summed again from their children; nothing is ever subtracted, so slow rates keep their last bit next to
rates 25 decades faster. One event reads the path to the chosen leaf (log8 n lines), the neighbour and coupling rows,
and for each of the three or so rows of pixels touched one line of energies and one of rates.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.random import uniform_pair
from chemage_kinetics._common import (
    STREAMS,
    bare,
    count_flip,
    count_sojourn,
    fixed_barrier,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    past,
    prefetch,
    rate,
    sojourn,
    two_uniforms,
    until,
)

WAYS = 8
#: A site is treated as a two-state chain when something else happens less often than once in so many of its flips.
FLICKER = 8.0

#: What the clock array (float64) and the counter array (int64) hold between calls.
HIGH, LOW = 0, 1
STREAM = STREAMS["rejection-free"]
EVENT, HOLD, LAST, DONE = 0, 1, 2, 3


def levels(sites: int) -> np.ndarray:
    """Where each level of the tree starts, the leaves first; the last entry is the size of the whole, (levels + 1,)."""
    starts = [0]
    width = max(sites, 1)
    while True:
        blocks = -(-width // WAYS)
        starts.append(starts[-1] + blocks * WAYS)
        if blocks == 1:
            return np.array(starts, np.int64)
        width = blocks


@hot
def _block_sum(tree, b):
    return ((tree[b] + tree[b + 1]) + (tree[b + 2] + tree[b + 3])) + (
        (tree[b + 4] + tree[b + 5]) + (tree[b + 6] + tree[b + 7])
    )


@jit
def fill(words, breaking, nu, per_unit, tree, starts):
    """Leaves from energies and states, then every level above; returns the total rate."""
    reversible = breaking.size > 0
    for i in range(words.size):
        word = words[i]
        if word & 1 == 0:
            tree[i] = rate(word >> 1, nu, per_unit)
        elif reversible:
            tree[i] = rate(fixed_barrier(breaking[i]), nu, per_unit)
        else:
            tree[i] = 0.0
    for i in range(words.size, starts[1]):
        tree[i] = 0.0
    for level in range(1, starts.size - 1):
        below = starts[level - 1]
        width = (starts[level] - below) // 8
        for i in range(width):
            tree[starts[level] + i] = _block_sum(tree, below + 8 * i)
        for i in range(starts[level] + width, starts[level + 1]):
            tree[i] = 0.0
    return _block_sum(tree, starts[starts.size - 2])


@hot
def _refresh(tree, starts, dirty, count):
    """Sum again every ancestor of the ``count`` leaf blocks listed in ``dirty``; returns the total."""
    for level in range(starts.size - 2):
        below = starts[level]
        above = starts[level + 1]
        kept = 0
        for d in range(count):
            block = dirty[d]
            tree[above + block] = _block_sum(tree, below + 8 * block)
            parent = block >> 3
            known = False
            for e in range(kept):
                if dirty[e] == parent:
                    known = True
                    break
            if not known:
                dirty[kept] = parent
                kept += 1
        count = kept
    return _block_sum(tree, starts[starts.size - 2])


@inner
def _set_leaf(tree, starts, dirty, leaf, value):
    tree[leaf] = value
    dirty[0] = leaf >> 3
    return _refresh(tree, starts, dirty, 1)


@hot
def _fetch_sites(node, words, neighbours, coupling, breaking):
    """Ask for all that belongs to the eight sites of a leaf block."""
    prefetch(words, 8 * node, 8 * node + 8)
    prefetch(neighbours, 8 * node, 8 * node + 8)
    prefetch(coupling, 8 * node, 8 * node + 8)
    if breaking.size > 0:
        prefetch(breaking, 8 * node, 8 * node + 8)


@hot
def _descend(tree, base, target):
    """The child at which the running sum passes ``target``, never one of zero rate; and what is left of the target."""
    chosen = 0
    for s in range(8):
        w = tree[base + s]
        if w > 0.0:
            chosen = s
            if target < w:
                break
            target -= w
    return chosen, target


@hot
def _pick(tree, starts, target, words, neighbours, coupling, breaking):
    """The leaf at which the running sum of rates passes ``target``; never a leaf of zero rate."""
    node = 0
    for level in range(starts.size - 2, -1, -1):
        if level == 0:
            # One of these eight sites it will be: fetch what belongs to them while their rates are on the way.
            _fetch_sites(node, words, neighbours, coupling, breaking)
        child, target = _descend(tree, starts[level] + 8 * node, target)
        node = 8 * node + child
    return node


@inner
def _pick_plainly(tree, starts, target):
    node = 0
    for level in range(starts.size - 2, -1, -1):
        child, target = _descend(tree, starts[level] + 8 * node, target)
        node = 8 * node + child
    return node


@hot
def _shift(i, words, neighbours, coupling, tree, above, near):
    """Turn the state of site i over and move its neighbours' energies; returns how many free neighbours ``near`` lists.

    The neighbours' lines are all asked for in this short loop, so that their latencies overlap; the next one, long with
    exponentials, finds them in cache.
    """
    word = words[i] ^ 1
    words[i] = word
    sign = 2 if word & 1 else -2
    found = 0
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[i, s])
        if j >= 0:
            prefetch(tree, j, j + 1)
            prefetch(tree, above + (j >> 3), above + (j >> 3) + 1)
            word = words[j] + sign * fixed_coupling(coupling[i, s])
            words[j] = word
            if word & 1 == 0:
                near[found, 0] = j
                near[found, 1] = word >> 1
                found += 1
    return found


@hot
def _rates(i, found, words, breaking, nu, per_unit, tree, starts, dirty, near):
    """New rates of site i and of the ``found`` sites in ``near``, and every sum above them; returns the total."""
    word = words[i]
    if word & 1 == 0:
        tree[i] = rate(word >> 1, nu, per_unit)
    elif breaking.size > 0:
        tree[i] = rate(fixed_barrier(breaking[i]), nu, per_unit)
    else:
        tree[i] = 0.0
    dirty[0] = i >> 3
    count = 1
    for s in range(found):
        j = near[s, 0]
        tree[j] = rate(near[s, 1], nu, per_unit)
        block = j >> 3
        known = False
        for e in range(count):
            if dirty[e] == block:
                known = True
                break
        if not known:
            dirty[count] = block
            count += 1
    return _refresh(tree, starts, dirty, count)


@inner
def _flip(i, words, neighbours, coupling, breaking, nu, per_unit, tree, starts, dirty, near):
    """Form or break the bond of site i: new energies and rates around it; returns the total rate."""
    found = _shift(i, words, neighbours, coupling, tree, starts[1], near)
    return _rates(i, found, words, breaking, nu, per_unit, tree, starts, dirty, near)


@inner
def _dwell(
    rng,
    i,
    high,
    low,
    limit,
    rate_back,
    leave_back,
    words,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    tree,
    starts,
    dirty,
    near,
    tally,
    hold,
):
    """Follow site i, which flips to and fro, until something else happens or the time ``limit`` comes.

    Returns the clock and the site of the last event.
    """
    rate_here = tree[i]
    leave_here = _set_leaf(tree, starts, dirty, i, 0.0)
    if leave_here * FLICKER >= rate_here:
        _set_leaf(tree, starts, dirty, i, rate_here)
        return high, low, i
    spent, exited, other, out_here, out_there = sojourn(
        rng, rate_here, rate_back, leave_here, leave_back, until(high, low, limit)
    )
    count_sojourn(tally, hold, words[i], out_here, out_there, other)
    if exited:
        high, low = later(high, low, spent)
    if not exited or past(high, low, limit):
        high = limit
        low = 0.0
    if other:
        _flip(i, words, neighbours, coupling, breaking, nu, per_unit, tree, starts, dirty, near)
        rate_here = tree[i]
        leave_here = _set_leaf(tree, starts, dirty, i, 0.0)
    if not exited:
        _set_leaf(tree, starts, dirty, i, rate_here)
        return high, low, i
    j = _pick_plainly(tree, starts, two_uniforms(rng)[0] * leave_here)
    _set_leaf(tree, starts, dirty, i, rate_here)
    _flip(j, words, neighbours, coupling, breaking, nu, per_unit, tree, starts, dirty, near)
    count_flip(tally, hold, words[j])
    return high, low, j


@jit
def advance(
    k0,
    k1,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    hold_times,
    superbasins,
    words,
    tree,
    starts,
    clock,
    counters,
    tally,
    events,
):
    """Go on for at most ``events`` events, or to the last hold time (then ``counters[DONE]`` is 1).

    superbasins: True or None, so that the chain is compiled only where it is used.
    tally: (m, 3) int64, bonds formed, broken, and the difference, between the hold time before and this one. ``words``,
    ``tree``, ``clock`` and ``counters`` carry the state from call to call.
    """
    dirty = np.empty(neighbours.shape[1] + 1, np.int64)
    near = np.empty((neighbours.shape[1], 2), np.int64)
    _advance(
        k0,
        k1,
        neighbours,
        coupling,
        breaking,
        nu,
        per_unit,
        hold_times,
        superbasins,
        words,
        tree,
        starts,
        clock,
        counters,
        tally,
        events,
        dirty,
        near,
        np.empty(5, np.uint64),
    )


@inner
def _advance(
    k0,
    k1,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    hold_times,
    superbasins,
    words,
    tree,
    starts,
    clock,
    counters,
    tally,
    events,
    dirty,
    near,
    rng,
):
    neighbours = bare(neighbours)
    coupling = bare(coupling)
    breaking = bare(breaking)
    hold_times = bare(hold_times)
    words = bare(words)
    tree = bare(tree)
    starts = bare(starts)
    tally = bare(tally)
    dirty = bare(dirty)
    near = bare(near)
    rng = bare(rng)
    high = clock[HIGH]
    low = clock[LOW]
    event = counters[EVENT]
    hold = counters[HOLD]
    last = counters[LAST]
    final = hold_times[hold_times.size - 1]
    total = _block_sum(tree, starts[starts.size - 2])
    done = False
    while events > 0:
        if total <= 0.0:
            done = True
            break
        u, v = uniform_pair(k0, k1, STREAM, event, 0)
        step = -math.log(u) / total
        if high + step > 2.0 * final + 1.0:
            done = True
            break
        next_high, next_low = later(high, low, step)
        if past(next_high, next_low, final):
            done = True
            break
        high = next_high
        low = next_low
        while past(high, low, hold_times[hold]):
            hold += 1
        i = _pick(tree, starts, v * total, words, neighbours, coupling, breaking)
        event += 1
        events -= 1

        rate_back = tree[i]
        leave_back = np.inf
        if superbasins is not None and i == last and breaking.size > 0:
            # The site has flipped twice running: what else could have happened?
            leave_back = _set_leaf(tree, starts, dirty, i, 0.0)
        found = _shift(i, words, neighbours, coupling, tree, starts[1], near)
        total = _rates(i, found, words, breaking, nu, per_unit, tree, starts, dirty, near)
        count_flip(tally, hold, words[i])
        last = i
        if superbasins is not None and leave_back * FLICKER < rate_back:
            rng[0] = k0
            rng[1] = k1
            rng[2] = np.uint64(STREAM)
            rng[3] = np.uint64(event - 1)
            rng[4] = np.uint64(1)  # block 0 was the event's own
            high, low, last = _dwell(
                rng,
                i,
                high,
                low,
                hold_times[hold],
                rate_back,
                leave_back,
                words,
                neighbours,
                coupling,
                breaking,
                nu,
                per_unit,
                tree,
                starts,
                dirty,
                near,
                tally,
                hold,
            )
            total = _block_sum(tree, starts[starts.size - 2])
    clock[HIGH] = high
    clock[LOW] = low
    counters[EVENT] = event
    counters[HOLD] = hold
    counters[LAST] = last
    counters[DONE] = 1 if done else 0
