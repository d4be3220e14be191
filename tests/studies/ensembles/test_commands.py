"""Ensembles on the command line: run, resumed, shown, drawn, checked, refused."""

from __future__ import annotations

import json
from pathlib import Path

import faults
import numpy as np
import pytest

import chemage as ca

SCENE = """
name = "rough"

[surface]
kind = "self-affine"
pixels = 128
pixel_size = 0.45
rms_slope = 0.1
hurst = 0.8
zeta = 8
seed = 3

[contact]
kind = "fft-bem"
modulus = 35.3
load = 400.0

[forming]
kind = "uniform"
lower = 0.8
upper = 1.4

[engine]
kind = "independent"

[hold]
start = 1e-2
stop = 1e4
per_decade = 1
replicas = 2
seed = 5
"""
ASKED = '[ensemble]\nbudget = "1 h"\n\n[accuracy]\nbeta = "9 %"\n'


@pytest.fixture
def scene(tmp_path, monkeypatch) -> Path:
    """The file of a scene, in an empty working folder."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "rough.toml"
    file.write_text(SCENE)
    return file


def test_a_number_of_surfaces_is_run_written_drawn_and_shown(command, scene):
    done = command("run", scene, "--surfaces", 3)
    assert done.status == 0, done.err
    assert "per decade" in done.out
    made = ca.read("rough.h5")
    assert isinstance(made, ca.Ensemble)
    assert made.surfaces == 3
    assert (Path("rough-figures") / "ensemble.png").stat().st_size > 1000
    assert list(Path("rough-samples").iterdir())
    shown = command("show", "rough.h5")
    assert shown.status == 0, shown.err
    assert shown.out in done.out
    every = command("show", "rough.h5", "--all").out
    assert "3 random surfaces: 128 x 128 pixels, 2 replicas each" in every
    assert "per e-fold" in every
    assert command("plot", "rough.h5", "--out", "again").status == 0
    assert (Path("again") / "ensemble.png").is_file()
    assert "doi" in command("cite", "rough.h5").out


def test_json_is_one_object_with_every_part_of_the_error(command, scene):
    done = command("run", scene, "--surfaces", 3, "--no-figures", "--json")
    found = json.loads(done.out)
    beta = found["beta"]
    assert beta["low"] < beta["value"] < beta["high"]
    assert set(found["errors"]["beta"]) == {"surfaces", "replicas"}
    assert found["b"]["value"] == pytest.approx(beta["value"] / np.log(10))
    assert found["file"] == "rough.h5"
    assert found["samples"] == "rough-samples"
    shown = json.loads(command("show", "rough.h5", "--json").out)
    assert (shown["beta"], shown["errors"]) == (found["beta"], found["errors"])


def test_a_result_comes_back_bit_for_bit_and_xarray_reads_its_times(scene):
    xarray = pytest.importorskip("xarray")
    made = ca.ensemble(scene, surfaces=3)
    ca.write("made.h5", made)
    again = ca.read("made.h5")
    assert again == made
    assert again.half_widths.tobytes() == made.half_widths.tobytes()
    with xarray.open_dataset("made.h5", group="ensemble", engine="h5netcdf") as data:
        assert data["hold_time"].values.tolist() == made.hold_times.tolist()


def test_contacts_alone_are_averaged_too(scene):
    data = {
        name: part for name, part in ca.plugin.scene_data(scene)[0].items() if name in ("name", "surface", "contact")
    }
    made = ca.ensemble(data, surfaces=3)
    assert made.estimate("area_fraction").half_width > 0
    ca.write("made.h5", made)
    assert ca.read("made.h5") == made


@pytest.mark.long
def test_sections_of_a_scene_ask_and_options_override_them(command, scene):
    scene.write_text(SCENE + ASKED)
    done = command("run", scene, "--no-figures", "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["goals"] == {"beta": 0.09}
    assert found["stopped"] == "the accuracy was reached"
    assert found["beta"]["high"] <= 1.09 * found["beta"]["value"]
    done = command("run", scene, "--surfaces", 2, "-o", "two.h5", "--no-figures", "--json")
    assert json.loads(done.out)["stopped"] == "the number of surfaces that was asked for"
    # one surface is a run as it always was
    done = command("run", scene, "--surfaces", 1, "-o", "one.h5", "--no-figures")
    assert done.status == 0, done.err
    assert isinstance(ca.read("one.h5"), ca.Run)


@pytest.mark.long
def test_a_goal_at_a_hold_time_is_shown_at_that_time(command, scene):
    goal = "friction_coefficient_drop@1e2 s=9%"
    done = command("run", scene, "--accuracy", "beta=9%", "--accuracy", goal, "--no-figures")
    assert done.status == 0, done.err
    assert "friction coefficient drop Δμ at 100 s" in done.out
    every = command("show", "rough.h5", "--all").out
    assert "± 9 %" in every
    assert "ended because" in every
    beside = json.loads(command("compare", "rough.h5", "--json").out)["results"][0]
    assert beside[goal.removesuffix("=9%")]["value"] == pytest.approx(
        ca.read("rough.h5").estimate("friction_coefficient_drop", 100.0).value
    )


@pytest.mark.long
def test_a_budget_ends_sampling_and_says_so(command, scene):
    done = command("run", scene, "--budget", "3 s", "--no-figures")
    assert done.status == 0, done.err
    assert "the time was over" in done.out


@pytest.mark.long
def test_an_interrupted_ensemble_says_its_interval_and_goes_on(command, scene, monkeypatch):
    words = ("run", scene, "--accuracy", "beta=6%", "--threads", 1, "--no-figures")
    with monkeypatch.context() as patch:
        faults.interrupt_after(patch, 8)
        stopped = command(*words)
    assert stopped.status == 130
    assert "interrupted; so far beta ± " in stopped.err
    assert "from 8 samples, kept in rough-samples; the same command takes them up and goes on" in stopped.err
    assert not Path("rough.h5").exists()
    done = command(*words)
    assert done.status == 0, done.err
    assert "8 samples taken from rough-samples" in done.out
    # as if nothing had happened
    assert ca.read("rough.h5") == ca.ensemble(scene, accuracy={"beta": "6%"})


@pytest.mark.long
def test_nothing_is_overwritten_unless_forced(command, scene):
    words = ("run", scene, "--surfaces", 2, "--no-figures")
    assert command(*words).status == 0
    again = command(*words)
    assert again.status == 2
    assert "rough.h5" in again.err
    forced = command(*words, "--force")
    assert forced.status == 0
    assert "2 samples taken from rough-samples" in forced.out
    Path("other-samples").write_text("mine")
    done = command(*words, "-o", "other.h5")
    assert done.status == 2
    assert Path("other-samples").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--accuracy", "beta"), "write it as NAME=VALUE, such as beta=2%"),
        (("--accuracy", "beta=2%", "--accuracy", "beta=3%"), "beta is given twice"),
        (("--accuracy", "beta=0"), "accuracy.beta: '0': must lie between 1e-09 and 1"),
        (("--accuracy", "beta=-1%"), "must lie between 1e-09 and 1"),
        (("--accuracy", "beta=200%"), "must lie between 1e-09 and 1"),
        (("--accuracy", "betta=2%"), "no such quantity (did you mean 'beta'?)"),
        (("--accuracy", "friction_drop@3 s=2%"), "is not one of the hold times; the nearest is 1 s"),
        (("--surfaces", "5", "--accuracy", "beta=2%"), "give the number of surfaces, or the accuracy"),
        (("--budget", "3 nm"), "ensemble.budget"),
        (("--budget", "-3 s"), "ensemble.budget"),
        (("--surfaces", "5", "-o", "result.txt"), "ends in .txt"),
        (("--surfaces", "5", "--checkpoints", "here"), "an ensemble keeps its samples beside its result"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_anything_is_computed(command, scene, words, message):
    done = command("run", scene, *words)
    assert done.status == 2
    assert message in done.err
    assert [path.name for path in Path().iterdir()] == ["rough.toml"]
    if words[-1] not in ("result.txt", "here"):
        assert command("check", scene, *words).status == 2


def test_check_foresees_a_number_of_surfaces(command, scene):
    done = command("check", scene, "--surfaces", 40)
    assert done.status == 0, done.err
    assert "128 x 128 pixels, 2 replicas" in done.out
    assert "40, as asked for" in done.out
    found = json.loads(command("check", scene, "--surfaces", 40, "--json").out)["ensemble"]
    (one,) = found["computations"]
    # measured in a pilot, of which this is an estimate
    low, high = found["cpu_seconds_range"]
    assert 0 < low < found["cpu_seconds"] < high < 40 * 20 * one["cpu_seconds"]


def test_check_foresees_the_computations_of_an_accuracy(command, scene):
    done = command("check", scene, "--accuracy", "beta=2%", "--budget", "1e-3 s")
    assert done.status == 0, done.err
    assert "beta ± 2 %, 0.001 s of wall time, whichever comes first" in done.out
    assert "128 x 128 pixels, 1 replica, about" in done.out
    assert "the time will be over before" in done.out
    assert "warning: the first 6 surfaces, without which there is no interval, take about" in done.out
    done = command("check", scene, "--accuracy", "beta=2%")
    assert "from a pilot of" in " ".join(done.out.split())


def test_points_of_a_sweep_may_be_means(command, scene):
    sweep = '[sweep]\n"contact.load" = [400.0, 500.0]\n'
    scene.write_text(SCENE + sweep)
    checked = command("check", scene, "--accuracy", "beta=5%")
    assert checked.status == 0
    assert "a mean over surfaces" in " ".join(checked.out.split())
    assert "of CPU time" in checked.out
    refused = command("run", scene, "--budget", "5 s")
    assert refused.status == 2
    assert "a wall time is for one mean" in refused.err


@pytest.mark.long
def test_progress_shows_the_interval_closing(scene):
    seen = []
    ca.ensemble(scene, accuracy={"beta": "6 %"}, progress=lambda *given: seen.append(given))
    stage, done, total, note = seen[-1]
    assert stage == "sampling"
    assert done == total >= 10
    assert note.startswith("beta ± ")
    assert note.endswith(" of 6 %")
    assert all(one[1] <= one[2] for one in seen)
