"""Rates of all sites in an eight-way sum tree, and beside it a short list of the fastest sites.

A node of the tree holds the sum of its eight children, which share one cache line (64 bytes). When leaves change, their
ancestors are summed again from their children; nothing is ever subtracted, so slow rates keep their last bit next to
rates 25 decades faster.

On large lattices a site that has more than a thousandth of the rate of the whole tree, such as one whose bond has just
broken by chance, is moved to the list while it is so fast. Selections from the tree then hardly depend on such sites,
so they can be predicted; see `chemage_kinetics._rejection_free`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from chemage_kinetics._common import Model, site_rate
from chemage_kinetics._memory import Float, Int, borrowed, hot, inner, jit, prefetch

WAYS = 8
#: Selecting a leaf takes one random number for this many upper levels and another one for the levels below.
UPPER = 3
#: Sites in the list at most (the square of 8); each has more than this part of the rate of the whole tree.
ROOM = np.int64(64)  # typed, because numba compiles what it is passed to once more for a literal
FAST = 1.0 / 1024.0
NONE = np.int64(-1)
ONE = np.int64(1)


class Rates(NamedTuple):
    """The rate of every site: in its leaf or, for a listed site, in the list."""

    tree: np.ndarray
    """(size,) float64 Hz, the leaves first, then the levels above; aligned to cache lines"""
    starts: np.ndarray
    """(levels + 1,) int64: where each level starts; the last entry is the size of the whole tree"""
    sites: np.ndarray
    """(ROOM,) int64: the listed sites"""
    rates: np.ndarray
    """(ROOM + 8,) float64 Hz: their rates, then the sums over blocks of eight"""
    listed: np.ndarray
    """(1,) int64: how many sites are listed"""
    dirty: np.ndarray
    """(k + 1,) int64 scratch: blocks whose ancestors are to be summed again"""
    listing: bool
    """whether fast sites are listed; changes which random numbers decide what"""


def empty_rates(sites: int, slots: int, listing: bool) -> Rates:
    """Memory for the rates of ``sites`` sites with ``slots`` neighbours each; see `fill`."""
    starts = _levels(sites)
    rates = _aligned(int(ROOM) + 8)
    rates[:] = 0.0
    return Rates(
        tree=_aligned(int(starts[-1])),
        starts=starts,
        sites=np.full(ROOM, NONE),
        rates=rates,
        listed=np.zeros(1, np.int64),
        dirty=np.empty(slots + 1, np.int64),
        listing=listing,
    )


def _levels(sites: int) -> np.ndarray:
    starts = [0]
    width = max(sites, 1)
    while True:
        blocks = -(-width // WAYS)
        starts.append(starts[-1] + blocks * WAYS)
        if blocks == 1:
            return np.array(starts, np.int64)
        width = blocks


def _aligned(size: int) -> np.ndarray:
    """float64 (size,) starting on a cache line of 64 bytes."""
    room = np.empty(size + 8)
    offset = (-room.ctypes.data // 8) % 8
    return room[offset : offset + size]


# -- sums ----------------------------------------------------------------------------------------------------------


@hot
def _block_sum(tree: np.ndarray, b: Int) -> Float:
    return ((tree[b] + tree[b + 1]) + (tree[b + 2] + tree[b + 3])) + (
        (tree[b + 4] + tree[b + 5]) + (tree[b + 6] + tree[b + 7])
    )


@hot
def tree_total(rates: Rates) -> Float:
    """Total rate of the tree."""
    return _block_sum(rates.tree, rates.starts[rates.starts.size - 2])


@hot
def list_total(rates: Rates) -> Float:
    """Total rate of the listed sites."""
    return _block_sum(rates.rates, ROOM)


@jit
def fill(words: np.ndarray, model: Model, rates: Rates) -> None:
    """Fill the leaves from energies and states, then every level above."""
    words = borrowed(words)
    model = borrowed(model)
    rates = borrowed(rates)
    tree = rates.tree
    starts = rates.starts
    for i in range(words.size):
        tree[i] = site_rate(i, words, model)
    for i in range(words.size, starts[1]):
        tree[i] = 0.0
    for level in range(1, starts.size - 1):
        below = starts[level - 1]
        width = (starts[level] - below) // 8
        for i in range(width):
            tree[starts[level] + i] = _block_sum(tree, below + 8 * i)
        for i in range(starts[level] + width, starts[level + 1]):
            tree[i] = 0.0


@hot
def mark(rates: Rates, block: Int, count: Int) -> Int:
    """Add a block to the first ``count`` of ``dirty`` if it is not one of them; returns their number."""
    for d in range(count):
        if rates.dirty[d] == block:
            return count
    rates.dirty[count] = block
    return count + 1


@hot
def refresh(rates: Rates, count: Int) -> Float:
    """Sum again every ancestor of the ``count`` leaf blocks in ``dirty``; returns the total of the tree."""
    tree = rates.tree
    dirty = rates.dirty
    for level in range(rates.starts.size - 2):
        below = rates.starts[level]
        above = rates.starts[level + 1]
        kept = np.int64(0)
        for d in range(count):
            block = dirty[d]
            tree[above + block] = _block_sum(tree, below + 8 * block)
            kept = mark(rates, block >> 3, kept)
        count = kept
    return tree_total(rates)


# -- the list of fast sites ----------------------------------------------------------------------------------------


@hot
def _find(i: Int, rates: Rates) -> Int:
    """The position of site i in the list, or -1. Without a branch, so that it runs on vector registers."""
    found = 0
    for h in range(rates.listed[0]):
        found += h + 1 if rates.sites[h] == i else 0
    return found - 1


@hot
def _enter(h: Int, i: Int, value: Float, rates: Rates) -> None:
    rates.sites[h] = i
    rates.rates[h] = value
    rates.rates[ROOM + (h >> 3)] = _block_sum(rates.rates, h & ~7)


@hot
def threshold(rates: Rates) -> Float:
    """The rate above which a site is listed."""
    return FAST * tree_total(rates) if rates.listing else np.inf


@hot
def settle(i: Int, value: Float, fast: Float, rates: Rates) -> None:
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
def _settle_cold(i: Int, value: Float, fast: Float, rates: Rates) -> None:
    settle(i, value, fast, rates)


@jit
def relist(fast: np.ndarray, rates: Rates) -> None:
    """Move the sites ``fast`` (int64) from a newly filled tree to the list, in the order in which they were there."""
    for h in range(fast.size):
        _enter(h, fast[h], rates.tree[fast[h]], rates)
        rates.tree[fast[h]] = 0.0
        rates.dirty[0] = fast[h] >> 3
        refresh(rates, ONE)
    rates.listed[0] = fast.size


@inner
def rate_of(i: Int, rates: Rates) -> Float:
    """The rate of site i, whether it is listed or not."""
    h = _find(i, rates)
    return rates.rates[h] if h >= 0 else rates.tree[i]


@inner
def set_aside(i: Int, rates: Rates) -> Float:
    """Exclude site i from the selection; returns the total rate of all others."""
    _settle_cold(i, 0.0, np.inf, rates)
    rates.dirty[0] = i >> 3
    return refresh(rates, ONE) + list_total(rates)


@inner
def put_back(i: Int, value: Float, rates: Rates) -> None:
    """Undo `set_aside`: site i has the rate ``value``."""
    _settle_cold(i, value, threshold(rates), rates)
    rates.dirty[0] = i >> 3
    refresh(rates, ONE)


# -- selection -----------------------------------------------------------------------------------------------------


@hot
def descend(tree: np.ndarray, base: Int, target: Float) -> tuple[Int, Float]:
    """The child at which the running sum passes ``target``, never one of zero rate; and the rest of the target."""
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
def select(rates: Rates, target: Float, v: Float) -> Int:
    """The leaf at which the running sum of rates passes ``target``; never one of zero rate.

    With a ``v`` that is not 0, ``target`` selects only one of the nodes UPPER levels down, and ``v`` a leaf below it.
    An event elsewhere hardly changes the first selection and does not affect the second, so both can be predicted.
    """
    node = 0
    top = rates.starts.size - 2
    for level in range(top, -1, -1):
        child, target = descend(rates.tree, rates.starts[level] + 8 * node, target)
        node = 8 * node + child
        if level == top - UPPER + 1 and v > 0.0:
            target = v * rates.tree[rates.starts[level] + node]
    return node


@inner
def select_cold(rates: Rates, target: Float) -> Int:
    """`select` with a single random number; a function of its own, to be compiled once."""
    return select(rates, target, 0.0)


@hot
def select_listed(rates: Rates, target: Float) -> Int:
    """The position in the list at which the running sum of rates passes ``target``."""
    block, target = descend(rates.rates, ROOM, target)
    return 8 * block + descend(rates.rates, 8 * block, target)[0]


@hot
def prefetch_leaf(tree: np.ndarray, above: Int, i: Int) -> None:
    """Prefetch the leaf of site i and the sum above it; ``above``: where the second level of the tree starts."""
    prefetch(tree, i)
    prefetch(tree, above + (i >> 3))
