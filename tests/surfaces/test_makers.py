"""The interface of surfaces and readers: options, provenance, files, errors."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import StoreError, hookimpl, registry, threads

HEIGHTS = np.random.default_rng(0).standard_normal((5, 7))
ROUGH = {"pixels": 64, "pixel_size": "0.5 nm", "hurst": 0.8, "zeta": 20, "eta": 3, "rms_slope": 0.1}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def from_file(path, **options):
    return ca.surface("from-file", path=path, **options)


def test_packages_import_nothing_heavy():
    code = (
        "import sys, chemage_ageing, chemage_bonds, chemage_surfaces, chemage_silica\n"
        "heavy = {'numpy', 'scipy', 'numba', 'pydantic', 'h5py'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "from chemage_surfaces import FromFile, Hdf5, Npy, SelfAffine, Sphere, Text, Topography\n"
        "from chemage_bonds import ElasticPairs, Gaussian, Tabulated, Uniform\n"
        "from chemage_silica import MDSilica\n"
        "assert (Sphere.kind, Gaussian.kind, MDSilica.kind) == ('sphere', 'gaussian', 'md-silica')\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# -- self-affine ------------------------------------------------------------------------------------------------------


def test_same_seed_same_bytes_other_seed_other_surface():
    maker = ca.surface("self-affine", **ROUGH)
    assert maker.make(seed=7) == maker.make(seed=7)
    assert maker.make(seed=7).heights.tobytes() == maker.make(seed=7).heights.tobytes()
    assert np.abs(np.corrcoef(maker.make(seed=7).heights.ravel(), maker.make(seed=8).heights.ravel())[0, 1]) < 0.3


def test_bytes_do_not_depend_on_the_number_of_threads():
    maker = ca.surface("self-affine", pixels=(300, 251), pixel_size=0.5, hurst=0.8, zeta=100, eta=3, rms_slope=0.1)
    made = []
    with threads.restored():
        for number in (1, 4):
            threads.limit(number)
            made.append(maker.make(2).heights.tobytes())
    assert made[0] == made[1]


def test_a_seed_sequence_is_a_seed_and_is_not_used_up():
    maker, sequence = ca.surface("self-affine", **ROUGH), np.random.SeedSequence(5)
    assert np.array_equal(maker.make(sequence).heights, maker.make(sequence).heights)
    assert np.array_equal(maker.make(sequence).heights, maker.make(5).heights)
    first, second = sequence.spawn(2)
    assert not np.array_equal(maker.make(first).heights, maker.make(second).heights)


@pytest.mark.parametrize("seed", [3, np.random.SeedSequence(3, spawn_key=(1, 2))])
def test_provenance_says_how_a_rough_surface_was_made(seed):
    surface = ca.surface("self-affine", **ROUGH).make(seed)
    record = json.loads(json.dumps(surface.provenance))
    assert record == surface.provenance
    again = ca.plugin.fromdict("surface", {"kind": record["kind"], **record["options"]})
    stored = record["seed"]
    if isinstance(stored, dict):
        stored = np.random.SeedSequence(stored["entropy"], spawn_key=stored["spawn_key"])
    assert again.make(stored) == surface
    assert record["chemage"] == ca.__version__


@pytest.mark.parametrize("pixels", [64, [64, 64], (64, 64), 64.0, np.int64(64)])
def test_one_number_of_pixels_means_a_square(pixels):
    assert ca.surface("self-affine", **ROUGH | {"pixels": pixels}) == ca.surface("self-affine", **ROUGH)


def test_rms_slope_and_height_are_two_ways_to_scale_one_surface():
    by_slope = ca.surface("self-affine", **ROUGH).make(1)
    by_height = ca.surface("self-affine", **ROUGH | {"rms_slope": None, "rms_height": by_slope.rms_height}).make(1)
    # heights are sums of many waves: what is near zero carries the rounding of what is not
    tolerance = 1e-13 * by_slope.rms_height
    np.testing.assert_allclose(by_height.heights, by_slope.heights, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"zeta": 33}, "zeta = 33: above the Nyquist limit 32 of 64 pixels"),
        ({"pixels": [39, 20]}, "above the Nyquist limit 19.5 of 39 pixels"),
        ({"eta": 21}, "eta = 21: above zeta = 20"),
        ({"eta": 0.5}, "eta"),
        ({"rms_height": "1 nm"}, "both given; give exactly one"),
        ({"rms_slope": None}, "neither given; give exactly one"),
        ({"rms_slope": -0.1}, "rms_slope"),
        ({"rms_slope": float("nan")}, "rms_slope"),
        ({"rms_slope": "0.1 nm"}, "nanometer"),
        ({"hurst": 1.2}, "hurst"),
        ({"pixel_size": 0}, "pixel_size"),
        ({"pixel_size": float("inf")}, "pixel_size"),
        ({"pixel_size": "0.5 GPa"}, "gigapascal"),
        ({"pixels": 0}, "pixels: 0: a grid of 0 x 0 pixels"),
        ({"pixels": -5}, "pixels"),
        ({"pixels": 64.5}, "whole number of pixels"),
        ({"pixels": True}, "whole number of pixels"),
        ({"pixels": "many"}, "whole number of pixels"),
        ({"pixels": [64, 64, 64]}, "3 numbers"),
        ({"pixels": 10**7}, "of memory of this machine hold the heights of at most"),
        ({"hurts": 0.8}, "did you mean 'hurst'"),
    ],
)
def test_wrong_options_are_refused_in_words(wrong, words):
    with pytest.raises(InputError, match=words):
        ca.surface("self-affine", **ROUGH | wrong)


@pytest.mark.parametrize("seed", [-1, 1.5, "x", True, None])
def test_a_seed_is_a_whole_number(seed):
    with pytest.raises(InputError, match="seed"):
        ca.surface("self-affine", **ROUGH).make(seed)


def test_what_is_known_beforehand_is_what_comes():
    maker = ca.surface("self-affine", **ROUGH | {"pixels": [64, 50]})
    known, surface = maker.expected(), maker.make()
    assert (known["nx"], known["ny"]) == surface.shape
    assert known["pixel_size"] == surface.pixel_size
    assert known["rms_slope"] == pytest.approx(surface.rms_slope, rel=1e-12)
    assert known["shortest_wavelength"] == pytest.approx(64 * 0.5 / 20)


# -- from a file ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "save"),
    [
        ("a.npy", lambda path: np.save(path, HEIGHTS)),
        ("fortran.npy", lambda path: np.save(path, np.asfortranarray(HEIGHTS))),
        ("big-endian.npy", lambda path: np.save(path, HEIGHTS.astype(">f8"))),
        ("blanks.txt", lambda path: np.savetxt(path, HEIGHTS.T)),
        ("tabs.dat", lambda path: np.savetxt(path, HEIGHTS.T, delimiter="\t", header="heights in nm\nx y")),
        ("commas.csv", lambda path: np.savetxt(path, HEIGHTS.T, delimiter=",")),
        ("UPPER.CSV", lambda path: np.savetxt(path, HEIGHTS.T, delimiter=", ")),
        ("semicolons.asc", lambda path: np.savetxt(path, HEIGHTS.T, delimiter=";", header="x", comments="% ")),
    ],
)
def test_every_format_gives_the_same_surface(folder, name, save):
    save(folder / name)
    surface = from_file(folder / name, pixel_size="0.45 nm").make()
    np.testing.assert_array_equal(surface.heights, HEIGHTS)
    assert surface.pixel_size == 0.45
    assert not surface.periodic


def test_single_precision_stays_single(folder):
    np.save("map.npy", HEIGHTS.astype(np.float32))
    assert from_file("map.npy", pixel_size=1).make().heights.dtype == np.float32


def test_whole_numbers_are_heights_too(folder):
    np.save("map.npy", np.arange(6, dtype=np.int16).reshape(2, 3))
    np.testing.assert_array_equal(from_file("map.npy", pixel_size=1).make().heights, [[0, 1, 2], [3, 4, 5]])


def test_a_text_file_can_state_its_pixel_size(folder):
    np.savetxt("map.txt", HEIGHTS, header="scan 12\npixel_size = 4.5 angstrom")
    assert from_file("map.txt").make().pixel_size == pytest.approx(0.45)
    assert from_file("map.txt", pixel_size="0.4501 nm").make().pixel_size == pytest.approx(0.4501)
    for kind in ("from-file", "measured"):
        with pytest.raises(
            InputError, match=r"pixel_size = 1 x 1 nm: .*map.txt states 0.45 x 0.45 nm; leave pixel_size"
        ):
            ca.surface(kind, path="map.txt", pixel_size="1 nm", height_unit="nm").make()
    # said of the file
    assert from_file("map.txt", reader={"kind": "text", "pixel_size": "1 nm"}).make().pixel_size == 1.0


def test_hdf5_states_pixel_size_and_period_in_attributes(folder):
    with h5py.File("map.h5", "w") as file:
        file.attrs["pixel_size"] = 9.0
        file["surface/heights"] = HEIGHTS
        file["surface/x"] = np.arange(5.0)
        file["surface"].attrs["pixel_size"] = "3 angstrom"
        file["surface"].attrs["periodic"] = True
    surface = from_file("map.h5").make()
    np.testing.assert_array_equal(surface.heights, HEIGHTS)
    assert surface.pixel_size == pytest.approx(0.3)
    assert surface.periodic
    assert not from_file("map.h5", periodic=False).make().periodic


def test_hdf5_with_several_maps_wants_a_name(folder):
    with h5py.File("two.h5", "w") as file:
        file["forward"], file["back/ward"] = HEIGHTS, 2 * HEIGHTS
    with pytest.raises(InputError, match=r"which dataset.*back/ward, forward"):
        from_file("two.h5", pixel_size=1).make()
    reader = {"kind": "hdf5", "dataset": "back/ward"}
    np.testing.assert_array_equal(from_file("two.h5", pixel_size=1, reader=reader).make().heights, 2 * HEIGHTS)
    with pytest.raises(StoreError, match=r"no dataset 'sideways'.*back/ward, forward"):
        from_file("two.h5", pixel_size=1, reader={"kind": "hdf5", "dataset": "sideways"}).make()


def test_height_unit_scales_and_detrend_levels(folder):
    x, y = np.meshgrid(np.arange(12), np.arange(9), indexing="ij")
    bumps = np.random.default_rng(1).standard_normal((12, 9))
    np.save("map.npy", bumps + 3 * x - 2 * y + 100)
    options = {"pixel_size": 1, "height_unit": "um"}
    raw = from_file("map.npy", **options).make().heights
    np.testing.assert_allclose(raw, 1000 * (bumps + 3 * x - 2 * y + 100), rtol=1e-12)
    np.testing.assert_allclose(from_file("map.npy", detrend="mean", **options).make().heights, raw - raw.mean())
    level = from_file("map.npy", detrend="plane", **options).make().heights
    design = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
    fit, *_ = np.linalg.lstsq(design, raw.ravel(), rcond=None)
    np.testing.assert_allclose(level, raw - (design @ fit).reshape(raw.shape), atol=1e-9)


def test_a_map_survives_the_trip_through_a_file(folder):
    surface = ca.surface("self-affine", **ROUGH).make(2)
    np.save("map.npy", surface.heights)
    again = from_file("map.npy", pixel_size=surface.pixel_size, periodic=True).make()
    np.testing.assert_array_equal(again.heights, surface.heights)
    assert again.rms_slope == surface.rms_slope


def test_an_edited_file_is_another_surface_with_another_identity(folder):
    np.save("map.npy", HEIGHTS)
    maker = from_file("map.npy", pixel_size=1)
    before, made = maker.digest(), maker.make().provenance
    assert maker.digest() == before
    np.save("map.npy", 2 * HEIGHTS)
    assert maker.digest() != before
    assert maker.make().provenance["file_blake2b"] != made["file_blake2b"]
    assert json.loads(json.dumps(made)) == made


def write(name, content):
    Path(name).write_bytes(content)


@pytest.mark.parametrize(
    ("name", "save", "error", "words"),
    [
        ("gone.npy", lambda name: None, StoreError, "gone.npy does not exist"),
        ("gone.txt", lambda name: None, StoreError, "gone.txt does not exist"),
        ("gone.h5", lambda name: None, StoreError, "gone.h5 does not exist"),
        ("empty.npy", lambda name: write(name, b""), StoreError, "not a numpy"),
        ("empty.txt", lambda name: write(name, b""), StoreError, "holds no numbers"),
        ("empty.h5", lambda name: write(name, b""), StoreError, "not an HDF5 file, or is truncated"),
        ("foreign.npy", lambda name: write(name, b"PK\x03\x04 something"), StoreError, "not a numpy"),
        ("foreign.txt", lambda name: write(name, bytes(range(128, 256))), StoreError, "not a text file"),
        ("foreign.h5", lambda name: write(name, b"1 2 3\n"), StoreError, "not an HDF5 file"),
        ("objects.npy", lambda name: np.save(name, np.array([[{}]]), allow_pickle=True), StoreError, "plain array"),
        ("words.npy", lambda name: np.save(name, np.array([["a", "b"]])), StoreError, "heights are real numbers"),
        ("complex.npy", lambda name: np.save(name, HEIGHTS + 1j), StoreError, "heights are real numbers"),
        ("line.npy", lambda name: np.save(name, HEIGHTS[0]), StoreError, "two dimensions"),
        ("cube.npy", lambda name: np.save(name, HEIGHTS[None]), StoreError, "two dimensions"),
        ("none.npy", lambda name: np.save(name, np.empty((0, 3))), StoreError, "two dimensions"),
        ("ragged.txt", lambda name: write(name, b"1 2 3\n4 5\n"), StoreError, "line 2: 2 columns where line 1 has 3"),
        (
            "word.txt",
            lambda name: write(name, b"1 2\n3 four\n"),
            StoreError,
            "column 2: 'four' is not a number",
        ),
        ("nan.txt", lambda name: write(name, b"1 2\n3 nan\n"), InputError, r"1 of 4 heights .* at pixel \(1, 1\)"),
        ("inf.npy", lambda name: np.save(name, HEIGHTS / 0.0), InputError, "35 of 35 heights"),
        ("map.nobody", lambda name: write(name, b"1 2\n"), StoreError, "no reader for files ending in '.nobody'"),
    ],
)
def test_files_that_are_no_height_maps_are_refused_in_words(folder, name, save, error, words):
    with np.errstate(divide="ignore"):
        save(name)
    with pytest.raises(error, match=words):
        from_file(name, pixel_size=1).make()


@pytest.mark.parametrize("name", ["map.npy", "map.h5"])
def test_a_truncated_file_is_refused_wherever_it_ends(folder, name):
    if name.endswith("npy"):
        np.save(name, HEIGHTS)
    else:
        with h5py.File(name, "w") as file:
            file["heights"] = HEIGHTS
    whole = Path(name).read_bytes()
    for size in [3, 8, 50, 100, len(whole) // 2, len(whole) - 8]:
        write("part" + Path(name).suffix, whole[:size])
        with pytest.raises(StoreError, match=r"truncated|not a numpy"):
            from_file("part" + Path(name).suffix, pixel_size=1).make()


def test_a_pixel_size_nobody_states_is_asked_for(folder):
    np.save("map.npy", HEIGHTS)
    with pytest.raises(InputError, match=r"pixel_size: map.npy does not state one"):
        from_file("map.npy").make()


def test_the_named_reader_is_used_whatever_the_ending(folder):
    np.savetxt("map.npy.txt.unknown", HEIGHTS, delimiter="|")
    reader = {"kind": "text", "delimiter": "|", "transpose": True}
    maker = from_file("map.npy.txt.unknown", pixel_size=1, reader=reader)
    np.testing.assert_array_equal(maker.make().heights, HEIGHTS)
    assert ca.plugin.fromdict("surface", maker.todict()) == maker
    with pytest.raises(InputError, match="did you mean 'text'"):
        from_file("map.txt", reader="txt")
    with pytest.raises(InputError, match="kind is required"):
        from_file("map.txt", reader={"delimiter": "|"})


def test_a_third_party_adds_a_format(folder, monkeypatch):
    (folder / "spam_reader.py").write_text(
        "import numpy as np\n"
        "from chemage import Surface\n"
        "from chemage.plugin import Reader\n"
        "class Spam(Reader):\n"
        "    kind = 'spam'\n"
        "    suffixes = ('.spam', '.npy')\n"
        "    def read(self, path):\n"
        "        return Surface(heights=np.ones((3, 4)), pixel_size=2.0, periodic=True)\n"
    )
    monkeypatch.syspath_prepend(folder)

    class Plugin:
        @staticmethod
        @hookimpl
        def chemage_register():
            return {"reader": {"spam": "spam_reader:Spam"}}

    with registry.using(registry.Registry()) as mine:
        mine.register(Plugin(), "spam")
        write("map.spam", b"spam")
        surface = from_file("map.spam").make()
        assert surface.shape == (3, 4)
        assert (surface.pixel_size, surface.periodic) == (2.0, True)
        with pytest.raises(InputError, match=r"pixel_size = 3 x 3 nm: map\.spam states 2 x 2 nm"):
            from_file("map.spam", pixel_size="3 nm").make()
        assert surface.provenance["reader"] == "spam"
        np.save("map.npy", HEIGHTS)
        assert from_file("map.npy", pixel_size=1).make().provenance["reader"] == "npy"  # chemage's own comes first
        with ca.prefer_plugins("spam"):
            assert from_file("map.npy", pixel_size=2).make().provenance["reader"] == "spam"
        assert from_file("map.npy", pixel_size=1, reader="npy").make().shape == (5, 7)


def test_files_are_checked_before_a_run(folder):
    np.save("map.npy", HEIGHTS)
    maker = from_file("map.npy", pixel_size=0.5)
    slope = maker.make().rms_slope
    assert maker.expected() == {"nx": 5, "ny": 7, "pixel_size": 0.5, "periodic": 0.0, "rms_slope": slope}
    with pytest.raises(StoreError, match="does not exist"):
        from_file("gone.npy", pixel_size=0.5).expected()


def test_the_error_of_coarse_pixels_grows_as_the_square_of_the_rim():
    maker = ca.surface("self-affine", pixels=256, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=16)
    wide = {factor: maker.coarser_errors(factor, {"perimeter_to_area": 0.5})["beta"] for factor in (2, 4)}
    assert wide[4] == pytest.approx(4 * wide[2])
    assert 0.001 < wide[2] < 0.01
    assert maker.coarser_errors(2, {"perimeter_to_area": 0.25})["beta"] == pytest.approx(wide[2] / 4)
    assert maker.coarser_errors(2, {}) == maker.coarser_errors(2, {"perimeter_to_area": float("nan")})


@pytest.mark.parametrize(("hurst", "zeta", "eta", "load"), [(0.8, 24, 1, 2e3), (0.5, 20, 3, 8e3)])
def test_the_rim_that_is_foreseen_is_that_of_a_contact(hurst, zeta, eta, load):
    """Within 25 %: it was fitted to other contacts, 3 % from most and 20 % from some."""
    maker = ca.surface("self-affine", pixels=384, pixel_size=0.45, rms_slope=0.1, hurst=hurst, zeta=zeta, eta=eta)
    made = ca.contact("fft-bem", modulus=35.3).solve(maker.make(4), load).summary()
    error = maker.coarser_errors(2, {"area_fraction": made["area_fraction"]})["beta"]
    exact = maker.coarser_errors(2, {"perimeter_to_area": made["perimeter_to_area"]})["beta"]
    assert (error / exact) ** 0.5 == pytest.approx(1, rel=0.25)


def test_a_sketch_is_the_same_surface_on_two_pixels_per_shortest_wave():
    maker = ca.surface("self-affine", pixels=(256, 512), pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=40)
    sketch = maker.sketch()
    assert sketch is not None
    assert sketch.pixels == (45, 90)
    fine, made = maker.make(3), sketch.make(3)
    # the waves are the same: their amplitudes on both grids
    waves = [np.fft.fft2(one.heights)[:20, :20] / one.heights.size for one in (fine, made)]
    assert waves[1] == pytest.approx(waves[0], rel=1e-9, abs=1e-12)
    assert ca.surface("self-affine", pixels=64, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=31).sketch() is None


def test_a_bare_table_has_one_scan_line_per_line(folder):
    """As instruments write them; arrays with the size of their pixels are read as they are."""
    np.savetxt("bare.txt", HEIGHTS)
    np.savetxt("array.txt", HEIGHTS, header="pixel_size = 0.45 nm")
    for path, is_array in (("bare.txt", False), ("array.txt", True)):
        for transpose in (False, True):
            reader = {"kind": "text", "transpose": transpose}
            made = ca.surface("measured", path=path, height_unit="nm", pixel_size=0.45, reader=reader).make()
            np.testing.assert_array_equal(made.heights, HEIGHTS if is_array != transpose else HEIGHTS.T)
            lines = {"lines": "along y" if transpose else "along x"}
            assert {k: v for k, v in made.provenance["steps"][0].items() if k == "lines"} == ({} if is_array else lines)


def test_a_list_of_points_in_a_text_is_no_image(folder):
    x, y = np.divmod(np.arange(30.0), 5)
    np.savetxt("points.txt", np.column_stack([x, y, np.sin(x) + y]))
    options = {"path": "points.txt", "height_unit": "nm", "pixel_size": 1.0}
    with pytest.raises(InputError, match=r"three columns and no header, .*reader = \"xyz\""):
        ca.surface("measured", **options).make()
    made = ca.surface("measured", reader="xyz", **options).make()
    np.testing.assert_allclose(made.heights, (np.sin(x) + y).reshape(6, 5))
