"""Fused passes over the arrays of the contact iteration.

Everything that is not a Fourier transform happens here, one pass over memory per kernel. Arrays come flattened. Work is cut into blocks of
``BLOCK`` elements; each block writes its sums to its own row of ``part``, and the rows are added in order afterwards. Threads share out
whole blocks, so results are the same bytes for any number of threads. Sums run in double precision whatever the arrays are. Blocks without a
pixel of the working set are skipped, which at small loads is most of them.

Two dtypes occur: the *state* (pressure ``p``, gap before the offset ``r``) and the *work* vectors (``v``, ``z``, ``d``, ``y``).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BLOCK = 1024
# Reassociation lets sums use vector registers; infinities and NaN keep their meaning.
_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"reassoc", "nsz", "contract"}, "error_model": "numpy"}


@njit(**_OPTIONS)
def contact_sums(lo, hi, p, r, part):
    """part[b] = (Σ r, Σ 1, Σ p) over p > 0. Reads p, r."""
    n = p.size
    for b in range(lo, hi):
        total = 0.0
        count = 0
        load = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            inside = p[i] > 0
            total += float(r[i]) if inside else 0.0
            count += 1 if inside else 0
            load += float(p[i])
        part[b, 0] = total
        part[b, 1] = count
        part[b, 2] = load


@njit(**_OPTIONS)
def advance(lo, hi, p, r, y, factor, part):
    """r += factor·y, and the sums of ``contact_sums``. Reads p, y; updates r."""
    n = p.size
    for b in range(lo, hi):
        total = 0.0
        count = 0
        load = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            new = r[i] + factor * float(y[i])
            r[i] = new
            inside = p[i] > 0
            total += new if inside else 0.0
            count += 1 if inside else 0
            load += float(p[i])
        part[b, 0] = total
        part[b, 1] = count
        part[b, 2] = load


@njit(**_OPTIONS)
def residual(lo, hi, p, r, offset, v, part):
    """Steepest descent on the working set {p > 0} ∪ {gap < 0}: v = -gap there, 0 elsewhere.

    part[b] = (Σ gap² over p > 0, largest penetration where p = 0, pixels in the working set, Σ v). Reads p, r; writes v. A gap of exactly
    zero inside the set is written as a negligible number, because v ≠ 0 is what marks the set for the other kernels.
    """
    n = p.size
    for b in range(lo, hi):
        squares = 0.0
        deepest = 0.0
        count = 0
        total = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            gap = float(r[i]) + offset
            inside = p[i] > 0
            squares += gap * gap if inside else 0.0
            outside = 0.0 if inside else -gap
            deepest = outside if outside > deepest else deepest
            active = inside or gap < 0.0
            value = -gap if gap != 0.0 else 1e-30
            value = value if active else 0.0
            v[i] = value
            total += value
            count += 1 if active else 0
        part[b, 0] = squares
        part[b, 1] = deepest
        part[b, 2] = count
        part[b, 3] = total


@njit(**_OPTIONS)
def products(lo, hi, active, v, z, d, y, part):
    """Sums over the working set: part[b] = (Σ z, Σ z·v, Σ d, Σ d·v, Σ z·y, Σ d·y). Reads v, z, d, y."""
    n = v.size
    for b in range(lo, hi):
        sz = 0.0
        szv = 0.0
        sd = 0.0
        sdv = 0.0
        szy = 0.0
        sdy = 0.0
        sy = 0.0
        if active[b, 2] > 0.0:
            for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                vi = float(v[i])
                zi = float(z[i]) if vi != 0.0 else 0.0
                di = float(d[i]) if vi != 0.0 else 0.0
                yi = float(y[i]) if vi != 0.0 else 0.0
                sz += zi
                szv += zi * vi
                sd += di
                sdv += di * vi
                szy += zi * yi
                sdy += di * yi
                sy += yi
        part[b, 0] = sz
        part[b, 1] = szv
        part[b, 2] = sd
        part[b, 3] = sdv
        part[b, 4] = szy
        part[b, 5] = sdy
        part[b, 6] = sy


@njit(**_OPTIONS)
def direction(lo, hi, active, v, z, d, beta, shift, part):
    """d = z + beta·d - shift on the working set, 0 elsewhere; part[b] = largest |d|. Reads v, z; updates d."""
    n = v.size
    for b in range(lo, hi):
        largest = 0.0
        if active[b, 2] > 0.0:
            for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                value = float(z[i]) + beta * float(d[i]) - shift
                value = value if v[i] != 0 else 0.0
                d[i] = value
                size = abs(value)
                largest = size if size > largest else largest
        else:
            for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                d[i] = 0
        part[b, 0] = largest


@njit(**_OPTIONS)
def clipped(lo, hi, active, p, d, step, part):
    """What max(p + step·d, 0) would be: part[b] = (its sum, pixels it sets to zero). Reads p, d; writes nothing."""
    n = p.size
    for b in range(lo, hi):
        total = 0.0
        count = 0
        if active[b, 2] > 0.0:
            for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                new = float(p[i]) + step * float(d[i])
                negative = new < 0.0
                total += 0.0 if negative else new
                count += 1 if negative else 0
        part[b, 0] = total
        part[b, 1] = count


@njit(**_OPTIONS)
def move(lo, hi, active, p, d, step, scale):
    """p = scale·max(p + step·d, 0), and d = the change of p. Updates p, d.

    The change is rounded to the work precision first and the rounded change is added, so that p stays consistent with the gap, which only
    ever sees changes. A pixel that leaves the contact is set to exactly zero.
    """
    n = p.size
    for b in range(lo, hi):
        if active[b, 2] > 0.0:
            for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
                old = float(p[i])
                new = old + step * float(d[i])
                new = scale * new if new > 0.0 else 0.0
                d[i] = new - old
                new = old + float(d[i]) if new > 0.0 else 0.0
                p[i] = new if new > 0.0 else 0.0


@njit(**_OPTIONS)
def quadratic_form(lo, hi, spectrum, symbol, ny, part):
    """part[row] = Σ w |spectrum|² symbol over a half spectrum (nx, ny//2+1), w the multiplicity of a column. Reads both."""
    nx, columns = spectrum.shape
    for i in range(lo, hi):
        j = i if symbol.shape[0] == nx else min(i, nx - i)
        total = 0.0
        for k in range(columns):
            value = spectrum[i, k]
            total += (float(value.real) * float(value.real) + float(value.imag) * float(value.imag)) * float(
                symbol[j, k]
            )
        edge = spectrum[i, 0]
        first = (float(edge.real) ** 2 + float(edge.imag) ** 2) * float(symbol[j, 0])
        total = 2.0 * total - first
        if ny % 2 == 0 and columns > 1:
            edge = spectrum[i, columns - 1]
            total -= (float(edge.real) ** 2 + float(edge.imag) ** 2) * float(symbol[j, columns - 1])
        part[i, 0] = total


@njit(**_OPTIONS)
def multiply(lo, hi, spectrum, symbol):
    """spectrum *= symbol, in place. Symbols even in the first wave number may come with half the rows."""
    nx, columns = spectrum.shape
    for i in range(lo, hi):
        j = i if symbol.shape[0] == nx else min(i, nx - i)
        for k in range(columns):
            spectrum[i, k] = spectrum[i, k] * symbol[j, k]


@njit(**_OPTIONS)
def subtract(lo, hi, u, h, factor, r):
    """r = factor·u - h, block by block. Reads u, h; writes r."""
    n = r.size
    for b in range(lo, hi):
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            r[i] = factor * float(u[i]) - float(h[i])


@njit(**_OPTIONS)
def resample(lo, hi, source, i0, i1, wi, j0, j1, wj, target):
    """Bilinear resampling, rows lo … hi of target: weight wi of row i1 against row i0, and likewise for columns."""
    for i in range(lo, hi):
        a = i0[i]
        b = i1[i]
        w = wi[i]
        for j in range(target.shape[1]):
            left = (1.0 - w) * float(source[a, j0[j]]) + w * float(source[b, j0[j]])
            right = (1.0 - w) * float(source[a, j1[j]]) + w * float(source[b, j1[j]])
            target[i, j] = left + wj[j] * (right - left)


def blocks(n: int) -> int:
    """Number of blocks of an array of n elements."""
    return math.ceil(n / BLOCK)


def partial_sums(rows: int) -> np.ndarray:
    """A table for the sums of up to seven quantities per block."""
    return np.zeros((rows, 7))
