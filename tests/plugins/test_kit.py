"""The kit finds what is wrong: for every promise there is a choice that breaks it, and the check says so."""

from __future__ import annotations

import ast
import math
import threading
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import Field

import chemage as ca
from chemage import random, testing
from chemage.errors import InputError, StoreError
from chemage.objects import BondHistory, ContactSolution, Record, Surface
from chemage.spec import Barriers, ContactSolver, Interaction, Observable, Reader, Spec, SurfaceMaker, checked_seed
from chemage.units import Energy, Pressure

# -- choices that keep every promise ----------------------------------------------------------------------------------


class Flat(Barriers):
    """Any barrier between two energies is as likely."""

    kind = "flat"
    cite: ClassVar[tuple[str, ...]] = ("Nobody (2000)",)

    low: Energy = 0.8
    """lower end, eV"""
    high: Energy = 1.4
    """upper end, eV"""

    def quantile(self, uniform):
        return self.low + (self.high - self.low) * uniform

    def density(self, energy):
        return np.where((energy >= self.low) & (energy <= self.high), 1 / (self.high - self.low), 0.0)


class White(SurfaceMaker):
    """White noise."""

    kind = "white"

    def make(self, seed=0):
        if not isinstance(seed, np.random.SeedSequence):
            checked_seed(seed)
        heights = random.uniforms(seed, 300, np.arange(64).reshape(8, 8))
        return Surface(heights=heights, pixel_size=1.0, provenance=self.todict())


class Chain(Interaction):
    """Each pixel feels the next in its row."""

    kind = "chain"

    def neighbours(self, pixels, periodic, sites):
        found = np.full((sites.size, 2), -1, np.int32)
        place = {int(site): i for i, site in enumerate(sites)}
        ny = pixels[1]
        for i, site in enumerate(sites.tolist()):
            x, y = divmod(site, ny)
            around = []
            for step in (-1, 1):
                other = y + step
                if (periodic or 0 <= other < ny) and other % ny != y and other % ny not in around:
                    around.append(other % ny)
            for slot, other in enumerate(around):
                found[i, slot] = place.get(x * ny + other, -1)
        return found

    def coupling(self, sites, neighbours, seed):
        there = neighbours >= 0
        mine = np.broadcast_to(sites[:, None], neighbours.shape)
        other = sites[np.where(there, neighbours, 0)] if sites.size else mine
        return np.where(there, 0.1 * random.pair_uniforms(seed, 301, mine, other), 0.0)


class Count(Observable):
    """How many bonds."""

    kind = "count"

    def measure(self, contact, lattice, history):
        return {"bonded": float(history.bonds[-1])}


class Csv(Reader):
    """Comma-separated heights."""

    kind = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def read(self, path):
        try:
            heights = np.loadtxt(path, delimiter=",", ndmin=2)
            if heights.size < 2:
                raise ValueError("empty")
        except (OSError, ValueError, UserWarning) as error:
            raise StoreError(f"{path}: {error}") from None
        return Surface(heights=heights, pixel_size=1.0)


class Bed(ContactSolver):
    """A bed of springs (Winkler): the pressure is the overlap times a stiffness."""

    kind = "bed"

    modulus: Pressure = 10.0
    """GPa"""

    def _solve(self, surface, load, start):
        heights = np.sort(surface.heights.ravel())[::-1].astype(float)
        size = surface.pixel_size
        stiffness = self.modulus / (size * max(surface.shape))
        if load == 0:
            level = heights[0]
        else:
            # force at the level of each pixel, then the level within the right interval
            count = np.arange(1, heights.size + 1)
            force = stiffness * size**2 * (np.cumsum(heights) - count * heights)
            n = int(np.searchsorted(force, load))
            level = (np.sum(heights[:n]) - load / (stiffness * size**2)) / n
        pressure = stiffness * np.maximum(surface.heights - level, 0)
        if load > 0:
            pressure *= load / (pressure.sum() * size**2)
        return ContactSolution(
            pressure=pressure,
            load=load,
            pixel_size=size,
            modulus=self.modulus,
            periodic=surface.periodic,
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            provenance=self.todict(),
        )


