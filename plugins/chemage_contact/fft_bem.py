"""Any surface on an elastic half-space, by the boundary element method with Fourier transforms."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import (
    ConvergenceError,
    Length,
    Pressure,
    Unit,
    convert,
    threads,
)
from chemage_contact import _iteration as iteration
from chemage_contact import _kernels as kernels
from chemage_contact._descent import GridSolution
from chemage_contact._grid import bounded, rescale, sums
from chemage_contact._kernels import Heights
from chemage_contact._operators import (
    FreeHalfSpace,
    PeriodicHalfSpace,
    PeriodicLayer,
    Substrate,
    Team,
)
from chemage_contact._solvers import GRID, NO_LOAD, HalfSpaceSolver
from chemage_contact.paths import Loop, Path, PathState, wall_loop

#: Thickness of a layer, in pixels and in lengths of the surface. A thinner one is a bed of springs, which rounding
#: errors prevent from converging; a thicker one is a half-space.
THINNEST, THICKEST = 1e-6, 1e12
#: Mean pressures, GPa and relative to the modulus: their squares and sums stay numbers.
SMALLEST_PRESSURE, LARGEST_PRESSURE = 1e-307, 1e120
#: peak memory of a pixel, bytes, on surfaces that repeat and on others (``tests/benchmarks/memory.py``)
_BYTES = {"single": 50.0, "mixed": 70.0, "double": 88.0}
_BYTES_FREE = {"single": 95.0, "mixed": 133.0, "double": 182.0}
_LAYER = "thickness: a layer needs a periodic surface; leave thickness out, or give boundary = 'periodic'"
#: A contact of a tip that reaches beyond this share of the way to the edge of the grid is warned of.
NEAR_EDGE = 0.9
#: The smallest tolerance that single precision reaches, with a margin.
SINGLE_LIMIT = 1e-6
#: A reference: rounding errors of double precision allow little less than its tolerance.
REFERENCE_TOLERANCE, REFERENCE_ITERATIONS = 1e-12, 500

_Ratio = Annotated[Any, Unit("", ge=0, le=0.5)]

_POLONSKY = """@article{polonsky1999,
  author = {Polonsky, I. A. and Keer, L. M.},
  title = {A numerical method for solving rough contact problems based on the multi-level multi-summation and conjugate gradient techniques},
  journal = {Wear},
  volume = {231},
  pages = {206--219},
  year = {1999},
  doi = {10.1016/S0043-1648(99)00113-1},
}"""  # noqa: E501

_BUGNICOURT = """@article{bugnicourt2018,
  author = {Bugnicourt, R. and Sainsot, P. and Dureisseix, D. and Gauthier, C. and Lubrecht, A. A.},
  title = {{FFT}-based methods for solving a rough adhesive contact: description and convergence study},
  journal = {Tribology Letters},
  volume = {66},
  pages = {29},
  year = {2018},
  doi = {10.1007/s11249-017-0980-z},
}"""

_VOLLEBREGT = """@article{vollebregt2014,
  author = {Vollebregt, E. A. H.},
  title = {The bound-constrained conjugate gradient method for non-negative matrices},
  journal = {Journal of Optimization Theory and Applications},
  volume = {162},
  pages = {931--953},
  year = {2014},
  doi = {10.1007/s10957-013-0499-x},
}"""


class GridSolver(HalfSpaceSolver, ABC):
    """A boundary element method on the grid of any surface: an elastic half-space, or a layer."""

    hardness: Pressure | None = None
    """largest pressure, GPa: the material flows where it is reached, and the load spreads; default: elastic"""
    boundary: Literal["auto", "periodic", "free"] = "auto"
    """periodic or free (an isolated contact on an infinite half-space); auto: periodic if the surface is"""
    levels: int | None = Field(default=None, ge=1)
    """number of grids in the coarse-to-fine start; 1: the given grid only; default: chosen automatically"""
    on_failure: Literal["raise", "return"] = "raise"
    """if the tolerance is not reached: raise ConvergenceError, or return a solution with ``converged`` False"""
    gap: bool = False
    """whether the solution contains the gap (memory and file size double)"""
    thickness: Length | None = None
    """thickness of an elastic layer with this modulus, nm (periodic only); default: half-space"""
    poisson_ratio: _Ratio = 0.25
    """Poisson's ratio of the layer; not used for a half-space"""
    substrate: tuple[Annotated[Any, Unit("GPa", gt=0)], _Ratio] | None = None
    """Young's modulus (GPa) and Poisson's ratio of the elastic half-space to which the layer is bonded; default: a
    rigid base"""
    threads: int | None = Field(default=None, ge=1)
    """threads of one solve; default: all processors available to this process"""

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        if self.thickness is not None and self.boundary == "free":
            raise ValueError(
                "thickness: a layer needs boundary = 'periodic'; leave one of the two out"
            )
        if self.substrate is not None and self.thickness is None:
            raise ValueError(
                "substrate: it lies below a layer; give the thickness of the layer, or leave it out"
            )
        return self

    def check_body(self, area: float, pixel_size: float, load: float) -> None:
        """Refuse a layer that leaves the range of numbers, and a body too soft; ``area`` nominal, nm²."""
        pressure = load / area
        if self.hardness is not None and pressure > self.hardness * (1 + 1e-12):
            raise InputError.of(
                "hardness",
                self.hardness,
                f"is below the mean pressure of {load:.6g} nN on {area:.6g} nm², which no contact can bear",
                f"give a hardness of at least {pressure:.6g} GPa, or a smaller load",
            )
        thickness = self.thickness
        if (
            thickness is not None
            and not THINNEST * pixel_size <= thickness <= THICKEST * math.sqrt(area)
        ):
            raise InputError.of(
                "thickness",
                thickness,
                f"is not between {THINNEST:g} pixels of {pixel_size:g} nm and {THICKEST:g} times the surface",
                "give the thickness of the layer in nm; leave it out for a half-space",
            )

    def body(self, surface: Surface) -> Substrate:
        pixel = (surface.pixel_size, surface.pixel_size)
        if self.thickness is not None:
            if not self.is_nominally_flat(surface.periodic):
                raise InputError(_LAYER)
            layer = PeriodicLayer(
                surface.shape, pixel, self.thickness, self.poisson_ratio
            )
            if self.substrate is None:
                return layer
            young, poisson = self.substrate
            ratio = (
                self.modulus * (1.0 - self.poisson_ratio) * (1.0 + poisson) / young
            )
            return replace(layer, ratio=ratio, poisson_below=poisson)
        if self.is_nominally_flat(surface.periodic):
            return PeriodicHalfSpace(surface.shape, pixel)
        return FreeHalfSpace(surface.shape, pixel)


