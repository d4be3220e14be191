"""The adhesive contact on arrays: minimise ½ uᵀKu + Σ φ(g) + p̄ Σ g over gaps g ≥ 0, u = g + h.

K is the inverse of the substrate's symbol, φ the energy of attraction. The gradient is the sum of net traction and
attraction, so that at a minimum it vanishes where the gap is open, and presses where it is closed. With a hardness H a
gap below zero costs H per area and depth, so that the material flows where the pressure is H. The energy has
several minima, between which real contacts jump; the one that is found is below the start.

* Nonlinear conjugate gradients (Polak–Ribière) on the working set, the open pixels and those closed under tension,
  projected onto g ≥ 0: R. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29
  (2018); V. Rey, G. Anciaux, J.-F. Molinari, Comput. Mech. 60, 69 (2017). No step raises the energy.
* Preconditioner: the symbol itself restricted to the working set, levelled at wavelengths beyond the distance of
  contacts, and weighted by the distance from them, and by the slope of a stress that jumps; in single precision.
* The step along a direction is exact for the elastic energy (Parseval) and found by Newton's method for the attraction;
  one whose stress jumps is replaced by its tangents, which lie above it, until the zone in which it acts has settled.
* It starts from the traction on a coarser grid.
* An isolated contact is padded to the grid of its Green's function, on which the displacement beyond the surface is
  unknown too, and free of traction; its approach is one more unknown where the load is given.

Lengths are in pixels, stresses in units of the contact modulus: see ``_cohesion``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft
from scipy.ndimage import distance_transform_cdt

from chemage import InputError

from . import _cohesion as cohesion
from . import _kernels as kernels
from ._cohesion import CohesiveLaw
from ._grid import resampled
from ._operators import Substrate, Team

Array = NDArray[Any]
#: wave number up to which the preconditioner is levelled, in those of the side of the grid
LEVEL = 3.0
#: distance from the contact, in pixels, at which it halves the response to a stress; iterations after which it is measured
#: again, if the contact has changed by more than this
EDGE, SETTLED, ALIKE = 2.5, 10, 0.01
#: steps of Newton's method along a direction, and the part of the slope at which they end
NEWTON, FLAT = 4, 0.1
#: error below which a stress that jumps is no longer replaced by its tangents: the zone in which it acts has settled
SHARP = 0.03
#: times that a step which raises the energy is halved
HALVINGS = 25
#: part of the hardness below it at which a coarse grid flows
YIELDS = 1e-3
#: rms pressure, of the largest attraction, below which errors are not relative to the pressure any more
FAINT = 1e-6
#: how many times the relative error of the load counts in the error, where the approach is free
LOAD = 300.0
#: the iteration goes on beyond the tolerance to this part of it, in at most so many times the iterations so far: what
#: that changes is the error that is stated
FINER, MORE, LEAST = 0.1, 1.0, 20
#: part of the terms of the energy that rounding may change
ROUNDING = 1e-13


@dataclass
class Iterate:
    """The unknown, its traction, and what follows."""

    x: Array
    rise: float
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


class Adhesive:
    """One minimisation at a given mean ``pressure``, or at a given ``approach``, the other being None: the arrays, and
    the steps on them."""

    def __init__(
        self,
        body: Substrate,
        heights: Array,
        law: CohesiveLaw,
        pressure: float | None,
        approach: float | None,
        team: Team,
    ) -> None:
        self.h, self.law, self.pressure, self.given_approach, self.team = (
            heights,
            law,
            pressure,
            approach,
            team,
        )
        self.shape, self.padded = body.shape, body.padded
        self.periodic, self.unit = body.periodic, body.unit
        symbol = body.symbol() / body.unit
        #: displacement under the mean pressure of a layer on a rigid base
        self.uniform = (pressure or 0.0) * float(symbol[0, 0]) * self.periodic
        #: whether the mean plane of the body is the reference, so that a uniform displacement costs nothing
        self.floating = self.periodic and (pressure is not None or not symbol[0, 0])
        if self.floating:
            symbol[0, 0] = 0.0
        if self.periodic:
            self.stiffness = np.divide(
                1.0, symbol, out=np.zeros_like(symbol), where=symbol > 0
            )
        else:
            self.stiffness = 1.0 / np.maximum(
                symbol, 1e-6 * float(symbol.max()) / max(self.padded)
            )
        least = self.stiffness.ravel()[1:].min() if self.stiffness.size > 1 else 1.0
        level = LEVEL * least if self.floating else 0.0
        self.inverse = (1.0 / np.hypot(self.stiffness, level)).astype(np.float32)
        #: of a rigid body of the size of the grid
        self.punch = math.sqrt(math.prod(self.shape))
        self.transforms = self.iterations = 0
        self.history: list[float] = []
        #: where the tolerance was reached, and the last iterate after that
        self.ends: tuple[Iterate, Iterate] | None = None
        self.spare: list[Array] = []
        self.u = np.empty(self.padded)
        self.z, self.weight = (np.empty(self.padded, np.float32) for _ in range(2))
        self.workers = team.threads if math.prod(self.padded) >= 1 << 17 else 1

    def forward(self, x: Array) -> Array:
        self.transforms += 1
        return np.asarray(sfft.rfft2(x, workers=self.workers))

    def backward(self, spectrum: Array, symbol: Array) -> Array:
        """The array of ``spectrum`` times ``symbol``; the spectrum is destroyed."""
        self.transforms += 1
        self.team.run(kernels.multiply, spectrum.shape[0], spectrum, symbol)
        # axis by axis: half of the time of one call for both in double precision
        columns: Any = sfft.ifft(
            spectrum, axis=0, workers=self.workers, overwrite_x=True
        )
        return np.asarray(
            sfft.irfft(columns, self.padded[1], axis=1, workers=self.workers)
        )

    def empty(self) -> Array:
        """An array to fill, one that was used before if there is one: new memory takes longer than a pass over it."""
        return self.spare.pop() if self.spare else np.empty(self.padded)

    def sums(self, kernel: Any, columns: int, *args: Any) -> list[float]:
        return (
            self.team.table(kernel, self.padded[0], columns, *args)
            .sum(axis=0)
            .tolist()
        )

    def undeformed(self) -> tuple[Array, float]:
        """Bodies that just touch."""
        x = np.zeros(self.padded)
        x[: self.shape[0], : self.shape[1]] = -self.h
        return x, 0.0

    def refined(
        self, coarse: Adhesive, found: Iterate, closed: float
    ) -> tuple[Array, float]:
        """The unknown and the approach that follow from the traction on a coarser grid; pixels of which more than the
        part ``closed`` touches there touch."""
        nx, ny = coarse.shape
        ratio = coarse.unit / self.unit
        traction = np.ascontiguousarray(found.p[:nx, :ny]) + found.mean
        contact = (found.x[:nx, :ny] <= 0).astype(np.float64)
        level = float((found.x[:nx, :ny] + coarse.h).mean()) * ratio
        p, touching = (
            resampled(field, self.shape, np.float64, self.periodic, self.team)
            for field in (traction, contact)
        )
        x, rise = np.zeros(self.padded), ratio * found.rise
        nx, ny = self.shape
        x[:nx, :ny] = p
        symbol = np.divide(
            1.0,
            self.stiffness,
            out=np.zeros_like(self.stiffness),
            where=self.stiffness > 0,
        )
        x = self.backward(self.forward(x), symbol)
        if self.floating:
            x += level - float(x.mean())
        gap = x[:nx, :ny]
        gap -= self.h + rise
        flows = p >= (1 - YIELDS) * self.law.hardness
        gap[((touching > closed) | (gap < 0)) & ~flows] = 0.0
        gap[flows] = np.minimum(gap[flows], 0.0)
        return x, rise

    def placed(self, x: Array, rise: float, approach: float) -> tuple[Array, float]:
        """The surfaces of ``x`` and ``rise`` moved to another ``approach`` with the elastic body as it is, but not into
        each other."""
        nx, ny = self.shape
        x = x.copy()
        inside = x[:nx, :ny]
        if not self.floating:
            np.maximum(inside - (approach - rise), 0.0, out=inside)
            return x, approach
        wanted = -float(self.h.mean()) - approach
        if not wanted > 0:
            raise InputError.of(
                "displacement",
                approach,
                "is one at which the surfaces touch everywhere",
                "give a smaller approach",
            )
        low, high = -wanted - float(inside.max()), float(inside.max())
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high)
                if float(np.maximum(inside - middle, 0.0).mean()) > wanted
                else (low, middle)
            )
        np.maximum(inside - 0.5 * (low + high), 0.0, out=inside)
        return x, 0.0

    def evaluate(self, x: Array, rise: float) -> Iterate:
        """Traction, gradient and energy at ``x``."""
        self.team.run(cohesion.displaced, self.padded[0], x, self.h, rise, self.u)
        p = self.backward(self.forward(self.u), self.stiffness)
        free = not self.floating
        mean = 0.0 if free or self.pressure is None else self.pressure
        if not free and self.pressure is None:
            total, count = self.sums(
                cohesion.balance, 2, x, p, self.law, self.shape
            )
            mean = -total / count if count else 0.0
        r = self.empty()
        rr, pp, force, up, attracted, gaps, contact, level, count, borne = (
            self.sums(cohesion.gradient, 10, x, p, self.h, rise, mean, self.law, r)
        )
        pixels = math.prod(self.shape)
        excess = 0.0
        work = (self.pressure or 0.0) * (gaps if not free else -rise * pixels)
        if free and self.pressure is not None:
            excess = force - self.pressure * pixels
        if free or self.pressure is not None:
            level = 0.0
        shift = level / count if count else 0.0
        residual = max(rr - shift * level, 0.0)
        pp = max(pp, (FAINT * self.law.work / self.law.range) ** 2 * pixels)
        error = (
            math.sqrt(residual / pp)
            if pp > 0
            else (0.0 if residual == 0 else math.inf)
        )
        if excess:
            error = max(error, LOAD * abs(excess) / borne if borne else math.inf)
        energy = 0.5 * up + attracted + work
        terms = abs(0.5 * up) + abs(attracted) + abs(work)
        return Iterate(
            x,
            rise,
            p,
            mean,
            r,
            energy,
            terms,
            error,
            excess,
            shift,
            count,
            contact,
        )

    def minimise(
        self,
        x: Array,
        rise: float,
        tolerance: float,
        limit: int,
        finer: float = FINER,
    ) -> Iterate:
        """The minimum below the gap ``x`` (padded) at the approach ``rise``. Never raises for lack of convergence.

        Beyond the tolerance the iteration goes on to ``finer`` times it: :attr:`ends` has both ends.
        """
        here = self.evaluate(x, rise)
        reached, before, free, excess = None, here.r, False, 0.0
        d = np.zeros(self.padded)
        self.history.append(min(here.error, 1e300))
        size, ds, restart = 0.0, 0.0, True
        edge, touched = np.empty(0), math.inf
        while self.iterations < limit:
            if reached is None and here.error <= tolerance:
                reached = here
                limit = self.iterations + max(LEAST, int(MORE * self.iterations))
            if here.error <= finer * tolerance and (
                max(self.history[-3:]) <= tolerance or finer == 1
            ):
                break
            self.iterations += 1
            if (self.iterations - 1) % SETTLED == 0 and not math.isclose(
                here.contact, touched, rel_tol=ALIKE
            ):
                edge, touched = self.edge(here), here.contact
            fields = here.r, here.x, edge, self.law, self.shape, self.weight, self.z
            self.team.run(cohesion.weighted, self.padded[0], *fields)
            z = self.backward(self.forward(self.z), self.inverse)
            fields = here.r, before, self.weight, here.open_sum, z
            rz, bz, zs = self.sums(cohesion.products, 3, *fields)
            level = (
                zs / here.open_count
                if self.floating and self.pressure is None
                else 0.0
            )
            pull = here.excess / self.punch
            now = rz + here.excess * pull
            beta = (
                0.0
                if restart or size <= 0
                else max(0.0, (now - bz - excess * pull) / size)
            )
            (slope,) = self.sums(cohesion.direction, 1, here.r, z, level, beta, d)
            ds = -pull + beta * ds
            slope += here.excess * ds
            if not slope < 0 and beta > 0:
                (slope,) = self.sums(
                    cohesion.direction, 1, here.r, z, level, 0.0, d
                )
                ds = -pull
                slope += here.excess * ds
            size = now
            there = self.step(here, d, ds, slope)
            if there is None:
                if restart:
                    break
                restart = True
                continue
            if free:
                self.spare.append(before)
            free = here is not reached
            if free and here.x is not x:
                self.spare.append(here.x)
            before, excess, here, restart = here.r, here.excess, there, False
            self.history.append(min(here.error, 1e300))
            if self.parted(here):
                break
        if reached is None:
            return here
        self.ends = reached, here
        return here if here.error <= tolerance or self.parted(here) else reached

    def edge(self, here: Iterate) -> Array:
        """What directions are weighted by near the contact, at whose edge the response to a stress vanishes as the root
        of the distance."""
        touching = here.r == 0.0
        if not touching.any():
            return np.ones_like(here.r, np.float32)
        distance = np.asarray(distance_transform_cdt(~touching), np.float32)
        np.maximum(distance, 1.0, out=distance)
        return np.sqrt(distance / (distance + EDGE))

    def energies(self, here: Iterate) -> tuple[float, float]:
        """Elastic energy and that of the attraction, and the latter alone (≤ 0)."""
        nx, ny = self.shape
        gaps = (
            float(here.x[:nx, :ny].sum())
            if self.floating
            else -here.rise * math.prod(self.shape)
        )
        work = (self.pressure or 0.0) * gaps
        energy = here.energy - work
        mean = 0.5 * self.uniform * (self.pressure or 0.0) * math.prod(self.shape)
        return energy + mean, 0.5 * (energy - (here.terms - abs(work)))

    def step(
        self, here: Iterate, d: Array, ds: float, slope: float
    ) -> Iterate | None:
        """The lowest point along the direction; None if none is lower."""
        if not slope < 0:
            return None
        np.copyto(self.z, d, casting="same_kind")
        if ds:
            self.z[: self.shape[0], : self.shape[1]] += ds
        spectrum = self.forward(self.z)
        part = self.team.table(
            kernels.quadratic_form,
            spectrum.shape[0],
            1,
            spectrum,
            self.stiffness,
            self.padded[1],
        )
        curvature = float(part.sum()) / math.prod(self.padded)
        x, law, shape = here.x, self.law, self.shape
        length = -slope / (curvature or -slope)
        # far from equilibrium, a step beyond that of the tangents to a stress that jumps passes others
        if law.exponential or here.error < SHARP:
            length = self._newton(x, d, slope, curvature)
        for _ in range(HALVINGS):
            out = self.empty()
            total, count = self.sums(
                cohesion.move, 2, x, d, here.r, length, 0.0, shape, out
            )
            if self.floating and self.pressure is None:
                self._levelled(x, d, here.r, length, total, count, out)
            there = self.evaluate(out, here.rise + length * ds)
            if there.energy <= here.energy + ROUNDING * (here.terms + there.terms):
                return there
            length *= 0.5
        return None

    def _newton(self, x: Array, d: Array, slope: float, curvature: float) -> float:
        """The length of a step to the lowest point along a direction."""
        law, shape = self.law, self.shape
        base, second = self.sums(cohesion.along, 2, x, d, 0.0, law, shape)
        length = -slope / (
            curvature + second
            if curvature + second > 0.1 * curvature
            else curvature or -slope
        )
        for _ in range(NEWTON):
            stress, second = self.sums(cohesion.along, 2, x, d, length, law, shape)
            rest = slope + length * curvature + stress - base
            if abs(rest) <= -FLAT * slope:
                break
            bend = curvature + second
            length = (
                length - rest / bend if bend > 0.1 * curvature else 2.0 * length
            )
            length = max(length, 0.0) or -slope / (curvature or 1.0)
        return length

    def _levelled(
        self,
        x: Array,
        d: Array,
        r: Array,
        length: float,
        total: float,
        count: float,
        out: Array,
    ) -> None:
        """Shift the open pixels of the step ``out`` so that it keeps the mean gap of a given approach."""
        wanted = (self.given_approach or 0.0) + float(self.h.mean())
        wanted = -wanted * math.prod(self.shape)
        shift = 0.0
        for _ in range(30):
            excess = total - wanted
            if abs(excess) <= 1e-13 * abs(wanted) or not count:
                break
            shift += excess / count
            total, count = self.sums(
                cohesion.move, 2, x, d, r, length, shift, self.shape, out
            )

    def parted(self, here: Iterate) -> bool:
        """Whether a pull has parted the surfaces: no contact, and next to no attraction left."""
        if self.pressure is None or self.pressure >= 0 or here.contact:
            return False
        nx, ny = self.shape
        gap = float(here.x[:nx, :ny].min())
        return cohesion.attraction(gap, self.law)[0] < 0.1 * -self.pressure
