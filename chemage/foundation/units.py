"""Units: a number is in the internal unit of its field, a string carries its own.

Internal units are nm, nN, GPa, eV, s, K. They are coherent: 1 GPa nm² = 1 nN. Strings are read by pint with exact
decimals, so that ``"20 uN"`` is 20000.0 nN to the last bit. pint is imported only when a string comes.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, get_args

import ase.units
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.fields import FieldInfo
from pydantic_core import core_schema

from chemage.foundation.errors import UnitError

if TYPE_CHECKING:
    import pint

#: 1 GPa nm³ in eV: energy = activation volume (nm³) × pressure (GPa) × this.
EV_PER_GPA_NM3 = float(ase.units.GPa * ase.units.nm**3)
#: Boltzmann constant, eV/K.
KB = float(ase.units.kB)


@lru_cache(maxsize=1)
def unit_registry() -> pint.UnitRegistry:
    """The one pint registry, with exact decimals."""
    import pint

    exact: Any = Decimal  # pint takes it, its annotation says float
    return pint.UnitRegistry(non_int_type=exact, autoconvert_offset_to_baseunit=True)


def convert(value: object, unit: str) -> float:
    """``value`` as a float in ``unit``.

    Numbers pass through; strings are parsed (``"20 uN"``, ``"6.4 angstrom**3"``, ``"0.04 eV/GPa"``, ``"27 degC"``).

    Raises
    ------
    UnitError
        The string cannot be read, or has another dimension than ``unit``.
    """
    if isinstance(value, bool) or value is None:
        raise UnitError(f"{value!r} is not a quantity; give a number in {unit or 'no unit'} or a string with its unit")
    if isinstance(value, str):
        return _parse(value, unit)
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError) as error:
        raise UnitError(
            f"{value!r} is not a quantity; give a number in {unit or 'no unit'} or a string with its unit"
        ) from error


_QUANTITY = re.compile(
    r"(?P<number>[+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*\*?\s*"
    r"(?P<unit>(?:/|[^\W\d]|[°%])[\w\s*/^().°%·⁻+-]*)"
)


@lru_cache(maxsize=4096)
def _parse(text: str, unit: str) -> float:
    try:
        plain = float(text)
    except ValueError:
        pass
    else:
        if not unit or not math.isfinite(plain):
            return plain
        raise UnitError(f'"{text}" has no unit; write "{text} {unit}", or the bare number {text} (read as {unit})')
    # pint reads "1,5 nm" as 15 nm and "1 2 nm" as 2 nm, so the number is split off and both parts are checked here
    match = _QUANTITY.fullmatch(text.strip().replace("\u2212", "-"))
    if match is None:
        raise UnitError(
            f'"{text}" cannot be read as a quantity in {unit or "pure numbers"}; '
            'write one number, with a decimal point, and its unit, such as "6.4 angstrom**3"'
        )
    import pint

    units = unit_registry()
    number, rest = match["number"], match["unit"]
    try:
        # degC has an offset, so "27 degC" is built, not multiplied out
        quantity = units.Quantity(Decimal(number), f"1{rest}" if rest.startswith("/") else rest)
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError as error:
        raise UnitError(
            f'"{text}" is a quantity of {error.units1}, but this field is in {unit or "pure numbers"}'
        ) from None
    except pint.UndefinedUnitError as error:
        names = error.unit_names if isinstance(error.unit_names, str) else ", ".join(error.unit_names)
        raise UnitError(f'"{text}": unknown unit {names}; this field is in {unit or "pure numbers"}') from None
    except Exception as error:
        raise UnitError(f'"{text}" cannot be read as a quantity in {unit or "pure numbers"} ({error})') from None


class Unit:
    """Marks a field as a quantity: ``Annotated[float, Unit("nm", gt=0)]``.

    Numbers are taken as they are (they are in ``unit``), strings are converted; infinite values and NaN are refused.
    Bounds are ``gt``, ``ge``, ``lt``, ``le``. The unit appears in the JSON Schema.
    """

    def __init__(
        self,
        unit: str,
        *,
        gt: float | None = None,
        ge: float | None = None,
        lt: float | None = None,
        le: float | None = None,
    ) -> None:
        self.unit = unit
        self._bounds: dict[str, Any] = {
            name: bound for name, bound in (("gt", gt), ("ge", ge), ("lt", lt), ("le", le)) if bound is not None
        }

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        number = core_schema.float_schema(allow_inf_nan=False, **self._bounds)
        return core_schema.no_info_before_validator_function(
            lambda value: convert(value, self.unit),
            number,
            json_schema_input_schema=core_schema.union_schema([number, core_schema.str_schema()]),
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "unit": self.unit}

    def __repr__(self) -> str:
        return f"Unit({self.unit!r})"


def unit_of(field: FieldInfo) -> str:
    """The unit of a field of a model; empty where it is no quantity."""
    # the unit of an optional field is one level deeper
    places = [field.metadata, *(getattr(part, "__metadata__", ()) for part in get_args(field.annotation))]
    return next((mark.unit for place in places for mark in place if isinstance(mark, Unit)), "")


Length = Annotated[float, Unit("nm", gt=0)]
Force = Annotated[float, Unit("nN", ge=0)]
Pressure = Annotated[float, Unit("GPa", gt=0)]
Energy = Annotated[float, Unit("eV")]
Volume = Annotated[float, Unit("nm**3")]
Time = Annotated[float, Unit("s", ge=0)]
Temperature = Annotated[float, Unit("K", gt=0)]
Frequency = Annotated[float, Unit("Hz", gt=0)]
