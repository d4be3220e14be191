"""Parametric families of densities, fitted by least squares and compared by what they predict of points left out.

From the curves to samples of the posterior: the smooth density that fits best, whether any does, and rounds.

With an interaction the model is linear about the density that is looked for, at which the kinetics of the sites are
simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from chemage.plugin import algebra, progress
from chemage_inference import kernels
from chemage_inference.energies import EnergyGrid
from chemage_inference.forward import Model
from chemage_inference.problem import REACH, Linear, Prior, Problem
from chemage_inference.result import UnexplainedError
from chemage_inference.sampling import MOST_SWEEPS, Guide, Samples, sample

#: weights of the penalty on the second derivative that are tried, from strong to weak
WEIGHTS = np.geomspace(1.0, 1e-7, 15)
#: probability of a larger χ² by chance below which no density explains the data
UNLIKELY = 1e-4
#: rounds of Gauss-Newton steps, each with kinetics simulated at its density; steps in a round
ROUNDS, STEPS = 4, 6
#: change of the density, integrated over the visible energies, that ends the iteration
CONVERGED = 0.01
#: rounds in which the errors are guessed, and the effective parameters of a density meanwhile
GUESSES, PARAMETERS = 3, 7
#: samples of short runs, and sweeps of their chains
SHORT, SHORT_SWEEPS = 400, 200


class SmoothFit(NamedTuple):
    """A density that fits best."""

    #: (n,) 1/eV
    density: np.ndarray
    chi2: float
    #: (m,) as the instruments measure them
    fitted: np.ndarray
    #: (q,) nuisances, in their standard deviations
    nuisances: np.ndarray


def smooth_fit(data: Linear, weight: float, factor: float = 1.0) -> SmoothFit:
    """The density (n,) ≥ 0 of integral at most 1 and the nuisances z of least χ² + z² + ``weight`` × ∫ p''²."""
    grid, shared = data.grid, data.nuisances
    count = shared.shape[1]
    matrix = factor * data.matrix
    values = data.values - factor * data.offset
    second = (
        np.diff(np.eye(grid.count), 2, axis=0)
        * np.sqrt(weight * grid.step)
        / grid.step**2
    )
    # one more unknown, the share above the last energy, completes the integral to 1
    limit = np.append(grid.areas, 1.0)[None] / 1e-3
    rows = np.concatenate([matrix / data.errors[:, None], second])
    rows = np.concatenate([np.pad(rows, ((0, 0), (0, 1))), limit])
    goal = np.concatenate([values / data.errors, np.zeros(len(second)), [1e3]])
    if count:  # each is the difference of two that are not negative
        each, below = shared / data.errors[:, None], len(second) + 1
        each = np.concatenate([each, np.zeros((below, count)), np.eye(count)])
        rows = np.pad(rows, ((0, count), (0, 0)))
        rows = np.concatenate([rows, each, -each], axis=1)
        goal = np.append(goal, np.zeros(count))
    found = algebra.nonnegative(rows.T.copy(), goal)
    density, ends = found[: grid.count], found[grid.count + 1 :].reshape(2, -1)
    density /= max(1.0, float(algebra.product(density, grid.areas)))
    nuisances = ends[0] - ends[1]
    fitted = algebra.product(matrix, density)
    if count:
        fitted += algebra.product(shared, nuisances)
    chi2 = float(np.sum(((fitted - values) / data.errors) ** 2))
    return SmoothFit(density, chi2, factor * data.offset + fitted, nuisances)


def first_estimate(data: Linear, factor: float) -> np.ndarray:
    """The smoothest density whose χ² does not exceed the number of values, or nearly the least χ² if none does."""
    best, least = np.zeros(0), np.inf
    for weight in WEIGHTS * 1e-4:
        density, chi2, *_ = smooth_fit(data, float(weight), factor)
        if chi2 < 0.95 * least:
            best, least = density, chi2
        if chi2 <= data.values.size:
            break
    return best


def check_explained(
    data: Linear,
    labels: list[str],
    largest: np.ndarray,
    stated: np.ndarray,
    hints: Sequence[str] = (),
) -> None:
    """Refuse data that no non-negative density of integral at most 1 explains; ``labels`` name the values.

    ``hints`` are possible reasons. Errors (m,) are at most ``largest``; messages count in those that are ``stated``.

    Raises
    ------
    UnexplainedError
        With the best fit, its χ², and where it fails.
    """
    from scipy.stats import chi2 as distribution

    data = replace(data, errors=largest)
    values, errors, grid = data.values, stated, data.grid
    factors = [1.0] if data.factor is None else np.exp(np.linspace(*data.factor, 9))
    fits = [smooth_fit(data, 1e-12, float(factor)) for factor in factors]
    density, chi2, fitted, _ = min(fits, key=lambda fit: fit.chi2)
    if distribution.sf(chi2, values.size) >= UNLIKELY:
        return
    residuals = (values - fitted) / errors
    chi2, scaled = float(residuals @ residuals), np.any(largest > 1.01 * stated)
    worst = np.argsort(-np.abs(residuals))[:3]
    places = "; ".join(
        f"{residuals[at]:+.1f} standard errors at {labels[at]}"
        for at in sorted(worst)
    )
    share = float(algebra.product(density, grid.areas))
    why = list(hints)
    above = values - fitted
    if share > 0.99 and np.sum(above / errors) > 0:
        why.append(
            "all sites of the contact would have to be bonded and more, so that bond_force, site_density or the "
            "contact area of the scene is too small"
        )
    if np.any(values < -3 * errors):
        why.append(
            "values are below zero, but bonds that form can only add; check their sign and what they are counted from"
        )
    if np.any(residuals[1:] > 3) and np.any(residuals[:-1] < -3):
        why.append(
            "the curve rises faster with the hold time than a single barrier makes it, or its errors are too small"
        )
    if scaled:
        why.append(
            "errors up to five times the stated ones, and single points that are off, would not explain it"
        )
    raise UnexplainedError(
        f"values: no density of barriers explains them; the best fit has χ² = {chi2:.1f} for {values.size} points, "
        f"and is off by {places}"
        + "".join(f"; {reason}" for reason in why)
        + "; check units, errors, load and scene",
        energies=grid.nodes,
        density=density,
        fitted=fitted,
        residuals=residuals,
        chi2=chi2,
    )


def estimated(
    model: Model, threads: int | None, report: progress.Report
) -> tuple[np.ndarray, list[float]]:
    """The density of best fit, smoothed, and how much each round of the interaction changed it."""
    if model.unknowns.points > 1:
        model.middle = _best_point(model)
    data, factor = _alone(model, model.middle)
    data = _with_guessed_errors(model, data)
    if not model.interacting:
        _check_model(model, data)
        return first_estimate(data, factor), []
    density = first_estimate(data, factor)
    seen, changes = model.seen(), []
    total = ROUNDS * STEPS
    for number in range(ROUNDS):
        before = density
        for step in range(STEPS):
            report("interaction", number * STEPS + step, total)
            fitted, data = _about(model, density)
            if number and not step:
                data = _with_guessed_errors(model, data)
            fit = first_estimate(data, _common_factor(data, fitted))
            # full steps in the end, half ones while the neighbours' part still changes much
            change = _distance(model, fit, density, seen)
            density = fit if change < 0.1 else 0.5 * (fit + density)
            if change < CONVERGED:
                break
        changes.append(_distance(model, density, before, seen))
        model.calibrate(density, threads)
        if number and changes[-1] < CONVERGED:
            break
    _check_model(model, _about(model, density)[1])
    report("interaction", total, total)
    return density, changes


def _best_point(model: Model) -> int:
    """The point of the grid of scalars at which a density fits best, the neighbours left out: a pattern search."""
    nodes = model.unknowns.nodes
    priors = model.unknowns.priors[: nodes.shape[1]]

    @cache
    def misfit(point: int) -> float:
        data, factor = _alone(model, point)
        prior = kernels.log_prior_of(nodes[point].astype(float), priors)
        return smooth_fit(data, 1e-11, factor).chi2 - 2 * prior

    best, step = model.middle, int(nodes.max() + 1) // 4
    while step:
        away = np.abs(nodes - nodes[best])
        near = np.flatnonzero(
            (away.sum(axis=1) == step) & (away.max(axis=1) == step)
        )
        other = min(map(int, near), key=misfit, default=best)
        if misfit(other) < misfit(best):
            best = other
        else:
            step //= 2
    return best


def _with_guessed_errors(model: Model, data: Linear) -> Linear:
    """The data with errors with which about the smooth density of least χ² explains them; points that are off last."""
    noise = model.noise
    if noise.fixed:
        return replace(data, errors=model.errors)
    model.state = noise.start
    factors = np.unique(np.exp(np.linspace(*(data.factor or (0.0, 0.0)), 5)))
    for _ in range(GUESSES):
        data = replace(data, errors=noise.errors(model.state))
        fits = [smooth_fit(data, 1e-11, float(factor)) for factor in factors]
        best = min(fits, key=lambda fit: fit.chi2)
        guessed = noise.guessed(data.values - best.fitted, PARAMETERS)
        model.state = replace(guessed, nuisances=noise.widths * best.nuisances)
    return replace(data, errors=model.errors)


def _check_model(model: Model, data: Linear) -> None:
    noise = model.noise
    cold = (curve.question for curve in model.curves)
    check_explained(
        data,
        model.labels(),
        noise.largest(model.state),
        noise.errors(noise.start),
        [hint for hint in cold if hint],
    )


def _alone(model: Model, point: int) -> tuple[Linear, float]:
    """The linear model without neighbours, and a common factor with which some density reaches the largest value."""
    matrix = model.without_neighbours(point)
    data = _linear(model, matrix, np.zeros(model.values.size))
    return data, _common_factor(
        data,
        algebra.product(
            matrix, np.full(model.grid.count, 0.9 / model.grid.areas.sum())
        ),
    )


def _common_factor(data: Linear, fitted: np.ndarray) -> float:
    if data.factor is None:
        return 1.0
    ratio = float(np.log(max(data.values.max(), 1e-12) / max(fitted.max(), 1e-12)))
    return float(np.exp(np.clip(ratio, *data.factor)))


def _linear(model: Model, matrix: np.ndarray, offset: np.ndarray) -> Linear:
    return Linear(
        model.grid,
        matrix,
        offset,
        model.values,
        model.errors,
        model.unknowns.factor,
        model.noise.linear(model.values),
    )


def _about(model: Model, density: np.ndarray) -> tuple[np.ndarray, Linear]:
    """The values of the model at a density, and the model linear about it."""
    fitted, slope = model.linear(density, model.middle)
    return fitted, _linear(model, slope, fitted - algebra.product(slope, density))


def _distance(
    model: Model, density: np.ndarray, other: np.ndarray, seen: np.ndarray
) -> float:
    return float((np.abs(density - other) * model.grid.areas)[seen].sum())


def linear_problem(model: Model, prior: Prior, density: np.ndarray) -> Problem:
    """The linear model of all points of the grid of scalars about ``density``."""
    matrices, offsets = [], []
    for point in range(model.unknowns.points):
        value, slope = model.linear(density, point)
        matrices.append(slope)
        offsets.append(value - algebra.product(slope, density))
    unknowns, coefficients = model.unknowns, model.unknowns.coefficients
    known = prior, model.grid.areas, model.values, model.noise
    arrays = coefficients(np.stack(matrices)), coefficients(np.stack(offsets))
    return Problem(*known, *arrays, unknowns, model.middle, model.state)


def sampled(
    model: Model,
    density: np.ndarray,
    count: int,
    threads: int | None,
    report: progress.Report,
    changes: list[float],
    sweeps: int = MOST_SWEEPS,
) -> tuple[Problem, Samples, list[float]]:
    """``count`` samples of the posterior; with an interaction the model is linear about their mean."""
    prior = Prior(model.grid.nodes)
    start = np.where(density > 1e-6, density, -0.1)
    if model.interacting:
        seen = model.seen()
        for number in range(2):
            few = short(
                linear_problem(model, prior, density),
                start,
                model.seed + number,
                threads,
            )
            mean = few.densities.mean(axis=0)
            changes = [*changes, _distance(model, mean, density, seen)]
            density = mean
            model.linear(density, model.middle)
            model.calibrate(density, threads)
            if changes[-1] < CONVERGED:
                break
        start = np.where(density > 1e-3, density, -0.1)
    problem = linear_problem(model, prior, density)
    samples = sample(
        problem,
        start,
        samples=count,
        seed=model.seed,
        watched=model.seen(),
        sweeps=sweeps,
        threads=threads,
        progress=lambda done, total: report("sampling", done, total),
    )
    return problem, samples, changes


def short(
    problem: Problem,
    start: np.ndarray,
    seed: int,
    threads: int | None,
    guide: Guide | None = None,
) -> Samples:
    """Fewer samples, where their mean and covariance are enough."""
    return sample(
        problem,
        start,
        samples=SHORT,
        seed=seed,
        # chains that are guided need not learn
        sweeps=SHORT_SWEEPS // (2 if guide else 1),
        threads=threads,
        guide=guide,
    )


#: contiguous blocks of hold times, of which one after the other is left out
BLOCKS = 5
#: starting points of a fit along each of the first two parameters
STARTS = 5
#: nodes of the piecewise linear family
NODES = 6


@dataclass(frozen=True)
class Family:
    """A density with a few parameters θ, of which the last may be the logarithm of an unknown common factor."""

    data: Linear
    parameters: tuple[str, ...]
    #: (E, θ) -> share of the barriers below E
    below: Callable[[np.ndarray, np.ndarray], np.ndarray]
    #: starting points, lower and upper bounds of θ
    starts: list[np.ndarray]
    lower: np.ndarray
    upper: np.ndarray

    def density(self, grid: EnergyGrid, theta: np.ndarray) -> np.ndarray:
        """(n,) 1/eV: means over the cell of each node; what lies below the first is added to it."""
        edges = grid.nodes[0] + grid.step * (np.arange(grid.count + 1) - 0.5)
        share = np.diff(self.below(edges, theta))
        share[0] += self.below(edges[:1], theta)[0]
        return share / grid.areas

    def predicted(self, theta: np.ndarray) -> np.ndarray:
        """(m,) values."""
        data = self.data
        scale = 1.0 if data.factor is None else np.exp(theta[-1])
        return scale * (data.offset + data.matrix @ self.density(data.grid, theta))

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """(m, θ): change of the values with each parameter."""
        steps = 1e-3 * np.eye(theta.size)
        ends = [self.predicted(theta + step) for step in (*steps, *-steps)]
        return np.subtract(*np.split(np.stack(ends, axis=1), 2, axis=1)) / 2e-3

    def fit(self, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Parameters of least χ² among the points ``kept``, their covariance, and χ²."""
        from scipy.optimize import least_squares

        data, lower, upper = self.data, self.lower, self.upper

        def residuals(theta: np.ndarray) -> np.ndarray:
            return ((self.predicted(theta) - data.values) / data.errors)[kept]

        starts = [np.clip(it, lower + 1e-6, upper - 1e-6) for it in self.starts]
        starts.sort(key=lambda start: float(np.sum(residuals(start) ** 2)))
        how: dict[str, Any] = {"bounds": (lower, upper), "max_nfev": 200}
        fits = [
            least_squares(
                residuals, start, x_scale=np.maximum(np.abs(start), 0.05), **how
            )
            for start in starts[:4]
        ]
        best = min(fits, key=lambda fit: fit.cost)
        theta, chi2 = best.x, 2 * float(best.cost)
        slope = (self.slope(theta) / data.errors[:, None])[kept]
        # what the data do not know is known to within the bounds
        precision = slope.T @ slope + np.diag(12 / (upper - lower) ** 2)
        # a fit that is off makes its own prediction uncertain
        inflation = max(1.0, chi2 / max(int(kept.sum()) - theta.size, 1))
        return theta, inflation * np.linalg.inv(precision), chi2

    def about(self) -> dict[str, Any]:
        """The fit to all points."""
        theta, covariance, chi2 = self.fit(np.ones(self.data.values.size, bool))
        errors, wide = np.sqrt(np.diag(covariance)), self.data.grid.wider(*REACH)
        density = self.density(wide, theta)
        if self.data.factor is not None:
            theta[-1] = np.exp(theta[-1])
            errors[-1] *= theta[-1]
        return {
            "parameters": dict(zip(self.parameters, theta.tolist(), strict=True)),
            "errors": dict(zip(self.parameters, errors.tolist(), strict=True)),
            "chi2": chi2,
            "density": density.tolist(),
        }

    def beyond(self, out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of the points ``out`` that the fit to all others predicts."""
        theta, covariance, _ = self.fit(~out)
        slope = self.slope(theta)[out]
        return self.predicted(theta)[out], slope @ covariance @ slope.T


def _uniform(energy: np.ndarray, theta: np.ndarray) -> np.ndarray:
    return np.clip((energy - theta[0]) / theta[1], 0.0, 1.0)


def _triangle(energy: np.ndarray, theta: np.ndarray) -> np.ndarray:
    peak, left, right = theta[:3]
    rise = np.clip(energy - peak + left, 0, left) ** 2 / (left * (left + right))
    fall = np.clip(peak + right - energy, 0, right) ** 2 / (right * (left + right))
    return np.where(energy < peak, rise, 1 - fall)


def _gaussian(energy: np.ndarray, theta: np.ndarray) -> np.ndarray:
    from scipy.special import ndtr

    return ndtr((energy - theta[0]) / theta[1])


def _piecewise(
    nodes: np.ndarray, energy: np.ndarray, theta: np.ndarray
) -> np.ndarray:
    logs = np.append(theta[: NODES - 1], 0.0)
    heights, steps = np.exp(logs - logs.max()), np.diff(nodes)
    sums = np.append(0.0, np.cumsum((heights[1:] + heights[:-1]) / 2 * steps))
    place = np.clip(np.searchsorted(nodes, energy, side="right") - 1, 0, NODES - 2)
    part = np.clip(energy - nodes[place], 0.0, steps[place])
    slope = np.diff(heights)[place] / steps[place]
    return (sums[place] + heights[place] * part + slope * part**2 / 2) / sums[-1]


def family(name: str, low: float, high: float, data: Linear) -> Family:
    """The family of a name; ``low`` to ``high`` are the energies that the data see, eV."""
    if name == "piecewise":
        nodes, count = np.linspace(low, high + 0.3, NODES), NODES - 1
        what = "log weight at {:.3f} eV over that at {:.3f} eV"
        names = tuple(what.format(node, nodes[-1]) for node in nodes[:-1])
        below = partial(_piecewise, nodes)
        starts = [np.linspace(first, 0, count) for first in (0.0, -2.0, 2.0)]
        lower, upper = np.full(count, -8.0), np.full(count, 8.0)
    else:
        names, below, widths, first, last = {
            "uniform": (("lowest (eV)", "width (eV)"), _uniform, (0.1, 0.4, 0.8), (-0.5, 0.01), (0.3, 3.0)),
            "triangle": (
                ("peak (eV)", "rise (eV)", "fall (eV)"), _triangle, (0.1, 0.4), (-0.3, 0.01, 0.01), (0.5, 2.0, 2.0)
            ),
            "gaussian": (
                ("mean (eV)", "standard deviation (eV)"), _gaussian, (0.05, 0.2, 0.4), (-0.5, 0.005), (1.0, 1.5)
            ),
        }[name]  # fmt: skip
        # the first parameter is an energy, the others are widths
        lower, upper = np.array(first), np.array(last)
        lower[0], upper[0] = low + lower[0], high + upper[0]
        starts = [
            np.append(at, np.full(len(names) - 1, width))
            for at in np.linspace(low, high, STARTS)
            for width in widths
        ]
    if data.factor is not None:
        names = (*names, "bond_force over that of the scene")
        starts = [np.append(start, 0.0) for start in starts]
        lower, upper = (
            np.append(*ends)
            for ends in zip((lower, upper), data.factor, strict=True)
        )
    return Family(data, names, below, starts, lower, upper)


def blocks_of(curve: np.ndarray, hold_times: np.ndarray) -> np.ndarray:
    """(m,) number of the block of each point: contiguous hold times of each curve."""
    blocks = np.zeros(curve.size, dtype=np.int64)
    for number in np.unique(curve):
        here = np.flatnonzero(curve == number)
        rank = np.argsort(
            np.argsort(hold_times[here], kind="stable"), kind="stable"
        )
        blocks[here] = rank * min(BLOCKS, here.size) // here.size
    return blocks


def score(
    data: Linear,
    blocks: np.ndarray,
    beyond: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
) -> float:
    """Logarithm of the normal density of the values of each block, whose mean and covariance ``beyond`` predicts."""
    total = 0.0
    for block in np.unique(blocks):
        out = blocks == block
        mean, covariance = beyond(out)
        lower = np.linalg.cholesky(covariance + np.diag(data.errors[out] ** 2))
        away = np.linalg.solve(lower, data.values[out] - mean)
        total -= 0.5 * (away @ away + mean.size * np.log(2 * np.pi))
        total -= np.log(np.diag(lower)).sum()
    return float(total)


def compared(
    model: Model,
    problem: Problem,
    samples: Samples,
    families: Sequence[str],
    threads: int | None,
    report: progress.Report,
) -> tuple[dict[str, float], dict[str, Any]]:
    """Scores of the smooth density and of the families on hold times left out, and the fits of the families."""
    if not families:
        return {}, {}
    problem = problem.settled(samples.typical)
    blocks = blocks_of(model.curve, model.hold_times)
    first = int(blocks.max()) + 1
    total = first + len(families)
    seen = model.grid.nodes[model.seen()]
    low, high = (seen if seen.size else model.grid.nodes)[[0, -1]].tolist()
    mean = samples.densities.mean(axis=0)
    start = np.where(mean > 1e-3, mean, -0.1)
    middle = np.median(samples.positions, axis=0, keepdims=True)
    data = Linear(
        model.grid,
        *problem.at(problem.unknowns.weights(middle)[0]),
        problem.values,
        problem.errors,
        model.unknowns.factor,
    )

    def beyond(out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        block = int(blocks[out][0])
        report("families", block, total)
        left, seed = problem.without(out), model.seed + 100 + block
        few = short(left, start, seed, threads, samples.guide)
        values = few.fitted(problem)[:, out]
        return values.mean(axis=0), np.atleast_2d(np.cov(values.T))

    scores, fits = {"density": score(data, blocks, beyond)}, {}
    for number, name in enumerate(families):
        report("families", first + number, total)
        chosen = family(name, low, high, data)
        fits[name], scores[name] = (
            chosen.about(),
            score(data, blocks, chosen.beyond),
        )
    report("families", total, total)
    return scores, fits
