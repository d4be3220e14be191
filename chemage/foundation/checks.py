"""Validation: of the arguments of stages (type, load, temperature, seed, hold times), and of every frozen object."""

from __future__ import annotations

import ast
import inspect
import itertools
import math
import os
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    Union,
    get_args,
    get_origin,
)

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    GetJsonSchemaHandler,
    ValidationError,
)
from pydantic_core import core_schema

from chemage.foundation.errors import (
    NO_OPTION,
    InputError,
    UnitError,
    explain,
    in_lines,
    nearest,
    shown,
)
from chemage.foundation.units import (
    LARGEST,
    SMALLEST,
    QuantityLike,
    Unit,
    array_in,
    carried,
    convert,
    plain_array,
)

#: what users give as a seed: a whole number, or one of numpy's seed sequences
Seed = int | np.random.SeedSequence
#: numbers beyond this are no seeds that anyone writes down
LARGEST_SEED = 2**256 - 1
#: bins of a histogram or a spectrum
MOST_BINS = 1_000_000
#: more hold times than this fill the memory with counts
MOST_TIMES = 10_000_000


def is_table(value: Any) -> bool:
    """Whether ``value`` is a mapping of names."""
    return isinstance(value, Mapping) and all(
        map(isinstance, value, itertools.repeat(str))
    )


def expect(name: str, value: object, kind: type, remedy: str) -> None:
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        what = f"{shown(value)} ({type(value).__name__})"
        raise InputError(
            f"{name} must be {article} {kind.__name__}, got {what}; {remedy}"
        )


def force(load: QuantityLike, *, signed: bool = False) -> float:
    """``load`` in nN, finite and ≥ 0 unless ``signed``; also a deflection times a spring constant, such as
    ``"20 nm * 2.5 N/m"``."""
    deflection, times, spring = (
        load.partition(" * ") if isinstance(load, str) else ("", "", "")
    )
    value = (
        convert(deflection, "nm", "load") if times else convert(load, "nN", "load")
    )
    if times:
        value *= convert(spring, "nN/nm", "load")
    remedy = "give a force such as 20 uN"
    if not np.isfinite(value) or (value < 0 and not signed):
        raise InputError.of("load", load, "must be finite and not negative", remedy)
    if abs(value) > LARGEST:
        raise InputError.of(
            "load", load, f"is out of range, above {LARGEST:g} nN", remedy
        )
    return value


def temperature_value(temperature: QuantityLike) -> float:
    """``temperature`` in K, finite and > 0."""
    value = convert(temperature, "K", "temperature")
    remedy = "give kelvin, such as 300 K"
    if not np.isfinite(value) or value <= 0:
        raise InputError.of(
            "temperature", temperature, "must be finite and above zero", remedy
        )
    if not SMALLEST <= value <= LARGEST:
        raise InputError.of("temperature", temperature, "is out of range", remedy)
    return value


def _is_whole(value: Any) -> bool:
    # a difference of dates is an integer to numpy
    return isinstance(value, int | np.integer) and not isinstance(
        value, bool | np.timedelta64
    )


def checked_seed(seed: Any) -> int:
    """``seed`` as a non-negative int."""
    if not _is_whole(seed) or seed < 0:
        raise InputError.of("seed", seed, "must be a whole number, 0 or larger")
    if int(seed) > LARGEST_SEED:
        raise InputError(
            "seed: has more than 256 bits; give a smaller whole number"
        )
    return int(seed)


def checked_count(
    name: str, value: Any, least: int = 1, most: int | None = None
) -> int:
    """``value`` as an int of at least ``least`` and, if given, at most ``most``."""
    if not _is_whole(value) or value < least:
        raise InputError.of(
            name, value, f"must be a whole number of at least {least}"
        )
    if most is not None and value > most:
        raise InputError.of(name, value, f"must be at most {most}")
    return int(value)


