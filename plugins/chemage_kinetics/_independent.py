"""Kernels for sites that do not interact: each is a two-state chain of its own, with its own random numbers."""

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
    Int,
    Key,
    KineticModel,
    RampBounds,
    begin_own_sequence,
    borrowed,
    count_flip,
    fixed_barrier,
    jit,
    next_event,
    over_bound,
    own_uniform,
    past,
    rate,
    set_time,
    stay,
    time_of,
    until,
)

STREAM = STREAMS["independent"]


class IndependentSites(NamedTuple):
    """All sites in their present states, with their random numbers and the times of their next events."""

    key: Key
    pixels: Array
    """(n,) int64: index of each site's random numbers, the pixel where no other site is in it"""
    forming: Array
    """(n,) eV"""
    model: KineticModel
    state: Array
    """(n,) bool"""
    times: Array
    """(n, 2) float64 s: pending times as pairs"""
    draws: Array
    """(n,) int64: random numbers drawn so far"""


@jit
def draw_times(sites: IndependentSites, start: Float) -> None:
    """Draw the first pending times of all sites, from the time ``start`` (s) on."""
    sites = borrowed(sites)
    breaking = sites.model.breaking
    for i in range(sites.pixels.size):
        if sites.state[i] and breaking.size == 0:
            set_time(sites.times, i, NEVER)
            continue
        barrier = fixed_barrier(breaking[i] if sites.state[i] else sites.forming[i])
        now = next_event(i, barrier, (start, 0.0), sites, STREAM)
        set_time(sites.times, i, now)


@jit
def follow(
    sites: IndependentSites,
    holds: Holds,
    ramp: RampBounds | None,
    rng: Array,
    first: Int,
    last: Int,
) -> None:
    """Follow the sites ``first`` to ``last`` - 1 to the last hold time. rng: (5,) uint64 scratch, see `_common`."""
    sites = borrowed(sites)
    holds = borrowed(holds)
    rng = borrowed(rng)
    model = sites.model
    final = holds.times[holds.times.size - 1]
    for i in range(first, last):
        now = time_of(sites.times, i)
        if past(now, final):
            continue
        forms = fixed_barrier(sites.forming[i])
        breaks = (
            fixed_barrier(model.breaking[i])
            if model.breaking.size > 0
            else np.int64(0)
        )
        slower = min(rate(forms, model), rate(breaks, model))
        hold = 0
        while not past(now, final):
            while past(now, holds.times[hold]):
                hold += 1
            bonded = not sites.state[i]
            if ramp is not None:
                word = 2 * forms + (not bonded)
                u = own_uniform(i, sites, STREAM)
                if u >= over_bound(i, word, now, ramp, model):
                    barrier = forms if bonded else breaks
                    now = next_event(i, barrier, now, sites, STREAM)
                    continue
            sites.state[i] = bonded
            count_flip(holds.tally, hold, np.int64(bonded))
            if model.breaking.size == 0:
                now = NEVER
                break
            if ramp is None and until(now, holds.times[hold]) * slower > FLICKER:
                # Many events before the hold time: the state there, and their number, are drawn together.
                begin_own_sequence(rng, i, sites, STREAM)
                here = rate(breaks if bonded else forms, model)
                there = rate(forms if bonded else breaks, model)
                rates = FlickerRates(here, there, 0.0, 0.0)
                now, _, other = stay(rng, rates, now, holds, hold, np.int64(bonded))
                if other:
                    sites.state[i] = not bonded
            barrier = breaks if sites.state[i] else forms
            now = next_event(i, barrier, now, sites, STREAM)
        set_time(sites.times, i, now)


@jit
def moments(
    forming: Array,
    model: KineticModel,
    state: Array,
    spans: Array,
    mean: Array,
    variance: Array,
) -> None:
    """Expected number of bonds after ``spans`` (m,) seconds, and its variance, for every site a two-state chain."""
    mean[:] = 0.0
    variance[:] = 0.0
    for i in range(forming.size):
        forms = rate(fixed_barrier(forming[i]), model)
        breaks = 0.0
        if model.breaking.size > 0:
            breaks = rate(fixed_barrier(model.breaking[i]), model)
        total = forms + breaks
        for t in range(spans.size):
            if total > 0.0:
                gone = -math.expm1(-total * spans[t])
                bonded = gone * (forms / total)
                if state[i]:
                    bonded = 1.0 - gone * (breaks / total)
            else:
                bonded = 1.0 if state[i] else 0.0
            mean[t] += bonded
            variance[t] += bonded * (1.0 - bonded)
