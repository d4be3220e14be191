"""The distribution of the contact pressure over the reactive sites."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from chemage import ContactSolution, ReactionLattice
from chemage.plugin import BondHistory, Observable, Output, Pressure


class PressureSpectrum(Observable):
    """Histograms of the pressure at the sites as densities per site, 1/GPa.

    ``pressures``: all sites; ``pressures_bonded``: the sites bonded at the end, also per site of the lattice.
    """

    kind = "pressure-spectrum"

    outputs: ClassVar[Mapping[str, Output]] = {
        "pressure_edges": Output(("pressure_edge",), "GPa", "edges of the bins of the pressure"),
        "pressures": Output(("pressure",), "1/GPa", "density per site of all sites"),
        "pressures_bonded": Output(("pressure",), "1/GPa", "density per site of the sites bonded at the end"),
    }

    upper: Pressure = 20.0
    """upper edge of the histogram, GPa; the lower edge is 0"""
    bins: int = Field(default=200, ge=1, le=100_000)
    """number of bins of equal width"""

    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, np.ndarray]:
        """Compute the bin edges, (bins + 1,) GPa, and two densities per site of the lattice, (bins,) 1/GPa."""
        edges = np.linspace(0.0, self.upper, self.bins + 1)
        pressure = lattice.pressures(contact)

        def density(values: np.ndarray) -> np.ndarray:
            counts, _ = np.histogram(values, bins=edges)
            return counts / (max(pressure.size, 1) * np.diff(edges))

        return {
            "pressure_edges": edges,
            "pressures": density(pressure),
            "pressures_bonded": density(pressure[history.state]),
        }