REFERENCES: list[Spec] = [Flat(), White(), Chain(), Count(), Csv(), Bed()]


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "map.csv"
    np.savetxt(path, testing.rough_surface((6, 5)).heights, delimiter=",")
    return path


@testing.parametrize_with_checks(REFERENCES)
def test_a_right_choice_passes(choice, check):
    check(choice)


def test_the_whole_role_at_once(csv):
    testing.check_barriers(Flat())
    testing.check_surface_maker(White())
    testing.check_interaction(Chain())
    testing.check_observable(Count())
    testing.check_reader(Csv(), path=csv)
    testing.check_contact_solver(Bed(), force_tolerance=1e-9)
    with pytest.raises(InputError, match=r"not a chemage\.spec\.Engine"):
        testing.check_engine(Flat())  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="barriers checks take no path"):
        testing.checks_for(Flat(), path=csv)
    with pytest.raises(InputError, match="is of no role"):
        testing.checks_for(ca.chemistry(forming=Flat()))


# -- one that breaks each ---------------------------------------------------------------------------------------------


def broken(base: type[Spec], **changes: Any) -> Any:
    """``base`` with some attributes or methods replaced."""
    return type(f"Broken{base.__name__}", (base,), {"__module__": __name__, "__doc__": base.__doc__, **changes})


def failing(choice: Spec, name: str, **inputs: Any) -> str:
    """The message of check ``name``, which must fail."""
    (check,) = [one for one in testing.checks_for(choice, **inputs) if one.name == name]
    with pytest.raises(AssertionError) as caught:
        check(choice)
    return str(caught.value)


class Bare(Flat):
    note: str = ""
    loose: float = 1.0
    """takes nan"""


class Listed(Flat):
    numbers: list[float] = Field(default=[1.0])
    """a list has no hash"""


class Thawed(Flat):
    model_config: ClassVar[Any] = {"frozen": False}


class Stubborn(Flat):
    def replace(self, **changes):
        return Stubborn(low=0.1)


class Rejecting(Flat):
    """Says no without saying to what."""

    def __init__(self, **options):
        if options:
            raise InputError("no")
        super().__init__()


@pytest.mark.parametrize(
    ("choice", "check", "said"),
    [
        (broken(Flat, kind="")(), "has_kind_and_role", "kind is empty"),
        (broken(Flat, kind="Flat Out")(), "has_kind_and_role", "lower-case"),
        (broken(Flat, __doc__=" ")(), "has_kind_and_role", "no docstring"),
        (broken(Flat, cite="Hertz (1881)")(), "citations_are_strings", "is a str"),
        (broken(Flat, cite=(1881,))(), "citations_are_strings", "non-empty str"),
        (Bare(), "options_are_described", "'note' has no description"),
        (broken(Flat, speed_only=("threads",))(), "speed_only_names_options", "names threads"),
        (Thawed(), "options_are_frozen", "can be set"),
        (Bare(), "wrong_options_are_refused", "loose = nan"),
        (Rejecting(), "wrong_options_are_refused", "does not name it"),
        (broken(Flat, todict=lambda self: {"kind": "flat", "low": self})(), "options_go_round", "not plain JSON"),
        (broken(Flat, todict=lambda self: {"low": 0.8})(), "options_go_round", "kind None"),
        (Stubborn(), "options_go_round", "replace() gave"),
        (Listed(), "options_go_round", "unhashable"),
        (broken(Flat)(), "options_go_round", "pickle: PicklingError"),
    ],
)
def test_what_every_choice_owes(choice, check, said):
    assert said in failing(choice, check)


_calls = iter(range(10**9))


def _surface(heights: Any, **fields: Any) -> Surface:
    return Surface(heights=heights, pixel_size=1.0, **{"provenance": {"by": "hand"}, **fields})


