"""Contacts at the edge of what numbers, grids and loads allow."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chemage import InputError, Surface
from chemage.plugin import ConvergenceError
from chemage_contact import FFTBEM, Hertz
from chemage_surfaces import SelfAffine, Sphere

MODULUS = 35.3


def rough(pixels=128, **options):
    options = {"pixel_size": 0.45, "hurst": 0.8, "zeta": 40, "eta": 3, "rms_slope": 0.1} | options
    return SelfAffine(pixels=pixels, **options).make(1)


def press(heights, mean, periodic=True, pixel=0.45, modulus=MODULUS, **options):
    surface = Surface(heights=heights, pixel_size=pixel, periodic=periodic)
    contact = FFTBEM(modulus=modulus, **options).solve(surface, mean * surface.nominal_area)
    assert contact.converged
    assert contact.pressure.min() >= 0
    assert contact.pressure.sum(dtype=float) * pixel**2 == pytest.approx(contact.load, rel=1e-6)
    return contact


# -- loads ------------------------------------------------------------------------------------------------------------


def test_no_load_is_a_valid_contact_without_pixels():
    surface = rough()
    contact = FFTBEM(modulus=MODULUS, gap=True).solve(surface, 0.0)
    assert contact.sites.size == 0
    assert contact.area == 0
    assert contact.patches == 0
    assert contact.displacement == 0
    assert math.isnan(contact.kappa)
    assert contact.gap is not None
    assert contact.gap.min() == 0
    assert "no load" in contact.notes[0]


@pytest.mark.parametrize("periodic", [True, False])
def test_one_pixel_in_contact(periodic):
    """Its pressure is the load over its area, its indentation that of one loaded pixel."""
    heights = rough().heights
    contact = press(heights, 1e-7, periodic)
    assert contact.sites.tolist() == [int(np.argmax(heights))]
    pixel_indentation = 4 * math.log(1 + math.sqrt(2)) / math.pi * 0.45 * float(contact.pressure.max()) / MODULUS
    assert contact.displacement == pytest.approx(pixel_indentation, rel=1e-6 if not periodic else 0.05)


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("load", [1e-30, 1e-12, 1e-6, 1.0, 1e6, 1e12, 1e30])
def test_any_load_is_solved(load, precision):
    surface = rough()
    contact = FFTBEM(modulus=MODULUS, precision=precision).solve(surface, load)
    assert contact.pressure.sum(dtype=float) * 0.45**2 == pytest.approx(load, rel=1e-6)
    assert contact.sites.size == 1 if load < 1e-5 else contact.sites.size > 1
    assert (contact.area_fraction == 1) == (load >= 1e6)


def test_a_load_that_single_precision_cannot_hold_is_refused():
    surface = rough()
    for load in (1e-90, 1e60):
        with pytest.raises(InputError, match="leaves the range of float32"):
            FFTBEM(modulus=MODULUS, precision="single").solve(surface, load)
        assert FFTBEM(modulus=MODULUS).solve(surface, load).sites.size > 0


@pytest.mark.parametrize("precision", ["single", "mixed"])
def test_nearly_and_just_full_contact(precision):
    """Between 99.9 % and 100 %: the load at which the last pixel closes is known exactly."""
    heights = rough().heights
    full = press(heights, 100.0).pressure - 100.0
    last = -float(full.min())
    for factor in (0.9, 0.99, 0.999, 0.9999, 1.0001, 1.01):
        contact = press(heights, factor * last, precision=precision, tolerance=1e-6)
        assert (contact.area_fraction == 1) == (factor > 1)
        if factor > 0.95:
            assert contact.area_fraction > 0.999
    np.testing.assert_allclose(contact.pressure, full + 1.01 * last, atol=1e-5 * last)
    assert "full contact" in contact.notes[-1]


@pytest.mark.parametrize("modulus", [1e-6, 1e-3, 1.0, 1e3])
def test_a_kilopascal_to_a_terapascal(modulus):
    """One kPa is 1e-6 GPa: only pressure over modulus matters."""
    surface = rough()
    plain = FFTBEM(modulus=1.0, tolerance=1e-11).solve(surface, 0.003 * surface.nominal_area)
    contact = FFTBEM(modulus=modulus, tolerance=1e-11).solve(surface, 0.003 * modulus * surface.nominal_area)
    np.testing.assert_allclose(contact.pressure / modulus, plain.pressure, rtol=1e-6)


# -- surfaces ---------------------------------------------------------------------------------------------------------


def test_a_flat_surface_bears_evenly():
    contact = press(np.full((30, 20), 3.7), 0.5)
    np.testing.assert_allclose(contact.pressure, 0.5, rtol=1e-14)
    assert contact.area_fraction == 1
    assert contact.displacement == pytest.approx(0, abs=1e-15)


def test_a_surface_that_is_flat_but_for_rounding_counts_as_flat():
    heights = 0.1 + np.random.default_rng(1).integers(0, 2, (16, 16)) * 1e-17
    assert press(heights * 3 / 3, 0.5).area_fraction == 1


@pytest.mark.parametrize("periodic", [True, False])
def test_a_plane_with_one_spike(periodic):
    heights = np.zeros((40, 40))
    heights[5, 7] = 1.0
    light = press(heights, 1e-4, periodic)
    assert light.sites.tolist() == [5 * 40 + 7]
    heavy = press(heights, 10.0, periodic)
    assert heavy.pressure[5, 7] == heavy.pressure.max()
    assert 0.5 < heavy.area_fraction < 1
    assert np.all(heavy.pressure[[5, 5, 4, 6], [6, 8, 7, 7]] == 0)  # the neighbours of the spike stay open


@pytest.mark.parametrize("shape", [(16, 16), (64, 32), (128, 128)])
def test_a_checkerboard_is_half_open_until_it_closes_at_once(shape):
    heights = np.indices(shape).sum(axis=0) % 2 * 1.0
    low = press(heights, 1.0)
    np.testing.assert_allclose(low.pressure, 2.0 * heights, atol=1e-6)
    q = math.pi * math.sqrt(2) / 0.45
    closing = MODULUS * q / 2 * 0.5
    assert press(heights, 0.999 * closing).area_fraction == 0.5
    assert press(heights, 1.001 * closing).area_fraction == 1.0


@pytest.mark.parametrize("scale", [1e-90, 1e-12, 1e6, 1e90])
def test_heights_of_any_size(scale):
    heights = rough().heights
    plain, scaled = press(heights, 0.1), press(heights * scale, 0.1 * scale)
    np.testing.assert_allclose(scaled.pressure / scale, plain.pressure, atol=1e-6 * plain.pressure.max())


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e6])
@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
def test_float32_heights(scale, precision):
    heights = (rough().heights * scale).astype(np.float32)
    contact = press(heights, 0.1 * scale, precision=precision)
    reference = press(heights.astype(np.float64), 0.1 * scale, precision="double", tolerance=1e-9)
    assert contact.pressure.dtype == (np.float32 if precision == "single" else np.float64)
    error = np.linalg.norm(contact.pressure - reference.pressure) / np.linalg.norm(reference.pressure)
    assert error < 2e-4


@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 64), (64, 1), (2, 2), (2, 3), (5, 1), (7, 13), (101, 97), (128, 131), (3000, 50), (512, 4)]
)
@pytest.mark.parametrize("periodic", [True, False])
def test_any_grid(shape, periodic):
    heights = np.random.default_rng(2).standard_normal(shape)
    for axis in (0, 1):
        heights = heights + np.roll(heights, 1, axis)
    contact = press(heights, 0.5, periodic, tolerance=1e-5)
    if min(shape) > 2:
        assert 0 < contact.area_fraction < 1


def test_white_noise_and_steps():
    rng = np.random.default_rng(3)
    assert 0 < press(rng.standard_normal((128, 128)), 1.0).area_fraction < 0.2
    assert press((rng.random((128, 128)) > 0.5) * 1.0, 1.0).area_fraction == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("offset", [1e6, -1e9])
def test_a_large_mean_height(offset):
    """Heights of 1e9 nm resolve 1e-7 nm: the answer may be off by as much as the input is."""
    heights = rough().heights
    plain, raised = press(heights, 0.1), press(heights + offset, 0.1)
    assert np.linalg.norm(raised.pressure - plain.pressure) < 1e-4 * np.linalg.norm(plain.pressure)


def test_tilt_in_a_free_half_space_shifts_the_contact_and_keeps_the_load():
    surface = Sphere(radius=50.0, pixels=160, pixel_size=0.25).make()
    x = (np.arange(160) - 79.5) * 0.25
    tilted = Surface(heights=surface.heights + 0.1 * x[:, None] + 1e5, pixel_size=0.25, periodic=False)
    solver = FFTBEM(modulus=MODULUS)
    plain, moved = solver.solve(surface, 20.0), solver.solve(tilted, 20.0)
    # A tilt of 0.1 moves the apex of the paraboloid by 0.1 R = 5 nm, 20 pixels.
    np.testing.assert_allclose(moved.pressure[20:], plain.pressure[:-20], atol=0.01 * plain.pressure.max())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_heights_that_are_not_finite_are_refused(bad):
    heights = np.zeros((8, 8))
    heights[3, 4] = bad
    with pytest.raises(InputError, match=r"heights: 1 of 64 values are not finite"):
        press(heights, 1.0)


# -- the iteration ----------------------------------------------------------------------------------------------------


def test_the_iteration_limit_raises_with_the_history():
    surface = rough()
    with pytest.raises(
        ConvergenceError, match=r"iteration limit was reached after 3 iterations.*raise max_iter"
    ) as error:
        FFTBEM(modulus=MODULUS, max_iterations=3).solve(surface, 1000.0)
    assert len(error.value.history) == 4
    assert error.value.residual == error.value.history[-1] > error.value.tolerance == 1e-5


@pytest.mark.parametrize("limit", [0, 3])
def test_the_iteration_limit_returns_an_unconverged_contact_when_asked(limit):
    surface = rough()
    contact = FFTBEM(modulus=MODULUS, max_iterations=limit, on_failure="return").solve(surface, 1000.0)
    assert not contact.converged
    assert contact.iterations == limit
    assert contact.residual > 1e-5
    assert "iteration limit" in contact.notes[-1]
    assert contact.pressure.sum() * 0.45**2 == pytest.approx(1000.0, rel=1e-6)


def test_single_precision_says_what_it_cannot_do():
    with pytest.raises(InputError, match=r"single precision cannot reach this; use precision = 'mixed'"):
        FFTBEM(modulus=MODULUS, precision="single", tolerance=1e-8)


def test_a_stall_is_reported_as_such():
    """Below the rounding of the heights no method can go; the message says so and what to do."""
    heights = rough().heights + 1e9
    surface = Surface(heights=heights, pixel_size=0.45)
    reached = FFTBEM(modulus=MODULUS, tolerance=1e-12, on_failure="return").solve(surface, 1000.0)
    assert reached.converged == (reached.residual < 1e-12)
    from chemage_contact import _iteration
    from chemage_contact._kernels import Heights
    from chemage_contact._operators import Team

    body = FFTBEM(modulus=MODULUS).body(surface)
    scaled = np.float32((rough().heights - rough().heights.max()) / rough().rms_height)
    settings = _iteration.Settings(tolerance=1e-9, precision="single")
    end = _iteration.solve(body, Heights(scaled), stiffness=2e-3, settings=settings, team=Team(1))
    assert not end.converged
    assert end.iterations < settings.max_iterations
    assert 1e-9 < end.error < 1e-4


def test_tolerances_down_to_rounding_are_reached():
    surface = rough()
    for precision in ("mixed", "double"):
        contact = FFTBEM(modulus=MODULUS, tolerance=1e-12, precision=precision).solve(surface, 1000.0)
        assert contact.residual < 1e-12


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"modulus": 0}, "modulus"),
        ({"modulus": math.nan}, "modulus"),
        ({"tolerance": 0}, "tolerance"),
        ({"tolerance": 1e-15}, "below the rounding errors of double precision"),
        ({"levels": 0}, "levels"),
        ({"threads": 0}, "threads"),
        ({"precision": "half"}, "precision"),
        ({"thickness": 1.0, "boundary": "free"}, "thickness"),
        ({"poisson_ratio": 0.6}, "poisson_ratio"),
        ({"tolerence": 1e-3}, r"no such option \(did you mean 'tolerance'\?\)"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        FFTBEM(**({"modulus": 1.0} | options))


def test_a_layer_under_a_surface_that_does_not_repeat_is_refused():
    surface = Surface(heights=np.zeros((8, 8)), pixel_size=1.0, periodic=False)
    with pytest.raises(InputError, match="needs a periodic surface"):
        FFTBEM(modulus=1.0, thickness=3.0).solve(surface, 1.0)


@pytest.mark.parametrize("thickness", [1e-3, 1.0, 1e3, 1e9])
@pytest.mark.parametrize("poisson", [0.0, 0.49, 0.5])
def test_layers_of_any_thickness(thickness, poisson):
    surface = rough()
    contact = FFTBEM(modulus=MODULUS, thickness=thickness, poisson_ratio=poisson).solve(surface, 1000.0)
    assert contact.pressure.sum() * 0.45**2 == pytest.approx(1000.0, rel=1e-6)


# -- displacement control ---------------------------------------------------------------------------------------------


def test_approaches_without_contact_and_beyond_full_contact():
    surface = rough()
    solver = FFTBEM(modulus=MODULUS, gap=True)
    for approach in (0.0, -2.0):
        contact = solver.solve_displacement(surface, approach)
        assert contact.load == 0
        assert contact.gap is not None
        assert contact.gap.min() == pytest.approx(-approach, abs=1e-12)
    top = float(surface.heights.max() - surface.heights.mean())
    with pytest.raises(InputError, match="the mean plane goes no further"):
        solver.solve_displacement(surface, top)
    assert solver.solve_displacement(surface, 0.95 * top).area_fraction > 0.4
    with pytest.raises(InputError, match="must be finite"):
        solver.solve_displacement(surface, math.nan)


def test_a_tiny_approach_touches_one_pixel():
    contact = FFTBEM(modulus=MODULUS).solve_displacement(rough(), 1e-9)
    assert contact.sites.size == 1
    assert 0 < contact.load < 1e-6


def test_a_hertz_tip_pressed_with_almost_nothing_agrees_with_the_grid():
    tip = Sphere(radius=30.0, pixels=129, pixel_size=0.45).make()
    for load in (1e-12, 1e-3):
        numerical, exact = FFTBEM(modulus=MODULUS).solve(tip, load), Hertz(modulus=MODULUS).solve(tip, load)
        assert numerical.sites.tolist() == exact.sites.tolist() == [64 * 129 + 64]
        assert numerical.pressure.max() == pytest.approx(exact.pressure.max(), rel=1e-6)
