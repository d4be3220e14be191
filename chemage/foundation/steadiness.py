"""Whether a mean over a window of time is that of something steady, and whether enough bonds made it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from chemage.foundation.quantities import (
    Quantity,
    Rank,
    number_text,
    unit_text,
)
from chemage.foundation.text import percent

#: fewer bonds give an upper bound in place of a mean
FEWEST_BONDS = 20
#: what is recorded beside such a mean: its second half less its first, in its unit; the bonds that one replica forms in
#: the window; the largest share of one bond in the mean, in its unit
CHANGE, FORMED, SHARE = "_change", "_formed", "_per_bond"


def upper_bound(mean: float, share: float, samples: int) -> float:
    """The 95 % upper limit of a mean over ``samples`` that single bonds make, each with at most ``share``: that of a sum
    of Poisson numbers with unequal weights (Fay & Feuer, Stat. Med. 16, 791 (1997)) at the largest variance it can have.
    """
    from scipy.special import gammaincinv

    if not share > 0:
        return mean
    return share / samples * float(gammaincinv(mean * samples / share + 1, 0.95))


def judged(
    numbers: Mapping[str, Quantity],
    rests: Mapping[str, Sequence[str]],
    samples: int,
) -> dict[str, Quantity]:
    """The same ``numbers``, by name, with what is wrong with those that rest on means over a window.

    A mean carries a sentence where the 95 % interval of its change within the window excludes 0, as it does for one of
    twenty steady means; what fewer than 20 bonds made has no value but an upper bound. A number that rests on such means
    has no value. What is recorded beside a mean is for who asks for all.

    Parameters
    ----------
    rests
        Name -> the means over a window on which it rests: itself alone if it is one.
    samples
        Independent replicas over which the numbers are means.
    """
    found, withheld = dict(numbers), set()
    means = [name for name, on in rests.items() if tuple(on) == (name,)]
    for name in means:
        mean = numbers[name]
        beside = [name + part for part in (CHANGE, FORMED, SHARE)]
        change, formed, share = (numbers[one] for one in beside)
        found |= {one: numbers[one].but(rank=Rank.REST) for one in beside}
        bonds = formed.value * samples
        reasons = [mean.reason, _unsteady(mean.value, change)]
        few = bonds < FEWEST_BONDS
        if few:
            high = upper_bound(mean.value, share.value, samples)
            most = f"{number_text(float(f'{high:.2g}'))} {unit_text(mean.unit)}"
            because = f"{number_text(bonds)} bonds formed in the window"
            reasons.insert(0, f"below {most} (95 %): {because}")
            mean = mean.but(value=math.nan).within(0.0, high)
        found[name] = mean.but(reason="; ".join(filter(None, reasons)))
        if few or abs(change.value) > change.half_width:
            withheld.add(name)
    for name in rests.keys() - set(means):
        faulty = [found[mean] for mean in rests[name] if mean in withheld]
        reasons = (f"{one.label} {one.reason}" for one in faulty)
        if faulty:
            empty = numbers[name].but(value=math.nan).within(math.nan, math.nan)
            found[name] = empty.but(reason=f"not taken: {'; '.join(reasons)}")
    return found


def _unsteady(mean: float, change: Quantity) -> str:
    """That a mean changes within its window, or that this is not known; "" where it seems steady."""
    if not change.known:
        return "not tested for being steady: record 4 points or more"
    if math.isnan(change.half_width) and change.value:
        return "not tested for being steady: give 2 replicas or more"
    if not abs(change.value) > change.half_width:
        return ""
    first = mean - change.value / 2
    word = "falls" if change.value < 0 else "rises"
    by = percent(abs(change.value) / first) if first > 0 else "all of it"
    return f"still {word} by {by} within the window"
