"""Surfaces at the ends of what numbers and grids can be."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chemage as ca

ROUGH = {"pixels": 32, "pixel_size": 0.5, "hurst": 0.8, "zeta": 16, "eta": 2, "rms_slope": 0.1}


def rough(**options):
    return ca.surface("self-affine", **ROUGH | options)


@pytest.mark.parametrize("pixels", [2, [1, 2], [2, 1], [1, 17], [17, 1], [2, 3], [3, 101], [101, 103]])
def test_small_thin_and_prime_grids_meet_their_slope(pixels):
    surface = rough(pixels=pixels, zeta=1, eta=1).make(4)
    assert surface.rms_slope == pytest.approx(0.1, rel=1e-12)
    assert np.all(np.isfinite(surface.heights))


@pytest.mark.parametrize("pixels", [32, 33])
def test_cutoff_exactly_at_nyquist_is_allowed(pixels):
    assert rough(pixels=pixels, zeta=pixels / 2).make(4).rms_slope == pytest.approx(0.1, rel=1e-12)


def test_a_single_wavelength_is_allowed():
    # zeta = eta = 1: only the four waves of length λ_L
    surface = rough(zeta=1, eta=1).make(4)
    spectrum = np.abs(np.fft.fft2(surface.heights))
    assert np.count_nonzero(spectrum > 1e-10 * spectrum.max()) == 4
    assert surface.rms_height == pytest.approx(0.1 * 16 / (2 * math.pi), rel=1e-12)


@pytest.mark.parametrize("hurst", [0, 1])
def test_ends_of_the_hurst_range(hurst):
    assert rough(hurst=hurst).make(4).rms_slope == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e300])
def test_measures_of_tiny_and_huge_heights_neither_overflow_nor_vanish(scale):
    plain = rough().make(4)
    scaled = ca.Surface(heights=plain.heights * scale, pixel_size=0.5)
    assert scaled.rms_height == pytest.approx(plain.rms_height * scale, rel=1e-12)
    assert scaled.rms_slope == pytest.approx(0.1 * scale, rel=1e-12)
    open_ended = ca.Surface(heights=plain.heights * scale, pixel_size=0.5, periodic=False)
    still = ca.Surface(heights=plain.heights, pixel_size=0.5, periodic=False)
    assert open_ended.rms_slope == pytest.approx(still.rms_slope * scale, rel=1e-12)


def test_a_mean_height_far_above_the_roughness_changes_nothing():
    plain = rough().make(4)
    lifted = ca.Surface(heights=plain.heights + 1e6, pixel_size=0.5)
    assert lifted.rms_height == pytest.approx(plain.rms_height, rel=1e-8)
    assert lifted.rms_slope == pytest.approx(0.1, rel=1e-8)
    np.testing.assert_allclose(lifted.psd()[1][:5], plain.psd()[1][:5], rtol=1e-6)


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (4, 1), (3, 3)])
def test_flat_surfaces_have_no_roughness(shape, periodic):
    for level in (0.0, 7.0, -1e300):
        flat = ca.Surface(heights=np.full(shape, level), pixel_size=0.5, periodic=periodic)
        assert (flat.rms_height, flat.rms_slope) == (0, 0)
        assert not flat.psd()[1].any()


def test_zero_slope_is_a_flat_surface():
    assert not rough(rms_slope=0).make(1).heights.any()


def test_wide_and_narrow_spectra_of_the_largest_ratio():
    surface = rough(pixels=[4096, 2], zeta=2048, eta=1, hurst=1).make(0)
    assert surface.rms_slope == pytest.approx(0.1, rel=1e-10)


@pytest.mark.parametrize("pixels", [1, [1, 7], [2, 2], 3])
def test_a_sphere_on_few_pixels(pixels):
    tip = ca.surface("sphere", radius="30 nm", pixels=pixels, pixel_size="0.4518 nm").make()
    assert tip.heights.shape == ((pixels, pixels) if isinstance(pixels, int) else tuple(pixels))
    assert np.all(tip.heights <= 0)


@pytest.mark.parametrize("radius", [1e-3, 1e12])
def test_spheres_much_smaller_or_larger_than_the_grid(radius):
    tip = ca.surface("sphere", radius=radius, pixels=65, pixel_size=0.5).make()
    np.testing.assert_allclose(np.diff(tip.heights, 2, axis=0), -0.25 / radius, rtol=1e-9)
