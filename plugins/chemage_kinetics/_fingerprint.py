"""A 64-bit fingerprint of a lattice, far cheaper than its digest."""

from __future__ import annotations

import numpy as np

from chemage import ReactionLattice
from chemage_kinetics._mix import mix


def fingerprint(lattice: ReactionLattice) -> np.ndarray:
    """uint64 (1,), a hash of all that the kinetics depend on: pixels of the sites, barriers, graph, frequency."""
    value = np.array([lattice.attempt_frequency]).view(np.uint64)[0]
    for array in (lattice.sites, lattice.forming, lattice.breaking, lattice.neighbours, lattice.coupling):
        raw = np.empty(0, np.uint8) if array is None else array.reshape(-1).view(np.uint8)
        whole = raw.size - raw.size % 8
        rest = np.zeros(16, np.uint8)
        rest[: raw.size - whole] = raw[whole:]
        rest[8] = array is None
        for part in (raw[:whole], rest):
            words = part.view(np.uint64)
            words.setflags(write=False)
            value = np.uint64(mix(words, value))
    return np.array([value], np.uint64)
