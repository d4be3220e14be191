"""Checks of a kinetic Monte Carlo engine."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from chemage.foundation.components import call_with
from chemage.foundation.units import KB
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.testing.answers import Questions, asks
from chemage.testing.checks import (
    CHANCE,
    binomial_chance,
    check_of,
    option_variants,
    refuses,
    require,
    require_estimates,
    seeds_are_harmless,
    trade_variants,
    whole,
)
from chemage.testing.small_systems import (
    LARGE,
    NU,
    TEMPERATURE,
    Group,
    Trials,
    barrier,
    compare,
    compare_mean,
    coupled,
    held,
    random_hold,
    sampled,
    single,
    states,
)

#: rows and columns of random groups around a site that flickers
FLICKERING = ((1, 1), (1, 2), (1, 2), (1, 2), (2, 2))
#: what an estimate of a replica may state
_ESTIMATES = ("cpu_seconds", "cpu_seconds_least", "cpu_seconds_most", "bytes")


check_engine = whole(Engine)


def _disordered(interacting: bool, *rings: int, seed: int = 7) -> ReactionLattice:
    """Rings of sites with rates over five decades, by default one of 40; with an interaction of nearest neighbours if
    ``interacting``. An engine can distribute several rings over threads: their sites are mixed."""
    rng = np.random.default_rng(seed)
    rings = rings or (40,)
    n, sizes = sum(rings), np.repeat(rings, rings)
    first = np.repeat(np.cumsum([0, *rings[:-1]]), rings)
    after, before = (first + (np.arange(n) - first + step) % sizes for step in (1, -1))
    order = rng.permutation(n) if len(rings) > 1 else np.arange(n)
    fields: dict[str, Any] = {}
    if interacting:
        pair = rng.uniform(-0.05, 0.1, n)
        fields["neighbours"] = np.argsort(order)[np.stack([after, before], axis=1)][order]
        fields["coupling"] = np.stack([pair, pair[before]], axis=1)[order]
    return ReactionLattice(
        pixels=(n, 1),
        sites=np.arange(n),
        forming=np.array([barrier(10**x) for x in rng.uniform(-3, 2, n)]),
        breaking=np.array([barrier(10**x) for x in rng.uniform(-3, 1, n)]),
        **fields,
    )


def _trace(history: BondHistory) -> tuple[bytes, ...]:
    parts = (history.bonds, history.formed, history.broken, history.state)
    return tuple(part.tobytes() for part in parts)


@asks(Engine)
def _engines_asked(component: Engine) -> Questions:
    def ask(lattice: ReactionLattice, times: Any = (0.013, 1.7, 43.0), **given: Any) -> Any:
        how = {"temperature": 300.0, "seed": 31, **given}
        return lambda engine: _trace(engine.run(lattice, times, **how))

    def sites(number: int, **changes: Any) -> ReactionLattice:
        return _disordered(component.interacting, number).model_copy(update=changes)

    def breaking(number: int) -> np.ndarray:
        return np.asarray(sites(number).breaking)[::-1]

    changes: dict[str, Callable[[int], Any]] = {
        "at another temperature": lambda n: ask(sites(n), temperature=317.0),
        "with another seed": lambda n: ask(sites(n), seed=32),
        "at other hold times": lambda n: ask(sites(n), (0.017, 1.3, 41.0)),
        "with another attempt frequency": lambda n: ask(sites(n, attempt_frequency=7e12)),
        "in pixels of another size": lambda n: ask(sites(n, pixel_size=2.1)),
        "with their forming barriers in another order": lambda n: ask(sites(n, forming=sites(n).forming[::-1])),
        "with their breaking barriers in another order": lambda n: ask(sites(n, breaking=breaking(n))),
        "whose bonds last": lambda n: ask(sites(n, breaking=None)),
        "of which every third is bonded at first": lambda n: ask(sites(n), start=np.arange(n) % 3 == 0),
    }
    for number, (what, changed) in enumerate(changes.items(), 31):
        yield f"{number} sites", ask(sites(number))
        yield f"{number} sites {what}", changed(number)
    for interacting in sorted({False, component.interacting}):
        yield f"279 sites, interacting={interacting}", ask(_disordered(interacting, 119, 7, 60, 3, 90))
    if component.interacting:
        hold = random_hold(1, 1, 2)
        flickering = {"times": [hold.time], "temperature": hold.temperature}
        yield "a site that flickers", ask(hold.group.lattice(3), start=np.full(6, hold.start), **flickering)


# -- the form of the answer -------------------------------------------------------------------------------------------


@check_of(Engine)
def _history_adds_up(component: Engine) -> None:
    """Hold times, temperature and kind are those of the run; bonds are formed less broken; the last count is the final
    state's."""
    times = np.geomspace(1e-3, 1e3, 13)
    lattice = _disordered(component.interacting)
    history = component.run(lattice, times, temperature=TEMPERATURE, seed=1)
    require(isinstance(history, BondHistory), f"run() returned {type(history).__name__}; expected a BondHistory")
    require(np.array_equal(history.hold_times, times), "the hold times are not the given ones")
    n = lattice.sites.size
    require(history.state.shape == (n,), f"state of {history.state.shape} for {n} sites")
    require(
        (history.bonds >= 0).all() and (history.bonds <= n).all(),
        f"from {history.bonds.min()} to {history.bonds.max()} bonds on {n} sites",
    )
    require(
        history.bonds[-1] == history.state.sum(),
        f"the last count is {history.bonds[-1]} bonds; the final state has {history.state.sum()}",
    )
    require(np.array_equal(history.bonds, history.formed - history.broken), "bonds are not formed less broken")
    require(
        (np.diff(history.formed) >= 0).all() and (np.diff(history.broken) >= 0).all(), "the numbers of events decrease"
    )
    require(history.events > 0, "nothing happened in 1000 s at rates up to 100 per second")
    require(
        history.time == times[-1] and history.temperature == TEMPERATURE,
        f"wrong time or temperature: {history.time} s at {history.temperature} K; expected {times[-1]} s at 300 K",
    )
    # an engine that selects another one records which
    kinds = {component.kind, *registry.current().kinds(component.role)}
    require(history.engine in kinds, f"engine is {history.engine!r}, neither {component.kind!r} nor an installed one")


