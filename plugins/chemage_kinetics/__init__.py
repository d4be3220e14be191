"""Engines that follow the forming and breaking of bonds; docs/kinetics.md compares them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_kinetics.engines import BKL as BKL
    from chemage_kinetics.engines import Auto as Auto
    from chemage_kinetics.engines import Independent as Independent
    from chemage_kinetics.engines import ManyStates as ManyStates
    from chemage_kinetics.engines import NextReaction as NextReaction
    from chemage_kinetics.engines import RejectionFree as RejectionFree
    from chemage_kinetics.pulled import Pulled as Pulled
    from chemage_kinetics.pulling import EventDriven as EventDriven

KINDS = {
    "engine": {
        "auto": "chemage_kinetics.engines:Auto",
        "rejection-free": "chemage_kinetics.engines:RejectionFree",
        "bkl": "chemage_kinetics.engines:BKL",
        "next-reaction": "chemage_kinetics.engines:NextReaction",
        "independent": "chemage_kinetics.engines:Independent",
        "many-states": "chemage_kinetics.engines:ManyStates",
    },
    "pulling": {"event-driven": "chemage_kinetics.pulling:EventDriven"},
    "rupture": {"pulled": "chemage_kinetics.pulled:Pulled"},
}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The engines of this package."""
    return KINDS
