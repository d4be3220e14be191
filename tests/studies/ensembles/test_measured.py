"""The dial learns from a map: measured costs, measured errors, and no map of something else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import chemage as ca
from chemage import InputError, ensemble
from chemage.plugin import TradeMap, TradePoint, versions
from chemage.studies.ensembles.goals import Request
from chemage.studies.ensembles.running import Sampler

ROUGH = {
    "name": "small",
    "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8,
                "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 100.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "chemistry": {"activation_volume": "6.4 angstrom**3"},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 3, "seed": 5},
}  # fmt: skip
LOOSE = {"contact.tolerance": 0.01}


@pytest.fixture(scope="module")
def scene() -> ca.Scene:
    return ca.parse_scene(ROUGH)


def made(scene: ca.Scene, *points: TradePoint) -> TradeMap:
    """A map with these points and that of the scene itself, which takes 1 s for a contact and 30 ms for 3 replicas."""
    own = measured(1.0, 0.0, choices={}, changes={}, own=True)
    more: dict[str, Any] = {"observables": ["beta"], "surface_scatter": {"beta": 0.1}, "points": [own, *points]}
    return TradeMap.measured(scene, rounds=4, random=True, **more)


def measured(seconds: float, error: float, stderr: float = 0.0, **more: Any) -> TradePoint:
    names = ["beta", *(f"friction_drop@{time:g} s" for time in 10.0 ** np.arange(-2, 5)), "corrected_area"]
    fields: dict[str, Any] = {
        "choices": {"contact.tolerance": "0.01"},
        "changes": LOOSE,
        "contact_seconds": [seconds] * 4,
        "ageing_seconds": [0.03] * 4,
        "differences": dict.fromkeys(names, (error, stderr, 3)),
        "values": {},
        "scatter": dict.fromkeys(names, 0.1),
    }
    return TradePoint(**{**fields, **more})


def asked(scene: ca.Scene, accuracy: float, found: TradeMap) -> list[Any]:
    return Request.of(scene.model_copy(update={"accuracy": {"beta": accuracy}}), found).computations()


def test_measured_costs_take_the_place_of_estimates(scene):
    (own,) = asked(scene, 0.05, made(scene))
    assert own.contact_seconds == 1.0
    assert own.replica_seconds == pytest.approx(0.01)
    assert own.seconds == pytest.approx(1.01)


def test_cheaper_settings_without_an_error_are_chosen(scene):
    loose, own = asked(scene, 0.05, made(scene, measured(0.4, 0.0005)))
    assert loose.scene.contact.tolerance == 0.01
    assert loose.seconds == pytest.approx(0.41)
    assert own.scene.contact.tolerance == scene.contact.tolerance
    assert loose.errors[0] == pytest.approx(0.0005)
    assert "contact.tolerance 0.01" in loose.words
    assert loose.scene.keys() != own.scene.keys()


def test_settings_that_hardly_pay_are_not(scene):
    assert len(asked(scene, 0.05, made(scene, measured(0.95, 0.0)))) == 1


def test_a_bias_of_the_size_of_the_goal_is_corrected_or_refused(scene):
    # a correction that scatters as much as β itself costs more than it saves
    assert len(asked(scene, 0.05, made(scene, measured(0.4, 0.1, 0.05)))) == 1
    # one that hardly scatters pays
    assert len(asked(scene, 0.05, made(scene, measured(0.05, 0.1, 0.001)))) == 2
    names = [route.name for route in Sampler(
        scene.model_copy(update={"accuracy": {"beta": 0.05}}), measured=made(scene, measured(0.05, 0.1, 0.001))
    ).possible_routes()]  # fmt: skip
    assert names == ["not corrected", "corrected"]


def test_the_mean_with_a_biased_setting_is_that_of_the_scene(scene):
    """The map says that the loose tolerance is wrong by 30 %, so that it has to be corrected."""
    found = made(scene, measured(1e-3, 0.3, 1e-4))
    mean = ensemble(scene, accuracy={"beta": 0.2}, measured=found, threads=1)
    assert len(mean.levels) == 2
    assert "contact.tolerance 0.01" in mean.levels[0]["words"]
    exact = ensemble(scene, surfaces=60, threads=1).estimate("beta")
    beta = mean.estimate("beta")
    assert beta.relative <= 0.2
    assert abs(beta.value - exact.value) < 3 * (beta.half_width + exact.half_width) / 1.96


def test_a_measured_error_is_in_the_interval_and_named(scene):
    found = made(scene, measured(1e-3, 0.01))
    mean = ensemble(scene, accuracy={"beta": 0.2}, measured=found, threads=1)
    beta = mean.estimate("beta")
    assert len(mean.levels) == 1
    assert beta.errors["settings"].size == pytest.approx(0.01 * beta.value)
    assert beta.errors["settings"].how == "measured for the map: contact.tolerance 0.01"
    assert any("as measured for the map" in note for note in mean.notes)
    # what the map does not have is not known
    assert np.isnan(mean.estimate("patches").half_width)
    assert np.isfinite(mean.estimate("corrected_area").half_width)


def test_an_exact_engine_needs_no_correction(scene):
    faster = measured(0.1, 0.5, 0.5, exact=True)
    found = made(scene, faster)
    sampler = Sampler(scene.model_copy(update={"accuracy": {"beta": 0.05}}), measured=found)
    (route,) = sampler.possible_routes()
    assert route.levels[0].cost == pytest.approx(0.11)


def test_a_budget_is_divided_by_measured_costs(scene):
    asking = scene.model_copy(update={"ensemble": ca.parse_scene({**ROUGH, "ensemble": {"budget": "10 s"}}).ensemble})
    assert len(Request.of(asking, made(scene, measured(0.4, 0.0005))).computations()) == 2
    assert len(Request.of(asking, made(scene, measured(0.4, 0.3, 0.3))).computations()) == 1


def test_a_short_budget_leaves_an_error_that_would_take_longer_to_correct(scene):
    """In 1 s, relative standard errors: 0.14 of the scene, 0.06 with the error of the setting, 0.14 if corrected."""
    asking = scene.model_copy(update={"ensemble": ca.parse_scene({**ROUGH, "ensemble": {"budget": "1 s"}}).ensemble})
    assert len(Request.of(asking, made(scene, measured(0.05, 0.0, 0.05))).computations()) == 2
    assert len(Request.of(asking, made(scene, measured(0.05, 0.15, 0.05))).computations()) == 1


def test_the_map_is_named_in_the_scene_or_on_the_command_line(scene, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made(scene, measured(1e-3, 0.001)).write("map.json")
    text = toml({**scene.todict(), "accuracy": {"beta": 0.2}, "ensemble": {"map": "map.json"}})
    (tmp_path / "with.toml").write_text(text)
    monkeypatch.chdir("/")
    shown = command("check", tmp_path / "with.toml")
    assert shown.status == 0, shown.err
    assert "contact.tolerance 0.01" in shown.out.replace("\n", " ")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "without.toml").write_text(toml(scene.todict()))
    done = command("run", "without.toml", "--accuracy", "beta=20%", "--map", "map.json", "--no-figures")
    assert done.status == 0, done.err
    assert "measured for the map" in done.out
    refused = command("run", "without.toml", "--surfaces", 4, "--map", "map.json")
    assert refused.status == 2
    assert "--map: a number of surfaces is computed as the scene is written" in refused.err


def test_a_map_that_does_not_fit_is_refused_before_anything_is_computed(scene, tmp_path):
    other = made(ca.parse_scene({**ROUGH, "contact": {**ROUGH["contact"], "load": 200.0}}))
    other.write(tmp_path / "map.json")
    with pytest.raises(InputError, match=r"map\.json: was measured on another scene, which has changed since"):
        ensemble(scene, accuracy={"beta": 0.2}, measured=tmp_path / "map.json")
    old = replace(made(scene), versions={**versions(scene), "chemage": "0.0"})
    with pytest.raises(InputError, match=r"other versions: chemage 0\.0 instead of"):
        ensemble(scene, accuracy={"beta": 0.2}, measured=old)
    with pytest.raises(InputError, match="leave the map out"):
        ensemble(scene, surfaces=4, measured=made(scene))


def toml(data) -> str:
    import tomli_w

    return tomli_w.dumps(data)
