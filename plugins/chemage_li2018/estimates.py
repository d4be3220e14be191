"""Estimates of the text of the paper beside ours, and β over the members of the density."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from chemage.plugin import decisions
from chemage_li2018 import published
from chemage_li2018.comparisons import Line, lines
from chemage_li2018.published import NUMBERS, SLOPES, PublishedNumber, window
from chemage_li2018.sweeps import PARTIAL, WITH_PRESSURE, Studies, front, mean

#: the paper's gain of area by plasticity at h' = 1: 2 × 0.2/1.0 = 0.4 of that at h' = 0.2, of which 0.2/1.0 are slopes
PLASTIC = 2.0
#: hold times (s) of all β here
_HOLD = window(WITH_PRESSURE)


class Estimate(NamedTuple):
    """An estimate in the text of the paper, ours, and how ours is computed."""

    statement: str
    ours: str
    how: str
    #: one of the five words, or none where there is no number to compare
    word: str = ""


def estimates(studies: Studies) -> Iterable[Estimate]:
    """Compare the estimates of the text with ours, from the studies ``slopes`` and ``front``."""
    shares = (1.0, 0.5, PARTIAL)
    full, half, partial = (front(studies, share).beta(_HOLD) for share in shares)
    groups = studies["slopes"].by_volume()[6.4].by("rms_slope")
    rough = np.array([group.beta(_HOLD) for group in groups.values()])
    exponents = np.polyfit(np.log(SLOPES), np.log(rough), 1)[0]
    rougher = np.log(full / rough[0]) / np.log(0.4 / SLOPES[0])
    factor = front(studies, 0.5)[0].varied("front_factor")
    paper = PublishedNumber.of(published.MACROSCOPIC_BETA)
    macroscopic = Line("estimates", "β", paper, mean(half), chosen=True).word
    computed = (
        (str(mean(half)), macroscopic),
        (f"{mean(exponents)}; from 0.05 to 0.4 {mean(rougher)}", decisions.CALIBRATED),
        (f"{mean(full * 0.4)}; half hydroxylated with the front {mean(half * 0.4)}",),
        (f"half hydroxylated with the front {mean(half * 0.4 * PLASTIC)}",),
        (f"{mean(partial)}, {mean(partial / half)} times that with f = 0.5",),
        (f"β × {mean(half / factor / full)} and β × {factor:g} exactly",),
    )
    texts = published.DATA["estimates"].items()
    for (statement, how), found in zip(texts, computed, strict=True):
        yield Estimate(statement, found[0], how, *found[1:])


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
            members = studies["members"].at_options(number["at"]).by("member")
            hold = window(number["at"]["chemistry.activation_volume"])
            beta = [group.beta(hold).mean() for group in members.values()]
            low, high = min(beta) / beta[0] - 1, max(beta) / beta[0] - 1
            found.append(Band(line, low, high, len(beta)))
    return found
