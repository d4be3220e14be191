"""One seed gives independent noise on every contact and in every engine, and the same bytes on the same lattice."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import chemage
from chemage import ReactionLattice
from chemage.plugin import random as cr
from chemage_kinetics._common import STREAMS
from chemage_kinetics._driver import PROBES, noise_key

RUNS = 600
#: 4.5 standard deviations of the correlation of so many independent pairs
INDEPENDENT = 4.5 / RUNS**0.5
TIMES = np.geomspace(10.0, 1e4, 7)


def full_contact(side: int = 8, surface: int = 0, interacting: bool = True, **changes) -> ReactionLattice:
    """All pixels in contact under the pressures of one surface; the disorder is the same on all surfaces."""
    sites = np.arange(side * side)
    pairs = chemage.interaction("elastic-pairs", strength=0.5)
    graph = pairs.neighbours((side, side), True, sites)
    pressure = 1.6 + 0.8 * np.random.default_rng(surface).normal(size=sites.size)
    fields = {
        "pixels": (side, side),
        "sites": sites,
        "forming": 0.8 + 0.6 * cr.uniforms(7, cr.FORMING, sites) - 0.04 * pressure,
        "breaking": 1.0 + 0.2 * cr.uniforms(7, cr.BREAKING, sites),
    }
    if interacting:
        fields |= {"neighbours": graph, "coupling": pairs.coupling(sites, graph, 7)}
    return ReactionLattice(**{**fields, **changes})


def slopes_and_bonds(kind: str, lattice: ReactionLattice) -> np.ndarray:
    """(2, RUNS): bonds per decade of time, and bonds at the end, for the seeds 0 to RUNS - 1."""
    engine = chemage.engine(kind)
    bonds = np.array([engine.run(lattice, TIMES, temperature=300.0, seed=s).bonds for s in range(RUNS)])
    return np.stack([np.polyfit(np.log10(TIMES), bonds.T, 1)[0], bonds[:, -1]])


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=() if kind == "rejection-free" else pytest.mark.long)
        for kind in STREAMS
        if kind != "event-driven"  # pulls
    ],
)
def test_replicas_of_one_seed_are_independent_on_different_surfaces(kind):
    one, other = (slopes_and_bonds(kind, full_contact(surface=s, interacting=kind != "independent")) for s in (1, 2))
    for a, b in zip(one, other, strict=True):
        assert abs(np.corrcoef(a, b)[0, 1]) < INDEPENDENT


@pytest.mark.long
def test_engines_are_independent_on_one_seed():
    found = [slopes_and_bonds(kind, full_contact()) for kind in ("rejection-free", "bkl", "next-reaction")]
    for one, other in itertools.combinations(found, 2):
        for a, b in zip(one, other, strict=True):
            assert abs(np.corrcoef(a, b)[0, 1]) < INDEPENDENT


def test_the_key_differs_with_the_seed_the_engine_and_everything_in_the_lattice():
    base = full_contact()
    plain = full_contact(interacting=False)
    lattices = [
        base,
        plain,
        full_contact(surface=1),
        full_contact(breaking=None),
        full_contact(attempt_frequency=2e13),
        full_contact(coupling=2 * np.asarray(base.coupling)),
        full_contact(side=20),
        full_contact(side=20, surface=1),
        ReactionLattice(pixels=(9, 8), sites=base.sites + 1, forming=plain.forming, breaking=plain.breaking),
        ReactionLattice(pixels=(8, 8), sites=base.sites[1:], forming=plain.forming[1:]),
        ReactionLattice(pixels=(8, 8), sites=[], forming=[]),
    ]
    keys = {noise_key(seed, stream, one) for one in lattices for stream in (16, 17) for seed in (0, 1)}
    assert len(keys) == 4 * len(lattices)


@pytest.mark.parametrize("side", [8, 100])
def test_the_key_does_not_depend_on_the_last_bits_of_a_processor(side):
    one = full_contact(side)
    assert (one.sites.size > PROBES) == (side == 100)
    for factor in (1.0 - 1e-12, 1.0 + 1e-12):
        rounded = {name: factor * np.asarray(getattr(one, name)) for name in ("forming", "breaking")}
        assert noise_key(3, 16, full_contact(side, **rounded)) == noise_key(3, 16, one)


def test_runs_with_one_key_have_common_random_numbers():
    """What compares two loads with small errors: the key is used as it is, whatever the lattice."""
    seed = cr.CommonSeed(5)
    one, other = (noise_key(seed, 16, full_contact(surface=number)) for number in (1, 2))
    assert one == other == tuple(cr.key(5))
    assert noise_key(5, 16, full_contact()) != one


def test_a_seed_and_its_seed_sequence_are_the_same():
    assert noise_key(5, 16, full_contact()) == noise_key(np.random.SeedSequence(5), 16, full_contact())
