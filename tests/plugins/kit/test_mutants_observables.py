"""Observables, barriers and options that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import Count, Flat, caught_by, mutant
from pydantic import Field

from chemage import testing
from chemage.plugin import KB, Barriers, Energy, Observable, Output

pytestmark = pytest.mark.long


class Map(Observable):
    """A map of the bonds, their number at each hold time, and the mean pressure at the sites that have one."""

    kind = "map"
    figures: ClassVar[Any] = {"bonds-with-time": "Bonds against hold time, the mean of all replicas."}

    def measure(self, contact, lattice, history):
        bonds = np.zeros(lattice.pixels, dtype=np.int64)
        bonds.ravel()[lattice.sites] = history.state
        pressure = lattice.pressures(contact)[history.state]
        return {
            "bond_map": bonds,
            "bonds_at": history.bonds,
            "pressure_of_bonds": pressure.mean() if pressure.size else np.nan,
        }

    def draw(self, figure, axes, results):
        for one in results:
            axes.plot(one.ageing.hold_times, one.ageing.observables["bonds_at"].mean(axis=0), "o-", color=one.color)


def test_a_right_observable_passes():
    testing.check_observable(Map())


class Declared(Map):
    """Declares what it measures."""

    outputs: ClassVar[Any] = {
        "bond_map": Output(("x", "y"), "", "number of bonds"),
        "bonds_at": Output("hold_times", "", "number of bonds"),
        "pressure_of_bonds": Output((), "GPa", "mean pressure where there is a bond"),
    }


class Early(Observable):
    """When half of the bonds had formed, from the states at every hold time."""

    kind = "early"
    states = True
    outputs: ClassVar[Any] = {"half": Output((), "s", "first hold time with half of the bonds")}

    def measure(self, contact, lattice, history):
        return {"half": history.hold_times[np.argmax(2 * history.states.sum(axis=1) >= history.bonds[-1])]}


def test_observables_that_declare_and_ask_for_states_pass():
    testing.check_observable(Declared())
    testing.check_observable(Early(), all=True)


def declaring(name: str, **outputs: Any) -> Any:
    """An observable that measures what ``Declared`` does, with other declarations; None takes one away."""
    changed = {**Declared.outputs, **outputs}
    return mutant(Declared, name, outputs={key: output for key, output in changed.items() if output is not None})()


def measuring(name: str, measure: Any) -> Any:
    """An observable that measures just that."""
    return mutant(Count, name, measure=lambda self, *replica: measure(*replica))()


def drawing(name: str, draw: Any, **attributes: Any) -> Any:
    """An observable that measures what ``Map`` does, and draws it like that."""
    return mutant(Map, name, draw=draw, **attributes)()


def _square(contact, lattice, history):
    n = round(contact.pressure.size**0.5)
    bonds = np.zeros((n, n))
    bonds[lattice.sites // n, lattice.sites % n] = history.state
    return {"bond_map": bonds}


def _swapped(contact, lattice, history):
    bonds = np.zeros(contact.shape[::-1])
    bonds.ravel()[lattice.sites] = history.state
    return {"bond_map": bonds}


def _first_only(self, figure, axes, results):
    for one in results:
        axes.plot(one.ageing.hold_times, one.ageing.observables["bonds_at"][0])


def _one_only(self, figure, axes, results):
    (one,) = results
    axes.plot(one.ageing.hold_times, one.ageing.observables["bonds_at"].mean(axis=0))


def _with_chemistry(self, figure, axes, results):
    for one in results:
        axes.axvline(one.chemistry.activation_volume)
        axes.plot(one.ageing.hold_times, one.ageing.observables["bonds_at"].mean(axis=0))


def _written(contact, lattice, history):
    forming = lattice.forming
    forming.setflags(write=True)
    forming[:] = np.sort(forming)[::-1]
    forming.setflags(write=False)
    return {"lowest": forming.min() if forming.size else 0.0}


_totals: list[int] = [0]


def _running(contact, lattice, history):
    _totals[0] += int(history.bonds[-1])
    return {"total": _totals[0]}


class Coarse(Count):
    """Counts every second site where it is told to be quick."""

    speed_only: ClassVar[tuple[str, ...]] = ("stride",)
    stride: int = Field(default=1, ge=1)
    """count every so many sites"""

    def measure(self, contact, lattice, history):
        return {"bonded": float(history.state[:: self.stride].sum() * self.stride)}


OBSERVABLES: dict[str, tuple[Any, str]] = {
    "a slash in a name": (lambda: measuring("slash", lambda con, lat, his: {"bonds/sites": 1.0}), "names_are_safe"),
    "a line break in a name": (
        lambda: measuring("line", lambda con, lat, his: {"bonds\nhere": 1.0}),
        "names_are_safe",
    ),
    "an empty name": (lambda: measuring("empty", lambda con, lat, his: {"": 1.0}), "names_are_safe"),
    "needs breaking barriers": (
        lambda: measuring("breaking", lambda con, lat, his: {"last": float(np.max(lat.breaking, initial=0))}),
        "parts_may_be_absent",
    ),
    "needs an interaction": (
        lambda: measuring("neighbours", lambda con, lat, his: {"pairs": float((lat.neighbours >= 0).sum())}),
        "parts_may_be_absent",
    ),
    "needs two hold times": (
        lambda: measuring("times", lambda con, lat, his: {"gain": his.bonds[1] - his.bonds[0]}),
        "parts_may_be_absent",
    ),
    "needs a square grid": (lambda: measuring("square", _square), "grids_need_not_be_square"),
    "a map of (ny, nx)": (lambda: measuring("swapped", _swapped), "grids_need_not_be_square"),
    "a number per site": (lambda: measuring("sites", lambda con, lat, his: {"state": his.state}), "observes_numbers"),
    "divides by the bonds": (
        lambda: measuring("mean", lambda con, lat, his: {"mean": lat.forming[his.state].mean()}),
        "observes_numbers",
    ),
    "text": (lambda: measuring("text", lambda con, lat, his: {"bonds": str(his.bonds[-1])}), "observes_numbers"),
    "complex numbers": (
        lambda: measuring("waves", lambda con, lat, his: {"wave": 1j * his.time}),
        "observes_numbers",
    ),
    "never a number": (lambda: measuring("nan", lambda con, lat, his: {"mean": np.nan}), "observes_numbers"),
    "an output that is not declared": (
        lambda: declaring("undeclared", bonds_at=None),
        "measures_what_it_declares",
    ),
    "an output that is not measured": (
        lambda: declaring("unmeasured", more=Output((), "", "more")),
        "measures_what_it_declares",
    ),
    "one dimension too many": (
        lambda: declaring("dims", pressure_of_bonds=Output("x", "GPa", "pressure")),
        "measures_what_it_declares",
    ),
    "a number per hold time that is not": (
        lambda: declaring("times", bond_map=Output(("hold_times", "y"), "", "bonds")),
        "measures_what_it_declares",
    ),
    "a unit that cannot be read": (
        lambda: declaring("unit", pressure_of_bonds=Output((), "gigapascals/", "pressure")),
        "measures_what_it_declares",
    ),
    "no description": (lambda: declaring("text", bonds_at=Output("hold_times")), "measures_what_it_declares"),
    "states it did not ask for": (lambda: mutant(Early, "unasked", states=False)(), "observes_numbers"),
    "a total over replicas": (lambda: measuring("running", _running), "calls_are_independent"),
    "writes into the lattice": (lambda: measuring("writes", _written), "calls_are_independent"),
    "draws the first replica": (lambda: drawing("first", _first_only), "figures_are_drawn"),
    "draws one result only": (lambda: drawing("one", _one_only), "figures_are_drawn"),
    "needs the chemistry to draw": (lambda: drawing("chemistry", _with_chemistry), "figures_are_drawn"),
    "draws nothing": (lambda: drawing("nothing", lambda self, figure, axes, results: None), "figures_are_drawn"),
    "a figure without a caption": (lambda: drawing("caption", Map.draw, figures={"bonds": " "}), "figures_are_named"),
    "quick and different": (lambda: Coarse(), "options_count"),
}


@pytest.mark.parametrize("name", OBSERVABLES)
def test_a_wrong_observable(name):
    make, check = OBSERVABLES[name]
    found, said = caught_by(make())
    assert found == check, said


# -- observables under other conditions --------------------------------------------------------------------------------


class Watch(Observable):
    """The bonds and the pressure on them at every hold time, and the rate at which the others form."""

    kind = "watch"
    states = True
    outputs: ClassVar[Any] = {
        "bonded": Output("hold_time", "", "sites with a bond"),
        "bonded_pressure": Output("hold_time", "GPa", "mean pressure on sites with a bond, 0 without any"),
        "rate": Output((), "1/s", "mean rate at which sites without a bond form one, at the last hold time"),
    }

    def measure(self, contact, lattice, history, states=None, pressure=None, kelvin=None, nu=None):
        states = history.states if states is None else states
        pressure = lattice.pressures(contact) if pressure is None else pressure
        count, unbonded = states.sum(axis=1), lattice.forming[~states[-1]]
        rates = np.exp(-np.maximum(unbonded, 0.0) / (KB * (kelvin or history.temperature)))
        return {
            "bonded": count,
            "bonded_pressure": states @ pressure[: states.shape[1]] / np.maximum(count, 1),
            "rate": (nu or lattice.attempt_frequency) * rates.sum() / max(unbonded.size, 1),
        }


_kept: dict[Any, Any] = {}
_work = np.zeros(100_000)


def watching(name: str, **given: Any) -> Any:
    """``Watch`` with some of its arguments as functions of contact, lattice and history."""

    def measure(self, contact, lattice, history):
        return Watch.measure(
            self, contact, lattice, history, **{k: f(contact, lattice, history) for k, f in given.items()}
        )

    return mutant(Watch, name, measure=measure)()


def counting(name: str, change: Any) -> Any:
    """``Watch`` whose number of bonds is passed through ``change``."""

    def measure(self, contact, lattice, history):
        found = Watch.measure(self, contact, lattice, history)
        return found | {"bonded": change(found["bonded"], history)}

    return mutant(Watch, name, measure=measure)()


def _kept_rate(self, contact, lattice, history):
    key = (contact.digest(), lattice.digest(), history.bonds.tobytes())
    return _kept.setdefault(key, Watch.measure(self, contact, lattice, history))


def _before(contact, lattice, history):
    kelvin, _kept["kelvin"] = _kept.get("kelvin", history.temperature), history.temperature
    return kelvin


def _in_one_array(contact, lattice, history):
    found = _work[: lattice.sites.size]
    found[:] = lattice.pressures(contact)
    time.sleep(1e-3)
    return found


def _all_bonded(contact, lattice, history):
    states = history.states
    states.setflags(write=True)
    states[:] = True
    states.setflags(write=False)
    return states


PIXELS, TIMES = "sites_need_not_be_pixels", "number_of_hold_times_does_not_matter"
CONDITIONS: dict[str, tuple[Any, str]] = {
    "the pressure of the pixel with the number of the site": (
        lambda: watching("by pixel", pressure=lambda con, lat, his: con.pressure.ravel()[lat.sites]),
        PIXELS,
    ),
    "the last state at every hold time": (
        lambda: watching("last", states=lambda con, lat, his: np.repeat(his.states[-1:], his.bonds.size, axis=0)),
        "every_hold_time_has_its_bonds",
    ),
    "no bond at the first hold time": (lambda: counting("first", lambda n, his: np.append(0, n[1:])), TIMES),
    "64 hold times at most": (
        lambda: counting("most", lambda n, his: n[np.minimum(np.arange(n.size), 63)]),
        TIMES,
    ),
    "300 K assumed": (lambda: watching("warm", kelvin=lambda *given: 300.0), "energies_have_their_unit"),
    "1e13 Hz assumed": (lambda: watching("fast", nu=lambda *given: 1e13), "times_have_their_unit"),
    "bonds formed for bonds": (lambda: counting("formed", lambda n, his: his.formed), "broken_bonds_do_not_count"),
    "a bond stays for ever": (
        lambda: watching("lasting", states=lambda con, lat, his: np.maximum.accumulate(his.states, axis=0)),
        "broken_bonds_do_not_count",
    ),
    "65,536 sites at most": (
        lambda: watching("largest", states=lambda con, lat, his: his.states[:, :65536], kelvin=lambda *given: None),
        "sites_may_be_many",
    ),
    "numbers of sites in 16 bits": (
        lambda: watching(
            "short", pressure=lambda con, lat, his: lat.pressures(con)[np.arange(lat.sites.size).astype(np.uint16)]
        ),
        "sites_may_be_many",
    ),
    "bonds in 16 bits": (lambda: counting("bits", lambda n, his: n.astype(np.int16)), "sites_may_be_many"),
    "kept without the temperature": (
        lambda: mutant(Watch, "kept", measure=_kept_rate)(),
        "answers_do_not_depend_on_what_was_asked_before",
    ),
    "the temperature of the call before": (lambda: watching("before", kelvin=_before), "calls_are_independent"),
    "threads that share an array": (lambda: watching("shared", pressure=_in_one_array), "calls_are_independent"),
    "bonds written into the history": (lambda: watching("bonded", states=_all_bonded), "calls_are_independent"),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_an_observable_that_is_wrong_under_other_conditions(name, caught):
    make, check = CONDITIONS[name]
    _kept.clear()
    found, said = caught(make(), check)
    assert found == check, said


def test_an_observable_that_is_right_under_all_conditions_passes():
    testing.check_observable(Watch(), all=True)
    since = {"since": Output("hold_time", "", "bonds formed so far")}
    measure = {"measure": lambda self, contact, lattice, history: {"since": history.formed}}
    testing.check_observable(mutant(Count, "since", outputs=since, **measure)(), all=True)


# -- barriers ---------------------------------------------------------------------------------------------------------

_buffer = np.empty(1000)


def _shared(self, uniform):
    """Every call returns the same array."""
    if uniform.shape != _buffer.shape:
        return Flat.quantile(self, uniform)
    _buffer[:] = Flat.quantile(self, uniform)
    return _buffer


def _in_place(self, uniform):
    uniform *= self.high - self.low
    uniform += self.low
    return uniform


def _ranked(self, uniform):
    order = np.argsort(np.argsort(uniform, axis=None)).reshape(uniform.shape)
    return Flat.quantile(self, (order + 0.5) / max(uniform.size, 1))


class Bounded(Flat):
    """Barriers between two energies, neither of which holds."""

    lower: Energy = 0.9
    """lower end"""


class Sampled(Flat):
    """Rounds where it is told to be quick."""

    speed_only: ClassVar[tuple[str, ...]] = ("fast",)
    fast: bool = False
    """round"""

    def quantile(self, uniform):
        return Flat.quantile(self, np.round(uniform, 6) if self.fast else uniform)


BARRIERS: dict[str, tuple[dict[str, Any], str]] = {
    "in kJ/mol": (
        {
            "quantile": lambda self, u: 96.485 * Flat.quantile(self, u),
            "density": lambda self, e: Flat.density(self, e / 96.485) / 96.485,
        },
        "barriers_are_in_ev",
    ),
    "in k_BT": (
        {
            "quantile": lambda self, u: 38.68 * Flat.quantile(self, u),
            "density": lambda self, e: Flat.density(self, e / 38.68) / 38.68,
        },
        "barriers_are_in_ev",
    ),
    "in J": (
        {
            "quantile": lambda self, u: 1.6e-19 * Flat.quantile(self, u),
            "density": lambda self, e: Flat.density(self, e / 1.6e-19) / 1.6e-19,
        },
        "barriers_are_in_ev",
    ),
    "from the upper end": ({"quantile": lambda self, u: Flat.quantile(self, 1 - u)}, "quantile_is_monotone"),
    "infinite at the end": (
        {"quantile": lambda self, u: 1.0 - 0.1 * np.log(np.maximum(1 - u - 1e-15, 0.0))},
        "quantile_is_monotone",
    ),
    "an array shared by all calls": ({"quantile": _shared}, "barrier_is_the_pixels_own"),
    "writes into the uniform numbers": ({"quantile": _in_place}, "barrier_is_the_pixels_own"),
    "ranks in place of numbers": ({"quantile": _ranked}, "barrier_is_the_pixels_own"),
    "a density in 1/(k_BT)": (
        {"density": lambda self, e: Flat.density(self, e) * 0.02585},
        "density_agrees_with_quantile",
    ),
    "a cumulative density": (
        {"density": lambda self, e: np.clip((e - self.low) / (self.high - self.low), 0.0, 1.0)},
        "density_agrees_with_quantile",
    ),
    "a trade that changes the barriers": ({"trade": {"low": (0.2, 1.2)}}, "trade_keeps_the_barriers"),
    "a density shifted by a hundredth": (
        {"density": lambda self, e: Flat.density(self, e + 0.01)},
        "density_agrees_with_quantile",
    ),
}


@pytest.mark.parametrize("name", BARRIERS)
def test_wrong_barriers(name):
    changes, check = BARRIERS[name]
    found, said = caught_by(mutant(Flat, name, **changes)())
    assert found == check, said


@pytest.mark.parametrize(("component", "check"), [(Bounded(), "barriers_are_in_ev"), (Sampled(), "options_count")])
def test_barriers_whose_options_do_something_else(component, check):
    found, said = caught_by(component)
    assert found == check, said


# -- every component --------------------------------------------------------------------------------------------------


class Nameless(Flat):
    """Its options do not all count."""

    def identity(self):
        return {"kind": self.kind, "low": self.low}


class Wide(Barriers):
    """Two options, one of which takes no values of the trade."""

    kind = "wide"
    trade: ClassVar[Any] = {"points": (10, 100, 100)}

    points: int = 10
    """points of a table"""

    def quantile(self, uniform):
        return 0.8 + uniform

    def density(self, energy):
        return np.where((energy >= 0.8) & (energy <= 1.8), 1.0, 0.0)


@pytest.mark.parametrize(
    ("make", "check"),
    [
        (Nameless, "digest_tells_options_apart"),
        (Wide, "trade_names_options"),
        (lambda: mutant(Wide, "once", trade={"points": (10,)})(), "trade_names_options"),
        (lambda: mutant(Wide, "both", trade={"points": (1, 9)}, speed_only=("points",))(), "trade_names_options"),
        (lambda: mutant(Wide, "string", trade={}, speed_only="points")(), "speed_only_names_options"),
    ],
)
def test_options_that_do_not_do_what_they_say(make, check):
    found, said = caught_by(make())
    assert found == check, said
