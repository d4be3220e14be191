"""Results are compared with hardness and shear strength, which change no bond."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chemage as ca
from chemage.ageing.aging import ELASTIC_MEASURES, elastic_measures, elastic_notes, elastic_rows, with_limits_of
from chemage.ageing.replicas import identity

TIMES = [1.0, 100.0]


@pytest.fixture(scope="module")
def contact():
    tip = ca.surface("sphere", radius="10 nm", pixels=32, pixel_size="0.4518 nm").make()
    return ca.contact("hertz", modulus="35.3 GPa").solve(tip, "60 nN")


def silica(**options):
    return ca.chemistry(
        forming=ca.barriers("uniform", lower=0.7, upper=0.9),
        activation_volume="6.4 angstrom**3",
        interaction=ca.interaction("elastic-pairs", strength=0.1, bias=0.1),
        **options,
    )


def aged(contact, **options):
    return ca.age(
        contact, silica(**options), engine=ca.engine("bkl"), hold_times=TIMES, temperature=300.0, replicas=3, seed=4
    )


def test_limits_change_no_bond_no_key_and_no_record(contact):
    plain, limited = aged(contact), aged(contact, hardness="4 GPa", shear_strength="4.6 GPa")
    assert np.array_equal(plain.bonds, limited.bonds)
    assert plain.provenance == limited.provenance
    assert "hardness" not in plain.provenance["chemistry"]
    assert limited.model_copy(update={"elasticity": {}}) == plain
    one, other = silica(), silica(hardness=4.0)
    assert one.digest() == other.digest()
    assert one != other
    engine = ca.engine("bkl")
    assert identity(contact, one, engine, 300.0) == identity(contact, other, engine, 300.0)
    assert ca.Chemistry.fromdict(other.todict()) == other


def test_the_measures_are_those_of_contact_and_bonds(contact):
    found = aged(contact, hardness="4 GPa", shear_strength="4.6 GPa")
    known = elastic_measures(found)
    assert list(known) == list(ELASTIC_MEASURES)
    area, load = contact.above(4.0)
    assert 0 < area < load < 1
    assert (known["area_above_hardness"], known["load_above_hardness"]) == (area, load)
    stress = 3.0 * found.bonds[:, -1].mean() / contact.area
    assert found.mean_shear_stress == pytest.approx(stress)
    assert known["shear_stress_to_strength"] == pytest.approx(stress / 4.6)


def test_what_is_not_given_is_absent_and_not_zero(contact):
    plain = aged(contact)
    assert plain.elasticity == {}
    assert list(elastic_measures(plain)) == ["mean_shear_stress"]
    assert elastic_notes(plain) == ()
    assert [name for name, _ in elastic_rows(plain)] == ["mean shear stress at 100 s"]
    assert elastic_measures(None) == {}
    assert elastic_rows(None) == []
    unknown = plain.model_copy(update={"contact": {}})  # an ageing curve whose area is not known
    assert math.isnan(unknown.mean_shear_stress)
    assert elastic_measures(unknown) == {}


def test_more_than_a_twentieth_is_noted(contact):
    peak = contact.max_pressure
    high = aged(contact, hardness=1.1 * peak)
    assert elastic_notes(high) == ()
    assert elastic_rows(high)[0][1] == "0 % of the contact area, 0 % of the load", "but it is in the table"
    (note,) = elastic_notes(with_limits_of(high, contact, silica(hardness=0.5 * peak)))
    area, load = contact.above(0.5 * peak)
    assert note.startswith(f"{100 * area:.0f} % of the contact area, which carries {100 * load:.0f} % of the load, is")
    assert "overestimates the pressure" in note
    stress = high.mean_shear_stress
    assert elastic_notes(with_limits_of(high, contact, silica(shear_strength=21 * stress))) == ()
    (note,) = elastic_notes(with_limits_of(high, contact, silica(shear_strength=2 * stress)))
    assert "50 % of the shear strength" in note


def test_stored_results_keep_them_and_without_them_the_file_is_as_before(contact, tmp_path):
    limited = aged(contact, hardness="4 GPa")
    ca.write(tmp_path / "limited.h5", limited)
    assert ca.read(tmp_path / "limited.h5") == limited
    assert ca.read(tmp_path / "limited.h5").elasticity == limited.elasticity
    import h5py

    ca.write(tmp_path / "plain.h5", aged(contact))
    with h5py.File(tmp_path / "plain.h5") as file:
        assert "elasticity" not in file["aging"].attrs


@pytest.mark.parametrize("wrong", [0, -1, "ten", "10 nN", True])
@pytest.mark.parametrize("name", ["hardness", "shear_strength"])
def test_what_is_no_pressure_is_refused(name, wrong):
    with pytest.raises(ca.errors.InputError, match=name):
        silica(**{name: wrong})
