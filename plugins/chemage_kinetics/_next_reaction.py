"""Kernel of the next-reaction method, patch by patch.

Sites interact along the neighbour graph only, so its connected patches evolve independently: each is followed to the
end on its own, in a small working set, on any thread. Every site has the time of its next event; only those before the
last hold time are queued. All random numbers of a site come from its own counter (pixel, draw), so neither the order of
the patches nor the number of threads can be seen in the result.

When a neighbour's event changes a site's rate from r to r', its pending time moves from t + d to t + d r / r' (Gibson &
Bruck 2000): the exponential of the change in barrier, no logarithm and no random number.

The queue is lazy. Sites are sorted once into buckets of time, the finer the more sites there are, and only the bucket
at hand is a heap, small enough for the nearest cache. A time that moves later leaves its entry, in a bucket or in the
heap, where it is: entries are lower bounds, and are corrected when their turn comes. None of this can be seen in the
result, which depends on the times alone.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.random import uniform
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
    own_rate,
    past,
    sojourn,
    touch,
    touch_rows,
    until,
)

#: A site is treated as a two-state chain when it flips more than this many times before anything else near it happens.
FLICKER = 8.0
#: Draws below this number are single uniforms of a site, above it the private sequences of sojourns.
_SOJOURN_BLOCKS = np.uint64(1 << 40)

#: Buckets of time cover so many octaves back from the last hold time; all that is earlier is in the first one.
OCTAVES = 64
#: A patch of up to so many sites has a single bucket; larger ones have four to an octave, and so many that not many
#: more than a thousand sites are in the heap at once, up to MOST_BUCKETS.
ONE_BUCKET = 256
MOST_BUCKETS = 256 * OCTAVES
#: Sites that move to a bucket to come are noted in chunks of one cache line: the next chunk of the bucket, how many
#: sites, the sites.
NEXT, COUNT, ENTRIES = 0, 1, 2
HELD = 14
#: How many sites ahead a list of scattered sites is fetched.
AHEAD = 12

HIGH, LOW = 0, 1
STREAM = STREAMS["next-reaction"]


@jit
def find_patches(neighbours, order, starts, label):
    """Connected patches by breadth-first search; returns their number.

    order: (n,) int32, sites patch by patch; starts: (n + 1,) int32, where each patch begins in ``order``; label: (n,)
    int32 scratch of zeros.
    """
    n, k = neighbours.shape
    patches = 0
    filled = 0
    for seed in range(n):
        if label[seed]:
            continue
        starts[patches] = filled
        patches += 1
        label[seed] = 1
        order[filled] = seed
        read = filled
        filled += 1
        while read < filled:
            i = np.int64(order[read])
            read += 1
            for s in range(k):
                j = np.int64(neighbours[i, s])
                if j >= 0 and not label[j]:
                    label[j] = 1
                    order[filled] = j
                    filled += 1
    starts[patches] = filled
    return patches


@hot
def _before(high, low, site, other_high, other_low, other_site):
    return high < other_high or (high == other_high and (low < other_low or (low == other_low and site < other_site)))


@hot
def _rise(keys, sites, spot, at, high, low, site):
    """Put an entry at heap position ``at`` or above, where it belongs."""
    while at > 0:
        above = (at - 1) >> 2
        if not _before(high, low, site, keys[above, 0], keys[above, 1], np.int64(sites[above])):
            break
        keys[at, 0] = keys[above, 0]
        keys[at, 1] = keys[above, 1]
        sites[at] = sites[above]
        spot[sites[at], 0] = at
        at = above
    keys[at, 0] = high
    keys[at, 1] = low
    sites[at] = site
    spot[site, 0] = at


@hot
def _sink(keys, sites, spot, size, at, high, low, site):
    """Put an entry at heap position ``at`` or below, where it belongs."""
    while True:
        child = 4 * at + 1
        if child >= size:
            break
        best = child
        best_high = keys[child, 0]
        for c in range(child + 1, min(child + 4, size)):
            if keys[c, 0] <= best_high and _before(
                keys[c, 0], keys[c, 1], np.int64(sites[c]), keys[best, 0], keys[best, 1], np.int64(sites[best])
            ):
                best = c
                best_high = keys[c, 0]
        if not _before(keys[best, 0], keys[best, 1], np.int64(sites[best]), high, low, site):
            break
        keys[at, 0] = keys[best, 0]
        keys[at, 1] = keys[best, 1]
        sites[at] = sites[best]
        spot[sites[at], 0] = at
        at = best
    keys[at, 0] = high
    keys[at, 1] = low
    sites[at] = site
    spot[site, 0] = at


@inner
def _drop(keys, sites, spot, size, site):
    """Take a site out of the heap; returns the new size."""
    at = np.int64(spot[site, 0])
    if at < 0:
        return size
    spot[site, 0] = -1
    size -= 1
    if at < size:
        high = keys[size, 0]
        low = keys[size, 1]
        moved = np.int64(sites[size])
        above = (at - 1) >> 2
        if at > 0 and _before(high, low, moved, keys[above, 0], keys[above, 1], np.int64(sites[above])):
            _rise(keys, sites, spot, at, high, low, moved)
        else:
            _sink(keys, sites, spot, size, at, high, low, moved)
    return size


@inner
def _grid(sites, final, scratch):
    """How a patch of so many sites is cut into buckets, see `_bucket`."""
    bits = 2
    while sites >> (14 + bits) > 0 and OCTAVES << bits < MOST_BUCKETS:
        bits += 1
    last = (OCTAVES << bits) - 1 if sites > ONE_BUCKET else 0
    scratch[0][0] = final
    return (scratch[1][0] >> (52 - bits)) - last, 52 - bits, last


@hot
def _bucket(time, grid, scratch):
    """The bucket of a time: exponent and some leading bits of a positive double.

    ``grid`` is (what is taken from that number, bits that are left out, the last bucket); ``scratch`` a pair of views,
    as float64 and int64, of one number.
    """
    scratch[0][0] = time
    return min(max((scratch[1][0] >> grid[1]) - grid[0], 0), grid[2])


@hot
def _rehome(site, bucket, spot, heads, pool, spare):
    """Enter a site in a bucket to come. False where it stands in a later one and cannot be."""
    if spot[site, 1] < 0:
        spot[site, 1] = bucket
        chunk = heads[bucket]
        if chunk < 0 or pool[chunk, COUNT] == HELD:
            fresh = spare[0]
            if fresh >= 0:
                spare[0] = np.int64(pool[fresh, NEXT])
            else:
                fresh = spare[1]
                spare[1] += 1
            pool[fresh, NEXT] = chunk
            pool[fresh, COUNT] = 0
            heads[bucket] = fresh
            chunk = fresh
        pool[chunk, ENTRIES + pool[chunk, COUNT]] = site
        pool[chunk, COUNT] += 1
        return True
    return spot[site, 1] <= bucket


@hot
def _valid_top(keys, sites, spot, size, times, final, present, grid, scratch, heads, pool, spare):
    """Correct the entries at the top until the first is right; returns the size."""
    while size > 0:
        site = np.int64(sites[0])
        high = times[site, 0]
        low = times[site, 1]
        if high == keys[0, 0] and low == keys[0, 1]:
            break
        gone = past(high, low, final)
        if not gone:
            bucket = _bucket(high, grid, scratch)
            gone = bucket > present and _rehome(site, bucket, spot, heads, pool, spare)
        if gone:
            spot[site, 0] = -1
            size -= 1
            if size == 0:
                break
            high = keys[size, 0]
            low = keys[size, 1]
            site = np.int64(sites[size])
        _sink(keys, sites, spot, size, np.int64(0), high, low, site)
    return size


@hot
def _offer(keys, sites, spot, size, times, site, final, present, grid, scratch, heads, pool, spare):
    """See that the queue knows of a pending time that is new or earlier than it was; returns the size of the heap."""
    high = times[site, 0]
    low = times[site, 1]
    at = np.int64(spot[site, 0])
    if at >= 0:
        if _before(high, low, site, keys[at, 0], keys[at, 1], site):
            _rise(keys, sites, spot, at, high, low, site)
        return size
    if past(high, low, final):
        return size
    bucket = _bucket(high, grid, scratch)
    if bucket > present and _rehome(site, bucket, spot, heads, pool, spare):
        return size
    _rise(keys, sites, spot, size, high, low, site)
    return size + 1


@inner
def _offer_cold(keys, sites, spot, size, times, site, final, present, grid, scratch, heads, pool, spare):
    return _offer(keys, sites, spot, size, times, site, final, present, grid, scratch, heads, pool, spare)


@inner
def _open(sorted_sites, begin, end, bucket, keys, sites, spot, size, times, final, grid, scratch, heads, pool, spare):
    """Take the entries of one bucket into the heap; returns its size."""
    for at in range(begin, end):
        if at + AHEAD < end:
            touch(times, sorted_sites[at + AHEAD])
            touch(spot, sorted_sites[at + AHEAD])
        site = np.int64(sorted_sites[at])
        if spot[site, 0] < 0:
            size = _offer_cold(keys, sites, spot, size, times, site, final, bucket, grid, scratch, heads, pool, spare)
    chunk = heads[bucket]
    heads[bucket] = -1
    while chunk >= 0:
        following = np.int64(pool[chunk, NEXT])
        touch(pool, following)
        for e in range(ENTRIES, ENTRIES + pool[chunk, COUNT]):
            touch(times, pool[chunk, e])
            touch(spot, pool[chunk, e])
        for e in range(ENTRIES, ENTRIES + pool[chunk, COUNT]):
            site = np.int64(pool[chunk, e])
            spot[site, 1] = -1
            if spot[site, 0] < 0:
                size = _offer_cold(
                    keys, sites, spot, size, times, site, final, bucket, grid, scratch, heads, pool, spare
                )
        pool[chunk, NEXT] = spare[0]
        spare[0] = chunk
        chunk = following
    return size


@inner
def _sort(order, begin, end, times, final, grid, scratch, ends, room):
    """Sort the sites of a patch by bucket, those with no event before ``final`` last; ``ends`` (buckets + 2,) where
    each bucket ends."""
    buckets = grid[2] + 1
    for b in range(buckets + 2):
        ends[b] = 0
    for o in range(begin, end):
        i = np.int64(order[o])
        if o + AHEAD < end:
            touch(times, order[o + AHEAD])
        room[o - begin] = i
        b = buckets if past(times[i, 0], times[i, 1], final) else _bucket(times[i, 0], grid, scratch)
        ends[b + 1] += 1
    ends[0] = begin
    for b in range(buckets + 1):
        ends[b + 1] += ends[b]
    # Now where each bucket begins; filling them moves that to their ends.
    for o in range(end - begin):
        i = np.int64(room[o])
        if o + AHEAD < end - begin:
            touch(times, room[o + AHEAD])
        b = buckets if past(times[i, 0], times[i, 1], final) else _bucket(times[i, 0], grid, scratch)
        order[ends[b]] = i
        ends[b] += 1


@inner
def _draw(k0, k1, site, pixel, words, breaking, nu, per_unit, high, low, times, draws):
    """A new pending time for a site, from the instant high + low on. Infinite where the rate is zero."""
    word = words[site]
    if word & 1 == 0:
        barrier = word >> 1
    elif breaking.size > 0:
        barrier = fixed_barrier(breaking[site])
    else:
        times[site, 0] = np.inf
        times[site, 1] = 0.0
        return
    draw = draws[site]
    draws[site] = draw + 1
    wait = -math.log(uniform(k0, k1, STREAM, pixel, draw)) / nu
    if barrier > 0:
        wait *= math.exp(barrier * per_unit)
    if wait > 1.0e300:
        times[site, 0] = np.inf
        times[site, 1] = 0.0
        return
    times[site, 0], times[site, 1] = later(high, low, wait)


@jit
def draw_times(k0, k1, pixels, words, breaking, nu, per_unit, clock, times, draws):
    """First pending times of all sites, from the instant ``clock`` on."""
    for i in range(words.size):
        _draw(k0, k1, i, pixels[i], words, breaking, nu, per_unit, clock[HIGH], clock[LOW], times, draws)


@inner
def _around(site, words, neighbours, breaking, nu, per_unit):
    """Total rate of a site's neighbours."""
    total = 0.0
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[site, s])
        if j >= 0:
            total += own_rate(j, words, breaking, nu, per_unit)
    return total


