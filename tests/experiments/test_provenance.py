"""Provenance: which versions and which plugins made a result."""

from __future__ import annotations

from importlib import metadata

import pytest

import chemage
from chemage import load_scene


@pytest.fixture
def scene(small):
    return load_scene(small)


def test_versions_name_the_distributions_in_use(scene):
    found = chemage.versions(scene)
    assert found["chemage"] == chemage.__version__ == metadata.version("chemage")
    for name in ("numpy", "scipy", "numba", "h5py"):
        assert found[name] == metadata.version(name)
