"""Measures of roughness, as plain functions of arrays: rms height, rms slope, power spectrum.

Lengths are in nm.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from chemage.foundation.threads import available


def multiplicity(ny: int) -> np.ndarray:
    """How often each column of a half spectrum occurs in the full one: 2; 1 for zero and the Nyquist of an even ny."""
    weight = np.full(ny // 2 + 1, 2.0)
    weight[0] = 1.0
    if ny % 2 == 0:
        weight[-1] = 1.0
    return weight


def _wavenumbers(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Angular wavenumbers of the half spectrum in 1/pixel: (nx,) and (ny//2 + 1,)."""
    return 2 * np.pi * np.fft.fftfreq(shape[0]), 2 * np.pi * np.fft.rfftfreq(
        shape[1]
    )


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
    power *= multiplicity(heights.shape[1]) / float(heights.size) ** 2
    return power


def rms_height(heights: np.ndarray) -> float:
    """Root mean square height about the mean, nm."""
    scaled, scale = _centred(heights)
    return scale * math.sqrt(float(np.mean(np.square(scaled))))


def rms_slope(
    heights: np.ndarray, pixel_size: float, periodic: bool = True
) -> float:
    """Root mean square slope sqrt(<|∇h|²>), spectral: it has the waves down to two pixels in full.

    Periodic heights are a Fourier series. Others are, along each row and each column, the straight line between its
    ends and a sine series of what deviates from it (odd mirror images at the edges), so that a plane is exact; waves of
    2.2 pixels on N pixels err by about 0.3/N of the slope.
    """
    from scipy import fft

    scaled, scale = _centred(heights)
    if periodic:
        qx, qy = _wavenumbers(scaled.shape)
        power = _power(scaled)
        squared = float(qx**2 @ power.sum(axis=1)) + float(
            power.sum(axis=0) @ qy**2
        )
    else:
        squared = 0.0
        for rows in (scaled.T, scaled):
            steps = rows.shape[1] - 1
            if steps < 1:
                continue
            slope = line = (rows[:, -1:] - rows[:, :1]) / steps
            if steps > 1:
                waves = np.zeros(rows.shape)
                waves[:, 1:-1] = (
                    rows[:, 1:-1] - rows[:, :1] - line * np.arange(1, steps)
                )
                waves[:, 1:-1] = np.asarray(
                    fft.dst(waves[:, 1:-1], type=1, axis=1, workers=available())
                )
                waves *= 0.5 * np.pi / steps**2 * np.arange(steps + 1)
                slope = line + fft.dct(
                    waves, type=1, axis=1, overwrite_x=True, workers=available()
                )
            squared += float(np.mean(np.square(slope)))
    return math.sqrt(squared) * (scale / pixel_size)


def taper(heights: np.ndarray) -> None:
    """Multiply heights, which are about their mean, with a Hann window of unit mean square, in place."""
    for axis, count in enumerate(heights.shape):
        window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
        window /= math.sqrt(float(np.mean(window**2)))
        heights *= window[:, None] if axis == 0 else window[None, :]


def psd(
    heights: np.ndarray, pixel_size: float, periodic: bool = True, bins: int = 60
) -> tuple[np.ndarray, np.ndarray]:
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
        taper(scaled)
    power = _power(scaled).ravel()
    qx, qy = _wavenumbers((nx, ny))
    q = np.hypot(qx[:, None], qy[None, :]).ravel()
    lowest, highest = 2 * np.pi / max(nx, ny), float(q.max())
    # a little wider than the spectrum, so that rounding drops no wave vector
    edges = np.geomspace(
        lowest * (1 - 1e-9), max(highest, lowest) * (1 + 1e-9), bins + 1
    )
    which = np.searchsorted(edges, q, side="right")
    weight = np.broadcast_to(multiplicity(ny), (nx, ny // 2 + 1)).ravel()
    count, waves, total = (
        np.bincount(which, values, bins + 2)[1 : bins + 1]
        for values in (weight, weight * q, power)
    )
    filled = count > 0
    mean = total[filled] / count[filled] * heights.size
    return waves[filled] / count[filled] / pixel_size, mean * (
        scale * pixel_size
    ) ** 2
