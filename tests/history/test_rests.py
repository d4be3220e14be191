"""Steps at rest: loads and temperatures in any order, against closed forms and matrix exponentials."""

from __future__ import annotations

from itertools import product
from typing import ClassVar

import numpy as np
import pytest
from rows_in_contact import Rows
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.stats import binomtest, chi2, chi2_contingency, kstest

import chemage as ca
from chemage import InputError
from chemage.plugin import KB, Engine, Output
from chemage_history import HistoryStep, Programme
from chemage_history.programme import follow, on_all_sites, state_of
from chemage_history.steps import segments

ENGINES = ["auto", "rejection-free", "bkl", "next-reaction"]
NU = 1e13


FLAT = ca.Surface(heights=np.zeros((20, 400)), pixel_size=0.2, periodic=True)


def aged(steps, chemistry, engine="auto", replicas=2, load=100.0, **options):
    programme = Programme(protocol={"kind": "steps", "step": steps})
    return ca.age(
        Rows().solve(FLAT, load), chemistry, engine=ca.engine(engine), hold_times=programme.times(), temperature=300,
        replicas=replicas, method=programme, surface=FLAT, solver=Rows(), **options,
    )  # fmt: skip


def rate(barrier: float, kelvin: float = 300.0) -> float:
    return NU * np.exp(-barrier / (KB * kelvin))


def relaxed(theta: float, forming: float, breaking: float, span: float) -> float:
    """One reversible site."""
    total = forming + breaking
    return forming / total + (theta - forming / total) * np.exp(-total * span)


def independent(**options) -> ca.Chemistry:
    same = {"kind": "gaussian", "std": 0.0}
    fields = {"forming": {**same, "mean": 0.8}, "breaking": {**same, "mean": 0.78}, "site_density": "pixel"}
    return ca.chemistry(**{**fields, **options})


@pytest.mark.parametrize("engine", [*ENGINES, "independent"])
def test_loads_and_temperatures_of_independent_sites(engine):
    """Pressure lowers the barrier; sites join unbonded and leave without their bonds."""
    chemistry = independent(activation_volume=0.0064)
    steps = [
        {"duration": 2.0},
        {"load": 150.0, "duration": 0.5},
        {"load": 50.0, "duration": 1.0},
        {"temperature": 320.0, "duration": 0.1},
        {"temperature": 300.0, "load": 100.0, "duration": 3.0},
    ]
    found = aged(steps, chemistry, engine, replicas=1)
    theta, load, kelvin = np.zeros(20), 100.0, 300.0
    for number, step in enumerate(steps):
        load, kelvin = step.get("load", load), step.get("temperature", kelvin)
        rows = round(load / 10)
        pressure = load / (rows * 400 * 0.2**2)
        theta[rows:] = 0.0
        forming = rate(0.8 - 0.0064 * 6.241509 * pressure, kelvin)
        theta[:rows] = relaxed(theta[:rows], forming, rate(0.78, kelvin), step["duration"])
        bonds = int(found.observables[f"bonds_{number}"][0])
        mean = theta[:rows].mean()
        assert binomtest(bonds, rows * 400, mean).pvalue > 1e-4, (number, bonds, mean * rows * 400)
    lost = found.observables["step_lost"][0]
    assert lost[[0, 1, 3, 4]].tolist() == [0, 0, 0, 0]
    assert lost[2] > 0


def test_a_ramp_of_temperature_goes_on_from_the_step_before_and_hands_on_its_end():
    steps = [{"duration": 0.5}, {"temperature": {"to": "330 K"}, "duration": 2.0, "points": 8}, {"duration": 0.5}]
    found = aged(steps, independent(), "independent", replicas=1)
    kelvin = found.observables["temperature"][0]
    assert kelvin[:21].tolist() == [300.0] * 21
    assert kelvin[[21, 29]].tolist() == [300.0, 330.0]
    assert np.all(kelvin[30:] == 330.0)

    def change(time: float, theta: np.ndarray) -> np.ndarray:
        at = 300.0 + 30.0 * min(max(time - 0.5, 0.0), 2.0) / 2.0
        return rate(0.8, at) * (1 - theta) - rate(0.78, at) * theta

    solved = solve_ivp(
        change, (0, 3.0), [0.0], t_eval=[0.5, 2.5, 3.0], rtol=1e-9, atol=1e-12, max_step=0.05, method="LSODA"
    )
    sites = 10 * 400
    for number, mean in enumerate(solved.y[0]):
        assert binomtest(int(found.observables[f"bonds_{number}"][0]), sites, mean).pvalue > 1e-4


