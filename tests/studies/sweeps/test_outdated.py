"""Plugins change between two calls of one sweep: exactly what they touch is computed again, and that is said."""

from __future__ import annotations

import shutil
import sys
import warnings

import numpy as np
import pytest

import chemage
from chemage.plugin import registry

LOADS = [5.0, 10.0, 20.0, 40.0]
#: caps the pressure above a load
CAP = """
import chemage, numpy as np

@chemage.plugin.hookimpl(wrapper=True)
def chemage_solve_contact(load):
    found = yield
    if load < {above}:
        return found
    return found.model_copy(update={{"pressure": np.minimum(found.pressure, {cap}), "carries": "capped"}})
"""
IDLE = """
import chemage

@chemage.plugin.hookimpl
def chemage_make_surface(maker, seed):
    return None

@chemage.plugin.hookimpl
def chemage_solve_contact(solver, surface, load, start):
    return None

@chemage.plugin.hookimpl(wrapper=True)
def chemage_run_kinetics():
    return (yield)

@chemage.plugin.hookimpl(wrapper=True)
def chemage_rupture_bonds():
    return (yield)

@chemage.plugin.hookimpl
def chemage_observe(contact, lattice, history):
    return {}
"""
RUPTURE_HOOK = """
import chemage

@chemage.plugin.hookimpl(wrapper=True)
def chemage_rupture_bonds(bonded):
    found = yield
    return found if bonded.contact.load < {above} else {factor} * found
"""
ENGINE_HOOK = """
import chemage

@chemage.plugin.hookimpl(wrapper=True)
def chemage_run_kinetics():
    found = yield
    return found.model_copy(update={"notes": (*found.notes, "seen")})
"""
PULL_HOOK = """
import chemage

@chemage.plugin.hookimpl(wrapper=True)
def chemage_pull_bonds():
    pulled = yield
    longest = chemage.plugin.Output("end", "nm", "longest stretch").of([pulled.stretch.max(initial=0.0)])
    chemage.plugin.record(longest=longest)
    return pulled
"""


class Lab:
    """One sweep over four loads, computed again and again with other plugins."""

    def __init__(self, tiny, site, folder):
        self.tiny, self.site, self.folder = tiny, site, folder

    def plugin(self, name, source, version="1.0"):
        """Install a version of a plugin in place of the one before."""
        module = f"chemage_{name}"
        for old in self.site.folder.glob(f"{module}-*.dist-info"):
            shutil.rmtree(old)
        sys.modules.pop(module, None)
        self.site.install(f"chemage-{name}", {f"{module}.py": source}, {name: module}, version)

    def remove(self, name):
        for old in self.site.folder.glob(f"chemage_{name}-*.dist-info"):
            shutil.rmtree(old)

    def sweep(self, **sections):
        """Compute; returns the sweep, the number of contacts and replicas computed, and the warnings."""
        self.tiny.forget()
        scene = self.tiny.scene(**sections) | {"sweep": {"contact.load": LOADS}}
        with warnings.catch_warnings(record=True) as caught, registry.using(self.site.registry()):
            warnings.simplefilter("always")
            result = chemage.sweep(scene, self.folder)
        assert result.states() == ["done"] * 4
        said = [str(one.message) for one in caught if one.category.__name__ == "SweepWarning"]
        return result, len(self.tiny.computed("contact")), len(self.tiny.computed("kinetics")), said


@pytest.fixture
def lab(tiny, site, tmp_path):
    return Lab(tiny, site, tmp_path / "out")


@pytest.mark.long
def test_a_plugin_that_answers_nothing_changes_nothing(lab):
    first = lab.sweep()[0]
    before = {point.index: point.summary for point in first}
    lab.plugin("idle", IDLE)
    again, contacts, replicas, said = lab.sweep()
    # it is asked with one replica of every point
    assert (contacts, replicas, said) == (0, 4, [])
    assert {point.index: point.summary for point in again} == before
    assert lab.sweep()[1:] == (0, 0, [])  # and asked once
    lab.remove("idle")
    assert lab.sweep()[1:] == (0, 0, [])


def test_a_plugin_that_changes_the_friction_of_some_points_computes_just_those(lab):
    plain = [point.ageing() for point in lab.sweep()[0]]
    lab.plugin("weak", RUPTURE_HOOK.format(above=15, factor=0.5))
    again, contacts, _, said = lab.sweep()
    assert contacts == 0
    assert "2 points and 0 contacts are computed again" in said[0]
    for point, before, factor in zip(again, plain, (1, 1, 0.5, 0.5), strict=True):
        assert point.summary["plugins"].get("weak") == (None if factor == 1 else "chemage-weak 1.0")
        assert (point.ageing().bonds == before.bonds).all()
        assert (point.ageing().friction_drop == factor * before.friction_drop).all()
    lab.plugin("weak", RUPTURE_HOOK.format(above=15, factor=0.25), "1.1")
    again, contacts, replicas, _ = lab.sweep()
    # two replicas of each of two points, and one of each of the others, with which the new version is asked
    assert (contacts, replicas) == (0, 6)
    assert (again[3].ageing().friction_drop == 0.25 * plain[3].friction_drop).all()
    lab.remove("weak")
    assert [point.ageing() == before for point, before in zip(lab.sweep()[0], plain, strict=True)] == [True] * 4


