"""Units: a number is in the internal unit of its field, a string carries its own.

Internal units are nm, nN, GPa, eV, s, K. They are coherent: 1 GPa nm² = 1 nN. Strings are read with exact decimals, so
that ``"20 uN"`` is 20000.0 nN to the last bit: where a power of ten leads from one unit to the other from a table, and
by pint otherwise, because importing pint takes longer than everything else that reads a scene. Data that carry a unit
are taken where a string with its unit is: quantities of pint, of any registry, of astropy and unyt, and what xarray,
pandas and netCDF hold with an attribute ``units`` (CF conventions, section 3.1). Masked values and dates are refused.

:func:`convert` makes a number of what a user gives, :func:`array_in` an array.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    NamedTuple,
    Protocol,
    TypeAlias,
    get_args,
)

import ase.units
import numpy as np
from pydantic import BeforeValidator, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.fields import FieldInfo
from pydantic_core import core_schema

from chemage.foundation.aliases import Data
from chemage.foundation.errors import InputError, UnitError, shortened, shown

if TYPE_CHECKING:
    import pint
    from pydantic import BaseModel


class WithUnit(Protocol):
    """A number with its unit as pint has it, and astropy and unyt."""

    def to(self, unit: Any, /) -> Any:
        """The same quantity in another unit."""


#: what users give for a quantity: a number in the internal unit, a string with its unit, or a quantity of pint
QuantityLike: TypeAlias = (
    float | str | np.floating[Any] | np.integer[Any] | WithUnit
)

#: 1 GPa nm³ in eV: energy = activation volume (nm³) × pressure (GPa) × this.
EV_PER_GPA_NM3 = float(ase.units.GPa * ase.units.nm**3)
#: Boltzmann constant, eV/K.
KB = float(ase.units.kB)
#: K, below which a temperature in °C may be meant
COLD = 150.0
#: Quantities other than zero are between these in their internal units: their squares and products stay numbers.
SMALLEST, LARGEST = 1e-100, 1e100


#: internal unit -> other units of its dimension -> exponent of ten
_POWERS: dict[str, dict[str, int]] = {
    "nm": {"pm": -3, "angstrom": -1, "nm": 0, "um": 3, "µm": 3, "mm": 6, "m": 9},
    "nN": {"pN": -3, "nN": 0, "uN": 3, "µN": 3, "mN": 6, "N": 9},
    "GPa": {"Pa": -9, "kPa": -6, "MPa": -3, "GPa": 0},
    "eV": {"meV": -3, "eV": 0},
    "s": {"ns": -9, "us": -6, "µs": -6, "ms": -3, "s": 0},
    "K": {"K": 0},
    "Hz": {"Hz": 0, "kHz": 3, "MHz": 6, "GHz": 9, "THz": 12},
    "nm**3": {"angstrom**3": -3, "nm**3": 0},
}
#: longer numbers are left to pint, which rounds to 28 decimals
_DIGITS = 25


@lru_cache(maxsize=1)
def unit_registry() -> pint.UnitRegistry:
    """The one pint registry, with exact decimals."""
    import pint

    exact: Any = Decimal  # pint takes it, its annotation says float
    return pint.UnitRegistry(
        non_int_type=exact, autoconvert_offset_to_baseunit=True
    )


def convert(value: object, unit: str, field: str = "") -> float:
    """``value`` as a float in ``unit``.

    Numbers pass through; strings are parsed (``"20 uN"``, ``"6.4 angstrom**3"``, ``"0.04 eV/GPa"``, ``"27 degC"``);
    quantities of pint, of any registry, are converted. ``field`` is named in messages.

    Raises
    ------
    UnitError
        The string cannot be read, or has another dimension than ``unit``.
    """
    if field:
        try:
            return convert(value, unit)
        except UnitError as error:
            raise UnitError(f"{field}: {error}") from None
    if isinstance(value, str):
        return _parse(value, unit)
    data = None if isinstance(value, int | float) else carried(value)
    number: Any = value if data is None else magnitudes(data, unit)
    try:
        if hasattr(number, "__array__"):
            array = plain_array(number)
            number = array.item() if array.dtype.kind in "fiuO" else None
        if number is None or isinstance(number, bool | str | bytes):
            raise TypeError
        result = float(number)
    except UnitError as error:
        raise UnitError(f"{shown(value)}: {error}") from None
    except Exception:  # of whatever library
        what = "a quantity; give a" if data is None else "one quantity; give one"
        several = (
            "; several are compared by a sweep, see docs/sweeps.md"
            if isinstance(value, list | tuple)
            else ""
        )
        raise UnitError(
            f"{shown(value)} is not {what} number in {unit or 'no unit'} or a string with its unit{several}"
        ) from None
    # with exact decimals, as strings are read, so that equal quantities have equal bits; not where a registry of units
    # has a meaning of its own
    try:
        exact = result if data is None else _parse(in_words(value), unit)
    except (UnitError, TypeError, ValueError, AttributeError):
        return result
    return exact if math.isclose(exact, result, rel_tol=1e-9) else result


class Carried(NamedTuple):
    """Data that carry a unit."""

    numbers: Any
    unit: str
    #: their own conversion, of quantities that have one
    to: Callable[[str], Any] | None = None


def carried(value: Any) -> Carried | None:
    """The numbers and the unit of data that carry one, as an attribute ``units`` or ``unit`` or in ``attrs``, else
    None."""
    if isinstance(value, _PLAIN) or type(value) is np.ndarray:
        return None
    try:
        attrs = getattr(value, "attrs", None)
        if not isinstance(attrs, Mapping):
            unit = next(
                (
                    own
                    for name in _NAMES
                    if (own := getattr(value, name, None)) is not None
                ),
                None,
            )
            numbers = getattr(value, "magnitude", getattr(value, "value", value))
            to = None if numbers is value else value.to
        elif (
            unit := next((attrs[name] for name in _NAMES if name in attrs), None)
        ) is None:
            return (
                carried(value.data) if hasattr(value, "dims") else None
            )  # xarray around a quantity
        else:
            numbers, to = value, None
    except Exception:  # attributes that cannot be read
        return None
    if unit is None:
        return None
    text = (
        unit.decode("utf-8", "replace") if isinstance(unit, bytes) else str(unit)
    ).strip()
    text = "dimensionless" if text in ("", "1") else text
    return Carried(numbers, text[1:] if text.startswith("1/") else text, to)


_NAMES = ("units", "unit")
_PLAIN = (
    int,
    float,
    complex,
    str,
    bytes,
    list,
    tuple,
    dict,
    type,
    np.generic,
    type(None),
    Path,
)


def magnitudes(data: Carried, unit: str) -> Any:
    """The number, or the array of numbers, of data that carry a unit, in ``unit``.

    Raises
    ------
    UnitError
        They have another dimension than ``unit``, or their unit cannot be read.
    """
    try:
        if data.to is not None:
            of_pint = hasattr(data.to.__self__, "magnitude")  # pyright: ignore[reportFunctionMemberAccess]
            there = carried(data.to(unit or ("dimensionless" if of_pint else "")))
            return data.numbers if there is None else there.numbers
        # from two points, because the zero of a unit may be another: degC
        zero, one = (_parse(f"{number} {data.unit}", unit) for number in (0, 1))
    except Exception as error:  # every library has its own
        raise UnitError(
            f'"{shortened(" ".join(f"{data.numbers} {data.unit}".split()))}" is a quantity of {data.unit}, '
            f"but this field is in {unit or 'pure numbers'}"
        ) from error
    return (
        data.numbers
        if (zero, one) == (0.0, 1.0)
        else zero + plain_array(data.numbers) * (one - zero)
    )


def plain_array(value: Any) -> np.ndarray:
    """``value`` as an array, whatever it holds, of which nothing is masked.

    Raises
    ------
    UnitError
        It is no array, or values are masked.
    """
    try:
        array = np.asanyarray(value)
        masked = int(np.count_nonzero(getattr(array, "mask", False)))
    except Exception:  # ragged, nested too deeply, or of a library that refuses
        raise UnitError("expected an array of numbers") from None
    if masked:
        raise UnitError(
            f"{masked} values are masked; fill or crop missing data first"
        )
    return np.asarray(array)


def array_in(value: Any, unit: str = "") -> np.ndarray:
    """``value`` as an array, in ``unit`` where it carries a unit, or is a list of what does.

    Raises
    ------
    UnitError
        It is no array, values are masked, or their dimension is another than that of ``unit``.
    """
    if type(value) is np.ndarray:  # neither masked nor of another library
        return value
    if (data := carried(value)) is not None:
        return plain_array(magnitudes(data, unit))
    if isinstance(value, list | tuple) and any(
        carried(item) is not None for item in value
    ):
        return np.array([convert(item, unit) for item in value])
    return plain_array(value)


def in_words(data: Any, path: str = "") -> Any:
    """A copy of scene data without anything of another library: what carries a unit becomes a string with it, such as
    ``"20.0 micronewton"``, or a list of strings, and an array a list."""
    if isinstance(data, Mapping):
        return {
            name: item
            if isinstance(item, int | float | str)
            else in_words(item, f"{path}.{name}".lstrip("."))
            for name, item in data.items()
        }
    if isinstance(data, list | tuple):
        return [in_words(item, path) for item in data]
    own = carried(data)
    if own is None and (isinstance(data, type) or not hasattr(data, "__array__")):
        return data
    try:
        numbers = plain_array(data if own is None else own.numbers).tolist()
    except UnitError as error:
        raise UnitError(f"{path}: {error}") from None
    if own is None:
        return in_words(numbers, path) if isinstance(numbers, list) else numbers
    return (
        [_word(item, own.unit) for item in numbers]
        if isinstance(numbers, list)
        else _word(numbers, own.unit)
    )


def _word(number: Any, unit: str) -> str:
    return f"{float(number)!r} {unit}".strip().removesuffix(" dimensionless")


def is_in_table(text: str, unit: str) -> bool:
    """Whether this is a quantity whose unit leads to ``unit`` by a power of ten, which is read without pint."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) <= 200 else None
    return match is not None and match["unit"] in _POWERS.get(unit, {})


