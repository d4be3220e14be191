"""Engines that pull a contact and are wrong in one way, each found by the check named for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kit_examples import mutant

from chemage.plugin import BondHistory, PullHistory, registry

EventDriven: Any = registry.current().component("pulling", "event-driven")


def engine(name: str, change: Any) -> Any:
    """`event-driven`, of which ``change(exact, given)`` gives the answer; ``given`` are the arguments by name."""

    def _run(self, lattice, drive, times, temperature, seed, start, partners):
        given = {"lattice": lattice, "drive": drive, "times": times, "temperature": temperature}
        given |= {"seed": seed, "start": start, "partners": partners}
        return change(lambda **changed: EventDriven._run(self, **{**given, **changed}), given)

    return mutant(EventDriven, name, _run=_run)()


def _farther(exact, given):
    drive = given["drive"]
    return exact(drive=drive.replace(transition_distance=1.1 * drive.transition_distance))


def _slow_to_form(exact, given):
    lattice = given["lattice"]
    return exact(lattice=lattice.model_copy(update={"forming": lattice.forming + 0.02}))


def _smooth(exact, given):
    return exact(drive=given["drive"].replace(friction=0.0))


def _by_samples(exact, given):
    seed = given["seed"]
    return exact(seed=seed + 1000 * len(given["times"]) if isinstance(seed, int) else seed)


def _drifts(exact, given):
    pulled = exact()
    if given["drive"].speed > 0:
        return pulled
    return pulled.model_copy(update={"displacement": pulled.displacement + 1e-3 * (given["times"] > 0)})


def _every_second_seed(exact, given):
    seed = given["seed"]
    return exact(seed=seed // 2 if isinstance(seed, int) else seed)


def _lasting(self, lattice, drive, times, **options):
    if lattice.breaking is None:
        lattice = lattice.model_copy(update={"breaking": np.full(lattice.sites.size, 1.1)})
    return EventDriven.run(self, lattice, drive, times, **options)


def _at_300_kelvin(exact, given):
    return exact(temperature=300.0).model_copy(update={"temperature": given["temperature"]})


def _at_ten_terahertz(exact, given):
    return exact(lattice=given["lattice"].model_copy(update={"attempt_frequency": 1e13}))


def _without_the_clock(exact, given):
    """A pull that begins at time 0, also after a hold."""
    start = given["start"]
    if not isinstance(start, BondHistory):
        return exact()
    pulled = exact(start=np.array(start.state))
    counts = {name: getattr(pulled, name) + getattr(start, name)[-1] for name in ("formed", "broken")}
    return pulled.model_copy(update=counts)


def _without_pressure(exact, given):
    partners = given["partners"]
    return exact(partners=partners and partners._replace(shift=np.zeros_like(partners.shift)))


def _same_partners(exact, given):
    return exact(partners=None, drive=given["drive"].replace(partner="kept"))


def _mean_partners(exact, given):
    """All partners have the mean barrier."""
    partners = given["partners"]
    return exact(
        partners=partners and partners._replace(forming=np.full_like(partners.forming, partners.forming.mean()))
    )


def _own_breaking(exact, given):
    """Bonds with all partners break over the barrier of the lattice."""
    partners, breaking = given["partners"], given["lattice"].breaking
    return exact(partners=partners and partners._replace(breaking=np.full(2, breaking.mean())))


def _far_partners(exact, given):
    """Sites keep a partner for a hundred spacings."""
    partners = given["partners"]
    return exact(partners=partners and partners._replace(spacing=100 * partners.spacing))


def _others_at_rest(exact, given):
    pulled = exact()
    forming = pulled.forming + 0.01 * (given["drive"].speed == 0)
    return pulled.model_copy(update={"forming": forming})


def _uncoupled(exact, given):
    return exact(lattice=given["lattice"].model_copy(update={"neighbours": None, "coupling": None}))


def _short_indices(exact, given):
    lattice = given["lattice"]
    if lattice.neighbours is None:
        return exact()
    short = np.where(lattice.neighbours < 0, -1, lattice.neighbours & 0xFFFF).astype(np.int32)
    return exact(lattice=lattice.model_copy(update={"neighbours": short}))


def _peak_of_the_samples(exact, given):
    pulled = exact()
    before = given["start"].peak if isinstance(given["start"], PullHistory) else 0.0
    return pulled.model_copy(update={"peak": max(float(pulled.force.max()), before)})


def _sixty_four_samples(exact, given):
    pulled = exact()
    bonds = pulled.bonds.copy()
    bonds[64:] = bonds[63:64]
    return pulled.model_copy(update={"bonds": bonds, "formed": bonds - pulled.bonds + pulled.formed})


_kept: dict[Any, Any] = {}


def _seed_of_the_first_call(exact, given):
    return exact(seed=_kept.setdefault(("seed", given["lattice"].sites.size), given["seed"]))


def _drive_of_the_first_call(exact, given):
    return exact(drive=_kept.setdefault(("drive", given["lattice"].sites.size), given["drive"]))


def _temperature_of_another_thread(exact, given):
    _kept["temperature"] = given["temperature"]
    given["lattice"].digest()  # what takes a moment
    return exact(temperature=_kept["temperature"]).model_copy(update={"temperature": given["temperature"]})


def _moved_times(self, lattice, drive, times, **options):
    pulled = EventDriven.run(self, lattice, drive, times, **options)
    if isinstance(times, np.ndarray):
        times -= times[0]
        times += 1e-12
    return pulled


def _begins_with_all(self, lattice, drive, times, *, start=None, **options):
    pulled = EventDriven.run(self, lattice, drive, times, start=start, **options)
    if isinstance(start, np.ndarray):
        start[:] = pulled.state
    return pulled


#: wrong in a situation of its own, or in a second call
OTHERS = {
    "300 K": (engine("300 K", _at_300_kelvin), "bonds_break_as_their_barrier_falls"),
    "10 THz": (engine("10 THz", _at_ten_terahertz), "bonds_break_as_their_barrier_falls"),
    "no clock": (engine("no clock", _without_the_clock), "bonds_break_as_their_barrier_falls"),
    "peak of the samples": (engine("peak of the samples", _peak_of_the_samples), "bonds_break_as_their_barrier_falls"),
    "no pressure": (engine("no pressure", _without_pressure), "steady_sliding_is_the_closed_form"),
    "same partners": (engine("same partners", _same_partners), "steady_sliding_is_the_closed_form"),
    "mean partners": (engine("mean partners", _mean_partners), "steady_sliding_is_the_closed_form"),
    "own breaking": (engine("own breaking", _own_breaking), "steady_sliding_is_the_closed_form"),
    "far partners": (engine("far partners", _far_partners), "steady_sliding_is_the_closed_form"),
    "others at rest": (engine("others at rest", _others_at_rest), "at_rest_nothing_moves"),
    "uncoupled": (engine("uncoupled", _uncoupled), "bonds_without_force_are_those_of_a_hold"),
    "short indices": (engine("short indices", _short_indices), "bonds_without_force_are_those_of_a_hold"),
    "64 samples": (engine("64 samples", _sixty_four_samples), "going_on_is_exact"),
    "first seed": (engine("first seed", _seed_of_the_first_call), "seeds_decide_the_noise"),
    "first drive": (engine("first drive", _drive_of_the_first_call), "bonds_break_as_their_barrier_falls"),
    "threads": (engine("threads", _temperature_of_another_thread), "calls_are_independent"),
    "times moved": (mutant(EventDriven, "times moved", run=_moved_times)(), "calls_are_independent"),
    "start moved": (mutant(EventDriven, "start moved", run=_begins_with_all)(), "calls_are_independent"),
}


MUTANTS = {
    "bonds_break_as_their_barrier_falls": engine("farther", _farther),
    "steady_sliding_is_the_closed_form": engine("slow to form", _slow_to_form),
    "spring_bonds_and_friction_balance": engine("smooth", _smooth),
    "going_on_is_exact": engine("by samples", _by_samples),
    "at_rest_nothing_moves": engine("drifts", _drifts),
    "seeds_decide_the_noise": engine("every second seed", _every_second_seed),
    "what_cannot_be_pulled_is_refused": mutant(EventDriven, "lasting", run=_lasting)(),
}


SLOW = {"going_on_is_exact"}


@pytest.mark.parametrize(
    ("check", "component"),
    [
        pytest.param(check, component, id=check, marks=[pytest.mark.long] if check in SLOW else [])
        for check, component in MUTANTS.items()
    ],
)
def test_the_check_finds_it(check, component, caught):
    assert caught(component, check)[0] == check


#: others that the same checks find are quicker
LONG = ("short indices", "mean partners", "own breaking")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in LONG else ()) for name in OTHERS]
)
def test_what_is_wrong_elsewhere_is_found(name, caught):
    component, check = OTHERS[name]
    _kept.clear()
    found, said = caught(component, check)
    assert found == check, said