@pytest.mark.parametrize(
    ("make", "check", "said"),
    [
        (lambda self, seed=0: np.ones((2, 2)), "makes_a_surface", "gave ndarray"),
        (lambda self, seed=0: _surface(np.ones((2, 2)), provenance={}), "makes_a_surface", "provenance is empty"),
        (lambda self, seed=0: _surface(np.ones((2, 2)), provenance={"n": (1,)}), "makes_a_surface", "tuple"),
        (lambda self, seed=0: _surface(np.ones((2, 2)), provenance={"n": math.nan}), "makes_a_surface", "JSON"),
        (lambda self, seed=7: _surface(np.full((2, 2), float(seed))), "makes_a_surface", "not make(0)"),
        (lambda self, seed=0: _surface([[float(next(_calls))]]), "surface_follows_its_seed", "same seed gave two"),
        (lambda self, seed=0: _surface([[seed == 1]]), "surface_follows_its_seed", "2 different results"),
        (
            lambda self, seed=0: _surface(np.random.default_rng(_spawned(seed)).random((2, 2))),
            "surface_follows_its_seed",
            "spawned from the SeedSequence",
        ),
        (
            lambda self, seed=0: _surface(np.random.default_rng(_entropy(seed)).random((2, 2))),
            "surface_follows_its_seed",
            "two children",
        ),
        (
            lambda self, seed=0: _surface([[np.random.rand() * 0]]),  # noqa: NPY002
            "surface_follows_its_seed",
            "global random state",
        ),
        (
            lambda self, seed=0: _surface(random.uniforms(seed, 300, np.arange(9).reshape(3, 3))),
            "surface_follows_its_seed",
            "make(-1): raised ValueError",
        ),
    ],
)
def test_surfaces(make, check, said):
    assert said in failing(broken(White, make=make)(), check)


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        (None, "expected a dict"),
        ({"nx": 9.0}, "expected() says nx = 9.0, the surface has 8"),
        ({"pixel_size": 2.0}, "says pixel_size = 2.0"),
        ({"rms_slope": 0.01}, "says rms_slope = 0.01"),
        ({"rms_slope": math.nan}, "rms_slope = nan"),
        ({"slope": 0.01}, "gives 'slope'; known are nx, ny"),
    ],
)
def test_what_surfaces_say_beforehand(said, problem):
    assert problem in failing(broken(White, expected=lambda self: said)(), "surface_is_as_expected")


@pytest.mark.parametrize("said", [{"area_fraction": 1.5}, {"cpu_seconds": -1.0}, {"bytes": math.inf}, {"area": 0.1}])
def test_what_solvers_say_beforehand(said):
    wrong = broken(Bed, expected=lambda self, surface, load: said)()
    assert next(iter(said)) in failing(wrong, "contact_cost_is_estimated")


@pytest.mark.parametrize("said", [{"cpu_seconds": -1.0}, {"bytes": math.nan}, {"events": 0.1}])
def test_what_engines_say_beforehand(said):
    wrong = mutant(expected=lambda self, sites, interacting: said)
    assert next(iter(said)) in failing(wrong, "engine_cost_is_estimated")


def _spawned(seed: Any) -> Any:
    return seed.spawn(1)[0] if isinstance(seed, np.random.SeedSequence) else seed


def _entropy(seed: Any) -> Any:
    return seed.entropy if isinstance(seed, np.random.SeedSequence) else seed


def _changed(solution: Record, **changes: Any) -> Any:
    return type(solution).fromdict({**solution.todict(), **changes})


def _with(**changes: Any) -> Any:
    return lambda solution, *given: _changed(solution, **{name: f(solution) for name, f in changes.items()})


def _bed(change: Any) -> Any:
    def _solve(self, surface, load, start):
        return change(Bed._solve(self, surface, load, start), surface, start)

    return broken(Bed, _solve=_solve)()


