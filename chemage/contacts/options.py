"""The options of a contact that are more than a number with a unit: its load, a force or a nominal pressure, and its
contact modulus, a number or the elastic constants of the bodies in contact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import GetCoreSchemaHandler
from pydantic_core import core_schema

from chemage.foundation.checks import force
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError, UnitError, nearest, shown
from chemage.foundation.units import (
    QuantityLike,
    Unit,
    convert,
    in_range,
    is_in_table,
)

#: what a table of elastic constants holds: those of isotropic bodies, and of a transversely isotropic one
CONSTANTS = ("young", "poisson")
CRYSTAL = ("c11", "c13", "c33", "c44")
_FORM_CRYSTAL = (
    'give c11, c13, c33 and c44, such as "209.7 GPa", with the axis along z, and young and poisson of the counter-body '
    "unless it is rigid; c12 and c66 do not enter"
)
_FORM = 'give young = ["72 GPa", "210 GPa"] and poisson = [0.17, 0.3], or one of each for a rigid counter-body'

#: above this rms slope, or mean contact pressure over E*, linear elasticity does not hold; solids have a hardness below
#: 0.3 E*
LARGEST_SLOPE, LARGEST_MEAN = 1.0, 0.3


def nominal_pressure(load: object) -> float | None:
    """``load`` in GPa where it is a pressure, such as ``"10 MPa"``; None where it is a force, a bare number, or
    neither."""
    if isinstance(load, str) and is_in_table(
        load, "GPa"
    ):  # without pint, whose import takes long
        return convert(load, "GPa")
    if isinstance(load, int | float) or (
        isinstance(load, str) and is_in_table(load, "nN")
    ):
        return None
    for unit in ("nN", "GPa"):
        try:
            value = convert(load, unit)
        except UnitError:
            continue
        return value if unit == "GPa" else None
    return None


def normal_force(
    load: QuantityLike, area: float | None, *, flat: bool, signed: bool = False
) -> float:
    """``load`` in nN, finite, and ≥ 0 unless ``signed``; a pressure is multiplied by the nominal ``area`` (nm²; None:
    not known).

    Raises
    ------
    InputError
        It is negative where nothing adheres, or out of range; or a pressure, and the surface is not nominally ``flat``
        or its area not known.
    UnitError
        It is neither a force nor a pressure.
    """
    pressure = nominal_pressure(load)
    if pressure is None:
        try:
            return force(load, signed=signed)
        except UnitError as error:
            raise UnitError(
                f'{error}; a load is a force, such as "20 uN" or "20 nm * 2.5 N/m" (deflection times spring constant), '
                'or a nominal pressure, such as "10 MPa"'
            ) from None
    give = 'give the normal force, such as load = "20 uN"'
    if not math.isfinite(pressure) or (pressure < 0 and not signed):
        raise InputError.of(
            "load",
            load,
            "must be finite and not negative",
            "give a nominal pressure such as 10 MPa",
        )
    if not flat:
        raise InputError.of(
            "load",
            load,
            "a nominal pressure needs a nominal area, and that of a tip or of a surface that is not periodic has no "
            "meaning",
            give,
        )
    if area is None:
        raise InputError.of(
            "load",
            load,
            "the nominal area of this surface is not known before it is made",
            give,
        )
    return force(pressure * area, signed=signed)


def force_text(force: float) -> str:
    """A force (nN) with the unit in which it is usually given."""
    for unit, size in (("N", 1e9), ("mN", 1e6), ("µN", 1e3)):
        if abs(force) >= size:
            return f"{force / size:.4g} {unit}"
    return f"{force:.4g} nN"


def beyond_elasticity(
    modulus: float, slope: float, mean: float, most: float = 0.0
) -> str:
    """Why linear elasticity with small slopes does not hold, in words; "" where it does: rms ``slope``, ``mean`` and
    ``most``, the largest, of the pressure over the contact (GPa); nan: not known."""
    if slope > LARGEST_SLOPE:
        what = f"the rms slope is {slope:.2g}, and the half-space needs slopes well below {LARGEST_SLOPE:g}"
        return f"{what}: give a surface without bad pixels, or one that is smoother"
    for name, pressure, limit in (
        ("mean", mean, LARGEST_MEAN),
        ("largest", most, 1.0),
    ):
        if pressure > limit * modulus:
            what = f"the {name} contact pressure is {pressure:.3g} GPa, {pressure / modulus:.2g} of the contact modulus"
            return f"{what}, which no solid bears: use a contact with a hardness, or a smaller load or rms slope"
    return ""


def contact_modulus(
    young: QuantityLike,
    poisson: float,
    counter_young: QuantityLike | None = None,
    counter_poisson: float | None = None,
) -> float:
    """The contact modulus E* of two elastic bodies, 1/E* = (1 − ν₁²)/E₁ + (1 − ν₂²)/E₂, in GPa.

    Parameters
    ----------
    young, poisson
        Young's modulus E₁ (GPa, or a string with its unit) and Poisson's ratio ν₁ of a body; −1 < ν ≤ 0.5.
    counter_young, counter_poisson
        Those of the other body; None: it is rigid, and E* = E₁/(1 − ν₁²).

    Raises
    ------
    InputError
        A modulus is not positive, a ratio is out of range, or one of the two constants of the counter-body is missing.

    Source: K. L. Johnson, Contact Mechanics, Cambridge University Press (1985), section 4.2.
    """
    if (counter_young is None) != (counter_poisson is None):
        raise InputError(
            "counter_young, counter_poisson: give both, or neither for a rigid counter-body"
        )
    compliance = _compliance("young", young, "poisson", poisson)
    if counter_young is not None:
        compliance += _compliance(
            "counter_young", counter_young, "counter_poisson", counter_poisson
        )
    return in_range(1 / compliance, "GPa")


def _compliance(
    young_name: str, young: object, poisson_name: str, poisson: object
) -> float:
    """(1 − ν²)/E of one body, 1/GPa."""
    modulus, ratio = convert(young, "GPa"), convert(poisson, "")
    if not (math.isfinite(modulus) and modulus > 0):
        raise InputError.of(
            young_name,
            young,
            "must be finite and positive",
            "give Young's modulus, such as 72 GPa",
        )
    if not -1 < ratio <= 0.5:
        raise InputError.of(
            poisson_name,
            poisson,
            "must be above -1 and at most 0.5",
            "give Poisson's ratio",
        )
    return (1 - ratio**2) / in_range(modulus, "GPa")


def indentation_modulus(
    c11: QuantityLike, c13: QuantityLike, c33: QuantityLike, c44: QuantityLike
) -> float:
    """The contact modulus (GPa) of a transversely isotropic body with its axis normal to the surface, against a rigid
    one: E* = 2 √[(c11 c33 − c13²)/c11 / (1/c44 + 2/(√(c11 c33) + c13))]; constants in GPa, or strings with their unit.

    Raises
    ------
    InputError
        A body with these constants is not stable: c11, c33 and c44 must be positive, and c13² below c11 c33.

    Source: A. Delafargue, F.-J. Ulm, Int. J. Solids Struct. 41, 7351 (2004); H. A. Elliott, Proc. Camb. Phil. Soc. 44,
    522 (1948).
    """
    values = [convert(each, "GPa") for each in (c11, c13, c33, c44)]
    for name, value in zip(CRYSTAL, values, strict=True):
        if not math.isfinite(value) or (name != "c13" and not value > 0):
            raise InputError.of(
                name,
                value,
                "must be finite and positive",
                "give an elastic constant in GPa",
            )
        in_range(abs(value) or 1.0, "GPa")
    axial, cross, normal, shear = values
    mean = math.sqrt(axial) * math.sqrt(normal)
    if not abs(cross) < mean:
        raise InputError.of(
            "c13",
            cross,
            f"must be smaller than √(c11 c33) = {mean:.6g}",
            "check the constants",
        )
    squared = (
        (mean - cross) * (mean + cross) / axial / (1 / shear + 2 / (mean + cross))
    )
    return in_range(2 * math.sqrt(squared), "GPa")


class _ModulusUnit(Unit):
    """A contact modulus: a number in GPa, a string with its unit, or a table of elastic constants."""

    def __init__(self) -> None:
        super().__init__("GPa", gt=0)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        number = core_schema.float_schema(allow_inf_nan=False, gt=0)
        scalar = core_schema.union_schema([number, core_schema.str_schema()])
        two = core_schema.list_schema(scalar, min_length=2, max_length=2)
        ratio = core_schema.float_schema(gt=-1, le=0.5)
        ratios = core_schema.union_schema(
            [ratio, core_schema.list_schema(ratio, min_length=2, max_length=2)]
        )
        table = core_schema.typed_dict_schema(
            {
                "young": core_schema.typed_dict_field(
                    core_schema.union_schema([scalar, two])
                ),
                "poisson": core_schema.typed_dict_field(ratios),
            },
            extra_behavior="forbid",
        )
        fields = {name: core_schema.typed_dict_field(scalar) for name in CRYSTAL}
        fields |= {
            name: core_schema.typed_dict_field(one, required=False)
            for name, one in zip(CONSTANTS, (scalar, ratio), strict=True)
        }
        crystal = core_schema.typed_dict_schema(fields, extra_behavior="forbid")
        return core_schema.no_info_before_validator_function(
            self._read,
            number,
            json_schema_input_schema=core_schema.union_schema(
                [number, core_schema.str_schema(), table, crystal]
            ),
        )

    def _read(self, value: object) -> float:
        """The modulus (GPa) of a number or a string, or of a table with the entries ``young`` and ``poisson``: one
        number each for an elastic body against a rigid one, lists of two for two bodies. Or with ``c11``, ``c13``,
        ``c33`` and ``c44`` of a body for which see :func:`indentation_modulus`; ``young`` and ``poisson`` are then
        those of the counter-body."""
        if not isinstance(value, Mapping):
            return super()._read(value)
        constants: Mapping[Any, Any] = value
        crystal = CRYSTAL if any(name in constants for name in CRYSTAL) else ()
        bodies = (
            CONSTANTS
            if not crystal or any(name in constants for name in CONSTANTS)
            else ()
        )
        known, form = (*crystal, *CONSTANTS), _FORM_CRYSTAL if crystal else _FORM
        if unknown := [name for name in constants if name not in known]:
            raise InputError(
                f"{shown(unknown[0])}: no such elastic constant{nearest(str(unknown[0]), known)}; {form}"
            )
        if missing := [
            name for name in (*crystal, *bodies) if name not in constants
        ]:
            raise InputError(f"{missing[0]} is missing; {form}")
        if crystal:
            own = indentation_modulus(*(constants[name] for name in CRYSTAL))
            if not bodies:
                return own
            return in_range(
                1
                / (
                    1 / own
                    + _compliance(
                        "young", constants["young"], "poisson", constants["poisson"]
                    )
                ),
                "GPa",
            )
        young, poisson = (
            list(value) if isinstance(value, list | tuple) else [value]
            for value in (constants["young"], constants["poisson"])
        )
        if not len(young) == len(poisson) <= 2 or not young:
            raise InputError(
                f"young has {len(young)} entries and poisson {len(poisson)}; {_FORM}"
            )
        return contact_modulus(young[0], poisson[0], *young[1:], *poisson[1:])

    def __repr__(self) -> str:
        return "ContactModulus"


#: the type of an option that is a contact modulus E*, GPa: a number, a quantity, or the elastic constants of the bodies
if TYPE_CHECKING:
    ContactModulus: TypeAlias = Any  # see chemage.foundation.units
else:
    ContactModulus = Annotated[float, _ModulusUnit()]


def modulus_in(component: Component) -> float | None:
    """The contact modulus among the options of ``component``, GPa, or of the one that it wraps; None where there is
    none of this type."""
    for name, info in type(component).model_fields.items():
        if any(isinstance(mark, _ModulusUnit) for mark in info.metadata):
            return getattr(component, name)
    inner = getattr(component, "inner", None)
    return modulus_in(inner) if isinstance(inner, Component) else None
