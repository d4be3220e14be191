"""The rule that ends sampling: how many samples an accuracy needs, when it stops, and what a control saves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drawn_levels import Drawn, Timer, nothing
from scipy import stats
from seen import result_of

import chemage as ca
from chemage import Ensemble, ensemble
from chemage.studies.ensembles import computations
from chemage.studies.ensembles.quantities import Spread, allocated, half_width, regressed
from chemage.studies.ensembles.stages import CONTROLLED, FIRST, Clock, Route, SamplingState, Unreachable, run_stages

# -- how many samples an accuracy needs: against closed forms and against a search of all numbers ---------------------


def one(variance: float, freedom: int) -> Spread:
    return Spread(np.array([variance]), freedom)


def test_the_interval_of_one_level_is_students():
    values = np.random.default_rng(1).normal(3.0, 0.2, 12)
    low, high = stats.t.interval(0.95, 11, values.mean(), stats.sem(values))
    found = half_width([one(values.var(ddof=1), 11)], [12], np.zeros(1))
    assert found[0] == pytest.approx((high - low) / 2, rel=1e-12)


def test_the_interval_of_two_levels_is_welchs():
    rng = np.random.default_rng(2)
    a, b = rng.normal(0, 1.0, 9), rng.normal(0, 3.0, 5)
    interval = stats.ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    spreads = [one(a.var(ddof=1), 8), one(b.var(ddof=1), 4)]
    found = half_width(spreads, [9, 5], np.zeros(1))
    assert found[0] == pytest.approx((interval.high - interval.low) / 2, rel=1e-9)


def test_what_is_known_before_is_normal_and_adds_in_squares():
    found = half_width([one(0.0, 5)], [6], np.array([0.3]))
    assert found[0] == pytest.approx(0.3 * stats.norm.ppf(0.975), rel=1e-6)
    assert np.isnan(half_width([one(1.0, 5)], [6], np.array([np.nan]))[0])


@pytest.mark.parametrize(("deviation", "wanted"), [(0.05, 0.02), (0.05, 0.003), (0.2, 0.01)])
def test_one_level_needs_the_number_of_the_textbook(deviation, wanted):
    counts = allocated([one(deviation**2, 10**6)], [1.0], [8], np.zeros(1), np.array([wanted]))
    assert counts is not None
    needed = (stats.norm.ppf(0.975) * deviation / wanted) ** 2
    assert needed <= counts[0] <= 1.12 * needed + 1


def test_two_levels_cost_hardly_more_than_the_cheapest_of_all_numbers():
    spreads, costs, wanted = [one(0.053**2, 40), one(0.006**2, 6)], [0.25, 3.0], 0.01
    counts = allocated(spreads, costs, [10, 5], np.zeros(1), np.array([wanted]))
    assert counts is not None
    assert half_width(spreads, counts, np.zeros(1))[0] <= wanted
    cheapest = math.inf
    for fine in range(5, 40):
        for many in range(10, 600):
            if half_width(spreads, [many, fine], np.zeros(1))[0] <= wanted:
                cheapest = min(cheapest, many * costs[0] + fine * costs[1])
                break
    assert many * costs[0] > 0
    assert sum(n * c for n, c in zip(counts, costs, strict=True)) <= 1.1 * cheapest


def test_a_level_that_is_known_well_enough_is_left_as_it_is():
    counts = allocated([one(1e-2, 50), one(1e-12, 5)], [1.0, 100.0], [10, 5], np.zeros(1), np.array([0.02]))
    assert counts is not None
    assert counts[1] == 5
    assert counts[0] > 50


def test_no_number_is_enough_against_an_error_that_stays():
    assert allocated([one(1e-4, 50)], [1.0], [10], np.array([0.01]), np.array([0.015])) is None


def test_every_quantity_is_accurate_enough():
    spread = Spread(np.array([1e-3, 1e-5, 4e-3]), 30)
    wanted = np.array([0.02, np.inf, 0.02])
    counts = allocated([spread], [1.0], [10], np.zeros(3), wanted)
    assert counts is not None
    assert np.all(half_width([spread], counts, np.zeros(3)) <= wanted)


# -- the rule that stops: its intervals hold the truth as often as they say, and are never wider than asked -----------


def trial(seed: int, deviation: float, difference: float | None, skewed: float, wanted: float) -> tuple[bool, int]:
    """Whether the interval of one sampling held the truth, and how many samples the first level had."""
    rng = np.random.default_rng(seed)
    if difference is None:
        levels = (Drawn(rng, 1.0, deviation, 0.25, skewed),)
    else:
        levels = (Drawn(rng, 1.004, deviation, 0.25, skewed), Drawn(rng, -0.004, difference, 3.0))
    state = run_stages([Route("", levels, nothing)], np.array([wanted]), most=10**6)
    half = float(state.half_width()[0])
    assert half <= wanted * abs(state.mean[0]) * (1 + 1e-12)
    return bool(abs(state.mean[0] - 1.0) <= half), state.sampled[0].count


@pytest.mark.long
@pytest.mark.parametrize("wanted", [0.05, pytest.param(0.02, marks=pytest.mark.campaign), 0.01])
@pytest.mark.parametrize(
    ("deviation", "difference", "skewed"),
    [(0.02, None, 0.2), (0.053, None, 0.0), (0.053, 0.006, 0.2), (0.1, 0.006, 0.2)],
)
def test_the_interval_holds_the_truth_as_often_as_it_says(deviation, difference, skewed, wanted):
    """Of 400 intervals 93 to 98 % hold the truth, give or take three standard errors of such a count."""
    held = np.mean([trial(seed, deviation, difference, skewed, wanted)[0] for seed in range(400)])
    slack = 3 * np.sqrt(0.95 * 0.05 / 400)
    assert 0.93 - slack <= held <= 0.98 + slack


def test_the_interval_is_never_wider_than_asked_and_takes_hardly_more_samples_than_it_must():
    counts = [trial(seed, 0.053, None, 0.0, 0.02)[1] for seed in range(40)]
    must = (1.96 * 0.053 / 0.02) ** 2
    assert np.mean(counts) < 1.5 * must


def test_a_goal_that_the_first_stage_reaches_ends_there():
    assert trial(3, 0.01, None, 0.0, 0.05)[1] == FIRST


def route(deviation: float, known: float = 0.0, mean: float = 1.0) -> Route:
    return Route("", (Drawn(np.random.default_rng(5), mean, deviation, 1.0),), lambda mean: np.array([known]))


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (route(0.05, known=0.02), "known"),
        (route(0.5), "most"),
        (route(0.05, mean=0.0), "zero"),
        (route(0.05, known=float("nan")), "unknown"),
    ],
)
def test_what_cannot_be_reached_says_why(made, reason):
    with pytest.raises(Unreachable) as caught:
        run_stages([made], np.array([0.01]), most=1000)
    assert caught.value.reason == reason


def test_the_cheaper_of_two_routes_is_taken():
    rng = np.random.default_rng(8)

    def both(known: float, wanted: float) -> str:
        first = Drawn(rng, 1.0, 0.05, 0.25)
        biased = Route("biased", (first,), lambda mean: np.array([known]))
        corrected = Route("corrected", (first, Drawn(rng, 0.0, 0.005, 3.0)), nothing)
        return run_stages([biased, corrected], np.array([wanted]), most=10**6).route.name

    assert both(0.008, 0.05) == "biased"  # what is known before is enough
    assert both(0.008, 0.01) == "corrected"
    assert both(float("nan"), 0.05) == "corrected"


def test_corrections_that_cannot_pay_take_no_samples():
    """Without its known error the first level would need nearly as many samples, and the corrections cost more."""
    rng = np.random.default_rng(8)
    first, difference = Drawn(rng, 1.0, 0.05, 0.25), Drawn(rng, 0.0, 0.001, 1.5)
    small = Route("not corrected", (first,), lambda mean: np.array([0.002]))
    state = run_stages([small, Route("corrected", (first, difference), nothing)], np.array([0.02]), most=10**6)
    assert state.route.name == "not corrected"
    assert state.cost([60], state.costs) + state.counts[0] * 0.25 > 5 * 1.5  # more than the first corrections alone
    assert difference.taken == 0


class Timed(Drawn):
    """A level whose samples take their cost."""

    def __init__(self, timer: Timer, *arguments):
        super().__init__(*arguments)
        self.timer = timer

    def sample(self, begin: int, end: int) -> np.ndarray:
        self.timer.time += (end - begin) * self.cost
        return super().sample(begin, end)


@pytest.mark.parametrize("seconds", [20.0, 60.0, 240.0])
@pytest.mark.parametrize("corrected", [False, True])
def test_a_budget_is_kept_and_used(seconds, corrected):
    timer, rng = Timer(), np.random.default_rng(4)
    levels = (Timed(timer, rng, 1.0, 0.05, 0.25), *([Timed(timer, rng, 0.0, 0.005, 1.0)] if corrected else []))
    state = run_stages([Route("", levels, nothing)], np.array([0.0]), most=10**6, clock=Clock(seconds, timer))
    assert 0.85 * seconds < timer.time <= 1.1 * seconds
    assert not state.reached(np.array([0.0]))
    assert state.half_width()[0] < 0.05


def test_twice_the_time_makes_the_interval_narrower_by_the_root_of_two():
    found = []
    for seconds in (40.0, 80.0):
        halves = []
        for seed in range(60):
            timer, rng = Timer(), np.random.default_rng(seed)
            levels = (Timed(timer, rng, 1.0, 0.05, 0.25), Timed(timer, rng, 0.0, 0.005, 1.0))
            made = run_stages([Route("", levels, nothing)], np.array([0.0]), most=10**6, clock=Clock(seconds, timer))
            halves.append(made.half_width()[0])
        found.append(np.mean(halves))
    assert found[0] / found[1] == pytest.approx(2**0.5, rel=0.1)


def test_an_accuracy_that_comes_before_the_end_of_the_time_ends_sampling():
    timer, rng = Timer(), np.random.default_rng(4)
    made = Route("", (Timed(timer, rng, 1.0, 0.05, 0.25),), nothing)
    state = run_stages([made], np.array([0.03]), most=10**6, clock=Clock(1000.0, timer))
    assert state.reached(np.array([0.03]))
    assert timer.time < 20


@pytest.mark.parametrize("deviation", [0.0, 0.1])
def test_a_budget_alone_always_answers_also_where_the_mean_is_zero(deviation):
    """As of a scene so cold that no bond, or hardly one, forms; no error hides that, and the time is used."""
    timer = Timer()
    level = Timed(timer, np.random.default_rng(4), 0.0, deviation, 0.25)
    state = run_stages([Route("", (level,), nothing)], np.array([0.0]), most=10**6, clock=Clock(20.0, timer))
    assert 17 < timer.time <= 22
    assert abs(state.mean[0]) < 0.05
    unknown = Route("", (Timed(timer, np.random.default_rng(4), 1.0, 0.1, 0.25),), lambda mean: np.array([np.nan]))
    assert np.isnan(run_stages([unknown], np.array([0.0]), most=10**6, clock=Clock(5.0, timer)).half_width()[0])


def test_a_quantity_that_was_not_asked_for_and_has_no_interval_does_not_decide_how_a_time_is_divided():
    """The second quantity scatters only where it is corrected, and its error is not known."""
    timer, rng = Timer(), np.random.default_rng(4)

    class Both(Timed):
        def sample(self, begin: int, end: int) -> np.ndarray:
            own = super().sample(begin, end)
            return np.hstack([own, 100 * own if self.mean == 0.0 else np.ones_like(own)])

    levels = (Both(timer, rng, 1.0, 0.05, 0.25), Both(timer, rng, 0.0, 0.001, 1.0))
    route = Route("", levels, lambda mean: np.array([0.0, np.nan]))
    state = run_stages([route], np.array([0.0, np.inf]), most=10**6, clock=Clock(60.0, timer))
    assert state.counts[0] > 10 * state.counts[1]


# -- the control of an ensemble: a cheap number of each surface, on which the first level is regressed ----------------


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
        spreads = [Spread.of(terms[0], 20, 19, True), Spread.of(terms[1], 200, 199)]
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
    [
        pytest.param(0.975, 0.01, None, marks=pytest.mark.campaign),
        (0.975, 0.01, 0.006),
        (0.9, 0.01, None),
        pytest.param(0.95, 0.02, 0.006, marks=pytest.mark.campaign),
    ],
)
def test_with_a_control_too_the_interval_holds_the_truth_as_often_as_it_says(correlation, wanted, difference):
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
        cost = computations.SurfaceLevel.cost.fget
        cheap = property(lambda level: cost(level) if level.parts[0].computation.scene.ages else 0.001)
        patch.setattr(computations.SurfaceLevel, "cost", cheap)
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
    assert sketches[4, 0] == pytest.approx(solved.quantity("area_fraction").value, rel=1e-9)
    assert np.corrcoef(first[:, 0], sketches[: len(first), 0])[0, 1] > 0.8
    assert made.estimate("beta").relative <= 0.03


def test_its_numbers_are_those_of_the_rule_and_come_back_from_a_file(scene, made, tmp_path):
    terms = regressed([made.rows[str(number)] for number in range(len(made.levels))])
    spreads = [
        Spread.of(term, level["variance_of"], level["freedom"], not number)
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
    state = SamplingState(route, [], np.array([True]))
    assert not state.controlled
