"""Numbers as text carry the digits their errors bear, and no more."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np
import pytest

from chemage.plugin import text as wording


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.4391, 0.0123, "0.439 ± 0.012"),
        (1234.5, 67.0, "1230 ± 70"),
        (1234.5, 12.0, "1234 ± 12"),
        (0.4391, 0.031, "0.44 ± 0.03"),
        (0.4391, 0.0967, "0.44 ± 0.10"),
        (0.5, math.nan, "0.5"),
        (0.5, 0.0, "0.5"),
        (11.8875, 1.6e-14, "11.89"),  # the rounding of equal numbers
        (math.nan, 0.1, "nan"),
    ],
)
def test_a_value_is_cut_where_its_error_is(value, error, text):
    assert wording.plus_minus(value, error) == text
    assert wording.plus_minus(value, error, "nN") == f"{text} nN"


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((0.7946, 0.7821, 0.8074), "0.795 [0.782, 0.807]"),
        ((0.71, 0.43, 1.03), "0.7 [0.4, 1.0]"),
        ((20.0, 18.06, 21.47), "20.0 [18.1, 21.5]"),
        ((2.0, 1.9999999, 2.0000001), "2.00000 ± 1e-07"),
        ((0.0, 0.0, 0.0), "0 (no scatter, so that the error is not known)"),
        ((0.4391, 0.4391, 0.4391), "0.4391 (no scatter, so that the error is not known)"),
        ((1.2345e-7, 1.1e-7, 1.4e-7), "1.23e-07 [1.10e-07, 1.40e-07]"),
        ((1e-5, 1e-9, 3e-3), "1e-05 [1e-09, 0.003]"),
        ((5.0, 0.0, math.inf), "5 [0, inf]"),
        ((12560.3, 12242.0, 12303.0), "12560, truth in [12240, 12300]"),
        ((1e-5, 2e-5, 3e-2), "1e-05, truth in [2e-05, 0.03]"),
        ((math.nan, 0.0, math.inf), "undetermined"),
        ((0.0, -0.0123, 0.0212), "0.000 [-0.012, 0.021]"),
    ],
)
def test_an_interval_sets_the_digits_of_all_three_numbers(numbers, text):
    assert wording.with_interval(*numbers) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.4283, 0.0312, "0.43(3)"),
        (0.4283, 0.0125, "0.428(12)"),
        (212.0, 57.0, "210(60)"),
        (4.19, 1.13, "4.2(11)"),
        (0.4283, math.nan, "0.428"),
    ],
)
def test_in_legends_the_error_stands_in_brackets(value, error, text):
    assert wording.with_error(value, error) == text


@pytest.mark.parametrize("error", [1.0, 1.94, 1.96, 2.0, 9.4, 9.6])
def test_one_rule_rounds_every_error(error):
    """Two digits where the first is 1, so that rounding changes no error by more than 25 %."""
    for exponent in range(-8, 9):
        size = error * 10.0**exponent
        assert abs(round(size, wording.decimals(size)) - size) <= 0.25 * size


@pytest.mark.parametrize(
    ("value", "plain"),
    [
        (np.float64(0.5), 0.5),
        (np.int32(3), 3),
        (np.bool_(True), True),
        (math.nan, None),
        (-math.inf, None),
        (np.array([[1.0, np.nan]]), [[1.0, None]]),
        ((1, "a", None), [1, "a", None]),
        ({1: {"x": np.float32("inf")}}, {"1": {"x": None}}),
    ],
)
def test_jsonable_is_json(value, plain):
    assert wording.jsonable(value) == plain
    assert type(wording.jsonable(value)) is type(plain)
    json.dumps(wording.jsonable(value), allow_nan=False)


@pytest.mark.parametrize("text", ["=1+1", "+1+1", "-1+1", "@SUM(1)", '\t=cmd|"/c calc"!A1', " =1", "\uff1d1"])
def test_a_text_that_a_spreadsheet_would_compute_is_a_text_in_csv(text):
    names, cells = csv.reader(io.StringIO(wording.csv_text(["name", text], [[text, -1.5]]), newline=""))
    assert names == ["name", f"'{text}"]
    assert cells == [f"'{text}", "-1.5"]
    assert wording.csv_text([], [["a\r=1+1"]]).splitlines() == ["", "a =1+1"]


@pytest.mark.parametrize("text", ["-1.5", "+3e-7", "-inf", "", "a=b", "silica-tip", "1 - 2"])
def test_numbers_and_ordinary_texts_are_as_they_are_in_csv(text):
    assert list(csv.reader(io.StringIO(wording.csv_text(["name"], [[text, 1]])))) == [["name"], [text, "1"]]
