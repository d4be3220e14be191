"""Provenance: which versions and which plugins made a result."""

from __future__ import annotations

import json
from importlib import metadata

import h5py
import numpy as np
import pytest

import chemage
from chemage import load_scene, parse_scene
from chemage.plugin import registry


@pytest.fixture
def scene(small):
    return load_scene(small)


def test_versions_name_the_distributions_in_use(scene):
    found = chemage.plugin.versions(scene)
    assert found["chemage"] == chemage.__version__ == metadata.version("chemage")
    for name in ("numpy", "scipy", "numba", "h5py"):
        assert found[name] == metadata.version(name)


# -- a plugin that changes the pressure -------------------------------------------------------------------------------

CAP = """
    import chemage, numpy as np

    @chemage.plugin.hookimpl(wrapper=True)
    def chemage_solve_contact(load):
        found = yield
        return found.model_copy(update={"pressure": np.minimum(found.pressure, 0.3), "carries": "capped"})
"""
TINY = {"tiny": "chemage-tiny 1.0"}
TOOK_PART = {**TINY, "cap": "chemage-cap 2.1"}


@pytest.fixture
def plain(tiny):
    """Keys of the result, and the result, without the plugin."""
    run = chemage.run(parse_scene(tiny.scene()))
    return run.keys, run


@pytest.fixture
def capped(plain, site):
    """The plugin is installed."""
    site.install("chemage-cap", {"chemage_cap.py": CAP}, {"cap": "chemage_cap"}, version="2.1")
    with registry.using(site.registry()):
        yield


def test_without_it_only_the_provider_of_the_components_took_part(plain):
    _, run = plain
    assert run.plugins == run.contact.plugins == run.ageing.plugins == TINY
    assert run.summary()["plugins"] == TINY


def test_chemage_itself_is_not_listed_as_a_plugin():
    run = chemage.run(load_scene("silica-tip", {"hold.replicas": 2, "hold.stop": "10 s"}))
    assert run.plugins == {}
    assert "plugins" not in run.contact.provenance
    assert "plugins" not in run.ageing.provenance


def test_it_is_in_the_result(capped, tiny):
    run = chemage.run(parse_scene(tiny.scene()))
    assert run.contact.pressure.max() == 0.3
    for thing in (run.contact, run.ageing, run):
        assert thing.plugins == TOOK_PART
    assert run.contact.provenance["plugins"] == run.ageing.provenance["plugins"] == TOOK_PART
    # what the solver itself says is kept beside it
    assert run.contact.provenance["kind"] == "tiny-even"
    assert run.surface.plugins == TINY
    assert run.versions["chemage-cap"] == "2.1"
    assert run.summary()["plugins"] == TOOK_PART


def test_it_changes_the_keys_of_its_stage_and_of_those_after_it(plain, capped, tiny):
    before, after = plain[0], chemage.run(parse_scene(tiny.scene())).keys
    assert before["surface"] == after["surface"]
    for stage in ("contact", "ageing", "result"):
        assert before[stage] != after[stage], stage


def test_another_version_of_it_is_another_result(capped, tiny, site, tmp_path, monkeypatch):
    before = chemage.run(parse_scene(tiny.scene())).keys
    (record,) = [one for one in registry.current().records if one.name == "cap"]
    info = site.folder / "chemage_cap-2.1.dist-info"
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: chemage-cap\nVersion: 2.2\n")
    with registry.using(site.registry()):
        after = chemage.run(parse_scene(tiny.scene())).keys
    assert record.version == "2.1"
    assert before["surface"] == after["surface"]
    assert before["contact"] != after["contact"]


def test_it_is_in_the_file_and_comes_back(capped, tiny, tmp_path):
    run = chemage.run(parse_scene(tiny.scene()))
    chemage.write(tmp_path / "x.h5", run)
    with h5py.File(tmp_path / "x.h5") as file:
        assert json.loads(file.attrs["versions"])["chemage-cap"] == "2.1"
        for group in ("contact", "ageing"):
            assert json.loads(file[group].attrs["provenance"])["plugins"] == TOOK_PART
    again = chemage.read(tmp_path / "x.h5")
    assert again.plugins == again.contact.plugins == again.ageing.plugins == TOOK_PART
    assert again.contact == run.contact
    assert again.ageing == run.ageing


def test_the_command_show_names_it(capped, tiny, tmp_path, command):
    chemage.write(tmp_path / "x.h5", chemage.run(parse_scene(tiny.scene())))
    shown = command("show", tmp_path / "x.h5", "--all")
    assert (shown.status, shown.err) == (0, "")
    lines = [line.split() for line in shown.out.splitlines() if "plugin" in line]
    assert ["plugin", "cap", "chemage-cap", "2.1"] in lines
    told = json.loads(command("show", tmp_path / "x.h5", "--json").out)
    assert told["plugins"] == TOOK_PART
    assert told["versions"]["chemage-cap"] == "2.1"


@pytest.mark.long
def test_a_report_names_it(capped, tiny, tmp_path):
    chemage.write(tmp_path / "x.h5", chemage.run(parse_scene(tiny.scene())))
    page = chemage.write_report([tmp_path / "x.h5"], tmp_path / "x.html").read_text(encoding="utf-8")
    assert "plugin cap" in page
    assert "chemage-cap 2.1" in page


def test_a_comparison_names_it(capped, tiny, tmp_path):
    chemage.write(tmp_path / "x.h5", chemage.run(parse_scene(tiny.scene())))
    found = chemage.compare_files([tmp_path / "x.h5"])
    assert dict(found.table())["plugins that took part"] == ["chemage-tiny 1.0, chemage-cap 2.1"]
    assert found.numbers()[0]["plugins"] == TOOK_PART
    assert "chemage-cap 2.1" in found.csv()


def test_a_point_of_a_sweep_knows_it(capped, tiny, tmp_path):
    sweep = {"sweep": {"contact.load": [10.0, 12.0]}}
    result = chemage.sweep({**tiny.scene(), **sweep}, tmp_path / "out")
    alone = chemage.run(parse_scene(tiny.scene()))
    for point in result:
        made = point.run()
        assert point.summary["plugins"] == made.plugins == TOOK_PART
        assert point.contact().plugins == point.ageing().plugins == TOOK_PART
        assert made.versions["chemage-cap"] == "2.1"
    assert result[0].run().contact == alone.contact
    assert result[0].ageing() == alone.ageing
    assert np.array_equal(result[0].contact().pressure, alone.contact.pressure)
