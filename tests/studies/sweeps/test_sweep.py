"""Sweeps: which points there are, what they share, what is kept of them."""

from __future__ import annotations

import csv
import json
import re
import sys
import tomllib
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
import xarray
from seen import read_grid, scene_schema, survey_of

import chemage
from chemage import Ageing, InputError, parse_scene
from chemage.foundation.codec import from_json, to_json
from chemage.kinetics.hooks import REPLICA_SECONDS
from chemage.plugin import SceneError, StoreError, override
from chemage.studies.sweeps.grid import Grid, cpu_seconds
from chemage.studies.sweeps.running import SweepProgress
from chemage.studies.sweeps.table import short_names
from chemage.studies.tasks import by_contact

AXES = """
[sweep]
"surface.height" = [1.0, 2.0]
contact.load = ["5 nN", 10.0, "0.02 uN"]

[[sweep.zip]]
hold.seed = [0, 1]
"hold.temperature" = [300, "310 K"]
"""


def swept(tiny, text, **sections):
    return {**tiny.scene(**sections), **tomllib.loads(dedent(text))}


# -- the grid ---------------------------------------------------------------------------------------------------------


def test_every_line_is_an_axis_and_a_zip_is_one(tiny):
    grid = read_grid(swept(tiny, AXES))
    assert [axis.paths for axis in grid.axes] == [
        ("surface.height",),
        ("contact.load",),
        ("hold.seed", "hold.temperature"),
    ]
    assert grid.shape == (2, 3, 2)
    assert grid.size == 12
    changes = [grid.changes(point) for point in range(12)]
    assert changes[0] == {
        "surface.height": 1.0,
        "contact.load": "5 nN",
        "hold.seed": 0,
        "hold.temperature": 300,
    }
    assert changes[1] == {**changes[0], "hold.seed": 1, "hold.temperature": "310 K"}, "the last axis moves fastest"
    assert changes[11] == {**changes[1], "surface.height": 2.0, "contact.load": "0.02 uN"}
    assert len({json.dumps(change) for change in changes}) == 12


def test_dotted_and_nested_lines_mean_the_same(tiny):
    dotted = read_grid(swept(tiny, '[sweep]\n"contact.load" = [1, 2]\n"hold.seed" = [0, 1]'))
    nested = read_grid(swept(tiny, "[sweep.contact]\nload = [1, 2]\n[sweep.hold]\nseed = [0, 1]"))
    assert survey_of(dotted).digest == survey_of(nested).digest


def test_a_whole_section_is_replaced_before_a_field_in_it_is_set(tiny):
    text = """
    [sweep]
    "surface.height" = [3.0, 4.0]
    surface = [{kind = "tiny-tip", pixels = 5}, {kind = "tiny-tip", pixels = 7, height = 9.0}]
    """
    grid = read_grid(swept(tiny, text))
    scenes = [grid.scene(point) for point in range(4)]
    assert [(one.surface.pixels, one.surface.height) for one in scenes] == [(5, 3.0), (7, 3.0), (5, 4.0), (7, 4.0)]


def test_values_of_one_point_do_not_leak_into_the_next(tiny):
    grid = read_grid(swept(tiny, '[sweep]\nsurface = [{kind = "tiny-tip"}]\n"surface.height" = [3.0]'))
    grid.data(0)
    assert grid.changes(0)["surface"] == {"kind": "tiny-tip"}


def test_false_leaves_a_section_out(tiny):
    text = """
    [sweep]
    breaking = [false, {kind = "tiny-flat"}]
    """
    scenes = [read_grid(swept(tiny, text)).scene(point) for point in (0, 1)]
    assert scenes[0].chemistry.breaking is None
    assert scenes[1].chemistry.breaking is not None


