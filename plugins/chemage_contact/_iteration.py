"""The hard-wall contact problem on arrays: minimise ½ pᵀGp - pᵀh over p ≥ 0 at a given load or a given approach.

The gradient is the gap, so the solution satisfies p ≥ 0, gap ≥ 0, p·gap = 0. Method:

* Conjugate gradients on the working set {p > 0} ∪ {gap < 0}, clipped to p ≥ 0 after an exact line search, restarted
  only when the direction is not one of descent: I. A. Polonsky, L. M. Keer, Wear 231, 206 (1999) without its
  restarts, after L. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29 (2018).
* Preconditioner of opposite order: the inverse symbol |q|, restricted to the working set: E. A. H. Vollebregt, J.
  Optim. Theory Appl. 162, 862 (2014). Most of its term for flow out of the working set is removed again (the regional
  instead of the restricted fractional Laplacian), which saves up to a third of the iterations.
* Coarse to fine: each grid starts from the interpolated solution of the next coarser one.
* Mixed precision by iterative refinement: pressure and gap are kept in double precision, but only *changes* of the
  gap are computed, in single precision, so that their rounding errors shrink with the changes.
* Most iterations use the split operator of ``_split``, a stencil and a coarse grid, which costs less than one
  transform and nothing where nothing touches. The gap is evaluated exactly every few iterations, and convergence is
  judged by that gap alone (defect correction).
* Where the split operator does not apply (odd sizes, free boundary), the step length comes from Parseval's theorem, and
  a step that clips nothing reuses the spectrum of its direction: four or five transforms per iteration.

Everything is made dimensionless: heights in units of their rms value, measured down from the highest point; pressure
in units of its mean. This module goes from grid to grid; ``_grid`` is the problem on one grid and ``_descent`` the
iteration on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._descent import Descent, Outcome
from ._grid import PRECISIONS, Grid, Settings
from ._kernels import Heights
from ._operators import Substrate
from ._resampling import dimensionless, grids, regridded, resampled
from ._team import Team

Array = NDArray[Any]

#: A coarse grid only provides a start: it is solved to this tolerance, in at most so many iterations.
COARSE_TOLERANCE = 5e-3
COARSE_ITERATIONS = 30


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


def sums(p: Array, r: Array, team: Team) -> tuple[float, float, float]:
    """Σ p, Σ p·|r| and the least p, of two arrays (nx, ny)."""
    part = team.table(kernels.totals, p.shape[0], 3, p, r)
    return float(part[:, 0].sum()), float(part[:, 1].sum()), float(part[:, 2].min(initial=math.inf))


def rescale(p: Array, factor: float, team: Team) -> float:
    """Multiply p (nx, ny) in place; returns the new sum."""
    return float(team.table(kernels.scale, p.shape[0], 1, p, p.dtype.type(factor)).sum())


def projected(q: Array) -> Array:
    """The nearest array to q that has no negative entry and the mean 1: max(q - t, 0)."""
    order = np.sort(q, axis=None)[::-1].astype(np.float64)
    excess = np.cumsum(order) - q.size
    index = np.arange(1, q.size + 1)
    last = int(np.flatnonzero(order * index > excess)[-1])
    return np.maximum(q - excess[last] / (last + 1), 0.0)


def solve(
    substrate: Substrate,
    heights: Heights,
    *,
    stiffness: float,
    offset: float | None = None,
    start: Array | None = None,
    settings: Settings,
    team: Team,
) -> Result:
    """Solve on ``substrate`` for ``heights``.

    ``stiffness`` is (unit of pressure)·pixel/(E*·unit of height). With ``offset`` None the mean pressure is 1;
    otherwise the gap is G p - h + offset and the load follows (negative: approach since first touch). ``start`` is a
    pressure to begin from instead of a coarser grid. Never raises for lack of convergence: look at ``converged``.
    """
    state = PRECISIONS[settings.precision][0]
    shapes = grids(substrate.shape, 1 if start is not None else settings.levels)
    levels: list[tuple[tuple[int, int], int]] = []
    p = None if start is None else np.array(start, dtype=state)
    for shape in reversed(shapes):
        finest = shape == substrate.shape
        here = substrate if finest else substrate.regrid(shape)
        h = heights if finest else regridded(heights, shape, state, substrate.periodic, team)
        # Displacements are counted in pixels of the grid at hand.
        pixels = here.pixel[0] * here.pixel[1] / (substrate.pixel[0] * substrate.pixel[1])
        grid = Grid(here, h, stiffness * math.sqrt(pixels), offset, settings, team)
        end = _solve_on(grid, p, finest)
        p = end.pressure
        levels.append((shape, end.iterations))
        if finest:
            end.gap += end.offset
            return Result(
                pressure=p,
                gap=end.gap,
                offset=end.offset - stiffness * grid.uniform,
                rms_gap=end.rms_gap,
                penetration=end.penetration,
                converged=end.converged,
                iterations=end.iterations,
                transforms=grid.transforms,
                history=grid.history,
                levels=levels,
                notes=end.notes,
            )
    raise AssertionError("there is always a finest grid")


def _solve_on(grid: Grid, p: Array | None, finest: bool) -> Outcome:
    """Solve on one grid, from the pressure on a coarser one (or on this one), or from none."""
    body, settings, load_given = grid.substrate, grid.settings, grid.offset_fixed is None
    if p is None:
        p = _first_guess(grid)
    elif p.shape != body.shape:
        p = resampled(p, body.shape, grid.state, body.periodic, grid.team, kernels.resample_pressure)
    if load_given:
        total, _, least = sums(p, p, grid.team)
        rescale(p, p.size / total, grid.team)
        if body.padded == body.shape and least > 0.0:
            end = _full_contact(grid)
            if end is not None:
                return end
    tolerance, limit = settings.tolerance, settings.max_iterations
    if not finest:
        tolerance, limit = max(tolerance, COARSE_TOLERANCE), min(limit, COARSE_ITERATIONS)
    return Descent(grid, p, tolerance, limit, finest).run()


def _flattening(grid: Grid) -> Array:
    """Pressure with mean 0 that presses the heights flat: exact where nothing is padded."""
    q = grid.exact().precondition(dimensionless(grid.heights, grid.state, grid.team))
    q -= q.dtype.type(q.mean(dtype=np.float64))
    # At vanishing loads only its shape is of use.
    q *= q.dtype.type(1.0 / max(grid.stiffness, 1e-12))
    return q


def _full_contact(grid: Grid) -> Outcome | None:
    """The solution if every pixel touches, else None.

    The gap is computed from the varying part of the pressure: under a large mean the sum would not resolve it.
    """
    varying = _flattening(grid)
    if float(varying.min()) <= -1.0:
        return None
    r = grid.gap(varying, True)
    offset = -float(r.mean(dtype=np.float64))
    rms = math.sqrt(float(np.mean(np.square(r + r.dtype.type(offset)), dtype=np.float64)))
    varying += varying.dtype.type(1.0)
    grid.history.append((rms, 0.0))
    return Outcome(varying, r, offset, rms, 0.0, rms < grid.settings.tolerance, 0, [])


def _first_guess(grid: Grid) -> Array:
    """The admissible pressure nearest to the one that presses the heights flat."""
    if grid.offset_fixed is None:
        return projected(_flattening(grid) + 1.0).astype(grid.state)
    scaled = dimensionless(grid.heights, grid.work, grid.team)
    q = grid.operator.precondition(scaled - grid.work(grid.offset_fixed))
    return np.maximum(q, 0.0).astype(grid.state) / grid.state(grid.stiffness)