def in_range(value: float, unit: str) -> float:
    """``value`` if it is zero, not finite, or of a magnitude that computations can hold.

    Raises
    ------
    InputError
        It is smaller than ``SMALLEST`` or larger than ``LARGEST``.
    """
    if (
        value != 0
        and math.isfinite(value)
        and not SMALLEST <= abs(value) <= LARGEST
    ):
        text = f"{value:g} {unit}".strip()
        raise InputError(
            f"{text} is out of range; give 0, or {SMALLEST:g} to {LARGEST:g} {unit}".strip()
        )
    return value


_QUANTITY = re.compile(
    r"(?P<number>[+-]?(?:\d[\d_]*(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)\s*(?:\*\s*)?"
    r"(?P<unit>(?:/|[^\W\d_]|[°%])[\w\s*/^().°%·⁻+-]*)"
)


@lru_cache(maxsize=4096)
def _parse(text: str, unit: str) -> float:
    if len(text) > 200:
        raise UnitError(
            f"{shown(text)} is too long for a quantity; write one number and its unit"
        )
    try:
        plain = float(text)
    except ValueError:
        pass
    else:
        if not unit or not math.isfinite(plain):
            return plain
        raise UnitError(
            f'"{text}" has no unit; write "{text} {unit}", or the bare number {text} (read as {unit})'
        )
    # pint reads "1,5 nm" as 15 nm and "1 2 nm" as 2 nm, so the number is split off and both parts are checked here
    match = _QUANTITY.fullmatch(text.strip().replace("\u2212", "-"))
    if match is None:
        raise UnitError(
            f'"{text}" cannot be read as a quantity in {unit or "pure numbers"}; '
            'write one number, with a decimal point, and its unit, such as "6.4 angstrom**3"'
        )
    number, rest = match["number"], match["unit"]
    power = _POWERS.get(unit, {}).get(rest)
    if power is not None and len(number) <= _DIGITS:
        return float(Decimal(number).scaleb(power))
    import pint

    units = unit_registry()
    try:
        # degC has an offset, so "27 degC" is built, not multiplied out
        quantity = units.Quantity(
            Decimal(number), f"1{rest}" if rest.startswith("/") else rest
        )
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError as error:
        raise UnitError(
            f'"{text}" is a quantity of {error.units1}, but this field is in {unit or "pure numbers"}'
        ) from None
    except pint.UndefinedUnitError as error:
        names = (
            error.unit_names
            if isinstance(error.unit_names, str)
            else ", ".join(error.unit_names)
        )
        raise UnitError(
            f'"{text}": unknown unit {names}; this field is in {unit or "pure numbers"}'
        ) from None
    except Exception as error:
        raise UnitError(
            f'"{text}" cannot be read as a quantity in {unit or "pure numbers"} ({error})'
        ) from None


