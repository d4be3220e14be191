"""Quantities of pint, of any registry, and of libraries with the same methods are taken wherever a quantity is."""

from __future__ import annotations

import runpy
from decimal import Decimal
from pathlib import Path

import numpy as np
import pint
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import SceneError, UnitError

UNITS = pint.UnitRegistry()
Q = UNITS.Quantity


class Astronomical:
    """What quantities of astropy have: ``to``, ``value`` and ``unit``."""

    def __init__(self, value, unit):
        self.value, self.unit = value, unit

    def to(self, unit):
        if (self.unit, unit) != ("um", "nm"):
            raise ValueError(f"{self.unit} and {unit} are not convertible")
        return Astronomical(self.value * 1e3, unit)


@pytest.mark.parametrize(
    ("quantity", "text", "unit"),
    [
        (Q(20, "uN"), "20 uN", "nN"),
        (Q(0.1, "um"), "0.1 um", "nm"),
        (Q(27, "degC"), "27 degC", "K"),
        (Q(6.4, "angstrom**3"), "6.4 angstrom**3", "nm**3"),
        (Q(0.04, "eV/GPa"), "0.04 eV/GPa", "nm**3"),
        (Q(35.3, "GPa"), "35.3 GPa", "GPa"),
        (Q(0.5, ""), "0.5", ""),
        (pint.UnitRegistry(non_int_type=Decimal).Quantity(Decimal("0.3"), "um"), "0.3 um", "nm"),
        (Astronomical(0.7, "um"), "0.7 um", "nm"),
    ],
)
def test_a_quantity_has_the_bits_of_the_string_with_its_unit(quantity, text, unit):
    assert ca.plugin.convert(quantity, unit) == ca.plugin.convert(text, unit)


def test_a_registry_with_units_of_its_own_is_believed():
    own = pint.UnitRegistry()
    own.define("burger = 0.286 nm")
    assert ca.plugin.convert(own.Quantity(2, "burger"), "nm") == pytest.approx(0.572, rel=1e-12)


def test_numbers_of_numpy_are_numbers():
    assert ca.plugin.convert(np.float32(0.5), "nm") == 0.5
    assert ca.plugin.convert(np.int64(3), "nm") == 3.0


def test_the_wrong_dimension_names_field_value_and_unit():
    with pytest.raises(InputError, match=r"radius: \"30 gigapascal\" is a quantity of gigapascal, .* in nm"):
        ca.surface("sphere", radius=Q(30, "GPa"), pixels=8, pixel_size=1)
    with pytest.raises(UnitError, match=r'load: "3 meter" is a quantity of meter, but this field is in nN'):
        ca.plugin.force(Q(3, "m"))
    with pytest.raises(UnitError, match=r'load: "3 m" is a quantity of meter, but this field is in nN'):
        ca.plugin.force("3 m")
    with pytest.raises(UnitError, match=r'temperature: "3 s" .* in K'):
        ca.plugin.temperature_value("3 s")
    with pytest.raises(UnitError, match=r'"2 um" is a quantity of um, but this field is in s'):
        ca.plugin.convert(Astronomical2(), "s")


class Astronomical2(Astronomical):
    def __init__(self):
        super().__init__(2, "um")

    def __str__(self):
        return "2 um"


def test_several_numbers_are_not_one():
    with pytest.raises(UnitError, match="is not one quantity"):
        ca.plugin.convert(Q([1, 2], "nm"), "nm")


def test_hold_times_may_carry_their_unit():
    assert ca.plugin.check_times(Q([1, 20], "ms")).tolist() == [1e-3, 20e-3]
    assert ca.plugin.check_times([Q(1, "ms"), "2 s", 3.0]).tolist() == [1e-3, 2.0, 3.0]
    assert ca.hold_times(Q(1, "ms"), Q(10, "ms"), 1).tolist() == [1e-3, 1e-2]


def test_arrays_of_records_are_converted():
    surface = ca.Surface(heights=Q([[0.001, 0.002]], "um"), pixel_size=1)
    assert np.allclose(surface.heights, [[1, 2]], rtol=1e-12)
    with pytest.raises(UnitError, match=r"Surface: heights: .* is a quantity of second, but this field is in nm"):
        ca.Surface(heights=Q([[1, 2]], "s"), pixel_size=1)


SCENE = {
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 16, "pixel_size": "1 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "0.05 uN"},
    "forming": {"kind": "uniform", "lower": "0.8 eV", "upper": "1.2 eV"},
    "engine": {"kind": "auto"},
    "hold": {"times": ["1 ms", "10 ms"], "replicas": 2, "temperature": "27 degC"},
}


def test_scene_data_may_hold_quantities():
    given = {
        **SCENE,
        "surface": {"kind": "sphere", "radius": Q(30, "nm"), "pixels": 16, "pixel_size": Q(1, "nm")},
        "contact": {"kind": "hertz", "modulus": Q(35.3, "GPa"), "load": Q(0.05, "uN")},
        "hold": {"times": Q([1, 10], "ms"), "replicas": 2, "temperature": Q(27, "degC")},
    }
    assert ca.parse_scene(given).keys() == ca.parse_scene(SCENE).keys()
    with pytest.raises(SceneError, match=r'contact.load: "50.0 nanometer" is a quantity of nanometer, .* in nN'):
        ca.parse_scene({**SCENE, "contact": {"kind": "hertz", "modulus": 35.3, "load": Q(50, "nm")}})


def test_the_program_that_type_checkers_accept_runs():
    """CI checks its types with pyright; here its numbers."""
    program = runpy.run_path(str(Path(__file__).parents[1] / "stubs" / "typed_program.py"))
    assert len({contact.digest() for contact in program["contacts"]}) == 1
    assert len({maker.digest() for maker in program["makers"]}) == 1
    assert program["aging"].temperature == 300.15
