"""Kernel of the next-reaction method, patch by patch.

Sites interact along the neighbour graph only, so its connected patches evolve independently: each is followed to the
end on its own, in a small working set, on any thread. Every site has the time of its next event; see `_event_queue`.
All random numbers of a site come from its own counter (pixel, draw), so the result depends neither on the order of the
patches nor on the number of threads.

When a neighbour's event changes a site's rate from r to r', its pending time moves from t + d to t + d r / r' (Gibson &
Bruck 2000): this takes the exponential of the change in barrier, no logarithm and no random number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage_kinetics._common import (
    FLICKER,
    NEVER,
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
    begin_own_sequence,
    borrowed,
    change_state,
    choose_around,
    count_flip,
    count_sojourn,
    degree,
    fixed_barrier,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    neighbour,
    next_event,
    over_bound,
    own_uniform,
    past,
    prefetch,
    prefetch_rows,
    rate_around,
    set_time,
    site_rate,
    sojourn,
    time_of,
    until,
)
from chemage_kinetics._event_queue import (
    Buckets,
    Order,
    Queue,
    bucket_of,
    correct_top,
    drop,
    offer,
    open_bucket,
    start_patch,
)

STREAM = STREAMS["next-reaction"]


class QueuedSites(NamedTuple):
    """All sites in their present states, with their random numbers."""

    key: Key
    model: KineticModel
    pixels: Array
    """(n,) int64: index of each site's random numbers, the pixel where no other site is in it"""
    words: Array
    """(n,) int64, see `_common`"""
    draws: Array
    """(n,) int64: random numbers drawn so far"""


class NextReactionRun(NamedTuple):
    """Everything one thread works on."""

    sites: QueuedSites
    holds: Holds
    queue: Queue
    order: Order
    sooner: Array
    """(k,) int64 scratch: neighbours that the queue must know of"""
    rng: Array
    """(5,) uint64 scratch, see `_common`"""


# -- one site ------------------------------------------------------------------------------------------------------


@hot
def _draw(site: Int, now: Instant, sites: QueuedSites, times: Array) -> None:
    """Draw a new pending time of a site, from the instant ``now`` on. Never where the rate is zero."""
    model = sites.model
    word = sites.words[site]
    if word & 1 and model.breaking.size == 0:
        set_time(times, site, NEVER)
        return
    barrier = fixed_barrier(model.breaking[site]) if word & 1 else word >> 1
    set_time(times, site, next_event(site, barrier, now, sites, STREAM))


@inner
def _draw_cold(site: Int, now: Instant, sites: QueuedSites, times: Array) -> None:
    _draw(site, now, sites, times)


@jit
def draw_times(sites: QueuedSites, start: Float, times: Array) -> None:
    """Draw the first pending times (n, 2) of all sites, from the time ``start`` (s) on."""
    sites = borrowed(sites)
    times = borrowed(times)
    for i in range(sites.words.size):
        _draw(i, (start, 0.0), sites, times)


@hot
def _flip(
    site: Int, now: Instant, sites: QueuedSites, queue: Queue, sooner: Array
) -> Int:
    """Change the state of a site, and the energies and pending times of its neighbours; its own time is not drawn.

    Returns how many neighbours ``sooner`` lists: those whose time moved forward, or came to lie before the last hold
    time.
    """
    model = sites.model
    words = sites.words
    times = queue.times
    word = words[site] ^ 1
    words[site] = word
    sign = 1 if word & 1 else -1
    found = 0
    for s in range(degree(model)):
        # Prefetched in a short loop of its own, so that the latencies overlap.
        j = neighbour(site, s, model)
        if j >= 0:
            prefetch(words, j)
            prefetch(times, j)
    for s in range(degree(model)):
        j = neighbour(site, s, model)
        if j < 0:
            continue
        shift = sign * fixed_coupling(model.coupling[site, s])
        old = words[j]
        words[j] = old + 2 * shift
        if old & 1 or shift == 0:
            continue
        before = old >> 1
        change = max(before + shift, 0) - max(before, 0)
        left = (times[j, 0] - now[0]) + (times[j, 1] - now[1])
        if left < 1.0e300:
            late = times[j, 0] > queue.final
            left = max(left, 0.0) * math.exp(change * model.per_unit)
            set_time(times, j, later(now, left))
            if change < 0 or (late and times[j, 0] <= queue.final):
                sooner[found] = j
                found += 1
        else:
            # Its pending time was infinite, so nothing is known of it: the exponential law has no memory.
            _draw_cold(j, now, sites, times)
            sooner[found] = j
            found += 1
    return found


