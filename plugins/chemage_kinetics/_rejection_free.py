"""Kernel of the direct method: an eight-way sum tree over the rates.

A node holds the sum of its eight children, which share one cache line (64 bytes). After an event the parents of every
changed leaf are summed again from their children; nothing is ever subtracted, so slow rates keep their last bit next to
rates 25 decades faster.

From a quarter of a million sites on (FAR) an event waits for memory more than it computes: the sums on its path, the
chosen leaf, the neighbour and coupling rows, and for each of the three or so rows of pixels touched one line of
energies and two of rates. So the next choices in the tree are foreseen and their memory asked for, stage by stage, see
`_look_ahead`. A site with more than a thousandth of the rate of the whole tree, as one whose bond has just broken by
chance, is taken out of it into a short list while it lasts: the choices inside the tree then hardly depend on it.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.random import uniform_pair
from chemage_kinetics._common import (
    STREAMS,
    bare,
    count_flip,
    count_sojourn,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    own_rate,
    past,
    rate,
    sojourn,
    touch,
    touch_site,
    two_uniforms,
    until,
)

WAYS = 8
#: A choice in the tree takes one number for this many levels and another for those below.
UPPER = 3
#: Sites from which on it pays to look ahead: a smaller lattice fits the caches.
FAR = 1 << 18
#: Events whose draws are kept, a power of two above the four looked ahead.
RING = 8
#: A site is treated as a two-state chain when something else happens less often than once in so many of its flips.
FLICKER = 8.0

#: The list of fast sites holds so many (the square of 8), those above this part of the rate of the whole tree.
ROOM = 64
FAST = 1.0 / 1024.0

#: What the clock array (float64) and the counter array (int64) hold between calls.
HIGH, LOW = 0, 1
STREAM = STREAMS["rejection-free"]
EVENT, HOLD, LAST, DONE, DRAWN, LISTED = 0, 1, 2, 3, 4, 5


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
    for i in range(words.size):
        tree[i] = own_rate(i, words, breaking, nu, per_unit)
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


@hot
def _find(i, sites, count):
    """Where site i stands in the list, or -1; without a branch, so that vector registers do it."""
    found = 0
    for h in range(count):
        found += h + 1 if sites[h] == i else 0
    return found - 1


@hot
def _enter(h, i, value, sites, rates):
    sites[h] = i
    rates[h] = value
    rates[ROOM + (h >> 3)] = _block_sum(rates, h & ~7)


@hot
def _settle(i, value, fast, tree, sites, rates, counters):
    """Give site i its rate: in the list if that is above ``fast`` and there is room, otherwise in its leaf."""
    count = counters[LISTED]
    if count > 0 and tree[i] == 0.0:  # as it is for those in the list
        h = _find(i, sites, count)
        if h >= 0:
            if value > fast:
                _enter(h, i, value, sites, rates)
                return
            count -= 1
            counters[LISTED] = count
            _enter(h, sites[count], rates[count], sites, rates)
            _enter(count, -1, 0.0, sites, rates)
    if value > fast and count < ROOM:
        _enter(count, i, value, sites, rates)
        counters[LISTED] = count + 1
        value = 0.0
    tree[i] = value


@inner
def _settle_cold(i, value, fast, tree, sites, rates, counters):
    _settle(i, value, fast, tree, sites, rates, counters)


@hot
def _bar(far, tree, starts):
    """The rate above which a site is listed."""
    return FAST * _block_sum(tree, starts[starts.size - 2]) if far else np.inf


@jit
def relist(fast, tree, starts, sites, rates):
    """Move the sites ``fast`` (int64) from a newly filled tree to the list, where they were; returns their number."""
    dirty = np.empty(1, np.int64)
    for h in range(fast.size):
        _enter(h, fast[h], tree[fast[h]], sites, rates)
        tree[fast[h]] = 0.0
        dirty[0] = fast[h] >> 3
        _refresh(tree, starts, dirty, 1)
    return fast.size


@inner
def _own(i, tree, sites, rates, counters):
    """The rate of site i, wherever it stands."""
    h = _find(i, sites, counters[LISTED])
    return rates[h] if h >= 0 else tree[i]


@inner
def _set_aside(i, tree, starts, dirty, sites, rates, counters):
    """Take the rate of site i out of the draw; returns the total rate of all others."""
    _settle_cold(i, 0.0, np.inf, tree, sites, rates, counters)
    dirty[0] = i >> 3
    return _refresh(tree, starts, dirty, 1) + _block_sum(rates, ROOM)


@inner
def _put_back(i, value, far, tree, starts, dirty, sites, rates, counters):
    """Undo `_set_aside`."""
    _settle_cold(i, value, _bar(far, tree, starts), tree, sites, rates, counters)
    dirty[0] = i >> 3
    _refresh(tree, starts, dirty, 1)


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
def _pick(tree, starts, target, v):
    """The leaf at which the running sum of rates passes ``target``; never one of zero rate.

    With a ``v`` that is not 0, ``target`` only picks one of the nodes UPPER levels down, and ``v`` a leaf below it. An
    event elsewhere hardly moves the first choice and does not touch the second, so `_look_ahead` can foresee them.
    """
    node = 0
    top = starts.size - 2
    for level in range(top, -1, -1):
        child, target = _descend(tree, starts[level] + 8 * node, target)
        node = 8 * node + child
        if level == top - UPPER + 1 and v > 0.0:
            target = v * tree[starts[level] + node]
    return node


@inner
def _pick_cold(tree, starts, target):
    return _pick(tree, starts, target, 0.0)


@hot
def _pick_listed(target, rates):
    """The entry of the list at which the running sum passes ``target``."""
    block, target = _descend(rates, ROOM, target)
    return 8 * block + _descend(rates, 8 * block, target)[0]


@hot
def _begin(tree, starts, total, draws, spots, slot):
    """First stage of looking ahead: down to the last level but two."""
    node = 0
    top = starts.size - 2
    target = draws[slot, 0] * total
    for level in range(top, 1, -1):
        child, target = _descend(tree, starts[level] + 8 * node, target)
        node = 8 * node + child
        if level == top - UPPER + 1:
            target = draws[slot, 1] * tree[starts[level] + node]
    spots[slot] = node
    draws[slot, 2] = target
    touch(tree, starts[1] + 8 * node)


@hot
def _draw(k0, k1, drawn, draws):
    """The two numbers that pick the ``drawn``-th site from the tree; block 0 of an index is the event's own."""
    draws[drawn & (RING - 1), 0], draws[drawn & (RING - 1), 1] = uniform_pair(k0, k1, STREAM, drawn, 1)


