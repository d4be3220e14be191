"""What `check` foresees of an ensemble: surfaces, corrections, time, memory, and what it cannot know."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy import special

import chemage as ca
from chemage.studies.ensembles import computations, planning, stages
from chemage.studies.ensembles.goals import with_request
from chemage.studies.ensembles.planning import plan

DATA = {
    "name": "small",
    "surface": {"kind": "self-affine", "pixels": 512, "pixel_size": 0.4518, "rms_slope": 0.1, "hurst": 0.8, "zeta": 32,
                "eta": 3, "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 2000.0},
    "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 4, "seed": 5, "temperature": 300.0},
}  # fmt: skip
TIP = {
    **DATA,
    "surface": {"kind": "sphere", "radius": 30.0, "pixels": 64, "pixel_size": 0.45},
    "contact": {"kind": "hertz", "modulus": 35.3, "load": 50.0},
}


@pytest.fixture(scope="module")
def scene() -> ca.Scene:
    return ca.parse_scene(DATA)


def planned(scene: ca.Scene, **request):
    return plan(with_request(scene.completed(), **request))


def test_the_number_of_surfaces_follows_from_the_samples(scene):
    found = planned(scene, accuracy={"beta": 0.03})
    low, high = found.foreseen.range
    assert low <= found.expected <= high
    assert found.foreseen.intervals["beta"] <= 0.03
    assert re.fullmatch(r"from a pilot of \d+ surfaces", found.reason)
    assert low <= ca.ensemble(with_request(scene, accuracy={"beta": 0.03})).surfaces <= 1.5 * high


@pytest.mark.parametrize(("count", "freedom"), [(3, 2), (12, 11)])
def test_what_a_pilot_allows_is_as_wide_as_student_and_chi_square(count, freedom):
    """A next sample is in Student's prediction interval, and variances are those of scaled inverse χ²."""
    rows = np.random.default_rng(1).standard_normal((count, 2)) + 5
    nexts, ratios = [], []
    for seed in range(4000):
        drawn = planning._Drawn(rows, np.random.default_rng(seed), own=False).upto(400)
        nexts.append(drawn[0, 1])
        ratios.append(drawn[:, 1].var(ddof=1) / rows[:, 1].var(ddof=1))
    limit = special.stdtrit(freedom - 1, 0.9) * math.sqrt(freedom / (freedom - 1) * (1 + 1 / count))
    spread = rows[:, 1].std(ddof=1)
    assert np.mean(np.abs(nexts - rows[:, 1].mean()) < limit * spread) == pytest.approx(0.8, abs=0.03)
    # the second of two columns has one degree of freedom less than n − 1
    shares = special.chdtri(freedom - 1, [0.1, 0.5, 0.9])
    assert np.quantile(ratios, [0.1, 0.5, 0.9]) == pytest.approx(freedom / shares, rel=0.25)


@pytest.mark.long
def test_corrections_are_foreseen_where_the_coarse_grid_is_not_good_enough(scene):
    found = planned(scene, accuracy={"beta": 0.008})
    assert len(found.computations) > 1
    first, second = found.todict()["ensemble"]["levels"]
    assert second["samples"] >= stages.FIRST_DIFFERENCES
    assert "minus" in second["words"]
    assert first["samples"] > second["samples"]
    assert len(planned(scene, accuracy={"beta": 0.2}).todict()["ensemble"]["levels"]) == 1


@pytest.mark.long
def test_a_budget_says_how_many_surfaces_and_which_interval_to_expect(scene):
    short, long = (planned(scene, budget=seconds) for seconds in (20.0, 80.0))
    assert short.foreseen.wall_seconds <= 20.0 * 1.1
    assert long.expected > 2 * short.expected
    assert long.foreseen.intervals["beta"] < 0.7 * short.foreseen.intervals["beta"]
    both = planned(scene, budget=5.0, accuracy={"beta": 0.001})
    assert any("the time will be over before" in note for note in both.notes)


@pytest.mark.long
def test_a_number_of_surfaces_has_its_interval_too(scene):
    found = planned(scene, surfaces=30)
    assert found.expected == 30
    assert found.foreseen.intervals["beta"] == pytest.approx(
        ca.ensemble(scene, surfaces=30).estimate("beta").relative, rel=0.5
    )


def test_a_mean_that_is_too_dear_for_a_pilot_has_one_on_a_sketch_or_none(scene, monkeypatch):
    near = planned(scene, accuracy={"beta": 0.05})
    monkeypatch.setattr("chemage.scene.plan.slowness", lambda: 300.0)
    sketch = planned(scene, accuracy={"beta": 0.05})
    assert re.search("from a pilot of .* surfaces, on [0-9]+ x [0-9]+ pixels", sketch.reason) or sketch.foreseen is None
    low, _ = near.foreseen.range
    assert sketch.foreseen is None or sketch.foreseen.range[1] > low
    monkeypatch.setattr("chemage.scene.plan.slowness", lambda: 1e6)
    none = planned(scene, accuracy={"beta": 0.05})
    assert none.expected is None
    assert none.cpu_seconds is None
    assert "a pilot of 3 would take about" in none.reason
    # the time alone says how many surfaces there will be
    timed = planned(scene, budget=20.0)
    assert timed.expected >= stages.FIRST
    assert timed.foreseen.intervals == {}


