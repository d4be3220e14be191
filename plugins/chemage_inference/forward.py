"""The forward model: what a density of barriers makes of the hold times of all curves, on the contacts of a scene.

ΔF(t) = ⟨f⟩ × front factor × sites × ∫ p(E) S(t; E) dE. S is averaged over pressure, breaking barriers and rim of the
contact: exactly where sites do not interact, and through the mean field of :mod:`chemage_inference.energies` where
they do. What the mean field leaves out is measured by the kinetics of the sites themselves
(:meth:`Condition.calibrate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from chemage import (
    Chemistry,
    ContactSolution,
    InputError,
    ReactionLattice,
    Scene,
    Surface,
)
from chemage.plugin import (
    EV_PER_GPA_NM3,
    ContactStatistics,
    algebra,
    build_lattice,
    contact_of,
    contact_statistics,
    random,
    run_kinetics,
    surface_of,
)
from chemage.plugin import threads as processors
from chemage_inference.curves import MeasuredCurve
from chemage_inference.energies import (
    GROUPS,
    EnergyGrid,
    Environments,
    Kernel,
    MeanField,
    Solved,
    energy_grid,
    make_kernel,
)
from chemage_inference.noise import ErrorModel, Noise
from chemage_inference.problem import LOAD, Unknowns

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
#: error of the forward model, of the largest value of a curve: the density is piecewise linear, the truth is not
MODEL_ERROR = 1e-3


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
    #: (m, n): ΔF over scale by the density, as if sites did not interact
    alone: np.ndarray
    #: of sites that interact
    mean_field: MeanField | None = None
    #: (m,) positions of the hold times among the times of the mean field
    places: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    #: GPa, between the groups of pressure
    edges: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _last: Solved | None = None
    _lattices: list[Any] | None = None

    def __post_init__(self) -> None:
        #: (m,) simulated over mean field, and its standard error
        self.correction, self.correction_error = (
            np.ones(self.hold_times.size),
            np.zeros(self.hold_times.size),
        )

    @property
    def interacting(self) -> bool:
        """Whether bonded neighbours change the barriers."""
        return self.mean_field is not None

    def linear(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ΔF at the hold times (m,), nN, and its derivative by the density (m, n)."""
        if self.mean_field is None:
            value = self.scale * algebra.product(self.alone, density)
            return value, self.without_neighbours
        start = self._last.shares if self._last is not None else None
        self._last = solved = self.mean_field.solve(density, start)
        share = self.mean_field.environments.shares
        factor = self.scale * self.correction
        value = factor * algebra.product(share, solved.shares)[self.places]
        return value, factor[:, None] * np.einsum(
            "g,gln->ln", share, solved.derivative
        )[self.places]

    @property
    def without_neighbours(self) -> np.ndarray:
        """(m, n): the derivative that a contact without interaction would have, for a first guess."""
        return self.scale * self.alone

    @property
    def relative_error(self) -> np.ndarray:
        """(m,) standard error of the correction, relative to it."""
        return self.correction_error / self.correction

    def corrected_as(self, other: Condition) -> None:
        """Take over the correction of the same contact under another chemistry, or on other energies."""
        self.correction, self.correction_error = (
            other.correction,
            other.correction_error,
        )

    def calibrate(
        self,
        density: np.ndarray,
        scene: Scene,
        seed: int,
        threads: int | None = None,
    ) -> None:
        """Simulate the kinetics of the sites with barriers of ``density``, and correct the mean field at it.

        Every site keeps its uniform number, couplings and kinetic noise between calls (common random numbers). What the
        mean field expects of each site, given its barrier and pressure, is subtracted as a control variate, so that the
        draw of the barriers adds no noise.
        """
        if self.mean_field is None or not isinstance(self.contact, ContactSolution):
            return
        if self._last is None:
            self.linear(density)
        assert self._last is not None
        assert scene.engine is not None
        contact, engine, solved = self.contact, scene.engine, self._last
        expected = np.stack(
            [
                self._of_energy(solved.weights[group])
                for group in range(len(solved.weights))
            ]
        )
        if self._lattices is None:
            count = int(
                np.clip(math.ceil(SIMULATED / max(self.sites, 1.0)), FEWEST, MOST)
            )
            self._lattices = [
                self._prepared(contact, seed, number) for number in range(count)
            ]
        lattices, step = self._lattices, self.grid.fine_step
        beyond = float(self.grid.fine[-1]) + BEYOND

        def replica(number: int) -> tuple[np.ndarray, int]:
            lattice, uniform, lowering, group, noise = lattices[number]
            barrier = self.grid.quantile(density, uniform, beyond)
            sites = lattice.model_copy(update={"forming": barrier + lowering})
            bonds = run_kinetics(
                engine, sites, self.hold_times, temperature=self.temperature, seed=noise, contact=contact,
                chemistry=self.chemistry,
            ).bonds  # fmt: skip
            place = np.clip(
                (barrier - self.grid.first) / step, 0, self.grid.fine.size - 1.001
            )
            left = place.astype(np.int64)
            part = place - left
            inside = barrier < beyond
            mean = (
                expected[group, :, left] * (1 - part)[:, None]
                + expected[group, :, left + 1] * part[:, None]
            )
            return bonds - mean[inside].sum(axis=0), barrier.size

        replicas = processors.in_order(
            replica, len(lattices), threads or processors.available(), None
        )
        sizes = np.array([size for _, size in replicas], dtype=float)
        surplus = np.stack([difference for difference, _ in replicas])
        excess = surplus.sum(axis=0) / sizes.sum()
        scatter = surplus - sizes[:, None] * excess
        error = (
            np.sqrt(
                (scatter**2).sum(axis=0) / max(len(replicas) - 1, 1) * len(replicas)
            )
            / sizes.sum()
        )
        share = algebra.product(self.mean_field.environments.shares, solved.shares)[
            self.places
        ]
        self.correction, self.correction_error = _smoothed(
            np.log10(self.hold_times),
            excess / np.maximum(share, 1e-12),
            error / np.maximum(share, 1e-12),
        )

    def _of_energy(self, weights: np.ndarray) -> np.ndarray:
        """(m, N): probability that the mean field gives to sites of each fine energy of a group."""
        assert self.mean_field is not None
        windows = self.mean_field.kernel.windows[self.places]
        return np.einsum("ls,lsj->lj", weights[self.places], windows)

    def _prepared(
        self, contact: ContactSolution, seed: int, number: int
    ) -> tuple[Any, ...]:
        disorder = np.random.SeedSequence(seed, spawn_key=(number, 0))
        noise = random.CommonSeed(seed, spawn_key=(number, 1))
        lattice = build_lattice(self.chemistry, contact, disorder)
        uniform = random.uniforms(disorder, random.FORMING, lattice.random_index)
        pressure = lattice.pressures(contact)
        lowering = (
            -self.chemistry.activation_volume
            * EV_PER_GPA_NM3
            * np.asarray(pressure, dtype=np.float64)
        )
        return (
            lattice,
            uniform,
            lowering,
            np.searchsorted(self.edges, pressure, side="right"),
            noise,
        )


