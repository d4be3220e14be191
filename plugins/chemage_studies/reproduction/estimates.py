"""The estimates in the text of the paper, with how ours are computed."""

from __future__ import annotations

import numpy as np

from chemage_studies.reproduction import published
from chemage_studies.reproduction.numbers import Studies, by_volume, front
from chemage_studies.reproduction.points import SLOPE, Mean, Point, by, mean
from chemage_studies.reproduction.published import SLOPES, Published
from chemage_studies.reproduction.studies import LITERAL_VOLUME, PARTIAL
from chemage_studies.reproduction.verdicts import COMMON, DISAGREES, PREDICTED, Estimate, Line

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
    products[0.4] = mean(p.beta() * 0.4 for p in front(studies, 1.0))
    values = np.array([one.value for one in products.values()])
    return Estimate(
        "β is proportional to 1/h'",
        ", ".join(f"β h' = {one} at h' = {slope:g}" for slope, one in products.items()),
        "β over 10 to 1e4 s, fully hydroxylated, ΔV = 6.4 Å³; constant if the claim holds",
        PREDICTED if float(np.ptp(values) / values.mean()) <= 2 * COMMON else DISAGREES,
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
