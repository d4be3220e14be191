"""Rupture laws, from bonds to friction: ``mean-force``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_friction.mean_force import MeanForce

__all__ = ["MeanForce"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {"rupture": {"mean-force": "chemage_friction.mean_force:MeanForce"}}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from chemage_friction.mean_force import MeanForce

    return MeanForce
