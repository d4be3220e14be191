"""What the contact solvers of this package have in common: the contact modulus, the solution, and checks of spheres."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import ContactModulus, ContactSolver

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
        "pressure": 'a nominal pressure is a load: load = "20 MPa"',
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
        return ContactSolution(**known | fields)


class SphereSolver(HalfSpaceSolver, ABC):
    """A closed form of a sphere, whose apex is the middle of the grid."""

    #: the contact of this package that takes any surface
    general: ClassVar[str]

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
        what: str = "the contact has",
    ) -> None:
        """Refuse a contact of radius ``edge`` (nm) on a surface that reaches less far from the apex."""
        room = 0.5 * min(shape) * size
        if edge > room:
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
