"""Bonds under a growing force: mean forces and distributions against numerical integration and closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expn
from seen import read_grid, survey_of

import chemage as ca
from chemage import InputError

KB = ca.plugin.KB
EV_PER_NM = 0.1602176634  # nN
EXPONENTS = {"cusp": 0.5, "cubic": 2 / 3, "constant": 1.0}
LENGTH, BARRIER = 0.03, 1.1


def rate_of(force: float, nu: float, barrier: float, temperature: float) -> float:
    """The published rate, 1/s, at ``force`` (nN)."""
    b = barrier / (KB * temperature)
    left = 1 - nu * force * LENGTH / (barrier * EV_PER_NM)
    return 1e13 * left ** (1 / nu - 1) * math.exp(-b * left ** (1 / nu)) if left > 0 else 1e13


def survival_mean(nu: float, loading: float, barrier: float, temperature: float) -> float:
    """⟨F⟩ by integrating rate and survival numerically in pieces, with none of the closed forms."""
    end = barrier * EV_PER_NM / (nu * LENGTH)
    edges = np.linspace(0, end, 1501)
    at, weights = np.polynomial.legendre.leggauss(8)
    # inside a piece from its beginning to each node, and to its end
    inner = np.polynomial.legendre.leggauss(6)
    hazard = total = 0.0
    for low, high in pairwise(edges):
        half = (high - low) / 2
        for node, weight in zip(at, weights, strict=True):
            width = half * (node + 1) / 2
            part = sum(
                w * rate_of(low + width * (x + 1), nu, barrier, temperature) for x, w in zip(*inner, strict=True)
            )
            total += half * weight * math.exp(-min(hazard + part * width / loading, 745.0))
        part = sum(w * rate_of(low + half * (x + 1), nu, barrier, temperature) for x, w in zip(*inner, strict=True))
        hazard += part * half / loading
        if hazard > 60:
            break
    return total


def law(kind: str, loading: float = 1e3, **options):
    return ca.rupture(kind, transition_distance=LENGTH, loading_rate=loading, **options)


@pytest.mark.parametrize("shape", EXPONENTS)
@pytest.mark.parametrize("decade", range(-2, 9, 2))
def test_mean_force_is_the_integral_of_the_survival(shape, decade):
    loading = 10.0**decade
    found = law("dudko-hummer-szabo", loading, shape=shape).mean_forces(np.array([BARRIER]), 300.0)[0]
    assert found == pytest.approx(survival_mean(EXPONENTS[shape], loading, BARRIER, 300.0), rel=1e-6)


@pytest.mark.parametrize("decade", range(-2, 9))
def test_bell_is_its_closed_form_and_the_case_of_the_general_law(decade):
    loading, kt = 10.0**decade, KB * 300
    scale = kt * EV_PER_NM / LENGTH
    y = 1e13 * math.exp(-BARRIER / kt) * scale / loading
    # e^y E1(y) by its integral, ∫ exp(−y s)/(1 + s) ds, where y is not small, and by scipy's expn otherwise
    e1 = quad(lambda s: math.exp(-y * s) / (1 + s), 0, math.inf)[0] if y > 0.1 else math.exp(y) * expn(1, y)
    barriers = np.array([BARRIER])
    assert law("bell", loading).mean_forces(barriers, 300.0)[0] == pytest.approx(scale * e1, rel=1e-7)
    for kind in ("dudko-hummer-szabo", "friddle"):
        same = law(kind, loading, shape="constant").mean_forces(barriers, 300.0)[0]
        assert same == pytest.approx(law("bell", loading).mean_forces(barriers, 300.0)[0], rel=1e-12)


@pytest.mark.parametrize("shape", ["cusp", "cubic"])
def test_friddle_is_close_to_the_integral_and_says_that_it_is_approximate(shape):
    for loading in 10.0 ** np.arange(-2, 9):
        near = law("friddle", loading, shape=shape)
        exact = law("dudko-hummer-szabo", loading, shape=shape)
        found, true = (one.mean_forces(np.array([BARRIER]), 300.0)[0] for one in (near, exact))
        assert found == pytest.approx(true, rel=2e-3)
        assert (near.exact, exact.exact) == (False, True)


@pytest.mark.parametrize("barrier", [-0.3, 0.0, 0.005, 0.02, 0.3, 1.1, 3.0, 30.0])
@pytest.mark.parametrize("shape", EXPONENTS)
def test_limits_of_slow_and_fast_loading_and_of_no_barrier(barrier, shape):
    """Slow: a bond breaks by itself, ⟨F⟩ = Ḟ/k₀. Fast: it breaks at ν₀ beyond the force at which no barrier is left."""
    k0 = 1e13 * math.exp(-max(barrier, 0.0) / (KB * 300))
    one = np.array([barrier])
    slow = 1e-12 * k0
    if slow > 1e-90:
        assert law("dudko-hummer-szabo", slow, shape=shape).mean_forces(one, 300.0)[0] == pytest.approx(1e-12, rel=1e-6)
    vanishes = max(barrier, 0.0) * EV_PER_NM / (EXPONENTS[shape] * LENGTH)
    found = law("dudko-hummer-szabo", 1e30, shape=shape).mean_forces(one, 300.0)[0]
    assert found == pytest.approx(vanishes + 1e30 / 1e13, rel=1e-6)
    assert law("bell", 1e30).mean_forces(one, 300.0)[0] == pytest.approx(1e17, rel=1e-6)
    if barrier <= 0:
        assert law("bell").mean_forces(one, 300.0)[0] == pytest.approx(1e-10, rel=1e-9)


@pytest.mark.parametrize("shape", EXPONENTS)
@pytest.mark.parametrize("barrier", [0.0, 0.01, 0.2, 1.1])
def test_the_density_is_that_of_the_mean_force(shape, barrier):
    """∫p dF = 1 and ∫F p dF = ⟨F⟩, also where the barrier vanishes before bonds break."""
    for loading in (1e3, 1e11, 1e14):
        one = law("dudko-hummer-szabo", loading, shape=shape)
        ramp = one.ramp(np.array([barrier]), 300.0, 1e13)
        mean = one.mean_forces(np.array([barrier]), 300.0)[0] / ramp.thermal
        end = barrier / (KB * 300) / EXPONENTS[shape]
        corner = float(ramp.force(ramp.top)[0])
        last = end + 60 / ramp.attempts if float(ramp.hazard(np.array([end]))[0, 0]) < 60 else end
        total = first = 0.0
        # also logarithmic from below: where little barrier is left, bonds break long before it vanishes
        edges = np.concatenate([[0.0], np.geomspace(1e-12 * mean, last, 60_001), [corner, end]])
        edges = np.unique(edges[edges <= last])
        middle = (edges[1:] + edges[:-1]) / 2
        values = ramp.density(middle)[0] * np.diff(edges)
        total, first = values.sum(), (values * middle).sum()
        assert total == pytest.approx(1.0, rel=2e-4)
        assert first == pytest.approx(mean, rel=2e-4)


def test_no_rate_is_above_the_attempt_frequency_and_none_falls_with_force():
    for shape, nu in EXPONENTS.items():
        ramp = law("dudko-hummer-szabo", shape=shape).ramp(np.array([0.0, 0.01, 0.3, 1.1]), 300.0, 1e13)
        force = np.linspace(0, 1.2 * 1.1 / (KB * 300 * nu), 4000)
        hazard = ramp.hazard(force)
        rates = np.diff(hazard, axis=1) / np.diff(force)
        assert (rates <= ramp.attempts * (1 + 1e-7)).all()
        sure = hazard[:, 1:] < 1e3 * rates  # where a difference has digits
        assert (np.diff(rates, axis=1) >= -1e-6 * rates[:, 1:])[sure[:, 1:]].all()


def aged(rupture, **options) -> ca.Ageing:
    contact = ca.contact("hertz", modulus=35.3).solve(
        ca.surface("sphere", radius=30, pixels=32, pixel_size=0.45).make(), 50
    )
    breaking = ca.barriers("gaussian", mean=1.1, std=0.02)
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper=1.2), breaking=breaking, **options)
    return ca.age(
        contact,
        chemistry,
        engine=ca.engine("rejection-free"),
        hold_times=ca.hold_times(1e-2, 1e3, 1),
        temperature=300,
        replicas=2,
        rupture=rupture,
    )


def test_friction_is_the_sum_over_bonds_and_grows_with_the_log_of_speed():
    slow, fast = (
        aged(ca.rupture("bell", transition_distance=0.05, speed=v, stiffness=10)) for v in ("1 nm/s", "1 um/s")
    )
    np.testing.assert_array_equal(slow.bonds, fast.bonds)
    there = slow.bonds > 0
    rise = (fast.friction_drop - slow.friction_drop)[there] / slow.bonds[there]
    np.testing.assert_allclose(rise, KB * 300 * EV_PER_NM / 0.05 * math.log(1e3), rtol=1e-3)
    density = fast.observables["bond_force_density"]
    grid = fast.observables["bond_force_grid"][0]
    np.testing.assert_allclose((density * (grid[1] - grid[0])).sum(axis=1), 1.0, rtol=1e-3)
    each = fast.observables["mean_bond_force"]
    np.testing.assert_allclose(each * fast.bonds, fast.friction_drop, rtol=1e-12)


def test_options_that_contradict_each_other_are_refused_or_warned_of():
    for given in ({}, {"speed": 1}, {"loading_rate": 1, "speed": 1}, {"loading_rate": 1, "speed": 1, "stiffness": 1}):
        with pytest.raises(InputError, match="either loading_rate, or both speed and stiffness"):
            ca.rupture("bell", transition_distance=0.1, **given)
    breaking = ca.barriers("gaussian", mean=1.1, std=0.0)
    chemistry = ca.chemistry(forming=breaking, breaking=breaking, bond_force=3.0)
    said = "at most 1.76 nN; bond_force = 3 nN of the chemistry is not used, and would need a distance below 0.0587"
    wide = ca.rupture("bell", transition_distance=0.1, loading_rate=1e3)
    assert any(said in doubt for doubt in wide.check(chemistry, 300.0))
    assert law("bell").check(chemistry, 300.0) == []
    assert "the barrier vanishes before most bonds break" in law("bell", 1e15).check(chemistry, 300.0)[0]
    assert "break by themselves" in law("bell", 1e-8).check(chemistry, 300.0)[0]
    with pytest.raises(InputError, match=r"here bonds last; give \[breaking\]"):
        wide.check(ca.chemistry(forming=breaking), 300.0)


def test_a_sweep_of_temperature_says_that_the_force_of_a_bond_does_not_follow():
    scene = {
        "surface": {"kind": "sphere", "radius": 30, "pixels": 16, "pixel_size": 0.45},
        "contact": {"kind": "hertz", "modulus": 35.3, "load": 50},
        "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
        "breaking": {"kind": "gaussian", "mean": 1.1, "std": 0.02},
        "engine": {"kind": "rejection-free"},
        "hold": {"temperature": 300, "start": 1, "stop": 10, "per_decade": 1, "replicas": 2},
    }
    with_law = {"rupture": {"kind": "bell", "transition_distance": 0.05, "loading_rate": 1e4}}
    for law, path, said in (({}, "hold.temperature", 1), ({}, "contact.load", 0), (with_law, "hold.temperature", 0)):
        values = [300, 310] if path == "hold.temperature" else [40, 50]
        warned = survey_of(read_grid({**scene, **law, "sweep": {path: values}})).warnings()
        assert sum("bonds break at 3 nN at every temperature" in text for text in warned) == said
