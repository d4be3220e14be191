"""What the contact solvers of this package have in common: the contact modulus, the solution, and checks of spheres."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import ContactModulus, ContactSolver
from chemage_contact.paths import (
    Branch,
    Loop,
    Path,
    PathState,
    SphereState,
    closed_loop,
    loaded_loop,
)

#: notes of a contact without load
NO_LOAD = ("no load: the bodies just touch and no pixel carries pressure",)
#: relative error of closed forms
ROUNDING = 1e-12
#: what :meth:`chemage.plugin.SurfaceMaker.expected` says of a grid
GRID = {"nx", "ny", "pixel_size"}


def tabor(radius: float, work: float, modulus: float, reach: float) -> float:
    """Tabor's parameter (Rw²/(E*²z₀³))^(1/3) of a sphere (nm, nN/nm, GPa, nm)."""
    return math.cbrt(radius * work**2 / modulus**2) / reach


class HalfSpaceSolver(ContactSolver, ABC):
    """A solver for an elastic body of one contact modulus."""

    modulus: ContactModulus
    """contact modulus E* = E/(1−ν²) of the elastic body (or of both, combined), GPa; or their young
    and poisson"""

    elsewhere = {
        "pressure": 'it is a load: load = "20 MPa", or "3 GPa over contact"',
        "adhesion": "contact 'adhesive-bem', of spheres 'jkr', 'dmt' and 'maugis', have a work_of_adhesion",
        "work_of_adhesion": "contact 'adhesive-bem', of spheres 'jkr', 'dmt' and 'maugis', have one",
        "hardness": "contact 'fft-bem', 'adhesive-bem' and, of spheres, 'hertz' have one",
    }
    #: options that an identity has only where they are given, as it had before there were these options
    later: ClassVar[tuple[str, ...]] = ()

    def identity(self) -> dict[str, Any]:
        """As for every component; without :attr:`later` options that are not given."""
        return {
            name: value
            for name, value in super().identity().items()
            if value or name not in self.later
        }

    def is_nominally_flat(self, periodic: bool) -> bool:
        """See :meth:`chemage.plugin.ContactSolver.is_nominally_flat`; ``boundary`` may make it periodic, or free."""
        boundary = getattr(self, "boundary", "auto")
        return periodic if boundary == "auto" else boundary == "periodic"

    def sweep(
        self, surface: Surface, loads: Sequence[float | str]
    ) -> list[ContactSolution]:
        """Contacts of ``surface`` under each of ``loads``, none of which remembers another; ``loop`` follows a path."""
        return [self.solve(surface, load) for load in loads]

    def solution(self, surface: Surface, **fields: Any) -> ContactSolution:
        """The contact of ``surface`` with these fields, whose arrays are frozen."""
        told = {**fields["convergence"], "summit": surface.missed_peak}
        for value in fields.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        known = {
            "pixel_size": surface.pixel_size,
            "modulus": self.modulus,
            "periodic": self.is_nominally_flat(surface.periodic),
            "rms_slope": surface.rms_slope,
            "rms_height": surface.rms_height,
            "provenance": self.provenance(surface),
        }
        return ContactSolution(**known | fields | {"convergence": told})


