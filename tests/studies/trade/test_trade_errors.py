"""Speed against accuracy: the errors are the true ones or not known, and what cannot run is said."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from independent_contact import Body
from scipy.stats import wasserstein_distance
from seen import figures

import chemage as ca
from chemage.plugin import TradePoint
from chemage_contact import FFTBEM

pytestmark = pytest.mark.usefixtures("few_choices")

SMALL = {"surface.pixels": 128, "surface.zeta": 16, "contact.load": "200 nN", "hold.replicas": 3, "hold.per_decade": 2}
CONTACT_ONLY = {name: value for name, value in SMALL.items() if not name.startswith("hold")} | dict.fromkeys(
    ("forming", "breaking", "interaction", "chemistry", "engine", "hold", "fit", "observe")
)
MODULUS = 35.3


@pytest.fixture(scope="module")
def found() -> ca.Tradeoff:
    return ca.tradeoff(ca.load_scene("silica-rough", SMALL), rounds=1)


def singles(found: ca.Tradeoff, option: str) -> dict[str, TradePoint]:
    """The points that differ from the scene in this option alone: value -> point."""
    return {one.choices[option]: one for one in found.points if set(one.choices) == {option}}


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


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """Wasserstein distance of the pressures above zero over their mean."""
    return float(wasserstein_distance(one[one > 0], other[other > 0]) / other[other > 0].mean())


@pytest.mark.long
def test_errors_of_the_contact_are_the_true_ones(found: ca.Tradeoff):
    """Against a dense solve that is independent of the project: every error, the smallest included."""
    scene = ca.load_scene("silica-rough", SMALL)
    surface = scene.surface.make(scene.surface_seed)
    tight = scene.contact.replace(tolerance=1e-11, precision="double").solve(surface, scene.load)
    truth = exact_pressure(surface, scene.load, tight.contact)
    for option in scene.contact.trade:
        for value, point in singles(found, f"contact.{option}").items():
            options = {option: value if option == "precision" else float(value)}
            contact = scene.contact.replace(**options).solve(surface, scene.load)
            area = contact.corrected_area / tight.corrected_area - 1
            assert point.deviation("corrected_area").value == pytest.approx(area, rel=1e-6, abs=1e-12)
            apart = point.deviation("pressure_distribution").value
            assert apart == pytest.approx(distance(contact.pressure, truth), rel=0.1), options


def test_every_option_the_solver_declares_is_varied(found: ca.Tradeoff):
    scene = ca.load_scene("silica-rough", SMALL)
    for option, values in scene.contact.trade.items():
        others = {str(value) for value in values if value != getattr(scene.contact, option)}
        assert singles(found, f"contact.{option}").keys() == others


class Unsolved(FFTBEM):
    """A solver whose reference fails."""

    kind = "unsolved"

    def reference(self) -> FFTBEM:
        return self.replace(max_iterations=0, tolerance=1e-12, precision="double", on_failure="raise")


def test_without_a_reference_errors_are_differences_from_the_scene():
    with registered(Unsolved):
        found = ca.tradeoff(ca.load_scene("silica-rough", {**CONTACT_ONLY, "contact.kind": "unsolved"}), rounds=1)
    (note,) = [note for note in found.notes if note.startswith("no reference, so that errors are differences")]
    assert "iteration limit" in note
    assert found.own is not None
    assert found.own.deviation("corrected_area").value == 0
    json.dumps(found.summary(), allow_nan=False)


@contextmanager
def registered(cls: type[FFTBEM]) -> Iterator[None]:
    ca.register(cls)
    yield
    ca.unregister(cls)


@pytest.mark.long
def test_one_replica_has_differences_without_errors():
    found = ca.tradeoff(ca.load_scene("silica-rough", {**SMALL, "hold.replicas": 1}), rounds=1)
    for point in singles(found, "contact.tolerance").values():
        assert math.isfinite(point.deviation("beta").value)
        assert math.isnan(point.deviation("beta").half_width)


def test_a_coarser_grid_samples_the_same_surface(found: ca.Tradeoff):
    assert singles(found, "grid of the contact").keys() == {"2 times coarser"}  # 32 pixels: two to the shortest wave
    scene = ca.load_scene("silica-rough", SMALL)
    coarse = scene.surface.coarser(2)
    assert coarse is not None
    fine = scene.surface.make(scene.surface_seed)
    again = coarse.make(scene.surface_seed)
    np.testing.assert_allclose(again.heights, fine.heights[::2, ::2], atol=1e-9)


def test_exact_engines_agree_and_the_closed_form_is_refused(found: ca.Tradeoff):
    engines = singles(found, "engine")
    assert "independent" not in engines
    assert any(note.startswith("engine independent: not tried") for note in found.notes)
    for kind in ("bkl", "next-reaction"):
        deviation = engines[kind].deviation("beta")
        assert engines[kind].exact
        assert abs(deviation.value) <= deviation.half_width


def test_contact_mechanics_alone_has_no_engines():
    found = ca.tradeoff(ca.load_scene("silica-rough", CONTACT_ONLY), rounds=1)
    knobs = {knob for one in found.points for knob in one.choices}
    assert knobs == {"contact.precision", "contact.tolerance", "grid of the contact"}


def test_the_figure_has_a_panel_for_each_observable(found: ca.Tradeoff):
    titles = [" ".join(axes.get_title().split()) for axes in figures(found)["trade"].axes]
    assert titles[0] == "β"
    assert titles[-4:] == [
        "corrected contact area",
        "distribution of pressure",
        "number of patches",
        "perimeter over area",
    ]


@pytest.mark.long
def test_command_line(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    arguments = ["tradeoff", "silica-tip", "--set", "hold.replicas=2", "--set", "hold.per_decade=2"]
    done = command(*arguments, "--rounds", 1, "--json", "--out", "trade.svg")
    assert done.status == 0
    printed = json.loads(done.out)
    assert printed["scene"] == "silica-tip"
    assert (tmp_path / "trade.svg").read_text().startswith("<?xml")
    done = command(*arguments, "--out", "trade.svg")
    assert done.status == 2
    assert "already there" in done.err
