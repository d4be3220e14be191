"""The kernel that checks a reaction graph (numba; knows nothing of the framework)."""

from __future__ import annotations

import numpy as np
from numba import njit


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
    fault, site, slot = _find_fault(neighbours, coupling)
    return int(fault), int(site), int(slot)
