"""The forward model: what a density of barriers makes of hold times, on the real contacts of a scene.

ΔF(t) = ⟨f⟩ × front factor × sites × ∫ p(E) S(t; E) dE. S is averaged over pressure, breaking barriers and rim of the
contact: exactly where sites do not interact, and through the mean field of :mod:`chemage.inference.neighbours` where
they do. What the mean field leaves out is measured by the kinetics of the sites themselves
(:meth:`Condition.calibrate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage.ageing.seeds import replica_seeds
from chemage.contacts.role import ContactTheory
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.contacts.stage import solve_contact
from chemage.foundation import random
from chemage.foundation.errors import InputError
from chemage.foundation.threads import available, in_order
from chemage.foundation.units import EV_PER_GPA_NM3
from chemage.inference.kernel import EnergyGrid, make_kernel
from chemage.inference.neighbours import GROUPS, Environments, MeanField, Solved
from chemage.kinetics.stage import run_kinetics
from chemage.lattices.chemistry import Chemistry, contact_statistics
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.stage import build_lattice
from chemage.scene.scene import Scene
from chemage.surfaces.stage import make_surface

#: sites of the contact that stand for all in the mean field
ENVIRONMENTS = 1000
#: sites, over all replicas, whose kinetics calibrate the mean field; and limits of the number of replicas
SIMULATED, FEWEST, MOST = 80_000, 3, 600
#: decades over which the calibration is smoothed, and its standard deviation before anything was simulated
SMOOTHED, UNCALIBRATED = 0.5, 0.15
#: eV by which neighbours raise a barrier at most; beyond, no site bonds
MOST_SHIFT = 1.2
#: eV above the last node: a barrier that is never crossed
BEYOND = 3.0


@dataclass(eq=False)
class Condition:
    """One load and one temperature: a contact, its hold times, and the derivative of ΔF by the density there."""

    chemistry: Chemistry
    contact: ContactSolution | ContactStatistics
    temperature: float
    #: (m,) s, ascending
    hold_times: np.ndarray
    grid: EnergyGrid
    sites: float
    #: nN that a density of which all sites are bonded gives
    scale: float
    #: (m, n): ΔF over scale by the density, where sites do not interact
    exact: np.ndarray | None = None
    mean_field: MeanField | None = None
    #: (m,) positions of the hold times among the times of the mean field
    places: np.ndarray | None = None
    edges: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """GPa, between the groups of pressure"""
    #: (m,) simulated over mean field, and its standard error
    correction: np.ndarray | None = None
    correction_error: np.ndarray | None = None
    _last: Solved | None = None
    _lattices: list[Any] | None = None

    @property
    def interacting(self) -> bool:
        """Whether bonded neighbours change the barriers."""
        return self.mean_field is not None

    def linear(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ΔF at the hold times (m,), nN, and its derivative by the density (m, n)."""
        if self.mean_field is None or self.places is None:
            assert self.exact is not None
            return self.scale * (self.exact @ density), self.scale * self.exact
        start = self._last.shares if self._last is not None else None
        self._last = solved = self.mean_field.solve(density, start)
        share = self.mean_field.environments.shares
        factor = self.scale * (np.ones(self.hold_times.size) if self.correction is None else self.correction)
        value = factor * (share @ solved.shares)[self.places]
        return value, factor[:, None] * np.einsum("g,gln->ln", share, solved.derivative)[self.places]

    def without_neighbours(self) -> np.ndarray:
        """(m, n): the derivative that a contact without interaction would have, for a first guess."""
        if self.exact is not None:
            return self.scale * self.exact
        assert self.mean_field is not None
        assert self.places is not None
        env, kernel = self.mean_field.environments, self.mean_field.kernel
        left, part = kernel.places(env.lowering)
        weights = np.bincount(left, 1 - part, kernel.shifts) + np.bincount(left + 1, part, kernel.shifts)
        weights = np.broadcast_to(weights / env.lowering.size, (kernel.times.size, kernel.shifts))
        return self.scale * kernel.matrix(weights)[self.places]

    def calibrate(self, density: np.ndarray, scene: Scene, seed: int, threads: int | None = None) -> None:
        """Simulate the kinetics of the sites with barriers of ``density``, and correct the mean field at it.

        Every site keeps its uniform number, couplings and kinetic noise between calls (common random numbers). What the
        mean field expects of each site, given its barrier and pressure, is subtracted as a control variate, so that the
        draw of the barriers adds no noise.
        """
        if self.mean_field is None or self.places is None or not isinstance(self.contact, ContactSolution):
            return
        if self._last is None:
            self.linear(density)
        assert self._last is not None
        assert scene.engine is not None
        contact, engine, solved = self.contact, scene.engine, self._last
        expected = np.stack([self._of_energy(solved.weights[group]) for group in range(len(solved.weights))])
        if self._lattices is None:
            count = int(np.clip(math.ceil(SIMULATED / max(self.sites, 1.0)), FEWEST, MOST))
            self._lattices = [self._prepared(contact, seed, number) for number in range(count)]
        lattices, step = self._lattices, self.grid.fine_step
        beyond = float(self.grid.fine[-1]) + BEYOND

        def replica(number: int) -> tuple[np.ndarray, int]:
            lattice, uniform, lowering, group, noise = lattices[number]
            barrier = self.grid.quantile(density, uniform, beyond)
            made = lattice.model_copy(update={"forming": barrier + lowering})
            bonds = run_kinetics(
                engine, made, self.hold_times, temperature=self.temperature, seed=noise, contact=contact,
                chemistry=self.chemistry,
            ).bonds  # fmt: skip
            place = np.clip((barrier - self.grid.first) / step, 0, self.grid.fine.size - 1.001)
            left = place.astype(np.int64)
            part = place - left
            inside = barrier < beyond
            known = expected[group, :, left] * (1 - part)[:, None] + expected[group, :, left + 1] * part[:, None]
            return bonds - known[inside].sum(axis=0), barrier.size

        found = list(in_order(replica, len(lattices), threads or available(), None))
        sizes = np.array([size for _, size in found], dtype=float)
        surplus = np.stack([difference for difference, _ in found])
        excess = surplus.sum(axis=0) / sizes.sum()
        scatter = surplus - sizes[:, None] * excess
        error = np.sqrt((scatter**2).sum(axis=0) / max(len(found) - 1, 1) * len(found)) / sizes.sum()
        share = (self.mean_field.environments.shares @ solved.shares)[self.places]
        self.correction, self.correction_error = _smoothed(
            np.log10(self.hold_times), excess / np.maximum(share, 1e-12), error / np.maximum(share, 1e-12)
        )

    def _of_energy(self, weights: np.ndarray) -> np.ndarray:
        """(m, N): probability that the mean field gives to sites of each fine energy of a group."""
        assert self.mean_field is not None
        assert self.places is not None
        windows = self.mean_field.kernel.windows[self.places]
        return np.einsum("ls,lsj->lj", weights[self.places], windows, optimize=True)

    def _prepared(self, contact: ContactSolution, seed: int, number: int) -> tuple[Any, ...]:
        disorder, noise = replica_seeds(seed, number, "all", ())
        lattice = build_lattice(self.chemistry, contact, disorder)
        uniform = random.uniforms(disorder, random.FORMING, lattice.random_index)
        pressure = lattice.pressures(contact)
        lowering = -self.chemistry.activation_volume * EV_PER_GPA_NM3 * np.asarray(pressure, dtype=np.float64)
        return lattice, uniform, lowering, np.searchsorted(self.edges, pressure, side="right"), noise


