"""The control of an ensemble: a cheap number of each surface, on which the first level is regressed."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_levels import Drawn, Timer, nothing

import chemage as ca
from chemage import Ensemble, ensemble
from chemage.foundation.result import result_of
from chemage.studies.ensembles import computations
from chemage.studies.ensembles.quantities import half_width, regressed, spread_of
from chemage.studies.ensembles.stages import CONTROLLED, Clock, Route, State, run_stages

ROUGH = {
    "name": "small",
    "surface": {"kind": "self-affine", "pixels": 256, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 24,
                "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 1000.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "chemistry": {"activation_volume": "6.4 angstrom**3"},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 3, "seed": 5},
}  # fmt: skip


class Pair:
    """A level and its control: two numbers of each surface that are correlated."""

    def __init__(self, seed: int, correlation: float, skewed: float = 0.2, timer: Timer | None = None):
        self.rng, self.correlation, self.skewed, self.timer = (
            np.random.default_rng(seed),
            correlation,
            skewed,
            timer or Timer(),
        )
        self.numbers = np.zeros((2, 0))
        self.first, self.control = Side(self, 0.25, self.level), Side(self, 0.05, self.area)

    def upto(self, count: int) -> np.ndarray:
        missing = count - self.numbers.shape[1]
        if missing > 0:
            self.numbers = np.concatenate([self.numbers, self.rng.standard_normal((2, missing))], axis=1)
        return self.numbers[:, :count]

    def shaped(self, x: np.ndarray) -> np.ndarray:
        """Of variance one, and skewed."""
        s = self.skewed
        return (np.exp(s * x - s**2 / 2) - 1) / np.sqrt(np.expm1(s**2)) if s else x

    def level(self, numbers: np.ndarray) -> np.ndarray:
        mixed = self.correlation * numbers[0] + np.sqrt(1 - self.correlation**2) * numbers[1]
        return 1 + 0.06 * self.shaped(mixed)

    def area(self, numbers: np.ndarray) -> np.ndarray:
        return 7 + 3 * self.shaped(numbers[0])


class Side:
    """One of the two."""

    def __init__(self, pair: Pair, cost: float, value):
        self.pair, self.cost, self.value = pair, cost, value

    def sample(self, begin: int, end: int) -> np.ndarray:
        self.pair.timer.time += (end - begin) * self.cost
        return self.value(self.pair.upto(end)[:, begin:end])[:, None]


def sampled(seed: int, correlation: float, wanted: float, difference: float | None = None, control: bool = True):
    """The state in which sampling ends, and its cost."""
    pair = Pair(seed, correlation)
    levels = (pair.first,)
    if difference is not None:
        levels = (pair.first, Drawn(np.random.default_rng([seed, 1]), 0.0, difference, 3.0))
    route = Route("", levels, nothing, pair.control if control else None)
    state = run_stages([route], np.array([wanted]), most=10**6)
    return state, sum(one.count * one.level.cost for one in state.sampled)


def test_the_mean_is_that_of_the_textbook():
    rng = np.random.default_rng(3)
    x = rng.normal(size=90)
    y = np.stack([2 * x[:30] + rng.normal(size=30), rng.normal(size=30)], axis=1)
    first, second = regressed([y, x[:, None]])
    for column in (0, 1):
        slope = np.polyfit(x[:30], y[:, column], 1)[0]
        wanted = y[:, column].mean() + slope * (x.mean() - x[:30].mean())
        assert first[:, column].mean() + second[:, column].mean() == pytest.approx(wanted, rel=1e-12)
    # what remains does not depend on the control, and the two add up to the scatter
    assert np.abs(x[:30] @ (first - first.mean(axis=0))).max() < 1e-10


def test_a_control_that_is_the_same_everywhere_changes_nothing():
    y = np.random.default_rng(3).normal(size=(8, 2))
    first, second = regressed([y, np.full((20, 1), 0.3)])
    assert np.array_equal(first, y)
    assert not second.any()


def test_the_variance_is_that_of_repeated_samplings():
    means, variances = [], []
    for seed in range(3000):
        numbers = Pair(seed, 0.9, 0.0)
        terms = regressed([numbers.level(numbers.upto(200))[:20, None], numbers.area(numbers.upto(200))[:, None]])
        spreads = [spread_of(terms[0], 20, 19, True), spread_of(terms[1], 200, 199)]
        means.append(sum(float(one.mean()) for one in terms))
        variances.append(spreads[0].variance[0] / 20 + spreads[1].variance[0] / 200)
    # 3000 variances of normal means have a relative standard error of 2.6 %
    assert np.mean(variances) == pytest.approx(np.var(means, ddof=1), rel=0.1)
    closed = 0.06**2 * (0.19 / 20 * (1 + 1 / 17) + 0.81 / 200)
    assert np.mean(variances) == pytest.approx(closed, rel=0.05)


def test_a_good_control_costs_less_than_half_and_a_bad_one_hardly_more():
    def cost(correlation: float, control: bool) -> float:
        return float(np.median([sampled(seed, correlation, 0.01, control=control)[1] for seed in range(25)]))

    alone = cost(0.0, False)
    assert cost(0.975, True) < 0.5 * alone
    assert cost(0.2, True) < 1.15 * alone


def test_every_sample_of_the_first_level_has_its_control_and_the_interval_is_as_asked():
    for seed in range(20):
        state, _ = sampled(seed, 0.95, 0.01, 0.006)
        assert state.half_width()[0] <= 0.01 * state.mean[0] * (1 + 1e-12)
        assert len(state.sampled) == 2 + state.controlled
        assert not state.controlled or state.counts[-1] >= state.counts[0]


def test_few_samples_take_no_control():
    state, _ = sampled(1, 0.99, 0.05)
    assert not state.controlled
    assert state.counts[0] < CONTROLLED


@pytest.mark.long
@pytest.mark.parametrize(
    ("correlation", "wanted", "difference"),
    [(0.975, 0.01, None), (0.975, 0.01, 0.006), (0.9, 0.01, None), (0.95, 0.02, 0.006)],
)
def test_the_interval_holds_the_truth_as_often_as_it_says(correlation, wanted, difference):
    """Of 400 intervals 93 to 98 % hold the truth, give or take three standard errors of such a count."""
    held = []
    for seed in range(400):
        state, _ = sampled(seed, correlation, wanted, difference)
        held.append(abs(state.mean[0] - 1) <= state.half_width()[0])
    slack = 3 * np.sqrt(0.95 * 0.05 / 400)
    assert 0.93 - slack <= np.mean(held) <= 0.98 + slack


@pytest.mark.parametrize("seconds", [20.0, 60.0])
def test_a_budget_is_kept_and_a_control_makes_its_interval_narrower(seconds):
    def half(control: bool) -> float:
        timer = Timer()
        pair = Pair(4, 0.975, timer=timer)
        route = Route("", (pair.first,), nothing, pair.control if control else None)
        state = run_stages([route], np.array([0.0]), most=10**6, clock=Clock(seconds, timer))
        assert 0.85 * seconds < timer.time <= 1.1 * seconds
        return float(state.half_width()[0])

    assert half(True) < 0.8 * half(False)


@pytest.fixture(scope="module")
def scene() -> ca.Scene:
    return ca.parse_scene(ROUGH)


@pytest.fixture(scope="module")
def made(scene) -> Ensemble:
    # on so small a contact a sketch costs half of it; as cheap as on large ones, it is taken
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(computations.Control, "cost", 0.001)
        return ensemble(scene, accuracy={"beta": "3 %"}, threads=1)


def test_an_ensemble_is_regressed_on_the_area_of_sketches(scene, made):
    assert made.controlled
    first, sketches = made.rows["0"], made.rows[str(len(made.levels) - 1)]
    assert sketches.shape[1] == 1
    assert len(sketches) >= len(first)
    # the area of the sketch is that of the surface with the same seed
    surface, _ = made.levels[0]["seeds"][4]
    assert made.levels[-1]["seeds"][4][0] == surface
    maker = scene.surface.sketch()
    assert maker is not None
    solved = scene.contact.solve(maker.make(surface), scene.load)
    assert sketches[4, 0] == pytest.approx(solved.area_fraction, rel=1e-9)
    assert np.corrcoef(first[:, 0], sketches[: len(first), 0])[0, 1] > 0.8
    assert made.estimate("beta").relative <= 0.03


def test_its_numbers_are_those_of_the_rule_and_come_back_from_a_file(scene, made, tmp_path):
    terms = regressed([made.rows[str(number)] for number in range(len(made.levels))])
    spreads = [
        spread_of(term, level["variance_of"], level["freedom"], not number)
        for number, (term, level) in enumerate(zip(terms, made.levels, strict=True))
    ]
    base = np.sqrt(sum((made.mean * known) ** 2 for known in made.known.values()) + np.zeros(made.mean.size))
    half = half_width(spreads, [len(term) for term in terms], base)
    assert made.half_widths == pytest.approx(half, rel=1e-12, nan_ok=True)
    beta = made.estimate("beta")
    squares = sum(part.size**2 for part in beta.errors.values())
    own = sum(float(one.variance[0]) / len(term) for one, term in zip(spreads, terms, strict=True)) + base[0] ** 2
    assert squares == pytest.approx(own, rel=1e-9)
    ca.write(tmp_path / "made.h5", made)
    again = ca.read(tmp_path / "made.h5")
    assert again.digest() == made.digest()
    assert np.array_equal(again.half_widths, made.half_widths, equal_nan=True)


def test_it_is_the_mean_of_the_surfaces_alone_within_the_error(scene, made):
    alone = ensemble(scene, surfaces=60).estimate("beta")
    beta = made.estimate("beta")
    assert abs(beta.value - alone.value) < 1.5 * np.hypot(beta.half_width, alone.half_width)


def test_its_text_says_what_it_was_regressed_on(made):
    text = dict(result_of(made).rows())["regressed on"]
    assert f"{len(made.rows[str(len(made.levels) - 1)])} surfaces" in text
    assert "sketches" in made.estimate("area_fraction").errors["surfaces"].how


def test_a_state_without_its_control_is_a_plain_mean():
    pair = Pair(1, 0.9)
    route = Route("", (pair.first,), nothing, pair.control)
    state = State(route, [], np.array([True]))
    assert not state.controlled
