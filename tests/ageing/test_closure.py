"""Ageing ``closure``: exact without interaction, close to the kinetics with it, kept on disk."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import build_lattice
from chemage_ageing import _table
from chemage_ageing._table import bonded_share

KT = ca.plugin.KB * 300.0
EV_PER_GPA_NM3 = ca.plugin.EV_PER_GPA_NM3
TIMES = np.array([0.0, 1.0, 10.0, 100.0, 1000.0])


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return tmp_path_factory.mktemp("tables")


@pytest.fixture(autouse=True)
def small_tables(monkeypatch, tables):
    """Tables of a few hundred sites, each computed once for all tests."""
    monkeypatch.setenv("CHEMAGE_CACHE", str(tables))
    for name, value in (("SIDE", 32), ("BAND", 4), ("FIRST", 2), ("MOST", 2)):
        monkeypatch.setattr(_table, name, value)
    monkeypatch.setattr("chemage_ageing.closure._tables", {})


@pytest.fixture
def own_tables(monkeypatch, tmp_path):
    """The folder with the tables of this test alone."""
    monkeypatch.setenv("CHEMAGE_CACHE", str(tmp_path))
    return tmp_path


def chemistry(**options) -> ca.Chemistry:
    own = {"forming": ca.barriers("uniform", lower=0.75, upper=1.1), "activation_volume": 0.0064}
    return ca.chemistry(**{**own, "site_density": "pixel", **options})


def interacting(**options) -> ca.Chemistry:
    return chemistry(interaction=ca.interaction("elastic-pairs", strength=0.1), **options)


def uniform(pressure: float, shape=(40, 30), where=None) -> ca.ContactSolution:
    values = np.full(shape, pressure) if where is None else np.where(where, pressure, 0.0)
    load = float(values.sum()) * 0.2
    return ca.ContactSolution(pressure=values, load=load, pixel_size=math.sqrt(0.2), modulus=35.3)


def aged(contact, own, **options) -> ca.Ageing:
    fields = {"engine": ca.engine("rejection-free"), "temperature": 300.0, "hold_times": TIMES}
    return ca.age(contact, own, **{"method": ca.ageing_method("closure"), **fields, **options})


# -- sites that do not interact ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("breaking", [None, 0.95])
def test_one_barrier_under_one_pressure_is_one_exponential(breaking):
    """ρ = a/(a + b) [1 − exp(−(a + b) t)], times the sites that are reactive."""
    own = chemistry(
        forming=ca.barriers("gaussian", mean=1.0, std=0.0),
        breaking=ca.barriers("gaussian", mean=breaking, std=0.0) if breaking else None,
        hydroxylation=0.8,
    )
    forming = 1e13 * math.exp(-(1.0 - 2.0 * own.activation_volume * EV_PER_GPA_NM3) / KT)
    both = forming + (1e13 * math.exp(-breaking / KT) if breaking else 0.0)
    found = aged(uniform(2.0), own)
    exact = 0.8 * 1200 * forming / both * -np.expm1(-both * TIMES)
    np.testing.assert_allclose(found.bonds[0], exact, rtol=3e-4)
    assert found.sites[0] == pytest.approx(960, rel=1e-12)
    assert found.engine == "quadrature"


def _legendre(mean: float, std: float, kt: float) -> tuple[np.ndarray, np.ndarray]:
    """Energies and weights of a normal distribution: Gauss-Legendre panels no wider than k_BT, over nine deviations."""
    panels = math.ceil(18 * std / min(std, kt))
    edges = np.linspace(mean - 9 * std, mean + 9 * std, panels + 1)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half, middle = 0.5 * np.diff(edges)[:, None], 0.5 * (edges[1:] + edges[:-1])[:, None]
    energies = (middle + half * nodes).ravel()
    density = np.exp(-0.5 * ((energies - mean) / std) ** 2) / (std * math.sqrt(2 * math.pi))
    return energies, (half * weights).ravel() * density


def _exact_share(forming, breaking, shift: float, kt: float, times: np.ndarray) -> np.ndarray:
    """⟨a/(a + b) (1 − exp(−(a + b) t))⟩ over two normal distributions (mean, std) in eV, in the space of energies."""
    (e, v), (f, w) = _legendre(*forming, kt), _legendre(*breaking, kt)
    a = 1e13 * np.exp(-np.maximum(e - shift, 0.0) / kt)[:, None]
    both = a + 1e13 * np.exp(-np.maximum(f, 0.0) / kt)
    return np.array([v @ (a / both * -np.expm1(-both * time)) @ w for time in times])


#: forming and breaking barriers (mean, std) in eV, temperature in K, hold times in s, pressures in GPa
BROAD = ((1.3, 0.02), (0.9, 0.1), 300.0, np.array([1.0, 1e4, 1e8, 1e12]), (0.0, 2.0))


def _random_barriers(seed: int):
    rng = np.random.default_rng(seed)
    forming = rng.uniform(0.7, 1.4), 10 ** rng.uniform(-2.3, -0.9)
    breaking = rng.uniform(0.7, 1.4), 10 ** rng.uniform(-2.3, -0.9)
    return forming, breaking, rng.uniform(50, 600), 10.0 ** rng.uniform(-3, 12, 4), rng.uniform(0, 20, 2)


@pytest.mark.parametrize(
    "case",
    [BROAD, *map(_random_barriers, range(8))]
    + [pytest.param(_random_barriers(seed), marks=pytest.mark.long) for seed in range(8, 100)],
)
def test_the_quadrature_is_exact_within_its_stated_error(case):
    """A broad distribution of breaking barriers leaves the bonds to those of its upper end."""
    forming, breaking, temperature, times, pressures = case
    own = chemistry(
        forming=ca.barriers("gaussian", mean=forming[0], std=forming[1]),
        breaking=ca.barriers("gaussian", mean=breaking[0], std=breaking[1]),
    )
    times, kt = np.sort(times), ca.plugin.KB * temperature
    found = bonded_share(own, temperature, times, np.array(pressures))
    shifts = np.array(pressures) * own.activation_volume * EV_PER_GPA_NM3
    exact = np.stack([_exact_share(forming, breaking, shift, kt, times) for shift in shifts])
    # no rank is below 2⁻⁴⁹, so that one site in 10¹⁴ may be missed
    np.testing.assert_allclose(found, exact, rtol=2e-4, atol=1e-14)


@pytest.mark.parametrize("pressure", [0.0, 5.0, 20.0, 100.0])
def test_pressure_makes_barriers_crossed_that_are_far_too_high_without_it(pressure):
    """2.3 eV at 300 K: some 10⁻²² of the sites without pressure, one in 10⁸ under 20 GPa."""
    own = chemistry(forming=ca.barriers("uniform", lower=2.30, upper=2.35))
    lowered = 2.30 + 0.05 * (np.arange(4000) + 0.5) / 4000 - pressure * own.activation_volume * EV_PER_GPA_NM3
    rates = 1e13 * np.exp(-np.maximum(lowered, 0.0) / KT)
    exact = ca.plugin.TwoState(rates).relaxed(1e4).mean()
    assert bonded_share(own, 300.0, np.array([1e4]), np.array([pressure]))[0, 0] == pytest.approx(exact, rel=2e-4)


def test_no_table_is_made_without_interaction(own_tables):
    aged(uniform(2.0), chemistry())
    aged(uniform(2.0), chemistry(interaction=ca.interaction("elastic-pairs", strength=0.1)), hold_times=[1.0])
    assert len(list(own_tables.glob("*.npz"))) == 1


def test_a_contact_without_pressure_has_no_bonds():
    found = aged(uniform(0.0), interacting())
    assert not found.bonds.any()
    assert not found.sites.any()


# -- sites that interact ----------------------------------------------------------------------------------------------


def _agrees(contact, own, allowed: float) -> None:
    """Within what the small table and 60 replicas of the kinetics can tell, and ``allowed`` on top."""
    found = aged(contact, own)
    full = aged(contact, own, method=None, replicas=60, seed=3)
    mean, noise = full.bonds.mean(axis=0), full.bonds.std(axis=0, ddof=1) / math.sqrt(60)
    spread = 5 * np.hypot(noise, found.errors["closure"] * found.bonds[0])
    assert (np.abs(found.bonds[0] - mean) <= spread + allowed * mean).all(), (found.bonds[0], mean)
    assert found.sites[0] == pytest.approx(full.sites.mean(), rel=0.05)


def test_a_uniform_contact_has_the_bonds_of_its_kinetics():
    _agrees(uniform(1.7), interacting(), 0.01)


@pytest.mark.long
def test_statistics_of_a_uniform_contact_have_the_bonds_of_its_map():
    contact, own = uniform(2.0), interacting(site_density=5.0)
    known = ca.plugin.contact_statistics(contact, own)
    fields = {"pressure": known.pressure, "area": known.area, "load": contact.load, "modulus": 35.3}
    statistics = ca.plugin.ContactStatistics(nominal_area=contact.nominal_area, rms_slope=0.1, **fields)
    np.testing.assert_allclose(aged(statistics, own).bonds, aged(contact, own).bonds, rtol=1e-9)


@pytest.mark.long
def test_a_contact_half_of_whose_sites_are_reactive():
    _agrees(uniform(1.7), interacting(hydroxylation=0.5), 0.01)


@pytest.mark.long
def test_bonds_that_break():
    _agrees(uniform(1.7), interacting(breaking=ca.barriers("gaussian", mean=0.85, std=0.02)), 0.01)


def _equilibrium(lattice, temperature: float, sweeps: int) -> float:
    """Bonds of a lattice in equilibrium by the heat bath, which knows no time, from every site bonded."""
    rng = np.random.default_rng(5)
    kt = ca.plugin.KB * temperature
    bonded = np.ones(lattice.sites.size, dtype=bool)
    row, column = np.divmod(lattice.sites, 40)
    colours = [np.flatnonzero((row % 2 == r) & (column % 2 == c)) for r in (0, 1) for c in (0, 1)]
    counts = []
    for _ in range(sweeps):
        for colour in colours:
            near = bonded[lattice.neighbours[colour]]
            gain = lattice.breaking[colour] - lattice.forming[colour]
            gain = gain - (near * lattice.coupling[colour]).sum(axis=1)
            bonded[colour] = rng.random(colour.size) < 1 / (1 + np.exp(-gain / kt))
        counts.append(np.count_nonzero(bonded))
    return float(np.mean(counts[sweeps // 4 :]))


@pytest.mark.long
@pytest.mark.parametrize("strength", [0.1, 0.5])
def test_bonds_that_break_often_settle_in_equilibrium_and_are_followed_no_longer(monkeypatch, strength):
    """Bonds last 1 ms, and would break 10¹⁰ times until the last hold time; no run of a table is longer than 1 s."""
    own = chemistry(
        breaking=ca.barriers("gaussian", mean=0.6, std=0.02),
        interaction=ca.interaction("elastic-pairs", strength=strength),
        forming=ca.barriers("uniform", lower=0.45, upper=0.75),
    )
    run, longest = _table.run_kinetics, []
    monkeypatch.setattr(_table, "run_kinetics", lambda *a, **k: longest.append(max(a[2])) or run(*a, **k))
    contact = uniform(1.7, (40, 40))
    found = aged(contact, own, hold_times=[1e-3, 1.0, 1e3, 1e7])
    assert max(longest) <= 1.0
    counts = [_equilibrium(build_lattice(own, contact, seed), 300.0, 400) for seed in range(8)]
    noise = np.std(counts, ddof=1) / math.sqrt(len(counts))
    away = np.abs(found.bonds[0, 1:] - np.mean(counts))
    assert (away <= 3 * np.hypot(noise, found.errors["closure"] * found.bonds[0])[1:]).all()
    assert (np.diff(found.errors["closure"][1:]) > 0).all()
    assert found.errors["closure"][-1] < 0.15


def test_a_table_ends_where_the_slowest_bonds_have_broken_thirty_times():
    """At 100 °C a bond of 1.147 eV, above 99 % of them, lasts 300 s; one of 1.1 eV for ever where none breaks."""
    own, times = interacting(breaking=ca.barriers("gaussian", mean=1.1, std=0.02)), np.array([0.0, 1e-3, 1e9])
    assert _table.decades_of(times, own, 373.15) == (-3, 4)
    assert _table.decades_of(times[1:] * 1e8, own, 373.15) == (3, 4)
    assert _table.decades_of(times, interacting(), 373.15) == (-3, 9)
    assert _table.decades_of(times[:2], own, 373.15) == (-3, -2)


@pytest.mark.long
def test_isolated_sites_are_exactly_independent():
    """x = 1: every neighbour is missing, and the interaction changes nothing."""
    where = np.zeros((40, 32), dtype=bool)
    where[::4, ::4] = True
    found = aged(uniform(1.7, (40, 32), where), interacting())
    alone = aged(uniform(1.7, (40, 32), where), chemistry())
    np.testing.assert_allclose(found.bonds, alone.bonds, rtol=1e-9, atol=1e-9)


def test_stripes_have_more_bonds_per_site_than_their_inside():
    where = np.broadcast_to(np.arange(32) % 8 < 3, (40, 32))
    stripes = uniform(1.7, (40, 32), where)
    _agrees(stripes, interacting(), 0.02)
    inside = aged(uniform(1.7), interacting())
    assert aged(stripes, interacting()).bonds[0, -1] / where.sum() > 1.02 * inside.bonds[0, -1] / 1200


def _patches(pixels: int, box: tuple[int, int], low: float, high: float) -> ca.ContactSolution:
    """Patches of given sides apart from each other, sites under alternating pressures."""
    rows, columns = (np.arange(pixels) % (side + 1) < side for side in box)
    where = rows[:, None] & columns
    pressure = np.where(np.add.outer(np.arange(pixels), np.arange(pixels)) % 2, low, high)
    values = np.where(where, pressure, 0.0)
    return ca.ContactSolution(pressure=values, load=float(values.sum()) * 0.2, pixel_size=0.2**0.5, modulus=35.3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("box", "low", "high"), [((1, 2), 1.7, 1.7), ((2, 2), 0.5, 4.0), ((1, 4), 0.1, 3.0), ((3, 3), 0.2, 3.0)]
)
def test_the_stated_error_holds_on_patches_of_a_few_sites_under_unequal_pressures(box, low, high):
    """Pairs, chains and squares, as in contacts of rough surfaces, where nearly every site is at the rim."""
    contact = _patches(72, box, low=low, high=high)
    own = chemistry(interaction=ca.interaction("elastic-pairs", strength=0.5))
    found = aged(contact, own)
    full = aged(contact, own, method=None, replicas=20, seed=3)
    noise = full.bonds.std(axis=0, ddof=1) / math.sqrt(20)
    away = np.abs(found.bonds[0] - full.bonds.mean(axis=0))
    assert (away <= 3 * np.hypot(noise, found.errors["closure"] * found.bonds[0])).all(), (away, found.bonds)


def _silica():
    patch = ca.parse_scene(ca.plugin.scene_data("silica-patch")[0])
    strong = ca.interaction("elastic-pairs", strength=0.5, bias=0.1)
    return patch, patch.chemistry.replace(interaction=strong)


@pytest.mark.parametrize("tip", [pytest.param(tip, marks=pytest.mark.campaign) for tip in (False, True)])
def test_the_stated_error_holds_on_very_rough_contacts_and_on_twelve_sites_under_a_tip(monkeypatch, tip):
    """H = 0.3 with a shortest wave of two pixels, a patch for each three to four sites; and a tip of 4 nm."""
    for name, value in (("SIDE", 128), ("BAND", 8), ("FIRST", 2), ("MOST", 256)):
        monkeypatch.setattr(_table, name, value)
    patch, own = _silica()
    if tip:
        sphere = ca.surface("sphere", radius=4.0, pixels=16, pixel_size=0.4518).make()
        single = ca.contact("hertz", modulus=35.3).solve(sphere, 8.0)
        # side by side, apart from each other
        pressure = np.tile(single.pressure, (12, 12))
        contact = ca.ContactSolution(pressure=pressure, load=144 * 8.0, pixel_size=0.4518, modulus=35.3, periodic=False)
        assert np.count_nonzero(single.contact) == 12
    else:
        contact = patch.contact.solve(patch.surface.replace(hurst=0.3, zeta=250).make(1), 0.5 * patch.load)
    times = 10.0 ** np.arange(-4, 6)
    method = ca.ageing_method("closure", accuracy=0.03)
    found = aged(contact, own, method=method, hold_times=times)
    replicas = 300
    full = aged(contact, own, method=None, replicas=replicas, seed=3, hold_times=times)
    mean, noise = full.bonds.mean(axis=0), full.bonds.std(axis=0, ddof=1) / math.sqrt(replicas)
    seen = mean * replicas > 100
    stated = found.errors["closure"] * found.bonds[0]
    assert (np.abs(found.bonds[0] - mean) <= 2.6 * np.hypot(noise, stated))[seen].all()
    # and the stated error is not so wide that it says nothing
    assert found.errors["closure"].max() < 0.05


def test_errors_of_opposite_signs_early_and_late_are_in_that_of_beta():
    found = aged(uniform(1.7), interacting())
    times, stated = found.hold_times, found.errors["closure"]
    early = np.where(times < 50, 1.0, -1.0) * stated
    tilted = found.model_copy(update={"bonds": found.bonds * (1 + early)})
    shift = abs(tilted.fit(1.0, 1e3).beta / found.fit(1.0, 1e3).beta - 1)
    run = ca.Run(scene={"fit": {"start": 1.0, "stop": 1e3}}, contact=uniform(1.7), ageing=found)
    assert run.beta_errors["closure"] == pytest.approx(shift, rel=1e-9)
    level = found.model_copy(update={"bonds": np.full_like(found.bonds, 500.0)})
    settled = dataclasses.replace(run, ageing=level)
    (beta,) = (one for one in level.quantities((1.0, 1e3)) if one.name == "beta")
    assert (beta.value, settled.beta_errors) == (0.0, {})
    assert beta.errors["closure"].size > 0.001 * level.mean_friction_coefficient_drop[-1]
    assert beta.parts()[0][1] == f"{beta.errors['closure'].size:.4g}"
    several = aged(uniform(1.7), interacting(), method=None, replicas=3)
    assert dataclasses.replace(run, ageing=several).beta_errors == {}


def test_bonds_do_not_depend_on_bond_force_and_grow_with_the_contact():
    one = aged(uniform(1.7), interacting())
    strong = aged(uniform(1.7), interacting(bond_force=6.0))
    np.testing.assert_array_equal(one.bonds, strong.bonds)
    np.testing.assert_array_equal(strong.friction_drop, 2 * one.friction_drop)
    np.testing.assert_allclose(aged(uniform(1.7, (80, 30)), interacting()).bonds, 2 * one.bonds, rtol=1e-12)


def test_what_it_gives_is_said():
    found = aged(uniform(1.7), interacting())
    assert (found.replicas, found.events, found.method, found.engine) == (1, None, "closure", "next-reaction")
    assert found.errors["closure"][1:].min() > 0.001
    assert "standard error" in found.error_words
    assert found.approximate[-1]["kind"] == "closure"


# -- tables -----------------------------------------------------------------------------------------------------------


def test_a_table_is_made_once_and_kept(own_tables, monkeypatch):
    done = []
    first = aged(uniform(1.7), interacting(), progress=lambda k, n: done.append((k, n)))
    assert done[-1][0] == done[-1][1] > 1
    monkeypatch.setattr("chemage_ageing.closure._tables", {})  # another process
    monkeypatch.setattr(_table.Setting, "nodes", lambda *_: pytest.fail("computed again"))
    again = aged(uniform(1.7), interacting())
    np.testing.assert_array_equal(again.bonds, first.bonds)
    assert again == first


@pytest.mark.long
def test_a_table_grows_with_the_pressure_and_its_nodes_do_not_change(own_tables, monkeypatch):
    low = aged(uniform(0.3), interacting())
    aged(uniform(4.0), interacting())
    monkeypatch.setattr("chemage_ageing.closure._tables", {})
    np.testing.assert_array_equal(aged(uniform(0.3), interacting()).bonds, low.bonds)
    assert len(list(own_tables.glob("*.npz"))) == 1


@pytest.mark.long
def test_every_chemistry_temperature_and_accuracy_has_a_table_of_its_own(own_tables):
    contact = uniform(0.2, (8, 8))
    aged(contact, interacting())
    aged(contact, interacting(hydroxylation=0.9))
    aged(contact, interacting(), temperature=310.0)
    aged(contact, interacting(), method=ca.ageing_method("closure", accuracy=0.02))
    assert len(list(own_tables.glob("*.npz"))) == 4


@pytest.mark.long
@pytest.mark.parametrize(
    "damage",
    [
        lambda b: b[:200] + b"xx" + b[202:],
        *(
            pytest.param(one, marks=pytest.mark.campaign)
            for one in (lambda b: b[:-100], lambda b: b"", lambda b: b"no")
        ),
    ],
)
def test_a_damaged_table_is_computed_again_and_that_is_said(own_tables, monkeypatch, damage):
    first = aged(uniform(0.3), interacting())
    (path,) = own_tables.glob("*.npz")
    path.write_bytes(damage(path.read_bytes()))
    monkeypatch.setattr("chemage_ageing.closure._tables", {})
    again = aged(uniform(0.3), interacting())
    np.testing.assert_array_equal(again.bonds, first.bonds)
    assert any(path.name in note and "computed again" in note for note in again.notes)
    assert path.stat().st_size > 1000


@pytest.mark.long
def test_a_folder_that_cannot_be_written_is_a_note(tmp_path):
    (tmp_path / "file").write_text("here")
    method = ca.ageing_method("closure", folder=str(tmp_path / "file" / "below"))
    found = aged(uniform(0.3), interacting(), method=method)
    assert found.bonds[0, -1] > 0
    assert any("could not be kept" in note or "cannot be read" in note for note in found.notes)
    assert method.digest() == ca.ageing_method("closure").digest()


# -- refusals ---------------------------------------------------------------------------------------------------------


def test_an_approximate_engine_of_the_scene_is_not_replaced_by_an_exact_one():
    class Rough(type(ca.engine("rejection-free"))):
        kind = "rough"
        exact = False

    with pytest.raises(
        InputError, match="tabulates with engine 'next-reaction', but the scene asks for the approximate"
    ):
        aged(uniform(0.3), interacting(), engine=Rough())


def test_an_engine_that_cannot_treat_the_interaction_is_refused():
    with pytest.raises(InputError, match="treats sites that do not interact"):
        aged(uniform(0.3), interacting(), method=ca.ageing_method("closure", engine="independent"))


def test_more_pressures_than_a_table_can_have_are_refused():
    areas, pressure = np.ones(5000), np.linspace(1.0, 1e7, 5000)
    wide = ca.plugin.ContactStatistics(pressure=pressure, area=areas, load=1.0, nominal_area=1e6, modulus=35.3)
    with pytest.raises(InputError, match="out of its range, leave out"):
        aged(wide, interacting(site_density=4.9))


def test_a_table_of_many_pressures_is_foreseen():
    """At 60 K and 4 GPa, pressures one k_BT of the barrier apart are some hundred; at 300 K a fifth of that."""
    method = ca.ageing_method("closure")

    def most(temperature, volume=0.0064):
        own = interacting(activation_volume=volume)
        known = {"interacting": True, "chemistry": own, "temperature": temperature, "mean_pressure": 4.0}
        return method.expected(1e4, {}, 1, **known)["cpu_seconds_most"]

    highest = 4.0 * math.sqrt(4 / math.pi * math.log(1e6))
    pressures = 0.0064 * ca.plugin.EV_PER_GPA_NM3 * highest / (ca.plugin.KB * 60.0)
    assert most(60.0) / most(60.0, 0.0) == pytest.approx(pressures, rel=0.05)
    assert 4 < most(60.0) / most(300.0) <= 5
