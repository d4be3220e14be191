"""Checks of observables and laws of rupture: what they must not notice, what they must, and what must follow from a
change of units."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
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
    held,
    numbers,
    tiled,
    treats,
    with_states,
)
from chemage.testing.trials import TRIALS, Trial

check_observable, check_rupture = whole(Observable), whole(Rupture)

#: rounding of sums in another order
SAME: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}


#: energies of a lattice, as far as it has them
ENERGIES = ("forming", "breaking", "coupling")


def rescaled_replica(
    replica: Bonded,
    *,
    temperature: float = 1.0,
    pixel: float = 1.0,
    pressure: float = 1.0,
    energy: float = 1.0,
    time: float = 1.0,
) -> Bonded:
    """The replica with temperature, lengths, pressures, energies and times that are so many times as large; with the
    energies of its chemistry."""
    contact, lattice, history = replica.contact, replica.lattice, replica.history
    parts = {
        **dict.fromkeys(ENERGIES, energy),
        "pressure": pressure,
        "positions": pixel,
    }
    of_lattice = {
        name: factor * values
        for name, factor in parts.items()
        if (values := getattr(lattice, name)) is not None
    }
    if lattice.origin is not None:
        of_lattice["origin"] = tuple(pixel * one for one in lattice.origin)
    frequency = lattice.attempt_frequency / time
    of_contact = {
        "pixel_size": pixel * contact.pixel_size,
        "pressure": pressure * contact.pressure,
        "load": pressure * pixel**2 * contact.load,
        "modulus": pressure * contact.modulus,
    }
    chemistry: Any = replica.chemistry
    for name in ("forming", "breaking", "interaction"):
        if (part := getattr(chemistry, name)) is not None:
            own = {
                one: energy * getattr(part, one) for one in type(part).model_fields
            }
            chemistry = chemistry.replace(**{name: part.replace(**own)})
    chemistry = chemistry.replace(
        bond_force=energy / pixel * chemistry.bond_force,
        attempt_frequency=frequency,
        activation_volume=energy / pressure * chemistry.activation_volume,
    )
    return replace(
        changed(
            replica,
            contact=of_contact,
            lattice={
                **of_lattice,
                "pixel_size": pixel * lattice.pixel_size,
                "attempt_frequency": frequency,
            },
            history={
                "temperature": temperature * history.temperature,
                "hold_times": time * history.hold_times,
                "time": time * history.time,
            },
        ),
        chemistry=chemistry,
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
    fine, plain = Trial(pixels=(9, 7), spacing=0.5), Trial()
    changes: dict[str, tuple[Trial, Callable[[Bonded], Bonded]]] = {
        "at another temperature": (
            plain,
            partial(rescaled_replica, temperature=1.05),
        ),
        "with other bonds": (
            plain,
            lambda replica: held(replica, replica.hold_times, [0, 8, 13, 13, 11]),
        ),
        "under another pressure": (fine, partial(rescaled_replica, pressure=1.3)),
        "in pixels of another size": (plain, partial(rescaled_replica, pixel=1.4)),
        "with higher barriers": (plain, partial(rescaled_replica, energy=1.1)),
        "at other times": (plain, partial(rescaled_replica, time=1.7)),
        "elsewhere on the surface": (
            plain,
            lambda replica: shifted(with_states(replica), (3, 2)),
        ),
    }
    for number, (what, (trial, change)) in enumerate(changes.items(), 31):
        replica = with_states(trial.but(sites=number, bonded=19).replica())
        other = change(replica)
        yield f"{number} sites", replica
        yield (
            f"{number} sites {what}",
            with_states(other) if other.history.states is None else other,
        )
    for other in (plain.but(breaking=False), plain.but(coupled=False)):
        yield repr(other), with_states(other.but(sites=39).replica())


def _on_pixels(pressures: np.ndarray, size: float, periodic: bool) -> Bonded:
    """A replica with sites every 0.5 nm, under the pressures (4, 4) of squares of 1 nm, in pixels of ``size`` nm."""
    replica = Trial().replica()
    pressure, fine = (
        np.kron(pressures, np.ones((round(1 / edge),) * 2)) for edge in (size, 0.5)
    )
    of_sites = {
        "pressure": fine.ravel()[replica.lattice.sites],
        "origin": (0.0, 0.0),
    }
    return replace(
        changed(
            replica,
            contact={
                "pressure": pressure,
                "pixel_size": size,
                "load": float(pressures.sum()),
                "periodic": periodic,
            },
            lattice=of_sites if size != 0.5 else {},
        ),
        chemistry=replica.chemistry.replace(site_density=4.0),
    )


def _blocks(values: np.ndarray, axis: int | None, repeats: int) -> list[np.ndarray]:
    """The first and the last of the ``repeats`` values of every hold time; themselves where they have no times."""
    if axis is None:
        return [values]
    return [
        np.take(values, np.arange(at, values.shape[axis], repeats), axis)
        for at in (0, repeats - 1)
    ]


def _time_axis(
    component: Asked, name: str, values: np.ndarray, times: int
) -> int | None:
    """The dimension of what has one value for each hold time, as far as that is known."""
    output = component.outputs.get(name)
    if isinstance(component, Observable) and output is not None:
        return output.dims.index(HOLD_TIME) if HOLD_TIME in output.dims else None
    return values.shape.index(times) if times in values.shape else None


def _same(one: np.ndarray, two: np.ndarray) -> bool:
    return one.shape == two.shape and np.allclose(one, two, equal_nan=True, **SAME)


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

    def sites_need_not_be_pixels(self) -> None:
        """Where sites are smaller or larger than the pixels of the contact, pressures count as they are on the
        sites."""
        component = self.component
        if isinstance(component, Rupture) and component.sampled:
            return
        pressures = np.random.default_rng(7).uniform(0.3, 3.0, (4, 4))
        for size, periodic in ((0.25, True), (1.0, False)):
            before, after, its, moved = (
                numbers(
                    component,
                    _on_pixels(given, edge, periodic),
                    f"sites every 0.5 nm in pixels of {edge:g} nm",
                )
                for edge in (0.5, size)
                for given in (pressures, np.roll(pressures, 5))
            )
            for name, one in before.items():
                if one.shape != its[name].shape:
                    continue  # a map of the pixels
                # the number of pixels may count in an observable
                expected, found = (
                    (one, its[name])
                    if isinstance(component, Rupture)
                    else (after[name] - 1.0 * one, moved[name] - 1.0 * its[name])
                )
                require(
                    _same(expected, found),
                    f"{name}: {found} in pixels of {size:g} nm, but {expected} in pixels of 0.5 nm, the size of the "
                    "sites: the pressures on the sites are lattice.pressures(contact); lattice.sites are flat indices "
                    "on the grid lattice.pixels, which need not be that of the contact",
                )
        for trial in TRIALS:
            if treats(component, replica := trial.replica()):
                numbers(component, replica, repr(trial))

    def number_of_hold_times_does_not_matter(self) -> None:
        """A single hold time, or a hundred between which nothing happens, give the same as a few."""
        component = self.component
        if isinstance(component, Rupture) and component.sampled:
            return  # each hold time has random numbers of its own
        replica = Trial().replica()
        for times, bonds, repeats in (
            ([10.0], [17], (1, 2)),
            (replica.hold_times, [0, 6, 11, 17, 25], (2, 20)),
        ):
            count = [len(times) * repeat for repeat in repeats]
            few, many = (
                numbers(
                    component,
                    held(
                        replica, np.repeat(times, repeat), np.repeat(bonds, repeat)
                    ),
                    f"{len(times) * repeat} hold times",
                )
                for repeat in repeats
            )
            for name, one in few.items():
                axis = _time_axis(component, name, one, count[0])
                two = _blocks(many[name], axis, repeats[1])
                for these, those in zip(
                    _blocks(one, axis, repeats[0]), two, strict=True
                ):
                    require(
                        _same(these, those),
                        f"{name} of {count[1]} hold times is {those}, and of {count[0]} with the same bonds {these}",
                    )

    def sites_may_be_many(self) -> None:
        """More than 65,536 sites count as fewer do: what is twice as much, or the same, on two copies of a contact is
        so on two copies of a thousand of them."""
        component = self.component
        if isinstance(component, Rupture) and component.sampled:
            return
        replica = Trial().replica()
        replica = with_states(replica) if component.states else replica
        one, two, many, more = (
            numbers(component, tiled(replica, copies), f"{40 * copies} sites")
            for copies in (1, 2, 1000, 2000)
        )
        for name, values in one.items():
            if not values.shape == two[name].shape == more[name].shape:
                continue
            for factor in (1.0, 2.0):
                if _same(two[name], factor * values):
                    require(
                        np.allclose(
                            more[name], factor * many[name], 1e-6, equal_nan=True
                        ),
                        f"{name} of 80,000 sites is {more[name]}, of 40,000 {many[name]}, although it is {two[name]} "
                        f"of 80 and {values} of 40",
                    )
                    break


class ObservedHistoryChecks(Checks[Observable], of=Observable):
    """What an observable must notice of a history."""

    def _over_time(self, bonds: Sequence[int], passed: Any = 0) -> dict[str, Any]:
        """What is measured with these bonds at five hold times: (values, dimension of the hold times)."""
        replica = held(Trial().replica(), Trial().times, bonds, passed)
        values = numbers(
            self.component, replica, f"{list(bonds)} bonds at the hold times"
        )
        return {
            name: (one, _time_axis(self.component, name, one, len(bonds)))
            for name, one in values.items()
        }

    def every_hold_time_has_its_bonds(self) -> None:
        """What has a value for each hold time, and depends on the bonds at the last one, depends at another one on the
        bonds there."""
        plain, last, third = (
            self._over_time(bonds)
            for bonds in ((0, 8, 17, 17, 25), (0, 8, 17, 17, 0), (0, 8, 0, 17, 25))
        )
        for name, (values, axis) in plain.items():
            if axis is None:
                continue
            depends = [
                not _same(
                    np.take(values, at, axis), np.take(other[name][0], at, axis)
                )
                for other, at in ((last, -1), (third, 2))
            ]
            require(
                depends != [True, False],
                f"{name} at the third of five hold times is {np.take(values, 2, axis)} with 17 bonds and without any, "
                "but at the last one it depends on them: history.state are the bonds at the last hold time; set states "
                "= True, history.states are those at each",
            )

    def broken_bonds_do_not_count(self) -> None:
        """Bonds that have broken are none, unless the output is about those formed so far, and its name or description
        says so: "formed", "ever" or "event"."""
        bonds = (0, 8, 17, 17, 17)
        plain, none, broken, passed = (
            self._over_time(*given)
            for given in (
                (bonds,),
                ([0] * 5,),
                ((*bonds[:4], 0),),
                ([0] * 5, bonds),
            )
        )
        for name, (_, axis) in plain.items():
            output = self.component.outputs.get(name)
            said = f"{name} {output.description if output else ''}".lower()
            if {"formed", "ever", "event", "events"} & {*re.split("[^a-z]+", said)}:
                continue
            for found, at in (
                (passed, None),
                *([(broken, -1)] if axis is not None else []),
            ):
                one, two, without = (
                    of[name][0] if at is None else np.take(of[name][0], at, axis)
                    for of in (plain, found, none)
                )
                require(
                    _same(one, without) or not _same(one, two),
                    f"{name} is {one} with 17 bonds, and just that after all of them have broken; history.formed are "
                    'those formed so far, history.bonds those there are (if it is about the former, say "formed" in '
                    "the description)",
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
        self._require_units("a size of pixels", length=2.0, stress=1 / 8)

    def energies_have_their_unit(self) -> None:
        """With all energies, k_BT and stresses twice as large, in the options too, an output in eV is twice as large,
        and a number stays as it is: no energy and no temperature is assumed."""
        self._require_units("a temperature, an energy or a stress", stress=2.0)

    def times_have_their_unit(self) -> None:
        """With all times twice as long, attempts half as frequent, and the options likewise, an output in s is twice as
        large, and a number stays as it is."""
        self._require_units("an attempt frequency or a time", time=2.0)

    def _require_units(self, assumed: str, **scale: float) -> None:
        """Require the factors of ``scale``; powers of two, which leave numbers without a unit as they are, bit by
        bit."""
        try:
            other = self.rescaled(**scale)
        except InputError:
            return
        stress, length = scale.get("stress", 1.0), scale.get("length", 1.0)
        factors = {
            "energy": stress * length**3,
            "pressure": stress,
            "pixel": length,
        }
        factors |= {
            "temperature": factors["energy"],
            "time": scale.get("time", 1.0),
        }
        words = ", ".join(
            f"{name} times {factor:g}"
            for name, factor in factors.items()
            if factor != 1.0
        )
        for trial in UNITS:
            small = trial.replica()
            one = numbers(self.component, small, repr(trial))
            two = numbers(
                other, rescaled_replica(small, **factors), f"{trial}, {words}"
            )
            for name, output in self.component.outputs.items():
                its = dimensions(output.unit)
                if its.others or one[name].shape != two[name].shape:
                    continue
                factor = its.factor(**scale)
                require(
                    _same(two[name], one[name] * factor),
                    f"{trial}: with {words}, output {name!r} in {output.unit or '1'} is {two[name]} in place of "
                    f"{one[name]}; expected {factor:g} times as much. Is {assumed} assumed, or the unit another? What "
                    "is compared with an energy, a pressure, a length or a time is best an option with a unit",
                )


#: in which units are changed
UNITS = (
    Trial(),
    Trial(breaking=False, hold_times=(10.0,)),
    Trial(pixels=(9, 7), spacing=0.5, temperature=200.0, attempt_frequency=1e12),
)


class RuptureUnitChecks(Checks[Rupture], of=Rupture):
    """What follows from a change of units."""

    def questions(self) -> Questions:
        for what, replica in _replicas():
            yield what, lambda law, replica=replica: law.force(replica)

    def forces_have_their_unit(self) -> None:
        """With all energies, k_BT, pressures and forces three times as large, in the options too, the force is: no
        energy, temperature and stress is assumed. A law that gives a force of its own, whatever the barriers are,
        passes, as does one that draws random numbers."""
        self._require_units(
            "energies, k_BT, pressures and forces three times as large",
            {"temperature": 3.0, "pressure": 3.0, "energy": 3.0},
            stress=3.0,
        )

    def times_have_their_unit(self) -> None:
        """With all times twice as long, attempts half as frequent and rates of options half as large, the force is the
        same."""
        self._require_units("all times twice as long", {"time": 2.0}, time=2.0)

    def _require_units(
        self, words: str, factors: dict[str, float], **scale: float
    ) -> None:
        """Require that the force grows with the stresses. What differs is compared with what each of the ``factors``
        changes by itself: an approximation moves the force by a small part of that, and what is assumed by all of
        it."""
        if self.component.sampled:
            return
        try:
            other = self.rescaled(**scale)
        except InputError:
            return
        for trial in UNITS:
            replica = trial.replica()
            if not treats(self.component, replica):
                continue
            plain = force_of(self.component, replica, repr(trial))
            expected = scale.get("stress", 1.0) * plain

            def asked(
                law: Rupture, *names: str, replica: Bonded = replica
            ) -> np.ndarray:
                scaled = rescaled_replica(
                    replica, **{name: factors[name] for name in names}
                )
                return force_of(law, scaled, words)

            found, without = asked(other, *factors), {}
            if _same(found, expected) or np.array_equal(found, plain):
                continue
            for name in factors:
                without[name] = asked(other, *(factors.keys() - {name}))
            first = next(iter(factors))
            alone = asked(self.component, first)
            effect = np.abs(alone - plain) + np.abs(without[first] - expected)
            assumed = (
                "an attempt frequency or a time"
                if "time" in factors
                else "a stress, with which pressures are compared,"
                if _same(without["pressure"], expected)
                else "a temperature (it is bonded.temperature)"
                if np.array_equal(without["temperature"], found)
                else "an energy"
            )
            require(
                bool((np.abs(found - expected) <= 1e-4 * effect).all()),
                f"{trial}: with {words} the force is {found} nN in place of {expected} nN; is {assumed} assumed? Make "
                "it an option with a unit, or take it from what is given",
            )

    def hydroxyls_are_drawn_already(self) -> None:
        """The sites that are given react: the hydroxylation of the chemistry does not count once more."""
        replica = Trial(hydroxylation=0.5).replica()
        if self.component.sampled or not treats(self.component, replica):
            return
        full = replace(
            replica, chemistry=replica.chemistry.replace(hydroxylation=1.0)
        )
        one, two = (force_of(self.component, given) for given in (replica, full))
        require(
            _same(one, two),
            f"the force of the same bonds is {one} nN with hydroxylation = 0.5 and {two} nN with 1; the lattice has just "
            "the sites that react",
        )
