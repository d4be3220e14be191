"""Observables at work: what they declare is checked before anything is computed, what they measure on each replica."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from chemage.ageing.observables import Observable
from chemage.ageing.outputs import Checker, Declared, Output, declaration_problems
from chemage.contacts.solution import ContactSolution
from chemage.foundation.errors import PluginError
from chemage.kinetics.history import BondHistory
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.context import Plugins, taking_part
from chemage.plugins.sources import providers


class Seen(NamedTuple):
    """What was measured on one replica."""

    values: dict[str, np.ndarray]
    outputs: dict[str, Output]
    plugins: Plugins


def check_outputs(observe: Sequence[Observable]) -> None:
    """Require that what the observables declare can be measured together and stored.

    Raises
    ------
    PluginError
        Names the observable and the output.
    """
    by_name: dict[str, str] = {}
    dims: dict[str, str] = {}
    for one in observe:
        who = f"observable {one.kind!r}"
        if problems := declaration_problems(one.outputs):
            raise PluginError(f"{who}: {problems[0]}")
        for name, output in one.outputs.items():
            if name in by_name:
                raise PluginError(f"two observables give {name!r}; rename one ({by_name[name]} and {who})")
            by_name[name] = who
            dims |= dict.fromkeys(output.dims, who)
    if both := by_name.keys() & dims.keys():
        name = min(both)
        raise PluginError(f"{by_name[name]}: output {name!r} has the name of a dimension of {dims[name]}; rename one")


def measure(
    contact: ContactSolution, lattice: ReactionLattice, history: BondHistory, observe: Sequence[Observable]
) -> Seen:
    """Measure on one finished replica, with every observable and with the hook ``chemage_observe``.

    Raises
    ------
    PluginError
        What was measured is not what is declared, or two give the same name.
    """
    seen = Seen({}, {}, {})
    times = history.hold_times.size
    for one in observe:
        checker = Checker(f"observable {one.kind!r}", times)
        found = one.measure(contact, lattice, history)
        checker.names(found, one.outputs)
        _take(seen, checker, ((name, value, one.outputs.get(name)) for name, value in found.items()))
    with taking_part() as plugins:
        answers = registry.current().manager.hook.chemage_observe(contact=contact, lattice=lattice, history=history)
    for answer in answers:
        checker = Checker("the hook chemage_observe of a plugin", times)
        checker.names(answer, {})
        outputs = {name: value.output for name, value in answer.items() if isinstance(value, Declared)}
        if problems := declaration_problems(outputs):
            raise PluginError(f"the hook chemage_observe of a plugin: {problems[0]}")
        plain = {name: value.values if isinstance(value, Declared) else value for name, value in answer.items()}
        _take(seen, checker, ((name, value, outputs.get(name)) for name, value in plain.items()))
    dims = {dim for output in seen.outputs.values() for dim in output.dims}
    if both := dims & seen.values.keys():
        raise PluginError(f"observables: {min(both)!r} is the name of an output and of a dimension; rename one")
    return seen._replace(plugins=providers(*observe) | plugins)


def _take(seen: Seen, checker: Checker, found: Iterator[tuple[str, Any, Output | None]]) -> None:
    for name, values, output in found:
        if name in seen.values:
            raise PluginError(f"two observables give {name!r}; rename one")
        seen.values[name] = checker.values(name, values, output)
        if output is not None:
            seen.outputs[name] = output


def stacked(replicas: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """What was measured on all replicas, (replicas, ...) by name."""
    first = {name: value.shape for name, value in replicas[0].items()}
    for number, seen in enumerate(replicas):
        if (shapes := {name: value.shape for name, value in seen.items()}) != first:
            raise PluginError(
                f"observables differ between replicas: {first} in replica 0, {shapes} in replica {number}; "
                "give the same names and shapes for every replica"
            )
    return {name: np.stack([seen[name] for seen in replicas]) for name in first}