@check_of(Engine)
def _engine_cost_is_estimated(component: Engine) -> None:
    """``expected()`` returns finite costs, also for no sites and for ten million, no events and 1e12 a site."""
    for sites in (0.0, 1.0, 1e7):
        for events in (None, 0.0, 1e12):
            expected = call_with(component.expected, sites, component.interacting, events=events)
            require_estimates(f"expected({sites})", expected, dict.fromkeys(_ESTIMATES, math.inf))


@check_of(Engine)
def _error_is_declared(component: Engine) -> None:
    """An approximate engine (``exact = False``) has a ``declared_error``, an exact one has none."""
    error = component.declared_error
    if component.exact:
        require(
            error is None, f"declared_error = {error!r}, but exact is True; an exact engine has no error to declare"
        )
        return
    require(
        isinstance(error, int | float) and not isinstance(error, bool) and 0 < error <= 1,
        f"exact = False and declared_error = {error!r}; declare the largest relative error of the mean number of "
        "bonds, above 0 and at most 1",
    )


@check_of(Engine)
def _run_follows_its_seed(component: Engine) -> None:
    """The same seed gives the same bytes, other seeds give others (an approximate engine may ignore it), and no global
    random state is used."""
    lattice = _disordered(component.interacting, 100)

    def draw(seed: Any) -> tuple[bytes, ...]:
        return _trace(component.run(lattice, [0.1, 1, 10], temperature=300, seed=seed))

    seeds_are_harmless(draw, "run", chance=component.exact)


@check_of(Engine)
def _runs_do_not_share_state(component: Engine) -> None:
    """A run does not depend on what ran before it, on another lattice, temperature or seed, and leaves its input as it
    was."""
    lattice, start = _disordered(component.interacting), np.arange(40) % 3 == 0
    times, kept = np.array([0.5, 20.0]), start.copy()
    before = _trace(component.run(lattice, times, temperature=300, seed=3, start=start))
    for other, kelvin in ((_disordered(component.interacting, seed=8), 300), (lattice, 320), (_disordered(False), 300)):
        component.run(other, [5.0, 30.0], temperature=kelvin, seed=4)
    require(np.array_equal(start, kept), "the array of bonds given as start was changed")
    after = _trace(component.run(lattice, times, temperature=300, seed=3, start=start))
    require(after == before, "the same run, repeated after runs of other lattices and temperatures, gave other bonds")
    require(times.tolist() == [0.5, 20.0], "the hold times were changed")


