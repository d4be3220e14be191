"""The same pixel keeps its disorder when load, activation volume or temperature change, so that differences between
scenes have small errors."""

import numpy as np
import pytest

import chemage as ca

SILICA = ca.chemistry(
    forming=ca.barriers("md-silica"),
    breaking=ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
    interaction=ca.interaction("elastic-pairs", strength="0.5 eV"),
)
ROUGH = ca.surface("self-affine", pixels=256, pixel_size="0.4518 nm", rms_slope=0.1, hurst=0.8, zeta=32, eta=2).make(
    seed=3
)
SOLVER = ca.contact("fft-bem", modulus="35.3 GPa")
LIGHT, HEAVY = SOLVER.solve(ROUGH, "400 nN"), SOLVER.solve(ROUGH, "420 nN")


def test_shared_pixels_keep_their_barriers_and_couplings_when_the_load_changes():
    light, heavy = SILICA.on(LIGHT, seed=1), SILICA.on(HEAVY, seed=1)
    shared, at, other = np.intersect1d(light.sites, heavy.sites, return_indices=True)
    assert shared.size > 0.9 * light.sites.size
    assert light.breaking is not None
    assert heavy.breaking is not None
    np.testing.assert_array_equal(light.forming[at], heavy.forming[other])
    np.testing.assert_array_equal(light.breaking[at], heavy.breaking[other])

    def pairs(lattice: ca.ReactionLattice) -> dict[tuple[int, int], float]:
        assert lattice.neighbours is not None
        assert lattice.coupling is not None
        i, slot = np.nonzero(lattice.neighbours >= 0)
        j = lattice.neighbours[i, slot]
        ends = zip(lattice.sites[i].tolist(), lattice.sites[j].tolist(), strict=True)
        return dict(zip(ends, lattice.coupling[i, slot].tolist(), strict=True))

    first, second = pairs(light), pairs(heavy)
    both = first.keys() & second.keys()
    assert len(both) > 0.9 * len(first)
    assert all(first[pair] == second[pair] for pair in both)


def test_hydroxylation_only_takes_sites_away():
    full, half = SILICA.on(LIGHT, seed=1), SILICA.replace(hydroxylation=0.5).on(LIGHT, seed=1)
    more = SILICA.replace(hydroxylation=0.8).on(LIGHT, seed=1)
    assert set(half.sites) < set(more.sites) < set(full.sites)
    assert abs(half.sites.size / full.sites.size - 0.5) < 4 * 0.5 / full.sites.size**0.5


@pytest.mark.long
def test_differences_between_loads_have_smaller_errors_than_independent_runs():
    """The paired standard deviation of ΔF(heavy) − ΔF(light) over replicas against that of independent seeds.

    With common disorder, two loads share that of their common pixels: 0.62 ± 0.03.
    """
    engine, times = ca.engine("rejection-free"), ca.hold_times(1.0, 1e3, 1)

    def drop(contact: ca.ContactSolution, seed: int) -> np.ndarray:
        ageing = ca.age(
            contact,
            SILICA,
            engine=engine,
            hold_times=times,
            temperature=300.0,
            replicas=400,
            seed=seed,
            common="disorder",
        )
        return ageing.friction_drop[:, -1]

    light, heavy, unpaired = drop(LIGHT, 0), drop(HEAVY, 0), drop(HEAVY, 99)
    assert np.std(heavy - light) < 0.75 * np.std(unpaired - light)
    # and the pairing does not move the mean
    error = np.hypot(np.std(heavy), np.std(unpaired)) / 400**0.5
    assert abs(heavy.mean() - unpaired.mean()) < 4 * error
