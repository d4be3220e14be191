"""A plan says what will be modelled, and its estimates are not far from what happens."""

from __future__ import annotations

import json
import tracemalloc

import faults
import pytest

import chemage
from chemage import load_scene
from chemage.plugin import plan, scene_data


@pytest.fixture
def planned(small):
    return lambda **changes: plan(load_scene(small, {n.replace("__", "."): v for n, v in changes.items()}))


def test_estimates_are_near_what_happens(small, tmp_path):
    changes = {"surface.pixels": 200, "surface.zeta": 20, "contact.load": "0.5 uN"}
    scene = load_scene(small, changes)
    expected = plan(scene).numbers
    result = chemage.run(scene)
    chemage.write(tmp_path / "x.h5", result)
    assert (expected["nx"], expected["ny"]) == result.contact.shape
    assert expected["area_fraction"] == pytest.approx(result.contact.area_fraction, rel=0.35)
    assert expected["sites"] == pytest.approx(result.contact.sites.size, rel=0.35)
    assert 0.3 < expected["file"] / (tmp_path / "x.h5").stat().st_size < 3


def test_the_reference_run_fits_its_budget():
    numbers = plan(load_scene("silica-rough")).numbers
    assert 0.0085 < numbers["area_fraction"] < 0.0110
    assert numbers["sites"] == numbers["area_fraction"] * 2500**2
    if "memory" in numbers:
        assert numbers["memory"] < 3e9
    if "cpu_seconds" in numbers:
        assert 0 < numbers["cpu_seconds"] < 90


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
def test_the_gap_is_part_of_the_estimates(small, precision):
    """Its bytes are those of the array that a solve returns."""
    without = load_scene(small, {"contact.precision": precision})
    scene = load_scene(small, {"contact.precision": precision, "contact.gap": True})
    gap = chemage.run(scene).contact.gap
    assert gap is not None
    assert plan(scene).gap_bytes == gap.nbytes
    assert plan(without).gap_bytes == 0
    for name in ("file", "memory"):
        assert plan(scene).numbers[name] - plan(without).numbers[name] == pytest.approx(gap.nbytes)
    assert plan(scene).contact_file - plan(without).contact_file == gap.nbytes


def test_a_tip_is_planned_with_its_area():
    scene = load_scene("silica-tip")
    contact = chemage.solve_contact(scene.contact, scene.surface.make(), scene.load)
    assert plan(scene).numbers["area_fraction"] == pytest.approx(contact.area_fraction, rel=0.1)


def test_what_is_left_out_is_told(planned):
    stages = planned(breaking=None, interaction=None, chemistry=None).stages
    assert stages["breaking"] == "not modelled: bonds last"
    assert stages["interaction"] == "not modelled: no neighbour list"
    assert "pressure only decides who is in contact" in stages["forming"]


def test_hydroxylation_leaves_fewer_sites(planned):
    assert planned(chemistry__hydroxylation=0.25).numbers["sites"] == planned().numbers["sites"] / 4


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"contact__load": 0}, "the load is 0"),
        ({"contact__load": "1 mN"}, "nearly full"),
        ({"surface__zeta": 20}, "2.4 pixels"),
        ({"fit": {"start": 1e4, "stop": 1e5}}, None),
        ({"fit": {"start": 1e6, "stop": 1e7}}, "beta will not be fitted: no hold time lies between"),
        ({"hold__stop": "10 ms", "hold__temperature": 100}, "no bond is expected at 100 K and 0.01 s"),
        ({"hold__start": "1e15 s", "hold__stop": "1e17 s"}, "already crossed"),
    ],
)
def test_what_a_user_should_know_beforehand(planned, changes, said):
    notes = planned(**changes).notes
    if said is None:
        assert not any("fit" in note for note in notes)
    else:
        assert sum(said in note for note in notes) == 1, notes
        assert not any(said in note for note in planned().notes)


def test_hold_time_zero_alone_is_no_trouble(small):
    text = small.read_text().replace('start = "1 ms"\nstop = "1e5 s"', "times = [0.0]")
    small.write_text(text)
    json.dumps(plan(load_scene(small)).todict(), allow_nan=False)


