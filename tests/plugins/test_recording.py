"""What components of any role and hooks record: the plugins of docs/plugins.md, from one stage to every table."""

from __future__ import annotations

import importlib
import json
import warnings
from typing import ClassVar

import numpy as np
import pytest
from tutorial import Tutorial

import chemage as ca
from chemage.plugin import Output, PluginError, SceneError, hookimpl, record, registry
from chemage.testing import check_component

BLOCKS = {
    name: code
    for language, code in Tutorial("plugins.md").blocks
    for name in ("class Noting", "class Weakest", "class Skewed")
    if language == "python" and name in code
}
MODULE = "\n".join(BLOCKS.values())
KINDS = {
    "rupture": {"weakest": "chemage_noting:Weakest"},
    "surface": {"skewed": "chemage_noting:Skewed"},
}
REGISTER = f"""
from chemage.plugin import hookimpl
from chemage_noting import CHEMAGE_OPTIONS, chemage_run_kinetics, chemage_solve_contact

@hookimpl
def chemage_register():
    return {KINDS!r}
"""
ROUGH = {"kind": "self-affine", "pixels": 32, "pixel_size": 0.5, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8}
SCENE = {
    "name": "noted",
    "surface": {"kind": "skewed", "inner": ROUGH},
    "contact": {"kind": "fft-bem", "load": "20 nN", "modulus": "35.3 GPa"},
    "forming": {"kind": "uniform", "lower": 0.7, "upper": 0.9},
    "breaking": {"kind": "uniform", "lower": 0.8, "upper": 0.9},
    "engine": {"kind": "rejection-free"},
    "rupture": {"kind": "weakest"},
    "plugins": {"noting": {}},
    "chemistry": {"site_density": "pixel"},
    "hold": {"start": "1 ms", "stop": "1e2 s", "per_decade": 1, "replicas": 3},
}
NUMBERS = {"skewness", "uneven", "most_bonds"}


@pytest.fixture
def noting(site):
    """The plugins of the page, installed."""
    site.install(
        "chemage-noting", {"chemage_noting.py": MODULE, "noting_plugin.py": REGISTER}, {"noting": "noting_plugin"}
    )
    with registry.using(registry.Registry()), warnings.catch_warnings():
        warnings.simplefilter("ignore", ca.PlanWarning)
        yield importlib.import_module("chemage_noting")


def test_the_plugins_of_the_page_are_short():
    assert len(BLOCKS) == 3
    assert sum(len(code.strip().splitlines()) for code in BLOCKS.values()) <= 80


@pytest.mark.long
@pytest.mark.parametrize("section", ["surface", "rupture"])
def test_they_meet_their_roles(noting, section):
    check_component(getattr(ca.parse_scene(SCENE), section))


def test_what_is_recorded_reaches_file_tables_and_comparison(noting, tmp_path, command):
    run = ca.run(SCENE)
    contact, ageing = run.contact, run.ageing
    assert set(run.measured) == {"quarters", "broken_share", "first", *NUMBERS}
    assert contact.measured["quarters"].unit == "nN"
    assert contact.measured["quarters"].values.sum() == pytest.approx(20)
    assert contact.observables["skewness"] == run.surface.observables["skewness"]
    np.testing.assert_array_equal(ageing.observables["most_bonds"], ageing.bonds.max(axis=1))
    np.testing.assert_array_equal(ageing.observables["first"], np.where(ageing.bonds > 0, 2.0, 0.0))
    assert ageing.measured["broken_share"].output == Output("hold_time", "", "bonds that broke, of those formed so far")
    for name in ("a.h5", "b.h5"):
        ca.write(tmp_path / name, run)
    again = ca.read(tmp_path / "a.h5")
    assert (again.contact, again.ageing) == (contact, ageing)
    assert again.summary()["observables"] == run.summary()["observables"]
    shown = command("show", tmp_path / "a.h5").out
    compared = command("compare", tmp_path / "a.h5", tmp_path / "b.h5").out
    for name in NUMBERS:
        words = run.measured[name].words[:20]
        assert words in shown, shown
        assert words in compared
    told = json.loads(command("show", tmp_path / "a.h5", "--json").out)
    assert told["observable.uneven"]["value"] == pytest.approx(float(contact.observables["uneven"]))


def test_it_is_the_same_in_parts_from_checkpoints_and_with_states(noting, tmp_path):
    scene = ca.parse_scene(SCENE)
    whole = ca.run(scene).ageing
    kept = ca.run(scene, checkpoints=tmp_path).ageing
    resumed = ca.run(scene, checkpoints=tmp_path)
    for one in (kept, resumed.ageing):
        assert one == whole
    assert resumed.contact.observables["uneven"] > 1

    class Looking(type(ca.rupture("weakest"))):
        """Asks for the states."""

        kind = "looking"
        states = True

    ca.register(Looking)
    states = ca.run({**SCENE, "rupture": {"kind": "looking"}}).ageing
    for name, values in whole.observables.items():
        np.testing.assert_array_equal(states.observables[name], values)


