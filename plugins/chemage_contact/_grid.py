"""The contact problem on one grid: heights, operator, and how the kernels run over its blocks."""

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
from ._operators import Substrate
from ._team import Active, Team

Array = NDArray[Any]
Precision = Literal["single", "double", "mixed"]

#: dtypes of state and work
PRECISIONS: dict[str, tuple[type[np.floating[Any]], type[np.floating[Any]]]] = {
    "single": (np.float32, np.float32),
    "mixed": (np.float64, np.float32),
    "double": (np.float64, np.float64),
}


@dataclass
class Settings:
    """How to solve; the same on all grids."""

    tolerance: float = 1e-5
    precision: Precision = "mixed"
    max_iterations: int = 500
    levels: int | None = None
    library: str = "scipy"
    #: an entry of ``_descent.METHODS``: 0 uses every acceleration
    method: int = 0


class Grid:
    """The problem on one grid, and sums over its blocks."""

    def __init__(
        self,
        substrate: Substrate,
        heights: Heights,
        stiffness: float,
        offset: float | None,
        settings: Settings,
        team: Team,
    ) -> None:
        self.substrate, self.settings, self.team = substrate, settings, team
        #: given if the approach is prescribed, None if the load is
        self.offset_fixed = offset
        self.floating = offset is None
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
        self._exact = self.operator if self.state == self.work else None
        nx, ny = substrate.shape
        per_row = math.ceil(ny / kernels.WIDTH)
        self.width = min(ny, 16 * math.ceil(ny / per_row / 16))
        self.per_row = math.ceil(ny / self.width)
        blocks = nx * self.per_row
        #: sums of the last kernel, block by block
        self.part = np.zeros((blocks, 7))
        #: sums of ``kernels.residual``, which outlast those of other kernels
        self.residual_part = np.zeros((blocks, 4))
        self.everywhere = self.active(np.ones(blocks, np.bool_))
        self.history: list[tuple[float, float]] = []

    @property
    def transforms(self) -> int:
        """Fourier transforms of the full grid so far."""
        exact = self._exact.transforms if self._exact is not None and self._exact is not self.operator else 0
        return self.operator.transforms + exact

    def exact(self) -> Convolution:
        """The operator in the precision of the state."""
        if self._exact is None:
            assert self._symbol is not None
            make = (self.substrate, self._symbol, self.state, self.settings.library, self.team)
            self._exact = Convolution(*make, floating=self.floating)
        return self._exact

    def gap(self, p: Array, exact: bool, out: Array | None = None) -> Array:
        """Gap before the offset, G p - h, in the precision of the state, or in that of the work, which costs less.

        The sums of the gap and of the pixels in contact are in ``part`` afterwards.
        """
        u = (self.exact() if exact else self.operator).apply(p)
        r = np.empty(p.shape, self.state) if out is None else out
        self.run(kernels.subtract, self.everywhere, u, self.heights, self.stiffness, State(p, r), self.part)
        return r

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
        for shift in range(1, reach + 1):
            near |= np.roll(here, shift, axis=0) | np.roll(here, -shift, axis=0)
        return self.active(near.ravel())
