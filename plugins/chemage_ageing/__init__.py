"""Methods of ageing: ``closure`` (bonds per area from uniform contacts and the rim, integrated over the pressures) and
``sample`` (the kinetics of windows of the contact)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_ageing.closure import Closure as Closure
    from chemage_ageing.sample import Sample as Sample

_HOME = {"Closure": "closure", "Sample": "sample"}

__all__ = ["Closure", "Sample"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The methods of this package."""
    return {"ageing": {"closure": "chemage_ageing.closure:Closure", "sample": "chemage_ageing.sample:Sample"}}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
