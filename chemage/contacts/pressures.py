"""How the pressure is distributed over the contact."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Above(NamedTuple):
    """Shares of the contact that lie above a pressure."""

    area: float
    """of the contact area"""
    load: float
    """of the load"""


def above(pressure: np.ndarray, limit: float) -> Above:
    """Which shares of contact area and load lie where the pressure (GPa) is above ``limit``; nan without contact."""
    beyond = pressure[pressure > limit]
    pixels, total = int(np.count_nonzero(pressure > 0)), float(pressure.sum(dtype=np.float64))
    if not pixels:
        return Above(math.nan, math.nan)
    return Above(beyond.size / pixels, float(beyond.sum(dtype=np.float64)) / total)
