"""Units: a number is in the field's unit, a string says its own, and nothing is guessed."""

from __future__ import annotations

import math
import runpy
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import ase.units
import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

import chemage as ca
from chemage import InputError
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    Component,
    Energy,
    Length,
    SceneError,
    Temperature,
    Unit,
    UnitError,
    convert,
    registry,
    units,
)

INTERNAL = ("nm", "nN", "GPa", "eV", "s", "K", "Hz", "nm**3")


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("20 uN", "nN", 20000.0),
        ("20 µN", "nN", 20000.0),
        ("20 μN", "nN", 20000.0),  # Greek mu as well as the micro sign
        ("6.4 angstrom**3", "nm**3", 0.0064),
        ("6.4 Å^3", "nm**3", 0.0064),
        ("6.4 Å³", "nm**3", 0.0064),
        ("0.4518 nm", "nm", 0.4518),
        ("4.518 Å", "nm", 0.4518),
        ("35.3 GPa", "GPa", 35.3),
        ("35300 MPa", "GPa", 35.3),
        ("1 ms", "s", 0.001),
        ("1e5 s", "s", 100000.0),
        ("1 day", "s", 86400.0),
        ("1e13 Hz", "Hz", 1e13),
        ("1e13/s", "Hz", 1e13),
        ("20 meV", "eV", 0.02),
        ("5 mN/m", "nN/nm", 0.005),
        ("1 GPa*nm**2", "nN", 1.0),
        ("0.1 dimensionless", "", 0.1),
        ("3 %", "", 0.03),
        ("0.1", "", 0.1),
        ("  20   uN ", "nN", 20000.0),
        ("20uN", "nN", 20000.0),
        ("-3e-2 eV", "eV", -0.03),
        ("−3 eV", "eV", -3.0),  # the minus sign of a typesetter
        (".5 nm", "nm", 0.5),
        ("5. nm", "nm", 5.0),
        ("1_000 nm", "nm", 1000.0),
    ],
)
def test_strings_are_exact_decimals(text, unit, value):
    assert convert(text, unit) == value


@pytest.mark.parametrize(
    ("text", "kelvin"),
    [
        ("300 K", 300.0),
        ("27 degC", 300.15),
        ("27degC", 300.15),
        ("-5 °C", 268.15),
        ("80.33 degF", 300.0),
        ("0 degC", 273.15),
    ],
)
def test_temperatures_with_an_offset(text, kelvin):
    assert convert(text, "K") == pytest.approx(kelvin, rel=1e-15)


def test_a_mega_is_no_milli():
    assert convert("1 MPa", "GPa") == 1e-3
    assert convert("1 mPa", "GPa") == 1e-12


def test_internal_units_are_coherent():
    assert convert("1 GPa*nm**2", "nN") == 1.0
    assert convert("1 nN/nm", "GPa*nm") == 1.0


def test_constants_are_those_of_ase():
    assert ase.units.kB == KB
    # an activation volume of 6.4 cubic angstrom is 0.04 eV per GPa
    assert math.isclose(0.0064 * EV_PER_GPA_NM3, 0.04, rel_tol=2e-3)
    # pint and ASE take the elementary charge from different CODATA sets
    assert convert("1 GPa*nm**3", "eV") == pytest.approx(EV_PER_GPA_NM3, rel=1e-7)
    assert convert("0.04 eV/GPa", "nm**3") == pytest.approx(0.04 / EV_PER_GPA_NM3, rel=1e-7)


@given(st.floats(-1e12, 1e12), st.sampled_from(INTERNAL))
def test_a_number_and_the_same_number_with_its_unit_are_one(value, unit):
    assert convert(value, unit) == value
    assert convert(f"{value!r} {unit}", unit) == value


@given(st.integers(-(10**9), 10**9), st.integers(-12, 12))
def test_prefixes_shift_the_decimal_point_exactly(digits, exponent):
    text = f"{digits}e{exponent} um"
    assert convert(text, "nm") == float(Fraction(digits) * Fraction(10) ** (exponent + 3))


