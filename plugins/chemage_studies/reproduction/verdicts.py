"""The words for a comparison with the paper: *calibrated*, *predicted*, *disagrees*."""

from __future__ import annotations

import math
from typing import NamedTuple

from chemage_studies.reproduction.points import Mean
from chemage_studies.reproduction.published import Published

CALIBRATED, PREDICTED, DISAGREES = "calibrated", "predicted", "disagrees"
#: largest accepted relative distance from a published number
COMMON = 0.10


class Line(NamedTuple):
    """A published number and ours."""

    target: str
    quantity: str
    paper: Published
    ours: Mean
    #: whether an option was fitted to the published number
    calibrated: bool = False

    @property
    def difference(self) -> float:
        """Distance of our mean from the published number, or from the nearer end of its range, relative."""
        if self.paper.value is not None:
            return self.ours.value / self.paper.value - 1
        nearest = min(max(self.ours.value, self.paper.low), self.paper.high)
        return self.ours.value / nearest - 1

    @property
    def word(self) -> str:
        """``calibrated``, ``predicted`` or ``disagrees``."""
        if self.calibrated:
            return CALIBRATED
        return PREDICTED if self.reason else DISAGREES

    @property
    def reason(self) -> str:
        """Why the two agree: the digits of the paper, the common tolerance or the scatter between surfaces; or ""."""
        if self.paper.distance(self.ours.value) == 0:
            low, high = self.paper.low, self.paper.high
            return f"in the {'range' if self.paper.value is None else 'rounding'} {low:.5g} to {high:.5g}"
        if abs(self.difference) <= COMMON:
            return f"within {COMMON:.0%}"
        half = self.ours.one_more
        if math.isfinite(half) and self.paper.distance(self.ours.value) <= half:
            return f"one surface: {max(self.ours.value - half, 0):.3g} to {self.ours.value + half:.3g} (95 %)"
        return ""


class Claim(NamedTuple):
    """A statement of the paper, our result, and whether the statement holds for it."""

    target: str
    statement: str
    found: str
    holds: bool

    @property
    def word(self) -> str:
        """``predicted`` or ``disagrees``."""
        return PREDICTED if self.holds else DISAGREES


class Estimate(NamedTuple):
    """An estimate in the text of the paper, ours, and how ours is computed."""

    statement: str
    ours: str
    how: str
    #: one of the three words, or why there is nothing to compare
    word: str