@check_of(Engine)
def _no_sites_is_no_bonds(component: Engine) -> None:
    """A lattice without sites is run, and has no bonds."""
    graphs: list[dict[str, Any]] = [{}]
    if component.interacting:
        graphs += [{"neighbours": np.empty((0, k), np.int32), "coupling": np.empty((0, k))} for k in (0, 8)]
    for graph in graphs:
        for breaking in (None, np.empty(0)):
            none = np.empty(0, np.int64)
            empty = ReactionLattice(pixels=(3, 3), sites=none, forming=np.empty(0), breaking=breaking, **graph)
            history = component.run(empty, [0, 1e5], temperature=300)
            require(history.bonds.tolist() == [0, 0] and history.events == 0, f"{history.bonds} bonds without sites")


@check_of(Engine)
def _nothing_happens_at_rate_zero(component: Engine) -> None:
    """A lattice whose total rate is 0, also by underflow, does not change and is not an error."""
    n = 7
    for energy in (25.0, 1e4):
        lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=np.full(n, energy))
        history = component.run(lattice, [0, 1, 1e5], temperature=300)
        require(history.events == 0 and history.time == 1e5, f"{history.events} events over {energy} eV")


# -- the rates --------------------------------------------------------------------------------------------------------


@check_of(Engine, known=True)
def _one_site_is_the_closed_form(component: Engine) -> None:
    """θ(t) = k_f/(k_f + k_b) (1 − exp(−(k_f + k_b) t)), and as many bonds are formed as it takes: one site with many
    seeds, and many sites."""
    forming, breaking = 2.0, 0.7
    group, total = single(forming, breaking), forming + breaking
    times = np.array([0.02, 0.3, 1.0, 2.5])
    theta = forming / total * (1 - np.exp(-total * times))
    # the mean number of bonds formed by t, ∫ k_f (1 − θ) dt
    formed = forming * (times - (forming / total) * (times - (1 - np.exp(-total * times)) / total))
    samples = [Trials(48, 400), Trials(600, 1), Trials(1, 400)] if component.exact else [Trials(LARGE, 8)]
    for sample in samples:
        lattice = group.lattice(sample.copies)
        runs = [component.run(lattice, times, temperature=300, seed=seed) for seed in range(sample.runs)]
        for at, t in enumerate(times):
            where = f"sites that form bonds at 2 per second and break them at 0.7 per second: after {t} s"
            compare_mean(component, where, [run.bonds[at] for run in runs], sample.copies, float(theta[at]))
            if not component.exact:
                continue
            events, expected = int(sum(run.formed[at] for run in runs)), formed[at] * sample.copies * sample.runs
            # alternating events scatter less than independent ones
            require(
                abs(events - expected) < 6.5 * math.sqrt(expected) + 6.5,
                f"{where}, {events} bonds were formed; expected {expected:.0f}",
            )
        states_at_end = np.sum([states(run.state, 1) for run in runs], axis=0)
        compare(component, "in the final states", states_at_end, np.array([1 - theta[-1], theta[-1]]))


@check_of(Engine, known=True)
def _sites_keep_their_own_rates(component: Engine) -> None:
    """Each site reacts over its own barriers, wherever its pixel is: the positions in the list are not the pixels."""
    group = Group(tuple(barrier(k) for k in (4.0, 0.25, 1.0)), tuple(barrier(k) for k in (0.1, 0.5, 2.0)))
    for time in (0.3, 1.5):
        where = f"sites with different barriers, after {time} s"
        compare(component, where, sampled(component, group, time), group.probabilities(time))


@check_of(Engine, known=True)
def _rates_follow_the_temperature(component: Engine) -> None:
    """The same barrier is crossed at the rate ν exp(−E/k_B T) of each temperature."""
    group = single(1.0)
    for kelvin in (260.0, 350.0, 900.0):
        time = math.exp(group.forming[0] / (KB * kelvin)) / NU
        where = f"at {kelvin:g} K, over {group.forming[0]:.4g} eV, after {time:.3g} s"
        compare(component, where, sampled(component, group, time, temperature=kelvin), _bonded(1 - math.exp(-1)))


