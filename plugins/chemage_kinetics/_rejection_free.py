"""Kernel of the direct method: every event is selected from the exact total rate, by an eight-way tree of sums.

A node of the tree holds the sum of its eight children, which share one cache line (64 bytes). When leaves change, their
ancestors are summed again from their children; nothing is ever subtracted, so slow rates keep their last bit next to
rates 25 decades faster.

On large lattices a site that has more than a thousandth of the rate of the whole tree, such as one whose bond has just
broken by chance, is moved to a short list while it is so fast. Selections from the tree then hardly depend on such
sites, so they can be predicted.

From a quarter of a million sites on (FAR) an event waits for memory longer than it computes: for the sums on its path,
the selected leaf, the rows of neighbours and couplings, and, in each of the three or so rows of pixels around it, for
one line of energies and two of rates. So the next selections are predicted, and their memory is prefetched in stages;
see `_look_ahead`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage.plugin import random
from chemage_kinetics._common import (
    DONE,
    DRAWN,
    EVENT,
    FLICKER,
    HOLD,
    LAST,
    STREAMS,
    Array,
    FlickerRates,
    Float,
    Holds,
    Instant,
    Int,
    Key,
    KineticModel,
    RampBounds,
    begin_sequence,
    block_sum,
    borrowed,
    count_flip,
    degree,
    descend,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    neighbour,
    over_bound,
    past,
    prefetch,
    prefetch_site,
    rate,
    site_rate,
    stay,
    two_uniforms,
)

WAYS = 8
#: Selecting a leaf takes one random number for this many upper levels and another one for the levels below.
UPPER = 3
#: Sites in the list at most (the square of 8); each has more than this part of the rate of the whole tree.
ROOM = np.int64(
    64
)  # typed, because numba compiles what it is passed to once more for a literal
FAST = 1.0 / 1024.0
NONE = np.int64(-1)
ONE = np.int64(1)


class SiteRates(NamedTuple):
    """The rate of every site: in its leaf or, for a listed site, in the list."""

    tree: Array
    """(size,) float64 Hz, the leaves first, then the levels above; aligned to cache lines"""
    starts: Array
    """(levels + 1,) int64: where each level starts; the last entry is the size of the whole tree"""
    sites: Array
    """(ROOM,) int64: the listed sites"""
    rates: Array
    """(ROOM + 8,) float64 Hz: their rates, then the sums over blocks of eight"""
    listed: Array
    """(1,) int64: how many sites are listed"""
    dirty: Array
    """(k + 1,) int64 scratch: blocks whose ancestors are to be summed again"""
    listing: bool
    """whether fast sites are listed; changes which random numbers decide what"""


def empty_rates(sites: int, slots: int, listing: bool) -> SiteRates:
    """Memory for the rates of ``sites`` sites with ``slots`` neighbours each; see `fill`."""
    ends, width = [0], max(sites, 1)
    while width > 1 or len(ends) == 1:
        width = -(-width // WAYS)
        ends.append(ends[-1] + width * WAYS)
    starts = np.array(ends, np.int64)
    rates = _aligned(int(ROOM) + 8)
    rates[:] = 0.0
    return SiteRates(
        tree=_aligned(int(starts[-1])),
        starts=starts,
        sites=np.full(ROOM, NONE),
        rates=rates,
        listed=np.zeros(1, np.int64),
        dirty=np.empty(slots + 1, np.int64),
        listing=listing,
    )


def _aligned(size: int) -> Array:
    """float64 (size,) starting on a cache line of 64 bytes."""
    room = np.empty(size + 8)
    offset = (-room.ctypes.data // 8) % 8
    return room[offset : offset + size]


# -- sums ----------------------------------------------------------------------------------------------------------


@hot
def tree_total(rates: SiteRates) -> Float:
    """Total rate of the tree."""
    return block_sum(rates.tree, rates.starts[rates.starts.size - 2])


@hot
def list_total(rates: SiteRates) -> Float:
    """Total rate of the listed sites."""
    return block_sum(rates.rates, ROOM)


@jit
def fill(words: Array, model: KineticModel, rates: SiteRates) -> None:
    """Fill the leaves from energies and states, then every level above."""
    words = borrowed(words)
    model = borrowed(model)
    rates = borrowed(rates)
    for i in range(words.size):
        rates.tree[i] = site_rate(i, words, model)
    sum_leaves(words.size, rates)


@inner
def sum_leaves(sites: Int, rates: SiteRates) -> None:
    """Fill every level above the leaves of ``sites``."""
    tree = rates.tree
    starts = rates.starts
    for i in range(sites, starts[1]):
        tree[i] = 0.0
    for level in range(1, starts.size - 1):
        below = starts[level - 1]
        width = (starts[level] - below) // 8
        for i in range(width):
            tree[starts[level] + i] = block_sum(tree, below + 8 * i)
        for i in range(starts[level] + width, starts[level + 1]):
            tree[i] = 0.0


@hot
def mark(rates: SiteRates, block: Int, count: Int) -> Int:
    """Add a block to the first ``count`` of ``dirty`` if it is not one of them; returns their number."""
    for d in range(count):
        if rates.dirty[d] == block:
            return count
    rates.dirty[count] = block
    return count + 1


@hot
def refresh(rates: SiteRates, count: Int) -> Float:
    """Sum again every ancestor of the ``count`` leaf blocks in ``dirty``; returns the total of the tree."""
    tree = rates.tree
    dirty = rates.dirty
    for level in range(rates.starts.size - 2):
        below = rates.starts[level]
        above = rates.starts[level + 1]
        kept = np.int64(0)
        for d in range(count):
            block = dirty[d]
            tree[above + block] = block_sum(tree, below + 8 * block)
            kept = mark(rates, block >> 3, kept)
        count = kept
    return tree_total(rates)


# -- the list of fast sites ----------------------------------------------------------------------------------------


@hot
def _find(i: Int, rates: SiteRates) -> Int:
    """The position of site i in the list, or -1. Without a branch, so that it runs on vector registers."""
    found = 0
    for h in range(rates.listed[0]):
        found += h + 1 if rates.sites[h] == i else 0
    return found - 1


@hot
def _enter(h: Int, i: Int, value: Float, rates: SiteRates) -> None:
    rates.sites[h] = i
    rates.rates[h] = value
    rates.rates[ROOM + (h >> 3)] = block_sum(rates.rates, h & ~7)


@hot
def threshold(rates: SiteRates) -> Float:
    """The rate above which a site is listed."""
    return FAST * tree_total(rates) if rates.listing else np.inf


@hot
def settle(i: Int, value: Float, fast: Float, rates: SiteRates) -> None:
    """Give site i its rate: in the list if it is above ``fast`` and there is room, otherwise in its leaf."""
    count = rates.listed[0]
    if count > 0 and rates.tree[i] == 0.0:  # as it is for listed sites
        h = _find(i, rates)
        if h >= 0:
            if value > fast:
                _enter(h, i, value, rates)
                return
            count -= 1
            rates.listed[0] = count
            _enter(h, rates.sites[count], rates.rates[count], rates)
            _enter(count, NONE, 0.0, rates)
    if value > fast and count < ROOM:
        _enter(count, i, value, rates)
        rates.listed[0] = count + 1
        value = 0.0
    rates.tree[i] = value


@inner
def _settle_cold(i: Int, value: Float, fast: Float, rates: SiteRates) -> None:
    settle(i, value, fast, rates)


@jit
def relist(fast: Array, rates: SiteRates) -> None:
    """Move the sites ``fast`` (int64) from a newly filled tree to the list, in the order in which they were there."""
    for h in range(fast.size):
        _enter(h, fast[h], rates.tree[fast[h]], rates)
        rates.tree[fast[h]] = 0.0
        rates.dirty[0] = fast[h] >> 3
        refresh(rates, ONE)
    rates.listed[0] = fast.size


@inner
def rate_of(i: Int, rates: SiteRates) -> Float:
    """The rate of site i, whether it is listed or not."""
    h = _find(i, rates)
    return rates.rates[h] if h >= 0 else rates.tree[i]


@inner
def set_aside(i: Int, rates: SiteRates) -> Float:
    """Exclude site i from the selection; returns the total rate of all others."""
    _settle_cold(i, 0.0, np.inf, rates)
    rates.dirty[0] = i >> 3
    return refresh(rates, ONE) + list_total(rates)


@inner
def put_back(i: Int, value: Float, rates: SiteRates) -> None:
    """Undo `set_aside`: site i has the rate ``value``."""
    _settle_cold(i, value, threshold(rates), rates)
    rates.dirty[0] = i >> 3
    refresh(rates, ONE)


# -- selection -----------------------------------------------------------------------------------------------------


@hot
def _node(
    rates: SiteRates, target: Float, v: Float, lowest: Int
) -> tuple[Int, Float]:
    """The node of the level ``lowest`` at which the running sum of rates passes ``target``, and the rest of it.

    With a ``v`` that is not 0, ``target`` selects only one of the nodes UPPER levels down, and ``v`` what lies below.
    """
    node = 0
    top = rates.starts.size - 2
    for level in range(top, lowest - 1, -1):
        child, target = descend(rates.tree, rates.starts[level] + 8 * node, target)
        node = 8 * node + child
        if level == top - UPPER + 1 and v > 0.0:
            target = v * rates.tree[rates.starts[level] + node]
    return node, target


@hot
def select(rates: SiteRates, target: Float, v: Float) -> Int:
    """The leaf at which the running sum of rates passes ``target``; never one of zero rate.

    An event elsewhere hardly changes what ``target`` selects and does not affect what ``v`` does (see `_node`), so both
    can be predicted.
    """
    return _node(rates, target, v, 0)[0]


@hot
def select_listed(rates: SiteRates, target: Float) -> Int:
    """The position in the list at which the running sum of rates passes ``target``."""
    block, target = descend(rates.rates, ROOM, target)
    return 8 * block + descend(rates.rates, 8 * block, target)[0]


@hot
def prefetch_leaf(tree: Array, above: Int, i: Int) -> None:
    """Prefetch the leaf of site i and the sum above it; ``above``: where the second level of the tree starts."""
    prefetch(tree, i)
    prefetch(tree, above + (i >> 3))


#: Sites from which on predicting pays: a smaller lattice fits the caches.
FAR = 1 << 18
#: Selections whose random numbers are kept, a power of two above the four predicted ones.
RING = 8

STREAM = STREAMS["rejection-free"]
#: Blocks of random numbers of one index: of an event, of a selection from the tree, and from where on of a sojourn.
OF_EVENT, OF_SELECTION, OF_SOJOURN = np.int64(0), np.int64(1), np.uint64(2)


class RejectionFreeRun(NamedTuple):
    """Everything a run consists of; its arrays carry the state from call to call."""

    key: Key
    holds: Holds
    model: KineticModel
    words: Array
    """(n,) int64, see `_common`"""
    rates: SiteRates
    near: Array
    """(k, 2) int64 scratch: unbonded neighbours of the present site, and their barriers"""
    draws: Array
    """(RING, 3) float64 scratch: two random numbers of each predicted selection, and what is left of its target"""
    spots: Array
    """(RING,) int64 scratch: the node that each of these has reached"""
    rng: Array
    """(5,) uint64 scratch, see `_common`"""
    clock: Array
    """(2,) float64: the present instant"""
    counters: Array
    """(5,) int64: the number of the next EVENT, the present HOLD time, the LAST site, whether the run is DONE, and the
    number of the next selection DRAWN from the tree"""


@hot
def _draw(run: RejectionFreeRun, drawn: Int) -> None:
    """The two random numbers that select the ``drawn``-th site from the tree."""
    slot = drawn & (RING - 1)
    run.draws[slot, 0], run.draws[slot, 1] = random.uniform_pair(
        run.key.k0, run.key.k1, STREAM, drawn, OF_SELECTION
    )


@hot
def _look_ahead(run: RejectionFreeRun, drawn: Int, total: Float) -> None:
    """Prefetch the memory of the next predicted events; a wrong prediction costs time and changes nothing.

    Four selections ahead the sums above the leaves, three ahead the leaves, two ahead the site's own rows, one ahead
    its neighbours: each stage finds in cache what the stage before has prefetched.
    """
    tree = run.rates.tree
    above = run.rates.starts[1]
    _draw(run, drawn + 4)
    slot = (drawn + 4) & (RING - 1)
    node, run.draws[slot, 2] = _node(
        run.rates, run.draws[slot, 0] * total, run.draws[slot, 1], 2
    )
    run.spots[slot] = node
    prefetch(tree, above + 8 * node)

    slot = (drawn + 3) & (RING - 1)
    node = run.spots[slot]
    child, run.draws[slot, 2] = descend(tree, above + 8 * node, run.draws[slot, 2])
    run.spots[slot] = 8 * node + child
    prefetch(tree, 8 * run.spots[slot])

    slot = (drawn + 2) & (RING - 1)
    node = run.spots[slot]
    node = min(
        8 * node + descend(tree, 8 * node, run.draws[slot, 2])[0],
        run.words.size - 1,
    )
    run.spots[slot] = node
    prefetch_site(node, run.words, run.model)

    node = run.spots[(drawn + 1) & (RING - 1)]
    for s in range(degree(run.model)):
        j = neighbour(node, s, run.model)
        if j >= 0:
            prefetch(run.words, j)
            prefetch_leaf(tree, above, j)


@hot
def _shift(run: RejectionFreeRun, i: Int) -> Int:
    """Change the state of site i and the energies of its neighbours; returns how many unbonded ones ``near`` lists.

    The neighbours' lines are all prefetched in this short loop, so that their latencies overlap; the next loop, long
    with exponentials, finds them in cache.
    """
    above = run.rates.starts[1]
    word = run.words[i] ^ 1
    run.words[i] = word
    sign = 2 if word & 1 else -2
    found = 0
    for s in range(degree(run.model)):
        j = neighbour(i, s, run.model)
        if j >= 0:
            prefetch_leaf(run.rates.tree, above, j)
            word = run.words[j] + sign * fixed_coupling(run.model.coupling[i, s])
            run.words[j] = word
            if word & 1 == 0:
                run.near[found, 0] = j
                run.near[found, 1] = word >> 1
                found += 1
    return found


@hot
def _update(run: RejectionFreeRun, i: Int, found: Int) -> Float:
    """New rates of site i and of the ``found`` sites in ``near``, and all sums above; returns the tree's total."""
    fast = threshold(run.rates)
    count = np.int64(0)
    for s in range(-1, found):
        if s < 0:
            j = i
            value = site_rate(i, run.words, run.model)
        else:
            j = run.near[s, 0]
            value = rate(run.near[s, 1], run.model)
        settle(j, value, fast, run.rates)
        count = mark(run.rates, j >> 3, count)
    return refresh(run.rates, count)


