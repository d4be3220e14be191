"""`chemage infer` and the commands that read its file: what they print, write and refuse."""

from __future__ import annotations

import json
from pathlib import Path

import faults
import inferring
import numpy as np
import pytest
from made_inference import made_forecast, made_inference

import chemage as ca

SCENE = """
name = "bare-tip"

[surface]
kind = "sphere"
radius = "5 nm"
pixels = 32
pixel_size = "0.4518 nm"

[contact]
kind = "hertz"
modulus = "35.3 GPa"
load = "20 nN"

[forming]
kind = "uniform"
lower = 0.8
upper = 1.4

[engine]
kind = "rejection-free"

[hold]
start = "1 ms"
stop = "1e5 s"
per_decade = 2
replicas = 3
seed = 1
"""
HEADER = "hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K)\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a scene and a measured curve that rises with the logarithm of the hold time."""
    monkeypatch.chdir(tmp_path)
    Path("tip.toml").write_text(SCENE, encoding="utf-8")
    rows = [f"{t:.6g}, {12 + 3.0 * np.log10(t):.5g}, 0.5, 20, 300" for t in np.geomspace(1e-3, 1e5, 25)]
    Path("tip.csv").write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")
    return tmp_path


@pytest.fixture
def made_up(monkeypatch):
    """`chemage infer` without the computation: what it was called with."""
    called = {}

    def infer(curves, scene, **how):
        called.update(curves=curves, scene=scene, **how)
        return made_inference()

    def forecast(self, **how):
        called.update(forecast=how)
        unseen = {"notes": ("half of it is unseen",), "unseen": 0.5} if "temperature" in how else {}
        return made_forecast(**unseen)

    faults.infer_by(monkeypatch, infer)
    monkeypatch.setattr(ca.Inference, "forecast", forecast)
    ranked = [{"hold_time": 1e6, "load": 20.0, "reduction": 0.4, "deviation": 0.1}]
    monkeypatch.setattr(
        ca.Inference, "next_experiment", lambda self, candidates, **how: called.update(candidates=candidates) or ranked
    )
    return called


@pytest.fixture
def result(command, folder, made_up):
    """The file of an inference with two forecasts and a planned measurement."""
    words = ["--predict", "load=50 nN", "--predict", "temperature=350 K", "--next", "hold_time=1e6 s"]
    assert command("infer", "tip.csv", "--scene", "tip.toml", "--no-figures", "-o", "made.h5", *words).status == 0
    return "made.h5"


def test_what_was_asked_reaches_the_inference_and_the_file(command, folder, made_up):
    Path("plan.csv").write_text("hold_time (min), load (uN), error (%)\n10, 0.05, 5\n1000, , \n", encoding="utf-8")
    words = ["--predict", "load=0.5 uN, temperature=350 K, hold_time=1 s to 100 s", "--next", "plan.csv"]
    words += ["--next", "hold_time=1 s to 100 s, load=50 nN", "--unknown", "bond_force=1 nN to 10 nN", "--seed", 4]
    done = command("infer", "tip.csv", "--scene", "tip.toml", "--no-figures", *words)
    assert done.status == 0, done.err
    assert made_up["unknown"] == {"bond_force": ("1 nN", "10 nN")}
    assert made_up["seed"] == 4
    assert made_up["families"] == ("uniform", "triangle", "gaussian", "piecewise")
    assert [curve.hold_times.size for curve in made_up["curves"]] == [25]
    assert made_up["forecast"]["load"] == 500
    assert made_up["forecast"]["hold_times"][0] == 1
    assert len(made_up["forecast"]["hold_times"]) == 9
    assert made_up["candidates"][0] == {"hold_time": 600, "load": pytest.approx(50), "error": "5 %"}
    assert [one["hold_time"] for one in made_up["candidates"]] == [600, 60000, 1, 10, 100]
    assert "one peak at 1.000 " in done.out
    assert "load=0.5 uN, temperature=350 K" in done.out
    assert "10⁶ s, 20 nN" in done.out
    assert max(map(len, done.out.splitlines())) <= 120
    shown = json.loads(command("show", "tip-inferred.h5", "--json").out)
    assert [forecast["label"] for forecast in shown["forecasts"]] == ["load=0.5 uN, temperature=350 K"]
    assert shown["experiments"][0]["hold_time"] == 1e6
    assert isinstance(ca.read("tip-inferred.h5"), ca.Inference)
    assert not Path("tip-inferred-figures").exists()


