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
spoil. Memory: a candidate is one Cholesky factor, n² doubles. **Unknown scalars** move in the same way: another model
of the measurements takes the place of another choice.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.plugin import algebra, kernel

#: twice the logarithm by which a density is lower where it is left out
NEGLIGIBLE = 60.0
#: rows of a misfit are a multiple of these, for vectors of the processor
ROWS = 16
#: standard deviation of the integral of a density that is complete, and its largest
COMPLETE, LIMIT = 0.003, 1.02
#: standard errors by which a combination of the measurements changes with the density (1/eV) at scalars, or is left out
UNTOLD = 0.01
#: nodes by which a density is shifted at most; probability with which a new one has the sign of the one beside
SHIFTED, SAME = 8, 0.9


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
def log_tail(z):
    """Logarithm of the probability that a standard normal number exceeds ``z``."""
    if z < 0.0:
        return math.log1p(-0.5 * math.erfc(-z / math.sqrt(2.0)))
    return -0.5 * z * z + math.log(0.5 * scaled_erfc(z / math.sqrt(2.0)))


@kernel(nogil=True)
def at_log_tail(log_share):
    """The z of which :func:`log_tail` is ``log_share``; at least −38, where it is 0 to double precision.

    By Newton's method, which converges as log Q is concave.
    """
    if log_share >= -1e-300:
        return -38.0
    lower = log_share > -math.log(
        2.0
    )  # by the other tail, which is the smaller one
    goal = math.log(-math.expm1(log_share)) if lower else log_share
    # Abramowitz & Stegun, 26.2.23: to within 5e-4
    t = math.sqrt(-2.0 * goal)
    z = 2.515517 + t * (0.802853 + t * 0.010328)
    z = max(t - z / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308))), 0.0)
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
def tails(a, b, low, high):
    """Of α between ``low`` and ``high`` with the density exp(−(aα² + 2bα)/2): the logarithms of the smaller tails of
    the normal distribution beyond the nearer and the farther end, and the sign of α along them."""
    root = math.sqrt(a)
    first, last = low * root + b / root, high * root + b / root
    if first + last < 0.0:
        return log_tail(-last), log_tail(-first), -1.0
    return log_tail(first), log_tail(last), 1.0


@kernel(nogil=True)
def piece(a, b, c, low, high):
    """Logarithm of ∫ exp(−(aα² + 2bα + c)/2) dα from ``low`` to ``high``."""
    near, far, _ = tails(a, b, low, high)
    share = math.log(max(-math.expm1(far - near), 1e-300))
    return near + share - 0.5 * (c - b * b / a) + 0.5 * math.log(2.0 * math.pi / a)


@kernel(nogil=True)
def drawn(a, b, low, high, uniform):
    """α between ``low`` and ``high`` with the density exp(−(aα² + 2bα)/2)."""
    near, far, sign = tails(a, b, low, high)
    z = at_log_tail(near + math.log1p(uniform * math.expm1(far - near)))
    root = math.sqrt(a)
    return min(max((sign * z - b / root) / root, low), high)


