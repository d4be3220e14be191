"""A plugin made by ``chemage plugins new`` works as it is: it registers and passes the tests it comes with."""

import re
import subprocess
import sys
import tomllib
from importlib import resources
from pathlib import Path

import pytest

import chemage
from chemage import InputError, scaffold
from chemage.plugin import API_VERSION, StoreError, registry

#: one process for the plugins of all roles, because it takes longer to start than most of their tests to run
PROGRAM = """
import importlib, sys, pytest
from chemage.plugin import registry
plugins = registry.current()
folders = {}
for role, folder in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
    sys.path.insert(0, folder)
    folders[role] = folder
    plugins.register(importlib.import_module(f"chemage_fresh_{role}"), f"fresh-{role}")
    assert plugins.component(role, f"fresh-{role}").kind == f"fresh-{role}"
assert not plugins.check(), plugins.check()
for role, folder in folders.items():
    options = ["-q", "-p", "no:cacheprovider", "--import-mode=importlib", f"--rootdir={folder}"]
    assert pytest.main([*options, f"{folder}/tests"]) == 0, f"the tests of the new {role} fail"
    print(f"{role}: its tests pass")
"""


@pytest.mark.long
def test_new_plugins_register_and_pass_their_own_tests(tmp_path: Path):
    roles = registry.current().roles
    words = [sys.executable, "-c", PROGRAM]
    for role in roles:
        words += [role, str(scaffold.new(f"fresh-{role}", role, tmp_path)[0].parent)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(f"{role}: its tests pass" in done.stdout for role in roles)


def test_an_existing_folder_is_kept(tmp_path: Path):
    (tmp_path / "chemage-mine").mkdir()
    with pytest.raises(StoreError, match="already there"):
        scaffold.new("mine", "barriers", tmp_path)
    assert not list((tmp_path / "chemage-mine").iterdir())


@pytest.mark.parametrize("name", ["Mine", "1st", "a b", "a--b", "lambda", "", "../up"])
def test_names_that_cannot_be_kinds_are_refused(name: str, tmp_path: Path):
    with pytest.raises(InputError, match="is not a valid kind"):
        scaffold.new(name, "barriers", tmp_path)
    assert not list(tmp_path.iterdir())


def test_unknown_role_names_the_nearest(tmp_path: Path):
    with pytest.raises(InputError, match=r"no role 'barrier' \(did you mean 'barriers'\?\)"):
        scaffold.new("mine", "barrier", tmp_path)


def test_every_role_has_a_template():
    names = {path.name for path in resources.files("chemage.scaffold").joinpath("templates").iterdir()}
    roles = {found[1] for name in names if (found := re.fullmatch(r"role_(\w+)\.py\.in", name))}
    assert roles == set(registry.current().roles)


def test_a_new_plugin_states_its_interface_and_the_versions_that_it_works_with(tmp_path: Path):
    files = scaffold.new("mine", "barriers", tmp_path)
    major, minor, *_ = chemage.__version__.split(".")
    project = tomllib.loads(files[0].read_text())["project"]
    assert project["dependencies"] == [f"chemage>={major}.{minor},<{int(major) + 1}"]
    assert f"CHEMAGE_API = {API_VERSION}\n" in (files[0].parent / "chemage_mine" / "__init__.py").read_text()


def test_a_kind_or_a_name_that_is_taken_is_reported(tmp_path: Path, site):
    with pytest.warns(
        registry.PluginWarning, match=r"barriers 'gaussian' comes with 'barriers' \(chemage .*choose anoth"
    ):
        scaffold.new("gaussian", "barriers", tmp_path)
    source = "import chemage\n@chemage.plugin.hookimpl\ndef chemage_register():\n    return {}"
    site.install("chemage-mine", {"chemage_mine.py": source}, {"chemage_mine": "chemage_mine"})
    with registry.using(registry.Registry()), pytest.warns(registry.PluginWarning, match="a plugin 'chemage_mine' is"):
        scaffold.new("mine", "barriers", tmp_path)
