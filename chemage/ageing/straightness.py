"""Whether a curve is the line that is fitted to it.

Two tests, each of which calls at most half of :data:`RISK` of all true lines bent:

* The residuals of the mean over replicas are larger than the scatter of the replicas about their own lines explains, by
  the F distribution with the effective degrees of freedom of correlated residuals (Box, Ann. Math. Stat. 25, 290 (1954)).
* The local slope changes by more than a third of the slope of the line, and a cubic fits significantly better than the
  line. Measurements at different hold times are independent; of a simulated curve, whose hold times share their bonds,
  the rises from each to the next are.
"""

from __future__ import annotations

import numpy as np

from chemage.foundation.text import ROUNDING

#: share of true lines that are called bent, at most
RISK = 0.01
#: change of the local slope within a window, over the slope of the line
BENT = 1 / 3
#: a local slope is that over so many decades, and hold times
SPAN_DECADES, SPAN_TIMES = 0.5, 3


def local_slopes(
    x: np.ndarray, y: np.ndarray, weight: np.ndarray
) -> tuple[float, float, float]:
    """The slopes of ``y`` (m,) at the begin, in the middle and at the end of ``x`` (m,), which are decades of time."""
    places = np.unique(x)
    middle = 0.5 * (places[0] + places[-1])
    slopes = []
    for centre, reach in ((places[0], 1.0), (middle, 0.5), (places[-1], 1.0)):
        away = np.abs(x - centre)
        nearest = np.sort(np.abs(places - centre))[:SPAN_TIMES]
        near = away <= max(reach * SPAN_DECADES, nearest[-1]) + ROUNDING
        slopes.append(_slope(x[near], y[near], weight[near]))
    return slopes[0], slopes[1], slopes[2]


def _slope(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> float:
    away = x - np.average(x, weights=weight)
    return float((weight * away * y).sum() / (weight * away**2).sum())


def is_bent(
    x: np.ndarray, curves: np.ndarray, weight: np.ndarray, *, simulated: bool
) -> bool:
    """Whether the mean of ``curves`` (replicas, m) is no line over the ascending ``x`` (m,), decades of time.

    ``weight`` (m,) is in proportion to 1/variance of measurements; ``simulated`` curves weigh 1.
    """
    mean = curves.mean(axis=0)
    if _exceeds_scatter(x, curves):
        return True
    slopes = local_slopes(x, mean, weight)
    if max(slopes) - min(slopes) <= BENT * abs(_slope(x, mean, weight)):
        return False
    return _cubic_fits_better(x, curves, weight, simulated=simulated)


def longest_line(
    x: np.ndarray,
    curves: np.ndarray,
    weight: np.ndarray,
    *,
    simulated: bool,
    points: int,
    decades: float,
) -> tuple[float, float] | None:
    """The ends of the longest part of the ascending ``x`` (m,), over so many ``decades`` and different ``points`` at
    least, in which the mean of ``curves`` (replicas, m) is a line that rises; None: there is none."""
    mean, places = curves.mean(axis=0), np.unique(x)
    # every local slope, and the place where it ends
    slopes, ends = [], []
    for start, place in enumerate(places[: 1 - SPAN_TIMES]):
        reach = np.searchsorted(places, place + SPAN_DECADES - ROUNDING)
        end = max(int(reach), start + SPAN_TIMES - 1)
        if end < places.size:
            near = (x >= place) & (x <= places[end])
            slopes.append(_slope(x[near], mean[near], weight[near]))
            ends.append(end)
    parts = [
        (low, high)
        for low in range(places.size)
        for high in range(low + points - 1, places.size)
        if places[high] - places[low] >= decades - ROUNDING
    ]
    for low, high in sorted(
        parts, key=lambda part: places[part[0]] - places[part[1]]
    ):
        inside = slopes[low : np.searchsorted(ends, high, side="right")]
        least, largest = min(inside), max(inside)
        if least <= 0 or largest - least > BENT * 0.5 * (least + largest):
            continue
        use = (x >= places[low]) & (x <= places[high])
        part = x[use], curves[:, use], weight[use]
        if not _exceeds_scatter(*part[:2]) and not _cubic_fits_better(
            *part, simulated=simulated
        ):
            return float(places[low]), float(places[high])
    return None


def _exceeds_scatter(x: np.ndarray, curves: np.ndarray) -> bool:
    """Whether the mean of (replicas, m) curves is farther from its line than their scatter explains."""
    from scipy import special

    replicas = len(curves)
    if replicas == 1:
        return False
    line, _ = np.linalg.qr(np.stack([np.ones(x.size), x - x.mean()], axis=1))
    rest = curves - (curves @ line) @ line.T
    off = rest.mean(axis=0)
    away = rest - off
    products = away.T @ away / (replicas - 1)
    total = float(np.trace(products))
    if total <= (ROUNDING * np.abs(curves).max()) ** 2:
        return False  # equal replicas, as few bonds often are by chance: their scatter is not known
    freedom = total**2 / float(np.sum(products**2))
    limit = special.fdtri(freedom, freedom * (replicas - 1), 1 - RISK / 2)
    return replicas * float(off @ off) > float(limit) * total


def _cubic_fits_better(
    x: np.ndarray, curves: np.ndarray, weight: np.ndarray, *, simulated: bool
) -> bool:
    """Whether a cubic fits the mean of ``curves`` significantly better than a line."""
    mean = curves.mean(axis=0)
    if not simulated:
        return _fits_better(x, mean, weight, 1)
    x, first = np.unique(x, return_index=True)
    mean, steps = mean[first], np.diff(x)
    return _fits_better(x[:-1] + 0.5 * steps, np.diff(mean) / steps, steps, 0)


def _fits_better(
    x: np.ndarray, y: np.ndarray, weight: np.ndarray, degree: int
) -> bool:
    """Whether two more powers of ``x`` fit independent ``y`` better than a polynomial of this degree."""
    from scipy import special

    freedom = x.size - degree - 3
    if freedom < 2:
        return False
    scaled = (x - x.mean()) / np.ptp(x)
    root = np.sqrt(weight)
    left = []
    for powers in (degree, degree + 2):
        part, _ = np.linalg.qr(np.vander(scaled, powers + 1) * root[:, None])
        rest = root * y - part @ (part.T @ (root * y))
        left.append(float(rest @ rest))
    least = (ROUNDING * float(np.abs(root * y).max())) ** 2
    if left[0] <= least * x.size:
        return False
    limit = float(special.fdtri(2, freedom, 1 - RISK / 2))
    return (left[0] - left[1]) / 2 > limit * max(left[1], least) / freedom
