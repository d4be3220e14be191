"""The force that breaks the bonds of one replica."""

from __future__ import annotations

from typing import Any, Self

from pydantic import model_validator

from chemage.foundation.records import Doubles, Record


class RuptureForce(Record):
    """Force that breaks all bonds of one replica, after each hold time."""

    arrays = {
        "hold_times": (("hold_time",), "s", "time since the contact was made"),
        "force": (("hold_time",), "nN", "force that breaks all bonds"),
    }
    stored_names = {"hold_times": "hold_time"}

    hold_times: Doubles
    """(m,) s"""
    force: Doubles
    """(m,) nN"""
    law: str = ""
    """kind of the rupture law; empty for the mean force per bond of the chemistry"""
    provenance: dict[str, Any] = {}
    """how it was made: plain JSON values"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.hold_times.ndim != 1 or self.force.shape != self.hold_times.shape:
            raise ValueError(f"force: shape {self.force.shape}; give one number for each of the hold times")
        return self

    def __repr__(self) -> str:
        return f"<RuptureForce {self.force[-1]:.4g} nN at {self.hold_times[-1]:g} s>"

    __str__ = __repr__
