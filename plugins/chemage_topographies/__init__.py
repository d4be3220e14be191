"""The reader ``topography``: files of microscopes and profilometers, read with the library SurfaceTopography."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_topographies.reader import Topography as Topography

KINDS = {"reader": {"topography": "chemage_topographies.reader:Topography"}}

__getattr__ = lazy_attributes(KINDS)

#: heights depend on its version
CHEMAGE_LIBRARIES = ("SurfaceTopography",) if find_spec("SurfaceTopography") else ()


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS
