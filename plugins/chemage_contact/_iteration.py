"""The hard-wall contact problem on arrays: minimise ½ pᵀGp - pᵀh over p ≥ 0 at a given load or a given approach.

The gradient is the gap, so the solution satisfies p ≥ 0, gap ≥ 0, p·gap = 0. Method:

* Conjugate gradients on the working set {p > 0} ∪ {gap < 0}, clipped to p ≥ 0 after an exact line search, restarted only when the direction
  is not one of descent: I. A. Polonsky, L. M. Keer, Wear 231, 206 (1999) without its restarts, after L. Bugnicourt, P. Sainsot,
  D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29 (2018).
* Preconditioner of opposite order: the inverse symbol |q|, restricted to the working set: E. A. H. Vollebregt, J. Optim. Theory Appl. 162,
  862 (2014).
* Coarse to fine: each grid starts from the interpolated solution of the next coarser one.
* Mixed precision by iterative refinement: pressure and gap are kept in double precision, but only *changes* of the gap are ever computed, in
  single precision, so that their rounding errors shrink with the changes.
* The step length comes from Parseval's theorem, and a step that clips nothing reuses the spectrum of its direction: four or five transforms
  per iteration.

Everything is made dimensionless: heights in units of their rms value, measured down from the highest point; pressure in units of its mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

from . import _kernels as kernels
from ._operators import Substrate
from ._transforms import Transforms

Array = NDArray[Any]
Precision = Literal["single", "double", "mixed"]

#: state and work precision
PRECISIONS: dict[str, tuple[type[np.floating[Any]], type[np.floating[Any]]]] = {
    "single": (np.float32, np.float32),
    "mixed": (np.float64, np.float32),
    "double": (np.float64, np.float64),
}
#: Iterations without halving the error after which the method in use counts as stalled.
PATIENCE = 40
#: A coarse grid is only a start: solved this well, and never smaller than this many pixels along an edge.
COARSE_TOLERANCE = 1e-3
COARSEST = 48


class Team:
    """Runs a kernel over whole blocks on a few threads; the kernels release the interpreter lock."""

    def __init__(self, threads: int) -> None:
        self.threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None

    def run(self, kernel: Callable[..., None], count: int, *args: Any) -> None:
        if self._pool is None or count < 64:
            kernel(0, count, *args)
            return
        edges = [count * k // self.threads for k in range(self.threads + 1)]
        for job in [self._pool.submit(kernel, a, b, *args) for a, b in zip(edges, edges[1:], strict=False)]:
            job.result()

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()


class Convolution:
    """A substrate's operator in one precision, in pixel units: displacement = symbol/pixel applied to pressure."""

    def __init__(self, body: Substrate, dtype: Any, library: str, team: Team) -> None:
        self.shape, self.dtype, self.team = body.shape, np.dtype(dtype), team
        self.unit = math.sqrt(body.pixel[0] * body.pixel[1])
        self._transforms = Transforms(body.shape, body.padded, library, team.threads)
        self._plain = self._transforms
        if body.padded != body.shape:
            self._plain = Transforms(body.shape, body.shape, library, team.threads)
        self._symbol = (body.symbol() / self.unit).astype(self.dtype)
        self._inverse: Array | None = None
        self._body = body

    @property
    def transforms(self) -> int:
        """Transforms made so far."""
        return self._transforms.count + (self._plain.count if self._plain is not self._transforms else 0)

    def spectrum(self, x: Array) -> Array:
        """Transform of x (nx, ny), zero-padded."""
        return self._transforms.forward(x)

    def energy(self, spectrum: Array) -> float:
        """xᵀGx from the spectrum of x, by Parseval's theorem."""
        rows, columns = self._transforms.padded
        part = np.zeros((spectrum.shape[0], 1))
        self.team.run(kernels.quadratic_form, spectrum.shape[0], spectrum, self._symbol, columns, part)
        return float(part.sum()) / (rows * columns)

    def displacement(self, spectrum: Array) -> Array:
        """Gx from the spectrum of x, which is destroyed."""
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, self._symbol)
        return self._transforms.backward(spectrum)

    def apply(self, x: Array) -> Array:
        """Gx of a pressure x (nx, ny), rounded to this precision first."""
        return self.displacement(self.spectrum(np.asarray(x, dtype=self.dtype)))

    def precondition(self, v: Array) -> Array:
        """Approximately G⁻¹v."""
        if self._inverse is None:
            self._inverse = (self._body.inverse() * self.unit).astype(self.dtype)
        spectrum = self._plain.forward(v)
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, self._inverse)
        return self._plain.backward(spectrum)


@dataclass
class Settings:
    """How to solve; the same on all grids."""

    tolerance: float = 1e-5
    precision: Precision = "mixed"
    max_iterations: int = 500
    levels: int | None = None
    library: str = "scipy"
    threads: int = 1
    precondition: bool = True


@dataclass
class Result:
    """A solution in dimensionless units. ``pressure`` (mean 1 under load control), ``gap`` (rms heights), both (nx, ny)."""

    pressure: Array
    gap: Array
    offset: float
    rms_gap: float
    penetration: float
    converged: bool
    iterations: int
    transforms: int
    history: list[tuple[float, float]]
    levels: list[tuple[tuple[int, int], int]]
    notes: list[str] = field(default_factory=list)

    @property
    def error(self) -> float:
        """The larger of the two errors that convergence is judged by."""
        return max(self.rms_gap, self.penetration)


class _Grid:
    """The iteration on one grid."""

    def __init__(
        self, body: Substrate, heights: Array, stiffness: float, offset: float | None, settings: Settings, team: Team
    ):
        self.body, self.settings, self.team, self.offset_fixed = body, settings, team, offset
        self.state, self.work = PRECISIONS[settings.precision]
        self.h = heights
        #: displacement = stiffness · (pixel-unit operator applied to dimensionless pressure)
        self.kappa = stiffness
        self.operator = Convolution(body, self.work, settings.library, team)
        self._exact = self.operator if self.state == self.work else None
        self.blocks = kernels.blocks(heights.size)
        self.part = kernels.partial_sums(self.blocks)
        self.active = kernels.partial_sums(self.blocks)
        self.history: list[tuple[float, float]] = []

    @property
    def transforms(self) -> int:
        exact = self._exact.transforms if self._exact is not None and self._exact is not self.operator else 0
        return self.operator.transforms + exact

    def gap(self, p: Array) -> Array:
        """Gap before the offset, G p - h, evaluated in the precision of the state."""
        if self._exact is None:
            self._exact = Convolution(self.body, self.state, self.settings.library, self.team)
        u = self._exact.apply(p)
        r = u if u.dtype == self.state else np.empty(p.shape, self.state)
        self.team.run(kernels.subtract, self.blocks, u.ravel(), self.h.ravel(), self.kappa, r.ravel())
        return r

    def _sum(self, table: Array, columns: int) -> list[float]:
        return [float(x) for x in table[:, :columns].sum(axis=0)]

    def solve(
        self, p: Array, tolerance: float, limit: int
    ) -> tuple[Array, Array, float, float, float, bool, int, list[str]]:
        """Iterate from p (nx, ny, state precision, changed in place) until both errors are below tolerance."""
        team, blocks, part, active = self.team, self.blocks, self.part, self.active
        load = float(p.size)
        flat = p.ravel()
        v = np.empty(p.shape, self.work)
        d = np.zeros(p.shape, self.work)
        y = d
        notes: list[str] = []
        precondition = self.settings.precondition
        fresh, steepest = True, True
        r = self.gap(p)
        team.run(kernels.contact_sums, blocks, flat, r.ravel(), part)
        refreshed = best = math.inf
        best_at = iteration = 0
        while True:
            total, count, _ = self._sum(part, 3)
            offset = (
                self.offset_fixed if self.offset_fixed is not None else (-total / count if count else -float(r.min()))
            )
            team.run(kernels.residual, blocks, flat, r.ravel(), offset, v.ravel(), active)
            squares, _, size, sum_v = self._sum(active, 4)
            rms = math.sqrt(squares / count) if count else 0.0
            deepest = float(active[:, 1].max())
            error = max(rms, deepest)
            if fresh:
                improving = error < 0.5 * refreshed
                refreshed = error
            if len(self.history) < iteration + 1:
                self.history.append((rms, deepest))
            else:
                self.history[iteration] = (rms, deepest)
            if not math.isfinite(error):
                return (
                    p,
                    r,
                    offset,
                    rms,
                    deepest,
                    False,
                    iteration,
                    [*notes, "the iteration produced numbers that are not finite"],
                )
            if error < tolerance and fresh:
                return p, r, offset, rms, deepest, True, iteration, notes
            if error < tolerance or error < 1e-5 * refreshed:
                # Below this the rounding of the accumulated changes would show: take stock in full precision.
                r = self.gap(p)
                team.run(kernels.contact_sums, blocks, flat, r.ravel(), part)
                fresh = True
                continue
            if error < 0.5 * best:
                best, best_at = error, iteration
            if iteration >= limit:
                return p, r, offset, rms, deepest, False, iteration, notes
            if iteration - best_at >= PATIENCE:
                if not precondition:
                    return p, r, offset, rms, deepest, False, iteration, notes
                precondition, steepest, best_at = False, True, iteration
                notes.append(f"the preconditioner was switched off after {iteration} iterations without progress")
            iteration += 1
            # Direction
            z = self.operator.precondition(v) if precondition else v
            team.run(kernels.products, blocks, active, v.ravel(), z.ravel(), d.ravel(), y.ravel(), part)
            sz, szv, sd, sdv, szy, sdy, sy = self._sum(part, 7)
            zm, dm = (sz / size, sd / size) if self.offset_fixed is None else (0.0, 0.0)
            zv, zy, dv, dy = szv - zm * sum_v, szy - zm * sy, sdv - dm * sum_v, sdy - dm * sy
            beta = -zy / dy if not steepest and dy > 0.0 else 0.0
            if beta < 0.0 or zv + beta * dv <= 0.0:
                beta = 0.0
            slope = zv + beta * dv
            team.run(kernels.direction, blocks, active, v.ravel(), z.ravel(), d.ravel(), beta, zm + beta * dm, part)
            largest = float(part[:, 0].max())
            # Step
            spectrum = self.operator.spectrum(d)
            curvature = self.kappa * self.operator.energy(spectrum)
            step = slope / curvature if curvature > 0.0 else math.inf
            # A vanishing load makes the body look infinitely soft; no pixel needs more than the whole load.
            step = min(step, 1e3 * load / largest) if largest > 0.0 else 0.0
            team.run(kernels.clipped, blocks, active, flat, d.ravel(), step, part)
            new_load, cut = self._sum(part, 2)
            scale = load / new_load if cut and self.offset_fixed is None else 1.0
            team.run(kernels.move, blocks, active, flat, d.ravel(), step, scale)
            if cut:
                y = self.operator.displacement(self.operator.spectrum(d))
                factor = self.kappa
            else:
                y = self.operator.displacement(spectrum)
                factor = self.kappa * step
            team.run(kernels.advance, blocks, flat, r.ravel(), y.ravel(), factor, part)
            fresh, steepest = False, False


