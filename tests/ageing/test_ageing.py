"""The result of ageing: friction from bonds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from seen import result_of

from chemage import InputError, fit_ageing


@pytest.fixture
def ageing(examples):
    return examples.ageing


def test_friction_drop_is_bonds_times_force(ageing):
    made = ageing(bond_force=3.0, front_factor=0.5)
    assert made.replicas == 2
    assert made.friction_drop.tolist() == [[15, 30, 45], [18, 36, 45]]
    assert made.friction_coefficient_drop.tolist() == [[0.25, 0.5, 0.75], [0.3, 0.6, 0.75]]
    assert made.mean_friction_drop.tolist() == [16.5, 33, 45]
    assert made.mean_friction_coefficient_drop.tolist() == pytest.approx([0.275, 0.55, 0.75])
    # standard error of two values is half their difference
    assert made.friction_drop_stderr.tolist() == pytest.approx([1.5, 3, 0])
    assert made.friction_coefficient_drop_stderr.tolist() == pytest.approx([0.025, 0.05, 0])


def test_no_load_has_a_drop_of_the_friction_force_but_no_coefficient(ageing):
    made = ageing(load=0.0)
    assert np.isfinite(made.friction_drop).all()
    assert np.isnan(made.friction_coefficient_drop).all()
    with pytest.raises(InputError, match="load = 0: the friction coefficient is undefined"):
        made.fit(1, 100)
    force = fit_ageing(made, window=(1, 100), quantity="friction_drop")
    assert force.friction_rate == force.beta > 0


def test_one_replica_has_no_standard_error(ageing):
    one = ageing(bonds=[[10, 20, 30]], sites=[50], events=[30], observables={})
    assert np.isnan(one.friction_drop_stderr).all()


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"hold_times": [[1.0, 10.0, 100.0]]}, r"hold_times: shape \(1, 3\)"),
        ({"hold_times": [1.0, 10.0]}, r"bonds: shape \(2, 3\); give \(replicas, 2\)"),
        ({"bonds": [10, 20, 30]}, r"bonds: shape \(3,\)"),
        ({"bonds": [[10, 20, 30], [12, 24, 51]]}, r"bonds: 51 of replica 1 at 100 s, which has only 50 sites"),
        ({"rupture_force": [[1, 2, 3], [1, -2, 3]]}, r"rupture_force: has numbers that are negative or not finite"),
        ({"rupture_force": [[1, 2, 3], [1, np.nan, 3]]}, r"rupture_force: has numbers that are negative or not finite"),
        ({"bonds": np.empty((0, 3), int), "sites": [], "events": []}, r"bonds: shape \(0, 3\)"),
        ({"sites": [50]}, "sites: give one number for each of the 2 replicas"),
        ({"events": [1, 2, 3]}, "events: give one number for each of the 2 replicas"),
        ({"load": math.nan}, "load: nan"),
        ({"bond_force": -3.0}, "bond_force: -3.0"),
        ({"temperature": math.nan}, "temperature: nan"),
    ],
)
def test_ageings_that_are_refused(ageing, changes, problem):
    with pytest.raises(InputError, match=f"Ageing: {problem}"):
        ageing(**changes)


@pytest.mark.parametrize(
    ("times", "shown"), [((1.0, 10.0, 100.0), "1"), ((0.1, 1.0, 1e3), "1000"), ((10.0, 20.0, 30.0), "30")]
)
def test_the_main_number_is_at_a_time_that_many_results_have(examples, times, shown):
    """1000 s or else 1 s, ends included, or the last hold time."""
    (_, label), *_ = result_of(examples.ageing(hold_times=times)).summary()
    assert label == f"friction coefficient drop Δμ at {shown} s"