@pytest.mark.parametrize(
    ("choice", "check", "said"),
    [
        (_bed(lambda s, surface, start: s.pressure), "contact_carries_the_load", "gave ndarray"),
        (_bed(_with(load=lambda s: 2 * s.load)), "contact_carries_the_load", "the solution says"),
        (_bed(_with(pressure=lambda s: s.pressure * 1.001)), "contact_carries_the_load", "adds up"),
        (
            _bed(_with(pressure=lambda s: np.full(s.shape, s.load / s.nominal_area))),
            "contact_carries_the_load",
            "expected some contact",
        ),
        (_bed(_with(pixel_size=lambda s: 9.0)), "solution_describes_itself", "pixel_size is 9.0"),
        (_bed(_with(periodic=lambda s: False)), "solution_describes_itself", "periodic is False"),
        (_bed(_with(rms_slope=lambda s: math.nan)), "solution_describes_itself", "rms_slope"),
        (_bed(_with(converged=lambda s: False)), "solution_describes_itself", "did not converge"),
        (_bed(_with(provenance=lambda s: {})), "solution_describes_itself", "provenance is empty"),
        (broken(Bed, implemented_properties=("gap",))(), "solution_describes_itself", "implements 'gap'"),
        (_bed(_with(gap=lambda s: np.full(s.shape, -1.0))), "gap_is_closed_in_contact", "overlap by 1 nm"),
        (
            _bed(_with(gap=lambda s: np.full(s.shape, 1.0))),
            "gap_is_closed_in_contact",
            "where the pressure is positive",
        ),
        (
            _bed(_with(pressure=lambda s: s.pressure + 1e-9)),
            "no_load_is_no_contact",
            "pixels in contact at load 0",
        ),
        (
            broken(Bed, solve=lambda self, surface, load, start=None: self._solve(surface, abs(float(load)), start))(),
            "wrong_load_is_refused",
            "load -1.0: gave",
        ),
        (
            _bed(lambda s, surface, start: _changed(s, pressure=s.pressure * (1 + 1e-9 * next(_calls)))),
            "contact_is_deterministic",
            "different pressures",
        ),
        (
            _bed(lambda s, surface, start: _changed(s, pressure=s.pressure * (1 + (s.modulus > 10)))),
            "contact_scales",
            "twice modulus",
        ),
        (
            _bed(lambda s, surface, start: _changed(s, pressure=s.pressure * surface.pixel_size)),
            "contact_scales",
            "three times the size",
        ),
        (
            _bed(lambda s, surface, start: _changed(s, pressure=s.pressure * (1 + 0.1 * (surface.heights.max() > 3)))),
            "contact_scales",
            "raised by 5 nm",
        ),
        (
            _bed(_with(pressure=lambda s: s.pressure * (s.pressure > 0.3))),
            "contact_grows_with_load",
            "rising load",
        ),
        (
            _bed(lambda s, surface, start: s if start is None else _changed(s, pressure=start.pressure)),
            "start_changes_nothing",
            "another solution",
        ),
        (_bed(_with(pressure=lambda s: s.pressure.T)), "odd_grids_are_solved", "a solution of"),
    ],
)
def test_contact_solvers(choice, check, said):
    assert said in failing(choice, check)


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        ({"quantile": lambda self, u: 1 - u}, "quantile_is_monotone", "falls"),
        ({"quantile": lambda self, u: np.tan(np.pi * (u - 0.5)) / (u > 1e-9)}, "quantile_is_monotone", ""),
        ({"quantile": lambda self, u: u.astype(np.float32)}, "quantile_is_monotone", "float32"),
        ({"quantile": lambda self, u: np.sort(u)}, "barrier_is_the_pixels_own", "what else was asked"),
        ({"quantile": lambda self, u: u + next(_calls)}, "barrier_is_the_pixels_own", "two calls"),
        ({"quantile": lambda self, u: (0.8 + 0.6 * u).ravel()}, "barrier_is_the_pixels_own", "shape"),
        ({"density": lambda self, e: Flat.density(self, e) * 1.02}, "density_agrees_with_quantile", "adds up to"),
        ({"density": lambda self, e: np.full(e.shape, 1 / 0.6)}, "density_agrees_with_quantile", "thousand eV"),
        ({"density": lambda self, e: -Flat.density(self, e)}, "density_agrees_with_quantile", "density between"),
        ({"density": lambda self, e: np.array([1.0])}, "density_agrees_with_quantile", "shape"),
        ({"quantile": lambda self, u: np.ones(u.shape)}, "density_agrees_with_quantile", "point mass"),
    ],
)
def test_barriers(change, check, said):
    choice = broken(Flat, **change)()
    if said:
        assert said in failing(choice, check)
    else:
        (one,) = [one for one in testing.checks_for(choice) if one.name == check]
        with pytest.raises((AssertionError, RuntimeWarning)):
            one(choice)


