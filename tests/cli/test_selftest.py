"""``chemage selftest`` passes here, and sees a kernel, a generator of random numbers or a file that is wrong."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from chemage.plugin import container, random
from chemage.testing import selftest

ROOT = Path(__file__).parents[2]


def test_the_known_bytes_are_those_of_the_description(monkeypatch):
    plain = b'{"title": "selftest", "numbers": [1, 2.5, 1e-09]'
    assert hashlib.sha256(plain).hexdigest() == selftest._SEALED
    selftest.bytes_are_the_known_ones()
    monkeypatch.setattr(container, "sealed_json", lambda content: b"{}")
    with pytest.raises(AssertionError, match="other bytes"):
        selftest.bytes_are_the_known_ones()


def test_wrong_random_numbers_and_files_are_seen(monkeypatch):
    selftest.random_numbers_are_the_published_ones()
    selftest.files_give_back_what_was_written()
    monkeypatch.setattr(random, "philox", lambda *words: (0, 0, 0, 0))
    with pytest.raises(AssertionError, match="philox gives"):
        selftest.random_numbers_are_the_published_ones()
    monkeypatch.setattr(container, "read", lambda path, kinds: ({}, {}))
    with pytest.raises(AssertionError, match="differ from those written"):
        selftest.files_give_back_what_was_written()


def test_every_solver_engine_and_reader_is_tested():
    components, unmade = selftest.examples()
    parts = {f"{component.role} {component.kind}" for component in components}
    for role in ("contact", "engine", "reader"):
        for kind in selftest.registry.current().kinds(role):
            assert f"{role} {kind}" in parts
    assert not {part for part in unmade if part.startswith(("contact", "engine", "reader"))}


def test_a_solver_whose_library_is_not_installed_is_not_tested_and_nothing_is_wrong(command, monkeypatch, tmp_path):
    libraries = {"contactmechanics": "ContactMechanics", "tamaas": "tamaas"}
    for library in libraries.values():
        missing = f"raise ModuleNotFoundError(name={library!r})"
        (tmp_path / f"{library}.py").write_text(missing)
    monkeypatch.syspath_prepend(str(tmp_path))
    peers = [one for one in selftest.examples()[0] if one.kind in libraries]
    monkeypatch.setattr(selftest, "examples", lambda: (peers, {}))
    done = command("selftest")
    assert done.status == 0
    assert "WRONG" not in done.out
    for kind, library in libraries.items():
        assert f"not tested contact {kind}: {library} is not installed; run: pip install 'chemage[{kind}]'" in done.out


#: part of the selftest -> the file of its kernel, a term of it and a factor that makes it wrong
BROKEN = {
    "engine bkl": ("chemage_kinetics/_rate_classes.py", "math.exp((c", 0.8),
    "contact fft-bem": ("chemage_contact/_kernels.py", "s[k] * g[k]", 1.1),
}


@pytest.mark.campaign
def test_broken_kernels_are_caught_where_the_right_ones_are_kept(tmp_path):
    shutil.copytree(ROOT / "plugins", tmp_path / "plugins")
    path = os.pathsep.join([str(ROOT), str(tmp_path / "plugins")])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}

    def failed():
        command = [sys.executable, "-m", "chemage", "selftest", "--json"]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
        assert done.stdout, done.stderr
        return {one["part"] for one in json.loads(done.stdout)["parts"] if one["problems"]}

    assert not failed()
    for file, right, factor in BROKEN.values():
        broken = tmp_path / "plugins" / file
        assert broken.read_text().count(right) == 1
        broken.write_text(broken.read_text().replace(right, f"{factor} * {right}"))
    found = failed()
    assert found >= BROKEN.keys()
    assert "engine rejection-free" not in found
