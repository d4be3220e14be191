"""The module names of chemage 0.1, so that plugins written for it still work: each import of one warns."""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

#: old module -> the module that has taken its place, or "" where its names are names of ``chemage`` now
MOVED = {
    **{name: f"chemage.foundation.{name}" for name in ("errors", "random", "threads", "units")},
    "hookspecs": "chemage.plugins.hooks",
    "registry": "chemage.plugins.registry",
    **dict.fromkeys(("measures", "objects", "runs", "scene", "spec", "store"), ""),
}


class _Finder(MetaPathFinder, Loader):
    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        package, _, name = fullname.rpartition(".")
        return ModuleSpec(fullname, self) if package == "chemage" and name in MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        place = MOVED[spec.name.rpartition(".")[2]]
        remedy = f"use {place}, or the names of chemage itself" if place else "import its names from chemage itself"
        warnings.warn(f"the module {spec.name} has moved; {remedy}", DeprecationWarning, stacklevel=2)
        return importlib.import_module(place) if place else _Names(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


class _Names(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(sys.modules["chemage"], "Component" if name == "Spec" else name)


def install() -> None:
    """Let the old names be imported."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
