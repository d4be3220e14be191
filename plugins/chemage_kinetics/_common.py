"""What the kernels share: fixed-point energies, rates, a clock that does not stall, counts of events.

Energies are whole multiples of 2**-40 eV in int64. A bond adds its pair energies to its neighbours and takes the same
whole numbers away when it breaks, so the energy of a site depends on the present bonds and not on their history: no
drift, and a restart is bit-exact. Where a site's energy and its state are needed together they share one word,
``2 * energy + bonded``, so that a neighbour costs one cache line.

Times are unevaluated sums ``high + low`` of two doubles. At t = 1e5 s and a total rate of 1e13 Hz a single double would
not advance at all.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from chemage.plugin import random
from chemage_kinetics._memory import Float, Int, borrowed, hot, inner, jit, prefetch

#: Fixed-point units in an electronvolt.
UNITS_PER_EV = 2.0**40
#: Barriers and couplings are limited to these, in eV; below 1e6 K, exp has long overflowed or underflowed there.
LARGEST_BARRIER = 2.0**20
LARGEST_COUPLING = 2.0**15
#: A rate below exp(-COLDEST) times the attempt frequency is zero.
COLDEST = 745.0
#: Event counts stop here instead of overflowing.
MOST = np.int64(2**61)

#: Each engine has its own stream of random numbers.
STREAMS = {
    "rejection-free": random.KINETICS,
    "bkl": random.KINETICS + 1,
    "next-reaction": random.KINETICS + 2,
    "independent": random.KINETICS + 3,
}


class Key(NamedTuple):
    """The key of a run's random numbers, see `chemage_kinetics._identity`."""

    k0: np.uint64
    k1: np.uint64


class Model(NamedTuple):
    """Everything about a lattice at one temperature that does not change during a run, but the forming barriers.

    neighbours: (n, k) int32, -1 where there is none; k = 0 where nothing interacts. coupling: (n, k) eV. breaking: (n,)
    eV, or empty where bonds never break. nu: Hz. per_unit: 1/k_B T over one fixed-point unit of energy.
    """

    neighbours: np.ndarray
    coupling: np.ndarray
    breaking: np.ndarray
    nu: float
    per_unit: float


class Sites(NamedTuple):
    """All sites in their present states. What takes ``sites`` takes any tuple with these two."""

    words: np.ndarray
    """(n,) int64, see above"""
    model: Model


class Holds(NamedTuple):
    """Hold times (m,) s, and the (m, 3) int64 counts of bonds formed, bonds broken, and their difference, each between
    the hold time before and this one."""

    times: np.ndarray
    tally: np.ndarray


# -- memory --------------------------------------------------------------------------------------------------------


@hot
def prefetch_rows(i: Int, model: Model) -> None:
    """Prefetch the graph rows of site i, which may lie across two cache lines."""
    prefetch(model.neighbours, i)
    prefetch(model.neighbours, i + 1)
    prefetch(model.coupling, i)
    prefetch(model.coupling, i + 1)


@hot
def prefetch_site(i: Int, words: np.ndarray, model: Model) -> None:
    """Prefetch everything that belongs to site i alone."""
    prefetch(words, i)
    prefetch_rows(i, model)
    if model.breaking.size > 0:
        prefetch(model.breaking, i)


# -- energies and rates --------------------------------------------------------------------------------------------


@inner
def fixed_barrier(energy: Float) -> Int:
    """eV to fixed point, limited to ±2**20 eV."""
    return np.int64(np.rint(min(max(energy, -LARGEST_BARRIER), LARGEST_BARRIER) * UNITS_PER_EV))


@inner
def fixed_coupling(energy: Float) -> Int:
    """eV to fixed point, limited to ±2**15 eV."""
    return np.int64(np.rint(min(max(np.float64(energy), -LARGEST_COUPLING), LARGEST_COUPLING) * UNITS_PER_EV))


@jit
def start_words(forming: np.ndarray, model: Model, state: np.ndarray, words: np.ndarray) -> None:
    """Fill ``words`` (n,) int64 with 2 * (forming barrier with the present neighbours) + bonded."""
    forming = borrowed(forming)
    model = borrowed(model)
    state = borrowed(state)
    words = borrowed(words)
    n, k = model.neighbours.shape
    for i in range(n):
        words[i] = 2 * fixed_barrier(forming[i]) + state[i]
    for i in range(n):
        if state[i]:
            for s in range(k):
                j = model.neighbours[i, s]
                if j >= 0:
                    words[j] += 2 * fixed_coupling(model.coupling[i, s])


