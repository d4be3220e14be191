"""A stage that a room declares is read, checked, planned, keyed, stored and swept like those that chemage has.

The stage of this test is declared in ``tests/stubs/wear.py``, and nothing of the framework is touched but the registry
that is told of it.
"""

from __future__ import annotations

import re

import jsonschema
import pytest
import wear
from seen import read_grid, scene_schema, survey_of

import chemage as ca
from chemage.plugin import plan


@pytest.fixture(autouse=True)
def registry():
    """A registry that knows the stage."""
    with ca.plugin.registry.using(ca.plugin.registry.Registry()) as installed:
        installed.add_room(wear)
        ca.register(wear.Archard)
        yield installed


def scene(**changes):
    return ca.load_scene("silica-tip", {"wear": {"kind": "archard", "slip": "3 nm"}, **changes})


def test_it_is_read_and_told(registry):
    worn = scene()
    assert worn.component("wear") == wear.Archard(slip=3.0)
    assert worn.todict()["wear"] == {"kind": "archard", "slip": 3.0}
    assert ca.parse_scene(worn.todict()) == worn
    assert wear.Archard.cite[0] in worn.cite()
    assert any("Archard" in name for name in ca.plugin.versions(worn))
    order = [stage.section for stage in registry.stages()]
    assert order.index("contact") < order.index("wear")


@pytest.mark.parametrize(
    ("changes", "path", "said"),
    [
        ({"wear": 3}, "wear", r"3 is not a section; write \[wear\] with options below it"),
        ({"wear": {"slip": 1}}, "wear.kind", "is required; installed: archard"),
        ({"wear": {"kind": "archrd"}}, "wear.kind", "did you mean 'archard'"),
        ({"wear": {"kind": "archard"}}, "wear.slip", "is required"),
        ({"wear.slop": 1}, "wear.slop", "no such option .did you mean 'slip'"),
        ({"wear.slip": "3 K"}, "wear.slip", '"3 K" is a quantity of kelvin'),
        ({"wear.slip": "1 m"}, "wear.slip", "is longer than any surface"),
        ({"waer": {}}, "waer", "no such section .did you mean 'wear'"),
    ],
)
def test_what_is_wrong_is_named(changes, path, said):
    with pytest.raises(ca.plugin.SceneError) as caught:
        scene(**changes)
    assert path in [problem[0] for problem in caught.value.problems]
    assert re.search(said, str(caught.value))


def test_it_needs_what_it_rests_on():
    contact = dict.fromkeys(("forming", "breaking", "interaction", "chemistry", "engine", "hold", "fit"))
    with pytest.raises(ca.plugin.SceneError, match=r"wear: needs \[forming\]"):
        scene(**contact, observe=None)


def test_its_options_are_in_the_keys_from_its_stage_on():
    without, worn, other = ca.load_scene("silica-tip").keys(), scene().keys(), scene(**{"wear.slip": 4}).keys()
    assert {key for key in worn if worn[key] != without[key]} == {"ageing", "result"}
    assert {key for key in worn if worn[key] != other[key]} == {"ageing", "result"}


def test_the_schema_has_it():
    schema = scene_schema()
    validator = jsonschema.Draft202012Validator(schema)
    assert not list(validator.iter_errors(scene().todict()))
    assert list(validator.iter_errors({**scene().todict(), "wear": {"kind": "archard", "slop": 1}}))
    assert schema["$defs"]["Archard"]["properties"]["slip"]["unit"] == "nm"


def test_the_plan_has_its_row_its_cost_and_its_doubts(command):
    before, worn = plan(ca.load_scene("silica-tip")), plan(scene())
    assert dict(worn.rows())["wear"] == "archard"
    assert worn.numbers["cpu_seconds"] > before.numbers["cpu_seconds"] + 999
    assert worn.notes == before.notes
    assert "a slip of 0.1 nm wears nothing off" in plan(scene(**{"wear.slip": 0.1})).notes
    told = command("check", "silica-tip", "--set", 'wear={"kind"="archard","slip"="0.1 nm"}')
    assert told.status == 0
    assert "archard" in told.out
    assert "wears nothing off" in told.out + told.err


def test_its_option_is_an_axis_of_a_sweep():
    data = ca.plugin.scene_data("silica-tip")[0] | {"wear": {"kind": "archard", "slip": 1.0}}
    surveyed = survey_of(read_grid({**data, "sweep": {"wear.slip": ["3 nm", "1 um"]}}))
    assert len(set(surveyed.keys)) == 2
    assert surveyed.units["wear.slip"] == "nm"
    assert surveyed.resolved[0] == [[3.0], [1000.0]]
    assert len(surveyed.contacts) == 1


def test_its_files_are_beside_the_scene(tmp_path):
    text = (tmp_path / "worn.toml").write_text
    text('[wear]\nkind = "archard"\ntable = "table.txt"\n[sweep]\n"wear.table" = ["one.txt", "/two.txt"]\n', "utf-8")
    data, _ = ca.plugin.scene_data(tmp_path / "worn.toml")
    assert data["wear"]["table"] == str(tmp_path / "table.txt")
    assert data["sweep"]["wear.table"] == [str(tmp_path / "one.txt"), "/two.txt"]