# -- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "unit", "problem"),
    [
        ("20 GPa", "nN", "a quantity of gigapascal, but this field is in nN"),
        ("1 nm nm", "nm", "a quantity of nanometer ** 2"),
        ("5 nm", "", "but this field is in pure numbers"),
        ("10 nms", "nm", "unknown unit nms; this field is in nm"),
        ("1 nm to m", "nm", "unknown unit to"),
        ("20", "nN", 'has no unit; write "20 nN", or the bare number 20 (read as nN)'),
        ("1e5", "s", 'write "1e5 s"'),
    ],
)
def test_the_message_says_what_and_what_instead(text, unit, problem):
    with pytest.raises(UnitError) as caught:
        convert(text, unit)
    assert problem in str(caught.value)
    assert f'"{text}"' in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "nm",
        "abc",
        "1,5 nm",  # pint alone reads 15 nm
        "1'000 nm",  # 0 nm
        "1 2 nm",  # 2 nm
        "1:2 nm",
        "1 nm = 2",
        "1 nm # of silica",
        "1 nm; 2",
        "1 nm!",
        "[1] nm",
        "(1) nm",
        "1/3 nm",
        "3 +/- 1 nm",
        "--3 nm",
        "1e nm",
        "0x10 nm",
        "nan nm",
        "inf nm",
        "9**9**9 nm",
        "__import__('os').getcwd()",
        "(",
    ],
)
def test_what_is_not_one_number_and_its_unit_is_refused(text):
    with pytest.raises(UnitError):
        convert(text, "nm")


@pytest.mark.parametrize("value", [None, True, False, [1.0], {"nm": 1}, (1,), object(), 1j])
def test_what_is_not_a_quantity_is_refused(value):
    with pytest.raises(UnitError, match="is not a quantity; give a number in nm or a string with its unit"):
        convert(value, "nm")


@pytest.mark.parametrize("value", [np.float32(0.5), np.int64(3), np.array(2.0), Fraction(1, 2)])
def test_any_number_is_a_number(value):
    assert convert(value, "nm") == float(value)


# -- fields -----------------------------------------------------------------------------------------------------------


class Thing(Component):
    length: Length
    """how long"""
    energy: Energy = 0.0
    """how deep"""
    temperature: Temperature = 300.0
    """how warm"""
    stretch: Annotated[float, Unit("nN/nm", ge=0, le=5)] | None = None
    """how stiff"""


def test_a_field_takes_numbers_and_strings():
    thing = Thing(length="4.518 angstrom", energy=-1, temperature="27 degC", stretch="5 mN/m")
    assert (thing.length, thing.energy, thing.temperature, thing.stretch) == (0.4518, -1.0, 300.15, 0.005)
    assert thing == Thing(length=0.4518, energy="-1 eV", temperature=300.15, stretch=0.005)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"length": 0}, "length: 0.0: Input should be greater than 0"),
        ({"length": "-1 nm"}, "length: -1.0: Input should be greater than 0"),
        ({"length": math.nan}, "length: nan: Input should be a finite number"),
        ({"length": math.inf}, "length: inf: Input should be a finite number"),
        ({"length": "nan"}, "length: nan: Input should be a finite number"),
        ({"length": "1e400 nm"}, "length: inf: Input should be a finite number"),
        ({"length": "20 GPa"}, 'length: "20 GPa" is a quantity of gigapascal, but this field is in nm'),
        ({"length": True}, "length: True is not a quantity"),
        ({"length": 1, "stretch": 6}, "stretch: 6.0: Input should be less than or equal to 5"),
        ({"length": 1, "temperature": "-300 degC"}, "temperature: -26.85: Input should be greater than 0"),
        ({}, "length: is required"),
        ({"lenght": 1}, "lenght: no such option (did you mean 'length'?); the options are length, energy"),
    ],
)
def test_a_field_refuses_and_names_itself(options, problem):
    with pytest.raises(InputError) as caught:
        Thing(**options)
    assert problem in str(caught.value)


def test_the_schema_carries_units():
    properties = Thing.model_json_schema()["properties"]
    assert properties["length"]["unit"] == "nm"
    assert {part.get("type") for part in properties["length"]["anyOf"]} == {"number", "string"}
    assert "nN/nm" in str(properties["stretch"])


