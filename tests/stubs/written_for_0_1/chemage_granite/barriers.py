"""Exponentially distributed barriers."""

from typing import Annotated

import numpy as np
from chemage.spec import Barriers
from chemage.units import Energy, Unit


class GraniteBarriers(Barriers):
    """Barriers above a threshold, exponentially rarer the higher they are."""

    kind = "granite-barriers"

    threshold: Energy = 0.8
    """the lowest barrier, eV"""
    scale: Annotated[float, Unit("eV", gt=0)] = 0.1
    """mean height above the threshold, eV"""

    def quantile(self, uniform):
        return self.threshold - self.scale * np.log1p(-np.asarray(uniform))

    def density(self, energy):
        above = (np.asarray(energy, dtype=np.float64) - self.threshold) / self.scale
        return np.where(above >= 0, np.exp(-np.maximum(above, 0.0)) / self.scale, 0.0)
