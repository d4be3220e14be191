"""Shares of contact area and load above a hardness."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chemage as ca
from chemage import InputError


@pytest.mark.parametrize("part", [0.25, 0.5, 0.8, 0.95])
@pytest.mark.parametrize(("radius", "load"), [(100.0, 2000.0), (30.0, 4000.0)])
def test_the_shares_of_a_hertz_contact_are_the_closed_form(radius, load, part):
    """p(r) = p0 √(1 − r²/a²): 1 − (H/p0)² of the area and 1 − (H/p0)³ of the load lie above the pressure H."""
    tip = ca.surface("sphere", radius=radius, pixels=512, pixel_size=0.1).make()
    contact = ca.contact("hertz", modulus="35.3 GPa").solve(tip, load)
    a = (3 * load * radius / (4 * 35.3)) ** (1 / 3)
    peak = 3 * load / (2 * math.pi * a**2)
    found = contact.above(part * peak)
    # pixels along the two contours decide by their centres: their number scatters by about the root of the perimeter
    pixels = 2 * math.sqrt(2 * math.pi * a / 0.1) * 0.1**2 / (math.pi * a**2)
    assert found.area == pytest.approx(1 - part**2, abs=pixels)
    assert found.load == pytest.approx(1 - part**3, abs=pixels)


def test_the_solved_sphere_has_the_shares_of_hertz():
    tip = ca.surface("sphere", radius="30 nm", pixels=256, pixel_size=0.1).make()
    contact = ca.contact("fft-bem", modulus="35.3 GPa").solve(tip, 1000.0)
    a = (3 * 1000.0 * 30.0 / (4 * 35.3)) ** (1 / 3)
    peak = 3 * 1000.0 / (2 * math.pi * a**2)
    found = contact.above(0.6 * peak)
    assert found.area == pytest.approx(1 - 0.6**2, abs=0.02)
    assert found.load == pytest.approx(1 - 0.6**3, abs=0.01)


def test_the_shares_fall_with_the_hardness_from_one_to_zero(examples):
    contact = examples.contact()
    shares = [contact.above(hardness) for hardness in (1e-6, 1.0, 2.5, 5.5, 1e3)]
    assert shares[0] == (1.0, 1.0)
    assert shares[-1] == (0.0, 0.0)
    areas, loads = zip(*shares, strict=True)
    assert list(areas) == sorted(areas, reverse=True)
    assert list(loads) == sorted(loads, reverse=True)
    assert all(load >= area for area, load in shares), "where the pressure is highest, the load per area is too"
    assert contact.above("1 GPa") == contact.above(1.0) == contact.above("1000 MPa")


def test_without_contact_there_are_no_shares(examples):
    nothing = examples.contact(pressure=np.zeros((4, 5)), load=0.0)
    assert all(math.isnan(share) for share in nothing.above(1.0))


@pytest.mark.parametrize("wrong", [0, -1.0, math.nan, math.inf, "10 nN", "10", None])
def test_what_is_no_hardness_is_refused(examples, wrong):
    with pytest.raises((InputError, ca.errors.UnitError)):
        examples.contact().above(wrong)


def test_a_tenth_of_the_contact_of_a_steep_surface_is_above_ten_gigapascal():
    """h'_rms = 0.4 at 15.7 MPa: 10–16 % of the area and 23–33 % of the load lie above 10 GPa."""
    maker = ca.surface("self-affine", pixels=512, pixel_size="0.4518 nm", rms_slope=0.4, hurst=0.8, zeta=31, eta=3)
    solver = ca.contact("fft-bem", modulus="35.3 GPa")
    found = np.array([solver.solve(maker.make(seed=seed), "839 nN").above("10 GPa") for seed in range(1, 9)])
    area, load = found.mean(axis=0)
    assert 0.10 < area < 0.16
    assert 0.23 < load < 0.33
