"""Declares, collects and runs the checks of the roles."""

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

#: probability that a statistical check rejects a correct implementation; seeds are fixed, so results are reproducible
CHANCE = 1e-5


@pytest.fixture
def isolated_registry() -> Iterator[registry.Registry]:
    """A registry without plugins, in use during a test; ``isolated_registry.register(module, name)`` adds a plugin."""
    with registry.using(registry.Registry([])) as empty:
        yield empty


class Check(NamedTuple):
    """One requirement of a role: a function that raises AssertionError if a component does not meet it."""

    name: str
    function: Callable[..., None]
    inputs: Mapping[str, Any]

    def __call__(self, component: Component) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self.function(component, **self.inputs)

    def __repr__(self) -> str:
        return self.name


#: role -> its checks; the checks of every component are those of the role ""
CHECKS: dict[str, list[Callable[..., None]]] = {}


def check_of(role: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Declare a function as a check of ``role``, or of every component if ``role`` is empty."""

    def mark(function: Callable[..., None]) -> Callable[..., None]:
        CHECKS.setdefault(role, []).append(function)
        return function

    return mark


def checks_for(component: Component | type[Component], **inputs: Any) -> list[Check]:
    """List the checks of the role of a component, or of a class.

    ``inputs`` are passed on to the checks: ``surfaces`` and ``force_tolerance`` (role ``contact``), ``path`` (role
    ``reader``).

    Raises
    ------
    InputError
        The component has no role, or the checks of its role do not use an input.
    """
    role = component.role
    roles = registry.current().roles
    if role not in roles:
        raise InputError.of("component", component, "has no role", f"the roles are {', '.join(roles)}")
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
    """Parametrise a test with ``component`` and ``check``: each check of each component becomes one test.

    Parameters
    ----------
    components
        The instances to check.
    expected_failures
        Name of a check -> reason why it cannot pass, or a function of the component that returns such a mapping; these
        tests must fail.
    inputs
        See :func:`checks_for`.
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
        # the name of the argument in tests written for chemage 0.1
        name = "choice" if "choice" in function.__code__.co_varnames[: function.__code__.co_argcount] else "component"
        return pytest.mark.parametrize((name, "check"), cases)(function)

    return parametrized


def run_checks(component: Component, role: type[Component], inputs: Mapping[str, Any]) -> None:
    """Run every check of ``component``, which must be of ``role``."""
    if not isinstance(component, role):
        raise InputError.of("component", component, f"is not a chemage.{role.__name__}")
    for check in checks_for(component, **inputs):
        check(component)


def require(condition: Any, message: str) -> None:
    """Raise AssertionError with ``message`` unless ``condition`` holds, also under ``python -O``."""
    if not condition:
        raise AssertionError(message)


def refuses(what: str, call: Callable[[], Any], error: type[Exception] = InputError) -> str:
    """Require that ``call`` raises ``error`` with a message, and return the message."""
    try:
        answer = call()
    except error as refusal:
        require(str(refusal), f"{what}: {type(refusal).__name__} without a message")
        return str(refusal)
    except Exception as other:
        raise AssertionError(f"{what}: raised {type(other).__name__}: {other}; expected {error.__name__}") from other
    raise AssertionError(f"{what}: returned {answer!r}; expected {error.__name__}")


def require_plain(value: Any, what: str) -> None:
    """Require that ``value`` consists of plain JSON values."""
    try:
        again = json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{what} is not plain JSON: {error}") from error
    require(again == value, f"{what} changes when written as JSON (a tuple, or a key that is not a string?): {value!r}")


def seeds_are_harmless(draw: Callable[[Any], Any], what: str, *, chance: bool = False) -> None:
    """Require that ``draw(seed)`` is reproducible, has no side effects, and differs between seeds.

    Without ``chance`` all seeds may give the same result.
    """
    before = np.random.get_state()[1].copy()  # noqa: NPY002  # pyright: ignore
    answers = [draw(seed) for seed in range(4)]
    require(draw(1) == answers[1], f"{what}: the same seed gave two results")
    distinct = sum(all(one != other for other in answers[:i]) for i, one in enumerate(answers))
    right = (4,) if chance else (1, 4)
    require(distinct in right, f"{what}: four seeds gave {distinct} different results; expected 4")
    sequence = np.random.SeedSequence(5, spawn_key=(2,))
    first = draw(sequence)
    require(sequence.n_children_spawned == 0, f"{what}: spawned children of the given SeedSequence")
    require(draw(sequence) == first, f"{what}: the same SeedSequence gave two results")
    if distinct == 4:
        other = np.random.SeedSequence(5, spawn_key=(3,))
        require(draw(other) != first, f"{what}: two children of one SeedSequence gave the same result")
    after = np.random.get_state()[1]  # noqa: NPY002  # pyright: ignore
    require(np.array_equal(before, after), f"{what}: draws from numpy's global random state")


def speed_variants(component: Any) -> Iterator[tuple[str, Any]]:
    """Yield the component with each integer option of ``speed_only`` set to 1, 2 and 3."""
    for name in type(component).speed_only:
        if "integer" in options_of(component)[name][0]:
            yield from ((f"{name} = {value}", component.replace(**{name: value})) for value in (1, 2, 3))


def require_estimates(what: str, found: Any, bounds: Mapping[str, float]) -> None:
    """Require that ``found`` maps names in ``bounds`` to finite numbers between 0 and the bound."""
    require(isinstance(found, Mapping), f"{what} returned {found!r}; expected a dict")
    for name, value in found.items():
        require(name in bounds, f"{what} returned {name!r}; known are {', '.join(bounds)}")
        require(0 <= value <= bounds[name] and math.isfinite(value), f"{what}: {name} = {value!r}")


def options_of(component: Component) -> dict[str, tuple[set[str], str | None, str]]:
    """List the options of a component: name -> (JSON types, unit, description)."""
    found = {}
    for name, schema in type(component).model_json_schema().get("properties", {}).items():
        parts = [schema, *schema.get("anyOf", [])]
        types = {str(part["type"]) for part in parts if "type" in part}
        unit = next((part["unit"] for part in parts if "unit" in part), None)
        found[name] = types, unit, schema.get("description", "")
    return found
