"""Kernels of old sources are never used, and those of other packages are left to numba."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest
from llvmlite import binding
from numba.core import caching

from chemage.foundation import kernels
from chemage.plugin import random

ROOT = Path(__file__).parents[2]
MINE = {
    "mine/__init__.py": "",
    "mine/deep/__init__.py": "",
    "mine/deep/rates.py": """
        from numba import njit

        RATE = 2.0

        @njit
        def rate(x):
            return RATE * x
        """,
    "mine/solver.py": """
        from chemage.plugin import kernel
        from mine.deep.rates import rate

        @kernel(nogil=True)
        def solve(x):
            return rate(x) + 1.0
        """,
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder for kernels."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("CHEMAGE_CACHE", str(tmp_path))
    kernels._sources.cache_clear()
    yield tmp_path / "kernels"
    kernels._sources.cache_clear()


def imported_anew(name):
    """The kernel of a module, as another process would import it."""
    for module in [module for module in sys.modules if module.partition(".")[0] == "mine"]:
        del sys.modules[module]
    importlib.invalidate_caches()
    return importlib.import_module(name).solve


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_function_of_another_file_is_compiled_again(site, folder):
    site.install("mine", MINE)
    assert imported_anew("mine.solver")(1.0) == 3.0
    kernels._sources.cache_clear()
    kernel = imported_anew("mine.solver")
    assert kernel(1.0) == 3.0
    assert sum(kernel.stats.cache_hits.values()) == 1
    edit(site.folder / "mine/deep/rates.py", "RATE = 2.0", "RATE = 6.0")
    kernels._sources.cache_clear()
    assert imported_anew("mine.solver")(1.0) == 7.0
    assert len([*folder.iterdir()]) == 2


def test_what_is_compiled_beside_edited_files_is_not_kept(site, folder):
    """A process that began before an update imports the rest after it."""
    site.install("mine", MINE)
    assert imported_anew("mine.solver")(1.0) == 3.0
    kept = {path: path.read_bytes() for path in folder.rglob("*.nb?")}
    assert kept
    edit(site.folder / "mine/deep/rates.py", "RATE = 2.0", "RATE = 6.0")
    assert imported_anew("mine.solver")(1.0) == 7.0
    assert kept == {path: path.read_bytes() for path in folder.rglob("*.nb?")}


def test_the_folder_changes_with_every_file_and_with_what_compiles(tmp_path, folder, monkeypatch):
    package = tmp_path / "mine"
    (package / "deep").mkdir(parents=True)
    names = set()

    def is_new():
        names.add(kernels.Sources("mine", str(package)).folder.name)
        return len(names)

    assert is_new() == 1
    for count, name in enumerate(["__init__.py", "deep/rates.py"], 2):
        (package / name).write_text("RATE = 1")
        assert is_new() == count
        (package / name).touch()
        assert is_new() == count, "the same files at another time"
    (package / "deep/rates.py").write_text("RATE = 2")
    assert is_new() == 4
    monkeypatch.setattr(numba, "__version__", "1000")
    assert is_new() == 5
    monkeypatch.setattr(kernels.llvmlite, "__version__", "1000")
    assert is_new() == 6
    monkeypatch.setattr(binding, "get_host_cpu_name", lambda: "abacus")
    assert is_new() == 7
    monkeypatch.setattr(numba.config, "CPU_FEATURES", "+beads")
    assert is_new() == 8
    assert str(Path(random.__file__)) in kernels.Sources("mine", str(package))._stamps


def test_a_damaged_kernel_is_compiled_again(site, folder):
    site.install("mine", MINE)
    assert imported_anew("mine.solver")(1.0) == 3.0
    for path in folder.rglob("*.nb?"):
        content = path.read_bytes()
        path.write_bytes(content[:-200] + bytes([content[-200] ^ 1]) + content[-199:])
        kernel = imported_anew("mine.solver")
        assert kernel(1.0) == 3.0
        assert not sum(kernel.stats.cache_hits.values())
    kernel = imported_anew("mine.solver")
    assert kernel(1.0) == 3.0
    assert sum(kernel.stats.cache_hits.values()) == 1


def test_a_kernel_that_cannot_be_kept_is_compiled(site, folder):
    site.install("mine", MINE)
    folder.write_text("no folder")
    assert imported_anew("mine.solver")(1.0) == 3.0
    assert kernels.kernel(eval("lambda x: 2 * x"))(1) == 2  # of no file


def test_folders_of_old_versions_are_removed(folder):
    now = time.time()
    ages = {f"mine-{number:032x}": number * kernels.RECENT / 8 for number in range(20)}
    others = ["mine_too-" + "0" * 32, "mine_" + "0" * 40]
    for name in (*ages, *others):
        (folder / name).mkdir(parents=True)
        os.utime(folder / name, (now - ages.get(name, 1e9),) * 2)
    sources = kernels.Sources("mine")
    sources.make_folder()
    left = [name for name in ages if (folder / name).is_dir()]
    assert left == list(ages)[: kernels.KEPT - 1]
    assert all((folder / name).is_dir() for name in others)
    os.utime(sources.folder, (1, 1))
    kernels.Sources("mine")
    assert sources.folder.stat().st_mtime > now - 60, "its use is noted"
    for name in ages:  # many versions of one day
        (folder / name).mkdir(exist_ok=True)
        os.utime(folder / name)
    sources.folder.rmdir()
    sources.make_folder()
    assert all((folder / name).is_dir() for name in ages)


def test_numba_is_left_as_it_was():
    assert caching.IndexDataCacheFile.__module__ == caching.FunctionCache.__module__ == caching.__name__
    assert not [finder for finder in sys.meta_path if type(finder).__module__.startswith("chemage")]


FOREIGN = """
import json, os, sys
before = [dict(os.environ), list(sys.meta_path)]
{first}
assert [dict(os.environ), list(sys.meta_path)] == before or not {first!r}
from foreign import twice
twice(1.0)
{after}
from numba.core import caching, config
print(json.dumps([
    twice.stats.cache_path, sum(twice.stats.cache_hits.values()), config.CACHE_DIR, os.environ.get("NUMBA_CACHE_DIR"),
    [type(finder).__name__ for finder in sys.meta_path], sorted(vars(caching)),
    {{name: value.__module__ for name, value in vars(caching).items() if isinstance(value, type)}},
    [locator.__name__ for locator in caching.CacheImpl._locator_classes],
]))
"""
USE = "import chemage; chemage.plugin.random.uniforms(1, 2, [3])"


@pytest.mark.long
def test_a_foreign_kernel_is_kept_where_it_is_without_chemage(tmp_path):
    (tmp_path / "foreign.py").write_text(
        "from numba import njit\n\n@njit(cache=True)\ndef twice(x):\n    return 2.0 * x\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["CHEMAGE_CACHE"] = str(tmp_path / "cache")

    def said(first, after):
        code = FOREIGN.format(first=first, after=after)
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    place, hits, *numba_of_itself = said("", "")
    assert (Path(place), hits) == (tmp_path / "__pycache__", 0)
    for first, after in [("", ""), (USE, ""), ("", USE), ("import chemage", USE)]:
        assert said(first, after) == [place, 1, *numba_of_itself]
    shutil.rmtree(place)
    assert said(USE, "")[:2] == [place, 0]
    assert said("", "")[:2] == [place, 1]


STALE = """
import json
import numpy as np, chemage as ca
lattice = ca.ReactionLattice(pixels=(20, 10), sites=np.arange(200), forming=np.full(200, 0.8), breaking=np.full(200, 0.8))
counts = [ca.engine(kind).run(lattice, [3e1], temperature=300.0, seed=1).events for kind in ("rejection-free", "independent")]
print(json.dumps([int(count) for count in counts]))
"""


@pytest.mark.long
def test_after_an_update_of_the_sources_the_new_physics_is_computed(tmp_path):
    """The rate is in one file, and compiled into the kernels of others."""
    shutil.copytree(ROOT / "plugins", tmp_path / "plugins", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path / "plugins")]),
        "NUMBA_CACHE_DIR": str(tmp_path / "kernels"),
    }

    def printed(*words):
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    before = json.loads(printed("-c", STALE))
    assert json.loads(printed("-c", STALE)) == before
    edit(tmp_path / "plugins/chemage_kinetics/_common.py", "return nu * math.exp(", "return 3.0 * nu * math.exp(")
    after = json.loads(printed("-c", STALE))
    for old, new in zip(before, after, strict=True):
        assert new > 2 * old
    printed("-m", "chemage", "warmup", "silica-tip")
    assert json.loads(printed("-c", STALE)) == after
