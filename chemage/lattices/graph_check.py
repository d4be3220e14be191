"""The kernel that checks a reaction graph (numba; knows nothing of the framework)."""

from __future__ import annotations

import numpy as np
from numba import njit

#: with more neighbours than this, sorting all pairs is faster than searching the row of each
WIDE = 64


@njit(cache=True, nogil=True)
def _find_fault(neighbours, coupling):  # pragma: no cover - compiled
    n, k = neighbours.shape
    for i in range(n):
        for s in range(k):
            j = neighbours[i, s]
            if j == -1:
                continue
            if j < -1 or j >= n:
                return 1, i, s
            if j == i:
                return 2, i, s
            for other in range(s):
                if neighbours[i, other] == j:
                    return 3, i, s
            if j < i:
                continue  # the pair was checked from its lower end, and a one-sided listing is found below
            back = -1
            for other in range(k):
                if neighbours[j, other] == i:
                    back = other
                    break
            if back < 0:
                return 4, i, s
            if coupling[j, back] != coupling[i, s]:
                return 5, i, s
    for i in range(n):
        for s in range(k):
            j = neighbours[i, s]
            if j < 0 or j > i:
                continue
            back = -1
            for other in range(k):
                if neighbours[j, other] == i:
                    back = other
                    break
            if back < 0:
                return 4, i, s
    return 0, 0, 0


def find_fault(neighbours: np.ndarray, coupling: np.ndarray) -> tuple[int, int, int]:
    """First fault of a graph as (fault, site, slot): 0 none, 1 out of range, 2 own neighbour, 3 listed twice,
    4 listed from one end only, 5 two different energies. ``neighbours`` (n, k) int32, ``coupling`` (n, k) eV."""
    if neighbours.shape[1] > WIDE:
        return _find_fault_wide(neighbours, coupling)
    fault, site, slot = _find_fault(neighbours, coupling)
    return int(fault), int(site), int(slot)


def _find_fault_wide(neighbours: np.ndarray, coupling: np.ndarray) -> tuple[int, int, int]:
    """As `_find_fault`, by sorting; finds another fault first where there are several."""
    n = neighbours.shape[0]
    sites, slots = np.nonzero(neighbours != -1)
    others = neighbours[sites, slots].astype(np.int64)

    def first(fault: int, wrong: np.ndarray) -> tuple[int, int, int]:
        at = int(np.flatnonzero(wrong)[0])
        return fault, int(sites[at]), int(slots[at])

    for fault, wrong in ((1, (others < 0) | (others >= n)), (2, others == sites)):
        if wrong.any():
            return first(fault, wrong)
    pairs, turned = sites * n + others, others * n + sites
    order, back = np.argsort(pairs, kind="stable"), np.argsort(turned, kind="stable")
    twice = np.zeros(pairs.size, np.bool_)
    twice[order[1:]] = pairs[order[1:]] == pairs[order[:-1]]
    if twice.any():
        return first(3, twice)
    single = np.ones(pairs.size, np.bool_)
    single[np.isin(pairs, turned)] = False
    if single.any():
        return first(4, single)
    different = np.zeros(pairs.size, np.bool_)
    energies = coupling[sites, slots]
    different[order] = energies[order] != energies[back]
    return first(5, different) if different.any() else (0, 0, 0)