def test_a_position_in_a_list_can_be_set():
    data = {"observe": [{"kind": "a", "bins": 1}, {"kind": "b", "bins": 2}]}
    assert override(data, {"observe.1.bins": 5})["observe"][1] == {"kind": "b", "bins": 5}
    assert override(data, {"observe.0": None})["observe"] == [data["observe"][1]]
    assert data["observe"][1]["bins"] == 2
    with pytest.raises(InputError, match=r"observe\.7\.bins: '7' is no position in a list of 2"):
        override(data, {"observe.7.bins": 1})


def test_a_swept_file_is_looked_for_beside_the_scene(tmp_path, monkeypatch):
    (tmp_path / "scenes").mkdir()
    file = tmp_path / "scenes" / "s.toml"
    file.write_text('[surface]\nkind = "from-file"\npath = "x.npy"\n[sweep]\nsurface.path = ["a.npy", "/abs/b.npy"]\n')
    monkeypatch.chdir(tmp_path)
    grid = read_grid("scenes/s.toml")
    assert grid.base["surface"]["path"] == str(tmp_path / "scenes" / "x.npy")
    assert [value for (value,) in grid.axes[0].values] == [str(tmp_path / "scenes" / "a.npy"), "/abs/b.npy"]


def test_a_grid_survives_json(tiny):
    grid = read_grid(swept(tiny, AXES))
    again = Grid.fromdict(json.loads(json.dumps(grid.todict())))
    assert again == grid


# -- what points share ------------------------------------------------------------------------------------------------


def test_points_share_contacts_and_surfaces(tiny):
    found = survey_of(read_grid(swept(tiny, AXES)))
    assert len(found.keys) == len(set(found.keys)) == 12
    assert len(found.contacts) == 6
    assert found.surfaces == 2
    assert [found.contacts[task.contact].number for task in found.tasks] == [0, 0, 2, 2, 4, 4, 6, 6, 8, 8, 10, 10]


def test_contacts_of_one_surface_follow_each_other(tiny):
    text = '[sweep]\n"contact.load" = [1, 2, 3]\n"surface.seed" = [4, 5]'
    contacts = by_contact(survey_of(read_grid(swept(tiny, text))).tasks)
    surfaces = [ageings[0][0].surface for ageings in contacts]
    assert surfaces == [surfaces[0]] * 3 + [surfaces[3]] * 3


def test_the_digest_is_of_what_is_meant_not_of_how_it_is_written(tiny):
    def digest(text):
        return survey_of(read_grid(swept(tiny, text))).digest

    one = digest('[sweep]\n"contact.load" = ["5 nN", "0.01 uN"]')
    assert digest('[sweep]\n"contact.load" = [5.0, 10]') == one
    assert digest('[sweep]\n"contact.load" = [5.0, 11]') != one
    assert digest('[sweep]\n"contact.load" = [10, 5.0]') != one


def test_speed_and_names_are_in_no_key(tiny):
    def keys(**sections):
        return parse_scene(tiny.scene(**sections)).keys()

    one = keys()
    assert keys(name="other", title="another") == one
    assert keys(engine={"kind": "tiny-coin", "pause": 0.5}) == one, "pause is speed_only"
    assert keys(engine={"kind": "tiny-coin", "bias": 0.5})["ageing"] != one["ageing"]
    hard = keys(chemistry={"hardness": "10 GPa", "site_density": "pixel"})
    assert hard["ageing"] == one["ageing"]
    assert hard["result"] != one["result"]
    refit = keys(fit={"start": 2.0, "stop": 1e3})
    assert refit["result"] != one["result"]
    assert refit["ageing"] == one["ageing"]


def test_threads_of_a_contact_solver_are_in_no_key():
    base = {"surface": {"kind": "sphere", "radius": 30, "pixels": 8, "pixel_size": 1}}
    keys = [
        parse_scene({**base, "contact": {"kind": "fft-bem", "modulus": 35, "load": 1, **more}}).keys()
        for more in ({}, {"threads": 1}, {"threads": 3}, {"tolerance": 1e-4})
    ]
    assert keys[0] == keys[1] == keys[2] != keys[3]