def checked_states(name: str, state: Any, sites: int) -> np.ndarray:
    """``state`` as (sites,) bool."""
    remedy = "one entry per site, True = bonded"
    try:
        array = np.asarray(state)
    except (TypeError, ValueError, RecursionError):
        raise InputError.of(name, state, "is no array of bool", remedy) from None
    if array.shape != (sites,) or array.dtype != np.bool_:
        shape = f"{array.dtype} array of shape {array.shape}"
        raise InputError.of(
            name, shape, f"expected bool of shape ({sites},)", remedy
        )
    if not is_boolean(array):
        raise InputError(
            f"{name}: bytes other than 0 and 1 in an array of bool; make it with values != 0"
        )
    return array


def is_boolean(array: np.ndarray) -> bool:
    """Whether every byte of an array of bool is 0 or 1, which compiled code relies on."""
    return bool(array.size == 0 or array.view(np.uint8).max() <= 1)


def check_times(hold_times: Sequence[float] | np.ndarray) -> np.ndarray:
    """``hold_times`` as (m,) float64, non-decreasing, finite, ≥ 0, m ≥ 1; one number is one time, and data
    that carry a unit are converted."""
    try:
        array = array_in(hold_times, "s")
    except UnitError as error:
        raise UnitError(f"hold_times: {error}") from None
    if array.dtype.kind not in "fiu" and array.size:
        raise InputError.of(
            "hold_times", hold_times, "not a list of numbers", "give seconds"
        )
    times = np.array(array, dtype=np.float64, ndmin=1)
    if times.ndim != 1 or times.size == 0:
        raise InputError.of(
            "hold_times",
            times.shape,
            "must be a list with at least one time",
            "give seconds",
        )
    if times.size > MOST_TIMES:
        raise InputError.of(
            "hold_times", times.shape, f"are more than {MOST_TIMES}", "give fewer"
        )
    unreal = ~np.isfinite(times) | (times < 0)
    too_far = (times > LARGEST) | ((times > 0) & (times < SMALLEST))
    earlier = np.append(False, times[1:] < times[:-1])
    since, span = (
        "seconds since the contact was made",
        f"{SMALLEST:g} to {LARGEST:g}",
    )
    for bad, problem, remedy in (
        (unreal, "must be finite and not negative", f"give {since}"),
        (too_far, "is out of range", f"give 0, or seconds from {span}"),
        (earlier, "comes after {}", "sort the hold times"),
    ):
        if bad.any():
            at = int(np.argmax(bad))
            problem = problem.format(times[at - 1])
            name = f"hold_times[{at}]"
            raise InputError.of(name, float(times[at]), problem, remedy)
    return times


# -- arguments of public functions ------------------------------------------------------------------------------------


def check_arguments(
    function: Callable[..., Any], args: Sequence[Any], kwargs: Mapping[str, Any]
) -> None:
    """Raise an InputError if an argument is not what its annotation says; what an annotation leaves open is right."""
    function = inspect.unwrap(function)
    try:
        bound = inspect.signature(function).bind(*args, **kwargs)
    except TypeError as error:
        raise InputError(f"{function.__name__}: {error}") from None
    for name, value in bound.arguments.items():
        hint = function.__annotations__.get(name, Any)
        kind = bound.signature.parameters[name].kind
        try:
            hint = (
                eval(hint, function.__globals__) if isinstance(hint, str) else hint
            )
        except NameError:  # imported for type checkers alone
            continue
        values = value if kind is inspect.Parameter.VAR_POSITIONAL else (value,)
        if kind is not inspect.Parameter.VAR_KEYWORD and not all(
            _fits(item, hint) for item in values
        ):
            raise InputError.of(
                name,
                value,
                "is not what this argument takes",
                f"give {_in_words(hint)}",
            )


