"""How many bonds form and break, estimated before any lattice is made."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from chemage.foundation.units import KB
from chemage.lattices.chemistry import Chemistry, effective_forming

#: quantiles of the pressure that the means are taken over
PRESSURES = 8
#: quantiles of the forming and of the breaking barrier in each of PANELS panels, each half as wide as the one above it:
#: the lowest barriers react first, and of a bond that breaks the lowest barriers decide how often
FORMING, BREAKING, PANELS = 12, 4, 12
#: events with an interaction over those without
COUPLED = 0.5


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


def expected_events(chemistry: Chemistry, pressure: float, hold_time: float, temperature: float) -> float:
    """The events of :func:`expected_kinetics` under the pressures of a rough contact of mean ``pressure``, GPa."""
    return expected_kinetics(chemistry, rough_pressures(pressure), hold_time, temperature).events


def expected_kinetics(chemistry: Chemistry, pressures: np.ndarray, hold_time: float, temperature: float) -> Expected:
    """Bonds formed and broken per reactive site until ``hold_time``, and the bonds then: means over the barriers.

    The closed form of a site that forms a bond at the rate k_f and breaks it at the rate k_b. Couplings mostly raise
    barriers; with an ``interaction`` half of the events of sites without are expected (measured on rough contacts from
    250 to 500 K and strengths of 0.1 to 0.5 eV: 0.33 to 0.84). The bonds are those without interaction.

    Parameters
    ----------
    pressures
        GPa, each of an equal share of the sites.
    hold_time, temperature
        s, K.
    """
    share = 1.0 if chemistry.interaction is None else COUPLED
    ranks, weights = _ranks(FORMING)
    intrinsic = chemistry.forming.quantile(ranks)
    barriers = effective_forming(intrinsic, chemistry.activation_volume, np.asarray(pressures, float)[:, None])
    forming = _rates(barriers, chemistry, temperature)[..., None]
    if chemistry.breaking is None:
        formed = _mean(-np.expm1(-_product(forming, hold_time)), weights, np.ones(1))
        return Expected(share * formed, formed)
    ranks, breaking_weights = _ranks(BREAKING)
    breaking = _rates(chemistry.breaking.quantile(ranks), chemistry, temperature)
    total = forming + breaking
    bonded = np.divide(forming, total, out=np.zeros_like(total), where=total > 0)
    passed = _product(total, hold_time)
    # the mean of 1 - exp(-k t) over the hold time
    risen = _risen(passed)
    formed = _product(forming, hold_time) * (1 - bonded * risen)
    broken = _product(breaking, hold_time) * bonded * risen
    events = _mean(np.minimum(formed + broken, 1e300), weights, breaking_weights)
    with np.errstate(under="ignore"):
        at_the_end = _mean(bonded * -np.expm1(-passed), weights, breaking_weights)
    return Expected(share * events, at_the_end)


@lru_cache(maxsize=4)
def _ranks(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Ranks in (0, 1) and their weights: ``count`` middles in each panel."""
    edges = np.concatenate([[0.0], 2.0 ** np.arange(1.0 - PANELS, 1.0)])
    widths = np.diff(edges)
    ranks = (edges[:-1, None] + widths[:, None] * _middles(count)).ravel()
    return ranks, np.repeat(widths / count, count)


def _mean(values: np.ndarray, forming: np.ndarray, breaking: np.ndarray) -> float:
    """The mean of (pressures, forming barriers, breaking barriers)."""
    with np.errstate(under="ignore"):
        return float((values.mean(axis=0) @ breaking) @ forming)


def _middles(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) / count


def _rates(barriers: np.ndarray, chemistry: Chemistry, temperature: float) -> np.ndarray:
    with np.errstate(under="ignore", over="ignore"):
        return chemistry.attempt_frequency * np.exp(-np.maximum(barriers, 0.0) / (KB * temperature))


def _product(rates: np.ndarray, hold_time: float) -> np.ndarray:
    with np.errstate(under="ignore", over="ignore"):
        return np.minimum(rates * hold_time, 1e300)


def _risen(x: np.ndarray) -> np.ndarray:
    """1 − (1 − e^−x)/x without cancellation for small x."""
    small = x < 1e-4
    safe = np.where(small, 1.0, x)
    return np.where(small, x / 2, 1 + np.expm1(-safe) / safe)
