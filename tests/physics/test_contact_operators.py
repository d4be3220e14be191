"""The elastic operators apart from the solver: symbols, kernels, and the split approximation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from independent_contact import Body, evaluate
from scipy.integrate import dblquad
from scipy.linalg import expm, schur

from chemage import InputError, Surface
from chemage_contact import FFTBEM, _kernels, _operators
from chemage_contact._grid import Convolution, Split, along_columns, along_rows, resampled, suits
from chemage_contact._iteration import projected
from chemage_contact._kernels import Blocks, Heights
from chemage_contact._operators import Active, FreeHalfSpace, PeriodicHalfSpace, PeriodicLayer, Team
from chemage_surfaces import SelfAffine

TEAM = Team(1)


def convolved(body, x, dtype=np.float64):
    operator = Convolution(body, body.symbol(), dtype, "scipy", TEAM, floating=False)
    return operator.apply(x) * operator.unit


def test_a_wave_of_pressure_moves_the_half_space_by_two_over_q():
    body = PeriodicHalfSpace((24, 30), (0.5, 0.5))
    x, y = np.meshgrid(np.arange(24), np.arange(30), indexing="ij")
    for i, j in ((1, 0), (0, 2), (5, -7), (12, 15)):
        wave = np.cos(2 * np.pi * (i * x / 24 + j * y / 30))
        q = 2 * np.pi / 0.5 * math.hypot(i / 24, j / 30)
        np.testing.assert_allclose(convolved(body, wave), 2 / q * wave, atol=1e-12)


@pytest.mark.parametrize(("i", "j"), [(0, 0), (1, 0), (2, 3)])
def test_love_kernel_is_the_integral_of_boussinesq(i, j):
    """u = (1/πE*) ∫ dx dy / r over a pixel of 0.5 × 0.8 nm."""
    pixel = (0.5, 0.8)
    kernel = _operators._love(np.arange(4.0), np.arange(4.0), pixel)

    def integrand(y, x):
        return 1 / math.hypot(x, y)

    x0, y0 = (i - 0.5) * pixel[0], (j - 0.5) * pixel[1]
    if i == j == 0:  # the corner of a quarter pixel is the singular point
        value = 4 * dblquad(integrand, 0, pixel[0] / 2, 0, pixel[1] / 2, epsabs=1e-9)[0]
    elif j == 0:
        value = 2 * dblquad(integrand, x0, x0 + pixel[0], 0, pixel[1] / 2)[0]
    else:
        value = dblquad(integrand, x0, x0 + pixel[0], y0, y0 + pixel[1])[0]
    assert kernel[i, j] == pytest.approx(value / math.pi, rel=1e-6)


@pytest.mark.parametrize("shape", [(7, 9), (16, 16), (1, 12), (5, 1), (1, 1)])
def test_free_convolution_is_the_plain_sum(shape):
    """No image of the pressure acts on any pixel."""
    body = FreeHalfSpace(shape, (0.5, 0.5))
    x = np.random.default_rng(1).random(shape)
    kernel = _operators._love(np.arange(shape[0], dtype=float), np.arange(shape[1], dtype=float), (0.5, 0.5))
    expected = np.zeros(shape)
    for i in range(shape[0]):
        for j in range(shape[1]):
            di, dj = np.abs(np.arange(shape[0]) - i), np.abs(np.arange(shape[1]) - j)
            expected[i, j] = np.sum(kernel[np.ix_(di, dj)] * x)
    np.testing.assert_allclose(convolved(body, x), expected, rtol=1e-10)


def test_far_away_a_pixel_is_a_point_force():
    kernel = _operators._love(np.array([0.0, 4000.0]), np.array([0.0, 3000.0]), (0.5, 0.5))
    assert kernel[1, 1] == pytest.approx(0.25 / (math.pi * 2500.0), rel=1e-6)


def test_thick_layer_is_a_half_space_and_thin_layer_a_bed_of_springs():
    shape, pixel = (32, 24), (0.5, 0.5)
    half_space = PeriodicHalfSpace(shape, pixel).symbol()
    thick = PeriodicLayer(shape, pixel, 1e4, 0.3).symbol()
    np.testing.assert_allclose(thick.ravel()[1:], half_space.ravel()[1:], rtol=1e-12)
    thin = PeriodicLayer(shape, pixel, 1e-4, 0.3).symbol()
    np.testing.assert_allclose(thin, 1e-4 * (1 - 0.6) / 0.7**2, rtol=1e-3)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_layer_symbol_is_smooth_where_its_series_takes_over(poisson):
    """Grids whose wave numbers lie just below and just above the switch give the same function."""

    def symbol(extent):  # the longest wave of a grid of two pixels
        return PeriodicLayer((2, 1), (extent / 2, extent / 2), 1.0, poisson).symbol()[1, 0]

    switch = 4 * math.pi / 1e-3
    below, above = symbol(switch * (1 + 1e-6)), symbol(switch * (1 - 1e-6))
    assert below == pytest.approx(above, rel=1e-5)


def states(c11, c13, c33, c44):
    """d/dz of (ux, uz, σxz, σzz) under a wave of unit wave number along x, in plane strain of a transversely isotropic
    body with the axis along z (ux and σxz a quarter of a wave ahead)."""
    inner = np.array([c13, 0, 0, 1]) / c33
    return np.array([[0, -1, 1 / c44, 0], inner, c11 * np.eye(4)[0] - c13 * inner, [0, 0, 1, 0]])


def compliance(layer, thickness, below):
    """uz under a unit wave of pressure, by the equations of elasticity: the layer carries the state of the face down,
    where it is one that decays in the half-space."""
    _, basis, _ = schur(below, sort="lhp")
    down = expm(layer * thickness)
    solved = np.linalg.solve(np.column_stack([down[:, :2], -basis[:, :2]]), down[:, 3])
    return solved[1]


def isotropic(young, poisson):
    lame, shear = young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)
    return states(lame + 2 * shear, lame, lame + 2 * shear, shear)


@pytest.mark.parametrize("below", [(1e-3, 0.4), (0.2, 0.1), (1.0, 0.3), (30.0, 0.3), (1e6, 0.0)])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.499])
def test_coating_obeys_the_equations_of_elasticity(below, poisson):
    """One wave of 4 nm on a layer of any thickness; a rigid half-space is a rigid base, a like one no layer at all."""
    modulus = 1 / (1 - poisson**2)
    shears = [young / 2 / (1 + nu) for young, nu in ((1.0, poisson), below)]
    for depth in (1e-4, 0.01, 0.3, 1.0, 4.0):
        body = PeriodicLayer((8, 1), (0.5, 0.5), depth * 4 / 2 / math.pi, poisson, shears[0] / shears[1], below[1])
        found = body.symbol()[1, 0] / modulus
        expected = compliance(isotropic(1.0, poisson), depth, isotropic(*below)) * 4 / 2 / math.pi
        assert found == pytest.approx(expected, rel=1e-7)


def test_coating_has_the_limits_of_both_bodies():
    shape, pixel = (32, 24), (0.5, 0.5)
    half_space = PeriodicHalfSpace(shape, pixel).symbol()
    for ratio, below in ((0.1, 0.3), (7.0, 0.5)):
        moduli = ratio * (1 - below) / (1 - 0.2)  # of layer and half-space
        thin = PeriodicLayer(shape, pixel, 1e-9, 0.2, ratio, below).symbol()
        np.testing.assert_allclose(thin, moduli * half_space, rtol=1e-6)
        thick = PeriodicLayer(shape, pixel, 1e12, 0.2, ratio, below).symbol()
        np.testing.assert_allclose(thick, half_space, rtol=1e-12)
    for thickness in (1e-6, 0.1, 1.0, 30.0):
        same = PeriodicLayer(shape, pixel, thickness, 0.2, 1.0, 0.2).symbol()
        np.testing.assert_allclose(same, half_space, rtol=1e-12)
        rigid = PeriodicLayer(shape, pixel, thickness, 0.2, 1e-12, 0.3).symbol()
        np.testing.assert_allclose(rigid[1:], PeriodicLayer(shape, pixel, thickness, 0.2).symbol()[1:], rtol=1e-4)


def test_layer_on_a_rigid_base_is_that_of_carbone_and_mangialardi():
    nu, x = 0.3, 2 * 2 * math.pi / 4 * np.array([0.1, 1.0, 7.0])
    stated = (3 - 4 * nu) * np.sinh(x) - x
    stated /= 5 + x**2 / 2 - 4 * nu * (3 - 2 * nu) + (3 - 4 * nu) * np.cosh(x)
    found = [PeriodicLayer((8, 1), (0.5, 0.5), t, nu).symbol()[1, 0] for t in (0.1, 1.0, 7.0)]
    np.testing.assert_allclose(found, 2 * 4 / 2 / math.pi * stated, rtol=1e-12)


def test_a_stiff_substrate_brings_less_of_a_coating_into_contact():
    surface = SelfAffine(pixels=64, pixel_size=0.5, hurst=0.8, zeta=10, eta=2, rms_slope=0.1).make(1)
    solver = FFTBEM(modulus=35.3, thickness="2 nm")
    areas = [
        solver.replace(substrate=below).solve(surface, 300.0).area_fraction
        for below in (None, ["350 GPa", 0.2], [35.3 * (1 - 0.25**2), 0.25], ["3 GPa", 0.2])
    ]
    assert areas == sorted(areas)
    assert areas[2] == pytest.approx(FFTBEM(modulus=35.3).solve(surface, 300.0).area_fraction, abs=1e-3)
    with pytest.raises(InputError, match="substrate: it lies below a layer; give the thickness"):
        FFTBEM(modulus=35.3, substrate=["350 GPa", 0.2])


@pytest.mark.parametrize("constants", [(3.0, 1.0, 2.0, 0.7), (60.0, 27.0, 180.0, 20.0), (209.7, 105.1, 210.9, 42.5)])
def test_transversely_isotropic_modulus_obeys_the_equations_of_elasticity(constants):
    """uz = 2p/(E*q); the last constants are those of zinc oxide, in GPa."""
    names = ("c11", "c13", "c33", "c44")
    solver = FFTBEM(modulus=dict(zip(names, constants, strict=True)))
    body = states(*constants)
    assert solver.modulus == pytest.approx(2 / compliance(body, 0.0, body), rel=1e-10)


def test_thin_layer_presses_like_springs():
    surface = SelfAffine(pixels=64, pixel_size=0.5, hurst=0.8, zeta=10, eta=2, rms_slope=0.1).make(1)
    thickness, poisson = 0.005, 0.25
    contact = FFTBEM(modulus=35.3, thickness=thickness, poisson_ratio=poisson).solve(surface, 300.0)
    stiffness = 35.3 * (1 - poisson) ** 2 / (thickness * (1 - 2 * poisson))
    assert contact.displacement is not None
    springs = stiffness * np.maximum(contact.displacement - (surface.heights.max() - surface.heights), 0)
    np.testing.assert_allclose(contact.pressure, springs, atol=0.01 * springs.max())


def test_parseval_energy_is_the_product_of_pressure_and_displacement():
    for body in (
        PeriodicHalfSpace((20, 21), (0.5, 0.5)),
        PeriodicHalfSpace((9, 16), (0.5, 0.5)),
        FreeHalfSpace((11, 8), (0.5, 0.5)),
    ):
        operator = Convolution(body, body.symbol(), np.float64, "scipy", TEAM, floating=False)
        x = np.random.default_rng(2).standard_normal(body.shape)
        energy = operator.energy(operator.spectrum(x))
        assert energy == pytest.approx(float(np.vdot(x, operator.apply(x))), rel=1e-10)


# -- the split operator -----------------------------------------------------------------------------------------------


def blocks(shape, width):
    """All blocks of a grid, all of them active."""
    per_row = -(-shape[1] // width)
    return Blocks(width, per_row, np.ones(shape[0] * per_row, np.uint8))


def axes_of(shape, coarse):
    return along_rows(shape[0], coarse[0], float), along_columns(shape[1], coarse[1], float)


@pytest.mark.parametrize(
    ("shape", "coarse"),
    [((128, 132), (32, 33)), ((129, 135), (33, 35)), ((130, 262), (36, 66)), ((128, 133), (32, 36))],
)
def test_interpolation_is_linear_and_the_transpose_of_restriction(shape, coarse):
    rng = np.random.default_rng(3)
    x, far = rng.standard_normal(shape), rng.standard_normal(coarse)
    grid = blocks(shape, 64)
    down, up, part = np.empty(coarse), np.empty(shape), np.empty((grid.active.size, 1))
    axes = axes_of(shape, coarse)
    _kernels.restrict(0, coarse[0], grid, x, *axes, down)
    _kernels.local(0, shape[0], grid, x, np.zeros((5, 5)), far, *axes, up, part)
    assert np.vdot(down, far) == pytest.approx(np.vdot(x, up), rel=1e-12)
    assert part.sum() == pytest.approx(np.vdot(x, up), rel=1e-12)
    expected = far
    for axis, (n, m) in enumerate(zip(shape, coarse, strict=True)):
        ends = np.concatenate([expected, np.take(expected, [0], axis)], axis)
        place = np.arange(n) * m / n
        expected = np.apply_along_axis(
            lambda line, place=place: np.interp(place, np.arange(line.size), line), axis, ends
        )
    np.testing.assert_allclose(up, expected, atol=1e-12)


def test_stencil_is_a_periodic_convolution():
    from scipy.ndimage import correlate

    rng = np.random.default_rng(4)
    x = rng.standard_normal((128, 160))
    quarter = rng.standard_normal((5, 5))
    quarter[2:, 4] = quarter[4, 2:] = 0  # corners beyond the reach
    reach = np.abs(np.arange(-4, 5))
    out, part = np.empty_like(x), np.empty((384, 1))
    axes = axes_of(x.shape, (32, 40))
    _kernels.local(0, 128, blocks(x.shape, 64), x, quarter, np.zeros((32, 40)), *axes, out, part)
    assert part.sum() == pytest.approx(np.vdot(x, out), rel=1e-12)
    np.testing.assert_allclose(out, correlate(x, quarter[np.ix_(reach, reach)], mode="wrap"), atol=1e-12)


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize(
    "body",
    [
        PeriodicHalfSpace((256, 128), (0.5, 0.5)),
        PeriodicHalfSpace((250, 133), (0.5, 0.5)),
        PeriodicLayer((128, 128), (0.5, 0.5), 20.0),
        PeriodicLayer((128, 131), (0.5, 0.5), 20.0),
    ],
)
def test_split_operator_is_accurate_to_about_ten_per_cent(body, inverse):
    """In the norm of the operator, for white noise and for smooth pressures; this bounds the defect correction."""
    assert suits(body)
    team, (width, _) = TEAM, _kernels.widths(body.shape[1])
    part = np.empty((blocks(body.shape, width).active.size, 1))
    split = Split(body, np.float64, "scipy", team, inverse=inverse, floating=not inverse)
    unit = 0.5
    symbol = body.inverse() * unit if inverse else body.symbol() / unit
    if not inverse:
        symbol[0, 0] = 0
    rows = np.minimum(np.arange(body.shape[0]), body.shape[0] - np.arange(body.shape[0]))
    full = symbol[rows]
    one_over = np.where(full > 0, 1 / np.where(full > 0, full, 1), 0)
    noise = np.random.default_rng(5).standard_normal(body.shape)
    q = np.hypot(np.fft.fftfreq(body.shape[0])[:, None], np.fft.rfftfreq(body.shape[1]))
    for cut in (1.0, 0.1, 0.03):
        x = np.fft.irfft2(np.fft.rfft2(noise) * (q < cut), s=body.shape)
        x -= x.mean()
        exact = np.fft.irfft2(np.fft.rfft2(x) * full, s=body.shape)
        every = blocks(body.shape, width)
        everywhere = Active(every.active, width, every.per_row, 1)
        error = split.apply(x, everywhere, np.empty_like(x), part) - exact

        def norm(f):
            return math.sqrt(np.vdot(f, np.fft.irfft2(np.fft.rfft2(f) * one_over, s=body.shape)))

        assert norm(error) < 0.15 * norm(exact)


def test_blocks_that_are_not_active_are_not_written():
    body = PeriodicHalfSpace((128, 128), (0.5, 0.5))
    split = Split(body, np.float64, "scipy", TEAM, inverse=False, floating=True)
    mask = np.zeros((128, 2), np.uint8)
    mask[30:50, 1] = 1
    x = np.zeros((128, 128))
    x[35:45, 70:90] = 1.0
    part = np.empty((256, 1))
    everywhere = split.apply(x, Active(np.ones(256), 64, 2, 1), np.empty_like(x), part).copy()
    out = split.apply(x, Active(mask.ravel(), 64, 2, 1), np.full_like(x, np.nan), part)
    seen = np.isfinite(out)
    np.testing.assert_array_equal(seen, np.repeat(mask, 64, axis=1).astype(bool))
    np.testing.assert_allclose(out[seen], everywhere[seen], rtol=1e-12)


@pytest.mark.parametrize("columns", [1, 3, 130, 513, 15873, 16385, 20483])
def test_blocks_cover_a_row_and_the_last_one_holds_the_reach_of_the_stencil(columns):
    width, per_row = _kernels.widths(columns)
    last = columns - width * (per_row - 1)
    assert min(columns, _kernels.REACH) <= last <= width <= _kernels.WIDTH


@pytest.mark.parametrize("shape", [(129, 250), (625, 130), (144, 129), (251, 131), (128, 160)])
def test_a_grid_of_any_size_needs_few_transforms(shape):
    """Those that odd, even and prime sizes need are those of multiples of four, whether or not the gap is asked for."""
    rng = np.random.default_rng(6)
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    heights = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) / (0.01 + q) ** 1.8 * (q < 0.2), s=shape)
    surface = Surface(heights=0.1 * heights / np.abs(np.diff(heights, axis=0)).std(), pixel_size=1.0)
    for mean in (0.02, 0.3):
        one, two, gap = (
            FFTBEM(modulus=35.3, threads=threads, gap=gap).solve(surface, mean * surface.nominal_area)
            for threads, gap in ((1, False), (2, False), (1, True))
        )
        assert one.pressure.tobytes() == two.pressure.tobytes() == gap.pressure.tobytes()
        assert one.convergence["transforms"] <= 20
        errors = evaluate(Body(35.3, 1.0), surface.heights, one.pressure)
        assert errors.error < 1.1e-5


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_shares_cover_everything_once_and_balance_the_active_blocks(threads):
    rng = np.random.default_rng(9)
    mask = np.zeros((640, 5), np.uint8)
    mask[500:620] = rng.random((120, 5)) < 0.9
    mask[::7] = 1
    shares = Active(mask.ravel(), 1024, 5, threads)
    for edges, size in ((shares.block_edges, 3200), (shares.row_edges, 640)):
        assert edges[0] == 0
        assert edges[-1] == size
        assert len(edges) == threads + 1
        assert np.all(np.diff(edges) >= 0)
    active = [mask.ravel()[a:b].sum() for a, b in itertools.pairwise(shares.block_edges)]
    assert max(active) - min(active) < 0.35 * mask.sum() / threads  # blocks that are skipped have a cost, too
    for count in (0, 5, 511, 512, 10_001):
        seen = np.zeros(count, int)

        def visit(lo, hi, seen=seen):
            seen[lo:hi] += 1

        with Team(threads) as team:
            team.run(visit, count)
        assert np.all(seen == 1)


# -- helpers of the iteration -----------------------------------------------------------------------------------------


def test_projection_is_onto_mean_one():
    q = np.random.default_rng(6).standard_normal((30, 20)) * 3
    p = projected(q)
    assert p.min() == 0
    assert p.mean() == pytest.approx(1.0, rel=1e-12)
    level = (q - p)[p > 0]
    np.testing.assert_allclose(level, level[0], atol=1e-12)  # the same shift everywhere inside
    assert np.all(q[p == 0] <= level[0] + 1e-12)


def test_resampling_keeps_planes_and_pixels():
    x, y = np.meshgrid(np.arange(12.0), np.arange(10.0), indexing="ij")
    plane = 2 * x - y
    finer = resampled(plane, (24, 20), np.float64, False, TEAM)
    np.testing.assert_allclose(finer[::2, ::2], plane, atol=1e-12)
    np.testing.assert_allclose(finer[1:-1:2, :-1:2], (plane[1:] + plane[:-1])[:, :] / 2, atol=1e-12)


def test_a_new_substrate_needs_no_other_solver():
    """A half-space with a symbol of its own: the solver only uses the members of the protocol."""
    from dataclasses import dataclass

    from chemage_contact import _iteration

    @dataclass(frozen=True)
    class Anisotropic(PeriodicHalfSpace):
        def symbol(self):
            q = _operators.wave_numbers(self.shape, (self.pixel[0] * 2, self.pixel[1]))
            q[0, 0] = np.inf
            return 2 / q

    heights = SelfAffine(pixels=128, pixel_size=0.5, hurst=0.8, zeta=16, eta=2, rms_slope=0.1).make(1).heights
    unit = heights.std()
    scaled = (heights - heights.max()) / unit
    body = Anisotropic((128, 128), (0.5, 0.5))
    settings = _iteration.Settings(tolerance=1e-6)
    found = _iteration.solve(body, Heights(scaled), stiffness=0.2 / 35.3 * 0.5 / unit, settings=settings, team=TEAM)
    assert found.converged
    plain = Surface(heights=heights, pixel_size=0.5)
    isotropic = FFTBEM(modulus=35.3).solve(plain, 0.2 * plain.nominal_area)
    assert abs(np.mean(found.pressure > 0) - isotropic.area_fraction) > 0.01
