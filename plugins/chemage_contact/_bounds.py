"""Pressures within their bounds, 0 ≤ p ≤ hardness, that bear a given load."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._grid import rescale
from ._operators import Team

Array = NDArray[Any]

#: Passes in which free pixels are multiplied to restore the load, each of which may take more pixels to the hardness.
PASSES = 4
#: steps in which the shift is found at most
MOST_STEPS = 300
#: of the load, relatively
ROUNDING = 1e-14
#: One of so many numbers is in the sample that says where those of a rank are.
STRIDE = 61


def shift_to(q: Array, load: float, hardness: float | None = None) -> float:
    """The t for which max(q - t, 0), at most ``hardness``, adds up to ``load``: by sorting, or with a hardness, where
    the sum is not convex in t, by Newton's method within bounds, every third step of which halves them."""
    if hardness is None:
        order = np.sort(q, axis=None).astype(np.float64)
        falling = order[::-1]
        excess = np.cumsum(falling) - load
        last = int(np.flatnonzero(falling * np.arange(1, q.size + 1) > excess)[-1])
        return float(excess[last] / (last + 1))
    order = q.astype(np.float64)
    low, high = float(order.min()) - hardness, float(order.max())
    shift = 0.5 * (low + high)
    for count in range(1, MOST_STEPS):
        pressed = np.clip(order - shift, 0.0, hardness)
        excess = float(pressed.sum()) - load
        if abs(excess) <= ROUNDING * load:
            break
        low, high = (shift, high) if excess > 0 else (low, shift)
        free = np.count_nonzero((pressed > 0) & (pressed < hardness))
        new = shift + excess / free if free else math.nan
        if count % 3 == 0 or not low < new < high:
            new = 0.5 * (low + high)
        if new in (low, high):
            break
        shift = new
    return shift


def ranked(x: Array, first: int, last: int) -> tuple[float, float]:
    """The numbers at two places of sorted x: of those between two of a sample (R. W. Floyd, R. L. Rivest, Commun. ACM
    18, 165 (1975)), or of all where these do not contain them."""
    x = x.ravel()
    sample = np.concatenate([[-math.inf], np.sort(x[::STRIDE]), [math.inf]])
    margin = 2.0 * math.sqrt(sample.size)  # four standard deviations at most
    low = sample[max(math.floor(first / STRIDE - margin), 0)]
    high = sample[min(math.ceil(last / STRIDE + margin), sample.size - 1)]
    below, some = int(np.count_nonzero(x < low)), x[(x >= low) & (x <= high)]
    if not below <= first <= last < below + some.size:
        below, some = 0, x
    order = np.partition(some, (first - below, last - below))
    return float(order[first - below]), float(order[last - below])


def projected(q: Array, mean: float = 1.0, hardness: float | None = None) -> Array:
    """The nearest array to q that has the given mean, no negative entry, and none above ``hardness``."""
    admissible = np.maximum(
        q - np.float64(shift_to(q, mean * q.size, hardness)), 0.0
    )
    return admissible if hardness is None else np.minimum(admissible, hardness)


def restored(
    p: Array, total: float, load: float, hardness: Any, team: Team
) -> float:
    """Make p (nx, ny), which is within its bounds and adds up to ``total``, add up to ``load``, in place; returns its
    sum.

    Without ``hardness`` it is multiplied; with it, only free pixels are, and not where they bear too little of the
    load.
    """
    if hardness is None:
        return rescale(p, load / total, team)
    for _ in range(PASSES):
        full = float(hardness) * int(np.count_nonzero(p >= hardness))
        free = total - full
        if abs(total - load) <= ROUNDING * load:
            return total
        factor = (load - full) / free if free > 0.0 else 0.0
        if factor <= 0.0:
            return total
        total = rescale(p, factor, team, hardness)
    return total
