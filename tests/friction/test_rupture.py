"""From bonds to friction: the laws agree with closed forms, and whatever law is chosen is in keys, files and fits."""

from __future__ import annotations

import csv
import json
from typing import ClassVar

import numpy as np
import pytest

import chemage as ca
from chemage import InputError, compare_files, parse_scene
from chemage.plugin import PluginError, SceneError

KT = ca.plugin.KB * 300.0
EV_PER_NM = 0.1602176634  # nN


class Bell(ca.plugin.Rupture):
    """Each bond breaks at the force at which its barrier, lowered by force times length, lets it break at a rate."""

    kind = "bell-at-rate"
    states = True

    length: float = 0.1
    """distance from the bound state to the barrier, nm"""
    rate: float = 1e3
    """rate at which the bonds break during sliding, 1/s"""

    def force(self, bonded):
        lattice = bonded.lattice
        barriers = lattice.forming if lattice.breaking is None else lattice.breaking
        energy = barriers - ca.plugin.KB * bonded.temperature * np.log(lattice.attempt_frequency / self.rate)
        return bonded.states @ (np.maximum(energy, 0.0) * EV_PER_NM / self.length)


class Twice(ca.plugin.Rupture):
    """Twice the force of another law."""

    kind = "twice"

    inner: ca.plugin.Choice[ca.plugin.Rupture]
    """the law that is doubled"""

    def force(self, bonded):
        return 2.0 * self.inner.force(bonded)


class Wrong(ca.plugin.Rupture):
    """A law that returns what it is told to."""

    kind = "wrong"
    answer: ClassVar = None

    def force(self, bonded):
        return type(self).answer(bonded)


@pytest.fixture
def bell():
    with ca.plugin.registry.using(ca.plugin.registry.Registry()):
        for cls in (Bell, Twice, Wrong):
            ca.register(cls)
        yield Bell()


def contact(load: float = 50.0) -> ca.ContactSolution:
    tip = ca.surface("sphere", radius=30, pixels=48, pixel_size=0.4518).make()
    return ca.contact("hertz", modulus=35.3).solve(tip, load)


def chemistry(**options) -> ca.Chemistry:
    return ca.chemistry(**{"forming": ca.barriers("uniform", lower=0.7, upper=1.2), **options})


def aged(law=None, **options) -> ca.Ageing:
    fields = {"engine": ca.engine("rejection-free"), "temperature": 300, "replicas": 3, "seed": 2, "rupture": law}
    fields |= {"hold_times": ca.hold_times(1e-3, 1e4, 2), "chemistry": chemistry(), **options}
    return ca.age(contact(), **fields)


# -- physics ----------------------------------------------------------------------------------------------------------


def test_bell_with_one_barrier_is_the_number_of_bonds_times_its_force(bell):
    """f* = (E − k_BT ln(ν/k)) / x, the same for every bond."""
    one = chemistry(breaking=ca.barriers("gaussian", mean=1.1, std=0.0))
    made = aged(bell, chemistry=one)
    force = (1.1 - KT * np.log(1e13 / 1e3)) * EV_PER_NM / 0.1
    assert force == pytest.approx(0.8087, rel=1e-3)  # 0.505 eV over 0.1 nm
    np.testing.assert_allclose(made.friction_drop, made.bonds * force, rtol=1e-12)
    assert made.bonds[:, -1].min() > 50


def lattice_of_two(bonded: int) -> tuple[ca.ReactionLattice, ca.plugin.BondHistory]:
    """Sites with barriers of 1.0 and 1.3 eV in turn; first ``bonded`` of the weak ones form a bond, then all sites."""
    n = 40
    breaking = np.where(np.arange(n) % 2 == 0, 1.0, 1.3)
    lattice = ca.ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=np.full(n, 0.9), breaking=breaking)
    weak = (np.arange(n) % 2 == 0) & (np.arange(n) < 2 * bonded)
    states = np.stack([np.zeros(n, bool), weak, np.ones(n, bool)])
    counts = states.sum(axis=1)
    history = ca.plugin.BondHistory(
        hold_times=[1.0, 10.0, 100.0],
        bonds=counts,
        formed=counts,
        broken=0 * counts,
        states=states,
        state=states[-1],
        time=100.0,
        temperature=300.0,
        engine="by-hand",
    )
    return lattice, history


