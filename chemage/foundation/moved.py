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
    "plots": "chemage.reports.figures",
    **dict.fromkeys(("measures", "objects", "runs", "scene", "spec", "store"), ""),
}
#: modules in which names of 0.1 are looked up that are not names of ``chemage``
_PLACES = ("surfaces.roughness", "contacts.patches", "contacts.theory", "experiments.scene_files", "foundation.text")


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
        name = "Component" if name == "Spec" else name
        places = (sys.modules["chemage"], *(importlib.import_module(f"chemage.{place}") for place in _PLACES))
        for place in places:
            if hasattr(place, name):
                return getattr(place, name)
        raise AttributeError(f"{self.__name__} has no name {name!r} any more")


def install() -> None:
    """Let the old names be imported."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
