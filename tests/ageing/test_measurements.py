"""Measurements: what is read, what is refused and how; fits that recover what is known, intervals that mean 95 %."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chemage import InputError, Measurements, read_measurements
from chemage.plugin import StoreError, UnitError

GOOD = """# silica on silica
# second comment

hold_time (s), friction_coefficient_drop, error
1, 0.10, 0.01
10, 0.30, 0.01
# a remark in between
100, 0.50, 0.02
"""


def written(tmp_path, text, name="data.csv", encoding="utf-8"):
    file = tmp_path / name
    file.write_bytes(text.encode(encoding))
    return file


def measured(t, y, error=None, quantity="friction_coefficient_drop"):
    return Measurements("m", np.asarray(t), np.asarray(y), quantity, error)


# -- reading ----------------------------------------------------------------------------------------------------------


def test_a_table_is_read_with_its_comments_left_out(tmp_path):
    data = read_measurements(written(tmp_path, GOOD))
    assert data.name == "data"
    assert data.quantity == "friction_coefficient_drop"
    np.testing.assert_array_equal(data.hold_times, [1, 10, 100])
    np.testing.assert_array_equal(data.values, [0.1, 0.3, 0.5])
    assert data.error is not None
    np.testing.assert_array_equal(data.error, [0.01, 0.01, 0.02])
    assert not data.values.flags.writeable


@pytest.mark.parametrize(
    ("header", "row", "time", "value", "error"),
    [
        ("hold_time (min), friction_drop (uN), error", "2, 0.5, 0.1", 120, 500, 100),
        ("hold_time [ms]; friction_drop [nN]; error [uN]", "2; 0.5; 0.1", 0.002, 0.5, 100),
        ("error\tfriction_coefficient_drop\tHold time (h)", "1\t5\t2", 7200, 5, 1),
        ("hold_time (s), friction_coefficient_drop (%)", "2, 5", 2, 0.05, None),
        ("hold_time (s), friction_coefficient_drop (1)", '2, "5"', 2, 5, None),
        ("hold_time (s), friction_drop (µN)", "0, -1e-3,", 0, -1, None),
    ],
)
def test_units_separators_and_the_order_of_columns_are_free(tmp_path, header, row, time, value, error):
    later = row.replace("2", "3", 1) if row.startswith("2") else row
    data = read_measurements(written(tmp_path, f"{header}\n{row}\n{later}\n"))
    assert data.hold_times[0] == pytest.approx(time, rel=1e-12)
    assert data.values[0] == pytest.approx(value, rel=1e-12)
    if error is None:
        assert data.error is None
    else:
        assert data.error is not None
        assert data.error[0] == pytest.approx(error, rel=1e-12)


@pytest.mark.parametrize(
    "text", [GOOD.replace("\n", "\r\n"), "\ufeff" + GOOD, GOOD.rstrip("\n"), GOOD.replace("0.02", "0.02,,")]
)
def test_what_spreadsheets_do_to_a_file_does_no_harm(tmp_path, text):
    assert read_measurements(written(tmp_path, text)).values.tolist() == [0.1, 0.3, 0.5]


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("", InputError, "there is nothing in it"),
        ("# only a comment\n", InputError, "there is nothing in it"),
        ("hold_time (s), friction_drop\n1,2\n", UnitError, r"line 1: the column friction_drop has no unit"),
        ("hold_time, friction_drop (nN)\n1,2\n", UnitError, r"the column hold_time has no unit; .* hold_time \(s\)"),
        ("hold_time (nm), friction_drop (nN)\n1,2\n", UnitError, r"line 1: the column hold_time \(nm\): .*nanometer"),
        ("hold_time (s), friction_drop (GPa)\n1,2\n", UnitError, r"friction_drop \(GPa\): .* gigapascal"),
        ("hold_time (s), friction_drop (furlongs)\n1,2\n", UnitError, "unknown unit furlongs|quantity of furlong"),
        ("hold_time (s), friction_coefficient_drop (nN)\n1,2\n", UnitError, "pure numbers"),
        (
            "hold_time (s), fricton_drop (nN)\n1,2\n",
            InputError,
            "column 2 is 'fricton_drop .*did you mean 'friction_drop'",
        ),
        ("1, 2\n3, 4\n", InputError, "line 1: column 1 is '1'; the columns are hold_time"),
        ("friction_drop (nN)\n1\n2\n", InputError, "no column hold_time"),
        ("hold_time (s)\n1\n2\n", InputError, "neither friction_coefficient_drop .* nor friction_drop"),
        (
            "hold_time (s), friction_drop (nN), friction_coefficient_drop\n1,2,3\n",
            InputError,
            "friction_drop and friction_coefficient_drop are both there; give one",
        ),
        ("hold_time (s), hold_time (s), error\n", InputError, "hold_time is there twice"),
        (
            GOOD.replace("10, 0.30", "10, abc"),
            InputError,
            r"line 6, column friction_coefficient_drop: 'abc' is not a number",
        ),
        (GOOD.replace("10, 0.30", "nan, 0.30"), InputError, "line 6, .*'nan' is not a finite number"),
        (GOOD.replace("0.30, 0.01", "0.30, "), InputError, "line 6, .*'' is not a finite number; fill in the number"),
        (GOOD.replace("10, 0.30", "-10, 0.30"), InputError, "line 6, column hold_time: -10 is negative"),
        (
            GOOD.replace("0.30, 0.01", "0.30, 0"),
            InputError,
            "line 6, column error: 0: a standard error must be above zero",
        ),
        (GOOD.replace("10, 0.30, 0.01", "10, 0.30"), InputError, "line 6: 2 values under 3 columns"),
        (GOOD.replace("10, 0.30, 0.01", "10, 0,30, 0,01"), InputError, "5 values under 3 columns; separate columns by"),
        ("hold_time (s), friction_drop (nN)\n1, 2\n", InputError, "1 rows of numbers"),
    ],
)
def test_what_is_wrong_is_named_with_its_line_and_column(tmp_path, text, kind, message):
    file = written(tmp_path, text)
    with pytest.raises(kind, match=message) as caught:
        read_measurements(file)
    assert str(file) in str(caught.value)


def test_a_file_that_is_no_text_or_not_there_is_an_error_of_the_store(tmp_path):
    for file in (tmp_path / "missing.csv", written(tmp_path, "hold_time\x00\x01\x02" * 9), tmp_path):
        with pytest.raises(StoreError, match=r"not a text file|does not exist|Is a directory"):
            read_measurements(file)


def test_measurements_made_in_python_are_checked_as_well():
    for bad in (
        {"hold_times": [2, 1]},
        {"values": [1, math.nan]},
        {"error": [1, 0]},
        {"error": [1.0]},
        {"quantity": "x"},
    ):
        fields = {"hold_times": [1, 2], "values": [1, 2], "quantity": "friction_drop", "error": None} | bad
        with pytest.raises(InputError):
            Measurements("m", **fields)


def test_friction_and_its_coefficient_convert_where_the_load_is_known():
    data = measured([1, 2], [10.0, 20.0], error=[1.0, 2.0], quantity="friction_drop")
    other = data.as_quantity("friction_coefficient_drop", 50.0)
    assert other is not None
    assert other.values.tolist() == [0.2, 0.4]
    assert other.error is not None
    assert other.error.tolist() == [0.02, 0.04]
    back = other.as_quantity("friction_drop", 50.0)
    assert back is not None
    np.testing.assert_allclose(back.values, data.values)
    assert data.as_quantity("friction_coefficient_drop", None) is None
    assert data.as_quantity("friction_drop", None) is data


@pytest.mark.parametrize(
    ("header", "drop", "offset"),
    [
        ("value (uN)", "friction_drop (uN)", None),
        ("value (%)", "friction_coefficient_drop (%)", None),
        ("friction (uN)", "friction_drop (uN)", "offset (uN)"),
        ("friction (mN)", "friction_drop (mN)", "offset (mN)"),
        ("friction_coefficient (%)", "friction_coefficient_drop (%)", "offset (%)"),
        ("mu", "friction_coefficient_drop (1)", "offset (1)"),
    ],
)
def test_a_remedy_keeps_the_unit_of_the_column(tmp_path, header, drop, offset):
    """Pasted, it changes no number."""
    text = f"hold_time (s), {header}\n1, 2\n10, 3\n100, 4\n"
    with pytest.raises(InputError) as error:
        read_measurements(written(tmp_path, text))
    assert drop in str(error.value)
    assert offset is None or offset in str(error.value)
    data = read_measurements(written(tmp_path, text.replace(header, drop)))
    scale = {"(uN)": 1e3, "(mN)": 1e6, "(%)": 0.01, "(1)": 1.0}[drop[drop.index("(") :]]
    assert data.values == pytest.approx(np.array([2.0, 3.0, 4.0]) * scale)
