"""Estimates of the text of the paper beside ours, what β of Fig. 6 hangs on, and β over the members of the density."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from chemage.plugin import FIT_WINDOW
from chemage_li2018 import published
from chemage_li2018.claims import STRAIGHT, crossings, onsets
from chemage_li2018.comparisons import DISAGREES, PREDICTED, Estimate, Line, lines
from chemage_li2018.published import NUMBERS, SLOPES, PublishedNumber
from chemage_li2018.shapes import Exponent
from chemage_li2018.sweeps import (
    FRONT,
    LITERAL_VOLUME,
    MEMBER,
    PARTIAL,
    SLOPE,
    VOLUME,
    WITH_PRESSURE,
    Mean,
    PointSet,
    Studies,
    front,
    mean,
)

#: by which plasticity multiplies the elastic contact area at h' = 1: the paper has 2 × 0.2/1.0 = 0.4 times the area at
#: h' = 0.2, of which 0.2/1.0 are the slopes
PLASTIC = 2.0
NONE = "no number to compare"
LATE = (1e2, 1e5)


def variants(studies: Studies) -> dict[str, Mean]:
    """β of Fig. 6 by what it depends on."""
    half, literal = front(studies, 0.5), front(studies, 0.5, LITERAL_VOLUME)
    computed: dict[str, tuple[PointSet, tuple[float, float]]] = {
        "as computed: 10 to 1e4 s, f = 0.5, ΔV = 6.4 Å³": (half, FIT_WINDOW),
        "fit window 100 to 1e5 s": (half, LATE),
        "f = 0.25 (both faces half hydroxylated)": (front(studies, 0.25), FIT_WINDOW),
        f"f = {PARTIAL:.2f} (2.6 of 4.9 OH/nm²)": (front(studies, PARTIAL), FIT_WINDOW),
        'ΔV = 0.04 Å³ ("0.04 Å³" read literally)': (literal, FIT_WINDOW),
        "ΔV = 0.04 Å³, fit window 100 to 1e5 s": (literal, LATE),
    }
    return {
        name: mean(points.beta(window)) for name, (points, window) in computed.items()
    }


def estimates(studies: Studies) -> Iterable[Estimate]:
    """Compare the estimates of the text with ours, from the studies ``slopes`` and ``front``."""
    full, half, partial = (front(studies, share) for share in (1.0, 0.5, PARTIAL))
    beta = mean(half.beta())
    yield Estimate(
        "β of macroscopic experiments is about 0.01",
        str(beta),
        "β of Fig. 6: h' = 0.4, half hydroxylated, detachment-front factor 0.15",
        Line(
            "estimates", "β", PublishedNumber.of(published.MACROSCOPIC_BETA), beta
        ).word,
    )
    groups = {**studies["slopes"].by_volume()[6.4].by(SLOPE), 0.4: full}
    slopes = np.array(list(groups))
    betas = np.array([group.beta() for group in groups.values()])
    power = Exponent.of(slopes, betas.T)
    products = ", ".join(
        f"β h' = {mean(beta_h * h)} at h' = {h:g}"
        for h, beta_h in zip(slopes, betas, strict=True)
    )
    yield Estimate(
        "β is proportional to 1/h'",
        f"β ∝ h' to the power {power}: {products}",
        "β over 10 to 1e4 s, fully hydroxylated, ΔV = 6.4 Å³; the power is −1 if the claim holds, to within "
        f"{STRAIGHT:g}",
        PREDICTED
        if abs(power.value + 1) + np.nan_to_num(power.half_width) <= STRAIGHT
        else DISAGREES,
    )
    yield from rough_limit(full, half)
    yield Estimate(
        "2.6 OH/nm² instead of 4.9",
        f"β = {mean(partial.beta())} with f = {PARTIAL:.2f}; {mean(partial.beta() / half.beta())} times that with "
        f"f = 0.5 ({beta})",
        "a pixel has a site with probability 2.6/4.9 and the pixels stay as they are: the contact and the distance of "
        "neighbours are those of the paper, and sites are lost at random, as on a dehydroxylated surface; pixels of "
        "1/√2.6 nm would change the contact as well",
        NONE,
    )
    factor = half[0].changes[FRONT]
    yield Estimate(
        "each correction of Fig. 6 by itself",
        f"half of the hydroxyl groups: β × {mean(half.beta() / factor / full.beta())}; the detachment front: "
        f"β × {factor:g} exactly",
        "β at h' = 0.4 with half and with all of the sites; neighbours that are missing block no bond, so that half of "
        "the sites have more than half of the bonds",
        NONE,
    )


def rough_limit(full: PointSet, half: PointSet) -> Iterable[Estimate]:
    """Extrapolate β of h' = 0.4 to h' = 1, elastic and with plasticity."""
    yield Estimate(
        "β for h' → 1, elastic",
        f"{mean(full.beta() * 0.4)} fully hydroxylated; {mean(half.beta() * 0.4)} half hydroxylated with the front",
        "extrapolation: β at h' = 0.4 times 0.4, which assumes β ∝ 1/h'; not computed at h' = 1, where "
        "the small-slope theory does not hold",
        NONE,
    )
    yield Estimate(
        f"β for h' → 1 with plasticity (area × {PLASTIC:g})",
        f"{mean(half.beta() * 0.4 * PLASTIC)} half hydroxylated with the front",
        f"the extrapolation above times {PLASTIC:g}, as in the paper (area 2 × 0.2/1.0 = 0.4 of that at h' = 0.2): "
        "β follows the contact area; plasticity itself is not modelled",
        NONE,
    )


class Band(NamedTuple):
    """β over the members of the density, relative to member 0, and the comparison of member 0 with the paper."""

    line: Line
    low: float
    high: float
    members: int


def bands(studies: Studies) -> list[Band]:
    """The bands of the β of Fig. 3 and Fig. 6 over the members."""
    found = []
    for target in ("fig3", "fig6"):
        compared = zip(NUMBERS[target], lines(studies, [target]), strict=True)
        for number, line in compared:
            members = studies["members"].at_options(number["at"]).by(MEMBER)
            beta = [one.value for one in members.means(PointSet.beta).values()]
            low, high = min(beta) / beta[0] - 1, max(beta) / beta[0] - 1
            found.append(Band(line, low, high, len(beta)))
    return found


def times(studies: Studies) -> dict[str, tuple[float, float]]:
    """The least and the largest of three times of Fig. 3 over the members, s."""
    members = studies["members"].by(SLOPE, VOLUME)
    low, high = (members[slope, WITH_PRESSURE] for slope in (SLOPES[0], SLOPES[-1]))
    seconds = {
        "reversal": crossings(low, high),
        "onset with ΔV": onsets(members[0.1, WITH_PRESSURE]),
        "onset without": onsets(members[0.1, 0.0]),
    }
    return {
        name: (float(np.nanmin(values)), float(np.nanmax(values)))
        for name, values in seconds.items()
    }
