"""The map of speed against accuracy: paired errors, combinations, fronts, the cheapest settings, and the file."""

from __future__ import annotations

import dataclasses
import json
import shlex
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
from seen import figures

import chemage as ca
import chemage_trade
from chemage import ContactSolution, InputError
from chemage.plugin import (
    ContactSolver,
    DamagedError,
    Pressure,
    Scatter,
    StoreError,
    TradePoint,
    container,
    options,
    override,
)
from chemage.studies.trade import Deviation
from chemage_trade.mapping import Timed
from chemage_trade.result import applied, changes, choices, go_together, pareto, pasted, words

ROUNDS = 3


class Part(ContactSolver):
    """The same pressure on the highest pixels; some of them are left out where it is to be fast."""

    kind = "tiny-part"
    trade: ClassVar[Any] = {"share": (0.5, 0.75, 1.0), "smooth": (False, True)}
    modulus: Pressure = 1.0
    """GPa"""
    share: float = 1.0
    """of the half of the pixels"""
    smooth: bool = True
    """whether the pressure is even"""

    def _solve(self, surface, load, start):
        count = max(1, round(0.5 * self.share * surface.heights.size))
        chosen = np.argsort(surface.heights, axis=None)[-count:]
        pressure = np.zeros(surface.heights.size)
        pressure[chosen] = 1.0 if self.smooth else 1.0 + 0.5 * (np.arange(count) % 2)
        pressure *= load / (pressure.sum() * surface.pixel_size**2)
        return ContactSolution(
            pressure=pressure.reshape(surface.heights.shape),
            load=load,
            pixel_size=surface.pixel_size,
            modulus=self.modulus,
        )

    def expected(self, surface, load):
        return {"area_fraction": 0.5, "cpu_seconds": 0.01, "bytes": 1e5}


@pytest.fixture
def scene(tiny):
    """A random surface, a contact with two options to trade, and two engines that are equal but for their names."""
    coin = ca.plugin.registry.current().component("engine", "tiny-coin")
    toss = type("Toss", (coin,), {"kind": "tiny-toss", "__doc__": coin.__doc__, "__module__": __name__})
    ca.register(Part)
    ca.register(toss)
    ca.plugin.registry.current().register(chemage_trade, "trade")
    hold = {"times": [1.0, 10.0, 100.0, 1000.0], "replicas": 3, "seed": 4}
    surface = {"kind": "tiny-tip", "pixels": 12, "seed": 2}
    return ca.parse_scene(tiny.scene(surface=surface, contact={"kind": "tiny-part", "load": 10.0}, hold=hold))


_MADE: list[ca.Tradeoff] = []


@pytest.fixture
def found(scene):
    """The map of the scene, measured once for all tests."""
    if not _MADE:
        _MADE.append(ca.tradeoff(scene, rounds=ROUNDS))
    return _MADE[0]


def point(found: ca.Tradeoff, **chosen: str) -> TradePoint:
    """The point with these choices; ``_`` stands for a dot."""
    wanted = {name.replace("_", "."): value for name, value in chosen.items()}
    (one,) = [one for one in found.points if one.choices == wanted]
    return one


def solved(scene, number: int, **options: Any):
    surface = scene.surface.make(scene.surface_seed + number)
    return scene.contact.replace(**options).solve(surface, scene.load)


# -- what is measured --------------------------------------------------------------------------------------------------


def test_every_setting_is_measured_on_every_surface(found, scene):
    assert found.random
    assert found.own == point(found)
    singles = [one.choices for one in found.points if len(one.choices) == 1]
    assert {"contact.share": "0.5"} in singles
    assert {"contact.smooth": "False"} in singles
    assert {"engine": "tiny-toss"} in singles
    # the single kind of contact that is left does not fit into this scene without its options
    for one in found.points:
        assert len(one.contact_seconds) == len(one.ageing_seconds) == ROUNDS
        assert one.seconds() > 0
        assert one.spread() >= 0


