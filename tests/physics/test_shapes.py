"""Claims of shape lose against the rivals that an R² lets pass."""

from __future__ import annotations

import numpy as np
import pytest

from chemage_li2018.shapes import exponent, growth

TIMES = np.logspace(0, 5, 21)
WINDOW = (1.0, 1e5)
DECADES = np.log10(TIMES)


def noisy(curve: np.ndarray, bonds: float, count: int = 10, seed: int = 3) -> np.ndarray:
    """Counts whose mean is ``bonds`` times ``curve``, with independent increments, per bond."""
    rng = np.random.default_rng(seed)
    increments = rng.poisson(bonds * np.diff(curve, prepend=0.0), (count, curve.size))
    return increments.cumsum(axis=1) / bonds


def r2(curve: np.ndarray) -> float:
    return float(np.corrcoef(DECADES, curve)[0, 1] ** 2)


FALLING = DECADES - 0.05 * DECADES**2 + 1.0


@pytest.mark.parametrize(("curve", "limit"), [(TIMES**0.05, 0.98), (FALLING, 0.98)], ids=["t^.05", "slope that halves"])
def test_what_passed_as_a_logarithm_is_none(curve, limit):
    assert r2(curve) > limit
    compared = growth(TIMES, noisy(curve, 20_000), WINDOW)
    assert not compared.holds("logarithm")
    assert compared.criterion("logarithm") > 10


@pytest.mark.parametrize("seed", range(5))
def test_a_logarithm_beats_its_rivals(seed):
    compared = growth(TIMES, noisy(1.0 + 0.5 * DECADES, 20_000, seed=seed), WINDOW)
    change, error = compared.change
    assert compared.holds("logarithm")
    assert abs(change) < 4 * error


@pytest.mark.parametrize("power", [0.05, 0.3])
def test_a_power_is_found_with_its_exponent(power):
    compared = growth(TIMES, noisy(TIMES**power, 20_000), WINDOW)
    assert compared.laws[0].name == "power"
    assert compared.laws[0].parameters[1] == pytest.approx(power, abs=0.02)


def test_an_exponent_of_two_thirds_is_not_one():
    loads = np.array([23.0, 50.0, 100.0, 200.0, 393.0])
    assert np.corrcoef(loads, loads ** (2 / 3))[0, 1] ** 2 > 0.95
    rng = np.random.default_rng(1)
    drop = loads ** (2 / 3) * rng.normal(1.0, 0.02, (8, 5))
    assert exponent(loads, drop).holds(2 / 3, 1.0)
    assert not exponent(loads, drop).holds(1.0)
    assert exponent(loads, loads * rng.normal(1.0, 0.02, (8, 5))).holds(1.0, 2 / 3)
