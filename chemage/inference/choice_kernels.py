"""Moves between choices of the prior (strength, smoothness, length) along which the density keeps its fit, compiled.

With the positive nodes fixed, the posterior of a choice is normal, N(m, (L Lᵀ)⁻¹). The process x is written as
m + L⁻ᵀ η, and the choice is drawn anew at fixed η, so that the density adapts to it: where the positive nodes are those
assumed, this draws from the posterior of the choice alone. Drawing the choice at fixed x as well makes this an
interweaving of two parametrisations (Yu & Meng, J. Comput. Graph. Stat. 20, 531 (2011); the variable η is that of
Murray & Adams, NeurIPS 23 (2010), with the measurements as surrogate data).

Memory: a candidate reads n² doubles of its factor and n² of its inverse covariance, once.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True)
def log_priors(x, level, candidates, inverses, logs):
    """(k,) logarithm of the prior of ``x`` (n,) of each of the ``candidates`` (k,), but for a constant.

    ``inverses`` (choices, n, n): inverse covariances; ``logs`` (choices,): minus half the logarithms of determinants.
    """
    n = x.size
    found = np.empty(candidates.size)
    for k in range(candidates.size):
        inverse = inverses[candidates[k]]
        total = 0.0
        for i in range(n):
            row = 0.0
            for j in range(i):
                row += inverse[i, j] * (x[j] - level)
            total += (x[i] - level) * (2.0 * row + inverse[i, i] * (x[i] - level))
        found[k] = logs[candidates[k]] - 0.5 * total
    return found


@nb.njit(cache=True, nogil=True)
def log_misfit(x, matrix, target, areas, limit):
    """Minus half of χ² of the positive part of ``x``; −∞ where its integral exceeds ``limit``."""
    n, m = matrix.shape
    mass = 0.0
    residual = -target
    for i in range(n):
        if x[i] > 0.0:
            mass += areas[i] * x[i]
            for k in range(m):
                residual[k] += x[i] * matrix[i, k]
    if mass > limit:
        return -np.inf
    total = 0.0
    for k in range(m):
        total += residual[k] * residual[k]
    return -0.5 * total


@nb.njit(cache=True, nogil=True)
def solved(factor, goals):
    """(k, n) solutions of Lᵀ x = g for the rows g of ``goals`` (k, n); ``factor`` (n, n) is L, lower triangular."""
    found = goals.copy()
    for k in range(found.shape[0]):
        x = found[k]
        for j in range(x.size - 1, -1, -1):
            x[j] /= factor[j, j]
            for i in range(j):
                x[i] -= factor[j, i] * x[j]
    return found


@nb.njit(cache=True, nogil=True)
def solved_twice(factors, goal):
    """(k, n) solutions of L Lᵀ x = ``goal`` (n,) for each of the lower triangular L of ``factors`` (k, n, n)."""
    found = np.empty((factors.shape[0], goal.size))
    for k in range(factors.shape[0]):
        lower, x = factors[k], found[k]
        for i in range(goal.size):
            total = goal[i]
            for j in range(i):
                total -= lower[i, j] * x[j]
            x[i] = total / lower[i, i]
        for j in range(goal.size - 1, -1, -1):
            x[j] /= lower[j, j]
            for i in range(j):
                x[i] -= lower[j, i] * x[j]
    return found


@nb.njit(cache=True, nogil=True)
def moved(x, choice, level, candidates, means, factors, inverses, logs, matrix, target, areas, limit, gumbels):
    """Draw the choice among ``candidates`` (k,) at fixed η; changes ``x`` (n,) in place, returns the choice.

    ``means`` (choices, n) and ``factors`` (choices, n, n), lower triangular: m and L of every choice. ``candidates``
    contains ``choice``; ``gumbels`` (k,) are standard Gumbel numbers. The others are those of :func:`log_priors` and
    :func:`log_misfit`.
    """
    n = x.size
    eta = np.zeros(n)
    lower, mean = factors[choice], means[choice]
    for j in range(n):
        away = x[j] - mean[j]
        for i in range(j + 1):
            eta[i] += lower[j, i] * away
    best, found, kept = -np.inf, choice, x.copy()
    one = np.empty(1, np.int64)
    trial = np.empty(n)
    for k in range(candidates.size):
        number = candidates[k]
        lower, mean = factors[number], means[number]
        trial[:] = eta
        volume = 0.0
        for j in range(n - 1, -1, -1):  # Lᵀ trial = η
            trial[j] /= lower[j, j]
            volume += math.log(lower[j, j])
            for i in range(j):
                trial[i] -= lower[j, i] * trial[j]
        for j in range(n):
            trial[j] += mean[j]
        if number == choice:
            trial[:] = x
        one[0] = number
        value = gumbels[k] - volume + log_misfit(trial, matrix, target, areas, limit)
        value += log_priors(trial, level, one, inverses, logs)[0]
        if value > best:
            best, found = value, number
            kept[:] = trial
    x[:] = kept
    return found
