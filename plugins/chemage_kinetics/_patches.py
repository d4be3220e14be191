"""Connected patches of the neighbour graph."""

from __future__ import annotations

import numpy as np

from chemage_kinetics._memory import Int, jit


def patches_of(neighbours: np.ndarray, label: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The sites patch by patch, (n,) int32, and where each patch begins there and the last ends, (patches + 1,) int32.

    label: (n,) int32 zeros to be overwritten; None: allocated here.
    """
    n = neighbours.shape[0]
    order = np.empty(n, np.int32)
    starts = np.empty(n + 1, np.int32)
    patches = _find(neighbours, order, starts, np.zeros(n, np.int32) if label is None else label)
    return order, starts[: patches + 1].copy()


@jit
def _find(neighbours: np.ndarray, order: np.ndarray, starts: np.ndarray, label: np.ndarray) -> Int:
    """Breadth-first search; returns the number of patches."""
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
