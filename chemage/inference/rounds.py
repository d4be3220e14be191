"""From the curves to samples of the posterior, in rounds.

With an interaction the model is linear about the density that is looked for, at which the kinetics of the sites are
simulated.
"""

from __future__ import annotations

import numpy as np

from chemage.foundation.progress import Report
from chemage.inference.assembly import Model
from chemage.inference.estimate import check_explained, first_estimate, smooth_fit
from chemage.inference.prior import Prior
from chemage.inference.problem import Problem, Scalars
from chemage.inference.sampling import Samples, sample

#: rounds of Gauss-Newton steps, each with kinetics simulated at its density; steps in a round
ROUNDS, STEPS = 4, 6
#: change of the density, integrated over the visible energies, that ends the iteration
CONVERGED = 0.01
#: samples of short runs, and sweeps of their chains
SHORT, SHORT_SWEEPS = 400, 200


def estimated(model: Model, threads: int | None, report: Report) -> tuple[np.ndarray, list[float]]:
    """The density of best fit, smoothed, and how much each round of the interaction changed it."""
    values, factor = model.values, model.unknowns.factor
    if model.unknowns.points > 1:
        model.middle = _best_point(model)
    middle = model.middle
    matrix = model.without_neighbours(middle)
    errors = model.errors(values)
    if not model.interacting:
        check_explained(model.grid, matrix, values, errors, np.zeros(values.size), model.labels(), _bounds(factor))
        return first_estimate(model.grid, _scaled(model, matrix), values, errors), []
    density = first_estimate(model.grid, _scaled(model, matrix), values, errors)
    seen, changes = model.seen(), []
    total = ROUNDS * STEPS
    for number in range(ROUNDS):
        before = density
        for step in range(STEPS):
            report("interaction", number * STEPS + step, total)
            fitted, slope = model.linear(density, middle)
            offset = fitted - slope @ density
            scale = _common_factor(model, fitted)
            found = first_estimate(model.grid, scale * slope, values - scale * offset, model.errors(values))
            # full steps in the end, half ones while the neighbours' part still changes much
            change = _distance(model, found, density, seen)
            density = found if change < 0.1 else 0.5 * (found + density)
            if change < CONVERGED:
                break
        changes.append(_distance(model, density, before, seen))
        model.calibrate(density, threads)
        if number and changes[-1] < CONVERGED:
            break
    fitted, slope = model.linear(density, middle)
    check_explained(
        model.grid, slope, values, model.errors(values), fitted - slope @ density, model.labels(), _bounds(factor)
    )
    report("interaction", total, total)
    return density, changes


def _best_point(model: Model) -> int:
    """The point of the grid of scalars at which a density fits best, the neighbours left out."""
    found = []
    for point in range(model.unknowns.points):
        matrix = _scaled(model, model.without_neighbours(point))
        found.append(smooth_fit(model.grid, matrix, model.values, model.errors(model.values), 1e-11)[1])
    return int(np.argmin(found))


def _bounds(factor: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if factor is None else (float(np.exp(factor[0])), float(np.exp(factor[1])))


def _scaled(model: Model, matrix: np.ndarray) -> np.ndarray:
    """The derivative, times a common factor with which some density reaches the largest value."""
    return matrix * _common_factor(model, matrix @ np.full(model.grid.count, 0.9 / model.grid.areas.sum()))


def _common_factor(model: Model, fitted: np.ndarray) -> float:
    if model.unknowns.factor is None:
        return 1.0
    ratio = float(np.log(max(model.values.max(), 1e-12) / max(fitted.max(), 1e-12)))
    return float(np.exp(np.clip(ratio, *model.unknowns.factor)))


def _distance(model: Model, one: np.ndarray, other: np.ndarray, seen: np.ndarray) -> float:
    return float((np.abs(one - other) * model.grid.areas)[seen].sum())


def linear_problem(model: Model, prior: Prior, density: np.ndarray) -> Problem:
    """The linear model of all points of the grid of scalars about ``density``."""
    matrices, offsets = [], []
    for point in range(model.unknowns.points):
        value, slope = model.linear(density, point)
        matrices.append(slope)
        offsets.append(value - slope @ density)
    unknowns = model.unknowns
    return Problem(
        prior,
        model.grid.areas,
        model.values,
        model.errors(model.values),
        np.stack(matrices),
        np.stack(offsets),
        Scalars(
            unknowns.values,
            unknowns.neighbours,
            "bond_force" if unknowns.factor is not None else "",
            unknowns.factor or (0.0, 0.0),
            model.middle,
        ),
    )


def sampled(
    model: Model, density: np.ndarray, samples: int, threads: int | None, report: Report, changes: list[float]
) -> tuple[Problem, Samples, list[float]]:
    """Samples of the posterior; with an interaction the model is linear about their mean."""
    prior = Prior(model.grid.nodes)
    start = np.where(density > 1e-6, density, -0.1)
    if model.interacting:
        seen = model.seen()
        for number in range(2):
            few = short(linear_problem(model, prior, density), start, model.seed + number, threads)
            mean = few.densities.mean(axis=0)
            changes = [*changes, _distance(model, mean, density, seen)]
            density = mean
            model.linear(density, model.middle)
            model.calibrate(density, threads)
            if changes[-1] < CONVERGED:
                break
        start = np.where(density > 1e-3, density, -0.1)
    problem = linear_problem(model, prior, density)
    found = sample(
        problem,
        start,
        samples=samples,
        seed=model.seed,
        watched=model.seen(),
        threads=threads,
        progress=lambda done, total: report("sampling", done, total),
    )
    return problem, found, changes


def short(problem: Problem, start: np.ndarray, seed: int, threads: int | None) -> Samples:
    """Fewer samples, where their mean and covariance are enough."""
    return sample(problem, start, samples=SHORT, seed=seed, sweeps=SHORT_SWEEPS, threads=threads)
