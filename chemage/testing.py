"""The kit for testing a plugin's choices: every promise a role makes, as checks that run on an instance.

.. code-block:: python

    from chemage.testing import parametrize_with_checks

    @parametrize_with_checks([Weibull(scale="1.1 eV", shape=8)])
    def test_keeps_the_contract(choice, check):
        check(choice)

or, without pytest's parametrisation, ``check_barriers(Weibull(...))``. A check that cannot hold is expected to fail,
with the reason: ``expected_failures={"restart_is_exact": "random numbers are drawn in sequence"}``.

The fixture ``isolated_registry`` is a registry in which no plugin is installed, in use for the length of a test. A
``conftest.py`` gets it with ``pytest_plugins = ["chemage.testing"]``; it is not a pytest entry point, because that
would import chemage in every test session of everyone who has it installed.
"""

from __future__ import annotations

import json
import math
import pickle
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pytest

from chemage import registry
from chemage.errors import ChemageError, InputError
from chemage.objects import BondHistory, ContactSolution, ReactionLattice, Record, Surface
from chemage.spec import ROLES, Barriers, ContactSolver, Engine, Interaction, Observable, Reader, Spec, SurfaceMaker
from chemage.units import KB

__all__ = [
    "Check",
    "check_barriers",
    "check_contact_solver",
    "check_engine",
    "check_interaction",
    "check_observable",
    "check_reader",
    "check_surface_maker",
    "checks_for",
    "isolated_registry",
    "parametrize_with_checks",
    "rough_surface",
]

#: A statistical check fails by chance once in so many correct implementations; its seeds are fixed, so it stays passed.
_CHANCE = 1e-5


@pytest.fixture
def isolated_registry() -> Iterator[registry.Registry]:
    """A registry without any plugin, in use during the test; ``isolated_registry.register(module, name)`` adds one."""
    with registry.using(registry.Registry([])) as empty:
        yield empty


class Check(NamedTuple):
    """One promise of a role, as a function that raises AssertionError when an instance breaks it."""

    name: str
    function: Callable[..., None]
    inputs: Mapping[str, Any]

    def __call__(self, choice: Spec) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self.function(choice, **self.inputs)

    def __repr__(self) -> str:
        return self.name


_CHECKS: dict[str, list[Callable[..., None]]] = {role: [] for role in ("", *ROLES)}


def _promise(role: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark a check: of ``role``, or of every choice where that is empty."""

    def mark(function: Callable[..., None]) -> Callable[..., None]:
        _CHECKS[role].append(function)
        return function

    return mark


def checks_for(choice: Spec | type[Spec], **inputs: Any) -> list[Check]:
    """The checks of a choice's role, or of a role's class.

    ``inputs`` are what a role's checks need from outside: ``surfaces`` and ``force_tolerance`` (contact), ``path``
    (reader).
    """
    role = choice.role
    if role not in ROLES:
        raise InputError.of("choice", choice, "is of no role", f"the roles are {', '.join(ROLES)}")
    found = []
    for function in (*_CHECKS[""], *_CHECKS[role]):
        code = function.__code__
        wanted = code.co_varnames[1 : code.co_argcount]
        found.append(Check(function.__name__.lstrip("_"), function, {k: v for k, v in inputs.items() if k in wanted}))
    unused = set(inputs).difference(*(check.inputs for check in found))
    if unused:
        raise InputError(f"{role} checks take no {', '.join(sorted(unused))}")
    return found


def parametrize_with_checks(
    choices: Iterable[Spec],
    *,
    expected_failures: Mapping[str, str] | Callable[[Spec], Mapping[str, str]] | None = None,
    **inputs: Any,
) -> Any:
    """Parametrise a test with ``choice`` and ``check``: every check of every choice is a test of its own.

    ``expected_failures`` maps a check's name to the reason why it cannot hold (or is a function of the choice that
    returns such a map); that test must then fail.
    """
    cases = []
    for number, choice in enumerate(choices):
        excused = expected_failures(choice) if callable(expected_failures) else expected_failures or {}
        checks = checks_for(choice, **inputs)
        if unknown := set(excused) - {check.name for check in checks}:
            raise InputError(f"expected_failures names no check of role {choice.role!r}: {', '.join(sorted(unknown))}")
        for check in checks:
            reason = excused.get(check.name)
            marks = [pytest.mark.xfail(reason=reason, strict=True, raises=AssertionError)] if reason else []
            cases.append(pytest.param(choice, check, id=f"{choice.kind}{number}-{check.name}", marks=marks))
    return pytest.mark.parametrize(("choice", "check"), cases)


def _run(choice: Spec, role: type[Spec], inputs: Mapping[str, Any]) -> None:
    if not isinstance(choice, role):
        raise InputError.of("choice", choice, f"is not a chemage.spec.{role.__name__}")
    for check in checks_for(choice, **inputs):
        check(choice)


def check_surface_maker(choice: SurfaceMaker) -> None:
    """Every promise of role ``surface``."""
    _run(choice, SurfaceMaker, {})


def check_contact_solver(choice: ContactSolver, **inputs: Any) -> None:
    """Every promise of role ``contact``; ``surfaces`` to solve besides the kit's own, ``force_tolerance``."""
    _run(choice, ContactSolver, inputs)


def check_barriers(choice: Barriers) -> None:
    """Every promise of role ``barriers``."""
    _run(choice, Barriers, {})


def check_interaction(choice: Interaction) -> None:
    """Every promise of role ``interaction``."""
    _run(choice, Interaction, {})


def check_engine(choice: Engine) -> None:
    """Every promise of role ``engine``."""
    _run(choice, Engine, {})


def check_observable(choice: Observable) -> None:
    """Every promise of role ``observable``."""
    _run(choice, Observable, {})


def check_reader(choice: Reader, **inputs: Any) -> None:
    """Every promise of role ``reader``; ``path`` is a file it can read."""
    _run(choice, Reader, inputs)


def _require(condition: Any, message: str) -> None:
    if not condition:
        raise AssertionError(message)


def _refuses(what: str, call: Callable[[], Any], error: type[Exception] = InputError) -> str:
    """``call`` must raise ``error``; the message."""
    try:
        answer = call()
    except error as refusal:
        _require(str(refusal), f"{what}: {type(refusal).__name__} without a message")
        return str(refusal)
    except Exception as other:
        raise AssertionError(f"{what}: raised {type(other).__name__}: {other}; expected {error.__name__}") from other
    raise AssertionError(f"{what}: gave {answer!r}; expected {error.__name__}")


