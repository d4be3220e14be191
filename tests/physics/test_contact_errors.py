"""Every error that fft-bem reports is the true one: claims against independent evaluations in double precision."""

from __future__ import annotations

import numpy as np
import pytest
from contact_errors import MODULUS, Case, cases, check, estimates, rough, slope
from independent_contact import Body, dense_solution, evaluate

from chemage import InputError, Surface
from chemage.plugin import ConvergenceError
from chemage_contact import FFTBEM, _descent

STRICT = [("single", 1e-6), ("mixed", 1e-12), ("double", 1e-12)]


@pytest.mark.parametrize(("precision", "tolerance"), STRICT)
@pytest.mark.parametrize(
    ("family", "count"),
    [
        *(("few_pixels", 14), ("light", 5), ("spikes", 5), ("outliers", 3), ("worn", 3), ("full", 3), ("layers", 4)),
        *(
            pytest.param(family, count, marks=pytest.mark.long)
            for family, count in (
                *(("few_pixels", 40), ("light", 15), ("spikes", 15), ("outliers", 8)),
                *(("worn", 8), ("full", 8), ("layers", 10)),
            )
        ),
    ],
)
def test_no_claimed_error_is_smaller_than_the_true_one(family, count, precision, tolerance):
    """And a contact that counts as converged keeps the tolerance and bears the load."""
    for case in cases(family, count):
        row = check(case, precision, tolerance)
        assert row["honest"], row
        assert row["kept"], row
        assert row["load"] < (2e-7 if precision == "single" else 1e-12)
        assert row["converged"] or row["notes"], row


@pytest.mark.parametrize("family", ["few_pixels", "light", "spikes", "outliers", "worn"])
@pytest.mark.parametrize("precision", ["mixed", pytest.param("double", marks=pytest.mark.long)])
def test_hard_contacts_converge_with_the_first_method(family, precision):
    for case in cases(family, 15, seed=1):
        row = check(case, precision, 1e-8)
        assert row["converged"]
        assert not row["stepped"]


@pytest.mark.parametrize("precision", ["mixed", pytest.param("double", marks=pytest.mark.long)])
def test_few_pixels_bear_the_pressure_of_the_dense_solution(precision):
    for case in cases("few_pixels", 40, seed=2):
        solution = case.solve(precision=precision, tolerance=1e-12)
        exact = dense_solution(case.body.matrix(case.heights.shape), case.heights, case.mean)
        np.testing.assert_allclose(solution.pressure, exact, atol=1e-9 * exact.max())


@pytest.mark.parametrize("periodic", [True, False])
def test_one_high_pixel_on_a_plane_at_the_load_where_the_plane_begins_to_touch(periodic):
    heights = np.zeros((64, 64))
    heights[20, 30] = 1.0
    body = Body(MODULUS, 0.5, periodic)
    alone = np.zeros_like(heights)
    alone[20, 30] = 1.0
    # Load at which the pixel has sunk by its height relative to the pixel of the plane that comes nearest.
    u = body.displacement(alone)
    touching = 1.0 / float(u[20, 30] - np.delete(u.ravel(), 20 * 64 + 30).min()) / heights.size
    for factor in (0.5, 0.9, 0.99, 1.01, 1.1, 2.0, 10.0):
        solution = Case(heights, factor * touching, body).solve(tolerance=1e-8)
        assert solution.converged
        assert solution.iterations < 60
        assert (solution.sites.size == 1) == (factor < 1)
        assert evaluate(body, heights, solution.pressure).error < 1.01e-8


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("excess", [1.5, 1e3, 1e6])
def test_full_contact_reports_the_error_of_the_rounded_pressure(excess, periodic, precision):
    rng = np.random.default_rng(3)
    heights = rough(rng, 64, rms_slope=0.1, hurst=0.8, zeta=16.0, eta=3.0)
    body = Body(MODULUS, 0.5, periodic)
    closing = MODULUS * slope(heights) * 3
    solution = Case(heights, excess * closing, body).solve(precision=precision)
    found = evaluate(body, heights, solution.pressure)
    assert found.error <= 1.01 * solution.residual + 1e-12 * excess
    assert found.error > 0.2 * solution.residual
    if solution.residual >= 1e-5:
        assert any("rounding" in note for note in solution.notes)
    if solution.area_fraction == 1:
        more = "uniform pressure" if periodic else "flat punch"
        assert any("full contact" in note and more in note for note in solution.notes)


