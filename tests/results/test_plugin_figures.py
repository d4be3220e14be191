"""Figures of plugins: of components of every role and of hooks, in runs, comparisons and reports."""

from __future__ import annotations

import sys
import warnings
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest
from nested import Outer
from seen import Comparison, Entry, comparison_figures, report
from seen import every_figure as figures

import chemage as ca
from chemage import compare_files, parse_scene
from chemage.plugin import figures as plots
from chemage.plugin import registry


def drawing(base, kind, named, draw):
    """A subclass of a component with figures, registered."""
    made = type(kind.title().replace("-", ""), (base,), {"__module__": __name__, "__doc__": kind, "kind": kind})
    made.figures, made.draw = named, draw
    return ca.register(made)


def level(self, figure, axes, results):
    """One line per result."""
    for number, one in enumerate(results):
        axes.plot([0, 1], [number, number], color=one.color, label=one.label)


@pytest.fixture
def parts(tiny):
    return sys.modules[type(ca.engine("tiny-coin")).__module__]


def ran(tiny, **sections):
    return ca.run(parse_scene(tiny.scene(**sections)), threads=1)


def labels(figure):
    (axes, *_) = figure.axes
    return [line.get_label() for line in axes.lines]


ROLES = {
    "surface": ("Tip", "surface", {}),
    "contact": ("Even", "contact", {"load": 10.0}),
    "barriers": ("Flat", "forming", {}),
    "engine": ("Coin", "engine", {}),
}


