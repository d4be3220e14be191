"""Sweeps of which every point is a mean over surfaces: the same on every executor, in shares, and after a kill."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import faults
import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import SceneError, StoreError

SCENE = """
name = "means"
surface = { kind = "self-affine", pixels = 64, pixel_size = 0.45, hurst = 0.8, zeta = 8, eta = 1, rms_slope = 0.1 }
contact = { kind = "fft-bem", load = "40 MPa", modulus = 35.3 }
forming = { kind = "gaussian", mean = 0.9, std = 0.1 }
engine = { kind = "auto" }
hold = { start = 1.0, stop = 1e4, per_decade = 1, replicas = 1 }
[accuracy]
beta = "15 %"
[sweep]
"hold.temperature" = [290, 300]
"""


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "means.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """All points, one surface after the other."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "means.toml").write_text(SCENE)
    return ca.sweep(folder / "means.toml", folder / "out", executor="serial")


def content(folder: Path) -> dict[str, dict]:
    """What the files of points and samples hold, without the time that it took."""
    found = {}
    for path in sorted(folder.rglob("points/*/*.json")):
        one = json.loads(path.read_bytes())
        one["summary"].pop("timings", None)
        del one["sha256"]
        found[str(path.relative_to(folder))] = one
    return found


def same(folder: Path, other: Path) -> bool:
    tables = [(one / "results.csv").read_bytes() for one in (folder, other)]
    return content(folder) == content(other) and tables[0] == tables[1]


def test_each_point_is_the_mean_of_its_scene(whole, tmp_path):
    assert whole.states() == ["done"] * 2
    for point, temperature in zip(whole, (290, 300), strict=True):
        mean = ca.ensemble(ca.load_scene(_plain(tmp_path), {"hold.temperature": temperature}))
        assert point.ensemble().mean.tolist() == mean.mean.tolist()
        beta = mean.estimate("beta")
        assert point.summary["beta"] == beta.value
        assert point.summary["beta_half_width"] == beta.half_width <= 0.15 * beta.value


def _plain(folder: Path) -> Path:
    path = folder / "one.toml"
    path.write_text(SCENE.partition("[sweep]")[0])
    return path


def test_points_have_their_contacts_in_common(whole):
    """Temperature changes no contact: samples of the same number are of one surface."""
    first, second = (json.loads(json.dumps(point.ensemble().levels[0]["seeds"])) for point in whole)
    count = min(len(first), len(second))
    assert first[:count] == second[:count]


def test_the_table_has_means_with_their_intervals(whole):
    table = whole.table()
    assert table.means
    assert np.all(table.results["beta_half_width"].values < 0.15 * table.results["beta"].values)
    assert "events" not in table.results
    assert whole.to_xarray().beta.dims == ("temperature",)


def test_threads_give_the_same(whole, file, tmp_path):
    ca.sweep(file, tmp_path / "out", workers=2)
    assert same(tmp_path / "out", whole.folder)


def test_accuracy_may_be_an_argument(whole, file, tmp_path):
    file.write_text(SCENE.replace('[accuracy]\nbeta = "15 %"\n', ""))
    result = ca.sweep(file, tmp_path / "out", accuracy={"beta": "15 %"})
    assert same(result.folder, whole.folder)


def test_a_finished_sweep_computes_nothing(file, tmp_path, monkeypatch):
    file.write_text(SCENE.replace("15 %", "40 %"))
    ca.sweep(file, tmp_path / "out")
    faults.interrupt_after(monkeypatch, 0)
    assert ca.sweep(file, tmp_path / "out").states() == ["done"] * 2


def test_a_point_has_no_contact_of_its_own(whole):
    with pytest.raises(StoreError, match=r"is a mean over surfaces; use ensemble\(\)"):
        whole[0].contact()
    with pytest.raises(StoreError, match=r"is a mean over surfaces; use ensemble\(\)"):
        whole[0].run()


def test_what_cannot_be_reached_fails_at_its_point(file, tmp_path):
    file.write_text(SCENE.replace("[290, 300]", "[30, 300]"))
    result = ca.sweep(file, tmp_path / "out")
    assert result.states() == ["failed", "done"]
    assert "InputError" in result[0].error
    assert "its mean is 0 within its interval" in result[0].error


def test_samples_of_another_version_end_the_mean(file, tmp_path, monkeypatch):
    """As of a worker on another machine."""
    faults.other_version(monkeypatch, "0.0.1")
    result = ca.sweep(file, tmp_path / "out")
    assert result.states() == ["failed"] * 2
    assert "a worker has chemage 0.0.1, but the study is run by" in result[0].error
    assert not list((tmp_path / "out").rglob(".parts"))


def test_a_budget_is_refused(file, tmp_path):
    file.write_text(SCENE.replace("[sweep]", "[ensemble]\nbudget = 10\n[sweep]"))
    with pytest.raises((InputError, SceneError), match="a wall time is for one mean"):
        ca.sweep(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def start(*words: object) -> subprocess.Popen:
    command = [sys.executable, "-m", "chemage", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.campaign
def test_a_job_array_of_four_gives_the_same(whole, file, tmp_path):
    shares = [start("sweep", file, "--out", tmp_path / "out", "--points", f"{share}/4") for share in range(1, 5)]
    for share in shares:
        text, _ = share.communicate(timeout=600)
        assert share.returncode == 0, text
    assert ca.collect_sweep(tmp_path / "out").complete
    assert same(tmp_path / "out", whole.folder)


@pytest.mark.long
@pytest.mark.parametrize("executor", ["processes", pytest.param("dask", marks=pytest.mark.campaign)])
def test_workers_give_the_same(whole, file, tmp_path, executor):
    ca.sweep(file, tmp_path / "out", executor=executor, workers=2)
    assert same(tmp_path / "out", whole.folder)


@pytest.mark.long
def test_killed_and_resumed_gives_the_same(whole, file, tmp_path):
    out = tmp_path / "out"
    for more in (2, 3):
        before = len(list(out.glob("samples/points/*/*.json")))
        process = start("sweep", file, "--out", out, "--executor", "processes", "--workers", 2)
        deadline = time.monotonic() + 300
        while len(list(out.glob("samples/points/*/*.json"))) < before + more:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    process = start("sweep", file, "--out", out)
    text, _ = process.communicate(timeout=600)
    assert process.returncode == 0, text
    assert same(out, whole.folder)


@pytest.mark.long
def test_one_mean_as_a_job_array(tmp_path):
    path = _plain(tmp_path)
    words = ("run", path, "--out", tmp_path / "array.h5", "--no-figures")
    shares = [start(*words, "--points", f"{share}/2") for share in (1, 2)]
    for share in shares:
        text, _ = share.communicate(timeout=600)
        assert share.returncode == 0, text
    assert ca.read(tmp_path / "array.h5") == ca.ensemble(path)
