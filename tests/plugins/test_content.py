"""Who took part is known by content: what a hook changes is named, also in place, and what is unchanged names nobody."""

from __future__ import annotations

import copy
import json
import pickle
import warnings

import faults
import numpy as np
import pytest

import chemage as ca
from chemage.plugin import Output, PluginError, hookimpl, record, registry

SCENE = {
    "name": "tip",
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 24, "pixel_size": "0.6 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
    "forming": {"kind": "uniform", "lower": 0.7, "upper": 0.9},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "1 us", "stop": "1 s", "per_decade": 1, "replicas": 2},
    "fit": {"start": "1 us", "stop": "1 s"},
}
SOLVE, RUN, RUPTURE = "chemage_solve_contact", "chemage_run_kinetics", "chemage_rupture_bonds"
MAKE, BUILD, OBSERVE = "chemage_make_surface", "chemage_build_lattice", "chemage_observe"


def ran(replicas=2, **functions) -> ca.Run:
    """A run with a plugin of these hooks, named 'guilty'."""
    with registry.using(registry.Registry()) as installed:
        installed.register(type("Tiny", (), functions), "guilty")
        return ca.run({**SCENE, "hold": {**SCENE["hold"], "replicas": replicas}})


def wrapper(change, old=False):
    """A wrapper that applies ``change`` to the answer of others and hands it on; or to nothing."""

    def new(*_):
        found = yield
        change(found)
        return found

    def old_style(*_):
        outcome = yield
        change(outcome.get_result())

    return staticmethod(hookimpl(hookwrapper=True)(old_style) if old else hookimpl(wrapper=True)(new))


def writable(array: np.ndarray) -> np.ndarray:
    array.setflags(write=True)
    return array


def shift(array: np.ndarray) -> None:
    """Change an array in place, to one with the same sum."""
    writable(array)[...] = np.roll(array, 1)


def recorded_map(found) -> None:
    record(map=Output(("site",), "nm").of(np.arange(3.0)))


def no_longer_contact(found) -> None:
    writable(found.contact)[:] = False


#: what is changed in place -> hook, how, what of the answer is named
IN_PLACE = {
    "an array": (MAKE, lambda found: shift(found.heights), "heights"),
    "an item of a mapping": (SOLVE, lambda found: dict.__setitem__(found.convergence, "x", 0), "convergence"),
    "a nested mapping": (SOLVE, lambda found: dict.clear(found.provenance["options"]), "provenance"),
    "a list": (MAKE, lambda found: list.append(found.provenance["options"]["pixels"], 1), "provenance"),
    "a field": (SOLVE, lambda found: vars(found).update(notes=("changed",)), "notes"),
    "a frozen number": (RUN, lambda found: object.__setattr__(found, "engine", "bkl"), "engine"),
    "an array in a mapping": (
        RUN,
        lambda found: np.add(writable(found.resume["event"]), 1, found.resume["event"]),
        "resume",
    ),
    "an array that is the answer": (RUPTURE, lambda found: np.multiply(found, 2, out=found), ""),
    "a mapping that is put in place of another": (
        BUILD,
        lambda found: vars(found).update(provenance={"x": 1}),
        "provenance",
    ),
    "what is recorded": (SOLVE, recorded_map, "map"),
}


@pytest.mark.parametrize("old", [False, True], ids=["wrapper", "hookwrapper"])
@pytest.mark.parametrize("name", IN_PLACE)
def test_what_a_hook_changes_in_place_is_named(name, old):
    hook, change, field = IN_PLACE[name]
    run = ran(**{hook: wrapper(change, old)})
    assert run.plugins == {"guilty": "Tiny"}
    assert run.changes == {"guilty": [f"{hook}.{field}".strip(".")]}
    assert run.summary()["changes"] == run.changes
    early = hook in (MAKE, SOLVE)
    assert run.contact.changes == (run.changes if early else {})
    # and the record is one of its own content, not of what it was before
    assert run.contact == pickle.loads(pickle.dumps(run.contact))
    assert run.keys != ca.run(SCENE).keys


