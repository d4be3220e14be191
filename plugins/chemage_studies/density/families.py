"""Shapes of the density of barriers on 0.8 to 1.4 eV, with at most three parameters each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

import chemage

#: eV
LOWER, UPPER = 0.8, 1.4
#: width of a step in a density, eV: nodes of a table must increase
STEP = 1e-3

Nodes = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class Family:
    """A family of densities that are piecewise linear (the beta distribution: on a fine grid)."""

    name: str
    #: parameters, in the order of the arguments of ``nodes``, with units
    parameters: tuple[str, ...]
    #: range in which the parameters are searched, one pair each
    bounds: tuple[tuple[float, float], ...]
    #: parameters -> energies (eV) and weights
    nodes: Callable[..., Nodes]

    def barriers(self, parameters: Sequence[float] | np.ndarray) -> chemage.plugin.Barriers:
        """Make the barriers of the density with these parameters."""
        energies, weights = self.nodes(*(float(value) for value in parameters))
        return chemage.barriers("tabulated", energies=list(energies), weights=list(weights))


def _triangle(peak: float) -> Nodes:
    return (LOWER, peak, UPPER), (0, 1, 0)


def _trapezoid(left: float, width: float) -> Nodes:
    return (LOWER, left, left + width, UPPER), (0, 1, 1, 0)


def _mixture(peak: float, floor: float) -> Nodes:
    return (LOWER, peak, UPPER), (floor, 1, floor)


def _beta(a: float, b: float) -> Nodes:
    x = np.linspace(0, 1, 121)
    # in logarithms, with the ends left out: both exponents are at least 0
    inside = np.exp((a - 1) * np.log(x[1:-1]) + (b - 1) * np.log1p(-x[1:-1]))
    ends = (1.0 if a == 1 else 0.0), (1.0 if b == 1 else 0.0)
    return (LOWER + (UPPER - LOWER) * x).tolist(), [ends[0], *inside.tolist(), ends[1]]


def _four_nodes(first: float, second: float, last: float) -> Nodes:
    return (0.8, 1.0, 1.2, 1.4), (first, second, 1, last)


def _shoulder(left: float, peak: float, height: float) -> Nodes:
    return (LOWER, left, peak, UPPER), (0, height, 1, 0)


def _ramp(peak: float, fall: float, start: float) -> Nodes:
    return (LOWER, peak, peak + fall, UPPER), (start, 1, 0, 0)


def _power(end: float, start: float, power: float) -> Nodes:
    x = np.linspace(0, 1, 61)
    energies, weights = LOWER + (end - LOWER) * x, start + (1 - start) * x**power
    return [*energies.tolist(), end + STEP, UPPER], [*weights.tolist(), 0, 0]


FAMILIES = (
    Family("triangle", ("peak (eV)",), ((0.9, 1.3),), _triangle),
    Family("trapezoid", ("start of the plateau (eV)", "width (eV)"), ((0.82, 1.1), (0.05, 0.28)), _trapezoid),
    Family("uniform + triangle", ("peak (eV)", "floor/peak"), ((0.9, 1.3), (0.0, 0.6)), _mixture),
    Family("beta distribution", ("a", "b"), ((1.2, 4.0), (1.2, 4.0)), _beta),
    Family(
        "four nodes (0.8, 1.0, 1.2, 1.4 eV)",
        ("at 0.8 eV", "at 1.0 eV", "at 1.4 eV"),
        ((0.0, 0.6), (0.3, 1.3), (0.0, 0.4)),
        _four_nodes,
    ),
    Family(
        "shoulder and peak",
        ("shoulder (eV)", "peak (eV)", "shoulder/peak"),
        ((0.82, 0.96), (1.0, 1.25), (0.1, 0.8)),
        _shoulder,
    ),
    Family(
        "ramp",
        ("peak (eV)", "width of the fall (eV)", "at 0.8 eV/peak"),
        ((1.10, 1.26), (STEP, 0.12), (0.0, 0.45)),
        _ramp,
    ),
    Family(
        "rise by a power, cut off",
        ("end (eV)", "at 0.8 eV/at the end", "power"),
        ((1.10, 1.26), (0.0, 0.45), (0.4, 3.0)),
        _power,
    ),
)
