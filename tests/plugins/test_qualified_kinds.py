"""Kinds of one name in several plugins: which is meant, how a scene says it, and what data keep."""

from __future__ import annotations

import json
from contextlib import nullcontext
from itertools import product

import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import UnknownKindError, registry
from chemage.plugin import fromdict as from_data

#: barriers and a contact of given kinds
PACKAGE = """
import numpy as np
from chemage import ContactSolution
from chemage.plugin import Barriers, Choice, ContactSolver, hookimpl


@hookimpl
def chemage_register():
    return {{
        "barriers": {{"weibull": "chemage_{name}:Weibull", "gaussian": "chemage_{name}:Gaussian",
                     "nested": "chemage_{name}:Nested"}},
        "contact": {{"winkler": "chemage_{name}:Winkler"}},
    }}


class Weibull(Barriers):
    "All the same."
    kind = "weibull"
    exact = False
    mean: float = 1.0
    std: float = 0.1

    def quantile(self, uniform):
        return self.mean + 0 * uniform

    def density(self, energy):
        return 0 * energy


class Gaussian(Weibull):
    "As the others."
    kind = "gaussian"


class Nested(Weibull):
    "Those of others."
    kind = "nested"
    inner: Choice[Barriers]


class Winkler(ContactSolver):
    "As stiff as the package has it."
    kind = "winkler"
    exact = False

    def _solve(self, surface, load, start):
        return ContactSolution(
            pressure=np.full(surface.shape, load / surface.nominal_area), load=load, modulus={modulus},
            pixel_size=surface.pixel_size, periodic=surface.periodic, provenance=self.provenance(surface),
        )
"""


def packages(site, *names):
    for number, name in enumerate(names):
        text = PACKAGE.format(name=name, modulus=10.0 + number)
        site.install(f"chemage-{name}", {f"chemage_{name}.py": text}, {name: f"chemage_{name}"})


@pytest.fixture
def both(site):
    """Two packages of the same kinds, beside those of chemage."""
    packages(site, "grit", "sand")
    with registry.using(registry.Registry()) as plugins:
        yield plugins


def scene(forming="weibull", contact="hertz", **sections):
    modulus = {"modulus": 30.0} if contact == "hertz" else {}
    return {
        "surface": {"kind": "sphere", "radius": 30.0, "pixels": 8, "pixel_size": 1.0},
        "contact": {"kind": contact, "load": 5.0, **modulus},
        "forming": {"kind": forming, "mean": 1.0, "std": 0.1},
        "chemistry": {"site_density": "pixel"},
        "engine": {"kind": "rejection-free"},
        "hold": {"times": [1.0, 10.0, 100.0], "replicas": 2},
        **sections,
    }


#: what is meant by a kind, by what comes before the colon, what is preferred, and whether it is built in
MEANT = {
    ("", "", True): "chemage",
    ("", "grit", True): "grit",
    ("", "sand", True): "sand",
    ("", "", False): 'write "grit:weibull" (chemage-grit 1.0) or "sand:weibull" (chemage-sand 1.0), or prefer one of',
    ("", "grit", False): "grit",
    ("", "sand", False): "sand",
    **{("grit:", *other): "grit" for other in product(("", "grit", "sand"), (True, False))},
    **{("sand:", *other): "sand" for other in product(("", "grit", "sand"), (True, False))},
    **{("chemage:", preferred, True): "chemage" for preferred in ("", "grit", "sand")},
    **{
        ("chemage:", preferred, False): "no barriers 'chemage:weibull' (did you mean"
        for preferred in ("", "grit", "sand")
    },
    **{
        ("dust:", *other): "no plugin 'dust' is installed; there is"
        for other in product(("", "grit", "sand"), (True, False))
    },
}


def preferring(how, name, monkeypatch):
    """The section of a scene, and the block, in which a plugin is preferred."""
    monkeypatch.setenv("CHEMAGE_PREFER", name if how == "environment" else "")
    section = {"plugins": {"prefer": [name]}} if how == "scene" and name else {}
    return section, ca.prefer_plugins(name) if how == "block" and name else nullcontext()