@pytest.mark.parametrize("contacts", [4, pytest.param(16, marks=pytest.mark.long)])
def test_on_a_ramp_of_load_sites_have_the_age_of_their_contact(contacts):
    """Rows join as the load rises: N = ρ A(0) θ(t) + ρ ∫ A'(t') θ(t − t') dt', and go as it falls."""
    up = {"load": {"to": 180.0, "contacts": contacts}, "duration": 2.0, "points": 10}
    down = {"load": {"to": "60 nN", "contacts": contacts}, "duration": 2.0}
    found = aged([{"duration": 0.5}, up, down], independent(), "independent", replicas=20)
    times, seen = found.hold_times, found.observables
    np.testing.assert_array_equal(
        times, Programme(protocol={"kind": "steps", "step": [{"duration": 0.5}, up, down]}).times()
    )
    assert seen["step_load"][0].tolist() == [100.0, 180.0, 60.0]
    rates = rate(0.8), rate(0.78)
    joined = np.linspace(0.5, 2.5, 2001)
    new = 400 * 8 * np.trapezoid(relaxed(0.0, *rates, 2.5 - joined), joined) / 2.0
    old = 400 * 10 * relaxed(0.0, *rates, 2.5)
    bonds, mean = seen["bonds_1"], old + new
    # a quarter of a step of the load is what rows are late or early, and rows are whole
    coarse = 400 * 8 * (0.25 / contacts**2 + 0.5 / contacts / 8)
    assert abs(bonds.mean() - mean) < 4.5 * np.sqrt(mean / 20) + coarse
    left = seen["step_lost"][:, 2].mean()
    assert 0.5 * mean * 12 / 18 < left < mean
    assert seen["bonds_2"].max() <= 400 * 6


def test_a_ramp_of_load_is_refused_without_its_surface():
    programme = Programme(protocol={"kind": "steps", "step": [{"load": {"to": 50.0}, "duration": 1.0}]})
    with pytest.raises(InputError, match="give the surface and the solver"):
        ca.age(
            Rows().solve(FLAT, 10.0), independent(), engine=ca.engine("auto"), hold_times=programme.times(),
            temperature=300, method=programme,
        )  # fmt: skip


class Recording(Engine):
    """Records two numbers at each hold time."""

    kind = "recording"
    outputs: ClassVar = {"bonds_and_sites": Output(("hold_time", "number"), "", "bonds, and sites")}

    def _run(self, lattice, hold_times, temperature, seed, start):
        history = ca.engine("independent")._run(lattice, hold_times, temperature, seed, start)
        sites = np.full(history.bonds.size, lattice.sites.size)
        self.record(bonds_and_sites=np.stack([history.bonds, sites], axis=1))
        return history


def test_arrays_that_an_engine_records_are_those_of_all_steps():
    steps = [{"duration": 1.0, "points": 3}, {"load": {"to": 150.0, "contacts": 2}, "duration": 1.0, "points": 5}]
    programme = Programme(protocol={"kind": "steps", "step": steps})
    found = ca.age(
        Rows().solve(FLAT, 100.0), independent(), engine=Recording(), hold_times=programme.times(), temperature=300,
        replicas=1, method=programme, surface=FLAT, solver=Rows(),
    )  # fmt: skip
    seen = found.observables["bonds_and_sites"][0]
    np.testing.assert_array_equal(seen[:, 0], found.bonds[0])
    assert np.all(seen[:, 1] == found.sites[0])


WATER = {
    "wetting": {"reaction": "free -> wet", "barrier": 0.68, "humidity": "langmuir"},
    "drying": {"reaction": "wet -> free", "barrier": 0.68},
}