@hot
def _look_ahead(sites: QueuedSites, queue: Queue, size: Int) -> None:
    """Prefetch the memory of the next predicted events.

    The next event is most likely the first of the four below the top, and the one after it another of them: the rows of
    all four are prefetched, and the neighbours of the first, whose row has been prefetched before.
    """
    model = sites.model
    after = np.int64(1)
    for c in range(1, min(5, size)):
        if queue.keys[c, 0] < queue.keys[after, 0]:
            after = np.int64(c)
        j = np.int64(queue.sites[c])
        prefetch(sites.words, j)
        prefetch_rows(j, model)
    i = np.int64(queue.sites[after])
    prefetch(queue.times, i)
    prefetch(sites.draws, i)
    prefetch(sites.pixels, i)
    if model.breaking.size > 0:
        prefetch(model.breaking, i)
    for s in range(degree(model)):
        j = neighbour(i, s, model)
        if j >= 0:
            prefetch(sites.words, j)
            prefetch(queue.times, j)
            prefetch(queue.spot, j)


# -- a site that flickers ------------------------------------------------------------------------------------------


@inner
def _stay(
    run: NextReactionRun,
    i: Int,
    now: Instant,
    span: Float,
    chain: FlickerRates,
    hold: Int,
) -> None:
    """Follow site i as a two-state chain for ``span`` seconds at most, and draw the pending times around it anew."""
    run = borrowed(run)
    sites = run.sites
    times = run.queue.times
    rng = run.rng
    begin_own_sequence(rng, i, sites, STREAM)
    spent, exited, other, out_here, out_there = sojourn(
        rng, chain.here, chain.there, chain.around_here, chain.around_there, span
    )
    count_sojourn(run.holds.tally, hold, sites.words[i], out_here, out_there, other)
    now = later(now, spent)
    limit = run.holds.times[hold]
    if past(now, limit):
        now = (limit, 0.0)
    if other:
        change_state(i, sites)
    chosen = -1
    if exited:
        chosen = choose_around(i, own_uniform(i, sites, STREAM), sites)
    # Given that there was no event around it, the pending times are exponential from now on.
    _draw_cold(i, now, sites, times)
    for s in range(degree(sites.model)):
        j = neighbour(i, s, sites.model)
        if j >= 0:
            _draw_cold(j, now, sites, times)
    if chosen >= 0:
        set_time(times, chosen, now)


@inner
def _drop_around(queue: Queue, size: Int, i: Int, model: KineticModel) -> Int:
    """Take site i and its neighbours out of the heap; returns its size."""
    size = drop(queue, size, i)
    for s in range(degree(model)):
        j = neighbour(i, s, model)
        if j >= 0:
            size = drop(queue, size, j)
    return size


@inner
def _end_aside(
    run: NextReactionRun,
    i: Int,
    now: Instant,
    chain: FlickerRates,
    hold: Int,
    size: Int,
    grid: Buckets,
    present: Int,
) -> Int:
    """Follow site i, set aside with its neighbours, until the next event elsewhere in the patch or around it, or the
    next hold time; then enter them in the queue again. Returns the size of the heap."""
    run = borrowed(run)
    queue = run.queue
    span = until(now, run.holds.times[hold])
    if size > 0:
        span = min(span, (queue.keys[0, 0] - now[0]) + (queue.keys[0, 1] - now[1]))
    if span * min(chain.here, chain.there) >= FLICKER:
        _stay(run, i, now, span, chain, hold)
    model = run.sites.model
    for s in range(-1, degree(model)):
        j = neighbour(i, s, model) if s >= 0 else i
        if j >= 0:
            size = offer(queue, size, j, grid, present)
    return size


