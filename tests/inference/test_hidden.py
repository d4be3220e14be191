"""Barriers outside of what hold times reach: any share of them, and what the measurements still say of them."""

from __future__ import annotations

import numpy as np
import pytest

from chemage.inference.energies import EnergyGrid
from chemage.inference.hidden import Data, Hidden, redrawn_outside

GRID = EnergyGrid(0.6, 0.02, 50)
FIRST = 15


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
    monkeypatch.setattr("chemage.inference.hidden.MOVES", 300)
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
    monkeypatch.setattr("chemage.inference.hidden.MOVES", 400)
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
