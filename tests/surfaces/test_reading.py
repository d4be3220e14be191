"""Files of other formats: `chemage.read` and the surface maker from-file look up their reader in one place."""

from __future__ import annotations

import numpy as np
import pytest

import chemage
from chemage import InputError
from chemage.plugin import PluginError, StoreError, hookimpl, reader_for, registry


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


def test_a_reader_that_cannot_be_imported_does_not_stop_the_others(rival, tmp_path):
    with pytest.raises(PluginError, match="no_such_module_xyz"):
        registry.current().component("reader", "gone")
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
