"""Provenance: the versions of everything that took part in a result."""

from __future__ import annotations

import platform
from functools import lru_cache
from importlib import metadata

from chemage.experiments.scene import Scene
from chemage.foundation.records import Record
from chemage.foundation.version import __version__
from chemage.plugins import registry

#: libraries on whose versions the last bits of a result depend
LIBRARIES = ("numpy", "scipy", "numba", "h5py")


def versions(scene: Scene | None = None, results: tuple[Record | None, ...] = ()) -> dict[str, str]:
    """Versions of chemage, of the libraries below it, and of the plugins that took part.

    Those are the distributions that offer the components of ``scene``, and the plugins that answered or changed a
    stage, which ``results`` know.
    """
    found = {"chemage": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        found[name] = _version(name)
    taking_part = {name for one in results if one is not None for name in one.plugins}
    used = {(part.role, part.kind) for part in scene.components()} if scene is not None else set()
    for record in registry.current().records:
        offered = {(role, kind) for role, kinds in record.kinds.items() for kind in kinds}
        if offered & used or record.name in taking_part:
            found.setdefault(record.distribution or record.name, record.version or record.source)
    return found


@lru_cache
def _version(distribution: str) -> str:
    # reading a distribution's metadata takes a millisecond, and a sweep needs it at every point
    return metadata.version(distribution)
