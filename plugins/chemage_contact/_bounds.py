"""Pressures within their bounds, 0 ≤ p ≤ hardness, that bear a given load."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._grid import rescale, sums
from ._operators import Team

Array = NDArray[Any]

#: To restore the load, free pixels are multiplied or divided by at most this factor; beyond it the pressure is shifted.
LARGEST_FACTOR = 2.0
#: Passes of multiplication, each of which may take more pixels to the hardness.
PASSES = 4
#: of the load, relatively
ROUNDING = 1e-14


def shift_to(q: Array, load: float, hardness: float | None = None) -> float:
    """The t for which max(q - t, 0), at most ``hardness``, adds up to ``load``: exactly, by sorting."""
    order = np.sort(q, axis=None).astype(np.float64)
    if hardness is None:
        falling = order[::-1]
        excess = np.cumsum(falling) - load
        last = int(np.flatnonzero(falling * np.arange(1, q.size + 1) > excess)[-1])
        return float(excess[last] / (last + 1))
    ends = np.concatenate([np.cumsum(order[::-1])[::-1], [0.0]])

    def above(t: Array) -> Array:
        """Σ max(q - t, 0)."""
        first = np.searchsorted(order, t)
        return ends[first] - t * (order.size - first)

    kinks = np.sort(np.concatenate([order - hardness, order]))
    totals = above(kinks) - above(kinks + hardness)
    # the sum falls with t, linearly between its kinks
    i = min(
        max(int(np.searchsorted(-totals, -load, side="right")) - 1, 0), kinks.size - 2
    )
    step = totals[i] - totals[i + 1]
    return float(
        kinks[i]
        + ((totals[i] - load) / step * (kinks[i + 1] - kinks[i]) if step > 0 else 0.0)
    )


def projected(q: Array, mean: float = 1.0, hardness: float | None = None) -> Array:
    """The nearest array to q that has the given mean, no negative entry, and none above ``hardness``."""
    admissible = np.maximum(q - np.float64(shift_to(q, mean * q.size, hardness)), 0.0)
    return admissible if hardness is None else np.minimum(admissible, hardness)


def restored(p: Array, total: float, load: float, hardness: Any, team: Team) -> float:
    """Make p (nx, ny), which is within its bounds and adds up to ``total``, add up to ``load``, in place; returns its
    sum.

    Without ``hardness`` it is multiplied; with it, only free pixels are, unless they bear too little of the load.
    """
    if hardness is None:
        return rescale(p, load / total, team)
    for _ in range(PASSES):
        full = float(hardness) * int(np.count_nonzero(p >= hardness))
        free = total - full
        if abs(total - load) <= ROUNDING * load:
            return total
        factor = (load - full) / free if free > 0.0 else 0.0
        if not 1.0 / LARGEST_FACTOR < factor < LARGEST_FACTOR:
            break
        total = rescale(p, factor, team, hardness)
    else:
        return total
    touching = p > 0
    if hardness * int(np.count_nonzero(touching)) < load:
        touching[...] = True
    some = p[touching]
    p[touching] = projected(some, load / some.size, float(hardness))
    return sums(p, p, team)[0]
