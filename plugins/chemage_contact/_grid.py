"""The contact problem on one grid: heights, the operator of the substrate as a convolution, and how the kernels run
over its blocks; and other grids of the same extent, with pressures and heights on them.

**Fourier transforms** with a choice of library: ``scipy`` (pocketfft, BSD licence) is always available; ``ducc0`` (GPL
v2+), ``pyfftw`` (BSD wrapper around FFTW, which is GPL v2+) and ``mkl_fft`` (BSD wrapper around Intel's proprietary
MKL) are used if they are installed and the user requests them by name.

**The split operator**, a stencil for what is near and a coarse grid for what is far, is the idea of multilevel
multi-integration (A. Brandt, A. A. Lubrecht, J. Comput. Phys. 90, 348 (1990)) and of particle-particle particle-mesh
sums (R. W. Hockney, J. W. Eastwood, Computer Simulation Using Particles), on a pixel grid: symbol = W·symbol + (1 -
W)·symbol with a Gaussian W that the coarse grid resolves. The coarse part goes through restriction, a Fourier transform
on the coarse grid and interpolation; the rest is a stencil of nine by nine pixels, fitted so that the relative error
over all wave vectors is smallest. It costs a fraction of the Fourier transform of the fine grid, even less where little
is in contact, and is accurate to about 10 %: not enough for a solution, but enough to compute corrections to one. A
coarse pixel is ``RATIO`` fine ones wide, or slightly less where the coarse grid then transforms faster; the stencil is
the same.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

from chemage import InputError
from chemage.plugin import algebra

from . import _kernels as kernels
from ._kernels import DescentState, Heights
from ._operators import Active, Substrate, Team, fast_length

Array = NDArray[Any]
Floats = NDArray[np.float64]

#: Number of pixels below which another thread gains nothing.
SHARED = 1 << 19
#: Names of the libraries' packages.
PACKAGES = {"ducc0": "ducc0", "pyfftw": "pyfftw", "mkl_fft": "mkl-fft mkl-service"}
RATIO = kernels.RATIO
#: width of the Gaussian in fine pixels: its tail at the coarse Nyquist wave number is 0.008
SPREAD = 0.7 * RATIO
#: pixels of the grid on which the stencil is fitted
SAMPLE = 64


class Transforms:
    """Forward and backward transforms between real (nx, ny) and half spectra (px, py//2+1), zero-padded to ``padded``
    = (px, py).

    ``count`` is the number of transforms made. Raises ``InputError`` if the library is not installed.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        padded: tuple[int, int],
        library: str,
        workers: int,
    ) -> None:
        self.shape, self.padded, self.library = shape, padded, library
        self.workers = workers if padded[0] * padded[1] >= SHARED else 1
        self.count = 0
        if library == "scipy":
            self._module: Any = sfft
            return
        name = (
            "ducc0.fft" if library == "ducc0" else f"{library}.interfaces.scipy_fft"
        )
        try:
            self._module = importlib.import_module(name)
            if library == "pyfftw":
                importlib.import_module("pyfftw.interfaces.cache").enable()
        except ImportError as error:
            remedy = f"pip install {PACKAGES[library]}, or choose 'scipy', which is always available"
            raise InputError.of(
                "fft", library, f"cannot be imported ({error})", remedy
            ) from error

    def forward(self, x: Array) -> Array:
        """Half spectrum of x, which is not changed."""
        self.count += 1
        if self.library == "scipy":
            # Axis by axis: rows that are only padding are never transformed, and the second pass is in place.
            rows = sfft.rfft(x, n=self.padded[1], axis=1, workers=self.workers)
            return np.asarray(
                sfft.fft(
                    rows,
                    n=self.padded[0],
                    axis=0,
                    overwrite_x=True,
                    workers=self.workers,
                )
            )
        if x.shape != self.padded:
            x = np.pad(
                x,
                [
                    (0, most - n)
                    for most, n in zip(self.padded, x.shape, strict=True)
                ],
            )
        if self.library == "ducc0":
            return self._module.r2c(x, axes=(0, 1), nthreads=self.workers)
        return np.ascontiguousarray(self._module.rfft2(x, workers=self.workers))

    def backward(self, spectrum: Array) -> Array:
        """The real array of a half spectrum, cropped to ``shape``; the spectrum is destroyed."""
        self.count += 1
        (nx, ny), columns = self.shape, self.padded[1]
        if self.library == "scipy":
            rows = np.asarray(
                sfft.ifft(spectrum, axis=0, overwrite_x=True, workers=self.workers)
            )[:nx]
            x = np.asarray(
                sfft.irfft(
                    rows, n=columns, axis=1, overwrite_x=True, workers=self.workers
                )
            )
        elif self.library == "ducc0":
            options = {
                "lastsize": columns,
                "forward": False,
                "inorm": 2,
                "nthreads": self.workers,
            }
            x = self._module.c2r(spectrum, axes=(0, 1), **options)
        else:
            x = self._module.irfft2(spectrum, s=self.padded, workers=self.workers)
        return np.ascontiguousarray(x[:nx, :ny])

    def in_place(self, z: Array, forward: bool) -> Array:
        """The complex transform of z, or the inverse one, in the memory of z if the library can; use the return value.

        If z is a view of a real array (pairs of neighbours as complex numbers), this transforms that array without
        memory for a spectrum, which would take longer to allocate than a pass over it.
        """
        self.count += 1
        if self.library == "ducc0":
            norm = 0 if forward else 2
            return self._module.c2c(
                z,
                axes=(0, 1),
                forward=forward,
                inorm=norm,
                out=z,
                nthreads=self.workers,
            )
        transform = self._module.fft2 if forward else self._module.ifft2
        return np.ascontiguousarray(
            transform(z, overwrite_x=True, workers=self.workers)
        )


