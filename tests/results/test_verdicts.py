"""Model against data: the verdict follows from offset, slope and χ², and both kinds of error count."""

from __future__ import annotations

import numpy as np
import pytest
from inferring import Ageing, Curve, result_of, verdict
from made_inference import made_inference

import chemage as ca

TIMES = np.logspace(0, 4, 9)
MODEL = 20 + 10 * np.log10(TIMES)


def result(half=0.0, load=50.0, temperature=300.0):
    curve = Curve("friction_drop", "nN", "ΔF", x=TIMES, mean=MODEL, half_width=np.full(TIMES.size, half))
    return Ageing(load=load, chemistry={"temperature": temperature}), {"friction_drop": curve}


def inferred():
    return result_of(made_inference()).ageing(), {}


def measured(change=lambda values: values, error=1.0, seed=0, **fields):
    noise = (error or 1.0) * np.random.default_rng(seed).standard_normal(TIMES.size)
    errors = None if error is None else np.full(TIMES.size, error)
    return ca.Measurements("afm", TIMES, change(MODEL) + noise, "friction_drop", errors, **fields)


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (lambda v: v, 1.0, "agrees within the errors"),
        (lambda v: 1.5 * v, 1.0, r"differs: the same shape, but measured values are 1\.5"),
        (lambda v: v + 12, 1.0, r"differs: the same shape, but measured values lie 1\d.* nN above it"),
        (lambda v: v + 10 * (TIMES > 100), 0.5, "differs in shape: up to .* the errors are mainly those of the measur"),
        (lambda v: 2 * v, 80.0, "the errors are too large to tell"),
        (lambda v: 2 * v, None, r"measured values are .* times the model.*; the measurements state no errors"),
    ],
)
def test_the_verdict_says_how_they_differ(change, error, says):
    found = verdict(measured(change, error), "run", *result())
    assert __import__("re").search(says, found.verdict), found.verdict


def test_agreement_has_the_chance_that_it_says():
    """χ² of normal errors is χ² distributed, also with an error that all hold times of the model share."""
    chances = []
    for seed in range(300):
        shift = 3 * np.random.default_rng([1, seed]).standard_normal()
        chances.append(verdict(measured(lambda v, s=shift: v + s, seed=seed), "run", *result(half=3 * 1.96)).chance)
    assert np.mean(np.array(chances) < 0.1) == pytest.approx(0.1, abs=0.05)
    without = [verdict(measured(lambda v: v + 3, seed=seed), "run", *result()).chance for seed in range(20)]
    assert max(without) < 1e-3


def test_offset_and_slope_are_those_of_least_squares():
    found = verdict(measured(lambda v: 5 + 1.2 * v), "run", *result())
    slope, offset = np.polyfit(MODEL, found.values, 1)
    assert (found.offset[0], found.slope[0]) == pytest.approx((offset, slope))
    assert found.residuals == pytest.approx(found.values - MODEL)
    assert found.todict()["residuals"] == pytest.approx(found.residuals)


@pytest.mark.parametrize(
    ("data", "beside", "says"),
    [
        (measured(load=80.0), result(), "measured at 80 nN, the result is at 50 nN"),
        (measured(temperature=350.0), result(), "measured at 350 K, the result is at 300 K"),
        (measured(), (Ageing(), {}), "no friction against hold time"),
        (ca.Measurements("m", TIMES * 1e6, MODEL, "friction_drop"), result(), "only 0 hold times in common"),
        (measured(), inferred(), "no load and temperature"),
    ],
)
def test_what_cannot_be_compared_says_why(data, beside, says):
    found = verdict(data, "run", *beside)
    assert found.verdict.startswith("not compared: ")
    assert says in found.verdict
    assert not found.values.size


def test_an_inference_is_judged_at_the_conditions_of_the_data():
    one = made_inference()
    made = one.forecast(load=20.0, temperature=300.0, hold_times=TIMES)
    data = ca.Measurements("other", TIMES, made.median, "friction_drop", 0.03 * made.median, 20.0, 300.0)
    found = verdict(data, "inferred", result_of(one).ageing(), {})
    assert found.verdict == "agrees within the errors"
    assert found.model_errors == pytest.approx(made.samples.std(axis=0, ddof=1))
    off = ca.Measurements("other", TIMES, 2 * made.median, "friction_drop", 0.03 * made.median, 20.0, 300.0)
    assert verdict(off, "inferred", result_of(one).ageing(), {}).verdict.startswith("differs: the same shape")