# -- patches -------------------------------------------------------------------------------------------------------


@hot
def _event(
    run: NextReactionRun,
    i: Int,
    now: Instant,
    hold: Int,
    size: Int,
    grid: Buckets,
    present: Int,
) -> Int:
    """The event of site i: new states and pending times of it and its neighbours. Returns the size of the heap."""
    found = _flip(i, now, run.sites, run.queue, run.sooner)
    count_flip(run.holds.tally, hold, run.sites.words[i])
    _draw(i, now, run.sites, run.queue.times)
    for s in range(found):
        size = offer(run.queue, size, run.sooner[s], grid, present)
    return size


@jit
def follow(
    run: NextReactionRun,
    first: Int,
    last: Int,
    superbasins: bool | None,
    ramp: RampBounds | None,
    events: Int,
) -> Int:
    """Follow the patches ``first`` to ``last`` - 1 to the last hold time, or for about ``events`` events.

    superbasins: True or None, so that the two-state chain is compiled only where it is used; None with a ``ramp``.
    Returns the first patch that is not finished. Its queue is made again from the pending times when it is continued,
    so nothing else is kept.
    """
    run = borrowed(run)
    sites = run.sites
    queue = run.queue
    hold_times = run.holds.times
    for p in range(first, last):
        grid = start_patch(queue, run.order, p)
        # Typed, because numba compiles what they are passed to once more for a literal.
        size = np.int64(0)
        hold = np.int64(0)
        present = np.int64(-1)
        aside = np.int64(-1)
        now = (0.0, 0.0)
        chain = FlickerRates(0.0, 0.0, 0.0, 0.0)
        while True:
            size = correct_top(queue, size, grid, present)
            # The heap may hold entries of later buckets; they wait until theirs is open.
            if present < grid.last and (
                size == 0 or bucket_of(queue.keys[0, 0], grid, queue) > present
            ):
                present += 1
                size = open_bucket(queue, run.order, p, size, grid, present)
                if superbasins is not None and aside >= 0:
                    size = _drop_around(queue, size, aside, sites.model)
                continue
            if superbasins is not None and aside >= 0:
                # Only now is the next event elsewhere in the patch known.
                size = _end_aside(run, aside, now, chain, hold, size, grid, present)
                aside = np.int64(-1)
                continue
            if size == 0:
                break
            if events <= 0:
                return p
            events -= 1
            i = np.int64(queue.sites[0])
            if size > 1:
                _look_ahead(sites, queue, size)
            now = time_of(queue.times, i)
            while past(now, hold_times[hold]):
                hold += 1
            if ramp is not None:
                u = own_uniform(i, sites, STREAM)
                if u >= over_bound(i, sites.words[i], now, ramp, sites.model):
                    _draw(i, now, sites, queue.times)
                    continue
            if superbasins is None:
                size = _event(run, i, now, hold, size, grid, present)
            else:
                there = site_rate(i, sites.words, sites.model)
                around_there = rate_around(i, sites)
                size = _event(run, i, now, hold, size, grid, present)
                here = site_rate(i, sites.words, sites.model)
                chain = FlickerRates(
                    here, there, rate_around(i, sites), around_there
                )
                # far more often than anything happens around it; what is fast around one of its states does not count
                # where it leaves that state faster still
                rarely = (
                    FLICKER * chain.around_here <= here
                    and FLICKER * around_there <= there
                )
                if (
                    rarely
                    and until(now, hold_times[hold]) * min(here, there) >= FLICKER
                ):
                    aside = i
                    size = _drop_around(queue, size, i, sites.model)
    return last
