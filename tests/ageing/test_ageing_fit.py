"""The fit of a simulated result: exact lines, windows, jackknife errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chemage import Ageing, InputError, Measurements, fit_ageing


@pytest.fixture
def ageing(examples):
    return examples.ageing


def line(slope, cutoff, times, replicas=1, load=30.0, force=3.0, noise=0):
    """An Ageing whose bonds lie on slope·log10(t/cutoff), plus whole-number ``noise`` (replicas, m)."""
    exact = slope * np.log10(np.asarray(times) / cutoff)
    bonds = np.rint(exact).astype(int) + np.zeros((replicas, 1), int) + noise
    return Ageing(
        hold_times=times,
        bonds=bonds,
        sites=[10**8] * replicas,
        events=[0] * replicas,
        load=load,
        temperature=300.0,
        bond_force=force,
    )


def test_fit_of_an_exact_line_is_exact():
    times = 10.0 ** np.arange(0, 6)
    fit = line(1000, 1e-2, times, replicas=4).fit("10 s", "1e4 s")
    assert fit.points == 4
    assert fit.friction_rate == pytest.approx(3000.0, rel=1e-12)
    assert fit.beta == pytest.approx(100.0, rel=1e-12)
    assert fit.cutoff_time == pytest.approx(1e-2, rel=1e-10)
    assert fit.beta_stderr == pytest.approx(0, abs=1e-10)
    assert fit.cutoff_time_stderr == pytest.approx(0, abs=1e-12)


def test_fit_sees_only_its_window(ageing):
    times = 10.0 ** np.arange(-2.0, 7.0)
    bent = line(1000, 1e-3, times).bonds.copy()
    bent[0, times < 10] = 0
    bent[0, times > 1e4] = 10**6
    made = ageing(hold_times=times, bonds=bent, sites=[10**6], events=[1], load=3.0, observables={})
    assert made.fit(10, 1e4).beta == pytest.approx(1000)
    # the ends belong to the window, also when rounding put them an ulp outside
    assert made.fit(10 * (1 + 1e-12), 1e4 * (1 - 1e-12)).points == 4
    assert made.fit(10.1, 9e3).points == 2


def test_time_zero_is_no_part_of_a_fit(ageing):
    made = ageing(hold_times=[0.0, 1.0, 10.0])
    assert made.fit(0, 10).points == 2


@pytest.mark.parametrize("window", [(20, 90), (1e3, 1e4), (100, 1), (1, 5), ("1 h", "1 day")])
def test_a_window_with_less_than_two_times_is_refused(ageing, window):
    problem = r"fit window = .*holds [01] different hold times, and a fit needs 2; widen it"
    with pytest.raises(InputError, match=problem):
        ageing().fit(*window)


def test_hold_times_that_repeat_are_one(ageing):
    with pytest.raises(InputError, match="holds 1 different hold times, and a fit needs 2"):
        ageing(hold_times=[10.0, 10.0, 100.0]).fit(1, 50)


def test_fit_refuses_what_is_no_time(ageing):
    with pytest.raises(InputError, match="gigapascal"):
        ageing().fit("1 GPa", "10 s")


def test_a_line_that_falls_has_no_cutoff(ageing):
    made = ageing(bonds=[[30, 20, 10], [31, 20, 12]])
    fit = made.fit(1, 100)
    assert fit.beta < 0
    assert math.isnan(fit.cutoff_time)
    assert fit.beta_stderr > 0


@pytest.mark.parametrize("cutoff", [1e-258, 1e-40, 9e-4])
@pytest.mark.parametrize("bootstrap", [None, "replicas"])
def test_a_cutoff_decades_before_the_hold_times_is_not_stated(cutoff, bootstrap):
    """A contact that is nearly saturated: an extrapolated line says nothing of when strengthening begins."""
    times = 10.0 ** np.arange(0, 6)
    noise = 10 * np.random.default_rng(1).integers(-9, 10, (5, 6))
    made = line(1000, cutoff, times, replicas=5, noise=noise)
    fit = fit_ageing(made, window=(10, 1e4), bootstrap=bootstrap)
    assert fit.beta == pytest.approx(100, rel=0.1)
    assert fit.beta_interval.low > 0
    # the line itself is known
    np.testing.assert_allclose(fit(times[1:5]), made.mean_friction_coefficient_drop[1:5], atol=10)
    told = "undetermined: the fit meets zero more than 3 decades before the hold times"
    assert fit.texts()[2] == told
    numbers = fit.todict()
    assert (numbers["cutoff_time"], numbers["cutoff_time_stderr"]) == (None, None)
    assert numbers["cutoff_time_interval"] == [0.0, None]
    assert numbers["cutoff_reason"] == told.removeprefix("undetermined: ")


def test_a_cutoff_of_a_slope_that_may_be_zero_is_not_stated():
    times = 10.0 ** np.arange(0, 6)
    slopes = np.array([[-1], [0], [1], [2]])
    fit = line(0, 1.0, times, replicas=4, noise=100 * slopes * np.arange(6) + 10000).fit(10, 1e4)
    assert fit.beta > 0 > fit.beta_interval.low
    assert fit.texts()[2] == "undetermined: β is not distinguishable from zero"
    assert fit.todict()["cutoff_time"] is None


def test_a_cutoff_that_is_stated_lies_in_its_interval():
    times = 10.0 ** np.arange(0, 6)
    for seed in range(100):
        generator = np.random.default_rng(seed)
        noise = generator.integers(-400, 400, (4, 6))
        fit = line(1000, 10.0 ** generator.uniform(-12, -1), times, replicas=4, noise=noise).fit(1, 1e5)
        low, high = fit.cutoff_interval.low, fit.cutoff_interval.high
        assert low <= high
        if not fit.cutoff_reason:
            assert low < fit.cutoff_time < high


def test_jackknife_error_of_the_slope_is_that_of_a_mean():
    """The slope is linear in the data, so its jackknife error is the standard error of the replicas' own slopes."""
    times = 10.0 ** np.arange(1, 5)
    noise = np.random.default_rng(0).integers(-40, 40, (7, 4))
    made = line(1000, 1e-2, times, replicas=7, noise=noise)
    x = np.log10(times)
    slopes = np.polyfit(x, made.friction_drop.T, 1)[0]
    fit = made.fit(10, 1e4)
    assert fit.friction_rate == pytest.approx(slopes.mean(), rel=1e-12)
    assert fit.friction_rate_stderr == pytest.approx(slopes.std(ddof=1) / math.sqrt(7), rel=1e-12)
    assert fit.beta_stderr == pytest.approx(fit.friction_rate_stderr / made.load, rel=1e-12)


