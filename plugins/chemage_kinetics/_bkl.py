"""Kernel of the n-fold way: classes of rates by powers of two, and thinning.

An attempt selects a class by its weight and one of its slots evenly, and accepts the member that is there, if any, with
the probability rate / 2**-c. The clock advances on every attempt, and after a rejected attempt everything is drawn
anew: the attempts are a Poisson process of known rate and the events a thinned one, so both times and selections are
exact. (If the weights were exact sums of rates, a rejected attempt would have to stay in its class; with weights that
are bounds that would be wrong.)

A site whose rate rises above its bound moves at once. One whose rate falls stays where it is, since the bound still
holds, and moves when an attempt on it is rejected. Most blocked neighbours are never attempted, so an event moves one
site instead of nine, and a bond that breaks again finds its neighbours where they were.

From a quarter of a million sites on (FAR) an attempt waits for memory longer than it computes, so the next attempts are
predicted and their memory is prefetched; see `_look_ahead`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage.plugin import random
from chemage_kinetics._common import (
    DONE,
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
    RampBounds,
    Sites,
    begin_sequence,
    borrowed,
    change_state,
    choose_around,
    count_flip,
    degree,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    neighbour,
    over_bound,
    past,
    prefetch,
    prefetch_rows,
    prefetch_site,
    rate,
    rate_around,
    stay,
    two_uniforms,
)
from chemage_kinetics._rate_classes import (
    PLACE,
    SLOTS,
    Classes,
    accepts,
    barrier_of,
    class_of,
    insert,
    put_back,
    remove,
    select_class,
    set_aside,
    site_class,
    total_weight,
    weigh,
)

#: Sites from which on predicting pays: a smaller lattice fits the caches.
FAR = 1 << 18
#: Attempts whose random numbers are kept, a power of two above the three predicted ones.
RING = 4

STREAM = STREAMS["bkl"]
#: Blocks of random numbers of one attempt: two of its own, and from where on of a sojourn.
FIRST, SECOND, OF_SOJOURN = np.int64(0), np.int64(1), np.uint64(2)


class BklRun(NamedTuple):
    """Everything a run consists of; its arrays carry the state from call to call."""

    key: Key
    holds: Holds
    classes: Classes
    draws: Array
    """(RING, 4) float64 scratch, of this and the next attempts: waiting time, class, slot, acceptance"""
    spots: Array
    """(RING,) int64 scratch: a predicted entry of the arena, then the site there"""
    predicting: bool
    """whether to look ahead; changes nothing but the time"""
    near: Array
    """(k + 1, 2) int64 scratch: sites that change their class, and the class"""
    rng: Array
    """(5,) uint64 scratch, see `_common`"""
    clock: Array
    """(2,) float64: the present instant"""
    counters: Array
    """(4,) int64: the number of the next attempt (EVENT), the present HOLD time, the LAST site, whether the run is
    DONE"""


@hot
def _flip(i: Int, classes: Classes, near: Array) -> None:
    """Form or break the bond of site i; move it, and every neighbour now above its bound, to the right class."""
    records = classes.records
    model = classes.model
    word = records[i, 0] ^ 1
    records[i, 0] = word
    sign = 2 if word & 1 else -2
    moves = 1
    near[0, 0] = i
    near[0, 1] = site_class(i, classes)
    for s in range(degree(model)):
        j = neighbour(i, s, model)
        if j >= 0:
            word = records[j, 0] + sign * fixed_coupling(model.coupling[i, s])
            records[j, 0] = word
            if word & 1 == 0:
                c = class_of(word >> 1, classes.per_class)
                present = records[j, 1] >> 32
                if c >= 0 and (c + 1 < present or present == 0):
                    if present > 0:
                        prefetch(
                            classes.arena,
                            classes.first[present - 1] + (records[j, 1] & PLACE),
                        )
                    near[moves, 0] = j
                    near[moves, 1] = c
                    moves += 1
    for m in range(moves):
        j = near[m, 0]
        c = remove(j, classes)
        target = near[m, 1]
        near[m, 0] = c
        if target >= 0:
            insert(j, target, classes)
    for m in range(moves):
        for side in range(2):
            c = near[m, side]
            if c >= 0 and classes.sums[c >> 3] < 0.0:
                weigh(c, classes)


@hot
def _attempt(
    u: Float, v: Float, w: Float, total: Float, classes: Classes
) -> tuple[Int, Float]:
    """The site that an attempt selects and accepts by three uniform numbers, or -1; moves a rejected site whose class
    is out of date. Also returns the total weight afterwards."""
    c = select_class(u * total, classes)
    slot = np.int64(v * classes.slots[c, SLOTS])
    if slot >= classes.counts[c]:
        return np.int64(-1), total
    i = np.int64(classes.arena[classes.first[c] + slot])
    prefetch_rows(i, classes.model)
    if accepts(w, i, c, classes):
        return i, total
    if site_class(i, classes) != c:
        set_aside(i, classes)
        put_back(i, classes)
        total = total_weight(classes)
    return np.int64(-1), total


@inner
def _dwell(
    run: BklRun, i: Int, now: Instant, hold: Int, rate_back: Float
) -> tuple[Instant, Int]:
    """Follow site i, which flickers, until something else is attempted or the present hold time is reached.

    Its neighbours differ in rate between its two states, so they leave their classes as well and react at their exact
    rates; all others are attempted at the weight of their classes, which does not depend on the state. Returns the
    clock and the site of the last event.
    """
    run = borrowed(run)
    classes = run.classes
    nu = classes.model.nu
    rate_here = rate(barrier_of(i, classes), classes.model)
    if nu * set_aside(i, classes) * FLICKER >= rate_here:
        put_back(i, classes)
        return now, i
    for s in range(degree(classes.model)):
        j = neighbour(i, s, classes.model)
        if j >= 0:
            set_aside(j, classes)
    sites = Sites(classes.records[:, 0], classes.model)
    elsewhere = nu * total_weight(classes)
    around = rate_around(i, sites)
    change_state(i, sites)
    around_back = rate_around(i, sites)
    change_state(i, sites)
    rates = FlickerRates(
        rate_here, rate_back, elsewhere + around, elsewhere + around_back
    )
    now, exited, other = stay(run.rng, rates, now, run.holds, hold, sites.words[i])
    if other:
        change_state(i, sites)
        around = around_back
    j = np.int64(-1)
    if exited:
        u, v = two_uniforms(run.rng)
        if u * (elsewhere + around) < around:
            j = choose_around(i, v, sites)
        else:
            u, v = two_uniforms(run.rng)
            w = two_uniforms(run.rng)[0]
            j = _attempt(u, v, w, total_weight(classes), classes)[0]
    put_back(i, classes)
    for s in range(degree(classes.model)):
        beside = neighbour(i, s, classes.model)
        if beside >= 0:
            put_back(beside, classes)
    if j < 0:
        return now, i
    _flip(j, classes, run.near)
    count_flip(run.holds.tally, hold, classes.records[j, 0])
    return now, j


@hot
def _draw(run: BklRun, attempt: Int) -> None:
    """The four random numbers of an attempt."""
    e = attempt & (RING - 1)
    k0, k1 = run.key
    run.draws[e, 0], run.draws[e, 1] = random.uniform_pair(
        k0, k1, STREAM, attempt, FIRST
    )
    run.draws[e, 2], run.draws[e, 3] = random.uniform_pair(
        k0, k1, STREAM, attempt, SECOND
    )


@hot
def _look_ahead(run: BklRun, attempt: Int, total: Float) -> None:
    """Prefetch the memory of the next predicted attempts; a wrong prediction costs time and changes nothing.

    Three attempts ahead the entry in the list of members, two ahead the site's own rows, one ahead its neighbours: each
    stage finds in cache what the stage before has prefetched.
    """
    classes = run.classes
    _draw(run, attempt + 3)
    e = (attempt + 3) & (RING - 1)
    c = select_class(run.draws[e, 1] * total, classes)
    spot = classes.first[c] + min(
        np.int64(run.draws[e, 2] * classes.slots[c, SLOTS]), classes.counts[c]
    )
    run.spots[e] = spot
    prefetch(classes.arena, spot)

    e = (attempt + 2) & (RING - 1)
    i = np.int64(classes.arena[run.spots[e]])
    i = min(
        max(i, 0), classes.records.shape[0] - 1
    )  # not a site where the list has moved meanwhile
    run.spots[e] = i
    prefetch_site(i, classes.records, classes.model)

    i = run.spots[(attempt + 1) & (RING - 1)]
    for s in range(degree(classes.model)):
        j = neighbour(i, s, classes.model)
        if j >= 0:
            prefetch(classes.records, j)


@jit
def advance(
    run: BklRun, superbasins: bool | None, ramp: RampBounds | None, attempts: Int
) -> None:
    """Go on for at most ``attempts`` attempts, or to the last hold time (then ``counters[DONE]`` is 1).

    superbasins: True or None, so that the two-state chain is compiled only where it is used; None with a ``ramp``.
    """
    run = borrowed(run)
    classes = run.classes
    nu = classes.model.nu
    times = run.holds.times
    final = times[times.size - 1]
    now = run.clock[0], run.clock[1]
    event = run.counters[EVENT]
    hold = run.counters[HOLD]
    last = run.counters[LAST]
    done = False
    total = total_weight(classes)
    if run.predicting:
        for e in range(event, event + 3):
            _draw(run, e)
    while attempts > 0:
        if total <= 0.0:
            done = True
            break
        if run.predicting:
            _look_ahead(run, event, total)
        else:
            _draw(run, event)
        e = event & (RING - 1)
        step = -math.log(run.draws[e, 0]) / (nu * total)
        then = later(now, step)
        if past(then, final):
            done = True
            break
        now = then
        while past(now, times[hold]):
            hold += 1
        draws = run.draws
        i, total = _attempt(draws[e, 1], draws[e, 2], draws[e, 3], total, classes)
        event += 1
        attempts -= 1
        if i < 0:
            continue
        if ramp is not None:
            u, _ = random.uniform_pair(
                run.key.k0, run.key.k1, STREAM, event - 1, np.int64(OF_SOJOURN)
            )
            if u >= over_bound(i, classes.records[i, 0], now, ramp, classes.model):
                continue

        rate_back = 0.0
        leave_back = np.inf
        if (
            superbasins is not None
            and i == last
            and classes.model.breaking.size > 0
        ):
            # Two events in a row on this site: at what total rate could anything else have been attempted?
            rate_back = rate(barrier_of(i, classes), classes.model)
            leave_back = nu * set_aside(i, classes)
        _flip(i, classes, run.near)
        count_flip(run.holds.tally, hold, classes.records[i, 0])
        last = i
        if superbasins is not None and leave_back * FLICKER < rate_back:
            begin_sequence(run.rng, run.key, STREAM, event - 1, OF_SOJOURN)
            now, last = _dwell(run, i, now, hold, rate_back)
        total = total_weight(classes)
    run.clock[0], run.clock[1] = now
    run.counters[EVENT] = event
    run.counters[HOLD] = hold
    run.counters[LAST] = last
    run.counters[DONE] = 1 if done else 0
