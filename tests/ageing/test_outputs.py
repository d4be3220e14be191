"""Observables declare what they measure; it is checked, stored with dimensions and units, and shown everywhere."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import ClassVar

import h5py
import numpy as np
import pytest

import chemage as ca
from chemage import InputError, compare_files, parse_scene
from chemage.plugin import Output, PluginError, SceneError


class Slip(ca.plugin.Observable):
    """A number, a number at each hold time, and a map at each hold time."""

    kind = "slip"
    states = True
    outputs: ClassVar = {
        "bond_share": Output((), "", "fraction of the sites that are bonded at the end"),
        "bond_energy": Output("hold_times", "eV", "sum of the breaking barriers of the bonds"),
        "bond_map": Output(("hold_times", "x", "y"), "1/nm**2", "bonds per area"),
    }

    def measure(self, contact, lattice, history):
        maps = np.zeros((history.hold_times.size, contact.pressure.size))
        maps[:, lattice.sites] = history.states / contact.pixel_size**2
        return {
            "bond_share": history.state.mean() if history.state.size else 0.0,
            "bond_energy": history.states @ lattice.forming,
            "bond_map": maps.reshape(-1, *contact.shape),
        }


class Told(ca.plugin.Observable):
    """Declares and measures what a test tells it to."""

    kind = "told"
    declare: ClassVar = {}
    answer: ClassVar = {}

    @property
    def outputs(self):
        return type(self).declare

    def measure(self, contact, lattice, history):
        return {name: value(history) if callable(value) else value for name, value in type(self).answer.items()}


@pytest.fixture
def told():
    with ca.plugin.registry.using(ca.plugin.registry.Registry()):
        ca.register(Slip)
        ca.register(Told)
        Told.declare, Told.answer = {}, {}
        yield Told


def scene(*observe, **sections):
    return {
        "name": "tip",
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": [24, 28], "pixel_size": "0.9 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
        "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
        "chemistry": {"site_density": "pixel"},
        "engine": {"kind": "rejection-free"},
        "hold": {"start": "1 ms", "stop": "1e4 s", "per_decade": 1, "replicas": 3},
        "observe": [{"kind": kind} for kind in observe],
        **sections,
    }


def declares(told, **outputs):
    told.declare = outputs
    return parse_scene(scene("told"))


# -- declarations -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["a/b", "", ".hidden", "two words", "line\nbreak", "hold_times", "replica", "bonds", "µ", "x" * 101]
)
def test_unsafe_names_are_refused_before_anything_is_computed(told, name, monkeypatch):
    monkeypatch.setattr(ca.plugin.AgeingRequest, "follow", lambda *_, **__: pytest.fail("computed"))
    with pytest.raises(SceneError, match="observe: observable 'told': output"):
        declares(told, **{name: Output()})
    contact = ca.run({name: part for name, part in scene().items() if name in ("surface", "contact")})
    with pytest.raises(PluginError, match="observable 'told': output"):
        ca.age(
            contact.contact,
            ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper=1.2)),
            engine=ca.engine("rejection-free"),
            hold_times=[1.0],
            temperature=300,
            observe=[Told()],
        )


@pytest.mark.parametrize("name", ["a", "bond_share", "2d-map", "v1.5", "_x", "A-b.c_9"])
def test_safe_names_are_not(told, name):
    assert declares(told, **{name: Output()}).observe == (Told(),)


@pytest.mark.parametrize(
    ("outputs", "said"),
    [
        ({"a": ("x",)}, "output 'a' is a tuple; give a chemage.plugin.Output"),
        ({"a": Output(("x", "x"))}, "lists one dimension twice"),
        ({"a": Output(("a b",))}, "dimension 'a b' is no name"),
        ({"a": Output(("b",)), "b": Output(("c",))}, "dimension 'b' has the name of a variable"),
        ({"a": Output(("replica",))}, "dimension 'replica' has the name of a variable"),
        ({"a": Output((), 3)}, "unit and description must be strings"),  # pyright: ignore[reportArgumentType]
        ([Output()], "give a mapping"),
    ],
)
def test_what_is_no_declaration_is_refused(told, outputs, said):
    told.declare = outputs
    with pytest.raises(SceneError, match=said):
        parse_scene(scene("told"))


def test_two_observables_of_one_name_are_refused_before_anything_is_computed(told):
    told.declare = {"bond_share": Output()}
    with pytest.raises(SceneError, match=r"two components record 'bond_share'; rename one \(.*slip.* and .*told"):
        parse_scene(scene("slip", "told"))
    told.declare = {"x": Output()}
    with pytest.raises(SceneError, match="output 'x' has the name of a dimension of observable 'slip'"):
        parse_scene(scene("slip", "told"))


@pytest.mark.parametrize(
    ("outputs", "answer", "said"),
    [
        ({"a": Output()}, {}, "observable 'told' declares the output 'a' and does not measure it"),
        ({"a": Output()}, {"a": 1.0, "b": 2.0}, "observable 'told' measured 'b', which it does not declare"),
        ({"a": Output()}, {"a": [1.0]}, r"output 'a' has the shape \(1,\), but declares the dimensions \(\)"),
        ({"a": Output("hold_times")}, {"a": [1.0, 2.0]}, "output 'a' has 2 entries along 'hold_time', expected 8"),
        (
            {"a": Output("bin"), "b": Output("bin")},
            {"a": [1.0], "b": [1.0, 2.0]},
            "output 'b' has 2 entries along 'bin', expected 1",
        ),
        ({"a": Output()}, {"a": "much"}, "output 'a' has values of type <U4; give numbers"),
        ({}, {"a/b": 1.0}, "the name 'a/b' cannot be that of a variable in a file; rename it"),
        ({}, {".": 1.0}, "the name '.' cannot be"),
    ],
)
def test_what_is_measured_must_be_what_is_declared(told, outputs, answer, said):
    told.declare, told.answer = outputs, answer
    with pytest.raises(PluginError, match=said):
        ca.run(scene("told"))


# -- files ------------------------------------------------------------------------------------------------------------


def test_dimensions_units_and_descriptions_are_stored_and_read(told, tmp_path):
    run = ca.run(scene("slip", "barrier-spectrum", "pressure-spectrum"))
    ca.write(tmp_path / "a.h5", run)
    again = ca.read(tmp_path / "a.h5").ageing
    assert again == run.ageing
    assert again.measured["bond_map"].output == Slip.outputs["bond_map"]
    assert again.measured["barriers_start"].unit == "1/eV"
    ca.plugin.container.write(tmp_path / "a.npz", {"ageing": run.ageing}, compact=True)
    assert ca.plugin.container.read(tmp_path / "a.npz", {"ageing": ca.Ageing})[0]["ageing"] == run.ageing
    with h5py.File(tmp_path / "a.h5") as file:
        stored = file["ageing/observables/bond_energy"]
        assert (stored.attrs["units"], stored.attrs["long_name"]) == ("eV", Slip.outputs["bond_energy"].description)


def test_xarray_opens_them_with_their_dimensions(told, tmp_path):
    xarray = pytest.importorskip("xarray")
    told.declare, told.answer = {"other": Output("x", "nm")}, {"other": np.arange(5.0)}
    run = ca.run(scene("slip", "told", "barrier-spectrum"))
    ca.write(tmp_path / "a.h5", run)
    with xarray.open_dataset(tmp_path / "a.h5", group="ageing/observables", engine="h5netcdf") as data:
        assert data.bond_map.dims == ("replica", "hold_time", "x", "y")
        assert data.bond_map.sizes == {"replica": 3, "hold_time": 8, "x": 24, "y": 28}
        assert data.bond_energy.dims == ("replica", "hold_time")
        assert data.bond_share.dims == ("replica",)
        assert data.bond_energy.attrs["units"] == "eV"
        assert data.barriers_start.dims == ("replica", "barrier")
        # another observable's dimension of this name has another length
        assert data.other.dims == ("replica", "x_5")
        np.testing.assert_array_equal(data.bond_map, run.ageing.observables["bond_map"])
    with xarray.open_dataset(tmp_path / "a.h5", group="ageing", engine="h5netcdf") as data:
        assert data.bonds.dims == ("replica", "hold_time")
        assert "hold_time" in data.coords


def test_an_observable_without_declaration_works_as_before(told, tmp_path):
    told.answer = {"count": lambda h: float(h.bonds[-1]), "all bonds": lambda h: h.bonds}
    run = ca.run(scene("told"))
    assert run.ageing.outputs == {}
    ca.write(tmp_path / "a.h5", run)
    assert ca.read(tmp_path / "a.h5").ageing == run.ageing
    with h5py.File(tmp_path / "a.h5") as file:
        assert "outputs" not in file["ageing"].attrs
        assert "units" not in file["ageing/observables/count"].attrs
    (count,) = [one for one in run.ageing.quantities() if one.name == "observable.count"]
    assert count.value == pytest.approx(run.ageing.bonds[:, -1].mean())


def test_outputs_that_do_not_belong_to_an_observable_are_refused(examples):
    with pytest.raises(InputError, match="outputs: 'y' does not belong to an observable"):
        examples.ageing(outputs={"y": Output().todict()})
    with pytest.raises(InputError, match="outputs: 'x' does not belong to an observable with dims"):
        examples.ageing(outputs={"x": Output().todict()})


# -- states -----------------------------------------------------------------------------------------------------------


def test_an_observable_that_asks_for_the_states_changes_no_other_result(told):
    plain, seen = ca.run(scene()), ca.run(scene("slip"))
    for name in ("bonds", "events", "sites"):
        np.testing.assert_array_equal(getattr(plain.ageing, name), getattr(seen.ageing, name))
    area = seen.contact.pixel_size**2
    bonds = seen.ageing.observables["bond_map"].sum(axis=(2, 3)) * area
    np.testing.assert_allclose(bonds, plain.ageing.bonds, rtol=1e-12)


# -- the hook ---------------------------------------------------------------------------------------------------------


def test_a_hook_may_declare_what_it_measures(told):
    class Hook:
        @ca.plugin.hookimpl
        def chemage_observe(self, history):
            return {"gain": Output("hold_times", "nN", "gain").of(2.0 * history.bonds), "plain": 1.0}

    ca.plugin.registry.current().register(Hook(), "hook")
    found = ca.run(scene()).ageing
    assert found.measured["gain"].output == Output(("hold_times",), "nN", "gain")
    assert found.measured["plain"].output is None
    np.testing.assert_array_equal(found.observables["gain"], 2 * found.bonds)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (lambda h: {"a/b": Output().of(1.0)}, "hook chemage_observe of a plugin: output 'a/b' is no name"),
        (lambda h: {"a": Output("hold_times").of([1.0])}, "output 'a' has 1 entries along 'hold_time', expected 8"),
        (lambda h: [1.0], "measured list; give a mapping"),
    ],
)
def test_what_a_hook_declares_must_hold(told, answer, said):
    class Hook:
        @ca.plugin.hookimpl
        def chemage_observe(self, history):
            return answer(history)

    ca.plugin.registry.current().register(Hook(), "hook")
    with pytest.raises(PluginError, match=said):
        ca.run(scene())


# -- shown ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def two(told, tmp_path, monkeypatch):
    """Two results, of which one has the observable, in the working folder."""
    monkeypatch.chdir(tmp_path)
    made = ca.run(scene("slip")), ca.run(scene("pressure-spectrum"))
    for name, run in zip(("a", "b"), made, strict=True):
        ca.write(f"{name}.h5", run)
    return made


def test_show_and_json_have_them(two, command):
    shown = command("show", "a.h5").out
    energy = two[0].ageing.observables["bond_energy"][:, -1]
    words = "sum of the breaking barriers of the bonds at 10000 s"
    line = next(line for line in shown.splitlines() if words in line)
    value = line.replace(words, "").split()[0]
    digits = len(value.partition(".")[2])
    assert value == f"{energy.mean():.{digits}f}"
    assert line.rstrip().endswith("eV")
    assert "values from" not in shown
    assert "bond_map" in command("show", "a.h5", "--all").out
    assert "8 x 24 x 28 values from " in command("show", "a.h5", "--all").out
    told = json.loads(command("show", "a.h5", "--json").out)
    assert told["observable.bond_energy"]["unit"] == "eV"
    means = two[0].ageing.observables["bond_energy"].mean(axis=0)
    assert told["observable.bond_energy"]["value"] == pytest.approx(means)
    assert told["observable.bond_share"]["low"] <= told["observable.bond_share"]["value"]
    assert told["observables"]["bond_map"]["shape"] == [8, 24, 28]
    assert not {"bond_energy", "bond_share"} & told["observables"].keys()
    ca.write("ageing.h5", two[0].ageing)
    assert "8 x 24 x 28 values from " in command("show", "ageing.h5", "--all").out
    assert "values from" not in command("show", "ageing.h5").out


def test_compare_has_rows_of_them(two):
    made = compare_files(["a.h5", "b.h5"])
    rows = dict(made.table())
    assert rows["fraction of the sites that are bonded at the end"][1] == "-"
    energy = "sum of the breaking barriers of the bonds"
    assert rows[f"{energy} at the last hold time"][0].endswith(" eV")
    assert set(rows) >= {f"{energy} at 1 s", f"{energy} at 1000 s"}
    first, second = made.numbers()
    assert first["observable.bond_share"] == pytest.approx(two[0].ageing.observables["bond_share"].mean())
    assert second["observable.bond_share"] is None
    energy = two[0].ageing.observables["bond_energy"][:, -1].mean()
    assert first["at"][-1]["observable.bond_energy"] == pytest.approx(energy)
    lines = list(csv.DictReader(made.csv().splitlines()))
    assert float(lines[0]["observable.bond_energy at last (eV)"]) == pytest.approx(energy)
    assert "observable.bond_energy_half_width at last (eV)" in lines[0]
    assert lines[1]["observable.bond_share"] == ""


@pytest.mark.long
def test_a_report_has_rows_of_them(two):
    ca.write_report(["a.h5"], "a.html")
    text = Path("a.html").read_text(encoding="utf-8")
    assert "sum of the breaking barriers of the bonds at 10000 s" in text
    assert "fraction of the sites that are bonded at the end" in text


def test_a_sweep_has_columns_of_them(told, tmp_path):
    grid = {"contact.load": ["30 nN", "50 nN"]}
    swept = ca.sweep({**scene("slip"), "sweep": grid}, out=tmp_path / "s")
    rows = list(csv.DictReader((tmp_path / "s" / "results.csv").read_text().splitlines()))
    for row, point in zip(rows, swept, strict=True):
        assert point.ageing() == ca.run(point.scene()).ageing  # a sweep keeps it as JSON
        seen = point.ageing().measured
        assert float(row["observable.bond_share"]) == pytest.approx(seen["bond_share"].values.mean())
        assert float(row["last observable.bond_energy (eV)"]) == pytest.approx(seen["bond_energy"].values[:, -1].mean())
        assert float(row["last observable.bond_energy_half_width (eV)"]) > 0
        assert seen["bond_map"].output == Slip.outputs["bond_map"]
        assert not [name for name in row if "bond_map" in name]
    table = swept.table()
    assert "observable.bond_share" in swept.to_pandas().columns
    data = table.to_xarray()
    assert data["observable.bond_energy"].dims == ("load", "hold_time")
    assert data["observable.bond_energy"].attrs == {"units": "eV", "long_name": Slip.outputs["bond_energy"].description}
    swept.write_tables()
    with h5py.File(tmp_path / "s" / "results.h5") as file:
        assert file["observable.bond_energy"].shape == (2, 8)
