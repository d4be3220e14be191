"""How many samples an accuracy needs: against closed forms and against a search of all numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from chemage.studies.ensembles.quantities import Spread, allocated, half_width


def one(variance: float, freedom: int) -> Spread:
    return Spread(np.array([variance]), freedom)


def test_the_interval_of_one_level_is_students():
    values = np.random.default_rng(1).normal(3.0, 0.2, 12)
    low, high = stats.t.interval(0.95, 11, values.mean(), stats.sem(values))
    found = half_width([one(values.var(ddof=1), 11)], [12], np.zeros(1))
    assert found[0] == pytest.approx((high - low) / 2, rel=1e-12)


def test_the_interval_of_two_levels_is_welchs():
    rng = np.random.default_rng(2)
    a, b = rng.normal(0, 1.0, 9), rng.normal(0, 3.0, 5)
    interval = stats.ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    spreads = [one(a.var(ddof=1), 8), one(b.var(ddof=1), 4)]
    found = half_width(spreads, [9, 5], np.zeros(1))
    assert found[0] == pytest.approx((interval.high - interval.low) / 2, rel=1e-9)


def test_what_is_known_before_is_normal_and_adds_in_squares():
    found = half_width([one(0.0, 5)], [6], np.array([0.3]))
    assert found[0] == pytest.approx(0.3 * stats.norm.ppf(0.975), rel=1e-6)
    assert np.isnan(half_width([one(1.0, 5)], [6], np.array([np.nan]))[0])


@pytest.mark.parametrize(("deviation", "wanted"), [(0.05, 0.02), (0.05, 0.003), (0.2, 0.01)])
def test_one_level_needs_the_number_of_the_textbook(deviation, wanted):
    counts = allocated([one(deviation**2, 10**6)], [1.0], [8], np.zeros(1), np.array([wanted]))
    assert counts is not None
    needed = (stats.norm.ppf(0.975) * deviation / wanted) ** 2
    assert needed <= counts[0] <= 1.12 * needed + 1


def test_two_levels_cost_hardly_more_than_the_cheapest_of_all_numbers():
    spreads, costs, wanted = [one(0.053**2, 40), one(0.006**2, 6)], [0.25, 3.0], 0.01
    counts = allocated(spreads, costs, [10, 5], np.zeros(1), np.array([wanted]))
    assert counts is not None
    assert half_width(spreads, counts, np.zeros(1))[0] <= wanted
    cheapest = math.inf
    for fine in range(5, 40):
        for many in range(10, 600):
            if half_width(spreads, [many, fine], np.zeros(1))[0] <= wanted:
                cheapest = min(cheapest, many * costs[0] + fine * costs[1])
                break
    assert many * costs[0] > 0
    assert sum(n * c for n, c in zip(counts, costs, strict=True)) <= 1.1 * cheapest


def test_a_level_that_is_known_well_enough_is_left_as_it_is():
    counts = allocated([one(1e-2, 50), one(1e-12, 5)], [1.0, 100.0], [10, 5], np.zeros(1), np.array([0.02]))
    assert counts is not None
    assert counts[1] == 5
    assert counts[0] > 50


def test_no_number_is_enough_against_an_error_that_stays():
    assert allocated([one(1e-4, 50)], [1.0], [10], np.array([0.01]), np.array([0.015])) is None


def test_every_quantity_is_accurate_enough():
    spread = Spread(np.array([1e-3, 1e-5, 4e-3]), 30)
    wanted = np.array([0.02, np.inf, 0.02])
    counts = allocated([spread], [1.0], [10], np.zeros(3), wanted)
    assert counts is not None
    assert np.all(half_width([spread], counts, np.zeros(3)) <= wanted)
