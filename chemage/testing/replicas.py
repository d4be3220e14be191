"""Checks of ageing methods, observables and laws of rupture, which make or receive replicas; and replicas for them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice, product
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from chemage.ageing.age import age
from chemage.ageing.ageing import Ageing
from chemage.ageing.methods import AgedBonds, AgeingMethod, AgeingRequest
from chemage.ageing.observables import Observable
from chemage.contacts.solution import ContactSolution
from chemage.foundation import random
from chemage.foundation.checks import Seed
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import Checker, declaration_problems, file_problem
from chemage.foundation.units import EV_PER_GPA_NM3, KB, unit_registry
from chemage.friction.role import Bonded, Rupture
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.independent import TwoState
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Barriers
from chemage.testing.answers import independent_calls
from chemage.testing.checks import (
    Checks,
    Questions,
    known,
    naming,
    refuses,
    require,
    whole,
)
from chemage.testing.trials import (
    Even,
    Trial,
    contact_of,
    history_of,
    states_of,
)


def with_states(replica: Bonded) -> Bonded:
    """The replica with the state of every site at every hold time."""
    states = states_of(replica.lattice.sites.size, replica.history.bonds)
    return changed(replica, history={"states": states})


def changed(replica: Bonded, **changes: Mapping[str, Any]) -> Bonded:
    """The replica with other fields of its parts: ``contact``, ``lattice`` or ``history``."""
    contact = replica.contact.model_copy(update=changes.get("contact"))
    lattice = replica.lattice.model_copy(update=changes.get("lattice"))
    update = {"lattice_hash": lattice.digest(), **changes.get("history", {})}
    return replace(
        replica,
        contact=contact,
        lattice=lattice,
        history=replica.history.model_copy(update=update),
    )


def held(
    replica: Bonded, times: ArrayLike, bonds: ArrayLike, passed: Any = 0
) -> Bonded:
    """The replica with so many bonds at each of ``times`` (s), and ``passed`` (m,) that formed and broke before."""
    counts = np.array(bonds, np.int64)
    broken: Any = np.cumsum(np.maximum(-np.diff(counts, prepend=0), 0)) + passed
    states = states_of(replica.lattice.sites.size, counts)
    history = history_of(
        replica.lattice, times, states, replica.temperature, "by-hand", broken
    )
    return replace(replica, history=history)


def tiled(replica: Bonded, copies: int) -> Bonded:
    """So many copies of a replica with states, one after the other along x."""
    contact, lattice, history = replica.contact, replica.lattice, replica.history
    (nx, ny), n, states = lattice.pixels, lattice.sites.size, history.states
    number = np.repeat(np.arange(copies), n)
    fields: dict[str, Any] = {
        name: np.tile(values, copies)
        for name in ("forming", "breaking")
        if (values := getattr(lattice, name)) is not None
    }
    if lattice.neighbours is not None and lattice.coupling is not None:
        near = np.tile(lattice.neighbours, (copies, 1))
        ends = np.where(near >= 0, near + n * number[:, None], -1).astype(np.int32)
        coupling = np.tile(lattice.coupling, (copies, 1))
        fields |= {"neighbours": ends, "coupling": coupling}
    return changed(
        replica,
        contact={
            "pressure": np.tile(contact.pressure, (copies, 1)),
            "load": copies * contact.load,
        },
        lattice={
            "pixels": (copies * nx, ny),
            "sites": np.tile(lattice.sites, copies) + nx * ny * number,
            **fields,
        },
        history={
            "state": np.tile(history.state, copies),
            "states": None if states is None else np.tile(states, (1, copies)),
            **{
                name: copies * getattr(history, name)
                for name in ("bonds", "formed", "broken")
            },
        },
    )


#: what can be asked for its answer to a replica
Asked = Observable | Rupture


def usual() -> list[tuple[str, Bonded]]:
    """Replicas with and without bonds and sites, each with what it is; the second is the plain one."""
    counts = ((40, 0), (40, 17), (40, 40), (1, 1), (0, 0))
    plain = Trial().replica()
    return [
        *(
            (
                f"{bonded} of {n} sites bonded",
                Trial(sites=n, bonded=bonded).replica(),
            )
            for n, bonded in counts
        ),
        (
            "17 bonds that have broken",
            held(plain, plain.hold_times, [0, 8, 17, 17, 0], [0, 0, 5, 5, 5]),
        ),
    ]


#: what is left out or changed of a replica that is usual
UNUSUAL = (
    Trial(breaking=False),
    Trial(coupled=False),
    Trial(breaking=False, coupled=False),
    Trial(pixels=(13, 5)),
    Trial(pixels=(5, 13)),
    Trial(hold_times=(10.0,)),
    Trial(hold_times=(0.0,)),
    Trial(hold_times=(1.0, 1.0, 10.0)),
)


def _given(component: Asked, replica: Bonded) -> Bonded:
    return (
        with_states(replica)
        if component.states and replica.history.states is None
        else replica
    )


def numbers(
    component: Asked, replica: Bonded, what: str = "17 of 40 sites bonded"
) -> dict[str, np.ndarray]:
    """What the observable measures, which must be named numbers; or the force of the law, in nN at each hold time."""
    seen = _given(component, replica)
    with naming(what):
        if isinstance(component, Rupture):
            answer: Any = {"force": component.force(seen)}
        else:
            answer = component.measure(seen.contact, seen.lattice, seen.history)
    require(
        isinstance(answer, Mapping) and answer,
        f"{what}: measure() returned {answer!r}; expected names",
    )
    require(
        all(isinstance(name, str) for name in answer),
        f"names {list(answer)} are not all str",
    )
    values = {name: np.asarray(value) for name, value in answer.items()}
    kinds = {name: value.dtype.kind for name, value in values.items()}
    require(set(kinds.values()) <= set("fiub"), f"{what}: not numbers: {kinds}")
    if isinstance(component, Rupture):
        force, times = values["force"], replica.hold_times.shape
        require(
            force.shape == times,
            f"{what}: forces of the shape {force.shape}; expected {times}, of the hold times",
        )
        require(
            np.isfinite(force).all() and (force >= 0).all(),
            f"{what}: negative or not finite: {force} nN",
        )
    return values


def treats(component: Asked, replica: Bonded) -> bool:
    """Whether it does not say beforehand that it cannot treat this."""
    try:
        if isinstance(component, Rupture):
            component.check(replica.chemistry, replica.temperature)
    except InputError:
        return False
    return True


def _parts_may_be_absent(checks: Checks[Asked]) -> None:
    """Lattices without breaking barriers or without interaction, contacts that are not square, and any hold times
    are treated too, or a rupture law refuses them, in ``check`` as well."""
    component = checks.component
    for trial in UNUSUAL:
        what, replica = repr(trial), trial.replica()
        if treats(component, replica):
            numbers(component, replica, what)
        else:
            seen = _given(component, replica)
            refuses(what, lambda seen=seen: component.force(seen))  # pyright: ignore[reportAttributeAccessIssue]


class ObservableChecks(Checks[Observable], of=Observable):
    """What every observable must do."""

    # -- observables ---------------------------------------------------------------------------------------------------

    def observes_numbers(self) -> None:
        """Names and shapes are the same for all replicas of a contact, with or without bonds and sites."""
        first = None
        for what, replica in usual():
            values = numbers(self.component, replica, what)
            shapes = {name: value.shape for name, value in values.items()}
            first = first or shapes
            require(
                shapes == first,
                f"{what}: {shapes}, expected {first} as for the other replicas",
            )
            if what == "17 of 40 sites bonded":
                lost = [
                    name
                    for name, value in values.items()
                    if value.size and not np.isfinite(value).any()
                ]
                require(
                    not lost,
                    f"{', '.join(lost)}: no finite number, although 17 of 40 sites are bonded",
                )

    def names_are_safe(self) -> None:
        """Names can be those of a variable in a file and of a column in a table: no slash, no control character, no
        blank at either end."""
        for problem in map(
            file_problem, numbers(self.component, Trial().replica())
        ):
            require(not problem, f"{problem}; rename it")

    @known
    def measures_what_it_declares(self) -> None:
        """What is measured are just the ``outputs``, where they are declared: with these dimensions, of which
        ``hold_times`` is as long as the hold times, with safe names, and units that can be read."""
        component = self.component
        problems = declaration_problems(component.outputs)
        require(not problems, "; ".join(problems))
        for name, output in component.outputs.items():
            with naming(
                f"output {name!r}: the unit {output.unit!r} cannot be read"
            ):
                unit_registry().parse_units(output.unit)
            require(
                output.description.strip(), f"output {name!r} has no description"
            )
        for times in (
            ((0.0, 10.0), (0.0, 0.5, 2.0, 10.0, 10.0), (10.0,))
            if component.outputs
            else ()
        ):
            checker = Checker("it", len(times))
            values = numbers(
                component,
                Trial(hold_times=times).replica(),
                f"{len(times)} hold times",
            )
            with naming(f"{len(times)} hold times"):
                checker.names(values, component.outputs)
                for name, value in values.items():
                    checker.values(name, value, component.outputs[name])

    def grids_need_not_be_square(self) -> None:
        """Contacts whose grid is not square are measured, with the same names; maps are (nx, ny)."""
        names = numbers(self.component, Trial().replica()).keys()
        for grid in ((13, 5), (5, 13)):
            what = f"a grid of {grid} pixels (nx, ny)"
            values = numbers(self.component, Trial(pixels=grid).replica(), what)
            require(
                values.keys() == names,
                f"{what} has other names: {sorted(values.keys() ^ names)}",
            )
            swapped = [
                name
                for name, value in values.items()
                if value.shape[-2:] == grid[::-1]
            ]
            require(
                not swapped,
                f"{what}: {', '.join(swapped)} has the shape {grid[::-1]}",
            )

    parts_may_be_absent = _parts_may_be_absent
    calls_are_independent = independent_calls


# -- laws of rupture --------------------------------------------------------------------------------------------------

#: force per bond, nN, from entropic bonds of a few pN to beyond any covalent bond
LEAST, MOST = 1e-4, 100.0


def force_of(
    component: Rupture, bonded: Bonded, what: str = "17 of 40 sites bonded"
) -> np.ndarray:
    """What the law gives, which must be a force in nN for each hold time."""
    return numbers(component, bonded, what)["force"]


class RuptureChecks(Checks[Rupture], of=Rupture):
    """What every law of rupture must do."""

    @known
    def forces_are_forces(self) -> None:
        """There is one force for each hold time, finite and not negative, with or without bonds and sites."""
        for what, replica in usual():
            force_of(self.component, replica, what)

    @known
    def no_bonds_no_force(self) -> None:
        """The force is 0 wherever there is no bond."""
        for what, replica in usual():
            force = force_of(self.component, replica, what)[replica.bonds == 0]
            require(
                (force == 0).all(),
                f"{what}: a force of {force.max(initial=0.0):.4g} nN where there is no bond",
            )

    parts_may_be_absent = _parts_may_be_absent

    def forces_are_in_nn(self) -> None:
        """Forces are in nN: the mean force per bond is between 1e-4 and 100 nN, unless all are zero."""
        force = float(force_of(self.component, Trial(bonded=40).replica())[-1]) / 40
        require(
            force == 0 or LEAST <= force <= MOST,
            f"the mean force per bond is {force:.3g} nN; expected {LEAST:g} to {MOST:g} nN: is it in N, pN or eV/nm?",
        )

    calls_are_independent = independent_calls

    def later_times_do_not_matter(self) -> None:
        """The force after a hold time does not depend on what happens later: sliding after 10 s does not know of 1e4
        s."""
        bonded = Trial(bonded=30).replica()
        whole = force_of(self.component, bonded)
        for number in range(1, bonded.hold_times.size):
            times, bonds = bonded.hold_times[:number], bonded.bonds[:number]
            force = force_of(
                self.component,
                held(bonded, times, bonds),
                f"the first {number} hold times",
            )
            require(
                np.allclose(force, whole[:number], rtol=1e-9, atol=0.0),
                f"the first {number} hold times alone: {force} nN, but {whole[:number]} nN where later ones follow; "
                "history.state are the bonds at the last hold time, set states = True for those at each",
            )

    def unbonded_sites_do_not_matter(self) -> None:
        """A law that asks for the states does not depend on the barriers of sites that have no bond, unless it follows
        them on (``sampled``)."""
        if not self.component.states or self.component.sampled:
            return
        bonded = Trial().replica()
        raised = {
            name: getattr(bonded.lattice, name) + 0.1 * ~bonded.history.state
            for name in ("forming", "breaking")
        }
        here, there = (
            force_of(self.component, case)
            for case in (bonded, changed(bonded, lattice=raised))
        )
        require(
            np.allclose(here, there, rtol=1e-9, atol=0.0),
            f"barriers of unbonded sites were raised by 0.1 eV: {there} nN instead of {here} nN; states are (hold "
            "times, sites), in the order of lattice.sites",
        )


TEMPERATURE, METHOD_TIMES = 300.0, np.array([0.0, 1e-3, 1.0, 1.0, 1e3, 1e6])
REPLICAS = 6
#: standard errors within which a method must agree with the closed form
FAR = 6.5


check_ageing_method = whole(AgeingMethod)


class Single(Engine):
    """Sites that form and break their bond each by itself: the engine of these checks."""

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
        def rate(barriers: np.ndarray) -> np.ndarray:
            return lattice.attempt_frequency * np.exp(
                -np.maximum(barriers, 0.0) / (KB * temperature)
            )

        forming, index = rate(lattice.forming), lattice.random_index
        if lattice.breaking is None:
            formed = -np.log(random.uniforms(seed, 900, index)) / forming
            states = formed <= hold_times[:, None]
        else:
            sites, now = TwoState(forming, rate(lattice.breaking)), 0.0
            state, found = np.zeros(index.size), []
            for number, time in enumerate(hold_times):
                left = 1 - sites.relaxed(time - now)
                chance = sites.bonded(time - now) + state * left
                state = random.uniforms(seed, 901 + number, index) < chance
                now = time
                found.append(state)
            states = np.array(found).reshape(hold_times.size, index.size)
        lost = -np.diff(states.sum(axis=1), prepend=0)
        broken: Any = np.cumsum(np.maximum(lost, 0))
        return history_of(
            lattice, hold_times, states, temperature, self.kind, broken
        )


def _contacts() -> Iterator[tuple[str, ContactSolution]]:
    yield "a uniform contact of 48 x 40 pixels", contact_of(np.full((48, 40), 2.0))
    rows, columns = np.indices((64, 40))
    rough = 3.0 * np.sin(rows / 5.0) * np.cos(columns / 4.0) - 0.8
    yield "a contact of several patches", contact_of(np.maximum(rough, 0.0))
    yield (
        "a contact that does not repeat",
        contact_of(np.maximum(rough[:40], 0.0), periodic=False),
    )
    yield "a contact of one pixel", contact_of(np.pad([[1.5]], 7))
    yield "no contact", contact_of(np.zeros((16, 16)))


def _chemistry(**options: Any) -> Chemistry:
    return Chemistry(
        **{
            "forming": Even(),
            "activation_volume": 0.01,
            "site_density": "pixel",
            **options,
        }
    )


def _request(contact: ContactSolution, **changes: Any) -> AgeingRequest:
    own = {
        "chemistry": _chemistry(),
        "engine": Single(),
        "hold_times": METHOD_TIMES,
        "temperature": TEMPERATURE,
    }
    return AgeingRequest(
        **{
            "contact": contact,
            **own,
            "replicas": REPLICAS,
            "seed": 5,
            "common": "none",
            **changes,
        }
    )


def _expected(
    contact: ContactSolution, chemistry: Chemistry, kelvin: float, times: np.ndarray
) -> np.ndarray:
    """Mean number of bonds at each of ``times``, (m,): sites that do not interact, over 4000 barriers each."""

    def barriers(of: Barriers, count: int) -> np.ndarray:
        return of.quantile((np.arange(count) + 0.5) / count)

    of_bonds = chemistry.breaking
    breaking = 0.0
    if of_bonds is not None:
        breaking = chemistry.rates(barriers(of_bonds, 50), kelvin)[:, None]
    total = np.zeros(times.size)
    pressures, counts = np.unique(
        chemistry.sites_of(contact).pressure, return_counts=True
    )
    forming = barriers(chemistry.forming, 4000)
    for pressure, count in zip(pressures, counts, strict=True):
        barrier = forming - chemistry.activation_volume * EV_PER_GPA_NM3 * float(
            pressure
        )
        sites = TwoState(chemistry.rates(barrier, kelvin), breaking)
        total += count * np.array([np.mean(sites.bonded(time)) for time in times])
    return total * chemistry.hydroxylation


#: hydroxylation, attempt frequency (Hz), activation volume (nm³), temperature (K), pixel (nm), hold times (s), and
#: other options of the chemistry
_CONDITIONS: tuple[tuple[Any, ...], ...] = (
    (1.0, 1e13, 0.01, 300.0, 0.5, METHOD_TIMES, {}),
    (0.7, 3e11, 0.02, 360.0, 0.8, METHOD_TIMES[1:] / 7, {}),
)
#: ... of which one contact is enough
_FURTHER: tuple[tuple[Any, ...], ...] = (
    (
        0.9,
        1e11,
        0.01,
        150.0,
        0.5,
        np.array([1e3]),
        {"forming": Even(lower=0.3, upper=0.6)},
    ),
    (
        0.8,
        1e14,
        0.01,
        600.0,
        0.5,
        np.geomspace(1e-3, 1e5, 100),
        {"forming": Even(lower=1.6, upper=2.8)},
    ),
    (1.0, 1e13, 0.01, 300.0, 0.5, METHOD_TIMES, {"site_density": 13.0}),
    (1.0, 1e13, 0.01, 300.0, 0.5, METHOD_TIMES, {"site_density": 1.1}),
    (
        1.0,
        1e13,
        0.01,
        300.0,
        0.5,
        METHOD_TIMES,
        {"breaking": Even(lower=0.7, upper=1.0)},
    ),
)


class AgeingMethodChecks(Checks[AgeingMethod], of=AgeingMethod):
    """What every method of ageing must do."""

    def _aged(self, request: AgeingRequest) -> Ageing:
        """What the stage makes of the answer, which it validates."""
        fields = (
            "engine",
            "hold_times",
            "temperature",
            "replicas",
            "seed",
            "common",
            "threads",
        )
        options = {name: getattr(request, name) for name in fields}
        return age(
            request.contact, request.chemistry, method=self.component, **options
        )

    def questions(self) -> Questions:
        answered = attrgetter("bonds", "sites", "errors")

        def ask(rows: int, pressure: float = 1.7, **changes: Any) -> Any:
            contact = contact_of(np.full((rows, 13), pressure))
            request = _request(
                contact, **{"temperature": 303.0, "replicas": 2, **changes}
            )
            return lambda method: answered(method.age(request))

        changes: dict[str, dict[str, Any]] = {
            "at other hold times": {"hold_times": 1.3 * METHOD_TIMES},
            "at another temperature": {"temperature": 317.0},
            "under another pressure": {"pressure": 1.9},
            "with another seed": {"seed": 6},
            "with another attempt frequency": {
                "chemistry": _chemistry(attempt_frequency=7e12)
            },
            "with fewer hydroxyl groups": {
                "chemistry": _chemistry(hydroxylation=0.8)
            },
        }
        for rows, (what, change) in enumerate(changes.items(), 17):
            yield f"a contact of {rows}x13 pixels", ask(rows)
            yield f"a contact of {rows}x13 pixels {what}", ask(rows, **change)

    def gives_aged_bonds(self) -> None:
        """The answer has one row of bonds for each replica, or a single one where the class says so, and one number for
        each hold time; what it says of errors is complete."""
        for what, contact in _contacts():
            aged = self.component.age(_request(contact))
            require(
                isinstance(aged, AgedBonds),
                f"{what}: age() returned {type(aged).__name__}; give an AgedBonds",
            )
            shape = np.shape(aged.bonds)
            expected = (
                REPLICAS if self.component.replicates else 1,
                METHOD_TIMES.size,
            )
            require(
                shape == expected,
                f"{what}: bonds have the shape {shape}; expected {expected}",
            )
            with naming(what):
                self._aged(_request(contact))

    @known
    def bonds_are_those_of_the_whole_contact(self) -> None:
        """Bonds and sites are those of the whole contact: sites that do not interact have the mean of the closed form,
        within the errors that the method states."""
        contacts = list(_contacts())
        cases = [*product(_CONDITIONS, contacts), *product(_FURTHER, contacts[:1])]
        for (share, nu, volume, kelvin, pixel, times, more), (
            what,
            contact,
        ) in cases:
            chemistry = _chemistry(
                hydroxylation=share,
                attempt_frequency=nu,
                activation_volume=volume,
                **more,
            )
            try:
                self.component.check(chemistry, Single())
            except InputError:
                continue  # it says beforehand that it cannot treat this
            load = contact.load * (pixel / contact.pixel_size) ** 2
            contact = contact.model_copy(update={"pixel_size": pixel, "load": load})
            ageing = self._aged(
                _request(
                    contact,
                    chemistry=chemistry,
                    temperature=kelvin,
                    hold_times=times,
                )
            )
            sites = share * chemistry.sites_of(contact).sites.size
            exact = _expected(contact, chemistry, kelvin, times)
            spread = FAR * math.sqrt(max(sites * (1 - share), 0.25))
            size = float(ageing.sites.mean())
            require(
                abs(size - sites) <= spread + 0.5,
                f"{what}: {size:g} sites, expected {sites:g}",
            )
            bonds, stated = ageing.bonds.mean(axis=0), np.zeros(times.size)
            for name, error in ageing.errors.items():
                worst = float(np.nan_to_num(error[exact > 1]).max(initial=0.0))
                require(
                    worst < 1,
                    f"{what}: the error {name!r} is up to {worst:.3g}; errors are relative, 0.05 is 5 %",
                )
                stated += np.nan_to_num(error) ** 2
            allowed = (
                FAR * np.sqrt(stated) * exact
                + (1e-3 + (self.component.declared_error or 0.0)) * exact
                + 1e-9
            )
            if self.component.replicates:  # replicas differ by their disorder as well: at most as Poisson numbers
                allowed += FAR * np.sqrt(exact / len(ageing.bonds)) + 0.5
            at = int(np.argmax(np.abs(bonds - exact) - allowed))
            require(
                abs(bonds[at] - exact[at]) <= allowed[at],
                f"{what}, hydroxylation {share:g}, ν = {nu:g} Hz, {kelvin:g} K, {more}: {bonds[at]:.4g} bonds at "
                f"{times[at]:g} s, the closed form has {exact[at]:.4g}; bonds are those of the whole contact",
            )

    calls_are_independent = independent_calls

    def answers_are_repeatable(self) -> None:
        """An answer does not depend on the number of threads."""
        for _, contact in islice(_contacts(), 3):
            one, three = (
                self.component.age(_request(contact, threads=threads))
                for threads in (1, 3)
            )
            require(
                np.array_equal(one.bonds, three.bonds),
                "the bonds depend on the number of threads",
            )

    def fewer_replicas_are_the_first_ones(self) -> None:
        """Replica r does not depend on how many replicas there are."""
        if not self.component.replicates:
            return
        contact = next(_contacts())[1]
        many, few = (
            np.asarray(self.component.age(_request(contact, replicas=count)).bonds)
            for count in (REPLICAS, 2)
        )
        require(
            np.array_equal(many[:2], few),
            "2 replicas are not the first 2 of 6; the seed belongs to the replica",
        )