def test_errors_of_the_contact_are_means_over_surfaces(found, scene):
    for share in (0.5, 0.75):
        areas = np.array([solved(scene, k, share=share).corrected_area for k in range(ROUNDS)])
        best = np.array([solved(scene, k, share=1.0).corrected_area for k in range(ROUNDS)])
        deviation = point(found, contact_share=str(share)).deviation("corrected_area")
        assert deviation.value == pytest.approx((areas - best).mean() / best.mean())
        expected = (areas - best).std(ddof=1) / np.sqrt(ROUNDS) / best.mean()
        assert deviation.stderr == pytest.approx(expected)
        assert deviation.half_width == pytest.approx(expected * 4.302652729749462)  # Student's of 3


def test_the_distribution_of_pressure_is_compared_by_its_wasserstein_distance(found, scene):
    # two values, a fifth above and below the mean, against one
    deviation = point(found, contact_smooth="False").deviation("pressure_distribution")
    assert deviation.value == pytest.approx(0.2, rel=1e-6)
    assert point(found).deviation("pressure_distribution").value == 0


def test_errors_of_beta_are_paired_surface_by_surface_and_replica_by_replica(found, scene):
    def betas(number, **options):
        ageing = ca.age(
            solved(scene, number, **options), scene.chemistry, engine=scene.engine, hold_times=scene.hold.hold_times,
            temperature=scene.hold.temperature, replicas=3, seed=scene.hold.seed + number, common="all",
        )  # fmt: skip
        return np.polyfit(np.log10(ageing.hold_times), ageing.friction_coefficient_drop.T, 1)[0]

    pairs = np.array([betas(k, share=0.5) - betas(k) for k in range(ROUNDS)])
    each = pairs.mean(axis=1)
    mean = np.mean([betas(k).mean() for k in range(ROUNDS)])
    deviation = point(found, contact_share="0.5").deviation("beta")
    assert deviation.value == pytest.approx(each.mean() / mean)
    between = each.std(ddof=1) / np.sqrt(ROUNDS) / mean
    within = np.sqrt(pairs.var(axis=1, ddof=1).mean() / 3 / ROUNDS) / mean
    assert deviation.stderr == pytest.approx(max(between, within))
    assert deviation.freedom == (2 if between >= within else 3 * 2)
    assert deviation.value == pytest.approx(-0.5, abs=0.2)
    assert deviation.resolved


def test_the_noise_of_an_exact_engine_is_not_an_error(found):
    one = point(found, engine="tiny-toss")
    assert one.exact
    assert one.deviation("beta") == Deviation(0.0, 0.0, ROUNDS - 1)


def test_where_the_seed_changes_no_surface_replicas_are_the_sample(scene, monkeypatch):
    monkeypatch.setattr(type(scene.surface), "scatter", lambda self, contact: Scatter(0.0, "the tip is the same"))
    made = ca.tradeoff(scene, rounds=2)
    assert not made.random
    assert made.surface_scatter == {}
    one = point(made, contact_share="0.5")
    assert one.deviation("beta").freedom == 2 * 3 - 1
    assert one.deviation("corrected_area").stderr == 0


def test_observables_are_of_each_decade_and_of_the_contact(found):
    drops = [f"friction_drop@{time} s" for time in (10, 100, 1000)]  # at 1 s nothing is bonded
    contact = ["corrected_area", "pressure_distribution", "patches", "perimeter_to_area"]
    assert found.observables == ["beta", *drops, *contact]
    assert words("friction_drop@1000 s") == "ΔF at 10³ s"


def test_a_contact_alone_has_a_map(scene, tiny):
    data = {name: part for name, part in scene.todict().items() if name in ("name", "surface", "contact")}
    made = ca.tradeoff(ca.parse_scene(data), rounds=2)
    assert made.observables == ["corrected_area", "pressure_distribution", "patches", "perimeter_to_area"]
    assert made.cheapest("corrected_area", 0.01).point is not None


def test_the_time_that_is_left_is_said(scene):
    said = []
    ca.tradeoff(scene, rounds=2, report=said.append)
    assert any(text.startswith("surface 2 of 2: contact.share 0.5") for text in said)


# -- combinations ------------------------------------------------------------------------------------------------------


@pytest.fixture
def faster(monkeypatch):
    """As if every other value than the scene's were twice as fast."""
    outcome = Timed.outcome

    def timed(task, worker):
        contact, computed = task.scene.contact, outcome(task, worker)
        faster = (getattr(contact, "share", 1) < 1) + (not getattr(contact, "smooth", True))
        timings = {**computed.run.timings, "contact": 2.0**-faster, "ageing": 1e-3}
        return dataclasses.replace(computed, run=dataclasses.replace(computed.run, timings=timings))

    monkeypatch.setattr(Timed, "outcome", timed)


