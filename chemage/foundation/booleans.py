"""True and False are no numbers: pydantic would read them as 1 and 0."""

from __future__ import annotations

import types
from functools import lru_cache
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ValidationInfo, ValidatorFunctionWrapHandler


def no_booleans(cls: type[BaseModel], value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
    """Refuse True and False, also in a list, in a field of numbers that the field itself lets pass."""
    made = handler(value)
    if info.field_name is not None and info.field_name in _numeric_fields(cls):
        items = value if isinstance(value, list | tuple) else (value,)
        for item in items:
            if isinstance(item, bool | np.bool_):
                raise ValueError(f"{item} is not a number")
    return made


@lru_cache(maxsize=512)
def _numeric_fields(cls: type[BaseModel]) -> frozenset[str]:
    return frozenset(name for name, info in cls.model_fields.items() if _is_numeric(info.annotation))


def _is_numeric(annotation: Any) -> bool:
    kinds = set(_kinds(annotation))
    return bool(kinds & {int, float}) and bool not in kinds


def _kinds(annotation: Any) -> list[Any]:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _kinds(get_args(annotation)[0])
    if origin in (Union, types.UnionType, tuple, list):
        return [kind for part in get_args(annotation) for kind in _kinds(part)]
    return [annotation]