@pytest.mark.parametrize(
    "role", [pytest.param(role, marks=() if role == "engine" else pytest.mark.long) for role in ROLES]
)
def test_a_component_of_any_role_brings_figures(tiny, parts, tmp_path, role):
    base, section, options = ROLES[role]
    seen = []

    def draw(self, figure, axes, results):
        seen.append((self, results))
        level(self, figure, axes, results)

    cls = drawing(getattr(parts, base), "mine", {"mine-figure": "What mine does."}, draw)
    run = ran(tiny, **{section: {"kind": "mine", **options}})
    paths = plots.save_figures(figures(run), tmp_path / "figures")
    assert "mine-figure.png" in [path.name for path in paths]
    ((one, (result,)),) = seen
    assert type(one) is cls
    assert isinstance(result, ca.plugin.PlottedResult)
    assert (result.label, result.color) == ("tiny", plots.BLUE)
    assert result.ageing == run.ageing
    assert result.contact == run.contact
    assert result.surface == run.surface
    assert result.chemistry is not None
    assert result.component == one
    ca.write(tmp_path / "a.h5", run)
    ca.write(tmp_path / "b.h5", ran(tiny, **{section: {"kind": "mine", **options}}, hold={"times": [1.0, 10.0]}))
    both = comparison_figures(compare_files([tmp_path / "a.h5", tmp_path / "b.h5"]))
    assert labels(both["mine-figure"]) == ["a", "b"]
    assert [one.contact for one in seen[-1][1]] == [run.contact, run.contact]
    if role != "barriers":
        return
    page = report([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert page.count("<figcaption>What mine does.</figcaption>") == 3


def test_each_result_is_drawn_with_its_own_options(tiny, parts, tmp_path):
    def draw(self, figure, axes, results):
        for one in results:
            axes.plot([0.8, one.component.top], [0, 1], label=one.label)

    drawing(parts.Flat, "mine", {"mine-figure": "Barriers."}, draw)
    for top in (1.2, 1.6):
        ca.write(tmp_path / f"{top}.h5", ran(tiny, forming={"kind": "mine", "top": top}))
    made = comparison_figures(compare_files([tmp_path / "1.2.h5", tmp_path / "1.6.h5"]))["mine-figure"]
    assert [line.get_xdata()[1] for line in made.axes[0].lines] == [1.2, 1.6]


@pytest.mark.long
def test_one_kind_twice_in_a_result_is_told_apart(tiny, parts):
    drawing(parts.Flat, "mine", {"mine-figure": "Barriers."}, level)
    figure = figures(ran(tiny, forming={"kind": "mine"}, breaking={"kind": "mine"}))["mine-figure"]
    assert labels(figure) == ["tiny, forming", "tiny, breaking"]
    assert [line.get_color() for line in figure.axes[0].lines] == list(plots.PALETTE[:2])


def test_a_component_inside_a_component_brings_its_figures(tiny, parts):
    drawing(parts.Coin, "mine", {"mine-figure": "Coins."}, level)
    ca.register(Outer)
    assert "mine-figure" in figures(ran(tiny, engine={"kind": "outer", "inner": "mine"}))


@pytest.mark.long
def test_contact_mechanics_alone_has_the_figures_of_its_components(tiny, parts, tmp_path):
    drawing(parts.Tip, "tip", {"tip-figure": "A tip."}, level)
    scene = {name: part for name, part in tiny.scene(surface={"kind": "tip"}).items() if name in ("name", "contact")}
    run = ca.run(parse_scene({**scene, "surface": {"kind": "tip"}}))
    assert "tip-figure" in figures(run)


def test_an_ageing_curve_alone_has_the_figures_of_its_chemistry_and_engine(tiny, parts, tmp_path):
    drawing(parts.Flat, "flat", {"flat-figure": "Barriers."}, level)
    drawing(parts.Coin, "coin", {"coin-figure": "Coins."}, level)
    ca.write(tmp_path / "ageing.h5", ran(tiny, forming={"kind": "flat"}, engine={"kind": "coin"}).ageing)
    assert {"flat-figure", "coin-figure"} <= set(comparison_figures(compare_files([tmp_path / "ageing.h5"])))


# -- what goes wrong --------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_figure_that_fails_costs_nothing_else(tiny, parts, tmp_path):
    def draw(self, figure, axes, results):
        if figure == "broken":
            raise ValueError("no such thing")
        axes.plot([0, 1])
        axes.set_title("$x_$" if figure == "formula" else "fine")

    drawing(parts.Flat, "mine", {"broken": "A.", "formula": "B.", "right": "C."}, draw)
    run = ran(tiny, forming={"kind": "mine"})
    with pytest.warns(registry.PluginWarning) as warned:
        made = figures(run)
    assert list(made) == ["surface", "pressure", "friction", "right"]
    first, second = (str(one.message) for one in warned if one.category is registry.PluginWarning)
    assert "'broken' of barriers 'mine' (plugin tests.results.test_plugin_figures.Mine" in first
    assert "ValueError: no such thing" in first
    assert "'formula' of barriers 'mine'" in second
    plots.save_figures(made, tmp_path / "figures")
    with pytest.warns(registry.PluginWarning):
        assert set(comparison_figures(alone(run))) >= {"friction-drop", "right"}


def alone(run):
    return Comparison([Entry.of(run)])


@pytest.mark.long
def test_the_command_line_writes_the_result_and_says_what_failed(tiny, parts, command, tmp_path, monkeypatch):
    def draw(self, figure, axes, results):
        raise SystemExit("leave")

    drawing(parts.Flat, "mine", {"broken": "A."}, draw)
    monkeypatch.chdir(tmp_path)
    scene = '[surface]\nkind="tiny-tip"\n[contact]\nkind="tiny-even"\nload=10\n[forming]\nkind="mine"\n'
    (tmp_path / "x.toml").write_text(scene + '[engine]\nkind="tiny-coin"\n[hold]\ntimes=[1,10]\nreplicas=2\n')
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        done = command("run", "x.toml", "--out", "x.h5")
        assert command("plot", "x.h5", "--out", "again").status == 0
    assert done.status == 0, done.err
    assert "chemage: warning: the figure 'broken' of barriers 'mine'" in done.err
    assert (tmp_path / "x.h5").exists()
    assert (tmp_path / "x-figures" / "friction.png").exists()


def test_in_strict_mode_a_figure_that_fails_is_an_error(tiny, parts, monkeypatch):
    def draw(self, figure, axes, results):
        raise ValueError("no such thing")

    drawing(parts.Flat, "mine", {"broken": "A."}, draw)
    run = ran(tiny, forming={"kind": "mine"})
    monkeypatch.setattr(registry.current(), "strict", True)
    with pytest.raises(ValueError, match="no such thing"):
        figures(run)


def test_two_figures_of_one_name_are_both_drawn_and_reported(tiny, parts):
    drawing(parts.Flat, "mine", {"same": "Barriers.", "pressure": "Not chemage's."}, level)
    drawing(parts.Coin, "coin", {"same": "Coins."}, level)
    run = ran(tiny, forming={"kind": "mine"}, engine={"kind": "coin"})
    plain = figures(run.contact)["pressure"]
    with pytest.warns(registry.PluginWarning) as warned:
        made = figures(run)
    assert list(made) == ["surface", "pressure", "friction", "same", "mine-pressure", "coin-same"]
    assert len(made["pressure"].axes) == len(plain.axes)
    own, other = (str(one.message) for one in warned if one.category is registry.PluginWarning)
    assert "'pressure' of barriers 'mine'" in own
    assert "chemage itself" in own
    assert "'same' of engine 'coin'" in other
    assert "barriers 'mine'" in other
    assert "'coin-same'" in other


@pytest.mark.parametrize(
    "name", ["../up", "", *(pytest.param(name, marks=pytest.mark.long) for name in ("a/b", ".hidden", "two\nlines"))]
)
def test_a_name_that_is_no_file_is_left_out(tiny, parts, name):
    drawing(parts.Flat, "mine", {name: "A."}, level)
    run = ran(tiny, forming={"kind": "mine"})
    with pytest.warns(registry.PluginWarning, match="names a file"):
        assert list(figures(run)) == ["surface", "pressure", "friction"]


@pytest.mark.long
def test_figures_that_are_no_mapping_are_reported(tiny, parts):
    drawing(parts.Flat, "mine", ("a", "b"), level)
    run = ran(tiny, forming={"kind": "mine"})
    with pytest.warns(registry.PluginWarning, match="does not map names to captions"):
        figures(run)


# -- of hooks ---------------------------------------------------------------------------------------------------------

CAP = """
@chemage.plugin.hookimpl(wrapper=True)
def chemage_solve_contact(load):
    found = yield
    return found.model_copy(update={"notes": ("capped",)}) if load > 20 else found
"""
FIGURES = """
@chemage.plugin.hookimpl
def chemage_figures():
    return {"cap": ("How much was capped.", draw)}

def draw(axes, results):
    for one in results:
        axes.plot([0, 1], [one.contact.load, 1], color=one.color, label=one.label)
"""


def plugin(text, name="cap"):
    module = ModuleType(name)
    exec("import chemage\n" + text, module.__dict__)
    return registry.current().register(module, name)


def loaded(tiny, load):
    return ran(tiny, contact={"kind": "tiny-even", "load": load})


@pytest.mark.long
def test_a_plugin_of_hooks_draws_the_results_in_which_it_took_part(tiny, tmp_path):
    plugin(CAP + FIGURES)
    for load in (10.0, 30.0, 40.0):
        run = loaded(tiny, load)
        assert ("cap" in figures(run)) == (load > 20)
        ca.write(tmp_path / f"{load:g}.h5", run)
    made = compare_files([tmp_path / f"{load}.h5" for load in (10, 30, 40)])
    assert labels(comparison_figures(made)["cap"]) == ["30", "40"]
    assert report([tmp_path / "30.h5"]).count("<figcaption>How much was capped.</figcaption>") == 1
    assert "How much was capped" not in report([tmp_path / "10.h5"])


def test_a_plugin_that_computes_nothing_draws_every_result(tiny):
    plugin(FIGURES)
    assert "cap" in figures(loaded(tiny, 10.0))


@pytest.mark.long
def test_two_plugins_with_one_figure(tiny):
    plugin(FIGURES, "first")
    plugin(FIGURES, "second")
    with pytest.warns(registry.PluginWarning, match=r"'cap' of plugin 'second'.*'second-cap'"):
        made = figures(loaded(tiny, 10.0))
    assert {"cap", "second-cap"} <= set(made)


@pytest.mark.parametrize(
    "answer",
    ["1 / 0"]
    + [pytest.param(each, marks=pytest.mark.long) for each in ("3", "{'a': 'caption only'}", "{'a': ('x', 'y', 'z')}")],
)
def test_a_wrong_answer_is_reported(tiny, answer):
    plugin(f"@chemage.plugin.hookimpl\ndef chemage_figures():\n    return {answer}\n")
    run = loaded(tiny, 10.0)
    with pytest.warns(registry.PluginWarning, match="of plugin 'cap'"):
        assert list(figures(run)) == ["surface", "pressure", "friction"]


def test_no_answer_is_no_figure(tiny):
    plugin("@chemage.plugin.hookimpl\ndef chemage_figures():\n    return None\n")
    assert list(figures(loaded(tiny, 10.0))) == ["surface", "pressure", "friction"]


# -- as it was --------------------------------------------------------------------------------------------------------


class Count(ca.plugin.Observable):
    """How many bonds."""

    kind = "count"
    figures: ClassVar = {"count": "Bonds."}

    def measure(self, contact, lattice, history):
        return {"bonded": float(history.bonds[-1])}

    def draw(self, figure, axes, results):
        assert all(isinstance(one, ca.plugin.Observed) for one in results)
        for one in results:
            axes.plot(one.ageing.observables["bonded"], label=one.label)


def test_observables_draw_as_before(tiny):
    ca.register(Count)
    run = ran(tiny, observe=[{"kind": "count"}])
    (line,) = figures(run)["count"].axes[0].lines
    assert np.array_equal(line.get_ydata(), run.ageing.observables["bonded"])
    one = ca.plugin.Observed("one", run.ageing, None, "C0")
    assert (one.label, one.chemistry, one.color, one.contact, one.surface) == ("one", None, "C0", None, None)


@pytest.mark.long
def test_nothing_of_matplotlib_is_imported_with_the_components():
    import subprocess

    use = "import sys, chemage as ca; ca.plugin.Engine, ca.plugin.PlottedResult, ca.engine('bkl')"
    code = f"{use}; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
