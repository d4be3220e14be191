"""A design of a third party's package asks for runs, on any executor and with a folder, and brings its command.

The package is ``tests/stubs/chemage_bisection.py``, installed like any other.
"""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import chemage_bisection
import pytest
from chemage_bisection import Bisection
from tutorial import Tutorial

import chemage as ca
from chemage import plugin
from chemage.plugin import registry

SOURCE = Path(chemage_bisection.__file__)
BETA = 0.8


@pytest.fixture(autouse=True)
def installed():
    with registry.using(registry.Registry()) as plugins:
        plugins.register(chemage_bisection, "bisection")
        yield plugins


def scene(**changes):
    return ca.load_scene("silica-tip", {"hold.replicas": 8, "contact.load": "50 nN", **changes})


class Counted(Bisection):
    """Counts what was computed and what was there, and may be interrupted."""

    def __init__(self, *arguments, stop=1000):
        super().__init__(*arguments)
        self.computed, self.kept, self.stop = [], [], stop

    def tell(self, task, outcome):
        super().tell(task, outcome)
        (self.kept if outcome.kept else self.computed).append(task.changes["contact.load"])
        if len(self.computed) == self.stop:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def found():
    design = Counted(scene(), BETA, 10.0, 1000.0)
    plugin.carry_out(design)
    return design


def test_it_is_short():
    assert len(SOURCE.read_text("utf-8").splitlines()) <= 60


def test_it_is_found_by_its_entry_point(site, command):
    files = {"chemage_bisection.py": SOURCE.read_text("utf-8")}
    site.install("chemage-bisection", files, {"bisection": "chemage_bisection"})
    with registry.using(site.registry()):
        assert "Find the load at which β" in command("bisect", "--help").out


def test_the_load_is_where_a_sweep_around_it_has_it(found, tmp_path):
    around = [found.low / 4, found.low, found.high, 4 * found.high]
    swept = ca.sweep(scene(), tmp_path / "around", axes={"contact.load": around})
    betas = [point.summary["beta"] for point in swept]
    assert betas[0] > betas[1] > BETA > betas[2] > betas[3]
    assert betas[0] - betas[3] > 0.2
    assert betas[1:3] == [found.betas[found.low], found.betas[found.high]]
    assert found.high == pytest.approx(found.low, rel=0.01)


@pytest.mark.parametrize("executor", ["threads", pytest.param("processes", marks=pytest.mark.long), ThreadPoolExecutor])
def test_where_it_is_computed_changes_nothing(found, executor, tmp_path):
    design = Counted(scene(), BETA, 10.0, 1000.0)
    if isinstance(executor, str):
        plugin.carry_out(design, tmp_path / "kept", executor=executor, workers=2)
    else:
        with executor(2) as pool:
            plugin.carry_out(design, executor=pool)
    assert design.betas == found.betas


def test_an_interrupted_study_goes_on_and_computes_nothing_twice(found, tmp_path):
    first = Counted(scene(), BETA, 10.0, 1000.0, stop=5)
    with pytest.raises(KeyboardInterrupt, match=r"5 runs are kept in .*; rerun the same command to resume"):
        plugin.carry_out(first, tmp_path / "kept")
    then = Counted(scene(), BETA, 10.0, 1000.0)
    plugin.carry_out(then, tmp_path / "kept")
    assert sorted(then.kept) == sorted(first.computed)
    assert not set(then.computed) & set(first.computed)
    assert then.betas == found.betas
    again = Counted(scene(), BETA, 10.0, 1000.0)
    plugin.carry_out(again, tmp_path / "kept", executor="processes")
    assert again.computed == []
    other = Counted(scene(**{"hold.seed": 9}), BETA, 10.0, 1000.0)
    plugin.carry_out(other, tmp_path / "kept")
    assert other.kept == []


@pytest.mark.long
def test_shares_compute_each_run_once(found, tmp_path):
    designs = [Counted(scene(), BETA, 10.0, 1000.0) for _ in range(2)]
    folder = tmp_path / "kept"
    with ThreadPoolExecutor(2) as pool:
        calls = [
            pool.submit(plugin.carry_out, design, folder, points=f"{k}/2", patience=120)
            for k, design in enumerate(designs, 1)
        ]
        for call in calls:
            call.result()
    assert [design.betas for design in designs] == [found.betas] * 2
    assert len(list(folder.glob("points/*/*.json"))) == len(found.betas)
    for points, kept, said in (("1/2", None, "shares meet in a folder"), ("0-3", folder, "only a sweep has points")):
        with pytest.raises(ca.InputError, match=said):
            plugin.carry_out(Bisection(scene(), BETA, 10.0, 1000.0), kept, points=points)


def test_that_of_the_page_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ((_, code),) = Tutorial("plugins.md", "## A design of your own", "## Hooks").blocks
    assert '"silica-rough", 100.0, 0.02), "folder", workers=4)' in code
    smaller = code.replace('"silica-rough", 100.0', '"silica-tip", 10.0').replace("workers=4", "")
    exec(smaller, {"plugin": plugin})
    assert len(list(Path("folder").glob("points/*/*.json"))) > 1


def test_what_fails_is_raised_where_it_is_used(installed):
    class Heavy:
        @plugin.hookimpl
        def chemage_run_kinetics(self, contact):
            if contact.load > 500:
                raise ca.InputError("load: too heavy")

    installed.register(Heavy(), "heavy")
    with pytest.raises(ca.InputError, match="load: too heavy"):
        plugin.carry_out(Bisection(scene(), BETA, 10.0, 1000.0))

    class Careful(Bisection):
        failed = ()

        def tell(self, task, outcome):
            if outcome.error is not None:
                self.failed, self.high = (task.changes["contact.load"],), 400.0
                return
            super().tell(task, outcome)

    careful = Careful(scene(), BETA, 10.0, 1000.0)
    plugin.carry_out(careful)
    assert careful.failed == (1000.0,)
    with pytest.raises(ca.InputError, match=r"contact\.load"):
        plugin.carry_out(Bisection(scene(), BETA, -1.0, 1000.0))
    with pytest.raises(ca.InputError, match=r"design = 7: .*give a Design"):
        plugin.carry_out(7)  # pyright: ignore[reportArgumentType]


def test_the_command_has_the_options_of_studies(command, found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["bisect", "silica-tip", "--beta", BETA, "--between", 10, 1000, "--set", "hold.replicas=8"]
    done = command(*words, "--folder", "kept", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out) == {"load": found.load, "runs": len(found.betas)}
    done = command(*words, "--folder", "kept", "--workers", 2)
    assert done.out == f"load {found.load:.4g} nN\n"
    done = command(*words[:3], 5, *words[4:])
    assert done.status == 2
    assert "beta = 5.0: is not reached: β is" in done.err
    assert "choose another, or other loads" in done.err
    done = command(*words, "--executor", "nowhere")
    assert done.status == 2
    assert "no such executor" in done.err
