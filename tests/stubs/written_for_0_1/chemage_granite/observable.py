"""Bonds in large patches."""

import numpy as np
from chemage.measures import label_patches
from chemage.spec import Observable
from pydantic import Field


class GraniteObservable(Observable):
    """Share of the bonds that lie in patches of at least ``pixels`` pixels."""

    kind = "granite-observable"

    pixels: int = Field(default=100, ge=1)
    """what counts as a large patch"""

    def measure(self, contact, lattice, history):
        labels = label_patches(contact.contact, contact.periodic)[0].ravel()
        large = np.bincount(labels)[labels[lattice.sites]] >= self.pixels
        bonds = np.count_nonzero(history.state)
        return {"bonds_in_large_patches": np.count_nonzero(history.state & large) / bonds if bonds else 0.0}
