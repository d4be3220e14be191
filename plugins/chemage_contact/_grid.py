"""The contact problem on one grid: heights, operator, and how the kernels run over its blocks; and other grids of the
same extent, with pressures and heights on them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._convolution import Convolution
from ._kernels import Heights, State
from ._operators import Substrate, fast_length
from ._team import Active, Team

Array = NDArray[Any]
Precision = Literal["single", "double", "mixed"]

#: dtypes of state and work
PRECISIONS: dict[str, tuple[type[np.floating[Any]], type[np.floating[Any]]]] = {
    "single": (np.float32, np.float32),
    "mixed": (np.float64, np.float32),
    "double": (np.float64, np.float64),
}
#: Coarse grids are never smaller than this number of pixels along an edge.
COARSEST = 48


@dataclass
class Settings:
    """How to solve; the same on all grids."""

    tolerance: float = 1e-5
    precision: Precision = "mixed"
    max_iterations: int = 500
    levels: int | None = None
    library: str = "scipy"
    #: largest estimated L2 error of the pressure, relative to its norm
    pressure_tolerance: float | None = None
    #: an entry of ``_descent.METHODS``: 0 uses every acceleration
    method: int = 0
    #: whether the split operator may be used on grids whose sides are no multiples of its ratio
    any_size: bool = False


class Grid:
    """The problem on one grid, and sums over its blocks."""

    def __init__(
        self,
        substrate: Substrate,
        heights: Heights,
        stiffness: float,
        mean: float,
        offset: float | None,
        settings: Settings,
        team: Team,
        finest: bool = True,
    ) -> None:
        self.substrate, self.settings, self.team = substrate, settings, team
        #: given if the approach is prescribed, None if the load is
        self.offset_fixed = offset
        self.floating = offset is None
        #: sum of the dimensionless pressure, if the load is prescribed; else its order of magnitude
        self.load = mean * substrate.shape[0] * substrate.shape[1]
        self.mean, self.finest = mean, finest
        self.state, self.work = PRECISIONS[settings.precision]
        self.heights = heights
        #: displacement = stiffness · (pixel-unit operator applied to dimensionless pressure)
        self.stiffness = stiffness
        symbol = substrate.symbol()
        self.operator = Convolution(substrate, symbol, self.work, settings.library, team, floating=self.floating)
        padded = substrate.padded != substrate.shape
        #: displacement under the mean pressure, which the operator leaves out where the offset is unknown
        self.uniform = 0.0 if padded or not self.floating else float(symbol[0, 0]) / self.operator.unit
        self._symbol = symbol if self.state != self.work else None
        self._double = self.operator if self.work == np.float64 else None
        nx, ny = substrate.shape
        self.width, self.per_row = kernels.widths(ny)
        blocks = nx * self.per_row
        #: sums of the last kernel, block by block
        self.part = np.zeros((blocks, 7))
        #: sums of ``kernels.residual``, which outlast those of other kernels
        self.residual_part = np.zeros((blocks, 6))
        self.everywhere = self.active(np.ones(blocks, np.bool_))
        self.history: list[tuple[float, float]] = []

    @property
    def transforms(self) -> int:
        """Fourier transforms of the full grid so far."""
        double = self._double.transforms if self._double is not None and self._double is not self.operator else 0
        return self.operator.transforms + double

    def exact(self) -> Convolution:
        """The operator in the precision of the state."""
        return self.operator if self.state == self.work else self.double()

    def double(self) -> Convolution:
        """The operator in double precision."""
        if self._double is None:
            symbol = self.substrate.symbol() if self._symbol is None else self._symbol
            make = (self.substrate, symbol, np.float64, self.settings.library, self.team)
            self._double = Convolution(*make, floating=self.floating)
        return self._double

    def gap(self, operator: Convolution, base: float, state: State) -> None:
        """The gap G p - h + base, in the precision of the operator, into ``state.r``.

        The sums of the gap and of the pixels in contact are in ``part`` afterwards.
        """
        u = operator.apply(state.p)
        self.run(kernels.subtract, self.everywhere, u, self.heights, self.stiffness, base, state, self.part)

    def run(self, kernel: Callable[..., None], active: Active, *args: Any) -> None:
        """Run a kernel over the active blocks."""
        self.team.run(kernel, active.block_edges, active.blocks, *args)

    def sums(self, columns: int) -> list[float]:
        """The first columns of ``part``, summed over all blocks."""
        return [float(x) for x in self.part[:, :columns].sum(axis=0)]

    def active(self, mask: Array) -> Active:
        """The blocks in ``mask``, ready for the kernels."""
        return Active(mask, self.width, self.per_row, self.team.threads)

    def working_set(self, reach: int) -> Active:
        """Blocks with a pixel of the working set in them or up to ``reach`` rows away."""
        here = (self.residual_part[:, 2] > 0.0).reshape(-1, self.per_row)
        near = here.copy()
        for shift in range(1, min(reach, len(here) - 1) + 1):
            near[shift:] |= here[:-shift]
            near[:-shift] |= here[shift:]
            near[:shift] |= here[-shift:]
            near[-shift:] |= here[:shift]
        return self.active(near.ravel())


def sums(p: Array, r: Array, team: Team) -> tuple[float, float, float]:
    """Σ p, Σ p·|r| and the least p, of two arrays (nx, ny)."""
    part = team.table(kernels.totals, p.shape[0], 3, p, r)
    return float(part[:, 0].sum()), float(part[:, 1].sum()), float(part[:, 2].min(initial=math.inf))


def rescale(p: Array, factor: float, team: Team) -> float:
    """Multiply p (nx, ny) in place; returns the new sum."""
    return float(team.table(kernels.scale, p.shape[0], 1, p, p.dtype.type(factor)).sum())


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
    values = dimensionless(Heights(sampled, heights.top, heights.factor), dtype, team)
    values.setflags(write=False)
    return Heights(values)
