"""What ``dir`` lists of an object, and so what the tab key offers: not the methods that every pydantic model has."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import BaseModel

_OF_EVERY_MODEL = {name for name in dir(BaseModel) if not name.startswith("_")}


def without_noise(cls: type[BaseModel], names: Iterable[str]) -> list[str]:
    """``names`` of an instance of ``cls`` without those of every model, unless a field of it has the name."""
    return sorted(name for name in names if name not in _OF_EVERY_MODEL or name in cls.model_fields)
