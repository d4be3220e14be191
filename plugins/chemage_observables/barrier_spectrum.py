"""The barriers a contact offers, and those that are left once bonds have formed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from chemage.objects import BondHistory, ContactSolution, ReactionLattice
from chemage.spec import Observable
from chemage.units import Energy


class BarrierSpectrum(Observable):
    """Histograms of the forming barriers, as densities per site (1/eV): of all sites before any bond formed
    (``barriers_start``), of the sites still open at the end (``barriers_open``, with what bonded neighbours add), and
    the start barriers of the sites that are bonded at the end (``barriers_bonded``). Li et al. 2018, Fig. 2(a).
    """

    kind = "barrier-spectrum"

    lower: Energy = 0.0
    """lower edge of the histogram"""
    upper: Energy = 2.5
    """upper edge; what lies outside is not counted, so a density integrates to the share of sites inside"""
    bins: int = Field(default=125, ge=1, le=100_000)
    """bins of equal width between them"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.upper <= self.lower:
            raise ValueError(f"upper ({self.upper:g} eV) must be above lower ({self.lower:g} eV)")
        return self

    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, np.ndarray]:
        """Bin edges (bins + 1,) eV and three densities (bins,) 1/eV; each is per site of the lattice."""
        edges = np.linspace(self.lower, self.upper, self.bins + 1)
        forming, bonded = lattice.forming, history.state
        now = np.array(forming)
        if lattice.neighbours is not None and lattice.coupling is not None:
            taken = np.append(bonded, False)[lattice.neighbours]  # slot -1 reads the appended False
            now += np.sum(lattice.coupling, axis=1, where=taken, dtype=np.float64)

        def density(values: np.ndarray) -> np.ndarray:
            counts, _ = np.histogram(values, bins=edges)
            return counts / (max(forming.size, 1) * np.diff(edges))

        return {
            "barrier_edges": edges,
            "barriers_start": density(forming),
            "barriers_open": density(now[~bonded]),
            "barriers_bonded": density(forming[bonded]),
        }
