"""Sites that do not interact: the closed form of their bonds, and what it says before any lattice is made."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from chemage.lattices.chemistry import Chemistry, effective_forming

#: quantiles of the pressure that the means are taken over
PRESSURES = 8
#: quantiles of the forming and of the breaking barrier in each of PANELS panels, each half as wide as the one above it:
#: the lowest barriers react first, and of a bond that breaks the lowest barriers decide how often
FORMING, BREAKING, PANELS = 12, 4, 12
#: events with an interaction over those without
COUPLED = 0.5


@dataclass(frozen=True, eq=False)
class TwoState:
    """Sites without bonds at first that form one at the rate a and break it at the rate b: a two-state chain each.

    All arrays broadcast against each other: the rates, and the times of the methods.
    """

    #: a, Hz
    forming: np.ndarray
    #: b, Hz; 0: bonds last
    breaking: np.ndarray | float = 0.0

    @cached_property
    def total(self) -> np.ndarray:
        """a + b, Hz."""
        return self.forming + self.breaking

    @cached_property
    def equilibrium(self) -> np.ndarray:
        """a/(a + b), the probability of a bond after a long time; 0 where nothing happens."""
        with np.errstate(under="ignore"):
            return np.divide(
                self.forming,
                self.total,
                out=np.zeros_like(self.total),
                where=self.total > 0,
            )

    def relaxed(self, times: np.ndarray | float) -> np.ndarray:
        """1 − exp(−(a + b) t) after ``times`` (s): how much of the way to the equilibrium is gone."""
        with np.errstate(under="ignore", over="ignore"):
            return -np.expm1(-(self.total * times))

    def bonded(self, times: np.ndarray | float) -> np.ndarray:
        """Probability of a bond after ``times`` (s)."""
        with np.errstate(under="ignore"):
            return self.equilibrium * self.relaxed(times)

    def broken(self, times: np.ndarray | float) -> np.ndarray:
        """Bonds broken on average until ``times`` (s), at most 1e300; those formed are so many and the present ones."""
        with np.errstate(under="ignore", over="ignore"):
            passed = self.total * times
            # the mean of 1 - exp(-x) from 0 to x, without cancellation where x is small
            small = passed < 1e-4
            safe = np.where(small, 1.0, passed)
            mean = np.where(small, passed / 2, 1 + np.expm1(-safe) / safe)
            return (
                np.minimum(self.breaking * times, 1e300) * self.equilibrium * mean
            )


class Expected(NamedTuple):
    """What is expected of a reactive site until a hold time."""

    #: bonds formed and broken
    events: float
    #: probability that it is bonded
    bonded: float


def rough_pressures(mean: float) -> np.ndarray:
    """Pressures of a rough contact at a small load, at PRESSURES equal shares of its area: a Rayleigh distribution."""
    return np.sqrt(-4 / np.pi * np.log1p(-_middles(PRESSURES))) * mean


def smooth_pressures(mean: float) -> np.ndarray:
    """Pressures of a smooth tip, 3/2 of the mean times sqrt(1 - r²/a²), at PRESSURES equal shares of its area."""
    return 1.5 * np.sqrt(1 - _middles(PRESSURES)) * mean


def expected_kinetics(
    chemistry: Chemistry,
    pressures: np.ndarray,
    hold_time: float,
    temperature: float,
) -> Expected:
    """Bonds formed and broken per reactive site until ``hold_time``, and the bonds then: means over the barriers.

    Couplings mostly raise barriers; with an ``interaction`` half of the events of sites without are expected (measured
    on rough contacts from 250 to 500 K and strengths of 0.1 to 0.5 eV: 0.33 to 0.84). The bonds are those without
    interaction.

    Parameters
    ----------
    pressures
        GPa, each of an equal share of the sites.
    hold_time, temperature
        s, K.
    """
    ranks, forming_weights = _ranks(FORMING)
    intrinsic = chemistry.forming.quantile(ranks)
    barriers = effective_forming(
        intrinsic,
        chemistry.activation_volume,
        np.asarray(pressures, float)[:, None],
    )
    breaking, breaking_weights = np.zeros(1), np.ones(1)
    if chemistry.breaking is not None:
        ranks, breaking_weights = _ranks(BREAKING)
        breaking = chemistry.rates(chemistry.breaking.quantile(ranks), temperature)
    sites = TwoState(chemistry.rates(barriers, temperature)[..., None], breaking)

    def mean(values: np.ndarray) -> float:
        """The mean of (pressures, forming barriers, breaking barriers)."""
        with np.errstate(under="ignore"):
            return float(
                np.sum(
                    values.mean(axis=0)
                    * breaking_weights
                    * forming_weights[:, None]
                )
            )

    bonded = sites.bonded(hold_time)
    events = mean(np.minimum(bonded + 2 * sites.broken(hold_time), 1e300))
    return Expected(
        events if chemistry.interaction is None else COUPLED * events, mean(bonded)
    )


@lru_cache(maxsize=4)
def _ranks(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Ranks in (0, 1) and their weights: ``count`` middles in each panel."""
    edges = np.concatenate([[0.0], 2.0 ** np.arange(1.0 - PANELS, 1.0)])
    widths = np.diff(edges)
    ranks = (edges[:-1, None] + widths[:, None] * _middles(count)).ravel()
    return ranks, np.repeat(widths / count, count)


def _middles(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) / count
