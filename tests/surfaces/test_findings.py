"""What is wrong with an image is found before it is fitted: 16 artefacts at three strengths, on synthetic and on real
scans; and nothing is found in clean ones."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from instrument_files import gwy

import chemage as ca
from chemage import InputError
from chemage_surfaces import Measured, fit_roughness
from chemage_surfaces.findings import ARTEFACTS, STRUCTURES, Scan, examine

FILES = Path(__file__).parents[1] / "data" / "topographies"
#: nm
SIDE = 2.0


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def clean(seed: int, n: int = 128, hurst: float = 0.7, roll: float = 4.0, slope: float = 0.15, side: float = SIDE):
    """A part of a random surface that is twice as large, (n, n) nm."""
    maker = ca.surface("self-affine", pixels=2 * n, pixel_size=side, rms_slope=slope, hurst=hurst, zeta=n, eta=roll)
    return maker.make(seed).heights[:n, :n].copy()


def dilated(heights, side, radius):
    """The heights at which a paraboloid touches."""
    reach = min(int(math.sqrt(radius * np.ptp(heights)) / side) + 1, 60)
    for axis in (0, 1):
        shifted = [np.roll(heights, k, axis) - (k * side) ** 2 / (2 * radius) for k in range(-reach, reach + 1)]
        heights = np.max(shifted, axis=0)
    return heights


def found(heights, side=SIDE, periodic=False):
    """Kind -> finding."""
    scan = Scan(heights.astype(float), (side, side), periodic)
    return {one.kind: one for one in examine(scan, (*ARTEFACTS, *STRUCTURES))}


# -- artefacts, weak, clear and strong ---------------------------------------------------------------------------------


def block(h, s, rng):
    k, a = len(h) * (8, 20, 35)[s] // 256, len(h) // 3
    h[a : a + k, a : a + k] += (3, 10, 60)[s] * h.std()


def sentinel(h, s, rng):
    k, a = len(h) * (8, 20, 50)[s] // 256, len(h) // 3
    h[a : a + k, a : a + k] = (0.0, -32768.0, h.min() - 3 * h.std())[s]


def spikes(h, s, rng):
    for _ in range((4, 20, 80)[s]):
        (a, b), k = rng.integers(5, len(h) - 8, 2), rng.integers(2, 6)
        h[a : a + k, b : b + k] += rng.choice([-1, 1]) * (2, 5, 20)[s] * h.std()


def saturation(h, s, rng):
    np.minimum(h, np.quantile(h, 1 - (0.003, 0.02, 0.1)[s]), out=h)


def dead_lines(h, s, rng):
    for line in rng.choice(np.arange(5, len(h) - 5, 3), (1, 4, 8)[s], replace=False):
        h[:, line] = h[:, line - 1] if s < 2 else h[0, line]


def offsets(h, s, rng):
    h += (0.05, 0.2, 2.0)[s] * h.std() * rng.standard_normal(len(h))


def columns(h, s, rng):
    h += (0.05, 0.2, 2.0)[s] * h.std() * rng.standard_normal(len(h))[:, None]


def scars(h, s, rng):
    for _ in range((1, 5, 20)[s]):
        a, b, long, wide = *rng.integers(3, len(h) - 50, 2), rng.integers(20, 45), rng.integers(1, 3)
        h[a : a + long, b : b + wide] += rng.choice([-1, 1]) * (1, 2, 5)[s] * h.std()


def aborted(h, s, rng):
    h[:, -(len(h) * (8, 60, 150)[s] // 256) :] = (0.0, h[0, 0], math.nan)[s]


def bow(h, s, rng):
    h += (5, 30, 200)[s] * h.std() * np.linspace(-0.5, 0.5, len(h))[:, None] ** 2


def drift(h, s, rng):
    h += (1, 5, 30)[s] * h.std() * np.exp(-np.arange(len(h)) / 30)


def grating(h, s, rng):
    x, y = np.indices(h.shape)
    h += (0.05, 0.5, 3)[s] * h.std() * np.sign(np.sin(0.385 * (math.cos(0.3) * x + math.sin(0.3) * y) + 0.1))


def interference(h, s, rng):
    x, y = np.indices(h.shape)
    h += (0.05, 0.3, 1)[s] * h.std() * np.sin(2 * np.pi * (0.11 * x + 0.031 * y))


def terraces(h, s, rng):
    step, x = (0.5, 1, 2)[s] * h.std(), np.linspace(-1, 1, len(h))[:, None]
    h[:] = np.round((h + h.std() * x) / step) * step + 0.03 * h.std() * rng.standard_normal(h.shape)


def tip(h, s, rng):
    h[:] = dilated(h, 1.0, (3, 10, 40)[s] / max(np.diff(h, axis=0).std(), 1e-9) * 0.15)


def noise(h, s, rng):
    h += (0.01, 0.05, 0.3)[s] * h.std() * rng.standard_normal(h.shape)


SPOILED = {
    block: {"spikes", "blocks"},
    sentinel: {"repeated heights", "blocks"},
    spikes: {"spikes", "blocks"},
    saturation: {"saturation"},
    dead_lines: {"dead lines", "repeated heights"},
    offsets: {"line offsets"},
    columns: {"line offsets"},
    scars: {"scars", "spikes"},
    aborted: {"repeated heights", "missing", "dead lines"},
    bow: {"bow"},
    drift: {"level jumps", "bow"},
    grating: {"periodic structure"},
    interference: {"periodic structure"},
    terraces: {"terraces", "blocks", "spikes"},
    tip: {"dilation", "fine pixels"},
    noise: {"fine pixels"},
}


@pytest.mark.parametrize(
    "spoil", [one for one in SPOILED if one not in (drift, tip, noise)], ids=lambda one: one.__name__
)
def test_what_is_clear_is_found_at_its_place(spoil):
    before = clean(3)
    heights = before.copy()
    spoil(heights, 2, np.random.default_rng(1))
    here = found(heights)
    kinds = SPOILED[spoil] & here.keys()
    assert kinds
    changed = ~(heights == before)
    for kind in kinds - {"terraces"}:
        where = here[kind].where
        if where is not None:
            # a line between two scars is off both
            assert (where & changed).sum() > 0.75 * where.sum()


@pytest.mark.parametrize("case", [*range(4), *(pytest.param(k, marks=pytest.mark.long) for k in range(4, 40))])
def test_nothing_is_found_in_a_clean_scan(case):
    """H .2 to .95, any roll-off, tips of no and of 5 nm, pixels of 1 to 10 nm, 64 to 256 of them, coarse heights."""
    rng = np.random.default_rng([7, case])
    n, side = (64, 128, 256)[case % 3], float(rng.uniform(1, 10))
    options = {"hurst": rng.uniform(0.2, 0.95), "roll": rng.uniform(1, 16), "slope": rng.uniform(0.03, 0.5)}
    heights = clean(case, n, side=side, **options)
    if case % 2:
        heights = dilated(heights, side, 5.0)
    if case % 4 > 1:
        quantum = np.ptp(heights) / rng.choice([500, 4000, 65535])
        heights = np.round(heights / quantum) * quantum
    here = found(heights, side)
    assert not here.keys() - {"dilation"}, [one.line() for one in here.values()]
    assert case % 2 or not here


def judged(heights, side, clean_fit):
    """Whether the artefact is found or refused; else how far the rms slope is off, in half widths of its interval."""
    np.save("scan.npy", heights)
    maker = Measured(path="scan.npy", height_unit=1.0, pixel_size=(side, side), detrend="plane")
    image = maker.image()
    if image.faults:
        return "refused", 0.0
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        surface = maker.make()
    assert len(said) == len(image.findings)
    try:
        fit = fit_roughness(surface)
    except InputError:
        return "refused", 0.0
    if fit.fault:
        return "refused", 0.0
    kinds = {one.kind for one in (*image.findings, *fit.findings)}
    longest, shortest = 64 * side, fit.resolution
    slopes = [replace(fit, hurst=fit.hurst + k * fit.hurst_error).slope(longest, shortest) for k in (-1, 0, 1)]
    half = 1.645 * math.hypot(0.5 * math.log(slopes[2] / slopes[0]), 0.5 * fit.density_error)
    return kinds, math.log(slopes[1] / clean_fit.slope(longest, shortest)) / half


def scans():
    """A synthetic scan and, where the reader is there, a real one of 256 x 256 pixels: the film of ``afm.txt``."""
    yield clean(3, 256), SIDE
    real = np.loadtxt(FILES / "afm.txt")
    yield np.ascontiguousarray(real), 2.34375


@pytest.mark.parametrize(
    ("spoil", "strengths"),
    [
        pytest.param(
            spoil,
            strengths,
            marks=pytest.mark.long if strengths == [1] and number % 2 == 0 else pytest.mark.campaign,
            id=f"{spoil.__name__}-{strengths}",
        )
        for number, spoil in enumerate(SPOILED)
        for strengths in ([1], [0, 2])
    ],
)
def test_no_spoiled_scan_is_wrong_in_silence(spoil, strengths):
    """It is refused, or the artefact is named, or the rms slope of the fit is within twice the half width of its 90 %
    interval."""
    for which, (before, side) in enumerate(scans()):
        truth = fit_roughness(ca.Surface(heights=before, pixel_size=side, periodic=False))
        for strength in strengths:
            heights = before.copy()
            spoil(heights, strength, np.random.default_rng([which, strength]))
            what, off = judged(heights, side, truth)
            assert what == "refused" or what & SPOILED[spoil] or abs(off) < 2, (which, strength, what, off)


# -- what follows ------------------------------------------------------------------------------------------------------


def spoiled(spoil, strength, **options):
    heights = clean(3)
    spoil(heights, strength, np.random.default_rng(1))
    np.save("scan.npy", heights)
    return ca.surface("measured", path="scan.npy", height_unit="nm", pixel_size=SIDE, **options)


def test_a_block_of_bad_pixels_is_refused_and_can_be_interpolated():
    with pytest.raises(InputError, match=r'289 of 16384 pixels are spikes, .* give spikes = "interpolate"'):
        spoiled(block, 2).make()
    mended = spoiled(block, 2, spikes="interpolate").make()
    assert mended.rms_slope == pytest.approx(0.15, rel=0.1)
    assert {"step": "spikes", "replaced": 289} in mended.provenance["steps"]


def test_numbers_that_stand_for_no_height_and_dead_lines_count_as_missing():
    with pytest.warns(UserWarning, match="stands for none|interpolated") as said:
        surface = spoiled(sentinel, 1).make()
    assert "100 pixels have the same height of -32768 nm" in str(said[0].message)
    assert "100 of 16384 heights are missing, and interpolated" in str(said[1].message)
    assert surface.rms_slope == pytest.approx(0.15, rel=0.1)
    quiet = spoiled(sentinel, 1, missing="interpolate").make()
    np.testing.assert_array_equal(quiet.heights, surface.heights)


def test_a_scan_that_was_stopped_is_refused_with_the_part_to_take():
    with pytest.raises(InputError, match=r"scan was stopped .* give crop = \[0.0, 0.0, 256.0, 106.0\]"):
        spoiled(aborted, 2).make()
    assert spoiled(aborted, 2, crop=[0, 0, 256, 106]).make().shape == (128, 53)


def test_offsets_say_which_option_removes_them_and_which_way_they_run():
    with pytest.warns(UserWarning, match=r'lines along x are offset: .* give lines = "differences"'):
        spoiled(offsets, 2).make()
    assert spoiled(offsets, 2, lines="differences").make().rms_slope == pytest.approx(0.15, rel=0.3)
    with pytest.warns(UserWarning, match="lines along y are offset: .* give --transpose, or turn the image"):
        spoiled(columns, 2).make()


@pytest.mark.parametrize("spoil", [grating, terraces])
def test_structures_make_no_random_surface(spoil):
    heights = clean(3)
    spoil(heights, 2, np.random.default_rng(1))
    surface = ca.Surface(heights=heights, pixel_size=SIDE, periodic=False)
    fit = fit_roughness(surface)
    assert 'take the image itself, as the surface "measured"' in fit.fault
    with pytest.raises(InputError, match="no surface like this one"):
        fit.maker()


def test_an_artefact_of_the_image_spoils_the_fit_of_its_surface_too():
    with pytest.warns(UserWarning, match="are at the end of the range"):
        surface = spoiled(saturation, 1, detrend="plane").make()
    assert "scan again with a larger range" in fit_roughness(surface).fault
    aligned = spoiled(saturation, 1, lines="linear", spikes="keep").image()
    assert "saturation" in {one.kind for one in aligned.findings}
    assert "unfit" not in spoiled(saturation, 0, spikes="keep").image().unfit()


def test_an_enlarged_image_is_noted_and_not_mended():
    here = found(np.repeat(clean(3, 64), 2, axis=1))
    assert here["repeated lines"].consequence == "noted"
    assert "dead lines" not in here


def test_the_wave_of_a_grating_is_that_of_the_grating():
    x, _ = np.indices((128, 128))
    one = found(clean(3) + 2 * np.sin(2 * np.pi * x / 16))["periodic structure"]
    assert one.waves is not None
    np.testing.assert_allclose(np.abs(one.waves[0]), [2 * np.pi / 32, 0], atol=1e-12)


def test_the_command_prints_and_draws_what_is_found_and_takes_a_channel(command):
    heights = clean(3)
    scars(heights, 1, np.random.default_rng(1))
    Path("two.gwy").write_bytes(
        gwy(1e-9 * clean(4), title="Z", second=1e-9 * heights, second_title="Sensor", side=SIDE * 1e-9)
    )
    done = command("roughness", "two.gwy", "--figures", ".", "--spikes", "keep")
    assert done.status == 0, done.err
    assert "channel             'Z'; --channel takes another: 'Sensor'" in done.out
    assert "scars" not in done.out
    done = command("roughness", "two.gwy", "--channel", "Sensor", "--spikes", "keep", "--figures", ".", "--force")
    assert "scars               noted: " in done.out
    assert Path("findings.png").stat().st_size > 10_000
    np.save("plain.npy", heights)
    refused = command("roughness", "plain.npy", "--channel", "Z")
    assert refused.status != 0
    assert "the reader 'npy' knows no channels" in refused.err