def _plain(value: Any, what: str) -> None:
    try:
        again = json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{what} is not plain JSON: {error}") from error
    _require(again == value, f"{what} does not survive JSON (a tuple, or a key that is not a string?): {value!r}")


def _seeds_are_harmless(draw: Callable[[Any], Any], what: str, *, chance: bool = False) -> None:
    """``draw(seed)``: the same seed the same answer, no side effects, and every seed another answer; unless there must
    be ``chance`` in it, all seeds may give the same."""
    before = np.random.get_state()[1].copy()  # noqa: NPY002  # pyright: ignore
    answers = [draw(seed) for seed in range(4)]
    _require(draw(1) == answers[1], f"{what}: the same seed gave two results")
    distinct = sum(all(one != other for other in answers[:i]) for i, one in enumerate(answers))
    right = (4,) if chance else (1, 4)
    _require(distinct in right, f"{what}: four seeds gave {distinct} different results; expected 4")
    sequence = np.random.SeedSequence(5, spawn_key=(2,))
    first = draw(sequence)
    _require(sequence.n_children_spawned == 0, f"{what}: spawned from the SeedSequence it was given")
    _require(draw(sequence) == first, f"{what}: the same SeedSequence gave two results")
    if distinct == 4:
        other = np.random.SeedSequence(5, spawn_key=(3,))
        _require(draw(other) != first, f"{what}: two children of one SeedSequence gave the same result")
    after = np.random.get_state()[1]  # noqa: NPY002  # pyright: ignore
    _require(np.array_equal(before, after), f"{what}: draws from numpy's global random state")


# -- every choice -----------------------------------------------------------------------------------------------------


@_promise("")
def _has_kind_and_role(choice: Spec) -> None:
    cls = type(choice)
    _require(isinstance(cls.kind, str) and cls.kind, f"{cls.__name__}.kind is empty; name it as users will")
    _require(cls.kind == cls.kind.strip().lower() and " " not in cls.kind, f"kind {cls.kind!r}: use lower-case-words")
    _require(isinstance(choice, ROLES[cls.role]), f"{cls.__name__}: role {cls.role!r} but not its class")
    _require((cls.__doc__ or "").strip(), f"{cls.__name__} has no docstring")


@_promise("")
def _citations_are_strings(choice: Spec) -> None:
    cite = type(choice).cite
    _require(
        isinstance(cite, tuple), f"cite is a {type(cite).__name__}; a tuple of str, with a comma after a single one"
    )
    _require(all(isinstance(one, str) and one.strip() for one in cite), f"cite = {cite!r}: not all are non-empty str")


def _options(choice: Spec) -> dict[str, tuple[set[str], str | None, str]]:
    """Option name -> (JSON types, unit, description)."""
    found = {}
    for name, schema in type(choice).model_json_schema().get("properties", {}).items():
        parts = [schema, *schema.get("anyOf", [])]
        types = {str(part["type"]) for part in parts if "type" in part}
        unit = next((part["unit"] for part in parts if "unit" in part), None)
        found[name] = types, unit, schema.get("description", "")
    return found


@_promise("")
def _options_are_described(choice: Spec) -> None:
    for name, (_, unit, description) in _options(choice).items():
        _require(description.strip(), f"option {name!r} has no description; write a docstring below it")
        if unit:
            from chemage.units import registry as units

            units().parse_units(unit)


@_promise("")
def _speed_only_names_options(choice: Spec) -> None:
    unknown = set(type(choice).speed_only) - set(type(choice).model_fields)
    _require(not unknown, f"speed_only names {', '.join(sorted(unknown))}, which is no option")


@_promise("")
def _options_are_frozen(choice: Spec) -> None:
    before = choice.digest()
    for name in (*type(choice).model_fields, "some_other_name"):
        try:
            setattr(choice, name, getattr(choice, name, 1))
        except (ValueError, AttributeError, TypeError):
            continue
        raise AssertionError(f"{name} can be set; a choice is frozen")
    _require(choice.digest() == before, "the digest changed while nothing did")


@_promise("")
def _options_go_round(choice: Spec) -> None:
    """todict → JSON → fromdict, pickle: equal, hashable, of the same digest."""
    fields = choice.todict()
    _plain(fields, "todict()")
    _require(fields.get("kind") == choice.kind, f"todict() has kind {fields.get('kind')!r}, not {choice.kind!r}")
    ways: dict[str, Callable[[], Spec]] = {
        "fromdict(todict())": lambda: type(choice).fromdict(json.loads(json.dumps(fields))),
        "pickle": lambda: pickle.loads(pickle.dumps(choice)),
        "replace()": choice.replace,
    }
    for way, make in ways.items():
        try:
            again = make()
            same_hash, same_digest = hash(again) == hash(choice), again.digest() == choice.digest()
        except Exception as error:
            raise AssertionError(f"{way}: {type(error).__name__}: {error}") from error
        _require(again == choice, f"{way} gave {again!r}, not {choice!r}")
        _require(same_hash, f"{way}: another hash; options must be hashable and compare by value")
        _require(same_digest, f"{way}: another digest")


@_promise("")
def _wrong_options_are_refused(choice: Spec) -> None:
    message = _refuses("an unknown option", lambda: type(choice)(no_such_option=1))
    _require("no_such_option" in message, f"the refusal of an unknown option does not name it: {message}")
    for name, (types, unit, _) in _options(choice).items():
        if "number" not in types:
            continue
        for value in (math.nan, math.inf, -math.inf):
            message = _refuses(f"{name} = {value}", lambda name=name, value=value: choice.replace(**{name: value}))
            _require(name in message, f"the refusal of {name} = {value} does not name it: {message}")
        if unit:
            _refuses(f"{name} in mol", lambda name=name: choice.replace(**{name: "1 mol"}))
            value = getattr(choice, name)
            if value is not None:
                text = f"{value!r} {unit}"
                _require(choice.replace(**{name: text}) == choice, f"{name} = {text!r} is not {value!r}")


def _speed_variants(choice: Any) -> Iterator[tuple[str, Any]]:
    """The choice with each whole-number option of ``speed_only`` set to 1, 2 and 3."""
    for name in type(choice).speed_only:
        if "integer" in _options(choice)[name][0]:
            yield from ((f"{name} = {value}", choice.replace(**{name: value})) for value in (1, 2, 3))


# -- surfaces ---------------------------------------------------------------------------------------------------------


