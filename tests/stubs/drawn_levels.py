"""Levels of random numbers, and a clock that only they move, for tests of the rule that stops an ensemble."""

from __future__ import annotations

import numpy as np


class Drawn:
    """A level of random numbers."""

    def __init__(self, rng: np.random.Generator, mean: float, deviation: float, cost: float, skewed: float = 0.0):
        self.rng, self.mean, self.deviation, self.cost, self.skewed = rng, mean, deviation, cost, skewed
        self.taken = 0

    def sample(self, begin: int, end: int) -> np.ndarray:
        assert begin == self.taken
        self.taken = end
        x = self.rng.standard_normal(end - begin)
        if self.skewed:
            x = np.exp(self.skewed * x - self.skewed**2 / 2) - 1
            x /= np.sqrt(np.expm1(self.skewed**2))
        return (self.mean + self.deviation * x)[:, None]


def nothing(mean: np.ndarray) -> np.ndarray:
    return np.zeros(1)


class Timer:
    """A clock that only moves when samples are taken."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self) -> float:
        return self.time
