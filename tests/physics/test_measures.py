"""What is measured on surfaces and contacts, against closed forms and the literature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf

from chemage import surface
from chemage.plugin import patches, roughness, theory


def cosine(shape, i, j, amplitude=1.0, phase=0.3):
    x, y = np.meshgrid(np.arange(shape[0]) / shape[0], np.arange(shape[1]) / shape[1], indexing="ij")
    return amplitude * np.cos(2 * np.pi * (i * x + j * y) + phase)


# -- surfaces ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(32, 32), (31, 17), (24, 9), (2, 16), (1, 9)])
def test_slope_of_a_cosine_is_its_wavenumber_times_its_height(shape):
    pixel = 0.45
    for i, j in ((1, 0), (0, 1), (3, -2), (0, 4), (5, 3)):
        if abs(i) > (shape[0] - 1) // 2 or abs(j) > (shape[1] - 1) // 2:
            continue  # too short a wave for this grid
        heights = 7.0 + cosine(shape, i, j, amplitude=2.0)
        wavenumber = 2 * np.pi * math.hypot(i / shape[0], j / shape[1]) / pixel
        assert roughness.rms_height(heights) == pytest.approx(math.sqrt(2), rel=1e-12)
        assert roughness.rms_slope(heights, pixel) == pytest.approx(math.sqrt(2) * wavenumber, rel=1e-12)


def test_slopes_of_orthogonal_waves_add_in_squares():
    one, two = cosine((40, 30), 3, 1), cosine((40, 30), 2, -5, amplitude=0.4)
    together = roughness.rms_slope(one + two, 0.5)
    assert together == pytest.approx(
        math.hypot(roughness.rms_slope(one, 0.5), roughness.rms_slope(two, 0.5)), rel=1e-12
    )


def test_free_slope_of_a_plane_and_of_a_paraboloid():
    x, y = np.meshgrid(np.arange(50) * 0.2, np.arange(30) * 0.2, indexing="ij")
    assert roughness.rms_slope(3 * x - 4 * y, 0.2, periodic=False) == pytest.approx(5.0, rel=1e-12)
    x, y = x - x.mean(), y - y.mean()
    radius = 40.0
    expected = math.sqrt(np.mean(x**2 + y**2)) / radius
    assert roughness.rms_slope(-(x**2 + y**2) / (2 * radius), 0.2, periodic=False) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("pixels_per_wave", "within"), [(2.05, 0.03), (2.2, 0.02), (2.5, 0.01), (8.0, 0.005)])
@pytest.mark.parametrize("angle", [0.1, 0.4, 0.9])
def test_free_slope_of_short_waves(pixels_per_wave, within, angle):
    """A wave on a slope, oblique to the grid and cut off by its edges at every phase: its derivative is known."""
    k = 2 * np.pi / pixels_per_wave
    kx, ky = k * math.cos(angle), k * math.sin(angle)
    x, y = np.meshgrid(np.arange(72.0), np.arange(90.0), indexing="ij")
    phase = kx * x + ky * y + 0.7
    exact = math.sqrt(np.mean((0.3 - kx * np.sin(phase)) ** 2 + (ky * np.sin(phase)) ** 2))
    heights = 0.3 * x + np.cos(phase)
    assert roughness.rms_slope(0.5 * heights, 0.5, periodic=False) == pytest.approx(exact, rel=within)


@pytest.mark.parametrize(("hurst", "zeta"), [(0.8, 128), (0.3, 128), (0.8, 32)])
def test_slope_of_a_part_is_that_of_the_whole_there(hurst, zeta):
    """Parts of periodic surfaces, whose spectrum ends at two pixels and at eight; 11 surfaces each."""
    maker = surface("self-affine", pixels=256, pixel_size=1.0, rms_slope=0.1, hurst=hurst, zeta=zeta, eta=2)
    q = 2j * np.pi * np.fft.fftfreq(256)
    off = []
    for seed in range(11):
        heights = maker.make(seed).heights
        waves = np.fft.fft2(heights)
        squared = np.fft.ifft2(q[:, None] * waves).real ** 2 + np.fft.ifft2(q * waves).real ** 2
        part = np.s_[10:90, 30:126]
        exact = math.sqrt(squared[part].mean())
        off.append(roughness.rms_slope(heights[part], 1.0, periodic=False) / exact - 1)
    assert abs(np.mean(off)) < 0.005
    assert np.abs(off).max() < 0.015


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_neither_scale_nor_offset_spoils_a_slope(scale, offset):
    heights = np.random.default_rng(1).standard_normal((16, 20))
    plain = roughness.rms_slope(heights, 1.0)
    assert roughness.rms_slope((heights + offset) * scale, 1.0) == pytest.approx(plain * scale, rel=1e-9)
    assert roughness.rms_height((heights + offset) * scale) == pytest.approx(np.std(heights) * scale, rel=1e-9)


@pytest.mark.parametrize("shape", [(64, 64), (33, 21), (40, 7)])
def test_the_spectrum_adds_up_to_the_variance(shape):
    """<h²> = ∫ C d²q/(2π)²: with one bin the mean of C times the area of the spectrum."""
    heights = np.random.default_rng(2).standard_normal(shape)
    pixel = 0.3
    _, c = roughness.psd(heights, pixel, bins=1)
    cells = heights.size - 1  # every wave vector but zero
    area = (2 * np.pi) ** 2 / (heights.size * pixel**2)
    assert c[0] * cells * area / (2 * np.pi) ** 2 == pytest.approx(np.var(heights), rel=1e-12)


def test_white_noise_has_a_flat_spectrum():
    heights = np.random.default_rng(3).standard_normal((256, 256))
    q, c = roughness.psd(heights, 0.5, bins=12)
    expected = np.var(heights) * 0.5**2
    # averages over n modes of an exponential distribution scatter by 1/sqrt(n); the long waves are few
    assert np.allclose(c[-5:], expected, rtol=0.05)
    assert c[0] == pytest.approx(expected, rel=1.0)
    assert q[0] >= 2 * np.pi / 128 * (1 - 1e-9)


def test_a_single_wave_is_a_single_peak_at_its_wavenumber():
    q, c = roughness.psd(cosine((128, 128), 8, 0), 0.5, bins=40)
    peak = np.argmax(c)
    assert q[peak] == pytest.approx(2 * np.pi * 8 / 64, rel=0.15)
    assert c[peak] > 1e20 * np.median(c)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 2), (3, 1)])
def test_spectra_of_the_smallest_surfaces_do_not_fail(shape):
    for periodic in (True, False):
        q, c = roughness.psd(np.arange(float(math.prod(shape))).reshape(shape), 1.0, periodic)
        assert q.shape == c.shape
        assert np.isfinite(c).all()


# -- contacts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [20.0, 45.5])
def test_the_perimeter_of_a_disc_of_pixels_is_that_of_its_bounding_square(radius):
    x = np.arange(128) - 63.7
    disc = x[:, None] ** 2 + x**2 < radius**2
    assert patches.perimeter(disc, 1.0, False) == pytest.approx(8 * radius, rel=0.03)
    assert patches.patches(disc, False).count == 1


def test_corrected_area_is_yastrebovs():
    """A − (π − 1 + ln 2)/24 · C · a, J. Mech. Phys. Solids 107, 469 (2017), eq. 10: about 0.118 of a pixel per edge."""
    assert patches.corrected_area(100.0, 40.0, 0.5) == pytest.approx(100 - 0.118117 * 40 * 0.5, rel=1e-4)
    assert patches.corrected_area(100.0, 0.0, 0.5) == 100.0


def test_the_correction_brings_circles_covered_by_pixels_nearer_to_their_area():
    """Pixels that a circle touches count as contact in a numerical solution; the excess is at the rim."""
    rng = np.random.default_rng(4)
    n, radius = 64, 22.0
    edges = np.arange(n + 1)
    raw, corrected = [], []
    for _ in range(50):
        cx, cy = rng.uniform(31, 33, 2)
        # the point of each pixel that is nearest to the centre
        nearest_x = np.clip(cx, edges[:-1], edges[1:]) - cx
        nearest_y = np.clip(cy, edges[:-1], edges[1:]) - cy
        touched = nearest_x[:, None] ** 2 + nearest_y[None, :] ** 2 < radius**2
        area = float(touched.sum())
        raw.append(area - math.pi * radius**2)
        corrected.append(
            patches.corrected_area(area, patches.perimeter(touched, 1.0, False), 1.0) - math.pi * radius**2
        )
    assert 0 < np.mean(corrected) < 0.85 * np.mean(raw)


@pytest.mark.parametrize("x", [1e-6, 1e-3, 0.05, 0.3, 1.0, 4.0])
def test_perssons_pressures_add_up_to_his_contact_fraction_and_to_the_load(x):
    modulus, slope = 35.3, 0.1
    mean = x * modulus * slope
    sigma = modulus * slope / 2
    top = mean + 40 * sigma

    def density(p):
        return theory.persson_pressure_density(np.array(p), mean, modulus, slope)

    fraction, _ = quad(density, 0, top, points=[mean], limit=200, epsabs=0, epsrel=1e-10)
    force, _ = quad(lambda p: p * density(p), 0, top, points=[mean], limit=200, epsabs=0, epsrel=1e-10)
    assert fraction == pytest.approx(erf(math.sqrt(2) * x), rel=1e-8)
    assert fraction == pytest.approx(float(theory.persson_area_fraction(x)), rel=1e-8)
    assert force == pytest.approx(mean, rel=1e-8)


def test_full_contact_is_reached_by_persson_and_not_by_bgt():
    assert theory.persson_area_fraction(10.0) == 1.0
    assert theory.bgt_area_fraction(1.0) > 1


def test_at_light_load_the_area_is_proportional_to_it():
    """κ = A h'_rms E*/F is sqrt(8/π) = 1.596 for Persson, sqrt(2π) = 2.507 for Bush, Gibson and Thomas."""
    x = np.array([1e-8, 1e-6])
    assert np.allclose(theory.persson_area_fraction(x) / x, math.sqrt(8 / math.pi), rtol=1e-9)
    assert np.allclose(theory.bgt_area_fraction(x) / x, math.sqrt(2 * math.pi), rtol=1e-14)
    assert theory.persson_area_fraction(1e-6) / 1e-6 == pytest.approx(1.596, abs=5e-4)
    assert theory.bgt_area_fraction(1e-6) / 1e-6 == pytest.approx(2.507, abs=5e-4)


def test_perssons_density_at_vanishing_load_keeps_its_digits():
    """Small mean pressures make the difference of the two Gaussians cancel; the product does not."""
    p = np.linspace(0.1, 8, 30)
    mean, sigma = 1e-12, 35.3 * 0.1 / 2
    expected = 2 * p * mean / sigma**2 * np.exp(-0.5 * (p / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
    assert np.allclose(theory.persson_pressure_density(p, mean, 35.3, 0.1), expected, rtol=1e-10)
    assert theory.persson_pressure_density(np.array(0.0), 0.5, 35.3, 0.1) == 0
