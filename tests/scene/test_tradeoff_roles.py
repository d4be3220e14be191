"""Speed against accuracy of third-party components of every role, and of components inside components."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import pytest

import chemage as ca
from chemage.plugin import Choice, Length
from chemage.results.tradeoff_figure import figure
from chemage.studies.trade.settings import MOST_VALUES, planned, settings
from chemage.studies.trade.tradeoff import l2_error, tradeoff

#: methods that first make a table are left out
pytestmark = pytest.mark.usefixtures("without_preparation")


class Grained(ca.plugin.SurfaceMaker):
    """A sphere whose heights are multiples of a grain."""

    kind = "grained"
    trade: ClassVar[Any] = {"grain": (0.1, 0.01, 0.001)}
    grain: Length = 0.01
    """nm"""

    def make(self, seed=0):
        smooth = ca.surface("sphere", radius="20 nm", pixels=32, pixel_size="0.4518 nm").make()
        heights = np.round(smooth.heights / self.grain) * self.grain
        return ca.Surface(heights=heights, pixel_size=smooth.pixel_size)


class Stepped(ca.plugin.Barriers):
    """Barriers between 0.8 and 1.2 eV at so many levels."""

    kind = "stepped"
    trade: ClassVar[Any] = {"levels": (2, 8, 512)}
    levels: int = 8
    """number of levels"""

    def quantile(self, uniform):
        return 0.8 + 0.4 * (np.floor(np.asarray(uniform) * self.levels) + 0.5) / self.levels

    def density(self, energy):
        return np.where((energy >= 0.8) & (energy <= 1.2), 2.5, 0.0)


class Rounded(ca.plugin.Interaction):
    """Elastic pairs whose couplings are rounded to so many decimal digits."""

    kind = "rounded"
    trade: ClassVar[Any] = {"digits": (0, 1, 6)}
    digits: int = 6
    """digits after the point, eV"""

    def neighbours(self, pixels, periodic, sites):
        return self._pairs().neighbours(pixels, periodic, sites)

    def coupling(self, sites, neighbours, seed):
        return np.round(self._pairs().coupling(sites, neighbours, seed), self.digits)

    @staticmethod
    def _pairs():
        return ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1)


class Thinned(ca.plugin.Engine):
    """Runs an exact engine and keeps the bonds to a multiple of ``grain``."""

    kind = "thinned"
    exact = False
    declared_error: ClassVar[float | None] = 0.5
    trade: ClassVar[Any] = {"grain": (4, 2, 1)}
    grain: int = 4
    """bonds"""

    def _run(self, lattice, hold_times, temperature, seed, start):
        exact = ca.engine("rejection-free").run(lattice, hold_times, temperature=temperature, seed=seed, start=start)
        bonds = exact.bonds // self.grain * self.grain
        return exact.model_copy(update={"bonds": bonds, "formed": bonds + exact.broken, "engine": self.kind})


class Within(ca.plugin.ContactSolver):
    """Another solver does the work."""

    kind = "within"
    inner: Choice[ca.plugin.ContactSolver]
    """the solver"""

    def _solve(self, surface, load, start):
        return self.inner.solve(surface, load, start=start)


class Seen(ca.plugin.Observable):
    """Bonds at the end."""

    kind = "seen"
    trade: ClassVar[Any] = {"parts": (1, 2)}
    parts: int = 1
    """of what"""

    def measure(self, contact, lattice, history):
        return {"seen": float(history.bonds[-1]) / self.parts}


SCENE = {
    "name": "third-party",
    "surface": {"kind": "grained"},
    "contact": {"kind": "within", "inner": {"kind": "fft-bem", "modulus": "35.3 GPa"}, "load": "40 nN"},
    "forming": {"kind": "stepped"},
    "interaction": {"kind": "rounded"},
    "engine": {"kind": "thinned"},
    "hold": {"start": "1 ms", "stop": "1e5 s", "per_decade": 2, "replicas": 4, "seed": 3},
    "observe": [{"kind": "seen"}],
}


@pytest.fixture(scope="module", autouse=True)
def third_party():
    classes = (Grained, Stepped, Rounded, Thinned, Within, Seen)
    for cls in classes:
        ca.register(cls)
    yield
    for cls in classes:
        ca.unregister(cls)


@pytest.fixture(scope="module")
def scene():
    return ca.parse_scene(SCENE)


@pytest.fixture(scope="module")
def reports():
    return []


@pytest.fixture(scope="module")
def found(scene, reports):
    return tradeoff(scene, rounds=1, report=reports.append)


def rows(found, option):
    return [row for row in found.rows if row.option == option]


TRADED = {
    "surface.grain": (0.1, 0.01, 0.001),
    "forming.levels": (2, 8, 512),
    "interaction.digits": (0, 1, 6),
    "engine.grain": (4, 2, 1),
}


@pytest.mark.parametrize("option", TRADED)
def test_every_option_of_every_role_is_tried(found, option):
    measured = rows(found, option)
    assert [row.setting for row in measured] == [str(value) for value in TRADED[option]]
    assert sum(row.own for row in measured) == 1
    assert all(row.cpu_seconds >= 0 and row.wall_seconds > 0 for row in measured)
    assert all(math.isfinite(row.beta) for row in measured)
    section = option.partition(".")[0]
    assert any(note.startswith(f"{section}: differences are those from a reference") for note in found.notes)


def test_an_option_of_a_component_inside_a_component_is_tried(found, scene):
    surface, solver = scene.surface.make(), scene.contact.inner
    best = solver.reference().solve(surface, scene.load)
    inner = rows(found, "contact.inner.tolerance")
    assert [float(row.setting) for row in inner] == list(solver.trade["tolerance"])
    assert [row.own for row in inner].count(True) == 1
    for row in inner[:3]:
        one = solver.replace(tolerance=float(row.setting)).solve(surface, scene.load)
        assert row.pressure_error == pytest.approx(l2_error(one.pressure, best.pressure), rel=1e-6)
    assert any("inner.tolerance = 1e-12" in note for note in found.notes)


def test_errors_of_a_surface_are_differences_from_its_most_accurate_setting(found, scene):
    def area(grain):
        return ca.solve_contact(scene.contact, Grained(grain=grain).make(), scene.load).corrected_area

    coarse, own, finest = rows(found, "surface.grain")
    assert coarse.area_error == pytest.approx(abs(area(0.1) / area(0.001) - 1))
    assert own.area_error == pytest.approx(abs(area(0.01) / area(0.001) - 1), abs=1e-12)
    assert math.isnan(finest.area_error)
    assert coarse.pressure_error > own.pressure_error > 0


def betas(scene, **changes):
    """β of each replica with all random numbers in common."""
    contact = ca.solve_contact(scene.contact, scene.surface.make(), scene.load)
    chemistry, engine = scene.chemistry, changes.pop("engine", scene.engine)
    aging = ca.age(
        contact,
        chemistry.replace(**changes),
        engine=engine,
        hold_times=scene.hold.hold_times,
        temperature=300,
        replicas=4,
        seed=3,
        common="all",
    )
    use = (aging.hold_times >= 10 * (1 - 1e-9)) & (aging.hold_times <= 1e4 * (1 + 1e-9))
    return np.polyfit(np.log10(aging.hold_times[use]), aging.friction_coefficient_drop[:, use].T, 1)[0]


@pytest.mark.parametrize(
    ("option", "make", "part", "best"),
    [
        ("forming.levels", Stepped, "forming", 512),
        ("interaction.digits", Rounded, "interaction", 6),
        ("engine.grain", Thinned, "engine", 1),
    ],
)
def test_differences_of_beta_are_paired(found, scene, option, make, part, best):
    name = option.partition(".")[2]
    reference = betas(scene, **{part: make(**{name: best})})
    for row in rows(found, option):
        each = betas(scene, **{part: make(**{name: int(row.setting)})}) - reference
        assert row.beta_difference == pytest.approx(each.mean(), rel=1e-6, abs=1e-12)
        assert row.beta_difference_stderr == pytest.approx(each.std(ddof=1) / 2, rel=1e-6, abs=1e-12)
    assert rows(found, option)[-1].beta_difference == 0


def test_approximate_settings_are_marked(found):
    for row in [*rows(found, "engine.grain"), *(row for row in rows(found, "engine") if row.setting == "thinned")]:
        assert "approximate: thinned (declared error 50 % of the mean number of bonds)" in row.remark


def test_an_option_of_an_observable_is_left_out_with_a_sentence(found):
    assert not rows(found, "observe.0.parts")
    assert any(note.startswith("observe.0.parts: not tried") for note in found.notes)


def test_the_cost_is_said_before(scene, found, reports):
    assert planned(scene) in reports[0]
    # two options of the solver inside, one of the surface, three values or more each, and a reference each
    contacts = int(planned(scene).split()[0])
    ageings = int(planned(scene).split()[3])
    computed = sum(row.option.startswith(("contact", "surface")) for row in found.rows)
    assert contacts >= computed
    assert ageings >= sum(math.isfinite(row.beta) for row in found.rows)


def test_few_of_many_values_are_tried():
    class Many(Stepped):
        kind = "many"
        trade: ClassVar[Any] = {"levels": tuple(range(1, 101))}

    ca.register(Many)
    made = ca.parse_scene({**SCENE, "forming": {"kind": "many", "levels": 37}})
    ca.unregister(Many)
    (one,) = [setting for setting in settings(made) if setting.name == "forming.levels"]
    assert len(one.values) == MOST_VALUES
    assert one.named == 100
    assert {1, 37, 100} <= set(one.values)
    assert list(one.values) == sorted(one.values)


def test_a_setting_that_is_refused_has_its_reason():
    class Refusing(Stepped):
        kind = "refusing"

        def quantile(self, uniform):
            if self.levels == 2:
                raise ca.InputError("two levels are too few")
            return super().quantile(uniform)

    ca.register(Refusing)
    changes = {"contact": {"kind": "fft-bem", "modulus": "35.3 GPa", "load": "40 nN"}, "observe": []}
    plain = {**SCENE, **changes, "forming": {"kind": "refusing"}, "hold": {**SCENE["hold"], "replicas": 2}}
    try:
        few = tradeoff(ca.parse_scene(plain), rounds=1)
    finally:
        ca.unregister(Refusing)
    first, *others = rows(few, "forming.levels")
    assert first.remark == "two levels are too few"
    assert math.isnan(first.cpu_seconds)
    assert all(math.isfinite(row.beta) for row in others)


def test_contact_mechanics_alone_says_that_the_rest_is_not_tried():
    data = {name: part for name, part in SCENE.items() if name in ("name", "surface", "contact")}
    found = tradeoff(ca.parse_scene(data), rounds=1)
    assert {row.option.partition(".")[0] for row in found.rows} == {"surface", "contact"}


def test_options_of_every_role_are_in_the_map(found):
    knobs = {knob for point in found.map.points for knob in point.choices}
    assert {"forming.levels", "engine.grain", "surface.grain", "interaction.digits"} <= knobs
    assert "contact.inner.tolerance" in knobs
    assert figure(found.map).axes
