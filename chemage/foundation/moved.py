"""The modules of chemage 0.1, in which packages written for it find their names; each warns when it is imported."""

from __future__ import annotations

from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

#: module of 0.1 -> the modules that have its names now
MOVED = {
    **{
        name: (f".foundation.{name}",)
        for name in ("errors", "random", "threads", "units")
    },
    "hookspecs": (".plugins.hooks",),
    "measures": (".surfaces.roughness", ".contacts.patches", ".contacts.theory"),
    "plots": (".foundation.figures",),
    "registry": (".plugins.registry",),
    **dict.fromkeys(("objects", "runs", "spec", "store", "sweeps"), ()),
}


class Finder:
    """Finds these modules where no other finder does."""

    def find_spec(
        self, name: str, path: Any, target: Any = None
    ) -> ModuleSpec | None:
        package, _, last = name.rpartition(".")
        is_moved = package == "chemage" and last in MOVED
        return ModuleSpec(name, self) if is_moved else None  # pyright: ignore[reportArgumentType]

    def create_module(self, spec: ModuleSpec) -> None:
        """As usual."""

    def exec_module(self, module: ModuleType) -> None:
        from warnings import warn

        name = module.__name__.rpartition(".")[2]
        warn(
            f"chemage.{name} is a module of chemage 0.1; its names are in chemage and chemage.plugin",
            DeprecationWarning,
            stacklevel=2,
        )
        places = [import_module(f"chemage{place}") for place in ("", *MOVED[name])]

        def found(name: str) -> Any:
            name = {"Spec": "Component"}.get(name, name)
            place = next((one for one in places if hasattr(one, name)), places[0])
            return getattr(place, name)

        vars(module)["__getattr__"] = found
