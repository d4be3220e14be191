"""Errors say the field, the value and the remedy, and survive a process boundary."""

from __future__ import annotations

import inspect
import pickle

import pytest

import chemage as ca
from chemage import ChemageError, InputError, errors
from chemage.plugin import ConvergenceError, PluginError, SceneError, StoreError, UnitError

ALL = [
    value
    for _, value in inspect.getmembers(errors, inspect.isclass)
    if issubclass(value, ChemageError) and value.__module__ == errors.__name__
]

EXAMPLES = [
    ChemageError("plain"),
    InputError("wrong", [("load", "negative")]),
    InputError.of("load", -1, "negative", "give a force"),
    UnitError("no unit"),
    errors.UnknownKindError("no such"),
    errors.MissingError("not installed"),
    SceneError("scene.toml", [("contact.load", "negative"), ("", "not valid TOML")]),
    PluginError("broken"),
    ConvergenceError("short", history=[1.0, 0.1], residual=0.1, tolerance=1e-5),
    StoreError("missing"),
    errors.AbsentError("missing"),
    errors.DamagedError("damaged"),
    errors.ExecutorError("no workers"),
    errors.WorkerLost("a worker died"),
]


def test_every_error_has_an_example():
    assert {type(one) for one in EXAMPLES} == set(ALL)


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda error: type(error).__name__)
def test_every_error_is_ours_and_pickles(error):
    assert isinstance(error, ChemageError)
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


@pytest.mark.parametrize("cls", ALL)
def test_the_tree_at_the_top_names_every_error(cls):
    assert cls.__name__ in (errors.__doc__ or "")
    assert (cls.__doc__ or "").strip()


def test_builtin_handlers_still_work():
    for error, builtin in ((InputError("x"), ValueError), (StoreError("x"), OSError), (UnitError("x"), ValueError)):
        assert isinstance(error, builtin)


def test_the_standard_wording():
    assert str(InputError.of("load", -1, "negative", "give a force")) == "load = -1: negative; give a force"
    assert str(InputError.of("load", -1, "negative")) == "load = -1: negative"
    long = str(InputError.of("samples", list(range(1000)), "too many"))
    assert len(long) < 110
    assert "...: too many" in long


def test_a_scene_error_lists_every_problem_with_its_path():
    error = SceneError("scene.toml", [("contact.load", "negative"), ("", "no [surface]")])
    assert str(error) == "scene.toml is not a valid scene:\n  contact.load: negative\n  no [surface]"
    assert error.problems == [("contact.load", "negative"), ("", "no [surface]")]


def test_a_convergence_error_carries_the_history():
    error = ConvergenceError("short", history=(1.0, 0.1), residual=0.1, tolerance=1e-5)
    assert (error.history, error.residual, error.tolerance) == ([1.0, 0.1], 0.1, 1e-5)


def test_nearest():
    assert ca.plugin.nearest("hertzz", ["hertz", "fft-bem"]) == " (did you mean 'hertz'?)"
    assert ca.plugin.nearest("qqq", ["hertz", "fft-bem"]) == ""
    assert ca.plugin.nearest("x", []) == ""
