"""Numbers of the paper beside ours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist

from chemage.plugin import decisions, statistics
from chemage_li2018.published import (
    DATA,
    NUMBERS,
    ROWS,
    TABLE_1,
    PublishedNumber,
    window,
)
from chemage_li2018.sweeps import (
    Mean,
    PointSet,
    Studies,
    front,
    mean,
)

#: factor that a comparison must notice to decide
FACTOR = 1.5


@dataclass(frozen=True)
class Line:
    """A published number, of one surface, and ours.

    The two agree if the published number, with its rounding, lies in the interval that holds the value of one more
    surface with a probability of 95 %; a true number is refused in 5 %.
    """

    target: str
    quantity: str
    paper: PublishedNumber
    ours: Mean
    #: whether an option was fitted to the published number, or chosen for it by the authors
    calibrated: bool = False
    chosen: bool = False
    #: ours as the paper could be read as well
    readings: Mapping[str, Mean] = field(default_factory=dict)

    @property
    def difference(self) -> float:
        """Distance of our mean from the published number, or from the nearer end of its range, relative."""
        nearest = self.paper.value
        if nearest is None:
            nearest = min(max(self.ours.value, self.paper.low), self.paper.high)
        return self.ours.value / nearest - 1

    @property
    def shown(self) -> str:
        """The difference in per cent."""
        return f"{self.difference:+.1%}"

    def agrees(self, ours: Mean) -> bool:
        """Whether the published number may be that of one more surface."""
        return self.paper.distance(ours.value) <= ours.one_more

    @property
    def noticed(self) -> float:
        """The factor by which a number must be larger than ours to be refused in 80 %; nan if this is not known."""
        rounding = 0.5 * (self.paper.high - self.paper.low)
        away = NormalDist().inv_cdf(decisions.POWER) * self.ours.scatter + rounding
        return 1 + (self.ours.one_more + away) / abs(self.ours.value)

    @property
    def refused(self) -> list[str]:
        """Names of the readings that do not agree."""
        return [name for name, ours in self.readings.items() if not self.agrees(ours)]

    @property
    def word(self) -> str:
        """One of the five words, by rule."""
        if self.calibrated:
            return decisions.CALIBRATED
        if math.isnan(self.noticed):
            return decisions.CANNOT
        if not self.agrees(self.ours):
            return decisions.DISAGREES
        if self.noticed > FACTOR:
            return decisions.CANNOT
        return decisions.READ_AS if self.refused or self.chosen else decisions.PREDICTED


def lines(studies: Studies, targets: Sequence[str]) -> list[Line]:
    """Compare the published numbers of ``targets`` with those of the computed ``studies``."""
    found = []
    for target in targets:
        for number in NUMBERS.get(target, ()):
            paper = PublishedNumber.of(number["paper"])
            points = studies[number["study"]].at_options(number["at"])
            ours = _of(points, number["value"])
            line = Line(target, number["quantity"], paper, ours, target == "fig3")
            readings = variants(studies) if target == "fig6" else {}
            found.append(replace(line, readings=readings))
        for row in TABLE_1 if target in ROWS else ():
            group = studies["table"].by_row()[row]
            for quantity, text, value in ROWS[target]:
                paper = PublishedNumber.of(text.format_map(row._asdict()))
                name = quantity.format(name=row.name)
                found.append(Line(target, name, paper, mean(group.of(value))))
    return found


def _of(points: PointSet, value: str) -> Mean:
    """A number over surfaces, β over the preferred hold times; of a tip over its replicas."""
    half = points[0].summary.get(f"{value}_half_width")
    if len(points) == 1 and half is not None and "surface.radius" in points[0].changes:
        # half of a 95 % interval over very many replicas
        return Mean(points[0].summary[value], half / statistics.NORMAL_LIMIT, 10**6)
    if value == "beta" and "chemistry.activation_volume" in points[0].changes:
        return mean(points.beta(window(points[0].varied("activation_volume"))))
    return mean(points.of(value))


def variants(studies: Studies) -> dict[str, Mean]:
    """β of Fig. 6 as the paper could be read: share of sites, activation volume (nm³), hold times (s) of the fit."""
    return {
        name: mean(front(studies, share, volume).beta((first, last)))
        for name, (share, volume, first, last) in DATA["variants"].items()
    }
