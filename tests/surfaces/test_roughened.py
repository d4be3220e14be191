"""A measured surface carried on to smaller wavelengths; and the roughness parameters of a measured surface."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.fft import dctn

import chemage as ca
from chemage import InputError
from chemage.plugin import PlottedResult
from chemage_surfaces import fit_roughness

SIDE, PIXELS = 0.45, 256
REFERENCE = ca.surface("self-affine", pixels=PIXELS, pixel_size=SIDE, rms_slope=0.1, hurst=0.8, zeta=64, eta=2)
SHORTEST = PIXELS * SIDE / 64

PATH = Path(__file__).parents[1] / "benchmarks" / "roughened.py"
spec = spec_from_file_location("roughened_benchmark", PATH)
benchmark = module_from_spec(spec)
spec.loader.exec_module(benchmark)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def imaged(heights, factor=4, **options):
    """The low-passed image of a surface on pixels ``factor`` times larger."""
    np.save("image.npy", benchmark.image(heights, factor))
    image = {"kind": "measured", "path": "image.npy", "height_unit": "nm", "pixel_size": factor * SIDE}
    return {**image, "periodic": True, **options}


def roughened(image, **options):
    return ca.surface("roughened", surface=image, **{"pixel_size": SIDE, "cutoff": SHORTEST, **options})


def waves(heights):
    qx, qy = (2 * np.pi * np.fft.fftfreq(n, SIDE) for n in heights.shape)
    return np.hypot(qx[:, None], qy), np.fft.fft2(heights)


@pytest.mark.parametrize(("factor", "resolution"), [(4, None), (4, "5 nm"), (2, "3 nm")])
def test_measured_waves_stay_as_they_are(factor, resolution):
    original = REFERENCE.make(1)
    rough = roughened(imaged(original.heights, factor), hurst=0.8, resolution=resolution).make(5)
    (q, before), (_, after) = waves(original.heights), waves(rough.heights)
    join = 2 * math.pi / (float(resolution[0]) if resolution else 2 * factor * SIDE) * (1 - 1e-9)
    kept = q < join
    assert np.abs(after - before)[kept].max() < 1e-12 * np.abs(before).max()
    beyond = q > 2 * math.pi / SHORTEST * (1 + 1e-9)
    assert np.abs(after)[beyond].max() < 1e-12 * np.abs(before).max()
    between = ~kept & ~beyond
    assert np.all(after[between] != before[between])


@pytest.mark.parametrize(
    "lines", ["none", *(pytest.param(one, marks=pytest.mark.long) for one in ("differences", "linear"))]
)
# robust lines through a few hills leave a line off the others
@pytest.mark.filterwarnings("ignore:.*lie off the lines on both sides")
def test_waves_that_the_alignment_of_lines_took_are_drawn_from_the_spectrum(lines):
    """Their mean squares, over eight surfaces, are those of the same waves of the surfaces themselves."""
    n, rows = 64, {"none": 0, "linear": 2}.get(lines, 1)
    own, found = [], []
    for seed in range(8):
        part = benchmark.image(REFERENCE.replace(pixels=(2 * PIXELS, 2 * PIXELS)).make(seed).heights, 4)[:n, :n]
        np.save("part.npy", part)
        image = {"kind": "measured", "path": "part.npy", "height_unit": "nm", "pixel_size": 4 * SIDE, "lines": lines}
        maker = roughened({**image, "spikes": "keep"}, hurst=0.8)
        rough = maker.make(seed)
        assert maker.expected()["rms_slope"] == pytest.approx(rough.rms_slope, rel=0.03)
        coarse = rough.heights.reshape(n, 4, n, 4).mean(axis=(1, 3))
        own.append(dctn(part, norm="ortho"))
        found.append(dctn(coarse, norm="ortho"))
    own, found = np.array(own), np.array(found)
    # from four periods to half of the waves that stay
    for row in range(max(rows, 1)):
        before, after = (np.mean(one[:, row, 8:24] ** 2 * np.arange(8, 24) ** 3.6) for one in (own, found))
        # ratio of two means of 128 squares of normal variates
        assert math.log(after / before) == pytest.approx(0, abs=4 * math.sqrt(4 / 128))
    alike = np.corrcoef(own[:, 0, 8:24].ravel(), found[:, 0, 8:24].ravel())[0, 1]
    assert alike > 0.99 if rows == 0 else alike < 0.5
    np.testing.assert_allclose(found[:, 4, 8:20], own[:, 4, 8:20], atol=0.1 * own[:, 4, 8:20].std())


def test_the_seed_draws_the_waves_that_are_added():
    maker = roughened(imaged(REFERENCE.make(1).heights), hurst=0.8)
    one, two = maker.make(1), maker.make(2)
    assert one == maker.make(1)
    q, first = waves(one.heights)
    _, second = waves(two.heights)
    added = (q > math.pi / (4 * SIDE)) & (q < 2 * math.pi / SHORTEST)
    alike = np.abs(np.vdot(first[added], second[added])) / np.linalg.norm(first[added]) / np.linalg.norm(second[added])
    assert alike < 5 / math.sqrt(np.count_nonzero(added))
    assert maker.scatter({}).relative is None


@pytest.mark.long
def test_the_ensemble_is_that_of_the_original():
    """Rms slopes and fitted H of 12 surfaces: their means agree within their scatter, which is a few per cent."""
    slopes, exponents, errors = [], [], []
    for seed in range(12):
        rough = roughened(imaged(REFERENCE.make(seed).heights)).make(100 + seed)
        slopes.append(rough.rms_slope)
        exponents.append(rough.provenance["roughened"]["hurst"])
        errors.append(rough.provenance["roughened"]["hurst_error"])
    assert np.mean(slopes) == pytest.approx(0.1, abs=4 * np.std(slopes) / math.sqrt(12))
    assert np.std(slopes) < 0.01
    assert np.mean(exponents) == pytest.approx(0.8, abs=4 * np.mean(errors) / math.sqrt(12))
    # errors are of waves that no image shows
    assert np.std(exponents, ddof=1) < 1.5 * np.mean(errors)


@pytest.mark.long
def test_contact_and_ageing_are_those_of_the_original():
    """Six surfaces, pairwise: κ and β with the waves drawn anew differ by less than between surfaces."""
    silica = ca.load_scene("silica-patch").chemistry
    times = ca.hold_times(10, 1e4, per_decade=2)

    def found(surface):
        contact = ca.contact("fft-bem", modulus=35.3).solve(surface, 0.03 * surface.nominal_area)
        ageing = ca.age(contact, silica, engine=ca.engine("bkl"), hold_times=times, temperature=300.0, replicas=4)
        return contact.kappa, ageing.fit().beta

    before, after = [], []
    for seed in range(6):
        original = REFERENCE.make(seed)
        before.append(found(original))
        after.append(found(roughened(imaged(original.heights), hurst=0.8).make(50 + seed)))
    before, after = np.array(before), np.array(after)
    scatter = before.std(axis=0, ddof=1)
    apart = after.mean(axis=0) - before.mean(axis=0)
    pairs = (after - before).std(axis=0, ddof=1)
    assert np.all(np.abs(apart) < scatter + 4 * pairs / math.sqrt(6))
    assert np.all(np.abs(apart) < 0.1 * before.mean(axis=0))


def test_the_full_measurement_agrees_within_its_scatter():
    """The rows in the documentation, of ten surfaces of the reference contact."""
    rows = np.genfromtxt(PATH.with_suffix(".csv"), delimiter=",", names=True)
    original = rows[rows["image_nm"] == 0]
    assert len(original) == 10
    for size in set(rows["image_nm"]) - {0.0}:
        other = rows[rows["image_nm"] == size]
        for name in ("kappa", "kappa_corrected", "beta"):
            assert abs(other[name].mean() - original[name].mean()) < original[name].std(ddof=1)


def test_an_image_that_is_not_periodic_is_carried_on_too():
    """Long waves are those of the image at the centres of its pixels, and no step appears at the edges."""
    whole = REFERENCE.make(3).heights
    part = benchmark.image(whole, 4)[:40, :48]
    np.save("part.npy", part)
    image = {"kind": "measured", "path": "part.npy", "height_unit": "nm", "pixel_size": 4 * SIDE}
    rough = roughened(image, hurst=0.8).make(1)
    assert (rough.shape, rough.periodic) == ((160, 192), False)
    change = dctn(rough.heights.reshape(40, 4, 48, 4).mean(axis=(1, 3)) - part, norm="ortho")
    q = np.hypot(*np.meshgrid(*(np.pi * np.arange(n) / (n * 4 * SIDE) for n in part.shape), indexing="ij"))
    long = q < 0.9 * rough.provenance["roughened"]["join"]
    assert long.mean() > 0.2
    assert np.sqrt(np.mean(change[long] ** 2)) < 0.05 * part.std()
    assert rough.rms_slope == pytest.approx(0.1, rel=0.15)
    assert roughened(image, hurst=0.8).expected()["rms_slope"] == pytest.approx(rough.rms_slope, rel=0.02)
    # down to two pixels as well, of which a central difference sees nothing
    short = roughened(image, hurst=0.3, cutoff=None)
    assert short.expected()["rms_slope"] == pytest.approx(short.make(1).rms_slope, rel=0.02)
    # pixels that do not fill the image leave out less than one
    assert roughened(image, hurst=0.8, pixel_size="0.7 nm", cutoff=None).make().shape == (102, 123)


def test_refused():
    image = imaged(REFERENCE.make(1).heights)
    wrong = {
        r"cutoff = 0.5 nm: shorter than two pixels of 0.45 nm, 0.9 nm; give smaller pixels": {"cutoff": 0.5},
        r"pixel_size = 1.8 nm: the pixels of the measured surface are 1.8 nm; give smaller": {
            "pixel_size": 1.8,
            "cutoff": None,
        },
        r'pixel_size = 0.46 nm: the period along x, 115.2 nm, is no whole .* give pixel_size = "0.4608': {
            "pixel_size": 0.46
        },
        r"resolution = 3 nm: shorter than two pixels of the image, 3.6 nm": {"resolution": 3},
        r"cutoff = 3.6 nm: the image has waves down to 3.6 nm, so that nothing is left": {"cutoff": 3.6},
        r"resolution = 2 nm: nothing is left to add above the cutoff of 2.5 nm": {"cutoff": 2.5, "resolution": 2},
        r"fit_from = 3 nm: must be longer than resolution = 4 nm": {"resolution": 4, "fit_from": 3},
        r"fit_from = 3.7 nm, .*: the image has no waves between them; give a longer fit_from": {"fit_from": 3.7},
    }
    for words, options in wrong.items():
        with pytest.raises(InputError, match=words):
            roughened(image, **options).expected()
    smooth = ca.surface("self-affine", pixels=64, pixel_size=1.8, rms_slope=0.1, hurst=0.8, zeta=8)
    with pytest.raises(InputError, match=r"spectrum of the image ends at a wavelength of .* give this resolution"):
        roughened(smooth, resolution=3.6).expected()
    # without a resolution it goes on from there: 8 periods
    assert roughened(smooth).make().provenance["roughened"]["join"] == pytest.approx(2 * np.pi / 14.4, rel=0.15)


@pytest.mark.long
def test_it_is_a_scene_with_a_figure(command):
    imaged(REFERENCE.make(1).heights)
    Path("scene.toml").write_text(
        f'[surface]\nkind = "roughened"\npixel_size = {SIDE}\ncutoff = {SHORTEST}\nseed = 3\n'
        '[surface.surface]\nkind = "measured"\npath = "image.npy"\nheight_unit = "nm"\n'
        "pixel_size = 1.8\nperiodic = true\n"
        '[contact]\nkind = "fft-bem"\nmodulus = "35.3 GPa"\nload = "200 nN"\n',
        encoding="utf-8",
    )
    assert command("check", "scene.toml").status == 0
    done = command("run", "scene.toml", "-o", "rough.h5")
    assert done.status == 0, done.err
    assert list(Path().glob("**/*roughened-spectrum.png"))
    record = ca.read("rough.h5").surface.provenance
    assert record["measured"]["steps"][0]["reader"] == "npy"
    assert 0.5 < record["roughened"]["hurst"] < 1


def test_the_figure_shows_the_spectrum_of_this_surface_alone():
    """Of a tip on it the image and the law, not the spectrum of the tip; nothing where the result holds no surface."""
    below = roughened(imaged(REFERENCE.make(1).heights))
    body = {"kind": "sphere", "radius": 30, "pixels": 64, "pixel_size": SIDE}
    on_it = ca.surface("tip", body=body, counterface=below).make(1)
    for surface, shown in ((below.make(1), 3), (on_it, 2), (None, 0)):
        maps = {"contact": None, "surface": surface}
        result = PlottedResult("it", None, None, "C0", below, load_maps=partial(SimpleNamespace, **maps))
        axes = Figure().add_subplot()
        below.draw("roughened-spectrum", axes, [result])
        labels = axes.get_legend_handles_labels()[1]
        assert len(labels) == shown
        assert ("it, carried on" in labels) == (shown == 3)
        assert axes.has_data() == bool(shown)
        assert not axes.texts  # which would make a figure of it


# -- roughness parameters of a measurement -----------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("hurst", "eta"), [(0.5, 8), (0.8, 1), (0.8, 4)])
def test_the_parameters_of_a_surface_are_found(hurst, eta):
    maker = REFERENCE.replace(hurst=hurst, eta=eta)
    found = [fit_roughness(maker.make(seed)) for seed in range(4)]
    like = [one.maker(cutoff=SHORTEST) for one in found]
    error = np.mean([one.hurst_error for one in found])
    assert np.mean([one.hurst for one in found]) == pytest.approx(hurst, abs=4 * error / 2 + 0.01)
    assert np.mean([one.eta for one in like]) == pytest.approx(eta, rel=0.2)
    assert np.mean([one.rms_slope for one in like]) == pytest.approx(0.1, rel=0.04)
    assert like[0].zeta == pytest.approx(64)
    assert like[0].pixels == (PIXELS, PIXELS)
    if eta > 1:
        low, high = found[0].roll_off_interval
        assert f"roll-off            {found[0].roll_off:.4g} nm ({low:.4g} to {high:.4g})" in found[0].text()
    assert "roll-off            none" in replace(found[0], roll_off=None, roll_off_interval=None).text()


def test_the_command_prints_a_section_that_is_a_scene(command):
    np.save("image.npy", REFERENCE.make(2).heights / 1000)
    words = [
        "--height-unit",
        "um",
        "--pixel-size",
        "0.45 nm",
        "--periodic",
        "--spacing",
        "0.9 nm",
        "--cutoff",
        "1.8 nm",
    ]
    done = command("roughness", "image.npy", *words)
    assert done.status == 0, done.err
    assert "Hurst exponent      0.8" in done.out or "Hurst exponent      0.7" in done.out
    section = tomllib.loads(done.out[done.out.index("[surface]") :])["surface"]
    seed = section.pop("seed")
    surface = ca.plugin.fromdict("surface", section).make(seed)
    assert surface.shape == (128, 128)
    assert surface.pixel_size == 0.9
    refused = command("roughness", "image.npy")
    assert refused.status != 0
    assert "height_unit, pixel_size" in refused.err


@pytest.mark.long
def test_what_is_not_self_affine_is_measured_and_makes_no_scene(command):
    with pytest.raises(InputError, match="too few wavelengths"):
        fit_roughness(ca.Surface(heights=np.random.default_rng(0).standard_normal((8, 8)), pixel_size=1.0))
    white = np.random.default_rng(0).standard_normal((128, 128))
    fit = fit_roughness(ca.Surface(heights=white, pixel_size=1.0, periodic=False))
    assert fit.hurst == pytest.approx(-1, abs=3 * fit.hurst_error)
    assert fit.hurst_error < 0.3
    with pytest.raises(InputError, match="not self-affine"):
        fit.maker()
    np.save("white.npy", white)
    done = command("roughness", "white.npy", "--height-unit", "nm", "--pixel-size", "1 nm", "--spikes", "keep")
    assert done.status == 0
    assert "rms height" in done.out
    assert f"no self-affine surface: the spectrum falls with H = {fit.hurst:.1f}" in done.out
    # the image itself makes one
    section = tomllib.loads(done.out[done.out.index("[surface]") :])["surface"]
    seed = section.pop("seed")
    surface = ca.plugin.fromdict("surface", section).make(seed)
    assert (surface.shape, surface.pixel_size) == ((256, 256), 0.5)
    with pytest.raises(InputError, match=r"resolution = 1 nm: shorter than two pixels, 2 nm"):
        fit_roughness(ca.Surface(heights=white, pixel_size=1.0), resolution="1 nm")
