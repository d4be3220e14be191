"""What is sampled: measured values as a linear function of the density, the prior, and the unknown scalars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from chemage.inference.prior import Prior


@dataclass(frozen=True, eq=False)
class Scalars:
    """Unknown scalars on a grid of values, each with its linear model."""

    #: name -> (g,) value at each point of the grid
    values: Mapping[str, np.ndarray]
    #: (g, k) points beside each, itself where the grid ends
    neighbours: np.ndarray
    #: name of the factor of everything, bounds of its logarithm; "" without one
    factor: str = ""
    bounds: tuple[float, float] = (0.0, 0.0)
    #: point from which sampling begins; None: the middle
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """Measured values as a linear function of the density: values = offset + matrix @ density, at each grid point."""

    prior: Prior
    #: (n,) eV
    areas: np.ndarray
    #: (m,) measured, and their standard errors
    values: np.ndarray
    errors: np.ndarray
    #: (g, m, n) and (g, m)
    matrices: np.ndarray
    offsets: np.ndarray
    scalars: Scalars = field(default_factory=lambda: Scalars({}, np.zeros((1, 0), dtype=np.int64)))

    def without(self, left_out: np.ndarray) -> Problem:
        """The problem without the points that ``left_out`` (m,) marks."""
        kept = ~left_out
        return Problem(
            self.prior,
            self.areas,
            self.values[kept],
            self.errors[kept],
            self.matrices[:, kept],
            self.offsets[:, kept],
            self.scalars,
        )