def argument(name, change):
    """A hook that answers nothing, and changes one of its arguments."""
    words = {**globals(), "change": lambda it: (change(it), None)[1]}
    return staticmethod(hookimpl(eval(f"lambda {name}: change({name})", words)))


#: what of the arguments is changed in place -> hook, its argument, how, what is named
ARGUMENTS = {
    "the surface": (SOLVE, "surface", lambda it: shift(it.heights), "surface.heights"),
    "an option of a component": (SOLVE, "solver", lambda it: vars(it).update(modulus=70.6), "solver.modulus"),
    "the contact": (BUILD, "contact", lambda it: shift(it.pressure), "contact.pressure"),
    "the hold times": (RUN, "hold_times", lambda it: np.multiply(writable(it), 2, out=it), "hold_times"),
    "the seed": (RUN, "seed", lambda it: it.spawn(1), "seed"),
    "the barriers": (RUN, "lattice", lambda it: shift(it.forming), "lattice.forming"),
    "a record in a dataclass": (RUPTURE, "bonded", lambda it: shift(it.history.bonds), "bonded.history.bonds"),
    "the history": (OBSERVE, "history", lambda it: shift(it.bonds), "history.bonds"),
    "what is derived": (BUILD, "contact", lambda it: shift(it.contact), "contact.contact"),
}


@pytest.mark.parametrize("replicas", [1, 2])
@pytest.mark.parametrize("name", ARGUMENTS)
def test_an_argument_that_a_hook_changes_in_place_is_refused_and_named(name, replicas):
    hook, arguments, change, named = ARGUMENTS[name]
    with pytest.raises(PluginError) as caught:
        ran(replicas, **{hook: argument(arguments, change)})
    assert str(caught.value).startswith(f"plugin 'guilty' (Tiny): {hook} changed {named} in place")
    assert f"in the hook {hook} of plugin 'guilty' (Tiny): " in caught.value.__notes__[0]


def before_it_yields(surface):
    shift(surface.heights)
    return (yield)


def after_it_yields(surface):
    found = yield
    shift(surface.heights)
    return found


@pytest.mark.parametrize("function", [before_it_yields, after_it_yields])
def test_so_is_one_that_a_wrapper_changes(function):
    mutant = staticmethod(hookimpl(wrapper=True, specname=SOLVE)(function))
    with pytest.raises(PluginError, match=r"changed surface\.heights in place"):
        ran(**{SOLVE: mutant})


def test_what_a_hook_keeps_and_changes_later_is_named():
    kept = []

    @hookimpl
    def later(history):
        shift(kept[0].heights)

    with pytest.raises(
        PluginError, match=r"a hook of guilty changed surface\.heights, which is made already, in place"
    ):
        ran(**{MAKE: wrapper(kept.append), OBSERVE: staticmethod(later)})


def test_what_a_hook_derives_and_changes_is_derived_anew():
    run = ran(**{SOLVE: wrapper(no_longer_contact)})
    assert run.plugins == run.changes == {}
    assert run.contact.contact.any()
    assert run == ca.run(SCENE) or run.ageing == ca.run(SCENE).ageing


def test_what_is_no_longer_valid_is_refused():
    change = lambda found: writable(found.pressure).fill(np.nan)  # noqa: E731
    with pytest.raises(PluginError, match=r"plugin 'guilty' \(Tiny\) changed it in place: .*not finite"):
        ran(**{SOLVE: wrapper(change)})


def copied(*_):
    found = yield
    return found if isinstance(found, np.ndarray) else found.model_copy()


def restored(*_):
    found = yield
    if not isinstance(found, np.ndarray):
        vars(found)["provenance"], before = {}, found.provenance
        vars(found)["provenance"] = before
    return found


