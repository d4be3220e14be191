"""Bonds of uniform contacts beside those of sites that do not interact: what the interaction changes, tabulated.

At each pressure a periodic contact without a rim, the same sites without interaction, and stripes of the same sites are
followed with the same barriers and the same kinetic noise. The share of bonded sites is that of independent sites,
which is known exactly, plus the difference of the first two (a control variate: Law, Simulation Modeling and Analysis,
section 11.4). Differences between the stripes and the same sites of the contact without a rim give the rim term.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage import (
    KB,
    Chemistry,
    ContactSolution,
    Engine,
    ReactionLattice,
    build_lattice,
    random,
    run_kinetics,
)
from chemage.foundation.threads import in_order
from chemage_ageing._independent import bonded_share, shift_per_gpa

#: changes with what is computed below, so that tables of an older version are not used
VERSION = 1
#: sites along a side of a uniform contact; of the blocks of which its scatter is found; period and width of a stripe
SIDE, BLOCK, PERIOD, WIDTH = 128, 16, 32, 8
#: hold times per decade
PER_DECADE = 8
#: replicas: those begun with, and the most
FIRST, MOST = 4, 256
#: a share of bonded sites of one in so many sites of the table is not resolved any better
RESOLVED = 20.0
#: pressures are so many k_BT of the barrier apart
STEP = 1.0


@dataclass(frozen=True)
class Node:
    """What the interaction changes at one pressure; per site in contact, at each time of the table, (m,) each."""

    #: change of the share of bonded sites inside the contact
    change: np.ndarray
    change_error: np.ndarray
    #: coefficient of the rim term: a in a (x − x²) − change x², for sites that lack the share x of their neighbours
    rim: np.ndarray
    rim_error: np.ndarray
    replicas: int


@dataclass(frozen=True)
class Setting:
    """All on which a node depends, beside its number."""

    chemistry: Chemistry
    engine: Engine
    temperature: float
    #: nm, distance of the sites
    spacing: float
    #: neighbours of a site inside the contact
    most: int
    #: first and last decade of the times
    decades: tuple[int, int]
    accuracy: float
    seed: int = 0

    @property
    def times(self) -> np.ndarray:
        """(m,) s."""
        first, last = self.decades
        return 10.0 ** (np.arange(first * PER_DECADE, last * PER_DECADE + 1) / PER_DECADE)

    @property
    def pressure_step(self) -> float:
        """Distance of the pressures of the table, GPa; 0 where bonds do not depend on the pressure."""
        shift = abs(shift_per_gpa(self.chemistry))
        return STEP * KB * self.temperature / shift if shift else 0.0

    def identity(self) -> dict[str, Any]:
        """As plain JSON values; equal for equal tables."""
        chemistry = self.chemistry.identity()
        for name in ("bond_force", "front_factor", "site_density"):
            chemistry.pop(name, None)
        return {
            "version": VERSION,
            "chemistry": chemistry,
            "engine": self.engine.identity(),
            "temperature": self.temperature,
            "spacing": float(f"{self.spacing:.4g}"),
            "decades": list(self.decades),
            "accuracy": self.accuracy,
            "grid": [SIDE, BLOCK, PERIOD, WIDTH, PER_DECADE, STEP],
        }


@dataclass
class Took:
    """The plugins that took part in a table, and what is approximate about it."""

    plugins: dict[str, str] = field(default_factory=dict)
    approximate: list[dict[str, Any]] = field(default_factory=list)


def decades_of(hold_times: np.ndarray) -> tuple[int, int]:
    """The decades that contain the hold times above 0."""
    positive = hold_times[hold_times > 0]
    if not positive.size:
        return 0, 1
    first = math.floor(math.log10(float(positive.min())) + 1e-9)
    return first, max(math.ceil(math.log10(float(positive.max())) - 1e-9), first + 1)


def compute(
    setting: Setting, numbers: list[int], threads: int, progress: Callable[[int, int], None] | None
) -> dict[int, Node]:
    """The nodes of these numbers; node k is at k times :attr:`Setting.pressure_step`."""
    made = in_order(lambda k: _node(setting, numbers[k]), len(numbers), max(1, min(threads, len(numbers))), progress)
    return dict(zip(numbers, made, strict=True))


def taking_part(setting: Setting) -> Took:
    """What takes part in the table now, from a small contact."""
    lattice = build_lattice(_own(setting), _uniform(setting, 0, np.ones((4, 4), dtype=bool)), 0)
    times = setting.times[:1]
    history = run_kinetics(setting.engine, lattice, times, temperature=setting.temperature, seed=0)
    return Took(lattice.plugins | history.plugins, [*lattice.approximate, *history.approximate])


def _own(setting: Setting) -> Chemistry:
    return setting.chemistry.replace(site_density="pixel", hardness=None, shear_strength=None)


def _pressure(setting: Setting, number: int) -> float:
    # a contact without pressure would have no sites
    return max(number * setting.pressure_step, 1e-9)


def _uniform(setting: Setting, number: int, where: np.ndarray) -> ContactSolution:
    pressure = np.where(where, _pressure(setting, number), 0.0)
    load = float(pressure.sum()) * setting.spacing**2
    return ContactSolution(pressure=pressure, load=load, pixel_size=setting.spacing, modulus=1.0, periodic=True)


def _node(setting: Setting, number: int) -> Node:
    samples = _Samples(setting, number)
    count = FIRST
    while True:
        while len(samples.rims) < count:
            samples.add(len(samples.rims))
        node = samples.node()
        if count >= MOST or samples.sufficient(node):
            return node
        count *= 2


class _Samples:
    """The replicas of a node."""

    def __init__(self, setting: Setting, number: int) -> None:
        self.setting, self.number = setting, number
        full = np.ones((SIDE, SIDE), dtype=bool)
        stripes = np.broadcast_to(np.arange(SIDE) % PERIOD < WIDTH, (SIDE, SIDE))
        self.full, self.stripes = (_uniform(setting, number, where) for where in (full, stripes))
        pressure = np.array([_pressure(setting, number)])
        exact = bonded_share(setting.chemistry, setting.temperature, setting.times, pressure)
        self.independent = exact[0]
        #: (blocks, m) share of the sites in contact, over all replicas
        self.coupled: list[np.ndarray] = []
        self.control: list[np.ndarray] = []
        #: (m,) of each replica: difference of the stripes, per site
        self.rims: list[np.ndarray] = []
        self.moments = self._moments()

    def _moments(self) -> tuple[float, float]:
        """Means of x − x² and of x² over the sites of the stripes, x being the share of neighbours that they lack."""
        chemistry = _own(self.setting).replace(hydroxylation=1.0)
        graph = build_lattice(chemistry, self.stripes, 0).neighbours
        assert graph is not None
        x = 1.0 - np.count_nonzero(graph >= 0, axis=1) / self.setting.most
        return float(np.mean(x - x * x)), float(np.mean(x * x))

    def add(self, replica: int) -> None:
        setting, chemistry = self.setting, _own(self.setting)
        disorder = np.random.SeedSequence(setting.seed, spawn_key=(self.number, replica, 0))
        noise = random.CommonSeed(setting.seed, spawn_key=(self.number, replica, 1))

        def states(chemistry: Chemistry, contact: ContactSolution) -> tuple[ReactionLattice, np.ndarray]:
            lattice = build_lattice(chemistry, contact, disorder)
            history = run_kinetics(
                setting.engine, lattice, setting.times, temperature=setting.temperature, seed=noise, states=True
            )
            assert history.states is not None
            return lattice, history.states

        full, coupled = states(chemistry, self.full)
        alone, control = states(chemistry.replace(interaction=None), self.full)
        part, rim = states(chemistry, self.stripes)
        self.coupled.append(_blocks(full.sites, coupled))
        self.control.append(_blocks(alone.sites, control))
        same = np.searchsorted(full.sites, part.sites)
        touching = np.count_nonzero(self.stripes.contact)
        self.rims.append((rim.sum(axis=1) - coupled[:, same].sum(axis=1)) / touching)

    def node(self) -> Node:
        coupled, control = np.concatenate(self.coupled), np.concatenate(self.control)
        control = control - self.independent
        # the coefficient of least variance, at each time
        spread = control.var(axis=0)
        covariance = np.mean((coupled - coupled.mean(axis=0)) * (control - control.mean(axis=0)), axis=0)
        factor = np.divide(covariance, spread, out=np.ones_like(spread), where=spread > 0)
        values = coupled - factor * control
        change = values.mean(axis=0) - self.independent
        error = values.std(axis=0, ddof=1) / math.sqrt(len(values))
        rims = np.stack(self.rims)
        linear, square = self.moments
        rim = (rims.mean(axis=0) + change * square) / linear
        rim_error = rims.std(axis=0, ddof=1) / math.sqrt(len(rims)) / linear
        return Node(change, error, rim, rim_error, len(rims))

    def sufficient(self, node: Node) -> bool:
        """Whether the error is below the accuracy at each decade, as far as bonds are there."""
        at = slice(None, None, PER_DECADE)
        share = (self.independent + node.change)[at]
        sites = SIDE * SIDE * node.replicas
        return bool((node.change_error[at] <= self.setting.accuracy * np.maximum(share, RESOLVED / sites)).all())


def _blocks(sites: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Bonded sites of each block over its sites in contact, (blocks, m)."""
    across = SIDE // BLOCK
    rows, columns = np.divmod(sites, SIDE)
    block = rows // BLOCK * across + columns // BLOCK
    order = np.argsort(block, kind="stable")
    edges = np.searchsorted(block[order], np.arange(across * across + 1))
    total = np.concatenate([np.zeros((len(states), 1)), np.cumsum(states[:, order], axis=1)], axis=1)
    return np.diff(total[:, edges], axis=1).T / BLOCK**2
