"""Sites of two, three and four states against the master equation, isotherms, and the same run in pieces."""

from __future__ import annotations

import itertools
import math
import pickle
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import expm_multiply
from scipy.stats import binom, chi2, kstest

import chemage as ca
from chemage import InputError, ReactionLattice
from chemage.plugin import KB, Ramp
from chemage.testing.small_systems import barrier

NU, KELVIN = 1e13, 300.0
NAMES = ("free", "bonded", "dry", "blocked")
#: sites of a grid of 2 x 3, each a neighbour of those beside and diagonal to it
GRID = list(itertools.product(range(2), range(3)))
PAIRS = [
    (i, j)
    for i, j in itertools.combinations(range(6), 2)
    if max(abs(a - b) for a, b in zip(GRID[i], GRID[j], strict=True)) == 1
]


class Model:
    """Six coupled sites: barriers and couplings of random numbers, of rates about one per second."""

    def __init__(self, states: int, seed: int) -> None:
        rng = np.random.default_rng((states, seed))
        self.count, unit = states, KB * KELVIN

        def energies(*shape: int) -> np.ndarray:
            return float(barrier(1.0)) + unit * rng.uniform(-1.5, 1.5, shape)

        self.forming, self.breaking = energies(6), energies(6)
        self.coupling = np.zeros((6, 6), np.float32)
        for i, j in PAIRS:
            self.coupling[i, j] = self.coupling[j, i] = unit * rng.uniform(-1.0, 2.0)
        every = [pair for pair in itertools.permutations(range(states), 2) if max(pair) > 1]
        # some pairs of states twice, some not at all, and a second way of bonding
        chosen = [every[k] for k in rng.integers(0, len(every), 3 * (states - 2))] + [(0, 1)] if every else []
        self.pairs = np.array(chosen, int).reshape(-1, 2)
        self.barriers = energies(6, len(chosen))
        self.terms = np.column_stack([rng.uniform(-1.0, 1.5, len(chosen)), rng.uniform(0.2, 3.0, len(chosen))])
        # one that something leaves
        self.initial = int(rng.choice([0, *(before for before, _ in chosen if before != 1)]))

    def lattice(self, copies: int) -> ReactionLattice:
        near = [np.flatnonzero(row) for row in self.coupling]
        slots = max(row.size for row in near)
        neighbours = np.full((6, slots), -1)
        coupling = np.zeros((6, slots), np.float32)
        for i, row in enumerate(near):
            neighbours[i, : row.size], coupling[i, : row.size] = row, self.coupling[i, row]
        shifted = np.where(neighbours >= 0, neighbours + 6 * np.arange(copies)[:, None, None], -1)
        further = {
            "states": NAMES[: self.count],
            "initial": self.initial,
            "transitions": self.pairs,
            "transition_barriers": np.tile(self.barriers, (copies, 1)),
            "transition_terms": self.terms,
        }
        return ReactionLattice(
            pixels=(copies, 6),
            sites=np.arange(6 * copies),
            forming=np.tile(self.forming, copies),
            breaking=np.tile(self.breaking, copies),
            neighbours=shifted.reshape(-1, slots),
            coupling=np.tile(coupling, (copies, 1)),
            attempt_frequency=NU,
            **(further if self.count > 2 else {}),
        )

    def generator(self, kelvin: float = KELVIN, risen: float = 0.0) -> csc_array:
        """Rates from each of the states of six sites to each other one; site i is digit i of the number of a state.
        ``risen``: eV that are added to forming and taken from breaking barriers."""
        ways = [(0, 1, self.forming + risen, 1.0, 1.0), (1, 0, self.breaking - risen, 0.0, 1.0)]
        ways += [
            (*pair, self.barriers[:, t], *term)
            for t, (pair, term) in enumerate(zip(self.pairs, self.terms, strict=True))
        ]
        rows, columns, rates = [], [], []
        digits = self.count ** np.arange(6)
        for state in range(self.count**6):
            now = state // digits % self.count
            felt = self.coupling.astype(float) @ (now == 1)
            for i, (before, after, energy, share, factor) in itertools.product(range(6), ways):
                if now[i] == before:
                    height = max(energy[i] + share * felt[i], 0.0)
                    rate = factor * NU * math.exp(-height / (KB * kelvin))
                    rows += [state + (after - before) * digits[i], state]
                    columns += [state, state]
                    rates += [rate, -rate]
        shape = (self.count**6, self.count**6)
        return csc_array(coo_array((rates, (rows, columns)), shape=shape))

    def start(self) -> np.ndarray:
        return np.eye(1, self.count**6, sum(self.initial * self.count**i for i in range(6)))[0]

    def counts(self, occupied: np.ndarray) -> np.ndarray:
        return np.bincount(occupied.reshape(-1, 6) @ self.count ** np.arange(6), minlength=self.count**6)