@check_of(Engine)
def _rates_follow_the_attempt_frequency(component: Engine) -> None:
    """Rates are proportional to the attempt frequency of the lattice."""
    group = single(1.0)
    for nu in (1e10, 4e15):
        where = f"at an attempt frequency of {nu:g} Hz, over {group.forming[0]:.4g} eV, after {NU / nu:.3g} s"
        compare(component, where, sampled(component, group, NU / nu, nu=nu), _bonded(1 - math.exp(-1)))


def _bonded(probability: float) -> np.ndarray:
    return np.array([1 - probability, probability])


@check_of(Engine, known=True)
def _barrierless_is_the_attempt_frequency(component: Engine) -> None:
    """The rate over a barrier at or below zero is the attempt frequency ν."""
    for energy in (0.0, -0.3, -50.0):
        group = Group((energy,))
        for time in (2e-14, 1e-13):
            where = f"over a barrier of {energy:g} eV, after {time:g} s (ν = 1e13 Hz)"
            compare(component, where, sampled(component, group, time), _bonded(1 - math.exp(-NU * time)))


@check_of(Engine)
def _rates_span_many_decades(component: Engine) -> None:
    """Slow sites keep their rates of 1e-6 per second beside fast ones of 1e12: a total that is kept up by adding and
    subtracting rates is lost in rounding."""
    slow = (1e-6, 4e-6)
    rng = np.random.default_rng(5)
    sample = Trials(8, 100) if component.exact else Trials(LARGE, 4)
    bonded = np.zeros(2, dtype=np.int64)
    early = 0
    time, many = 2e5, 2 * sample.copies
    for seed in range(sample.runs):
        rates = np.concatenate([np.tile(slow, sample.copies), 10 ** rng.uniform(11, 12.5, many)])
        place = rng.permutation(rates.size)
        lattice = ReactionLattice(
            pixels=(rates.size, 1),
            sites=np.arange(rates.size),
            forming=np.array([barrier(float(rates[i])) for i in place]),
        )
        history = component.run(lattice, [1.0, time], temperature=300, seed=seed)
        state = np.empty(rates.size, dtype=bool)
        state[place] = history.state
        early += int(history.bonds[0]) - many
        bonded += state[:many].reshape(-1, 2).sum(axis=0)
        require(state[many:].all(), f"sites with rates above 1e11 per second are not bonded after {time:g} s")
    total = sample.copies * sample.runs
    compare_mean(component, "of the slow sites, after 1 s", [early], 2 * total, 2.5e-6)
    for rate, count in zip(slow, bonded, strict=True):
        where = f"sites with a rate of {rate:g} per second among sites with rates of 1e12, after {time:g} s"
        compare_mean(component, where, [int(count)], total, 1 - math.exp(-rate * time))


@check_of(Engine)
def _hold_times_may_coincide(component: Engine) -> None:
    """There are no bonds at time 0; repeated hold times have equal counts and do not change the others."""
    lattice = _disordered(component.interacting)
    once = component.run(lattice, [0.5, 20], temperature=300, seed=3)
    twice = component.run(lattice, [0.5, 0.5, 20, 20], temperature=300, seed=3)
    require(twice.bonds.tolist() == np.repeat(once.bonds, 2).tolist(), f"{twice.bonds} where once gave {once.bonds}")
    require(np.array_equal(once.state, twice.state), "a repeated hold time changes the final state")
    at_zero = component.run(lattice, [0, 0, 20], temperature=300, seed=3)
    require(at_zero.bonds[:2].tolist() == [0, 0], f"{at_zero.bonds[0]} bonds at time 0")
    only = component.run(lattice, [0.0], temperature=300, seed=3)
    require(only.bonds.tolist() == [0] and only.events == 0 and only.time == 0, f"{only.events} events by time 0")


@check_of(Engine)
def _bonds_last_without_breaking(component: Engine) -> None:
    """On a lattice without breaking barriers no bond breaks, and every site is bonded in the end."""
    n = 600
    times = np.array([0.1, 1.0, 1.0, 2.0, 50.0])
    history = component.run(single(1.0).lattice(n), times, temperature=300, seed=5)
    require((history.broken == 0).all(), f"{history.broken[-1]} bonds broke on a lattice without breaking")
    require((np.diff(history.bonds) >= 0).all(), f"bonds {history.bonds}")
    require(history.bonds[-1] == n, f"{history.bonds[-1]} of {n} bonded after fifty times the mean time")