def _fits(value: Any, hint: Any) -> bool:
    """Whether ``value`` is what an annotation says, as far as that can be seen."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(_fits(value, part) for part in inner)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if hint in (None, type(None)):
        return value is None
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint in (int, float):
        is_number = isinstance(value, int | float | np.number)
        if not is_number or isinstance(value, bool):
            return False
        return bool((hint is float or _is_whole(value)) and abs(value) < 2.0**63)
    cls = origin or hint
    if not isinstance(cls, type) or cls in (Any, object):
        return True
    if getattr(cls, "_is_protocol", False):
        return all(
            hasattr(value, name) for name in vars(cls) if not name.startswith("_")
        )
    if isinstance(value, str) and "\0" in value:  # neither a path nor a word
        return False
    if not isinstance(value, cls) or (
        isinstance(value, str) and cls in (Sequence, Iterable)
    ):
        return False
    return not (isinstance(value, list | tuple) and len(inner) == 1) or all(
        _fits(item, inner[0]) for item in value
    )


_WORDS = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    types.NoneType: "None",
}
_WORDS |= {
    Mapping: "a table by name",
    Sequence: "a list",
    np.ndarray: "an array",
    os.PathLike: "a path",
    Path: "a path",
}


def _in_words(hint: Any) -> str:
    parts = (
        get_args(hint) if get_origin(hint) in (Union, types.UnionType) else [hint]
    )
    if get_origin(hint) is Literal:
        return " or ".join(map(repr, get_args(hint)))
    kinds = [get_origin(part) or part for part in parts]
    named = [
        _WORDS.get(kind) or f"a {getattr(kind, '__name__', kind)}" for kind in kinds
    ]
    return " or ".join(dict.fromkeys(named))


# -- frozen objects ---------------------------------------------------------------------------------------------------

_OF_EVERY_MODEL = {name for name in dir(BaseModel) if not name.startswith("_")}


class Frozen(BaseModel):
    """What records, components and the sections of a scene have in common."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
    #: words that users may give and that are no option here -> what to give instead
    elsewhere: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        described = handler(schema)
        texts = meanings(cls)
        for name, part in (
            handler.resolve_ref_schema(described).get("properties", {}).items()
        ):
            if name in texts:
                part["description"] = texts[name]
        return described

    def __init__(self, /, **fields: Any) -> None:
        problems = {}
        for name, with_unit in _numeric_fields(type(self)).items():
            value = fields.get(name)
            for item in value if isinstance(value, list | tuple) else (value,):
                if type(item) not in _NUMBERS and (
                    text := _is_no_number(item, with_unit)
                ):
                    problems[name] = text
        try:
            super().__init__(**fields)
        except ValidationError as error:
            for path, text in explain(error):
                if text == NO_OPTION:
                    text = self.no_option(path)
                if not problems.get(path, "").endswith(_UNIT):
                    problems[path] = text
        if problems:
            found = list(problems.items())
            raise InputError(f"{self._title()}: {in_lines(found)}", found)

    @classmethod
    def no_option(cls, name: str, beside: Iterable[str] = ()) -> str:
        """That ``name`` is no option, the nearest one, and all; in a scene its section has those ``beside`` as well."""
        known = [*cls.model_fields, *beside]
        answer = cls.elsewhere.get(name)
        hint = f" ({answer})" if answer else nearest(name, known)
        return f"{NO_OPTION}{hint}; the options are {', '.join(known) or 'none'}"

    @classmethod
    def _title(cls) -> str:
        """What messages call it."""
        return cls.__name__

    @classmethod
    def model_construct(
        cls, _fields_set: set[str] | None = None, **values: Any
    ) -> Self:
        """As the constructor: compiled code relies on what is checked there."""
        return cls(**values)

    def __dir__(self) -> list[str]:
        """What the tab key offers: not the methods of every model, unless a field has the name."""
        fields = type(self).model_fields
        return sorted(
            name
            for name in super().__dir__()
            if name not in _OF_EVERY_MODEL or name in fields
        )


#: types of what is taken for a number, or for a text with a unit, without a question
_NUMBERS = int, float, str, type(None)
#: ends what is said of data with a unit, whatever else is wrong with them
_UNIT = "; give plain numbers here"


def _is_no_number(item: Any, with_unit: bool) -> str:
    """Why an item is none, although pydantic may take it for one: True and False, masked values, and data that carry a
    unit where the field has none; in words, "" if it is."""
    if isinstance(item, bool | np.bool_ | np.timedelta64):
        return f"{item} is not a number"
    data = carried(item)
    if data is not None and not with_unit and data.unit != "dimensionless":
        return f"{shown(item)} carries the unit {data.unit}{_UNIT}"
    if data is None and hasattr(item, "__array__"):
        try:
            plain_array(item)  # nothing in it is masked
        except UnitError as error:
            return str(error)
    return ""


