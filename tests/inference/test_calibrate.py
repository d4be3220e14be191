"""Ranks, and what is said of them: uniform where bands hold as often as they say."""

from __future__ import annotations

import numpy as np
import pytest
from inferring import Calibration, ErrorModel, Noise, calibrate, drawn_errors, rank

import chemage as ca

RNG = np.random.default_rng(5)


def test_ranks_of_the_same_distribution_are_uniform_and_bands_that_are_too_narrow_are_seen():
    drawn = RNG.standard_normal((400, 200))
    right = Calibration({"x": np.array([rank(row, RNG.standard_normal(), RNG) for row in drawn])})
    assert right.chance("x") > 0.01
    assert right.coverage("x", 0.9) == pytest.approx(0.9, abs=0.05)
    narrow = Calibration({"x": np.array([rank(row, 2 * RNG.standard_normal(), RNG) for row in drawn])})
    assert narrow.chance("x") < 1e-3
    assert narrow.coverage("x", 0.9) < 0.75


def test_the_rank_among_equal_values_is_random():
    ranks = [rank(np.zeros(99), 0.0, RNG) for _ in range(500)]
    assert np.mean(ranks) == pytest.approx(0.5, abs=0.05)
    assert (min(ranks), max(ranks)) == pytest.approx((0, 1), abs=0.05)


def test_drawn_errors_are_those_of_the_model():
    size = 4000
    noise = Noise(ErrorModel(correlated=True), np.full(size, 2.0), np.zeros(size), np.zeros(size, dtype=np.int64),
                  np.exp(0.1 * np.arange(size)), np.zeros(1, dtype=np.int64))  # fmt: skip
    values, state = drawn_errors(noise, np.zeros(size), RNG)
    assert values.std() == pytest.approx(2.0, rel=0.3)
    near = np.corrcoef(values[1:], values[:-1])[0, 1]
    assert near == pytest.approx(np.exp(-0.1 / np.exp(state.log_time)), abs=0.1)
    white = noise.white(state, values)
    assert white.std() == pytest.approx(1.0, rel=0.1)
    zero = np.zeros(9)
    noise = Noise(
        ErrorModel(calibration=0.1), zero + 1e-9, zero, zero.astype(np.int64), zero + 1, np.zeros(1, dtype=np.int64)
    )
    values, state = drawn_errors(noise, np.ones(9), RNG)
    assert values == pytest.approx(np.full(9, np.exp(state.nuisances[0])))


def test_a_scene_with_an_interaction_is_refused():
    curve = ca.MeasuredCurve(load=50.0, temperature=300.0, hold_times=[1, 100], values=[1, 2], errors=[0.1, 0.1])
    with pytest.raises(ca.InputError, match="leave out \\[interaction\\] for the calibration"):
        calibrate([curve], "silica-tip")
