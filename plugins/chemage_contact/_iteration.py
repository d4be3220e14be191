"""The hard-wall contact problem on arrays: minimise ½ pᵀGp - pᵀh over p ≥ 0 at a given load or a given approach.

The gradient is the gap, so the solution satisfies p ≥ 0, gap ≥ 0, p·gap = 0. Method:

* Conjugate gradients on the working set {p > 0} ∪ {gap < 0}, clipped to p ≥ 0 after an exact line search, restarted
  only when the direction is not one of descent: I. A. Polonsky, L. M. Keer, Wear 231, 206 (1999) without its
  restarts, after L. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29 (2018).
* Preconditioner of opposite order: the inverse symbol |q|, restricted to the working set: E. A. H. Vollebregt, J.
  Optim. Theory Appl. 162, 862 (2014). The part of it that describes flow out of the working set is mostly taken away
  again (the regional instead of the restricted fractional Laplacian), which saves up to a third of the iterations.
* Coarse to fine: each grid starts from the interpolated solution of the next coarser one.
* Mixed precision by iterative refinement: pressure and gap are kept in double precision, but only *changes* of the
  gap are ever computed, in single precision, so that their rounding errors shrink with the changes.
* Most iterations use the split operator of ``_split``, a stencil and a coarse grid, which costs less than one
  transform and nothing where nothing touches; the gap is evaluated exactly every few iterations, and the answer is
  judged by that gap alone (defect correction).
* Where the split operator does not apply (odd sizes, free boundary), the step length comes from Parseval's theorem, and
  a step that clips nothing reuses the spectrum of its direction: four or five transforms per iteration.

Everything is made dimensionless: heights in units of their rms value, measured down from the highest point; pressure
in units of its mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._operators import Substrate, fast_length
from ._split import Split, suits
from ._team import Live, Team
from ._transforms import Transforms

Array = NDArray[Any]
Precision = Literal["single", "double", "mixed"]

#: state and work precision
PRECISIONS: dict[str, tuple[type[np.floating[Any]], type[np.floating[Any]]]] = {
    "single": (np.float32, np.float32),
    "mixed": (np.float64, np.float32),
    "double": (np.float64, np.float64),
}
#: Iterations without halving the error after which the next more cautious method takes over: everything; Fourier
#: transforms only and the plain preconditioner; no preconditioner. After the last the solve has stalled.
PATIENCE = (20, 20, 100)
#: How far the error may fall on changes of the gap alone before the gap is evaluated anew: exact, and split operator.
EXACT_TRUST, SPLIT_TRUST = 1e-5, 0.15
#: Iterations with the split operator after which the gap is evaluated anew in any case.
SPLIT_TURNS = 10
#: The restricted inverse also carries what flows out of the working set, which the inverse of the restricted operator
#: does not: this share of it is taken away, and it is worked out anew after so many iterations.
OUTWARD_SHARE = 0.65
OUTWARD_TURNS = 6
#: The tolerance is relative to the rms height, or to the approach since first touch where that is smaller, but not
#: below this part of the rms height: what the precision can resolve.
APPROACH_FLOOR = {"single": 0.1, "mixed": 1e-6, "double": 1e-6}
#: Pressure cut off below zero is left out of the gap if it would change it by less than this part of the error.
NEGLIGIBLE = 0.01
#: A coarse grid is only a start: solved this well, and never smaller than this many pixels along an edge.
COARSE_TOLERANCE = 5e-3
COARSEST = 48
COARSE_ITERATIONS = 30


class Convolution:
    """A substrate's operator in one precision, in pixel units: displacement = symbol/pixel applied to pressure.

    ``symbol`` is ``body.symbol()``, which takes a while.
    """

    def __init__(self, body: Substrate, symbol: Array, dtype: Any, library: str, team: Team, *, floating: bool) -> None:
        self.shape, self.dtype, self.team = body.shape, np.dtype(dtype), team
        self.unit = math.sqrt(body.pixel[0] * body.pixel[1])
        self._transforms = Transforms(body.shape, body.padded, library, team.threads)
        self._plain = self._transforms
        if body.padded != body.shape:
            self._plain = Transforms(body.shape, body.shape, library, team.threads)
        self._symbol = (symbol / self.unit).astype(self.dtype)
        if floating and body.padded == body.shape:
            self._symbol[0, 0] = 0.0  # a uniform displacement only shifts the offset, but its rounding drowns the rest
        self._inverse: Array | None = None
        self._body = body
        self._buffer: Array | None = None
        self._turn: Array | None = None
        if body.padded == body.shape and body.shape[1] % 2 == 0:
            angles = 2.0 * math.pi / body.shape[1] * np.arange(body.shape[1] // 2)
            self._turn = np.exp(-1j * angles).astype(np.result_type(self.dtype, np.complex64))

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
        part = self.team.table(kernels.quadratic_form, spectrum.shape[0], 1, spectrum, self._symbol, columns)
        return float(part.sum()) / (rows * columns)

    def displacement(self, spectrum: Array) -> Array:
        """Gx from the spectrum of x, which is destroyed."""
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, self._symbol)
        return self._transforms.backward(spectrum)

    def apply(self, x: Array) -> Array:
        """Gx of a pressure x (nx, ny), rounded to this precision first; lasts until the next call."""
        if self._turn is None:
            return self.displacement(self.spectrum(np.asarray(x, dtype=self.dtype)))
        if self._buffer is None:
            self._buffer = np.empty(self.shape, self.dtype)
        return self._packed(x, self._symbol, self._buffer)

    def precondition(self, v: Array) -> Array:
        """Approximately G⁻¹v."""
        if self._inverse is None:
            self._inverse = (self._body.inverse() * self.unit).astype(self.dtype)
        if self._turn is not None:
            return self._packed(v, self._inverse, np.empty(self.shape, self.dtype))
        spectrum = self._plain.forward(v)
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, self._inverse)
        return self._plain.backward(spectrum)

    def _packed(self, x: Array, symbol: Array, buffer: Array) -> Array:
        """x times a symbol, in the memory of ``buffer`` (nx, ny)."""
        nx = self.shape[0]
        self.team.run(kernels.convert, nx, x, buffer)
        z = self._plain.in_place(buffer.view(np.result_type(self.dtype, np.complex64)), True)
        self.team.run(kernels.multiply_packed, nx // 2 + 1, z, symbol, self._turn)
        return self._plain.in_place(z, False).view(self.dtype)


@dataclass
class Heights:
    """Heights (nx, ny) as they came, and what makes them dimensionless: (values - top)·factor has rms 1 and no positive
    entry. Kernels work that out on the fly, which saves an array."""

    values: Array
    top: float = 0.0
    factor: float = 1.0

    def scaled(self, dtype: Any, team: Team) -> Array:
        """The dimensionless heights."""
        out = np.empty(self.values.shape, dtype)
        team.run(kernels.standardise, len(out), self.values, self.top, self.factor, out)
        return out

    def regrid(self, shape: tuple[int, int], dtype: Any, periodic: bool, team: Team) -> Heights:
        """The dimensionless heights on another grid."""
        sampled = resampled(self.values, shape, np.float64, periodic, team)
        sampled.setflags(write=False)  # as those of a surface, or numba compiles kernels for both
        found = Heights(sampled, self.top, self.factor).scaled(dtype, team)
        found.setflags(write=False)
        return Heights(found)


@dataclass
class Settings:
    """How to solve; the same on all grids."""

    tolerance: float = 1e-5
    precision: Precision = "mixed"
    max_iterations: int = 500
    levels: int | None = None
    library: str = "scipy"
    #: 0: every acceleration; 1: Fourier transforms and the plain preconditioner; 2: no preconditioner
    caution: int = 0


@dataclass
class Result:
    """A solution in dimensionless units. ``pressure`` (mean 1 under load control), ``gap`` (rms heights), both (nx,
    ny)."""

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
        self, body: Substrate, heights: Heights, stiffness: float, offset: float | None, settings: Settings, team: Team
    ) -> None:
        self.body, self.settings, self.team, self.offset_fixed = body, settings, team, offset
        self.state, self.work = PRECISIONS[settings.precision]
        self.heights = heights
        #: displacement = stiffness · (pixel-unit operator applied to dimensionless pressure)
        self.kappa = stiffness
        self.floating = offset is None
        symbol = body.symbol()
        self.operator = Convolution(body, symbol, self.work, settings.library, team, floating=self.floating)
        padded = body.padded != body.shape
        #: displacement under the mean pressure, which the operator leaves out where the offset is free
        self.uniform = 0.0 if padded or not self.floating else float(symbol[0, 0]) / self.operator.unit
        self._symbol = symbol if self.state != self.work else None
        self._exact = self.operator if self.state == self.work else None
        nx, ny = body.shape
        self.per_row = math.ceil(ny / kernels.WIDTH)
        self.width = min(ny, 16 * math.ceil(ny / self.per_row / 16))
        self.per_row = math.ceil(ny / self.width)
        self.blocks = nx * self.per_row
        self.part = np.zeros((self.blocks, 7))
        self.active = np.zeros((self.blocks, 4))
        self.everywhere = self._live(np.ones(self.blocks, np.bool_))
        self.history: list[tuple[float, float]] = []

    @property
    def transforms(self) -> int:
        """Fourier transforms of the full grid so far."""
        exact = self._exact.transforms if self._exact is not None and self._exact is not self.operator else 0
        return self.operator.transforms + exact

    def exact(self) -> Convolution:
        """The operator in the precision of the state."""
        if self._exact is None:
            assert self._symbol is not None
            make = (self.body, self._symbol, self.state, self.settings.library, self.team)
            self._exact = Convolution(*make, floating=self.floating)
        return self._exact

    def gap(self, p: Array, exact: bool, out: Array | None = None) -> Array:
        """Gap before the offset, G p - h, in the precision of the state, or in the cheaper one of the work.

        Leaves the sums of the gap and of the pixels in contact in ``part``.
        """
        u = (self.exact() if exact else self.operator).apply(p)
        r = np.empty(p.shape, self.state) if out is None else out
        h = self.heights
        self._run(kernels.subtract, self.everywhere, u, h.values, h.top, h.factor, self.kappa, p, r, self.part)
        return r

    def _run(self, kernel: Callable[..., None], live: Live, *args: Any) -> None:
        self.team.run(kernel, live.blocks, self.width, live.mask, *args)

    def _sum(self, columns: int) -> list[float]:
        return [float(x) for x in self.part[:, :columns].sum(axis=0)]

    def _live(self, mask: Array) -> Live:
        return Live(mask.astype(np.uint8), self.per_row, self.team.threads)

    def _working_set(self, reach: int) -> Live:
        """Blocks with a pixel of the working set in them or up to ``reach`` rows away."""
        here = (self.active[:, 2] > 0.0).reshape(-1, self.per_row)
        near = here.copy()
        for shift in range(1, reach + 1):
            near |= np.roll(here, shift, axis=0) | np.roll(here, -shift, axis=0)
        return self._live(near.ravel())

    def solve(self, p: Array, tolerance: float, limit: int, exact: bool) -> Outcome:
        """Iterate from p (nx, ny, state precision, changed in place) until both errors are below tolerance.

        With ``exact`` the errors that end the iteration are those of a gap evaluated anew in the state's precision.
        """
        run, part, active = self._run, self.part, self.active
        load = float(p.size)
        v = np.empty(p.shape, self.work)
        d = np.zeros(p.shape, self.work)
        y: Array = d
        # zeros, not zeros_like: memory that is never live is never touched
        z = np.zeros(p.shape, self.work)
        outward = np.zeros(p.shape, self.work)
        caution = self.settings.caution
        split = caution == 0 and suits(self.body)
        make = (self.body, self.work, self.settings.library, self.team, self.width)
        near = Split(*make, inverse=False, floating=self.floating) if split else None
        near_inverse = Split(*make, inverse=True, floating=False) if split else None
        if split:
            y = np.zeros(p.shape, self.work)
        notes: list[str] = []
        steepest = True
        iteration = best_at = since = 0
        best = refreshed = math.inf
        settled = self.state == self.work
        fresh = True
        live = self.everywhere
        r = self.gap(p, settled)
        while True:
            # Where things stand
            scope = self.everywhere if fresh or not split else live
            total, count = self._sum(2)
            offset = self.offset_fixed
            if offset is None:
                offset = -total / count if count else -float(r.min())
            run(kernels.residual, scope, p, r, offset, v, active)
            squares, _, size, sum_v = (float(x) for x in active.sum(axis=0))
            rms = math.sqrt(squares / count) if count else 0.0
            deepest = float(active[:, 1].max())
            error = max(rms, deepest)
            del self.history[iteration:]
            self.history.append((rms, deepest))
            if fresh or not split:
                live = self._working_set(2 if split else 0)
            if fresh:
                refreshed, since = error, 0
            if error < 0.5 * best:
                best, best_at = error, iteration
            # A small approach is a finer measure of what matters than the roughness of pixels that never meet.
            aim = tolerance * min(1.0, max(-offset, APPROACH_FLOOR[self.settings.precision])) if exact else tolerance
            trusted = settled or (not exact and (fresh or not split))
            hopeless = not math.isfinite(error) or iteration >= limit
            if not hopeless and iteration - best_at >= PATIENCE[caution]:
                if caution < 2:
                    caution += 1
                    notes.append(f"slow progress: went on more cautiously after {iteration} iterations")
                    steepest, best, best_at, since = True, error, iteration, 0
                    if split:
                        split, near, near_inverse = False, None, None
                        live = self._working_set(0)
                else:
                    hopeless = True
            if error < aim or hopeless:
                if trusted:
                    return Outcome(p, r, offset, rms, deepest, error < aim, iteration, notes)
                settled = exact or self.state == self.work
                self.gap(p, settled, r)
                fresh = True
                continue
            goal = max(0.5 * aim, SPLIT_TRUST * refreshed) if split else EXACT_TRUST * refreshed
            if not fresh and (error < goal or (split and since >= SPLIT_TURNS)):
                # Take stock: evaluate the gap anew, in full precision where rounding might show.
                settled = self.state == self.work or (exact and error < max(aim, 1e-5))
                self.gap(p, settled, r)
                fresh = True
                continue
            # Direction
            iteration += 1
            since += 1
            clear = since == 1 or not split  # blocks that were live before may not be any more
            if caution == 0 and (since - 1) % OUTWARD_TURNS == 0:
                run(kernels.indicator, live, v, z, clear)
                outward = near_inverse.apply(z, live, outward, part) if near_inverse else self.operator.precondition(z)
            if near_inverse:
                near_inverse.apply(v, live, z, part)
            else:
                z = self.operator.precondition(v) if caution < 2 else v
            run(kernels.products, live, v, z, outward, OUTWARD_SHARE if caution == 0 else 0.0, d, y, part)
            sz, szv, sd, sdv, szy, sdy, sy = self._sum(7)
            zm, dm = (sz / size, sd / size) if self.offset_fixed is None else (0.0, 0.0)
            zv, zy, dv, dy = szv - zm * sum_v, szy - zm * sy, sdv - dm * sum_v, sdy - dm * sy
            beta = -zy / dy if not steepest and dy > 0.0 else 0.0
            if beta < 0.0 or zv + beta * dv <= 0.0:
                beta = 0.0
            run(kernels.direction, live, v, z, d, beta, zm + beta * dm, clear, part)
            largest = math.sqrt(self._sum(1)[0])
            # Step
            spectrum: Array = d
            if near:
                near.apply(d, live, y, part)
                curvature = self.kappa * self._sum(1)[0]
            else:
                spectrum = self.operator.spectrum(d)
                curvature = self.kappa * self.operator.energy(spectrum)
            step = (zv + beta * dv) / curvature if curvature > 0.0 else math.inf
            # A vanishing load makes the body look infinitely soft; no pixel needs more than the whole load.
            step = min(step, 1e3 * load / largest) if largest > 0.0 else 0.0
            run(kernels.clipped, live, p, d, step, part)
            new_load, _, cut_squares = self._sum(3)
            scale = load / new_load if cut_squares and self.offset_fixed is None else 1.0
            run(kernels.move, live, p, d, step, scale)
            if self.kappa * math.sqrt(cut_squares) > NEGLIGIBLE * error:
                factor = self.kappa
                y = near.apply(d, live, y, part) if near else self.operator.displacement(self.operator.spectrum(d))
            else:
                factor = self.kappa * step
                y = y if split else self.operator.displacement(spectrum)
            run(kernels.advance, live if split else self.everywhere, p, r, y, factor, part)
            fresh = settled = steepest = False


@dataclass
class Outcome:
    """Where the iteration on one grid ended; ``gap`` without the offset."""

    pressure: Array
    gap: Array
    offset: float
    rms_gap: float
    penetration: float
    converged: bool
    iterations: int
    notes: list[str]


def sums(p: Array, r: Array, team: Team) -> tuple[float, float, float]:
    """Σ p, Σ p·|r| and the least p, of two arrays (nx, ny)."""
    part = team.table(kernels.totals, p.shape[0], 3, p, r)
    return float(part[:, 0].sum()), float(part[:, 1].sum()), float(part[:, 2].min(initial=math.inf))


def rescale(p: Array, factor: float, team: Team) -> float:
    """Multiply p (nx, ny) in place; returns the new sum."""
    return float(team.table(kernels.scale, p.shape[0], 1, p, p.dtype.type(factor)).sum())


def resampled(
    source: Array,
    shape: tuple[int, int],
    dtype: Any,
    periodic: bool,
    team: Team,
    kernel: Callable[..., None] = kernels.resample,
) -> Array:
    """Bilinear resampling of (nx, ny) to another grid of the same extent whose first pixels coincide."""
    tables = []
    for n, m in zip(source.shape, shape, strict=True):
        x = np.arange(m) * (n / m)
        low = np.minimum(x.astype(np.int64), n - 1)
        tables += [low, (low + 1) % n if periodic else np.minimum(low + 1, n - 1), x - low]
    target = np.empty(shape, dtype)
    team.run(kernel, shape[0], source, *tables, target)
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
        nx, ny = (n if n < COARSEST else 4 * fast_length(math.ceil(n / 8)) for n in out[-1])
        if (nx, ny) == out[-1] or (levels is None and max(nx, ny) < COARSEST):
            break
        out.append((nx, ny))
    return out


def solve(
    body: Substrate,
    heights: Heights,
    *,
    stiffness: float,
    offset: float | None = None,
    start: Array | None = None,
    settings: Settings,
    team: Team,
) -> Result:
    """Solve on ``body`` for ``heights``.

    ``stiffness`` is (unit of pressure)·pixel/(E*·unit of height). With ``offset`` None the mean pressure is 1;
    otherwise the gap is G p - h + offset and the load follows (negative: approach since first touch). ``start`` is a
    pressure to begin from instead of a coarser grid. Never raises for lack of convergence: look at ``converged``.
    """
    state = PRECISIONS[settings.precision][0]
    shapes = grids(body.shape, 1 if start is not None else settings.levels)
    levels: list[tuple[tuple[int, int], int]] = []
    p = start
    for depth in range(len(shapes) - 1, -1, -1):
        shape = shapes[depth]
        here = body if depth == 0 else body.regrid(shape)
        h = heights if depth == 0 else heights.regrid(shape, state, body.periodic, team)
        # Displacements are counted in pixels of the grid at hand.
        kappa = stiffness * math.sqrt(here.pixel[0] * here.pixel[1] / (body.pixel[0] * body.pixel[1]))
        grid = _Grid(here, h, kappa, offset, settings, team)
        if p is None:
            p = _first_guess(grid, kappa, offset)
        elif p.shape != shape:
            p = resampled(p, shape, state, body.periodic, team, kernels.resample_pressure)
        if p is start:
            p = np.array(start, dtype=state)
        end: Outcome | None = None
        if offset is None:
            total, _, least = sums(p, p, team)
            rescale(p, p.size / total, team)
            if here.padded == here.shape and least > 0.0:
                end = _full_contact(grid, kappa)
        tolerance = settings.tolerance if depth == 0 else max(settings.tolerance, COARSE_TOLERANCE)
        limit = settings.max_iterations if depth == 0 else min(settings.max_iterations, COARSE_ITERATIONS)
        end = end or grid.solve(p, tolerance, limit, depth == 0)
        p = end.pressure
        levels.append((shape, end.iterations))
        if depth == 0:
            end.gap += end.offset
            return Result(
                p,
                end.gap,
                end.offset - stiffness * grid.uniform,
                end.rms_gap,
                end.penetration,
                end.converged,
                end.iterations,
                grid.transforms,
                grid.history,
                levels,
                end.notes,
            )
    raise AssertionError("there is always a finest grid")


def _flattening(grid: _Grid, kappa: float) -> Array:
    """Pressure with mean 0 that presses the heights flat: exact where nothing is padded."""
    q = grid.exact().precondition(grid.heights.scaled(grid.state, grid.team))
    q -= q.dtype.type(q.mean(dtype=np.float64))
    # At vanishing loads only its shape is of use.
    q *= q.dtype.type(1.0 / max(kappa, 1e-12))
    return q


def _full_contact(grid: _Grid, kappa: float) -> Outcome | None:
    """The solution if every pixel touches, else None.

    The gap is worked out from the varying part of the pressure: under a large mean the sum would not resolve it.
    """
    varying = _flattening(grid, kappa)
    if float(varying.min()) <= -1.0:
        return None
    r = grid.gap(varying, True)
    offset = -float(r.mean(dtype=np.float64))
    rms = math.sqrt(float(np.mean(np.square(r + r.dtype.type(offset)), dtype=np.float64)))
    varying += varying.dtype.type(1.0)
    grid.history.append((rms, 0.0))
    return Outcome(varying, r, offset, rms, 0.0, rms < grid.settings.tolerance, 0, [])


def _first_guess(grid: _Grid, kappa: float, offset: float | None) -> Array:
    """The admissible pressure nearest to the one that presses the heights flat."""
    if offset is None:
        return projected(_flattening(grid, kappa) + 1.0).astype(grid.state)
    q = grid.operator.precondition(grid.heights.scaled(grid.work, grid.team) - grid.work(offset))
    return np.maximum(q, 0.0).astype(grid.state) / grid.state(kappa)
