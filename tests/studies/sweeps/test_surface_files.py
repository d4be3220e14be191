"""A sweep over a surface file reads it once per process, however many points there are."""

from __future__ import annotations

import builtins
import io
import os

import numpy as np
import pytest
from seen import read_grid, survey_of

import chemage
import chemage_surfaces


@pytest.fixture
def opened(monkeypatch):
    """Base names of the files that were opened for reading, in order."""
    names = []
    for module in (builtins, io):
        real = module.open

        def counting(file, mode="r", *args, real=real, **options):
            if isinstance(file, str | os.PathLike) and "r" in mode:
                names.append(os.path.basename(os.fspath(file)))
            return real(file, mode, *args, **options)

        monkeypatch.setattr(module, "open", counting)
    real_handle = os.open

    def handle(path, flags, *args, **options):
        if isinstance(path, str | os.PathLike) and not flags & (os.O_WRONLY | os.O_RDWR):
            names.append(os.path.basename(os.fspath(path)))
        return real_handle(path, flags, *args, **options)

    monkeypatch.setattr(os, "open", handle)
    return names


@pytest.fixture
def scene(tiny, tmp_path, monkeypatch):
    """Fifty loads on the surface in a file."""
    chemage.plugin.registry.current().register(chemage_surfaces, "surfaces")
    np.save(tmp_path / "map.npy", np.random.default_rng(0).random((12, 12)))
    surface = {"kind": "from-file", "path": str(tmp_path / "map.npy"), "pixel_size": 1.0, "periodic": True}
    loads = np.linspace(1.0, 20.0, 50).tolist()
    return {**tiny.scene(surface=surface), "sweep": {"contact.load": loads}}


def times(opened):
    return opened.count("map.npy")


def test_check_recognises_the_file_once_reads_it_once_and_hashes_it_once(scene, opened):
    found = survey_of(read_grid(scene))
    assert (len(found.contacts), found.surfaces) == (50, 1)
    assert times(opened) == 3
    again = survey_of(read_grid(scene))
    assert again.keys == found.keys
    assert times(opened) == 3


@pytest.mark.long
def test_a_sweep_reads_the_file_once_and_hashes_it_once(scene, tiny, opened, tmp_path):
    result = chemage.sweep(scene, tmp_path / "out")
    assert result.states() == ["done"] * 50
    assert len(tiny.computed("contact")) == 50
    assert times(opened) == 3
    assert chemage.sweep(scene, tmp_path / "out").states() == ["done"] * 50
    assert times(opened) == 3


def test_a_file_that_changed_is_read_again(scene, opened, tmp_path):
    before = survey_of(read_grid(scene))
    np.save(tmp_path / "map.npy", np.random.default_rng(1).random((12, 14)))
    after = survey_of(read_grid(scene))
    assert not set(before.keys) & set(after.keys)
    assert times(opened) == 6
