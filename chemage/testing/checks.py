"""Declares, collects and runs the checks of the roles."""

from __future__ import annotations

import json
import math
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from inspect import Parameter, isfunction, signature
from typing import Any, ClassVar, Generic, NamedTuple, TypeGuard, TypeVar

import numpy as np

from chemage.foundation.components import Component
from chemage.foundation.errors import InputError, MissingError
from chemage.plugins import registry

try:
    import pytest
except ModuleNotFoundError:  # `chemage selftest` runs the checks without it
    pytest: Any = None

#: probability that one comparison of a statistical check rejects a correct component. A kit makes fewer than a thousand
#: comparisons, so that one kit in a million is a false alarm; seeds are fixed, so results are reproducible.
CHANCE = 1e-9
#: s that one check of one component may take; those of the slowest component of chemage take two
LIMIT = 120.0


@(pytest.fixture if pytest is not None else lambda function: function)
def isolated_registry() -> Iterator[registry.Registry]:
    """A registry without plugins, in use during a test; ``isolated_registry.register(module, name)`` adds a plugin."""
    with registry.using(registry.Registry([])) as empty:
        yield empty


class CheckFailed(AssertionError):
    """A component does not meet a requirement of its role; ``check`` is the name of the requirement."""

    def __init__(self, check: str, component: str, problem: str) -> None:
        super().__init__(check, component, problem)
        self.check = check

    def __str__(self) -> str:
        check, component, problem = self.args
        return f"{component}: check {check}: {problem}"


class ChecksFailed(ExceptionGroup, AssertionError):
    """All requirements that a component does not meet, each as a :class:`CheckFailed` in ``exceptions``."""

    def derive(self, excs: Sequence[Any]) -> Any:
        return ChecksFailed(self.message, excs)


class Check(NamedTuple):
    """One requirement of a role: it raises AssertionError if a component does not meet it."""

    name: str
    #: the class of which it is a method
    of: type[Checks[Any]]
    inputs: Mapping[str, Any]

    @property
    def function(self) -> Callable[..., None]:
        """The method, which takes an instance of its class and the inputs."""
        return getattr(self.of, self.name)

    @property
    def requirement(self) -> str:
        """What is required, in one sentence."""
        return " ".join((self.function.__doc__ or "").split("\n\n")[0].split())

    @property
    def missing(self) -> tuple[str, ...]:
        """Inputs without which there is nothing to check, and which were not given."""
        needed = [
            one.name
            for one in _taken(self.function)
            if one.default is one.empty and one.kind is not one.VAR_KEYWORD
        ]
        return tuple(name for name in needed if self.inputs.get(name) is None)

    def __call__(self, component: Component) -> None:
        if self.missing or isinstance(component, self.of.unless):
            return
        name = f"{component.role} {component.kind!r}"
        try:
            with _strict_warnings(), _limited(f"took longer than {LIMIT:g} s"):
                self.function(self.of(component), **self.inputs)
        except (CheckFailed, MissingError):
            raise
        except AssertionError as failure:
            raise CheckFailed(self.name, name, str(failure)) from failure
        except Warning as warning:
            problem = f"the component warns ({type(warning).__name__}: {warning}); handle this case"
            raise CheckFailed(self.name, name, problem) from warning
        except Exception as error:
            raise CheckFailed(
                self.name, name, f"raised {type(error).__name__}: {error}"
            ) from error

    def __repr__(self) -> str:
        return self.name


@contextmanager
def _limited(problem: str) -> Iterator[None]:
    """Fail after :data:`LIMIT` seconds; only where signals can be set, in the main thread and not on Windows."""

    def stop(*_: Any) -> None:
        raise AssertionError(problem)

    if threading.current_thread() is not threading.main_thread() or not hasattr(
        signal, "setitimer"
    ):
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _strict_warnings() -> Iterator[None]:
    """Warnings of numerics and of use are errors. Not those of an import, which are the library's own affair, nor
    announcements such as DeprecationWarning."""

    def show(
        message: Warning | str, category: type[Warning], *_: Any, **__: Any
    ) -> None:
        if not issubclass(category, RuntimeWarning | UserWarning):
            return
        frame = sys._getframe(1)
        while frame is not None and frame.f_code is not Check.__call__.__code__:
            if frame.f_code.co_filename.startswith("<frozen importlib"):
                return
            frame = frame.f_back
        raise message if isinstance(message, Warning) else category(message)

    with warnings.catch_warnings():
        warnings.simplefilter("always")
        # what loky says of the worker of the checks, which keeps what numba compiled, or by the clock
        warnings.filterwarnings(
            "ignore",
            "A worker (stopped|was restarted) while some jobs were given",
            UserWarning,
        )
        warnings.showwarning = show
        yield


