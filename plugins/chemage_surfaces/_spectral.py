"""Random self-affine surfaces by Fourier filtering.

Each wave vector has a fixed position in the random stream, ordered in shells of increasing wavenumber, so that a seed
defines one *surface*: a finer pixel grid samples the same surface, and a larger ``zeta`` adds shorter waves to it.
Convergence in the pixel size can therefore be studied without averaging over realisations.

Source: Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018), Eq. 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

Floats = NDArray[np.float64]

__all__ = ["continuation", "self_affine", "spectral_density"]


def spectral_density(q: Floats, *, hurst: float, q_roll: float, q_long: float, q_short: float) -> Floats:
    """Shape of the power spectral density, Eq. 1 of the paper, normalised to 1 on the plateau.

    ``q`` (any shape) and the cut-offs have the same unit, 1/nm or 2π/λ_L. The density is constant for
    ``q_long <= q < q_roll``, falls as ``(q/q_roll)**(-2-2*hurst)`` for ``q_roll <= q <= q_short``, and is zero
    elsewhere. The cut-offs are inclusive to within rounding (1e-9).
    """
    slack = 1e-9
    density = (np.maximum(q, q_roll) / q_roll) ** (-2.0 - 2.0 * hurst)
    density[(q < q_long * (1.0 - slack)) | (q > q_short * (1.0 + slack))] = 0.0
    return density


def self_affine(
    shape: tuple[int, int],
    pixel_size: float,
    *,
    hurst: float,
    zeta: float,
    eta: float,
    rms_slope: float | None = None,
    rms_height: float | None = None,
    seed: int | np.random.SeedSequence,
    workers: int = 1,
) -> Floats:
    """Heights (nx, ny) in nm of a periodic, isotropic, Gaussian self-affine surface with zero mean.

    λ_L is the longer side, q_L = 2π/λ_L, q_s = zeta·q_L, q_r = eta·q_L.

    Parameters
    ----------
    shape, pixel_size
        Pixels (nx, ny) and the edge of a pixel, nm.
    hurst, zeta, eta
        Hurst exponent, short cut-off q_s/q_L and roll-off q_r/q_L.
    rms_slope, rms_height
        Spectral rms slope, or rms height (nm), of this realisation; exactly one of them.
    seed, workers
        Seed of the surface; threads of the Fourier transform, which do not change a bit of the result.

    Raises
    ------
    ValueError
        The cut-offs contradict each other, the grid cannot resolve them (``zeta`` above half the pixels of the longer
        side), or no wave vector of the grid lies between them.
    """
    nx, ny = shape
    longest = max(nx, ny)
    if (rms_slope is None) == (rms_height is None):
        raise ValueError("give either rms_slope or rms_height, not both")
    if min(nx, ny) < 1:
        raise ValueError(f"a grid of {nx} x {ny} pixels has no pixels")
    if not 1.0 <= eta <= zeta:
        raise ValueError(f"need 1 <= eta <= zeta, not eta = {eta:g} and zeta = {zeta:g}")
    if zeta > longest / 2:
        raise ValueError(
            f"zeta = {zeta:g} is above the Nyquist limit of {longest} pixels, {longest / 2:g}: "
            "use more pixels or a smaller zeta"
        )
    half = _half_spectrum(
        nx,
        ny,
        zeta,
        seed,
        lambda q: np.sqrt(spectral_density(q, hurst=hurst, q_roll=eta, q_long=1.0, q_short=zeta)),
    )
    # wavenumbers in units of 2π/λ_L, in columns up to the short cut-off
    qx = _frequencies(nx) * (longest / nx)
    qy = np.arange(half.shape[1]) * (longest / ny)
    weight = _multiplicity(ny)[: half.shape[1]]
    power = half.real**2 + half.imag**2
    power *= weight
    if rms_slope is not None:
        # the terms are scaled to order one, so that extreme spectra neither overflow nor vanish
        norm = math.sqrt(float(np.sum(power * (qx[:, None] ** 2 + qy**2)))) * (2.0 * math.pi / longest)
        target = rms_slope * pixel_size
    else:
        norm = math.sqrt(float(np.sum(power)))
        target = float(rms_height)  # type: ignore[arg-type]
    if norm == 0.0:
        raise ValueError(
            f"no wave vector of a {nx} x {ny} grid lies between the cut-offs (zeta = {zeta:g}, eta = {eta:g})"
        )
    half *= target / norm * nx * ny
    columns = sfft.ifft(half, axis=0, overwrite_x=True, workers=workers)
    heights = sfft.irfft(columns, n=ny, axis=1, overwrite_x=True, workers=workers)
    return np.ascontiguousarray(heights)


def _frequencies(n: int) -> Floats:
    """Integer wavenumbers of a transform of length n, in FFT order, as floats."""
    index = np.arange(n, dtype=np.float64)
    index[(n + 1) // 2 :] -= n
    return index


def _multiplicity(ny: int) -> Floats:
    """Multiplicity of each column of a half spectrum in the full one: 1 for zero and the Nyquist frequency, else 2."""
    weight = np.full(ny // 2 + 1, 2.0)
    weight[0] = 1.0
    if ny % 2 == 0:
        weight[-1] = 1.0
    return weight


def continuation(
    shape: tuple[int, int],
    pixel_size: float,
    *,
    hurst: float,
    density: float,
    join: float,
    cutoff: float,
    seed: int | np.random.SeedSequence,
) -> NDArray[np.complex128]:
    """Half spectrum of random heights with C(q) = density·(q/join)**(-2-2·hurst) for join <= q <= cutoff, else 0.

    ``density`` is in nm⁴, ``join`` and ``cutoff`` in 1/nm, C(q) as in :func:`chemage.plugin.roughness.psd`. Rows are in
    FFT order, columns 0 … top along y; an inverse transform of length ny along y gives heights in nm. Amplitudes are
    those of a Gaussian surface, not scaled to meet a roughness, so that the spectrum has its natural scatter.
    """
    nx, ny = shape
    longest = 2.0 * math.pi / (max(nx, ny) * pixel_size)
    # noise has a mean square of 2
    scale = math.sqrt(0.5 * density * nx * ny) / pixel_size

    def amplitude(q: Floats) -> Floats:
        power = spectral_density(q, hurst=hurst, q_roll=join / longest, q_long=join / longest, q_short=cutoff / longest)
        return scale * np.sqrt(power)

    return _half_spectrum(nx, ny, cutoff / longest, seed, amplitude)


def _half_spectrum(
    nx: int,
    ny: int,
    zeta: float,
    seed: int | np.random.SeedSequence,
    amplitude: Callable[[Floats], Floats],
) -> NDArray[np.complex128]:
    """Complex white noise of mean square 2 times ``amplitude`` of q/q_L, with Hermitian symmetry, up to ``zeta``: rows
    in FFT order, columns 0 … top along y."""
    longest = max(nx, ny)
    top_x = min(math.floor(zeta * nx / longest * (1.0 + 1e-12)), nx // 2)
    top_y = min(math.floor(zeta * ny / longest * (1.0 + 1e-12)), ny // 2)
    sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    rng = np.random.Generator(np.random.Philox(sequence))
    # noise[i, j] has kx = i - top_x, ky = j
    noise = np.zeros((2 * top_x + 1, top_y + 1), dtype=np.complex128)
    for s in range(1, max(top_x, top_y) + 1):
        draw = rng.standard_normal(2 * (4 * s + 1)).view(np.complex128)
        if s <= top_x:
            ky = min(s, top_y) + 1
            noise[top_x + s, :ky] = draw[:ky]
            noise[top_x - s, :ky] = draw[s + 1 : s + 1 + ky]
        if s <= top_y:
            kx = min(s - 1, top_x)
            middle = 3 * s + 1  # of draw[2s+2 : 4s+1], where kx = 0
            noise[top_x - kx : top_x + kx + 1, s] = draw[middle - kx : middle + kx + 1]
    kx_all = np.arange(-top_x, top_x + 1)
    q = np.hypot(kx_all[:, None] * (longest / nx), np.arange(top_y + 1) * (longest / ny))
    noise *= amplitude(q)
    half = np.zeros((nx, top_y + 1), dtype=np.complex128)
    half[kx_all % nx] = noise  # for even nx and top_x = nx/2 the first and the last share a row, which keeps the last
    for column in (0, ny // 2) if ny % 2 == 0 and top_y == ny // 2 and ny > 1 else (0,):
        _make_hermitian(half[:, column])
    return half


def _make_hermitian(column: NDArray[np.complex128]) -> None:
    """Make a column its own conjugate mirror image from its positive half; real entries keep their variance."""
    n = column.size
    positive = column[1 : (n + 1) // 2]
    column[n - positive.size :] = positive[::-1].conj()
    for i in (0, n // 2) if n % 2 == 0 else (0,):
        column[i] = math.sqrt(2.0) * column[i].real