@hot
def _turn(
    site, high, low, words, neighbours, coupling, breaking, nu, per_unit, times, draws, k0, k1, pixels, final, sooner
):
    """Flip a site and move its neighbours' energies and pending times; the site's own time is not drawn.

    Returns how many neighbours ``sooner`` lists: those whose time came forward, or came to lie before ``final``.
    """
    word = words[site] ^ 1
    words[site] = word
    sign = 1 if word & 1 else -1
    found = 0
    for s in range(neighbours.shape[1]):
        # Asked for in a short loop of its own, so that the latencies overlap.
        j = np.int64(neighbours[site, s])
        if j >= 0:
            touch(words, j)
            touch(times, j)
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[site, s])
        if j < 0:
            continue
        shift = sign * fixed_coupling(coupling[site, s])
        old = words[j]
        words[j] = old + 2 * shift
        if old & 1 or shift == 0:
            continue
        before = old >> 1
        change = max(before + shift, 0) - max(before, 0)
        left = (times[j, 0] - high) + (times[j, 1] - low)
        if left < 1.0e300:
            left *= math.exp(change * per_unit)
            late = times[j, 0] > final
            if left < 1.0e300:
                times[j, 0], times[j, 1] = later(high, low, max(left, 0.0))
            else:
                times[j, 0] = np.inf
                times[j, 1] = 0.0
            if change < 0 or (late and times[j, 0] <= final):
                sooner[found] = j
                found += 1
        else:
            # It had no event before the end of time: nothing is known of it, and the exponential forgets.
            _draw(k0, k1, j, pixels[j], words, breaking, nu, per_unit, high, low, times, draws)
            sooner[found] = j
            found += 1
    return found


