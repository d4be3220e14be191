"""Sampling: exact along lines, the same with the same seed, honest of its own convergence; and barriers outside of what
hold times reach: any share of them, and what the measurements still say of them."""

from __future__ import annotations

import numpy as np
import pytest

from chemage.inference.energies import EnergyGrid
from chemage.inference.kernels import (
    drawn,
    edge_integral,
    log_misfit,
    log_priors,
    moved,
    piece,
    scaled_erfc,
    solved,
    solved_twice,
)
from chemage.inference.problem import LEVEL, Data, Hidden, Prior, Problem, Unknowns, redrawn_outside
from chemage.inference.sampling import Chain, convergence, sample

NODES = 0.7 + 0.02 * np.arange(12)
GRID, FIRST = EnergyGrid(0.6, 0.02, 50), 15


def problem(values=(2.0, 1.0), errors=(0.2, 0.1), nodes=NODES):
    matrix = np.random.default_rng(3).uniform(0.2, 1.0, (1, len(values), nodes.size)) / nodes.size
    areas = np.full(nodes.size, 0.02)
    return Problem(Prior(nodes), areas, np.array(values), np.array(errors), matrix, np.zeros((1, len(values))))


@pytest.mark.parametrize(
    ("a", "b", "low", "high"), [(2.0, 1.0, -1.0, 3.0), (2.0, 5.0, 1.0, 4.0), (0.5, -9.0, -2.0, 1.0)]
)
def test_the_integral_of_a_piece_is_that_of_a_quadrature(a, b, low, high):
    from scipy.integrate import quad

    expected = quad(lambda x: np.exp(-0.5 * (a * x * x + 2 * b * x + 3.0)), low, high)[0]
    assert piece(a, b, 3.0, low, high) == pytest.approx(np.log(expected), abs=1e-7)


def test_pieces_far_in_the_tail_and_without_an_end_stay_numbers():
    assert np.isfinite(piece(1.0, 1e4, 0.0, 0.0, np.inf))
    assert np.isfinite(piece(1.0, -1e4, 0.0, -np.inf, 0.0))
    assert edge_integral(0.0, 1.0, np.inf) == pytest.approx(np.sqrt(np.pi / 2))
    assert scaled_erfc(30.0) == pytest.approx(1 / (30 * np.sqrt(np.pi)), rel=1e-3)
    assert scaled_erfc(5.999999) == pytest.approx(scaled_erfc(6.000001), rel=1e-5)


def test_numbers_drawn_from_a_piece_have_its_quantiles():
    from scipy.stats import truncnorm

    uniform = np.linspace(0.01, 0.99, 25)
    for low, high, mean in ((-1.0, 2.0, 0.5), (1.0, 3.0, 0.0), (-3.0, -1.0, 0.0)):
        found = [drawn(1.0, -mean, low, high, one) for one in uniform]
        expected = truncnorm.ppf(uniform, low - mean, high - mean) + mean
        if mean >= high:  # drawn from the edge where the density is highest
            expected = expected[::-1]
        assert np.sort(found) == pytest.approx(np.sort(expected), abs=1e-6)


def test_the_kernels_of_the_choice_agree_with_numpy():
    prior = Prior(NODES)
    rng = np.random.default_rng(2)
    x = LEVEL + rng.standard_normal(12)
    every = np.arange(len(prior.combinations))
    away, covariances = x - LEVEL, [prior.covariance(choice) for choice in range(every.size)]
    logs = [-0.5 * np.linalg.slogdet(c)[1] - 0.5 * away @ np.linalg.solve(c, away) for c in covariances]
    assert log_priors(x, LEVEL, every, *prior.precisions) == pytest.approx(logs, rel=1e-6)
    factor = np.linalg.cholesky(np.cov(rng.standard_normal((12, 40))))
    goals = rng.standard_normal((3, 12))
    assert solved(factor, goals) == pytest.approx(np.linalg.solve(factor.T, goals.T).T)
    expected = np.linalg.solve(factor @ factor.T, goals[0])
    assert solved_twice(factor[None], goals[0]) == pytest.approx(expected[None])
    made = problem()
    matrix, target = made.matrices[0].T / made.errors, made.values / made.errors
    expected = -0.5 * np.sum((np.maximum(x, 0) @ matrix - target) ** 2)
    assert log_misfit(x, np.ascontiguousarray(matrix), target, made.areas, 100.0) == pytest.approx(expected)
    assert log_misfit(x, np.ascontiguousarray(matrix), target, made.areas, 0.001) == -np.inf


