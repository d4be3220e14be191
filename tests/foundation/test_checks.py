"""Arguments of stages: what is accepted, and how the rest is refused."""

from __future__ import annotations

import numpy as np
import pytest

from chemage import InputError
from chemage.plugin import check_times, checked_seed, force, temperature_value


def test_force():
    assert force("20 uN") == 20000.0
    assert force(0) == 0.0
    for wrong in (-1, np.nan, np.inf, "nan", "1e400 N"):
        with pytest.raises(InputError, match=r"load = .*must be finite and not negative; give a force such as 20 uN"):
            force(wrong)
    with pytest.raises(InputError, match="gigapascal"):
        force("20 GPa")


def test_temperature():
    assert temperature_value("26.85 degC") == 300.0
    for wrong in (0, -1, np.nan, np.inf, "-300 degC"):
        with pytest.raises(InputError, match=r"temperature = .*must be finite and above zero; give kelvin"):
            temperature_value(wrong)


@pytest.mark.parametrize("times", [[1.0], (0, 1), np.array([0.0, 0.0, 2.0]), 3.0, range(4)])
def test_hold_times(times):
    checked = check_times(times)
    assert checked.dtype == np.float64
    assert checked.ndim == 1


@pytest.mark.parametrize(
    ("times", "problem"),
    [
        ([], r"hold_times = \(0,\): must be a list with at least one time"),
        ([[1, 2]], r"hold_times = \(1, 2\): must be a list"),
        (["soon"], r"hold_times = \['soon'\]: not a list of numbers"),
        ([1, -2], r"hold_times\[1\] = -2.0: must be finite and not negative"),
        ([1, np.nan], r"hold_times\[1\] = nan"),
        ([1, np.inf], r"hold_times\[1\] = inf"),
        ([1, 3, 2], r"hold_times\[2\] = 2.0: comes after 3.0; sort the hold times"),
    ],
)
def test_wrong_hold_times(times, problem):
    with pytest.raises(InputError, match=problem):
        check_times(times)


def test_hold_times_are_a_copy():
    mine = np.array([1.0, 2.0])
    checked = check_times(mine)
    mine[0] = 5
    assert checked[0] == 1.0


def test_seeds():
    assert checked_seed(np.int64(3)) == 3
    for wrong in (-1, 1.5, True, "1", None):
        with pytest.raises(InputError, match=r"seed = .*must be a whole number, 0 or larger"):
            checked_seed(wrong)
