"""Checks of ageing methods, observables and laws of rupture, which make or receive replicas; and replicas for them."""

from __future__ import annotations

import dataclasses
import math
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from chemage.ageing.age import age
from chemage.ageing.aging import Aging
from chemage.ageing.methods import AgedBonds, AgeingMethod, AgeingRequest
from chemage.ageing.observables import Observable
from chemage.contacts.solution import ContactSolution
from chemage.foundation import random
from chemage.foundation.checks import Seed
from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.outputs import Checker, declaration_problems
from chemage.foundation.units import EV_PER_GPA_NM3, KB, unit_registry
from chemage.friction.role import Bonded, Rupture
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.independent import TwoState
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Barriers
from chemage.testing.answers import Questions, asks
from chemage.testing.checks import calls_are_independent, check_of, refuses, require, whole


class Even(Barriers):
    """Barriers between 0.8 and 1.4 eV, for what needs some chemistry."""

    kind = "even"

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return 0.8 + 0.6 * uniform

    def density(self, energy: np.ndarray) -> np.ndarray:
        return np.where((energy >= 0.8) & (energy <= 1.4), 1 / 0.6, 0.0)


class FinishedReplica(NamedTuple):
    """What is there when the kinetics of a replica have been run."""

    contact: ContactSolution
    lattice: ReactionLattice
    history: BondHistory


def finished(
    n: int,
    bonded: int,
    *,
    grid: tuple[int, int] = (8, 8),
    times: Sequence[float] = (0.0, 10.0),
    breaking: bool = True,
    interacting: bool = True,
) -> FinishedReplica:
    """A finished replica: ``n`` sites scattered over the grid, ``bonded`` of them with a bond at the end."""
    rng = np.random.default_rng(n + 100 * grid[0])
    pixels = grid[0] * grid[1]
    touching = np.sort(rng.permutation(pixels)[: min(n + 3 * (n > 1), pixels)])
    if 1 < touching.size < pixels:
        touching[-1] = pixels - 1
    pressure = np.zeros(pixels)
    pressure[touching] = rng.uniform(0.3, 3.0, touching.size)
    contact = ContactSolution(
        pressure=pressure.reshape(grid), load=float(pressure.sum()) * 0.25, pixel_size=0.5, modulus=35.3, rms_slope=0.1
    )
    sites = touching[touching.size - n :]
    fields: dict[str, Any] = {"breaking": np.full(n, 1.1)} if breaking else {}
    if interacting:
        k = np.arange(n)
        near = np.stack([np.where(k + 1 < n, k + 1, -1), k - 1], axis=1) if n else np.empty((0, 2), int)
        fields |= {"neighbours": near.astype(np.int32), "coupling": np.where(near >= 0, 0.05, 0.0)}
    forming = rng.uniform(0.8, 1.4, n)
    lattice = ReactionLattice(pixels=grid, sites=sites, forming=forming, pixel_size=0.5, **fields)
    counts = np.linspace(0 if len(times) > 1 else bonded, bonded, len(times)).astype(np.int64)
    history = BondHistory(
        hold_times=np.array(times),
        bonds=counts,
        formed=counts,
        broken=np.zeros(len(times), np.int64),
        state=_rank(n) < bonded,
        time=times[-1],
        temperature=300.0,
        engine="by-hand",
        lattice_hash=lattice.digest(),
    )
    return FinishedReplica(contact, lattice, history)


def _rank(n: int) -> np.ndarray:
    """In which order ``n`` sites form their bonds."""
    return np.random.default_rng(n).permutation(n)


def with_states(replica: FinishedReplica) -> FinishedReplica:
    """The replica with the state of every site at every hold time: a bond that has formed stays."""
    if replica.history.states is not None:
        return replica
    states = _rank(replica.lattice.sites.size) < replica.history.bonds[:, None]
    return replica._replace(history=replica.history.model_copy(update={"states": states}))


Case = tuple[str, FinishedReplica]


def usual(times: Sequence[float] = (0.0, 10.0)) -> list[Case]:
    """Replicas with and without bonds and sites, each with what it is; the second is the plain one."""
    counts = ((40, 0), (40, 17), (40, 40), (1, 1), (0, 0))
    return [(f"{bonded} of {n} sites bonded", finished(n, bonded, times=times)) for n, bonded in counts]


