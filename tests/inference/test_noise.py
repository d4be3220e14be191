"""Errors that are inferred: the likelihood against its closed form, draws against their posterior, and whole cases."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from inferring import (
    LARGEST,
    NEAREST,
    RARE,
    SPREAD,
    WIDER,
    Chain,
    ErrorModel,
    Noise,
    Prior,
    Problem,
    State,
    effective,
    error_terms,
    make_model,
    unknowns_of,
    warm,
)

import chemage as ca

TIMES = np.logspace(-3, 5, 25)


def scene():
    data, _ = ca.plugin.scene_data("silica-tip")
    return ca.parse_scene(ca.plugin.override(data, {"observe": [], "interaction": None}))


def curve(forming, times=TIMES, noise=0.03):
    """A curve of the quadrature of the method ``closure``, and errors of 3 %."""
    made = scene()
    contact = ca.solve_contact(made.solver, ca.make_surface(made.surface), made.load)
    call = {"engine": made.engine, "hold_times": times, "temperature": 300.0, "replicas": 1}
    ageing = ca.age(contact, made.chemistry.replace(forming=forming), method=ca.ageing_method("closure"), **call)
    values = ageing.friction_drop[0]
    noisy = values * (1 + noise * np.random.default_rng(7).standard_normal(times.size))
    return ca.MeasuredCurve(load=made.load, temperature=300.0, hold_times=times, values=noisy, errors=noise * values)


def noise(size=12, **model):
    return Noise(
        ErrorModel(**model),
        np.linspace(0.5, 1.5, size),
        np.full(size, 0.1),
        np.repeat([0, 1], size // 2),
        np.tile(np.geomspace(1, 100, size // 2), 2),
        np.arange(2),
    )


@pytest.mark.parametrize("correlated", [False, True])
def test_white_residuals_have_the_likelihood_of_the_covariance(correlated):
    from scipy.stats import multivariate_normal

    one = noise(correlated=correlated)
    state = State(np.array([1.5, 2.0]), np.where(np.arange(12) == 3, WIDER, 1.0), np.zeros(0), 0.7)
    errors = np.hypot(np.array([1.5, 2.0])[one.curve] * state.inflation * one.stated, one.floors)
    apart = np.abs(np.log(one.hold_times)[:, None] - np.log(one.hold_times))
    near = np.where(one.curve[:, None] == one.curve, np.exp(-apart / np.exp(0.7)), 0.0)
    covariance = np.outer(errors, errors) * (near if correlated else np.eye(12))
    residual = np.random.default_rng(0).standard_normal(12)
    expected = multivariate_normal(np.zeros(12), covariance).logpdf(residual)
    found = one._logs(state, residual).sum() - 6 * np.log(2 * np.pi)
    assert found == pytest.approx(expected, rel=1e-10)
    white = one.white(state, residual)
    assert white @ white == pytest.approx(residual @ np.linalg.solve(covariance, residual), rel=1e-9)
    assert float(np.exp(-1e-9)) > NEAREST


def test_known_correlations_are_those_of_the_stated_errors():
    """A chain: the covariance is the product of the correlations of neighbours; errors of the model are independent."""
    near = np.tile([0.0, 0.9, 0.8, 0.95, 0.7, 0.9], 2)
    one = replace(noise(), near=near)
    state = replace(one.start, scales=np.array([1.5, 2.0]))
    share = one.stated / np.hypot(one.stated, one.floors)
    chain = np.eye(12)
    for i, j in zip(*np.triu_indices(12, 1), strict=True):
        chain[i, j] = chain[j, i] = np.prod((near * share * np.roll(share, 1))[i + 1 : j + 1])
    errors = one.errors(state)
    residual = np.random.default_rng(0).standard_normal(12)
    white = one.white(state, residual)
    assert white @ white == pytest.approx(residual @ np.linalg.solve(np.outer(errors, errors) * chain, residual))
    others = replace(one, near=np.where(one.curve == 1, near, np.nan), model=ErrorModel(correlated=True))
    expected = np.where(one.curve == 1, one.correlation(state), noise(correlated=True).correlation(state))
    assert others.correlation(state) == pytest.approx(expected)


def test_settled_measurements_are_independent_combinations():
    one = replace(noise(), near=np.tile([0.0, 0.9, 0.8, 0.95, 0.7, 0.9], 2))
    matrix = np.random.default_rng(0).random((1, 12, 3))
    problem = Problem(Prior(np.linspace(0, 1, 3)), np.ones(3), np.arange(12.0), one, matrix, np.ones((1, 12)))
    settled = problem.settled(one.start)
    assert settled.errors == pytest.approx(1.0)
    density = np.array([0.2, 0.4, 0.1])
    residual = settled.values - settled.offsets[0] - settled.matrices[0] @ density
    assert residual == pytest.approx(one.white(one.start, problem.values - 1 - matrix[0] @ density))


def test_the_drawn_scale_has_its_posterior():
    """Against the integral of likelihood × prior over a grid of scales."""
    one = noise(40, scaled=True)
    residual = 2.0 * one.stated * np.random.default_rng(2).standard_normal(40)
    grid = np.linspace(1, LARGEST, 4001)
    errors = np.hypot(grid[:, None] * one.stated, one.floors)[:, :20]
    logs = (-0.5 * (residual[:20] / errors) ** 2 - np.log(errors)).sum(axis=1)
    weights = np.exp(logs - logs.max() - 0.5 * (np.log(grid) / SPREAD) ** 2) / grid
    mean = weights @ grid / weights.sum()
    rng, state, drawn = np.random.default_rng(3), one.start, []
    for _ in range(4000):
        state = one.drawn(state, residual, np.zeros(40), rng)
        drawn.append(state.scales[0])
    assert np.mean(drawn) == pytest.approx(mean, rel=0.02)


@pytest.mark.parametrize("correlated", [False, True])
def test_points_are_off_with_their_probability(correlated):
    one = noise(robust=True, correlated=correlated)
    residual = np.where(np.arange(12) == 4, 4.0, 0.3) * one.stated
    rng, state, off = np.random.default_rng(3), one.start, np.zeros(12)
    for _ in range(3000):
        state = one.drawn(state, residual, np.zeros(12), rng)
        off += state.inflation > 1
    if not correlated:
        calm, wide = (np.hypot(factor * one.stated, 0.1) for factor in (1.0, WIDER))
        odds = RARE / (1 - RARE) * calm / wide * np.exp(0.5 * residual**2 * (calm**-2 - wide**-2))
        assert off / 3000 == pytest.approx(odds / (1 + odds), abs=0.03)
    assert off.argmax() == 4


@pytest.mark.campaign
def test_instruments_have_calibrations_of_their_own():
    """Two curves of one density, 20 % apart: the difference is known, and what they share is that of the prior."""
    size, width = 12, 0.1
    likelihood = noise(size, calibration=width)
    values = np.where(likelihood.curve == 0, 1.1, 0.9)
    likelihood = replace(likelihood, stated=np.full(size, 0.02), floors=np.zeros(size))
    made = Problem(
        Prior(np.array([0.8, 0.85, 0.9])), np.full(3, 0.1), values, likelihood, np.full((1, size, 3), 1 / 3),
        np.zeros((1, size)),
    )  # fmt: skip
    chain = Chain(made, np.ones(3), np.random.default_rng(1))
    warm([chain], 200)
    chain.forget()
    chain.run(6000)
    drawn = np.array([place.state.nuisances for place in chain.places])
    assert (drawn[:, 0] - drawn[:, 1]).mean() == pytest.approx(np.log(1.1 / 0.9), abs=0.006)
    assert (drawn[:, 0] - drawn[:, 1]).std() == pytest.approx(np.hypot(0.02 / 1.1, 0.02 / 0.9) / 6**0.5, rel=0.15)
    # the prior of the density tells next to nothing of their mean
    assert drawn.mean(axis=1).std() == pytest.approx(width / 2**0.5, rel=0.15)
    assert effective(drawn.mean(axis=1)[None]) > 60


def test_nuisances_are_columns_of_their_instruments():
    """A factor, one that runs with the decades from the middle, where it is 1, and what is added."""
    one = noise(6, calibration=0.1, drift=0.05, offset=2.0)
    names = [(name, number) for name in ("calibration", "drift", "offset") for number in (0, 1)]
    assert one.nuisances == names
    state = replace(one.start, nuisances=np.array([0.1, -0.2, 0.05, 0.0, 0.0, 3.0]))
    drift = np.array([-0.05, 0.0, 0.05])
    assert one.factor(state) == pytest.approx(np.exp(np.append(0.1 + drift, [-0.2] * 3)))
    assert one.added(state) == pytest.approx([0, 0, 0, 3, 3, 3])
    values = np.arange(1.0, 7.0)
    small = 1e-6 * np.arange(1.0, 7.0)
    changed = replace(one.start, nuisances=small * one.widths)
    change = one.factor(changed) * values + one.added(changed) - values
    assert one.linear(values) @ small == pytest.approx(change, rel=1e-4)
    assert noise(6).factor(noise(6).start) == pytest.approx(np.ones(6), abs=0)


@pytest.mark.long
def test_drift_and_offset_of_one_curve_are_those_of_the_prior(monkeypatch):
    """A density explains what rises with the logarithm of the hold time as well, and falls by drift are no error."""
    # of 100 effective samples the mean scatters by a quarter of what it may be off
    monkeypatch.setattr("chemage_inference.sampling.ENOUGH", 250)
    times = np.geomspace(1e-2, 1e4, 13)
    call = {"load": 50.0, "temperature": 300.0, "hold_times": times, "errors": np.full(13, 1.0)}
    level = ca.MeasuredCurve(values=100 - 4 * np.log10(times), **call)
    with pytest.raises(ca.InputError, match="values fall"):
        ca.infer(level, scene(), families=())
    rising = ca.MeasuredCurve(values=50 + 20 * np.log10(times), **call)
    for one, mean, width in ((rising, 0.0, 0.045), (level, -0.042, 0.0)):
        found = ca.infer(one, scene(), families=(), calibration={"drift": "5 %", "offset": "1 nN"}, samples=400)
        # without a drift below -4 % the curve would not rise
        assert found.error_terms["drift"].mean() == pytest.approx(mean, abs=0.02)
        assert found.error_terms["drift"].std() == pytest.approx(width, abs=0.01)
        assert found.error_terms["offset"].std() == pytest.approx(1.0, rel=0.15)
    with pytest.raises(ca.InputError, match="calibration = 'bias': is no calibration; choose of force, drift, offset"):
        ca.infer(rising, scene(), calibration={"bias": 1})
    with pytest.raises(ca.InputError, match=r"calibration\.offset = -1: must be at least 0 nN"):
        ca.infer(rising, scene(), calibration={"offset": -1})


def test_curves_of_two_instruments_are_told_apart(tmp_path):
    text = "t (s), ΔF (nN), err (nN), load (nN), T (K), lever\n"
    text += "".join(f"{t}, {t + 1}, 0.1, 50, 300, {lever}\n" for lever in ("a", "b") for t in (1, 10, 100))
    (tmp_path / "m.csv").write_text(text)
    found = ca.read_curves(tmp_path / "m.csv")
    assert [(one.name, one.instrument) for one in found] == [
        ("m, a, 50 nN, 300 K", "a"), ("m, b, 50 nN, 300 K", "b"),
    ]  # fmt: skip


@pytest.mark.long
def test_correlated_errors_are_no_parameters_of_the_density():
    """25 points whose errors are correlated over 5 e-folds of the time; the density alone takes 6 to 8 parameters."""
    data = curve(ca.barriers("gaussian", mean=0.95, std=0.1), noise=1e-9)
    near = np.exp(-np.abs(np.log(TIMES)[:, None] - np.log(TIMES)) / 5)
    noisy = data.values * (1 + 0.03 * np.linalg.cholesky(near) @ np.random.default_rng(3).standard_normal(25))
    data = data.model_copy(update={"values": noisy, "errors": 0.03 * data.values})
    found = ca.infer(data, scene(), families=(), samples=200, errors="correlated")
    assert 3 < found.effective_parameters < 10
    assert 10 < found.chi2 < 40


@pytest.mark.long
def test_bands_from_simulated_means_carry_the_correlation_of_hold_times():
    """Replicas whose bonds persist are wrong at all hold times alike, which no number of these makes up for."""
    made = scene()
    contact = ca.solve_contact(made.solver, ca.make_surface(made.surface), made.load)
    silica = made.chemistry.replace(forming=ca.barriers("gaussian", mean=0.9, std=0.1))
    call = {"engine": ca.engine("independent"), "temperature": 300.0, "replicas": 10, "seed": 5}
    (simulated,) = ca.read_curves(ca.age(contact, silica, hold_times=TIMES, **call))
    alone = simulated.model_copy(update={"correlation": None})
    one, other = (ca.infer(each, made, families=(), samples=100, seed=2) for each in (simulated, alone))
    middle = (TIMES > 0.1) & (TIMES < 1e3)
    spreads = [found.fitted[:, middle].mean(axis=1).std() for found in (one, other)]
    assert spreads[0] > 1.3 * spreads[1]
    assert spreads[0] == pytest.approx(simulated.errors[middle].mean(), rel=0.35)
    assert one.near is not None
    assert other.near is None
    assert 3 < one.effective_parameters < 10
    assert 0.3 < one.chi2 / (25 - one.effective_parameters) < 1.5


WRONG = {
    "errors": ({"errors": "large"}, "errors = 'large': is not known; choose of scaled, robust, correlated"),
    "calibration": ({"calibration": "200 %"}, "must be between 0 and 50 %"),
    "kind": ({"calibration": {"lever": 0.1}}, "is no calibration; choose of force, drift, offset, load"),
}


@pytest.mark.parametrize(("given", "message"), WRONG.values(), ids=WRONG)
def test_wrong_models_of_errors_are_refused(given, message):
    with pytest.raises(ca.InputError, match=message):
        ca.infer(curve(ca.barriers("gaussian", mean=0.95, std=0.1)), scene(), **given)


def off_by(data, factor=1.0, scale=1.0, outlier=None):
    """The same curve with a factor, errors that are understated by ``scale``, and one point off by 8 of them."""
    values = np.array(data.values) * factor
    if outlier is not None:
        values[outlier] += 8 * data.errors[outlier]
    return data.model_copy(update={"values": values, "errors": np.array(data.errors) / scale})


@pytest.mark.campaign
def test_understated_errors_and_a_point_that_is_off_are_found():
    data = curve(ca.barriers("gaussian", mean=0.95, std=0.1), times=np.logspace(-3, 5, 60))
    found = ca.infer(off_by(data, scale=2.5), scene(), families=(), samples=200)
    low, high = np.quantile(found.error_terms["scale 0"], [0.01, 0.99])
    assert low < 2.5 < high
    assert any("times the stated errors" in note for note in found.notes)
    assert found.errors[-1] == pytest.approx(found.stated_errors[-1] * np.median(found.error_terms["scale 0"]), rel=0.1)
    found = ca.infer(off_by(data, outlier=30), scene(), families=(), samples=200)
    assert len(found.suspects()) == 1
    assert found.off[30] > 0.9
    stated = ca.infer(data, scene(), families=(), samples=200, errors="as-stated")
    assert not stated.error_terms
    assert stated.errors[-1] == pytest.approx(data.errors[-1], rel=0.1)


def test_the_sites_of_an_unknown_load_are_known_as_well_as_said():
    """Between the loads of the grid, those of a parabola are off by one of the steps of the pixels, of the whole curve."""
    made, error = scene(), 0.05
    load, chemistry = made.load, made.chemistry
    about = {"temperature": 300.0, "hold_times": TIMES, "values": np.ones(25), "errors": np.ones(25)}
    curves = [ca.MeasuredCurve(load=over * load, **about) for over in (1, 3)]
    unknowns = unknowns_of([], chemistry, error)
    found = make_model(made, chemistry, unknowns, curves, 0).noise
    assert found.nuisances == [("sites", 0), ("sites", 1)]
    assert found.columns == pytest.approx(np.repeat(np.eye(2), 25, axis=0))
    surface, at = ca.make_surface(made.surface), np.random.default_rng(1).uniform(0, 8, 40)

    def sites(over):
        return [chemistry.sites_of(ca.solve_contact(made.solver, surface, one * load)).sites.size for one in over]

    for width, over in zip(found.widths, (1, 3), strict=True):
        axis = over * np.exp(error * 2.5 * np.linspace(-1, 1, 9))
        smooth = np.polynomial.Polynomial.fit(np.log(axis), np.log(sites(axis)), 2)
        between = np.exp(np.interp(at, np.arange(9), np.log(axis)))
        off = np.log(sites(between)) - smooth(np.log(between))
        assert 0.5 < off.std() / width < 2
    known = make_model(made, chemistry, unknowns_of([], chemistry), curves, 0).noise
    assert not known.nuisances


def test_errors_of_loads_are_named_by_them_and_every_contact_is_solved_once(monkeypatch):
    """More loads than instruments."""
    from chemage_inference import forward

    solved, made = [], scene()
    contact_of = forward.contact_of
    monkeypatch.setattr(forward, "contact_of", lambda *given: solved.append(1) or contact_of(*given))
    about = {"temperature": 300.0, "hold_times": TIMES, "values": np.ones(25), "errors": np.ones(25)}
    loads = {30.0: "a", 50.0: "b", 150.0: "b"}
    curves = [ca.MeasuredCurve(load=load, instrument=name, **about) for load, name in loads.items()]
    unknowns, errors = unknowns_of([], made.chemistry, 0.05), ErrorModel(calibration=0.1)
    model = make_model(made, made.chemistry, unknowns, curves, 0, None, errors)
    nuisances = np.zeros((4, len(model.noise.nuisances)))
    samples = SimpleNamespace(scales=np.ones((4, 3)), states=[], nuisances=nuisances)
    names = ["calibration of a", "calibration of b", *(f"sites under {load:g} nN" for load in loads)]
    assert list(error_terms(model, samples)) == names
    for point in range(unknowns.points):
        model.linear(np.ones(model.grid.count), point)
    assert len(solved) == len(loads) * unknowns.points


@pytest.mark.parametrize(
    ("unknown", "calibration"),
    [([], {"load": "5 %"}), (["activation_volume"], {"force": "10 %"})],
    ids=["load", "force"],
)
def test_families_are_compared_where_scalars_and_errors_of_instruments_are_unknown(unknown, calibration):
    """The errors are settled then, and the chains that leave hold times out have fewer scalars than those that guide."""
    data = curve(ca.barriers("gaussian", mean=0.9, std=0.05), times=TIMES[::2])
    call = {"families": ("gaussian",), "samples": 80, "unknown": unknown, "calibration": calibration}
    assert set(ca.infer(data, scene(), **call).scores) == {"density", "gaussian"}


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["force", "load"])
def test_a_shared_factor_widens_what_is_inferred(kind):
    data = curve(ca.barriers("gaussian", mean=0.9, std=0.05), times=TIMES)
    narrow = ca.infer(data, scene(), families=(), samples=200)
    wide = ca.infer(data, scene(), families=(), samples=200, calibration={kind: "10 %"})
    assert (wide.error_terms["calibration"] if kind == "force" else wide.scalars["load over stated"]).std() > 0.03
    last = [one.forecast(hold_times=[1e3], samples=200).samples.std() for one in (narrow, wide)]
    assert last[1] > 1.5 * last[0]
