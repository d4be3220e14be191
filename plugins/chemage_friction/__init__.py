"""Rupture laws, from bonds to friction: ``mean-force``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_friction.mean_force import MeanForce as MeanForce

KINDS = {"rupture": {"mean-force": "chemage_friction.mean_force:MeanForce"}}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS
