"""Speed against accuracy: the errors are the true ones or not known, and what cannot run is said."""

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import chemage as ca
from chemage.cli.app import main
from chemage.results.tradeoff_figure import figure
from chemage.studies.trade.tradeoff import Row, Tradeoff, l2_error, measured, relative, tradeoff
from chemage_contact import FFTBEM

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))
from independent_contact import Body

#: methods that first make a table are left out
pytestmark = pytest.mark.usefixtures("without_preparation")

SMALL = {"surface.pixels": 128, "surface.zeta": 16, "contact.load": "200 nN", "hold.replicas": 3, "hold.per_decade": 2}
CONTACT_ONLY = {name: value for name, value in SMALL.items() if not name.startswith("hold")} | dict.fromkeys(
    ("forming", "breaking", "interaction", "chemistry", "engine", "hold", "fit", "observe")
)
MODULUS = 35.3


@pytest.fixture(scope="module")
def found() -> Tradeoff:
    return tradeoff(ca.load_scene("silica-rough", SMALL), rounds=1)


def rows(found: Tradeoff, option: str) -> list[Row]:
    return [row for row in found.rows if row.option == option]


def exact_pressure(surface: ca.Surface, load: float, pixels: np.ndarray) -> np.ndarray:
    """The pressure (nx, ny) GPa of a contact of these pixels by a dense solve with its own Green's function."""
    body = Body(MODULUS, surface.pixel_size)
    unit = np.zeros(surface.shape)
    unit[0, 0] = 1.0
    response = body.displacement(unit)
    i, j = np.nonzero(pixels)
    inside = response[(i[:, None] - i) % surface.shape[0], (j[:, None] - j) % surface.shape[1]]
    system = np.ones((i.size + 1, i.size + 1))
    system[:-1, :-1], system[-1, -1] = inside / response[0, 0], 0.0
    heights = surface.heights[i, j] - surface.heights.max()
    solution = np.linalg.solve(system, np.append(heights / response[0, 0], load / surface.pixel_size**2))
    pressure = np.zeros(surface.shape)
    pressure[i, j] = solution[:-1]
    gap = body.displacement(pressure) - surface.heights
    gap -= gap[pixels].mean()
    assert pressure.min() >= 0
    assert gap[~pixels].min() > 0, "these are not the pixels in contact"
    return pressure


@pytest.mark.long
def test_errors_of_the_contact_are_the_true_ones(found: Tradeoff):
    """Against a dense solve that is independent of the project: every error, the smallest included."""
    scene = ca.load_scene("silica-rough", SMALL)
    surface = scene.surface.make(scene.surface_seed)
    tight = scene.contact.replace(tolerance=1e-11, precision="double").solve(surface, scene.load)
    truth = exact_pressure(surface, scene.load, tight.contact)
    for option, values in scene.contact.trade.items():
        for value, row in zip(values, rows(found, f"contact.{option}"), strict=True):
            contact = scene.contact.replace(**{option: value}).solve(surface, scene.load)
            assert row.pressure_error == pytest.approx(l2_error(contact.pressure, truth), rel=0.1), row
            assert row.area_error == pytest.approx(
                abs(contact.corrected_area / tight.corrected_area - 1), rel=1e-6, abs=1e-12
            )
            assert row.pressure_error / 3 < row.pressure_estimate < row.pressure_error * 3


def test_tighter_tolerance_is_more_accurate(found: Tradeoff):
    errors = {float(row.setting): row.pressure_error for row in rows(found, "contact.tolerance")}
    loose, usual, tight = errors[1e-3], errors[1e-5], errors[1e-8]
    assert loose > 10 * usual > 100 * tight
    assert errors[min(errors)] < 1e-8


def test_every_option_the_solver_declares_is_varied(found: Tradeoff):
    scene = ca.load_scene("silica-rough", SMALL)
    for option, values in scene.contact.trade.items():
        assert [row.setting for row in rows(found, f"contact.{option}")] == [str(value) for value in values]
        assert sum(row.own for row in rows(found, f"contact.{option}")) == 1


class Plain(FFTBEM):
    """A solver that neither has a reference of its own nor estimates its error."""

    kind = "plain"
    reference = ca.plugin.ContactSolver.reference

    def _solve(self, surface: ca.Surface, load: float, start: ca.ContactSolution | None) -> ca.ContactSolution:
        return super()._solve(surface, load, start).model_copy(update={"convergence": {}})


class Unsolved(FFTBEM):
    """A solver whose reference fails."""

    kind = "unsolved"

    def reference(self) -> FFTBEM:
        return self.replace(max_iterations=0, tolerance=1e-12, precision="double", on_failure="raise")


@pytest.fixture(params=[Plain, Unsolved])
def solver(request: pytest.FixtureRequest) -> Iterator[type[FFTBEM]]:
    ca.register(request.param)
    yield request.param
    ca.unregister(request.param)


