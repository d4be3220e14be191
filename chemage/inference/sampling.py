"""Samples of the posterior: Markov chains that are continued until there are enough, and the measures of that.

A chain moves along lines for the density, by two Gibbs moves for what the prior leaves open, and by Metropolis moves
for unknown scalars.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from chemage.foundation.threads import available, in_order
from chemage.inference import kernels
from chemage.inference.noise import State
from chemage.inference.open import effective as effective_samples
from chemage.inference.open import r_hat
from chemage.inference.problem import LEVEL, Problem

#: chains, and sweeps of each before samples are kept
CHAINS, WARM = 4, 400
#: effective samples and R-hat at which sampling ends, and the most sweeps of a chain for it
ENOUGH, AGREED, MOST_SWEEPS = 300, 1.03, 4000
#: sweeps of the density for each of the errors
EVERY = 2
#: nodes by which a move of a scalar shifts the density, at most
SHIFT = 2
#: standard deviation of the integral of a density that is complete, and its largest
COMPLETE, LIMIT = 0.003, 1.02
#: sets of positive nodes that directions and choices are drawn with, at most; bytes of their tables
PATTERNS, BYTES = 8, 64e6
#: choices of the prior among which one is drawn
CANDIDATES = 24
#: densities of the warm-up whose differences serve as directions; bumps of which some are drawn for every sweep
ARCHIVE, BUMPS = 100, 2000
#: standard errors by which a combination of the measurements changes with the density (1/eV) at least, or is left out
NEGLIGIBLE = 2e-3


@dataclass(eq=False)
class _Pattern:
    """A set of positive nodes; the posterior for it is normal under every choice of the prior."""

    #: (n,) 1 where positive
    positive: np.ndarray
    #: point of the grid of scalars and logarithm of the factor at which it is tabulated
    point: int
    log_factor: float
    #: errors of the measurements for which it is tabulated
    state: State
    #: whether the density is complete -> (choices, n) means and (choices, n, n) factors of the inverse covariances
    tables: dict[bool, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


class Chain:
    """One Markov chain, which begins at ``start`` (n,)."""

    def __init__(self, problem: Problem, start: np.ndarray, rng: np.random.Generator) -> None:
        self.problem, self.rng = problem, rng
        mass = float(np.maximum(start, 0.0) @ problem.areas)
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
        choices = len(problem.prior.combinations)
        self._most_patterns = int(np.clip(BYTES / (16 * choices * start.size**2), 2, PATTERNS))
        self._last: tuple[tuple[int, float, bool], State, tuple[np.ndarray, np.ndarray]] | None = None
        self._sweep = 0
        self._reduced: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self.choice = self._drawn(np.arange(choices))

    def warm(self, sweeps: int) -> None:
        """Forget the start, and choose the directions; nothing is kept."""
        every = max(sweeps // (2 * self._most_patterns), 1)
        archive = []
        for sweep in range(sweeps):
            if sweep % every == every - 1:
                self._patterns = [*self._patterns, self._pattern()][-self._most_patterns :]
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
        self._drawn_density()
        self._drawn_complete()
        self._drawn_choice()
        self._moved_choice()
        self._sweep += 1
        if not self.noise.fixed and self._sweep % EVERY == 0:
            self._drawn_errors()
        if self.problem.unknowns.points > 1 or self.problem.unknowns.factor is not None:
            for _ in range(3):
                self._moved_scalars()

    # -- the misfit ---------------------------------------------------------------------------------------------------

    def _rotated(self, point: int) -> tuple[np.ndarray, np.ndarray]:
        """Axes (n, r) of the density that the measurements tell of, and the measurements (m, r) by them."""
        if point not in self._reduced:
            matrix = self.problem.matrices[point]
            _, size, axes = np.linalg.svd(matrix / self.problem.errors[:, None], full_matrices=False)
            axes = axes[: max(int((size > NEGLIGIBLE).sum()), 1)].T
            self._reduced[point] = axes, matrix @ axes
        return self._reduced[point]

    def _rows(self, point: int, log_factor: float, complete: bool, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (n, r) and target (r,) of the misfit; a complete density has one row more, for its integral."""
        key = point, log_factor, complete
        if self._last is None or self._last[0] != key or self._last[1] is not state:
            self._last = key, state, self._made_rows(point, log_factor, complete, state)
        return self._last[2]

    def _made_rows(self, point: int, log_factor: float, complete: bool, state: State) -> tuple[np.ndarray, np.ndarray]:
        axes, parts = self._rotated(point)
        factor = np.exp(log_factor + state.calibration)
        parts = factor * self.noise.white(state, parts)
        goal = self.noise.white(state, self.problem.values - factor * self.problem.offsets[point])
        lower = np.linalg.cholesky(parts.T @ parts + 1e-6 * np.eye(parts.shape[1]))
        matrix, target = axes @ lower, np.linalg.solve(lower, parts.T @ goal)
        if not complete:
            return np.ascontiguousarray(matrix), target
        row = self.problem.areas[:, None] / COMPLETE
        return np.ascontiguousarray(np.concatenate([matrix, row], axis=1)), np.append(target, 1 / COMPLETE)

    def _fitted(self, x: np.ndarray, point: int, log_factor: float) -> np.ndarray:
        """(m,) values of the model, before the calibration."""
        return np.exp(log_factor) * (self.problem.offsets[point] + self.problem.matrices[point] @ np.maximum(x, 0.0))

    def _misfit(self, x: np.ndarray, point: int, log_factor: float, state: State) -> float:
        """Half of χ² of all measurements; infinite where the integral of the density exceeds 1."""
        mass = float(np.maximum(x, 0.0) @ self.problem.areas)
        if mass > self._limit:
            return np.inf
        fitted = np.exp(state.calibration) * self._fitted(x, point, log_factor)
        residual = self.noise.white(state, self.problem.values - fitted)
        return 0.5 * float(residual @ residual) + (0.5 * ((mass - 1) / COMPLETE) ** 2 if self.complete else 0.0)

    @property
    def _limit(self) -> float:
        return LIMIT if self.complete else 1.0

    # -- the density --------------------------------------------------------------------------------------------------

    def _pattern(self) -> _Pattern:
        return _Pattern((self.x > 0).astype(float), self.point, self.log_factor, self.state)

    def _table(self, pattern: _Pattern) -> tuple[np.ndarray, np.ndarray]:
        """(choices, n) means and (choices, n, n) lower factors L of the inverse covariances of a pattern."""
        if self.complete not in pattern.tables:
            matrix, target = self._rows(pattern.point, pattern.log_factor, self.complete, pattern.state)
            seen = matrix * pattern.positive[:, None]
            factors = np.linalg.cholesky(self.problem.prior.precisions[0] + seen @ seen.T)
            goal = seen @ (target - LEVEL * seen.sum(axis=0))
            pattern.tables[self.complete] = LEVEL + kernels.solved_twice(factors, goal), factors
        return pattern.tables[self.complete]

    def _directions(self, count: int) -> np.ndarray:
        """(count, n): bumps of all widths, and bumps beside dips, which keep the integral; as wide as the posterior is
        in them, if the nodes that are positive were those of an earlier sample; and differences of earlier samples."""
        nodes, rng = self.problem.prior.nodes, self.rng
        others = count // 3 if self._patterns else 0
        between = count // 3 if len(self._archive) > 10 else 0
        bumps = count - others - between
        parts = [self._bumps[rng.integers(BUMPS, size=bumps)]]
        if others:
            _, factors = self._table(self._patterns[rng.integers(len(self._patterns))])
            parts.append(kernels.solved(factors[self.choice], rng.standard_normal((others, nodes.size))))
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
        bumps = np.exp(-0.5 * away**2) * np.where(rng.random((BUMPS, 1)) < 0.5, 1.0, away)
        bumps[np.abs(bumps) < 1e-6] = 0.0
        return bumps

    def _drawn_density(self) -> None:
        """Draw the process anew along as many lines as it has nodes."""
        problem = self.problem
        matrix, target = self._rows(self.point, self.log_factor, self.complete, self.state)
        directions = self._directions(self.x.size)
        inverse = problem.prior.precisions[0][self.choice]
        kernels.sweep(
            self.x,
            inverse @ (self.x - LEVEL),
            matrix,
            target,
            problem.areas,
            self._limit,
            directions,
            directions @ inverse,
            self.rng.random((len(directions), 2)),
        )

    def _drawn_complete(self) -> None:
        """Draw whether the density is complete: a normal density of its integral about 1, or any integral below 1."""
        mass = float(np.maximum(self.x, 0.0) @ self.problem.areas)
        away = (mass - 1) / COMPLETE
        odds = -0.5 * away**2 - np.log(COMPLETE * np.sqrt(2 * np.pi)) + np.log(2.0)
        self.complete = mass > 1.0 or self.rng.logistic() < odds

    # -- the prior ----------------------------------------------------------------------------------------------------

    def _candidates(self) -> np.ndarray:
        """(k,) choices drawn at random, and the present one."""
        count = len(self.problem.prior.combinations)
        drawn = self.rng.permutation(count)[: min(CANDIDATES, count)]
        if self.choice not in drawn:
            drawn[0] = self.choice
        return drawn

    def _drawn_choice(self) -> None:
        """Draw the choice of the prior at fixed x."""
        self.choice = self._drawn(self._candidates())

    def _drawn(self, candidates: np.ndarray) -> int:
        """One of the ``candidates`` (k,), by their priors of x."""
        logs = kernels.log_priors(self.x, LEVEL, candidates, *self.problem.prior.precisions)
        return int(candidates[np.argmax(logs + self.rng.gumbel(size=logs.size))])

    def _moved_choice(self) -> None:
        """Draw the choice of the prior with a density that adapts to it."""
        if not self._patterns:
            return
        means, factors = self._table(self._patterns[self.rng.integers(len(self._patterns))])
        candidates = self._candidates()
        self.choice = int(
            kernels.moved(
                self.x,
                self.choice,
                LEVEL,
                candidates,
                means,
                factors,
                *self.problem.prior.precisions,
                *self._rows(self.point, self.log_factor, self.complete, self.state),
                self.problem.areas,
                self._limit,
                self.rng.gumbel(size=candidates.size),
            )
        )

    # -- errors -------------------------------------------------------------------------------------------------------

    def _drawn_errors(self) -> None:
        """Draw the errors at fixed density, and the calibration with a density that makes up for it."""
        fitted = self._fitted(self.x, self.point, self.log_factor)
        self.state = self.noise.drawn(self.state, self.problem.values, fitted, self.rng)
        if width := self.noise.model.calibration:
            step = 0.3 * width * float(self.rng.standard_normal())
            other = replace(self.state, calibration=self.state.calibration + step)
            gain = self.noise.log_calibration(other.calibration) - self.noise.log_calibration(self.state.calibration)
            if self._scaled_density(step, self.point, self.log_factor, other, gain):
                self.state = other

    def _scaled_density(self, step: float, point: int, log_factor: float, state: State, gain: float) -> bool:
        """Scale the density by exp(−``step``) as the rest changes; ``gain`` of the prior of the rest."""
        scaled = self.x * np.exp(-step)
        gain += self._misfit(self.x, self.point, self.log_factor, self.state)
        gain += self._log_prior(scaled) - self._log_prior(self.x) - self.x.size * step
        taken = bool(np.log(self.rng.random()) < gain - self._misfit(scaled, point, log_factor, state))
        if taken:
            self.x = scaled
        return taken

    # -- unknown scalars ----------------------------------------------------------------------------------------------

    def _moved_scalars(self) -> None:
        """Move along the grid of scalars, with the density shifted by whole nodes, and the common factor with it."""
        unknowns, rng = self.problem.unknowns, self.rng
        if unknowns.neighbours.shape[1]:
            other = int(unknowns.neighbours[self.point, rng.integers(unknowns.neighbours.shape[1])])
            shifted = np.roll(self.x, int(rng.integers(-SHIFT, SHIFT + 1)))
            gain = self._log_prior(shifted) - self._log_prior(self.x)
            gain += float(unknowns.log_priors[other] - unknowns.log_priors[self.point])
            gain += self._misfit(self.x, self.point, self.log_factor, self.state)
            gain -= self._misfit(shifted, other, self.log_factor, self.state)
            if other != self.point and np.log(rng.random()) < gain:
                self.x, self.point = shifted, other
        if unknowns.factor is not None:
            step = 0.15 * float(rng.standard_normal())
            factor = self.log_factor + step
            if unknowns.factor[0] <= factor <= unknowns.factor[1]:
                # the density falls as the factor rises, or stays
                falls = rng.random() < 0.5
                if self._scaled_density(step if falls else 0.0, self.point, factor, self.state, 0.0):
                    self.log_factor = factor

    def _log_prior(self, x: np.ndarray) -> float:
        choice = np.array([self.choice])
        return float(kernels.log_priors(x, LEVEL, choice, *self.problem.prior.precisions)[0])


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
    def off(self) -> np.ndarray:
        """(m,) share of the samples in which a point is off."""
        return np.mean([state.inflation > 1 for state in self.states], axis=0)

    @property
    def typical(self) -> State:
        """The typical errors: points weigh by the mean of their precision."""
        precision = np.mean([state.inflation**-2.0 for state in self.states], axis=0)
        time, calibration = (
            float(np.mean([getattr(state, name) for state in self.states])) for name in ("log_time", "calibration")
        )
        return State(np.exp(np.log(self.scales).mean(axis=0)), precision**-0.5, time, calibration)

    def fitted(self, problem: Problem) -> np.ndarray:
        """(S, m) values of each sample, before the calibration."""
        values = (
            problem.offsets[self.points]
            + np.einsum("smn,sn->sm", problem.matrices[self.points], self.densities, optimize=False)
            if len(problem.matrices) > 1
            else problem.offsets[0] + self.densities @ problem.matrices[0].T
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
    chains = [Chain(problem, start, np.random.default_rng([seed, number, 41])) for number in range(CHAINS)]
    workers = min(threads or available(), CHAINS)
    warm = min(WARM, sweeps)
    total, done, more = warm + sweeps, 0, min(2 * each, max(sweeps, each))
    list(in_order(lambda number: chains[number].warm(warm), CHAINS, workers, None))
    while True:
        if progress:
            progress(warm + done, total)
        more = min(more, sweeps - done) if done else more
        list(in_order(lambda number, more=more: chains[number].run(more), CHAINS, workers, None))
        done += more
        kept = np.linspace(0, done - 1, each).round().astype(int)
        every = np.stack([np.array(chain.densities) for chain in chains])
        effective, ratio = convergence(every[:, :, watched] if watched.any() else every)
        if not problem.likelihood.fixed:
            errors = np.array(
                [[[*np.log(state.scales), state.calibration] for state in chain.states] for chain in chains]
            )
            for column in range(errors.shape[2]):
                own = convergence(errors[:, :, column : column + 1])
                effective, ratio = min(effective, own[0]), max(ratio, own[1])
        if (effective >= ENOUGH and ratio <= AGREED) or done >= sweeps:
            break
        more = done
    effective = min(effective, float(CHAINS * each))
    if progress:
        progress(total, total)
    points = np.concatenate([np.array(chain.points)[kept] for chain in chains])
    factors = np.concatenate([np.array(chain.factors)[kept] for chain in chains])
    states = [chain.states[number] for chain in chains for number in kept]
    return Samples(every[:, kept].reshape(CHAINS * each, -1), points, factors, states, effective, ratio, done)


def convergence(chains: np.ndarray) -> tuple[float, float]:
    """Least effective number of samples and largest R-hat over the columns of ``chains`` (chains, S, n)."""
    within = chains.var(axis=1, ddof=1).mean(axis=0)
    # where the density hardly ever differs from zero, a single bump would decide
    moving = np.flatnonzero(within > max(1e-12, 0.01 * float(within.max())))
    if not moving.size:
        return float(chains.shape[0] * chains.shape[1]), 1.0
    numbers = [(effective_samples(chains[:, :, column]), r_hat(chains[:, :, column])) for column in moving]
    return min(ess for ess, _ in numbers), max(ratio for _, ratio in numbers)