def meanings(cls: type[BaseModel]) -> dict[str, str]:
    """What each field means: its description, or the text below it in the source.

    The source is read when somebody asks; pydantic's ``use_attribute_docstrings`` reads it at import, which was a fifth
    of the start.
    """
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        texts |= _texts_below(base) if issubclass(base, BaseModel) else {}
    described = {
        name: info.description or texts.get(name)
        for name, info in cls.model_fields.items()
    }
    return {name: text for name, text in described.items() if text}


@lru_cache(maxsize=512)
def _texts_below(cls: type) -> dict[str, str]:
    try:
        source = inspect.getsource(cls)
    except (OSError, TypeError):  # typed in by hand
        return {}
    indented = source[:1].isspace()
    definition = ast.parse(f"if True:\n{source}" if indented else source).body[0]
    body = (
        definition.body[0] if isinstance(definition, ast.If) else definition
    ).body  # pyright: ignore[reportAttributeAccessIssue]
    texts = {}
    for field, after in itertools.pairwise(body):
        match field, after:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                value=ast.Constant(value=str() as text)
            ):
                texts[name] = inspect.cleandoc(text)
    return texts


@lru_cache(maxsize=512)
def _numeric_fields(cls: type[BaseModel]) -> dict[str, bool]:
    """The fields of numbers, and whether each has a unit."""
    kinds = {
        name: {*_kinds(info.annotation), *map(type, info.metadata)}
        for name, info in cls.model_fields.items()
    }
    return {
        name: any(
            issubclass(kind, Unit) for kind in of_field if isinstance(kind, type)
        )
        for name, of_field in kinds.items()
        if of_field & {int, float} and bool not in of_field
    }


def _kinds(annotation: Any) -> list[Any]:
    """The types in an annotation, those of its marks included."""
    origin = get_origin(annotation)
    if origin is Annotated:
        kind, *marks = get_args(annotation)
        return [*_kinds(kind), *map(type, marks)]
    if origin in (Union, types.UnionType, tuple, list):
        return [kind for part in get_args(annotation) for kind in _kinds(part)]
    return [annotation]


#: more hold times to a decade than any curve needs
MOST_PER_DECADE = 1000


def hold_times(
    start: QuantityLike, stop: QuantityLike, per_decade: int = 4
) -> np.ndarray:
    """Hold times from ``start`` to ``stop`` (s, both included), ``per_decade`` to a decade, evenly in log t.

    Times are whole multiples of 1/``per_decade`` decades above ``start``; ``stop`` is added if it is not one of them.
    """
    low, high = convert(start, "s", "start"), convert(stop, "s", "stop")
    for name, written, value in (("start", start, low), ("stop", stop, high)):
        if (
            math.isfinite(value)
            and value != 0
            and not SMALLEST <= abs(value) <= LARGEST
        ):
            raise InputError.of(
                name,
                written,
                "is out of range",
                f"give from {SMALLEST:g} to {LARGEST:g} s",
            )
    if not (math.isfinite(low) and low > 0):
        raise InputError.of(
            "start",
            start,
            "must be above zero",
            "hold times are spaced in log t; start at 1 ms, for example",
        )
    if not (math.isfinite(high) and high >= low):
        raise InputError.of(
            "stop", stop, f"must be finite and not before start ({low:g} s)"
        )
    checked_count("per_decade", per_decade, most=MOST_PER_DECADE)
    decades = math.log10(high / low)
    count = math.floor(decades * per_decade + 1e-9)
    times = low * 10.0 ** (np.arange(count + 1) / per_decade)
    # 0.001 * 10**(4/4) is 0.01, not 0.010000000000000002
    times = np.array([float(f"{t:.12g}") for t in times])
    if high > times[-1] * (1 + 1e-9):
        times = np.append(times, high)
    times[-1] = high
    return times


def within(times: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """(m,) bool: which ``times`` (m,) lie in a window, s; one given as 10.000000000000002 belongs to that from 10."""
    return (times >= window[0] * (1 - 1e-9)) & (times <= window[1] * (1 + 1e-9))
