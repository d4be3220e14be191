"""A bed of independent springs."""

import numpy as np
from chemage.objects import ContactSolution
from chemage.spec import ContactSolver
from chemage.units import Pressure
from pydantic import Field


class GraniteContact(ContactSolver):
    """Winkler's foundation: each pixel pushes back in proportion to its own overlap, p = E* (h − d) / thickness."""

    kind = "granite-contact"
    implemented_properties = ("pressure", "displacement")

    modulus: Pressure = 35.3
    """contact modulus E*, GPa"""
    aspect: float = Field(default=0.1, gt=0, le=1e6)
    """thickness of the bed over the longer side of the surface"""

    def _solve(self, surface, load, start):
        thickness = self.aspect * max(surface.shape) * surface.pixel_size
        heights = np.sort(surface.heights, axis=None)[::-1].astype(np.float64)
        overlap = load * thickness / (self.modulus * surface.pixel_size**2)  # sum of h − d over the contact, nm
        # with the m highest pixels in contact d = (sum of them − overlap) / m; the right m is where d lies between
        below = np.cumsum(heights[0] - heights) - np.arange(1, heights.size + 1) * (heights[0] - heights)
        touching = max(int(np.searchsorted(-below, overlap, side="left")), 1)
        level = heights[:touching].mean() - overlap / touching
        pressure = np.maximum(surface.heights.astype(np.float64) - level, 0.0)
        total = pressure.sum()
        pressure *= load / surface.pixel_size**2 / total if total > 0 else 0.0
        return ContactSolution(
            pressure=pressure,
            load=load,
            pixel_size=surface.pixel_size,
            modulus=self.modulus,
            periodic=surface.periodic,
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            displacement=float(heights[0] - level),
            provenance={"solver": self.todict(), "surface": surface.provenance},
        )
