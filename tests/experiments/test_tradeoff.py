"""Speed against accuracy is measured, not asserted: errors fall along each knob, and what cannot run is said."""

import json
import math

import numpy as np
import pytest

import chemage as ca
from chemage.cli.app import main
from chemage.experiments.tradeoff import Row, Tradeoff, l2_error, measured, relative, tradeoff
from chemage.reports.tradeoff_figure import figure

SMALL = {"surface.pixels": 128, "surface.zeta": 16, "contact.load": "200 nN", "hold.replicas": 3, "hold.per_decade": 2}


@pytest.fixture(scope="module")
def found() -> Tradeoff:
    return tradeoff(ca.load_scene("silica-rough", SMALL))


def rows(found: Tradeoff, knob: str) -> list[Row]:
    return [row for row in found.rows if row.knob == knob]


def test_tighter_tolerance_is_more_accurate(found: Tradeoff):
    errors = {float(row.setting): row.pressure_error for row in rows(found, "contact.tolerance")}
    loose, usual, tight = errors[1e-3], errors[1e-5], errors[1e-8]
    assert loose > 10 * usual > 100 * tight
    assert errors[min(errors)] < 1e-8


def test_every_knob_the_solver_declares_is_turned(found: Tradeoff):
    scene = ca.load_scene("silica-rough", SMALL)
    for option, values in scene.contact.trade.items():
        assert [row.setting for row in rows(found, f"contact.{option}")] == [str(value) for value in values]
        assert sum(row.own for row in rows(found, f"contact.{option}")) == 1


def test_a_coarser_grid_samples_the_same_surface(found: Tradeoff):
    settings = [row.setting for row in rows(found, "surface.pixels")]
    assert settings == ["64 x 64", "128 x 128"]  # 32 pixels would be two to the shortest wave
    scene = ca.load_scene("silica-rough", SMALL)
    coarse = scene.surface.coarser(2)
    assert coarse is not None
    fine = scene.surface.make(scene.surface_seed)
    again = coarse.make(scene.surface_seed)
    np.testing.assert_allclose(again.heights, fine.heights[::2, ::2], atol=1e-9)


def test_exact_engines_agree_and_the_closed_form_is_refused(found: Tradeoff):
    engines = {row.setting: row for row in rows(found, "engine")}
    assert engines["independent"].remark == "not for this lattice"
    assert math.isnan(engines["independent"].cpu_seconds)
    own = engines["rejection-free"]
    for kind in ("bkl", "next-reaction"):
        spread = math.hypot(engines[kind].beta_stderr, own.beta_stderr)
        assert abs(engines[kind].beta - own.beta) < 5 * spread


def test_contact_mechanics_alone_has_no_engines():
    changes = dict.fromkeys(("forming", "breaking", "interaction", "chemistry", "engine", "hold", "fit", "observe"))
    found = tradeoff(
        ca.load_scene("silica-rough", {**SMALL, "hold.replicas": None, "hold.per_decade": None, **changes})
    )
    assert {row.knob for row in found.rows} == {"contact.precision", "contact.tolerance", "surface.pixels"}


def test_a_solver_without_knobs_is_measured_by_engines_and_replicas():
    found = tradeoff(ca.load_scene("silica-tip", {"hold.replicas": 3, "hold.per_decade": 2}))
    assert "hold.replicas" in {row.knob for row in found.rows}
    assert not rows(found, "contact.tolerance")


def test_error_measures():
    assert relative(1.1, 1.0) == pytest.approx(0.1)
    assert math.isnan(relative(1.0, 0.0))
    assert l2_error(np.array([[3.0, 4.5]], np.float32), np.array([[3.0, 4.0]])) == pytest.approx(0.1)
    assert math.isnan(l2_error(np.zeros((2, 2)), np.zeros((2, 2))))
    result, cpu, wall = measured(lambda: sum(range(200_000)))
    assert result == 19999900000
    assert 0 < cpu < 10
    assert wall > 0


def test_figure_has_a_panel_for_each_knob_with_an_error(found: Tradeoff):
    titles = [axes.get_title() for axes in figure(found).axes]
    assert titles[:2] == ["contact.precision", "contact.tolerance"]
    assert "hold.replicas" in titles
    assert figure(Tradeoff("empty")).axes


def test_command_line(tmp_path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    arguments = ["tradeoff", "silica-tip", "--set", "hold.replicas=2", "--set", "hold.per_decade=2"]
    monkeypatch.setattr("sys.argv", ["chemage", *arguments, "--json", "--out", "trade.svg"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["scene"] == "silica-tip"
    assert (tmp_path / "trade.svg").read_text().startswith("<?xml")
    monkeypatch.setattr("sys.argv", ["chemage", *arguments, "--out", "trade.svg"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "already there" in capsys.readouterr().err
