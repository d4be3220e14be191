"""Chemistry: its parts, and the lattice that it makes of a contact."""

from __future__ import annotations

import json

import numpy as np
import pytest

import chemage as ca
from chemage import ContactSolution, InputError
from chemage.plugin import EV_PER_GPA_NM3, Barriers


class Ladder(Barriers):
    """Barriers evenly between 0 and 1 eV."""

    kind = "ladder"

    def quantile(self, uniform):
        return uniform

    def density(self, energy):
        return np.where((energy >= 0) & (energy <= 1), 1.0, 0.0)


def test_chemistry_goes_round_with_its_choices():
    silica = ca.chemistry(
        forming=ca.barriers("md-silica"),
        breaking=ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
        activation_volume="6.4 angstrom**3",
        interaction=ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1),
    )
    fields = json.loads(json.dumps(silica.todict()))
    assert ca.Chemistry.fromdict(fields) == silica
    assert ca.Chemistry.fromdict(fields).digest() == silica.digest()
    assert ca.Chemistry(**{**fields, "breaking": None}) != silica


def test_two_chemistries_that_differ_by_a_kind_differ():
    uniform, gaussian = ca.barriers("uniform", lower=1, upper=2), ca.barriers("gaussian", mean=1, std=2)
    assert ca.chemistry(forming=uniform).digest() != ca.chemistry(forming=gaussian).digest()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({}, "forming: is required"),
        ({"forming": "gaussian"}, "forming: .*barriers 'gaussian': mean: is required"),
        ({"forming": 3.0}, "forming: .*expected a component made with chemage.barriers"),
        ({"forming": {}}, "forming: barriers: kind is required; installed: .*gaussian"),
        ({"forming": {"kind": "gausian"}}, r"forming: no barriers 'gausian' \(did you mean 'gaussian'\?\)"),
        ({"forming": {"kind": "gaussian", "mean": 1, "std": -1}}, "forming: .*std"),
        (
            {"forming": Ladder(), "interaction": Ladder()},
            "interaction: expected a component made with chemage.interaction",
        ),
        ({"forming": Ladder(), "hydroxylation": 1.5}, "hydroxylation: 1.5"),
        ({"forming": Ladder(), "front_factor": 0}, "front_factor: 0"),
        ({"forming": Ladder(), "bond_force": "1 GPa"}, "bond_force: .*gigapascal"),
        ({"forming": Ladder(), "attempt_frequency": 0}, "attempt_frequency: 0"),
        ({"forming": Ladder(), "volume": 1}, "volume: no such option"),
    ],
)
def test_wrong_chemistry_is_refused(options, problem):
    with pytest.raises(InputError, match=f"Chemistry: {problem}"):
        ca.chemistry(**options)


# -- disorder belongs to pixels ---------------------------------------------------------------------------------------


@pytest.fixture
def contact():
    pressure = np.zeros((6, 7))
    pressure[1:4, 2:6] = np.linspace(0.5, 3, 12).reshape(3, 4)
    return ContactSolution(pressure=pressure, load=pressure.sum() * 0.25, pixel_size=0.5, modulus=30.0)


def chemistry(**options):
    return ca.chemistry(forming=Ladder(), **{"site_density": "pixel", **options})


def test_a_pixel_keeps_its_barrier_when_the_contact_grows(contact):
    pressure = np.array(contact.pressure)
    pressure[0, 0] = pressure[5, :] = 1.0
    larger = ContactSolution(pressure=pressure, load=pressure.sum() * 0.25, pixel_size=0.5, modulus=30.0)
    small, large = chemistry().on(contact, 7), chemistry().on(larger, 7)
    assert np.isin(small.sites, large.sites).all()
    assert np.array_equal(large.forming[np.isin(large.sites, small.sites)], small.forming)


@pytest.mark.parametrize("precision", [np.float64, np.float32])
def test_pressure_lowers_the_barrier_by_the_activation_volume(contact, precision):
    """Equation 3, in double precision whatever the contact has."""
    pressed = contact.model_copy(update={"pressure": contact.pressure.astype(precision)})
    plain, helped = chemistry().on(pressed, 7), chemistry(activation_volume="6.4 angstrom**3").on(pressed, 7)
    pressure = pressed.pressure.ravel()[pressed.sites].astype(np.float64)
    assert pytest.approx(0.04, rel=2e-3) == 0.0064 * EV_PER_GPA_NM3
    assert helped.forming.dtype == np.float64
    np.testing.assert_allclose(helped.forming, plain.forming - 0.0064 * EV_PER_GPA_NM3 * pressure, rtol=1e-14)


def test_forming_and_breaking_barriers_are_independent(contact):
    made = chemistry(breaking=Ladder()).on(contact, 7)
    assert made.breaking is not None
    assert not np.array_equal(made.forming, made.breaking)
    assert not made.interacting


def test_hydroxylation_keeps_the_barriers_of_the_sites_that_are_left(contact):
    all_sites, half = chemistry().on(contact, 7), chemistry(hydroxylation=0.5).on(contact, 7)
    assert 0 < half.sites.size < all_sites.sites.size
    assert np.array_equal(all_sites.forming[np.isin(all_sites.sites, half.sites)], half.forming)
    assert chemistry(hydroxylation=0).on(contact, 7).sites.size == 0
