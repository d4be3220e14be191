"""Engines that follow the forming and breaking of bonds; docs/kinetics.md compares them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_kinetics.auto import Auto
    from chemage_kinetics.bkl import BKL
    from chemage_kinetics.independent import Independent
    from chemage_kinetics.next_reaction import NextReaction
    from chemage_kinetics.rejection_free import RejectionFree

__all__ = ["BKL", "Auto", "Independent", "NextReaction", "RejectionFree"]

ENGINES = {
    "auto": "chemage_kinetics.auto:Auto",
    "rejection-free": "chemage_kinetics.rejection_free:RejectionFree",
    "bkl": "chemage_kinetics.bkl:BKL",
    "next-reaction": "chemage_kinetics.next_reaction:NextReaction",
    "independent": "chemage_kinetics.independent:Independent",
}


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The engines of this package."""
    return {"engine": ENGINES}


def __getattr__(name: str) -> Any:
    # Engines import numba, so they are imported on first use.
    for target in ENGINES.values():
        module, cls = target.split(":")
        if cls == name:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
