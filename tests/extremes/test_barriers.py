"""Barrier distributions at the ends of what numbers can be."""

from __future__ import annotations

import numpy as np
import pytest

import chemage as ca

#: the smallest and the largest uniform number there is, and some between
U = np.array([2.0**-53, 1e-9, 0.1, 0.5, 0.9, 1 - 1e-9, 1 - 2.0**-53])


@pytest.mark.parametrize(
    "bounds", [{"lower": 1.2}, {"upper": 0.3}, {"lower": 1e6}, {"upper": -1e200}, {"lower": 1.0, "upper": 1.0 + 1e-12}]
)
def test_truncated_gaussians_are_finite_and_inside_however_far_the_bounds(bounds):
    for std in (1e-300, 1e-12, 1e-3, 1.0, 1e300):
        barriers = ca.barriers("gaussian", mean=1.1, std=std, **bounds)
        values = barriers.quantile(U)
        assert np.all(np.isfinite(values))
        assert np.all(values >= bounds.get("lower", -np.inf))
        assert np.all(values <= bounds.get("upper", np.inf))
        assert np.all(np.diff(values) >= -4 * np.spacing(np.abs(values).max()))
        assert not np.any(np.isnan(barriers.density(values)))


def test_a_bound_beyond_resolution_is_where_all_barriers_are():
    np.testing.assert_array_equal(ca.barriers("gaussian", mean=1.1, std=1e-12, lower=1.2).quantile(U), 1.2)
    np.testing.assert_array_equal(ca.barriers("gaussian", mean=1.1, std=1e-12, upper=1.0).quantile(U), 1.0)


def test_a_narrow_window_is_evenly_filled():
    for centre in (0.0, 1.1, 1.5):  # far in a tail, at the mean, far in the other
        barriers = ca.barriers("gaussian", mean=1.1, std=0.1, lower=centre, upper=centre + 1e-9)
        np.testing.assert_allclose(barriers.quantile(U), centre + 1e-9 * U, rtol=0, atol=1e-14)
        np.testing.assert_allclose(barriers.density(np.array([centre, centre + 5e-10])), 1e9, rtol=1e-5)


def test_the_last_quantiles_of_a_table_do_not_lose_digits():
    # next to an end where the density vanishes, u = F(x) is quadratic: x − end = √(u·2·...) exactly
    barriers = ca.barriers("tabulated", energies=[0.8, 1.1, 1.4], weights=[0, 1, 0])
    small = np.array([2.0**-53, 1e-12, 1e-6])
    np.testing.assert_allclose(barriers.quantile(small) - 0.8, 0.3 * np.sqrt(2 * small), rtol=1e-8, atol=2e-16)
    np.testing.assert_allclose(1.4 - barriers.quantile(1 - small), 0.3 * np.sqrt(2 * small), rtol=1e-4, atol=5e-16)


@pytest.mark.parametrize("scale", [1e-320, 1e-300, 1e300, 1.7e308])
def test_weights_of_any_size_are_normalised(scale):
    energies, weights = [0.8, 1.1, 1.2, 1.4], np.array([0.25, 1.0, 0.0, 0.5])
    barriers = ca.barriers("tabulated", energies=energies, weights=weights * scale)
    plain = ca.barriers("tabulated", energies=energies, weights=weights)
    np.testing.assert_allclose(barriers.quantile(U), plain.quantile(U), rtol=1e-3 if scale < 1e-310 else 1e-12)


def test_one_nearly_empty_interval_among_others():
    barriers = ca.barriers("tabulated", energies=[0, 1, 2, 3], weights=[0, 1e-200, 0, 1])
    values = barriers.quantile(U)
    assert np.all((values >= 2) & (values <= 3))


def test_gaps_without_density_are_never_drawn():
    barriers = ca.barriers("tabulated", energies=[0, 1, 2, 3, 4, 5], weights=[0, 1, 0, 0, 1, 0])
    values = barriers.quantile((np.arange(10_000) + 0.5) / 10_000)
    assert not np.any((values > 2.001) & (values < 2.999))
    assert np.mean(values <= 2) == pytest.approx(0.5, abs=1e-3)


def test_a_table_narrower_than_its_distance_from_zero():
    barriers = ca.barriers("tabulated", energies=[1e6, 1e6 + 1e-6], weights=[1, 1])
    values = barriers.quantile(U)
    assert values[0] >= 1e6
    assert values[-1] <= 1e6 + 1e-6


def test_a_million_samples():
    values = np.random.default_rng(0).normal(1.1, 0.1, 1_000_000)
    barriers = ca.barriers("tabulated", samples=values)
    assert barriers.quantile(np.array(0.5)) == pytest.approx(np.median(values), abs=1e-12)
