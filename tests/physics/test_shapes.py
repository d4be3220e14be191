"""Claims of shape lose against the rivals that an R² lets pass."""

from __future__ import annotations

import numpy as np
import pytest

from chemage_li2018 import sweeps
from chemage_li2018.claims import claims
from chemage_li2018.comparisons import Claim
from chemage_li2018.shapes import Exponent, growth
from chemage_li2018.sweeps import PointSet, StudyPoint

TIMES = np.logspace(0, 5, 21)
WINDOW = (1.0, 1e5)
DECADES = np.log10(TIMES)


def noisy(curve: np.ndarray, bonds: float, count: int = 10, seed: int = 3) -> np.ndarray:
    """Counts whose mean is ``bonds`` times ``curve``, with independent increments, per bond."""
    rng = np.random.default_rng(seed)
    increments = rng.poisson(bonds * np.diff(curve, prepend=0.0), (count, curve.size))
    return increments.cumsum(axis=1) / bonds


def r2(curve: np.ndarray) -> float:
    return float(np.corrcoef(DECADES, curve)[0, 1] ** 2)


FALLING = DECADES - 0.05 * DECADES**2 + 1.0


@pytest.mark.parametrize(("curve", "limit"), [(TIMES**0.05, 0.98), (FALLING, 0.98)], ids=["t^.05", "slope that halves"])
def test_what_passed_as_a_logarithm_is_none(curve, limit):
    assert r2(curve) > limit
    compared = growth(TIMES, noisy(curve, 20_000), WINDOW)
    assert not compared.holds("logarithm")
    assert compared.criterion("logarithm") > 10


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 5))])
def test_a_logarithm_beats_its_rivals(seed):
    compared = growth(TIMES, noisy(1.0 + 0.5 * DECADES, 20_000, seed=seed), WINDOW)
    change, error = compared.change
    assert compared.holds("logarithm")
    assert abs(change) < 4 * error


@pytest.mark.parametrize("power", [0.05, 0.3])
def test_a_power_is_found_with_its_exponent(power):
    compared = growth(TIMES, noisy(TIMES**power, 20_000), WINDOW)
    assert compared.laws[0].name == "power"
    assert compared.laws[0].parameters[1] == pytest.approx(power, abs=0.02)


def test_a_power_whose_exponent_runs_to_zero_is_called_the_logarithm():
    compared = growth(TIMES, noisy(FALLING, 20_000), WINDOW)
    laws = {law.name: law for law in compared.laws}
    assert laws["power"].parameters == ()
    assert laws["power"].chi_squared == laws["logarithm"].chi_squared
    assert laws["power"].criterion > laws["logarithm"].criterion


def test_an_exponent_of_two_thirds_is_not_one():
    loads = np.array([23.0, 50.0, 100.0, 200.0, 393.0])
    assert np.corrcoef(loads, loads ** (2 / 3))[0, 1] ** 2 > 0.95
    rng = np.random.default_rng(1)
    drop = loads ** (2 / 3) * rng.normal(1.0, 0.02, (8, 5))
    power = Exponent.of(loads, drop)
    assert abs(power.value - 2 / 3) < power.half_width < abs(power.value - 1)
    line = Exponent.of(loads, loads * rng.normal(1.0, 0.02, (8, 5)))
    assert abs(line.value - 1) < line.half_width < abs(line.value - 2 / 3)


def test_the_area_of_a_surface_is_no_error_of_the_shape():
    """Surfaces differ by a factor common to all hold times; the logarithm is refused as well as without it."""
    factors = np.random.default_rng(5).normal(1.0, 0.2, (10, 1))
    compared = growth(TIMES, factors * noisy(TIMES**0.05, 20_000), WINDOW)
    assert not compared.holds("logarithm")
    assert compared.criterion("logarithm") > 10


# -- the claims themselves ---------------------------------------------------------------------------------------------


def loads(shape: np.ndarray, power: float = 1.0, surfaces: int = 4) -> PointSet:
    """Points of Fig. 2 that follow ``shape`` in time and a power of the load, with the noise of counts."""
    points = PointSet()
    for load in [point[sweeps.LOAD] for point in sweeps.members("loads")]:
        change = {**sweeps.members("reference")[0], "contact.load": load}
        for seed, curve in enumerate(noisy(shape, 20_000, surfaces, seed=int(load))):
            drop = curve * load**power
            summary = {"load": load, "area_fraction": load / 2e6, "kappa": 2.0}
            pressures = {"pressures": np.ones(4)}
            points.append(StudyPoint({**change, "surface.seed": seed}, summary, TIMES, drop, 0.0 * drop, pressures))
    return points


def claim(points: dict[str, PointSet], target: str, words: str) -> Claim:
    return next(one for one in claims(points, [target]) if words in one.statement)


@pytest.mark.parametrize(
    ("shape", "holds"), [(TIMES**0.05, False), (FALLING, False), (1 + DECADES, True)], ids=["t^.05", "halves", "log t"]
)
def test_only_a_logarithm_satisfies_the_claim_of_one(shape, holds):
    found = claim({"loads": loads(shape)}, "fig2", "log t")
    assert found.holds is holds
    assert {law.name for law in found.laws} == {"logarithm", "power", "stretched exponential"}


def test_a_logarithm_of_one_surface_is_not_tested():
    found = claim({"loads": loads(1 + DECADES, surfaces=1)}, "fig2", "log t")
    assert found.word == "not tested"


@pytest.mark.parametrize(
    ("power", "holds"), [(1.0, True), pytest.param(2 / 3, False, marks=pytest.mark.long), (0.9, False)]
)
def test_only_a_line_satisfies_the_claims_of_one(power, holds):
    found = {"loads": loads(1 + DECADES, power)}
    assert claim(found, "fig2", "linear in A").holds is holds


@pytest.mark.parametrize(
    ("law", "holds"),
    [(lambda f: 20 * f ** (2 / 3), False), (lambda f: 200 + 5 * f, True)],
    ids=["F^(2/3)", "line with an offset"],
)
def test_the_area_of_a_sphere_is_no_line_with_an_offset(law, holds):
    group = PointSet()
    for load in [23.0, 50.0, 100.0, 200.0, 393.0]:
        drop = np.full(TIMES.size, law(load) * np.random.default_rng(int(load)).normal(1, 0.005))
        changes = {"surface.radius": 30.0, "contact.load": load}
        group.append(StudyPoint(changes, {"load": load}, TIMES, drop, 0.01 * drop))
    found = claim({"tips": group}, "tips", "linear in the load")
    assert found.holds is holds