def _smoothed(
    x: np.ndarray, excess: np.ndarray, error: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """1 + the relative excess, smoothed over neighbouring times and drawn to 1 where it is not known; its error."""
    weight = 1 / np.maximum(error, 1e-4) ** 2
    near = np.exp(-0.5 * ((x[:, None] - x) / (SMOOTHED / 2)) ** 2)
    # neighbouring times see the same bonds: their noise is common, and counts once
    total = (near * weight).sum(axis=1)
    mean = algebra.product(near * weight, excess) / total
    own = 1 / np.maximum((near * weight).max(axis=1), 1e-300)
    kept = UNCALIBRATED**2 / (UNCALIBRATED**2 + own)
    return 1 + kept * mean, np.sqrt(kept * own)


class Contacts:
    """The contacts of a scene at several loads, each solved once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._by_load: dict[float, ContactSolution | ContactStatistics] = {}

    @cached_property
    def _surface(self) -> Surface:
        return surface_of(self.scene)

    def at(self, load: float) -> ContactSolution | ContactStatistics:
        """The contact under ``load`` nN."""
        if load not in self._by_load:
            surface = self._surface if self.scene.contact.gives_map else None
            self._by_load[load] = contact_of(
                self.scene.model_copy(update={"load": load}), surface
            )
        return self._by_load[load]


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
    if scene.chemistry.interaction is not None and not scene.contact.gives_map:
        raise InputError(
            f"scene {scene.name!r}: contact {scene.contact.kind!r} has no map of the pressure, and the neighbours of "
            "sites that interact are not known; solve the contact, or leave out [interaction]"
        )
    return scene.chemistry


def largest_lowering(
    contact: ContactSolution | ContactStatistics, chemistry: Chemistry
) -> float:
    """eV by which pressure lowers the barriers of all but one in a thousand of the sites."""
    if isinstance(contact, ContactSolution):
        pressure = np.sort(chemistry.sites_of(contact).pressure)
        top = (
            float(pressure[int(0.999 * (pressure.size - 1))])
            if pressure.size
            else 0.0
        )
    else:
        top = float(contact.pressure[-1])
    return chemistry.activation_volume * EV_PER_GPA_NM3 * top


def _sites(
    chemistry: Chemistry, contact: ContactSolution | ContactStatistics
) -> float:
    if isinstance(contact, ContactSolution):
        sites = float(chemistry.sites_of(contact).sites.size)
    else:
        statistics = contact_statistics(contact, chemistry)
        sites = statistics.contact_area * float(chemistry.site_density)
    sites *= chemistry.hydroxylation
    if not sites > 0:
        raise InputError(
            f"contact at {contact.load:g} nN: has no sites in contact; check load, surface and site_density"
        )
    return sites


def make_condition(
    chemistry: Chemistry,
    contact: ContactSolution | ContactStatistics,
    temperature: float,
    hold_times: np.ndarray,
    grid: EnergyGrid,
    seed: int = 0,
    before: tuple[float, float] | None = None,
) -> Condition:
    """The forward model of one contact at one temperature, for a density on ``grid``; ``before``: see
    :func:`chemage_inference.energies.bonded_probability`."""
    times = np.unique(hold_times)
    sites = _sites(chemistry, contact)
    statistics = contact_statistics(contact, chemistry)
    scale = sites * chemistry.bond_force * chemistry.front_factor
    if chemistry.interaction is None or not isinstance(contact, ContactSolution):
        shift = -chemistry.activation_volume * EV_PER_GPA_NM3 * statistics.pressure
        lowest, highest = float(shift.min(initial=0)), float(shift.max(initial=0))
        ends = lowest, highest
        kernel = make_kernel(chemistry, temperature, times, grid, *ends, before)
        alone = _alone(kernel, shift, statistics.area / statistics.contact_area)
        return Condition(
            chemistry, contact, temperature, times, grid, sites, scale, alone
        )
    if before is not None:
        raise InputError(
            "before: sites that interact have no rest before; leave it out, or leave out [interaction]"
        )
    early = times[0] * 10.0 ** np.arange(-5, 0, 0.4)
    late = times[0] * 10.0 ** np.arange(
        0, math.log10(times[-1] / times[0]) + 1e-9, 1 / 6
    )
    every = np.unique(np.concatenate([early, late, times]))
    environments, edges = _environments(chemistry, contact, seed)
    lowest = min(float(environments.lowering.min()), 0.0) - 0.25
    kernel = make_kernel(chemistry, temperature, every, grid, lowest, MOST_SHIFT)
    mean_field = MeanField(kernel, environments, temperature)
    places = np.searchsorted(every, times)
    alone = _alone(kernel, environments.lowering, 1.0, environments.lowering.size)[
        places
    ]
    return Condition(
        chemistry,
        contact,
        temperature,
        times,
        grid,
        sites,
        scale,
        alone,
        mean_field,
        places,
        edges,
    )


def _alone(
    kernel: Kernel,
    shift: np.ndarray,
    weight: np.ndarray | float,
    total: float = 1.0,
) -> np.ndarray:
    """(l, n): derivative of the bonded share by the density; sites of ``shift`` (s,) weigh ``weight`` of ``total``."""
    weights = kernel.spread(shift[None], weight) / total
    return kernel.matrix(np.repeat(weights, kernel.times.size, axis=0))


def _environments(
    chemistry: Chemistry, contact: ContactSolution, seed: int
) -> tuple[Environments, np.ndarray]:
    """Sites drawn evenly over the pressures of the contact, with their own neighbours; and the edges of the groups."""
    lattices: list[ReactionLattice] = []
    total = 0
    while total < ENVIRONMENTS and len(lattices) < 50:
        disorder = np.random.SeedSequence(
            seed, spawn_key=(1_000_000 + len(lattices), 0)
        )
        lattices.append(build_lattice(chemistry, contact, disorder))
        total += max(lattices[-1].sites.size, 1)
    pressure = np.concatenate(
        [
            np.asarray(lattice.pressures(contact), dtype=np.float64)
            for lattice in lattices
        ]
    )
    width = max(
        0 if lattice.coupling is None else lattice.coupling.shape[1]
        for lattice in lattices
    )
    coupling = np.zeros((pressure.size, width))
    there = np.zeros((pressure.size, width), dtype=bool)
    begin = 0
    for lattice in lattices:
        end = begin + lattice.sites.size
        if lattice.coupling is not None and lattice.neighbours is not None:
            coupling[begin:end, : lattice.coupling.shape[1]] = lattice.coupling
            there[begin:end, : lattice.coupling.shape[1]] = lattice.neighbours >= 0
        begin = end
    order = np.argsort(pressure, kind="stable")
    count = min(ENVIRONMENTS, pressure.size)
    chosen = order[
        ((np.arange(count) + 0.5) / count * pressure.size).astype(np.int64)
    ]
    groups = GROUPS if chemistry.activation_volume and count >= 20 * GROUPS else 1
    group = (np.arange(count) * groups // count).astype(np.int64)
    edges = np.array(
        [pressure[chosen][group == number][0] for number in range(1, groups)]
    )
    uniform = np.random.default_rng([seed, 17]).random((count, width))
    uniform[~there[chosen]] = 2.0
    lowering = -chemistry.activation_volume * EV_PER_GPA_NM3 * pressure[chosen]
    return Environments(
        lowering, coupling[chosen] * there[chosen], uniform, group, groups
    ), edges


@dataclass(eq=False)
class Model:
    """The forward model of all measured points."""

    scene: Scene
    chemistry: Chemistry
    unknowns: Unknowns
    curves: Sequence[MeasuredCurve]
    grid: EnergyGrid
    contacts: Contacts
    seed: int
    error_model: ErrorModel = field(default_factory=ErrorModel)
    #: (point of the grid of scalars, condition) -> its model
    conditions: dict[tuple[int, int], Condition] = field(default_factory=dict)

    def __post_init__(self) -> None:
        #: the point of the grid of scalars from which sampling begins: the middle, until another is known to fit better
        self.middle = self.unknowns.points // 2
        self.loads = list(dict.fromkeys(curve.load for curve in self.curves))
        self.keys = list(
            dict.fromkeys(
                (curve.load, curve.temperature, curve.before)
                for curve in self.curves
            )
        )
        curves = self.curves
        self.curve = np.repeat(
            np.arange(len(curves)), [curve.hold_times.size for curve in curves]
        )
        self.hold_times = np.concatenate([curve.hold_times for curve in curves])
        self.values = np.concatenate([curve.friction_drop for curve in curves])
        #: (m,) what the forward model is thought to be wrong by
        self.floors = np.array(
            [MODEL_ERROR * np.abs(curve.friction_drop).max() for curve in curves]
        )[self.curve]
        self.stated = np.concatenate(
            [curve.friction_drop_errors for curve in curves]
        )
        #: (m,) see :class:`chemage_inference.noise.Noise`
        self.near = np.concatenate([curve.known_correlation for curve in curves])
        #: errors as they are thought to be now
        self.state = self._noise(self.floors).start
        self.which = np.array(
            [
                self.keys.index((curve.load, curve.temperature, curve.before))
                for curve in curves
            ]
        )[self.curve]
        self.times = [
            np.unique(self.hold_times[self.which == k])
            for k in range(len(self.keys))
        ]

    def condition(self, point: int, number: int) -> Condition:
        """The model of a condition at a point of the grid of scalars; made once."""
        if (point, number) not in self.conditions:
            load, temperature, before = self.keys[number]
            chemistry = self.unknowns.chemistry(self.chemistry, point)
            contact = self.contacts.at(self.unknowns.load(load, point))
            condition = make_condition(
                chemistry,
                contact,
                temperature,
                self.times[number],
                self.grid,
                self.seed,
                before,
            )
            self.conditions[point, number] = condition
            if (middle := self.conditions.get((self.middle, number))) is not None:
                condition.corrected_as(middle)
        return self.conditions[point, number]

    def on(self, grid: EnergyGrid) -> Model:
        """The same model on other energies."""
        other = replace(self, grid=grid, conditions={})
        other.middle, other.state = self.middle, self.state
        for number in range(len(self.keys)):
            other.condition(self.middle, number).corrected_as(
                self.condition(self.middle, number)
            )
        return other

    @property
    def interacting(self) -> bool:
        """Whether bonded neighbours change the barriers."""
        return self.condition(self.middle, 0).interacting

    def _gathered(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """One row for each point, of arrays (hold times, ...) of each condition."""
        rows = np.empty((self.values.size, *parts[0].shape[1:]))
        for number, part in enumerate(parts):
            here = self.which == number
            rows[here] = part[
                np.searchsorted(self.times[number], self.hold_times[here])
            ]
        return rows

    def _at(self, point: int) -> list[Condition]:
        return [self.condition(point, number) for number in range(len(self.keys))]

    def linear(
        self, density: np.ndarray, point: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """ΔF of every measured point at ``density`` (m,), and its derivative (m, n)."""
        values, slopes = zip(
            *(condition.linear(density) for condition in self._at(point)),
            strict=True,
        )
        return self._gathered(values), self._gathered(slopes)

    def without_neighbours(self, point: int) -> np.ndarray:
        """(m, n): the derivative without interaction."""
        return self._gathered(
            [condition.without_neighbours for condition in self._at(point)]
        )

    def calibrate(self, density: np.ndarray, threads: int | None) -> None:
        """Simulate the kinetics of every condition at ``density``; all points of the grid get the same correction."""
        for number, middle in enumerate(self._at(self.middle)):
            middle.calibrate(density, self.scene, self.seed, threads)
            for (_, other), condition in self.conditions.items():
                if other == number:
                    condition.corrected_as(middle)

    @property
    def noise(self) -> Noise:
        """The likelihood of residuals, with the errors of the forward model."""
        relative = self._gathered(
            [condition.relative_error for condition in self._at(self.middle)]
        )
        return self._noise(np.hypot(self.floors, relative * self.values))

    def _noise(self, floors: np.ndarray) -> Noise:
        numbers = np.array(
            [self.instruments.index(curve.instrument) for curve in self.curves]
        )
        loads = [self.loads.index(curve.load) for curve in self.curves]
        return Noise(
            self.error_model,
            self.stated,
            floors,
            self.curve,
            self.hold_times,
            numbers,
            np.zeros(0) if np.isnan(self.near).all() else self.near,
            np.array(loads),
            self._site_errors,
        )

    @cached_property
    def _site_errors(self) -> np.ndarray:
        """(loads,) of the logarithm of the sites under an unknown load, 0 where smaller than other errors: as it rises,
        pixels come into contact one after the other, and some at once."""
        errors = np.zeros(len(self.loads))
        if LOAD not in self.unknowns.axes:
            return errors
        points = range(self.unknowns.axes[LOAD].size)  # the last axis
        for number, stated in enumerate(self.loads):
            loads = [self.unknowns.load(stated, point) for point in points]
            sites = [
                _sites(self.chemistry, self.contacts.at(load)) for load in loads
            ]
            smooth = np.polynomial.Polynomial.fit(np.log(loads), np.log(sites), 2)
            errors[number] = np.std(np.log(sites) - smooth(np.log(loads)), ddof=3)
        return np.where(errors > MODEL_ERROR, errors, 0.0)

    @property
    def instruments(self) -> list[str]:
        """Names of the instruments with which the curves were measured."""
        return list(dict.fromkeys(curve.instrument for curve in self.curves))

    @property
    def errors(self) -> np.ndarray:
        """(m,) standard errors as they are thought to be now."""
        return self.noise.errors(self.state)

    def labels(self) -> list[str]:
        """What each point is, in words."""
        return [
            f"{time:.3g} s of {curve.name}"
            for curve in self.curves
            for time in curve.hold_times
        ]

    def seen(self) -> np.ndarray:
        """(n,) whether some condition has hold times before and after sites of this barrier bond."""
        seen = np.zeros(self.grid.count, dtype=bool)
        for condition in self._at(self.middle):
            share = condition.without_neighbours[[0, -1]] / (
                condition.scale * self.grid.areas
            )
            seen |= (share[1] - share[0]) >= 0.5 * max(float(share[1].max()), 1e-12)
        return seen


def make_model(
    scene: Scene,
    chemistry: Chemistry,
    unknowns: Unknowns,
    curves: Sequence[MeasuredCurve],
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    error_model: ErrorModel = ErrorModel(),  # noqa: B008
) -> Model:
    """Solve the contacts of all loads, and choose the energies."""
    contacts = Contacts(scene)
    loads = list(dict.fromkeys(curve.load for curve in curves))
    lowering = 0.0
    bounds = unknowns.bounds
    widest = chemistry.replace(
        activation_volume=bounds.get(
            "activation_volume", (0.0, chemistry.activation_volume)
        )[1],
        attempt_frequency=bounds.get(
            "attempt_frequency", (0.0, chemistry.attempt_frequency)
        )[1],
    )
    for done, load in enumerate(loads):
        if progress:
            progress(done, len(loads))
        top = unknowns.load(load, unknowns.points - 1)
        lowering = max(lowering, largest_lowering(contacts.at(top), widest))
    if progress:
        progress(len(loads), len(loads))
    rests = [curve.before for curve in curves if curve.before is not None]
    temperatures = np.concatenate(
        [np.full(curve.hold_times.size, curve.temperature) for curve in curves]
        + [np.array([kelvin]) for kelvin, _ in rests]
    )
    times = np.concatenate(
        [curve.hold_times for curve in curves]
        + [np.array([span]) for _, span in rests]
    )
    grid = energy_grid(widest, temperatures, times, lowering)
    if (
        "attempt_frequency" in bounds
    ):  # the lowest frequency reacts at lower energies
        lower = energy_grid(
            widest.replace(attempt_frequency=bounds["attempt_frequency"][0]),
            temperatures,
            times,
            lowering,
        )
        count = int(np.ceil((grid.nodes[-1] - lower.first) / grid.step)) + 1
        grid = EnergyGrid(lower.first, grid.step, count)
    return Model(
        scene, chemistry, unknowns, curves, grid, contacts, seed, error_model
    )
