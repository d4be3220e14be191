"""Checks of a distribution of barriers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from chemage.lattices.role import Barriers
from chemage.testing.checks import check_of, require, run_checks


def check_barriers(component: Barriers) -> None:
    """Run every check of the role ``barriers``; raises AssertionError if one fails."""
    run_checks(component, Barriers, {})


_LOWEST, _HIGHEST = 2.0**-53, 1 - 2.0**-53


@check_of("barriers")
def _quantile_is_monotone(component: Barriers) -> None:
    uniform = np.concatenate([[_LOWEST, 1e-12, 1e-6], np.linspace(1e-4, 1 - 1e-4, 2001), [1 - 1e-6, _HIGHEST]])
    energy = component.quantile(uniform)
    require(energy.shape == uniform.shape and energy.dtype == np.float64, f"{energy.shape} {energy.dtype}")
    require(np.isfinite(energy).all(), "a barrier is not finite for a uniform number between 2^-53 and 1 - 2^-53")
    falls = np.flatnonzero(np.diff(energy) < 0)
    require(not falls.size, f"the quantile function falls at u = {uniform[falls[:1]]}")


@check_of("barriers")
def _barrier_is_the_pixels_own(component: Barriers) -> None:
    """The barrier of a pixel depends only on its own number, neither on other pixels nor on earlier calls."""
    uniform = np.random.default_rng(1).random(1000)
    energy = component.quantile(uniform)
    require(energy.tobytes() == component.quantile(uniform).tobytes(), "two calls gave different barriers")
    for part in (slice(None, None, -1), slice(10, 11), slice(3, 700, 7)):
        alone = component.quantile(np.ascontiguousarray(uniform[part]))
        require(
            np.allclose(alone, energy[part], rtol=1e-13, atol=0), "a barrier depends on the other numbers in the call"
        )
    grid = component.quantile(uniform.reshape(20, 50))
    require(
        grid.shape == (20, 50) and np.allclose(grid.ravel(), energy, rtol=1e-13),
        "the barriers do not have the shape of the numbers",
    )
    require(component.quantile(np.empty(0)).shape == (0,), "no pixels: expected an empty array")


@check_of("barriers")
def _density_agrees_with_quantile(component: Barriers) -> None:
    """∫ density between two quantiles is the probability between them."""
    levels = np.array([0.001, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 0.999])
    energies = component.quantile(levels)
    if energies[0] == energies[-1]:
        require(np.isposinf(component.density(energies[:1])).all(), "a point mass has density inf")
        return
    for (low, high), (below, above) in zip(pairwise(energies), pairwise(levels), strict=True):
        # midpoints: a density may jump at a quantile
        count = 20000
        middle = low + (np.arange(count) + 0.5) * (high - low) / count
        density = component.density(middle)
        require(density.shape == middle.shape, f"density of shape {density.shape} for energies of {middle.shape}")
        require((density >= 0).all() and np.isfinite(density).all(), f"density between {low} and {high} eV")
        total = float(density.sum()) * (high - low) / count
        require(
            abs(total - (above - below)) < 1e-3,
            f"the density integrates to {total:.5f} between {low:.5f} and {high:.5f} eV; "
            f"the quantile function puts {above - below:.5f} there",
        )
    far = component.density(np.array([energies[0] - 1e3, energies[-1] + 1e3]))
    require(np.allclose(far, 0, atol=1e-6), f"density {far} a thousand eV away")
