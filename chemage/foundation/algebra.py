"""Linear equations whose sums have one order, whatever the processor: BLAS adds in another one on each kind."""

from __future__ import annotations

import numpy as np


def solve(matrix: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """The solutions of ``matrix`` (n, n) x = g for g, (n,) or the columns of (n, k), as :func:`numpy.linalg.solve`.

    Gaussian elimination with row pivots; for small systems. ``matrix @ x`` without BLAS is :func:`numpy.einsum`.
    """
    left = np.array(matrix, dtype=np.float64)
    right = np.array(goals, dtype=np.float64).reshape(len(left), -1)
    count = len(left)
    for k in range(count):
        pivot = k + int(np.argmax(np.abs(left[k:, k])))
        left[[k, pivot]], right[[k, pivot]] = left[[pivot, k]], right[[pivot, k]]
        factors = (left[k + 1 :, k] / left[k, k])[:, None]
        left[k + 1 :] -= factors * left[k]
        right[k + 1 :] -= factors * right[k]
    for k in range(count - 1, -1, -1):
        right[k] /= left[k, k]
        right[:k] -= left[:k, k, None] * right[k]
    return right.reshape(goals.shape)
