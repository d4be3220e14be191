"""Kernels for sites that do not interact: each is a two-state chain of its own, with its own random numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage_kinetics._common import (
    FLICKER,
    SOJOURN_BLOCKS,
    SOJOURN_DRAWS,
    STREAMS,
    Float,
    Holds,
    Int,
    Key,
    begin_sequence,
    borrowed,
    count_flip,
    count_sojourn,
    fixed_barrier,
    hot,
    jit,
    next_event,
    past,
    rate,
    sojourn,
    until,
)

STREAM = STREAMS["independent"]


class IndependentSites(NamedTuple):
    """All sites in their present states, with their random numbers and the times of their next events."""

    key: Key
    pixels: np.ndarray
    """(n,) int64: index of each site's random numbers, the pixel where no other site is in it"""
    forming: np.ndarray
    """(n,) eV"""
    breaking: np.ndarray
    """(n,) eV, or empty where bonds never break"""
    nu: float
    per_unit: float
    """1/k_B T over one fixed-point unit of energy"""
    state: np.ndarray
    """(n,) bool"""
    times: np.ndarray
    """(n, 2) float64 s: pending times as pairs"""
    draws: np.ndarray
    """(n,) int64: random numbers drawn so far"""


@hot
def _draw(
    sites: IndependentSites, i: Int, barrier: Int, high: Float, low: Float
) -> tuple[Float, Float]:
    """A new pending time of site i, from the instant high + low on, as a pair. Infinite where the rate is zero."""
    draw = sites.draws[i]
    sites.draws[i] = draw + 1
    return next_event(
        sites.key,
        STREAM,
        sites.pixels[i],
        draw,
        barrier,
        sites.nu,
        sites.per_unit,
        high,
        low,
    )


@jit
def draw_times(sites: IndependentSites, start: Float) -> None:
    """Draw the first pending times of all sites, from the time ``start`` (s) on."""
    sites = borrowed(sites)
    for i in range(sites.pixels.size):
        if sites.state[i] and sites.breaking.size == 0:
            sites.times[i, 0] = np.inf
            sites.times[i, 1] = 0.0
            continue
        barrier = fixed_barrier(
            sites.breaking[i] if sites.state[i] else sites.forming[i]
        )
        sites.times[i, 0], sites.times[i, 1] = _draw(sites, i, barrier, start, 0.0)


@jit
def follow(
    sites: IndependentSites, holds: Holds, rng: np.ndarray, first: Int, last: Int
) -> None:
    """Follow the sites ``first`` to ``last`` - 1 to the last hold time. rng: (5,) uint64 scratch, see `_common`."""
    sites = borrowed(sites)
    holds = borrowed(holds)
    rng = borrowed(rng)
    final = holds.times[holds.times.size - 1]
    for i in range(first, last):
        high = sites.times[i, 0]
        low = sites.times[i, 1]
        if past(high, low, final):
            continue
        forms = fixed_barrier(sites.forming[i])
        breaks = (
            fixed_barrier(sites.breaking[i]) if sites.breaking.size > 0 else np.int64(0)
        )
        slower = min(
            rate(forms, sites.nu, sites.per_unit),
            rate(breaks, sites.nu, sites.per_unit),
        )
        hold = 0
        while not past(high, low, final):
            while past(high, low, holds.times[hold]):
                hold += 1
            bonded = not sites.state[i]
            sites.state[i] = bonded
            count_flip(holds.tally, hold, np.int64(bonded))
            if sites.breaking.size == 0:
                high = np.inf
                low = 0.0
                break
            span = until(high, low, holds.times[hold])
            if span * slower > FLICKER:
                # Many events before the hold time: the state there, and their number, are drawn together.
                block = SOJOURN_BLOCKS + np.uint64(sites.draws[i] * SOJOURN_DRAWS)
                begin_sequence(rng, sites.key, STREAM, sites.pixels[i], block)
                sites.draws[i] += 1
                here = rate(breaks if bonded else forms, sites.nu, sites.per_unit)
                there = rate(forms if bonded else breaks, sites.nu, sites.per_unit)
                _, _, other, out_here, out_there = sojourn(
                    rng, here, there, 0.0, 0.0, span
                )
                count_sojourn(
                    holds.tally, hold, np.int64(bonded), out_here, out_there, other
                )
                if other:
                    sites.state[i] = not bonded
                high = holds.times[hold]
                low = 0.0
            high, low = _draw(sites, i, breaks if sites.state[i] else forms, high, low)
        sites.times[i, 0] = high
        sites.times[i, 1] = low


@jit
def moments(
    forming: np.ndarray,
    breaking: np.ndarray,
    nu: Float,
    per_unit: Float,
    state: np.ndarray,
    spans: np.ndarray,
    mean: np.ndarray,
    variance: np.ndarray,
) -> None:
    """Expected number of bonds after ``spans`` (m,) seconds, and its variance, for every site a two-state chain."""
    mean[:] = 0.0
    variance[:] = 0.0
    for i in range(forming.size):
        forms = rate(fixed_barrier(forming[i]), nu, per_unit)
        breaks = (
            rate(fixed_barrier(breaking[i]), nu, per_unit) if breaking.size > 0 else 0.0
        )
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
