"""Linear algebra in a fixed order gives what LAPACK gives."""

from __future__ import annotations

import numpy as np
import pytest
from inferring import algebra
from scipy import optimize


@pytest.mark.parametrize("decades", [0, 3, 12, 40, 90, 150, 300])
def test_axes_are_right_singular_vectors(decades):
    """Rows of lengths over many decades, whose squares underflow, end the rotations."""
    rng = np.random.default_rng(decades)
    rows = np.logspace(0, -decades, 12)[:, None] * rng.normal(size=(12, 20))
    axes = algebra.row_axes(rows, 0.0)
    np.testing.assert_allclose(axes @ axes.T, np.eye(len(axes)), atol=1e-12)
    lengths = np.linalg.norm(axes @ rows.T, axis=1)
    assert len(axes) == np.count_nonzero(np.logspace(0, -decades, 12) > 1e-20)
    np.testing.assert_allclose(lengths, np.linalg.svd(rows, compute_uv=False)[: len(axes)], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("rank", [0, 1, 5])
def test_axes_of_dependent_rows(rank):
    rng = np.random.default_rng(rank)
    rows = rng.normal(size=(30, rank)) @ rng.normal(size=(rank, 9))
    axes = algebra.row_axes(rows.T @ rows, 1e-9)
    assert len(axes) == max(rank, 1)
    np.testing.assert_allclose(axes @ axes.T, np.eye(len(axes)), atol=1e-12)
    np.testing.assert_allclose(rows @ axes.T @ axes, rows, atol=1e-12)


@pytest.mark.parametrize("size", [1, 3, 4, 11])
def test_factors_and_solutions(size):
    rng = np.random.default_rng(size)
    a, b = rng.normal(size=(size, size)), rng.normal(size=(size, 2))
    matrix = a @ a.T + np.eye(size)
    lower = algebra.cholesky(matrix)
    np.testing.assert_allclose(lower, np.linalg.cholesky(matrix), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(algebra.forward(lower, b), np.linalg.solve(lower, b), rtol=1e-10)
    np.testing.assert_allclose(algebra.product(a, b), a @ b, rtol=1e-12)
    assert np.isnan(algebra.cholesky(-matrix)).any()


@pytest.mark.parametrize("seed", range(5))
def test_least_squares(seed):
    rng = np.random.default_rng(seed)
    columns, goal = rng.normal(size=(6, 15)), rng.normal(size=15)
    free = np.linalg.lstsq(columns.T, goal, rcond=None)[0]
    np.testing.assert_allclose(algebra.least_squares(columns, goal), free, rtol=1e-10)
    np.testing.assert_allclose(algebra.nonnegative(columns, goal), optimize.nnls(columns.T, goal)[0], atol=1e-12)
