"""What the surface makers share: the grid option, and the record of how a surface was made."""

from __future__ import annotations

import operator
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

import chemage
from chemage.spec import Seed, SurfaceMaker

#: pixels of the longest grid this accepts; a square one of that size has 2**34 pixels, 128 GiB of heights
LONGEST = 2**17


def _grid(value: Any) -> tuple[int, int]:
    sides: tuple[Any, ...] = tuple(value) if isinstance(value, list | tuple | np.ndarray) else (value, value)
    try:
        if any(isinstance(side, bool) for side in sides):
            raise TypeError
        counts = [
            int(side) if isinstance(side, float) and side.is_integer() else operator.index(side) for side in sides
        ]
    except TypeError:
        raise ValueError("give a whole number of pixels, or two: [nx, ny]") from None
    if len(counts) != 2:
        raise ValueError(f"{value!r}: give one whole number, or two: [nx, ny]")
    if min(counts) < 1 or max(counts) > LONGEST:
        raise ValueError(f"a grid of {counts[0]} x {counts[1]} pixels; give 1 to {LONGEST} on a side")
    return counts[0], counts[1]


#: (nx, ny), from one number (a square) or two
Pixels = Annotated[tuple[int, int], BeforeValidator(_grid, json_schema_input_type=int | tuple[int, int])]


def provenance(maker: SurfaceMaker, seed: Seed | None = None) -> dict[str, Any]:
    """How a surface was made, in plain JSON values; ``seed`` only where the maker draws random numbers."""
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
