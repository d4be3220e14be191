"""A Markov chain of the posterior: along lines for the density, two Gibbs moves for what the prior leaves open, and
Metropolis moves for unknown scalars.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from chemage.inference import choice_kernels, line_kernels
from chemage.inference.prior import LEVEL
from chemage.inference.problem import Problem

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
    #: whether the density is complete -> (choices, n) means and (choices, n, n) factors of the inverse covariances
    tables: dict[bool, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


class Chain:
    """One Markov chain, which begins at ``start`` (n,)."""

    def __init__(self, problem: Problem, start: np.ndarray, rng: np.random.Generator) -> None:
        self.problem, self.rng = problem, rng
        mass = float(np.maximum(start, 0.0) @ problem.areas)
        self.x = np.ascontiguousarray(start * min(1.0, 0.999 / max(mass, 1e-12)))
        start_point = problem.scalars.start
        self.point = len(problem.matrices) // 2 if start_point is None else start_point
        self.log_factor = 0.0
        # whether no barrier lies above the last energy, so that the integral of the density is 1
        self.complete = False
        #: (sweeps, n) densities, points of the grid of scalars and factors, from the end of the warm-up on
        self.densities: list[np.ndarray] = []
        self.points: list[int] = []
        self.factors: list[float] = []
        self._archive: np.ndarray = np.zeros((0, start.size))
        self._patterns: list[_Pattern] = []
        choices = len(problem.prior.combinations)
        self._most_patterns = int(np.clip(BYTES / (16 * choices * start.size**2), 2, PATTERNS))
        self._scaled: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._reduced: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        logs = problem.prior.log_densities(self.x)
        self.choice = int(np.argmax(logs + rng.gumbel(size=logs.size)))

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

    def step(self) -> None:
        """One sweep over all unknowns."""
        self._drawn_density()
        self._drawn_complete()
        self._drawn_choice()
        self._moved_choice()
        if self.problem.scalars.values or self.problem.scalars.factor:
            for _ in range(3):
                self._moved_scalars()

    # -- the misfit ---------------------------------------------------------------------------------------------------

    def _linear(self, point: int) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (n, m) and offset (m,) in units of the errors, the factor left out."""
        if point not in self._scaled:
            problem = self.problem
            self._scaled[point] = (
                np.ascontiguousarray((problem.matrices[point] / problem.errors[:, None]).T),
                problem.offsets[point] / problem.errors,
            )
        return self._scaled[point]

    def _rotated(self, point: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix (n, r), values and offset (r,) of the combinations of the measurements that tell of the density."""
        if point not in self._reduced:
            matrix, offset = self._linear(point)
            _, size, axes = np.linalg.svd(matrix, full_matrices=False)
            axes = axes[: max(int((size > NEGLIGIBLE).sum()), 1)].T
            values = self.problem.values / self.problem.errors
            self._reduced[point] = np.ascontiguousarray(matrix @ axes), values @ axes, offset @ axes
        return self._reduced[point]

    def _rows(self, point: int, log_factor: float, complete: bool) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (n, r) and target (r,) of the misfit; a complete density has one row more, for its integral."""
        matrix, values, offset = self._rotated(point)
        if log_factor:
            matrix = np.exp(log_factor) * matrix
        target = values - np.exp(log_factor) * offset
        if not complete:
            return matrix, target
        row = self.problem.areas[:, None] / COMPLETE
        return np.ascontiguousarray(np.concatenate([matrix, row], axis=1)), np.append(target, 1 / COMPLETE)

    def _misfit(self, x: np.ndarray, point: int, log_factor: float) -> float:
        """Half of χ² of all measurements; infinite where the integral of the density exceeds 1."""
        density = np.maximum(x, 0.0)
        mass = float(density @ self.problem.areas)
        if mass > self._limit:
            return np.inf
        matrix, offset = self._linear(point)
        residual = np.exp(log_factor) * (offset + density @ matrix) - self.problem.values / self.problem.errors
        return 0.5 * float(residual @ residual) + (0.5 * ((mass - 1) / COMPLETE) ** 2 if self.complete else 0.0)

    @property
    def _limit(self) -> float:
        return LIMIT if self.complete else 1.0

    # -- the density --------------------------------------------------------------------------------------------------

    def _pattern(self) -> _Pattern:
        return _Pattern((self.x > 0).astype(float), self.point, self.log_factor)

    def _table(self, pattern: _Pattern) -> tuple[np.ndarray, np.ndarray]:
        """(choices, n) means and (choices, n, n) lower factors L of the inverse covariances of a pattern."""
        if self.complete not in pattern.tables:
            matrix, target = self._rows(pattern.point, pattern.log_factor, self.complete)
            seen = matrix * pattern.positive[:, None]
            factors = np.linalg.cholesky(self.problem.prior.precisions[0] + seen @ seen.T)
            goal = seen @ (target - LEVEL * seen.sum(axis=0))
            pattern.tables[self.complete] = LEVEL + choice_kernels.solved_twice(factors, goal), factors
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
            parts.append(choice_kernels.solved(factors[self.choice], rng.standard_normal((others, nodes.size))))
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
        found = np.exp(-0.5 * away**2) * np.where(rng.random((BUMPS, 1)) < 0.5, 1.0, away)
        found[np.abs(found) < 1e-6] = 0.0
        return found

    def _drawn_density(self) -> None:
        """Draw the process anew along as many lines as it has nodes."""
        problem = self.problem
        matrix, target = self._rows(self.point, self.log_factor, self.complete)
        directions = self._directions(self.x.size)
        inverse = problem.prior.precisions[0][self.choice]
        line_kernels.sweep(
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
        candidates = self._candidates()
        logs = choice_kernels.log_priors(self.x, LEVEL, candidates, *self.problem.prior.precisions)
        self.choice = int(candidates[np.argmax(logs + self.rng.gumbel(size=logs.size))])

    def _moved_choice(self) -> None:
        """Draw the choice of the prior with a density that adapts to it."""
        if not self._patterns:
            return
        means, factors = self._table(self._patterns[self.rng.integers(len(self._patterns))])
        candidates = self._candidates()
        self.choice = int(
            choice_kernels.moved(
                self.x,
                self.choice,
                LEVEL,
                candidates,
                means,
                factors,
                *self.problem.prior.precisions,
                *self._rows(self.point, self.log_factor, self.complete),
                self.problem.areas,
                self._limit,
                self.rng.gumbel(size=candidates.size),
            )
        )

    # -- unknown scalars ----------------------------------------------------------------------------------------------

    def _moved_scalars(self) -> None:
        """Move along the grid of scalars, with the density shifted by whole nodes, and the common factor with it."""
        scalars, rng, logs_of = self.problem.scalars, self.rng, self._log_prior
        here, logs = self._misfit(self.x, self.point, self.log_factor), logs_of(self.x)
        if scalars.neighbours.shape[1]:
            other = int(scalars.neighbours[self.point, rng.integers(scalars.neighbours.shape[1])])
            shifted = np.roll(self.x, int(rng.integers(-SHIFT, SHIFT + 1)))
            there = self._misfit(shifted, other, self.log_factor)
            gain = here - there + logs_of(shifted) - logs
            if other != self.point and np.log(rng.random()) < gain:
                self.x, self.point, here = shifted, other, there
                logs = logs_of(self.x)
        if scalars.factor:
            step = 0.15 * rng.standard_normal()
            factor = self.log_factor + step
            if scalars.bounds[0] <= factor <= scalars.bounds[1]:
                # the density falls as the factor rises, or stays
                falls = rng.random() < 0.5
                scaled = self.x * np.exp(-step) if falls else self.x
                gain = here - self._misfit(scaled, self.point, factor)
                gain += logs_of(scaled) - logs - self.x.size * step if falls else 0.0
                if np.log(rng.random()) < gain:
                    self.x, self.log_factor = scaled, factor

    def _log_prior(self, x: np.ndarray) -> float:
        one = np.array([self.choice])
        return float(choice_kernels.log_priors(x, LEVEL, one, *self.problem.prior.precisions)[0])
