"""Provenance: the versions of everything that took part in a result."""

from __future__ import annotations

import platform
from functools import lru_cache
from importlib import metadata

from chemage.foundation.machine import processor
from chemage.foundation.records import Record
from chemage.foundation.version import __version__
from chemage.plugins import registry
from chemage.plugins.sources import providers
from chemage.scene.scene import Scene

#: libraries on whose versions the last bits of a result depend
LIBRARIES = ("numpy", "scipy", "numba", "h5py")


def versions(scene: Scene | None = None, results: tuple[Record | None, ...] = ()) -> dict[str, str]:
    """Versions of chemage, of the libraries below it, and of the plugins that took part; and the processor.

    Those are the plugins that provide the components of ``scene``, and those that took part in ``results``; and the
    libraries that they name as their basis.
    """
    found = {"chemage": __version__, "python": platform.python_version(), "processor": processor()}
    for name in LIBRARIES:
        found[name] = _version(name)
    taking_part = providers(*scene.components()) if scene is not None else {}
    for one in results:
        if one is not None:
            taking_part |= one.plugins
    records = {record.name: record for record in registry.current().records}
    for name, source in sorted(taking_part.items()):
        record = records.get(name)
        found.setdefault((record and record.distribution) or name, (record and record.version) or source)
        found |= (
            {library: found.get(library, version) for library, version in record.libraries.items()} if record else {}
        )
    return found


@lru_cache
def _version(distribution: str) -> str:
    # reading a distribution's metadata takes a millisecond, and a sweep needs it at every point
    return metadata.version(distribution)
