"""Samples of the posterior: Markov chains that are continued until there are enough, and the measures of that.

A chain moves along lines for the density, by a Gibbs move for what the prior leaves open, and by Metropolis moves for
unknown scalars.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from chemage.plugin import algebra
from chemage.plugin import threads as processors
from chemage_inference import kernels
from chemage_inference.noise import State
from chemage_inference.open import effective as effective_samples
from chemage_inference.open import r_hat
from chemage_inference.problem import LEVEL, Problem

#: chains, and sweeps of each before samples are kept
CHAINS, WARM = 4, 400
#: effective samples and R-hat at which sampling ends, and the most sweeps of a chain for it
ENOUGH, AGREED, MOST_SWEEPS = 250, 1.03, 4000
#: sweeps of the density for each of the errors, and moves of the calibrations then
EVERY, CALIBRATIONS = 2, 4
#: nodes by which a move of a scalar shifts the density, at most
SHIFT = 2
#: steps along the grid of scalars at once
STEPS = 1, 1, 2, 4
#: standard deviation of the integral of a density that is complete, and its largest
COMPLETE, LIMIT = 0.003, 1.02
#: passes over the density in a sweep
PASSES = 3
#: sets of positive nodes that directions are drawn with, at most
PATTERNS = 8
#: choices of the prior among which one is drawn
CANDIDATES = 5
#: densities of the warm-up whose differences serve as directions; bumps of which some are drawn for every sweep
ARCHIVE, BUMPS = 100, 2000
#: derivatives of a bump that serve as directions, from the 0th
ORDERS = 5
#: standard errors by which a combination of the measurements changes with the density (1/eV) at least, or is left out
NEGLIGIBLE = 2e-3


class ChainPosition(NamedTuple):
    """Where a chain is, but for its density."""

    #: of the grid of scalars
    point: int
    #: logarithm of the common factor
    log_factor: float
    #: the errors of the measurements
    state: State


@dataclass(eq=False)
class _Pattern:
    """A set of positive nodes; the posterior for it is nearly normal under every choice of the prior."""

    #: (n,) 1 where positive
    positive: np.ndarray
    #: where it is tabulated
    place: ChainPosition
    #: choice, and whether the density is complete -> (n, n) lower factor of the inverse covariance
    factors: dict[tuple[int, bool], np.ndarray] = field(default_factory=dict)
    #: these, and the points of a factor -> (n,) answer to it, see :meth:`Chain._answer`
    answers: dict[tuple[int, bool, bytes], np.ndarray] = field(default_factory=dict)


class Chain:
    """One Markov chain, which begins at ``start`` (n,)."""

    def __init__(
        self, problem: Problem, start: np.ndarray, rng: np.random.Generator
    ) -> None:
        self.problem, self.rng = problem, rng
        self.noise = problem.noise
        self.x = np.ascontiguousarray(
            start * min(1.0, 0.999 / max(self._mass(start), 1e-12))
        )
        self.place = ChainPosition(
            problem.start, 0.0, problem.state or self.noise.start
        )
        # whether no barrier lies above the last energy, so that the integral of the density is 1
        self.complete = False
        #: from the end of the warm-up on: (sweeps, n) densities, and places
        self.densities: list[np.ndarray] = []
        self.places: list[ChainPosition] = []
        self._archive = np.zeros((0, start.size))
        self._patterns: list[_Pattern] = []
        self._last: Any = None, None
        self._sweep = 0
        self._reduced: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        every = np.arange(len(problem.prior.combinations))
        logs = self._log_priors(self.x, every)
        self.choice = int(np.argmax(logs + rng.gumbel(size=logs.size)))

    def warm(self, sweeps: int) -> None:
        """Forget the start, and choose the directions; nothing is kept."""
        every = max(sweeps // (2 * PATTERNS), 1)
        archive = []
        for sweep in range(sweeps):
            if sweep % every == every - 1:
                pattern = _Pattern((self.x > 0).astype(float), self.place)
                self._patterns = [*self._patterns, pattern][-PATTERNS:]
            if sweep == sweeps // 2:
                self._archive = np.array(archive)
            self.step()
            if sweep >= sweeps // 4:
                archive.append(self.x.copy())
        self._archive = np.array(archive)[:: max(len(archive) // ARCHIVE, 1)]

    def run(self, sweeps: int) -> None:
        """Make and keep more sweeps."""
        for _ in range(sweeps):
            self.step()
            self.densities.append(np.maximum(self.x, 0.0))
            self.places.append(self.place)

    def step(self) -> None:
        """One sweep over all unknowns."""
        for _ in range(PASSES):
            self._drawn_density()
            self._drawn_complete()
        self._drawn_choice()
        self._sweep += 1
        if not self.noise.fixed and self._sweep % EVERY == 0:
            self._drawn_errors()
        if self.problem.unknowns.points > 1 or self.problem.unknowns.factor is not None:
            for _ in range(6):
                self._moved_scalars()

    # -- the misfit ---------------------------------------------------------------------------------------------------

    def _rotated(self, point: int) -> tuple[np.ndarray, np.ndarray]:
        """Axes (n, r) of the density that the measurements tell of, and the measurements (m, r) by them."""
        if point not in self._reduced:
            matrix = self.problem.matrices[point]
            axes = algebra.row_axes(matrix / self.problem.errors[:, None], NEGLIGIBLE).T
            self._reduced[point] = axes, algebra.product(matrix, axes)
        return self._reduced[point]

    def _rows(
        self, place: ChainPosition, complete: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (n, r) and target (r,) of the misfit; a complete density has one row more, for its integral."""
        key = place, complete
        if self._last[0] != key:
            self._last = key, self._made_rows(place, complete)
        return self._last[1]

    def _made_rows(
        self, place: ChainPosition, complete: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        axes, _ = self._rotated(place.point)
        parts, factor = self._slopes(place)
        offsets = self.problem.offsets[place.point]
        goal = self.noise.white(place.state, self.problem.values - factor * offsets)
        lower = algebra.cholesky(
            algebra.product(parts.T, parts) + 1e-6 * np.eye(parts.shape[1])
        )
        matrix = algebra.product(axes, lower)
        target = algebra.forward(lower, algebra.product(parts.T, goal[:, None]))[:, 0]
        if complete:
            row = self.problem.areas[:, None] / COMPLETE
            matrix = np.concatenate([matrix, row], axis=1)
            target = np.append(target, 1 / COMPLETE)
        return np.ascontiguousarray(matrix), target

    def _slopes(self, place: ChainPosition) -> tuple[np.ndarray, np.ndarray]:
        """(m, r) change of the measurements by the axes, in standard errors, and (m,) their factor."""
        _, parts = self._rotated(place.point)
        factor = np.exp(place.log_factor) * self.noise.factor(place.state)
        return self.noise.white(place.state, factor[:, None] * parts), factor

    def _mass(self, x: np.ndarray) -> float:
        return float(algebra.product(np.maximum(x, 0.0), self.problem.areas))

    def _fitted(self, x: np.ndarray, place: ChainPosition) -> np.ndarray:
        """(m,) values of the model, before the calibration."""
        matrix = self.problem.matrices[place.point]
        return np.exp(place.log_factor) * (
            self.problem.offsets[place.point]
            + algebra.product(matrix, np.maximum(x, 0.0))
        )

    def _misfit(self, x: np.ndarray, place: ChainPosition) -> float:
        """Half of χ² of all measurements; infinite where the integral of the density exceeds 1."""
        mass = self._mass(x)
        if mass > self._limit:
            return np.inf
        fitted = self.noise.factor(place.state) * self._fitted(x, place)
        residual = self.noise.white(place.state, self.problem.values - fitted)
        misfit = 0.5 * float(algebra.product(residual, residual))
        return misfit + 0.5 * ((mass - 1) / COMPLETE) ** 2 * self.complete

    @property
    def _limit(self) -> float:
        return LIMIT if self.complete else 1.0

    # -- the density --------------------------------------------------------------------------------------------------

    def _factor(self, pattern: _Pattern) -> np.ndarray:
        """(n, n) lower factor L of the inverse covariance of a pattern, under the present choice of the prior."""
        key = self.choice, self.complete
        if key not in pattern.factors:
            matrix, _ = self._rows(pattern.place, self.complete)
            seen = matrix * pattern.positive[:, None]
            pattern.factors[key] = algebra.cholesky(
                self.problem.prior.precisions[0][self.choice]
                + algebra.product(seen, seen.T)
            )
        return pattern.factors[key]

    def _directions(self, count: int) -> np.ndarray:
        """(count, n): bumps of all widths, and their derivatives, which keep the integral, the mean and so on; as wide
        as the posterior is in them, if the nodes that are positive were those of an earlier sample; and differences of
        earlier samples."""
        nodes, rng = self.problem.prior.nodes, self.rng
        others = count // 3 if self._patterns else 0
        between = count // 3 if len(self._archive) > 10 else 0
        bumps = count - others - between
        parts = [self._bumps[rng.integers(BUMPS, size=bumps)]]
        if others:
            factor = self._factor(self._patterns[rng.integers(len(self._patterns))])
            parts.append(
                kernels.solved(factor, rng.standard_normal((others, nodes.size)))
            )
        if between:
            pairs = rng.integers(len(self._archive), size=(between, 2))
            parts.append(self._archive[pairs[:, 0]] - self._archive[pairs[:, 1]])
        return np.ascontiguousarray(np.concatenate(parts))

    @cached_property
    def _bumps(self) -> np.ndarray:
        """(BUMPS, n)."""
        nodes, rng = self.problem.prior.nodes, self.rng
        step = nodes[1] - nodes[0]
        centre = rng.uniform(nodes[0] - step, nodes[-1] + step, (BUMPS, 1))
        width = np.exp(rng.uniform(np.log(0.3 * step), np.log(0.5), (BUMPS, 1)))
        away = (nodes - centre) / width
        # Hermite functions, the derivatives of a bump
        order = rng.integers(ORDERS, size=(BUMPS, 1))
        bumps = np.exp(-0.5 * away**2) * np.choose(
            order,
            (
                np.ones_like(away),
                away,
                away**2 - 1,
                away**3 - 3 * away,
                away**4 - 6 * away**2 + 3,
            ),
        )
        bumps[np.abs(bumps) < 1e-6] = 0.0
        return bumps

    def _drawn_density(self) -> None:
        """Draw the process anew along as many lines as it has nodes."""
        problem = self.problem
        matrix, target = self._rows(self.place, self.complete)
        directions = self._directions(self.x.size)
        inverse = problem.prior.precisions[0][self.choice]
        kernels.sweep(
            self.x,
            algebra.product(inverse, self.x - LEVEL),
            matrix,
            target,
            problem.areas,
            self._limit,
            directions,
            algebra.products(directions, inverse),
            self.rng.random((len(directions), 2)),
        )

    def _drawn_complete(self) -> None:
        """Draw whether the density is complete: a normal density of its integral about 1, or any integral below 1."""
        mass = self._mass(self.x)
        away = (mass - 1) / COMPLETE
        odds = -0.5 * away**2 - np.log(COMPLETE * np.sqrt(2 * np.pi)) + np.log(2.0)
        self.complete = mass > 1.0 or self.rng.logistic() < odds

    # -- the prior ----------------------------------------------------------------------------------------------------

    def _drawn_choice(self) -> None:
        """Draw the choice of the prior with a density that adapts to it."""
        count = len(self.problem.prior.combinations)
        candidates = self.rng.permutation(count)[: min(CANDIDATES, count)]
        self.choice = int(
            kernels.moved(
                self.x,
                self.choice,
                LEVEL,
                candidates,
                *self.problem.prior.precisions,
                *self._rows(self.place, self.complete),
                self.problem.areas,
                self._limit,
                self.rng.gumbel(size=candidates.size + 1),
            )
        )

    # -- errors -------------------------------------------------------------------------------------------------------

    def _drawn_errors(self) -> None:
        """Draw the errors at fixed density, and the calibration with a density that makes up for it."""
        fitted = self._fitted(self.x, self.place)
        state = self.noise.drawn(
            self.place.state, self.problem.values, fitted, self.rng
        )
        self.place = self.place._replace(state=state)
        if not self.noise.model.calibration:
            return
        each = np.eye(state.calibration.size, dtype=bool)
        # each instrument alone, and all together
        chosen = [*each, each.any(axis=0)] if len(each) > 1 else each
        for here in CALIBRATIONS * list(chosen):
            step = self._step(self.noise.model.calibration)
            before = self.place.state.calibration
            after = before + step * here
            gain = self.noise.log_calibrations(after)
            gain = gain - self.noise.log_calibrations(before)
            state = replace(self.place.state, calibration=after)
            x = self.x + step * self._answer(here[self.noise.instrument])
            self._move(x, self.place._replace(state=state), float(gain.sum()))

    def _step(self, width: float) -> float:
        """A step of the logarithm of a factor, small or as large as its ``width``."""
        return width * float(
            self.rng.choice([0.1, 0.3, 1.0]) * self.rng.standard_normal()
        )

    def _answer(self, here: np.ndarray) -> np.ndarray:
        """(n,) how the density answers to a larger logarithm of the factor of the points ``here`` (m,).

        It is the change of the most probable density of an earlier set of positive nodes, where the model fits, and
        does not depend on the present density, so that a move by it is reversible.
        """
        if not self._patterns:
            return np.zeros(self.x.size)
        pattern = self._patterns[self.rng.integers(len(self._patterns))]
        key = self.choice, self.complete, here.tobytes()
        if key not in pattern.answers:
            axes, _ = self._rotated(pattern.place.point)
            slope, _ = self._slopes(pattern.place)
            values = np.where(here, self.problem.values, 0.0)
            white = self.noise.white(pattern.place.state, values)
            pull = algebra.product(axes, algebra.product(slope.T, white))
            factor = self._factor(pattern)
            half = algebra.forward(factor, (pattern.positive * pull)[:, None])
            pattern.answers[key] = -kernels.solved(factor, half.T)[0]
        return pattern.answers[key]

    def _move(self, x: np.ndarray, place: ChainPosition, gain: float) -> None:
        """Move to the density ``x`` (n,) and ``place``, or stay; ``gain`` is that of the prior of the place."""
        gain += self._misfit(self.x, self.place)
        after, before = (
            float(self._log_priors(one, np.array([self.choice]))[0])
            for one in (x, self.x)
        )
        gain += after - before
        if np.log(self.rng.random()) < gain - self._misfit(x, place):
            self.x, self.place = x, place

    # -- unknown scalars ----------------------------------------------------------------------------------------------

    def _moved_scalars(self) -> None:
        """Move along the grid of scalars, with the density shifted by whole nodes, and the common factor with it."""
        unknowns, rng, point = self.problem.unknowns, self.rng, self.place.point
        everywhere = np.ones(self.problem.values.size, dtype=bool)
        if unknowns.axes:
            steps = int(rng.choice([-1, 1]) * rng.choice(STEPS))
            axis = int(rng.integers(len(unknowns.axes)))
            other = unknowns.moved(point, axis, steps)
            if other is not None:
                # sites react at other energies, or more of them everywhere
                if rng.random() < 0.5:
                    x = np.roll(self.x, int(rng.integers(-SHIFT, SHIFT + 1)))
                else:
                    rise = self._levels[other] - self._levels[point]
                    x = self.x + rise * self._answer(everywhere)
                gain = unknowns.log_priors[other] - unknowns.log_priors[point]
                self._move(x, self.place._replace(point=other), float(gain))
        if unknowns.factor is not None:
            low, high = unknowns.factor
            step = self._step(0.5)
            factor = self.place.log_factor + step
            if low <= factor <= high:
                # the density falls as the factor rises, or stays
                fall = step * self._answer(everywhere) * (rng.random() < 0.7)
                self._move(self.x + fall, self.place._replace(log_factor=factor), 0.0)

    @cached_property
    def _levels(self) -> np.ndarray:
        """(g,) logarithms of the sum of all values under a uniform density, at each point of the grid."""
        return np.log(np.maximum(self.problem.matrices.sum(axis=(1, 2)), 1e-300))

    def _log_priors(self, x: np.ndarray, choices: np.ndarray) -> np.ndarray:
        return kernels.log_priors(x, LEVEL, choices, *self.problem.prior.precisions)


@dataclass(frozen=True, eq=False)
class Samples:
    """What sampling gives."""

    #: (S, n) densities, and where they were
    densities: np.ndarray
    places: list[ChainPosition]
    #: least effective number of samples and largest R-hat over the nodes watched, and sweeps of each chain
    effective: float
    r_hat: float
    sweeps: int

    @cached_property
    def points(self) -> np.ndarray:
        """(S,) of the grid of scalars."""
        return np.array([place.point for place in self.places])

    @cached_property
    def factors(self) -> np.ndarray:
        """(S,) common factors."""
        return np.array([float(np.exp(place.log_factor)) for place in self.places])

    @property
    def states(self) -> list[State]:
        """(S,) errors."""
        return [place.state for place in self.places]

    @property
    def scales(self) -> np.ndarray:
        """(S, curves) of the stated errors."""
        return np.stack([state.scales for state in self.states])

    @property
    def calibrations(self) -> np.ndarray:
        """(S, instruments) measured over true value."""
        return np.exp([state.calibration for state in self.states])

    @property
    def off(self) -> np.ndarray:
        """(m,) share of the samples in which a point is off."""
        return np.mean([state.inflation > 1 for state in self.states], axis=0)

    @property
    def typical(self) -> State:
        """The typical errors: points weigh by the mean of their precision."""
        precision = np.mean([state.inflation**-2.0 for state in self.states], axis=0)
        time = float(np.mean([state.log_time for state in self.states]))
        scales, calibration = (
            np.log(factors).mean(axis=0) for factors in (self.scales, self.calibrations)
        )
        return State(np.exp(scales), precision**-0.5, calibration, time)

    def fitted(self, problem: Problem) -> np.ndarray:
        """(S, m) values of each sample, before the calibration."""
        if len(problem.matrices) == 1:
            values = algebra.product(self.densities, problem.matrices[0].T)
        else:
            matrices = problem.matrices[self.points]
            values = np.einsum("smn,sn->sm", matrices, self.densities, optimize=False)
        return self.factors[:, None] * (problem.offsets[self.points] + values)


def sample(
    problem: Problem,
    start: np.ndarray,
    *,
    samples: int,
    seed: int,
    watched: np.ndarray | None = None,
    sweeps: int = MOST_SWEEPS,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Samples:
    """At least ``samples`` samples of the posterior from chains that begin near ``start`` (n,).

    The chains are continued until the ``watched`` nodes (n,) have :data:`ENOUGH` effective samples and agree, or
    each has made ``sweeps`` sweeps; of the sweeps, evenly spaced ones are kept.
    """
    each = -(-samples // CHAINS)
    watched = np.ones(start.size, dtype=bool) if watched is None else watched
    chains = [
        Chain(problem, start, np.random.default_rng([seed, number, 41]))
        for number in range(CHAINS)
    ]
    workers = min(threads or processors.available(), CHAINS)
    warm = min(WARM, sweeps)
    total, done, more = warm + sweeps, 0, min(2 * each, max(sweeps, each))
    processors.in_order(lambda number: chains[number].warm(warm), CHAINS, workers, None)
    while True:
        if progress:
            progress(warm + done, total)
        processors.in_order(
            lambda number, more=more: chains[number].run(more), CHAINS, workers, None
        )
        done += more
        densities = np.stack([np.array(chain.densities) for chain in chains])
        found = [convergence(densities[:, :, watched] if watched.any() else densities)]
        if not problem.noise.fixed:
            errors = np.array(
                [[_errors(at) for at in chain.places] for chain in chains]
            )
            columns = np.split(errors, errors.shape[2], axis=2)
            found += [convergence(column) for column in columns]
        effective, ratio = min(ess for ess, _ in found), max(off for _, off in found)
        if (effective >= ENOUGH and ratio <= AGREED) or done >= sweeps:
            break
        more = min(done // 2, sweeps - done)
    if progress:
        progress(total, total)
    kept = np.linspace(0, done - 1, each).round().astype(int)
    places = [chain.places[number] for chain in chains for number in kept]
    size = CHAINS * each
    densities = densities[:, kept].reshape(size, -1)
    return Samples(densities, places, min(effective, float(size)), ratio, done)


def _errors(place: ChainPosition) -> list[float]:
    return [*np.log(place.state.scales), *place.state.calibration]


def convergence(chains: np.ndarray) -> tuple[float, float]:
    """Least effective number of samples and largest R-hat over the columns of ``chains`` (chains, S, n)."""
    within = chains.var(axis=1, ddof=1).mean(axis=0)
    # where the density hardly ever differs from zero, a single bump would decide
    moving = np.flatnonzero(within > max(1e-12, 0.01 * float(within.max())))
    if not moving.size:
        return float(chains.shape[0] * chains.shape[1]), 1.0
    numbers = [
        (effective_samples(chains[:, :, column]), r_hat(chains[:, :, column]))
        for column in moving
    ]
    return min(ess for ess, _ in numbers), max(ratio for _, ratio in numbers)