def _graph(change: Any) -> Any:
    return {"neighbours": lambda self, *grid: change(Chain.neighbours(self, *grid), *grid)}


def _coupling(change: Any) -> Any:
    return {"coupling": lambda self, *given: change(Chain.coupling(self, *given), *given)}


def _self_listed(graph, pixels, periodic, sites):
    graph = graph.copy()
    graph[:1, 0] = 0
    return graph


def _one_sided(graph, pixels, periodic, sites):
    graph = graph.copy()
    graph[:1] = -1
    return graph


def _directed(energy, sites, neighbours, seed):
    return np.where(neighbours >= 0, energy + 1e-3 * np.arange(sites.size)[:, None], 0.0)


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        (_graph(lambda graph, *grid: graph.astype(np.int64)), "graph_is_sound", "int64"),
        (_graph(lambda graph, *grid: graph.ravel()), "graph_is_sound", "1x1"),
        (_graph(_self_listed), "graph_is_sound", "its own neighbour"),
        (_graph(_one_sided), "graph_is_sound", "not the other way round"),
        (_graph(lambda graph, *grid: np.hstack([graph, graph])), "graph_is_sound", "listed twice"),
        (_coupling(_directed), "graph_is_sound", "two values"),
        (_coupling(lambda energy, *given: energy + 0.1), "graph_is_sound", "where there is no neighbour"),
        (_coupling(lambda energy, *given: energy[:, :1]), "graph_is_sound", "coupling"),
        (
            _coupling(lambda energy, sites, *given: energy * (1 + sites.size)),
            "pair_keeps_its_energy",
            "other sites were taken away",
        ),
        (_graph(lambda graph, *grid: np.full_like(graph, -1)), "pair_keeps_its_energy", "no site has a neighbour"),
        (_coupling(lambda energy, *given: energy * next(_calls)), "coupling_follows_its_seed", "same seed"),
    ],
)
def test_interactions(change, check, said):
    assert said in failing(broken(Chain, **change)(), check)


@pytest.mark.parametrize(
    ("measure", "said"),
    [
        (lambda self, contact, lattice, history: {}, "expected names"),
        (lambda self, contact, lattice, history: {1: 2.0}, "not all str"),
        (lambda self, contact, lattice, history: {"state": history.state}, "expected"),
        (lambda self, contact, lattice, history: {"name": "many"}, "not numbers"),
        (lambda self, contact, lattice, history: {"calls": next(_calls)}, "second time"),
        (lambda self, contact, lattice, history: {f"b{history.bonds[-1]}": 1.0}, "as for the others"),
    ],
)
def test_observables(measure, said):
    assert said in failing(broken(Count, measure=measure)(), "observes_numbers")


def test_observables_divide_by_no_sites():
    careless = broken(Count, measure=lambda self, contact, lattice, history: {"mean": history.state.mean()})()
    (check,) = [one for one in testing.checks_for(careless) if one.name == "observes_numbers"]
    with pytest.raises(RuntimeWarning, match="empty slice"):
        check(careless)


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        ({"suffixes": ()}, "suffixes_are_named", "name the endings"),
        ({"suffixes": ("csv",)}, "suffixes_are_named", "with the dot"),
        ({"read": lambda self, path: np.loadtxt(path)}, "bad_files_are_refused", "a missing file: raised FileNotFound"),
        ({"read": lambda self, path: 1}, "bad_files_are_refused", "gave 1"),
        ({"read": lambda self, path: _raise(StoreError("bad"))}, "bad_files_are_refused", "does not name it"),
        ({"read": lambda self, path: None}, "reads_its_file", "gave None"),
        ({"read": lambda self, path: _surface([[float(next(_calls))]])}, "reads_its_file", "two different objects"),
    ],
)
def test_readers(change, check, said, csv):
    assert said in failing(broken(Csv, **change)(), check, path=csv)


