"""The number of events that is expected before anything is computed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

import chemage as ca
from chemage.lattices.independent import COUPLED, expected_kinetics, rough_pressures

NU = 1e13


def chemistry(forming=0.8, breaking: float | None = 0.9, **options):
    bonds = {} if breaking is None else {"breaking": ca.barriers("gaussian", mean=breaking, std=0)}
    return ca.chemistry(forming=ca.barriers("gaussian", mean=forming, std=0), **bonds, **options)


def expected_events(chemistry, pressure, hold_time, temperature):
    return expected_kinetics(chemistry, rough_pressures(pressure), hold_time, temperature).events


@pytest.mark.parametrize("hold_time", [1.0, 1e6])
@pytest.mark.parametrize("barriers", [(0.8, 0.9), (0.9, 0.8), (0.75, 0.75)])
def test_two_states_have_the_events_of_the_master_equation(barriers, hold_time):
    form, break_ = (NU * np.exp(-energy / (ca.plugin.KB * 320.0)) for energy in barriers)
    total = form + break_

    def rate(t):
        bonded = form / total * -np.expm1(-total * t)
        return form * (1 - bonded) + break_ * bonded

    exact, _ = quad(rate, 0, hold_time, epsabs=0, epsrel=1e-9, points=[min(10 / total, hold_time)], limit=500)
    found = expected_events(chemistry(*barriers), 1.0, hold_time, 320.0)
    assert found == pytest.approx(exact, rel=1e-7)


def test_bonds_that_last_form_once():
    lasting = chemistry(0.8, None)
    rate = NU * np.exp(-0.8 / (ca.plugin.KB * 300.0))
    assert expected_events(lasting, 1.0, 1.0, 300.0) == pytest.approx(-np.expm1(-rate), rel=1e-12)
    assert expected_events(lasting, 1.0, 1e9, 300.0) == pytest.approx(1.0, rel=1e-14)


def test_pressure_and_couplings():
    free = chemistry(0.9)
    assert expected_events(free, 5.0, 1.0, 300.0) == expected_events(free, 1.0, 1.0, 300.0)
    under = chemistry(0.9, activation_volume="6.4 angstrom**3")
    assert expected_events(under, 2.0, 1.0, 300.0) > 2 * expected_events(under, 1.0, 1.0, 300.0)
    coupled = chemistry(0.9, interaction=ca.interaction("elastic-pairs", strength=0.5))
    assert expected_events(coupled, 1.0, 1.0, 300.0) == COUPLED * expected_events(free, 1.0, 1.0, 300.0)


@pytest.mark.parametrize("hold_time", [0.0, 1e-100, 1e100])
@pytest.mark.parametrize("temperature", [1.0, 1e4, 1e100])
def test_the_ends_of_the_number_range(hold_time, temperature):
    for barriers in ((0.0, 0.0), (1e-3, 50.0), (50.0, 50.0), (1.0, None)):
        with np.errstate(all="raise"):
            found = expected_events(chemistry(*barriers), 1e10, hold_time, temperature)
        assert 0 <= found < np.inf


@pytest.mark.parametrize(("forming", "breaking"), [(2.0, 0.5), (1e-9, 3.0), (5.0, 0.0), (0.0, 0.0), (1e13, 1e-3)])
def test_the_two_state_chain_follows_its_master_equation(forming, breaking):
    """By the matrix exponential of the generator, in which a third component counts the bonds that broke."""
    sites = ca.plugin.TwoState(np.array([forming]), breaking)
    for time in (0.0, 1e-12, 0.3, 40.0):
        step = np.array([[-forming, breaking, 0], [forming, -breaking, 0], [0, breaking, 0]]) * time
        exact = expm(step) @ [1.0, 0.0, 0.0]
        assert sites.bonded(time)[0] == pytest.approx(exact[1], rel=1e-9, abs=1e-300)
        assert sites.broken(time)[0] == pytest.approx(exact[2], rel=2e-6, abs=1e-300)
        assert sites.bonded(np.array([[time], [2 * time]])).shape == (2, 1)


def test_rates_are_those_of_arrhenius_and_the_attempt_frequency_at_most():
    rates = chemistry().rates(np.array([-1.0, 0.0, 0.5]), 300.0)
    assert rates == pytest.approx([NU, NU, NU * np.exp(-0.5 / (ca.plugin.KB * 300.0))], rel=1e-15)
