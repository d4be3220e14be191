"""How many bonds form and break in a pull, estimated before it is made: every site by itself, in the mean field of its
neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from chemage import ReactionLattice
from chemage.plugin import EV_PER_GPA_NM3, KB, Drive, TwoState
from chemage_kinetics._common import Array

#: iterations of the mean field, and of the stretch at which bonds break
SWEEPS, STEPS = 12, 4


def rates(barriers: Array, frequency: float, temperature: float) -> Array:
    """Hz at which bonds form or break over ``barriers`` (eV) without a force."""
    return frequency * np.exp(-np.maximum(barriers, 0.0) / (KB * temperature))


def rupture_stretch(
    barriers: Array, drive: Drive, frequency: float, temperature: float
) -> Array:
    """nm at which bonds with these breaking barriers (eV) carry most: their rate times the stretch is the speed."""
    thermal = KB * temperature
    barriers = np.maximum(np.asarray(barriers, float), 1e-9)
    stretch = np.full(
        barriers.shape,
        thermal / EV_PER_GPA_NM3 / drive.transition_distance / drive.bond_stiffness,
    )
    for _ in range(STEPS):
        tries = np.log(np.maximum(frequency * stretch / drive.speed, 1.0))
        left = np.minimum(thermal * tries / barriers, 1.0)
        force = (
            barriers
            / EV_PER_GPA_NM3
            / (drive.exponent * drive.transition_distance)
            * (1 - left**drive.exponent)
        )
        stretch = np.maximum(force / drive.bond_stiffness, 1e-2 * stretch)
    return stretch


def lifetimes(
    barriers: Array, drive: Drive, way: float, frequency: float, temperature: float
) -> Array:
    """Seconds that bonds last, (n,), where the slider goes by ``way`` (nm) in all."""
    alone = 1.0 / np.maximum(rates(barriers, frequency, temperature), 1e-300)
    if drive.speed == 0 or drive.bond_stiffness == 0 or way <= 0:
        return alone
    stretch = rupture_stretch(barriers, drive, frequency, temperature)
    return np.where(stretch < way, np.minimum(alone, stretch / drive.speed), alone)


def waiting(
    forming: Array, span: float, frequency: float, temperature: float
) -> Array:
    """Seconds until sites without a bond form one, at most ``span``."""
    return np.minimum(
        1.0 / np.maximum(rates(forming, frequency, temperature), 1e-300), span
    )


class Renewed(NamedTuple):
    """Partners that sites come to one after the other."""

    forming: Array
    """eV, barriers to forming a bond with them"""
    passing: float
    """s, in which the slider goes from one to the next"""

    def waiting(
        self, shift: Array, span: float, frequency: float, temperature: float
    ) -> Array:
        """Seconds until sites whose barriers are higher by ``shift`` (eV) form a bond, at most ``span``: the mean time
        with a partner over the probability to bind to it."""
        spent, binds = np.zeros(np.shape(shift)), np.zeros(np.shape(shift))
        for barrier in self.forming:
            speed = np.maximum(
                rates(barrier + shift, frequency, temperature), 1e-300
            )
            bound = TwoState(speed, 0.0).bonded(self.passing)
            spent, binds = spent + bound / speed, binds + bound
        return np.minimum(spent / np.maximum(binds, 1e-300), span)


def slider_way(drive: Drive, bonds: float, stretch: float, span: float) -> float:
    """How far the slider comes in ``span`` seconds, nm: a spring is first loaded by ``bonds`` stretched so far."""
    if drive.spring == 0:
        return 0.0
    if drive.spring is None:
        return drive.speed * span
    loaded = bonds * drive.bond_stiffness * stretch + drive.friction
    return drive.speed * span - loaded / drive.spring


def flips(wait: Array, last: Array, bonded: Array, span: float) -> Array:
    """Bonds that each site forms and breaks in ``span`` seconds, from the share that is ``bonded`` at first."""
    opened, formed = TwoState(1 / last, 1 / wait), TwoState(1 / wait, 1 / last)
    from_bond, from_none = (
        chain.bonded(span) + 2 * chain.broken(span) for chain in (opened, formed)
    )
    return bonded * from_bond + (1 - bonded) * from_none


def flips_on(
    lattice: ReactionLattice,
    drive: Drive,
    span: float,
    temperature: float,
    bonded: Array,
    again: Renewed | None,
    enough: float,
) -> float:
    """Bonds that form and break on ``lattice`` in ``span`` seconds; ``again``: the partners that
    they come to, None where sites keep theirs.

    At first as if every bond broke like the weakest one and formed again at once, then with all couplings that help
    bonds to form and the lowest barriers. If that bound exceeds ``enough`` too, the larger of two mean fields, of all
    neighbours open and of all bonded at first: bonds that help each other to form may do so only once there are some.
    """
    nu, n = lattice.attempt_frequency, lattice.sites.size
    assert lattice.breaking is not None
    if not n or span <= 0:
        return 0.0
    weakest = lifetimes(
        np.array([lattice.breaking.min()]), drive, np.inf, nu, temperature
    )
    if (most := n * (1 + 2 * span / float(weakest[0]))) <= enough:
        return most
    stretch = 0.0
    if drive.speed > 0 and drive.bond_stiffness > 0:
        stretch = float(
            np.median(rupture_stretch(lattice.breaking, drive, nu, temperature))
        )
    way = slider_way(drive, float(np.count_nonzero(bonded)), stretch, span)
    last = lifetimes(lattice.breaking, drive, way, nu, temperature)

    def forms_after(shift: Array, partners: Renewed | None) -> Array:
        if partners is None:
            return waiting(lattice.forming + shift, span, nu, temperature)
        return partners.waiting(shift, span, nu, temperature)

    def around(there: Array) -> Array:
        if lattice.neighbours is None or lattice.coupling is None:
            return np.zeros(n)
        return (
            lattice.coupling
            * np.where(lattice.neighbours >= 0, there[lattice.neighbours], 0.0)
        ).sum(axis=1)

    helped = np.zeros(n)
    if lattice.coupling is not None:
        helped = np.minimum(lattice.coupling, 0.0).sum(axis=1)
    wait = forms_after(helped, None)
    if again is not None:
        lowest = again._replace(forming=again.forming[:1])
        wait = np.minimum(wait, forms_after(helped, lowest))
    if (most := float(flips(wait, last, bonded, span).sum())) <= enough:
        return most
    found = []
    for there in (np.zeros(n), np.ones(n)):
        wait = forms_after(around(there), again)
        for _ in range(SWEEPS):
            there = 0.5 * (there + last / (wait + last))
            wait = forms_after(around(there), again)
        found.append(float(flips(wait, last, bonded, span).sum()))
    return max(found)
