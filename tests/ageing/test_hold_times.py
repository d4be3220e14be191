"""Hold times: evenly spaced in log t, with round numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import chemage as ca
from chemage import InputError


def test_hold_times_are_round_decades():
    times = ca.hold_times("1 ms", "1e5 s", per_decade=4)
    assert times.size == 33
    assert times[0] == 1e-3
    assert times[-1] == 1e5
    assert times[::4].tolist() == [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5]
    assert np.allclose(np.diff(np.log10(times)), 0.25, atol=1e-9)


@given(st.floats(1e-12, 1e6), st.floats(1.0, 1e9), st.integers(1, 20))
def test_hold_times_start_stop_and_rise(start, ratio, per_decade):
    times = ca.hold_times(start, start * ratio, per_decade)
    assert times[0] == pytest.approx(start, rel=1e-11)
    assert times[-1] == start * ratio
    assert (np.diff(times) > 0).all()
    steps = np.diff(np.log10(times))
    assert np.allclose(steps[:-1], 1 / per_decade, atol=1e-9)
    assert times.size <= math.log10(ratio) * per_decade + 2.001


def test_hold_times_are_short_decimals():
    # 0.0011 * 100 is 0.11000000000000001
    assert ca.hold_times(0.0011, 110, 1).tolist() == [0.0011, 0.011, 0.11, 1.1, 11, 110]


def test_the_end_is_added_when_it_is_no_step():
    assert ca.hold_times(1, 50, 1).tolist() == [1, 10, 50]
    assert ca.hold_times(2, 2).tolist() == [2]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((0, 1), "start = 0: must be above zero; hold times are spaced in log t"),
        ((-1, 1), "start = -1"),
        ((math.nan, 1), "start = nan"),
        ((1, 0.5), "stop = 0.5: must be finite and not before start"),
        ((1, math.inf), "stop = inf"),
        (("1 nm", 2), "nanometer"),
        ((1, 10, 0), "per_decade = 0: must be a whole number of at least 1"),
    ],
)
def test_hold_times_that_are_refused(arguments, problem):
    with pytest.raises(InputError, match=problem):
        ca.hold_times(*arguments)