class FFTBEM(GridSolver):
    """Frictionless, non-adhesive hard-wall contact of a rigid surface with a flat elastic body, at a given load.

    Finds the pressure with p ≥ 0, gap ≥ 0, p·gap = 0 on every pixel. Converged means that both errors are below
    ``tolerance``: the rms gap over the contact and the largest penetration outside it, relative to the rms height, or
    to the approach since first touch where that is smaller. They are those of the pressure that is returned.
    ``ContactSolution.convergence`` also estimates the error of the pressure: ``pressure_error`` (L2 norm, relative) and
    ``pressure_error_max`` (largest, relative to the largest pressure).
    Contact on the outermost pixels of a free surface is an error for tips (``provenance["tip"]``), else a note.
    The iteration is described in ``chemage_contact._iteration``; its speed and accuracy in ``docs/contact.md``.
    """

    kind = "fft-bem"
    implemented_properties = ("pressure", "gap", "displacement")
    later = ("hardness", "substrate")
    speed_only = ("threads",)
    trade = {
        "precision": ("single", "mixed", "double"),
        "tolerance": (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10),
    }
    cite = (
        "I. A. Polonsky, L. M. Keer, Wear 231, 206 (1999)",
        "L. Bugnicourt, P. Sainsot, D. Dureisseix, C. Gauthier, A. A. Lubrecht, Tribol. Lett. 66, 29 (2018)",
        "E. A. H. Vollebregt, J. Optim. Theory Appl. 162, 931 (2014)",
    )
    bibtex = (_POLONSKY, _BUGNICOURT, _VOLLEBREGT)

    tolerance: float = Field(default=1e-5, gt=0, lt=1, allow_inf_nan=False)
    """largest error of the gap, relative to the rms height (or to the approach since first touch, where smaller)"""
    pressure_tolerance: float | None = Field(
        default=None, gt=0, lt=1, allow_inf_nan=False
    )
    """largest estimated relative L2 error of the pressure, in addition to ``tolerance``; default: not required"""
    precision: Literal["single", "double", "mixed"] = "mixed"
    """mixed: iterate in single, pressure and gap in double precision (as accurate as double); single: least memory"""
    max_iterations: int = Field(default=500, ge=0)
    """largest number of iterations on the given grid"""
    fft: Literal["scipy", "ducc0", "pyfftw", "mkl_fft"] = "scipy"
    """Fourier transform library; all but scipy must be installed separately (note their licences)"""

    @property
    def declared_error(self) -> float | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the pressure on a half-space, see ``docs/contact.md``; None for a layer, which has no closed form here."""
        return (
            None
            if self.thickness is not None
            else min(1e-3 + 30 * self.tolerance, 1.0)
        )

    @model_validator(mode="after")
    def _check(self) -> FFTBEM:
        if self.precision == "single" and self.tolerance < SINGLE_LIMIT:
            raise ValueError(
                f"tolerance = {self.tolerance:g}: single precision cannot reach this; "
                f"use precision = 'mixed', or a tolerance of at least {SINGLE_LIMIT:g}"
            )
        if self.tolerance < 1e-13:
            raise ValueError(
                f"tolerance = {self.tolerance:g}: below the rounding errors of double precision; use 1e-12 or more"
            )
        return self

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """Area fraction from κ = 2.2 and Persson's theory, cost and memory from measurements (``docs/contact.md``)."""
        if not {"nx", "ny"} <= surface.keys():
            return {}
        pixels = surface["nx"] * surface["ny"]
        repeats = self.is_nominally_flat(surface.get("periodic") != 0)
        estimate = {
            "bytes": pixels * (_BYTES if repeats else _BYTES_FREE)[self.precision]
        }
        if maps := self.gap + (self.hardness is not None):
            size = float(np.dtype(iteration.PRECISIONS[self.precision][0]).itemsize)
            estimate["gap_bytes"] = pixels * size * maps
            estimate["bytes"] += estimate["gap_bytes"]
        if self.hardness is not None:
            estimate["max_pressure"] = self.hardness
        fraction = 0.1
        if {"pixel_size", "rms_slope"} <= surface.keys():
            x = load / (pixels * surface["pixel_size"] ** 2) / self.modulus
            x = (
                x / surface["rms_slope"]
                if surface["rms_slope"] > 0
                else math.inf
                if load > 0
                else 0.0
            )
            fraction = estimate["area_fraction"] = math.erf(
                2.2 * x / math.sqrt(4.0 / math.pi)
            )
            if self.hardness is not None:
                full = load / (pixels * surface["pixel_size"] ** 2) / self.hardness
                fraction = estimate["area_fraction"] = min(max(fraction, full), 1.0)
        if {"pixel_size", "radius"} <= surface.keys() and not repeats:
            edge = self._radius(surface["radius"], load)
            fraction = estimate["area_fraction"] = min(
                math.pi * edge**2 / (pixels * surface["pixel_size"] ** 2), 1.0
            )
        return estimate | {"cpu_seconds": self._seconds(pixels, fraction, repeats)}

    def _radius(self, radius: float, load: float) -> float:
        """Radius of the contact of a sphere, nm: the larger one of Hertz and of full yield."""
        elastic = math.cbrt(0.75 * load * radius / self.modulus)
        return (
            elastic
            if self.hardness is None
            else max(elastic, math.sqrt(load / self.hardness / math.pi))
        )

    def _seconds(self, pixels: float, fraction: float, periodic: bool) -> float:
        """CPU seconds of a solve, as measured on a 2-core Intel Xeon machine (``tests/benchmarks/estimates.py``); contacts
        of more than a tenth of the area need no more iterations."""
        required = min(self.tolerance, 0.2 * (self.pressure_tolerance or 1.0))
        digits = math.log10(1e-5 / required)
        work = (1.8e-7 + 1.2e-6 * math.sqrt(min(fraction, 0.1))) * max(
            0.5, 1.0 + 0.14 * digits
        )
        factor = {"single": 0.95, "mixed": 1.0, "double": 1.4}[self.precision]
        return 0.03 + pixels * work * factor * (1.0 if periodic else 1.4) * (
            2.0 if self.levels == 1 else 1.0
        )

    def check(self, surface: Mapping[str, float], load: float) -> tuple[str, ...]:
        """See :meth:`chemage.plugin.ContactSolver.check`."""
        if (
            self.thickness is not None
            and self.boundary == "auto"
            and surface.get("periodic") == 0
        ):
            raise InputError(_LAYER)
        if not surface.keys() >= GRID:
            return ()
        size = surface["pixel_size"]
        area = surface["nx"] * surface["ny"] * size**2
        self._check_range(area, size, load)
        doubts = []
        # to the outermost pixels, which must not touch (see _at_edge)
        room = 0.5 * (min(surface["nx"], surface["ny"]) - 1) * size
        if "radius" in surface:
            edge = self._radius(surface["radius"], load)
            if edge > room:
                raise InputError.of(
                    "load",
                    load,
                    f"the contact has a radius of about {edge:.4g} nm, but the surface reaches only "
                    f"{room:.4g} nm from the apex, so that the contact would be cut off at the edge of the grid",
                    "use more pixels or a smaller load",
                )
            if edge > NEAR_EDGE * room:
                doubts.append(
                    f"the contact reaches {100 * edge / room:.0f} % of the way from the apex to the edge of the grid "
                    f"({edge:.4g} of {room:.4g} nm); use more pixels"
                )
        if self.boundary == "periodic" and surface.get("periodic") == 0:
            doubts.append(
                "boundary = 'periodic' repeats a surface that is not periodic: its opposite edges become neighbours; "
                "use boundary = 'free', or 'auto'"
            )
        if self.boundary == "free" and surface.get("periodic") == 1:
            doubts.append(
                "boundary = 'free' takes one period of a periodic surface for the whole body: sites near its edges "
                "carry the pressures of the edge of a punch; use boundary = 'periodic', or 'auto'"
            )
        return tuple(doubts)

    def warm_up(self, surface: Mapping[str, float], load: float) -> None:
        """See :meth:`chemage.plugin.ContactSolver.warm_up`."""
        if load == 0 or not surface.keys() >= GRID:
            return
        shape = (int(surface["nx"]), int(surface["ny"]))
        pixel = (surface["pixel_size"], surface["pixel_size"])
        periodic = self.is_nominally_flat(surface.get("periodic") != 0)
        # of the body, only its grid matters
        body = (PeriodicHalfSpace if periodic else FreeHalfSpace)(shape, pixel)
        iteration.compile_kernels(
            body, self._settings(), bounded=self.hardness is not None
        )

    def _check_range(self, area: float, pixel_size: float, load: float) -> None:
        """As :meth:`check_body`, and refuse pressures that leave the range of numbers."""
        self.check_body(area, pixel_size, load)
        if load == 0:
            return
        pressure = load / area
        if not (
            SMALLEST_PRESSURE < pressure < LARGEST_PRESSURE
            and pressure / self.modulus > SMALLEST_PRESSURE
        ):
            raise InputError.of(
                "load",
                load,
                "leaves the range of numbers when spread over the surface",
            )
        if self.precision == "single" and not (
            load / pixel_size**2 > 1e-35 and pressure < 1e35
        ):
            raise InputError.of(
                "load",
                load,
                "the pressure leaves the range of float32",
                "use precision = 'mixed'",
            )

    def reference(self) -> FFTBEM:
        """Double precision at a tolerance of 1e-12, or the nearest to it that rounding errors allow."""
        return self.replace(
            precision="double",
            tolerance=min(self.tolerance, REFERENCE_TOLERANCE),
            pressure_tolerance=None,
            max_iterations=max(self.max_iterations, REFERENCE_ITERATIONS),
            on_failure="return",
        )

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        self._check_range(surface.nominal_area, surface.pixel_size, load)
        if load == 0:
            return self._untouched(surface, 0.0)
        pressure = load / surface.nominal_area
        quantum = _power_of_two(pressure)
        # Growing the contact takes longer than shrinking it; where coarse grids are the better start is measured
        # (``docs/contact.md``).
        near = (
            start is not None
            and start.shape == surface.shape
            and 0.8 * start.load <= load <= 1.05 * start.load
        )
        with Team(self.threads or threads.available()) as team:
            heights, unit = _dimensionless(surface, pressure / self.modulus, team)
            goal: dict[str, Any] = {
                "mean": pressure / quantum,
                "start": start.pressure if start is not None and near else None,
            }
            return self._solved(
                surface,
                self.body(surface),
                heights,
                unit,
                quantum,
                load,
                team,
                goal,
            )

    def sweep(
        self, surface: Surface, loads: Sequence[float | str]
    ) -> list[ContactSolution]:
        """Contacts of ``surface`` under each of ``loads`` (forces or nominal pressures), in the order given.

        Solved from the smallest load to the largest, each from its neighbour. This is the area–load curve:
        ``[(c.load, c.area) for c in solver.sweep(surface, loads)]``. None remembers another: see :meth:`loop`.
        """
        values = [self.normal_force(load, surface) for load in loads]
        contacts: dict[int, ContactSolution] = {}
        start: ContactSolution | None = None
        for i in sorted(range(len(values)), key=values.__getitem__):
            start = contacts[i] = self.solve(surface, values[i], start=start)
        return [contacts[i] for i in range(len(values))]

    def solve_displacement(
        self, surface: Surface, displacement: float | str
    ) -> ContactSolution:
        """The contact at a given approach: ``displacement`` in nm since first touch, of the mean plane of the elastic
        body (periodic) or of points far away (free). The load follows.

        Raises
        ------
        InputError
            The approach is not finite, or not below that of full contact (where the load is undetermined).
        ConvergenceError
            As for :meth:`solve`.
        """
        approach = convert(displacement, "nm")
        if not math.isfinite(approach):
            raise InputError.of(
                "displacement",
                displacement,
                "must be finite",
                "give a length such as 1 nm",
            )
        heights = surface.heights
        if approach <= 0:
            return self._untouched(surface, approach)
        body = self.body(surface)
        flat = body.periodic and (
            self.thickness is None or self.substrate is not None
        )
        if flat and self.hardness is None:
            limit = float(heights.max()) - float(heights.mean(dtype=np.float64))
            if approach >= limit:
                raise InputError.of(
                    "displacement",
                    displacement,
                    f"the surface is flat after {limit:.6g} nm and the mean plane goes no further",
                    "give a smaller approach, or a load",
                )
        strain = approach / max(surface.shape) / surface.pixel_size
        with Team(self.threads or threads.available()) as team:
            scaled, unit = _dimensionless(surface, strain, team)
            quantum = _power_of_two(self.modulus * (unit / surface.pixel_size))
            return self._solved(
                surface,
                body,
                scaled,
                unit,
                quantum,
                None,
                team,
                {"offset": -approach / unit},
            )

    def loop(self, surface: Surface, path: Path | Sequence[float | str]) -> Loop:
        """The contacts along a path of loads or of approaches, in the order given; with a hardness each of the shape
        that those before have left. See :class:`chemage_contact.paths.Path`.

        Approaches are since first touch of ``surface``, and the ``plastic_displacement`` of each contact is all of it,
        so that ``contact.residual_surface(surface)`` is what is left. The dissipated energy is the hardness times the
        volume that has flowed, because the pressure is the hardness where it flows.
        """
        path = Path.of(path)
        if path.target is not None:
            path = replace(path.there_and_back(0.0, path.target), control="load")
        left, top = surface, float(surface.heights.max())
        contacts: list[ContactSolution] = []
        sunk = error = 0.0
        for value in path.values:
            contact = (
                self.solve(left, value, start=contacts[-1] if contacts else None)
                if path.control == "load"
                else self.solve_displacement(left, value - sunk)
            )
            more: dict[str, Any] = {
                "displacement": (contact.displacement or 0.0) + sunk
            }
            if (flow := contact.plastic_displacement) is not None:
                if flow.any():
                    left = contact.residual_surface(left)
                    told = contact.convergence
                    shaky = told["rms_gap"] * told["scale"] * np.count_nonzero(flow)
                    error = max(error, shaky)
                total = np.maximum(surface.heights - left.heights, 0)
                total.setflags(write=False)
                loads = [*(one.load for one in contacts), contact.load]
                more |= {
                    "plastic_displacement": total,
                    "rms_height": surface.rms_height,
                    "rms_slope": surface.rms_slope,
                    "provenance": self.provenance(surface) | {"path": loads},
                }
            sunk = top - float(left.heights.max())
            contacts.append(contact.model_copy(update=more))
        unit = (self.hardness or 0.0) * surface.pixel_size**2
        lost = unit * float(
            np.sum(surface.heights - left.heights, dtype=np.float64)
        )
        states = [
            PathState(one.displacement or 0.0, one.load, one.area)
            for one in contacts
        ]
        return Loop.of(
            states,
            range(len(states)),
            contacts=tuple(contacts),
            **wall_loop(states, sunk, lost, unit * error),
        )

    def _settings(self) -> iteration.Settings:
        return iteration.Settings(
            tolerance=self.tolerance,
            precision=self.precision,
            max_iterations=self.max_iterations,
            levels=self.levels,
            library=self.fft,
            pressure_tolerance=self.pressure_tolerance,
        )

    def _untouched(self, surface: Surface, approach: float) -> ContactSolution:
        """The solution without contact: a load of zero, or an approach of zero or less."""
        pressure = np.zeros(
            surface.shape, dtype=iteration.PRECISIONS[self.precision][0]
        )
        return self.solution(
            surface,
            pressure=pressure,
            gap=float(surface.heights.max()) - approach - surface.heights
            if self.gap
            else None,
            plastic_displacement=None
            if self.hardness is None
            else np.zeros_like(pressure),
            load=0.0,
            displacement=approach,
            convergence=self._report(
                None, force_error=0.0, complementarity=0.0, scale=0.0
            ),
            notes=NO_LOAD if approach == 0 else (),
        )

    def _solved(
        self,
        surface: Surface,
        body: Substrate,
        heights: Heights,
        unit: float,
        pressure: float,
        load: float | None,
        team: Team,
        goal: dict[str, Any],
    ) -> ContactSolution:
        """The solution of ``goal`` in units of ``unit`` (nm) and ``pressure`` (GPa); without ``load``, it is the sum of
        the pressure."""
        stiffness = pressure / self.modulus * (surface.pixel_size / unit)
        hardness = None if self.hardness is None else self.hardness / pressure
        goal |= {
            "stiffness": stiffness,
            "hardness": hardness,
            "settings": self._settings(),
        }
        result = iteration.solve(body, heights, team=team, **goal)
        values = result.pressure
        area = surface.pixel_size**2
        flow = None if hardness is None else self._flow(result, hardness, unit)
        total, weighted, least = sums(values, result.gap, team)
        complementarity = weighted / total / result.scale if weighted else 0.0
        # The factor is a power of two: nothing is rounded.
        force = rescale(values, pressure, team) * area
        load = force if load is None else load
        notes = list(result.notes)
        if not result.converged:
            message = self._failure(result)
            if self.on_failure == "raise":
                raise ConvergenceError(
                    message,
                    history=[max(pair) for pair in result.history],
                    residual=result.error,
                    tolerance=self.tolerance,
                )
            notes.append(message)
        edge = (
            []
            if self.is_nominally_flat(surface.periodic)
            else self._at_edge(surface, values, load, -result.offset * unit)
        )
        notes += (
            self._full(surface, result, flow)
            if values.size and least > 0.0
            else edge
        )
        force_error = abs(force / load - 1.0) if load > 0 else 0.0
        if not force_error < 1e-3:
            raise InputError.of(
                "load",
                load,
                f"the pressure leaves the range of {values.dtype} numbers",
            )
        gap = None
        if self.gap:
            gap = np.maximum(result.gap, 0.0)
            gap *= unit
        return self.solution(
            surface,
            pressure=values,
            gap=gap,
            plastic_displacement=flow,
            load=load,
            displacement=-result.offset * unit,
            converged=result.converged,
            residual=result.error,
            iterations=result.iterations,
            convergence=self._report(
                result,
                force_error=force_error,
                complementarity=complementarity,
                scale=result.scale * unit,
            ),
            notes=tuple(notes),
        )

    def _flow(
        self, result: GridSolution, hardness: float, unit: float
    ) -> np.ndarray:
        """The overlap where the pressure is the hardness, in nm; it is taken from the gap, which is then closed."""
        values = result.pressure
        flow = np.where(
            values >= bounded(hardness, values.dtype.type),
            np.maximum(-result.gap, 0),
            0,
        )
        result.gap += flow
        flow *= unit
        return flow

    def _full(
        self, surface: Surface, result: GridSolution, flow: np.ndarray | None
    ) -> list[str]:
        """Notes of a contact in which every pixel touches."""
        more = (
            "uniform pressure"
            if self.is_nominally_flat(surface.periodic)
            else "the pressure of a flat punch"
        )
        more = (
            f"adds {more}"
            if flow is None or not flow.any()
            else "makes more of it yield"
        )
        notes = [f"full contact: every pixel touches, and more load only {more}"]
        if result.converged and result.error >= self.tolerance:
            notes.append(
                f"the pressure is exact up to the rounding of {result.pressure.dtype} numbers, which at this load "
                f"leaves a relative gap error of {result.error:.3g} (tolerance {self.tolerance:g})"
            )
        return notes

    def _at_edge(
        self, surface: Surface, pressure: np.ndarray, load: float, approach: float
    ) -> list[str]:
        """A note of contact on the outermost pixels of a free surface; of a tip, an error: its contact is cut off, as
        where the surfaces beyond the grid are less than the approach below the highest point."""
        nx, ny = pressure.shape
        below = surface.provenance.get("tip", {}).get("below", math.inf)
        if approach > below:
            raise InputError.of(
                "load",
                load,
                f"the tip may touch the counterface beyond its grid ({nx} x {ny} pixels of {surface.pixel_size:.4g} nm), "
                f"too: of the highest points, one there is {below:.4g} nm lower, and the approach is {approach:.4g} nm",
                f"give the tip depth = '{1.5 * approach:.2g} nm' or more, another place, or use a smaller load",
            )
        rows = pressure[sorted({0, nx - 1})]
        columns = pressure[1:-1, sorted({0, ny - 1})]
        total = float(rows.sum(dtype=np.float64) + columns.sum(dtype=np.float64))
        if not total > 0.0:
            return []
        share = total / float(pressure.sum(dtype=np.float64))
        if "tip" in surface.provenance:
            raise InputError.of(
                "load",
                load,
                f"the contact of this tip reaches the edge of its grid ({nx} x {ny} pixels of "
                f"{surface.pixel_size:.4g} nm), where it is cut off: the outermost pixels carry {100 * share:.2g} % "
                "of the load",
                "use a smaller load, or a body on more pixels",
            )
        where = "contact at the edge of the grid, beyond which nothing carries load"
        return [
            f"{where}: {100 * share:.2g} % of the load is on the outermost pixels, as at the edge of a punch"
        ]

    def _report(
        self, result: GridSolution | None, **errors: float
    ) -> dict[str, Any]:
        """The errors of the solution and how it was found: plain values."""
        numbers: dict[str, Any] = {
            "tolerance": self.tolerance,
            "precision": self.precision,
            "rms_gap": result.rms_gap if result else 0.0,
            "penetration": result.penetration if result else 0.0,
            "pressure_error": result.pressure_error[0] if result else 0.0,
            "pressure_error_max": result.pressure_error[1] if result else 0.0,
            "transforms": result.transforms if result else 0,
            "history": [
                [float(rms), float(deepest)] for rms, deepest in result.history
            ]
            if result
            else [],
            "levels": [
                {"pixels": list(shape), "iterations": n}
                for shape, n in result.levels
            ]
            if result
            else [],
        }
        return numbers | errors

    def _failure(self, result: GridSolution) -> str:
        larger = "accept a larger tolerance"
        if result.iterations >= self.max_iterations:
            why = "the iteration limit was reached"
            remedy = f"raise max_iterations, or {larger}"
        elif result.rounding and self.precision == "single":
            why = "rounding errors of single precision were reached"
            remedy = f"use precision = 'mixed', or {larger}"
        elif result.rounding:
            why, remedy = "rounding errors of double precision were reached", larger
        elif self.precision == "double":
            why, remedy = "the error stopped falling", larger
        else:
            why = "the error stopped falling"
            remedy = f"{larger}, or use precision = 'double'"
        return (
            f"fft-bem: {why} after {result.iterations} iterations at a relative gap error of {result.error:.3g} "
            f"(rms gap {result.rms_gap:.3g}, penetration {result.penetration:.3g}; tolerance {self.tolerance:g}): "
            f"{remedy}"
        )


def _dimensionless(
    surface: Surface, strain: float, team: Team
) -> tuple[Heights, float]:
    """Heights below the highest point in units of their rms value, and that unit in nm.

    A surface counts as flat if its heights vanish or differ by rounding only; the unit is then the displacement
    under a mean ``strain`` (pressure over modulus).
    """
    heights = surface.heights
    nx, ny = heights.shape
    top = float(heights.max())
    unit = top - float(heights.min())
    if unit <= max(8.0 * float(np.finfo(heights.dtype).eps) * abs(top), 1e-290):
        return Heights(heights, top, 0.0), strain * max(nx, ny) * surface.pixel_size
    # Relative to the largest value, so that squares of 1e-200 nm do not underflow.
    part = team.table(kernels.moments, nx, 2, heights, top, 1.0 / unit)
    spread = math.sqrt(
        float(part[:, 1].sum()) / (nx * ny) + float(part[:, 0].var())
    )
    return Heights(heights, top, 1.0 / unit / spread), unit * spread


def _power_of_two(value: float) -> float:
    """The largest power of two that does not exceed a positive value; at least the smallest normal number."""
    return math.ldexp(1.0, max(math.frexp(value)[1] - 1, -1022))
