"""A wavy surface."""

import numpy as np
from chemage.objects import Surface
from chemage.spec import SurfaceMaker
from chemage.units import Length
from pydantic import Field


class GraniteSurface(SurfaceMaker):
    """One cosine along x."""

    kind = "granite-surface"

    amplitude: Length = 1.0
    """half the height from valley to crest, nm"""
    pixels: int = Field(default=64, ge=1, le=100_000)
    """along each side; one wavelength"""
    pixel_size: Length = 0.5
    """edge of a pixel, nm"""

    def make(self, seed=0):
        x = 2 * np.pi * np.arange(self.pixels) / self.pixels
        heights = np.repeat(self.amplitude * np.cos(x)[:, None], self.pixels, axis=1)
        return Surface(heights=heights, pixel_size=self.pixel_size, periodic=True, provenance={"maker": self.todict()})
