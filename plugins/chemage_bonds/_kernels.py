"""Numba kernels on sorted lists of pixels. Cost and memory grow with the number of sites, not with that of pixels."""

from __future__ import annotations

import numpy as np

from chemage.plugin import kernel, random

#: (row, column) steps to the neighbours in the slots of a site's row; slot 7 − s is the opposite of slot s
SLOTS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


@kernel(nogil=True)
def row_starts(sites: np.ndarray, nx: int, ny: int) -> np.ndarray:
    """Where each row of pixels begins in the sorted list ``sites``: (nx + 1,) int64.

    An empty array if the list is not ascending, or if a pixel lies outside the grid.
    """
    starts = np.zeros(nx + 1, dtype=np.int64)
    row = 0
    before = np.int64(-1)
    for i in range(sites.size):
        pixel = sites[i]
        if pixel <= before or pixel >= nx * ny:
            return np.zeros(0, dtype=np.int64)
        before = pixel
        while pixel >= (row + 1) * ny:
            row += 1
            starts[row] = i
    for r in range(row + 1, nx + 1):
        starts[r] = sites.size
    return starts


@kernel(nogil=True)
def eight_neighbours(
    sites: np.ndarray,
    starts: np.ndarray,
    nx: int,
    ny: int,
    periodic: bool,
    out: np.ndarray,
) -> None:
    """Fill ``out`` (n, 8) int32 with the positions of the eight nearest neighbours in the list, or -1.

    Rows are merged: one pointer moves along each neighbouring row, so a site costs a few reads, nearly all of them from
    the cache, and one write of 32 bytes. On a periodic grid one or two pixels wide, steps that lead to the same pixel
    count once, and a pixel is not its own neighbour.
    """
    first_step = 0 if periodic and nx < 3 else -1
    last_step = 0 if periodic and nx < 2 else 1
    first_side = 0 if periodic and ny < 3 else -1
    last_side = 0 if periodic and ny < 2 else 1
    out[:] = -1
    for r in range(nx):
        begin, end = starts[r], starts[r + 1]
        if begin == end:
            continue
        for step in range(first_step, last_step + 1):
            other = r + step
            if other < 0 or other >= nx:
                if not periodic:
                    continue
                other = other % nx
            there, stop = starts[other], starts[other + 1]
            if there == stop:
                continue
            head, tail = there, stop - 1
            base, origin = r * ny, other * ny
            slot = (step + 1) * 3 + 1
            for i in range(begin, end):
                column = sites[i] - base
                while there < stop and sites[there] - origin < column - 1:
                    there += 1
                at = there
                for side in range(first_side, last_side + 1):
                    target = column + side
                    found = np.int64(-1)
                    if target < 0:
                        if periodic and sites[tail] - origin == ny - 1:
                            found = tail
                    elif target >= ny:
                        if periodic and sites[head] == origin:
                            found = head
                    else:
                        while at < stop and sites[at] - origin < target:
                            at += 1
                        if at < stop and sites[at] - origin == target:
                            found = at
                    if found >= 0 and found != i:
                        s = slot + side
                        out[i, s if s < 4 else s - 1] = found


@kernel(nogil=True)
def pair_couplings(
    sites: np.ndarray,
    neighbours: np.ndarray,
    k0: np.uint64,
    k1: np.uint64,
    stream: int,
    strength: float,
    bias: float,
    out: np.ndarray,
) -> None:
    """Fill ``out`` (n, k) with strength·(φ − bias), φ uniform on (0, 1), one number for each pair of pixels.

    Each number is drawn once, for the first site of the pair, and copied to the other; 0 where there is no neighbour.
    k0, k1: the key of the random numbers, see `chemage.plugin.random.key`.
    """
    n, k = neighbours.shape
    for i in range(n):
        for s in range(k):
            j = neighbours[i, s]
            if j < 0:
                out[i, s] = 0.0
            elif j > i:
                value = strength * (
                    random.pair_uniform(k0, k1, stream, sites[i], sites[j]) - bias
                )
                out[i, s] = value
                back = k - 1 - s
                if neighbours[j, back] != i:
                    back = 0
                    while back < k and neighbours[j, back] != i:
                        back += 1
                if back < k:
                    out[j, back] = value
