"""From the curves to samples of the posterior: the smooth density that fits best, whether any does, and rounds.

With an interaction the model is linear about the density that is looked for, at which the kinetics of the sites are
simulated.
"""

from __future__ import annotations

import numpy as np

from chemage.foundation.progress import Report
from chemage.inference.forward import Model
from chemage.inference.problem import Linear, Prior, Problem
from chemage.inference.result import UnexplainedError
from chemage.inference.sampling import Samples, sample

#: weights of the penalty on the second derivative that are tried, from strong to weak
WEIGHTS = np.geomspace(1.0, 1e-7, 15)
#: probability of a larger χ² by chance below which no density explains the data
UNLIKELY = 1e-4
#: rounds of Gauss-Newton steps, each with kinetics simulated at its density; steps in a round
ROUNDS, STEPS = 4, 6
#: change of the density, integrated over the visible energies, that ends the iteration
CONVERGED = 0.01
#: samples of short runs, and sweeps of their chains
SHORT, SHORT_SWEEPS = 400, 200


def smooth_fit(data: Linear, weight: float, factor: float = 1.0) -> tuple[np.ndarray, float]:
    """The density (n,) ≥ 0 of least χ² + ``weight`` × ∫ p''² of integral at most 1, and its χ²."""
    from scipy.optimize import nnls

    grid, matrix, values = data.grid, factor * data.matrix, data.values - factor * data.offset
    second = np.diff(np.eye(grid.count), 2, axis=0) * np.sqrt(weight * grid.step) / grid.step**2
    # one more unknown, the share above the last energy, completes the integral to 1
    limit = np.append(grid.areas, 1.0)[None] / 1e-3
    rows = np.concatenate([matrix / data.errors[:, None], second])
    rows = np.concatenate([np.pad(rows, ((0, 0), (0, 1))), limit])
    goal = np.concatenate([values / data.errors, np.zeros(len(second)), [1e3]])
    density = nnls(rows, goal, maxiter=50 * rows.shape[1])[0][:-1]
    density /= max(1.0, float(density @ grid.areas))
    return density, float(np.sum(((matrix @ density - values) / data.errors) ** 2))


def first_estimate(data: Linear, factor: float) -> np.ndarray:
    """The smoothest density whose χ² does not exceed the number of values, or nearly the least χ² if none does."""
    best, least = np.zeros(0), np.inf
    for weight in WEIGHTS * 1e-4:
        density, chi2 = smooth_fit(data, float(weight), factor)
        if chi2 < 0.95 * least:
            best, least = density, chi2
        if chi2 <= data.values.size:
            break
    return best


def check_explained(data: Linear, labels: list[str]) -> None:
    """Refuse data that no non-negative density of integral at most 1 explains; ``labels`` name the values.

    Raises
    ------
    UnexplainedError
        With the best fit, its χ², and where it fails.
    """
    from scipy.stats import chi2 as distribution

    values, errors, grid = data.values, data.errors, data.grid
    fits = []
    for factor in [1.0] if data.factor is None else np.geomspace(np.exp(data.factor[0]), np.exp(data.factor[1]), 9):
        density, chi2 = smooth_fit(data, 1e-12, factor)
        fits.append((chi2, density, factor * (data.offset + data.matrix @ density)))
    chi2, density, fitted = min(fits, key=lambda fit: fit[0])
    if distribution.sf(chi2, values.size) >= UNLIKELY:
        return
    residuals = (values - fitted) / errors
    worst = np.argsort(-np.abs(residuals))[:3]
    places = "; ".join(f"{residuals[at]:+.1f} standard errors at {labels[at]}" for at in sorted(worst))
    share = float(density @ grid.areas)
    why = []
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
    raise UnexplainedError(
        f"values: no density of barriers explains them; the best fit has χ² = {chi2:.1f} for {values.size} points, "
        f"and is off by {places}" + "".join(f"; {reason}" for reason in why) + "; check units, errors, load and scene",
        energies=grid.nodes,
        density=density,
        fitted=fitted,
        residuals=residuals,
        chi2=chi2,
    )


def estimated(model: Model, threads: int | None, report: Report) -> tuple[np.ndarray, list[float]]:
    """The density of best fit, smoothed, and how much each round of the interaction changed it."""
    if model.unknowns.points > 1:  # the point at which a density fits best, the neighbours left out
        alone = (_alone(model, point) for point in range(model.unknowns.points))
        model.middle = int(np.argmin([smooth_fit(data, 1e-11, factor)[1] for data, factor in alone]))
    data, factor = _alone(model, model.middle)
    if not model.interacting:
        check_explained(data, model.labels())
        return first_estimate(data, factor), []
    density = first_estimate(data, factor)
    seen, changes = model.seen(), []
    total = ROUNDS * STEPS
    for number in range(ROUNDS):
        before = density
        for step in range(STEPS):
            report("interaction", number * STEPS + step, total)
            fitted, slope = model.linear(density, model.middle)
            data = _linear(model, slope, fitted - slope @ density)
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
    fitted, slope = model.linear(density, model.middle)
    check_explained(_linear(model, slope, fitted - slope @ density), model.labels())
    report("interaction", total, total)
    return density, changes


def _alone(model: Model, point: int) -> tuple[Linear, float]:
    """The linear model without neighbours, and a common factor with which some density reaches the largest value."""
    matrix = model.without_neighbours(point)
    data = _linear(model, matrix, np.zeros(model.values.size))
    return data, _common_factor(data, matrix @ np.full(model.grid.count, 0.9 / model.grid.areas.sum()))


def _common_factor(data: Linear, fitted: np.ndarray) -> float:
    if data.factor is None:
        return 1.0
    ratio = float(np.log(max(data.values.max(), 1e-12) / max(fitted.max(), 1e-12)))
    return float(np.exp(np.clip(ratio, *data.factor)))


def _linear(model: Model, matrix: np.ndarray, offset: np.ndarray) -> Linear:
    return Linear(model.grid, matrix, offset, model.values, model.errors(model.values), model.unknowns.factor)


def _distance(model: Model, density: np.ndarray, other: np.ndarray, seen: np.ndarray) -> float:
    return float((np.abs(density - other) * model.grid.areas)[seen].sum())


def linear_problem(model: Model, prior: Prior, density: np.ndarray) -> Problem:
    """The linear model of all points of the grid of scalars about ``density``."""
    matrices, offsets = [], []
    for point in range(model.unknowns.points):
        value, slope = model.linear(density, point)
        matrices.append(slope)
        offsets.append(value - slope @ density)
    errors, at = model.errors(model.values), (model.unknowns, model.middle)
    return Problem(prior, model.grid.areas, model.values, errors, np.stack(matrices), np.stack(offsets), *at)


def sampled(
    model: Model, density: np.ndarray, count: int, threads: int | None, report: Report, changes: list[float]
) -> tuple[Problem, Samples, list[float]]:
    """``count`` samples of the posterior; with an interaction the model is linear about their mean."""
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
    samples = sample(
        problem,
        start,
        samples=count,
        seed=model.seed,
        watched=model.seen(),
        threads=threads,
        progress=lambda done, total: report("sampling", done, total),
    )
    return problem, samples, changes


def short(problem: Problem, start: np.ndarray, seed: int, threads: int | None) -> Samples:
    """Fewer samples, where their mean and covariance are enough."""
    return sample(problem, start, samples=SHORT, seed=seed, sweeps=SHORT_SWEEPS, threads=threads)
