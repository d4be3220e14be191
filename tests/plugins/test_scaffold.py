"""A plugin made by ``chemage plugins new`` works as it is: it registers and passes the tests it comes with."""

import re
import subprocess
import sys
import tomllib
from importlib import resources
from pathlib import Path
from types import ModuleType

import pytest

import chemage
from chemage import InputError
from chemage.plugin import API_VERSION, registry

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


@pytest.fixture
def new(command, tmp_path):
    """``new(name, role)``: ``chemage plugins new`` in the folder of the test; the files that it made."""

    def new(name: str, role: str = "barriers") -> list[Path]:
        done = command("plugins", "new", "--role", role, "--in", tmp_path, "--", name)
        if done.status:
            raise InputError(" ".join(done.err.split()))
        return [path for path in map(Path, done.out.split()) if path.is_absolute() and path.is_file()]

    return new


@pytest.mark.long
def test_new_plugins_register_and_pass_their_own_tests(new, tmp_path: Path):
    roles = registry.Registry(()).roles
    words = [sys.executable, "-c", PROGRAM]
    for role in roles:
        words += [role, str(new(f"fresh-{role}", role)[0].parent)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(f"{role}: its tests pass" in done.stdout for role in roles)


def test_an_existing_folder_is_kept(new, tmp_path: Path):
    (tmp_path / "chemage-mine").mkdir()
    with pytest.raises(InputError, match="already there"):
        new("mine")
    assert not list((tmp_path / "chemage-mine").iterdir())


@pytest.mark.parametrize("name", ["Mine", "1st", "a b", "a--b", "lambda", "", "../up"])
def test_names_that_cannot_be_kinds_are_refused(new, name: str, tmp_path: Path):
    with pytest.raises(InputError, match="is not a valid kind"):
        new(name)
    assert not list(tmp_path.iterdir())


def test_unknown_role_names_the_nearest(new):
    with pytest.raises(InputError, match=r"no role 'barrier' \(did you mean 'barriers'\?\)"):
        new("mine", "barrier")


def test_every_role_has_a_template():
    names = {path.name for path in resources.files("chemage.scaffold").joinpath("templates").iterdir()}
    roles = {found[1] for name in names if (found := re.fullmatch(r"role_(\w+)\.py\.in", name))}
    assert roles == set(registry.Registry(()).roles)


def test_what_new_plugins_describe_in_a_unit_is_a_quantity_in_that_unit():
    described = set()
    for role in registry.Registry(()).roles:
        text = resources.files("chemage.scaffold").joinpath("templates", f"role_{role}.py.in").read_text()
        names = {"__name__": f"scaffold_{role}"}
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(sys.modules, f"scaffold_{role}", ModuleType(f"scaffold_{role}"))
            exec(text.format(cls="Made", kind="made"), names)
        options = re.findall(r'^    (\w+): .*\n    """.*, (nm|eV|GPa|s|nN)"""$', text, re.M)
        for name, unit in options:
            assert names["Made"].model_json_schema()["properties"][name]["unit"] == unit
        described |= {role for _ in options}
    assert {"rupture", "surface", "barriers", "contact", "interaction"} <= described


def test_a_new_plugin_states_its_interface_and_the_versions_that_it_works_with(new):
    files = new("mine")
    major, minor, *_ = chemage.__version__.split(".")
    project = tomllib.loads(files[0].read_text())["project"]
    assert project["dependencies"] == [f"chemage>={major}.{minor},<{int(major) + 1}"]
    assert f"CHEMAGE_API = {API_VERSION}\n" in (files[0].parent / "chemage_mine" / "__init__.py").read_text()


@pytest.mark.filterwarnings("default")
def test_a_kind_or_a_name_that_is_taken_is_reported(command, tmp_path: Path, site):
    def reported(name: str) -> str:
        return " ".join(command("plugins", "new", name, "--role", "barriers", "--in", tmp_path).err.split())

    assert re.search(r"barriers 'gaussian' comes with 'bonds' \(chemage .*choose anoth", reported("gaussian"))
    source = "import chemage\n@chemage.plugin.hookimpl\ndef chemage_register():\n    return {}"
    site.install("chemage-mine", {"chemage_mine.py": source}, {"chemage_mine": "chemage_mine"})
    with registry.using(registry.Registry()):
        assert "a plugin 'chemage_mine' is" in reported("mine")
