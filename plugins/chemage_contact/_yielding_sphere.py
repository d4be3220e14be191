"""A sphere on a half-space whose pressure is at most the hardness, in one dimension.

The pressure is the hardness up to a radius c and falls to zero at a; between them the gap is closed. As a sum of
uniformly loaded discs (K. L. Johnson, Contact Mechanics, section 3.4(a)) of radii s between c and a with the density
D(s) = -dp/ds, the slope of the surface is u'(r) = (4/πE*) ∫ D κ(r, s) ds, with κ = (E - K)(s/r) for s < r and (s/r) (E
- K)(r/s) beyond, of complete elliptic integrals. u' = -r/R on c … a determines D, which is infinite like the inverse
root at both ends: D ds = ψ dθ with r = middle + half·cos θ and a smooth ψ. κ = A ln|r - s| + B, the logarithm
integrated exactly for each Chebyshev polynomial, so that the error falls exponentially with the number of points.
Lengths are in units of a, pressures of E* a/R: then c/a alone is left, and the load determines it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chemage.plugin import algebra

Array = NDArray[np.float64]

#: points between c and a, radii of tables, and points of the quadrature for displacements
POINTS, RADII, FINE = 64, 1024, 384
#: 1 - c/a below which D is a step
THINNEST = 1e-9
#: F E*²/(H³ R²) where the largest pressure of Hertz is the hardness
ONSET = math.pi**3 / 6.0


@dataclass(frozen=True)
class Ring:
    """The solution for one c/a = 1 - 2·half, in units of a and E* a/R."""

    half: float
    coefficients: Array
    """of ψ in Chebyshev polynomials"""
    hardness: float
    load: float

    @classmethod
    def of(cls, width: float) -> Ring:
        """The solution for a - c = ``width`` · a."""
        from scipy import special

        half = 0.5 * width
        if width < THINNEST:
            hardness = (
                0.25
                * math.pi
                / (0.5 * math.log(2.0 / width) - 1.0 + 2.0 * math.log(2.0))
            )
            return cls(
                half, np.array([hardness / math.pi]), hardness, math.pi * hardness
            )
        order = np.arange(POINTS)
        theta = (order + 0.5) * math.pi / POINTS
        x = np.cos(theta)
        s = 1.0 - half + half * x
        apart = half * (x[:, None] - x)
        larger = np.maximum(s[:, None], s)
        rest = np.abs(apart) * (s[:, None] + s) / larger**2  # 1 - k²
        np.fill_diagonal(rest, 1.0)
        kappa = np.maximum(s[None, :] / s[:, None], 1.0) * (
            special.ellipe(1.0 - rest) - special.ellipkm1(rest)
        )
        factor = special.ellipe(1.0 - (s[None, :] / s[:, None]) ** 2) / math.pi
        np.fill_diagonal(apart, 1.0)
        smooth = kappa - factor * np.log(np.abs(apart))
        np.fill_diagonal(smooth, 1.0 - math.log(4.0) + 0.5 * np.log(2.0 / s))
        cosines = np.cos(np.outer(theta, order))
        logarithm = (
            -math.log(2.0)
            - 2.0
            * np.einsum("ik,jk->ij", cosines[:, 1:] / order[1:], cosines[:, 1:])
            + math.log(half)
        )
        weight = math.pi / POINTS
        psi = algebra.solve(
            weight * (factor * logarithm + smooth), -0.25 * math.pi * s
        )
        coefficients = 2.0 / POINTS * np.einsum("ij,i->j", cosines, psi)
        coefficients[0] *= 0.5
        return cls(
            half,
            coefficients,
            weight * float(psi.sum()),
            math.pi * weight * float(np.sum(psi * s**2)),
        )

    def pressure(self, r: Array) -> Array:
        """∫ D from r on."""
        theta = np.arccos(np.clip((r - 1.0 + self.half) / self.half, -1.0, 1.0))
        order = np.arange(1, self.coefficients.size)
        return self.coefficients[0] * theta + np.einsum(
            "...i,i->...",
            np.sin(theta[..., None] * order),
            self.coefficients[1:] / order,
        )

    def displacement(self, r: Array) -> Array:
        """u at radii r (n,), in units of a²/R: u = (4 s/π) E(r/s) inside a disc, and beyond it with K (Johnson)."""
        from scipy import special

        theta = (np.arange(FINE) + 0.5) * math.pi / FINE
        s = 1.0 - self.half + self.half * np.cos(theta)
        density = np.einsum(
            "ij,j->i",
            np.cos(np.outer(theta, np.arange(self.coefficients.size))),
            self.coefficients,
        ) * (math.pi / FINE)
        inner, outer = np.minimum(r[:, None], s), np.maximum(r[:, None], s)
        rest = np.abs(r[:, None] - s) * (inner + outer) / outer**2
        second = rest * special.ellipkm1(
            np.maximum(rest, 1e-300)
        )  # finite where it is multiplied by zero
        values = special.ellipe(1.0 - rest) - np.where(r[:, None] > s, second, 0.0)
        return (4.0 / math.pi) * np.einsum("ij,j->i", outer * values, density)


@dataclass(frozen=True)
class YieldingSphere:
    """The contact of a sphere; lengths in nm, pressures in GPa."""

    ring: Ring
    edge: float
    """a"""
    core: float
    """c"""
    hardness: float
    radius: float
    approach: float

    def pressure(self, r: Array) -> Array:
        """At distances r from the apex."""
        inside = np.clip(r / self.edge, 1.0 - 2.0 * self.ring.half, 1.0)
        found = np.zeros(r.shape)
        between = (r > self.core) & (r < self.edge)
        found[between] = self.ring.pressure(inside[between]) * (
            self.hardness / self.ring.hardness
        )
        found[r <= self.core] = self.hardness
        return np.minimum(found, self.hardness)

    def gap(self, r: Array) -> Array:
        """u - approach + r²/2R: negative by the plastic displacement where the sphere yields, 0 up to the edge."""
        shape, x = r.shape, np.ravel(r) / self.edge
        core, level = (
            self.core / self.edge,
            self.approach * self.radius / self.edge**2,
        )
        found = np.zeros(x.size)
        # finer towards c and a, where the gap begins
        towards = np.linspace(1.0, 0.0, RADII) ** 2
        for where, table in (
            (x < core, core * (1.0 - towards)),
            (
                x > 1.0,
                1.0 + max(float(x.max(initial=1.0)) - 1.0, 0.0) * towards[::-1],
            ),
        ):
            if where.any():
                u = self.ring.displacement(table) - level + 0.5 * table**2
                found[where] = np.interp(x[where], table, u)
        return found.reshape(shape) * (self.edge**2 / self.radius)


def yielding_sphere(
    load: float, radius: float, modulus: float, hardness: float
) -> YieldingSphere | None:
    """The contact under ``load`` (nN > 0); None where the largest pressure of Hertz is not above the hardness."""
    from scipy import optimize

    ratio = modulus / hardness
    wanted = load / hardness / radius / radius * ratio * ratio
    if wanted <= ONSET:
        return None

    def excess(depth: float) -> float:
        ring = Ring.of(math.exp(-depth))
        return math.log(ring.load / ring.hardness**3 / wanted)

    deepest = -math.log(THINNEST)
    if math.isfinite(wanted) and excess(deepest) > 0.0:
        first = 1e-6
        depth: Any = (
            optimize.brentq(excess, first, deepest, xtol=1e-14)
            if excess(first) < 0.0
            else first
        )
        ring = Ring.of(math.exp(-depth))
        edge = math.sqrt(load / hardness * ring.hardness / ring.load)
    else:
        size = math.sqrt(math.pi / wanted) if wanted > 0.0 else 0.0
        ring = Ring(0.0, np.array([size / math.pi]), size, math.pi * size)
        edge = math.sqrt(load / hardness / math.pi)
    rim = float(ring.displacement(np.ones(1))[0]) + 0.5
    core = edge * (1.0 - 2.0 * ring.half)
    return YieldingSphere(
        ring, edge, core, hardness, radius, rim * edge**2 / radius
    )