C = TypeVar("C", bound=Component)
F = TypeVar("F", bound=Callable[..., None])
#: what is asked: (in words, a function of the component)
Questions = Iterator[tuple[str, Callable[[Any], Any]]]
#: role -> the classes of its checks; the checks of every component are those of the role ""
CHECKS: dict[str, list[type[Checks[Any]]]] = {}


class Checks(Generic[C]):
    """Checks of the class of a role ``of``, or of several, or of every component with :class:`Component`.

    Each method without an underscore is a check. Its arguments are inputs of :func:`checks_for`; without those that
    have no default there is nothing to check.
    """

    #: classes whose components are not checked
    unless: ClassVar[tuple[type, ...]] = ()
    #: checks of every component that come after those of its role, which say more of what is wrong
    last: ClassVar[bool] = False

    def __init_subclass__(
        cls, of: type[Component] | tuple[type[Component], ...]
    ) -> None:
        for role in of if isinstance(of, tuple) else (of,):
            CHECKS.setdefault(role.role, []).append(cls)

    def __init__(self, component: C) -> None:
        self.component, self.cls = component, type(component)

    @classmethod
    def names(cls) -> list[str]:
        """Its checks."""
        own = [
            name
            for name, value in vars(cls).items()
            if isfunction(value) and not name.startswith("_")
        ]
        return [name for name in own if name not in vars(Checks)]

    def other_values(self, name: str) -> Iterator[tuple[str, Any]]:
        """Yield the component with option ``name`` at other values that it accepts, and what was changed."""
        parts = self.options().get(name, [])
        types = {part.get("type") for part in parts}
        value = getattr(self.component, name)
        tried: list[Any] = [
            choice for part in parts for choice in part.get("enum", [])
        ]
        tried += [True, False] if "boolean" in types else []
        tried += [1, 2, 3] if "integer" in types else []
        if "number" in types and is_number(value):
            tried += [0.5 * value, 2 * value, 0.9 * value] if value else [0.1, 1.0]
        for other in tried:
            try:
                variant = self.component.replace(**{name: other})
            except InputError:
                continue
            if getattr(variant, name) != value or type(
                getattr(variant, name)
            ) is not type(value):
                yield f"{name} = {other}", variant

    def option_variants(self) -> Iterator[tuple[str, Any]]:
        """Yield the component as it is, with each switch, choice and option of ``speed_only`` at another value, and
        with all of these at once. Numbers that are not for speed alone may mean anything, and stay."""
        yield "with these options", self.component
        together: dict[str, Any] = {}
        for name in self.cls.model_fields:
            others = list(self.other_values(name))
            if name in self.cls.speed_only:
                others = others[:1]
            elif is_number(getattr(self.component, name)):
                continue
            yield from others
            if others:
                together[name] = getattr(others[-1][1], name)
        if len(together) > 1:
            try:
                words = ", ".join(
                    f"{name} = {value}" for name, value in together.items()
                )
                yield words, self.component.replace(**together)
            except InputError:
                return

    def trade_variants(self) -> Iterator[tuple[str, list[tuple[str, Any]]]]:
        """Yield each option of ``trade`` with the component at its values, from fast to accurate.

        Values that the other options of this component rule out are left out.
        """
        for name, values in self.cls.trade.items():
            variants = []
            for value in values:
                try:
                    variants.append(
                        (
                            f"{name} = {value}",
                            self.component.replace(**{name: value}),
                        )
                    )
                except InputError:
                    continue
            if len(variants) > 1:
                yield name, variants

    def rescaled(self, **scale: float) -> Any:
        """The component in other units: each option times the factor of its unit, see :meth:`Dimensions.factor`."""
        changes: dict[str, float] = {}
        for name, unit in self.units().items():
            value, its = getattr(self.component, name), dimensions(unit)
            if is_number(value) and not its.others and its.factor(**scale) != 1.0:
                changes[name] = value * its.factor(**scale)
        return self.component.replace(**changes) if changes else self.component

    def options(self) -> dict[str, list[dict[str, Any]]]:
        """The JSON schemas of each option: its own, then those of the alternatives of its value."""
        properties = self.cls.model_json_schema().get("properties", {})
        return {
            name: [schema, *schema.get("anyOf", [])]
            for name, schema in properties.items()
        }

    def units(self) -> dict[str, str]:
        """The units of the options that have one."""
        return {
            name: part["unit"]
            for name, parts in self.options().items()
            for part in parts
            if part.get("unit")
        }

    def questions(self, *_: Any, **__: Any) -> Questions:
        """What can be asked of the component.

        The questions come in pairs that differ in one thing, each pair about something that no other and no other check
        asks of, so that nothing that was kept before can answer them.
        """
        return iter(())