@_promise("surface")
def _makes_a_surface(choice: SurfaceMaker) -> None:
    surface = choice.make(0)
    _require(isinstance(surface, Surface), f"make() gave {type(surface).__name__}, not a chemage.Surface")
    _require(np.isfinite(surface.heights).all(), "heights are not finite")
    _plain(surface.provenance, "provenance")
    _require(surface.provenance, "provenance is empty; say how it was made, such as self.todict() and the seed")
    _require(choice.make() == surface, "make() is not make(0)")


@_promise("surface")
def _surface_follows_its_seed(choice: SurfaceMaker) -> None:
    _seeds_are_harmless(lambda seed: choice.make(seed).heights.tobytes(), "make")
    if choice.make(0).heights.tobytes() != choice.make(1).heights.tobytes():
        for seed in (-1, 0.5):
            _refuses(f"make({seed})", lambda seed=seed: choice.make(seed))  # pyright: ignore[reportArgumentType]


def _estimates(what: str, found: Any, bounds: Mapping[str, float]) -> None:
    """``found`` must map names of ``bounds`` to finite numbers from 0 to the bound."""
    _require(isinstance(found, Mapping), f"{what} gave {found!r}; expected a dict")
    for name, value in found.items():
        _require(name in bounds, f"{what} gives {name!r}; known are {', '.join(bounds)}")
        _require(0 <= value <= bounds[name] and math.isfinite(value), f"{what}: {name} = {value!r}")


@_promise("surface")
def _surface_is_as_expected(choice: SurfaceMaker) -> None:
    """What ``expected()`` says beforehand, as far as it says it, is what ``make()`` gives."""
    surface, said = choice.make(0), choice.expected()
    exact = {"nx": surface.shape[0], "ny": surface.shape[1], "pixel_size": surface.pixel_size}
    _estimates("expected()", said, dict.fromkeys((*exact, "rms_slope", "shortest_wavelength"), math.inf))
    for name in exact.keys() & said.keys():
        _require(said[name] == exact[name], f"expected() says {name} = {said[name]}, the surface has {exact[name]}")
    if "rms_slope" in said:
        slope = said["rms_slope"]
        _require(
            math.isclose(slope, surface.rms_slope, rel_tol=0.3, abs_tol=1e-9),
            f"expected() says rms_slope = {slope}, the surface has {surface.rms_slope}",
        )


# -- contact ----------------------------------------------------------------------------------------------------------


def rough_surface(shape: tuple[int, int] = (32, 32), seed: int = 0, **fields: Any) -> Surface:
    """A small random surface for tests: every mode up to a quarter of the grid, rms slope 0.1, pixels of 0.5 nm."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    heights = np.zeros(shape)
    top = [max(1, n // 4) if n > 1 else 0 for n in shape]
    for i in range(top[0] + 1):
        for j in range(-top[1], top[1] + 1):
            size = math.hypot(i / shape[0], j / shape[1])
            if size > 0:
                phase, height = rng.random(), rng.standard_normal()
                heights += height * (size * max(shape)) ** -1.8 * np.cos(2 * np.pi * (i * x + j * y + phase))
    fields = {"pixel_size": 0.5, **fields}
    slope = Surface(heights=heights, **fields).rms_slope
    return Surface(heights=heights * (0.1 / slope if slope > 0 else 0), **fields)


def _paraboloid(pixels: int = 48, radius: float = 30.0, pixel_size: float = 0.5) -> Surface:
    x = (np.arange(pixels) - (pixels - 1) / 2) * pixel_size
    heights = -(x[:, None] ** 2 + x**2) / (2 * radius)
    return Surface(heights=heights, pixel_size=pixel_size, periodic=False, provenance={"radius": radius})


def _solvable(choice: ContactSolver, surfaces: Sequence[Surface]) -> list[tuple[Surface, float]]:
    """The surfaces this solver treats, each with a load (nN) that brings some but not all of it into contact."""
    taken = []
    for surface in (*surfaces, rough_surface(), _paraboloid()):
        try:
            light = choice.solve(surface, 1e-3 * surface.nominal_area)
        except InputError:
            continue
        _require(isinstance(light, ContactSolution), f"solve() gave {type(light).__name__}, not a ContactSolution")
        taken.append((surface, 0.02 * light.modulus * surface.rms_slope * surface.nominal_area))
    _require(taken, "refused a rough periodic surface and a paraboloid; give surfaces=[...] that it can treat")
    return taken


@_promise("contact")
def _contact_carries_the_load(choice: ContactSolver, surfaces: Sequence[Surface] = (), force_tolerance=1e-6) -> None:
    for surface, load in _solvable(choice, surfaces):
        solution = choice.solve(surface, load)
        _require(solution.load == load, f"asked for {load} nN, the solution says {solution.load}")
        force = float(solution.pressure.sum(dtype=np.float64)) * solution.pixel_size**2
        _require(
            math.isclose(force, load, rel_tol=force_tolerance),
            f"the pressure adds up to {force!r} nN, the load is {load!r} nN",
        )
        _require(0 < solution.sites.size < solution.pressure.size, f"{solution.area_fraction=}: expected some contact")
        _require(solution.pressure.min() >= 0, "negative pressure")


@_promise("contact")
def _solution_describes_itself(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(choice, surfaces):
        solution = choice.solve(surface, load)
        _require(solution.shape == surface.shape, f"a solution of {solution.shape} pixels for {surface.shape}")
        for name in ("pixel_size", "periodic"):
            mine, its = getattr(solution, name), getattr(surface, name)
            _require(mine == its, f"{name} is {mine}, the surface has {its}")
        for name in ("rms_slope", "rms_height"):
            mine, its = getattr(solution, name), getattr(surface, name)
            _require(math.isclose(mine, its, rel_tol=1e-6), f"{name} is {mine}, the surface has {its}")
        for name in choice.implemented_properties:
            # an option of the same name may ask for what costs memory
            asked = (
                choice.replace(**{name: True}).solve(surface, load) if name in type(choice).model_fields else solution
            )
            _require(getattr(asked, name, None) is not None, f"implements {name!r}, but the solution has none")
        _require(solution.converged, "did not converge, and did not raise ConvergenceError")
        _require(math.isfinite(solution.residual), f"residual {solution.residual}")
        _plain(solution.provenance, "provenance")
        _require(solution.provenance, "provenance is empty; say how the contact was solved, such as self.todict()")
        _plain(solution.convergence, "convergence")


@_promise("contact")
def _gap_is_closed_in_contact(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Hard wall: gap ≥ 0, p·gap = 0, within the solver's tolerance."""
    for surface, load in _solvable(choice, surfaces):
        asked = choice.replace(gap=True) if "gap" in type(choice).model_fields else choice
        solution = asked.solve(surface, load)
        if solution.gap is None:
            continue
        scale = 1e-3 * surface.rms_height
        _require(solution.gap.min() >= -scale, f"the bodies overlap by {-solution.gap.min():g} nm")
        gap = float(np.abs(solution.gap[solution.contact]).max())
        _require(gap <= 10 * scale, f"a gap of {gap:g} nm where the pressure is positive")


