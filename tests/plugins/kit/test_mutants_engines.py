"""Engines that are wrong in one way, each found by the check named for it; with ``--long`` alone, first by it."""

from __future__ import annotations

import itertools
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_engine import Fault, Plain
from kit_examples import changed, mutant

import chemage as ca
from chemage import testing
from chemage.plugin import BondHistory, Energy

#: what the direct method does wrong -> the check that finds it
FAULTS = {
    Fault.TEMPERATURE: "rates_follow_the_temperature",
    Fault.FREQUENCY: "rates_follow_the_attempt_frequency",
    Fault.SIGN: "coupled_sites_are_refused_or_right",
    Fault.TWICE: "coupled_sites_are_refused_or_right",
    Fault.FIRST_EMPTY: "empty_slots_are_skipped",
    Fault.LAST_SITE: "empty_slots_are_skipped",
    Fault.SUBTRACT: "rates_span_many_decades",
    Fault.AFTER: "one_site_is_the_closed_form",
    Fault.NO_CAP: "barrierless_is_the_attempt_frequency",
    Fault.CAP_FIRST: "barriers_end_at_zero",
    Fault.BREAKING_COUPLED: "coupled_sites_are_refused_or_right",
    Fault.ONE_BARRIER: "one_site_is_the_closed_form",
    Fault.LOG10: "one_site_is_the_closed_form",
    Fault.MEAN_TIME: "one_site_is_the_closed_form",
    Fault.ANY_SITE: "one_site_is_the_closed_form",
    Fault.ONE_NEIGHBOUR: "coupled_sites_are_refused_or_right",
    Fault.BY_PIXEL: "sites_keep_their_own_rates",
    Fault.STALE: "coupled_sites_are_refused_or_right",
    Fault.HALF: "one_site_is_the_closed_form",
    Fault.CLOCK: "going_on_counts_from_the_history",
    Fault.REUSE: "going_on_keeps_the_rates",
    Fault.OLD_TEMPERATURE: "going_on_keeps_the_rates",
    Fault.RECOUNT: "going_on_counts_from_the_history",
    Fault.NO_START: "start_is_taken",
    Fault.OVERWRITE: "calls_are_independent",
    Fault.SINGLE_TIME: "going_on_keeps_the_rates",
    Fault.BOUND: "coupled_sites_are_refused_or_right",
}


@pytest.mark.long
def test_the_direct_method_passes():
    testing.check_engine(Plain())


#: their checks repeat a run most often; others that the same check finds are quick
LONG = (
    *(Fault.NO_CAP, Fault.ONE_BARRIER, Fault.LOG10, Fault.MEAN_TIME, Fault.REUSE, Fault.OLD_TEMPERATURE),
    *(Fault.ANY_SITE, Fault.SINGLE_TIME),
)


@pytest.mark.long
@pytest.mark.parametrize(
    "fault", [pytest.param(fault, marks=pytest.mark.long if fault in LONG else ()) for fault in Fault]
)
def test_a_wrong_direct_method(fault, caught):
    if fault is Fault.NONE:
        return
    name, said = caught(mutant(Plain, fault.name, fault=fault)(), FAULTS[fault])
    assert name == FAULTS[fault], said


def passed_on(name: str, change: Any = None, before: Any = None, base: type = Plain, **attributes: Any) -> Any:
    """An engine whose result is passed through ``change``, or its arguments through ``before``."""

    def _run(self: Any, *given: Any) -> BondHistory:
        if before is not None:
            given = before(*given)
        history = base._run(self, *given)
        return history if change is None else change(history, *given)

    return mutant(base, name, _run=_run, **attributes)()


def _events_doubled(history, *given):
    return changed(history, formed=2 * history.formed, broken=history.broken + history.formed)


_kept: dict[int, Any] = {}


def _remembered(lattice, *rest):
    """The barriers of the last lattice with interaction, if it had this size."""
    forming = _kept.setdefault(lattice.sites.size, lattice.forming) if lattice.interacting else lattice.forming
    _kept.clear()
    _kept[lattice.sites.size] = lattice.forming
    return changed(lattice, forming=forming), *rest


