"""Measures of images as instruments give them: closed forms, gaps, oblong pixels, tips, noise, several images."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from instrument_files import gwy

import chemage as ca
from chemage import InputError, Surface
from chemage_surfaces import fit_roughness
from chemage_surfaces._maps import opposite
from chemage_surfaces.measures import Measures
from chemage_surfaces.spectra import Binned
from chemage_surfaces.steps import find_scars, line_offsets, trend
from chemage_surfaces.trusted import noise_between

FILES = Path(__file__).parents[1] / "data" / "topographies"
RANDOM = np.random.default_rng(4)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def dilated(heights, side, radius):
    """The image that a paraboloid of ``radius`` takes of periodic heights: the maximum of its touching positions."""
    reach = min(math.ceil(math.sqrt(2 * radius * np.ptp(heights)) / side), len(heights) // 4)
    for axis in (0, 1):
        shifted = [np.roll(heights, k, axis) - (k * side) ** 2 / (2 * radius) for k in range(-reach, reach + 1)]
        heights = np.max(shifted, axis=0)
    return heights


# -- measures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gaps", [False, True])
def test_a_tilted_parabola_on_oblong_pixels_has_its_slopes_and_curvatures(gaps):
    x, y = np.meshgrid(2.0 * np.arange(40), 5.0 * np.arange(24), indexing="ij")
    heights = 0.3 * x - 0.1 * y
    curved = heights + 0.01 * x**2 * np.sign(y - 57.5)
    if gaps:
        curved[RANDOM.random(curved.shape) < 0.3] = np.nan
    found = Measures.of(curved, (2.0, 5.0))
    assert found.missing == np.isnan(curved).sum()
    # ± half of the area each
    np.testing.assert_allclose(found.x.curvature, 0.02, rtol=0.1 if gaps else 1e-9)
    plane = Measures.of(np.where(np.isnan(curved), np.nan, heights), (2.0, 5.0))
    np.testing.assert_allclose(plane.x.slope, 0.3, rtol=1e-12)
    np.testing.assert_allclose(plane.y.slope, 0.1, rtol=1e-12)
    np.testing.assert_allclose(plane.y.difference, 0.1 * plane.y.distance, rtol=1e-12)
    np.testing.assert_allclose(plane.x.curvature, 0, atol=1e-12)


def test_a_wave_has_its_height_difference_function():
    side, length = 0.5, 32
    x = np.arange(16 * length)[:, None] * side
    heights = np.broadcast_to(3 * np.sin(2 * np.pi * x / (length * side)), (16 * length, 8))
    found = Measures.of(heights, (side, side))
    assert found.rms_height == pytest.approx(3 / math.sqrt(2))
    # whole periods of pairs at distances of at most a period
    few = found.x.distance <= length * side / 4
    expected = 3 * math.sqrt(2) * np.abs(np.sin(np.pi * found.x.distance / (length * side)))
    np.testing.assert_allclose(found.x.difference[few], expected[few], rtol=0.02)
    assert (found.y.difference < 1e-12).all()


@pytest.mark.parametrize("scale", [1e-250, 1.0, 1e250])
def test_measures_know_no_unit_and_no_level(scale):
    heights = RANDOM.standard_normal((32, 32))
    found, plain = Measures.of(scale * (heights + 1e3), (1.0, 1.0)), Measures.of(heights, (1.0, 1.0))
    assert found.rms_height / scale == pytest.approx(plain.rms_height, rel=1e-9)
    np.testing.assert_allclose(found.x.curvature / scale, plain.x.curvature, rtol=1e-9)


def test_nothing_is_measured_of_nothing():
    with pytest.raises(InputError, match="all of them are missing"):
        Measures.of(np.full((5, 5), np.nan), (1.0, 1.0))
    one = Measures.of(np.array([[1.0, 2.0, np.nan]]), (1.0, 1.0))
    assert one.rms_height == 0.5
    assert "not available and 1" in one.text()


# -- artefacts ---------------------------------------------------------------------------------------------------------


def test_a_trend_with_gaps_is_that_of_the_heights_that_are_there():
    x, y = np.indices((20, 15)) / 10
    heights = 1 + 2 * x - y + 0.5 * x * y - x**2
    gaps = RANDOM.random(heights.shape) < 0.4
    np.testing.assert_allclose(trend(np.where(gaps, np.nan, heights), 2), heights, atol=1e-12)


@pytest.mark.parametrize("degree", [None, 0, 1, 2])
def test_lines_are_aligned_in_spite_of_a_feature_on_them(degree):
    offsets = RANDOM.standard_normal(40)
    x = np.linspace(-1, 1, 60)[:, None]
    lines = np.broadcast_to(offsets[None, :] * (1 if not degree else (1 + x + x**degree)), (60, 40))
    ripple = 0.01 * np.sin(40 * x)
    feature = np.zeros((60, 40))
    feature[10:28, 12:20] = 50.0
    holed = lines + ripple + feature
    holed[40:50, 30] = np.nan
    rest = holed - line_offsets(holed, degree) - feature
    rest = rest - np.nanmean(rest)
    if degree is None:
        # a level of the whole image is left, but none from line to line
        assert np.nanmax(np.abs(np.diff(rest - ripple, axis=1))) < 1e-9
    else:
        assert np.nanmax(np.abs(rest)) < 0.1


def test_scars_are_found_and_the_surface_is_not():
    surface = ca.surface("self-affine", pixels=128, pixel_size=1.0, rms_slope=0.2, hurst=0.8, zeta=32).make(1).heights
    assert not find_scars(surface).any()
    scarred = surface.copy()
    marked = np.zeros(surface.shape, bool)
    for place, sign in (((slice(20, 60), slice(30, 31)), 1), ((slice(70, 100), slice(80, 82)), -1)):
        scarred[place] += sign * 8 * surface.std()
        marked[place] = True
    found = find_scars(scarred)
    assert (found & marked).sum() > 0.9 * marked.sum()
    assert (found & ~marked).sum() < 0.05 * marked.sum()
    np.save("scars.npy", scarred)
    options = {"path": "scars.npy", "height_unit": "nm", "pixel_size": 1.0}
    clean = ca.surface("measured", **options, scars="interpolate").make()
    assert [step["step"] for step in clean.provenance["steps"]] == ["read", "scars", "missing"][:2]
    assert np.std(clean.heights - surface) < 0.05 * np.std(scarred - surface)


def test_offset_lines_do_not_change_the_fit():
    surface = ca.surface("self-affine", pixels=256, pixel_size=1.0, rms_slope=0.2, hurst=0.8, zeta=128).make(3)
    plain = Surface(heights=surface.heights, pixel_size=1.0, periodic=False)
    offsets = surface.rms_height * RANDOM.standard_normal(256)
    shifted = Surface(heights=surface.heights + offsets, pixel_size=1.0, periodic=False)
    assert fit_roughness(shifted).hurst == pytest.approx(fit_roughness(plain).hurst, abs=0.02)


# -- tip and noise -----------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("radius", [8.0, pytest.param(20.0, marks=pytest.mark.campaign)])
def test_the_effect_of_a_tip_is_seen_corrected_and_stated(radius):
    true = ca.surface("self-affine", pixels=512, pixel_size=2.0, rms_slope=0.2, hurst=0.7, zeta=256).make(5)
    image = Surface(heights=dilated(true.heights, 2.0, radius), pixel_size=2.0)
    assert Measures.of(true.heights, (2.0, 2.0)).tip_radius() == 0
    fit = fit_roughness(image)
    assert fit.tip_radius == pytest.approx(radius, rel=0.5)
    assert fit.resolution > 4.0
    assert fit.limit == "the tip"
    assert fit.hurst == pytest.approx(0.7, abs=3 * fit.hurst_error + 0.01)
    assert "tip radius" in fit.text()
    # with all waves the fit would be far off
    assert fit_roughness(image, resolution="4 nm").hurst > 0.75
    known = fit_roughness(image, tip_radius=radius)
    assert known.hurst == pytest.approx(0.7, abs=0.05)
    with pytest.raises(InputError, match="above those changed by the tip of 1e\\+06 nm"):
        fit_roughness(image, tip_radius=1e6)
    with pytest.raises(InputError, match=r"tip_radius = -1: is no radius"):
        fit_roughness(image, tip_radius=-1)


def test_white_noise_is_found_and_subtracted():
    true = ca.surface("self-affine", pixels=256, pixel_size=1.0, rms_slope=0.1, hurst=0.8, zeta=128).make(5)
    noise = 0.05 * RANDOM.standard_normal((256, 256))
    fit = fit_roughness(Surface(heights=true.heights + noise, pixel_size=1.0))
    assert fit.noise == pytest.approx(0.05, rel=0.1)
    assert fit.limit == "noise"
    assert fit.hurst == pytest.approx(0.8, abs=0.06)
    assert fit_roughness(true).noise == 0


# -- several images, and the command -----------------------------------------------------------------------------------


@pytest.mark.long
def test_images_at_two_magnifications_make_one_spectrum():
    true = ca.surface("self-affine", pixels=1024, pixel_size=1.0, rms_slope=0.2, hurst=0.7, zeta=512, eta=8).make(2)
    near = Surface(heights=true.heights[100:356, 400:656], pixel_size=1.0, periodic=False)
    blocks = true.heights.reshape(256, 4, 256, 4).mean(axis=(1, 3))
    far = Surface(heights=blocks, pixel_size=4.0)
    both, alone = fit_roughness([near, far]), fit_roughness(far)
    assert both.resolution < alone.resolution / 2
    assert both.shape == (256, 256)
    assert both.pixel_size == 4.0
    assert both.hurst == pytest.approx(0.7, abs=0.05)
    assert both.roll_off == pytest.approx(128, rel=0.3)
    assert both.rms_slope == near.rms_slope
    with pytest.raises(InputError, match="empty list"):
        fit_roughness([])


def test_the_command_measures_what_makes_no_surface(command):
    image = RANDOM.standard_normal((40, 30))
    image[:20, :15] = np.nan
    np.save("gaps.npy", image)
    done = command("roughness", "gaps.npy", "--height-unit", "nm", "--pixel-size", "2 nm")
    assert done.status == 0, done.err
    assert "300 heights are missing" in done.out
    assert "profile slope" in done.out
    assert done.out.count("rms slope ") == 1
    assert "no fit: gaps.npy: 300 of 1200 heights are missing, the first at pixel (0, 0); give missing" in done.out


@pytest.mark.long
def test_the_command_fits_several_images_together_and_draws_them(command):
    true = ca.surface("self-affine", pixels=256, pixel_size=2.0, rms_slope=0.2, hurst=0.8, zeta=128).make(7).heights
    np.save("one.npy", true[:, :200] + RANDOM.standard_normal(200))
    np.save("two.npy", true[:128, :128])
    words = ["--height-unit", "nm", "--pixel-size", "2 nm", "--lines", "differences", "--figures", "drawn"]
    done = command("roughness", "one.npy", "two.npy", *words)
    assert done.status == 0, done.err
    assert done.out.count("profile curvature  ") == 2
    # one number of each image has the name of the rms slope: that of the gradient
    assert sum(line.startswith("rms slope ") for line in done.out.splitlines()) == 2
    assert "lines               lines differences, rms_nm" in done.out
    assert done.out.count("Hurst exponent") == 1
    assert Path("drawn/roughness.png").stat().st_size > 10_000
    assert command("roughness", "one.npy", "two.npy", *words).status != 0
    assert command("roughness", "one.npy", *words, "--force").status == 0


@pytest.mark.parametrize("name", ["afm.txt", "gwyddion-export-german.txt", "nc-1.nc"])
def test_files_of_instruments_are_measured(command, name):
    if name.endswith("nc"):
        pytest.importorskip("SurfaceTopography")
    done = command("roughness", FILES / name, "--spikes", "interpolate")
    assert done.status == 0, done.err
    assert "rms height" in done.out


# -- trace and retrace -------------------------------------------------------------------------------------------------


def scanned(seed, moved=2.3, noise=0.02):
    """Trace and retrace of one place (nm, pixels of 2 nm): the retrace is moved along the lines, each has noise of its
    own that is correlated over some pixels, and the scanner bows the two into opposite directions."""
    random = np.random.default_rng(seed)
    n, side = 256, 2.0
    q = np.hypot(2 * np.pi * np.fft.fftfreq(2 * n, side)[:, None], 2 * np.pi * np.fft.fftfreq(2 * n, side))
    q[0, 0] = np.inf
    amplitude = q**-1.8
    waves = np.fft.fft2(random.standard_normal((2 * n, 2 * n))) * amplitude
    shift = np.exp(-2j * np.pi * np.fft.fftfreq(2 * n) * moved)[:, None]
    trace, retrace = (np.fft.ifft2(waves * way).real[:n, :n] for way in (1, shift))
    scale = trace.std()
    smooth = np.exp(-np.minimum(np.arange(n), n - np.arange(n)) / 1.5)
    density = np.abs(np.fft.fft(smooth)) ** 2

    def errors():
        along = np.fft.fft(random.standard_normal((n, n)), axis=0) * np.sqrt(density)[:, None]
        one = np.fft.ifft(along, axis=0).real
        return noise * one / one.std()

    bow = 0.5 * ((np.arange(n) - n / 2) / n)[:, None] ** 2
    noises = [errors(), errors()]
    both = [trace / scale + bow + noises[0], retrace / scale - bow + noises[1]]
    return both, noises[0], side


def test_noise_is_the_difference_of_trace_and_retrace():
    found = []
    for seed in range(4):
        (trace, retrace), own, side = scanned(seed)
        one, other, alone = (Surface(heights=h, pixel_size=side, periodic=False) for h in (trace, retrace, own))
        difference = Binned.of(noise_between(one, other))
        found.append(difference.density / Binned.of(alone).density)
    ratio = np.mean(found, axis=0)
    short = 2 * np.pi / difference.q < 100
    # a ratio of two means over independent wave vectors
    assert np.all(np.abs(ratio - 1)[short] < 4 * np.sqrt(2 / (4 * difference.modes[short])) + 0.03)
    assert np.average(ratio[short], weights=difference.modes[short]) == pytest.approx(1, abs=0.03)


@pytest.mark.long
def test_noise_that_is_not_white_spoils_no_fit_where_the_retrace_is_there():
    away = {True: [], False: []}
    for seed in range(4):
        (trace, retrace), _, side = scanned(seed, noise=0.05)
        one, other = (Surface(heights=h, pixel_size=side, periodic=False) for h in (trace, retrace))
        for known in away:
            fit = fit_roughness(one, retraces=[other] if known else [])
            away[known].append((fit.hurst - 0.8) / fit.hurst_error)
            assert not known or fit.limit == "noise"
    assert np.abs(away[True]).max() < 3
    assert np.mean(np.abs(away[True])) < np.mean(np.abs(away[False]))


def test_a_retrace_of_another_place_is_refused():
    one, other = (Surface(heights=scanned(seed)[0][0], pixel_size=2.0, periodic=False) for seed in (1, 2))
    with pytest.raises(InputError, match="does not show what"):
        fit_roughness(one, retraces=[other])
    with pytest.raises(InputError, match="retraces: 1 for 2 images"):
        fit_roughness([one, other], retraces=[other])
    with pytest.raises(InputError, match="the other direction of the same scan"):
        fit_roughness(one, retraces=[Surface(heights=other.heights, pixel_size=1.0, periodic=False)])


@pytest.mark.long
def test_the_command_finds_trace_and_retrace_in_one_file(command):
    (trace, retrace), _, side = scanned(3)
    Path("both.gwy").write_bytes(
        gwy(1e-9 * trace, title="Z (Trace)", second=1e-9 * retrace, second_title="Z (Retrace)", side=side * 1e-9)
    )
    done = command("roughness", "both.gwy")
    assert done.status == 0, done.err
    assert "retrace             'Z (Retrace)': the difference is noise" in done.out
    assert "(noise)" in done.out
    without = command("roughness", "both.gwy", "--no-retrace")
    assert "retrace  " not in without.out


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("Scan forward (Z-Axis)", "Scan backward (Z-Axis)", True),
        ("Scan forward (Z-Axis)", "Scan backward (Z-AxisSensor)", False),
        ("HeightRetrace", "HeightTrace", True),
        ("Height trace", "Height trace", False),
        ("Z fwd", "Z bwd", True),
        ("Height (measured)", "Height (measured, retrace)", True),
        ("Height", "Height (retrace)", True),
        ("Height", "Height (measured, retrace)", False),
        ("Height#1", "Height#2", False),
    ],
)
def test_names_of_the_two_directions(one, other, same):
    assert opposite(one, other) is same
    assert opposite(other, one) is same


def test_the_rms_slope_is_the_rms_gradient_of_surfacetopography():
    library = pytest.importorskip("SurfaceTopography")
    heights = ca.surface("self-affine", pixels=64, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=32).make(1).heights
    part = heights[:50, :40]
    topography = library.Topography(part, (25.0, 20.0), unit="nm", periodic=False)
    assert Measures.of(part, (0.5, 0.5)).rms_slope == pytest.approx(topography.rms_gradient(), rel=1e-12)


def test_the_rms_slope_is_that_of_the_gradient_over_a_pixel():
    """Of h = a x + b y + c x y on oblong pixels, also around a missing height."""
    x, y = np.arange(6)[:, None] * 2.0, np.arange(5) * 0.5
    heights = 0.3 * x + 0.4 * y + 0.01 * x * y
    gradient = np.hypot(0.3 + 0.01 * y[:-1] + 0 * x[:-1], 0.4 + 0.01 * x[:-1] + 0 * y[:-1])
    assert Measures.of(heights, (2.0, 0.5)).rms_slope == pytest.approx(np.sqrt(np.mean(gradient**2)), rel=1e-12)
    heights[2, 2] = np.nan
    gone = np.zeros((5, 4), dtype=bool)
    gone[[2, 1, 2], [2, 2, 1]] = True
    found = Measures.of(heights, (2.0, 0.5)).rms_slope
    assert found == pytest.approx(np.sqrt(np.mean(gradient[~gone] ** 2)), rel=1e-12)


def test_a_length_without_a_unit_is_in_nm_and_the_lines_of_a_table_are_noted(command):
    heights = ca.surface("self-affine", pixels=64, pixel_size=2, rms_slope=0.1, hurst=0.8, zeta=16).make(1).heights
    np.savetxt("scan.txt", heights)
    options = ("roughness", "scan.txt", "--height-unit", "nm", "--pixel-size")
    bare, given, turned = (command(*options, *rest) for rest in (("2",), ("2 nm",), ("2 nm", "--transpose")))
    assert bare.status == 0, bare.err
    assert bare.out == given.out
    assert "lines of the table  along x; --transpose" in bare.out
    assert "lines of the table  along y; --transpose" in turned.out
    assert "64 x 64 of 2 x 2 nm" in bare.out
    slopes = [re.search(r"profile slope +(\S+) and (\S+) along", done.out).groups() for done in (bare, turned)]
    assert slopes[0] == slopes[1][::-1] != slopes[1]
