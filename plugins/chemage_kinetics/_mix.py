"""A hash of 64 bits of an array, compiled; to distinguish arrays, not for security."""

from __future__ import annotations

import numpy as np

from chemage_kinetics._memory import jit

_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xBF58476D1CE4E5B9)
_P3 = np.uint64(0x94D049BB133111EB)
_R27 = np.uint64(27)
_R31 = np.uint64(31)
_R37 = np.uint64(37)


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
