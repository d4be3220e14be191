"""Checks of every component: kind, options, references."""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Callable
from typing import Any

from chemage.foundation.components import Component
from chemage.plugins import registry
from chemage.testing.checks import check_of, checks_for, options_of, refuses, require, require_plain


def check_component(component: Component, **inputs: Any) -> None:
    """Run every check of the role of a component; raises AssertionError if one fails. See :func:`checks_for`."""
    for check in checks_for(component, **inputs):
        check(component)


@check_of("")
def _has_kind_and_role(component: Component) -> None:
    cls = type(component)
    require(
        isinstance(cls.kind, str) and cls.kind, f"{cls.__name__}.kind is empty; give the name that users select it by"
    )
    require(cls.kind == cls.kind.strip().lower() and " " not in cls.kind, f"kind {cls.kind!r}: use lower-case-words")
    require(
        isinstance(component, registry.current().role(cls.role)),
        f"{cls.__name__}: has role {cls.role!r}, but is not of its class",
    )
    require((cls.__doc__ or "").strip(), f"{cls.__name__} has no docstring")


@check_of("")
def _citations_are_strings(component: Component) -> None:
    cite = type(component).cite
    require(
        isinstance(cite, tuple),
        f"cite is a {type(cite).__name__}; expected a tuple of str, with a comma after a single one",
    )
    require(all(isinstance(one, str) and one.strip() for one in cite), f"cite = {cite!r}: not all are non-empty str")


@check_of("")
def _options_are_described(component: Component) -> None:
    for name, (_, unit, description) in options_of(component).items():
        require(description.strip(), f"option {name!r} has no description; write a docstring below it")
        if unit:
            from chemage.foundation.units import unit_registry as units

            units().parse_units(unit)


@check_of("")
def _speed_only_names_options(component: Component) -> None:
    unknown = set(type(component).speed_only) - set(type(component).model_fields)
    require(not unknown, f"speed_only names {', '.join(sorted(unknown))}, which are not options")


@check_of("")
def _options_are_frozen(component: Component) -> None:
    before = component.digest()
    for name in (*type(component).model_fields, "some_other_name"):
        try:
            setattr(component, name, getattr(component, name, 1))
        except (ValueError, AttributeError, TypeError):
            continue
        raise AssertionError(f"{name} can be set; a component is frozen")
    require(component.digest() == before, "the digest changed although no option did")


@check_of("")
def _options_go_round(component: Component) -> None:
    """Copies by todict, JSON and fromdict, by pickle and by replace are equal and have the same hash and digest."""
    fields = component.todict()
    require_plain(fields, "todict()")
    require(fields.get("kind") == component.kind, f"todict() has kind {fields.get('kind')!r}, not {component.kind!r}")
    ways: dict[str, Callable[[], Component]] = {
        "fromdict(todict())": lambda: type(component).fromdict(json.loads(json.dumps(fields))),
        "pickle": lambda: pickle.loads(pickle.dumps(component)),
        "replace()": component.replace,
    }
    for way, make in ways.items():
        try:
            again = make()
            same_hash, same_digest = hash(again) == hash(component), again.digest() == component.digest()
        except Exception as error:
            raise AssertionError(f"{way}: {type(error).__name__}: {error}") from error
        require(again == component, f"{way} returned {again!r}, not {component!r}")
        require(same_hash, f"{way}: the hash differs; options must be hashable and compare by value")
        require(same_digest, f"{way}: the digest differs")


@check_of("")
def _wrong_options_are_refused(component: Component) -> None:
    message = refuses("an unknown option", lambda: type(component)(no_such_option=1))
    require("no_such_option" in message, f"the error for an unknown option does not name it: {message}")
    for name, (types, unit, _) in options_of(component).items():
        if "number" not in types:
            continue
        for value in (math.nan, math.inf, -math.inf):
            message = refuses(f"{name} = {value}", lambda name=name, value=value: component.replace(**{name: value}))
            require(name in message, f"the error for {name} = {value} does not name the option: {message}")
        if unit:
            refuses(f"{name} in mol", lambda name=name: component.replace(**{name: "1 mol"}))
            value = getattr(component, name)
            if value is not None:
                text = f"{value!r} {unit}"
                require(component.replace(**{name: text}) == component, f"{name} = {text!r} is not {value!r}")