def test_two_populations_by_hand(bell):
    lattice, history = lattice_of_two(7)
    found = ca.plugin.rupture_bonds(ca.plugin.Bonded(contact(), chemistry(), lattice, history), bell)
    lost = KT * np.log(1e13 / 1e3)
    weak, strong = (energy - lost for energy in (1.0, 1.3))
    expected = np.array([0.0, 7 * weak, 20 * weak + 20 * strong]) * EV_PER_NM / 0.1
    np.testing.assert_allclose(found.force, expected, rtol=1e-12)
    assert (found.law, list(found.plugins)) == ("bell-at-rate", [f"{__name__}.Bell"])


def test_weak_bonds_form_last_and_strong_ones_carry_more(bell):
    """In a real run: ΔF is the sum over the bonded sites, and no multiple of their number."""
    two = chemistry(breaking=ca.barriers("uniform", lower=1.0, upper=1.3))
    made, plain = aged(bell, chemistry=two), aged(chemistry=two)
    np.testing.assert_array_equal(made.bonds, plain.bonds)
    ratio = made.friction_drop[made.bonds > 0] / made.bonds[made.bonds > 0]
    low, high = ((energy - KT * np.log(1e10)) * EV_PER_NM / 0.1 for energy in (1.0, 1.3))
    assert low < ratio.min() < ratio.max() < high
    assert np.ptp(ratio) > 1e-3


def test_the_mean_force_is_what_there_was_without_a_law():
    half = chemistry(bond_force=2.5, front_factor=0.3)
    plain, law = aged(chemistry=half), aged(ca.rupture("mean-force"), chemistry=half)
    assert plain.rupture_force is None
    assert law.rupture_force is not None
    for name in ("bonds", "events", "friction_drop", "friction_coefficient_drop"):
        np.testing.assert_array_equal(getattr(law, name), getattr(plain, name))
    assert law.fit(1, 1e4).todict() == plain.fit(1, 1e4).todict()
    assert (plain.rupture, law.rupture) == (None, "mean-force")
    own = aged(ca.rupture("mean-force", bond_force="500 pN", front_factor=1.0), chemistry=half)
    np.testing.assert_array_equal(own.friction_drop, own.bonds * 0.5)
    np.testing.assert_array_equal(own.bonds, plain.bonds)


def test_without_a_law_the_force_is_that_of_the_chemistry_times_the_bonds():
    """ΔF = N ⟨f⟩ × front factor, here 7 and 40 bonds of 2.5 nN of which three in ten carry load at once."""
    lattice, history = lattice_of_two(7)
    bonded = ca.plugin.Bonded(contact(), chemistry(bond_force=2.5, front_factor=0.3), lattice, history)
    found = ca.plugin.rupture_bonds(bonded)
    np.testing.assert_allclose(found.force, [0.0, 5.25, 30.0], rtol=1e-15)
    assert (found.law, found.provenance.get("rupture")) == ("", None)


# -- the stage --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (lambda b: b.bonds[:-1] * 1.0, r"gave an array of shape \(14,\) for 15 hold times"),
        (lambda b: 3.0, r"gave an array of shape \(\) for 15 hold times"),
        (lambda b: np.where(b.bonds < 5, 1.0, np.nan), r"gave \d+ forces of 15 that are not finite"),
        (lambda b: -1.5 * np.ones(15), "gave a negative force, -1.5 nN"),
        (lambda b: ["much"] * 15, "gave values of type <U4"),
    ],
)
def test_what_is_no_force_is_an_error_that_names_law_and_plugin(bell, answer, said):
    Wrong.answer = staticmethod(answer)
    with pytest.raises(PluginError, match=f"rupture 'wrong' of .*Wrong .*source .*{said}; give one force in nN"):
        aged(Wrong())


