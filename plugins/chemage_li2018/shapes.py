"""Shapes that claims are about, with rivals that a figure might hide; and times at which curves reach something.

A rival of ``x`` ↦ ``a + b x`` is scaled to the same range, so that only its shape differs.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Curves = dict[str, np.ndarray]


def _steps(u: np.ndarray, slope: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Integrate a slope over u from 0 to 1, scaled to end at 1."""
    fine = np.linspace(0, 1, 2001)
    total = np.concatenate([[0], np.cumsum(slope(0.5 * (fine[1:] + fine[:-1])))])
    return np.interp(u, fine, total / total[-1])


def _bump(u: np.ndarray) -> np.ndarray:
    """1 in the middle of 0 to 1, and 0 towards the ends."""
    return np.exp(-(((u - 0.5) / 0.2) ** 2))


def growth_rivals(times: np.ndarray, start: float, rise: float) -> Curves:
    """Laws of growth that are no logarithm, from ``start`` by ``rise`` over hold times (m,) s."""
    ratio = times / times[0]
    u = np.log(ratio) / np.log(ratio[-1])
    grown = {f"t^{n:g}": ratio**n for n in (-0.1, -0.05, 0.05, 0.1, 0.2)}
    grown["stretched exponential"] = -np.exp(-((ratio / 1e3) ** 0.2))
    grown["exponential approach"] = -np.exp(-ratio / 0.1 / ratio[-1])
    laws = {name: (y - y[0]) / (y[-1] - y[0]) for name, y in grown.items()}
    laws["slope 40 % higher in the middle"] = _steps(u, lambda u: 1 + 0.4 * _bump(u))
    laws["slope 40 % lower in the middle"] = _steps(u, lambda u: 1 - 0.4 * _bump(u))
    laws["slope that halves"] = _steps(u, lambda u: np.where(u < 0.5, 2.0, 1.0))
    laws["slope that doubles"] = _steps(u, lambda u: np.where(u < 0.4, 1.0, 2.0))
    laws["log² t"] = u**2
    laws["√log t"] = np.sqrt(u)
    return {name: start + rise * law for name, law in laws.items()}


def proportional_rivals(x: np.ndarray, factor: float) -> Curves:
    """Laws that are not ``factor`` x, at x (k,) > 0."""
    middle, last = np.exp(np.log(x).mean()), x.max()
    u = np.log(x / x.min()) / np.log(last / x.min())
    laws = {
        f"x^{n:.3g}": middle * (x / middle) ** n
        for n in (0.5, 2 / 3, 0.9, 0.95, 1.05, 1.1)
    }
    laws["an offset of 20 %"] = x + 0.2 * middle
    laws["an offset of −20 %"] = np.maximum(x - 0.2 * middle, 0.01 * x)
    laws["saturating"] = x / (1 + 0.5 * x / last)
    laws["bent upwards"] = x * (1 + 0.5 * x / last)
    laws["20 % more in the middle"] = x * (1 + 0.2 * _bump(u))
    laws["20 % less in the middle"] = x * (1 - 0.2 * _bump(u))
    return {name: factor * law for name, law in laws.items()}


def line_rivals(x: np.ndarray, offset: float, slope: float) -> Curves:
    """Laws that are not ``offset`` + ``slope`` x with an offset above 0, at x (k,) > 0."""
    middle, last = x.mean(), x.max()
    u = (x - x.min()) / (last - x.min())
    height, rise = offset + slope * middle, slope * (last - x.min())
    line = offset + slope * x
    return {
        "proportional": height * x / middle,
        "x^1.3": height * (x / middle) ** 1.3,
        "x²": height * (x / middle) ** 2,
        "a negative offset": np.maximum(1.2 * height * x / middle - 0.2 * height, 0),
        "constant": np.full_like(x, height),
        "falling": height * (2 - x / middle).clip(0.05),
        "logarithm": height * np.log(x / x.min() + 1e-9).clip(0) / 1.0,
        "step": np.where(u < 0.5, line[np.argmin(x)], line[np.argmax(x)]),
        "level from the middle on": line[np.argmin(x)] + rise * np.minimum(2 * u, 1),
        "rising from the middle on": line[np.argmin(x)]
        + rise * np.maximum(2 * u - 1, 0),
        "20 % more in the middle": line * (1 + 0.2 * _bump(u)),
        "20 % less in the middle": line * (1 - 0.2 * _bump(u)),
    }


def rise_rivals(x: np.ndarray, height: float, rise: float) -> Curves:
    """Laws that do not rise along a line by ``rise`` about ``height``, at x (k,)."""
    u = (x - x.min()) / np.ptp(x)
    laws = {
        "constant": 0 * u,
        "falling": -u,
        "highest in the middle": _bump(u),
        "lowest in the middle": -_bump(u),
        "level from a fifth on": np.minimum(5 * u, 1),
        "rising from four fifths on": np.maximum(5 * u - 4, 0),
        "step": np.where(u < 0.5, 0.0, 1.0),
        "falling, then rising": np.abs(2 * u - 1),
        "rising, then falling": -np.abs(2 * u - 1),
        "two waves": np.sin(4 * np.pi * u),
        "ten times as strong": 10 * u,
        "proportional": 1 / (rise / height) * (u - 0.5),
    }
    return {name: height + rise * (law - law.mean()) for name, law in laws.items()}


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


def line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Rms deviation from the line through y (x), relative, and the offset of the line over the mean of y."""
    slope, offset = fit(x, y)
    return rms(y, offset + slope * x), offset / float(y.mean())


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
