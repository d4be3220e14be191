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
from chemage_inference.kernels import COMPLETE, LIMIT
from chemage_inference.noise import State
from chemage_inference.open import effective as effective_samples
from chemage_inference.open import r_hat
from chemage_inference.problem import LEVEL, LOAD, STRENGTHS, Problem, values_of

#: chains; sweeps of each before samples are kept, in stages after each of which all chains learn from all
CHAINS, WARM, STAGES = 4, 80, 4
#: effective samples and R-hat at which sampling ends, and the most sweeps of a chain for it
ENOUGH, AGREED, MOST_SWEEPS = 250, 1.03, 4000
#: R-hat of unknown scalars at which sampling ends
SCALARS_AGREED = 1.01
#: lengths of moves of the scalars over that of a difference of earlier values, or of the prior, before there are earlier
#: values; by how much they are larger then
STEPS, LONGER = (0.1, 0.3, 1.0), 0.7
#: share of the moves of scalars in which the density shifts with the energies
SHIFTED = 0.7
#: passes over the density in a sweep, without scalars and with them; moves of scalars after each: so many, and so many
#: for each scalar; common factors need fewer
PASSES, MOVED = (2, 4), (2, 2)
#: densities at most that are looked at for one direction of an exchange between density and factor
TRIES = 30
#: densities of the warm-up whose differences serve as directions; bumps of which some are drawn for every sweep
ARCHIVE, BUMPS = 200, 2000
#: derivatives of a bump that serve as directions, from the 0th
ORDERS = 5
#: standard errors by which a combination of the measurements changes with the density (1/eV) at least, or is left out
NEGLIGIBLE = 0.02


