"""Contacts with a history: holds, slip, loads and temperatures one after the other; docs/pulling.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes
from chemage_history.stages import STAGES as STAGES

if TYPE_CHECKING:
    from chemage_history.programme import Programme as Programme
    from chemage_history.steps import HistoryStep as HistoryStep
    from chemage_history.steps import Protocol as Protocol
    from chemage_history.steps import Slider as Slider

ROLES = {"protocol": "chemage_history.steps:Protocol"}

KINDS = {
    "protocol": {
        "steps": "chemage_history.protocols:Steps",
        "slide-hold-slide": "chemage_history.protocols:SlideHoldSlide",
        "velocity-steps": "chemage_history.protocols:VelocitySteps",
        "load-steps": "chemage_history.protocols:LoadSteps",
        "heating": "chemage_history.protocols:Heating",
        "creep": "chemage_history.protocols:Creep",
    },
}

__getattr__ = lazy_attributes(
    KINDS,
    "chemage_history.programme:Programme",
    "chemage_history.steps:Protocol",
    "chemage_history.steps:Slider",
    "chemage_history.steps:HistoryStep",
)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The protocols of this package."""
    return KINDS


@hookimpl
def chemage_scenes() -> dict[str, str]:
    """The scene of this package."""
    return {"silica-history": "chemage_history:scenes/silica-history.toml"}
