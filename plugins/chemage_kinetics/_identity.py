"""The key of a run's random numbers, which makes it an independent sample, and a fingerprint of its lattice."""

from __future__ import annotations

import hashlib

import numpy as np

from chemage import ReactionLattice
from chemage.plugin import Seed, random
from chemage_kinetics._common import Key
from chemage_kinetics._lattice import mix

#: Sites whose pixel and energies enter the key, spread evenly over the lattice.
PROBES = 256
#: Energies are rounded to 0.7 meV: coarse enough that differences between processors in the last bits do not matter,
#: and irrational, so that no barrier that a user writes down lies between two steps.
STEPS_PER_EV = 1000.0 * np.sqrt(2.0)


def noise_key(seed: Seed, stream: int, lattice: ReactionLattice) -> Key:
    """The key of the random numbers of an engine with this ``stream`` on ``lattice``.

    It is a hash of the seed, the engine and the lattice, so that one seed gives independent noise on every contact and
    in every engine, and always the same noise on the same lattice. A `chemage.plugin.random.CommonSeed` is used as it
    is: runs with one such seed have common random numbers.
    """
    words = random.key(seed)
    if isinstance(seed, random.CommonSeed):
        return Key(words[0], words[1])
    n = lattice.sites.size
    probes = slice(None) if n <= PROBES else np.arange(PROBES) * (n - 1) // (PROBES - 1)
    numbers = np.array([words[0], words[1], stream, n, lattice.attempt_frequency])
    content = hashlib.blake2b(numbers.astype("<f8").tobytes() + lattice.sites[probes].astype("<i8").tobytes())
    for energies in (lattice.forming, lattice.breaking, lattice.coupling):
        content.update(b"/")
        if energies is not None:
            steps = np.rint(energies[probes].astype("<f8") * STEPS_PER_EV)
            content.update((steps + 0.0).tobytes())  # + 0.0, because -0.0 has other bytes
    k0, k1 = np.frombuffer(content.digest()[:8], "<u4").astype(np.uint64)
    return Key(k0, k1)


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
