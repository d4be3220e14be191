"""How many samples of each level make an interval narrow enough at the lowest cost.

The estimate is a sum of means over independent levels (Giles, Oper. Res. 56, 607 (2008)): of the cheapest computation
on many surfaces, and of the difference between a better and a cheaper one on few. Its variance is Σ v/n, with v the
variance of one sample of a level and n their number; its degrees of freedom are those of Welch, Biometrika 34, 28
(1947), and Satterthwaite, Biometrics Bulletin 2, 110 (1946).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from chemage.foundation.statistics import student_limit

#: more samples of a level than this are not asked for
MOST = 10_000_000


@dataclass(frozen=True)
class Spread:
    """The variance of one sample of a level, and how well it is known."""

    #: (quantities,)
    variance: np.ndarray
    #: degrees of freedom of the variance
    freedom: int


def spread_of(rows: np.ndarray, chosen: int, freedom: int, regressed: bool = False) -> Spread:
    """The spread of a level from its samples: that of the first ``chosen``, or of all of them where it is larger.

    Parameters
    ----------
    rows
        (samples, quantities)
    regressed
        Whether the rows are what remains of a regression, whose coefficient takes a degree of freedom and adds its own
        error to the mean (Cochran, Sampling Techniques, 3rd ed. (1977), section 12.6).
    """
    parts = []
    for part in (rows[:chosen], rows):
        count, variance = len(part), part.var(axis=0, ddof=1)
        if regressed and count > 3:
            variance = variance * (count - 1) / (count - 2) * (1 + 1 / (count - 3))
        parts.append(variance)
    return Spread(np.maximum(*parts), max(1, freedom - 1) if regressed else freedom)


def regressed(values: list[np.ndarray]) -> list[np.ndarray]:
    """The samples of each level with those of the first freed from what the control, the last of them, explains, and
    those of the control in units of each quantity.

    This is double sampling with a regression estimator (Cochran, Sampling Techniques, 3rd ed. (1977), section 12.6),
    known as multifidelity Monte Carlo where the control is a cheaper model (Peherstorfer, Willcox & Gunzburger, SIAM J.
    Sci. Comput. 38, A3163 (2016)). Of n samples y of the first level and N ≥ n of the control x, a cheap number of
    each surface,

        mean = ȳ_n + α (x̄_N − x̄_n),   variance = σ²(1 − ρ²)/n + σ²ρ²/N

    with the slope α of y against x and their correlation ρ; the two terms are uncorrelated, since the residuals of a
    regression are uncorrelated with x.

    Parameters
    ----------
    values
        (samples, quantities) of each level, and (N, 1) of the control on the surfaces of the first level and on more.
    """
    first, control = values[0], values[-1][:, 0]
    pairs = control[: len(first)]
    centred = pairs - pairs.mean()
    square = float(centred @ centred)
    slope = centred @ first / square if square > 0 else np.zeros(first.shape[1])
    about = control - control.mean()
    return [first - np.outer(about[: len(first)], slope), *values[1:-1], np.outer(about, slope)]


def half_width(spreads: list[Spread], counts: list[int], known: np.ndarray) -> np.ndarray:
    """Half the width of the interval of the sum of the means, (quantities,); nan where all samples are equal and no
    other error is known, since equal samples say nothing of their scatter.

    Parameters
    ----------
    spreads, counts
        Of each level: its spread, and the number of samples in its mean.
    known
        (quantities,) standard errors from other causes, known before; they are taken as normal.
    """
    parts = [spread.variance / count for spread, count in zip(spreads, counts, strict=True)]
    total = sum(parts) + known**2
    half = np.full(total.shape, np.nan)
    for k, variance in enumerate(total):
        if variance > 0:
            below = sum(
                float(part[k]) ** 2 / spread.freedom for part, spread in zip(parts, spreads, strict=True) if part[k] > 0
            )
            freedom = float(variance) ** 2 / below if below > 0 else math.inf
            half[k] = limit(freedom) * math.sqrt(variance)
    return half


def limit(freedom: float) -> float:
    """Student's limit; of the normal distribution where the freedom is infinite."""
    return student_limit(min(freedom, 1e9))  # pyright: ignore[reportArgumentType]


def allocated(
    spreads: list[Spread],
    costs: list[float],
    done: list[int],
    known: np.ndarray,
    wanted: np.ndarray,
) -> list[int] | None:
    """The cheapest numbers of samples, none below ``done``, whose interval is within ``wanted`` in every quantity.

    None: no number of samples is enough, because of the errors that are ``known``.
    """
    if np.any(limit(math.inf) * known >= wanted):
        return None
    counts = list(done)
    for k, half in enumerate(wanted):
        if not math.isfinite(half):
            continue
        column = [Spread(spread.variance[k : k + 1], spread.freedom) for spread in spreads]
        needed = _of_one(column, costs, done, known[k : k + 1], float(half))
        counts = [max(pair) for pair in zip(counts, needed, strict=True)]
    return counts


def _of_one(spreads: list[Spread], costs: list[float], done: list[int], known: np.ndarray, wanted: float) -> list[int]:
    """As :func:`allocated`, of one quantity."""
    scale = 1.0
    counts = list(done)
    # Student's limit depends on the counts; it falls as they rise, so that doubling the goal always ends
    for _ in range(200):
        if float(half_width(spreads, counts, known)[0]) <= wanted:
            break
        goal = (wanted / limit(math.inf)) ** 2 - float(known[0]) ** 2
        counts = _optimal([float(spread.variance[0]) for spread in spreads], costs, done, max(goal, 1e-300) / scale)
        scale *= 1.05
    return counts


def _optimal(variances: list[float], costs: list[float], done: list[int], goal: float) -> list[int]:
    """Counts that give Σ v/n ≤ ``goal`` at the lowest cost, none below ``done``."""
    counts = [float(count) for count in done]
    free = [k for k, variance in enumerate(variances) if variance > 0]
    while free:
        held = sum(variances[k] / counts[k] for k in range(len(counts)) if k not in free)
        left = goal - held
        if left <= 0:  # what is held is too much: let everything grow
            free, left = [k for k, variance in enumerate(variances) if variance > 0], goal
        share = sum(math.sqrt(variances[k] * costs[k]) for k in free)
        best = {k: math.sqrt(variances[k] / costs[k]) * share / left for k in free}
        short = [k for k in free if best[k] < done[k]]
        if not short or len(short) == len(free):
            for k in free:
                counts[k] = max(best[k], done[k])
            break
        free = [k for k in free if k not in short]
    return [min(MOST, math.ceil(count - 1e-9)) for count in counts]