def _raise(error: Exception) -> Any:
    raise error


# -- engines: mutants of one that is right ----------------------------------------------------------------------------


def mutant(change: Any = None, before: Any = None, **attributes: Any) -> Any:
    """The installed rejection-free engine, its result passed through ``change`` or its lattice through ``before``."""
    base = ca.engine("rejection-free").__class__

    def _run(self, lattice, hold_times, temperature, seed, start):
        given = (lattice, hold_times, temperature, seed, start)
        if before is not None:
            given = before(*given)
        history = base._run(self, *given)
        return history if change is None else change(history, *given)

    return broken(base, _run=_run, **attributes)()


def _faster(lattice, *rest):
    return _changed(lattice, forming=lattice.forming - 0.003), *rest


def _half_coupled(lattice, *rest):
    if lattice.interacting:
        lattice = _changed(lattice, coupling=lattice.coupling * 0.5)
    return lattice, *rest


def _no_breaking(lattice, *rest):
    return _changed(lattice, breaking=None), *rest


def _breaking(lattice, *rest):
    if lattice.breaking is None:
        lattice = _changed(lattice, breaking=np.full(lattice.sites.size, 0.78))
    return lattice, *rest


def _one_seed(lattice, times, temperature, seed, start):
    return lattice, times, temperature, 0, start


def _forgetful(lattice, times, temperature, seed, start):
    return lattice, times, temperature, seed, start.state if isinstance(start, BondHistory) else start


def _unstarted(lattice, times, temperature, seed, start):
    return lattice, times, temperature, seed, None if isinstance(start, np.ndarray) else start


def _crowded(history, *given):
    if threading.current_thread() is not threading.main_thread():
        return _changed(history, bonds=history.bonds + 1)
    return history


def _eager(history, lattice, times, *rest):
    return _changed(history, bonds=history.bonds + (times == 0))


def _single(history, lattice, times, *rest):
    return _changed(history, bonds=history.bonds * np.append(1, np.diff(times) > 0))


def _capped(lattice, times, temperature, seed, start):
    # a barrier far below zero is taken as it is by a careless exp
    return _changed(lattice, forming=np.maximum(lattice.forming, 0.02)), times, temperature, seed, start


def _haunted(history, lattice, times, *rest):
    return history if lattice.sites.size else _changed(history, bonds=history.bonds + 1)


def _stirred(history, lattice, times, *rest):
    if (lattice.forming > 20).all() and times[-1] > 1:
        return _changed(history, formed=history.formed + 1)
    return history


class Hasty(Bed):
    speed_only: ClassVar[tuple[str, ...]] = ("threads",)
    threads: int = 1
    """more is worse"""

    def _solve(self, surface, load, start):
        solution = super()._solve(surface, load, start)
        return _changed(solution, pressure=solution.pressure * (1 + 1e-12 * (self.threads > 1)))


def test_speed_that_changes_pressures():
    assert "threads = 2: other pressures" in failing(Hasty(), "speed_does_not_change_the_contact")


def test_speed_that_changes_bonds():
    base = ca.engine("rejection-free").__class__
    fields = {"__annotations__": {"threads_used": int}, "threads_used": 1, "speed_only": ("threads_used",)}

    def _run(self, lattice, hold_times, temperature, seed, start):
        history = base._run(self, lattice, hold_times, temperature, seed, start)
        return _changed(history, formed=history.formed + (self.threads_used > 2))

    hasty = broken(base, **fields, _run=_run)()
    assert "threads_used = 3: another result" in failing(hasty, "speed_does_not_change_the_run")


