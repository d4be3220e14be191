"""Methods of ageing: ``closure`` (bonds per area from uniform contacts and the rim, integrated over the pressures) and
``sample`` (the kinetics of windows of the contact)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_ageing.closure import Closure as Closure
    from chemage_ageing.sample import Sample as Sample

KINDS = {"ageing": {"closure": "chemage_ageing.closure:Closure", "sample": "chemage_ageing.sample:Sample"}}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The methods of this package."""
    return KINDS
