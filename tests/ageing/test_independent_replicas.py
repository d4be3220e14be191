"""One seed gives independent replicas on every surface, at every temperature, in every engine, unless asked not to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import chemage as ca
from chemage import InputError

TIMES = np.geomspace(10.0, 1e4, 7)
SURFACES = 12
REPLICAS = 40
SILICA = ca.chemistry(
    forming=ca.barriers("uniform", lower="0.8 eV", upper="1.4 eV"),
    breaking=ca.barriers("uniform", lower="1.0 eV", upper="1.4 eV"),
    interaction=ca.interaction("elastic-pairs", strength=0.3),
    activation_volume="0.04 eV/GPa",
)


def contact_of(surface: int, fraction: float, side: int = 40) -> ca.ContactSolution:
    """Patches of smooth pressure over this fraction of the pixels; no solver, so that no tolerance matters."""
    height = ndimage.gaussian_filter(np.random.default_rng(surface).normal(size=(side, side)), 2, mode="wrap")
    pressure = np.maximum(height - np.quantile(height, 1 - fraction), 0)
    pressure *= 3.0 / pressure.max()
    size = 0.4518
    return ca.ContactSolution(pressure=pressure, load=pressure.sum() * size**2, pixel_size=size, modulus=70.0)


def beta_and_drop(contact: ca.ContactSolution, engine: str = "rejection-free", **options) -> np.ndarray:
    """(2, replicas): β, and Δμ at the last hold time."""
    ageing = ca.age(
        contact,
        options.pop("chemistry", SILICA),
        engine=ca.engine(engine),
        hold_times=TIMES,
        temperature=options.pop("temperature", 300.0),
        replicas=REPLICAS,
        threads=1,
        **options,
    )
    drops = ageing.friction_coefficient_drop
    return np.stack([np.polyfit(np.log10(TIMES), drops.T, 1)[0], drops[:, -1]])


def correlation(groups: list[np.ndarray]) -> np.ndarray:
    """(2,) mean correlation over all pairs of ``groups`` (2, replicas), replica by replica.

    From the variance of the mean over groups, after every group was given mean 0 and variance 1. Its standard error is
    sqrt(1 / (pairs · (replicas − 1))) without correlation.
    """
    values = np.stack([(one - one.mean(1, keepdims=True)) / one.std(1, ddof=1, keepdims=True) for one in groups])
    return (values.mean(axis=0).var(axis=1, ddof=1) * len(groups) - 1) / (len(groups) - 1)


# 40 × 40 pixels at 1 % are 16 sites, so the sparse contact is larger
@pytest.mark.parametrize(("fraction", "side"), [pytest.param(0.01, 120, marks=pytest.mark.long), (0.7, 40)])
@pytest.mark.parametrize(
    "engine", ["rejection-free", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("bkl", "next-reaction"))]
)
def test_replicas_on_different_surfaces_are_independent(engine, fraction, side):
    """66 pairs of surfaces; the standard error of the mean correlation is 0.02. Without hashing: 0.2 to 0.6."""
    found = [beta_and_drop(contact_of(surface, fraction, side), engine) for surface in range(SURFACES)]
    assert np.abs(correlation(found)).max() < 0.09


@pytest.mark.long
def test_engines_are_independent_on_one_contact():
    """36 pairs of engines on one surface each; the standard error of the mean correlation is 0.027."""
    kinds = ("rejection-free", "bkl", "next-reaction")
    pairs = [
        correlation([beta_and_drop(contact_of(surface, 0.7), kind) for kind in kinds]) for surface in range(SURFACES)
    ]
    assert np.abs(np.mean(pairs, axis=0)).max() < 0.12


def test_loads_temperatures_and_chemistries_are_independent_on_one_surface():
    light, heavy = contact_of(0, 0.6), contact_of(0, 0.7)
    runs = [
        beta_and_drop(light),
        beta_and_drop(heavy),
        beta_and_drop(heavy, temperature=301.0),
        beta_and_drop(heavy, chemistry=SILICA.replace(activation_volume="0.041 eV/GPa")),
    ]
    # 6 pairs of 40 replicas: 4.5 standard errors
    assert np.abs(correlation(runs)).max() < 4.5 / (6 * 39) ** 0.5


def test_what_is_asked_to_be_common_is_common():
    """Full contact under two loads: the same pixels react, over barriers that differ by the pressure alone."""
    loads = [contact_of(0, 1.0), contact_of(1, 1.0)]
    rho = {
        common: correlation([beta_and_drop(one, common=common) for one in loads])[1]
        for common in ("none", "disorder", "all")
    }
    assert abs(rho["none"]) < 0.45
    assert 0.3 < rho["disorder"] < rho["all"]


def test_a_result_says_which_random_numbers_were_common():
    contact = contact_of(0, 0.1)
    engine = ca.engine("bkl")
    for common, words in (
        ("none", "independent of runs with another contact, chemistry, temperature or engine"),
        ("all", "disorder and kinetic noise in common"),
    ):
        made = ca.age(
            contact, SILICA, engine=engine, hold_times=[1.0], temperature=300, replicas=2, seed=7, common=common
        )
        assert made.provenance["common"] == common
        assert made.random_numbers.startswith(f"seed 7, {words}")
    with pytest.raises(InputError, match="common = 'some'"):
        ca.age(contact, SILICA, engine=engine, hold_times=[1.0], temperature=300, common="some")  # pyright: ignore


@pytest.mark.long
def test_runs_that_differ_in_the_rupture_law_alone_have_the_same_bonds():
    """So that laws and speeds are compared on them; a result says that only runs with other bonds are independent."""
    pull = {"distance": 0.6, "bond_stiffness": 10, "transition_distance": 0.05, "points": 2}
    laws = [None, *(ca.rupture("pulled", speed=speed, **pull) for speed in (1.0, 100.0))]
    runs = [
        ca.age(contact_of(0, 0.1), SILICA, engine=ca.engine("bkl"), hold_times=[10.0], temperature=300, replicas=8,
               rupture=law)
        for law in laws
    ]  # fmt: skip
    for one in runs:
        np.testing.assert_array_equal(one.bonds, runs[0].bonds)
        assert "runs with another contact, chemistry, temperature or engine" in one.random_numbers
    peaks = [one.friction_drop[:, -1] for one in runs[1:]]
    assert np.corrcoef(*peaks)[0, 1] > 0.5


def noise_of(contact, chemistry, engine, temperature=300.0) -> list[int]:
    """The seed of the noise that the first replica of a run is given."""
    seeds = []

    class Look:
        @ca.plugin.hookimpl
        def chemage_run_kinetics(self, seed):
            seeds.append(ca.plugin.random.key(seed))

    with ca.plugin.registry.using(ca.plugin.registry.Registry()) as plugins:
        plugins.register(Look(), "look")
        ca.age(contact, chemistry, engine=engine, hold_times=[1e-9], temperature=temperature, replicas=1, seed=1)
    (noise,) = seeds
    return list(noise)


def test_what_does_not_decide_the_bonds_does_not_decide_the_random_numbers():
    contact, engine = contact_of(0, 0.3), ca.engine("next-reaction")
    base = noise_of(contact, SILICA, engine)
    threads = next(name for name in engine.speed_only)
    close, single = (
        contact.model_copy(update={"pressure": pressure})
        for pressure in (contact.pressure * (1 + 1e-12), contact.pressure.astype("f4"))
    )
    assert noise_of(contact, SILICA.replace(bond_force="1 nN", front_factor=0.5), engine) == base
    assert noise_of(contact, SILICA.replace(hardness=4.0), engine) == base
    assert noise_of(contact, SILICA, ca.engine("next-reaction", **{threads: 2})) == base
    assert noise_of(close, SILICA, engine) == base
    assert noise_of(single, SILICA, engine) == base
    assert noise_of(contact, SILICA, engine, 301.0) != base


def test_contacts_without_load_have_random_numbers_too():
    empty = ca.ContactSolution(pressure=np.zeros((3, 5)), load=0.0, pixel_size=1.0, modulus=1.0)
    small = ca.ContactSolution(pressure=np.ones((1, 2)), load=2.0, pixel_size=1.0, modulus=1.0)
    runs = {
        tuple(noise_of(one, SILICA, ca.engine("bkl"), kelvin)) for one in (empty, small) for kelvin in (300.0, 400.0)
    }
    assert len(runs) == 4
