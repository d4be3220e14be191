"""Preconditioned projected conjugate gradients on one grid; the method is described in ``_iteration``."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chemage.plugin import progress

from . import _kernels as kernels
from ._bounds import ranked, restored, shift_to
from ._grid import Convolution, GridProblem, Split, suits
from ._kernels import DescentState, Search
from ._operators import Active

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
#: Pressure that is clipped is left out of the update of the gap if it changes it by less than this part of the error.
NEGLIGIBLE = 0.01
#: Longest step of any pixel, in units of the load.
LONGEST_STEP = 1e3


#: After clipping, the load is restored by a shift, found in at most so many Newton steps. A step from an excess of less
#: than this part of the load is the last one: the next projection or evaluation restores the rest.
LITTLE_EXCESS, LOAD_ACCURACY, NEWTON_STEPS = 1e-3, 1e-10, 50
#: The same with a hardness.
BOUNDED_STEPS = 12
#: Free pixels are few if they could bear less than this part of the load; a number of pixels counts as whole if it is
#: by this part.
FEW_FREE, INTEGER = 0.01, 1e-9
#: The load is restored before an evaluation of the gap if it is wrong by more than this, relatively.
LOAD_ROUNDING = 1e-13
#: A direction shorter than this many rounding errors of the terms it is the difference of is noise. Only so few pixels
#: run out of conjugate directions.
NOISE, NOISE_PIXELS = 8.0, 4096
#: In single precision, the gap is evaluated in double precision if rounding exceeds this part of the error to reach.
NOISE_SHARE = 0.1
#: Errors below so many times the rounding errors of the gap cannot be expected to fall further.
ROUNDING_LIMIT = 10.0
#: The gap is evaluated in the precision of the state if the error is below this part of the approach or of the rms
#: height.
REFINE_BELOW = 3e-6
#: Steps of the estimate of the pressure error at most; fewer if a step increases neither norm by more than this factor,
#: or if the first one reduces the residual to less than this part.
MOST_ESTIMATES = 8
SETTLED = 2.5
REDUCED = 0.3
#: The increase by further steps is extrapolated as a geometric series, whose ratio is at most this.
LARGEST_RATIO = 0.5
#: From this iteration on the best pressure is kept, in case the solve fails.
KEEP_FROM = 15


@dataclass
class GridSolution:
    """The end of the iteration on one grid, in dimensionless units; of the finest one with what led there, and errors
    relative to ``scale``.

    ``gap`` is without ``gap_offset``, until the finest grid is solved; ``offset`` is the offset of G p - h.
    """

    pressure: Array
    gap: Array
    gap_offset: float
    offset: float
    scale: float
    rms_gap: float
    penetration: float
    converged: bool
    iterations: int
    notes: list[str]
    rounding: bool = False
    """whether rounding errors ended the iteration"""
    pressure_error: tuple[float, float] = (0.0, 0.0)
    """estimated: L2 norm relative to that of the pressure, largest error relative to the largest pressure"""
    transforms: int = 0
    history: list[tuple[float, float]] = field(default_factory=list)
    levels: list[tuple[tuple[int, int], int]] = field(default_factory=list)

    @property
    def error(self) -> float:
        """The larger of the two errors that convergence is judged by."""
        return max(self.rms_gap, self.penetration)


@dataclass
class Standing:
    """Errors of the present pressure in rms heights, and sums over the working set."""

    offset: float = 0.0
    rms_gap: float = math.inf
    penetration: float = math.inf
    pixels: float = 0.0
    residual_sum: float = 0.0
    norm: float = 0.0
    """L2 norm of the pressure"""
    residual_squares: float = 0.0

    @property
    def error(self) -> float:
        return max(self.rms_gap, self.penetration)


class Descent:
    """The iteration from a pressure p (nx, ny, state precision, changed in place) until both errors are below
    ``tolerance``.

    With ``final`` the tolerance is relative to the approach where that is small, and the errors that end the iteration
    are those of a gap evaluated in the precision of the state, from the pressure that is returned.
    """

    def __init__(
        self,
        grid: GridProblem,
        p: Array,
        load: float,
        tolerance: float,
        limit: int,
        final: bool,
    ) -> None:
        self.grid, self.tolerance, self.limit, self.final = (
            grid,
            tolerance,
            limit,
            final,
        )
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
        #: the best pressure so far, as the pixels in contact: its error, their places and values
        self.kept: tuple[float, Array, Array] | None = None
        self.standing = Standing()
        self.active = grid.everywhere
        self.state = DescentState(p, np.empty(p.shape, grid.state))
        #: offset that the stored gap already contains
        self.base = grid.offset_fixed or 0.0
        #: present sum of the pressure
        self.load = load
        self._evaluate_gap(grid.operator)

    def run(self) -> GridSolution:
        """Iterate to the end."""
        while True:
            self._assess()
            if self.final and (report := progress.watched()) is not None:
                report(
                    "contact",
                    self.iteration,
                    0,
                    f"residual {self.standing.error / self._scale():.1e}",
                )
            target = self.tolerance * self._scale()
            trusted = self._trusted()
            stop = (
                not math.isfinite(self.standing.error)
                or self.iteration >= self.limit
            )
            stop = stop or not self._progress()
            if self.standing.error < target or stop:
                if trusted:
                    outcome = self._outcome()
                    if not outcome.converged or not self._tighten(outcome):
                        return outcome
                self._evaluate_gap(self._reporting_operator())
            elif self._evaluation_due(target):
                near = self.standing.error < max(
                    target, REFINE_BELOW * max(1.0, abs(self._offset()))
                )
                self._evaluate_gap(
                    self._reporting_operator() if near else self.grid.operator
                )
            else:
                self.iteration += 1
                self.since_evaluation += 1
                slope, largest = self._find_direction(
                    self.since_evaluation % OUTWARD_PERIOD == 1
                )
                if largest > 0.0:
                    self._move(slope, largest)
                elif (
                    self._trusted()
                    and abs(self.standing.offset) <= 1e-3 * self._scale()
                ):
                    return self._outcome(rounding=True)
                else:
                    self.iteration -= 1
                    self._evaluate_gap(self._reporting_operator())

    # -- the gap and its errors ---------------------------------------------------------------------------------------

    def _evaluate_gap(self, operator: Convolution) -> None:
        """Evaluate the gap from the pressure by Fourier transforms, relative to the last offset.

        Before that, the load is restored, if rounding the changes of the pressure has changed it; where free pixels
        cannot bear it, after that, from the gap.
        """
        grid, allowed = self.grid, math.inf
        if grid.offset_fixed is None:
            allowed = LITTLE_EXCESS
            self.base += (
                self.standing.offset if math.isfinite(self.standing.offset) else 0.0
            )
            if operator is self._reporting_operator():
                allowed = max(LOAD_ROUNDING, 4.0 * float(np.finfo(grid.state).eps))
                if abs(self.load / grid.load - 1.0) > allowed:
                    self.load = restored(
                        self.state.p, self.load, grid.load, grid.hardness, grid.team
                    )
        grid.gap(operator, self.base, self.state)
        if grid.hardness is not None and abs(self.load / grid.load - 1.0) > allowed:
            self._fill(float(grid.hardness))
            grid.gap(operator, self.base, self.state)
        self.evaluated = True
        self.evaluated_by = operator
        self.evaluated_exactly = operator is self._reporting_operator()

    def _reporting_operator(self) -> Convolution:
        """The operator for errors that may be reported."""
        grid = self.grid
        if not self.final or grid.work == np.float64:
            return grid.operator
        if grid.state == np.float64:
            return grid.double()
        return (
            grid.double()
            if self._noise() > NOISE_SHARE * self.tolerance * self._scale()
            else grid.operator
        )

    def _noise(self) -> float:
        """Rounding error of the gap in the precision of the state: of the pressures, and of the displacement."""
        grid, p = self.grid, self.standing.norm / math.sqrt(self.state.p.size)
        eps = float(np.finfo(grid.state).eps)
        return eps * (
            grid.stiffness * grid.operator.response * p + abs(self._offset())
        )

    def _offset(self) -> float:
        """Offset of the gap: gap = G p - h + offset."""
        return (
            self.base
            if self.grid.offset_fixed is not None
            else self.base + self.standing.offset
        )

    def _scale(self) -> float:
        """The length that errors are relative to, in rms heights: the approach since first touch, at most 1."""
        if not self.final:
            return 1.0
        approach = (
            self.grid.uniform * self.grid.stiffness * self.grid.mean
            - self._offset()
        )
        return min(1.0, approach) if approach > 0.0 else 1.0

    def _assess(self) -> None:
        """Residual, offset and errors from the gap; the sums of the gap over the contact are in ``part``."""
        grid = self.grid
        scope = grid.everywhere if self.evaluated or not self.split else self.active
        total, count = grid.sums(2)
        # where nearly all of the load is where the contact yields, free pixels say little of the offset
        borne = math.inf if grid.hardness is None else count * float(grid.hardness)
        few = grid.offset_fixed is None and (
            not count or borne < FEW_FREE * grid.load
        )
        mean = -total / count if count and grid.offset_fixed is None else 0.0
        s = self._measured(scope, self._offset_of_few() if few else mean, count)
        if few and count and not s.penetration:
            s = self._measured(
                scope, mean, count
            )  # the few free pixels are all that is left
        self.standing = s
        del grid.history[self.iteration :]
        grid.history.append((s.rms_gap, s.penetration))
        if self.evaluated or not self.split:
            self.active = grid.working_set(2 if self.split else 0)
            self._keep()
        if self.evaluated:
            self.evaluated_error, self.since_evaluation = self.standing.error, 0
        if self.standing.error < 0.5 * self.best:
            self.best, self.best_iteration = self.standing.error, self.iteration

    def _measured(self, scope: Active, offset: float, free: float) -> Standing:
        """The residual with this ``offset``, its sums and its errors."""
        grid = self.grid
        args = self.state, offset, grid.hardness, self.search.v
        grid.run(kernels.residual, scope, *args, grid.residual_part)
        squares, _, pixels, residual_sum, norm, through = (
            float(x) for x in grid.residual_part.sum(axis=0)
        )
        rms = math.sqrt(squares / free) if free else 0.0
        deepest = float(grid.residual_part[:, 1].max())
        return Standing(
            offset,
            rms,
            deepest,
            pixels,
            residual_sum,
            math.sqrt(norm),
            squares + through,
        )

    def _offset_of_few(self) -> float:
        """The offset where no pixel, or hardly one, is free: as many gaps are negative as pixels at the hardness would
        bear the load."""
        r = self.state.r
        if self.grid.hardness is None:
            return -float(r.min())
        # rounding the hardness down may leave less than the load on all pixels
        number = min(self.grid.load / float(self.grid.hardness), r.size)
        whole = round(number)
        if abs(number - whole) > INTEGER * number:
            first = last = math.floor(number)
        else:  # none need be free: any offset between the last that yields and the first that is not in contact
            first, last = whole - 1, whole
        return -0.5 * sum(ranked(r, max(first, 0), min(last, r.size - 1)))

    def _fill(self, hardness: float) -> None:
        """Let the pixels with the smallest gaps yield, as on a rigid body, so many that they bear the load."""
        r, number = self.state.r, self.grid.load / hardness
        rounding = LOAD_ROUNDING * number
        whole = min(int(number + rounding), r.size - 1)
        level, _ = ranked(r, whole, whole)
        full, last = r < level, r == level
        share = (number - np.count_nonzero(full)) / max(np.count_nonzero(last), 1)
        self.state.p[...] = np.where(full, hardness, 0.0)
        self.state.p[last] = hardness * min(share, 1.0) if share > rounding else 0.0
        self.load = self.grid.load

    def _trusted(self) -> bool:
        """Whether the errors are those of a gap that may be reported."""
        return self.evaluated_exactly or (
            not self.final and (self.evaluated or not self.split)
        )

    def _evaluation_due(self, target: float) -> bool:
        """Whether updates have changed the gap so much that it should be evaluated again."""
        if self.evaluated:
            return False
        trust = SPLIT_TRUST if self.split else EXACT_TRUST
        goal = (
            max(0.5 * target, trust * self.evaluated_error)
            if self.split
            else trust * self.evaluated_error
        )
        return self.standing.error < goal or (
            self.split and self.since_evaluation >= SPLIT_ITERATIONS
        )

    def _progress(self) -> bool:
        """Change the method if progress is slow; False if there is no further method."""
        if (
            self.iteration >= self.limit
            or self.iteration - self.best_iteration < PATIENCE[self.method]
        ):
            return True
        if self.method == len(METHODS) - 1 or self._at_rounding():
            return False
        self.method += 1
        self.notes.append(
            f"slow convergence: after {self.iteration} iterations continued with {METHODS[self.method]}"
        )
        self.steepest, self.since_evaluation = True, 0
        self.best, self.best_iteration = self.standing.error, self.iteration
        if self.split:
            self._make_split()
            self.active = self.grid.working_set(0)
        return True

    def _at_rounding(self) -> bool:
        """Whether rounding prevents a smaller error."""
        return self.standing.error < ROUNDING_LIMIT * self._noise()

    def _keep(self) -> None:
        """Keep the present pressure if it is the best so far and the solve may fail."""
        error = self.standing.error
        if not self.final or (
            self.iteration < KEEP_FROM and self.limit > KEEP_FROM
        ):
            return
        if math.isfinite(error) and (
            self.kept is None or error < 0.9 * self.kept[0]
        ):
            pixels = np.flatnonzero(self.state.p)
            self.kept = error, pixels, self.state.p.ravel()[pixels]

    def _outcome(self, rounding: bool = False) -> GridSolution:
        """The present solution, or the best one kept if the iteration ended without reaching the tolerance."""
        target = self.tolerance * self._scale()
        kept = self.kept
        if (
            self.standing.error >= target
            and kept is not None
            and not self.standing.error <= kept[0]
        ):
            self.state.p.fill(0)
            self.state.p.ravel()[kept[1]] = kept[2]
            self._evaluate_gap(self._reporting_operator())
            self._assess()
        s = self.standing
        converged = s.error < self.tolerance * self._scale()
        # Rounding of a gap in single precision is not in the error measured with it.
        noise = (
            self._noise()
            if self.final and self.evaluated_by.dtype == np.float32
            else 0.0
        )
        estimate = self._pressure_error() if self.final else (0.0, 0.0)
        return GridSolution(
            self.state.p,
            self.state.r,
            s.offset,
            self._offset(),
            self._scale(),
            s.rms_gap + noise,
            s.penetration + noise if s.penetration > 0.0 else 0.0,
            converged,
            self.iteration,
            self.notes,
            rounding or (not converged and self._at_rounding()),
            estimate,
        )

    def _tighten(self, outcome: GridSolution) -> bool:
        """Lower the tolerance if the error of the pressure is too large; the iteration starts anew from here."""
        error, wanted = (
            outcome.pressure_error[0],
            self.grid.settings.pressure_tolerance,
        )
        if not self.final or wanted is None or error <= wanted:
            return False
        self.tolerance = 0.7 * wanted / error * self.standing.error / self._scale()
        self.steepest = True
        self.best, self.best_iteration = self.standing.error, self.iteration
        return True

    def _pressure_error(self) -> tuple[float, float]:
        """Estimate of the error of the pressure: relative L2 norm, largest relative to the largest pressure.

        The linear equations for the correction on the present working set are solved by a few steps of conjugate
        gradients, often only one, until a further step would change the estimate little. The pressure is not changed,
        but the residual and the direction are.
        """
        grid, s = self.grid, self.standing
        if not s.norm:
            return 0.0, 0.0
        correction = np.zeros_like(self.search.v)
        highest = float(self.state.p.max())
        before = norms = (0.0, 0.0)
        rest = math.inf
        self.steepest, self.since_evaluation = True, 1
        for count in range(1, MOST_ESTIMATES + 1):
            slope, length = self._find_direction(self.iteration == 0 and count == 1)
            if length == 0.0:
                break
            curvature = self._image()
            if not curvature > 0.0:
                break
            step = slope / curvature
            args = self.search, correction, step, step * grid.stiffness
            grid.run(kernels.correct, self.active, *args, grid.part)
            largest = float(grid.part[:, 1].max())
            squares, _, residual_sum, residual_squares = grid.sums(4)
            before, norms = norms, (math.sqrt(squares), largest)
            self.standing = replace(
                s, residual_sum=residual_sum, residual_squares=residual_squares
            )
            self.steepest, self.since_evaluation = False, self.since_evaluation + 1
            rest = (
                math.sqrt(self._spread(self.standing) / self._spread(s))
                if self._spread(s) > 0.0
                else math.inf
            )
            if (count == 1 and rest < REDUCED) or (
                count > 1
                and all(
                    new < SETTLED * old
                    for old, new in zip(before, norms, strict=True)
                )
            ):
                break
        self.standing = s
        total = []
        for old, new in zip(before, norms, strict=True):
            limit = new
            if before == (0.0, 0.0):
                limit *= 1.0 + rest if rest < REDUCED else 1.0
            elif 0.0 < old < new:
                ratio = min((new - old) / old, LARGEST_RATIO)
                limit += (new - old) * ratio / (1.0 - ratio)
            total.append(limit)
        floor = float(np.finfo(grid.state).eps)
        rounding = (floor, floor)
        if grid.hardness is not None:
            # the load that rounding the hardness changes is borne by the free pixels
            p, limit = self.state.p, float(grid.hardness)
            free = max(int(np.count_nonzero((p > 0) & (p < limit))), 1)
            changed = floor * limit * int(np.count_nonzero(p >= limit))
            rounding = (
                math.hypot(floor, changed / math.sqrt(free) / s.norm),
                math.hypot(floor, changed / free / highest),
            )
        return (
            math.hypot(total[0] / s.norm, rounding[0]),
            math.hypot(total[1] / highest, rounding[1]),
        )

    def _spread(self, s: Standing) -> float:
        """Sum of the squared residual over the working set, without its mean where the offset is unknown."""
        mean = s.residual_sum / s.pixels if self.grid.floating and s.pixels else 0.0
        # where nothing but the mean is left, rounding may leave less than nothing
        return max(s.residual_squares - mean * s.residual_sum, 0.0)

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

    def _precondition(self, clear: bool, renew: bool) -> None:
        """z from the residual, and ``outward`` anew if it is due."""
        grid, search = self.grid, self.search
        v, z, outward = search.v, search.z, search.outward
        if self.method == 0 and renew:
            grid.run(kernels.indicator, self.active, v, z, clear)
            if self.near_inverse:
                outward = self.near_inverse.apply(
                    z, self.active, outward, grid.part
                )
            else:
                outward = grid.operator.precondition(z)
        if self.near_inverse:
            self.near_inverse.apply(v, self.active, z, grid.part)
        else:
            z = grid.operator.precondition(v) if self.method < 2 else v
        self.search = search._replace(z=z, outward=outward)

    def _find_direction(self, renew: bool) -> tuple[float, float]:
        """The conjugate direction d; returns its product with the residual, and its norm, 0 if d is only noise."""
        grid, s = self.grid, self.standing
        if not s.pixels:
            return 0.0, 0.0
        # Blocks that were active before may not be any more.
        clear = self.since_evaluation == 1 or not self.split
        self._precondition(clear, renew)
        share = OUTWARD_SHARE if self.method == 0 else 0.0
        uniform = (self.near_inverse or grid.operator).stiffness
        grid.run(
            kernels.products, self.active, self.search, share, uniform, grid.part
        )
        sz, szv, sd, sdv, szy, sdy, sy = grid.sums(7)
        # Under a given load directions have zero mean.
        zm, dm = (
            (sz / s.pixels, sd / s.pixels)
            if grid.offset_fixed is None
            else (0.0, 0.0)
        )
        zv, zy = szv - zm * s.residual_sum, szy - zm * sy
        dv, dy = sdv - dm * s.residual_sum, sdy - dm * sy
        beta = -zy / dy if not self.steepest and dy > 0.0 else 0.0
        if beta < 0.0 or zv + beta * dv <= 0.0:
            beta = 0.0
        while True:
            few = s.pixels <= NOISE_PIXELS
            grid.run(
                kernels.direction,
                self.active,
                self.search,
                beta,
                zm + beta * dm,
                clear,
                few,
                grid.part,
            )
            squares, terms = grid.sums(2)
            limit = NOISE * float(np.finfo(grid.work).eps)
            if squares > limit * limit * terms:
                return zv + beta * dv, math.sqrt(squares)
            if beta == 0.0:
                return 0.0, 0.0
            # A few pixels have no further conjugate direction; z is not changed by the kernel.
            beta = 0.0

    def _image(self) -> float:
        """Displacement y under the direction d, not yet multiplied by the stiffness; returns the curvature along d."""
        grid, search = self.grid, self.search
        if self.near:
            self.near.apply(search.d, self.active, search.y, grid.part)
            return grid.stiffness * grid.sums(1)[0]
        spectrum = grid.operator.spectrum(search.d)
        curvature = grid.stiffness * grid.operator.energy(spectrum)
        self.search = search._replace(y=grid.operator.displacement(spectrum))
        return curvature

    def _move(self, slope: float, largest: float) -> None:
        """An exact line search along d, projection onto p ≥ 0 and the load, and the update of the gap. d becomes the
        change of p."""
        grid, search, near = self.grid, self.search, self.near
        d, y = search.d, search.y
        spectrum: Array = d
        if near:
            curvature = self._image()
        else:
            spectrum = grid.operator.spectrum(d)
            curvature = grid.stiffness * grid.operator.energy(spectrum)
        step = slope / curvature if curvature > 0.0 else math.inf
        # A vanishing load makes the body look infinitely soft; no pixel needs more than the whole load.
        step = min(step, LONGEST_STEP * grid.load / largest)
        shift, scale, squares = self._project(step)
        grid.run(
            kernels.move,
            self.active,
            self.state.p,
            d,
            step,
            shift,
            scale,
            grid.hardness,
            grid.part,
        )
        self.load = grid.sums(1)[0]
        left_out = math.sqrt(squares) + abs(scale - 1.0) * self.standing.norm
        if grid.stiffness * left_out > NEGLIGIBLE * self.standing.error:
            factor = grid.stiffness
            y = (
                near.apply(d, self.active, y, grid.part)
                if near
                else grid.operator.displacement(grid.operator.spectrum(d))
            )
        else:
            factor = grid.stiffness * step
            y = y if near else grid.operator.displacement(spectrum)
        scope: Active = self.active if self.split else grid.everywhere
        grid.run(
            kernels.advance, scope, self.state, y, factor, grid.hardness, grid.part
        )
        self.search = search._replace(y=y)
        self.evaluated = self.evaluated_exactly = self.steepest = False

    def _project(self, step: float) -> tuple[float, float, float]:
        """Shift and factor that make factor·max(p + step·d - shift, 0) bear the load, and Σ of its squared difference
        from p + step·d.

        This is the nearest admissible pressure. The sum is convex in the shift, so Newton's method from 0 increases
        the shift to the solution.
        """
        grid, shift = self.grid, 0.0
        args = self.active, self.state.p, self.search.d, step
        grid.run(kernels.projection, *args, shift, grid.hardness, grid.part)
        total, count, squares = grid.sums(3)
        if grid.offset_fixed is not None:
            return 0.0, 1.0, squares
        if grid.hardness is not None:
            return self._project_to_both(step, total, count, squares)
        for _ in range(NEWTON_STEPS):
            excess = total - grid.load
            if not squares or not count or excess <= LOAD_ACCURACY * grid.load:
                break
            shift += excess / count
            if excess < LITTLE_EXCESS * grid.load:
                return shift, 1.0, squares + count * shift**2
            grid.run(kernels.projection, *args, shift, None, grid.part)
            total, count, squares = grid.sums(3)
        return shift, grid.load / total if total > 0.0 else 1.0, squares

    def _project_to_both(
        self, step: float, total: float, count: float, squares: float
    ) -> tuple[float, float, float]:
        """As ``_project``, with a hardness: the sum is not convex in the shift, so that Newton's method is kept within
        bounds, and the shift is found by sorting where it is slow."""
        grid, shift, low, high = self.grid, 0.0, -math.inf, math.inf
        assert grid.hardness is not None
        args = self.active, self.state.p, self.search.d, step
        for _ in range(BOUNDED_STEPS):
            excess = total - grid.load
            if abs(excess) <= LOAD_ACCURACY * grid.load:
                return shift, 1.0, squares
            low, high = (shift, high) if excess > 0.0 else (low, shift)
            new = shift + excess / count if count else math.nan
            if not low < new < high:
                break
            if abs(excess) < LITTLE_EXCESS * min(
                grid.load, FEW_FREE * count * float(grid.hardness)
            ):
                return new, 1.0, squares + count * (new - shift) ** 2
            shift = new
            grid.run(kernels.projection, *args, shift, grid.hardness, grid.part)
            total, count, squares = grid.sums(3)
        p, d = self.state.p, self.search.d
        moved = d != 0
        q = p[moved] + step * d[moved].astype(np.float64)
        shift = shift_to(
            q,
            grid.load - float(p.sum(where=~moved, dtype=np.float64)),
            float(grid.hardness),
        )
        grid.run(kernels.projection, *args, shift, grid.hardness, grid.part)
        return shift, 1.0, grid.sums(3)[2]