@pytest.mark.long
def test_any_quantity_is_foreseen(scene):
    for name in ("area_fraction", "patches", "friction_coefficient_drop@1e3 s"):
        found = planned(scene, accuracy={name: 0.05})
        assert set(found.foreseen.intervals) == {name}
        assert found.cpu_seconds > 0


@pytest.mark.long
def test_that_beta_cannot_be_told_from_zero_is_said(scene):
    """In balance long before the window: the bonds fluctuate about their mean."""
    changes = {
        "breaking": {"kind": "uniform", "lower": 0.5, "upper": 0.6},
        "forming": {"kind": "uniform", "lower": 0.5, "upper": 0.6},
    }
    held = {"hold": {**DATA["hold"], "seed": 6}}
    found = planned(ca.parse_scene({**DATA, **changes, **held}), accuracy={"beta": 0.05})
    assert any("beta cannot be told from zero" in note for note in found.notes)


@pytest.mark.long
def test_too_many_surfaces_and_too_few_bonds_are_said_before(scene):
    *_, note = planned(scene, accuracy={"beta": 0.001}, most=100).notes
    assert "surfaces (" in note
    assert "100 are allowed; ask for a wider interval, or allow more with [ensemble] most" in note
    early = ca.parse_scene({**DATA, "hold": {**DATA["hold"], "start": 1e-13}})
    notes = planned(early, accuracy={"friction_drop@1e-13 s": 0.05}).notes
    assert "are equal, 0" in notes[-2]
    assert "its mean is expected to be 0 within its interval" in notes[-1]


def test_memory_is_that_of_the_surfaces_at_the_same_time(scene, monkeypatch):
    monkeypatch.setattr("chemage.studies.ensembles.planning.available", lambda: 8)
    found = planned(scene, surfaces=30)
    one = found.computations[0]
    assert found.memory == pytest.approx(computations.PROGRAM + 8 * one.bytes)
    # where memory is short fewer are computed at the same time
    monkeypatch.setenv("CHEMAGE_MEMORY", f"{(computations.PROGRAM + 2.5 * one.bytes) / 1e6:.0f} MB")
    assert computations.fitting(one, 8) == 2
    assert found.memory == pytest.approx(computations.PROGRAM + 2 * one.bytes)


@pytest.mark.long
def test_what_is_left_out_is_said_with_the_reason(scene):
    observed = ca.parse_scene({**DATA, "observe": [{"kind": "pressure-spectrum"}]})
    found = planned(observed, accuracy={"beta": 0.05}).not_computed()
    text = "\n".join(found)
    assert "the contact grid of the scene on every surface" in text
    assert "4 replicas on each surface" in text
    assert re.search(r"arrays that are recorded \(.*pressures.*\): an ensemble averages declared", text)
    assert "maps of heights and pressure are not kept" in text
    assert not any("replicas on each" in one for one in planned(scene, surfaces=30).not_computed())


@pytest.mark.parametrize(
    "temperature", [pytest.param(900.0, marks=pytest.mark.campaign), pytest.param(150.0, marks=pytest.mark.long)]
)
def test_where_hardly_a_bond_forms_in_the_window_it_is_said_why(temperature):
    """All have formed before the window at 900 K, and none forms before its end at 150 K: β is 0."""
    one = ca.parse_scene({**DATA, "hold": {**DATA["hold"], "temperature": temperature}})
    found = planned(one, accuracy={"beta": 0.05})
    assert found.foreseen.reason == "zero"
    assert any("samples of the pilot are equal, 0" in note for note in found.notes)
    assert "ask at other hold times, or another temperature" in found.notes[-1]
    timed = planned(one, budget=20.0)
    assert timed.expected > stages.FIRST
    assert planned(one, surfaces=30).foreseen.intervals == {}


@pytest.mark.long
def test_the_speed_of_the_machine_changes_nothing_that_is_computed(scene, monkeypatch):
    asked = with_request(scene, accuracy={"beta": 0.1})
    before, mean = plan(asked), ca.ensemble(asked)
    each = [one.seconds_here for one in before.computations]
    monkeypatch.setattr("chemage.scene.plan.slowness", lambda: 3.0)
    slow = plan(asked)
    assert [one.seconds_here for one in slow.computations] == pytest.approx([3 * one for one in each])
    assert ca.ensemble(asked) == mean