@pytest.mark.parametrize(("before", "preferred", "built_in"), MEANT)
def test_which_of_several_kinds_is_meant(both, before, preferred, built_in, monkeypatch):
    plain = "gaussian" if built_in else "weibull"
    meant = MEANT[before, preferred, built_in]
    for how in ("scene", "block", "environment"):
        section, block = preferring(how, preferred, monkeypatch)
        with block:
            if " " in meant:
                with pytest.raises(InputError) as refused:
                    ca.parse_scene(scene(before + plain, **section))
                assert "forming.kind: " in str(refused.value)
                assert meant in str(refused.value)
                continue
            parsed = ca.parse_scene(scene(before + plain, **section))
            forming = parsed.component("forming")
            if how != "scene":
                assert ca.barriers(before + plain, mean=1.0, std=0.1) == forming
            assert ca.parse_scene(parsed.todict()) == parsed
            assert ca.load_scene(parsed, {"contact.load": 6.0}).component("forming") == forming
        owner = "chemage_bonds" if meant == "chemage" else f"chemage_{meant}"
        assert type(forming).__module__.split(".")[0] == owner
        # what is kept of it means the same whatever is preferred later
        assert forming.identity()["kind"] == (plain if meant == "chemage" else f"{meant}:{plain}")
        for name in ("", "grit", "sand"):
            monkeypatch.setenv("CHEMAGE_PREFER", name)
            assert from_data("barriers", forming.identity()) == from_data("barriers", forming.todict()) == forming
            if how == "scene" and preferred:
                assert ca.parse_scene(parsed.todict()).component("forming") == forming


def test_a_kind_of_one_package_needs_no_name(site):
    packages(site, "grit")
    with registry.using(registry.Registry()) as plugins:
        short, full = (ca.barriers(kind, mean=2.0) for kind in ("weibull", "grit:weibull"))
        assert short == full
        assert short.digest() == full.digest()
        assert short.todict()["kind"] == "grit:weibull"
        assert {"weibull", "gaussian", "grit:gaussian"} <= {*plugins.kinds("barriers")}
        assert "grit:weibull" not in plugins.kinds("barriers")
        # what was written before kinds were qualified
        assert from_data("barriers", {**short.todict(), "kind": "weibull"}) == short
        assert type(short).fromdict({**short.todict(), "kind": "weibull"}) == short
        with pytest.raises(UnknownKindError, match=r"no barriers 'grit:wiebull' \(did you mean"):
            ca.barriers("grit:wiebull")


def test_data_of_what_is_built_in_do_not_change(both):
    for role, kind in (("barriers", "gaussian"), ("contact", "hertz")):
        record = both.offer(role, kind)
        assert record.distribution == "chemage"
        assert both.component(role, kind).qualified_kind() == kind
    gaussian = ca.barriers("gaussian", mean=1.0, std=0.1)
    assert gaussian.todict()["kind"] == "gaussian"
    assert gaussian.digest() == "e4954be4749b0ee451782f946b58738e"  # that of 0.2
    other = ca.barriers("grit:gaussian", mean=1.0, std=0.1)
    assert other.todict() == {"kind": "grit:gaussian", "mean": 1.0, "std": 0.1}
    assert other.digest() != gaussian.digest() != ca.barriers("sand:gaussian", mean=1.0, std=0.1).digest()


def test_a_result_keeps_whose_kind_it_was(both, tmp_path):
    run = ca.run(ca.parse_scene(scene("sand:weibull", "grit:winkler")))
    ca.write(tmp_path / "run.h5", run)
    again = ca.read(tmp_path / "run.h5")
    assert again.scene["forming"]["kind"] == "sand:weibull"
    assert again.contact.provenance["kind"] == again.summary()["solver"] == "grit:winkler"
    assert again.approximate == "grit:winkler (no error declared); sand:weibull (no error declared)"
    assert ca.parse_scene(again.scene) == ca.parse_scene(scene("sand:weibull", "grit:winkler"))


