"""Kernels of the adhesive contact: plain functions of arrays that compute rows lo … hi and fill their rows of ``part``.

Lengths are in pixels, stresses in units of the contact modulus. ``x`` is the unknown on the padded grid: the gap on the
pixels of the surface (``h.shape``; below zero where the material flows), beyond them the displacement of the free
surface. ``law`` is :class:`CohesiveLaw`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from chemage.plugin import kernel

Array = NDArray[Any]
_OPTIONS = {
    "nogil": True,
    "fastmath": {"reassoc", "nsz", "contract"},
    "error_model": "numpy",
}
#: exponential attraction at this gap, in ranges, is that of all larger ones: none
_FAR = 60.0


class CohesiveLaw(NamedTuple):
    """The attraction of two surfaces as a function of their gap."""

    exponential: bool | None
    """or None, a constant of a kernel, which can run in vectors then"""
    work: float
    """work of adhesion"""
    range: float
    ramp: float
    """of the constant stress: half the length over which it falls to zero, about the range"""
    hardness: float
    """pressure at which the material flows: cost of a gap below zero, per area and depth"""


@kernel(**_OPTIONS)
def attraction(gap, law):
    """Stress, energy (≤ 0) and derivative of the stress (≤ 0) at a gap ≥ 0."""
    # without calls or branches, so that loops over it run in vectors
    peak = law.work / law.range
    if law.exponential is not None:
        t = min(gap * (1.0 / law.range), _FAR) * (1 / 256)
        stress = 1.0 - t * (1 / 11)
        stress = 1.0 - t * (1 / 10) * stress
        stress = 1.0 - t * (1 / 9) * stress
        stress = 1.0 - t * (1 / 8) * stress
        stress = 1.0 - t * (1 / 7) * stress
        stress = 1.0 - t * (1 / 6) * stress
        stress = 1.0 - t * (1 / 5) * stress
        stress = 1.0 - t * (1 / 4) * stress
        stress = 1.0 - t * (1 / 3) * stress
        stress = 1.0 - t * (1 / 2) * stress
        stress = 1.0 - t * stress
        for _ in range(8):
            stress *= stress
        stress *= peak
        return stress, -stress * law.range, -stress * (1.0 / law.range)
    rest = max(law.range + law.ramp - gap, 0.0)
    part = min(rest * (0.5 / law.ramp), 1.0)
    energy = law.ramp * part * part + max(rest - 2.0 * law.ramp, 0.0)
    falls = 0.0 < part < 1.0
    return peak * part, -peak * energy, -0.5 * peak / law.ramp if falls else 0.0


@kernel(**_OPTIONS)
def displaced(lo, hi, x, h, rise, u):
    """u = x + h + rise on the surface, x beyond it."""
    nx, ny = h.shape
    for i in range(lo, hi):
        for j in range(x.shape[1]):
            u[i, j] = x[i, j]
        if i < nx:
            for j in range(ny):
                u[i, j] += h[i, j] + rise


@kernel(**_OPTIONS)
def balance(lo, hi, x, p, law, shape, part):
    """part = (Σ p + stress, Σ 1) over the surface where the gap is open."""
    for i in range(lo, min(hi, shape[0])):
        total = 0.0
        count = 0.0
        for j in range(shape[1]):
            if x[i, j] > 0.0:
                total += p[i, j] + attraction(x[i, j], law)[0]
                count += 1.0
        part[i, 0] = total
        part[i, 1] = count


@kernel(**_OPTIONS)
def gradient(lo, hi, x, p, h, rise, mean, law, r, part):
    """r = gradient of the energy on the working set (gap open, or closed under tension, or flow), 0 elsewhere.

    ``p`` is the traction without its ``mean``. part = (Σ r², Σ (p + mean)², Σ p + mean, Σ u p, Σ energy of attraction,
    Σ gap, pixels in contact, Σ r, pixels of the working set, Σ |p + mean|), all but the first, fourth, eighth and ninth
    over the surface.
    """
    nx, ny = h.shape
    for i in range(lo, hi):
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = s9 = 0.0
        columns = ny if i < nx else 0
        for j in range(columns):
            gap, traction = x[i, j], p[i, j] + mean
            stress, energy, _ = attraction(max(gap, 0.0), law)
            force = traction + stress
            flows = gap < 0.0 or (gap == 0.0 and traction > law.hardness)
            if flows:
                force = traction - law.hardness
                energy -= law.hardness * gap
            s1 += traction * traction
            s2 += traction
            s9 += abs(traction)
            s3 += (gap + h[i, j] + rise) * p[i, j]
            s4 += energy
            s5 += gap
            free = gap > 0.0 or force < 0.0 or flows
            value = force if free else 0.0
            r[i, j] = value
            s0 += value * value
            s7 += value
            s8 += 1.0 if free else 0.0
            s6 += 1.0 if gap <= 0.0 else 0.0
        for j in range(columns, x.shape[1]):
            value = p[i, j]
            r[i, j] = value
            s0 += value * value
            s3 += x[i, j] * value
            s7 += value
            s8 += 1.0
        part[i, 0], part[i, 1], part[i, 2], part[i, 3], part[i, 4] = (
            s0,
            s1,
            s2,
            s3,
            s4,
        )
        part[i, 5], part[i, 6], part[i, 7], part[i, 8], part[i, 9] = (
            s5,
            s6,
            s7,
            s8,
            s9,
        )


@kernel(**_OPTIONS)
def weighted(lo, hi, r, x, edge, law, shape, weight, z):
    """z = r times ``weight``, that of the ``edge``, and about (1 + slope of the stress)^-½ where the stress jumps, which
    softens the rim, of stiffness near 1."""
    for i in range(lo, hi):
        columns = shape[1] if i < shape[0] and law.exponential is None else 0
        for j in range(columns):
            slope = attraction(max(x[i, j], 0.0), law)[2]
            weight[i, j] = edge[i, j] * (1.0 - 0.8 * slope)
            z[i, j] = r[i, j] * weight[i, j]
        for j in range(columns, r.shape[1]):
            weight[i, j] = edge[i, j]
            z[i, j] = r[i, j] * edge[i, j]


@kernel(**_OPTIONS)
def products(lo, hi, r, before, weight, shift, z, part):
    """z times ``weight``, 0 outside the working set (r = 0); part = (Σ (r − shift) z, Σ before z, Σ z)."""
    for i in range(lo, hi):
        a = b = c = 0.0
        for j in range(r.shape[1]):
            value = z[i, j] * weight[i, j] if r[i, j] != 0.0 else z.dtype.type(0)
            a += (r[i, j] - shift) * value
            b += before[i, j] * value
            c += value
            z[i, j] = value
        part[i, 0], part[i, 1], part[i, 2] = a, b, c


@kernel(**_OPTIONS)
def direction(lo, hi, r, z, shift, beta, d, part):
    """d = shift − z + β d on the working set, 0 elsewhere; part = (Σ r d,)."""
    for i in range(lo, hi):
        total = 0.0
        for j in range(r.shape[1]):
            if r[i, j] != 0.0:
                value = shift - z[i, j] + beta * d[i, j]
                d[i, j] = value
                total += r[i, j] * value
            else:
                d[i, j] = 0.0
        part[i, 0] = total


@kernel(**_OPTIONS)
def along(lo, hi, x, d, step, law, shape, part):
    """part = (Σ stress · d, Σ derivative of stress · d²) at a step along d."""
    for i in range(lo, min(hi, shape[0])):
        a = b = 0.0
        for j in range(shape[1]):
            gap = x[i, j] + step * d[i, j]
            stress, _, slope = attraction(max(gap, 0.0), law)
            a += stress * d[i, j]
            b += slope * d[i, j] * d[i, j] if gap > 0.0 else 0.0
        part[i, 0], part[i, 1] = a, b


@kernel(**_OPTIONS)
def move(lo, hi, x, d, r, step, shift, shape, out, part):
    """out = x + step·d − shift, on the surface not through zero; part = (Σ out, pixels open)."""
    nx, ny = shape
    for i in range(lo, hi):
        total = count = 0.0
        columns = ny if i < nx else 0
        for j in range(columns):
            value = x[i, j] + step * d[i, j]
            if x[i, j] < 0.0 or (x[i, j] == 0.0 and r[i, j] > 0.0):
                value = min(value, 0.0)
            else:
                value = max(value - shift if value > 0.0 else 0.0, 0.0)
            count += 1.0 if value > 0.0 else 0.0
            out[i, j] = value
            total += value
        for j in range(columns, x.shape[1]):
            out[i, j] = x[i, j] + step * d[i, j]
        part[i, 0], part[i, 1] = total, count