def unusual(times: Sequence[float] = (0.0, 10.0)) -> list[Case]:
    """Replicas on lattices that lack a part, on grids that are not square, and at other hold times."""
    cases: list[Case] = []
    for breaking, interacting in ((False, True), (True, False), (False, False)):
        lack = [word for word, there in (("breaking", breaking), ("interaction", interacting)) if not there]
        replica = finished(40, 17, breaking=breaking, interacting=interacting, times=times)
        cases.append((f"a lattice without {' and '.join(lack)}", replica))
    for grid in ((13, 5), (5, 13)):
        cases.append((f"a grid of {grid[0]}x{grid[1]} pixels", finished(40, 17, grid=grid, times=times)))
    for others in ((10.0,), (0.0,), (1.0, 1.0, 10.0)):
        cases.append((f"hold times of {', '.join(f'{t:g}' for t in others)} s", finished(40, 17, times=others)))
    return cases


def _answer(what: str, method: str, call: Callable[[], Any]) -> Any:
    try:
        return call()
    except Exception as error:
        raise AssertionError(f"{what}: {method}() raised {type(error).__name__}: {error}") from error


# -- observables ------------------------------------------------------------------------------------------------------


def numbers(component: Observable, replica: FinishedReplica, what: str) -> dict[str, np.ndarray]:
    """What the observable measures, which must be named numbers."""
    seen = with_states(replica) if component.states else replica
    answer = _answer(what, "measure", lambda: component.measure(*seen))
    right = isinstance(answer, Mapping) and answer
    require(right, f"{what}: measure() returned {answer!r}; expected names with numbers")
    require(all(isinstance(name, str) for name in answer), f"names {list(answer)} are not all str")
    values = {name: np.asarray(value) for name, value in answer.items()}
    kinds = {name: value.dtype.kind for name, value in values.items()}
    require(set(kinds.values()) <= set("fiub"), f"{what}: not numbers: {kinds}")
    return values


def _bytes(component: Observable, replica: FinishedReplica) -> dict[str, bytes]:
    return {name: value.tobytes() for name, value in numbers(component, replica, "a replica").items()}


@check_of(Observable)
def _observes_numbers(component: Observable) -> None:
    """Names and shapes are the same for all replicas of a contact, with or without bonds and sites."""
    first = None
    for what, replica in usual():
        values = numbers(component, replica, what)
        shapes = {name: value.shape for name, value in values.items()}
        first = first or shapes
        require(shapes == first, f"{what}: {shapes}, expected {first} as for the other replicas")
        if what == "17 of 40 sites bonded":
            lost = [name for name, value in values.items() if value.size and not np.isfinite(value).any()]
            require(not lost, f"{', '.join(lost)}: no finite number, although 17 of 40 sites are bonded")


@check_of(Observable)
def _names_are_safe(component: Observable) -> None:
    """Names can be those of a variable in a file and of a column in a table: no slash, no control character, no blank
    at either end."""
    for name in numbers(component, finished(40, 17), "17 of 40 sites bonded"):
        bad = [character for character in name if character in "/\\" or unicodedata.category(character)[0] == "C"]
        require(not bad, f"the name {name!r} contains {bad[:1]!r}, which a file or a table cannot hold; rename it")
        fits = name and name == name.strip() and name not in (".", "..") and len(name) <= 100
        require(fits, f"the name {name!r} cannot be that of a variable in a file; rename it")


@check_of(Observable, known=True)
def _measures_what_it_declares(component: Observable) -> None:
    """What is measured are just the ``outputs``, where they are declared: with these dimensions, of which
    ``hold_times`` is as long as the hold times, with safe names, and units that can be read."""
    problems = declaration_problems(component.outputs)
    require(not problems, "; ".join(problems))
    for name, output in component.outputs.items():
        try:
            unit_registry().parse_units(output.unit)
        except Exception as error:
            raise AssertionError(f"output {name!r}: the unit {output.unit!r} cannot be read: {error}") from error
        require(output.description.strip(), f"output {name!r} has no description")
    for times in ((0.0, 10.0), (0.0, 0.5, 2.0, 10.0, 10.0), (10.0,)) if component.outputs else ():
        checker = Checker("it", len(times))
        values = numbers(component, finished(40, 17, times=times), f"{len(times)} hold times")
        try:
            checker.names(values, component.outputs)
            for name, value in values.items():
                checker.values(name, value, component.outputs[name])
        except PluginError as error:
            raise AssertionError(f"{len(times)} hold times: {error}") from error


