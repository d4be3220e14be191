"""Kernels over a whole lattice: the connected patches of its graph, and a hash of its arrays."""

from __future__ import annotations

import numpy as np

from chemage_kinetics._memory import Int, jit

_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xBF58476D1CE4E5B9)
_P3 = np.uint64(0x94D049BB133111EB)
_R27 = np.uint64(27)
_R31 = np.uint64(31)
_R37 = np.uint64(37)


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


@jit
def mix(words: np.ndarray, seed: np.uint64) -> np.uint64:
    """A 64-bit hash of uint64 words, to distinguish arrays; not for security."""
    a = seed ^ _P1
    b = seed + _P2
    c = seed ^ _P3
    d = seed + _P1
    n = words.size
    for i in range(0, n - 3, 4):
        a = ((a ^ words[i]) * _P1) ^ (a >> _R27)
        b = ((b ^ words[i + 1]) * _P2) ^ (b >> _R31)
        c = ((c ^ words[i + 2]) * _P3) ^ (c >> _R37)
        d = ((d ^ words[i + 3]) * _P1) ^ (d >> _R31)
    for i in range(n - n % 4, n):
        a = ((a ^ words[i]) * _P2) ^ (a >> _R31)
    h = a
    for lane in (b, c, d, np.uint64(n)):
        h = (h ^ lane) * _P3
        h ^= h >> _R31
        h = h * _P2
        h ^= h >> _R27
    return h
