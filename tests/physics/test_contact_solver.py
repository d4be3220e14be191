"""fft-bem against closed forms, against an independent solver, and against the theories of rough contact."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from chemage import Surface
from chemage.plugin import theory
from chemage_contact import FFTBEM, Hertz
from chemage_surfaces import SelfAffine, Sphere

MODULUS = 35.3


def rough(pixels=256, seed=1, **options):
    options = {"pixel_size": 0.5, "hurst": 0.8, "zeta": 32, "eta": 3, "rms_slope": 0.1} | options
    return SelfAffine(pixels=pixels, **options).make(seed)


def wavy(n, pixel, amplitude):
    x = np.arange(n) * pixel
    return np.tile(amplitude * np.cos(2 * np.pi * x / (n * pixel))[:, None], (1, 8))


# -- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.5, 0.9])
def test_westergaard(ratio):
    """Sinusoid of amplitude Δ: p* = πE*Δ/λ, p̄/p* = sin²(πa/λ) (H. M. Westergaard, J. Appl. Mech. 6, 49 (1939))."""
    n, pixel, amplitude = 512, 0.4, 0.7
    wavelength = n * pixel
    surface = Surface(heights=wavy(n, pixel, amplitude), pixel_size=pixel)
    mean = ratio * math.pi * MODULUS * amplitude / wavelength
    contact = FFTBEM(modulus=MODULUS, tolerance=1e-7).solve(surface, mean * surface.nominal_area)
    half = wavelength / math.pi * math.asin(math.sqrt(ratio))
    assert contact.area_fraction == pytest.approx(2 * half / wavelength, abs=1.5 / n)
    x = np.arange(n) * pixel
    x = np.where(x > wavelength / 2, x - wavelength, x)
    root = math.sin(math.pi * half / wavelength) ** 2 - np.sin(np.pi * x / wavelength) ** 2
    exact = 2 * mean * np.cos(np.pi * x / wavelength) / ratio * np.sqrt(np.maximum(root, 0))
    inside = np.abs(x) < half - 3 * pixel
    np.testing.assert_allclose(contact.pressure[inside, 0], exact[inside], rtol=5e-3)


def test_westergaard_of_the_reference_values():
    """Contact fraction 0.2952 and peak p/p̄ = 4.47214 at p̄/p* = 0.2 on 512 pixels."""
    surface = Surface(heights=wavy(512, 1.0, 1.0), pixel_size=1.0)
    mean = 0.2 * math.pi * MODULUS / 512
    contact = FFTBEM(modulus=MODULUS, tolerance=1e-8).solve(surface, mean * surface.nominal_area)
    assert contact.area_fraction == pytest.approx(0.2952, abs=1 / 512)
    assert contact.pressure.max() / mean == pytest.approx(4.47214, rel=1e-3)


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("excess", [1.0001, 1.5, 1e3, 1e9])
def test_full_contact_of_a_cosine(excess, precision):
    """p = p̄ + p* cos(2πx/λ) at and beyond p̄ = p*."""
    n, pixel, amplitude = 64, 0.4, 0.7
    surface = Surface(heights=wavy(n, pixel, amplitude), pixel_size=pixel)
    full = math.pi * MODULUS * amplitude / (n * pixel)
    contact = FFTBEM(modulus=MODULUS, precision=precision).solve(surface, excess * full * surface.nominal_area)
    exact = excess * full + full * surface.heights / amplitude
    np.testing.assert_allclose(contact.pressure, exact, atol=1e-5 * excess * full)
    assert contact.area_fraction == 1.0
    assert any("full contact" in note for note in contact.notes)


def test_rms_pressure_of_full_contact():
    """p_rms = E* h'_rms/2, whatever the spectrum."""
    surface = rough(128)
    contact = FFTBEM(modulus=MODULUS).solve(surface, 50 * surface.nominal_area)
    assert contact.pressure.std() == pytest.approx(MODULUS * surface.rms_slope / 2, rel=1e-9)


@pytest.mark.parametrize(("pixels", "load"), [(200, 50.0), (201, 400.0)])
def test_a_sphere_agrees_with_hertz(pixels, load):
    surface = Sphere(radius=30.0, pixels=pixels, pixel_size=0.15).make()
    numerical = FFTBEM(modulus=MODULUS).solve(surface, load)
    exact = Hertz(modulus=MODULUS).solve(surface, load)
    assert exact.displacement is not None
    radius = math.sqrt(exact.displacement * 30.0)
    peak = 3 * load / (2 * math.pi * radius**2)
    x = (np.arange(pixels) - (pixels - 1) / 2) * 0.15
    away = np.hypot(x[:, None], x) < radius - 4 * 0.15
    assert np.abs(numerical.pressure - exact.pressure)[away].max() < 0.01 * peak
    assert numerical.pressure.sum(dtype=float) * 0.15**2 == pytest.approx(load, rel=1e-6)
    assert numerical.displacement == pytest.approx(exact.displacement, rel=3e-3)
    assert numerical.area == pytest.approx(math.pi * radius**2, rel=0.02)
    assert exact.area == pytest.approx(math.pi * radius**2, rel=0.02)


