"""A cheap approximation of a convolution: a stencil for what is near, a coarse grid for what is far.

The idea of multilevel multi-integration (A. Brandt, A. A. Lubrecht, J. Comput. Phys. 90, 348 (1990)) and of
particle-particle particle-mesh sums (R. W. Hockney, J. W. Eastwood, Computer Simulation Using Particles), on a pixel
grid: symbol = W·symbol + (1 - W)·symbol with a Gaussian W that the coarse grid resolves. The coarse part goes through
restriction, a Fourier transform on the coarse grid and interpolation; the rest is a stencil of nine by nine pixels,
fitted so that the relative error over all wave vectors is smallest. It costs a fraction of the Fourier transform of the
fine grid, even less where little is in contact, and is accurate to about 10 %: not enough for a solution, but enough to
compute corrections to one.

A coarse pixel is ``RATIO`` fine ones wide. It is slightly less wide where a side is no multiple of that; the weights of
interpolation are then tables, and the stencil is the same.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._operators import Substrate, fast_length
from ._transforms import Transforms

if TYPE_CHECKING:
    from ._team import Active, Team

Array = NDArray[Any]
Floats = NDArray[np.float64]

RATIO = kernels.RATIO
#: width of the Gaussian in fine pixels: its tail at the coarse Nyquist wave number is 0.008
SPREAD = 0.7 * RATIO
#: pixels of the grid on which the stencil is fitted
SAMPLE = 64


def suits(body: Substrate, any_size: bool = False) -> bool:
    """Whether the grid is periodic, large enough for it to pay, and divides into coarse pixels (or ``any_size``)."""
    if body.padded != body.shape or min(body.shape) < 2 * SAMPLE:
        return False
    # of columns that are not whole coarse pixels, the last block must hold the reach of the stencil
    width, per_row = kernels.widths(body.shape[1])
    return divides(body.shape) or (any_size and body.shape[1] - width * (per_row - 1) >= kernels.REACH)


def divides(shape: tuple[int, int]) -> bool:
    """Whether a grid divides into coarse pixels."""
    return all(n % RATIO == 0 for n in shape)


class Split:
    """Approximately a convolution on the grid of ``body``: with its symbol, or with the inverse one."""

    def __init__(self, body: Substrate, dtype: Any, library: str, team: Team, *, inverse: bool, floating: bool) -> None:
        self._run = team.run
        nx, ny = body.shape
        coarse = (nx // RATIO, ny // RATIO)
        self._axes: tuple[kernels.Axis, kernels.Axis] | None = None
        if not divides(body.shape):
            coarse = (fast_length(math.ceil(nx / RATIO)), fast_length(math.ceil(ny / RATIO)))
            self._axes = _axis(nx, coarse[0], np.dtype(dtype)), _axis(ny, coarse[1], np.dtype(dtype))
        self._transforms = Transforms(coarse, coarse, library, team.threads)
        far = _pixel_symbol(body.regrid(coarse), body, inverse) * _far(body.shape, coarse)
        #: of the inverse operator for a uniform displacement
        self.stiffness = float(far[0, 0])
        if floating:
            far[0, 0] = 0.0
        self._far = _whole(far / (nx / coarse[0] * (ny / coarse[1])), coarse[0]).astype(dtype)
        self._stencil = _stencil(body.window((SAMPLE, SAMPLE)), inverse).astype(dtype)
        self._coarse = np.empty(coarse, dtype)

    def apply(self, x: Array, active: Active, out: Array, part: Array) -> Array:
        """The convolution of x (nx, ny; zero in blocks that are not active) in active blocks of ``out``.

        Σ x·out over each block is in ``part[:, 0]`` afterwards.
        """
        if self._axes is None:
            self._run(kernels.restrict, active.coarse_edges, active.blocks, x, self._coarse)
        else:
            self._run(kernels.restrict_between, len(self._coarse), active.blocks, x, *self._axes, self._coarse)
        spectrum = self._transforms.forward(self._coarse)
        spectrum *= self._far
        far = self._transforms.backward(spectrum)
        if self._axes is None:
            self._run(kernels.local, active.row_edges, active.blocks, x, self._stencil, far, out, part)
        else:
            given = x, self._stencil, far, *self._axes
            self._run(kernels.local_between, active.row_edges, active.blocks, *given, out, part)
        return out


def _axis(fine: int, coarse: int, dtype: Any) -> kernels.Axis:
    """Interpolation along an axis of ``coarse`` pixels to one of ``fine``, periodic."""
    place = np.arange(fine) * coarse
    lower = place // fine
    return kernels.Axis(lower, (lower + 1) % coarse, ((place - lower * fine) / fine).astype(dtype))


def _pixel_symbol(body: Substrate, fine: Substrate, inverse: bool) -> Floats:
    """The symbol or its inverse in units of the pixels of ``fine``."""
    unit = math.sqrt(fine.pixel[0] * fine.pixel[1])
    return body.inverse() * unit if inverse else body.symbol() / unit


@lru_cache(maxsize=64)
def _stencil(window: Substrate, inverse: bool) -> Floats:
    """The stencil of a body. That of a half-space is the same on all grids."""
    small = (SAMPLE // RATIO, SAMPLE // RATIO)
    coarse = _pixel_symbol(window.regrid(small), window, inverse)
    return _fitted(_pixel_symbol(window, window, inverse), coarse * _far((SAMPLE, SAMPLE), small))


def _whole(quarter: Array, rows: int) -> Array:
    """A symbol on all rows of a half spectrum."""
    if quarter.shape[0] == rows:
        return quarter
    return np.concatenate([quarter, quarter[1 : rows - quarter.shape[0] + 1][::-1]])


def _hat(q: NDArray[np.floating[Any]], ratio: float = RATIO) -> Floats:
    """Transform of the hat function over ``ratio``, at wave numbers per fine pixel: 1 at zero."""
    half = np.where(q == 0.0, 1.0, 0.5 * q)
    return np.where(q == 0.0, 1.0, np.sin(half * ratio) / (ratio * np.sin(half))) ** 2


def _far(fine: tuple[int, int], coarse: tuple[int, int]) -> Floats:
    """What the coarse symbol is multiplied by: the Gaussian, and the inverse of restriction and interpolation."""
    qx = 2.0 * np.pi / fine[0] * np.arange(coarse[0] // 2 + 1)[:, None]
    qy = 2.0 * np.pi / fine[1] * np.arange(coarse[1] // 2 + 1)[None, :]
    hats = _hat(qx, fine[0] / coarse[0]) * _hat(qy, fine[1] / coarse[1])
    return np.exp(-(SPREAD**2) * (qx**2 + qy**2)) / hats**2


def _fitted(symbol: Floats, far: Floats) -> Floats:
    """Stencil (REACH + 1, REACH + 1) that best adds what the coarse grid leaves out, in the relative sense."""
    half = SAMPLE // 2 + 1
    q = 2.0 * np.pi / SAMPLE * np.arange(half)
    full = _whole(_whole(symbol, SAMPLE)[:half], half)
    # The coarse spectrum repeats on the fine one.
    m = SAMPLE // RATIO
    index = np.arange(half) % m
    index = np.minimum(index, m - index)
    rest = full - far[np.ix_(index, index)] * np.outer(_hat(q), _hat(q)) ** 2
    weight = 1.0 / np.maximum(full, 1e-3 * full.ravel()[1:].max())
    weight[0, 0] = 0.0
    # Rows and columns of the quarter stand for two, except the first and last.
    twice = np.where((np.arange(half) % (half - 1)) == 0, 1.0, 2.0)
    weight *= np.sqrt(np.outer(twice, twice))
    pairs = [
        (a, b)
        for a in range(kernels.REACH + 1)
        for b in range(kernels.REACH + 1)
        if np.hypot(a, b) <= kernels.REACH + 0.3
    ]
    cosine = (
        np.cos(np.outer(np.arange(kernels.REACH + 1), q)) * np.where(np.arange(kernels.REACH + 1) == 0, 1, 2)[:, None]
    )
    matrix = np.stack([(np.outer(cosine[a], cosine[b]) * weight).ravel() for a, b in pairs], axis=1)
    # Normal equations, summed without BLAS: its threads would take longer to wake than this takes to add.
    normal = np.einsum("ka,kb->ab", matrix, matrix)
    values = np.linalg.solve(normal, np.einsum("ka,k->a", matrix, (rest * weight).ravel()))
    stencil = np.zeros((kernels.REACH + 1, kernels.REACH + 1))
    for (a, b), value in zip(pairs, values, strict=True):
        stencil[a, b] = value
    return stencil
