"""Rupture laws that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

import time
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest
from kit_examples import Breaking, calls, caught_by, mutant

from chemage import testing
from chemage.plugin import KB, Energy, Length, Pressure, Rupture, Unit

pytestmark = pytest.mark.long

#: what a law that sums over the bonded sites does wrong -> the check that finds it
NM = 0.1602176634


def law(name: str, force: Any, **attributes: Any) -> Any:
    """The law of ``Breaking`` with another force."""
    return mutant(Breaking, name, force=lambda self, bonded: force(self, bonded), **attributes)()


def right(self: Any, bonded: Any) -> Any:
    return Breaking.force(self, bonded)


class Ageless(Rupture):
    """The same force for every bond, without states."""

    kind = "ageless"

    def force(self, bonded):
        return 2.0 * bonded.bonds


def _barriers(bonded):
    return bonded.lattice.forming if bonded.lattice.breaking is None else bonded.lattice.breaking


def _written(self, bonded):
    counts = bonded.bonds
    counts.setflags(write=True)
    counts[:] = np.sort(counts)[::-1]
    counts.setflags(write=False)
    return 2.0 * counts


def _with_nan(self, bonded):
    with np.errstate(invalid="ignore", divide="ignore"):
        return right(self, bonded) / bonded.bonds * bonded.bonds


_totals: list[float] = [0.0]


def _running(self, bonded):
    _totals[0] += 1e-3
    return right(self, bonded) * (1 + _totals[0])


class Coarse(Breaking):
    """Leaves out every second site where it is told to be quick."""

    speed_only: ClassVar[tuple[str, ...]] = ("quick",)
    quick: bool = False
    """whether to leave them out"""

    def force(self, bonded):
        found = super().force(bonded)
        return 0.5 * found if self.quick else found


RUPTURES: dict[str, tuple[Any, str]] = {
    "one number": (lambda: law("one", lambda s, b: right(s, b)[-1]), "forces_are_forces"),
    "a force per site": (lambda: law("site", lambda s, b: _barriers(b) * NM), "forces_are_forces"),
    "nan without bonds": (lambda: law("nan", _with_nan), "forces_are_forces"),
    "negative": (lambda: law("negative", lambda s, b: -right(s, b)), "forces_are_forces"),
    "text": (lambda: law("text", lambda s, b: [f"{x:.2f}" for x in right(s, b)]), "forces_are_forces"),
    "states it did not ask for": (lambda: law("unasked", right, states=False), "forces_are_forces"),
    "adhesion as well": (lambda: law("adhesion", lambda s, b: right(s, b) + 5.0), "no_bonds_no_force"),
    "in N": (lambda: law("newton", lambda s, b: 1e-9 * right(s, b)), "forces_are_in_nn"),
    "in pN": (lambda: law("piconewton", lambda s, b: 1e3 * right(s, b)), "forces_are_in_nn"),
    "needs breaking barriers": (
        lambda: law("breaking", lambda s, b: b.states @ (b.lattice.breaking * NM)),
        "parts_may_be_absent",
    ),
    "needs an interaction": (
        lambda: law("neighbours", lambda s, b: right(s, b) * (1.0 + 0.0 * b.lattice.neighbours.shape[1])),
        "parts_may_be_absent",
    ),
    "needs two hold times": (
        lambda: law("rate", lambda s, b: right(s, b) + 0.0 * (b.hold_times[1] - b.hold_times[0])),
        "parts_may_be_absent",
    ),
    "the mean barrier of the bonds at the end": (
        lambda: mutant(
            Ageless,
            "end",
            force=lambda self, b: (
                b.bonds * (_barriers(b)[b.history.state].mean() if b.history.state.any() else 0.0) * NM
            ),
        )(),
        "later_times_do_not_matter",
    ),
    "divided by the last force": (
        lambda: law("normalised", lambda s, b: right(s, b) / max(float(right(s, b)[-1]), 1e-9)),
        "later_times_do_not_matter",
    ),
    "the barriers of all sites": (
        lambda: law("all", lambda s, b: b.bonds * (_barriers(b).mean() if _barriers(b).size else 0.0) * NM),
        "unbonded_sites_do_not_matter",
    ),
    "the barriers in another order": (
        lambda: law("order", lambda s, b: b.states @ (_barriers(b)[::-1] * NM)),
        "unbonded_sites_do_not_matter",
    ),
    "a total over replicas": (lambda: law("running", _running), "calls_are_independent"),
    "a force by call": (
        lambda: law("call", lambda s, b: right(s, b) * (1 + 1e-12 * next(calls))),
        "calls_are_independent",
    ),
    "writes into the history": (lambda: mutant(Ageless, "writes", force=_written)(), "calls_are_independent"),
    "quick and different": (lambda: Coarse(), "options_count"),
}


@pytest.mark.parametrize("name", RUPTURES)
def test_a_wrong_rupture_law(name):
    make, check = RUPTURES[name]
    found, said = caught_by(make())
    assert found == check, said


def test_right_rupture_laws_pass():
    testing.check_rupture(Ageless())
    testing.check_rupture(Breaking(), all=True)


# -- under other conditions -------------------------------------------------------------------------------------------


class Loaded(Rupture):
    """Every bond at its most probable force under a load that rises at a constant rate; pressed bonds are stronger."""

    kind = "loaded"
    states = True

    length: Length = 0.1
    """distance to the barrier, nm"""
    rate: Annotated[float, Unit("nN/s", gt=0)] = 1e3
    """rate at which the force rises, nN/s"""
    stiffening: Pressure = 100.0
    """pressure that doubles the strength, GPa"""
    barrier: Energy = 1.1
    """barrier where the chemistry has none, eV"""

    def strength(self, bonded, kelvin=None, nu=None, pressure=None, stiffening=None, barrier=None):
        lattice, kt = bonded.lattice, KB * (kelvin or bonded.temperature)
        barriers = (
            np.full(lattice.sites.size, barrier or self.barrier) if lattice.breaking is None else lattice.breaking
        )
        rise = kt * NM / (self.rate * self.length)
        energy = np.maximum(barriers - kt * np.log((nu or lattice.attempt_frequency) * rise), 0.0)
        pressure = lattice.pressures(bonded.contact) if pressure is None else pressure
        return energy * NM / self.length * (1 + pressure / (stiffening or self.stiffening))

    def force(self, bonded):
        return bonded.states @ self.strength(bonded)


class Tabulated(Loaded):
    """The strength falls with the cube root of the thermal energy: interpolated between barriers of a table."""

    kind = "tabulated"

    def strength(self, bonded, **assumed):  # pyright: ignore[reportIncompatibleMethodOverride]
        lattice, kt = bonded.lattice, KB * bonded.temperature
        barriers = np.full(lattice.sites.size, self.barrier) if lattice.breaking is None else lattice.breaking
        table = np.linspace(0.01, 6.0, 4000)
        rise = kt * NM / (self.rate * self.length)
        share = np.clip(kt * np.log(lattice.attempt_frequency * rise) / table, 0.0, 1.0)
        strength = np.interp(barriers, table, table * (1 - share ** (2 / 3))) * NM / self.length
        return strength * (1 + lattice.pressures(bonded.contact) / self.stiffening)


_kept: dict[Any, Any] = {}
_work = np.zeros(100_000)


def loaded(name: str, **given: Any) -> Any:
    """``Loaded`` with some of its arguments as functions of what it receives."""

    def force(self, bonded):
        return bonded.states @ self.strength(bonded, **{k: f(bonded) for k, f in given.items()})

    return mutant(Loaded, name, force=force)()


def forced(name: str, change: Any) -> Any:
    """``Loaded`` whose force is passed through ``change``."""
    return mutant(Loaded, name, force=lambda self, bonded: change(Loaded.force(self, bonded), bonded))()


def _before(bonded):
    kelvin, _kept["kelvin"] = _kept.get("kelvin", bonded.temperature), bonded.temperature
    return kelvin


def _shared(bonded):
    found = _work[: bonded.lattice.sites.size]
    found[:] = bonded.lattice.pressures(bonded.contact)
    time.sleep(1e-3)
    return found


UNIT, TIMES = "forces_have_their_unit", "number_of_hold_times_does_not_matter"
CONDITIONS: dict[str, tuple[Any, str]] = {
    "the pressure of the pixel with the number of the site": (
        lambda: loaded("by pixel", pressure=lambda b: b.contact.pressure.ravel()[b.lattice.sites]),
        "sites_need_not_be_pixels",
    ),
    "100 GPa assumed": (lambda: loaded("stiff", stiffening=lambda b: 100.0), UNIT),
    "300 K assumed where bonds last": (
        lambda: loaded("warm", kelvin=lambda b: 300.0 if b.lattice.breaking is None else None),
        UNIT,
    ),
    "1.1 eV assumed where bonds last": (lambda: loaded("even", barrier=lambda b: 1.1), UNIT),
    "a temperature that is 0.15 K too high": (
        lambda: loaded("celsius", kelvin=lambda b: b.temperature + 0.15),
        UNIT,
    ),
    "1e13 Hz assumed": (lambda: loaded("fast", nu=lambda b: 1e13), "times_have_their_unit"),
    "hydroxylation once more": (
        lambda: forced("hydroxyl", lambda f, b: f * b.chemistry.hydroxylation),
        "hydroxyls_are_drawn_already",
    ),
    "no force at the first hold time": (lambda: forced("first", lambda f, b: np.append(0.0, f[1:])), TIMES),
    "64 hold times at most": (
        lambda: forced("most", lambda f, b: f[np.minimum(np.arange(f.size), 63)]),
        TIMES,
    ),
    "bonds formed for bonds": (
        lambda: mutant(Ageless, "formed", force=lambda self, b: 2.0 * b.history.formed)(),
        "no_bonds_no_force",
    ),
    "numbers of sites in 16 bits": (
        lambda: loaded(
            "short", pressure=lambda b: b.lattice.pressures(b.contact)[np.arange(b.lattice.sites.size).astype("u2")]
        ),
        "sites_may_be_many",
    ),
    "the temperature of the call before": (lambda: loaded("before", kelvin=_before), "calls_are_independent"),
    "threads that share an array": (lambda: loaded("shared", pressure=_shared), "calls_are_independent"),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_rupture_law_that_is_wrong_under_other_conditions(name, caught):
    make, check = CONDITIONS[name]
    _kept.clear()
    found, said = caught(make(), check)
    assert found == check, said
    if name == "100 GPa assumed":
        assert "is a stress, with which pressures are compared, assumed" in said


@pytest.mark.parametrize("law", [Loaded, Tabulated])
def test_a_rupture_law_that_is_right_under_all_conditions_passes(law):
    testing.check_rupture(law(), all=True)
