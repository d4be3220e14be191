"""The area in the limit of vanishing pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from grid_errors import vanishing_pixels

import chemage as ca


def disc(pixels: int, radius: float, shift: tuple[float, float] = (0.0, 0.0)) -> ca.ContactSolution:
    """A disc in a square of 10 nm, of the pixels whose centre lies in it."""
    x, y = ((np.arange(pixels) + 0.5) * 10 / pixels - 5 - offset for offset in shift)
    pressure = (np.hypot(x[:, None], y) < radius).astype(float)
    return ca.ContactSolution(
        pressure=pressure, load=1.0, pixel_size=10 / pixels, modulus=35.3, periodic=False, contact_pixels="centres"
    )


def test_two_grids_are_extrapolated_to_first_order():
    coarse, fine = disc(20, 3.3), disc(40, 3.3)
    limit = vanishing_pixels([coarse, fine])
    assert limit is not None
    assert limit.area == pytest.approx(2 * fine.corrected_area - coarse.corrected_area, rel=1e-12)
    sigma = [math.sqrt(one.pixel_size**3 * one.perimeter / 12) for one in (coarse, fine)]
    assert limit.area_stderr == pytest.approx(math.hypot(sigma[0], 2 * sigma[1]), rel=1e-12)


def test_three_grids_are_a_weighted_fit():
    found = [disc(pixels, 3.3) for pixels in (16, 32, 64)]
    limit = vanishing_pixels(found)
    assert limit is not None
    sigma = np.array([math.sqrt(one.pixel_size**3 * one.perimeter / 12) for one in found])
    areas = np.array([one.area for one in found])
    (_, area), covariance = np.polyfit([one.pixel_size for one in found], areas, 1, w=1 / sigma, cov="unscaled")
    assert limit.area == pytest.approx(area, rel=1e-9)
    assert limit.area_stderr == pytest.approx(math.sqrt(covariance[1, 1]), rel=1e-9)


def test_discs_lie_within_the_standard_error():
    """Discs at random places, whose area is known: the standard error is right, if anything too large."""
    rng = np.random.default_rng(3)
    away = []
    for _ in range(300):
        radius, shift = rng.uniform(2.0, 3.5), tuple(rng.uniform(-0.5, 0.5, 2))
        limit = vanishing_pixels([disc(pixels, radius, shift) for pixels in (24, 48, 96)])
        assert limit is not None
        away.append((limit.area - math.pi * radius**2) / limit.area_stderr)
    assert abs(np.mean(away)) < 0.15
    assert 0.3 < np.std(away) < 1.0


def test_what_cannot_be_extrapolated_is_not():
    whole = ca.ContactSolution(pressure=np.ones((8, 8)), load=64.0, pixel_size=1.0, modulus=35.3)
    finer = ca.ContactSolution(pressure=np.ones((16, 16)), load=64.0, pixel_size=0.5, modulus=35.3)
    assert vanishing_pixels([disc(20, 3.0)]) is None
    assert vanishing_pixels([disc(20, 3.0), disc(20, 3.0)]) is None
    assert vanishing_pixels([whole, finer]) is None
    assert vanishing_pixels([]) is None