def test_costs_are_of_distinct_stages(tiny):
    found = survey_of(read_grid(swept(tiny, AXES)))
    # 6 contacts and 12 points of 2 replicas, a hundredth of a second each beside what chemage itself does
    replica = 0.01 + REPLICA_SECONDS
    assert cpu_seconds(found.tasks) == pytest.approx(6 * 0.01 + 24 * replica, rel=0.01)
    text = '[sweep]\n"fit.stop" = [1e2, 1e3]'
    assert cpu_seconds(survey_of(read_grid(swept(tiny, text))).tasks) == pytest.approx(0.01 + 2 * replica, rel=0.01)


def test_each_stage_is_computed_once_for_all_points_that_share_it(tiny, tmp_path):
    chemage.sweep(swept(tiny, AXES), tmp_path / "out")
    assert len(tiny.computed("surface")) == 2
    assert len(tiny.computed("contact")) == 6
    assert len(tiny.computed("kinetics")) == 24
    # points follow their contact, while it and its surface are in memory
    words = [line.split()[0] for line in tiny.computed()]
    assert words == 2 * ["surface", *(3 * ["contact", *(4 * ["kinetics"])])]


def test_points_that_differ_in_the_limits_of_the_material_share_the_kinetics(tiny, tmp_path):
    text = '[sweep]\n"chemistry.hardness" = ["0.01 GPa", "1e6 GPa"]'
    result = chemage.sweep(swept(tiny, text), tmp_path / "out")
    assert len(tiny.computed("kinetics")) == 2
    assert [point.summary["load_above_hardness"] for point in result] == [1.0, 0.0]
    assert [point.ageing().elasticity["hardness"] for point in result] == [0.01, 1e6]
    assert np.array_equal(result[0].ageing().bonds, result[1].ageing().bonds)
    assert result[0].summary["keys"]["ageing"] == result[1].summary["keys"]["ageing"]
    assert len(result[0].run().notes) == len(result[1].run().notes) + 1
    for point in result:
        assert point.run().summary() == point.summary
    assert result.table().results["area_above_hardness"].values.tolist() == [1.0, 0.0]
    header = (tmp_path / "out" / "results.csv").read_text().splitlines()[0].split(",")
    assert {"area_above_hardness", "load_above_hardness", "mean_shear_stress (GPa)"} <= set(header)
    assert "shear_strength (GPa)" not in header, "no point has one"


def test_points_that_differ_in_their_fit_share_the_kinetics(tiny, tmp_path):
    result = chemage.sweep(swept(tiny, '[sweep]\n"fit.stop" = [1e2, 1e3]'), tmp_path / "out")
    assert len(tiny.computed("kinetics")) == 2
    assert result[0].ageing() == result[1].ageing()
    assert [point.summary["beta"] for point in result] == [
        pytest.approx(point.ageing().fit(1.0, stop).beta) for point, stop in zip(result, (1e2, 1e3), strict=True)
    ]
    assert result[0].summary["beta"] != result[1].summary["beta"]
    assert result[0].summary["keys"]["ageing"] == result[1].summary["keys"]["ageing"]
    assert result[0].summary["keys"]["result"] != result[1].summary["keys"]["result"]


def test_equal_points_are_computed_once(tiny, tmp_path):
    result = chemage.sweep(swept(tiny, '[sweep]\n"contact.load" = ["5 nN", 5.0, 6.0]'), tmp_path / "out")
    assert result.states() == ["done"] * 3
    assert len(tiny.computed("kinetics")) == 4
    assert result[0].key == result[1].key


# -- what is computed -------------------------------------------------------------------------------------------------


def test_a_point_equals_the_run_of_its_scene(tiny, tmp_path):
    result = chemage.sweep(swept(tiny, AXES), tmp_path / "out")
    for point in (result[0], result[7]):
        made = chemage.run(point.scene())
        expected = made.summary()
        seen = dict(point.summary)
        for name in ("timings", "versions"):
            expected.pop(name), seen.pop(name)
        assert seen == expected
        assert np.array_equal(point.ageing().bonds, made.ageing.bonds)
        assert np.array_equal(point.contact().pressure, made.contact.pressure)