def resampled(source: Array, shape: tuple[int, int], dtype: Any, periodic: bool, team: Team) -> Array:
    """Bilinear resampling of (nx, ny) to another grid of the same extent whose first pixels coincide."""
    tables = []
    for n, m in zip(source.shape, shape, strict=True):
        x = np.arange(m) * (n / m)
        low = np.minimum(x.astype(np.int64), n - 1)
        tables += [low, (low + 1) % n if periodic else np.minimum(low + 1, n - 1), x - low]
    target = np.empty(shape, dtype)
    team.run(kernels.resample, shape[0], source, *tables, target)
    return target


def projected(q: Array) -> Array:
    """The nearest array to q that has no negative entry and the mean 1: max(q - t, 0)."""
    order = np.sort(q, axis=None)[::-1].astype(np.float64)
    excess = np.cumsum(order) - q.size
    index = np.arange(1, q.size + 1)
    last = int(np.flatnonzero(order * index > excess)[-1])
    return np.maximum(q - excess[last] / (last + 1), 0.0)


def grids(shape: tuple[int, int], levels: int | None) -> list[tuple[int, int]]:
    """Grids from fine to coarse: halved, to lengths that transform fast. ``levels`` counts all of them."""
    out = [shape]
    while levels is None or len(out) < levels:
        nx, ny = (n if n < COARSEST else sfft.next_fast_len(math.ceil(n / 2), real=True) for n in out[-1])
        if (nx, ny) == out[-1] or (levels is None and max(nx, ny) < COARSEST):
            break
        out.append((nx, ny))
    return out


