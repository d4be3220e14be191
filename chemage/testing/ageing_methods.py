"""Checks of a method of ageing."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from chemage.ageing.age import age
from chemage.ageing.aging import Aging
from chemage.ageing.methods import AgedBonds, AgeingMethod, AgeingRequest
from chemage.contacts.solution import ContactSolution
from chemage.foundation import random
from chemage.foundation.checks import Seed
from chemage.foundation.units import EV_PER_GPA_NM3, KB
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.independent import TwoState
from chemage.lattices.lattice import ReactionLattice
from chemage.testing.checks import calls_are_independent, check_of, require, speed_changes_nothing, whole
from chemage.testing.replicas import Even

TEMPERATURE, TIMES = 300.0, np.array([0.0, 1e-3, 1.0, 1.0, 1e3, 1e6])
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
    own = {"chemistry": _chemistry(), "engine": Single(), "hold_times": TIMES, "temperature": TEMPERATURE}
    return AgeingRequest(**{"contact": contact, **own, "replicas": REPLICAS, "seed": 5, "common": "none", **changes})


def _aged(component: AgeingMethod, request: AgeingRequest) -> Aging:
    """What the stage makes of the answer, which it validates."""
    fields = ("engine", "hold_times", "temperature", "replicas", "seed", "common", "threads")
    options = {name: getattr(request, name) for name in fields}
    return age(request.contact, request.chemistry, method=component, **options)


def _expected(contact: ContactSolution, chemistry: Chemistry) -> np.ndarray:
    """Mean number of bonds at each of ``TIMES``, (m,): sites that do not interact, over 4000 barriers each."""
    ranks = (np.arange(4000) + 0.5) / 4000
    total = np.zeros(TIMES.size)
    pressures, counts = np.unique(chemistry.sites_of(contact).pressure, return_counts=True)
    for pressure, count in zip(pressures, counts, strict=True):
        barrier = chemistry.forming.quantile(ranks) - chemistry.activation_volume * EV_PER_GPA_NM3 * float(pressure)
        sites = TwoState(chemistry.rates(barrier, TEMPERATURE))
        total += count * sites.bonded(TIMES[:, None]).mean(axis=1)
    return total * chemistry.hydroxylation


@check_of("ageing")
def _gives_aged_bonds(component: AgeingMethod) -> None:
    """The answer has one row of bonds for each replica, or a single one where the class says so, and one number for
    each hold time; what it says of errors is complete."""
    for what, contact in _contacts():
        aged = component.age(_request(contact))
        require(isinstance(aged, AgedBonds), f"{what}: age() returned {type(aged).__name__}; give an AgedBonds")
        rows = REPLICAS if component.replicates else 1
        shape = np.shape(aged.bonds)
        require(shape == (rows, TIMES.size), f"{what}: bonds have the shape {shape}; expected {(rows, TIMES.size)}")
        try:
            _aged(component, _request(contact))
        except Exception as error:
            raise AssertionError(f"{what}: {error}") from error


@check_of("ageing")
def _bonds_are_those_of_the_whole_contact(component: AgeingMethod) -> None:
    """Bonds and sites are those of the whole contact: sites that do not interact have the mean of the closed form,
    within the errors that the method states."""
    for hydroxylation in (1.0, 0.7):
        chemistry = _chemistry(hydroxylation=hydroxylation)
        for what, contact in _contacts():
            aging = _aged(component, _request(contact, chemistry=chemistry))
            sites, exact = hydroxylation * contact.sites.size, _expected(contact, chemistry)
            spread = FAR * math.sqrt(max(sites * (1 - hydroxylation), 0.25))
            size = float(aging.sites.mean())
            require(abs(size - sites) <= spread + 0.5, f"{what}: {size:g} sites, expected {sites:g}")
            bonds = aging.bonds.mean(axis=0)
            # replicas differ by their disorder as well: at most as Poisson numbers
            noise = np.sqrt(exact / len(aging.bonds)) if component.replicates else np.zeros(TIMES.size)
            stated = sum((np.nan_to_num(error) ** 2 for error in aging.errors.values()), np.zeros(TIMES.size))
            allowed = FAR * (noise + np.sqrt(stated) * exact) + (component.declared_error or 0.0) * exact
            allowed += 1e-3 * exact + (0.5 if component.replicates else 1e-9)
            at = int(np.argmax(np.abs(bonds - exact) - allowed))
            require(
                bool(abs(bonds[at] - exact[at]) <= allowed[at]),
                f"{what}, hydroxylation {hydroxylation:g}: {bonds[at]:.4g} bonds at {TIMES[at]:g} s, the closed form "
                f"has {exact[at]:.4g}; bonds are those of the whole contact",
            )


@check_of("ageing")
def _answers_are_repeatable(component: AgeingMethod) -> None:
    """An answer depends on the request alone: not on what was asked before or at the same time, nor on the number of
    threads; and the contact stays as it was."""
    requests = [_request(contact) for _, contact in list(_contacts())[:3]]

    def bonds(request: AgeingRequest) -> bytes:
        return np.asarray(component.age(request).bonds, dtype=np.float64).tobytes()

    calls_are_independent(bonds, requests, *(request.contact for request in requests))
    threaded = [bonds(dataclasses.replace(request, threads=3)) for request in requests]
    require(threaded == [bonds(request) for request in requests], "the bonds depend on the number of threads")


@check_of("ageing")
def _fewer_replicas_are_the_first_ones(component: AgeingMethod) -> None:
    """Replica r does not depend on how many replicas there are."""
    if not component.replicates:
        return
    contact = next(_contacts())[1]
    many, few = (np.asarray(component.age(_request(contact, replicas=count)).bonds) for count in (REPLICAS, 2))
    require(np.array_equal(many[:2], few), "2 replicas are not the first 2 of 6; the seed belongs to the replica")


@check_of("ageing")
def _speed_does_not_change_the_bonds(component: AgeingMethod) -> None:
    """Options in ``speed_only`` do not change a bit of the bonds."""
    request = _request(next(_contacts())[1])
    speed_changes_nothing(component, lambda variant: np.asarray(variant.age(request).bonds).tobytes(), "the bonds")