def test_a_scene_without_chemistry_stops_at_the_contact(tiny, tmp_path):
    scene = {name: part for name, part in tiny.scene().items() if name in ("name", "surface", "contact")}
    result = chemage.sweep({**scene, "sweep": {"contact.load": [0.0, 5.0]}}, tmp_path / "out")
    assert result.states() == ["done", "done"]
    assert [point.summary["area_fraction"] for point in result] == [0.0, 0.5]
    assert result[0].summary["beta"] is None
    assert np.isnan(result.table().results["beta"].values).all()
    with xarray.open_dataset(result.folder / "results.h5") as file:
        assert list(file["area_fraction"].values) == [0.0, 0.5]
        assert file.sizes["hold_time"] == 0
    with pytest.raises(StoreError, match="its scene stops at the contact"):
        result[0].ageing()


def test_a_run_again_computes_nothing(tiny, tmp_path):
    chemage.sweep(swept(tiny, AXES), tmp_path / "out")
    tiny.forget()
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*.json")}
    again = chemage.sweep(swept(tiny, AXES), tmp_path / "out")
    assert tiny.computed() == []
    assert again.states() == ["done"] * 12
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*.json")} == before


def test_force_computes_everything_anew(tiny, tmp_path):
    chemage.sweep(swept(tiny, AXES), tmp_path / "out")
    tiny.forget()
    chemage.sweep(swept(tiny, '[sweep]\n"contact.load" = [1]'), tmp_path / "out", force=True)
    assert len(tiny.computed("kinetics")) == 2
    assert len(list((tmp_path / "out").rglob("points/*/*.json"))) == 1


def test_other_versions_are_told(tiny, tmp_path):
    chemage.sweep(swept(tiny, AXES), tmp_path / "out")
    folder = chemage.load_sweep(tmp_path / "out").store
    content = folder.read_manifest()
    content["versions"]["numpy"] = "1.0.0"
    folder.clear_parts()
    folder.write_manifest(content)
    with pytest.warns(UserWarning, match=r"numpy 1\.0\.0 -> "):
        chemage.sweep(swept(tiny, AXES), tmp_path / "out")


def test_progress_tells_how_far_and_how_long(tiny, tmp_path):
    seen: list[SweepProgress] = []
    engine = {"kind": "tiny-coin", "pause": 0.02}
    chemage.sweep(swept(tiny, AXES, engine=engine), tmp_path / "out", progress=seen.append, threads=1)
    computing = [one for one in seen if one.stage == "computing"]
    assert seen[0].stage == "validating"
    assert computing[-1].done == 12
    assert computing[-1].contacts_done == 6
    assert computing[-1].remaining == 0
    halfway = next(one for one in computing if 3 <= one.done <= 9)
    # 12 points of 2 replicas and a fiftieth of a second
    assert 0.04 * (12 - halfway.done) * 0.5 < halfway.remaining < 0.04 * (12 - halfway.done) * 4 + 0.3


def test_progress_in_words():
    state = SweepProgress("computing", 100, 40, 2, 10, 4, 2, 60.0, 3725.0)
    assert str(state) == "sweep: 40 of 100 points, 2 failed, 4 of 10 contacts, 1 h 02 min left"
    state = SweepProgress("computing", 100, 40, 0, 10, 4, 2, 60.0, 61.0)
    assert str(state) == "sweep: 40 of 100 points, 4 of 10 contacts, 1 min 01 s left"
    state = SweepProgress("computing", 100, 0, 0, 10, 0, 2, 60.0, None)
    assert str(state) == "sweep: 0 of 100 points, 0 of 10 contacts, remaining time not known yet"


# -- results ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def result(tiny, tmp_path):
    return chemage.sweep(swept(tiny, AXES), tmp_path / "out")


