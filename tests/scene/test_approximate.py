"""An approximate component is marked wherever a number of its result appears, and exact ones change nothing."""

from __future__ import annotations

import csv
import json
import sys
from types import ModuleType
from typing import ClassVar

import pytest
from nested import Outer
from seen import comparison_figures, figures, report

import chemage as ca
from chemage import compare_files, parse_scene
from chemage.plugin import registry

WORDS = "coarse (declared error 2 % of the mean number of bonds)"


@pytest.fixture
def parts(tiny):
    return sys.modules[type(ca.engine("tiny-coin")).__module__]


def approximate(base, kind="coarse", error: float | None = 0.02, **attributes):
    given = {"__module__": __name__, "__doc__": kind, "kind": kind, "exact": False, "declared_error": error}
    return ca.register(type(kind.title(), (base,), given | attributes))


def ran(tiny, **sections):
    return ca.run(parse_scene(tiny.scene(**sections)), threads=1)


ROLES = {
    "surface": ("Tip", {}, "the heights"),
    "contact": ("Even", {"load": 10.0}, "the pressure"),
    "forming": ("Flat", {}, "the barriers"),
    "engine": ("Coin", {}, "the mean number of bonds"),
}


@pytest.mark.parametrize("section", ROLES)
def test_a_component_of_any_role_is_marked(tiny, parts, section):
    base, options, of = ROLES[section]
    approximate(getattr(parts, base))
    run = ran(tiny, **{section: {"kind": "coarse", **options}})
    assert run.approximate == f"coarse (declared error 2 % of {of})"
    assert run.ageing.approximate[0]["kind"] == "coarse"
    assert bool(run.contact.approximate) == (section in ("surface", "contact"))


def test_several_components_are_named_each_once(tiny, parts):
    approximate(parts.Flat, "rude", error=None)
    approximate(parts.Coin)
    run = ran(tiny, forming={"kind": "rude"}, breaking={"kind": "rude"}, engine={"kind": "coarse"})
    assert sorted(run.approximate.split("; ")) == [WORDS, "rude (no error declared)"]


def test_an_observable_is_marked(tiny):
    class Guess(ca.plugin.Observable):
        """Guesses."""

        kind = "guess"
        exact = False

        def measure(self, contact, lattice, history):
            return {"guess": 1.0}

    ca.register(Guess)
    assert ran(tiny, observe=[{"kind": "guess"}]).approximate == "guess (no error declared)"


def test_a_component_inside_a_component_is_marked(tiny, parts):
    approximate(parts.Coin)
    ca.register(Outer)
    assert ran(tiny, engine={"kind": "outer", "inner": "coarse"}).approximate == WORDS


class Selecting(ca.plugin.Engine):
    """Selects an engine by itself, as ``auto`` does, and records which."""

    kind = "selecting"

    def _run(self, lattice, hold_times, temperature, seed, start):
        chosen = ca.engine("coarse")
        return chosen.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)


def test_an_engine_that_was_selected_is_marked(tiny, parts):
    def _run(self, *given):
        return parts.Coin._run(self, *given).model_copy(update={"engine": "coarse"})

    approximate(parts.Coin, _run=_run)
    ca.register(Selecting)
    assert ran(tiny, engine={"kind": "selecting"}).approximate == WORDS


HOOK = """
@chemage.plugin.hookimpl(wrapper=True)
def chemage_solve_contact():
    found = yield
    mark = {"kind": "cap", "declared_error": 0.1, "of": "the pressure"}
    return found.model_copy(update={"provenance": {**found.provenance, "approximate": [mark]}})
"""


def test_a_plugin_of_hooks_marks_its_answer(tiny):
    module = ModuleType("cap")
    exec("import chemage\n" + HOOK, module.__dict__)
    registry.current().register(module, "cap")
    run = ran(tiny)
    assert run.approximate == "cap (declared error 10 % of the pressure)"
    assert run.ageing.approximate == run.contact.approximate


def test_checkpoints_keep_the_mark(tiny, parts, tmp_path):
    approximate(parts.Coin)
    scene = parse_scene(tiny.scene(engine={"kind": "coarse"}))
    assert ca.run(scene, checkpoints=tmp_path).approximate == WORDS
    assert ca.run(scene, checkpoints=tmp_path).approximate == WORDS


