"""A hardness: 0 ≤ p ≤ H at the given load, against full yield, the elastic solution, an independent evaluation of the
conditions, a dense solver, and the sphere in one dimension; unloading and loading again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, optimize, special

import chemage as ca
from chemage import InputError, Surface
from chemage_contact import FFTBEM, Hertz, _iteration, _kernels
from chemage_contact._bounds import projected, ranked, shift_to
from chemage_contact._yielding_sphere import ONSET, Ring, yielding_sphere
from chemage_surfaces import SelfAffine, Sphere

MODULUS = 35.3


def rough(pixels=128, seed=1, **options):
    options = {"pixel_size": 0.5, "hurst": 0.8, "zeta": 16, "eta": 3, "rms_slope": 0.4} | options
    return SelfAffine(pixels=pixels, **options).make(seed)


def bem(hardness, **options):
    return FFTBEM(modulus=MODULUS, hardness=hardness, **options)


def flow(contact) -> np.ndarray:
    """Its plastic displacement, which is known."""
    assert contact.plastic_displacement is not None
    return contact.plastic_displacement


def approach(contact) -> float:
    assert contact.displacement is not None
    return contact.displacement


def violations(surface, contact, hardness, thickness=None):
    """Errors of the conditions, nm: rms gap of free pixels, penetration outside, positive gap where it yields. From the
    pressure alone, with the Green's functions of this test."""
    p = contact.pressure.astype(float)
    shape = p.shape if surface.periodic else tuple(2 * n for n in p.shape)
    if surface.periodic:
        q = 2 * np.pi / surface.pixel_size * np.hypot(*np.ix_(*(np.fft.fftfreq(n) for n in shape)))
        q[0, 0] = 1.0
        symbol = 2 / (MODULUS * q)
        if thickness is not None:
            nu, x = 0.25, np.minimum(2 * q * thickness, 300.0)
            top = (3 - 4 * nu) * np.sinh(x) - (2 - 0.0) * x * 0.5
            symbol *= top / (5 + 0.5 * x * x - 4 * nu * (3 - 2 * nu) + (3 - 4 * nu) * np.cosh(x))
        symbol[0, 0] = 0.0
    else:
        place = [np.minimum(np.arange(n), n - np.arange(n)) * surface.pixel_size for n in shape]
        a = 0.5 * surface.pixel_size
        love = np.zeros(shape)
        for sx in (-a, a):
            for sy in (-a, a):
                x, y = place[0][:, None] + sx, place[1] + sy
                love += np.sign(sx * sy) * (x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y)))
        symbol = np.fft.fft2(love / (np.pi * MODULUS)).real
    gap = np.fft.ifft2(np.fft.fft2(p, shape) * symbol).real[: p.shape[0], : p.shape[1]] - surface.heights
    full = p >= hardness * (1 - 2e-7)
    free = (p > 0) & ~full
    gap -= gap[free].mean()
    return math.sqrt(np.mean(gap[free] ** 2)), -gap[p == 0].min(initial=0.0), gap[full].max(initial=0.0)


# -- the ends of the scale --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periodic", [pytest.param(True, marks=pytest.mark.long), False])
def test_at_full_yield_the_area_is_load_over_hardness(periodic):
    """On a body so stiff that elastic displacements are nothing beside the heights, for a load of whole pixels."""
    surface = Surface(heights=rough().heights, pixel_size=0.5, periodic=periodic)
    hardness = 1e-6 * MODULUS
    load = 3000 * hardness * 0.25
    contact = bem(hardness).solve(surface, load)
    assert contact.area == pytest.approx(load / hardness, rel=1e-6)
    assert contact.pressure[contact.contact].min() > (1 - 1e-6) * hardness
    highest = np.sort(surface.heights, axis=None)[-3000]
    np.testing.assert_array_equal(contact.contact, surface.heights >= highest)