@hot
def _look_ahead(drawn, k0, k1, tree, starts, total, words, neighbours, coupling, breaking, draws, spots):
    """Ask for the memory of the next events while there is time; a wrong guess costs that time and nothing else.

    Four draws ahead the sums above the leaves, three ahead the leaves, two ahead the site's own rows, one ahead its
    neighbours: each stage finds what the stage before has asked for.
    """
    _draw(k0, k1, drawn + 4, draws)
    _begin(tree, starts, total, draws, spots, (drawn + 4) & (RING - 1))

    slot = (drawn + 3) & (RING - 1)
    node = spots[slot]
    child, draws[slot, 2] = _descend(tree, starts[1] + 8 * node, draws[slot, 2])
    spots[slot] = 8 * node + child
    touch(tree, 8 * spots[slot])

    slot = (drawn + 2) & (RING - 1)
    node = spots[slot]
    node = min(8 * node + _descend(tree, 8 * node, draws[slot, 2])[0], words.size - 1)
    spots[slot] = node
    touch_site(node, words, neighbours, coupling, breaking)

    node = spots[(drawn + 1) & (RING - 1)]
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[node, s])
        if j >= 0:
            touch(words, j)
            touch(tree, j)
            touch(tree, starts[1] + (j >> 3))


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
            touch(tree, j)
            touch(tree, above + (j >> 3))
            word = words[j] + sign * fixed_coupling(coupling[i, s])
            words[j] = word
            if word & 1 == 0:
                near[found, 0] = j
                near[found, 1] = word >> 1
                found += 1
    return found


@hot
def _rates(i, found, far, words, breaking, nu, per_unit, tree, starts, dirty, near, sites, rates, counters):
    """New rates of site i and of the ``found`` sites in ``near``, and all sums above; returns the tree's total."""
    fast = _bar(far, tree, starts)
    count = 0
    for s in range(-1, found):
        if s < 0:
            j = i
            value = own_rate(i, words, breaking, nu, per_unit)
        else:
            j = near[s, 0]
            value = rate(near[s, 1], nu, per_unit)
        _settle(j, value, fast, tree, sites, rates, counters)
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
def _flip(
    i, far, words, neighbours, coupling, breaking, nu, per_unit, tree, starts, dirty, near, sites, rates, counters
):
    """Form or break the bond of site i: new energies and rates around it."""
    found = _shift(i, words, neighbours, coupling, tree, starts[1], near)
    _rates(i, found, far, words, breaking, nu, per_unit, tree, starts, dirty, near, sites, rates, counters)


