"""Barriers uniformly distributed on an interval."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from chemage.plugin import Barriers, Energy


class Uniform(Barriers):
    """Constant density between ``lower`` and ``upper``."""

    kind = "uniform"

    lower: Energy
    """lowest barrier, eV"""
    upper: Energy
    """highest barrier, eV"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.upper > self.lower:
            raise ValueError(f"upper = {self.upper:g} eV: not above lower = {self.lower:g} eV; swap or widen them")
        return self

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        u = np.asarray(uniform, dtype=np.float64)
        return np.clip(self.lower * (1.0 - u) + self.upper * u, self.lower, self.upper)

    def density(self, energy: np.ndarray) -> np.ndarray:
        e = np.asarray(energy, dtype=np.float64)
        return np.where((e >= self.lower) & (e <= self.upper), 1.0 / (self.upper - self.lower), 0.0)
