"""Two-dimensional real Fourier transforms with a choice of library.

``scipy`` (pocketfft, BSD licence) is always available. ``ducc0`` (GPL v2+), ``pyfftw`` (BSD wrapper around FFTW, which
is GPL v2+) and ``mkl_fft`` (BSD wrapper around Intel's proprietary MKL) are used if they are installed and the user
requests them by name.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

from chemage import InputError

#: Number of pixels below which another thread gains nothing.
SHARED = 1 << 19
#: Names of the libraries' packages.
PACKAGES = {"ducc0": "ducc0", "pyfftw": "pyfftw", "mkl_fft": "mkl-fft mkl-service"}

Array = NDArray[Any]


class Transforms:
    """Forward and backward transforms between real (nx, ny) and half spectra (px, py//2+1), zero-padded to ``padded``
    = (px, py).

    ``count`` is the number of transforms made. Raises ``InputError`` if the library is not installed.
    """

    def __init__(self, shape: tuple[int, int], padded: tuple[int, int], library: str, workers: int) -> None:
        self.shape, self.padded, self.library = shape, padded, library
        self.workers = workers if padded[0] * padded[1] >= SHARED else 1
        self.count = 0
        self._forward, self._backward, self._in_place = _functions(library)

    def forward(self, x: Array) -> Array:
        """Half spectrum of x, which is not changed."""
        self.count += 1
        return self._forward(x, self.padded, self.workers)

    def backward(self, spectrum: Array) -> Array:
        """The real array of a half spectrum, cropped to ``shape``; the spectrum is destroyed."""
        self.count += 1
        return self._backward(spectrum, self.shape, self.padded, self.workers)

    def in_place(self, z: Array, forward: bool) -> Array:
        """The complex transform of z, or the inverse one, in the memory of z if the library can; use the return value.

        If z is a view of a real array (pairs of neighbours as complex numbers), this transforms that array without
        memory for a spectrum, which would take longer to allocate than a pass over it.
        """
        self.count += 1
        return self._in_place(z, forward, self.workers)


def _scipy_forward(x: Array, padded: tuple[int, int], workers: int) -> Array:
    # Axis by axis: rows that are only padding are never transformed, and the second pass is in place.
    rows = sfft.rfft(x, n=padded[1], axis=1, workers=workers)
    return np.asarray(sfft.fft(rows, n=padded[0], axis=0, overwrite_x=True, workers=workers))


def _scipy_backward(s: Array, shape: tuple[int, int], padded: tuple[int, int], workers: int) -> Array:
    columns = np.asarray(sfft.ifft(s, axis=0, overwrite_x=True, workers=workers))[: shape[0]]
    x = np.asarray(sfft.irfft(columns, n=padded[1], axis=1, overwrite_x=True, workers=workers))
    return np.ascontiguousarray(x[:, : shape[1]])


def _scipy_in_place(z: Array, forward: bool, workers: int) -> Array:
    return np.asarray((sfft.fft2 if forward else sfft.ifft2)(z, overwrite_x=True, workers=workers))


def _pad(x: Array, padded: tuple[int, int]) -> Array:
    if x.shape == padded:
        return x
    full = np.zeros(padded, dtype=x.dtype)
    full[: x.shape[0], : x.shape[1]] = x
    return full


def _functions(library: str) -> tuple[Callable[..., Array], Callable[..., Array], Callable[..., Array]]:
    if library == "scipy":
        return _scipy_forward, _scipy_backward, _scipy_in_place
    try:
        if library == "ducc0":
            ducc = importlib.import_module("ducc0.fft")

            def forward(x: Array, padded: tuple[int, int], workers: int) -> Array:
                return ducc.r2c(_pad(x, padded), axes=(0, 1), nthreads=workers)

            def backward(s: Array, shape: tuple[int, int], padded: tuple[int, int], workers: int) -> Array:
                x = ducc.c2r(s, axes=(0, 1), lastsize=padded[1], forward=False, inorm=2, nthreads=workers)
                return np.ascontiguousarray(x[: shape[0], : shape[1]])

            def in_place(z: Array, forward: bool, workers: int) -> Array:
                norm = 0 if forward else 2
                return ducc.c2c(z, axes=(0, 1), forward=forward, inorm=norm, out=z, nthreads=workers)

            return forward, backward, in_place
        name = "pyfftw.interfaces.scipy_fft" if library == "pyfftw" else "mkl_fft.interfaces.scipy_fft"
        module = importlib.import_module(name)
        if library == "pyfftw":
            importlib.import_module("pyfftw.interfaces.cache").enable()
    except ImportError as error:
        remedy = f"pip install {PACKAGES[library]}, or choose 'scipy', which is always available"
        raise InputError.of("fft", library, f"cannot be imported ({error})", remedy) from error

    def forward2(x: Array, padded: tuple[int, int], workers: int) -> Array:
        return np.ascontiguousarray(module.rfft2(_pad(x, padded), workers=workers))

    def backward2(s: Array, shape: tuple[int, int], padded: tuple[int, int], workers: int) -> Array:
        x = module.irfft2(s, s=padded, workers=workers)
        return np.ascontiguousarray(x[: shape[0], : shape[1]])

    def in_place2(z: Array, forward: bool, workers: int) -> Array:
        transform = module.fft2 if forward else module.ifft2
        return np.ascontiguousarray(transform(z, overwrite_x=True, workers=workers))

    return forward2, backward2, in_place2