@inner
def _dwell(
    rng,
    i,
    high,
    low,
    limit,
    rate_back,
    leave_back,
    far,
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
    sites,
    rates,
    counters,
    tally,
    hold,
):
    """Follow site i, which flips to and fro, until something else happens or the time ``limit`` comes.

    Returns the clock and the site of the last event.
    """
    rate_here = _own(i, tree, sites, rates, counters)
    leave_here = _set_aside(i, tree, starts, dirty, sites, rates, counters)
    if leave_here * FLICKER >= rate_here:
        _put_back(i, rate_here, far, tree, starts, dirty, sites, rates, counters)
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
        _flip(
            i,
            far,
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
            sites,
            rates,
            counters,
        )
        rate_here = _own(i, tree, sites, rates, counters)
        leave_here = _set_aside(i, tree, starts, dirty, sites, rates, counters)
    if not exited:
        _put_back(i, rate_here, far, tree, starts, dirty, sites, rates, counters)
        return high, low, i
    target = two_uniforms(rng)[0] * leave_here
    if target < _block_sum(rates, ROOM):
        j = sites[_pick_listed(target, rates)]
    else:
        j = _pick_cold(tree, starts, two_uniforms(rng)[0] * _block_sum(tree, starts[starts.size - 2]))
    _put_back(i, rate_here, far, tree, starts, dirty, sites, rates, counters)
    _flip(
        j, far, words, neighbours, coupling, breaking, nu, per_unit, tree, starts, dirty, near, sites, rates, counters
    )
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
    far,
    words,
    tree,
    starts,
    sites,
    rates,
    clock,
    counters,
    tally,
    events,
):
    """Go on for at most ``events`` events, or to the last hold time (then ``counters[DONE]`` is 1).

    superbasins: True or None, so that the chain is compiled only where it is used.
    far: whether to look ahead and to list fast sites; changes what is drawn.
    sites, rates: (ROOM,) and (ROOM + 8,), the list of fast sites and the sums of its blocks of eight.
    tally: (m, 3) int64, bonds formed, broken, and the difference, between the hold time before and this one. All from
    ``words`` to ``counters`` carry the state from call to call.
    """
    dirty = np.empty(neighbours.shape[1] + 1, np.int64)
    near = np.empty((neighbours.shape[1], 2), np.int64)
    draws = np.zeros((RING, 3))
    spots = np.zeros(RING, np.int64)
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
        far,
        words,
        tree,
        starts,
        sites,
        rates,
        clock,
        counters,
        tally,
        events,
        dirty,
        near,
        draws,
        spots,
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
    far,
    words,
    tree,
    starts,
    sites,
    rates,
    clock,
    counters,
    tally,
    events,
    dirty,
    near,
    draws,
    spots,
    rng,
):
    neighbours = bare(neighbours)
    coupling = bare(coupling)
    breaking = bare(breaking)
    hold_times = bare(hold_times)
    words = bare(words)
    tree = bare(tree)
    starts = bare(starts)
    sites = bare(sites)
    rates = bare(rates)
    counters = bare(counters)
    tally = bare(tally)
    dirty = bare(dirty)
    near = bare(near)
    draws = bare(draws)
    spots = bare(spots)
    rng = bare(rng)
    high = clock[HIGH]
    low = clock[LOW]
    event = counters[EVENT]
    drawn = counters[DRAWN]
    hold = counters[HOLD]
    last = counters[LAST]
    final = hold_times[hold_times.size - 1]
    total = _block_sum(tree, starts[starts.size - 2])
    done = False
    if far:
        for e in range(drawn, drawn + 4):
            _draw(k0, k1, e, draws)
    while events > 0:
        listed = _block_sum(rates, ROOM)
        both = total + listed
        if both <= 0.0:
            done = True
            break
        u, v = uniform_pair(k0, k1, STREAM, event, 0)
        step = -math.log(u) / both
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
        v *= both
        if v < listed:
            h = _pick_listed(v, rates)
            i = sites[h]
            rate_back = rates[h]
        else:
            w = 0.0
            if far:
                _look_ahead(drawn, k0, k1, tree, starts, total, words, neighbours, coupling, breaking, draws, spots)
                v = draws[drawn & (RING - 1), 0] * total
                w = draws[drawn & (RING - 1), 1]
            i = _pick(tree, starts, v, w)
            rate_back = tree[i]
            drawn += 1
        event += 1
        events -= 1

        leave_back = np.inf
        if superbasins is not None and i == last and breaking.size > 0:
            # The site has flipped twice running: what else could have happened?
            leave_back = _set_aside(i, tree, starts, dirty, sites, rates, counters)
        found = _shift(i, words, neighbours, coupling, tree, starts[1], near)
        total = _rates(i, found, far, words, breaking, nu, per_unit, tree, starts, dirty, near, sites, rates, counters)
        count_flip(tally, hold, words[i])
        last = i
        if superbasins is not None and leave_back * FLICKER < rate_back:
            rng[0] = k0
            rng[1] = k1
            rng[2] = np.uint64(STREAM)
            rng[3] = np.uint64(event - 1)
            rng[4] = np.uint64(2)  # the blocks before were the event's own, and the choice's in the tree
            high, low, last = _dwell(
                rng,
                i,
                high,
                low,
                hold_times[hold],
                rate_back,
                leave_back,
                far,
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
                sites,
                rates,
                counters,
                tally,
                hold,
            )
            total = _block_sum(tree, starts[starts.size - 2])
    clock[HIGH] = high
    clock[LOW] = low
    counters[EVENT] = event
    counters[DRAWN] = drawn
    counters[HOLD] = hold
    counters[LAST] = last
    counters[DONE] = 1 if done else 0
