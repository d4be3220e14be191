"""A lazy queue of pending times: buckets of time, of which only the present one is a heap.

The sites of a patch are sorted once into buckets of time, the finer the more sites there are, and only the present
bucket is a heap, small enough for the nearest cache. A time that moves later leaves its entry, in a bucket or in the
heap, where it is: entries are lower bounds, and are corrected when they reach the top. None of this affects the order
of events, which depends on the times alone.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from chemage_kinetics._common import (
    Array,
    Float,
    Int,
    borrowed,
    hot,
    inner,
    past,
    prefetch,
    time_of,
)

#: A pending time as a pair of doubles, and its site: entries are compared in this order.
Entry: TypeAlias = tuple[Float, Float, Int]

#: Buckets of time cover so many octaves back from the last hold time; everything earlier is in the first one.
OCTAVES = 64
#: A patch of up to so many sites has a single bucket; a larger one has four per octave or more, so that not many more
#: than a thousand sites are in the heap at once, up to MOST_BUCKETS.
ONE_BUCKET = 256
MOST_BUCKETS = 256 * OCTAVES
#: Sites that move to a later bucket are listed in chunks of one cache line: the next chunk of the bucket, the number of
#: sites, the sites.
NEXT, COUNT, ENTRIES = 0, 1, 2
HELD = 14
#: How many sites ahead a list of scattered sites is prefetched.
AHEAD = 12


class Buckets(NamedTuple):
    """How times are divided into buckets, see `bucket_of`."""

    offset: int
    """subtracted from the leading bits of a time"""
    shift: int
    """trailing bits that are left out"""
    last: int
    """the last bucket"""


class Queue(NamedTuple):
    """Pending times, and the queue of those before the last hold time."""

    times: Array
    """(n, 2) float64 s: pending times as pairs"""
    spot: Array
    """(n, 2) int32: the position of a site in the heap, and the later bucket in whose chunks it is listed; or -1"""
    keys: Array
    """(most + 1, 2) float64: times in the heap, of four children per entry; ``most``: sites of the largest patch"""
    sites: Array
    """(most + 1,) int32: sites in the heap"""
    heads: Array
    """(MOST_BUCKETS,) int64: the first chunk of each bucket, or -1"""
    pool: Array
    """(chunks, ENTRIES + HELD) int32: see NEXT, COUNT, ENTRIES"""
    spare: Array
    """(2,) int64: the first chunk that is free again, or -1; the first chunk never used"""
    number: Array
    """(1,) float64 scratch"""
    bits: Array
    """(1,) int64: the same memory"""
    final: float
    """the last hold time, s"""


class Order(NamedTuple):
    """The sites patch by patch, of which the largest has ``most``, and, within the present one, bucket by bucket."""

    order: Array
    """(n,) int32: the sites"""
    starts: Array
    """(patches + 1,) int32: where each patch begins"""
    ends: Array
    """(MOST_BUCKETS + 2,) int64: where each bucket of the present patch ends"""
    room: Array
    """(most,) int32 scratch"""


def new_queue(times: Array, spot: Array, most: int, final: float) -> Queue:
    """Memory for the queue of any patch of up to ``most`` sites; shares ``times`` and ``spot``."""
    # The heap rarely holds more than a small part of a patch; pages that are never written take no memory.
    number = np.empty(1)
    return Queue(
        times=times,
        spot=spot,
        keys=np.empty((most + 1, 2)),
        sites=np.empty(most + 1, np.int32),
        heads=np.empty(MOST_BUCKETS, np.int64),
        pool=np.empty((most // HELD + MOST_BUCKETS + 1, ENTRIES + HELD), np.int32),
        spare=np.empty(2, np.int64),
        number=number,
        bits=number.view(np.int64),
        final=final,
    )


# -- the heap ------------------------------------------------------------------------------------------------------


@hot
def _entry(queue: Queue, at: Int) -> Entry:
    """The entry at a position of the heap."""
    return queue.keys[at, 0], queue.keys[at, 1], np.int64(queue.sites[at])


@hot
def _put(queue: Queue, at: Int, entry: Entry) -> None:
    queue.keys[at, 0], queue.keys[at, 1], site = entry
    queue.sites[at] = site
    queue.spot[site, 0] = at


@hot
def _rise(queue: Queue, at: Int, entry: Entry) -> None:
    """Put an entry at heap position ``at`` or above, where it belongs."""
    while at > 0:
        above = (at - 1) >> 2
        parent = _entry(queue, above)
        if not entry < parent:
            break
        _put(queue, at, parent)
        at = above
    _put(queue, at, entry)


@hot
def _sink(queue: Queue, size: Int, at: Int, entry: Entry) -> None:
    """Put an entry at heap position ``at`` or below, where it belongs."""
    while True:
        best = 4 * at + 1
        if best >= size:
            break
        first = _entry(queue, best)
        for child in range(best + 1, min(best + 4, size)):
            other = _entry(queue, child)
            if other < first:
                best = child
                first = other
        if not first < entry:
            break
        _put(queue, at, first)
        at = best
    _put(queue, at, entry)


@inner
def drop(queue: Queue, size: Int, site: Int) -> Int:
    """Take a site out of the heap of ``size`` entries; returns the new size."""
    at = np.int64(queue.spot[site, 0])
    if at < 0:
        return size
    queue.spot[site, 0] = -1
    size -= 1
    if at < size:
        moved = _entry(queue, size)
        if at > 0 and moved < _entry(queue, (at - 1) >> 2):
            _rise(queue, at, moved)
        else:
            _sink(queue, size, at, moved)
    return size


# -- the buckets ---------------------------------------------------------------------------------------------------


@hot
def bucket_of(time: Float, grid: Buckets, queue: Queue) -> Int:
    """The bucket of a time: exponent and some leading bits of a positive double."""
    queue.number[0] = time
    return min(max((queue.bits[0] >> grid.shift) - grid.offset, 0), grid.last)


@hot
def _list_later(site: Int, bucket: Int, queue: Queue) -> bool:
    """List a site in the chunks of a later bucket. False where it is listed in one that is later still."""
    spot = queue.spot
    pool = queue.pool
    if spot[site, 1] < 0:
        spot[site, 1] = bucket
        chunk = queue.heads[bucket]
        if chunk < 0 or pool[chunk, COUNT] == HELD:
            fresh = queue.spare[0]
            if fresh >= 0:
                queue.spare[0] = np.int64(pool[fresh, NEXT])
            else:
                fresh = queue.spare[1]
                queue.spare[1] += 1
            pool[fresh, NEXT] = chunk
            pool[fresh, COUNT] = 0
            queue.heads[bucket] = fresh
            chunk = fresh
        pool[chunk, ENTRIES + pool[chunk, COUNT]] = site
        pool[chunk, COUNT] += 1
        return True
    return spot[site, 1] <= bucket


@hot
def _pending(queue: Queue, site: Int) -> Entry:
    """The entry of a site as it should be."""
    return queue.times[site, 0], queue.times[site, 1], site


@hot
def _waits(queue: Queue, entry: Entry, grid: Buckets, present: Int) -> bool:
    """Whether an entry need not be in the heap yet: it is listed in a later bucket, or after the last hold time."""
    high, low, site = entry
    if past((high, low), queue.final):
        return True
    bucket = bucket_of(high, grid, queue)
    return bucket > present and _list_later(site, bucket, queue)


@hot
def correct_top(queue: Queue, size: Int, grid: Buckets, present: Int) -> Int:
    """Correct the entries at the top of the heap until the first is right; returns the size of the heap."""
    while size > 0:
        top = _entry(queue, 0)
        entry = _pending(queue, top[2])
        if entry == top:
            break
        if _waits(queue, entry, grid, present):
            queue.spot[top[2], 0] = -1
            size -= 1
            if size == 0:
                break
            entry = _entry(queue, size)
        _sink(queue, size, np.int64(0), entry)
    return size


@hot
def offer(queue: Queue, size: Int, site: Int, grid: Buckets, present: Int) -> Int:
    """Enter a pending time that is new or earlier than before in the queue; returns the size of the heap."""
    entry = _pending(queue, site)
    at = np.int64(queue.spot[site, 0])
    if at >= 0:
        if entry < _entry(queue, at):
            _rise(queue, at, entry)
        return size
    if _waits(queue, entry, grid, present):
        return size
    _rise(queue, size, entry)
    return size + 1


@inner
def _offer_cold(
    queue: Queue, size: Int, site: Int, grid: Buckets, present: Int
) -> Int:
    return offer(queue, size, site, grid, present)


@inner
def open_bucket(
    queue: Queue, order: Order, patch: Int, size: Int, grid: Buckets, bucket: Int
) -> Int:
    """Take the entries of one bucket of a patch into the heap; returns its size."""
    queue = borrowed(queue)
    order = borrowed(order)
    begin = order.ends[bucket - 1] if bucket > 0 else np.int64(order.starts[patch])
    end = order.ends[bucket]
    for at in range(begin, end):
        if at + AHEAD < end:
            prefetch(queue.times, order.order[at + AHEAD])
            prefetch(queue.spot, order.order[at + AHEAD])
        site = np.int64(order.order[at])
        if queue.spot[site, 0] < 0:
            size = _offer_cold(queue, size, site, grid, bucket)
    pool = queue.pool
    chunk = queue.heads[bucket]
    queue.heads[bucket] = -1
    while chunk >= 0:
        following = np.int64(pool[chunk, NEXT])
        prefetch(pool, following)
        for e in range(ENTRIES, ENTRIES + pool[chunk, COUNT]):
            prefetch(queue.times, pool[chunk, e])
            prefetch(queue.spot, pool[chunk, e])
        for e in range(ENTRIES, ENTRIES + pool[chunk, COUNT]):
            site = np.int64(pool[chunk, e])
            queue.spot[site, 1] = -1
            if queue.spot[site, 0] < 0:
                size = _offer_cold(queue, size, site, grid, bucket)
        pool[chunk, NEXT] = queue.spare[0]
        queue.spare[0] = chunk
        chunk = following
    return size


@hot
def _sorting_bucket(queue: Queue, i: Int, grid: Buckets) -> Int:
    """The bucket of site i; the one after the last where it has no event before the last hold time."""
    if past(time_of(queue.times, i), queue.final):
        return grid.last + 1
    return bucket_of(queue.times[i, 0], grid, queue)


@inner
def start_patch(queue: Queue, order: Order, patch: Int) -> Buckets:
    """Empty the queue and sort the sites of a patch by bucket; returns the grid."""
    queue = borrowed(queue)
    order = borrowed(order)
    begin = np.int64(order.starts[patch])
    end = np.int64(order.starts[patch + 1])
    bits = 2
    while (end - begin) >> (14 + bits) > 0 and OCTAVES << bits < MOST_BUCKETS:
        bits += 1
    last = (OCTAVES << bits) - 1 if end - begin > ONE_BUCKET else 0
    queue.number[0] = queue.final
    grid = Buckets((queue.bits[0] >> (52 - bits)) - last, 52 - bits, last)
    sites = order.order
    ends = order.ends
    room = order.room
    for o in range(begin, end):
        queue.spot[sites[o], 0] = -1
        queue.spot[sites[o], 1] = -1
    for b in range(grid.last + 3):
        ends[b] = 0
    for o in range(begin, end):
        i = np.int64(sites[o])
        if o + AHEAD < end:
            prefetch(queue.times, sites[o + AHEAD])
        room[o - begin] = i
        ends[_sorting_bucket(queue, i, grid) + 1] += 1
    ends[0] = begin
    for b in range(grid.last + 2):
        ends[b + 1] += ends[b]
    # Now where each bucket begins; filling them moves that to their ends.
    for o in range(end - begin):
        i = np.int64(room[o])
        if o + AHEAD < end - begin:
            prefetch(queue.times, room[o + AHEAD])
        b = _sorting_bucket(queue, i, grid)
        sites[ends[b]] = i
        ends[b] += 1
    for b in range(grid.last + 1):
        queue.heads[b] = -1
    queue.spare[0] = -1
    queue.spare[1] = 0
    return grid
