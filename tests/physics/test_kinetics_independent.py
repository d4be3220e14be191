"""Sites that do not interact: closed forms, for the engine that uses them and for those that simulate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

import chemage
from chemage import InputError, ReactionLattice
from chemage.plugin import KB, registry

KINDS = registry.current().kinds("engine")
CHANCE = 1e-5
#: hold times at which thousands of sites have mixed states
TIMES = {
    250.0: [1e4, 1e6],
    300.0: [10.0, 300.0, 1e5],
    500.0: [1e-5, 1e-3, 0.1],
    1000.0: [1e-9, 1e-8, 1e-6],
}


def mixed(n: int = 3000, reversible: bool = True) -> ReactionLattice:
    """Barriers .8 to 1.4 eV and breaking around 1.1 eV, nothing coupled."""
    rng = np.random.default_rng(2)
    return ReactionLattice(
        pixels=(n, 1),
        sites=np.arange(n),
        forming=rng.uniform(0.8, 1.4, n),
        breaking=rng.normal(1.1, 0.02, n) if reversible else None,
    )


@pytest.mark.parametrize("temperature", TIMES)
@pytest.mark.parametrize("kind", KINDS)
def test_every_engine_agrees_with_the_exact_mean_and_variance(kind, temperature):
    times = np.array(TIMES[temperature])
    lattice = mixed()
    mean, variance = chemage.engine("independent").mean(lattice, times, temperature=temperature)
    assert np.all(variance > 5.0)  # so that the counts are all but normal
    runs = 12
    bonds = np.array(
        [chemage.engine(kind).run(lattice, times, temperature=temperature, seed=s).bonds for s in range(runs)]
    )
    assert np.all(np.abs(bonds.mean(axis=0) - mean) < 4.5 * np.sqrt(variance / runs))
    spread = (runs - 1) * bonds.var(axis=0, ddof=1) / variance
    assert np.all(spread < stats.chi2.isf(CHANCE, runs - 1))


def test_the_exact_mean_of_one_site_is_the_closed_form():
    temperature, nu = 300.0, 1e13
    lattice = ReactionLattice(pixels=(1, 1), sites=[0], forming=[0.8], breaking=[0.85])
    forms, breaks = (nu * math.exp(-e / (KB * temperature)) for e in (0.8, 0.85))
    times = np.array([0.0, 0.1, 1.0, 7.0, 1e9])
    theta = forms / (forms + breaks) * (1 - np.exp(-(forms + breaks) * times))
    mean, variance = chemage.engine("independent").mean(lattice, times, temperature=temperature)
    assert np.allclose(mean, theta, rtol=1e-10, atol=0)
    assert np.allclose(variance, theta * (1 - theta), rtol=1e-9, atol=1e-15)
    bonded, _ = chemage.engine("independent").mean(lattice, times, temperature=temperature, start=np.array([True]))
    expected = forms / (forms + breaks) + breaks / (forms + breaks) * np.exp(-(forms + breaks) * times)
    assert np.allclose(bonded, expected, rtol=1e-10)


def test_the_rates_of_the_paper_are_reproduced():
    """0.3636, 3.318e-6 and 3.03e-11 per second over 0.8, 1.1 and 1.4 eV at 300 K."""
    for barrier, rate in ((0.8, 0.3636), (1.1, 3.318e-6), (1.4, 3.03e-11)):
        lattice = ReactionLattice(pixels=(1, 1), sites=[0], forming=[barrier])
        mean, _ = chemage.engine("independent").mean(lattice, [1e-6 / rate], temperature=300)
        assert mean[0] / 1e-6 == pytest.approx(1.0, rel=2e-3)


def test_uniform_barriers_age_by_kT_ln10_over_their_width_per_decade():
    """0.0992 bonds a site and decade between 10 and 1e4 s, for the mean and for a sample."""
    n = 400_000
    forming = np.random.default_rng(1).uniform(0.8, 1.4, n)
    lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=forming)
    times = np.geomspace(10.0, 1e4, 13)
    mean, _ = chemage.engine("independent").mean(lattice, times, temperature=300)
    slope = np.polyfit(np.log10(times), mean / n, 1)[0]
    assert slope == pytest.approx(KB * 300 * math.log(10) / 0.6, rel=0.01)
    for kind in ("independent", "rejection-free"):
        bonds = chemage.engine(kind).run(lattice, times, temperature=300, seed=3).bonds
        assert np.polyfit(np.log10(times), bonds / n, 1)[0] == pytest.approx(0.0992, rel=0.01)


@pytest.mark.parametrize("reversible", [True, False])
def test_the_exact_mean_goes_on_from_a_history(reversible):
    """E[N(t)] given the state at 1 s, averaged over states, is the mean from the start."""
    lattice = mixed(500, reversible)
    engine = chemage.engine("independent")
    direct, _ = engine.mean(lattice, [1.0, 100.0], temperature=400)
    given = [
        engine.mean(lattice, [100.0], temperature=400, start=engine.run(lattice, [1.0], temperature=400, seed=s))[0][0]
        for s in range(200)
    ]
    assert abs(np.mean(given) - direct[1]) < 4.5 * max(np.std(given, ddof=1), 1e-9) / math.sqrt(200) + 1e-9


def test_hot_sites_cost_no_more_than_a_few_draws_each():
    """A thousand sites, 1e9 s at 1000 K: more than 1e18 events drawn at once, and the law is the exact one."""
    lattice = mixed(1000)
    times = np.array([1.0, 1e5, 1e9])
    mean, variance = chemage.engine("independent").mean(lattice, times, temperature=1000)
    histories = [chemage.engine("independent").run(lattice, times, temperature=1000, seed=s) for s in range(20)]
    bonds = np.array([history.bonds for history in histories])
    assert np.all(np.abs(bonds.mean(axis=0) - mean) < 4.5 * np.sqrt(variance / 20))
    assert all(history.events > 1e18 for history in histories)
    assert all(history.bonds[-1] == history.state.sum() for history in histories)


def test_more_events_than_can_be_counted_leave_the_bonds_right():
    """Barriers of 0.3 eV for 1e14 s: counts stop at 2**61, and half of the sites stay bonded."""
    tip = chemage.surface("sphere", radius="30 nm", pixels=64, pixel_size="0.4518 nm").make()
    contact = chemage.contact("hertz", modulus="35.3 GPa").solve(tip, load="50 nN")
    barrier = chemage.barriers("gaussian", mean=0.3, std=0)
    ageing = chemage.age(
        contact,
        chemage.chemistry(forming=barrier, breaking=barrier),
        engine=chemage.engine("independent"),
        hold_times=np.array([1.0, 1e14, 2e14]),
        temperature=300.0,
        replicas=20,
    )
    assert ageing.events.tolist() == [2**62] * 20
    sites = int(ageing.sites.sum())
    assert np.all(np.abs(ageing.bonds.sum(axis=0) - sites / 2) < 4.5 * math.sqrt(sites / 4))


def test_a_lattice_that_interacts_is_refused_with_the_reason():
    lattice = ReactionLattice(
        pixels=(2, 1), sites=[0, 1], forming=[1.0, 1.0], neighbours=[[1], [0]], coupling=[[0.1], [0.1]]
    )
    with pytest.raises(InputError, match=r"independent.*couples neighbours"):
        chemage.engine("independent").run(lattice, [1.0], temperature=300)
    with pytest.raises(InputError, match="couples neighbours"):
        chemage.engine("independent").mean(lattice, [1.0], temperature=300)


def test_auto_says_what_it_takes_and_why():
    auto = chemage.engine("auto")
    engine, reason = auto.choose(mixed(10))
    assert engine.kind == "independent"
    assert "no site interacts" in reason
    pairs = 40_000
    near = np.arange(2 * pairs)[:, None] ^ 1
    many = ReactionLattice(
        pixels=(pairs, 2),
        sites=np.arange(2 * pairs),
        forming=np.full(2 * pairs, 1.0),
        neighbours=near,
        coupling=np.full((2 * pairs, 1), 0.1),
    )
    engine, reason = auto.choose(many)
    assert engine.kind == "next-reaction"
    assert "40000 patches holds 2 of 80000" in reason
    ring = ReactionLattice(
        pixels=(6, 1),
        sites=np.arange(6),
        forming=np.ones(6),
        neighbours=(np.arange(6)[:, None] + [1, 5]) % 6,
        coupling=np.full((6, 2), 0.1),
    )
    engine, reason = auto.choose(ring)
    assert engine.kind == "rejection-free"
    assert "sum tree" in reason
    history = auto.run(ring, [1e4], temperature=300, seed=2)
    assert history.notes == (f"engine auto took rejection-free: {reason}",)
    same = chemage.engine("rejection-free").run(ring, [1e4], temperature=300, seed=2)
    assert history.state.tolist() == same.state.tolist()
