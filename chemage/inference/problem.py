"""What is sampled: the density with its prior, the unknown scalars, and measured values as linear functions of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from chemage.foundation.errors import InputError, nearest
from chemage.foundation.units import QuantityLike, convert
from chemage.inference.energies import EnergyGrid
from chemage.lattices.chemistry import Chemistry

#: 1/eV: mean of the process, and standard deviation of its level
LEVEL, LEVEL_SPREAD = 0.5, 1.5
#: 1/eV: standard deviations of the process, uniform in the logarithm
STRENGTHS = np.geomspace(0.3, 12.0, 10)
#: eV: lengths, none shorter than what hold times can resolve
LENGTHS = (0.07, 0.125, 0.22, 0.4)
#: ν of the Matérn covariance
SMOOTHNESSES = (1.0, 1.5, 2.5)
#: unknown -> its unit, and whether its prior is uniform in the logarithm
UNITS: dict[str, tuple[str, bool]] = {
    "bond_force": ("nN", True),
    "activation_volume": ("nm**3", False),
    "attempt_frequency": ("Hz", True),
}
#: values of an unknown on the grid: alone and without interaction, with an interaction or another unknown, with both
POINTS = 61, 9, 5


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
    """A rectified Gaussian process on the nodes of a density, of unknown strength, smoothness and length.

    The density is max(x, 0), where x is the process, so that it can be exactly zero. Strength and covariance (Matérn 1,
    3/2 or 5/2, several lengths) are not set but sampled with it.
    """

    #: (n,) eV
    nodes: np.ndarray

    @cached_property
    def combinations(self) -> list[tuple[float, float, float]]:
        """Smoothness, length (eV) and strength (1/eV) of every choice."""
        return [
            (smoothness, length, float(strength))
            for smoothness in SMOOTHNESSES
            for length in LENGTHS
            for strength in STRENGTHS
        ]

    def covariance(self, choice: int) -> np.ndarray:
        """(n, n) 1/eV²."""
        smoothness, length, strength = self.combinations[choice]
        distance = np.abs(self.nodes[:, None] - self.nodes) / length
        covariance = strength**2 * matern(smoothness, distance) + LEVEL_SPREAD**2
        covariance[np.diag_indices_from(covariance)] += 1e-6 * (strength**2 + LEVEL_SPREAD**2)
        return covariance

    @cached_property
    def precisions(self) -> tuple[np.ndarray, np.ndarray]:
        """(choices, n, n) inverse covariances, and (choices,) minus half the logarithms of their determinants."""
        inverses, logs = [], []
        for choice in range(len(self.combinations)):
            covariance = self.covariance(choice)
            inverses.append(np.linalg.inv(covariance))
            logs.append(-0.5 * np.linalg.slogdet(covariance)[1])
        return np.stack(inverses), np.array(logs)

    def sample(self, count: int, areas: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(count, n) densities of the prior whose integral is at most 1."""
        densities: list[np.ndarray] = []
        factors: dict[int, np.ndarray] = {}
        for _ in range(1000 * count):
            choice = int(rng.integers(len(self.combinations)))
            if choice not in factors:
                factors[choice] = np.linalg.cholesky(self.covariance(choice))
            density = np.maximum(LEVEL + factors[choice] @ rng.standard_normal(self.nodes.size), 0.0)
            if density @ areas <= 1.0:
                densities.append(density)
                if len(densities) == count:
                    break
        while len(densities) < count:  # a range of energies so wide that hardly any density has an integral below 1
            densities.append(densities[-1] if densities else np.zeros(self.nodes.size))
        return np.stack(densities)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is inferred beside the density: scalars on a grid of values, each with its linear model, and ⟨f⟩."""

    #: name -> (g,) its value at each point of the grid; bond_force is not on it, but scales everything
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: (g, k) points beside each, itself where the grid ends
    neighbours: np.ndarray = field(default_factory=lambda: np.zeros((1, 0), dtype=np.int64))
    #: bounds of the logarithm of bond_force over that of the scene; None where it is known
    factor: tuple[float, float] | None = None
    #: name -> lower and upper bound, in its unit
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def points(self) -> int:
        """Points of the grid."""
        return len(self.neighbours)

    def chemistry(self, chemistry: Chemistry, point: int) -> Chemistry:
        """The chemistry at a point of the grid."""
        values = {name: float(array[point]) for name, array in self.values.items()}
        return chemistry.replace(**values) if values else chemistry


def unknowns_of(
    names: Mapping[str, tuple[QuantityLike, QuantityLike]] | Sequence[str], chemistry: Chemistry
) -> Unknowns:
    """The unknowns of these ``names``, with bounds or with the default ones.

    Raises
    ------
    InputError
        A name that is no unknown, or bounds that are none.
    """
    names = (names,) if isinstance(names, str) else names
    bounds = {name: _bounds(name, names, chemistry) for name in names}
    on_grid = [name for name in bounds if name != "bond_force"]
    count = POINTS[(chemistry.interaction is not None) + (len(on_grid) > 1)]
    axes = [(np.geomspace if UNITS[name][1] else np.linspace)(*bounds[name], count) for name in on_grid]
    values = (mesh.ravel() for mesh in np.meshgrid(*axes, indexing="ij"))
    point = np.arange(count ** len(on_grid)).reshape((count,) * len(on_grid))
    beside = [
        point.take(np.clip(np.arange(count) + step, 0, count - 1), axis).ravel()
        for axis in range(len(on_grid))
        for step in (-1, 1)
    ]
    factor = None
    if "bond_force" in bounds:
        low, high = np.log(np.array(bounds["bond_force"]) / chemistry.bond_force)
        factor = float(low), float(high)
    neighbours = np.array(beside, dtype=np.int64).reshape(-1, point.size).T
    return Unknowns(dict(zip(on_grid, values, strict=True)), neighbours, factor, bounds)


def _bounds(
    name: str, names: Mapping[str, tuple[QuantityLike, QuantityLike]] | Sequence[str], chemistry: Chemistry
) -> tuple[float, float]:
    if name not in UNITS:
        raise InputError.of(
            "unknown", name, f"cannot be inferred{nearest(name, list(UNITS))}", f"choose {', '.join(UNITS)}"
        )
    unit, logarithmic = UNITS[name]
    if not isinstance(names, Mapping):
        value = float(getattr(chemistry, name))
        if name == "activation_volume":
            return 0.0, max(2 * value, 0.012)
        return (value / 3, value * 3) if name == "bond_force" else (value / 30, value * 30)
    ends = names[name]
    if isinstance(ends, str) or not isinstance(ends, Sequence) or len(ends) != 2:
        raise InputError.of(f"unknown.{name}", ends, "must be a lower and an upper bound", f"in {unit}")
    low, high = (convert(end, unit, f"unknown.{name}") for end in ends)
    if not (0 <= low < high < np.inf) or (logarithmic and low <= 0):
        raise InputError.of(
            f"unknown.{name}", ends, "must be a lower and a larger upper bound, finite and not negative"
        )
    return low, high


@dataclass(frozen=True, eq=False)
class Linear:
    """Measured values as a linear function of the density: values = factor × (offset + matrix @ density)."""

    grid: EnergyGrid
    #: (m, n) and (m,)
    matrix: np.ndarray
    offset: np.ndarray
    #: (m,) measured, and their standard errors
    values: np.ndarray
    errors: np.ndarray
    #: bounds of the logarithm of an unknown common factor; None without one
    factor: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """Measured values as a linear function of the density: values = offset + matrix @ density, at each grid point."""

    prior: Prior
    #: (n,) eV
    areas: np.ndarray
    #: (m,) measured, and their standard errors
    values: np.ndarray
    errors: np.ndarray
    #: (g, m, n) and (g, m)
    matrices: np.ndarray
    offsets: np.ndarray
    unknowns: Unknowns = field(default_factory=Unknowns)
    #: point of the grid from which sampling begins
    start: int = 0

    def without(self, left_out: np.ndarray) -> Problem:
        """The problem without the points that ``left_out`` (m,) marks."""
        kept = ~left_out
        return replace(
            self,
            values=self.values[kept],
            errors=self.errors[kept],
            matrices=self.matrices[:, kept],
            offsets=self.offsets[:, kept],
        )
