"""What breaks codes of this kind, for every engine: 40 decades of rates, stalled clocks, tiny and odd graphs."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

import chemage
from chemage import InputError, ReactionLattice
from chemage.plugin import KB, registry

KINDS = registry.current().kinds("engine")
#: `auto` runs one of the others
ONCE = [pytest.param(kind, marks=pytest.mark.long if kind == "auto" else ()) for kind in KINDS]
COUPLED = [kind for kind in KINDS if registry.current().component("engine", kind).interacting]
COUPLED_ONCE = [pytest.param(kind, marks=pytest.mark.long if kind == "auto" else ()) for kind in COUPLED]
FAST = ["rejection-free", "bkl", "next-reaction"]
CHANCE = 1e-5
NU = 1e13


def alone(forming, breaking=None, nu=NU) -> ReactionLattice:
    forming = np.asarray(forming, float)
    return ReactionLattice(
        pixels=(max(forming.size, 1), 1),
        sites=np.arange(forming.size),
        forming=forming,
        breaking=breaking,
        attempt_frequency=nu,
    )


def moore(rows: int, columns: int, sites: np.ndarray, periodic: bool = True) -> np.ndarray:
    """(n, 8) positions of the neighbours in ``sites``, each once, never the site itself, -1 = none."""
    rank = np.full(rows * columns, -1)
    rank[sites] = np.arange(sites.size)
    table = np.full((sites.size, 8), -1)
    for i, (x, y) in enumerate(zip(*np.divmod(sites, columns), strict=True)):
        near = set()
        for a in (-1, 0, 1):
            for b in (-1, 0, 1):
                u, v = x + a, y + b
                if periodic:
                    u, v = u % rows, v % columns
                if 0 <= u < rows and 0 <= v < columns:
                    near.add(int(rank[u * columns + v]))
        near -= {i, -1}
        table[i, : len(near)] = sorted(near)
    return table


def grid(rows, columns, sites=None, seed=0, low=-0.05, high=0.1, forming=0.8, breaking=0.85, spread=0.05, **more):
    """A periodic grid with pair energies between ``low`` and ``high`` eV."""
    rng = np.random.default_rng(seed)
    sites = np.arange(rows * columns) if sites is None else np.asarray(sites)
    near = moore(rows, columns, sites)
    n = sites.size
    pairs = np.triu(rng.uniform(low, high, (n, n)), 1)
    pairs += pairs.T
    return ReactionLattice(
        pixels=(rows, columns),
        sites=sites,
        forming=forming + spread * rng.uniform(-1, 1, n),
        breaking=breaking + spread * rng.uniform(-1, 1, n),
        neighbours=near,
        # in single precision, as interactions give them
        coupling=np.where(near >= 0, pairs[np.arange(n)[:, None], near], 0.0).astype(np.float32),
        **more,
    )


def exact(lattice: ReactionLattice, temperature: float, times, start: int = 0) -> np.ndarray:
    """Probability of every state at each time, (m, 2^n), by matrix exponential."""
    n = lattice.sites.size
    matrix = np.zeros((2**n, 2**n))
    for state in range(2**n):
        bonded = np.array([state >> i & 1 for i in range(n)], bool)
        for i in range(n):
            if bonded[i]:
                energy = lattice.breaking[i]
            else:
                energy = lattice.forming[i]
                if lattice.neighbours is not None:
                    near = lattice.neighbours[i]
                    energy += lattice.coupling[i][(near >= 0) & bonded[near]].sum()
            rate = lattice.attempt_frequency * math.exp(-min(max(energy, 0.0) / (KB * temperature), 700.0))
            matrix[state ^ 1 << i, state] += rate
            matrix[state, state] -= rate
    return np.array([expm(matrix * t)[:, start] for t in times])


def sampled(kind, lattice, temperature, time, runs, **options) -> np.ndarray:
    """How often each state was the final one."""
    n = lattice.sites.size
    engine = chemage.engine(kind, **options)
    seen = np.zeros(2**n)
    for seed in range(runs):
        seen[engine.run(lattice, [time], temperature=temperature, seed=seed).state @ (1 << np.arange(n))] += 1
    return seen


def agree(seen: np.ndarray, probability: np.ndarray) -> float:
    """χ² probability; states expected less than 5 times are counted together."""
    expected = probability * seen.sum()
    common = expected >= 5
    e = np.append(expected[common], max(expected[~common].sum(), 0.0))
    o = np.append(seen[common], seen[~common].sum())
    if e[-1] < 0.5:  # too rare to compare; but nothing that rare may be common
        assert o[-1] <= 5
        e, o = e[:-1], o[:-1]
    if e.size < 2:
        return 1.0
    return float(stats.chisquare(o, e * o.sum() / e.sum()).pvalue)


@pytest.mark.parametrize("kind", KINDS)
def test_the_clock_does_not_stall(kind):
    """t = 1e5 s and a rate of 1e13 Hz: a double is 1.5e-11 s wide there, a hundred and fifty events."""
    lattice = alone([0.0], [0.0])
    late = 1e5
    first = chemage.engine(kind).run(alone([5.0], [5.0]), [late], temperature=300, seed=1)
    window = 1024 * np.spacing(late)
    history = chemage.engine(kind).run(lattice, [late, late + window], temperature=300, seed=1, start=first)
    expected = NU * window
    assert abs(history.events - expected) < 6 * math.sqrt(expected)
    assert abs(history.formed[-1] - expected / 2) < 6 * math.sqrt(expected)


@pytest.mark.parametrize("kind", KINDS)
def test_events_within_one_spacing_of_doubles_have_their_own_times(kind):
    """Between 1e5 s and the next double there are thousands of events; the law is that of the short time."""
    late = 1e5
    window = np.spacing(late)
    n = 4000
    lattice = alone(np.zeros(n), np.full(n, 60.0), nu=1.0 / window)
    waiting = chemage.engine(kind).run(alone(np.full(n, 60.0), np.full(n, 60.0)), [late], temperature=300, seed=2)
    history = chemage.engine(kind).run(lattice, [late, late + window], temperature=300, seed=3, start=waiting)
    assert history.bonds[0] == 0
    assert abs(history.bonds[1] - n * (1 - math.exp(-1))) < 4.5 * math.sqrt(n * math.exp(-1) * (1 - math.exp(-1)))


@pytest.mark.parametrize("kind", KINDS)
def test_barriers_at_and_below_zero_are_the_attempt_frequency(kind):
    n, t = 3000, 1e-13
    theta = 1 - math.exp(-NU * t)
    for barrier in (0.0, -1e-9, -18.5, -50.0, -1e5):
        bonds = chemage.engine(kind).run(alone(np.full(n, barrier)), [t], temperature=300, seed=2).bonds[0]
        assert abs(bonds - n * theta) < 4.5 * math.sqrt(n * theta * (1 - theta)), barrier


@pytest.mark.parametrize("kind", KINDS)
def test_rates_that_underflow_are_zero(kind):
    for barrier in (19.2, 50.0, 1e6):
        history = chemage.engine(kind).run(alone(np.full(5, barrier), np.full(5, barrier)), [0.0, 1e9], temperature=300)
        assert history.events == 0, barrier
        assert history.time == 1e9


@pytest.mark.parametrize("kind", KINDS)
def test_total_rate_zero_returns_the_state_at_the_end(kind):
    full = np.ones(4, bool)
    history = chemage.engine(kind).run(alone(np.full(4, 0.5)), [0.0, 1.0, 1e9], temperature=300, start=full)
    assert history.bonds.tolist() == [4, 4, 4]
    assert history.events == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("temperature", [1.0, 3000.0, 1e-2, 1e5])
def test_cold_and_hot(kind, temperature):
    """One reversible site whose barriers are ln 10 and ln 20 in k_BT, at any temperature."""
    unit = KB * temperature
    n = 4000
    lattice = alone(np.full(n, unit * math.log(10)), np.full(n, unit * math.log(20)), nu=1e3)
    times = np.array([2e-3, 1e-2, 0.5])
    bonds = chemage.engine(kind).run(lattice, times, temperature=temperature, seed=4).bonds
    theta = 2 / 3 * (1 - np.exp(-150.0 * times))
    assert np.all(np.abs(bonds - n * theta) < 4.5 * np.sqrt(n * theta * (1 - theta)))


@pytest.mark.parametrize("kind", KINDS)
def test_ordinary_barriers_at_one_kelvin_do_nothing(kind):
    history = chemage.engine(kind).run(alone([0.8, 1.1, 0.1], [1.1, 1.1, 0.1]), [1e5], temperature=1.0)
    assert history.events == 0


@pytest.mark.parametrize("nu", [1.0, 1e16])
@pytest.mark.parametrize("kind", KINDS)
def test_attempt_frequencies_from_one_to_1e16(kind, nu):
    n = 3000
    lattice = alone(np.full(n, 0.2), np.full(n, 0.21), nu=nu)
    forms, breaks = (nu * math.exp(-e / (KB * 300)) for e in (0.2, 0.21))
    times = np.array([0.1, 0.7, 3.0]) / (forms + breaks)
    bonds = chemage.engine(kind).run(lattice, times, temperature=300, seed=5).bonds
    theta = forms / (forms + breaks) * (1 - np.exp(-(forms + breaks) * times))
    assert np.all(np.abs(bonds - n * theta) < 4.5 * np.sqrt(n * theta * (1 - theta)))


@pytest.mark.parametrize("kind", COUPLED)
def test_couplings_of_five_electronvolt_either_way(kind):
    """One pair attracts by 5 eV (the second bond forms without a barrier), one repels by 5 eV (it never forms)."""
    copies = 2000
    near = np.arange(4 * copies)[:, None] ^ 1
    lattice = ReactionLattice(
        pixels=(copies, 4),
        sites=np.arange(4 * copies),
        forming=np.full(4 * copies, 0.8),
        breaking=np.full(4 * copies, 2.0),
        neighbours=near,
        coupling=np.tile(np.float32([[-5.0], [-5.0], [5.0], [5.0]]), (copies, 1)),
    )
    rate = NU * math.exp(-0.8 / (KB * 300))
    t = 0.7 / rate
    state = chemage.engine(kind).run(lattice, [t], temperature=300, seed=6).state.reshape(copies, 4)
    either = 1 - math.exp(-2 * 0.7)
    for pair in (state[:, :2], state[:, 2:]):
        assert abs(pair.any(axis=1).sum() - copies * either) < 4.5 * math.sqrt(copies * either * (1 - either))
    assert np.array_equal(state[:, 0], state[:, 1])
    assert not np.any(state[:, 2] & state[:, 3])


@pytest.mark.parametrize("kind", COUPLED_ONCE)
def test_barriers_pushed_below_zero_and_back(kind):
    """Couplings carry barriers through zero: fixed-point energies come back exactly, the rate below zero is ν."""
    lattice = grid(2, 3, low=-0.12, high=0.12, forming=0.06, breaking=0.08, spread=0.05, attempt_frequency=1.0)
    t = 3.0
    assert agree(sampled(kind, lattice, 300.0, t, 600), exact(lattice, 300.0, [t])[0]) > CHANCE


@pytest.mark.parametrize("kind", KINDS)
def test_a_million_sites_with_one_a_hundred_billion_billion_times_faster(kind):
    """The fast one goes first, and the others keep their rates to the last digit beside it."""
    n = 1_000_000
    forming = np.full(n, KB * 300 * math.log(NU * 1e8))  # 1e-8 per second
    forming[777_777] = KB * 300 * math.log(NU / 1e12)  # 1e12 per second
    times = np.array([1e-10, 1.0, 1e6])
    history = chemage.engine(kind).run(alone(forming), times, temperature=300, seed=7)
    assert history.bonds[:2].tolist() == [1, 1]
    theta = 1 - math.exp(-1e-2)
    assert abs(history.bonds[2] - 1 - n * theta) < 4.5 * math.sqrt(n * theta)
    assert history.state[777_777]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["rejection-free", pytest.param("bkl", marks=pytest.mark.campaign), "next-reaction"])
def test_a_million_slow_sites_beside_one_that_flips_with_the_acceleration(kind):
    """1e12 flips a second beside a million sites of 1e-8: only the acceleration gets anywhere, and it is exact."""
    n = 1_000_000
    forming = np.full(n, KB * 300 * math.log(NU * 1e8))
    breaking = np.full(n, 3.0)
    forming[5] = breaking[5] = KB * 300 * math.log(NU / 1e12)
    lattice = alone(forming, breaking)
    history = chemage.engine(kind, superbasins=True).run(lattice, [1e4], temperature=300, seed=7)
    slow = history.bonds[0] - history.state[5]
    theta = 1 - math.exp(-1e-4)
    assert abs(slow - n * theta) < 4.5 * math.sqrt(n * theta)
    assert 1e15 < history.formed[0] < 1e16


@pytest.mark.parametrize("kind", KINDS)
def test_no_site_and_one_site(kind):
    empty = chemage.engine(kind).run(alone([]), [0.0, 1e5], temperature=300)
    assert empty.bonds.tolist() == [0, 0]
    one = chemage.engine(kind).run(alone([0.3], [2.0]), [0.0, 1.0], temperature=300)
    assert one.bonds.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("rows", "columns"),
    [(1, 2), (2, 3), *(pytest.param(*shape, marks=pytest.mark.long) for shape in ((1, 1), (2, 2), (1, 5), (1, 7)))],
)
@pytest.mark.parametrize("kind", COUPLED_ONCE)
def test_tiny_and_two_wide_periodic_grids(kind, rows, columns):
    """On a grid two or three pixels wide one pixel is a neighbour on both sides; it counts once."""
    lattice = grid(rows, columns)
    t = 1.0 / (NU * math.exp(-0.8 / (KB * 300)))
    assert agree(sampled(kind, lattice, 300.0, t, 500), exact(lattice, 300.0, [t])[0]) > CHANCE


@pytest.mark.parametrize("kind", COUPLED_ONCE)
def test_a_patch_that_spans_the_periodic_boundary(kind):
    """Sites in the four corners of a 5 x 7 grid are one patch."""
    lattice = grid(5, 7, sites=[0, 1, 6, 28, 34], low=0.02, high=0.1)
    assert np.count_nonzero(lattice.neighbours >= 0) > 12
    t = 1.5 / (NU * math.exp(-0.8 / (KB * 300)))
    assert agree(sampled(kind, lattice, 300.0, t, 500), exact(lattice, 300.0, [t])[0]) > CHANCE


@pytest.mark.parametrize("kind", KINDS)
def test_bonds_are_counted_before_the_event_that_crosses_a_hold_time(kind):
    """One site that bonds at time τ: bonds are 0 at all hold times before τ and 1 after, however fine the list."""
    rate = NU * math.exp(-0.8 / (KB * 300))
    fine = np.linspace(0, 5 / rate, 4001)
    for seed in range(10):
        bonds = chemage.engine(kind).run(alone([0.8]), fine, temperature=300, seed=seed).bonds
        coarse = chemage.engine(kind).run(alone([0.8]), fine[::400], temperature=300, seed=seed).bonds
        assert set(np.diff(bonds).tolist()) <= {0, 1}
        assert bonds[0] == 0
        assert np.array_equal(bonds[::400], coarse)


@pytest.mark.parametrize("kind", KINDS)
def test_hold_times_may_be_many_equal_and_zero(kind):
    lattice = alone(np.linspace(0.6, 1.0, 50), np.full(50, 0.9))
    times = np.sort(np.concatenate([np.zeros(3), np.repeat(np.geomspace(1e-6, 1e3, 40), 3), np.linspace(0, 1e3, 500)]))
    history = chemage.engine(kind).run(lattice, times, temperature=300, seed=1)
    single, where = np.unique(times, return_inverse=True)
    once = chemage.engine(kind).run(lattice, single, temperature=300, seed=1)
    assert np.array_equal(history.bonds, once.bonds[where])
    assert np.array_equal(history.formed, once.formed[where])


@pytest.mark.parametrize("kind", KINDS)
def test_a_restart_at_any_hold_time_equals_the_uninterrupted_run(kind):
    lattice = grid(5, 7) if kind in COUPLED else alone(np.linspace(0.6, 1.0, 35), np.full(35, 0.8))
    times = np.array([0.0, 1e-3, 0.02, 0.02, 1.0, 5.0, 20.0])
    engine = chemage.engine(kind)
    for seed in range(3):
        whole = engine.run(lattice, times, temperature=300, seed=seed)
        history, parts = None, []
        for t in times:
            history = engine.run(lattice, [t], temperature=300, seed=seed, start=history)
            parts.append(history)
        assert np.concatenate([part.bonds for part in parts]).tolist() == whole.bonds.tolist()
        assert np.concatenate([part.formed for part in parts]).tolist() == whole.formed.tolist()
        assert parts[-1].state.tolist() == whole.state.tolist()
        for name, array in whole.resume.items():
            assert np.array_equal(parts[-1].resume[name], array), name


@pytest.mark.parametrize("kind", KINDS)
def test_a_restart_with_other_barriers_keeps_state_and_clock(kind):
    """A second at 300 K, then 400 K: the closed form, piecewise. And a barrier that falls to zero at once."""
    n = 4000
    lattice = alone(np.full(n, 0.8), np.full(n, 0.85))
    engine = chemage.engine(kind)
    rates = {t: [NU * math.exp(-e / (KB * t)) for e in (0.8, 0.85)] for t in (300.0, 400.0)}
    theta = 0.0
    for t, span in ((300.0, 1.0), (400.0, 0.002)):
        forms, breaks = rates[t]
        rest = forms / (forms + breaks)
        theta = rest + (theta - rest) * math.exp(-(forms + breaks) * span)
    cold = engine.run(lattice, [1.0], temperature=300, seed=9)
    hot = engine.run(lattice, [1.0, 1.002], temperature=400, seed=9, start=cold)
    assert hot.bonds[0] == cold.bonds[0]
    assert abs(hot.bonds[1] - n * theta) < 4.5 * math.sqrt(n * theta * (1 - theta))
    assert hot.formed[0] == cold.formed[0]
    open_ = engine.run(alone(np.zeros(n)), [1.0, 1.0 + 1e-10], temperature=300, seed=9, start=cold)
    assert open_.bonds.tolist() == [cold.bonds[0], n]


@pytest.mark.parametrize("kind", COUPLED_ONCE)
def test_another_engine_can_continue_a_history(kind):
    """State and clock can be passed from engine to engine without an effect on the distribution."""
    lattice = grid(2, 3)
    t = 1.0 / (NU * math.exp(-0.8 / (KB * 300)))
    other = "bkl" if kind != "bkl" else "rejection-free"
    seen = np.zeros(64)
    for seed in range(400):
        half = chemage.engine(other).run(lattice, [0.4 * t], temperature=300, seed=seed)
        history = chemage.engine(kind).run(lattice, [t], temperature=300, seed=seed, start=half)
        seen[history.state @ (1 << np.arange(6))] += 1
    assert agree(seen, exact(lattice, 300.0, [t])[0]) > CHANCE


@pytest.mark.parametrize("kind", ONCE)
def test_a_start_state_counts_with_its_couplings(kind):
    lattice = grid(2, 3) if kind in COUPLED else alone(np.full(6, 0.8), np.full(6, 0.85))
    t = 0.6 / (NU * math.exp(-0.8 / (KB * 300)))
    begin = np.array([1, 0, 1, 1, 0, 0], bool)
    seen = np.zeros(64)
    for seed in range(400):
        history = chemage.engine(kind).run(lattice, [t], temperature=300, seed=seed, start=begin)
        seen[history.state @ (1 << np.arange(6))] += 1
    assert agree(seen, exact(lattice, 300.0, [t], start=int(begin @ (1 << np.arange(6))))[0]) > CHANCE


@pytest.mark.parametrize("kind", KINDS)
def test_replicas_differ_and_repeat(kind):
    lattice = alone(np.linspace(0.7, 1.0, 400), np.full(400, 0.85))
    root = np.random.SeedSequence(3)
    states = [
        chemage.engine(kind).run(lattice, [1.0], temperature=300, seed=child).state.tobytes()
        for child in root.spawn(20)
    ]
    assert len(set(states)) == 20
    again = np.random.SeedSequence(3).spawn(1)[0]
    assert chemage.engine(kind).run(lattice, [1.0], temperature=300, seed=again).state.tobytes() == states[0]


@pytest.mark.parametrize("kind", ["next-reaction", "independent", "auto"])
def test_results_do_not_depend_on_the_number_of_threads(kind):
    """Many patches of all sizes, more than one piece of work; every array of the history is compared."""
    rng = np.random.default_rng(4)
    n = 130_000
    forming = rng.uniform(0.7, 1.2, n)
    breaking = rng.normal(0.95, 0.02, n)
    chain = {}
    if kind != "independent":
        cut = rng.random(n) < 0.05
        cut[0] = True
        left = np.where(cut, -1, np.arange(n) - 1)
        right = np.append(left[1:] + 1, 0)
        right = np.where(np.append(cut[1:], True), -1, right)
        pair = rng.uniform(-0.05, 0.2, n)
        energies = np.stack([np.where(cut, 0, pair), np.append(np.where(cut[1:], 0, pair[1:]), 0)], axis=1)
        chain = {"neighbours": np.stack([left, right], axis=1), "coupling": energies.astype(np.float32)}
    lattice = ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=forming, breaking=breaking, **chain)
    times = np.geomspace(1e-3, 1e3, 7)
    histories = [
        chemage.engine(kind, threads=threads).run(lattice, times, temperature=300, seed=1) for threads in (1, 2, 5)
    ]
    assert histories[0].events > n / 2
    assert histories[0] == histories[1] == histories[2]


@pytest.mark.parametrize("kind", KINDS)
def test_runs_side_by_side_do_not_disturb_each_other(kind):
    lattice = grid(7, 11) if kind in COUPLED else alone(np.linspace(0.6, 1.0, 77), np.full(77, 0.8))
    engine = chemage.engine(kind)

    def run(seed: int):
        return engine.run(lattice, [0.1, 10.0], temperature=300, seed=seed)

    one_by_one = [run(seed) for seed in range(12)]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(run, range(12))) == one_by_one


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=pytest.mark.long if kind == "rejection-free" else pytest.mark.campaign)
        for kind in COUPLED
    ],
)
def test_couplings_in_single_precision_are_used_as_they_are(kind):
    """The kernels of either precision give the same events."""
    single = grid(5, 7)
    rounded = type(single)(**{**single.todict(), "coupling": single.coupling.astype(np.float64)})
    one = chemage.engine(kind).run(single, [1.0, 10.0], temperature=300, seed=2)
    two = chemage.engine(kind).run(rounded, [1.0, 10.0], temperature=300, seed=2)
    assert one.formed.tolist() == two.formed.tolist()
    assert one.state.tolist() == two.state.tolist()


@pytest.mark.parametrize(
    ("times", "temperature", "word"),
    [
        ([2.0, 1.0], 300.0, "hold_times"),
        ([-1.0], 300.0, "hold_times"),
        ([math.nan], 300.0, "hold_times"),
        ([math.inf], 300.0, "hold_times"),
        ([], 300.0, "hold_times"),
        ([1.0], 0.0, "temperature"),
        ([1.0], -5.0, "temperature"),
        ([1.0], math.nan, "temperature"),
    ],
)
def test_bad_times_and_temperatures_are_refused(times, temperature, word):
    for kind in KINDS:
        with pytest.raises(InputError, match=word):
            chemage.engine(kind).run(alone([1.0]), times, temperature=temperature)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"forming": [1.0]}, "forming"),
        ({"breaking": [1.0, 1.0]}, "breaking"),
        ({"forming": [1.0, math.nan, 1.0]}, "forming"),
        ({"sites": [0, 1, 1]}, "twice"),
        ({"sites": [1, 0, 2]}, "ascending"),
        ({"sites": [0, 1, 9]}, "sites"),
        ({"coupling": [[0.1, 0], [0.2, 0.3], [0.3, 0]]}, "symmetric"),
        ({"neighbours": [[1, -1], [0, -1], [1, -1]]}, "both ends"),
        ({"neighbours": [[0, -1], [0, 2], [1, -1]]}, "own neighbour"),
        ({"neighbours": [[1, 1], [0, 2], [1, -1]]}, "twice"),
        ({"neighbours": [[7, -1], [0, 2], [1, -1]]}, "7"),
        ({"coupling": [[0.1], [0.1], [0.3]]}, "coupling"),
        ({"attempt_frequency": 0.0}, "attempt_frequency"),
    ],
)
def test_bad_lattices_are_refused(fields, word):
    good = {
        "pixels": (3, 1),
        "sites": [0, 1, 2],
        "forming": np.ones(3),
        "breaking": np.ones(3),
        "neighbours": [[1, -1], [0, 2], [1, -1]],
        "coupling": [[0.1, 0], [0.1, 0.3], [0.3, 0]],
    }
    ReactionLattice(**good)
    with pytest.raises(InputError, match=word):
        ReactionLattice(**{**good, **fields})