def unit_written(temperature: object) -> str:
    """The unit that is written with the number of a temperature, ``"K"`` of ``"27 K"``; "" where there is none."""
    return "K" if "K" in str(temperature) else ""


def celsius_meant(field: str, kelvin: float) -> str:
    """A question for a temperature so low that it may be one in °C; empty for any other."""
    if kelvin >= COLD:
        return ""
    return (
        f"{field} = {kelvin:g} K: is {kelvin:g} °C meant? "
        f'Write "{kelvin:g} degC", which is {convert(f"{kelvin} degC", "K"):g} K'
    )


def in_one_unit(values: Sequence[object]) -> tuple[list[float], str] | None:
    """The numbers and the unit of ``values`` as they were written, where all are strings with the same unit."""
    matches = [
        _QUANTITY.fullmatch(value.strip()) if isinstance(value, str) else None
        for value in values
    ]
    units = {None if match is None else match["unit"].strip() for match in matches}
    if len(units) != 1 or None in units:
        return None
    return [float(match["number"]) for match in matches if match is not None], str(
        units.pop()
    )


_BOUNDS = ("gt", "ge", "lt", "le")


class Unit:
    """Marks a field as a quantity: ``Annotated[Any, Unit("nm", gt=0)]``; type checkers then accept strings with units.

    Numbers are taken as they are (they are in ``unit``), strings are converted; infinite values and NaN are refused.
    Bounds are ``gt``, ``ge``, ``lt``, ``le``. The unit appears in the JSON Schema. Magnitudes outside 1e-100
    to 1e100 are refused, because their products leave the range of numbers, unless ``wide``, or in eV, or without unit.
    ``words`` may be given in place of a quantity.
    """

    def __init__(
        self,
        unit: str,
        *,
        gt: float | None = None,
        ge: float | None = None,
        lt: float | None = None,
        le: float | None = None,
        wide: bool = False,
        words: Collection[str] = (),
    ) -> None:
        self.unit = unit
        self.words = words
        self.wide = wide or unit in (
            "",
            "eV",
        )  # barriers are limited by the engines
        bounds = zip(_BOUNDS, (gt, ge, lt, le), strict=True)
        self._bounds: Data = {
            name: bound for name, bound in bounds if bound is not None
        }

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        # with the bounds of the field, such as Field(gt=0)
        bounds: Data = {k: v for k, v in handler(source).items() if k in _BOUNDS}
        number = core_schema.float_schema(
            allow_inf_nan=False, **(self._bounds | bounds)
        )
        either = core_schema.union_schema([number, core_schema.str_schema()])
        as_it_is = core_schema.plain_serializer_function_ser_schema(
            lambda value: value
        )
        return core_schema.no_info_wrap_validator_function(
            self._validated,
            number,
            json_schema_input_schema=either,
            serialization=as_it_is if self.words else None,
        )

    def _validated(
        self, value: object, check: core_schema.ValidatorFunctionWrapHandler
    ) -> object:
        is_word = isinstance(value, str) and value in self.words
        return value if is_word else check(self._read(value))

    def _read(self, value: object) -> float:
        number = convert(value, self.unit)
        return number if self.wide else in_range(number, self.unit)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> Data:
        return {**handler(schema), "unit": self.unit}

    def __repr__(self) -> str:
        return f"Unit({self.unit!r})"


