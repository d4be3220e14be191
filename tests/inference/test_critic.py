"""The critic: each trouble is named at four curves of made-up posteriors, clean measurements are not accused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from made_inference import SCENE, made_inference

import chemage as ca

KT = 8.617e-5
TIMES = np.tile(np.logspace(-2, 4, 9), 4)
CURVE = np.repeat(np.arange(4), 9)
KELVIN = np.repeat([300.0, 330.0, 300.0, 330.0], 9)
LOAD = np.repeat([30.0, 30.0, 100.0, 100.0], 9)
DECADES = np.log10(TIMES) - 1
ENERGIES = np.linspace(0.4, 1.6, 241)


def values(weights, kelvin=KELVIN, times=TIMES):
    """(..., m) nN: sites that react with exp(−E/kT), the barriers of the larger load 0.02 eV lower."""
    lower = np.where(LOAD > 50, 0.02, 0.0)
    rates = 1e13 * np.exp(-(ENERGIES - lower[:, None]) / (KT * kelvin[:, None]))
    return 3 * LOAD ** (2 / 3) * (weights @ -np.expm1(-times[:, None] * rates).T)


def densities(count, rng):
    """Two peaks and a background, of sum 1."""
    at, wide, share = rng.uniform((0.6, 0.03, 0.2), (1.3, 0.15, 1.0), (count, 2, 3)).transpose(2, 0, 1)[..., None]
    made = (share * np.exp(-0.5 * ((ENERGIES - at) / wide) ** 2)).sum(axis=1) + 0.2 * rng.random((count, 1))
    return made / made.sum(axis=1, keepdims=True)


@cache
def prior():
    return values(densities(400, np.random.default_rng(1)))


def inferred(seed, change=lambda y, e, rng: y, kelvin=KELVIN, slower=0.0, **more):
    """The posterior of normal densities, by conditioning samples of the prior."""
    rng = np.random.default_rng([seed, 2])
    weights = densities(1, rng)[0]
    true = values(weights, kelvin)
    if slower:  # bonds raise barriers: sites see a slower time
        for _ in range(60):
            share = true / (3 * LOAD ** (2 / 3))
            true = 0.5 * (true + values(weights, kelvin, TIMES * np.exp(-slower * share / (KT * KELVIN))))
    errors = np.hypot(0.03 * true, 0.003 * true.max())
    measured = change(true + errors * rng.standard_normal(true.size), errors, rng)
    samples = prior()
    covariance = np.cov(samples.T)
    gain = covariance @ np.linalg.inv(covariance + np.diag(errors**2))
    noisy = measured + errors * rng.standard_normal(samples.shape)
    curves = tuple(
        {"name": name, "load": load, "temperature": kelvin, "quantity": "friction_drop"}
        for name, load, kelvin in zip("abcd", LOAD[::9], KELVIN[::9], strict=True)
    )
    return made_inference(
        members=400, curve=CURVE, hold_times=TIMES, values=measured, errors=errors, curves=curves,
        prior_fitted=samples, fitted=samples + (noisy - samples) @ gain.T, **more,
    )  # fmt: skip


def correlated(y, e, rng):
    near = np.exp(-np.abs(np.log(TIMES)[:, None] - np.log(TIMES)) / 8) * (CURVE[:, None] == CURVE)
    return y + 3 * e * (np.linalg.cholesky(near + 1e-9 * np.eye(36)) @ rng.standard_normal(36))


TROUBLES = {
    "factor b": {"change": lambda y, e, rng: y * np.where(CURVE == 1, 1.15, 1.0)},
    "drift ": {"change": lambda y, e, rng: y * (1 + 0.06 * DECADES)},
    "offset ": {"change": lambda y, e, rng: y + 0.08 * y.max()},
    "temperature c": {"kelvin": KELVIN + 15 * (CURVE == 2)},
    "correlated ": {"change": correlated},
    "outlier d at 10 s": {"change": lambda y, e, rng: y + 12 * e * (np.arange(36) == 31)},
    "scaled ": {"change": lambda y, e, rng: y + 2.5 * e * rng.standard_normal(36)},
}


@pytest.mark.parametrize("trouble", TROUBLES)
def test_a_trouble_is_named(trouble):
    """In nine of ten cases among what the data do not tell apart, and mostly as the first."""
    kind, _, where = trouble.partition(" ")
    named = [inferred(seed, **TROUBLES[trouble]).critic.named for seed in range(10)]
    assert sum((kind, where) in [(it.kind, it.where) for it in some] for some in named) >= 9
    assert sum(bool(some) and some[0].kind == kind for some in named) >= 6


def test_several_wrong_values_of_one_curve_are_not_taken_for_larger_errors():
    """Three of nine, by eight standard errors up or down: in all cases among what the data do not tell apart."""
    bad = np.isin(np.arange(36), [10, 12, 16])
    cases = [inferred(seed, lambda y, e, rng: y + 8 * e * bad * rng.choice([-1, 1], 36)) for seed in range(10)]
    named = [case.critic.named for case in cases]
    places = {"b at 0.0562 s", "b at 1.78 s", "b at 1.78e+03 s"}
    found = [[it for it in some if it.kind == "outliers" and places <= set(it.where.split(", "))] for some in named]
    assert all(found)
    assert sum(some[0].kind == "outliers" for some in named) >= 6
    assert all(4 < abs(it.amplitude) < 12 for some in found for it in some)


def test_no_cause_is_named_before_the_question_about_celsius_is_answered():
    drifts = inferred(0, TROUBLES["drift "]["change"])
    cold = [{**about, "temperature": 27.0} for about in drifts.curves]
    asked = drifts.model_copy(update={"curves": tuple(cold)})
    assert not asked.critic.named
    meant = asked.model_copy(update={"curves": tuple({**about, "temperature_unit": "K"} for about in cold)})
    assert not meant.critic.asked


def test_clean_measurements_are_hardly_ever_accused():
    accused = sum(bool(inferred(100 + seed).critic.named) for seed in range(100))
    assert accused <= 5


def test_what_goes_unnoticed_is_said():
    clean = inferred(100)
    (note,) = [note for note in clean.critic.notes() if note.startswith("would go unnoticed")]
    assert "a factor of all forces" in note
    least = next(it.least for it in clean.critic.causes if it.kind == "drift" and not it.where)
    found = [
        any(it.kind == "drift" for it in inferred(seed, lambda y, e, r: y * (1 + least / 100 * DECADES)).critic.named)
        for seed in range(100, 120)
    ]
    assert np.mean(found) > 0.8


def test_neighbours_cannot_be_told_from_higher_barriers():
    """A front of energies at which so many sites are bonded moves alike at all temperatures and loads."""
    found = [inferred(seed, slower=0.1).critic for seed in range(10)]
    assert not any(one.named for one in found)
    assert all(any(it.kind == "interaction" and it.least > 0.05 for it in one.missed) for one in found)


def test_what_is_admitted_is_not_named_again():
    drifts = inferred(0, TROUBLES["drift "]["change"], error_terms={"drift": np.zeros(400)})
    assert not any(it.kind == "drift" and not it.where for it in drifts.critic.named)


def test_a_forecast_says_how_it_changes_with_the_likeliest_cause():
    """Without noise, the values with a drift admitted are the true ones."""
    found = inferred(0, TROUBLES["drift "]["change"])
    near = inferred(0)
    (note, *_) = found.critic.of_forecast(TIMES[:9], found.fitted[:, :9], np.arange(400))
    assert note.startswith("a drift, once admitted, changes ΔF")
    moved = float(note.split("about ")[1].split(" %")[0]) / 100
    at = int(np.argmin(np.abs(TIMES[:9] - float(note.split("at ")[1].split(" s")[0]))))
    change = near.fitted[:, at].mean() / found.fitted[:, at].mean() - 1
    assert moved == pytest.approx(change, abs=0.05)


def test_improbable_points_that_no_cause_explains_are_named():
    wild = inferred(3, lambda y, e, rng: y + 4 * e * np.where((CURVE == 1) & (DECADES > 1), [-1, 1] * 18, 0.0))
    least, where = wild.critic.improbable()
    assert least < 0.01
    assert where.startswith("b, ")


def test_degrees_celsius_are_asked_for_where_no_density_explains_kelvin():
    """More bonds than sites: refused before anything is sampled."""
    drops = 1e3 * values(densities(1, np.random.default_rng(0))[0])[:9]
    curve = ca.MeasuredCurve(load=30.0, temperature=27.0, hold_times=TIMES[:9], values=drops, errors=0.03 * drops)
    with pytest.raises(ca.InputError, match="27 °C meant"):
        ca.infer(curve, SCENE, samples=50)