ENGINE_MUTANTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "counts too many": ("history_adds_up", "the final state", {"change": _with(bonds=lambda h: h.bonds + 1)}),
    "forgets events": ("history_adds_up", "formed less broken", {"change": _with(formed=lambda h: h.formed + 1)}),
    "names another": ("history_adds_up", "engine is 'x'", {"change": _with(engine=lambda h: "x")}),
    "stops early": ("history_adds_up", "wrong time", {"change": _with(time=lambda h: h.time / 2)}),
    "one seed for all": ("run_follows_its_seed", "gave 1 different", {"before": _one_seed}),
    "bonds without sites": ("no_sites_is_no_bonds", "bonds without sites", {"change": _haunted}),
    "0.003 eV too low": ("one_site_is_the_closed_form", "bonded after", {"before": _faster}),
    "no breaking": ("one_site_is_the_closed_form", "bonded after", {"before": _no_breaking}),
    "a floor under barriers": ("barrierless_is_the_attempt_frequency", "over 0.0 eV", {"before": _capped}),
    "breaks what lasts": ("bonds_last_without_breaking", "bonds broke", {"before": _breaking}),
    "an event at rate 0": ("nothing_happens_at_rate_zero", "1 events", {"change": _stirred}),
    "bonds at time 0": ("hold_times_may_coincide", "bonds at time 0", {"change": _eager}),
    "drops a twin": ("hold_times_may_coincide", "where once gave", {"change": _single}),
    "ignores the start": ("start_is_taken", "started with", {"before": _unstarted}),
    "goes on from the state alone": ("restart_is_exact", "cut at", {"before": _forgetful}),
    "not for threads": ("threads_change_nothing", "side by side", {"change": _crowded}),
    "half the coupling": ("coupled_sites_are_refused_or_right", "master equation", {"before": _half_coupled}),
    "refuses nothing": (
        "coupled_sites_are_refused_or_right",
        "expected InputError",
        {"interacting": False, "run": lambda self, *given, **named: None},
    ),
    "takes any time": ("wrong_input_is_refused", "expected InputError", {"run": lambda self, *given, **named: None}),
}


@pytest.mark.parametrize("name", ENGINE_MUTANTS)
def test_engines(name):
    check, said, changes = ENGINE_MUTANTS[name]
    assert said in failing(mutant(**changes), check)


def test_every_promise_is_broken_somewhere():
    """A check that no broken choice above fails is a check nobody has seen at work."""
    named = {node.value for node in ast.walk(ast.parse(Path(__file__).read_text())) if isinstance(node, ast.Constant)}
    for role in testing.ROLES:
        for check in testing.checks_for(testing.ROLES[role]):
            assert check.name in named, f"no broken choice for {check.name}"


# -- expected failures ------------------------------------------------------------------------------------------------


def test_expected_failures_carry_their_reason():
    excuse = {"has_kind_and_role": "the kind has yet to be chosen"}
    mark = testing.parametrize_with_checks([Flat()], expected_failures=excuse)
    names, cases = mark.args
    assert names == ("choice", "check")
    marked = {case.id: case.marks for case in cases if case.marks}
    assert list(marked) == ["flat0-has_kind_and_role"]
    (xfail,) = marked["flat0-has_kind_and_role"]
    assert xfail.kwargs == {"reason": excuse["has_kind_and_role"], "strict": True, "raises": AssertionError}
    same = testing.parametrize_with_checks([Flat()], expected_failures=lambda choice: excuse)
    assert [case.id for case in same.args[1]] == [case.id for case in cases]
    with pytest.raises(InputError, match="names no check of role 'barriers': has_kind"):
        testing.parametrize_with_checks([Flat()], expected_failures={"has_kind": "?"})


def test_isolated_registry_is_empty_and_in_use(isolated_registry):
    assert ca.registry.current() is isolated_registry
    assert isolated_registry.records == []
    with pytest.raises(InputError, match="installed: none"):
        ca.engine("bkl")