def test_points_are_found_by_value(result):
    found = result.where({"contact.load": "0.02 uN", "surface.height": 2.0})
    assert [point.index for point in found] == [10, 11]
    assert [point.index for point in result.where({"contact.load": 20.0, "surface.height": 2})] == [10, 11]
    assert result.where({"contact.load": 21.0}) == []
    with pytest.raises(InputError, match=r"is not swept; swept are surface\.height, contact\.load, "):
        result.where({"surface.radius": 1})


def test_a_result_is_a_sequence(result):
    assert len(result) == 12
    assert result[-1].index == 11
    assert [point.index for point in result] == list(range(12))
    with pytest.raises(IndexError, match="point 12 of a sweep of 12"):
        result[12]
    assert result[1].values == {
        "surface.height": 1.0,
        "contact.load": 5.0,
        "hold.seed": 1,
        "hold.temperature": 310.0,
    }


def test_status_counts_by_value_of_each_axis(result):
    result.store.point(result.keys[3]).unlink()
    state = chemage.load_sweep(result.folder).status()
    assert (state["points"], state["done"], state["failed"], state["missing"]) == (12, 11, 0, 1)
    loads = state["axes"][1]
    assert loads["axis"] == "contact.load"
    assert [(row["values"], row["done"], row["missing"]) for row in loads["rows"]] == [
        ({"contact.load": "5 nN"}, 4, 0),
        ({"contact.load": 10.0}, 3, 1),
        ({"contact.load": "0.02 uN"}, 4, 0),
    ]


def test_the_csv_has_a_line_for_each_point(result):
    with open(result.folder / "results.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["contact.load (nN)"]) for row in rows] == [5, 5, 10, 10, 20, 20] * 2
    assert [float(row["hold.temperature (K)"]) for row in rows] == [300.0, 310.0] * 6
    for row, point in zip(rows, result, strict=True):
        assert row["status"] == "done"
        assert float(row["beta"]) == point.summary["beta"], "to the last digit"
        assert float(row["last friction_drop (nN)"]) == point.summary["friction_drop"][-1]
        assert float(row["last hold_time (s)"]) == 1000.0


def test_xarray_reads_the_file_as_it_reads_the_folder(result):
    with xarray.open_dataset(result.folder / "results.h5") as file:
        stored = file.load()
    made = result.to_xarray()
    assert stored.sizes == made.sizes == {"height": 2, "load": 3, "temperature": 2, "hold_time": 4, "replica": 2}
    for name in made.variables:
        np.testing.assert_array_equal(stored[name].values, made[name].values, err_msg=name)
        assert stored[name].attrs["long_name"] == made[name].attrs["long_name"]
        assert stored[name].attrs.get("units") == made[name].attrs.get("units")
    assert stored["load"].attrs == {"units": "nN", "long_name": "swept", "path": "contact.load"}
    assert stored["friction_drop"].attrs["units"] == "nN"
    for data in (stored, made):
        for point in result:
            place = data.sel(
                height=point.values["surface.height"],
                load=point.values["contact.load"],
                temperature=point.values["hold.temperature"],
            )
            assert place["point"] == point.index
            assert place["status"] == "done"
            assert np.array_equal(place["bonds"].values, point.ageing().bonds)
            assert place["beta"] == point.summary["beta"]
            half = np.array(point.summary["friction_drop_half_width"], dtype=float)  # None: not known
            assert np.array_equal(place["friction_drop_half_width"].values, half, equal_nan=True)
            assert place["seed"] == point.values["hold.seed"], "it varies together with the temperature"


def test_points_that_are_missing_are_nan_and_say_so(result):
    result.store.point(result.keys[4]).unlink()
    data = chemage.load_sweep(result.folder).to_xarray()
    place = np.unravel_index(4, (2, 3, 2))
    assert data["status"].values[place] == "missing"
    assert (data["status"] == "done").sum() == 11
    assert np.isnan(data["beta"].values[place])
    assert np.isnan(data["friction_drop"].values[place]).all()
    assert (data["bonds"].values[place] == -1).all()
    assert np.isfinite(data["beta"].values).sum() == 11


def test_names_of_dimensions_are_short_where_they_are_clear():
    paths = ["contact.load", "surface.seed", "hold.seed", "surface.rms_slope", "engine.kind", "surface"]
    assert short_names(paths, {"rms_slope"}) == {
        "contact.load": "load",
        "surface.seed": "surface_seed",
        "hold.seed": "hold_seed",
        "surface.rms_slope": "surface_rms_slope",
        "engine.kind": "engine",
        "surface": "surface",
    }
    assert short_names(["observe.0.replica"]) == {"observe.0.replica": "observe_0_replica"}


@pytest.mark.parametrize(("library", "method"), [("xarray", "to_xarray"), ("pandas", "to_pandas")])
def test_a_library_that_is_not_installed_is_named_with_its_extra(result, monkeypatch, library, method):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=rf"{library} is not installed; run: pip install 'chemage\[xarray\]'"):
        getattr(result, method)()