def test_sites_of_three_states_go_through_loads_and_humidities():
    """Sites that stay keep their state, those that join have that of their humidity; without bonds the share of wet
    sites goes to x/(1 + x)."""
    chemistry = independent(
        forming={"kind": "gaussian", "mean": 0.8, "std": 0.0}, breaking=None, transitions=WATER, humidity=0.5
    )
    steps = [
        {"duration": 0.5},
        {"load": 150.0, "duration": 0.5},
        {"load": 50.0, "humidity": 0.0, "duration": 1.0},
        {"load": 100.0, "duration": 2.0},
    ]
    found = aged(steps, chemistry, "many-states", replicas=4)
    forming, bare = rate(0.8), 1 / 1.5
    theta = np.zeros(20)
    expected = []
    # exchange of water is fast: a share of sites is free to bind
    for rows, free, span in [(10, bare, 0.5), (15, bare, 0.5), (5, 1.0, 1.0), (10, 1.0, 2.0)]:
        theta[rows:] = 0.0
        theta[:rows] = 1 - (1 - theta[:rows]) * np.exp(-forming * free * span)
        expected.append(400 * theta[:rows].sum())
    for number, mean in enumerate(expected):
        bonds = found.observables[f"bonds_{number}"]
        # water takes 0.03 s to go
        assert abs(bonds.mean() - mean) < 4.5 * np.sqrt(mean / 4) + 0.02 * mean, (number, bonds, mean)
    seen = found.observables
    rows = np.repeat([10, 15, 5, 10], seen["step_points"][0])
    np.testing.assert_array_equal(seen["sites_free"] + seen["sites_wet"] + found.bonds, 400 * rows + np.zeros((4, 1)))
    assert found.outputs["sites_wet"]["dims"] == ["hold_time"]
    # of the sites without a bond a third is wet, and none where there is no water
    last = np.cumsum(seen["step_points"][0]) - 1
    unbound, wet = (400 * rows - found.bonds)[:, last].sum(axis=0), seen["sites_wet"][:, last].sum(axis=0)
    assert binomtest(int(wet[0]), int(unbound[0]), 1 / 3).pvalue > 1e-4
    assert binomtest(int(wet[1]), int(unbound[1]), 1 / 3).pvalue > 1e-4
    assert not wet[2:].any()


def lattice_of_patches(count: int, forming: np.ndarray, seed: int = 1) -> ca.ReactionLattice:
    """Patches of 2 × 3 interacting sites; ``forming`` (6,) eV, nan where a site is not in contact."""
    rng = np.random.default_rng(seed)
    breaking = 0.8 + 0.02 * rng.standard_normal(6)
    neighbours, coupling = np.full((6, 8), -1, np.int32), np.zeros((6, 8), np.float32)
    energies = {}
    for i, j in product(range(6), range(6)):
        if i < j and max(abs(i // 3 - j // 3), abs(i % 3 - j % 3)) == 1:
            energies[i, j] = energies[j, i] = 0.1 * (rng.random() - 0.3)
    there = np.flatnonzero(~np.isnan(forming))
    place = {site: number for number, site in enumerate(there)}
    for i in there:
        partners = [j for j in there if (i, j) in energies]
        for slot, j in enumerate(partners):
            neighbours[i, slot], coupling[i, slot] = place[j], energies[i, j]
    graph = neighbours[there]
    start = there.size * np.arange(count)[:, None, None]
    sites = (6 * np.arange(count)[:, None] + there).ravel()
    return ca.ReactionLattice(
        pixels=(count, 6), sites=sites, forming=np.tile(forming[there], count), breaking=np.tile(breaking[there], count),
        neighbours=np.where(graph >= 0, graph + start, -1).reshape(-1, 8).astype(np.int32),
        coupling=np.tile(coupling[there], (count, 1)),
    )  # fmt: skip


def generator(lattice: ca.ReactionLattice, kelvin: float) -> np.ndarray:
    """(64, 64) rates of the first patch, site 0 the lowest bit."""
    matrix = np.zeros((64, 64))
    n = int(np.searchsorted(lattice.sites, 6))
    for state in range(64):
        for k in range(n):
            site = int(lattice.sites[k])
            if state >> site & 1:
                flow = rate(lattice.breaking[k], kelvin)
            else:
                around = [(j, e) for j, e in zip(lattice.neighbours[k], lattice.coupling[k], strict=True) if j >= 0]
                energy = sum(e for j, e in around if state >> int(lattice.sites[j]) & 1)
                flow = rate(max(lattice.forming[k] + energy, 0.0), kelvin)
            matrix[state ^ (1 << site), state] += flow
            matrix[state, state] -= flow
    return matrix


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 8))])
def test_interacting_patches_against_matrix_exponentials(engine, seed):
    """Steps of temperature and load; one site leaves and comes back, another one joins."""
    count = 4000
    base = 0.78 + 0.02 * np.random.default_rng(seed).standard_normal(6)
    first, second = base.copy(), base - 0.01
    first[5] = np.nan
    second[2] = np.nan
    plain = [lattice_of_patches(count, forming, seed) for forming in (first, second)]
    one, two = on_all_sites(plain)
    programme = [(one, 300.0, 0.5), (two, 300.0, 0.3), (two, 315.0, 0.1), (one, 290.0, 1.0), (one, 300.0, 0.2)]
    steps = [HistoryStep(duration=span, temperature=kelvin, points=1) for _, kelvin, span in programme]
    state, before, expected = None, None, np.eye(64)[0]
    for (lattice, kelvin, span), segment in zip(programme, segments(steps), strict=True):
        if before is not None and lattice is not before:
            state = state_of(state, before, lattice)
            gone = 2 if lattice is two else 5
            folded = np.zeros(64)
            for code in range(64):
                folded[code & ~(1 << gone)] += expected[code]
            expected = folded
        state = follow(segment, lattice, state, ca.engine(engine), None, temperature=kelvin, seed=seed)
        before = lattice
        matrix = generator(plain[lattice is two], kelvin)
        expected = expm(matrix * span) @ expected
        codes = state.state.reshape(count, 6) @ (1 << np.arange(6))
        often = expected * count >= 8
        seen = np.bincount(codes, minlength=64)
        seen, mean = (
            np.append(seen[often], seen[~often].sum()),
            np.append(expected[often], expected[~often].sum()) * count,
        )
        use = mean > 0
        value = chi2.sf(((seen - mean)[use] ** 2 / mean[use]).sum(), use.sum() - 1)
        assert value > 1e-4, (segment, value)


