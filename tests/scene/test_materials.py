"""A material fills what a scene does not say, each value with its source; the result is that of the plain scene."""

from __future__ import annotations

import json
import tomllib

import jsonschema
import pytest
from seen import read_grid, scene_schema, survey_of

import chemage as ca
from chemage.plugin import plan, registry, scene_data
from chemage.testing import CheckFailed, check_material

CHEMISTRY = ("forming", "breaking", "interaction", "chemistry")


@pytest.fixture
def rough():
    """The data of silica-rough, which gives every value itself."""
    return scene_data("silica-rough")[0]


@pytest.fixture
def bare(rough):
    """The same scene, in which all that a material can give is left to the material."""
    data = {name: part for name, part in rough.items() if name not in CHEMISTRY}
    return {**ca.plugin.override(data, {"contact.modulus": None}), "title": rough["title"], "material": "silica"}


def test_a_material_gives_what_the_scene_does_not_say(rough, bare):
    made, plain = ca.parse_scene(bare), ca.parse_scene(rough)
    assert made.keys() == plain.keys()
    assert made.todict() == plain.todict()
    assert made.digest() == plain.digest()
    assert made.chemistry == plain.chemistry
    assert "material" not in made.todict()
    assert ca.parse_scene(made.todict()).keys() == plain.keys()


def test_the_scene_says_what_is_the_materials(bare):
    found = ca.parse_scene({**bare, "interaction": {"strength": "0.1 eV"}, "chemistry": {"hydroxylation": 0.5}})
    assert found.material == "silica"
    paths = [one.path for one in found.from_material]
    assert "contact.modulus" in paths
    assert "interaction.bias" in paths
    assert "interaction.strength" not in paths
    assert found.chemistry.interaction.strength == 0.1
    assert found.chemistry.hydroxylation == 0.5
    text = plan(found).stages["material"]
    assert text.startswith("silica: contact.modulus = 35.3 GPa")
    assert "strength =" not in text.replace("shear_strength =", "")


def test_the_sources_of_what_was_used_are_cited(bare, rough):
    source = "L. T. Zhuravlev, Colloids Surf. A 173, 1 (2000)"
    assert source in ca.parse_scene(bare).cite()
    assert source not in ca.parse_scene({**bare, "chemistry": {"site_density": 4.9}}).cite()
    assert source not in ca.parse_scene(rough).cite()


def test_every_value_can_be_overridden(bare):
    for value in ca.material("silica").values:
        if not value.path.endswith(".kind"):
            given = ca.plugin.override(bare, {value.path: value.value})
            assert value.path not in [one.path for one in ca.parse_scene(given).from_material]
            assert ca.parse_scene(given).keys() == ca.parse_scene(bare).keys()


def test_another_kind_keeps_its_own_options(bare):
    found = ca.parse_scene({**bare, "breaking": {"kind": "uniform", "lower": "1 eV", "upper": "1.2 eV"}})
    assert found.chemistry.breaking == ca.barriers("uniform", lower="1 eV", upper="1.2 eV")
    assert not [one for one in found.from_material if one.path.startswith("breaking")]


def test_false_leaves_out_what_the_material_has(bare):
    found = ca.parse_scene({**bare, "breaking": False, "interaction": False, "chemistry": {"hardness": False}})
    assert found.chemistry.breaking is None
    assert found.chemistry.interaction is None
    assert found.chemistry.hardness is None
    assert found.chemistry.shear_strength == 4.6


def test_a_contact_alone_takes_the_modulus_alone():
    data = {
        "material": "silica",
        "surface": {"kind": "sphere", "radius": 30, "pixels": 16, "pixel_size": 0.5},
        "contact": {"kind": "hertz", "load": "5 nN"},
    }
    found = ca.parse_scene(data)
    assert found.chemistry is None
    assert [one.path for one in found.from_material] == ["contact.modulus"]
    elastic = ca.parse_scene(ca.plugin.override(data, {"contact.modulus": {"young": 72, "poisson": 0.17}}))
    assert elastic.from_material == ()
    assert plan(elastic).stages["material"] == "silica: the scene gives every value itself"


def test_a_sweep_fills_every_point_and_may_leave_sections_out(bare):
    weak = {"kind": "elastic-pairs", "strength": "0.1 eV", "bias": 0.1}
    grid = read_grid({**bare, "sweep": {"interaction": [False, weak], "chemistry.hardness": ["9 GPa", "10 GPa"]}})
    points = [grid.scene(point) for point in range(grid.size)]
    assert [one.chemistry.interaction is None for one in points] == [True, True, False, False]
    assert [one.chemistry.hardness for one in points] == [9, 10, 9, 10]
    assert survey_of(grid).units["chemistry.hardness"] == "GPa"
    laws = read_grid({**bare, "sweep": {"rupture": [False, {"kind": "mean-force"}]}})
    assert [laws.scene(point).rupture is None for point in range(2)] == [True, False]


