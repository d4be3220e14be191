"""Engines that pull a contact and are wrong in one way, each found by the check named for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kit_examples import mutant

from chemage.plugin import registry

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
    return exact(seed=given["seed"] + 1000 * len(given["times"]))


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
