"""Samples of the posterior: Markov chains that are continued until there are enough, and the measures of that.

A chain moves along lines for the density, by a Gibbs move for what the prior leaves open, and by Metropolis moves for
unknown scalars.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

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


@dataclass(eq=False)
class _Pattern:
    """A set of positive nodes; the posterior for it is nearly normal under every choice of the prior."""

    #: (n,) 1 where positive
    positive: np.ndarray
    #: point of the grid of scalars and logarithm of the factor at which it is tabulated
    point: int
    log_factor: float
    #: errors of the measurements for which it is tabulated
    state: State
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
        mass = float(algebra.product(np.maximum(start, 0.0), problem.areas))
        self.x = np.ascontiguousarray(start * min(1.0, 0.999 / max(mass, 1e-12)))
        self.point, self.log_factor = problem.start, 0.0
        self.noise = problem.likelihood
        self.state = problem.state or self.noise.start
        # whether no barrier lies above the last energy, so that the integral of the density is 1
        self.complete = False
        #: (sweeps, n) densities, points of the grid of scalars and factors, from the end of the warm-up on
        self.densities: list[np.ndarray] = []
        self.points: list[int] = []
        self.factors: list[float] = []
        self.states: list[State] = []
        self._archive: np.ndarray = np.zeros((0, start.size))
        self._patterns: list[_Pattern] = []
        self._last: (
            tuple[tuple[int, float, bool], State, tuple[np.ndarray, np.ndarray]] | None
        ) = None
        self._sweep = 0
        self._reduced: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        logs = kernels.log_priors(
            self.x,
            LEVEL,
            np.arange(len(problem.prior.combinations)),
            *problem.prior.precisions,
        )
        self.choice = int(np.argmax(logs + rng.gumbel(size=logs.size)))

    def warm(self, sweeps: int) -> None:
        """Forget the start, and choose the directions; nothing is kept."""
        every = max(sweeps // (2 * PATTERNS), 1)
        archive = []
        for sweep in range(sweeps):
            if sweep % every == every - 1:
                self._patterns = [*self._patterns, self._pattern()][-PATTERNS:]
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
            self.points.append(self.point)
            self.factors.append(float(np.exp(self.log_factor)))
            self.states.append(self.state)

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
        self, point: int, log_factor: float, complete: bool, state: State
    ) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (n, r) and target (r,) of the misfit; a complete density has one row more, for its integral."""
        key = point, log_factor, complete
        if self._last is None or self._last[0] != key or self._last[1] is not state:
            self._last = key, state, self._made_rows(point, log_factor, complete, state)
        return self._last[2]

    def _made_rows(
        self, point: int, log_factor: float, complete: bool, state: State
    ) -> tuple[np.ndarray, np.ndarray]:
        axes, parts = self._rotated(point)
        factor = np.exp(log_factor) * self.noise.factor(state)
        parts = self.noise.white(state, factor[:, None] * parts)
        goal = self.noise.white(
            state, self.problem.values - factor * self.problem.offsets[point]
        )
        lower = algebra.cholesky(
            algebra.product(parts.T, parts) + 1e-6 * np.eye(parts.shape[1])
        )
        matrix = algebra.product(axes, lower)
        target = algebra.forward(lower, algebra.product(parts.T, goal[:, None]))[:, 0]
        if not complete:
            return np.ascontiguousarray(matrix), target
        row = self.problem.areas[:, None] / COMPLETE
        return np.ascontiguousarray(np.concatenate([matrix, row], axis=1)), np.append(
            target, 1 / COMPLETE
        )

    def _fitted(self, x: np.ndarray, point: int, log_factor: float) -> np.ndarray:
        """(m,) values of the model, before the calibration."""
        return np.exp(log_factor) * (
            self.problem.offsets[point]
            + algebra.product(self.problem.matrices[point], np.maximum(x, 0.0))
        )

    def _misfit(
        self, x: np.ndarray, point: int, log_factor: float, state: State
    ) -> float:
        """Half of χ² of all measurements; infinite where the integral of the density exceeds 1."""
        mass = float(algebra.product(np.maximum(x, 0.0), self.problem.areas))
        if mass > self._limit:
            return np.inf
        fitted = self.noise.factor(state) * self._fitted(x, point, log_factor)
        residual = self.noise.white(state, self.problem.values - fitted)
        return 0.5 * float(algebra.product(residual, residual)) + (
            0.5 * ((mass - 1) / COMPLETE) ** 2 if self.complete else 0.0
        )

    @property
    def _limit(self) -> float:
        return LIMIT if self.complete else 1.0

    # -- the density --------------------------------------------------------------------------------------------------

    def _pattern(self) -> _Pattern:
        return _Pattern(
            (self.x > 0).astype(float), self.point, self.log_factor, self.state
        )

    def _factor(self, pattern: _Pattern) -> np.ndarray:
        """(n, n) lower factor L of the inverse covariance of a pattern, under the present choice of the prior."""
        key = self.choice, self.complete
        if key not in pattern.factors:
            matrix, _ = self._rows(
                pattern.point, pattern.log_factor, self.complete, pattern.state
            )
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
        matrix, target = self._rows(
            self.point, self.log_factor, self.complete, self.state
        )
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
        mass = float(algebra.product(np.maximum(self.x, 0.0), self.problem.areas))
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
                *self._rows(self.point, self.log_factor, self.complete, self.state),
                self.problem.areas,
                self._limit,
                self.rng.gumbel(size=candidates.size + 1),
            )
        )

    # -- errors -------------------------------------------------------------------------------------------------------

    def _drawn_errors(self) -> None:
        """Draw the errors at fixed density, and the calibration with a density that makes up for it."""
        fitted = self._fitted(self.x, self.point, self.log_factor)
        self.state = self.noise.drawn(self.state, self.problem.values, fitted, self.rng)
        if not self.noise.model.calibration:
            return
        count = self.state.calibration.size
        # each instrument alone, and all together
        for here in CALIBRATIONS * (
            *np.eye(count, dtype=bool),
            *np.ones((int(count > 1), count), dtype=bool),
        ):
            step = self._step(self.noise.model.calibration)
            other = replace(
                self.state, calibration=self.state.calibration + step * here
            )
            gain = self.noise.log_calibrations(
                other.calibration
            ) - self.noise.log_calibrations(self.state.calibration)
            x = self.x + step * self._answer(here[self.noise.instrument])
            if self._moved(x, self.point, self.log_factor, other, float(gain.sum())):
                self.state = other

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
            axes, parts = self._rotated(pattern.point)
            factor = np.exp(pattern.log_factor) * self.noise.factor(pattern.state)
            slope = self.noise.white(pattern.state, factor[:, None] * parts)
            pull = algebra.product(
                axes,
                algebra.product(
                    slope.T,
                    self.noise.white(
                        pattern.state, np.where(here, self.problem.values, 0.0)
                    ),
                ),
            )
            factor = self._factor(pattern)
            half = algebra.forward(factor, (pattern.positive * pull)[:, None])
            pattern.answers[key] = -kernels.solved(factor, half.T)[0]
        return pattern.answers[key]

    def _moved(
        self, x: np.ndarray, point: int, log_factor: float, state: State, gain: float
    ) -> bool:
        """Move the density to ``x`` (n,) as the rest changes; ``gain`` of the prior of the rest."""
        gain += self._misfit(self.x, self.point, self.log_factor, self.state)
        gain += self._log_prior(x) - self._log_prior(self.x)
        taken = bool(
            np.log(self.rng.random()) < gain - self._misfit(x, point, log_factor, state)
        )
        if taken:
            self.x = x
        return taken

    # -- unknown scalars ----------------------------------------------------------------------------------------------

    def _moved_scalars(self) -> None:
        """Move along the grid of scalars, with the density shifted by whole nodes, and the common factor with it."""
        unknowns, rng = self.problem.unknowns, self.rng
        if unknowns.axes:
            steps = int(rng.choice([-1, 1]) * rng.choice(STEPS))
            other = unknowns.moved(
                self.point, int(rng.integers(len(unknowns.axes))), steps
            )
            if other is not None:
                if (
                    rng.random() < 0.5
                ):  # sites react at other energies, or more of them everywhere
                    x = np.roll(self.x, int(rng.integers(-SHIFT, SHIFT + 1)))
                else:
                    x = self.x + (
                        self._levels[other] - self._levels[self.point]
                    ) * self._answer(self._everywhere)
                gain = float(
                    unknowns.log_priors[other] - unknowns.log_priors[self.point]
                )
                if self._moved(x, other, self.log_factor, self.state, gain):
                    self.point = other
        if unknowns.factor is not None:
            step = self._step(0.5)
            factor = self.log_factor + step
            if unknowns.factor[0] <= factor <= unknowns.factor[1]:
                # the density falls as the factor rises, or stays
                x = self.x + step * self._answer(self._everywhere) * (
                    rng.random() < 0.7
                )
                if self._moved(x, self.point, factor, self.state, 0.0):
                    self.log_factor = factor

    @cached_property
    def _everywhere(self) -> np.ndarray:
        """(m,) all points."""
        return np.ones(self.problem.values.size, dtype=bool)

    @cached_property
    def _levels(self) -> np.ndarray:
        """(g,) logarithms of the sum of all values under a uniform density, at each point of the grid."""
        return np.log(np.maximum(self.problem.matrices.sum(axis=(1, 2)), 1e-300))

    def _log_prior(self, x: np.ndarray) -> float:
        choice = np.array([self.choice])
        return float(
            kernels.log_priors(x, LEVEL, choice, *self.problem.prior.precisions)[0]
        )