def test_a_choice_that_is_the_only_candidate_changes_nothing():
    prior, made = Prior(NODES), problem()
    x = LEVEL + np.random.default_rng(2).standard_normal(12)
    before = x.copy()
    factors = np.linalg.cholesky(prior.precisions[0])
    means = np.full((len(factors), 12), LEVEL)
    matrix, target = np.ascontiguousarray(made.matrices[0].T / made.errors), made.values / made.errors
    one, zero = np.array([7]), np.zeros(1)
    rest = (matrix, target, made.areas, 100.0, zero)
    assert moved(x, 7, LEVEL, one, means, factors, *prior.precisions, *rest) == 7
    assert np.array_equal(x, before)


def test_combinations_that_tell_nothing_are_left_out_of_the_lines_only():
    """A measurement that repeats another adds no combination of the density."""
    made = problem(values=(2.0, 2.0, 1.0), errors=(0.2, 0.2, 0.1))
    made.matrices[0, 1] = made.matrices[0, 0]
    chain = Chain(made, np.ones(12), np.random.default_rng(0))
    matrix, values, _ = chain._rotated(0)
    assert matrix.shape == (12, 2)
    x = np.linspace(0.1, 2.0, 12)
    full = made.matrices[0] @ x / made.errors - made.values / made.errors
    assert np.sum((x @ matrix - values) ** 2) == pytest.approx(np.sum(full**2))


@pytest.mark.long
def test_samples_have_the_means_of_the_posterior():
    """Against importance sampling of the prior, of which some hundred thousand samples are enough for few values."""
    made = problem(nodes=NODES[:4], values=(1.1,), errors=(0.3,))
    found = sample(made, np.ones(4), samples=3000, seed=1)
    rng = np.random.default_rng(5)
    draws, weights = [], []
    for choice in range(len(made.prior.combinations)):
        factor = np.linalg.cholesky(made.prior.covariance(choice))
        density = np.maximum(LEVEL + rng.standard_normal((4000, 4)) @ factor.T, 0.0)
        misfit = (made.values - density @ made.matrices[0].T) / made.errors
        mass = density @ made.areas
        draws.append(density)
        weights.append(np.exp(-0.5 * (misfit**2).sum(axis=1)) * (mass <= 1))
    weight, density = np.concatenate(weights), np.concatenate(draws)
    expected = weight @ density / weight.sum()
    assert found.densities.mean(axis=0) == pytest.approx(expected, rel=0.08)
    zero = weight @ (density == 0) / weight.sum()
    assert np.mean(found.densities == 0, axis=0) == pytest.approx(zero, abs=0.04)


def test_the_same_seed_gives_the_same_samples_and_none_has_an_integral_above_one():
    made = problem(values=(30.0, 30.0))
    first, again = (sample(made, np.ones(12), samples=60, seed=4).densities for _ in range(2))
    assert np.array_equal(first, again)
    assert (first @ made.areas < 1.02).all()
    assert (first >= 0).all()


@pytest.mark.long
def test_a_scalar_on_a_grid_moves_to_the_values_that_fit():
    """Two conditions whose ratio depends on the scalar alone."""
    nodes = NODES[:3]
    ratio = np.linspace(0.5, 1.5, 11)
    matrices = np.stack([np.stack([np.ones(3), r * np.ones(3)]) / 3 for r in ratio])
    beside = np.stack([np.maximum(np.arange(11) - 1, 0), np.minimum(np.arange(11) + 1, 10)], axis=1)
    made = Problem(
        Prior(nodes), np.full(3, 0.02), np.array([2.0, 2.4]), np.array([0.05, 0.05]), matrices, np.zeros((11, 2)),
        Unknowns({"ratio": ratio}, beside),
    )  # fmt: skip
    found = sample(made, np.full(3, 2.0), samples=600, seed=2)
    values = ratio[found.points]
    assert values.mean() == pytest.approx(1.2, abs=0.04)
    assert 0.02 < values.std() < 0.12


