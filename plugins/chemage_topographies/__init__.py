"""The reader ``topography``: files of microscopes and profilometers, read with the library SurfaceTopography."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_topographies.reader import Topography as Topography

__all__ = ["Topography"]

#: heights depend on its version
CHEMAGE_LIBRARIES = ("SurfaceTopography",) if find_spec("SurfaceTopography") else ()


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {"reader": {"topography": "chemage_topographies.reader:Topography"}}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.reader"), name)
