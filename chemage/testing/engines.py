"""Checks of a kinetic Monte Carlo engine."""

from __future__ import annotations

import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from chemage.foundation.units import KB
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.testing.checks import (
    CHANCE,
    check_of,
    refuses,
    require,
    require_estimates,
    run_checks,
    seeds_are_harmless,
    speed_variants,
)

_TEMPERATURE = 300.0
_NU = 1e13


def _barrier(rate: float) -> float:
    """The barrier (eV) of a site with ``rate`` (1/s) at 300 K."""
    return KB * _TEMPERATURE * math.log(_NU / rate)


def _independent(n: int, forming: float, breaking: float | None = None) -> ReactionLattice:
    """``n`` sites without interaction, with these rates (1/s)."""
    return ReactionLattice(
        pixels=(max(n, 1), 1),
        sites=np.arange(n),
        forming=np.full(n, _barrier(forming)),
        breaking=None if breaking is None else np.full(n, _barrier(breaking)),
    )


def _disordered(interacting: bool, n: int = 40) -> ReactionLattice:
    """A ring of sites with rates over five decades, with an interaction of nearest neighbours if ``interacting``."""
    rng = np.random.default_rng(7)
    fields: dict[str, Any] = {}
    if interacting:
        pair = rng.uniform(-0.05, 0.1, n)
        fields["neighbours"] = np.stack([(np.arange(n) + 1) % n, (np.arange(n) - 1) % n], axis=1)
        fields["coupling"] = np.stack([pair, np.roll(pair, 1)], axis=1)
    return ReactionLattice(
        pixels=(n, 1),
        sites=np.arange(n),
        forming=np.array([_barrier(10**x) for x in rng.uniform(-3, 2, n)]),
        breaking=np.array([_barrier(10**x) for x in rng.uniform(-3, 1, n)]),
        **fields,
    )


def _trace(history: BondHistory) -> tuple[bytes, ...]:
    parts = (history.bonds, history.formed, history.broken, history.state)
    return tuple(part.tobytes() for part in parts)


def _z(count: int, n: int, probability: float) -> float:
    return (count - n * probability) / math.sqrt(n * probability * (1 - probability))


@check_of("engine")
def _history_adds_up(component: Engine) -> None:
    times = np.geomspace(1e-3, 1e3, 13)
    lattice = _disordered(component.interacting)
    history = component.run(lattice, times, temperature=_TEMPERATURE, seed=1)
    require(isinstance(history, BondHistory), f"run() returned {type(history).__name__}; expected a BondHistory")
    require(np.array_equal(history.hold_times, times), "the hold times are not the given ones")
    require(history.state.shape == lattice.sites.shape, f"state of {history.state.shape}")
    require(history.bonds[-1] == history.state.sum(), "the last count is not that of the final state")
    require(np.array_equal(history.bonds, history.formed - history.broken), "bonds are not formed less broken")
    require(
        (np.diff(history.formed) >= 0).all() and (np.diff(history.broken) >= 0).all(), "the numbers of events decrease"
    )
    require(history.events > 0, "nothing happened in 1000 s at rates up to 100 per second")
    require(history.time == times[-1] and history.temperature == _TEMPERATURE, "wrong time or temperature")
    # an engine that selects another one records which
    known = {component.kind, *registry.current().kinds("engine")}
    require(history.engine in known, f"engine is {history.engine!r}, neither {component.kind!r} nor an installed one")


@check_of("engine")
def _engine_cost_is_estimated(component: Engine) -> None:
    for sites in (0.0, 1.0, 1e7):
        expected = component.expected(sites, component.interacting)
        require_estimates(f"expected({sites})", expected, {"cpu_seconds": math.inf, "bytes": math.inf})


@check_of("engine")
def _run_follows_its_seed(component: Engine) -> None:
    lattice = _disordered(component.interacting, 400)

    def draw(seed: Any) -> tuple[bytes, ...]:
        return _trace(component.run(lattice, [0.1, 1, 10], temperature=300, seed=seed))

    seeds_are_harmless(draw, "run", chance=True)


@check_of("engine")
def _no_sites_is_no_bonds(component: Engine) -> None:
    graphs: list[dict[str, Any]] = [{}]
    if component.interacting:
        graphs += [{"neighbours": np.empty((0, k), np.int32), "coupling": np.empty((0, k))} for k in (0, 8)]
    for graph in graphs:
        for breaking in (None, np.empty(0)):
            none = np.empty(0, np.int64)
            empty = ReactionLattice(pixels=(3, 3), sites=none, forming=np.empty(0), breaking=breaking, **graph)
            history = component.run(empty, [0, 1e5], temperature=300)
            require(history.bonds.tolist() == [0, 0] and history.events == 0, f"{history.bonds} bonds without sites")


