"""The prior of the density: a rectified Gaussian process of unknown strength, roughness and length.

The density is max(x, 0), where x is a Gaussian process, so that it can be exactly zero. Strength and covariance (Matérn
1, 3/2 or 5/2, several lengths) are not set but sampled with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

#: 1/eV: mean of the process, and standard deviation of its level
LEVEL, LEVEL_SPREAD = 0.5, 1.5
#: 1/eV: standard deviations of the process, uniform in the logarithm
STRENGTHS = np.geomspace(0.3, 12.0, 10)
#: eV: lengths, none shorter than what hold times can resolve
LENGTHS = (0.07, 0.125, 0.22, 0.4)
#: (ν of the Matérn covariance, lengths in eV)
SHAPES = ((1.0, LENGTHS), (1.5, LENGTHS), (2.5, LENGTHS))


def matern(smoothness: float, distance: np.ndarray) -> np.ndarray:
    """Matérn covariance of variance 1 at distances in units of its length; Rasmussen & Williams 2006, eq. 4.14."""
    if smoothness == 1.0:
        from scipy.special import k1

        scaled = np.sqrt(2.0) * np.maximum(distance, 1e-9)
        return scaled * k1(scaled)
    if smoothness == 1.5:
        scaled = np.sqrt(3.0) * distance
        return (1 + scaled) * np.exp(-scaled)
    scaled = np.sqrt(5.0) * distance
    return (1 + scaled + scaled**2 / 3) * np.exp(-scaled)


@dataclass(frozen=True, eq=False)
class Prior:
    """The prior on the nodes of a density."""

    #: (n,) eV
    nodes: np.ndarray

    @cached_property
    def combinations(self) -> list[tuple[float, float, float]]:
        """Smoothness, length (eV) and strength (1/eV) of every choice."""
        return [
            (smoothness, length, float(strength))
            for smoothness, lengths in SHAPES
            for length in lengths
            for strength in STRENGTHS
        ]

    def covariance(self, choice: int) -> np.ndarray:
        """(n, n) 1/eV²."""
        smoothness, length, strength = self.combinations[choice]
        distance = np.abs(self.nodes[:, None] - self.nodes) / length
        found = strength**2 * matern(smoothness, distance) + LEVEL_SPREAD**2
        found[np.diag_indices_from(found)] += 1e-6 * (strength**2 + LEVEL_SPREAD**2)
        return found

    @cached_property
    def precisions(self) -> tuple[np.ndarray, np.ndarray]:
        """(choices, n, n) inverse covariances, and (choices,) half the logarithms of their determinants."""
        inverses, logs = [], []
        for choice in range(len(self.combinations)):
            covariance = self.covariance(choice)
            inverses.append(np.linalg.inv(covariance))
            logs.append(-0.5 * np.linalg.slogdet(covariance)[1])
        return np.stack(inverses), np.array(logs)

    def log_densities(self, x: np.ndarray) -> np.ndarray:
        """(choices,) log prior density of ``x`` (n,) under each choice, but for a constant."""
        inverses, logs = self.precisions
        away = x - LEVEL
        return logs - 0.5 * (inverses @ away) @ away

    def sample(self, count: int, areas: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(count, n) densities of the prior whose integral is at most 1."""
        found: list[np.ndarray] = []
        factors: dict[int, np.ndarray] = {}
        for _ in range(1000 * count):
            choice = int(rng.integers(len(self.combinations)))
            if choice not in factors:
                factors[choice] = np.linalg.cholesky(self.covariance(choice))
            density = np.maximum(LEVEL + factors[choice] @ rng.standard_normal(self.nodes.size), 0.0)
            if density @ areas <= 1.0:
                found.append(density)
                if len(found) == count:
                    break
        while len(found) < count:  # a range of energies so wide that hardly any density has an integral below 1
            found.append(found[-1] if found else np.zeros(self.nodes.size))
        return np.stack(found)
