"""Results are compared with hardness and shear strength, which change no bond."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import chemage as ca

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
    assert ca.Chemistry.fromdict(other.todict()) == other


NAMES = {
    "hardness",
    "area_above_hardness",
    "load_above_hardness",
    "mean_shear_stress",
    "shear_strength",
    "shear_stress_to_strength",
}


@pytest.fixture
def numbers(command, tmp_path):
    """``numbers(ageing)``: what ``chemage show --json`` says of pressures and shear stresses."""

    def numbers(ageing: ca.Ageing) -> dict[str, float]:
        ca.write(tmp_path / "ageing.h5", ageing, force=True)
        shown = json.loads(command("show", tmp_path / "ageing.h5", "--json").out)
        return {name: one["value"] for name, one in shown.items() if name in NAMES}

    return numbers


@pytest.fixture
def shown(command, tmp_path):
    """``shown(ageing)``: what ``chemage show --all`` says, in one line."""

    def shown(ageing: ca.Ageing) -> str:
        ca.write(tmp_path / "ageing.h5", ageing, force=True)
        return " ".join(command("show", tmp_path / "ageing.h5", "--all").out.split())

    return shown


def test_a_tip_that_adhesion_holds_is_noted(contact, shown):
    """2πwR of 0.05 J/m² and 10 nm is 3.14 nN; JKR has 3/4 of it."""
    ageing = aged(contact, work_of_adhesion="50 mJ/m**2")
    assert np.array_equal(ageing.bonds, aged(contact).bonds)
    assert ageing.elasticity["pull_off_to_load"] == pytest.approx(2 * math.pi * 0.05 * 10 / 60)
    assert "holds this sphere with up to 5.24 % of the load" in shown(ageing)
    assert "holds this sphere" not in shown(aged(contact, work_of_adhesion=0.01))


def test_the_measures_are_those_of_contact_and_bonds(contact, numbers):
    found = aged(contact, hardness="4 GPa", shear_strength="4.6 GPa")
    known = numbers(found)
    assert known.keys() == NAMES
    area, load = contact.above(4.0)
    assert 0 < area < load < 1
    assert (known["area_above_hardness"], known["load_above_hardness"]) == pytest.approx((area, load))
    stress = 3.0 * found.bonds[:, -1].mean() / contact.area
    assert found.mean_shear_stress == pytest.approx(stress)
    assert known["shear_stress_to_strength"] == pytest.approx(stress / 4.6)


def test_what_is_not_given_is_absent_and_not_zero(contact, numbers, shown):
    plain = aged(contact)
    assert plain.elasticity == {}
    assert numbers(plain).keys() == {"mean_shear_stress"}
    assert "mean shear stress at 100 s" in shown(plain)
    assert "hardness" not in shown(plain)
    assert ca.Run(scene={}, contact=contact, ageing=plain).notes == ca.Run(scene={}, contact=contact).notes
    unknown = plain.model_copy(update={"contact": {}})  # an ageing curve whose area is not known
    assert math.isnan(unknown.mean_shear_stress)
    assert numbers(unknown) == {}
    assert "shear stress" not in shown(unknown)


def test_more_than_a_twentieth_is_noted(contact, shown):
    def notes(**limits):
        return [
            note
            for note in ca.Run(scene={}, contact=contact, ageing=aged(contact, **limits)).notes
            if "overestimates the pressure" in note or "shear strength" in note
        ]

    peak, stress = contact.max_pressure, aged(contact).mean_shear_stress
    assert notes(hardness=1.1 * peak) == []
    assert "share of the load above the hardness 0 " in shown(aged(contact, hardness=1.1 * peak)), "in the table"
    (note,) = notes(hardness=0.5 * peak)
    area, load = contact.above(0.5 * peak)
    assert note.startswith(f"{100 * area:.0f} % of the contact area, which carries {100 * load:.0f} % of the load, is")
    assert notes(shear_strength=21 * stress) == []
    (note,) = notes(shear_strength=2 * stress)
    assert "50 % of the shear strength" in note


def test_stored_results_keep_them_and_without_them_the_file_is_as_before(contact, tmp_path):
    limited = aged(contact, hardness="4 GPa")
    ca.write(tmp_path / "limited.h5", limited)
    assert ca.read(tmp_path / "limited.h5") == limited
    assert ca.read(tmp_path / "limited.h5").elasticity == limited.elasticity
    import h5py

    ca.write(tmp_path / "plain.h5", aged(contact))
    with h5py.File(tmp_path / "plain.h5") as file:
        assert "elasticity" not in file["ageing"].attrs


@pytest.mark.parametrize("wrong", [0, -1, "ten", "10 nN", True])
@pytest.mark.parametrize("name", ["hardness", "shear_strength"])
def test_what_is_no_pressure_is_refused(name, wrong):
    with pytest.raises(ca.errors.InputError, match=name):
        silica(**{name: wrong})
