"""Files of other programs, read with SurfaceTopography: units, orientation, gaps, channels."""

from __future__ import annotations

import builtins
import json
import re
from pathlib import Path

import instrument_files
import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import PluginError, StoreError
from chemage_surfaces import Topography

NX, NY = 12, 8
#: µm, without symmetry; pixels of 0.5 x 0.25 µm
HEIGHTS = np.add.outer(0.01 * np.arange(NX), 0.003 * np.arange(NY) ** 2)
HEIGHTS[2, 1] += 0.02
SIZES = (NX * 0.5, NY * 0.25)


@pytest.fixture
def library():
    return pytest.importorskip("SurfaceTopography")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def of_library(library, name, heights=HEIGHTS):
    image = library.Topography(heights, SIZES, unit="µm", periodic=False)
    writers = {".nc": image.to_netcdf, ".x3p": image.to_x3p, ".gwy": image.to_gwy, ".asc": image.to_matrix}
    writers[name[name.index(".") :]](name)


def sdf(library, name):
    Path(name).write_bytes(instrument_files.sdf(1e-6 * HEIGHTS, (5e-7, 2.5e-7)))


def gwyddion_text(library, name):
    """The text that Gwyddion exports: rows of pixels from the top, heights in m."""
    header = f"# Channel: Height\n# Width: {SIZES[0]} µm\n# Height: {SIZES[1]} µm\n# Value units: m\n"
    rows = "\n".join("\t".join(f"{1e-6 * value:.10e}" for value in HEIGHTS[:, j]) for j in range(NY))
    with open(name, "w", encoding="utf-8") as file:
        file.write(header + rows + "\n")


def points(library, name):
    x, y = np.indices((NX, NY)) * np.array([0.5, 0.25])[:, None, None]
    np.savetxt(name, np.column_stack([x.ravel(), y.ravel(), HEIGHTS.ravel()]))


def matlab(library, name):
    from scipy.io import savemat

    savemat(name, {"map": HEIGHTS})


FORMATS = {
    "image.nc": (of_library, {}),
    "image.x3p": (of_library, {}),
    "image.gwy": (of_library, {}),
    "image.asc": (of_library, {}),
    "image.sdf": (sdf, {}),
    "gwyddion.txt": (gwyddion_text, {}),
    "image.xyz": (points, {"unit": "um"}),
}


@pytest.mark.parametrize("name", FORMATS)
def test_units_and_orientation(library, name):
    """x is the first index, nothing is mirrored, lengths are in nm; text files of Gwyddion begin at the top."""
    write, options = FORMATS[name]
    write(library, name)
    image = Topography(**options).height_map(name)
    heights = image.heights * image.height_unit
    wanted = 1000 * HEIGHTS
    if heights.shape == wanted.shape and not np.allclose(heights, wanted, atol=1e-6):
        wanted = wanted[:, ::-1]  # y upwards instead of downwards
        assert name == "gwyddion.txt"
    np.testing.assert_allclose(heights, wanted, atol=1e-6)
    np.testing.assert_allclose(image.pixel_size, [500, 250], rtol=1e-9)
    assert not image.periodic
    surface = ca.surface(
        "measured", path=name, reader={"kind": "topography", **options}, resample="250 nm", spikes="keep"
    ).make()
    assert surface.shape == (2 * NX, NY)
    assert surface.heights.mean() == pytest.approx(wanted.mean())
    assert surface.provenance["steps"][0]["format"]


@pytest.mark.parametrize("name", ["image.x3p", "image.sdf", "image.gwy"])
def test_the_ending_selects_the_reader(library, name):
    FORMATS[name][0](library, name)
    assert ca.plugin.reader_for(name).kind == {".sdf": "topography"}.get(name[-4:], name[-3:])
    with pytest.raises(InputError, match=r'pixels of 500 x 250 nm are not square.*resample = "250 nm"'):
        ca.read(name)


def test_endings_of_chemage_stay_its_own():
    own = {
        ending
        for kind in ("npy", "text", "hdf5")
        for ending in ca.plugin.registry.current().component("reader", kind).suffixes
    }
    # .dat is a text, or a binary file of an interferometer: the content tells
    assert own & set(Topography.suffixes) == {".dat"}