def test_one_step_is_a_hold_bit_for_bit():
    chemistry = independent(interaction={"kind": "elastic-pairs", "strength": 0.1, "bias": 0.1})
    for engine in ENGINES:
        one = aged([{"duration": 10.0}], chemistry, engine)
        two = aged([{"duration": 1.0}, {"duration": 9.0}], chemistry, engine)
        times = Programme(protocol={"kind": "steps", "step": [{"duration": 10.0}]}).times()
        held = ca.age(
            Rows().solve(FLAT, 100.0),
            chemistry,
            engine=ca.engine(engine),
            hold_times=times,
            temperature=300,
            replicas=2,
        )
        np.testing.assert_array_equal(one.bonds, held.bonds)
        np.testing.assert_array_equal(one.friction_drop, held.friction_drop)
        np.testing.assert_array_equal(two.bonds[:, -1], held.bonds[:, -1])


def test_a_load_and_back_changes_nothing_where_nothing_reacts():
    chemistry = independent(activation_volume=0.0064)
    steps = [{"duration": 3.0}, {"load": 180.0, "duration": 1e-13}, {"load": 100.0, "duration": 1e-13}]
    found = aged(steps, chemistry)
    np.testing.assert_array_equal(found.observables["bonds_0"], found.observables["bonds_2"])
    assert not found.observables["step_lost"].any()
    less = aged([*steps[:1], {"load": 40.0, "duration": 1e-13}, steps[2]], chemistry)
    kept = less.observables["bonds_0"] - less.observables["step_lost"][:, 1]
    np.testing.assert_array_equal(less.observables["bonds_2"], kept)
    assert kept.mean() == pytest.approx(0.4 * less.observables["bonds_0"].mean(), rel=0.1)


@pytest.mark.parametrize("common", ["none", "all"])
@pytest.mark.parametrize("engine", [*ENGINES, "independent"])
def test_sites_that_come_back_take_fresh_noise(engine, common):
    """The first hold and the one after the sites came back have the same lattice, and no noise in common."""
    half = KB * 300 * np.log(NU / np.log(2))
    same = {"kind": "gaussian", "std": 0.0}
    chemistry = independent(forming={**same, "mean": half}, breaking=None)
    programme = [(100.0, 1.0), (10.0, 1e-12), (100.0, 1.0)]
    contacts = [Rows().solve(FLAT, load) for load, _ in programme]
    lattices = on_all_sites([chemistry.on(contact, 3) for contact in contacts])
    steps = segments([HistoryStep(duration=span, points=1) for _, span in programme])
    seed = 5 if common == "none" else ca.plugin.random.CommonSeed(5)
    state, before, ends = None, None, []
    for segment, lattice in zip(steps, lattices, strict=True):
        if before is not None:
            state = state_of(state, before, lattice)
        state = follow(segment, lattice, state, ca.engine(engine), None, temperature=300, seed=seed)
        before = lattice
        ends.append(state.state)
    back = np.arange(400 * 10) >= 400
    assert binomtest(int(ends[2][back].sum()), int(back.sum()), 0.5).pvalue > 1e-4
    table = np.histogram2d(ends[0][back], ends[2][back], bins=2)[0]
    assert chi2_contingency(table).pvalue > 1e-4


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="step 1: give either duration or distance"):
        list(segments([HistoryStep(duration=1.0), HistoryStep(load=3.0)]))
    with pytest.raises(InputError, match=r"a speed needs \[drive\]"):
        Programme(protocol={"kind": "steps", "step": [{"duration": 1, "speed": 3}]}).times()
    programme = Programme(protocol={"kind": "load-steps", "loads": [50, 100], "durations": [1, 1]})
    with pytest.raises(InputError, match="give the surface and the solver"):
        ca.age(
            Rows().solve(FLAT, 10.0), independent(), engine=ca.engine("auto"), hold_times=programme.times(),
            temperature=300, method=programme,
        )  # fmt: skip