def test_a_unit_makes_the_annotation():
    class Other(Component):
        area: Annotated[float, Unit("nm**2", gt=0)] = 1.0

    assert Other(area="1 um**2").area == 1e6
    with pytest.raises(InputError, match=r"area: 0\.0: Input should be greater than 0"):
        Other(area=0)


def test_pint_is_imported_only_for_a_unit_that_no_power_of_ten_leads_to():
    code = (
        "import sys\nfrom chemage import convert\n"
        "assert convert(3, 'nm') == 3\nassert 'pint' not in sys.modules\n"
        "convert('3 um', 'nm')\nassert 'pint' not in sys.modules\n"
        "convert('3 inch', 'nm')\nassert 'pint' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_there_is_one_registry():
    assert units.unit_registry() is units.unit_registry()


@pytest.mark.parametrize(
    ("unit", "others"),
    [
        ("nm", "pm angstrom nm um µm mm m"),
        ("nN", "pN nN uN µN mN N"),
        ("GPa", "Pa kPa MPa GPa"),
        ("eV", "meV eV"),
        ("s", "ns us µs ms s"),
        ("K", "K"),
        ("Hz", "Hz kHz MHz GHz THz"),
        ("nm**3", "angstrom**3 nm**3"),
    ],
)
def test_common_units_are_converted_as_pint_converts_them(unit, others):
    """A table of powers of ten is used for them, because importing pint takes long."""
    numbers = ["0", "1", "-3", "0.4518", "35.3", "6.4", "1e13", "1E-5", "+2.50e3", ".5", "1_000", "123456789.123456789"]
    generator = np.random.default_rng(0)
    numbers += map(repr, (generator.uniform(-1, 1, 20) * 10.0 ** np.arange(-10, 10)).tolist())
    by_pint = units.unit_registry().Quantity
    for other in others.split():
        for number in numbers:
            assert convert(f"{number} {other}", unit) == float(by_pint(Decimal(number), other).to(unit).magnitude)


@pytest.mark.long
def test_a_scene_is_read_without_pint():
    code = "import sys, chemage; chemage.load_scene('silica-rough'); sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# -- quantities of other libraries ---------------------------------------------------------------------------------

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
    assert program["ageing"].temperature == 300.15


def test_the_programs_that_strict_type_checkers_accept_run():
    stubs = Path(__file__).parents[1] / "stubs"
    used = runpy.run_path(str(stubs / "typed_strict.py"))
    assert used["pressure"] > 0
    assert used["spectra"]
    assert used["peak"] > 0
    assert used["again"] == used["again"].model_copy(update={"heights": used["tip"].heights})
    written = runpy.run_path(str(stubs / "typed_plugin.py"))
    assert (written["inner"].kind, written["solver"].kind) == ("rejection-free", "hertz")
    assert written["Ladder"](top=0.9).declared_error == 0.1
    roles = {
        one.role for one in written.values() if isinstance(one, type) and getattr(one, "kind", "").startswith("typed-")
    }
    assert roles == {role for role, home in registry.current().roles.items() if home.startswith("chemage.")}


# -- data that carry a unit in their attributes -----------------------------------------------------------------------


def labelled(value, unit):
    """The same numbers with the same unit, as every library has them."""
    series = pd.Series(np.ravel(value))
    series.attrs["units"] = unit
    return [Q(value, unit), xr.DataArray(value, attrs={"units": unit}), xr.DataArray(Q(np.array(value), unit)), series]


@pytest.mark.parametrize("number", range(4))
def test_a_unit_in_attributes_counts_as_one_of_pint(number, tmp_path):
    def data(value, unit):
        return labelled(value, unit)[number]

    assert ca.plugin.force(data(0.02, "uN")) == 20.0
    assert ca.plugin.temperature_value(data(27.0, "degC")) == pytest.approx(300.15)
    assert ca.contact("fft-bem", modulus=data(3500.0, "MPa")).modulus == 3.5
    assert ca.contact_modulus(data(70.0, "GPa"), data(0.5, "dimensionless")) == pytest.approx(70 / 0.75)
    assert ca.plugin.check_times(data([1.0, 2.0], "hour")).tolist() == [3600.0, 7200.0]
    assert ca.plugin.check_times([data(1.0, "hour"), "2 hour"]).tolist() == [3600.0, 7200.0]
    assert ca.hold_times(data(1.0, "ms"), data(10.0, "ms"), 1).tolist() == [1e-3, 1e-2]
    scene = ca.load_scene("silica-tip", {"hold.temperature": labelled(3e5, "mK")[min(number, 2)]})
    assert scene.hold.temperature == 300
    curve = ca.Measurements("m", data([1.0, 2.0], "min"), data([0.1, 0.2], "uN"), "friction_drop")
    assert curve.hold_times.tolist() == [60.0, 120.0]
    assert curve.values.tolist() == [100.0, 200.0]
    same = ca.MeasuredCurve(
        load=1.0,
        temperature=300.0,
        hold_times=data([1.0, 2.0], "min"),
        values=data([0.1, 0.2], "uN"),
        errors=[1.0, 1.0],
    )
    assert same.values.tolist() == curve.values.tolist()
    for wrong in (lambda: ca.plugin.force(data(1.0, "s")), lambda: ca.plugin.check_times(data([1.0], "nm"))):
        with pytest.raises(UnitError, match="is a quantity of"):
            wrong()


def test_a_number_without_a_unit_refuses_data_with_one():
    heights = np.zeros((4, 4))
    for size in labelled(0.5, "um")[:3]:
        with pytest.raises(InputError, match=r"pixel_size: .* carries the unit"):
            ca.Surface(heights=heights, pixel_size=size)
    with pytest.raises(InputError, match=r"energies: .* carries the unit meV"):
        ca.barriers("tabulated", energies=xr.DataArray([1.0, 2.0], attrs={"units": "meV"}), weights=[0, 1])


def test_heights_carry_their_unit():
    heights = np.arange(12.0).reshape(3, 4)
    for data in labelled(heights, "um")[:3]:
        assert np.allclose(ca.Surface(heights=data, pixel_size=1).heights, 1e3 * heights, rtol=1e-12)
    with pytest.raises(UnitError, match=r"heights: .* is a quantity of seconds since 2000-01-01"):
        ca.Surface(heights=xr.DataArray(heights, attrs={"units": "seconds since 2000-01-01"}), pixel_size=1)


def test_what_a_result_states_is_read_back():
    written = ca.plugin.BondHistory.arrays | ca.ReactionLattice.arrays | ca.ContactSolution.arrays | ca.Inference.arrays
    for _, unit, _ in written.values():
        data = xr.DataArray([1.0], attrs={"units": unit or "1"})
        assert units.array_in(data, unit).tolist() == [1.0]


@pytest.mark.parametrize(
    "value", [np.ma.masked, np.ma.masked_array(0.02, True), np.ma.masked_array([1.0, 2.0], [0, 1])]
)
def test_what_is_masked_is_no_number(value):
    calls = [
        lambda: ca.plugin.force(value),
        lambda: ca.plugin.check_times(value),
        lambda: ca.contact("fft-bem", modulus=value),
        lambda: ca.load_scene("silica-tip", {"contact.load": value}),
        lambda: ca.barriers("tabulated", samples=value),
        lambda: ca.barriers("gaussian", mean=1.0, std=value),
    ]
    for call in calls:
        with pytest.raises(InputError, match="masked"):
            call()


def test_durations_of_other_libraries_are_no_numbers():
    for value in (np.timedelta64(5, "h"), pd.Timedelta("5h"), pd.Series(pd.to_timedelta(["5h"]))):
        for call in (ca.plugin.force, ca.plugin.check_times, ca.plugin.checked_seed, lambda v: ca.hold_times(1, 2, v)):
            with pytest.raises(InputError):
                call(value)


def test_bounds_of_a_field_count_beside_those_of_its_quantity():
    class Timed(Component):
        after: units.Time = Field(default=1.0, gt=0, le=10)

    assert Timed(after="10 s").after == 10.0
    for value, problem in ((0, "greater than 0"), ("0 s", "greater than 0"), (-1, "than or equal to 0"), (11, "10")):
        with pytest.raises(InputError, match=problem):
            Timed(after=value)
    (number, _) = Timed.model_json_schema()["properties"]["after"]["anyOf"]
    assert (number["exclusiveMinimum"], number["maximum"]) == (0, 10)
