"""Files of other formats: `chemage.read` and the surface maker from-file look up their reader in one place."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from instrument_files import gwy, netcdf, x3p

import chemage
import chemage as ca
from chemage import InputError
from chemage.plugin import PluginError, StoreError, hookimpl, reader_for, registry

# of the reader that cannot be imported
pytestmark = pytest.mark.filterwarnings("ignore:left out. reader 'gone'")


class Rival:
    """A plugin whose reader also accepts .npy, and one that cannot be imported."""

    @staticmethod
    @hookimpl
    def chemage_register():
        return {"reader": {"rival": "rival_reader:Rival", "gone": "no_such_module_xyz:Gone"}}


class Third:
    """Another plugin, whose reader accepts what the rival's does."""

    @staticmethod
    @hookimpl
    def chemage_register():
        return {"reader": {"third": "rival_reader:Third"}}


@pytest.fixture
def rival(tmp_path, monkeypatch):
    (tmp_path / "rival_reader.py").write_text(
        "from chemage import Surface\nfrom chemage.plugin import Reader\n"
        "class Rival(Reader):\n"
        "    kind = 'rival'\n"
        "    suffixes = ('.npy', '.riv', '.both')\n"
        "    def read(self, path):\n"
        "        return Surface(heights=[[1.0, 2.0]], pixel_size=1.0)\n"
        "class Third(Rival):\n"
        "    kind = 'third'\n"
        "    suffixes = ('.both',)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    with registry.using(registry.Registry()) as mine:
        mine.register(Rival(), "rival")
        mine.register(Third(), "third-party")
        yield mine


def refusal(call, error):
    with pytest.raises(error) as caught:
        call()
    return str(caught.value)


def both(path):
    """The two ways to read a surface from ``path``."""
    return (lambda: chemage.read(path)), chemage.surface("from-file", path=str(path)).make


@pytest.mark.parametrize(("name", "error"), [("map.nobody", StoreError), ("map", StoreError), ("map.both", InputError)])
def test_both_ways_give_the_same_error(rival, tmp_path, name, error):
    (tmp_path / name).write_bytes(b"\0\1 in no known format")
    by_read, by_maker = (refusal(call, error) for call in both(tmp_path / name))
    assert by_read == by_maker == refusal(lambda: reader_for(tmp_path / name), error)
    assert str(tmp_path / name) in by_read


def test_both_ways_give_the_same_surface(rival, tmp_path):
    (tmp_path / "map.riv").write_text("anything")
    by_read, by_maker = (call() for call in both(tmp_path / "map.riv"))
    assert np.array_equal(by_read.heights, by_maker.heights)
    assert type(reader_for(tmp_path / "map.RIV")).__name__ == "Rival"


def test_a_reader_that_cannot_be_imported_does_not_stop_the_others(rival, tmp_path):
    with pytest.raises(PluginError, match="no_such_module_xyz"):
        registry.current().component("reader", "gone")
    with pytest.warns(UserWarning, match="left out: reader 'gone' of plugin 'rival'"):
        assert reader_for("map.txt").kind == "text"
    assert [problem for problem in registry.current().check() if "no_such_module_xyz" in problem]


def test_a_reader_of_a_plugin_does_not_replace_chemages_own_unless_it_is_preferred(rival, tmp_path, monkeypatch):
    np.save(tmp_path / "map.npy", np.ones((3, 3)))
    maker = chemage.surface("from-file", path=str(tmp_path / "map.npy"), pixel_size=1.0)
    assert chemage.make_surface(maker).shape == (3, 3)
    assert chemage.make_surface(maker).plugins == {}
    assert reader_for("map.npy").kind == "npy"
    with chemage.prefer_plugins("rival"):
        assert reader_for("map.npy").kind == "rival"
        preferred = chemage.make_surface(maker)
    assert preferred.shape == (1, 2)
    assert list(preferred.plugins) == ["rival"]
    monkeypatch.setenv("CHEMAGE_PREFER", "rival")
    assert reader_for("map.npy").kind == "rival"


def test_of_two_plugins_for_one_ending_none_comes_first_unless_one_is_preferred(rival):
    said = refusal(lambda: reader_for("map.both"), InputError)
    assert "the readers rival, third all read .both; give reader = ..." in said
    assert "prefer the plugin of one of them (rival, third-party)" in said
    with chemage.prefer_plugins("third-party", "rival"):
        assert reader_for("map.both").kind == "third"
    with chemage.prefer_plugins("rival", "third-party"):
        assert reader_for("map.both").kind == "rival"


def test_shared_endings_are_reported_with_what_is_used_and_how_to_change_it(rival, command):
    def notes():
        said = " ".join(" ".join(command("plugins", "check")[1:]).split())
        return [note for note in said.split("note: ") if "all read" in note]

    none, own = notes()
    assert none.startswith("the readers 'rival' (Rival) and 'third' (Third) all read .both; none is used by default")
    assert "all read .npy; 'npy' is used, because it comes with chemage" in own
    assert 'write reader = "rival" where the file is named, or write prefer = ["rival"] below [plugins]' in own
    with chemage.prefer_plugins("rival"):
        assert all("'rival' is used, because its plugin is preferred" in note for note in notes())


HEIGHTS = np.random.default_rng(4).normal(size=(6, 5))


@pytest.mark.parametrize(("unit", "in_nm"), [("um", 1e3), ("nm", 1.0), ("m", 1e9), (None, 1.0)])
def test_heights_are_in_the_unit_that_their_file_states(tmp_path, unit, in_nm):
    attributes = {} if unit is None else {"units": unit}
    xr.DataArray(HEIGHTS / in_nm, attrs=attributes | {"pixel_size": 2.0}, name="z").to_netcdf(
        tmp_path / "map.nc", engine="h5netcdf"
    )
    rows = "\n".join(" ".join(map(repr, row)) for row in (HEIGHTS / in_nm).tolist())
    comment = "" if unit is None else f"# Channel: Height\n# Value units: {unit}\n"
    (tmp_path / "map.txt").write_text(f"{comment}# pixel_size = 2 nm\n{rows}\n")
    for name in ("map.nc", "map.txt"):
        path = str(tmp_path / name)
        assert np.allclose(ca.surface("from-file", path=path).make().heights, HEIGHTS, rtol=1e-9)
        # what the user states comes before what the file states
        assert np.allclose(ca.surface("from-file", path=path, height_unit="nm").make().heights, HEIGHTS / in_nm)
        measured = {"height_unit": "nm"} if unit is None else {}
        made = ca.surface("measured", path=path, spikes="keep", **measured).make().heights
        assert np.allclose(made - made.mean(), HEIGHTS - HEIGHTS.mean(), rtol=1e-6, atol=1e-9)


def test_packed_heights_are_unpacked(tmp_path):
    file = tmp_path / "packed.nc"
    packing = {"dtype": "i2", "scale_factor": 1e-4, "add_offset": 0.5, "_FillValue": -9999}
    data = xr.DataArray(HEIGHTS / 1e3, attrs={"units": "um", "pixel_size": 2.0}, name="z")
    data.to_netcdf(file, engine="h5netcdf", encoding={"z": packing})
    assert np.abs(ca.surface("from-file", path=str(file)).make().heights - HEIGHTS).max() < 0.051
    data[2, 3] = np.nan
    data.to_netcdf(file, engine="h5netcdf", encoding={"z": packing})
    with pytest.raises(InputError, match=r"1 of 30 heights are missing .* \(2, 3\)"):
        ca.surface("from-file", path=str(file)).make()


def test_a_unit_of_heights_that_is_no_length_is_refused(tmp_path):
    file = tmp_path / "map.nc"
    xr.DataArray(HEIGHTS, attrs={"units": "V", "pixel_size": 2.0}, name="z").to_netcdf(file, engine="h5netcdf")
    with pytest.raises(StoreError, match=r"states the unit of its heights: .* is a quantity of volt"):
        ca.surface("from-file", path=str(file)).make()


def test_masked_heights_of_a_reader_are_missing():
    image = ca.plugin.HeightMap(np.ma.masked_less(HEIGHTS, -1.0), 1.0, (2.0, 2.0))
    assert np.isnan(image.heights).tolist() == (HEIGHTS < -1.0).tolist()


def saved(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_the_content_selects_the_reader_before_the_ending(tmp_path):
    np.save(tmp_path / "map.npy", HEIGHTS)
    array = (tmp_path / "map.npy").read_bytes()
    xr.DataArray(HEIGHTS, name="z").to_netcdf(tmp_path / "map.nc", engine="h5netcdf")
    hdf5 = (tmp_path / "map.nc").read_bytes()
    for name in ("map.txt", "map.nobody", "map", "map.x3p"):
        assert reader_for(saved(tmp_path / name, array)).kind == "npy"
        assert reader_for(saved(tmp_path / name, hdf5)).kind == "hdf5"
    assert reader_for(saved(tmp_path / "map.dat", "1 2\n3 4\n")).kind == "text"
    assert reader_for(saved(tmp_path / "map.dat", b"\x88\x1b\x03\x6f\0\1\0\0")).kind == "topography"
    # a damaged file goes to the reader of its ending, which says what is wrong
    assert reader_for(saved(tmp_path / "map.npy", b"\x93NUMPX" + array[6:])).kind == "npy"


GERMAN = (
    "# Kanal: Topografie\n# Breite: 12,34 µm\n# Höhe: 5678,9 nm\n# Value units: m\n1 1.5 3\n-2 -3 -6\n0 0 0\n9 9 9\n"
)
PHASE = "h=2 w=3\npixel size=4e-007 m\ndata unit=rad\nheight conversion factor (-> m)=2e-008\n1 2 3\n4 5 6\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_headers_of_instruments_state_units_sides_and_orientation(tmp_path, encoding, ends):
    image = reader_for(path := saved(tmp_path / "a.txt", GERMAN.replace("\n", ends).encode(encoding))).height_map(path)
    assert image.heights.tolist() == [[1, -2, 0, 9], [1.5, -3, 0, 9], [3, -6, 0, 9]]
    assert image.height_unit == pytest.approx(1e9)
    assert image.pixel_size == pytest.approx((12340 / 3, 5678.9 / 4))
    assert image.notes == {"channel": "Topografie"}
    image = reader_for(path := saved(tmp_path / "b.txt", PHASE.replace("\n", ends).encode(encoding))).height_map(path)
    assert np.allclose(image.heights * image.height_unit, 20 * np.array([[1, 4], [2, 5], [3, 6]]))
    assert image.pixel_size == pytest.approx((400, 400))


def test_a_header_that_contradicts_its_rows_is_refused(tmp_path):
    path = saved(tmp_path / "b.txt", PHASE.replace("w=3", "w=4"))
    with pytest.raises(StoreError, match="states 4 x 2 pixels, but holds 3 columns and 2 rows"):
        ca.read(path)


def test_decimal_commas_beside_another_separator(tmp_path):
    path = saved(tmp_path / "a.csv", "# pixel_size = 2 nm\n1,5;2,5\n-3,5e1;4,0\n")
    assert ca.read(path).heights.tolist() == [[1.5, 2.5], [-35.0, 4.0]]


def damaged(content, random):
    """The content with its first 200 bytes altered: bits, a cut, or numbers and units replaced."""
    content = bytearray(content)
    place = int(random.integers(min(len(content), 200)))
    match random.integers(4):
        case 0:
            content[place] ^= 1 << int(random.integers(8))
        case 1:
            del content[place:]
        case 2:
            words = [b"99999999999", b"-1", b"0", b"nan", b"1e999", b" V", b" um", b"="]
            content[place : place + 3] = words[random.integers(len(words))]
        case _:
            content[place : place + 8] = b"\xff" * 8
    return bytes(content)


@pytest.mark.parametrize("count", [100, pytest.param(500, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["german", "phase", "npy", "hdf5", "gwy", "x3p", "netcdf", "xyz"])
def test_damaged_headers_give_a_map_or_one_clear_error(tmp_path, kind, count):
    np.save(tmp_path / "a.npy", HEIGHTS)
    data = xr.DataArray(HEIGHTS, attrs={"units": "um", "pixel_size": 2.0}, name="z")
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    whole = {
        "german": GERMAN.encode(),
        "phase": PHASE.encode(),
        "npy": (tmp_path / "a.npy").read_bytes(),
        "hdf5": (tmp_path / "a.nc").read_bytes(),
        "gwy": gwy(HEIGHTS),
        "x3p": x3p(HEIGHTS),
        "netcdf": netcdf(HEIGHTS),
        "xyz": "\n".join(f"{i} {j} {value}" for (i, j), value in np.ndenumerate(HEIGHTS)).encode(),
    }[kind]
    reader = registry.current().component("reader", "text" if kind in ("german", "phase") else kind)()
    random = np.random.default_rng(1)
    for _ in range(count):
        path = saved(tmp_path / "damaged", damaged(whole, random))
        try:
            size, said = reader.height_map(path).heights.size, str(path)
        except ca.ChemageError as error:
            size, said = 0, str(error)
        assert size <= 60
        assert str(path) in said
