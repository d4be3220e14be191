"""``chemage`` is for users, ``chemage.plugin`` for authors of plugins, and everything else is private."""

from __future__ import annotations

import importlib
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from plugin_api import recorded

import chemage
from chemage.plugin import registry

#: how many names users may have to look through
MOST = 56


def test_each_name_is_in_one_place_and_leads_to_something():
    users, authors = {*chemage.__all__, *registry.current().offered("names")}, set(chemage.plugin.__all__)
    assert not users & authors
    for module, offered in ((chemage, users), (chemage.plugin, authors)):
        assert set(dir(module)) == offered
        assert all(getattr(module, name) is not None for name in offered)
        with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
            module.nothing  # noqa: B018


def test_users_have_few_names():
    assert len(chemage.__all__) <= MOST


def test_what_0_2_had_is_still_there_and_says_where_it_is_now():
    brought = registry.current().offered("names")
    moved = {*recorded()["names"]} - {*chemage.__all__, *brought}
    assert len(moved) > 90
    for name in moved:
        with pytest.warns(DeprecationWarning, match=rf"^chemage\.{name} is now chemage\.plugin\.{name}$") as warned:
            before = getattr(chemage, name)
        assert before is getattr(chemage.plugin, name)
        assert warned[0].filename == __file__
    assert all(getattr(chemage, name) is getattr(chemage.plugin, name) for name in brought)


def test_a_plugin_of_0_2_runs_as_it_is(tmp_path):
    (tmp_path / "old.py").write_text("from chemage import Barriers, Energy, InputError, hookimpl, random\n")
    words = [sys.executable, "-c", "import old; print(old.Barriers, old.random.stream('a/b'))"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_importing_the_names_of_plugins_loads_nothing():
    """Entry points import ``hookimpl`` whenever chemage starts."""
    code = (
        "import sys; from chemage.plugin import hookimpl; print(len({'numpy', 'scipy', 'pydantic'} & {*sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "0\n"


FILES = ("__init__.pyi", "plugin.pyi")


@pytest.fixture
def stubs(command, tmp_path):
    """``stubs()`` is what ``chemage plugins stubs`` writes where no other plugins are installed: file -> text."""

    def stubs():
        own = [point for point in metadata.entry_points(group=registry.GROUP) if point.dist.name == "chemage"]
        with registry.using(registry.Registry(own)):
            assert command("plugins", "stubs", "--in", tmp_path, "--force").status == 0
        return {file: (tmp_path / "chemage" / file).read_text(encoding="utf-8") for file in FILES}

    return stubs


def test_the_stubs_know_every_name_and_every_option_of_every_component(stubs):
    """``chemage plugins stubs --in . --force`` makes them again."""
    for file, text in stubs().items():
        stub = Path(chemage.__file__).with_name(file).read_text(encoding="utf-8")
        missing = set(text.splitlines()) ^ set(stub.splitlines())
        assert stub == text, "\n".join(sorted(missing))


def test_a_new_option_is_seen_in_the_stubs(stubs, monkeypatch):
    hertz = registry.current().component("contact", "hertz")
    wider = type("Hertz", (hertz,), {"__annotations__": {"novelty": int}, "novelty": 1, "__module__": __name__})
    monkeypatch.setattr(importlib.import_module(hertz.__module__), "Hertz", wider)
    monkeypatch.setitem(vars(importlib.import_module("chemage_contact")), "Hertz", wider)
    changed = set(stubs()["__init__.pyi"].splitlines())
    stub = Path(chemage.__file__).with_name("__init__.pyi").read_text(encoding="utf-8")
    (line,) = changed - set(stub.splitlines())
    assert 'Literal["hertz"]' in line
    assert "novelty: int = ..." in line