def test_a_flat_punch_in_a_free_half_space():
    """Rigid square of side s: F = 1.152 s E* δ (G. M. L. Gladwell, Contact Problems, 1980); pressure peaks at edges."""
    surface = Surface(heights=np.zeros((96, 96)), pixel_size=0.5, periodic=False)
    contact = FFTBEM(modulus=MODULUS).solve(surface, 1000.0)
    assert contact.displacement is not None
    assert 1000.0 / (MODULUS * contact.displacement * 48.0) == pytest.approx(1.152, rel=0.01)
    assert contact.pressure[0, 0] > contact.pressure[0, 48] > contact.pressure[48, 48]


# -- an independent solver --------------------------------------------------------------------------------------------


def dense_operator(shape, pixel, modulus):
    """The periodic half-space as a matrix, summed wave by wave."""
    nx, ny = shape
    x, y = np.divmod(np.arange(nx * ny), ny)
    matrix = np.zeros((nx * ny, nx * ny))
    for i in range(nx):
        for j in range(ny):
            if i or j:
                q = 2 * np.pi / pixel * math.hypot(min(i, nx - i) / nx, min(j, ny - j) / ny)
                phase = 2 * np.pi * (i * x / nx + j * y / ny)
                wave = np.stack([np.cos(phase), np.sin(phase)])
                matrix += 2 / (modulus * q) * wave.T @ wave / (nx * ny)
    return matrix


def solved_densely(matrix, h, total):
    """Active sets with a direct solve for each; ends where p ≥ 0 and gap ≥ 0."""
    inside = np.ones(h.size, bool)
    for _ in range(200):
        n = int(inside.sum())
        system = np.ones((n + 1, n + 1))
        system[:n, :n] = matrix[np.ix_(inside, inside)]
        system[n, n] = 0
        solution = np.linalg.solve(system, np.append(h[inside], total))
        p = np.zeros(h.size)
        p[inside] = solution[:n]
        gap = matrix @ p - h + solution[n]
        if p.min() >= 0 and gap.min() > -1e-12:
            return p, gap
        inside = (p > 0) | (~inside & (gap < 0))
    raise AssertionError("the dense solver does not settle")


@pytest.mark.parametrize("shape", [(12, 12), (9, 14), (1, 40), (31, 5)])
@pytest.mark.parametrize("mean", [0.02, 0.5, 3.0])
def test_a_dense_solver_finds_the_same(shape, mean):
    rng = np.random.default_rng(shape[0])
    heights = rng.standard_normal(shape)
    heights = heights + np.roll(heights, 1, 0) + np.roll(heights, 1, 1)
    p, gap = solved_densely(dense_operator(shape, 0.5, MODULUS), heights.ravel(), mean * heights.size)
    surface = Surface(heights=heights, pixel_size=0.5)
    contact = FFTBEM(modulus=MODULUS, tolerance=1e-10, gap=True).solve(surface, mean * surface.nominal_area)
    np.testing.assert_allclose(contact.pressure.ravel(), p, atol=1e-7 * p.max())
    assert contact.gap is not None
    np.testing.assert_allclose(contact.gap.ravel(), np.maximum(gap, 0), atol=1e-8)


# -- the result keeps its promises ------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("mean", [0.005, 0.3, 2.0])
def test_complementarity_balance_and_sign_at_exit(mean, precision):
    """Checked with an operator of the test's own, in double precision, from heights and pressure alone."""
    surface = rough(256)
    load = mean * surface.nominal_area
    contact = FFTBEM(modulus=MODULUS, precision=precision, tolerance=1e-5, gap=True).solve(surface, load)
    p = contact.pressure.astype(float)
    assert p.min() >= 0
    assert p.sum() * surface.pixel_size**2 == pytest.approx(load, rel=1e-6)
    q = 2 * np.pi / surface.pixel_size * np.hypot(np.fft.fftfreq(256)[:, None], np.fft.rfftfreq(256))
    q[0, 0] = np.inf
    u = np.fft.irfft2(np.fft.rfft2(p) * 2 / (MODULUS * q), s=surface.shape)
    gap = u - surface.heights
    gap -= gap[p > 0].mean()
    assert math.sqrt(np.mean(gap[p > 0] ** 2)) < 1.1e-5 * surface.rms_height
    assert gap[p == 0].min() > -1.1e-5 * surface.rms_height
    report = contact.convergence
    assert max(report["rms_gap"], report["penetration"]) == contact.residual < 1e-5
    assert report["rms_gap"] == pytest.approx(math.sqrt(np.mean(gap[p > 0] ** 2)) / surface.rms_height, abs=1e-6)
    assert report["force_error"] < 1e-6
    assert report["complementarity"] < 1e-5
    assert contact.gap is not None
    assert np.abs(contact.gap - np.maximum(gap, 0)).max() < 1e-5 * surface.rms_height


