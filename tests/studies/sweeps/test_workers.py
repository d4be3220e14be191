"""Components and plugins registered by hand in sweeps: workers import them, or the sweep says at once why not."""

from __future__ import annotations

import importlib
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from textwrap import dedent
from types import ModuleType

import pytest

import chemage
from chemage import InputError
from chemage.plugin import registry

HAND = """
import numpy as np
from chemage.plugin import Barriers, Choice

class Hand(Barriers):
    "One barrier for all."
    kind = "by-hand"
    level: float = 0.8

    def quantile(self, uniform):
        return np.full(uniform.shape, self.level)

    def density(self, energy):
        return np.where(energy == self.level, np.inf, 0.0)

class Outer(Hand):
    "With another inside."
    kind = "outer"
    inner: Choice[Barriers]

    def quantile(self, uniform):
        return self.inner.quantile(uniform)
"""
HOOK = """
import chemage

@chemage.plugin.hookimpl(wrapper=True)
def chemage_solve_contact():
    found = yield
    return found.model_copy(update={"notes": ("by hand",)})
"""


@pytest.fixture
def hand(tiny, site):
    """A module with a component, on the import path and no plugin."""
    for name, text in (("hand_made", HAND), ("hand_hook", HOOK)):
        (site.folder / f"{name}.py").write_text(text)
    importlib.invalidate_caches()
    return importlib.import_module("hand_made")


def sweep(tiny, folder, forming="by-hand", **options):
    scene = tiny.scene(forming={"kind": forming} if isinstance(forming, str) else forming)
    return chemage.sweep(scene | {"sweep": {"contact.load": [5.0, 10.0]}}, folder, **options)


@pytest.mark.long
@pytest.mark.parametrize("forming", ["by-hand", {"kind": "outer", "inner": "by-hand"}])
def test_worker_processes_import_what_is_in_a_module(tiny, hand, tmp_path, forming):
    chemage.register(hand.Hand)
    chemage.register(hand.Outer)
    found = sweep(tiny, tmp_path / "out", forming, executor="processes", workers=1)
    assert found.states() == ["done", "done"]
    assert any(name.endswith("Hand") and "source" in version for name, version in found[0].summary["plugins"].items())
    here = sweep(tiny, tmp_path / "here", forming)
    assert [point.summary for point in here] == [
        {**point.summary, "timings": other.summary["timings"]} for point, other in zip(found, here, strict=True)
    ]


@pytest.mark.long
def test_a_pool_that_was_given_imports_it_too(tiny, hand, tmp_path):
    chemage.register(hand.Hand)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert sweep(tiny, tmp_path / "out", executor=pool).states() == ["done", "done"]


@pytest.mark.long
def test_workers_of_dask_import_it_too(tiny, hand, tmp_path):
    chemage.register(hand.Hand)
    assert sweep(tiny, tmp_path / "out", executor="dask", workers=1).states() == ["done", "done"]


@pytest.mark.long
def test_a_plugin_with_hooks_is_known_to_workers(tiny, hand, tmp_path):
    chemage.register(hand.Hand)
    registry.current().register(importlib.import_module("hand_hook"), "hook-by-hand")
    found = sweep(tiny, tmp_path / "out", executor="processes", workers=1)
    assert [point.contact().notes for point in found] == [("by hand",)] * 2


@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_a_class_that_cannot_be_imported_is_refused_before_anything_is_computed(tiny, hand, tmp_path, executor):
    class Local(hand.Hand):
        kind = "local"

    chemage.register(Local)
    with pytest.raises(InputError, match=r"Local \(barriers 'local'\) was registered by hand from .*test_workers"):
        sweep(tiny, tmp_path / "out", "local", executor=executor)
    assert not (tmp_path / "out").exists()
    assert tiny.computed() == []
    # this process and its threads know all
    assert sweep(tiny, tmp_path / "here", "local").states() == ["done", "done"]
    with ThreadPoolExecutor(2) as pool:
        assert sweep(tiny, tmp_path / "threads", "local", executor=pool).states() == ["done", "done"]


@pytest.mark.long
def test_a_class_that_the_sweep_does_not_use_may_be_anywhere(tiny, hand, tmp_path):
    class Local(hand.Hand):
        kind = "local"

    chemage.register(Local)
    chemage.register(hand.Hand)
    assert sweep(tiny, tmp_path / "other", executor="processes", workers=1).states() == ["done", "done"]


def test_hooks_that_cannot_be_imported_are_refused(tiny, hand, tmp_path):
    chemage.register(hand.Hand)
    module = ModuleType("nowhere")
    exec(HOOK, module.__dict__)
    registry.current().register(module, "nowhere")
    with pytest.raises(InputError, match="the plugin 'nowhere' was registered by hand from nowhere, which worker"):
        sweep(tiny, tmp_path / "out", executor="processes")
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_script_says_what_to_do(tiny, tmp_path):
    script = tmp_path / "script.py"
    scene = tiny.scene(forming={"kind": "by-hand"}) | {"sweep": {"contact.load": [5.0, 10.0]}}
    script.write_text(
        HAND
        + dedent(f"""
        import chemage
        chemage.register(Hand)
        try:
            chemage.sweep({scene!r}, "out", executor="processes", workers=1)
        except chemage.InputError as error:
            print(error)
        print(chemage.sweep({scene!r}, "out").states())
    """)
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path, check=True)
    refused, states = done.stdout.splitlines()
    assert refused.startswith("the class Hand (barriers 'by-hand') was registered by hand from __main__, which worker")
    assert 'or compute in this process (executor="serial")' in refused
    assert states == "['done', 'done']"
