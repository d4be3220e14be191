"""The roles of the chemistry: distributions of barriers, and interactions of neighbouring sites."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from chemage.foundation.checks import Seed
from chemage.foundation.components import Component


class Barriers(Component, ABC):
    """Role ``barriers``: a distribution of energy barriers.

    It is given as its quantile function, so that every pixel's barrier is a pure function of the pixel's own uniform
    number: the same pixel keeps its barrier rank when load, temperature or the distribution change.
    """

    role = "barriers"
    error_of = "the barriers"

    @abstractmethod
    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        """Barriers in eV at ``uniform`` numbers in (0, 1); same shape, non-decreasing."""

    @abstractmethod
    def density(self, energy: np.ndarray) -> np.ndarray:
        """Probability density in 1/eV at ``energy`` in eV; same shape. A point mass has density ``inf`` there."""

    def members(self, count: int) -> Sequence[Barriers]:
        """Other distributions that the same data allow, at most ``count`` of them; none where none is known.

        A run ages them on its contact too, and their scatter is its error ``barriers``.
        """
        return ()


class Interaction(Component, ABC):
    """Role ``interaction``: which sites are coupled, and how strongly.

    A component may add keyword arguments with defaults to both methods, and chemage then passes them: ``pixel_size``
    (nm) and ``positions`` ((n, 2) nm, or None where each site is in the centre of its pixel); to ``coupling`` also
    ``pixels`` and ``periodic``.
    """

    role = "interaction"
    error_of = "the couplings"

    @abstractmethod
    def neighbours(
        self, pixels: tuple[int, int], periodic: bool, sites: np.ndarray
    ) -> np.ndarray:
        """The graph: (n, k) int32, entry ``[i, s]`` the position in ``sites`` of a neighbour of ``i``, or -1.

        It depends on geometry alone, so replicas share it. ``sites`` are sorted flat pixel indices, (n,) int64.
        """

    @abstractmethod
    def coupling(
        self, sites: np.ndarray, neighbours: np.ndarray, seed: Seed
    ) -> np.ndarray:
        """What a bonded neighbour adds to a site's forming barrier, (n, k) eV, symmetric, 0 where there is none."""