def test_single_precision_is_close_to_double():
    surface = rough(512, zeta=64)
    load = 0.016 * surface.nominal_area
    double = FFTBEM(modulus=MODULUS, precision="double", tolerance=1e-6).solve(surface, load)
    for precision in ("single", "mixed"):
        other = FFTBEM(modulus=MODULUS, precision=precision, tolerance=1e-6).solve(surface, load)
        error = np.linalg.norm(other.pressure - double.pressure) / np.linalg.norm(double.pressure)
        assert error < 2e-5
        assert abs(other.area_fraction - double.area_fraction) < 1e-5


def test_tightening_the_tolerance_converges():
    surface = rough(256)
    load = 0.2 * surface.nominal_area
    reference = FFTBEM(modulus=MODULUS, precision="double", tolerance=1e-11).solve(surface, load).pressure
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9):
        p = FFTBEM(modulus=MODULUS, tolerance=tolerance).solve(surface, load).pressure
        errors.append(float(np.linalg.norm(p - reference) / np.linalg.norm(reference)))
    assert all(b < a / 5 for a, b in pairwise(errors))
    assert errors[1] < 2e-4
    assert errors[-1] < 1e-8


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_byte(threads):
    surface = rough(512, zeta=64)
    one, more = (FFTBEM(modulus=MODULUS, threads=n).solve(surface, 3000.0) for n in (1, threads))
    assert one.pressure.tobytes() == more.pressure.tobytes()


def test_a_start_changes_the_iterations_only():
    surface = rough(256)
    solver = FFTBEM(modulus=MODULUS, tolerance=1e-8)
    first = solver.solve(surface, 1000.0)
    again = solver.solve(surface, 1005.0, start=first)
    cold = solver.solve(surface, 1005.0)
    np.testing.assert_allclose(again.pressure, cold.pressure, atol=1e-6 * cold.pressure.max())
    assert again.convergence["levels"] == [{"pixels": [256, 256], "iterations": again.iterations}]


@pytest.mark.parametrize("levels", [1, 2, None])
def test_the_start_from_coarse_grids_changes_the_cost_only(levels):
    surface = rough(256)
    contact = FFTBEM(modulus=MODULUS, levels=levels, tolerance=1e-8).solve(surface, 1000.0)
    plain = FFTBEM(modulus=MODULUS, precision="double", tolerance=1e-9).solve(surface, 1000.0)
    np.testing.assert_allclose(contact.pressure, plain.pressure, atol=1e-5 * plain.pressure.max())
    assert levels is None or len(contact.convergence["levels"]) == levels


# -- displacement control and sweeps ----------------------------------------------------------------------------------


@pytest.mark.parametrize("mean", [0.003, 0.1, 1.0])
@pytest.mark.parametrize("periodic", [True, False])
def test_displacement_control_is_the_inverse_of_load_control(mean, periodic):
    surface = Surface(heights=rough(128).heights, pixel_size=0.5, periodic=periodic)
    solver = FFTBEM(modulus=MODULUS, tolerance=1e-7)
    contact = solver.solve(surface, mean * surface.nominal_area)
    assert contact.displacement is not None
    back = solver.solve_displacement(surface, contact.displacement)
    assert back.load == pytest.approx(contact.load, rel=1e-4)
    assert back.displacement == pytest.approx(contact.displacement, rel=1e-12)
    np.testing.assert_allclose(back.pressure, contact.pressure, atol=2e-4 * contact.pressure.max())


def test_displacement_of_a_sphere_gives_the_hertz_load():
    surface = Sphere(radius=30.0, pixels=128, pixel_size=0.15).make()
    load = FFTBEM(modulus=MODULUS).solve_displacement(surface, "5 angstrom").load
    assert load == pytest.approx(4 / 3 * MODULUS * math.sqrt(30.0) * 0.5**1.5, rel=5e-3)


