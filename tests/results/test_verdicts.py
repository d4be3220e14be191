"""Model against data: the verdict follows from offset, slope and χ², and both kinds of error count."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from inferring import Comparable, Curve, CurveError, between, by_name, result_of, verdict
from made_inference import made_inference

import chemage as ca

TIMES = np.logspace(0, 4, 9)
MODEL = 20 + 10 * np.log10(TIMES)


def result(half=0.0, load=50.0, temperature=300.0):
    curve = Curve("friction_drop", "nN", "ΔF", x=TIMES, mean=MODEL, half_width=np.full(TIMES.size, half))
    return Comparable(load=load, chemistry={"temperature": temperature}), {"friction_drop": curve}


def inferred():
    return result_of(made_inference()).comparable(), {}


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
        (lambda v: v + 10 * (TIMES > 100), 0.5, "differs in shape: up to .* the errors are mainly those of afm"),
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


#: probability that a site is bonded at each of the hold times; 500 sites of 3 nN a bond
SHARES = np.linspace(0.02, 0.5, TIMES.size)


def run_of(rng, replicas, sites=500, surfaces=0.0):
    """(replicas, m) ΔF of sites that bond for good, on surfaces of other sizes."""
    bonds = (rng.random((replicas, sites, 1)) < SHARES).sum(axis=1)
    return 3.0 * bonds * (1 + surfaces * rng.standard_normal((replicas, 1)))


@pytest.mark.parametrize(("replicas", "off"), [(5, 0.3), (40, 0.1)])
def test_errors_and_correlations_of_neighbours_are_those_of_sites_that_bond_for_good(replicas, off):
    """Of 500 sites n p(1 − q) is the covariance of two hold times, p the earlier one's share; on average over runs."""
    found = []
    for seed in range(40):
        curves = run_of(np.random.default_rng([3, seed]), replicas)
        curve = Curve("friction_drop", "nN", "ΔF").of_replicas(TIMES, curves)
        errors, near = ca.plugin.correlated_errors(curve, 0.01)
        found.append([errors**2, near * errors * np.roll(errors, 1)])
    variances, covariances = np.mean(found, axis=0)
    expected = 9.0 * 500 / replicas * SHARES * (1 - SHARES)
    assert variances == pytest.approx(expected, rel=off)
    assert covariances[1:] == pytest.approx(9.0 * 500 / replicas * SHARES[:-1] * (1 - SHARES[1:]), rel=off)


def test_errors_without_samples_are_shared_by_all_hold_times_and_none_are_no_errors():
    _, curves = result(half=3 * 1.96)
    errors, near = ca.plugin.correlated_errors(curves["friction_drop"])
    assert errors == pytest.approx(np.full(TIMES.size, 3.0), rel=1e-3)
    assert near[1:] == pytest.approx(1.0)
    with pytest.raises(ca.InputError, match="its error is not known, as that of a single replica"):
        ca.plugin.correlated_errors(result()[1]["friction_drop"])


def test_where_no_bond_formed_half_a_one_may_have():
    curves = run_of(np.random.default_rng(0), 10)
    curves[:, 0] = 0.0
    errors, _ = ca.plugin.correlated_errors(Curve("friction_drop", "nN", "ΔF").of_replicas(TIMES, curves))
    assert errors[0] == pytest.approx(3.0 / 10 * np.sqrt(0.5), rel=0.5)


def share_that_differs(replicas, error, surfaces=0.0, factor=1.0, trials=60):
    """The share of runs beside which measurements of the true mean, times ``factor``, do not agree."""
    different = 0
    for seed in range(trials):
        rng = np.random.default_rng([seed, replicas])
        values = factor * 3.0 * 500 * SHARES
        stated = error * values
        data = ca.Measurements("afm", TIMES, values + stated * rng.standard_normal(TIMES.size), "friction_drop", stated)
        curves = run_of(rng, replicas, surfaces=surfaces)
        curve = Curve("friction_drop", "nN", "ΔF").of_replicas(TIMES, curves)
        different += verdict(data, "run", Comparable(load=50.0), {"friction_drop": curve}).chance < 0.05
    return different / trials


@pytest.mark.parametrize(
    ("replicas", "error", "surfaces"),
    [
        (5, 0.01, 0.0),
        *(pytest.param(*case, marks=pytest.mark.long) for case in [(2, 0.005, 0.0), (20, 0.01, 0.0), (10, 0.03, 0.15)]),
    ],
)
def test_a_run_of_few_replicas_differs_from_its_own_truth_as_rarely_as_is_said(replicas, error, surfaces):
    """One in twenty: of 60, eight or more would be one case in a hundred."""
    assert share_that_differs(replicas, error, surfaces) < 8 / 60


def test_a_run_of_few_replicas_tells_a_false_model():
    assert share_that_differs(5, 0.01, factor=1.3, trials=20) > 0.8


def beside(one, other, load=50.0):
    """The verdict of two runs with these replicas."""
    runs = []
    for curves, name in ((one, "one"), (other, "other")):
        curve = Curve("friction_drop", "nN", "ΔF").of_replicas(TIMES, curves)
        runs.append(SimpleNamespace(name=name, comparable=Comparable(load=load), curves={"friction_drop": curve}))
        load = 50.0
    return between(*runs)


