"""Numbers and statements of the paper beside ours: *calibrated*, *predicted* or *disagrees*."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from chemage_li2018 import published
from chemage_li2018.published import Published
from chemage_li2018.shapes import Law
from chemage_li2018.sweeps import LOAD, ROW, SLOPE, VOLUME, WITH_PRESSURE, Mean, Point, by, grouped, mean

CALIBRATED, PREDICTED, DISAGREES, UNTESTED = "calibrated", "predicted", "disagrees", "not tested"
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

    target: str
    #: as in the paper; for a statement that cannot be tested, ``ours`` is the reason
    statement: str
    ours: str
    #: None if it is not tested
    holds: bool | None
    #: the laws that were compared, the best first, if the statement is about a shape
    laws: tuple[Law, ...] = ()
    #: whether the barrier density was fitted to what it states
    calibrated: bool = False

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


Studies = dict[str, list[Point]]


def lines(studies: Studies, targets: Sequence[str]) -> list[Line]:
    """Compare the published numbers of ``targets`` with those of the computed ``studies``."""
    return [line for target in targets if target in _LINES for line in _LINES[target](studies)]


def rows(points: Sequence[Point]) -> list[tuple[published.Row, list[Point]]]:
    """Sort points by the rows of Table 1."""
    groups = grouped(points, *ROW)
    return [(row, groups[row.hurst, row.zeta, row.eta]) for row in published.TABLE_1]


def by_volume(points: Sequence[Point]) -> dict[float, list[Point]]:
    """Group points by the activation volume in Å³."""
    return {6.4 if volume else 0.0: group for volume, group in by(points, VOLUME).items()}


def circle(points: Sequence[Point]) -> list[Point]:
    """The points with the roughness of the reference, the first row of Table 1."""
    return rows(points)[0][1]


def front(studies: Studies, hydroxylation: float, volume: float = WITH_PRESSURE) -> list[Point]:
    """The points of Fig. 6 with a hydroxylation and an activation volume (nm³)."""
    return grouped(studies["front"], "chemistry.hydroxylation", VOLUME)[hydroxylation, volume]


def _line(target: str, quantity: str, paper: str, points: Sequence[Point], name: str) -> Line:
    return Line(target, quantity, Published.of(paper), mean(p.summary[name] for p in points))


def _kappa_lines(studies: Studies) -> Iterable[Line]:
    by_load = {load / 1000: group for load, group in by(studies["loads"], LOAD).items()}
    for load, paper in published.AREA_FRACTION.items():
        yield _line("kappa", f"A/A0 at {load:g} µN", paper, by_load[load], "area_fraction")
    yield _line("kappa", "κ at 20 µN, h' = 0.1", published.KAPPA, by_load[20.0], "kappa")
    for row, points in rows(studies["table"]):
        yield _line("kappa", f"κ, Table 1 {row.name}", published.KAPPA_ROWS, points, "kappa")


def _table1_lines(studies: Studies) -> Iterable[Line]:
    for row, points in rows(studies["table"]):
        yield _line("table1", f"N_p, {row.name}", row.patches, points, "patches")
        yield _line("table1", f"C/A (1/nm), {row.name}", row.perimeter_to_area, points, "perimeter_to_area")


def _fig3_lines(studies: Studies) -> Iterable[Line]:
    for volume, points in by_volume(studies["slopes"]).items():
        for slope, paper in published.BETA[volume].items():
            group = [p for p in points if math.isclose(p.changes[SLOPE], slope)]
            line = _line("fig3", f"β, h' = {slope:g}, ΔV = {volume:g} Å³", f"{paper:.2f}", group, "beta")
            yield line._replace(calibrated=True)


def _fig6_lines(studies: Studies) -> Iterable[Line]:
    yield _line("fig6", "β, h' = 0.4, half hydroxylated, front", published.FIG_6_BETA, front(studies, 0.5), "beta")


def _tips_lines(studies: Studies) -> Iterable[Line]:
    for (radius, load), group in grouped(studies["tips"], "surface.radius", LOAD).items():
        if load in published.TIP_BETA:
            name = f"β of a tip at {load:g} nN, radius {radius:g} nm"
            yield _line("tips", name, published.TIP_BETA[load], group, "beta")


_LINES: dict[str, Callable[[Studies], Iterable[Line]]] = {
    "kappa": _kappa_lines,
    "table1": _table1_lines,
    "fig3": _fig3_lines,
    "fig6": _fig6_lines,
    "tips": _tips_lines,
}
