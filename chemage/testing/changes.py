"""Checks of observables and laws of rupture: what they must not notice, and what must follow from a change of units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from chemage.ageing.observables import Observable
from chemage.contacts.solution import ContactSolution
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import HOLD_TIME
from chemage.friction.role import Bonded, Rupture
from chemage.testing.answers import Questions, asks
from chemage.testing.checks import check_of, dimensions, require, rescaled, whole
from chemage.testing.replicas import TIMES, FinishedReplica, bonded_of, finished, force_of, numbers, with_states

check_observable, check_rupture = whole(Observable), whole(Rupture)

#: rounding of sums in another order
SAME = {"rtol": 1e-9, "atol": 1e-12}


def changed(
    replica: FinishedReplica,
    *,
    temperature: float = 300.0,
    pixel: float = 0.5,
    pressure: float = 1.0,
    energy: float = 1.0,
) -> FinishedReplica:
    """The replica at another temperature (K), with pixels of another size (nm), and with pressures and barriers times
    a factor."""
    contact, lattice, history = replica
    stress = contact.pressure * pressure
    fields: dict[str, Any] = {"pixel_size": pixel, "pressure": stress, "load": float(stress.sum()) * pixel**2}
    contact = contact.model_copy(update=fields | {"modulus": contact.modulus * pressure})
    barriers = {
        name: energy * values
        for name in ("forming", "breaking", "coupling")
        if (values := getattr(lattice, name)) is not None
    }
    lattice = lattice.model_copy(update={"pixel_size": pixel, **barriers})
    update = {"temperature": temperature, "lattice_hash": lattice.digest()}
    return FinishedReplica(contact, lattice, history.model_copy(update=update))


def shifted(replica: FinishedReplica, step: tuple[int, int]) -> FinishedReplica:
    """The same replica on a periodic surface that begins elsewhere, so that its sites are in another order."""
    contact, lattice, history = replica
    nx, ny = contact.shape
    x, y = np.divmod(lattice.sites, ny)
    moved = (x + step[0]) % nx * ny + (y + step[1]) % ny
    order = np.argsort(moved)
    place = np.append(np.argsort(order), -1).astype(np.int32)
    names = ("forming", "breaking", "coupling")
    fields = {name: values[order] for name in names if (values := getattr(lattice, name)) is not None}
    if lattice.neighbours is not None:
        fields["neighbours"] = place[lattice.neighbours[order]]
    pressure = np.ascontiguousarray(np.roll(contact.pressure, step, (0, 1)))
    lattice = lattice.model_copy(update={"sites": moved[order], **fields})
    states = None if history.states is None else history.states[:, order]
    update = {"state": history.state[order], "states": states, "lattice_hash": lattice.digest()}
    return FinishedReplica(
        ContactSolution.fromdict({**contact.todict(), "pressure": pressure}), lattice, history.model_copy(update=update)
    )


def _as_bonded(component: Rupture, replica: FinishedReplica, chemistry: Any) -> Bonded:
    """As the law receives it, with the barriers that the replica has."""
    return Bonded(replica.contact, chemistry, replica.lattice, replica.history)


# -- questions --------------------------------------------------------------------------------------------------------


def _replicas() -> Iterator[tuple[str, FinishedReplica]]:
    changes: dict[str, Callable[[FinishedReplica], FinishedReplica]] = {
        "at another temperature": lambda replica: changed(replica, temperature=317.0),
        "in pixels of another size": lambda replica: changed(replica, pixel=0.7),
        "under another pressure": lambda replica: changed(replica, pressure=1.3),
        "with higher barriers": lambda replica: changed(replica, energy=1.1),
        "elsewhere on the surface": lambda replica: shifted(replica, (3, 2)),
    }
    for number, (what, change) in enumerate(changes.items(), 31):
        plain = with_states(finished(number, 19, times=TIMES))
        yield f"{number} sites", plain
        yield f"{number} sites {what}", change(plain)
    yield "37 sites whose bonds last", with_states(finished(37, 19, times=TIMES, breaking=False))
    yield "37 sites that do not interact", with_states(finished(37, 19, times=TIMES, interacting=False))


@asks(Rupture)
def _laws_asked(component: Rupture) -> Questions:
    for what, replica in _replicas():
        bonded = bonded_of(component, replica)
        yield what, lambda law, bonded=bonded: law.force(bonded)


@asks(Observable)
def _observables_asked(component: Observable) -> Questions:
    for what, replica in _replicas():
        yield what, lambda observable, replica=replica: observable.measure(*replica)


# -- places and orders ------------------------------------------------------------------------------------------------


@check_of(Rupture)
@check_of(Observable)
def _order_of_the_sites_does_not_matter(component: Observable | Rupture) -> None:
    """Where a periodic surface begins, and with it the order of the sites, changes neither a force nor a number."""
    if isinstance(component, Rupture) and component.sampled:  # its random numbers belong to the places
        return
    replica = with_states(finished(40, 17, grid=(9, 7), times=TIMES))
    whole = bonded_of(component, replica) if isinstance(component, Rupture) else None
    if whole is not None:
        replica = FinishedReplica(whole.contact, whole.lattice, replica.history)
    for step in ((3, 2), (5, 6)):
        cases = [replica, shifted(replica, step)]
        if whole is not None:
            assert isinstance(component, Rupture)
            one, two = ({"": force_of(component, _as_bonded(component, case, whole.chemistry), "")} for case in cases)
        else:
            assert isinstance(component, Observable)
            one, two = (numbers(component, case, "40 sites") for case in cases)
        for name in one:
            if isinstance(component, Observable) and not _is_number(component, name, one[name]):
                continue
            require(
                np.allclose(one[name], two[name], equal_nan=True, **SAME),
                f"{name or 'the force'} is {one[name]}, and {two[name]} where the surface begins {step} pixels further "
                "on: sites are in ascending order of their pixels, lattice.sites names the pixel of each, and any of "
                "them may be bonded",
            )


def _is_number(component: Observable, name: str, values: np.ndarray) -> bool:
    """Whether it has no place on the surface, as far as that is known."""
    output = component.outputs.get(name)
    return values.ndim == 0 if output is None else set(output.dims) <= {HOLD_TIME}


# -- units ------------------------------------------------------------------------------------------------------------


@check_of(Observable)
def _lengths_have_their_unit(component: Observable) -> None:
    """On a contact twice as large, with all lengths among the options doubled, an output in nm is twice as large, one
    in 1/nm**2 a quarter."""
    small, large = (finished(40, 17, times=TIMES), changed(finished(40, 17, times=TIMES), pixel=1.0))
    try:
        doubled = rescaled(component, stress=1 / 8, length=2)
    except InputError:
        return
    one, two = numbers(component, small, "pixels of 0.5 nm"), numbers(doubled, large, "pixels of 1 nm")
    for name, output in component.outputs.items():
        mass, length, others = dimensions(output.unit)
        if mass or others or not length or one[name].shape != two[name].shape:
            continue
        require(
            np.allclose(two[name], one[name] * 2**length, equal_nan=True, **SAME),
            f"output {name!r} in {output.unit} is {_shown(one[name])} with pixels of 0.5 nm and {_shown(two[name])} "
            f"with pixels of 1 nm; expected {2**length:g} times as much. Is a size of pixels assumed, or the unit "
            "another?",
        )


@check_of(Rupture)
def _forces_have_their_unit(component: Rupture) -> None:
    """With all energies, k_BT and forces three times as large, in the options too, the force is: no energy and no
    temperature is assumed. A law that gives a force of its own, whatever the barriers are, passes, as does
    one that draws random numbers."""
    if component.sampled:
        return
    try:
        strong = rescaled(component, stress=3)
    except InputError:
        return
    replica = finished(40, 17, times=TIMES)
    before = bonded_of(component, replica)
    after = bonded_of(component, changed(replica, temperature=900.0, pressure=3.0))
    lattice = after.lattice.model_copy(
        update={name: 3 * getattr(before.lattice, name) for name in ("forming", "breaking", "coupling")}
    )
    chemistry = after.chemistry.replace(bond_force=3 * after.chemistry.bond_force)
    one = force_of(component, before, "40 sites")
    two = force_of(strong, Bonded(after.contact, chemistry, lattice, after.history), "40 sites")
    require(
        np.allclose(two, 3 * one, rtol=SAME["rtol"], atol=SAME["atol"]) or np.array_equal(one, two),
        f"with energies, k_BT and forces three times as large the force is {two} nN instead of {3 * one}; is a "
        "temperature or an energy assumed? The temperature is bonded.temperature",
    )


def _shown(values: np.ndarray) -> str:
    return f"{float(values):.4g}" if values.ndim == 0 else f"up to {float(np.nanmax(values, initial=0)):.4g}"
