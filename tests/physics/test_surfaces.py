"""Surfaces against Eq. 1 of Li, Pastewka & Szlufarska (2018) and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

import chemage as ca


def rough(pixels, **options):
    options = {"pixel_size": 0.5, "hurst": 0.8, "zeta": 30, "eta": 4, "rms_slope": 0.1} | options
    return ca.surface("self-affine", pixels=pixels, **options)


def full_spectrum(surface):
    """|q| (1/nm), the angle of q, and |h_q|² (nm²) of every mode, one of each conjugate pair."""
    nx, ny = surface.shape
    power = np.abs(np.fft.fft2(surface.heights)) ** 2 / surface.heights.size**2
    qx = 2 * np.pi * np.fft.fftfreq(nx, surface.pixel_size)[:, None]
    qy = 2 * np.pi * np.fft.fftfreq(ny, surface.pixel_size)[None, :]
    once = (qy > 0) | ((qy == 0) & (qx > 0)) | np.zeros((nx, ny), dtype=bool)
    return np.hypot(qx, qy)[once], np.broadcast_to(np.arctan2(qy, qx), (nx, ny))[once], power[once]


def equation_1(q, q_long, hurst, zeta, eta):
    density = np.maximum(q / q_long, eta) ** (-2 - 2 * hurst)
    return np.where((q < q_long * (1 - 1e-9)) | (q > zeta * q_long * (1 + 1e-9)), 0.0, density)


@pytest.mark.parametrize(
    ("pixels", "hurst", "zeta", "eta"),
    [(128, 0.8, 40, 4), (128, 0.3, 64, 1), (97, 0.5, 30, 10), ([96, 160], 0.8, 50, 3), ([150, 64], 1.0, 20, 5)],
)
def test_mean_power_of_every_ring_follows_equation_1(pixels, hurst, zeta, eta):
    maker = rough(pixels, hurst=hurst, zeta=zeta, eta=eta)
    seeds = 40
    spectra = [full_spectrum(maker.make(seed)) for seed in range(seeds)]
    q = spectra[0][0]
    power = np.mean([power for _, _, power in spectra], axis=0)
    q_long = 2 * np.pi / (max(maker.pixels) * maker.pixel_size)
    expected = equation_1(q, q_long, hurst, zeta, eta)
    assert np.all(power[expected == 0] < 1e-20 * power.max())
    # the prescribed slope fixes the prefactor; 2 because each mode stands for its conjugate too
    expected *= 0.1**2 / (2 * np.sum(expected * q**2))
    inside = expected > 0
    ring = np.rint(q / q_long).astype(int)[inside]
    # |h_q|² of a mode is exponentially distributed: the mean of n of them has relative scatter 1/√n
    modes = np.bincount(ring)
    ratio = np.bincount(ring, power[inside] / expected[inside])
    z = (ratio[modes > 0] / modes[modes > 0] - 1) * np.sqrt(modes[modes > 0] * seeds)
    assert np.max(np.abs(z)) < 4.5
    assert stats.chi2.sf(np.sum(z**2), z.size) > 1e-4


@pytest.mark.long
def test_waves_at_the_nyquist_limit_carry_their_share():
    # a flat spectrum up to the limit: the standing waves (8, 0) and (0, 8) as much as any travelling one
    maker = rough(16, zeta=8, eta=8)
    power = np.mean([np.abs(np.fft.fft2(maker.make(seed).heights)) ** 2 for seed in range(1200)], axis=0)
    typical = np.mean(power[1:5, 1:5])
    np.testing.assert_allclose([power[8, 0] / typical, power[0, 8] / typical], 1, atol=4 * math.sqrt(2 / 1200))


def test_power_is_the_same_in_every_direction():
    moments = []
    for seed in range(40):
        q, angle, power = full_spectrum(rough(96, zeta=45, eta=8).make(seed))
        weight = power * q**2
        moments.append([np.sum(weight * np.cos(m * angle)) / np.sum(weight) for m in (2, 4)])
    mean, error = np.mean(moments, axis=0), stats.sem(moments, axis=0)
    assert np.all(np.abs(mean) < 4 * error)
    assert np.all(error < 0.02)


def test_heights_are_gaussian():
    maker = rough(48, zeta=20, eta=12, rms_slope=None, rms_height=2.0)
    # points a third of the grid apart, four roll-off wavelengths: independent
    heights = np.array([maker.make(seed).heights[::16, ::16] for seed in range(250)]).ravel()
    assert stats.kstest(heights, "norm", args=(0, 2.0)).pvalue > 1e-3
    assert abs(stats.kurtosis(heights)) < 4 * math.sqrt(24 / heights.size)


@pytest.mark.parametrize("pixels", [64, 63, [64, 31], [31, 64]])
def test_rms_slope_is_met_exactly(pixels):
    surface = rough(pixels, rms_slope=0.37, zeta=20).make(3)
    q, _, power = full_spectrum(surface)
    assert surface.rms_slope == pytest.approx(0.37, rel=1e-12)
    assert math.sqrt(2 * np.sum(q**2 * power)) == pytest.approx(0.37, rel=1e-12)


def test_rms_height_is_met_exactly():
    surface = rough(64, rms_slope=None, rms_height="3 angstrom").make(3)
    assert surface.rms_height == pytest.approx(0.3, rel=1e-12)
    assert surface.heights.mean() == pytest.approx(0.0, abs=1e-15)


def test_spectral_slope_is_the_slope_of_the_resolved_surface():
    fine = rough(1024, pixel_size=0.5 / 16, zeta=20).make(3)
    x, y = (np.roll(fine.heights, -1, axis) - np.roll(fine.heights, 1, axis) for axis in (0, 1))
    assert math.sqrt(np.mean(x**2 + y**2)) / (2 * fine.pixel_size) == pytest.approx(0.1, rel=5e-3)


@pytest.mark.parametrize(("pixels", "factor"), [(64, 2), ([48, 64], 3), (63, 2)])
def test_a_finer_grid_samples_the_same_surface(pixels, factor):
    # the zeta = 20 surface is resolved on both grids
    coarse = rough(pixels, pixel_size=0.6, zeta=20).make(11)
    finer = rough((np.array(coarse.shape) * factor).tolist(), pixel_size=0.6 / factor, zeta=20).make(11)
    np.testing.assert_allclose(finer.heights[::factor, ::factor], coarse.heights, rtol=0, atol=1e-12)


def test_a_larger_cutoff_only_adds_shorter_waves():
    long_waves = np.fft.fft2(rough(64, zeta=8, eta=2).make(5).heights)
    more_waves = np.fft.fft2(rough(64, zeta=24, eta=2).make(5).heights)
    k = np.fft.fftfreq(64, 1 / 64)
    kept = np.hypot(k[:, None], k[None, :]) <= 8
    kept[0, 0] = False
    ratio = more_waves[kept] / long_waves[kept]
    np.testing.assert_allclose(ratio, ratio[0].real, rtol=1e-9)


# -- the measures -----------------------------------------------------------------------------------------------------


def test_slope_and_height_of_a_cosine():
    x = np.arange(90) * 0.4
    q = 2 * np.pi * 5 / (90 * 0.4)
    surface = ca.Surface(heights=np.repeat(2.5 * np.cos(q * x)[:, None], 7, axis=1), pixel_size=0.4)
    assert surface.rms_height == pytest.approx(2.5 / math.sqrt(2), rel=1e-12)
    assert surface.rms_slope == pytest.approx(2.5 * q / math.sqrt(2), rel=1e-12)


def test_slope_of_a_tilted_plane_that_is_not_periodic():
    x, y = np.meshgrid(np.arange(12) * 0.3, np.arange(9) * 0.3, indexing="ij")
    surface = ca.Surface(heights=0.3 * x - 0.4 * y + 1e5, pixel_size=0.3, periodic=False)
    assert surface.rms_slope == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("shape", [(128, 128), (96, 201)])
def test_power_spectral_density_of_white_noise_is_variance_times_pixel_area(shape, periodic):
    noise = np.random.default_rng(4)
    spectra = [
        ca.Surface(heights=noise.standard_normal(shape) * 0.7 + 50.0, pixel_size=0.4, periodic=periodic).psd(bins=12)
        for _ in range(80)
    ]
    q, density = np.mean(spectra, axis=0)
    fine = q > q.max() / 6  # hundreds of modes a bin
    np.testing.assert_allclose(density[fine], 0.7**2 * 0.4**2, rtol=0.04)
    assert q.max() <= math.sqrt(2) * math.pi / 0.4


def test_power_spectral_density_of_a_wave_integrates_to_its_mean_square():
    # one wave on a square grid: bin means times the bin's modes, d²q/(2π)² = 1/A0 each
    x = np.arange(64)
    surface = ca.Surface(heights=np.repeat(np.cos(2 * np.pi * 9 / 64 * x)[:, None], 64, axis=1), pixel_size=1.0)
    q, density = surface.psd(bins=40)
    peak = int(np.argmax(density))
    edges = np.geomspace(2 * np.pi / 64, math.sqrt(2) * np.pi, 41)
    k = 2 * np.pi * np.fft.fftfreq(64)
    modes = np.hypot(k[:, None], k[None, :])
    around = edges[np.searchsorted(edges, 2 * np.pi * 9 / 64) - 1 :][:2]
    inside = np.count_nonzero((modes >= around[0]) & (modes < around[1]))
    assert q[peak] == pytest.approx(2 * np.pi * 9 / 64, rel=0.06)
    assert density[peak] * inside / 64**2 == pytest.approx(0.5, rel=1e-9)


def test_power_spectral_density_of_a_patch_is_that_of_the_whole():
    wholes = [rough(256, zeta=100, eta=15).make(seed) for seed in range(20)]
    patches = [ca.Surface(heights=one.heights[:128, 60:188], pixel_size=0.5, periodic=False) for one in wholes]
    q, density = np.mean([one.psd(bins=60) for one in wholes], axis=0)
    q_patch, density_patch = np.mean([one.psd(bins=60) for one in patches], axis=0)
    # above the roll-off, below the cut-off
    q_long = 2 * np.pi / 128
    inside = (q > 25 * q_long) & (q < 90 * q_long)
    assert np.count_nonzero(inside) > 10
    at = np.exp(np.interp(np.log(q[inside]), np.log(q_patch), np.log(density_patch)))
    np.testing.assert_allclose(at, density[inside], rtol=0.1)


# -- the sphere -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pixels", [32, 33, [16, 41]])
def test_sphere_is_the_paraboloid_of_its_radius(pixels):
    tip = ca.surface("sphere", radius="30 nm", pixels=pixels, pixel_size=0.25).make()
    for axis in (0, 1):
        np.testing.assert_allclose(np.diff(tip.heights, 2, axis=axis) / 0.25**2, -1 / 30.0, rtol=1e-9)
    np.testing.assert_array_equal(tip.heights, tip.heights[::-1])
    np.testing.assert_array_equal(tip.heights, tip.heights[:, ::-1])
    x, y = (0.25 * (np.arange(n) - (n - 1) / 2) for n in tip.shape)
    r = np.hypot(x[:, None], y[None, :])
    sphere = np.sqrt(30.0**2 - r**2) - 30.0
    # the two part by r²/(4R²) of the depth to leading order
    np.testing.assert_allclose(tip.heights, sphere, rtol=1.2 * r.max() ** 2 / (4 * 30.0**2), atol=1e-12)
    assert tip.heights.max() <= 0
    assert not tip.periodic
    assert tip.provenance["radius"] == 30.0


def test_apex_of_an_odd_grid_is_a_pixel_at_height_zero():
    tip = ca.surface("sphere", radius=30, pixels=9, pixel_size=0.5).make()
    assert tip.heights[4, 4] == 0
    assert np.count_nonzero(tip.heights == 0) == 1