@inner
def _offer_around(i, neighbours, keys, sites, spot, size, times, final, present, grid, scratch, heads, pool, spare):
    for s in range(-1, neighbours.shape[1]):
        j = np.int64(neighbours[i, s]) if s >= 0 else i
        if j >= 0:
            size = _offer(keys, sites, spot, size, times, j, final, present, grid, scratch, heads, pool, spare)
    return size


@inner
def _stay(
    rng,
    i,
    high,
    low,
    span,
    limit,
    rate_here,
    rate_back,
    around_here,
    around_back,
    words,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    times,
    draws,
    k0,
    k1,
    pixels,
    tally,
    hold,
):
    """Follow site i as a two-state chain for ``span`` seconds at most, and draw the pending times around it anew."""
    rng[0] = k0
    rng[1] = k1
    rng[2] = np.uint64(STREAM)
    rng[3] = np.uint64(pixels[i])
    rng[4] = _SOJOURN_BLOCKS + np.uint64(draws[i] * 4096)
    draws[i] += 1
    spent, exited, other, out_here, out_there = sojourn(rng, rate_here, rate_back, around_here, around_back, span)
    count_sojourn(tally, hold, words[i], out_here, out_there, other)
    high, low = later(high, low, spent)
    if past(high, low, limit):
        high = limit
        low = 0.0
    if other:
        words[i] ^= 1
        sign = 2 if words[i] & 1 else -2
        for s in range(neighbours.shape[1]):
            j = np.int64(neighbours[i, s])
            if j >= 0:
                words[j] += sign * fixed_coupling(coupling[i, s])
    chosen = -1
    if exited:
        chosen = _choose(i, uniform(k0, k1, STREAM, pixels[i], draws[i]), words, neighbours, breaking, nu, per_unit)
        draws[i] += 1
    # Given that nothing around it has fired, the pending times are exponential anew.
    _draw(k0, k1, i, pixels[i], words, breaking, nu, per_unit, high, low, times, draws)
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[i, s])
        if j >= 0:
            _draw(k0, k1, j, pixels[j], words, breaking, nu, per_unit, high, low, times, draws)
    if chosen >= 0:
        times[chosen, 0] = high
        times[chosen, 1] = low


@inner
def _choose(site, u, words, neighbours, breaking, nu, per_unit):
    """The neighbour whose event ended a sojourn, by its rate."""
    target = u * _around(site, words, neighbours, breaking, nu, per_unit)
    chosen = -1
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[site, s])
        if j >= 0:
            w = own_rate(j, words, breaking, nu, per_unit)
            if w > 0.0:
                chosen = j
                if target < w:
                    break
                target -= w
    return chosen


@inner
def _drop_around(keys, sites, spot, size, i, neighbours):
    size = _drop(keys, sites, spot, size, i)
    for s in range(neighbours.shape[1]):
        if neighbours[i, s] >= 0:
            size = _drop(keys, sites, spot, size, np.int64(neighbours[i, s]))
    return size


@hot
def _look_ahead(keys, sites, size, words, neighbours, coupling, breaking, times, draws, pixels, spot):
    """Ask for the memory of the next events while there is time.

    The next event is the first of the four below the top, most likely, and the one after it is another of them: the
    rows of all four are asked for, and the neighbours of the first, by the row that was asked for before.
    """
    after = np.int64(1)
    for c in range(1, min(5, size)):
        if keys[c, 0] < keys[after, 0]:
            after = np.int64(c)
        j = np.int64(sites[c])
        touch(words, j)
        touch_rows(j, neighbours, coupling)
    i = np.int64(sites[after])
    touch(times, i)
    touch(draws, i)
    touch(pixels, i)
    if breaking.size > 0:
        touch(breaking, i)
    for s in range(neighbours.shape[1]):
        j = np.int64(neighbours[i, s])
        if j >= 0:
            touch(words, j)
            touch(times, j)
            touch(spot, j)


