"""Measures of an image as it is: along both axes and scale by scale, also where heights are missing or pixels oblong.

They need no model of the surface. Lengths are in nm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import compress, zip_longest

import numpy as np

from chemage import InputError
from chemage_surfaces._maps import Floats

#: longest distance, of the side of the image
LONGEST = 0.25
#: A tip of radius R rounds peaks and sharpens valleys. With x = R times the rms second difference over half a
#: wavelength, it takes LOWERED[0] x + LOWERED[1] x² off the logarithm of the density, and the second differences have
#: the skewness SKEWED x; calibrated on self-affine surfaces dilated by paraboloids (H .5 to .9, rms slopes .05 to .5),
#: where the first holds to 35 % and the second to 50 %
LOWERED, SKEWED = (0.6, 4.0), 0.9
#: waves are used up to this x
MOST_TIP = 0.15
#: skewness between which a radius is estimated, and the largest that is one of a tip, nm
TIP_SKEWNESS, MOST_SKEWNESS, LARGEST_TIP = 0.04, 0.5, 1000.0


@dataclass(frozen=True, eq=False)
class Profile:
    """What changes over a distance along one axis, from all pairs and triples of heights that are there."""

    #: distances, nm, whole pixels
    distance: Floats
    #: rms of h(x + d) − h(x), nm: the height-difference function
    difference: Floats
    #: rms of h(x + d) − 2 h(x) + h(x − d) about its mean, divided by d², 1/nm
    curvature: Floats
    #: skewness of these second differences; nan where there are none
    skewness: Floats
    #: how many of them are independent, about
    independent: Floats

    @classmethod
    def along(cls, heights: Floats, side: float, scale: float) -> Profile:
        """Along the first axis of heights in units of ``scale``."""
        count = len(heights)
        most = max(int(LONGEST * count), 1)
        lags = sorted(
            lag
            for k in range(64)
            for lag in (2**k, 3 * 2**k)
            if lag <= most and lag < count
        )
        rows = []
        for lag in lags:
            first = heights[lag:] - heights[:-lag]
            second = first[lag:] - first[:-lag]
            first, second = first[np.isfinite(first)], second[np.isfinite(second)]
            rms = (
                math.sqrt(float(np.mean(np.square(first))))
                if first.size
                else math.nan
            )
            if second.size:
                second = second - second.mean()
                square = float(np.mean(np.square(second)))
                skewness = (
                    float(np.mean(second**3)) / square**1.5
                    if square > 0
                    else math.nan
                )
                curvature = math.sqrt(square) / (lag * side) ** 2 * scale
            else:
                skewness = curvature = math.nan
            rows.append(
                (
                    lag * side,
                    rms * scale,
                    curvature,
                    skewness,
                    second.size / (2.0 * lag) ** 2,
                )
            )
        columns = np.array(rows, dtype=np.float64).reshape(len(rows), 5).T
        return cls(*columns)

    @property
    def slope(self) -> Floats:
        """rms slope over each distance."""
        return self.difference / self.distance


@dataclass(frozen=True, eq=False)
class Measures:
    """Measures of an image, nan where there are too few heights."""

    shape: tuple[int, int]
    #: edges of a pixel, nm
    sides: tuple[float, float]
    #: heights that are missing
    missing: int
    #: about the mean, nm
    rms_height: float
    #: root mean square of the gradient, from differences over a pixel, where all three heights are there
    rms_slope: float
    x: Profile
    y: Profile

    @classmethod
    def of(cls, heights: Floats, sides: tuple[float, float]) -> Measures:
        """Measures of heights (nx, ny) in nm, nan where they are missing, on pixels of ``sides``.

        Raises
        ------
        InputError
            All heights are missing.
        """
        there = np.isfinite(heights)
        if not there.any():
            raise InputError("heights: all of them are missing")
        middle = float(heights[there].mean())
        # so that neither the unit nor a large mean spoils a sum of squares
        scale = float(np.abs(heights[there] - middle).max()) or 1.0
        scaled = (heights - middle) / scale
        nx, ny = heights.shape
        along_x = np.diff(scaled, axis=0)[:, :-1] / sides[0]
        squared = along_x**2 + (np.diff(scaled, axis=1)[:-1] / sides[1]) ** 2
        squared = squared[np.isfinite(squared)]
        return cls(
            shape=(nx, ny),
            sides=sides,
            missing=int(heights.size - there.sum()),
            rms_height=scale * math.sqrt(float(np.mean(np.square(scaled[there])))),
            rms_slope=scale * math.sqrt(float(squared.mean()))
            if squared.size
            else math.nan,
            x=Profile.along(scaled, sides[0], scale),
            y=Profile.along(scaled.T, sides[1], scale),
        )

    def tip_radius(self) -> float:
        """Radius (nm) of the tip that leaves valleys as much sharper than peaks as they are along x; 0 if they are not
        (four standard errors of the skewness), or at all distances, or as those of no tip, as on scratches.

        White noise makes it smaller.
        """
        profile = self.x
        error = np.sqrt(6 / np.maximum(profile.independent, 1.0))
        skewed = profile.skewness > np.maximum(TIP_SKEWNESS, 4 * error)
        ends = np.nonzero(~skewed)[0]
        seen = np.arange(len(skewed)) < (ends[0] if ends.size else 0)
        # where it is small it is proportional to the radius, and where it is smallest it is noise
        weak = seen & (profile.skewness < MOST_SKEWNESS)
        if not weak.any():
            return 0.0
        weak &= profile.skewness > 0.5 * profile.skewness[weak].max()
        radius = float(
            np.median(profile.skewness[weak] / (SKEWED * profile.curvature[weak]))
        )
        return radius if radius <= LARGEST_TIP else 0.0

    def tip_share(self, radius: float, q: Floats) -> Floats:
        """What a tip of ``radius`` (nm) takes off the logarithm of the density at wavenumbers ``q`` (1/nm); infinite
        where it takes too much to be corrected."""
        distance, curvature = self.x.distance, self.x.curvature
        x = radius * np.exp(
            np.interp(
                np.log(math.pi / q),
                np.log(distance),
                np.log(np.maximum(curvature, 1e-300)),
            )
        )
        return np.where(x <= MOST_TIP, LOWERED[0] * x + LOWERED[1] * x**2, math.inf)

    def text(self) -> str:
        """The measures, one line each, and a table by distance."""
        lines = [
            f"pixels              {self.shape[0]} x {self.shape[1]} of {self.sides[0]:.4g} x {self.sides[1]:.4g} nm"
            + (f", {self.missing} heights are missing" if self.missing else ""),
            f"rms height          {self.rms_height:.4g} nm",
            f"rms slope           {_number(self.rms_slope)}, of the gradient over a pixel",
        ]
        for name, unit in (("slope", ""), ("curvature", " 1/nm")):
            each = (getattr(axis, name) for axis in (self.x, self.y))
            first = " and ".join(
                _number(values[0]) if len(values) else "not available"
                for values in each
            )
            lines.append(
                f"{'profile ' + name:<19} {first}{unit} along x and y, rms over a pixel"
            )
        lines += [
            "",
            "distance (nm)       rms difference (nm)    profile slope          profile curvature (1/nm)",
            "along x and y       x          y           x          y           x          y",
        ]
        names = ("distance", "difference", "slope", "curvature")
        columns = [
            getattr(axis, name) for name in names for axis in (self.x, self.y)
        ]
        longest = max(self.x.distance, self.y.distance, key=len)
        # distances that are a power of two times the first one
        wanted = np.log2(longest / longest[:1]) % 1 == 0
        for row in compress(zip_longest(*columns, fillvalue=math.nan), wanted):
            x, y, *others = map(_number, row)
            lines.append(
                ("{:20}" + 3 * "{:10} {:11} ").format(f"{x} {y}", *others).rstrip()
            )
        return "\n".join(lines)


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"