def known(check: F) -> F:
    """Mark a check that compares with closed forms or known numbers, within seconds: ``chemage selftest`` runs it."""
    check.known = True  # pyright: ignore[reportFunctionMemberAccess]
    return check


def _taken(function: Callable[..., None]) -> list[Parameter]:
    """The inputs that a check takes besides the component; it needs those without a default."""
    return list(signature(function, follow_wrapped=False).parameters.values())[1:]


def checks_for(
    component: Component | type[Component], **inputs: Any
) -> list[Check]:
    """List the checks of the role of a component, or of a class.

    ``inputs`` are passed on to the checks: ``surfaces`` and ``force_tolerance`` (role ``contact``), ``path`` and
    ``surface`` (role ``reader``).

    Raises
    ------
    InputError
        The component has no role, or the checks of its role do not use an input.
    """
    role = component.role
    roles = registry.current().roles
    if role not in roles:
        raise InputError.of(
            "component",
            component,
            "has no role",
            f"the roles are {', '.join(roles)}",
        )
    checks, used = [], set[str]()
    for of in sorted(
        (*CHECKS[""], *CHECKS.get(role, ())), key=lambda one: one.last
    ):
        for name in of.names():
            taken = _taken(getattr(of, name))
            every = any(one.kind is one.VAR_KEYWORD for one in taken)
            names = {one.name for one in taken}
            checks.append(
                Check(
                    name,
                    of,
                    {k: v for k, v in inputs.items() if every or k in names},
                )
            )
            used |= names
    if unused := set(inputs) - used:
        raise InputError(f"{role} checks take no {', '.join(sorted(unused))}")
    return checks


def parametrize_with_checks(
    components: Iterable[Component],
    *,
    expected_failures: Mapping[str, str]
    | Callable[[Component], Mapping[str, str]]
    | None = None,
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
        See :func:`checks_for`. A check that needs an input that is not given is skipped.
    """
    cases = []
    for number, component in enumerate(components):
        excused = (
            expected_failures(component)
            if callable(expected_failures)
            else expected_failures or {}
        )
        checks = checks_for(component, **inputs)
        if unknown := set(excused) - {check.name for check in checks}:
            raise InputError(
                f"expected_failures names no check of role {component.role!r}: {', '.join(sorted(unknown))}"
            )
        for check in checks:
            reason = excused.get(check.name)
            marks: list[Any] = (
                [
                    pytest.mark.xfail(
                        reason=reason, strict=True, raises=AssertionError
                    )
                ]
                if reason
                else []
            )
            if check.missing:
                marks = [
                    pytest.mark.skip(
                        reason=f"give {' and '.join(f'{name}=...' for name in check.missing)}"
                    )
                ]
            cases.append(
                pytest.param(
                    component,
                    check,
                    id=f"{component.kind}{number}-{check.name}",
                    marks=marks,
                )
            )

    return pytest.mark.parametrize(("component", "check"), cases)


def check_component(
    component: Component, *, all: bool = False, **inputs: Any
) -> None:
    """Run every check of the role of a component; see :func:`checks_for` for ``inputs``.

    Raises
    ------
    CheckFailed
        A check fails: the first that does.
    ChecksFailed
        With ``all``: one error that lists every check that fails.
    """
    failures: list[CheckFailed] = []
    checks = checks_for(component, **inputs)
    for check in checks:
        try:
            check(component)
        except CheckFailed as failure:
            if not all:
                raise
            failures.append(failure)
    if failures:
        lines = "".join(f"\n- {failure}" for failure in failures)
        raise ChecksFailed(
            f"{len(failures)} of {len(checks)} checks fail:{lines}", failures
        )


def whole(role: type[Component], **known: str) -> Callable[..., None]:
    """The function that runs every check of ``role``; ``known`` are the inputs that it takes and what they are."""

    def check(component: Component, *, all: bool = False, **inputs: Any) -> None:
        if not isinstance(component, role):
            raise InputError.of(
                "component", component, f"is not a chemage.plugin.{role.__name__}"
            )
        check_component(component, all=all, **inputs)

    further = "".join(
        f"\n\n``{name}``: {meaning}." for name, meaning in known.items()
    )
    check.__doc__ = (
        f"Run every check of the role ``{role.role}``; raises CheckFailed if one fails, with ``all`` every one that "
        f"does.{further}"
    )
    return check


def is_number(value: Any) -> TypeGuard[float]:
    """Whether it is a number, and no switch."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def require(condition: Any, message: str) -> None:
    """Raise AssertionError with ``message`` unless ``condition`` holds, also under ``python -O``."""
    if not condition:
        raise AssertionError(message)


@contextmanager
def naming(what: object) -> Iterator[None]:
    """Say where the component raised what it raises in this block, or which trial a check fails in."""
    try:
        yield
    except AssertionError as failure:
        raise AssertionError(f"{what}: {failure}") from failure
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}") from error