def of_three(numbers: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Of the numbers of all states of six sites, those of three of the sites."""
    sites = np.random.default_rng(seed).choice(6, 3, replace=False)
    state = np.arange(count**6)[:, None] // count**sites % count
    return np.bincount(state @ count ** np.arange(3), numbers, count**3)


def chance(seen: np.ndarray, probabilities: np.ndarray) -> float:
    """Probability by χ² of counts as far from the expected ones, rare states together."""
    expected = seen.sum() * probabilities
    order = np.argsort(-expected)
    cells, tail = np.split(order, [int(np.count_nonzero(expected >= 8.0))])
    parts = [(seen[c], expected[c]) for c in cells]
    parts += [(seen[tail].sum(), expected[tail].sum())] if expected[tail].sum() > 8.0 else []
    return float(chi2.sf(sum((s - e) ** 2 / e for s, e in parts), len(parts) - 1))


@pytest.mark.long
@pytest.mark.parametrize("count", [2, 3, 4])
def test_interacting_sites_follow_the_master_equation(count):
    engine, chances = ca.engine("many-states"), []
    for seed in range(24):
        model = Model(count, seed)
        time = float(np.random.default_rng(seed).uniform(0.2, 2.0))
        lattice = model.lattice(1500)
        if seed % 2:
            history = engine.run(lattice, [time], temperature=KELVIN, seed=seed)
        else:  # stopped on the way
            history = engine.run(lattice, [0.4 * time], temperature=KELVIN, seed=seed)
            history = engine.run(lattice, [time], temperature=KELVIN, seed=seed, start=history)
        occupied = history.resume["occupied"]
        assert np.array_equal(history.state, occupied == 1)
        for at, name in enumerate(NAMES[:count]):
            if at != 1 and count > 2:
                assert history.observables[f"sites_{name}"][-1] == np.count_nonzero(occupied == at)
        solved = expm_multiply(model.generator() * time, model.start())
        both = model.counts(occupied), solved
        chances.append((chance(*both), chance(*(of_three(each, count, seed) for each in both))))
    for found in zip(*chances, strict=True):
        assert min(found) > 1e-5
        assert kstest(found, "uniform").pvalue > 1e-3


@pytest.mark.long
@pytest.mark.parametrize(("kelvin", "risen"), [(330.0, 0.0), (280.0, 0.0), (300.0, -0.05), (315.0, 0.04)])
def test_interacting_sites_of_three_states_follow_a_ramp(kelvin, risen):
    model, time, copies = Model(3, 5), 1.5, 3000
    lattice = model.lattice(copies)
    change = {"forming": lattice.forming + risen, "breaking": lattice.breaking - risen}
    ramp = Ramp(kelvin, lattice.model_copy(update=change))
    history = ca.engine("many-states").run(lattice, [0.5, time], temperature=KELVIN, seed=3, ramp=ramp)
    parts = [model.generator(KELVIN + (kelvin - KELVIN) * k / 40, risen * k / 40) for k in range(41)]

    def rates(moment: float, now: np.ndarray) -> np.ndarray:
        # smooth in between: rates that change by at most a factor of 7 on the way, at 41 points
        at = min(int(moment / time * 40), 39)
        share = moment / time * 40 - at
        return (1 - share) * (parts[at] @ now) + share * (parts[at + 1] @ now)

    solved = solve_ivp(rates, (0, time), model.start(), t_eval=[0.5, time], rtol=1e-7, atol=1e-10)
    assert chance(model.counts(history.resume["occupied"]), solved.y[:, -1]) > 1e-4
    state = np.arange(729)[:, None] // 3 ** np.arange(6) % 3
    for name, at in (("sites_free", 0), ("sites_dry", 2)):
        number = (state == at).sum(axis=1)
        mean = copies * (solved.y[:, 0] @ number)
        spread = math.sqrt(copies * (solved.y[:, 0] @ number**2 - (mean / copies) ** 2))
        assert abs(history.observables[name][0] - mean) < 4.5 * spread


def humid(x: float, k: float = 8.0, initial: str | None = None, forming: float = 3.0) -> ca.Chemistry:
    """Sites that are dry, free under one layer of water, or blocked under more; ``k``: of the first layer."""
    first, further = float(barrier(1.0)), float(barrier(1.0))
    transitions = {
        "wetting": {"reaction": "dry -> free", "barrier": first - KB * KELVIN * math.log(k), "humidity": "langmuir"},
        "drying": {"reaction": "free -> dry", "barrier": first},
        "covering": {"reaction": "free->blocked", "barrier": further, "humidity": "bet"},
        "baring": {"reaction": "blocked -> free", "barrier": further},
    }
    return ca.chemistry(
        forming=ca.barriers("uniform", lower=forming, upper=forming + 1e-6),
        transitions=transitions,
        humidity=x,
        initial=initial,
        site_density="pixel",
    )


def plate(side: int = 100) -> ca.ContactSolution:
    return ca.ContactSolution(pressure=np.ones((side, side)), load=1.0 * side**2, pixel_size=1.0, modulus=1.0)


@pytest.mark.long
def test_a_ramp_begins_in_the_equilibrium_of_its_beginning():
    """At the temperature at which the difference of both barriers is k_BT ln 3."""
    ways = {"up": {"reaction": "free -> dry", "barrier": 60.0}, "down": {"reaction": "dry -> free", "barrier": 50.0}}
    lattice = humid(0.0, forming=500.0).replace(humidity=None, transitions=ways).on(plate(), 1)
    warm = 10.0 / (KB * math.log(3.0))
    history = ca.engine("many-states").run(lattice, [0.0, 1e-16], temperature=warm, seed=1, ramp=Ramp(1.5 * warm))
    assert abs(history.observables["sites_dry"][0] - 2500) < 4.5 * math.sqrt(1e4 * 0.25 * 0.75)


@pytest.mark.long
@pytest.mark.parametrize("x", [0.0, 0.003, 0.1, 0.4, 0.9])
@pytest.mark.parametrize("initial", [None, "free", "blocked"])
def test_water_is_adsorbed_as_by_langmuir_and_by_bet(x, initial):
    """In equilibrium 1 : cx : cx²/(1 − x), whatever the beginning; of those under no more than one layer cx/(1 + cx)."""
    c = 8.0
    lattice = humid(x, c, initial).on(plate(), 1)
    history = ca.engine("many-states").run(lattice, [0.0, 80.0], temperature=KELVIN, seed=2)
    weights = np.array([c * x, 1.0, c * x * x / (1 - x)])
    for at in range(initial is not None, 2):
        seen = [int(history.observables[f"sites_{name}"][at]) for name in ("free", "dry", "blocked")]
        assert sum(seen) == 10_000
        for number, share in zip(seen, weights / weights.sum(), strict=True):
            assert binom.cdf(number, 10_000, share) > 1e-5, (seen, weights)
            assert binom.sf(number - 1, 10_000, share) > 1e-5, (seen, weights)
        free, dry = seen[:2]
        langmuir = c * x / (1 + c * x)
        assert binom.cdf(free, free + dry, langmuir) > 1e-5
        assert binom.sf(free - 1, free + dry, langmuir) > 1e-5


def test_equilibria_are_exact_over_sixty_decades_of_rates():
    """Against the null space of the generator in whole fractions."""
    from chemage_kinetics._common import UNITS_PER_EV
    from chemage_kinetics._transitions import Transitions, in_equilibrium

    rng, states, unbonded, several = np.random.default_rng(4), 5, [0, 2, 3, 4], 0
    for _ in range(60):
        pairs = [pair for pair in itertools.permutations(unbonded, 2) if rng.random() < 0.6]
        energies = KB * KELVIN * math.log(10) * rng.uniform(0, 60, len(pairs))
        fixed = np.rint(energies * UNITS_PER_EV).astype(np.int64)[None]
        terms = np.tile([0.0, 1e13], (len(pairs), 1))
        found = in_equilibrium(Transitions(np.array(pairs), fixed, terms), KELVIN, states)[:, 0]
        rates = np.exp(-fixed[0] / UNITS_PER_EV / (KB * KELVIN)).tolist()
        exact = exact_equilibrium(4, [(unbonded.index(a), unbonded.index(b)) for a, b in pairs], rates)
        assert found[1] == 0
        assert found.sum() == pytest.approx(1)
        if exact is None:
            several += 1
        else:
            np.testing.assert_allclose(found[unbonded], [float(p) for p in exact], rtol=1e-9, atol=1e-100)
    assert several < 20


def test_free_sites_that_can_come_to_two_ends_come_to_each_by_its_rate():
    from chemage_kinetics._common import UNITS_PER_EV
    from chemage_kinetics._transitions import Transitions, in_equilibrium

    barriers = np.array([[0.5, 0.5 + KB * KELVIN * math.log(3)]])
    fixed = np.rint(barriers * UNITS_PER_EV).astype(np.int64)
    ends = Transitions(np.array([[0, 2], [0, 3]]), fixed, np.tile([0.0, 1e13], (2, 1)))
    np.testing.assert_allclose(in_equilibrium(ends, KELVIN, 4)[:, 0], [0, 0, 0.75, 0.25], atol=1e-12)


def exact_equilibrium(count: int, pairs: list, rates: list[float]) -> list[Fraction] | None:
    """The one stationary state; None where there are several."""
    matrix = [[Fraction(0)] * count for _ in range(count)]
    for (before, after), rate in zip(pairs, rates, strict=True):
        matrix[after][before] += Fraction(rate)
        matrix[before][before] -= Fraction(rate)
    rank, pivots = 0, []
    for column in range(count):
        row = next((r for r in range(rank, count) if matrix[r][column]), None)
        if row is None:
            continue
        matrix[rank], matrix[row] = matrix[row], matrix[rank]
        matrix[rank] = [value / matrix[rank][column] for value in matrix[rank]]
        for other in range(count):
            if other != rank and (scale := matrix[other][column]):
                matrix[other] = [a - scale * b for a, b in zip(matrix[other], matrix[rank], strict=True)]
        pivots.append(column)
        rank += 1
    if rank != count - 1:
        return None
    free = next(column for column in range(count) if column not in pivots)
    vector = [Fraction(0)] * count
    vector[free] = Fraction(1)
    for row, column in enumerate(pivots):
        vector[column] = -matrix[row][free]
    return [value / sum(vector) for value in vector]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["many-states", "auto"])
def test_a_run_in_pieces_has_the_bytes_of_the_whole_one(kind):
    engine, lattice = ca.engine(kind), Model(4, 1).lattice(40)
    times = np.array([0.0, 1e-3, 0.1, 0.1, 0.5, 2.0, 5.0])
    whole = engine.run(lattice, times, temperature=KELVIN, seed=6)
    for cut in range(1, times.size):
        first = pickle.loads(pickle.dumps(engine.run(lattice, times[:cut], temperature=KELVIN, seed=6)))
        rest = engine.run(lattice, times[cut:], temperature=KELVIN, seed=6, start=first)
        both = first.then(rest)
        for name in ("bonds", "formed", "broken", "state"):
            assert np.array_equal(getattr(both, name), getattr(whole, name)), (cut, name)
        for name in ("observables", "resume"):
            for key, values in getattr(whole, name).items():
                assert np.array_equal(getattr(both, name)[key], values), (cut, key)


@pytest.mark.long
def test_a_step_keeps_the_states_and_takes_new_random_numbers():
    """Into other air a site goes with its state; after a run of two states a bond that broke left its site free."""
    engine = ca.engine("many-states")
    wet, dry = (humid(x, forming=0.7).on(plate(30), 1) for x in (0.5, 0.01))
    first = engine.run(wet, [3.0], temperature=KELVIN, seed=1)
    then = engine.run(dry, [3.0, 4.0], temperature=KELVIN, seed=1, start=first)
    for name in first.observables:
        assert then.observables[name][0] == first.observables[name][-1]
    assert then.resume["event"] > first.resume["event"] + 1
    # all bonds broken by an engine that follows two states
    plain = wet.model_copy(
        update=dict.fromkeys(("states", "initial", "transitions", "transition_barriers", "transition_terms"))
        | {"breaking": np.zeros(900), "forming": np.full(900, 5.0)}
    )
    broken = ca.engine("rejection-free").run(plain, [5.0], temperature=KELVIN, seed=1, start=first)
    assert broken.bonds[-1] == 0 < first.bonds[-1]
    again = engine.run(wet, [5.0], temperature=KELVIN, seed=1, start=broken)
    # sites that come into contact, as whoever puts histories together writes -1
    occupied = np.where(np.arange(900) < 450, -1, first.resume["occupied"])
    joined = first.model_copy(
        update={
            "resume": {**first.resume, "occupied": occupied},
            "state": occupied == 1,
            "bonds": [np.count_nonzero(occupied == 1)],
        }
    )
    joined = engine.run(wet, [3.0], temperature=KELVIN, seed=1, start=joined).resume["occupied"]
    shares = np.bincount(joined[:450], minlength=4) / 450
    assert shares == pytest.approx(np.array([4, 0, 1, 4]) / 9, abs=0.1)
    kept = occupied[450:]
    assert np.array_equal(joined[450:], kept)
    assert again.observables["sites_dry"][0] == first.observables["sites_dry"][-1]
    assert again.observables["sites_free"][0] == first.observables["sites_free"][-1] + first.bonds[-1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"transitions": {"a": {"reaction": "dry", "barrier": 1}}}, "two states"),
        ({"transitions": {"a": {"reaction": "dry -> dry", "barrier": 1}}}, "two states"),
        ({"transitions": {"a": {"reaction": "dry -> free"}}}, "barrier: is required"),
        ({"transitions": {"a": {"reaction": "dry -> free", "barrier": {"kind": "gausian"}}}}, "gaussian"),
        ({"transitions": {"a": {"reaction": "dry -> free", "barrier": "1 nm"}}}, "barrier"),
        (
            {"transitions": {"a": {"reaction": "dry -> free", "barrier": 1, "neighbours": 1}}, "humidity": None},
            "needs .interaction",
        ),
        ({"transitions": {"a": {"reaction": "dry -> free", "barrier": 1, "colour": 1}}}, "no such option"),
        ({"initial": "drie"}, "'drie' is no state without a bond"),
        ({"initial": "bonded"}, "'bonded' is no state without a bond"),
        ({"humidity": "140 %"}, "humidity"),
        ({"humidity": 1}, "humidity"),
        ({"transitions": None, "humidity": 0.4, "initial": "free"}, "no transition depends on it"),
    ],
)
def test_states_that_contradict_each_other_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        humid(0.4).replace(**change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"states": None}, "names of the states"),
        ({"states": ("free", "dry", "blocked")}, "name free and bonded first"),
        ({"states": ("free", "bonded", "free")}, "none twice"),
        ({"transitions": [[0, 4]] * 7}, "give states from 0 to 3"),
        ({"transition_barriers": np.zeros((5, 7))}, "shape"),
        ({"transition_terms": None}, "transition_terms: shape"),
        ({"transition_terms": [[0.0, -1.0]] * 7}, "not negative"),
        ({"initial": 7}, r"initial: 7 is no state without a bond; give None, or one of \[0, 2, 3\]"),
        ({"initial": 1}, "initial: 1 is no state without a bond"),
    ],
)
def test_lattices_whose_transitions_contradict_their_states_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        Model(4, 0).lattice(2).model_copy(update=change)


@pytest.mark.parametrize("initial", [1, 2, -1])
def test_a_lattice_of_two_states_begins_without_bonds(initial):
    with pytest.raises(InputError, match=rf"initial: {initial} is no state .*; give None, or one of \[0\]"):
        ca.ReactionLattice(pixels=(4, 4), sites=np.arange(16), forming=np.full(16, 0.5), initial=initial)


def test_states_are_refused_where_they_would_be_ignored():
    lattice = Model(3, 0).lattice(2)
    for kind in ("rejection-free", "bkl", "next-reaction"):
        with pytest.raises(InputError, match="these are free, bonded, dry"):
            ca.engine(kind).run(lattice, [1.0], temperature=300)
    drive = ca.plugin.Drive(speed=1.0, bond_stiffness=1.0, transition_distance=0.1)
    with pytest.raises(InputError, match="free or bonded"):
        ca.pulling("event-driven").run(lattice, drive, [1.0], temperature=300)
    with pytest.raises(InputError, match="more than two states"):
        ca.plugin.contact_statistics(plate(10), humid(0.2))


@pytest.mark.long
def test_a_state_that_nothing_enters_or_leaves_is_fine():
    for reaction, initial, left in (("dry -> free", "dry", 0), ("free -> blocked", "free", 100)):
        one = humid(0.0, initial=initial).replace(
            humidity=None, transitions={"only": {"reaction": reaction, "barrier": 0}}
        )
        history = ca.engine("many-states").run(one.on(plate(10)), [1.0], temperature=300)
        name = "dry" if initial == "dry" else "blocked"
        assert history.observables[f"sites_{name}"][-1] == left


def test_a_lattice_with_states_is_stored_and_read_back(tmp_path):
    lattice = Model(4, 2).lattice(3)
    path = tmp_path / "lattice.nc"
    ca.write(path, lattice)
    assert ca.read(path) == lattice


def test_barriers_of_a_transition_may_be_distributed():
    apart = ca.barriers("uniform", lower=0.7, upper=0.9)
    wide = {"a": {"reaction": "dry -> free", "barrier": {"kind": "uniform", "lower": 0.7, "upper": 0.9}}}
    wide["b"] = {"reaction": "free -> dry", "barrier": apart, "activation_volume": "6.4 angstrom**3"}
    chemistry = humid(0.2).replace(humidity=None, transitions=wide)
    assert ca.Chemistry.fromdict(chemistry.todict()) == chemistry
    barriers = chemistry.on(plate(50), 1).transition_barriers
    lowered = 6.4e-3 * ca.plugin.EV_PER_GPA_NM3
    assert kstest(barriers[:, 0], "uniform", (0.7, 0.2)).pvalue > 1e-3
    assert kstest(barriers[:, 1] + lowered, "uniform", (0.7, 0.2)).pvalue > 1e-3
    assert abs(np.corrcoef(barriers.T)[0, 1]) < 0.1
    assert np.array_equal(chemistry.on(plate(50), 1, sites=np.arange(9)).transition_barriers, barriers[:9])


def humid_tip(humidity: str, **more: dict | None) -> ca.Scene:
    data = ca.plugin.scene_data("silica-humid-tip")[0]
    data["chemistry"]["humidity"] = humidity
    data = {name: section for name, section in {**data, **more}.items() if section is not None}
    return ca.parse_scene(data)


@pytest.mark.long
@pytest.mark.parametrize("humidity", ["0.5 %", "10 %", "30 %", "90 %"])
def test_bonds_in_humid_air_are_those_of_the_sites_under_one_layer(humidity):
    """Water is exchanged within days: until 100 s the bonds are those of sites that are always free, times the share of
    such sites by BET; without interaction, where the former are a closed form."""
    x = float(humidity.rstrip("% ")) / 100
    scene = humid_tip(humidity, interaction=None)
    run = ca.run(scene)
    c = math.exp(0.06 / (KB * KELVIN))
    share = c * x * (1 - x) / (1 - x + c * x)
    alone = scene.chemistry.replace(transitions=None, humidity=None)
    mean = np.zeros(scene.hold.hold_times.size)
    for seed in range(50):
        lattice = alone.on(run.contact, 1000 + seed)
        mean += ca.engine("independent").mean(lattice, scene.hold.hold_times, temperature=KELVIN)[0] / 50
    bonds = run.ageing.bonds.mean(axis=0)
    error = np.sqrt(share * mean / len(run.ageing.bonds) + share**2 * mean / 50)
    assert np.all(np.abs(bonds - share * mean) < 4.5 * error + 0.01 * share * mean)


def test_every_number_of_the_scene_in_humid_air_has_a_source():
    scene = humid_tip("30 %")
    for each in scene.chemistry.transitions.values():
        assert each.source.startswith(("published", "fitted", "assumed"))
        assert each.source in scene.cite()


def test_humidity_is_part_of_the_key_and_a_source_is_not():
    scene = humid_tip("30 %")
    assert ca.parse_scene(scene.todict()).digest() == scene.digest()
    assert humid_tip("40 %").keys()["ageing"] != scene.keys()["ageing"]
    wetting = scene.chemistry.transitions["wetting"].replace(source="assumed: another reason")
    others = {**scene.chemistry.transitions, "wetting": wetting}
    other = scene.model_copy(update={"chemistry": scene.chemistry.replace(transitions=others)})
    assert other.keys() == scene.keys()
    with pytest.raises(InputError, match="these are free, bonded, dry, blocked"):
        ca.run(humid_tip("30 %", engine={"kind": "bkl"}))


@pytest.mark.long
def test_numbers_of_states_are_in_a_sweep_over_humidity(tmp_path):
    scene = {**ca.plugin.scene_data("silica-humid-tip")[0], "hold": {"times": ["1 s", "100 s"], "replicas": 3}}
    points = ca.sweep(scene, tmp_path / "humid", axes={"chemistry.humidity": ["1 %", 0.4]})
    table = points.to_xarray()
    dry = table["observable.sites_dry"].sel(hold_time=100.0).to_numpy()
    assert dry[0] > 3 * dry[1] > 0
