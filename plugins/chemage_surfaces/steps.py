"""The steps from an image to a surface, as plain functions of arrays: heights (nx, ny) in nm, nan where they are
missing; lengths in nm. Scan lines run along x, the first index."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chemage.plugin import roughness
from chemage_surfaces._maps import Floats

#: more unknown heights than this are found by iteration instead of by elimination
MOST_ELIMINATED = 50_000
#: groups of pixels with more of the image than this are part of the surface
MOST_CUT_OFF = 0.1


def cropped(
    heights: Floats,
    pixel_size: tuple[float, float],
    window: tuple[float, float, float, float],
) -> tuple[Floats, list[int]]:
    """The part (x, y, width, height) of an image, to whole pixels; and [first x, first y, pixels x, pixels y].

    Raises
    ------
    ValueError
        The window leaves the image.
    """
    taken = []
    for axis, name in enumerate("xy"):
        start, size, side = window[axis], window[axis + 2], pixel_size[axis]
        first, count = round(start / side), round(size / side)
        length = heights.shape[axis] * side
        if first + count > heights.shape[axis]:
            raise ValueError(
                f"{start:g} to {start + size:g} nm along {name}, but the image ends at {length:g} nm; "
                "give a part inside it"
            )
        if count < 1:
            raise ValueError(
                f"{size:g} nm along {name} is less than a pixel of {side:g} nm; give more"
            )
        taken.append((first, count))
    (ix, nx), (iy, ny) = taken
    return np.ascontiguousarray(heights[ix : ix + nx, iy : iy + ny]), [
        ix,
        iy,
        nx,
        ny,
    ]


def find_spikes(
    heights: Floats, threshold: float, periodic: bool
) -> NDArray[np.bool_]:
    """Pixels that differ from the median of the 5 x 5 pixels around them by more than ``threshold`` times the robust
    standard deviation (1.4826 times the median) of such differences, but at least 1 % of the standard deviation of the
    medians, and by more than twice the range of the medians around them.

    Features of up to 12 pixels are found; edges of steps and smooth peaks are no spikes.
    """
    from scipy import ndimage

    there = np.isfinite(heights)
    whole = heights
    if not there.all():
        nearest = ndimage.distance_transform_edt(
            ~there, return_distances=False, return_indices=True
        )
        whole = heights[tuple(nearest)]  # pyright: ignore[reportArgumentType]
    # a slope goes on beyond the edges, where it would otherwise look like a feature
    padded = (
        np.pad(whole, 2, mode="wrap")
        if periodic
        else np.pad(whole, 2, mode="reflect", reflect_type="odd")
    )
    median = ndimage.median_filter(padded, size=5)
    local = (
        ndimage.maximum_filter(median, size=5)
        - ndimage.minimum_filter(median, size=5)
    )[2:-2, 2:-2]
    smooth = median[2:-2, 2:-2]
    away = np.abs(whole - smooth)
    scale = max(1.4826 * float(np.median(away[there])), 0.01 * float(smooth.std()))
    # rounding of a flat image far from zero is no spike
    scale = max(scale, 1e-12 * float(np.abs(whole).max()))
    return there & (away > threshold * scale) & (away > 2 * local)


def find_groups(heights: Floats, threshold: float) -> NDArray[np.bool_]:
    """Groups of pixels that only steps of more than ``threshold`` robust standard deviations of the steps between pixels
    connect to the others; none where they are a tenth of all, as terraces are."""
    from scipy import ndimage, sparse
    from scipy.sparse import csgraph

    none = np.zeros(heights.shape, dtype=bool)
    joined = []
    for axis in (0, 1):
        steps = np.diff(heights, axis=axis)
        away = np.abs(steps - np.median(steps))
        scale = 1.4826 * float(np.median(away))
        # of an image without noise
        scale = max(scale, 0.01 * float(heights.std()), 1e-300)
        joined.append(away <= threshold * scale)
    if joined[0].all() and joined[1].all():
        return none
    number = np.arange(heights.size).reshape(heights.shape)
    ends = [
        np.concatenate([number[:-1][joined[0]], number[:, :-1][joined[1]]]),
        np.concatenate([number[1:][joined[0]], number[:, 1:][joined[1]]]),
    ]
    graph = sparse.coo_array(
        (np.ones(len(ends[0]), dtype=bool), (ends[0], ends[1])),
        shape=(heights.size, heights.size),
    )
    _, label = csgraph.connected_components(graph, directed=False)
    surface = (label == np.bincount(label).argmax()).reshape(heights.shape)
    groups = ~surface
    # terraces and gratings have steps, and are surfaces
    if groups.mean() > MOST_CUT_OFF:
        return none
    # pixels inside that happen to join
    inside: Any = ndimage.binary_fill_holes(groups)
    return inside


def line_offsets(heights: Floats, degree: int | None) -> Floats:
    """What to subtract from each scan line so that it fits to the others, (nx, ny).

    With a ``degree`` it is the polynomial of least absolute deviation, then that of least squares through the points
    within three robust standard deviations; without, the sum of the medians of the differences from line to line. A
    feature on less than half of a line changes neither.
    """
    nx, ny = heights.shape
    if degree is None:
        there = np.isfinite(heights)
        both = there[:, 1:] & there[:, :-1]
        steps = np.zeros(ny - 1)
        some = both.any(axis=0)
        differences = np.where(
            both, np.diff(np.where(there, heights, 0.0), axis=1), np.nan
        )
        steps[some] = np.nanmedian(differences[:, some], axis=0)
        offset = np.concatenate([[0.0], np.cumsum(steps)])
        return np.broadcast_to(offset - offset.mean(), heights.shape)
    basis = _polynomials(nx, degree)
    result = np.zeros(heights.shape)
    for j in range(ny):
        there = np.isfinite(heights[:, j])
        if there.sum() > degree:
            result[:, j] = _robust(basis[:, there].T, heights[there, j]) @ basis
    return result


def _robust(basis: Floats, values: Floats) -> Floats:
    """Coefficients of the least absolute deviation, then of least squares through the points near it."""
    weight = np.ones(len(values))
    least = 1e-9 * float(np.ptp(values)) + 1e-300
    fit: Any = np.zeros(basis.shape[1])
    for _ in range(30):
        fit = np.linalg.lstsq(basis * weight[:, None], values * weight, rcond=None)[
            0
        ]
        weight = 1 / np.sqrt(np.maximum(np.abs(values - basis @ fit), least))
    used = np.ones(len(values), dtype=bool)
    for _ in range(10):
        away = np.abs(values - basis @ fit)
        near = away <= 3 * 1.4826 * float(np.median(away[used])) + least
        if near.sum() <= basis.shape[1] or (near == used).all():
            break
        used = near
        fit = np.linalg.lstsq(basis[used], values[used], rcond=None)[0]
    return fit


#: scars: widest in lines, shortest in pixels along the line, and their height in robust standard deviations of the
#: difference from line to line
SCAR_LINES, SCAR_PIXELS, SCAR_HEIGHT = 3, 12, 4.0


def find_scars(heights: Floats) -> NDArray[np.bool_]:
    """Pixels of scars: stretches of one to three scan lines that lie above, or below, the lines on both sides over at
    least 12 pixels, by more than four robust standard deviations of the differences between neighbouring lines."""
    from scipy import ndimage

    found = np.zeros(heights.shape, dtype=bool)
    differences = np.diff(heights, axis=1)
    there = np.isfinite(differences)
    if not there.any():
        return found
    middle = float(np.median(differences[there]))
    height = (
        SCAR_HEIGHT * 1.4826 * float(np.median(np.abs(differences[there] - middle)))
    )
    whole = np.where(np.isfinite(heights), heights, np.nan)
    along = np.ones((SCAR_PIXELS, 1))
    for width in range(1, min(SCAR_LINES, heights.shape[1] - 2) + 1):
        inside = np.lib.stride_tricks.sliding_window_view(
            whole[:, 1:-1], width, axis=1
        )
        before, after = whole[:, : inside.shape[1]], whole[:, width + 1 :]
        for sign in (1.0, -1.0):
            low = (sign * inside).min(axis=2)
            out = (low - sign * before > height) & (low - sign * after > height)
            out: Any = ndimage.binary_opening(out, structure=along)
            for k in range(width):
                found[:, 1 + k : 1 + k + out.shape[1]] |= out
    return found


def filled(heights: Floats, periodic: bool) -> Floats:
    """Missing heights by harmonic interpolation: each is the mean of its four neighbours, so that no new maximum or
    minimum arises (discrete Laplace equation with the known heights as boundary values)."""
    from scipy import sparse
    from scipy.sparse import linalg

    missing = ~np.isfinite(heights)
    count = int(missing.sum())
    if not count:
        return heights
    nx, ny = heights.shape
    number = np.full(heights.shape, -1)
    number[missing] = np.arange(count)
    x, y = np.nonzero(missing)
    here = number[x, y]
    degree, around = np.zeros(count), np.zeros(count)
    rows, columns = [], []
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        i, j = x + dx, y + dy
        inside = (
            np.ones(count, bool)
            if periodic
            else (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        )
        i, j = i % nx, j % ny
        degree += inside
        other = inside & missing[i, j]
        rows.append(here[other])
        columns.append(number[i[other], j[other]])
        boundary = inside & ~missing[i, j]
        around[boundary] += heights[i[boundary], j[boundary]]
    row, column = np.concatenate(rows), np.concatenate(columns)
    matrix: Any = sparse.csc_matrix(
        (-np.ones(row.size), (row, column)), shape=(count, count)
    )
    matrix = (matrix + sparse.diags(degree)).tocsc()
    if count <= MOST_ELIMINATED:
        solution: Any = linalg.spsolve(matrix, around)
    else:
        from scipy import ndimage

        nearest = ndimage.distance_transform_edt(
            missing, return_distances=False, return_indices=True
        )
        start = heights[tuple(nearest)][missing]  # pyright: ignore[reportArgumentType]
        # heights about their mean, so that the tolerance is one of the roughness
        level = float(start.mean())
        solution, failed = linalg.cg(
            matrix,
            around - matrix @ np.full(count, level),
            x0=start - level,
            rtol=1e-8,
        )
        if failed:
            raise ValueError(
                f"{count} missing heights cannot be interpolated; crop the image"
            )
        solution = solution + level
    result = heights.copy()
    result[missing] = solution
    return result


def trend(heights: Floats, degree: int) -> Floats:
    """The least-squares polynomial in x and y of total degree ``degree`` (0 mean, 1 plane, 2 paraboloid) through the
    heights that are there."""
    across, along = (_polynomials(count, degree) for count in heights.shape)
    there = np.isfinite(heights)
    if not there.all():
        pairs = [
            (i, j)
            for i in range(len(across))
            for j in range(len(along))
            if i + j <= degree
        ]
        known = np.where(there, heights, 0.0)
        right = np.array([across[i] @ known @ along[j] for i, j in pairs])
        normal = [
            [
                (across[i] * across[k]) @ there @ (along[j] * along[m])
                for k, m in pairs
            ]
            for i, j in pairs
        ]
        found: Any = np.linalg.lstsq(np.array(normal), right, rcond=1e-12)[0]
        part = np.zeros((len(across), len(along)))
        part[tuple(np.transpose(pairs))] = found
        return across.T @ part @ along
    # on a full grid products of discrete orthogonal polynomials are orthogonal: each is a separate projection
    part = across @ heights @ along.T
    i, j = np.indices(part.shape)
    part[i + j > degree] = 0.0
    return across.T @ part @ along


def _polynomials(count: int, degree: int) -> Floats:
    """Orthonormal polynomials on ``count`` points, (degree + 1, count)."""
    x = (np.arange(count) - 0.5 * (count - 1)) / count
    orthogonal, _ = np.linalg.qr(np.vander(x, degree + 1, increasing=True))
    return np.ascontiguousarray(orthogonal.T)


def resampled(
    heights: Floats, pixel_size: tuple[float, float], side: float, periodic: bool
) -> Floats:
    """Means over square pixels of edge ``side``: the cubic spline through the integral of the heights along each axis,
    differenced at the new edges, so that volume is conserved and coarser pixels are averages.

    Raises
    ------
    ValueError
        The image repeats, and its period is no whole number of pixels; or fewer than four pixels would remain.
    """
    from scipy.interpolate import CubicSpline

    for axis, old in enumerate(pixel_size):
        count = heights.shape[axis]
        exact = count * old / side
        fits = abs(exact - round(exact)) < 1e-6 * max(exact, 1.0)
        if periodic and not fits:
            near = max(round(exact), 1)
            raise ValueError(
                f"the period along {'xy'[axis]}, {count * old:.9g} nm, is no whole number of pixels of {side:g} nm; "
                f"give {count * old / near:.9g} nm"
            )
        new = round(exact) if fits else math.floor(exact)
        if new < 4:
            raise ValueError(
                f"leaves {new} pixels of {side:g} nm along {'xy'[axis]}; give smaller pixels"
            )
        if new == count and fits:
            continue
        rows = np.moveaxis(heights, axis, 0)
        level = rows.mean(axis=0)
        integral = np.zeros((count + 1, *rows.shape[1:]))
        np.cumsum((rows - level) * old, axis=0, out=integral[1:])
        if periodic:
            integral[-1] = 0.0  # to the last bit
        ends = "periodic" if periodic else "not-a-knot"
        spline = CubicSpline(np.arange(count + 1) * old, integral, bc_type=ends)
        edges = np.minimum(np.arange(new + 1) * side, count * old)
        heights = np.moveaxis(
            np.diff(spline(edges), axis=0) / side + level, 0, axis
        )
    return np.ascontiguousarray(heights)


def hann(heights: Floats) -> Floats:
    """Heights about their mean times a Hann window of unit mean square, 0 at the edges."""
    result = heights - heights.mean()
    roughness.taper(result)
    return result