def solve(
    body: Substrate,
    heights: Array,
    *,
    stiffness: float,
    offset: float | None = None,
    start: Array | None = None,
    settings: Settings,
) -> Result:
    """Solve on ``body`` for dimensionless ``heights`` (nx, ny; rms 1, highest point 0, state precision).

    ``stiffness`` is (unit of pressure)·pixel/(E*·unit of height). With ``offset`` None the mean pressure is 1; otherwise the gap is
    G p - h + offset and the load follows (negative: approach since first touch). ``start`` is a pressure to begin from instead of a coarser
    grid. Never raises for lack of convergence: look at ``converged``.
    """
    team = Team(settings.threads)
    try:
        return _solve(body, heights, stiffness, offset, start, settings, team)
    finally:
        team.close()


def _solve(
    body: Substrate,
    heights: Array,
    stiffness: float,
    offset: float | None,
    start: Array | None,
    settings: Settings,
    team: Team,
) -> Result:
    state = PRECISIONS[settings.precision][0]
    shapes = grids(body.shape, 1 if start is not None else settings.levels)
    levels: list[tuple[tuple[int, int], int]] = []
    notes: list[str] = []
    transforms = 0
    p = start
    for depth in range(len(shapes) - 1, -1, -1):
        shape = shapes[depth]
        here = body if depth == 0 else body.regrid(shape)
        h = heights if depth == 0 else resampled(heights, shape, state, body.periodic, team)
        # Displacements are counted in pixels of the grid at hand.
        kappa = stiffness * math.sqrt(here.pixel[0] * here.pixel[1] / (body.pixel[0] * body.pixel[1]))
        grid = _Grid(here, h, kappa, offset, settings, team)
        if p is None:
            p = _first_guess(grid, h, kappa, offset)
        elif p.shape != shape:
            p = resampled(p, shape, state, body.periodic, team)
        p = np.array(p, dtype=state, copy=p is start)
        if offset is None:
            if here.padded == here.shape and depth == 0 and p.min() > 0.0:
                full = _full_contact(grid, h, kappa)
                p = full if full.min() >= 0.0 else p
            mean = float(p.mean(dtype=np.float64))
            p *= 1.0 / mean
        tolerance = settings.tolerance if depth == 0 else max(settings.tolerance, COARSE_TOLERANCE)
        limit = settings.max_iterations if depth == 0 else min(settings.max_iterations, 60)
        p, r, c, rms, deepest, converged, iterations, more = grid.solve(p, tolerance, limit)
        levels.append((shape, iterations))
        transforms += grid.transforms if depth == 0 else 0
        if depth == 0:
            notes += more
            r += c
            return Result(p, r, c, rms, deepest, converged, iterations, transforms, grid.history, levels, notes)
    raise AssertionError("there is always a finest grid")


def _full_contact(grid: _Grid, h: Array, kappa: float) -> Array:
    """Pressure that presses the heights flat, with mean 1: exact where nothing is padded."""
    q = grid.operator.precondition(np.asarray(h, dtype=grid.work)).astype(grid.state)
    q *= 1.0 / max(kappa, 1e-12)
    q += 1.0 - float(q.mean(dtype=np.float64))
    return q


def _first_guess(grid: _Grid, h: Array, kappa: float, offset: float | None) -> Array:
    """The admissible pressure nearest to the one that presses the heights flat."""
    if offset is None:
        return projected(_full_contact(grid, h, kappa)).astype(grid.state)
    q = grid.operator.precondition(np.asarray(h, dtype=grid.work) - offset)
    return np.maximum(q.astype(grid.state) / kappa, 0.0)