def test_the_history_and_the_residual_are_relative_to_the_approach_where_it_is_small():
    case = next(cases("light", 1))
    solution = case.solve(tolerance=1e-4)
    report = solution.convergence
    assert report["scale"] == pytest.approx(min(solution.rms_height, solution.displacement or 0.0), rel=1e-9)
    assert solution.residual == max(report["rms_gap"], report["penetration"]) == max(report["history"][-1])


# -- the error of the pressure ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("family", "tolerance", "precision", "count"),
    [
        pytest.param("moderate", 1e-5, "mixed", 15, marks=pytest.mark.long),
        ("moderate", 1e-3, "mixed", 10),
        ("few_pixels", 1e-5, "mixed", 25),
    ],
)
def test_the_estimated_error_of_the_pressure_is_within_a_factor_three(family, tolerance, precision, count):
    ratios = estimates(family, tolerance, precision, count, seed=5)
    assert len(ratios) > count // 3
    assert ratios.min() > 1 / 3
    assert ratios.max() < 3


def test_a_tolerance_for_the_pressure_is_kept():
    rng = np.random.default_rng(8)
    heights = rough(rng, 128, rms_slope=0.1, hurst=0.8, zeta=16.0, eta=3.0)
    case = Case(heights, 0.02 * MODULUS * 0.1)
    exact = case.solve(precision="double", tolerance=1e-11).pressure
    loose = case.solve(tolerance=1e-3)
    assert loose.convergence["pressure_error"] > 1e-4
    for wanted in (1e-4, 1e-6, 1e-9):
        solution = case.solve(tolerance=1e-3, pressure_tolerance=wanted)
        assert solution.converged
        assert solution.convergence["pressure_error"] <= wanted
        assert np.linalg.norm(solution.pressure - exact) < 2 * wanted * np.linalg.norm(exact) + 1e-10
        assert solution.iterations > loose.iterations


def test_a_tolerance_for_the_pressure_that_cannot_be_reached_is_an_error():
    rng = np.random.default_rng(8)
    surface = Surface(heights=rough(rng, 64), pixel_size=0.5)
    solver = FFTBEM(modulus=MODULUS, precision="single", tolerance=1e-5, pressure_tolerance=1e-12)
    with pytest.raises(ConvergenceError, match=r"single precision.*use precision = 'mixed'"):
        solver.solve(surface, 0.02 * MODULUS * slope(surface.heights) * surface.nominal_area)
    with pytest.raises(InputError, match="pressure_tolerance"):
        FFTBEM(modulus=MODULUS, pressure_tolerance=0.0)


# -- failures ---------------------------------------------------------------------------------------------------------


def test_a_solve_that_fails_returns_its_best_iterate(monkeypatch):
    """The error can rise on the way; on a grid without split operator all of the history is exact."""
    monkeypatch.setattr(_descent, "KEEP_FROM", 0)
    rng = np.random.default_rng(1)
    case = Case(rng.standard_normal((64, 64)), 2.0)
    for limit in range(1, 12):
        solution = case.solve(max_iterations=limit, tolerance=1e-12, levels=1)
        assert not solution.converged
        errors = [max(pair) for pair in solution.convergence["history"]]
        assert solution.residual <= 1.2 * min(errors)
        assert evaluate(case.body, case.heights, solution.pressure).error == pytest.approx(solution.residual, rel=1e-6)


def test_a_stalled_solve_in_double_precision_does_not_recommend_double_precision():
    case = next(iter(cases("full", 1)))
    body = Body(MODULUS, 0.5, periodic=False)
    for precision in ("mixed", "double"):
        solution = Case(case.heights, case.mean * 1e6, body).solve(precision=precision, tolerance=1e-12)
        assert not solution.converged
        assert "rounding errors of double precision" in " ".join(solution.notes)
        assert "use precision" not in " ".join(solution.notes)


def test_a_uniform_residual_has_no_spread():
    """The mean taken away leaves rounding errors of either sign, of which a root was taken."""
    from types import SimpleNamespace

    from chemage_contact._descent import Descent

    for value in np.linspace(0.1, 0.7, 50):
        residual = [value] * 3
        standing = SimpleNamespace(residual_sum=sum(residual), pixels=3, residual_squares=sum(v * v for v in residual))
        owner = SimpleNamespace(grid=SimpleNamespace(floating=True))
        assert 0.0 <= Descent._spread(owner, standing) < 1e-15  # type: ignore[arg-type]
