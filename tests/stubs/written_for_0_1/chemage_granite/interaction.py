"""Four nearest neighbours, all pairs alike."""

import numpy as np
from chemage.spec import Interaction
from chemage.units import Energy


class GraniteInteraction(Interaction):
    """A bonded neighbour across a pixel's edge adds the same energy everywhere."""

    kind = "granite-interaction"

    strength: Energy = 0.2
    """what each bonded neighbour adds to the forming barrier, eV"""

    def neighbours(self, pixels, periodic, sites):
        nx, ny = pixels
        x, y = np.divmod(sites, ny)
        found = np.full((sites.size, 4), -1, dtype=np.int32)
        for slot, (dx, dy) in enumerate([(-1, 0), (0, -1), (0, 1), (1, 0)]):
            i, j = x + dx, y + dy
            inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
            flat = (i % nx) * ny + j % ny
            at = np.searchsorted(sites, flat).clip(max=max(sites.size - 1, 0))
            there = (sites[at] == flat) if sites.size else np.zeros(0, dtype=bool)
            there &= (flat != sites) & (inside | periodic)
            # on a grid one or two pixels wide the same neighbour lies on both sides; it counts once
            there &= ~(found == at[:, None]).any(axis=1)
            found[there, slot] = at[there]
        return found

    def coupling(self, sites, neighbours, seed):
        return np.where(neighbours >= 0, self.strength, 0.0)
