"""What all tests share."""

from __future__ import annotations

import importlib
import sys
from importlib import metadata
from textwrap import dedent

import pytest
from hypothesis import HealthCheck, settings

from chemage import registry
from chemage.testing import isolated_registry as isolated_registry

# the same examples on every run: a test that fails does so for everyone, and one that passes stays passed
settings.register_profile(
    "chemage",
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("chemage")


class Site:
    """A folder of installed distributions, as pip would leave it."""

    def __init__(self, folder):
        self.folder = folder
        self.names = []

    def install(self, name, files, entry_points=None, version="1.0"):
        """Write the distribution ``name``: ``files`` are path -> source, ``entry_points`` name -> module."""
        for path, text in files.items():
            file = self.folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(dedent(text), encoding="utf-8")
        info = self.folder / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        points = "".join(f"{key} = {value}\n" for key, value in (entry_points or {}).items())
        (info / "entry_points.txt").write_text(f"[chemage]\n{points}")
        self.names.append(name)
        importlib.invalidate_caches()

    def registry(self, **options):
        """A registry of what was installed here, without chemage's own plugins."""
        points = metadata.entry_points(group=registry.GROUP)
        return registry.Registry([p for p in points if p.dist is not None and p.dist.name in self.names], **options)


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder on the import path in which distributions can be installed for one test."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    yield Site(folder)
    for name, module in list(sys.modules.items()):
        if str(folder) in (getattr(module, "__file__", None) or ""):
            del sys.modules[name]
    importlib.invalidate_caches()
