"""Checks of an observable."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from chemage.ageing.observables import Observable
from chemage.contacts.solution import ContactSolution
from chemage.kinetics.history import BondHistory
from chemage.lattices.lattice import ReactionLattice
from chemage.testing.checks import check_of, require, run_checks


def check_observable(component: Observable) -> None:
    """Run every check of the role ``observable``; raises AssertionError if one fails."""
    run_checks(component, Observable, {})


def _replica(n: int, bonded: int) -> tuple[ContactSolution, ReactionLattice, BondHistory]:
    """Make a completed replica: ``n`` sites on an 8x8 grid, ``bonded`` of them with a bond."""
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


@check_of("observable")
def _observes_numbers(component: Observable) -> None:
    """Names and shapes are the same for all replicas, with or without bonds and sites, and results are reproducible."""
    shapes = {}
    for n, bonded in ((40, 0), (40, 17), (40, 40), (1, 1), (0, 0)):
        replica = _replica(n, bonded)
        found = component.measure(*replica)
        require(isinstance(found, Mapping) and found, f"measure() returned {found!r}; expected names with numbers")
        require(all(isinstance(name, str) for name in found), f"names {list(found)} are not all str")
        values = {name: np.asarray(value) for name, value in found.items()}
        kinds = {name: value.dtype.kind for name, value in values.items()}
        require(set(kinds.values()) <= set("fiub"), f"not numbers: {kinds}")
        again = {name: np.asarray(value).tobytes() for name, value in component.measure(*replica).items()}
        require(again == {name: value.tobytes() for name, value in values.items()}, "a second call gave another result")
        shapes[n, bonded] = {name: value.shape for name, value in values.items()}
    first = next(iter(shapes.values()))
    for (n, bonded), shape in shapes.items():
        require(shape == first, f"{bonded} of {n} sites bonded: {shape}, expected {first} as for the other replicas")
