"""The smooth tip of a single asperity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from chemage import Surface
from chemage.plugin import Length, Scatter, Seed, SurfaceMaker, memory
from chemage_surfaces._maps import Pixels, provenance

_JOHNSON = """@book{johnson1985,
  author = {Johnson, K. L.},
  title = {Contact Mechanics},
  publisher = {Cambridge University Press},
  year = {1985},
  doi = {10.1017/CBO9781139171731},
}"""


class Sphere(SurfaceMaker):
    """A sphere near its apex: the paraboloid −r²/(2R) with apex at height 0 in the middle of the grid; not periodic.

    Hertz' theory is that of a paraboloid, so that a numerical solution for this surface can be compared with the closed
    form at any load. A sphere is lower by the fraction r²/(4R²), 0.25 % at r = R/10, where the error of small-strain
    elasticity is of the same size.

    The apex has the pixel index ((nx − 1)/2, (ny − 1)/2): on a pixel for odd numbers, between pixels for even ones.
    Heights equal their mirror images to the last bit.
    """

    kind = "sphere"
    cite: ClassVar[tuple[str, ...]] = ("K. L. Johnson, Contact Mechanics, Cambridge University Press (1985), ch. 4",)
    bibtex: ClassVar[tuple[str, ...]] = (_JOHNSON,)

    radius: Length
    """radius of curvature R, nm"""
    pixels: Pixels
    """grid: one number for a square, or [nx, ny]"""
    pixel_size: Length
    """edge of a pixel, nm"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        lowest = sum((0.5 * (count - 1) * self.pixel_size) ** 2 for count in self.pixels) / (2 * self.radius)
        if lowest > 1e250:
            raise ValueError(
                f"radius = {self.radius:g} nm: the edge of the grid would lie {lowest:g} nm below the apex; "
                "give radius and pixel_size in nm"
            )
        return self

    def expected(self) -> dict[str, float]:
        """The grid and the radius."""
        nx, ny = self.pixels
        return {"nx": nx, "ny": ny, "pixel_size": self.pixel_size, "radius": self.radius, "periodic": 0.0} | {
            "cpu_seconds": 1e-8 * nx * ny
        }

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """None: the seed is ignored."""
        return Scatter(0.0)

    def make(self, seed: Seed = 0) -> Surface:
        """Make the surface: heights (nx, ny) float64 nm, at most 0. ``seed`` is ignored.

        ``provenance["radius"]`` is R in nm.
        """
        memory.require(3 * 8.0 * self.pixels[0] * self.pixels[1], f"pixels = {self.pixels}", "use fewer")
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