def test_jackknife_error_of_the_cutoff_is_that_of_the_delta_method():
    times = 10.0 ** np.arange(1, 5)
    noise = np.random.default_rng(1).integers(-8, 8, (40, 4))
    made = line(1000, 1e-2, times, replicas=40, noise=noise)
    fit = made.fit(10, 1e4)
    slopes, intercepts = np.polyfit(np.log10(times), made.friction_drop.T, 1)
    covariance = np.cov(slopes, intercepts) / 40
    # log10 of the cut-off is −intercept/slope
    gradient = np.array([intercepts.mean() / slopes.mean() ** 2, -1 / slopes.mean()])
    expected = fit.cutoff_time * math.log(10) * math.sqrt(gradient @ covariance @ gradient)
    assert fit.cutoff_time_stderr == pytest.approx(expected, rel=0.02)


def test_the_error_of_measurements_is_that_of_least_squares_and_one_replica_has_none():
    times = 10.0 ** np.arange(1, 7)
    noise = np.random.default_rng(2).integers(-30, 30, (1, 6))
    made = line(1000, 1e-2, times, noise=noise)
    (_, _), covariance = np.polyfit(np.log10(times), made.friction_drop[0], 1, cov=True)
    data = Measurements("m", times, made.friction_drop[0], "friction_drop", None)
    assert fit_ageing(data).friction_rate_stderr == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-10)
    assert math.isnan(made.fit(10, 1e6).friction_rate_stderr)
