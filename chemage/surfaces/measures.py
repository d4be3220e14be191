"""Roughness as numbers: what theories of contact need to know of a surface instead of its heights."""

from __future__ import annotations

import math

from chemage.foundation.records import Number, Plain, PositiveNumber, Record
from chemage.surfaces.surface import Surface


class Roughness(Record):
    """The roughness of a surface that need not exist as a map."""

    rms_slope: Number
    """h'_rms"""
    nominal_area: PositiveNumber
    """nm²"""
    rms_height: float = math.nan
    """nm; nan where it is not known"""
    provenance: Plain = {}
    """how the surface would be made: plain JSON values"""

    @classmethod
    def of(cls, surface: Surface) -> Roughness:
        """The roughness of a surface that is there."""
        return cls(
            rms_slope=surface.rms_slope,
            nominal_area=surface.nominal_area,
            rms_height=surface.rms_height,
            provenance=surface.provenance,
        )