@check_of(Observable)
def _grids_need_not_be_square(component: Observable) -> None:
    """Contacts whose grid is not square are measured, with the same names; maps are (nx, ny)."""
    names = set(numbers(component, finished(40, 17), "an 8x8 grid"))
    for grid in ((13, 5), (5, 13)):
        values = numbers(component, finished(40, 17, grid=grid), f"a grid of {grid[0]}x{grid[1]} pixels")
        require(set(values) == names, f"a grid of {grid} pixels has other names: {sorted(set(values) ^ names)}")
        swapped = [name for name, value in values.items() if value.shape[-2:] == grid[::-1]]
        require(not swapped, f"a grid of {grid} pixels (nx, ny): {', '.join(swapped)} has the shape {grid[::-1]}")


@check_of(Observable)
def _measure_disturbs_nothing(component: Observable) -> None:
    """A replica is measured the same way every time, whatever was measured before or at the same time, and stays as it
    was."""
    replicas = [finished(40, 17), finished(40, 40), finished(30, 5)]
    kept = [record for replica in replicas for record in replica]
    calls_are_independent(lambda replica: _bytes(component, replica), replicas, *kept)


# -- laws of rupture --------------------------------------------------------------------------------------------------

#: force per bond, nN, from entropic bonds of a few pN to beyond any covalent bond
LEAST, MOST = 1e-4, 100.0
TIMES = (0.0, 0.1, 10.0, 10.0, 1e4)


def bonded_of(component: Rupture, replica: FinishedReplica) -> Bonded:
    """A replica with breaking barriers that differ from site to site, as the law receives it."""
    contact, lattice, history = with_states(replica) if component.states else replica
    breaking: Any = None
    if lattice.breaking is not None:
        breaking = Even()
        order = np.random.default_rng(lattice.sites.size + 1).permutation(lattice.sites.size)
        lattice = lattice.model_copy(update={"breaking": np.linspace(0.9, 1.3, lattice.sites.size)[order]})
        history = history.model_copy(update={"lattice_hash": lattice.digest()})
    return Bonded(contact, Chemistry(forming=Even(), breaking=breaking), lattice, history)


def _some(component: Rupture, n: int = 40, bonded: int = 17) -> Bonded:
    return bonded_of(component, finished(n, bonded, times=TIMES))


def force_of(component: Rupture, bonded: Bonded, what: str) -> np.ndarray:
    """What the law gives, which must be a force in nN for each hold time."""
    force = _answer(what, "force", lambda: np.asarray(component.force(bonded)))
    times = bonded.hold_times.size
    require(force.dtype.kind in "fiu", f"{what}: force() returned values of type {force.dtype}; expected forces in nN")
    require(force.shape == (times,), f"{what}: force() returned the shape {force.shape} for {times} hold times")
    require(np.isfinite(force).all(), f"{what}: not all forces are finite: {force}")
    require((force >= 0).all(), f"{what}: a force is negative: {force}")
    return force


@check_of(Rupture, known=True)
def _forces_are_forces(component: Rupture) -> None:
    """There is one force for each hold time, finite and not negative, with or without bonds and sites."""
    for what, replica in usual(TIMES):
        force_of(component, bonded_of(component, replica), what)


@check_of(Rupture, known=True)
def _no_bonds_no_force(component: Rupture) -> None:
    """The force is 0 wherever there is no bond."""
    for what, replica in usual(TIMES):
        bonded = bonded_of(component, replica)
        force = force_of(component, bonded, what)[bonded.bonds == 0]
        require((force == 0).all(), f"{what}: a force of {force.max(initial=0.0):.4g} nN where there is no bond")


@check_of(Rupture)
def _forces_are_in_nn(component: Rupture) -> None:
    """Forces are in nN: the mean force per bond is between 1e-4 and 100 nN, unless all are zero."""
    force = float(force_of(component, _some(component, 40, 40), "all sites bonded")[-1]) / 40
    require(
        force == 0 or LEAST <= force <= MOST,
        f"the mean force per bond is {force:.3g} nN; expected {LEAST:g} to {MOST:g} nN: is it in N, pN or eV/nm?",
    )


