"""A check finds a component that breaks it: observables."""

from __future__ import annotations

import pytest
from kit_examples import Count, broken, calls, failing

from chemage import testing


@pytest.mark.parametrize(
    ("measure", "said"),
    [
        (lambda self, contact, lattice, history: {}, "expected names"),
        (lambda self, contact, lattice, history: {1: 2.0}, "not all str"),
        (lambda self, contact, lattice, history: {"state": history.state}, "expected"),
        (lambda self, contact, lattice, history: {"name": "many"}, "not numbers"),
        (lambda self, contact, lattice, history: {f"b{history.bonds[-1]}": 1.0}, "as for the other replicas"),
    ],
)
def test_observables(measure, said):
    assert said in failing(broken(Count, measure=measure)(), "observes_numbers")


def test_observables_that_count_their_calls():
    component = broken(Count, measure=lambda self, contact, lattice, history: {"calls": next(calls)})()
    assert "a second call" in failing(component, "calls_are_independent")


def test_observables_divide_by_no_sites():
    careless = broken(Count, measure=lambda self, contact, lattice, history: {"mean": history.state.mean()})()
    (check,) = [one for one in testing.checks_for(careless) if one.name == "observes_numbers"]
    with pytest.raises(AssertionError, match="empty slice"):
        check(careless)