@inner
def rate(barrier: Int, nu: Float, per_unit: Float) -> Float:
    """nu exp(-E/kT) for a fixed-point barrier; nu where E <= 0. ``per_unit`` is 1/kT over one fixed-point unit."""
    if barrier <= 0:
        return nu
    return nu * math.exp(-(barrier * per_unit))


@inner
def site_rate(site: Int, words: np.ndarray, model: Model) -> Float:
    """The rate at which a site changes its state: forms its bond or breaks it. 0 for a bond that never breaks."""
    word = words[site]
    if word & 1 == 0:
        return rate(word >> 1, model.nu, model.per_unit)
    if model.breaking.size > 0:
        return rate(fixed_barrier(model.breaking[site]), model.nu, model.per_unit)
    return 0.0


@inner
def rate_around(site: Int, sites: Any) -> Float:
    """Total rate of a site's neighbours."""
    total = 0.0
    for s in range(sites.model.neighbours.shape[1]):
        j = np.int64(sites.model.neighbours[site, s])
        if j >= 0:
            total += site_rate(j, sites.words, sites.model)
    return total


@inner
def choose_around(site: Int, u: Float, sites: Any) -> Int:
    """A neighbour of the site, by its rate; ``u`` uniform on (0, 1)."""
    target = u * rate_around(site, sites)
    chosen = -1
    for s in range(sites.model.neighbours.shape[1]):
        j = np.int64(sites.model.neighbours[site, s])
        if j >= 0:
            w = site_rate(j, sites.words, sites.model)
            if w > 0.0:
                chosen = j
                if target < w:
                    break
                target -= w
    return chosen


@inner
def change_state(site: Int, sites: Any) -> None:
    """Form or break the bond of a site: its own word, and its neighbours' energies."""
    sites.words[site] ^= 1
    sign = 2 if sites.words[site] & 1 else -2
    for s in range(sites.model.neighbours.shape[1]):
        j = np.int64(sites.model.neighbours[site, s])
        if j >= 0:
            sites.words[j] += sign * fixed_coupling(sites.model.coupling[site, s])


# -- the clock -----------------------------------------------------------------------------------------------------


@inner
def later(high: Float, low: Float, step: Float) -> tuple[Float, Float]:
    """(high + low) + step, step >= 0 and finite, as a normalised pair of doubles."""
    s = high + step
    b = s - high
    low += (high - (s - b)) + (step - b)
    top = s + low
    return top, low - (top - s)


@inner
def past(high: Float, low: Float, time: Float) -> bool:
    """Whether the instant high + low comes after ``time``."""
    return high > time or (high == time and low > 0.0)


@inner
def until(high: Float, low: Float, time: Float) -> Float:
    """Seconds from the instant high + low to ``time``, not negative."""
    return max((time - high) - low, 0.0)


# -- counts --------------------------------------------------------------------------------------------------------


@inner
def _add(total: Float, more: Float) -> Int:
    if more >= 2.0e18 or total + np.int64(more) > MOST:
        return MOST
    return total + np.int64(more)


@inner
def count_flip(tally: np.ndarray, hold: Int, word: Int) -> None:
    """Count an event that has taken place; ``word & 1`` is the new state. tally: see `Holds`."""
    if word & 1:
        tally[hold, 0] += 1
        tally[hold, 2] += 1
    else:
        tally[hold, 1] += 1
        tally[hold, 2] -= 1


@inner
def count_sojourn(tally: np.ndarray, hold: Int, word: Int, out_here: Float, out_there: Float, other: bool) -> None:
    """Count the flips of a sojourn from the state ``word & 1``; counts stop at 2**61, the difference is exact."""
    bonded = word & 1
    tally[hold, 0] = _add(tally[hold, 0], out_there if bonded else out_here)
    tally[hold, 1] = _add(tally[hold, 1], out_here if bonded else out_there)
    if other:
        tally[hold, 2] += -1 if bonded else 1