class SphereSolver(HalfSpaceSolver, ABC):
    """A closed form of a sphere, whose apex is the middle of the grid; here that of Hertz, whose pressure a pull-off
    force adds to the load."""

    #: the contact of this package that takes any surface
    general: ClassVar[str]
    #: CPU seconds, those of each pixel, and its peak memory in bytes
    costs: ClassVar[tuple[float, float, float]]

    def pull_off(self, radius: float) -> float:
        """The largest pull (nN) that a sphere of ``radius`` nm bears."""
        return 0.0

    def at_load(self, radius: float, load: float) -> SphereState:
        """The stable contact under ``load`` nN, which is at least that of pull-off."""
        edge = math.cbrt(
            0.75 * radius / self.modulus * (load + self.pull_off(radius))
        )
        return SphereState(load, edge, edge, edge**2 / radius)

    def _ends(self, radius: float) -> tuple[float, float]:
        """The approaches (nm) at which contact is lost, and at which surfaces apart come into it."""
        return 0.0, 0.0

    def _at(self, radius: float, displacement: float) -> SphereState:
        """The stable contact at an approach, which is at least that at which contact is lost."""
        edge = math.sqrt(displacement * radius)
        load = 4 * self.modulus * edge**3 / (3 * radius) - self.pull_off(radius)
        return SphereState(load, edge, edge, displacement)

    def branches(self, radius: float) -> tuple[Branch, ...]:
        """The equilibria at each approach, from apart to contact."""
        last, first = self._ends(radius)
        least = self.at_load(radius, -self.pull_off(radius)).displacement
        return (
            Branch(-math.inf, first),
            Branch(
                min(last, first), math.inf, partial(self._at, radius), least, True
            ),
        )

    def loop(self, surface: Surface, path: Path | Sequence[float | str]) -> Loop:
        """Load and contact area along a path of approaches or of loads, from surfaces apart, and exactly what it costs.
        See :class:`chemage_contact.paths.Path`."""
        radius, path = self.radius(surface.provenance), Path.of(path)
        branches, pull = self.branches(radius), self.pull_off(radius)
        if path.target is not None:
            last = self.at_load(radius, path.target).displacement
            first = min(branches[0].high, *(branch.low for branch in branches[1:]))
            path = path.there_and_back(first - 0.1 * abs(last - first), last)
        if path.control == "load":
            states, touching = [], False
            for load in path.values:
                # apart after a larger pull than pull-off, until a load presses
                touching = load >= -pull if touching else load >= 0
                apart = SphereState(0.0, 0.0, 0.0, -math.inf)
                states.append(self.at_load(radius, load) if touching else apart)
            lost = self.at_load(radius, -pull).displacement
            found = loaded_loop(states, path.values, pull, lost)
        else:
            states, found = closed_loop(branches, path.values)
        for state in states:
            self.require_room(
                state.outer, surface.shape, surface.pixel_size, state.load
            )
        return Loop.of(
            [
                PathState(state.displacement, state.load, math.pi * state.edge**2)
                for state in states
            ],
            range(len(states)),
            **found,
        )

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """Cost, and the area fraction πa²/A0, where the radius is known."""
        if not surface.keys() >= {*GRID, "radius"}:
            return {}
        pixels, radius = surface["nx"] * surface["ny"], surface["radius"]
        begin, each, memory = self.costs
        found = {"cpu_seconds": begin + each * pixels, "bytes": memory * pixels}
        if load >= -self.pull_off(radius):
            area = math.pi * self._edge(radius, load) ** 2
            fraction = area / pixels / surface["pixel_size"] ** 2
            found["area_fraction"] = min(fraction, 1.0)
        return found

    def _edge(self, radius: float, load: float) -> float:
        """Expected radius of the contact, nm."""
        return self.at_load(radius, load).edge

    def is_nominally_flat(self, periodic: bool) -> bool:
        """A sphere is not."""
        return False

    def radius(self, made: Mapping[str, Any]) -> float:
        """The radius (nm) in the provenance of a surface, or in what its maker expects."""
        radius = made.get("radius")
        if (
            isinstance(radius, bool)
            or not isinstance(radius, int | float)
            or not (0 < radius < math.inf)
        ):
            raise InputError(
                f"contact {self.kind!r} needs a sphere, but this surface has no radius (provenance['radius'] = "
                f"{radius!r}); use surface kind 'sphere' or contact {self.general!r}"
            )
        return float(radius)

    def check(self, surface: Mapping[str, float], load: float) -> tuple[str, ...]:
        """See :meth:`chemage.plugin.ContactSolver.check`."""
        if surface.keys() >= GRID:
            shape = (int(surface["nx"]), int(surface["ny"]))
            self.pressed(shape, surface["pixel_size"], self.radius(surface), load)
        return ()

    @abstractmethod
    def pressed(
        self, shape: tuple[int, int], size: float, radius: float, load: float
    ) -> Any:
        """The contact of a sphere of ``radius`` under ``load``, if it is one and within a grid of pixels of ``size``
        (nm)."""

    def exactly(
        self, contact: ContactSolution, **truth: float | None
    ) -> ContactSolution:
        """``contact`` with its errors: nothing is iterated, and those of its pixels are the differences from the closed
        form, whose measures ``truth`` has; None: infinite, or not known."""
        errors = {
            name: {
                "iteration": 0.0,
                "pixel": None
                if value is None
                else abs(contact.measure(name) - value) + ROUNDING * abs(value),
            }
            for name, value in truth.items()
        }
        convergence = {**contact.convergence, "errors": errors}
        return contact.model_copy(update={"convergence": convergence})

    def require_room(
        self,
        edge: float,
        shape: tuple[int, int],
        size: float,
        load: float,
    ) -> None:
        """Refuse a contact of radius ``edge`` (nm) on a surface that reaches less far from the apex."""
        room = 0.5 * min(shape) * size
        if edge > room:
            what = (
                "contact and attraction have" if self.adheres else "the contact has"
            )
            raise InputError.of(
                "load",
                load,
                f"{what} a radius of {edge:.4g} nm, but the surface reaches only {room:.4g} nm from the apex",
                "use more pixels or a smaller load",
            )

    def edges(self, surface: Surface) -> list[np.ndarray]:
        """The edges of the pixels along both sides, (nx + 1,) and (ny + 1,) nm, from the middle of the grid."""
        return [
            (np.arange(n + 1) - 0.5 * n) * surface.pixel_size for n in surface.shape
        ]

    def distances(self, surface: Surface) -> np.ndarray:
        """Distances of the centres of pixels from the apex, nm."""
        x, y = self.edges(surface)
        return np.hypot((0.5 * (x[1:] + x[:-1]))[:, None], 0.5 * (y[1:] + y[:-1]))
