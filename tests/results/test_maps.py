"""Parts of stored maps."""

from __future__ import annotations

import numpy as np
import pytest
from seen import window_figure

import chemage


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """A contact whose maps are stored in several squares, and its file."""
    rng = np.random.default_rng(5)
    pressure = np.where(rng.random((1300, 1750)) < 0.05, rng.random((1300, 1750)), 0.0)
    gap = np.where(pressure > 0, 0.0, rng.random((1300, 1750)))
    contact = chemage.ContactSolution(
        pressure=pressure, gap=gap, load=float(pressure.sum()) * 4.0, pixel_size=2.0, modulus=35.3
    )
    path = tmp_path_factory.mktemp("large") / "large.h5"
    chemage.write(path, contact)
    return contact, path


def slices(start, stop, step=None):
    return slice(start, stop, step)


@pytest.mark.parametrize(
    "part",
    [
        (slices(0, 1300), slices(0, 1750)),
        (slices(500, 530), slices(1000, 1600)),
        (slices(None, None, 7), slices(None, None, 16)),
        (slices(3, 1299, 600), slices(1749, 1750)),
        (slices(-10, None), slices(-5, -1)),
        (slices(1000, 5000), slices(0, 3)),
        (slices(20, 10), slices(0, 3)),
        (slices(0, 3), slices(1750, 1760)),
    ],
)
def test_a_part_is_that_of_the_whole(large, part):
    contact, path = large
    with chemage.open_maps(path) as maps:
        assert list(maps) == ["contact/pressure", "contact/gap"]
        pressure = maps["contact/pressure"]
        assert (pressure.shape, pressure.pixel_size, pressure.unit) == ((1300, 1750), 2.0, "GPa")
        found = pressure[part]
        assert found.dtype == contact.pressure.dtype
        assert np.array_equal(found, contact.pressure[part])
        assert np.array_equal(maps["contact/gap"][part], contact.gap[part])


def test_large_maps_are_stored_in_squares(large):
    import h5py

    _, path = large
    with h5py.File(path) as file:
        assert file["contact/pressure"].chunks == file["contact/gap"].chunks == (512, 512)


@pytest.mark.parametrize("part", [3, (1, 2), slice(0, 3), (slice(0, 3), 2), (slice(0, 3, -1), slice(0, 3)), ...])
def test_what_is_no_part_is_refused(large, part):
    with chemage.open_maps(large[1]) as maps, pytest.raises(chemage.InputError, match="two slices"):
        maps["contact/pressure"][part]


def test_a_damaged_file_is_not_opened(large, tmp_path):
    content = bytearray(large[1].read_bytes())
    content[len(content) // 2] ^= 1
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(content)
    with pytest.raises(chemage.plugin.DamagedError), chemage.open_maps(damaged):
        pass


def test_what_has_no_maps_is_refused(tmp_path):
    history = chemage.plugin.BondHistory(
        hold_times=[1.0], bonds=[0], formed=[0], broken=[0], state=[False], time=1.0, temperature=1.0, engine=""
    )
    chemage.write(tmp_path / "history.h5", history)
    with pytest.raises(chemage.plugin.StoreError, match="holds no map"), chemage.open_maps(tmp_path / "history.h5"):
        pass
    with pytest.raises(chemage.plugin.StoreError, match="does not exist"), chemage.open_maps(tmp_path / "none.h5"):
        pass


def shown(figure):
    return [axes.images[0] for axes in figure.axes if axes.images and axes.get_title()]


def test_a_window_shows_the_pixels_it_touches(large):
    contact, path = large
    pressure, gap = shown(window_figure(path, "101 300 2 0.5um"))
    assert pressure.get_extent() == gap.get_extent() == [100, 300, 2, 500]
    assert np.array_equal(np.ma.filled(pressure.get_array(), 0.0).T, contact.pressure[50:150, 1:250])
    assert np.array_equal(gap.get_array().T, contact.gap[50:150, 1:250])


@pytest.mark.parametrize(
    "window", ["", "1 2 3", "0 1 0 1 1", "5 5 0 1", "3 1 0 1", "0 1 -1 1", "0 2601 0 1", "0 nan 0 1", "0 1 0 1kg"]
)
def test_a_window_outside_is_refused(large, window):
    with pytest.raises(chemage.ChemageError, match=r"window|unit|kg"):
        window_figure(large[1], window)