@pytest.mark.filterwarnings("default::chemage.PlanWarning")
def test_whether_celsius_are_meant_is_asked_before_anything_is_computed(command, folder, monkeypatch):
    """A density at 27 K has 160 nodes: sampling takes minutes."""
    text = Path("tip.csv").read_text(encoding="utf-8").replace(", 300\n", ", 27\n")
    Path("cold.csv").write_text(text, encoding="utf-8")
    asked = "cold: temperature = 27 K: is 27 °C meant?"

    def stopped(*args, **how):
        raise ca.InputError("computed")

    monkeypatch.setattr("chemage_inference.infer.make_model", stopped)
    done = command("infer", "cold.csv", "--scene", "tip.toml", "--no-figures")
    assert asked in done.out + done.err
    assert done.status == 2
    Path("cold.csv").write_text(text.replace(", 27\n", ", 27 K\n"), encoding="utf-8")
    done = command("infer", "cold.csv", "--scene", "tip.toml", "--no-figures")
    assert "meant" not in done.out + done.err


@pytest.mark.long
def test_figures_are_drawn_beside_the_result(command, folder, made_up):
    done = command("infer", "tip.csv", "--scene", "tip.toml", "--predict", "load=500 nN")
    assert done.status == 0, done.err
    figures = {path.stem for path in Path("tip-inferred-figures").iterdir()}
    assert figures == {"density", "data", "predictive", "forecasts"}


def test_tables_have_80_columns(command, result):
    done = command("show", "made.h5")
    assert done.status == 0, done.err
    tables = [line for line in done.out.splitlines() if not line.startswith(("note:", "the data", "hold times"))]
    assert max(map(len, tables)) <= 80
    assert "one peak" in done.out
    assert "note: forecast temperature=350 K: half of it is unseen" in done.out