def test_a_law_that_returns_nothing_is_told(bell):
    Wrong.answer = staticmethod(lambda b: None)
    with pytest.raises(PluginError, match=r"rupture 'wrong' of .*: force returned None; expected a np\.ndarray"):
        aged(Wrong())


def test_states_that_were_not_asked_for_are_an_error_that_says_so(bell):
    Wrong.answer = staticmethod(lambda b: b.states.sum(axis=1))
    with pytest.raises(PluginError, match="not asked for; set states = True"):
        aged(Wrong())


def test_what_asks_is_named_where_the_engine_cannot_give_states(bell):
    class Once(ca.plugin.Engine):
        """Cannot resume."""

        kind = "once"
        restart = False

        def _run(self, lattice, hold_times, temperature, seed, start):
            raise AssertionError("computed")

    ca.register(Once)
    said = "rupture 'bell-at-rate' asks for the states: engine 'once' cannot resume"
    with pytest.raises(InputError, match=said):
        aged(Twice(inner=bell), engine=Once())
    with pytest.raises(SceneError, match=f"engine: {said}"):
        parse_scene(scene(rupture={"kind": "bell-at-rate"}, engine={"kind": "once"}))
    assert parse_scene(scene(engine={"kind": "once"})).engine == Once()


def test_arguments_of_another_kind_are_refused(bell):
    with pytest.raises(InputError, match="rupture must be a Rupture"):
        aged("mean-force")
    with pytest.raises(InputError, match="bonded must be a Bonded"):
        ca.plugin.rupture_bonds(3)  # pyright: ignore[reportArgumentType]


def test_a_law_inside_a_law_has_its_states(bell):
    inner, outer = aged(bell), aged(Twice(inner=bell))
    np.testing.assert_array_equal(outer.friction_drop, 2.0 * inner.friction_drop)
    assert set(outer.plugins) == {f"{__name__}.Bell", f"{__name__}.Twice"}


def test_a_plugin_that_answers_for_some_replicas_only_is_stored_for_all(bell):
    class Some:
        @ca.plugin.hookimpl
        def chemage_rupture_bonds(self, bonded):
            return 7.0 * bonded.bonds if bonded.lattice.forming.size and bonded.bonds[0] % 2 else None

    plain = aged()
    ca.plugin.registry.current().register(Some(), "some")
    made = aged()
    odd = plain.bonds[:, 0] % 2 == 1
    assert made.rupture_force is None or odd.any()
    np.testing.assert_array_equal(made.friction_drop, np.where(odd[:, None], 7.0, 3.0) * plain.bonds)


# -- scenes, keys, files ----------------------------------------------------------------------------------------------


def scene(**sections):
    return {
        "name": "tip",
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 48, "pixel_size": "0.4518 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
        "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
        "engine": {"kind": "rejection-free"},
        "hold": {"start": "1 ms", "stop": "1e4 s", "per_decade": 2, "replicas": 3},
        **sections,
    }


def test_the_law_is_part_of_the_key_of_ageing_and_of_no_other(bell):
    plain = parse_scene(scene())
    first = parse_scene(scene(rupture={"kind": "bell-at-rate", "length": 0.1}))
    second = parse_scene(scene(rupture={"kind": "bell-at-rate", "length": 0.2}))
    keys = [one.keys() for one in (plain, first, second)]
    assert len({one["ageing"] for one in keys}) == len({one["result"] for one in keys}) == 3
    assert len({one["contact"] for one in keys}) == 1
    assert parse_scene(first.todict()) == first
    assert first.rupture == Bell()
    assert Bell() in first.components()