class Convolution:
    """The operator of a substrate in one precision, in pixel units: displacement = symbol/pixel applied to pressure.

    ``symbol`` is ``substrate.symbol()``, which takes a while to compute. ``floating``: the offset of the gap is
    unknown, so that the displacement under the mean pressure is left out where it is uniform (periodic substrates).
    """

    def __init__(
        self,
        substrate: Substrate,
        symbol: Array,
        dtype: Any,
        library: str,
        team: Team,
        *,
        floating: bool,
    ) -> None:
        self.shape, self.dtype, self.team = substrate.shape, np.dtype(dtype), team
        self.unit = substrate.unit
        periodic = substrate.padded == substrate.shape
        self._transforms = Transforms(
            substrate.shape, substrate.padded, library, team.threads
        )
        self._unpadded = self._transforms
        if not periodic:
            self._unpadded = Transforms(
                substrate.shape, substrate.shape, library, team.threads
            )
        self._symbol = (symbol / self.unit).astype(self.dtype)
        if floating and periodic:
            self._symbol[0, 0] = (
                0.0  # a uniform displacement only shifts the offset, but its rounding exceeds the rest
            )
        self._inverse: Array | None = None
        #: of the preconditioner for a uniform residual, once it was used
        self.stiffness = 0.0
        self._substrate = substrate
        self._buffer: Array | None = None
        self._turn: Array | None = None
        if periodic and substrate.shape[1] % 2 == 0:
            angles = (
                2.0
                * math.pi
                / substrate.shape[1]
                * np.arange(substrate.shape[1] // 2)
            )
            self._turn = np.exp(-1j * angles).astype(
                np.result_type(self.dtype, np.complex64)
            )

    @property
    def transforms(self) -> int:
        """Transforms made so far."""
        return self._transforms.count + (
            self._unpadded.count if self._unpadded is not self._transforms else 0
        )

    @cached_property
    def response(self) -> float:
        """Root of the mean squared symbol: rms displacement under random pressures of unit rms."""
        rows, columns = self._transforms.padded
        weight = np.full(self._symbol.shape[1], 2.0)
        weight[0] = 1.0
        if columns % 2 == 0 and columns > 1:
            weight[-1] = 1.0
        squares = np.einsum(
            "ij,j->i", np.square(self._symbol, dtype=np.float64), weight
        )
        if squares.size != rows:
            squares[1 : (rows + 1) // 2] *= 2.0
        return math.sqrt(float(squares.sum()) / (rows * columns))

    def spectrum(self, x: Array) -> Array:
        """Transform of x (nx, ny), zero-padded."""
        return self._transforms.forward(x)

    def energy(self, spectrum: Array) -> float:
        """xᵀGx from the spectrum of x, by Parseval's theorem."""
        rows, columns = self._transforms.padded
        part = self.team.table(
            kernels.quadratic_form,
            spectrum.shape[0],
            1,
            spectrum,
            self._symbol,
            columns,
        )
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
            self._inverse = (self._substrate.inverse() * self.unit).astype(
                self.dtype
            )
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
        z = self._unpadded.in_place(
            buffer.view(np.result_type(self.dtype, np.complex64)), True
        )
        self.team.run(kernels.multiply_packed, nx // 2 + 1, z, symbol, self._turn)
        return self._unpadded.in_place(z, False).view(self.dtype)


def suits(body: Substrate) -> bool:
    """Whether the grid is periodic and large enough for the split operator to pay."""
    return body.padded == body.shape and min(body.shape) >= 2 * SAMPLE


class Split:
    """Approximately a convolution on the grid of ``body``: with its symbol, or with the inverse one."""

    def __init__(
        self,
        body: Substrate,
        dtype: Any,
        library: str,
        team: Team,
        *,
        inverse: bool,
        floating: bool,
    ) -> None:
        self._run = team.run
        nx, ny = body.shape
        coarse = (
            fast_length(math.ceil(nx / RATIO)),
            fast_length(math.ceil(ny / RATIO)),
        )
        self._axes = (
            along_rows(nx, coarse[0], dtype),
            along_columns(ny, coarse[1], dtype),
        )
        self._transforms = Transforms(coarse, coarse, library, team.threads)
        far = body.regrid(coarse).in_pixels(body, inverse) * _far(
            body.shape, coarse
        )
        #: of the inverse operator for a uniform displacement
        self.stiffness = float(far[0, 0])
        if floating:
            far[0, 0] = 0.0
        self._far = _whole(
            far / (nx / coarse[0] * (ny / coarse[1])), coarse[0]
        ).astype(dtype)
        self._stencil = _stencil(body.window((SAMPLE, SAMPLE)), inverse).astype(
            dtype
        )
        self._coarse = np.empty(coarse, dtype)

    def apply(self, x: Array, active: Active, out: Array, part: Array) -> Array:
        """The convolution of x (nx, ny; zero in blocks that are not active) in active blocks of ``out``.

        Σ x·out over each block is in ``part[:, 0]`` afterwards.
        """
        size = len(self._coarse)
        edges = [edge * size // len(x) for edge in active.row_edges]
        across = x, *self._axes, self._coarse
        self._run(kernels.restrict, edges, active.blocks, *across)
        spectrum = self._transforms.forward(self._coarse)
        spectrum *= self._far
        far = self._transforms.backward(spectrum)
        fields = x, self._stencil, far, *self._axes, out, part
        self._run(kernels.local, active.row_edges, active.blocks, *fields)
        return out


def along_rows(fine: int, coarse: int, dtype: Any) -> kernels.Interpolation:
    """Interpolation along an axis of ``coarse`` pixels to one of ``fine``, periodic."""
    place = np.arange(fine) * coarse
    lower = place // fine
    weight = (place - lower * fine) / fine
    return kernels.Interpolation(lower, (lower + 1) % coarse, weight.astype(dtype))


def along_columns(fine: int, coarse: int, dtype: Any) -> kernels.Taps:
    """The same, as the kernels take it along columns."""
    place = np.arange(coarse) * fine
    begin = -(-place // coarse)
    last = np.append(np.diff(begin) != kernels.RATIO, True)
    last[-2:] = True
    ends = np.flatnonzero(last) + 1
    along = np.arange(kernels.REACH + 1)[:, None] * coarse
    before, behind = (
        np.maximum(1 - np.abs(begin * coarse - place + side) / fine, 0)
        for side in (-along, along)
    )
    return kernels.Taps(
        np.dtype(dtype).type(coarse / fine),
        begin.astype(np.uint64),
        ((begin * coarse - place) / coarse).astype(dtype),
        np.repeat(ends, np.diff(ends, prepend=0)).astype(np.uint64),
        (0.5 * (before + behind)).astype(dtype),
        (0.5 * (behind - before)).astype(dtype),
    )


def _whole(quarter: Array, rows: int) -> Array:
    """A symbol on all rows of a half spectrum."""
    if quarter.shape[0] == rows:
        return quarter
    return np.concatenate([quarter, quarter[1 : rows - quarter.shape[0] + 1][::-1]])


def _hat(q: NDArray[np.floating[Any]], ratio: float = RATIO) -> Floats:
    """Transform of the hat function over ``ratio``, at wave numbers per fine pixel: 1 at zero."""
    half = np.where(q == 0.0, 1.0, 0.5 * q)
    return (
        np.where(q == 0.0, 1.0, np.sin(half * ratio) / (ratio * np.sin(half))) ** 2
    )


def _far(fine: tuple[int, int], coarse: tuple[int, int]) -> Floats:
    """What the coarse symbol is multiplied by: the Gaussian, and the inverse of restriction and interpolation."""
    qx = 2.0 * np.pi / fine[0] * np.arange(coarse[0] // 2 + 1)[:, None]
    qy = 2.0 * np.pi / fine[1] * np.arange(coarse[1] // 2 + 1)[None, :]
    hats = _hat(qx, fine[0] / coarse[0]) * _hat(qy, fine[1] / coarse[1])
    return np.exp(-(SPREAD**2) * (qx**2 + qy**2)) / hats**2


@lru_cache(maxsize=64)
def _stencil(window: Substrate, inverse: bool) -> Floats:
    """Stencil (REACH + 1, REACH + 1) of a body that best adds what the coarse grid leaves out, in the relative sense.
    That of a half-space is the same on all grids."""
    half = SAMPLE // 2 + 1
    q = 2.0 * np.pi / SAMPLE * np.arange(half)
    full = _whole(_whole(window.in_pixels(window, inverse), SAMPLE)[:half], half)
    # The coarse spectrum repeats on the fine one.
    m = SAMPLE // RATIO
    far = window.regrid((m, m)).in_pixels(window, inverse) * _far(
        (SAMPLE, SAMPLE), (m, m)
    )
    index = np.arange(half) % m
    index = np.minimum(index, m - index)
    rest = full - far[np.ix_(index, index)] * np.outer(_hat(q), _hat(q)) ** 2
    weight = 1.0 / np.maximum(full, 1e-3 * full.ravel()[1:].max())
    weight[0, 0] = 0.0
    # Rows and columns of the quarter stand for two, except the first and last.
    twice = np.where((np.arange(half) % (half - 1)) == 0, 1.0, 2.0)
    weight *= np.sqrt(np.outer(twice, twice))
    reach = np.arange(kernels.REACH + 1)
    pairs = np.argwhere(np.hypot(reach[:, None], reach) <= kernels.REACH + 0.3)
    cosine = np.cos(np.outer(reach, q)) * np.where(reach == 0, 1, 2)[:, None]
    matrix = np.stack(
        [(np.outer(cosine[a], cosine[b]) * weight).ravel() for a, b in pairs],
        axis=1,
    )
    # Without BLAS, whose sums differ between processors.
    normal = np.einsum("ka,kb->ab", matrix, matrix)
    values = algebra.solve(
        normal, np.einsum("ka,k->a", matrix, (rest * weight).ravel())
    )
    stencil = np.zeros((reach.size, reach.size))
    stencil[tuple(pairs.T)] = values
    return stencil


Precision = Literal["single", "double", "mixed"]

#: dtypes of state and work
PRECISIONS: dict[str, tuple[type[np.floating[Any]], type[np.floating[Any]]]] = {
    "single": (np.float32, np.float32),
    "mixed": (np.float64, np.float32),
    "double": (np.float64, np.float64),
}
#: Coarse grids are never smaller than this number of pixels along an edge.
COARSEST = 48


@dataclass
class Settings:
    """How to solve; the same on all grids."""

    tolerance: float = 1e-5
    precision: Precision = "mixed"
    max_iterations: int = 500
    levels: int | None = None
    library: str = "scipy"
    #: largest estimated L2 error of the pressure, relative to its norm
    pressure_tolerance: float | None = None
    #: an entry of ``_descent.METHODS``: 0 uses every acceleration
    method: int = 0


class GridProblem:
    """The problem on one grid, and sums over its blocks."""

    def __init__(
        self,
        substrate: Substrate,
        heights: Heights,
        stiffness: float,
        mean: float,
        offset: float | None,
        settings: Settings,
        team: Team,
        finest: bool = True,
        hardness: float | None = None,
    ) -> None:
        self.substrate, self.settings, self.team = substrate, settings, team
        #: given if the approach is prescribed, None if the load is
        self.offset_fixed = offset
        self.floating = offset is None
        #: sum of the dimensionless pressure, if the load is prescribed; else its order of magnitude
        self.load = mean * substrate.shape[0] * substrate.shape[1]
        self.mean, self.finest = mean, finest
        self.state, self.work = PRECISIONS[settings.precision]
        #: largest dimensionless pressure, in the precision of the state
        self.hardness = None if hardness is None else bounded(hardness, self.state)
        self.heights = heights
        #: displacement = stiffness · (pixel-unit operator applied to dimensionless pressure)
        self.stiffness = stiffness
        symbol = substrate.symbol()
        self.operator = Convolution(
            substrate,
            symbol,
            self.work,
            settings.library,
            team,
            floating=self.floating,
        )
        padded = substrate.padded != substrate.shape
        #: displacement under the mean pressure, which the operator leaves out where the offset is unknown
        self.uniform = (
            0.0
            if padded or not self.floating
            else float(symbol[0, 0]) / self.operator.unit
        )
        self._symbol = symbol if self.state != self.work else None
        self._double = self.operator if self.work == np.float64 else None
        nx, ny = substrate.shape
        self.width, self.per_row = kernels.widths(ny)
        blocks = nx * self.per_row
        #: sums of the last kernel, block by block
        self.part = np.zeros((blocks, 7))
        #: sums of ``kernels.residual``, which outlast those of other kernels
        self.residual_part = np.zeros((blocks, 6))
        self.everywhere = self.active(np.ones(blocks, np.bool_))
        self.history: list[tuple[float, float]] = []

    @property
    def transforms(self) -> int:
        """Fourier transforms of the full grid so far."""
        double = (
            self._double.transforms
            if self._double is not None and self._double is not self.operator
            else 0
        )
        return self.operator.transforms + double

    def exact(self) -> Convolution:
        """The operator in the precision of the state."""
        return self.operator if self.state == self.work else self.double()

    def double(self) -> Convolution:
        """The operator in double precision."""
        if self._double is None:
            symbol = (
                self.substrate.symbol() if self._symbol is None else self._symbol
            )
            make = (
                self.substrate,
                symbol,
                np.float64,
                self.settings.library,
                self.team,
            )
            self._double = Convolution(*make, floating=self.floating)
        return self._double

    def gap(self, operator: Convolution, base: float, state: DescentState) -> None:
        """The gap G p - h + base, in the precision of the operator, into ``state.r``.

        The sums of the gap and of the free pixels are in ``part`` afterwards.
        """
        u = operator.apply(state.p)
        fields = u, self.heights, self.stiffness, base, state, self.hardness
        self.run(kernels.subtract, self.everywhere, *fields, self.part)

    def run(self, kernel: Callable[..., None], active: Active, *args: Any) -> None:
        """Run a kernel over the active blocks."""
        self.team.run(kernel, active.block_edges, active.blocks, *args)

    def sums(self, columns: int) -> list[float]:
        """The first columns of ``part``, summed over all blocks."""
        return [float(x) for x in self.part[:, :columns].sum(axis=0)]

    def active(self, mask: Array) -> Active:
        """The blocks in ``mask``, ready for the kernels."""
        return Active(mask, self.width, self.per_row, self.team.threads)

    def working_set(self, reach: int) -> Active:
        """Blocks with a pixel of the working set or with pressure in them or up to ``reach`` rows away."""
        here = self.residual_part[:, 2] > 0.0
        if self.hardness is not None:
            here |= self.residual_part[:, 4] > 0.0
        here = here.reshape(-1, self.per_row)
        near = here.copy()
        for shift in range(1, min(reach, len(here) - 1) + 1):
            near[shift:] |= here[:-shift]
            near[:-shift] |= here[shift:]
            near[:shift] |= here[-shift:]
            near[-shift:] |= here[:shift]
        return self.active(near.ravel())


def sums(p: Array, r: Array, team: Team) -> tuple[float, float, float]:
    """Σ p, Σ p·|r| and the least p, of two arrays (nx, ny)."""
    part = team.table(kernels.totals, p.shape[0], 3, p, r)
    return (
        float(part[:, 0].sum()),
        float(part[:, 1].sum()),
        float(part[:, 2].min(initial=math.inf)),
    )


def rescale(p: Array, factor: float, team: Team, hardness: Any = None) -> float:
    """Multiply p (nx, ny) in place, up to ``hardness`` and except where p is it already; returns the new sum."""
    return float(
        team.table(
            kernels.scale, p.shape[0], 1, p, p.dtype.type(factor), hardness
        ).sum()
    )


def bounded(hardness: float, dtype: Any) -> Any:
    """The largest number of ``dtype`` that is not above ``hardness``."""
    value = dtype(hardness)
    return value if float(value) <= hardness else np.nextafter(value, dtype(0))


def grids(shape: tuple[int, int], levels: int | None) -> list[tuple[int, int]]:
    """Grids from fine to coarse: halved, to lengths that transform fast. ``levels`` counts all of them."""
    out = [shape]
    while levels is None or len(out) < levels:
        nx, ny = (
            n if n < COARSEST else 4 * fast_length(math.ceil(n / 8))
            for n in out[-1]
        )
        if (nx, ny) == out[-1] or (levels is None and max(nx, ny) < COARSEST):
            break
        out.append((nx, ny))
    return out


def resampled(
    source: Array,
    shape: tuple[int, int],
    dtype: Any,
    periodic: bool,
    team: Team,
    kernel: Callable[..., None] = kernels.resample,
    *bounds: Any,
) -> Array:
    """Bilinear resampling of (nx, ny) to another grid of the same extent whose first pixels coincide."""
    axes = []
    for n, m in zip(source.shape, shape, strict=True):
        x = np.arange(m) * (n / m)
        low = np.minimum(x.astype(np.int64), n - 1)
        high = (low + 1) % n if periodic else np.minimum(low + 1, n - 1)
        axes.append(kernels.Interpolation(low, high, x - low))
    target = np.empty(shape, dtype)
    team.run(kernel, shape[0], source, *axes, *bounds, target)
    return target


def dimensionless(heights: Heights, dtype: Any, team: Team) -> Array:
    """The dimensionless heights as an array (nx, ny)."""
    out = np.empty(heights.values.shape, dtype)
    team.run(kernels.standardise, len(out), heights, out)
    return out