@pytest.mark.parametrize("mean", [pytest.param(1e-3, marks=pytest.mark.long), 0.3, 3.0, 200.0])
@pytest.mark.parametrize("precision", ["mixed", pytest.param("single", marks=pytest.mark.long)])
def test_a_hardness_that_is_not_reached_changes_nothing(mean, precision):
    surface = rough(256)
    load = mean * surface.nominal_area
    elastic = FFTBEM(modulus=MODULUS, precision=precision).solve(surface, load)
    hard = bem(1e3 * elastic.max_pressure, precision=precision).solve(surface, load)
    np.testing.assert_allclose(hard.pressure, elastic.pressure, atol=1e-4 * elastic.max_pressure)
    assert hard.area_fraction == pytest.approx(elastic.area_fraction, abs=2e-5)
    assert not flow(hard).any()
    assert hard.yielded == (0.0, 0.0)
    assert hard.iterations <= elastic.iterations + 2


def test_without_a_hardness_nothing_is_new():
    contact = FFTBEM(modulus=MODULUS).solve(rough(64), 100.0)
    assert contact.plastic_displacement is None
    assert "hardness" not in contact.provenance["options"]
    assert not {"yielded_area", "yielded_load"} & contact.summary().keys()
    assert all(math.isnan(share) for share in contact.yielded)
    with pytest.raises(InputError, match="give its solver a hardness"):
        contact.residual_surface(rough(64))


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("over", [1.001, 1.1, 3.0])
def test_near_full_yield_it_takes_no_more_transforms_than_the_elastic_contact(over, precision):
    surface = rough(256)
    load = 0.03 * surface.nominal_area
    elastic, hard = (bem(h, precision=precision).solve(surface, load) for h in (None, over * 0.03))
    assert hard.yielded.load > 0.98
    assert hard.iterations < elastic.iterations
    assert hard.convergence["transforms"] <= elastic.convergence["transforms"] + 2
    assert hard.convergence["force_error"] < (5e-7 if precision == "single" else 2e-13)


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("over", [0.0, 1e-9, 3e-8, 1e-6])
def test_a_hardness_that_is_the_mean_pressure_up_to_rounding(over, precision):
    """All of the surface yields, or all but part of a pixel."""
    surface = rough(64)
    load = 2.1 * surface.nominal_area
    contact = bem(2.1 * (1 + over), precision=precision).solve(surface, load)
    assert contact.area_fraction == 1
    assert contact.yielded.load > 0.999
    assert contact.pressure.sum(dtype=float) * 0.25 == pytest.approx(load, rel=2e-7 if precision == "single" else 1e-12)


# -- the conditions ---------------------------------------------------------------------------------------------------

CASES = {
    "default": {},
    "single": {"precision": "single"},
    "double": {"precision": "double", "tolerance": 1e-9},
    "one grid": {"levels": 1},
    "two grids": {"levels": 2},
    "free": {"boundary": "free"},
    "layer": {"thickness": 8.0},
    "gap": {"gap": True},
    "pressure tolerance": {"pressure_tolerance": 1e-6},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    ("mean", "hardness"), [pytest.param(0.05, 12.0, marks=pytest.mark.long), (0.5, 4.0), (1.5, 2.0)]
)
def test_the_conditions_hold(case, mean, hardness):
    options = CASES[case]
    made = rough(150 if case == "gap" else 128)
    surface = Surface(heights=made.heights, pixel_size=0.5, periodic=case != "free")
    contact = bem(hardness, **options).solve(surface, mean * surface.nominal_area)
    p = contact.pressure
    assert p.min() >= 0
    assert p.max() <= hardness
    assert p.sum(dtype=float) * 0.25 == pytest.approx(contact.load, rel=2e-6)
    assert contact.yielded.load > 0.02
    errors = violations(surface, contact, hardness, options.get("thickness"))
    scale = contact.convergence["scale"]
    noise = 2e-6 if case == "single" else 1e-9
    assert max(errors) < (1.01 * contact.residual + noise) * scale
    assert contact.residual < options.get("tolerance", 1e-5)
    assert contact.convergence["complementarity"] < 1e-5
    flows = flow(contact) > 0
    assert (p[flows] >= hardness * (1 - 2e-7)).all()
    if contact.gap is not None:
        assert not contact.gap[flows].any()
        assert np.abs(contact.gap[contact.contact]).max() < 1e-3 * surface.rms_height