@lru_cache(maxsize=512)
def units_of(model: type[BaseModel]) -> Mapping[str, str]:
    """The unit of each field of a model that is a quantity."""
    return {
        name: mark.unit
        for name, field in model.model_fields.items()
        for mark in _marks(field)
        if isinstance(mark, Unit)
    }


def is_file_path(field: FieldInfo) -> bool:
    """Whether a field of a model is a :data:`FilePath`."""
    return any(mark is _FILE for mark in _marks(field))


def _marks(field: FieldInfo) -> Iterator[Any]:
    # those of an optional field are one level deeper
    for place in (
        field.metadata,
        *(getattr(part, "__metadata__", ()) for part in get_args(field.annotation)),
    ):
        yield from place


_FILE = BeforeValidator(
    lambda value: str(value) if isinstance(value, Path) else value
)
#: the path of a file, a text or a ``Path``: where a scene in a file has a relative one, it starts from that folder
FilePath: TypeAlias = Annotated[str, _FILE]


if TYPE_CHECKING:
    # to a type checker anything can be assigned to a quantity: numbers, strings with units, quantities of pint. Its own
    # checks of the value are made when the component is.
    Length: TypeAlias = Any
    Force: TypeAlias = Any
    Pressure: TypeAlias = Any
    Energy: TypeAlias = Any
    Volume: TypeAlias = Any
    Time: TypeAlias = Any
    Temperature: TypeAlias = Any
    Frequency: TypeAlias = Any
else:
    Length = Annotated[float, Unit("nm", gt=0)]
    Force = Annotated[float, Unit("nN", ge=0)]
    Pressure = Annotated[float, Unit("GPa", gt=0)]
    Energy = Annotated[float, Unit("eV", ge=-1e300, le=1e300)]
    Volume = Annotated[float, Unit("nm**3")]
    Time = Annotated[float, Unit("s", ge=0)]
    Temperature = Annotated[float, Unit("K", gt=0)]
    Frequency = Annotated[float, Unit("Hz", gt=0)]
