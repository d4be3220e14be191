"""From the image of an instrument to a surface: every step does what it says; none is taken that was not asked for."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import chemage as ca
from chemage import InputError

#: an image without symmetry: 24 x 16 pixels, smooth
X, Y = np.indices((24, 16))
IMAGE = np.sin(2 * np.pi * X / 24) + 0.3 * np.cos(2 * np.pi * (X / 12 - Y / 16)) + 0.1 * np.sin(2 * np.pi * Y / 8)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def measured(heights=IMAGE, **options):
    np.save("image.npy", heights)
    return ca.surface("measured", path="image.npy", **{"height_unit": "nm", "pixel_size": "2 nm", **options})


def holed(*pixels):
    heights = IMAGE.copy()
    for pixel in pixels:
        heights[pixel] = np.nan
    return heights


def test_without_steps_the_surface_is_the_image():
    surface = measured().make()
    np.testing.assert_array_equal(surface.heights, IMAGE)
    assert (surface.pixel_size, surface.periodic) == (2.0, False)
    assert [step["step"] for step in surface.provenance["steps"]] == ["read"]


def test_units_count():
    surface = measured(height_unit="um", pixel_size="3 um").make()
    np.testing.assert_allclose(surface.heights, 1000 * IMAGE, rtol=1e-14)
    assert surface.pixel_size == 3000


def test_every_step_is_recorded_in_its_order():
    options = {
        "crop": [4, 2, 36, 24],
        "missing": "interpolate",
        "detrend": "plane",
        "resample": "3 nm",
        "window": "mirror",
    }
    surface = measured(holed((5, 5)), **options).make()
    steps = surface.provenance["steps"]
    assert [step["step"] for step in steps] == ["read", "crop", "missing", "detrend", "resample", "window"]
    assert steps[1] == {"step": "crop", "first_pixel": [2, 1], "pixels": [18, 12]}
    assert steps[2]["interpolated"] == 1
    assert surface.shape == (24, 16)
    assert json.loads(json.dumps(surface.provenance)) == surface.provenance
    again = ca.plugin.fromdict("surface", {"kind": "measured", **surface.provenance["options"]})
    assert again.make() == surface


# -- steps ------------------------------------------------------------------------------------------------------------


def test_missing_heights_are_harmonic():
    """A plane is harmonic, and so is filled exactly; no filled height is a new maximum."""
    plane = 0.1 * X + 0.05 * Y
    plane[8:14, 5:9] = np.nan
    plane[0, 3:6] = np.nan  # at the edge the slope across it is zero instead
    filled = measured(plane, missing="interpolate").make().heights
    np.testing.assert_allclose(filled[8:14, 5:9], (0.1 * X + 0.05 * Y)[8:14, 5:9], rtol=1e-12)
    rough = np.random.default_rng(0).standard_normal((24, 16))
    gaps = np.random.default_rng(1).random(rough.shape) < 0.2
    filled = measured(np.where(gaps, np.nan, rough), missing="interpolate").make().heights
    assert filled.max() <= rough[~gaps].max()
    np.testing.assert_array_equal(filled[~gaps], rough[~gaps])


def test_many_missing_heights_are_found_by_iteration_to_the_same(monkeypatch):
    from chemage_surfaces import steps

    heights = holed(*((i, j) for i in range(3, 20, 2) for j in range(2, 12)))
    direct = steps.filled(heights, False)
    monkeypatch.setattr(steps, "MOST_ELIMINATED", 0)
    np.testing.assert_allclose(steps.filled(heights, False), direct, atol=1e-7)


@pytest.mark.parametrize(("detrend", "degree"), [("mean", 0), ("plane", 1), ("quadratic", 2)])
def test_a_trend_is_the_least_squares_polynomial(detrend, degree):
    x, y = X / 24, Y / 16
    powers = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    design = np.stack([power.ravel() for power in powers], axis=1)
    image = IMAGE + 5 - 3 * x + 2 * y + x * y - 4 * y**2
    fit, *_ = np.linalg.lstsq(design, image.ravel(), rcond=None)
    level = measured(image, detrend=detrend).make().heights
    np.testing.assert_allclose(level, image - (design @ fit).reshape(image.shape), atol=1e-12)


def test_spikes_are_found_and_replaced_and_edges_are_not():
    spiked = IMAGE.copy()
    spiked[7, 3] += 40
    spiked[15, 9] -= 40
    clean = measured(spiked, spikes="interpolate").make()
    assert clean.provenance["steps"][1] == {"step": "spikes", "replaced": 2}
    assert np.abs(clean.heights - IMAGE).max() < 0.2
    np.testing.assert_array_equal(measured(spiked, spikes="keep").make().heights, spiked)
    step = np.where(X < 12, 0.0, 30.0) + 0.01 * IMAGE
    np.testing.assert_array_equal(measured(step).make().heights, step)
    peak = np.exp(3 * np.cos(2 * np.pi * X / 24) + 3 * np.sin(2 * np.pi * Y / 16)) / 100
    np.testing.assert_array_equal(measured(peak).make().heights, peak)
    flat = np.zeros((24, 16))
    np.testing.assert_array_equal(measured(flat).make().heights, flat)
    for seed in range(3):
        rough = ca.surface("self-affine", pixels=64, pixel_size=2, rms_slope=0.3, hurst=0.3, zeta=32).make(seed)
        np.testing.assert_array_equal(measured(rough.heights).make().heights, rough.heights)


def test_pixels_with_two_sides_are_made_square():
    """Of twice as many rows the pairs are averaged, exactly; volume is conserved at any size."""
    tall = np.repeat(IMAGE, 2, axis=0)
    surface = measured(tall, pixel_size=[1, 2], resample=2).make()
    np.testing.assert_allclose(surface.heights, IMAGE, atol=1e-12)
    finer = measured(pixel_size=[1.5, 3.0], resample=0.75).make()
    assert finer.shape == (48, 64)
    assert finer.heights.mean() == pytest.approx(IMAGE.mean(), abs=1e-12)


def test_resampling_a_period_is_as_good_as_its_waves_are_long():
    surface = measured(periodic=True, resample=1).make()
    assert surface.shape == (48, 32)
    x, y = ((np.indices((48, 32)) + 0.5) / 2) - 0.5
    exact = np.sin(2 * np.pi * x / 24) + 0.3 * np.cos(2 * np.pi * (x / 12 - y / 16)) + 0.1 * np.sin(2 * np.pi * y / 8)
    assert np.abs(surface.heights - exact).max() < 0.02


def test_windows_make_an_image_periodic():
    tilted = IMAGE + X
    mirror = measured(tilted, window="mirror").make()
    assert mirror.shape == (48, 32)
    assert mirror.periodic
    np.testing.assert_array_equal(mirror.heights, mirror.heights[::-1, ::-1])
    np.testing.assert_array_equal(mirror.heights[:24, :16], tilted)
    hann = measured(tilted, window="hann").make()
    assert hann.periodic
    assert np.abs(hann.heights[[0, -1]]).max() < 0.1 * np.abs(hann.heights).max()


# -- refused ----------------------------------------------------------------------------------------------------------

REFUSED = {
    "missing heights": (
        lambda: measured(holed((3, 4), (5, 6)), missing="refuse"),
        r"2 of 384 heights .*\(3, 4\); give missing = ",
    ),
    "most heights missing": (
        lambda: measured(np.where(X % 3 < 2, np.nan, IMAGE)),
        "too many to interpolate; crop",
    ),
    "a scan that was stopped": (
        lambda: measured(np.where(Y > 9, np.nan, IMAGE)),
        r"144 of 384 heights are missing, where the scan was stopped .* give crop = \[0.0, 0.0, 48.0, 20.0\]",
    ),
    "infinite heights": (lambda: measured(np.where(X < 2, np.inf, IMAGE)), "32 of 384 heights are missing"),
    "a spike": (lambda: measured(np.where((X == 7) & (Y == 3), 99, IMAGE)), r"1 of 384 pixels are spikes.*\(7, 3\)"),
    "one row": (lambda: measured(IMAGE[:1]), "1 x 16 pixels are no image; give an image of at least 4 x 4"),
    "one column": (lambda: measured(IMAGE[:, :1]), "24 x 1 pixels are no image"),
    "two sides": (lambda: measured(pixel_size=[2, 3]), 'pixels of 2 x 3 nm are not square; give resample = "2 nm"'),
    "no unit": (lambda: measured(height_unit=None), "height_unit: image.npy does not state one; give it, such as "),
    "no size": (lambda: measured(pixel_size=None), "pixel_size: image.npy does not state one"),
    "neither": (lambda: measured(height_unit=None, pixel_size=None), "height_unit, pixel_size: .* does not state them"),
    "no unit of length": (lambda: measured(height_unit="V"), "height_unit.*volt"),
    "an unknown unit": (lambda: measured(height_unit="furlongs_per"), "height_unit.*unknown unit"),
    "a wrong unit": (lambda: measured(height_unit="mm"), "rms slope of .* one of the units is wrong: give height_unit"),
    "a crop outside": (lambda: measured(crop=[0, 20, 20, 20]), "crop = .*along y, but the image ends at 32 nm"),
    "a crop of a row": (lambda: measured(crop=[0, 0, 2, 30]), "crop = .*: 1 x 15 pixels are no image"),
    "pixels too large": (lambda: measured(resample=20), "resample = 20 nm: leaves 2 pixels"),
    "a broken period": (
        lambda: measured(periodic=True, resample=1.9),
        "no whole number of pixels of 1.9 nm; give 1.92",
    ),
    "a trend of a period": (
        lambda: measured(periodic=True, detrend="plane"),
        "is periodic, .* its edges would not fit",
    ),
    "a window twice": (lambda: measured(periodic=True, window="hann"), "window = 'hann', periodic = True: .*leave out"),
}


def test_few_spikes_and_gaps_are_repaired_with_a_warning_and_their_count():
    rough = ca.surface("self-affine", pixels=64, pixel_size=1, rms_slope=0.1, hurst=0.8, zeta=8).make(1).heights.copy()
    rough[7, 3] = 99.0
    with pytest.warns(UserWarning, match="1 of 4096 pixels are spikes, and interpolated"):
        surface = measured(rough).make()
    assert {"step": "spikes", "replaced": 1} in surface.provenance["steps"]
    np.testing.assert_array_equal(surface.heights, measured(rough, spikes="interpolate").make().heights)
    with pytest.raises(InputError, match="1 of 4096 pixels are spikes"):
        measured(rough, spikes="refuse").make()
    rough[7, 3] = np.nan
    with pytest.warns(UserWarning, match="1 of 4096 heights are missing, and interpolated"):
        assert measured(rough).make().provenance["steps"][1] == {"step": "missing", "interpolated": 1}


@pytest.mark.parametrize("case", REFUSED)
def test_an_image_that_needs_a_step_is_refused_with_it(case):
    make, words = REFUSED[case]
    with pytest.raises(InputError, match=words):
        make().make()


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        (np.where(X < 2, np.nan, IMAGE), "give crop = [4.0, 0.0, 44.0, 32.0]"),
        (IMAGE[:1], "no image"),
        (1e6 * IMAGE, "units is wrong"),
    ],
)
def test_check_refuses_it_as_run_does(command, heights, words):
    measured(heights)
    with open("scene.toml", "w", encoding="utf-8") as file:
        file.write(
            '[surface]\nkind = "measured"\npath = "image.npy"\nheight_unit = "nm"\npixel_size = "2 nm"\n'
            '[contact]\nkind = "fft-bem"\nmodulus = "35.3 GPa"\nload = "1 nN"\n'
        )
    for name in ("check", "run"):
        done = command(name, "scene.toml")
        assert done.status != 0
        assert words in " ".join((done.out + done.err).split())


def test_a_file_that_changes_is_another_surface():
    maker = measured()
    before = maker.digest(), maker.make()
    np.save("image.npy", 2 * IMAGE)
    assert maker.digest() != before[0]
    assert maker.make().rms_height == pytest.approx(2 * before[1].rms_height)


def test_from_file_names_the_surface_that_fills_gaps():
    np.save("image.npy", holed((3, 4)))
    with pytest.raises(InputError, match=r'1 of 384 heights.*surface "measured" and missing = "interpolate"'):
        ca.surface("from-file", path="image.npy", pixel_size=1).make()


def test_a_measured_tip_is_pressed():
    """A paraboloid measured in µm on pixels of two sides, tilted: its contact is that of Hertz."""
    x, y = (np.indices((96, 48)) + 0.5) * np.array([0.5, 1.0])[:, None, None] - 24
    tip = -(x**2 + y**2) / (2 * 60)
    np.save("image.npy", (tip + 3) / 1000)
    maker = ca.surface("measured", path="image.npy", height_unit="um", pixel_size=["0.5 nm", "1 nm"], resample="0.5 nm")
    contact = ca.contact("fft-bem", modulus="35.3 GPa").solve(maker.make(), load="50 nN")
    radius = (0.75 * 60 * 50 / 35.3) ** (1 / 3)
    assert contact.corrected_area == pytest.approx(math.pi * radius**2, rel=0.05)