def test_choices_that_save_time_are_combined(scene, faster):
    combined = [set(one.choices) for one in ca.tradeoff(scene, rounds=1).points if len(one.choices) > 1]
    assert {"contact.share", "contact.smooth"} in combined
    assert all(len({name for name in one if name.startswith("engine")}) < 2 for one in combined)


def test_two_values_of_one_option_are_not_combined(scene):
    share = [choice for choice in choices(scene, []) if choice.name == "contact.share"]
    assert len(share) == 2  # and that of the scene
    assert not go_together(tuple(share))


# -- where it is computed ----------------------------------------------------------------------------------------------


def differences(found: ca.Tradeoff) -> dict[str, Any]:
    return {one.words: (one.differences, one.values, one.scatter) for one in found.points}


@pytest.mark.long
def test_a_map_that_was_stopped_is_resumed_with_equal_times(scene, faster, tmp_path, tiny):
    class Stopped(Exception):
        pass

    def stop(text):
        if text.startswith("surface 2 of 2: contact.smooth"):
            raise Stopped

    with pytest.raises(Stopped):
        ca.tradeoff(scene, rounds=2, folder=tmp_path, report=stop)
    kept = len(list(tmp_path.rglob("*.json")))
    assert kept > 5
    tiny.forget()
    resumed = ca.tradeoff(scene, rounds=2, folder=tmp_path)
    assert len(list(tmp_path.rglob("*.json"))) > kept
    assert 0 < len(tiny.computed("kinetics")) < len(resumed.points) * 2 * 3
    tiny.forget()
    again = ca.tradeoff(scene, rounds=2, folder=tmp_path)
    assert tiny.computed("kinetics") == []  # what is refused is tried again
    assert again.todict() == resumed.todict()
    assert repr(differences(ca.tradeoff(scene, rounds=2))) == repr(differences(resumed))  # nan are equal


def test_times_of_another_processor_are_not_taken(scene, tmp_path, tiny, monkeypatch):
    ca.tradeoff(scene, rounds=1, folder=tmp_path)
    monkeypatch.setattr("chemage.scene.provenance.processor", lambda: "another")
    tiny.forget()
    ca.tradeoff(scene, rounds=1, folder=tmp_path)
    assert tiny.computed("kinetics") != []


@pytest.mark.long
def test_processes_measure_the_same():
    plain = ca.load_scene(
        "silica-rough",
        {"surface.pixels": 64, "surface.zeta": 8, "contact.load": "200 nN", "hold.replicas": 3, "hold.per_decade": 2},
    )
    here, there = (ca.tradeoff(plain, rounds=2, executor=executor) for executor in ("serial", "processes"))
    both = differences(here).keys() & differences(there).keys()  # which combinations are kept depends on times
    assert {name for name in differences(here) if "," not in name} <= both
    assert [name for name in both if repr(differences(here)[name]) != repr(differences(there)[name])] == []
    assert all(one.seconds() > 0 for one in there.points)


def test_threads_of_one_process_are_refused(scene):
    with pytest.raises(InputError, match="CPU times of threads cannot be told apart; choose processes"):
        ca.tradeoff(scene, executor="threads")


def test_settings_can_be_pasted(scene, found):
    for one in found.points:
        words = shlex.split(pasted(one.changes))
        again = override(scene.todict(), options.changed_fields([word for word in words if word != "--set"]))
        changed = ca.parse_scene(again)
        assert changes(scene, changed) == one.changes
        assert (changed == scene) == one.own


def test_a_coarser_grid_can_be_pasted_with_its_sites_in_place():
    scene = ca.load_scene("silica-rough")
    (grid,) = [choice for choice in choices(scene, []) if choice.label == "2 times coarser"]
    changed = changes(scene, applied(scene, (grid,)))
    assert changed["surface.pixels"] == [1250, 1250]
    again = ca.parse_scene(override(scene.todict(), changed))
    assert again.keys() == applied(scene, (grid,)).keys()
    assert again.site_grids is not None
    assert scene.site_grids is not None
    assert again.site_grids[1] == scene.site_grids[1]


