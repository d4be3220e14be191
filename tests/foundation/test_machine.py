"""Where what is made once for this machine is kept; without such a folder chemage still works."""

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

import chemage
from chemage.foundation import kernels, machine
from chemage.plugin import random

SCRIPT = """
import os
real = os.access
# for the superuser every folder is writable, so that it is said here which are not
def access(path, mode, **more):
    return not (str(path).startswith({shut!r}) and mode & os.W_OK) and real(path, mode, **more)
os.access = access
import chemage
from chemage.foundation.machine import kernel_folder
print(kernel_folder())
print(chemage.plugin.random.uniforms(1, 2, [3, 4]).size)
"""


@pytest.mark.long
def test_without_a_folder_to_write_to_kernels_go_to_a_temporary_one(tmp_path):
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    home.mkdir()
    temporary.mkdir()
    shut = (str(home),)
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"CHEMAGE_CACHE": str(home), "TMPDIR": str(temporary)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(shut=shut)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-1500:]
    folder, size = done.stdout.splitlines()
    assert Path(folder).parent == temporary
    assert any(Path(folder).iterdir())
    assert (Path(folder).stat().st_mode & 0o777) == 0o700
    assert size == "2"


def test_a_folder_that_somebody_else_may_write_to_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first = machine._temporary()
    assert machine._temporary() == first
    first.chmod(0o777)
    assert machine._temporary() != first


@pytest.mark.parametrize("given", ["there", "not-yet/there"])
def test_kernels_are_kept_where_numba_is_told_to_keep_them(tmp_path, monkeypatch, given):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / given))
    assert machine.kernel_folder() == tmp_path / given


@pytest.mark.parametrize(("variable", "below"), [("CHEMAGE_CACHE", "."), ("XDG_CACHE_HOME", "chemage")])
def test_everything_that_can_be_computed_again_is_in_one_folder(tmp_path, monkeypatch, variable, below):
    if variable.startswith("XDG") and sys.platform != "linux":
        pytest.skip("a convention of Linux")
    for name in ("CHEMAGE_CACHE", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, str(tmp_path))
    assert chemage.plugin.cache_folder() == tmp_path / below
    assert machine.kernel_folder() == tmp_path / below / "kernels"


# -- kernels of old sources are never used, and those of other packages are left to numba ------------------------------

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
    for name in ("CPU_NAME", "CPU_FEATURES"):
        monkeypatch.setattr(numba.config, name, None)
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
    finders = {type(finder).__module__ for finder in sys.meta_path}
    assert not [name for name in finders if name.startswith("chemage") and name != "chemage.foundation.moved"]


def printed(environment, folder, *words):
    done = subprocess.run([sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


FOREIGN = """
import json, os, sys
def around():
    # what finds the modules of 0.1 looks for no other
    return dict(os.environ), [one for one in sys.meta_path if type(one).__module__ != "chemage.foundation.moved"]
before = around()
{first}
assert around() == before or not {first!r}
from foreign import twice
twice(1.0)
{after}
from numba.core import caching, config
print(json.dumps([
    twice.stats.cache_path, sum(twice.stats.cache_hits.values()), config.CACHE_DIR, os.environ.get("NUMBA_CACHE_DIR"),
    [type(finder).__name__ for finder in around()[1]], sorted(vars(caching)),
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
        return json.loads(printed(environment, tmp_path, "-c", code))

    place, hits, *numba_of_itself = said("", "")
    assert (Path(place), hits) == (tmp_path / "__pycache__", 0)
    for first, after in [(USE, ""), ("import chemage", USE)]:
        assert said(first, after) == [place, 1, *numba_of_itself]
    shutil.rmtree(place)
    assert said(USE, "")[:2] == [place, 0]
    assert said("", "")[:2] == [place, 1]


STALE = """
import json
import numpy as np, chemage as ca
barriers = np.full(200, 0.8)
lattice = ca.ReactionLattice(pixels=(20, 10), sites=np.arange(200), forming=barriers, breaking=barriers)
engines = [ca.engine("independent")]
print(json.dumps([int(engine.run(lattice, [30.0], temperature=300.0, seed=1).events) for engine in engines]))
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

    def counts():
        return json.loads(printed(environment, tmp_path, "-c", STALE))

    before = counts()
    assert counts() == before
    edit(
        tmp_path / "plugins/chemage_kinetics/_common.py",
        "return model.nu * math.exp(",
        "return 3.0 * model.nu * math.exp(",
    )
    after = counts()
    for old, new in zip(before, after, strict=True):
        assert new > 2 * old
    assert counts() == after, "those that were kept last are used"


def test_kernels_that_are_not_to_be_compiled_are_refused_by_the_name_of_the_variable():
    command = [sys.executable, "-m", "chemage", "check", "silica-tip"]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert done.returncode == 2
    (said,) = [line for line in done.stderr.splitlines() if not line.startswith("loading")]
    assert said == (
        "chemage: NUMBA_DISABLE_JIT = '1': chemage works with compiled kernels alone; run: unset NUMBA_DISABLE_JIT"
    )
