"""The measured points of all curves, and their linear model about a density, with contacts solved once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from chemage.inference.curves import MeasuredCurve
from chemage.inference.forward import Condition, Contacts, largest_lowering, make_condition
from chemage.inference.kernel import EnergyGrid, energy_grid
from chemage.inference.unknowns import Unknowns
from chemage.lattices.chemistry import Chemistry
from chemage.scene.scene import Scene

#: error of the forward model, of the largest value of a curve: the density is piecewise linear, the truth is not
MODEL_ERROR = 1e-3


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
    #: (point of the grid of scalars, condition) -> its model
    conditions: dict[tuple[int, int], Condition] = field(default_factory=dict)

    def __post_init__(self) -> None:
        #: the point of the grid of scalars from which sampling begins: the middle, until another is known to fit better
        self.middle = self.unknowns.points // 2
        self.keys = list(dict.fromkeys((curve.load, curve.temperature) for curve in self.curves))
        self.curve = np.concatenate([np.full(one.hold_times.size, k) for k, one in enumerate(self.curves)])
        self.hold_times = np.concatenate([one.hold_times for one in self.curves])
        self.values = np.concatenate([one.friction_drop for one in self.curves])
        floor = [np.full(one.hold_times.size, MODEL_ERROR * np.abs(one.friction_drop).max()) for one in self.curves]
        self.given_errors = np.concatenate([one.friction_drop_errors for one in self.curves])
        self._floor = np.concatenate(floor)
        self.which = np.array([self.keys.index((one.load, one.temperature)) for one in self.curves])[self.curve]
        self.times = [np.unique(self.hold_times[self.which == k]) for k in range(len(self.keys))]

    def condition(self, point: int, number: int) -> Condition:
        """The model of a condition at a point of the grid of scalars; made once."""
        if (point, number) not in self.conditions:
            load, temperature = self.keys[number]
            self.conditions[point, number] = make_condition(
                self.unknowns.chemistry(self.chemistry, point),
                self.contacts.at(load),
                temperature,
                self.times[number],
                self.grid,
                self.seed,
            )
            if (middle := self.conditions.get((self.middle, number))) is not None:
                made = self.conditions[point, number]
                made.correction, made.correction_error = middle.correction, middle.correction_error
        return self.conditions[point, number]

    def on(self, grid: EnergyGrid) -> Model:
        """The same model on other energies."""
        found = replace(self, grid=grid, conditions={})
        found.middle = self.middle
        for number in range(len(self.keys)):
            own, other = self.condition(self.middle, number), found.condition(self.middle, number)
            other.correction, other.correction_error = own.correction, own.correction_error
        return found

    @property
    def interacting(self) -> bool:
        """Whether bonded neighbours change the barriers."""
        return self.condition(self.middle, 0).interacting

    def _gathered(self, parts: Callable[[int], np.ndarray]) -> np.ndarray:
        """One row for each point, of arrays (hold times, ...) of each condition."""
        first = parts(0)
        found = np.empty((self.values.size, *first.shape[1:]))
        for number in range(len(self.keys)):
            here = self.which == number
            found[here] = (first if number == 0 else parts(number))[
                np.searchsorted(self.times[number], self.hold_times[here])
            ]
        return found

    def linear(self, density: np.ndarray, point: int) -> tuple[np.ndarray, np.ndarray]:
        """ΔF of every measured point at ``density`` (m,), and its derivative (m, n)."""
        made = [self.condition(point, number).linear(density) for number in range(len(self.keys))]
        return self._gathered(lambda k: made[k][0]), self._gathered(lambda k: made[k][1])

    def without_neighbours(self, point: int) -> np.ndarray:
        """(m, n): the derivative without interaction."""
        return self._gathered(lambda k: self.condition(point, k).without_neighbours())

    def calibrate(self, density: np.ndarray, threads: int | None) -> None:
        """Simulate the kinetics of every condition at ``density``; all points of the grid get the same correction."""
        middle = self.middle
        for number in range(len(self.keys)):
            made = self.condition(middle, number)
            made.calibrate(density, self.scene, self.seed, threads)
            for (_, other), one in self.conditions.items():
                if other == number:
                    one.correction, one.correction_error = made.correction, made.correction_error

    def errors(self, value: np.ndarray) -> np.ndarray:
        """(m,) standard errors of the measured values, with those of the forward model at ``value``."""
        found = self.given_errors**2 + self._floor**2
        if self.interacting:
            relative = self._gathered(lambda k: _error(self.condition(self.middle, k)))
            found = found + (relative * value) ** 2
        return np.sqrt(found)

    def labels(self) -> list[str]:
        """What each point is, in words."""
        return [
            f"{time:.3g} s of {self.curves[number].name}"
            for number, time in zip(self.curve, self.hold_times, strict=True)
        ]

    def seen(self) -> np.ndarray:
        """(n,) whether some condition has hold times before and after sites of this barrier bond."""
        found = np.zeros(self.grid.count, dtype=bool)
        for number in range(len(self.keys)):
            made = self.condition(self.middle, number)
            share = made.without_neighbours()[[0, -1]] / (made.scale * self.grid.areas)
            found |= (share[1] - share[0]) >= 0.5 * max(float(share[1].max()), 1e-12)
        return found


def _error(condition: Condition) -> np.ndarray:
    if condition.correction_error is None or condition.correction is None:
        return np.zeros(condition.hold_times.size)
    return condition.correction_error / condition.correction


def make_model(
    scene: Scene,
    chemistry: Chemistry,
    unknowns: Unknowns,
    curves: Sequence[MeasuredCurve],
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Model:
    """Solve the contacts of all loads, and choose the energies."""
    contacts = Contacts(scene)
    loads = list(dict.fromkeys(curve.load for curve in curves))
    lowering = 0.0
    bounds = unknowns.bounds
    widest = chemistry.replace(
        activation_volume=bounds.get("activation_volume", (0.0, chemistry.activation_volume))[1],
        attempt_frequency=bounds.get("attempt_frequency", (0.0, chemistry.attempt_frequency))[1],
    )
    for done, load in enumerate(loads):
        if progress:
            progress(done, len(loads))
        lowering = max(lowering, largest_lowering(contacts.at(load), widest))
    if progress:
        progress(len(loads), len(loads))
    temperatures = np.concatenate([np.full(one.hold_times.size, one.temperature) for one in curves])
    times = np.concatenate([one.hold_times for one in curves])
    grid = energy_grid(widest, temperatures, times, lowering)
    if "attempt_frequency" in bounds:  # the lowest frequency reacts at lower energies
        lower = energy_grid(
            widest.replace(attempt_frequency=bounds["attempt_frequency"][0]), temperatures, times, lowering
        )
        count = int(np.ceil((grid.nodes[-1] - lower.first) / grid.step)) + 1
        grid = EnergyGrid(lower.first, grid.step, count)
    return Model(scene, chemistry, unknowns, curves, grid, contacts, seed)
