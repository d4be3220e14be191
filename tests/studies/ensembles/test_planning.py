"""What `check` foresees of an ensemble: surfaces, corrections, time, memory, and what it cannot know."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import chemage as ca
from chemage.scene.plan import cost
from chemage.studies.ensembles import computations, stages
from chemage.studies.ensembles.goals import Request, Scatters, with_request
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


def test_the_number_of_surfaces_follows_from_the_scatter(scene):
    few, many = (planned(scene, accuracy={"beta": accuracy}) for accuracy in (0.05, 0.02))
    scatter = few.scatters.sample(1)[0]
    assert many.expected is not None
    # Student's factor and the rule take some more than the normal distribution does
    assert 1 < many.expected / (1.96 * scatter / 0.02) ** 2 < 2
    assert few.expected < many.expected
    low, high = many.foreseen.range
    assert low <= many.expected <= high
    assert many.foreseen.intervals["beta"] <= 0.02
    assert many.cpu_seconds >= many.expected * many.seconds[0]


def test_the_plan_is_the_same_each_time(scene):
    assert planned(scene, accuracy={"beta": 0.05}).foreseen == planned(scene, accuracy={"beta": 0.05}).foreseen


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


def test_a_number_of_surfaces_has_its_interval_too(scene):
    found = planned(scene, surfaces=30)
    assert found.expected == 30
    expected = 2.045 * found.scatters.sample(4)[0] / math.sqrt(30)
    assert found.foreseen.intervals["beta"] == pytest.approx(expected, rel=1e-3)


def test_the_friction_drop_scatters_as_beta_does(scene):
    found = planned(scene, accuracy={"friction_coefficient_drop@1e3 s": 0.05})
    assert found.expected is not None
    assert "friction_coefficient_drop@1e3 s" in found.reason


def test_what_is_not_known_is_said(scene):
    for name in ("area_fraction", "patches"):
        found = planned(scene, accuracy={name: 0.05})
        assert found.expected is None
        assert found.cpu_seconds is None
        assert "is not known before" in found.reason
    # a surface of a given rms height: its scatter was not measured
    surface = {name: value for name, value in DATA["surface"].items() if name != "rms_slope"}
    other = ca.parse_scene({**DATA, "surface": {**surface, "rms_height": 1.0}})
    assert planned(other, accuracy={"beta": 0.05}).expected is None
    # the time alone says how many surfaces there will be
    timed = planned(other, budget=20.0)
    assert timed.expected > stages.FIRST
    assert timed.foreseen.intervals == {}


@pytest.mark.long
def test_replicas_on_a_tip_scatter_as_sites_that_react_independently():
    tip = ca.parse_scene(TIP)
    found = planned(tip, accuracy={"beta": 0.02})
    assert found.request.counted == "replicas"
    asked = with_request(tip.completed(), accuracy={"friction_drop": 0.02})
    request = Request.of(asked)
    expected = Scatters.of(request, cost(tip), {}).replicas[request.goals[0].column]
    drops = np.asarray(ca.run(ca.parse_scene({**TIP, "hold": {**TIP["hold"], "replicas": 200}})).aging.friction_drop)
    measured = drops[:, -1].std(ddof=1) / drops[:, -1].mean()
    assert expected == pytest.approx(measured, rel=0.3)


def test_too_many_surfaces_and_too_few_bonds_are_said_before(scene):
    *_, note = planned(scene, accuracy={"beta": 0.001}, most=100).notes
    assert "surfaces (" in note
    assert "100 are allowed; ask for a wider interval, or allow more with [ensemble] most" in note
    early = ca.parse_scene({**DATA, "hold": {**DATA["hold"], "start": 1e-9}})
    *_, note = planned(early, accuracy={"friction_drop@1e-7 s": 0.05}).notes
    assert "its mean is expected to be 0 within its interval" in note
    with pytest.raises(ca.InputError, match="no bond is expected to form in time on 10,000 surfaces"):
        planned(early, accuracy={"friction_drop@1e-9 s": 0.05})


def test_memory_is_that_of_the_surfaces_at_the_same_time(scene, monkeypatch):
    monkeypatch.setattr("chemage.studies.ensembles.planning.available", lambda: 8)
    found = planned(scene, surfaces=30)
    one = found.computations[0]
    assert found.memory == pytest.approx(computations.PROGRAM + 8 * one.bytes)
    # where memory is short fewer are computed at the same time
    monkeypatch.setenv("CHEMAGE_MEMORY", f"{(computations.PROGRAM + 2.5 * one.bytes) / 1e6:.0f} MB")
    assert computations.fitting(one, 8) == 2
    assert found.memory == pytest.approx(computations.PROGRAM + 2 * one.bytes)


def test_what_is_left_out_is_said_with_the_reason(scene):
    observed = ca.parse_scene({**DATA, "observe": [{"kind": "pressure-spectrum"}]})
    found = planned(observed, accuracy={"beta": 0.05}).not_computed()
    text = "\n".join(found)
    assert "the contact grid of the scene on every surface" in text
    assert "4 replicas on each surface" in text
    assert re.search(r"arrays that are recorded \(.*pressures.*\): an ensemble averages declared", text)
    assert "maps of heights and pressure are not kept" in text
    assert not any("replicas on each" in one for one in planned(scene, surfaces=30).not_computed())


@pytest.mark.parametrize("temperature", [900.0, 150.0])
def test_where_hardly_a_bond_forms_in_the_window_no_scatter_is_foreseen_but_said_why(temperature):
    """All have formed before the window at 900 K, and none forms before its end at 150 K: β is 0."""
    one = ca.parse_scene({**DATA, "hold": {**DATA["hold"], "temperature": temperature}})
    found = planned(one, accuracy={"beta": 0.05})
    assert found.foreseen.reason == "zero"
    assert found.reason == "since hardly a bond is expected to form between 10 and 10000 s, so that beta is about 0"
    assert "ask at other hold times, or another temperature" in found.notes[-1]
    timed = planned(one, budget=20.0)
    assert timed.expected > stages.FIRST
    assert timed.foreseen.intervals == {}
    assert timed.reason == f"as many as the time allows, {found.reason}"
    assert planned(one, surfaces=30).foreseen.intervals == {}
    assert "%" not in str(dict(found.rows())["number of surfaces"])


def test_the_speed_of_the_machine_changes_what_is_foreseen_and_nothing_that_is_computed(scene, monkeypatch):
    asked = with_request(scene, accuracy={"beta": 0.1})
    before, mean = plan(asked), ca.ensemble(asked)
    each = [one.seconds_here for one in before.computations]
    monkeypatch.setattr("chemage.scene.plan.slowness", lambda: 3.0)
    slow = plan(asked)
    assert slow.cpu_seconds == pytest.approx(3 * before.cpu_seconds)
    assert [one.seconds_here for one in slow.computations] == pytest.approx([3 * one for one in each])
    assert slow.foreseen.samples == before.foreseen.samples
    assert ca.ensemble(asked) == mean
