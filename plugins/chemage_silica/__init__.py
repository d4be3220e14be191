"""Silica surfaces with silanol groups that form siloxane bridges.

After Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018): the barrier distribution ``md-silica``, and the scenes
``silica-rough``, ``silica-patch``, ``silica-tip``, ``silica-tips``, ``silica-afm-tip`` and ``silica-linear-tip``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage import hookimpl

if TYPE_CHECKING:
    from chemage_silica.barriers import MDSilica as MDSilica

__all__ = ["MDSilica"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {"barriers": {"md-silica": "chemage_silica.barriers:MDSilica"}}


@hookimpl
def chemage_scenes() -> dict[str, str]:
    """The scenes of this package."""
    names = ("silica-rough", "silica-patch", "silica-tip", "silica-tips", "silica-afm-tip", "silica-linear-tip")
    return {name: f"chemage_silica.scenes:{name}.toml" for name in names}


def __getattr__(name: str) -> Any:
    if name == "MDSilica":
        from chemage_silica.barriers import MDSilica

        return MDSilica
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