def test_pandas_has_a_row_for_each_point(result):
    frame = result.to_pandas()
    assert list(frame.index) == list(range(12))
    assert frame.loc[5, "beta"] == result[5].summary["beta"]
    assert frame.groupby("contact.load").size().to_dict() == {5.0: 4, 10.0: 4, 20.0: 4}


def test_hold_times_that_differ_are_padded(tiny, tmp_path):
    text = """
    [sweep]
    "hold.times" = [[1.0, 10.0], [1.0, 10.0, 100.0]]
    "hold.replicas" = [1, 3]
    """
    scene = swept(tiny, text, fit={"start": 1.0, "stop": 10.0})
    result = chemage.sweep(scene, tmp_path / "out")
    table = result.table()
    assert table.hold_times.shape == (4, 3)
    assert np.isnan(table.hold_times[0, 2])
    assert np.isnan(table.results["friction_drop"].values[:2, 2]).all()
    assert table.bonds.shape == (4, 3, 3)
    assert (table.bonds[0, 1:] == -1).all()
    assert np.array_equal(table.bonds[3], result[3].ageing().bonds)
    assert result.to_xarray()["hold_times"].dims == ("times", "replicas", "hold_time")
    with open(tmp_path / "out" / "results.csv", newline="") as stream:
        assert [float(row["last hold_time (s)"]) for row in csv.DictReader(stream)] == [10, 10, 100, 100]


def test_sections_and_words_are_text_in_the_table(tiny, tmp_path):
    text = """
    [sweep]
    breaking = [false, {kind = "tiny-flat", top = 1.2}]
    "engine.trouble" = ["", "other"]
    """
    table = chemage.sweep(swept(tiny, text), tmp_path / "out").table()
    assert list(table.swept["breaking"]) == ["false", "false", "tiny-flat top=1.2", "tiny-flat top=1.2"]
    assert list(table.swept["engine.trouble"]) == ["", "other", "", "other"]


# -- what is kept -----------------------------------------------------------------------------------------------------


def test_packed_ageing_is_the_same_ageing():
    ageing = Ageing(
        hold_times=[0.1, 1.0 + 1e-15, 1e5],
        bonds=[[1, 2, 3], [0, 2, 2**31]],
        sites=[5, 2**32],
        events=[7, 8],
        load=20.0,
        temperature=300.0,
        engine="bkl",
        contact={"kappa": float("nan"), "area": 0.1 + 0.2},
        observables={"a": np.array([[np.nan, 1e-300], [np.inf, 2.0]]), "b": np.array([1, 2], dtype=np.int8)},
        provenance={"seed": "3"},
    )
    assert from_json(Ageing, json.loads(json.dumps(to_json(ageing)))) == ageing


