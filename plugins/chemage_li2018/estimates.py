"""Estimates of the text of the paper beside ours, what β of Fig. 6 hangs on, and β over the members of the density."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from chemage_li2018 import published
from chemage_li2018.claims import STRAIGHT, crossing, onset
from chemage_li2018.comparisons import (
    DISAGREES,
    PREDICTED,
    Estimate,
    Line,
    Studies,
    by_volume,
    front,
    lines,
)
from chemage_li2018.published import SLOPES, Published
from chemage_li2018.shapes import exponent
from chemage_li2018.sweeps import (
    LITERAL_VOLUME,
    MEMBER,
    PARTIAL,
    SLOPE,
    VOLUME,
    WITH_PRESSURE,
    Mean,
    Point,
    by,
    grouped,
    mean,
)

#: by which plasticity multiplies the elastic contact area at h' = 1: the paper has 2 × 0.2/1.0 = 0.4 times the area at
#: h' = 0.2, of which 0.2/1.0 are the slopes
PLASTIC = 2.0
NONE = "no number to compare"
LATE = (1e2, 1e5)


class Variant:
    """One way to compute β of Fig. 6."""

    def __init__(self, name: str, points: list[Point], window: tuple[float, float] | None = None) -> None:
        self.name = name
        self.beta: Mean = mean(p.beta(window) if window else p.beta() for p in points)


def variants(studies: Studies) -> list[Variant]:
    """β of Fig. 6 by what it depends on."""
    half = front(studies, 0.5)
    return [
        Variant("as computed: 10 to 1e4 s, f = 0.5, ΔV = 6.4 Å³", half),
        Variant("fit window 100 to 1e5 s", half, LATE),
        Variant("f = 0.25 (both faces half hydroxylated)", front(studies, 0.25)),
        Variant(f"f = {PARTIAL:.2f} (2.6 of 4.9 OH/nm²)", front(studies, PARTIAL)),
        Variant('ΔV = 0.04 Å³ ("0.04 Å³" read literally)', front(studies, 0.5, LITERAL_VOLUME)),
        Variant("ΔV = 0.04 Å³, fit window 100 to 1e5 s", front(studies, 0.5, LITERAL_VOLUME), LATE),
    ]


def estimates(studies: Studies) -> list[Estimate]:
    """Compare the estimates of the text with ours, from the studies ``slopes`` and ``front``."""
    return [
        _macroscopic(studies),
        _inverse_slope(studies),
        *_rough_limit(studies),
        _partial(studies),
        _corrections(studies),
    ]


def _macroscopic(studies: Studies) -> Estimate:
    ours = mean(p.beta() for p in front(studies, 0.5))
    line = Line("estimates", "β", Published.of(published.MACROSCOPIC_BETA), ours)
    return Estimate(
        "β of macroscopic experiments is about 0.01",
        str(ours),
        "β of Fig. 6: h' = 0.4, half hydroxylated, detachment-front factor 0.15",
        line.word,
    )


def _inverse_slope(studies: Studies) -> Estimate:
    with_volume = by_volume(studies["slopes"])[6.4]
    groups = by(with_volume, SLOPE)
    products = {slope: mean(p.beta() * slope for p in groups[slope]) for slope in SLOPES}
    roughest = front(studies, 1.0)
    products[0.4] = mean(p.beta() * 0.4 for p in roughest)
    slopes = np.array([*SLOPES, 0.4])
    betas = np.array([[p.beta() for p in points] for points in (*(groups[slope] for slope in SLOPES), roughest)]).T
    power = exponent(slopes, betas)
    return Estimate(
        "β is proportional to 1/h'",
        f"β ∝ h' to the power {power}: "
        + ", ".join(f"β h' = {mean_of_slope} at h' = {slope:g}" for slope, mean_of_slope in products.items()),
        "β over 10 to 1e4 s, fully hydroxylated, ΔV = 6.4 Å³; the power is −1 if the claim holds, to within "
        f"{STRAIGHT:g}",
        PREDICTED if abs(power.value + 1) + np.nan_to_num(power.half_width) <= STRAIGHT else DISAGREES,
    )


def _rough_limit(studies: Studies) -> list[Estimate]:
    full = mean(p.beta() * 0.4 for p in front(studies, 1.0))
    half = mean(p.beta() * 0.4 for p in front(studies, 0.5))
    plastic = half.times(PLASTIC)
    return [
        Estimate(
            "β for h' → 1, elastic",
            f"{full} fully hydroxylated; {half} half hydroxylated with the front",
            "extrapolation: β at h' = 0.4 times 0.4, which assumes β ∝ 1/h'; not computed at h' = 1, where "
            "the small-slope theory does not hold",
            NONE,
        ),
        Estimate(
            f"β for h' → 1 with plasticity (area × {PLASTIC:g})",
            f"{plastic} half hydroxylated with the front",
            f"the extrapolation above times {PLASTIC:g}, as in the paper (area 2 × 0.2/1.0 = 0.4 of that at h' = 0.2): "
            "β follows the contact area; plasticity itself is not modelled",
            NONE,
        ),
    ]


def _partial(studies: Studies) -> Estimate:
    half, partial = (mean(p.beta() for p in front(studies, f)) for f in (0.5, PARTIAL))
    ratio = mean(a.beta() / b.beta() for a, b in zip(front(studies, PARTIAL), front(studies, 0.5), strict=True))
    return Estimate(
        "2.6 OH/nm² instead of 4.9",
        f"β = {partial} with f = {PARTIAL:.2f}; {ratio} times that with f = 0.5 ({half})",
        "a pixel has a site with probability 2.6/4.9 and the pixels stay as they are: the contact and the distance of "
        "neighbours are those of the paper, and sites are lost at random, as on a dehydroxylated surface; pixels of "
        "1/√2.6 nm would change the contact as well",
        NONE,
    )


def _corrections(studies: Studies) -> Estimate:
    full, half = front(studies, 1.0), front(studies, 0.5)
    factor = half[0].changes["chemistry.front_factor"]
    ratio = mean(a.beta() / factor / b.beta() for a, b in zip(half, full, strict=True))
    return Estimate(
        "each correction of Fig. 6 by itself",
        f"half of the hydroxyl groups: β × {ratio}; the detachment front: β × {factor:g} exactly",
        "β at h' = 0.4 with half and with all of the sites; neighbours that are missing block no bond, so that half of "
        "the sites have more than half of the bonds",
        NONE,
    )


class Band(NamedTuple):
    """β over the members of the density, relative to member 0, and the residual of member 0 from the paper."""

    quantity: str
    paper: str
    residual: float
    low: float
    high: float
    members: int
    word: str


def bands(studies: Studies) -> list[Band]:
    """The bands of the β of Fig. 3 and Fig. 6 over the members, and the comparisons of member 0 with the paper."""
    compared = lines(studies, ["fig3", "fig6"])
    groups = by(studies["members"], SLOPE)
    bands_of_fit = []
    for slope in published.SLOPES:
        for volume, points in by_volume(groups[slope]).items():
            quantity = f"β, h' = {slope:g}, ΔV = {volume:g} Å³"
            bands_of_fit.append(_band(quantity, f"{published.BETA[volume][slope]:.2f}", points, compared))
    bands_of_fit.sort(key=lambda band: band.quantity.endswith("= 0 Å³"))
    quantity = "β, h' = 0.4, half hydroxylated, front"
    return [*bands_of_fit, _band(quantity, published.FIG_6_BETA, groups[0.4], compared)]


def times(studies: Studies) -> dict[str, tuple[float, float]]:
    """The least and the largest of three times of Fig. 3 over the members, s."""
    seconds: dict[str, list[float]] = {"reversal": [], "onset with ΔV": [], "onset without": []}
    for group in by(studies["members"], MEMBER).values():
        chosen = grouped(group, SLOPE, VOLUME)
        low, high = (chosen[slope, WITH_PRESSURE] for slope in (published.SLOPES[0], published.SLOPES[-1]))
        seconds["reversal"].append(crossing(low, high))
        seconds["onset with ΔV"].append(onset(chosen[0.1, WITH_PRESSURE]))
        seconds["onset without"].append(onset(chosen[0.1, 0.0]))
    return {name: (float(np.nanmin(values)), float(np.nanmax(values))) for name, values in seconds.items()}


def _band(quantity: str, paper: str, points: list[Point], lines: list[Line]) -> Band:
    by_member = {member: mean(p.beta() for p in group).value for member, group in by(points, MEMBER).items()}
    relative = [value / by_member[0] - 1 for value in by_member.values()]
    line = next(line for line in lines if line.quantity == quantity)
    return Band(quantity, paper, line.difference, min(relative), max(relative), len(relative), line.word)