@pytest.mark.parametrize(
    "counts", [(5, 5), pytest.param((2, 30), marks=pytest.mark.long), pytest.param((2, 2), marks=pytest.mark.long)]
)
def test_two_runs_of_one_model_differ_as_rarely_as_is_said(counts):
    """One in twenty at most: of 60, eight or more would be one case in a hundred; none surely."""
    chances = []
    for seed in range(60):
        rng = np.random.default_rng([7, seed])
        chances.append(beside(*(run_of(rng, count) for count in counts)).chance)
    assert np.mean(np.array(chances) < 0.05) < 8 / 60
    assert min(chances) > 1e-4


def test_two_runs_of_other_models_differ():
    rng = np.random.default_rng(8)
    found = beside(run_of(rng, 10), 1.3 * run_of(rng, 10))
    assert found.verdict.startswith("differs: the same shape, but its values are 1.")
    assert (found.data, found.result) == ("other", "one")
    assert "at 50 nN, the result is at 20 nN" in beside(run_of(rng, 5), run_of(rng, 5), load=20.0).verdict
    assert "a single replica has no error" in beside(run_of(rng, 5), run_of(rng, 1)).verdict


def test_replicas_that_are_equal_by_chance_are_no_certainty():
    """Two replicas of whole numbers of bonds: equal at the last hold time in one case of thirty."""
    rng = np.random.default_rng(9)
    curves = run_of(rng, 2)
    curves[1, -1] = curves[0, -1]
    found = CurveError.of([curves], curves.mean(axis=0))
    assert found.variance > 0
    truth = curves.mean(axis=0) + 30.0
    data = ca.Measurements("afm", TIMES, truth, "friction_drop", 0.002 * truth)
    curve = Curve("friction_drop", "nN", "ΔF").of_replicas(TIMES, curves)
    assert verdict(data, "run", Comparable(load=50.0), {"friction_drop": curve}).chance > 1e-3


def test_the_covariance_of_a_run_is_that_of_independent_sites():
    """N p(t) (1 − p(u)) of the bonds at t ≤ u, over the number of replicas."""
    curves = run_of(np.random.default_rng(1), 400)
    found = CurveError.of([curves], curves.mean(axis=0)).matrix()
    exact = 9 * 500 * np.minimum.outer(SHARES, SHARES) * (1 - np.maximum.outer(SHARES, SHARES)) / 400
    deviations = np.sqrt(np.diag(exact))
    assert np.abs(found - exact).max() < 0.15 * np.outer(deviations, deviations).max()
    assert np.sqrt(np.diag(found)) == pytest.approx(deviations, rel=0.1)


def test_the_error_of_a_mean_over_terms_is_the_sum_of_theirs():
    """Levels of a mean over surfaces: samples of one, and differences of another, which are independent of them."""
    rng = np.random.default_rng(2)
    first, second = run_of(rng, 40, surfaces=0.2), 0.1 * run_of(rng, 10)
    mean = first.mean(axis=0) + second.mean(axis=0)
    both = CurveError.of([first, second], mean)
    single = [CurveError.of([one], mean) for one in (first, second)]
    assert both.variance == pytest.approx(sum(one.variance for one in single))
    assert both.freedoms.tolist() == [39, 9]


def test_replicas_and_surfaces_are_the_samples_of_their_curves(small_contact_run):
    """What is judged is the mean that is shown."""
    for curve in small_contact_run:
        np.testing.assert_allclose(sum(values.mean(axis=0) for values in curve.samples), curve.mean)
        assert curve.known.shape == curve.mean.shape


@pytest.fixture
def small_contact_run():
    rng = np.random.default_rng(3)
    bonds = (rng.random((4, 500, 1)) < SHARES).sum(axis=1)
    fields = {"load": 50.0, "temperature": 300.0}
    ageing = ca.Ageing(hold_times=TIMES, bonds=bonds, sites=np.full(4, 500), **fields)
    rows = np.concatenate([np.ones((6, 1)), run_of(rng, 6)], axis=1)
    ensemble = ca.Ensemble(
        hold_times=TIMES,
        load=50.0,
        window=(10.0, 1e4),
        levels=({"words": "all", "replicas": 1, "samples": 6},),
        rows={"0": rows},
        known={"sites": np.full(rows.shape[1], 0.01)},
        known_how={"sites": "known"},
    )
    return [by_name(result_of(one).curves())["friction_drop"] for one in (ageing, ensemble)]


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
        (measured(), (Comparable(), {}), "no friction against hold time"),
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
    found = verdict(data, "inferred", result_of(one).comparable(), {})
    assert found.verdict == "agrees within the errors"
    assert found.model_errors == pytest.approx(made.samples.std(axis=0, ddof=1))
    off = ca.Measurements("other", TIMES, 2 * made.median, "friction_drop", 0.03 * made.median, 20.0, 300.0)
    assert verdict(off, "inferred", result_of(one).comparable(), {}).verdict.startswith("differs: the same shape")