@check_of(Rupture)
@check_of(Observable)
def _parts_may_be_absent(component: Observable | Rupture) -> None:
    """Lattices without breaking barriers or without interaction, contacts that are not square, and any hold times are
    treated too, or a rupture law refuses them, in ``check`` as well."""
    for what, replica in unusual(TIMES):
        if isinstance(component, Rupture):
            bonded = bonded_of(component, replica)
            try:
                component.check(bonded.chemistry, bonded.temperature)
            except InputError:  # it says beforehand that it cannot treat this
                refuses(what, lambda bonded=bonded: component.force(bonded))
            else:
                force_of(component, bonded, what)
        else:
            numbers(component, replica, what)


@check_of(Rupture)
def _force_disturbs_nothing(component: Rupture) -> None:
    """A replica has the same force every time, whatever was asked before or at the same time, and stays as it was."""
    replicas = [_some(component), _some(component, 40, 40), _some(component, 30, 5)]
    kept = [record for bonded in replicas for record in (bonded.contact, bonded.lattice, bonded.history)]
    calls_are_independent(lambda bonded: force_of(component, bonded, "a replica").tobytes(), replicas, *kept)


@check_of(Rupture)
def _later_times_do_not_matter(component: Rupture) -> None:
    """The force after a hold time does not depend on what happens later: sliding after 10 s does not know of 1e4 s."""
    bonded = _some(component, 40, 30)
    whole = force_of(component, bonded, "30 of 40 sites bonded")
    for number in range(1, bonded.hold_times.size):
        force = force_of(component, _until(bonded, number), f"the first {number} hold times")
        require(
            np.allclose(force, whole[:number], rtol=1e-9, atol=0.0),
            f"the first {number} hold times alone: {force} nN, but {whole[:number]} nN where later ones follow; "
            "history.state are the bonds at the last hold time, set states = True for those at each",
        )


def _until(bonded: Bonded, number: int) -> Bonded:
    """The replica, had it been stopped after its first ``number`` hold times."""
    history = bonded.history
    changes: dict[str, Any] = {
        name: getattr(history, name)[:number] for name in ("hold_times", "bonds", "formed", "broken")
    }
    states = _rank(bonded.lattice.sites.size) < history.bonds[:number, None]
    changes |= {"state": states[-1], "time": float(history.hold_times[number - 1])}
    changes["states"] = None if history.states is None else states
    return Bonded(bonded.contact, bonded.chemistry, bonded.lattice, history.model_copy(update=changes))


@check_of(Rupture)
def _unbonded_sites_do_not_matter(component: Rupture) -> None:
    """A law that asks for the states does not depend on the barriers of sites that have no bond, unless it follows them
    on (``sampled``)."""
    if not component.states or component.sampled:
        return
    bonded = _some(component)
    lattice, open_sites = bonded.lattice, ~bonded.history.state
    raised = {
        name: np.where(open_sites, getattr(lattice, name) + 0.1, getattr(lattice, name))
        for name in ("forming", "breaking")
    }
    other = Bonded(bonded.contact, bonded.chemistry, lattice.model_copy(update=raised), bonded.history)
    here, there = (force_of(component, case, "17 of 40 sites bonded") for case in (bonded, other))
    require(
        np.allclose(here, there, rtol=1e-9, atol=0.0),
        f"barriers of unbonded sites were raised by 0.1 eV: {there} nN instead of {here} nN; states are (hold times, "
        "sites), in the order of lattice.sites",
    )


TEMPERATURE, METHOD_TIMES = 300.0, np.array([0.0, 1e-3, 1.0, 1.0, 1e3, 1e6])
REPLICAS = 6
#: standard errors within which a method must agree with the closed form
FAR = 6.5


check_ageing_method = whole(AgeingMethod)


class Single(Engine):
    """Sites that form a bond once and for all, each by itself: the engine of these checks."""

    kind = "single"
    interacting = False
    restart = True  # the times of all events are known from the start

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        rate = lattice.attempt_frequency * np.exp(-np.maximum(lattice.forming, 0.0) / (KB * temperature))
        formed = -np.log(random.uniforms(seed, 900, lattice.random_index)) / rate
        bonds = np.array([np.count_nonzero(formed <= time) for time in hold_times], dtype=np.int64)
        return BondHistory(
            hold_times=hold_times,
            bonds=bonds,
            formed=bonds,
            broken=np.zeros_like(bonds),
            state=formed <= hold_times[-1],
            time=float(hold_times[-1]),
            temperature=temperature,
            engine=self.kind,
            lattice_hash=lattice.digest(),
        )


