"""The adhesive contact on arrays: minimise ½ uᵀKu + Σ φ(g) + p̄ Σ g over gaps g ≥ 0, u = g + h.

K is the inverse of the substrate's symbol, φ the energy of attraction. The gradient is the sum of net traction and
attraction, so that at a minimum it vanishes where the gap is open, and presses where it is closed. The energy has
several minima, between which real contacts jump; the one that is found is below the start.

* Nonlinear conjugate gradients (Polak–Ribière) on the working set, the open pixels and those closed under tension,
  projected onto g ≥ 0: R. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29
  (2018); V. Rey, G. Anciaux, J.-F. Molinari, Comput. Mech. 60, 69 (2017). No step raises the energy.
* Preconditioner: the symbol itself restricted to the working set, levelled at wavelengths beyond the distance of
  contacts.
* The step along a direction is exact for the elastic energy (Parseval) and found by Newton's method for the attraction.
* An isolated contact is padded to the grid of its Green's function, on which the displacement beyond the surface is
  unknown too, and free of traction; its approach is one more unknown where the load is given.

Lengths are in pixels, stresses in units of the contact modulus: see ``_cohesion``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

from . import _cohesion as cohesion
from . import _kernels as kernels
from ._cohesion import CohesiveLaw
from ._operators import Substrate, Team

Array = NDArray[Any]
#: wave number up to which the preconditioner is levelled, in those of the side of the grid
LEVEL = 3.0
#: steps of Newton's method along a direction, and the part of the slope at which they end
NEWTON, FLAT = 4, 0.1
#: times that a step which raises the energy is halved
HALVINGS = 25
#: rms pressure, of the largest attraction, below which errors are not relative to the pressure any more
FAINT = 1e-6
#: how many times the relative error of the load counts in the error, where the approach is free
LOAD = 300.0
#: part of the terms of the energy that rounding may change
ROUNDING = 1e-13


@dataclass
class Prescribed:
    """What is given: the mean pressure, or the approach; the other is None."""

    pressure: float | None
    approach: float | None


@dataclass
class Found:
    """A minimum: gap and net traction on the pixels, approach, and how it was found."""

    unknown: Array
    """on the padded grid"""
    gap: Array
    traction: Array
    approach: float
    error: float
    converged: bool
    iterations: int
    transforms: int
    history: list[float] = field(default_factory=list)
    apart: bool = False
    """the surfaces moved away from each other without end"""


class Adhesive:
    """One minimisation: the arrays, and the steps on them."""

    def __init__(self, body: Substrate, heights: Array, law: CohesiveLaw, goal: Prescribed, team: Team) -> None:
        self.body, self.h, self.law, self.goal, self.team = body, heights, law, goal, team
        self.shape, self.padded = body.shape, body.padded
        self.periodic = body.periodic
        symbol = body.symbol() / body.unit
        if self.periodic:
            self.stiffness = np.divide(1.0, symbol, out=np.zeros_like(symbol), where=symbol > 0)
        else:
            self.stiffness = 1.0 / np.maximum(symbol, 1e-6 * float(symbol.max()) / max(self.padded))
        least = self.stiffness.ravel()[1:].min() if self.stiffness.size > 1 else 1.0
        level = LEVEL * least if self.periodic else 0.0
        self.inverse = 1.0 / np.sqrt(self.stiffness**2 + level**2) if self.periodic else 1.0 / self.stiffness
        #: of a rigid body of the size of the grid
        self.punch = math.sqrt(math.prod(self.shape))
        self.transforms = 0
        self.workers = team.threads if math.prod(self.padded) >= 1 << 17 else 1

    def forward(self, x: Array) -> Array:
        self.transforms += 1
        return np.asarray(sfft.rfft2(x, workers=self.workers))

    def backward(self, spectrum: Array, symbol: Array) -> Array:
        """The array of ``spectrum`` times ``symbol``; the spectrum is destroyed."""
        self.transforms += 1
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, symbol)
        return np.asarray(sfft.irfft2(spectrum, s=self.padded, workers=self.workers, overwrite_x=True))

    def quadratic(self, spectrum: Array) -> float:
        part = self.team.table(kernels.quadratic_form, spectrum.shape[0], 1, spectrum, self.stiffness, self.padded[1])
        return float(part.sum()) / math.prod(self.padded)

    def sums(self, kernel: Any, columns: int, *args: Any) -> list[float]:
        return self.team.table(kernel, self.padded[0], columns, *args).sum(axis=0).tolist()

    def spectrum(self, x: Array, rise: float) -> Array:
        u = np.empty(self.padded)
        self.team.run(cohesion.displaced, self.padded[0], x, self.h, rise, u)
        return self.forward(u)


@dataclass
class Iterate:
    """The unknown, its traction, and what follows."""

    x: Array
    rise: float
    spectrum: Array
    p: Array
    mean: float
    r: Array
    energy: float
    terms: float
    error: float
    excess: float
    """force over that given, of an isolated contact whose approach is free; else 0"""
    open_sum: float
    open_count: float
    contact: float
    fresh: bool
    """whether the spectrum is the transform of the unknown itself"""


def evaluate(problem: Adhesive, x: Array, rise: float, spectrum: Array | None = None) -> Iterate:
    """Traction, gradient and energy at ``x``, whose ``spectrum`` may be known."""
    goal, fresh = problem.goal, spectrum is None
    if spectrum is None:
        spectrum = problem.spectrum(x, rise)
    p = problem.backward(spectrum.copy(), problem.stiffness)
    free = not problem.periodic
    mean = 0.0 if free or goal.pressure is None else goal.pressure
    if not free and goal.pressure is None:
        total, count = problem.sums(cohesion.balance, 2, x, p, problem.law, problem.shape)
        mean = -total / count if count else 0.0
    r = np.empty(problem.padded)
    rr, pp, force, up, attracted, gaps, contact, level, count, borne = problem.sums(
        cohesion.gradient, 10, x, p, problem.h, rise, mean, problem.law, r
    )
    pixels = math.prod(problem.shape)
    excess = 0.0
    work = (goal.pressure or 0.0) * (gaps if not free else -rise * pixels)
    if free and goal.pressure is not None:
        excess = force - goal.pressure * pixels
    if free or goal.pressure is not None:
        level = 0.0
    shift = level / count if count else 0.0
    residual = max(rr - shift * level, 0.0)
    pp = max(pp, (FAINT * problem.law.work / problem.law.range) ** 2 * pixels)
    error = math.sqrt(residual / pp) if pp > 0 else (0.0 if residual == 0 else math.inf)
    if excess:
        error = max(error, LOAD * abs(excess) / borne if borne else math.inf)
    energy, terms = 0.5 * up + attracted + work, abs(0.5 * up) + abs(attracted) + abs(work)
    return Iterate(x, rise, spectrum, p, mean, r, energy, terms, error, excess, shift, count, contact, fresh)


def minimise(problem: Adhesive, x: Array, rise: float, tolerance: float, limit: int) -> Found:
    """The minimum below the gap ``x`` (padded) at the approach ``rise``. Never raises for lack of convergence."""
    here = evaluate(problem, x, rise)
    d, before = np.zeros(problem.padded), np.zeros(problem.padded)
    history, size, ds, restart, iteration, before_excess = [min(here.error, 1e300)], 0.0, 0.0, True, 0, 0.0
    apart = False
    while iteration < limit:
        if here.error <= tolerance:
            if here.fresh:
                break
            # the spectrum was a sum of those of the steps
            here = evaluate(problem, here.x, here.rise)
            continue
        iteration += 1
        z = problem.backward(problem.forward(here.r), problem.inverse)
        shift = here.open_sum
        rz, bz, zs = problem.sums(cohesion.products, 3, here.r, before, z, shift)
        level = zs / here.open_count if problem.periodic and problem.goal.pressure is None else 0.0
        pull = here.excess / problem.punch
        now = rz + here.excess * pull
        beta = 0.0 if restart or size <= 0 else max(0.0, (now - bz - before_excess * pull) / size)
        (slope,) = problem.sums(cohesion.direction, 1, here.r, z, level, beta, d)
        ds = -pull + beta * ds
        slope += here.excess * ds
        if not slope < 0 and beta > 0:
            (slope,) = problem.sums(cohesion.direction, 1, here.r, z, level, 0.0, d)
            ds = -pull
            slope += here.excess * ds
        size, before, before_excess = now, here.r, here.excess
        there = step(problem, here, d, ds, slope)
        if there is None:
            if restart:
                break
            restart = True
            continue
        restart = False
        here = there
        history.append(min(here.error, 1e300))
        if _gone(problem, here):
            apart = True
            break
    nx, ny = problem.shape
    return Found(
        unknown=here.x,
        gap=np.ascontiguousarray(here.x[:nx, :ny]),
        traction=np.ascontiguousarray(here.p[:nx, :ny]) + here.mean,
        approach=_approach(problem, here),
        error=here.error,
        converged=here.error <= tolerance,
        iterations=iteration,
        transforms=problem.transforms,
        history=history,
        apart=apart,
    )


def step(problem: Adhesive, here: Iterate, d: Array, ds: float, slope: float) -> Iterate | None:
    """The lowest point along the direction; None if none is lower."""
    if not slope < 0:
        return None
    whole = d
    if ds:
        whole = d.copy()
        whole[: problem.shape[0], : problem.shape[1]] += ds
    spectrum = problem.forward(whole)
    curvature = problem.quadratic(spectrum)
    x, law, shape = here.x, problem.law, problem.shape
    change, second = problem.sums(cohesion.along, 2, x, d, 0.0, law, shape)
    length = -slope / (curvature + second if curvature + second > 0.1 * curvature else curvature or -slope)
    for _ in range(NEWTON):
        change, second = problem.sums(cohesion.along, 2, x, d, length, law, shape)
        rest = slope + length * curvature + change
        if abs(rest) <= -FLAT * slope:
            break
        bend = curvature + second
        length = length - rest / bend if bend > 0.1 * curvature else 2.0 * length
        length = max(length, 0.0) or -slope / (curvature or 1.0)
    for _ in range(HALVINGS):
        out, shifted = np.empty_like(x), 0.0
        stopped, total, count = problem.sums(cohesion.move, 3, x, d, length, 0.0, shape, out)
        if problem.periodic and problem.goal.pressure is None:
            out, shifted = _levelled(problem, x, d, length, total, count, out)
        new = None if stopped or shifted else here.spectrum + length * spectrum
        there = evaluate(problem, out, here.rise + length * ds, new)
        if there.energy <= here.energy + ROUNDING * (here.terms + there.terms):
            return there
        length *= 0.5
    return None


def _levelled(
    problem: Adhesive, x: Array, d: Array, length: float, total: float, count: float, out: Array
) -> tuple[Array, float]:
    """The step with a shift of the open pixels that keeps the mean gap of a given approach."""
    wanted = (problem.goal.approach or 0.0) + float(problem.h.mean())
    wanted = -wanted * math.prod(problem.shape)
    shift = 0.0
    for _ in range(30):
        excess = total - wanted
        if abs(excess) <= 1e-13 * abs(wanted) or not count:
            break
        shift += excess / count
        _, total, count = problem.sums(cohesion.move, 3, x, d, length, shift, problem.shape, out)
    return out, shift


def _gone(problem: Adhesive, here: Iterate) -> bool:
    """Whether a pull has parted the surfaces: no contact, and next to no attraction left."""
    pressure = problem.goal.pressure
    if pressure is None or pressure >= 0 or here.contact:
        return False
    nx, ny = problem.shape
    gap = float(here.x[:nx, :ny].min())
    return cohesion.attraction(gap, problem.law)[0] < 0.1 * -pressure


def _approach(problem: Adhesive, here: Iterate) -> float:
    if not problem.periodic:
        return here.rise
    nx, ny = problem.shape
    return -float(problem.h.mean()) - float(here.x[:nx, :ny].mean())
