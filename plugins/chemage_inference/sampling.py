"""Samples of the posterior: Markov chains that are continued until there are enough, and the measures of that.

A chain moves along lines for the density, and by moves with a density that adapts for what the prior leaves open and
for the unknown scalars: ⟨f⟩, the nuisances, and those on the grid. Scalars move by differences between their earlier
values, so that they follow the ridges of their posterior (ter Braak, Stat. Comput. 16, 239 (2006)).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from chemage.plugin import algebra
from chemage.plugin import threads as processors
from chemage_inference import kernels
from chemage_inference.noise import State
from chemage_inference.open import effective as effective_samples
from chemage_inference.open import r_hat
from chemage_inference.problem import LEVEL, LOAD, STRENGTHS, Problem, values_of

#: chains; sweeps of each before samples are kept, in stages after each of which all chains learn from all
CHAINS, WARM, STAGES = 4, 120, 4
#: effective samples and R-hat at which sampling ends, and the most sweeps of a chain for it
ENOUGH, AGREED, MOST_SWEEPS = 250, 1.03, 4000
#: R-hat of unknown scalars at which sampling ends
SCALARS_AGREED = 1.01
#: lengths of moves of the scalars over that of a difference of earlier values, or of the prior, before there are earlier
#: values; by how much they are larger then
STEPS, LONGER = (0.1, 0.3, 1.0), 0.7
#: standard deviation of the integral of a density that is complete, and its largest
COMPLETE, LIMIT = 0.003, 1.02
#: passes over the density in a sweep, and moves of scalars in each; common factors need fewer
PASSES, MOVED = 2, 5
#: densities at most that are looked at for one direction of an exchange between density and factor
TRIES = 30
#: densities of the warm-up whose differences serve as directions; bumps of which some are drawn for every sweep
ARCHIVE, BUMPS = 200, 2000
#: derivatives of a bump that serve as directions, from the 0th
ORDERS = 5
#: standard errors by which a combination of the measurements changes with the density (1/eV) at least, or is left out
NEGLIGIBLE = 2e-3


class ChainPosition(NamedTuple):
    """Where a chain is, but for its density."""

    #: (d,) on the grid of scalars
    position: np.ndarray
    #: logarithm of the common factor
    log_factor: float
    #: the errors of the measurements
    state: State
    #: (g,) of the coefficients there, and the logarithm of the prior of the scalars
    weights: np.ndarray
    log_prior: float


class Guide(NamedTuple):
    """What chains have learnt of the posterior, whose differences are directions; they are valid whatever it is."""

    #: (A, n) densities, and (B, k) scalars
    archive: np.ndarray
    scalars: np.ndarray


class Chain:
    """One Markov chain, which begins at ``start`` (n,)."""

    def __init__(
        self,
        problem: Problem,
        start: np.ndarray,
        rng: np.random.Generator,
        guide: Guide | None = None,
    ) -> None:
        self.problem, self.rng = problem, rng
        self.noise = problem.noise
        self.x = np.ascontiguousarray(
            start * min(1.0, 0.999 / max(self._mass(start), 1e-12))
        )
        self.place = self._placed(
            problem.unknowns.nodes[problem.start].astype(float),
            0.0,
            problem.state or self.noise.start,
        )
        # whether no barrier lies above the last energy, so that the integral of the density is 1
        self.complete = False
        #: (sweeps, n) of the process, and places
        self.processes: list[np.ndarray] = []
        self.places: list[ChainPosition] = []
        nothing = np.zeros((0, start.size))
        self.guide = guide or Guide(nothing, nothing)
        self._last: Any = None, None, None
        # what kernels.moved knows of the present place; nan at last: nothing
        self._known = np.full(start.size + 1, np.nan)
        every = np.arange(len(problem.prior.combinations))
        logs = self._log_priors(self.x, every)
        self.choice = int(np.argmax(logs + rng.gumbel(size=logs.size)))

    def run(self, sweeps: int) -> None:
        """Make and keep more sweeps."""
        for _ in range(sweeps):
            self.step()
            self.processes.append(self.x.copy())
            self.places.append(self.place)

    def forget(self) -> None:
        """Keep none of the sweeps that were made."""
        self.processes.clear()
        self.places.clear()

    @property
    def densities(self) -> np.ndarray:
        """(sweeps, n) that were kept."""
        return np.maximum(self.processes, 0.0)

    def step(self) -> None:
        """One sweep over all unknowns."""
        for _ in range(PASSES):
            self._drawn_density()
            self._drawn_complete()
            self._drawn_choice()
            if self._widths.size:
                self._exchanged()
                for _ in range(MOVED if not self._common.all() else 1):
                    self._moved_scalars()
        if self._widths.size:
            self._completed()
        if not self.noise.fixed:
            self._drawn_errors()

    # -- the misfit ---------------------------------------------------------------------------------------------------

    @cached_property
    def _rotated(self) -> tuple[np.ndarray, np.ndarray]:
        """Axes (n, r) of the density that the measurements tell of, and the measurements (g, m, r) by them."""
        matrices = self.problem.matrices
        rows = matrices / self.problem.errors[:, None]
        if len(rows) == 1:
            axes = algebra.row_axes(rows[0], NEGLIGIBLE).T
        else:
            rows = rows.reshape(-1, rows.shape[2])
            mean_square = algebra.product(rows.T, rows) / len(matrices)
            axes = algebra.row_axes(mean_square, NEGLIGIBLE**2).T
        return np.ascontiguousarray(axes), algebra.product(matrices, axes)

    def _rows(
        self, place: ChainPosition, mass: float | None
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Matrix (n, r) and target (r,) of the misfit, and the part of χ² that does not depend on the density.

        With a ``mass`` they have one row more, for the integral of the density to be about that.
        """
        if self._last[0] is not place or self._last[1] != mass:
            self._last = place, mass, self._made_rows(place, mass)
            self._known[-1] = np.nan
        return self._last[2]

    def _made_rows(
        self, place: ChainPosition, mass: float | None
    ) -> tuple[np.ndarray, np.ndarray, float]:
        problem, noise, state = self.problem, self.noise, place.state
        matrix, target, rest = kernels.reduced(
            place.weights,
            *self._rotated,
            problem.offsets,
            problem.values - noise.added(state),
            np.exp(place.log_factor) * noise.factor(state),
            noise.errors(state),
            noise.correlation(state),
        )
        if mass is not None:
            row = self.problem.areas[:, None] / COMPLETE
            matrix = np.concatenate([matrix, row], axis=1)
            target = np.append(target, mass / COMPLETE)
        return np.ascontiguousarray(matrix), target, rest

    def _mass(self, x: np.ndarray) -> float:
        return float(algebra.product(np.maximum(x, 0.0), self.problem.areas))

    def _fitted(self, x: np.ndarray, place: ChainPosition) -> np.ndarray:
        """(m,) true values of the model."""
        matrix, offset = self.problem.at(place.weights)
        values = offset + algebra.product(matrix, np.maximum(x, 0.0))
        return np.exp(place.log_factor) * values

    @property
    def _integral(self) -> float | None:
        """That of a complete density."""
        return 1.0 if self.complete else None

    @property
    def _limit(self) -> float:
        return LIMIT if self.complete else 1.0

    # -- the density --------------------------------------------------------------------------------------------------

    def _directions(self, count: int) -> np.ndarray:
        """(count, n): bumps of all widths, and their derivatives, which keep the integral, the mean and so on; and
        differences of earlier samples."""
        rng, archive = self.rng, self.guide.archive
        between = count // 3 if len(archive) else 0
        bumps = self._bumps[rng.integers(BUMPS, size=count - between)]
        if not between:
            return bumps
        pairs = rng.integers(len(archive), size=(2, between))
        return np.concatenate([bumps, np.subtract(*archive[pairs])])

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
        """Draw the process anew along twice as many lines as it has nodes."""
        self._known[-1] = np.nan
        problem = self.problem
        matrix, target, _ = self._rows(self.place, self._integral)
        directions = self._directions(2 * self.x.size)
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
        """Draw the choice of the prior among its neighbours, a block of two in each of its parts, with a density that
        adapts to it."""
        blocks = self.problem.prior.parts + self.rng.integers(2, size=3)
        near = (blocks // 2 == blocks[self.choice] // 2).all(axis=1)
        near[self.choice] = False
        choices = np.append(self.choice, np.flatnonzero(near))
        rows = [self._rows(self.place, self._integral)]
        gumbels = self.rng.gumbel(size=choices.size)
        chosen = self._adapted(choices, rows, [self._limit], gumbels)
        self.choice = int(choices[chosen])

    def _adapted(
        self,
        choices: np.ndarray,
        rows: list[tuple[np.ndarray, np.ndarray, float]],
        limits: list[float],
        gumbels: np.ndarray,
    ) -> int:
        """Which of the choices and models is drawn, with a density that adapts to it."""
        matrices, targets, _ = zip(*rows, strict=True)
        return kernels.moved(
            self.x,
            choices,
            LEVEL,
            *self.problem.prior.precisions,
            np.stack(matrices),
            np.stack(targets),
            self.problem.areas,
            np.array(limits),
            gumbels,
            self._known,
        )

    # -- errors -------------------------------------------------------------------------------------------------------

    def _drawn_errors(self) -> None:
        """Draw the errors at fixed density and nuisances."""
        fitted = self._fitted(self.x, self.place)
        state = self.noise.drawn(
            self.place.state, self.problem.values, fitted, self.rng
        )
        self.place = self.place._replace(state=state)

    # -- unknown scalars ----------------------------------------------------------------------------------------------

    def scalars(self, place: ChainPosition) -> np.ndarray:
        """(k,) position on the grid, logarithm of the common factor, nuisances: those unknown."""
        known = self.problem.unknowns.factor is None
        factor = () if known else (place.log_factor,)
        return np.concatenate([place.position, factor, place.state.nuisances])

    def _placed(
        self, position: np.ndarray, log_factor: float, state: State
    ) -> ChainPosition:
        unknowns = self.problem.unknowns
        low, high = unknowns.factor or (0.0, 0.0)
        log_prior = unknowns.log_prior(position)
        if not low <= log_factor <= high or not np.isfinite(log_prior):
            return ChainPosition(position, log_factor, state, np.zeros(0), -np.inf)
        away = state.nuisances / self.noise.widths
        log_prior -= 0.5 * float(away @ away)
        weights = unknowns.weights(position[None])[0]
        return ChainPosition(position, log_factor, state, weights, log_prior)

    def _at(self, scalars: np.ndarray) -> ChainPosition:
        """The place with other ``scalars`` (k,)."""
        size, state = self.place.position.size, self.place.state
        position, rest, log_factor = scalars[:size], scalars[size:], 0.0
        if self.problem.unknowns.factor is not None:
            log_factor, rest = float(rest[0]), rest[1:]
        if rest.size:
            state = replace(state, nuisances=rest)
        return self._placed(position, log_factor, state)

    @cached_property
    def _widths(self) -> np.ndarray:
        """(k,) about the standard deviations of the scalars in their prior."""
        unknowns = self.problem.unknowns
        spans = [axis.size - 1.0 for axis in unknowns.axes.values()]
        if unknowns.factor is not None:
            spans.append(unknowns.factor[1] - unknowns.factor[0])
        return np.append(0.3 * np.array(spans), self.noise.widths)

    @cached_property
    def _common(self) -> np.ndarray:
        """(k,) 1 for the scalars whose sum with one number is a common factor of all values: ⟨f⟩, or calibrations."""
        unknowns, nuisances = self.problem.unknowns, self.noise.nuisances
        known = unknowns.factor is None
        shared = [known and name == "calibration" for name, _ in nuisances]
        before = [False] * len(unknowns.axes) + [True] * (not known)
        return np.array([*before, *shared], dtype=float)

    @cached_property
    def _scaling(self) -> np.ndarray:
        """(k,) changes of the scalars by which all values rise by a factor e: of common factors, or else of the load."""
        direction, axes = self._common.copy(), self.problem.unknowns.axes
        if LOAD in axes and not direction.any():  # the last axis
            last = axes[LOAD].size - 1
            sums = self.problem.matrices.sum(axis=(1, 2)).reshape(-1, last + 1)
            rise = np.log(sums[:, last].sum() / sums[:, 0].sum())
            direction[len(axes) - 1] = last / rise
        return direction

    @cached_property
    def _rises(self) -> np.ndarray:
        """(k,) by how much the logarithms of all values rise on average with each scalar, those on the grid left out."""
        noise, unknowns = self.noise, self.problem.unknowns
        shared = noise.columns.mean(axis=0) * noise.multiplies
        before = [0.0] * len(unknowns.axes) + [1.0] * (unknowns.factor is not None)
        return np.array([*before, *shared])

    def _exchanged(self) -> None:
        """Draw a common factor with the density, whose integral stays, where values are proportional to it."""
        problem, scalars = self.problem, self.scalars(self.place)
        common = np.flatnonzero(self._common)
        # what neighbours add is not, but for rounding
        if not common.size or np.abs(problem.offsets).max() > 1e-9:
            return
        matrix, target, _ = self._rows(self.place, self._integral)
        count = target.size - self.complete
        directions = self._directions(self.x.size // 3)
        inverse = problem.prior.precisions[0][self.choice]
        widths, bounds = self._widths[common], problem.unknowns.factor
        rise = kernels.exchanged(
            self.x,
            LEVEL,
            algebra.product(inverse, self.x),
            np.ascontiguousarray(matrix[:, :count]),
            target[:count].copy(),
            problem.areas,
            directions,
            algebra.products(directions, inverse),
            scalars[common],
            np.full(1, np.inf) if bounds else widths,
            np.array(bounds or (-np.inf, np.inf)),
            self.rng.random((len(directions), TRIES)),
        )
        self.place = self._at(scalars + rise * self._common)
        self._known[-1] = np.nan

    def _step(self) -> np.ndarray:
        """(k,) by which scalars move: a difference of earlier values or as far as the prior is wide, all or one."""
        rng, size, count = self.rng, self._widths.size, len(self.guide.scalars)
        kind = rng.random() if count else 1.0
        step = self._widths * rng.standard_normal(size)
        if kind < 0.75:
            one, other = self.guide.scalars[rng.integers(count, size=2)]
            step = (one - other)[:size]
        if kind > 0.4:
            step *= np.arange(size) == rng.integers(size)
        return step * (STEPS[rng.integers(len(STEPS))] + LONGER * (count > 0))

    def _moved_scalars(self) -> None:
        """Move the scalars, or stay, with a density that adapts to them."""
        place = self._at(self.scalars(self.place) + self._step())
        self._tried(place, 0.0, (self._integral, self._integral))

    def _completed(self) -> None:
        """Complete the density with a smaller common factor, or open it with a larger one, at about equal values.

        An open density is scaled to one whose integral is about 1; the probability with which that leads back is a
        further row of the open model.
        """
        rng, direction = self.rng, self._scaling
        if not direction.any():
            return
        there = direction != 0
        width = float(np.mean(self._widths[there] / direction[there]))
        if self.complete:
            step = width * abs(rng.standard_normal())
            integral = np.exp(-step)
        else:
            integral = self._mass(self.x) + COMPLETE * rng.standard_normal()
            step = -np.log(max(integral, 1e-300))
        if step < 0:
            return
        gain = (
            step
            + np.log(4 / (width * np.sqrt(2 * np.pi)))
            - 0.5 * (step / width) ** 2
        )
        sign = 1.0 if self.complete else -1.0
        integrals = (1.0, integral) if self.complete else (integral, 1.0)
        place = self._at(self.scalars(self.place) + sign * step * direction)
        self._tried(place, -sign * gain, integrals)

    def _tried(
        self,
        place: ChainPosition,
        gain: float,
        integrals: tuple[float | None, float | None],
    ) -> None:
        """Move to ``place``, or stay, with a density that adapts; ``gain`` is that of the proposal, logarithmic.

        Different ``integrals`` mean that a density is completed or opened. In half of the moves the strength of the
        prior falls as the common factor rises.
        """
        gain += place.log_prior - self.place.log_prior
        if not np.isfinite(gain):
            return
        flips = integrals[0] != integrals[1]
        limits = [self._limit, 1.0 + LIMIT - self._limit if flips else self._limit]
        rows = [
            self._rows(self.place, integrals[0]),
            self._made_rows(place, integrals[1]),
        ]
        gain += 0.5 * (rows[0][2] - rows[1][2]) - np.log(self.rng.random())
        rise = self._rises @ (self.scalars(place) - self.scalars(self.place))
        fall = rise / np.log(STRENGTHS[1] / STRENGTHS[0]) * self.rng.integers(2)
        strength = self.choice % STRENGTHS.size
        strength -= int(np.floor(fall + self.rng.random()))
        if not 0 <= strength < STRENGTHS.size:
            return
        other = self.choice - self.choice % STRENGTHS.size + strength
        choices, gumbels = np.array([self.choice, other]), np.array([0.0, gain])
        if self._adapted(choices, rows, limits, gumbels):
            self.place, self.complete = place, self.complete != flips
            self.choice = other
            self._last = place, integrals[1], rows[1]

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
    guide: Guide

    @cached_property
    def positions(self) -> np.ndarray:
        """(S, d) on the grid of scalars."""
        return np.stack([place.position for place in self.places])

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
    def nuisances(self) -> np.ndarray:
        """(S, q) of :attr:`Noise.nuisances`."""
        return np.stack([state.nuisances for state in self.states])

    @property
    def off(self) -> np.ndarray:
        """(m,) share of the samples in which a point is off."""
        return np.mean([state.inflation > 1 for state in self.states], axis=0)

    @property
    def typical(self) -> State:
        """The typical errors: points weigh by the mean of their precision."""
        precision = np.mean(
            [state.inflation**-2.0 for state in self.states], axis=0
        )
        time = float(np.mean([state.log_time for state in self.states]))
        scales = np.exp(np.log(self.scales).mean(axis=0))
        return State(scales, precision**-0.5, self.nuisances.mean(axis=0), time)

    def fitted(self, problem: Problem) -> np.ndarray:
        """(S, m) true values of each sample."""
        weights = problem.unknowns.weights(self.positions)
        values = values_of(
            self.densities, weights, problem.matrices, problem.offsets
        )
        return self.factors[:, None] * values

    def expected(self, problem: Problem) -> np.ndarray:
        """(S, m) values of each sample as the instruments measure them."""
        noise, states = problem.noise, self.states
        factors, added = (
            np.stack([each(state) for state in states])
            for each in (noise.factor, noise.added)
        )
        return factors * self.fitted(problem) + added


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
    guide: Guide | None = None,
) -> Samples:
    """At least ``samples`` samples of the posterior from chains that begin near ``start`` (n,).

    They first learn how to move, or only forget the start if a ``guide`` is given. They are continued until the
    ``watched`` nodes (n,) and all scalars have :data:`ENOUGH` effective samples and agree, or each has made ``sweeps``
    sweeps; of the sweeps, evenly spaced ones are kept.
    """
    each = -(-samples // CHAINS)
    watched = np.ones(start.size, dtype=bool) if watched is None else watched
    chains = [
        Chain(problem, start, np.random.default_rng([seed, number, 41]), guide)
        for number in range(CHAINS)
    ]
    workers = min(threads or processors.available(), CHAINS)
    if guide:
        run(chains, min(WARM, sweeps) // STAGES, workers)
    else:
        warm(chains, min(WARM, sweeps), workers)
    for chain in chains:
        chain.forget()
    done, more = 0, min(2 * each, max(sweeps, each))
    while True:
        if progress:
            progress(done, sweeps)
        run(chains, more, workers)
        done += more
        densities = np.stack([chain.densities for chain in chains])
        seen = densities[:, :, watched] if watched.any() else densities
        found = [(*convergence(seen), AGREED)]
        for of, end in (_errors, AGREED), (Chain.scalars, SCALARS_AGREED):
            values = np.array(
                [[of(chain, at) for at in chain.places] for chain in chains]
            )
            columns = (
                np.split(values, values.shape[2], axis=2) if values.size else ()
            )
            found += [(*convergence(column), end) for column in columns]
        effective, ratio = (
            min(one[0] for one in found),
            max(one[1] for one in found),
        )
        agreed = all(off <= end for _, off, end in found)
        if (effective >= ENOUGH and agreed) or done >= sweeps:
            break
        more = min(done // 4, sweeps - done)
    if progress:
        progress(sweeps, sweeps)
    kept = np.linspace(0, done - 1, each).round().astype(int)
    places = [chain.places[number] for chain in chains for number in kept]
    size = CHAINS * each
    densities = densities[:, kept].reshape(size, -1)
    effective = min(effective, float(size))
    return Samples(densities, places, effective, ratio, done, chains[0].guide)


def run(chains: Sequence[Chain], sweeps: int, workers: int = 1) -> None:
    """Make more sweeps of each chain."""
    processors.in_order(
        lambda number: chains[number].run(sweeps), len(chains), workers, None
    )


def warm(chains: Sequence[Chain], sweeps: int, workers: int = 1) -> None:
    """Let chains forget where they began, and learn from each other how to move unless they are guided."""
    for _ in range(STAGES):
        run(chains, sweeps // STAGES, workers)
        half = len(chains[0].places) // 2
        places = [place for chain in chains for place in chain.places[half:]]
        processes = np.concatenate([chain.processes[half:] for chain in chains])
        guide = Guide(
            processes[:: max(len(processes) // ARCHIVE, 1)],
            np.array([chains[0].scalars(place) for place in places]),
        )
        for chain in chains:
            chain.guide = guide


def _errors(chain: Chain, place: ChainPosition) -> np.ndarray:
    """What is inferred of the errors but for the nuisances."""
    state, correlated = place.state, chain.noise.model.correlated
    return np.append(np.log(state.scales), state.log_time if correlated else ())


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
