"""Checks of every component: kind, options, references, and the figures that it brings."""

from __future__ import annotations

import json
import math
import pickle
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from chemage.ageing.ageing import Ageing
from chemage.ageing.observables import Maps, Observable, Observed, PlottedResult
from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.figures import CORE
from chemage.foundation.outputs import recording
from chemage.friction.role import Bonded, Rupture
from chemage.plugins import registry
from chemage.scene.materials import material_problems
from chemage.scene.provenance import bibtex_problem
from chemage.surfaces.role import SurfaceMaker
from chemage.surfaces.surface import Surface
from chemage.testing.answers import as_bytes
from chemage.testing.checks import (
    CheckFailed,
    Checks,
    dimensions,
    is_number,
    naming,
    refuses,
    require,
    require_plain,
)
from chemage.testing.replicas import numbers, with_states
from chemage.testing.trials import Trial, contact_of


def check_material(name: str) -> None:
    """Check an installed material: its file can be read, every value has a source and says how it is known, every
    option exists, and the components accept the values.

    Raises
    ------
    CheckFailed
        With everything that is wrong.
    """
    if problems := material_problems(name):
        raise CheckFailed(
            "values_can_be_used", f"material {name!r}", "\n".join(problems)
        )


class ComponentChecks(Checks[Component], of=Component):
    """What every component must do."""

    def has_kind_and_role(self) -> None:
        """The class has a kind in lower case, a docstring, and is of the class of its role."""
        cls = self.cls
        kind, role = cls.kind, registry.current().role(cls.role)
        require(
            isinstance(kind, str) and kind,
            f"{cls.__name__}.kind is empty; give the name that users select it by",
        )
        require(
            kind == kind.strip().lower() and " " not in kind,
            f"kind {kind!r}: use lower-case-words",
        )
        require(
            isinstance(self.component, role),
            f"{cls.__name__}: has role {cls.role!r}, but is not of its class",
        )
        require((cls.__doc__ or "").strip(), f"{cls.__name__} has no docstring")

    def citations_are_strings(self) -> None:
        """``cite`` is a tuple of strings, and ``bibtex``, if there is one, has an entry or "" for each of them."""
        cite = self.cls.cite
        owner = next(one for one in self.cls.__mro__ if "cite" in vars(one))
        entries = vars(owner).get("bibtex", ())
        for name, texts in (("cite", cite), ("bibtex", entries)):
            given = type(texts).__name__
            require(
                isinstance(texts, tuple),
                f"{name} is a {given}; expected a tuple of str, with a comma after one",
            )
            require(
                all(isinstance(one, str) for one in texts),
                f"{name} = {texts!r}: not all are non-empty str",
            )
        require(
            all(one.strip() for one in cite),
            f"cite = {cite!r}: not all are non-empty str",
        )
        require(
            len(entries) in (0, len(cite)),
            f"bibtex has {len(entries)} entries for {len(cite)} of cite; write one for each, '' where there is none",
        )
        for entry in filter(None, entries):
            problem = bibtex_problem(entry)
            require(not problem, f"bibtex: {entry[:60]!r} {problem}")

    def options_are_described(self) -> None:
        """Every option has a description, and a unit that can be read."""
        for name, (schema, *_) in self.options().items():
            described = schema.get("description", "").strip()
            require(
                described,
                f"option {name!r} has no description; write a docstring below it",
            )
        for name, unit in self.units().items():
            with naming(f"option {name!r}: the unit {unit!r} cannot be read"):
                dimensions(unit)

    def speed_only_names_options(self) -> None:
        """``speed_only`` is a tuple of names of options."""
        named = self.cls.speed_only
        require(
            isinstance(named, tuple),
            f"speed_only = {named!r}: give a tuple, with a comma after a single name",
        )
        unknown = set(named) - set(self.cls.model_fields)
        require(
            not unknown,
            f"speed_only names {', '.join(sorted(unknown))}, which are not options",
        )

    def trade_names_options(self) -> None:
        """``trade`` maps names of options to at least two values each, all of which the option accepts."""
        cls = self.cls
        require(
            isinstance(cls.trade, Mapping),
            f"trade = {cls.trade!r}: give a mapping from options to values",
        )
        for name, values in cls.trade.items():
            require(
                name in cls.model_fields,
                f"trade names {name!r}, which is not an option",
            )
            both = name in cls.speed_only
            require(
                not both,
                f"trade and speed_only both name {name!r}: either it changes the answer or it does not",
            )
            require(
                isinstance(values, tuple) and len(values) > 1,
                f"trade of {name!r} is {values!r}; give several values",
            )
            distinct = len({repr(self._accepted(name, value)) for value in values})
            require(
                distinct == len(values),
                f"trade of {name!r} lists one value twice: {values!r}",
            )

    def _accepted(self, name: str, value: Any) -> Any:
        """The option ``name`` at ``value``, with other options of ``trade`` at values that go with it."""
        others = {
            other: values
            for other, values in self.cls.trade.items()
            if other != name
        }
        refusal = None
        for combination in (
            {},
            *(
                dict(zip(others, each, strict=True))
                for each in product(*others.values())
            ),
        ):
            try:
                return getattr(
                    self.component.replace(**combination, **{name: value}), name
                )
            except InputError as error:
                refusal = refusal or error
        raise AssertionError(
            f"trade: the option {name!r} does not accept {value!r}: {refusal}"
        )

    def approximations_are_declared(self) -> None:
        """``exact`` is True or False, an exact component declares no error (a contact solver may), and
        ``error_of`` says in words what the declared error is the error of."""
        component = self.component
        require(
            isinstance(component.exact, bool),
            f"exact = {component.exact!r}; give True or False",
        )
        require(
            isinstance(component.error_of, str) and component.error_of.strip(),
            f"error_of = {component.error_of!r}; say what the declared error is the error of, such as 'the pressure'",
        )
        error = component.declared_error
        if error is None:
            return
        require(
            isinstance(component, ContactSolver) or not component.exact,
            f"declared_error = {error!r}, but exact is True; set exact = False",
        )
        require(
            is_number(error) and 0 < error <= 1,
            f"declared_error = {error!r}; give the largest relative error of {component.error_of}, above 0 and at "
            "most 1",
        )

    def digest_tells_options_apart(self) -> None:
        """The digest changes with every option except those of ``speed_only``, so that no stored result is mistaken for
        another's."""
        for name in self.cls.model_fields:
            for what, variant in self.other_values(name):
                same = variant.digest() == self.component.digest()
                if name in self.cls.speed_only:
                    require(
                        same,
                        f"{what}: the digest differs, but speed_only names {name!r}",
                    )
                else:
                    equal = same or variant == self.component
                    value = getattr(self.component, name)
                    require(
                        not equal,
                        f"{what}: the digest is that of {value!r}; a sweep would take one for the other",
                    )

    def options_are_frozen(self) -> None:
        """No option can be set on a finished component."""
        component = self.component
        before = component.digest()
        for name in (*self.cls.model_fields, "some_other_name"):
            try:
                setattr(component, name, getattr(component, name, 1))
            except (ValueError, AttributeError, TypeError):
                continue
            raise AssertionError(f"{name} can be set; a component is frozen")
        require(
            component.digest() == before,
            "the digest changed although no option did",
        )

    def options_go_round(self) -> None:
        """Copies by todict, JSON and fromdict, by pickle and by replace are equal and have the same hash and digest."""
        component = self.component
        fields = component.todict()
        require_plain(fields, "todict()")
        kinds = component.kind, component.qualified_kind()
        require(
            fields.get("kind") in kinds,
            f"todict() has kind {fields.get('kind')!r}, not {kinds[-1]!r}",
        )
        ways: dict[str, Callable[[], Component]] = {
            "fromdict(todict())": lambda: self.cls.fromdict(
                json.loads(json.dumps(fields))
            ),
            "pickle": lambda: pickle.loads(pickle.dumps(component)),
            "replace()": component.replace,
        }
        for way, make in ways.items():
            with naming(way):
                again = make()
                same_hash = hash(again) == hash(component)
                same_digest = again.digest() == component.digest()
            require(
                again == component, f"{way} returned {again!r}, not {component!r}"
            )
            require(
                same_hash,
                f"{way}: the hash differs; options must be hashable and compare by value",
            )
            require(same_digest, f"{way}: the digest differs")

    def wrong_options_are_refused(self) -> None:
        """Unknown options, numbers that are not finite and quantities of another dimension are errors naming the
        option."""
        component = self.component
        cls: Any = self.cls

        def refused(name: str, value: Any, make: Callable[..., Any]) -> None:
            message = refuses(f"{name} = {value!r}", lambda: make(**{name: value}))
            require(
                name in message,
                f"the error for {name} = {value!r} does not name it: {message}",
            )

        refused("no_such_option", 1, cls)
        units = self.units()
        for name, parts in self.options().items():
            if not any(part.get("type") == "number" for part in parts):
                continue
            for wrong in (
                math.nan,
                math.inf,
                -math.inf,
                *(["1 mol"] if name in units else []),
            ):
                refused(name, wrong, component.replace)
            value = getattr(component, name)
            if name in units and value is not None:
                text = f"{value!r} {units[name]}"
                require(
                    component.replace(**{name: text}) == component,
                    f"{name} = {text!r} is not {value!r}",
                )

    def figures_are_named(self) -> None:
        """Each figure has a caption, and a name that a file can have and that is none of chemage's own figures'."""
        figures = self.cls.figures
        require(
            isinstance(figures, Mapping),
            f"figures = {figures!r}; give a mapping from names to captions",
        )
        for name, caption in figures.items():
            require(
                isinstance(name, str) and re.fullmatch(r"\w[\w .+-]*", name),
                f"figures names {name!r}; a figure is saved as a file of this name: use letters, digits, - and _",
            )
            require(
                name not in CORE,
                f"figures names {name!r}, which is a figure of chemage; choose another name",
            )
            require(
                isinstance(caption, str) and caption.strip(),
                f"figure {name!r} has no caption",
            )