def test_json_is_one_object_with_the_forecasts(command, folder, made_up):
    words = ["--predict", "load=500 nN", "--no-figures", "--json", "--families", "none"]
    done = command("infer", "tip.csv", "--scene", "tip.toml", "-o", "x.h5", *words)
    found = json.loads(done.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert made_up["families"] == ()
    assert (found["file"], found["figures"]) == ("x.h5", [])
    assert found["forecasts"][0]["label"] == "load=500 nN"
    assert len(found["forecasts"][0]["band_90"]) == 2
    assert len(found["density"]) == len(found["energies"])
    shown = json.loads(command("show", "x.h5", "--json").out)
    assert shown["forecasts"] == found["forecasts"]


@pytest.mark.long
def test_the_file_is_shown_drawn_reported_and_cited(command, result):
    assert ca.read("made.h5") == made_inference()
    assert command("plot", "made.h5", "--format", "svg").status == 0
    assert Path("made-figures/density.svg").is_file()
    done = command("report", "made.h5")
    assert done.status == 0, done.err
    page = Path("report.html").read_text(encoding="utf-8")
    for text in ("one peak", "Forecasts", "half of it is unseen", "Next measurements", "smooth density", "Provenance"):
        assert text in page, text
    assert page.count("<svg") == 5
    first = page.encode()
    assert command("report", "made.h5", "--force").status == 0
    assert Path("report.html").read_bytes() == first
    assert "10.1103/PhysRevE.98.023001" in command("cite", "made.h5").out
    assert command("report", "made.h5", "tip.csv", "--out", "two.html").status == 2


def test_an_inference_written_alone_is_shown_too(command, folder):
    ca.write("alone.h5", made_inference())
    shown = json.loads(command("show", "alone.h5", "--json").out)
    assert (shown["points"]["value"], shown["forecasts"], shown["experiments"]) == (
        made_inference().hold_times.size,
        [],
        [],
    )


@pytest.mark.parametrize(
    ("effective", "r_hat", "converged"), [(800, 1.01, True), (800, 1.06, False), (99, 1.01, False)]
)
def test_only_bands_of_chains_that_agree_are_called_intervals(command, folder, effective, r_hat, converged):
    sampling = {"effective_samples": float(effective), "r_hat": r_hat, "cpu_seconds": 3.2}
    ca.write("alone.h5", made_inference(diagnostics=sampling))
    text = " ".join(command("show", "alone.h5").out.split())
    assert ("90 % intervals" in text) is converged
    assert ("bands of the posterior: they contain" in text) is converged
    assert ("chains have not converged" in text) is not converged


def test_nothing_is_overwritten(command, folder, made_up):
    for name in ("tip-inferred.h5", "other.h5"):
        Path(name).write_text("mine")
    done = command("infer", "tip.csv", "--scene", "tip.toml")
    assert done.status == 2
    assert "tip-inferred.h5" in done.err
    assert not made_up
    assert Path("tip-inferred.h5").read_text() == "mine"
    assert command("infer", "tip.csv", "--scene", "tip.toml", "--force", "--no-figures").status == 0
    assert command("infer", "tip.csv", "--scene", "tip.toml", "-o", "tip.csv", "--force").status == 2
    assert Path("tip.csv").read_text().startswith("hold_time")


def test_interrupted_leaves_nothing(command, folder, monkeypatch):
    def infer(curves, scene, **how):
        raise KeyboardInterrupt

    faults.infer_by(monkeypatch, infer)
    before = sorted(path.name for path in folder.iterdir())
    done = command("infer", "tip.csv", "--scene", "tip.toml")
    assert done.status == 130
    assert "interrupted; nothing was written" in done.err
    assert sorted(path.name for path in folder.iterdir()) == before


def test_interrupted_drawing_keeps_the_result(command, folder, made_up, monkeypatch):
    faults.interrupt_drawing(monkeypatch)
    done = command("infer", "tip.csv", "--scene", "tip.toml")
    assert done.status == 130
    assert "the result is in tip-inferred.h5" in done.err
    assert sorted(path.name for path in folder.iterdir()) == ["tip-inferred.h5", "tip.csv", "tip.toml"]
    assert ca.read("tip-inferred.h5") == made_inference()


def test_a_forecast_that_fails_leaves_nothing(command, folder, made_up, monkeypatch):
    def forecast(self, **how):
        raise ca.InputError("load: too large")

    monkeypatch.setattr(ca.Inference, "forecast", forecast)
    done = command("infer", "tip.csv", "--scene", "tip.toml", "--predict", "load=1 N")
    assert (done.status, done.err.splitlines()[-1]) == (2, "chemage: load: too large")
    assert not Path("tip-inferred.h5").exists()


def test_data_that_no_density_explains_come_with_the_best_fit(command, folder, monkeypatch):
    def infer(curves, scene, **how):
        size = curves[0].hold_times.size
        lines = {"energies": np.ones(2), "density": np.ones(2), "fitted": np.ones(size), "residuals": np.ones(size)}
        raise ca.plugin.UnexplainedError("values: no density of barriers explains them", chi2=99.0, **lines)

    faults.infer_by(monkeypatch, infer)
    done = command("infer", "tip.csv", "--scene", "tip.toml")
    assert done.status == 2
    assert done.err.count("+1.0") == 25
    assert done.err.splitlines()[-1] == "chemage: values: no density of barriers explains them"
    assert "the best fit" not in command("infer", "tip.csv", "--scene", "tip.toml", "--quiet").err


WRONG = {
    "no scene": ([], "--scene"),
    "unknown word": (["--predict", "lod=5 nN"], "--predict = 'lod': is not known"),
    "no value": (["--predict", "load"], "write it as NAME=VALUE"),
    "wrong unit": (["--predict", "load=5 K"], "5 K"),
    "negative": (["--predict", "temperature=-3"], "--predict.temperature = -3.0: must be above zero"),
    "given twice": (["--predict", "load=5, load=6"], "load is given twice"),
    "backward range": (["--predict", "hold_time=1 s to 1 ms"], "hold_time=1 s to 1 ms"),
    "no hold time": (["--next", "load=5 nN"], "give a hold time"),
    "no percentage": (["--next", "hold_time=1 s, error=x %"], '--next.error: "x %" cannot be read'),
    "negative percentage": (["--next", "hold_time=1 s, error=-3 %"], "--next.error = '-3 %': must be above zero"),
    "no file": (["--next", "plan.csv"], "plan.csv"),
    "target without plans": (["--target", "energy=1.0 eV"], "--next"),
    "half a target": (["--next", "hold_time=1 s", "--target", "load=5 nN"], "--target = {'load': '5 nN'}: is neither"),
    "bounds": (["--unknown", "bond_force=1 nN"], "LOW to HIGH"),
    "mixed bounds": (["--unknown", "bond_force", "--unknown", "activation_volume=0 nm**3 to 1 nm**3"], "for none"),
    "relative error": (["--relative-error", "3"], "between 0 and 1"),
    "ending": (["-o", "x.csv"], "x.csv"),
    "load given twice": (["--load", "5 nN"], "load"),
    "missing scene": (["--predict", "scene=nothing"], "nothing"),
}


@pytest.mark.parametrize(("words", "says"), WRONG.values(), ids=WRONG)
def test_wrong_options_are_one_clear_message_before_anything_is_computed(command, folder, made_up, words, says):
    scene = [] if says == "--scene" else ["--scene", "tip.toml"]
    done = command("infer", "tip.csv", *scene, *words)
    assert done.status == 2
    assert says in done.err
    assert "Traceback" not in done.err
    assert not made_up
    assert sorted(path.name for path in folder.iterdir()) == ["tip.csv", "tip.toml"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("hold_time (s), error (%)\n1,-3\n", "must be above zero"),
        ("hold_time (s), load (nN)\n", "no planned measurements"),
        ("load (nN)\n5\n", "no column hold_time"),
        ("hold_time (s), laod (nN)\n1,2\n", "column 2"),
        ("hold_time (ms)\n-1\n", "must be above zero"),
    ],
)
def test_wrong_plans_in_a_file_are_one_clear_message(command, folder, made_up, text, says):
    (folder / "plan.csv").write_text(text)
    done = command("infer", "tip.csv", "--scene", "tip.toml", "--next", "plan.csv")
    assert done.status == 2
    assert says in done.err
    assert "plan.csv" in done.err
    assert "Traceback" not in done.err
    assert not made_up


