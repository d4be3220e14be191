"""Persson's theory: area of contact and distribution of the pressure from the rms slope alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from chemage import ContactModulus, ContactStatistics, ContactTheory, InputError, Roughness, theory
from chemage_contact._references import MANNERS, PERSSON

#: classes of pressure, and standard deviations beyond the mean pressure up to which they reach
CLASSES, REACH = 512, 8.0
#: largest relative error of the contact area, measured (``tests/benchmarks/persson_errors.py``)
LARGEST_ERROR = 0.32

_SMOOTH = (
    "contact 'persson' is a theory of randomly rough surfaces, and this surface is a sphere; use contact 'hertz' or "
    "'fft-bem'"
)


class Persson(ContactTheory):
    """Persson's theory of the contact of a Gaussian surface with an elastic half-space, without a solve.

    As roughness is added to a flat body in full contact, the pressure diffuses from the nominal pressure p̄; it is
    absorbed at zero pressure, where contact is lost. Over the nominal area the density of p > 0 is the difference of
    two Gaussians of mean ±p̄ and variance (E* h'_rms/2)², and A/A0 = erf(√2 p̄/(E* h'_rms)). At small loads the area
    is proportional to the load, with κ = √(8/π) = 1.60 where solutions have 2.1 to 2.3, so that area is too small and
    pressure too high. It has no patches and no rim. B. N. J. Persson, J. Chem. Phys. 115, 3840 (2001); W. Manners,
    J. A. Greenwood, Wear 261, 600 (2006).
    """

    kind = "persson"
    declared_error: ClassVar[float | None] = LARGEST_ERROR
    cite: ClassVar[tuple[str, ...]] = (
        "B. N. J. Persson, J. Chem. Phys. 115, 3840 (2001)",
        "W. Manners, J. A. Greenwood, Wear 261, 600 (2006)",
    )
    bibtex: ClassVar[tuple[str, ...]] = (PERSSON, MANNERS)

    modulus: ContactModulus
    """contact modulus E* = E/(1−ν²) of the elastic body (or of both, combined), GPa; or their young
    and poisson"""
    kappa: float | None = Field(default=None, ge=1, le=4)
    """calibrated area–load coefficient κ = A h'_rms E*/F_N at small loads, such as that of a solved contact of the same
    spectrum: the rms slope in the theory is multiplied by √(8/π)/κ; default: that of the theory, √(8/π) = 1.60"""

    def expected(self, surface: Mapping[str, float], load: float) -> dict[str, float]:
        """Area fraction where the rms slope is known; time and memory, which are those of nothing."""
        found = {"cpu_seconds": 0.01, "bytes": 1e6, "gap_bytes": 0.0}
        if not {"nx", "ny", "pixel_size", "rms_slope"} <= surface.keys():
            return found
        area = surface["nx"] * surface["ny"] * surface["pixel_size"] ** 2
        slope = surface["rms_slope"] * self.modulus * self._factor
        fraction = theory.persson_area_fraction(load / area / slope) if slope > 0 else float(load > 0)
        return {**found, "area_fraction": float(fraction)}

    def check(self, surface: Mapping[str, float], load: float) -> None:
        """See :meth:`chemage.ContactSolver.check`."""
        if "radius" in surface:
            raise InputError(_SMOOTH)

    @property
    def _factor(self) -> float:
        """By which the rms slope is multiplied."""
        return 1.0 if self.kappa is None else math.sqrt(8 / math.pi) / self.kappa

    def _statistics(self, roughness: Roughness, load: float) -> ContactStatistics:
        if "radius" in roughness.provenance:
            raise InputError(_SMOOTH)
        mean, sigma = load / roughness.nominal_area, 0.5 * self.modulus * roughness.rms_slope * self._factor
        pressure, share = _classes(mean, sigma)
        return ContactStatistics(
            pressure=pressure,
            area=share * roughness.nominal_area,
            load=load,
            nominal_area=roughness.nominal_area,
            modulus=self.modulus,
            rms_slope=roughness.rms_slope,
            rms_height=roughness.rms_height,
            notes=(
                "the contact is that of Persson's theory: no map, no patches, no rim, which leaves out 0.3 to 6 % of "
                "the bonds of sites that interact"
                + ("" if self.kappa is None else f"; calibrated to an area–load coefficient of {self.kappa:g}"),
            ),
            provenance={
                "kind": self.kind,
                "options": {name: value for name, value in self.identity().items() if name != "kind"},
                "surface": roughness.provenance,
            },
        )


def _classes(mean: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean pressure of each class, GPa, and its share of the nominal area."""
    if not mean > 0:
        return np.zeros(0), np.zeros(0)
    if sigma <= 1e-12 * mean:
        return np.array([mean]), np.array([1.0])
    edges = np.linspace(max(mean - REACH * sigma, 0.0), mean + REACH * sigma, CLASSES + 1)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = 0.5 * np.diff(edges)
    points = 0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * nodes
    # the density of the theory for a modulus of 2 GPa and a slope of sigma
    density = theory.persson_pressure_density(points, mean, 2.0, sigma) * (half[:, None] * weights)
    share = density.sum(axis=1)
    there = share > 0
    pressure = (density * points).sum(axis=1)[there] / share[there]
    total = float(pressure @ share[there])
    # what is beyond the last class, 1e-14 of the load, is distributed in proportion
    return pressure * (mean / total) if math.isfinite(total) and total > 0 else pressure, share[there]
