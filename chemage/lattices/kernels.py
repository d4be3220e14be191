"""Kernels that place the sites of a contact below its pixels, and that check a reaction graph.

They are compiled by numba and know nothing of the framework.

Pixels are addressed by their flat index; `place` gives the position of a pixel among those that were listed (in
contact, or at most two pixels away), and -1 for all others: what is computed is stored for the listed ones only.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.kernels import kernel

compiled = kernel(nogil=True)

#: the rim is this part of the way from a pixel outside to its neighbour in contact, at most
FURTHEST = 0.95
#: smallest cosine between the normal of the rim and the line between two pixels
SMALLEST_COSINE = 0.3
#: from a pixel to itself and its eight neighbours
STEPS = tuple((di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1))


@compiled
def _at(i, j, nx, ny, periodic):  # pragma: no cover - compiled
    """Flat index of pixel (i, j), wrapped where periodic; -1 outside the grid."""
    if periodic:
        return (i % nx) * ny + j % ny
    if i < 0 or j < 0 or i >= nx or j >= ny:
        return -1
    return i * ny + j


@compiled
def _near(i, j, nx, ny, periodic):  # pragma: no cover - compiled
    """As `_at`; outside a free grid the nearest pixel."""
    if periodic:
        return (i % nx) * ny + j % ny
    return min(max(i, 0), nx - 1) * ny + min(max(j, 0), ny - 1)


@compiled
def around(pixels, place, nx, ny, periodic):  # pragma: no cover - compiled
    """The neighbours (of eight) of `pixels` that are not listed yet, which `place` is -1 for; it becomes -2."""
    found = np.empty(8 * pixels.size, np.int64)
    count = 0
    for at in pixels:
        for di, dj in STEPS:
            other = _at(at // ny + di, at % ny + dj, nx, ny, periodic)
            if other >= 0 and place[other] == -1:
                place[other] = -2
                found[count] = other
                count += 1
    return found[:count].copy()


@compiled
def _way(ratio):  # pragma: no cover - compiled
    """x in (0, 1) with x³/(1 − x) = ratio, at most `FURTHEST`."""
    low, high = 0.0, FURTHEST
    if high * high * high <= ratio * (1.0 - high):
        return high
    for _ in range(30):
        x = 0.5 * (low + high)
        if x * x * x < ratio * (1.0 - x):
            low = x
        else:
            high = x
    return 0.5 * (low + high)


@compiled
def _slope(i, j, nx, ny, periodic, place, level):  # pragma: no cover - compiled
    """Direction in which the level rises at a pixel, from its eight neighbours; (0, 0) where it has none."""
    gx, gy = 0.0, 0.0
    for di, dj in STEPS:
        at = place[_near(i + di, j + dj, nx, ny, periodic)]
        if at >= 0:
            gx += di * (2 - abs(dj)) * level[at]
            gy += dj * (2 - abs(di)) * level[at]
    length = math.sqrt(gx * gx + gy * gy)
    if length == 0.0:
        return 0.0, 0.0
    return gx / length, gy / length


@compiled
def rim(
    pixels, bounds, place, opening, level, nx, ny, periodic, passes
):  # pragma: no cover - compiled
    """The level of the pixels outside, negative, from their gap and the pressure of their neighbours in contact.

    pixels : flat indices; the first `bounds[0]` are in contact, up to `bounds[1]` touch one of these, the rest one of
        those. level : squared pressure of the first, and what is computed here for the others, in place.
    opening : ¾ E* gap over a pixel, in units of the pressure; below zero: not known, the rim is then halfway.

    Between a pixel in contact, p² = B² (1 − x) d, and one outside, ¾ E* gap = B (x d)^{3/2}, the rim is at the part x
    of the distance d between them along its normal, x³/(1 − x) = (¾ E* gap / p d)². In the first pass the normal is
    along the line between them, then along the slope of the level.
    """
    # B², d in pixels; and new levels, which must not enter the slopes of the same pass
    strength, fresh = np.zeros(bounds[1]), np.zeros(bounds[1])
    for turn in range(passes):
        for k in range(bounds[0], bounds[1]):
            i, j = pixels[k] // ny, pixels[k] % ny
            sx, sy = 0.0, 0.0
            if turn > 0:
                sx, sy = _slope(i, j, nx, ny, periodic, place, level)
            total, squares, weights = 0.0, 0.0, 0.0
            for di, dj in STEPS:
                other = _at(i + di, j + dj, nx, ny, periodic)
                if other < 0 or place[other] >= bounds[0] or place[other] < 0:
                    continue
                inside = level[place[other]]
                length = math.sqrt(float(di * di + dj * dj))
                cosine = 1.0
                if sx != 0.0 or sy != 0.0:
                    cosine = max((di * sx + dj * sy) / length, SMALLEST_COSINE)
                d = length * cosine
                x = 0.5
                if opening[k] >= 0.0 and inside > 0.0:
                    x = _way(min((opening[k] / d) ** 2 / inside, 1e300))
                weight = (cosine / length) ** 2
                square = inside / ((1.0 - x) * d)
                total += weight * square * x * d
                squares += weight * square
                weights += weight
            strength[k] = squares / weights
            fresh[k] = -total / weights
        level[bounds[0] : bounds[1]] = fresh[bounds[0] :]
        for k in range(bounds[1], bounds[2]):
            i, j = pixels[k] // ny, pixels[k] % ny
            squares, count = 0.0, 0
            for di, dj in STEPS:
                other = _at(i + di, j + dj, nx, ny, periodic)
                if other >= 0 and bounds[0] <= place[other] < bounds[1]:
                    squares += strength[place[other]]
                    count += 1
            square = squares / count
            if opening[k] >= 0.0:
                level[k] = -((square * opening[k]) ** (2.0 / 3.0))
            else:
                level[k] = -1.5 * square


@compiled
def _first(cell, sites, pixels, offset):  # pragma: no cover - compiled
    """The first site at or behind node `cell`, where site s lies at (2 s pixels + offset)/(2 sites)."""
    return -((offset - 2 * cell * sites) // (2 * pixels))


@compiled
def _weights(t, values, slopes):  # pragma: no cover - compiled
    """Cubic convolution (Catmull-Rom) of four nodes at the fraction t between the middle ones, and its slope."""
    values[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    values[1] = (1.5 * t - 2.5) * t * t + 1.0
    values[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    values[3] = (0.5 * t - 0.5) * t * t
    slopes[0] = (-1.5 * t + 2.0) * t - 0.5
    slopes[1] = (4.5 * t - 5.0) * t
    slopes[2] = (-4.5 * t + 4.0) * t + 0.5
    slopes[3] = (1.5 * t - 1.0) * t


@compiled
def _touched(
    i, place, inside, grid, periodic, active
):  # pragma: no cover - compiled
    """Mark the cells between the rows of pixels i and i + 1 that have a pixel in contact; whether there is any."""
    nx, ny = grid
    first = 0 if periodic else -1
    found = False
    before = False
    for j in range(first, ny + 1):
        now = False
        for di in range(2):
            at = place[_near(i + di, j, nx, ny, periodic)]
            now = now or (0 <= at < inside)
        if j > first:
            active[j - 1 - first] = now or before
            found = found or now or before
        before = now
    return found


@compiled
def most_sites(place, inside, grid, sites, periodic):  # pragma: no cover - compiled
    """How many sites lie in cells between pixels of which one is in contact."""
    nx, ny = grid
    mx, my = sites
    ox, oy = (0, 0) if periodic else (nx - mx, ny - my)
    first = 0 if periodic else -1
    active = np.zeros(ny + 1, np.bool_)
    count = 0
    for i in range(first, nx):
        rows = min(_first(i + 1, mx, nx, ox), mx) - max(_first(i, mx, nx, ox), 0)
        if rows > 0 and _touched(i, place, inside, grid, periodic, active):
            for j in range(first, ny):
                if active[j - first]:
                    columns = min(_first(j + 1, my, ny, oy), my) - max(
                        _first(j, my, ny, oy), 0
                    )
                    count += rows * max(columns, 0)
    return count


@compiled
def place_sites(
    place, inside, level, grid, sites, periodic, shift, out, values
):  # pragma: no cover - compiled
    """Sites with a positive level, ascending: their number; flat index and pressure are written into `out`, `values`.

    The level at a site is interpolated by cubic convolution, and lowered by `shift` times its slope per pixel, which
    moves the rim inwards by that many pixels. Only cells between pixels of which one is in contact are visited.
    """
    nx, ny = grid
    mx, my = sites
    ox, oy = (0, 0) if periodic else (nx - mx, ny - my)
    first = 0 if periodic else -1
    active = np.zeros(ny + 1, np.bool_)
    z = np.empty((4, 4))
    wx, wy, vx, vy = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    count = 0
    for i in range(first, nx):
        if not _touched(i, place, inside, grid, periodic, active):
            continue
        for row in range(
            max(_first(i, mx, nx, ox), 0), min(_first(i + 1, mx, nx, ox), mx)
        ):
            _weights((2 * row * nx + ox - 2 * i * mx) / (2.0 * mx), wx, vx)
            for j in range(first, ny):
                if not active[j - first]:
                    continue
                begin = max(_first(j, my, ny, oy), 0)
                end = min(_first(j + 1, my, ny, oy), my)
                if begin >= end:
                    continue
                for k in range(4):
                    for m in range(4):
                        z[k, m] = level[
                            place[_near(i + k - 1, j + m - 1, nx, ny, periodic)]
                        ]
                for column in range(begin, end):
                    _weights(
                        (2 * column * ny + oy - 2 * j * my) / (2.0 * my), wy, vy
                    )
                    f, fx, fy = 0.0, 0.0, 0.0
                    for k in range(4):
                        for m in range(4):
                            f += wx[k] * wy[m] * z[k, m]
                            fx += vx[k] * wy[m] * z[k, m]
                            fy += wx[k] * vy[m] * z[k, m]
                    f -= shift * math.sqrt(fx * fx + fy * fy)
                    if f > 0.0:
                        out[count] = row * my + column
                        values[count] = math.sqrt(f)
                        count += 1
    return count


@compiled
def _cell(site, sites, pixels, offset):  # pragma: no cover - compiled
    """The node before a site, and the fraction of a pixel between them."""
    at = 2 * site * pixels + offset
    cell = at // (2 * sites)
    return cell, (at - 2 * cell * sites) / (2.0 * sites)


@compiled
def _parts(pixels, sites, offset):  # pragma: no cover - compiled
    """How many sites belong to each pixel along a side, each divided between its two nodes."""
    parts = np.zeros(pixels)
    for site in range(sites):
        cell, t = _cell(site, sites, pixels, offset)
        if offset == 0:
            parts[cell % pixels] += 1.0 - t
            parts[(cell + 1) % pixels] += t
        else:
            parts[max(cell, 0)] += 1.0 - t
            parts[min(cell + 1, pixels - 1)] += t
    return parts


@compiled
def balance(
    place, pixels, load, grid, sites, periodic, index, values
):  # pragma: no cover - compiled
    """Scale the pressures of sites, in place, so that in each neighbourhood of 3 x 3 pixels they carry the load there.

    load : pressure of each listed pixel, in units of `values`. The factor is between ½ and 2 and interpolated linearly.
    """
    nx, ny = grid
    mx, my = sites
    ox, oy = (0, 0) if periodic else (nx - mx, ny - my)
    across, along = _parts(nx, mx, ox), _parts(ny, my, oy)
    carried = np.zeros(pixels.size)
    factor = np.ones(pixels.size)
    for turn in range(2):
        for s in range(index.size):
            i, t = _cell(index[s] // my, mx, nx, ox)
            j, u = _cell(index[s] % my, my, ny, oy)
            scale = 0.0
            for di in range(2):
                for dj in range(2):
                    weight = (t if di else 1.0 - t) * (u if dj else 1.0 - u)
                    at = place[_near(i + di, j + dj, nx, ny, periodic)]
                    if turn == 0:
                        carried[at] += weight * values[s]
                    else:
                        scale += weight * factor[at]
            if turn:
                values[s] *= scale
        if turn:
            break
        for k in range(pixels.size):
            wanted, found = 0.0, 0.0
            for di, dj in STEPS:
                other = _at(
                    pixels[k] // ny + di, pixels[k] % ny + dj, nx, ny, periodic
                )
                if other >= 0 and place[other] >= 0:
                    wanted += load[place[other]]
                    # how many sites belong to a pixel changes from one to the next
                    found += carried[place[other]] / (
                        across[other // ny] * along[other % ny]
                    )
            if found > 0.0:
                factor[k] = min(max(wanted / found, 0.5), 2.0)


@compiled
def overlaps(
    pixels, pressure, grid, sites, periodic, index, share, carried
):  # pragma: no cover - compiled
    """The share of each site that each pixel in contact covers, and its part of the site's mean pressure: their number.

    Sites are larger than pixels, so that a pixel covers parts of at most four. In units of half a pixel over `sites`,
    all limits are whole numbers.
    """
    nx, ny = grid
    mx, my = sites
    e = 1 if periodic else 0
    count = 0
    for k in range(pixels.size):
        i, j = pixels[k] // ny, pixels[k] % ny
        x, y = (2 * i - e) * mx, (2 * j - e) * my
        row, column = (x + e * nx) // (2 * nx), (y + e * ny) // (2 * ny)
        for di in range(2):
            low, high = (2 * (row + di) - e) * nx, (2 * (row + di + 1) - e) * nx
            width = min(x + 2 * mx, high) - max(x, low)
            if width <= 0:
                continue
            for dj in range(2):
                below = (2 * (column + dj) - e) * ny
                above = (2 * (column + dj + 1) - e) * ny
                height = min(y + 2 * my, above) - max(y, below)
                if height <= 0:
                    continue
                index[count] = ((row + di) % mx) * my + (column + dj) % my
                share[count] = (width / (2.0 * nx)) * (height / (2.0 * ny))
                carried[count] = share[count] * pressure[k]
                count += 1
    return count


@compiled
def find_fault(neighbours, coupling):  # pragma: no cover - compiled
    """First fault of a graph as (fault, site, slot): 0 none, 1 out of range, 2 own neighbour, 3 listed twice,
    4 listed from one end only, 5 two different energies. ``neighbours`` (n, k) int32, ``coupling`` (n, k) eV."""
    n, k = neighbours.shape
    # the last site that listed each site, and where that was found in its row: rows that ascend are searched from there
    listed, found = np.full(n, -1), np.zeros(n, np.int64)
    for i in range(n):
        for s in range(k):
            j = neighbours[i, s]
            if j == -1:
                continue
            if j < -1 or j >= n:
                return 1, i, s
            if j == i:
                return 2, i, s
            if listed[j] == i:
                return 3, i, s
            listed[j] = i
            back = found[j]
            for _ in range(k):
                if neighbours[j, back] == i:
                    break
                back = (back + 1) % k
            if neighbours[j, back] != i:
                return 4, i, s
            if coupling[j, back] != coupling[i, s]:
                return 5, i, s
            found[j] = back
    return 0, 0, 0
