"""The hard-wall contact problem on arrays: minimise ½ pᵀGp - pᵀh over p ≥ 0 at a given load or a given approach.

The gradient is the gap, so the solution satisfies p ≥ 0, gap ≥ 0, p·gap = 0. With a hardness H, 0 ≤ p ≤ H: the gap is
negative where p = H, by the plastic displacement. Method:

* Conjugate gradients on the working set {p > 0} ∪ {gap < 0}, without pixels that yield, p = H, until their gap is
  positive; projected onto the bounds and the load after an exact line search (by a shift, which gives the nearest
  admissible pressure), restarted only when the direction is not one of descent: I. A. Polonsky, L. M. Keer, Wear 231,
  206 (1999) without its restarts, after L. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol.
  Lett. 66, 29 (2018).
* Preconditioner of opposite order: the inverse symbol |q|, restricted to the working set: E. A. H. Vollebregt, J.
  Optim. Theory Appl. 162, 862 (2014). Most of its term for flow out of the working set is removed again (the regional
  instead of the restricted fractional Laplacian), which saves up to a third of the iterations.
* Coarse to fine: each grid starts from the interpolated solution of the next coarser one. With a hardness, where free
  pixels are too few to bear what the interpolation changes of the load, the pixels with the smallest gaps yield.
* Mixed precision by iterative refinement: pressure and gap are kept in double precision, but only *changes* of the
  gap are computed, in single precision, so that their rounding errors shrink with the changes.
* Most iterations use the split operator of ``_grid``, a stencil and a coarse grid, which costs less than one
  transform and nothing where nothing touches. The gap is evaluated exactly every few iterations, and convergence is
  judged by that gap alone (defect correction).
* Where the split operator does not apply (few pixels, free boundary), the step length comes from Parseval's theorem, and
  a step that clips nothing reuses the spectrum of its direction: four or five transforms per iteration.

Everything is made dimensionless: heights in units of their rms value, measured down from the highest point; pressure
in units of a power of two near its mean, so that the conversion at the end does not round and the pressure returned is
the one whose errors were measured. This module goes from grid to grid; ``_grid`` is the problem on one grid and
``_descent`` the iteration on it. ``compile_kernels`` compiles the kernels of a solve without solving: each is called
once, on no rows and on arrays of one pixel.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._bounds import projected, restored
from ._descent import Descent, GridSolution
from ._grid import (
    PRECISIONS,
    GridProblem,
    Settings,
    along_columns,
    along_rows,
    dimensionless,
    grids,
    resampled,
    suits,
    sums,
)
from ._kernels import DescentState, Heights
from ._operators import Substrate, Team

Array = NDArray[Any]
Call = tuple[Callable[..., None], tuple[Any, ...]]

#: A coarse grid only provides a start: it is solved to this tolerance, in at most so many iterations.
COARSE_TOLERANCE = 1e-2
COARSE_ITERATIONS = 30


def solve(
    substrate: Substrate,
    heights: Heights,
    *,
    stiffness: float,
    mean: float = 1.0,
    hardness: float | None = None,
    offset: float | None = None,
    start: Array | None = None,
    settings: Settings,
    team: Team,
) -> GridSolution:
    """Solve on ``substrate`` for ``heights``.

    ``stiffness`` is (unit of pressure)·pixel/(E*·unit of height). With ``offset`` None ``mean`` is the mean pressure;
    otherwise the gap is G p - h + offset and the load follows (negative: approach since first touch). ``hardness`` is
    the largest pressure, not below the mean one. ``start`` is a pressure to begin from instead of a coarser grid. Never
    raises for lack of convergence: look at ``converged``.
    """
    state = PRECISIONS[settings.precision][0]
    shapes = grids(substrate.shape, 1 if start is not None else settings.levels)
    levels: list[tuple[tuple[int, int], int]] = []
    p = None if start is None else np.array(start, dtype=state)
    for shape in reversed(shapes):
        finest = shape == substrate.shape
        here = substrate if finest else substrate.regrid(shape)
        h = heights
        if not finest:
            sampled = resampled(
                heights.values, shape, np.float64, substrate.periodic, team
            )
            sampled.setflags(
                write=False
            )  # as those of a surface, or numba compiles kernels for both
            h = Heights(
                dimensionless(heights._replace(values=sampled), state, team)
            )
            h.values.setflags(write=False)
        # Displacements are counted in pixels of the grid at hand.
        pixels = (
            here.pixel[0]
            * here.pixel[1]
            / (substrate.pixel[0] * substrate.pixel[1])
        )
        grid = GridProblem(
            here,
            h,
            stiffness * math.sqrt(pixels),
            mean,
            offset,
            settings,
            team,
            finest,
            hardness,
        )
        end = _solve_on(grid, p, finest)
        p = end.pressure
        levels.append((shape, end.iterations))
        if finest:
            end.gap += end.gap_offset
            return replace(
                end,
                offset=end.offset - stiffness * mean * grid.uniform,
                rms_gap=end.rms_gap / end.scale,
                penetration=end.penetration / end.scale,
                transforms=grid.transforms,
                history=[
                    (rms / end.scale, deepest / end.scale)
                    for rms, deepest in grid.history
                ],
                levels=levels,
            )
    raise AssertionError("there is always a finest grid")


def _solve_on(grid: GridProblem, p: Array | None, finest: bool) -> GridSolution:
    """Solve on one grid, from the pressure on a coarser one (or on this one), or from none."""
    body = grid.substrate
    settings = grid.settings
    load_given = grid.offset_fixed is None
    if p is None and load_given:
        # the admissible pressure nearest to the one that presses the heights flat
        p = projected(
            _flattening(grid) + grid.mean, grid.mean, grid.hardness
        ).astype(grid.state)
    elif p is None:
        q = dimensionless(grid.heights, grid.work, grid.team) - grid.work(
            grid.offset_fixed
        )
        p = np.maximum(grid.operator.precondition(q), 0.0).astype(
            grid.state
        ) / grid.state(grid.stiffness)
    elif p.shape != body.shape:
        p = resampled(
            p,
            body.shape,
            grid.state,
            body.periodic,
            grid.team,
            kernels.resample_pressure,
            grid.hardness,
        )
    if grid.hardness is not None:
        np.minimum(p, grid.hardness, out=p)
    total = grid.load
    if load_given:
        total, _, least = sums(p, p, grid.team)
        total = restored(p, total, grid.load, grid.hardness, grid.team)
        if body.padded == body.shape and least > 0.0:
            end = _full_contact(grid)
            if end is not None:
                return end
    tolerance, limit = settings.tolerance, settings.max_iterations
    if not finest:
        tolerance, limit = (
            max(tolerance, COARSE_TOLERANCE),
            min(limit, COARSE_ITERATIONS),
        )
    return Descent(grid, p, total, tolerance, limit, finest).run()


def _flattening(grid: GridProblem) -> Array:
    """Pressure with mean 0 that presses the heights flat: exact where nothing is padded."""
    q = grid.exact().precondition(
        dimensionless(grid.heights, grid.state, grid.team)
    )
    q -= q.dtype.type(q.mean(dtype=np.float64))
    # At vanishing loads only its shape is of use.
    q *= q.dtype.type(1.0 / max(grid.stiffness, 1e-12))
    return q


def _full_contact(grid: GridProblem) -> GridSolution | None:
    """The solution if every pixel touches, else None.

    The gap is computed from the varying part of the pressure: under a large mean the sum would not resolve it. It is
    that of the pressure returned, after the mean was added and the sum rounded. That pressure is the solution rounded
    to its precision, and counts as converged even if its error exceeds the tolerance.
    """
    mean = grid.state(grid.mean)
    p = _flattening(grid)
    p += mean
    if float(p.min()) <= 0.0 or (
        grid.hardness is not None and float(p.max()) > grid.hardness
    ):
        return None
    varying = p - mean
    r = np.empty_like(p)
    # The mean height is the offset, if the load is given and the body periodic.
    base = float(np.mean(dimensionless(grid.heights, np.float64, grid.team)))
    operator = (
        grid.exact()
        if grid.state == np.float64 or not grid.finest
        else grid.double()
    )
    grid.gap(operator, base, DescentState(varying, r))
    correction = -float(r.mean(dtype=np.float64))
    rms = math.sqrt(
        float(np.mean(np.square(r + r.dtype.type(correction)), dtype=np.float64))
    )
    grid.history.append((rms, 0.0))
    offset = base + correction
    approach = grid.uniform * grid.stiffness * grid.mean - offset
    scale = min(1.0, approach) if approach > 0.0 else 1.0
    eps = 2.0 * float(np.finfo(grid.state).eps)
    return GridSolution(
        p, r, correction, offset, scale, rms, 0.0, True, 0, [], True, (eps, eps)
    )


def compile_kernels(
    body: Substrate,
    settings: Settings,
    heights: Any = np.float64,
    bounded: bool = False,
) -> None:
    """Compile what a solve on ``body`` calls, the last kernel first.

    ``heights``: dtype of the heights of the surface; ``bounded``: there is a hardness. The order is the reverse of that
    in which a solve calls them, so that a second process that does this while the first one solves compiles what the
    first one has not reached yet.
    """
    for kernel, args in reversed(
        list(_calls(body, settings, np.dtype(heights), bounded))
    ):
        kernel(0, 0, *args)


def _calls(
    body: Substrate, settings: Settings, heights: Any, bounded: bool
) -> Iterator[Call]:
    """The kernels of a solve with their arguments, in the order in which they are first called.

    What an argument is follows from its name: one of ``known``, arrays of one pixel among them, else a number.
    """
    state, work = PRECISIONS[settings.precision]
    p, pixel = np.zeros((1, 1), state), np.zeros((1, 1), work)
    place, source = np.zeros(1, np.int64), np.zeros((1, 1), heights)
    source.setflags(write=False)  # as the heights of a surface
    axis = kernels.Interpolation(place, place, np.zeros(1))
    fields = "u", "v", "d", "e", "y", "x", "out", "coarse", "stencil"
    known: dict[str, Any] = {
        **dict.fromkeys(fields, pixel),
        "p": p,
        "r": p,
        "blocks": kernels.Blocks(16, 1, np.zeros(1, np.uint8)),
        "state": DescentState(p, p),
        "search": kernels.Search(pixel, pixel, pixel, pixel, pixel),
        "hardness": state(1) if bounded else None,
        "rows": along_rows(4, 1, work),
        "columns": along_columns(4, 1, work),
        "part": np.zeros((1, 7)),
        "ny": 1,
        "clear": True,
        "terms": True,
    }

    def call(kernel: Any, **others: Any) -> Call:
        names = list(inspect.signature(kernel).parameters)[2:]
        return kernel, tuple((known | others).get(name, 1.0) for name in names)

    def spectral(kernel: Any, dtype: Any = work) -> Call:
        spectrum = np.zeros((1, 1), np.result_type(dtype, np.complex64))
        return call(
            kernel,
            symbol=np.zeros((1, 1), dtype),
            spectrum=spectrum,
            z=spectrum,
            turn=spectrum[0],
        )

    yield call(kernels.moments, heights=source)
    shapes, convolution = grids(body.shape, settings.levels), kernels.multiply
    if len(shapes) > 1:
        yield call(
            kernels.resample,
            source=source,
            rows=axis,
            columns=axis,
            target=np.zeros((1, 1)),
        )
    for shape in reversed(shapes):
        here, surface = body, Heights(source)
        if shape != body.shape:
            values = np.zeros((1, 1), state)
            values.setflags(write=False)
            here, surface = body.regrid(shape), Heights(values)
        convolution = (
            kernels.multiply_packed
            if body.periodic and shape[1] % 2 == 0
            else kernels.multiply
        )
        split = suits(here)
        if shape == shapes[-1]:
            yield spectral(convolution, state)
        else:
            yield call(
                kernels.resample_pressure,
                source=p,
                rows=axis,
                columns=axis,
                target=p,
            )
        yield call(kernels.totals)
        yield call(kernels.scale, factor=state(1))
        yield spectral(convolution)
        yield call(kernels.subtract, heights=surface)
        yield call(kernels.residual)
        yield call(kernels.indicator)
        if split:
            yield call(kernels.restrict)
            yield call(kernels.local)
        yield from map(call, (kernels.products, kernels.direction))
        if not split:
            yield spectral(kernels.quadratic_form)
            yield spectral(kernels.multiply)
        yield from map(call, (kernels.projection, kernels.move, kernels.advance))
    if state != work:
        yield spectral(convolution, state)
        yield call(kernels.subtract, u=p, heights=Heights(source))
    yield call(kernels.correct)
    yield call(kernels.scale, factor=state(1), hardness=None)