# -- interaction ------------------------------------------------------------------------------------------------------


@check_of(Engine, known=True)
def _coupled_sites_are_refused_or_right(component: Engine) -> None:
    """Four coupled sites follow their master equation of 16 states, or are refused with an InputError."""
    group = coupled()
    if not component.interacting:
        lattice = group.lattice()
        message = refuses("a lattice whose sites interact", lambda: component.run(lattice, [1.0], temperature=300))
        require(component.kind in message, f"the error does not name the engine: {message}")
        return
    for time in (0.3, 2.0):
        counts = sampled(component, group, time)
        compare(component, f"four coupled sites: after {time} s", counts, group.probabilities(time))


@check_of(Engine)
def _empty_slots_are_skipped(component: Engine) -> None:
    """Entries -1 in ``neighbours`` mean no neighbour, wherever they stand among the slots."""
    if not component.interacting:
        return
    group = coupled()
    counts = sampled(component, group, 1.0, slots=3)
    where = "four coupled sites with empty neighbour slots between the others: after 1 s"
    compare(component, where, counts, group.probabilities(1.0))
    # a single-precision coupling, and a site without any neighbour
    alone = ReactionLattice(
        pixels=(400, 1),
        sites=np.arange(400),
        forming=np.full(400, barrier(1.0)),
        neighbours=np.full((400, 2), -1, np.int32),
        coupling=np.zeros((400, 2), np.float32),
    )
    bonds = component.run(alone, [1.0], temperature=300, seed=12).bonds
    compare_mean(
        component, "sites all of whose neighbour slots are empty: after 1 s", bonds.tolist(), 400, 1 - math.exp(-1)
    )


@check_of(Engine)
def _barriers_end_at_zero(component: Engine) -> None:
    """Neighbours are added to the barrier first, and a sum below zero counts as zero then."""
    if not component.interacting:
        return
    lowered = Group((0.0, 0.2), (0.05, 0.3), ((0.0, -1.0), (-1.0, 0.0)))
    raised = Group((-0.3, 0.0), (0.05, 0.3), ((0.0, 0.33), (0.33, 0.0)))
    for group, how in ((lowered, "lowers from 0.2 to -0.8 eV"), (raised, "raises from -0.3 to 0.03 eV")):
        where = f"over a barrier that a bonded neighbour {how}, after 2e-13 s"
        compare(component, where, sampled(component, group, 2e-13), group.probabilities(2e-13))


# -- starting and going on --------------------------------------------------------------------------------------------


@check_of(Engine)
def _start_is_taken(component: Engine) -> None:
    """A run begins with the bonds that are given, and goes on from them."""
    lattice = _disordered(component.interacting)
    start = np.arange(lattice.sites.size) % 3 == 0
    history = component.run(lattice, [0, 100], temperature=300, seed=4, start=start)
    require(history.bonds[0] == start.sum(), f"{history.bonds[0]} bonds at time 0, started with {start.sum()}")
    gained = history.formed - history.broken
    require(np.array_equal(history.bonds, start.sum() + gained), "bonds are not those at the start plus those formed")
    full = component.run(single(1.0).lattice(7), [1, 1e5], temperature=300, start=np.ones(7, bool))
    require(
        full.bonds.tolist() == [7, 7] and full.events == 0,
        "all sites are bonded and no bond breaks, but the state changed",
    )
    for wrong in (start[:-1], start.astype(int), np.ones((2, 2), bool)):
        refuses("a wrong start", lambda wrong=wrong: component.run(lattice, [1], temperature=300, start=wrong))
    group = Group(tuple(barrier(k) for k in (2.0, 0.3)), tuple(barrier(k) for k in (0.7, 1.5)))
    where = "from all sites bonded, after 0.6 s"
    compare(component, where, sampled(component, group, 0.6, start=True), group.probabilities(0.6, start=3))