def _smoothed(x: np.ndarray, excess: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """1 + the relative excess, smoothed over neighbouring times and drawn to 1 where it is not known; its error."""
    weight = 1 / np.maximum(error, 1e-4) ** 2
    near = np.exp(-0.5 * ((x[:, None] - x) / (SMOOTHED / 2)) ** 2)
    # neighbouring times see the same bonds: their noise is common, and counts once
    total = (near * weight).sum(axis=1)
    mean = (near * weight) @ excess / total
    own = 1 / np.maximum((near * weight).max(axis=1), 1e-300)
    kept = UNCALIBRATED**2 / (UNCALIBRATED**2 + own)
    return 1 + kept * mean, np.sqrt(kept * own)


class Contacts:
    """The contacts of a scene at several loads, each solved once."""

    def __init__(self, scene: Scene, progress: Callable[[int, int], None] | None = None) -> None:
        self.scene, self._made, self._surface = scene, {}, None
        self.progress = progress

    def at(self, load: float) -> ContactSolution | ContactStatistics:
        """The contact under ``load`` nN."""
        if load not in self._made:
            scene = self.scene
            with scene.in_use():
                if isinstance(scene.contact, ContactTheory):
                    self._made[load] = scene.contact.statistics(scene.surface, load, scene.surface_seed)
                else:
                    if self._surface is None:
                        self._surface = make_surface(scene.surface, scene.surface_seed)
                    self._made[load] = solve_contact(scene.solver, self._surface, load)
        return self._made[load]


def check_scene(scene: Scene) -> Chemistry:
    """The chemistry of a scene whose ageing can be inverted.

    Raises
    ------
    InputError
        Naming the section that is missing or cannot be inverted.
    """
    if scene.chemistry is None or scene.engine is None:
        raise InputError(
            f"scene {scene.name!r} ends at the contact; add [forming], [engine] and [hold], of which [forming] is what "
            "is inferred, so that any density will do"
        )
    if scene.rupture is not None:
        raise InputError(
            f"scene {scene.name!r}: [rupture] makes the friction depend on which sites are bonded, which measured "
            "curves do not tell; leave it out, and give bond_force and front_factor of [chemistry]"
        )
    if scene.chemistry.interaction is not None and isinstance(scene.contact, ContactTheory):
        raise InputError(
            f"scene {scene.name!r}: contact {scene.contact.kind!r} has no map of the pressure, and the neighbours of "
            "sites that interact are not known; solve the contact, or leave out [interaction]"
        )
    return scene.chemistry


def largest_lowering(contact: ContactSolution | ContactStatistics, chemistry: Chemistry) -> float:
    """eV by which pressure lowers the barriers of all but one in a thousand of the sites."""
    if isinstance(contact, ContactSolution):
        pressure = np.sort(chemistry.sites_of(contact).pressure)
        top = float(pressure[int(0.999 * (pressure.size - 1))]) if pressure.size else 0.0
    else:
        top = float(contact.pressure[-1])
    return chemistry.activation_volume * EV_PER_GPA_NM3 * top


def make_condition(
    chemistry: Chemistry,
    contact: ContactSolution | ContactStatistics,
    temperature: float,
    hold_times: np.ndarray,
    grid: EnergyGrid,
    seed: int = 0,
) -> Condition:
    """The forward model of one contact at one temperature, for a density on ``grid``."""
    times = np.unique(hold_times)
    statistics = contact if isinstance(contact, ContactStatistics) else contact_statistics(contact, chemistry)
    if isinstance(contact, ContactSolution):
        sites = float(chemistry.sites_of(contact).sites.size)
    else:
        sites = statistics.contact_area * float(chemistry.site_density)
    sites *= chemistry.hydroxylation
    if not sites > 0:
        raise InputError(
            f"contact at {contact.load:g} nN: has no sites in contact; check load, surface and site_density"
        )
    made = Condition(
        chemistry, contact, temperature, times, grid, sites, sites * chemistry.bond_force * chemistry.front_factor
    )
    per_gpa = chemistry.activation_volume * EV_PER_GPA_NM3
    if chemistry.interaction is None or not isinstance(contact, ContactSolution):
        shift = -per_gpa * statistics.pressure
        kernel = make_kernel(
            chemistry, temperature, times, grid, float(shift.min(initial=0)), float(shift.max(initial=0))
        )
        left, part = kernel.places(shift)
        share = statistics.area / statistics.contact_area
        weights = np.bincount(left, share * (1 - part), kernel.shifts) + np.bincount(
            left + 1, share * part, kernel.shifts
        )
        made.exact = kernel.matrix(np.broadcast_to(weights, (times.size, kernel.shifts)))
        return made
    early = times[0] * 10.0 ** np.arange(-5, 0, 0.4)
    late = times[0] * 10.0 ** np.arange(0, math.log10(times[-1] / times[0]) + 1e-9, 1 / 6)
    every = np.unique(np.concatenate([early, late, times]))
    environments, made.edges = _environments(chemistry, contact, seed)
    lowest = min(float(environments.lowering.min()), 0.0) - 0.25
    kernel = make_kernel(chemistry, temperature, every, grid, lowest, MOST_SHIFT)
    made.mean_field = MeanField(kernel, environments, temperature)
    made.places = np.searchsorted(every, times)
    return made


def _environments(chemistry: Chemistry, contact: ContactSolution, seed: int) -> tuple[Environments, np.ndarray]:
    """Sites drawn evenly over the pressures of the contact, with their own neighbours; and the edges of the groups."""
    lattices: list[ReactionLattice] = []
    total = 0
    while total < ENVIRONMENTS and len(lattices) < 50:
        disorder, _ = replica_seeds(seed, 1_000_000 + len(lattices), "all", ())
        lattices.append(build_lattice(chemistry, contact, disorder))
        total += max(lattices[-1].sites.size, 1)
    pressure = np.concatenate([np.asarray(one.pressures(contact), dtype=np.float64) for one in lattices])
    width = max(0 if one.coupling is None else one.coupling.shape[1] for one in lattices)
    coupling, there = np.zeros((pressure.size, width)), np.zeros((pressure.size, width), dtype=bool)
    begin = 0
    for one in lattices:
        end = begin + one.sites.size
        if one.coupling is not None and one.neighbours is not None:
            coupling[begin:end, : one.coupling.shape[1]] = one.coupling
            there[begin:end, : one.coupling.shape[1]] = one.neighbours >= 0
        begin = end
    order = np.argsort(pressure, kind="stable")
    count = min(ENVIRONMENTS, pressure.size)
    chosen = order[((np.arange(count) + 0.5) / count * pressure.size).astype(np.int64)]
    groups = GROUPS if chemistry.activation_volume and count >= 20 * GROUPS else 1
    group = (np.arange(count) * groups // count).astype(np.int64)
    edges = np.array([pressure[chosen][group == number][0] for number in range(1, groups)])
    uniform = np.random.default_rng([seed, 17]).random((count, width))
    uniform[~there[chosen]] = 2.0
    lowering = -chemistry.activation_volume * EV_PER_GPA_NM3 * pressure[chosen]
    return Environments(lowering, coupling[chosen] * there[chosen], uniform, group, groups), edges
