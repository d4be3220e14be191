"""The elastic operator of a substrate as a convolution on its grid, by Fourier transforms."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._operators import Substrate
from ._team import Team
from ._transforms import Transforms

Array = NDArray[Any]


class Convolution:
    """The operator of a substrate in one precision, in pixel units: displacement = symbol/pixel applied to pressure.

    ``symbol`` is ``substrate.symbol()``, which takes a while to compute. ``floating``: the offset of the gap is
    unknown, so that the displacement under the mean pressure is left out where it is uniform (periodic substrates).
    """

    def __init__(
        self, substrate: Substrate, symbol: Array, dtype: Any, library: str, team: Team, *, floating: bool
    ) -> None:
        self.shape, self.dtype, self.team = substrate.shape, np.dtype(dtype), team
        self.unit = math.sqrt(substrate.pixel[0] * substrate.pixel[1])
        periodic = substrate.padded == substrate.shape
        self._transforms = Transforms(substrate.shape, substrate.padded, library, team.threads)
        self._unpadded = self._transforms
        if not periodic:
            self._unpadded = Transforms(substrate.shape, substrate.shape, library, team.threads)
        self._symbol = (symbol / self.unit).astype(self.dtype)
        if floating and periodic:
            self._symbol[0, 0] = 0.0  # a uniform displacement only shifts the offset, but its rounding exceeds the rest
        self._inverse: Array | None = None
        #: of the preconditioner for a uniform residual, once it was used
        self.stiffness = 0.0
        self._substrate = substrate
        self._buffer: Array | None = None
        self._turn: Array | None = None
        if periodic and substrate.shape[1] % 2 == 0:
            angles = 2.0 * math.pi / substrate.shape[1] * np.arange(substrate.shape[1] // 2)
            self._turn = np.exp(-1j * angles).astype(np.result_type(self.dtype, np.complex64))

    @property
    def transforms(self) -> int:
        """Transforms made so far."""
        return self._transforms.count + (self._unpadded.count if self._unpadded is not self._transforms else 0)

    @cached_property
    def response(self) -> float:
        """Root of the mean squared symbol: rms displacement under random pressures of unit rms."""
        rows, columns = self._transforms.padded
        weight = np.full(self._symbol.shape[1], 2.0)
        weight[0] = 1.0
        if columns % 2 == 0 and columns > 1:
            weight[-1] = 1.0
        squares = np.square(self._symbol, dtype=np.float64) @ weight
        if squares.size != rows:
            squares[1 : (rows + 1) // 2] *= 2.0
        return math.sqrt(float(squares.sum()) / (rows * columns))

    def spectrum(self, x: Array) -> Array:
        """Transform of x (nx, ny), zero-padded."""
        return self._transforms.forward(x)

    def energy(self, spectrum: Array) -> float:
        """xᵀGx from the spectrum of x, by Parseval's theorem."""
        rows, columns = self._transforms.padded
        part = self.team.table(kernels.quadratic_form, spectrum.shape[0], 1, spectrum, self._symbol, columns)
        return float(part.sum()) / (rows * columns)

    def displacement(self, spectrum: Array) -> Array:
        """Gx from the spectrum of x, which is destroyed."""
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, self._symbol)
        return self._transforms.backward(spectrum)

    def apply(self, x: Array) -> Array:
        """Gx of a pressure x (nx, ny), which is first rounded to this precision; valid until the next call."""
        if self._turn is None:
            return self.displacement(self.spectrum(np.asarray(x, dtype=self.dtype)))
        if self._buffer is None:
            self._buffer = np.empty(self.shape, self.dtype)
        return self._packed(x, self._symbol, self._buffer)

    def precondition(self, v: Array) -> Array:
        """Approximately G⁻¹v."""
        if self._inverse is None:
            self._inverse = (self._substrate.inverse() * self.unit).astype(self.dtype)
            self.stiffness = float(self._inverse[0, 0])
        if self._turn is not None:
            return self._packed(v, self._inverse, np.empty(self.shape, self.dtype))
        spectrum = self._unpadded.forward(v)
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, self._inverse)
        return self._unpadded.backward(spectrum)

    def _packed(self, x: Array, symbol: Array, buffer: Array) -> Array:
        """x times a symbol, in the memory of ``buffer`` (nx, ny)."""
        nx = self.shape[0]
        self.team.run(kernels.convert, nx, x, buffer)
        z = self._unpadded.in_place(buffer.view(np.result_type(self.dtype, np.complex64)), True)
        self.team.run(kernels.multiply_packed, nx // 2 + 1, z, symbol, self._turn)
        return self._unpadded.in_place(z, False).view(self.dtype)