def _contact(pressure: np.ndarray, periodic: bool = True) -> ContactSolution:
    load = float(pressure.sum()) * 0.25
    return ContactSolution(pressure=pressure, load=load, pixel_size=0.5, modulus=35.3, rms_slope=0.1, periodic=periodic)


def _contacts() -> Iterator[tuple[str, ContactSolution]]:
    yield "a uniform contact of 48 x 40 pixels", _contact(np.full((48, 40), 2.0))
    rows, columns = np.indices((64, 40))
    rough = 3.0 * np.sin(rows / 5.0) * np.cos(columns / 4.0) - 0.8
    yield "a contact of several patches", _contact(np.maximum(rough, 0.0))
    yield "a contact that does not repeat", _contact(np.maximum(rough[:40], 0.0), periodic=False)
    yield "a contact of one pixel", _contact(np.pad([[1.5]], 7))
    yield "no contact", _contact(np.zeros((16, 16)))


def _chemistry(**options: Any) -> Chemistry:
    return Chemistry(**{"forming": Even(), "activation_volume": 0.01, "site_density": "pixel", **options})


def _request(contact: ContactSolution, **changes: Any) -> AgeingRequest:
    own = {"chemistry": _chemistry(), "engine": Single(), "hold_times": METHOD_TIMES, "temperature": TEMPERATURE}
    return AgeingRequest(**{"contact": contact, **own, "replicas": REPLICAS, "seed": 5, "common": "none", **changes})


def _aged(component: AgeingMethod, request: AgeingRequest) -> Aging:
    """What the stage makes of the answer, which it validates."""
    fields = ("engine", "hold_times", "temperature", "replicas", "seed", "common", "threads")
    options = {name: getattr(request, name) for name in fields}
    return age(request.contact, request.chemistry, method=component, **options)


def _expected(contact: ContactSolution, chemistry: Chemistry, kelvin: float, times: np.ndarray) -> np.ndarray:
    """Mean number of bonds at each of ``times``, (m,): sites that do not interact, over 4000 barriers each."""
    ranks = (np.arange(4000) + 0.5) / 4000
    total = np.zeros(times.size)
    pressures, counts = np.unique(chemistry.sites_of(contact).pressure, return_counts=True)
    for pressure, count in zip(pressures, counts, strict=True):
        barrier = chemistry.forming.quantile(ranks) - chemistry.activation_volume * EV_PER_GPA_NM3 * float(pressure)
        sites = TwoState(chemistry.rates(barrier, kelvin))
        total += count * sites.bonded(times[:, None]).mean(axis=1)
    return total * chemistry.hydroxylation


@asks(AgeingMethod)
def _methods_asked(component: AgeingMethod) -> Questions:
    def ask(rows: int, **changes: Any) -> Any:
        contact = _contact(np.full((rows, 13), changes.pop("pressure", 1.7)))
        request = _request(contact, **{"temperature": 303.0, "replicas": 2, **changes})
        return lambda method: [getattr(method.age(request), name) for name in ("bonds", "sites", "errors")]

    changes: dict[str, dict[str, Any]] = {
        "at another temperature": {"temperature": 317.0},
        "under another pressure": {"pressure": 1.9},
        "with another seed": {"seed": 6},
        "at other hold times": {"hold_times": 1.3 * METHOD_TIMES},
        "with another attempt frequency": {"chemistry": _chemistry(attempt_frequency=7e12)},
        "with fewer hydroxyl groups": {"chemistry": _chemistry(hydroxylation=0.8)},
    }
    for rows, (what, change) in enumerate(changes.items(), 17):
        yield f"a contact of {rows}x13 pixels", ask(rows)
        yield f"a contact of {rows}x13 pixels {what}", ask(rows, **change)


