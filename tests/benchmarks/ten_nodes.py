"""The best density of ten nodes for a simulation of the six published curves; used by ``straight_line.py``.

Shares of the barriers in ten hat functions are varied, in logarithms. Derivatives of the simulated curves are finite
differences, updated by Broyden's formula; each step minimises the misfit of the linearised curves within a trust
region, over the readings of the window in which β was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

import chemage as ca

TIMES = ca.hold_times("1 ms", "1e5 s", per_decade=4)
DECADES = np.log10(TIMES)
PUBLISHED = np.array([0.89, 0.45, 0.20, 0.98, 0.49, 0.24])
#: eV; without pressure and neighbours the last barriers that react within 1e5 s at 300 K are at 1.07 eV
NODES = np.array([0.80, 0.84, 0.88, 0.92, 0.96, 1.00, 1.05, 1.10, 1.20, 1.40])
AREAS = np.convolve(np.diff(NODES), [0.5, 0.5])
#: first hold time of the fit with ΔV and without, and last one, s: each line from its own onset, or both alike
READINGS = [(1, 10, end) for end in (1e3, 1e4, 1e5)]
READINGS += [(first, first, end) for first, end in ((1, 1e3), (1, 1e4), (1, 1e5), (10, 1e4), (10, 1e5), (100, 1e5))]
#: ln of onset with ΔV and without and of the crossing, s, with standard deviations: a factor of 3 is two of an onset
PAPER_TIMES = np.log([1, 10, 10**0.5]), np.array([0.5 * np.log(3)] * 2 + [0.25 * np.log(10)])
#: this share of the barriers is in the first and in the last 0.1 eV at least; half of it is two standard deviations
SHARE = 0.02


def line(first: float, last: float) -> np.ndarray:
    """Weights (m,) with which a curve has the slope of its line over these hold times."""
    inside = (first * (1 - 1e-9) <= TIMES) & (last * (1 + 1e-9) >= TIMES)
    x = np.where(inside, DECADES - DECADES[inside].mean(), 0.0)
    return x / (x @ x)


LINES = np.stack([[line(first, end)] * 3 + [line(second, end)] * 3 for first, second, end in READINGS])
LOCAL = np.stack([line(10.0**k, 10.0 ** (k + 1)) for k in range(5)])


def passing(values: np.ndarray, at: int) -> float:
    """ln of the time at which ``values`` (m,) pass zero between those at − 1 and at."""
    first, last = values[at - 1], values[at]
    part = np.clip(first / (first - last), 0, 1) if first != last else 0.0
    return float(np.log(10) * (DECADES[at - 1] + part * (DECADES[at] - DECADES[at - 1])))


def reported(curves: np.ndarray, reading: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of six curves: β (6,); ln of onset with ΔV and without and of the crossing, s (3,); local slopes over their mean."""
    beta = np.maximum((curves * LINES[reading]).sum(axis=1), 1e-6)
    steep = [np.gradient(curves[at], DECADES) - 0.5 * beta[at] for at in (1, 4)]
    times = [passing(each, max(int(np.argmax(each >= 0)), 1)) for each in steep]
    positive = np.flatnonzero(curves[2] > curves[0])
    times.append(passing(curves[2] - curves[0], min(int(positive[-1]) + 1, TIMES.size - 1) if positive.size else 1))
    local = LOCAL @ curves[1]
    return beta, np.array(times), local / local.mean()


def ends_of(shares: np.ndarray) -> np.ndarray:
    """Shares of the barriers in the first and in the last 0.1 eV."""
    density = np.interp(np.linspace(0.8, 1.4, 601), NODES, shares / AREAS)
    total = np.cumsum(0.5 * (density[1:] + density[:-1]))
    return np.array([total[99], total[-1] - total[499]]) / total[-1]


def softmax(logs: np.ndarray) -> np.ndarray:
    """Shares that sum to 1."""
    shares = np.exp(logs - logs.max())
    return shares / shares.sum()


