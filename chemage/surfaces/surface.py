"""The surface: heights on a pixel grid, and what theories of contact need of it instead, its roughness."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from chemage.foundation.checks import MOST_BINS, checked_count
from chemage.foundation.codec import dataset, map_frame
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import Observing
from chemage.foundation.records import (
    Named,
    Number,
    Plain,
    PositiveNumber,
    Reals,
    Record,
    require_finite,
)
from chemage.foundation.result import draw_result, notebook_html
from chemage.surfaces import roughness

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: nm; and of heights over the pixel size
LARGEST_HEIGHT, LARGEST_RATIO = 1e300, 1e305


class PixelMap:
    """A record whose first array is a map on square pixels."""

    if TYPE_CHECKING:
        arrays: ClassVar[dict[str, tuple[tuple[str, ...], str, str]]]
        pixel_size: float

    @property
    def _first(self) -> np.ndarray:
        return getattr(self, next(iter(self.arrays)))

    @property
    def shape(self) -> tuple[int, int]:
        """(nx, ny) pixels."""
        nx, ny = self._first.shape
        return nx, ny

    @property
    def nominal_area(self) -> float:
        """A0, nm²."""
        return self._first.size * self.pixel_size**2

    @property
    def missed_peak(self) -> float:
        """By how much the largest value may be exceeded between two pixels: of the parabola through its neighbours."""
        values = self._first
        place = np.unravel_index(int(values.argmax()), values.shape)
        peak, missed = float(values[place]), 0.0
        for axis in (0, 1):
            line = np.take(values, place[1 - axis], 1 - axis)
            around = line[[place[axis] - 1, (place[axis] + 1) % line.size]]
            missed += max(2 * peak - float(around.sum(dtype=np.float64)), 0.0) / 8
        return missed

    def coordinates(self) -> dict[str, np.ndarray]:
        """Centres of the pixels along ``x`` and ``y``, nm."""
        return {
            name: (np.arange(n) + 0.5) * self.pixel_size
            for name, n in zip("xy", self.shape, strict=True)
        }

    def to_pandas(self) -> pandas.DataFrame:
        """The map, one row for each x and one column for each y, both in nm. Needs pandas."""
        name = next(iter(self.arrays))
        return map_frame(
            self._first, self.coordinates(), name, self.arrays[name][1]
        )


class Surface(PixelMap, Observing, Record):
    """A rough (or spherical) body, given by its heights on a pixel grid."""

    arrays = {
        "heights": (("x", "y"), "nm", "height, higher = nearer to the counter-body")
    }
    added = ("observables", "outputs")

    heights: Reals
    """(nx, ny) nm, higher = nearer to the counter-body; float64, or float32 as given"""
    pixel_size: PositiveNumber
    """edge of a pixel, nm"""
    periodic: bool = True
    """whether the grid repeats"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""
    observables: Named = {}
    """name -> what was recorded on the way to this, see :class:`chemage.plugin.Output`"""
    outputs: dict[str, dict[str, Any]] = {}
    """the same names -> dims, unit and description"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.heights.ndim != 2 or self.heights.size == 0:
            raise ValueError(
                f"heights: shape {self.heights.shape}; give a two-dimensional, non-empty array (nx, ny)"
            )
        require_finite("heights", self.heights, "fill or crop missing data first")
        largest = max(
            abs(float(self.heights.max())), abs(float(self.heights.min()))
        )
        if largest > LARGEST_HEIGHT:
            raise ValueError(
                f"heights: up to {largest:g} nm, out of range; give heights in nm"
            )
        if largest / self.pixel_size > LARGEST_RATIO:
            raise ValueError(
                f"heights: up to {largest:g} nm on pixels of {self.pixel_size:g} nm, slopes are out of range; "
                "give heights and pixel_size in nm"
            )
        return self

    @cached_property
    def rms_height(self) -> float:
        """Root mean square height about the mean, nm."""
        return roughness.rms_height(self.heights)

    @cached_property
    def rms_slope(self) -> float:
        """Root mean square slope h'_rms, see :func:`chemage.plugin.roughness.rms_slope`."""
        return roughness.rms_slope(self.heights, self.pixel_size, self.periodic)

    def psd(self, bins: int = 60) -> tuple[np.ndarray, np.ndarray]:
        """Radially averaged power spectral density, mean square height = ∫C d²q/(2π)²: q (1/nm) and C(q) (nm⁴).

        See :func:`chemage.surfaces.roughness.psd`; a surface that is not periodic is tapered with a Hann window.
        """
        try:
            count = checked_count("bins", bins, most=MOST_BINS)
            waves, density = roughness.psd(
                self.heights, self.pixel_size, self.periodic, count
            )
        except OverflowError:
            density = waves = np.array([np.inf])
        if not np.isfinite(density).all():
            raise InputError(
                f"heights: the power spectral density of {self!r} is out of the range of numbers; rescale"
            )
        return waves, density

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the map of the heights into ``ax``, or into a new figure of pyplot; return the axes."""
        return draw_result(self, ax)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays with the names, dimensions and units of the file, x and y in nm. Needs xarray."""
        return dataset(self)

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def __repr__(self) -> str:
        nx, ny = self.shape
        return f"<Surface {nx}x{ny} pixels of {self.pixel_size:g} nm, rms height {self.rms_height:.4g} nm>"

    __str__ = __repr__


class Roughness(Record):
    """The roughness of a surface that need not exist as a map."""

    rms_slope: Number
    """h'_rms"""
    nominal_area: PositiveNumber
    """nm²"""
    rms_height: float = math.nan
    """nm; nan where it is not known"""
    provenance: Plain = {}
    """how the surface would be made: plain JSON values"""

    @classmethod
    def of(cls, surface: Surface) -> Roughness:
        """The roughness of a surface that is there."""
        return cls(
            rms_slope=surface.rms_slope,
            nominal_area=surface.nominal_area,
            rms_height=surface.rms_height,
            provenance=surface.provenance,
        )
