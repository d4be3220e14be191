"""What is measured on surfaces and contacts, as plain functions of arrays.

Lengths in nm, pressures in GPa. Contact is where the pressure is positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage.threads import available

# -- surfaces ---------------------------------------------------------------------------------------------------------


def _multiplicity(ny: int) -> np.ndarray:
    """How often each column of a half spectrum occurs in the full one: 2; 1 for zero and the Nyquist of an even ny."""
    weight = np.full(ny // 2 + 1, 2.0)
    weight[0] = 1.0
    if ny % 2 == 0:
        weight[-1] = 1.0
    return weight


def _wavenumbers(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Angular wavenumbers of the half spectrum in 1/pixel: (nx,) and (ny//2 + 1,)."""
    return 2 * np.pi * np.fft.fftfreq(shape[0]), 2 * np.pi * np.fft.rfftfreq(shape[1])


def _centred(heights: np.ndarray) -> tuple[np.ndarray, float]:
    """Heights less their mean, scaled to at most 1, float64; and the scale (nm).

    So neither heights of 1e200 nm nor a mean of 1e6 rms heights spoils a sum of squares.
    """
    largest = float(np.max(np.abs(heights)))
    if largest == 0:
        return np.zeros(heights.shape), 0.0
    scaled = np.divide(heights, largest, dtype=np.float64)
    scaled -= scaled.mean()
    spread = float(np.max(np.abs(scaled)))
    if spread > 0:
        scaled /= spread
    return scaled, largest * spread


def _power(heights: np.ndarray) -> np.ndarray:
    """|h_q|² of the half spectrum, each mode counted with its conjugate: the sum is the mean square."""
    from scipy import fft

    spectrum: Any = fft.rfft2(heights, workers=available())
    power = np.square(spectrum.real)
    power += np.square(spectrum.imag)
    power *= _multiplicity(heights.shape[1]) / float(heights.size) ** 2
    return power


def rms_height(heights: np.ndarray) -> float:
    """Root mean square height about the mean, nm."""
    scaled, scale = _centred(heights)
    return scale * math.sqrt(float(np.mean(np.square(scaled))))


def rms_slope(heights: np.ndarray, pixel_size: float, periodic: bool = True) -> float:
    """Root mean square slope sqrt(<|∇h|²>): spectral where periodic, central differences otherwise."""
    scaled, scale = _centred(heights)
    if periodic:
        qx, qy = _wavenumbers(scaled.shape)
        power = _power(scaled)
        squared = float(qx**2 @ power.sum(axis=1)) + float(power.sum(axis=0) @ qy**2)
    else:
        squared = sum(
            float(np.mean(np.square(np.gradient(scaled, axis=axis)))) for axis in (0, 1) if scaled.shape[axis] > 1
        )
    return math.sqrt(squared) * (scale / pixel_size)


def psd(heights: np.ndarray, pixel_size: float, periodic: bool = True, bins: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Radially averaged power spectral density of (nx, ny) heights: wavenumbers q (1/nm) and C(q) (nm⁴).

    C(q) = |a² Σ h exp(−iq·r)|²/A0, so that the mean square height is ∫C d²q/(2π)². Averages over ``bins`` logarithmic
    bins from 2π/λ_L, λ_L the longer side, to the corner of the grid's spectrum; q is the mean over the bin's wave
    vectors, and bins that hold none are left out. Where not periodic, a Hann window of unit mean square is applied to
    the heights about their mean.

    Conventions of Jacobs, Junge & Pastewka, Surf. Topogr.: Metrol. Prop. 5, 013001 (2017).
    """
    nx, ny = heights.shape
    scaled, scale = _centred(heights)
    if not periodic:
        # sampled at pixel centres, so that the window has no zeros and stands for a single pixel too
        for axis, count in enumerate((nx, ny)):
            window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
            window /= math.sqrt(float(np.mean(window**2)))
            scaled *= window[:, None] if axis == 0 else window[None, :]
    power = _power(scaled).ravel()
    qx, qy = _wavenumbers((nx, ny))
    q = np.hypot(qx[:, None], qy[None, :]).ravel()
    lowest, highest = 2 * np.pi / max(nx, ny), float(q.max())
    # a little wider than the spectrum, so that rounding drops no wave vector
    edges = np.geomspace(lowest * (1 - 1e-9), max(highest, lowest) * (1 + 1e-9), bins + 1)
    which = np.searchsorted(edges, q, side="right")
    weight = np.broadcast_to(_multiplicity(ny), (nx, ny // 2 + 1)).ravel()
    count, waves, total = (np.bincount(which, values, bins + 2)[1 : bins + 1] for values in (weight, weight * q, power))
    filled = count > 0
    mean = total[filled] / count[filled] * heights.size
    return waves[filled] / count[filled] / pixel_size, mean * (scale * pixel_size) ** 2


# -- contacts ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Patches:
    """Connected contact patches: how many, the area of each in pixels (largest first)."""

    count: int
    sizes: np.ndarray


def label_patches(contact: np.ndarray, periodic: bool) -> tuple[np.ndarray, int]:
    """8-connected patches of a bool (nx, ny) map: labels 1…count (0 outside contact), across edges where periodic."""
    from scipy import ndimage
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    labels = np.zeros(contact.shape, dtype=np.int32)
    count = int(ndimage.label(contact, structure=np.ones((3, 3), dtype=np.int8), output=labels))  # pyright: ignore[reportArgumentType]
    if not periodic or count == 0:
        return labels, count
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