@pytest.mark.parametrize("fft", ["ducc0", "pyfftw"])
def test_any_transform_library_solves_it(fft):
    pytest.importorskip(fft)
    surface = rough(64)
    one, other = (bem(4.0, tolerance=1e-8, fft=name).solve(surface, 500.0) for name in ("scipy", fft))
    np.testing.assert_allclose(one.pressure, other.pressure, atol=1e-5)


@pytest.mark.parametrize("shape", [(8, 8), (5, 9), (1, 30)])
@pytest.mark.parametrize("share", [0.15, 0.5, 0.95])
def test_a_general_optimiser_finds_the_same(shape, share):
    """½pᵀGp - pᵀh over 0 ≤ p ≤ H at the load, by SciPy's SLSQP with a dense G."""
    heights = np.random.default_rng(shape[0]).standard_normal(shape)
    heights += np.roll(heights, 1, 0) + np.roll(heights, 1, 1)
    q = 2 * np.pi / 0.5 * np.hypot(*np.ix_(*(np.fft.fftfreq(n) for n in shape)))
    q[0, 0] = np.inf
    n = heights.size
    unit = np.eye(n).reshape(n, *shape)
    dense = np.fft.ifft2(np.fft.fft2(unit, axes=(1, 2)) * 2 / (MODULUS * q), axes=(1, 2)).real.reshape(n, n)
    hardness, h = 8.0, heights.ravel()
    total = share * n * hardness
    found = optimize.minimize(
        lambda p: 0.5 * p @ dense @ p - p @ h,
        np.full(n, total / n),
        jac=lambda p: dense @ p - h,
        method="SLSQP",
        bounds=[(0.0, hardness)] * n,
        constraints={"type": "eq", "fun": lambda p: p.sum() - total, "jac": lambda p: np.ones(n)},
        options={"ftol": 1e-14, "maxiter": 1000},
    )
    contact = bem(hardness, tolerance=1e-10).solve(Surface(heights=heights, pixel_size=0.5), total * 0.25)
    p = contact.pressure.ravel()
    assert found.fun == pytest.approx(0.5 * p @ dense @ p - p @ h, rel=1e-7)
    np.testing.assert_allclose(p, found.x, atol=2e-3 * hardness)