@dataclass(frozen=True, eq=False)
class Samples:
    """What sampling gives."""

    #: (S, n) densities, (S,) points of the grid of scalars, (S,) factors
    densities: np.ndarray
    points: np.ndarray
    factors: np.ndarray
    #: (S,) errors
    states: list[State]
    #: least effective number of samples and largest R-hat over the nodes watched, and sweeps of each chain
    effective: float
    r_hat: float
    sweeps: int

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
        calibration = np.log(self.calibrations).mean(axis=0)
        return State(
            np.exp(np.log(self.scales).mean(axis=0)), precision**-0.5, calibration, time
        )

    def fitted(self, problem: Problem) -> np.ndarray:
        """(S, m) values of each sample, before the calibration."""
        values = (
            problem.offsets[self.points]
            + np.einsum(
                "smn,sn->sm",
                problem.matrices[self.points],
                self.densities,
                optimize=False,
            )
            if len(problem.matrices) > 1
            else problem.offsets[0]
            + algebra.product(self.densities, problem.matrices[0].T)
        )
        return self.factors[:, None] * values


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
        more = min(more, sweeps - done) if done else more
        processors.in_order(
            lambda number, more=more: chains[number].run(more), CHAINS, workers, None
        )
        done += more
        kept = np.linspace(0, done - 1, each).round().astype(int)
        every = np.stack([np.array(chain.densities) for chain in chains])
        effective, ratio = convergence(every[:, :, watched] if watched.any() else every)
        if not problem.likelihood.fixed:
            errors = np.array(
                [
                    [
                        [*np.log(state.scales), *state.calibration]
                        for state in chain.states
                    ]
                    for chain in chains
                ]
            )
            for column in range(errors.shape[2]):
                own = convergence(errors[:, :, column : column + 1])
                effective, ratio = min(effective, own[0]), max(ratio, own[1])
        if (effective >= ENOUGH and ratio <= AGREED) or done >= sweeps:
            break
        more = done // 2
    effective = min(effective, float(CHAINS * each))
    if progress:
        progress(total, total)
    points = np.concatenate([np.array(chain.points)[kept] for chain in chains])
    factors = np.concatenate([np.array(chain.factors)[kept] for chain in chains])
    states = [chain.states[number] for chain in chains for number in kept]
    return Samples(
        every[:, kept].reshape(CHAINS * each, -1),
        points,
        factors,
        states,
        effective,
        ratio,
        done,
    )


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
