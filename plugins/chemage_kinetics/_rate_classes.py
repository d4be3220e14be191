"""Sites in classes of rates by powers of two, weighed by whole numbers.

A site in class c has a rate of at most 2**-c times the attempt frequency. The class of a rate is the whole part of
E / (kT ln 2), so it costs no exponential. A class of so many slots weighs slots * 2**-c, a whole number: nothing
accumulates. It has as many slots as members, rounded up by 1 part in 64 at most, so that its weight and the members'
slots seldom change.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage_kinetics._common import (
    COLDEST,
    LARGEST_BARRIER,
    UNITS_PER_EV,
    Array,
    Float,
    Int,
    KineticModel,
    block_sum,
    borrowed,
    descend,
    fixed_barrier,
    hot,
    inner,
    jit,
    prefetch,
)

#: Classes down to the smallest rate that is not zero, in groups of eight.
CLASSES = 8 * math.ceil((COLDEST / math.log(2.0) + 1.0) / 8.0)
GROUPS = CLASSES // 8
#: Classes per unit of E/kT.
PER_KT = 1.0 / math.log(2.0)

#: A class has between so many and twice as many steps of slots (fewer, each of one slot, if it is smaller).
STEPS = 64

#: 2**-c; a constant of the compiled code.
SCALE = np.ldexp(1.0, -np.arange(CLASSES))

#: Columns of the slots array: how many a class has, and by how many at a time that changes (a power of two).
SLOTS, STEP = 0, 1

#: The part of a record that is the place among the members.
PLACE = np.int64(0xFFFFFFFF)


class Classes(NamedTuple):
    """The present classes of all sites."""

    records: Array
    """(n, 2) int64: the site's word (see `_common`) and, in one number, its class + 1 (from bit 32) and its place among
    the members; 0 for a site in no class, whose rate is zero"""
    arena: Array
    """int32, the member lists of all classes"""
    first: Array
    """(CLASSES,) int64: where the list of a class begins in the arena"""
    room: Array
    """(CLASSES + 1,) int64: how many members the list has room for; then where the free end of the arena begins"""
    counts: Array
    """(CLASSES,) int64: members"""
    slots: Array
    """(CLASSES, 2) int64: columns SLOTS and STEP"""
    weights: Array
    """(CLASSES,) float64: slots times 2**-c"""
    sums: Array
    """(GROUPS,) float64: sums of the weights over groups of eight classes; -1: to be summed again"""
    used: Array
    """(2,) int64: the first and the last group in use"""
    model: KineticModel
    per_class: float
    """1/(k_B T ln 2) over one fixed-point unit of energy"""


@hot
def class_of(barrier: Int, per_class: Float) -> Int:
    """The class of a fixed-point barrier; -1 where the rate is zero to double precision."""
    if barrier <= 0:
        return 0
    octaves = barrier * per_class
    if octaves >= CLASSES - 1.0:
        return -1
    return int(octaves)


@hot
def barrier_of(i: Int, classes: Classes) -> Int:
    """The fixed-point barrier to the next event of site i; not for a bonded site where bonds never break."""
    word = classes.records[i, 0]
    if word & 1 == 0:
        return word >> 1
    return fixed_barrier(classes.model.breaking[i])


@hot
def site_class(i: Int, classes: Classes) -> Int:
    """The class of the present rate of site i, which may be another than the one it is in."""
    if classes.records[i, 0] & 1 and classes.model.breaking.size == 0:
        return -1
    return class_of(barrier_of(i, classes), classes.per_class)


# -- set-up --------------------------------------------------------------------------------------------------------


def sort(words: Array, breaking: Array, per_class: float) -> tuple[Array, Array]:
    """The sites in ascending order of class, those of zero rate last, (n,) int32, and the members of each class.

    Classes are those of `site_class`, but on whole arrays: another kernel would take half a second to compile.
    """
    octaves = octaves_of(words, breaking, per_class)
    classes = np.where(octaves >= CLASSES - 1.0, CLASSES, octaves).astype(np.int16)
    counts = np.bincount(classes, minlength=CLASSES + 1)[:CLASSES]
    return np.argsort(classes, kind="stable").astype(np.int32), counts


def octaves_of(words: Array, breaking: Array, per_class: float) -> Array:
    """By how many powers of two the rate of each site is below the attempt frequency, (n,) float64."""
    barriers = words >> 1
    bonded = np.flatnonzero(words & 1)
    if breaking.size > 0:
        limited = np.clip(breaking[bonded], -LARGEST_BARRIER, LARGEST_BARRIER)
        barriers[bonded] = np.rint(limited * UNITS_PER_EV).astype(np.int64)
    octaves = np.maximum(barriers, 0) * per_class
    if breaking.size == 0:
        octaves[bonded] = np.inf
    return octaves


def new_classes(
    words: Array,
    model: KineticModel,
    order: Array | None,
    counts: Array | None,
) -> Classes:
    """The classes of the sites; ``order`` and ``counts`` as `sort` or `members` give them, or None: sorted here."""
    per_class = model.per_unit * PER_KT
    if order is None or counts is None:
        order, counts = sort(words, model.breaking, per_class)
    classes = Classes(
        records=np.empty((words.size, 2), np.int64),
        arena=np.empty(
            5 * words.size // 2 + 16 * CLASSES, np.int32
        ),  # room for any state, see `_spread`
        first=np.empty(CLASSES, np.int64),
        room=np.empty(CLASSES + 1, np.int64),
        counts=np.array(counts, np.int64),
        slots=np.empty((CLASSES, 2), np.int64),
        weights=np.empty(CLASSES),
        sums=np.empty(GROUPS),
        used=np.empty(2, np.int64),
        model=model,
        per_class=per_class,
    )
    _place(order, words, classes)
    return classes


@jit
def _place(order: Array, words: Array, classes: Classes) -> None:
    """Fill the classes from an order of the sites; the members of each class are counted already."""
    order = borrowed(order)
    words = borrowed(words)
    classes = borrowed(classes)
    first = classes.first
    room = classes.room
    counts = classes.counts
    slots = classes.slots
    top = 0
    for c in range(counts.size):
        first[c] = top
        room[c] = counts[c] + (counts[c] >> 3) + 4
        top += room[c]
    room[counts.size] = top
    for i in range(words.size):
        classes.records[i, 0] = words[i]
        classes.records[i, 1] = 0
    o = 0
    for c in range(counts.size):
        for m in range(counts[c]):
            classes.arena[first[c] + m] = order[o]
            classes.records[order[o], 1] = ((c + 1) << 32) | m
            o += 1
        slots[c, STEP] = 1
        while counts[c] > 2 * STEPS * slots[c, STEP]:
            slots[c, STEP] *= 2
        slots[c, SLOTS] = (counts[c] + slots[c, STEP] - 1) & -slots[c, STEP]
        classes.weights[c] = slots[c, SLOTS] * SCALE[c]
    classes.used[0] = GROUPS - 1
    classes.used[1] = 0
    for g in range(GROUPS):
        classes.sums[g] = block_sum(classes.weights, 8 * g)
        if classes.sums[g] > 0.0:
            classes.used[0] = min(classes.used[0], g)
            classes.used[1] = g


def members(classes: Classes) -> Array:
    """Every site, class by class in the order of the member lists, those of zero rate last; (n,) int32."""
    n = classes.records.shape[0]
    listed = [
        classes.arena[classes.first[c] :][: classes.counts[c]]
        for c in np.flatnonzero(classes.counts)
    ]
    there = np.zeros(n, np.bool_)
    for part in listed:
        there[part] = True
    return np.concatenate([*listed, np.flatnonzero(~there).astype(np.int32)])


# -- members -------------------------------------------------------------------------------------------------------


@hot
def _recount(c: Int, count: Int, classes: Classes) -> None:
    """Set the new number of members of class c, one more or less; a group whose weight changes is marked by -1."""
    slots = classes.slots
    classes.counts[c] = count
    step = slots[c, STEP]
    if count > 2 * STEPS * step:
        step *= 2
    elif count <= STEPS * step and step > 1:
        step >>= 1
    slots[c, STEP] = step
    new = (count + step - 1) & -step
    if new != slots[c, SLOTS]:
        slots[c, SLOTS] = new
        classes.weights[c] = new * SCALE[c]
        classes.sums[c >> 3] = -1.0


@inner
def _spread(wanted: Int, classes: Classes) -> None:
    """Distribute the arena anew, with some room for every class and as much again for the class ``wanted``.

    9/8 of all members and 4 places per class, and 1 more times the members of one class: within 5/2 n + 4 CLASSES.
    """
    packed = classes.arena.copy()
    top = 0
    for c in range(CLASSES):
        begin = classes.first[c]
        count = classes.counts[c]
        for m in range(count):
            classes.arena[top + m] = packed[begin + m]
        classes.first[c] = top
        classes.room[c] = count + (count >> 3) + 4
        if c == wanted:
            classes.room[c] += count
        top += classes.room[c]
    classes.room[CLASSES] = top


@inner
def _enlarge(c: Int, classes: Classes) -> None:
    """More room for class c: at the free end of the arena, which begins at room[-1], or by distributing it anew."""
    arena = classes.arena
    size = 2 * classes.room[c] + 8
    top = classes.room[CLASSES]
    if top + size > arena.size:
        _spread(c, classes)
        return
    for m in range(classes.counts[c]):
        arena[top + m] = arena[classes.first[c] + m]
    classes.first[c] = top
    classes.room[c] = size
    classes.room[CLASSES] = top + size


@hot
def remove(i: Int, classes: Classes) -> Int:
    """Take site i out of its class: the last member moves to its place. Returns the class, or -1."""
    records = classes.records
    slot = records[i, 1]
    c = (slot >> 32) - 1
    if c < 0:
        return -1
    begin = classes.first[c]
    last = classes.counts[c] - 1
    moved = np.int64(classes.arena[begin + last])
    classes.arena[begin + (slot & PLACE)] = moved
    records[moved, 1] = slot
    records[i, 1] = 0
    _recount(c, last, classes)
    if last > 0:
        prefetch(
            records, classes.arena[begin + last - 1]
        )  # the next one to be moved
    return c


@hot
def insert(i: Int, c: Int, classes: Classes) -> None:
    """Make site i the last member of class c."""
    count = classes.counts[c]
    if count == classes.room[c]:
        _enlarge(c, classes)
    classes.arena[classes.first[c] + count] = i
    classes.records[i, 1] = ((c + 1) << 32) | count
    _recount(c, count + 1, classes)


@hot
def weigh(c: Int, classes: Classes) -> None:
    """Sum again the weight of the group of class c, and note that it is in use."""
    g = c >> 3
    classes.sums[g] = block_sum(classes.weights, 8 * g)
    classes.used[0] = min(classes.used[0], g)
    classes.used[1] = max(classes.used[1], g)


@hot
def total_weight(classes: Classes) -> Float:
    """Sum of all class weights; narrows the range of groups in use."""
    low = classes.used[0]
    high = classes.used[1]
    while low < high and classes.sums[low] == 0.0:
        low += 1
    while high > low and classes.sums[high] == 0.0:
        high -= 1
    classes.used[0] = low
    classes.used[1] = high
    total = 0.0
    for g in range(high, low - 1, -1):
        total += classes.sums[g]
    return total


@inner
def set_aside(i: Int, classes: Classes) -> Float:
    """Exclude site i from the selection; returns the weight of all others."""
    c = remove(i, classes)
    if c >= 0:
        weigh(c, classes)
    return total_weight(classes)


@inner
def put_back(i: Int, classes: Classes) -> None:
    """Enter site i, which is in no class, in the class of its present rate."""
    c = site_class(i, classes)
    if c >= 0:
        insert(i, c, classes)
        weigh(c, classes)


# -- selection -----------------------------------------------------------------------------------------------------


@hot
def select_class(target: Float, classes: Classes) -> Int:
    """The class at which the running sum of weights passes ``target``, the fastest first; never an empty one."""
    group = classes.used[0]
    for g in range(classes.used[0], classes.used[1] + 1):
        w = classes.sums[g]
        if w > 0.0:
            group = g
            if target < w:
                break
            target -= w
    return 8 * group + descend(classes.weights, 8 * group, target)[0]


@inner
def accepts(u: Float, i: Int, c: Int, classes: Classes) -> bool:
    """Thinning: whether the attempt of site i, from class c, is accepted, with the probability rate / 2**-c."""
    barrier = barrier_of(i, classes)
    if barrier <= 0:
        return True
    return u < math.exp((c - barrier * classes.per_class) / PER_KT)
