"""Numbers and statements of the paper beside ours: *calibrated*, *predicted* or *disagrees*."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from chemage_li2018 import published
from chemage_li2018.published import PublishedNumber
from chemage_li2018.shapes import ScalingLaw
from chemage_li2018.sweeps import (
    LOAD,
    RADIUS,
    SLOPE,
    Mean,
    PointSet,
    Studies,
    front,
    mean,
)

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
        for quantity, paper, points, name in _numbers(studies, target):
            ours = mean(points.of(name))
            found.append(
                Line(
                    target,
                    quantity,
                    PublishedNumber.of(paper),
                    ours,
                    calibrated=target == "fig3",
                )
            )
    return found


def _numbers(studies: Studies, target: str) -> Iterable[tuple[str, str, PointSet, str]]:
    """What is published, as it is printed; and the points that have it, in the summary by a name."""
    if target == "kappa":
        by_load = studies["loads"].by_load()
        for load, paper in published.AREA_FRACTION.items():
            yield f"A/A0 at {load:g} µN", paper, by_load[load], "area_fraction"
        yield "κ at 20 µN, h' = 0.1", published.KAPPA, by_load[20.0], "kappa"
        for row, points in studies["table"].by_row().items():
            yield f"κ, Table 1 {row.name}", published.KAPPA_ROWS, points, "kappa"
    elif target == "table1":
        for row, points in studies["table"].by_row().items():
            yield f"N_p, {row.name}", row.patches, points, "patches"
            yield (
                f"C/A (1/nm), {row.name}",
                row.perimeter_to_area,
                points,
                "perimeter_to_area",
            )
    elif target == "fig3":
        for volume, points in studies["slopes"].by_volume().items():
            for slope, group in points.by(SLOPE).items():
                yield (
                    f"β, h' = {slope:g}, ΔV = {volume:g} Å³",
                    f"{published.BETA[volume][slope]:.2f}",
                    group,
                    "beta",
                )
    elif target == "fig6":
        yield (
            "β, h' = 0.4, half hydroxylated, front",
            published.FIG_6_BETA,
            front(studies, 0.5),
            "beta",
        )
    elif target == "tips":
        for (radius, load), group in studies["tips"].by(RADIUS, LOAD).items():
            if load in published.TIP_BETA:
                yield (
                    f"β of a tip at {load:g} nN, radius {radius:g} nm",
                    published.TIP_BETA[load],
                    group,
                    "beta",
                )
