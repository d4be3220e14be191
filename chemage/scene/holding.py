"""How long a contact is held, and where ageing is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from chemage.ageing.fitting import FIT_WINDOW
from chemage.ageing.hold_times import hold_times
from chemage.ageing.seeds import Common
from chemage.foundation.checks import check_times
from chemage.foundation.units import Temperature, Time, convert, has_unit
from chemage.scene.section import Section


class Hold(Section):
    """How long, how hot, how often."""

    temperature: Temperature = 300.0
    """K"""
    start: Time | None = None
    """first hold time, s"""
    stop: Time | None = None
    """last hold time, s"""
    per_decade: int = Field(default=4, ge=1, le=1000)
    """hold times to a decade"""
    times: tuple[Time, ...] | None = None
    """the hold times themselves, s, instead of start, stop and per_decade"""
    replicas: int = Field(default=10, ge=1)
    """independent draws of the disorder and the kinetic noise"""
    seed: int = Field(default=0, ge=0)
    """of disorder and noise"""
    common: Common = "none"
    """random numbers that replica r has in common with replica r of other runs with this seed: "none", "disorder"
    (barriers, couplings and hydroxylation of a pixel) or "all" (the kinetic noise as well)"""

    @field_validator("times", mode="before")
    @classmethod
    def _times(cls, value: Any) -> Any:
        if has_unit(value):
            return tuple(check_times(value).tolist())
        if isinstance(value, Sequence) and not isinstance(value, str):
            return tuple(check_times([convert(item, "s") for item in value]).tolist())
        return value

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.times is None:
            if self.start is None or self.stop is None:
                raise ValueError('give start and stop (such as "1 ms" and "1e5 s"), or times')
            hold_times(self.start, self.stop, self.per_decade)
        elif self.start is not None or self.stop is not None:
            raise ValueError("give either times, or start and stop")
        return self

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s."""
        if self.times is not None:
            return np.array(self.times)
        assert self.start is not None
        assert self.stop is not None
        return hold_times(self.start, self.stop, self.per_decade)


class FitWindow(Section):
    """Where the line of Δμ against log t is fitted."""

    start: Time = FIT_WINDOW[0]
    """s"""
    stop: Time = FIT_WINDOW[1]
    """s"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stop <= self.start:
            raise ValueError(f"stop ({self.stop:g} s) must be after start ({self.start:g} s)")
        return self
