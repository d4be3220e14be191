"""Any surface on an elastic half-space that attracts it: the boundary element method with a law of cohesion."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from chemage import ChemageError, ContactSolution, InputError, Surface
from chemage.plugin import ConvergenceError, Length, Unit, convert, threads
from chemage_contact._attraction import Adhesive, Iterate
from chemage_contact._cohesion import CohesiveLaw
from chemage_contact._grid import grids, resampled
from chemage_contact._operators import Substrate, Team
from chemage_contact._solvers import GRID, tabor
from chemage_contact.fft_bem import _BUGNICOURT, FFTBEM, GridSolver
from chemage_contact.paths import (
    Follower,
    Loop,
    Path,
    PathState,
    finer,
    more_errors,
)

#: largest pixel in units of E*ρ²/w, the length of the zone of cohesion; measured, see ``docs/contact.md``
COARSEST = 0.5
#: tolerance on coarse grids, which must not open what the next one holds closed, and iterations
COARSE_TOLERANCE, COARSE_ITERATIONS = {"apart": 2e-3, "contact": 1e-2}, 30
#: a pixel is closed first if coarse ones around it are in so much of it, from surfaces apart: the start must not be beyond
#: the equilibrium; else if they are in the rest
CLOSED = 0.99
#: attraction on the outermost pixels of a free surface that is noted, of the largest
AT_EDGE = 1e-2
#: pixels of the padded grid up to which the contact is solved from the other side, too, and the tolerance of that
BOTH_SIDES, OTHER_TOLERANCE = 1 << 17, 1e-3
#: how the error of the area grows with the pixel over the length of the zone of cohesion; calibrated
#: (``tests/benchmarks/contact_errors.py intervals``)
RIM = 8.0
#: the part of the pull-off force by which the rim is held, over the same, where the stress jumps: of spheres it is 0.02, the
#: rest is for the length over which the stress falls
HELD = 0.14
#: energy by which a jump is lost on such a rim, over the pull-off force times the range of the attraction; measured too
LOST = 0.5
#: standard error of what a path gives, over its change on pixels of half the size: twice as large where the stress jumps,
#: so that errors fall in proportion to the pixel; and beside it that of an approach at which surfaces jump, over the range
#: of the attraction. Of paths of ``tests/benchmarks/paths.py``: rough ones of seeds 1 and 2, spheres of seed 7
CHANGE, ANYWHERE = {"dugdale": 1.5, "exponential": 0.75}, 0.005
#: share of the largest attraction that is none: where a path ends that parts the surfaces
GONE = 1e-3
#: tolerance of a reference, and its iterations
REFERENCE_TOLERANCE, REFERENCE_ITERATIONS = 1e-8, 5000

_REY = """@article{rey2017,
  author = {Rey, V. and Anciaux, G. and Molinari, J.-F.},
  title = {Normal adhesive contact on rough surfaces: efficient algorithm for {FFT}-based {BEM} resolution},
  journal = {Computational Mechanics},
  volume = {60},
  pages = {69--81},
  year = {2017},
  doi = {10.1007/s00466-017-1392-5},
}"""


#: where an iteration begins: the unknown on the padded grid and the approach, in pixels
_Before = tuple[np.ndarray, float]


class PartedError(InputError):
    """No contact bears the load."""


class AdhesiveBEM(GridSolver):
    """Frictionless contact of a rigid surface with a flat elastic body that attracts it, at a given load.

    The surfaces do not overlap, and attract each other with the energy φ(g) per area at a gap g: ``exponential``,
    φ = −w exp(−g/ρ), or ``dugdale``, a constant stress w/ρ up to the gap ρ (over two elastic deformations of a pixel it
    falls to zero linearly, which keeps w). In contact are the pixels of zero gap. The pressure is the net one: elastic
    restoring stress, negative where attraction prevails, outside the contact too. With a ``hardness`` the material flows
    where the pressure reaches it (a gap below zero, the ``plastic_displacement``), at single loads or approaches.

    Converged means that the L2 norm of the stress out of balance (pressure plus attraction where the gap is open,
    tension beyond the attraction where it is closed), relative to that of the pressure (or of w/ρ times 1e-6 on every
    pixel, where that is larger: surfaces apart), is below ``tolerance``, in
    double precision, for the gap that is returned; and for a free boundary the error of the load below a 300th of it.
    That is a ``residual``: near a jump the pressure may be farther from the solution. The iteration goes on to a tenth
    of the tolerance, and how that changes the pressure is its ``pressure_error``. At a given load of a grid that is
    not large the contact is solved from the other side as well, and the difference is the error called ``branch``.

    A contact that adheres has a history: under one load there may be several. ``start`` says from which side it is
    approached, :meth:`loop` follows a path of loads or of approaches.
    """

    kind = "adhesive-bem"
    adheres = True
    implemented_properties = ("pressure", "gap", "displacement")
    later = ("levels", "hardness", "thickness", "substrate")
    speed_only = ("threads",)
    trade = {"tolerance": (1e-2, 1e-3, 1e-4, 1e-6)}
    cite = (
        "L. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29 (2018)",
        "V. Rey, G. Anciaux, J.-F. Molinari, Comput. Mech. 60, 69 (2017)",
    )
    bibtex = (_BUGNICOURT, _REY)

    work_of_adhesion: Annotated[Any, Unit("J/m**2", ge=0)] = Field(
        examples=["50 mJ/m^2"]
    )
    """work of adhesion w of the two surfaces, J/m² (the same number in nN/nm)"""
    range: Length = Field(examples=["0.3 nm"])
    """range ρ of the attraction, nm: the largest stress is w/ρ"""
    law: Literal["exponential", "dugdale"] = "exponential"
    """how the attraction falls with the gap"""
    start: Literal["apart", "contact"] = "apart"
    """where the surfaces come from, if both are possible: from the contact without attraction, or from gaps closed
    everywhere"""
    tolerance: float = Field(default=1e-4, ge=1e-12, lt=1, allow_inf_nan=False)
    """largest stress out of balance, relative to the pressure (L2 norms)"""
    coarse: Literal["refuse", "note"] = "refuse"
    """pixels too large for the zone of cohesion: an error, or a note in the result"""
    max_iterations: int = Field(default=2000, ge=0)
    """largest number of iterations"""

    def reference(self) -> AdhesiveBEM:
        """At a tolerance of 1e-8."""
        least = min(self.tolerance, REFERENCE_TOLERANCE)
        most = max(self.max_iterations, REFERENCE_ITERATIONS)
        return self.replace(
            tolerance=least, max_iterations=most, on_failure="return"
        )

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """Area and cost of the contact without attraction, and the iterations of this one, as measured."""
        if not {"nx", "ny"} <= surface.keys():
            return {}
        estimate = self._plain().expected(surface, max(load, 0.0))
        pixels = surface["nx"] * surface["ny"]
        padded = pixels * (
            1 if self.is_nominally_flat(surface.get("periodic") != 0) else 4
        )
        # the rest is for kernels that a first run compiles (`tests/benchmarks/memory.py`)
        estimate["bytes"] = max(estimate["bytes"], 165.0 * padded) + 3e7
        estimate["cpu_seconds"] += 0.05 + 1e-6 * padded * max(
            1.0, 1 - 0.3 * math.log10(self.tolerance / 1e-4)
        )
        estimate.pop("gap_bytes", None)
        if "radius" in surface and self.work_of_adhesion:
            estimate["tabor"] = tabor(
                surface["radius"], self.work_of_adhesion, self.modulus, self.range
            )
        return estimate | ({"gap_bytes": 8.0 * pixels} if self.gap else {})

    def check(self, surface: Mapping[str, float], load: float) -> tuple[str, ...]:
        """See :meth:`chemage.plugin.ContactSolver.check`."""
        doubts = []
        if "pixel_size" in surface and (
            text := self._unresolved(surface["pixel_size"])
        ):
            doubts.append(text)
        if "radius" in surface:
            self._bearable(surface["radius"], load)
        if surface.keys() >= GRID and load > 0:
            doubts += self._plain().check(
                {k: v for k, v in surface.items() if k != "radius"}, load
            )
        return tuple(doubts)

    def _bearable(self, radius: float, load: float) -> None:
        most = 2 * math.pi * self.work_of_adhesion * radius
        if load < -most:
            raise PartedError.of(
                "load",
                load,
                f"pulls the surfaces apart: the pull-off force of a sphere of {radius:g} nm is at most 2πwR = "
                f"{most:.6g} nN",
                f"give a load above {-most:.6g} nN",
            )

    def _plain(self) -> FFTBEM:
        """The contact without attraction."""
        shared = GridSolver.model_fields.keys() - {"on_failure", "gap", "levels"}
        options = {name: getattr(self, name) for name in shared}
        return FFTBEM(tolerance=1e-3, on_failure="return", **options)

    @property
    def _zone(self) -> float:
        """Length of the zone of cohesion, E*ρ²/w, nm; infinite without adhesion."""
        if not self.work_of_adhesion:
            return math.inf
        return self.modulus * self.range**2 / self.work_of_adhesion

    def _unresolved(self, size: float) -> str:
        """What is wrong with pixels of ``size`` nm, if they are not refused."""
        if not self.work_of_adhesion:
            return ""
        needed = COARSEST * self._zone
        if size <= needed * (1 + 1e-9):
            return ""
        why = (
            f"pixels of {size:.4g} nm do not resolve the zone in which the surfaces attract each other, "
            f"E*ρ²/w = {self._zone:.4g} nm long, so that the contact sticks to the grid"
        )
        if self.coarse == "refuse":
            raise InputError.of(
                "range",
                self.range,
                why,
                f"use pixels of {needed:.4g} nm or less, or a longer range",
            )
        return f"{why}; use pixels of {needed:.4g} nm or less"

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        contact = self._from(surface, load, None)[0]
        padded = contact.pressure.size * (1 if contact.periodic else 4)
        if not self.work_of_adhesion or padded > BOTH_SIDES:
            return contact
        other = self.replace(
            start="apart" if self.start == "contact" else "contact",
            tolerance=max(self.tolerance, OTHER_TOLERANCE),
            on_failure="return",
        )
        try:
            there = other._from(surface, load, None)[0]
        except InputError:  # that there is no contact
            return contact
        errors = {
            name: parts | {"branch": there.measure(name) - contact.measure(name)}
            for name, parts in contact.convergence.get("errors", {}).items()
        }
        return contact.model_copy(
            update={"convergence": {**contact.convergence, "errors": errors}}
        )

    def solve_displacement(
        self, surface: Surface, displacement: float | str
    ) -> ContactSolution:
        """The contact at a given approach: ``displacement`` in nm since first touch without attraction, of the mean
        plane of the elastic body (periodic) or of points far away (free); below zero the surfaces are apart, or held
        together by adhesion. The load follows."""
        return self._from(surface, None, None, convert(displacement, "nm"))[0]

    def loop(self, surface: Surface, path: Path | Sequence[float | str]) -> Loop:
        """The contacts along a path of approaches or of loads, each from the one before, from surfaces apart: pull-off,
        jumps, and the work that is lost. See :class:`chemage_contact.paths.Path`."""
        if self.hardness is not None:
            raise InputError.of(
                "hardness",
                self.hardness,
                "is not followed along a path of contacts that adhere",
                "leave it out, or use contact 'fft-bem'",
            )
        path = Path.of(path)
        follower = self._follow(surface, path)
        found = follower.quantities(path.control)
        other: dict[str, Any] = {}
        with contextlib.suppress(ChemageError):
            other = self._follow(finer(surface), path).quantities(path.control)
        # over which a stress that jumps is spread
        ramp = surface.pixel_size / self._zone if self.law == "dugdale" else 0.0
        for name in found.keys() - {"jumps"}:
            value, unit = found[name].value, found[name].unit
            scale = self.range if unit == "nm" else abs(value)
            held = scale if unit == "nm" else HELD * scale
            if name == "dissipated":
                held = LOST * self.range * found["pull_off"].value
            change = other[name].value - value if other else math.nan
            least = ANYWHERE * scale if unit == "nm" else 0.0
            bound = self.tolerance * scale
            found[name] = more_errors(
                found[name],
                iteration=(bound, "the tolerance, of the value or of the range"),
                pixel=(
                    math.hypot(CHANGE[self.law] * change, least, ramp * held),
                    "the same path on smaller pixels",
                ),
            )
        return Loop.of(
            follower.states,
            follower.given,
            contacts=tuple(follower.contacts),
            **found,
        )

    def _follow(self, surface: Surface, path: Path) -> Follower:
        """The states along a path."""
        by_load = path.control == "load" and path.target is None

        def solve(value: float, last: PathState | None) -> PathState:
            load, approach = (value, None) if by_load else (None, value)
            before = last.memory if last is not None else None
            try:
                contact, memory, energies = self._from(
                    surface, load, before, approach
                )
            except PartedError:
                return PathState(-math.inf, 0.0, 0.0)
            rise = float(contact.displacement or 0.0)
            energy, attraction = energies
            return PathState(
                rise,
                contact.load,
                contact.area,
                energy,
                -attraction,
                memory,
                contact,
            )

        follower = Follower(solve)
        if path.target is None:
            follower.follow(path.values)
            return follower
        far = -self.range * (-math.log(GONE) if self.law == "exponential" else 2.0)
        deepest = self._from(surface, path.target, None)[0].displacement or 0.0
        around = path.there_and_back(far, deepest)
        follower.follow(around.values)
        step = (deepest - far) / path.points
        while (last := follower.states[-1]).area or last.load < GONE * min(
            state.load for state in follower.states
        ):
            follower.follow([follower.values[-1] - step])
        if follower.values[-1] < far:
            follower.follow([far])
        return follower

    def _from(
        self,
        surface: Surface,
        load: float | None,
        before: _Before | None,
        approach: float | None = None,
    ) -> tuple[ContactSolution, _Before, tuple[float, float]]:
        """The contact under ``load``, or at ``approach`` (nm), where the next one may begin, and :meth:`Adhesive.energies`
        in nN nm."""
        size, modulus = surface.pixel_size, self.modulus
        coarse = self._unresolved(size)
        heights = surface.heights.astype(np.float64)
        heights -= heights.max()
        self.check_body(surface.nominal_area, size, load or 0.0)
        body = self.body(surface)
        if load is not None and not math.isfinite(
            load / surface.nominal_area / modulus
        ):
            raise InputError.of(
                "load",
                load,
                "leaves the range of numbers when spread over the surface",
            )
        if load is not None and "radius" in surface.provenance:
            self._bearable(float(surface.provenance["radius"]), load)
        pressure = None if load is None else load / surface.nominal_area / modulus
        with Team(self.threads or threads.available()) as team:
            problem = self._problem(body, heights, pressure, approach, team)
            if approach is not None:
                if problem.floating and not approach < -heights.mean():
                    raise InputError.of(
                        "displacement",
                        f"{approach:g} nm",
                        "is one at which the surfaces touch everywhere",
                        f"give an approach below {-heights.mean():.6g} nm",
                    )
                x, rise = before or problem.undeformed()
                x, rise = problem.placed(x, rise, approach / size)
            else:
                x, rise = before or self._begin(problem, body, heights, load or 0.0)
            found = problem.minimise(x, rise, self.tolerance, self.max_iterations)
        if problem.parted(found):
            raise PartedError.of(
                "load",
                load,
                f"pulls the surfaces apart: no contact bears it from start = {self.start!r} at a work of adhesion of "
                f"{self.work_of_adhesion:g} J/m²",
                "give a load above the pull-off force, which loop() finds"
                + (", or start = 'contact'" if self.start == "apart" else ""),
            )
        rise = self._approach(problem, found)
        unit = modulus * size**3
        energy, attraction = problem.energies(found)
        return (
            self._solution(surface, problem, found, load, rise, coarse),
            (found.x, rise),
            (energy * unit, attraction * unit),
        )

    def _approach(self, problem: Adhesive, found: Iterate) -> float:
        """The approach since first touch, in pixels."""
        nx, ny = problem.shape
        if not problem.floating:
            return found.rise
        return problem.uniform - float((problem.h + found.x[:nx, :ny]).mean())

    def _iteration(self, problem: Adhesive, size: float) -> dict[str, Any]:
        """What the last tenth of the residual changed: of the pressure relatively, of the measures in their units."""
        if problem.ends is None:
            return {"pressure_error": None}
        first, last = problem.ends
        nx, ny = problem.shape
        p, q = (self.modulus * (end.p[:nx, :ny] + end.mean) for end in problem.ends)
        # not by BLAS, whose sums differ between processors
        norm, change = (math.sqrt(float(np.square(x).sum())) for x in (q, q - p))
        highest = float(np.abs(q).max())
        error = math.hypot(change, last.error * norm)
        most = math.hypot(float(np.abs(q - p).max()), last.error * highest)
        flips = np.count_nonzero(
            (first.x <= 0)[:nx, :ny] != (last.x <= 0)[:nx, :ny]
        )
        risen = self._approach(problem, last)
        changed = math.hypot(
            risen - self._approach(problem, first), last.error * risen
        )
        return {
            "pressure_error": error / norm if norm else 0.0,
            "pressure_error_max": most / highest if highest else 0.0,
            "errors": {
                "area": {"iteration": float(flips) * size**2},
                "max_pressure": {"iteration": most},
                "rms_pressure": {"iteration": error / math.sqrt(nx * ny)},
                "displacement": {"iteration": changed * size},
            },
        }

    def _problem(
        self,
        body: Substrate,
        heights: np.ndarray,
        pressure: float | None,
        approach: float | None,
        team: Team,
    ) -> Adhesive:
        """The minimisation on one grid; ``heights`` and ``approach`` in nm, ``pressure`` over the modulus."""
        size = body.unit
        # a stress that falls to zero over twice its own elastic deformation of a pixel leaves neither a pixel nor a few
        # in a row the choice of two gaps
        work = self.work_of_adhesion / self.modulus / size
        reach = self.range / size
        law = CohesiveLaw(
            self.law == "exponential" or None,
            work,
            reach,
            work / reach or reach,
            math.inf if self.hardness is None else self.hardness / self.modulus,
        )
        given = None if approach is None else approach / size
        return Adhesive(body, heights / size, law, pressure, given, team)

    def _begin(
        self, problem: Adhesive, body: Substrate, heights: np.ndarray, load: float
    ) -> _Before:
        """Where the iteration under a given load begins: coarse to fine, from the contact without attraction or from gaps
        closed everywhere. Attraction acts where pixels resolve it."""
        last: tuple[Adhesive, Iterate] | None = None
        for shape, adheres in self._stages(body, load):
            sampled = resampled(
                heights, shape, np.float64, body.periodic, problem.team
            )
            here = self._problem(
                body.regrid(shape), sampled, problem.pressure, None, problem.team
            )
            if not adheres:
                here.law = here.law._replace(work=0.0)
            start = self._first(here, last)
            found = here.minimise(
                *start, COARSE_TOLERANCE[self.start], COARSE_ITERATIONS, 1.0
            )
            last = None if here.parted(found) else (here, found)
        return self._first(problem, last)

    def _stages(self, body: Substrate, load: float) -> Iterator[tuple[Any, bool]]:
        """The grids before the last iteration, and whether the surfaces attract each other on them."""
        elastic = self.start == "apart" and load > 0
        for shape in reversed(grids(body.shape, self.levels)):
            resolved = body.regrid(shape).unit <= COARSEST * self._zone
            if elastic:
                yield shape, False
                elastic = not resolved
            if resolved and shape != body.shape:
                yield shape, True

    def _first(
        self, problem: Adhesive, last: tuple[Adhesive, Iterate] | None
    ) -> _Before:
        apart = self.start == "apart"
        if last is not None:
            return problem.refined(*last, CLOSED if apart else 1 - CLOSED)
        return problem.undeformed() if apart else (np.zeros(problem.padded), 0.0)

    def _solution(
        self,
        surface: Surface,
        problem: Adhesive,
        found: Iterate,
        load: float | None,
        rise: float,
        coarse: str,
    ) -> ContactSolution:
        size, area, law = surface.pixel_size, surface.pixel_size**2, problem.law
        nx, ny = surface.shape
        reduced = np.ascontiguousarray(found.x[:nx, :ny])
        pressure = (
            np.ascontiguousarray(found.p[:nx, :ny]) + found.mean
        ) * self.modulus
        attracts = {}
        if self.work_of_adhesion:
            attracts["attraction"] = self.work_of_adhesion / self.range
            attracts["pixel_factor"] = 1 + RIM * size / self._zone
        flow = None
        if self.hardness is not None:
            np.minimum(pressure, self.hardness, out=pressure)
            flow = np.maximum(-reduced, 0.0) * size
        force = float(pressure.sum()) * area
        borne = float(np.abs(pressure).sum()) * area
        converged = found.error <= self.tolerance
        notes = [coarse] if coarse else []
        if not converged:
            why = "no step lowers the energy any more"
            remedy = "accept a larger tolerance"
            if problem.iterations >= self.max_iterations:
                why = "the iteration limit was reached"
                remedy = "raise max_iterations, or accept a larger tolerance"
            message = (
                f"adhesive-bem: {why} after {problem.iterations} iterations with a relative stress of "
                f"{found.error:.3g} out of balance (tolerance {self.tolerance:g}): {remedy}"
            )
            if self.on_failure == "raise":
                raise ConvergenceError(
                    message,
                    history=problem.history,
                    residual=found.error,
                    tolerance=self.tolerance,
                )
            notes.append(message)
        if not self.is_nominally_flat(surface.periodic):
            # beyond the outermost pixels nothing acts
            nearest = min(
                float(edge.min())
                for edge in (reduced[0], reduced[-1], reduced[:, 0], reduced[:, -1])
            )
            reach = law.range * -math.log(AT_EDGE) if law.exponential else law.range
            if nearest <= 0 and "tip" in surface.provenance:
                raise InputError.of(
                    "load",
                    force if load is None else load,
                    f"the contact of this tip reaches the edge of its grid ({nx} x {ny} pixels of {size:.4g} nm), "
                    "where it is cut off",
                    "use a smaller load, or a body on more pixels",
                )
            if nearest <= 0:
                notes.append(
                    "contact at the edge of the grid, beyond which nothing carries load"
                )
            elif law.work and nearest <= reach:
                notes.append(
                    "the surfaces attract each other at the edge of the grid, beyond which nothing acts: use more "
                    "pixels"
                )
        return self.solution(
            surface,
            pressure=pressure,
            touching=reduced <= 0,
            gap=np.maximum(reduced, 0.0) * size if self.gap else None,
            plastic_displacement=flow,
            load=force if load is None else load,
            displacement=rise * size,
            converged=converged,
            residual=found.error,
            iterations=problem.iterations,
            convergence={
                "tolerance": self.tolerance,
                **self._iteration(problem, size),
                **attracts,
                "force_error": abs(force - load) / borne
                if load is not None and borne
                else 0.0,
                "transforms": problem.transforms,
                "history": problem.history,
            },
            notes=tuple(notes),
        )
