"""The forward model: quadrature, real contacts, neighbours and their derivative."""

from __future__ import annotations

import numpy as np
import pytest

import chemage as ca
from chemage.inference.energies import EnergyGrid, bonded_probability, energy_grid
from chemage.inference.forward import check_scene, largest_lowering, make_condition

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
    aging = ca.age(
        model.contact,
        made.chemistry,
        method=ca.ageing_method("closure"),
        engine=made.engine,
        hold_times=TIMES,
        temperature=300.0,
        replicas=1,
    )
    expected = aging.friction_drop[0]
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
    alone = model.without_neighbours() @ change
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
    aging = ca.age(
        model.contact, made.chemistry, engine=made.engine, hold_times=TIMES, temperature=300.0, replicas=400, seed=11
    )
    value, noise = aging.mean_friction_drop, aging.friction_drop_stderr
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