def refuses(
    what: str, call: Callable[[], Any], error: type[Exception] = InputError
) -> str:
    """Require that ``call`` raises ``error`` with a message, and return the message."""
    try:
        answer = call()
    except error as refusal:
        require(str(refusal), f"{what}: {type(refusal).__name__} without a message")
        return str(refusal)
    except Exception as other:
        raise AssertionError(
            f"{what}: raised {type(other).__name__}: {other}; expected {error.__name__}"
        ) from other
    raise AssertionError(f"{what}: returned {answer!r}; expected {error.__name__}")


def require_plain(value: Any, what: str) -> None:
    """Require that ``value`` consists of plain JSON values."""
    try:
        again = json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{what} is not plain JSON: {error}") from error
    require(
        again == value,
        f"{what} changes when written as JSON (a tuple, or a key that is not a string?): {value!r}",
    )


def seeds_are_harmless(
    draw: Callable[[Any], Any], what: str, *, chance: bool = False
) -> None:
    """Require that ``draw(seed)`` is reproducible, has no side effects, and differs between seeds.

    Without ``chance`` all seeds may give the same result.
    """

    def global_state() -> tuple[bytes, int]:
        state: Any = np.random.get_state()  # noqa: NPY002
        return state[1].tobytes(), state[2]

    before = global_state()
    answers = [draw(seed) for seed in range(4)]
    require(draw(1) == answers[1], f"{what}: the same seed gave two results")
    distinct = sum(
        all(one != other for other in answers[:i]) for i, one in enumerate(answers)
    )
    right = (4,) if chance else (1, 4)
    require(
        distinct in right,
        f"{what}: four seeds gave {distinct} different results; expected 4",
    )
    sequence = np.random.SeedSequence(5, spawn_key=(2,))
    first = draw(sequence)
    require(
        sequence.n_children_spawned == 0,
        f"{what}: spawned children of the given SeedSequence",
    )
    require(
        draw(sequence) == first, f"{what}: the same SeedSequence gave two results"
    )
    if distinct == 4:
        other = np.random.SeedSequence(5, spawn_key=(3,))
        require(
            draw(other) != first,
            f"{what}: two children of one SeedSequence gave the same result",
        )
    require(
        global_state() == before, f"{what}: draws from numpy's global random state"
    )


class Dimensions(NamedTuple):
    """The powers of mass, length, time and temperature in a unit, and whether it contains anything else."""

    mass: float
    length: float
    time: float
    temperature: float
    others: bool

    def factor(
        self, stress: float = 1.0, length: float = 1.0, time: float = 1.0
    ) -> float:
        """By how much a quantity of this unit grows with all stresses, lengths and times, and with k_BT as every other
        energy, which is a stress times a volume; a stress is M/(L T²)."""
        mass = stress * length * time**2
        return (
            mass**self.mass
            * length**self.length
            * time**self.time
            * (stress * length**3) ** self.temperature
        )


def dimensions(unit: str) -> Dimensions:
    """The dimensions of a unit."""
    from chemage.foundation.units import unit_registry as units

    found: dict[str, Any] = dict(units().parse_units(unit).dimensionality)
    names = ("[mass]", "[length]", "[time]", "[temperature]")
    mass, length, time, kelvin = (float(found.pop(name, 0)) for name in names)
    return Dimensions(mass, length, time, kelvin, bool(found))


def binomial_chance(count: int, of: int, probability: float) -> float:
    """The probability of a deviation like ``count`` of ``of`` or larger, on either side, where ``probability`` is."""
    from scipy.stats import binom

    return 2 * float(
        min(binom.cdf(count, of, probability), binom.sf(count - 1, of, probability))
    )


def require_estimates(what: str, estimates: Any, *names: str) -> None:
    """Require that ``estimates`` maps some ``names`` to finite numbers that are not negative."""
    require(
        isinstance(estimates, Mapping),
        f"{what} returned {estimates!r}; expected a dict",
    )
    for name, value in estimates.items():
        require(
            name in names, f"{what} returned {name!r}; known are {', '.join(names)}"
        )
        require(0 <= value < math.inf, f"{what}: {name} = {value!r}")