def _seedless(lattice, times, kelvin, seed, start):
    return lattice, times, kelvin, 0, start


def _spawning(lattice, times, kelvin, seed, start):
    return lattice, times, kelvin, seed.spawn(1)[0] if isinstance(seed, np.random.SeedSequence) else seed, start


def _kj_per_mol(lattice, *rest):
    breaking = None if lattice.breaking is None else lattice.breaking * 0.98
    return changed(lattice, forming=lattice.forming * 0.98, breaking=breaking), *rest


def _one_time_only(history, lattice, times, *rest):
    """Every hold time has the count of the last one."""
    end = times > 0
    formed, broken = (np.where(end, counts[-1], counts) for counts in (history.formed, history.broken))
    return changed(history, bonds=np.where(end, history.bonds[-1], history.bonds), formed=formed, broken=broken)


class Hasty(Plain):
    """Leaves out breaking where it works in pieces."""

    speed_only: ClassVar[tuple[str, ...]] = ("pieces",)
    pieces: int = 1
    """number of pieces"""

    def _run(self, lattice, hold_times, temperature, seed, start):
        shifted = changed(lattice, forming=lattice.forming + 0.01 * (self.pieces - 1))
        return super()._run(shifted, hold_times, temperature, seed, start)


class Traded(Plain):
    """Trades the barriers."""

    trade: ClassVar[Any] = {"lowered": (0.2, 0.0)}
    lowered: Energy = 0.0
    """by how much barriers are lowered"""

    def _run(self, lattice, hold_times, temperature, seed, start):
        lowered = changed(lattice, forming=lattice.forming - self.lowered)
        return super()._run(lowered, hold_times, temperature, seed, start)


class Superbasins(Plain):
    """As `bkl` was with this option: a neighbour is attempted at its rate in one state of a site that flickers, and
    accepted by its bound, which the other state has raised."""

    superbasins: bool = False
    """follow a site that flickers as one chain"""

    def _run(self, lattice, hold_times, temperature, seed, start):
        engine = mutant(Plain, "bound", fault=Fault.BOUND)() if self.superbasins else Plain()
        history = engine.run(lattice, hold_times, temperature=temperature, seed=seed, start=start)
        return changed(history, engine=self.kind)


class Rounded(Plain):
    """An approximation: rates rounded to powers of two."""

    exact: ClassVar[bool] = False
    declared_error: ClassVar[float | None] = 0.4

    def _run(self, lattice, hold_times, temperature, seed, start):
        step = ca.plugin.KB * temperature * np.log(2)
        rounded = changed(
            lattice,
            forming=np.where(lattice.forming > 0, np.round(lattice.forming / step) * step, lattice.forming),
        )
        return super()._run(rounded, hold_times, temperature, seed, start)


counter = itertools.count()
OTHERS: dict[str, tuple[Any, str]] = {
    "events counted twice": (
        lambda: passed_on("events", lambda h, *g: changed(h, formed=2 * h.formed, broken=h.broken + h.formed)),
        "one_site_is_the_closed_form",
    ),
    "state shared between runs": (lambda: passed_on("shared", before=_remembered), "calls_are_independent"),
    "one seed for all": (lambda: passed_on("seedless", before=_seedless), "run_follows_its_seed"),
    "spawns from the seed": (lambda: passed_on("spawning", before=_spawning), "run_follows_its_seed"),
    "a wrong conversion of energies": (
        lambda: passed_on("energies", before=_kj_per_mol),
        "one_site_is_the_closed_form",
    ),
    "the last count for all hold times": (lambda: passed_on("last", _one_time_only), "one_site_is_the_closed_form"),
    "results of the last run": (
        lambda: passed_on("late", lambda h, *g: changed(h, formed=h.formed + next(counter), broken=h.broken + 1)),
        "history_adds_up",
    ),
    "a restart that is not exact": (lambda: mutant(Plain, "restart", restart=True)(), "restart_is_exact"),
    "an option for speed that changes rates": (Hasty, "options_keep_the_rates"),
    "an option for accuracy that is another model": (Traded, "trade_keeps_the_rates"),
    "an option that loses attempts": (Superbasins, "options_keep_the_rates"),
    "speed of an option that does not exist": (
        lambda: mutant(Plain, "speed", speed_only=("workers",))(),
        "speed_only_names_options",
    ),
    "trade of an option that does not exist": (
        lambda: mutant(Plain, "trade", trade={"workers": (1, 2)})(),
        "trade_names_options",
    ),
    "approximate without an error": (lambda: mutant(Plain, "undeclared", exact=False)(), "error_is_declared"),
    "exact with an error": (lambda: mutant(Plain, "declared", declared_error=0.1)(), "approximations_are_declared"),
    "an error larger than declared": (
        lambda: mutant(Rounded, "proud", declared_error=0.01)(),
        "rates_follow_the_temperature",
    ),
}


