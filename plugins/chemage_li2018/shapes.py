"""Shapes that claims are about, fits of these, and times at which curves reach something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def grown(times: np.ndarray, slopes: Sequence[float]) -> np.ndarray:
    """From 0 to 1 over hold times (m,), with these slopes in the middle of each decade, between them on lines."""
    x = np.log10(times / times[0])
    fine = np.linspace(0, x[-1], 2001)
    slope = np.interp(fine[1:], np.arange(len(slopes)) + 0.5, slopes)
    total = np.concatenate([[0], np.cumsum(slope)])
    return np.interp(x, fine, total / total[-1])


def law(x: np.ndarray, n: float, offset: float, bend: float, hump: float) -> np.ndarray:
    """(xⁿ + offset) (1 + bend x) with a hump in the middle, at x (k,) in units of its geometric mean; at least 0.01."""
    u = np.log(x / x.min()) / np.log(x.max() / x.min())
    x = x / np.exp(np.log(x).mean())
    bump = np.exp(-(((u - 0.5) / 0.2) ** 2))
    return np.maximum((x**n + offset) * (1 + bend * x) * (1 + hump * bump), 0.01)


def rms(values: np.ndarray, fitted: np.ndarray) -> float:
    """Rms deviation of values from fitted ones, relative to these."""
    return float(np.sqrt(np.mean((values / fitted - 1) ** 2)))


def fit(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and offset of the line through y (x)."""
    away = x - x.mean()
    slope = float(away @ y / (away @ away))
    return slope, float(y.mean() - slope * x.mean())


def power(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Exponent of the power through y (x), and the rms deviation from it, relative."""
    exponent, factor = fit(np.log(x), np.log(y))
    return exponent, rms(y, np.exp(factor) * x**exponent)


def line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Rms deviation from the line through y (x), relative; its offset over the mean of y; the rms over that of a power.

    Where a line with an offset and a power are alike, only the last tells them apart.
    """
    slope, offset = fit(x, y)
    away = rms(y, offset + slope * x)
    return away, offset / float(y.mean()), away / power(x, y)[1]


def local_slopes(times: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Slope of a curve (m,) against log10 t in each decade of hold times (m,), over their mean."""
    x = np.log10(times / times[0])
    slopes = []
    for first in range(round(x[-1])):
        inside = (x >= first - 0.01) & (x <= first + 1.01)
        slopes.append(fit(x[inside], curve[inside])[0])
    return np.array(slopes) / np.mean(slopes)


def first_reaching(
    times: np.ndarray, values: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """Hold time at which ``values`` (..., m) first reach ``level`` (...), or the first one."""
    return _between(
        times, values, np.argmax(values >= level[..., None], axis=-1), level
    )


def last_positive(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Hold time after which ``values`` (..., m) are not positive again; the first or the last one if there is none."""
    positive = values > 0
    after = np.where(
        positive.any(axis=-1), times.size - np.argmax(positive[..., ::-1], axis=-1), 1
    )
    return _between(
        times, values, np.minimum(after, times.size - 1), np.zeros(values.shape[:-1])
    )


def _between(
    times: np.ndarray, values: np.ndarray, at: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """The time between those at − 1 and at where ``values`` (..., m), linear in its logarithm, have ``level``."""
    before, decades = np.maximum(at - 1, 0), np.log10(times)
    first, last = (
        np.take_along_axis(values, place[..., None], -1)[..., 0]
        for place in (before, at)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(np.clip((level - first) / (last - first), 0, 1))
    return 10 ** (decades[before] + share * (decades[at] - decades[before]))
