"""The same force for every bond."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from chemage.plugin import Bonded, Force, Rupture


class MeanForce(Rupture):
    """Every bond breaks at the same mean force: ΔF = N ⟨f⟩ × front factor. Li et al. 2018."""

    kind = "mean-force"
    cite = ("Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",)

    bond_force: Force | None = None
    """⟨f⟩, mean force to rupture a bond, nN; default: that of the chemistry"""
    front_factor: float | None = Field(default=None, gt=0, le=1)
    """fraction of the bonds that carry load at once as the detachment front passes; default: that of the chemistry"""

    def force(self, bonded: Bonded) -> np.ndarray:
        """Force in nN, (m,)."""
        force = bonded.chemistry.bond_force if self.bond_force is None else self.bond_force
        factor = bonded.chemistry.front_factor if self.front_factor is None else self.front_factor
        return bonded.bonds * (force * factor)