def test_wrong_measurements_are_one_clear_message(command, folder, made_up):
    Path("bad.csv").write_text(HEADER + "1, 5, 0, 20, 300\n50, 6, 1, 20, 300\n", encoding="utf-8")
    done = command("infer", "bad.csv", "--scene", "tip.toml")
    assert done.status == 2
    assert "bad.csv, line 2, column error: 0: a standard error must be above zero" in done.err
    assert not made_up


def test_columns_that_a_file_lacks_are_given_as_options(command, folder, made_up):
    Path("bare.csv").write_text("hold_time (s), friction_drop (nN)\n0.1, 3\n10, 5\n1e3, 8\n", encoding="utf-8")
    words = ["--load", "20 nN", "--temperature", "300 K", "--relative-error", "3 %", "--no-figures"]
    done = command("infer", "bare.csv", "--scene", "tip.toml", *words)
    assert done.status == 0, done.err
    (curve,) = made_up["curves"]
    assert (curve.load, curve.temperature) == (20, 300)
    assert curve.errors == pytest.approx(0.03 * curve.values)


def test_what_is_inferred_of_the_errors_is_asked_for(command, folder, made_up):
    words = ["--errors", "scaled, correlated", "--calibration", "force=10 %, load=5 %", "--no-figures"]
    done = command("infer", "tip.csv", "--scene", "tip.toml", *words)
    assert done.status == 0, done.err
    assert made_up["errors"] == ["scaled", "correlated"]
    assert made_up["calibration"] == {"force": "10 %", "load": "5 %"}


def test_the_residuals_of_refused_data_are_drawn(command, folder, monkeypatch):
    def infer(curves, scene, **how):
        size = curves[0].hold_times.size
        lines = {"energies": np.ones(2), "density": np.ones(2), "fitted": np.ones(size), "residuals": np.ones(size)}
        raise ca.plugin.UnexplainedError("values: no density of barriers explains them", chi2=99.0, **lines)

    faults.infer_by(monkeypatch, infer)
    done = command("infer", "tip.csv", "--scene", "tip.toml")
    assert "residuals of the best fit: tip-inferred-figures/residuals.png" in done.err
    assert Path("tip-inferred-figures/residuals.png").is_file()


@pytest.mark.campaign
def test_a_plan_is_calibrated(command, folder, monkeypatch):
    inferring.fewer_sweeps(monkeypatch)
    done = command("infer", "tip.csv", "--scene", "tip.toml", "--calibrate", 10, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)["quantities"]
    assert set(found) >= {"scale of the errors", "friction drop at 1e+05 s"}
    assert all(len(one["ranks"]) == 10 and 0 <= min(one["ranks"]) < max(one["ranks"]) <= 1 for one in found.values())
    assert not Path("tip-inferred.h5").exists()


@pytest.mark.long
def test_the_whole_command_on_a_tip(command, folder):
    words = ["--predict", "load=50 nN, hold_time=10 s", "--next", "hold_time=1e-3 s to 1e7 s", "--samples", 200]
    done = command("infer", "tip.csv", "--scene", "tip.toml", "--families", "none", *words)
    assert done.status == 0, done.err
    shown = json.loads(command("show", "tip-inferred.h5", "--json").out)
    low, high = shown["visible_range"]
    assert 0.5 < low < high < 1.3
    assert len(shown["experiments"]) == 11
    (forecast,) = shown["forecasts"]
    assert forecast["load"] == 50
    scene = ca.load_scene("tip.toml", {"forming": {"kind": "inferred", "path": "tip-inferred.h5"}})
    run = ca.run(scene, warn=False)
    assert "barriers" in run.ageing.errors


def test_the_offset_of_whole_friction_and_the_sheet_are_options(command, folder, made_up):
    Path("whole.csv").write_text("t (s);F (nN);error (nN)\n0.1;13;1\n10;15;1\n1e3;18;1\n", encoding="utf-8")
    words = ["infer", "whole.csv", "--scene", "tip.toml", "--load", "20 nN", "--temperature", "300 K", "--no-figures"]
    asked = command(*words)
    assert asked.status == 2
    assert "is the whole friction" in asked.err
    assert "--offset first" in asked.err
    assert "has no sheets" in command(*words, "--sheet", "wet").err
    done = command(*words, "--offset", "10 nN")
    assert done.status == 0, done.err
    assert made_up["curves"][0].values.tolist() == [3, 5, 8]