@inner
def _flip(run: RejectionFreeRun, i: Int) -> None:
    """Form or break the bond of site i: new energies and rates around it."""
    _update(run, i, _shift(run, i))


@inner
def _dwell(
    run: RejectionFreeRun,
    i: Int,
    now: Instant,
    hold: Int,
    rate_back: Float,
    leave_back: Float,
) -> tuple[Instant, Int]:
    """Follow site i, which flickers, until something else happens or the present hold time is reached.

    Returns the clock and the site of the last event.
    """
    run = borrowed(run)
    rates = run.rates
    rate_here = rate_of(i, rates)
    leave_here = set_aside(i, rates)
    if leave_here * FLICKER >= rate_here:
        put_back(i, rate_here, rates)
        return now, i
    chain = FlickerRates(rate_here, rate_back, leave_here, leave_back)
    now, exited, other = stay(run.rng, chain, now, run.holds, hold, run.words[i])
    if other:
        _flip(run, i)
        rate_here = rate_of(i, rates)
        leave_here = set_aside(i, rates)
    if not exited:
        put_back(i, rate_here, rates)
        return now, i
    target = two_uniforms(run.rng)[0] * leave_here
    if target < list_total(rates):
        j = rates.sites[select_listed(rates, target)]
    else:
        j = select(rates, two_uniforms(run.rng)[0] * tree_total(rates), 0.0)
    put_back(i, rate_here, rates)
    _flip(run, j)
    count_flip(run.holds.tally, hold, run.words[j])
    return now, j


