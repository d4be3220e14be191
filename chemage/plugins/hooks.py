"""The markers of hooks, and the hook by which a plugin offers components.

A plugin is a module (or package) named by an entry point in the group ``chemage``; its functions marked with
``chemage.plugin.hookimpl`` implement hooks. A plugin may leave out arguments that it does not need. Arguments are only
ever added; a changed meaning is a new hook. The hooks of each stage are specified in the ``hooks`` module of its room.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import pluggy

#: A plugin module may set ``CHEMAGE_API = 1``; one made for another version is reported and skipped.
API_VERSION = 1
#: versions whose modules are still loaded
SUPPORTED_API_VERSIONS = (1,)

#: hooks that are called once, at discovery, by which a plugin offers what it has
OFFERS = ("chemage_register", "chemage_scenes", "chemage_materials")

hookspec = pluggy.HookspecMarker("chemage")
hookimpl = pluggy.HookimplMarker("chemage")


def lazy_attributes(kinds: Mapping[str, Mapping[str, str]], *further: str) -> Callable[[str], Any]:
    """The ``__getattr__`` of a plugin package: the classes in ``kinds``, as for :func:`chemage_register`, and
    ``further`` objects (``"module:name"``), each imported on first use."""
    paths = [*further, *(path for offered in kinds.values() for path in offered.values())]
    homes = {name: module for module, _, name in (path.partition(":") for path in paths)}

    def attribute(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"no attribute {name!r}; there are {', '.join(sorted(homes))}")
        return getattr(import_module(homes[name]), name)

    return attribute


@hookspec
def chemage_register() -> Mapping[str, Mapping[str, str]]:  # pyright: ignore[reportReturnType]
    """Offer components: ``{role: {kind: "module:Class"}}``.

    Strings, so that discovery imports nothing heavy; the class is imported when the kind is first used.
    """
