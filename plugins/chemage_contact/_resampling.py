"""Pressures and heights on other grids of the same extent."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._kernels import Heights
from ._operators import fast_length
from ._team import Team

Array = NDArray[Any]

#: Coarse grids are never smaller than this number of pixels along an edge.
COARSEST = 48


def grids(shape: tuple[int, int], levels: int | None) -> list[tuple[int, int]]:
    """Grids from fine to coarse: halved, to lengths that transform fast. ``levels`` counts all of them."""
    out = [shape]
    while levels is None or len(out) < levels:
        nx, ny = (n if n < COARSEST else 4 * fast_length(math.ceil(n / 8)) for n in out[-1])
        if (nx, ny) == out[-1] or (levels is None and max(nx, ny) < COARSEST):
            break
        out.append((nx, ny))
    return out


def resampled(
    source: Array,
    shape: tuple[int, int],
    dtype: Any,
    periodic: bool,
    team: Team,
    kernel: Callable[..., None] = kernels.resample,
) -> Array:
    """Bilinear resampling of (nx, ny) to another grid of the same extent whose first pixels coincide."""
    axes = []
    for n, m in zip(source.shape, shape, strict=True):
        x = np.arange(m) * (n / m)
        low = np.minimum(x.astype(np.int64), n - 1)
        high = (low + 1) % n if periodic else np.minimum(low + 1, n - 1)
        axes.append(kernels.Axis(low, high, x - low))
    target = np.empty(shape, dtype)
    team.run(kernel, shape[0], source, *axes, target)
    return target


def dimensionless(heights: Heights, dtype: Any, team: Team) -> Array:
    """The dimensionless heights as an array (nx, ny)."""
    out = np.empty(heights.values.shape, dtype)
    team.run(kernels.standardise, len(out), heights, out)
    return out


def regridded(heights: Heights, shape: tuple[int, int], dtype: Any, periodic: bool, team: Team) -> Heights:
    """The dimensionless heights on another grid."""
    sampled = resampled(heights.values, shape, np.float64, periodic, team)
    sampled.setflags(write=False)  # as those of a surface, or numba compiles kernels for both
    found = dimensionless(Heights(sampled, heights.top, heights.factor), dtype, team)
    found.setflags(write=False)
    return Heights(found)
