"""β over the members of the barrier density, sets of parameters that fit the published β about as well as the best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from chemage_studies.reproduction import numbers, published
from chemage_studies.reproduction.claims import crossing, onset
from chemage_studies.reproduction.numbers import Studies, by_volume
from chemage_studies.reproduction.points import SLOPE, VOLUME, Point, by, grouped, mean
from chemage_studies.reproduction.studies import VOLUME as WITH_PRESSURE
from chemage_studies.reproduction.verdicts import Line

MEMBER = "forming.member"


class Band(NamedTuple):
    """β over the members of the density, relative to the best, and the residual of the best from the paper."""

    quantity: str
    paper: str
    residual: float
    low: float
    high: float
    members: int
    word: str


def bands(studies: Studies) -> list[Band]:
    """The bands of the β of Fig. 3 and Fig. 6 over the members, and the comparisons of the best with the paper."""
    lines = numbers.lines(studies, ["fig3", "fig6"])
    groups = by(studies["members"], SLOPE)
    made = []
    for slope in published.SLOPES:
        for volume, points in by_volume(groups[slope]).items():
            quantity = f"β, h' = {slope:g}, ΔV = {volume:g} Å³"
            made.append(_band(quantity, f"{published.BETA[volume][slope]:.2f}", points, lines))
    made.sort(key=lambda band: band.quantity.endswith("= 0 Å³"))
    quantity = "β, h' = 0.4, half hydroxylated, front"
    return [*made, _band(quantity, published.FIG_6_BETA, groups[0.4], lines)]


def times(studies: Studies) -> dict[str, tuple[float, float]]:
    """The least and the largest of three times of Fig. 3 over the members, s, of which none was fitted."""
    by_member = by(studies["members"], MEMBER).values()
    found: dict[str, list[float]] = {"reversal": [], "onset with ΔV": [], "onset without": []}
    for group in by_member:
        chosen = grouped(group, SLOPE, VOLUME)
        low, high = (chosen[slope, WITH_PRESSURE] for slope in (published.SLOPES[0], published.SLOPES[-1]))
        found["reversal"].append(crossing(low, high))
        found["onset with ΔV"].append(onset(chosen[0.1, WITH_PRESSURE]))
        found["onset without"].append(onset(chosen[0.1, 0.0]))
    return {name: (float(np.nanmin(values)), float(np.nanmax(values))) for name, values in found.items()}


def _band(quantity: str, paper: str, points: list[Point], lines: list[Line]) -> Band:
    by_member = {member: mean(p.beta() for p in group).value for member, group in by(points, MEMBER).items()}
    relative = [value / by_member[0] - 1 for value in by_member.values()]
    line = next(line for line in lines if line.quantity == quantity)
    return Band(quantity, paper, line.difference, min(relative), max(relative), len(relative) - 1, line.word)
