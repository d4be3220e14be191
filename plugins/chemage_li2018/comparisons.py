"""Numbers and statements of the paper beside ours: *calibrated*, *predicted* or *disagrees*."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from chemage_li2018.published import NUMBERS, ROWS, TABLE_1, PublishedNumber
from chemage_li2018.shapes import ScalingLaw
from chemage_li2018.sweeps import Mean, Studies, mean

CALIBRATED = "calibrated"
PREDICTED = "predicted"
DISAGREES = "disagrees"
UNTESTED = "not tested"
#: largest accepted relative distance from a published number
COMMON = 0.10


class Line(NamedTuple):
    """A published number and ours."""

    target: str
    quantity: str
    paper: PublishedNumber
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
    def shown(self) -> str:
        """The difference, in whole per cent if the mean is not known better than to one per cent."""
        error = self.ours.scatter / math.sqrt(self.ours.count) / abs(self.ours.value)
        shown = f"{self.difference:+.{0 if error > 0.01 else 1}%}"
        return shown if float(shown[:-1]) else shown[1:]

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

    #: as in the paper; for a statement that cannot be tested, ``ours`` is the reason
    statement: str
    ours: str
    #: None if it is not tested
    holds: bool | None
    #: the laws that were compared, the best first, if the statement is about a shape
    laws: tuple[ScalingLaw, ...] = ()
    #: whether the barrier density was fitted to what it states
    calibrated: bool = False
    target: str = ""

    @property
    def word(self) -> str:
        """``calibrated``, ``predicted``, ``disagrees`` or ``not tested``."""
        if self.holds is None:
            return UNTESTED
        if not self.holds:
            return DISAGREES
        return CALIBRATED if self.calibrated else PREDICTED


class Estimate(NamedTuple):
    """An estimate in the text of the paper, ours, and how ours is computed."""

    statement: str
    ours: str
    how: str
    #: one of the three words, or why there is nothing to compare
    word: str


def lines(studies: Studies, targets: Sequence[str]) -> list[Line]:
    """Compare the published numbers of ``targets`` with those of the computed ``studies``."""
    found = []
    for target in targets:
        for number in NUMBERS.get(target, ()):
            paper = PublishedNumber.of(number["paper"])
            points = studies[number["study"]].at_options(number["at"])
            ours = mean(points.of(number["value"]))
            calibrated = target == "fig3"
            found.append(Line(target, number["quantity"], paper, ours, calibrated))
        for row in TABLE_1 if target in ROWS else ():
            group = studies["table"].by_row()[row]
            for quantity, text, value in ROWS[target]:
                paper = PublishedNumber.of(text.format_map(row._asdict()))
                name = quantity.format(name=row.name)
                found.append(Line(target, name, paper, mean(group.of(value))))
    return found
