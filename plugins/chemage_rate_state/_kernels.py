"""The laws of rate-and-state friction, integrated; compiled by numba."""

from __future__ import annotations

import math

import numpy as np

from chemage.plugin import kernel

#: logarithms of speeds over V₀ between which a slider is stable
SLOWEST, FASTEST = -700.0, 40.0
#: of a step, over the time in which the state changes: its size at most, for a change of order one
LONGEST, ERROR = 1.5, 1e-7


@kernel(nogil=True)
def states(
    slip: bool,
    b: float,
    pull: float,
    ends: np.ndarray,
    ratios: np.ndarray,
    times: np.ndarray,
    steps: int,
) -> np.ndarray:
    """(m, 2) x and y at ``times`` (m,), from 0 at time 0, where the load point moves at ``ratios`` (n,) until ``ends`` (n,),
    of which the last is infinite; by the classical Runge–Kutta method, ``b`` and ``pull`` over a. NaN from where the
    slider is unstable, or after so many ``steps``, unless they are negative."""
    found = np.full((times.size, 2), np.nan)
    x = y = 0.0
    now, part = 0.0, 0
    for i in range(times.size):
        while now < times[i]:
            end = min(times[i], ends[part])
            speed, aged = math.exp(x), math.exp(-y)
            # with which the state forgets
            rate = (1 + b + pull) * speed
            rate += (1 + b) * (speed * abs(x + y) if slip else aged)
            dx = dy = all_x = all_y = h = 0.0
            for place, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
                u, w = x + place * h * dx, y + place * h * dy
                speed = math.exp(u)
                dy = -speed * (u + w) if slip else math.exp(-w) - speed
                dx = pull * (ratios[part] - speed) - b * dy
                if not place:
                    away = abs(dx) + abs(dy)
                    h = (ERROR * (1 + rate / (away + 1e-9))) ** 0.2 / (rate + away)
                    h = min(end - now, h, LONGEST / rate)
                all_x += weight * dx
                all_y += weight * dy
            x += h / 6 * all_x
            y += h / 6 * all_y
            now = min(now + h, end)
            steps -= 1
            if not (SLOWEST < x < FASTEST and steps):
                return found
            if now == ends[part]:
                part += 1
        found[i, 0], found[i, 1] = x, y
    return found
