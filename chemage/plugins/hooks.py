"""The markers of hooks, and the hook by which a plugin offers components.

A plugin is a module (or package) named by an entry point in the group ``chemage``; its functions marked with
``chemage.plugin.hookimpl`` implement hooks. A plugin may leave out arguments that it does not need. Arguments are only
ever added; a changed meaning is a new hook. The hooks of each stage are specified in the ``hooks`` module of its room.
"""

from __future__ import annotations

from collections.abc import Mapping

import pluggy

#: A plugin module may set ``CHEMAGE_API = 1``; one made for another version is reported and skipped.
API_VERSION = 1
#: versions whose modules are still loaded
SUPPORTED_API_VERSIONS = (1,)

#: hooks that are called once, at discovery, by which a plugin offers what it has
OFFERS = ("chemage_register", "chemage_scenes", "chemage_materials")

hookspec = pluggy.HookspecMarker("chemage")
hookimpl = pluggy.HookimplMarker("chemage")


@hookspec
def chemage_register() -> Mapping[str, Mapping[str, str]]:  # pyright: ignore[reportReturnType]
    """Offer components: ``{role: {kind: "module:Class"}}``.

    Strings, so that discovery imports nothing heavy; the class is imported when the kind is first used.
    """