@hot
def _select(
    run: RejectionFreeRun, v: Float, drawn: Int, total: Float, listed: Float
) -> tuple[Int, Float, Int]:
    """Select the site of an event, ``v`` uniform on (0, 1); returns the site, its rate, and selections drawn so far."""
    rates = run.rates
    v *= total + listed
    if v < listed:
        h = select_listed(rates, v)
        return rates.sites[h], rates.rates[h], drawn
    w = 0.0
    if rates.listing:
        _look_ahead(run, drawn, total)
        v = run.draws[drawn & (RING - 1), 0] * total
        w = run.draws[drawn & (RING - 1), 1]
    i = select(rates, v, w)
    return i, rates.tree[i], drawn + 1


@jit
def advance(
    run: RejectionFreeRun,
    superbasins: bool | None,
    ramp: RampBounds | None,
    events: Int,
) -> None:
    """Go on for at most ``events`` events, or to the last hold time (then ``counters[DONE]`` is 1).

    superbasins: True or None, so that the two-state chain is compiled only where it is used; None with a ``ramp``.
    """
    run = borrowed(run)
    times = run.holds.times
    final = times[times.size - 1]
    now = run.clock[0], run.clock[1]
    event = run.counters[EVENT]
    drawn = run.counters[DRAWN]
    hold = run.counters[HOLD]
    last = run.counters[LAST]
    total = tree_total(run.rates)
    done = False
    if run.rates.listing:
        for e in range(drawn, drawn + 4):
            _draw(run, e)
    while events > 0:
        listed = list_total(run.rates)
        if total + listed <= 0.0:
            done = True
            break
        u, v = random.uniform_pair(run.key.k0, run.key.k1, STREAM, event, OF_EVENT)
        step = -math.log(u) / (total + listed)
        then = later(now, step)
        if past(then, final):
            done = True
            break
        now = then
        while past(now, times[hold]):
            hold += 1
        i, rate_back, drawn = _select(run, v, drawn, total, listed)
        event += 1
        events -= 1
        if ramp is not None:
            u, _ = random.uniform_pair(
                run.key.k0, run.key.k1, STREAM, event - 1, np.int64(OF_SOJOURN)
            )
            if u >= over_bound(i, run.words[i], now, ramp, run.model):
                continue

        leave_back = np.inf
        if superbasins is not None and i == last and run.model.breaking.size > 0:
            # Two events in a row on this site: at what total rate could anything else have happened?
            leave_back = set_aside(i, run.rates)
        total = _update(run, i, _shift(run, i))
        count_flip(run.holds.tally, hold, run.words[i])
        last = i
        if superbasins is not None and leave_back * FLICKER < rate_back:
            begin_sequence(run.rng, run.key, STREAM, event - 1, OF_SOJOURN)
            now, last = _dwell(run, i, now, hold, rate_back, leave_back)
            total = tree_total(run.rates)
    run.clock[0], run.clock[1] = now
    run.counters[EVENT] = event
    run.counters[DRAWN] = drawn
    run.counters[HOLD] = hold
    run.counters[LAST] = last
    run.counters[DONE] = 1 if done else 0
