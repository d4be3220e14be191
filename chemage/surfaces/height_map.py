"""Heights as a file holds them, before anything is done to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage.foundation.errors import InputError


@dataclass(frozen=True, eq=False)
class HeightMap:
    """An image as its file holds it: heights may be missing, pixels may have two sides, units may be unknown.

    A :class:`chemage.Surface` has none of these; steps that the user chooses lead from one to the other.
    """

    #: (nx, ny), float32 or float64, higher = nearer to the counter-body; nan where a height is missing
    heights: np.ndarray
    #: nm per unit of the heights; None: the file does not state it
    height_unit: float | None
    #: edges of a pixel along x and y, nm; None: the file does not state them
    pixel_size: tuple[float, float] | None
    #: whether the file says that the image repeats
    periodic: bool = False
    #: what to call the file in messages
    source: str = "the file"
    #: what else identifies the image, such as its format and channel: plain JSON values
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        heights = self.heights
        if not isinstance(heights, np.ndarray) or heights.dtype.kind != "f":
            raise InputError.of("heights", type(heights).__name__, "is no array of real numbers")
        if heights.ndim != 2 or heights.size == 0:
            raise InputError(
                f"{self.source} holds an array of shape {heights.shape}; an image has two dimensions (nx, ny)"
            )
        sizes = (*(self.pixel_size or ()), *(() if self.height_unit is None else (self.height_unit,)))
        if not all(np.isfinite(size) and size > 0 for size in sizes):
            raise InputError(
                f"{self.source} states pixels of {self.pixel_size} nm and a height unit of {self.height_unit} nm; "
                "both must be above 0: give pixel_size and height_unit"
            )
