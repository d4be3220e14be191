"""The two models of ageing, and their least squares.

``"line"``
    β log10(t / t_c).
``"curve"``
    β log10(1 + t / t_c).
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

Model = Literal["line", "curve"]


def basis(model: Model, t: np.ndarray, log_cutoff: np.ndarray | float) -> np.ndarray:
    """The model at β = 1; ``t`` and ``log_cutoff`` broadcast."""
    if model == "line":
        return np.log10(t) - log_cutoff
    # log10(1 + t/t_c) without overflow where t_c is far below t
    log_t = np.log(t, out=np.full(t.shape, -np.inf), where=t > 0)
    return np.logaddexp(0.0, log_t - np.multiply(log_cutoff, math.log(10))) / math.log(10)


def above_rounding(slope: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """``slope`` (b,) of the least-squares lines through ``y`` (b, m) at ``x`` (m,), with 0 where it is no more than the
    rounding of y: bonds that all formed earlier do not age.

    The bound of the rounding of a sum of m products, m ε Σ|x y|, is that of Higham, Accuracy and Stability of Numerical
    Algorithms, 2nd ed. (2002), section 3.1; twice, as the centre of x is rounded as well.
    """
    away = np.abs(x - x.mean())
    rounding = 2 * x.size * np.finfo(np.float64).eps * np.abs(y).max(axis=-1) * away.sum() / (away @ away)
    return np.where(np.abs(slope) <= rounding, 0.0, slope)


def solve(model: Model, t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares for each row of ``y`` (b, m) with weights ``w`` (b or 1, m): β and log10 t_c, (b,) each.

    log10 t_c is ±inf or nan where no finite cut-off time is best.
    """
    return _solve_line(t, y, w) if model == "line" else _solve_curve(t, y, w)


def _solve_line(t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.log10(t)
    total = w.sum(axis=1)
    centre, height = (w * x).sum(axis=1) / total, (w * y).sum(axis=1) / total
    away = x - centre[:, None]
    spread = (w * away**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = above_rounding((w * away * y).sum(axis=1) / spread, x, y)
        # a resample of one hold time, or a line that does not rise, crosses zero nowhere that means anything
        return slope, np.where(slope > 0, centre - height / slope, np.nan)


def basis_slope(model: Model, t: np.ndarray, log_cutoff: np.ndarray | float) -> np.ndarray:
    """The derivative of :func:`basis` by log10 t_c; between −1 and 0."""
    from scipy import special

    if model == "line":
        return np.full(np.broadcast_shapes(t.shape, np.shape(log_cutoff)), -1.0)
    log_t = np.log10(t, out=np.full(t.shape, -np.inf), where=t > 0)
    return -special.expit((log_t - log_cutoff) * math.log(10))


def bounds(t: np.ndarray) -> tuple[float, float]:
    """Where log10 t_c is searched: beyond, the curve is a constant or a straight line in t, and t_c means nothing."""
    return math.log10(t[t > 0].min()) - 30.0, math.log10(t.max()) + 4.0


def _solve_curve(t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For a given t_c the best β is a ratio of sums, so only log10 t_c is searched: a coarse grid, then ever finer."""
    lowest, highest = bounds(t)
    grid = np.arange(lowest, highest + 0.05, 0.1)
    shapes = basis("curve", t, grid[:, None])
    w = np.broadcast_to(w, y.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = ((w * y) @ shapes.T) ** 2 / (w @ (shapes**2).T)
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
