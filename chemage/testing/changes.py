"""Checks of observables and laws of rupture: what they must not notice, and what must follow from a change of units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from chemage.ageing.observables import Observable
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import HOLD_TIME
from chemage.friction.role import Bonded, Rupture
from chemage.testing.checks import Checks, Questions, dimensions, require, whole
from chemage.testing.replicas import (
    Asked,
    changed,
    force_of,
    numbers,
    with_states,
)
from chemage.testing.trials import Trial

check_observable, check_rupture = whole(Observable), whole(Rupture)

#: rounding of sums in another order
SAME: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}


#: energies of a lattice, as far as it has them
ENERGIES = ("forming", "breaking", "coupling")


def rescaled_replica(
    replica: Bonded,
    *,
    temperature: float = 300.0,
    pixel: float = 0.5,
    pressure: float = 1.0,
    energy: float = 1.0,
) -> Bonded:
    """The replica at another temperature (K), with pixels of another size (nm), and with pressures and energies times a
    factor."""
    contact, lattice = replica.contact, replica.lattice
    stress = contact.pressure * pressure
    energies = {
        name: energy * values
        for name in ENERGIES
        if (values := getattr(lattice, name)) is not None
    }
    of_contact = {
        "pressure": stress,
        "load": float(stress.sum()) * pixel**2,
        "modulus": contact.modulus * pressure,
    }
    return changed(
        replica,
        contact={"pixel_size": pixel, **of_contact},
        lattice={"pixel_size": pixel, **energies},
        history={"temperature": temperature},
    )


def shifted(replica: Bonded, step: tuple[int, int]) -> Bonded:
    """The same replica on a periodic surface that begins elsewhere, so that its sites are in another order."""
    contact, lattice, history = replica.contact, replica.lattice, replica.history
    states: Any = history.states
    place = np.roll(
        np.arange(contact.pressure.size).reshape(contact.shape),
        (-step[0], -step[1]),
        (0, 1),
    ).ravel()
    moved = place[lattice.sites]
    order = np.argsort(moved)
    fields = {
        name: values[order]
        for name in ENERGIES
        if (values := getattr(lattice, name)) is not None
    }
    if lattice.neighbours is not None:
        fields["neighbours"] = np.append(np.argsort(order), -1).astype(np.int32)[
            lattice.neighbours[order]
        ]
    return changed(
        replica,
        contact={"pressure": np.roll(contact.pressure, step, (0, 1))},
        lattice={"sites": moved[order], **fields},
        history={"state": history.state[order], "states": states[:, order]},
    )


# -- questions --------------------------------------------------------------------------------------------------------


def _replicas() -> Iterator[tuple[str, Bonded]]:
    changes: dict[str, Callable[[Bonded], Bonded]] = {
        "at another temperature": lambda replica: rescaled_replica(
            replica, temperature=317.0
        ),
        "in pixels of another size": lambda replica: rescaled_replica(
            replica, pixel=0.7
        ),
        "under another pressure": lambda replica: rescaled_replica(
            replica, pressure=1.3
        ),
        "with higher barriers": lambda replica: rescaled_replica(replica, energy=1.1),
        "elsewhere on the surface": lambda replica: shifted(replica, (3, 2)),
    }
    for number, (what, change) in enumerate(changes.items(), 31):
        plain = with_states(Trial(sites=number, bonded=19).replica())
        yield f"{number} sites", plain
        yield f"{number} sites {what}", change(plain)
    yield (
        "37 sites whose bonds last",
        with_states(Trial(sites=37, breaking=False).replica()),
    )
    yield (
        "37 sites that do not interact",
        with_states(Trial(sites=37, coupled=False).replica()),
    )


class ChangedReplicaChecks(Checks[Asked], of=(Rupture, Observable)):
    """What no observable and no law of rupture may notice."""

    # -- places and orders ---------------------------------------------------------------------------------------------

    def order_of_the_sites_does_not_matter(self) -> None:
        """Where a periodic surface begins, and with it the order of the sites, changes neither a force nor a number."""
        component = self.component
        if (
            isinstance(component, Rupture) and component.sampled
        ):  # its random numbers belong to the places
            return
        replica = with_states(Trial(pixels=(9, 7)).replica())
        one = numbers(component, replica)
        for step in ((3, 2), (5, 6)):
            two = numbers(component, shifted(replica, step))
            for name, values in one.items():
                output = component.outputs.get(name)
                # whether it has no place on the surface, as far as that is known
                number = (
                    values.ndim == 0
                    if output is None
                    else set(output.dims) <= {HOLD_TIME}
                )
                require(
                    np.allclose(values, two[name], equal_nan=True, **SAME)
                    or not (number or isinstance(component, Rupture)),
                    f"{name} is {values}, and {two[name]} where the surface begins {step} pixels further on: sites are "
                    "in ascending order of their pixels, lattice.sites names the pixel of each, and any of them may be "
                    "bonded",
                )


class ObservableUnitChecks(Checks[Observable], of=Observable):
    """What follows from a change of units."""

    def questions(self) -> Questions:
        for what, one in _replicas():
            yield (
                what,
                lambda observable, one=one: observable.measure(
                    one.contact, one.lattice, one.history
                ),
            )

    # -- units ---------------------------------------------------------------------------------------------------------

    def lengths_have_their_unit(self) -> None:
        """On a contact twice as large, with all lengths among the options doubled, an output in nm is twice as large,
        one in 1/nm**2 a quarter."""
        small = Trial().replica()
        try:
            doubled = self.rescaled(stress=1 / 8, length=2)
        except InputError:
            return
        one = numbers(self.component, small)
        two = numbers(doubled, rescaled_replica(small, pixel=1.0), "pixels of 1 nm")
        for name, output in self.component.outputs.items():
            mass, length, others = dimensions(output.unit)
            if mass or others or not length or one[name].shape != two[name].shape:
                continue
            require(
                np.allclose(two[name], one[name] * 2**length, equal_nan=True, **SAME),
                f"output {name!r} in {output.unit} is {one[name]} with pixels of 0.5 nm and {two[name]} with pixels of "
                f"1 nm; expected {2**length:g} times as much. Is a size of pixels assumed, or the unit another?",
            )


class RuptureUnitChecks(Checks[Rupture], of=Rupture):
    """What follows from a change of units."""

    def questions(self) -> Questions:
        for what, replica in _replicas():
            yield what, lambda law, replica=replica: law.force(replica)

    def forces_have_their_unit(self) -> None:
        """With all energies, k_BT and forces three times as large, in the options too, the force is: no energy and no
        temperature is assumed. A law that gives a force of its own, whatever the barriers are, passes, as does
        one that draws random numbers."""
        if self.component.sampled:
            return
        try:
            strong = self.rescaled(stress=3)
        except InputError:
            return
        before = Trial().replica()
        after = rescaled_replica(before, temperature=900.0, pressure=3.0, energy=3.0)
        chemistry = before.chemistry.replace(bond_force=3 * before.chemistry.bond_force)
        one = force_of(self.component, before)
        two = force_of(strong, replace(after, chemistry=chemistry))
        require(
            np.allclose(two, 3 * one, **SAME) or np.array_equal(one, two),
            f"with energies, k_BT and forces three times as large the force is {two} nN instead of {3 * one}; is a "
            "temperature or an energy assumed? The temperature is bonded.temperature",
        )
