"""Comparison of the published numbers with the computed ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from chemage_studies.reproduction import published
from chemage_studies.reproduction.points import LOAD, ROW, SLOPE, VOLUME, Point, by, grouped, mean
from chemage_studies.reproduction.published import Published
from chemage_studies.reproduction.studies import VOLUME as WITH_PRESSURE
from chemage_studies.reproduction.verdicts import Line

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


def _kappa(studies: Studies) -> Iterable[Line]:
    by_load = {load / 1000: group for load, group in by(studies["loads"], LOAD).items()}
    for load, paper in published.AREA_FRACTION.items():
        yield _line("kappa", f"A/A0 at {load:g} µN", paper, by_load[load], "area_fraction")
    yield _line("kappa", "κ at 20 µN, h' = 0.1", published.KAPPA, by_load[20.0], "kappa")
    for row, points in rows(studies["table"]):
        yield _line("kappa", f"κ, Table 1 {row.name}", published.KAPPA_ROWS, points, "kappa")


def _table1(studies: Studies) -> Iterable[Line]:
    for row, points in rows(studies["table"]):
        yield _line("table1", f"N_p, {row.name}", row.patches, points, "patches")
        yield _line("table1", f"C/A (1/nm), {row.name}", row.perimeter_to_area, points, "perimeter_to_area")


def _fig3(studies: Studies) -> Iterable[Line]:
    for volume, points in by_volume(studies["slopes"]).items():
        for slope, paper in published.BETA[volume].items():
            group = [p for p in points if math.isclose(p.changes[SLOPE], slope)]
            line = _line("fig3", f"β, h' = {slope:g}, ΔV = {volume:g} Å³", f"{paper:.2f}", group, "beta")
            yield line._replace(calibrated=True)


def _fig6(studies: Studies) -> Iterable[Line]:
    yield _line("fig6", "β, h' = 0.4, half hydroxylated, front", published.FIG_6_BETA, front(studies, 0.5), "beta")


def _tips(studies: Studies) -> Iterable[Line]:
    for (radius, load), group in grouped(studies["tips"], "surface.radius", LOAD).items():
        if load in published.TIP_BETA:
            name = f"β of a tip at {load:g} nN, radius {radius:g} nm"
            yield _line("tips", name, published.TIP_BETA[load], group, "beta")


_LINES: dict[str, Callable[[Studies], Iterable[Line]]] = {
    "kappa": _kappa,
    "table1": _table1,
    "fig3": _fig3,
    "fig6": _fig6,
    "tips": _tips,
}