@pytest.mark.long
def test_random_contacts_converge_or_are_refused():
    """Loads and hardnesses over decades: all converge in few iterations, and obey the conditions."""
    rng = np.random.default_rng(0)
    for k in range(150):
        n = int(rng.choice([32, 64, 100, 128]))
        surface = rough(n, int(k), rms_slope=10 ** rng.uniform(-2.5, 0.3), zeta=min(16, n // 8), eta=2)
        surface = Surface(heights=surface.heights, pixel_size=0.5, periodic=bool(rng.random() < 0.8))
        mean = MODULUS * surface.rms_slope * 10 ** rng.uniform(-5, 0.3)
        hardness = mean * 10 ** rng.uniform(-0.1, 4.5)
        load = mean * surface.nominal_area
        if hardness < mean:
            with pytest.raises(InputError, match="below the mean pressure"):
                bem(hardness).solve(surface, load)
            continue
        contact = bem(hardness).solve(surface, load)
        assert contact.iterations <= 60
        assert contact.pressure.max() <= hardness
        full = contact.pressure >= hardness
        if ((contact.pressure > 0) & ~full).any() and contact.area_fraction < 1:
            errors = violations(surface, contact, hardness)
            assert max(errors) < 2e-5 * contact.convergence["scale"] + 1e-6 * surface.rms_height, k


def test_a_start_and_the_threads_change_nothing():
    surface = rough(256)
    solver = bem(4.0, tolerance=1e-8)
    cold = solver.solve(surface, 3000.0)
    for start in (solver.solve(surface, 2990.0), FFTBEM(modulus=MODULUS).solve(surface, 3000.0)):
        warm = solver.solve(surface, 3000.0, start=start)
        np.testing.assert_allclose(warm.pressure, cold.pressure, atol=1e-5)
    again = solver.replace(threads=2).solve(surface, 3000.0)
    assert again.pressure.tobytes() == solver.replace(threads=1).solve(surface, 3000.0).pressure.tobytes()


@pytest.mark.parametrize("periodic", [True, False])
def test_the_load_follows_from_the_approach(periodic):
    surface = Surface(heights=rough().heights, pixel_size=0.5, periodic=periodic)
    solver = bem(4.0, tolerance=1e-8)
    contact = solver.solve(surface, 0.4 * surface.nominal_area)
    back = solver.solve_displacement(surface, approach(contact))
    assert back.load == pytest.approx(contact.load, rel=1e-4)
    np.testing.assert_allclose(back.pressure, contact.pressure, atol=1e-3)
    if periodic:  # beyond the approach that makes an elastic body flat all of it yields in the end
        all_yield = solver.solve_displacement(surface, float(np.ptp(surface.heights)) * 1.5)
        assert all_yield.load == pytest.approx(4.0 * surface.nominal_area)


def test_a_full_contact_that_yields():
    """Every pixel touches and the highest yield; the elastic solution is beyond the hardness."""
    surface = rough(64, rms_slope=0.1)
    elastic = FFTBEM(modulus=MODULUS).solve(surface, 50 * surface.nominal_area)
    assert elastic.area_fraction == 1
    hardness = 0.5 * (50 + elastic.max_pressure)
    contact = bem(hardness).solve(surface, 50 * surface.nominal_area)
    assert contact.area_fraction == 1
    assert 0 < contact.yielded.area < 1
    assert any("full contact" in note and "yield" in note for note in contact.notes)
    assert max(violations(surface, contact, hardness)) < 2e-5 * surface.rms_height


def test_the_mean_pressure_may_be_the_hardness():
    surface = rough(64)
    contact = bem(3.0).solve(surface, 3.0 * surface.nominal_area)
    np.testing.assert_allclose(contact.pressure, 3.0, rtol=1e-12)
    assert flow(contact).min() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(flow(contact) + surface.heights * -1) < 1e-9 * surface.rms_height


# -- unloading and loading again --------------------------------------------------------------------------------------


@pytest.mark.parametrize("hardness", [8.0, 3.0])
def test_loading_again_reproduces_the_contact_and_flows_beyond(hardness):
    surface = rough(128)
    solver = bem(hardness, tolerance=1e-8)
    first = solver.solve(surface, 2000.0)
    left = first.residual_surface(surface)
    elastic = FFTBEM(modulus=MODULUS, tolerance=1e-8)
    again = elastic.solve(left, 2000.0)
    np.testing.assert_allclose(again.pressure, first.pressure, atol=1e-5 * hardness)
    lower = float(surface.heights.max() - left.heights.max())  # the surfaces touch first where more is left
    assert approach(again) == pytest.approx(approach(first) - lower, abs=1e-6 * surface.rms_height)
    # below that load nothing flows, and at that load nothing more
    for load in (500.0, 1500.0, 2000.0):
        reloaded = solver.solve(left, load)
        assert reloaded.max_pressure <= hardness
        assert flow(reloaded).max() < 1e-6 * surface.rms_height
        np.testing.assert_allclose(reloaded.pressure, elastic.solve(left, load).pressure, atol=1e-4 * hardness)
        assert reloaded.area >= solver.solve(surface, load).area, "the flattened summits touch on a larger area"
    # beyond it, flow goes on from where it was: in one step or in two, the flow outside is that of the whole load
    more = solver.solve(left, 4000.0)
    whole = solver.solve(surface, 4000.0)
    assert more.yielded.load == pytest.approx(whole.yielded.load, rel=0.02)
    total = flow(first) + flow(more)
    np.testing.assert_allclose(more.pressure, whole.pressure, atol=1e-3 * hardness)
    np.testing.assert_allclose(total, flow(whole), atol=1e-4 * surface.rms_height)


def test_what_is_left_of_a_surface():
    surface = Sphere(radius=30.0, pixels=96, pixel_size=0.2).make()
    contact = Hertz(modulus=MODULUS, hardness=2.0).solve(surface, 100.0)
    left = contact.residual_surface(surface)
    np.testing.assert_array_equal(left.heights, surface.heights - flow(contact))
    assert left.periodic is False
    assert left.provenance["flowed"][0]["load"] == 100.0
    assert left.provenance["flowed"][0]["options"]["hardness"] == 2.0
    with pytest.raises(InputError, match="radius"):  # it is no sphere any more
        Hertz(modulus=MODULUS).solve(left, 10.0)
    # a second load adds to the record
    twice = bem(2.0).solve(left, 150.0).residual_surface(left)
    assert [entry["load"] for entry in twice.provenance["flowed"]] == [100.0, 150.0]
    with pytest.raises(InputError, match="is not the one of"):
        contact.residual_surface(Sphere(radius=31.0, pixels=96, pixel_size=0.2).make())


def test_the_flow_is_stored_shown_and_refused_where_it_is_wrong(tmp_path):
    surface = rough(64)
    contact = bem(4.0).solve(surface, 300.0)
    ca.write(tmp_path / "contact.h5", contact)
    assert ca.read(tmp_path / "contact.h5") == contact
    summary = contact.summary()
    assert (summary["yielded_area"], summary["yielded_load"]) == tuple(contact.yielded)
    flows = flow(contact) > 0
    assert summary["yielded_load"] == pytest.approx(4.0 * flows.sum() * 0.25 / 300.0)
    assert "plastic_displacement" in contact.to_xarray()
    for wrong, match in (
        (-np.ones((64, 64)), "only lowers"),
        (np.ones((3, 3)), "shape"),
        (np.full((64, 64), np.nan), "finite"),
    ):
        with pytest.raises(InputError, match=match):
            contact.model_copy(update={"plastic_displacement": wrong})


# -- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hardness", [0, -1.0, math.nan, math.inf, "3 nm", True])
@pytest.mark.parametrize("solver", [FFTBEM, Hertz])
def test_no_such_hardness(solver, hardness):
    with pytest.raises(InputError, match="hardness"):
        solver(modulus=MODULUS, hardness=hardness)


def test_a_hardness_below_the_mean_pressure_is_refused_before_and_in_the_solve():
    surface = rough(64)
    load = 2.0 * surface.nominal_area
    solver = bem(1.9)
    known = {"nx": 64.0, "ny": 64.0, "pixel_size": 0.5}
    for ask in (lambda: solver.solve(surface, load), lambda: solver.check(known, load)):
        with pytest.raises(InputError, match=r"hardness = 1\.9: is below the mean pressure .* at least 2 GPa"):
            ask()
    small = {"nx": 64.0, "ny": 64.0, "pixel_size": 0.2, "radius": 30.0}
    sphere = Sphere(radius=30.0, pixels=64, pixel_size=0.2).make()
    for ask in (
        lambda: Hertz(modulus=MODULUS, hardness=0.5).solve(sphere, 100.0),
        lambda: Hertz(modulus=MODULUS, hardness=0.5).check(small, 100.0),
    ):
        with pytest.raises(InputError, match=r"hardness = 0\.5: bears 100 nN .* at least 0\.777"):
            ask()


def test_the_area_is_expected_to_be_load_over_hardness_at_least():
    solver = bem(4.0)
    fraction = solver.expected({"nx": 64.0, "ny": 64.0, "pixel_size": 0.5, "rms_slope": 0.4}, 3000.0)["area_fraction"]
    assert fraction >= 3000.0 / 4.0 / 32**2


# -- the nearest admissible pressure ----------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 1.0])
def test_the_projection_is_the_nearest_admissible_pressure(share):
    rng = np.random.default_rng(3)
    q = rng.standard_normal((20, 30)) * rng.choice([0.01, 1.0, 30.0], (20, 30))
    p = projected(q, share * 2.0, 2.0)
    assert p.min() >= 0
    assert p.max() <= 2
    assert p.mean() == pytest.approx(2.0 * share)
    t = shift_to(q, share * 2.0 * q.size, 2.0)
    np.testing.assert_allclose(p, np.clip(q - t, 0.0, 2.0), atol=1e-12)  # the conditions of the nearest one


@pytest.mark.parametrize("kind", ["noise", "rows", "ties", "constant"])
@pytest.mark.parametrize("shape", [(3, 4), (300, 200)])
def test_numbers_of_a_rank_are_those_of_the_sorted_array(kind, shape):
    x = np.random.default_rng(5).standard_normal(shape)
    x = {"noise": x, "rows": np.sort(x, axis=None).reshape(shape), "ties": np.round(x), "constant": 0 * x}[kind]
    order = np.sort(x, axis=None)
    for share in (0.0, 0.01, 0.5, 0.999, 1.0):
        last = int(share * (x.size - 1))
        first = max(last - 1, 0)
        assert ranked(x, first, last) == (order[first], order[last])


def test_kernels_are_those_of_a_solve(monkeypatch):
    """A warm-up compiles each kernel that a solve with a hardness calls, for the same types."""
    surface, solver = rough(128), bem(4.0)
    body, settings = solver.body(surface), solver._settings()
    _iteration.compile_kernels(body, settings, bounded=True)
    before = {name: len(k.signatures) for name, k in vars(_kernels).items() if hasattr(k, "signatures")}
    solver.solve(surface, 500.0)
    assert before == {name: len(k.signatures) for name, k in vars(_kernels).items() if hasattr(k, "signatures")}


# -- a sphere in one dimension ----------------------------------------------------------------------------------------


def test_below_the_yield_pressure_it_is_hertz():
    surface = Sphere(radius=30.0, pixels=96, pixel_size=0.2).make()
    elastic = Hertz(modulus=MODULUS, gap=True).solve(surface, 50.0)
    peak = 1.5 * 50.0 / (math.pi * approach(elastic) * 30.0)
    hard = Hertz(modulus=MODULUS, hardness=1.0001 * peak, gap=True).solve(surface, 50.0)
    assert hard.pressure.tobytes() == elastic.pressure.tobytes()
    assert hard.gap is not None
    assert elastic.gap is not None
    assert hard.gap.tobytes() == elastic.gap.tobytes()
    assert approach(hard) == approach(elastic)
    soft = yielding_sphere(50.0, 30.0, MODULUS, 0.9999 * peak)
    assert soft is not None
    assert soft.edge == pytest.approx(math.sqrt(approach(elastic) * 30.0), rel=1e-6)
    assert soft.approach == pytest.approx(approach(elastic), rel=1e-6)


@pytest.mark.parametrize(
    "width", [0.9, *(pytest.param(width, marks=pytest.mark.long) for width in (0.5, 0.1, 1e-3)), 1e-6]
)
def test_the_ring_of_a_sphere_closes_the_gap_and_bears_the_load(width):
    """The pressure, turned into displacements by other integrals: u = (2/πE*) ∫ q(x)/√(r² - x²) dx over 0 … r with
    q(x) = 2 ∫ s p(s)/√(s² - x²) ds over x … a (method of dimensionality reduction, Popov & Heß)."""
    ring = Ring.of(width)
    core = 1.0 - width

    def line(x):
        """q(x) with s² = x² + t², where the pressure is the hardness in closed form."""
        inside = math.sqrt(max(core**2 - x * x, 0.0))
        end = math.sqrt(1.0 - x * x)
        middle, half = 0.5 * (inside + end), 0.5 * (end - inside)
        nodes, weights = np.polynomial.legendre.leggauss(60)
        angle = 0.5 * np.pi * nodes  # t = middle + half·sin, which removes the roots at both ends
        t = middle + half * np.sin(angle)
        values = ring.pressure(np.sqrt(x * x + t * t)) * half * np.cos(angle) * 0.5 * np.pi
        return 2.0 * (ring.hardness * inside + float(weights @ values))

    def displacement(r):
        kink = [math.asin(core / r)] if r > core else None
        return 2 / np.pi * integrate.quad(lambda a: line(r * math.sin(a)), 0, np.pi / 2, points=kink, epsabs=1e-10)[0]

    radii = core + width * np.array([0.15, 0.5, 0.85])
    level = [displacement(r) + 0.5 * r * r for r in radii]
    assert np.ptp(level) < 2e-7
    assert float(ring.displacement(np.ones(1))[0]) + 0.5 == pytest.approx(level[1], abs=1e-5)
    assert displacement(0.5 * core) + 0.125 * core**2 < level[1]  # it penetrates where it yields
    assert float(ring.displacement(np.array([0.5 * core]))[0]) == pytest.approx(displacement(0.5 * core), rel=1e-7)
    load, _ = integrate.quad(lambda r: 2 * np.pi * r * float(ring.pressure(np.array([r]))[0]), core, 1.0, limit=200)
    assert load + np.pi * core**2 * ring.hardness == pytest.approx(ring.load, rel=1e-7)


@pytest.mark.parametrize("wanted", [1.001, 3.0, 30.0, 1e3, 1e12, 1e250])
def test_the_area_of_a_sphere_grows_from_hertz_to_load_over_hardness(wanted):
    hardness = 2.0
    load = wanted * ONSET * hardness**3 * 30.0**2 / MODULUS**2
    sphere = yielding_sphere(load, 30.0, MODULUS, hardness)
    assert sphere is not None
    hertz = math.cbrt(0.75 * load * 30.0 / MODULUS)
    assert sphere.edge >= max(hertz, math.sqrt(load / hardness / math.pi)) * (1 - 1e-12)
    if wanted >= 1e12:
        assert math.pi * sphere.edge**2 == pytest.approx(load / hardness, rel=1e-9)
    # the limits of the parameters
    assert Ring.of(1 - 1e-6).hardness == pytest.approx(2 / math.pi, rel=1e-6)
    assert special.ellipe(0) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(("load", "hardness"), [pytest.param(400.0, 4.0, marks=pytest.mark.long), (50.0, 1.0)])
def test_a_sphere_that_yields_agrees_with_fft_bem(load, hardness):
    """Both converge to the same contact as pixels shrink."""
    errors = []
    for pixels in (64, 128, 256):
        surface = Sphere(radius=30.0, pixels=pixels, pixel_size=16 / pixels).make()
        exact = Hertz(modulus=MODULUS, hardness=hardness, gap=True).solve(surface, load)
        numerical = bem(hardness, tolerance=1e-7).solve(surface, load)
        assert exact.pressure.max() <= hardness
        assert exact.pressure.sum() * surface.pixel_size**2 == pytest.approx(load, rel=1e-12)
        moved, other = flow(exact), flow(numerical)
        errors.append(
            (
                abs(approach(exact) / approach(numerical) - 1),
                float(np.linalg.norm(moved - other) / np.linalg.norm(other)),
                abs(exact.area / numerical.corrected_area - 1),
            )
        )
        rim = float(np.linalg.norm(exact.pressure - numerical.pressure) / np.linalg.norm(numerical.pressure))
        assert rim < Hertz(modulus=MODULUS, hardness=hardness).declared_error
    assert all(last < first / 4 for first, last in zip(errors[0][:2], errors[-1][:2], strict=True))
    assert errors[-1][0] < 5e-4
    assert errors[-1][1] < 1e-3
    assert errors[-1][2] < 3e-3
