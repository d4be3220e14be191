"""Scalar unknowns: their bounds, and the grid of values for which the forward model is computed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.messages import nearest
from chemage.foundation.units import QuantityLike, convert
from chemage.lattices.chemistry import Chemistry

#: unknown -> its unit, and whether its prior is uniform in the logarithm
UNITS: dict[str, tuple[str, bool]] = {
    "bond_force": ("nN", True),
    "activation_volume": ("nm**3", False),
    "attempt_frequency": ("Hz", True),
}
#: values of an unknown on the grid: without interaction, with it, and of each of two with it
POINTS, POINTS_INTERACTING, POINTS_BOTH = 61, 9, 5


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is inferred beside the density."""

    #: name -> lower and upper bound, in its unit
    bounds: dict[str, tuple[float, float]]
    #: name -> (g,) its value at each point of the grid; bond_force is not on it, but scales everything
    values: dict[str, np.ndarray]
    #: (g, k) points beside each
    neighbours: np.ndarray
    #: bounds of the logarithm of bond_force over that of the scene; None where it is known
    factor: tuple[float, float] | None

    @property
    def points(self) -> int:
        """Points of the grid."""
        return len(self.neighbours)

    def chemistry(self, chemistry: Chemistry, point: int) -> Chemistry:
        """The chemistry at a point of the grid."""
        values = {name: float(array[point]) for name, array in self.values.items()}
        return chemistry.replace(**values) if values else chemistry


def unknowns_of(
    asked: Mapping[str, tuple[QuantityLike, QuantityLike]] | Sequence[str], chemistry: Chemistry
) -> Unknowns:
    """The unknowns that are asked for, by name or with bounds.

    Raises
    ------
    InputError
        A name that is no unknown, or bounds that are none.
    """
    if isinstance(asked, str):
        asked = (asked,)
    bounds: dict[str, tuple[float, float]] = {}
    for name in asked:
        if name not in UNITS:
            raise InputError.of(
                "unknown", name, f"cannot be inferred{nearest(name, list(UNITS))}", f"choose {', '.join(UNITS)}"
            )
        given = asked[name] if isinstance(asked, Mapping) else _default(name, chemistry)
        unit, logarithmic = UNITS[name]
        if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
            raise InputError.of(f"unknown.{name}", given, "must be a lower and an upper bound", f"in {unit}")
        low, high = (convert(one, unit, f"unknown.{name}") for one in given)
        if not (0 <= low < high < np.inf) or (logarithmic and low <= 0):
            raise InputError.of(
                f"unknown.{name}", given, "must be a lower and a larger upper bound, finite and not negative"
            )
        bounds[name] = low, high
    on_grid = [name for name in bounds if name != "bond_force"]
    count = POINTS if chemistry.interaction is None else (POINTS_INTERACTING if len(on_grid) < 2 else POINTS_BOTH)
    if chemistry.interaction is None and len(on_grid) > 1:
        count = POINTS_INTERACTING
    axes = []
    for name in on_grid:
        spaced = np.geomspace if UNITS[name][1] else np.linspace
        axes.append(spaced(*bounds[name], count))
    places = list(itertools.product(range(count), repeat=len(on_grid))) or [()]
    number = {place: at for at, place in enumerate(places)}
    beside = []
    for place in places:
        near = []
        for axis, step in itertools.product(range(len(on_grid)), (-1, 1)):
            other = tuple(one + step * (at == axis) for at, one in enumerate(place))
            near.append(number.get(other, number[place]))
        beside.append(near)
    factor = None
    if "bond_force" in bounds:
        low, high = np.log(np.array(bounds["bond_force"]) / chemistry.bond_force)
        factor = float(low), float(high)
    values = {name: np.array([axes[at][place[at]] for place in places]) for at, name in enumerate(on_grid)}
    return Unknowns(bounds, values, np.array(beside, dtype=np.int64).reshape(len(places), -1), factor)


def _default(name: str, chemistry: Chemistry) -> tuple[float, float]:
    value = float(getattr(chemistry, name))
    if name == "activation_volume":
        return 0.0, max(2 * value, 0.012)
    return (value / 3, value * 3) if name == "bond_force" else (value / 30, value * 30)
