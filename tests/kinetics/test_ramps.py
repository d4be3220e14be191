"""Ramps of temperature and barriers, of every engine, against the master equation and integrated hazards."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import binom, kstest

import chemage
from chemage import InputError, ReactionLattice
from chemage.plugin import EV_PER_GPA_NM3, KB, Drive, Ramp
from chemage.testing.small_systems import Group, agree, barrier, coupled, states

pytestmark = pytest.mark.long
NU = 1e13
KELVIN, SPAN = 300.0, 3.0
#: what the conditions become: temperature, and what forming and breaking barriers rise by, eV
RAMPS = {
    "heated": (335.0, 0.0, 0.0),
    "cooled": (270.0, 0.0, 0.0),
    "pressed": (300.0, -0.06, 0.02),
    "released and heated": (320.0, 0.05, 0.0),
}
ENGINES = [
    ("rejection-free", {}),
    ("bkl", {}),
    ("bkl", {"superbasins": True}),
    ("next-reaction", {"superbasins": True, "threads": 2}),
    ("auto", {}),
    ("event-driven", {}),
]
STILL = Drive(speed=0, bond_stiffness=1.0, transition_distance=0.1, partner="kept")


def risen(group: Group, forming: float, breaking: float) -> Group:
    """The group with other barriers, each by another amount."""
    shares = np.linspace(0.5, 1.5, len(group.forming))
    return dataclasses.replace(
        group,
        forming=tuple(np.array(group.forming) + forming * shares),
        breaking=None if group.breaking is None else tuple(np.array(group.breaking) + breaking * shares),
    )


@cache
def solved(name: str, times: tuple[float, ...]) -> np.ndarray:
    """The probabilities of all states at ``times`` (m, states), from the state without bonds, with rates that change."""
    kelvin, *rise = RAMPS[name]
    group = coupled()
    end = risen(group, *rise)

    def change(time: float, now: np.ndarray) -> np.ndarray:
        part = time / times[-1]
        between = {
            name: tuple(np.array(getattr(group, name)) * (1 - part) + np.array(getattr(end, name)) * part)
            for name in ("forming", "breaking")
        }
        return dataclasses.replace(group, **between).generator(KELVIN + (kelvin - KELVIN) * part) @ now

    start = np.eye(2 ** len(group.forming))[0]
    return solve_ivp(change, (0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-12, method="LSODA").y.T


def followed(kind, options, lattice, times, seed, ramp, **more):
    if kind == "event-driven":
        how = {"temperature": KELVIN, "seed": seed, "ramp": ramp, **more}
        return chemage.pulling(kind, **options).run(lattice, STILL, times, **how)
    return chemage.engine(kind, **options).run(lattice, times, temperature=KELVIN, seed=seed, ramp=ramp, **more)


@pytest.mark.parametrize("name", RAMPS)
@pytest.mark.parametrize(("kind", "options"), ENGINES)
def test_interacting_sites_follow_the_master_equation_with_changing_rates(kind, options, name):
    kelvin, *change = RAMPS[name]
    group, copies = coupled(), 2500
    end = risen(group, *change)
    lattice, times = group.lattice(copies), (0.4 * SPAN, SPAN)
    probabilities = solved(name, times)
    history = followed(kind, options, lattice, times, 5, Ramp(kelvin, end.lattice(copies)))
    agree(f"{kind}, {name}", states(history.state, 4), probabilities[-1])
    bonded = np.arange(16)[:, None] >> np.arange(4) & 1
    mean = copies * (probabilities[0] @ bonded.sum(axis=1))
    spread = math.sqrt(copies * (probabilities[0] @ bonded.sum(axis=1) ** 2 - (mean / copies) ** 2))
    assert abs(history.bonds[0] - mean) < 4.5 * spread
    assert history.temperature == kelvin
    assert np.array_equal(history.hold_times if kind != "event-driven" else history.times, times)


@pytest.mark.parametrize("decade", range(-28, 13, 8))
def test_over_forty_decades_of_rates_a_site_forms_by_its_integrated_hazard(decade):
    copies, energy = 20_000, float(barrier(10.0**decade))
    lattice = plain(copies, energy)
    points = np.linspace(0.0, 1.0, 20_001)
    hazard = NU * np.exp(-energy / (KB * (KELVIN + 20.0 * points)))
    past = np.concatenate([[0.0], np.cumsum((hazard[1:] + hazard[:-1]) / 2)]) / 20_000
    # half of the sites at the second time
    span = math.log(2.0) / past[-1]
    for kind in ("independent", "bkl", "next-reaction", "rejection-free"):
        times = np.array([0.5, 1.0]) * span
        bonds = chemage.engine(kind).run(lattice, times, temperature=KELVIN, seed=3, ramp=Ramp(320.0)).bonds
        for seen, so_far in zip(bonds, (past[10_000], past[-1]), strict=True):
            chance = -math.expm1(-so_far * span)
            assert 1e-6 < binom.cdf(seen, copies, chance) < 1 - 1e-6, kind


@pytest.mark.parametrize("shape", ["cusp", "cubic", "constant"])
@pytest.mark.parametrize(("kelvin", "change"), [(340.0, 0.05), (300.0, -0.1), (260.0, 0.0), (280.0, 0.1)])
def test_bonds_that_are_pulled_break_by_their_integrated_hazard(shape, kelvin, change):
    copies, times, drive = 5000, np.linspace(0.0, 10.0, 21), pulled_at(shape)
    lattice = plain(copies, 5.0, 0.85)
    end = lattice.model_copy(update={"breaking": lattice.breaking + change})
    pulled = chemage.pulling("event-driven").run(
        lattice, drive, times, temperature=KELVIN, seed=2, start=np.ones(copies, bool), ramp=Ramp(kelvin, end)
    )

    def hazard(time: float) -> float:
        thermal = KB * (KELVIN + (kelvin - KELVIN) * time / 10.0)
        energy = (0.85 + change * time / 10.0) / thermal
        lowered = 0.1 * time * 0.8 * 0.1 * EV_PER_GPA_NM3 / thermal
        share = 1 - drive.exponent * lowered / energy
        left = max(share, 0.0) ** (1 / drive.exponent) * energy
        if left < 1 - drive.exponent or share <= 0:
            left = 1 - drive.exponent
        return NU * (left / energy) ** (1 - drive.exponent) * math.exp(-left)

    past = solve_ivp(
        lambda time, _: [hazard(time)], (0, 10), [0.0], t_eval=times, rtol=1e-9, atol=1e-12, method="LSODA"
    )
    alive = np.exp(-past.y[0])
    spread = np.sqrt(copies * alive * (1 - alive))
    assert np.all(np.abs(pulled.bonds - copies * alive) < 4.5 * spread + 0.5)
    assert pulled.peak >= pulled.force.max()
    assert abs(pulled.imbalance).max() < 1e-9


@pytest.mark.parametrize(("first", "last"), [(0.0, 0.2), (0.2, 0.0), (0.02, 0.15)])
@pytest.mark.parametrize("kelvin", [300.0, 320.0])
def test_a_drive_whose_speed_changes_breaks_bonds_by_their_integrated_hazard(first, last, kelvin):
    copies, times = 5000, np.linspace(0.0, 10.0, 21)
    lattice, drive = plain(copies, 5.0, 0.85), pulled_at("constant").replace(speed=first)
    pulled = chemage.pulling("event-driven").run(
        lattice, drive, times, temperature=KELVIN, seed=2, start=np.ones(copies, bool), ramp=Ramp(kelvin, speed=last)
    )
    way = first * times + (last - first) * times**2 / 20
    np.testing.assert_allclose(pulled.displacement, way, rtol=1e-12, atol=1e-14)
    assert pulled.drive["speed"] == last

    def hazard(time: float) -> float:
        thermal = KB * (KELVIN + (kelvin - KELVIN) * time / 10.0)
        stretch = first * time + (last - first) * time**2 / 20
        return NU * math.exp(-max(0.85 - stretch * 0.8 * 0.1 * EV_PER_GPA_NM3, 0.0) / thermal)

    past = solve_ivp(
        lambda time, _: [hazard(time)], (0, 10), [0.0], t_eval=times, rtol=1e-9, atol=1e-12, method="LSODA"
    )
    alive = np.exp(-past.y[0])
    assert np.all(np.abs(pulled.bonds - copies * alive) < 4.5 * np.sqrt(copies * alive * (1 - alive)) + 0.5)
    assert abs(pulled.imbalance).max() < 1e-9
    fewer = chemage.pulling("event-driven").run(
        lattice,
        drive,
        times[[7, -1]],
        temperature=KELVIN,
        seed=2,
        start=np.ones(copies, bool),
        ramp=Ramp(kelvin, speed=last),
    )
    assert np.array_equal(fewer.state, pulled.state)
    assert fewer.force[-1] == pulled.force[-1]


@pytest.mark.parametrize(("first", "last"), [(0.0, 2.0), (2.0, 0.0), (0.5, 1.5)])
def test_a_spring_whose_end_accelerates_is_in_balance(first, last):
    """K(x − X) = n κ X + friction once it pulls as much; nothing reacts."""
    copies, times = 50, np.linspace(0.0, 3.0, 31)
    lattice = plain(copies, 6.0, 6.0)
    drive = Drive(speed=first, spring=30.0, friction=5.0, bond_stiffness=0.8, transition_distance=1e-4, partner="kept")
    how = {"temperature": KELVIN, "start": np.ones(copies, bool), "ramp": Ramp(speed=last)}
    pulled = chemage.pulling("event-driven").run(lattice, drive, times, **how)
    way = first * times + (last - first) * times**2 / 6
    slider = np.maximum(30.0 * way - 5.0, 0.0) / (30.0 + 40.0)
    np.testing.assert_allclose(pulled.displacement, slider, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(pulled.force, 30.0 * (way - slider), rtol=1e-9, atol=1e-12)
    assert abs(pulled.imbalance).max() < 1e-9


def test_a_speed_of_a_hold_is_refused():
    with pytest.raises(InputError, match="to a pull alone"):
        chemage.engine("bkl").run(plain(10, 0.8, 0.9), [1.0], temperature=KELVIN, ramp=Ramp(speed=1.0))


def pulled_at(shape: str) -> Drive:
    return Drive(speed=0.1, bond_stiffness=0.8, transition_distance=0.1, partner="kept", shape=shape)


def plain(copies: int, forming: float, breaking: float | None = None) -> ReactionLattice:
    return ReactionLattice(
        pixels=(copies, 1),
        sites=np.arange(copies),
        forming=np.full(copies, forming),
        breaking=None if breaking is None else np.full(copies, breaking),
    )


def test_other_partners_have_the_barriers_of_the_present_pressure():
    """Those that sites have met on a way of two spacings rise with the barriers of the lattice."""
    copies, engine = 4000, chemage.pulling("event-driven")
    lattice = plain(copies, 0.9, 0.5)
    end = lattice.model_copy(update={"forming": lattice.forming + 0.08, "breaking": lattice.breaking + 0.02})
    partners = chemage.plugin.Partners(np.full(2, 0.8), np.full(2, 0.6), np.zeros(copies), 1.0)
    drive = Drive(speed=2e3, bond_stiffness=1.0, transition_distance=0.1)
    how = {"temperature": KELVIN, "seed": 4, "partners": partners}
    slid = engine.run(lattice, drive, [1e-3], **how)
    assert np.allclose(slid.forming, 0.8)
    still = engine.run(lattice, drive.replace(speed=0), [2.0], start=slid, ramp=Ramp(lattice=end), **how)
    assert np.allclose(still.forming, 0.88)
    assert np.allclose(still.breaking, 0.62)


@pytest.mark.parametrize(("kind", "options"), ENGINES)
def test_a_hold_after_a_ramp_has_the_rates_of_its_end(kind, options):
    """What was pending at the end of a ramp is a bound, and no event of the hold that follows."""
    copies = 4000
    lattice = plain(copies, 0.85, 2.0)
    ramp = Ramp(temperature=280.0)
    cooled = followed(kind, options, lattice, [1.0], 7, ramp)
    until = 60.0
    if kind == "event-driven":
        held = chemage.pulling(kind).run(lattice, STILL, [until], temperature=280.0, seed=7, start=cooled)
    else:
        held = chemage.engine(kind, **options).run(lattice, [until], temperature=280.0, seed=7, start=cooled)
    chance = -math.expm1(-NU * math.exp(-0.85 / (KB * 280.0)) * (until - 1.0))
    left = copies - int(cooled.bonds[-1])
    assert 1e-5 < binom.cdf(int(held.bonds[-1] - cooled.bonds[-1]), left, chance) < 1 - 1e-5


def test_a_ramp_takes_no_random_number_of_the_hold_before_it_again():
    """Times of single bonds, in a hold and in a ramp that changes nothing, are independent."""
    lattice, pairs = plain(1, float(barrier(1.0)), float(barrier(1.0))), []
    for seed in range(400):
        engine = chemage.engine("next-reaction")
        held = engine.run(lattice, [1.0], temperature=KELVIN, seed=seed)
        ramped = engine.run(lattice, [2.0], temperature=KELVIN, seed=seed, start=held, ramp=Ramp(KELVIN + 1e-9))
        pairs.append((held.formed[-1], ramped.formed[-1] - held.formed[-1], held.bonds[-1]))
    first, second, bonded = np.array(pairs).T
    for state in (0, 1):
        there = bonded == state
        assert abs(np.corrcoef(first[there], second[there])[0, 1]) < 4 / math.sqrt(there.sum())


def test_where_a_ramp_is_asked_for_changes_nothing():
    """Hold times between do not change what happens, whatever part of the ramp they lie in."""
    lattice = coupled().lattice(200)
    for kind, options in ENGINES[:-1]:
        engine, ramp = chemage.engine(kind, **options), Ramp(temperature=340.0)
        many = engine.run(lattice, np.linspace(0.1, SPAN, 30), temperature=KELVIN, seed=1, ramp=ramp)
        one = engine.run(lattice, [SPAN], temperature=KELVIN, seed=1, ramp=ramp)
        assert np.array_equal(many.state, one.state), kind
        assert many.bonds[-1] == one.bonds[-1]


def test_without_time_a_ramp_is_a_step():
    lattice = plain(10, 0.6, 0.9)
    held = chemage.engine("bkl").run(lattice, [1.0], temperature=KELVIN)
    there = chemage.engine("bkl").run(lattice, [1.0], temperature=KELVIN, start=held, ramp=Ramp(350.0))
    assert there.temperature == 350.0
    assert np.array_equal(there.state, held.state)


@pytest.mark.parametrize(
    ("ramp", "words"),
    [
        (Ramp("-3 K"), "temperature"),
        (Ramp(lattice=plain(9, 0.8, 0.9)), "other sites"),
        (Ramp(lattice=plain(10, 0.8)), "other sites"),
    ],
)
def test_a_ramp_to_what_cannot_be_is_refused(ramp, words):
    with pytest.raises(InputError, match=words):
        chemage.engine("bkl").run(plain(10, 0.8, 0.9), [1.0], temperature=KELVIN, ramp=ramp)


def test_the_time_of_a_bond_is_distributed_as_its_hazard_says():
    """Waiting times under a ramp, transformed by the integrated hazard, are exponential."""
    copies, times = 3000, np.linspace(0.0, 4.0, 4001)
    lattice = plain(copies, 0.82)
    history = chemage.engine("bkl").run(lattice, times, temperature=KELVIN, seed=8, ramp=Ramp(360.0))
    hazard = NU * np.exp(-0.82 / (KB * (KELVIN + 15.0 * times)))
    past = np.concatenate([[0], np.cumsum((hazard[1:] + hazard[:-1]) / 2 * np.diff(times))])
    formed = np.repeat(past, np.diff(history.bonds, prepend=0))
    assert kstest(-np.expm1(-formed) / -math.expm1(-past[-1]), "uniform").pvalue > 1e-4