def test_rows_and_dict_are_for_tables_and_programs(planned):
    made = planned()
    names = [name for name, _ in made.rows()]
    assert names[:3] == ["surface", "contact", "forming"]
    assert "expected area fraction" in names
    told = made.todict()
    assert told["keys"] == made.scene.keys()
    assert told["nx"] == 48


@pytest.mark.parametrize(
    ("temperature", "stop"), [(300.0, 1e5), (400.0, 100.0), (350.0, 1e3)], ids=["300 K", "400 K", "350 K"]
)
def test_events_are_estimated_at_every_temperature(small, temperature, stop):
    """Within a factor 2; the cost of a replica is proportional to them."""
    changes = {"surface.pixels": 200, "surface.zeta": 20, "contact.load": "0.5 uN"}
    scene = load_scene(small, {**changes, "hold.temperature": temperature, "hold.stop": stop, "hold.replicas": 5})
    found = chemage.run(scene).ageing
    assert 0.5 < plan(scene).numbers["events"] / (found.events / found.sites).mean() < 2


def test_what_takes_hours_is_said():
    hot = {"hold.temperature": 400.0, "hold.stop": 3e7}
    (note,) = [note for note in plan(load_scene("silica-rough", hot)).notes if "this will take about" in note]
    assert "days on" in note
    few = {**hot, "engine": {"kind": "next-reaction", "superbasins": True}}
    # their gain is not known before
    (note,) = [note for note in plan(load_scene("silica-rough", few)).notes if "this will take up to" in note]
    assert "the cost of engine 'next-reaction' depends on what happens during the run" in note
    short = load_scene("silica-patch", {"hold.temperature": 400.0, "hold.stop": 100.0})
    assert not [note for note in plan(short).notes if "this will take" in note]


def test_seconds_follow_the_speed_of_the_machine(small, monkeypatch):
    scene = load_scene(small)
    once = plan(scene).numbers
    faults.speed(monkeypatch, 0.25)
    fast = plan(scene)
    assert fast.numbers["cpu_seconds"] == pytest.approx(once["cpu_seconds"] / 4)
    assert fast.numbers["seconds"] == pytest.approx(once["seconds"] / 4)
    assert fast.numbers["memory"] == once["memory"]
    assert ("speed of this machine", "4 times the reference, measured once") in fast.rows()


def test_what_is_not_known_of_a_rough_tip_is_said():
    body = {"kind": "cone", "radius": 20, "half_angle": 75, "pixels": 32, "pixel_size": 0.25}
    scene = chemage.parse_scene(scene_data("silica-patch")[0] | {"surface": {"kind": "tip", "body": body}})
    rows = dict(plan(scene).rows())
    assert rows["expected area fraction"] == "not known before the contact is solved"


SPHERES = {
    "hertz": ("hertz", {}),
    "with the gap": ("hertz", {"gap": True}),
    "with a hardness": ("hertz", {"hardness": "4 GPa"}),
    "with both": ("hertz", {"hardness": "4 GPa", "gap": True}),
    "jkr": ("jkr", {"work_of_adhesion": "50 mJ/m^2"}),
    "dmt": ("dmt", {"work_of_adhesion": "50 mJ/m^2"}),
    "maugis": ("maugis", {"work_of_adhesion": "50 mJ/m^2", "range": "0.3 nm"}),
}


@pytest.mark.parametrize("load", ["50 nN", "2000 nN"])
@pytest.mark.parametrize("case", SPHERES)
def test_the_memory_of_a_sphere_is_what_its_solver_takes(case, load):
    kind, options = SPHERES[case]
    solver = chemage.contact(kind, modulus="35.3 GPa", **options)
    surface, few = (chemage.surface("sphere", radius="30 nm", pixels=n, pixel_size=f"{29 / n} nm") for n in (1000, 32))
    solver.solve(few.make(), load)  # what is imported is no memory of the solver
    made = surface.make()
    tracemalloc.start()
    try:
        solver.solve(made, load)
        taken = made.heights.nbytes + tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    stated = solver.expected(surface.expected(), solver.normal_force(load, made))["bytes"]
    assert 0.85 < stated / taken < 1.25
