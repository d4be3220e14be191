"""Fused passes over the arrays of the contact iteration.

Everything that is not a Fourier transform happens here, with one pass over memory per kernel. What numpy does as fast
is not compiled. The work is divided into blocks: a block is up to ``width`` neighbouring pixels of one row. Each block
writes its sums to its own row of a table, and the rows are added in order afterwards. Threads process whole blocks, so
the results are the same bytes for any number of threads. Sums are made in double precision whatever the arrays are.
Blocks that are not active (no pixel of the working set in or near them) are skipped; at small loads that is most of
them.

Two dtypes occur: that of the *state* (pressure and gap) and that of the *work* vectors of the conjugate gradients. All
arrays are (nx, ny). A pixel belongs to the working set where the residual is not zero.

Every kernel starts with the range ``lo`` … ``hi`` of blocks or rows that one thread processes. Arguments that belong
together are named tuples, which numba compiles as if they were passed one by one. ``hardness``, the largest pressure,
is None where there is none: numba then leaves out what would need it. Pixels are *free* where the pressure is strictly
between its bounds, and yield where it is the hardness.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chemage.plugin import kernel

Array = NDArray[Any]

#: largest number of pixels in a block
WIDTH = 512
#: most fine pixels per coarse pixel; a constant, so that loops over it unroll
RATIO = 4
#: reach of the stencil of ``local`` in pixels
REACH = 4
#: distance between the beginnings of neighbouring lines of sums in ``local``, in numbers: a block with its halo fits,
#: and no two of the five lines begin at nearly the same address modulo 4096, where loads would wait for stores
LINE = 576
_U = np.uint64
# Reassociation lets sums use vector registers; infinities and NaN keep their meaning.
_OPTIONS = {
    "nogil": True,
    "fastmath": {"reassoc", "nsz", "contract"},
    "error_model": "numpy",
}


class Blocks(NamedTuple):
    """The blocks of a grid and which of them are active."""

    width: int
    """pixels per block, except for the last one of a row"""
    per_row: int
    """blocks per row"""
    active: Array
    """(rows · per_row,) uint8, block by block"""


class DescentState(NamedTuple):
    """The unknown and its gradient, in the precision of the state."""

    p: Array
    """pressure"""
    r: Array
    """gap up to a uniform offset"""


class Search(NamedTuple):
    """The vectors of the conjugate gradients, in the precision of the work."""

    v: Array
    """residual: minus the gap on the working set, 0 elsewhere"""
    z: Array
    """preconditioned residual"""
    outward: Array
    """preconditioner applied to the indicator of the working set"""
    d: Array
    """direction"""
    y: Array
    """displacement under the previous direction"""


class Heights(NamedTuple):
    """Heights (nx, ny) as given, and what makes them dimensionless: (values - top)·factor has rms 1 and no positive
    entry. Kernels compute that on the fly, which saves an array."""

    values: Array
    top: float = 0.0
    factor: float = 1.0


class Interpolation(NamedTuple):
    """Linear interpolation along one axis: entry k of the target is (1 - weight[k])·source[lower[k]] +
    weight[k]·source[upper[k]]."""

    lower: Array
    upper: Array
    weight: Array


class Taps(NamedTuple):
    """Linear interpolation of a coarse line on one of pixels that are finer by up to ``RATIO``, and its transpose."""

    step: Any
    """size of a fine pixel over that of a coarse one"""
    begin: Array
    """(size,) the first fine pixel that is not before a coarse one"""
    shift: Array
    """(size,) how far behind it is, in fine pixels"""
    straight: Array
    """(size,) end of the coarse pixels from each on that begin ``RATIO`` fine ones apart, or of the line's last but one:
    with loops over such, indices are straight lines, as vector registers need them"""
    even: Array
    """(REACH + 1, size) half the sum of the weights of the fine pixels so far before and behind that one, and"""
    odd: Array
    """(REACH + 1, size) half their difference"""


def widths(columns: int) -> tuple[int, int]:
    """Pixels per block of a row of ``columns``, and blocks per row."""
    per_row = math.ceil(columns / WIDTH)
    width = min(columns, 16 * math.ceil(columns / per_row / 16))
    while (columns - 1) % width + 1 < REACH < width:
        width -= 16  # the last block must hold the reach of the stencil
    return width, math.ceil(columns / width)


@kernel(**_OPTIONS)
def _block(blocks, b, columns):
    """Row, first column and end column of block b."""
    row = b // blocks.per_row
    start = (b - row * blocks.per_row) * blocks.width
    return row, start, min(columns, start + blocks.width)


@kernel(**_OPTIONS)
def advance(lo, hi, blocks, state, y, factor, hardness, part):
    """r += factor·y; part[b] = (Σ r, Σ 1) over free pixels. Reads p, y; updates r."""
    p, r = state.p, state.r
    for b in range(lo, hi):
        total = 0.0
        count = 0.0
        if blocks.active[b]:
            row, start, stop = _block(blocks, b, p.shape[1])
            pb, rb, yb = p[row, start:stop], r[row, start:stop], y[row, start:stop]
            for i in range(pb.size):
                new = r.dtype.type(rb[i] + factor * yb[i])
                rb[i] = new
                weight = 1.0 if pb[i] > 0 else 0.0
                if hardness is not None:
                    weight = weight if pb[i] < hardness else 0.0
                total += weight * new
                count += weight
        part[b, 0] = total
        part[b, 1] = count


@kernel(**_OPTIONS)
def residual(lo, hi, blocks, state, offset, hardness, v, part):
    """Residual on the working set, all free pixels and those whose gap has the wrong sign (gap < 0 where p = 0, gap > 0
    where p is the hardness): v = -gap there, 0 elsewhere.

    part[b] = (Σ gap² over free pixels, largest |gap| of a wrong sign, pixels in the working set, Σ v, Σ p², Σ gap² of
    wrong signs). Reads p, r; writes v. A gap of exactly zero inside the set is written as a negligible number, because
    v ≠ 0 marks the set.
    """
    p, r = state.p, state.r
    for b in range(lo, hi):
        squares = 0.0
        through = 0.0
        deepest = 0.0
        count = 0.0
        total = 0.0
        pressures = 0.0
        if blocks.active[b]:
            row, start, stop = _block(blocks, b, p.shape[1])
            pb, rb, vb = p[row, start:stop], r[row, start:stop], v[row, start:stop]
            for i in range(pb.size):
                gap = rb[i] + offset
                inside = pb[i] > 0
                wrong = gap < 0.0
                if hardness is not None:
                    wrong = (gap > 0.0) if pb[i] >= hardness else wrong
                    inside = inside and pb[i] < hardness
                pressures += float(pb[i]) * float(pb[i])
                held = gap if inside else 0.0
                squares += held * held
                outside = gap if wrong and not inside else 0.0
                through += outside * outside
                value = -(held + outside)
                value = 1e-30 if inside and value == 0.0 else value
                vb[i] = value
                total += value
                count += 1.0 if value != 0.0 else 0.0
            if (
                through > 0.0
            ):  # a loop of its own: an extremum would keep the sums above out of vector registers
                for i in range(pb.size):
                    if pb[i] <= 0 and rb[i] + offset < -deepest:
                        deepest = -(rb[i] + offset)
                    if (
                        hardness is not None
                        and pb[i] >= hardness
                        and rb[i] + offset > deepest
                    ):
                        deepest = rb[i] + offset
        part[b, 0] = squares
        part[b, 1] = deepest
        part[b, 2] = count
        part[b, 3] = total
        part[b, 4] = pressures
        part[b, 5] = through


@kernel(**_OPTIONS)
def indicator(lo, hi, blocks, v, out, clear):
    """out = 1 on the working set, 0 elsewhere; blocks that are not active are only written if ``clear``. Reads v."""
    for b in range(lo, hi):
        row, start, stop = _block(blocks, b, v.shape[1])
        vb, ob = v[row, start:stop], out[row, start:stop]
        if blocks.active[b]:
            for i in range(vb.size):
                ob[i] = 1 if vb[i] != 0 else 0
        elif clear:
            ob[:] = 0


@kernel(**_OPTIONS)
def products(lo, hi, blocks, search, share, uniform, part):
    """z -= share·max(outward - uniform, 0)·v on the working set, 0 elsewhere in active blocks, and sums over the set:
    part[b] = (Σ z, Σ z·v, Σ d, Σ d·v, Σ z·y, Σ d·y, Σ y). Reads v, outward, d, y; updates z.
    """
    v, z, d, y = search.v, search.z, search.d, search.y
    level = z.dtype.type(uniform)
    for b in range(lo, hi):
        sz = 0.0
        szv = 0.0
        sd = 0.0
        sdv = 0.0
        szy = 0.0
        sdy = 0.0
        sy = 0.0
        if blocks.active[b]:
            row, start, stop = _block(blocks, b, v.shape[1])
            vb = v[row, start:stop]
            zb = z[row, start:stop]
            db = d[row, start:stop]
            yb = y[row, start:stop]
            kb = search.outward[row, start:stop]
            for i in range(vb.size):
                vi = float(vb[i])
                weight = 1.0 if vi != 0.0 else 0.0
                loss = kb[i] - level if kb[i] > level else 0.0
                zi = weight * zb[i] - share * loss * vi
                zb[i] = zi
                di = weight * db[i]
                yi = float(yb[i])
                sz += zi
                szv += zi * vi
                sd += di
                sdv += di * vi
                szy += zi * yi
                sdy += di * yi
                sy += weight * yi
        part[b, 0] = sz
        part[b, 1] = szv
        part[b, 2] = sd
        part[b, 3] = sdv
        part[b, 4] = szy
        part[b, 5] = sdy
        part[b, 6] = sy


@kernel(**_OPTIONS)
def direction(lo, hi, blocks, search, beta, shift, clear, terms, part):
    """d = z + beta·d - shift on the working set, 0 elsewhere; blocks that are not active are only written if
    ``clear``. part[b] = (Σ d², Σ z² + (beta·d)² if ``terms``, else 0), from which cancellation is recognised. Reads v,
    z; updates d."""
    v, z, d = search.v, search.z, search.d
    for b in range(lo, hi):
        row, start, stop = _block(blocks, b, v.shape[1])
        vb, zb, db = v[row, start:stop], z[row, start:stop], d[row, start:stop]
        squares = 0.0
        both = 0.0
        if blocks.active[b]:
            if terms:
                for i in range(vb.size):
                    new, old = float(zb[i]), beta * db[i]
                    both += new * new + old * old if vb[i] != 0 else 0.0
            for i in range(vb.size):
                value = zb[i] + beta * db[i] - shift
                value = value if vb[i] != 0 else 0.0
                db[i] = value
                squares += value * value
        elif clear:
            db[:] = 0
        part[b, 0] = squares
        part[b, 1] = both


@kernel(**_OPTIONS)
def projection(lo, hi, blocks, p, d, step, shift, hardness, part):
    """Sums of q - shift, cut to the bounds of the pressure, with q = p + step·d, without storing it: part[b] = (its
    sum, pixels where it is free, Σ of its squared difference from q). With a hardness, pixels with d = 0 stay as they
    are: the shift may have any sign, and must not move what is no part of the working set. Reads p, d; writes nothing
    else."""
    for b in range(lo, hi):
        total = 0.0
        count = 0.0
        squares = 0.0
        if blocks.active[b]:
            row, start, stop = _block(blocks, b, p.shape[1])
            pb, db = p[row, start:stop], d[row, start:stop]
            for i in range(pb.size):
                new = pb[i] + step * db[i] - shift
                cut = new if new < 0.0 else 0.0
                if hardness is None:
                    change = cut + shift
                    squares += change * change
                    total += new - cut
                    count += 1.0 if new > 0.0 else 0.0
                else:
                    cut = new - hardness if new > hardness else cut
                    moved = 1.0 if db[i] != 0 else 0.0
                    change = moved * (cut + shift)
                    squares += change * change
                    total += new - cut if db[i] != 0 else pb[i]
                    count += moved if new > 0.0 and new < hardness else 0.0
        part[b, 0] = total
        part[b, 1] = count
        part[b, 2] = squares


@kernel(**_OPTIONS)
def move(lo, hi, blocks, p, d, step, shift, scale, hardness, part):
    """p = scale·max(p + step·d - shift, 0), at most the hardness (see ``projection``), and d = the change of p.
    part[b] = Σ p. Updates p, d.

    The change is rounded to the work precision first and the rounded change is added, so that p stays consistent with
    the gap, which is only updated by changes. A pixel that leaves the contact is set to exactly zero, one that yields
    to exactly the hardness.
    """
    for b in range(lo, hi):
        total = 0.0
        if blocks.active[b]:
            row, start, stop = _block(blocks, b, p.shape[1])
            pb, db = p[row, start:stop], d[row, start:stop]
            for i in range(pb.size):
                old = pb[i]
                new = old + step * db[i] - shift
                new = scale * new if new > 0.0 else 0.0
                if hardness is not None:
                    new = min(new, hardness) if db[i] != 0 else old
                db[i] = new - old
                rounded = old + db[i]
                if hardness is not None:
                    rounded = (
                        hardness if new >= hardness else min(rounded, hardness)
                    )
                new = rounded if new > 0.0 and rounded > 0.0 else 0.0
                pb[i] = new
                total += new
        part[b, 0] = total


@kernel(**_OPTIONS)
def correct(lo, hi, blocks, search, e, step, factor, part):
    """A step of the linear correction on the working set: e += step·d, v -= factor·y. part[b] = (Σ e², largest |e|,
    Σ v, Σ v²). Reads d, y; updates e, v. The working set stays marked by v ≠ 0."""
    v, d, y = search.v, search.d, search.y
    for b in range(lo, hi):
        squares = 0.0
        largest = 0.0
        total = 0.0
        rest = 0.0
        if blocks.active[b]:
            row, start, stop = _block(blocks, b, v.shape[1])
            vb = v[row, start:stop]
            db = d[row, start:stop]
            yb = y[row, start:stop]
            eb = e[row, start:stop]
            for i in range(vb.size):
                new = vb[i] - factor * yb[i]
                new = 1e-30 if new == 0.0 else new
                new = new if vb[i] != 0 else 0.0
                vb[i] = new
                total += new
                rest += float(new) * float(new)
                change = eb[i] + step * db[i]
                eb[i] = change
                squares += change * change
            for i in range(eb.size):
                largest = max(largest, abs(eb[i]))
        part[b, 0] = squares
        part[b, 1] = largest
        part[b, 2] = total
        part[b, 3] = rest


@kernel(**_OPTIONS)
def subtract(lo, hi, blocks, u, heights, factor, base, state, hardness, part):
    """r = factor·u - (values - top)·scale + base with the heights' values, top and factor (scale), in every block;
    part[b] = (Σ r, Σ 1) over free pixels. Reads u, the heights and p; writes r."""
    h, top, scale = heights.values, heights.top, heights.factor
    p, r = state.p, state.r
    for b in range(lo, hi):
        row, start, stop = _block(blocks, b, p.shape[1])
        ub = u[row, start:stop]
        hb = h[row, start:stop]
        pb = p[row, start:stop]
        rb = r[row, start:stop]
        total = 0.0
        count = 0.0
        for i in range(pb.size):
            new = r.dtype.type(factor * ub[i] - (hb[i] - top) * scale + base)
            rb[i] = new
            weight = 1.0 if pb[i] > 0 else 0.0
            if hardness is not None:
                weight = weight if pb[i] < hardness else 0.0
            total += weight * new
            count += weight
        part[b, 0] = total
        part[b, 1] = count


def convert(lo, hi, x, out):
    """out = x in another precision, rows lo … hi. As fast with numpy, and not compiled for every pair of precisions."""
    with np.errstate(all="ignore"):  # as in compiled code
        np.copyto(out[lo:hi], x[lo:hi], casting="same_kind")


@kernel(**_OPTIONS)
def totals(lo, hi, p, r, part):
    """part[row] = (Σ p, Σ p·|r|, least p). Reads p, r."""
    for i in range(lo, hi):
        pb, rb = p[i], r[i]
        total = 0.0
        weighted = 0.0
        for j in range(pb.size):
            total += pb[j]
            weighted += float(pb[j]) * abs(float(rb[j]))
        least = np.inf
        for j in range(pb.size):
            least = min(least, pb[j])
        part[i, 0] = total
        part[i, 1] = weighted
        part[i, 2] = least


@kernel(**_OPTIONS)
def scale(lo, hi, p, factor, hardness, part):
    """p *= factor, up to the hardness and except where p is it already; part[row] = Σ p. Updates p."""
    for i in range(lo, hi):
        pb = p[i]
        total = 0.0
        for j in range(pb.size):
            new = pb[j] * factor
            if hardness is not None:
                new = hardness if pb[j] >= hardness else min(new, hardness)
            pb[j] = new
            total += new
        part[i, 0] = total


@kernel(**_OPTIONS)
def moments(lo, hi, heights, top, factor, part):
    """part[row] = (mean, Σ (x - mean)²) of x = (heights - top)·factor. Reads heights, twice but from cache."""
    for i in range(lo, hi):
        hb = heights[i]
        total = 0.0
        for j in range(hb.size):
            total += (hb[j] - top) * factor
        mean = total / hb.size
        squares = 0.0
        for j in range(hb.size):
            x = (hb[j] - top) * factor - mean
            squares += x * x
        part[i, 0] = mean
        part[i, 1] = squares


def standardise(lo, hi, heights, out):
    """out = the dimensionless heights, which are computed in double precision. Once per grid."""
    rows = max(1, WIDTH * 64 // max(1, out.shape[1]))  # that stay in cache
    for start in range(lo, hi, rows):
        here = slice(start, min(start + rows, hi))
        with np.errstate(all="ignore"):
            below = np.subtract(heights.values[here], heights.top, dtype=np.float64)
            np.multiply(below, heights.factor, out=out[here], casting="same_kind")


@kernel(**_OPTIONS)
def quadratic_form(lo, hi, spectrum, symbol, ny, part):
    """part[row] = Σ w |spectrum|² symbol over a half spectrum (nx, ny//2+1), w the multiplicity of a column."""
    nx, columns = spectrum.shape
    for i in range(lo, hi):
        j = i if symbol.shape[0] == nx else min(i, nx - i)
        s, g = spectrum[i], symbol[j]
        total = 0.0
        for k in range(columns):
            re, im = float(s[k].real), float(s[k].imag)
            total += (re * re + im * im) * g[k]
        edges = (float(s[0].real) ** 2 + float(s[0].imag) ** 2) * g[0]
        if ny % 2 == 0 and columns > 1:
            last = columns - 1
            edges += (float(s[last].real) ** 2 + float(s[last].imag) ** 2) * g[last]
        part[i, 0] = 2.0 * total - edges


@kernel(**_OPTIONS)
def multiply(lo, hi, spectrum, symbol):
    """spectrum *= symbol, in place. Symbols even in the first wave number may come with half the rows."""
    nx, columns = spectrum.shape
    for i in range(lo, hi):
        j = i if symbol.shape[0] == nx else min(i, nx - i)
        s, g = spectrum[i], symbol[j]
        for k in range(columns):
            s[k] = s[k] * g[k]


@kernel(**_OPTIONS)
def multiply_packed(lo, hi, z, symbol, turn):
    """The spectrum of a real array times a symbol, both of them packed: in place, rows lo … hi of 0 … nx//2 and -lo …

    z (nx, m) is the transform of x[:, 0::2] + i x[:, 1::2] of a real x (nx, 2m), turn[l] = exp(-2πi·l/2m). With
    even = (z(k, l) + z*(-k, -l))/2 and odd = (z(k, l) - z*(-k, -l))/2i the spectrum of x is even + turn·odd at l and
    even - turn·odd at l + m. Both are multiplied and packed again. The symbol is that of ``multiply``; the one at
    l + m is the one at (-k, m - l).
    """
    nx, m = z.shape
    quarter = z.real.dtype.type(0.25)
    for k in range(lo, hi):
        j = (nx - k) % nx
        here, there = z[k], z[j]
        g = symbol[k]
        back = symbol[j if symbol.shape[0] == nx else k]
        for i in range(m if k != j else m // 2 + 1):
            o = m - i if i > 0 else 0
            a, b = here[i], there[o]
            even_re, even_im = a.real + b.real, a.imag - b.imag
            odd_re, odd_im = a.imag + b.imag, b.real - a.real
            mean, half = (
                quarter * (g[i] + back[m - i]),
                quarter * (g[i] - back[m - i]),
            )
            w = turn[i]
            new_re = mean * even_re + half * (w.real * odd_re - w.imag * odd_im)
            new_im = mean * even_im + half * (w.real * odd_im + w.imag * odd_re)
            other_re = mean * odd_re + half * (w.real * even_re + w.imag * even_im)
            other_im = mean * odd_im + half * (w.real * even_im - w.imag * even_re)
            here[i] = complex(new_re - other_im, new_im + other_re)
            there[o] = complex(new_re + other_im, other_re - new_im)


@kernel(**_OPTIONS)
def resample_pressure(lo, hi, source, rows, columns, hardness, target):
    """As ``resample``, but zero where pixels without pressure make up more than half of the interpolation weights, and
    the hardness where pixels that yield do.

    Bilinear interpolation alone would widen every patch by up to a coarse pixel.
    """
    j0, j1, wj = columns.lower, columns.upper, columns.weight
    for i in range(lo, hi):
        a, b = source[rows.lower[i]], source[rows.upper[i]]
        w = rows.weight[i]
        for j in range(target.shape[1]):
            p00, p01, p10, p11 = a[j0[j]], a[j1[j]], b[j0[j]], b[j1[j]]
            u = wj[j]
            value = (1.0 - w) * ((1.0 - u) * p00 + u * p01) + w * (
                (1.0 - u) * p10 + u * p11
            )
            inside = (1.0 - w) * ((1.0 - u) * (p00 > 0) + u * (p01 > 0)) + w * (
                (1.0 - u) * (p10 > 0) + u * (p11 > 0)
            )
            if hardness is not None:
                full = (1.0 - w) * (
                    (1.0 - u) * (p00 >= hardness) + u * (p01 >= hardness)
                ) + w * ((1.0 - u) * (p10 >= hardness) + u * (p11 >= hardness))
                value = hardness if full >= 0.5 else min(value, hardness)
            target[i, j] = value if inside >= 0.5 else 0.0


@kernel(**_OPTIONS)
def resample(lo, hi, source, rows, columns, target):
    """Bilinear resampling, rows lo … hi of target, from the interpolation along ``rows`` and along ``columns``."""
    j0, j1, wj = columns.lower, columns.upper, columns.weight
    for i in range(lo, hi):
        a, b = source[rows.lower[i]], source[rows.upper[i]]
        w = rows.weight[i]
        for j in range(target.shape[1]):
            left = (1.0 - w) * a[j0[j]] + w * b[j0[j]]
            right = (1.0 - w) * a[j1[j]] + w * b[j1[j]]
            target[i, j] = left + wj[j] * (right - left)


@kernel(**_OPTIONS)
def restrict(lo, hi, blocks, x, rows, columns, coarse):
    """Rows lo … hi of coarse = Pᵀ x, P the interpolation along ``rows`` and ``columns``; periodic.

    x must be zero in blocks that are not active. Reads the active part of x twice.
    """
    nx, ny = x.shape
    size = coarse.shape[0]
    width, per_row, active = blocks.width, blocks.per_row, blocks.active
    column = np.zeros(ny + 2 * REACH, x.dtype)  # with a halo
    for row in range(lo, hi):
        column[:] = 0
        touched = False
        # fine rows strictly between the coarse rows before and behind this one: ceil((row - 1)·nx/size) …
        first = -(((1 - row) * nx) // size)
        last = -((-(row + 1) * nx) // size)
        for k in range(first, last):
            i = k % nx
            weight = rows.weight[i]
            if rows.lower[i] == row:
                weight = x.dtype.type(1) - weight
            for s in range(per_row):
                if active[i * per_row + s]:
                    start = s * width
                    stop = min(ny, start + width)
                    xb, cb = x[i, start:stop], column[REACH + start : REACH + stop]
                    for j in range(xb.size):
                        cb[j] += weight * xb[j]
                    touched = True
        out = coarse[row]
        if not touched:
            out[:] = 0
            continue
        column[:REACH] = column[ny : ny + REACH]
        column[ny + REACH :] = column[REACH : 2 * REACH]
        begin = _U(0)
        while begin < _U(out.size):
            end = columns.straight[begin]
            offset = columns.begin[begin] + _U(REACH) - _U(RATIO) * begin
            for k in range(begin, end):
                at = offset + _U(RATIO) * k
                total = columns.even[0, k] * column[at]
                for a in range(1, REACH + 1):
                    before, behind = column[at - _U(a)], column[at + _U(a)]
                    total += columns.even[a, k] * (before + behind)
                    total += columns.odd[a, k] * (behind - before)
                out[k] = total
            begin = end


# ``local`` and its helpers take their indices as unsigned integers: a signed one might count from the end of an array,
# and the test for that keeps a loop out of vector registers. They take whole arrays, because every slice that ``local``
# would make of one costs an atomic reference count, as does every tuple of arrays.


@kernel(**_OPTIONS)
def _interpolate(coarse, row, columns, first, last, start, fine, f):
    """fine[f, REACH …] = a row of coarse interpolated between its pixels first … last, from column ``start`` on. Each
    writes ``RATIO`` columns; where there are fewer before the next one, that overwrites the rest."""
    while first < last:
        end = min(columns.straight[first], last)
        offset = columns.begin[first] + _U(REACH) - start - _U(RATIO) * first
        after = _U(1) if end < _U(coarse.shape[1]) else _U(0) - first
        for k in range(first, end):
            value = coarse[row, k]
            slope = (coarse[row, k + after] - value) * columns.step
            value += columns.shift[k] * slope
            for a in range(RATIO):
                to = offset + _U(RATIO) * k + _U(a)
                fine[f, to] = value + fine.dtype.type(a) * slope
        first = end


@kernel(**_OPTIONS)
def _pair_rows(x, above, below, first, count, sums, to):
    """sums[to …] = x[above] + x[below], ``count`` columns from ``first`` on."""
    for j in range(count):
        sums[to + j] = x[above, first + j] + x[below, first + j]


@kernel(**_OPTIONS)
def _stencil_columns(sums, weights, count):
    """The stencil along columns. Lines 0 … 4 of ``sums``, each ``LINE`` long, are the sums of two rows 0 … 4 away
    before, and the sums over the rows of the stencil for columns 0 … 4 away afterwards. Weights more than ``REACH`` +
    0.3 away are zero."""
    half = weights.dtype.type(0.5)  # row 0 was added to itself
    a0 = half * weights[0, 0]
    a1 = half * weights[0, 1]
    a2 = half * weights[0, 2]
    a3 = half * weights[0, 3]
    a4 = half * weights[0, 4]
    b0 = weights[1, 0]
    b1 = weights[1, 1]
    b2 = weights[1, 2]
    b3 = weights[1, 3]
    b4 = weights[1, 4]
    c0, c1, c2, c3 = weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3]
    d0, d1, d2, d3 = weights[3, 0], weights[3, 1], weights[3, 2], weights[3, 3]
    e0, e1 = weights[4, 0], weights[4, 1]
    for j in range(count):
        x0, x1, x2 = sums[j], sums[_U(LINE) + j], sums[_U(2 * LINE) + j]
        x3, x4 = sums[_U(3 * LINE) + j], sums[_U(4 * LINE) + j]
        sums[j] = a0 * x0 + b0 * x1 + c0 * x2 + d0 * x3 + e0 * x4
        sums[_U(LINE) + j] = a1 * x0 + b1 * x1 + c1 * x2 + d1 * x3 + e1 * x4
        sums[_U(2 * LINE) + j] = a2 * x0 + b2 * x1 + c2 * x2 + d2 * x3
        sums[_U(3 * LINE) + j] = a3 * x0 + b3 * x1 + c3 * x2 + d3 * x3
        sums[_U(4 * LINE) + j] = a4 * x0 + b4 * x1


@kernel(**_OPTIONS)
def _stencil_rows(sums, fine, lower, upper, weight, x, out, row, first, count):
    """out = the stencil along rows, from the lines of ``sums``, plus the row that is interpolated from
    fine[lower] to fine[upper]. Returns Σ x·out."""
    for j in range(count):
        value = fine[lower, _U(REACH) + j]
        value += weight * (fine[upper, _U(REACH) + j] - value)
        out[row, first + j] = value + (
            sums[_U(4) + j]
            + (sums[_U(LINE + 3) + j] + sums[_U(LINE + 5) + j])
            + (sums[_U(2 * LINE + 2) + j] + sums[_U(2 * LINE + 6) + j])
            + (sums[_U(3 * LINE + 1) + j] + sums[_U(3 * LINE + 7) + j])
            + (sums[_U(4 * LINE) + j] + sums[_U(4 * LINE + 8) + j])
        )
    product = 0.0  # a loop of its own: sums in double precision would halve the vectors of the one above
    for j in range(count):
        product += float(x[row, first + j]) * float(out[row, first + j])
    return product


@kernel(**_OPTIONS)
def local(lo, hi, blocks, x, stencil, coarse, rows, columns, out, part):
    """out = stencil * x + coarse interpolated along ``rows`` and ``columns``, in active blocks of rows lo … hi; periodic.
    part[b] = Σ x·out.

    ``stencil[a, b]`` is the weight of the up to four neighbours at distances (a, b) ≤ REACH. x must be zero in blocks
    that are not active. Reads 2·REACH + 1 rows of x, which stay in cache; writes out once. Sums along columns are made
    first and then added along rows, which needs a third of the loads of one pass over all pixels of the stencil.
    """
    nx, ny = x.shape
    per_row = blocks.per_row
    sums = np.zeros((REACH + 1) * LINE, x.dtype)
    fine = np.zeros((per_row * 2, blocks.width + 2 * REACH), x.dtype)
    # coarse row that each line of ``fine`` was interpolated from: the odd and even ones take turns, block by block
    ready = np.full((per_row, 2), -1)
    for row in range(lo, hi):
        base = np.int64(rows.lower[row])
        for s in range(per_row):
            b = row * per_row + s
            part[b, 0] = 0.0
            if not blocks.active[b]:
                continue
            _, start, stop = _block(blocks, b, ny)
            n = stop - start
            for needed in range(base, base + 2):
                f = needed & 1
                if ready[s, f] != needed:
                    ready[s, f] = needed
                    source = _U(needed % coarse.shape[0])
                    first = _U(start * coarse.shape[1] // ny)
                    last = _U((stop - 1) * coarse.shape[1] // ny + 1)
                    _interpolate(
                        coarse,
                        source,
                        columns,
                        first,
                        last,
                        _U(start),
                        fine,
                        _U(2 * s + f),
                    )
            left = REACH if start > 0 else 0
            right = REACH if stop < ny else 0
            for a in range(REACH + 1):
                above, below, line = (
                    _U((row - a) % nx),
                    _U((row + a) % nx),
                    a * LINE,
                )
                _pair_rows(
                    x,
                    above,
                    below,
                    _U(start - left),
                    _U(left + n + right),
                    sums,
                    _U(line + REACH - left),
                )
                if left == 0:
                    _pair_rows(
                        x, above, below, _U(ny - REACH), _U(REACH), sums, _U(line)
                    )
                if right == 0:
                    _pair_rows(
                        x,
                        above,
                        below,
                        _U(0),
                        _U(REACH),
                        sums,
                        _U(line + REACH + n),
                    )
            _stencil_columns(sums, stencil, _U(n + 2 * REACH))
            lower = _U(2 * s + (base & 1))
            part[b, 0] = _stencil_rows(
                sums,
                fine,
                lower,
                lower ^ _U(1),
                rows.weight[row],
                x,
                out,
                _U(row),
                _U(start),
                _U(n),
            )