@check_of("engine")
def _one_site_is_the_closed_form(component: Engine) -> None:
    """θ(t) = k_f/(k_f + k_b) (1 − exp(−(k_f + k_b) t)), for one site with many seeds and many sites with one seed."""
    if not component.exact:
        return
    forming, breaking = 2.0, 0.7
    times = np.array([0.02, 0.3, 1.0, 6.0])
    expected = forming / (forming + breaking) * (1 - np.exp(-(forming + breaking) * times))
    one, runs = _independent(1, forming, breaking), 400
    single = np.sum([component.run(one, times, temperature=300, seed=seed).bonds for seed in range(runs)], axis=0)
    n = 20000
    many = component.run(_independent(n, forming, breaking), times, temperature=300, seed=11).bonds
    for t, theta, few, lot in zip(times, expected, single, many, strict=True):
        for count, of in ((int(few), runs), (int(lot), n)):
            require(abs(_z(count, of, theta)) < 4.5, f"{count} of {of} bonded after {t} s; expected {of * theta:.1f}")


@check_of("engine")
def _barrierless_is_the_attempt_frequency(component: Engine) -> None:
    """The rate over a barrier at or below zero is the attempt frequency ν."""
    if not component.exact:
        return
    n, times = 5000, np.array([2e-14, 1e-13])
    for energy in (0.0, -0.3, -50.0):
        lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=np.full(n, energy))
        bonds = component.run(lattice, times, temperature=300, seed=2).bonds
        for t, count in zip(times, bonds, strict=True):
            theta = 1 - math.exp(-_NU * t)
            message = f"{count} of {n} sites bonded over {energy} eV; expected {n * theta:.0f}"
            require(abs(_z(int(count), n, theta)) < 4.5, message)


@check_of("engine")
def _bonds_last_without_breaking(component: Engine) -> None:
    n, forming = 5000, 1.0
    times = np.array([0.1, 1.0, 1.0, 2.0, 50.0])
    history = component.run(_independent(n, forming), times, temperature=300, seed=5)
    require((history.broken == 0).all(), f"{history.broken[-1]} bonds broke on a lattice without breaking")
    require((np.diff(history.bonds) >= 0).all(), f"bonds {history.bonds}")
    require(history.bonds[-1] == n, f"{history.bonds[-1]} of {n} bonded after fifty times the mean time")
    if component.exact:
        z = _z(int(history.bonds[1]), n, 1 - math.exp(-forming))
        require(abs(z) < 4.5, f"{history.bonds[1]} of {n} bonded after the mean time")


@check_of("engine")
def _nothing_happens_at_rate_zero(component: Engine) -> None:
    """A lattice whose total rate is 0, also by underflow, does not change and is not an error."""
    n = 7
    for energy in (25.0, 1e4):
        lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=np.full(n, energy))
        history = component.run(lattice, [0, 1, 1e5], temperature=300)
        require(history.events == 0 and history.time == 1e5, f"{history.events} events over {energy} eV")
    full = component.run(_independent(n, 1.0), [1, 1e5], temperature=300, start=np.ones(n, bool))
    require(
        full.bonds.tolist() == [n, n] and full.events == 0,
        "all sites are bonded and no bond breaks, but the state changed",
    )


@check_of("engine")
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


@check_of("engine")
def _start_is_taken(component: Engine) -> None:
    lattice = _disordered(component.interacting)
    start = np.arange(lattice.sites.size) % 3 == 0
    history = component.run(lattice, [0, 100], temperature=300, seed=4, start=start)
    require(history.bonds[0] == start.sum(), f"{history.bonds[0]} bonds at time 0, started with {start.sum()}")
    gained = history.formed - history.broken
    require(np.array_equal(history.bonds, start.sum() + gained), "bonds are not those at the start plus those formed")
    for wrong in (start[:-1], start.astype(int), np.ones((2, 2), bool)):
        refuses("a wrong start", lambda wrong=wrong: component.run(lattice, [1], temperature=300, start=wrong))


@check_of("engine")
def _restart_is_exact(component: Engine) -> None:
    """A run continued from any hold time equals the uninterrupted run to the last bit."""
    if not component.restart:
        return
    times = np.array([0.0, 1e-3, 0.1, 0.1, 1.0, 30.0, 1e3])
    for lattice in (_disordered(component.interacting), _disordered(False), _independent(30, 1.0)):
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
    half = component.run(lattice, [1.0], temperature=300, seed=6)
    refuses("going back", lambda: component.run(lattice, [0.5], temperature=300, seed=6, start=half))
    other = _independent(31, 1.0)
    refuses("another lattice", lambda: component.run(other, [2.0], temperature=300, seed=6, start=half))


@check_of("engine")
def _threads_change_nothing(component: Engine) -> None:
    """Results are the same on one thread and on all, alone and concurrently with other runs."""
    import numba

    lattice = _disordered(component.interacting, 300)

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