# -- fronts and the cheapest settings ----------------------------------------------------------------------------------


def made_point(seconds: float, error: float, stderr: float = 0.0, **more: Any) -> TradePoint:
    """A point that needs this for the contact, and a tenth of it for the ageing of ten replicas."""
    fields: dict[str, Any] = {
        "choices": {"contact.tolerance": f"{error:g}"},
        "changes": {"contact.tolerance": error},
        "contact_seconds": [seconds, seconds, 2 * seconds],
        "ageing_seconds": [0.1 * seconds] * 3,
        "differences": {"beta": (error, stderr, 2), "corrected_area": (error, 0.0, 2)},
        "values": {"beta": 0.4},
        "scatter": {"beta": 0.05},
    }
    return TradePoint(**{**fields, **more})


@pytest.fixture
def drawn():
    points = [
        made_point(1.0, 0.0005, choices={}, changes={}, own=True),
        made_point(0.1, 0.02),
        made_point(0.3, 0.05),  # beaten
        made_point(0.5, -0.004, 0.0005),
    ]
    return ca.Tradeoff(
        scene={"name": "drawn"}, question="q", versions={}, machine={}, rounds=3, random=True, replicas=10,
        observables=["beta", "corrected_area"], points=points,
    ).marked()  # fmt: skip


def test_the_front_leaves_out_what_is_slower_and_less_accurate(drawn):
    assert [one.changes.get("contact.tolerance") for one in drawn.front("beta")] == [0.02, -0.004, None]
    assert [bool(one.front) for one in drawn.points] == [True, True, False, True]
    assert pareto([(1, 2), (2, 2), (2, 1), (3, 0)], lambda one: one) == [(1, 2), (2, 1), (3, 0)]


def test_the_cheapest_settings_have_as_many_replicas_as_they_need(drawn):
    one = drawn.cheapest("beta", 0.03)
    assert one.point is not None
    # a bias of 2 % leaves 2.24 % for the replicas, whose scatter is 5 %
    assert one.replicas == 20
    assert one.seconds == pytest.approx(0.1 + 0.001 * 20)
    assert one.error == pytest.approx(np.hypot(0.02, 1.959963984540054 * 0.05 / np.sqrt(20)))
    assert one.error <= 0.03
    assert one.options == "--set contact.tolerance=0.02 --set hold.replicas=20"
    assert "within 3 %: 0.12 CPU s" in one.text()


def test_of_the_contact_the_contact_alone_is_paid(drawn):
    one = drawn.cheapest("corrected_area", 0.03)
    assert one.seconds == 0.1
    assert one.replicas is None
    assert one.options == "--set contact.tolerance=0.02"


def test_what_is_not_found_is_said(drawn):
    assert drawn.cheapest("corrected_area", 0.0001).text() == "within 0.01 %: none found; the best is known to 0.05 %"
    assert drawn.cheapest("corrected_area", 0.0001).todict()["found"] is False


def test_a_difference_within_its_error_is_not_resolved():
    assert not Deviation(0.001, 0.001, 2).resolved
    assert Deviation(0.01, 0.001, 2).resolved
    assert Deviation(0.001, 0.001, 2).bound == pytest.approx(0.001 + 4.302652729749462 * 0.001)
    assert np.isnan(Deviation(0.001, float("nan"), 0).bound)


@pytest.mark.long
def test_the_figure_has_a_panel_for_each_observable(drawn, found):
    assert [axes.get_title() for axes in figures(drawn)["trade"].axes] == ["β", "corrected contact area"]
    assert len(figures(found)["trade"].axes) == 1 + 3 + 4
    assert figures(found)["trade"].get_figheight() > 1.5 * figures(drawn)["trade"].get_figheight()
    assert figures(replace(drawn, points=[], observables=[])) == {}


# -- the file ----------------------------------------------------------------------------------------------------------


def test_a_map_is_read_as_it_was_written(found, scene, tmp_path):
    found.write(tmp_path / "map.json")
    again = ca.Tradeoff.read(tmp_path / "map.json")
    assert again.todict() == found.todict()
    assert again.front("beta")[0].changes == found.front("beta")[0].changes
    again.check(scene)
    with pytest.raises(StoreError, match="already there"):
        found.write(tmp_path / "map.json")


