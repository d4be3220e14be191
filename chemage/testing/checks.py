"""How the checks of a role are declared, collected and run."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pytest

from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.plugins import registry

#: A statistical check fails by chance once in so many correct implementations; its seeds are fixed, so it stays passed.
CHANCE = 1e-5


@pytest.fixture
def isolated_registry() -> Iterator[registry.Registry]:
    """A registry without any plugin, in use during the test; ``isolated_registry.register(module, name)`` adds one."""
    with registry.using(registry.Registry([])) as empty:
        yield empty


class Check(NamedTuple):
    """One requirement of a role, as a function that raises AssertionError when an instance breaks it."""

    name: str
    function: Callable[..., None]
    inputs: Mapping[str, Any]

    def __call__(self, component: Component) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self.function(component, **self.inputs)

    def __repr__(self) -> str:
        return self.name


#: role -> its checks; those of every component under ""
CHECKS: dict[str, list[Callable[..., None]]] = {}


def check_of(role: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark a check: of ``role``, or of every component where that is empty."""

    def mark(function: Callable[..., None]) -> Callable[..., None]:
        CHECKS.setdefault(role, []).append(function)
        return function

    return mark


def checks_for(component: Component | type[Component], **inputs: Any) -> list[Check]:
    """The checks of a component's role, or of a role's class.

    ``inputs`` are what a role's checks need from outside: ``surfaces`` and ``force_tolerance`` (contact), ``path``
    (reader).
    """
    role = component.role
    roles = registry.current().roles
    if role not in roles:
        raise InputError.of("component", component, "is of no role", f"the roles are {', '.join(roles)}")
    found = []
    for function in (*CHECKS.get("", ()), *CHECKS.get(role, ())):
        code = function.__code__
        wanted = code.co_varnames[1 : code.co_argcount]
        found.append(Check(function.__name__.lstrip("_"), function, {k: v for k, v in inputs.items() if k in wanted}))
    unused = set(inputs).difference(*(check.inputs for check in found))
    if unused:
        raise InputError(f"{role} checks take no {', '.join(sorted(unused))}")
    return found


def parametrize_with_checks(
    components: Iterable[Component],
    *,
    expected_failures: Mapping[str, str] | Callable[[Component], Mapping[str, str]] | None = None,
    **inputs: Any,
) -> Any:
    """Parametrise a test with ``component`` and ``check``: every check of every component is a test of its own.

    ``expected_failures`` maps a check's name to the reason why it cannot hold (or is a function of the component that
    returns such a map); that test must then fail.
    """
    cases = []
    for number, component in enumerate(components):
        excused = expected_failures(component) if callable(expected_failures) else expected_failures or {}
        checks = checks_for(component, **inputs)
        if unknown := set(excused) - {check.name for check in checks}:
            raise InputError(
                f"expected_failures names no check of role {component.role!r}: {', '.join(sorted(unknown))}"
            )
        for check in checks:
            reason = excused.get(check.name)
            marks = [pytest.mark.xfail(reason=reason, strict=True, raises=AssertionError)] if reason else []
            cases.append(pytest.param(component, check, id=f"{component.kind}{number}-{check.name}", marks=marks))

    def parametrized(function: Callable[..., Any]) -> Callable[..., Any]:
        # tests written for chemage 0.1 name their argument so
        name = "choice" if "choice" in function.__code__.co_varnames[: function.__code__.co_argcount] else "component"
        return pytest.mark.parametrize((name, "check"), cases)(function)

    return parametrized


def run_checks(component: Component, role: type[Component], inputs: Mapping[str, Any]) -> None:
    if not isinstance(component, role):
        raise InputError.of("component", component, f"is not a chemage.{role.__name__}")
    for check in checks_for(component, **inputs):
        check(component)


def require(condition: Any, message: str) -> None:
    if not condition:
        raise AssertionError(message)


def refuses(what: str, call: Callable[[], Any], error: type[Exception] = InputError) -> str:
    """``call`` must raise ``error``; the message."""
    try:
        answer = call()
    except error as refusal:
        require(str(refusal), f"{what}: {type(refusal).__name__} without a message")
        return str(refusal)
    except Exception as other:
        raise AssertionError(f"{what}: raised {type(other).__name__}: {other}; expected {error.__name__}") from other
    raise AssertionError(f"{what}: gave {answer!r}; expected {error.__name__}")


def require_plain(value: Any, what: str) -> None:
    try:
        again = json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{what} is not plain JSON: {error}") from error
    require(again == value, f"{what} does not survive JSON (a tuple, or a key that is not a string?): {value!r}")


def seeds_are_harmless(draw: Callable[[Any], Any], what: str, *, chance: bool = False) -> None:
    """``draw(seed)``: the same seed the same answer, no side effects, and every seed another answer; unless there must
    be ``chance`` in it, all seeds may give the same."""
    before = np.random.get_state()[1].copy()  # noqa: NPY002  # pyright: ignore
    answers = [draw(seed) for seed in range(4)]
    require(draw(1) == answers[1], f"{what}: the same seed gave two results")
    distinct = sum(all(one != other for other in answers[:i]) for i, one in enumerate(answers))
    right = (4,) if chance else (1, 4)
    require(distinct in right, f"{what}: four seeds gave {distinct} different results; expected 4")
    sequence = np.random.SeedSequence(5, spawn_key=(2,))
    first = draw(sequence)
    require(sequence.n_children_spawned == 0, f"{what}: spawned from the SeedSequence it was given")
    require(draw(sequence) == first, f"{what}: the same SeedSequence gave two results")
    if distinct == 4:
        other = np.random.SeedSequence(5, spawn_key=(3,))
        require(draw(other) != first, f"{what}: two children of one SeedSequence gave the same result")
    after = np.random.get_state()[1]  # noqa: NPY002  # pyright: ignore
    require(np.array_equal(before, after), f"{what}: draws from numpy's global random state")


def speed_variants(component: Any) -> Iterator[tuple[str, Any]]:
    """The component with each whole-number option of ``speed_only`` set to 1, 2 and 3."""
    for name in type(component).speed_only:
        if "integer" in options_of(component)[name][0]:
            yield from ((f"{name} = {value}", component.replace(**{name: value})) for value in (1, 2, 3))


def require_estimates(what: str, found: Any, bounds: Mapping[str, float]) -> None:
    """``found`` must map names of ``bounds`` to finite numbers from 0 to the bound."""
    require(isinstance(found, Mapping), f"{what} gave {found!r}; expected a dict")
    for name, value in found.items():
        require(name in bounds, f"{what} gives {name!r}; known are {', '.join(bounds)}")
        require(0 <= value <= bounds[name] and math.isfinite(value), f"{what}: {name} = {value!r}")


def same_pressure(one: np.ndarray, two: np.ndarray, tolerance: float) -> bool:
    return float(np.linalg.norm(one - two)) <= tolerance * float(np.linalg.norm(two))


def options_of(component: Component) -> dict[str, tuple[set[str], str | None, str]]:
    """Option name -> (JSON types, unit, description)."""
    found = {}
    for name, schema in type(component).model_json_schema().get("properties", {}).items():
        parts = [schema, *schema.get("anyOf", [])]
        types = {str(part["type"]) for part in parts if "type" in part}
        unit = next((part["unit"] for part in parts if "unit" in part), None)
        found[name] = types, unit, schema.get("description", "")
    return found