def test_a_wrapper_is_in_the_points_that_it_changes_and_a_new_version_computes_just_those(lab):
    lab.plugin("cap", CAP.format(above=15, cap=0.3))
    first, contacts, _, _ = lab.sweep()
    assert contacts == 4
    assert [point.summary["plugins"].get("cap") for point in first] == [
        None,
        None,
        "chemage-cap 1.0",
        "chemage-cap 1.0",
    ]
    assert [point.contact().plugins.get("cap") for point in first][2:] == ["chemage-cap 1.0"] * 2
    lab.plugin("cap", CAP.format(above=15, cap=0.2), "1.1")
    again, contacts, replicas, said = lab.sweep()
    assert (contacts, replicas) == (2, 4)
    assert len(said) == 1
    assert "2 points and 2 contacts are computed again" in said[0]
    assert "cap was chemage-cap 1.0 and is chemage-cap 1.1" in said[0]
    assert [point.summary["max_pressure"] for point in again][2:] == [0.2, 0.2]
    lab.remove("cap")
    plain, contacts, _, said = lab.sweep()
    assert contacts == 2
    assert "is not installed" in said[0]
    assert all("cap" not in point.summary["plugins"] for point in plain)


def test_a_plugin_that_is_new_is_asked_about_every_contact(lab):
    lab.sweep()
    lab.plugin("cap", CAP.format(above=30, cap=0.3))
    again, contacts, replicas, said = lab.sweep()
    assert (contacts, replicas) == (1, 2)
    assert "cap (chemage-cap 1.0) answers or changes them now" in said[0]
    assert [("cap" in point.summary["plugins"]) for point in again] == [False, False, False, True]


def test_a_hook_of_the_kinetics_leaves_contacts_as_they_are(lab):
    lab.sweep()
    lab.plugin("seen", ENGINE_HOOK)
    again, contacts, replicas, said = lab.sweep()
    assert contacts == 0
    assert replicas == 4 + 8  # asked, and computed again
    assert "4 points and 0 contacts" in said[0]
    assert "seen" in again[0].ageing().plugins
    lab.plugin("seen", ENGINE_HOOK, "2.0")
    assert lab.sweep()[1:3] == (0, 8)


@pytest.mark.long
def test_a_hook_of_pulls_is_asked_about_a_history_that_was_swept_before(site, tmp_path):
    scene = chemage.load_scene("silica-history").todict()
    scene |= {
        "step": [{"duration": 1}, {"speed": 100, "distance": 0.2}],
        "hold": {"replicas": 1},
        "sweep": {"step.1.speed": [100, 1000]},
    }
    scene.pop("fit", None)

    def summaries():
        with warnings.catch_warnings(), registry.using(registry.Registry()):
            warnings.simplefilter("ignore")
            return [point.summary for point in chemage.sweep(scene, tmp_path / "out")]

    assert not any(one["plugins"] for one in summaries())
    site.install("chemage-longest", {"chemage_longest.py": PULL_HOOK}, {"longest": "chemage_longest"})
    assert all(one["plugins"] == {"longest": "chemage-longest 1.0"} for one in summaries())


def test_a_component_of_a_new_version_computes_what_it_is_part_of(lab, site):
    lab.sweep()
    source = (site.folder / "chemage_tiny.py").read_text()
    lab.plugin("tiny", source, "1.1")
    _, contacts, replicas, said = lab.sweep()
    assert (contacts, replicas) == (4, 8)
    assert "tiny was chemage-tiny 1.0 and is chemage-tiny 1.1" in said[0]


def test_the_keys_of_a_finished_run_contain_the_plugins_that_took_part(lab, site):
    plain = lab.sweep()[0]
    lab.plugin("cap", CAP.format(above=0, cap=0.3))
    with registry.using(site.registry()):
        run = chemage.run(plain[0].scene())
    keys = run.keys
    assert keys["contact"] != plain[0].summary["keys"]["contact"]
    assert keys["surface"] == plain[0].summary["keys"]["surface"]
    assert run.versions["chemage-cap"] == "1.0"
    assert np.all(run.contact.pressure <= 0.3)