@check_of(AgeingMethod)
def _gives_aged_bonds(component: AgeingMethod) -> None:
    """The answer has one row of bonds for each replica, or a single one where the class says so, and one number for
    each hold time; what it says of errors is complete."""
    for what, contact in _contacts():
        aged = component.age(_request(contact))
        require(isinstance(aged, AgedBonds), f"{what}: age() returned {type(aged).__name__}; give an AgedBonds")
        rows = REPLICAS if component.replicates else 1
        shape = np.shape(aged.bonds)
        expected = (rows, METHOD_TIMES.size)
        require(shape == expected, f"{what}: bonds have the shape {shape}; expected {expected}")
        try:
            _aged(component, _request(contact))
        except Exception as error:
            raise AssertionError(f"{what}: {error}") from error


@check_of(AgeingMethod, known=True)
def _bonds_are_those_of_the_whole_contact(component: AgeingMethod) -> None:
    """Bonds and sites are those of the whole contact: sites that do not interact have the mean of the closed form,
    within the errors that the method states."""
    conditions = ((1.0, 1e13, 0.01, TEMPERATURE, METHOD_TIMES), (0.7, 3e11, 0.02, 360.0, METHOD_TIMES[1:] / 7))
    for hydroxylation, nu, volume, kelvin, times in conditions:
        chemistry = _chemistry(hydroxylation=hydroxylation, attempt_frequency=nu, activation_volume=volume)
        for what, contact in _contacts():
            contact = contact.model_copy(update={"pixel_size": 0.5 if kelvin == TEMPERATURE else 0.8})
            contact = contact.model_copy(update={"load": contact.carried})
            request = _request(contact, chemistry=chemistry, temperature=kelvin, hold_times=times)
            aging = _aged(component, request)
            sites, exact = hydroxylation * contact.sites.size, _expected(contact, chemistry, kelvin, times)
            spread = FAR * math.sqrt(max(sites * (1 - hydroxylation), 0.25))
            size = float(aging.sites.mean())
            require(abs(size - sites) <= spread + 0.5, f"{what}: {size:g} sites, expected {sites:g}")
            bonds = aging.bonds.mean(axis=0)
            # replicas differ by their disorder as well: at most as Poisson numbers
            noise = np.sqrt(exact / len(aging.bonds)) if component.replicates else np.zeros(times.size)
            for name, error in aging.errors.items():
                worst = float(np.nan_to_num(error[exact > 1]).max(initial=0.0))
                require(worst < 1, f"{what}: the error {name!r} is up to {worst:.3g}; errors are relative, 0.05 is 5 %")
            stated = sum((np.nan_to_num(error) ** 2 for error in aging.errors.values()), np.zeros(times.size))
            allowed = FAR * (noise + np.sqrt(stated) * exact) + (component.declared_error or 0.0) * exact
            allowed += 1e-3 * exact + (0.5 if component.replicates else 1e-9)
            at = int(np.argmax(np.abs(bonds - exact) - allowed))
            require(
                bool(abs(bonds[at] - exact[at]) <= allowed[at]),
                f"{what}, hydroxylation {hydroxylation:g}, ν = {nu:g} Hz, {kelvin:g} K: {bonds[at]:.4g} bonds at "
                f"{times[at]:g} s, the closed form has {exact[at]:.4g}; bonds are those of the whole contact",
            )


@check_of(AgeingMethod)
def _answers_are_repeatable(component: AgeingMethod) -> None:
    """An answer depends on the request alone: not on what was asked before or at the same time, nor on the number of
    threads; and the contact stays as it was."""
    requests = [_request(contact) for _, contact in list(_contacts())[:3]]

    def bonds(request: AgeingRequest) -> bytes:
        return np.asarray(component.age(request).bonds, dtype=np.float64).tobytes()

    calls_are_independent(bonds, requests, *(request.contact for request in requests))
    threaded = [bonds(dataclasses.replace(request, threads=3)) for request in requests]
    require(threaded == [bonds(request) for request in requests], "the bonds depend on the number of threads")


@check_of(AgeingMethod)
def _fewer_replicas_are_the_first_ones(component: AgeingMethod) -> None:
    """Replica r does not depend on how many replicas there are."""
    if not component.replicates:
        return
    contact = next(_contacts())[1]
    many, few = (np.asarray(component.age(_request(contact, replicas=count)).bonds) for count in (REPLICAS, 2))
    require(np.array_equal(many[:2], few), "2 replicas are not the first 2 of 6; the seed belongs to the replica")
