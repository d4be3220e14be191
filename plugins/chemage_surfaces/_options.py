"""The grid option and the provenance record of the surface makers."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from pydantic import BeforeValidator

import chemage
from chemage.plugin import Seed, SurfaceMaker

#: pixels of the largest grid: no machine holds its heights, but theories of contact need none
MOST_PIXELS = 2**43


def _count(side: Any) -> int:
    if isinstance(side, bool):
        raise TypeError
    # 2.5e3 is a whole number, too
    if isinstance(side, float):
        if not side.is_integer():
            raise TypeError
        return int(side)
    return operator.index(side)


def _grid(value: Any) -> tuple[int, int]:
    try:
        sides = tuple(value) if isinstance(value, list | tuple | np.ndarray) else (value, value)
        counts = [_count(side) for side in sides]
    except TypeError:
        raise ValueError("give a whole number of pixels, or two: [nx, ny]") from None
    if len(counts) != 2:
        raise ValueError(f"{len(counts)} numbers; give one whole number of pixels, or two: [nx, ny]")
    if min(counts) < 1:
        raise ValueError(f"a grid of {counts[0]} x {counts[1]} pixels is empty; give at least 1")
    if counts[0] * counts[1] > MOST_PIXELS:
        raise ValueError(
            f"a grid of {counts[0]} x {counts[1]} pixels is too large for the memory; give at most {MOST_PIXELS}"
        )
    return counts[0], counts[1]


#: (nx, ny), from one number (a square) or two
if TYPE_CHECKING:
    Pixels: TypeAlias = Any  # to a type checker, so that one number can be given
else:
    Pixels = Annotated[tuple[int, int], BeforeValidator(_grid, json_schema_input_type=int | tuple[int, int])]


def provenance(maker: SurfaceMaker, seed: Seed | None = None) -> dict[str, Any]:
    """Record how a surface was made, as plain JSON values; with ``seed`` if the maker draws random numbers."""
    options = maker.todict()
    record: dict[str, Any] = {"kind": options.pop("kind"), "options": options, "chemage": chemage.__version__}
    if isinstance(seed, np.random.SeedSequence):
        entropy = seed.entropy
        record["seed"] = {
            "entropy": [int(word) for word in entropy] if isinstance(entropy, list | tuple | np.ndarray) else entropy,
            "spawn_key": [int(word) for word in seed.spawn_key],
        }
    elif seed is not None:
        record["seed"] = int(seed)
    return record
