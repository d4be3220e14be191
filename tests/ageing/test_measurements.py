"""Measurements: what is read, what is refused and how; fits that recover what is known, intervals that mean 95 %."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chemage.errors import InputError, StoreError, UnitError
from chemage.measured import Measurements, fit_aging, read_measurements
from chemage.objects import Aging

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


def line(beta, cutoff, t):
    return beta * np.log10(t / cutoff)


def curve(beta, cutoff, t):
    return beta * np.log10(1 + t / cutoff)


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
            "both friction_coefficient_drop .* and friction_drop",
        ),
        ("hold_time (s), hold_time (s), error\n", InputError, "hold_time is there twice"),
        (
            GOOD.replace("10, 0.30", "10, abc"),
            InputError,
            r"line 6, column friction_coefficient_drop: 'abc' is not a number",
        ),
        (GOOD.replace("0.30", "nan"), InputError, "line 6, .*'nan' is not a finite number"),
        (GOOD.replace("0.30", ""), InputError, "line 6, .*'' is not a number"),
        (GOOD.replace("10, 0.30", "-10, 0.30"), InputError, "line 6, column hold_time: -10 is negative"),
        (GOOD.replace("100, ", "9, "), InputError, "line 8, column hold_time: 9 s comes after 10 s; sort the rows"),
        (GOOD.replace("0.30, 0.01", "0.30, 0"), InputError, "line 6, column error: 0 is not above zero"),
        (GOOD.replace("10, 0.30, 0.01", "10, 0.30"), InputError, "line 6: 2 values under 3 columns"),
        (GOOD.replace("10, 0.30, 0.01", "10, 0,30, 0,01"), InputError, "5 values under 3 columns; write decimals with"),
        ("hold_time (s); friction_drop (nN)\n1;0,5\n", InputError, "'0,5' is not a number; write a decimal point"),
        ("hold_time (s), friction_drop (nN)\n1, 2\n", InputError, "1 rows of numbers"),
    ],
)
def test_what_is_wrong_is_named_with_its_line_and_column(tmp_path, text, kind, message):
    file = written(tmp_path, text)
    with pytest.raises(kind, match=message) as caught:
        read_measurements(file)
    assert str(file) in str(caught.value)


def test_a_file_that_is_no_text_or_not_there_is_an_error_of_the_store(tmp_path):
    for file in (tmp_path / "missing.csv", written(tmp_path, GOOD, encoding="utf-16"), tmp_path):
        with pytest.raises(StoreError, match="cannot be read as a table"):
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


# -- fitting ----------------------------------------------------------------------------------------------------------

TIMES = np.geomspace(0.1, 1e4, 16)


@pytest.mark.parametrize(("model", "shape"), [("line", line), ("curve", curve)])
@pytest.mark.parametrize(("beta", "cutoff"), [(0.45, 0.7), (12.0, 3e-4), (1e-3, 50.0), (3.0, 1e-12)])
def test_exact_data_give_back_what_they_were_made_with(model, shape, beta, cutoff):
    fit = fit_aging(measured(TIMES, shape(beta, cutoff, TIMES)), model=model)
    assert fit.beta == pytest.approx(beta, rel=1e-6)
    assert fit.cutoff_time == pytest.approx(cutoff, rel=1e-5)
    assert fit.rms_residual < 1e-6 * beta
    np.testing.assert_allclose(fit(TIMES), shape(beta, cutoff, TIMES), atol=1e-6 * beta)
    assert fit.points == TIMES.size


def test_a_measurement_at_zero_counts_for_the_curve_and_not_for_the_line():
    t = np.append(0.0, TIMES)
    y = curve(0.5, 2.0, t)
    y[0] = 0.2
    assert fit_aging(measured(t, y), model="line").points == TIMES.size
    with_zero, without = (fit_aging(measured(t[k:], y[k:]), model="curve") for k in (0, 1))
    assert with_zero.points == without.points + 1
    # a residual at t = 0 that no β and t_c can take away
    assert (with_zero.beta, with_zero.cutoff_time) == (pytest.approx(without.beta), pytest.approx(without.cutoff_time))
    assert with_zero.rms_residual == pytest.approx(0.2 / math.sqrt(t.size))


def test_the_window_chooses_the_hold_times_and_both_ends_belong_to_it():
    y = line(0.5, 1.0, TIMES)
    y[TIMES > 2e3] = 99.0
    fit = fit_aging(measured(TIMES, y), window=(TIMES[3] * (1 + 1e-12), "1000 s"))
    assert fit.points == np.count_nonzero((TIMES[3] <= TIMES) & (TIMES <= 1000))
    assert fit.beta == pytest.approx(0.5)
    assert fit.window == (pytest.approx(TIMES[3]), 1000.0)
    assert "1000 s" in fit.describe()


def test_errors_weigh_the_rows():
    y = line(0.5, 1.0, TIMES)
    y[-1] += 3.0
    error = np.full(TIMES.size, 0.01)
    error[-1] = 100.0
    assert fit_aging(measured(TIMES, y, error)).beta == pytest.approx(0.5, rel=1e-4)
    assert fit_aging(measured(TIMES, y)).beta > 0.6


@pytest.mark.parametrize("kind", ["residuals", "pairs"])
@pytest.mark.parametrize(("model", "shape"), [("line", line), ("curve", curve)])
def test_intervals_hold_the_truth_nineteen_times_in_twenty(model, shape, kind):
    generator = np.random.default_rng(8)
    trials, inside = 160, np.zeros(2)
    for _ in range(trials):
        y = shape(0.45, 5.0, TIMES) + generator.normal(0, 0.05, TIMES.size)
        fit = fit_aging(measured(TIMES, y), model=model, bootstrap=kind, samples=400)
        inside += [
            fit.beta_interval.low <= 0.45 <= fit.beta_interval.high,
            fit.cutoff_interval.low <= 5.0 <= fit.cutoff_interval.high,
        ]
    # a percentile bootstrap of 16 points covers a little less than it says: 0.95 ± 2.3 standard errors, and 0.02 below
    assert (inside / trials > 0.89).all()
    assert (inside / trials < 0.99).all()


def aging(bonds, **options):
    replicas = bonds.shape[0]
    fields = {"load": 100.0, "temperature": 300.0, "bond_force": 3.0} | options
    ones = np.full(replicas, 10**6)
    return Aging(hold_times=TIMES, bonds=bonds.astype(np.int64), sites=ones, events=ones, **fields)


def correlated(generator, replicas):
    """Replicas whose whole curve is scaled and shifted: errors that no scatter about the line shows."""
    beta = generator.normal(4000.0, 400.0, (replicas, 1))
    return np.rint(beta * np.log10(TIMES) + generator.normal(9000.0, 500.0, (replicas, 1)))


def test_replicas_are_drawn_whole_so_that_correlated_errors_count():
    generator, trials, inside, narrow = np.random.default_rng(4), 200, 0, 0
    for _ in range(trials):
        many = aging(correlated(generator, 8))
        fit = fit_aging(many, window=("0.1 s", "1e4 s"), samples=400)
        assert fit.bootstrap == "replicas"
        inside += fit.beta_interval.low <= 4000 * 0.03 <= fit.beta_interval.high
        blind = fit_aging(many, window=("0.1 s", "1e4 s"), samples=400, bootstrap="residuals")
        narrow += blind.beta_interval.low <= 4000 * 0.03 <= blind.beta_interval.high
    assert 0.90 < inside / trials < 0.99
    assert narrow / trials < 0.2


def test_a_simulated_line_is_the_fit_of_ageing_itself():
    one = aging(correlated(np.random.default_rng(1), 6))
    own, fit = one.fit("10 s", "1e4 s"), fit_aging(one)
    assert fit.beta == pytest.approx(own.beta, rel=1e-12)
    assert fit.cutoff_time == pytest.approx(own.cutoff_time, rel=1e-9)
    half = 0.5 * (fit.beta_interval.high - fit.beta_interval.low)
    # 95 % of Student's t with five degrees of freedom: 2.571 standard errors
    assert half == pytest.approx(2.571 * own.beta_stderr, rel=0.2)
    force = fit_aging(one, quantity="friction_drop")
    assert force.beta == pytest.approx(own.friction_rate, rel=1e-12)
    assert force.beta_text().endswith("nN")


def test_a_single_replica_falls_back_to_residuals():
    one = aging(correlated(np.random.default_rng(1), 1))
    assert fit_aging(one).bootstrap == "residuals"
    with pytest.raises(InputError, match="single curve"):
        fit_aging(one, bootstrap="replicas")


def test_the_same_data_give_the_same_digits_and_the_seed_changes_them():
    y = line(0.5, 1.0, TIMES) + np.sin(TIMES)
    data = measured(TIMES, y)
    assert fit_aging(data) == fit_aging(data)
    assert fit_aging(data).beta_interval != fit_aging(data, seed=1).beta_interval


def test_a_wider_confidence_gives_a_wider_interval():
    data = measured(TIMES, line(0.5, 1.0, TIMES) + 0.1 * np.sin(3 * TIMES))
    widths = []
    for confidence in (0.5, 0.9, 0.99):
        interval = fit_aging(data, confidence=confidence).beta_interval
        widths.append(interval.high - interval.low)
    assert widths[0] < widths[1] < widths[2]


@pytest.mark.parametrize("model", ["line", "curve"])
def test_data_that_do_not_rise_have_no_cutoff_time(model):
    noise = np.random.default_rng(0).normal(0, 0.1, TIMES.size)
    falling = fit_aging(measured(TIMES, -line(0.5, 1.0, TIMES) + noise), model=model)
    assert falling.beta < 0
    assert math.isnan(falling.cutoff_time)
    assert falling.cutoff_text().startswith("undetermined")
    flat = fit_aging(measured(TIMES, noise), model=model)
    assert flat.cutoff_interval.low == 0
    assert math.isinf(flat.cutoff_interval.high)
    # None, not NaN, where JSON is wanted
    assert falling.todict()["cutoff_time"] is None


def test_all_data_before_the_cutoff_only_bound_it_from_below():
    # Δμ in proportion to t: any cut-off time far beyond the last measurement does
    fit = fit_aging(measured(TIMES, 1e-3 * TIMES), model="curve")
    assert not fit.cutoff_time < TIMES[-1]
    assert np.isfinite(fit.rms_residual)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "cubic"}, "choose line or curve"),
        ({"samples": 10}, "too few"),
        ({"confidence": 1.0}, "between 0 and 1"),
        ({"bootstrap": "jackknife"}, "choose residuals, pairs, replicas"),
        ({"window": ("1e5 s", "1e6 s")}, "0 different hold times"),
        ({"window": (0.1, 0.2)}, "different hold times"),
        ({"quantity": "friction_drop"}, "measurements of friction_coefficient_drop"),
        ({"window": ("1 nm", "2 nm")}, "nanometer"),
    ],
)
def test_options_that_make_no_sense_are_named(options, message):
    with pytest.raises(InputError, match=message):
        fit_aging(measured(TIMES, line(0.5, 1.0, TIMES)), **options)


def test_a_coefficient_without_load_is_refused_with_the_remedy():
    with pytest.raises(InputError, match="quantity='friction_drop'"):
        fit_aging(aging(correlated(np.random.default_rng(1), 3), load=0.0))


def test_repeated_hold_times_are_repeated_measurements():
    t = np.repeat([1.0, 10.0, 100.0], 4)
    y = line(0.5, 0.1, t) + np.tile([0.1, -0.1, 0.05, -0.05], 3)
    fit = fit_aging(measured(t, y))
    assert fit.beta == pytest.approx(0.5)
    assert fit.points == 12
    pairs = fit_aging(measured(t, y), bootstrap="pairs", model="curve")
    assert pairs.beta_interval.low < pairs.beta < pairs.beta_interval.high
