"""Formats of instruments that are read without a further library: bytes written by hand, and that library's files."""

from __future__ import annotations

import numpy as np
import pytest
from instrument_files import gwy, netcdf, x3p

import chemage as ca
from chemage import InputError
from chemage.plugin import StoreError, reader_for
from chemage_surfaces import Topography

NX, NY = 6, 5
HEIGHTS = np.random.default_rng(4).normal(size=(NX, NY)) * 1e-9
ALL = {"gwy": gwy, "x3p": x3p, "netcdf": netcdf}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def image_of(content, name="image.any", **options):
    with open(name, "wb") as file:
        file.write(content)
    reader = reader_for(name)
    return (reader.replace(**options) if options else reader).height_map(name)


@pytest.mark.parametrize("kind", ALL)
def test_content_selects_the_reader_and_every_pixel_is_in_its_place(kind):
    image = image_of(ALL[kind](HEIGHTS))
    assert reader_for("image.any").kind == kind
    np.testing.assert_allclose(image.heights * image.height_unit, 1e9 * HEIGHTS, rtol=1e-12)
    assert image.pixel_size == pytest.approx((2.0, 2.0))
    assert not image.periodic
    surface = ca.surface("from-file", path="image.any").make()
    np.testing.assert_allclose(surface.heights, 1e9 * HEIGHTS, rtol=1e-12)


@pytest.mark.parametrize("name", ["image.gwy", "image.x3p", "image.nc"])
@pytest.mark.parametrize("gap", [False, True])
def test_files_of_the_library_are_read_as_it_reads_them(name, gap):
    library = pytest.importorskip("SurfaceTopography")
    heights = np.ma.masked_array(HEIGHTS * 1e9, np.zeros(HEIGHTS.shape, bool))
    if gap:
        heights[1, 2] = np.ma.masked
        if name.endswith("gwy"):
            pytest.skip("the library writes no masks into it")
    image = library.Topography(heights, (NX * 0.5, NY * 0.25), unit="µm", periodic=False)
    {".gwy": image.to_gwy, ".x3p": image.to_x3p, ".nc": image.to_netcdf}[name[5:]](name)
    assert reader_for(name).kind != "topography"
    own, other = reader_for(name).height_map(name), Topography().height_map(name)
    assert own.heights.shape == other.heights.shape
    np.testing.assert_allclose(own.heights * own.height_unit, other.heights * other.height_unit, rtol=1e-12)
    np.testing.assert_allclose(own.pixel_size, other.pixel_size, rtol=1e-12)
    assert own.periodic == other.periodic


def test_masked_points_of_gwyddion_are_missing_and_channels_are_named():
    mask = np.zeros(HEIGHTS.shape, bool)
    mask[4, 1] = True
    image = image_of(gwy(HEIGHTS, mask=mask))
    assert np.argwhere(np.isnan(image.heights)).tolist() == [[4, 1]]
    assert image.notes == {"format": "gwy", "channel": "Height"}
    assert image_of(gwy(HEIGHTS), channel="Height").heights.shape == (NX, NY)
    with pytest.raises(InputError, match=r"channel = 'Amplitude': .*no such channel of heights \(Height\)"):
        image_of(gwy(HEIGHTS), channel="Amplitude")
    with pytest.raises(InputError, match=r"no such channel of heights \(none\)"):
        image_of(gwy(HEIGHTS, unit="V"))


def test_points_of_x3p_may_be_invalid_whole_numbers_or_in_the_record():
    valid = np.ones(HEIGHTS.shape, bool)
    valid[2, 3] = False
    image = image_of(x3p(HEIGHTS, valid=valid, sides=(1e-6, 3e-6)))
    assert np.argwhere(np.isnan(image.heights)).tolist() == [[2, 3]]
    assert image.pixel_size == pytest.approx((1000, 3000))
    whole = image_of(x3p(np.arange(30.0).reshape(NX, NY), kind="I", scale=1e-9))
    np.testing.assert_allclose(whole.heights * whole.height_unit, np.arange(30).reshape(NX, NY))
    inline = image_of(x3p(HEIGHTS, inline=True))
    np.testing.assert_array_equal(inline.heights, HEIGHTS)
    with pytest.raises(InputError, match="holds no image, but 'PRF'"):
        image_of(x3p(HEIGHTS, feature="PRF"))


def test_an_archive_that_is_larger_than_it_says_or_defines_entities_is_refused():
    content = x3p(HEIGHTS).replace(b"<SizeX>6<", b"<SizeX>5<")
    with pytest.raises(StoreError, match=r"image\.any is damaged"):
        image_of(content)
    import io
    import zipfile

    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("main.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>')
    with pytest.raises(StoreError, match="its XML defines entities"):
        image_of(file.getvalue())


def test_packed_heights_and_fill_values_of_netcdf():
    heights = np.arange(30.0).reshape(NX, NY)
    heights[3, 3] = -999
    image = image_of(netcdf(heights, unit="um", scale_factor=0.5, add_offset=2.0, _FillValue=-999.0))
    assert np.argwhere(np.isnan(image.heights)).tolist() == [[3, 3]]
    assert image.heights[2, 1] == 0.5 * 11 + 2
    assert image.height_unit == 1000
    with pytest.raises(InputError, match=r"variable = 'depth': .*these of two dimensions: height; give one"):
        image_of(netcdf(heights), variable="depth")


def test_netcdf_4_has_its_pixels_from_its_coordinates():
    import xarray

    coordinates = {"x": ("x", 3.0 * np.arange(NX), {"units": "nm"}), "y": ("y", -2.0 * np.arange(NY), {"units": "nm"})}
    data = xarray.DataArray(HEIGHTS, dims=("x", "y"), coords=coordinates, attrs={"units": "m"}, name="z")
    data.to_netcdf("image.nc", engine="h5netcdf")
    image = reader_for("image.nc").height_map("image.nc")
    assert image.pixel_size == pytest.approx((3.0, 2.0))


def test_points_in_any_order_make_a_grid_with_gaps():
    i, j = np.indices((NX, NY))
    table = np.column_stack([0.5 * i.ravel() + 7, 0.25 * j.ravel() - 1, HEIGHTS.ravel() * 1e9])
    order = np.random.default_rng(1).permutation(len(table))
    np.savetxt("image.xyz", table[order][1:], fmt="%.9g")
    image = reader_for("image.xyz").replace(unit="um").height_map("image.xyz")
    wanted = HEIGHTS.copy()
    wanted[i.ravel()[order[0]], j.ravel()[order[0]]] = np.nan
    np.testing.assert_allclose(image.heights, 1e9 * wanted, rtol=1e-8)
    assert image.pixel_size == pytest.approx((500, 250))
    for rows, words in (
        (table[:, :2], "holds 2 columns; a list of points has three"),
        (table[:1], "all points have one x"),
        (table + [[0.1 * (k % 3 == 0), 0, 0] for k in range(30)], "30 points are no grid of 27 x 5"),
        (table + [[0.123 * (k == 7), 0, 0] for k in range(30)], "along x are not evenly spaced"),
    ):
        np.savetxt("image.xyz", rows)
        with pytest.raises(StoreError, match=words):
            reader_for("image.xyz").height_map("image.xyz")
