"""Speed against accuracy of third-party components of every role, and of components inside components."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import pytest

import chemage as ca
from chemage.plugin import Choice, Length
from chemage_trade.mapping import planned
from chemage_trade.result import choices

pytestmark = pytest.mark.usefixtures("few_choices")


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
        state = exact.state.copy()
        state[np.flatnonzero(state)[bonds[-1] :]] = False
        kept = {"bonds": bonds, "formed": bonds + exact.broken, "state": state}
        return exact.model_copy(update={**kept, "engine": self.kind})


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
def found(scene):
    return ca.tradeoff(scene, rounds=1)


def singles(found, option):
    """The points that differ from the scene in this option alone: value -> point."""
    return {one.choices[option]: one for one in found.points if set(one.choices) == {option}}


TRADED = {
    "surface.grain": (0.1, 0.001),
    "forming.levels": (2, 512),
    "interaction.digits": (0, 1),
    "engine.grain": (2, 1),
    "contact.inner.tolerance": (1e-3, 1e-4, 1e-6, 1e-8, 1e-10),
}


@pytest.mark.parametrize("option", TRADED)
def test_every_option_of_every_role_is_tried(found, option):
    assert singles(found, option).keys() == {str(value) for value in TRADED[option]}


def test_errors_of_a_surface_are_differences_from_its_most_accurate_setting(found, scene):
    def area(grain):
        return scene.contact.inner.reference().solve(Grained(grain=grain).make(), scene.load).corrected_area

    coarse, finest = singles(found, "surface.grain").values()
    assert coarse.deviation("corrected_area").value == pytest.approx(area(0.1) / area(0.001) - 1, rel=1e-3)
    assert coarse.deviation("pressure_distribution").value > finest.deviation("pressure_distribution").value


def betas(scene, **changes):
    """β of each replica with all random numbers in common."""
    contact = ca.solve_contact(scene.contact, scene.surface.make(), scene.load)
    chemistry, engine = scene.chemistry, changes.pop("engine", scene.engine)
    ageing = ca.age(
        contact,
        chemistry.replace(**changes),
        engine=engine,
        hold_times=scene.hold.hold_times,
        temperature=300,
        replicas=4,
        seed=3,
        common="all",
    )
    use = (ageing.hold_times >= 10 * (1 - 1e-9)) & (ageing.hold_times <= 1e4 * (1 + 1e-9))
    return np.polyfit(np.log10(ageing.hold_times[use]), ageing.friction_coefficient_drop[:, use].T, 1)[0]


def test_differences_of_beta_are_paired(found, scene):
    """All parts of the reference are the most accurate; replica by replica with the same random numbers."""
    own = betas(scene)
    contact = Within(inner=scene.contact.inner.reference())
    best = betas(
        scene.model_copy(update={"surface": Grained(grain=0.001), "contact": contact}),
        forming=Stepped(levels=512),
        interaction=Rounded(digits=6),
        engine=Thinned(grain=1),
    )  # fmt: skip
    deviation = found.own.deviation("beta")
    assert deviation.value == pytest.approx((own - best).mean() / best.mean())
    # one surface: the scatter between replicas is not its error
    assert math.isnan(deviation.half_width) or deviation.stderr > 0


def test_approximate_settings_are_marked(found):
    assert all("thinned (declared error 50 %" in one.remark for one in singles(found, "engine.grain").values())


def test_an_option_of_an_observable_is_left_out_with_a_sentence(found):
    assert not singles(found, "observe.0.parts")
    assert any(note.startswith("observe.0.parts: not tried") for note in found.notes)


def test_the_cost_is_said_before(scene, found):
    contacts, _, _, ageings = planned(scene).split()[:4]
    alone = [one for one in found.points if len(one.choices) < 2]
    assert int(contacts) >= 1 + sum(one.contact_only for one in alone)
    assert int(ageings) >= len(alone)


def test_few_of_many_values_are_tried():
    class Many(Stepped):
        kind = "many"
        trade: ClassVar[Any] = {"levels": tuple(range(1, 101))}

    ca.register(Many)
    made = ca.parse_scene({**SCENE, "forming": {"kind": "many", "levels": 37}})
    ca.unregister(Many)
    notes: list[str] = []
    tried = choices(made, notes)
    values = [int(one.label) for one in tried if one.name == "forming.levels"]
    assert len(values) == 7  # and that of the scene
    assert {1, 100} <= set(values)
    assert values == sorted(values)
    assert "forming.levels: 8 of 100 values are tried" in notes


@pytest.mark.long
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
        few = ca.tradeoff(ca.parse_scene(plain), rounds=1)
    finally:
        ca.unregister(Refusing)
    assert singles(few, "forming.levels").keys() == {"512"}
    assert "forming.levels 2: two levels are too few" in few.notes


def test_contact_mechanics_alone_says_that_the_rest_is_not_tried():
    data = {name: part for name, part in SCENE.items() if name in ("name", "surface", "contact")}
    found = ca.tradeoff(ca.parse_scene(data), rounds=1)
    assert {knob.partition(".")[0] for one in found.points for knob in one.choices} == {"surface", "contact"}
