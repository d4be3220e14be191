"""Engines that follow the forming and breaking of bonds; docs/kinetics.md compares them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_kinetics.engines import BKL, Auto, Independent, NextReaction, RejectionFree

__all__ = ["BKL", "Auto", "Independent", "NextReaction", "RejectionFree"]

_KINDS = {
    "auto": "Auto",
    "rejection-free": "RejectionFree",
    "bkl": "BKL",
    "next-reaction": "NextReaction",
    "independent": "Independent",
}


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The engines of this package."""
    return {"engine": {kind: f"chemage_kinetics.engines:{name}" for kind, name in _KINDS.items()}}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from chemage_kinetics import engines  # imports numba, so on first use

    return getattr(engines, name)