def test_chains_that_differ_are_seen():
    rng = np.random.default_rng(0)
    same = rng.standard_normal((2, 500, 3))
    assert convergence(same)[1] < 1.02
    assert convergence(same)[0] > 600
    assert convergence(same + np.array([0.0, 2.0])[:, None, None])[1] > 1.3
    assert convergence(np.zeros((2, 100, 3))) == (200.0, 1.0)


def test_any_share_of_the_sites_may_lie_below_an_energy_and_none_is_lost():
    hidden = Hidden(GRID, FIRST, GRID.count)
    shares = np.full(2000, 0.7)
    densities = hidden.redrawn(np.ones((2000, GRID.count)), shares, np.random.default_rng(1))
    assert np.array_equal(densities[:, :FIRST], np.ones((2000, FIRST)))
    assert hidden.integral(densities) == pytest.approx(shares, rel=1e-9)
    middle = (FIRST + GRID.count) // 2
    below = densities[:, FIRST:middle] @ GRID.areas[FIRST:middle] / 0.7
    assert below.mean() == pytest.approx(0.5, abs=0.03)
    assert np.quantile(below, [0.1, 0.9]) == pytest.approx([0, 1], abs=0.01)


def test_all_sites_are_somewhere_and_those_seen_stay():
    rng = np.random.default_rng(2)
    smooth = rng.uniform(0, 1, (300, GRID.count))
    seen = (np.arange(GRID.count) > 10) & (np.arange(GRID.count) < 20)
    densities = redrawn_outside(GRID, seen, smooth, rng)
    assert np.array_equal(densities[:, seen], smooth[:, seen])
    redrawn = (densities != smooth).any(axis=1)
    assert 0.67 < redrawn.mean() < 0.83
    assert densities[redrawn] @ GRID.areas == pytest.approx(1.0)
    assert densities[:, :11] @ GRID.areas[:11] == pytest.approx(smooth[:, :11] @ GRID.areas[:11])


def test_an_upper_end_of_90_percent_is_held_by_all_sites_in_one_narrow_peak(monkeypatch):
    """No density that ages linearly first gives more later: 5 % of the samples must be such peaks, 10 % to be sure."""
    monkeypatch.setattr("chemage.inference.problem.MOVES", 300)
    kt, count = 0.04, 1000
    rates = np.exp(-(GRID.nodes - 0.9) / kt) * GRID.areas
    data = Data(
        rates[None, None] / 0.003,
        np.zeros(count, dtype=np.int64),
        np.ones(count),
        np.array([33.3]),
        np.zeros((1, 1)),
        kt,
    )
    seen = np.arange(GRID.count) < FIRST
    found = redrawn_outside(GRID, seen, np.zeros((count, GRID.count)), np.random.default_rng(6), data)
    # a peak with exp(−(E − 0.9 eV)/k_BT) = 0.1 lies at 0.99 eV; up to 0.02 eV wide, it ends at 1.05 eV
    below = found @ (GRID.areas * (GRID.nodes < 1.05))
    assert (below > 0.99).mean() > 0.1


@pytest.mark.long
def test_peaks_have_the_posterior_of_importance_sampling(monkeypatch):
    """One measurement of the sum of share × exp(−E/k_BT), as linear ageing gives it; 100,000 draws of the prior."""
    monkeypatch.setattr("chemage.inference.problem.MOVES", 400)
    kt = 0.04
    rates = np.exp(-(GRID.nodes - 0.9) / kt) * GRID.areas
    hidden, count = Hidden(GRID, FIRST, GRID.count), 1500
    data = Data(
        rates[None, None] / 0.02, np.zeros(count, dtype=np.int64), np.ones(count), np.array([5.0]), np.zeros((1, 1)), kt
    )
    empty = np.zeros((count, GRID.count))
    found = hidden.redrawn(empty, np.ones(count), np.random.default_rng(3), data)
    prior = hidden.redrawn(np.zeros((100_000, GRID.count)), np.ones(100_000), np.random.default_rng(4))
    weight = np.exp(-0.5 * ((prior @ rates - 0.1) / 0.02) ** 2)
    weight /= weight.sum()
    assert 1 / (weight**2).sum() > 1000
    for end in (22, 26, 30, 40):
        below, expected = (one[:, :end] @ GRID.areas[:end] for one in (found, prior))
        assert below.mean() == pytest.approx(weight @ expected, abs=0.03)
        assert (below > 0.9).mean() == pytest.approx(weight @ (expected > 0.9), abs=0.04)