def test_a_damaged_map_is_refused(found, tmp_path):
    path = tmp_path / "map.json"
    found.write(path)
    text = path.read_bytes()
    path.write_bytes(text.replace(b'"replicas": 3', b'"replicas": 4', 1))
    with pytest.raises(DamagedError, match="not what chemage wrote"):
        ca.Tradeoff.read(path)
    path.write_bytes(text[:200])
    with pytest.raises(DamagedError, match="is damaged"):
        ca.Tradeoff.read(path)
    path.write_text('{"a": 1}')
    with pytest.raises(StoreError, match=r"cannot read the map: .* is no file of chemage"):
        ca.Tradeoff.read(path)
    path.write_bytes(container.sealed_json({"a": 1}))
    with pytest.raises(StoreError, match="is no map"):
        ca.Tradeoff.read(path)
    with pytest.raises(StoreError, match="cannot read the map"):
        ca.Tradeoff.read(tmp_path / "none.json")


def test_a_map_serves_other_seeds_replicas_and_goals(found, scene):
    hold = scene.hold.model_copy(update={"seed": 77, "replicas": 40})
    other = scene.model_copy(update={"hold": hold, "surface_seed": 5, "accuracy": {"beta": 0.1}, "name": "other"})
    found.check(other)


def test_a_map_of_another_scene_is_refused(found, scene):
    with pytest.raises(InputError, match="was measured on another scene, which has changed since; measure it again"):
        found.check(scene.model_copy(update={"load": 11.0}), "map.json")


def test_a_map_of_other_versions_is_refused(found, scene):
    other = replace(found, versions={**found.versions, "numpy": "1.0"})
    with pytest.raises(InputError, match=r"was measured with other versions: numpy 1.0 instead of"):
        other.check(scene)
    replace(found, versions={**found.versions, "processor": "another"}).check(scene)


# -- the command -------------------------------------------------------------------------------------------------------


def test_the_command_prints_tables_of_80_columns_and_writes_the_map(scene, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.toml").write_text(toml(scene))
    done = command("tradeoff", "part.toml", "--rounds", 2, "-o", "map.json", "-o", "map.png")
    assert done.status == 0, done.err
    table, sentences = done.out.split("The cheapest settings", 1)
    assert max(len(line) for line in table.splitlines()) <= 80
    assert "as in the scene" in table
    assert "for the β of one surface:" in sentences
    assert "within 10 %:" in sentences
    assert "map      map.json" in done.out
    assert (tmp_path / "map.png").stat().st_size > 1000
    assert command("tradeoff", "part.toml", "--rounds", 2, "-o", "map.json").status == 2
    assert ca.Tradeoff.read("map.json").rounds == 2


def test_the_command_goes_on_from_its_folder(scene, tmp_path, command, monkeypatch, tiny):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.toml").write_text(toml(scene))
    words = ("tradeoff", "part.toml", "--rounds", 2, "--folder", "kept", "--json")
    first = command(*words)
    tiny.forget()
    assert command(*words).out == first.out
    assert tiny.computed("kinetics") == []
    assert "choose processes" in command(*words, "--executor", "threads").err


def test_the_keys_of_json(scene, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.toml").write_text(toml(scene))
    found = json.loads(command("tradeoff", "part.toml", "--rounds", 2, "--json").out)
    assert {"scene", "notes", "map", "cheapest", "sentences"} == found.keys()
    assert found["scene"] == "part"
    assert {"observable", "within", "options", "cpu_seconds", "error"} <= found["cheapest"][0].keys()


def toml(scene) -> str:
    import tomli_w

    return tomli_w.dumps({**scene.todict(), "name": "part"})


def test_what_is_far_slower_than_the_scene_is_left_out(scene, monkeypatch):
    monkeypatch.setattr("chemage_trade.mapping.NOT_LONG", 0.0)
    monkeypatch.setattr("chemage_trade.mapping.SLOWER", 0.0)
    made = ca.tradeoff(scene, rounds=2)
    assert all(set(one.choices) <= {"contact", "contact.share", "contact.smooth"} for one in made.points)
    assert any("engine tiny-toss: left out: about" in note for note in made.notes)
