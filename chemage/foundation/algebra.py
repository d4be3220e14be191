"""Linear algebra whose sums have one order, which the shapes alone decide.

BLAS and LAPACK add in another order on another processor, or with another number of threads; a chain that hangs on the
last bit then goes another way. The innermost loops here run over elements that do not depend on each other, so that
compilers make vectors of them without changing a sum.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.kernels import kernel

#: times the longest: a row that is 0
SHORT = 1e-20


@kernel(nogil=True)
def products(a, b):
    """(m, n): ``a`` (m, k) times ``b`` (k, n)."""
    rows, inner = a.shape
    result = np.zeros((rows, b.shape[1]))
    whole = inner - inner % 4
    for i in range(rows):
        row = result[i]
        for k in range(0, whole, 4):
            p, q, r, s = a[i, k], a[i, k + 1], a[i, k + 2], a[i, k + 3]
            for j in range(row.size):
                row[j] += (p * b[k, j] + q * b[k + 1, j]) + (
                    r * b[k + 2, j] + s * b[k + 3, j]
                )
        for k in range(whole, inner):
            p = a[i, k]
            for j in range(row.size):
                row[j] += p * b[k, j]
    return result


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``a @ b`` of arrays (..., k) and (k,) or (k, n)."""
    columns = np.ascontiguousarray(b, dtype=np.float64).reshape(len(b), -1)
    result = products(
        np.ascontiguousarray(a, dtype=np.float64).reshape(-1, len(b)), columns
    )
    return result.reshape((*a.shape[:-1], *b.shape[1:]))


@kernel(nogil=True)
def cholesky(matrix):
    """(n, n) lower factor L of a positive definite ``matrix`` = L Lᵀ; nan where it is not positive definite."""
    n = matrix.shape[0]
    upper = np.zeros((n, n))
    for i in range(n):
        row = upper[i]
        for j in range(i, n):
            row[j] = matrix[i, j]
        whole = i - i % 4
        for k in range(0, whole, 4):
            p, q, r, s = (
                upper[k, i],
                upper[k + 1, i],
                upper[k + 2, i],
                upper[k + 3, i],
            )
            for j in range(i, n):
                row[j] -= (p * upper[k, j] + q * upper[k + 1, j]) + (
                    r * upper[k + 2, j] + s * upper[k + 3, j]
                )
        for k in range(whole, i):
            p = upper[k, i]
            for j in range(i, n):
                row[j] -= p * upper[k, j]
        root = 1.0 / math.sqrt(row[i]) if row[i] > 0.0 else np.nan
        for j in range(i, n):
            row[j] *= root
    return upper.T.copy()


@kernel(nogil=True)
def forward(lower, goals):
    """(n, k) solutions of L x = g for the columns g of ``goals`` (n, k); ``lower`` (n, n) is L."""
    x = goals.copy()
    for i in range(x.shape[0]):
        for k in range(i):
            factor = lower[i, k]
            for j in range(x.shape[1]):
                x[i, j] -= factor * x[k, j]
        for j in range(x.shape[1]):
            x[i, j] /= lower[i, i]
    return x


@kernel(nogil=True)
def row_axes(matrix, least):
    """(r, n) orthonormal axes of the rows of ``matrix`` (m, n), those along which it is longer than ``least``, the
    longest first; one at least.

    They are the right singular vectors, by Jacobi rotations of pairs of rows: Hestenes, J. SIAM 6, 51 (1958).
    """
    rows = matrix.copy()
    whole = (rows * rows).sum()
    # twelve are many; nothing may turn them for ever
    for _ in range(60):
        turned = False
        for i in range(rows.shape[0]):
            for j in range(i):
                a, b = rows[i], rows[j]
                aa = bb = ab = 0.0
                for k in range(a.size):
                    aa += a[k] * a[k]
                    bb += b[k] * b[k]
                    ab += a[k] * b[k]
                # a product of squares would underflow; a row this short turns no other one by a last bit
                if (
                    abs(ab) <= 1e-13 * math.sqrt(aa) * math.sqrt(bb)
                    or min(aa, bb) <= SHORT**2 * whole
                ):
                    continue
                turned = True
                ratio = (bb - aa) / (2.0 * ab)
                tangent = math.copysign(1.0, ratio) / (
                    abs(ratio) + math.hypot(1.0, ratio)
                )
                cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for k in range(a.size):
                    a[k], b[k] = (
                        cosine * a[k] - sine * b[k],
                        sine * a[k] + cosine * b[k],
                    )
        if not turned:
            break
    lengths = np.sqrt((rows * rows).sum(axis=1))
    order = np.argsort(-lengths)
    count = max((lengths > max(least, SHORT * math.sqrt(whole))).sum(), 1)
    axes = np.zeros((count, rows.shape[1]))
    if lengths[order[0]] == 0.0:
        axes[0, 0] = 1.0
        return axes
    for k in range(count):
        axes[k] = rows[order[k]] / lengths[order[k]]
    return axes


@kernel(nogil=True)
def least_squares(columns, goal):
    """(n,) x of least |Σ x_i ``columns``[i] − ``goal``| for columns (n, m) and a goal (m,): modified Gram-Schmidt."""
    n = columns.shape[0]
    axes, rest, upper, x = (
        columns.copy(),
        goal.copy(),
        np.zeros((n, n)),
        np.zeros(n),
    )
    for k in range(n):
        axis = axes[k]
        upper[k, k] = math.sqrt((axis * axis).sum())
        axis /= upper[k, k]
        for j in range(k + 1, n):
            upper[k, j] = (axis * axes[j]).sum()
            axes[j] -= upper[k, j] * axis
        x[k] = (axis * rest).sum()
        rest -= x[k] * axis
    for k in range(n - 1, -1, -1):
        x[k] /= upper[k, k]
        for i in range(k):
            x[i] -= upper[i, k] * x[k]
    return x


@kernel(nogil=True)
def nonnegative(columns, goal):
    """The same for x ≥ 0: Lawson & Hanson, Solving Least Squares Problems (1974), chapter 23."""
    n = columns.shape[0]
    x, free = np.zeros(n), np.zeros(n, np.bool_)
    least = 10.0 * max(columns.shape) * 2.2e-16 * np.abs(columns).sum(axis=1).max()
    for _ in range(3 * n):
        rest = goal.copy()
        for i in range(n):
            rest -= x[i] * columns[i]
        gain = np.empty(n)
        for i in range(n):
            gain[i] = -np.inf if free[i] else (columns[i] * rest).sum()
        new = np.argmax(gain)
        if gain[new] <= least:
            break
        free[new] = True
        while True:
            places = np.flatnonzero(free)
            found = least_squares(columns[places], goal)
            part = 1.0
            for k in range(places.size):
                if found[k] <= 0.0:
                    part = min(
                        part, x[places[k]] / max(x[places[k]] - found[k], 1e-300)
                    )
            whole = found.min() > 0.0
            for k in range(places.size):
                before = x[places[k]]
                x[places[k]] = (
                    found[k] if whole else before + part * (found[k] - before)
                )
                if (
                    not whole
                    and found[k] <= 0.0
                    and x[places[k]] <= 1e-14 * max(before, 1e-300)
                ):
                    x[places[k]], free[places[k]] = 0.0, False
            if whole or not free.any():
                break
    return x


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
