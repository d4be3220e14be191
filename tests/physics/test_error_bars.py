"""Error bars hold the truth as often as they say; the cases are those of ``tests/benchmarks/error_bars.py``."""

from __future__ import annotations

import error_bars
import numpy as np
import pytest
from scipy import stats

from chemage.plugin import statistics

#: what docs/accuracy.md says holds the truth less often
NARROW = ("skewed", "exponential", "bootstrap")
#: of cases that take longer
TRIALS = {"replicas": 100, "arrhenius": 100}


def campaign(name):
    return pytest.param(name, marks=pytest.mark.campaign)


CASES = [
    "few_sites",
    "measurements",
    "arrhenius",
    "two_levels",
    "sketched",
    "seeds_of_sweeps",
    "observables",
    "grids",
    "one_more_surface",
]


@pytest.mark.parametrize("name", [pytest.param("replicas", marks=pytest.mark.long), *map(campaign, CASES)])
def test_error_bars_hold_the_truth_as_often_as_they_say(name):
    """Not less often than claimed by 2 % and four standard errors of the count."""
    found = error_bars.block(name, 10**6, TRIALS.get(name, 200))
    for bar, (held, trials, claimed) in found.items():
        if not any(words in bar for words in NARROW):
            assert held / trials >= claimed - 0.02 - 4 * np.sqrt(claimed * (1 - claimed) / trials), bar


@pytest.mark.campaign
@pytest.mark.parametrize(("count", "trials"), [(5, 200), (10, 200)])
def test_weights_that_are_estimated_do_not_make_an_activation_energy_too_certain(count, trials):
    """With weights taken as known, 88 % (5 replicas) and 92 % (10) of the intervals held the truth."""
    found = error_bars.block("arrhenius", 10**6 + count, trials)
    held, counted, claimed = found[f"activation energy, {count} replicas"]
    assert held / counted >= 0.93 - 3 * np.sqrt(claimed * (1 - claimed) / counted)


def test_one_factor_is_the_interval_of_student():
    values = np.random.default_rng(1).standard_normal((7, 3))
    assert statistics.crossed_half_width(values, 1) == pytest.approx(statistics.half_width(values), rel=1e-12)
    assert statistics.crossed_half_width(values[:, None], 2) == pytest.approx(statistics.half_width(values), rel=1e-12)


def test_what_is_not_finite_is_left_out():
    values = np.random.default_rng(1).standard_normal((4, 3))
    values[2] = np.nan
    assert statistics.crossed_half_width(values, 1) == pytest.approx(
        statistics.half_width(values[[0, 1, 3]]), rel=1e-12
    )
    assert np.isnan(statistics.crossed_half_width(values[2:], 1)).all()
    assert np.isnan(statistics.crossed_half_width(np.ones((1, 1)), 2))


def test_values_of_one_surface_are_not_independent_of_each_other():
    """Three surfaces with a hundred replicas each are three values, and not three hundred."""
    rng = np.random.default_rng(2)
    values = rng.standard_normal((3, 1)) + 0.01 * rng.standard_normal((3, 100))
    limit = stats.t.ppf(0.975, 2) / np.sqrt(3)
    assert statistics.crossed_half_width(values, 2) == pytest.approx(limit * values.mean(axis=1).std(ddof=1), rel=0.01)
    assert statistics.crossed_half_width(values, 2) > 10 * statistics.half_width(values.ravel())


def test_replicas_that_are_equal_say_nothing_of_their_scatter():
    found = statistics.half_width(np.array([[3, 5, 0], [3, 7, 0]]))
    assert np.isnan(found).tolist() == [True, False, True]
    assert np.isnan(statistics.half_width(np.array([2.0, 2.0, 2.0])))