def test_an_unknown_material_names_those_there_are(bare):
    with pytest.raises(
        ca.plugin.SceneError, match=r"material: no material 'silca' \(did you mean 'silica'\?\); installed: silica"
    ):
        ca.parse_scene({**bare, "material": "silca"})
    for wrong in (3, ["silica"], {}):
        with pytest.raises(ca.plugin.SceneError, match="material: no material"):
            ca.parse_scene({**bare, "material": wrong})
    with pytest.raises(ca.plugin.UnknownKindError):
        ca.material("granite")


# -- the material itself ----------------------------------------------------------------------------------------------


def test_every_value_has_a_source_and_says_how_it_is_known():
    silica = ca.material("silica")
    assert len(silica.values) == 14
    assert all(one.source and one.how in ("measured", "calculated", "calibrated", "estimated") for one in silica.values)
    check_material("silica")


def test_it_makes_components_in_python(rough):
    silica = ca.material("silica")
    plain = ca.parse_scene(rough)
    assert silica.chemistry() == plain.chemistry
    assert silica.chemistry(interaction=None, hydroxylation=0.5).interaction is None
    assert ca.contact("fft-bem", **silica.options("contact")) == plain.contact
    assert "material silica" in silica._repr_html_()


def test_toml_to_copy_is_the_material(bare, rough):
    text = ca.material("silica").toml()
    copied = tomllib.loads(text)
    data = {name: part for name, part in bare.items() if name != "material"}
    data["contact"] = {**data["contact"], **copied.pop("contact")}
    assert ca.parse_scene({**data, **copied}).keys() == ca.parse_scene(rough).keys()
    assert "# measured: L. T. Zhuravlev" in text


@pytest.mark.long
def test_a_scene_file_and_the_schema_know_it(bare, rough):
    schema = scene_schema()
    for data in (bare, rough, {**bare, "breaking": False, "interaction": {"strength": "0.1 eV"}}):
        jsonschema.validate(json.loads(json.dumps(data)), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**bare, "material": "granite"}, schema)


MATERIAL = """
title = "A glass"
[contact.modulus]
value = "30 GPa"
how = "measured"
source = "a table"
[forming.kind]
value = "uniform"
how = "estimated"
source = "this test"
[forming.lower]
value = "0.8 eV"
how = "estimated"
source = "this test"
[forming.upper]
value = "1.4 eV"
how = "estimated"
source = "this test"
"""
PLUGIN = """
import chemage

@chemage.plugin.hookimpl
def chemage_materials():
    return {"glass": "a_glass:glass.toml"}
"""


@pytest.fixture
def glass(site):
    """Installs a third party's material with this text."""

    def install(text=MATERIAL, name="a-glass"):
        package = name.replace("-", "_")
        files = {f"{package}/__init__.py": PLUGIN.replace("a_glass", package), f"{package}/glass.toml": text}
        site.install(name, files, {name: package})
        return registry.Registry()

    return install


def test_a_third_party_adds_one(glass, bare):
    with registry.using(glass()):
        check_material("glass")
        found = ca.parse_scene({**bare, "material": "glass"})
        assert found.contact.modulus == 30
        assert found.chemistry.breaking is None
        assert found.chemistry.forming == ca.barriers("uniform", lower=0.8, upper=1.4)
        assert "glass" in scene_schema()["properties"]["material"]["enum"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('how = "measured"', ""), "contact.modulus.how = None: give one of measured, calculated"),
        (('source = "a table"', ""), "contact.modulus.source: give a text"),
        (('value = "30 GPa"\n', ""), "write .contact.modulus. with value, how and source"),
        (('value = "30 GPa"', 'value = "30 nm"'), "contact.modulus: .*quantity of nanometer"),
        (('value = "30 GPa"', "value = -30"), "contact.modulus: .*greater than 0"),
        (("contact.modulus", "contact.moduls"), "contact.moduls: no installed contact has this option"),
        (("contact.modulus", "contact.load"), "contact.load: is no property of a material"),
        (("contact.modulus", "chemistry.hardnes"), r"chemistry.hardnes: no such option \(did you mean 'hardness'\?\)"),
        (("contact.modulus", "hold.temperature"), "hold: no such section"),
        (('value = "1.4 eV"', 'value = "0.4 eV"'), "forming: .*"),
        (("[contact.modulus]", "[contact.modulus"), "glass.toml: "),
        (('title = "A glass"', "title = 3"), "title: give a text"),
        (("how =", "remark = 3\nhow ="), "no such entry; the entries are value, how, source, note"),
        ((MATERIAL, ""), "has no values"),
    ],
)
def test_what_is_wrong_with_a_material_is_said(glass, change, message):
    with registry.using(glass(MATERIAL.replace(*change))), pytest.raises(CheckFailed, match=message):
        check_material("glass")


def test_two_plugins_with_one_material_are_an_error(glass):
    glass()
    with registry.using(glass(name="b-glass")) as found:
        assert any("material 'glass' is claimed by" in text for text in found.clashes())
        with pytest.raises(ca.plugin.PluginError, match="claimed by"):
            ca.material("glass")
