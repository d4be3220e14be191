"""Models of pydantic as chemage has them: frozen, without booleans for numbers, with errors in plain words."""

from __future__ import annotations

import types
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Any, Self, Union, get_args, get_origin

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from chemage.foundation.errors import shown

_OF_EVERY_MODEL = {name for name in dir(BaseModel) if not name.startswith("_")}


class Frozen(BaseModel):
    """What records, components and the sections of a scene have in common."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, use_attribute_docstrings=True)

    @field_validator("*", mode="wrap")
    @classmethod
    def _no_booleans(cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        """Refuse True and False, also in a list, in a field of numbers: pydantic would read them as 1 and 0."""
        checked = handler(value)
        if info.field_name is not None and info.field_name in _numeric_fields(cls):
            for item in value if isinstance(value, list | tuple) else (value,):
                if isinstance(item, bool | np.bool_):
                    raise ValueError(f"{item} is not a number")
        return checked

    @classmethod
    def model_construct(cls, _fields_set: set[str] | None = None, **values: Any) -> Self:
        """As the constructor: compiled code relies on what is checked there."""
        return cls(**values)

    def __dir__(self) -> list[str]:
        """What the tab key offers: not the methods of every model, unless a field has the name."""
        fields = type(self).model_fields
        return sorted(name for name in super().__dir__() if name not in _OF_EVERY_MODEL or name in fields)


@lru_cache(maxsize=512)
def _numeric_fields(cls: type[BaseModel]) -> frozenset[str]:
    kinds = {name: set(_kinds(info.annotation)) for name, info in cls.model_fields.items()}
    return frozenset(name for name, of_field in kinds.items() if of_field & {int, float} and bool not in of_field)


def _kinds(annotation: Any) -> list[Any]:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _kinds(get_args(annotation)[0])
    if origin in (Union, types.UnionType, tuple, list):
        return [kind for part in get_args(annotation) for kind in _kinds(part)]
    return [annotation]


def explain(error: ValidationError, prefix: str = "") -> list[tuple[str, str]]:
    """Pydantic's error as ``(path, message)`` pairs in plain words."""
    problems = []
    for item in error.errors(include_url=False):
        path = ".".join(str(part) for part in (*([prefix] if prefix else []), *item["loc"]))
        message = item["msg"].removeprefix("Value error, ")
        value = item.get("input")
        if item["type"] == "extra_forbidden":
            message = "no such option"
        elif item["type"] == "missing":
            message = "is required"
        elif isinstance(value, int | float | str | bool):
            # many messages begin with the value already; that 0 is in "greater than 0" does not count
            begins = message.startswith((shown(value), f'"{value}"'))
            message = message if begins else f"{shown(value)}: {message}"
        problems.append((path, message))
    return problems


def in_lines(problems: Sequence[tuple[str, str]]) -> str:
    """``(path, message)`` pairs as one text."""
    return "; ".join(f"{path}: {message}" if path else message for path, message in problems)


def nearest(word: str, known: Sequence[str]) -> str:
    """``" (did you mean 'x'?)"`` when a known word is close, else nothing."""
    import difflib

    match = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f" (did you mean {match[0]!r}?)" if match else ""