@check_of(Engine)
def _going_on_counts_from_the_history(component: Engine) -> None:
    """A run that goes on from a history has its bonds, its clock and its numbers of events to begin with."""
    lattice = _disordered(component.interacting)
    first = component.run(lattice, [0.1, 2.0], temperature=300, seed=6)
    rest = component.run(lattice, [2.0, 2.0, 50.0], temperature=300, seed=6, start=first)
    for name in ("bonds", "formed", "broken"):
        was, now = int(getattr(first, name)[-1]), int(getattr(rest, name)[0])
        require(was == now, f"{name} is {was} at 2 s, and {now} at 2 s in the run that goes on from there")
    require(np.array_equal(rest.bonds, rest.formed - rest.broken), "bonds are not formed less broken over both runs")
    require(rest.hold_times.tolist() == [2.0, 2.0, 50.0], f"the hold times are {rest.hold_times}, not 2, 2 and 50 s")
    require(rest.time == 50.0, f"the time at the end is {rest.time} s, not 50 s")
    refuses("going back", lambda: component.run(lattice, [0.5], temperature=300, seed=6, start=first))
    other = single(1.0).lattice(31)
    refuses("another lattice", lambda: component.run(other, [3.0], temperature=300, seed=6, start=first))


@check_of(Engine)
def _going_on_keeps_the_rates(component: Engine) -> None:
    """A run that goes on from a history with the same seed has the right rates from there on: neither the clock nor the
    random numbers begin again, and a new temperature counts."""
    group = single(1.0)
    samples = [Trials(1, 400), Trials(12, 100)] if component.exact else [Trials(LARGE, 8)]
    for sample in samples:
        lattice = group.lattice(sample.copies)
        for kelvin in (300.0, 330.0):
            rate = NU * math.exp(-group.forming[0] / (KB * kelvin))
            times = [1.0, 1.3] if kelvin == 300 else [1.0, 1.0 + 0.3 / rate]
            unbonded = gained = 0
            for seed in range(sample.runs):
                first = component.run(lattice, times[:1], temperature=300, seed=seed)
                rest = component.run(lattice, times[1:], temperature=kelvin, seed=seed, start=first)
                unbonded += sample.copies - int(first.bonds[-1])
                gained += int(rest.bonds[-1] - first.bonds[-1])
            p = 1 - math.exp(-0.3)
            where = f"{unbonded} sites unbonded at 1 s, going on to {times[1]:.4g} s at {kelvin:g} K (same seed)"
            if component.exact:
                require(
                    binomial_chance(gained, unbonded, p) > CHANCE,
                    f"{where}: {gained} form a bond; expected {unbonded * p:.0f}",
                )
            else:
                compare_mean(component, where, [gained], unbonded, p)
    by_hand = BondHistory(
        hold_times=np.array([1e7]),
        bonds=np.array([0]),
        formed=np.array([3]),
        broken=np.array([3]),
        state=np.zeros(400, dtype=bool),
        time=1e7,
        temperature=300.0,
        engine="another",
    )
    history = component.run(group.lattice(400), [1e7 + 1], temperature=300, seed=1, start=by_hand)
    compare_mean(
        component, "1 s after a history of 1e7 s of another engine", history.bonds.tolist(), 400, 1 - math.exp(-1)
    )


@check_of(Engine, known=True)
def _restart_is_exact(component: Engine) -> None:
    """A run continued from any hold time equals the uninterrupted run to the last bit, where ``restart`` is true."""
    if not component.restart:
        return
    times = np.array([0.0, 1e-3, 0.1, 0.1, 1.0, 30.0, 1e3])
    for lattice in (_disordered(component.interacting), _disordered(False), single(1.0).lattice(30)):
        whole = component.run(lattice, times, temperature=300, seed=6)
        for cut in range(1, times.size):
            first = component.run(lattice, times[:cut], temperature=300, seed=6)
            kept = pickle.loads(pickle.dumps(first))  # also after it was stored
            rest = component.run(lattice, times[cut:], temperature=300, seed=6, start=kept)
            for name in ("bonds", "formed", "broken"):
                mine = np.concatenate([getattr(first, name), getattr(rest, name)])
                its = getattr(whole, name)
                require(
                    np.array_equal(mine, its), f"continued from {times[cut - 1]} s: {name} {mine}, uninterrupted {its}"
                )
            require(
                np.array_equal(rest.state, whole.state), f"continued from {times[cut - 1]} s: the final state differs"
            )
            require(rest.time == whole.time, "the time differs")


# -- speed ------------------------------------------------------------------------------------------------------------