@kernel(nogil=True)
def inner(a, b):
    """Inner product of ``a`` (n,) and ``b`` (n,): four sums, which do not wait for each other."""
    p = q = r = s = 0.0
    whole = a.size - a.size % 4
    for k in range(0, whole, 4):
        p += a[k] * b[k]
        q += a[k + 1] * b[k + 1]
        r += a[k + 2] * b[k + 2]
        s += a[k + 3] * b[k + 3]
    for k in range(whole, a.size):
        p += a[k] * b[k]
    return (p + q) + (r + s)


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
    return -0.5 * inner(residual, residual)


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
        a0, b0 = inner(v, pulls[number]), inner(v, pull)
        if not a0 > 0.0:
            continue
        misfit = inner(residual, residual)
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
                a = a0 + inner(moving, moving)
                b, c = b0 + inner(fixed, moving), inner(fixed, fixed)
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
def log_prior_of(scalars, priors):
    """Logarithm of the prior of ``scalars`` (k,): lower and upper bound, mean and standard deviation (k, 4) of each."""
    total = 0.0
    for k in range(scalars.size):
        if not priors[k, 0] <= scalars[k] <= priors[k, 1]:
            return -np.inf
        total -= 0.5 * ((scalars[k] - priors[k, 2]) / priors[k, 3]) ** 2
    return total


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
    priors,
    uniforms,
):
    """Draw ``x`` (n,) and a common factor anew along each of the ``directions`` (k, n) of their product, in place.

    What ``x`` loses by the factor 1/f keeps its integral, so that sites move between energies while the factor follows.
    By slice sampling (Neal, Ann. Statist. 31, 705 (2003)). ``pull`` (n,) is the inverse covariance times x, ``pulls``
    (k, n) times the directions; ``matrix`` (n, r) and ``target`` (r,) are those of the present factor; ``logs`` (q,)
    are the logarithms that the factor changes, with ``priors`` (q, 4) as of :func:`scalars_moved`. ``uniforms``:
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
                value -= 0.5 * inner(residual, residual)
                value += log_prior_of(logs - whole - log, priors)
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
def log_prior(x, level, inverse, log):
    """Logarithm of the prior of ``x`` (n,), but for a constant.

    ``inverse`` (n, n) is the inverse covariance, ``log`` minus half the logarithm of the determinant of the other.
    """
    total = 0.0
    for i in range(x.size):
        row = 0.0
        for j in range(i):
            row += inverse[i, j] * (x[j] - level)
        total += (x[i] - level) * (2.0 * row + inverse[i, i] * (x[i] - level))
    return log - 0.5 * total


@kernel(nogil=True)
def spline_weights(position, powers, sizes):
    """(g,) weights of the coefficients at a ``position`` (d,) on the grid of scalars.

    ``powers`` (d, 4, pieces, splines): of each axis the coefficients of the polynomials; of these there are ``sizes``
    (d, 2), pieces and splines.
    """
    weights = np.ones(1)
    for axis in range(position.size):
        piece = min(int(position[axis]), sizes[axis, 0] - 1)
        each = powers[axis, :, piece, : sizes[axis, 1]]
        away = position[axis] - piece
        basis = ((each[3] * away + each[2]) * away + each[1]) * away + each[0]
        weights = np.outer(weights, basis).ravel()
    return weights


@kernel(nogil=True)
def reduced(scalars, measured, values, errors, near):
    """Matrix (n, q) and target (q,) of the misfit, and the part of χ² that does not depend on the density.

    ``measured`` is the model at any ``scalars`` (k,), of which the first d are a position on the grid: ``powers`` and
    ``sizes`` as of :func:`spline_weights`; the coefficients ``parts`` (g, m, r), of the measurements by the ``axes``
    (n, r), and ``offsets`` (g, m); and the changes (m, k) of the logarithms of the values, and of the values, with each
    scalar. ``values`` (m,) have ``errors`` (m,) and correlations ``near`` (m,) with the point before. Combinations that
    the density does not change at these scalars are left out. The last columns are 0, the very last for the integral,
    see :func:`weighed`.
    """
    powers, sizes, axes, parts, offsets, rises, adds = measured
    m, r = values.size, axes.shape[1]
    rows, goal = np.zeros((m, r)), np.zeros((m, 1))
    weights = spline_weights(scalars[: len(sizes)], powers, sizes)
    for point in np.flatnonzero(weights):
        weight = weights[point]
        for i in range(m):
            goal[i, 0] += weight * offsets[point, i]
            for k in range(r):
                rows[i, k] += weight * parts[point, i, k]
    for i in range(m - 1, -1, -1):
        log = added = 0.0
        for k in range(scalars.size):
            log += rises[i, k] * scalars[k]
            added += adds[i, k] * scalars[k]
        factor = math.exp(log) / errors[i]
        goal[i, 0] = (values[i] - added) / errors[i] - factor * goal[i, 0]
        rows[i] *= factor
    for i in range(m - 1, 0, -1):
        if near[i] != 0.0:
            root = math.sqrt(1.0 - near[i] * near[i])
            goal[i, 0] = (goal[i, 0] - near[i] * goal[i - 1, 0]) / root
            rows[i] = (rows[i] - near[i] * rows[i - 1]) / root
    columns = rows.T.copy()
    square = algebra.products(columns, rows)
    lower = algebra.cholesky(square + 1e-6 * np.eye(r))
    goals = algebra.forward(lower, algebra.products(columns, goal))
    told = np.flatnonzero((lower * lower).sum(axis=0) > UNTOLD**2)
    width = told.size + ROWS - told.size % ROWS
    matrix, target = np.zeros((len(axes), width)), np.zeros(width)
    matrix[:, : told.size] = algebra.products(axes, lower[:, told])
    target[: told.size] = goals[told, 0]
    return matrix, target, (goal * goal).sum() - (target * target).sum()


@kernel(nogil=True)
def weighed(matrix, target, areas, integral):
    """Write the row of the misfit that keeps the integral of the density about ``integral``; nan: none does."""
    there = not math.isnan(integral)
    for i in range(areas.size):
        matrix[i, -1] = areas[i] / COMPLETE if there else 0.0
    target[-1] = integral / COMPLETE if there else 0.0


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
def normal_equations(x, level, matrix, target):
    """Precision (n, n), and its product (n, 1) with the mean less ``level``, that the measurements give where the signs
    of ``x`` (n,) stay; ``matrix`` (n, m) and ``target`` (m,) as of :func:`log_misfit`."""
    places, pull = np.flatnonzero(x > 0.0), target.copy()
    seen = matrix[places]
    for i in range(places.size):
        pull -= level * seen[i]
    square = algebra.products(seen, seen.T.copy())
    right = algebra.products(seen, pull.reshape((-1, 1)))
    precision, goal = np.zeros((x.size, x.size)), np.zeros((x.size, 1))
    for i in range(places.size):
        goal[places[i], 0] = right[i, 0]
        for j in range(places.size):
            precision[places[i], places[j]] = square[i, j]
    return precision, goal


@kernel(nogil=True)
def adapted(x, log_shares, known, level, inverse, log, equations, model, limit):
    """Logarithm of the probability of a choice and a model at fixed v and signs, but for a constant.

    With ``known`` logarithms of v, ``log_shares`` (n,), ``x`` (n,) becomes what they are there, of the same signs; or
    else they are written of ``x``. ``inverse`` and ``log`` as of :func:`log_prior`, ``equations`` as of
    :func:`normal_equations`; ``model``: matrix, target and areas of :func:`log_misfit`.
    """
    precision, goal = equations
    matrix, target, areas = model
    lower = algebra.cholesky(inverse + precision)
    mean = solved(lower, algebra.forward(lower, goal).T)[0]
    after, value = np.zeros(x.size), 0.0  # of each node, what those after it pull
    for j in range(x.size - 1, -1, -1):
        sign, middle = 1.0 if x[j] > 0.0 else -1.0, level + mean[j]
        room = log_tail(sign * (after[j] - lower[j, j] * middle))
        if known:
            z = at_log_tail(log_shares[j] + room)
            there = middle + (sign * z - after[j]) / lower[j, j]
            # rounding keeps the sign
            x[j] = max(there, 1e-300) if sign > 0.0 else min(there, 0.0)
        else:
            z = sign * (after[j] + lower[j, j] * (x[j] - middle))
            log_shares[j] = log_tail(z) - room
        value += room + 0.5 * z * z - math.log(lower[j, j])
        for i in range(j):
            after[i] += lower[j, i] * (x[j] - middle)
    value += log_misfit(x, matrix, target, areas, limit)
    return value + log_prior(x, level, inverse, log)


@kernel(nogil=True)
def choice_drawn(x, choices, level, inverses, logs, model, limit, gumbels):
    """Draw among ``choices`` (k,) of the prior, the present one first, at fixed v and signs: from 0, which.

    Changes ``x`` (n,) in place. ``gumbels`` (k,) are standard Gumbel numbers; ``inverses`` (choices, n, n) and ``logs``
    (choices,) the others of :func:`adapted`.
    """
    matrix, target, _ = model
    equations = normal_equations(x, level, matrix, target)
    shares, kept = np.empty(x.size), x.copy()
    best, chosen = -np.inf, 0
    for k in range(choices.size):
        trial, number = x.copy(), choices[k]
        value = gumbels[k] + adapted(
            trial, shares, k > 0, level, inverses[number], logs[number], equations, model, limit
        )  # fmt: skip
        if value > best:
            best, chosen = value, k
            kept[:] = trial
    x[:] = kept
    return chosen


@kernel(nogil=True)
def shifted(x, log_shares, nodes, uniforms):
    """Signs of ``x`` (n,) and ``log_shares`` (n,) moved up by ``nodes``; new ones at an end are drawn, each with the
    sign of the one beside it, or not. With them, the logarithm of the probability of those that are lost, drawn from
    those beside, over that of the new ones. ``uniforms``: (:data:`SHIFTED`, 2)."""
    signs, shares, gain = np.roll(x, nodes), np.roll(log_shares, nodes), 0.0
    inwards = 1 if nodes > 0 else -1
    for k in range(abs(nodes)):
        new = inwards * (abs(nodes) - k) - (nodes > 0)
        same = uniforms[k, 0] < SAME
        signs[new] = 1.0 if same == (signs[new + inwards] > 0.0) else -1.0
        shares[new] = math.log(1.0 - uniforms[k, 1])
        lost = new - nodes
        kept = (x[lost] > 0.0) == (x[lost - inwards] > 0.0)
        gain += math.log(SAME if kept else 1.0 - SAME)
        gain -= math.log(SAME if same else 1.0 - SAME)
    return signs, shares, gain


@kernel(nogil=True)
def scalars_moved(
    x,
    scalars,
    state,
    level,
    inverses,
    logs,
    strengths,
    areas,
    measured,
    data,
    priors,
    steps,
    flips,
    shifts,
    uniforms,
):
    """Move the ``scalars`` (k,) by each of the ``steps`` (M, k), or stay, with a density that adapts, in place.

    ``state``: choice of the prior, and whether the density is complete. Where ``flips`` (M, 2), a length and a standard
    normal number, are not nan, the step is a direction along which the logarithms of all values rise by about 1. An
    open density is then completed with smaller values, or a complete one, of which less remains, opened with larger
    ones. The open one is scaled to an integral of about 1; the probability with which that leads back is a further row
    of its model. In half of the moves the strength of the prior falls as the values rise: it is one of
    ``strengths[0]``, by steps of ``strengths[1]`` in the logarithm. ``inverses`` (choices, n, n) and ``logs``
    (choices,): see :func:`adapted`; ``priors``: :func:`log_prior_of`; ``measured`` and ``data``, values, errors and
    correlations: :func:`reduced`. The density is shifted by the nodes of ``shifts`` (M,), see :func:`shifted`.
    ``uniforms``: (M, 3 + :data:`SHIFTED`, 2).
    """
    values, errors, near = data
    rises = measured[5].sum(axis=0) / values.size
    matrix, target, rest = reduced(scalars, measured, values, errors, near)
    shares, value, known = np.empty(x.size), 0.0, False
    for number in range(len(steps)):
        choice, complete = state[0], state[1] > 0
        flip = not math.isnan(flips[number, 0])
        here = there = 1.0 if complete else np.nan
        step, gain = 1.0, 0.0
        if flip:
            width, normal = flips[number, 0], flips[number, 1]
            if complete:
                step = width * abs(normal)
                there = math.exp(-step)
            else:
                here, there = COMPLETE * normal, 1.0
                for i in range(x.size):
                    here += areas[i] * max(x[i], 0.0)
                step = math.log(max(here, 1e-300))
                if step > 0.0:
                    continue
            size = abs(step)
            gain = size + math.log(4.0 / (width * math.sqrt(2.0 * math.pi)))
            gain = (gain - 0.5 * (size / width) ** 2) * (-1.0 if complete else 1.0)
        other = scalars + step * steps[number]
        gain += log_prior_of(other, priors) - log_prior_of(scalars, priors)
        fall = 0.0
        if uniforms[number, 0, 0] < 0.5:
            for k in range(rises.size):
                fall += rises[k] * (other[k] - scalars[k]) / strengths[1]
        strength = choice % strengths[0] - math.floor(fall + uniforms[number, 1, 0])
        nodes = shifts[number]
        possible = 0 <= strength < strengths[0]
        possible = possible and abs(nodes) <= min(SHIFTED, x.size - 1)
        if gain == -np.inf or not possible:
            continue
        after = int(choice - choice % strengths[0] + strength)
        if flip or not known:
            weighed(matrix, target, areas, here)
            limit = LIMIT if complete else 1.0
            model = matrix, target, areas
            equations = normal_equations(x, level, matrix, target)
            value = adapted(
                x.copy(), shares, False, level, inverses[choice], logs[choice], equations, model, limit
            )  # fmt: skip
            known = not flip
        trial, its_shares, more = shifted(x, shares, nodes, uniforms[number, 3:])
        gain += more
        new, goal, left = reduced(other, measured, values, errors, near)
        weighed(new, goal, areas, there)
        limit = LIMIT if complete != flip else 1.0
        equations = normal_equations(trial, level, new, goal)
        found = adapted(
            trial, its_shares, True, level, inverses[after], logs[after], equations, (new, goal, areas), limit
        )  # fmt: skip
        if found - value + gain + 0.5 * (rest - left) > math.log(
            uniforms[number, 2, 0]
        ):
            x[:], shares[:], scalars[:] = trial, its_shares, other
            matrix, target, rest, value = new, goal, left, found
            state[0], state[1] = after, complete != flip
            known = not flip


@kernel(nogil=True)
def peaks_drawn(uniforms, last, widths, probability):
    """(S, 4, k) peaks of the prior, of ``uniforms`` of the same shape: their positions from 0 to ``last``, the numbers
    of their ``widths``, their weights, and whether they are there. Weights are exponential, so that their parts of the
    sum over those there are uniform; all but the first are there with a ``probability``."""
    peaks = uniforms.copy()
    for each in peaks:
        for k in range(each.shape[1]):
            each[0, k] *= last
            each[1, k] = math.floor(widths * each[1, k])
            each[2, k] = -math.log(1.0 - each[2, k])
            each[3, k] = 1.0 if k == 0 or each[3, k] < probability else 0.0
    return peaks


@kernel(nogil=True)
def of_peaks(peaks, table):
    """(m,) mean over ``peaks`` (4, k) of a ``table`` (widths, positions, m), interpolated between positions."""
    place, width, weight, there = peaks[0], peaks[1], peaks[2], peaks[3]
    total, whole = np.zeros(table.shape[2]), 0.0
    for k in range(place.size):
        if there[k] > 0.0:
            left = min(int(place[k]), table.shape[1] - 2)
            lower, upper = (
                table[int(width[k]), left],
                table[int(width[k]), left + 1],
            )
            total += weight[k] * (lower + (place[k] - left) * (upper - lower))
            whole += weight[k]
    return total / whole


@kernel(nogil=True)
def peaks_location(peaks, kt, widths):
    """-kt times the logarithm of the rate with which all ``peaks`` (4, k) react at first; all in steps."""
    place, width, weight, there = peaks[0], peaks[1], peaks[2], peaks[3]
    top, total, whole = -np.inf, 0.0, 0.0
    logs = np.full(place.size, -np.inf)
    for k in range(place.size):
        if there[k] > 0.0:
            logs[k] = 0.5 * (widths[int(width[k])] / kt) ** 2 - place[k] / kt
            whole += weight[k]
            top = max(top, logs[k])
    for k in range(place.size):
        total += weight[k] * math.exp(logs[k] - top)
    return -kt * (top + math.log(total / whole))


@kernel(nogil=True)
def peaks_moved(peaks, base, scale, table, kt, widths, probability, uniforms):
    """Move ``peaks`` (4, k) by Metropolis steps, in place; their residuals are ``base`` (m,) less ``scale`` × those of
    :func:`of_peaks` in standard errors.

    All peaks move alike, or else all or one are drawn from the prior and then all moved alike such that they react at
    first as before. ``kt`` and ``widths`` in steps of the positions; ``uniforms``: (moves, 4 k + 4).
    """
    count, last = peaks.shape[1], table.shape[1] - 1.0
    residual = base - scale * of_peaks(peaks, table)
    here = 0.5 * inner(residual, residual)
    for number in range(len(uniforms)):
        uniform, kind = uniforms[number], number % 3
        other, away, possible = peaks.copy(), 0.0, True
        if kind == 0:
            normal = math.sqrt(-2.0 * math.log(1.0 - uniform[0]))
            normal *= math.cos(2.0 * math.pi * uniform[1])
            away = 10.0 ** (4.0 * uniform[2] - 3.0) * kt * normal
        else:
            new = uniform[4:].copy().reshape((1, 4, count))
            new = peaks_drawn(new, last, widths.size, probability)[0]
            one = int(count * uniform[0])
            for k in range(count):
                if kind == 1 or k == one:
                    other[:, k] = new[:, k]
            away = peaks_location(other, kt, widths)
            away -= peaks_location(peaks, kt, widths)
            for k in range(
                count
            ):  # it draws those that are replaced, shifted as well
                drawn_back = peaks[3, k] > 0.0 and (kind == 1 or k == one)
                if drawn_back and not 0.0 <= peaks[0, k] - away <= last:
                    possible = False
        for k in range(count):
            other[0, k] -= away
            if other[3, k] > 0.0 and not 0.0 <= other[0, k] <= last:
                possible = False
            other[0, k] = min(max(other[0, k], 0.0), last)
        if not possible:
            continue
        residual = base - scale * of_peaks(other, table)
        there = 0.5 * inner(residual, residual)
        if math.log(uniform[3]) < here - there:
            peaks[:], here = other, there
