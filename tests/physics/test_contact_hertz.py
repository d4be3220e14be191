"""The closed form of the sphere on pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chemage import InputError, Surface
from chemage.plugin import patches
from chemage_contact import Hertz
from chemage_contact.closed_forms import _corner_force
from chemage_surfaces import Sphere


def tip(pixels, radius=30.0, pixel_size=0.25):
    return Sphere(radius=radius, pixels=pixels, pixel_size=pixel_size).make()


def contact_radius(load, radius, modulus):
    return (0.75 * load * radius / modulus) ** (1 / 3)


@pytest.mark.parametrize("pixels", [(64, 64), (65, 65), (63, 80)])
def test_pressure_is_that_of_hertz(pixels):
    load, radius, modulus = 60.0, 30.0, 35.3
    contact = Hertz(modulus=modulus).solve(tip(pixels), load)
    a = contact_radius(load, radius, modulus)
    peak = 1.5 * load / (math.pi * a * a)
    x, y = ((np.arange(n) - (n - 1) / 2) * 0.25 for n in pixels)
    r = np.hypot(x[:, None], y)
    exact = peak * np.sqrt(np.maximum(1 - (r / a) ** 2, 0))
    away = r < a - 0.75
    np.testing.assert_allclose(contact.pressure[away], exact[away], rtol=0.02)
    assert np.all(contact.pressure[r >= a] == 0)
    assert contact.displacement == pytest.approx(a * a / radius, rel=1e-12)
    assert contact.patches == 1
    np.testing.assert_array_equal(contact.pressure, contact.pressure[::-1, ::-1])


@given(
    load=st.floats(1e-6, 3e2),
    radius=st.floats(5, 100),
    pixel=st.floats(0.1, 2.0),
    pixels=st.tuples(st.integers(60, 90), st.integers(60, 90)),
)
def test_pixels_add_up_to_the_load_and_the_area(load, radius, pixel, pixels):
    modulus = 35.3
    a = contact_radius(load, radius, modulus)
    if a > 25 * pixel:
        return
    contact = Hertz(modulus=modulus).solve(tip(pixels, radius, pixel), load)
    assert contact.pressure.sum() * pixel**2 == pytest.approx(load, rel=1e-9)
    assert contact.pressure.min() >= 0
    if a > 5 * pixel:
        assert contact.area == pytest.approx(math.pi * a * a, rel=0.12)
        assert contact.pressure.max() == pytest.approx(1.5 * load / (math.pi * a * a), rel=0.03)


@pytest.mark.parametrize(("pixel_size", "pixels"), [(0.25, 56), (0.4518, 32), (0.9, 16)])
def test_no_area_is_free_of_bias_but_that_of_the_centres(pixel_size, pixels):
    """Averaged over radii, the corrected area is πa²; the correction for loaded pixels would take away 1 to 4 %."""
    loads = np.geomspace(20.0, 300.0, 1000 if pixel_size > 0.5 else 300)
    surface = tip(pixels, 30.0, pixel_size)  # the largest contact is 11.6 nm wide
    contacts = [Hertz(modulus=35.3).solve(surface, load) for load in loads]
    exact = np.array([math.pi * contact_radius(load, 30.0, 35.3) ** 2 for load in loads])
    found = np.array([contact.corrected_area for contact in contacts])
    scatter = (found / exact).std() / math.sqrt(loads.size)
    assert abs((found / exact).mean() - 1) < 4 * scatter + 1e-12
    assert 4 * scatter < 0.01
    wrong = np.array([patches.corrected_area(c.area, c.perimeter, pixel_size) for c in contacts])
    assert (wrong / exact).mean() < 1 - 0.01


@given(load=st.floats(1e-6, 300.0), radius=st.floats(5.0, 100.0), pixels=st.integers(60, 90))
def test_the_expected_area_is_that_of_the_solution(load, radius, pixels):
    """A plan knows πa²/A0 from the radius of the sphere."""
    solver, maker = Hertz(modulus=35.3), Sphere(radius=radius, pixels=pixels, pixel_size=0.5)
    expected = solver.expected(maker.expected(), load)["area_fraction"]
    a = contact_radius(load, radius, 35.3)
    assert expected == pytest.approx(math.pi * a**2 / (pixels * 0.5) ** 2, rel=1e-12)
    assert solver.expected({"nx": pixels, "ny": pixels}, load) == {}
    if 2.5 < a < 0.25 * pixels:
        assert solver.solve(maker.make(), load).area_fraction == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize(
    ("x", "y"), [(0.3, 0.4), (0.7, 0.7), (0.9, 0.8), (1.0, 0.5), (2.0, 3.0), (0.05, 0.9), (0.6, 0.8)]
)
def test_corner_integral_is_right(x, y):
    """Against a midpoint sum of sqrt(1 − s² − t²)."""
    n = 2000
    s, t = (np.arange(n) + 0.5) / n * min(x, 1), (np.arange(n) + 0.5) / n * min(y, 1)
    total = np.sqrt(np.maximum(1 - s[:, None] ** 2 - t**2, 0)).mean() * min(x, 1) * min(y, 1)
    assert float(_corner_force(np.array(x), np.array(y))) == pytest.approx(total, rel=2e-5)


def test_the_whole_quarter_is_a_sixth_of_pi():
    assert float(_corner_force(np.array(1.0), np.array(1.0))) == pytest.approx(math.pi / 6, rel=1e-14)


@pytest.mark.parametrize("pixels", [64, 65])
def test_a_contact_smaller_than_a_pixel_is_carried_by_the_pixels_at_the_apex(pixels):
    contact = Hertz(modulus=35.3).solve(tip(pixels), 1e-9)
    assert contact.sites.size == (4 if pixels % 2 == 0 else 1)
    assert contact.pressure.sum() * 0.25**2 == pytest.approx(1e-9, rel=1e-12)


def test_no_load_is_a_contact_without_pixels():
    contact = Hertz(modulus=35.3).solve(tip(32), 0.0)
    assert contact.sites.size == 0
    assert contact.displacement == 0
    assert "no load" in contact.notes[0]


def test_a_surface_that_is_no_sphere_is_refused():
    flat = Surface(heights=np.zeros((8, 8)), pixel_size=1.0)
    with pytest.raises(InputError, match=r"provenance\['radius'\] = None.*'sphere'.*'fft-bem'"):
        Hertz(modulus=35.3).solve(flat, 1.0)
    odd = Surface(heights=np.zeros((8, 8)), pixel_size=1.0, provenance={"radius": -3.0})
    with pytest.raises(InputError, match="needs a sphere"):
        Hertz(modulus=35.3).solve(odd, 1.0)


def test_a_contact_larger_than_the_grid_is_refused():
    with pytest.raises(InputError, match="more pixels or a smaller load"):
        Hertz(modulus=35.3).solve(tip(32), 1e4)
