"""The schema accepts what chemage accepts and refuses what it refuses, for every kind that is installed."""

from __future__ import annotations

import copy
import tomllib

import jsonschema
import pytest
from seen import options_of, scene_schema

from chemage import load_scene, parse_scene
from chemage.plugin import SceneError, override, registry, scene_data

KINDS = [(role, kind) for role in registry.current().roles for kind in registry.current().kinds(role)]


@pytest.fixture(scope="module")
def schema():
    made = scene_schema()
    jsonschema.Draft202012Validator.check_schema(made)
    return made


@pytest.fixture(scope="module")
def problems(schema):
    validator = jsonschema.Draft202012Validator(schema)
    return lambda data: [f"{error.json_path}: {error.message}" for error in validator.iter_errors(data)]


@pytest.fixture(scope="module")
def data(small_text):
    return tomllib.loads(small_text)


@pytest.mark.parametrize("name", sorted(registry.current().scenes()))
def test_installed_scenes_fit(problems, name):
    data = scene_data(name)[0]
    assert problems(data) == []
    data.pop("sweep", None)
    assert problems(parse_scene(data).todict()) == []


WRONG = [
    {"surface.kind": "nothing"},
    {"surface.kind": None},
    {"surface.pixel": 3},
    {"surface.rms_slope": -1},
    {"surface.pixels": "many"},
    {"surface.seed": -1},
    {"surface.seed": 0.5},
    {"surface": None},
    {"contact.load": None},
    {"contact.load": True},
    {"contact.load": []},
    {"contact.modulus": 0},
    {"contact.precision": "half"},
    {"contact": 5},
    {"forming.kind": "gaussian"},
    {"breaking.std": -1},
    {"interaction.strength": None},
    {"chemistry.hydroxylation": 2},
    {"chemistry.forming": {}},
    {"hold.replicas": 0},
    {"hold.temperature": 0},
    {"hold.times": "1 s"},
    {"fit.stop": -1},
    {"observe": 5},
    {"observe": [{}]},
    {"observe": [5]},
    {"name": 5},
    {"surfce": {}},
]


@pytest.mark.parametrize("change", WRONG, ids=str)
def test_what_chemage_refuses_does_not_fit(problems, data, change):
    wrong = override(data, change)
    with pytest.raises(SceneError):
        parse_scene(wrong)
    assert problems(wrong), change


RIGHT = [
    {"surface.pixels": [30, 40]},
    {"contact.load": "20 uN"},
    {"contact.load": 0},
    {"interaction": None},
    {"breaking": None},
    {"observe": None},
    {"chemistry": None},
    {"hold": {"times": [0, "1 ms", 2.5]}},
    {"surface": {"kind": "from-file", "path": "a.npy", "pixel_size": 1, "reader": {"kind": "npy"}}},
    {"surface": {"kind": "from-file", "path": "a.npy", "pixel_size": "1 nm", "reader": "npy", "height_unit": "um"}},
    {"surface": {"kind": "sphere", "radius": "30 nm", "pixels": 8, "pixel_size": 1}},
]


@pytest.mark.parametrize("change", RIGHT, ids=str)
def test_what_chemage_accepts_fits(problems, data, change):
    right = override(data, change)
    parse_scene(right)
    assert problems(right) == []


def _definition(schema, role, kind):
    """The part of the schema that stands for a kind."""
    (found,) = [
        part
        for part in schema["$defs"].values()
        if part.get("properties", {}).get("kind", {}).get("enum", [""])[0] == kind
        and part["title"] == registry.current().component(role, kind).__name__
    ]
    return found


@pytest.mark.parametrize(("role", "kind"), KINDS)
def test_every_kind_is_in_it_with_its_options_and_units(schema, role, kind):
    cls = registry.current().component(role, kind)
    part = _definition(schema, role, kind)
    assert part["additionalProperties"] is False
    assert "kind" in part["required"]
    extra = {"surface": {"seed"}, "contact": {"load"}}.get(role, set())
    assert set(part["properties"]) == {"kind", *cls.model_fields, *extra}
    for option in options_of(cls):
        assert option["meaning"] or option["name"] == "bins", f"{kind}.{option['name']} says nothing of itself"
        if option["unit"]:
            assert f'"unit": "{option["unit"]}"' in _json(part["properties"][option["name"]])


def _json(part):
    import json

    return json.dumps(part)


def test_quantities_state_their_units(schema):
    assert _definition(schema, "surface", "self-affine")["properties"]["pixel_size"]["unit"] == "nm"
    assert _definition(schema, "contact", "fft-bem")["properties"]["modulus"]["unit"] == "GPa"
    assert _definition(schema, "contact", "fft-bem")["properties"]["load"]["unit"] == "nN"
    assert schema["properties"]["chemistry"]["properties"]["activation_volume"]["unit"] == "nm**3"
    units = {
        option["name"]: option["unit"] for option in options_of(registry.current().component("contact", "fft-bem"))
    }
    assert units["thickness"] == "nm"  # may be left out
    assert units["tolerance"] == ""


def test_every_role_has_its_section(schema):
    sections = schema["properties"]
    plugins = registry.current()
    for section, role in (("surface", "surface"), ("breaking", "barriers"), ("engine", "engine")):
        part = sections[section]
        part = part["anyOf"][0] if "anyOf" in part else part  # or false, or the kind of a material
        names = [schema["$defs"][ref["$ref"].rpartition("/")[2]] for ref in part["oneOf"]]
        assert sorted(part["properties"]["kind"]["enum"][0] for part in names) == plugins.kinds(role)


def test_the_schema_is_made_anew_each_time(schema):
    assert scene_schema() == schema
    changed = copy.deepcopy(scene_schema())
    changed["$defs"].clear()
    assert scene_schema() == schema


def test_a_new_plugin_is_in_the_schema(site):
    source = """
        import chemage
        from chemage.plugin import Barriers, Energy
        import numpy as np

        class Step(Barriers):
            "A step."

            kind = "step"
            height: Energy
            "how high"

            def quantile(self, uniform):
                return np.full(uniform.shape, self.height)

            def density(self, energy):
                return np.where(energy == self.height, np.inf, 0.0)

        @chemage.plugin.hookimpl
        def chemage_register():
            return {"barriers": {"step": "stepped:Step"}}
    """
    site.install("stepped", {"stepped.py": source}, {"stepped": "stepped"})
    with registry.using(registry.Registry()):
        made = scene_schema()
        data = load_scene("silica-tip").todict()
        data["forming"] = {"kind": "step", "height": "1 eV"}
        validator = jsonschema.Draft202012Validator(made)
        assert not list(validator.iter_errors(data))
        data["forming"] = {"kind": "step"}
        assert list(validator.iter_errors(data))
    assert made["$defs"]["Step"]["properties"]["height"]["unit"] == "eV"
