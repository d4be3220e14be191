"""The two models of ageing: their least squares, and the confidence intervals of β and the cut-off time.

``"line"``
    β log10(t / t_c).
``"curve"``
    β log10(1 + t / t_c).

Student's t is the default. Every replica gives one slope, so the interval of their mean is exact for replicas whose
bonds are normally distributed, whatever the correlation between hold times. A cut-off time t_c lies in the interval if
the data do not reject it: at the true t_c a certain linear combination of every curve has mean 0, and Student's test
is made of that (Fieller, J. R. Stat. Soc. B 16, 175 (1954), for a line; for a curve it is the score test).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from chemage.foundation.statistics import student_limit
from chemage.foundation.text import ROUNDING

Model = Literal["line", "curve"]
Bootstrap = Literal["residuals", "pairs", "replicas"]


def basis(
    model: Model, t: np.ndarray, log_cutoff: np.ndarray | float
) -> np.ndarray:
    """The model at β = 1; ``t`` and ``log_cutoff`` broadcast."""
    if model == "line":
        return np.log10(t) - log_cutoff
    # log10(1 + t/t_c) without overflow where t_c is far below t
    log_t = np.log(t, out=np.full(t.shape, -np.inf), where=t > 0)
    return np.logaddexp(
        0.0, log_t - np.multiply(log_cutoff, math.log(10))
    ) / math.log(10)


def slopes_of(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The slope of the least-squares line through each of ``y`` (b, m) at ``x`` (m,): (b,)."""
    away = x - x.mean()
    # row by row, so that a curve has the same bits alone and among others
    products = np.array([np.sum(away * (row - row.mean())) for row in y])
    return above_rounding(products / np.sum(away**2), x, y)


