"""Tests of claims accept what the paper says, its own numbers among them, and refuse rivals as often as they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from chemage.plugin import ClaimTest, Limits, decisions
from chemage_li2018 import claims, shapes
from chemage_li2018.sweeps import TARGETS, read_points, studies_of

STORED = Path(__file__).parents[2] / "plugins" / "chemage_li2018" / "docs" / "reproduction.npz"
TIMES = np.logspace(0, 5, 21)


@pytest.fixture(scope="module")
def found() -> list[claims.Claim]:
    """The claims on the points of the page."""
    points, about = read_points(STORED)
    return claims.claims(studies_of(points, about["targets"]), about["targets"])


def test_every_claim_accepts_what_it_says_and_refuses_its_rivals_where_there_is_no_noise(found):
    """What a claim says is the paper's own number where it prints one (N_p, the ratios of β, 1 and 10 s, 1 to 10 s)."""
    tested = [one for one in found if one.test]
    assert {one.target for one in tested} < set(TARGETS)
    assert len(tested) == len(claims.DATA["claims"])
    for one in tested:
        assert one.test.accepts(one.test.truth(one.test.claimed)[None]), one.sentence
        for name, numbers in one.test.rivals.items():
            assert not one.test.accepts(one.test.truth(numbers)[None]), (one.sentence, name)


def test_every_claim_of_a_law_has_twelve_rivals(found):
    assert sum(one.shape for one in found) >= 8
    assert min(len(one.test.rivals) for one in found if one.shape) >= 12


def drawn(test: ClaimTest, truth: np.ndarray, count: int) -> float:
    """Share of sets that are refused, with normal noise of the covariance of ours in place of drawn surfaces."""
    rng = np.random.default_rng(7)
    if test.errors is not None:
        noise = test.errors * rng.standard_normal((count, *test.values.shape))
    else:
        away = test.values / test.values.mean(axis=0) - 1
        surfaces = len(away)
        weights = rng.standard_normal((count, surfaces, surfaces)) / np.sqrt(surfaces - 1)
        noise = np.einsum("cij,j...->ci...", weights, away)
    return float(np.mean([not test.accepts(np.maximum(truth * (1 + one), 1e-12)) for one in noise]))


@pytest.mark.long
def test_rivals_of_laws_are_refused_where_the_power_says_so_under_noise_drawn_otherwise(found):
    for one in found:
        if one.shape and one.test.decidable:
            for name, rate in one.test.power.items():
                if rate >= decisions.POWER:
                    assert drawn(one.test, one.test.truth(one.test.rivals[name]), 60) >= decisions.POWER - 0.15, (
                        one.sentence,
                        name,
                    )
            assert drawn(one.test, one.test.truth(one.test.claimed), 60) <= one.test.false_alarm + 0.12, one.sentence


@pytest.mark.long
def test_the_words_of_the_page_follow_from_the_rates(found):
    for one in found:
        if one.test and one.word in (decisions.PREDICTED, decisions.READ_AS):
            assert min(one.test.power.values()) >= decisions.POWER
        if one.word == decisions.DISAGREES:
            assert one.test.support <= 1 - decisions.POWER


# -- shapes -----------------------------------------------------------------------------------------------------------


def furthest(curve: np.ndarray) -> float:
    return float(np.abs(shapes.local_slopes(TIMES, curve) - 1).max())


def test_the_law_of_the_field_is_a_logarithm_and_a_hump_with_equal_ends_is_none():
    """log(1 + t/0.3 s) has a local slope that is 8 % too low in its first decade; R² is above 0.99 in all of these."""
    rivals = {name: shapes.grown(TIMES, slopes) for name, slopes in claims.DATA["rivals"]["growth"].items()}
    hump = rivals["40 % steeper in the middle"]
    assert furthest(np.log1p(TIMES / 0.3)) < 0.09
    assert furthest(shapes.grown(TIMES, [0.92, 1, 1, 1, 1])) == pytest.approx(furthest(np.log1p(TIMES / 0.3)), abs=0.03)
    assert np.corrcoef(np.log10(TIMES), hump)[0, 1] ** 2 > 0.99
    assert min(furthest(rival) for rival in rivals.values()) > 0.15
    assert furthest(rivals["t^0.1"]) == pytest.approx(furthest(TIMES**0.1), rel=0.1)


def test_a_power_of_nearly_one_is_not_proportional():
    loads = np.array([5.0, 10.0, 20.0, 50.0])
    assert shapes.power(loads, loads**0.95) == pytest.approx((0.95, 0.0))
    exponent, away = shapes.power(loads, loads + 2.0)
    assert exponent < 0.92
    assert away > 0.01


def test_the_offset_of_a_line():
    x = np.linspace(1, 5, 9)
    assert shapes.line(x, 3 + 2 * x) == pytest.approx((0.0, 3 / 9, 0.0))
    assert shapes.line(x, x**0.5)[0] < 0.04
    assert shapes.line(x, x**0.5)[2] > 1e6


# -- rules ------------------------------------------------------------------------------------------------------------


def judged(value: float, scatter: float, *, surfaces: int = 8, rival: float = 2.0, **more) -> ClaimTest:
    """A number that should be 1, by at most 10 %."""
    rng = np.random.default_rng(3)
    away = rng.standard_normal(surfaces)
    away = (away - away.mean()) / away.std(ddof=1) if surfaces > 1 else away
    values = (value + scatter * away)[:, None]
    limits = [Limits("ours", 0.9, 1.1)]
    return ClaimTest(values, list, np.array, limits=limits, claimed=[1.0], rivals={"twice": [rival]}, **more)


@pytest.mark.parametrize(
    ("test", "word"),
    [
        (judged(1.0, 0.05), decisions.PREDICTED),
        (judged(1.3, 0.05), decisions.DISAGREES),
        (judged(1.0, 0.05, rival=1.11), decisions.CANNOT),
        (judged(1.12, 0.3), decisions.CANNOT),
        (judged(1.0, 0.05, surfaces=1), decisions.CANNOT),
        (judged(1.0, 0.0, surfaces=1, errors=np.array([0.02])), decisions.PREDICTED),
        (judged(1.0, 0.05, readings={"otherwise": np.full((8, 1), 1.4)}), decisions.READ_AS),
    ],
)
def test_words_of_claims(test, word):
    assert test.word() == word


def test_a_test_without_power_says_what_it_would_take():
    """A rival at 1.2 with an error of 0.11 is refused in 83 % of draws, and the claim is so in 36 %."""
    test = judged(1.0, 0.3, rival=1.2)
    assert test.word() == decisions.CANNOT
    assert test.false_alarm == pytest.approx(0.36, abs=0.08)
    assert test.remedy == "16 times as many surfaces would tell" or test.remedy == "4 times as many surfaces would tell"
    assert judged(1.0, 0.3, rival=1.05).remedy == "more surfaces would not tell"