def test_a_sweep_over_two_kinds_of_one_name_computes_both(both, tmp_path):
    swept = scene("gaussian", "grit:winkler", sweep={"contact.kind": ["grit:winkler", "sand:winkler"]})
    result = ca.sweep(swept, tmp_path / "out", executor="serial")
    assert [point.contact().modulus for point in result] == [10.0, 11.0]
    assert "grit:winkler" in (tmp_path / "out" / "results.csv").read_text()


def test_an_option_that_is_a_component_is_qualified_too(both):
    outer = ca.barriers("grit:nested", inner="sand:weibull")
    assert outer.todict()["inner"]["kind"] == outer.identity()["inner"]["kind"] == "sand:weibull"
    assert from_data("barriers", outer.todict()) == outer
    for inner in ("weibull", {"kind": "weibull"}):
        with pytest.raises(InputError, match='write "grit:weibull"'):
            ca.barriers("grit:nested", inner=inner)
        with ca.prefer_plugins("sand"):
            assert ca.barriers("grit:nested", inner=inner) == outer
    with ca.prefer_plugins("sand"):
        own = ca.barriers("grit:nested", inner={"kind": "chemage:gaussian", "mean": 1.0, "std": 0.1})
        assert own.todict()["inner"]["kind"] == "chemage:gaussian"
        assert own.identity()["inner"]["kind"] == "gaussian"


def test_commands_take_the_qualified_kind(both, command, tmp_path):
    import tomli_w

    path = tmp_path / "mine.toml"
    path.write_text(tomli_w.dumps(scene("gaussian", "grit:winkler")))
    words = ("--json", "--no-figures", "--out", tmp_path / "b.h5", "--set", "contact.kind=sand:winkler")
    done = command("run", path, *words)
    assert done.status == 0, done.err
    assert json.loads(done.out)["solver"] == "sand:winkler"
    listed = json.loads(command("plugins", "list", "--json").out)["components"]
    kinds = {(row["kind"], row["plugin"]) for row in listed}
    assert {("gaussian", "bonds"), ("grit:gaussian", "grit"), ("sand:winkler", "sand")} <= kinds
    shown = command("plugins", "show", "sand:winkler")
    assert shown.out.startswith("contact sand:winkler  (chemage-sand 1.0)")
    assert 'write "grit:winkler"' in command("plugins", "show", "winkler").err
    schema = json.loads(command("schema").out)["$defs"].values()
    named = [part["properties"]["kind"]["enum"] for part in schema if "kind" in part.get("properties", {})]
    assert sorted(words for words in named if words[-1].endswith("gaussian")) == [
        ["gaussian", "chemage:gaussian"],
        ["grit:gaussian"],
        ["sand:gaussian"],
    ]


def test_a_scene_that_a_package_brings_means_its_own_kinds(site):
    import tomli_w

    brings = "\n\n@hookimpl\ndef chemage_scenes():\n    return {{'{name}-scene': 'chemage_{name}:scene.toml'}}\n"
    for name in ("grit", "sand"):
        text = PACKAGE.format(name=name, modulus=1.0) + brings.format(name=name)
        files = {"__init__.py": text, "scene.toml": tomli_w.dumps(scene("gaussian", "winkler"))}
        files = {f"chemage_{name}/{file}": text for file, text in files.items()}
        site.install(f"chemage-{name}", files, {name: f"chemage_{name}"})
    with registry.using(registry.Registry()):
        for name in ("grit", "sand"):
            for preferred in ((), ("grit",), ("sand",)):
                with ca.prefer_plugins(*preferred):
                    parts = ca.load_scene(f"{name}-scene").parts
                assert {type(parts[part]).__module__ for part in ("forming", "contact")} == {f"chemage_{name}"}


def test_plugins_check_says_which_kind_is_meant(both, command):
    done = command("plugins", "check")
    assert done.status == 0, done.out
    assert (
        'barriers \'gaussian\' may be "chemage:gaussian" (chemage 0.2.0) and "grit:gaussian" (chemage-grit 1.0) and '
        '"sand:gaussian" (chemage-sand 1.0); without a plugin, it is "chemage:gaussian", because it comes with chemage'
    ) in " ".join(done.out.split())
    assert "barriers 'weibull' may be" in done.out
    assert "a scene must say which" in done.out
