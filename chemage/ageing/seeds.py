"""Which random numbers the replicas of a run take, and which of them runs have in common.

By default a run is an independent sample: its seeds are hashed from the seed, the number of the replica, and what is
simulated. Differences between runs have smaller errors if the runs share their random numbers (common random numbers,
a standard method of variance reduction: Law, Simulation Modeling and Analysis, chapter 11).
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, checked_seed
from chemage.foundation.errors import InputError
from chemage.foundation.random import CommonSeed
from chemage.foundation.records import content_hash
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.site_grid import site_shape

#: the random numbers that replica r of every run with one seed has in common
Common = Literal["none", "disorder", "all"]
#: `Common` -> what it means, for users
COMMON: dict[str, str] = {
    "none": "independent of every other run",
    "disorder": "disorder in common with runs of this seed, kinetic noise independent",
    "all": "disorder and kinetic noise in common with runs of this seed",
}

#: The contact is recognised by the load on so many blocks of pixels along each side, ...
BLOCKS = 16
#: ... each rounded to this part of the load, coarse enough that the last bits of a processor hardly ever matter.
SHARE = 1e-3


class ReplicaSeeds(NamedTuple):
    """Seeds of one replica."""

    disorder: np.random.SeedSequence
    noise: np.random.SeedSequence


def replica_seeds(seed: Seed, replica: int, common: Common, run: tuple[int, ...]) -> ReplicaSeeds:
    """Seeds of a replica's disorder and of its kinetics: functions of the arguments alone.

    Parameters
    ----------
    seed, replica
        The seed of the run, and the number of the replica from 0.
    common
        What replica ``replica`` of every run with this seed has in common.
    run
        What is simulated, see :func:`identity`.
    """
    if isinstance(seed, np.random.SeedSequence):
        entropy, path = seed.entropy, tuple(seed.spawn_key)
    else:
        entropy, path = checked_seed(seed), ()
    disorder = np.random.SeedSequence(entropy, spawn_key=(*path, *(run if common == "none" else ()), replica, 0))
    if common == "all":
        return ReplicaSeeds(disorder, CommonSeed(entropy, spawn_key=(*path, replica, 1)))
    return ReplicaSeeds(disorder, np.random.SeedSequence(entropy, spawn_key=(*path, *run, replica, 1)))


def check_common(common: str) -> None:
    """Refuse what is not one of :data:`COMMON`."""
    if not isinstance(common, str) or common not in COMMON:
        raise InputError.of("common", common, f"is not one of {', '.join(COMMON)}", "the default is 'none'")


def identity(contact: ContactSolution, chemistry: Chemistry, engine: Engine, temperature: float) -> tuple[int, ...]:
    """Four 32-bit words that differ between runs that simulate different things.

    Of the contact enter its grid, that of the sites where it is another, its load, and how the pressure is distributed
    over it; of the chemistry what decides the bonds; of the engine its kind. Options that only change the speed do not
    enter, nor do the hold times.
    """
    chemical = chemistry.identity()
    for name in ("bond_force", "front_factor", "site_density"):
        chemical.pop(name, None)
    sites = site_shape(contact.shape, contact.pixel_size, chemistry.site_density)
    content = [
        contact.shape,
        f"{contact.pixel_size:.9g} {contact.load:.9g} {contact.modulus:.9g}",
        _distribution(contact.pressure),
        chemical,
        engine.kind,
        temperature,
        *([sites] if sites != contact.shape else []),
    ]
    return tuple(int(word) for word in np.frombuffer(bytes.fromhex(content_hash(content)), "<u4"))


def _distribution(pressure: np.ndarray) -> list[int]:
    """The share of the load on each block of pixels, and the mean pressure that the load sees, rounded."""
    rows, columns = (np.unique(np.arange(BLOCKS) * side // BLOCKS) for side in pressure.shape)
    sums = np.add.reduceat(np.add.reduceat(pressure, rows, axis=0, dtype=np.float64), columns, axis=1)
    total = float(sums.sum())
    if not total > 0:
        return []
    seen = float(np.einsum("ij,ij->", pressure, pressure, dtype=np.float64)) / total
    return [*np.rint(sums.ravel() / (SHARE * total)).astype(int).tolist(), round(math.log(seen) / SHARE)]


def origin(seed: Seed) -> list[object]:
    """A seed as plain JSON values, equal for equal seeds only."""
    if isinstance(seed, np.random.SeedSequence):
        return [isinstance(seed, CommonSeed), str(seed.entropy), list(seed.spawn_key)]
    return [int(seed)]
