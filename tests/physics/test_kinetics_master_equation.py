"""Every engine with every option against the master equation of small patches, solved for all states.

A lattice of thousands of copies of a patch, not coupled to each other, holds one sample of the patch's distribution in
each copy.
"""

from __future__ import annotations

import decimal
import functools
import itertools
import math
from typing import Any

import numpy as np
import pytest
from flickering import chance_of, held, random_hold
from scipy import stats
from scipy.linalg import expm

import chemage
from chemage import ReactionLattice
from chemage.plugin import KB, registry
from chemage.testing.checks import Checks
from chemage.testing.small_systems import Group, barrier, coupled, evolved

CHANCE = 1e-5
NU = 1e13
#: (rows, columns, holes)
PATCHES = {"3x3": (3, 3, ()), "2x4 with a hole": (2, 4, (5,))}
TEMPERATURES = (150.0, 300.0, 900.0)
#: multiples of the time at which a barrier of 0.5 eV is crossed once
MULTIPLES = np.array([0.1, 0.5, 1.5, 5.0, 60.0])
INTERACTING = [
    (kind, {})
    for kind in registry.current().kinds("engine")
    if registry.current().component("engine", kind).interacting
]
PLAIN = [kind for kind, _ in INTERACTING]
#: `auto` runs one of the others
ONCE = [pytest.param(kind, marks=pytest.mark.long if kind == "auto" else ()) for kind in PLAIN]


def patch(name: str, temperature: float) -> dict[str, np.ndarray]:
    """Barriers and couplings of a patch; barriers are given in k_BT so that every temperature explores all states."""
    rows, columns, holes = PATCHES[name]
    cells = [divmod(cell, columns) for cell in range(rows * columns) if cell not in holes]
    n = len(cells)
    rng = np.random.default_rng(rows * 10 + columns)
    unit = KB * temperature
    middle = 0.5
    pairs = np.zeros((n, n))
    for i, (x, y) in enumerate(cells):
        for j, (u, v) in enumerate(cells):
            if i < j and max(abs(x - u), abs(y - v)) == 1:
                # in single precision, as interactions give them
                pairs[i, j] = pairs[j, i] = np.float32(unit * rng.uniform(-1.0, 2.5))
    return {
        "forming": middle + unit * rng.uniform(-1.5, 1.5, n),
        "breaking": middle + unit * rng.uniform(-1.0, 1.0, n),
        "pairs": pairs,
    }


def copies_of(one: dict[str, np.ndarray], copies: int) -> ReactionLattice:
    """``copies`` patches that do not interact with each other."""
    n = one["forming"].size
    slots = int(np.count_nonzero(one["pairs"], axis=1).max())
    neighbours = np.full((n, slots), -1)
    coupling = np.zeros((n, slots), np.float32)
    for i in range(n):
        near = np.flatnonzero(one["pairs"][i])
        neighbours[i, : near.size] = near
        coupling[i, : near.size] = one["pairs"][i, near]
    shifted = np.where(neighbours >= 0, neighbours + n * np.arange(copies)[:, None, None], -1)
    return ReactionLattice(
        pixels=(copies, n),
        sites=np.arange(copies * n),
        forming=np.tile(one["forming"], copies),
        breaking=np.tile(one["breaking"], copies),
        neighbours=shifted.reshape(-1, slots),
        coupling=np.tile(coupling, (copies, 1)),
        attempt_frequency=NU,
    )


def generator(one: dict[str, np.ndarray], temperature: float) -> np.ndarray:
    """The matrix of the master equation; bit i of a state's number tells whether site i is bonded."""
    n = one["forming"].size
    matrix = np.zeros((2**n, 2**n))
    for state in range(2**n):
        bonded = np.array([state >> i & 1 for i in range(n)], bool)
        for i in range(n):
            energy = one["breaking"][i] if bonded[i] else one["forming"][i] + one["pairs"][i][bonded].sum()
            rate = NU * math.exp(-max(energy, 0.0) / (KB * temperature))
            matrix[state ^ 1 << i, state] += rate
            matrix[state, state] -= rate
    return matrix


@functools.cache
def solution(name: str, temperature: float) -> tuple[np.ndarray, np.ndarray]:
    """The times (5,) in s and the probability of every state at each, (5, states)."""
    matrix = generator(patch(name, temperature), temperature)
    times = MULTIPLES / (NU * math.exp(-0.5 / (KB * temperature)))
    found, now, before = [], np.eye(matrix.shape[0])[0], 0.0
    for t in times:
        now = expm(matrix * (t - before)) @ now
        found.append(now)
        before = t
    return times, np.array(found)


