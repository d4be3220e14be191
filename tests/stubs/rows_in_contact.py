"""A contact whose area is known: whole rows of pixels."""

from __future__ import annotations

import numpy as np

import chemage as ca
from chemage.plugin import ContactSolver


class Rows(ContactSolver):
    """A uniform pressure of 0.625 GPa on rows of pixels, one for each 10 nN."""

    kind = "rows"
    modulus: float = 1.0

    def _solve(self, surface, load, start):
        pressure = np.zeros(surface.shape)
        rows = round(load / 10 / getattr(self, "hardness", 1.0))
        pressure[:rows] = load / (rows * surface.shape[1]) / surface.pixel_size**2 if rows else 0.0
        return ca.ContactSolution(
            pressure=pressure, load=load, pixel_size=surface.pixel_size, modulus=1.0, periodic=True
        )
