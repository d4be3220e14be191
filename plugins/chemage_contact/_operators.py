"""Elastic substrates: the Green's function that turns pressure into displacement, apart from any solver.

A substrate knows its grid and returns a ``symbol``, the factor between the transforms of pressure and displacement
for unit contact modulus, in nm: u(q) = symbol(q)·p(q)/E*. To add one (another boundary, another material) write a
class with these members; the iteration depends on nothing else.

Beside them the threads that share the blocks and rows of a kernel; results do not depend on their number.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

from . import _kernels as kernels

Array = NDArray[Any]

#: Numbers of rows, and of pixels in active blocks, below which waking another thread takes longer than the work or
#: gains nothing.
FEW, FEW_PIXELS = 700, 1 << 19
#: Cost of an active block relative to that of one that is skipped.
ACTIVE_COST = 16


class Team:
    """Runs a kernel on a few threads, including the calling one; the kernels release the interpreter lock."""

    def __init__(self, threads: int) -> None:
        self.threads = max(1, threads)
        self._pool = (
            ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, *_: type[BaseException] | BaseException | TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def run(
        self, kernel: Callable[..., None], share: int | Sequence[int], *args: Any
    ) -> None:
        """Call ``kernel(lo, hi, *args)`` so that the ranges cover 0 … ``share``, or between the edges given."""
        edges = share
        if isinstance(
            edges, int
        ):  # about equal shares; a single one if the rows are few
            shares = 1 if edges < FEW else self.threads
            edges = [edges * k // shares for k in range(shares + 1)]
        if len(edges) == 2:
            kernel(edges[0], edges[1], *args)
            return
        first, *others = pairwise(edges)
        jobs = (
            [self._pool.submit(kernel, *part, *args) for part in others]
            if self._pool is not None
            else []
        )
        kernel(*first, *args)
        for job in jobs:
            job.result()

    def table(
        self, kernel: Callable[..., None], rows: int, columns: int, *args: Any
    ) -> Array:
        """The table (rows, columns) float64 that ``kernel(lo, hi, *args, part)`` fills row by row."""
        part = np.zeros((rows, columns))
        self.run(kernel, rows, *args, part)
        return part


class Active:
    """The active blocks of an iteration, and ranges of blocks and rows of about equal work per thread.

    ``mask`` (rows · per_row,) bool or uint8, block by block; ``width`` pixels per block.
    """

    def __init__(self, mask: Array, width: int, per_row: int, threads: int) -> None:
        mask = mask.astype(np.uint8)
        #: as the kernels take them
        self.blocks = kernels.Blocks(width, per_row, mask)
        rows = mask.size // per_row
        shares = 1 if np.count_nonzero(mask) * width < FEW_PIXELS else threads
        self.block_edges, self.row_edges = [0, mask.size], [0, rows]
        if shares == 1:
            return
        done = np.concatenate(
            [
                np.zeros(1, np.int64),
                np.cumsum(1 + ACTIVE_COST * mask.astype(np.int64)),
            ]
        )
        goals = done[-1] * np.arange(1, shares) // shares
        self.block_edges = [
            0,
            *(int(b) for b in np.searchsorted(done, goals)),
            mask.size,
        ]
        self.row_edges = [
            0,
            *(int(r) for r in np.searchsorted(done[::per_row], goals)),
            rows,
        ]


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Substrate(ABC):
    """An elastic body on a grid; one that is periodic has no padding."""

    shape: tuple[int, int]
    """pixels (nx, ny)"""
    pixel: tuple[float, float]
    """edge lengths of a pixel in nm"""
    #: whether opposite edges of the grid are neighbours
    periodic: ClassVar[bool] = True

    @property
    def padded(self) -> tuple[int, int]:
        """Grid of the convolution: ``shape`` if periodic, at least twice that for an isolated contact."""
        return self.shape

    @abstractmethod
    def symbol(self) -> Floats:
        """(px, py//2+1) values ≥ 0, or (px//2+1, py//2+1) if even in the first wave number."""

    def inverse(self) -> Floats:
        """(nx, ny//2+1) or (nx//2+1, ny//2+1) values > 0: approximately 1/symbol on the unpadded grid, for
        preconditioning. Here that of a half-space."""
        return 0.5 * wave_numbers(self.shape, self.pixel)

    def in_pixels(self, fine: Substrate, inverse: bool) -> Floats:
        """The symbol or its inverse in units of the pixels of ``fine``."""
        return self.inverse() * fine.unit if inverse else self.symbol() / fine.unit

    def regrid(self, shape: tuple[int, int]) -> Self:
        """The same body on another grid of the same extent."""
        pixel = (
            self.pixel[0] * self.shape[0] / shape[0],
            self.pixel[1] * self.shape[1] / shape[1],
        )
        return replace(self, shape=shape, pixel=pixel)

    @property
    def unit(self) -> float:
        """The root of the area of a pixel, nm."""
        return (
            self.pixel[0]
            if self.pixel[0] == self.pixel[1]
            else math.sqrt(self.pixel[0] * self.pixel[1])
        )

    def window(self, shape: tuple[int, int]) -> Self:
        """The same body with the same pixels on another extent; all lengths in units of the root of the area of a
        pixel. Equal windows have equal symbols and equal hashes."""
        return replace(
            self,
            shape=shape,
            pixel=(self.pixel[0] / self.unit, self.pixel[1] / self.unit),
        )


def fast_length(n: int) -> int:
    """The smallest length of at least n that transforms fast."""
    return int(sfft.next_fast_len(n, real=True) or n)


def wave_numbers(shape: tuple[int, int], pixel: tuple[float, float]) -> Floats:
    """|q| in 1/nm on the quarter (nx//2+1, ny//2+1) of the spectrum that symmetry leaves; half of its smallest other
    value instead of zero (1 on a grid of one pixel)."""
    qx = 2.0 * math.pi / (shape[0] * pixel[0]) * np.arange(shape[0] // 2 + 1)
    qy = 2.0 * math.pi / (shape[1] * pixel[1]) * np.arange(shape[1] // 2 + 1)
    q = np.add.outer(qx * qx, qy * qy)
    np.sqrt(q, out=q)
    others = [float(edge.min()) for edge in (q[1:, 0], q[0, 1:]) if edge.size]
    q[0, 0] = 0.5 * min(others, default=2.0)
    return q


@dataclass(frozen=True)
class PeriodicHalfSpace(Substrate):
    """Elastic half-space under a periodic pressure: symbol 2/|q|, zero at q = 0 (the mean plane is the reference)."""

    def symbol(self) -> Floats:
        q = wave_numbers(self.shape, self.pixel)
        values = np.divide(2.0, q, out=q)
        values[0, 0] = 0.0
        return values


@dataclass(frozen=True)
class PeriodicLayer(Substrate):
    """Elastic layer of ``thickness`` nm bonded to a rigid base or to an elastic half-space, periodic pressure on its
    face.

    symbol = 2/|q| · [1 + 4mqt e^(-2qt) - mn e^(-4qt)] / [1 - (m + n + 4m(qt)²) e^(-2qt) + mn e^(-4qt)] with t the
    thickness, m = (k - 1)/(k + 3 - 4ν), n = 1 - 4(1 - ν)/(1 + k(3 - 4ν₀)) and k the ratio of the shear moduli of layer
    and half-space (B. N. J. Persson, J. Phys.: Condens. Matter 24, 095008 (2012)). With k = 0 it is that on a rigid
    base (G. Carbone, L. Mangialardi, J. Mech. Phys. Solids 56, 684 (2008)), and at q = 0 the confined compression
    t(1-2ν)/(1-ν)²; else the mean plane is the reference.
    """

    thickness: float
    poisson: float = 0.25
    """ν, of the layer"""
    ratio: float = 0.0
    """k"""
    poisson_below: float = 0.25
    """ν₀, of the half-space"""

    def symbol(self) -> Floats:
        # Numerator and denominator times e^(2qt) and the denominators of m and n, over cosh 2qt: nothing overflows, and
        # all large terms are positive, so that neither a thin layer nor a rigid or soft half-space cancels.
        k, a, b = (
            self.ratio,
            3.0 - 4.0 * self.poisson_below,
            3.0 - 4.0 * self.poisson,
        )
        q = wave_numbers(self.shape, self.pixel)
        q[0, 0] = 1.0
        x = 2.0 * q * self.thickness
        sech = 2.0 * np.exp(-x) / (1.0 + np.exp(-2.0 * x))
        both = k * (1.0 + a) * (1.0 + b)
        even = 2.0 * k * k * a + k * (a - 1.0) * (b - 1.0) + 2.0 * b
        odd = 4.0 * k * k * a + k * (a - 1.0) * (b - 3.0) + 2.0 * (b - 1.0)
        # (sinh x - x)/cosh x and (cosh x - 1 - x²/2)/cosh x
        less_x = np.tanh(x) - x * sech
        _by_series(
            less_x,
            x,
            sech,
            0.3,
            x * np.square(x) / 6.0,
            (20.0, 42.0, 72.0, 110.0, 156.0),
        )
        less_parabola = 1.0 - (1.0 + 0.5 * x * x) * sech
        _by_series(
            less_parabola,
            x,
            sech,
            0.5,
            np.square(x) ** 2 / 24.0,
            (30.0, 56.0, 90.0, 132.0, 182.0),
        )
        numerator = both + even * less_x + odd * x * sech
        thin = (1.0 + b) * (1.0 + b + 0.5 * (k * (a - 1.0) + 2.0) * x * x)
        values = (
            2.0
            / q
            * numerator
            / (even * less_parabola + thin * sech + both * np.tanh(x))
        )
        nu = self.poisson
        values[0, 0] = (
            self.thickness * (1.0 - 2.0 * nu) / (1.0 - nu) ** 2 if k == 0.0 else 0.0
        )
        return values

    def inverse(self) -> Floats:
        values = self.symbol()
        if (
            values[0, 0] <= 0.0
        ):  # a uniform pressure does not move the reference: as the longest wave
            longest = [
                float(edge[0])
                for edge in (values[1:, 0], values[0, 1:])
                if edge.size
            ]
            values[0, 0] = min(longest, default=1.0)
        return 1.0 / values

    def window(self, shape: tuple[int, int]) -> Self:
        return replace(super().window(shape), thickness=self.thickness / self.unit)


@dataclass(frozen=True)
class FreeHalfSpace(Substrate):
    """Elastic half-space loaded nowhere else: displacements relative to infinity.

    Convolution with the exact displacement of a uniformly loaded rectangle (A. E. H. Love, Phil. Trans. R. Soc. A
    228, 377 (1929); K. L. Johnson, Contact Mechanics, Eq. 3.25), zero-padded so that images do not interact (R. W.
    Hockney, Methods Comput. Phys. 9, 135 (1970)).
    """

    periodic = False

    @property
    def padded(self) -> tuple[int, int]:
        nx, ny = (2 * n - 1 for n in self.shape)
        return fast_length(nx), fast_length(ny)

    def symbol(self) -> Floats:
        px, py = self.padded
        x = np.arange(px, dtype=np.float64)
        y = np.arange(py, dtype=np.float64)
        kernel = _love(
            np.minimum(x, px - x)[: px // 2 + 1],
            np.minimum(y, py - y)[: py // 2 + 1],
            self.pixel,
        )
        for n, axis in (
            (py, 1),
            (px, 0),
        ):  # an even array, of which there are the first n//2 + 1 entries
            rest = np.flip(
                np.take(kernel, np.arange(1, (n + 1) // 2), axis=axis), axis=axis
            )
            mirrored = np.concatenate([kernel, rest], axis=axis)
            spectrum = np.asarray(
                sfft.rfft(mirrored, axis=axis, overwrite_x=True), np.complex128
            )
            kernel = np.ascontiguousarray(spectrum.real)
        # The truncated kernel is positive definite on the unpadded pixels; negative values are rounding errors.
        return np.maximum(kernel, 0.0)


def _by_series(
    values: Floats,
    x: Floats,
    sech: Floats,
    below: float,
    leading: Floats,
    divisors: Sequence[float],
) -> None:
    """Put ``leading`` (1 + y/d₁ (1 + y/d₂ …)) sech, y = x², into ``values`` where x is small and they cancel."""
    small = x < below
    y = np.square(x[small])
    series = np.ones(y.shape)
    for divisor in reversed(divisors):
        series = 1.0 + y / divisor * series
    values[small] = leading[small] * series * sech[small]


def _love(x: Floats, y: Floats, pixel: tuple[float, float]) -> Floats:
    """Displacement (times E*, per unit pressure, nm) at pixel distances x, y from the centre of a loaded pixel."""
    ax, ay = pixel

    def corner(sx: float, sy: float) -> Floats:
        # Antiderivative of 1/r: x asinh(y/|x|) + y asinh(x/|y|); pixel corners are at half-integers, so x and y are
        # never zero.
        xs = ((x + sx) * ax)[:, None]
        ys = ((y + sy) * ay)[None, :]
        return xs * np.arcsinh(ys / np.abs(xs)) + ys * np.arcsinh(xs / np.abs(ys))

    return (
        corner(0.5, 0.5)
        - corner(0.5, -0.5)
        - corner(-0.5, 0.5)
        + corner(-0.5, -0.5)
    ) / math.pi