def agrees(seen: np.ndarray, expected: np.ndarray) -> float:
    """Probability by χ² of counts at least as far from ``expected``; rare states are counted together."""
    order = np.argsort(expected)
    rare = order[: max(int(np.searchsorted(np.cumsum(expected[order]), 8.0)) + 1, 1)]
    rest = np.setdiff1d(order, rare)
    rest = rest[expected[rest] >= 5.0]
    pooled = np.setdiff1d(np.arange(expected.size), rest)
    e = np.append(expected[rest], expected[pooled].sum())
    o = np.append(seen[rest], seen[pooled].sum())
    keep = e > 0
    assert np.all(o[~keep] == 0)
    return float(stats.chi2.sf(np.sum((o[keep] - e[keep]) ** 2 / e[keep]), keep.sum() - 1))


def states(history, n: int) -> np.ndarray:
    return np.bincount(history.state.reshape(-1, n) @ (1 << np.arange(n)), minlength=2**n)


def case(kind: str, name: str, temperature: float) -> Any:
    """At every temperature the same states are explored, and `auto` runs one of the others: a few cases are quick."""
    quick = kind != "auto" and (name, temperature) == ("2x4 with a hole", 300.0)
    return pytest.param(kind, name, temperature, marks=() if quick else pytest.mark.long)


@pytest.mark.parametrize(
    ("kind", "name", "temperature"), [case(*one) for one in itertools.product(PLAIN, PATCHES, TEMPERATURES)]
)
def test_all_states_at_five_times_follow_the_master_equation(kind, name, temperature):
    copies = 4000
    one = patch(name, temperature)
    n = one["forming"].size
    times, expected = solution(name, temperature)
    lattice = copies_of(one, copies)
    engine = chemage.engine(kind)
    number = [bin(state).count("1") for state in range(2**n)]
    history = None
    for t, probability in zip(times, expected, strict=True):
        history = engine.run(lattice, [t], temperature=temperature, seed=21, start=history)
        assert agrees(states(history, n), copies * probability) > CHANCE, f"{t} s"
        mean = probability @ number
        spread = math.sqrt(probability @ np.square(number) - mean**2)
        assert abs(history.bonds[0] / copies - mean) < 4.5 * spread / math.sqrt(copies)


@pytest.mark.parametrize(("copies", "runs"), [(40, 100), pytest.param(8000, 1, marks=pytest.mark.long)])
@pytest.mark.long
def test_the_list_of_fast_sites_changes_no_probability(copies, runs, monkeypatch):
    """On large lattices `rejection-free` lists fast sites and predicts its selections; here on small ones, too."""
    monkeypatch.setattr("chemage_kinetics._rejection_free.FAR", 9)
    name, temperature = "2x4 with a hole", 300.0
    one = patch(name, temperature)
    times, expected = solution(name, temperature)
    lattice = copies_of(one, copies)
    engine = chemage.engine("rejection-free")
    seen = np.zeros((times.size, expected.shape[1]))
    listed = 0
    for seed in range(runs):
        history = None
        for t, time in enumerate(times):
            history = engine.run(lattice, [time], temperature=temperature, seed=seed, start=history)
            seen[t] += states(history, one["forming"].size)
            listed += history.resume["fast"].size
        whole = engine.run(lattice, times, temperature=temperature, seed=seed)
        assert whole.state.tolist() == history.state.tolist()
        assert whole.formed[-1] == history.formed[-1]
    assert (listed > 0) == (copies < 1000)
    for t, probability in enumerate(expected):
        assert agrees(seen[t], copies * runs * probability) > CHANCE, f"{times[t]} s"


