"""The compiled moves of a chain: exactly along straight lines, and between choices of the prior.

**Lines.** Along a line x + αv the negative logarithm of the posterior of a rectified Gaussian process is a different
parabola between any two values of α at which a node becomes positive or zero. Each of these pieces has a closed
integral, so that α is drawn exactly, as in Gibbs sampling, whatever the direction v (Chen & Schmeiser, J. Comput.
Graph. Stat. 2, 251 (1993), call it hit and run). There is nothing to adapt, and the bends at x = 0, where other methods
stall, are no obstacle. Memory: n (m + n) doubles, which stay in the cache of one core; each direction reads them about
once.

**Choices** (strength, smoothness, length). Given which nodes are positive, the posterior of a choice is a normal
distribution N(m, (L Lᵀ)⁻¹) restricted to these signs. The process is written by numbers v, uniform between 0 and 1:
from the last node to the first, x_j has the tail probability v_j in its normal distribution given the nodes after it,
cut at zero (Geweke 1991; Hajivassiliou & McFadden 1998). The choice is drawn anew at fixed v and fixed signs, so that
the density adapts to it; the probability of a choice is its evidence times the probabilities of the signs. This is a
non-centred parametrisation (Papaspiliopoulos, Roberts & Sköld, Statist. Sci. 22, 59 (2007)) that rectification does not
spoil. Memory: a candidate is one Cholesky factor, n² doubles. Unknown scalars are drawn in the same way: another model
of the measurements takes the place of another choice.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.plugin import algebra, kernel

#: twice the logarithm by which a density is lower where it is left out
NEGLIGIBLE = 60.0


@kernel(nogil=True)
def scaled_erfc(x):
    """exp(x²) erfc(x) for x ≥ 0, to within 1e-10."""
    if x < 6.0:
        return math.exp(x * x) * math.erfc(x)
    y = 1.0 / (2.0 * x * x)
    return (1.0 - y * (1.0 - 3.0 * y * (1.0 - 5.0 * y * (1.0 - 7.0 * y)))) / (
        x * math.sqrt(math.pi)
    )


@kernel(nogil=True)
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


@kernel(nogil=True)
def piece(a, b, c, low, high):
    """Logarithm of ∫ exp(−(aα² + 2bα + c)/2) dα from ``low`` to ``high``."""
    centre = -b / a
    if low < centre < high:
        root = math.sqrt(0.5 * a)
        area = math.erf((high - centre) * root) + math.erf((centre - low) * root)
        return (
            -0.5 * (c - b * b / a)
            + math.log(max(area, 1e-300))
            + 0.5 * math.log(math.pi / (2.0 * a))
        )
    edge = low if centre <= low else high
    area = edge_integral(abs(a * edge + b), a, high - low)
    if area <= 0.0:
        return -np.inf
    return -0.5 * (a * edge * edge + 2.0 * b * edge + c) + math.log(area)


@kernel(nogil=True)
def log_tail(z):
    """Logarithm of the probability that a standard normal number exceeds ``z``."""
    if z < 0.0:
        return math.log1p(-0.5 * math.erfc(-z / math.sqrt(2.0)))
    return -0.5 * z * z + math.log(0.5 * scaled_erfc(z / math.sqrt(2.0)))


@kernel(nogil=True)
def at_log_tail(log_share):
    """The z of which :func:`log_tail` is ``log_share``; at least −38, where it is 0 to double precision.

    Newton's method from an upper bound, Q(z) ≤ exp(−z²/2)/2, from which it converges monotonically as log Q is concave.
    """
    if log_share >= -1e-300:
        return -38.0
    lower = log_share > -math.log(
        2.0
    )  # by the other tail, which is the smaller one
    goal = math.log(-math.expm1(log_share)) if lower else log_share
    z = math.sqrt(max(-2.0 * (goal + math.log(2.0)), 0.0))
    for _ in range(60):
        tail = 0.5 * scaled_erfc(z / math.sqrt(2.0))
        step = (
            (math.log(tail) - 0.5 * z * z - goal) * tail * math.sqrt(2.0 * math.pi)
        )
        z += step
        if abs(step) < 1e-12 * (1.0 + z):
            break
    return -z if lower else z


@kernel(nogil=True)
def drawn(a, b, low, high, uniform):
    """α between ``low`` and ``high`` with the density exp(−(aα² + 2bα)/2), by the tails of the normal distribution."""
    root = math.sqrt(a)
    first, last = low * root + b / root, high * root + b / root
    sign = 1.0
    if first + last < 0.0:  # by the smaller tails
        first, last, sign = -last, -first, -1.0
    most = log_tail(first)
    z = at_log_tail(most + math.log1p(uniform * math.expm1(log_tail(last) - most)))
    return min(max((sign * z - b / root) / root, low), high)


@kernel(nogil=True)
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


@kernel(nogil=True)
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
    curves, linears, rests = np.empty(n + 1), np.empty(n + 1), np.empty(n + 1)
    residual, whole = -target, 0.0
    for i in range(n):
        if x[i] > 0.0:
            whole += areas[i] * x[i]
            for k in range(m):
                residual[k] += x[i] * matrix[i, k]
    for number in range(directions.shape[0]):
        v = directions[number]
        moved = np.flatnonzero(v)
        a0 = b0 = misfit = 0.0
        for i in range(n):
            a0 += v[i] * pulls[number, i]
            b0 += v[i] * pull[i]
        if not a0 > 0.0:
            continue
        for k in range(m):
            misfit += residual[k] * residual[k]
        # beyond, the prior alone is below exp(−NEGLIGIBLE/2) of the present density
        reach = math.sqrt(b0 * b0 + a0 * (misfit + NEGLIGIBLE)) / a0
        first, last = -b0 / a0 - reach, -b0 / a0 + reach
        count, mass, mass_rate = 0, whole, 0.0
        for k in range(m):
            fixed[k], moving[k] = residual[k], 0.0
        for i in moved:
            at = -x[i] / v[i]
            positive = (at <= first) == (v[i] > 0.0)  # at the first α
            if first < at < last:
                breaks[count], places[count] = at, i
                count += 1
            if positive:
                mass_rate += areas[i] * v[i]
                for k in range(m):
                    moving[k] += v[i] * matrix[i, k]
            if positive != (x[i] > 0.0):
                more = x[i] if positive else -x[i]
                mass += areas[i] * more
                for k in range(m):
                    fixed[k] += more * matrix[i, k]
        order = np.argsort(breaks[:count])
        top = -np.inf
        for part in range(count + 1):
            low = first if part == 0 else breaks[order[part - 1]]
            high = last if part == count else breaks[order[part]]
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
                (
                    lows[part],
                    highs[part],
                    curves[part],
                    linears[part],
                    rests[part],
                ) = (
                    low,
                    high,
                    a,
                    b,
                    c,
                )
                peak = min(max(-b / a, low), high)
                logs[part] = -0.5 * (
                    a * peak * peak + 2.0 * b * peak + c
                )  # the highest density, for now
                top = max(top, logs[part])
            if part < count:
                i = places[order[part]]
                sign = 1.0 if v[i] > 0.0 else -1.0
                mass += sign * areas[i] * x[i]
                mass_rate += sign * areas[i] * v[i]
                for k in range(m):
                    fixed[k] += sign * x[i] * matrix[i, k]
                    moving[k] += sign * v[i] * matrix[i, k]
        if not top > -np.inf:
            continue
        best = -np.inf
        for part in range(count + 1):
            if logs[part] < top - 0.5 * NEGLIGIBLE:
                logs[part] = -np.inf
            else:
                logs[part] = piece(
                    curves[part],
                    linears[part],
                    rests[part],
                    lows[part],
                    highs[part],
                )
                best = max(best, logs[part])
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
        step = drawn(
            curves[chosen],
            linears[chosen],
            lows[chosen],
            highs[chosen],
            uniforms[number, 1],
        )
        for i in range(n):
            pull[i] += step * pulls[number, i]
        for i in moved:
            before = max(x[i], 0.0)
            x[i] += step * v[i]
            more = max(x[i], 0.0) - before
            if more != 0.0:
                whole += areas[i] * more
                for k in range(m):
                    residual[k] += more * matrix[i, k]


@kernel(nogil=True)
def exchanged(
    x,
    level,
    pull,
    matrix,
    target,
    areas,
    directions,
    pulls,
    logs,
    widths,
    bounds,
    uniforms,
):
    """Draw ``x`` (n,) and a common factor anew along each of the ``directions`` (k, n) of their product, in place.

    What ``x`` loses by the factor 1/f keeps its integral, so that sites move between energies while the factor follows.
    By slice sampling (Neal, Ann. Statist. 31, 705 (2003)). ``pull`` (n,) is the inverse covariance times x, ``pulls``
    (k, n) times the directions; ``matrix`` (n, r) and ``target`` (r,) are those of the present factor; ``logs`` (q,)
    are the logarithms that the factor changes, normal with ``widths`` (q,) and within ``bounds`` (2,). ``uniforms``:
    (k, :). Returns the logarithm of the whole factor.
    """
    n, tries = x.size, uniforms.shape[1]
    trial, residual = np.empty(n), np.empty(target.size)
    whole = 0.0
    for number in range(directions.shape[0]):
        v = directions[number]
        xx = xv = vv = lx = lv = mass = step = 0.0
        for i in range(n):
            xx += x[i] * pull[i]
            xv += v[i] * pull[i]
            vv += v[i] * pulls[number, i]
            lx += level * pull[i]
            lv += level * pulls[number, i]
            mass += areas[i] * max(x[i], 0.0)
        for k in range(target.size):
            seen = 0.0
            for i in range(n):
                seen += v[i] * matrix[i, k]
            step += seen * seen
        if not vv > 0.0 or not mass > 0.0:
            continue
        step = 2.0 / math.sqrt(vv + step)
        low, high, top, used, stage, at, share = 0.0, 0.0, 0.0, 0, 0, 0.0, 1.0
        # 0: the height; 1 and 2: the lower and upper end; 3: within
        while used < tries:
            there = 0.0
            for k in range(target.size):
                residual[k] = -target[k]
            for i in range(n):
                trial[i] = x[i] + at * v[i]
                if trial[i] > 0.0:
                    there += areas[i] * trial[i]
                    for k in range(target.size):
                        residual[k] += trial[i] * matrix[i, k]
            value = -np.inf
            if there > 0.0:
                share = mass / there
                log = math.log(share)
                value = n * log
                value -= 0.5 * share * share * (xx + at * (2.0 * xv + at * vv))
                value += share * (lx + at * lv)
                for k in range(target.size):
                    value -= 0.5 * residual[k] * residual[k]
                for q in range(logs.size):
                    value -= 0.5 * ((logs[q] - whole - log) / widths[q]) ** 2
                    if not bounds[0] <= logs[q] - whole - log <= bounds[1]:
                        value = -np.inf
            uniform = uniforms[number, used]
            used += 1
            if stage == 0:
                top = value + math.log(max(uniform, 1e-300))
                low = -step * uniforms[number, used]
                high, at, stage = low + step, low, 1
                used += 1
            elif stage < 3 and value > top:
                low -= step * (stage == 1)
                high += step * (stage == 2)
                at = low if stage == 1 else high
            elif stage == 1:
                at, stage = high, 2
            elif stage == 2:
                at, stage = low + uniform * (high - low), 3
            elif value > top:
                for i in range(n):
                    x[i] = share * trial[i]
                    pull[i] = share * (pull[i] + at * pulls[number, i])
                    for k in range(target.size):
                        matrix[i, k] /= share
                whole += math.log(share)
                break
            else:
                low, high = (at, high) if at < 0.0 else (low, at)
                at = low + uniform * (high - low)
    return -whole


@kernel(nogil=True)
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


@kernel(nogil=True)
def reduced(weights, axes, parts, offsets, values, factor, errors, near):
    """Matrix (n, r) and target (r,) of the misfit, and the part of χ² that does not depend on the density.

    ``weights`` (g,) of the coefficients ``parts`` (g, m, r), the measurements by the ``axes`` (n, r), and ``offsets``
    (g, m); ``values`` (m,), measured, are ``factor`` (m,) times those of the model, with ``errors`` (m,) and
    correlations ``near`` (m,) with the point before.
    """
    m, r = values.size, axes.shape[1]
    rows, goal = np.zeros((m, r)), np.zeros((m, 1))
    for point in range(weights.size):
        if weights[point] != 0.0:
            rows += weights[point] * parts[point]
            goal[:, 0] += weights[point] * offsets[point]
    for i in range(m - 1, -1, -1):
        goal[i, 0] = (values[i] - factor[i] * goal[i, 0]) / errors[i]
        for k in range(r):
            rows[i, k] = factor[i] * rows[i, k] / errors[i]
    for i in range(m - 1, 0, -1):
        if near[i] != 0.0:
            root = math.sqrt(1.0 - near[i] * near[i])
            goal[i, 0] = (goal[i, 0] - near[i] * goal[i - 1, 0]) / root
            rows[i] = (rows[i] - near[i] * rows[i - 1]) / root
    columns = rows.T.copy()
    lower = algebra.cholesky(algebra.products(columns, rows) + 1e-6 * np.eye(r))
    target = algebra.forward(lower, algebra.products(columns, goal))
    rest = algebra.products(goal.T.copy(), goal)
    rest -= algebra.products(target.T.copy(), target)
    return algebra.products(axes, lower), target[:, 0].copy(), rest[0, 0]


@kernel(nogil=True)
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


@kernel(nogil=True)
def moved(
    x,
    choices,
    level,
    inverses,
    logs,
    matrices,
    targets,
    areas,
    limits,
    gumbels,
    known,
):
    """Draw among ``choices`` (k,) of the prior and models of the measurements, at fixed v and fixed signs.

    Changes ``x`` (n,) in place and returns which was drawn, from 0; the first is the present one. ``gumbels`` (k,) are
    standard Gumbel numbers and what the logarithm of the probability has besides. ``matrices`` (1 or k, n, m),
    ``targets`` and ``limits``: one model, or one for each choice. ``known``
    (n + 1,): log v and the logarithm of the density of the present one, or at last nan; afterwards those of the one
    drawn. The others are those of :func:`log_priors` and :func:`log_misfit`.
    """
    n = x.size
    signs, log_shares = np.where(x > 0.0, 1.0, -1.0), np.empty(n)
    trial, kept, shares = x.copy(), x.copy(), known.copy()
    precision, goal = np.empty((n, n)), np.empty((n, 1))
    number = np.empty(1, np.int64)
    best, chosen = -np.inf, 0
    for k in range(choices.size):
        number[0] = choices[k]
        at = min(k, len(matrices) - 1)
        matrix, target, limit = matrices[at], targets[at], limits[at]
        if k == 0 and len(matrices) > 1 and not np.isnan(known[n]):
            log_shares[:] = known[:n]
            best = gumbels[k] + known[n]
            continue
        if k < len(matrices):
            places, pull = np.flatnonzero(signs > 0.0), target.copy()
            seen = matrix[places]
            for i in range(places.size):
                pull -= level * seen[i]
            square = algebra.products(seen, seen.T.copy())
            right = algebra.products(seen, pull.reshape((-1, 1)))
            precision[:], goal[:] = 0.0, 0.0
            for i in range(places.size):
                goal[places[i], 0] = right[i, 0]
                for j in range(places.size):
                    precision[places[i], places[j]] = square[i, j]
        lower = algebra.cholesky(inverses[number[0]] + precision)
        mean = solved(lower, algebra.forward(lower, goal).T)[0]
        after = np.zeros(n)  # of each node, what those after it pull
        value = gumbels[k]
        for j in range(n - 1, -1, -1):
            sign, middle = signs[j], level + mean[j]
            room = log_tail(sign * (after[j] - lower[j, j] * middle))
            if k == 0:
                z = sign * (after[j] + lower[j, j] * (x[j] - middle))
                log_shares[j] = log_tail(z) - room
            else:
                z = at_log_tail(log_shares[j] + room)
                there = middle + (sign * z - after[j]) / lower[j, j]
                trial[j] = (
                    max(there, 1e-300) if sign > 0.0 else min(there, 0.0)
                )  # rounding keeps the sign
            value += room + 0.5 * z * z - math.log(lower[j, j])
            for i in range(j):
                after[i] += lower[j, i] * (trial[j] - middle)
        value += log_misfit(trial, matrix, target, areas, limit)
        value += log_priors(trial, level, number, inverses, logs)[0]
        if value > best:
            best, chosen = value, k
            kept[:] = trial
            shares[:n] = log_shares
            shares[n] = value - gumbels[k]
    x[:] = kept
    known[:] = shares
    return chosen


@kernel(nogil=True)
def curve_logs(
    residual, stated, floors, curve, near, scales, inflation, rare, wider
):
    """(curves,) logarithms of the density of residuals (m,), each given the one before, but for a constant.

    ``near`` (m,): correlation with the point before. With ``rare`` above zero each point is ``wider`` with that
    probability, and summed over it; ``inflation`` (m,) is then left out.
    """
    logs = np.zeros(scales.size)
    before = 0.0
    for i in range(residual.size):
        size = scales[curve[i]] * stated[i]
        error = math.sqrt(
            (size * (1.0 if rare > 0.0 else inflation[i])) ** 2 + floors[i] ** 2
        )
        away = residual[i] / error
        rest = 1.0 - near[i] * near[i]
        value = (
            -0.5 * (away - near[i] * before) ** 2 / rest
            - math.log(error)
            - 0.5 * math.log(rest)
        )
        before = away
        if rare > 0.0:
            wide = math.sqrt((size * wider) ** 2 + floors[i] ** 2)
            other = (
                math.log(rare) - 0.5 * (residual[i] / wide) ** 2 - math.log(wide)
            )
            value += math.log(1.0 - rare)
            top = max(value, other)
            value = top + math.log(math.exp(value - top) + math.exp(other - top))
        logs[curve[i]] += value
    return logs
