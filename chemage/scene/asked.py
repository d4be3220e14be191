"""What a scene asks of its answer: how many surfaces, how accurate, how long."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from pydantic import Field

from chemage.foundation.errors import ChemageError, InputError, shown
from chemage.foundation.units import Time, convert
from chemage.scene.section import Section

_PERCENT = re.compile(r"\s*([-+0-9.eE]+)\s*%\s*")
#: surfaces of an ensemble, unless more are allowed
MOST_SURFACES = 10_000
#: and this is the least that may be allowed: the first samples, and some that these lead to
LEAST = 10
REMEDY = 'give "2 %" or 0.02'


class EnsembleOptions(Section):
    """Over how many surfaces the answer is a mean."""

    surfaces: int | None = Field(default=None, ge=1)
    """how many; 1: the one of the scene alone; default: as many as the accuracy or the budget decides"""
    budget: Time | None = Field(default=None, gt=0)
    """wall time that may be taken, s"""
    most: int = Field(default=MOST_SURFACES, ge=LEAST)
    """surfaces that are allowed"""
    map: str | None = None
    """file with the map of this scene (``chemage tradeoff SCENE -o FILE``), by whose measured costs and errors the
    settings are chosen; default: by estimates"""


def relative(name: str, value: Any) -> float:
    """A relative accuracy: a number, or a string with a percent sign.

    Raises
    ------
    InputError
        It is not above 0 and below 1.
    """
    field = f"accuracy.{name}"
    found = value
    if isinstance(value, str):
        match = _PERCENT.fullmatch(value)
        try:
            found = float(match[1]) / 100 if match else float(value)
        except ValueError:
            raise InputError.of(field, value, "is no number", REMEDY) from None
    if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found):
        raise InputError.of(field, value, "is no number", REMEDY)
    if not 0 < found < 1:
        problem = "must lie between 0 and 1: it is half the width of the 95 % interval over the mean"
        raise InputError.of(field, value, problem, REMEDY)
    return float(found)


def accuracies(given: Any) -> dict[str, float]:
    """A mapping of quantities, written as ``name`` or ``name@time``, to relative accuracies.

    Raises
    ------
    InputError
        It is no mapping, or an accuracy is not above 0 and below 1.
    """
    if not isinstance(given, Mapping):
        raise InputError(f'accuracy = {shown(given)}: give names and accuracies, such as {{"beta": "2 %"}}')
    return {str(name): relative(str(name), value) for name, value in given.items()}


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
