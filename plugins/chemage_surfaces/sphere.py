"""The smooth tip of a single asperity."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from chemage import Length, Seed, Surface, SurfaceMaker
from chemage_surfaces._options import Pixels, provenance


class Sphere(SurfaceMaker):
    """A sphere near its apex: the paraboloid −r²/(2R), apex at height 0 in the middle of the grid; not periodic.

    The paraboloid is the body of Hertz' theory, so that a numerical contact solution of this surface can be compared
    with the closed form at any load. A true sphere is lower by the fraction r²/(4R²), 0.25 % at r = R/10, where
    small-strain elasticity is in error by as much.

    The apex lies at pixel index ((nx − 1)/2, (ny − 1)/2): on a pixel where the count is odd, between two where it is
    even. Either way heights equal their mirror images to the last bit.
    """

    kind = "sphere"
    cite: ClassVar[tuple[str, ...]] = ("K. L. Johnson, Contact Mechanics, Cambridge University Press (1985), ch. 4",)

    radius: Length
    """radius of curvature R, nm"""
    pixels: Pixels
    """grid: one number for a square, or [nx, ny]"""
    pixel_size: Length
    """edge of a pixel, nm"""

    def expected(self) -> dict[str, float]:
        nx, ny = self.pixels
        return {"nx": nx, "ny": ny, "pixel_size": self.pixel_size}

    def make(self, seed: Seed = 0) -> Surface:
        """The surface: heights (nx, ny) float64 nm, highest 0 at the apex. ``seed`` is ignored.

        ``provenance["radius"]`` is R in nm.
        """
        across, along = (
            ((np.arange(count) - 0.5 * (count - 1)) * self.pixel_size) ** 2 / (2 * self.radius) for count in self.pixels
        )
        heights = -(across[:, None] + along[None, :])
        heights.setflags(write=False)
        return Surface(
            heights=heights,
            pixel_size=self.pixel_size,
            periodic=False,
            provenance={**provenance(self), "radius": self.radius},
        )
