"""The sections of a scene beside its components: how long a contact is held, where ageing is fitted, what is asked."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from pydantic import (
    Field,
    field_validator,
    model_validator,
)

from chemage.ageing.fitting import FIT_WINDOW
from chemage.ageing.replicas import Common
from chemage.foundation.checks import Frozen, check_times, hold_times
from chemage.foundation.errors import ChemageError, InputError, shown
from chemage.foundation.units import FilePath, Temperature, Time, convert, has_unit

_PERCENT = re.compile(r"\s*([-+0-9.eE]+)\s*%\s*")
#: surfaces of an ensemble, unless more are allowed
MOST_SURFACES = 10_000
#: and this is the least that may be allowed: the first samples, and some that these lead to
LEAST = 10
REMEDY = 'give "2 %" or 0.02'


class Section(Frozen):
    """A frozen set of options that is no component."""


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


class EnsembleOptions(Section):
    """Over how many surfaces the answer is a mean."""

    surfaces: int | None = Field(default=None, ge=1)
    """how many; 1: the one of the scene alone; default: as many as the accuracy or the budget decides"""
    budget: Time | None = Field(default=None, gt=0)
    """wall time that may be taken, s"""
    most: int = Field(default=MOST_SURFACES, ge=LEAST)
    """surfaces that are allowed"""
    map: FilePath | None = None
    """file with the map of this scene (``chemage tradeoff SCENE -o FILE``), by whose measured costs and errors the
    settings are chosen; default: by estimates"""


def accuracies(options: Any) -> dict[str, float]:
    """A mapping of quantities, written as ``name`` or ``name@time``, to relative accuracies: numbers, or strings with a
    percent sign.

    Raises
    ------
    InputError
        It is no mapping, or an accuracy is not above 0 and below 1.
    """
    if not isinstance(options, Mapping):
        raise InputError(f'accuracy = {shown(options)}: give names and accuracies, such as {{"beta": "2 %"}}')
    return {str(name): _accuracy(str(name), value) for name, value in options.items()}


def _accuracy(name: str, value: Any) -> float:
    number = value
    if isinstance(value, str):
        percent = _PERCENT.fullmatch(value)
        try:
            number = float(percent[1]) / 100 if percent else float(value)
        except ValueError:
            number = math.nan
    if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
        problem = "is no number"
    elif not 0 < number < 1:
        problem = "must lie between 0 and 1: it is half the width of the 95 % interval over the mean"
    else:
        return float(number)
    message = f"{shown(value)}: {problem}; {REMEDY}"
    raise InputError(f"accuracy.{name} = {message}", [(name, message)])


def budget(value: Any) -> float:
    """A budget of wall time, s.

    Raises
    ------
    InputError
        It is no time, or not above zero.
    """
    try:
        seconds = convert(value, "s")
    except ChemageError as error:
        raise InputError(f"budget: {error}") from None
    if not 0 < seconds < math.inf:
        raise InputError.of("budget", value, "must be above zero and finite", 'give a time such as "60 s"')
    return seconds
