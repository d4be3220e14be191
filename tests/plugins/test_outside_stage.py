"""A stage of a third party's package is read, planned, run, keyed, stored, swept and shown because it is declared.

The package is ``tests/stubs/chemage_creep.py``, installed like any other.
"""

from __future__ import annotations

import re
import tokenize
from pathlib import Path

import chemage_creep
import numpy as np
import pytest

import chemage as ca
from chemage.plugin import registry

SOURCE = Path(chemage_creep.__file__)


@pytest.fixture(autouse=True)
def installed():
    with registry.using(registry.Registry()) as plugins:
        plugins.register(chemage_creep, "creep")
        yield plugins


def scene(**changes):
    return ca.load_scene("silica-tip", {"creep": {"time": "100 s"}, "hold.replicas": 2, **changes})


def test_it_is_short():
    with SOURCE.open("rb") as stream:
        lines = {token.start[0] for token in tokenize.tokenize(stream.readline) if token.string.strip()}
    assert len(lines) - 1 <= 40


def test_it_is_found_by_its_entry_point(site):
    site.install("chemage-creep", {"chemage_creep.py": SOURCE.read_text("utf-8")}, {"creep": "chemage_creep"})
    assert "creep" in [stage.section for stage in site.registry().stages()]


def test_it_runs_between_the_contact_and_the_ageing(tmp_path):
    without, crept = ca.run(scene(creep=None)), ca.run(scene())
    assert list(crept.timings) == ["surface", "contact", "creep", "ageing"]
    assert crept.contact.area > without.contact.area
    assert crept.contact.pressure.sum() == pytest.approx(without.contact.pressure.sum(), rel=1e-9)
    assert crept.ageing.sites.mean() > without.ageing.sites.mean()
    added = crept.measured["grown"].values
    assert added == pytest.approx(crept.contact.area - without.contact.area)
    ca.write(tmp_path / "crept.h5", crept)
    again = ca.read(tmp_path / "crept.h5")
    assert again.contact.provenance["creep"] == {"time": 100.0}
    assert "creep" in again.plugins
    assert again.ageing.provenance["contact"]["creep"] == {"time": 100.0}
    np.testing.assert_array_equal(again.measured["grown"].values, added)


def test_it_is_in_keys_plan_table_and_sweep(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert {key for key, value in scene().keys().items() if value != scene(creep=None).keys()[key]} == {
        "contact",
        "ageing",
        "result",
    }
    told = command("check", "silica-tip", "--set", "creep.time='2 s'")
    assert "nothing creeps within 2 s" in told.out + told.err
    done = command("run", "silica-tip", "--no-figures", "--set", "creep.time='1 h'", "-o", "crept.h5")
    assert done.status == 0, done.err
    assert "creep" in done.out
    shown = command("show", "crept.h5", "--all").out
    assert "time 3600" in " ".join(shown.split())
    grid = {**scene().todict(), "sweep": {"creep.time": ["1 s", "100 s", "1000 s"]}}
    study = ca.sweep(grid, tmp_path / "out")
    areas = [point.summary["area"] for point in study]
    assert areas[0] < areas[1] < areas[2]


@pytest.mark.parametrize(
    ("stage", "said"),
    [
        ({"section": "hold"}, "this name is taken"),
        ({"section": "name"}, "this name is taken"),
        ({"section": "x", "makes": "contact"}, r"add takes = \('contact',\)"),
        ({"section": "x", "takes": ("bonds",), "makes": "bonds"}, "nothing makes 'bonds'; there are ageing, contact"),
        ({"section": "x", "role": "y"}, "there is no role 'y'; declare it in ROLES"),
    ],
)
def test_a_declaration_that_cannot_work_is_refused(installed, stage, said):
    plugin = type("Plugin", (), {"STAGES": (ca.plugin.Stage(**stage),)})
    with pytest.raises(ca.plugin.PluginError, match=said):
        installed.register(plugin, "wrong")
    assert "x" not in [each.section for each in installed.stages()]


def test_one_that_changes_what_a_scene_does_not_compute_is_refused_by_check_too(installed, command, tmp_path):
    installed.register(type("Plugin", (), {"STAGES": (Late("late", takes=("ageing",), makes="ageing"),)}), "late")
    file = tmp_path / "late.toml"
    file.write_text(
        'surface = {kind = "sphere", radius = "20 nm", pixels = 64, pixel_size = "0.5 nm"}\n'
        'contact = {kind = "hertz", load = "20 nN", modulus = "40 GPa"}\n'
        "late = {by = 1}\n"
    )
    said = r"[late] changes what this scene does not compute, 'ageing'; leave it out"
    assert said in " ".join(command("check", str(file)).err.split())
    with pytest.raises(ca.InputError, match=re.escape(said)):
        ca.run(file)


class Late(ca.plugin.Stage):
    def run(self, inputs):
        return inputs.made[self.makes]


def test_what_it_makes_is_checked(installed):
    class Wrong(ca.plugin.Stage):
        def run(self, inputs):
            contact = inputs.made["contact"]
            return contact.model_copy(update={"pressure": 2 * contact.pressure}) if self.takes else None

    for makes, said in (("contact", "load"), ("ageing", "made ContactSolution; expected Ageing|expected Ageing")):
        plugin = type("Plugin", (), {"STAGES": (Wrong("double", takes=("contact", makes), makes=makes),)})
        with registry.using(registry.Registry()) as plugins:
            plugins.register(plugin, "wrong")
            with pytest.raises(ca.plugin.PluginError, match=said):
                ca.run(ca.load_scene("silica-tip", {"double": {"by": 2}, "hold.replicas": 1}))