@_promise("contact")
def _no_load_is_no_contact(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, _ in _solvable(choice, surfaces):
        solution = choice.solve(surface, 0)
        _require(solution.sites.size == 0 and solution.load == 0, f"{solution.sites.size} pixels in contact at load 0")


@_promise("contact")
def _wrong_load_is_refused(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    surface, load = _solvable(choice, surfaces)[0]
    for wrong in (-1.0, math.nan, math.inf, "20 GPa", "20", True):
        _refuses(f"load {wrong!r}", lambda wrong=wrong: choice.solve(surface, wrong))
    _require(
        choice.solve(surface, f"{load!r} nN") == choice.solve(surface, load), "a load with its unit is another load"
    )


@_promise("contact")
def _contact_is_deterministic(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(choice, surfaces):
        first, second = choice.solve(surface, load), choice.solve(surface, load)
        _require(first.pressure.tobytes() == second.pressure.tobytes(), "two solves gave different pressures")


def _same_pressure(one: np.ndarray, two: np.ndarray, tolerance: float) -> bool:
    return float(np.linalg.norm(one - two)) <= tolerance * float(np.linalg.norm(two))


@_promise("contact")
def _contact_scales(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Elasticity has no scale: all lengths ×3 and the load ×9, or modulus and load ×2; a raised surface is the same."""
    for surface, load in _solvable(choice, surfaces):
        plain = choice.solve(surface, load)
        if "modulus" in type(choice).model_fields:
            stiff = choice.replace(modulus=2 * plain.modulus).solve(surface, 2 * load)
            _require(_same_pressure(stiff.pressure / 2, plain.pressure, 1e-3), "twice modulus and load is not twice p")
        for what, other, force in (
            ("three times the size", surface.heights * 3, 9 * load),
            ("raised by 5 nm", surface.heights + 5, load),
        ):
            size = surface.pixel_size * (3 if force > load else 1)
            radius = surface.provenance.get("radius")
            known = {"radius": radius * size / surface.pixel_size} if radius else {}
            changed = Surface(heights=other, pixel_size=size, periodic=surface.periodic, provenance=known)
            try:
                solution = choice.solve(changed, force)
            except InputError:  # it needs more than heights and radius
                continue
            _require(_same_pressure(solution.pressure, plain.pressure, 1e-3), f"{what}: another pressure")


@_promise("contact")
def _contact_grows_with_load(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(choice, surfaces):
        areas = [choice.solve(surface, factor * load).sites.size for factor in (0.3, 1.0, 2.0)]
        _require(areas == sorted(areas) and areas[0] < areas[-1], f"pixels in contact at rising load: {areas}")


@_promise("contact")
def _speed_does_not_change_the_contact(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Options named in ``speed_only``, such as a number of threads, change no byte of the pressure."""
    for surface, load in _solvable(choice, surfaces):
        pressure = choice.solve(surface, load).pressure
        for what, variant in _speed_variants(choice):
            _require(variant.solve(surface, load).pressure.tobytes() == pressure.tobytes(), f"{what}: other pressures")


@_promise("contact")
def _contact_cost_is_estimated(choice: ContactSolver) -> None:
    """``expected()`` takes what a surface says beforehand, little or much, and gives finite numbers."""
    much = {"nx": 64.0, "ny": 48.0, "pixel_size": 0.5, "rms_slope": 0.1, "shortest_wavelength": 4.0}
    for surface in ({}, {"nx": 64.0, "ny": 48.0}, much):
        for load in (0.0, 1.0, 1e9):
            said = choice.expected(surface, load)
            bounds = {"area_fraction": 1.0, "cpu_seconds": math.inf, "bytes": math.inf}
            _estimates(f"expected({surface}, {load})", said, bounds)


@_promise("contact")
def _start_changes_nothing(choice: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(choice, surfaces):
        start, cold = choice.solve(surface, 0.5 * load), choice.solve(surface, load)
        warm = choice.solve(surface, load, start=start)
        _require(_same_pressure(warm.pressure, cold.pressure, 1e-2), "another solution when started from a neighbour")


@_promise("contact")
def _odd_grids_are_solved(choice: ContactSolver) -> None:
    """Non-square, odd, one pixel wide, one pixel: solved, or refused with an InputError."""
    for shape in ((15, 32), (9, 7), (1, 16), (1, 1)):
        for surface in (rough_surface(shape), rough_surface(shape, periodic=False)):
            try:
                solution = choice.solve(surface, 1e-2 * surface.nominal_area)
            except InputError:
                continue
            _require(solution.shape == shape, f"a solution of {solution.shape} for {shape}")


# -- barriers ---------------------------------------------------------------------------------------------------------

_LOWEST, _HIGHEST = 2.0**-53, 1 - 2.0**-53


@_promise("barriers")
def _quantile_is_monotone(choice: Barriers) -> None:
    uniform = np.concatenate([[_LOWEST, 1e-12, 1e-6], np.linspace(1e-4, 1 - 1e-4, 2001), [1 - 1e-6, _HIGHEST]])
    energy = choice.quantile(uniform)
    _require(energy.shape == uniform.shape and energy.dtype == np.float64, f"{energy.shape} {energy.dtype}")
    _require(np.isfinite(energy).all(), "a barrier is not finite for a uniform number between 2^-53 and 1 - 2^-53")
    falls = np.flatnonzero(np.diff(energy) < 0)
    _require(not falls.size, f"the quantile function falls at u = {uniform[falls[:1]]}")


@_promise("barriers")
def _barrier_is_the_pixels_own(choice: Barriers) -> None:
    """A pixel's barrier depends on its own number alone, not on how many pixels there are, nor on earlier calls."""
    uniform = np.random.default_rng(1).random(1000)
    energy = choice.quantile(uniform)
    _require(energy.tobytes() == choice.quantile(uniform).tobytes(), "two calls gave different barriers")
    for part in (slice(None, None, -1), slice(10, 11), slice(3, 700, 7)):
        alone = choice.quantile(np.ascontiguousarray(uniform[part]))
        _require(np.allclose(alone, energy[part], rtol=1e-13, atol=0), "a barrier changed with what else was asked")
    grid = choice.quantile(uniform.reshape(20, 50))
    _require(grid.shape == (20, 50) and np.allclose(grid.ravel(), energy, rtol=1e-13), "not the shape it was given")
    _require(choice.quantile(np.empty(0)).shape == (0,), "no pixels: expected an empty array")


@_promise("barriers")
def _density_agrees_with_quantile(choice: Barriers) -> None:
    """∫ density between two quantiles is the probability between them."""
    levels = np.array([0.001, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 0.999])
    energies = choice.quantile(levels)
    if energies[0] == energies[-1]:
        _require(np.isposinf(choice.density(energies[:1])).all(), "a point mass has density inf")
        return
    for (low, high), (below, above) in zip(pairwise(energies), pairwise(levels), strict=True):
        # midpoints: a density may jump at a quantile
        count = 20000
        middle = low + (np.arange(count) + 0.5) * (high - low) / count
        density = choice.density(middle)
        _require(density.shape == middle.shape, f"density of shape {density.shape} for energies of {middle.shape}")
        _require((density >= 0).all() and np.isfinite(density).all(), f"density between {low} and {high} eV")
        total = float(density.sum()) * (high - low) / count
        _require(
            abs(total - (above - below)) < 1e-3,
            f"the density adds up to {total:.5f} between {low:.5f} and {high:.5f} eV; "
            f"the quantile function puts {above - below:.5f} there",
        )
    far = choice.density(np.array([energies[0] - 1e3, energies[-1] + 1e3]))
    _require(np.allclose(far, 0, atol=1e-6), f"density {far} a thousand eV away")


# -- interactions -----------------------------------------------------------------------------------------------------

_GRIDS = ((1, 1), (1, 2), (2, 2), (1, 7), (2, 5), (3, 3), (7, 5), (13, 11))


def _patches_of_sites(grid: tuple[int, int]) -> Iterator[np.ndarray]:
    size = grid[0] * grid[1]
    yield np.arange(size, dtype=np.int64)
    some = np.flatnonzero(np.random.default_rng(size).random(size) < 0.6).astype(np.int64)
    if some.size < size:
        yield some
    yield np.empty(0, np.int64)


@_promise("interaction")
def _graph_is_sound(choice: Interaction) -> None:
    """No site its own neighbour, none twice, each pair from both ends with one energy, on every kind of small grid."""
    for grid in _GRIDS:
        for periodic in (True, False):
            for sites in _patches_of_sites(grid):
                where = f"{grid[0]}x{grid[1]} grid, periodic={periodic}, {sites.size} sites"
                neighbours = choice.neighbours(grid, periodic, sites)
                _require(neighbours.dtype == np.int32, f"{where}: neighbours are {neighbours.dtype}, not int32")
                _require(neighbours.ndim == 2 and neighbours.shape[0] == sites.size, f"{where}: {neighbours.shape}")
                coupling = choice.coupling(sites, neighbours, 0)
                _require(coupling.shape == neighbours.shape, f"{where}: coupling {coupling.shape}")
                _require((coupling[neighbours < 0] == 0).all(), f"{where}: energy where there is no neighbour")
                try:
                    ReactionLattice(
                        pixels=grid,
                        sites=sites,
                        forming=np.ones(sites.size),
                        neighbours=neighbours,
                        coupling=coupling,
                    )
                except InputError as error:
                    raise AssertionError(f"{where}: {error}") from error


def _pairs(choice: Interaction, grid: tuple[int, int], sites: np.ndarray, seed: Any) -> dict[tuple[int, int], float]:
    neighbours = choice.neighbours(grid, True, sites)
    coupling = choice.coupling(sites, neighbours, seed)
    i, s = np.nonzero(neighbours >= 0)
    return {
        (int(sites[a]), int(sites[b])): float(energy)
        for a, b, energy in zip(i, neighbours[i, s], coupling[i, s], strict=True)
    }


@_promise("interaction")
def _pair_keeps_its_energy(choice: Interaction) -> None:
    """A pair of pixels keeps its energy when the contact around it changes."""
    grid = (13, 11)
    everywhere, here = list(_patches_of_sites(grid))[:2]
    all_pairs, some = _pairs(choice, grid, everywhere, 3), _pairs(choice, grid, here, 3)
    _require(all_pairs and some, "no site has a neighbour on a full 13x11 grid")
    chosen = set(here.tolist())
    expected = {pair: energy for pair, energy in all_pairs.items() if chosen.issuperset(pair)}
    _require(some == expected, "pairs or their energies changed when other sites were taken away")


@_promise("interaction")
def _coupling_follows_its_seed(choice: Interaction) -> None:
    grid, sites = (13, 11), np.arange(143, dtype=np.int64)
    _seeds_are_harmless(lambda seed: tuple(_pairs(choice, grid, sites, seed).items()), "coupling")


# -- engines ----------------------------------------------------------------------------------------------------------

_TEMPERATURE = 300.0
_NU = 1e13


def _barrier(rate: float) -> float:
    """The barrier (eV) that gives ``rate`` (1/s) at 300 K."""
    return KB * _TEMPERATURE * math.log(_NU / rate)


def _independent(n: int, forming: float, breaking: float | None = None) -> ReactionLattice:
    """``n`` sites that feel nothing, with these rates (1/s)."""
    return ReactionLattice(
        pixels=(max(n, 1), 1),
        sites=np.arange(n),
        forming=np.full(n, _barrier(forming)),
        breaking=None if breaking is None else np.full(n, _barrier(breaking)),
    )


def _disordered(interacting: bool, n: int = 40) -> ReactionLattice:
    """A ring of sites with rates over five decades, coupled to the nearest two where asked."""
    rng = np.random.default_rng(7)
    fields: dict[str, Any] = {}
    if interacting:
        pair = rng.uniform(-0.05, 0.1, n)
        fields["neighbours"] = np.stack([(np.arange(n) + 1) % n, (np.arange(n) - 1) % n], axis=1)
        fields["coupling"] = np.stack([pair, np.roll(pair, 1)], axis=1)
    return ReactionLattice(
        pixels=(n, 1),
        sites=np.arange(n),
        forming=np.array([_barrier(10**x) for x in rng.uniform(-3, 2, n)]),
        breaking=np.array([_barrier(10**x) for x in rng.uniform(-3, 1, n)]),
        **fields,
    )


def _trace(history: BondHistory) -> tuple[bytes, ...]:
    parts = (history.bonds, history.formed, history.broken, history.state)
    return tuple(part.tobytes() for part in parts)


def _z(count: int, n: int, probability: float) -> float:
    return (count - n * probability) / math.sqrt(n * probability * (1 - probability))


@_promise("engine")
def _history_adds_up(choice: Engine) -> None:
    times = np.geomspace(1e-3, 1e3, 13)
    lattice = _disordered(choice.interacting)
    history = choice.run(lattice, times, temperature=_TEMPERATURE, seed=1)
    _require(isinstance(history, BondHistory), f"run() gave {type(history).__name__}")
    _require(np.array_equal(history.hold_times, times), "other hold times than asked for")
    _require(history.state.shape == lattice.sites.shape, f"state of {history.state.shape}")
    _require(history.bonds[-1] == history.state.sum(), "the last count is not that of the final state")
    _require(np.array_equal(history.bonds, history.formed - history.broken), "bonds are not formed less broken")
    _require((np.diff(history.formed) >= 0).all() and (np.diff(history.broken) >= 0).all(), "events were taken back")
    _require(history.events > 0, "nothing happened in 1000 s at rates up to 100 per second")
    _require(history.time == times[-1] and history.temperature == _TEMPERATURE, "wrong time or temperature")
    # an engine that chooses among others says which one it took
    known = {choice.kind, *registry.current().kinds("engine")}
    _require(history.engine in known, f"engine is {history.engine!r}, neither {choice.kind!r} nor an installed one")


@_promise("engine")
def _engine_cost_is_estimated(choice: Engine) -> None:
    for sites in (0.0, 1.0, 1e7):
        said = choice.expected(sites, choice.interacting)
        _estimates(f"expected({sites})", said, {"cpu_seconds": math.inf, "bytes": math.inf})


@_promise("engine")
def _run_follows_its_seed(choice: Engine) -> None:
    lattice = _disordered(choice.interacting, 400)

    def draw(seed: Any) -> tuple[bytes, ...]:
        return _trace(choice.run(lattice, [0.1, 1, 10], temperature=300, seed=seed))

    _seeds_are_harmless(draw, "run", chance=True)


@_promise("engine")
def _no_sites_is_no_bonds(choice: Engine) -> None:
    graphs: list[dict[str, Any]] = [{}]
    if choice.interacting:
        graphs += [{"neighbours": np.empty((0, k), np.int32), "coupling": np.empty((0, k))} for k in (0, 8)]
    for graph in graphs:
        for breaking in (None, np.empty(0)):
            none = np.empty(0, np.int64)
            empty = ReactionLattice(pixels=(3, 3), sites=none, forming=np.empty(0), breaking=breaking, **graph)
            history = choice.run(empty, [0, 1e5], temperature=300)
            _require(history.bonds.tolist() == [0, 0] and history.events == 0, f"{history.bonds} bonds without sites")


@_promise("engine")
def _one_site_is_the_closed_form(choice: Engine) -> None:
    """θ(t) = k_f/(k_f + k_b) (1 − exp(−(k_f + k_b) t)): one site with many seeds, and many sites with one."""
    if not choice.exact:
        return
    forming, breaking = 2.0, 0.7
    times = np.array([0.02, 0.3, 1.0, 6.0])
    expected = forming / (forming + breaking) * (1 - np.exp(-(forming + breaking) * times))
    one, runs = _independent(1, forming, breaking), 400
    single = np.sum([choice.run(one, times, temperature=300, seed=seed).bonds for seed in range(runs)], axis=0)
    n = 20000
    many = choice.run(_independent(n, forming, breaking), times, temperature=300, seed=11).bonds
    for t, theta, few, lot in zip(times, expected, single, many, strict=True):
        for count, of in ((int(few), runs), (int(lot), n)):
            _require(abs(_z(count, of, theta)) < 4.5, f"{count} of {of} bonded after {t} s; expected {of * theta:.1f}")


@_promise("engine")
def _barrierless_is_the_attempt_frequency(choice: Engine) -> None:
    """A barrier at or below zero means the rate ν, however far below."""
    if not choice.exact:
        return
    n, times = 5000, np.array([2e-14, 1e-13])
    for energy in (0.0, -0.3, -50.0):
        lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=np.full(n, energy))
        bonds = choice.run(lattice, times, temperature=300, seed=2).bonds
        for t, count in zip(times, bonds, strict=True):
            theta = 1 - math.exp(-_NU * t)
            said = f"{count} of {n} sites bonded over {energy} eV; expected {n * theta:.0f}"
            _require(abs(_z(int(count), n, theta)) < 4.5, said)


@_promise("engine")
def _bonds_last_without_breaking(choice: Engine) -> None:
    n, forming = 5000, 1.0
    times = np.array([0.1, 1.0, 1.0, 2.0, 50.0])
    history = choice.run(_independent(n, forming), times, temperature=300, seed=5)
    _require((history.broken == 0).all(), f"{history.broken[-1]} bonds broke on a lattice without breaking")
    _require((np.diff(history.bonds) >= 0).all(), f"bonds {history.bonds}")
    _require(history.bonds[-1] == n, f"{history.bonds[-1]} of {n} bonded after fifty times the mean time")
    if choice.exact:
        z = _z(int(history.bonds[1]), n, 1 - math.exp(-forming))
        _require(abs(z) < 4.5, f"{history.bonds[1]} of {n} bonded after the mean time")


@_promise("engine")
def _nothing_happens_at_rate_zero(choice: Engine) -> None:
    """Total rate 0 is a state that lasts, not an error; so is a rate that underflows."""
    n = 7
    for energy in (25.0, 1e4):
        lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=np.full(n, energy))
        history = choice.run(lattice, [0, 1, 1e5], temperature=300)
        _require(history.events == 0 and history.time == 1e5, f"{history.events} events over {energy} eV")
    full = choice.run(_independent(n, 1.0), [1, 1e5], temperature=300, start=np.ones(n, bool))
    _require(full.bonds.tolist() == [n, n] and full.events == 0, "all bonded, nothing breaks, yet it changed")


@_promise("engine")
def _hold_times_may_coincide(choice: Engine) -> None:
    """Time 0 has no bonds; a hold time given twice is answered twice, and the rest stays as it was."""
    lattice = _disordered(choice.interacting)
    once = choice.run(lattice, [0.5, 20], temperature=300, seed=3)
    twice = choice.run(lattice, [0.5, 0.5, 20, 20], temperature=300, seed=3)
    _require(twice.bonds.tolist() == np.repeat(once.bonds, 2).tolist(), f"{twice.bonds} where once gave {once.bonds}")
    _require(np.array_equal(once.state, twice.state), "the final state depends on asking twice")
    at_zero = choice.run(lattice, [0, 0, 20], temperature=300, seed=3)
    _require(at_zero.bonds[:2].tolist() == [0, 0], f"{at_zero.bonds[0]} bonds at time 0")
    only = choice.run(lattice, [0.0], temperature=300, seed=3)
    _require(only.bonds.tolist() == [0] and only.events == 0 and only.time == 0, f"{only.events} events in no time")


@_promise("engine")
def _start_is_taken(choice: Engine) -> None:
    lattice = _disordered(choice.interacting)
    start = np.arange(lattice.sites.size) % 3 == 0
    history = choice.run(lattice, [0, 100], temperature=300, seed=4, start=start)
    _require(history.bonds[0] == start.sum(), f"{history.bonds[0]} bonds at time 0, started with {start.sum()}")
    gained = history.formed - history.broken
    _require(np.array_equal(history.bonds, start.sum() + gained), "bonds are not those at the start plus those formed")
    for wrong in (start[:-1], start.astype(int), np.ones((2, 2), bool)):
        _refuses("a wrong start", lambda wrong=wrong: choice.run(lattice, [1], temperature=300, start=wrong))


@_promise("engine")
def _restart_is_exact(choice: Engine) -> None:
    """Going on from any hold time equals the uninterrupted run bit for bit."""
    if not choice.restart:
        return
    times = np.array([0.0, 1e-3, 0.1, 0.1, 1.0, 30.0, 1e3])
    for lattice in (_disordered(choice.interacting), _disordered(False), _independent(30, 1.0)):
        whole = choice.run(lattice, times, temperature=300, seed=6)
        for cut in range(1, times.size):
            first = choice.run(lattice, times[:cut], temperature=300, seed=6)
            kept = pickle.loads(pickle.dumps(first))  # a history goes on after it was stored, too
            rest = choice.run(lattice, times[cut:], temperature=300, seed=6, start=kept)
            for name in ("bonds", "formed", "broken"):
                mine = np.concatenate([getattr(first, name), getattr(rest, name)])
                its = getattr(whole, name)
                _require(np.array_equal(mine, its), f"cut at {times[cut - 1]} s: {name} {mine}, uninterrupted {its}")
            _require(np.array_equal(rest.state, whole.state), f"cut at {times[cut - 1]} s: another final state")
            _require(rest.time == whole.time, "another time")
    half = choice.run(lattice, [1.0], temperature=300, seed=6)
    _refuses("going back", lambda: choice.run(lattice, [0.5], temperature=300, seed=6, start=half))
    other = _independent(31, 1.0)
    _refuses("another lattice", lambda: choice.run(other, [2.0], temperature=300, seed=6, start=half))


@_promise("engine")
def _threads_change_nothing(choice: Engine) -> None:
    """The same bytes on one thread and on all, alone and beside other runs."""
    import numba

    lattice = _disordered(choice.interacting, 300)

    def run(seed: int) -> tuple[bytes, ...]:
        return _trace(choice.run(lattice, [0.1, 10.0], temperature=300, seed=seed))

    alone = [run(seed) for seed in range(6)]
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        _require([run(seed) for seed in range(6)] == alone, "one thread gave another result than several")
    finally:
        numba.set_num_threads(threads)
    if not choice.threads:
        with ThreadPoolExecutor(3) as pool:
            beside = list(pool.map(run, range(6)))
        _require(beside == alone, "runs side by side gave other results than one after the other")


@_promise("engine")
def _speed_does_not_change_the_run(choice: Engine) -> None:
    """Options named in ``speed_only``, such as a number of threads, change no bond."""
    rng = np.random.default_rng(9)
    pieces = [_disordered(choice.interacting, n) for n in (120, 7, 60, 3, 90)]
    # several rings that do not touch, so that an engine has something to share between threads
    graph: dict[str, Any] = {}
    if choice.interacting:
        starts = np.cumsum([0, *(piece.sites.size for piece in pieces)])
        rings = [(piece.neighbours, piece.coupling, start) for piece, start in zip(pieces, starts, strict=False)]
        graph["neighbours"] = np.concatenate([near + start for near, _, start in rings if near is not None])
        graph["coupling"] = np.concatenate([energy for _, energy, _ in rings if energy is not None])
    forming = np.concatenate([piece.forming for piece in pieces])
    breaking = np.concatenate([piece.breaking for piece in pieces if piece.breaking is not None])
    order = rng.permutation(forming.size)
    for fields in ({}, graph):
        lattice = ReactionLattice(
            pixels=(forming.size, 1),
            sites=np.arange(forming.size),
            forming=forming[order],
            breaking=breaking[order],
            **fields,
        )
        plain = _trace(choice.run(lattice, [0.1, 10.0], temperature=300, seed=1))
        for what, variant in _speed_variants(choice):
            trace = _trace(variant.run(lattice, [0.1, 10.0], temperature=300, seed=1))
            _require(trace == plain, f"{what}: another result")


@_promise("engine")
def _coupled_sites_are_refused_or_right(choice: Engine) -> None:
    """Four mutually coupled sites against their master equation, 16 states, by χ²; or an InputError that says so."""
    rng = np.random.default_rng(8)
    pair = np.triu(rng.uniform(-0.02, 0.06, (4, 4)), 1)
    pair += pair.T
    forming = np.array([_barrier(k) for k in (3.0, 1.0, 0.6, 2.0)])
    breaking = np.array([_barrier(k) for k in (0.5, 1.5, 0.2, 0.9)])
    copies = 3000
    others = np.array([[j for j in range(4) if j != i] for i in range(4)])
    lattice = ReactionLattice(
        pixels=(copies, 4),
        sites=np.arange(4 * copies),
        forming=np.tile(forming, copies),
        breaking=np.tile(breaking, copies),
        neighbours=(others + 4 * np.arange(copies)[:, None, None]).reshape(-1, 3),
        coupling=np.tile(np.take_along_axis(pair, others, axis=1), (copies, 1)),
    )
    if not choice.interacting:
        message = _refuses("a lattice whose sites interact", lambda: choice.run(lattice, [1.0], temperature=300))
        _require(choice.kind in message, f"the refusal does not name the engine: {message}")
        return
    if not choice.exact:
        return
    from scipy.linalg import expm
    from scipy.stats import chi2

    generator = np.zeros((16, 16))
    for state in range(16):
        bonded = np.array([state >> i & 1 for i in range(4)], dtype=bool)
        for i in range(4):
            energy = breaking[i] if bonded[i] else forming[i] + pair[i][bonded].sum()
            rate = _NU * math.exp(-max(energy, 0.0) / (KB * _TEMPERATURE))
            generator[state ^ 1 << i, state] += rate
            generator[state, state] -= rate
    for t in (0.15, 0.8, 20.0):
        expected = copies * expm(generator * t)[:, 0]
        history = choice.run(lattice, [t / 2, t], temperature=300, seed=int(100 * t))
        state = history.state.reshape(copies, 4) @ (1 << np.arange(4))
        seen = np.bincount(state, minlength=16)
        # states too rare for χ² are counted together
        rare = expected < 8
        e, o = np.append(expected[~rare], expected[rare].sum()), np.append(seen[~rare], seen[rare].sum())
        e, o = e[e > 0], o[e > 0]
        statistic = float(np.sum((o - e) ** 2 / e))
        chance = float(chi2.sf(statistic, e.size - 1))
        _require(chance > _CHANCE, f"after {t} s, states {seen.tolist()}; master equation {expected.round(1).tolist()}")


@_promise("engine")
def _wrong_input_is_refused(choice: Engine) -> None:
    lattice = _disordered(False, 5)
    for times in ([], [2, 1], [-1], [math.nan], [math.inf], ["soon"], [[1, 2]]):
        _refuses(f"hold times {times}", lambda times=times: choice.run(lattice, times, temperature=300))  # pyright: ignore
    for kelvin in (0, -3, math.nan, math.inf, "3 eV", "300"):
        _refuses(f"temperature {kelvin!r}", lambda kelvin=kelvin: choice.run(lattice, [1], temperature=kelvin))
    for seed in (-1, 0.5, "x"):
        _refuses(f"seed {seed!r}", lambda seed=seed: choice.run(lattice, [1], temperature=300, seed=seed))  # pyright: ignore
    warm = choice.run(lattice, [1.0], temperature="26.85 degC", seed=1)
    _require(_trace(warm) == _trace(choice.run(lattice, [1.0], temperature=300, seed=1)), "26.85 degC is not 300 K")


# -- observables ------------------------------------------------------------------------------------------------------


def _replica(n: int, bonded: int) -> tuple[ContactSolution, ReactionLattice, BondHistory]:
    """A finished replica by hand: ``n`` sites on an 8x8 grid, ``bonded`` of them."""
    pressure = np.zeros(64)
    pressure[:n] = np.linspace(0.5, 2.0, n) if n else 0
    contact = ContactSolution(
        pressure=pressure.reshape(8, 8), load=float(pressure.sum()) * 0.25, pixel_size=0.5, modulus=35.3
    )
    lattice = ReactionLattice(
        pixels=(8, 8),
        sites=np.arange(n),
        forming=np.linspace(0.8, 1.4, n),
        breaking=np.full(n, 1.1),
        pixel_size=0.5,
    )
    counts = np.array([0, bonded])
    history = BondHistory(
        hold_times=np.array([0.0, 10.0]),
        bonds=counts,
        formed=counts,
        broken=np.zeros(2, np.int64),
        state=np.arange(n) < bonded,
        time=10.0,
        temperature=300.0,
        engine="by-hand",
        lattice_hash=lattice.digest(),
    )
    return contact, lattice, history


@_promise("observable")
def _observes_numbers(choice: Observable) -> None:
    """Names and shapes are those of every other replica, bonded or not, with sites or without; the same each time."""
    shapes = {}
    for n, bonded in ((40, 0), (40, 17), (40, 40), (1, 1), (0, 0)):
        replica = _replica(n, bonded)
        seen = choice.measure(*replica)
        _require(isinstance(seen, Mapping) and seen, f"measure() gave {seen!r}; expected names with numbers")
        _require(all(isinstance(name, str) for name in seen), f"names {list(seen)} are not all str")
        values = {name: np.asarray(value) for name, value in seen.items()}
        kinds = {name: value.dtype.kind for name, value in values.items()}
        _require(set(kinds.values()) <= set("fiub"), f"not numbers: {kinds}")
        again = {name: np.asarray(value).tobytes() for name, value in choice.measure(*replica).items()}
        _require(again == {name: value.tobytes() for name, value in values.items()}, "another answer the second time")
        shapes[n, bonded] = {name: value.shape for name, value in values.items()}
    first = next(iter(shapes.values()))
    for (n, bonded), shape in shapes.items():
        _require(shape == first, f"{bonded} of {n} sites bonded: {shape}, expected {first} as for the others")


# -- readers ----------------------------------------------------------------------------------------------------------


@_promise("reader")
def _suffixes_are_named(choice: Reader) -> None:
    suffixes = type(choice).suffixes
    _require(isinstance(suffixes, tuple) and suffixes, f"suffixes = {suffixes!r}: name the endings it answers to")
    _require(all(s.startswith(".") and s == s.lower() for s in suffixes), f"{suffixes}: lower case, with the dot")


@_promise("reader")
def _bad_files_are_refused(choice: Reader, path: Any = None) -> None:
    """A missing, empty, foreign or truncated file is an error that names the file, never another exception."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        suffix = type(choice).suffixes[0]
        files = {"missing": folder / f"missing{suffix}", "folder": folder}
        contents = {"empty": b"", "foreign": b"\x89not this format at all\r\n\x1a\n\x00" * 20}
        if path is not None:
            good = Path(path).read_bytes()
            contents["truncated"] = good[: len(good) // 2]
            suffix = Path(path).suffix
        for label, content in contents.items():
            files[label] = folder / f"{label}{suffix}"
            files[label].write_bytes(content)
        for label, file in files.items():
            message = _refuses(f"a {label} file", lambda file=file: choice.read(file), ChemageError)
            _require(file.name in message, f"a {label} file: the message does not name it: {message}")


@_promise("reader")
def _reads_its_file(choice: Reader, path: Any = None) -> None:
    if path is None:
        return
    first, second = choice.read(path), choice.read(str(path))
    _require(first is not None, "read() gave None")
    if isinstance(first, Record):
        _require(first == second, "reading the file twice, as Path and as str, gave two different objects")
