"""Where what is made once for this machine is kept; without such a folder chemage still works."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import chemage
from chemage.foundation import machine

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
