"""What is measured on surfaces and contacts, as plain functions of arrays.

Lengths in nm, pressures in GPa. Contact is where the pressure is positive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

# -- surfaces ---------------------------------------------------------------------------------------------------------


def wavenumbers(shape: tuple[int, int], pixel_size: float) -> tuple[np.ndarray, np.ndarray]:
    """Angular wavenumbers (1/nm) of the half spectrum: qx (nx, 1) and qy (1, ny//2 + 1)."""
    nx, ny = shape
    qx = 2 * np.pi * np.fft.fftfreq(nx, pixel_size)[:, None]
    qy = 2 * np.pi * np.fft.rfftfreq(ny, pixel_size)[None, :]
    return qx, qy


def _power(heights: np.ndarray) -> np.ndarray:
    """|h_q|² (nm²) of the half spectrum, each mode counted with its conjugate: the sum is the height variance."""
    from scipy import fft

    nx, ny = heights.shape
    # the mean first: one of 1e6 rms heights must not spoil the squares
    spectrum = fft.rfft2(heights - heights.mean(dtype=np.float64), workers=-1)
    power = spectrum.real**2
    power += spectrum.imag**2
    power /= (float(nx) * ny) ** 2
    power[:, 1 : (ny + 1) // 2] *= 2
    power[0, 0] = 0
    return power


def rms_height(heights: np.ndarray) -> float:
    """Root mean square height about the mean, nm."""
    return float(np.std(heights, dtype=np.float64))


def rms_slope(heights: np.ndarray, pixel_size: float, periodic: bool = True) -> float:
    """Root mean square slope sqrt(<|∇h|²>): spectral where periodic, central differences otherwise."""
    if not periodic:
        total = sum(
            float(np.mean(np.square(np.gradient(heights, pixel_size, axis=axis), dtype=np.float64)))
            for axis in (0, 1)
            if heights.shape[axis] > 1
        )
        return math.sqrt(total)
    nx, ny = heights.shape
    qx, qy = wavenumbers((nx, ny), pixel_size)
    power = _power(heights)
    across = float(power.sum(axis=1) @ (qx[:, 0] ** 2))
    along = float(power.sum(axis=0) @ (qy[0] ** 2))
    return math.sqrt(across + along)


def psd(heights: np.ndarray, pixel_size: float, bins: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Radially averaged power spectral density of a periodic surface.

    C(q) = A0/(2π)² <|h_q|²> (nm⁴), so that the variance is ∫ C(q) 2πq dq. Returns wavenumbers (1/nm, geometric means
    of logarithmic bins) and C; empty bins are left out.
    """
    nx, ny = heights.shape
    qx, qy = wavenumbers((nx, ny), pixel_size)
    weight = np.full((1, ny // 2 + 1), 2.0)
    weight[0, 0] = 1
    if ny % 2 == 0:
        weight[0, -1] = 1
    power = _power(heights) * (nx * ny * pixel_size**2 / (2 * np.pi) ** 2)
    q = np.hypot(qx, qy)
    lowest = 2 * np.pi / (max(nx, ny) * pixel_size)
    edges = np.geomspace(lowest * 0.999, max(q.max(), lowest) * 1.001, bins + 1)
    which = np.digitize(q.ravel(), edges) - 1
    inside = (which >= 0) & (which < bins)
    count = np.bincount(which[inside], np.broadcast_to(weight, q.shape).ravel()[inside], bins)
    total = np.bincount(which[inside], power.ravel()[inside], bins)
    filled = count > 0
    return np.sqrt(edges[1:] * edges[:-1])[filled], total[filled] / count[filled]


# -- contacts ---------------------------------------------------------------------------------------------------------


class Patches(NamedTuple):
    """Connected contact patches: how many, the area of each in pixels (largest first)."""

    count: int
    sizes: np.ndarray


def label_patches(contact: np.ndarray, periodic: bool) -> tuple[np.ndarray, int]:
    """8-connected patches of a bool (nx, ny) map: labels 1…count (0 outside contact), across edges where periodic."""
    from scipy import ndimage
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    labels, count = ndimage.label(contact, structure=np.ones((3, 3), dtype=np.int8))  # pyright: ignore[reportGeneralTypeIssues]
    if not periodic or count == 0:
        return labels, int(count)
    pairs = []
    for first, second in ((labels[0], labels[-1]), (labels[:, 0], labels[:, -1])):
        for shift in (-1, 0, 1):
            other = np.roll(second, shift)
            both = (first > 0) & (other > 0)
            pairs.append(np.stack([first[both], other[both]]))
    joined = np.concatenate(pairs, axis=1) - 1
    graph = coo_array((np.ones(joined.shape[1], dtype=np.int8), (joined[0], joined[1])), shape=(count, count))
    merged, component = connected_components(graph, directed=False)
    relabel = np.concatenate([[0], component + 1]).astype(labels.dtype)
    return relabel[labels], int(merged)


def patches(contact: np.ndarray, periodic: bool) -> Patches:
    """Connected (8 neighbours) patches of a bool (nx, ny) contact map."""
    labels, count = label_patches(contact, periodic)
    sizes = np.bincount(labels[contact], minlength=count + 1)[1:]
    return Patches(count, np.sort(sizes)[::-1].astype(np.int64))


def perimeter(contact: np.ndarray, pixel_size: float, periodic: bool) -> float:
    """Total length (nm) of pixel edges between contact and non-contact; beyond a free boundary there is no contact."""
    edges = 0
    for axis in (0, 1):
        edges += int(np.count_nonzero(np.diff(contact, axis=axis)))
        first, last = np.take(contact, 0, axis), np.take(contact, -1, axis)
        edges += int(np.count_nonzero(first ^ last) if periodic else np.count_nonzero(first) + np.count_nonzero(last))
    return edges * pixel_size


def corrected_area(area: float, contour: float, pixel_size: float) -> float:
    """Contact area (nm²) less the pixels' excess at the rim, A − (π − 1 + ln 2)/24 · C · a.

    Yastrebov, Anciaux & Molinari, J. Mech. Phys. Solids 107, 469 (2017), eq. 10. ``contour`` is :func:`perimeter`.
    """
    return area - (math.pi - 1 + math.log(2)) / 24 * contour * pixel_size


def kappa(area: float, rms_slope: float, modulus: float, load: float) -> float:
    """κ = A h'_rms E* / F_N, the area–load coefficient; nan without load."""
    return area * rms_slope * modulus / load if load > 0 else math.nan


def persson_area_fraction(x: float | np.ndarray) -> float | np.ndarray:
    """Persson's contact fraction erf(√2 x), x = p̄/(E* h'_rms). Persson, J. Chem. Phys. 115, 3840 (2001)."""
    from scipy.special import erf

    return erf(np.sqrt(2) * x)


def bgt_area_fraction(x: float | np.ndarray) -> float | np.ndarray:
    """Asymptotic contact fraction √(2π) x of Bush, Gibson & Thomas, Wear 35, 87 (1975), x = p̄/(E* h'_rms)."""
    return np.sqrt(2 * np.pi) * x


def persson_pressure_density(
    pressure: np.ndarray, mean_pressure: float, modulus: float, rms_slope: float
) -> np.ndarray:
    """Persson's density of the pressure p > 0 over the nominal area (1/GPa); its integral is the contact fraction.

    [exp(−(p−p̄)²/2σ²) − exp(−(p+p̄)²/2σ²)]/(σ√(2π)) with σ = E* h'_rms/2.
    """
    sigma = 0.5 * modulus * rms_slope
    p = np.asarray(pressure, dtype=np.float64)
    near = np.exp(-0.5 * ((p - mean_pressure) / sigma) ** 2)
    # the difference of the two Gaussians as a product: no cancellation at small mean pressure
    return -near * np.expm1(-2 * p * mean_pressure / sigma**2) / (sigma * math.sqrt(2 * math.pi))
