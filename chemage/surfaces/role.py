"""The role that makes a surface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

from chemage.foundation.checks import Seed
from chemage.foundation.components import Component
from chemage.surfaces.surface import Surface


class SurfaceMaker(Component, ABC):
    """Role ``surface``: makes the rough body."""

    role = "surface"
    error_of: ClassVar[str] = "the heights"

    @abstractmethod
    def make(self, seed: Seed = 0) -> Surface:
        """The surface. The same seed gives the same bytes; a deterministic maker ignores it."""

    def expected(self) -> dict[str, float]:
        """What is known before anything is computed, as far as it is: ``nx``, ``ny`` (pixels), ``pixel_size`` (nm),
        ``rms_slope``, ``shortest_wavelength`` (nm), ``radius`` (of a sphere, nm). Used by ``chemage check``."""
        return {}

    def coarser(self, factor: int) -> Self | None:
        """A maker of the same surface at the same size on pixels ``factor`` times larger; None where there is none."""
        return None