def above_rounding(slope: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """``slope`` (b,) of the least-squares lines through ``y`` (b, m) at ``x`` (m,), with 0 where it is no more than the
    rounding of y: bonds that all formed earlier do not age.

    The bound of the rounding of a sum of m products, m ε Σ|x y|, is that of Higham, Accuracy and Stability of Numerical
    Algorithms, 2nd ed. (2002), section 3.1; twice, as the centre of x is rounded as well.
    """
    away = np.abs(x - x.mean())
    rounding = (
        2
        * x.size
        * np.finfo(np.float64).eps
        * np.abs(y).max(axis=-1)
        * away.sum()
        / np.sum(away**2)
    )
    return np.where(np.abs(slope) <= rounding, 0.0, slope)


def solve(
    model: Model, t: np.ndarray, y: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares for each row of ``y`` (b, m) with weights ``w`` (b or 1, m): β and log10 t_c, (b,) each.

    log10 t_c is ±inf or nan where no finite cut-off time is best.
    """
    if model == "curve":
        return _solve_curve(t, y, w)
    x = np.log10(t)
    if (w == 1).all():
        slope, height = slopes_of(x, y), y.mean(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return slope, np.where(
                slope > 0, (slope * x.mean() - height) / slope, np.nan
            )
    total = w.sum(axis=1)
    centre, height = (w * x).sum(axis=1) / total, (w * y).sum(axis=1) / total
    away = x - centre[:, None]
    spread = (w * away**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = above_rounding((w * away * y).sum(axis=1) / spread, x, y)
        # a resample of one hold time, or a line that does not rise, crosses zero nowhere that means anything
        return slope, np.where(slope > 0, centre - height / slope, np.nan)


def time_of(log_time: float) -> float:
    """10**log_time, s; inf beyond the range of numbers, nan where nothing is known."""
    with np.errstate(over="ignore"):
        return float(np.power(10.0, log_time))


def basis_slope(
    model: Model, t: np.ndarray, log_cutoff: np.ndarray | float
) -> np.ndarray:
    """The derivative of :func:`basis` by log10 t_c; between −1 and 0."""
    from scipy import special

    if model == "line":
        return np.full(np.broadcast_shapes(t.shape, np.shape(log_cutoff)), -1.0)
    log_t = np.log10(t, out=np.full(t.shape, -np.inf), where=t > 0)
    return -special.expit((log_t - log_cutoff) * math.log(10))


def bounds(t: np.ndarray) -> tuple[float, float]:
    """Where log10 t_c is searched: beyond, the curve is a constant or a straight line in t, and t_c means nothing."""
    return math.log10(t[t > 0].min()) - 30.0, math.log10(t.max()) + 4.0


def _solve_curve(
    t: np.ndarray, y: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """For a given t_c the best β is a ratio of sums, so only log10 t_c is searched: a coarse grid, then ever finer."""
    lowest, highest = bounds(t)
    grid = np.arange(lowest, highest + 0.05, 0.1)
    shapes = basis("curve", t, grid[:, None])
    w = np.broadcast_to(w, y.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = np.einsum("bm,km->bk", w * y, shapes) ** 2 / np.einsum(
            "bm,km->bk", w, shapes**2
        )
        # a resample of t = 0 alone determines nothing: 0/0
        centre, step = grid[np.nan_to_num(gain, nan=-1.0).argmax(axis=1)], 0.1
        at_end = (centre <= grid[0]) | (centre >= grid[-1])
        offsets = np.linspace(-1.0, 1.0, 9)
        while step > 1e-7:
            tried = centre[:, None] + step * offsets
            shapes = basis("curve", t, tried[:, :, None])
            products = np.einsum("bm,bkm->bk", w * y, shapes)
            gain = products**2 / np.einsum("bm,bkm->bk", w, shapes**2)
            best = np.nan_to_num(gain, nan=-1.0).argmax(axis=1)[:, None]
            centre = np.take_along_axis(tried, best, axis=1)[:, 0]
            step /= 4.0
        shapes = basis("curve", t, centre[:, None])
        slope = (w * y * shapes).sum(axis=1) / (w * shapes**2).sum(axis=1)
    limit = np.where(centre > 0.5 * (lowest + highest), np.inf, -np.inf)
    return slope, np.where(slope > 0, np.where(at_end, limit, centre), np.nan)


# -- intervals --------------------------------------------------------------------------------------------------------


class Interval(NamedTuple):
    """Ends of a confidence interval; an end that the data do not bound is infinite (for a time: 0 or infinite)."""

    low: float
    high: float


UNKNOWN = Interval(math.nan, math.nan)


def student(
    model: Model,
    t: np.ndarray,
    curves: np.ndarray,
    weight: np.ndarray,
    slope: float,
    slope_error: float,
    log_cutoff: float,
    confidence: float,
) -> tuple[Interval, Interval]:
    """Student's intervals of β and of t_c (s).

    Parameters
    ----------
    t, curves, weight
        (m,) s, (replicas, m), (m,). A single curve has independent errors with variances in proportion to 1/weight.
    slope, slope_error, log_cutoff
        The estimates, and the standard error of the first; nan where there is none.
    """
    replicas = len(curves)
    freedom = replicas - 1 if replicas > 1 else t.size - 2
    if freedom < 1:
        return UNKNOWN, UNKNOWN
    if math.isnan(slope_error):
        # a curve that does not rise has no cut-off time, and its slope no meaning
        return UNKNOWN, Interval(0.0, math.inf)
    if slope_error <= ROUNDING * abs(slope):
        # equal replicas, as few bonds often are by chance, or points on the fit: their scatter is not known
        return UNKNOWN, UNKNOWN
    limit = student_limit(freedom, confidence)
    beta = Interval(slope - limit * slope_error, slope + limit * slope_error)
    lowest, highest = bounds(t)
    if not (beta.low > 0 and lowest < log_cutoff < highest):
        # a line that may be flat crosses zero anywhere
        return beta, Interval(0.0, math.inf)

    def statistic(log_times: np.ndarray) -> np.ndarray:
        """|Student's t| of each log10 t_c, (k,)."""
        shape = basis(model, t, log_times[:, None])
        tilt = basis_slope(model, t, log_times[:, None])
        # what is left of the derivative by t_c where β is fitted: 0 on average at the true t_c
        along = (weight * shape * tilt).sum(axis=1) / (weight * shape**2).sum(
            axis=1
        )
        score = weight * (tilt - along[:, None] * shape)
        values = np.einsum("rm,km->rk", curves, score)
        with np.errstate(divide="ignore", invalid="ignore"):
            if replicas > 1:
                error = values.std(axis=0, ddof=1) / math.sqrt(replicas)
            else:
                rest = curves[0] - slope * basis(model, t, log_cutoff)
                error = np.sqrt(
                    (weight * rest**2).sum()
                    / freedom
                    * (score**2 / weight).sum(axis=1)
                )
            return np.abs(values.mean(axis=0)) / error

    return beta, Interval(
        _end(statistic, limit, log_cutoff, lowest, 0.0),
        _end(statistic, limit, log_cutoff, highest, math.inf),
    )


def _end(
    statistic: Callable[[np.ndarray], np.ndarray],
    limit: float,
    start: float,
    stop: float,
    beyond: float,
) -> float:
    """The time (s) between ``start`` and ``stop`` (log10) up to which no cut-off time is rejected; else ``beyond``."""
    grid = np.linspace(start, stop, max(2, math.ceil(abs(stop - start) / 0.02)))[1:]
    rejected = np.flatnonzero(statistic(grid) > limit)
    if not rejected.size:
        return beyond
    outside = float(grid[rejected[0]])
    inside = float(grid[rejected[0] - 1]) if rejected[0] else start
    # each round narrows the step, in which the statistic crosses the limit, tenfold
    for _ in range(8):
        steps = np.linspace(inside, outside, 11)
        above = np.flatnonzero(statistic(steps[1:]) > limit)
        first = int(above[0]) if above.size else 9
        inside, outside = float(steps[first]), float(steps[first + 1])
    return 10.0**inside


def bootstrapped(
    kind: Bootstrap,
    model: Model,
    t: np.ndarray,
    curves: np.ndarray,
    weight: np.ndarray,
    fitted: np.ndarray,
    *,
    confidence: float,
    samples: int,
    seed: int,
) -> tuple[Interval, Interval]:
    """Percentile intervals of β and of t_c (s), widened for small numbers as Student's t is.

    Hesterberg, Am. Stat. 69, 371 (2015), expanded percentile interval. ``fitted``: (m,) the fit.
    """
    from scipy import special

    if kind != "replicas" and t.size < 3:
        return UNKNOWN, UNKNOWN
    heights, weights = _resampled(
        kind, np.random.default_rng(seed), samples, curves, fitted, weight
    )
    slopes, cutoffs = solve(model, t, heights, weights)
    # percentiles whose normal distance is Student's t: a small sample's wider tails
    freedom = len(curves) - 1 if kind == "replicas" else t.size - 2
    tail = float(special.ndtr(-student_limit(max(freedom, 1), confidence)))
    ends = 100 * tail, 100 * (1 - tail)
    # where more samples than a tail holds do not rise at all, the data set no bounds: 0 to infinity
    if np.count_nonzero(~(slopes > 0)) > ends[0] / 100 * slopes.size:
        return _interval(slopes, ends), Interval(0.0, math.inf)
    logs = _interval(cutoffs, ends)
    return _interval(slopes, ends), Interval(time_of(logs.low), time_of(logs.high))


def _resampled(
    kind: Bootstrap,
    generator: np.random.Generator,
    samples: int,
    curves: np.ndarray,
    fitted: np.ndarray,
    weight: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Bootstrap data: values (b, m), weights (b or 1, m)."""
    (replicas, points), mean = curves.shape, curves.mean(axis=0)
    if kind == "replicas":
        # deviations are stretched, since a draw from r replicas has (r − 1)/r of the variance
        drawn = (
            generator.multinomial(
                replicas, np.full(replicas, 1 / replicas), samples
            )
            / replicas
        )
        stretched = (np.einsum("br,rm->bm", drawn, curves) - mean) * math.sqrt(
            replicas / (replicas - 1)
        )
        return mean + stretched, weight[None, :]
    if kind == "pairs":
        times_drawn = generator.multinomial(
            points, np.full(points, 1 / points), samples
        )
        return np.broadcast_to(mean, (samples, points)), times_drawn * weight
    scaled = (mean - fitted) * np.sqrt(weight)
    scaled = (scaled - scaled.mean()) * math.sqrt(points / (points - 2))
    drawn = generator.integers(0, points, (samples, points))
    return fitted + scaled[drawn] / np.sqrt(weight), weight[None, :]


def _interval(values: np.ndarray, ends: tuple[float, float]) -> Interval:
    # order statistics, not interpolated: infinite values must not turn into nan
    finite = np.sort(values[~np.isnan(values)])
    if not finite.size:
        return UNKNOWN
    low, high = (
        float(np.percentile(finite, end, method="nearest")) for end in ends
    )
    return Interval(low, high) if high - low > ROUNDING * abs(high) else UNKNOWN
