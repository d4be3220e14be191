"""Differences between scenes, field by field."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Difference:
    """A field whose value differs between results; ``values`` in the order of the results, None where it is absent."""

    path: str
    values: tuple[Any, ...]


def differences(flats: Sequence[Mapping[str, Any]]) -> list[Difference]:
    """Find the fields that differ between flat mappings of dotted path -> value."""
    paths = dict.fromkeys(path for flat in flats for path in flat)
    found = [Difference(path, tuple(flat.get(path) for flat in flats)) for path in paths]
    return [one for one in found if not all(_same(one.values[0], value) for value in one.values[1:])]


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, float | int) and isinstance(b, float | int) and not isinstance(a, bool):
        return math.isclose(a, b, rel_tol=1e-9)
    return a == b
