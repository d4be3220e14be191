"""The kit as a whole: what is right passes, every check is seen at work, expected failures carry their reason."""

from __future__ import annotations

import ast
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from kit_examples import Bed, Breaking, Chain, Count, Csv, Flat, Shell, White, mutant

import chemage as ca
from chemage import InputError, testing
from chemage.plugin import Component, registry
from chemage.testing.checks import CHECKS

REFERENCES: list[Component] = [Flat(), White(), Chain(), Shell(), Breaking(), Count(), Csv(), Bed()]


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "map.csv"
    np.savetxt(path, testing.rough_surface((6, 5)).heights, delimiter=",")
    return path


@testing.parametrize_with_checks(REFERENCES[:1])
def test_checks_are_test_cases(component, check):
    check(component)


@pytest.mark.parametrize("component", REFERENCES, ids=lambda component: component.kind)
def test_a_right_component_passes(component):
    testing.check_component(component, all=True)


def test_the_whole_role_at_once(csv):
    testing.check_barriers(Flat())
    testing.check_surface_maker(White())
    testing.check_interaction(Chain())
    testing.check_rupture(Breaking())
    testing.check_observable(Count())
    testing.check_reader(Csv(), path=csv)
    testing.check_contact_solver(Bed(), force_tolerance=1e-9)
    with pytest.raises(InputError, match=r"is not a chemage\.plugin\.Engine"):
        testing.check_engine(Flat())  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="barriers checks take no path"):
        testing.checks_for(Flat(), path=csv)
    with pytest.raises(InputError, match="has no role"):
        testing.checks_for(ca.chemistry(forming=Flat()))


def test_a_failure_names_its_check():
    wrong = mutant(Flat, "two faults", quantile=lambda self, u: 1 - u, density=lambda self, e: 0 * e, cite="Hertz")()
    with pytest.raises(
        testing.CheckFailed, match=r"barriers 'flat': check citations_are_strings: cite is a str"
    ) as one:
        testing.check_component(wrong)
    assert one.value.check == "citations_are_strings"
    again = pickle.loads(pickle.dumps(one.value))  # as parallel test runs send it
    assert (str(again), again.check) == (str(one.value), one.value.check)


def test_all_failures_are_reported_at_once():
    wrong = mutant(Flat, "three faults", quantile=lambda self, u: 1 - u, density=lambda self, e: 0 * e, cite="Hertz")()
    for check in (testing.check_component, testing.check_barriers):
        with pytest.raises(testing.ChecksFailed, match="4 of 22 checks fail") as several:
            check(wrong, all=True)
        names = ["citations_are_strings", "quantile_is_monotone", "density_agrees_with_quantile", "options_count"]
        assert [failure.check for failure in several.value.exceptions] == names
        assert all(name in str(several.value) for name in names)
        assert isinstance(several.value, AssertionError)
    testing.check_component(Flat(), all=True)


def test_an_exception_of_the_component_is_a_failure_of_the_check():
    wrong = mutant(Flat, "raises", density=lambda self, e: e[10**9])()
    with pytest.raises(testing.CheckFailed, match="density_agrees_with_quantile: raised IndexError"):
        testing.check_component(wrong)


def test_every_check_says_what_it_requires():
    for of in {one for classes in CHECKS.values() for one in classes}:
        for name in of.names():
            assert testing.Check(name, of, {}).requirement.endswith("."), name


def test_every_promise_is_broken_somewhere():
    """A check that no broken component of these files fails is a check nobody has seen at work."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in Path(__file__).parent.glob("test_*.py")]
    named = {node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    for role in registry.current().roles:
        for check in testing.checks_for(registry.current().role(role)):
            assert check.name in named, f"no broken component for {check.name}"


def parameters(decorator):
    """What ``decorator`` parametrises a test with: the names, and the cases."""

    @decorator
    def test(component, check):
        pass

    (mark,) = test.pytestmark
    return mark.args


def test_expected_failures_carry_their_reason():
    excuse = {"has_kind_and_role": "the kind has yet to be chosen"}
    names, cases = parameters(testing.parametrize_with_checks([Flat()], expected_failures=excuse))
    assert names == ("component", "check")
    marked = {case.id: case.marks for case in cases if case.marks}
    assert list(marked) == ["flat0-has_kind_and_role"]
    (xfail,) = marked["flat0-has_kind_and_role"]
    assert xfail.kwargs == {"reason": excuse["has_kind_and_role"], "strict": True, "raises": AssertionError}
    _, same = parameters(testing.parametrize_with_checks([Flat()], expected_failures=lambda component: excuse))
    assert [case.id for case in same] == [case.id for case in cases]
    assert [case.marks for case in same] == [case.marks for case in cases]
    with pytest.raises(InputError, match="names no check of role 'barriers': has_kind"):
        testing.parametrize_with_checks([Flat()], expected_failures={"has_kind": "?"})


def test_isolated_registry_is_empty_and_in_use(isolated_registry):
    assert ca.plugin.registry.current() is isolated_registry
    assert isolated_registry.records == []
    with pytest.raises(InputError, match="installed: none"):
        ca.engine("bkl")


CHECKS_WORKER = """
from chemage.testing import answers as kept
print(kept._worker().submit(len, "abc").result())
"""
POOL = """
from chemage.studies.runner import open_pool
with open_pool("processes", 1) as kept:
    print(kept.executor.submit(len, "abc").result())
"""


@pytest.mark.long
@pytest.mark.parametrize("code", [CHECKS_WORKER, POOL])
def test_processes_end_without_a_word(code):
    """Whatever module the interpreter takes down first."""
    code += "import json; json.kept = kept"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("3\n", "")
