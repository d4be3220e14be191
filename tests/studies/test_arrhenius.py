"""Activation energies are those of closed forms, and their intervals mean 95 %."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chemage as ca
from chemage import Ageing, InputError
from chemage.plugin import EV_PER_GPA_NM3, KB

KELVINS = (260.0, 280.0, 300.0, 325.0, 350.0)
NU = 1e13
#: a window without hold times, for tests that need no fit of β
NO_FIT = ("1e9 s", "1e10 s")
TIMES = np.geomspace(1e-6, 1e8, 14 * 16 + 1)


def aged(temperature, coverage, times=TIMES, **fields):
    """An ageing curve of a million sites whose bonded share is ``coverage`` (replicas, m)."""
    share = np.atleast_2d(coverage)
    given = {"load": 1e6, "temperature": temperature, "bond_force": 1.0, "front_factor": 1.0}
    return Ageing(hold_times=times, bonds=1e6 * share, sites=np.full(len(share), 1e6), **(given | fields))


def of_one_barrier(temperature, energy, times=TIMES):
    """First-order kinetics of independent sites: 1 − exp(−ν t e^(−E/k_B T))."""
    return -np.expm1(-NU * times * math.exp(-energy / (KB * temperature)))


def of_flat_density(temperature, lower, upper, times=TIMES):
    """The same, averaged over barriers spread evenly between ``lower`` and ``upper``."""
    energies = lower + (upper - lower) * (np.arange(1000) + 0.5) / 1000
    return np.mean(-np.expm1(-np.outer(times, NU * np.exp(-energies / (KB * temperature)))), axis=1)


# -- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", [0.1, 0.5, 0.9])
def test_one_barrier_has_its_own_energy_at_every_level(level):
    found = ca.arrhenius([aged(t, of_one_barrier(t, 0.85)) for t in KELVINS], level, quantity="bonds_per_site")
    (one, *_) = found.energies
    assert one.energy == pytest.approx(0.85, abs=1e-3)
    # at half coverage t = ln 2/ν exp(E/k_B T)
    assert math.log(one.prefactor) == pytest.approx(math.log(-math.log1p(-level) / NU), abs=0.05)
    assert one(300.0) == pytest.approx(-math.log1p(-level) / NU * math.exp(0.85 / (KB * 300)), rel=0.02)


@pytest.mark.long
def test_pressure_lowers_the_energy_by_the_activation_volume():
    """What the model computes: E_a at half coverage is E − P ΔV."""
    contact = ca.ContactSolution(
        pressure=np.full((32, 32), 1.5), load=1.5 * 32**2 * 0.4518**2, pixel_size=0.4518, modulus=35.3
    )
    barriers = ca.barriers("uniform", lower=0.899, upper=0.901)
    chemistry = ca.chemistry(forming=barriers, activation_volume="6.4 angstrom**3")
    times = ca.hold_times("1e-3 s", "1e6 s", per_decade=8)
    curves = [
        ca.age(contact, chemistry, engine=ca.engine("independent"), hold_times=times, temperature=t, replicas=6, seed=3)
        for t in (280.0, 300.0, 320.0)
    ]
    expected = 0.9 - 1.5 * 6.4e-3 * EV_PER_GPA_NM3
    one = ca.arrhenius(curves, 0.5, quantity="bonds_per_site").energies[0]
    assert one.energy == pytest.approx(expected, abs=max(4 * one.energy_stderr, 2e-3))
    assert one.energy_stderr < 0.02
    assert one.energy_interval.low < expected < one.energy_interval.high


def test_a_flat_density_has_an_energy_that_grows_with_the_level():
    """θ ≈ (k_B T (ln νt + γ) − E₀)/(E₁ − E₀) inside the range, so that E_a(θ) = E₀ + θ (E₁ − E₀)."""
    levels = [0.2, 0.35, 0.5, 0.65, 0.8]
    curves = [aged(t, of_flat_density(t, 0.7, 1.3)) for t in (310.0, 340.0, 370.0)]
    found = ca.arrhenius(curves, levels, quantity="bonds_per_site", window=NO_FIT)
    for level, one in zip(levels, found.energies, strict=True):
        assert one.energy == pytest.approx(0.7 + 0.6 * level, abs=2e-3)
        assert math.log(one.prefactor) == pytest.approx(-np.euler_gamma - math.log(NU), abs=0.1)


def test_the_slope_of_a_flat_density_is_proportional_to_temperature():
    """β = k_B T ln 10/(E₁ − E₀) of the bonds per site, here equal to Δμ, and the cut-off time has the energy E₀."""
    curves = [aged(t, of_flat_density(t, 0.5, 1.5)) for t in KELVINS]
    found = ca.arrhenius(curves, 0.3, window=("0.1 s", "100 s"))
    for kelvin, fit in zip(found.temperatures, found.fits, strict=True):
        assert fit.beta / kelvin == pytest.approx(KB * math.log(10), rel=2e-3)
    assert found.energies[-1].level is None
    assert found.energies[-1].energy == pytest.approx(0.5, abs=2e-3)


def test_levels_are_chosen_where_the_temperatures_overlap():
    curves = [aged(t, of_flat_density(t, 0.7, 1.1)) for t in KELVINS]
    found = ca.arrhenius(curves, quantity="bonds_per_site")
    levels = [one for one in found.energies if one.level is not None]
    assert len(levels) == 5
    assert all(one.temperatures.size == len(KELVINS) for one in levels)
    assert [one.level for one in levels] == sorted(one.level for one in levels)


# -- errors -----------------------------------------------------------------------------------------------------------

LOGS = np.log(TIMES)


def noisy(rng, replicas=40, common=0.0, alone=0.02, energy=0.8, kelvins=KELVINS):
    """Straight lines in ln t that replicas shift, by an amount common to all temperatures and by one of their own."""
    shift = common * rng.standard_normal((replicas, 1))
    curves = []
    for t in kelvins:
        own = alone * rng.standard_normal((replicas, 1))
        mean = 0.02 * (LOGS + math.log(NU) - energy / (KB * t)) + 0.1
        curves.append(aged(t, np.clip(mean + shift + own, 0, 1)))
    return curves


def test_what_all_temperatures_have_in_common_does_not_change_the_energy():
    one = ca.arrhenius(noisy(np.random.default_rng(0), common=0.05, alone=0.0), 0.3).energies[0]
    assert one.energy == pytest.approx(0.8, abs=1e-6)
    assert one.energy_stderr < 1e-6
    spread = math.log(one.prefactor_interval.high / one.prefactor)
    assert spread == pytest.approx(2.02 * 0.05 / 0.02 / math.sqrt(40), rel=0.35)  # all of it is in the prefactor


def test_the_standard_error_is_that_of_least_squares():
    one = ca.arrhenius(noisy(np.random.default_rng(1), replicas=200), 0.3).energies[0]
    x = 1 / (KB * np.array(KELVINS))
    expected = 0.02 / 0.02 / math.sqrt(200) / math.sqrt(np.sum((x - x.mean()) ** 2))
    assert one.energy_stderr == pytest.approx(expected, rel=0.2)
    assert one.log_time_errors == pytest.approx(np.full(5, 1 / math.sqrt(200)), rel=0.25)
    assert one.intervals == "Student's t, jackknife over 200 replicas"


@pytest.mark.long
@pytest.mark.parametrize("common", [0.0, 0.03])
@pytest.mark.parametrize("replicas", [4, 12])
def test_intervals_hold_the_energy_in_95_of_100_cases(common, replicas):
    rng, inside = np.random.default_rng(7), 0
    for _ in range(400):
        one = ca.arrhenius(noisy(rng, replicas, common), 0.3, window=NO_FIT).energies[0]
        inside += one.energy_interval.low < 0.8 < one.energy_interval.high
    assert 0.92 <= inside / 400 <= 0.98


def test_a_single_replica_has_the_scatter_about_the_line_for_its_error():
    rng = np.random.default_rng(2)
    one = ca.arrhenius(noisy(rng, replicas=1), 0.3).energies[0]
    assert one.intervals == "Student's t, scatter about the line, 5 temperatures"
    assert one.energy_interval.low < 0.8 < one.energy_interval.high
    x, y = 1 / (KB * one.temperatures), np.log(one.times)
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    assert one.energy == pytest.approx(slope, rel=1e-9)
    assert one.energy_stderr == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-6)


def test_unlike_numbers_of_replicas_are_taken_as_independent():
    curves = noisy(np.random.default_rng(3), replicas=20)
    curves[1] = aged(KELVINS[1], curves[1].bonds[:8] / 1e6)
    one = ca.arrhenius(curves, 0.3).energies[0]
    assert one.intervals == "Student's t, jackknife over 8 to 20 replicas"
    assert one.energy_interval.low < 0.8 < one.energy_interval.high


# -- input ------------------------------------------------------------------------------------------------------------


def curves(*kelvins, **fields):
    return [aged(t, of_one_barrier(t, 0.85), **fields) for t in kelvins]


@pytest.mark.parametrize(
    ("results", "options", "message"),
    [
        (curves(300, 320), {}, "2 temperatures; a line with an error needs 3"),
        ([], {}, "0 temperatures"),
        (curves(300, 300, 320), {}, "two of them are at 300 K"),
        ([*curves(300, 320), *curves(340, load=5.0)], {}, r"differ in load \(5, 1e\+06\), not in temperature alone"),
        ([*curves(300, 320), *curves(340, provenance={"chemistry": {"x": 1}})], {}, "differ in their chemistry"),
        (curves(300, 320, 340), {"levels": 2.0}, "is reached between .* at 0 temperatures, and a line needs 3"),
        (curves(300, 320, 340), {"levels": -1}, "must be finite and positive"),
        (curves(300, 320, 340), {"levels": []}, "an empty list"),
        (curves(300, 320, 340), {"levels": "3 nN"}, "nanonewton"),
        (curves(300, 320, 340), {"quantity": "friction"}, "choose friction_coefficient_drop"),
        (curves(300, 320, 340), {"confidence": 1}, "between 0 and 1"),
        (curves(300, 320, 340, load=0.0), {"quantity": "friction_coefficient_drop"}, "load = 0"),
        ([1, 2, 3], {}, "an int is no result"),
    ],
)
def test_what_makes_no_line_is_refused(results, options, message):
    with pytest.raises(InputError, match=message):
        ca.arrhenius(results, **options)


def test_temperatures_at_which_a_level_is_not_reached_are_left_out():
    short = TIMES[TIMES <= 10]
    cold = aged(200.0, of_one_barrier(200.0, 0.85, short), short)
    found = ca.arrhenius([cold, *curves(300, 320, 340)], 0.5, quantity="bonds_per_site")
    assert found.temperatures.tolist() == [200, 300, 320, 340]
    assert found.energies[0].temperatures.tolist() == [300, 320, 340]


def test_without_load_the_levels_are_forces():
    found = ca.arrhenius(curves(300, 320, 340, load=0.0), "0.5 uN")
    assert found.quantity == "friction_drop"
    assert found.unit == "nN"
    assert found.label(found.energies[0]) == "ΔF = 500 nN"
    assert found.energies[0].energy > 0.8


def test_where_nothing_overlaps_a_note_says_so():
    found = ca.arrhenius([aged(t, np.full(TIMES.size, 0.5)) for t in (300, 320, 340)])
    assert found.energies == ()
    assert "no level is reached" in found.notes[0]
