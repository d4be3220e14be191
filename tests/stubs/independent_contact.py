"""Contacts evaluated and solved independently of the project: in double precision, from heights and pressure alone.

Only numpy is used, and the Green's functions are written down again. ``evaluate`` measures how well a pressure
satisfies the contact conditions; ``dense_solution`` solves small contacts exactly with active sets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Body:
    """An elastic body: periodic half-space, layer of ``thickness`` nm, or free half-space."""

    modulus: float
    pixel: float
    periodic: bool = True
    thickness: float | None = None
    poisson: float = 0.25

    def displacement(self, p: np.ndarray) -> np.ndarray:
        """Displacement (nx, ny) in nm under a pressure in GPa; its mean is left out where the body is periodic."""
        if self.periodic:
            return np.fft.irfft2(np.fft.rfft2(p - p.mean()) * self.symbol(p.shape), s=p.shape)
        nx, ny = p.shape
        kernel = np.zeros((2 * nx, 2 * ny))
        i, j = (np.concatenate([np.arange(n), [0], np.arange(1, n)[::-1]]) for n in (nx, ny))
        kernel[:] = self._love(nx, ny)[np.ix_(i, j)]
        u = np.fft.irfft2(np.fft.rfft2(p, s=kernel.shape) * np.fft.rfft2(kernel), s=kernel.shape)
        return u[:nx, :ny] / self.modulus

    def symbol(self, shape: tuple[int, ...]) -> np.ndarray:
        """u(q)/p(q) in nm/GPa on the half spectrum, 0 at q = 0."""
        qx = 2 * np.pi * np.fft.fftfreq(shape[0], self.pixel)
        qy = 2 * np.pi * np.fft.rfftfreq(shape[1], self.pixel)
        q = np.hypot(qx[:, None], qy)
        q[0, 0] = 1.0
        symbol = 2 / (self.modulus * q)
        if self.thickness is not None:
            symbol = symbol * _layer(2 * q * self.thickness, self.poisson)
        symbol[0, 0] = 0.0
        return symbol

    def uniform(self) -> float:
        """Displacement of a layer under a uniform unit pressure, nm/GPa."""
        if self.thickness is None:
            return 0.0
        return self.thickness * (1 - 2 * self.poisson) / (1 - self.poisson) ** 2 / self.modulus

    def matrix(self, shape: tuple[int, int]) -> np.ndarray:
        """The operator as a dense matrix, one loaded pixel after the other."""
        columns = []
        for k in range(shape[0] * shape[1]):
            p = np.zeros(shape)
            p.flat[k] = 1.0
            columns.append(self.displacement(p).ravel())
        return np.stack(columns, axis=1)

    def _love(self, nx: int, ny: int) -> np.ndarray:
        """u·E* in nm at pixel distances 0 … nx - 1, 0 … ny - 1 from a loaded square pixel (Johnson, Eq. 3.25)."""
        x, y = (np.arange(nx) * self.pixel)[:, None], np.arange(ny) * self.pixel
        total = np.zeros((nx, ny))
        for sx in (-0.5, 0.5):
            for sy in (-0.5, 0.5):
                a, b = x + sx * self.pixel, y + sy * self.pixel
                total += 4 * sx * sy * (a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b)))
        return total / np.pi


def _layer(x: np.ndarray, nu: float) -> np.ndarray:
    """Symbol of a bonded layer over that of the half-space; x = 2·q·thickness (Carbone & Mangialardi 2008)."""
    y = np.minimum(x, 300.0)  # beyond, both hyperbolic functions are the same number
    series = sum(y ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(1, 9))
    difference = np.where(y < 1.0, series, np.sinh(y) - y)
    numerator = (2 - 4 * nu) * y + (3 - 4 * nu) * difference
    return numerator / (5 - 4 * nu * (3 - 2 * nu) + 0.5 * y**2 + (3 - 4 * nu) * np.cosh(y))


@dataclass(frozen=True)
class Errors:
    """How far a pressure is from satisfying the contact conditions; lengths in nm."""

    rms_gap: float
    """over the contact"""
    penetration: float
    """largest one outside the contact"""
    approach: float
    """since first touch"""
    rms_height: float
    load: float
    """nN"""
    rounding: float
    """of the evaluation itself: of the displacement and of the pressures in it"""

    @property
    def error(self) -> float:
        """The larger one, relative to the rms height or to the approach since first touch, if that is smaller."""
        scale = self.rms_height if self.rms_height > 0 else np.inf
        scale = min(scale, self.approach) if self.approach > 0 else scale
        return max(self.rms_gap, self.penetration) / scale if np.isfinite(scale) else 0.0


def evaluate(body: Body, heights: np.ndarray, pressure: np.ndarray, approach: float | None = None) -> Errors:
    """Errors of a pressure (GPa) on heights (nm); with ``approach`` (nm) the offset of the gap is prescribed."""
    p = pressure.astype(np.float64)
    h = heights.astype(np.float64)
    h = h - h.max()
    u = body.displacement(p)
    inside = p > 0
    gap = u - h
    offset = -float(gap[inside].mean()) if approach is None else -approach
    gap += offset
    found = body.uniform() * float(p.mean()) - offset
    rms = float(np.sqrt(np.mean(gap[inside] ** 2)))
    deepest = float(max(0.0, -gap[~inside].min(initial=0.0)))
    point = np.zeros_like(p)
    point[0, 0] = 1.0
    response = float(np.linalg.norm(body.displacement(point)))
    noise = 1e-15 * (response * float(np.sqrt(np.mean((p - p.mean() * body.periodic) ** 2))) + abs(offset))
    return Errors(rms, deepest, found, float(h.std()), float(p.sum()) * body.pixel**2, noise)


def dense_solution(matrix: np.ndarray, heights: np.ndarray, mean: float) -> np.ndarray:
    """Pressure (n,) with the given mean from the dense operator, by active sets with a direct solve for each.

    Starts from the highest pixel and adds the pixel that penetrates most, like a loading test.
    """
    h = heights.ravel() - heights.max()
    n = h.size
    inside = np.zeros(n, bool)
    inside[int(np.argmax(h))] = True
    for _ in range(20 * n):
        while True:
            index = np.flatnonzero(inside)
            system = np.ones((index.size + 1, index.size + 1))
            system[:-1, :-1] = matrix[np.ix_(index, index)]
            system[-1, -1] = 0
            # scaled so that the direct solve is well conditioned at any load
            unit = float(np.abs(np.diag(matrix)).max())
            system[:-1, :-1] /= unit
            solution = np.linalg.solve(system, np.append(h[index] / unit, mean * n))
            if solution[:-1].min() > 0:
                break
            inside[index[solution[:-1] <= 0]] = False
        p = np.zeros(n)
        p[index] = solution[:-1]
        gap = matrix @ p - h + solution[-1] * unit
        gap[inside] = 0
        worst = int(np.argmin(gap))
        if gap[worst] > -1e-13 * max(float(np.abs(h).max()), 1e-300):
            return p.reshape(heights.shape)
        inside[worst] = True
    raise AssertionError("the dense solver does not settle")