@pytest.mark.parametrize("function", [copied, restored])
@pytest.mark.parametrize("hook", [MAKE, SOLVE, BUILD, RUN, RUPTURE])
def test_an_answer_of_equal_content_names_nobody(hook, function):
    plain = ca.run(SCENE)
    run = ran(**{hook: staticmethod(hookimpl(wrapper=True, specname=hook)(function))})
    assert run.plugins == run.changes == {}
    assert (run.contact, run.ageing, run.keys) == (plain.contact, plain.ageing, plain.keys)
    assert "changes" not in run.summary()


def test_a_hook_that_answers_nothing_and_records_something_took_part():
    @hookimpl
    def recording(solver):
        record(depth=Output((), "nm").of(3.0))

    run = ran(**{SOLVE: staticmethod(recording)})
    assert run.changes == {"guilty": [f"{SOLVE}.depth"]}
    assert run.plugins == {"guilty": "Tiny"}


def test_who_answers_is_named_with_the_hook(tmp_path, command):
    @hookimpl
    def answering(maker, seed):
        return maker.make(seed)

    @hookimpl
    def measuring():
        return {"n": 1.0}

    run = ran(**{MAKE: staticmethod(answering), OBSERVE: staticmethod(measuring)})
    assert run.changes == {"guilty": [MAKE, OBSERVE]}
    ca.write(tmp_path / "run.h5", run)
    assert ca.read(tmp_path / "run.h5").changes == run.changes
    assert f"changed by guilty {MAKE}, {OBSERVE}" in " ".join(command("show", tmp_path / "run.h5", "--all").out.split())


def test_a_replica_that_is_resumed_names_who_changed_it(tmp_path):
    def half(found):
        vars(found)["notes"] = ("changed",)

    plugin = type("Tiny", (), {RUN: wrapper(half)})
    with registry.using(registry.Registry()) as installed, warnings.catch_warnings():
        warnings.simplefilter("error")
        installed.register(plugin, "guilty")
        first, again = (ca.run(SCENE, checkpoints=tmp_path) for _ in range(2))
    assert first.changes == again.changes == {"guilty": [f"{RUN}.notes"]}
    assert first.ageing == again.ageing


def test_nothing_is_compared_where_no_plugin_has_a_hook(monkeypatch):
    faults.no_checksums(monkeypatch)
    with registry.using(registry.Registry()):
        ca.run(SCENE)
    with pytest.raises(AssertionError, match="a checksum was made"):
        ran(**{SOLVE: wrapper(lambda found: None)})


# -- mappings of results ----------------------------------------------------------------------------------------------


def mappings(value, path="run"):
    """Every mapping and list in a result, at any depth: path -> it."""
    if isinstance(value, dict | list):
        yield path, value
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else ()
    fields = vars(value).items() if isinstance(value, ca.Run | ca.Surface | ca.ContactSolution | ca.Ageing) else ()
    for name, one in (*entries, *fields):
        if not str(name).startswith("_"):
            yield from mappings(one, f"{path}.{name}")


def test_mappings_of_results_are_read_only_all_the_way_down(tmp_path):
    ca.write(tmp_path / "run.h5", ca.run(SCENE))
    for run in (ca.run(SCENE), ca.read(tmp_path / "run.h5")):
        found = dict(mappings(run))
        assert len(found) > 25
        assert any(isinstance(one, list) for one in found.values())
        for one in found.values():
            changes = [one.clear, lambda one=one: one.__setitem__(0, 1), lambda one=one: one.__delitem__(0)]
            changes += [one.update, one.popitem] if isinstance(one, dict) else [one.sort, lambda one=one: one.append(1)]
            for change in changes:
                with pytest.raises(TypeError, match="a result is read-only"):
                    change()


def test_a_copy_of_them_can_be_changed():
    provenance = ca.run(SCENE).contact.provenance
    for one in (copy.deepcopy(provenance), pickle.loads(pickle.dumps(provenance)), json.loads(json.dumps(provenance))):
        assert one == provenance
        one["options"]["modulus"] = 1
        one["surface"]["options"]["pixels"].append(3)
        assert one != provenance
    assert {**provenance, "x": 1}["x"] == (provenance | {"x": 1})["x"] == 1
