"""The compiled moves of a chain: exactly along straight lines, and between choices of the prior.

**Lines.** Along a line x + αv the negative logarithm of the posterior of a rectified Gaussian process is a different
parabola between any two values of α at which a node becomes positive or zero. Each of these pieces has a closed
integral, so that α is drawn exactly, as in Gibbs sampling, whatever the direction v (Chen & Schmeiser, J. Comput.
Graph. Stat. 2, 251 (1993), call it hit and run). There is nothing to adapt, and the bends at x = 0, where other methods
stall, are no obstacle. Memory: n (m + n) doubles, which stay in the cache of one core; each direction reads them about
once.

**Choices** (strength, smoothness, length). With the positive nodes fixed, the posterior of a choice is normal,
N(m, (L Lᵀ)⁻¹). The process x is written as m + L⁻ᵀ η, and the choice is drawn anew at fixed η, so that the density
adapts to it: where the positive nodes are those assumed, this draws from the posterior of the choice alone. Drawing the
choice at fixed x as well makes this an interweaving of two parametrisations (Yu & Meng, J. Comput. Graph. Stat. 20, 531
(2011); the variable η is that of Murray & Adams, NeurIPS 23 (2010), with the measurements as surrogate data). Memory: a
candidate reads n² doubles of its factor and n² of its inverse covariance, once.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True)
def scaled_erfc(x):
    """exp(x²) erfc(x) for x ≥ 0, to within 1e-10."""
    if x < 6.0:
        return math.exp(x * x) * math.erfc(x)
    y = 1.0 / (2.0 * x * x)
    return (1.0 - y * (1.0 - 3.0 * y * (1.0 - 5.0 * y * (1.0 - 7.0 * y)))) / (x * math.sqrt(math.pi))


@nb.njit(cache=True, nogil=True)
def edge_integral(slope, curve, length):
    """∫ exp(−slope u − curve u²/2) du from 0 to ``length``; slope ≥ 0, curve > 0."""
    slope = max(slope, 1e-300)  # 0 × ∞ is no number
    root = math.sqrt(2.0 * curve)
    whole = scaled_erfc(slope / root)
    exponent = slope * length + 0.5 * curve * length * length
    if exponent > 700.0:
        rest = 0.0
    elif exponent < 1e-5:  # the two terms cancel
        return length * (1.0 - 0.5 * exponent)
    else:
        rest = math.exp(-exponent) * scaled_erfc((slope + curve * length) / root)
    return math.sqrt(math.pi / (2.0 * curve)) * max(whole - rest, 0.0)


@nb.njit(cache=True, nogil=True)
def piece(a, b, c, low, high):
    """Logarithm of ∫ exp(−(aα² + 2bα + c)/2) dα from ``low`` to ``high``."""
    centre = -b / a
    if low < centre < high:
        root = math.sqrt(0.5 * a)
        area = math.erf((high - centre) * root) + math.erf((centre - low) * root)
        return -0.5 * (c - b * b / a) + math.log(max(area, 1e-300)) + 0.5 * math.log(math.pi / (2.0 * a))
    edge = low if centre <= low else high
    area = edge_integral(abs(a * edge + b), a, high - low)
    if area <= 0.0:
        return -np.inf
    return -0.5 * (a * edge * edge + 2.0 * b * edge + c) + math.log(area)


@nb.njit(cache=True, nogil=True)
def drawn(a, b, low, high, uniform):
    """α between ``low`` and ``high`` with the density exp(−(aα² + 2bα)/2), by bisection of its integral."""
    centre, width = -b / a, 1.0 / math.sqrt(a)
    if low < centre < high:
        first, last = max(low, centre - 9.0 * width), min(high, centre + 9.0 * width)
        root = math.sqrt(0.5 * a)
        begin, end = math.erf((first - centre) * root), math.erf((last - centre) * root)
        goal = begin + uniform * (end - begin)
        for _ in range(46):
            middle = 0.5 * (first + last)
            if math.erf((middle - centre) * root) < goal:
                first = middle
            else:
                last = middle
        return 0.5 * (first + last)
    edge, sign = (low, 1.0) if centre <= low else (high, -1.0)
    slope = abs(a * edge + b)
    length = min(high - low, 40.0 * min(width, 1.0 / slope if slope > 0.0 else width))
    goal, first, last = uniform * edge_integral(slope, a, length), 0.0, length
    for _ in range(46):
        middle = 0.5 * (first + last)
        if edge_integral(slope, a, middle) < goal:
            first = middle
        else:
            last = middle
    return edge + sign * 0.5 * (first + last)


@nb.njit(cache=True, nogil=True)
def sweep(x, pull, matrix, target, areas, limit, directions, pulls, uniforms):
    """Draw ``x`` (n,) anew along each of the ``directions`` (k, n), in place.

    The prior is normal; ``pull`` (n,) is its inverse covariance times x minus its mean, and is kept up to date, and
    ``pulls`` (k, n) are the directions times the inverse covariance. The residuals are Σ max(x_i, 0) ``matrix``[i] −
    ``target`` (m,) in standard errors; Σ max(x_i, 0) ``areas``[i] is at most ``limit``. ``uniforms``: (k, 2).
    """
    n, m = matrix.shape
    breaks, places = np.empty(n), np.empty(n, np.int64)
    fixed, moving = np.empty(m), np.empty(m)
    lows, highs, logs = np.empty(n + 1), np.empty(n + 1), np.empty(n + 1)
    curves, linears = np.empty(n + 1), np.empty(n + 1)
    for number in range(directions.shape[0]):
        v = directions[number]
        a0 = b0 = 0.0
        for i in range(n):
            a0 += v[i] * pulls[number, i]
            b0 += v[i] * pull[i]
        if not a0 > 0.0:
            continue
        count, mass, mass_rate = 0, 0.0, 0.0
        for k in range(m):
            fixed[k], moving[k] = -target[k], 0.0
        for i in range(n):
            if v[i] != 0.0:
                breaks[count], places[count] = -x[i] / v[i], i
                count += 1
            if v[i] < 0.0 or (v[i] == 0.0 and x[i] > 0.0):  # positive for α → −∞
                mass += areas[i] * x[i]
                mass_rate += areas[i] * v[i]
                for k in range(m):
                    fixed[k] += x[i] * matrix[i, k]
                    moving[k] += v[i] * matrix[i, k]
        order = np.argsort(breaks[:count])
        best = -np.inf
        for part in range(count + 1):
            low = -np.inf if part == 0 else breaks[order[part - 1]]
            high = np.inf if part == count else breaks[order[part]]
            if mass_rate > 1e-14:
                high = min(high, (limit - mass) / mass_rate)
            elif mass_rate < -1e-14:
                low = max(low, (limit - mass) / mass_rate)
            elif mass > limit + 1e-9:
                high = low
            logs[part] = -np.inf
            if high > low:
                a, b, c = a0, b0, 0.0
                for k in range(m):
                    a += moving[k] * moving[k]
                    b += fixed[k] * moving[k]
                    c += fixed[k] * fixed[k]
                lows[part], highs[part], curves[part], linears[part] = low, high, a, b
                logs[part] = piece(a, b, c, low, high)
                best = max(best, logs[part])
            if part < count:
                i = places[order[part]]
                sign = 1.0 if v[i] > 0.0 else -1.0
                mass += sign * areas[i] * x[i]
                mass_rate += sign * areas[i] * v[i]
                for k in range(m):
                    fixed[k] += sign * x[i] * matrix[i, k]
                    moving[k] += sign * v[i] * matrix[i, k]
        if not best > -np.inf:
            continue
        total = 0.0
        for part in range(count + 1):
            total += math.exp(logs[part] - best)
        goal, chosen = uniforms[number, 0] * total, -1
        for part in range(count + 1):
            weight = math.exp(logs[part] - best)
            if weight > 0.0:
                chosen = part
                goal -= weight
                if goal <= 0.0:
                    break
        step = drawn(curves[chosen], linears[chosen], lows[chosen], highs[chosen], uniforms[number, 1])
        for i in range(n):
            x[i] += step * v[i]
            pull[i] += step * pulls[number, i]


@nb.njit(cache=True, nogil=True)
def log_priors(x, level, candidates, inverses, logs):
    """(k,) logarithm of the prior of ``x`` (n,) of each of the ``candidates`` (k,), but for a constant.

    ``inverses`` (choices, n, n): inverse covariances; ``logs`` (choices,): minus half the logarithms of determinants.
    """
    n = x.size
    priors = np.empty(candidates.size)
    for k in range(candidates.size):
        inverse = inverses[candidates[k]]
        total = 0.0
        for i in range(n):
            row = 0.0
            for j in range(i):
                row += inverse[i, j] * (x[j] - level)
            total += (x[i] - level) * (2.0 * row + inverse[i, i] * (x[i] - level))
        priors[k] = logs[candidates[k]] - 0.5 * total
    return priors


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
    solutions = goals.copy()
    for k in range(solutions.shape[0]):
        x = solutions[k]
        for j in range(x.size - 1, -1, -1):
            x[j] /= factor[j, j]
            for i in range(j):
                x[i] -= factor[j, i] * x[j]
    return solutions


@nb.njit(cache=True, nogil=True)
def solved_twice(factors, goal):
    """(k, n) solutions of L Lᵀ x = ``goal`` (n,) for each of the lower triangular L of ``factors`` (k, n, n)."""
    solutions = np.empty((factors.shape[0], goal.size))
    for k in range(factors.shape[0]):
        lower, x = factors[k], solutions[k]
        for i in range(goal.size):
            total = goal[i]
            for j in range(i):
                total -= lower[i, j] * x[j]
            x[i] = total / lower[i, i]
        for j in range(goal.size - 1, -1, -1):
            x[j] /= lower[j, j]
            for i in range(j):
                x[i] -= lower[j, i] * x[j]
    return solutions


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
    best, chosen, kept = -np.inf, choice, x.copy()
    candidate = np.empty(1, np.int64)
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
        candidate[0] = number
        value = gumbels[k] - volume + log_misfit(trial, matrix, target, areas, limit)
        value += log_priors(trial, level, candidate, inverses, logs)[0]
        if value > best:
            best, chosen = value, number
            kept[:] = trial
    x[:] = kept
    return chosen


@nb.njit(cache=True, nogil=True)
def curve_logs(residual, stated, floors, curve, near, scales, inflation, rare, wider):
    """(curves,) logarithms of the density of residuals (m,), each given the one before, but for a constant.

    ``near`` (m,): correlation with the point before. With ``rare`` above zero each point is ``wider`` with that
    probability, and summed over it; ``inflation`` (m,) is then left out.
    """
    logs = np.zeros(scales.size)
    before = 0.0
    for i in range(residual.size):
        size = scales[curve[i]] * stated[i]
        error = math.sqrt((size * (1.0 if rare > 0.0 else inflation[i])) ** 2 + floors[i] ** 2)
        away = residual[i] / error
        rest = 1.0 - near[i] * near[i]
        value = -0.5 * (away - near[i] * before) ** 2 / rest - math.log(error) - 0.5 * math.log(rest)
        before = away
        if rare > 0.0:
            wide = math.sqrt((size * wider) ** 2 + floors[i] ** 2)
            other = math.log(rare) - 0.5 * (residual[i] / wide) ** 2 - math.log(wide)
            value += math.log(1.0 - rare)
            top = max(value, other)
            value = top + math.log(math.exp(value - top) + math.exp(other - top))
        logs[curve[i]] += value
    return logs
