"""Packages written against 0.1 and 0.2, one component of each role and each hook of that version, run as they are.

Those of 0.1 are what its ``chemage plugins new`` wrote, without numba, and the examples of its page of hooks. What 0.2
is must not change either: new components belong into other packages.
"""

from __future__ import annotations

import importlib
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import chemage as ca
from chemage.plugin import registry

STUBS = Path(__file__).parents[1] / "stubs"
#: version -> the package, and the roles that it knows
PACKAGES = {"0_1": ("granite", 7), "0_2": ("basalt", 10)}

#: the module of chemage that finds modules of 0.1
MOVED = "chemage.foundation.moved"

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


@pytest.fixture
def old_modules():
    """No module of 0.1 stays imported."""
    yield
    for name, module in [*sys.modules.items()]:
        package, _, last = name.rpartition(".")
        if package == "chemage" and (module.__name__ != name or type(module.__loader__).__module__ == MOVED):
            del sys.modules[name]
            vars(ca).pop(last, None)


@pytest.fixture(params=PACKAGES)
def package(request, monkeypatch, old_modules):
    """The module of a package, which is found by its entry point beside those of chemage."""
    folder, name = STUBS / f"written_for_{request.param}", PACKAGES[request.param][0]
    monkeypatch.syspath_prepend(str(folder))
    own = metadata.entry_points(group=registry.GROUP)
    points = [point for point in own if point.dist is not None and point.dist.name in ("chemage", f"chemage-{name}")]
    with registry.using(registry.Registry(points)):
        yield sys.modules[f"chemage_{name}"]
    for module in [module for module in sys.modules if module.startswith(f"chemage_{name}")]:
        del sys.modules[module]
    importlib.invalidate_caches()


def test_nothing_is_wrong_with_it(package):
    name = package.__name__.removeprefix("chemage_")
    (record,) = [record for record in registry.current().records if record.name == name]
    assert record.error == ""
    assert len(record.kinds) == dict(PACKAGES.values())[name]
    points = [point for point in metadata.entry_points(group=registry.GROUP) if point.name == name]
    assert registry.Registry(points).check() == []


def test_its_scene_runs_and_comes_back_from_its_file(package, tmp_path):
    name = package.__name__.removeprefix("chemage_")
    run = ca.run(name)
    assert {name} <= run.plugins.keys()
    assert run.ageing.replicas == 2
    assert 0 < run.ageing.bonds[:, -1].mean() <= run.ageing.sites[0]
    assert run.ageing.bonds[0, 0] <= run.ageing.bonds[0, -1]
    # what its hooks did
    assert abs(run.surface.heights.mean()) < 1e-12
    assert run.ageing.observables["pressure_where_bonded"].shape == (2,)
    assert [call[0] for call in package.CALLS].count(run.ageing.engine) >= 2
    ca.write(tmp_path / "run.h5", run)
    again = ca.read(tmp_path / "run.h5")
    assert again.scene["engine"]["kind"] == f"{name}:{run.ageing.engine}"
    assert ca.parse_scene(again.scene) == ca.load_scene(name)
    assert np.array_equal(ca.run(ca.parse_scene(again.scene)).ageing.bonds, run.ageing.bonds)


def test_its_reader_reads(package, tmp_path):
    if package.__name__ == "chemage_granite":
        path, text = tmp_path / "a.xyz", "0 0 1\n0 0.5 2\n0.5 0 3\n0.5 0.5 4\n"
        reader = "granite:granite-reader"
    else:
        path, text, reader = tmp_path / "a.basalt", "1 2\n3 4\n", None
    path.write_text(text)
    surface = ca.surface("from-file", path=str(path), **({"reader": reader} if reader else {})).make()
    np.testing.assert_array_equal(surface.heights, [[1, 2], [3, 4]])


def test_its_command_runs(package, command):
    name = package.__name__.removeprefix("chemage_")
    done = command(f"{name}-stiffness", "6", "2")
    assert (done.status, done.out) == (0, "3.0\n")


@pytest.mark.parametrize("package", ["0_2"], indirect=True)
def test_rupture_pulling_ageing_materials_and_names_of_0_2(package):
    assert ca.basalt_stiffness(6.0, 2.0) == 3.0
    assert ca.material("basalt").options("chemistry") == {"hardness": "5.5 GPa"}
    scene = ca.load_scene("basalt")
    run = ca.run(scene)
    assert run.contact.max_pressure == 3.0  # of its options
    assert (run.ageing.rupture_force[:, -1] > 0).all()
    pulled = {"kind": "pulled", "speed": 100.0, "distance": 0.1, "bond_stiffness": 10.0, "transition_distance": 0.03}
    forces = ca.run(ca.load_scene(scene, {"rupture": {**pulled, "engine": "basalt-rigid"}})).ageing.rupture_force
    np.testing.assert_allclose(forces, run.ageing.bonds * 10.0 * 0.1)
    lasting = {"breaking": None, "interaction": None, "rupture": None, "observe": None}
    counted = ca.run(ca.load_scene(scene, {**lasting, "ageing.kind": "basalt-count"}))
    assert counted.ageing.bonds[0, -1] > 0


def test_modules_of_0_1_say_where_their_names_are(old_modules):
    def old(name):
        return importlib.import_module(f"chemage.{name}")

    with pytest.warns(DeprecationWarning, match=r"^chemage\.objects is a module of chemage 0\.1; its names are in"):
        assert old("objects").Surface is ca.Surface
    assert (old("spec").Barriers, old("spec").Spec) == (ca.plugin.Barriers, ca.plugin.Component)
    assert old("units").Energy is ca.plugin.Energy
    assert old("measures").label_patches is ca.plugin.label_patches
    assert old("measures").rms_slope is ca.plugin.roughness.rms_slope
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        old("spec").nothing  # noqa: B018
    with pytest.raises(ModuleNotFoundError):
        old("nothing")
