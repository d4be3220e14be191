"""Files of other formats: `chemage.read` and the surface maker from-file look up their reader in one place."""

from __future__ import annotations

import numpy as np
import pytest

import chemage
import chemage_surfaces
from chemage import InputError, PluginError, StoreError, hookimpl, reader_for, registry


class Rival:
    """A plugin whose reader also accepts .npy, and one that cannot be imported."""

    @staticmethod
    @hookimpl
    def chemage_register():
        return {"reader": {"rival": "rival_reader:Rival", "gone": "no_such_module_xyz:Gone"}}


@pytest.fixture
def rival(tmp_path, monkeypatch):
    (tmp_path / "rival_reader.py").write_text(
        "from chemage import Reader, Surface\n"
        "class Rival(Reader):\n"
        "    kind = 'rival'\n"
        "    suffixes = ('.npy', '.riv')\n"
        "    def read(self, path):\n"
        "        return Surface(heights=[[1.0, 2.0]], pixel_size=1.0)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    with registry.using(registry.Registry()) as mine:
        mine.register(Rival(), "rival")
        yield mine


def refusal(call, error):
    with pytest.raises(error) as caught:
        call()
    return str(caught.value)


def both(path):
    """The two ways to read a surface from ``path``."""
    return (lambda: chemage.read(path)), chemage.surface("from-file", path=str(path)).make


@pytest.mark.parametrize(("name", "error"), [("map.sur", StoreError), ("map", StoreError), ("map.npy", InputError)])
def test_both_ways_give_the_same_error(rival, tmp_path, name, error):
    np.save(tmp_path / "x.npy", np.ones((2, 2)))
    (tmp_path / "x.npy").rename(tmp_path / name)
    by_read, by_maker = (refusal(call, error) for call in both(tmp_path / name))
    assert by_read == by_maker == refusal(lambda: reader_for(tmp_path / name), error)
    assert str(tmp_path / name) in by_read


def test_both_ways_give_the_same_surface(rival, tmp_path):
    (tmp_path / "map.riv").write_text("anything")
    by_read, by_maker = (call() for call in both(tmp_path / "map.riv"))
    assert np.array_equal(by_read.heights, by_maker.heights)
    assert type(reader_for(tmp_path / "map.RIV")).__name__ == "Rival"


def test_there_is_one_look_up():
    from chemage.store import results

    assert results.reader_for is chemage_surfaces.from_file.reader_for is reader_for


def test_a_reader_that_cannot_be_imported_does_not_stop_the_others(rival, tmp_path):
    with pytest.raises(PluginError, match="no_such_module_xyz"):
        registry.current().component("reader", "gone")
    assert reader_for("map.txt").kind == "text"
    assert [problem for problem in registry.current().check() if "no_such_module_xyz" in problem]
