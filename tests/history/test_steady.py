"""Whether the steady friction of a step is steady: said where it is not, seldom where it is, and a bound of few bonds."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import Quantity, steadiness
from chemage_validation.table import ROWS, validate


def tip(replicas=20, drive=(), **sections):
    """A small tip that slides."""
    data = ca.load_scene("silica-history").todict()
    del data["step"]
    data["surface"] |= {"pixels": 32, "pixel_size": 0.9036}
    data["forming"] = {"kind": "gaussian", "mean": 0.75, "std": 0.02}
    data["hold"] |= {"replicas": replicas}
    data["drive"] |= dict(drive)
    return {**data, **sections}


def toml(value) -> str:
    """A value of TOML; tables are inline."""
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name} = {toml(one)}' for name, one in value.items())}}}"
    return json.dumps(value)


def file_of(data, folder) -> str:
    path = folder / "tip.toml"
    path.write_text("\n".join(f"{name} = {toml(one)}" for name, one in data.items()))
    return str(path)


#: aged bonds break one after the other: the force rises, then falls, and is never steady
SHORT = [{"duration": 100}, {"speed": 100, "distance": 0.25}, {"speed": 100, "distance": 0.12}]


def test_a_step_that_is_too_short_is_called_so_before_and_its_friction_after(tmp_path, command):
    scene = file_of(tip(step=SHORT), tmp_path)
    assert "step 1: its steady friction is the mean over its last 0.125 nm of slip" in command("check", scene).out
    out = str(tmp_path / "run.h5")
    command("run", scene, "-o", out, "--no-figures")
    assert command("show", out, "--all").out.count("within the window") >= 2
    shown = json.loads(command("show", out, "--json").out)
    for step, word in ((1, "still rises by"), (2, "still falls by")):
        steady, change = (
            shown.get(f"observable.{name}") or shown["observables"][name]
            for name in (f"steady_{step}", f"steady_{step}_change")
        )
        assert steady["reason"].count(word)
        assert change["low"] * change["high"] > 0
    with pytest.raises(InputError, match=r"step 1 .* still rises .* no a, b, D_c is taken"):
        ca.trace_of(ca.read(out))


def test_what_rests_on_friction_that_is_not_steady_is_not_given():
    """Twice the same speed, right after a hold at which bonds formed: no velocity weakening."""
    protocol = {"kind": "slide-hold-slide", "speed": 100.0, "distance": 0.4, "holds": [10.0, 100.0]}
    run = ca.run(tip(replicas=40, protocol=protocol), warn=False)
    found = {name: one.quantity() for name, one in run.measured.items() if one.is_number}
    assert found["steady_1"].reason.startswith("still ")
    assert found["healing_1"].text() == f"not taken: {found['steady_1'].label} {found['steady_1'].reason}"
    assert math.isnan(found["healing_rate"].value)
    assert run.summary()["observables"]["healing_1"]["mean"] is None
    # the peak rests on nothing
    assert found["static_1"].value > 0


def test_few_bonds_give_an_upper_bound_and_no_change_of_friction(tmp_path, command):
    protocol = {"kind": "velocity-steps", "speeds": [10.0, 1e6], "distance": 4.0}
    scene = tip(protocol=protocol)
    told = command("check", file_of(scene, tmp_path)).out
    assert "step 1: about" in told
    assert "step 0: about" not in told
    seen = ca.run(scene, warn=False).summary()["observables"]
    slow, fast, change = (seen[name] for name in ("steady_0", "steady_1", "change_1"))
    assert slow["mean"] > 0
    assert not slow["reason"]
    assert (fast["mean"], fast["low"]) == (None, 0.0)
    assert 0 < fast["high"] < slow["mean"]
    assert "bonds formed in the window" in fast["reason"]
    assert change["mean"] is None
    with pytest.raises(InputError, match=r"at 1e\+06 nm/s below .* no a, b, D_c is taken"):
        ca.trace_of(ca.run(scene, warn=False))


def test_a_mean_says_so_too():
    mean = ca.ensemble(tip(step=SHORT), accuracy={"observable.peak_1": "8 %"})
    assert mean.estimate("observable.steady_1").reason.count("still rises by")
    assert mean.summary()["observables"]["steady_1"]["reason"].count("still rises by")


def told(values: np.ndarray, formed: float, share: float = 1.0) -> Quantity:
    """What is said of (replicas, 2) means over both halves of a window."""
    numbers = {
        "force": values.mean(axis=1),
        "force" + steadiness.CHANGE: values[:, 1] - values[:, 0],
        "force" + steadiness.FORMED: np.full(len(values), formed),
        "force" + steadiness.SHARE: np.full(len(values), share),
    }
    declared = {name: Quantity(name, "nN", name).of_replicas(one) for name, one in numbers.items()}
    return steadiness.judged(declared, {"force": ["force"]}, len(values))["force"]


@pytest.mark.parametrize(("replicas", "bonds"), [(2, 10), (3, 1000), (10, 2), (20, 1), (200, 0.1), (200, 10)])
def test_one_of_twenty_steady_means_is_called_unsteady(replicas, bonds):
    """Bonds of unequal strength form at random in both halves; at 20 bonds the distribution is not normal."""
    rng, trials = np.random.default_rng(5), 4000
    counts = rng.poisson(bonds / 2, (trials, replicas, 2))
    values = rng.gamma(np.maximum(2.0 * counts, 1e-12))
    said = np.mean(["still" in told(one, bonds).reason for one in values])
    assert said < 0.05 + 4.5 * (0.05 * 0.95 / trials) ** 0.5
    # and a fall to half is seen as far as the bonds allow: its mean over its standard error is 3 or more at 100 bonds
    values[..., 1] *= 0.5
    if replicas * bonds >= 100 and replicas > 3:
        assert np.mean(["still falls" in told(one, bonds).reason for one in values]) > 0.7


@pytest.mark.parametrize("bonds", [0.5, 3.0, 15.0])
def test_the_bound_is_above_the_truth_in_95_of_100(bonds):
    """Of sums of as many shares as Poisson says, each at most 1."""
    rng, trials = np.random.default_rng(6), 4000
    for weights in (lambda count: count.astype(float), lambda count: rng.beta(2, 5, count.sum())):
        count = rng.poisson(bonds, trials)
        drawn = weights(count)
        sums = drawn if drawn.size == trials else np.add.reduceat(np.append(drawn, 0), np.cumsum(count) - count)
        sums = np.where(count, sums, 0.0)
        truth = bonds * (1.0 if drawn.size == trials else 2 / 7)
        held = np.mean([steadiness.upper_bound(one, 1.0, 1) >= truth for one in sums])
        assert held > 0.95 - 4.5 * (0.05 * 0.95 / trials) ** 0.5


def equal_sites(seed: int, speeds: list[float]) -> ca.Run:
    """Many replicas of a tip whose sites have one barrier and keep it, so that its sliding is steady for certain."""
    protocol = {"kind": "velocity-steps", "speeds": speeds, "distance": 4.0}
    data = tip(1000, {"partner": "kept"}, protocol=protocol)
    del data["interaction"]
    data["forming"]["std"] = data["chemistry"]["activation_volume"] = 0.0
    data["hold"]["seed"] = seed
    return ca.run(data, warn=False)


@pytest.mark.long
def test_steady_runs_are_seldom_called_unsteady():
    """100 groups of 10 replicas of an engine, at four speeds."""
    speeds = [3.0, 30.0, 100.0, 300.0]
    run = equal_sites(3, speeds)
    said = 0
    for k in range(len(speeds)):
        values = {part: run.measured[f"steady_{k}{part}"].values for part in ("", steadiness.CHANGE)}
        first = values[""] - values[steadiness.CHANGE] / 2
        for group in np.split(np.stack([first, first + values[steadiness.CHANGE]], axis=1), 100):
            said += "still" in told(group, 100.0).reason
    assert 0 < said < 20 + 4.5 * (400 * 0.05 * 0.95) ** 0.5


@pytest.mark.long
def test_the_same_speed_twice_is_no_velocity_weakening(monkeypatch):
    """Right after a hold, on a path that is too short: the row tells nothing, and says why."""
    row = next(row for row in ROWS if row.name == "mcclimon-weakening")
    slide = {"speed": "10 nm/s", "distance": "0.4 nm"}
    case = {"hold.replicas": 50, "step": [{"duration": "100 s"}, slide, slide]}
    monkeypatch.setattr("chemage_validation.table.ROWS", [replace(row, cases=[case])])
    (found,) = validate().rows
    assert found.prediction.high < found.row.limits.high
    assert found.verdict == "cannot tell"
    assert "still" in found.reason
