"""The interface for plugins is what ``api.json`` records: names and arguments are added, and none is removed or changed
unless ``API_VERSION`` rises."""

from __future__ import annotations

import copy
import re
from pathlib import Path

import pytest
from plugin_api import broken, present, recorded

from chemage.plugin import API_VERSION

RECORD = "python tests/stubs/plugin_api.py"


def test_nothing_that_plugins_use_is_gone():
    before = recorded()
    if before["api"] == API_VERSION:
        assert broken(before, present()) == [], "keep it, or raise API_VERSION and add the change to docs/plugins.md"


def test_what_is_there_is_recorded():
    assert present() == recorded(), f"run `{RECORD}` and commit tests/plugins/api.json"


def test_the_page_says_which_interface_it_describes():
    page = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text(encoding="utf-8")
    assert re.search(rf"API version {API_VERSION}\b", page)


CHANGES = {
    "a name": (lambda api: api["names"].remove("Barriers"), "the public name Barriers is gone"),
    "a module": (lambda api: api["modules"].pop("random"), "the public module chemage.foundation.random is gone"),
    "a hook": (lambda api: api["hooks"].pop("chemage_cli"), "chemage_cli is gone"),
    "an argument of a hook": (
        lambda api: api["hooks"]["chemage_solve_contact"].remove("start"),
        "chemage_solve_contact: start is gone",
    ),
    "a role": (lambda api: api["roles"].pop("engine"), "role engine: Engine is gone"),
    "a method": (
        lambda api: api["roles"]["contact"]["methods"].pop("expected"),
        "contact: expected(self, surface, load) is now expected()",
    ),
    "the order of arguments": (
        lambda api: api["roles"]["barriers"]["methods"].update(density=["energy", "self"]),
        "barriers: density(self, energy) is now density(energy, self)",
    ),
    "one more argument": (
        lambda api: api["roles"]["barriers"]["methods"]["density"].append("temperature"),
        "barriers: density(self, energy) is now density(self, energy, temperature)",
    ),
    "one more by position, with a default": (
        lambda api: api["roles"]["barriers"]["methods"]["density"].append("temperature="),
        "barriers: density(self, energy) is now density(self, energy, temperature=)",
    ),
    "one more to define": (
        lambda api: api["roles"]["barriers"]["abstract"].append("mean"),
        "barriers: plugins must now define mean",
    ),
    "an attribute": (
        lambda api: api["roles"]["engine"]["attributes"].remove("restart"),
        "engine: the attribute restart is gone",
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_that_breaks_plugins_is_found(change):
    do, said = CHANGES[change]
    now = copy.deepcopy(recorded())
    do(now)
    assert broken(recorded(), now) == [said]


def test_additions_break_nothing():
    now = copy.deepcopy(recorded())
    now["names"].append("Novelty")
    now["modules"]["novelty"] = "chemage.novelty"
    now["hooks"]["chemage_novelty"] = ["thing"]
    now["hooks"]["chemage_solve_contact"].append("more")
    now["roles"]["novelty"] = {"class": "Novelty", "abstract": [], "methods": {}, "attributes": []}
    now["roles"]["barriers"]["methods"]["density"] += ["*", "temperature="]
    now["roles"]["contact"]["methods"]["solve"].append("threads=")
    now["roles"]["contact"]["methods"]["novelty"] = ["self"]
    assert broken(recorded(), now) == []
