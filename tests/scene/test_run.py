"""A run carries a scene from surface to ageing, and says what came of it in plain JSON."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import chemage
from chemage import InputError, Run, load_scene


@pytest.fixture
def scene(small):
    return load_scene(small)


def test_a_run_is_its_stages_one_after_the_other(scene):
    result = chemage.run(scene)
    surface = scene.surface.make(scene.surface_seed)
    contact = scene.contact.solve(surface, scene.load)
    ageing = chemage.age(
        contact,
        scene.chemistry,
        engine=scene.engine,
        hold_times=scene.hold.hold_times,
        temperature=300,
        replicas=3,
        seed=5,
        observe=scene.observe,
    )
    assert result.surface == surface
    assert np.array_equal(result.contact.pressure, contact.pressure)
    assert np.array_equal(result.ageing.bonds, ageing.bonds)
    assert result.scene == scene.todict()
    assert result.keys == scene.keys()
    assert list(result.timings) == ["surface", "contact", "ageing"]
    assert all(seconds >= 0 for seconds in result.timings.values())


def test_the_summary_is_what_its_parts_say(scene):
    result = chemage.run(scene)
    told = result.summary()
    json.dumps(told, allow_nan=False)
    fit = result.ageing.fit(10, 1e4)
    assert (told["beta"], told["beta_stderr"], told["cutoff_time"]) == (fit.beta, fit.beta_stderr, fit.cutoff_time)
    drop = 3.0 * result.ageing.bonds
    assert told["friction_drop"] == pytest.approx(drop.mean(axis=0))
    assert told["friction_coefficient_drop"] == pytest.approx(drop.mean(axis=0) / 40.0)
    assert told["friction_drop_stderr"] == pytest.approx(drop.std(axis=0, ddof=1) / math.sqrt(3))
    assert told["area_fraction"] == result.contact.quantity("area_fraction").value
    assert told["grid_area"] == pytest.approx(np.count_nonzero(result.contact.pressure) * 0.4518**2)
    assert told["mean_contact_pressure"] == pytest.approx(40.0 / (told["area_fraction"] * (48 * 0.4518) ** 2))
    assert told["events"] == result.ageing.events.sum()
    assert told["replicas"] == 3


def test_the_fit_window_is_that_of_the_scene(small):
    result = chemage.run(load_scene(small, {"fit.start": "1 s", "fit.stop": "1e5 s"}))
    assert result.fit() == result.ageing.fit(1.0, 1e5)
    assert result.fit().points == 11


def test_finished_stages_are_not_computed_again(scene, monkeypatch):
    first = chemage.run(scene)
    monkeypatch.setattr(type(scene.surface), "make", lambda *_: pytest.fail("made the surface again"))
    again = chemage.run(scene, surface=first.surface)
    assert again.ageing == first.ageing
    monkeypatch.setattr(type(scene.contact), "_solve", lambda *_: pytest.fail("solved the contact again"))
    again = chemage.run(scene, contact=first.contact)
    assert again.ageing == first.ageing
    assert list(again.timings) == ["ageing"]


def test_progress_tells_of_every_stage_and_replica(scene):
    told = []
    chemage.run(scene, progress=lambda *call: told.append(call), threads=1)
    assert [call for call in told if call[0] == "surface"] == [("surface", 0, 0), ("surface", 1, 1)]
    ageing = [call[1:] for call in told if call[0] == "ageing"]
    assert ageing[:4] == [(0, 0), (1, 3), (2, 3), (3, 3)]
    assert [stage for stage, done, total in told if (done, total) == (0, 0)] == ["surface", "contact", "ageing"]


def test_an_error_says_in_which_stage(small):
    scene = load_scene(small, {"contact": {"kind": "hertz", "modulus": 35.0, "load": 1.0}})
    with pytest.raises(InputError, match="needs a sphere") as caught:
        chemage.run(scene)
    assert caught.value.__notes__ == ["in the stage 'contact' of scene 'small'"]


def test_parts_and_attributes_make_the_run_again(scene):
    result = chemage.run(scene)
    again = Run.from_parts(result.parts(), result.attributes())
    assert again == result
