"""Methods of ageing that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

import dataclasses
import time
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import calls, caught_by, mutant
from pydantic import Field

import chemage as ca
from chemage import InputError, testing
from chemage.plugin import EV_PER_GPA_NM3, KB, AgedBonds, AgeingMethod

pytestmark = pytest.mark.long


class Means(AgeingMethod):
    """The mean of independent sites whose bonds last."""

    kind = "means"
    replicates = False

    def check(self, chemistry, engine):
        if chemistry.breaking is not None or chemistry.interaction is not None:
            raise InputError("ageing 'means' is about sites by themselves whose bonds last; use another method")

    def age(self, request):
        chemistry, times = request.chemistry, request.hold_times
        barriers = chemistry.forming.quantile((np.arange(2000) + 0.5) / 2000)
        pressures, counts = np.unique(chemistry.sites_of(request.contact).pressure, return_counts=True)
        bonds = np.zeros(times.size)
        for pressure, count in zip(pressures, counts, strict=True):
            energy = np.maximum(barriers - chemistry.activation_volume * EV_PER_GPA_NM3 * float(pressure), 0.0)
            rates = chemistry.attempt_frequency * np.exp(-energy / (KB * request.temperature))
            bonds += count * np.array([np.mean(-np.expm1(-rates * time)) for time in times])
        return AgedBonds(
            bonds=chemistry.hydroxylation * bonds[None], sites=np.array([chemistry.hydroxylation * counts.sum()])
        )


class Drawn(AgeingMethod):
    """The kinetics of every site, replica by replica."""

    kind = "drawn"
    first: ClassVar[int] = 0

    def age(self, request):
        bonds, sites = [], []
        for replica in range(request.replicas):
            seed = np.random.SeedSequence(request.seed, spawn_key=(self.first + replica,))
            lattice = ca.plugin.build_lattice(request.chemistry, request.contact, seed)
            history = ca.plugin.run_kinetics(
                request.engine, lattice, request.hold_times, temperature=request.temperature, seed=seed
            )
            bonds.append(history.bonds)
            sites.append(lattice.sites.size)
        return AgedBonds(bonds=np.array(bonds), sites=np.array(sites), events=np.array(bonds)[:, -1])


class Quick(Means):
    """Leaves out a thousandth where it is told to be quick."""

    speed_only: ClassVar[tuple[str, ...]] = ("quick",)
    quick: int = Field(default=0, ge=0)
    """whether to leave it out"""

    def age(self, request):
        found = super().age(request)
        return dataclasses.replace(found, bonds=found.bonds * (1 - 1e-3 * min(self.quick, 1)))


def changed(base: Any, name: str, change: Any, **attributes: Any) -> Any:
    """A method whose answer is changed."""

    def age(self, request):
        found = base.age(self, request)
        return dataclasses.replace(found, **change(found, request))

    return mutant(base, name, age=age, **attributes)()


def _by_count(found, request):
    """Another seed where there are more replicas."""
    return {"bonds": found.bonds[::-1], "sites": found.sites[::-1], "events": found.events[::-1]}


def _overwriting(found, request):
    pressure = request.contact.pressure
    pressure.setflags(write=True)
    pressure.flat[0] += 1e-12
    pressure.setflags(write=False)
    return {}


def _pixels_for_sites(found, request):
    share = request.contact.sites.size / max(request.chemistry.sites_of(request.contact).sites.size, 1)
    return {"bonds": share * found.bonds, "sites": share * found.sites}


_kelvin: list[float] = []
_times = np.zeros(1000)


def _temperature_before(self, request):
    last = _kelvin[-1] if _kelvin else request.temperature
    _kelvin.append(request.temperature)
    return Means.age(self, dataclasses.replace(request, temperature=last))


def _in_one_array(self, request):
    """All threads work in one array."""
    mine = _times[: request.hold_times.size]
    mine[:] = request.hold_times
    time.sleep(2e-3)
    return Means.age(self, dataclasses.replace(request, hold_times=mine.copy()))


WHOLE = "bonds_are_those_of_the_whole_contact"
WRONG: dict[str, tuple[Any, str]] = {
    "breaking left out": (lambda: mutant(Means, "lasting", check=lambda *given: None)(), WHOLE),
    "pixels for sites": (lambda: changed(Means, "pixels", _pixels_for_sites), WHOLE),
    "no bonds at the first hold time": (
        lambda: changed(Means, "first", lambda f, r: {"bonds": f.bonds * (np.arange(r.hold_times.size) > 0)}),
        WHOLE,
    ),
    "64 hold times at most": (
        lambda: changed(
            Means, "most", lambda f, r: {"bonds": f.bonds[:, np.minimum(np.arange(r.hold_times.size), 63)]}
        ),
        WHOLE,
    ),
    "the temperature of the call before": (
        lambda: mutant(Means, "before", age=_temperature_before)(),
        WHOLE,
    ),
    "threads that share an array": (lambda: mutant(Means, "shared", age=_in_one_array)(), "calls_are_independent"),
    "one row for all replicas": (
        lambda: changed(Drawn, "row", lambda f, r: {"bonds": f.bonds[:1], "sites": f.sites[:1], "events": None}),
        "gives_aged_bonds",
    ),
    "a curve without replicas": (
        lambda: changed(Means, "flat", lambda f, r: {"bonds": f.bonds[0]}),
        "gives_aged_bonds",
    ),
    "an error without a source": (
        lambda: changed(Means, "source", lambda f, r: {"errors": {"table": 0.01 + 0 * r.hold_times}}),
        "gives_aged_bonds",
    ),
    "one error for all times": (
        lambda: changed(
            Means, "scalar", lambda f, r: {"errors": {"table": np.array(0.1)}, "error_sources": {"table": "a guess"}}
        ),
        "gives_aged_bonds",
    ),
    "more bonds than sites": (
        lambda: changed(Means, "many", lambda f, r: {"bonds": f.bonds + 1.0}),
        "gives_aged_bonds",
    ),
    "bonds of half the contact": (
        lambda: changed(Means, "half", lambda f, r: {"bonds": 0.5 * f.bonds}),
        "bonds_are_those_of_the_whole_contact",
    ),
    "every site reacts": (
        lambda: changed(Means, "sites", lambda f, r: {"sites": f.sites / r.chemistry.hydroxylation}),
        "bonds_are_those_of_the_whole_contact",
    ),
    "bonds as a fraction": (
        lambda: changed(Means, "fraction", lambda f, r: {"bonds": f.bonds / np.maximum(f.sites[:, None], 1)}),
        "bonds_are_those_of_the_whole_contact",
    ),
    "depends on the threads": (
        lambda: changed(Means, "threads", lambda f, r: {"bonds": f.bonds * (1 - 1e-9 * r.threads)}),
        "answers_are_repeatable",
    ),
    "depends on earlier calls": (
        lambda: changed(Means, "calls", lambda f, r: {"bonds": f.bonds * (1 - 1e-12 * next(calls))}),
        "calls_are_independent",
    ),
    "changes the contact": (lambda: changed(Means, "overwriting", _overwriting), "calls_are_independent"),
    "replicas in reverse order": (lambda: changed(Drawn, "reverse", _by_count), "fewer_replicas_are_the_first_ones"),
    "quick and different": (lambda: Quick(), "options_count"),
}


#: found by checks that call a method many times
SLOW = {"depends on the threads", "quick and different", "depends on earlier calls"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] if name in SLOW else []) for name in WRONG]
)
def test_a_wrong_method_of_ageing(name):
    make, check = WRONG[name]
    found, said = caught_by(make())
    assert found == check, said


def test_right_methods_of_ageing_pass():
    testing.check_ageing_method(Means(), all=True)
    testing.check_ageing_method(Drawn(), all=True)
