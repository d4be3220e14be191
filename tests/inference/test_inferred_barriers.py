"""The barriers ``inferred``, and the error that members of a distribution give a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_inference import SCENE, made_inference

import chemage as ca


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "tip-inferred.h5"
    ca.write(path, made_inference())
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> ca.Run:
    path = tmp_path_factory.mktemp("inferred") / "tip-inferred.h5"
    ca.write(path, made_inference())
    return ca.run(scene_of(path), warn=False)


def scene_of(file: Path, **options) -> ca.Scene:
    return ca.parse_scene({**SCENE, "forming": {"kind": "inferred", "path": str(file), **options}})


def test_the_density_is_that_of_the_inference(file):
    inference = ca.read(file)
    barriers = ca.barriers("inferred", path=file)
    assert np.allclose(barriers.density(inference.energies), inference.density, rtol=1e-9)
    third = ca.barriers("inferred", path=file, member=3)
    assert np.allclose(third.density(inference.energies), inference.samples[2], rtol=1e-9)


def test_what_is_missing_to_one_lies_above_every_energy(file):
    inference = ca.read(file)
    uniform = (np.arange(20000) + 0.5) / 20000
    found = ca.barriers("inferred", path=file).quantile(uniform)
    share = np.trapezoid(inference.density, inference.energies)
    assert (found <= inference.energies[-1]).mean() == pytest.approx(share, abs=1e-4)
    assert found[found > inference.energies[-1]].min() > inference.energies[-1] + 0.4


def test_the_content_of_the_file_is_in_the_keys(file):
    before = scene_of(file).keys()
    assert scene_of(file, member=2).keys()["ageing"] != before["ageing"]
    ca.write(file, made_inference(seed=7), force=True)
    after = scene_of(file).keys()
    assert after["ageing"] != before["ageing"]
    assert after["contact"] == before["contact"]


def test_wrong_files_and_members_are_clear_errors(file, tmp_path):
    with pytest.raises(ca.InputError, match="members 1 to 60"):
        ca.barriers("inferred", path=file, member=61).quantile(np.array([0.5]))
    with pytest.raises(ca.plugin.StoreError, match=r"nothing\.h5"):
        ca.barriers("inferred", path=tmp_path / "nothing.h5").quantile(np.array([0.5]))
    other = tmp_path / "forecast.h5"
    ca.write(other, ca.surface("sphere", radius=5, pixels=32, pixel_size=0.5).make())
    with pytest.raises(ca.InputError, match="not an inference"):
        ca.barriers("inferred", path=other).quantile(np.array([0.5]))
    with pytest.raises(ca.InputError, match="member"):
        ca.barriers("inferred", path=file, member=-1)


def test_only_the_mean_has_members(file):
    barriers = ca.barriers("inferred", path=file)
    members = barriers.members(8)
    assert len({one.member for one in members}) == 8
    assert min(one.member for one in members) >= 1
    assert members[0].members(8) == ()
    assert len(barriers.members(1000)) == 60
    assert ca.barriers("uniform", lower=0.8, upper=1.4).members(8) == ()


def test_a_run_carries_the_error_of_its_barriers(run, tmp_path):
    error = run.ageing.errors["barriers"]
    assert run.ageing.member_ratios.shape == (8, run.ageing.hold_times.size)
    assert np.allclose(error, run.ageing.member_ratios.std(axis=0, ddof=1), equal_nan=True)
    assert 0 < error[-1] < 0.3
    assert "8 members" in run.ageing.error_sources["barriers"]
    assert 0 < run.beta_errors["barriers"] < 1
    summary = run.summary()
    assert summary["beta_errors"] == run.beta_errors
    assert summary["bond_errors"]["barriers"][-1] == error[-1]
    path = tmp_path / "run.h5"
    ca.write(path, run)
    again = ca.read(path)
    assert again.ageing == run.ageing
    assert again.beta_errors == run.beta_errors


def test_the_rest_of_the_run_is_as_without(run):
    alone = ca.age(
        run.contact,
        ca.parse_scene(run.scene).chemistry,
        engine=ca.engine("rejection-free"),
        hold_times=run.ageing.hold_times,
        temperature=300.0,
        replicas=3,
        seed=1,
    )
    assert np.array_equal(alone.bonds, run.ageing.bonds)
    assert alone.errors == {}


def test_other_distributions_have_no_such_error():
    run = ca.run(ca.parse_scene(SCENE), warn=False)
    assert run.ageing.errors == {}
    assert run.ageing.member_ratios is None
    assert run.beta_errors == {}
    assert "beta_errors" not in run.summary()


@pytest.mark.long
def test_a_wider_band_is_a_larger_error(tmp_path):
    errors = []
    for number, width in enumerate((0.02, 0.4)):
        base = made_inference()
        wide = base.density * (1 + width * np.random.default_rng(1).standard_normal((60, 1)))
        path = tmp_path / f"{number}.h5"
        wide = np.maximum(wide, 0)
        wide /= np.maximum(np.trapezoid(wide, base.energies, axis=1)[:, None], 1.0)
        ca.write(path, base.model_copy(update={"samples": wide}))
        errors.append(ca.run(scene_of(path), warn=False).ageing.errors["barriers"][-1])
    assert errors[1] > 3 * errors[0]


@pytest.mark.long
def test_a_mean_over_surfaces_carries_the_error(file):
    found = ca.ensemble(scene_of(file), accuracy={"friction_drop": 0.4})
    errors = found.estimate("beta").errors
    assert "8 members" in errors["barriers"].how
    assert "on one surface" in errors["barriers"].how
    assert 0 < errors["barriers"].size < abs(found.estimate("beta").value)
    assert found.estimate("beta").half_width > 1.96 * errors["barriers"].size
    # the contact does not depend on the barriers
    assert found.estimate("area").errors["barriers"].size == 0
    plain = ca.ensemble(ca.parse_scene(SCENE), accuracy={"friction_drop": 0.4})
    assert "barriers" not in plain.estimate("beta").errors


def test_an_accuracy_narrower_than_the_error_of_the_barriers_is_refused(file):
    with pytest.raises(ca.InputError, match=r"errors that no number of .* makes smaller are larger"):
        ca.ensemble(scene_of(file), accuracy={"friction_drop": 1e-4}, most=10)


def test_show_names_the_error(run, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ca.write("run.h5", run)
    shown = " ".join(command("show", "run.h5", "--all").out.split())
    assert "error of β: barriers" in shown
    assert "scatter of 8 members of the distribution of barriers" in shown


@pytest.mark.long
def test_a_report_names_the_error(run, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ca.write("run.h5", run)
    assert command("report", "run.h5").status == 0
    assert "scatter of 8 members" in Path("report.html").read_text(encoding="utf-8")