def test_endings_are_those_of_the_library(library):
    from SurfaceTopography.IO import readers

    known = {f".{ending.lower()}" for reader in readers for ending in reader.file_extensions()}
    assert set(Topography.suffixes) <= known


@pytest.mark.parametrize("name", ["image.mat", "image.xyz"])
def test_a_file_without_units_asks_for_them(library, name):
    (matlab if name.endswith("mat") else points)(library, name)
    with pytest.raises(InputError, match=r'height_unit, pixel_size: .* does not state them; give them, such as .*"um"'):
        ca.surface("measured", path=name).make()
    given = ca.surface("measured", path=name, height_unit="um", pixel_size=["0.5 um", "0.25 um"], resample="250 nm")
    assert given.replace(spikes="keep").make().shape == (2 * NX, NY)


def test_missing_heights_are_gaps(library):
    gaps = np.ma.masked_array(HEIGHTS, np.zeros(HEIGHTS.shape, bool))
    gaps.mask[3, 4] = True
    of_library(library, "image.x3p", gaps)
    image = Topography().height_map("image.x3p")
    assert np.argwhere(np.isnan(image.heights)).tolist() == [[3, 4]]
    with pytest.raises(InputError, match=r'1 of 96 heights .*\(3, 4\).*surface "measured" and missing = "interpolate"'):
        ca.read("image.x3p")


def test_channels_are_named(library):
    of_library(library, "image.gwy")
    with pytest.raises(
        InputError, match=r"channel = 'Phase': .* no such image of heights \(channels of heights: Topography"
    ):
        Topography(channel="Phase").height_map("image.gwy")
    assert Topography(channel="Topography").height_map("image.gwy").notes["channel"] == "Topography"


def test_a_line_scan_is_no_image(library):
    np.savetxt("line.xyz", np.column_stack([np.arange(30.0), np.sin(np.arange(30.0))]))
    with pytest.raises(InputError, match="holds no image of heights, but a line scan"):
        Topography().height_map("line.xyz")


def test_what_is_no_image_is_refused(library):
    for name, content in {"empty.x3p": b"", "other.gwy": b"\x89 something else" * 50}.items():
        with open(name, "wb") as file:
            file.write(content)
        with pytest.raises(StoreError, match=rf"{re.escape(name)} is in no format that SurfaceTopography reads"):
            Topography().height_map(name)
    of_library(library, "image.x3p")
    with open("image.x3p", "rb") as file:
        content = file.read()
    with open("part.x3p", "wb") as file:
        file.write(content[: len(content) // 2])
    with pytest.raises(StoreError, match=r"part\.x3p is in no format"):
        Topography().height_map("part.x3p")


def test_without_the_library_it_says_how_to_install_it(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.partition(".")[0] == "SurfaceTopography":
            raise ImportError("No module named 'SurfaceTopography'", name="SurfaceTopography")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with open("image.opd", "wb") as file:
        file.write(b"anything")
    with pytest.raises(PluginError, match=r"image\.opd: .*not installed; pip install 'chemage\[topographies\]'"):
        ca.surface("measured", path="image.opd").make()


FILES = Path(__file__).parents[1] / "data" / "topographies"


@pytest.mark.parametrize(
    "wanted", json.loads((FILES / "read_by_SurfaceTopography.json").read_text()), ids=lambda w: w["file"]
)
def test_files_of_instruments_are_read_as_the_library_reads_them(library, wanted):
    image = ca.plugin.reader_for(FILES / wanted["file"]).height_map(FILES / wanted["file"])
    in_nm = ca.plugin.convert(f"1 {wanted['unit']}", "nm")
    assert list(image.heights.shape) == wanted["shape"]
    sizes = [count * side for count, side in zip(image.heights.shape, image.pixel_size, strict=True)]
    assert sizes == pytest.approx([size * in_nm for size in wanted["size"]])
    assert np.isnan(image.heights).sum() == wanted["missing"]
    assert np.nanstd(image.heights) * image.height_unit == pytest.approx(wanted["rms_height"] * in_nm)


def test_text_of_gwyddion_equals_the_library_element_by_element(library):
    name = FILES / "gwyddion-export-german.txt"
    own, other = (reader.height_map(name) for reader in (ca.plugin.reader_for(name), Topography()))
    assert ca.plugin.reader_for(name).kind == "text"
    np.testing.assert_array_equal(own.heights * own.height_unit, other.heights * other.height_unit)