@pytest.mark.parametrize("sites", [9, 400, 3000])
def test_prefetching_changes_no_result(sites, monkeypatch):
    """On large lattices `bkl` predicts its attempts and prefetches their memory; this changes nothing but the time."""
    one = patch("3x3", 300.0)
    lattice = copies_of(one, -(-sites // 9))
    times = solution("3x3", 300.0)[0]
    plain = chemage.engine("bkl").run(lattice, times, temperature=300.0, seed=2)
    monkeypatch.setattr("chemage_kinetics._bkl.FAR", 0)
    ahead = chemage.engine("bkl").run(lattice, times, temperature=300.0, seed=2)
    assert plain.formed.tolist() == ahead.formed.tolist()
    assert plain.state.tolist() == ahead.state.tolist()


@pytest.mark.parametrize("kind", PLAIN)
def test_events_are_those_of_the_master_equation(kind):
    """The mean number of bonds formed is the integral of the forming rate over the distribution."""
    temperature, copies, name = 300.0, 1500, "2x4 with a hole"
    one = patch(name, temperature)
    n = one["forming"].size
    matrix = generator(one, temperature)
    forming = np.array(
        [sum(matrix[state ^ 1 << i, state] for i in range(n) if not state >> i & 1) for state in range(2**n)]
    )
    # d/dt (p, ∫ forming·p) is linear, too
    augmented = np.zeros((2**n + 1, 2**n + 1))
    augmented[:-1, :-1] = matrix
    augmented[-1, :-1] = forming
    times = solution(name, temperature)[0]
    expected = np.array([expm(augmented * t)[-1, 0] for t in times])
    history = chemage.engine(kind).run(copies_of(one, copies), times, temperature=temperature, seed=5)
    # the count is less scattered than a Poisson number of the same mean
    assert np.all(np.abs(history.formed - copies * expected) < 4.5 * np.sqrt(copies * expected))


@pytest.mark.parametrize("kind", ONCE)
def test_long_runs_follow_the_boltzmann_weights(kind):
    """Symmetric couplings make detailed balance hold: H = Σ (E_form − E_break) n + Σ pairs ΔE n n."""
    temperature, copies, name = 300.0, 3000, "2x4 with a hole"
    one = patch(name, temperature)
    n = one["forming"].size
    bonded = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    energy = bonded @ (one["forming"] - one["breaking"]) + 0.5 * np.einsum("si,ij,sj->s", bonded, one["pairs"], bonded)
    weights = np.exp(-energy / (KB * temperature))
    weights /= weights.sum()
    assert np.allclose(solution(name, temperature)[1][-1], weights, rtol=0, atol=2e-3)  # the theory agrees with itself
    long = 100.0 / (NU * math.exp(-0.5 / (KB * temperature)))
    history = chemage.engine(kind).run(copies_of(one, copies), [long], temperature=temperature, seed=8)
    assert agrees(states(history, n), copies * weights) > CHANCE


@pytest.mark.parametrize("kind", PLAIN)
def test_no_bonds_break_without_breaking_barriers(kind):
    """Irreversible bonds: the same patches, absorbing in the full state; the master equation without breaking."""
    temperature, copies, name = 300.0, 6000, "2x4 with a hole"
    one = patch(name, temperature)
    n = one["forming"].size
    lattice = copies_of(one, copies)
    lattice = type(lattice)(**{**lattice.todict(), "breaking": None})
    matrix = generator(one, temperature)
    for state in range(2**n):
        for i in range(n):
            if state >> i & 1:
                matrix[state, state] += matrix[state ^ 1 << i, state]
                matrix[state ^ 1 << i, state] = 0.0
    t = solution(name, temperature)[0][2]
    history = chemage.engine(kind).run(lattice, [0.3 * t, t], temperature=temperature, seed=3)
    assert history.broken.tolist() == [0, 0]
    assert agrees(states(history, n), copies * expm(matrix * t)[:, 0]) > CHANCE


@pytest.mark.parametrize("kind", PLAIN)
@pytest.mark.parametrize(("fast", "slow"), [(1, 1), (1, 7), (5, 3)])
def test_selection_follows_the_rates_with_unequal_classes(kind, fast, slow):
    """Rates .99 and .26 share no power of two: an engine that draws its class anew after a rejection within classes of
    exact weights picks them .879 to .121 instead of .792 to .208. Who bonds first blocks all others in its group."""
    copies = 8000
    rates = np.array([0.99] * fast + [0.26] * slow)
    n = rates.size
    temperature = 1.0 / KB / 1000.0  # k_BT = 1 meV
    pairs = np.full((n, n), 5.0)
    np.fill_diagonal(pairs, 0.0)
    one = {"forming": -1e-3 * np.log(rates), "breaking": np.full(n, 9.0), "pairs": pairs}
    lattice = copies_of(one, copies)
    lattice = type(lattice)(**{**lattice.todict(), "attempt_frequency": 1.0})
    history = chemage.engine(kind).run(lattice, [1e3], temperature=temperature, seed=17)
    assert history.events == history.bonds[0] == copies
    first = history.state.reshape(copies, n).sum(axis=0)
    assert stats.chisquare(first, copies * rates / rates.sum()).pvalue > CHANCE


@pytest.mark.parametrize("kind", PLAIN)
def test_waiting_times_are_exponential(kind):
    """The first event of a pair comes at the total rate, though the two differ by half an octave."""
    copies = 8000
    rates = np.array([0.99, 0.26])
    pairs = np.array([[0.0, 5.0], [5.0, 0.0]])
    one = {"forming": -1e-3 * np.log(rates), "breaking": np.full(2, 9.0), "pairs": pairs}
    lattice = copies_of(one, copies)
    lattice = type(lattice)(**{**lattice.todict(), "attempt_frequency": 1.0})
    times = np.linspace(0.1, 4.0, 14)
    history = chemage.engine(kind).run(lattice, times, temperature=1.0 / KB / 1000.0, seed=4)
    cells = np.diff(np.concatenate([[0], history.bonds, [copies]]))
    survival = np.exp(-rates.sum() * np.concatenate([[0.0], times]))
    expected = np.append(-np.diff(survival), survival[-1])
    assert stats.chisquare(cells, copies * expected).pvalue > CHANCE


def exactly(generator: np.ndarray, time: float) -> np.ndarray:
    """The matrix exponential to 250 digits, by scaling and squaring."""
    with decimal.localcontext(prec=250):
        n = generator.shape[0]
        matrix = np.array([[decimal.Decimal(float(value)) for value in row] for row in generator])
        np.fill_diagonal(matrix, 0)
        np.fill_diagonal(matrix, -matrix.sum(axis=0))
        squarings = int(math.log2(float(-matrix.diagonal().min()) * time)) + 20
        matrix = matrix * (decimal.Decimal(time) / 2**squarings)
        found = identity = np.array([[decimal.Decimal(int(i == j)) for j in range(n)] for i in range(n)])
        for k in range(30, 0, -1):
            found = identity + matrix @ found / k
        for _ in range(squarings):
            found = found @ found
        return found.astype(float)


@pytest.mark.parametrize("seed", range(3))
def test_the_master_equation_is_solved_to_the_last_digits_over_sixty_decades(seed):
    """Every probability to twelve digits, the smallest too; that of scipy overflows."""
    rng = np.random.default_rng(seed)
    rates, pair, nu = 10.0 ** rng.uniform(-30.0, 30.0, 4), float(np.float32(rng.normal(0.0, 0.3))), 1e40
    barriers = tuple(barrier(rate, nu=nu) for rate in rates)
    generator = Group(barriers[:2], barriers[2:], ((0.0, pair), (pair, 0.0))).generator(nu=nu)
    assert np.allclose(evolved(generator, 3.0)[0], exactly(generator, 3.0), rtol=1e-12, atol=1e-280)


def test_the_mean_numbers_of_events_are_integrals_over_the_master_equation():
    generator = coupled().generator()
    leaving = -generator.diagonal()
    augmented = np.pad(generator, (0, 1))
    augmented[-1, :-1] = leaving
    for time in (0.01, 1.0, 40.0):
        assert np.allclose(evolved(generator, time, leaving[:, None])[1][:, 0], expm(augmented * time)[-1, :-1], 1e-10)


#: rows and columns of random lattices, in turn
SHAPES = ((1, 2), (1, 2), (2, 2), (1, 2), (1, 3), (1, 2), (1, 2), (2, 3), (1, 2), (3, 3))


@pytest.mark.parametrize(
    ("kind", "numbers", "far"),
    [
        ("rejection-free", [0, 1, 3, 59], 10**6),
        *(
            pytest.param(kind, [0, 1, 3, 59], 10**6, marks=pytest.mark.campaign if kind == "auto" else pytest.mark.long)
            for kind in PLAIN
            if kind != "rejection-free"
        ),
        *(
            pytest.param(
                kind, range(59, 66), 10**6, marks=pytest.mark.long if kind == "next-reaction" else pytest.mark.campaign
            )
            for kind in PLAIN
            if kind != "auto"
        ),
        # the same on more lattices
        *(pytest.param(kind, range(66, 79), 10**6, marks=pytest.mark.campaign) for kind in PLAIN if kind != "auto"),
        # on nine sites, as on a large lattice: predicting, with a list of fast sites
        *(
            pytest.param(
                kind, (319, 369), 9, marks=pytest.mark.long if kind == "rejection-free" else pytest.mark.campaign
            )
            for kind in PLAIN
            if kind != "auto"
        ),
    ],
)
def test_random_lattices_follow_the_master_equation_with_every_option(kind, numbers, far, monkeypatch):
    """Rates over 60 decades beside a site that flickers: 60 times, and with superbasins up to 1e25 times; see
    `benchmarks/master_equation.py`."""
    for kernel in ("_rejection_free", "_bkl"):
        monkeypatch.setattr(f"chemage_kinetics.{kernel}.FAR", far)
    monkeypatch.setattr("chemage_kinetics.engines.PIECE", 1)  # so that threads share few sites
    chances = []
    for at, (what, engine) in enumerate(Checks(chemage.engine(kind)).option_variants()):
        fast = getattr(engine, "superbasins", False)
        for number in numbers:
            hold = random_hold(number, *SHAPES[number % len(SHAPES)], flips=1e25 if fast and number % 2 else 60.0)
            copies = 1 if fast and kind != "next-reaction" else 2
            counts = held(engine, hold, copies, 120 // copies, through=(1e-3, 0.2), restart=number % 3 == 0)
            chances.append(chance_of(counts, hold.probabilities, np.random.default_rng((number, at))))
            assert chances[-1] > CHANCE, f"{what}, random_hold({number}, ...)"
    assert stats.kstest(chances, "uniform").pvalue > CHANCE