def test_a_sweep_is_the_area_load_curve():
    surface = rough(256)
    solver = FFTBEM(modulus=MODULUS)
    loads = [3000.0, "100 nN", 0.0, 3100.0, 4e5]
    contacts = solver.sweep(surface, loads)
    assert [c.load for c in contacts] == [3000.0, 100.0, 0.0, 3100.0, 4e5]
    areas = [c.area for c in sorted(contacts, key=lambda c: c.load)]
    assert areas == sorted(areas)
    assert areas[0] == 0
    alone = solver.solve(surface, 3100.0)
    assert contacts[3].area == pytest.approx(alone.area, rel=2e-3)


# -- rough surfaces ---------------------------------------------------------------------------------------------------


def test_area_lies_between_persson_and_bush_gibson_thomas():
    """κ between 1.596 and 2.507 at small loads; Persson's fraction is a lower bound and exact towards full contact."""
    kappas = []
    for seed in range(3):
        surface = rough(512, seed, zeta=80, eta=4)
        contact = FFTBEM(modulus=MODULUS).solve(surface, 0.02 * MODULUS * surface.rms_slope * surface.nominal_area)
        kappas.append(contact.corrected_area / contact.area * contact.kappa)
    assert 1.596 < np.mean(kappas) < 2.507
    assert 2.0 < np.mean(kappas) < 2.4
    surface = rough(512, 3, zeta=80, eta=4)
    for x, slack in ((0.1, 0.1), (0.3, 0.1), (0.6, 0.06), (1.0, 0.02), (1.3, 0.01)):
        contact = FFTBEM(modulus=MODULUS).solve(surface, x * MODULUS * surface.rms_slope * surface.nominal_area)
        persson = float(theory.persson_area_fraction(x))
        assert persson < contact.area_fraction < min(persson + slack, float(theory.bgt_area_fraction(x)))


def test_pixel_correction_brings_coarse_grids_nearer_to_fine_ones():
    """The same surface on four grids: what the rim pixels add is taken away (Yastrebov et al. 2017)."""
    raw, corrected = [], []
    for pixels in (128, 256, 512):
        surface = rough(pixels, zeta=24, pixel_size=256 / pixels)
        contact = FFTBEM(modulus=MODULUS).solve(surface, 0.04 * MODULUS * 0.1 * 256.0**2)
        raw.append(contact.area_fraction)
        corrected.append(contact.corrected_area / contact.nominal_area)
    assert abs(corrected[0] - corrected[-1]) < 0.5 * abs(raw[0] - raw[-1])


def test_pressures_are_distributed_as_persson_says_at_high_load():
    surface = rough(512, zeta=80, eta=4)
    x = 1.0
    mean = x * MODULUS * surface.rms_slope
    contact = FFTBEM(modulus=MODULUS).solve(surface, mean * surface.nominal_area)
    edges, density = contact.pressure_histogram(bins=12, upper=4 * mean)
    centres = (edges[1:] + edges[:-1]) / 2
    expected = theory.persson_pressure_density(centres, mean, MODULUS, surface.rms_slope)
    assert np.abs(density * contact.area_fraction - expected).max() < 0.12 * expected.max()


@pytest.mark.parametrize(
    ("hurst", "zeta", "eta"),
    [
        *((0.8, 15, 3), (0.3, 150, 3)),
        *(
            pytest.param(*one, marks=pytest.mark.long)
            for one in ((0.8, 150, 3), (0.5, 150, 3), (0.8, 150, 10), (0.8, 150, 1))
        ),
    ],
)
def test_iterations_stay_few_from_vanishing_load_to_full_contact(hurst, zeta, eta):
    """Fewer than 60 at a tolerance of 1e-6, for the surfaces of the paper's Table 1."""
    surface = rough(320, hurst=hurst, zeta=zeta, eta=eta, rms_slope=0.05)
    solver = FFTBEM(modulus=MODULUS, tolerance=1e-6)
    for mean in (1e-6 * MODULUS, 0.002, 0.1, 1.0, 3.0):
        assert solver.solve(surface, mean * surface.nominal_area).iterations < 60


@pytest.mark.parametrize("slope", [1e-4, 1.0])
def test_iterations_do_not_depend_on_the_slope(slope):
    counts = [
        FFTBEM(modulus=MODULUS, tolerance=1e-6).solve(surface, 0.05 * MODULUS * s * surface.nominal_area).iterations
        for s in (0.1, slope)
        for surface in [rough(256, rms_slope=s)]
    ]
    assert abs(counts[0] - counts[1]) <= 2


def test_iterations_grow_slowly_with_the_grid():
    counts = [
        FFTBEM(modulus=MODULUS, tolerance=1e-6).solve(surface, 0.016 * surface.nominal_area).iterations
        for pixels in (128, 512)
        for surface in [rough(pixels, zeta=pixels // 16)]
    ]
    assert counts[1] < 1.5 * counts[0] + 1
