"""Sites with more states than free and bonded: the transitions between them, as data."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from chemage.foundation.components import Component
from chemage.foundation.units import Energy, Unit, Volume
from chemage.lattices.role import Barriers
from chemage.plugins.options import Choice

#: what every site can be; a lattice numbers its states in this order, further ones after these
TWO_STATES = ("free", "bonded")
_REACTION = re.compile(r"[A-Za-z][\w-]*\s*->\s*[A-Za-z][\w-]*")


class Transition(Component):
    """A transition of a site beside the forming and breaking of its bond.

    Its rate is f ν exp(−E/k_B T) with E = ``barrier`` − ΔV·P + ``neighbours`` × Σ couplings of the bonded neighbours,
    and a factor f that the ``humidity`` decides. Where a molecule of water adsorbs by a transition of the kind
    "langmuir" and desorbs by one of the kind "none", the coverage in equilibrium is that of Langmuir, Kx/(1 + Kx); with
    a transition "bet" from there to a state of two or more layers the states are populated as by Brunauer, Emmett and
    Teller, J. Am. Chem. Soc. 60, 309 (1938), 1 : cx : cx²/(1 − x).
    """

    speed_only: ClassVar[tuple[str, ...]] = ("source",)

    reaction: str
    """states of the site before and after, such as "dry -> free"; those that are neither "free" nor "bonded" are
    further states"""
    barrier: Energy | Choice[Barriers]
    """of every site, eV, or its distribution"""
    activation_volume: Volume = 0.0
    """ΔV, nm³, by which pressure lowers the barrier"""
    neighbours: Annotated[Any, Unit("", ge=-1e6, le=1e6)] = 0.0
    """what a bonded neighbour adds to the barrier, in units of its coupling in [interaction]"""
    humidity: Literal["none", "langmuir", "bet"] = "none"
    """factor of the rate at the relative humidity x: 1; x, a molecule that adsorbs on a bare site; x/(1 − x), further
    layers on the first one"""
    source: str = ""
    """of its numbers, which are published, fitted or assumed, and why"""

    @property
    def states(self) -> list[str]:
        """Those before and after it."""
        return re.split(r"\s*->\s*", self.reaction)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if not _REACTION.fullmatch(self.reaction) or len({*self.states}) < 2:
            raise ValueError(
                f'reaction: {self.reaction!r}; name two states, such as "dry -> free"'
            )
        return self

    def factor(self, humidity: float) -> float:
        """By which the relative ``humidity`` multiplies the rate."""
        if self.humidity == "none":
            return 1.0
        return (
            humidity if self.humidity == "langmuir" else humidity / (1 - humidity)
        )


def check_transitions(lattice: Any) -> None:
    """Raise a ValueError where the transitions of a lattice contradict its states."""
    names = "transitions", "transition_barriers", "transition_terms"
    arrays = [getattr(lattice, name) for name in names]
    states, (transitions, _, terms) = lattice.states, arrays
    if states is None and any(array is not None for array in arrays):
        raise ValueError("transitions: give the names of the states as well")
    unbonded = {None, *range(len(states or TWO_STATES))} - {1}
    if lattice.initial not in unbonded:
        raise ValueError(
            f"initial: {lattice.initial} is no state without a bond; give None, or one of {sorted(unbonded - {None})}"
        )
    if states is None:
        return
    count = np.size(transitions) // 2
    shapes = [(count, 2), (lattice.sites.size, count), (count, 2)]
    for name, array, shape in zip(names, arrays, shapes, strict=True):
        if np.shape(array) != shape or not np.isfinite(array).all():
            raise ValueError(
                f"{name}: shape {np.shape(array)}; give {shape} finite numbers"
            )
    if tuple(states[:2]) != TWO_STATES or len({*states}) < len(states):
        raise ValueError(
            f"states: {states}; name {' and '.join(TWO_STATES)} first, and none twice"
        )
    numbers = {*transitions.ravel().tolist()}
    if not numbers <= {*range(len(states))} or (terms[:, 1] < 0).any():
        raise ValueError(
            f"transitions: states {numbers} and factors {terms[:, 1]}; give states from 0 to {len(states) - 1}, and "
            "factors of rates that are not negative"
        )