@pytest.fixture
def written(tiny, parts, tmp_path, monkeypatch):
    """Files in the working folder: an approximate run, an exact one, and the ageing of the approximate one alone."""
    approximate(parts.Coin)
    monkeypatch.chdir(tmp_path)
    ca.write("a.h5", ran(tiny, engine={"kind": "coarse"}))
    ca.write("b.h5", ran(tiny))
    ca.write("ageing.h5", ca.read("a.h5").ageing)


@pytest.mark.usefixtures("written")
def test_files_and_comparisons_say_so(command):
    assert ca.read("a.h5").approximate == WORDS
    shown = " ".join(command("show", "a.h5").out.split())
    assert f"note: approximate: {WORDS}" in shown
    assert f"approximate {WORDS[:20]}" in " ".join(command("show", "a.h5", "--all").out.split())
    assert json.loads(command("show", "a.h5", "--json").out)["approximate"] == WORDS
    assert "approximate" in command("show", "ageing.h5").out
    assert "approximate" not in command("show", "b.h5").out
    made = compare_files(["a.h5", "b.h5", "ageing.h5"])
    assert dict(made.table())["approximate"] == [WORDS, "-", WORDS]
    assert [one["approximate"] for one in made.numbers()] == [WORDS, "", WORDS]
    assert [row["approximate"] for row in csv.DictReader(made.csv().splitlines())] == [WORDS, "", WORDS]


@pytest.mark.long
@pytest.mark.usefixtures("written")
def test_figures_and_reports_say_so():
    made = compare_files(["a.h5", "b.h5", "ageing.h5"])
    legend = comparison_figures(made)["friction-drop"].axes[0].get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    assert [label.partition(",")[0] for label in labels] == ["a (approximate)", "b", "ageing (approximate)"]
    page = report(["a.h5", "b.h5"])
    assert f"<strong>Note:</strong> approximate: {WORDS}" in page
    captions = [line.split("</figcaption>")[0] for line in page.split("<figcaption>")[1:]]
    assert sum(f"a is approximate: {WORDS}." in caption for caption in captions) >= 3
    assert sum(f"The result is approximate: {WORDS}." in caption for caption in captions) >= 3
    run = ca.read("a.h5")
    title = figures(run)["friction"].get_suptitle()
    assert title.endswith(f"\napproximate: {WORDS}")


def test_exact_results_say_nothing(tiny, tmp_path):
    run = ran(tiny)
    assert run.approximate == ""
    assert "approximate" not in run.summary()
    assert "approximate" not in run.ageing.provenance
    assert "approximate" not in run.contact.provenance
    ca.write(tmp_path / "a.h5", run)
    made = compare_files([tmp_path / "a.h5"])
    assert "approximate" not in dict(made.table())
    assert "approximate" not in made.csv()


@pytest.mark.long
def test_reports_of_exact_results_say_nothing(tiny, tmp_path):
    ca.write(tmp_path / "a.h5", ran(tiny))
    assert "pproximate" not in report([tmp_path / "a.h5"])


class Sometimes(ca.plugin.Engine):
    """Approximate where an option says so."""

    kind = "sometimes"
    error_of: ClassVar[str] = "the rate"
    quick: bool = False
    """whether to approximate"""

    @property
    def exact(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return not self.quick

    declared_error: ClassVar[float | None] = 0.5

    def _run(self, lattice, hold_times, temperature, seed, start):
        return ca.engine("tiny-coin").run(lattice, hold_times, temperature=temperature, seed=seed, start=start)


def test_a_sweep_lists_the_points_that_are_approximate(tiny, tmp_path):
    ca.register(Sometimes)
    scene = tiny.scene(engine={"kind": "sometimes"}, sweep={"engine.quick": [False, True]})
    swept = ca.sweep(scene, tmp_path / "sweep")
    rows = list(csv.DictReader((tmp_path / "sweep" / "results.csv").read_text().splitlines()))
    words = "sometimes (declared error 50 % of the rate)"
    assert [row["approximate"] for row in rows] == ["", words]
    assert swept.table().marks["approximate"] == ["", words]
    exact = ca.sweep(tiny.scene(sweep={"contact.load": [10.0, 20.0]}), tmp_path / "exact")
    assert "approximate" not in exact.table().marks
    assert "approximate" not in (tmp_path / "exact" / "results.csv").read_text()