class ChainPosition(NamedTuple):
    """Where a chain is, but for its density."""

    #: (k,) position on the grid, logarithm of the common factor, nuisances: those unknown
    scalars: np.ndarray
    #: (d,) on the grid of scalars
    position: np.ndarray
    #: logarithm of the common factor
    log_factor: float
    #: the errors of the measurements
    state: State


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
        #: the errors; their nuisances are those of the scalars
        self.state = problem.state or self.noise.start
        unknowns = problem.unknowns
        #: (k,) position on the grid, logarithm of the common factor, nuisances: those unknown
        self.scalars = np.concatenate(
            [
                unknowns.nodes[problem.start],
                np.zeros(int(unknowns.factor is not None)),
                self.state.nuisances,
            ]
        ).astype(float)
        # whether no barrier lies above the last energy, so that the integral of the density is 1
        self.complete = False
        #: (sweeps, n) of the process, and places
        self.processes: list[np.ndarray] = []
        self.places: list[ChainPosition] = []
        nothing = np.zeros((0, start.size)), np.zeros((0, self.scalars.size))
        archive, scalars = guide or nothing
        # of a problem without nuisances, which are the last scalars, those of the others guide
        self.guide = Guide(archive, scalars[:, : self.scalars.size])
        self._rows: Any = None
        logs = [
            kernels.log_prior(self.x, LEVEL, *one)
            for one in zip(*problem.prior.precisions, strict=True)
        ]
        self.choice = int(np.argmax(logs + rng.gumbel(size=len(logs))))

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
        unknown = self.scalars.size > 0
        for _ in range(PASSES[unknown]):
            self._drawn_density()
            self._drawn_complete()
            self._drawn_choice()
            if unknown:
                self._exchanged()
                self._moved_scalars()
        if not self.noise.fixed:
            self._drawn_errors()

    @property
    def place(self) -> ChainPosition:
        """Where the chain is."""
        unknowns, scalars = self.problem.unknowns, self.scalars.copy()
        position, rest = np.split(scalars, [len(unknowns.axes)])
        known = unknowns.factor is None
        log_factor, nuisances = np.split(rest, [0 if known else 1])
        state = replace(self.state, nuisances=nuisances)
        return ChainPosition(scalars, position, float(log_factor.sum()), state)

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

    @cached_property
    def _measured(self) -> tuple[np.ndarray, ...]:
        """The model at any scalars, as of :func:`chemage_inference.kernels.reduced`."""
        problem, noise = self.problem, self.noise
        unknowns, size = problem.unknowns, problem.values.size
        rises, adds = np.zeros((2, size, self.scalars.size))
        rises[:, len(unknowns.axes) :] = 1.0
        first = self.scalars.size - noise.widths.size
        rises[:, first:] = noise.columns * noise.multiplies
        adds[:, first:] = noise.columns * ~noise.multiplies
        return (
            *unknowns.polynomials,
            *self._rotated,
            problem.offsets,
            rises,
            adds,
        )

    @property
    def _data(self) -> tuple[np.ndarray, ...]:
        """Values, their errors, and correlations."""
        noise = self.noise
        errors, near = noise.errors(self.state), noise.correlation(self.state)
        return self.problem.values, errors, near

    def _model(self, complete: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix (n, r + 1) and target (r + 1,) of the misfit, the last for the integral of a complete density; and
        areas."""
        if self._rows is None:
            made = kernels.reduced(self.scalars, self._measured, *self._data)
            self._rows = made[:2]
        model = *self._rows, self.problem.areas
        kernels.weighed(*model, 1.0 if complete else np.nan)
        return model

    def _mass(self, x: np.ndarray) -> float:
        return float(algebra.product(np.maximum(x, 0.0), self.problem.areas))

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
        each = np.polynomial.hermite_e.hermeval(away, np.eye(ORDERS))
        bumps = np.exp(-0.5 * away**2) * np.choose(order, each)
        bumps[np.abs(bumps) < 1e-6] = 0.0
        return bumps

    def _drawn_density(self) -> None:
        """Draw the process anew along twice as many lines as it has nodes."""
        problem = self.problem
        matrix, target, areas = self._model(self.complete)
        directions = self._directions(2 * self.x.size)
        inverse = problem.prior.precisions[0][self.choice]
        kernels.sweep(
            self.x,
            algebra.product(inverse, self.x - LEVEL),
            matrix,
            target,
            areas,
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
        chosen = kernels.choice_drawn(
            self.x,
            choices,
            LEVEL,
            *self.problem.prior.precisions,
            self._model(self.complete),
            self._limit,
            self.rng.gumbel(size=choices.size),
        )
        self.choice = int(choices[chosen])

    # -- errors -------------------------------------------------------------------------------------------------------

    def _drawn_errors(self) -> None:
        """Draw the errors at fixed density and nuisances."""
        place = self.place
        weights = self.problem.unknowns.weights(place.position[None])[0]
        matrix, offset = self.problem.at(weights)
        values = offset + algebra.product(matrix, np.maximum(self.x, 0.0))
        fitted = np.exp(place.log_factor) * values
        self.state = self.noise.drawn(
            place.state, self.problem.values, fitted, self.rng
        )
        self._rows = None

    # -- unknown scalars ----------------------------------------------------------------------------------------------

    @cached_property
    def _priors(self) -> np.ndarray:
        """(k, 4) of the scalars: lower and upper bound, mean, standard deviation."""
        far = np.inf
        nuisances = [(-far, far, 0.0, width) for width in self.noise.widths]
        both = self.problem.unknowns.priors, np.reshape(nuisances, (-1, 4))
        return np.concatenate(both)

    @cached_property
    def _widths(self) -> np.ndarray:
        """(k,) about the standard deviations of the scalars in their prior."""
        low, high, _, width = self._priors.T
        return np.minimum(0.3 * (high - low), width)

    @cached_property
    def _common(self) -> np.ndarray:
        """(k,) which scalars, all changed alike, are a common factor of all values: ⟨f⟩, or calibrations."""
        unknowns, nuisances = self.problem.unknowns, self.noise.nuisances
        known = unknowns.factor is None
        shared = [known and name == "calibration" for name, _ in nuisances]
        before = [False] * len(unknowns.axes) + [True] * (not known)
        return np.array([*before, *shared], dtype=bool)

    @cached_property
    def _responses(self) -> np.ndarray:
        """(2, k): nodes by which energies shift, and logarithms by which values rise, with one of each scalar on the
        grid: as the model in the middle of the grid changes at best."""
        problem, found = self.problem, np.zeros((2, self.scalars.size))
        middle = problem.unknowns.nodes.mean(axis=0)
        scale = problem.errors[:, None] * problem.areas
        for axis in range(middle.size):
            ends = middle + np.outer((-1, 0, 1), np.arange(middle.size) == axis)
            weights = problem.unknowns.weights(ends)
            below, here, above = (problem.at(one)[0] / scale for one in weights)
            columns = np.stack([-np.gradient(here, axis=1), here]).reshape(2, -1)
            (a, b), (_, c) = algebra.product(columns, columns.T)
            u, v = algebra.product(columns, (above - below).ravel() / 2)
            found[:, axis] = np.array([c * u - b * v, a * v - b * u]) / (
                a * c - b * b
            )
        return found

    @cached_property
    def _scaling(self) -> np.ndarray:
        """(k,) changes of the scalars by which all values rise by a factor e: of common factors, or else of the load."""
        direction, axes = self._common.astype(float), self.problem.unknowns.axes
        if LOAD in axes and not direction.any():  # the last axis
            direction[len(axes) - 1] = 1.0 / self._responses[1, len(axes) - 1]
        return direction

    def _exchanged(self) -> None:
        """Draw a common factor with the density, whose integral stays, where values are proportional to it."""
        problem, common = self.problem, self._common
        # what neighbours add is not, but for rounding
        if not common.any() or np.abs(problem.offsets).max() > 1e-9:
            return
        matrix, target, areas = self._model(False)
        directions = self._directions(self.x.size // 4)
        inverse = problem.prior.precisions[0][self.choice]
        self.scalars[common] += kernels.exchanged(
            self.x,
            LEVEL,
            algebra.product(inverse, self.x),
            matrix,
            target,
            areas,
            directions,
            algebra.products(directions, inverse),
            self.scalars[common],
            self._priors[common],
            self.rng.random((len(directions), TRIES)),
        )
        self._rows = None

    def _steps(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """(count, k) by which scalars move: a difference of earlier values or as far as the prior is wide, all or
        one; and (count,) nodes by which energies shift, and in most of the moves the density."""
        rng, size, archive = self.rng, self.scalars.size, self.guide.scalars
        steps, longer = self._widths * rng.standard_normal((count, size)), 0.0
        kind = np.ones(count)
        if len(archive):
            kind, longer = rng.random(count), LONGER
            pairs = archive[rng.integers(len(archive), size=(2, count))]
            earlier = kind < 0.75
            steps[earlier] = np.subtract(*pairs)[earlier]
        one = np.arange(size) == rng.integers(size, size=(count, 1))
        steps *= one | (kind <= 0.4)[:, None]
        steps *= rng.choice(STEPS, size=(count, 1)) + longer
        # a density shifts by whole nodes
        nodes = algebra.product(steps, self._responses[0])
        whole = np.rint(nodes) * (rng.random(count) < SHIFTED)
        there = whole != 0
        steps[there] *= (whole[there] / nodes[there])[:, None]
        return steps, whole.astype(np.int64)

    def _moved_scalars(self) -> None:
        """Move the scalars, or stay, with a density that adapts to them; the last move opens or completes the density."""
        problem, rng, direction = self.problem, self.rng, self._scaling
        moves = MOVED[0] + MOVED[1] * self.scalars.size
        steps, nodes = self._steps(1 if self._common.all() else moves)
        ways = np.full((len(steps), 2), np.nan)
        if direction.any():
            there = direction != 0
            width = float(np.mean(self._widths[there] / direction[there]))
            steps = np.concatenate([steps, direction[None]])
            ways = np.concatenate([ways, [[width, rng.standard_normal()]]])
            nodes = np.append(nodes, 0)
        state = np.array([self.choice, self.complete])
        kernels.scalars_moved(
            self.x,
            self.scalars,
            state,
            LEVEL,
            *problem.prior.precisions,
            (STRENGTHS.size, float(np.log(STRENGTHS[1] / STRENGTHS[0]))),
            problem.areas,
            self._measured,
            self._data,
            self._priors,
            steps,
            ways,
            nodes,
            rng.random((len(steps), 3 + kernels.SHIFTED, 2)),
        )
        self.choice, self.complete = int(state[0]), bool(state[1])
        self._rows = None


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
    done, more = 0, each
    while True:
        if progress:
            progress(done, sweeps)
        run(chains, more, workers)
        done += more
        densities = np.stack([chain.densities for chain in chains])
        seen = densities[:, :, watched] if watched.any() else densities
        found = [(*convergence(seen), AGREED)]
        for of, end in (_errors, AGREED), (_scalars, SCALARS_AGREED):
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
        learn(chains)
        more = min(-(-done // 8), sweeps - done)
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
        learn(chains)


def learn(chains: Sequence[Chain]) -> None:
    """Let chains move by differences between the later half of what all have made."""
    half = len(chains[0].places) // 2
    places = [place for chain in chains for place in chain.places[half:]]
    processes = np.concatenate([chain.processes[half:] for chain in chains])
    guide = Guide(
        processes[:: max(len(processes) // ARCHIVE, 1)],
        np.array([place.scalars for place in places]),
    )
    for chain in chains:
        chain.guide = guide


def _scalars(chain: Chain, place: ChainPosition) -> np.ndarray:
    return place.scalars


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
