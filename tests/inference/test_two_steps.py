"""Curves of contacts that have rested at another temperature before, against matrix exponentials and kinetics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import chemage as ca
from chemage.plugin import KB
from chemage_inference.energies import bonded_probability
from chemage_inference.forward import make_model
from chemage_inference.problem import Unknowns

TIMES = np.geomspace(1.0, 1e5, 6)


def generator(forming: float, breaking: float, kelvin: float) -> np.ndarray:
    """Rates of a site, free and bonded."""
    on, off = (1e13 * np.exp(-energy / (KB * kelvin)) for energy in (forming, breaking))
    return np.array([[-on, off], [on, -off]])


@pytest.mark.parametrize("before", [(350.0, 1e3), (280.0, 1e4)])
@pytest.mark.parametrize("breaking", [None, 0.9, 1.1])
def test_a_site_goes_on_from_its_rest_before(breaking, before):
    law = None if breaking is None else {"kind": "gaussian", "mean": breaking, "std": 0.0}
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.4), breaking=law)
    energies = np.array([0.7, 0.85, 0.9, 1.0])
    found = bonded_probability(chemistry, 300.0, TIMES, energies, before)
    off = 50.0 if breaking is None else breaking
    for column, energy in enumerate(energies):
        first = expm(generator(energy, off, before[0]) * before[1]) @ [1.0, 0.0]
        for row, time in enumerate(TIMES):
            bonded = (expm(generator(energy, off, 300.0) * time) @ first)[1]
            assert found[row, column] == pytest.approx(bonded, rel=1e-6, abs=1e-12)


def curves(before=(300.0, 1e4), **options):
    about = {"load": 50.0, "hold_times": TIMES, "values": np.ones(6), "errors": np.full(6, 0.1), **options}
    return [ca.MeasuredCurve(temperature=350.0, before=one, **about) for one in (None, before)]


def test_the_model_of_two_steps_against_the_kinetics():
    """Of the steps of a programme; without a rest before, the curve is one of another condition."""
    data = ca.load_scene("silica-tip").todict()
    for name in ("fit", "observe", "interaction"):
        data.pop(name, None)
    data["forming"] = {"kind": "gaussian", "mean": 1.2, "std": 0.15}
    data["hold"] = {"temperature": 300, "replicas": 10}
    steps = [{"duration": 1e4}, {"temperature": 350, "duration": 1e5, "points": 26}]
    own = ca.parse_scene({**data, "step": steps})
    model = make_model(own, own.chemistry, Unknowns(), curves(), 0)
    density = np.exp(-0.5 * ((model.grid.nodes - 1.2) / 0.15) ** 2) / (0.15 * np.sqrt(2 * np.pi))
    alone, after = np.split(model.linear(density, 0)[0], 2)
    assert (after[:-1] > alone[:-1]).all()
    ageing = ca.run(own, warn=False).ageing
    at = np.array([np.argmin(np.abs(ageing.hold_times - 1e4 - time)) for time in TIMES])
    np.testing.assert_allclose(ageing.hold_times[at], 1e4 + TIMES, rtol=1e-9)
    drops = ageing.friction_drop[:, at]
    assert (np.abs(drops.mean(axis=0) - after) < 4.5 * drops.std(axis=0) / 3).all()


def test_interacting_sites_have_no_rest_before():
    own = ca.parse_scene(ca.plugin.override(ca.plugin.scene_data("silica-tip")[0], {"interaction.strength": 0.1}))
    model = make_model(own, own.chemistry, Unknowns(), curves(), 0)
    with pytest.raises(ca.InputError, match="sites that interact have no rest before"):
        model.linear(np.ones(model.grid.count), 0)


def test_a_curve_keeps_its_rest_before():
    alone, after = curves((300.0, 1e4))
    assert (alone.before, after.before) == (None, (300.0, 1e4))
    assert type(after).fromdict(after.todict()) == after
    assert after != alone
    with pytest.raises(ca.InputError, match="before"):
        curves((300.0, -1.0))
