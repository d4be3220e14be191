"""The error of a difference between results whose replicas share random numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from chemage import Aging, InputError
from chemage.ageing.fitting import Difference, paired_difference

TIMES = np.geomspace(1.0, 1e5, 21)


def aged(bonds: np.ndarray) -> Aging:
    count = len(bonds)
    fixed: dict[str, Any] = {"hold_times": TIMES, "load": 1e3, "temperature": 300.0, "bond_force": 3.0}
    return Aging(bonds=bonds, sites=np.full(count, 10**6), events=np.zeros(count, np.int64), **fixed)


def bonds(rng: np.random.Generator, replicas: int, rate: float, shared: np.ndarray | None = None) -> np.ndarray:
    """Logarithmic ageing, with a slope and an offset of its own for each replica, and noise."""
    slopes = rate + (rng.normal(0, 0.05 * rate, replicas) if shared is None else shared)
    curves = 2e4 + slopes[:, None] * np.log10(TIMES) + rng.normal(0, 5.0, (replicas, TIMES.size))
    return np.rint(curves).astype(np.int64)


@pytest.mark.parametrize("replicas", [2, 3, 10, 25])
def test_error_is_that_of_the_mean_of_paired_slopes(replicas: int):
    """A line with equal weights is linear in the data, so that the jackknife has a closed form: s/√R."""
    rng = np.random.default_rng(replicas)
    first, second = bonds(rng, replicas, 500.0), bonds(rng, replicas, 520.0)
    use = (TIMES >= 10 * (1 - 1e-9)) & (TIMES <= 1e4 * (1 + 1e-9))
    slopes = [np.polyfit(np.log10(TIMES[use]), one[:, use].T * 3.0 / 1e3, 1)[0] for one in (first, second)]
    each = slopes[0] - slopes[1]
    found = paired_difference(aged(first), aged(second), window=(10.0, 1e4))
    assert found.value == pytest.approx(each.mean(), rel=1e-9)
    assert found.stderr == pytest.approx(each.std(ddof=1) / math.sqrt(replicas), rel=1e-9)
    low, high = stats.ttest_1samp(each, 0.0).confidence_interval(0.95)
    assert found.half_width == pytest.approx(0.5 * (high - low), rel=1e-9)


def test_what_replicas_share_does_not_count():
    rng = np.random.default_rng(5)
    shared = rng.normal(0, 50.0, 10)
    first, second = aged(bonds(rng, 10, 500.0, shared)), aged(bonds(rng, 10, 510.0, shared))
    found = paired_difference(first, second)
    value, error = found.value, found.stderr
    fits = first.fit(), second.fit()
    assert value == pytest.approx(fits[0].beta - fits[1].beta, rel=1e-12)
    assert error < 0.1 * math.hypot(fits[0].beta_stderr, fits[1].beta_stderr)
    assert abs(value + 0.03) < 5 * error
    assert paired_difference(first, first) == Difference(0.0, 0.0, 0.0)


@pytest.mark.long
def test_independent_replicas_have_the_errors_of_both():
    """Over many pairs of independent results, the error is √(σ₁² + σ₂²) on average."""
    rng = np.random.default_rng(11)
    ratios = []
    for _ in range(40):
        first, second = aged(bonds(rng, 12, 500.0)), aged(bonds(rng, 12, 500.0))
        both = math.hypot(first.fit().beta_stderr, second.fit().beta_stderr)
        ratios.append(paired_difference(first, second).stderr / both)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)


def test_one_replica_has_no_error_and_unequal_numbers_no_pairs():
    rng = np.random.default_rng(2)
    one, other = aged(bonds(rng, 1, 500.0)), aged(bonds(rng, 1, 510.0))
    found = paired_difference(one, other)
    assert found.value == pytest.approx(one.fit().beta - other.fit().beta)
    assert math.isnan(found.stderr)
    assert math.isnan(found.half_width)
    with pytest.raises(InputError, match="1 and 3 replicas cannot be paired"):
        paired_difference(one, aged(bonds(rng, 3, 500.0)))
