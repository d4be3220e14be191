"""The smooth non-negative density that fits measured values best, from which sampling begins; and whether any fits."""

from __future__ import annotations

import numpy as np

from chemage.inference.kernel import EnergyGrid
from chemage.inference.unexplained import UnexplainedError

#: weights of the penalty on the second derivative that are tried, from strong to weak
WEIGHTS = np.geomspace(1.0, 1e-7, 15)
#: probability of a larger χ² by chance below which no density explains the data
UNLIKELY = 1e-4


def smooth_fit(
    grid: EnergyGrid, matrix: np.ndarray, values: np.ndarray, errors: np.ndarray, weight: float
) -> tuple[np.ndarray, float]:
    """The density (n,) ≥ 0 of least χ² + ``weight`` × ∫ p''² of integral at most 1, and its χ²."""
    from scipy.optimize import nnls

    second = np.diff(np.eye(grid.count), 2, axis=0) * np.sqrt(weight * grid.step) / grid.step**2
    # one more unknown, the share above the last energy, completes the integral to 1
    limit = np.append(grid.areas, 1.0)[None] / 1e-3
    rows = np.concatenate([matrix / errors[:, None], second])
    rows = np.concatenate([np.pad(rows, ((0, 0), (0, 1))), limit])
    goal = np.concatenate([values / errors, np.zeros(len(second)), [1e3]])
    found = nnls(rows, goal, maxiter=50 * rows.shape[1])[0][:-1]
    found /= max(1.0, float(found @ grid.areas))
    return found, float(np.sum(((matrix @ found - values) / errors) ** 2))


def first_estimate(grid: EnergyGrid, matrix: np.ndarray, values: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """The smoothest density whose χ² does not exceed the number of values, or nearly the least χ² if none does."""
    best, least = None, np.inf
    for weight in WEIGHTS * 1e-4:
        density, chi2 = smooth_fit(grid, matrix, values, errors, float(weight))
        if chi2 < 0.95 * least:
            best, least = density, chi2
        if chi2 <= values.size:
            break
    assert best is not None
    return best


def check_explained(
    grid: EnergyGrid,
    matrix: np.ndarray,
    values: np.ndarray,
    errors: np.ndarray,
    offset: np.ndarray,
    labels: list[str],
    factor: tuple[float, float] | None = None,
) -> None:
    """Refuse data that no non-negative density of integral at most 1 explains; ``factor``: bounds of a common factor.

    Raises
    ------
    UnexplainedError
        With the best fit, its χ², and where it fails.
    """
    from scipy.stats import chi2 as distribution

    best = None
    for scale in [1.0] if factor is None else np.geomspace(*factor, 9):
        density, chi2 = smooth_fit(grid, scale * matrix, values - scale * offset, errors, 1e-12)
        if best is None or chi2 < best[0]:
            best = chi2, density, scale * (offset + matrix @ density)
    assert best is not None
    chi2, density, fitted = best
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
        f"and is off by {places}" + "".join(f"; {one}" for one in why) + "; check units, errors, load and scene",
        energies=grid.nodes,
        density=density,
        fitted=fitted,
        residuals=residuals,
        chi2=chi2,
    )
