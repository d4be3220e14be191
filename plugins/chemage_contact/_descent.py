"""Preconditioned projected conjugate gradients on one grid; the method is described in ``_iteration``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._grid import Grid
from ._kernels import Search, State
from ._split import Split, suits
from ._team import Active

Array = NDArray[Any]

#: The methods from fast to robust; a solve that makes slow progress goes on with the next one.
METHODS = (
    "split operator and regional preconditioner",
    "Fourier transforms and plain preconditioner",
    "Fourier transforms without preconditioner",
)
#: Iterations without halving the error after which the next method takes over; after the last the solve has stalled.
PATIENCE = (20, 20, 100)
#: How far the error may fall by updates of the gap before the gap is evaluated again: exact and split operator.
EXACT_TRUST, SPLIT_TRUST = 1e-5, 0.15
#: Iterations with the split operator after which the gap is evaluated again in any case.
SPLIT_ITERATIONS = 10
#: The restricted inverse also contains a term for flow out of the working set, which the inverse of the restricted
#: operator does not: this share of it is removed. The term is updated every so many iterations.
OUTWARD_SHARE = 0.65
OUTWARD_PERIOD = 6
#: The tolerance is relative to the rms height, or to the approach since first touch where that is smaller, but not
#: below this part of the rms height: what the precision can resolve.
APPROACH_FLOOR = {"single": 0.1, "mixed": 1e-6, "double": 1e-6}
#: Pressure that is clipped is left out of the update of the gap if it changes it by less than this part of the error.
NEGLIGIBLE = 0.01
#: Longest step of any pixel, in units of the load.
LONGEST_STEP = 1e3


@dataclass
class Outcome:
    """The end of the iteration on one grid; ``gap`` without the offset."""

    pressure: Array
    gap: Array
    offset: float
    rms_gap: float
    penetration: float
    converged: bool
    iterations: int
    notes: list[str]


@dataclass
class Standing:
    """Errors of the present pressure, and sums over the working set."""

    offset: float = 0.0
    rms_gap: float = math.inf
    penetration: float = math.inf
    pixels: float = 0.0
    residual_sum: float = 0.0

    @property
    def error(self) -> float:
        return max(self.rms_gap, self.penetration)


class Descent:
    """The iteration from a pressure p (nx, ny, state precision, changed in place) until both errors are below
    ``tolerance``.

    With ``final`` the tolerance is relative to the approach where that is small, and the errors that end the iteration
    are those of a gap evaluated in the precision of the state.
    """

    def __init__(self, grid: Grid, p: Array, tolerance: float, limit: int, final: bool) -> None:
        self.grid, self.tolerance, self.limit, self.final = grid, tolerance, limit, final
        self.same_precision = grid.state == grid.work
        self.method = grid.settings.method
        self._make_split()
        # zeros, not zeros_like: memory that is never active is never touched
        v, d = np.empty(p.shape, grid.work), np.zeros(p.shape, grid.work)
        z, outward = np.zeros(p.shape, grid.work), np.zeros(p.shape, grid.work)
        y = np.zeros(p.shape, grid.work) if self.split else d
        self.search = Search(v, z, outward, d, y)
        self.notes: list[str] = []
        self.steepest = True
        self.iteration = self.best_iteration = self.since_evaluation = 0
        self.best = self.evaluated_error = math.inf
        self.standing = Standing()
        self.active = grid.everywhere
        self.state = State(p, np.empty(p.shape, grid.state))
        self._evaluate_gap(self.same_precision)

    def run(self) -> Outcome:
        """Iterate to the end."""
        while True:
            self._assess()
            target = self._target()
            trusted = self._trusted()
            stop = not math.isfinite(self.standing.error) or self.iteration >= self.limit
            stop = stop or not self._progress()
            if self.standing.error < target or stop:
                if trusted:
                    return self._outcome(target)
                self._evaluate_gap(self.final or self.same_precision)
            elif self._evaluation_due(target):
                # In full precision where rounding might show.
                exact = self.same_precision or (self.final and self.standing.error < max(target, 1e-5))
                self._evaluate_gap(exact)
            else:
                self.iteration += 1
                self.since_evaluation += 1
                self._move(*self._find_direction())

    # -- the gap and its errors ---------------------------------------------------------------------------------------

    def _evaluate_gap(self, exact: bool) -> None:
        """Evaluate the gap from the pressure by Fourier transforms, in the precision of the state if ``exact``."""
        self.grid.gap(self.state.p, exact, self.state.r)
        self.evaluated = True
        self.evaluated_exactly = exact

    def _assess(self) -> None:
        """Residual, offset and errors from the gap; the sums of the gap over the contact are in ``part``."""
        grid = self.grid
        scope = grid.everywhere if self.evaluated or not self.split else self.active
        total, count = grid.sums(2)
        offset = grid.offset_fixed
        if offset is None:
            offset = -total / count if count else -float(self.state.r.min())
        grid.run(kernels.residual, scope, self.state, offset, self.search.v, grid.residual_part)
        squares, _, pixels, residual_sum = (float(x) for x in grid.residual_part.sum(axis=0))
        rms = math.sqrt(squares / count) if count else 0.0
        deepest = float(grid.residual_part[:, 1].max())
        self.standing = Standing(offset, rms, deepest, pixels, residual_sum)
        del grid.history[self.iteration :]
        grid.history.append((rms, deepest))
        if self.evaluated or not self.split:
            self.active = grid.working_set(2 if self.split else 0)
        if self.evaluated:
            self.evaluated_error, self.since_evaluation = self.standing.error, 0
        if self.standing.error < 0.5 * self.best:
            self.best, self.best_iteration = self.standing.error, self.iteration

    def _target(self) -> float:
        """The error to reach, relative to the rms height."""
        if not self.final:
            return self.tolerance
        # A small approach is a finer measure of what matters than the roughness of pixels that never meet.
        return self.tolerance * min(1.0, max(-self.standing.offset, APPROACH_FLOOR[self.grid.settings.precision]))

    def _trusted(self) -> bool:
        """Whether the errors are those of a gap that may be reported."""
        return self.evaluated_exactly or (not self.final and (self.evaluated or not self.split))

    def _evaluation_due(self, target: float) -> bool:
        """Whether updates have changed the gap so much that it should be evaluated again."""
        if self.evaluated:
            return False
        trust = SPLIT_TRUST if self.split else EXACT_TRUST
        goal = max(0.5 * target, trust * self.evaluated_error) if self.split else trust * self.evaluated_error
        return self.standing.error < goal or (self.split and self.since_evaluation >= SPLIT_ITERATIONS)

    def _progress(self) -> bool:
        """Change the method if progress is slow; False if there is no further method."""
        if self.iteration >= self.limit or self.iteration - self.best_iteration < PATIENCE[self.method]:
            return True
        if self.method == len(METHODS) - 1:
            return False
        self.method += 1
        self.notes.append(f"slow convergence: after {self.iteration} iterations continued with {METHODS[self.method]}")
        self.steepest, self.since_evaluation = True, 0
        self.best, self.best_iteration = self.standing.error, self.iteration
        if self.split:
            self._make_split()
            self.active = self.grid.working_set(0)
        return True

    def _outcome(self, target: float) -> Outcome:
        s = self.standing
        converged = s.error < target
        (p, r), iterations = self.state, self.iteration
        return Outcome(p, r, s.offset, s.rms_gap, s.penetration, converged, iterations, self.notes)

    # -- direction and step -------------------------------------------------------------------------------------------

    def _make_split(self) -> None:
        """The split operator and its inverse, where the method uses them and the grid allows them."""
        grid = self.grid
        self.split = self.method == 0 and suits(grid.substrate)
        self.near: Split | None = None
        self.near_inverse: Split | None = None
        if self.split:
            make = (grid.substrate, grid.work, grid.settings.library, grid.team)
            self.near = Split(*make, inverse=False, floating=grid.floating)
            self.near_inverse = Split(*make, inverse=True, floating=False)

    def _precondition(self, clear: bool) -> None:
        """z from the residual, and ``outward`` where it is due."""
        grid, search = self.grid, self.search
        v, z, outward = search.v, search.z, search.outward
        if self.method == 0 and (self.since_evaluation - 1) % OUTWARD_PERIOD == 0:
            grid.run(kernels.indicator, self.active, v, z, clear)
            if self.near_inverse:
                outward = self.near_inverse.apply(z, self.active, outward, grid.part)
            else:
                outward = grid.operator.precondition(z)
        if self.near_inverse:
            self.near_inverse.apply(v, self.active, z, grid.part)
        else:
            z = grid.operator.precondition(v) if self.method < 2 else v
        self.search = search._replace(z=z, outward=outward)

    def _find_direction(self) -> tuple[float, float]:
        """The conjugate direction d; returns its product with the residual, and its norm."""
        grid, s = self.grid, self.standing
        # Blocks that were active before may not be any more.
        clear = self.since_evaluation == 1 or not self.split
        self._precondition(clear)
        share = OUTWARD_SHARE if self.method == 0 else 0.0
        grid.run(kernels.products, self.active, self.search, share, grid.part)
        sz, szv, sd, sdv, szy, sdy, sy = grid.sums(7)
        # Under a given load directions have zero mean.
        zm, dm = (sz / s.pixels, sd / s.pixels) if grid.offset_fixed is None else (0.0, 0.0)
        zv, zy = szv - zm * s.residual_sum, szy - zm * sy
        dv, dy = sdv - dm * s.residual_sum, sdy - dm * sy
        beta = -zy / dy if not self.steepest and dy > 0.0 else 0.0
        if beta < 0.0 or zv + beta * dv <= 0.0:
            beta = 0.0
        grid.run(kernels.direction, self.active, self.search, beta, zm + beta * dm, clear, grid.part)
        return zv + beta * dv, math.sqrt(grid.sums(1)[0])

    def _move(self, slope: float, largest: float) -> None:
        """An exact line search along d, clipping to p ≥ 0, and the update of the gap. d becomes the change of p."""
        grid, search, near = self.grid, self.search, self.near
        d, y = search.d, search.y
        load = float(d.size)
        spectrum: Array = d
        if near:
            near.apply(d, self.active, y, grid.part)
            curvature = grid.stiffness * grid.sums(1)[0]
        else:
            spectrum = grid.operator.spectrum(d)
            curvature = grid.stiffness * grid.operator.energy(spectrum)
        step = slope / curvature if curvature > 0.0 else math.inf
        # A vanishing load makes the body look infinitely soft; no pixel needs more than the whole load.
        step = min(step, LONGEST_STEP * load / largest) if largest > 0.0 else 0.0
        grid.run(kernels.clipped, self.active, self.state.p, d, step, grid.part)
        new_load, _, cut_squares = grid.sums(3)
        scale = load / new_load if cut_squares and grid.offset_fixed is None else 1.0
        grid.run(kernels.move, self.active, self.state.p, d, step, scale)
        if grid.stiffness * math.sqrt(cut_squares) > NEGLIGIBLE * self.standing.error:
            factor = grid.stiffness
            y = near.apply(d, self.active, y, grid.part) if near else self._displacement(grid.operator.spectrum(d))
        else:
            factor = grid.stiffness * step
            y = y if near else self._displacement(spectrum)
        scope: Active = self.active if self.split else grid.everywhere
        grid.run(kernels.advance, scope, self.state, y, factor, grid.part)
        self.search = search._replace(y=y)
        self.evaluated = self.evaluated_exactly = self.steepest = False

    def _displacement(self, spectrum: Array) -> Array:
        return self.grid.operator.displacement(spectrum)
