"""The laws of rate-and-state friction, integrated; compiled by numba."""

from __future__ import annotations

import math

import numpy as np

from chemage.plugin import kernel

#: logarithms of speeds over V₀ between which the slider is stable
FASTEST, SLOWEST = 40.0, 700.0
#: of a step, over the time in which the state changes: its size at most, for a change of order one
LONGEST, ERROR = 1.5, 1e-7


@kernel(nogil=True)
def rates(
    slip: bool, b: float, pull: float, ratio: float, x: float, y: float
) -> tuple[float, float]:
    """x' and y'; b and pull are over a."""
    speed = math.exp(x)
    evolved = -speed * (x + y) if slip else math.exp(-y) - speed
    return pull * (ratio - speed) - b * evolved, evolved


@kernel(nogil=True)
def states(
    slip: bool,
    b: float,
    pull: float,
    begins: np.ndarray,
    ratios: np.ndarray,
    times: np.ndarray,
) -> np.ndarray:
    """(m, 2) x and y at ``times`` (m,), where the load point moves at ``ratios`` (n,) from ``begins`` (n,) on; from 0 at
    the first; by the classical Runge–Kutta method. NaN from where the slider is unstable."""
    found = np.full((times.size, 2), np.nan)
    x = y = 0.0
    now, part = begins[0], 0
    for i in range(times.size):
        while now < times[i]:
            if part + 1 < begins.size and begins[part + 1] <= now:
                part += 1
                continue
            end = times[i]
            if part + 1 < begins.size:
                end = min(end, begins[part + 1])
            ratio, left = ratios[part], end - now
            while left > 0:
                if not -SLOWEST < x < FASTEST:
                    return found
                dx, dy = rates(slip, b, pull, ratio, x, y)
                speed, ages = math.exp(x), math.exp(-y)
                rate = speed * (pull + 1 + b)
                rate += (1 + b) * (speed * abs(x + y) if slip else ages)
                size = (abs(dx) + abs(dy)) / rate
                h = min(LONGEST, (ERROR / (size + 1e-12)) ** 0.2) / rate
                h = min(h, left)
                dx2, dy2 = rates(
                    slip, b, pull, ratio, x + h / 2 * dx, y + h / 2 * dy
                )
                dx3, dy3 = rates(
                    slip, b, pull, ratio, x + h / 2 * dx2, y + h / 2 * dy2
                )
                dx4, dy4 = rates(slip, b, pull, ratio, x + h * dx3, y + h * dy3)
                x += h / 6 * (dx + 2 * dx2 + 2 * dx3 + dx4)
                y += h / 6 * (dy + 2 * dy2 + 2 * dy3 + dy4)
                left -= h
            now = end
        found[i, 0], found[i, 1] = x, y
    return found
