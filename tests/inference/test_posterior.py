"""The steps of an inference: the forward model, sampling, and the shape of a density in words and figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_inference import made_forecast, made_inference
from scipy.special import ndtr
from seen import figures as inference_figures
from seen import result_of

import chemage as ca
from chemage_inference import display as words
from chemage_inference.energies import EnergyGrid, bonded_probability, energy_grid
from chemage_inference.forward import check_scene, largest_lowering, make_condition
from chemage_inference.kernels import (
    adapted,
    at_log_tail,
    choice_drawn,
    drawn,
    log_misfit,
    log_prior,
    log_tail,
    normal_equations,
    piece,
    scaled_erfc,
    solved,
)
from chemage_inference.noise import ErrorModel, fixed
from chemage_inference.problem import LEVEL, LOAD, Data, Hidden, Prior, Problem, Unknowns, redrawn_outside
from chemage_inference.result import InferenceResult
from chemage_inference.sampling import COMPLETE, Chain, convergence, sample
from chemage_inference.shape import between, peaks, shares

# -- the forward model: quadrature, real contacts, neighbours and their derivative ------------------------------------


TIMES = np.logspace(-3, 5, 9)


def scene(strength=0.0, **changes):
    data, _ = ca.plugin.scene_data("silica-tip")
    interaction = {"interaction.strength": strength} if strength else {"interaction": None}
    return ca.parse_scene(ca.plugin.override(data, {"observe": [], **interaction, **changes}))


def condition(made, times=TIMES):
    chemistry = check_scene(made)
    contact = ca.solve_contact(made.solver, ca.make_surface(made.surface), made.load)
    grid = energy_grid(chemistry, np.full(times.size, 300.0), times, largest_lowering(contact, chemistry))
    return make_condition(chemistry, contact, 300.0, times, grid), grid


def bump(energies, mean=0.95, std=0.1):
    return np.exp(-0.5 * ((energies - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))


def test_a_site_follows_the_closed_form_without_overflow():
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.4))
    found = bonded_probability(chemistry, 300.0, np.array([1e-10, 1.0, 1e12]), np.array([-5.0, 0.0, 0.8, 50.0]))
    rate = 1e13 * np.exp(-0.8 / (ca.plugin.units.KB * 300))
    assert found[1, 2] == pytest.approx(1 - np.exp(-rate), rel=1e-9)
    assert found[:, 0] == pytest.approx(found[:, 1])  # a barrier below zero is one of zero
    assert found[0, 1] == pytest.approx(1.0)
    assert np.isfinite(found).all()
    assert found[2, 3] == 0.0


def test_hat_functions_integrate_a_density_exactly():
    grid = EnergyGrid(0.5, 0.02, 41)
    assert grid.areas.sum() == pytest.approx(0.8)
    density = 1 + grid.nodes
    assert grid.areas @ density == pytest.approx(0.8 + (1.3**2 - 0.5**2) / 2)


def test_barriers_of_a_density_have_its_quantiles_and_the_rest_lies_beyond():
    grid = EnergyGrid(0.5, 0.02, 41)
    density = 0.6 * bump(grid.nodes, 0.9, 0.05)
    uniform = (np.arange(20000) + 0.5) / 20000
    found = grid.quantile(density, uniform, 9.0)
    assert np.mean(found == 9.0) == pytest.approx(0.4, abs=1e-3)
    inside = found[found < 9]
    assert inside.mean() == pytest.approx(0.9, abs=1e-3)
    assert inside.std() == pytest.approx(np.hypot(0.05, 0.02 / np.sqrt(6)), abs=1e-3)
    assert (np.diff(found) >= 0).all()


@pytest.mark.parametrize("breaking", [True, False])
def test_without_interaction_it_is_the_quadrature_of_another_method(breaking):
    """The ageing method `closure` is exact there, and shares no code with this."""
    made = scene(**({} if breaking else {"breaking": None}), forming={"kind": "gaussian", "mean": 0.95, "std": 0.1})
    model, grid = condition(made)
    value, matrix = model.linear(bump(grid.nodes))
    assert made.chemistry is not None
    ageing = ca.age(
        model.contact,
        made.chemistry,
        method=ca.ageing_method("closure"),
        engine=made.engine,
        hold_times=TIMES,
        temperature=300.0,
        replicas=1,
    )
    expected = ageing.friction_drop[0]
    # linear interpolation of a Gaussian between nodes 0.017 eV apart widens it by 0.4 %
    assert value == pytest.approx(expected, rel=0.03, abs=2e-3 * expected[-1])
    assert matrix @ bump(grid.nodes) == pytest.approx(value)


def test_the_rim_the_pressure_and_hydroxylation_enter():
    full, grid = condition(scene())
    half, _ = condition(scene(**{"chemistry.hydroxylation": 0.5}))
    none, other = condition(scene(**{"chemistry.activation_volume": 0.0}))
    density = bump(grid.nodes)
    assert half.linear(density)[0] == pytest.approx(0.5 * full.linear(density)[0])
    # pressure lowers the barriers, so that more sites are bonded at early times
    assert full.linear(density)[0][3] > 1.3 * none.linear(bump(other.nodes))[0][3]


@pytest.mark.parametrize("strength", [0.1, 0.5])
@pytest.mark.long
def test_the_derivative_contains_the_part_of_the_neighbours(strength):
    model, grid = condition(scene(strength))
    density, change = 0.9 * bump(grid.nodes), bump(grid.nodes, 0.85, 0.06) - bump(grid.nodes, 1.0, 0.05)
    _, matrix = model.linear(density)
    step = 1e-3
    above, below = (model.linear(density + sign * step * change)[0] for sign in (1, -1))
    found, expected = matrix @ change, (above - below) / (2 * step)
    assert found == pytest.approx(expected, abs=0.02 * np.abs(expected).max())
    # without that part it would be wrong
    alone = model.without_neighbours @ change
    assert np.abs(alone - expected).max() > 0.2 * np.abs(expected).max()


@pytest.mark.parametrize(("strength", "error"), [(0.1, 0.05), (0.5, 0.15)])
@pytest.mark.long
def test_the_mean_field_is_near_the_kinetics_of_the_sites_and_corrected_to_them(strength, error):
    made = scene(strength, forming={"kind": "gaussian", "mean": 0.95, "std": 0.1})
    model, grid = condition(made)
    density = bump(grid.nodes)
    alone = model.linear(density)[0]
    model.calibrate(density, made, 5)
    corrected = model.linear(density)[0]
    assert made.chemistry is not None
    ageing = ca.age(
        model.contact, made.chemistry, engine=made.engine, hold_times=TIMES, temperature=300.0, replicas=400, seed=11
    )
    value, noise = ageing.mean_friction_drop, ageing.friction_drop_stderr
    late = TIMES >= 0.1
    assert alone[late] == pytest.approx(value[late], rel=error)
    off = np.abs(corrected - value)[late]
    assert (off <= 4 * noise[late] + 0.012 * value[late] + 2e-3 * value.max()).all()


def test_what_cannot_be_inverted_is_refused_before_anything_is_computed():
    data, _ = ca.plugin.scene_data("silica-tip")
    removed = dict.fromkeys(("forming", "breaking", "interaction", "chemistry", "engine", "hold", "fit", "observe"))
    bare = ca.parse_scene(ca.plugin.override(data, removed))
    with pytest.raises(ca.InputError, match=r"ends at the contact; add \[forming\]"):
        check_scene(bare)
    with pytest.raises(ca.InputError, match=r"\[rupture\] makes the friction depend on which sites are bonded"):
        check_scene(scene(rupture={"kind": "mean-force"}))


# -- sampling: exact along lines, the same with the same seed, honest of its own convergence; and barriers outside of -


NODES = 0.7 + 0.02 * np.arange(12)
GRID, FIRST = EnergyGrid(0.6, 0.02, 50), 15


def problem(values=(2.0, 1.0), errors=(0.2, 0.1), nodes=NODES):
    matrix = np.random.default_rng(3).uniform(0.2, 1.0, (1, len(values), nodes.size)) / nodes.size
    areas = np.full(nodes.size, 0.02)
    return Problem(Prior(nodes), areas, np.array(values), fixed(np.array(errors)), matrix, np.zeros((1, len(values))))


@pytest.mark.parametrize(
    ("a", "b", "low", "high"), [(2.0, 1.0, -1.0, 3.0), (2.0, 5.0, 1.0, 4.0), (0.5, -9.0, -2.0, 1.0)]
)
def test_the_integral_of_a_piece_is_that_of_a_quadrature(a, b, low, high):
    from scipy.integrate import quad

    expected = quad(lambda x: np.exp(-0.5 * (a * x * x + 2 * b * x + 3.0)), low, high)[0]
    assert piece(a, b, 3.0, low, high) == pytest.approx(np.log(expected), abs=1e-7)


def test_pieces_far_in_the_tail_and_without_an_end_stay_numbers():
    assert np.isfinite(piece(1.0, 1e4, 0.0, 0.0, np.inf))
    assert np.isfinite(piece(1.0, -1e4, 0.0, -np.inf, 0.0))
    assert scaled_erfc(30.0) == pytest.approx(1 / (30 * np.sqrt(np.pi)), rel=1e-3)
    assert scaled_erfc(5.999999) == pytest.approx(scaled_erfc(6.000001), rel=1e-5)


def test_numbers_drawn_from_a_piece_have_its_quantiles():
    from scipy.stats import truncnorm

    uniform = np.linspace(0.01, 0.99, 25)
    for low, high, mean in ((-1.0, 2.0, 0.5), (1.0, 3.0, 0.0), (-3.0, -1.0, 0.0)):
        found = [drawn(1.0, -mean, low, high, one) for one in uniform]
        expected = truncnorm.ppf(uniform, low - mean, high - mean) + mean
        if mean >= high:  # drawn from the edge where the density is highest
            expected = expected[::-1]
        assert np.sort(found) == pytest.approx(np.sort(expected), abs=1e-6)


def test_the_kernels_of_the_choice_agree_with_numpy():
    prior = Prior(NODES)
    rng = np.random.default_rng(2)
    x = LEVEL + rng.standard_normal(12)
    away, covariances = x - LEVEL, [prior.covariance(choice) for choice in range(len(prior.combinations))]
    logs = [-0.5 * np.linalg.slogdet(c)[1] - 0.5 * away @ np.linalg.solve(c, away) for c in covariances]
    found = [log_prior(x, LEVEL, *one) for one in zip(*prior.precisions, strict=True)]
    assert found == pytest.approx(logs, rel=1e-6)
    factor = np.linalg.cholesky(np.cov(rng.standard_normal((12, 40))))
    goals = rng.standard_normal((3, 12))
    assert solved(factor, goals) == pytest.approx(np.linalg.solve(factor.T, goals.T).T)
    made = problem()
    matrix, target = made.matrices[0].T / made.errors, made.values / made.errors
    expected = -0.5 * np.sum((np.maximum(x, 0) @ matrix - target) ** 2)
    assert log_misfit(x, np.ascontiguousarray(matrix), target, made.areas, 100.0) == pytest.approx(expected)
    assert log_misfit(x, np.ascontiguousarray(matrix), target, made.areas, 0.001) == -np.inf


def test_tails_are_those_of_the_normal_distribution_and_are_inverted():
    from scipy.special import log_ndtr

    for z in (-30.0, -7.0, -0.5, 0.0, 0.3, 2.0, 8.0, 40.0, 300.0):
        assert log_tail(z) == pytest.approx(log_ndtr(-z), rel=1e-10, abs=1e-300)
    for z in (-7.0, -0.5, 0.0, 0.3, 2.0, 8.0, 40.0, 300.0):
        assert at_log_tail(log_tail(z)) == pytest.approx(z, abs=1e-5 if z < -6 else 1e-9)
    assert at_log_tail(0.0) == -38.0


def choices_drawn(made, draws=6000):
    """Choices that four chains draw again and again, with a density that is drawn by lines between."""
    found, signs = [], []
    for seed in range(4):
        chain = Chain(made, np.ones(made.areas.size), np.random.default_rng(seed))
        for _ in range(draws):
            chain.step()
            found.append(chain.choice)
            signs.append(chain.x > 0)
    return np.array(found), np.array(signs)


@pytest.mark.long
def test_a_choice_that_is_the_only_candidate_changes_nothing():
    prior, made = Prior(NODES), problem()
    chain = Chain(made, np.ones(12), np.random.default_rng(2))
    for _ in range(50):
        chain.step()
    x, before = chain.x.copy(), chain.x.copy()
    matrix, target = np.ascontiguousarray(made.matrices[0].T / made.errors), made.values / made.errors
    rest = (LEVEL, *prior.precisions, (matrix, target, made.areas), 100.0)
    assert choice_drawn(x, np.array([7]), *rest, np.zeros(1)) == 0
    assert np.array_equal(x, before)
    # there and back again is where it was, and no sign has changed
    assert choice_drawn(x, np.array([7, 90]), *rest, np.array([0, 1e6])) == 1
    assert np.array_equal(x > 0, before > 0)
    assert not np.allclose(x, before, rtol=1e-3)
    assert choice_drawn(x, np.array([90, 7]), *rest, np.array([0, 1e6])) == 1
    assert x == pytest.approx(before, rel=1e-6)


@pytest.mark.long
def test_choices_that_are_drawn_without_data_are_those_of_the_prior():
    """All are equally probable then; and so are the signs, of a process whose mean is above zero."""
    made = problem(values=(1.0, 1.0, 1.0), errors=(1e9, 1e9, 1e9))
    made = replace(made, areas=1e-9 * made.areas)
    found, signs = choices_drawn(made)
    counts = np.bincount(found, minlength=120)
    for axis in range(3):  # smoothness, length, strength
        shares = counts.reshape(3, 4, 10).sum(axis=tuple({0, 1, 2} - {axis})) / counts.sum()
        assert shares == pytest.approx(np.full(shares.size, 1 / shares.size), rel=0.25)
    spread = [np.sqrt(np.diag(made.prior.covariance(choice))) for choice in range(120)]
    assert signs.mean() == pytest.approx(ndtr(LEVEL / np.array(spread)).mean(), abs=0.03)


def test_combinations_that_tell_nothing_are_left_out_of_the_lines_only():
    """A measurement that repeats another adds no combination of the density."""
    made = problem(values=(2.0, 2.0, 1.0), errors=(0.2, 0.2, 0.1))
    made.matrices[0, 1] = made.matrices[0, 0]
    chain = Chain(made, np.ones(12), np.random.default_rng(0))
    matrix, target, _ = chain._model(False)
    assert np.flatnonzero(matrix.any(axis=0)).tolist() == [0, 1]
    x, other = np.linspace(0.1, 2.0, 12), np.linspace(2.0, 0.5, 12)

    def full(x):
        return np.sum(((made.matrices[0] @ x - made.values) / made.errors) ** 2)

    # the two values that contradict each other add a constant
    part = [np.sum((x @ matrix - target) ** 2) for x in (x, other)]
    assert part[1] - part[0] == pytest.approx(full(other) - full(x), rel=1e-6)


@pytest.mark.long
def test_samples_have_the_means_of_the_posterior():
    """Against importance sampling of the prior, of which some hundred thousand samples are enough for few values."""
    made = problem(nodes=NODES[:4], values=(1.1,), errors=(0.3,))
    found = sample(made, np.ones(4), samples=3000, seed=1)
    rng = np.random.default_rng(5)
    draws, weights = [], []
    for choice in range(len(made.prior.combinations)):
        factor = np.linalg.cholesky(made.prior.covariance(choice))
        density = np.maximum(LEVEL + rng.standard_normal((4000, 4)) @ factor.T, 0.0)
        misfit = (made.values - density @ made.matrices[0].T) / made.errors
        mass = density @ made.areas
        draws.append(density)
        weights.append(np.exp(-0.5 * (misfit**2).sum(axis=1)) * (mass <= 1))
    weight, density = np.concatenate(weights), np.concatenate(draws)
    expected = weight @ density / weight.sum()
    assert found.densities.mean(axis=0) == pytest.approx(expected, rel=0.08)
    zero = weight @ (density == 0) / weight.sum()
    assert np.mean(found.densities == 0, axis=0) == pytest.approx(zero, abs=0.04)


@pytest.mark.campaign
def test_the_same_seed_gives_the_same_samples_and_none_has_an_integral_above_one():
    made = problem(values=(30.0, 30.0))
    first, again = (sample(made, np.ones(12), samples=60, seed=4).densities for _ in range(2))
    assert np.array_equal(first, again)
    assert (first @ made.areas < 1.02).all()
    assert (first >= 0).all()


def test_a_model_that_is_the_only_other_one_is_left_again():
    """Another matrix: there and back again is where it was, with the same signs."""
    prior, made = Prior(NODES), problem()
    matrix, target = made.matrices[0].T / made.errors, made.values / made.errors
    x = np.linspace(-1.0, 2.0, 12)
    x[3] = 0.7
    before, shares = x.copy(), np.empty(12)

    def log(factor, known):
        model = np.ascontiguousarray(factor * matrix), target, made.areas
        equations = normal_equations(x, LEVEL, *model[:2])
        inverse, log = (each[7] for each in prior.precisions)
        return adapted(x, shares, known, LEVEL, inverse, log, equations, model, 100.0)

    first, there = log(1.0, False), log(1.2, True)
    assert not np.allclose(x, before, rtol=1e-3)
    assert np.array_equal(x > 0, before > 0)
    assert log(1.2, False) == pytest.approx(there, rel=1e-6)
    assert log(1.0, True) == pytest.approx(first, rel=1e-6)
    assert x == pytest.approx(before, rel=1e-4)


def test_functions_of_two_scalars_are_interpolated_by_splines():
    unknowns = Unknowns({"activation_volume": np.linspace(0, 1, 9), "attempt_frequency": np.geomspace(1, 100, 13)})
    function = lambda at: np.sin(at[:, 0] / 2) * np.exp(-at[:, 1] / 5)  # noqa: E731
    coefficients = unknowns.coefficients(function(unknowns.nodes)[:, None])
    at = np.random.default_rng(0).uniform([0, 0], [8, 12], (500, 2))
    assert unknowns.weights(at) @ coefficients[:, 0] == pytest.approx(function(at), abs=1e-3)
    assert unknowns.weights(unknowns.nodes) @ coefficients[:, 0] == pytest.approx(function(unknowns.nodes), abs=1e-12)
    assert (unknowns.weights(at) != 0).sum(axis=1).max() == 16
    values = unknowns.values(np.array([[4.0, 6.0]]))
    assert [float(value[0]) for value in values.values()] == pytest.approx([0.5, 10.0])


def test_values_do_not_follow_the_steps_in_which_sites_come_into_contact():
    """156 sites of a tip become 164 at once: interpolated, that made two maxima of the posterior of the load."""
    loads = np.exp(0.05 * np.linspace(-2.5, 2.5, 9))
    unknowns = Unknowns({LOAD: loads})
    sites = np.array([148, 148, 148, 148, 156, 156, 164, 164, 164.0])
    at = np.linspace(0, 8, 81)[:, None]
    found = unknowns.weights(at) @ unknowns.coefficients(sites[:, None])[:, 0]
    assert (np.diff(found) > 0).all()
    assert np.ptp(np.diff(found, 2)) < 1e-9, "a parabola"
    assert found[::10] == pytest.approx(sites, abs=8), "within one of the steps"
    smooth = 156 * loads ** (2 / 3)
    found = unknowns.weights(at) @ unknowns.coefficients(smooth[:, None])[:, 0]
    assert found[::10] == pytest.approx(smooth, rel=2e-4)


RATIO = np.linspace(0.5, 1.5, 5)
UNKNOWN = {
    "factor": Unknowns(factor=(-1.0, 1.0)),
    "ratio": Unknowns({"ratio": RATIO}),
    "both": Unknowns({"ratio": RATIO}, (-1.0, 1.0)),
    "shift": Unknowns({"shift": np.arange(5.0)}),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "calibration", "seeds"),
    [
        pytest.param("both", 0.2, [1], marks=pytest.mark.campaign),
        ("shift", 0.0, [1, 2, 3]),
        *(
            pytest.param(name, calibration, [1, 2, 3, 4, 5, 6], marks=pytest.mark.campaign)
            for name in ("factor", "ratio", "both")
            for calibration in (0.0, 0.2)
        ),
    ],
)
def test_scalars_have_the_posterior_of_importance_sampling(name, calibration, seeds):
    """Of three nodes, whose integral is often about 1: there the density may be complete."""
    unknowns, nodes, areas = UNKNOWN[name], NODES[:3], np.full(3, 0.3)
    ratio = RATIO if unknowns.axes else np.ones(1)
    rows = np.random.default_rng(3).uniform(0.5, 1.0, (2, 3)) / 3
    models = np.stack([rows * [[1.0], [r]] for r in ratio])
    if name == "shift":  # by a node with each step: what reacts lies lower or higher
        models = 0.3 * ndtr(np.array([[0.5], [1.5]]) - np.arange(3) + np.arange(-2, 3)[:, None, None])
    matrices = unknowns.coefficients(models)
    values, errors = np.array([0.8, 0.9]), np.array([0.2, 0.2])
    noise = replace(fixed(errors), model=ErrorModel(calibration=calibration))
    made = Problem(Prior(nodes), areas, values, noise, matrices, np.zeros((ratio.size, 2)), unknowns)
    # the standard deviation of the integral scatters by 5 to 7 % between seeds
    every = [sample(made, np.ones(3), samples=3000, seed=seed, sweeps=2500) for seed in seeds]
    rng, draws, weights = np.random.default_rng(5), [], []
    for choice in range(len(made.prior.combinations)):
        factor = np.linalg.cholesky(made.prior.covariance(choice))
        density = np.maximum(LEVEL + rng.standard_normal((20_000, 3)) @ factor.T, 0.0)
        # position on the grid, common factor, calibration
        at = rng.uniform(0, 4, 20_000) if unknowns.axes else np.zeros(20_000)
        log = rng.uniform(-1, 1, 20_000) if unknowns.factor else np.zeros(20_000)
        shared = calibration * rng.standard_normal(20_000)
        weighted = np.einsum("sg,gmn->smn", unknowns.weights(at[:, None][:, : len(unknowns.axes)]), matrices)
        fitted = np.einsum("smn,sn->sm", weighted, density) * np.exp(log + shared)[:, None]
        mass = density @ areas
        complete = 2 * np.exp(-0.5 * ((mass - 1) / COMPLETE) ** 2) / (COMPLETE * np.sqrt(2 * np.pi))
        weights.append(np.exp(-0.5 * (((fitted - values) / errors) ** 2).sum(axis=1)) * ((mass <= 1) + complete))
        draws.append(np.stack([at, log, shared, mass], axis=1))
    weight, drawn_ = np.concatenate(weights), np.concatenate(draws)
    mean = weight @ drawn_ / weight.sum()
    spread = np.sqrt(weight @ (drawn_ - mean) ** 2 / weight.sum())
    parts = []
    for found in every:
        at = found.positions[:, 0] if unknowns.axes else np.zeros(len(found.factors))
        shared_drawn = found.nuisances[:, 0] if calibration else np.zeros(at.size)
        parts.append(np.stack([at, np.log(found.factors), shared_drawn, found.densities @ areas], axis=1))
    sampled = np.concatenate(parts)
    assert sampled.mean(axis=0) == pytest.approx(mean, abs=0.1 * spread.max() + 1e-9)
    for mine, middle, theirs in zip(sampled.T, mean, spread, strict=True):
        assert mine.mean() == pytest.approx(middle, abs=0.12 * theirs + 1e-9)
        assert mine.std() == pytest.approx(theirs, rel=0.1, abs=1e-9)


def test_chains_follow_the_ridge_along_which_energies_shift():
    """Two narrow peaks at one temperature: a larger ν₀ is nothing but higher barriers."""
    nodes, ends = np.linspace(0.5, 1.3, 41), np.linspace(0.75, 1.05, 12)[:, None]
    reacts = -np.expm1(-np.exp(np.minimum(ends + 0.02 * np.arange(-4, 5)[:, None, None] - nodes, 0.1) / 0.02))
    truth = 7.0 * np.exp(-0.5 * ((nodes - 0.80) / 0.02) ** 2) + 4.0 * np.exp(-0.5 * ((nodes - 0.98) / 0.02) ** 2)
    unknowns, values = Unknowns({"attempt_frequency": np.geomspace(1e12, 1e14, 9)}), 0.02 * reacts[4] @ truth
    known = fixed(0.005 + 0.01 * values), unknowns.coefficients(0.02 * reacts), np.zeros((9, 12)), unknowns
    made = Problem(Prior(nodes), np.full(41, 0.02), values, *known, start=4)
    drawn = sample(made, np.where(truth < 0.01, -1.0, truth), samples=800, seed=0, sweeps=200, threads=1)
    ess, ratio = convergence(drawn.positions.reshape(4, -1, 1))
    assert ess > 60, "6 without shifts"
    assert ratio < 1.1, "1.6 without shifts"
    assert drawn.positions.std() > 1.8, "uniform: 2.3"


def test_chains_that_differ_are_seen():
    rng = np.random.default_rng(0)
    same = rng.standard_normal((2, 500, 3))
    assert convergence(same)[1] < 1.02
    assert convergence(same)[0] > 600
    assert convergence(same + np.array([0.0, 2.0])[:, None, None])[1] > 1.3
    assert convergence(np.zeros((2, 100, 3))) == (200.0, 1.0)


def test_any_share_of_the_sites_may_lie_below_an_energy_and_none_is_lost():
    hidden = Hidden(GRID, FIRST, GRID.count)
    shares = np.full(2000, 0.7)
    densities = hidden.redrawn(np.ones((2000, GRID.count)), shares, np.random.default_rng(1))
    assert np.array_equal(densities[:, :FIRST], np.ones((2000, FIRST)))
    assert hidden.integral(densities) == pytest.approx(shares, rel=1e-9)
    middle = (FIRST + GRID.count) // 2
    below = densities[:, FIRST:middle] @ GRID.areas[FIRST:middle] / 0.7
    assert below.mean() == pytest.approx(0.5, abs=0.03)
    assert np.quantile(below, [0.1, 0.9]) == pytest.approx([0, 1], abs=0.01)


def test_all_sites_are_somewhere_and_those_seen_stay():
    rng = np.random.default_rng(2)
    smooth = rng.uniform(0, 1, (300, GRID.count))
    seen = (np.arange(GRID.count) > 10) & (np.arange(GRID.count) < 20)
    densities = redrawn_outside(GRID, seen, smooth, rng)
    assert np.array_equal(densities[:, seen], smooth[:, seen])
    redrawn = (densities != smooth).any(axis=1)
    assert 0.67 < redrawn.mean() < 0.83
    assert densities[redrawn] @ GRID.areas == pytest.approx(1.0)
    assert densities[:, :11] @ GRID.areas[:11] == pytest.approx(smooth[:, :11] @ GRID.areas[:11])


@pytest.mark.long
def test_an_upper_end_of_90_percent_is_held_by_all_sites_in_one_narrow_peak(monkeypatch):
    """No density that ages linearly first gives more later: 5 % of the samples must be such peaks, 10 % to be sure."""
    monkeypatch.setattr("chemage_inference.problem.MOVES", 300)
    kt, count = 0.04, 1000
    rates = np.exp(-(GRID.nodes - 0.9) / kt) * GRID.areas
    data = Data(
        rates[None, None] / 0.003,
        np.ones((count, 1)),
        np.ones(count),
        np.array([33.3]),
        np.zeros((1, 1)),
        kt,
    )
    seen = np.arange(GRID.count) < FIRST
    found = redrawn_outside(GRID, seen, np.zeros((count, GRID.count)), np.random.default_rng(6), data)
    # a peak with exp(−(E − 0.9 eV)/k_BT) = 0.1 lies at 0.99 eV; up to 0.02 eV wide, it ends at 1.05 eV
    below = found @ (GRID.areas * (GRID.nodes < 1.05))
    assert (below > 0.99).mean() > 0.1


@pytest.mark.long
def test_peaks_have_the_posterior_of_importance_sampling(monkeypatch):
    """One measurement of the sum of share × exp(−E/k_BT), as linear ageing gives it; 100,000 draws of the prior."""
    monkeypatch.setattr("chemage_inference.problem.MOVES", 400)
    kt = 0.04
    rates = np.exp(-(GRID.nodes - 0.9) / kt) * GRID.areas
    hidden, count = Hidden(GRID, FIRST, GRID.count), 1500
    data = Data(rates[None, None] / 0.02, np.ones((count, 1)), np.ones(count), np.array([5.0]), np.zeros((1, 1)), kt)
    empty = np.zeros((count, GRID.count))
    found = hidden.redrawn(empty, np.ones(count), np.random.default_rng(3), data)
    prior = hidden.redrawn(np.zeros((100_000, GRID.count)), np.ones(100_000), np.random.default_rng(4))
    weight = np.exp(-0.5 * ((prior @ rates - 0.1) / 0.02) ** 2)
    weight /= weight.sum()
    assert 1 / (weight**2).sum() > 1000
    for end in (22, 26, 30, 40):
        below, expected = (one[:, :end] @ GRID.areas[:end] for one in (found, prior))
        assert below.mean() == pytest.approx(weight @ expected, abs=0.03)
        assert (below > 0.9).mean() == pytest.approx(weight @ (expected > 0.9), abs=0.04)


# -- the shape of a density in words: peaks, shares, verdicts; and the figures of an inference ------------------------


def test_one_two_and_no_peak_are_told_apart():
    (peak,) = peaks(made_inference((1.0,)))
    assert peak.energy == pytest.approx(1.0, abs=0.02)
    assert peak.band[0] <= peak.energy <= peak.band[1]
    assert [round(one.energy, 1) for one in peaks(made_inference((0.85, 1.1)))] == [0.8, 1.1]
    assert peaks(made_inference(())) == []
    assert "flat" in words.density_text(made_inference(()))
    assert words.density_text(made_inference((1.3,))).startswith("no peak inside; rises")


def test_no_barriers_inside_are_neither_flat_nor_falling():
    """Linear ageing: all samples are zero at all visible energies, and the barriers lie above."""
    empty = made_inference((1.4,))
    text = "hardly any inside (at most 0.1 % of the sites); barriers lie above"
    zero = np.where(empty.visible, 0.0, empty.samples)
    for one in (empty, empty.model_copy(update={"samples": zero})):
        assert words.density_text(one) == text
        assert ("sites below 0.760 eV", "less than 0.1 %") in [share.row() for share in shares(one)]
        assert text in inference_figures(InferenceResult(one))["density"].axes[0].get_title().replace("\n", " ")


def test_a_maximum_of_the_curve_that_is_no_peak_is_named_and_marked():
    """The curve of the figure is highest at 0.85 eV, inside the visible energies, in half of the samples."""
    one = made_inference(())
    bump = 2 * np.exp(-0.5 * ((one.energies - 0.85) / 0.03) ** 2)
    samples = 0.6 * one.samples
    samples[::2] += 0.6 * bump
    one = one.model_copy(update={"samples": samples})
    high = one.energies[np.argmax(one.density)]
    assert peaks(one) == []
    assert f"the maximum at {high:.3f} eV is not resolved" in words.density_text(one)
    assert "no peak inside" not in words.density_text(one)
    axes = inference_figures(InferenceResult(one))["density"].axes[0]
    (marks,) = [line for line in axes.get_lines() if line.get_label() == "maximum, not resolved"]
    assert high in marks.get_xdata()


def skew_forecast(**more):
    """Most samples between 1157 and 1177 nN, one in six far below, as a forecast of the documentation."""
    samples = np.linspace(1157, 1177, 300)[:, None]
    samples[:45] = np.linspace(700, 1100, 45)[:, None]
    return made_forecast().model_copy(update={"hold_times": np.array([1e6]), "samples": samples, **more})


def test_a_forecast_is_shown_by_its_median_which_lies_in_its_bands():
    one = skew_forecast()
    low, high = one.band(0.68)
    assert one.friction_drop[0] < low[0] < one.median[0] < high[0]
    median = f"{one.median[0]:.4g} nN"
    assert words.forecast_row("a", one)[1] == median
    assert median in repr(one)
    made = InferenceResult(made_inference(), {"a": one})
    (summary,) = made.summary()["forecasts"]
    assert summary["median"] == one.median.tolist()
    assert summary["friction_drop"] == one.friction_drop.tolist()
    lines = inference_figures(made)["forecasts"].axes[0].get_lines()
    (line,) = [line for line in lines if line.get_label() == f"a ({one.load:g} nN, {one.temperature:g} K)"]
    assert line.get_ydata() == pytest.approx(one.median)


def test_where_nearly_all_is_unseen_only_bounds_are_shown():
    one = skew_forecast(unseen=0.97)
    name, value, inner, outer = words.forecast_row("a", one)
    assert "97 % unseen: bounds only" in name
    assert (value, inner) == ("-", "-")
    assert f"{one.median[0]:.4g}" not in outer + repr(one)
    axes = inference_figures(InferenceResult(made_inference(), {"a": one}))["forecasts"].axes[0]
    drawn = np.concatenate([line.get_ydata() for line in axes.get_lines()])
    assert one.median[0] not in drawn
    assert {float(end[0]) for end in one.band(0.9)} <= {*drawn.tolist()}


def test_a_rise_towards_an_end_is_named():
    assert words.density_text(made_inference((0.9, 1.25))).endswith("; rises again towards the upper end")


def test_a_peak_that_only_some_samples_have_is_none():
    one = made_inference(())
    bump = np.exp(-0.5 * ((one.energies - 1.0) / 0.05) ** 2)
    samples = one.samples.copy()
    samples[::2] += bump
    samples *= 0.5
    assert peaks(one.model_copy(update={"samples": samples})) == []


def test_shares_are_integrals_of_the_density():
    one = made_inference()
    below, *inner, above = shares(one)
    low, high = one.visible_range
    assert (below.label, above.label) == (f"sites below {low:.3f} eV", f"sites above {high:.3f} eV")
    inside = (one.energies >= low) & (one.energies <= high)
    whole = 100 * np.trapezoid(one.density[inside], one.energies[inside])
    assert sum(part.value for part in inner) == pytest.approx(whole, rel=1e-2)
    upto = one.energies <= high
    assert above.value == pytest.approx(100 - 100 * np.trapezoid(one.density[upto], one.energies[upto]), abs=1)
    assert between(one, one.visible_range).sum(axis=0) == pytest.approx(1)


def test_sites_below_the_visible_energies_have_a_row():
    """Of an offset that was left in the values, sites seem bonded from the first hold time on."""
    below, *_, above = shares(made_inference((0.65, 1.0)))
    assert 20 < below.value < 60
    assert below.low < below.value < below.high
    assert below.row()[0] == "sites below 0.760 eV"
    assert below.row()[1].endswith("% bonded before the first hold time")
    assert above.row()[1].endswith("% seen as not reacted")


def test_data_that_tell_nothing_are_shown_as_such():
    one = made_inference(visible=np.zeros(61, dtype=bool))
    made = InferenceResult(one)
    assert peaks(one) == []
    assert shares(one) == []
    rows = dict(words.facts(made.inference))
    assert rows["visible energies"].startswith("none")
    assert "density" in inference_figures(made)


def test_scores_name_the_best_and_those_as_good():
    one = made_inference()
    assert words.family_rows(one)[0][:2] == ("gaussian", "best")
    assert words.family_verdict(one) == ["The data do not tell apart the smooth density and gaussian: scores within 2."]
    alone = made_inference(scores={"density": 10.0, "uniform": 1.0})
    assert words.family_verdict(alone)[0].endswith("best by the smooth density.")
    assert words.family_rows(made_inference(scores={})) == []


def test_the_band_of_a_peak_is_at_least_a_step_of_the_energies_wide():
    one = made_inference()
    assert words.density_text(one) == "one peak at 1.000 ± 0.008 eV"


def test_every_figure_has_a_caption_and_what_it_should_show():
    scalars = {"bond_force": np.random.default_rng(0).uniform(2, 4, 60)}
    one = made_inference(scalars=scalars, scalar_bounds={"bond_force": (1.0, 9.0)})
    made = InferenceResult(one, {"load=50 nN": made_forecast(), "at 1 s": made_forecast(80.0, unseen=0.4)})
    figures = inference_figures(made)
    assert figures.keys() == {"density", "data", "predictive", "forecasts", "unknowns"}
    assert all(panel.caption for picture in result_of(made).pictures().values() for panel in picture.panels)
    (density,) = figures["density"].axes
    labels = density.get_legend_handles_labels()[1]
    assert {"visible energies", "90 % band", "68 % band", "mean", "gaussian"} <= {*labels}
    assert "uniform" not in labels, "46 below the best: excluded"
    captions = [
        result_of(each).pictures()["density"].panels[0].caption
        for each in (one, made_inference(scores={}, families={}))
    ]
    assert ["Orange: families" in caption for caption in captions] == [True, False]
    data, residuals = figures["data"].axes
    assert data.get_legend().get_title().get_text() == "points: measured, bars 95 %; bands: 68 and 90 %"
    bars = np.array(data.containers[0].lines[2][0].get_segments())
    assert 0.5 * np.ptp(bars[:, :, 1], axis=1) == pytest.approx(1.959964 * one.errors[one.curve == 0])
    assert residuals.get_lines()[-1].get_ydata() == pytest.approx(one.residuals)
    assert data.get_xscale() == "log"
    assert "40 % unseen" in " ".join(figures["forecasts"].axes[0].get_legend_handles_labels()[1])