SWEPT = {**SCENE, "sweep": {"hold.temperature": [300, 310]}}


def swept(folder, **options):
    found = ca.sweep(SWEPT, folder, **options)
    assert found.states() == ["done", "done"]
    table = (folder / "results.csv").read_text().splitlines()
    for name in NUMBERS:
        assert f"observable.{name}" in table[0], table[0]
    return [point.summary["observables"] for point in found]


def test_sweeps_and_means_have_it(noting, tmp_path):
    here = swept(tmp_path / "here")
    assert here == swept(tmp_path / "threads", executor="threads")
    assert here[0]["skewness"] == here[1]["skewness"]
    assert here[0]["broken_share"] != here[1]["broken_share"]
    mean = ca.ensemble(SCENE, surfaces=3)
    for name in NUMBERS:
        assert np.isfinite(mean.estimate(f"observable.{name}").value)
    assert mean.summary()["observables"].keys() >= NUMBERS


@pytest.mark.long
@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_worker_processes_have_it_too(noting, tmp_path, executor):
    assert swept(tmp_path / "out", executor=executor, workers=1) == swept(tmp_path / "here")


# -- hooks, and what is wrong -----------------------------------------------------------------------------------------


def surface():
    return ca.make_surface(ca.surface("sphere", radius=30, pixels=16, pixel_size=0.9))


class Hook:
    """Records what a test tells it to."""

    def __init__(self, **values):
        self.values = values

    @hookimpl(wrapper=True)
    def chemage_make_surface(self):
        made = yield
        record(**self.values)
        return made


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"depth": 1.0}, "'depth' is recorded without its unit; give Output"),
        ({"depth": Output("x", "nm").of(1.0)}, r"output 'depth' has the shape \(\), but declares"),
        ({"depth": Output("hold_time", "nm").of([1.0])}, "no hold times at this stage"),
        ({"bonds": Output((), "").of(1)}, "every result has this name already"),
        ({"depth": Output((), "nm").of("deep")}, "give numbers"),
    ],
)
def test_what_a_hook_cannot_record(values, said):
    with registry.using(registry.Registry()) as installed:
        installed.register(Hook(**values), "noting")
        with pytest.raises(PluginError, match=said):
            surface()


def test_a_hook_records_and_the_next_stage_has_it():
    record(depth=Output((), "nm", "dropped, because no stage is running").of(2.0))
    with registry.using(registry.Registry()) as installed:
        installed.register(Hook(depth=Output((), "nm", "depth").of(2.5)), "noting")
        made = surface()
        assert made.measured["depth"].quantity().text() == "2.5 nm"
        assert ca.solve_contact(ca.contact("hertz", modulus=35.3), made, 5).observables["depth"] == 2.5
    assert surface().observables == {}


class Careless(ca.plugin.Engine):
    """Declares one thing and records another."""

    kind = "careless"
    inner: ca.plugin.Choice[ca.plugin.Engine]
    outputs = {"waits": Output((), "s", "waits")}
    said: ClassVar = {}

    def _run(self, lattice, hold_times, temperature, seed, start):
        self.record(**type(self).said)
        return self.inner.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({}, "engine 'careless' of .* declares the output 'waits' and does not record it"),
        ({"wait": 1.0}, "engine 'careless' records 'wait', which it does not declare"),
        ({"waits": [1.0]}, r"engine 'careless': output 'waits' has the shape \(1,\)"),
    ],
)
def test_an_engine_that_records_something_else_is_named(said, message, monkeypatch):
    monkeypatch.setattr(Careless, "said", said)
    contact = ca.solve_contact(ca.contact("hertz", modulus=35.3), surface(), 50)
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper=0.9))
    with pytest.raises(PluginError, match=message):
        ca.age(contact, chemistry, engine=Careless(inner="rejection-free"), hold_times=[1.0], temperature=300)


def test_two_of_one_name_are_found_before_anything_is_computed(noting):
    class Also(type(ca.rupture("weakest"))):
        """Has the output of the surface."""

        kind = "also"
        outputs = {"skewness": Output((), "", "as well")}

    ca.register(Also)
    with pytest.raises(SceneError, match=r"rupture: two components record 'skewness'; rename one"):
        ca.parse_scene({**SCENE, "rupture": {"kind": "also"}})