def test_a_scene_without_bonds_has_no_law():
    short = {name: part for name, part in scene().items() if name in ("surface", "contact")}
    with pytest.raises(SceneError, match=r"rupture: needs \[forming\]"):
        parse_scene({**short, "rupture": {"kind": "mean-force"}})
    with pytest.raises(SceneError, match=r"rupture.kind: no rupture 'mean' \(did you mean 'mean-force'\?\)"):
        parse_scene(scene(rupture={"kind": "mean"}))


def test_file_comparison_and_summary_have_the_force_of_the_law(bell, tmp_path):
    plain, law = (ca.run(scene(**part)) for part in ({}, {"rupture": {"kind": "bell-at-rate"}}))
    for name, run in (("plain", plain), ("law", law)):
        ca.write(tmp_path / f"{name}.h5", run)
    again = ca.read(tmp_path / "law.h5")
    assert again.ageing == law.ageing
    np.testing.assert_array_equal(again.ageing.friction_drop, law.ageing.rupture_force)
    assert ca.read(tmp_path / "plain.h5").ageing.rupture_force is None
    assert law.summary()["friction_drop"] == law.ageing.rupture_force.mean(axis=0).tolist()
    assert (law.summary()["rupture"], plain.summary()["rupture"]) == ("bell-at-rate", None)
    made = compare_files([tmp_path / "plain.h5", tmp_path / "law.h5"])
    assert made.statement() == "Chemistry: the same in all results."
    assert "rupture.kind" in made.other_differences()
    drops = [one["at"][-1]["friction_drop"] for one in made.numbers()]
    assert drops == pytest.approx([one.ageing.friction_drop[:, -1].mean() for one in (plain, law)])


def test_a_checkpoint_is_reused_when_only_the_law_changes(bell, tmp_path, monkeypatch):
    with_law = ca.run(parse_scene(scene(rupture={"kind": "bell-at-rate"})), checkpoints=tmp_path)
    scenes = [
        parse_scene(scene(**part))
        for part in (
            {},
            {"rupture": {"kind": "mean-force", "bond_force": 1.0}},
            {"rupture": {"kind": "bell-at-rate", "rate": 1.0}},
        )
    ]
    computed = [ca.run(one).ageing for one in scenes]
    monkeypatch.setattr(type(scenes[0].engine), "run", lambda *_, **__: pytest.fail("computed again"))
    for one, ageing in zip(scenes, computed, strict=True):
        kept = ca.run(one, checkpoints=tmp_path)
        assert kept.ageing == ageing
        np.testing.assert_array_equal(kept.ageing.bonds, with_law.ageing.bonds)
        assert not np.array_equal(kept.ageing.friction_drop, with_law.ageing.friction_drop)


def test_laws_in_a_sweep_are_points_of_their_own(tmp_path):
    grid = {"rupture.bond_force": [1.0, 2.0], "hold.seed": [0, 1]}
    swept = ca.sweep({**scene(rupture={"kind": "mean-force"}), "sweep": grid}, out=tmp_path / "s")
    assert [point.status for point in swept] == ["done"] * 4
    drops = [point.ageing().friction_drop for point in swept]
    np.testing.assert_array_equal(drops[2], 2 * drops[0])
    np.testing.assert_array_equal(swept[1].ageing().bonds, swept[3].ageing().bonds)
    assert len({point.key for point in swept}) == 4
    rows = list(csv.DictReader((tmp_path / "s" / "results.csv").read_text().splitlines()))
    column = "last friction_drop (nN)"
    assert float(rows[3][column]) == pytest.approx(2 * float(rows[1][column]))


def test_run_prints_the_law(bell, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import tomli_w

    (tmp_path / "tip.toml").write_text(tomli_w.dumps(scene(rupture={"kind": "mean-force", "bond_force": 2.0})))
    done = json.loads(command("run", "tip.toml", "--json", "--no-figures").out)
    assert done["rupture"] == "mean-force"
    assert "mean-force" in command("show", "tip.h5", "--all").out
    assert "rupture" in command("check", "tip.toml").out
