"""Kernel of the n-fold way: classes of rates by powers of two, whole-number counts, thinning.

A site in class c has a rate of at most 2**-c times the attempt frequency. The class of a rate is the whole part of
E / (kT ln 2), so it costs no exponential. A class of so many slots weighs slots * 2**-c, a whole number: nothing
accumulates. It has as many slots as members, rounded up by 1 part in 64 at most, so that its weight and the members'
slots seldom change. An attempt draws a class by weight and a slot evenly, and takes the member that is there, if any,
with the probability rate / 2**-c. The clock advances on every attempt, and a rejected attempt draws everything anew:
the attempts are a Poisson process of known rate and the events a thinned one, so both times and choices are exact.
(Weights that are exact sums of rates would need the rejected attempt to stay in its class; with bounds for weights that
would be wrong.)

A site whose rate rises above its bound moves at once. One whose rate falls stays where it is, since the bound still
holds, and moves when an attempt on it is rejected. Most blocked neighbours are never attempted, so an event moves one
site instead of nine, and a bond that breaks again finds its neighbours where they were.

From a quarter of a million sites on (FAR) an attempt waits for memory more than it computes, so the next attempts are
foreseen and their memory is asked for, see `_look_ahead`.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.random import uniform_pair
from chemage_kinetics._common import (
    COLDEST,
    LARGEST_BARRIER,
    STREAMS,
    UNITS_PER_EV,
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
    rate,
    sojourn,
    touch,
    touch_rows,
    touch_site,
    two_uniforms,
    until,
)

#: Classes down to the smallest rate that is told from zero, in groups of eight.
CLASSES = 8 * math.ceil((COLDEST / math.log(2.0) + 1.0) / 8.0)
GROUPS = CLASSES // 8
#: A site is treated as a two-state chain when something else happens less often than once in so many of its flips.
FLICKER = 8.0
SHARE = 1.0 / math.log(2.0)

#: A class has between so many and twice as many steps of slots (fewer, each of one slot, if it is smaller).
STEPS = 64
#: Sites from which on it pays to look ahead: a smaller lattice fits the caches.
FAR = 1 << 18
#: Attempts whose draws are kept, a power of two above the three looked ahead.
RING = 4

#: 2**-c; a constant of the compiled code.
SCALE = np.ldexp(1.0, -np.arange(CLASSES))

HIGH, LOW = 0, 1
STREAM = STREAMS["bkl"]
#: Columns of the slots array: how many a class has, and by how many at a time that changes (a power of two).
SLOTS, STEP = 0, 1
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


def sort(words: np.ndarray, breaking: np.ndarray, per_class: float, counts: np.ndarray) -> np.ndarray:
    """The sites in ascending order of class, those of zero rate last, (n,) int32; fills ``counts`` (CLASSES,).

    As `_site_class` has it, but on whole arrays: another kernel would be half a second of compilation.
    """
    barriers = words >> 1
    bonded = np.flatnonzero(words & 1)
    if breaking.size > 0:
        limited = np.clip(breaking[bonded], -LARGEST_BARRIER, LARGEST_BARRIER)
        barriers[bonded] = np.rint(limited * UNITS_PER_EV).astype(np.int64)
    octaves = np.maximum(barriers, 0) * per_class
    if breaking.size == 0:
        octaves[bonded] = np.inf
    classes = np.where(octaves >= CLASSES - 1.0, CLASSES, octaves).astype(np.int16)
    counts[:] = np.bincount(classes, minlength=CLASSES + 1)[:CLASSES]
    return np.argsort(classes, kind="stable").astype(np.int32)


@jit
def place(order, words, records, first, room, counts, slots, weights, counters):
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
        slots[c, STEP] = 1
        while counts[c] > 2 * STEPS * slots[c, STEP]:
            slots[c, STEP] *= 2
        slots[c, SLOTS] = (counts[c] + slots[c, STEP] - 1) & -slots[c, STEP]
    counters[FIRST_GROUP] = GROUPS - 1
    counters[LAST_GROUP] = 0
    for g in range(GROUPS):
        weights[g] = _group_weight(g, slots)
        if weights[g] > 0.0:
            counters[FIRST_GROUP] = min(counters[FIRST_GROUP], g)
            counters[LAST_GROUP] = g
    return arena


def members(arena: np.ndarray, first: np.ndarray, counts: np.ndarray, n: int) -> np.ndarray:
    """Every site, class by class in the order of the member lists, those of zero rate last; (n,) int32."""
    listed = [arena[first[c] : first[c] + counts[c]] for c in np.flatnonzero(counts)]
    there = np.zeros(n, np.bool_)
    for part in listed:
        there[part] = True
    return np.concatenate([*listed, np.flatnonzero(~there).astype(np.int32)])


@hot
def _group_weight(g, slots):
    c = 8 * g
    return (
        (slots[c, SLOTS] * SCALE[c] + slots[c + 1, SLOTS] * SCALE[c + 1])
        + (slots[c + 2, SLOTS] * SCALE[c + 2] + slots[c + 3, SLOTS] * SCALE[c + 3])
    ) + (
        (slots[c + 4, SLOTS] * SCALE[c + 4] + slots[c + 5, SLOTS] * SCALE[c + 5])
        + (slots[c + 6, SLOTS] * SCALE[c + 6] + slots[c + 7, SLOTS] * SCALE[c + 7])
    )


@hot
def _recount(c, count, counts, slots, weights):
    """Note the new number of members of class c, one more or less; a group to be weighed again is marked by -1."""
    counts[c] = count
    step = slots[c, STEP]
    if count > 2 * STEPS * step:
        step *= 2
    elif count <= STEPS * step and step > 1:
        step >>= 1
    slots[c, STEP] = step
    new = (count + step - 1) & -step
    if new != slots[c, SLOTS]:
        slots[c, SLOTS] = new
        weights[c >> 3] = -1.0


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
def _remove(i, records, arena, first, counts, slots, weights):
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
    records[i, 1] = 0
    _recount(c, last, counts, slots, weights)
    if last > 0:
        touch(records, arena[first[c] + last - 1])  # the next one to be moved
    return c


@hot
def _insert(i, c, records, arena, first, room, counts, slots, weights):
    if counts[c] == room[c]:
        _enlarge(arena, first, room, counts, c)
    arena[first[c] + counts[c]] = i
    records[i, 1] = ((c + 1) << 32) | counts[c]
    _recount(c, counts[c] + 1, counts, slots, weights)


@hot
def _total(weights, counters):
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
def _weigh(c, slots, weights, counters):
    """Weigh again the group of class c, and note that it is in use."""
    g = c >> 3
    weights[g] = _group_weight(g, slots)
    counters[FIRST_GROUP] = min(counters[FIRST_GROUP], g)
    counters[LAST_GROUP] = max(counters[LAST_GROUP], g)


@hot
def _pick_class(target, slots, weights, counters):
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
        if slots[c, SLOTS] > 0:
            chosen = c
            w = slots[c, SLOTS] * SCALE[c]
            if target < w:
                break
            target -= w
    return chosen


@inner
def _pick_class_cold(target, slots, weights, counters):
    return _pick_class(target, slots, weights, counters)


@inner
def _accepts(u, i, c, records, breaking, per_class):
    """Thinning: whether the attempt of site i, from class c, counts, with the probability rate / 2**-c."""
    barrier = _barrier(i, records, breaking)
    if barrier <= 0:
        return True
    return u < math.exp((c - barrier * per_class) / SHARE)


@hot
def _flip(
    i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, slots, weights, counters, near
):
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
                    if present > 0:
                        touch(arena, first[present - 1] + (records[j, 1] & _POS))
                    near[moves, 0] = j
                    near[moves, 1] = c
                    moves += 1
    for m in range(moves):
        j = near[m, 0]
        c = _remove(j, records, arena, first, counts, slots, weights)
        target = near[m, 1]
        near[m, 0] = c
        if target >= 0:
            _insert(j, target, records, arena, first, room, counts, slots, weights)
    for m in range(moves):
        for side in range(2):
            c = near[m, side]
            if c >= 0 and weights[c >> 3] < 0.0:
                _weigh(c, slots, weights, counters)


@inner
def _turn(
    i, records, neighbours, coupling, breaking, per_class, arena, first, room, counts, slots, weights, counters, near
):
    _flip(
        i,
        records,
        neighbours,
        coupling,
        breaking,
        per_class,
        arena,
        first,
        room,
        counts,
        slots,
        weights,
        counters,
        near,
    )


@inner
def _set_aside(i, records, arena, first, counts, slots, weights, counters):
    """Take site i out of the draw; returns the weight of all others."""
    c = _remove(i, records, arena, first, counts, slots, weights)
    if c >= 0:
        _weigh(c, slots, weights, counters)
    return _total(weights, counters)


@inner
def _put_back(i, records, breaking, per_class, arena, first, room, counts, slots, weights, counters):
    c = _site_class(i, records, breaking, per_class)
    if c >= 0:
        _insert(i, c, records, arena, first, room, counts, slots, weights)
        _weigh(c, slots, weights, counters)


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
    slots,
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
    leave_here = nu * _set_aside(i, records, arena, first, counts, slots, weights, counters)
    if leave_here * FLICKER >= rate_here:
        _put_back(i, records, breaking, per_class, arena, first, room, counts, slots, weights, counters)
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
            i,
            records,
            neighbours,
            coupling,
            breaking,
            per_class,
            arena,
            first,
            room,
            counts,
            slots,
            weights,
            counters,
            near,
        )
        leave_here = nu * _set_aside(i, records, arena, first, counts, slots, weights, counters)
    if not exited:
        _put_back(i, records, breaking, per_class, arena, first, room, counts, slots, weights, counters)
        return high, low, i
    u, v = two_uniforms(rng)
    c = _pick_class_cold(u * (leave_here / nu), slots, weights, counters)
    slot = np.int64(v * slots[c, SLOTS])
    empty = slot >= counts[c]
    j = np.int64(arena[first[c] + min(slot, counts[c] - 1)])
    _put_back(i, records, breaking, per_class, arena, first, room, counts, slots, weights, counters)
    if empty or not _accepts(two_uniforms(rng)[0], j, c, records, breaking, per_class):
        return high, low, i
    _turn(
        j,
        records,
        neighbours,
        coupling,
        breaking,
        per_class,
        arena,
        first,
        room,
        counts,
        slots,
        weights,
        counters,
        near,
    )
    count_flip(tally, hold, records[j, 0])
    return high, low, j


@hot
def _draw(k0, k1, event, draws):
    """The four numbers of an attempt."""
    e = event & (RING - 1)
    draws[e, 0], draws[e, 1] = uniform_pair(k0, k1, STREAM, event, 0)
    draws[e, 2], draws[e, 3] = uniform_pair(k0, k1, STREAM, event, 1)


@hot
def _look_ahead(
    event,
    k0,
    k1,
    records,
    neighbours,
    coupling,
    breaking,
    arena,
    first,
    counts,
    slots,
    weights,
    counters,
    total,
    draws,
    spots,
):
    """Ask for the memory of the next attempts while there is time; a wrong guess costs that time and nothing else.

    Three attempts ahead the entry in the list of members, two ahead the site's own rows, one ahead its neighbours: each
    stage finds what the stage before has asked for.
    """
    _draw(k0, k1, event + 3, draws)
    e = (event + 3) & (RING - 1)
    c = _pick_class(draws[e, 1] * total, slots, weights, counters)
    spots[e] = first[c] + min(np.int64(draws[e, 2] * slots[c, SLOTS]), counts[c])
    touch(arena, spots[e])

    e = (event + 2) & (RING - 1)
    i = min(max(np.int64(arena[spots[e]]), 0), records.shape[0] - 1)  # not a site where the list has moved
    spots[e] = i
    touch_site(i, records, neighbours, coupling, breaking)

    i = spots[(event + 1) & (RING - 1)]
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[i, s])
        if j >= 0:
            touch(records, j)


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
    records,
    arena,
    first,
    room,
    counts,
    slots,
    weights,
    clock,
    counters,
    tally,
    attempts,
):
    """Go on for at most ``attempts`` attempts, or to the last hold time (then ``counters[DONE]`` is 1).

    records: (n, 2) int64, the site's word (see `_common`) and, in one number, its class + 1 (from bit 32) and its place
    among the members. arena: int32, all member lists; class c has ``counts[c]`` members from ``first[c]`` on and room
    for ``room[c]``. slots: (CLASSES, 2). far: whether to look ahead. superbasins, tally: as for the direct method.
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
        far,
        records,
        arena,
        first,
        room,
        counts,
        slots,
        weights,
        clock,
        counters,
        tally,
        attempts,
        np.empty((neighbours.shape[1] + 1, 2), np.int64),
        np.empty((RING, 4)),
        np.zeros(RING, np.int64),
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
    records,
    arena,
    first,
    room,
    counts,
    slots,
    weights,
    clock,
    counters,
    tally,
    attempts,
    near,
    draws,
    spots,
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
    slots = bare(slots)
    weights = bare(weights)
    counters = bare(counters)
    tally = bare(tally)
    near = bare(near)
    draws = bare(draws)
    spots = bare(spots)
    rng = bare(rng)
    per_class = per_unit * SHARE
    high = clock[HIGH]
    low = clock[LOW]
    event = counters[EVENT]
    hold = counters[HOLD]
    last = counters[LAST]
    final = hold_times[hold_times.size - 1]
    done = False
    total = _total(weights, counters)
    if far:
        for ahead in range(event, event + 3):
            _draw(k0, k1, ahead, draws)
    while attempts > 0:
        if total <= 0.0:
            done = True
            break
        if far:
            _look_ahead(
                event,
                k0,
                k1,
                records,
                neighbours,
                coupling,
                breaking,
                arena,
                first,
                counts,
                slots,
                weights,
                counters,
                total,
                draws,
                spots,
            )
        else:
            _draw(k0, k1, event, draws)
        e = event & (RING - 1)
        step = -math.log(draws[e, 0]) / (nu * total)
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
        c = _pick_class(draws[e, 1] * total, slots, weights, counters)
        slot = np.int64(draws[e, 2] * slots[c, SLOTS])
        event += 1
        attempts -= 1
        if slot >= counts[c]:
            continue
        i = np.int64(arena[first[c] + slot])
        touch_rows(i, neighbours, coupling)
        if not _accepts(draws[e, 3], i, c, records, breaking, per_class):
            if _site_class(i, records, breaking, per_class) != c:
                _set_aside(i, records, arena, first, counts, slots, weights, counters)
                _put_back(i, records, breaking, per_class, arena, first, room, counts, slots, weights, counters)
                total = _total(weights, counters)
            continue

        rate_back = 0.0
        leave_back = np.inf
        if superbasins is not None and i == last and breaking.size > 0:
            # The site has flipped twice running: what else could have been attempted?
            rate_back = rate(_barrier(i, records, breaking), nu, per_unit)
            leave_back = nu * _set_aside(i, records, arena, first, counts, slots, weights, counters)
        _flip(
            i,
            records,
            neighbours,
            coupling,
            breaking,
            per_class,
            arena,
            first,
            room,
            counts,
            slots,
            weights,
            counters,
            near,
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
                slots,
                weights,
                counters,
                near,
                tally,
                hold,
            )
        total = _total(weights, counters)
    clock[HIGH] = high
    clock[LOW] = low
    counters[EVENT] = event
    counters[HOLD] = hold
    counters[LAST] = last
    counters[DONE] = 1 if done else 0