def test_p_values_of_many_patches_are_uniform():
    """Of one observable of one step, over seeds."""
    values = []
    for seed in range(40):
        count = 500
        lattice = lattice_of_patches(count, np.full(6, 0.78), 1)
        steps = segments([HistoryStep(duration=0.4, points=1), HistoryStep(duration=0.2, points=1)])
        state, expected = None, np.eye(64)[0]
        for segment, kelvin in zip(steps, (300.0, 320.0), strict=True):
            state = follow(segment, lattice, state, ca.engine("rejection-free"), None, temperature=kelvin, seed=seed)
            span = segment.times[-1] - segment.times[0]
            expected = expm(generator(lattice, kelvin) * span) @ expected
        bonds = state.state.reshape(count, 6).sum(axis=1)
        sizes = np.array([bin(code).count("1") for code in range(64)])
        mean = np.bincount(sizes, weights=expected) * count
        seen = np.bincount(bonds, minlength=7)
        use = mean > 3
        values.append(chi2.sf(((seen - mean)[use] ** 2 / mean[use]).sum(), use.sum() - 1))
    assert kstest(values, "uniform").pvalue > 1e-4


class SofterRows(Rows):
    """Rows whose number grows as the hardness falls."""

    kind = "softer-rows"
    hardness: float = 1.0


@pytest.mark.long
def test_on_area_that_grows_bonds_have_the_age_of_their_area():
    """N(t) = ρ A(0) θ(t) + ρ ∫ A'(t') θ(t − t') dt' without interaction (creep of Dieterich and Kilgore)."""
    tau, m, duration, contacts = 0.2, 0.08, 40.0, 40
    protocol = {"kind": "creep", "duration": duration, "rate": m, "onset": tau, "contacts": contacts}
    programme = Programme(protocol=protocol)
    flat = ca.Surface(heights=np.zeros((400, 200)), pixel_size=0.2, periodic=True)
    solver = SofterRows()
    found = ca.age(
        solver.solve(flat, 2000.0), independent(), engine=ca.engine("independent"), hold_times=programme.times(),
        temperature=300, replicas=2, method=programme, surface=flat, solver=solver,
    )  # fmt: skip
    forming, breaking = rate(0.8), rate(0.78)

    def theta(age: np.ndarray) -> np.ndarray:
        return relaxed(np.zeros_like(age), forming, breaking, age)

    times = np.linspace(0.0, duration, 200_001)
    grows = 200.0 * m / (tau + times)
    old = 200.0 * theta(np.array([duration]))[0] * 200
    new = np.trapezoid(grows * theta(duration - times), times) * 200
    # steps of the area are a part of the growth: 1.5 % of what is new, and a row
    assert abs(found.observables["bonds_old"].mean() - old) < 4.5 * np.sqrt(old / 2)
    assert abs(found.observables["bonds_new"].mean() - new) < 4.5 * np.sqrt(new / 2) + 0.015 * new + 200
    assert found.bonds[0, -1] == found.observables["bonds_old"][0] + found.observables["bonds_new"][0]


def test_a_contact_without_hardness_does_not_creep():
    with pytest.raises(InputError, match="has no hardness"):
        aged([{"duration": 1.0}, {"hardness_ratio": 0.9, "duration": 1.0}], independent())


def test_a_rough_contact_that_creeps_grows_as_its_hardness_falls():
    """Near full yield the area is F/H."""
    scene = {
        "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.5, "rms_slope": 0.8, "hurst": 0.8, "zeta": 16},
        "contact": {"kind": "fft-bem", "load": "2 GPa", "hardness": "8 GPa", "modulus": 35.3},
        "forming": {"kind": "gaussian", "mean": 0.8, "std": 0.0},
        "chemistry": {"site_density": "pixel"},
        "engine": {"kind": "auto"},
        "hold": {"temperature": 300, "replicas": 1},
        "protocol": {"kind": "creep", "duration": "100 s", "rate": 0.02, "contacts": 4},
    }
    run = ca.run(scene)
    area = run.ageing.observables["step_area"][0]
    shares = (np.arange(4) + 0.5) / 4
    ratio = 1 + 0.02 * np.log1p(100.0) * shares
    assert np.allclose(area[1:] / area[0], ratio[1:], rtol=0.02)