class Search:
    """The density of one model, with ``factor`` (6,) from its surfaces to the mean and their covariance (6, 6)."""

    def __init__(
        self,
        curves: Callable[[Sequence[np.ndarray]], np.ndarray],
        factor: np.ndarray,
        surface: np.ndarray,
        asked: str,
    ) -> None:
        errors = surface + np.diag(0.005**2 / 3 / PUBLISHED**2 + 0.01**2) + (4.0 if asked == "free factor" else 0.0)
        #: readings that are allowed
        self.readings = {"one window": range(3, 9), "to 1e4 s": [1]}.get(asked, range(len(READINGS)))
        self.root, self.asked = np.linalg.inv(np.linalg.cholesky(errors)), asked
        self.simulated = lambda shares: curves(shares) * factor[:, None]

    def misfit(self, curves: np.ndarray, shares: np.ndarray, reading: int, limit: float) -> np.ndarray:
        """Residuals: six rates, three times, two ends, five local slopes, smoothness."""
        beta, times, local = reported(curves, reading)
        rates = self.root @ np.log(PUBLISHED / beta) * (self.asked != "free rates")
        times = (times - PAPER_TIMES[0]) / PAPER_TIMES[1]
        ends = 2 * np.minimum(0, np.log2(np.maximum(ends_of(shares), 1e-6) / SHARE))
        straight = np.maximum(np.abs(local - 1) - limit, 0) / 0.005
        rise, peak = np.diff(np.log(shares / AREAS)), int(np.argmax(shares / AREAS))
        peaks = 5 * np.maximum(np.append(-rise[:peak], rise[peak:]), 0) * (self.asked == "one peak")
        return np.concatenate([rates, times, ends, straight, np.diff(rise) / 20, peaks])

    def cost(self, limit: float, curves: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Sum of squares by reading."""
        costs = np.full(len(READINGS), np.inf)
        for at in self.readings:
            costs[at] = np.sum(self.misfit(curves, shares, at, limit) ** 2)
        return costs

    def differences(self, shares: np.ndarray, part: float = 0.1) -> None:
        """Simulate at ``shares`` and with a ``part`` of them in each hat function."""
        self.curves, *others = self.simulated([shares, *((1 - part) * shares + part * np.eye(NODES.size))])
        self.shares, self.derivative = shares, (np.array(others) - self.curves) / part

    def linear(self, shares: np.ndarray) -> np.ndarray:
        """Curves near the present density."""
        return self.curves + np.tensordot(shares - self.shares, self.derivative, 1)

    def descend(self, limit: float, steps: int = 6) -> None:
        """Minimise the misfit from the present density on."""
        radius, found = 0.7, self.cost(limit, self.curves, self.shares)
        for _ in range(steps):
            logs, trials = np.log(self.shares), []
            bounds = np.maximum(logs - radius, -12), np.maximum(logs, -11.9) + radius
            start = np.clip(logs, bounds[0] + 0.01, bounds[1])
            for reading in [at for at in np.argsort(found)[:4].tolist() if at in self.readings]:
                result = least_squares(
                    lambda x, at=reading: self.misfit(self.linear(softmax(x)), softmax(x), at, limit),
                    start, bounds=bounds, max_nfev=15,
                )  # fmt: skip
                trials.append((2 * result.cost, softmax(result.x)))
            expected, shares = min(trials, key=lambda trial: trial[0])
            curves, step = self.simulated([shares])[0], shares - self.shares
            new = self.cost(limit, curves, shares)
            self.derivative += np.multiply.outer(step, curves - self.linear(shares)) / max(step @ step, 1e-12)
            gain, hoped = found.min() - new.min(), found.min() - expected
            if gain > 0:
                self.shares, self.curves, found = shares, curves, new
            radius = min(1.4, radius * (1.5 if gain > 0.5 * hoped else 0.5 if gain < 0.2 * hoped else 1))
            if hoped < 0.2 or radius < 0.05:
                break
