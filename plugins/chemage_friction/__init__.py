"""Rupture laws, from bonds to friction: ``mean-force``."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_friction.mean_force import MeanForce as MeanForce

_HOME = {"MeanForce": "mean_force"}
__all__ = ["MeanForce"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {"rupture": {"mean-force": "chemage_friction.mean_force:MeanForce"}}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