RejectionFree: Any = type(ca.engine("rejection-free"))


def _twin(lattice, **fields):
    """The lattice with other fields, unchecked, as an engine may hold it."""
    return lattice.model_copy(update=fields)


def _short_indices(lattice, *rest):
    if lattice.interacting:
        near = lattice.neighbours
        lattice = _twin(lattice, neighbours=np.where(near < 0, -1, near & 0xFFFF).astype(np.int32))
    return lattice, *rest


def _first_sites_only(lattice, *rest):
    idle = np.arange(lattice.sites.size) >= 1 << 16
    return _twin(lattice, forming=np.where(idle, 1e3, lattice.forming)), *rest


def _short_counts(history, *given):
    return history.model_copy(update={"bonds": history.bonds & 0xFFFF})


def _sixty_four_times(history, *given):
    """Every hold time after the 64th has the counts of that one."""
    at = np.minimum(np.arange(history.bonds.size), 63)
    counts = {name: getattr(history, name)[at] for name in ("bonds", "formed", "broken")}
    return history.model_copy(update=counts)


def _by_the_last_hold_time(lattice, times, kelvin, seed, start):
    last = int(times[-1:].view(np.uint64)[0])
    return lattice, times, kelvin, np.random.SeedSequence([*ca.plugin.random.key(seed), last]), start


def _one_barrier_per_pixel(lattice, *rest):
    first = np.searchsorted(lattice.sites, lattice.sites)
    return _twin(lattice, forming=lattice.forming[first]), *rest


def _slipped_are_lost(lattice, times, kelvin, seed, start):
    """Sites that have slipped begin without a bond."""
    if isinstance(start, BondHistory) and "partner" in start.resume:
        state = start.state & (start.resume["partner"] == 0)
        lost = int(start.state.sum() - state.sum())
        counts = {"state": state, "bonds": start.bonds - lost, "broken": start.broken + lost}
        start = start.model_copy(update=counts)
    return lattice, times, kelvin, seed, start


_shared: dict[Any, Any] = {}


def _temperature_of_another_thread(lattice, times, kelvin, seed, start):
    _shared["temperature"] = kelvin
    lattice.digest()  # what takes a moment
    return lattice, times, _shared["temperature"], seed, start


def _barriers_of_another_thread(lattice, times, kelvin, seed, start):
    n = lattice.sites.size
    buffer = _shared.setdefault("buffer", np.empty(1 << 17))
    for site in range(min(n, 200)):
        buffer[site] = lattice.forming[site]
    mine = np.append(buffer[: min(n, 200)], lattice.forming[200:])
    return _twin(lattice, forming=mine), times, kelvin, seed, start


def _temperature_of_the_first_call(lattice, times, kelvin, seed, start):
    return lattice, times, _shared.setdefault(lattice.digest(), kelvin), seed, start


def _start_of_the_call_before(lattice, times, kelvin, seed, start):
    """A start that is given is taken again by the next call that has none."""
    if isinstance(start, np.ndarray):
        _shared[lattice.digest()] = np.array(start)
    return lattice, times, kelvin, seed, _shared.pop(lattice.digest(), None) if start is None else start


