"""Kernel of the n-fold way: classes of rates by powers of two, whole-number counts, thinning.

A site in class c has a rate of at most 2**-c times the attempt frequency. The class of a rate is the whole part of
E / (kT ln 2), so it costs no exponential. A class weighs count * 2**-c, from a whole-number count: nothing accumulates.
An attempt draws a class by weight and a member evenly, and takes it with the probability rate / 2**-c. The clock
advances on every attempt, and a rejected attempt draws everything anew: the attempts are a Poisson process of known
rate and the events a thinned one, so both times and choices are exact. (Weights that are exact sums of rates would need
the rejected attempt to stay in its class; with bounds for weights that would be wrong.)

A site whose rate rises above its bound moves at once. One whose rate falls stays where it is, since the bound still
holds, and moves when an attempt on it is rejected. Most blocked neighbours are never attempted, so an event moves one
site instead of nine, and a bond that breaks again finds its neighbours where they were.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.random import uniform_pair
from chemage_kinetics._common import (
    COLDEST,
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

#: Classes down to the smallest rate that is told from zero, in groups of eight.
CLASSES = 8 * math.ceil((COLDEST / math.log(2.0) + 1.0) / 8.0)
GROUPS = CLASSES // 8
#: A site is treated as a two-state chain when something else happens less often than once in so many of its flips.
FLICKER = 8.0
SHARE = 1.0 / math.log(2.0)

#: 2**-c; a constant of the compiled code.
SCALE = np.ldexp(1.0, -np.arange(CLASSES))

HIGH, LOW = 0, 1
STREAM = STREAMS["bkl"]
EVENT, HOLD, LAST, DONE, FIRST_GROUP, LAST_GROUP = 0, 1, 2, 3, 4, 5

_POS = np.int64(0xFFFFFFFF)


@hot
def _class_of(barrier, per_class):
    """The class of a fixed-point barrier; -1 where the rate is zero to double precision."""
    if barrier <= 0:
        return 0
    octaves = barrier * per_class
    if octaves >= CLASSES - 1.0:
        return -1
    return int(octaves)


@hot
def _barrier(i, records, breaking):
    """The barrier to what site i can do next, fixed point; not for a bonded site where bonds never break."""
    word = records[i, 0]
    if word & 1 == 0:
        return word >> 1
    return fixed_barrier(breaking[i])


@hot
def _site_class(i, records, breaking, per_class):
    if records[i, 0] & 1 and breaking.size == 0:
        return -1
    return _class_of(_barrier(i, records, breaking), per_class)


@jit
def sort(words, breaking, per_class, records, counts):
    """The sites in ascending order of class, those of zero rate last, and the number in each class; (n,) int32."""
    counts[:] = 0
    for i in range(words.size):
        records[i, 0] = words[i]
        c = _site_class(i, records, breaking, per_class)
        records[i, 1] = c
        if c >= 0:
            counts[c] += 1
    begin = np.zeros(counts.size + 1, np.int64)
    for c in range(counts.size):
        begin[c + 1] = begin[c] + counts[c]
    order = np.empty(words.size, np.int32)
    for i in range(words.size):
        c = records[i, 1] if records[i, 1] >= 0 else counts.size
        order[begin[c]] = i
        begin[c] += 1
    return order


@jit
def place(order, words, records, first, room, counts, weights, counters):
    """Fill the classes from an order as `sort` or `members` gives it; returns the arena of member lists."""
    n = words.size
    top = 0
    for c in range(counts.size):
        first[c] = top
        room[c] = counts[c] + (counts[c] >> 3) + 4
        top += room[c]
    room[counts.size] = top
    arena = np.empty(5 * n // 2 + 16 * counts.size, np.int32)  # room for any state, see `_spread`
    for i in range(n):
        records[i, 0] = words[i]
        records[i, 1] = 0
    o = 0
    for c in range(counts.size):
        for m in range(counts[c]):
            arena[first[c] + m] = order[o]
            records[order[o], 1] = ((c + 1) << 32) | m
            o += 1
    counters[FIRST_GROUP] = GROUPS - 1
    counters[LAST_GROUP] = 0
    for g in range(GROUPS):
        weights[g] = _group_weight(g, counts)
        if weights[g] > 0.0:
            counters[FIRST_GROUP] = min(counters[FIRST_GROUP], g)
            counters[LAST_GROUP] = g
    return arena


@jit
def members(arena, first, counts, n):
    """Every site, class by class in the order of the member lists, those of zero rate last; (n,) int32."""
    order = np.empty(n, np.int32)
    listed = np.zeros(n, np.bool_)
    o = 0
    for c in range(counts.size):
        for m in range(counts[c]):
            order[o] = arena[first[c] + m]
            listed[order[o]] = True
            o += 1
    for i in range(n):
        if not listed[i]:
            order[o] = i
            o += 1
    return order


@hot
def _group_weight(g, counts):
    c = 8 * g
    return (
        (counts[c] * SCALE[c] + counts[c + 1] * SCALE[c + 1])
        + (counts[c + 2] * SCALE[c + 2] + counts[c + 3] * SCALE[c + 3])
    ) + (
        (counts[c + 4] * SCALE[c + 4] + counts[c + 5] * SCALE[c + 5])
        + (counts[c + 6] * SCALE[c + 6] + counts[c + 7] * SCALE[c + 7])
    )


@inner
def _spread(arena, first, room, counts, wanted):
    """Share the arena out anew, with some room for every class and as much again for the class ``wanted``.

    9/8 of all members and 4 places a class, and 1 more times the members of one class: within 5/2 n + 4 CLASSES.
    """
    packed = np.empty(arena.size, np.int32)
    top = 0
    for c in range(counts.size):
        for m in range(counts[c]):
            packed[top + m] = arena[first[c] + m]
        top += counts[c]
    begin = 0
    top = 0
    for c in range(counts.size):
        first[c] = top
        for m in range(counts[c]):
            arena[top + m] = packed[begin + m]
        begin += counts[c]
        room[c] = counts[c] + (counts[c] >> 3) + 4
        if c == wanted:
            room[c] += counts[c]
        top += room[c]
    room[counts.size] = top


@inner
def _enlarge(arena, first, room, counts, c):
    """More room for class c: at the free end of the arena, which begins at room[-1], or by sharing it out anew."""
    size = 2 * room[c] + 8
    top = room[counts.size]
    if top + size > arena.size:
        _spread(arena, first, room, counts, c)
        return
    for m in range(counts[c]):
        arena[top + m] = arena[first[c] + m]
    first[c] = top
    room[c] = size
    room[counts.size] = top + size


@hot
def _remove(i, records, arena, first, counts):
    """Take site i out of its class: the last member moves to its place. Returns the class, or -1."""
    slot = records[i, 1]
    c = (slot >> 32) - 1
    if c < 0:
        return -1
    position = slot & _POS
    last = counts[c] - 1
    moved = np.int64(arena[first[c] + last])
    arena[first[c] + position] = moved
    records[moved, 1] = slot
    counts[c] = last
    records[i, 1] = 0
    return c


@hot
def _insert(i, c, records, arena, first, room, counts):
    if counts[c] == room[c]:
        _enlarge(arena, first, room, counts, c)
    arena[first[c] + counts[c]] = i
    records[i, 1] = ((c + 1) << 32) | counts[c]
    counts[c] += 1


@hot
def _total(counts, weights, counters):
    """Sum of all class weights; narrows the range of groups in use."""
    low = counters[FIRST_GROUP]
    high = counters[LAST_GROUP]
    while low < high and weights[low] == 0.0:
        low += 1
    while high > low and weights[high] == 0.0:
        high -= 1
    counters[FIRST_GROUP] = low
    counters[LAST_GROUP] = high
    total = 0.0
    for g in range(high, low - 1, -1):
        total += weights[g]
    return total


@hot
def _weigh(c, counts, weights, counters):
    """Weigh again the group of class c, and note that it is in use."""
    g = c >> 3
    weights[g] = _group_weight(g, counts)
    counters[FIRST_GROUP] = min(counters[FIRST_GROUP], g)
    counters[LAST_GROUP] = max(counters[LAST_GROUP], g)


@hot
def _pick_class(target, counts, weights, counters):
    """The class at which the running sum of weights passes ``target``, the fastest first; never an empty one."""
    group = counters[FIRST_GROUP]
    for g in range(counters[FIRST_GROUP], counters[LAST_GROUP] + 1):
        w = weights[g]
        if w > 0.0:
            group = g
            if target < w:
                break
            target -= w
    chosen = 8 * group
    for c in range(8 * group, 8 * group + 8):
        if counts[c] > 0:
            chosen = c
            w = counts[c] * SCALE[c]
            if target < w:
                break
            target -= w
    return chosen


@inner
def _pick_class_cold(target, counts, weights, counters):
    return _pick_class(target, counts, weights, counters)


@inner
def _accepts(u, i, c, records, breaking, per_class):
    """Thinning: whether the attempt of site i, from class c, counts, with the probability rate / 2**-c."""
    barrier = _barrier(i, records, breaking)
    if barrier <= 0:
        return True
    return u < math.exp((c - barrier * per_class) / SHARE)


@hot
def _flip(i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, weights, counters, near):
    """Form or break the bond of site i; move it, and every neighbour now above its bound."""
    word = records[i, 0] ^ 1
    records[i, 0] = word
    sign = 2 if word & 1 else -2
    moves = 1
    near[0, 0] = i
    near[0, 1] = _site_class(i, records, breaking, per_class)
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[i, s])
        if j >= 0:
            word = records[j, 0] + sign * fixed_coupling(coupling[i, s])
            records[j, 0] = word
            if word & 1 == 0:
                c = _class_of(word >> 1, per_class)
                present = records[j, 1] >> 32
                if c >= 0 and (c + 1 < present or present == 0):
                    near[moves, 0] = j
                    near[moves, 1] = c
                    moves += 1
    for m in range(moves):
        j = near[m, 0]
        c = _remove(j, records, arena, first, counts)
        if c >= 0:
            weights[c >> 3] = -1.0
        near[m, 0] = c
        c = near[m, 1]
        if c >= 0:
            _insert(j, c, records, arena, first, room, counts)
            weights[c >> 3] = -1.0
    for m in range(moves):
        for side in range(2):
            c = near[m, side]
            if c >= 0 and weights[c >> 3] < 0.0:
                _weigh(c, counts, weights, counters)


@inner
def _turn(i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, weights, counters, near):
    _flip(i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, weights, counters, near)


@inner
def _set_aside(i, records, arena, first, counts, weights, counters):
    """Take site i out of the draw; returns the weight of all others."""
    c = _remove(i, records, arena, first, counts)
    if c >= 0:
        _weigh(c, counts, weights, counters)
    return _total(counts, weights, counters)


@inner
def _put_back(i, records, breaking, per_class, arena, first, room, counts, weights, counters):
    c = _site_class(i, records, breaking, per_class)
    if c >= 0:
        _insert(i, c, records, arena, first, room, counts)
        _weigh(c, counts, weights, counters)


@inner
def _dwell(
    rng,
    i,
    high,
    low,
    limit,
    rate_back,
    leave_back,
    records,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    per_class,
    arena,
    first,
    room,
    counts,
    weights,
    counters,
    near,
    tally,
    hold,
):
    """Follow site i, which flips to and fro, until something else is attempted or the time ``limit`` comes.

    Returns the clock and the site of the last event.
    """
    rate_here = rate(_barrier(i, records, breaking), nu, per_unit)
    leave_here = nu * _set_aside(i, records, arena, first, counts, weights, counters)
    if leave_here * FLICKER >= rate_here:
        _put_back(i, records, breaking, per_class, arena, first, room, counts, weights, counters)
        return high, low, i
    spent, exited, other, out_here, out_there = sojourn(
        rng, rate_here, rate_back, leave_here, leave_back, until(high, low, limit)
    )
    count_sojourn(tally, hold, records[i, 0], out_here, out_there, other)
    if exited:
        high, low = later(high, low, spent)
    if not exited or past(high, low, limit):
        high = limit
        low = 0.0
    if other:
        _turn(
            i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, weights, counters, near
        )
        leave_here = nu * _set_aside(i, records, arena, first, counts, weights, counters)
    if not exited:
        _put_back(i, records, breaking, per_class, arena, first, room, counts, weights, counters)
        return high, low, i
    u, v = two_uniforms(rng)
    c = _pick_class_cold(u * (leave_here / nu), counts, weights, counters)
    j = np.int64(arena[first[c] + min(np.int64(v * counts[c]), counts[c] - 1)])
    _put_back(i, records, breaking, per_class, arena, first, room, counts, weights, counters)
    if not _accepts(two_uniforms(rng)[0], j, c, records, breaking, per_class):
        return high, low, i
    _turn(j, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, weights, counters, near)
    count_flip(tally, hold, records[j, 0])
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
    records,
    arena,
    first,
    room,
    counts,
    weights,
    clock,
    counters,
    tally,
    attempts,
):
    """Go on for at most ``attempts`` attempts, or to the last hold time (then ``counters[DONE]`` is 1).

    records: (n, 2) int64, the site's word (see `_common`) and, in one number, its class + 1 (from bit 32) and its place
    among the members. arena: int32, all member lists; class c has ``counts[c]`` members from ``first[c]`` on and room
    for ``room[c]``. superbasins, tally: as for the direct method.
    """
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
        records,
        arena,
        first,
        room,
        counts,
        weights,
        clock,
        counters,
        tally,
        attempts,
        np.empty((neighbours.shape[1] + 1, 2), np.int64),
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
    records,
    arena,
    first,
    room,
    counts,
    weights,
    clock,
    counters,
    tally,
    attempts,
    near,
    rng,
):
    neighbours = bare(neighbours)
    coupling = bare(coupling)
    breaking = bare(breaking)
    hold_times = bare(hold_times)
    records = bare(records)
    arena = bare(arena)
    first = bare(first)
    room = bare(room)
    counts = bare(counts)
    weights = bare(weights)
    counters = bare(counters)
    tally = bare(tally)
    near = bare(near)
    rng = bare(rng)
    per_class = per_unit * SHARE
    high = clock[HIGH]
    low = clock[LOW]
    event = counters[EVENT]
    hold = counters[HOLD]
    last = counters[LAST]
    final = hold_times[hold_times.size - 1]
    done = False
    total = _total(counts, weights, counters)
    while attempts > 0:
        if total <= 0.0:
            done = True
            break
        u, v = uniform_pair(k0, k1, STREAM, event, 0)
        step = -math.log(u) / (nu * total)
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
        c = _pick_class(v * total, counts, weights, counters)
        u, v = uniform_pair(k0, k1, STREAM, event, 1)
        i = np.int64(arena[first[c] + min(np.int64(u * counts[c]), counts[c] - 1)])
        prefetch(neighbours, i, i + 1)
        prefetch(coupling, i, i + 1)
        event += 1
        attempts -= 1
        if not _accepts(v, i, c, records, breaking, per_class):
            if _site_class(i, records, breaking, per_class) != c:
                _set_aside(i, records, arena, first, counts, weights, counters)
                _put_back(i, records, breaking, per_class, arena, first, room, counts, weights, counters)
                total = _total(counts, weights, counters)
            continue

        rate_back = 0.0
        leave_back = np.inf
        if superbasins is not None and i == last and breaking.size > 0:
            # The site has flipped twice running: what else could have been attempted?
            rate_back = rate(_barrier(i, records, breaking), nu, per_unit)
            leave_back = nu * _set_aside(i, records, arena, first, counts, weights, counters)
        _flip(
            i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, weights, counters, near
        )
        count_flip(tally, hold, records[i, 0])
        last = i
        if superbasins is not None and leave_back * FLICKER < rate_back:
            rng[0] = k0
            rng[1] = k1
            rng[2] = np.uint64(STREAM)
            rng[3] = np.uint64(event - 1)
            rng[4] = np.uint64(2)  # blocks 0 and 1 were the attempt's own
            high, low, last = _dwell(
                rng,
                i,
                high,
                low,
                hold_times[hold],
                rate_back,
                leave_back,
                records,
                neighbours,
                coupling,
                breaking,
                nu,
                per_unit,
                per_class,
                arena,
                first,
                room,
                counts,
                weights,
                counters,
                near,
                tally,
                hold,
            )
        total = _total(counts, weights, counters)
    clock[HIGH] = high
    clock[LOW] = low
    counters[EVENT] = event
    counters[HOLD] = hold
    counters[LAST] = last
    counters[DONE] = 1 if done else 0
