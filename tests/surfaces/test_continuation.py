"""What `roughened` does not know of a surface, and what it keeps of one that is not self-affine."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import fft as sfft

import chemage as ca
from chemage.plugin import CONTINUATIONS

SIDE, N = 2.0, 128


def drawn(density, seed, n=2 * N, side=SIDE):
    """A corner of Gaussian heights with a density of (qx, qy), nm⁴, which does not repeat."""
    qx, qy = 2 * np.pi * np.fft.fftfreq(n, side)[:, None], 2 * np.pi * np.fft.rfftfreq(n, side)
    with np.errstate(divide="ignore"):
        amplitude = np.sqrt(density(qx, qy)) / side
    amplitude[0, 0] = 0
    spectrum = sfft.rfft2(np.random.default_rng(seed).standard_normal((n, n)))
    return sfft.irfft2(spectrum * amplitude, s=(n, n))[: n // 2, : n // 2]


def law(hurst, c=3.0):
    return lambda qx, qy: c * (np.hypot(qx, qy)) ** (-2 - 2 * hurst) * 1e-2


def roughened(tmp_path, heights, **options):
    np.save(tmp_path / "image.npy", heights)
    image = {"kind": "measured", "path": str(tmp_path / "image.npy"), "height_unit": "nm", "pixel_size": SIDE}
    return ca.surface("roughened", surface=image, **{"pixel_size": SIDE / 4, "cutoff": SIDE} | options)


def record(maker, seed=0):
    return maker.make(seed).provenance["roughened"]


@pytest.mark.parametrize("noise", [*(pytest.param(rms, marks=pytest.mark.long) for rms in (0.03, 0.1)), 0.3])
def test_white_noise_is_told_from_the_surface(tmp_path, noise):
    """The slope is that of the surface without it, which where it is weak is less certain; where it is strong it is
    found."""
    fine = drawn(law(0.9), 1, 6 * N, SIDE / 3)
    image = fine[1::3, 1::3] + noise * np.random.default_rng(2).standard_normal((N, N))
    found = record(roughened(tmp_path, image, pixel_size=SIDE / 3, cutoff=None))
    low, high = found["rms_slope_interval"]
    assert low < ca.Surface(heights=fine, pixel_size=SIDE / 3, periodic=False).rms_slope < high
    assert high / low < 2.5
    assert found["noise"] < 1.1 * noise
    if noise == 0.3:
        assert found["noise"] == pytest.approx(noise, rel=0.05)


@pytest.mark.parametrize("hurst", [0.3, *(pytest.param(h, marks=pytest.mark.long) for h in (1.3, 2.0))])
def test_a_spectrum_of_any_slope_is_carried_on(tmp_path, hurst):
    """Also where no surface is self-affine; the interval of H is about what is seen, or wide."""
    found = record(roughened(tmp_path, drawn(law(hurst), 3), resolution="5 nm"))
    assert abs(found["hurst"] - hurst) < 3 * found["hurst_error"]
    assert 0.05 < found["hurst_error"] < 0.5


def test_what_is_far_below_the_image_is_less_known(tmp_path):
    heights = drawn(law(0.8), 4)[:64, :64]
    near, far = (record(roughened(tmp_path, heights, pixel_size=SIDE / k, cutoff=2 * SIDE / k)) for k in (4, 32))
    near, far = (one["rms_slope_interval"][1] / one["rms_slope_interval"][0] for one in (near, far))
    assert far > 1.3 * near > 1.3


def test_added_waves_have_the_directions_of_the_image(tmp_path):
    """Wavelengths across 60° are four times shorter than those along it: mean square slopes differ as theirs."""
    angle = math.radians(60)

    def density(qx, qy):
        along = qx * math.cos(angle) + qy * math.sin(angle)
        across = qy * math.cos(angle) - qx * math.sin(angle)
        return 1e-2 * np.hypot(along / 2, 2 * across) ** -3.6

    surface = roughened(tmp_path, drawn(density, 5)).make(1)
    spectrum = np.abs(np.fft.fft2(surface.heights * np.outer(*2 * [np.hanning(len(surface.heights))]))) ** 2
    q = 2 * np.pi * np.fft.fftfreq(len(spectrum), SIDE / 4)
    q, turn = np.hypot(q[:, None], q), np.arctan2(q, q[:, None])
    added = (q > 1.3 * surface.provenance["roughened"]["join"]) & (q < 0.9 * 2 * math.pi / SIDE)
    near = [spectrum[added & (np.abs(np.sin(turn - at)) < 0.15)].mean() for at in (angle, angle + math.pi / 2)]
    assert near[0] / near[1] == pytest.approx(16**1.8, rel=0.5)
    plain = roughened(tmp_path, drawn(law(0.8), 6)).make(1)
    assert plain.provenance["roughened"]["hurst"] == pytest.approx(0.8, abs=0.5)


def test_a_grating_and_terraces_stay_as_they_are(tmp_path):
    turn = math.radians(30)

    def across(count, side):
        at = (np.arange(count) + 0.5) * side
        return at[:, None] * math.cos(turn) + at * math.sin(turn)

    rough = 0.05 * drawn(law(0.8), 7) / drawn(law(0.8), 7).std()
    fine = across(4 * N, SIDE / 4)
    inside = np.zeros(fine.shape, dtype=bool)
    inside[16:-16, 16:-16] = True
    for shape in (lambda x: np.sin(2 * np.pi * x / 16), lambda x: 2.0 * np.floor(x / 64)):
        made = roughened(tmp_path, shape(across(N, SIDE)) + rough, resolution="8 nm").make(2).heights
        there = inside & (np.abs(fine / 64 - np.rint(fine / 64)) * 64 > 4)
        apart = (made - shape(fine))[there]
        assert apart.std() < 0.08


def test_members_are_other_surfaces_that_the_image_allows(tmp_path):
    maker = roughened(tmp_path, drawn(law(0.8), 8), resolution="6 nm")
    members = maker.members(9)
    assert members == maker.members(9)
    assert not maker.members(0)
    assert not members[0].members(3)
    slopes = [one.make(1).rms_slope for one in members]
    assert slopes == pytest.approx(sorted(slopes), rel=0.03)
    low, high = record(maker)["rms_slope_interval"]
    assert np.quantile(slopes, [0.05, 0.95]) == pytest.approx([low, high], rel=0.1)
    assert maker.scatter({}).between == CONTINUATIONS
    # none is unknown where the spectrum is given
    assert "tip" not in maker.unknown
    assert "tip_radius is not given" in roughened(tmp_path, drawn(law(0.8), 8)).unknown


@pytest.mark.campaign
def test_a_mean_has_the_error_of_what_the_image_does_not_show(tmp_path):
    maker = roughened(tmp_path, drawn(law(0.8), 9), resolution="6 nm")
    scene = {
        "surface": maker.todict(),
        "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 2000.0},
        "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
        "chemistry": {"activation_volume": "6.4 angstrom**3"},
        "engine": {"kind": "independent"},
        "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 2, "seed": 5},
    }
    made = ca.ensemble(ca.parse_scene(scene), surfaces=3)
    area = made.estimate("area_fraction")
    part = area.errors["measurement"]
    assert "8 members: the spectrum below what the image shows" in part.how
    # area is in inverse proportion to the slope
    slopes = [one.make(1).rms_slope for one in maker.members(8)]
    assert part.size / area.value == pytest.approx(1.28 * np.std(slopes, ddof=1) / np.mean(slopes), rel=0.5)
    more = ca.ensemble(ca.parse_scene(scene), surfaces=6).estimate("area_fraction")
    assert more.errors["measurement"].size / more.value == pytest.approx(part.size / area.value, rel=1e-9)
    assert area.half_width > 1.9 * part.size
