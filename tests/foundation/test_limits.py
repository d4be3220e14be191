"""What is not modelled is said so, in place of a guess; the page and the table agree."""

from __future__ import annotations

from pathlib import Path

import pytest
from seen import limits

import chemage as ca
from chemage.plugin import nearest, registry

ROOT = Path(__file__).parents[2]
SCENE = {
    "name": "tip",
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 32, "pixel_size": "0.45 nm"},
    "contact": {"kind": "hertz", "modulus": 35.3, "load": "5 nN"},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "hold": {"start": 1e-3, "stop": 1e3, "per_decade": 2},
}
ASKED = {
    "chemistry.relative_humidity": "of water there is chemistry.humidity",
    "hold.velocity": "sliding is a pull, or the [[step]]s of a scene",
    "hold.sliding_speed": "sliding is a pull, or the [[step]]s of a scene",
    "velocity": "sliding is a pull, or the [[step]]s of a scene",
    "hold.temperature_programme": "the temperature is constant during a hold",
    "hold.heating_rate": "the temperature is constant during a hold",
    "wear": "wear is not modelled",
    "contact.plasticity": "of plastic flow there is the hardness of a contact",
    "contact.yield_stress": "of plastic flow there is the hardness of a contact",
    "contact.viscosity": "viscoelasticity is not modelled",
}


@pytest.mark.parametrize(("path", "answer"), ASKED.items())
def test_a_scene_that_asks_for_it_is_told_so(path, answer):
    section, _, option = path.partition(".")
    value = {**SCENE.get(section, {}), option: 1.0} if option else {"rate": 1.0}
    with pytest.raises(ca.InputError) as error:
        ca.parse_scene({**SCENE, section: value})
    (line,) = [line for line in str(error.value).splitlines() if path in line]
    assert answer in line
    assert f"see {limits.PAGE}" in line
    assert "did you mean" not in line


def test_a_component_and_a_kind_are_told_too():
    with pytest.raises(ca.InputError, match=r"wear: no such option .wear is not modelled"):
        ca.contact("hertz", modulus=35.3, wear=0.1)
    with pytest.raises(ca.InputError, match=r"no contact 'viscoelastic' .viscoelasticity is not modelled"):
        ca.contact("viscoelastic")


def test_what_is_known_or_mistyped_is_what_it_was():
    assert nearest("velocty", ["velocity"]) == " (did you mean 'velocity'?)"
    assert nearest("site_densty", ["site_density"]) == " (did you mean 'site_density'?)"
    assert nearest("zzz", ["velocity"]) == ""


def test_no_option_of_chemage_is_among_what_is_absent():
    plugins = registry.current()
    options = {
        name
        for role in plugins.roles
        for kind in plugins.kinds(role)
        for name in plugins.component(role, kind).model_fields
    }
    assert len(options) > 40
    assert [name for name in options if limits.not_modelled(name)] == []


def test_the_page_names_every_answer_and_is_short():
    text = (ROOT / limits.PAGE).read_text(encoding="utf-8")
    assert len(text.split()) < 400
    words = ("water", "sliding", "temperature", "wear", "plastic", "viscoelasticity", "inertia")
    assert len(words) == len(limits.ABSENT)
    assert all(word in text.lower() for word in words)
    assert limits.PAGE in (ROOT / "README.md").read_text(encoding="utf-8").split("## Install")[0]
