"""Scenes: the same experiment has the same keys however it is written; a stage's key moves with what it rests on."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from seen import heading, read_grid

from chemage import InputError, load_scene, parse_scene
from chemage.plugin import SceneError, StoreError, convert, override, registry, scene_data


@pytest.fixture
def data(small):
    return scene_data(small)[0]


# -- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("section", "slip", "meant"),
    [("contact", "lod", "load"), ("surface", "sed", "seed"), ("contact", "modlus", "modulus")],
)
def test_a_slip_of_the_pen_is_answered_from_all_fields_of_its_section(data, section, slip, meant):
    data[section][slip] = 1
    with pytest.raises(SceneError) as error:
        parse_scene(data)
    assert f"{section}.{slip}: no such option (did you mean '{meant}'?)" in str(error.value)
    assert meant in str(error.value).rpartition("the options are ")[2]


# -- titles ----------------------------------------------------------------------------------------------------------


def test_a_title_is_left_out_where_the_values_are_others_than_it_says():
    """ "at 50 nN" is no title of a contact at 100 nN; what is printed then comes from the values."""
    assert heading(load_scene("silica-tip").todict()) == "Silica tip of 30 nm radius at 50 nN"
    other = load_scene("silica-tip", {"contact.load": "100 nN"})
    assert other.title == ""
    assert heading(other.todict()) == "silica-tip: sphere at 100 nN"
    assert heading(load_scene("silica-rough", {"surface.hurst": 0.7}).todict()) == "silica-rough: self-affine at 20 µN"
    assert load_scene("silica-tip", {"hold.seed": 3, "hold.replicas": 2}).title
    assert load_scene("silica-tip", {"contact.load": "100 nN", "title": "mine"}).title == "mine"
    grid = read_grid("silica-tip", axes={"contact.load": [50.0, 100.0]})
    assert grid.scene(1).title == ""
    assert read_grid("silica-tip", axes={"hold.seed": [1, 2]}).scene(1).title


# -- keys ------------------------------------------------------------------------------------------------------------


def test_keys_do_not_depend_on_how_it_is_written(data):
    plain = parse_scene(data)
    spelled = override(
        data,
        {
            "title": data["title"],
            "surface.pixels": [48, 48],
            "surface.pixel_size": "4.518 angstrom",
            "contact.load": 40.0,
            "contact.modulus": "35300 MPa",
            "contact.tolerance": 1e-5,
            "hold.start": 0.001,
            "hold.stop": "100 ks",
            "hold.temperature": "26.85 degC",
            "chemistry.activation_volume": "0.0064 nm**3",
            "chemistry.bond_force": "3 nN",
            "chemistry.hydroxylation": 1,
            "breaking.mean": 1.1,
            "interaction.strength": "500 meV",
        },
    )
    backwards = dict(reversed(list(spelled.items())))
    for other in (parse_scene(spelled), parse_scene(backwards)):
        assert other == plain
        assert other.keys() == plain.keys()
        assert other.digest() == plain.digest()


def test_20_micronewton_is_20000(data):
    assert parse_scene(override(data, {"contact.load": "20 uN"})).load == 20000.0
    one, two = (parse_scene(override(data, {"contact.load": load})).keys() for load in ("20 uN", 20000))
    assert one == two


STAGES = ("surface", "contact", "ageing", "result")


@pytest.mark.parametrize(
    ("change", "first"),
    [
        ({"surface.rms_slope": 0.2}, "surface"),
        ({"surface.seed": 2}, "surface"),
        ({"surface.pixels": 50}, "surface"),
        ({"contact.load": 41}, "contact"),
        ({"contact.modulus": 36}, "contact"),
        ({"contact.tolerance": 1e-4}, "contact"),
        ({"forming": {"kind": "uniform", "lower": 1.0, "upper": 1.2}}, "ageing"),
        ({"breaking.mean": 1.2}, "ageing"),
        ({"breaking": None}, "ageing"),
        ({"interaction.strength": 0.4}, "ageing"),
        ({"interaction": None}, "ageing"),
        ({"chemistry.activation_volume": 0}, "ageing"),
        ({"chemistry.bond_force": 2}, "ageing"),
        ({"engine.kind": "bkl"}, "ageing"),
        ({"hold.replicas": 4}, "ageing"),
        ({"hold.seed": 6}, "ageing"),
        ({"hold.stop": "1e4 s"}, "ageing"),
        ({"hold.temperature": 301}, "ageing"),
        ({"observe": None}, "ageing"),
        ({"observe": [{"kind": "barrier-spectrum", "bins": 7}]}, "ageing"),
        ({"fit": {"start": "1 s"}}, "result"),
        ({"name": "other"}, None),
        ({"title": "another"}, None),
        ({"contact.threads": 1}, None),
    ],
)
def test_a_key_moves_with_what_its_stage_rests_on_and_with_nothing_else(data, change, first):
    before, after = parse_scene(data).keys(), parse_scene(override(data, change)).keys()
    moved = [stage for stage in STAGES if before[stage] != after[stage]]
    assert moved == list(STAGES[STAGES.index(first) :] if first else ())


def test_an_edited_height_map_is_another_surface(small):
    np.save("h.npy", np.zeros((4, 4)))
    scene = {
        "surface": {"kind": "from-file", "path": "h.npy", "pixel_size": 1.0},
        "contact": {"kind": "fft-bem", "modulus": 30.0, "load": 1.0},
    }
    one = parse_scene(scene).keys()
    assert parse_scene(scene).keys() == one
    np.save("h.npy", np.ones((4, 4)))
    two = parse_scene(scene).keys()
    assert {name for name in one if one[name] != two[name]} == set(one)


@pytest.mark.long
def test_keys_are_the_same_in_every_process(small):
    code = (
        "import json, chemage; s = chemage.load_scene('small.toml');"
        "print(json.dumps([s.keys(), s.digest(), s.surface.digest(), s.chemistry.digest()]))"
    )
    seen = []
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        seen.append(json.loads(done.stdout))
    scene = load_scene(small)
    assert seen[0] == seen[1] == [scene.keys(), scene.digest(), scene.surface.digest(), scene.chemistry.digest()]


# -- to data and back ------------------------------------------------------------------------------------------------


def test_a_scene_is_read_back_from_its_data(data):
    scene = parse_scene(data)
    again = parse_scene(json.loads(json.dumps(scene.todict())))
    assert again == scene
    assert again.todict() == scene.todict()


@pytest.mark.parametrize("name", sorted(registry.current().scenes()))
def test_installed_scenes_are_read_back_from_their_data(name):
    data = scene_data(name)[0]
    data.pop("sweep", None)
    scene = parse_scene(data)
    assert scene.name == name
    assert parse_scene(scene.todict()) == scene


@given(
    load=st.floats(0, 1e9),
    temperature=st.floats(1e-3, 1e5),
    times=st.lists(st.just(0.0) | st.floats(1e-100, 1e12), min_size=1, max_size=5).map(sorted),
    strength=st.floats(0, 10),
    seeds=st.tuples(st.integers(0, 2**80), st.integers(0, 2**80)),
)
def test_every_number_survives_the_round_trip(load, temperature, times, strength, seeds):
    scene = parse_scene(
        {
            "surface": {"kind": "sphere", "radius": 30.0, "pixels": 8, "pixel_size": 0.5, "seed": seeds[0]},
            "contact": {"kind": "hertz", "modulus": 35.0, "load": load},
            "forming": {"kind": "md-silica"},
            "interaction": {"kind": "elastic-pairs", "strength": strength, "bias": 0.1},
            "engine": {"kind": "rejection-free"},
            "hold": {"times": times, "temperature": temperature, "seed": seeds[1]},
        }
    )
    again = parse_scene(json.loads(json.dumps(scene.todict())))
    assert again == scene
    assert again.keys() == scene.keys()
    assert (again.load, again.hold.hold_times.tolist()) == (load, times)


def test_defaults_are_spelled_out(data):
    told = parse_scene(data).todict()
    assert told["contact"]["tolerance"] == 1e-5
    assert told["chemistry"]["attempt_frequency"] == 1e13
    assert told["fit"] == {"start": 10.0, "stop": 1e4}
    assert told["hold"]["temperature"] == 300.0


# -- changes ---------------------------------------------------------------------------------------------------------


def test_override_leaves_the_original_alone(data):
    before = json.dumps(data)
    changed = override(data, {"surface.rms_slope": 0.3, "fit.stop": "1e3 s", "breaking": None, "observe.0.bins": 9})
    assert json.dumps(data) == before
    assert (changed["surface"]["rms_slope"], changed["fit"]) == (0.3, {"stop": "1e3 s"})
    assert "breaking" not in changed
    assert changed["observe"][0]["bins"] == 9


@pytest.mark.parametrize("path", ["surface.pixels.x", "name.x", "observe.5.bins", "observe.bins"])
def test_override_into_a_value_names_the_path(data, path):
    with pytest.raises(InputError, match=path.replace(".", r"\.")):
        override(data, {path: 1})


# -- files -----------------------------------------------------------------------------------------------------------


def test_a_scene_without_a_name_has_that_of_its_file(small):
    small.write_text(small.read_text().replace('name = "small"', ""))
    assert load_scene(small).name == "small"
    assert load_scene(small.rename("other.scene.toml")).name == "other.scene"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ('[surface]\nkind = "from-file"\npath = "a"', ("surface", "path")),
        ('[forming]\nkind = "tabulated"\npath = "a"', ("forming", "path")),
        ('[surface]\nkind = "roughened"\nsurface = {kind = "from-file", path = "a"}', ("surface", "surface", "path")),
        ('[surface]\npath = "a"', ("surface", "path")),
        ('[ensemble]\nmap = "a"', ("ensemble", "map")),
        ('[sweep]\nsurface = [{kind = "from-file", path = "a"}]', ("sweep", "surface", 0, "path")),
        ('[surface]\nkind = "from-file"\n[sweep]\n"surface.path" = ["a"]', ("sweep", "surface.path", 0)),
        (
            '[surface]\nkind = "sphere"\n[sweep.surface]\nkind = ["from-file"]\npath = ["a"]',
            ("sweep", "surface", "path", 0),
        ),
        ('[[sweep.zip]]\n"forming.path" = ["a"]', ("sweep", "zip", 0, "forming.path", 0)),
    ],
)
def test_relative_paths_start_from_the_folder_of_the_scene(tmp_path, text, place):
    """Paths are known by their type: a text that is called otherwise is one, and another called "path" is none."""
    (tmp_path / "mine.toml").write_text(text + '\n[hold]\npath = "a"\n', "utf-8")
    value, _ = scene_data(tmp_path / "mine.toml")
    assert value["hold"]["path"] == "a"
    for word in place:
        value = value[word]
    assert value == str(tmp_path / "a")


def test_a_scene_that_is_not_there():
    with pytest.raises(StoreError, match="silica-rough"):
        load_scene("no-such-scene")


def test_problems_carry_their_paths(data):
    with pytest.raises(SceneError) as caught:
        parse_scene(override(data, {"surface.rms_slope": -1, "contact.load": "3 K"}), "mine.toml")
    assert [path for path, _ in caught.value.problems] == ["surface.rms_slope", "contact.load"]
    assert caught.value.source == "mine.toml"
    assert isinstance(caught.value, ValueError)


def test_citations_name_each_source_once(data):
    cited = parse_scene(data).cite()
    assert len(cited) == len(set(cited)) > 3
    assert any("Phys. Rev. E 98, 023001" in text for text in cited)


def test_hold_times_are_those_of_the_scene(data):
    times = parse_scene(data).hold.hold_times
    assert (times[0], times[-1], times.size) == (convert("1 ms", "s"), 1e5, 17)
    assert np.allclose(np.diff(np.log10(times)), 0.5)
