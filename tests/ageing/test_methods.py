"""Methods of ageing: their answer is of the whole contact, stored and shown; what they cannot give is refused."""

from __future__ import annotations

import csv
import json
from typing import ClassVar

import numpy as np
import pytest

import chemage as ca
from chemage import InputError, compare_files, parse_scene
from chemage.plugin import PluginError, SceneError

TIMES = np.array([1.0, 10.0, 100.0, 1000.0])


class Half(ca.plugin.AgeingMethod):
    """Half of the sites are bonded, with an error of one percent."""

    kind = "half"
    replicates = False
    exact = False
    declared_error = 0.01
    wrong: ClassVar = None

    share: float = 0.5
    """share of the sites"""

    def age(self, request):
        if type(self).wrong is not None:
            return type(self).wrong
        sites = request.chemistry.hydroxylation * request.chemistry.sites_of(request.contact).sites.size
        times = request.hold_times
        return ca.plugin.AgedBonds(
            bonds=np.full((1, times.size), self.share * sites),
            sites=np.array([sites]),
            errors={"table": np.full(times.size, 0.01)},
            error_sources={"table": "assumed"},
            engine="none",
        )


@pytest.fixture
def half():
    with ca.plugin.registry.using(ca.plugin.registry.Registry()):
        ca.register(Half)
        yield Half()


def contact(load: float = 50.0) -> ca.ContactSolution:
    tip = ca.surface("sphere", radius=30, pixels=48, pixel_size=0.4518).make()
    return ca.contact("hertz", modulus=35.3).solve(tip, load)


def aged(method, **options):
    fields = {"engine": ca.engine("rejection-free"), "temperature": 300, "replicas": 3, "seed": 2, "hold_times": TIMES}
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper=1.2))
    return ca.age(contact(), **{"chemistry": chemistry, **fields, "method": method, **options})


def scene(**parts):
    return {
        "name": "tip",
        "surface": {"kind": "sphere", "radius": 30, "pixels": 48, "pixel_size": 0.4518},
        "contact": {"kind": "hertz", "modulus": 35.3, "load": 50.0},
        "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
        "engine": {"kind": "rejection-free"},
        "hold": {"times": TIMES.tolist(), "replicas": 3},
        **parts,
    }


def test_the_answer_becomes_an_ageing_curve_that_says_how_it_was_found(half):
    found = aged(half)
    assert found.replicas == 1
    assert found.bonds.dtype == np.float64
    np.testing.assert_array_equal(found.bonds, np.full((1, 4), 0.5 * contact().sites.size))
    assert (found.method, found.events, found.load) == ("half", None, 50.0)
    assert found.error_words == "table 1 % (assumed)"
    assert found.random_numbers == ""
    assert found.contact == contact().summary()
    plain = aged(None)
    assert (plain.method, plain.errors, plain.error_words) == (None, {}, "")
    assert "ageing" not in plain.provenance


def test_the_answer_is_stored_to_the_last_bit(half, tmp_path):
    found = aged(half, chemistry=ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper=1.2), hydroxylation=0.7))
    ca.write(tmp_path / "half.h5", found)
    again = ca.read(tmp_path / "half.h5")
    assert again == found
    assert again.digest() == found.digest()
    np.testing.assert_array_equal(again.errors["table"], found.errors["table"])
    assert (again.sites.dtype, again.events) == (np.float64, None)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (3, "gave int; its method age must give an AgedBonds"),
        (ca.plugin.AgedBonds(bonds=np.ones((1, 3)), sites=np.array([9])), r"bonds: shape \(1, 3\)"),
        (
            ca.plugin.AgedBonds(bonds=np.full((1, 4), np.nan), sites=np.array([9])),
            "bonds: 4 of 4 values are not finite",
        ),
        (ca.plugin.AgedBonds(bonds=np.full((1, 4), 9.5), sites=np.array([9])), "a site has one bond at most"),
        (ca.plugin.AgedBonds(bonds=np.ones((2, 4)), sites=np.array([9, 9])), "gave 2 replicas"),
        (
            ca.plugin.AgedBonds(bonds=np.ones((1, 4)), sites=np.array([9]), errors={"table": np.ones(4)}),
            "error_sources: say how each of the errors table is known",
        ),
    ],
)
def test_an_answer_that_is_none_names_the_method(half, monkeypatch, answer, said):
    monkeypatch.setattr(Half, "wrong", answer)
    with pytest.raises(PluginError, match="ageing 'half'.*" + said):
        aged(half)