@jit
def follow(
    k0,
    k1,
    pixels,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    hold_times,
    superbasins,
    order,
    starts,
    first,
    last,
    words,
    times,
    draws,
    spot,
    tally,
    events,
):
    """Follow the patches ``first`` to ``last`` - 1 to the last hold time, or for about ``events`` events.

    times: (n, 2) float64 pending times as pairs; draws: (n,) int64 numbers drawn so far; spot: (n, 2) int32 scratch, a
    site's place in the heap and the bucket to come where it is noted; superbasins, tally: as for the direct method.
    Returns the first patch not finished: its queue is made again from ``times`` when it is taken up, so nothing else
    needs to be kept.
    """
    most = 0
    for p in range(first, last):
        most = max(most, starts[p + 1] - starts[p])
    # The heap rarely holds more than a small part of a patch; what is never written takes no memory.
    keys = np.empty((most + 1, 2))
    sites = np.empty(most + 1, np.int32)
    return _follow(
        k0,
        k1,
        pixels,
        neighbours,
        coupling,
        breaking,
        nu,
        per_unit,
        hold_times,
        superbasins,
        order,
        starts,
        first,
        last,
        words,
        times,
        draws,
        spot,
        tally,
        events,
        keys,
        sites,
        np.empty(most, np.int32),
        np.empty(neighbours.shape[1], np.int64),
        np.empty(MOST_BUCKETS + 2, np.int64),
        np.empty(MOST_BUCKETS, np.int64),
        np.empty((most // HELD + MOST_BUCKETS + 1, ENTRIES + HELD), np.int32),
        np.empty(2, np.int64),
        np.empty(1),
        np.empty(5, np.uint64),
    )


@inner
def _follow(
    k0,
    k1,
    pixels,
    neighbours,
    coupling,
    breaking,
    nu,
    per_unit,
    hold_times,
    superbasins,
    order,
    starts,
    first,
    last,
    words,
    times,
    draws,
    spot,
    tally,
    events,
    keys,
    sites,
    room,
    sooner,
    ends,
    heads,
    pool,
    spare,
    number,
    rng,
):
    pixels = bare(pixels)
    neighbours = bare(neighbours)
    coupling = bare(coupling)
    breaking = bare(breaking)
    hold_times = bare(hold_times)
    order = bare(order)
    words = bare(words)
    times = bare(times)
    draws = bare(draws)
    spot = bare(spot)
    pool = bare(pool)
    spare = bare(spare)
    tally = bare(tally)
    keys = bare(keys)
    sites = bare(sites)
    sooner = bare(sooner)
    heads = bare(heads)
    rng = bare(rng)
    scratch = (bare(number), bare(number.view(np.int64)))
    final = hold_times[hold_times.size - 1]
    for p in range(first, last):
        grid = _grid(np.int64(starts[p + 1]) - starts[p], final, scratch)
        for o in range(starts[p], starts[p + 1]):
            spot[order[o], 0] = -1
            spot[order[o], 1] = -1
        _sort(order, starts[p], starts[p + 1], times, final, grid, scratch, ends, room)
        for b in range(grid[2] + 1):
            heads[b] = -1
        spare[0] = -1
        spare[1] = 0
        # Typed, or numba compiles what they are passed to for the literals, too.
        size = np.int64(0)
        hold = np.int64(0)
        present = np.int64(-1)
        aside = np.int64(-1)
        high = low = span = 0.0
        rate_here = rate_back = around_here = around_back = 0.0
        while True:
            size = _valid_top(keys, sites, spot, size, times, final, present, grid, scratch, heads, pool, spare)
            # The heap may hold entries of buckets to come; they wait until theirs is open.
            if present < grid[2] and (size == 0 or _bucket(keys[0, 0], grid, scratch) > present):
                present += 1
                begin = ends[present - 1] if present > 0 else starts[p]
                if ends[present] > begin or heads[present] >= 0:
                    size = _open(
                        order,
                        begin,
                        ends[present],
                        present,
                        keys,
                        sites,
                        spot,
                        size,
                        times,
                        final,
                        grid,
                        scratch,
                        heads,
                        pool,
                        spare,
                    )
                    if superbasins is not None and aside >= 0:
                        size = _drop_around(keys, sites, spot, size, aside, neighbours)
                continue
            if superbasins is not None and aside >= 0:
                # Now the next event elsewhere in the patch is known: follow the site set aside until then, or until a
                # neighbour's event, or the next hold time.
                i = aside
                aside = np.int64(-1)
                if size > 0:
                    span = min(span, (keys[0, 0] - high) + (keys[0, 1] - low))
                if span * min(rate_here, rate_back) >= FLICKER:
                    _stay(
                        rng,
                        i,
                        high,
                        low,
                        span,
                        hold_times[hold],
                        rate_here,
                        rate_back,
                        around_here,
                        around_back,
                        words,
                        neighbours,
                        coupling,
                        breaking,
                        nu,
                        per_unit,
                        times,
                        draws,
                        k0,
                        k1,
                        pixels,
                        tally,
                        hold,
                    )
                size = _offer_around(
                    i, neighbours, keys, sites, spot, size, times, final, present, grid, scratch, heads, pool, spare
                )
                continue
            if size == 0:
                break
            if events <= 0:
                return p
            events -= 1
            i = np.int64(sites[0])
            if size > 1:
                _look_ahead(keys, sites, size, words, neighbours, coupling, breaking, times, draws, pixels, spot)
            high = times[i, 0]
            low = times[i, 1]
            while past(high, low, hold_times[hold]):
                hold += 1
            if superbasins is not None:
                rate_back = own_rate(i, words, breaking, nu, per_unit)
                around_back = _around(i, words, neighbours, breaking, nu, per_unit)
            found = _turn(
                i,
                high,
                low,
                words,
                neighbours,
                coupling,
                breaking,
                nu,
                per_unit,
                times,
                draws,
                k0,
                k1,
                pixels,
                final,
                sooner,
            )
            count_flip(tally, hold, words[i])
            _draw(k0, k1, i, pixels[i], words, breaking, nu, per_unit, high, low, times, draws)
            for s in range(found):
                size = _offer(
                    keys, sites, spot, size, times, sooner[s], final, present, grid, scratch, heads, pool, spare
                )
            if superbasins is not None:
                # Does the site flip far more often than anything around it? Then set it and its neighbours aside.
                rate_here = own_rate(i, words, breaking, nu, per_unit)
                around_here = _around(i, words, neighbours, breaking, nu, per_unit)
                slower = min(rate_here, rate_back)
                span = until(high, low, hold_times[hold])
                if FLICKER * max(around_here, around_back) <= slower and span * slower >= FLICKER:
                    aside = i
                    size = _drop_around(keys, sites, spot, size, i, neighbours)
    return last
