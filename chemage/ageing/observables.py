"""The role of further measurements on each replica: what is measured, and from what figures are drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from chemage.ageing.ageing import Ageing
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.foundation.errors import PluginError
from chemage.foundation.outputs import (
    Checker,
    Output,
    RecordedValue,
    declaration_problems,
    recording,
)
from chemage.kinetics.history import BondHistory
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.context import Plugins, taking_part
from chemage.plugins.sources import components_in, providers
from chemage.surfaces.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Maps(NamedTuple):
    """The large arrays of a result; None for what its file does not hold."""

    contact: ContactSolution | None = None
    surface: Surface | None = None


@dataclass(frozen=True)
class PlottedResult:
    """One result to draw: alone, or beside others with which it is compared."""

    #: for the legend
    label: str
    #: None without ageing
    ageing: Ageing | None
    #: None without ageing, and where the plugins that made this result are not installed
    chemistry: Chemistry | None
    #: a matplotlib colour
    color: str
    #: the component whose figure is drawn, with the options that it had in this result; None for figures of a hook
    component: Component | None = None
    #: plain data of the scene; empty where the file holds none
    scene: Mapping[str, Any] = field(default_factory=dict)
    #: gives contact and surface, which are read from the file when they are needed
    load_maps: Callable[[], Maps] = field(default=Maps, repr=False, compare=False)

    @property
    def contact(self) -> ContactSolution | None:
        """The contact; None where the file holds none."""
        return self.load_maps().contact

    @property
    def surface(self) -> Surface | None:
        """The surface; None where the file holds none."""
        return self.load_maps().surface


@dataclass(frozen=True)
class Observed(PlottedResult):
    """One result as an observable draws it: ``ageing`` is always there."""

    ageing: Ageing


class Observable(Component, ABC):
    """Role ``observable``: further numbers to take from each replica."""

    role = "observable"
    error_of = "what it measures"
    # not annotated for type checkers, so that a class can make it a property
    if TYPE_CHECKING:
        states = False
    else:
        #: asks for the state of every site at every hold time, ``history.states``, (m, n) bool; the engine must be able
        #: to resume from a history (``restart``)
        states: ClassVar[bool] = False

    @abstractmethod
    def measure(
        self,
        contact: ContactSolution,
        lattice: ReactionLattice,
        history: BondHistory,
    ) -> Mapping[str, float | np.ndarray]:
        """Named numbers or arrays, the same names and shapes for every replica: just those of :attr:`outputs`.
        Without declared outputs nothing is known of dimensions and units."""

    def draw(self, figure: str, axes: Axes, results: Sequence[Observed]) -> None:
        """As for every component.

        What was measured is in ``Ageing.observables`` of each result, (replicas, ...) by name.
        """
        super().draw(figure, axes, results)


def observable(kind: str, **options: Any) -> Any:
    """A further measurement on each replica."""
    return registry.current().make("observable", kind, options)


class Seen(NamedTuple):
    """What was measured on one replica."""

    values: dict[str, np.ndarray]
    outputs: dict[str, Output]
    plugins: Plugins


def output_problems(*components: Any) -> Iterator[tuple[Component, str]]:
    """Why what the components, or parts of them, declare cannot be recorded together and stored: the component, and the
    reason in words."""
    by_name: dict[str, Component] = {}
    dims: dict[str, Component] = {}
    for part in components_in(*components):
        who = _called(part)
        if problems := declaration_problems(part.outputs):
            yield part, f"{who}: {problems[0]}"
            continue
        for name, output in part.outputs.items():
            if name in by_name:
                yield (
                    part,
                    f"two components record {name!r}; rename one ({_called(by_name[name])} and {who})",
                )
            by_name[name] = part
            dims |= dict.fromkeys(output.dims, part)
    for name in sorted(by_name.keys() & dims.keys()):
        part, other = by_name[name], _called(dims[name])
        yield (
            part,
            f"{_called(part)}: output {name!r} has the name of a dimension of {other}; rename one",
        )


def _called(component: Component) -> str:
    return f"{component.role} {component.kind!r}"


def measure(
    contact: ContactSolution,
    lattice: ReactionLattice,
    history: BondHistory,
    observe: Sequence[Observable],
) -> Seen:
    """Measure on one finished replica, with every observable and with the hook ``chemage_observe``.

    Raises
    ------
    PluginError
        What was measured is not what is declared, or two give the same name.
    """
    seen = Seen({}, {}, {})
    times = history.hold_times.size

    def take(
        checker: Checker, measured: Mapping[str, Any], outputs: Mapping[str, Output]
    ) -> None:
        for name, values in measured.items():
            if name in seen.values:
                raise PluginError(f"two observables give {name!r}; rename one")
            seen.values[name] = checker.values(name, values, outputs.get(name))
            if name in outputs:
                seen.outputs[name] = outputs[name]

    with recording() as block, taking_part() as took_part:
        for observable in observe:
            checker = Checker(_called(observable), times)
            values = observable.measure(contact, lattice, history)
            outputs = observable.outputs
            checker.names(values, outputs)
            take(checker, values, outputs)
        answers = registry.current().manager.hook.chemage_observe(
            contact=contact, lattice=lattice, history=history
        )
    for name, (who, declared) in block.items():
        take(Checker(who, times), {name: declared.values}, {name: declared.output})
    for answer in answers:
        checker = Checker("the hook chemage_observe of a plugin", times)
        checker.names(answer, {})
        outputs = {
            name: value.output
            for name, value in answer.items()
            if isinstance(value, RecordedValue)
        }
        if problems := declaration_problems(outputs):
            raise PluginError(
                f"the hook chemage_observe of a plugin: {problems[0]}"
            )
        plain = {
            name: value.values if isinstance(value, RecordedValue) else value
            for name, value in answer.items()
        }
        take(checker, plain, outputs)
    dims = {dim for output in seen.outputs.values() for dim in output.dims}
    if both := dims & seen.values.keys():
        raise PluginError(
            f"observables: {min(both)!r} is the name of an output and of a dimension; rename one"
        )
    return seen._replace(plugins=providers(*observe) | took_part.plugins)


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