@check_of("engine")
def _speed_does_not_change_the_run(component: Engine) -> None:
    """Options in ``speed_only``, such as the number of threads, do not change any bond."""
    rng = np.random.default_rng(9)
    pieces = [_disordered(component.interacting, n) for n in (120, 7, 60, 3, 90)]
    # several rings without interaction between them, which an engine can distribute over threads
    graph: dict[str, Any] = {}
    if component.interacting:
        starts = np.cumsum([0, *(piece.sites.size for piece in pieces)])
        rings = [(piece.neighbours, piece.coupling, start) for piece, start in zip(pieces, starts, strict=False)]
        graph["neighbours"] = np.concatenate([near + start for near, _, start in rings if near is not None])
        graph["coupling"] = np.concatenate([energy for _, energy, _ in rings if energy is not None])
    forming = np.concatenate([piece.forming for piece in pieces])
    breaking = np.concatenate([piece.breaking for piece in pieces if piece.breaking is not None])
    order = rng.permutation(forming.size)
    for fields in ({}, graph):
        lattice = ReactionLattice(
            pixels=(forming.size, 1),
            sites=np.arange(forming.size),
            forming=forming[order],
            breaking=breaking[order],
            **fields,
        )
        plain = _trace(component.run(lattice, [0.1, 10.0], temperature=300, seed=1))
        for what, variant in speed_variants(component):
            trace = _trace(variant.run(lattice, [0.1, 10.0], temperature=300, seed=1))
            require(trace == plain, f"{what}: the result differs")


@check_of("engine")
def _coupled_sites_are_refused_or_right(component: Engine) -> None:
    """Four coupled sites follow their master equation (16 states, χ² test), or are refused with an InputError."""
    rng = np.random.default_rng(8)
    pair = np.triu(rng.uniform(-0.02, 0.06, (4, 4)), 1)
    pair += pair.T
    forming = np.array([_barrier(k) for k in (3.0, 1.0, 0.6, 2.0)])
    breaking = np.array([_barrier(k) for k in (0.5, 1.5, 0.2, 0.9)])
    copies = 3000
    others = np.array([[j for j in range(4) if j != i] for i in range(4)])
    lattice = ReactionLattice(
        pixels=(copies, 4),
        sites=np.arange(4 * copies),
        forming=np.tile(forming, copies),
        breaking=np.tile(breaking, copies),
        neighbours=(others + 4 * np.arange(copies)[:, None, None]).reshape(-1, 3),
        coupling=np.tile(np.take_along_axis(pair, others, axis=1), (copies, 1)),
    )
    if not component.interacting:
        message = refuses("a lattice whose sites interact", lambda: component.run(lattice, [1.0], temperature=300))
        require(component.kind in message, f"the error does not name the engine: {message}")
        return
    if not component.exact:
        return
    from scipy.linalg import expm
    from scipy.stats import chi2

    generator = np.zeros((16, 16))
    for state in range(16):
        bonded = np.array([state >> i & 1 for i in range(4)], dtype=bool)
        for i in range(4):
            energy = breaking[i] if bonded[i] else forming[i] + pair[i][bonded].sum()
            rate = _NU * math.exp(-max(energy, 0.0) / (KB * _TEMPERATURE))
            generator[state ^ 1 << i, state] += rate
            generator[state, state] -= rate
    for t in (0.15, 0.8, 20.0):
        expected = copies * expm(generator * t)[:, 0]
        history = component.run(lattice, [t / 2, t], temperature=300, seed=int(100 * t))
        state = history.state.reshape(copies, 4) @ (1 << np.arange(4))
        counts = np.bincount(state, minlength=16)
        # states too rare for χ² are counted together
        rare = expected < 8
        e, o = np.append(expected[~rare], expected[rare].sum()), np.append(counts[~rare], counts[rare].sum())
        e, o = e[e > 0], o[e > 0]
        statistic = float(np.sum((o - e) ** 2 / e))
        chance = float(chi2.sf(statistic, e.size - 1))
        require(chance > CHANCE, f"after {t} s, states {counts.tolist()}; master equation {expected.round(1).tolist()}")


@check_of("engine")
def _wrong_input_is_refused(component: Engine) -> None:
    lattice = _disordered(False, 5)
    for times in ([], [2, 1], [-1], [math.nan], [math.inf], ["soon"], [[1, 2]]):
        refuses(f"hold times {times}", lambda times=times: component.run(lattice, times, temperature=300))  # pyright: ignore
    for kelvin in (0, -3, math.nan, math.inf, "3 eV", "300"):
        refuses(f"temperature {kelvin!r}", lambda kelvin=kelvin: component.run(lattice, [1], temperature=kelvin))
    for seed in (-1, 0.5, "x"):
        refuses(f"seed {seed!r}", lambda seed=seed: component.run(lattice, [1], temperature=300, seed=seed))  # pyright: ignore
    warm = component.run(lattice, [1.0], temperature="26.85 degC", seed=1)
    require(_trace(warm) == _trace(component.run(lattice, [1.0], temperature=300, seed=1)), "26.85 degC is not 300 K")


def check_engine(component: Engine) -> None:
    """Run every check of the role ``engine``; raises AssertionError if one fails."""
    run_checks(component, Engine, {})