class Counting(RejectionFree):
    """Records how many bonds there were at each hold time, but not where it goes on."""

    outputs: ClassVar[Any] = {"seen": ca.plugin.Output("hold_time", description="bonds")}

    def _run(self, lattice, hold_times, temperature, seed, start):
        history = super()._run(lattice, hold_times, temperature, seed, start)
        if not isinstance(start, BondHistory):
            self.record(seen=history.bonds.astype(float))
        return history


class OneCurve(Counting):
    """Records the number of bonds at the end for all hold times."""

    def _run(self, lattice, hold_times, temperature, seed, start):
        history = RejectionFree._run(self, lattice, hold_times, temperature, seed, start)
        self.record(seen=np.full(hold_times.size, float(history.bonds[-1])))
        return history


def fast(name: str, change: Any = None, before: Any = None) -> Any:
    return passed_on(name, change, before, RejectionFree)


#: wrong with many sites, many hold times, in another grid, after a pull, in several threads, or in a second call
ELSEWHERE: dict[str, tuple[Any, str]] = {
    "neighbours in 16 bits": (lambda: fast("short", before=_short_indices), "situations_keep_the_rates"),
    "65,536 sites": (lambda: fast("first-sites", before=_first_sites_only), "situations_keep_the_rates"),
    "counts in 16 bits": (lambda: fast("short-counts", _short_counts), "situations_keep_the_rates"),
    "64 hold times": (lambda: fast("64-times", _sixty_four_times), "situations_keep_the_rates"),
    "one barrier per pixel": (lambda: fast("per-pixel", before=_one_barrier_per_pixel), "situations_keep_the_rates"),
    "bonds of sites that slipped": (lambda: fast("slipped", before=_slipped_are_lost), "situations_keep_the_rates"),
    "the last hold time in the seed": (
        lambda: passed_on("by-times", before=_by_the_last_hold_time),
        "later_hold_times_change_nothing",
    ),
    "a temperature shared by threads": (
        lambda: fast("shared", before=_temperature_of_another_thread),
        "calls_are_independent",
    ),
    "barriers shared by threads": (
        lambda: fast("buffer", before=_barriers_of_another_thread),
        "calls_are_independent",
    ),
    "the temperature of the first call": (
        lambda: fast("first-kelvin", before=_temperature_of_the_first_call),
        "rates_follow_the_temperature",
    ),
    "the start of the call before": (
        lambda: fast("last-start", before=_start_of_the_call_before),
        "calls_are_independent",
    ),
    "an output lost at restart": (Counting, "restart_is_exact"),
    "an output of the end alone": (OneCurve, "restart_is_exact"),
}


#: others that the same checks find are quicker
LONG_ELSEWHERE = ("neighbours in 16 bits",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in LONG_ELSEWHERE else ()) for name in ELSEWHERE]
)
def test_what_is_wrong_elsewhere_is_found(name, caught):
    make, check = ELSEWHERE[name]
    _shared.clear()
    found, said = caught(make(), check)
    assert found == check, said


#: found by the closed form of one site, as are others
LONG_OTHERS = ("a wrong conversion of energies", "the last count for all hold times")


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in LONG_OTHERS else ()) for name in OTHERS]
)
def test_a_wrong_engine(name, caught):
    make, check = OTHERS[name]
    _kept.clear()
    found, said = caught(make(), check)
    assert found == check, said


@pytest.mark.long
def test_the_same_random_numbers_for_all_sites_of_a_pixel(caught):
    def by_pixel(lattice, *rest):
        twin = lattice.model_copy()
        vars(twin)["random_index"] = twin.sites
        return (twin, *rest)

    wrong = passed_on("by-pixel", before=by_pixel, base=type(ca.engine("independent")))
    name, said = caught(wrong, "sites_of_one_pixel_are_independent")
    assert name == "sites_of_one_pixel_are_independent", said