def test_an_error_without_a_better_reference_is_unknown(solver: type[FFTBEM]):
    """It used to be the difference from a contact that is no better."""
    found = tradeoff(ca.load_scene("silica-rough", {**CONTACT_ONLY, "contact.kind": solver.kind}), rounds=1)
    for option in ("contact.tolerance", "contact.precision"):
        *others, last = rows(found, option)
        assert math.isnan(last.pressure_error)
        assert math.isnan(last.area_error)
        if solver is Plain:
            assert all(row.pressure_error > 0 and math.isnan(row.pressure_estimate) for row in others)
            assert "error of the pressure is not known" in found.notes[0]
        else:
            assert all(math.isnan(row.pressure_error) and row.pressure_estimate > 0 for row in others)
            assert "no reference" in found.notes[0]
            assert "iteration limit" in found.notes[0]
    json.dumps(found.todict(), allow_nan=False)


def test_differences_of_beta_are_paired(found: Tradeoff):
    """Settings of the contact share everything with the reference, engines their disorder."""
    scene = ca.load_scene("silica-rough", SMALL)
    assert scene.chemistry is not None
    assert scene.hold is not None
    surface = scene.surface.make(scene.surface_seed)

    def betas(solver: Any, engine: str, common: Any) -> np.ndarray:
        aging = ca.age(
            solver.solve(surface, scene.load),
            scene.chemistry,
            engine=ca.engine(engine),
            hold_times=scene.hold.hold_times,
            temperature=scene.hold.temperature,
            replicas=scene.hold.replicas,
            seed=scene.hold.seed,
            common=common,
        )
        use = (aging.hold_times >= 10 * (1 - 1e-9)) & (aging.hold_times <= 1e4 * (1 + 1e-9))
        drop = aging.friction_coefficient_drop[:, use]
        return np.polyfit(np.log10(aging.hold_times[use]), drop.T, 1)[0]

    reference = betas(scene.contact.reference(), "rejection-free", "all")
    for row in rows(found, "contact.tolerance"):
        each = betas(scene.contact.replace(tolerance=float(row.setting)), "rejection-free", "all") - reference
        assert row.beta_difference == pytest.approx(each.mean(), rel=1e-6, abs=1e-12)
        assert row.beta_difference_stderr == pytest.approx(each.std(ddof=1) / math.sqrt(3), rel=1e-6, abs=1e-12)
    own = betas(scene.contact, "rejection-free", "disorder")
    for row in rows(found, "engine"):
        if row.setting in ("bkl", "next-reaction"):
            each = betas(scene.contact, row.setting, "disorder") - own
            assert row.beta_difference == pytest.approx(each.mean(), rel=1e-6)
            assert row.beta_difference_stderr == pytest.approx(each.std(ddof=1) / math.sqrt(3), rel=1e-6)


def test_one_replica_has_differences_without_errors():
    found = tradeoff(ca.load_scene("silica-rough", {**SMALL, "hold.replicas": 1}), rounds=1)
    for row in rows(found, "contact.tolerance"):
        assert math.isfinite(row.beta_difference)
        assert math.isnan(row.beta_difference_stderr)
        assert math.isnan(row.beta_difference_half_width)


@pytest.mark.long
def test_the_error_of_the_grid_is_estimated():
    """The own grid has an error as well: that of finer grids, which is computed here, within its uncertainty."""
    changes = {**CONTACT_ONLY, "surface.pixels": 256, "surface.pixel_size": "0.2259 nm"}
    scene = ca.load_scene("silica-rough", changes)
    found = rows(tradeoff(scene, rounds=1), "surface.pixels")
    assert [row.setting for row in found] == ["64 x 64", "128 x 128", "256 x 256"]
    maker = scene.surface.replace(pixels=(2048, 2048), pixel_size=scene.surface.pixel_size / 8)
    finest = scene.contact.solve(maker.make(scene.surface_seed), scene.load)
    truth = finest.corrected_area / finest.nominal_area
    for row in found:
        assert abs(row.area_error - abs(row.corrected_fraction / truth - 1)) < row.area_error_half_width
        assert row.area_error > 0
        assert 0 < row.area_error_stderr < 0.02
    assert found[-1].own


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
    assert math.isnan(own.beta_difference)
    for kind in ("bkl", "next-reaction"):
        assert engines[kind].beta_difference == pytest.approx(engines[kind].beta - own.beta)
        assert abs(engines[kind].beta_difference) < 5 * engines[kind].beta_difference_stderr


def test_contact_mechanics_alone_has_no_engines():
    found = tradeoff(ca.load_scene("silica-rough", CONTACT_ONLY), rounds=1)
    assert {row.option for row in found.rows} == {"contact.precision", "contact.tolerance", "surface.pixels"}


def test_a_solver_without_such_options_is_measured_by_engines_and_replicas():
    found = tradeoff(ca.load_scene("silica-tip", {"hold.replicas": 3, "hold.per_decade": 2}), rounds=1)
    assert "hold.replicas" in {row.option for row in found.rows}
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


def test_the_figure_has_a_panel_for_each_observable(found: Tradeoff):
    assert found.map is not None
    titles = [axes.get_title() for axes in figure(found.map).axes]
    assert titles[0] == "β"
    assert titles[-4:] == [
        "corrected contact area",
        "distribution of pressure",
        "number of patches",
        "perimeter over area",
    ]


def test_command_line(tmp_path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    arguments = ["tradeoff", "silica-tip", "--set", "hold.replicas=2", "--set", "hold.per_decade=2"]
    monkeypatch.setattr("sys.argv", ["chemage", *arguments, "--rounds", "1", "--json", "--out", "trade.svg"])
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
