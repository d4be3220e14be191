"""Fits recover what is known, and their intervals mean 95 %."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from chemage import Ageing, InputError, Measurements, fit_ageing


def line(beta, cutoff, t):
    return beta * np.log10(t / cutoff)


def curve(beta, cutoff, t):
    return beta * np.log10(1 + t / cutoff)


def measured(t, y, error=None, quantity="friction_coefficient_drop"):
    return Measurements("m", np.asarray(t), np.asarray(y), quantity, error)


TIMES = np.geomspace(0.1, 1e4, 16)


@pytest.mark.parametrize(("model", "shape"), [("line", line), ("curve", curve)])
@pytest.mark.parametrize(("beta", "cutoff"), [(0.45, 0.7), (12.0, 3e-4), (1e-3, 50.0), (3.0, 1e-12)])
def test_exact_data_give_back_what_they_were_made_with(model, shape, beta, cutoff):
    fit = fit_ageing(measured(TIMES, shape(beta, cutoff, TIMES)), model=model)
    assert fit.beta == pytest.approx(beta, rel=1e-6)
    # one that lies decades outside the hold times is no time at which strengthening begins
    assert fit.cutoff_time == pytest.approx(cutoff if cutoff > 1e-4 else math.nan, rel=1e-5, nan_ok=True)
    assert fit.log_cutoff == pytest.approx(math.log10(cutoff), abs=1e-5)
    assert fit.rms_residual < 1e-6 * beta
    np.testing.assert_allclose(fit(TIMES), shape(beta, cutoff, TIMES), atol=1e-6 * beta)
    assert fit.points == TIMES.size


def test_what_rises_like_the_time_itself_has_no_cutoff_time():
    """log(1 + t/t_c) of a t_c far beyond the data."""
    fit = fit_ageing(measured(TIMES, 1e-3 * TIMES), model="curve")
    assert fit.log_cutoff == math.inf


def test_a_measurement_at_zero_counts_for_the_curve_and_not_for_the_line():
    t = np.append(0.0, TIMES)
    y = curve(0.5, 2.0, t)
    y[0] = 0.2
    assert fit_ageing(measured(t, y), model="line").points == TIMES.size
    with_zero, without = (fit_ageing(measured(t[k:], y[k:]), model="curve") for k in (0, 1))
    assert with_zero.points == without.points + 1
    # a residual at t = 0 that no β and t_c can take away
    assert (with_zero.beta, with_zero.cutoff_time) == (pytest.approx(without.beta), pytest.approx(without.cutoff_time))
    assert with_zero.rms_residual == pytest.approx(0.2 / math.sqrt(t.size))


def test_the_window_chooses_the_hold_times_and_both_ends_belong_to_it():
    y = line(0.5, 1.0, TIMES)
    y[TIMES > 2e3] = 99.0
    fit = fit_ageing(measured(TIMES, y), window=(TIMES[3] * (1 + 1e-12), "1000 s"))
    assert fit.points == np.count_nonzero((TIMES[3] <= TIMES) & (TIMES <= 1000))
    assert fit.beta == pytest.approx(0.5)
    assert fit.window == (pytest.approx(TIMES[3]), 1000.0)
    assert "1000 s" in fit.describe()


def test_errors_weigh_the_rows():
    y = line(0.5, 1.0, TIMES)
    y[-1] += 3.0
    error = np.full(TIMES.size, 0.01)
    error[-1] = 100.0
    assert fit_ageing(measured(TIMES, y, error)).beta == pytest.approx(0.5, rel=1e-4)
    assert fit_ageing(measured(TIMES, y)).beta > 0.6


@pytest.mark.parametrize("kind", ["residuals", "pairs"])
@pytest.mark.parametrize(("model", "shape"), [("line", line), pytest.param("curve", curve, marks=pytest.mark.long)])
def test_intervals_hold_the_truth_nineteen_times_in_twenty(model, shape, kind):
    generator = np.random.default_rng(8)
    trials, inside = 160, np.zeros(2)
    for _ in range(trials):
        y = shape(0.45, 5.0, TIMES) + generator.normal(0, 0.05, TIMES.size)
        fit = fit_ageing(measured(TIMES, y), model=model, bootstrap=kind, samples=400 if model == "line" else 200)
        inside += [
            fit.beta_interval.low <= 0.45 <= fit.beta_interval.high,
            fit.cutoff_interval.low <= 5.0 <= fit.cutoff_interval.high,
        ]
    # a percentile bootstrap of 16 points covers a little less than it says: 0.95 ± 2.3 standard errors, and 0.02 below
    assert (inside / trials > 0.89).all()
    assert (inside / trials < 0.99).all()


def ageing(bonds, **options):
    replicas = bonds.shape[0]
    fields = {"load": 100.0, "temperature": 300.0, "bond_force": 3.0} | options
    ones = np.full(replicas, 10**8)
    return Ageing(hold_times=TIMES, bonds=bonds.astype(np.int64), sites=ones, events=ones, **fields)


def correlated(generator, replicas):
    """Replicas whose whole curve is scaled and shifted: errors that no scatter about the line shows."""
    beta = generator.normal(4000.0, 400.0, (replicas, 1))
    return np.rint(beta * np.log10(TIMES) + generator.normal(9000.0, 500.0, (replicas, 1)))


def test_replicas_are_drawn_whole_so_that_correlated_errors_count():
    generator, trials, inside = np.random.default_rng(4), 200, 0
    for _ in range(trials):
        many = ageing(correlated(generator, 8))
        fit = fit_ageing(many, window=("0.1 s", "1e4 s"), samples=400, bootstrap="replicas")
        assert fit.bootstrap == "replicas"
        inside += fit.beta_interval.low <= 4000 * 0.03 <= fit.beta_interval.high
    assert 0.90 < inside / trials < 0.99


@pytest.mark.parametrize("model", ["line", pytest.param("curve", marks=pytest.mark.long)])
@pytest.mark.parametrize("replicas", [3, *(pytest.param(count, marks=pytest.mark.long) for count in (2, 5, 10))])
def test_the_intervals_of_a_few_replicas_cover_what_they_say(replicas, model):
    """Replicas that differ by a factor and by a scatter of their own; 0.95 ± 4 standard errors of the trials."""
    generator, trials = np.random.default_rng(replicas), 400
    inside = np.zeros(2)
    shape = line if model == "line" else curve
    for _ in range(trials):
        scale = generator.normal(1e6, 5e4, (replicas, 1))
        noise = generator.normal(0.0, 3e4, (replicas, TIMES.size))
        fit = fit_ageing(
            ageing(np.maximum(scale * shape(0.45, 5.0, TIMES) + noise, 0)), model=model, window=("10 s", "1e4 s")
        )
        inside += [
            fit.beta_interval.low <= 0.45 * 3e4 <= fit.beta_interval.high,
            fit.cutoff_interval.low <= 5.0 <= fit.cutoff_interval.high,
        ]
    assert np.abs(inside / trials - 0.95).max() < 4 * (0.95 * 0.05 / trials) ** 0.5


@pytest.mark.parametrize("model", [pytest.param("line", marks=pytest.mark.long), "curve"])
@pytest.mark.parametrize("points", [4, *(pytest.param(count, marks=pytest.mark.long) for count in (6, 25))])
def test_the_intervals_of_a_few_measurements_cover_what_they_say(points, model):
    generator, trials = np.random.default_rng(points), 300 if model == "line" else 150
    times, inside = np.geomspace(1.0, 1e4, points), np.zeros(2)
    error = np.geomspace(0.02, 0.08, points)
    shape = line if model == "line" else curve
    for _ in range(trials):
        y = shape(0.45, 5.0, times) + generator.normal(0, error)
        fit = fit_ageing(measured(times, y, error), model=model)
        inside += [
            fit.beta_interval.low <= 0.45 <= fit.beta_interval.high,
            fit.cutoff_interval.low <= 5.0 <= fit.cutoff_interval.high,
        ]
    assert np.abs(inside / trials - 0.95).max() < 4 * (0.95 * 0.05 / trials) ** 0.5 + (model == "curve") * 0.01


def test_a_simulated_line_is_the_fit_of_ageing_itself():
    one = ageing(correlated(np.random.default_rng(1), 6))
    own, fit = one.fit("10 s", "1e4 s"), fit_ageing(one)
    assert fit.beta == pytest.approx(own.beta, rel=1e-12)
    assert fit.cutoff_time == pytest.approx(own.cutoff_time, rel=1e-9)
    half = 0.5 * (fit.beta_interval.high - fit.beta_interval.low)
    # 95 % of Student's t with five degrees of freedom: 2.571 standard errors
    assert half == pytest.approx(2.571 * own.beta_stderr, rel=1e-3)
    force = fit_ageing(one, quantity="friction_drop")
    assert force.beta == pytest.approx(own.friction_rate, rel=1e-12)
    assert force.texts()[0].endswith("nN")


def test_a_single_replica_has_no_error_and_says_so():
    one = ageing(correlated(np.random.default_rng(1), 1))
    fit = fit_ageing(one)
    assert math.isnan(fit.beta_stderr)
    assert math.isnan(fit.beta_interval.low)
    assert math.isnan(fit.cutoff_interval.high)
    assert fit.texts()[0].endswith("(one replica: no error)")
    assert fit.intervals_text() == "none: a single replica has no error"
    with pytest.raises(InputError, match="single curve"):
        fit_ageing(one, bootstrap="replicas")


@pytest.mark.parametrize("kind", ["residuals", "pairs"])
def test_the_scatter_of_simulated_hold_times_is_no_error(kind):
    with pytest.raises(InputError, match="share their bonds"):
        fit_ageing(ageing(correlated(np.random.default_rng(1), 3)), bootstrap=kind)


def test_an_interval_is_printed_by_its_ends_where_the_value_is_not_in_the_middle():
    fit = fit_ageing(ageing(correlated(np.random.default_rng(1), 3)), bootstrap="replicas")
    low, high = fit.beta_interval.low, fit.beta_interval.high
    assert abs(low + high - 2 * fit.beta) > 0.05 * (high - low)
    found = [float(number) for number in re.search(r"\[(\S+), (\S+)\]", fit.beta_text()).groups()]
    assert found == pytest.approx([low, high], abs=0.5), "rounded to a whole number"
    beta = fit.quantities()[0]
    assert beta.but(low=fit.beta - 0.1, high=fit.beta + 0.1, half_width=0.1).bare().endswith("± 0.10")


@pytest.mark.parametrize("bootstrap", [None, "replicas"])
@pytest.mark.parametrize("slope", [4000, 0])
def test_replicas_that_are_all_equal_have_no_interval_and_say_so(slope, bootstrap):
    """Few bonds are equal by chance; an interval of no width would say that β is known exactly."""
    bonds = np.tile(np.rint(slope * np.log10(TIMES / 0.01)), (3, 1))
    fit = fit_ageing(ageing(bonds), bootstrap=bootstrap)
    assert np.isnan([fit.beta_interval.low, fit.beta_interval.high]).all()
    beta, b, cutoff = fit.texts()
    assert beta.startswith(f"{fit.beta:.4g} ")
    assert "no scatter, so that the error is not known" in beta
    if slope:
        assert cutoff.endswith("(no scatter, so that the error is not known)")
    else:
        assert cutoff == "undetermined: β is not distinguishable from zero"
    assert "[" not in b + cutoff
    assert "(" not in fit.short_text().partition(" per decade")[0]


def test_the_same_data_give_the_same_digits_and_the_seed_changes_them():
    y = line(0.5, 1.0, TIMES) + np.sin(TIMES)
    data = measured(TIMES, y)
    assert fit_ageing(data) == fit_ageing(data)
    first, second = (fit_ageing(data, bootstrap="residuals", seed=seed).beta_interval for seed in (0, 1))
    assert first != second


def test_a_wider_confidence_gives_a_wider_interval():
    data = measured(TIMES, line(0.5, 1.0, TIMES) + 0.1 * np.sin(3 * TIMES))
    widths = []
    for confidence in (0.5, 0.9, 0.99):
        interval = fit_ageing(data, confidence=confidence).beta_interval
        widths.append(interval.high - interval.low)
    assert widths[0] < widths[1] < widths[2]


@pytest.mark.parametrize("model", ["line", "curve"])
def test_data_that_do_not_rise_have_no_cutoff_time(model):
    noise = np.random.default_rng(0).normal(0, 0.1, TIMES.size)
    falling = fit_ageing(measured(TIMES, -line(0.5, 1.0, TIMES) + noise), model=model)
    assert falling.beta < 0
    assert math.isnan(falling.cutoff_time)
    assert falling.texts()[2].startswith("undetermined")
    flat = fit_ageing(measured(TIMES, noise), model=model)
    assert flat.cutoff_interval.low == 0
    assert math.isinf(flat.cutoff_interval.high)
    # None, not NaN, where JSON is wanted
    assert falling.todict()["cutoff_time"] is None


@pytest.mark.parametrize(("cutoff", "side"), [(1e-5, "before"), (1e8, "after")])
def test_a_cutoff_decades_outside_the_measurements_is_not_stated(cutoff, side):
    fit = fit_ageing(measured(TIMES, line(0.5, cutoff, TIMES)))
    assert fit.texts()[2] == f"undetermined: the fit meets zero more than 3 decades {side} the hold times"
    assert fit.todict()["cutoff_time"] is None


def test_all_data_before_the_cutoff_only_bound_it_from_below():
    # Δμ in proportion to t: any cut-off time far beyond the last measurement does
    fit = fit_ageing(measured(TIMES, 1e-3 * TIMES), model="curve")
    assert not fit.cutoff_time < TIMES[-1]
    assert np.isfinite(fit.rms_residual)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "cubic"}, "choose line or curve"),
        ({"samples": 10}, "too few"),
        ({"confidence": 1.0}, "between 0 and 1"),
        ({"bootstrap": "jackknife"}, "choose residuals, pairs, replicas, or leave it out"),
        ({"window": ("1e5 s", "1e6 s")}, "0 different hold times"),
        ({"window": (0.1, 0.2)}, "different hold times"),
        ({"quantity": "friction_drop"}, "measurements of friction_coefficient_drop"),
        ({"window": ("1 nm", "2 nm")}, "nanometer"),
    ],
)
def test_options_that_make_no_sense_are_named(options, message):
    with pytest.raises(InputError, match=message):
        fit_ageing(measured(TIMES, line(0.5, 1.0, TIMES)), **options)


def test_a_coefficient_without_load_is_refused_with_the_remedy():
    with pytest.raises(InputError, match="quantity='friction_drop'"):
        fit_ageing(ageing(correlated(np.random.default_rng(1), 3), load=0.0))


def test_repeated_hold_times_are_repeated_measurements():
    t = np.repeat([1.0, 10.0, 100.0], 4)
    y = line(0.5, 0.1, t) + np.tile([0.1, -0.1, 0.05, -0.05], 3)
    fit = fit_ageing(measured(t, y))
    assert fit.beta == pytest.approx(0.5)
    assert fit.points == 12
    pairs = fit_ageing(measured(t, y), bootstrap="pairs", model="curve")
    assert pairs.beta_interval.low < pairs.beta < pairs.beta_interval.high


def test_b_is_the_slope_per_factor_e():
    """Δμ = b ln(t/t_c) of rate-and-state friction is the same line as β log10(t/t_c)."""
    t = np.geomspace(1, 1e4, 9)
    noise = np.random.default_rng(1).normal(0, 1e-3, t.size)
    found = fit_ageing(measured(t, 0.02 * np.log(t / 0.1) + noise))
    assert found.b == pytest.approx(0.02, abs=1e-3)
    assert found.b == found.beta / math.log(10)
    assert found.b_stderr / found.b == pytest.approx(found.beta_stderr / found.beta, rel=1e-12)
    assert found.b_interval.low < found.b < found.b_interval.high
    assert found.b_half_width == pytest.approx((found.b_interval.high - found.b_interval.low) / 2, rel=1e-12)
    assert found.todict()["b"] == found.b
    assert found.texts()[1].startswith("0.0")


# -- curves that are no line ---------------------------------------------------------------------------------------


def simulated(probabilities, seed, replicas=10, sites=2000):
    """Bonds of independent sites, which share their hold times: ``probabilities`` (m,) to be bonded at each."""
    rng = np.random.default_rng(seed)
    steps = np.append(np.diff(probabilities, prepend=0.0), 1 - probabilities[-1])
    bonds = rng.multinomial(sites, steps, size=replicas)[:, :-1].cumsum(axis=1)
    return Ageing(hold_times=HOLDS, bonds=bonds, sites=[sites] * replicas, load=100.0, temperature=300.0)


HOLDS = 10.0 ** np.arange(-2, 5.01, 0.25)
STRAIGHT = 0.05 + 0.1 * (np.log10(HOLDS) + 2)
SATURATING = 1 - np.exp(-((HOLDS / 50) ** 0.5))
HUMP = 1 / (1 + (300 / HOLDS) ** 1.5)


@pytest.mark.parametrize("replicas", [1, 2, 10])
def test_a_true_line_is_called_bent_as_rarely_as_is_said(replicas):
    """One in a hundred at most: of 200, eight or more would be one case in a thousand."""
    bent = [simulated(STRAIGHT, seed, replicas).fit().bent for seed in range(200)]
    assert sum(bent) < 8


def test_measurements_on_a_line_are_called_bent_as_rarely_as_is_said():
    rng = np.random.default_rng(3)
    bent = [
        fit_ageing(measured(TIMES, line(0.4, 0.1, TIMES) + 0.1 * rng.normal(size=TIMES.size))).bent for _ in range(400)
    ]
    assert sum(bent) < 12


@pytest.mark.parametrize("truth", [SATURATING, HUMP])
@pytest.mark.parametrize("replicas", [1, 10])
def test_a_curve_that_is_no_line_is_called_so_with_its_numbers(truth, replicas):
    made = simulated(truth, 1, replicas, 20_000)
    fit = made.fit()
    assert fit.bent
    x, y = np.log10(HOLDS), truth * 20_000 * 3.0 / 100.0
    for slope, at in ((fit.slope_from, 1.0), (fit.slope_to, 3.5)):
        ends = np.interp([at, at + 0.5], x, y)
        assert slope == pytest.approx((ends[1] - ends[0]) / 0.5, rel=0.1, abs=0.05 * fit.beta)
    (note,) = fit.notes
    assert f"no line: rms residual {fit.rms_residual:.3g}, local slope from {fit.slope_from:.3g}" in note
    assert "no line: rms residual" in fit.short_text()
    assert "no line: rms residual" in fit.beta_text()
    assert {"rms_residual", "slope_from", "slope_to"} <= fit.todict().keys()


def test_the_window_that_is_named_is_one_in_which_the_curve_is_a_line():
    bends = np.where(HOLDS < 10, STRAIGHT, STRAIGHT[HOLDS < 10][-1] + 0.02 * (np.log10(HOLDS) - 0.75))
    made = simulated(bends, 2, 10, 20_000)
    fit = made.fit(0.01, 1e4)
    assert fit.bent
    low, high = fit.line_window
    assert f"it is a line from {low:.4g} to {high:.4g} s" in fit.notes[0]
    again = made.fit(low, high)
    assert not again.bent
    assert again.notes == ()
    assert "no window of two decades is one" in simulated(SATURATING, 1, 10, 10**6).fit().notes[0]


def test_a_saturating_curve_says_so_of_beta():
    assert simulated(SATURATING, 1, 10, 20_000).fit().saturates
    assert simulated(np.where(HOLDS < 1, 0.5, 1.0), 1).fit().saturates
    assert not simulated(STRAIGHT, 1, 10, 20_000).fit().saturates


def test_measurements_that_saturate_are_called_no_line():
    rng = np.random.default_rng(4)
    times = np.geomspace(5, 1e4, 14)
    fit = fit_ageing(measured(times, 1 - np.exp(-times / 10) + 0.02 * rng.normal(size=times.size)))
    assert fit.bent
    assert fit.slope_from > 3 * fit.slope_to
