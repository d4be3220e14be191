"""The rule that stops: its intervals hold the truth as often as they say, and are never wider than asked."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_levels import Drawn, Timer, nothing

from chemage.studies.ensembles.stages import FIRST, Clock, Route, Unreachable, run_stages


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
@pytest.mark.parametrize("wanted", [0.05, 0.02, 0.01])
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
    assert state.cost([60]) + state.counts[0] * 0.25 > 5 * 1.5  # more than the first corrections alone
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
