"""Who took part in a result: plugins that answered the hook of a stage or changed its answer, and no others."""

from __future__ import annotations

import inspect
from types import ModuleType

import pytest

import chemage
from chemage import parse_scene
from chemage.plugin import registry

PLAIN = """
    @chemage.plugin.hookimpl
    def {hook}({arguments}):
        {before}
        return {answer}
"""
WRAPPER = """
    @chemage.plugin.hookimpl(wrapper=True)
    def {hook}():
        found = yield
        return {answer}
"""
OLD_WRAPPER = """
    @chemage.plugin.hookimpl(hookwrapper=True)
    def {hook}():
        outcome = yield
        found = outcome.get_result()
        outcome.force_result({answer})
"""
#: hook -> a field of its answer, and another value for it
STAGES = {
    "chemage_make_surface": ("provenance", {"by": "a test"}),
    "chemage_solve_contact": ("notes", ("changed",)),
    "chemage_build_lattice": ("provenance", {"by": "a test"}),
    "chemage_run_kinetics": ("notes", ("changed",)),
    "chemage_rupture_bonds": ("", None),
}
every_stage = pytest.mark.parametrize("hook", STAGES)


def others(record) -> dict[str, str]:
    """The plugins that took part besides the one that provides the components."""
    return {name: version for name, version in record.plugins.items() if name != "tiny"}


def plugin(source: str, **words: str) -> ModuleType:
    module = ModuleType("by_hand")
    exec("import chemage\n" + inspect.cleandoc(source).format(**words), module.__dict__)
    return module


def changed(hook: str) -> str:
    field, value = STAGES[hook]
    if not field:
        return "2.0 * found"
    return f"found.model_copy(update={{{field!r}: {value!r}}})"


def run_with(tiny, source: str, **words: str) -> chemage.Run:
    registry.current().register(plugin(source, **words), "mine")
    return chemage.run(parse_scene(tiny.scene()))


@every_stage
@pytest.mark.parametrize("source", [WRAPPER, OLD_WRAPPER], ids=["wrapper", "hookwrapper"])
def test_a_wrapper_that_changes_an_answer_took_part(tiny, hook, source):
    run = run_with(tiny, source, hook=hook, answer=changed(hook))
    assert others(run) == {"mine": "by_hand"}
    assert others(run.ageing) == {"mine": "by_hand"}
    # at the contact only what came before it
    early = hook in ("chemage_make_surface", "chemage_solve_contact")
    assert others(run.contact) == ({"mine": "by_hand"} if early else {})
    assert run.versions["mine"] == "by_hand"


@every_stage
@pytest.mark.parametrize("source", [WRAPPER, OLD_WRAPPER], ids=["wrapper", "hookwrapper"])
def test_a_wrapper_that_hands_on_the_very_answer_did_not(tiny, hook, source):
    plain = chemage.run(parse_scene(tiny.scene()))
    run = run_with(tiny, source, hook=hook, answer="found")
    assert others(run) == {}
    assert "mine" not in run.versions
    assert run.contact == plain.contact
    assert run.ageing == plain.ageing


@every_stage
def test_a_plugin_that_leaves_the_answer_to_others_did_not(tiny, hook):
    run = run_with(tiny, PLAIN, hook=hook, arguments="", before="pass", answer="None")
    assert others(run) == {}
    assert "mine" not in run.versions


ANSWERS = {
    "chemage_make_surface": ("maker, seed", "maker.make(seed)"),
    "chemage_solve_contact": ("solver, surface, load", "solver.solve(surface, load)"),
    "chemage_build_lattice": ("chemistry, contact, seed", "chemistry.on(contact, seed)"),
    "chemage_run_kinetics": (
        "engine, lattice, hold_times, temperature, seed",
        "engine.run(lattice, hold_times, temperature=temperature, seed=seed)",
    ),
    "chemage_rupture_bonds": ("bonded", "3.0 * bonded.bonds"),
}


@every_stage
def test_a_plugin_that_answers_took_part_even_with_the_same_answer(tiny, hook):
    arguments, answer = ANSWERS[hook]
    run = run_with(tiny, PLAIN, hook=hook, arguments=arguments, before="pass", answer=answer)
    assert others(run) == {"mine": "by_hand"}


@pytest.mark.parametrize(("answer", "took_part"), [("{'n': 1.0}", True), ("{}", False), ("None", False)])
def test_an_observer_took_part_if_it_measured_something(tiny, answer, took_part):
    run = run_with(tiny, PLAIN, hook="chemage_observe", arguments="", before="pass", answer=answer)
    assert others(run) == ({"mine": "by_hand"} if took_part else {})


def test_a_wrapper_that_replaces_an_error_took_part(tiny):
    source = """
        @chemage.plugin.hookimpl(wrapper=True)
        def chemage_solve_contact(solver, surface, load):
            try:
                return (yield)
            except chemage.InputError:
                return solver.replace(trouble="").solve(surface, load)
    """
    registry.current().register(plugin(source), "mine")
    scene = tiny.scene(contact={"kind": "tiny-even", "load": 10.0, "trouble": "raise"})
    assert others(chemage.run(parse_scene(scene))) == {"mine": "by_hand"}
    assert others(chemage.run(parse_scene(tiny.scene()))) == {}


def test_errors_pass_through_a_wrapper(tiny):
    registry.current().register(plugin(WRAPPER, hook="chemage_solve_contact", answer="found"), "mine")
    scene = tiny.scene(contact={"kind": "tiny-even", "load": 10.0, "trouble": "raise"})
    with pytest.raises(chemage.InputError, match="this one is meant to fail"):
        chemage.run(parse_scene(scene))


def test_replicas_in_threads_are_seen(tiny):
    registry.current().register(
        plugin(WRAPPER, hook="chemage_run_kinetics", answer=changed("chemage_run_kinetics")), "m"
    )
    assert others(chemage.run(parse_scene(tiny.scene()), threads=2)) == {"m": "by_hand"}
