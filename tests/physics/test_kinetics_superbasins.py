"""The absorbing two-state chain: against its closed forms, the master equation and the plain engines."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
import pytest
from flickering import random_hold
from scipy import stats
from scipy.linalg import expm

import chemage
from chemage import ReactionLattice
from chemage.plugin import KB
from chemage_kinetics._common import gamma, sojourn

CHANCE = 1e-5
#: quick tests attack the others with this option as well, on random lattices
ENGINES = ["next-reaction", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("rejection-free", "bkl"))]


@nb.njit
def _many(draws, here, there, leave_here, leave_there, span):
    rng = np.zeros(5, np.uint64)
    rng[2] = np.uint64(999)
    out = np.empty((draws, 5))
    for i in range(draws):
        rng[3] = np.uint64(i)
        rng[4] = np.uint64(0)
        spent, exited, other, out_here, out_there = sojourn(rng, here, there, leave_here, leave_there, span)
        out[i] = (spent, 1.0 if exited else 0.0, 1.0 if other else 0.0, out_here, out_there)
    return out


@nb.njit
def _gammas(draws, shape):
    rng = np.zeros(5, np.uint64)
    out = np.empty(draws)
    for i in range(draws):
        rng[3] = np.uint64(i)
        rng[4] = np.uint64(0)
        out[i] = gamma(rng, shape)
    return out


def _z(values: np.ndarray, expected: float) -> float:
    return float((values.mean() - expected) / (values.std(ddof=1) / math.sqrt(values.size)))


@pytest.mark.parametrize("shape", [1.0, 2.0, 37.0, 1e6, 1e15])
def test_gamma_variates_are_gamma_variates(shape):
    assert stats.kstest(_gammas(20_000, shape), stats.gamma(shape).cdf).pvalue > CHANCE


@pytest.mark.long
@pytest.mark.parametrize(
    ("here", "there", "leave_here", "leave_there"),
    [(50.0, 80.0, 0.5, 0.1), (1e6, 3e3, 0.2, 0.7), (4.0, 1e5, 0.0, 2.0), (30.0, 20.0, 1.5, 0.0)],
)
def test_exits_of_the_chain_follow_its_closed_form(here, there, leave_here, leave_there):
    """Without a time limit: mean time, state at the exit and flips follow from the fundamental matrix of the chain."""
    out = _many(40_000, here, there, leave_here, leave_there, 1e9)
    assert np.all(out[:, 1] == 1.0)
    rates = np.array([[-(here + leave_here), there], [here, -(there + leave_there)]])
    sojourns = np.linalg.solve(-rates, [1.0, 0.0])  # mean time in each state
    assert abs(_z(out[:, 0], sojourns.sum())) < 4.5
    assert abs(_z(out[:, 3], here * sojourns[0])) < 4.5
    assert abs(_z(out[:, 4], there * sojourns[1])) < 4.5
    assert abs(out[:, 2].mean() - leave_there * sojourns[1]) < 4.5 * 0.5 / math.sqrt(out.shape[0])
    assert np.array_equal(out[:, 3] - out[:, 4], out[:, 2])


@pytest.mark.long
@pytest.mark.parametrize("span", [0.003, 0.04, 0.5, 4.0])
@pytest.mark.parametrize(
    ("here", "there", "leave_here", "leave_there"),
    [(300.0, 200.0, 0.5, 0.1), (3e4, 40.0, 0.2, 0.3), (90.0, 90.0, 0.0, 0.0)],
)
def test_a_sojourn_cut_short_is_in_the_right_state(here, there, leave_here, leave_there, span):
    """Cut at ``span``: present state, other state or gone, by matrix exponential; flips by its integral."""
    draws = 20_000
    out = _many(draws, here, there, leave_here, leave_there, span)
    matrix = np.zeros((5, 5))  # present state, other state, gone, ∫ flips out of each
    matrix[:2, :2] = [[-(here + leave_here), there], [here, -(there + leave_there)]]
    matrix[2, :2] = leave_here, leave_there
    matrix[3, 0], matrix[4, 1] = here, there
    expected = expm(matrix * span)[:, 0]
    gone = out[:, 1] == 1.0
    seen = np.array([np.sum(~gone & (out[:, 2] == 0)), np.sum(~gone & (out[:, 2] == 1)), gone.sum()])
    keep = expected[:3] > 0
    assert seen[~keep].sum() == 0
    assert stats.chisquare(seen[keep], draws * expected[:3][keep] / expected[:3].sum()).pvalue > CHANCE
    assert abs(_z(out[:, 3], expected[3])) < 4.5
    assert abs(_z(out[:, 4], expected[4])) < 4.5
    assert np.all(out[~gone, 0] == span)
    assert np.all(out[gone, 0] <= span)


@pytest.mark.long
@pytest.mark.parametrize("flips", [1e12, 1e17, 1e24])
def test_more_flips_than_a_double_can_count_leave_the_stationary_state(flips):
    here, there = flips, flips / 4.0
    out = _many(4000, here, there, 0.0, 0.0, 1.0)
    assert abs(out[:, 2].mean() - 0.8) < 4.5 * math.sqrt(0.16 / 4000)
    assert np.allclose(out[:, 3], here * there / (here + there), rtol=1e-5)


def single(energy: float) -> float:
    """As a coupling in single precision, which is what interactions give and kernels are compiled for."""
    return float(np.float32(energy))


def trio(flicker: float, others: float) -> tuple[ReactionLattice, np.ndarray, float]:
    """Three sites in a row, the middle one flipping ``flicker`` times a second, its neighbours ``others`` times.

    Returns the lattice, the matrix of its master equation and the temperature.
    """
    temperature, nu = 300.0, 1e13

    def barrier(rate: float) -> float:
        return KB * temperature * math.log(nu / rate)

    forming = np.array([barrier(2.0 * others), barrier(flicker), barrier(0.7 * others)])
    breaking = np.array([barrier(0.5 * others), barrier(1.7 * flicker), barrier(0.4 * others)])
    left, right = single(0.03), single(-0.02)
    lattice = ReactionLattice(
        pixels=(1, 3),
        sites=[0, 1, 2],
        forming=forming,
        breaking=breaking,
        neighbours=[[1, -1], [0, 2], [1, -1]],
        coupling=np.array([[left, 0], [left, right], [right, 0]], np.float32),
    )
    pairs = np.array([[0, left, 0], [left, 0, right], [0, right, 0]])
    matrix = np.zeros((8, 8))
    for state in range(8):
        bonded = np.array([state >> i & 1 for i in range(3)], bool)
        for i in range(3):
            energy = breaking[i] if bonded[i] else forming[i] + pairs[i][bonded].sum()
            rate = nu * math.exp(-max(energy, 0.0) / (KB * temperature))
            matrix[state ^ 1 << i, state] += rate
            matrix[state, state] -= rate
    return lattice, matrix, temperature


@pytest.mark.parametrize(
    ("kind", "flicker"),
    [
        ("next-reaction", 3000.0),
        pytest.param("rejection-free", 3000.0, marks=pytest.mark.long),
        pytest.param("bkl", 3000.0, marks=pytest.mark.long),
        pytest.param("next-reaction", 40.0, marks=pytest.mark.long),
        pytest.param("rejection-free", 40.0, marks=pytest.mark.long),
        pytest.param("bkl", 40.0, marks=pytest.mark.campaign),
    ],
)
def test_the_acceleration_follows_the_master_equation(kind, flicker):
    lattice, matrix, temperature = trio(flicker, 1.0)
    engine = chemage.engine(kind, superbasins=True)
    times, runs = np.array([0.02, 0.3, 0.3, 2.0]), 800
    seen = np.zeros((times.size, 8))
    bonds = np.zeros((times.size, 4))
    formed = np.empty(runs)
    for seed in range(runs):
        history = engine.run(lattice, times, temperature=temperature, seed=seed)
        for t, count in enumerate(history.bonds):
            bonds[t, count] += 1
        seen[-1, history.state @ [1, 2, 4]] += 1
        formed[seed] = history.formed[-1]
    number = np.array([bin(state).count("1") for state in range(8)])
    for t, time in enumerate(times):
        probability = expm(matrix * time)[:, 0]
        expected = np.bincount(number, probability, minlength=4)
        pooled = expected * runs >= 5
        o = np.append(bonds[t][pooled], bonds[t][~pooled].sum())
        e = np.append(expected[pooled], expected[~pooled].sum()) * runs
        assert stats.chisquare(o[e > 0], e[e > 0]).pvalue > CHANCE, f"{time} s"
    assert stats.chisquare(seen[-1], runs * expm(matrix * times[-1])[:, 0]).pvalue > CHANCE
    forming = np.array(
        [sum(matrix[state ^ 1 << i, state] for i in range(3) if not state >> i & 1) for state in range(8)]
    )
    augmented = np.zeros((9, 9))
    augmented[:8, :8], augmented[8, :8] = matrix, forming
    assert abs(_z(formed, expm(augmented * times[-1])[8, 0])) < 4.5


@pytest.mark.long
def test_the_acceleration_follows_the_master_equation_beside_a_list_of_fast_sites(monkeypatch):
    """As on a large lattice: one trio that flickers beside three that do not."""
    monkeypatch.setattr("chemage_kinetics._rejection_free.FAR", 9)
    hot, hot_matrix, temperature = trio(3000.0, 1.0)
    calm, calm_matrix, _ = trio(3.0, 1.0)
    trios = [calm, hot, calm, calm]
    lattice = ReactionLattice(
        pixels=(4, 3),
        sites=np.arange(12),
        forming=np.concatenate([t.forming for t in trios]),
        breaking=np.concatenate([t.breaking for t in trios]),
        neighbours=np.concatenate([np.where(t.neighbours < 0, -1, t.neighbours + 3 * i) for i, t in enumerate(trios)]),
        coupling=np.concatenate([t.coupling for t in trios]),
    )
    engine = chemage.engine("rejection-free", superbasins=True)
    runs, time = 3000, 0.4
    seen = np.zeros((4, 8))
    for seed in range(runs):
        first = engine.run(lattice, [0.1], temperature=temperature, seed=seed)
        history = engine.run(lattice, [time], temperature=temperature, seed=seed, start=first)
        for i, state in enumerate(history.state.reshape(4, 3) @ [1, 2, 4]):
            seen[i, state] += 1
    for i, matrix in enumerate([calm_matrix, hot_matrix, calm_matrix, calm_matrix]):
        expected = runs * expm(matrix * time)[:, 0]
        assert stats.chisquare(seen[i], expected).pvalue > CHANCE
    assert history.events > 300  # the flips that were not followed one by one are counted


@pytest.mark.parametrize(("forms", "breaks", "slow", "pair"), [(-0.3, 0.288, 0.524, 0.272), (0.0, 0.35, 0.55, 0.25)])
@pytest.mark.parametrize("kind", ["rejection-free", pytest.param("bkl", marks=pytest.mark.long), "next-reaction"])
def test_a_neighbour_reacts_out_of_the_common_state_too(kind, forms, breaks, slow, pair):
    """A site that is nearly always bonded, and a neighbour that is thousands of times faster while it is not: unbonded
    at two mean lifetimes with the probability exp(-2). `bkl` gave .337 and .777, because it attempted the neighbour at
    the rate of the common state and accepted it by the bound of the other."""
    temperature, pair, runs = 300.0, single(pair), 400

    def rate(energy: float) -> float:
        return 1e13 * math.exp(-max(energy, 0.0) / (KB * temperature))

    lattice = ReactionLattice(
        pixels=(1, 2),
        sites=[0, 1],
        forming=[forms, slow],
        breaking=[breaks, 3.0],
        neighbours=[[1], [0]],
        coupling=np.array([[pair], [pair]], np.float32),
    )
    bonded = rate(forms) / (rate(forms) + rate(breaks))
    lifetime = 1.0 / (bonded * rate(slow + pair) + (1.0 - bonded) * rate(slow))
    engine = chemage.engine(kind, superbasins=True)
    ends = [engine.run(lattice, [2.0 * lifetime], temperature=temperature, seed=s).state[1] for s in range(runs)]
    assert stats.binomtest(runs - int(sum(ends)), runs, math.exp(-2.0)).pvalue > CHANCE


@pytest.mark.parametrize("kind", ENGINES)
def test_the_cost_does_not_depend_on_the_number_of_flips(kind):
    """A thousand million flips between two events of the neighbours; followed one by one they would take minutes."""
    lattice, _, temperature = trio(1e9, 1.0)
    history = chemage.engine(kind, superbasins=True).run(lattice, [1.0, 2.0, 50.0], temperature=temperature, seed=1)
    expected = 50.0 * 1e9 * 1.7 / 2.7
    assert 0.5 * expected < history.formed[-1] < 2.0 * expected
    assert history.formed[-1] - history.broken[-1] == history.bonds[-1] == history.state.sum()


@pytest.mark.parametrize("kind", ENGINES)
def test_the_acceleration_changes_nothing_where_nothing_flickers(kind):
    lattice, _, temperature = trio(0.5, 1.0)
    times = [0.5, 3.0, 9.0]
    for seed in range(40):
        plain = chemage.engine(kind).run(lattice, times, temperature=temperature, seed=seed)
        fast = chemage.engine(kind, superbasins=True).run(lattice, times, temperature=temperature, seed=seed)
        assert plain.formed.tolist() == fast.formed.tolist()
        assert plain.state.tolist() == fast.state.tolist()


@pytest.mark.parametrize("kind", ENGINES)
def test_a_site_that_soon_leaves_the_state_in_which_others_are_fast_is_followed(kind):
    """Its neighbour forms 40 times faster than the site breaks, but only in the 0.1 ps for which it is unbonded."""
    hold = random_hold(31, 1, 2, flips=1e25)
    states = [
        chemage.engine(kind, superbasins=True)
        .run(hold.group.lattice(1), [hold.time], temperature=hold.temperature, seed=seed)
        .state.all()
        for seed in range(200)
    ]
    assert stats.binomtest(int(np.sum(states)), 200, float(hold.probabilities[3])).pvalue > CHANCE


@pytest.mark.parametrize("kind", ENGINES)
def test_a_restart_is_exact_with_the_acceleration(kind):
    lattice, _, temperature = trio(400.0, 1.0)
    engine = chemage.engine(kind, superbasins=True)
    times = [0.0, 0.01, 0.4, 0.4, 3.0, 20.0]
    for seed in range(20):
        whole = engine.run(lattice, times, temperature=temperature, seed=seed)
        for cut in range(1, len(times)):
            first = engine.run(lattice, times[:cut], temperature=temperature, seed=seed)
            rest = engine.run(lattice, times[cut:], temperature=temperature, seed=seed, start=first)
            assert np.concatenate([first.formed, rest.formed]).tolist() == whole.formed.tolist()
            assert rest.state.tolist() == whole.state.tolist()


@pytest.mark.parametrize("kind", ENGINES)
def test_hot_sites_hold_for_thirty_years(kind):
    """1e9 s at 1000 K: one site flips 1e17 times, the rest hardly; all are still in equilibrium with each other."""
    temperature, nu = 1000.0, 1e13
    unit = KB * temperature
    cold = unit * math.log(nu * 1e8)  # crossed once in 1e8 s
    forming = np.array([cold, 1.0, cold + 0.02])
    breaking = np.array([cold + 0.05, 1.05, cold])
    pair = single(0.06)
    lattice = ReactionLattice(
        pixels=(3, 1),
        sites=[0, 1, 2],
        forming=forming,
        breaking=breaking,
        neighbours=[[1, -1], [0, 2], [1, -1]],
        coupling=np.array([[pair, 0], [pair, pair], [pair, 0]], np.float32),
    )
    bonded = (np.arange(8)[:, None] >> np.arange(3)) & 1
    energy = bonded @ (forming - breaking) + pair * (bonded[:, 0] * bonded[:, 1] + bonded[:, 1] * bonded[:, 2])
    weights = np.exp(-energy / unit)
    engine = chemage.engine(kind, superbasins=True)
    runs = 600
    seen = np.zeros(8)
    for seed in range(runs):
        history = engine.run(lattice, [1.0, 1e9], temperature=temperature, seed=seed)
        seen[history.state @ [1, 2, 4]] += 1
    assert history.events > 1e16
    assert stats.chisquare(seen, runs * weights / weights.sum()).pvalue > CHANCE