def test_observables_come_back_from_the_folder(tiny, site, tmp_path):
    class Plugin:
        @staticmethod
        @chemage.plugin.hookimpl
        def chemage_observe(contact, history):
            return {"largest": contact.pressure.max(), "state": history.state.astype(np.float64)}

    chemage.plugin.registry.current().register(Plugin, "observer")
    result = chemage.sweep(swept(tiny, '[sweep]\n"contact.load" = [1.0, 2.0]'), tmp_path / "out")
    made = chemage.run(result[1].scene()).ageing
    assert result[1].ageing().observables["state"].shape == (2, 18)
    assert result[1].ageing() == made


def test_notes_of_contact_and_ageing_come_back_from_the_folder(tiny, tmp_path):
    result = chemage.sweep(swept(tiny, '[sweep]\n"contact.load" = [1.0, 2.0]'), tmp_path / "out")
    alone = chemage.run(result[1].scene())
    assert alone.ageing.notes == ("tossed",)
    doubt = alone.fit().doubt
    for point in chemage.load_sweep(tmp_path / "out"):
        assert point.ageing().notes == alone.ageing.notes
        assert point.run().notes == alone.notes == ("even", "tossed", doubt)
        assert point.summary["notes"] == ["even", "tossed", doubt]
    assert result[1].ageing() == alone.ageing


def test_a_point_that_is_not_there_says_so(tiny, result):
    result.store.point(result.keys[2]).unlink()
    again = chemage.load_sweep(result.folder)
    assert again[2].status == "missing"
    with pytest.raises(StoreError, match=r"point 2 of .* is missing"):
        again[2].ageing()


def test_only_a_sweep_is_swept(tiny, tmp_path):
    with pytest.raises(SceneError, match="sweep: is missing: this scene is one point"):
        chemage.sweep(tiny.scene(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


# -- documents --------------------------------------------------------------------------------------------------------

PAGE = Path(__file__).parents[3] / "docs" / "sweeps.md"
EXAMPLES = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_the_sweeps_of_the_page_are_valid_at_every_point():
    base, _ = chemage.plugin.scene_data("silica-rough")
    sizes = [survey_of(read_grid({**base, **tomllib.loads(text)})).grid.size for text in EXAMPLES if "[sweep]" in text]
    assert sizes == [36, 8, 5]


def test_the_schema_knows_sweeps():
    import jsonschema

    validator = jsonschema.Draft202012Validator(scene_schema())
    base, _ = chemage.plugin.scene_data("silica-rough")

    def wrong(sweep):
        return [".".join(map(str, error.absolute_path)) for error in validator.iter_errors({**base, "sweep": sweep})]

    for text in (AXES, *EXAMPLES):
        assert wrong(tomllib.loads(dedent(text)).get("sweep", {"a": [1]})) == []
    assert wrong({"contact.load": []}) == ["sweep.contact.load"]
    assert wrong({"contact.load": 3}) == ["sweep.contact.load"]
    assert wrong({"zip": {"a": [1]}}) == ["sweep.zip"]
    assert wrong({}) == ["sweep"]


def test_a_scene_is_swept_along_axes_that_are_given(tiny, tmp_path):
    """Data and a Scene give the same points; arrays of numpy and of pint are values of an axis."""
    import pint

    axes = {"contact.load": [10.0, 20.0], "hold.replicas": (1, 2)}
    scene = chemage.parse_scene(tiny.scene())
    made = chemage.sweep(scene, tmp_path / "scene", axes=axes)
    data = chemage.sweep(tiny.scene(), tmp_path / "data", axes=axes)
    loads = pint.UnitRegistry().Quantity([10, 20], "nN")
    again = chemage.sweep(scene, tmp_path / "pint", axes={"contact.load": loads, "hold.replicas": np.array([1, 2])})
    for result in (made, data, again):
        assert result.table().results["load"].values.tolist() == [10, 10, 20, 20]
    with pytest.raises(SceneError, match="give axes"):
        chemage.sweep(scene, tmp_path / "none")