def _drawn(
    component: Any, figure: str, results: Sequence[Any], filled: bool = True
) -> bytes:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    def figures() -> list[int]:
        pyplot = sys.modules.get("matplotlib.pyplot")
        return pyplot.get_fignums() if pyplot else []

    canvas = FigureCanvasAgg(Figure())
    given = list(results)
    settings = dict(matplotlib.rcParams)
    before = figures()
    axes = canvas.figure.subplots()
    component.draw(figure, axes, given)
    what = f"draw({figure!r}) of {len(results)} result(s)"
    require(
        figures() == before,
        f"{what} opens a figure of pyplot; draw into the axes that are given",
    )
    require(
        dict(matplotlib.rcParams) == settings,
        f"{what} changes the settings of matplotlib (rcParams) for all",
    )
    require(
        list(map(id, given)) == list(map(id, results)),
        f"{what} changes the list of results",
    )
    require(
        axes.has_data() or not filled,
        f"{what} left the axes empty; draw the results",
    )
    canvas.draw()
    return bytes(canvas.buffer_rgba())


class ObservableFigureChecks(Checks[Observable], of=Observable):
    """How observables draw."""

    def figures_are_drawn(self) -> None:
        """Each of ``figures`` is drawn from all replicas, of one result and of several, also where the chemistry is not
        known."""
        few, many, some = (Trial(bonded=bonded).replica() for bonded in (3, 40, 17))
        chemistry = some.chemistry
        for figure in self.cls.figures:
            first = self._measured([some, few, few])
            second = self._measured([some, many, many])
            shown, other, _, _ = (
                _drawn(self.component, figure, results)
                for results in (
                    [Observed("one", first, chemistry, "C0")],
                    [Observed("one", second, chemistry, "C0")],
                    [Observed("one", first, None, "C0")],
                    [
                        Observed("one", first, chemistry, "C0"),
                        Observed("two", second, None, "C1"),
                    ],
                )
            )
            require(
                shown != other
                or as_bytes(first.observables) == as_bytes(second.observables),
                f"figure {figure!r} is the same whatever the second and the third replica have; draw all replicas",
            )

    def _measured(self, replicas: Sequence[Bonded]) -> Ageing:
        """The result of these replicas, as ``chemage.age`` makes it."""
        measured = [numbers(self.component, replica) for replica in replicas]
        return _ageing(
            replicas[0].contact,
            bonds=np.stack([replica.bonds for replica in replicas]),
            hold_times=replicas[0].hold_times,
            observables={
                name: np.stack([values[name] for values in measured])
                for name in measured[0]
            },
            provenance={"observe": [self.component.todict()]},
        )