@check_of(Engine)
def _threads_change_nothing(component: Engine) -> None:
    """Results are the same on one thread and on all, alone and concurrently with other runs."""
    import numba

    lattice = _disordered(component.interacting, 100)

    def run(seed: int) -> tuple[bytes, ...]:
        return _trace(component.run(lattice, [0.1, 10.0], temperature=300, seed=seed))

    alone = [run(seed) for seed in range(6)]
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        require([run(seed) for seed in range(6)] == alone, "one thread and several gave different results")
    finally:
        numba.set_num_threads(threads)
    if component.concurrency() == 1:
        with ThreadPoolExecutor(3) as pool:
            concurrent = list(pool.map(run, range(6)))
        require(concurrent == alone, "concurrent and successive runs gave different results")


@check_of(Engine)
def _sites_of_one_pixel_are_independent(component: Engine) -> None:
    """Two sites in one pixel, which do not interact, form their bonds independently (not of an approximate engine)."""
    if not component.exact:  # it may choose the bonded sites without chance
        return
    pixels, rate = 2000, 1e13 * math.exp(-0.8 / (KB * 300))
    sites = np.repeat(np.arange(pixels), 2)
    x = np.stack([sites + np.tile([0.25, 0.75], pixels), np.full(sites.size, 0.5)], axis=1)
    lattice = ReactionLattice(pixels=(pixels, 1), sites=sites, positions=x, forming=np.full(sites.size, 0.8))
    state = component.run(lattice, [math.log(2) / rate], temperature=300, seed=4).state.reshape(pixels, 2)
    both = int(np.count_nonzero(state[:, 0] & state[:, 1]))
    expected = np.count_nonzero(state[:, 0]) * np.count_nonzero(state[:, 1]) / pixels
    # within five standard deviations; with the same random numbers for both sites it would be 45 of them
    require(
        abs(both - expected) < 5 * math.sqrt(pixels / 16),
        f"{pixels} pixels with two sites each, half of which are bonded: both are in {both} pixels, expected about "
        f"{expected:.0f}; take random numbers by lattice.random_index, not by the pixel",
    )


@check_of(Engine)
def _trade_keeps_the_rates(component: Engine) -> None:
    """Every value of ``trade`` gives the right mean number of bonds, to within the declared error."""
    group, time = (coupled(), 1.0) if component.interacting else (single(2.0, 0.7), 0.3)
    for _, variants in trade_variants(component):
        for what, variant in variants:
            counts = sampled(variant, group, time, runs=100)
            compare(variant, f"{what}: after {time} s", counts, group.probabilities(time))


@check_of(Engine)
def _options_keep_the_rates(component: Engine) -> None:
    """With every switch, choice and option for speed, a site that flickers and those around it follow their master
    equation, at rates over 60 decades."""
    copies, runs = (1, 250) if component.exact else (LARGE, 8)
    for what, variant in option_variants(component):
        for seed, (rows, columns) in enumerate(FLICKERING if component.interacting else ((1, 1),)):
            hold = random_hold(seed, rows, columns)
            where = f"{what}: {rows} by {columns} sites at {hold.temperature:.0f} K, after {hold.time:.3g} s"
            compare(variant, where, held(variant, hold, copies, runs, through=(0.1,)), hold.probabilities)


@check_of(Engine)
def _wrong_input_is_refused(component: Engine) -> None:
    """Wrong hold times, temperatures and seeds are InputErrors; temperatures may have units."""
    lattice = _disordered(False, 5)
    for times in ([], [2, 1], [-1], [math.nan], [math.inf], ["soon"], [[1, 2]]):
        refuses(f"hold times {times}", lambda times=times: component.run(lattice, times, temperature=300))  # pyright: ignore
    for kelvin in (0, -3, math.nan, math.inf, "3 eV", "300"):
        refuses(f"temperature {kelvin!r}", lambda kelvin=kelvin: component.run(lattice, [1], temperature=kelvin))
    for seed in (-1, 0.5, "x"):
        refuses(f"seed {seed!r}", lambda seed=seed: component.run(lattice, [1], temperature=300, seed=seed))  # pyright: ignore
    warm = component.run(lattice, [1.0], temperature="26.85 degC", seed=1)
    require(_trace(warm) == _trace(component.run(lattice, [1.0], temperature=300, seed=1)), "26.85 degC is not 300 K")