def test_what_a_method_cannot_give_is_refused_before_anything_is_computed(half):
    with pytest.raises(InputError, match=r"gives numbers of bonds.*observable 'barrier-spectrum' cannot be measured"):
        aged(half, observe=[ca.observable("barrier-spectrum")])
    with pytest.raises(InputError, match=r"the rupture law 'mean-force' cannot be applied; use bond_force"):
        aged(half, rupture=ca.rupture("mean-force"))
    with pytest.raises(SceneError, match=r"ageing: ageing 'half' gives numbers of bonds"):
        parse_scene(scene(ageing={"kind": "half"}, rupture={"kind": "mean-force"}))
    with pytest.raises(InputError, match=r"method must be an AgeingMethod, got 'half'"):
        aged("half")


def test_the_method_is_part_of_the_key_of_ageing_and_of_no_other(half):
    plain, first, second = (
        parse_scene(scene(**part))
        for part in ({}, {"ageing": {"kind": "half"}}, {"ageing": {"kind": "half", "share": 0.3}})
    )
    keys = [one.keys() for one in (plain, first, second)]
    assert len({one["ageing"] for one in keys}) == len({one["result"] for one in keys}) == 3
    assert len({one["contact"] for one in keys}) == 1
    assert parse_scene(first.todict()) == first
    assert half in first.components()
    short = {name: part for name, part in scene().items() if name in ("surface", "contact")}
    with pytest.raises(SceneError, match=r"ageing: needs \[forming\]"):
        parse_scene({**short, "ageing": {"kind": "half"}})


@pytest.mark.long
def test_runs_show_compare_and_report_give_the_error_of_the_method(half, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import tomli_w

    (tmp_path / "tip.toml").write_text(tomli_w.dumps(scene(ageing={"kind": "half"})))
    ca.write(tmp_path / "plain.h5", ca.run(scene()))
    done = json.loads(command("run", "tip.toml", "--json", "--no-figures").out)
    assert (done["ageing"], done["events"]) == ("half", None)
    assert done["bond_errors"] == {"table": [0.01] * 4}
    assert "approximate" in done
    shown = command("show", "tip.h5", "--all").out
    assert "table 1 % (assumed)" in " ".join(shown.split())
    assert "by ageing 'half'" in shown
    made = compare_files([tmp_path / "plain.h5", tmp_path / "tip.h5"])
    (further,) = [texts for label, texts in made.table() if label.startswith("errors of the mean at ")]
    assert further == ["-", "table 1 % (assumed)"]
    assert "table 1 % (assumed)" in made.csv()
    assert "ageing.kind" in made.other_differences()
    ca.write_report(["plain.h5", "tip.h5"], "page.html")
    assert "table 1 % (assumed)" in (tmp_path / "page.html").read_text()
    checked = command("check", "tip.toml").out
    assert "half, instead of the kinetics of every site" in " ".join(checked.split())


def test_sweeps_keep_bonds_that_are_no_whole_numbers(half, tmp_path):
    swept = ca.sweep({**scene(ageing={"kind": "half"}), "sweep": {"ageing.share": [0.25, 0.5]}}, out=tmp_path / "s")
    assert [point.status for point in swept] == ["done"] * 2
    sites = contact().sites.size
    np.testing.assert_array_equal(swept.table().bonds[:, 0, -1], [0.25 * sites, 0.5 * sites])
    rows = list(csv.DictReader((tmp_path / "s" / "results.csv").read_text().splitlines()))
    assert "half" in rows[0]["approximate"]
