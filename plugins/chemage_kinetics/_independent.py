"""Kernels for sites that do not interact: each is a two-state chain of its own, with its own random numbers."""

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
    hot,
    inner,
    jit,
    later,
    past,
    rate,
    sojourn,
    until,
)

STREAM = STREAMS["independent"]
#: With more flips than this to be expected before the next hold time, they are drawn together.
MANY = 8.0
_SOJOURN_BLOCKS = np.uint64(1 << 40)


@hot
def _wait(k0, k1, pixel, draw, barrier, nu, per_unit):
    wait = -math.log(uniform(k0, k1, STREAM, pixel, draw)) / nu
    if barrier > 0:
        wait *= math.exp(barrier * per_unit)
    return wait


@jit
def draw_times(k0, k1, pixels, forming, breaking, nu, per_unit, start, state, times, draws):
    """First pending times (n, 2) of all sites, from the time ``start`` on; infinite where the rate is zero."""
    for i in range(pixels.size):
        times[i, 0] = np.inf
        times[i, 1] = 0.0
        if state[i] and breaking.size == 0:
            continue
        barrier = fixed_barrier(breaking[i] if state[i] else forming[i])
        wait = _wait(k0, k1, pixels[i], draws[i], barrier, nu, per_unit)
        draws[i] += 1
        if wait < 1.0e300:
            times[i, 0], times[i, 1] = later(start, 0.0, wait)


@inner
def _follow(k0, k1, pixels, forming, breaking, nu, per_unit, hold_times, first, last, state, times, draws, tally, rng):
    pixels = bare(pixels)
    forming = bare(forming)
    breaking = bare(breaking)
    hold_times = bare(hold_times)
    state = bare(state)
    times = bare(times)
    draws = bare(draws)
    tally = bare(tally)
    rng = bare(rng)
    final = hold_times[hold_times.size - 1]
    rng[0] = k0
    rng[1] = k1
    rng[2] = np.uint64(STREAM)
    for i in range(first, last):
        high = times[i, 0]
        low = times[i, 1]
        if past(high, low, final):
            continue
        forms = fixed_barrier(forming[i])
        breaks = fixed_barrier(breaking[i]) if breaking.size > 0 else np.int64(0)
        slower = min(rate(forms, nu, per_unit), rate(breaks, nu, per_unit))
        hold = 0
        while not past(high, low, final):
            while past(high, low, hold_times[hold]):
                hold += 1
            bonded = not state[i]
            state[i] = bonded
            count_flip(tally, hold, np.int64(bonded))
            if breaking.size == 0:
                high = np.inf
                low = 0.0
                break
            span = until(high, low, hold_times[hold])
            if span * slower > MANY:
                rng[3] = np.uint64(pixels[i])
                rng[4] = _SOJOURN_BLOCKS + np.uint64(draws[i] * 4096)
                draws[i] += 1
                here = rate(breaks if bonded else forms, nu, per_unit)
                there = rate(forms if bonded else breaks, nu, per_unit)
                _, _, other, out_here, out_there = sojourn(rng, here, there, 0.0, 0.0, span)
                count_sojourn(tally, hold, np.int64(bonded), out_here, out_there, other)
                if other:
                    state[i] = not bonded
                high = hold_times[hold]
                low = 0.0
            wait = _wait(k0, k1, pixels[i], draws[i], breaks if state[i] else forms, nu, per_unit)
            draws[i] += 1
            if wait < 1.0e300:
                high, low = later(high, low, wait)
            else:
                high = np.inf
                low = 0.0
        times[i, 0] = high
        times[i, 1] = low


@jit
def follow(k0, k1, pixels, forming, breaking, nu, per_unit, hold_times, first, last, state, times, draws, tally):
    """Follow the sites ``first`` to ``last`` - 1 to the last hold time. tally: (m, 3) int64, bonds formed, broken, and
    the difference, between the hold time before and this one."""
    _follow(
        k0,
        k1,
        pixels,
        forming,
        breaking,
        nu,
        per_unit,
        hold_times,
        first,
        last,
        state,
        times,
        draws,
        tally,
        np.empty(5, np.uint64),
    )


@jit
def moments(forming, breaking, nu, per_unit, state, spans, mean, variance):
    """Expected number of bonds after ``spans`` (m,) seconds, and its variance, for every site a two-state chain."""
    mean[:] = 0.0
    variance[:] = 0.0
    for i in range(forming.size):
        forms = rate(fixed_barrier(forming[i]), nu, per_unit)
        breaks = rate(fixed_barrier(breaking[i]), nu, per_unit) if breaking.size > 0 else 0.0
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