def _ageing(contact: ContactSolution, bonds: np.ndarray, **fields: Any) -> Ageing:
    most = np.full(len(bonds), bonds.max(initial=40))
    own = {
        "load": contact.load,
        "temperature": 300.0,
        "engine": "by-hand",
        "contact": contact.summary(),
    }
    return Ageing(bonds=bonds, sites=most, events=most, **own, **fields)


class ComponentFigureChecks(Checks[Component], of=Component):
    """How components that are no observables draw."""

    unless = (Observable,)

    def components_draw_their_figures(self) -> None:
        """A component that is no observable draws each of its figures, of one result and of several, also where a part
        of the result is not known."""
        others = [
            variant
            for option in self.cls.model_fields
            for _, variant in self.other_values(option)
        ]
        for name in self.cls.figures:
            results = self._results()
            shown = {
                what: _drawn(self.component, name, drawn, "without" not in what)
                for what, drawn in results.items()
            }
            one, two = results["two results"]
            for other in (
                replace(two, component=variant) for variant in others[:4]
            ):
                alone = [
                    _drawn(self.component, name, [result])
                    for result in (two, other)
                ]
                require(
                    alone[0] == alone[1]
                    or _drawn(self.component, name, [one, other])
                    != shown["two results"],
                    f"figure {name!r} of two results is the same whatever the second one is; draw all results",
                )
            for what, drawn in results.items():
                for other in others[:1]:
                    require(
                        _drawn(other, name, drawn, filled=False) == shown[what],
                        f"figure {name!r} shows the options of the component that draws; draw those of each result, "
                        "one.component",
                    )

    def _results(self) -> dict[str, Sequence[PlottedResult]]:
        """Results to draw, by what they are."""
        component = self.component
        x = np.linspace(0, 2 * np.pi, 12, endpoint=False)
        surface = Surface(
            heights=np.cos(x)[:, None] + np.cos(2 * x), pixel_size=0.5
        )
        maps = Maps(contact_of(np.maximum(surface.heights - 0.5, 0.0)), surface)
        replica = Trial(hold_times=(0.1, 1.0, 10.0)).replica()
        with recording() as block:
            if isinstance(component, Rupture) and component.outputs:
                component.force(with_states(replica))
        recorded = {
            name: np.stack([made.declared.values] * 2)
            for name, made in block.items()
        }

        def result(label: str, most: int, color: str) -> PlottedResult:
            bonds = np.array([[0, most // 2, most], [1, most // 3, most - 1]])
            ageing = _ageing(
                replica.contact,
                bonds,
                hold_times=replica.hold_times,
                observables=recorded,
            )
            return PlottedResult(
                label,
                ageing,
                replica.chemistry,
                color,
                component,
                load_maps=lambda: maps,
            )

        one, two = result("one", 20, "C0"), result("two", 12, "C1")
        results: dict[str, Sequence[PlottedResult]] = {
            "one result": [one],
            "two results": [one, two],
            "a result without maps and chemistry": [
                replace(one, chemistry=None, load_maps=Maps)
            ],
        }
        if isinstance(component, SurfaceMaker | ContactSolver):
            results["a result without ageing"] = [
                replace(one, ageing=None, chemistry=None)
            ]
        return results
